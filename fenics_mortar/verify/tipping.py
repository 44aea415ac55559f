# SPDX-License-Identifier: MIT
"""Bodies that pressures on the covered parts of their surfaces cannot balance.

If the resultant of the pressures acts beyond the end of a master, see ``resultant``, the body would
tip over the edge. If an obstacle is sharper than a facet, see ``corners``, nodes on both
sides of its tip support the body sideways. Whether pressures can balance the body is decided by
limit analysis with the rigid motions of floating bodies and the loads on them. Pressures act at the
ends of the segments beside touching nodes instead of at these nodes, on an obstacle at the points
of the facets that touch it. In space they act at the corners of the covered parts of facets, and
bodies that touch on facets that are covered in part are judged. All assumptions overestimate the
limit load: friction is doubled and covers small errors of the normals, nodes that nearly touch are
included, and the ends of segments are moved outward by the distance that causes only a remark;
obstacles touch within this distance.

In space the multiplier of a node beside a facet that is covered in part acts within that part, but
its resultant may act beyond it. Where all facets beside touching nodes are covered wholly, the
limit analysis before the solve has used the same points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.reference import tabulate
from fenics_mortar.interface.space_mortar import SpaceOperators
from fenics_mortar.rigid.body_motions import (
    BodyMotions,
    Touching,
    nearly_touching,
    unresisted_motion,
)
from fenics_mortar.rigid.proximal import RIGID
from fenics_mortar.utils.arrays import TINY, Array, Flags, Indices
from fenics_mortar.verify.certificate import PairCertificate
from fenics_mortar.verify.finding import LIMITS, Finding


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


def points_in_space(
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


def slips_in_space(rates: Array, n: Array) -> Array:
    """Rates (m, p, 3) along two tangents at unit normals ``n`` (p, 3): (p, 2, m) [1] (local)."""
    e = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
    e /= np.linalg.norm(e, axis=1)[:, None]
    return np.stack([np.einsum("mpc,pc->pm", rates, t) for t in (e, np.cross(n, e))], axis=1)


def tipping_bodies(
    bodies: BodyMotions, pairs: Sequence[PairCertificate], pushed: Array | float
) -> list[str]:
    """Describe floating bodies that would tip over an edge (collective).

    Args:
        bodies: The bodies, with the bulk residual and all contacts at the present state.
        pairs: Certificates of the pairs.
        pushed: Forces of the loads at points, (owned dofs,) or 0 [force].

    Returns:
        One message, or an empty list: if all bodies are balanced, if no resultant acts beyond the
        cover, or if a law has adhesion.
    """
    in_space = bodies.bulk.space.dim == 3
    beyond = partly_covered(bodies) if in_space else _beyond(pairs)
    if not (beyond and bodies.bodies) or any(c.pair.law.has_adhesion for c in bodies.contacts):
        return []
    bulk = bodies.bulk
    forces = bulk.r.array_r[: bulk.num_owned] - pushed
    loads = np.concatenate([bodies.resultant(body, forces) for body in bodies.bodies])
    touching = _joined([_touching(bodies, contact, loads) for contact in bodies.contacts])
    motion = unresisted_motion(loads, touching)
    ends = np.cumsum([len(body.motions) for body in bodies.bodies])[:-1]
    found = [
        (body, move)
        for body, move in zip(bodies.bodies, np.split(motion, ends), strict=True)
        if np.abs(move).max() > RIGID.resisted
    ]
    if not found:
        return []
    where = "; ".join(beyond)
    names = bodies.names([body for body, _ in found])
    body, move = max(found, key=lambda each: float(np.abs(each[1]).max()))
    return [
        f"pressures where the surfaces touch cannot balance {names}, as "
        f"{bodies.name_of(body.label)} can {body.describe(move, directed=True)}, but those of the "
        f"solution act elsewhere ({where}): refine the facets there, or take the side that ends "
        "there, or has a corner there, as slave"
    ]


def _beyond(pairs: Sequence[PairCertificate]) -> list[str]:
    """Pairs whose pressures act elsewhere than where the surfaces touch."""
    return [
        f"{pair.pair}: {_described(finding)}"
        for pair in pairs
        for finding in pair.findings
        if finding.name in ("resultant_outside", "obstacle_angle") and finding.verdict == "remark"
    ]


def _described(finding: Finding) -> str:
    """Position of pressures that act elsewhere than where the surfaces touch."""
    if finding.name == "obstacle_angle":
        return f"along the facets at {finding.where}"
    return f"{finding.value:.2f} facets beyond the cover, at {finding.where}"


def _joined(pairs: Sequence[Touching]) -> Touching:
    """Arrays of all pairs, joined."""
    return Touching(*map(np.concatenate, zip(*pairs, strict=True)))


def _touching(bodies: BodyMotions, contact: Contact, loads: Array) -> Touching:
    """Points at which a pair touches, with twice the largest friction of its nodes (collective)."""
    near = contact.active | nearly_touching(contact)
    points = _points if contact.obstacle is None else _points_on_obstacle
    if bodies.bulk.space.dim == 3:
        points = points_in_space
    x, n, slave, master = points(bodies, contact, near)
    n /= np.linalg.norm(n, axis=1)[:, None]
    rates = np.concatenate(
        [
            bodies.displacement(body, x, master) - bodies.displacement(body, x, slave)
            for body in bodies.bodies
        ]
    )
    local = np.einsum("mpc,pc->pm", rates, n), _slips(rates, n)
    opens, slips = (np.concatenate(bodies.bulk.comm.allgather(part)) for part in local)
    weight = contact.operators.weight
    covered = float(weight[near].sum())
    pressure = float(np.abs(loads).sum()) / covered if covered > 0.0 else 0.0
    slope, shear, _ = contact.now.strength(pressure)
    one = np.ones(len(opens))
    largest = 2.0 * float(slope[near].max(initial=0.0)) + LIMITS.negligible
    return Touching(
        opens, slips, largest * one, 2.0 * float((weight * shear)[near].sum()) * one, 0.0 * one
    )


def _slips(rates: Array, n: Array) -> Array:
    """Rates (m, p, dim) along the tangents at ``n`` (p, dim): (p, m) or (p, 2, m) (local)."""
    if n.shape[1] == 3:
        return slips_in_space(rates, n)
    tangent = np.stack([-n[:, 1], n[:, 0]], axis=1)
    return np.asarray(np.einsum("mpc,pc->pm", rates, tangent))


def _points(
    bodies: BodyMotions, contact: Contact, near: Flags
) -> tuple[Array, Array, Indices, Indices]:
    """Find the ends of the segments beside ``near`` nodes, this rank's share (collective).

    Returns:
        Positions (p, 2) [length], directions of the pressure (p, 2), and numbers of the parts of
        slave and master, (p,) each; -1 for an obstacle.
    """
    o, s = contact.operators, contact.intersections()
    beside = near[s.slave].any(axis=1)
    slave, master = s.slave[beside][:, [0, -1]], s.master[beside]
    wider = s.ends[beside] + 2.0 * LIMITS.coarse_distance * np.array([-1.0, 1.0])
    shares = np.stack([0.5 * (1.0 - wider), 0.5 * (1.0 + wider)], axis=2)
    x, n = (np.einsum("sek,skc->sec", shares, field[slave]).reshape(-1, 2) for field in (o.x, o.n))
    of_slave, of_master = bodies.parts_of(contact.slave), bodies.parts_of(contact.master)
    return x, n, np.repeat(of_slave[slave[:, 0]], 2), np.repeat(of_master[master[:, 0]], 2)


def _points_on_obstacle(
    bodies: BodyMotions, contact: Contact, near: Flags
) -> tuple[Array, Array, Indices, Indices]:
    """Find points of the facets beside ``near`` nodes that nearly touch an obstacle (collective).

    The direction is that of the flatter side: of the obstacle, or of the facet where the normals of
    the obstacle at the ends of the facet differ by the angle of a corner. For the rest see
    ``_points``.
    """
    o, s = contact.on_obstacle, contact.intersections()
    at = np.linspace(-1.0, 1.0, 1 + int(np.ceil(2.0 / LIMITS.coarse_distance)))
    gaps = o.sample_gaps(o.x + contact.now.offset[:, None] * o.n, s, at)
    chords = o.x[s.slave[:, -1]] - o.x[s.slave[:, 0]]
    lengths = np.linalg.norm(chords, axis=1)[:, None]
    touches = (gaps <= LIMITS.coarse_distance * lengths) & near[s.slave].any(axis=1)[:, None]
    x, n = (
        np.einsum("pk,ekc->epc", tabulate(at, s.slave.shape[1])[:, 0], field[s.slave])
        for field in (o.x, o.n)
    )
    ends = o.n[s.slave[:, [0, -1]]]
    sharp = (ends[:, 0] * ends[:, 1]).sum(axis=1) < np.cos(LIMITS.corner)
    n[sharp] = (np.stack([chords[:, 1], -chords[:, 0]], axis=1) / lengths)[sharp, None]
    slave = bodies.parts_of(contact.slave)[s.slave[np.nonzero(touches)[0], 0]]
    return x[touches], n[touches], slave, np.full(len(slave), -1)
