# SPDX-License-Identifier: MIT
"""Time series for ParaView.

The bulk is written by cells, each by the rank that owns it. Contact surfaces are small and known on
all ranks; the first rank writes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.io.cell_field import CellField
from fenics_mortar.io.outlines import bounding_box, outline
from fenics_mortar.io.shared import check_problem, owned_cells, pad, prepare_path
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import check_same_words, together
from fenics_mortar.utils.files import try_together, write_whole

# Name in meshio and order of the nodes in VTK (corners, edges, interior), by number of nodes.
FACETS = {2: ("line", [0, 1]), 3: ("line3", [0, 2, 1])}
CELLS = {
    3: ("triangle", [0, 1, 2]),
    4: ("quad", [0, 1, 3, 2]),
    6: ("triangle6", [0, 1, 2, 5, 3, 4]),
    9: ("quad9", [0, 1, 3, 2, 4, 6, 7, 5, 8]),
}


class ResultsWriter:
    """Time series for ParaView: ``<path>.pvd`` and, for each pair, ``<path>_contact_<slave>.pvd``.

    The bulk has the displacement at its nodes [length] and the values of ``fields`` at the
    midpoints of its cells. The slave surface has at its nodes the displacement [length], the
    contact pressure [stress], the tangential traction tau . z [stress], the mean gap [length], nan
    without partner, the slip of the last step [length], the status (0 open, 1 active), whether it
    sticks (0, 1) and the normal. Obstacles are outlines in a box around the bodies, with their
    displacement [length], in ``<path>_obstacle_<name>.pvd``. Positions are those of the reference
    state: warp by displacement.

    Args:
        path: Path of the files, used on the first rank; missing folders are created.
        problem: The problem to write.
        fields: UFL expressions by name: scalars, vectors or tensors. Plane vectors and tensors are
            padded with zeros.

    Raises:
        MortarError: On all ranks, if a field cannot be evaluated or the folder not be created.
        ValueError: On all ranks, if an argument is of another type.
    """

    def __init__(
        self, path: str | Path, problem: ContactProblem, fields: dict[str, Any] | None = None
    ) -> None:
        """Compile the fields and create the folder (collective)."""
        check_problem(problem)
        self._problem, comm = problem, problem.comm
        with together(comm, "ResultsWriter"):
            check_kind("path", path, (str, Path), "the name of a file")
            if fields is not None:
                check_kind("fields", fields, dict, "a dictionary of UFL expressions by name")
        names = {str(number): name for number, name in enumerate(fields or {})}
        check_same_words(comm, "ResultsWriter", {"number of fields": len(names), **names})
        self._fields = {name: CellField(problem, e, name) for name, e in (fields or {}).items()}
        path = prepare_path(comm, path, ".pvd")
        cells = owned_cells(problem)
        self._nodes, numbers = np.unique(cells, return_inverse=True)
        self._X = problem.equations.bulk.V.tabulate_dof_coordinates()[self._nodes]
        self._cells = numbers.reshape(cells.shape)
        self._bulk = _Series(comm, path, len(cells) > 0)

        def series(what: str, names: list[str]) -> list[_Series]:
            """Series written by the first rank, numbered where names are equal."""
            names = [re.sub(r"\W+", "_", name) for name in names]
            names = [n if names.count(n) == 1 else f"{n}_{i}" for i, n in enumerate(names)]
            paths = [path.with_name(f"{path.name}_{what}_{name}") for name in names]
            return [_Series(comm, path, comm.rank == 0) for path in paths]

        self._surfaces = series(
            "contact", [contact.slave.name for contact in problem.equations.contacts]
        )
        self._obstacles = series("obstacle", [o.name for o in problem.equations.motions.obstacles])

    def write(self, time: float) -> None:
        """Write the present state as that of ``time`` (collective).

        Raises:
            MortarError: On all ranks, if a file cannot be written.
            ValueError: On all ranks, if ``time`` is not a finite number.
        """
        problem = self._problem
        with together(problem.comm, "write"):
            check_number("time", time, "a finite number", np.isfinite)
        u, dofs = problem.equations.bulk.u.x.array, problem.equations.bulk.space.dofs
        cell_data = {name: pad(field.evaluate()) for name, field in self._fields.items()}
        data = {"displacement": pad(u[dofs[self._nodes]])}
        self._bulk.write(time, partial(_piece, self._X, self._cells, CELLS, data, cell_data))
        for series, contact in zip(self._surfaces, problem.equations.contacts, strict=True):
            contact.evaluate(u, problem.equations.linearization)
            X, data = pad(contact.slave.X), _surface_data(contact, u)
            series.write(time, partial(_piece, X, contact.slave.facets, FACETS, data))
        box = bounding_box(problem.equations.bulk)
        for series, obstacle in zip(
            self._obstacles, problem.equations.motions.obstacles, strict=True
        ):
            series.write(time, partial(_outline_piece, obstacle, *box))

    def __enter__(self) -> ResultsWriter:
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: files are complete at any time, see ``files.write_whole``."""


def _surface_data(contact: Contact | Tie, u: Array) -> dict[str, Array]:
    """Nodal fields of a slave surface by name (local)."""
    o, friction = contact.operators, dict[str, Any]()
    if isinstance(contact, Contact):
        friction = {"slip": contact.slip, "sticking": contact.sticking.astype(np.int32)}
        friction |= {f"memory_{name}": v for name, v in contact.committed.memory.items()}
    return friction | {
        "displacement": pad(contact.slave.gather(u)),
        "contact_pressure": contact.pressure,
        "tangential_traction": np.einsum("jc,jc->j", o.tau, contact.z),
        "gap": contact.gap,
        "status": contact.active.astype(np.int32),
        "normal": pad(o.n),
    }


def _piece(
    X: Array,
    cells: Indices,
    kinds: dict[int, Any],
    point_data: dict[str, Array],
    cell_data: dict[str, Array] | None = None,
) -> Any:
    """Mesh of one rank: points (n, 3), cells in the order of dolfinx, values at both (local)."""
    import meshio

    kind, order = kinds[cells.shape[1]]
    data = {name: [values] for name, values in (cell_data or {}).items()}
    return meshio.Mesh(X, [(kind, cells[:, order])], point_data, data)


def _outline_piece(obstacle: Obstacle, low: Array, high: Array) -> Any:
    """Mesh of the outline of an obstacle in a box, with its displacement (local)."""
    points, lines, displacement = outline(obstacle, low, high)
    return _piece(pad(points), lines, FACETS, {"displacement": pad(displacement)})


class _Series:
    """One .vtu file per step and rank that has a piece, and the .pvd file that lists them."""

    def __init__(self, comm: MPI.Comm, path: Path, has_piece: bool) -> None:
        self._comm, self._path = comm, path
        self._ranks = np.flatnonzero(comm.allgather(has_piece))
        self._times: list[float] = []

    def write(self, time: float, piece: Callable[[], Any]) -> None:
        """Write a step, then the list of all steps (collective); ``branch`` creates this rank's."""
        mine = self._file(len(self._times), self._comm.rank)
        has_piece = self._comm.rank in self._ranks
        write_piece = partial(write_whole, mine, partial(_write_piece, piece))
        try_together(self._comm, has_piece, write_piece, f"cannot write '{mine}'")
        self._times.append(float(time))
        index = self._path.with_name(f"{self._path.name}.pvd")
        work = partial(write_whole, index, partial(_write_text, self._index()))
        try_together(self._comm, self._comm.rank == 0, work, f"cannot write '{index}'")

    def _file(self, step: int, rank: int) -> Path:
        return self._path.with_name(f"{self._path.name}_{step:06d}_p{rank}.vtu")

    def _index(self) -> str:
        from xml.sax.saxutils import quoteattr  # loads the library for HTTP

        lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1"><Collection>']
        for step, time in enumerate(self._times):
            for part, rank in enumerate(self._ranks):
                file = quoteattr(self._file(step, rank).name)
                lines.append(f'<DataSet timestep="{time!r}" part="{part}" file={file}/>')
        return "\n".join([*lines, "</Collection></VTKFile>", ""])


def _write_piece(piece: Callable[[], Any], path: Path) -> None:
    piece().write(path)


def _write_text(text: str, path: Path) -> None:
    path.write_text(text)
