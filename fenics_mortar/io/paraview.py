# SPDX-License-Identifier: MIT
"""Time series for ParaView, and the values of bodies, surfaces and obstacles in files and pictures.

``ResultsWriter`` writes the series. ``<path>.pvd`` lists the steps, one ``.vtm`` file each, which
names the blocks and the ``.vtu`` file of each of them; these are in the folder ``<path>``. Each
cell of the bulk is written by the rank that owns it. Contact surfaces are small and replicated on
all ranks; the first rank writes them.

``CellField`` and ``surface_fields`` give the values on bodies and surfaces, ``outline`` the
outlines of obstacles, ``contact_table`` a table of the pairs. Lagrange functions are evaluated at
the nodes of the displacement, other UFL expressions at the midpoints of the cells, or averaged over
them if they contain functions that exist at quadrature points only.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby, permutations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms import extract_arguments, extract_coefficients
from ufl.domain import extract_domains

from fenics_mortar.bulk.cells import DEGREES, lagrange, midpoint_of
from fenics_mortar.contact.contact import Contact
from fenics_mortar.mesh.space import KINDS
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat, errors, files, ranks

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.obstacles.obstacle import Obstacle
    from fenics_mortar.utils.arrays import Array, Indices


def check_problem(problem: Any) -> None:
    """Reject objects that are not problems (local).

    Raises:
        ValueError: If the object is not a problem.
    """
    errors.check_kind("problem", problem, ContactProblem, "a ContactProblem")


def check_name(name: Any) -> None:
    """Reject names of fields that are not strings or already used (local).

    Raises:
        MortarError: For another name.
    """
    if not isinstance(name, str) or not name or name == "displacement":
        expected = "expected a non-empty string other than 'displacement'"
        raise errors.MortarError(f"field {name!r} cannot be evaluated: {expected}")


def owned_cells(problem: ContactProblem) -> Indices:
    """Nodes of the owned cells, shape (cells, nodes), in the order of dolfinx (local)."""
    V = problem.equations.bulk.V
    num_cells = V.mesh.topology.index_map(V.mesh.topology.dim).size_local
    return compat.dofmap(V)[:num_cells].astype(np.int64)


def evaluated_contacts(problem: ContactProblem) -> list[Any]:
    """The pairs of a problem, evaluated at its present displacement (collective)."""
    for contact in problem.equations.contacts:
        contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)
    return list(problem.equations.contacts)


def surface_fields(contact: Interface, u: Array) -> dict[str, Array]:
    """Fields at the nodes of a slave surface by name, see ``ResultsWriter`` (collective).

    Args:
        contact: A pair of ``evaluated_contacts``.
        u: Displacement, shape (local dofs,) [length].
    """
    found: dict[str, Array] = {}
    if isinstance(contact, Contact):
        found |= {"slip": contact.slip, "sticking": contact.sticking.astype(np.int32)}
        found |= {f"memory_{name}": v for name, v in contact.accepted_instant.memory.items()}
    for i, flux in enumerate(contact.all_fluxes):
        nodal = flux.nodal()
        found |= {f"jump_{i}": nodal.jump, f"conduction_{i}": nodal.conduction}
        found[f"heating_{i}"] = nodal.heating
    o, now = contact.operators, contact.now
    return found | {
        "displacement": contact.slave.gather(u),
        "contact_pressure": contact.pressure,
        "tangential_traction": np.array(now.shear if o.slave.dim == 3 else now.z_tau),
        "gap": contact.gap,
        "status": contact.active.astype(np.int32),
        "normal": o.n,
    }


class CellField:
    """A UFL expression at the midpoints or nodes of the owned cells, compiled once (collective).

    If it contains functions that exist at quadrature points only, its mean over each cell.

    Args:
        problem: The problem on whose mesh it is evaluated.
        expression: Scalar, vector or tensor.
        name: Name of the field.
        rank: Largest allowed rank of the expression.
        at_nodes: Whether it is evaluated at the nodes of the displacement in each cell.

    Raises:
        MortarError: On all ranks, if it cannot be evaluated.
    """

    def __init__(
        self, problem: ContactProblem, expression: Any, name: str, *, rank: int = 2,
        at_nodes: bool = False,
    ) -> None:  # fmt: skip
        self._shape: tuple[int, ...] = ()
        work = partial(self._compile, problem.equations.bulk.V, expression, rank, at_nodes)
        message = f"field {name!r} cannot be evaluated"
        self._values: Any = files.try_together(problem.equations.comm, True, work, message)

    def _compile(self, V: Any, given: Any, rank: int, at_nodes: bool) -> Callable[[], Array]:
        """Function that returns the values in the cells (collective)."""
        expression = ufl.as_ufl(given)
        self._shape = expression.ufl_shape
        if len(self._shape) > rank or max(self._shape, default=1) > 3:
            expected = "a scalar, vector or tensor" if rank else "a scalar"
            raise ValueError(f"its shape is {self._shape}; expected {expected}")
        if extract_arguments(expression):
            raise ValueError("it contains a test or trial function")
        if any(domain != V.ufl_domain() for domain in extract_domains(expression)):
            raise ValueError("it contains a function or constant of another mesh")
        degree = _degree_of_points(expression)
        if degree is not None:
            return _cell_means(V.mesh, expression, degree)
        points = lagrange(V).points if at_nodes else midpoint_of(compat.cell_name(V.mesh))
        compiled = compat.create_expression(given, points)
        owned = V.mesh.topology.index_map(V.mesh.topology.dim).size_local
        cells = np.arange(owned, dtype=np.int32)
        return partial(compat.evaluate_expression, compiled, V.mesh, cells)

    def evaluate(self) -> Array:
        """Values [unit of the field], (owned cells,) and the shape of the expression (local).

        At nodes those of one cell after the other, (owned cells * nodes,) and this shape.
        """
        return np.asarray(self._values()).reshape(-1, *self._shape)


def _degree_of_points(expression: Any) -> int | None:
    """Degree of the quadrature functions of an expression, ``None`` without them (local)."""
    found = [compat.quadrature_degree(f) for f in extract_coefficients(expression)]
    degrees = {degree for degree in found if degree is not None}
    if len(degrees) > 1:
        raise ValueError(
            f"its functions exist at the quadrature points of the degrees {sorted(degrees)}; "
            "expected one degree"
        )
    return degrees.pop() if degrees else None


def _cell_means(mesh: Any, expression: Any, degree: int) -> Callable[[], Array]:
    """Function that returns the L2 projection onto constants on each cell (collective)."""
    V = compat.scalar_space(mesh, 0, "DG")
    cells = compat.dofmap(V)[: mesh.topology.index_map(mesh.topology.dim).size_local, 0]
    metadata = {"quadrature_degree": degree, "quadrature_scheme": "default"}
    test, measure = ufl.TestFunction(V), ufl.Measure("dx", domain=mesh, metadata=metadata)
    components = [expression[i] if i else expression for i in np.ndindex(expression.ufl_shape)]
    nothing = fem.Constant(mesh, 0.0)  # a form without test function, of a component 0, has no sums
    forms = [compat.form((c + nothing) * test * measure) for c in (ufl.as_ufl(1.0), *components)]

    def means() -> Array:
        area, *sums = (compat.local_sums(form)[cells] for form in forms)
        return np.stack([each / area for each in sums], axis=1)

    return means


def has_nodes(problem: ContactProblem, field: Any) -> bool:
    """Whether a field has values at nodes (local).

    This holds for scalar and vector functions of Lagrange spaces on the mesh of the problem,
    with a degree up to that of the displacement, and for such parts of mixed functions.
    """
    V = problem.equations.bulk.V
    if not isinstance(field, fem.Function) or field.ufl_shape not in ((), (V.mesh.geometry.dim,)):
        return False
    if field.function_space.mesh is not V.mesh:
        return False
    layout = field.function_space.dofmap.dof_layout
    degree = DEGREES.get(layout.num_dofs, 0)
    at_vertices = len(layout.entity_dofs(0, 0)) == 1
    return at_vertices and 1 <= degree <= DEGREES[V.dofmap.dof_layout.num_dofs]


# Number of points per direction of the grid on which outlines of obstacles are searched: its cells
# are narrower than the lines of a picture. In space triangles of a fortieth of the box.
GRID, GRID_IN_SPACE = 400, 40
# How often cells near an obstacle smaller than the grid are halved: to 1e-6 of the box.
HALVINGS = 15


def bounding_box(bulk: Bulk) -> tuple[Array, Array]:
    """Lower and upper corner of a box around deformed bodies, (dim,) [length] (collective)."""
    x = bulk.positions()
    ends = np.concatenate([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    ends = ranks.largest_over_ranks(bulk.comm, ends)
    dim = x.shape[1]
    return with_margin(-ends[:dim], ends[dim:])


def with_margin(low: Array, high: Array) -> tuple[Array, Array]:
    """A box with a margin of 15 % of its longer side, where obstacles are drawn (local).

    Args:
        low: Lower corner of a box, shape (dim,) [length].
        high: Upper corner, shape (dim,) [length].
    """
    margin = 0.15 * (high - low).max()
    return low - margin, high + margin


def outline(obstacle: Obstacle, low: Array, high: Array) -> tuple[Array, Indices, Array]:
    """Outline phi = 0 of an obstacle in a box: line segments, in space triangles (local).

    For an obstacle outside the box it is one of zero length or area at the pivot, since files
    without points are unreadable.

    Args:
        obstacle: The obstacle.
        low: Lower corner of the box, shape (dim,) [length].
        high: Upper corner, shape (dim,) [length].

    Returns:
        Points in the obstacle's frame (n, dim) [length], corners of the parts (m, dim), and
        displacements of the points (n, dim) [length].
    """
    dim = len(low)
    points, parts = _zeros(obstacle, low, high)
    for _ in range(2 if len(parts) else 0):  # Newton steps from chords of the grid to the surface
        phi, gradient, _ = obstacle.evaluate(points)
        points = points - (phi / (gradient**2).sum(axis=1))[:, None] * gradient
    if not len(parts):
        points = np.tile(obstacle.present_pivot, (dim, 1))
        parts = np.arange(dim)[None]
    own = obstacle.to_own_frame(points)
    return own, parts, points - own


# Edges of a simplex with corners in the order of phi on which a part of phi = 0 has its corners, by
# the number of corners with phi < 0: segments of a triangle, triangles of a tetrahedron.
CUTS = {
    2: ((1, ((0, 1), (0, 2))), (2, ((0, 2), (1, 2)))),
    3: ((1, ((0, 1), (0, 2), (0, 3))), (3, ((0, 3), (1, 3), (2, 3))),
        (2, ((0, 2), (0, 3), (1, 3))), (2, ((0, 2), (1, 3), (1, 2)))),
}  # fmt: skip


def _zeros(obstacle: Obstacle, low: Array, high: Array) -> tuple[Array, Indices]:
    """Points of phi = 0 in a box, (n, dim) [length], and of its parts (m, dim) (local).

    phi is linear in the simplices of a grid, whose cells are halved where the obstacle is small.
    """
    dim = len(low)
    count = {2: GRID, 3: GRID_IN_SPACE}[dim] - 1
    step, cells = (high - low) / count, np.indices((count,) * dim).reshape(dim, -1).T
    bits = np.arange(2**dim)[:, None] >> np.arange(dim) & 1
    for _ in range(HALVINGS):
        points, corners, phi = _at_corners(obstacle, low, step, cells, bits)
        lowest, highest = phi[corners].min(axis=1), phi[corners].max(axis=1)
        cut, size = (lowest < 0.0) & (highest >= 0.0), np.linalg.norm(step)
        near = (lowest <= size) & (highest >= -size)
        is_fine = cut.sum() >= count ** (dim - 1)
        if is_fine or not 0 < near.sum() << dim <= count**dim:  # no more cells than the grid has
            break
        step, cells = step / 2.0, (2 * cells[near][:, None] + bits).reshape(-1, dim)
    orders = np.cumsum(list(permutations(2 ** np.arange(dim))), axis=1)
    simplices = np.insert(orders, 0, 0, axis=1)  # ways along edges between opposite corners
    cells = corners[cut][:, simplices].reshape(-1, dim + 1)
    cells = np.take_along_axis(cells, np.argsort(phi[cells], axis=1), axis=1)
    inside = (phi[cells] < 0.0).sum(axis=1)
    edges = np.concatenate([cells[inside == number][:, cut] for number, cut in CUTS[dim]])
    ends, parts = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    at = phi[ends[:, 0]] / (phi[ends[:, 0]] - phi[ends[:, 1]])
    a, b = points[ends[:, 0]], points[ends[:, 1]]
    return a + at[:, None] * (b - a), parts.reshape(-1, dim)


def _at_corners(
    obstacle: Obstacle, low: Array, step: Array, cells: Indices, bits: Indices
) -> tuple[Array, Indices, Array]:
    """Corners (n, dim) [length] of ``cells`` of a grid, their numbers by cells, phi [length]."""
    each = (cells[:, None] + bits).reshape(-1, cells.shape[1])
    keys = each @ (each.max(axis=0, initial=0).max() + 1) ** np.arange(cells.shape[1])
    _, first, numbers = np.unique(keys, return_index=True, return_inverse=True)
    points = low + each[first] * step
    return points, numbers.reshape(-1, len(bits)), obstacle.evaluate(points)[0]


def grid(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Grid in the box from ``low`` to ``high``, each (2,) [length] (local).

    Returns:
        Coordinates x and y, each (GRID,), and points (GRID^2, 2) [length].
    """
    x, y = (np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True))
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def contact_table(problem: ContactProblem) -> files.MarkdownText:
    """Markdown table of forces, active nodes, pressure and gap of each pair (collective).

    Forces act on the bodies [stress length], or on whole bodies of revolution [force]. The pressure
    is the largest nodal value [stress]; the last column is the smallest mean gap of a slave node
    over its length [1].

    Raises:
        ValueError: If ``problem`` is not a ``ContactProblem``.
    """
    check_problem(problem)
    head = "pair|force on slave|force on master|sum|active|max pressure|min gap/length".split("|")
    rows = []
    for contact in evaluated_contacts(problem):
        o, z = contact.operators, contact.z_u
        forces = [-force.sum(axis=0) for force in (o.force(z)[0], o.reaction(z)[1])]
        gap = (contact.gap / contact.slave.nodal_lengths)[contact.covered]
        cells = [f"{contact.slave.name} - {contact.master.name}"]
        sums = [force + 0.0 for force in (*forces, forces[0] + forces[1])]  # -0.0 becomes 0.0
        cells += [f"({', '.join(f'{value:.4e}' for value in force)})" for force in sums]
        cells += [f"{contact.active.sum()} of {contact.slave.num_nodes}"]
        gap_text = f"{gap.min() + 0.0:.2e}" if gap.size else "-"
        cells += [f"{contact.pressure.max() + 0.0:.4e}", gap_text]
        rows.append(cells)
    return files.MarkdownText(files.markdown_table(head, rows, left=(0,)))


# Names in meshio by dimension and number of nodes.
NAMES = {
    (1, 2): "line", (1, 3): "line3",
    (2, 3): "triangle", (2, 4): "quad", (2, 6): "triangle6", (2, 9): "quad9",
    (3, 4): "tetra", (3, 8): "hexahedron", (3, 10): "tetra10", (3, 27): "hexahedron27",
}  # fmt: skip


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
    it sticks (0, 1) and the normal; of each of its fluxes, numbered from 0, as ``jump_0`` the jump
    of the field, ``conduction_0`` and ``heating_0``, see ``NodalFlux``. Obstacles are
    outlines, in space surfaces, in a box around the bodies, with their displacement [length].
    Positions are those of the reference state: warp by displacement.

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
        with errors.together(self._comm, "ResultsWriter"):
            errors.check_kind("path", path, (str, Path), "the name of a file")
            if fields is not None:
                errors.check_kind("fields", fields, dict, "a dictionary of UFL expressions by name")
            for name in fields or {}:
                check_name(name)
        names = {str(number): name for number, name in enumerate(fields or {})}
        errors.check_same_texts(
            self._comm, "ResultsWriter", {"number of fields": len(names), **names}
        )
        self._fields, self._nodal = dict[str, CellField](), dict[str, CellField]()
        for name, field in (fields or {}).items():
            at_nodes = has_nodes(problem, field)
            kind = self._nodal if at_nodes else self._fields
            kind[name] = CellField(problem, field, name, at_nodes=at_nodes)
        cells = owned_cells(problem)
        self._nodes, self._first, numbers = np.unique(cells, return_index=True, return_inverse=True)
        self._dim: int = problem.equations.bulk.space.dim
        self._X = problem.equations.bulk.V.tabulate_dof_coordinates()[self._nodes]
        order = np.argsort(KINDS[self._dim, cells.shape[1]].order)  # of VTK
        self._cells = numbers.reshape(cells.shape)[:, order]
        writers = np.flatnonzero(self._comm.allgather(len(cells) > 0)).tolist()
        surfaces = _numbered([contact.slave.name for contact in problem.equations.contacts])
        obstacles = _numbered([obstacle.name for obstacle in problem.equations.motions.obstacles])
        self._blocks = [
            *(_Block("bodies", f"rank {rank}", f"bodies_p{rank}", rank) for rank in writers),
            *(_Block("surfaces", name, f"surface_{file}", 0) for name, file in surfaces),
            *(_Block("obstacles", name, f"obstacle_{file}", 0) for name, file in obstacles),
        ]
        self._path = files.without_suffix(self._comm, path, ".pvd")
        files.make_folder(self._comm, self._path)

    def write(self, time: float) -> None:
        """Write the present state as that of ``time`` [time] (collective).

        Raises:
            MortarError: On all ranks, if a file cannot be written.
            ValueError: On all ranks, if ``time`` is not a finite number.
        """
        problem = self._problem
        with errors.together(self._comm, "write"):
            errors.check_number("time", time, "a finite number", np.isfinite)
        u, dofs = problem.equations.bulk.u.x.array, problem.equations.bulk.space.dofs
        cell_data = {name: field.evaluate() for name, field in self._fields.items()}
        data = {"displacement": u[dofs[self._nodes]]}
        data |= {name: field.evaluate()[self._first] for name, field in self._nodal.items()}
        bodies = partial(_piece, self._X, self._cells, self._dim, data, cell_data)
        pieces = [bodies for block in self._blocks if block.group == "bodies"]
        for contact in evaluated_contacts(problem):
            X, facets, dim = contact.slave.X, contact.slave.facets, self._dim - 1
            if dim == 1:  # middle nodes last
                facets = np.hstack([facets[:, [0, -1]], facets[:, 1:-1]])
            pieces.append(partial(_piece, X, facets, dim, surface_fields(contact, u)))
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
            self._write_file(0, file, partial(Path.write_text, data=text))

    def _write_file(self, rank: int, file: Path, write: Callable[[Path], Any]) -> None:
        """Write a file on a rank; an error is raised on all ranks (collective)."""
        work = partial(files.write_whole, file, write)
        files.try_together(self._comm, self._comm.rank == rank, work, f"cannot write '{file}'")

    def __enter__(self) -> ResultsWriter:
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to do: files are complete at any time, see ``files.write_whole``."""


def _numbered(names: list[str]) -> list[tuple[str, str]]:
    """Names of blocks and of files, numbered where they are equal (local)."""
    stems = [re.sub(r"\W+", "_", name) for name in names]
    stems = [n if stems.count(n) == 1 else f"{n}_{i}" for i, n in enumerate(stems)]
    names = [n if names.count(n) == 1 else f"{n} {i}" for i, n in enumerate(names)]
    return list(zip(names, stems, strict=True))


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
    X: Array, cells: Indices, dim: int, point_data: dict[str, Array],
    cell_data: dict[str, Array] | None = None,
) -> Any:  # fmt: skip
    """Mesh of one rank: points (n, d), cells in the order of VTK, values at both (local)."""
    import meshio

    at_points = {name: pad(values) for name, values in point_data.items()}
    in_cells = {name: [pad(values)] for name, values in (cell_data or {}).items()}
    return meshio.Mesh(pad(X), [(NAMES[dim, cells.shape[1]], cells)], at_points, in_cells)


def _outline_piece(obstacle: Obstacle, low: Array, high: Array) -> Any:
    """Mesh of the outline of an obstacle in a box, with its displacement (local)."""
    points, parts, displacement = outline(obstacle, low, high)
    return _piece(points, parts, parts.shape[1] - 1, {"displacement": displacement})


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
