# SPDX-License-Identifier: MIT
"""Time series of several blocks for ParaView.

``<path>.pvd`` lists the steps, one ``.vtm`` file each, which names the blocks and the ``.vtu`` file
of each of them; these are in the folder ``<path>``. Each cell of the bulk is written by the rank
that owns it. Contact surfaces are small and replicated on all ranks; the first rank writes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.io.fields import (
    CellField,
    NodalField,
    bounding_box,
    check_name,
    check_problem,
    evaluated_contacts,
    has_nodes,
    outline,
    owned_cells,
    surface_fields,
)
from fenics_mortar.mesh.space import KINDS
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import check_kind, check_number, check_same_texts, together
from fenics_mortar.utils.files import make_folder, try_together, without_suffix, write_whole

# Name in meshio and order of the nodes in VTK (corners, edges, interior), by number of nodes.
FACETS = {2: ("line", [0, 1]), 3: ("line3", [0, 2, 1])}
CELLS = {
    3: ("triangle", [0, 1, 2]),
    4: ("quad", [0, 1, 3, 2]),
    6: ("triangle6", [0, 1, 2, 5, 3, 4]),
    9: ("quad9", [0, 1, 3, 2, 4, 6, 7, 5, 8]),
}
# The same of solids, and of their facets, whose nodes are in the order of VTK.
SOLIDS = {
    number: (name, np.argsort(KINDS[3, number].order).tolist())
    for number, name in ((4, "tetra"), (10, "tetra10"), (8, "hexahedron"), (27, "hexahedron27"))
}
FACES = {
    number: (name, list(range(number)))
    for number, name in ((3, "triangle"), (4, "quad"), (6, "triangle6"), (9, "quad9"))
}


class _Block(NamedTuple):
    """A block of each step: name of its group, its name, name of its files, writing rank."""

    group: str
    name: str
    file: str
    rank: int


class ResultsWriter:
    """Time series for ParaView: open ``<path>.pvd``, which contains the whole run.

    Each step has the blocks "bodies", "surfaces" (the slaves) and "obstacles" in the folder
    ``<path>``. Bodies have the displacement [length] and Lagrange functions among ``fields`` at
    their nodes, of degree 2 also at the midpoints of edges, and other fields at the midpoints of
    their cells. A slave surface has at its nodes the displacement [length], the contact pressure
    [stress], the tangential traction tau . z, in space a vector [stress], the mean gap [length],
    nan without partner, the slip of the last step [length], the status (0 open, 1 active), whether
    it sticks (0, 1) and the normal. Obstacles are outlines in a box around the bodies, with their
    displacement [length]. Positions are those of the reference state: warp by displacement.

    Args:
        path: Path of the files, used on the first rank; missing folders are created.
        problem: The problem to write.
        fields: Functions and UFL expressions by name: scalars, vectors or tensors, padded with
            zeros to three dimensions. Scalar and vector functions of Lagrange spaces up to the
            degree of the displacement, and parts ``w.sub(i)`` of mixed ones, are written at nodes,
            all others are evaluated at the midpoints of cells. Expressions with functions that
            exist at quadrature points only are averaged over each cell.

    Raises:
        MortarError: On all ranks, if a field cannot be evaluated or the folder not be created.
        ValueError: On all ranks, if an argument is of another type.

    Note:
        Collective.

    Example:
        ::

            fields = {"stress": stress, "pressure": w.sub(1)}
            with fm.ResultsWriter("results/seal", problem, fields) as results:
                for step in range(1, 11):
                    problem.solve()
                    results.write(step)
    """

    def __init__(
        self, path: str | Path, problem: ContactProblem, fields: dict[str, Any] | None = None
    ) -> None:
        """Compile the fields and create the folder (collective)."""
        check_problem(problem)
        self._problem, self._comm, self._times = problem, problem.equations.comm, list[float]()
        with together(self._comm, "ResultsWriter"):
            check_kind("path", path, (str, Path), "the name of a file")
            if fields is not None:
                check_kind("fields", fields, dict, "a dictionary of UFL expressions by name")
            for name in fields or {}:
                check_name(name)
        names = {str(number): name for number, name in enumerate(fields or {})}
        check_same_texts(self._comm, "ResultsWriter", {"number of fields": len(names), **names})
        self._fields, self._nodal = dict[str, CellField](), dict[str, NodalField]()
        for name, field in (fields or {}).items():
            if has_nodes(problem, field):
                self._nodal[name] = NodalField(problem, field)
            else:
                self._fields[name] = CellField(problem, field, name)
        cells = owned_cells(problem)
        self._nodes, numbers = np.unique(cells, return_inverse=True)
        self._dim: int = problem.equations.bulk.space.dim
        self._X = problem.equations.bulk.V.tabulate_dof_coordinates()[self._nodes]
        self._cells = numbers.reshape(cells.shape)
        ranks = np.flatnonzero(self._comm.allgather(len(cells) > 0)).tolist()
        surfaces = _numbered([contact.slave.name for contact in problem.equations.contacts])
        obstacles = _numbered([obstacle.name for obstacle in problem.equations.motions.obstacles])
        self._blocks = [
            *(_Block("bodies", f"rank {rank}", f"bodies_p{rank}", rank) for rank in ranks),
            *(_Block("surfaces", name, f"surface_{file}", 0) for name, file in surfaces),
            *(_Block("obstacles", name, f"obstacle_{file}", 0) for name, file in obstacles),
        ]
        self._path = without_suffix(self._comm, path, ".pvd")
        make_folder(self._comm, self._path)

    def write(self, time: float) -> None:
        """Write the present state as that of ``time`` [time] (collective).

        Raises:
            MortarError: On all ranks, if a file cannot be written.
            ValueError: On all ranks, if ``time`` is not a finite number.
        """
        problem = self._problem
        with together(self._comm, "write"):
            check_number("time", time, "a finite number", np.isfinite)
        u, dofs = problem.equations.bulk.u.x.array, problem.equations.bulk.space.dofs
        cell_data = {name: field.evaluate() for name, field in self._fields.items()}
        data = {"displacement": u[dofs[self._nodes]]}
        data |= {name: field.evaluate() for name, field in self._nodal.items()}
        kinds, facet_kinds = (CELLS, FACETS) if self._dim == 2 else (SOLIDS, FACES)
        bodies = partial(_piece, self._X, self._cells, kinds, data, cell_data)
        pieces = [bodies for block in self._blocks if block.group == "bodies"]
        for contact in evaluated_contacts(problem):
            X, facets = contact.slave.X, contact.slave.facets
            pieces.append(partial(_piece, X, facets, facet_kinds, surface_fields(contact, u)))
        box = bounding_box(problem.equations.bulk)
        for obstacle in problem.equations.motions.obstacles:
            pieces.append(partial(_outline_piece, obstacle, *box))
        self._write(float(time), pieces)

    def _write(self, time: float, pieces: Sequence[Callable[[], Any]]) -> None:
        """Write the mesh that a function creates for each block, then the lists (collective)."""
        step = len(self._times)
        for block, piece in zip(self._blocks, pieces, strict=True):
            file = self._path / f"{block.file}_{step:06d}.vtu"
            self._write_file(block.rank, file, partial(_write_piece, piece))
        self._times.append(time)
        texts = {
            self._path / f"step_{step:06d}.vtm": _step(self._blocks, step),
            self._path.with_name(f"{self._path.name}.pvd"): _index(self._path.name, self._times),
        }
        for file, text in texts.items():
            self._write_file(0, file, partial(_write_text, text))

    def _write_file(self, rank: int, file: Path, write: Callable[[Path], Any]) -> None:
        """Write a file on a rank; an error is raised on all ranks (collective)."""
        work = partial(write_whole, file, write)
        try_together(self._comm, self._comm.rank == rank, work, f"cannot write '{file}'")

    def __enter__(self) -> ResultsWriter:
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to do: files are complete at any time, see ``files.write_whole``."""


def _numbered(names: list[str]) -> list[tuple[str, str]]:
    """Names of blocks and of files, numbered where they are equal (local)."""
    files = [re.sub(r"\W+", "_", name) for name in names]
    files = [n if files.count(n) == 1 else f"{n}_{i}" for i, n in enumerate(files)]
    names = [n if names.count(n) == 1 else f"{n} {i}" for i, n in enumerate(names)]
    return list(zip(names, files, strict=True))


def pad(values: Array) -> Array:
    """Pad ``values`` with zeros to three dimensions, in their unit, as VTK expects them (local).

    Args:
        values: Scalars (n,), vectors (n, a) or tensors (n, a, b) with a and b up to 3 [any unit].

    Returns:
        Scalars unchanged, vectors (n, 3), tensors row by row, shape (n, 9).
    """
    if values.ndim == 1:
        return values
    padded = np.zeros((len(values), *(values.ndim - 1) * (3,)))
    padded[tuple(slice(size) for size in values.shape)] = values
    return padded.reshape(len(values), 3 ** (values.ndim - 1))


def _piece(
    X: Array,
    cells: Indices,
    kinds: dict[int, Any],
    point_data: dict[str, Array],
    cell_data: dict[str, Array] | None = None,
) -> Any:
    """Mesh of one rank: points (n, d), cells in the order of dolfinx, values at both (local)."""
    import meshio

    kind, order = kinds[cells.shape[1]]
    at_points = {name: pad(values) for name, values in point_data.items()}
    in_cells = {name: [pad(values)] for name, values in (cell_data or {}).items()}
    return meshio.Mesh(pad(X), [(kind, cells[:, order])], at_points, in_cells)


def _outline_piece(obstacle: Obstacle, low: Array, high: Array) -> Any:
    """Mesh of the outline of an obstacle in a box, with its displacement (local)."""
    points, lines, displacement = outline(obstacle, low, high)
    return _piece(points, lines, FACETS, {"displacement": displacement})


def _step(blocks: list[_Block], step: int) -> str:
    """Text of the file that lists the blocks of a step."""
    from xml.sax.saxutils import quoteattr  # imports the library for HTTP

    lines = ['<VTKFile type="vtkMultiBlockDataSet" version="1.0"><vtkMultiBlockDataSet>']
    for i, (group, members) in enumerate(groupby(blocks, lambda block: block.group)):
        lines.append(f'<Block index="{i}" name={quoteattr(group)}>')
        for k, block in enumerate(members):
            file = quoteattr(f"{block.file}_{step:06d}.vtu")
            lines.append(f'<DataSet index="{k}" name={quoteattr(block.name)} file={file}/>')
        lines.append("</Block>")
    return _document([*lines, "</vtkMultiBlockDataSet></VTKFile>"])


def _index(name: str, times: list[float]) -> str:
    """Text of the file that lists the steps."""
    from xml.sax.saxutils import quoteattr

    lines = ['<VTKFile type="Collection" version="0.1"><Collection>']
    for step, time in enumerate(times):
        file = quoteattr(f"{name}/step_{step:06d}.vtm")
        lines.append(f'<DataSet timestep="{time!r}" part="0" file={file}/>')
    return _document([*lines, "</Collection></VTKFile>"])


def _document(lines: Sequence[str]) -> str:
    return "\n".join(['<?xml version="1.0"?>', *lines, ""])


def _write_piece(piece: Callable[[], Any], path: Path) -> None:
    piece().write(path)


def _write_text(text: str, path: Path) -> None:
    path.write_text(text)
