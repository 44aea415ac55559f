# SPDX-License-Identifier: MIT
"""Nodes that several pairs would constrain: which of the pairs has a multiplier there.

A slave node of a tie that belongs to other ties too, where joints meet, has one multiplier at most:
that of the tie which covers most of it. It has none if its motion would then depend on itself: of
the joints around a crosspoint of k bodies k - 1 are independent. The functions without multiplier
are handed over to their neighbours (Wohlmuth 2000).

A slave node of a tie that is a slave of contacts keeps the multiplier of the tie, and the contacts
hand their functions over. If the tie yielded, its joint would open there by a few per cent of the
displacements (by 22 % of an indentation at a joint of 5 facets, instead of 0.2 %).

Nodes that depend on nodes which depend on others cannot be condensed. If the condensed system is
demanded, no tied node at a crosspoint has a multiplier, nor one that belongs to a contact.

Pairs are bound here to the space of the displacement, and tied gaps are removed from the mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import NO_NODES, NO_WELDS, Interface
from fenics_mortar.contact.pair import ContactPair, TiedPair
from fenics_mortar.contact.tied import Tie
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Flags, Indices
from fenics_mortar.utils.errors import SurfaceError
from fenics_mortar.utils.rounding import ROUNDING, SAME_PLACE


def drop_crosspoints(ties: Sequence[Tie]) -> None:
    """Keep one multiplier of each slave node, and none that closes a circle (collective)."""
    used = [tie.nodes for tie in ties]
    others = [_joined(used[:i] + used[i + 1 :]) for i in range(len(ties))]
    shared = [np.isin(tie.slave.nodes, nodes) for tie, nodes in zip(ties, others, strict=True)]
    follows: dict[int, list[int]] = {}
    for tie, excluded in zip(ties, shared, strict=True):
        follows.update(_masters(tie, np.flatnonzero(tie.components.some_carry & ~excluded)))
    candidates: list[tuple[int, int, int]] = []  # by cover in whole units of rounding
    for i, tie in enumerate(ties):
        cover = np.round(tie.operators.cover / tie.slave.full_cover / SAME_PLACE).astype(np.int64)
        mine = np.flatnonzero(shared[i] & tie.components.some_carry)
        candidates += [(-int(cover[j]), i, int(j)) for j in mine]
    for _, i, j in sorted(candidates):
        ((node, masters),) = _masters(ties[i], np.array([j]))
        if node not in follows and not _depends(follows, masters, node):
            follows[node] = masters
            shared[i][j] = False
    for tie, nodes in zip(ties, shared, strict=True):
        tie.drop(nodes)


def drop_shared_multipliers(ties: Sequence[Tie], bound: Sequence[Interface]) -> None:
    """Remove the multipliers of tied nodes that belong to other pairs (collective)."""
    used = [c.nodes for c in bound]
    for tie in ties:
        others = _joined(nodes for nodes, c in zip(used, bound, strict=True) if c is not tie)
        tie.yield_at(np.isin(tie.slave.nodes, others))


def drop_contact_nodes(ties: Sequence[Tie], bound: Sequence[Interface]) -> None:
    """Remove the multipliers of tied nodes that kept one of a contact (collective).

    A contact keeps its multipliers at tied nodes if it had none otherwise.
    """
    kept = _joined(c.slave.nodes[c.may_carry] for c in bound if isinstance(c, Contact))
    for tie in ties:
        tie.yield_at(np.isin(tie.slave.nodes, kept))


def _joined(arrays: Iterable[Indices]) -> Indices:
    return np.concatenate([NO_NODES, *arrays])


def _masters(tie: Tie, slaves: Indices) -> Iterator[tuple[int, list[int]]]:
    """Global slave nodes, and the master nodes that each of them follows."""
    for j in slaves:
        yield int(tie.slave.nodes[j]), tie.masters_of(int(j))


def _depends(follows: dict[int, list[int]], masters: list[int], node: int) -> bool:
    """Whether the motion of some master nodes depends on that of ``node``."""
    seen, stack = set(masters), list(masters)
    while stack:
        new = set(follows.get(stack.pop(), ())) - seen
        seen |= new
        stack += new
    return node in seen


def bind(
    pairs: Sequence[ContactPair | TiedPair],
    space: DisplacementSpace,
    prescribed: Flags,
    *,
    chains: bool = True,
) -> list[Contact | Tie]:
    """Bind all pairs; remove the gaps of tied ones from the mesh (collective).

    Args:
        pairs: The pairs.
        space: Nodes and dofs of the displacement; nodes of the mesh may be moved.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
        chains: Whether nodes may follow nodes that follow others; see ``crosspoints``.

    Returns:
        Contacts and ties in the order of the pairs.

    Raises:
        SurfaceError: On all ranks, if a surface is unsuitable or a gap cannot be removed.
    """
    ties = {pair: Tie(pair, space, prescribed) for pair in pairs if isinstance(pair, TiedPair)}
    every_tie = list(ties.values())
    if chains:
        drop_crosspoints(every_tie)
    tied = _joined(tie.slave.nodes[tie.may_carry] for tie in every_tie) if chains else NO_NODES
    welds = np.concatenate([NO_WELDS, *(tie.welds() for tie in every_tie)])

    def all_bound() -> list[Contact | Tie]:
        return [
            ties[pair]
            if isinstance(pair, TiedPair)
            else Contact(pair, space, prescribed, welds, tied)
            for pair in pairs
        ]

    bound = all_bound()
    (drop_contact_nodes if chains else drop_shared_multipliers)(every_tie, bound)
    return all_bound() if close_gaps(every_tie, space) else bound


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
