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
        tolerance: For quantities that the equations make zero [1].
        penetration: For penetration and distance between the nodes [facet lengths].
        negligible: Force over the contact force below which it is smaller than the error of the
            discretization: 0.5 %, for springs and for shear caused by corners.
        min_pressure: Pressures are compared at least with this fraction of the stiffness:
            smaller ones may be rounding.
        min_force: Forces are compared at least with this fraction of stiffness times
            displacement [1].
        coarse_penetration: Remark on penetration from here on [facet lengths]; curved bodies on
            coarse meshes overlap by less.
        coarse_distance: Remark on distance from here on [facet lengths].
        at_corners: Fraction that matters at corners and ends [1], above the error of estimates
            there (a few per cent): sine of forces that are oblique; excess of the shear of a
            sticking corner over the friction limit; pressure over the largest pressure.
        of_friction: With friction, remark on forces misdirected at corners from this fraction of
            the friction on [1]. Measured on wedges of 90 to 150 degrees: where the error of the
            ratio of shear and normal force is 5 %, the estimate is 3.5 to 6 %. Also the sine of the
            angle by which a user's gradient may misdirect contact forces.
        corner: Turn of the facets at a node above which it is a corner, not a curve [radian].
        around_corner: Facets beside a corner that define the direction of the opposite surface.
        end_pressure: Remark where the pressure beside clamped slave nodes is this multiple of that
            of the next nodes [1].
        section_turn: Largest rotation of a body in one straight section of its path [radian], which
            shrinks it by 8 %; largest angle between normals of an obstacle at the ends of a path
            between which nothing is sought.
        max_points: Points on a path.
        bare: Covered length of a facet in the reference element, whose length is 2, below which
            tractions on it are zero [1].
        samples: Points on a segment at which gaps are evaluated.
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
    corner: float = 0.3
    around_corner: int = 3
    end_pressure: float = 2.0
    section_turn: float = np.pi / 4
    max_points: int = 400
    bare: float = 0.02
    samples: int = POINTS


LIMITS = Limits()
