# SPDX-License-Identifier: MIT
"""Thresholds that several checks of a state use, each with its unit and the reason for its value.

Those of a single check are in its module, in ``checks``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.interface.measures import POINTS
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.rounding import HALF_FACET, SOLVED


@dataclass(frozen=True)
class Limits:
    """Thresholds of several checks.

    Attributes:
        tolerance: Limit for quantities that vanish in a solution of the equations [1].
        penetration: Limit for penetration and distance between the nodes [facet lengths].
        unpaired: Smallest depth of crossing surfaces that no pair keeps apart that is an error
            [facet lengths]; smaller ones are below the error of displacements.
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
        corner: Angle between the facets at a node above which it is a corner, not part of a curve
            [radian].
        sharp_corner: The same where curves may be coarse [radian]: polygons with more than six
            sides count as circles.
        section_turn: Largest rotation of a body in one straight section of its path [radian], which
            shrinks it by 8 %. A path of less than half a facet did not pass through an obstacle if
            the normals at its ends differ by less.
        two_ways: Rotation above which a body may have turned the other way in a step [radian]: a
            sixth of a full turn, so that turns of up to five sixths are recognized.
        deep: Depth of a path below the surface of an obstacle over its chord [1] above which it
            does not slide along the surface. Paths through a round obstacle have 0.24 at least,
            those of nodes pressed into it the depth over the diameter.
        max_points: Largest number of points on a path, which limits the time of the check.
        bare: Covered length of a facet, of length 2 in the reference element, below which it is
            uncovered [1].
        large_conductance: Conductance of a node over the conduction of the cells beside it above
            which Newton's method may fail [1]: iterates change the flux by as many times.
        lost_conductance: The same above which a state is wrong [1]: the reference force of the
            solve, the largest of its iterations, exceeds the flux in the end by as many times.
        samples: Number of points on a segment at which gaps are evaluated.
    """

    tolerance: float = SOLVED
    large_conductance: float = 1e6
    lost_conductance: float = 1e10
    penetration: float = HALF_FACET
    unpaired: float = 0.01
    negligible: float = RIGID.negligible
    min_pressure: float = SOLVED
    min_force: float = 1e-4
    coarse_penetration: float = 0.2
    coarse_distance: float = 0.05
    at_corners: float = 0.1
    corner: float = 0.3
    sharp_corner: float = np.pi / 3
    section_turn: float = np.pi / 4
    two_ways: float = np.pi / 3
    deep: float = 0.1
    max_points: int = 2000
    bare: float = 0.02
    samples: int = POINTS


LIMITS = Limits()

# Remedy for curved surfaces with straight facets.
CURVED = "cells of order 2 (gmsh.model.mesh.setOrder(2)) with displacements of degree 2"
