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
from fenics_mortar.mesh.gmsh_mesh import GmshMesh, read_msh
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MeshError, format_point, raise_together
from fenics_mortar.utils.rounding import ROUNDING

# Gmsh's types of cells: triangles and quadrilaterals of order 1 to 3.
CELLS = (2, 9, 21, 3, 10, 36)


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
                mesh, names = _checked(model)
                file = mesh.given(*names) if mesh is model else None
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


def _checked(model: Any) -> tuple[GmshMesh, tuple[dict[str, int], dict[str, int]]]:
    """The mesh of a file or live model, and the names of its bodies and boundaries (local).

    An assertion in dolfinx would fail on one rank only, and the other ranks would wait forever.
    """
    try:
        mesh = model if isinstance(model, GmshMesh) else GmshMesh.of(model)
        _check_cells(mesh)
        _check_nodes(mesh)
        for dim in (2, 1):
            _check_groups(mesh, dim)
        if not np.array_equal(np.sort(mesh.tags), np.arange(1, len(mesh.tags) + 1)):
            mesh.renumber_nodes() if mesh is model else model.mesh.renumberNodes()
        return mesh, (_physical_names(mesh, 2), _physical_names(mesh, 1))
    except MeshError:
        raise
    except Exception as exception:  # gmsh raises Exception itself
        raise MeshError(f"cannot read the model of gmsh: {exception}") from None


def _check_cells(mesh: GmshMesh) -> None:
    """Raise unless the elements are of one type that dolfinx reads, and all different (local)."""
    if mesh.elements(3):
        raise MeshError("the mesh has elements of dimension 3; expected a mesh of the x-y plane")
    elements = mesh.elements(2)
    if not elements:
        raise MeshError("there are no elements of dimension 2; was model.mesh.generate(2) called?")
    names = sorted(mesh.types[kind] for kind in elements)
    if len(elements) > 1:
        raise MeshError(f"the mesh mixes {names}; expected one type, triangles or quadrilaterals")
    ((kind, nodes),) = elements.items()
    if kind not in CELLS:
        raise MeshError(f"cells of type {names} are not supported; expected e.g. 'Triangle 6'")
    known, number = np.unique(nodes, return_inverse=True)
    # The sum of random numbers assigned to its nodes identifies an element in any order of nodes.
    labels = np.random.default_rng(0).integers(0, 2**62, known.size, dtype=np.uint64)
    sums = labels[number.reshape(nodes.shape)].sum(axis=1)
    _, first, count = np.unique(sums, return_index=True, return_counts=True)
    if (count > 1).any():
        twice = first[np.argmax(count > 1)]
        where = format_point(mesh.x[np.isin(mesh.tags, nodes[twice])].mean(axis=0))
        raise MeshError(
            f"{(count - 1).sum()} elements are duplicates, one at {where}: remove the copies"
        )


def _check_nodes(mesh: GmshMesh) -> None:
    """Raise for nodes with coordinates that are not finite or not plane (local)."""
    bad = mesh.tags[~np.isfinite(mesh.x).all(axis=1)]
    if bad.size:
        raise MeshError(f"coordinates of {bad.size} nodes are not finite, e.g. of node {bad[0]}")
    used = np.isin(mesh.tags, np.concatenate([n.ravel() for n in mesh.elements(2).values()]))
    extent = np.ptp(mesh.x[used], axis=0)
    if extent[2] > ROUNDING * max(extent[:2]):
        raise MeshError(f"z varies by {extent[2]:.3g}; expected a mesh of the x-y plane")


def _check_groups(mesh: GmshMesh, dim: int) -> None:
    """Check that surfaces are in exactly one physical group, curves in at most one (local)."""
    what = {1: "curve", 2: "surface"}[dim]
    for entity in mesh.entities(dim):
        tags = sorted(mesh.groups.get((dim, entity), []))
        names = [mesh.names.get((dim, tag)) or tag for tag in tags]
        if len(tags) > 1:
            raise MeshError(f"{what} {entity} is in the physical groups {names}; expected one")
        empty = not mesh.blocks.get((dim, entity))
        if tags and empty:
            raise MeshError(f"{what} {entity} of physical group {names} has no elements")
        if dim == 2 and not tags and not empty:
            raise MeshError(f"surface {entity} is in no physical group; every cell needs a body")


def _physical_names(mesh: GmshMesh, dim: int) -> dict[str, int]:
    """Tags of the named physical groups of a dimension (local)."""
    names: dict[str, int] = {}
    for tag in mesh.groups_of(dim):
        name = mesh.names.get((dim, tag), "")
        if name in names:
            raise MeshError(
                f"the physical groups {names[name]} and {tag} have the same name {name!r}"
            )
        if name:
            names[name] = tag
    return names
