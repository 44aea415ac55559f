# SPDX-License-Identifier: MIT
"""Reader of plane gmsh meshes, whose physical groups name bodies and boundaries.

Physical groups of dimension 2 are bodies, those of dimension 1 boundaries. Wherever a name is
expected, the integer tag of the group is accepted as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.mesh.data import MeshData
from fenics_mortar.mesh.from_arrays import check_rank, distributed
from fenics_mortar.mesh.msh_file import MshFile, read_msh
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MeshError, format_point, raise_together
from fenics_mortar.utils.rounding import ROUNDING


def read_gmsh(source: str | Path | Any, comm: MPI.Comm, *, rank: int = 0) -> MeshData:
    """Read a plane mesh with names of bodies and boundaries from gmsh (collective).

    Each surface has to belong to one physical group, its body, and each curve to at most one, its
    boundary. Cells are either triangles or quadrilaterals, of order 1 to 3.

    Args:
        source: Path of a .msh file, or the module ``gmsh.model`` with a generated mesh. Only used
            on rank ``rank``; other ranks may pass ``None``.
        comm: Communicator of the mesh.
        rank: The rank that reads.

    Returns:
        The distributed mesh with tags; names are equal on all ranks.

    Raises:
        MeshError: On all ranks, if the file or the model cannot be read; the message states the
            reason.
        ValueError: If ``comm`` is not a communicator or ``rank`` not an integer.

    Note:
        The nodes of a live model are renumbered if their tags are not 1, 2, ..., n.

    Example:
        A disk of gmsh's own geometry, also with the gmsh 4.8 of Debian 12, where
        ``addPhysicalGroup`` takes no name::

            if comm.rank == 0:
                gmsh.initialize()
                gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
                gmsh.model.occ.synchronize()
                for dim, name in ((2, "disk"), (1, "disk/outline")):
                    gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [1]), name)
                gmsh.model.mesh.generate(2)
            data = read_gmsh(gmsh.model, comm)
    """
    check_rank("read_gmsh", comm, rank)
    with ExitStack() as stack:
        model, names, file, error = None, None, None, None
        if comm.rank == rank:
            try:
                model = stack.enter_context(_gmsh_model(source))
                names = _check_model(model)
                file = model.given(*names) if isinstance(model, MshFile) else None
            except MeshError as exception:
                error = exception
        raise_together(comm, error)
        (bodies, boundaries), in_arrays = comm.bcast((names, file is not None), root=rank)
        if in_arrays:
            return distributed(comm, rank, file)
        mesh, cell_tags, facet_tags = compat.model_to_mesh(model, comm, rank)
    return MeshData(mesh, cell_tags, facet_tags, bodies, boundaries)


@contextmanager
def _gmsh_model(source: str | Path | Any) -> Iterator[Any]:
    """Context with the gmsh model of ``source``, itself a model or a path (local).

    Files of format 4.1 are read without gmsh, those of other formats with it.
    """
    if hasattr(source, "getPhysicalGroups"):
        yield source
        return
    if not isinstance(source, (str, Path)):
        raise MeshError(f"source is {source!r}; expected the path of a .msh file or gmsh.model")
    if not Path(source).is_file():
        raise MeshError(f"no file '{source}' (current folder {Path.cwd()})")
    file = read_msh(Path(source))
    if file is not None:
        yield file
        return
    try:
        import gmsh
    except (ImportError, OSError) as exception:
        raise compat.missing_gmsh(f"to read '{source}'", exception) from None
    with _gmsh_session(gmsh):
        try:
            gmsh.merge(str(source))
        except Exception as exception:  # gmsh raises Exception itself
            raise MeshError(f"gmsh cannot read '{source}': {exception}") from None
        yield gmsh.model


@contextmanager
def _gmsh_session(gmsh: Any) -> Iterator[None]:
    """Context with an empty model and no terminal output; restores gmsh afterwards (local)."""
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
    """Check that dolfinx can read the model; return the names of bodies and boundaries (local).

    An assertion in dolfinx would fail on one rank only, and the other ranks would wait forever.
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
    except Exception as exception:  # gmsh raises Exception itself
        raise MeshError(f"cannot read the model of gmsh: {exception}") from None


def _check_dimension(model: Any) -> None:
    """Raise for models without surface elements or with volume elements (local)."""
    if len(model.mesh.getElements(3)[0]) > 0:
        raise MeshError("the mesh has elements of dimension 3; expected a mesh of the x-y plane")
    if len(model.mesh.getElements(2)[0]) == 0:
        raise MeshError("there are no elements of dimension 2; was model.mesh.generate(2) called?")


def _check_cell_type(model: Any) -> None:
    """Raise for mixed cell types and types that dolfinx does not read (local)."""
    types = model.mesh.getElements(2)[0]
    names = sorted(model.mesh.getElementProperties(int(t))[0] for t in types)
    if len(types) > 1:
        raise MeshError(f"the mesh mixes {names}; expected one type, triangles or quadrilaterals")
    families, orders = ("Triangle", "Quadrangle"), (1, 2, 3)
    if types[0] not in {model.mesh.getElementType(f, k) for f in families for k in orders}:
        raise MeshError(f"cells of type {names} are not supported; expected e.g. 'Triangle 6'")


def _check_nodes(model: Any) -> None:
    """Check the coordinates of the nodes; renumber nodes from 1 without gaps (local)."""
    tags, x, _ = model.mesh.getNodes()
    x = np.reshape(x, (-1, 3))
    used = np.isin(tags, np.concatenate(model.mesh.getElements(2)[2]))
    if not np.isfinite(x).all():
        bad = np.asarray(tags)[~np.isfinite(x).all(axis=1)]
        raise MeshError(f"coordinates of {bad.size} nodes are not finite, e.g. of node {bad[0]}")
    extent = np.ptp(x[used], axis=0)
    if extent[2] > ROUNDING * max(extent[:2]):
        raise MeshError(f"z varies by {extent[2]:.3g}; expected a mesh of the x-y plane")
    if not np.array_equal(np.sort(tags), np.arange(1, len(tags) + 1)):
        model.mesh.renumberNodes()


def _check_elements(model: Any) -> None:
    """Raise for duplicate elements, which make dolfinx crash (local)."""
    _, (elements,), (nodes,) = model.mesh.getElements(2)
    nodes = np.reshape(nodes, (len(elements), -1))
    known, number = np.unique(nodes, return_inverse=True)
    # The sum of random numbers assigned to its nodes identifies an element in any order of nodes.
    names = np.random.default_rng(0).integers(0, 2**62, known.size, dtype=np.uint64)
    sums = names[number.reshape(nodes.shape)].sum(axis=1)
    _, first, count = np.unique(sums, return_index=True, return_counts=True)
    if (count > 1).any():
        twice = first[np.argmax(count > 1)]
        x = np.mean([model.mesh.getNode(node)[0] for node in nodes[twice]], axis=0)
        raise MeshError(
            f"{(count - 1).sum()} elements are duplicates, one at {format_point(x)}: remove the "
            "copies"
        )


def _check_groups(model: Any, dim: int) -> None:
    """Check that surfaces are in exactly one physical group, curves in at most one (local)."""
    what = {1: "curve", 2: "surface"}[dim]
    groups: dict[int, list[int]] = {tag: [] for _, tag in model.getEntities(dim)}
    for _, group in model.getPhysicalGroups(dim):
        for entity in model.getEntitiesForPhysicalGroup(dim, group):
            groups[entity].append(group)
    for entity, tags in groups.items():
        names = [model.getPhysicalName(dim, tag) or tag for tag in tags]
        if len(tags) > 1:
            raise MeshError(f"{what} {entity} is in the physical groups {names}; expected one")
        empty = len(model.mesh.getElements(dim, entity)[0]) == 0
        if tags and empty:
            raise MeshError(f"{what} {entity} of physical group {names} has no elements")
        if dim == 2 and not tags and not empty:
            raise MeshError(f"surface {entity} is in no physical group; every cell needs a body")


def _physical_names(model: Any, dim: int) -> dict[str, int]:
    """Tags of the named physical groups of a dimension (local)."""
    names: dict[str, int] = {}
    for _, tag in model.getPhysicalGroups(dim):
        name = model.getPhysicalName(dim, tag)
        if name in names:
            raise MeshError(
                f"the physical groups {names[name]} and {tag} have the same name {name!r}"
            )
        if name:
            names[name] = int(tag)
    return names
