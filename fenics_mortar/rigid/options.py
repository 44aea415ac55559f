# SPDX-License-Identifier: MIT
"""Thresholds for rigid motions, each with its unit and the reason for its value."""

from __future__ import annotations

from dataclasses import dataclass

from fenics_mortar.utils.rounding import ASSEMBLY_ROUNDING


@dataclass(frozen=True)
class RigidOptions:
    """Thresholds common to floating bodies and driven obstacles.

    Attributes:
        resisted: Contact resists a motion if it changes gaps, or the slip of sticking nodes, by
            more than this fraction of its size [1].
        weakest_spring: Smallest stiffness of a spring over the largest diagonal entry of K [1]:
            enough for a regular matrix.
        weakest_anchor: Smallest stiffness of an anchored spring that forces determine [1]: a weight
            of a millionth of the stiffness moves a body. Smaller forces are rounding.
        stiffness_rounding: Resultants over stiffness times size that are roundoff of the bulk
            residual [1].
        negligible: Resultants below this fraction of the forces are within the error of the
            discretization [1]: 0.5 %. Springs may carry them. Obstacles, whose normals are exact,
            are subject to such an error of the slave's facets.
        slight: Resultants below this fraction of the forces are small compared with the error of
            contact forces along averaged normals, and with ``negligible`` [1]. Springs may not
            carry more on a body that slides at its friction limit, since they alone would stop it.
        normals_err: Error of contact forces along averaged normals of two meshes [1].
        overlap: Overlap of nodes over their length at the end of motions before a solve [1], so
            that the nodes are active. Bodies that move by less are considered at rest, also with
            springs.
        largest_move: Largest motion in one move over the size of the body [1]: gaps are linear in
            smaller motions.
        max_moves: Largest number of moves before a solve.
        max_creeping: Number of successive moves, all shorter than ``overlap``, after which the
            bodies are considered stopped. A remaining creep, such as that of a disk in a ring, is
            left to Newton's method.
        followed: Relative singular-value cutoff of the least-squares fit to nodes that stick [1]:
            combinations of motions with small slip, such as rolling, are left to the solve.
        elongation: Elongation of anchored springs per solve [shortest facets].
        recovery: Factor by which a smaller elongation grows after a solve [1]; after a failure it
            shrinks by the cube of this factor.
        max_solves: Largest number of solves with springs.
        max_readmissions: Number of times that an idle body is squeezed in a solve after which it
            takes part in contact to the end: Newton's method overestimates forces once or twice.
        narrowest: Slope of a wedge [1] below which it is squeezed between its neighbours, not out
            of the way: the smallest friction of dry contact. With more friction, its coefficient.
        max_failures: Number of failures in a row after which the solve fails: the elongation is
            below 1e-4 facets then.
        repeats: Number of solves with springs that remain: contact forces then are as large as
            possible.
        sliver: Length over the shortest facet that is considered zero [1]: the advance of an
            obstacle in a move, or the overlap of surfaces that slip off each other.
    """

    resisted: float = 1e-3
    weakest_spring: float = 1e-6
    weakest_anchor: float = 1e-9
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
    max_readmissions: int = 3
    narrowest: float = 0.1
    max_failures: int = 5
    repeats: int = 3
    sliver: float = 1e-3


RIGID = RigidOptions()
