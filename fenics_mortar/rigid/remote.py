# SPDX-License-Identifier: MIT
"""Loads and motions given at a point: what users give, and what the equations need of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy.typing as npt

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.obstacles.rigid_motion import RigidMotion, check_vector
from fenics_mortar.rigid.bordered import Border
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, check_same_texts, together


class BoundaryMotion(RigidMotion):
    """Motion and loads given at a point of a boundary (the constructor is collective).

    Args:
        data: Mesh, tags and names.
        boundary: Name or tag of the boundary, or a list of names.
        pivot: The point, shape (2,), in space (3,) [length].
        name: Name used in messages; by default that of the boundary.

    Attributes:
        data: The mesh, with tags and names.
        tags: Tags of the boundary.
        unloaded: Loads at first, nan where motions are prescribed.

    Raises:
        ValueError: If name or pivot is of another type, or the pivot is not finite.
        MeshError: If a name or tag is unknown or has no facets.
    """

    unloaded = float("nan")

    def __init__(
        self,
        data: MeshData,
        boundary: Names,
        *,
        pivot: npt.ArrayLike,
        name: str | None = None,
    ) -> None:
        check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data, own = data, type(self).__name__
        with together(data.mesh.comm, own):
            given = joined_names(boundary) if name is None else name
            super().__init__(given, check_vector("pivot", pivot, data.mesh.geometry.dim))
            self.tags = data.boundary_tags(boundary)
        here = {"boundary": self.tags, "pivot": self.pivot, "name": self.name}
        check_same_texts(data.mesh.comm, own, here)
        data.boundary_facets(boundary)
        self.load[:] = self.unloaded

    def __repr__(self) -> str:
        """The name."""
        return f"{type(self).__name__}({self.name!r})"


class RemoteMotion(Protocol):
    """A remote load in the space of a problem; all methods are collective.

    Attributes:
        motion: The object of the user, with place and loads.
        arm: Length that turns angles into motions [length].
    """

    motion: Any
    arm: float

    def bind_forces(self, bulk: Bulk, contacts: Sequence[Any]) -> None:
        """Set the source of forces: the bodies, contacts and ties."""

    def force(self) -> Array:
        """f_q at the last evaluated state, shape (3,) [stress length]."""

    def constant_force(self) -> Array:
        """The part of f_q that is not linear in the multipliers, shape (3,) [stress length]."""

    def take_bulk_rows(self) -> None:
        """Store products with the tangent of the bodies, before contact changes it."""

    def linearize(self, system: LinearSystem) -> Border:
        """C_q, [E_d, M_q] and E_q of the three motions; see ``balance``."""

    def pushed_nodes(self) -> Array | float:
        """The push as forces on nodes with its resultants, (owned dofs,) [stress length]."""

    def record(self) -> str:
        """Set the ``reaction`` of the user's object; return a sentence."""


def refuse_remote(loads: Sequence[Any], purpose: str) -> None:
    """Raise an error where remote loads are not implemented (local, equal on all ranks).

    Raises:
        MortarError: If there are any.
    """
    if loads:
        name = f"{loads[0].motion.kind} '{loads[0].motion.name}'"
        raise MortarError(f"{purpose} with remote loads, as {name}")


def check_remote(remote: Any) -> None:
    """Reject remote loads of a wrong type, or given twice (local).

    Raises:
        ValueError: If they are not a list of different remote loads.
    """
    if not isinstance(remote, Sequence) or not all(hasattr(load, "bind") for load in remote):
        raise ValueError(f"remote={remote!r}: expected a list of remote loads, e.g. RigidBoundary")
    if len(set(map(id, remote))) < len(remote):
        raise ValueError(f"remote={remote!r}: a remote load is given twice")
