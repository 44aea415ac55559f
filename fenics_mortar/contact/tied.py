# SPDX-License-Identifier: MIT
"""Tied pairs, and the binding of all pairs to a mesh.

``Tie`` is a tied pair bound to the space of the displacement. ``bind`` binds all pairs: it chooses
the pair that has a multiplier at nodes that several would constrain, and removes gaps of ties from
the mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csc_array, csr_array, diags, eye
from scipy.sparse.linalg import spsolve

from fenics_mortar.contact import interface, tied_rows
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.pair import ContactPair, TiedPair
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.utils.arrays import HALF_FACET, LAST_DIGITS, ROUNDING, SAME_PLACE, SUM_ROUNDING
from fenics_mortar.utils.errors import SurfaceError, format_point

if TYPE_CHECKING:
    from fenics_mortar.interface.mortar import Block, Linearization
    from fenics_mortar.interface.outline import Outline
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices


def _refuse_offset(_: Any, lengths: Any) -> None:
    raise ValueError("a tied pair has no offset: its gap is that of TiedPair(gap=...)")


class Tie(interface.Interface):
    """One tied pair of surfaces with nonmatching meshes, bound to a displacement space; replicated.

    With D and M of the reference configuration, the slave's displacement follows the master's,

        sum_k D[j, k] u_k - sum_l M[j, l] u_l = 0    for every multiplier node j,

    in all components; for further fields see ``tied_rows``. If a jump is prescribed, u_l is the sum
    of the displacement of the master and the jump; if the sides are at a distance, as those of a
    periodic cell, X_m below is the position translated onto the slave. The constraint is linear.
    With linear bulk the matrix of the whole system is constant, and elimination of the slave by u_s
    = D^-1 M u_m results in the symmetric matrix Q^T K Q.

    If also D X_s = M X_m, which ``close_gaps`` ensures, the constraint holds for current positions:
    rigid motions are free of stress, and the torques of D^T z and M^T z cancel to rounding (Puso
    2004). Otherwise the gap vector g = D X_s - M X_m of a faceted curve remains and does not
    rotate: a rotation by an angle a strains the bodies by about a |g| over their size, and the
    torques of the two sides differ by g x z.

    A node that is prescribed, or constrained by another pair, would be constrained twice. It
    carries no multiplier, and its function is handed over to its neighbours (Wohlmuth 2000), so
    that constants are reproduced on the whole interface. See ``bind`` where joints meet or end at
    contact.

    Attributes:
        D: Slave matrix, rows of multiplier nodes only, (slave nodes, slave nodes) [length].
        M: Master matrix, rows of multiplier nodes only, (slave nodes, master nodes) [length].
        jump: D u_s - M (u_m + jump) at the last evaluated displacement, shape (slave nodes, dim)
            [length^2].
        displacement: The displacement's part of the tie.
        fluxes: The tied fields.
        parts: The displacement and these.
        open_ends: Slave nodes whose multiplier yielded to that of another pair, (slave nodes,).
    """

    now: tied_rows.TiedFields
    rows: tied_rows.TiedRows
    fluxes: list[tied_rows.TiedField]
    components: tied_rows.TiedComponents

    _kind = tied_rows.TiedFields

    jump = interface.read_only("now.jump")
    D, M = interface.read_only("displacement.D"), interface.read_only("displacement.M")
    offset = interface.settable("offset", _refuse_offset)

    def __init__(self, pair: TiedPair, space: DisplacementSpace, prescribed: Flags) -> None:
        """Extract the surfaces and integrate D and M (collective)."""
        super().__init__(pair, space, prescribed)
        self.master = replace(self.master, X=self.master.X + pair.translation)
        self.rows, self.arm = tied_rows.TiedRows(self), 0.0
        self._yielded = np.zeros(self.slave.num_nodes, bool)
        self.open_ends = np.zeros(self.slave.num_nodes, bool)
        longest = max(float(side.facet_sizes.max()) for side in (self.slave, self.master))
        points = interface.points_per_segment(pair, self.slave, self.master)
        radius = pair.search_radius or HALF_FACET * longest
        options = pair.discretization.options(self.basis, points, radius)
        self.options = replace(options, gap_weights="basis")
        dim = self.slave.dim
        self.change(z=np.zeros((self.slave.num_nodes, dim + len(pair.fields))))
        sides = [(side, side.dofs) for side in (self.slave, self.master)]
        every_node = np.arange(self.slave.num_nodes)
        free, components = self.free.all(axis=1), np.arange(dim)
        self.displacement = tied_rows.TiedPart(self, components, sides, every_node, free)
        self.all_fluxes = self.fluxes = [
            tied_rows.TiedField(field, c, self, space, prescribed)
            for c, field in enumerate(pair.fields, dim)
        ]
        self.parts = [self.displacement, *self.fluxes]
        self.components = tied_rows.TiedComponents(self)
        self._integrate()

    def _periodic(self, translation: Array) -> str:
        """Advice for sides of the same size, which may be those of a periodic cell (local)."""
        low, high = (
            np.array([getattr(side.X, end)(axis=0) for side in (self.slave, self.master)])
            for end in ("min", "max")
        )
        size = high - low
        if np.abs(size[0] - size[1]).max() > HALF_FACET * float(self.slave.facet_sizes.max()):
            return ""
        period = translation + 0.5 * (low[0] + high[0] - low[1] - high[1])
        rounding = SUM_ROUNDING * float(np.abs([low, high]).max())
        period = np.where(np.abs(period) > rounding, period, 0.0)
        vector = ", ".join(f"{x:.6g}" for x in period)
        return f", or, for the two sides of a periodic cell, take translation=({vector})"

    def drop(self, nodes: Flags) -> None:
        """Remove the multipliers of ``nodes`` (slave nodes,), bool, also of fields (collective).

        Raises:
            SurfaceError: On all ranks, if no multiplier is left.
        """
        self._yielded = self._yielded | nodes
        if (nodes & (self.multiplier_nodes | self.components.some_carry)).any():
            self._integrate()

    def _integrate(self) -> None:
        """Integrate D and M at the reference positions (collective).

        Raises:
            SurfaceError: On all ranks, if no multiplier is left.
        """
        part = self.displacement
        part.integrate(self._yielded)
        if not part.active.any():
            raise SurfaceError(
                f"slave '{self.slave.name}' and master '{self.master.name}' {self._why_untied()}"
            )
        self.set_operators(tied_rows.tied_operators(part.operators, np.zeros(self.z.shape)))
        self.may_carry = part.active
        self.change(active=part.active, multiplier_nodes=part.multiplier_nodes)
        for field in self.fluxes:
            field.integrate(self._yielded)
        self.components.read()

    def _why_untied(self) -> str:
        """Why no node has a multiplier of the displacement, in words (collective)."""
        part = self.displacement
        covered = part.evaluated(part.candidates).cover > 0.0
        if part.candidates.any() and not covered.any():
            return (
                f"are farther apart than {self.options.radius:.3g} everywhere: "
                f"increase search_radius{self._periodic(self.pair.translation)}"
            )
        named = covered & (~part.candidates | self._yielded)
        why = "is prescribed or belongs to another pair"
        if covered.any() and not named.any():
            named, why = covered, f"faces it on less than {100.0 * MIN_SHARE:.0f} % of its facets"
        return (
            f"cannot be tied: every slave node that has a partner {why}, for example the one at "
            f"{format_point(self.slave.X[np.argmax(named)])}; exchange slave and master, or refine "
            "the slave"
        )

    @property
    def nodes(self) -> Indices:
        """Global numbers of the tied nodes of both sides, shape (k,)."""
        own = self.slave.nodes[self.now.has_partner]
        return np.concatenate([own, *(part.nodes for part in self.parts)])

    def masters_of(self, node: int) -> list[int]:
        """Global numbers of the master nodes that a slave node follows (local)."""
        return np.concatenate([part.masters_of(node) for part in self.parts]).tolist()

    def welds(self) -> Indices:
        """Coinciding ends of slave and master: global nodes, shape (k, 2).

        Where a joint ends at a contact surface, the corners of the two bodies are merged into one
        node, that of the master. The contact surface is then continuous across the joint.

        None at a distance, and none in space.
        """
        if self.pair.translation.any() or self.slave.dim == 3:
            return interface.NO_WELDS
        sides = self.slave, self.master
        ends = [np.flatnonzero((side.previous < 0) | (side.following < 0)) for side in sides]
        gaps = self.slave.X[ends[0], None] - self.master.X[ends[1]]
        near = np.linalg.norm(gaps, axis=2) < SAME_PLACE * self.slave.nodal_lengths[ends[0], None]
        j, l = np.nonzero(near)
        return np.stack([self.slave.nodes[ends[0][j]], self.master.nodes[ends[1][l]]], axis=1)

    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate jump, positions and normals at ``u``, shape (local dofs,) (collective)."""
        values, jumps = [part.gather(u) for part in self.parts], np.zeros(self.z.shape)
        values[0][1] += self.pair.present_jump()
        for part, (on_slave, on_master) in zip(self.parts, values, strict=True):
            jumps[np.ix_(part.at, part.components)] = part.D @ on_slave - part.M @ on_master
        x, m = self.slave.X + values[0][0], self.master.X + values[0][1]
        n, dn = evaluate_normals(self.slave, x, self.options.weighting)
        self.set_operators(replace(self.operators, x=x, m=m, n=n, dn=dn, weighted_jump=jumps))

    @property
    def partner_operators(self) -> Any:
        """Operators with the nodes at their reference positions."""
        n, _ = evaluate_normals(self.slave, self.slave.X, self.options.weighting)
        return replace(self.operators, x=self.slave.X, m=self.master.X, n=n)

    def intersections(self) -> Any:
        """Intersections of this rank's slave facets with the master."""
        return self.operators.segments

    def close_gap(self, space: DisplacementSpace) -> float:
        """Move active nodes such that D X_s = M X_m (collective).

        Returns:
            The largest motion over the size of the surface, 0 if it is rounding [1].
        """
        on, slave = self.active_nodes, self.slave
        take = self._followers()[:, on]
        gap = (self.M @ self.master.X - self.D @ slave.X)[on]
        change = spsolve(csc_array((self.D @ take)[on]), gap).reshape(-1, slave.dim)
        X, moved = slave.X + take @ change, np.unique(take.nonzero()[0])
        size = slave.extent + np.abs(slave.X).max()
        motion = float(np.abs(X - slave.X).max() / size)
        if motion <= LAST_DIGITS:
            return 0.0
        space.move_nodes(slave.nodes[moved], X[moved])
        return motion

    def _followers(self) -> csr_array:
        """Motions of slave nodes by those of others (slave nodes, slave nodes) [1].

        Where multipliers are at corners alone, these take the other nodes of their facets along.
        """
        own = eye(self.slave.num_nodes)
        if not (self.slave.dim == 3 and self.at_vertices):
            return csr_array(own)
        return csr_array(self.slave.from_corners + diags(self.slave.inner.astype(float)))

    def update_reference(self, space: DisplacementSpace) -> None:
        """Update the reference positions from the mesh (collective)."""
        X = space.positions()
        self.slave = replace(self.slave, X=self.slave.gather(X))
        self.master = replace(self.master, X=self.master.gather(X) + self.pair.translation)

    def force_blocks(self) -> list[Block]:
        """B^T, see ``Interface``; constant."""
        return self.displacement.blocks

    def limit_sight(self, outline: Outline) -> Outline:
        """Store the outlines of the bodies; tied facets do not limit the search."""
        for side in (self.slave, self.master):
            outline = outline.without(side, self.nodes)
        return outline

    def update_active(self, *, start: bool = False) -> int:
        """All multiplier nodes stay active; return 0.

        With ``start``, multipliers that are not finite are set to zero.
        """
        if start:
            self.change(z=np.where(np.isfinite(self.z), self.z, 0.0))
        return 0


def drop_crosspoints(ties: Sequence[Tie]) -> None:
    """Keep one multiplier of each slave node, and none that closes a circle (collective).

    A slave node of a tie that belongs to other ties too, where joints meet, has one multiplier at
    most: that of the tie which covers most of it. It has none if its motion would then depend on
    itself: of the joints around a crosspoint of k bodies k - 1 are independent. The functions
    without multiplier are handed over to their neighbours (Wohlmuth 2000).
    """
    used = [tie.nodes for tie in ties]
    others = [_joined(used[:i] + used[i + 1 :]) for i in range(len(ties))]
    shared = [np.isin(tie.slave.nodes, nodes) for tie, nodes in zip(ties, others, strict=True)]
    follows: dict[int, list[int]] = {}
    for tie, excluded in zip(ties, shared, strict=True):
        mine = np.flatnonzero(tie.components.some_carry & ~excluded)
        follows.update({int(tie.slave.nodes[j]): tie.masters_of(j) for j in mine})
    candidates: list[tuple[int, int, int]] = []  # by cover in whole units of rounding
    for i, tie in enumerate(ties):
        mine = np.flatnonzero(shared[i] & tie.components.some_carry)
        cover = np.round(tie.operators.cover[mine] / tie.slave.full_cover[mine] / SAME_PLACE)
        candidates += [(-int(c), i, int(j)) for c, j in zip(cover, mine, strict=True)]
    for _, i, j in sorted(candidates):
        node, masters = int(ties[i].slave.nodes[j]), ties[i].masters_of(j)
        if node not in follows and not _depends(follows, masters, node):
            follows[node] = masters
            shared[i][j] = False
    for tie, nodes in zip(ties, shared, strict=True):
        tie.drop(nodes)


def drop_nodes_of_others(
    ties: Sequence[Tie], bound: Sequence[interface.Interface], *, chains: bool
) -> None:
    """Remove multipliers of tied nodes that belong to other pairs: joints may open (collective).

    With chains only where a contact kept its multipliers, since it had none otherwise.
    """
    pairs = [c for c in bound if isinstance(c, Contact) or not chains]
    used = [c.slave.nodes[c.may_carry] if chains else c.nodes for c in pairs]
    for tie in ties:
        others = _joined(nodes for nodes, c in zip(used, pairs, strict=True) if c is not tie)
        nodes = np.isin(tie.slave.nodes, others)
        tie.open_ends = nodes & tie.may_carry
        tie.drop(nodes)


def _joined(arrays: Iterable[Indices]) -> Indices:
    return np.concatenate([interface.NO_NODES, *arrays])


def _depends(follows: dict[int, list[int]], masters: list[int], node: int) -> bool:
    """Whether the motion of some master nodes depends on that of ``node``."""
    seen, stack = set(masters), list(masters)
    while stack:
        new = set(follows.get(stack.pop(), ())) - seen
        seen |= new
        stack += new
    return node in seen


def bind(
    pairs: Sequence[ContactPair | TiedPair], space: DisplacementSpace, prescribed: Flags,
    *, chains: bool = True,
) -> list[Contact | Tie]:  # fmt: skip
    """Bind all pairs; remove the gaps of tied ones from the mesh (collective).

    Of several pairs that would constrain a node, one has a multiplier there. Among ties see
    ``drop_crosspoints``. A slave node of a tie that is a slave of contacts keeps the multiplier of
    the tie, and the contacts hand their functions over. If the tie yielded, its joint would open
    there by a few per cent of the displacements (by 22 % of an indentation at a joint of 5 facets,
    instead of 0.2 %).

    Nodes that depend on nodes which depend on others cannot be condensed. If the condensed system
    is demanded, no tied node at a crosspoint has a multiplier, nor one that belongs to a contact.

    Args:
        pairs: The pairs.
        space: Nodes and dofs of the displacement; nodes of the mesh may be moved.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
        chains: Whether nodes may follow nodes that follow others.

    Returns:
        Contacts and ties in the order of the pairs.

    Raises:
        SurfaceError: On all ranks, if a surface is unsuitable or a gap cannot be removed.
    """
    ties = {pair: Tie(pair, space, prescribed) for pair in pairs if isinstance(pair, TiedPair)}
    every_tie = list(ties.values())
    if chains:
        drop_crosspoints(every_tie)
    tied = _joined(tie.slave.nodes[tie.may_carry] for tie in every_tie if chains)
    welds = np.concatenate([interface.NO_WELDS, *(tie.welds() for tie in every_tie)])

    def all_bound() -> list[Contact | Tie]:
        return [
            ties[pair]
            if isinstance(pair, TiedPair)
            else Contact(pair, space, prescribed, welds, tied)
            for pair in pairs
        ]

    bound = all_bound()
    drop_nodes_of_others(every_tie, bound, chains=chains)
    if close_gaps(every_tie, space):
        bound = all_bound()
    for contact in bound:
        if isinstance(contact, Contact):
            _show_across_ties(contact, every_tie)
    return bound


def _show_across_ties(contact: Contact, ties: Sequence[Tie]) -> None:
    """Show at slave nodes of ties without multiplier the fields of the node across (local).

    Contact on both sides of the tie belongs to the multiplier of that node. At a corner where ties
    in several directions meet, the node across is the slave of another tie.
    """
    slave, nodes, carries = contact.slave, contact.slave.nodes, contact.may_carry
    own = np.arange(slave.num_nodes)
    shown = own.copy()
    for tie in ties:
        alone = np.flatnonzero(~carries & np.isin(nodes, tie.slave.nodes))
        across = np.flatnonzero(np.isin(nodes, tie.master.nodes))
        across = across[np.argsort(carries[across], kind="stable")]  # the last one remains
        ways = slave.X[alone, None] - slave.X[across] - tie.pair.translation
        i, j = np.nonzero((ways**2).sum(axis=2) <= (SAME_PLACE * slave.extent) ** 2)
        still = ~carries[shown[alone[i]]]  # not found by a tie before
        shown[alone[i][still]] = across[j][still]
    for _ in ties:
        shown = shown[shown]
    alone = np.flatnonzero((shown != own) & carries[shown])
    pairs = zip(contact.substitutes, (alone, shown[alone]), strict=True)
    contact.substitutes = tuple(np.concatenate(both) for both in pairs)


def close_gaps(ties: Sequence[Tie], space: DisplacementSpace) -> bool:
    """Move slave nodes of ties with gap="removed" onto their masters (collective).

    D and M remain those of the initial positions; the new positions satisfy their constraints.
    Several sweeps are needed, since a master may be the slave of another tie.

    Returns:
        Whether a node was moved.

    Raises:
        SurfaceError: If the mesh cannot represent the new positions.
    """
    closing = [tie for tie in ties if tie.pair.gap == "removed"]
    motions = [0.0]
    for sweep in range(len(closing) + 2):
        motions = [tie.close_gap(space) for tie in closing]
        if not any(motions):
            return sweep > 0
        for tie in ties:
            tie.update_reference(space)
    if max(motions) <= ROUNDING:
        return True  # of plane interfaces, at nodes that the mesh cannot move
    widest = closing[int(np.argmax(motions))]
    raise SurfaceError(
        f"the gap of {widest.pair} cannot be removed: straight cells with a displacement of "
        f"degree 2 cannot represent a curved interface; use a mesh of second order, or gap='kept'"
    )
