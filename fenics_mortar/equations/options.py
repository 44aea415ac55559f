# SPDX-License-Identifier: MIT
"""Thresholds of initial guesses and of changes of sets, each with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EquationOptions:
    """Thresholds that no user sets.

    Attributes:
        longest: Longest step over the last one [1], in extrapolated loads and in load steps.
        together: Changes go together if they differ by no more than this fraction of their size
            [1]: motions of the contacts on a body, and loads of two solves, 30 degrees if the sizes
            are equal.
        max_guess_iterations: Iterations after which a guess is abandoned: it has cost more than any
            guess saves.
        max_residual_left: Fraction of the residual that the first iteration from linear
            extrapolation may leave [1]. Measured on 300 steps of sliding and rolling: above it this
            guess costs more than it saves. The moving frame has no limit: it leaves 0.06 of the
            force where the last state leaves 0.5.
        at_rest: Displacement over the shortest facet [1] below which increments of the solution are
            measured by the facet: bodies that do not move have converged.
        wavering: Number of last iterations in which a node that opened and closed wavers.
        max_calls: Largest number of linearized contact problems in a solve: walls and arches need
            one or a few; more only cost time if there is no equilibrium.
        max_touching: Largest number of nodes that may touch in a linearized contact problem: with
            more, Lemke's dense tableau of four rows a node takes longer than the iterations saved
            (about 2 s for this number).
        spring: Stiffness of the springs on a body over its largest diagonal entry of K [1] where
            its compliance is evaluated: larger than the negative stiffness of its loads, of the
            order of the strains, but with a negligible effect on the elastic compliance.
        distortion: Relative motion of a facet's ends over its length above which a step may invert
            cells [1]: the areas of cells there change by about as much, and may change by 0.8, see
            ``Bulk.move``.
    """

    longest: float = 2.0
    together: float = 0.5
    max_guess_iterations: int = 8
    max_residual_left: float = 0.4
    at_rest: float = 1e-8
    wavering: int = 4
    max_calls: int = 8
    max_touching: int = 250
    spring: float = 1e-3
    distortion: float = 0.25


EQUATIONS = EquationOptions()
