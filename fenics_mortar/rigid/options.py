# SPDX-License-Identifier: MIT
"""Thresholds for rigid motions, each with its unit and the reason for its value."""

from __future__ import annotations

from dataclasses import dataclass

from fenics_mortar.utils.rounding import ASSEMBLY_ROUNDING


@dataclass(frozen=True)
class RigidOptions:
    """Thresholds that floating bodies and driven obstacles share.

    Attributes:
        resisted: Contact resists a motion if it changes gaps, or the slip of sticking nodes, by
            more than this fraction of its size [1].
        weakest_spring: Smallest stiffness of a spring over the largest diagonal entry of K [1]:
            enough for a regular matrix.
        stiffness_rounding: Resultants over stiffness times size that are roundoff of the bulk
            residual [1].
        negligible: Resultants below this fraction of the forces are within the error of the
            discretization [1]: 0.5 %. Springs may carry them; obstacles, whose normals are exact,
            feel such an error of the slave's facets.
        slight: Resultants below this fraction of the forces are small beside the error of contact
            forces along averaged normals, and beside ``negligible`` [1]. Springs may not carry more
            on a body that slides at its friction limit: nothing else would stop it.
        normals_err: Error of contact forces along averaged normals of two meshes [1].
        overlap: Motions before a solve end with nodes this deep inside, over their length [1], so
            that they are active. Bodies that move by less are at rest, with springs as well.
        largest_move: Largest motion in one move over the size of the body [1]: gaps are linear in
            smaller ones.
        max_moves: Moves before a solve.
        max_creeping: Moves in a row, all shorter than ``overlap``, after which contact has stopped
            the bodies but for a creep, as of a disk in a ring, which Newton's method does better.
        followed: Relative singular-value cutoff of the least-squares fit to nodes that stick [1]:
            combinations of motions that move them less than others, as rolling, are left to the
            solve.
        elongation: Elongation of anchored springs per solve [shortest facets].
        recovery: Factor by which a smaller elongation grows after a solve [1]; after a failure it
            shrinks by the cube of this factor.
        max_solves: Solves with springs: they end at rest, or by failures.
        max_failures: Failures in a row, after which the elongation is below 1e-4 facets.
        repeats: Solves with springs that remain: contact then carries all that it can.
        sliver: Length over the shortest facet that counts as zero [1]: the advance of an obstacle
            in a move, or the overlap of surfaces that slip off each other.
    """

    resisted: float = 1e-3
    weakest_spring: float = 1e-6
    stiffness_rounding: float = ASSEMBLY_ROUNDING
    negligible: float = 0.005
    slight: float = 1e-5
    normals_err: float = 0.05
    overlap: float = 0.01
    largest_move: float = 0.2
    max_moves: int = 200
    max_creeping: int = 10
    followed: float = 0.5
    elongation: float = 0.25
    recovery: float = 2.0
    max_solves: int = 24
    max_failures: int = 5
    repeats: int = 3
    sliver: float = 1e-3


RIGID = RigidOptions()
