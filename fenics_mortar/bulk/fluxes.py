# SPDX-License-Identifier: MIT
"""Evaluation of a UFL residual in cells: stress, loads and moduli, and inversion at its points.

``Fluxes`` extracts the stress, the loads and the moduli of any material from the form.
``FormPoints`` finds the deformations that the form inverts, at the points where it is evaluated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives, replace
from ufl.algorithms.analysis import extract_type
from ufl.algorithms.expand_indices import expand_indices
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.constantvalue import Zero
from ufl.corealg.multifunction import MultiFunction

from fenics_mortar.bulk import cells as bulk_cells
from fenics_mortar.kernels.facets import keep_volume
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices, Numbers

if TYPE_CHECKING:
    from fenics_mortar.mesh.space import DisplacementSpace

Subdomain = tuple[Any, Any]


class Values(NamedTuple):
    """Values at points of cells, shape (...).

    Attributes:
        jacobian: dx/dX, shape (..., dim, dim) [length].
        gradient: grad u, shape (..., dim, dim).
        stress: P, shape (..., dim, dim) [stress].
        residual: div P + f, shape (..., dim) [stress / length].
        constraint: Residuals of the constraints, shape (..., constraints).
    """

    jacobian: Array
    gradient: Array
    stress: Array
    residual: Array
    constraint: Array


class Fluxes:
    """Compiled fluxes of a residual, evaluated at the present displacement.

    A residual of first order is linear in v and grad v: P : grad v - f . v in a cell, -t . v on the
    boundary. Evaluation of its integrand I(v, grad v) for unit entries yields

        f_i = -I(e_i, 0),    P_iJ = I(0, e_i x e_J),    t_i = -I(e_i, 0) on the boundary,

    and its derivative yields the moduli dP_iJ / dF_kL. With the test function q = 1 of another
    unknown, e.g. a pressure, it is a constraint on the displacement, zero at all points.

    Args:
        residual: UFL form, linear in a test function of the space of ``u``.
        u: Displacement, alone or in a mixed function.
        space: The displacement's nodes and dofs.

    Raises:
        MortarError: If the form has integrals of an unsupported kind.
    """

    def __init__(self, residual: Any, u: fem.Function, space: DisplacementSpace) -> None:
        """Extract and compile (collective)."""
        self._mesh, self._dim = space.V.mesh, space.dim
        mesh, dim = self._mesh, self._dim
        self.cell = bulk_cells.ReferenceCell(compat.cell_name(mesh))
        # Distance from the axis of revolution below which it is rounding; -1 without an axis
        extent = ranks.largest_over_ranks(mesh.comm, np.abs(mesh.geometry.x).max(initial=0.0))
        self._axis = ROUNDING * float(extent) if space.is_axisymmetric else -1.0
        # Test function of the form itself: with dolfinx 0.5 a new one may hash differently, since
        # the first compilation changes the mesh's element.
        (test,), trial = residual.arguments(), ufl.TrialFunction(space.whole)
        displacement = u if not space.is_mixed else ufl.split(u)[space.part]
        size, first = _unknowns(space)
        motion = range(first, first + dim)
        others = [k for k in range(size) if k not in motion]
        x = ufl.SpatialCoordinate(mesh)  # first entry of each list: an expression needs a mesh
        bulk, boundary = _integrands(expand_derivatives(residual))
        self._in_cells, self._on_boundary = list(bulk), list(boundary)
        self._num_constraints = len(others)
        self._strain = fem.Constant(mesh, np.zeros((dim, dim)))
        still = [0.0] * dim
        rows = [[self._strain[k - first, J] for J in range(dim)] if k in motion else still
                for k in range(size)]  # fmt: skip
        change = ufl.as_tensor(rows)
        J, H = ufl.Jacobian(mesh), ufl.grad(displacement)
        at_points, moduli, loads = [*_entries(J), *_entries(H)], [x[0]], [x[0]]
        for integrand in bulk.values():
            I = _Entries(integrand, test, (size, dim))
            P, minus_f = I.of_gradient(motion), I.of_value(motion)
            constraints, fluxes = I.of_value(others), _flat(I.of_gradient(others))
            at_points += [*_flat(P), *_entries(ufl.div(ufl.as_tensor(P)) - ufl.as_vector(minus_f))]
            at_points += [*constraints, *fluxes]
            derivative = expand_derivatives(ufl.derivative(integrand, u, trial))
            given = Given(trial, ufl.zero(size), change)
            I = _Entries(map_integrand_dags(given, derivative), test, (size, dim))
            moduli += [*_flat(I.of_gradient(motion)), *I.of_value(others)]
        at_points.append(x[0])
        everywhere = np.concatenate([self.cell.points, self.cell.side_points])
        self._values = self._compile(at_points, everywhere)
        self._moduli = self._compile(moduli, self.cell.midpoint)
        self._normal = fem.Constant(mesh, np.zeros(dim))
        normal = ufl.dot(self._normal, ufl.JacobianInverse(mesh))
        normal = normal / ufl.sqrt(ufl.dot(normal, normal))
        for integrand in boundary.values():
            normals = extract_type(integrand, ufl.FacetNormal)
            there = replace(integrand, dict.fromkeys(normals, normal))
            loads += [-t for t in _Entries(there, test, (size, dim)).of_value(motion)]
        self._loads = self._compile(loads, self.cell.side_points)

    def in_cells(self, cells: Indices) -> tuple[Values, Values, Array]:
        """Values in owned ``cells`` (n,), (n, p), and on their sides, (n, s, q) (local).

        Also the largest flux of other unknowns and the largest value, for ``refuse_fluxes``
        [stress].
        """
        values, count, dim = self._evaluate(self._values, cells), self._num_constraints, self._dim
        shape, size = values.shape[:2], dim**2
        J, H = (values[..., i : i + size].reshape(*shape, dim, dim) for i in (0, size))
        width = size + dim + (1 + dim) * count
        sums = _summed(values[..., 2 * size : -1], width, self._in_cells, cells)
        # Hoop strains are 0 / 0 on the axis, and weighted by a thickness of 0
        sums[np.abs(values[..., -1]) <= self._axis] = 0.0
        P, r, c, fluxes = np.split(sums, np.cumsum([size, dim, count]), axis=2)
        P = P.reshape(H.shape)
        largest = np.array([np.abs(a).max(initial=0.0) for a in (fluxes, sums)])
        p, sides = len(self.cell.weights), (len(self.cell.sides), len(self.cell.shapes))
        inside = Values(*(a[:, :p] for a in (J, H, P, r, c)))
        along = (a[:, p:].reshape(len(a), *sides, *a.shape[2:]) for a in (J, H, P, r, c))
        return inside, Values(*along), largest

    def refuse_fluxes(self, mine: Array) -> None:
        """Raise if fluxes are not rounding compared with all values (collective).

        Args:
            mine: The largest flux and the largest value on this rank, shape (2,).

        Raises:
            MortarError: On all ranks, if a gradient of another test function occurs.
        """
        largest = ranks.largest_over_ranks(self._mesh.comm, mine)
        if largest[0] > ROUNDING * largest[1]:
            raise errors.MortarError(
                "the error cannot be estimated: the residual has the gradient of a test function "
                "other than that of the displacement; expected constraints such as "
                "(div(u) - p / kappa) * q"
            )

    def moduli(self, cells: Indices) -> tuple[Array, Array]:
        """Derivatives with respect to F at the midpoints of owned ``cells`` (n,) (local).

        Returns:
            dP_iJ / dF_kL, shape (n, dim, dim, dim, dim) [stress], and derivatives of the
            constraints, shape (n, constraints, dim, dim).
        """
        dim, size = self._dim, self._dim**2
        rows = size + self._num_constraints
        sums = np.zeros((cells.size, rows, size))
        for column, direction in enumerate(np.eye(size)):
            self._strain.value[:] = direction.reshape(dim, dim)
            values = self._evaluate(self._moduli, cells)[..., 1:]
            sums[:, :, column] = _summed(values, rows, self._in_cells, cells)[:, 0]
        A, C = sums[:, :size], sums[:, size:]
        return A.reshape(-1, *[dim] * 4), C.reshape(*C.shape[:2], dim, dim)

    def loads(self, cells: Indices, sides: Indices, facets: Indices) -> Array:
        """Tractions of the form on boundary sides of cells (local).

        Args:
            cells: Local cells, shape (n,).
            sides: Numbers of their sides, shape (n,).
            facets: Local facets of these sides, shape (n,).

        Returns:
            Tractions, shape (n, q, dim) [stress].
        """
        q, dim = len(self.cell.shapes), self._dim
        t = np.zeros((cells.size, q, dim))
        for side in range(len(self.cell.sides)):
            self._normal.value[:] = self.cell.normals[side]
            here = np.flatnonzero(sides == side)
            values = self._evaluate(self._loads, cells[here])[:, side * q : (side + 1) * q, 1:]
            t[here] = _summed(values, dim, self._on_boundary, facets[here])
        return t

    def _compile(self, entries: list[Any], points: Array) -> tuple[Any, tuple[int, int]]:
        """Compile a list of scalars for reference points (collective)."""
        compiled = compat.create_expression(ufl.as_vector(entries), points)
        return compiled, (len(points), len(entries))

    def _evaluate(self, compiled: tuple[Any, tuple[int, int]], cells: Indices) -> Array:
        """Values at all points in local ``cells`` (n,), shape (n, points, entries) (local)."""
        expression, shape = compiled
        values = compat.evaluate_expression(expression, self._mesh, cells.astype(np.int32))
        return np.asarray(values, np.float64).reshape(cells.size, *shape)


def _integrands(residual: Any) -> tuple[dict[Subdomain, Any], dict[Subdomain, Any]]:
    """Integrands over the cells and over the boundary, by subdomain: number and tags."""
    found: dict[str, dict[Subdomain, Any]] = {"cell": {}, "exterior_facet": {}}
    for integral in residual.integrals():
        kind, number = integral.integral_type(), integral.subdomain_id()
        tags = integral.subdomain_data()
        if kind not in found or number == "otherwise":
            raise errors.MortarError(
                f"the error cannot be estimated: the residual has an integral of kind {kind!r} "
                f"over {number!r}; expected integrals over cells and boundary"
            )
        if number == "everywhere":
            tags = None
        elif not hasattr(tags, "find"):
            raise errors.MortarError(
                f"the error cannot be estimated: an integral over part {number} has no MeshTags"
            )
        group = found[kind]
        integrand, key = integral.integrand(), (number, tags)
        group[key] = group[key] + integrand if key in group else integrand
    return found["cell"], found["exterior_facet"]


def _within(subdomain: Subdomain, entities: Indices) -> Flags:
    """Whether local entities (n,) belong to a subdomain, shape (n,) (local)."""
    number, tags = subdomain
    if tags is None:
        return np.ones(entities.size, bool)
    numbers = number if isinstance(number, tuple) else (number,)
    return np.isin(entities, np.concatenate([tags.find(int(k)) for k in numbers]))


def _summed(values: Array, width: int, subdomains: Sequence[Subdomain], entities: Indices) -> Array:
    """Sum of the values of all integrals at entities (n,) of their subdomains (local).

    Args:
        values: Values of one integral after the other, shape (n, points, integrals * width).
        width: Number of values of an integral.
        subdomains: The subdomain of each integral.
        entities: Local cells or facets.

    Returns:
        Shape (n, points, width); zero without integrals.
    """
    sums = np.zeros((*values.shape[:2], width))
    for number, subdomain in enumerate(subdomains):
        on = _within(subdomain, entities)
        sums[on] += values[on, :, width * number : width * (number + 1)]
    return sums


def _unknowns(space: DisplacementSpace) -> tuple[int, int]:
    """Number of components of the whole space, and the first one of the displacement."""
    if not space.is_mixed:
        return space.dim, 0
    sizes = [int(np.prod(part.ufl_shape)) for part in ufl.split(ufl.TestFunction(space.whole))]
    return sum(sizes), sum(sizes[: space.part])


class _Entries:
    """Coefficients of the components of an argument and of its gradient in an integrand.

    Args:
        integrand: Linear in the argument, derivatives expanded.
        argument: The argument.
        shape: Shape of its gradient.
    """

    def __init__(self, integrand: Any, argument: Any, shape: tuple[int, int]) -> None:
        self._integrand, self._argument, self._shape = integrand, argument, shape

    def of_value(self, components: Sequence[int]) -> list[Any]:
        """Coefficients of some components."""
        return [self._at((k,), None) for k in components]

    def of_gradient(self, components: Sequence[int]) -> list[list[Any]]:
        """Coefficients of the gradient of some components, one row each."""
        return [[self._at(None, (k, J)) for J in range(self._shape[1])] for k in components]

    def _at(self, value: tuple[int, ...] | None, gradient: tuple[int, ...] | None) -> Any:
        given = Given(self._argument, _unit(self._shape[:1], value), _unit(self._shape, gradient))
        return map_integrand_dags(given, self._integrand)


class Given(MultiFunction):
    """Replacement of an argument and its gradient by given values.

    Args:
        argument: The argument.
        value: Its value.
        gradient: Its gradient.
    """

    expr = MultiFunction.reuse_if_untouched

    def __init__(self, argument: Any, value: Any, gradient: Any) -> None:
        super().__init__()
        self._argument, self._value, self._gradient = argument, value, gradient

    def argument(self, o: Any) -> Any:
        """Replace the argument."""
        return self._value if o == self._argument else o

    def grad(self, o: Any) -> Any:
        """Replace its gradient; derivatives apply to terminals only."""
        return self._gradient if o.ufl_operands[0] == self._argument else o


def _unit(shape: tuple[int, ...], index: tuple[int, ...] | None) -> Any:
    """A tensor of zeros with 1 at one position."""
    if index is None:
        return ufl.zero(*shape)
    entries = np.zeros(shape)
    entries[index] = 1.0
    return ufl.as_tensor(entries.tolist())


def _flat(rows: list[list[Any]]) -> list[Any]:
    """Entries of rows in one list."""
    return [entry for row in rows for entry in row]


def _entries(value: Any) -> list[Any]:
    """Entries of a UFL vector or tensor, row by row."""
    return [value[index] for index in np.ndindex(*value.ufl_shape)]


# Skew matrices that represent all rotations: forms are linear in them, with simple coefficients.
SPINS = {
    2: np.array([[0.0, -1.0], [1.0, 0.0]]),
    3: np.array([[0.0, -7.0, 3.0], [7.0, 0.0, -1.0], [-3.0, 1.0, 0.0]]),
}


class CellPoints(NamedTuple):
    """Cells with the same reference points.

    Attributes:
        cells: Local cells, shape (m,).
        nodes: Their nodes, shape (m, k).
        gradients: Gradients of the shape functions at the points, shape (p, k, dim) [1].
        undeformed: Determinants of dX/dxi, nan where a cell has no area or volume, shape (m, p)
            [length^dim].
    """

    cells: Indices
    nodes: Numbers
    gradients: Array
    undeformed: Array


class FormPoints:
    """Points of the owned cells where integrals with finite strains are evaluated.

    Cells without such integrals have their nodes as points.

    A form sees the displacement at its quadrature points only. A deformation is inverted if
    det F <= 0 at one of these, whether or not the stress has a barrier there: no body deforms in
    this way. Nodes of cells are not judged: below a corner or at a bonded edge, det F at a node may
    be negative on any mesh, although it is positive at all points of the form and the mesh
    converges.

    With linear strains the sign of det F has no meaning. If surfaces slide by finite distances,
    steps of Newton's method are limited nevertheless, since folded surfaces disturb the search for
    contact. But a cell limits them only until it is strongly compressed, so that few steps lead to
    any state.

    Strains of an integral over cells are recognized as linear if its derivative does not depend on
    the displacement, or vanishes for a gradient that is a rotation W = -W^T, at any displacement:
    the stress is a function of sym(grad u). With finite strains, stresses turn with the body.

    Args:
        residual: UFL form, linear in a test function of the space of ``u``.
        u: Displacement, alone or in a mixed function.
        space: The displacement's nodes and dofs.

    Attributes:
        any: Whether an integral of the form has finite strains, equal on all ranks.
        linear: The owned cells without such integrals, shape (m,).
    """

    def __init__(self, residual: Any, u: Any, space: DisplacementSpace) -> None:
        """Find integrals and points (collective)."""
        V = space.V
        nodes = compat.dofmap(V)[: V.mesh.topology.index_map(space.dim).size_local]
        X = V.tabulate_dof_coordinates()[:, : space.dim].copy()
        groups = dict[Any, list[Indices]]()
        for integral in _with_finite_strains(residual, u, space):
            for rule, number in compat.quadrature_rules(residual, integral):
                cells = compat.subdomain_cells(integral.subdomain_data(), number, len(nodes))
                groups.setdefault(rule, []).append(cells)
        self._num_cells, self.any = len(nodes), bool(groups)
        self._finite, rest = list[CellPoints](), np.ones(len(nodes), bool)
        for rule, found in groups.items():
            cells = np.unique(np.concatenate(found))
            points = compat.quadrature_points(compat.cell_name(V.mesh), rule)
            self._finite.append(_points(X, nodes, cells, bulk_cells.gradients_at(V, points)))
            rest[cells] = False
        at_nodes = bulk_cells.nodal_gradients(V)
        self.linear: Indices = np.flatnonzero(rest)
        self._linear = _points(X, nodes, self.linear, at_nodes)
        self._nodes_of_finite = _points(X, nodes, np.flatnonzero(~rest), at_nodes)

    def keep_area(self, before: Array, after: Array, fraction: float, *, linear: bool) -> bool:
        """Whether a motion leaves every cell a fraction of its area at every point (local).

        Nodes are examined as well, so that long steps do not fold cells between the points; but not
        those that have lost more than 1 - ``fraction`` of their undeformed area.

        Args:
            before: Positions of the local nodes, shape (n, dim) [length].
            after: Positions after the motion, shape (n, dim) [length].
            fraction: Smallest area, in space volume, after over that before, which counts as zero
                if negative [1].
            linear: Whether nodes of cells with linear strains are examined.
        """
        for g in self._finite:
            at = g.nodes, g.gradients, g.undeformed
            if not keep_volume(before, after, *at, fraction, -np.inf):
                return False
        for g in (self._nodes_of_finite, self._linear) if linear else (self._nodes_of_finite,):
            at = g.nodes, g.gradients, g.undeformed
            if not keep_volume(before, after, *at, fraction, fraction):
                return False
        return True

    def inverted(self, x: Array) -> Flags:
        """Whether det F <= 0 at a point of a cell, shape (owned cells,) (local).

        Args:
            x: Positions of the local nodes, shape (n, dim) [length].
        """
        found = np.zeros(self._num_cells, bool)
        for group in self._finite:
            ratios = bulk_cells.areas_at(x, group.nodes, group.gradients) / group.undeformed
            found[group.cells] |= (ratios <= 0.0).any(axis=1)
        return found

    def too_few(self) -> Flags:
        """Whether motions other than rigid ones strain a cell at none of its points (local).

        That is so if the points have fewer strains than the cell has other motions; shape (owned
        cells,). Cells without finite strains are not judged.
        """
        lacking = np.zeros(self._num_cells)
        for group in self._finite:
            _, nodes, dim = group.gradients.shape
            lacking[group.cells] = nodes * dim - dim * (dim + 1) // 2
        for group in self._finite:
            points, _, dim = group.gradients.shape
            lacking[group.cells] -= points * dim * (dim + 1) // 2
        return np.asarray(lacking > 0)


def _points(X: Array, nodes: Any, cells: Indices, gradients: Array) -> CellPoints:
    """Points of some cells; those with the same gradients, as of a straight triangle, are one."""
    different = np.unique(gradients, axis=0)
    own = np.ascontiguousarray(nodes[cells])
    return CellPoints(cells, own, different, bulk_cells.areas_or_nan(X, own, different))


def _with_finite_strains(residual: Any, u: Any, space: DisplacementSpace) -> list[Any]:
    """Integrals over cells whose derivative is that of finite strains."""
    trial, (_, first) = ufl.TrialFunction(space.whole), _unknowns(space)
    rotation = np.zeros((*trial.ufl_shape, space.dim))
    rotation[first : first + space.dim] = SPINS[space.dim]
    turned = Given(trial, ufl.zero(*trial.ufl_shape), ufl.as_tensor(rotation.tolist()))
    found = []
    for integral in residual.integrals():
        if integral.integral_type() != "cell":
            continue
        tangent = expand_derivatives(ufl.derivative(ufl.Form([integral]), u, trial))
        if u not in tangent.coefficients():
            continue
        by_rotation = map_integrand_dags(turned, tangent)
        by_rotation = map_integrand_dags(_EqualBranches(), expand_indices(by_rotation))
        if not all(isinstance(part.integrand(), Zero) for part in by_rotation.integrals()):
            found.append(integral)
    return found


class _EqualBranches(MultiFunction):
    """Replacement of conditionals with equal values by the value."""

    expr = MultiFunction.reuse_if_untouched

    def conditional(self, o: Any, condition: Any, true: Any, false: Any) -> Any:
        """Replace a conditional of equal values."""
        return true if true == false else self.reuse_if_untouched(o, condition, true, false)
