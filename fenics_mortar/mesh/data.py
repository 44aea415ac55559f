# SPDX-License-Identifier: MIT
"""A mesh with named bodies and boundaries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.mesh.space import numbered_dofs
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices, values_at
from fenics_mortar.utils.errors import MeshError, check_kind, check_number, raise_together

# A name or tag of a boundary, or several of them.
Names = str | int | Sequence[str | int]
# Names of the entities of a mesh by dimension of mesh and entity, in messages.
ENTITIES = {
    1: ("vertices", "cells"),
    2: ("vertices", "facets", "cells"),
    3: ("vertices", "edges", "facets", "cells"),
}


@dataclass(frozen=True)
class MeshData:
    """A mesh of the plane or of space with tagged bodies and boundaries.

    Created by :func:`read_gmsh`, :func:`mesh_from_arrays`, or by hand from any dolfinx mesh and its
    tags. Names are optional: a boundary may also be given by its integer tag.

    Attributes:
        mesh: The mesh, possibly of several disconnected bodies.
        cell_tags: Tags of the cells, or ``None``.
        facet_tags: Tags of the facets. With dolfinx 0.5 these include facets of ghost cells.
        bodies: Tag of each named body.
        boundaries: Tag of each named boundary.

    Raises:
        ValueError: If a tag is not an integer, or mesh or tags are of another type.
        MeshError: On all ranks, if tags belong to another mesh, or those of cells to facets.

    Note:
        The constructor is collective.

    Example:
        A mesh that is not from gmsh, with two of its sides as boundaries 1 and 2:

        >>> from mpi4py import MPI
        >>> from dolfinx.mesh import create_unit_square, locate_entities_boundary, meshtags
        >>> mesh = create_unit_square(MPI.COMM_WORLD, 2, 2)
        >>> low = locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[1], 0.0))
        >>> high = locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[1], 1.0))
        >>> facets = np.hstack([low, high])
        >>> tags = np.repeat(np.int32([1, 2]), [low.size, high.size])
        >>> order = np.argsort(facets)
        >>> facet_tags = meshtags(mesh, 1, facets[order], tags[order])
        >>> data = MeshData(mesh, None, facet_tags, boundaries={"bottom": 1, "top": 2})
        >>> data.boundary_facets(["bottom", "top"]).size
        4
    """

    mesh: dmesh.Mesh
    cell_tags: dmesh.MeshTags | None
    facet_tags: dmesh.MeshTags
    bodies: dict[str, int] = field(default_factory=dict)
    boundaries: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise an error for tags that are not integers or of another mesh (collective)."""
        for what in ("bodies", "boundaries"):
            names = getattr(self, what)
            check_kind(what, names, dict, "a dictionary of tags by name")
            for name, tag in names.items():
                check_number(f"{what}[{name!r}]", tag, "an integer", np.isfinite, whole=True)
        for what in ("cell_tags", "facet_tags"):
            check_tags(what, getattr(self, what), self.mesh)
        if self.cell_tags is not None and self.cell_tags.dim != self.mesh.topology.dim:
            raise MeshError(
                f"cell_tags are of dimension {self.cell_tags.dim}; expected tags of dimension "
                f"{self.mesh.topology.dim}"
            )

    def body_tag(self, name: str | int) -> int:
        """Return the tag of a body (local); integers are returned unchanged.

        Raises:
            MeshError: If no body has this name; lists the names.
        """
        return _tag("body", name, self.bodies)

    def boundary_tag(self, name: str | int) -> int:
        """Return the tag of a boundary (local); integers are returned unchanged.

        Raises:
            MeshError: If no boundary has this name; lists the names.
        """
        return _tag("boundary", name, self.boundaries)

    def boundary_tags(self, names: Names) -> list[int]:
        """Return the tags of one or several boundaries (local).

        Raises:
            MeshError: If no boundary has one of the names, or none is given; lists the names.
        """
        tags = [self.boundary_tag(name) for name in as_list(names)]
        if not tags:
            raise MeshError(
                f"no boundary is given; the mesh has {sorted(map(str, self.boundaries))}"
            )
        return tags

    def node_dofs(self, V: Any, nodes: npt.ArrayLike) -> Indices:
        """Local dofs of nodes of the mesh input (local).

        Args:
            V: Lagrange space, not mixed; in a mixed space W take ``W.sub(0).collapse()[0]``.
            nodes: Numbers of nodes, shape (k,): rows of ``points`` of :func:`mesh_from_arrays`; for
                :func:`read_gmsh` tags minus one.

        Returns:
            Blocked dofs, shape (k,): the values of a vector ``u`` are
            ``u.x.array.reshape(-1, dim)[dofs]``. -1 for nodes that are not on this rank or not
            nodes of ``V``, such as middles of edges in a space of degree 1. Ghosts are included;
            owned dofs are below ``V.dofmap.index_map.size_local``.

        Raises:
            ValueError: If ``V`` has no dofs at the vertices, or is mixed.
        """
        dofs, numbers = numbered_dofs(V)
        return values_at(np.asarray(nodes, np.int64), numbers, dofs, -1)

    def nodal_values(self, u: Any, nodes: npt.ArrayLike) -> Array:
        """Values of a function at nodes of the mesh input, on all ranks (collective).

        Args:
            u: Function of a Lagrange space, not mixed.
            nodes: Numbers of nodes as in ``node_dofs``, equal on all ranks, shape (k,).

        Returns:
            Values [unit of u], shape (k, dim) for vectors and (k, 1) for scalars; nan where the
            space has no such node.

        Raises:
            ValueError: If the space of ``u`` has no dofs at the vertices, or is mixed.
        """
        V = u.function_space
        size, owned = V.dofmap.index_map_bs, V.dofmap.index_map.size_local
        dofs = self.node_dofs(V, nodes)
        mine = np.flatnonzero((dofs >= 0) & (dofs < owned))
        values = u.x.array.reshape(-1, size)[dofs[mine]]
        found = np.full((dofs.size, size), np.nan)
        for indices, there in V.mesh.comm.allgather((mine, values)):
            found[indices] = there
        return found

    def boundary_facets(self, names: Names) -> npt.NDArray[np.int32]:
        """Return this rank's facets of some boundaries, sorted and unique (collective).

        Args:
            names: A name or tag of a boundary, or a sequence of them.

        Returns:
            Local facet indices, shape (num_facets,); dolfinx 0.5 includes facets of ghost cells.

        Raises:
            MeshError: If a name is unknown, a boundary has no facets on any rank, or the tags do
                not belong to facets.
        """
        check_solid(self.mesh)
        dim = self.mesh.topology.dim - 1
        if self.facet_tags is None or self.facet_tags.dim != dim:
            given = "missing" if self.facet_tags is None else f"of dimension {self.facet_tags.dim}"
            raise MeshError(f"facet_tags are {given}; expected tags of dimension {dim}")
        names = as_list(names)
        if len(names) == 0:
            raise MeshError(f"no boundary is given; the mesh has {self._tagged()}")
        facets = [self.facet_tags.find(self.boundary_tag(name)) for name in names]
        for name, found in zip(names, facets):
            if self.mesh.comm.allreduce(found.size) == 0:
                raise MeshError(f"boundary {name!r} has no facets; the mesh has {self._tagged()}")
        return np.unique(np.concatenate(facets))

    def _tagged(self) -> list[str | int]:
        """List the boundaries with facets, by name if they have one (collective)."""
        name_of = {tag: name for name, tag in self.boundaries.items()}
        tags = set().union(*self.mesh.comm.allgather({int(tag) for tag in self.facet_tags.values}))
        return [name_of.get(tag, tag) for tag in sorted(tags)]


def as_list(names: Any) -> list[str | int]:
    """Return one or several names as a list (local)."""
    several = isinstance(names, Sequence) and not isinstance(names, str)
    return list(names) if several else [names]


def joined_names(names: Any) -> str:
    """Return one or several names as one, used in messages and files (local)."""
    first, *others = map(str, as_list(names) or [""])
    return " + ".join([first, *others]) if len(others) < 3 else f"{first} + {len(others)} others"


def _tag(kind: str, name: str | int, tags: dict[str, int]) -> int:
    """Return the tag of a name; integers are returned unchanged (local)."""
    if isinstance(name, (int, np.integer)) and not isinstance(name, bool):
        if not abs(int(name)) < 2**31:
            raise MeshError(f"no {kind} {name!r}; tags have at most 32 bits")
        return int(name)
    if not isinstance(name, str) or name not in tags:
        raise MeshError(f"no {kind} {name!r}; the mesh has {sorted(map(str, tags))}")
    return tags[name]


def check_solid(mesh: dmesh.Mesh) -> None:
    """Raise an error for meshes of shells, of beams or on a line (local, equal on all ranks).

    Raises:
        MeshError: If cells and space are not both of dimension 2 or 3.
    """
    if mesh.topology.dim != mesh.geometry.dim or mesh.topology.dim not in (2, 3):
        raise MeshError(
            f"the mesh has cells of dimension {mesh.topology.dim} in space of dimension "
            f"{mesh.geometry.dim}; expected plane bodies, 2 in 2, or solids, 3 in 3"
        )


def check_tags(what: str, tags: Any, mesh: dmesh.Mesh) -> None:
    """Reject tags of another mesh, or of entities that the mesh does not have (collective).

    Such tags crash dolfinx, or mark wrong entities.

    Args:
        what: Description of the tags, for the message.
        tags: Tags of dolfinx, or ``None``.
        mesh: The mesh.

    Raises:
        MeshError: On all ranks.
        ValueError: If tags or mesh are of another type.
    """
    if tags is None:
        return
    if not all(hasattr(tags, name) for name in ("find", "indices", "dim")):
        raise ValueError(f"{what}={tags!r}: expected tags of dolfinx.mesh.meshtags, or None")
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx")
    error = None
    if not compat.are_tags_of(tags, mesh):
        error = MeshError(
            f"{what} belong to another mesh; expected tags of this one, e.g. facet_tags or "
            "cell_tags of its MeshData"
        )
    else:
        mesh.topology.create_entities(tags.dim)
        index_map = mesh.topology.index_map(tags.dim)
        count = index_map.size_local + index_map.num_ghosts
        indices = np.asarray(tags.indices)
        wrong = indices[(indices < 0) | (indices >= count)]
        if wrong.size:
            entities = ENTITIES[mesh.topology.dim][tags.dim]
            error = MeshError(
                f"{what} have entity {wrong[0]}, but there are {count} {entities} on "
                f"rank {mesh.comm.rank}: they were made for another mesh"
            )
    raise_together(mesh.comm, error)
