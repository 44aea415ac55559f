# SPDX-License-Identifier: MIT
"""Linear solves with the tangent of all equations, or its transpose, at the present state.

The operator A is the derivative of these residuals with respect to displacement u, multipliers z
and places q of obstacles and remote loads, at fixed active sets and branches of the contact laws:

===============================  ================  =====================================  ==========
unknowns                         units             rows                                   units
===============================  ================  =====================================  ==========
u, free dofs                     length            forces of bodies and contact           stress
                                                   r + B^T z, r = f_int - f_ext           * length
u, dofs with prescribed values   length            u                                      length
z, multipliers of slave nodes    stress            rows of the contact law, as in         stress
                                                   ``Contact.rows``: blocks . u + A_z z   * length
q, driven motions                length, radian    forces and moment f_q of contact, in   stress
                                                   equilibrium with the push              * length,
                                                                                          * length^2
q, prescribed motions            length, radian    q                                      as q
===============================  ================  =====================================  ==========

The two rows of a slave node are Cartesian components. An active node has the row of its gap,
scaled by k_j / D_jj, along n, and the tangential row of the law, scaled by D_jj, along -tau; see
``contact.rows``. An open node has minus its nodal area times its multiplier, which exerts no force
on the bodies. A tied node has its jump, scaled by k_j / D_jj.

A does not contain the springs that regularize floating bodies and loose obstacles in Newton's
method. If contact leaves a rigid motion free, A is singular.

A change dR of the residuals changes the solution by -A^-1 dR. For a force f on the bodies this is
A^-1 f. The change of a prescribed displacement is the right-hand side of the row of its dof, the
change of a push that of the row of its motion. The gradient of a functional J with respect to a
parameter p is -y . dR/dp with A^T y = dJ/d(u, z, q) (adjoint method). For mixed functions u
contains all unknowns, each with its units and equations.

Solves with the tangent of a linear bulk that is factored once, or with its transpose.

With the stiffness K of the bodies, factored with the supports H prescribed, the equations of
``linearized`` on the free dofs are

    K u + K_c u + B^T z = f - K_H u_H,        C u + A_z z = h.

On the contact dofs they are the dense system of ``reduced_dense``. One solve with K and the forces
of its solution yields u. The transposed equations have the same form: K_c^T replaces K_c, C^T
replaces B^T, B replaces C, and A_z^T replaces A_z. The values at prescribed dofs are computed last.

The dense system contains the multipliers with displacements in their rows, C. Multipliers of other
nodes, most of them open, are computed separately: for A x = b before it, since they exert forces,
and for A^T y = b after it, since they depend on the displacements.

The dense system of a linear bulk: displacements of contact dofs and multipliers.

    u + A (K_c u + B^T z) = d,        C u + A_z z = h,

with the compliance A and the displacement d without contact forces; see ``reduced``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.sparse import coo_array, csr_array

from fenics_mortar.bulk.bodies import products
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.la.solver import LINEAR_TOLERANCE
from fenics_mortar.rigid.driven import border_of
from fenics_mortar.rigid.spread import solve_bordered
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import MortarError, check_kind, check_same, together

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.rows import Rows
    from fenics_mortar.la.compliance import Compliance, ContactDofs
    from fenics_mortar.la.system import LinearSystem
    from fenics_mortar.utils.arrays import Array, Indices


@dataclass(frozen=True)
class LinearVector:
    """Right-hand side or solution of ``ContactProblem.linear_solve``.

    A solution of the tangent has the units of the unknowns, a right-hand side those of the rows;
    with the transpose it is the other way round, over the unit of the functional. The scaling of
    the rows is that of ``equations.linearized``.

    Attributes:
        u: Values of the owned dofs in the order of dolfinx, shape (owned dofs,): displacements
            [length]; in rows forces [stress length], at prescribed dofs displacements [length].
            ``None``: zero.
        z: Components at the slave nodes of each pair, in the order of the surface, shape (slave
            nodes, 2), in space (slave nodes, 3) each, replicated: multipliers [stress]; in rows
            those of the contact law [stress length]. Tied fields have further columns [flux].
            ``None``: zero.
        q: x, y and angle of the m obstacles and remote loads, in the order of
            ``problem.obstacles`` and of the argument ``remote``, shape (m, 3), replicated [length,
            length, radian], in space (m, 6) with spins as rotations; in rows of driven motions
            forces and moments [stress length, stress length^2]. ``None``: zero.
    """

    u: Array | None = None
    z: Sequence[Array] | None = None
    q: Array | None = None

    def __add__(self, other: LinearVector) -> LinearVector:
        """Sum of two vectors; parts that are ``None`` in both remain ``None`` (local)."""
        alike = None
        if self.z is not None and other.z is not None:
            alike = [a + b for a, b in zip(self.z, other.z, strict=True)]
        z = alike or self.z or other.z
        return LinearVector(_sum(self.u, other.u), z, _sum(self.q, other.q))

    def __mul__(self, factor: float) -> LinearVector:
        """Product with a number (local)."""
        z = None if self.z is None else [factor * values for values in self.z]
        u, q = (None if part is None else factor * part for part in (self.u, self.q))
        return LinearVector(u, z, q)

    def dot(self, other: LinearVector, comm: MPI.Comm) -> float:
        """Scalar product with another vector, each entry counted once (collective).

        Args:
            other: The other vector.
            comm: Communicator of the mesh.

        Returns:
            The sum [product of the units of both], equal on all ranks.
        """
        pairs = [(self.q, other.q), *zip(self.z or (), other.z or (), strict=False)]
        alike = sum(float(np.vdot(a, b)) for a, b in pairs if a is not None and b is not None)
        mine = 0.0 if self.u is None or other.u is None else float(self.u @ other.u)
        return comm.allreduce(mine) + alike


def _sum(one: Array | None, other: Array | None) -> Array | None:
    """Sum of two arrays; ``None`` is zero (local)."""
    if one is None or other is None:
        return other if one is None else one
    return one + other


# Largest number of solves with a tangent that has smaller conductances [1]. Errors of the equations
# with the present ones, finite or not, decrease by 0.01 to 0.001 in each: ``contact.fluxes.SOFT``.
SOLVES = 8
# Relative change of the bodies' unknowns in the last of these solves [1]: rounding.
LAST_CHANGE = 1e-15


class LinearizedEquations:
    """A at the last evaluated state, factorized in the first solve; all methods are collective.

    Valid until the next Newton iteration, since matrix and factors are those of the problem.

    Args:
        equations: The ``ContactEquations``, evaluated.
    """

    def __init__(self, equations: Any) -> None:
        bulk, motions, tangent = equations.bulk, equations.motions, equations.reduced_tangent()
        self._bulk, self._contacts, self._system = bulk, equations.contacts, equations.system
        self._motions = motions
        self._tangent: LinearSystem | ReducedTangent = tangent or self._system
        self._shape, self._driven = motions.scales.shape, motions.unknowns
        if tangent is None:
            bulk.assemble_tangent()
            for load in motions.remote:
                load.take_bulk_rows()
        with self._softened():
            self._tangent.assemble()
        border, extra = border_of(motions, self._system), np.ones(motions.num_of_spread)
        raise_stored(bulk.comm, self._contacts)
        self._border = border.scaled(np.append(motions.scales.ravel(), extra))

    @contextmanager
    def _softened(self) -> Iterator[None]:
        """Within, large conductances are replaced by smaller ones, see ``contact.fluxes``."""
        with ExitStack() as stack:
            for contact in self._contacts:
                for flux in contact.fluxes:
                    stack.enter_context(flux.softened())
            yield

    def solve(self, rhs: LinearVector, *, transpose: bool = False) -> LinearVector:
        """Solve A x = rhs, or A^T x = rhs; see ``ContactProblem.linear_solve``."""
        with self._softened():
            found = change = self._solved(rhs, transpose)
            fluxes = [(i, flux) for i, c in enumerate(self._contacts) for flux in c.fluxes]
            stiff = [(i, flux, np.zeros(len(flux.cells))) for i, flux in fluxes if flux.exceeds]
            for _ in range(SOLVES - 1 if stiff else 0):
                change = self._solved(self._remainder(change, stiff, transpose), transpose)
                found = found + change
                if self._norm(change) <= LAST_CHANGE * self._norm(found):
                    break
            return found

    def _norm(self, solution: LinearVector) -> float:
        """Norm of the unknowns of the bodies [their unit], equal on all ranks (collective)."""
        return float(
            np.sqrt(LinearVector(solution.u).dot(LinearVector(solution.u), self._bulk.comm))
        )

    def _remainder(self, change: LinearVector, fluxes: Any, transpose: bool) -> LinearVector:
        """Right-hand side of the next change, by conductances above that of the tangent.

        Args:
            change: The last change, at first the first solution.
            fluxes: Contact, flux and its last change d, see ``Flux.remainder``, changed in place.
            transpose: Whether the equations are transposed.
        """
        assert change.u is not None and change.z is not None and change.q is not None
        u, y = np.zeros_like(change.u), change.u.copy()
        z, q = [np.zeros_like(part) for part in change.z], np.zeros_like(change.q)
        y[self._bulk.prescribed_dofs] = 0.0
        for i, flux, d in fluxes:
            obstacle = self._contacts[i].obstacle
            mover = None if obstacle is None else self._motions.obstacles.index(obstacle)
            if not transpose:
                motion = np.zeros(0) if mover is None else (change.q * self._motions.scales)[mover]
                u += flux.remainder(change.u, change.z[i], motion, d)
                continue
            on_bodies, of_z, motion = flux.transposed_remainder(y, d)
            u, z[i] = u + on_bodies, z[i] + of_z
            if mover is not None:
                q[mover] += motion * self._motions.scales[mover]
        if not transpose:
            u[self._bulk.prescribed_dofs] = 0.0
        return LinearVector(u, z, q)

    def _solved(self, rhs: LinearVector, transpose: bool) -> LinearVector:
        """One solve, see ``solve``."""
        b, c = self._read(rhs)
        solve = self._solve_transposed if transpose else self._solve
        x, q = solve(b, np.append(c, np.zeros(self._driven.size - c.size)))
        u, z = self._system.split(x)
        return LinearVector(u, z, q[: c.size].reshape(self._shape))

    def _solve(self, b: Array, c: Array) -> tuple[Array, Array]:
        """Solve A [x, q] = [b, c]; prescribed motions are eliminated first."""
        driven, border, q = self._driven, self._border, c.copy()
        given = c[~driven]
        x = self._tangent.solve(b - given @ border.columns[~driven])
        balance = c[driven] - border.corner[np.ix_(driven, ~driven)] @ given
        x, q[driven] = solve_bordered(
            self._tangent.solve, border.restricted_to(driven), x, balance, self._bulk.comm
        )
        return x, q

    def _solve_transposed(self, b: Array, c: Array) -> tuple[Array, Array]:
        """Solve A^T [x, q] = [b, c]; prescribed motions are computed last."""
        driven, border, q = self._driven, self._border, c.copy()

        def solve(rhs: Array) -> Array:
            return self._tangent.solve(rhs, transpose=True)

        x, q[driven] = solve_bordered(
            solve, border.restricted_to(driven).transposed, solve(b), c[driven], self._bulk.comm
        )
        coupled = self._bulk.comm.allreduce(border.columns[~driven] @ x)
        q[~driven] = c[~driven] - coupled - q[driven] @ border.corner[np.ix_(driven, ~driven)]
        return x, q

    def _read(self, rhs: LinearVector) -> tuple[Array, Array]:
        """The right-hand side as a vector of the system, and values for the motions.

        Raises:
            ValueError: On all ranks, if shape or type is wrong.
            MortarError: On all ranks, if z or q differ between ranks.
        """
        with together(self._bulk.comm, "linear_solve"):
            check_kind("rhs", rhs, LinearVector, "a LinearVector")
            u = _checked("u", rhs.u, (self._bulk.num_owned,))
            if rhs.z is not None and len(rhs.z) != len(self._contacts):
                raise ValueError(
                    f"z has values of {len(rhs.z)} pairs: expected {len(self._contacts)}"
                )
            none: list[Array | None] = [None] * len(self._contacts)
            given: Sequence[Array | None] = none if rhs.z is None else rhs.z
            shapes = [contact.z.shape for contact in self._contacts]
            z = [_checked("z", values, shape) for values, shape in zip(given, shapes, strict=True)]
            q = _checked("q", rhs.q, self._shape)
        check_same(self._bulk.comm, [*(("z", values) for values in z), ("q", q)])
        return self._system.join(u, z), q.ravel()


def _checked(name: str, values: Array | None, shape: tuple[int, ...]) -> Array:
    """Values as floats of the given shape, zero by default (local)."""
    if values is None:
        return np.zeros(shape)
    values = np.asarray(values, float)
    if values.shape != shape:
        raise ValueError(f"{name} has the shape {values.shape}: expected {shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} is not finite: expected numbers")
    return values


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


def on_first_rank(comm: MPI.Comm, solve: Callable[[], Any]) -> Any:
    """The result of a dense solve on rank 0, on all ranks (collective).

    Raises:
        MortarError: On all ranks, if the system is singular.
    """
    found = None
    if comm.rank == 0:
        with suppress(np.linalg.LinAlgError):
            found = solve()
    found = comm.bcast(found)
    if found is None:
        raise MortarError("the reduced linear system is singular")
    return found


def solve_dense(
    A: Array, matrices: ContactMatrices, some: Indices, d: Array, rhs: Array, weight: Array
) -> tuple[Array, Array, Array]:
    """Solve the dense system for some multipliers, the others being zero (local).

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
    K_t, B_t, A_t = _part(K_c, t, t), _part(B_T, t, some), A[t]
    matrix = np.empty((t.size + some.size, t.size + some.size))
    upper, lower = np.split(matrix, [t.size])
    upper[:, : t.size] = (K_t.T @ A_t[:, t]).T  # A is symmetric
    upper[:, t.size :] = (B_t.T @ A_t[:, t]).T
    upper[np.diag_indices(t.size)] += 1.0
    lower[:, : t.size] = _part(C, some, t).toarray()
    lower[:, t.size :] = _part(A_z, some, some).toarray()
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


def solve_alone(A_z: coo_array, alone: Sequence[Indices], rhs: Array) -> Array:
    """Solve the blocks of nodes with uncoupled multipliers, (n,); zero elsewhere (local).

    Args:
        A_z: See ``ContactMatrices``.
        alone: Numbers of the components of these multipliers, (nodes, c) for each pair.
        rhs: Right-hand side, (n,).

    Raises:
        LinAlgError: If a block is singular.
    """
    z = np.zeros(rhs.size)
    for z_dofs in alone:
        node, component = np.full((2, rhs.size), -1)
        node[z_dofs], component[z_dofs] = np.indices(z_dofs.shape)
        here = node[A_z.row] >= 0
        i, j, blocks = A_z.row[here], A_z.col[here], np.zeros((*z_dofs.shape, z_dofs.shape[1]))
        np.add.at(blocks, (node[i], component[i], component[j]), A_z.data[here])
        z[z_dofs] = np.linalg.solve(blocks, rhs[z_dofs][:, :, None])[..., 0]
    return z


def _part(matrix: coo_array, rows: Indices, columns: Indices) -> csr_array:
    """Submatrix of ascending rows and columns (local)."""
    i, j = np.full(matrix.shape[0], -1), np.full(matrix.shape[1], -1)
    i[rows], j[columns] = np.arange(rows.size), np.arange(columns.size)
    row, column = i[matrix.row], j[matrix.col]
    inside = (row >= 0) & (column >= 0)
    entries = matrix.data[inside], (row[inside], column[inside])
    return csr_array(entries, shape=(rows.size, columns.size))


class ReducedTangent:
    """The tangent of displacement and multipliers by factors of the bulk; methods are collective.

    Args:
        bulk: The bodies; their tangent is constant.
        system: System of displacements and multipliers, for numbers and scales.
        dofs: The contact dofs.
        compliance: Factors of the bulk.
        collect: Function that assembles ``ContactMatrices``, with scaled multipliers, from the rows
            of all contacts.
    """

    def __init__(
        self,
        bulk: Bulk,
        system: LinearSystem,
        dofs: ContactDofs,
        compliance: Compliance,
        collect: Callable[[Sequence[Rows]], ContactMatrices],
    ) -> None:
        self._bulk, self._system, self._dofs = bulk, system, dofs
        self._compliance, self._collect = compliance, collect
        self._away = ~bulk.prescribed[: bulk.num_owned]
        self._away[dofs.local] = False
        bulk.assemble_tangent()  # a step on all dofs may have added contact terms
        rows = (bulk.prescribed_dofs + bulk.first).astype(PETSc.IntType)
        self._K_H = bulk.K.createSubMatrix(PETSc.IS().createGeneral(rows, bulk.comm))

    @clock("assembly")
    def assemble(self) -> None:
        """See ``LinearSystem``."""
        self._parts = self._collect([c.rows.linearized() for c in self._system.contacts])
        self._coupled = self._system.with_others(self._parts.C.row)

    @clock("solve")
    def solve(self, b: Array, *, transpose: bool = False) -> Array:
        """See ``LinearSystem``."""
        prescribed = self._bulk.prescribed_dofs
        f, h = self._system.split(b)
        given, f[prescribed] = f[prescribed], 0.0
        if transpose:
            u, forces, z = self._solve(f, self._scaled(h), self._parts.transposed)
            u[prescribed] = given - products(self._K_H, u[None])[0] - forces[prescribed]
            return self._system.join(u, z)
        known = np.zeros_like(f)
        known[prescribed] = given
        by_given = products(self._K_H, given[None], transpose=True)[0]
        u, _, z = self._solve(f - by_given, h, self._parts, known)
        return self._system.join(u, self._scaled(z))

    def _solve(
        self, f: Array, h: Sequence[Array], matrices: ContactMatrices, known: Array | None = None
    ) -> tuple[Array, Array, list[Array]]:
        """Displacements and contact forces of the owned dofs, multipliers of the contacts.

        Args:
            f: Forces, owned dofs [stress length]; those on prescribed dofs are not used.
            h: Right-hand sides of the multipliers' rows, (slave nodes, 2) each.
            matrices: Matrices, complete on rank 0.
            known: Prescribed values, zero at free dofs, owned dofs [length]; zero by default.
        """
        d = self._without_contact(f)
        if known is not None:
            d = d + self._dofs.gather(known)
        force, zeta = on_first_rank(self._bulk.comm, partial(self._on_contact, d, h, matrices))
        forces = np.zeros_like(f)
        self._dofs.put(force, forces)
        u = self._of_bulk(f - forces)
        if known is not None:
            u += known
        return u, forces, [zeta[z_dofs] for z_dofs in self._system.z_dofs]

    def _without_contact(self, f: Array) -> Array:
        """Displacements of the contact dofs under forces, (size,) [length]; complete on rank 0."""
        if self._bulk.comm.allreduce(bool(f[self._away].any())):
            return self._dofs.gather(self._of_bulk(f))
        return self._compliance.by_forces(self._dofs.gather(f))

    def _on_contact(
        self, d: Array, h: Sequence[Array], matrices: ContactMatrices
    ) -> tuple[Array, Array]:
        """Contact forces (size,) and multipliers (n,), see ``solve_dense`` (local)."""
        A, (rhs, weight) = self._compliance.A, np.empty((2, self._system.all_z_dofs))
        for (contact, z_dofs), values in zip(self._system.numbered(), h, strict=True):
            rhs[z_dofs], weight[z_dofs] = values, 1.0 / contact.stiffness[:, None]
        coupled = [z_dofs.ravel() for z_dofs in self._coupled]
        some = np.sort(np.concatenate([np.empty(0, np.int64), *coupled]))
        others = self._system.with_others(np.setdiff1d(np.arange(rhs.size), some))
        alone = solve_alone(matrices.A_z, others, rhs)
        pushed = matrices.B_T @ alone
        u, force, z = solve_dense(A, matrices, some, d - A @ pushed, rhs, weight)
        alone = solve_alone(matrices.A_z, others, rhs - matrices.C @ u)
        return force + pushed, z + alone

    def _of_bulk(self, f: Array) -> Array:
        """Displacements of the owned dofs under forces on the free ones, (owned dofs,) [length]."""
        force = self._bulk.r.duplicate()
        force.array[:] = f
        return np.array(self._compliance.solve(force).array_r)

    def _scaled(self, z: Sequence[Array]) -> list[Array]:
        """Values of each contact times the scale of its multipliers (local)."""
        scales = map(self._system.scale, self._system.contacts)
        return [values * scale for values, scale in zip(z, scales, strict=True)]
