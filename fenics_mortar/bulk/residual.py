# SPDX-License-Identifier: MIT
"""Bodies without contact: residual and tangent from UFL, and prescribed displacements.

``Bulk`` assembles the residual and the tangent; ``find_units`` gives the scales of the unknowns and
equations of mixed functions, and ``Fields`` measures the changes of those other than the
displacement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import cached_property, partial
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from ufl.algorithms import expand_derivatives

from fenics_mortar.bulk.cells import Cells
from fenics_mortar.bulk.fluxes import FormPoints
from fenics_mortar.bulk.history import History
from fenics_mortar.bulk.input_data import InputData
from fenics_mortar.bulk.node_blocks import CellBlocks, come_in_pairs
from fenics_mortar.mesh.space import DisplacementSpace, by_input_node
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import EPSILON, TINY, Array, Flags, Indices, Numbers
from fenics_mortar.utils.clock import clock


def find_units(K: PETSc.Mat, space: DisplacementSpace, stiffness: float) -> tuple[Array, Array]:
    """Find the scales of all owned unknowns and equations (collective).

    Unknowns and equations of mixed functions are scaled by the bulk tangent: one unit of an unknown
    other than the displacement causes forces of the size of the stiffness, or residuals that are
    equivalent to such a force in the other equations; the residual of an equation is scaled such
    that one unit of an unknown causes such a force. Results do not depend on the units of
    measurement.

    Args:
        K: Bulk tangent, as assembled.
        space: The displacement's nodes and dofs.
        stiffness: Force of a displacement of one [stress].

    Returns:
        Amount of each unknown that is equivalent to a displacement of one, and factor that turns
        the residual of each equation into a force, each (owned dofs,); one for displacements. An
        equation that contains no displacement, nor any field of an equation that does, keeps its
        residual, as an equal force.
    """
    units, to_force = np.zeros((2, space.num_owned))
    units[space.owned_dofs] = to_force[space.owned_dofs] = 1.0
    transpose = K.transpose(PETSc.Mat())
    for _ in range(space.whole.num_sub_spaces):  # those found last may be needed for to_force
        sizes = row_sizes(transpose, to_force), row_sizes(K, units)
        for known, size in zip((units, to_force), sizes, strict=True):
            reached = (known == 0.0) & (size > 0.0)
            known[reached] = stiffness / size[reached]
    to_force = np.where(to_force > 0.0, to_force, 1.0)
    size = row_sizes(transpose, to_force)
    transpose.destroy()
    own = stiffness / np.where(size > 0.0, size, stiffness)
    return np.where(units > 0.0, units, own), to_force


def row_sizes(matrix: PETSc.Mat, columns: Array) -> Array:
    """Largest absolute entry in each row of matrix diag(columns), (owned rows,) [entry column]."""
    scale = matrix.createVecRight()
    scale.array[:] = columns
    scaled = matrix.copy()
    scaled.diagonalScale(None, scale)
    starts, _, values = scaled.getValuesCSR()
    scaled.destroy()
    sizes, filled = np.zeros(columns.size), np.diff(starts) > 0
    if filled.any():
        sizes[filled] = np.maximum.reduceat(np.abs(values), starts[:-1][filled])
    return sizes


# Smallest ratio of the area, in space the volume, of each cell after a Newton step to that before
# it, at each point where the form is evaluated [1]. The limit prevents inverted cells and does not
# affect converging iterations.
MIN_AREA_RATIO = 0.2
# Fraction of a step below which it is not halved further [1]: ten halvings.
MIN_FRACTION = 1e-3
# Extensions of the pattern of K before it is created again: sliding contact leaves explicit zeros
# in it.
MAX_GROWTHS = 4
# Of bodies without history.
UNCHANGED = nullcontext()


class Bulk:
    """Residual r = f_int - f_ext and tangent K of the bodies, assembled by dolfinx.

    Args:
        residual: UFL form, linear in a test function of the space of ``u``.
        u: Displacement, alone or in a mixed function.
        bcs: Dirichlet conditions of dolfinx.
        jacobian: UFL form of the tangent; the derivative of ``residual`` by default.
        space: The displacement's nodes and dofs.
        history: Pairs of a function in the forms and the expression of its new value.
        before_assembly: Function that sets further functions of the forms, or ``None``.

    Attributes:
        V: Space of the displacement alone.
        values: Values of ``u`` in its own memory, ghosts included, shape (local dofs,) [length].
        residual: The form.
        data: Constants and functions of residual and tangent without the displacement.
        cells: The cells of this rank.
        is_mixed: Whether there are unknowns other than the displacement.
        units: Amount of each owned unknown that is equivalent to a displacement of one, shape
            (num_owned,).
        to_force: Factor that turns the residual of each equation into a force, shape (num_owned,).
        stiffness: Force of a displacement of one, once ``set_units`` has been called [stress].
        diagonal: Absolute diagonal of ``K`` then, shape (num_owned,); of displacements [stress].
        input_data: Values that the user may change between solves: prescribed values, constants,
            functions.
        num_dofs: Number N of dofs on all ranks.
        K: Tangent without boundary conditions, shape (N, N) [stress].
        r: Residual without contact forces and boundary conditions, shape (N,) [stress length].
        num_patterns: Number of matrices created for ``K`` so far.
        is_linear: Whether the residual is recognized as linear in the displacement.
        is_mixed: Whether there are unknowns other than the displacement.
        prescribed: Whether a local dof, ghosts included, has a prescribed value.
        history: Functions that accepted steps update.
        inertia: The ``Inertia`` of the bodies, ``None`` in statics.
        spread: Loads at points, spread over boundaries; ``r`` includes them, ``K`` does not.
        surfaces_slide: Whether a contact slides by finite distances, so that it depends on cells.

    Raises:
        MortarError: If a condition belongs to another space.
    """

    def __init__(
        self, residual: Any, u: Any, bcs: list[Any], jacobian: Any | None, space: DisplacementSpace,
        history: Sequence[tuple[Any, Any]] = (), before_assembly: Callable[[], Any] | None = None,
    ) -> None:  # fmt: skip
        self.u, self.V, self.bcs, self.space = u, space.V, list(bcs), space
        self.values: Array = u.x.array
        self.comm: MPI.Comm = self.V.mesh.comm
        self.prescribed = mark_prescribed(space, u, bcs)
        self.is_linear, self.residual = False, residual
        if jacobian is None:
            jacobian = ufl.derivative(residual, u, ufl.TrialFunction(space.whole))
            self.is_linear = self.u not in expand_derivatives(jacobian).coefficients()
        self._residual, self._tangent = compat.form(residual), compat.form(jacobian)
        self._tangent_data = [*jacobian.constants(), *jacobian.coefficients()]
        data = [*residual.constants(), *residual.coefficients(), *self._tangent_data]
        self.data = [value for value in dict.fromkeys(data) if value is not u]
        if before_assembly is not None:
            before_assembly = partial(
                errors.call_together, self.comm, "before_assembly", before_assembly
            )
        self.history = History(history, before_assembly)
        self.input_data = InputData(self, (residual, jacobian))
        self._data: list[Array] = []
        self._K_is_whole = False  # true if K is up to date and without added terms
        self._constant: Any = None  # K of a linear residual, while other terms are added to K
        self.inertia: Any = None  # an Inertia
        self.spread: list[Any] = []
        self.surfaces_slide = False
        self._K_includes_mass = False  # true if the pattern includes that of the mass matrix
        self.K: PETSc.Mat = compat.create_matrix(self._tangent)
        self.num_patterns, self._num_growths = 1, 0
        self._blocks: CellBlocks | None = None  # of K
        self.r: PETSc.Vec = compat.create_vector(space.whole)
        self.cells = Cells(self.V)
        self.num_owned, self.first, self.num_dofs = space.num_owned, space.first, self.r.getSize()
        self.units, self.to_force = np.ones((2, self.num_owned))
        self.is_mixed = space.is_mixed
        self.stiffness, self.diagonal = 0.0, np.zeros(self.num_owned)

    @cached_property
    def prescribed_dofs(self) -> Numbers:
        """Local numbers of the owned dofs with prescribed values, shape (k,)."""
        return np.flatnonzero(self.prescribed[: self.num_owned]).astype(np.int32)

    def tangent_data(self) -> list[Array]:
        """Copies of all values on which the tangent depends, except ``u`` (local).

        Each has the shape of the constant, or (local dofs,) of the function [any unit]; last, the
        inertia's.
        """
        with self.history.at_start():
            found = [
                np.array(data.value if hasattr(data, "value") else data.x.array)
                for data in self._tangent_data
                if data is not self.u
            ]
        return found + ([] if self.inertia is None else [np.array(self.inertia.factor)])

    @clock("residual")
    def assemble_residual(self) -> None:
        """Assemble ``r`` at the present displacement (collective)."""
        with self.history.assembling() if self.history.is_used else UNCHANGED:
            compat.assemble_vector(self.r, self._residual)
        for load in self.spread:
            load.add_to_residual(self)
        if self.inertia is not None:
            self.r.array[: self.num_owned] += self.inertia.forces(self.values)

    @clock("tangent")
    def assemble_tangent(self) -> None:
        """Assemble ``K`` at the present displacement, unless it is up to date (collective)."""
        data = self.tangent_data() if self.is_linear else []
        if self.is_linear and self._is_known(data):
            if not self._K_is_whole:
                self._constant.copy(self.K, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            self._K_is_whole = True
            return
        self._data, self._K_is_whole = data, False
        if self._constant is not None:
            self._forget_constant()
        if self._num_growths > MAX_GROWTHS:
            self.renew_tangent()
        with self.history.assembling() if self.history.is_used else UNCHANGED:
            self._assemble_cells()
        if self.inertia is not None:
            self.inertia.add_to_tangent(self.K, includes_mass=self._K_includes_mass)
            self._K_includes_mass |= self.inertia.factor != 0.0  # PETSc skips products with zero
        self._K_is_whole = True

    def _is_known(self, data: list[Array]) -> bool:
        """Whether K of a linear residual with this ``data`` is there or kept (collective)."""
        kept = self._constant is not None and self._num_growths <= MAX_GROWTHS
        same = len(data) == len(self._data) and all(map(np.array_equal, data, self._data))
        return ranks.on_all_ranks(self.comm, (self._K_is_whole or kept) and same)

    def _forget_constant(self) -> None:
        """Drop the kept tangent, if there is one (collective)."""
        if self._constant is not None:
            self._constant.destroy()
        self._constant = None

    def _assemble_cells(self) -> None:
        """Assemble the form into ``K``, by way of blocks once ``K`` has entries (collective)."""
        if not (self.K.assembled and (self._blocks or come_in_pairs(self.K))):
            compat.assemble_matrix(self.K, self._tangent)
            return
        if self._blocks is None:
            self._blocks = CellBlocks(self.K)
        compat.assemble_matrix(self._blocks.blocks, self._tangent)
        self._blocks.copy_to(self.K)

    def renew_tangent(self) -> None:
        """Create ``K`` anew with the pattern of the form, not assembled (collective)."""
        self._K_is_whole = False
        self._forget_constant()
        self.free_garbage()
        old, self.K = self.K, compat.create_matrix(self._tangent)  # the old one until then
        old.destroy()
        self.num_patterns, self._num_growths = self.num_patterns + 1, 0
        self._K_includes_mass = False

    def free_garbage(self) -> None:
        """Free unreferenced PETSc objects, also those made from ``r`` and ``K`` (collective)."""
        compat.free_garbage(self.comm, self.r, self.K)

    def extend_tangent(self, zeros: PETSc.Mat) -> None:
        """Extend the pattern of ``K`` by that of a matrix of zeros (collective).

        After ``MAX_GROWTHS`` extensions a new pattern is created.
        """
        self._num_growths += 1
        self._forget_constant()
        self.K.axpy(1.0, zeros, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)

    def tangent_to_change(self) -> PETSc.Mat:
        """Return ``K`` for additions in place; it is made anew before the next use (collective).

        That of a linear residual is kept.
        """
        if self.is_linear and self._K_is_whole and self._constant is None:
            self._constant = self.K.copy()
        self._K_is_whole = False
        return self.K

    def add_to_diagonal(self, values: Array) -> None:
        """Add ``values``, shape (num_owned,) [stress], to the diagonal of ``K`` (collective)."""
        diagonal = self.K.getDiagonal()
        diagonal.array[:] += values
        self.K.setDiagonal(diagonal)
        self._K_is_whole = False

    def prescribed_values(self) -> Array:
        """Prescribed values of ``prescribed_dofs``, shape (k,) [length] (local)."""
        return self.values_as_prescribed()[self.prescribed_dofs]

    def values_as_prescribed(self) -> Array:
        """Copy of ``values``, with the prescribed ones, shape (local dofs,) [length] (local)."""
        values = self.values.copy()
        compat.set_prescribed(values, self.bcs)
        return values

    def distance_to_prescribed(self) -> Array:
        """Prescribed minus present values of ``prescribed_dofs``, shape (k,) [length] (local)."""
        return self.prescribed_values() - self.values[self.prescribed_dofs]

    def move(self, step: Array, fraction: float = 1.0) -> float:
        """Add the largest fraction of a displacement increment that no cell limits (collective).

        Args:
            step: The increment, shape (num_owned,) [length].
            fraction: Largest fraction to add [1].

        Returns:
            The added fraction [1]: the largest of ``fraction``, ``fraction`` / 2, ... for which
            every cell keeps at least ``MIN_AREA_RATIO`` of its present area, see ``fluxes``.
        """
        u, smallest = self.values, MIN_FRACTION * fraction
        start, before = u.copy(), self.positions()
        u[: self.num_owned] += step
        if self.comm.size > 1:
            self.u.x.scatter_forward()
        increment = u - start
        if fraction < 1.0:
            u[:] = start + fraction * increment

        def is_too_large() -> bool:
            now, linear = self.positions(), self.surfaces_slide
            stays = self.form_points.keep_area(before, now, MIN_AREA_RATIO, linear=linear)
            return not ranks.on_all_ranks(self.comm, bool(stays))

        while fraction > smallest and is_too_large():
            fraction *= 0.5
            u[:] = start + fraction * increment
        return fraction

    def positions(self) -> Array:
        """Current positions of the local nodes, ghosts included, (n, dim) [length] (local)."""
        return self.cells.X + self.values[self.space.dofs]

    def set_units(self, stiffness: float) -> None:
        """Set ``units`` and ``to_force`` from ``K`` as assembled (collective).

        Args:
            stiffness: Force of a displacement of one [stress].
        """
        self.stiffness = stiffness
        self.diagonal = np.abs(self.K.getDiagonal().array_r)
        if self.space.is_mixed:
            self.units, self.to_force = find_units(self.K, self.space, stiffness)

    def largest(self, values: Array) -> float:
        """Largest absolute value of unknowns in their ``units`` [length] (collective).

        Args:
            values: Values of the unknowns, owned ones first, shape (num_owned,) or longer.
        """
        sizes = np.abs(values[: self.num_owned])
        if self.is_mixed:
            sizes /= self.units
        mine = float(sizes.max(initial=0.0))
        return mine if self.comm.size == 1 else float(self.comm.allreduce(mine, MPI.MAX))

    @cached_property
    def fields(self) -> Fields:
        """The parts of a mixed function other than the displacement (collective)."""
        return Fields(self)

    def by_input_node(self) -> tuple[Indices, Array]:
        """Identifiers (n, k) and values (n, dim) of all nodes, see ``mesh.space`` (collective)."""
        return by_input_node(self.space, self.u)

    @cached_property
    def form_points(self) -> FormPoints:
        """The points where the residual with finite strains is evaluated (collective)."""
        return FormPoints(self.residual, self.u, self.space)

    def inverted_cells(self) -> tuple[int, str]:
        """Number of cells inverted where the residual is evaluated, and a position (collective).

        The position is that of a cell in the reference state. With linear strains the number is 0.
        """
        return self.cells.count(self.form_points.inverted(self.positions()))

    def describe_inverted_nodes(self) -> str:
        """Remark on cells inverted at their nodes alone; "" if there are none (collective)."""
        x = self.positions()
        at_nodes = (self.cells.area_ratios(x) <= 0.0).any(axis=1)
        count, where = self.cells.count(at_nodes & ~self.form_points.inverted(x))
        if not count:
            return ""
        if not self.form_points.any:
            return f"{count} cells are inverted, one at {where}: the strains are not small"
        return (
            f"{count} cells are inverted at nodes, one at {where}, though not where the form is "
            "evaluated: refine there, or raise the quadrature degree of dx"
        )


class Fields:
    """The parts of a mixed function other than the displacement, and their changes.

    A coupling with the displacement may be so weak that the equation of a field has no part in the
    residual, whose rows are forces: the increments of each field have a test of their own.

    Args:
        bulk: The bulk of a mixed function.
    """

    def __init__(self, bulk: Bulk) -> None:
        self._bulk, fields = bulk, bulk.space.fields
        self._dofs = {part: some[some < bulk.num_owned] for part, (_, some) in fields.items()}
        self.begin()

    def begin(self) -> None:
        """A solve starts at the present values (local)."""
        self._start = np.abs(self._bulk.values[: self._bulk.num_owned])

    def change(self, step: Array, sources: Mapping[int, float]) -> float:
        """Largest change of a field over its largest value [1] (collective).

        Changes by rounding do not count: of the terms of the field's equation, also with the values
        at the start, which may have been taken away; of its loads; or of sources.

        Args:
            step: Changes of the unknowns, owned ones first, shape (num_owned,) or longer.
            sources: Rounding of sources that are not in the bulk, by field [flux length].
        """
        bulk, mine = self._bulk, []
        step, x, r = (np.abs(v[: bulk.num_owned]) for v in (step, bulk.values, bulk.r.array_r))
        terms = row_sizes(bulk.K, x + step + self._start)
        rounding = 4.0 * EPSILON * np.sqrt(bulk.num_dofs)
        for part, dofs in self._dofs.items():
            of_field = np.zeros(bulk.num_owned)
            of_field[dofs] = 1.0
            own = row_sizes(bulk.K, of_field)[dofs]
            known = own > 0.0  # others, as pressures of incompressible bodies, are in the residual
            noise = rounding * terms[dofs] + sources.get(part, 0.0)
            sizes = step[dofs][known], x[dofs], noise[known] / own[known], r[dofs], 1.0 / own[known]
            mine.append([values.max(initial=0.0) for values in sizes])
        of_all = ranks.largest_over_ranks(bulk.comm, np.array(mine).reshape(-1, 5))
        counts = (
            change / max(value, TINY)
            for change, value, noise, load, per_load in of_all
            if change > noise + rounding * load * per_load
        )
        return float(max(counts, default=0.0))


def mark_prescribed(space: DisplacementSpace, u: Any, bcs: Sequence[Any]) -> Flags:
    """Mark the local dofs with Dirichlet values, shape (local dofs,) (local).

    Raises:
        MortarError: If a condition belongs to another space.
    """
    prescribed = np.zeros(u.x.array.size, bool)
    for number, bc in enumerate(bcs):
        if not compat.is_part_of(space.whole, bc.function_space):
            raise errors.MortarError(
                f"Dirichlet condition {number} belongs to another space; expected the space of u "
                "or a component of it"
            )
        prescribed[bc.dof_indices()[0]] = True
    return prescribed
