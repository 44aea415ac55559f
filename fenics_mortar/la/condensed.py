# SPDX-License-Identifier: MIT
"""Condensed system (Alg. 2), multipliers eliminated node by node, and the choice of the system.

If D is diagonal, the slave rows S of an acting multiplier give z_j = Z_j (f - K~ dd)_j with
Z_j = P_j / D_jj, where P_j removes prescribed components (eq. 14). Inserted into the system of
``system``, with right-hand sides f of the bodies and h of the laws, this yields

    (Q K~ + C) dd = Q f + h,       Q = 1 - B^T Z - A_z Z,

whose slave rows then contain the contact law. Only rows of contact nodes differ from those of K~:
with its slave rows K_S and Q = 1 + R,

    Q K~ + C = K~ + R K_S + C,

which in the plane is added to K in place, at a cost proportional to these rows; in space to a copy.

Components of multipliers with Z = 0 (nodes that do not act, prescribed components on symmetry
planes) have rows A_z z = h without displacements and with a diagonal A_z. They are solved first,
and their forces B^T z are subtracted from f.

The transposed system, with right-hand sides a of the displacements and b of the multipliers, is
solved by the steps in reverse order: with t = Z^T b,

    (Q K~ + C)^T w = a - K_S^T t,    y = t + Q^T w,    multipliers of the laws: w in the slave rows,

and components with Z = 0 from A_z^T w = b - B y. Rows of prescribed dofs are those of the identity:
y = w there, and they do not contribute to Q^T w.

The matrix R is stored by its entries, see ``ContactColumns``.

``system_of`` chooses this system or the saddle point of ``system``, and a direct or iterative
solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
from scipy.sparse import csr_array

from fenics_mortar.contact.rows import Rows
from fenics_mortar.kernels.blocks import gather_forces
from fenics_mortar.la import sparse
from fenics_mortar.la.coupling import zero_block
from fenics_mortar.la.options import SMALL, Algorithm, SolverName, costs_of, iterative
from fenics_mortar.la.system import LinearSystem, SaddleSystem, renumbered
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import Array, summed
from fenics_mortar.utils.clock import clock

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.mortar import Block
    from fenics_mortar.la.sparse import Entries


class ContactColumns:
    """A matrix with a row for each contact dof and a column for each multiplier, as R.

    R has a row for every contact dof and a column for every multiplier. Each rank keeps the columns
    of its own multipliers, since it owns the corresponding slave rows of K; rows are those of all
    ranks. R has few entries, and their pattern changes in half of the iterations: PETSc would spend
    more time on patterns than on values.

    Args:
        system: Numbering of the multipliers.
        rows: The contact dofs.
        entries: Numbers of contact dofs, of multiplier components of any rank, and values [1];
            those of all ranks are summed.

    Attributes:
        entries: Rows, columns and values of the entries [1] in the columns of this rank.
    """

    def __init__(self, system: LinearSystem, rows: sparse.SomeRows, entries: Entries) -> None:
        self._comm, self._rows, self._size = system.comm, rows, system.num_z_dofs
        first, (i, j, v) = system.first_z_dof, entries
        if self._comm.size > 1:
            mine = (j >= first) & (j < first + self._size)
            parts = [(i[mine], j[mine], v[mine])]
            for others, columns, values in self._comm.allgather((i[~mine], j[~mine], v[~mine])):
                here = (columns >= first) & (columns < first + self._size)
                parts.append((others[here], columns[here], values[here]))
            i, j, v = (np.concatenate(part) for part in zip(*parts, strict=True))
        self.entries: Entries = i, j - first, v

    def times(self, values: Array) -> Array:
        """R x [unit of x] in the owned contact dofs, for ``values`` x of this rank (collective)."""
        i, j, v = self.entries
        product = summed(v * values[j], i, self._rows.rows.size)
        if self._comm.size > 1:
            product = ranks.sum_over_ranks(self._comm, product)
        return product[self._rows.numbers]

    def transposed_times(self, values: Array) -> Array:
        """R^T w [unit of w], for ``values`` w of the owned contact dofs (collective)."""
        everywhere = np.zeros(self._rows.rows.size)
        everywhere[self._rows.numbers] = values
        everywhere = ranks.sum_over_ranks(self._comm, everywhere)
        i, j, v = self.entries
        return summed(v * everywhere[i], j, self._size)


class CondensedSystem(LinearSystem):
    """System of displacements only, for D that can be inverted node by node.

    In the plane assembly adds to the bulk's ``K``, which is assembled again before the next one; in
    space the matrix is a new one.

    Raises:
        ValueError: On all ranks, if D is not diagonal; see ``obstacle_to_condensation``.
    """

    has_multipliers = False

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any]
    ) -> None:
        super().__init__(bulk, contacts, prefix, options)
        obstacle = obstacle_to_condensation(contacts)
        if obstacle:
            raise ValueError(f"algorithm='condensed': {obstacle}; use algorithm='saddle'")
        size = bulk.num_owned
        touched = [side.dofs.ravel() for c in contacts for side in (c.slave, c.master)]
        touched += [flux.dofs for c in contacts for flux in c.fluxes]
        self._rows = sparse.SomeRows(
            np.concatenate([np.empty(0, np.int64), *touched]), bulk.first, size
        )
        self._rows_of_sides = [
            [self._rows.number(side.dofs) for side in (c.slave, c.master)] for c in contacts
        ]
        self._R: ContactColumns
        self._slave_K: Any = None
        dofs = np.empty(self.num_z_dofs, np.int64)
        for contact, _, owned, local in self._numbered:
            dofs[local] = contact.components.dofs[owned]
        self._slave_rows = PETSc.IS().createGeneral(dofs.astype(PETSc.IntType), self.comm)
        self._slave_dofs = dofs - bulk.first
        self._partly_prescribed = any((c.free[c.multiplier_nodes] == 0.0).any() for c in contacts)

    # Assembly

    @clock("assembly")
    def assemble(self) -> None:
        """Build K_c + R K_S + C + K (collective)."""
        pair_rows, inverses = list[Rows](), list[Array]()
        for contact in self.contacts:
            pair_rows.append(contact.rows.linearized())
            inverses.append(contact.components.inverse)
        entries = self._R_entries(pair_rows, inverses)
        if self.bulk.space.dim == 2 and self._update_pattern():
            self._extend_pattern(entries)
        self._R = ContactColumns(self, self._rows, entries)
        build = self._add_to_tangent if self.bulk.space.dim == 2 else self._without_pattern
        slave_dofs = [contact.components.dofs for contact in self.contacts]
        self.matrix = build(self.law_blocks(pair_rows, slave_dofs))
        self._collect_rows(pair_rows, inverses)
        self._prescribe_rows(self.matrix, self.bulk.first)

    def _add_to_tangent(self, C: list[Block]) -> PETSc.Mat:
        """The matrix in place of K, whose pattern has all entries (collective)."""
        K = self.bulk.tangent_to_change()
        sparse.add_blocks(K, self.force_derivative())
        self._slave_K = K.createSubMatrix(self._slave_rows, None, self._slave_K)
        sparse.add_blocks(K, C, self._product(self._slave_K.getValuesCSR()))
        return K

    def _without_pattern(self, C: list[Block]) -> PETSc.Mat:
        """The matrix beside K, with the entries of the present state only (collective)."""
        K, size = self.bulk.K, self.bulk.num_dofs
        self._free_matrix(K)
        bounds = K.getOwnershipRanges()
        K_c = sparse.summed_rows(
            self.comm, bounds, [sparse.packed(self.force_derivative(), None, size)]
        )
        of_bulk, shape = K.createSubMatrix(self._slave_rows), (self.num_z_dofs, size)
        starts, columns, values = of_bulk.getValuesCSR()
        of_contact = csr_array(K_c[::-1], shape=(self.bulk.num_owned, size))[self._slave_dofs]
        slave_K = csr_array((values, columns, starts), shape=shape) + of_contact
        indices = (part.astype(PETSc.IntType) for part in (slave_K.indptr, slave_K.indices))
        csr = *indices, slave_K.data
        for matrix in (of_bulk, self._slave_K):
            if matrix is not None:
                matrix.destroy()
        del columns, values, of_contact
        sizes = (self.num_z_dofs, None), (self.bulk.num_owned, None)
        self._slave_K = PETSc.Mat().createAIJ(sizes, csr=csr, comm=self.comm)
        rest = sparse.packed(C, self._product(csr), size)
        change = sparse.summed_rows(
            self.comm, bounds, [sparse.packed_rows(K_c, self.bulk.first), rest]
        )
        return sparse.with_rows(K, change)

    def _product(self, slave_csr: tuple[Any, ...]) -> sparse.Product:
        """R K_S, given the rows K_S of this rank."""
        starts, columns, values = slave_csr
        return sparse.Product(self._R.entries, (starts, columns, values), self._rows.rows)

    def _collect_rows(self, pair_rows: Sequence[Rows], inverses: Sequence[Array]) -> None:
        """Diagonals of Z and A_z and right-hand sides of the multipliers owned here (local)."""
        Z, A_z, rhs = np.zeros((3, self.num_z_dofs))
        for (_, _, owned, local), rows, inverse in zip(
            self._numbered, pair_rows, inverses, strict=True
        ):
            Z[local], rhs[local] = inverse[owned], rows.rhs[owned]
            A_z[local] = rows.A_z.diagonal(axis1=1, axis2=2)[owned]
        self._Z, self._A_z, self._law_rhs = Z, A_z, rhs

    def _extend_pattern(self, R_entries: Entries) -> None:
        """Extend the pattern of K by zeros for possible contact (collective)."""
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        rows, size = self._rows, self.bulk.num_owned
        of_slave = rows.number(self._slave_rows.indices).astype(PETSc.IntType)
        zeros_of_K = rows.renumbered(self.derivative_zeros())
        small = sparse.BlockMatrix(self.comm, rows.local.size, size).assemble(zeros_of_K)
        slave_K = self.bulk.K.createSubMatrix(self._slave_rows)
        of_small = small.createSubMatrix(PETSc.IS().createGeneral(of_slave, self.comm))
        slave_K.axpy(1.0, of_small, different)
        all_of_R = map(np.append, R_entries, sparse.flatten(rows.renumbered(self._R_zeros())))
        R = sparse.BlockMatrix(self.comm, rows.local.size, self.num_z_dofs).assemble_entries(
            *all_of_R
        )
        product = R.matMult(slave_K)
        small.axpy(1.0, product, different)
        zeros = rows.zeros(small, size)
        self.bulk.extend_tangent(zeros)
        for matrix in (small, slave_K, of_small, R, product, zeros, self._slave_K):
            if matrix is not None:
                matrix.destroy()
        self._slave_K = None
        self.solver.reset_pattern()

    def _R_entries(self, pair_rows: Sequence[Rows], inverses: Sequence[Array]) -> Entries:
        """R = -B^T Z - A_z Z in rows of contact nodes; columns are numbers of components."""
        num_entries = sum(c.operators.D.size + c.operators.M.size for c in self.contacts)
        size = self.bulk.space.dim * (self.num_z_dofs + num_entries)
        i, j = np.empty((2, size), PETSc.IntType)
        v, end = np.empty(size), 0
        for (contact, z_dofs, owned, _), (on_slave, on_master), rows, Z in zip(
            self._numbered, self._rows_of_sides, pair_rows, inverses, strict=True
        ):
            o, s = contact.operators, contact.operators.segments
            end += gather_forces(
                o.D, o.facet_nodes, on_slave, o.M, s.slave, s.master, on_master, Z, rows.A_z, owned,
                contact.acts, z_dofs, i[end:], j[end:], v[end:],
            )  # fmt: skip
        i, j, v = i[:end], j[:end], v[:end]
        for (contact, z_dofs), Z in zip(self.numbered(), inverses, strict=True):
            if contact.fluxes:
                blocks = renumbered((flux.by_multipliers() for flux in contact.fluxes), z_dofs, -Z)
                i, j, v = map(np.append, (i, j, v), sparse.flatten(self._rows.renumbered(blocks)))
        return i, j, v

    def _R_zeros(self) -> Iterator[Block]:
        """Zeros for possible entries of R."""
        for (contact, z_dofs), coupling in zip(self.numbered(), self._couplings, strict=True):
            patterns = [coupling.force_pattern()]
            patterns += [coupling.flux_force_pattern(flux) for flux in contact.fluxes]
            for rows, multipliers in patterns:
                yield zero_block(rows, z_dofs[multipliers, : contact.slave.dim])

    # Solution

    def step(self, distance: Array) -> Array:
        """Increment and new multipliers of a Newton iteration, as one vector (collective).

        In the units of ``LinearSystem``, see ``LinearSystem.step``; rows with Z = 0 have a zero
        right-hand side.
        """
        return self._eliminate(self._newton_force(distance), self._law_rhs)

    def solve(self, b: Array, *, transpose: bool = False) -> Array:
        """Solve with the condensed system; see ``LinearSystem.solve`` (collective)."""
        f, h = np.split(b, [self.bulk.num_owned])
        return self._solve_transposed(f, h) if transpose else self._solve_whole(f, h)

    def _solve_whole(self, f: Array, h: Array) -> Array:
        """Solve A x = [f, h], components with Z = 0 included (collective)."""
        left_out = self._solve_left_out(h)
        if self._partly_prescribed:
            forces = np.zeros_like(f)
            forces[self._rows.local] = self._prescribed_columns().times(left_out)
            forces[self.bulk.prescribed_dofs] = 0.0
            f = f - forces
        x = self._eliminate(f, np.where(self._Z == 0.0, 0.0, h))
        x[self.bulk.num_owned :] += left_out
        return x

    def _eliminate(self, f: Array, h: Array) -> Array:
        """Solve A x = [f, h], where h is zero in rows with Z = 0 (collective)."""
        prescribed, slave = self.bulk.prescribed_dofs, self._slave_dofs
        rhs = f.copy()
        rhs[self._rows.local] += self._R.times(f[slave])
        rhs += np.bincount(slave, h, rhs.size)  # a node may be a slave of several pairs
        rhs[prescribed] = self._prescribed_scale * f[prescribed]
        dd = self.solver.solve(self.matrix, rhs)
        forces = compat.products(self._slave_K, dd[None])[0]
        return np.concatenate([dd, self._Z * (f[slave] - forces)])

    def _solve_transposed(self, a: Array, b: Array) -> Array:
        """Solve A^T x = [a, b] (collective)."""
        prescribed, slave = self.bulk.prescribed_dofs, self._slave_dofs
        t = self._Z * b
        rhs = a - compat.products(self._slave_K, t[None], transpose=True)[0]
        w = self.solver.solve(self.matrix, rhs, transpose=True)
        at_prescribed, w[prescribed] = self._prescribed_scale * w[prescribed], 0.0
        y = w.copy()
        np.add.at(y, slave, t + self._R.transposed_times(w[self._rows.local]))
        if self._partly_prescribed:
            b = b - self._prescribed_columns().transposed_times(y[self._rows.local])
        multipliers = np.where(self._Z == 0.0, self._solve_left_out(b), w[slave])
        y[prescribed] = at_prescribed
        return np.concatenate([y, multipliers])

    def _solve_left_out(self, h: Array) -> Array:
        """Solve the rows A_z z = h of components with Z = 0; zero for others (local)."""
        return np.divide(h, self._A_z, out=np.zeros_like(h), where=self._Z == 0.0)

    def _prescribed_columns(self) -> ContactColumns:
        """B^T for prescribed components of acting multipliers (collective)."""
        loads = (
            renumbered(c.load_blocks(), z, 1.0 - c.components.free) for c, z in self.numbered()
        )
        blocks = self._rows.renumbered(chain.from_iterable(loads))
        return ContactColumns(self, self._rows, sparse.flatten(blocks))


def obstacle_to_condensation(contacts: Sequence[Interface]) -> str | None:
    """Reason why D is not diagonal, or ``None`` if it is (local)."""
    for contact in contacts:
        names = f"the pair '{contact.slave.name}' - '{contact.master.name}'"
        basis = contact.basis
        if basis not in ("dual", "vertices"):
            return f"{names} has basis '{basis}', so D is not diagonal"
        if contact.oblique.any():
            where = errors.format_point(contact.slave.X[contact.oblique][0])
            return (
                f"a slave node of {names} at {where} is prescribed in one component "
                "oblique to its normal"
            )
        candidates = contact.slave.nodes[contact.components.some_carry]
        for other in contacts:
            carry = other.components.some_carry
            if np.intersect1d(candidates, other.master.nodes).size:
                return f"slave nodes of {names} are master nodes of '{other.master.name}'"
            if np.intersect1d(candidates, other.slave.nodes[carry]).size and other is not contact:
                return f"slave nodes of {names} are slaves of '{other.master.name}', too"
            lacking = ~(carry if other is contact else other.components.all_carry)
            if np.intersect1d(candidates, other.slave.nodes[lacking]).size:
                return f"slave nodes of {names} are nodes of '{other.slave.name}' as well"
    return None


def system_of(
    bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any] | None,
    algorithm: Algorithm | None, solver: SolverName, linear_bulk: bool | None,
) -> Callable[[], LinearSystem]:  # fmt: skip
    """A function that creates the linear system of a problem; see ``ContactProblem``.

    Args:
        bulk: The bodies.
        contacts: All pairs.
        prefix: Prefix of PETSc's options.
        options: Options of the linear solver given by the user.
        algorithm: Condensed or saddle-point system; ``None``: condensed if possible.
        solver: Direct or iterative; "auto" depends on the size of the problem.
        linear_bulk: Whether the bulk is factorized only once.

    Raises:
        ValueError: On all ranks, for an iterative solver and a surface in contact with itself.
    """
    if algorithm is None:
        why = obstacle_to_condensation(contacts) or ""
        algorithm = "saddle" if why else "condensed"
    else:
        why = f"algorithm='{algorithm}'"
    form = CondensedSystem if algorithm == "condensed" else SaddleSystem
    automatic = solver == "auto"
    with_itself = next((c.slave.name for c in contacts if c.slave is c.master), "")
    if with_itself and solver == "iterative":
        raise ValueError(
            f"solver='iterative': multigrid needs separate slave and master surfaces, but "
            f"'{with_itself}' is in contact with itself; expected solver='direct' or 'auto'"
        )
    against = _against_multigrid(bulk, prefix, options, linear_bulk)
    reason = f"solver='{solver}'"
    if automatic:
        against = f"'{with_itself}' is in contact with itself" if with_itself else against
        reason = against or f"at least {costs_of(bulk.space.dim).many:,} unknowns"
        solver = "direct" if against else solver
    small = solver == "direct" and form is CondensedSystem and _is_small(bulk, prefix, options)
    if small:
        reason += f", at most {costs_of(bulk.space.dim).few:,} on one rank"
    defaults: dict[str, Any] = SMALL if small else {}
    if solver != "direct":
        on_edge = bulk.V.dofmap.dof_layout.entity_dofs(1, 0)
        defaults = iterative(bulk.space.dim, is_linear=len(on_edge) == 0)

    def create() -> LinearSystem:
        system = form(bulk, contacts, prefix, defaults | (options or {}))
        system.solver.given = set(options or {})
        system.solver.may_factor = small or solver == "auto"
        system.solver.reason, system.reason = reason, why
        system.solver.long_factors = bulk.space.dim == 3
        return system

    return create


def _is_small(bulk: Bulk, prefix: str, options: dict[str, Any] | None) -> bool:
    """Whether factorization without pivoting is tried first: few unknowns on one rank.

    Not in space, where even small factors have long rows.
    """
    given = PETSc.Options(prefix).getAll() or options
    few = bulk.space.dim == 2 and bulk.comm.size == 1 and bulk.r.getSize() <= costs_of(2).few
    return few and not given


def _against_multigrid(
    bulk: Bulk, prefix: str, options: dict[str, Any] | None, linear_bulk: bool | None
) -> str:
    """Reason why "auto" is direct, "" if it is iterative (collective)."""
    if PETSc.Options(prefix).getAll() or options:
        return "PETSc options are given"
    if bulk.space.is_mixed:
        return "mixed functions"
    # in space multigrid is faster where only some solves, if any, reduce to the contact dofs
    if bulk.is_linear and (linear_bulk or (linear_bulk is None and bulk.space.dim == 2)):
        return "the bulk is linear"
    many = costs_of(bulk.space.dim).many
    return "" if bulk.r.getSize() >= many else f"fewer than {many:,} unknowns"
