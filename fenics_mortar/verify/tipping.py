# SPDX-License-Identifier: MIT
"""Bodies that pressures on the covered parts of their surfaces cannot balance.

If the resultant of the pressures acts beyond the end of a master, see ``resultant``, the body would
tip over the edge. This is decided by limit analysis with the rigid motions of floating bodies and
the loads on them. Pressures act at the ends of the segments beside touching nodes instead of at
these nodes. All assumptions overestimate the limit load: friction is doubled, nodes that nearly
touch are included, and the ends of segments are moved outward by the distance that causes only a
remark.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.contact.contact import Contact
from fenics_mortar.rigid.body_motions import BodyMotions
from fenics_mortar.rigid.limit_analysis import Touching, unresisted_motion
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.rigid.responses import nearly_touching, opening, slipping
from fenics_mortar.utils.arrays import Array, Flags
from fenics_mortar.verify.limits import LIMITS
from fenics_mortar.verify.pair_certificate import PairCertificate


def tipping_bodies(bodies: BodyMotions, pairs: Sequence[PairCertificate]) -> list[str]:
    """Describe floating bodies that would tip over an edge (collective).

    Args:
        bodies: The bodies, with the bulk residual and all contacts at the present state.
        pairs: Certificates of the pairs.

    Returns:
        One message, or an empty list: if all bodies are balanced, if no resultant acts beyond the
        cover, or if a law has adhesion.
    """
    beyond = [pair for pair in pairs if pair.outside > LIMITS.coarse_distance]
    if not (beyond and bodies.bodies) or any(c.pair.law.has_adhesion for c in bodies.contacts):
        return []
    bulk = bodies.bulk
    forces = bulk.r.array_r[: bulk.num_owned]
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
    where = "; ".join(
        f"{pair.pair}: {pair.outside:.2f} facets beyond the cover, at {pair.outside_at}"
        for pair in beyond
    )
    names = bodies.names([body for body, _ in found])
    body, move = max(found, key=lambda each: float(np.abs(each[1]).max()))
    return [
        f"pressures on the covered parts of the surfaces cannot balance {names}, as "
        f"{bodies.name_of(body.label)} can {body.describe(move, directed=True)}, but the resultant "
        f"of the pressures acts outside of them ({where}): refine the facets there, or take the "
        "side that ends there as slave"
    ]


def _joined(pairs: Sequence[Touching]) -> Touching:
    """Arrays of all pairs, joined."""
    return Touching(*map(np.concatenate, zip(*pairs, strict=True)))


def _touching(bodies: BodyMotions, contact: Contact, loads: Array) -> Touching:
    """Places at which a pair touches, with twice the largest friction of its nodes (collective)."""
    near = contact.active | nearly_touching(contact)
    if contact.obstacle is not None:
        opens, slips = (
            np.concatenate([rate(bodies, contact, body) for body in bodies.bodies]).T[near]
            for rate in (opening, slipping)
        )
    else:
        parts = [_rates_at_ends(bodies, contact, near, body) for body in bodies.bodies]
        opens, slips = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    weight = contact.operators.weight
    covered = float(weight[near].sum())
    pressure = float(np.abs(loads).sum()) / covered if covered > 0.0 else 0.0
    slope, shear, _ = contact.now.strength(pressure)
    one = np.ones(len(opens))
    largest = 2.0 * float(slope[near].max(initial=0.0))
    return Touching(
        opens, slips, largest * one, 2.0 * float((weight * shear)[near].sum()) * one, 0.0 * one
    )


def _rates_at_ends(
    bodies: BodyMotions, contact: Contact, near: Flags, body: FloatingBody
) -> tuple[Array, Array]:
    """Opening and slip rates at the ends of segments beside ``near`` nodes (collective).

    Returns:
        Rates caused by the motions of the body, both of shape (points, motions) [1].
    """
    o, s = contact.operators, contact.intersections()
    beside = near[s.slave].any(axis=1)
    slave, master = s.slave[beside][:, [0, -1]], s.master[beside]
    wider = s.ends[beside] + 2.0 * LIMITS.coarse_distance * np.array([-1.0, 1.0])
    shares = np.stack([0.5 * (1.0 - wider), 0.5 * (1.0 + wider)], axis=2)
    x, n = (np.einsum("sek,skc->sec", shares, field[slave]).reshape(-1, 2) for field in (o.x, o.n))
    n /= np.linalg.norm(n, axis=1)[:, None]
    moves = np.repeat(bodies.labels_of(contact.slave)[slave[:, 0]] == body.label, 2)
    moves_other = np.repeat(bodies.labels_of(contact.master)[master[:, 0]] == body.label, 2)
    sign = moves_other.astype(float) - moves
    rates = body.displacement(x) * sign[:, None]
    tangent = np.stack([-n[:, 1], n[:, 0]], axis=1)
    local = [np.einsum("mpc,pc->pm", rates, along) for along in (n, tangent)]
    opens, slips = (np.concatenate(bodies.bulk.comm.allgather(part)) for part in local)
    return opens, slips
