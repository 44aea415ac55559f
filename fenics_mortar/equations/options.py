# SPDX-License-Identifier: MIT
"""Thresholds of initial guesses and of changes of sets, each with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EquationOptions:
    """Thresholds that are no options of users.

    Attributes:
        longest: Largest ratio of a step to the last one [1], for extrapolated loads and load steps.
        same_direction: Two changes are considered equal if they differ by at most this fraction of
            their size [1], or by 30 degrees for equal sizes. Applied to motions of the contacts on
            a body, and to loads of two solves.
        max_guess_iterations: Number of iterations after which a guess is abandoned: more than any
            guess saves.
        max_residual_left: Largest ratio of the residual after the first iteration from linear
            extrapolation to that before it [1]. Measured on 300 steps of sliding and rolling: above
            it the guess costs more than it saves. The moving frame has no limit: it leaves 0.06 of
            the force where the last state leaves 0.5.
        at_rest: Displacement over the shortest facet [1] below which increments of the solution are
            measured by the facet, for bodies that do not move.
        recent_sets: Number of last iterations in which nodes that open and close are reported.
        max_calls: Largest number of linearized contact problems in a solve: walls and arches need
            one or a few; if there is no equilibrium, more would only take time.
        max_touching: Largest number of nodes that may touch in a linearized contact problem: with
            more nodes, Lemke's method with a dense tableau of four rows per node takes longer than
            the iterations saved (about 2 s for this number).
        spring: Stiffness of the springs on a body over its largest diagonal entry of K [1] where
            its compliance is evaluated: larger than the negative stiffness of its loads, which is
            of the order of the strains, but small enough to have a negligible effect on the elastic
            compliance.
        distortion: Relative motion of a facet's ends over its length above which a step may invert
            cells [1]: the areas of adjacent cells change by about this fraction, and may change by
            0.8, see ``Bulk.move``.
    """

    longest: float = 2.0
    same_direction: float = 0.5
    max_guess_iterations: int = 8
    max_residual_left: float = 0.4
    at_rest: float = 1e-8
    recent_sets: int = 4
    max_calls: int = 8
    max_touching: int = 250
    spring: float = 1e-3
    distortion: float = 0.25


EQUATIONS = EquationOptions()
