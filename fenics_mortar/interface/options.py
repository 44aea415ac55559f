# SPDX-License-Identifier: MIT
"""Discretization of a pair: basis, normals, weights of the gap, quadrature, search."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from fenics_mortar.interface.segments import Integration
from fenics_mortar.kernels import basis, normals

Basis = Literal["dual", "standard", "vertices", "linear"]
Weighting = Literal["opposite", "unit", "own"]
GapWeights = Literal["cover", "basis", "standard"]
BASES = {
    "dual": basis.DUAL,
    "standard": basis.STANDARD,
    "vertices": basis.DUAL,
    "linear": basis.STANDARD,
}
# Bases without multipliers at the inner nodes of quadratic facets.
AT_VERTICES = ("vertices", "linear")
GAP_WEIGHTS = {
    "basis": basis.BY_BASIS,
    "cover": basis.BY_COVER,
    "standard": basis.BY_STANDARD,
}
WEIGHTINGS = {"opposite": normals.OPPOSITE, "unit": normals.UNIT, "own": normals.OWN}


def basis_on(surface: Any, basis: Basis) -> Basis:
    """Basis of the multipliers on a surface (local).

    Triangles with six nodes have "linear" functions at their corners: there the integral of the
    quadratic function is zero, and a dual one does not exist.
    """
    return "linear" if surface.dim == 3 and surface.facets.shape[1] == 6 else basis


@dataclass(frozen=True)
class MortarOptions:
    """Discretization of one pair.

    Attributes:
        basis: "dual" (D is diagonal), "standard" or, at vertices only, "vertices" and "linear".
        weighting: Weights of the facet normals at a node: "opposite", "unit" or "own".
        gap_weights: Weights of the gap: "basis", "cover" or "standard"; see ``kernels.basis``.
        integration: "segments", "elements" or "nodes"; see ``segments``.
        points: Gauss points per segment, with "elements" per slave facet.
        radius: Search radius along the normal [length]; see ``sight`` for limits behind the slave.
        min_cosine: Smallest cosine between the slave's normal and the reversed master's [1].
        corners: Whether corners inside the slave take the normal of one facet; see ``corners``.
    """

    basis: Basis
    weighting: Weighting
    gap_weights: GapWeights
    integration: Integration
    points: int
    radius: float
    min_cosine: float
    corners: bool = False

    @cached_property
    def kinds(self) -> tuple[int, int]:
        """Basis and weights of the gap as integers, the arguments of the kernels.

        If the quadrature points are the nodes, standard and dual functions are equal for any cover.
        """
        if self.integration == "nodes":
            return basis.STANDARD, basis.BY_BASIS
        return BASES[self.basis], GAP_WEIGHTS[self.gap_weights]
