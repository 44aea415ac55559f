# SPDX-License-Identifier: MIT
"""What comes out: files for ParaView, a table of contact forces, pictures.

All functions are collective and look at the present displacement and multipliers of a problem. The
bulk is written and gathered by cells, each by the rank that owns it; the contact surfaces are small
and known everywhere, so the first rank writes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from mpi4py import MPI

import numpy as np

import ufl
from ufl.algorithms import extract_arguments
from ufl.domain import extract_domains

from fenics_mortar.bulk.residual import AROUND, Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind, check_number
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import check_same_words, together
from fenics_mortar.utils.files import make_folder, try_together, without_suffix, write_whole

MIDPOINT = {"triangle": [[1 / 3, 1 / 3]], "quadrilateral": [[0.5, 0.5]]}
# By the number of nodes: meshio's name and the order of VTK, which is corners, edges, inside
FACETS = {2: ("line", [0, 1]), 3: ("line3", [0, 2, 1])}
CELLS = {
    3: ("triangle", [0, 1, 2]),
    4: ("quad", [0, 1, 3, 2]),
    6: ("triangle6", [0, 1, 2, 5, 3, 4]),
    9: ("quad9", [0, 1, 3, 2, 4, 6, 7, 5, 8]),
}


# Obstacles are drawn as far beyond the bodies, by the size of these.
AROUND_BODIES = 0.15
# The outlines of obstacles are looked for on a grid of so many points in each direction.
GRID = 400


class ResultsWriter:
    """Time series for ParaView: ``<path>.pvd`` and, for each pair, ``<path>_contact_<slave>.pvd``.

    The bulk has the displacement at its nodes and the values of ``fields`` at the midpoints of its
    cells. The slave surface has at its nodes the displacement, the contact pressure, the tangential
    traction tau . z [stress], the mean gap [length], nan where there is no partner, the slip of the
    last step [length], the status (0 open, 1 active), whether it is sticking and the normal.
    Obstacles are outlines in and somewhat around the box of the bodies, with their displacement, in
    ``<path>_obstacle_<name>.pvd``. Positions are those of the reference: warp by displacement.

    Args:
        path: Where to write, of the first rank; missing folders are made.
        problem: What is written.
        fields: UFL expressions by name: scalars, vectors or tensors. Plane vectors and tensors are
            filled up with zeros.

    Raises:
        MortarError: On all ranks, if a field or the path is of no use.
    """

    def __init__(
        self, path: str | Path, problem: ContactProblem, fields: dict[str, Any] | None = None
    ) -> None:
        """Compile the fields and make the folder (collective)."""
        _check_problem(problem)
        self._problem, comm = problem, problem.comm
        with together(comm, "ResultsWriter"):
            check_kind("path", path, (str, Path), "the name of a file")
            if fields is not None:
                check_kind("fields", fields, dict, "a dictionary of UFL expressions by name")
        names = {str(number): name for number, name in enumerate(fields or {})}
        check_same_words(comm, "ResultsWriter", {"number of fields": len(names), **names})
        self._fields = {name: _CellField(problem, e, name) for name, e in (fields or {}).items()}
        path = _prepare(comm, path, ".pvd")
        cells = _owned_cells(problem)
        self._nodes, numbers = np.unique(cells, return_inverse=True)
        self._X = problem.equations.bulk.V.tabulate_dof_coordinates()[self._nodes]
        self._cells = numbers.reshape(cells.shape)
        self._bulk = _Series(comm, path, len(cells) > 0)

        def series(what: str, names: list[str]) -> list[_Series]:
            """Those of things that the first rank writes, numbered where names are equal."""
            names = [re.sub(r"\W+", "_", name) for name in names]
            names = [n if names.count(n) == 1 else f"{n}_{i}" for i, n in enumerate(names)]
            paths = [path.with_name(f"{path.name}_{what}_{name}") for name in names]
            return [_Series(comm, path, comm.rank == 0) for path in paths]

        self._surfaces = series(
            "contact", [contact.slave.name for contact in problem.equations.contacts]
        )
        self._obstacles = series("obstacle", [o.name for o in problem.equations.tools.obstacles])

    def write(self, time: float) -> None:
        """Write the present state as that of ``time`` (collective)."""
        problem = self._problem
        with together(problem.comm, "write"):
            check_number("time", time, "a finite number", np.isfinite)
        u, dofs = problem.equations.bulk.u.x.array, problem.equations.bulk.space.dofs
        cell_data = {name: _pad(field.evaluate()) for name, field in self._fields.items()}
        data = {"displacement": _pad(u[dofs[self._nodes]])}
        self._bulk.write(time, partial(_piece, self._X, self._cells, CELLS, data, cell_data))
        for series, contact in zip(self._surfaces, problem.equations.contacts, strict=True):
            contact.evaluate(u, problem.equations.linearization)
            X, data = _pad(contact.slave.X), _surface_data(contact, u)
            series.write(time, partial(_piece, X, contact.slave.facets, FACETS, data))
        box = _box(problem.equations.bulk)
        for series, obstacle in zip(
            self._obstacles, problem.equations.tools.obstacles, strict=True
        ):
            series.write(time, partial(_outline, obstacle, *box))

    def __enter__(self) -> ResultsWriter:
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: all files are complete at any time, see ``files.write_whole``."""


def _check_problem(problem: Any) -> None:
    """Refuse what is no problem (local)."""
    check_kind("problem", problem, ContactProblem, "a ContactProblem")


def _surface_data(contact: Contact | Tie, u: Array) -> dict[str, Array]:
    o, friction = contact.operators, dict[str, Any]()
    if isinstance(contact, Contact):
        friction = {"slip": contact.slip, "sticking": contact.sticking.astype(np.int32)}
    return friction | {
        "displacement": _pad(contact.slave.gather(u)),
        "contact_pressure": contact.pressure,
        "tangential_traction": np.einsum("jc,jc->j", o.tau, contact.z),
        "gap": contact.gap,
        "status": contact.active.astype(np.int32),
        "normal": _pad(o.n),
    }


def _piece(
    X: Array,
    cells: Indices,
    kinds: dict[int, Any],
    point_data: dict[str, Array],
    cell_data: dict[str, Array] | None = None,
) -> Any:
    """What one rank writes: points (n, 3), cells in the order of dolfinx, values at both."""
    import meshio

    kind, order = kinds[cells.shape[1]]
    data = {name: [values] for name, values in (cell_data or {}).items()}
    return meshio.Mesh(X, [(kind, cells[:, order])], point_data, data)


def _box(bulk: Bulk) -> tuple[Array, Array]:
    """The box of the deformed bodies and somewhat around it, its lower and upper corner."""
    x = bulk.positions()
    ends = np.concatenate([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    bulk.comm.Allreduce(MPI.IN_PLACE, ends, MPI.MAX)
    low, high = -ends[:2], ends[2:]
    margin = AROUND_BODIES * (high - low).max()
    return low - margin, high + margin


def _outline(obstacle: Obstacle, low: Array, high: Array) -> Any:
    """Where phi = 0 in a box: points in the obstacle's frame, with their displacement.

    Out of sight it is a line without length at the pivot: files without points cannot be read.
    """
    lines = _zeros(obstacle, low, high) or [np.tile(obstacle.pivot + obstacle.place[:2], (2, 1))]
    points = np.concatenate(lines)
    first = np.setdiff1d(np.arange(len(points)), np.cumsum([len(line) for line in lines]) - 1)
    own = obstacle.to_own_frame(points)
    data = {"displacement": _pad(points - own)}
    return _piece(_pad(own), np.stack([first, first + 1], axis=1), FACETS, data)


def _zeros(obstacle: Obstacle, low: Array, high: Array) -> list[Array]:
    """The lines phi = 0 in a box, each (n, 2)."""
    from matplotlib.figure import Figure

    x, y, points = _grid(low, high)
    phi = obstacle.evaluate(points)[0].reshape(GRID, GRID)
    if not phi.min() < 0.0 < phi.max():
        return []
    lines = Figure().add_subplot().contour(x, y, phi, [0.0]).allsegs[0]
    for _ in range(2):  # from the chords of the grid to the curve
        fields = [obstacle.evaluate(line) for line in lines]
        lines = [
            line - (phi / (gradient**2).sum(axis=1))[:, None] * gradient
            for line, (phi, gradient, _) in zip(lines, fields, strict=True)
        ]
    return lines


def _grid(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Places x and y of a grid in a box, each (GRID,), and all its points (GRID^2, 2)."""
    x, y = (np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True))
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


class _Series:
    """One .vtu a step and rank that has a piece, and the .pvd that lists them."""

    def __init__(self, comm: MPI.Comm, path: Path, has_piece: bool) -> None:
        self._comm, self._path = comm, path
        self._ranks = np.flatnonzero(comm.allgather(has_piece))
        self._times: list[float] = []

    def write(self, time: float, piece: Callable[[], Any]) -> None:
        """Write a step, then the list of all steps (collective); ``piece`` makes this rank's."""
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


class _CellField:
    """A UFL expression at the midpoints of the owned cells; compiled once."""

    def __init__(self, problem: ContactProblem, expression: Any, name: str, rank: int = 2) -> None:
        V = problem.equations.bulk.V
        self._mesh = V.mesh
        self._shape: tuple[int, ...] = ()
        self._compiled: Any = None

        def compile_it() -> None:
            if not isinstance(name, str) or not name or name == "displacement":
                raise ValueError("a name is a text, not empty and not 'displacement'")
            self._shape = ufl.as_ufl(expression).ufl_shape
            if len(self._shape) > rank or max(self._shape, default=1) > 3:
                right = "a scalar, vector or tensor" if rank else "a scalar"
                raise ValueError(f"its shape is {self._shape}; right is {right}")
            if extract_arguments(ufl.as_ufl(expression)):
                raise ValueError("it holds a test or trial function")
            if any(domain != V.ufl_domain() for domain in extract_domains(ufl.as_ufl(expression))):
                raise ValueError("it holds a function or constant of another mesh")
            midpoint = MIDPOINT[compat.cell_name(V.mesh)]
            self._compiled = compat.create_expression(expression, midpoint)

        try_together(problem.comm, True, compile_it, f"field {name!r} cannot be evaluated")

    def evaluate(self) -> Array:
        """Values, shape (owned cells, *shape of the expression) (local)."""
        cells = np.arange(self._mesh.topology.index_map(2).size_local, dtype=np.int32)
        values = compat.evaluate_expression(self._compiled, self._mesh, cells)
        return np.asarray(values).reshape(cells.size, *self._shape)


def _owned_cells(problem: ContactProblem) -> Indices:
    """Nodes of the cells of this rank, shape (owned cells, nodes), in the order of dolfinx."""
    num_cells = problem.equations.bulk.V.mesh.topology.index_map(2).size_local
    return compat.dofmap(problem.equations.bulk.V)[:num_cells].astype(np.int64)


def _pad(values: Array) -> Array:
    """Fill (n, a) up to (n, 3), and (n, a, b) to 3 x 3 in rows of 9; as VTK has them."""
    rank = values.ndim - 1
    padded = np.zeros((len(values), *rank * (3,)))
    padded[tuple(slice(size) for size in values.shape)] = values
    return padded.reshape(len(values), 3**rank) if rank else padded


def _prepare(comm: MPI.Comm, path: str | Path, suffix: str) -> Path:
    """Make the folder; return the path of the first rank without its suffix (collective)."""
    path = without_suffix(comm, path, suffix)
    make_folder(comm, path.parent)
    return path


# Table


def contact_table(problem: ContactProblem) -> str:
    """Tabulate the contact of each pair in Markdown: forces, active nodes, pressure, gap.

    The forces are those that act on the bodies, [stress length]; the last column is the smallest
    mean gap of a slave node by the length of the node.
    """
    _check_problem(problem)
    head = "pair|force on slave|force on master|sum|active|max pressure|min gap/length".split("|")
    rows = [f"| {' | '.join(head)} |", "|---|---:|---:|---:|---:|---:|---:|"]
    for contact in problem.equations.contacts:
        contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)
        o, z = contact.operators, contact.z
        forces = [-force.sum(axis=0) for force in (o.force(z)[0], o.reaction(z)[1])]
        gap = (contact.gap / contact.nodal_lengths)[contact.covered]
        cells = [f"{contact.slave.name} - {contact.master.name}"]
        cells += [f"({f[0]:.4e}, {f[1]:.4e})" for f in (*forces, forces[0] + forces[1])]
        cells += [f"{contact.active.sum()} of {contact.slave.num_nodes}"]
        cells += [f"{contact.pressure.max():.4e}", f"{gap.min():.2e}" if gap.size else "-"]
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


# Picture

INK, GREY, PRESSURE = "#222222", "#999999", "#c8102e"


def plot(
    problem: ContactProblem,
    path: str | Path,
    *,
    stress: Any | None = None,
    label: str = "stress",
    title: str | None = None,
    scale: float = 1.0,
) -> None:
    """Draw the deformed bodies and the pressure on the slave surfaces as a PNG (collective).

    Args:
        problem: What is drawn.
        path: Where to, of the first rank; ``.png`` is added, missing folders are made.
        stress: Scalar UFL expression that colours the cells by its values at their midpoints.
        label: Name of ``stress`` at the colour bar.
        title: Title.
        scale: Factor of the displacement.

    Raises:
        MortarError: On all ranks, if the expression or the path is of no use.
    """
    _check_problem(problem)
    comm = problem.comm
    with together(comm, "plot"):
        check_kind("path", path, (str, Path), "the name of a file")
        check_number("scale", scale, "a finite number", np.isfinite)
    field = None if stress is None else _CellField(problem, stress, label, rank=0)
    path = _prepare(comm, path, ".png")
    cells = _owned_cells(problem)
    x = problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    x = x + scale * problem.equations.bulk.u.x.array[problem.equations.bulk.space.dofs]
    nodes = problem.equations.bulk.V.dofmap.index_map.local_to_global(
        cells.ravel().astype(np.int32)
    ).reshape(cells.shape)
    values = np.zeros(len(cells)) if field is None else field.evaluate()
    pieces: Any = comm.gather((nodes, x[cells], values))
    for contact in problem.equations.contacts:
        contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)

    def draw() -> None:
        from matplotlib.figure import Figure

        nodes, polygons, values = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        low, high = polygons.min(axis=(0, 1)), polygons.max(axis=(0, 1))
        width, height = 6.0 * (high - low) / (high - low).max()
        figure = Figure((max(width, 3.0) + 1.6, max(height, 1.5) + 0.9), layout="constrained")
        axes = figure.add_subplot(aspect="equal", title=title or "")
        bodies = _draw_bodies(axes, nodes, polygons, None if field is None else values)
        if field is not None:
            bar = figure.colorbar(bodies, cax=axes.inset_axes((1.03, 0.0, 0.025, 1.0)), label=label)
            bar.outline.set_visible(False)
        margin = AROUND_BODIES * float((high - low).max())
        _draw_obstacles(axes, problem.equations.tools.obstacles, low - margin, high + margin)
        open_pairs = [c for c in problem.equations.contacts if not isinstance(c, Tie)]
        _draw_pressure(axes, open_pairs, scale, 0.1 * float(np.sqrt(np.prod(high - low))))
        if scale != 1.0:
            axes.plot([], [], " ", color=INK, label=f"displacement x {scale:g}")
        if axes.get_legend_handles_labels()[1]:
            place = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.05), "labelcolor": "linecolor"}
            axes.legend(**place, frameon=False, fontsize=9, handletextpad=0.0, ncols=2)
        axes.margins(0.03)
        axes.locator_params(nbins=6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set_color(GREY)
        axes.tick_params(color=GREY, labelsize=8)
        draw_to = partial(figure.savefig, dpi=200, bbox_inches="tight")
        write_whole(path.with_name(f"{path.name}.png"), draw_to)

    try_together(comm, comm.rank == 0, draw, f"cannot draw '{path}.png'")


def _draw_bodies(axes: Any, nodes: Indices, polygons: Array, values: Array | None) -> Any:
    """Cells with thin edges, and the outline: the edges that belong to one cell only."""
    from matplotlib.collections import LineCollection, PolyCollection

    around = AROUND[nodes.shape[1]]
    nodes, polygons = nodes[:, around], polygons[:, around]
    cells = PolyCollection(polygons, cmap="YlGnBu", facecolors="#dfe6ea")
    cells.set(array=values, edgecolors=(0.1, 0.1, 0.1, 0.35))
    cells.set(linewidths=min(0.35, 12.0 / np.sqrt(len(nodes))))
    edges = np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=2).reshape(-1, 2)
    ends = np.stack([polygons, np.roll(polygons, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    _, first, count = np.unique(np.sort(edges), axis=0, return_index=True, return_counts=True)
    axes.add_collection(cells)
    axes.add_collection(LineCollection(ends[first[count == 1]], colors=INK, linewidths=0.8))
    return cells


def _draw_obstacles(axes: Any, obstacles: list[Obstacle], low: Array, high: Array) -> None:
    """The solid parts of obstacles, phi < 0, in a box."""
    x, y, points = _grid(low, high)
    for obstacle in obstacles:
        phi = obstacle.evaluate(points)[0].reshape(GRID, GRID)
        if phi.min() < 0.0:
            axes.contourf(x, y, phi, [phi.min(), 0.0], colors=[GREY], alpha=0.35, zorder=0)
            axes.contour(x, y, phi, [0.0], colors=[INK], linewidths=0.8)


def _draw_pressure(axes: Any, contacts: list[Contact], scale: float, height: float) -> None:
    """Pressure along the normals of the slave surfaces, on their outer side, and its maximum."""
    from matplotlib.collections import LineCollection, PolyCollection

    largest = max((contact.pressure.max() for contact in contacts), default=0.0)
    for contact in contacts:
        pressure, o = contact.pressure, contact.operators
        if not pressure.max() > 0.0:
            continue
        foot = contact.slave.X + scale * (o.x - contact.slave.X)
        tip = foot + height / largest * pressure[:, None] * o.n
        facets = contact.slave.facets[(pressure[contact.slave.facets] != 0.0).any(axis=1)]
        areas = np.concatenate([foot[facets], tip[facets][:, ::-1]], axis=1)
        axes.add_collection(PolyCollection(areas, facecolors="white", alpha=0.35, linewidths=0.0))
        stems = np.stack([foot, tip], axis=1)[np.unique(facets)]
        thin = min(0.5, 16.0 / len(stems))
        for lines, thickness in ((stems, thin), (tip[facets], 1.2), (foot[facets], 1.2)):
            axes.add_collection(LineCollection(lines, colors=PRESSURE, linewidths=thickness))
        top = int(pressure.argmax())
        what = f"pressure on {contact.slave.name}, at most {pressure[top]:.4g}"
        axes.plot(*tip[top], "o", markersize=4, color=PRESSURE, label=what)
