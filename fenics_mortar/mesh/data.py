# SPDX-License-Identifier: MIT
"""A mesh with named bodies and boundaries, and Dirichlet conditions on its boundaries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.mesh.space import numbered_dofs
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices, Numbers, values_at
from fenics_mortar.utils.errors import (
    MeshError,
    check_kind,
    check_number,
    check_same_texts,
    raise_together,
    together,
)

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

    def boundary_facets(self, names: Names) -> Numbers:
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
        facets = [self.facet_tags.find(tag) for tag in self.boundary_tags(names)]
        for name, found in zip(as_list(names), facets):
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


# All components of a vector, and one of them, in messages, by dimension.
ALL = {2: "both", 3: "all"}
ONE = {2: "component=0 or component=1", 3: "component=0, 1 or 2"}


def dirichlet(
    V: fem.FunctionSpace,
    data: MeshData,
    boundary: Names,
    value: fem.Constant | fem.Function | npt.ArrayLike,
    component: int | None = None,
) -> fem.DirichletBC:
    """Prescribe displacement, a component of it or a scalar field on boundaries (collective).

    Args:
        V: Space of the displacement, see :func:`vector_space`, or its sub-space ``W.sub(0)`` of a
            mixed space; of a scalar field ``W.sub(1)``, for example.
        data: Mesh on which ``V`` is defined.
        boundary: Name or tag of a boundary, or a sequence of them.
        value: Prescribed value [length]: numbers of shape (dim,), a constant of this shape or a
            function of ``V``; with ``component`` and for scalar fields a number or a scalar
            constant. Later changes of constants and functions take effect. In a mixed space,
            functions belong to the collapsed sub-space, and constants prescribe a scalar field or
            one component at a time.
        component: 0 for x, 1 for y, 2 for z in space, ``None`` for all.

    Returns:
        A boundary condition of dolfinx.

    Raises:
        MeshError: If a boundary is unknown or empty, the space is not that of a displacement on
            this mesh, or the value does not fit.
        ValueError: If ``data`` or ``V`` is of another type.
    """
    check_kind("data", data, MeshData, "the MeshData of the mesh")
    check_kind("V", V, fem.FunctionSpace, "a space of dolfinx, e.g. vector_space(mesh, 1)")
    is_scalar = ufl.TestFunction(V).ufl_shape == ()
    is_number = is_scalar and not isinstance(value, fem.Function)
    in_sub_space = component is None and compat.is_sub_space(V) and not is_number
    with together(data.mesh.comm, "dirichlet"):
        _check_component(component, data.mesh.geometry.dim)
        if is_scalar and component is not None:
            raise MeshError(f"component is {component!r}, but the field has none; omit it")
        if V.mesh is not data.mesh:
            raise MeshError("the space belongs to another mesh than the boundaries")
        tags = data.boundary_tags(boundary)
        value = value if in_sub_space else _boundary_value(V, value, component)
    check_same_texts(data.mesh.comm, "dirichlet", {"boundary": tags, "component": component})
    facets = data.boundary_facets(boundary)
    dim = data.mesh.topology.dim
    data.mesh.topology.create_connectivity(dim - 1, dim)
    if in_sub_space:
        return _dirichlet_in_sub_space(V, facets, value)
    space = V if component is None else V.sub(int(component))
    dofs = fem.locate_dofs_topological(space, dim - 1, facets)
    if isinstance(value, fem.Function):
        return fem.dirichletbc(value, dofs)
    return fem.dirichletbc(value, dofs, space)


def _check_component(component: Any, dim: int) -> None:
    """Raise unless a component is one of a vector of the space, or ``None`` (local)."""
    known = range(dim)
    if isinstance(component, (Sequence, np.ndarray)) or component not in (None, *known):
        allowed = "0, 1 or None for both" if dim == 2 else "0, 1, 2 or None for all"
        raise MeshError(f"component is {component!r}; expected {allowed}")


def _dirichlet_in_sub_space(
    sub_space: fem.FunctionSpace, facets: Numbers,
    value: fem.Constant | fem.Function | npt.ArrayLike,
) -> fem.DirichletBC:  # fmt: skip
    """Prescribe all components in a sub-space, which needs a function (collective)."""
    dim = sub_space.mesh.geometry.dim
    if isinstance(value, fem.Constant):
        raise MeshError(
            f"a constant cannot prescribe {ALL[dim]} components in a sub-space; prescribe one "
            f"component at a time, by {ONE[dim]}, or use a function of the collapsed sub-space"
        )
    if not isinstance(value, fem.Function):
        space, _ = sub_space.collapse()
        numbers, value = _boundary_value(space, value, None), fem.Function(space)
        value.x.array.reshape(-1, dim)[:] = numbers
    given = value.function_space
    fits = given.mesh is sub_space.mesh and not compat.is_sub_space(given)
    if not fits or given.ufl_element() != sub_space.ufl_element():
        raise MeshError("expected a function of the collapsed sub-space, W.sub(0).collapse()[0]")
    dofs = fem.locate_dofs_topological((sub_space, given), dim - 1, facets)
    return fem.dirichletbc(value, dofs, sub_space)


def _boundary_value(
    V: fem.FunctionSpace, value: fem.Constant | fem.Function | npt.ArrayLike, component: int | None
) -> fem.Constant | fem.Function | npt.NDArray:
    """Check that the value fits the space or its component; convert numbers (local)."""
    dim = V.mesh.geometry.dim
    if isinstance(value, fem.Function):
        if component is not None or value.function_space != V:
            raise MeshError(
                f"a function prescribes {ALL[dim]} components and has to belong to the same space"
            )
        return value
    if not isinstance(value, fem.Constant):
        try:
            value = np.array(value, dtype=PETSc.ScalarType)
        except (TypeError, ValueError):
            allowed = "numbers, a Constant or a Function"
            raise MeshError(f"the prescribed value is {value!r}; expected {allowed}") from None
    shape = value.ufl_shape if isinstance(value, fem.Constant) else value.shape
    expected = ufl.TestFunction(V).ufl_shape if component is None else ()
    if component is None and expected not in ((), (dim,)):
        raise MeshError(
            "the space is not that of a displacement or scalar field; of a mixed space W take "
            "W.sub(0)"
        )
    if shape != expected:
        advice = ""
        if expected == (dim,) and shape == ():
            advice = f"; a number prescribes one component, {ONE[dim]}"
        elif component is not None and shape == (dim,):
            advice = f"; omit component to prescribe {ALL[dim]} components"
        raise MeshError(f"the prescribed value has shape {shape}; expected {expected}{advice}")
    return value
