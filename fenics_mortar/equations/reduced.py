# SPDX-License-Identifier: MIT
"""Linear bulk with one factorization: Newton's method on the contact dofs alone.

``LinearBulk`` chooses, before each solve, between all equations and those reduced to the contact
dofs, ``ReducedEquations``. Their linear systems are dense, see ``solve_dense``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple, Self

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from fenics_mortar.bulk.bodies import find_floating_bodies
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.la.compliance import Compliance, ContactDofs
from fenics_mortar.la.options import COMPLIANCE, costs_of
from fenics_mortar.la.solver import LINEAR_TOLERANCE
from fenics_mortar.la.sparse import flatten, is_symmetric
from fenics_mortar.rigid.body_motions import names_of
from fenics_mortar.utils import compat, errors
from fenics_mortar.utils.clock import clock

if TYPE_CHECKING:
    from fenics_mortar.equations.general import ContactEquations
    from fenics_mortar.interface.mortar import Block
    from fenics_mortar.newton.loop import Status, Step
    from fenics_mortar.utils.arrays import Array, Flags, Indices


class ContactMatrices(NamedTuple):
    """Matrices on the contact dofs and n multipliers.

    Attributes:
        K_c: Derivative of forces with respect to displacements at fixed multipliers, (size, size).
        B_T: Derivative of forces with respect to multipliers, (size, n).
        C: Derivative of the multipliers' rows with respect to displacements, (n, size).
        A_z: Derivative of the multipliers' rows with respect to multipliers, (n, n); a block per
            node.
    """

    K_c: coo_array
    B_T: coo_array
    C: coo_array
    A_z: coo_array

    @property
    def transposed(self) -> Self:
        """The matrices of the transposed equations."""
        return type(self)(self.K_c.T, self.C.T, self.B_T.T, self.A_z.T)


def solve_dense(
    A: Array, matrices: ContactMatrices, some: Indices, d: Array, rhs: Array, weight: Array
) -> tuple[Array, Array, Array]:
    """Solve the dense system for some multipliers, the others being zero (local).

    Displacements and multipliers on the contact dofs satisfy

        u + A (K_c u + B^T z) = d,        C u + A_z z = h,

    with the displacement d without contact forces.

    Args:
        A: Compliance, symmetric, (size, size) [1 / stress].
        matrices: The matrices.
        some: Numbers of the multipliers, ascending.
        d: Displacements without contact forces, (size,) [length].
        rhs: Right-hand side h, (n,).
        weight: Factors of the rows of multipliers, (n,), for the norm of the error.

    Returns:
        Displacements and contact forces, (size,) each, multipliers, (n,).

    Raises:
        LinAlgError: If the system is singular.
    """
    K_c, B_T, C, A_z = matrices
    coupled = B_T.row[np.isin(B_T.col, some)]
    t = np.unique(np.concatenate([K_c.row, K_c.col, coupled, C.col[np.isin(C.row, some)]]))
    K_t, B_t, A_t = K_c.tocsr()[t][:, t], B_T.tocsr()[t][:, some], A[t]
    matrix = np.empty((t.size + some.size, t.size + some.size))
    upper, lower = np.split(matrix, [t.size])
    upper[:, : t.size] = (K_t.T @ A_t[:, t]).T  # A is symmetric
    upper[:, t.size :] = (B_t.T @ A_t[:, t]).T
    upper[np.diag_indices(t.size)] += 1.0
    lower[:, : t.size] = C.tocsr()[some][:, t].toarray()
    lower[:, t.size :] = A_z.tocsr()[some][:, some].toarray()
    lower *= weight[some, None]
    right = np.concatenate([d[t], weight[some] * rhs[some]])
    x = np.linalg.solve(matrix, right)
    defect = np.linalg.norm(matrix @ x - right)
    if not defect <= LINEAR_TOLERANCE * np.linalg.norm(right):
        raise np.linalg.LinAlgError("the solution has a defect")
    z, force = np.zeros(rhs.size), np.zeros(d.size)
    z[some] = x[t.size :]
    force[t] = K_t @ x[: t.size] + B_t @ z[some]
    return d - force[t] @ A_t, force, z


def solve_alone(A_z: coo_array, alone: Indices, rhs: Array) -> Array:
    """Solve for some multipliers that no others depend on, (n,); zero elsewhere (local).

    Args:
        A_z: See ``ContactMatrices``.
        alone: Numbers of their components, all of a node.
        rhs: Right-hand side, (n,).

    Raises:
        RuntimeError: If their equations are singular.
    """
    z = np.zeros(rhs.size)
    if alone.size:
        z[alone] = splu(A_z.tocsc()[alone][:, alone]).solve(rhs[alone])
    return z


class ReducedEquations:
    """Equations for ``newton.loop.solve``, and linear solves with their tangent, by factors of K.

    For constant symmetric K the displacement is linear in the contact forces q on the dofs S of the
    surfaces and in the prescribed values of the dofs H. After a full step the residual is r_S = -q
    and zero elsewhere, and the next step is

        dd_S = d_S - A (K_c dd + B^T z)_S,        C dd + A_z z = rhs,

    where d_S is the step without contact force and A = (K^-1)_SS the compliance, a dense matrix on
    rank 0. This small system is equivalent to the large one. The step without contact force is

        d_S = -A r_S - W^T (prescribed - present)_H - (K^-1 r_I)_S,      W = K_HF (K^-1)_FS,

    with the free dofs F and I = F without S. The last term is nonzero for new loads only. A is the
    inverse of the Schur complement of K on S. Products of W with earlier changes of prescribed
    values are stored; few of these are independent along a path. The displacement inside the bodies
    is computed at the end of Newton's method.

    All methods are collective.

    Args:
        general: The general equations, with linear bulk and without floating bodies.
        prefix: Prefix of PETSc's options.
    """

    def __init__(self, general: ContactEquations, prefix: str) -> None:
        self._general, self._system = general, general.system
        self.remedies, self.seconds = general.remedies, general.seconds
        self._bulk = bulk = general.bulk
        self._dofs = ContactDofs(general.contacts, bulk)
        self._compliance = Compliance(bulk, self._dofs, prefix)
        self._inside: Flags = ~bulk.prescribed[: bulk.num_owned]
        self._inside[self._dofs.local] = False
        rows = (bulk.prescribed_dofs + bulk.first).astype(PETSc.IntType)
        self._K_H = bulk.K.createSubMatrix(PETSc.IS().createGeneral(rows, bulk.comm))
        self._force: Array | None = None

    def evaluate(self, *, start: bool) -> Status:
        """Evaluate the present state; after a step the residual follows from contact alone."""
        if start:
            self._force = None
            self._bulk.assemble_residual()
        return self._general.evaluate(start=start, by_contact=True)

    def advance(self) -> Step:
        """Solve the small system; move the surfaces and the prescribed dofs."""
        bulk, change = self._bulk, self._bulk.distance_to_prescribed()
        self.assemble()
        with clock("solve"):
            d = self._step_without_contact(change)
            step, self._force, zeta = self._on_contact(d, [rows.rhs for rows in self._rows])
        moved = np.zeros_like(bulk.values)
        self._dofs.put(step, moved)
        moved[bulk.prescribed_dofs] = change
        fraction = 1.0
        if self._distorts(step):
            fraction = self._move_all(moved)
        else:
            bulk.values[:] += moved
            self._balance(self._force)
        for contact, values in zip(self._system.contacts, self._scaled(zeta), strict=True):
            contact.move(values, fraction, moved[: bulk.num_owned])
        return self._general.step(moved, fraction=fraction)

    def _distorts(self, step: Array) -> bool:
        """Whether a step may invert cells, by the relative motion of corners.

        Local, equal on all ranks.
        """
        return any(
            (side.distortions(step[self._dofs.number(side.dofs)]) > EQUATIONS.distortion).any()
            for contact in self._general.contacts
            for side in (contact.slave, contact.master)
        )

    def _move_all(self, moved: Array) -> float:
        """Apply the largest fraction of the step that no cell limits; return it [1] (collective).

        The next step begins with the remaining residual.

        Args:
            moved: Increments of contact dofs and prescribed ones.
        """
        u, bulk = self._bulk.values, self._bulk
        start = u.copy()
        u[:] += moved
        self.finish()
        whole = (u - start)[: bulk.num_owned]
        u[:] = start
        bulk.u.x.scatter_forward()
        fraction = bulk.move(whole)
        bulk.assemble_residual()
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
        bulk, rounding = self._bulk, self._general.residual.roundoff()
        f, moved = -bulk.r.array_r[: bulk.num_owned], np.zeros(bulk.num_owned)
        inside = (bulk.to_force * f)[self._inside]
        if bulk.comm.allreduce(float(inside @ inside)) <= rounding**2:
            f[self._inside] = 0.0
        moved[bulk.prescribed_dofs] = change
        by_values = self._compliance.by_prescribed(change, rounding / self._general.stiffest)
        return self._without_contact(f) + by_values + self._dofs.gather(moved)

    def _without_contact(self, f: Array) -> Array:
        """Displacements of the contact dofs under forces, (size,) [length]; complete on rank 0."""
        if self._bulk.comm.allreduce(bool(f[self._inside].any())):
            return self._dofs.gather(self._of_bulk(f))
        return self._compliance.by_forces(self._dofs.gather(f))

    def _of_bulk(self, f: Array) -> Array:
        """Displacements of the owned dofs under forces on the free ones, (owned dofs,) [length]."""
        force = self._bulk.r.duplicate()
        force.array[:] = f
        return np.array(self._compliance.solve(force).array_r)

    @clock("assembly")
    def assemble(self) -> None:
        """Assemble the matrices on the contact dofs, complete on rank 0, see ``LinearSystem``."""
        system, size, count = self._system, self._dofs.size, self._system.all_z_dofs
        self._rows = rows = [contact.rows.linearized() for contact in system.contacts]
        self._matrices = ContactMatrices(
            self._collect(system.force_derivative(), (size, size), (True, True)),
            self._collect(system.force_blocks(), (size, count), (True, False)),
            self._collect(system.law_blocks(rows), (count, size), (False, True)),
            self._collect(system.multiplier_blocks(rows), (count, count), (False, False)),
        )

    def _collect(
        self, blocks: Iterable[Block], shape: tuple[int, int], are_dofs: tuple[bool, bool]
    ) -> coo_array:
        """Gather blocks on rank 0; ``are_dofs``: whether rows and columns are global dofs."""
        *places, v = flatten(blocks)
        i, j = (self._dofs.number(p) if are else p for p, are in zip(places, are_dofs, strict=True))
        gathered = self._bulk.comm.gather((i, j, v)) or [(i, j, v)]
        i, j, v = (np.concatenate(column) for column in zip(*gathered, strict=True))
        inside = (i >= 0) & (j >= 0) & (v != 0.0)
        return coo_array((v[inside], (i[inside], j[inside])), shape=shape)

    def _on_contact(
        self, d: Array, h: Sequence[Array], *, transpose: bool = False
    ) -> tuple[Array, Array, Array]:
        """Displacements and contact forces (size,), multipliers zeta (n,).

        Args:
            d: Displacements without contact forces, (size,) [length]; complete on rank 0.
            h: Right-hand sides of the multipliers' rows, (slave nodes, c) each.
            transpose: Whether the equations are transposed.

        Raises:
            MortarError: On all ranks, if the system is singular.
        """
        comm, found = self._bulk.comm, None
        if comm.rank == 0:
            with suppress(np.linalg.LinAlgError, RuntimeError):
                found = self._solve_here(d, h, transpose)
        found = comm.bcast(found)
        if found is None:
            raise errors.MortarError("the reduced linear system is singular")
        return found

    def _solve_here(
        self, d: Array, h: Sequence[Array], transpose: bool
    ) -> tuple[Array, Array, Array]:
        """Solve on this rank; multipliers without displacements in their rows apart."""
        system, A, parts = self._system, self._compliance.A, self._matrices
        rhs, weight = np.empty((2, system.all_z_dofs))
        for (contact, z_dofs), values in zip(system.numbered(), h, strict=True):
            rhs[z_dofs], weight[z_dofs] = values, 1.0 / contact.stiffness[:, None]
        coupled = [z_dofs.ravel() for z_dofs in system.with_others(parts.C.row)]
        some = np.sort(np.concatenate([np.empty(0, np.int64), *coupled]))
        others = np.setdiff1d(np.arange(rhs.size), some)
        parts = parts.transposed if transpose else parts
        alone = solve_alone(parts.A_z, others, rhs)
        pushed = parts.B_T @ alone
        u, force, zeta = solve_dense(A, parts, some, d - A @ pushed, rhs, weight)
        alone = solve_alone(parts.A_z, others, rhs - parts.C @ u)
        return u, force + pushed, zeta + alone

    def _scaled(self, zeta: Array) -> list[Array]:
        """Multipliers of each contact times their scales (local)."""
        system = self._system
        return [zeta[z_dofs] * contact.components.scale for contact, z_dofs in system.numbered()]

    @clock("solve")
    def solve(self, b: Array, *, transpose: bool = False) -> Array:
        """Solve A x = b, or A^T x = b, as ``LinearSystem.solve`` [its units] (collective).

        The equations of ``linearized`` on the free dofs are

            K u + K_c u + B^T z = f - K_H u_H,        C u + A_z z = h.

        On the contact dofs they are the system of ``solve_dense``. One solve with K and the forces
        of its solution yields u elsewhere. The transposed equations have the same form: K_c^T
        replaces K_c, C^T replaces B^T, B replaces C, and A_z^T replaces A_z. The values at
        prescribed dofs are computed last.

        The dense system contains the multipliers with displacements in their rows, C. Multipliers
        of other nodes, most of them open, are computed separately: for A x = b before it, since
        they exert forces, and for A^T y = b after it, since they depend on the displacements.
        """
        system, prescribed = self._system, self._bulk.prescribed_dofs
        f, h = system.split(b)
        given, f[prescribed] = f[prescribed], 0.0
        known = np.zeros_like(f)
        if transpose:
            h = [values * c.components.scale for c, values in zip(system.contacts, h, strict=True)]
        else:
            known[prescribed] = given
            f -= compat.products(self._K_H, given[None], transpose=True)[0]
        d = self._without_contact(f) + self._dofs.gather(known)
        _, force, zeta = self._on_contact(d, h, transpose=transpose)
        forces = np.zeros_like(f)
        self._dofs.put(force, forces)
        u = self._of_bulk(f - forces) + known
        if not transpose:
            return system.join(u, self._scaled(zeta))
        u[prescribed] = given - compat.products(self._K_H, u[None])[0] - forces[prescribed]
        return system.join(u, [zeta[z_dofs] for z_dofs in system.z_dofs])

    def finish(self) -> None:
        """Balance the forces inside the bodies by their displacement."""
        if self._force is None:
            return
        bulk, forces = self._bulk, np.zeros(self._bulk.num_owned)
        bulk.u.x.scatter_forward()
        bulk.assemble_residual()
        self._dofs.put(self._force, forces)
        with clock("solve"):
            forces += bulk.r.array_r[: bulk.num_owned]
            bulk.values[: bulk.num_owned] -= self._of_bulk(forces)
        bulk.u.x.scatter_forward()

    def diagnose(self) -> str:
        """Describe what may be wrong, with the displacement inside the bodies; "" if nothing is."""
        self.finish()
        return self._general.diagnose()


class LinearBulk:
    """Choice, before each solve, between all equations and those reduced to the contact dofs.

    Problems with driven obstacles, or with a body that only ties hold, whose K is singular, are
    solved on all dofs.

    Args:
        general: The general equations.
        requested: Whether to reduce. ``None``: if the residual is linear and the predicted cost of
            the compliance is below the past and future cost of iterations with all dofs, with no
            more memory, see ``la.options``. In space the cost of the dense systems counts as well.
            It depends on the active nodes: all nodes, until they are known.
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
        damped = self._general.newton.damped
        if damped or self._general.motions.driven.any():
            self._say_refused("steps are damped" if damped else "motions are driven by forces")
            return None, []
        if self._data_changed():
            self._equations, self._num_iterations = None, 0
        if self._equations is not None and not (self._requested or self._iterates_faster()):
            self._equations = None  # many nodes have become active
        if self._equations is not None or not self._pays():
            return self._equations, []
        obstacle = self._obstacle()
        if obstacle:
            self._possible = False
            self._say_refused(obstacle)
            return None, [f"linear bulk, but {obstacle}: K is factored in every iteration"]
        try:
            with clock("solve"):
                self._equations = ReducedEquations(self._general, self._prefix)
        except errors.MortarError:  # singular: the solve on all dofs locates the cause
            if self._requested:
                raise
            self._say_refused("its stiffness is singular")
            return None, []
        return self._equations, [self._general.system.solver.describe_unused(reduced=True)]

    def _say_refused(self, why: str) -> None:
        """Set ``choice``, with the reason why all dofs are solved for (local)."""
        self.choice = f"linear bulk factored in every iteration: {why}"

    def tangent(self) -> ReducedEquations | None:
        """Solves with the tangent by the present factors (collective).

        ``None`` if there are none, if constants or functions of the tangent have changed since, or
        if the residual is not recognized as linear.
        """
        if not self._general.bulk.is_linear:
            return None
        before = self._data
        changed = self._equations is None or self._data_changed()
        self._data = before
        return None if changed else self._equations

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
        memory = "" if fits else ", and its matrices would need more memory than factors"
        predicted = f"once {compliance:.2g} s, {iterations} iterations with all {others:.2g} s"
        why = "linear_bulk=True" if self._requested else f"predicted: {predicted}{memory}"
        once = f"factored once, Newton's method on {dofs} contact dofs"
        how = once if pays else f"factored in every iteration: {dofs} contact dofs are many"
        self.choice = f"linear bulk {how} of {unknowns} unknowns ({why})"
        return pays

    def _obstacle(self) -> str:
        if self._general.motions.remote or self._general.motions.spread:
            return "there are remote loads"
        if any(contact.fluxes for contact in self._general.contacts):
            return "a scalar field flows across contact"
        floating = self._general.floating
        if floating.bodies:
            names = names_of(floating.bodies)
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
