# SPDX-License-Identifier: MIT
"""Equations of the multipliers of a contact: their rows, the active set, and the multiplier nodes.

``ContactRows`` are the rows of gap and contact law; functions yield their changes in given motions
of both surfaces. ``next_sets`` finds the active set and the branches by the complementarity
function, ``strength`` the tractions that the law admits at other pressures and gaps, and
``MultiplierNodes`` the slave nodes that carry multipliers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.contact.fields import normal_parts, tangential
from fenics_mortar.contact.law import GRAZE, KINK, STICK, Branches, VectorRow
from fenics_mortar.interface.mortar import Block, scaled
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.kernels.blocks import expand_rows
from fenics_mortar.utils.arrays import LAST_DIGITS, Array, Flags, Indices
from fenics_mortar.utils.ranks import sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.fields import ContactFields, InterfaceFields, InterfaceState

# Weights of the rows: n k / D of gaps, nodal areas of multipliers that do not act, tau D and n D of
# the law; with a closing gap of the law, weights of gaps are zero, and the weight -n k of the
# closing gap follows. Weights are zero at nodes without such a row. Shapes (slave nodes, 2), the
# second (slave nodes,). Ties have other weights, see ``tied_rows``.
Frame = tuple[Array, ...]


@dataclass(frozen=True)
class Rows:
    """The rows of the multipliers: blocks . dd + A_z z = rhs, in the units of the bulk's rows.

    Attributes:
        blocks: Blocks with rows that index z.ravel(), and dofs as columns.
        A_z: Shape (slave nodes, c, c) [length].
        rhs: Shape (slave nodes, c) [stress length].
    """

    blocks: list[Block]
    A_z: Array
    rhs: Array


class ContactRows:
    """Rows of the multipliers of a contact: gap and contact law (local).

    Rows of gaps are weighted by k_j / D_jj, rows of the law by D_jj, and rows of a closing gap by
    k_j, so that all have the units of the bulk rows. They are combined into Cartesian components,

        active:   n (row of the gap) - tau (tangential row)
        open:     - n (normal row) - tau (tangential row).

    In space the law has rows along two tangents, with the weights e D and t D. Rows of a tie have
    the same methods.

    Args:
        interface: The contact; its present fields ``now`` are used.
    """

    def __init__(self, interface: Any) -> None:
        self._interface = interface

    def linearized(self) -> Rows:
        """The linearized rows; shapes and units are those of ``Rows``."""
        f: ContactFields = self._interface.now
        o, z, own = f.operators, f.z_u, f.interface.slave.owned
        if o.is_linearized_late:  # with the forces, which are differentiated next
            f.acting.linearize_at(z)
        normal, idle, *weights = self.frame()
        dim, j = normal.shape[1], own[f.acts[own]]
        rhs, by_gap = -normal * o.gap[:, None], np.zeros(normal.shape)
        A_z, blocks = -idle[:, None, None] * np.eye(dim), list[Block]()
        numbers, columns = dim * j[:, None] + np.arange(dim), o.normal_columns()[j]
        for weight, row in zip(weights, f.vector_rows, strict=True):
            if not weight.any():
                continue
            A_z = A_z - weight[:, :, None] * row.by_z[:, None]
            constant = row.residual - np.einsum("ja,ja->j", row.by_z, z)
            rhs += weight * constant[:, None]
            by_gap += weight * row.by_gap[:, None]
            turned = np.einsum("ja,jaq->jq", row.by_normal[j], o.dn[j])
            blocks.append(Block(numbers, columns, -weight[j][:, :, None] * turned[:, None]))
            if row.by_slip.any():
                blocks += [normal_rows(block, -weight) for block in f.slip_derivative(row.by_slip)]
        return Rows([*gap_rows(f, normal, by_gap), *blocks], A_z, rhs)

    def measure(self) -> tuple[float, float]:
        """Size of the nonlinear rows.

        Returns:
            Sum of squares of their left sides as forces [stress^2 length^2], and the largest mean
            gap of an active node over its length [1].
        """
        f: ContactFields = self._interface.now
        o, on, k = f.operators, f.state.active, f.interface.stiffness
        rows = f.law_rows if o.slave.dim == 2 else f.vector_rows  # derivatives are not needed
        sizes = o.diagonal * np.array([row.residual for row in rows[: o.slave.dim]])
        along, opening, gap = sizes[:-1, f.acts], sizes[-1, f.attracted], f.nodal.gap[on]
        forces = np.concatenate([k[on] * gap, opening, along.ravel()])
        largest = np.abs(gap / f.nodal_lengths[on]).max(initial=0.0)
        return float(forces @ forces), float(largest)

    def followed(self) -> Array:
        """Diagonal blocks of the rows of active nodes, divided by their stiffness.

        Plus or minus the dyads of the constrained directions, shape (slave nodes, dim, dim) [1];
        the normal row of an active node has -k n_j . dd_j.
        """
        f: ContactFields = self._interface.now
        n = f.operators.n * f.state.active[:, None]
        return -np.einsum("ja,jb->jab", n, n)

    def frame(self) -> Frame:
        """Weights of the rows at the present state, see ``Frame``."""
        f: ContactFields = self._interface.now
        o, k, active, acts = f.operators, f.interface.stiffness, f.state.active, f.acts
        per_gap = np.where(active, k / np.where(active, o.diagonal, 1.0), 0.0)[:, None]
        of_law = np.where(acts, o.diagonal, 0.0)[:, None]
        opening = np.where(f.attracted, o.diagonal, 0.0)[:, None] * o.n
        along = of_law * np.reshape(f.row_tangents, (-1, *o.n.shape))
        idle = np.where(acts, 0.0, f.nodal_areas)
        if f.closing is None:
            return per_gap * o.n, idle, *along, opening
        by_law = np.where(active, k, 0.0)[:, None]
        return np.zeros_like(o.n), idle, *along, opening, -by_law * o.n

    def weighted(self, frame: Frame) -> Array:
        """Rows weighted by ``frame``, zero at a solution, (slave nodes, dim) [stress length].

        In space the tangential rows are components of one vector.
        """
        f: ContactFields = self._interface.now
        normal, idle, *weights = frame
        rows = normal * f.operators.gap[:, None] - idle[:, None] * f.state.z
        residuals = [row.residual for row in f.vector_rows]
        if f.operators.slave.dim == 3:  # along the tangents of the frame
            R = np.einsum("aj,ajc->jc", residuals[:2], f.row_tangents)
            for i, weight in enumerate(weights[:2]):  # D e or D t, zero where no multiplier acts
                size = np.linalg.norm(weight, axis=1)
                residuals[i] = normal_parts(weight, R) / np.where(size > 0.0, size, 1.0)
        for weight, residual in zip(weights, residuals, strict=True):
            rows = rows - weight * residual[:, None]
        return rows

    def by_motions(self) -> Array:
        """Derivative of the rows by obstacle motions, (slave nodes, dim, m) [stress]."""
        f: ContactFields = self._interface.now
        normal, _, *weights = self.frame()
        rows = np.einsum("ja,jm->jam", normal, f.operators.dgap_dq)
        for weight, row in zip(weights, f.vector_rows, strict=True):
            rows = rows - np.einsum("ja,jm->jam", weight, row_by_motions(f, row))
        return rows


def gap_by_motions(f: ContactFields) -> Array:
    """d(mean gaps)/d(obstacle motions), (slave nodes, m) [1]; zero at uncovered nodes."""
    return f.operators.dgap_dq * f.per_weight[:, None]


def row_by_displacements(
    f: ContactFields, row: VectorRow, *, summed: bool = True
) -> Iterator[Block]:
    """Blocks of the derivative of a row by displacements, rows are slave nodes, of this rank.

    ``summed``: whether its slip is that of the law, or only that of the step.
    """
    o, own = f.operators, f.interface.slave.owned
    turned = o.normal_derivative(row.by_normal)[own]
    yield Block(own[:, None], o.normal_columns()[own], turned[:, None])
    if row.by_gap.any():
        per_weight = row.by_gap * f.per_weight
        for block in o.gap_derivative():
            yield scaled(block, per_weight)
        for block in o.weight_derivative():
            yield scaled(block, -per_weight * f.mean_gap)
    if row.by_slip.any():
        yield from f.slip_derivative(row.by_slip, summed=summed)


def row_by_motions(f: ContactFields, row: VectorRow) -> Array:
    """Derivative of a row by motions of an obstacle, (slave nodes, m) [row / length] (local)."""
    o = f.operators
    change = np.einsum("ja,jam->jm", row.by_normal, o.dn_dq)
    if row.by_gap.any():
        change = change + row.by_gap[:, None] * gap_by_motions(f)
    if row.by_slip.any():
        slip, (count, motions) = f.state.partners.derivative_by_motions(o), change.shape
        parts = row.by_slip.reshape(count, -1), slip.reshape(count, -1, motions)
        change = change + np.einsum("ja,jam->jm", *parts)
    return np.asarray(change)


def change_along(
    f: InterfaceFields, blocks: Sequence[Block], on_slave: Array, on_master: Array
) -> Array:
    """Product of blocks, whose rows are slave nodes, and directions (collective).

    Args:
        f: Fields of the pair.
        blocks: Blocks of this rank.
        on_slave: Displacements of the slave nodes, shape (..., n, dim) [length].
        on_master: Displacements of the master nodes, shape (..., n, dim) [length].

    Returns:
        Shape (..., slave nodes), equal on all ranks.
    """
    sides = f.interface.slave, f.interface.master
    dofs = np.concatenate([side.dofs_of(np.arange(side.num_nodes)) for side in sides])
    several = on_slave.shape[:-2]
    both = [x.reshape(*several, x.shape[-2] * x.shape[-1]) for x in (on_slave, on_master)]
    values, order = np.concatenate(both, axis=-1), np.argsort(dofs)
    change = np.zeros((sides[0].num_nodes, *several))
    for block in blocks:
        index = order[np.searchsorted(dofs[order], np.maximum(block.columns, dofs.min()))]
        direction = np.where(block.columns >= 0, values[..., index], 0.0)
        np.add.at(change, block.rows, np.einsum("bjq,...bq->bj...", block.values, direction))
    return np.moveaxis(sum_over_ranks(sides[0].comm, change), 0, -1)


def gap_rows(f: ContactFields, normal: Array, scaled_tau: Array) -> list[Block]:
    """Rows ``normal`` (slave nodes, dim) dg - ``scaled_tau`` d(g / w) (local).

    Both are zero where no multiplier acts.
    """
    o = f.acting
    if not scaled_tau.any():
        return [normal_rows(block, normal) for block in o.gap_derivative()]
    along = scaled_tau * f.per_weight[:, None]
    blocks = [normal_rows(block, normal - along) for block in o.gap_derivative()]
    mean = along * f.mean_gap[:, None]
    return blocks + [normal_rows(block, mean) for block in o.weight_derivative()]


def normal_rows(block: Block, direction: Array) -> Block:
    """Expand nodal rows to the components of ``direction`` (slave nodes, dim) (local)."""
    count, size = block.rows.shape
    dim = direction.shape[1]
    rows = np.empty((count, dim * size), np.int64)
    values = np.empty((count, dim * size, block.columns.shape[1]))
    expand_rows(direction, *map(np.ascontiguousarray, (block.rows, block.values)), rows, values)
    return Block(rows, block.columns, values)


def next_sets(f: ContactFields, *, start: bool) -> tuple[ContactFields, int]:
    """Active set and branches by the complementarity function (local).

    Nodes in ``state.force_decided`` take the multipliers of their forces, open nodes those of the
    law. Nodes of idle bodies are open.

    Args:
        f: Fields of the present state.
        start: Whether this precedes the first solve, with unknown pressures: touching nodes become
            active, and multipliers that are nan after a failed solve become zero.

    Returns:
        Fields of the new state, and the number of changed nodes.
    """
    before, state, o = f.state, f.state, f.operators
    z = state.z
    if start and not np.isfinite(z).all():
        z = np.where(np.isfinite(z), z, 0.0)
    if state.force_decided is not None:
        presses, force = state.force_decided
        presses = presses & f.covered
        z = np.where(presses[:, None], force / np.where(presses, o.weight, 1.0)[:, None], z)
    if z is not state.z:
        f = f.after(state.replaced(z=z, force_decided=None))
    law, (active, new) = f.interface.pair.law, updated_set(f, start=start)
    resets = bool((active != before.active).any())
    changes = {"active": active} if resets else {}
    if resets or (new != f.state.z).any():
        f = f.after(f.state.replaced(z=new, **changes))
    last = before.branch
    if law.grazes and not law.has_adhesion:
        last, opened = graze_if_peeled(f, before)
        f = f.after(f.state.replaced(opened=opened))
    branch = f.interface.law_calls.branch(f.nodal, last)
    if o.n.shape[1] == 3 and law.has_friction:
        branch, heading = stick_where_turning_back(f, branch, before.heading, start=start)
        f = f.after(f.state.replaced(heading=heading))
    branched = branch != before.branch
    if branched.any():
        f = f.after(f.state.replaced(branch=branch))
    elif not resets:
        return f, 0
    ruled = f.acts if law.bridges_gap else active
    changed = (active != before.active) | (ruled & f.interface.follows_law & branched)
    return f, int(np.count_nonzero(changed))


def graze_if_peeled(f: ContactFields, before: InterfaceState) -> tuple[Branches, Array]:
    """Branches of the last iterate, grazing at nodes that their shear has opened twice (local).

    Their tension was below the shear. Other nodes open and close for other reasons.

    Args:
        f: Fields with the new active set, of a law that ``grazes``.
        before: State of the last iterate.

    Returns:
        Branches, and ``InterfaceState.opened`` [1], shape (slave nodes,) each.
    """
    active = f.state.active
    opened = np.zeros(active.size, np.int64) if before.opened is None else before.opened
    closes = active & ~before.active & (opened % 2 == 0) & (opened > 0)
    way = np.sign(f.nodal.slip) if f.operators.n.shape[1] == 2 else np.ones(active.size)
    kept = np.where(active, before.branch, np.sign(before.branch))
    branch = np.where(closes, GRAZE * way, kept).astype(np.int64)
    n, z = f.operators.n, before.z
    peels = np.linalg.norm(tangential(z, n), axis=1) > -normal_parts(n, z)
    return branch, opened + (before.active & ~active & peels)


def updated_set(f: ContactFields, *, start: bool) -> tuple[Flags, Array]:
    """The active set, and the multipliers, of open nodes by the law (local).

    Nodes with z_n + a > c_n (k / l) g are active; z_n + a = 0 at open nodes under adhesion. A node
    is unchanged if both terms are rounding, of the modulus k or of the largest coordinate.

    Args:
        f: Fields of the present state.
        start: Whether touching nodes are active in any case.

    Returns:
        The active set, shape (slave nodes,), bool, and multipliers, (slave nodes, dim) [stress].
    """
    c, o, gap, a, z = f.interface, f.operators, f.nodal.gap, f.pull.residual, f.state.z
    push = np.where(f.attracted, 0.0, f.z_n + a)
    if c.pair.law.grazes:
        way = np.sign(f.state.branch) * (np.abs(f.state.branch) == GRAZE)
        push = push + way * f.z_tau
    closes = push > f.state.c_n * c.foundation * gap
    largest = np.abs(o.x).max(initial=0.0)
    known = (np.abs(push) > LAST_DIGITS * c.modulus) | (np.abs(gap) > LAST_DIGITS * largest)
    closes = np.where(known, closes, f.state.active)
    if start:
        closes |= gap <= KINK * f.nodal_lengths
    active, opened = f.covered & ~c.set_aside & closes, -a[:, None] * o.n
    if c.pair.law.bridges_gap:
        opened[f.attracted] += tangential(z, o.n)[f.attracted]
    return active, np.where(active[:, None], z, opened)


# Number of times that a node may turn back in a solve before it sticks first. The first time may be
# that of a load that is reversed, which needs no iteration with stick.
MAX_TURNS_BACK = 1


def stick_where_turning_back(
    f: Any, branch: Branches, before: tuple[Array, Array] | None, *, start: bool
) -> tuple[Branches, tuple[Array, Array]]:
    """Branches of nodes in space, with stick for one iteration where sliding turns back (local).

    A node that slides in the direction e with w . e < 0 in the next iterate slides in the opposite
    direction then. With weights c_t (k / l) of the slip that exceed the stiffness of the node, as
    that of corners of facets with nine nodes, it jumps over stick each time, and turns back
    forever. In the plane the two directions are branches of their own, and their cycles are found.

    Args:
        f: Fields in space.
        branch: Branches of the law, shape (slave nodes,), int.
        before: ``InterfaceState.heading`` of the last iterate.
        start: Whether this precedes the first iteration.

    Returns:
        Branches, shape (slave nodes,), and the new heading [1].
    """
    slides = f.acts & (branch != STICK) & (f.directions.size > 0.0)
    count = np.zeros(branch.size) if start or before is None else before[1]
    if not start and before is not None:
        back = slides & (np.einsum("ja,ja->j", f.directions.along, before[0]) < 0.0)
        count = count + back
        stuck = back & (count > MAX_TURNS_BACK)
        branch, slides = np.where(stuck, STICK, branch), slides & ~stuck
    return branch, (np.where(slides[:, None], f.directions.along, 0.0), count)


def adhesion_at_gap(f: ContactFields, gap: Array) -> Array:
    """Adhesion at gaps (slave nodes,) [length], likewise [stress]."""
    return f.interface.law_calls.row("adhesion_at", replace(f.nodal, gap=gap), f.covered).residual


def strength(f: ContactFields, pressure: float) -> tuple[Array, Array]:
    """Admissible contact tractions near a pressure p [stress], each (slave nodes,).

    Returns:
        Slope mu and shear s_0 of the line |z_tau| <= s_0 + mu z_n through the friction limits
        at p and 2 p, an upper bound of a concave limit outside of [p, 2 p]; mu is inf without a
        limit.
    """
    follows_law, ones = f.interface.follows_law, np.ones(len(f.state.z))
    at, beyond = (f.friction_limit(factor * pressure * ones) for factor in (1.0, 2.0))
    unlimited = np.isinf(at + beyond)
    at, beyond = (np.where(unlimited, 0.0, limit) for limit in (at, beyond))
    slope = (beyond - at) / pressure if pressure > 0.0 else np.zeros_like(at)
    shear = np.maximum(at - slope * pressure, 0.0)
    shear = np.where(follows_law & (shear > KINK * at), shear, 0.0)
    slope = np.where(follows_law, np.where(unlimited, np.inf, slope), 0.0)
    return slope, shear


# Cosine of the angle between the normal of a slave node with one prescribed component and the free
# component [1]. Above the first value (20 degrees) the node is on a symmetry plane; below the
# second one it is prescribed along its normal.
PLANE_COSINE, OBLIQUE_COSINE = 0.94, 0.1
# Largest number of changes of a node in one solve. The cover may depend on whether the node carries
# a multiplier; without the limit the iteration might not end.
MAX_CHANGES = 4
# Distance of the cover from MIN_SHARE, over MIN_SHARE [1], within which a node is undecided: the
# cover changes by about this much with the multiplier.
UNDECIDED = 0.1


def normals_on_planes(normals: Array, free: Array) -> Array:
    """Normals of nodes on symmetry planes, nan elsewhere, shape (nodes, dim) [1].

    Args:
        normals: Normals of the undeformed surface, shape (nodes, dim).
        free: 1 where a component of a node is not prescribed, else 0, shape (nodes, dim).
    """
    inside = _cosines(normals, free)
    on_plane = _is_partly_prescribed(free) & (inside > PLANE_COSINE)
    scale = np.where(on_plane, inside, 1.0)[:, None]
    return np.where(on_plane[:, None], normals * free / scale, np.nan)


def _is_partly_prescribed(free: Array) -> Flags:
    """Whether some components of a node are prescribed, and others are not, (nodes,)."""
    count = free.sum(axis=1)
    return (count > 0.0) & (count < free.shape[1])


def _cosines(normals: Array, free: Array) -> Array:
    """Lengths of the parts of normals along the free components, (nodes,) [1]."""
    return np.asarray(np.sqrt(((normals * free) ** 2).sum(axis=1)))


class MultiplierNodes:
    """Slave nodes that may carry multipliers, and those that do; equal on all ranks.

    Not every slave node carries a multiplier. A node with prescribed components whose normal is
    approximately along the free ones lies on a symmetry plane; its normal is set to its part along
    these. Oblique normals are unchanged. A node prescribed along its normal, or in both components,
    carries no multiplier. Neither does the tip of a crack, a node of both faces: its gap is zero.

    The multiplier function of a hardly covered node is added to that of a neighbour. The nodal
    force w_j z_j does not vanish with the weight w_j; z_j would therefore grow without bound as the
    cover vanishes. Row scaling keeps the linear systems regular, but z_j would still be large and
    the active set unstable. An edge pressed by 2 % and slid past 2.5 slave nodes in 40 steps (block
    on block, mean pressure 1.4):

    ==========================  ==========  ================  ================
    41 load steps               friction    handed over       never
    ==========================  ==========  ================  ================
    iterations                  0           129, at most 4    134, at most 6
    largest nodal pressure      0           9.6               671
    iterations                  0.3         132, at most 5    156, at most 12
    largest nodal pressure      0.3         24                5e4
    steps without solution      0.3         0                 2
    ==========================  ==========  ================  ================

    Total forces agree to 0.6 %. A gradual transfer, s Phi_j to the node and (1 - s) Phi_j to its
    neighbour, has no effect: for s > 0 the functions span the original space.

    Args:
        slave: The slave surface.
        normals: Normals of the undeformed surface, shape (slave nodes, dim).
        free: 1 where a component of a slave node is not prescribed, else 0, (slave nodes, dim).
        at_vertices: Whether nodes inside facets have no multipliers.

    Attributes:
        possible: Whether a node carries a multiplier if it is covered, shape (slave nodes,), bool.
        oblique: Whether a node's prescribed components are neither along nor across its normal,
            shape (slave nodes,), bool.
        plane_normals: Normals on symmetry planes, nan elsewhere, shape (slave nodes, dim).
    """

    def __init__(self, slave: Any, normals: Array, free: Array, *, at_vertices: bool) -> None:
        self.plane_normals = normals_on_planes(normals, free)
        on_plane, partly = np.isfinite(self.plane_normals[:, 0]), _is_partly_prescribed(free)
        self.oblique = partly & ~on_plane & (_cosines(normals, free) > OBLIQUE_COSINE)
        self.possible = free.all(axis=1) | on_plane | self.oblique
        if at_vertices:
            self.possible &= ~slave.inner
        # Between two neighbours on a curve both have to be strong; in space the edge of the cover
        # runs along the neighbours, and one is enough.
        self._all_strong = slave.dim == 2
        if slave.dim == 2:
            step = slave.degree if at_vertices else 1
            neighbours = slave.along(np.arange(slave.num_nodes), range(-step, step + 1, 2 * step))
        else:
            neighbours = slave.neighbours
        self._neighbours: Indices = neighbours.T
        self._changes: Indices = np.zeros(slave.num_nodes, np.int64)

    def begin(self) -> None:
        """Reset the counts of changes."""
        self._changes[:] = 0

    def update(self, multiplier_nodes: Flags, cover: Array) -> tuple[Flags, int]:
        """New multiplier nodes, shape (slave nodes,), bool, and number of changed nodes (local).

        Args:
            multiplier_nodes: Present multiplier nodes, shape (slave nodes,), bool.
            cover: Covered fraction of each node, shape (slave nodes,) [1].
        """
        wanted = self.possible & ~(self._helped(cover) & (cover < MIN_SHARE))
        new = np.where(self._changes < MAX_CHANGES, wanted, multiplier_nodes)
        changes = new != multiplier_nodes
        self._changes += changes
        return new, int(changes.sum())

    def undecided(self, cover: Array, active: Flags) -> Indices:
        """Nodes next to active ones whose cover is close to ``MIN_SHARE`` (local).

        Their cover depends on whether they carry a multiplier; there may be two solutions.

        Args:
            cover: Covered fraction of each node, shape (slave nodes,) [1].
            active: Active set, shape (slave nodes,), bool.

        Returns:
            Numbers of the nodes, shape (k,).
        """
        near = self._helped(cover) & (np.abs(cover - MIN_SHARE) < UNDECIDED * MIN_SHARE)
        beside = ((self._neighbours >= 0) & active[self._neighbours]).any(axis=0)
        return np.flatnonzero(near & beside)

    def _helped(self, cover: Array) -> Flags:
        """Nodes that can hand their function over to a neighbour, (slave nodes,).

        The cover of one neighbour is larger by ``MIN_SHARE``, or twice ``MIN_SHARE``, and in the
        plane that of the other one is, too, or it is not covered.
        """
        there, least = self._neighbours >= 0, MIN_SHARE + np.minimum(cover, MIN_SHARE)
        beside = np.where(there, cover[self._neighbours], 0.0)
        strong = there & self.possible[self._neighbours] & (beside > least)
        helped = strong.any(axis=0)
        return helped & (strong | (beside == 0.0)).all(axis=0) if self._all_strong else helped
