# SPDX-License-Identifier: MIT
"""What files, tables and pictures contain: values of bodies and surfaces, outlines of obstacles.

Lagrange functions are interpolated to the nodes of the displacement. Other UFL expressions are
evaluated at the midpoints of the cells, or averaged over them if they contain functions that exist
at quadrature points only.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms import extract_arguments, extract_coefficients
from ufl.domain import extract_domains

from fenics_mortar.bulk.cells import DEGREES, midpoint_of
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, check_kind
from fenics_mortar.utils.files import MarkdownText, markdown_table, try_together
from fenics_mortar.utils.ranks import largest_over_ranks


def check_problem(problem: Any) -> None:
    """Reject objects that are not problems (local).

    Raises:
        ValueError: If the object is not a problem.
    """
    check_kind("problem", problem, ContactProblem, "a ContactProblem")


def check_name(name: Any) -> None:
    """Reject names of fields that are not strings or already used (local).

    Raises:
        MortarError: For another name.
    """
    if not isinstance(name, str) or not name or name == "displacement":
        expected = "expected a non-empty string other than 'displacement'"
        raise MortarError(f"field {name!r} cannot be evaluated: {expected}")


def owned_cells(problem: ContactProblem) -> Indices:
    """Nodes of the owned cells, shape (cells, nodes), in the order of dolfinx (local)."""
    num_cells = problem.equations.bulk.V.mesh.topology.index_map(
        problem.equations.bulk.space.dim
    ).size_local
    return compat.dofmap(problem.equations.bulk.V)[:num_cells].astype(np.int64)


def evaluated_contacts(problem: ContactProblem) -> list[Any]:
    """The pairs of a problem, evaluated at its present displacement (collective)."""
    for contact in problem.equations.contacts:
        contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)
    return list(problem.equations.contacts)


def surface_fields(contact: Contact | Tie, u: Array) -> dict[str, Array]:
    """Fields at the nodes of a slave surface by name, see ``ResultsWriter`` (local).

    Args:
        contact: A pair of ``evaluated_contacts``.
        u: Displacement, shape (local dofs,) [length].
    """
    o, friction = contact.operators, dict[str, Any]()
    if isinstance(contact, Contact):
        friction = {"slip": contact.slip, "sticking": contact.sticking.astype(np.int32)}
        friction |= {f"memory_{name}": v for name, v in contact.accepted_instant.memory.items()}
    return friction | {
        "displacement": contact.slave.gather(u),
        "contact_pressure": contact.pressure,
        "tangential_traction": _tangential(contact),
        "gap": contact.gap,
        "status": contact.active.astype(np.int32),
        "normal": o.n,
    }


def _tangential(contact: Contact | Tie) -> Array:
    """Tangential traction [stress]: along tau in the plane, (n,), a vector in space, (n, 3)."""
    o, z = contact.operators, contact.z_u
    if z.shape[1] == 2:
        return np.asarray(np.einsum("jc,jc->j", o.tau, z))
    return np.asarray(z - (z * o.n).sum(axis=1)[:, None] * o.n)


class CellField:
    """A UFL expression at the midpoints of the owned cells, compiled once (collective).

    If it contains functions that exist at quadrature points only, its mean over each cell.

    Args:
        problem: The problem on whose mesh it is evaluated.
        expression: Scalar, vector or tensor.
        name: Name of the field.
        rank: Largest allowed rank of the expression.

    Raises:
        MortarError: On all ranks, if it cannot be evaluated.
    """

    def __init__(self, problem: ContactProblem, expression: Any, name: str, rank: int = 2) -> None:
        self._shape: tuple[int, ...] = ()
        work = partial(self._compile, problem.equations.bulk.V, expression, rank)
        message = f"field {name!r} cannot be evaluated"
        self._values: Any = try_together(problem.equations.comm, True, work, message)

    def _compile(self, V: Any, given: Any, rank: int) -> Callable[[], Array]:
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
        midpoint = midpoint_of(compat.cell_name(V.mesh))
        compiled = compat.create_expression(given, midpoint)
        owned = V.mesh.topology.index_map(V.mesh.topology.dim).size_local
        cells = np.arange(owned, dtype=np.int32)
        return partial(compat.evaluate_expression, compiled, V.mesh, cells)

    def evaluate(self) -> Array:
        """Values [unit of the field], shape (owned cells,) and that of the expression (local)."""
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
    forms = [compat.form(c * test * measure) for c in (ufl.as_ufl(1.0), *components)]

    def means() -> Array:
        area, *sums = (compat.local_sums(form)[cells] for form in forms)
        return np.stack([each / area for each in sums], axis=1)

    return means


class NodalField:
    """A Lagrange function interpolated to the nodes of the displacement (collective).

    Args:
        problem: The problem on whose mesh the function is defined.
        function: A scalar or vector function for which ``has_nodes`` is true.
    """

    def __init__(self, problem: ContactProblem, function: fem.Function) -> None:
        V = problem.equations.bulk.V
        self._function, self._is_scalar = function, function.ufl_shape == ()
        self._space, self._parent_dofs = _space_of(function)
        self._own = fem.Function(self._space)
        degree = DEGREES[V.dofmap.dof_layout.num_dofs]
        space = compat.scalar_space if self._is_scalar else compat.vector_space
        self._at_nodes, self._dim = fem.Function(space(V.mesh, degree)), V.mesh.geometry.dim
        cells = owned_cells(problem)
        first = np.unique(cells, return_index=True)[1]
        self._dofs = compat.dofmap(self._at_nodes.function_space)[: len(cells)].ravel()[first]

    def evaluate(self) -> Array:
        """Values [unit of the field] at the nodes of owned cells, (nodes,) or (nodes, dim).

        Nodes are in the order of the dofs of the displacement (local).
        """
        self._own.x.array[:] = self._function.x.array[self._parent_dofs]
        self._at_nodes.interpolate(self._own)
        values = self._at_nodes.x.array
        return values[self._dofs] if self._is_scalar else values.reshape(-1, self._dim)[self._dofs]


def has_nodes(problem: ContactProblem, field: Any) -> bool:
    """Whether a field has values at nodes (collective).

    This holds for scalar and vector functions of Lagrange spaces on the mesh of the problem,
    with a degree up to that of the displacement, and for such parts of mixed functions.
    """
    V = problem.equations.bulk.V
    if not isinstance(field, fem.Function) or field.ufl_shape not in ((), (V.mesh.geometry.dim,)):
        return False
    if field.function_space.mesh is not V.mesh:
        return False
    layout = _space_of(field)[0].dofmap.dof_layout
    degree = DEGREES.get(layout.num_dofs, 0)
    at_vertices = len(layout.entity_dofs(0, 0)) == 1
    return at_vertices and 1 <= degree <= DEGREES[V.dofmap.dof_layout.num_dofs]


def _space_of(function: fem.Function) -> tuple[fem.FunctionSpace, slice | Indices]:
    """Space of a function, or of a part of a mixed one, and its dofs in the array."""
    space = function.function_space
    if not compat.is_sub_space(space):
        return space, slice(None)
    return compat.collapsed(space)


# Number of points per direction of the grid on which outlines of obstacles are searched: its cells
# are narrower than the lines of a picture.
GRID = 400


def bounding_box(bulk: Bulk) -> tuple[Array, Array]:
    """Lower and upper corner of a box around deformed bodies, (dim,) [length] (collective)."""
    x = bulk.positions()
    ends = np.concatenate([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    ends = largest_over_ranks(bulk.comm, ends)
    dim = x.shape[1]
    return with_margin(-ends[:dim], ends[dim:])


def with_margin(low: Array, high: Array) -> tuple[Array, Array]:
    """A box with a margin of 15 % of its longer side, where obstacles are drawn (local).

    Args:
        low: Lower corner of a box, shape (2,) [length].
        high: Upper corner, shape (2,) [length].
    """
    margin = 0.15 * (high - low).max()
    return low - margin, high + margin


def outline(obstacle: Obstacle, low: Array, high: Array) -> tuple[Array, Indices, Array]:
    """Outline phi = 0 of an obstacle in a box, as line segments (local).

    For an obstacle outside the box it is a line of zero length at the pivot, since files without
    points are unreadable.

    Args:
        obstacle: The obstacle.
        low: Lower corner of the box, shape (2,) [length].
        high: Upper corner, shape (2,) [length].

    Returns:
        Points in the obstacle's frame (n, 2) [length], ends of the segments (m, 2), and
        displacements of the points (n, 2) [length].
    """
    lines = _zeros(obstacle, low, high) or [np.tile(obstacle.pivot + obstacle.place[:2], (2, 1))]
    points = np.concatenate(lines)
    first = np.setdiff1d(np.arange(len(points)), np.cumsum([len(line) for line in lines]) - 1)
    own = obstacle.to_own_frame(points)
    return own, np.stack([first, first + 1], axis=1), points - own


def _zeros(obstacle: Obstacle, low: Array, high: Array) -> list[Array]:
    """Polylines phi = 0 in a box, each (n, 2) [length] (local)."""
    from matplotlib.figure import Figure

    x, y, points = grid(low, high)
    phi = obstacle.evaluate(points)[0].reshape(GRID, GRID)
    if not phi.min() < 0.0 < phi.max():
        return []
    lines = Figure().add_subplot().contour(x, y, phi, [0.0]).allsegs[0]
    for _ in range(2):  # Newton steps from the chords of the grid to the curve
        fields = [obstacle.evaluate(line) for line in lines]
        lines = [
            line - (phi / (gradient**2).sum(axis=1))[:, None] * gradient
            for line, (phi, gradient, _) in zip(lines, fields, strict=True)
        ]
    return lines


def grid(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Grid in the box from ``low`` to ``high``, each (2,) [length] (local).

    Returns:
        Coordinates x and y, each (GRID,), and points (GRID^2, 2) [length].
    """
    x, y = (np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True))
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def contact_table(problem: ContactProblem) -> MarkdownText:
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
    return MarkdownText(markdown_table(head, rows, left=(0,)))
