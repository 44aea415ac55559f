# SPDX-License-Identifier: MIT
"""Points in space at which pairs touch, for bodies that would tip over an edge; see ``tipping``.

The multiplier of a node beside a facet that is covered in part acts within that part, but its
resultant may act beyond it. Where all facets beside touching nodes are covered wholly, the limit
analysis before the solve has used the same points.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.rigid.body_motions import BodyMotions
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.rounding import TINY
from fenics_mortar.verify.finding import LIMITS


def partly_covered(bodies: BodyMotions) -> list[str]:
    """Pairs of floating bodies with facets that are covered in part and carry force (collective).

    Args:
        bodies: The bodies, with all contacts at the present state.
    """
    found = []
    for contact in bodies.contacts if bodies.bodies else ():
        o = contact.operators
        if not isinstance(o, SpaceOperators):
            continue
        beside = contact.active[o.facet_nodes].any(axis=1)
        mine = int((beside & _partly(o)).sum())
        if bodies.bulk.comm.allreduce(mine):
            sides = f"'{contact.pair.slave_name}' - '{contact.pair.master_name}'"
            found.append(f"{sides}: beside facets that are covered in part")
    return found


def _partly(o: SpaceOperators) -> Flags:
    """Facets of this share of which a part has no partner, but not the whole, (f,) (local)."""
    return ~o.moments.complete & o.moments.De.any(axis=1)


def points(
    bodies: BodyMotions, contact: Contact, near: Flags
) -> tuple[Array, Array, Indices, Indices]:
    """Find the points of a pair beside ``near`` nodes, this rank's share (collective).

    On facets that are covered in part these are the corners of the covered parts, moved outward by
    the distance that causes only a remark; else, and on obstacles, the nodes.

    Returns:
        Positions (p, 3) [length], directions of the pressure (p, 3), and numbers of the bodies of
        slave and master, (p,) each; -1 for an obstacle.
    """
    of_slave, of_master = bodies.parts_of(contact.slave), bodies.parts_of(contact.master)
    o, own = contact.operators, contact.slave.owned
    if not isinstance(o, SpaceOperators):
        j = own[near[own]]
        return o.x[j], o.n[j], of_slave[j], np.full(j.size, -1)
    s, beside = o.segments, near[o.facet_nodes].any(axis=1)
    pair, shares = o.covered_corners(beside & _partly(o))
    x, n = (np.einsum("ck,ckd->cd", shares, field[s.slave[pair]]) for field in (o.x, o.n))
    x = x + _outward(x, pair, contact.slave.facet_sizes[s.facets[s.owner[pair]]])
    whole = np.flatnonzero(beside & o.moments.complete)
    j, first = o.facet_nodes[whole].ravel(), np.repeat(s.offsets[whole], s.slave.shape[1])
    pair = np.concatenate([pair, first])
    bodies_at = of_slave[s.slave[pair, 0]], of_master[s.master[pair, 0]]
    return np.concatenate([x, o.x[j]]), np.concatenate([n, o.n[j]]), *bodies_at


def _outward(x: Array, pair: Indices, sizes: Array) -> Array:
    """Motions of corners ``x`` (c, 3) away from the middle of those of their pair (local).

    Args:
        x: Positions [length].
        pair: Numbers of their pairs, shape (c,).
        sizes: Sizes of their facets, shape (c,) [length].
    """
    _, pair, count = np.unique(pair, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(pair, column, count.size) for column in x.T], axis=1)
    away = x - (sums / count[:, None])[pair]
    lengths = np.linalg.norm(away, axis=1)
    return LIMITS.coarse_distance * (sizes / np.maximum(lengths, TINY))[:, None] * away


def slips(rates: Array, n: Array) -> Array:
    """Rates (m, p, 3) along two tangents at unit normals ``n`` (p, 3): (p, 2, m) [1] (local)."""
    e = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
    e /= np.linalg.norm(e, axis=1)[:, None]
    return np.stack([np.einsum("mpc,pc->pm", rates, t) for t in (e, np.cross(n, e))], axis=1)
