# SPDX-License-Identifier: MIT
"""Reader of gmsh meshes, whose physical groups name bodies and boundaries.

In the plane physical groups of dimension 2 are bodies, those of dimension 1 boundaries; in space
those of dimension 3 and 2. Wherever a name is
expected, the integer tag of the group is accepted as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.mesh.data import MeshData
from fenics_mortar.mesh.from_arrays import CheckedArrays, check_rank, distributed
from fenics_mortar.mesh.gmsh_mesh import GmshMesh, read_msh
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MeshError, format_point, refuse_in_space, together
from fenics_mortar.utils.rounding import ROUNDING

# Gmsh's types of cells by dimension: triangles and quadrilaterals, tetrahedra and hexahedra, of
# order 1 and 2.
CELLS = {2: (2, 9, 3, 10), 3: (4, 11, 5, 12)}
CUBIC = (29, 92)  # tetrahedra and hexahedra of order 3
EXPECTED = {2: "'Triangle 6'", 3: "'Tetrahedron 10' or 'Hexahedron 8'"}


def read_gmsh(source: str | Path | Any, comm: MPI.Comm, *, rank: int = 0) -> MeshData:
    """Read a mesh with names of bodies and boundaries from gmsh (collective).

    In the plane each surface has to belong to one physical group, its body, and each curve to at
    most one, its boundary; in space each volume and each surface. Cells are of one type: triangles
    or quadrilaterals, tetrahedra or hexahedra, of order 1 or 2.

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
        NotImplementedError: On all ranks, for solids of order 3.
        ValueError: If ``comm`` is not a communicator or ``rank`` not an integer.

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
    mine = None
    with together(comm, "read_gmsh"):
        if comm.rank == rank:
            mine = _checked(_mesh_of(source))
    return distributed(comm, rank, mine)


def _mesh_of(source: str | Path | Any) -> GmshMesh:
    """The mesh of ``source``, a model of gmsh or a path (local).

    Files of format 4.1 are read without gmsh, those of other formats with it.
    """
    if hasattr(source, "getPhysicalGroups"):
        return _mesh_of_model(source)
    if not isinstance(source, (str, Path)):
        raise MeshError(f"source is {source!r}; expected the path of a .msh file or gmsh.model")
    if not Path(source).is_file():
        raise MeshError(f"no file '{source}' (current folder {Path.cwd()})")
    mesh = read_msh(Path(source))
    if mesh is not None:
        return mesh
    try:
        import gmsh
    except (ImportError, OSError) as exception:
        raise compat.missing_gmsh(f"to read '{source}'", exception) from None
    with _gmsh_session(gmsh):
        try:
            gmsh.merge(str(source))
        except Exception as exception:  # gmsh raises Exception itself
            raise MeshError(f"gmsh cannot read '{source}': {exception}") from None
        return _mesh_of_model(gmsh.model)


def _mesh_of_model(model: Any) -> GmshMesh:
    try:
        return GmshMesh.of(model)
    except Exception as exception:  # gmsh raises Exception itself
        raise MeshError(f"cannot read the model of gmsh: {exception}") from None


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


def _checked(mesh: GmshMesh) -> CheckedArrays:
    """The mesh as arrays with the names of its bodies and boundaries (local)."""
    _check_cells(mesh)
    _check_nodes(mesh)
    for dim in (mesh.dim, mesh.dim - 1):
        _check_groups(mesh, dim)
    mesh.renumber_nodes()
    return mesh.given(_physical_names(mesh, mesh.dim), _physical_names(mesh, mesh.dim - 1))


def _check_cells(mesh: GmshMesh) -> None:
    """Raise unless the elements are of one type that dolfinx reads, and all different (local)."""
    dim = mesh.dim
    elements = mesh.elements(dim)
    if not elements:
        raise MeshError("there are no elements of dimension 2; was model.mesh.generate(2) called?")
    names = sorted(mesh.types[kind] for kind in elements)
    if len(elements) > 1:
        shapes = "triangles or quadrilaterals" if dim == 2 else "tetrahedra or hexahedra"
        raise MeshError(f"the mesh mixes {names}; expected one type, {shapes}")
    ((kind, nodes),) = elements.items()
    if kind in CUBIC:
        refuse_in_space("cubic", names[0])
    if kind not in CELLS[dim]:
        raise MeshError(f"cells of type {names} are not supported; expected e.g. {EXPECTED[dim]}")
    known, number = np.unique(nodes, return_inverse=True)
    # The sum of random numbers assigned to its nodes identifies an element in any order of nodes.
    labels = np.random.default_rng(0).integers(0, 2**62, known.size, dtype=np.uint64)
    sums = labels[number.reshape(nodes.shape)].sum(axis=1)
    _, first, count = np.unique(sums, return_index=True, return_counts=True)
    if (count > 1).any():
        twice = first[np.argmax(count > 1)]
        where = format_point(mesh.x[np.isin(mesh.tags, nodes[twice]), :dim].mean(axis=0))
        raise MeshError(
            f"{(count - 1).sum()} elements are duplicates, one at {where}: remove the copies"
        )


def _check_nodes(mesh: GmshMesh) -> None:
    """Raise for nodes with coordinates that are not finite or not plane (local)."""
    bad = mesh.tags[~np.isfinite(mesh.x).all(axis=1)]
    if bad.size:
        raise MeshError(f"coordinates of {bad.size} nodes are not finite, e.g. of node {bad[0]}")
    if mesh.dim == 3:
        return
    used = np.isin(mesh.tags, np.concatenate([n.ravel() for n in mesh.elements(2).values()]))
    extent = np.ptp(mesh.x[used], axis=0)
    if extent[2] > ROUNDING * max(extent[:2]):
        solid = "; was model.mesh.generate(3) called?" if mesh.entities(3) else ""
        raise MeshError(f"z varies by {extent[2]:.3g}; expected a mesh of the x-y plane{solid}")


def _check_groups(mesh: GmshMesh, dim: int) -> None:
    """Check that bodies are in exactly one physical group, boundaries in at most one (local)."""
    what = ("point", "curve", "surface", "volume")[dim]
    for entity in mesh.entities(dim):
        tags = sorted(mesh.groups.get((dim, entity), []))
        names = [mesh.names.get((dim, tag)) or tag for tag in tags]
        if len(tags) > 1:
            raise MeshError(f"{what} {entity} is in the physical groups {names}; expected one")
        empty = not mesh.blocks.get((dim, entity))
        if tags and empty:
            raise MeshError(f"{what} {entity} of physical group {names} has no elements")
        if dim == mesh.dim and not tags and not empty:
            raise MeshError(f"{what} {entity} is in no physical group; every cell needs a body")


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
