# SPDX-License-Identifier: MIT
"""Remarks on ties that do less than a user may expect (local, equal on all ranks)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.errors import format_point


def remarks_on_ties(contacts: Sequence[Contact | Tie], space: DisplacementSpace) -> Iterator[str]:
    """Describe unknowns and nodes that are not tied, and pressures that are not unique.

    Args:
        contacts: All pairs.
        space: The displacement's nodes, and the mixed space.
    """
    ties = [tie for tie in contacts if isinstance(tie, Tie)]
    for tie in ties:
        yield from filter(None, [_other_fields(tie, space), _open_ends(tie)])
        yield from _divided_slaves(tie, [c for c in contacts if isinstance(c, Contact)])


def _other_fields(tie: Tie, space: DisplacementSpace) -> str:
    """Name the unknowns that are not tied; "" if all are."""
    if not space.is_mixed:
        return ""
    tied = (space.part, *tie.pair.fields)
    others = [part for part in range(space.whole.num_sub_spaces) if part not in tied]
    if not others:
        return ""
    numbers = " and ".join(map(str, others))
    return (
        f"{tie.pair!r} does not tie sub-space {numbers} of the mixed function u, which may jump "
        f"there: nothing flows across; with fields={[*tie.pair.fields, *others]} it would"
    )


def _open_ends(tie: Tie) -> str:
    """Describe nodes at which the tie yielded to other pairs; "" if there are none."""
    alone = tie.open_ends
    if not alone.any():
        return ""
    return (
        f"{tie.pair!r} has no multiplier at {alone.sum()} nodes, one at "
        f"{format_point(tie.slave.X[alone.argmax()])}, since other pairs have one there: the joint "
        "may open by a fraction of the displacement of a facet; omit algorithm='condensed', refine "
        "the slaves, or exchange slave and master"
    )


def _divided_slaves(tie: Tie, contacts: Sequence[Contact]) -> Iterator[str]:
    """Describe slaves of two contacts whose masters meet at the end of a joint."""
    for merged, kept in tie.welds():
        here = [c for c in contacts if np.isin((merged, kept), c.master.nodes).any()]
        for i, one in enumerate(here):
            for other in here[i + 1 :]:
                if np.intersect1d(one.slave.nodes, other.slave.nodes).size:
                    where = tie.slave.X[np.flatnonzero(tie.slave.nodes == merged)[0]]
                    yield (
                        f"'{one.slave.name}' is the slave of '{one.master.name}' and of "
                        f"'{other.master.name}', which {tie.pair!r} joins at "
                        f"{format_point(where)}: their pressures may oscillate there; pass both "
                        "masters in one list, which makes them one surface"
                    )
