# SPDX-License-Identifier: MIT
"""Linear system of a Newton iteration, as saddle point (Alg. 1) or condensed (Alg. 2).

The unknowns are the increment dd and the *new* multiplier z (Foltyn & Vlach 2016, eq. 12), the
right-hand side therefore contains r = f_int - f_ext without the contact force:

    (K + K_c) dd + B^T z = -r         B^T z: +D^T z on slave, -M^T z on master rows
          C dd + A_z z   = rhs        rows of the contact law, see ``interface.Rows``

with K_c = d(B^T z^k)/dd. The row of a prescribed dof is that of the identity: dd = prescribed -
present. The operator A below is the derivative of these residuals: ``assemble`` linearizes,
``solve`` solves with A or A^T, and ``step`` solves with the right-hand side above.

The multipliers are scaled to forces, z_j = k_j zeta_j / D_jj. Nodal scaling (Popp, Seitz, Gee &
Wall 2013) keeps the system well conditioned if a node is only partly covered and does not change
the iterates. Rows of prescribed dofs are scaled by the largest k_j. Both scales are internal:
``solve`` takes and returns unscaled vectors.

Vectors are local arrays: values of the owned dofs, then both components of each multiplier owned by
this rank, in the order of ``z_numbers``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.rows import Frame, Rows
from fenics_mortar.interface.mortar import Block
from fenics_mortar.la.coupling import MARGIN, MAX_MARGIN, Coupling
from fenics_mortar.la.multigrid import ContactPreconditioner
from fenics_mortar.la.solver import LinearSolver
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.ranks import on_all_ranks, sum_over_ranks


class LinearSystem(ABC):
    """Base class of both forms: numbering and scaling of multipliers, blocks, solver.

    Attributes:
        z_numbers: Global number of the multiplier of each slave node, (slave nodes,) per contact,
            ordered by owner, so that a rank owns a contiguous range.
        num_multipliers: Number of multipliers owned by this rank.
        solver: Solver for ``matrix``.
        reason: Why the multipliers are unknowns or not, as text; "" for the default, not.
        matrix: The last assembled matrix, scaled, with the rows of prescribed dofs.
        num_kept: Number of iterations without a new tangent since ``count_anew``.
        frames: Weights of the rows of each contact in it, see ``contact.rows``.
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
        owners = np.concatenate([np.empty(0, np.int64), *(c.slave.owners for c in contacts)])
        z_number = np.empty(owners.size, np.int64)
        z_number[np.argsort(owners, kind="stable")] = np.arange(owners.size)
        ends = np.cumsum([contact.slave.num_nodes for contact in contacts])
        self.z_numbers: list[Indices] = np.split(z_number, ends)[:-1]
        self.num_multipliers = int((owners == self.comm.rank).sum())
        self._first_multiplier = int((owners < self.comm.rank).sum())
        self._numbered = [
            (contact, z_number, contact.slave.owned, self.local(contact, z_number))
            for contact, z_number in zip(contacts, self.z_numbers, strict=True)
        ]
        rows = 2 * self.num_multipliers if self.has_multipliers else None
        self.reason = ""
        self.solver = LinearSolver(
            self.comm, prefix, options, lambda: ContactPreconditioner(bulk, contacts, prefix, rows)
        )
        self._couplings: list[Coupling] = []
        self._margins = [MARGIN] * len(self.contacts)
        self._pattern = 0
        self.matrix: PETSc.Mat
        self.frames: list[Frame] = []
        self.num_kept = 0
        self._prescribed_scale = 1.0

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
            b: Right-hand side, shape (owned dofs + 2 owned multipliers,); [stress length] in the
                rows of free dofs.
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
        text = f"{form} system{why}, {unknowns} unknowns of the bulk, {self.solver.describe()}"
        if self.num_kept:
            text += f"; {self.num_kept} with the last tangent, whose change is negligible"
        return text

    def count_anew(self) -> None:
        """Set the numbers of iterations with earlier tangents or factors to zero (local)."""
        self.num_kept = 0
        self.solver.count_anew()

    # Vectors

    def local(self, contact: Interface, z_number: Indices) -> Indices:
        """Local numbers of a contact's owned multipliers, shape (n,) as ``z_number`` (local)."""
        return z_number[contact.slave.owned] - self._first_multiplier

    def numbered(self) -> Iterator[tuple[Interface, Indices]]:
        """Each contact with the numbers of its multipliers, (slave nodes,)."""
        return zip(self.contacts, self.z_numbers, strict=True)

    def collect(self, nodal: Iterable[Array]) -> Array:
        """Values [any unit] of the owned multipliers, shape (num_multipliers, ...) (local).

        Args:
            nodal: Values of each contact, shape (slave nodes, ...), replicated.
        """
        parts = list(nodal)
        shape = parts[0].shape[1:] if parts else (2,)
        mine = np.zeros((self.num_multipliers, *shape))
        for (_, _, owned, local), values in zip(self._numbered, parts, strict=True):
            mine[local] = values[owned]
        return mine

    def join(self, u: Array, z: Iterable[Array]) -> Array:
        """Vector (owned rows,) of ``u`` [length] and ``z`` (slave nodes, 2) [stress] (local)."""
        return np.concatenate([u[: self.bulk.num_owned], self.collect(z).ravel()])

    def split(self, x: Array) -> tuple[Array, list[Array]]:
        """Split ``x``, shape (owned rows,), into u [length] and z [stress] (collective).

        Values z of each contact, shape (slave nodes, 2), are replicated; inverse of ``join``.
        """
        mine, z = x[self.bulk.num_owned :].reshape(-1, 2), []
        for contact, _, owned, local in self._numbered:
            values = np.zeros((contact.slave.num_nodes, 2))
            values[owned] = mine[local]
            z.append(values if self.comm.size == 1 else sum_over_ranks(self.comm, values))
        return x[: self.bulk.num_owned].copy(), z

    # Blocks

    def force_derivative(self) -> list[Block]:
        """Blocks of K_c = d(B^T z)/dd at fixed z, and of the derivatives of fluxes."""
        return [block for contact in self.contacts for block in contact.load_derivative()]

    def scale(self, contact: Interface) -> Array:
        """z_j / zeta_j, shape (slave nodes,) [stress / length]."""
        diagonal = np.where(contact.acts, contact.operators.diagonal, contact.slave.nodal_areas)
        return contact.stiffness / diagonal

    def force_blocks(self) -> Iterable[Block]:
        """Blocks of B^T for zeta; columns are numbers of multipliers."""
        for contact, z_number in self.numbered():
            scale = self.scale(contact)
            for rows, columns, values in [*contact.force_blocks(), *contact.flux_blocks()]:
                j = columns // 2
                yield Block(rows, 2 * z_number[j] + columns % 2, values * scale[j][:, None, :])

    def law_blocks(self, pair_rows: Sequence[Rows]) -> Iterable[Block]:
        """Blocks of C, by the rows of each contact; rows are numbers of multipliers."""
        for z_number, own in zip(self.z_numbers, pair_rows, strict=True):
            for block in own.blocks:
                rows = 2 * z_number[block.rows // 2] + block.rows % 2
                yield Block(rows, block.columns, block.values)

    def multiplier_blocks(self, pair_rows: Sequence[Rows]) -> Iterable[Block]:
        """Blocks of A_z for zeta, of the multipliers owned here."""
        for (contact, z_number), own in zip(self.numbered(), pair_rows, strict=True):
            mine = contact.slave.owned
            dofs = components(z_number[mine, None])
            yield Block(dofs, dofs, own.A_z[mine] * self.scale(contact)[mine, None, None])

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
            if not coupling.contains(*now[i], contact.coupled):
                fits, self._margins[i] = False, min(2 * self._margins[i], MAX_MARGIN)
        if on_all_ranks(self.comm, fits):
            return False
        self._couplings = [Coupling(*state, m) for state, m in zip(now, self._margins, strict=True)]
        self._pattern = self.bulk.num_patterns
        return True

    def _prescribe_rows(self, matrix: PETSc.Mat, first_row: int) -> None:
        """Replace the rows of prescribed dofs by k times those of the identity (collective)."""
        self._prescribed_scale = max([float(c.stiffness.max()) for c in self.contacts], default=1.0)
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        rows = (self.bulk.prescribed_dofs + first_row).astype(PETSc.IntType)
        matrix.zeroRows(rows, diag=self._prescribed_scale)

    def _newton_force(self, distance: Array) -> Array:
        """-r, and at prescribed dofs the ``distance`` to their values, (owned dofs,).

        Loads of fluxes f(z) are linear in the new multipliers: -f(z^k) + f'(z^k) z^k (collective).
        """
        f = -self.bulk.r.array_r[: self.bulk.num_owned]
        for contact in self.contacts:
            for flux in contact.fluxes:
                flux.add_newton_loads(f)
        f[self.bulk.prescribed_dofs] = distance
        return f


def components(nodes: Indices) -> Indices:
    """Numbers 2 j + component of both components of ``nodes`` (..., k), shape (..., 2 k)."""
    numbers = 2 * nodes[..., None] + np.arange(2)
    return numbers.reshape(*nodes.shape[:-1], 2 * nodes.shape[-1])
