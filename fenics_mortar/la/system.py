# SPDX-License-Identifier: MIT
"""Linear system of a Newton iteration, and its form as a saddle point (Alg. 1); see ``condensed``.

The unknowns are the increment dd and the *new* multiplier z (Foltyn & Vlach 2016, eq. 12), the
right-hand side therefore contains r = f_int - f_ext without the contact force:

    (K + K_c) dd + B^T z = -r         B^T z: +D^T z on slave, -M^T z on master rows
          C dd + A_z z   = rhs        rows of the contact law, see ``contact.rows``

with K_c = d(B^T z^k)/dd. The row of a prescribed dof is that of the identity: dd = prescribed -
present. The operator A below is the derivative of these residuals: ``assemble`` linearizes,
``solve`` solves with A or A^T, and ``step`` solves with the right-hand side above.

The multipliers are scaled to forces, z_j = k_j zeta_j / D_jj. Nodal scaling (Popp, Seitz, Gee &
Wall 2013) keeps the system well conditioned if a node is only partly covered and does not change
the iterates. Rows of prescribed dofs are scaled by their own stiffness. Both scales are internal:
``solve`` takes and returns unscaled vectors.

Vectors are local arrays: values of the owned dofs, then the components of each multiplier owned by
this rank, in the order of ``z_dofs``.

``LinearSystem`` is the base class of both forms, ``SaddleSystem`` that with the multipliers as
unknowns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from enum import IntEnum
from itertools import chain
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.interface.mortar import Block
from fenics_mortar.la.coupling import MARGIN, MAX_MARGIN, Coupling, zero_block
from fenics_mortar.la.multigrid import ContactPreconditioner
from fenics_mortar.la.solver import LinearSolver
from fenics_mortar.la.sparse import BlockMatrix, add_blocks, packed, summed_rows, with_rows
from fenics_mortar.utils import compat, ranks
from fenics_mortar.utils.clock import clock

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.contact.rows import Rows
    from fenics_mortar.utils.arrays import Array, Indices


class LinearSystem(ABC):
    """Base class of both forms: numbering and scaling of multipliers, blocks, solver.

    Attributes:
        z_dofs: Global numbers of the components of the multipliers, shape of ``z`` per contact,
            ordered by owner, so that a rank owns a contiguous range; those of a node follow each
            other.
        num_z_dofs: Number of components owned by this rank.
        first_z_dof: Global number of the first of them.
        all_z_dofs: Number of components on all ranks.
        solver: Solver for ``matrix``.
        reason: Why the multipliers are unknowns or not, as text; "" for the default, not.
        matrix: The last assembled matrix, scaled, with the rows of prescribed dofs.
    """

    has_multipliers: bool  # whether the matrix has rows of multipliers

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any]
    ) -> None:
        """Number the multipliers and create the solver (collective).

        Args:
            bulk: The bodies.
            contacts: The contacts.
            prefix: Prefix of PETSc's options.
            options: Options of PETSc without the prefix.
        """
        self.bulk, self.contacts, self.comm = bulk, contacts, bulk.comm
        of_each = [np.repeat(c.slave.owners, c.z.shape[1]) for c in contacts]
        owners = np.concatenate([np.empty(0, np.int64), *of_each])
        numbers = np.empty(owners.size, np.int64)
        numbers[np.argsort(owners, kind="stable")] = np.arange(owners.size)
        parts = np.split(numbers, np.cumsum([c.z.size for c in contacts])[:-1])
        each = zip(parts, contacts, strict=False)
        self.z_dofs: list[Indices] = [part.reshape(c.z.shape) for part, c in each]
        self.all_z_dofs = owners.size
        self.num_z_dofs = int((owners == self.comm.rank).sum())
        self.first_z_dof = int((owners < self.comm.rank).sum())
        self._numbered = [(c, z, c.slave.owned, self.local(c, z)) for c, z in self.numbered()]
        rows = self.num_z_dofs if self.has_multipliers else None
        self.reason = ""
        self.solver = LinearSolver(
            self.comm, prefix, options, lambda: ContactPreconditioner(bulk, contacts, prefix, rows)
        )
        self._couplings: list[Coupling] = []
        self._margins = [MARGIN] * len(self.contacts)
        self._pattern = 0
        self.matrix: PETSc.Mat
        self._prescribed_scale: Array = np.empty(0)

    @abstractmethod
    def assemble(self) -> None:
        """Linearize: build ``matrix`` from the last evaluated state (collective)."""

    @abstractmethod
    def step(self, distance: Array) -> Array:
        """Increment dd and new multipliers of a Newton iteration, as one vector (collective).

        Args:
            distance: Prescribed values minus the present ones, shape (prescribed dofs,) [length].

        Returns:
            Increment [length] and multipliers [stress], shape (owned rows,).
        """

    @abstractmethod
    def solve(self, b: Array, *, transpose: bool = False) -> Array:
        """Solve A x = b, or A^T x = b, with A as last assembled (collective).

        Args:
            b: Right-hand side, shape (owned rows,); [stress length] in the rows of free dofs.
            transpose: Whether to solve with A^T.

        Raises:
            MortarError: On all ranks, if A is singular or the solver fails.
        """

    @property
    def ksp(self) -> PETSc.KSP:
        """PETSc's solver."""
        return self.solver.ksp

    def describe_solver(self) -> str:
        """Description of the system's form, size and solver (local)."""
        form = "saddle-point" if self.has_multipliers else "condensed"
        why = f" ({self.reason})" if self.reason else ""
        unknowns = self.bulk.r.getSize()
        return f"{form} system{why}, {unknowns} unknowns of the bulk, {self.solver.describe()}"

    # Vectors

    def local(self, contact: Interface, z_dofs: Indices) -> Indices:
        """Local numbers of a contact's owned components, shape (owned nodes, c) (local)."""
        return z_dofs[contact.slave.owned] - self.first_z_dof

    def numbered(self) -> Iterator[tuple[Interface, Indices]]:
        """Each contact with its ``z_dofs``."""
        return zip(self.contacts, self.z_dofs, strict=True)

    def with_others(self, numbers: Indices) -> list[Indices]:
        """Components (k, c) of the multipliers that have some of ``numbers``, per contact (local).

        Args:
            numbers: Global numbers of components, any shape.
        """
        marked = np.zeros(self.all_z_dofs, bool)
        marked[numbers] = True
        return [z_dofs[marked[z_dofs].any(axis=1)] for z_dofs in self.z_dofs]

    def collect(self, nodal: Iterable[Array]) -> Array:
        """Values [any unit] of the owned components, shape (num_z_dofs,) (local).

        Args:
            nodal: Values of each contact, shape of ``z``, replicated.
        """
        mine = np.zeros(self.num_z_dofs)
        for (_, _, owned, local), values in zip(self._numbered, nodal, strict=True):
            mine[local] = values[owned]
        return mine

    def join(self, u: Array, z: Iterable[Array]) -> Array:
        """Vector (owned rows,) of ``u`` [length] and ``z`` (slave nodes, c) [stress] (local)."""
        return np.concatenate([u[: self.bulk.num_owned], self.collect(z)])

    def split(self, x: Array) -> tuple[Array, list[Array]]:
        """Split ``x``, shape (owned rows,), into u [length] and z [stress] (collective).

        Values z of each contact, shape (slave nodes, c), are replicated; inverse of ``join``.
        """
        mine, z = x[self.bulk.num_owned :], []
        for _, z_dofs, owned, local in self._numbered:
            values = np.zeros(z_dofs.shape)
            values[owned] = mine[local]
            z.append(values if self.comm.size == 1 else ranks.sum_over_ranks(self.comm, values))
        return x[: self.bulk.num_owned].copy(), z

    # Blocks

    def force_derivative(self) -> list[Block]:
        """Blocks of K_c = d(B^T z)/dd at fixed z, and of the derivatives of fluxes."""
        blocks: list[Block] = []
        for contact in self.contacts:
            if not contact.operators.linearization.frozen:
                blocks += contact.now.acting.force_derivative(contact.z_u)
            for flux in contact.conductances:
                blocks += flux.derivative()
        return blocks

    def force_blocks(self) -> Iterable[Block]:
        """Blocks of B^T for zeta; columns are numbers of multipliers' components."""
        for contact, z_dofs in self.numbered():
            yield from renumbered(contact.load_blocks(), z_dofs, contact.components.scale)

    def law_blocks(
        self, pair_rows: Sequence[Rows], numbers: Sequence[Indices] | None = None
    ) -> list[Block]:
        """Blocks of C, by the rows of each contact.

        Args:
            pair_rows: The rows.
            numbers: Numbers of the rows, shape of ``z`` per contact; by default ``z_dofs``.
        """
        blocks = []
        for of_rows, own in zip(numbers or self.z_dofs, pair_rows, strict=True):
            for rows, columns, values in own.blocks:
                blocks.append(Block(of_rows.ravel()[rows], columns, values))
        return blocks

    def derivative_zeros(self) -> Iterator[Block]:
        """Zeros for possible derivatives of forces, gaps and fluxes."""
        for contact, coupling in zip(self.contacts, self._couplings, strict=True):
            yield coupling.derivative_pattern()
            yield from (coupling.flux_pattern(flux) for flux in contact.fluxes)

    def multiplier_blocks(self, pair_rows: Sequence[Rows]) -> Iterable[Block]:
        """Blocks of A_z for zeta, of the multipliers owned here."""
        for (contact, z_dofs), own in zip(self.numbered(), pair_rows, strict=True):
            mine = contact.slave.owned
            dofs = z_dofs[mine]
            yield Block(dofs, dofs, own.A_z[mine] * contact.components.scale[mine, None])

    # Assembly

    def _update_pattern(self) -> bool:
        """Replace the couplings if contact exceeds them or K is new (collective).

        Returns:
            Whether they were replaced.
        """
        now = [(c.operators, c.coupled_by_slip()) for c in self.contacts]
        fits = self._pattern == self.bulk.num_patterns
        for i, coupling in enumerate(self._couplings):
            contact = self.contacts[i]
            coupled = contact.acts | contact.z.any(axis=1)
            for flux in contact.fluxes:
                coupled = coupled | flux.conducts
            if not coupling.contains(*now[i], coupled):
                fits, self._margins[i] = False, min(2 * self._margins[i], MAX_MARGIN)
        if ranks.on_all_ranks(self.comm, fits):
            return False
        self._couplings = [Coupling(*state, m) for state, m in zip(now, self._margins, strict=True)]
        self._pattern = self.bulk.num_patterns
        return True

    def _free_matrix(self, K: PETSc.Mat) -> None:
        """Free the last matrix, and the factors of its strip, before a new one (collective).

        With multigrid only: factors of a direct solver serve further matrices.

        Args:
            K: A matrix of the same layout, to which PETSc's solver refers meanwhile.
        """
        if self.solver.multigrid is not None:
            self.solver.multigrid.forget_pattern()
            self.ksp.setOperators(K)
            self.matrix = PETSc.Mat()
            self.bulk.free_garbage()
            compat.return_free_memory()

    def _prescribe_rows(self, matrix: PETSc.Mat, first_row: int) -> None:
        """Replace the rows of prescribed dofs by k times those of the identity (collective).

        k is the own stiffness of each dof. With one k for all, the residuals of a stiff body beside
        a soft one would be far above the right-hand side.
        """
        bulk = self.bulk
        own = bulk.diagonal[bulk.prescribed_dofs]
        self._prescribed_scale = np.where(own > 0.0, own, bulk.stiffness)
        # in space the matrix is a new one each time, and its factors need no zeros
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, bulk.space.dim == 2)
        rows = (bulk.prescribed_dofs + first_row).astype(PETSc.IntType)
        matrix.zeroRows(rows, diag=1.0)
        diagonal = matrix.getDiagonal()
        diagonal.array[rows - matrix.getOwnershipRange()[0]] = self._prescribed_scale
        matrix.setDiagonal(diagonal)
        diagonal.destroy()

    def _newton_force(self, distance: Array) -> Array:
        """-r, and at prescribed dofs the ``distance`` to their values, (owned dofs,).

        Loads of fluxes f(z) are linear in the new multipliers: -f(z^k) + f'(z^k) z^k (collective).
        """
        f = -self.bulk.r.array_r[: self.bulk.num_owned]
        for contact in self.contacts:
            for flux in contact.conductances:
                flux.add_newton_loads(f)
        f[self.bulk.prescribed_dofs] = distance
        return f


def renumbered(blocks: Iterable[Block], z_dofs: Indices, factors: Array) -> Iterator[Block]:
    """Blocks whose columns index ``z.ravel()``, times ``factors``, with the numbers ``z_dofs``.

    Args:
        blocks: The blocks of a contact.
        z_dofs: Numbers of its multipliers' components, shape (slave nodes, c).
        factors: Factors of the columns, of that shape.
    """
    numbers, factors = z_dofs.ravel(), factors.ravel()
    for rows, columns, values in blocks:
        yield Block(rows, numbers[columns], values * factors[columns][:, None, :])


class Kind(IntEnum):
    """Kinds of rows and columns: dofs of the bodies, components of multipliers."""

    DOF, MULTIPLIER = range(2)


DOF, MULTIPLIER = Kind
# Kind of rows, kind of columns, and blocks with separate numbers for each kind.
Part = tuple[Kind, Kind, Iterable[Block]]


class SaddleSystem(LinearSystem):
    """System of displacements and multipliers; any basis, also with nodes shared between pairs.

    The unknowns are [dd, zeta] on each rank, the matrix S_r A S_c. S_c scales multipliers to
    forces, S_r scales the rows of prescribed dofs. The transposed system S_c A^T S_r uses the same
    factors.
    """

    has_multipliers = True

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, options: dict[str, Any]
    ) -> None:
        super().__init__(bulk, contacts, prefix, options)
        self._sizes = bulk.num_owned, self.num_z_dofs
        sizes = np.array(self.comm.allgather(self._sizes))
        self._ends = np.cumsum(sizes, axis=0)
        self._shifts = np.stack([(self._ends - sizes)[:, MULTIPLIER], self._ends[:, DOF]], axis=1)
        self._no_K = BlockMatrix(self.comm, *[self._sizes[MULTIPLIER]] * 2).assemble([])
        self._assembled: Any = None

    def _number(self, kind: Kind, numbers: Indices) -> Indices:
        """Numbers of dofs or components of multipliers in the whole matrix; -1 stays -1."""
        rank = np.searchsorted(self._ends[:, kind], numbers, side="right")
        return np.where(numbers >= 0, numbers + self._shifts[rank, kind], -1)

    def _numbered_blocks(self, parts: Iterable[Part]) -> Iterator[Block]:
        """Blocks for the whole matrix."""
        for of_rows, of_columns, blocks in parts:
            for i, j, values in blocks:
                yield Block(self._number(of_rows, i), self._number(of_columns, j), values)

    def _parts(self) -> Iterator[Part]:
        """Blocks of K_c, B^T, C and A_z, the last three for scaled multipliers zeta."""
        pair_rows = [contact.rows.linearized() for contact in self.contacts]
        self._law_rhs = [rows.rhs for rows in pair_rows]
        yield DOF, DOF, self.force_derivative()
        yield DOF, MULTIPLIER, self.force_blocks()
        yield MULTIPLIER, DOF, self.law_blocks(pair_rows)
        yield MULTIPLIER, MULTIPLIER, self.multiplier_blocks(pair_rows)

    def _zero_blocks(self) -> Iterator[Part]:
        """Zeros for possible entries of K_c, B^T and C; A_z has a fixed pattern."""
        yield DOF, DOF, self.derivative_zeros()
        for (contact, z_dofs), coupling in zip(self.numbered(), self._couplings, strict=True):
            own, dim = contact.slave.owned, contact.slave.dim
            dofs, multipliers = coupling.force_pattern()
            dofs = np.concatenate([dofs, contact.slave.dofs[own]]).reshape(-1, 1)
            numbers = z_dofs[np.append(multipliers, own), :dim].reshape(-1, 1)
            nodes, coupled = coupling.law_pattern()
            yield DOF, MULTIPLIER, [zero_block(dofs, numbers)]
            for flux in contact.fluxes:
                rows, carriers = coupling.flux_force_pattern(flux)
                yield DOF, MULTIPLIER, [zero_block(rows, z_dofs[carriers, :dim])]
            yield MULTIPLIER, DOF, [zero_block(z_dofs[nodes, :dim], coupled)]

    def blocks(self) -> tuple[PETSc.Mat, PETSc.Mat, PETSc.Mat, PETSc.Mat]:
        """K + K_c, B^T, C and A_z, the last three for scaled multipliers zeta (collective)."""
        K_c, B_T, C, A_z = (
            BlockMatrix(self.comm, self._sizes[rows], self._sizes[columns]).assemble(blocks)
            for rows, columns, blocks in self._parts()
        )
        K = self.bulk.K.copy()
        K.axpy(1.0, K_c, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return K, B_T, C, A_z

    @clock("assembly")
    def assemble(self) -> None:
        """Fill the matrix; create it again if contact exceeds its pattern (collective)."""
        nest = PETSc.Mat().createNest([[self.bulk.K, None], [None, self._no_K]], comm=self.comm)
        K = PETSc.Mat()
        nest.convert("aij", out=K)
        nest.destroy()
        if self.bulk.space.dim == 2:
            self._fill(K)
        else:
            blocks = self._numbered_blocks(self._parts())
            self._free_matrix(K)
            rows = packed(blocks, None, K.getSize()[1])
            self.matrix = with_rows(K, summed_rows(self.comm, K.getOwnershipRanges(), [rows]))
        K.destroy()
        self._scales = self.collect(c.components.scale for c in self.contacts)
        self._prescribe_rows(self.matrix, self.matrix.getOwnershipRange()[0])

    def _fill(self, K: PETSc.Mat) -> None:
        """Fill the matrix in the plane, whose pattern has all entries (collective)."""
        if self._update_pattern():
            self._extend_pattern(K)
        self._assembled.zeroEntries()
        K.copy(self._assembled, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        add_blocks(self._assembled, self._numbered_blocks(self._parts()))
        self.matrix = self._assembled

    def _extend_pattern(self, K: PETSc.Mat) -> None:
        """Create the matrix with the pattern of K and of possible contact (collective)."""
        if self._assembled is not None:
            self._assembled.destroy()
        parts = chain(self._parts(), self._zero_blocks())
        zero_blocks = BlockMatrix(self.comm, *[sum(self._sizes)] * 2)
        zero_blocks.assemble(self._numbered_blocks(parts))
        self._assembled = zero_blocks.mat
        self._assembled.axpy(1.0, K, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.solver.reset_pattern()

    def step(self, distance: Array) -> Array:
        """See ``LinearSystem``; solves for the increment of zeta, which vanishes at convergence.

        The tolerance of an iterative solver is therefore relative to the residual.
        """
        rhs = self._scale_rows(self.join(self._newton_force(distance), self._law_rhs))
        z = self.collect(c.z for c in self.contacts) / self._scales
        present = np.append(np.zeros(self.bulk.num_owned), z)
        product = compat.products(self.matrix, present[None])[0]
        return self._scale_multipliers(self.solver.solve(self.matrix, rhs - product) + present)

    def solve(self, b: Array, *, transpose: bool = False) -> Array:
        """Solve with the saddle-point system; see ``LinearSystem.solve`` (collective)."""
        if transpose:
            scaled = self._scale_multipliers(b)
            return self._scale_rows(self.solver.solve(self.matrix, scaled, transpose=True))
        return self._scale_multipliers(self.solver.solve(self.matrix, self._scale_rows(b)))

    def _scale_rows(self, b: Array) -> Array:
        """S_r b."""
        scaled = b.copy()
        scaled[self.bulk.prescribed_dofs] *= self._prescribed_scale
        return scaled

    def _scale_multipliers(self, x: Array) -> Array:
        """S_c x."""
        scaled = x.copy()
        scaled[self.bulk.num_owned :] *= self._scales
        return scaled
