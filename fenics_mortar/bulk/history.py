# SPDX-License-Identifier: MIT
"""History of materials: functions at quadrature points that an accepted step updates.

The stress at the end of a step depends on the displacement and on values at its start, such as the
plastic strain. These are functions in the forms. At the end of an accepted step each of them is
replaced by the value of an expression of the displacement and of the values at the start; all
expressions are evaluated before any function changes. Failed steps do not change them.

From then on the functions hold the values from which the next step starts, whereas forces and
tangent of the present state follow from the values at the start of the last step: a viscous stress
evaluated with the new values would be that after another step. ``History`` therefore keeps the
latter, and forms of the bodies are assembled ``at_start``. The start of the next step discards
them, at the same moment as that of the slip and of the memory of contact laws.

A stress that UFL cannot write is a function in the forms, too, as is its derivative. A function of
the user sets them before each assembly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms import extract_arguments, extract_coefficients
from ufl.domain import extract_domains

from fenics_mortar.mesh.space import by_cell, set_by_cell
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices, Value
from fenics_mortar.utils.errors import MortarError, check_kind, check_number, count_points

EXPECTED = "expected a list of pairs (quadrature function, UFL expression of its new value)"


def quadrature_function(mesh: Any, degree: int, shape: tuple[int, ...] = ()) -> fem.Function:
    """Create a function that has values at quadrature points only, zero at first (collective).

    Args:
        mesh: The mesh, such as ``data.mesh``.
        degree: Degree of the quadrature, that of the integrals that contain the function.
        shape: Shape of its values: () for scalars, (3, 3) for tensors.

    Raises:
        ValueError: If an argument is not allowed.

    Example:
        The plastic strain of a material with the measure ``ufl.dx(degree=2)``::

            plastic_strain = fm.quadrature_function(data.mesh, 2, (3, 3))
    """
    check_number("degree", degree, "a whole number, at least 0", lambda d: d >= 0, whole=True)
    if not isinstance(shape, tuple) or len(shape) > 2:
        raise ValueError(f"shape={shape!r}: expected (), (n,) or (n, m)")
    for size in shape:
        check_number("shape", size, "whole numbers, at least 1", lambda n: n >= 1, whole=True)
    return fem.Function(compat.quadrature_space(mesh, degree, shape))


@dataclass(frozen=True, eq=False)
class HistoryValues(Value):
    """Values of all history functions in a state, a value.

    Attributes:
        accepted: Values from which the next step starts, those of the functions one after the
            other, shape (local values,) [their units].
        start: Values at the start of the step that ended in the state, likewise; its forces follow
            from these.
    """

    accepted: Array
    start: Array


class History:
    """The history functions of a problem.

    The constructor is collective.

    Args:
        given: Pairs of a function and the expression of its new value.
        before_assembly: Function that sets further functions of the forms, or ``None``.

    Attributes:
        functions: The functions.
        before_assembly: The argument.
        is_used: Whether there is a history function, or such a function of the user.
        size: Number of all their local values.
    """

    def __init__(
        self,
        given: Sequence[tuple[Any, Any]] = (),
        before_assembly: Callable[[], Any] | None = None,
    ) -> None:
        self.before_assembly = before_assembly
        self.functions: list[Any] = [function for function, _ in given]
        self.is_used = bool(given) or before_assembly is not None
        self._updates = [_Update(function, expression) for function, expression in given]
        sizes = [function.x.array.size for function in self.functions]
        self.size, self._ends = sum(sizes), np.cumsum(sizes)[:-1]
        self._start, self._starts = self._read(), True

    def _read(self) -> Array:
        """Copy of the present values of all functions, shape (local values,) (local)."""
        return np.concatenate([np.empty(0), *(f.x.array for f in self.functions)])

    def _write(self, values: Array) -> None:
        """Set the present values of all functions, shape (local values,) (local)."""
        parts = np.split(values, self._ends) if self.functions else []
        for function, part in zip(self.functions, parts, strict=True):
            function.x.array[:] = part

    # Steps

    @property
    def values(self) -> HistoryValues:
        """The present values (local)."""
        accepted = self._read()
        return HistoryValues(accepted, accepted if self._starts else self._start)

    def put(self, values: HistoryValues) -> None:
        """Set the values of an earlier state (local)."""
        self._write(values.accepted)
        self._start, self._starts = values.start, False

    def start_step(self) -> None:
        """Start a step from the present values of the functions (local)."""
        self._start, self._starts = self._read(), True

    def new_values(self) -> Array:
        """Values at the end of the present step, (local values,) [their units] (collective).

        The functions are not changed.

        Raises:
            MortarError: On all ranks, if a value is not finite.
            Exception: Any error of ``before_assembly``.
        """
        if self.before_assembly is not None:
            self.before_assembly()
        return np.concatenate([np.empty(0), *(update.evaluate() for update in self._updates)])

    def accept(self, new_values: Array) -> None:
        """Set the values from which the next step starts, shape (local values,) (local)."""
        self._start, self._starts = self._read(), False
        self._write(new_values)

    @contextmanager
    def at_start(self) -> Iterator[None]:
        """Context in which the functions have the values at the start of the last step (local)."""
        if self._starts or not self.functions:
            yield
            return
        accepted, self._starts = self._read(), True
        self._write(self._start)
        try:
            yield
        finally:
            self._write(accepted)
            self._starts = False

    @contextmanager
    def assembling(self) -> Iterator[None]:
        """Context in which all functions of the forms are those of the present state (collective).

        Raises:
            Exception: Any error of ``before_assembly``.
        """
        with self.at_start():
            if self.before_assembly is not None:
                self.before_assembly()
            yield

    # Checkpoints

    def saved_data(self) -> dict[str, Any]:
        """Values by cells of the mesh input, equal on all ranks (collective)."""
        if not self.functions:
            return {}
        data, values = dict[str, Any](), self.values
        for name, numbers in (("history", values.accepted), ("history_start", values.start)):
            for i, part in enumerate(np.split(numbers, self._ends)):
                data["history_cells"], data[f"{name}{i}"] = by_cell(self.functions[i], part)
        return data

    def restore_data(self, data: Mapping[str, Any]) -> None:
        """Restore the values of ``saved_data``, from any number of ranks (collective)."""
        if not self.functions:
            return
        cells: Indices = data["history_cells"]
        accepted, start = (
            np.concatenate(
                [set_by_cell(f, cells, data[f"{name}{i}"]) for i, f in enumerate(self.functions)]
            )
            for name in ("history", "history_start")
        )
        self.put(HistoryValues(accepted, start))


class _Update:
    """The new value of a function, an expression at its quadrature points.

    The constructor is collective.

    Args:
        function: The quadrature function.
        expression: UFL expression of its shape.
    """

    def __init__(self, function: Any, expression: Any) -> None:
        self._function, V = function, function.function_space
        self._mesh = V.mesh
        degree = compat.quadrature_degree(function)
        points = compat.quadrature_points(compat.cell_name(V.mesh), ("default", degree))
        self._expression = compat.create_expression(expression, points)
        owned = V.mesh.topology.index_map(V.mesh.topology.dim).size_local
        self._cells = np.arange(owned, dtype=np.int32)
        self._dofs = compat.dofmap(V)[:owned]

    def evaluate(self) -> Array:
        """Values at all points, ghosts too, shape (local values,) [their unit] (collective).

        Raises:
            MortarError: On all ranks, if a value is not finite.
        """
        function = self._function
        found = compat.evaluate_expression(self._expression, self._mesh, self._cells)
        size = function.function_space.dofmap.bs
        values = np.asarray(found).reshape(*self._dofs.shape, size)
        self._check_finite(values)
        before = function.x.array.copy()
        function.x.array.reshape(-1, size)[self._dofs] = values
        function.x.scatter_forward()
        new = function.x.array.copy()
        function.x.array[:] = before
        return new

    def _check_finite(self, values: Array) -> None:
        """Refuse values (owned cells, points, components) that are not finite (collective)."""
        wrong = self._cells[~np.isfinite(values).all(axis=(1, 2))]
        geometry = self._mesh.geometry
        nodes = geometry.x[compat.geometry_dofmap(self._mesh)[wrong], : geometry.dim]
        count, where = count_points(self._mesh.comm, nodes.mean(axis=1))
        if count:
            raise MortarError(
                f"the new value of history function '{self._function.name}' is not finite in "
                f"{count} cells, one at {where}"
            )


def check_history(history: Any, forms: Mapping[str, Any], u: Any) -> None:
    """Reject history functions, expressions or integrals that do not fit (local).

    Args:
        history: Pairs of a function and the expression of its new value.
        forms: Forms with integrals of these functions, by name.
        u: The function of the unknowns.

    Raises:
        ValueError: If they are of a wrong kind, shape, mesh or degree.
    """
    if not isinstance(history, Sequence) or not all(
        isinstance(pair, Sequence) and len(pair) == 2 for pair in history
    ):
        raise ValueError(f"history={history!r}: {EXPECTED}")
    functions = [function for function, _ in history]
    for function, expression in history:
        _check_pair(function, expression, u)
    if len(set(map(id, functions))) < len(functions):
        raise ValueError(f"history has a function twice: {EXPECTED}")
    for name, form in forms.items():
        for integral in form.integrals():
            for function in functions:
                if function in extract_coefficients(integral.integrand()):
                    _check_integral(name, form, integral, function)


def _check_pair(function: Any, expression: Any, u: Any) -> None:
    """Reject a function or an expression of ``check_history`` (local)."""
    check_kind("a history function", function, fem.Function, "an fm.quadrature_function")
    name, degree = f"history function '{function.name}'", compat.quadrature_degree(function)
    if degree is None:
        raise ValueError(
            f"{name} is not a quadrature function: expected fm.quadrature_function(mesh, degree)"
        )
    check_kind(f"the new value of {name}", expression, ufl.core.expr.Expr, "a UFL expression")
    domain = u.function_space.ufl_domain()
    meshes = {function.function_space.ufl_domain(), *extract_domains(expression)}
    if any(other != domain for other in meshes):
        raise ValueError(f"{name} or its new value belongs to another mesh than u")
    if expression.ufl_shape != function.ufl_shape:
        raise ValueError(
            f"the new value of {name} has the shape {expression.ufl_shape}: expected that of the "
            f"function, {function.ufl_shape}"
        )
    if extract_arguments(expression):
        raise ValueError(f"the new value of {name} has a test or trial function")
    others = {compat.quadrature_degree(f) for f in extract_coefficients(expression)}
    if not others <= {None, degree}:
        raise ValueError(
            f"{name} is of degree {degree}, and its new value contains quadrature functions of "
            f"other degrees: expected one degree"
        )


def _check_integral(name: str, form: Any, integral: Any, function: Any) -> None:
    """Reject an integral of a history function by other points than its own (local)."""
    degree = compat.quadrature_degree(function)
    what = f"history function '{function.name}'"
    if integral.integral_type() != "cell":
        raise ValueError(f"{what} has no values on facets, and an integral of the {name} has it")
    for rule, _ in compat.quadrature_rules(form, integral):
        if rule != ("default", degree):
            raise ValueError(
                f"{what} has values at the points of degree {degree}, and an integral of the "
                f"{name} with it has the rule '{rule[0]}' of degree {rule[1]}: expected "
                f"ufl.dx(degree={degree}), or fm.quadrature_function of the degree of the integral"
            )
