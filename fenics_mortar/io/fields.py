# SPDX-License-Identifier: MIT
"""What files and pictures contain: values at the nodes, in the cells and on the slave surfaces.

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

from fenics_mortar.bulk.reference_cell import DEGREES, ReferenceCell
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.files import try_together


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
    num_cells = problem.equations.bulk.V.mesh.topology.index_map(2).size_local
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
        "tangential_traction": np.einsum("jc,jc->j", o.tau, contact.z_u),
        "gap": contact.gap,
        "status": contact.active.astype(np.int32),
        "normal": o.n,
    }


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
        midpoint = ReferenceCell(compat.cell_name(V.mesh)).midpoint
        compiled = compat.create_expression(given, midpoint)
        cells = np.arange(V.mesh.topology.index_map(2).size_local, dtype=np.int32)
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
    cells = compat.dofmap(V)[: mesh.topology.index_map(2).size_local, 0]
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
        function: A scalar or plane vector function for which ``has_nodes`` is true.
    """

    def __init__(self, problem: ContactProblem, function: fem.Function) -> None:
        V = problem.equations.bulk.V
        self._function, self._is_scalar = function, function.ufl_shape == ()
        self._space, self._parent_dofs = _space_of(function)
        self._own = fem.Function(self._space)
        degree = DEGREES[V.dofmap.dof_layout.num_dofs]
        space = compat.scalar_space if self._is_scalar else compat.vector_space
        self._at_nodes = fem.Function(space(V.mesh, degree))
        cells = owned_cells(problem)
        first = np.unique(cells, return_index=True)[1]
        self._dofs = compat.dofmap(self._at_nodes.function_space)[: len(cells)].ravel()[first]

    def evaluate(self) -> Array:
        """Values [unit of the field] at the nodes of owned cells, shape (nodes,) or (nodes, 2).

        Nodes are in the order of the dofs of the displacement (local).
        """
        self._own.x.array[:] = self._function.x.array[self._parent_dofs]
        self._at_nodes.interpolate(self._own)
        values = self._at_nodes.x.array
        return values[self._dofs] if self._is_scalar else values.reshape(-1, 2)[self._dofs]


def has_nodes(problem: ContactProblem, field: Any) -> bool:
    """Whether a field has values at nodes (collective).

    This holds for scalar and plane vector functions of Lagrange spaces on the mesh of the problem,
    with a degree up to that of the displacement, and for such parts of mixed functions.
    """
    V = problem.equations.bulk.V
    if not isinstance(field, fem.Function) or field.ufl_shape not in ((), (2,)):
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
    collapsed, dofs = space.collapse()
    return collapsed, np.asarray(dofs, dtype=np.int64)
