# SPDX-License-Identifier: MIT
"""Inversion of the deformation at the points where a form with finite strains is evaluated.

A form sees the displacement at its quadrature points only. A deformation is inverted if det F <= 0
at one of these, whether or not the stress has a barrier there: no body deforms in this way. Nodes
of cells are not judged: below a corner or at a bonded edge, det F at a node may be negative on any
mesh, although it is positive at all points of the form and the mesh converges.

With linear strains the sign of det F has no meaning. If surfaces slide by finite distances, steps
of Newton's method are limited nevertheless, since folded surfaces disturb the search for contact.
But a cell limits them only until it is strongly compressed, so that few steps lead to any state.

Strains of an integral over cells are recognized as linear if its derivative does not depend on the
displacement, or vanishes for a gradient that is a rotation W = -W^T, at any displacement: the
stress is a function of sym(grad u). With finite strains, stresses turn with the body.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import ufl
from ufl.algorithms import expand_derivatives
from ufl.algorithms.expand_indices import expand_indices
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.constantvalue import Zero
from ufl.corealg.multifunction import MultiFunction

from fenics_mortar.bulk.cells import areas_at, areas_or_nan, gradients_at, nodal_gradients
from fenics_mortar.bulk.fluxes import Given
from fenics_mortar.kernels.facets import keep_volume
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.ranks import largest_over_ranks

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
    nodes: npt.NDArray[np.int32]
    gradients: Array
    undeformed: Array


class FormPoints:
    """Points of the owned cells where integrals with finite strains are evaluated.

    Cells without such integrals have their nodes as points.

    Args:
        residual: UFL form, linear in a test function of the space of ``u``.
        u: Displacement, alone or in a mixed function.
        space: The displacement's nodes and dofs.

    Attributes:
        any: Whether an integral of the form has finite strains, equal on all ranks.
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
            self._finite.append(_points(X, nodes, cells, gradients_at(V, points)))
            rest[cells] = False
        at_nodes = nodal_gradients(V)
        self._linear = _points(X, nodes, np.flatnonzero(rest), at_nodes)
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
            ratios = areas_at(x, group.nodes, group.gradients) / group.undeformed
            found[group.cells] |= (ratios <= 0.0).any(axis=1)
        return found


def _points(X: Array, nodes: Any, cells: Indices, gradients: Array) -> CellPoints:
    """Points of some cells; those with the same gradients, as of a straight triangle, are one."""
    different = np.unique(gradients, axis=0)
    own = np.ascontiguousarray(nodes[cells])
    return CellPoints(cells, own, different, areas_or_nan(X, own, different))


def _with_finite_strains(residual: Any, u: Any, space: DisplacementSpace) -> list[Any]:
    """Integrals over cells whose derivative is that of finite strains."""
    trial = ufl.TrialFunction(space.whole)
    first = 0
    if space.is_mixed:
        first = sum(int(np.prod(p.ufl_shape)) for p in ufl.split(trial)[: space.part])
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


def check_rules(residual: Any, u: Any, space: DisplacementSpace) -> None:
    """Reject a residual that the form compiler evaluates at wrong points (collective).

    FFCx 0.5 takes values at the point of a rule of one point for the points of other rules, too,
    on quadrilaterals and curved triangles. If a residual has such rules, it is compared with the
    sum of its integrals, compiled one by one, at a displacement of 1e-3 of the mesh.

    Args:
        residual: UFL form, linear in a test function of the space of ``u``.
        u: Displacement, alone or in a mixed function; unchanged.
        space: The displacement's nodes and dofs.

    Raises:
        MortarError: On all ranks.
    """
    V, integrals = space.V, residual.integrals_by_type("cell")
    rules = {rule for i in integrals for rule, _ in compat.quadrature_rules(residual, i)}
    sizes = {len(compat.quadrature_points(compat.cell_name(V.mesh), rule)) for rule in rules}
    if 1 not in sizes or len(sizes) < 2:
        return
    kept, X = u.x.array.copy(), np.zeros(u.x.array.size)
    X[: space.dofs.max(initial=-1) + 1] = space.positions()
    size = float(largest_over_ranks(V.mesh.comm, np.abs(X).max(initial=0.0)))
    u.x.array[:] = 1e-3 * size * np.cos(3.0 * X / size + np.arange(X.size) % 2)
    u.x.scatter_forward()
    try:
        parts = [residual, *(ufl.Form([integral]) for integral in residual.integrals())]
        whole, *others = (_assembled(part, u) for part in parts)
    finally:
        u.x.array[:] = kept
    sizes_of = [np.abs(values).max(initial=0.0) for values in (whole - sum(others), whole)]
    error, largest = largest_over_ranks(V.mesh.comm, np.array(sizes_of))
    if error > ROUNDING * largest:
        raise MortarError(
            "this release of the form compiler evaluates the residual at wrong points: it has "
            "integrals over cells by one point (quadrature_degree 0 or 1) and others by more; take "
            "quadrature_degree=2 or more for all, or a mixed function of displacement and pressure"
        )


def _assembled(form: Any, u: Any) -> Array:
    """A form of rank 1, assembled, (owned dofs,)."""
    vector = compat.create_vector(u.function_space)
    compat.assemble_vector(vector, compat.form(form))
    values = vector.array_r.copy()
    vector.destroy()
    return np.asarray(values)
