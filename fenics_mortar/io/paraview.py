# SPDX-License-Identifier: MIT
"""Time series for ParaView.

Each cell of the bulk is written by the rank that owns it. Contact surfaces are small and replicated
on all ranks; the first rank writes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.io.cell_field import CellField, check_name
from fenics_mortar.io.nodal_field import NodalField, has_nodes
from fenics_mortar.io.outlines import bounding_box, outline
from fenics_mortar.io.series import Series, SeriesBlock
from fenics_mortar.io.shared import check_problem, owned_cells, pad, prepare_path
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import check_same_texts, together

# Name in meshio and order of the nodes in VTK (corners, edges, interior), by number of nodes.
FACETS = {2: ("line", [0, 1]), 3: ("line3", [0, 2, 1])}
CELLS = {
    3: ("triangle", [0, 1, 2]),
    4: ("quad", [0, 1, 3, 2]),
    6: ("triangle6", [0, 1, 2, 5, 3, 4]),
    9: ("quad9", [0, 1, 3, 2, 4, 6, 7, 5, 8]),
}


class ResultsWriter:
    """Time series for ParaView: open ``<path>.pvd``, which contains the whole run.

    Each step has the blocks "bodies", "surfaces" (the slaves) and "obstacles" in the folder
    ``<path>``. Bodies have the displacement [length] and Lagrange functions among ``fields`` at
    their nodes, of degree 2 also at the midpoints of edges, and other fields at the midpoints of
    their cells. A slave surface has at its nodes the displacement [length], the
    contact pressure [stress], the tangential traction tau . z [stress], the mean gap [length], nan
    without partner, the slip of the last step [length], the status (0 open, 1 active), whether it
    sticks (0, 1) and the normal. Obstacles are outlines in a box around the bodies, with their
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
        self._problem, comm = problem, problem.equations.comm
        with together(comm, "ResultsWriter"):
            check_kind("path", path, (str, Path), "the name of a file")
            if fields is not None:
                check_kind("fields", fields, dict, "a dictionary of UFL expressions by name")
        names = {str(number): name for number, name in enumerate(fields or {})}
        check_same_texts(comm, "ResultsWriter", {"number of fields": len(names), **names})
        self._fields, self._nodal = dict[str, CellField](), dict[str, NodalField]()
        for name, field in (fields or {}).items():
            if has_nodes(problem, field):
                check_name(problem, name)
                self._nodal[name] = NodalField(problem, field)
            else:
                self._fields[name] = CellField(problem, field, name)
        cells = owned_cells(problem)
        self._nodes, numbers = np.unique(cells, return_inverse=True)
        self._X = problem.equations.bulk.V.tabulate_dof_coordinates()[self._nodes]
        self._cells = numbers.reshape(cells.shape)
        ranks = np.flatnonzero(comm.allgather(len(cells) > 0)).tolist()
        surfaces = _numbered([contact.slave.name for contact in problem.equations.contacts])
        obstacles = _numbered([obstacle.name for obstacle in problem.equations.motions.obstacles])
        blocks = [SeriesBlock("bodies", f"rank {rank}", f"bodies_p{rank}", rank) for rank in ranks]
        blocks += [SeriesBlock("surfaces", name, f"surface_{file}", 0) for name, file in surfaces]
        blocks += [
            SeriesBlock("obstacles", name, f"obstacle_{file}", 0) for name, file in obstacles
        ]
        self._series = Series(comm, prepare_path(comm, path, ".pvd"), blocks)

    def write(self, time: float) -> None:
        """Write the present state as that of ``time`` [time] (collective).

        Raises:
            MortarError: On all ranks, if a file cannot be written.
            ValueError: On all ranks, if ``time`` is not a finite number.
        """
        problem = self._problem
        with together(problem.equations.comm, "write"):
            check_number("time", time, "a finite number", np.isfinite)
        u, dofs = problem.equations.bulk.u.x.array, problem.equations.bulk.space.dofs
        cell_data = {name: pad(field.evaluate()) for name, field in self._fields.items()}
        data = {"displacement": pad(u[dofs[self._nodes]])}
        data |= {name: pad(field.evaluate()) for name, field in self._nodal.items()}
        bodies = partial(_piece, self._X, self._cells, CELLS, data, cell_data)
        pieces: list[Callable[[], Any]] = []
        for contact in problem.equations.contacts:
            contact.evaluate(u, problem.equations.linearization)
            X, data = pad(contact.slave.X), _surface_data(contact, u)
            pieces.append(partial(_piece, X, contact.slave.facets, FACETS, data))
        box = bounding_box(problem.equations.bulk)
        for obstacle in problem.equations.motions.obstacles:
            pieces.append(partial(_outline_piece, obstacle, *box))
        ranks = self._series.count("bodies")
        self._series.write(time, [bodies] * ranks + pieces)

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


def _surface_data(contact: Contact | Tie, u: Array) -> dict[str, Array]:
    """Nodal fields of a slave surface by name (local)."""
    o, friction = contact.operators, dict[str, Any]()
    if isinstance(contact, Contact):
        friction = {"slip": contact.slip, "sticking": contact.sticking.astype(np.int32)}
        friction |= {f"memory_{name}": v for name, v in contact.accepted_instant.memory.items()}
    return friction | {
        "displacement": pad(contact.slave.gather(u)),
        "contact_pressure": contact.pressure,
        "tangential_traction": np.einsum("jc,jc->j", o.tau, contact.z_u),
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
