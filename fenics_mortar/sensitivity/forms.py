# SPDX-License-Identifier: MIT
"""UFL forms as quantities; the constants and functions in them, and nodal positions, as controls.

The derivative with respect to a constant c in the direction d is the integral of
d(integrand)/dc . d; that with respect to a function is UFL's Gateaux derivative. The transposed
derivative with respect to a function f is the linear form of test functions of the space of f, and
so is that with respect to the positions of the nodes, by UFL's coordinate derivative.

``read`` checks the arguments of a gradient, and converts constants, functions and forms of UFL to
these controls and quantities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.sparse import csr_array

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from ufl.algorithms import expand_derivatives
from ufl.algorithms.map_integrands import map_integrands
from ufl.corealg.traversal import unique_pre_traversal

from fenics_mortar.bulk.checks import check_domain, check_subdomains
from fenics_mortar.equations.linearized import LinearVector
from fenics_mortar.sensitivity.history import UNKNOWNS, PairOperator, check_exact, history_of
from fenics_mortar.sensitivity.partials.fields import by_positions, check_positions, fields_by_state
from fenics_mortar.sensitivity.protocols import Combined, ContactQuantity, Control, Quantity, Values
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MortarError, check_same_texts, together

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.equations.general import ContactEquations
    from fenics_mortar.problem import ContactProblem
    from fenics_mortar.sensitivity.history import Before
    from fenics_mortar.utils.arrays import Array


# Objects with compiled forms, by bulk and key.
_kept: WeakKeyDictionary[Bulk, dict[Any, Any]] = WeakKeyDictionary()


def kept_for(bulk: Bulk, key: Any, make: Callable[[], Any]) -> Any:
    """The object made earlier for a key, such as a UFL object, or a new one (local)."""
    kept = _kept.setdefault(bulk, {})
    if key not in kept:
        kept[key] = make()
    return kept[key]


class AssembledForm:
    """A form of rank 0 or 1, compiled when first assembled; all methods are collective.

    Args:
        form: The form.
        comm: Communicator of the mesh.
        space: Space of the test function, ``None`` for rank 0.
    """

    def __init__(self, form: ufl.Form, comm: MPI.Comm, space: Any = None) -> None:
        self._form, self._comm, self._space = form, comm, space

    @cached_property
    def _compiled(self) -> Any:
        """The compiled form, ``None`` if it is zero."""
        expanded = expand_derivatives(self._form)
        return compat.form(expanded) if expanded.integrals() else None

    @cached_property
    def _vector(self) -> PETSc.Vec:
        return compat.create_vector(self._space)

    def value(self) -> Any:
        """Number of a form of rank 0, equal on all ranks, or vector (owned dofs,) [its unit]."""
        if self._space is None:
            mine = 0.0 if self._compiled is None else fem.assemble_scalar(self._compiled)
            return self._comm.allreduce(float(mine))
        if self._compiled is None:
            return np.zeros(num_owned(self._space))
        compat.assemble_vector(self._vector, self._compiled)
        return self._vector.array_r.copy()


class DerivativeByConstant:
    """Derivative of a form with respect to a ``fem.Constant``; all methods are collective.

    Args:
        mesh: The mesh.
        form: The form.
        constant: The constant.
        space: Space of the form's test function, ``None`` for rank 0.
    """

    def __init__(self, mesh: Any, form: ufl.Form, constant: fem.Constant, space: Any = None):
        self._comm, self._constant = mesh.comm, constant
        variable = ufl.variable(constant)
        self._direction = fem.Constant(mesh, 0.0 * constant.value)

        def along(integrand: Any) -> Any:
            return ufl.inner(ufl.diff(integrand, variable), self._direction)

        form = ufl.replace(expand_derivatives(form), {constant: variable})
        self._assembled = AssembledForm(map_integrands(along, form), mesh.comm, space)

    def along(self, direction: Array) -> Any:
        """Derivative in a direction of its shape: a number or (owned dofs,) [its unit]."""
        self._direction.value[...] = direction
        return self._assembled.value()

    def transposed(self, weights: Array | None = None) -> Array:
        """Derivatives with respect to all numbers of the constant, of its shape, replicated.

        Units: that of the form or weighted sum over that of the constant [its unit].

        Args:
            weights: Weights of the values of the test function, shape (owned dofs,), of a form of
                rank 1.
        """
        shape = self._constant.value.shape
        units = np.eye(self._constant.value.size).reshape(-1, *shape)
        changes = [self.along(unit) for unit in units]
        if weights is None:
            return np.reshape(changes, shape)
        return self._comm.allreduce(np.reshape([weights @ change for change in changes], shape))


class DerivativeByField:
    """Derivative of a form with respect to a function, or to positions; methods are collective.

    Args:
        form: The form.
        field: The function, or the ``ufl.SpatialCoordinate`` of the form.
        V: Space of the function, or of the changes of the positions.
        space: Space of the form's test function, ``None`` for rank 0.
    """

    def __init__(self, form: ufl.Form, field: Any, V: Any, space: Any = None) -> None:
        comm, action = V.mesh.comm, form
        self._direction = fem.Function(V)
        if space is not None:
            self._weights, (test,) = fem.Function(space), form.arguments()
            action = ufl.replace(form, {test: self._weights})
            forwards = ufl.derivative(form, field, self._direction)
            self._forwards = AssembledForm(forwards, comm, space)
        backwards = ufl.derivative(action, field, ufl.TestFunction(V))
        self._backwards = AssembledForm(backwards, comm, V)

    def along(self, direction: Array) -> Array:
        """Change of a form of rank 1 along a direction, both (owned dofs,) [unit of the form]."""
        put_owned(self._direction, direction)
        return self._forwards.value()

    def transposed(self, weights: Array | None = None) -> Array:
        """Derivatives with respect to all values, (owned dofs,) [unit of the form over theirs].

        Args:
            weights: See ``DerivativeByConstant.transposed``.
        """
        if weights is not None:
            put_owned(self._weights, weights)
        return self._backwards.value()


def derivative_by(mesh: Any, form: ufl.Form, data: Any, space: Any = None) -> Any:
    """Derivative of a form with respect to a constant or function (local).

    Arguments: see ``DerivativeByConstant``.
    """
    if isinstance(data, fem.Constant):
        return DerivativeByConstant(mesh, form, data, space)
    return DerivativeByField(expand_derivatives(form), data, data.function_space, space)


def num_owned(space: Any) -> int:
    """Number of dofs of a space owned by this rank (local)."""
    return int(space.dofmap.index_map.size_local * space.dofmap.index_map_bs)


def put_owned(function: fem.Function, values: Array) -> None:
    """Set the owned values of a function, shape (owned dofs,), and its ghosts (collective)."""
    function.x.array[: values.size] = values
    function.x.scatter_forward()


class FormQuantity(Quantity):
    """Value and derivatives of a UFL form of rank 0; all methods are collective.

    See ``Quantity`` for the methods.

    Args:
        bulk: The bodies.
        form: The form.

    Attributes:
        form: The form.
    """

    def __init__(self, bulk: Bulk, form: ufl.Form) -> None:
        self.form, self._u, self._mesh = form, bulk.u, bulk.V.mesh
        self._data = [*form.constants(), *form.coefficients()]
        self._derivatives: dict[Any, Any] = {}

    @cached_property
    def _checked(self) -> ufl.Form:
        """The form, whose tags belong to the mesh."""
        check_subdomains("objective", self.form, self._mesh, ())
        return self.form

    @cached_property
    def _value(self) -> AssembledForm:
        return AssembledForm(self._checked, self._mesh.comm)

    def _by(self, data: Any) -> Array:
        """Derivative with respect to a constant or function."""
        if data not in self._derivatives:
            self._derivatives[data] = derivative_by(self._mesh, self._checked, data)
        return self._derivatives[data].transposed()

    def value(self, problem: ContactProblem, before: Before = None) -> float:
        """Value at the present state [unit of the quantity], equal on all ranks."""
        return self._value.value()

    def gradient(self, problem: ContactProblem, before: Before = None) -> LinearVector:
        """dJ/ds_k."""
        return LinearVector(u=self._by(self._u))

    def depends_on(self, control: Any) -> bool:
        """Whether a control occurs in the form (local)."""
        data = getattr(control, "data", None)
        return any(data is value for value in self._data)

    def by_control(self, problem: ContactProblem, control: Any, before: Before = None) -> Values:
        """Explicit derivative dJ/dm at fixed states, of the shape of m [unit of J / unit of m]."""
        return self._by(control.data) if self.depends_on(control) else 0.0


class FormControl:
    """A ``fem.Constant`` or ``fem.Function`` of a problem; all methods are collective.

    Values have the shape of the constant and are replicated, or that of the owned dofs of the
    function. See ``Control`` for the methods.

    It may occur in the residual and in Dirichlet conditions. The rows of free dofs change with the
    form r, those of prescribed dofs are u - g with the prescribed values g. For a control m in
    both:

        (dR/dm) dm = dr/dm dm  at free dofs,    -dg/dm dm  at prescribed dofs.

    g contains copies of entries of m. They are identified by numbering the entries of m: later
    conditions on a dof then overwrite earlier ones as in a solve.

    Args:
        bulk: The bodies.
        data: The constant or function.
    """

    def __init__(self, bulk: Bulk, data: Any) -> None:
        self._comm, self._space, self._bcs = bulk.comm, bulk.space.whole, bulk.bcs
        self._is_prescribed = bulk.prescribed[: bulk.num_owned]
        self._num_local = bulk.prescribed.size
        self.data = data
        self.is_distributed = isinstance(data, fem.Function)
        self.name = str(data.name) if self.is_distributed else "a constant"
        self.is_in_residual = any(data is value for value in bulk.data)
        if self.is_in_residual:
            self._derivative = derivative_by(bulk.V.mesh, bulk.residual, data, self._space)

    @property
    def _numbers(self) -> Array:
        """All numbers, ghosts included, as a flat view."""
        values = self.data.x.array if self.is_distributed else self.data.value
        return values.reshape(-1)

    @cached_property
    def _copied(self) -> csr_array:
        """Ones at copies of numbers in prescribed values, shape (owned dofs, local numbers)."""
        before, found = self._numbers.copy(), []
        for numbers in (np.arange(1.0, before.size + 1.0), np.zeros(before.size)):
            self._numbers[:] = numbers
            values = np.zeros(self._num_local)
            compat.set_prescribed(values, self._bcs)
            found.append(values[: self._is_prescribed.size])
        self._numbers[:] = before
        copies = np.rint(found[0] - found[1]).astype(np.int64)
        dofs = np.flatnonzero(copies)
        shape = copies.size, before.size
        return csr_array((np.ones(dofs.size), (dofs, copies[dofs] - 1)), shape=shape)

    @cached_property
    def occurs(self) -> bool:
        """Whether residual or prescribed values depend on the control."""
        return self._comm.allreduce(self.is_in_residual or self._copied.nnz > 0)

    def get(self, problem: ContactProblem) -> Array:
        """Present values, (owned dofs,) of a function, or the shape of a constant [their unit]."""
        if self.is_distributed:
            return self.data.x.array[: num_owned(self.data.function_space)].copy()
        return np.array(self.data.value)

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Set the values, of the shape of ``get``."""
        if self.is_distributed:
            put_owned(self.data, np.asarray(values))
        else:
            self.data.value[...] = values

    def jvp(self, problem: ContactProblem, direction: Array, before: Before = None) -> LinearVector:
        """(dR/dm) dm; see ``Control``."""
        rows = np.zeros(self._is_prescribed.size)
        if self.is_in_residual:
            rows = np.where(self._is_prescribed, 0.0, self._derivative.along(direction))
        return LinearVector(u=rows - self._copied @ self._with_ghosts(direction))

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """(dR/dm)^T y; see ``Control``."""
        u = np.zeros(self._is_prescribed.size) if y.u is None else y.u
        result = np.zeros_like(self.get(problem))
        if self.is_in_residual:
            result = self._derivative.transposed(np.where(self._is_prescribed, 0.0, u))
        return result - self._sum_ghosts(self._copied.T @ u).reshape(result.shape)

    def pairs(self, problem: ContactProblem) -> list[int]:
        """Numbers of the pairs whose rows or memory depend on it at fixed states (local).

        None, pairs depend on the control through the state only.
        """
        return []

    def _with_ghosts(self, values: Array) -> Array:
        """Values of a direction with ghosts, flat."""
        if not self.is_distributed:
            return np.ravel(values)
        direction = fem.Function(self.data.function_space)
        put_owned(direction, values)
        return direction.x.array

    def _sum_ghosts(self, values: Array) -> Array:
        """Sum of the values (local numbers,) of all ranks, at owned dofs or replicated."""
        if not self.is_distributed:
            return self._comm.allreduce(values)
        vector = compat.create_vector(self.data.function_space)
        with vector.localForm() as local:
            local.array[:] = values
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        owned = vector.array_r.copy()
        vector.destroy()
        return owned


class NodalPositions:
    """Positions X of the nodes; all methods are collective.

    Derivatives with respect to them are shape derivatives. Nodal values are constant while the
    nodes move. Residual and UFL objectives are differentiated by UFL's coordinate derivative.
    Contact depends only on the positions x = X + u, at the end of the step and in the state from
    which slip is counted.

    Values are those of a displacement of the mesh at the owned dofs of ``u``, [length]. Prescribed
    values, loads, offsets, thickness and the choices at set-up do not move with the mesh. The
    displacement must be of degree 1, without further unknowns, on straight cells.
    """

    name, is_distributed = "nodal positions", True

    def get(self, problem: ContactProblem) -> Array:
        """Positions in ``problem``, shape (owned dofs,) [length]; see ``Control``."""
        space = problem.equations.bulk.space
        return space.positions()[: space.num_owned].copy()

    def set(self, problem: ContactProblem, values: Array) -> None:
        """Raise an error: ``values``, shape (owned dofs,) [length], cannot be set in ``problem``.

        Raises:
            MortarError: Always.
        """
        raise MortarError("nodes of a problem cannot be moved: set up a new one on the moved mesh")

    def _of_form(self, problem: ContactProblem, form: ufl.Form, space: Any) -> DerivativeByField:
        """Derivative of a form by the positions; ``space``: of its test function, or ``None``.

        Raises:
            MortarError: On all ranks, if the nodes of displacement and mesh differ.
        """
        bulk = problem.equations.bulk
        V, mesh = bulk.space.V, bulk.V.mesh
        nodes = compat.dofmap(V).shape[1], compat.geometry_dofmap(mesh).shape[1]
        if bulk.space.is_mixed or nodes != 2 * (compat.num_corners(mesh),):
            raise MortarError(
                "nodal positions as control need displacements of degree 1 on straight cells"
            )
        given = form, _positions_in(form, mesh), V, space
        return kept_for(bulk, ("positions", form), lambda: DerivativeByField(*given))

    def _of_residual(self, problem: ContactProblem) -> DerivativeByField:
        bulk = problem.equations.bulk
        return self._of_form(problem, bulk.residual, bulk.space.V)

    def jvp(self, problem: ContactProblem, dm: Array, before: Before = None) -> LinearVector:
        """Change of the residuals along ``dm``, shape (owned dofs,) [length]; see ``Control``.

        ``problem`` and the state ``before`` are those of a step.
        """
        bodies = LinearVector(u=self._of_residual(problem).along(dm))
        contact = contact_by_positions(problem, before) @ LinearVector(u=dm)
        return free(problem.equations, bodies + contact)

    def vjp(self, problem: ContactProblem, y: LinearVector, before: Before = None) -> Array:
        """Gradient of the product of residuals and ``y``, shape (owned dofs,) [product / length].

        See ``Control``; ``problem`` and the state ``before`` are those of a step.
        """
        y = free(problem.equations, y)
        total = contact_by_positions(problem, before).T @ y
        if y.u is not None:
            total = total + LinearVector(u=self._of_residual(problem).transposed(y.u))
        return np.zeros(problem.equations.bulk.num_owned) if total.u is None else total.u

    def explicit(self, problem: ContactProblem, quantity: Any, before: Before = None) -> Array:
        """Derivative of a quantity at fixed displacements, shape (owned dofs,) [quantity / length].

        ``problem`` and the state ``before`` are those of a step.
        """
        form = getattr(quantity, "form", None)
        if form is not None:
            return self._of_form(problem, form, None).transposed()
        earlier = quantity.by_before(problem, before) or LinearVector()
        total = (quantity.gradient(problem, before) + earlier).u
        return np.zeros(problem.equations.bulk.num_owned) if total is None else total


def contact_by_positions(problem: ContactProblem, before: Before = None) -> PairOperator:
    """Derivative of the residuals by the positions of the nodes, contacts only (collective).

    Positions are values at the dofs of the displacement. See ``partials.fields``. Rows of
    prescribed dofs and motions, which contain no forces, are to be set to zero, see ``free``.

    Args:
        problem: The problem, at the end of a step, evaluated with ``EXACT``.
        before: State at the start of the step, with friction.

    Raises:
        MortarError: On all ranks, if contact depends on the undeformed mesh in other ways.
    """
    history, matrices = history_of(problem.equations, before), {}
    for i, contact in enumerate(problem.equations.contacts):
        check_positions(contact)
        check_exact(contact)
        matrices[i] = by_positions(contact)
        if history is not None and i in history.pairs:
            rows = fields_by_state(contact, ["z"])["z"].T
            matrices[i] = matrices[i] + rows @ history.pairs[i].rows
    return PairOperator(problem.equations, matrices, UNKNOWNS, UNKNOWNS)


def free(e: ContactEquations, x: LinearVector) -> LinearVector:
    """``x`` with zeros at prescribed dofs and motions, whose rows contain no forces (local)."""
    prescribed = e.bulk.prescribed[: e.bulk.num_owned]
    u = None if x.u is None else np.where(prescribed, 0.0, x.u)
    return LinearVector(u, x.z, None if x.q is None else np.where(e.motions.driven, x.q, 0.0))


def _positions_in(form: ufl.Form, mesh: dmesh.Mesh) -> ufl.SpatialCoordinate:
    """Coordinates that occur in a form, or new ones (local).

    UFL finds them by a hash that depends on the coordinate element; FFCx 0.5 changes this element.
    """
    parts = (unique_pre_traversal(integral.integrand()) for integral in form.integrals())
    found = (p for p in chain.from_iterable(parts) if isinstance(p, ufl.SpatialCoordinate))
    return next(found, ufl.SpatialCoordinate(mesh))


def controls_of(problem: ContactProblem, given: Any) -> list[Control]:
    """Controls; constants and functions are converted (local).

    Raises:
        ValueError: If an object is not a control, or a pair reads a constant or function.
    """
    return [_control_of(problem, control) for control in as_list(given)]


def quantities_of(problem: ContactProblem, given: Any) -> list[Quantity]:
    """Quantities; UFL forms are converted (local).

    Raises:
        ValueError: If an object is neither a quantity nor a form of rank 0.
    """
    return [_quantity_of(problem, quantity) for quantity in as_list(given)]


def as_list(given: Any) -> list[Any]:
    """A list of at least one object from one object or several (local).

    Raises:
        ValueError: If the list is empty.
    """
    found = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    if not found:
        raise ValueError("an empty list: expected at least one control and one quantity")
    return found


def read(
    problem: ContactProblem, objective: Any, controls: Any
) -> tuple[list[Quantity], list[Control]]:
    """Quantities and controls of a gradient; see ``gradient`` for the arguments (collective).

    Raises:
        ValueError: On all ranks, if an argument is of another type, or nothing depends on a
            control.
        MortarError: On all ranks, if number, kind or arguments of quantities or controls differ.
    """
    comm = problem.equations.comm
    with together(comm, "gradient"):
        quantities, made = quantities_of(problem, objective), controls_of(problem, controls)
    given = {
        "quantities": [_described(quantity) for quantity in quantities],
        "controls": [f"{type(control).__name__} {control.name}" for control in made],
    }
    check_same_texts(comm, "gradient", given)
    for control in made:
        occurs = getattr(control, "occurs", True)
        tests = (getattr(quantity, "depends_on", lambda _: False) for quantity in quantities)
        if not occurs and not any(depends_on(control) for depends_on in tests):
            raise ValueError(
                f"{control.name}: neither residual nor Dirichlet conditions nor objective depend "
                "on this control"
            )
    return quantities, made


def _refuse_data_of_pairs(problem: ContactProblem, data: Any) -> None:
    """Raise for a constant or function that a pair reads: its rows have no derivative by it.

    Raises:
        ValueError: If a pair reads it.
    """
    for contact in problem.equations.contacts:
        pair: Any = contact.pair
        read = [("jump", getattr(pair, "jump", None))]
        read += [("temperature", heat.temperature) for heat in getattr(pair, "fluxes", ())]
        read += getattr(getattr(pair, "law", None), "varying", {}).items()
        for name, value in read:
            if value is data:
                raise ValueError(
                    f"{data} is {name} of {pair!r}, by which a gradient has no derivative; "
                    "parameters of laws are controls by sensitivity.LawParameter"
                )


def _control_of(problem: ContactProblem, control: Any) -> Control:
    bulk = problem.equations.bulk
    if control is bulk.u:
        raise ValueError("the displacement is an unknown: expected a control on which it depends")
    if isinstance(control, (fem.Constant, fem.Function)):
        _refuse_data_of_pairs(problem, control)
        return kept_for(bulk, control, lambda: FormControl(bulk, control))
    if not hasattr(control, "jvp") or not hasattr(control, "vjp"):
        raise ValueError(
            f"control {control!r}: expected a fem.Constant, a fem.Function or a control of the "
            f"package, e.g. LawParameter(0, 'mu')"
        )
    _check(control)
    return control


def _quantity_of(problem: ContactProblem, quantity: Any) -> Quantity:
    bulk = problem.equations.bulk
    if isinstance(quantity, ufl.Form):
        if quantity.arguments():
            raise ValueError(
                f"the objective is a form with {len(quantity.arguments())} arguments: expected a "
                "form without test functions"
            )
        check_domain("objective", quantity, bulk.V.ufl_domain())
        return kept_for(bulk, quantity, lambda: FormQuantity(bulk, quantity))
    if not hasattr(quantity, "value") or not hasattr(quantity, "gradient"):
        raise ValueError(
            f"objective {quantity!r}: expected a scalar UFL form or a quantity of the package, "
            f"e.g. TotalForce(0, (0.0, 1.0))"
        )
    _check(quantity)
    if isinstance(quantity, ContactQuantity):
        quantity.check_dimension(bulk.space.dim)
    return quantity


def _check(given: Any) -> None:
    """Check the arguments of a control or quantity, if it has a method for this (local)."""
    check = getattr(given, "check", None)
    if check is not None:
        check()


def _described(quantity: Any) -> list[Any]:
    """Type and public arguments of a quantity, or of its parts, for a comparison (local)."""
    if isinstance(quantity, Combined):
        return [type(quantity).__name__, *map(_described, quantity.parts)]
    public = {name: v for name, v in vars(quantity).items() if not name.startswith("_")}
    return [type(quantity).__name__, public]
