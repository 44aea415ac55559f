# SPDX-License-Identifier: MIT
"""Linear bulk with one factorization: Newton's method on the contact dofs alone.

For constant symmetric K the displacement is linear in the contact forces q on the dofs S of the
surfaces and in the prescribed values of the dofs H. After a full step the residual is r_S = -q and
zero elsewhere, and the next step is

    dd_S = d_S - A (K_c dd + B^T z)_S,        C dd + A_z z = rhs,

where d_S is the step without contact force and A = (K^-1)_SS the compliance, a dense matrix on rank
0. This small system is equivalent to the large one. The step without contact force is

    d_S = -A r_S - W^T (prescribed - present)_H - (K^-1 r_I)_S,      W = K_HF (K^-1)_FS,

with the free dofs F and I = F without S. The last term is nonzero for new loads only. A is the
inverse of the Schur complement of K on S. Products of W with earlier changes of prescribed values
are stored; few of these are independent along a path. The displacement inside the bodies is
computed at the end of Newton's method.

Choice between all equations and those reduced to the contact dofs of a linear bulk.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
from scipy.sparse import coo_array

from fenics_mortar.bulk.bodies import find_floating_bodies
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.equations.linearized import (
    ContactMatrices,
    ReducedTangent,
    on_first_rank,
    solve_dense,
)
from fenics_mortar.la.compliance import Compliance, ContactDofs
from fenics_mortar.la.options import COMPLIANCE, costs_of
from fenics_mortar.la.sparse import flatten, is_symmetric
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError

if TYPE_CHECKING:
    from fenics_mortar.contact.rows import Rows
    from fenics_mortar.equations.general import ContactEquations
    from fenics_mortar.interface.mortar import Block
    from fenics_mortar.newton.loop import Status, Step
    from fenics_mortar.utils.arrays import Array, Flags


class ReducedEquations:
    """Equations for ``newton.loop.solve``, reduced to the contact dofs; methods are collective.

    Args:
        general: The general equations, with linear bulk and without floating bodies.
        prefix: Prefix of PETSc's options.
    """

    def __init__(self, general: ContactEquations, prefix: str) -> None:
        self._general, self._bulk, self._system = general, general.bulk, general.system
        self.remedies = general.remedies
        self._comm: MPI.Comm = self._bulk.comm
        self._dofs = ContactDofs(general.contacts, self._bulk)
        self._compliance = Compliance(self._bulk, self._dofs, prefix)
        self._inside: Flags = ~self._bulk.prescribed[: self._bulk.num_owned]
        self._inside[self._dofs.local] = False
        self._force: Array | None = None
        self._tangent: ReducedTangent | None = None

    def evaluate(self, *, start: bool) -> Status:
        """See ``ContactEquations``; after a step the residual follows from contact alone."""
        if start:
            self._force = None
            self._bulk.assemble_residual()
        return self._general.evaluate(start=start, by_contact=True)

    def advance(self) -> Step:
        """Solve the small system; move the surfaces and the prescribed dofs."""
        u, prescribed = self._bulk.u.x.array, self._bulk.prescribed_dofs
        change = self._bulk.distance_to_prescribed()
        with clock("solve"):
            without_contact = self._step_without_contact(change)
        with clock("assembly"):
            pair_rows = [contact.rows.linearized() for contact in self._general.contacts]
            matrices = self._assemble(pair_rows)
        with clock("solve"):
            step, self._force, zeta = self._solve(without_contact, pair_rows, matrices)
        moved = np.zeros_like(u)
        self._dofs.put(step, moved)
        moved[prescribed] = change
        fraction = 1.0
        if self._distorts(step):
            fraction = self._move_all(moved)
        else:
            u += moved
            self._balance(self._force)
        for contact, z_dofs in self._system.numbered():
            z = zeta[z_dofs] * self._system.scale(contact)
            contact.move(z, fraction, moved[: self._bulk.num_owned])
        return self._general.step(moved, fraction=fraction)

    def _distorts(self, step: Array) -> bool:
        """Whether a step may invert cells, by the relative motion of corners.

        Local, equal on all ranks.
        """
        for contact in self._general.contacts:
            for side in (contact.slave, contact.master):
                u = step[self._dofs.number(side.dofs)]
                if (side.distortions(u) > EQUATIONS.distortion).any():
                    return True
        return False

    def _move_all(self, moved: Array) -> float:
        """Apply the largest fraction of the step that no cell limits; return it [1] (collective).

        The next step begins with the remaining residual.

        Args:
            moved: Increments of contact dofs and prescribed ones.
        """
        u = self._bulk.u.x.array
        start = u.copy()
        u += moved
        self._find_inside()
        whole = (u - start)[: self._bulk.num_owned]
        u[:] = start
        self._bulk.u.x.scatter_forward()
        fraction = self._bulk.move(whole)
        self._bulk.assemble_residual()
        return fraction

    def _balance(self, force: Array) -> None:
        """Set the residual to that of contact forces alone, as after a full step (local)."""
        r, prescribed = self._bulk.r.array, self._bulk.prescribed_dofs
        r[self._inside] = 0.0
        kept = r[prescribed]
        self._dofs.put(-force, r)
        r[prescribed] = kept

    def _step_without_contact(self, change: Array) -> Array:
        """d_S (size,) [length] for a ``change`` of the prescribed values; complete on rank 0."""
        r = self._bulk.r.array_r[: self._bulk.num_owned]
        step = self._compliance.by_forces(-self._dofs.gather(r))
        rounding = self._general.residual.roundoff() / self._general.stiffest
        step += self._compliance.by_prescribed(change, rounding)
        rest = self._bulk.r.duplicate()
        rest.array[:] = np.where(self._inside, -r, 0.0)
        forces = self._bulk.to_force * rest.array_r
        if (
            np.sqrt(self._comm.allreduce(float(forces @ forces)))
            > self._general.residual.roundoff()
        ):
            step += self._dofs.gather(self._compliance.solve(rest).array_r)
        moved = np.zeros(self._bulk.num_owned)
        moved[self._bulk.prescribed_dofs] = change
        return np.where(self._dofs.free, step, 0.0) + self._dofs.gather(moved)

    def _assemble(self, pair_rows: Sequence[Rows]) -> ContactMatrices:
        """The matrices on the contact dofs, complete on rank 0."""
        system, size = self._system, self._dofs.size
        count = system.all_z_dofs
        return ContactMatrices(
            self._collect(system.force_derivative(), (size, size), (True, True)),
            self._collect(system.force_blocks(), (size, count), (True, False)),
            self._collect(system.law_blocks(pair_rows), (count, size), (False, True)),
            self._collect(system.multiplier_blocks(pair_rows), (count, count), (False, False)),
        )

    def _collect(
        self, blocks: Iterable[Block], shape: tuple[int, int], are_dofs: tuple[bool, bool]
    ) -> coo_array:
        """Gather blocks on rank 0; ``are_dofs``: whether rows and columns are global dofs."""
        *places, v = flatten(blocks)
        i, j = (self._dofs.number(p) if are else p for p, are in zip(places, are_dofs, strict=True))
        gathered = self._comm.gather((i, j, v)) or [(i, j, v)]
        i, j, v = (np.concatenate(column) for column in zip(*gathered, strict=True))
        inside = (i >= 0) & (j >= 0) & (v != 0.0)
        return coo_array((v[inside], (i[inside], j[inside])), shape=shape)

    def _solve(
        self, d: Array, pair_rows: Sequence[Rows], matrices: ContactMatrices
    ) -> tuple[Array, Array, Array]:
        """Step of the contact dofs, contact force and multipliers zeta (n,) (collective)."""
        rhs, weight = np.empty((2, self._system.all_z_dofs))
        for (contact, z_dofs), own in zip(self._system.numbered(), pair_rows, strict=True):
            rhs[z_dofs], weight[z_dofs] = own.rhs, 1.0 / contact.stiffness[:, None]
        solve = partial(self._solve_dense, d, matrices, rhs, weight)
        return on_first_rank(self._comm, solve)

    def _solve_dense(
        self, d: Array, matrices: ContactMatrices, rhs: Array, weight: Array
    ) -> tuple[Array, Array, Array]:
        """The solution, on rank 0.

        Unknowns are the multipliers that may act and the dofs in their rows and forces: if a row of
        the law has neither displacements nor a right-hand side, its multiplier is zero.
        """
        moved = self._system.with_others(np.concatenate([matrices.C.row, np.flatnonzero(rhs)]))
        some = np.concatenate([np.empty(0, np.int64), *(z_dofs.ravel() for z_dofs in moved)])
        some = np.intersect1d(some, matrices.B_T.col)
        return solve_dense(self._compliance.A, matrices, some, d, rhs, weight)

    def tangent(self) -> ReducedTangent:
        """Solves with the tangent by the factors of the bulk."""
        if self._tangent is None:
            at = self._bulk, self._system, self._dofs, self._compliance, self._assemble
            self._tangent = ReducedTangent(*at)
        return self._tangent

    def finish(self) -> None:
        """Compute the displacement inside the bodies."""
        if self._force is not None:
            self._find_inside()

    def _find_inside(self) -> None:
        """Balance the forces inside the bodies by their displacement (collective)."""
        assert self._force is not None
        self._bulk.u.x.scatter_forward()
        self._bulk.assemble_residual()
        with clock("solve"):
            rest = self._bulk.r.duplicate()
            force = np.zeros(self._bulk.num_owned)
            self._dofs.put(self._force, force)
            rest.array[:] = -(self._bulk.r.array_r[: self._bulk.num_owned] + force)
            self._bulk.u.x.array[: self._bulk.num_owned] += self._compliance.solve(rest).array_r
        self._bulk.u.x.scatter_forward()

    def seconds(self) -> dict[str, float]:
        """See ``ContactEquations``."""
        return self._general.seconds()

    def diagnose(self) -> str:
        """See ``ContactEquations``; computes the displacement inside the bodies first."""
        self.finish()
        return self._general.diagnose()


class LinearBulk:
    """Choice, before each solve, between all dofs and the contact dofs alone.

    Problems with driven obstacles, or with a body that only ties hold, whose K is singular, are
    solved on all dofs.

    Args:
        general: The general equations.
        requested: Whether to reduce. ``None``: if the residual is linear and the predicted cost of
            the compliance is below the past and future cost of iterations with all dofs, with no
            more memory, see ``la.options``. In space that of the dense systems counts as well,
            which the active nodes determine: all nodes, until they are known.
        prefix: Prefix of PETSc's options.

    Attributes:
        choice: The last choice and its reason, as text; "" if the bulk is not linear.
    """

    def __init__(self, general: ContactEquations, requested: bool | None, prefix: str) -> None:
        self._general, self._requested, self._prefix = general, requested, f"{prefix}{COMPLIANCE}"
        if requested and general.newton.damped:
            raise ValueError(
                "linear_bulk=True takes full steps: expected no line_search and max_motion, or "
                "linear_bulk=False"
            )
        linear = general.bulk.is_linear if requested is None else requested
        self._given = self._possible = linear and bool(general.contacts)
        self._costs = costs_of(general.bulk.space.dim)
        self._data: list[Array] = []
        self._equations: ReducedEquations | None = None
        self._num_iterations = 0
        self.choice = ""

    def choose(self) -> tuple[ReducedEquations | None, list[str]]:
        """The reduced equations, or ``None`` for all dofs; remarks (collective)."""
        if not self._possible:
            return None, []
        if self._general.newton.damped or self._general.motions.any_driven:
            damped = self._general.newton.damped
            why = "steps are damped" if damped else "motions are driven by forces"
            self.choice = f"linear bulk factored in every iteration: {why}"
            return None, []
        if self._data_changed():
            self._equations, self._num_iterations = None, 0
        if self._equations is not None and not (self._requested or self._iterates_faster()):
            self._equations = None  # many nodes have become active
        if self._equations is None and self._pays():
            obstacle = self._obstacle()
            if obstacle:
                self._possible = False
                self.choice = f"linear bulk factored in every iteration: {obstacle}"
                return None, [f"linear bulk, but {obstacle}: K is factored in every iteration"]
            try:
                with clock("solve"):
                    self._equations = ReducedEquations(self._general, self._prefix)
            except MortarError:  # singular: the solve on all dofs locates the cause
                if self._requested:
                    raise
                self.choice = "linear bulk factored in every iteration: its stiffness is singular"
                return None, []
            unused = self._general.system.solver.describe_unused(reduced=True)
            return self._equations, [unused]
        return self._equations, []

    def tangent(self) -> ReducedTangent | None:
        """Solves with the tangent by the present factors (collective).

        ``None`` if there are none, if constants or functions of the tangent have changed since, or
        if the residual is not recognized as linear.
        """
        if not self._general.bulk.is_linear:
            return None
        before = self._data
        changed = self._equations is None or self._data_changed()
        self._data = before
        return None if changed or self._equations is None else self._equations.tangent()

    def count(self, num_iterations: int) -> None:
        """Count iterations on all dofs (local)."""
        self._num_iterations += num_iterations

    def reset(self) -> None:
        """Discard the factors of the bulk (local)."""
        self._equations, self._data, self._num_iterations = None, [], 0
        self._possible = self._given

    @property
    def _dense_size(self) -> int:
        """Size of the dense systems: active nodes, about as many of the master, multipliers.

        All nodes with multipliers before the first solve on all dofs.
        """
        contacts = self._general.contacts
        nodes = [c.active if self._num_iterations else c.multiplier_nodes for c in contacts]
        sizes = [int(n.sum()) * c.slave.dim for n, c in zip(nodes, contacts, strict=True)]
        return 3 * sum(sizes)

    def _iterates_faster(self) -> bool:
        """Whether an iteration with the dense system is predicted to be the faster one (local)."""
        unknowns = self._general.bulk.r.getSize()
        return self._costs.dense_solves(self._dense_size, 1) <= self._costs.factors(unknowns, 1)

    def _pays(self) -> bool:
        """Whether to factorize once; sets ``choice`` (local)."""
        costs, unknowns = self._costs, self._general.bulk.r.getSize()
        dofs = sum(c.slave.dofs.size + c.master.dofs.size for c in self._general.contacts)
        iterations = self._num_iterations + costs.expected
        compliance = costs.compliance(unknowns, dofs)
        compliance += costs.dense_solves(self._dense_size, costs.expected)
        others, fits = costs.factors(unknowns, iterations), costs.fits(unknowns, dofs)
        if self._general.system.solver.multigrid is not None:
            others = min(others, costs.multigrid(unknowns, iterations))
        cheaper = compliance < others and self._iterates_faster()
        pays = bool(self._requested) or (fits and cheaper)
        if pays:
            self.choice = f"linear bulk factored once, Newton's method on {dofs} contact dofs"
        else:
            self.choice = f"linear bulk factored in every iteration: {dofs} contact dofs are many"
        self.choice += f" of {unknowns} unknowns"
        if self._requested:
            self.choice += " (linear_bulk=True)"
        else:
            memory = "" if fits else ", and its matrices would need more memory than factors"
            self.choice += (
                f" (predicted: once {compliance:.2g} s, {iterations} iterations with "
                f"all {others:.2g} s{memory})"
            )
        return pays

    def _obstacle(self) -> str:
        if self._general.motions.remote or self._general.motions.spread:
            return "there are remote loads"
        if any(contact.fluxes for contact in self._general.contacts):
            return "a scalar field flows across contact"
        floating = self._general.floating
        if floating.bodies:
            names = " and ".join(sorted(floating.name_of(body.label) for body in floating.bodies))
            return f"Dirichlet conditions leave {names} free to move"
        self._general.bulk.assemble_tangent()
        if any(isinstance(contact, Tie) for contact in self._general.contacts):
            parts = floating.parts, floating.num_parts
            if find_floating_bodies(self._general.bulk, *parts):
                return "ties alone hold a body"
        return "" if is_symmetric(self._general.bulk.K) else "its tangent is not symmetric"

    def _data_changed(self) -> bool:
        """Whether constants or functions of the tangent have changed since the last call."""
        before, self._data = self._data, self._general.bulk.tangent_data()
        same = len(before) == len(self._data) and all(map(np.array_equal, before, self._data))
        return self._general.comm.allreduce(not same, MPI.LOR)
