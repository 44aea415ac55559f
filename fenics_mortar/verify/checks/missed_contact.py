# SPDX-License-Identifier: MIT
"""Nodes without a partner, of the slave and inside another body, where contact was missed.

Bodies of the pair alone count. Overlaps with others are crossings, with limits of their own: an
elastic ground rises a little into a body that lies on it without a pair.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.messages import describe_search_radius
from fenics_mortar.contact.tied import Tie
from fenics_mortar.utils.arrays import Flags, Indices
from fenics_mortar.utils.ranks import any_over_ranks
from fenics_mortar.utils.rounding import HALF_FACET
from fenics_mortar.verify.finding import Finding
from fenics_mortar.verify.measured import Measured


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Number of nodes inside another body without a partner in any pair, and of slave nodes."""
    contact, missed = measured.contact, _count_missed(measured)
    yield Finding(
        "missed_nodes",
        "nodes inside another body without a partner",
        missed,
        f"{missed} nodes are inside another body and have no partner: contact was missed, since "
        f"partners are searched {describe_search_radius(contact)}; take smaller steps or a larger "
        "search_radius",
        limit=0,
    )
    yield _uncovered(contact.multiplier_nodes & ~contact.covered)


def of_tie(tie: Tie) -> Iterator[Finding]:
    """Number of slave nodes without a partner (local)."""
    yield _uncovered(~tie.now.has_partner)


def _uncovered(nodes: Flags) -> Finding:
    return Finding("uncovered", "slave nodes without a partner", int(nodes.sum()))


def paired_nodes(contact: Contact | Tie) -> Indices:
    """Global numbers of the nodes of both surfaces that have a partner, (n,) (collective)."""
    paired = np.zeros(contact.master.num_nodes, bool)
    paired[contact.intersections().master.ravel()] = True
    paired = any_over_ranks(contact.slave.comm, paired)
    return np.concatenate(
        [contact.slave.nodes[contact.now.has_partner], contact.master.nodes[paired]]
    )


def _count_missed(measured: Measured) -> int:
    """Count nodes of both surfaces inside a body of the pair, or the obstacle (collective).

    A node with a partner in any pair is no missed contact.
    """
    contact, bulk, paired = measured.contact, measured.bulk, measured.paired
    o, labels = contact.operators, measured.labels
    mine = bulk.space.spread(labels)
    sides = [(s, x, s.gather(mine)[:, 0]) for s, x in ((contact.slave, o.x), (contact.master, o.m))]
    of_pair = np.unique(np.concatenate([own for _, _, own in sides]))
    labels = np.where(np.isin(labels, of_pair), labels, -1)
    found = 0
    for surface, x, own in sides:
        alone = ~_among(surface.nodes, paired)
        inside = bulk.cells.inside_other_body(bulk.positions(), x[alone], own[alone], labels)
        found += int(inside.sum())
    if contact.obstacle is not None:
        phi = contact.on_obstacle.phi - contact.now.offset
        deep = phi < -HALF_FACET * contact.slave.nodal_lengths
        found += int((deep & ~_among(contact.slave.nodes, paired)).sum())
    return found


def _among(nodes: Indices, ascending: Indices) -> Flags:
    """Whether ``nodes`` (n,) are among the numbers ``ascending`` (m,), shape (n,), bool (local)."""
    if not ascending.size:
        return np.zeros(nodes.size, bool)
    at = np.minimum(np.searchsorted(ascending, nodes), ascending.size - 1)
    return np.asarray(ascending[at] == nodes)
