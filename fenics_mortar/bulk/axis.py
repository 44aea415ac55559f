# SPDX-License-Identifier: MIT
"""Checks of a meridian half plane: nodes and conditions on the axis, the radius in the residual."""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl
from ufl.algorithms.analysis import extract_type

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import MeshError, MortarError, count_places
from fenics_mortar.utils.rounding import ROUNDING


def check_axis(space: DisplacementSpace, prescribed: Flags) -> None:
    """Refuse nodes with x < 0, and free radial components on the axis (collective).

    A displacement away from the axis would tear the body: its hoop strain is unbounded.

    Args:
        space: The displacement's space; without effect unless it is axisymmetric.
        prescribed: Local dofs with Dirichlet values, shape (local dofs,), bool.

    Raises:
        MeshError: On all ranks, for a node with x < 0.
        MortarError: On all ranks, if the radial component of a node on the axis is not prescribed.
    """
    if not space.is_axisymmetric:
        return
    comm = space.V.mesh.comm
    X, rounding = _nodes(space)
    count, where = count_places(comm, X[X[:, 0] < -rounding])
    if count:
        raise MeshError(
            f"{count} nodes have x < 0, one at {where}: with geometry='axisymmetric' x is the "
            "distance from the axis; expected the half of the meridian plane with x >= 0"
        )
    free = ~prescribed[space.owned_dofs[:, 0]]
    count, where = count_places(comm, X[(np.abs(X[:, 0]) <= rounding) & free])
    if count:
        raise MortarError(
            f"{count} nodes on the axis may move away from it, one at {where}: the radial "
            "component is not prescribed; add fm.dirichlet(V, data, name, 0.0, component=0) for "
            "the boundary on the axis"
        )


def check_radius(residual: Any, u: Any, space: DisplacementSpace) -> None:
    """Refuse residuals of plane bodies in axisymmetric problems (local).

    Raises:
        ValueError: If the radius cannot be in the residual, which has neither a
            ``SpatialCoordinate`` nor a function beside ``u``.
    """
    if not space.is_axisymmetric or set(residual.coefficients()) - {u}:
        return
    if not extract_type(residual, ufl.classes.SpatialCoordinate):
        raise ValueError(
            "the residual does not contain the radius: with geometry='axisymmetric' multiply its "
            "measures by 2 * pi * X[0], X = ufl.SpatialCoordinate(mesh), and add the hoop strain"
        )


def radial_dofs_on_axis(space: DisplacementSpace) -> Indices:
    """Owned local dofs of radial components on the axis, (k,); none in a plane (collective)."""
    if not space.is_axisymmetric:
        return np.empty(0, np.int64)
    X, rounding = _nodes(space)
    return space.owned_dofs[np.abs(X[:, 0]) <= rounding, 0]


def _nodes(space: DisplacementSpace) -> tuple[Array, float]:
    """Positions (n, 2) of the owned nodes, and what is rounding of these [length] (collective)."""
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes, :2]
    sizes = space.V.mesh.comm.allgather(float(np.abs(X).max(initial=0.0)))
    return X, ROUNDING * max(sizes)
