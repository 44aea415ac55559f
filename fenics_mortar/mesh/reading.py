# SPDX-License-Identifier: MIT
"""From gmsh to a mesh whose bodies and boundaries have names.

gmsh's physical groups of dimension 2 are the bodies, those of dimension 1 the boundaries. Names
are for people: wherever a name is taken, the integer tag of the group is taken too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.errors import MeshError, check_same_words, place, raise_together, together

# gmsh's numbers of the cells that dolfinx can read: triangles and quadrilaterals of order 1, 2, 3
CELL_TYPES = (2, 3, 9, 10, 21, 36)


@dataclass(frozen=True)
class MeshData:
    """A plane mesh with tagged bodies and boundaries.

    Made by :func:`read_gmsh`, or by hand from any dolfinx mesh and its tags; the dictionaries may
    then stay empty and boundaries be called by their integers.

    Attributes:
        mesh: The mesh, which may have several disconnected bodies.
        cell_tags: Tags of the cells, or ``None``.
        facet_tags: Tags of the facets. With dolfinx 0.5 they also list facets of ghost cells.
        bodies: Tag of each named body.
        boundaries: Tag of each named boundary.

    Example:
        A mesh that is not from gmsh, with two of its sides as boundaries 1 and 2::

            low = locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[1], 0.0))
            high = locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[1], 1.0))
            facets = np.hstack([low, high])
            tags = np.repeat(np.int32([1, 2]), [low.size, high.size])
            order = np.argsort(facets)
            data = MeshData(mesh, None, meshtags(mesh, 1, facets[order], tags[order]))
    """

    mesh: dmesh.Mesh
    cell_tags: dmesh.MeshTags | None
    facet_tags: dmesh.MeshTags
    bodies: dict[str, int] = field(default_factory=dict)
    boundaries: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse names without whole numbers (local)."""
        for what in ("bodies", "boundaries"):
            names = getattr(self, what)
            check_kind(what, names, dict, "a dictionary of tags by name")
            for name, tag in names.items():
                check_number(f"{what}[{name!r}]", tag, "a whole number", np.isfinite, whole=True)

    def body_tag(self, name: str | int) -> int:
        """Return the tag of a body (local); integers are taken as they are.

        Raises:
            MeshError: If no body has this name; lists those there are.
        """
        return _tag("body", name, self.bodies)

    def boundary_tag(self, name: str | int) -> int:
        """Return the tag of a boundary (local); integers are taken as they are.

        Raises:
            MeshError: If no boundary has this name; lists those there are.
        """
        return _tag("boundary", name, self.boundaries)

    def boundary_facets(self, names: str | int | Sequence[str | int]) -> npt.NDArray[np.int32]:
        """Return this rank's facets of one boundary or of several, sorted, each once (collective).

        Args:
            names: A name or tag of a boundary, or a sequence of them.

        Returns:
            Local facet indices, shape (num_facets,); with dolfinx 0.5 facets of ghost cells too.

        Raises:
            MeshError: If a name is unknown, a boundary has no facets on any rank, or the tags are
                not those of the facets of a plane mesh.
        """
        check_plane(self.mesh)
        if self.facet_tags is None or self.facet_tags.dim != 1:
            given = "missing" if self.facet_tags is None else f"of dimension {self.facet_tags.dim}"
            raise MeshError(f"facet_tags are {given}; right are tags of dimension 1")
        names = _listed(names)
        if len(names) == 0:
            raise MeshError(f"no boundary is given; the mesh has {self._tagged()}")
        facets = [self.facet_tags.find(self.boundary_tag(name)) for name in names]
        for name, found in zip(names, facets):
            if self.mesh.comm.allreduce(found.size) == 0:
                raise MeshError(f"boundary {name!r} has no facets; the mesh has {self._tagged()}")
        return np.unique(np.concatenate(facets))

    def _tagged(self) -> list[str | int]:
        """List the boundaries that have facets, by name where there is one (collective)."""
        name_of = {tag: name for name, tag in self.boundaries.items()}
        tags = set().union(*self.mesh.comm.allgather({int(tag) for tag in self.facet_tags.values}))
        return [name_of.get(tag, tag) for tag in sorted(tags)]


def _listed(names: Any) -> list[str | int]:
    """One name, or several, as a list."""
    several = isinstance(names, Sequence) and not isinstance(names, str)
    return list(names) if several else [names]


def _tag(kind: str, name: str | int, tags: dict[str, int]) -> int:
    if isinstance(name, (int, np.integer)) and not isinstance(name, bool):
        if not abs(int(name)) < 2**31:
            raise MeshError(f"no {kind} {name!r}; tags have 32 bits")
        return int(name)
    if not isinstance(name, str) or name not in tags:
        raise MeshError(f"no {kind} {name!r}; the mesh has {sorted(map(str, tags))}")
    return tags[name]


def check_plane(mesh: dmesh.Mesh) -> None:
    """Refuse meshes that are not of plane bodies (local, equal on all ranks)."""
    if mesh.topology.dim != 2 or mesh.geometry.dim != 2:
        raise MeshError(
            f"the mesh has cells of dimension {mesh.topology.dim} in space of dimension "
            f"{mesh.geometry.dim}; contact is for plane bodies: right is 2 in 2"
        )


# Reading


def read_gmsh(source: str | Path | Any, comm: MPI.Comm, *, rank: int = 0) -> MeshData:
    """Read a plane mesh, with the names of its parts, from gmsh (collective).

    All surfaces have to belong to one named body each, and a curve to one boundary at most. Cells
    are triangles or quadrilaterals, not both, of first or higher order.

    Args:
        source: Path of a .msh file, or the module ``gmsh.model`` with a generated mesh. Only looked
            at on rank ``rank``; the others may pass ``None``.
        comm: Communicator of the mesh.
        rank: The rank that reads.

    Returns:
        The distributed mesh with tags; names are known on all ranks.

    Raises:
        MeshError: On every rank, if the file or the model cannot be read; says why.

    Note:
        If the nodes of a live model are not numbered from 1 to their number, they are renumbered.
    """
    check_kind("comm", comm, MPI.Comm, "a communicator of mpi4py, as MPI.COMM_WORLD")
    with together(comm, "read_gmsh"):
        check_number("rank", rank, "a whole number", lambda _: True, whole=True)
        if not 0 <= rank < comm.size:
            ranks = f"the ranks 0 to {comm.size - 1}"
            raise MeshError(f"rank {rank} should read, but there are {ranks}")
    check_same_words(comm, "read_gmsh", {"rank": rank})
    with ExitStack() as stack:
        model, names, error = None, None, None
        if comm.rank == rank:
            try:
                model = stack.enter_context(_gmsh_model(source))
                names = _check_model(model)
            except MeshError as exception:
                error = exception
        raise_together(comm, error)
        bodies, boundaries = comm.bcast(names, root=rank)
        mesh, cell_tags, facet_tags = compat.model_to_mesh(model, comm, rank)
    return MeshData(mesh, cell_tags, facet_tags, bodies, boundaries)


@contextmanager
def _gmsh_model(source: str | Path | Any) -> Iterator[Any]:
    """Yield the gmsh model that ``source`` is or, being a path, holds; clean up behind (local)."""
    if hasattr(source, "getPhysicalGroups"):
        yield source
        return
    if not isinstance(source, (str, Path)):
        raise MeshError(f"source is {source!r}; right is the path of a .msh file or gmsh.model")
    if not Path(source).is_file():
        raise MeshError(f"no file '{source}' (looked for in {Path.cwd()})")
    try:
        import gmsh
    except (ImportError, OSError) as exception:
        raise MeshError(f"gmsh's Python module is needed to read '{source}': {exception}") from None
    with _gmsh_session(gmsh):
        try:
            gmsh.merge(str(source))
        except Exception as exception:  # gmsh knows no other
            raise MeshError(f"gmsh cannot read '{source}': {exception}") from None
        yield gmsh.model


@contextmanager
def _gmsh_session(gmsh: Any) -> Iterator[None]:
    """Have a silent empty model, and leave gmsh as it was (local)."""
    ours = not compat.gmsh_is_initialized(gmsh)
    if ours:
        gmsh.initialize()
    current, terminal = gmsh.model.getCurrent(), gmsh.option.getNumber("General.Terminal")
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("fenics_mortar.read_gmsh")
    try:
        yield
    finally:
        gmsh.model.remove()
        gmsh.option.setNumber("General.Terminal", terminal)
        if ours:
            gmsh.finalize()
        else:
            gmsh.model.setCurrent(current)


def _check_model(model: Any) -> tuple[dict[str, int], dict[str, int]]:
    """Make sure that dolfinx can read the model; return the names of bodies and boundaries (local).

    dolfinx asserts on one rank only, and then the others wait for ever.
    """
    try:
        _check_dimension(model)
        _check_cell_type(model)
        _check_nodes(model)
        _check_elements(model)
        for dim in (2, 1):
            _check_groups(model, dim)
        return _physical_names(model, 2), _physical_names(model, 1)
    except MeshError:
        raise
    except Exception as exception:  # gmsh knows no other
        raise MeshError(f"gmsh cannot give its model: {exception}") from None


def _check_dimension(model: Any) -> None:
    if len(model.mesh.getElements(3)[0]) > 0:
        raise MeshError("the mesh has elements of dimension 3; right is a mesh of the x-y plane")
    if len(model.mesh.getElements(2)[0]) == 0:
        raise MeshError("there are no elements of dimension 2; was model.mesh.generate(2) run?")


def _check_cell_type(model: Any) -> None:
    types = model.mesh.getElements(2)[0]
    names = sorted(model.mesh.getElementProperties(int(t))[0] for t in types)
    if len(types) > 1:
        raise MeshError(f"the mesh mixes {names}; right is one type, triangles or quadrilaterals")
    if types[0] not in CELL_TYPES:
        raise MeshError(f"cells of type {names} are not known; right is e.g. 'Triangle 6'")


def _check_nodes(model: Any) -> None:
    """Check the coordinates of the cells' nodes; number all nodes from 1 on without holes."""
    tags, x, _ = model.mesh.getNodes()
    x = np.reshape(x, (-1, 3))
    used = np.isin(tags, np.concatenate(model.mesh.getElements(2)[2]))
    if not np.isfinite(x).all():
        bad = np.asarray(tags)[~np.isfinite(x).all(axis=1)]
        raise MeshError(f"coordinates of {bad.size} nodes are not finite, e.g. of node {bad[0]}")
    extent = np.ptp(x[used], axis=0)
    if extent[2] > 1e-12 * max(extent[:2]):
        raise MeshError(f"z varies by {extent[2]:.3g}; right is a mesh of the x-y plane")
    if not np.array_equal(np.sort(tags), np.arange(1, len(tags) + 1)):
        model.mesh.renumberNodes()


def _check_elements(model: Any) -> None:
    """Refuse elements that are there twice: dolfinx ends in a crash."""
    _, (elements,), (nodes,) = model.mesh.getElements(2)
    nodes = np.reshape(nodes, (len(elements), -1))
    known, number = np.unique(nodes, return_inverse=True)
    # A sum of random numbers of its nodes names an element, whatever their order.
    names = np.random.default_rng(0).integers(0, 2**62, known.size, dtype=np.uint64)
    sums = names[number.reshape(nodes.shape)].sum(axis=1)
    _, first, count = np.unique(sums, return_index=True, return_counts=True)
    if (count > 1).any():
        twice = first[np.argmax(count > 1)]
        x = np.mean([model.mesh.getNode(node)[0] for node in nodes[twice]], axis=0)
        raise MeshError(
            f"{(count - 1).sum()} elements are there twice, one at {place(x)}: remove the copies"
        )


def _check_groups(model: Any, dim: int) -> None:
    """Check that surfaces are in one physical group each, curves in one at most."""
    what = {1: "curve", 2: "surface"}[dim]
    groups: dict[int, list[int]] = {tag: [] for _, tag in model.getEntities(dim)}
    for _, group in model.getPhysicalGroups(dim):
        for entity in model.getEntitiesForPhysicalGroup(dim, group):
            groups[entity].append(group)
    for entity, tags in groups.items():
        names = [model.getPhysicalName(dim, tag) or tag for tag in tags]
        if len(tags) > 1:
            raise MeshError(f"{what} {entity} is in the physical groups {names}; right is one")
        empty = len(model.mesh.getElements(dim, entity)[0]) == 0
        if tags and empty:
            raise MeshError(f"{what} {entity} of physical group {names} has no elements")
        if dim == 2 and not tags and not empty:
            raise MeshError(f"surface {entity} is in no physical group; every cell needs a body")


def _physical_names(model: Any, dim: int) -> dict[str, int]:
    names: dict[str, int] = {}
    for _, tag in model.getPhysicalGroups(dim):
        name = model.getPhysicalName(dim, tag)
        if name in names:
            raise MeshError(f"{name!r} is the name of the physical groups {names[name]} and {tag}")
        if name:
            names[name] = int(tag)
    return names


# Boundary conditions


def dirichlet(
    V: fem.FunctionSpace,
    data: MeshData,
    boundary: str | int | Sequence[str | int],
    value: fem.Constant | fem.Function | npt.ArrayLike,
    component: int | None = None,
) -> fem.DirichletBC:
    """Prescribe the displacement, or one component of it, on named boundaries (collective).

    Args:
        V: Space of the displacement, see :func:`vector_space`, or the displacement's sub-space
            ``W.sub(0)`` of a mixed space.
        data: Mesh on which ``V`` is defined.
        boundary: Name or tag of a boundary, or a sequence of them.
        value: What is prescribed [length]: numbers of shape (2,), a constant of this shape or a
            function of ``V``; with ``component`` a number or a scalar constant. Later changes of
            constants and functions act. In a mixed space a function is one of the collapsed
            sub-space, and constants prescribe one component at a time.
        component: 0 for x only, 1 for y only, ``None`` for both.

    Returns:
        A boundary condition of dolfinx.

    Raises:
        MeshError: If a boundary is unknown or empty, the space is another than a displacement's on
            this mesh, or the value does not fit.
    """
    check_kind("data", data, MeshData, "the MeshData of the mesh")
    check_kind("V", V, fem.FunctionSpace, "a space of dolfinx, as vector_space(mesh, 1)")
    part = component is None and compat.is_sub_space(V)
    with together(data.mesh.comm, "dirichlet"):
        if isinstance(component, (Sequence, np.ndarray)) or component not in (None, 0, 1):
            raise MeshError(f"component is {component!r}; right is 0, 1 or None for both")
        if V.mesh is not data.mesh:
            raise MeshError("the space belongs to another mesh than the boundaries")
        tags = [data.boundary_tag(name) for name in _listed(boundary)]
        value = value if part else _boundary_value(V, value, component)
    check_same_words(data.mesh.comm, "dirichlet", {"boundary": tags, "component": component})
    facets = data.boundary_facets(boundary)
    data.mesh.topology.create_connectivity(1, 2)
    if part:
        return _dirichlet_of_part(V, facets, value)
    space = V if component is None else V.sub(int(component))
    dofs = fem.locate_dofs_topological(space, 1, facets)
    if isinstance(value, fem.Function):
        return fem.dirichletbc(value, dofs)
    return fem.dirichletbc(value, dofs, space)


def _dirichlet_of_part(
    part: fem.FunctionSpace,
    facets: npt.NDArray[np.int32],
    value: fem.Constant | fem.Function | npt.ArrayLike,
) -> fem.DirichletBC:
    """Prescribe both components in a sub-space; dolfinx takes functions only (collective)."""
    if isinstance(value, fem.Constant):
        raise MeshError(
            "a constant cannot prescribe both components in a sub-space; prescribe one component "
            "at a time, or use a function of the collapsed sub-space"
        )
    if not isinstance(value, fem.Function):
        space, _ = part.collapse()
        numbers, value = _boundary_value(space, value, None), fem.Function(space)
        value.x.array.reshape(-1, 2)[:] = numbers
    given = value.function_space
    fits = given.mesh is part.mesh and not compat.is_sub_space(given)
    if not fits or given.ufl_element() != part.ufl_element():
        raise MeshError("a function has to be of the collapsed sub-space, W.sub(0).collapse()[0]")
    dofs = fem.locate_dofs_topological((part, given), 1, facets)
    return fem.dirichletbc(value, dofs, part)


def _boundary_value(
    V: fem.FunctionSpace, value: fem.Constant | fem.Function | npt.ArrayLike, component: int | None
) -> fem.Constant | fem.Function | npt.NDArray:
    """Check that the value fits the space or its component; make numbers an array."""
    if isinstance(value, fem.Function):
        if component is not None or value.function_space != V:
            raise MeshError("a function prescribes both components and has to be of the same space")
        return value
    if not isinstance(value, fem.Constant):
        try:
            value = np.array(value, dtype=PETSc.ScalarType)
        except (TypeError, ValueError):
            allowed = "numbers, a Constant or a Function"
            raise MeshError(f"the prescribed value is {value!r}; right are {allowed}") from None
    shape = value.ufl_shape if isinstance(value, fem.Constant) else value.shape
    right = ufl.TestFunction(V).ufl_shape if component is None else ()
    if component is None and right != (2,):
        raise MeshError("the space is not that of a displacement; of a mixed space W take W.sub(0)")
    if shape != right:
        raise MeshError(f"the prescribed value has shape {shape}; right is {right}")
    return value
