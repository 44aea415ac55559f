# SPDX-License-Identifier: MIT
"""Multigrid for systems with contact, based on multigrid for bodies that remain in contact.

The rows of the condensed matrix A are those of K~, combined by Q, and, in the normal direction of
an active slave node, its constraint. A is unsymmetric and difficult for multigrid if the slave is
stiff. If instead the normal motion of these nodes is that of their partners,

    dd = T y,    dd_j = tau_j tau_j . y_j + n_j n_j . sum_l (M_jl / D_jj) y_l,

then B = L A T = T^T K~ T is the tangent of bodies that may slide and remain in contact, symmetric
except for contact terms. L reverts the combination by Q in tangential direction and omits the
constraints.

Multigrid coarsens x- and y-components separately. The term tau_j tau_j couples them where tau_j is
oblique to the axes. y therefore has components along nodal axes R, which are the tangents tau at
the contact and vary smoothly in between: B = R^T L A T R.

If the slave's normals deviate by a small angle e from the axes of its partners, B couples the
tangential motions of both bodies by e times the slave's stiffness. Where the bodies slide, this
coupling is spurious. It exceeds the stiffness of a soft master, and tangential motions of the
master would be interpolated from those of the slave. These entries are therefore dropped in the
cycle, except at master nodes that slave nodes stick to.

One application to a right-hand side b has two steps:

1. x_0 solves A x_0 = b in a strip along the contact surfaces, in space where they touch, by
factorization. It satisfies the constraints and resolves local motions of the surfaces, above all
motions of the master between slave nodes: these are soft modes in a stiff neighbourhood, which
multigrid cannot represent.

2. x = x_0 + T y, where y is one cycle of multigrid for B y = L (b - A x_0).

A strip has few unknowns, O(1/h), and is factorized in each Newton iteration. The cycle is reused.

All multipliers of a saddle-point matrix A belong to the strip. Its rows are not combined, so that
L = T^T, and step 2 changes displacements only. With a standard basis D is not diagonal: D_jj is
then the sum of row j, and T y satisfies the constraints where y is smooth, as the corrections of
the cycle are.

A tied node moves with its partners in both directions. If all are tied, every solution of the
condensed system is T y, and B is symmetric if K is: then B y = L (b - A x_0) is solved completely
by conjugate gradients with the cycle.

``Strip`` is the strip of step 1, ``Replacement`` tells when a cycle built for an earlier matrix is
replaced, and ``ContactPreconditioner`` applies both steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.interface.mortar import Block
from fenics_mortar.la import touching
from fenics_mortar.la.sparse import BlockMatrix, SomeRows, is_symmetric
from fenics_mortar.utils import compat, ranks
from fenics_mortar.utils.arrays import TINY, Array, Flags, Indices, summed

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.surfaces import Surface

# Excess iterations, so far and expected, after which the cycle is rebuilt, in the plane and in
# space. A new cycle costs as much as about twenty iterations but is used in several solves. In
# space the strip resolves most of a new active set: half balls of 53,000 and 88,000 unknowns take
# 68 and 76 iterations with 20 instead of 51 with 5, but one cycle instead of three, and a fifth and
# an eighth less time.
MAX_EXCESS, MAX_EXCESS_IN_SPACE = 5, 20
# Excess iterations of a solve over the first one at its place [1] that are not counted: rates vary
# by as much where only the right-hand side changes.
IGNORED_EXCESS = 0.1
# Excess iterations per digit of a cycle made for a different active set, over the share of active
# nodes that have changed since [1]. The cycle for the first three nodes in contact needs 7 to 15
# more iterations for five digits with about a hundred active nodes, however many of them change.
EXCESS_OF_OTHER_SET = 2


class Replacement:
    """Excess iterations of a cycle since it was built; all methods are local.

    A cycle built for an earlier matrix needs more iterations. It is replaced when its excess
    iterations have cost a quarter of a new one, in space as much as it; more are expected where the
    active set has changed since.

    Iterations per digit also depend on the right-hand side. The first one of a load step is smooth
    and takes 1.4 per digit, the next ones, which are concentrated at the contact, up to 1.8 even
    with a new cycle. A solve is therefore compared with the first one by the same cycle at the same
    place in Newton's method; at a place without one, with the slowest of the first ones at other
    places. Rates at one place vary by a tenth where only the right-hand side changes, which is not
    counted: a new cycle would be no better.

    Args:
        dim: 2 in the plane, 3 in space.
    """

    def __init__(self, dim: int) -> None:
        self._most = MAX_EXCESS if dim == 2 else MAX_EXCESS_IN_SPACE
        self._rates = dict[int, float]()  # iterations per digit of the first solve at each place
        self._excess = 0.0

    def is_due(self, changed: float, digits: float) -> bool:
        """Whether a new cycle costs less than the excess iterations, those expected included.

        Args:
            changed: Nodes that have entered or left the contact since the cycle was built, over
                those in contact [1].
            digits: Digits of the next solve [1].
        """
        return self._excess + EXCESS_OF_OTHER_SET * changed * digits > self._most

    def record(self, iterations: int, digits: float, place: int) -> None:
        """Record a solve.

        Args:
            iterations: Linear iterations.
            digits: Decimal logarithm of the factor by which the residual has decreased, positive.
            place: Number of earlier solves in the same load step.
        """
        rate = iterations / digits
        if place in self._rates:
            usual = (1.0 + IGNORED_EXCESS) * self._rates[place]
        else:
            usual = max(self._rates.values(), default=rate)
            self._rates[place] = rate
        excess = self._excess + iterations - usual * digits
        self._excess = max(excess, 0.0)  # a difficult first solve is not credited


# Stiffness of motions outside the range of T over that of the node [1]: affects only the coarse
# grids of the cycle, which would be too stiff with a large value.
IDLE_STIFFNESS = 1e-2
# Integral of a multiplier function over nodal area [1] below which a node is handled by the strip
# only: for quadratic standard functions on partly covered facets it may be zero or negative.
MIN_WEIGHT = 1e-2


class ContactPreconditioner:
    """A preconditioner for PETSc (``pc_type python``); all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts.
        prefix: Prefix of the options; those of the cycle and the strip begin with it.
        multipliers: Rows of multipliers that follow the rows of this rank's dofs; ``None`` if the
            system is condensed.

    Attributes:
        by: " by" and the name of a cycle other than hypre's.
    """

    by = ""

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Interface], prefix: str, multipliers: int | None
    ) -> None:
        self._bulk, self._contacts, self._prescribed = bulk, contacts, bulk.prescribed_dofs
        self._condensed = multipliers is None
        size, block_size = bulk.num_owned, bulk.space.block_size
        self._idle, self._R = (BlockMatrix(bulk.comm, size, size, block_size) for _ in range(2))
        self._strip = touching.Strip(bulk, f"{prefix}strip_", multipliers or 0)
        self._contact_dofs: Any = None
        self._loaded = np.empty(0, np.int64)  # dofs of the parts that the cycle was built for
        self._slaves = [_nodes_near(bulk, contact.slave) for contact in contacts]
        self._prefix = f"{prefix}cycle_"
        self._cycle: Any = None
        self._replacement, self._sets = Replacement(bulk.space.dim), list[Flags]()
        self._factored = b""  # sets of the factors of the strip
        self._digits, self._place = 5.0, 0  # of the next solve: digits [1], place in the load step

    def begin_solve(self, tolerance: float, *, same_step: bool) -> None:
        """Set the relative tolerance of the next solve, and whether the last one is of its step."""
        self._digits, self._place = _digits(tolerance), self._place + 1 if same_step else 0

    def setUp(self, pc: PETSc.PC) -> None:
        """Prepare for the present matrix and active sets, as PETSc calls it."""
        self._bulk.free_garbage()  # vectors of the last set-up
        A, _ = pc.getOperators()
        outdated = self._is_outdated()
        if outdated and self._cycle is not None:
            self._cycle.destroy()
            self._cycle = None
        if self._bulk.space.dim == 3:
            compat.return_free_memory()
        self._move_strip(of_cycle=not outdated)
        self._strip.factor(A, keep=bool(self._place) and self._keeps_factors())
        self._factored = self._present_sets()
        nodes = [self._active(contact) for contact in self._contacts]
        if outdated:
            self._turn_axes()
        self._follow(nodes)
        if outdated:
            self._make_cycle(A, nodes)
        self._work = [A.createVecRight(), *(self._R.mat.createVecRight() for _ in range(3))]
        self._work_near = self._motion.mat.createVecs()

    def _move_strip(self, *, of_cycle: bool) -> None:
        """Put the strip along the surfaces, in space along the parts whose multipliers act.

        In the plane the order of elimination is kept instead, see ``Strip``. While the sets are the
        same and the strip has all of these parts, it remains, with its factors.

        Args:
            of_cycle: Whether also along the parts where they acted when the cycle was built: where
                nodes have left the contact since, it is as stiff as if they were still in it.
        """
        bulk, contacts = self._bulk, self._contacts
        dofs = touching.dofs_of([surface for c in contacts for surface in (c.slave, c.master)])
        if bulk.space.dim == 3:
            everywhere = bulk.comm.allgather([d for c in contacts for d in _loaded_dofs(c)])
            loaded = np.unique(np.concatenate([np.empty(0, np.int64), *chain(*everywhere)]))
            if not of_cycle:
                self._loaded = loaded
            loaded = np.union1d(loaded, self._loaded)
            if loaded.size:
                dofs = np.intersect1d(dofs, loaded - bulk.first)
        if self._contact_dofs is not None:
            has_all = bool(np.isin(dofs, self._contact_dofs).all())
            same = dofs.size == self._contact_dofs.size or self._keeps_factors()
            if ranks.on_all_ranks(bulk.comm, has_all and same):
                return
        self._contact_dofs = dofs
        self._strip.move_to(dofs)
        near = np.concatenate(bulk.comm.allgather(self._strip.dofs + bulk.first))
        self._near = SomeRows(near, bulk.first, bulk.num_owned)
        size = self._near.owned.size
        self._motion, self._equations = (BlockMatrix(bulk.comm, size, size) for _ in range(2))

    def forget_pattern(self) -> None:
        """Prepare for a matrix with another sparsity pattern."""
        self._strip.forget_pattern(keep_factors=self._keeps_factors())

    def _keeps_factors(self) -> bool:
        """Whether the factors of the strip serve the present matrix (local).

        In space they take a fifth of an iteration. Where sets remain within a load step, Newton's
        method is near its end, and they need no more iterations than new ones.
        """
        return self._bulk.space.dim == 3 and self._present_sets() == self._factored

    def _present_sets(self) -> bytes:
        """Nodes on which multipliers act, and their branches (local)."""
        of_nodes = ((c.acts, c.active, c.active * c.branch) for c in self._contacts)
        return b"sets" + b"".join(values.tobytes() for values in chain(*of_nodes))

    def reset(self, pc: PETSc.PC) -> None:
        """Drop the cycle and the factors of the strip, as PETSc calls it."""
        self._cycle, self._factored = None, b""

    def _is_outdated(self) -> bool:
        """Whether a new cycle costs less than the expected excess iterations."""
        if self._cycle is None or self._cycle.getType() == "cg":
            return True
        now = [contact.active for contact in self._contacts]
        changed = sum(int((a != b).sum()) for a, b in zip(now, self._sets, strict=True))
        share = changed / max(sum(int(active.sum()) for active in now), 1)
        return self._replacement.is_due(share, self._digits)

    def postSolve(self, pc: PETSc.PC, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Record the number of iterations of a solve, as PETSc calls it."""
        digits = _digits(ksp.getResidualNorm() / max(b.norm(), TINY))
        if digits > 0.0 and math.isfinite(digits):
            self._replacement.record(ksp.getIterationNumber(), digits, self._place)

    def _make_cycle(self, A: PETSc.Mat, nodes: list[tuple[Indices, Array, Array]]) -> None:
        first = self._bulk.first
        B = self._touching_tangent(A)
        idle = self._idle.assemble(self._idle_blocks(nodes))
        B.axpy(1.0, idle, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._separate_sliding_bodies(B)
        B.zeroRowsColumns((self._prescribed + first).astype(PETSc.IntType), diag=1.0)
        self._cycle = PETSc.KSP().create(self._bulk.comm)
        self._cycle.setOptionsPrefix(self._prefix)
        self._cycle.setFromOptions()
        reduced = self._condensed and self._all_tied(nodes) and is_symmetric(B)
        self._cycle.setType("cg" if reduced else "preonly")
        self._cycle.setOperators(B)
        if self._cycle.getPC().getType() == "gamg":
            self.by = " by PETSc's gamg" + ("" if compat.petsc_has("hypre") else ", without hypre")
            B.setNearNullSpace(touching.rigid_motions_along(self._axes, self._bulk, B))
        self._cycle.setUp()
        if not reduced and self._cycle.getPC().getType() == "hypre":
            self._cycle.getPC().setReusePreconditioner(True)
            self._cycle.setOperators(self._bulk.K)  # instead of B, of which hypre has a copy
            B.destroy()
        self._replacement = Replacement(self._bulk.space.dim)
        self._sets = [contact.active.copy() for contact in self._contacts]

    def _touching_tangent(self, A: PETSc.Mat) -> PETSc.Mat:
        """R^T L A T R."""
        first, _ = A.getOwnershipRange()
        dofs = PETSc.IS().createStride(self._bulk.num_owned, first, 1, comm=self._bulk.comm)
        tangent = A if self._condensed else A.createSubMatrix(dofs, dofs)
        axes = self._axes[self._bulk.space.owned_dofs[:, 0]]
        transforms = self._motion.mat, self._equations.mat
        of_nodes = self._bulk.diagonal.reshape(-1, axes.shape[1]).max(axis=1, initial=0.0)
        B = touching.touching_tangent(tangent, self._near, *transforms, axes, of_nodes)
        if tangent is not A:
            tangent.destroy()
        return B

    def _separate_sliding_bodies(self, B: PETSc.Mat) -> None:
        """Drop the coupling of tangential motions of the bodies of a contact, see the module."""
        for contact, slave in zip(self._contacts, self._slaves, strict=True):
            free = _slide(contact)
            for axis in touching.tangential_axes(contact):
                master = contact.master.local_dofs[free, axis] + self._bulk.first
                # at the tip of a crack cells on the slave have nodes of the master
                slave = slave[~np.isin(slave[:, axis], master)]
                _leave_out(B, master, slave[:, axis])
                _leave_out(B, slave[:, axis], master)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """One application, as PETSc calls it."""
        R, (whole, rest, along_axes, y) = self._R.mat, self._work
        self._strip.solve(b, x)
        b.copy(whole)
        self._strip.subtract_product(x, whole)
        rest.array[:] = whole.array_r[: self._bulk.num_owned]
        self._add_product(self._equations.mat.multTranspose, rest)
        R.multTranspose(rest, along_axes)
        along_axes.array[self._prescribed] = 0.0
        self._cycle.solve(along_axes, y)
        R.mult(y, rest)
        self._add_product(self._motion.mat.mult, rest)
        x.array[: self._bulk.num_owned] += rest.array_r

    def applyTranspose(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """One application of the transpose, as PETSc calls it.

        The cycle is used as its own transpose: its matrix is symmetric except for contact terms,
        and its smoothing is symmetric.
        """
        R, (whole, rest, along_axes, y) = self._R.mat, self._work
        size = self._bulk.num_owned
        rest.array[:] = b.array_r[:size]
        self._add_product(self._motion.mat.multTranspose, rest)
        R.multTranspose(rest, along_axes)
        self._cycle.solve(along_axes, y)
        y.array[self._prescribed] = 0.0
        R.mult(y, rest)
        self._add_product(self._equations.mat.mult, rest)
        x.set(0.0)
        x.array[:size] = rest.array_r
        b.copy(whole)
        self._strip.subtract_transposed(x, whole)
        self._strip.solve(whole, x, transpose=True)
        x.array[:size] += rest.array_r

    def _add_product(self, multiply: Callable[[PETSc.Vec, PETSc.Vec], None], x: PETSc.Vec) -> None:
        """Add to ``x`` its product with a matrix of the dofs near contact."""
        near, product = self._work_near
        near.array[:] = x.array_r[self._near.local]
        multiply(near, product)
        x.array[self._near.local] += product.array_r

    def _turn_axes(self) -> None:
        """Set R."""
        self._axes = touching.turned_axes(self._bulk, self._contacts)
        dofs = self._bulk.space.owned_dofs
        globals_ = dofs + self._bulk.first
        self._R.assemble([Block(globals_, globals_, self._axes[dofs[:, 0]])])

    def _active(self, contact: Interface) -> tuple[Indices, Array, Array]:
        """Local dofs (a, dim), constrained directions and stiffness (a,) of owned nodes."""
        on = contact.acts[contact.slave.owned]
        j = contact.slave.owned[on]
        return contact.slave.local_dofs[on], contact.rows.followed()[j], contact.stiffness[j]

    def _all_tied(self, nodes: list[tuple[Indices, Array, Array]]) -> bool:
        """Whether all active nodes are constrained in all directions."""
        mine = all(np.allclose(F @ F, np.eye(F.shape[2])) for _, F, _ in nodes)
        return self._bulk.comm.allreduce(mine, MPI.LAND)

    def _follow(self, nodes: list[tuple[Indices, Array, Array]]) -> None:
        """Set T - 1 and L^T - 1: motions of constrained nodes, rows that receive their forces."""
        first = self._bulk.first
        own = [Block(dofs + first, dofs + first, -F @ F) for dofs, F, _ in nodes]
        gathered = np.eye(self._bulk.space.dim) * self._condensed
        motion, equations = own.copy(), own.copy()
        for slave, other, share, followed in self._partners():
            motion.append(Block(slave, other, share * followed))
            equations.append(Block(slave, other, share * (followed - gathered)))
        self._motion.assemble(self._near.in_submatrix(motion))
        self._equations.assemble(self._near.in_submatrix(equations))

    def _idle_blocks(self, nodes: list[tuple[Indices, Array, Array]]) -> Iterator[Block]:
        """Blocks of the motions outside the range of T, along the axes."""
        for dofs, F, k in nodes:
            axes = self._axes[dofs[:, 0]]
            idle = axes.transpose(0, 2, 1) @ F @ F @ axes
            dofs = dofs + self._bulk.first
            yield Block(dofs, dofs, IDLE_STIFFNESS * k[:, None, None] * idle)

    def _partners(self) -> Iterator[tuple[Indices, Indices, Array, Array]]:
        """Dofs (p, dim) of active slave nodes and of others, M_jl / D_jj (p, 1, 1), F F.

        Entries of D between active nodes are treated as if they were on its diagonal.
        """
        for contact in self._contacts:
            slave, followed = contact.slave, contact.rows.followed() @ contact.rows.followed()
            entries = zip(*contact.force_entries(), strict=True)
            dofs, j, values = (np.concatenate(parts) for parts in entries)
            own = np.isin(dofs[:, 0], slave.dofs[contact.acts, 0])
            weight = ranks.sum_over_ranks(slave.comm, summed(values[own], j[own], slave.num_nodes))
            weight[weight < MIN_WEIGHT * contact.slave.nodal_areas] = np.inf
            dofs, j, share = dofs[~own], j[~own], -values[~own] / weight[j[~own]]
            yield slave.dofs[j], dofs, share[:, None, None], followed[j]


def _loaded_dofs(contact: Interface) -> list[Indices]:
    """Dofs of the nodes on which multipliers of this rank act, and of their own nodes (local)."""
    own = contact.slave.dofs[contact.acts]
    return [own.ravel(), *(dofs.ravel() for dofs, _, _ in contact.force_entries())]


def _digits(reduction: float) -> float:
    """Decimal digits, at most 16, by which a residual is reduced."""
    return -math.log10(max(reduction, 1e-16))


def _nodes_near(bulk: Bulk, surface: Surface) -> Indices:
    """Global dofs (n, dim) of the owned nodes of a surface and of the cells on it."""
    dofs = bulk.space.owned_dofs
    near = touching.with_neighbours(bulk, touching.dofs_of([surface]), 1)
    return dofs[np.isin(dofs[:, 0], near)] + bulk.first


def _leave_out(B: PETSc.Mat, rows: Indices, columns: Indices) -> None:
    """Set entries in these rows and columns to zero: global numbers of those this rank owns.

    PETSc needs ascending numbers: with others ``createSubMatrix`` fails on some ranks only.
    """
    owned = [np.sort(part).astype(PETSc.IntType) for part in (rows, columns)]
    block = B.createSubMatrix(*(PETSc.IS().createGeneral(numbers, B.comm) for numbers in owned))
    starts, numbers, values = block.getValuesCSR()
    everywhere = np.concatenate(B.comm.tompi4py().allgather(owned[1]))
    B.setValuesIJV(starts, everywhere[numbers], np.zeros_like(values), rowmap=owned[0])
    B.assemble()
    block.destroy()


def _slide(contact: Interface) -> Flags:
    """Marks of owned master nodes to which no slave node sticks, (owned nodes,) (collective).

    Tips of cracks, which are nodes of both sides, do not slide.
    """
    s = contact.operators.segments
    stuck = np.isin(contact.master.nodes, contact.slave.nodes)
    stuck[s.master[contact.sticking[s.slave].any(axis=1)]] = True
    return ~ranks.any_over_ranks(contact.master.comm, stuck)[contact.master.owned]
