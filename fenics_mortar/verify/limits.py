# SPDX-License-Identifier: MIT
"""Thresholds of the certificate, each with its unit and the reason for its value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.interface.measures import POINTS
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.rounding import HALF_FACET, SOLVED


@dataclass(frozen=True)
class Limits:
    """Thresholds of the certificate.

    Attributes:
        tolerance: Limit for quantities that vanish in a solution of the equations [1].
        penetration: Limit for penetration and distance between the nodes [facet lengths].
        negligible: Force over the contact force below which it is smaller than the error of the
            discretization: 0.5 %, for springs and for shear caused by corners.
        min_pressure: Smallest reference of pressures, as a fraction of the stiffness [1]: smaller
            pressures may be rounding.
        min_force: Smallest reference of forces, as a fraction of stiffness times displacement [1].
        coarse_penetration: Smallest penetration with a remark [facet lengths]; curved bodies on
            coarse meshes overlap by less.
        coarse_distance: Smallest distance with a remark [facet lengths].
        at_corners: Threshold at corners and ends [1], above the error of estimates there (a few
            per cent), for the sine of the angle of oblique forces, the excess of the shear
            of a sticking corner over the friction limit, and the pressure over the largest
            pressure.
        of_friction: With friction, smallest fraction of the friction for a remark on misdirected
            forces at corners [1]. Measured on wedges of 90 to 150 degrees: if the error of the
            ratio of shear and normal force is 5 %, the estimate is 3.5 to 6 %.
        friction_work: Smallest difference between the work of friction by slip and by motions with
            a remark, over shear forces times motions [1]. In ironing with long steps, where nodes
            turn and stretch, it is 1.2 %; elsewhere below 0.3 %. A chord in place of the arc of 30
            degrees is 1.1 % too short, of 45 degrees 2.6 %; both count twice in a sine.
        wrong_gradient: Largest admissible sine of the angle between a user's gradient and
            difference quotients [1], slightly below the error of forces along averaged normals.
        corner: Angle between the facets at a node above which it is a corner, not part of a curve
            [radian].
        around_corner: Number of facets beside a corner that define the direction of the opposite
            surface.
        end_pressure: Smallest ratio of the pressure beside clamped slave nodes to that of the next
            nodes for a remark [1].
        section_turn: Largest rotation of a body in one straight section of its path [radian], which
            shrinks it by 8 %. A path of less than half a facet did not pass through an obstacle if
            the normals at its ends differ by less.
        two_ways: Rotation above which a body may have turned the other way in a step [radian]: a
            sixth of a full turn, so that turns of up to five sixths are recognized.
        deep: Depth of a path below the surface of an obstacle over its chord [1] above which it
            does not slide along the surface. Paths through a round obstacle have 0.24 at least,
            those of nodes pressed into it the depth over the diameter.
        max_points: Largest number of points on a path, which limits the time of the check.
        fewest_nodes: Number of active nodes of a region of contact, below which it is too narrow.
        uneven: Gap between active nodes over the approach of the bodies for a remark [1], at which
            forces are 7 % too small.
        bare: Covered length of a facet, of length 2 in the reference element, below which it is
            uncovered [1].
        samples: Number of points on a segment at which gaps are evaluated.
    """

    tolerance: float = SOLVED
    penetration: float = HALF_FACET
    negligible: float = RIGID.negligible
    min_pressure: float = SOLVED
    min_force: float = 1e-4
    coarse_penetration: float = 0.2
    coarse_distance: float = 0.05
    at_corners: float = 0.1
    of_friction: float = 0.04
    friction_work: float = 0.03
    wrong_gradient: float = 0.04
    corner: float = 0.3
    around_corner: int = 3
    end_pressure: float = 2.0
    section_turn: float = np.pi / 4
    two_ways: float = np.pi / 3
    deep: float = 0.1
    max_points: int = 2000
    fewest_nodes: int = 3
    uneven: float = 0.1
    bare: float = 0.02
    samples: int = POINTS


LIMITS = Limits()
