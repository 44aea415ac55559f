# SPDX-License-Identifier: MIT
"""Checks of a meridian half plane: nodes and conditions on the axis, radius in the residual."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from ufl.algorithms.analysis import extract_type

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import MeshError, MortarError, count_points
from fenics_mortar.utils.rounding import ROUNDING


def check_axis(space: DisplacementSpace, prescribed: Flags) -> None:
    """Reject nodes with x < 0, and free radial components on the axis (collective).

    A displacement away from the axis has an unbounded hoop strain.

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
    count, where = count_points(comm, X[X[:, 0] < -rounding])
    if count:
        raise MeshError(
            f"{count} nodes have x < 0, one at {where}: with geometry='axisymmetric' x is the "
            "distance from the axis; expected the half of the meridian plane with x >= 0"
        )
    free = ~prescribed[space.owned_dofs[:, 0]]
    count, where = count_points(comm, X[(np.abs(X[:, 0]) <= rounding) & free])
    if count:
        raise MortarError(
            f"{count} nodes on the axis may move away from it, one at {where}: the radial "
            "component is not prescribed; add fm.dirichlet(V, data, name, 0.0, component=0) for "
            "the boundary on the axis"
        )


def check_radius(residual: Any, u: Any, space: DisplacementSpace) -> None:
    """Reject a residual of plane bodies with axisymmetry (local, equal on all ranks).

    Args:
        residual: UFL form.
        u: Displacement or mixed function.
        space: The displacement's space; without effect unless it is axisymmetric.

    Raises:
        ValueError: If integrals over cells depend neither on the coordinates nor on a function that
            could be the radius.
    """
    if "cell" in _without_radius(residual, u, space):
        raise ValueError(
            "the residual does not contain the radius in integrals over cells: with "
            "geometry='axisymmetric' multiply its measures by 2 * pi * X[0], X = "
            "ufl.SpatialCoordinate(mesh), and add the hoop strain"
        )


def remark_on_radius(residual: Any, u: Any, space: DisplacementSpace) -> str:
    """Remark on boundary integrals without the radius; "" if there are none (local).

    Arguments as for ``check_radius``.
    """
    if not _without_radius(residual, u, space) - {"cell"}:
        return ""
    return (
        "the residual has boundary integrals without the radius: with geometry='axisymmetric' a "
        "traction needs the factor 2 pi X[0]"
    )


class AxisConditions:
    """Check of the values prescribed on the axis; the constructor is collective.

    Args:
        space: The displacement's space; without effect unless it is axisymmetric.
        u: Displacement or mixed function.
        bcs: Dirichlet conditions.
    """

    def __init__(self, space: DisplacementSpace, u: Any, bcs: list[Any]) -> None:
        self._space, self._u, self._bcs = space, u, bcs
        self._dofs = radial_dofs_on_axis(space)

    def check(self) -> None:
        """Reject radial motions of the axis (collective).

        Raises:
            MortarError: On all ranks, if a radial component on the axis is prescribed otherwise
                than by zero.
        """
        if not self._space.is_axisymmetric:
            return
        values = np.zeros_like(self._u.x.array)
        compat.set_prescribed(values, self._bcs)
        moved = np.abs(values[self._dofs])
        largest = self._space.V.mesh.comm.allreduce(float(moved.max(initial=0.0)), MPI.MAX)
        _, rounding = _nodes(self._space)
        if largest > rounding:
            raise MortarError(
                f"nodes on the axis are moved away from it by {largest:.3g}: expected 0 for their "
                "radial component"
            )


def _without_radius(residual: Any, u: Any, space: DisplacementSpace) -> set[str]:
    """Types of the integrals that cannot be weighted by the radius."""
    if not space.is_axisymmetric:
        return set()
    integrals = [(part.integral_type(), part.integrand()) for part in residual.integrals()]
    return {
        kind
        for kind, integrand in integrals
        if not extract_type(integrand, ufl.geometry.SpatialCoordinate)
        and not extract_type(integrand, ufl.Coefficient) - {u}
    }


def radial_dofs_on_axis(space: DisplacementSpace) -> Indices:
    """Owned local dofs of radial components on the axis, (k,); none in a plane (collective)."""
    if not space.is_axisymmetric:
        return np.empty(0, np.int64)
    X, rounding = _nodes(space)
    return space.owned_dofs[np.abs(X[:, 0]) <= rounding, 0]


def _nodes(space: DisplacementSpace) -> tuple[Array, float]:
    """Positions (n, 2) of the owned nodes, and the rounding of positions [length] (collective)."""
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes, :2]
    sizes = space.V.mesh.comm.allgather(float(np.abs(X).max(initial=0.0)))
    return X, ROUNDING * max(sizes)
