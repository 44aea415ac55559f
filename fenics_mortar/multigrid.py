# SPDX-License-Identifier: MIT
"""Multigrid for the condensed system, by that of two bodies which keep touching.

The rows of the condensed matrix A are those of K~, gathered by Q, and in the normal direction of an
active slave node its constraint: unsymmetric, and hard for multigrid where the slave is stiff. But
let the normal motion of these nodes follow that of their partners,

    dd = T y,    dd_j = tau_j tau_j . y_j + n_j n_j . sum_l (M_jl / D_jj) y_l,

then B = T^T K~ T is the tangent of bodies that may slide and keep touching, symmetric but for
contact. Multigrid for B preconditions A: constraints and prescribed values are met first, by x_0;
the rest of the right-hand side is put on the rows of T^T, and x = x_0 + T y, where y is one cycle
for B. The iterations depend neither on the mesh nor much on the stiffness of the bodies.

A tied node follows its partners in both directions. If all are tied, T y holds every solution, and
with a symmetric K so is B: conjugate gradients with the cycle then solve B y = rest altogether.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk import Bulk
from fenics_mortar.clock import clock
from fenics_mortar.interface import Interface
from fenics_mortar.mortar import Block
from fenics_mortar.sparse import BlockMatrix, is_symmetric
from fenics_mortar.surfaces import Array, Indices

CYCLE = "hypre"
# Of conjugate gradients: GMRES around them, with a tolerance of its own, then needs one iteration.
CG_TOLERANCE, CG_MOST = 1e-9, 500


class TouchingBodies:
    """A preconditioner for PETSc (``pc_type python``); all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts, with dual multipliers.
        prefix: Prefix of the options of the cycle.
    """

    def __init__(self, bulk: Bulk, contacts: Sequence[Interface], prefix: str) -> None:
        self._bulk, self._contacts = bulk, contacts
        size, block_size = bulk.num_owned, bulk.space.block_size
        self._T, self._slip, self._normal = (
            BlockMatrix(bulk.comm, size, size, block_size) for _ in range(3)
        )
        self._cycle = PETSc.KSP().create(bulk.comm)
        self._cycle.setOptionsPrefix(prefix)
        self._cycle.getPC().setType(CYCLE)
        self._cycle.setTolerances(rtol=CG_TOLERANCE, max_it=CG_MOST)
        self._cycle.setFromOptions()
        self._held = bulk.held
        self._nodes: list[tuple[Indices, Array, Array]] = []
        self._B: PETSc.Mat | None = None
        self._scale = 1.0

    @clock("solve")
    def set_up(self, K: PETSc.Mat, scale: float) -> None:
        """Prepare the cycle for the present state.

        Args:
            K: K + K_c, without boundary conditions.
            scale: Diagonal entry that rows of prescribed dofs have [stress].
        """
        self._scale = scale
        self._nodes = [self._active(contact) for contact in self._contacts]
        T = self._T.assemble(self._motion_blocks())
        self._slip.assemble(self._partner_blocks(followed=False))
        if self._B is not None:
            self._B.destroy()
        self._B = B = K.ptap(T)
        normal = self._normal.assemble(
            Block(dofs + self._bulk.first, dofs + self._bulk.first, k[:, None, None] * (F @ F))
            for dofs, F, k in self._nodes
        )
        B.axpy(1.0, normal, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        held = (self._held + self._bulk.first).astype(PETSc.IntType)
        B.zeroRowsColumns(held, diag=scale)
        self._cycle.setType("cg" if self._all_tied() and is_symmetric(B) else "preonly")
        self._cycle.setOperators(B)
        self._cycle.setUp()

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """One application, as PETSc calls it."""
        A, _ = pc.getOperators()
        first, held = b.duplicate(), b.duplicate()
        held.set(0.0)
        held.array[self._held] = b.array_r[self._held] / self._scale
        self._T.mat.mult(held, first)
        for dofs, F, k in self._nodes:
            first.array[dofs] += _apply(F, b.array_r[dofs]) / k[:, None]
        rest, change = b.duplicate(), b.duplicate()
        A.mult(first, rest)
        rest.aypx(-1.0, b)
        self._slip.mat.multTranspose(rest, change)
        rest.axpy(-1.0, change)
        for dofs, F, _ in self._nodes:
            rest.array[dofs] -= _apply(F @ F, rest.array_r[dofs])
        rest.array[self._held] = 0.0
        self._cycle.solve(rest, change)
        self._T.mat.mult(change, x)
        x.axpy(1.0, first)

    def _active(self, contact: Interface) -> tuple[Indices, Array, Array]:
        """Local dofs (a, 2), what is followed (a, 2, 2) and stiffness (a,) of own active nodes."""
        on = contact.active[contact.slave.owned]
        j = contact.slave.owned[on]
        return contact.slave.local_dofs[on], contact.followed()[j], contact.stiffness[j]

    def _all_tied(self) -> bool:
        """Whether all active nodes follow in both directions."""
        mine = all(np.allclose(F @ F, np.eye(2)) for _, F, _ in self._nodes)
        return self._bulk.comm.allreduce(mine, MPI.LAND)

    def _motion_blocks(self) -> Iterator[Block]:
        """Blocks of T."""
        one = np.ones(self._bulk.num_owned)
        for dofs, F, _ in self._nodes:
            one[dofs] = 0.0
            yield Block(dofs + self._bulk.first, dofs + self._bulk.first, np.eye(2) - F @ F)
        dofs = np.arange(one.size)[:, None] + self._bulk.first
        yield Block(dofs, dofs, one[:, None, None])
        yield from self._partner_blocks(followed=True)

    def _partner_blocks(self, *, followed: bool) -> Iterator[Block]:
        """Motion of active nodes by that of their partners, as far as they follow or not."""
        for contact in self._contacts:
            o = contact.operators
            dyads = contact.followed() @ contact.followed()
            dyads = dyads if followed else np.eye(2) - dyads
            for rows, columns, values in contact.force_blocks():
                dofs, j = rows.reshape(-1, 2), columns[::2, 0] // 2
                part = -values[::2, 0, 0] / o.diagonal[j]
                other = dofs[:, 0] != contact.slave.dofs[j, 0]
                dofs, j, part = dofs[other], j[other], part[other]
                yield Block(contact.slave.dofs[j], dofs, part[:, None, None] * dyads[j])


def _apply(matrices: Array, values: Array) -> Array:
    return np.einsum("jab,jb->ja", matrices, values)
