# SPDX-License-Identifier: MIT
"""Messages on contacts and ties: overlaps, interference, search radius, ties that do little."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.tied import Tie
from fenics_mortar.kernels.pairing import BEHIND
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import on_any_rank
from fenics_mortar.utils.rounding import SAME_PLACE

# Points of each segment at which surfaces may overlap [1].
POINTS = np.linspace(-1.0, 1.0, 9)


def describe_start(contact: Interface) -> str:
    """Message on an overlap or on missing partners of the present state; "" if not needed.

    An interference that the user prescribed is no overlap, nor is the mean gap of a node that
    touches a curve, negative since dual functions have negative parts. Collective.
    """
    if not isinstance(contact, Contact):
        return ""
    if not contact.covered.any():
        return (
            f"no node of '{contact.slave.name}' faced '{contact.master.name}' before the first "
            f"solve: no partner within {contact.options.radius:.3g} along the normals; the pair "
            f"transmits no force until the surfaces approach"
        )
    overlap = -np.nan_to_num(contact.gap)
    not_prescribed = overlap - _interference(contact)
    j = int(np.argmax(not_prescribed / contact.slave.nodal_lengths))
    if not_prescribed[j] <= SAME_PLACE * contact.slave.nodal_lengths[j]:
        return ""
    if not _overlaps(contact):
        return ""
    return (
        f"'{contact.slave.name}' and '{contact.master.name}' overlap by up to {overlap[j]:.3g} at "
        f"{format_point(contact.operators.x[j])} before the first solve, treated as interference; "
        "initial_gap=0 removes overlaps of the mesh"
        + ", up to half a facet"
        * (contact.pair.initial_gap is not None)
    )


def _overlaps(contact: Contact) -> bool:
    """Whether a point of a facet overlaps by more than the user prescribed (collective)."""
    o, s = contact.operators, contact.intersections()
    if contact.slave.dim == 3:
        gaps = o.smallest_gaps(contact.offset)[0][:, None]
    else:
        gaps = o.sample_gaps(o.x + contact.offset[:, None] * o.n, s, POINTS)
    admitted = _interference(contact) + SAME_PLACE * contact.slave.nodal_lengths
    deep = gaps < -admitted[s.slave].max(axis=1, initial=0.0)[:, None]
    return on_any_rank(contact.slave.comm, bool(deep.any()))


def _interference(contact: Contact) -> Array:
    """Interference of each slave node that the user prescribed, (slave nodes,) [length]."""
    if contact.pair.initial_gap is None:
        return np.maximum(contact.offset, 0.0)
    return np.full(contact.slave.num_nodes, max(-contact.pair.initial_gap, 0.0))


def describe_search_radius(contact: Contact) -> str:
    """Search radius as text."""
    if contact.obstacle is not None:
        return f"up to {contact.options.radius:.3g}"
    return (
        f"up to {contact.options.radius:.3g}, behind the surface at most up to half the thickness "
        "of both bodies"
    )


def describe_overlap(contact: Interface) -> str:
    """Message on the largest overlap of an active node; "" if it is small."""
    if not isinstance(contact, Contact):
        return ""
    sizes, interference = contact.slave.nodal_lengths, _interference(contact)
    overlap = np.where(contact.active, -np.nan_to_num(contact.now.closing_gap) / sizes, 0.0)
    j = int(np.argmax(overlap))
    if overlap[j] <= BEHIND:
        return ""
    depth = overlap[j] * sizes[j]
    if overlap[j] - interference[j] / sizes[j] <= BEHIND:
        return (
            f"'{contact.slave.name}' has an interference of {interference[j]:.3g} "
            f"({interference[j] / sizes[j]:.1f} facets) with '{contact.master.name}' at "
            f"{format_point(contact.operators.x[j])}: increase it in steps, by the offset of the "
            "pair in problem.contacts"
        )
    return (
        f"the node at {format_point(contact.operators.x[j])} of '{contact.slave.name}' overlaps "
        f"'{contact.master.name}' by {overlap[j]:.1f} facets; partners are searched "
        f"{describe_search_radius(contact)}: take smaller steps or, if this is not a contact, set "
        f"search_radius below {depth:.3g}"
    )


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
