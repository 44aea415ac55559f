# SPDX-License-Identifier: MIT
"""Geometric defects of a pair: penetration between the nodes, and nodes without a partner."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import any_over_ranks
from fenics_mortar.utils.rounding import HALF_FACET
from fenics_mortar.verify.limits import LIMITS


def between_nodes(contact: Contact) -> dict[str, Any]:
    """Penetration and distance over facet lengths, as fields of a certificate (collective)."""
    o, s = contact.operators, contact.intersections()
    ends = o.x[s.slave[:, [0, -1]]]
    gaps = o.sample_gaps(o.x + contact.now.offset[:, None] * o.n, s, _samples())
    gaps /= np.hypot(*(ends[:, 1] - ends[:, 0]).T)[:, None]
    smallest, where = np.inf, ""
    if gaps.size:
        deepest = gaps.min(axis=1).argmin()
        smallest, where = float(gaps[deepest].min()), format_point(0.5 * ends[deepest].sum(axis=0))
    smallest, where = min(contact.slave.comm.allgather((smallest, where)))
    return {
        "penetration": max(-smallest, 0.0),
        "distance": max(smallest, 0.0) if contact.active.any() else 0.0,
        "where": where,
    }


@cache
def _samples() -> Array:
    """Points of a segment at which the gap is measured, -1 ... 1, ends included (local)."""
    return np.linspace(-1.0, 1.0, LIMITS.samples)


def paired_nodes(contact: Contact | Tie) -> Indices:
    """Global numbers of the nodes of both surfaces that have a partner, (n,) (collective)."""
    paired = np.zeros(contact.master.num_nodes, bool)
    paired[contact.intersections().master.ravel()] = True
    paired = any_over_ranks(contact.slave.comm, paired)
    return np.concatenate(
        [contact.slave.nodes[contact.now.has_partner], contact.master.nodes[paired]]
    )


def count_unpaired(bulk: Bulk, contact: Contact, labels: Indices, paired: Indices) -> int:
    """Count nodes of both surfaces inside another body or obstacle without a partner (collective).

    Args:
        bulk: The bodies.
        contact: The pair.
        labels: Body of each local node, shape (local nodes,).
        paired: Global numbers of the nodes with a partner in any pair, ascending.
    """
    o = contact.operators
    mine = bulk.space.spread(labels)
    found = 0
    for surface, x in ((contact.slave, o.x), (contact.master, o.m)):
        alone = ~_among(surface.nodes, paired)
        own = surface.gather(mine)[:, 0]
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
