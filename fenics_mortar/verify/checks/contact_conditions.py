# SPDX-License-Identifier: MIT
"""Conditions of contact: at the nodes, between them, at nodes without a partner."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.contact.view import describe_search_radius
from fenics_mortar.utils.arrays import HALF_FACET, Array, Flags, first_largest
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import CURVED, LIMITS, POINTS_BETWEEN, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.contact.tied import Tie


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Conditions at the nodes and between them, missed contact, uniqueness (collective).

    Nodes without a partner are those of the slave, and those inside another body, where contact was
    missed. Bodies of the pair alone count. Overlaps with others are crossings, with limits of their
    own: an elastic ground rises a little into a body that lies on it without a pair.
    """
    yield from _between_nodes(measured)
    yield from _at_nodes(measured)
    yield from _without_partner(measured)
    yield from _not_unique(measured)


def _at_nodes(measured: Measured) -> Iterator[Finding]:
    """Tension, shear, overlap and complementarity (local).

    Yields:
        ``tension``: excess of -z_n over the adhesion a, over the largest pressure or tension;
        ``shear``: excess of the tangential multiplier over the friction limit, over the largest
        pressure (or the friction limit, if larger); ``overlap``: largest negative mean gap of a
        slave node over its length; ``complementarity``: largest |(z_n + a) g| over largest pressure
        times length.
    """
    contact, largest, limit = measured.contact, measured.largest_pressure, LIMITS.tolerance
    excess, tension = contact.now.shear_size - measured.friction_limit, contact.now.tension
    gap = contact.now.closing_gap / contact.slave.nodal_lengths
    gap[np.isnan(gap)] = 0.0  # uncovered nodes
    yield Finding(
        "tension", "tension above the adhesion / largest pressure",
        max(float(tension.max()), 0.0) / largest, limit=limit,
    )  # fmt: skip
    yield Finding(
        "shear", "shear above the friction limit / largest pressure",
        max(float(excess.max()), 0.0) / max(largest, float(measured.friction_limit.max())),
        limit=limit,
    )  # fmt: skip
    overlap = max(-float(gap.min()), 0.0)
    where = format_point(contact.operators.x[first_largest(-gap)])
    yield Finding(
        "overlap", "overlap at the nodes", overlap,
        f"overlap {overlap:.1e} (allowed {limit:.1e}) at {where}, in facets; partners are searched "
        f"{describe_search_radius(contact)}",
        limit=limit, unit="facet lengths", where=where,
    )  # fmt: skip
    yield Finding(
        "complementarity", "pressure at open gaps / largest pressure",
        float(np.abs(tension * gap).max()) / largest, limit=limit,
    )  # fmt: skip


def of_tie(tie: Tie) -> Iterator[Finding]:
    """Largest distance of the sides, slave nodes without a partner (local).

    A tied pair carries tension and shear.
    """
    yield Finding(
        "tie_distance", "distance of tied sides",
        float(np.nanmax(tie.gap / tie.slave.nodal_lengths)), limit=LIMITS.tolerance,
        unit="facet lengths",
    )  # fmt: skip
    yield _uncovered(~tie.now.has_partner)


def _between_nodes(measured: Measured) -> Iterator[Finding]:
    """Penetration and distance of the sides between the nodes (collective).

    Yields:
        ``penetration``: largest penetration of a segment over the length of its facet, admitted by
        the discretization between the nodes, of second order in the facet length; ``distance``:
        smallest distance of slave and master over the facet length if a force acts; ``missed``: the
        penetration if none does, as of a tip that enters a facet while the mean gap is open;
        ``idle``: in the plane, the penetration of facets without active nodes if others have some.
    """
    (smallest, where), (idle, where_idle) = _smallest_gaps(measured.contact)
    penetration, is_pressed = max(-smallest, 0.0), measured.contact.active.any()
    distance = max(smallest, 0.0) if is_pressed else 0.0
    yield Finding(
        "penetration", "penetration between the nodes", penetration,
        f"penetration of {penetration:.2f} facets between the nodes, at {where}; finer facets, or "
        f"{CURVED}, reduce it",
        limit=LIMITS.penetration, remark=LIMITS.coarse_penetration, unit="facet lengths",
        where=where,
    )  # fmt: skip
    yield Finding(
        "distance", "distance of sides with contact forces", distance,
        f"a force acts, but the sides are {distance:.2f} facets apart; finer facets of the slave, "
        f"or {CURVED}, reduce the distance",
        limit=LIMITS.penetration, remark=LIMITS.coarse_distance, unit="facet lengths",
    )  # fmt: skip
    missed = 0.0 if is_pressed else penetration
    yield Finding(
        "missed", "penetration of sides without contact forces", missed,
        f"the sides penetrate by {missed:.2g} facets between the nodes, at {where}, but no node of "
        "the pair carries a force: the pressure and the force of this contact are missing "
        "altogether; refine the slave there to facets smaller than what enters, or exchange "
        f"slave and master; of curves that fit each other, take {CURVED}",
        remark=LIMITS.missed, unit="facet lengths", where=where,
    )  # fmt: skip
    idle = max(-idle, 0.0) if is_pressed else 0.0
    yield Finding(
        "idle", "penetration of facets without contact forces", idle,
        f"beside the contact found elsewhere, a part of the master enters an unloaded facet of the "
        f"slave by {idle:.2g} of its length, at {where_idle}: the force of the pair lacks the "
        "share of this place; refine the slave there, or exchange slave and master; of curves that "
        f"fit each other, take {CURVED}",
        remark=LIMITS.coarse_unloaded, unit="facet lengths", where=where_idle,
    )  # fmt: skip


# A gap over the length of its facet, and its position as text.
Place = tuple[float, str]


def _smallest_gaps(contact: Contact) -> tuple[Place, Place]:
    """Smallest gaps of all facets and of those without active nodes, inf for none (collective).

    Facets all of whose nodes are prescribed never have active ones.
    """
    o, s = contact.operators, contact.intersections()
    if contact.slave.dim == 3:
        gaps, at = o.smallest_gaps(contact.now.offset)
        sizes = contact.slave.facet_sizes[o.segments.facets[o.segments.owner]]
        return _deepest(contact, gaps / sizes, at), (np.inf, "")
    ends = o.x[s.slave[:, [0, -1]]]
    gaps = o.sample_gaps(o.x + contact.now.offset[:, None] * o.n, s, POINTS_BETWEEN)
    gaps /= np.hypot(*(ends[:, 1] - ends[:, 0]).T)[:, None]
    of_segments, idle = gaps.min(axis=1), ~contact.active[s.slave].any(axis=1)
    idle &= contact.may_carry[s.slave].any(axis=1)
    middles, of_idle = ends.mean(axis=1), np.where(idle, of_segments, np.inf)
    return _deepest(contact, of_segments, middles), _deepest(contact, of_idle, middles)


def _deepest(contact: Contact, gaps: Array, at: Array) -> Place:
    """The smallest of gaps (n,) at places (n, dim) of all ranks, inf if none is finite."""
    smallest, where = np.inf, ""
    if np.isfinite(gaps).any():
        deepest = first_largest(-gaps)
        smallest, where = float(gaps[deepest]), format_point(at[deepest])
    return min(contact.slave.comm.allgather((smallest, where)))


def _without_partner(measured: Measured) -> Iterator[Finding]:
    """Number of nodes inside another body without a partner in any pair, and of slave nodes."""
    contact, missed = measured.contact, _count_missed(measured)
    steepest = contact.pair.discretization.max_angle
    yield Finding(
        "missed_nodes", "nodes inside another body without a partner", missed,
        f"{missed} nodes are inside another body and have no partner: contact was missed, since "
        f"partners are searched {describe_search_radius(contact)}, on facets whose normals are "
        f"opposite to {steepest:g} degrees; take smaller steps or a larger search_radius, or, if "
        "the edge of a thin wedge is pressed, Discretization(max_angle=...) and the flat side as "
        "slave",
        limit=0,
    )  # fmt: skip
    yield _uncovered(contact.multiplier_nodes & ~contact.covered)


def _uncovered(nodes: Flags) -> Finding:
    return Finding("uncovered", "slave nodes without a partner", int(nodes.sum()))


def _count_missed(measured: Measured) -> int:
    """Count nodes of both surfaces inside a body of the pair, or the obstacle (collective).

    A node with a partner in any pair is no missed contact.
    """
    contact = measured.contact
    of_pair = np.concatenate([contact.slave.nodes, contact.master.nodes])
    inside = np.intersect1d(measured.inside, of_pair)
    found = np.setdiff1d(inside, measured.paired).size
    if contact.obstacle is not None:
        phi = contact.operators.phi - contact.now.offset
        deep = phi < -HALF_FACET * contact.slave.nodal_lengths
        found += int((deep & ~np.isin(contact.slave.nodes, measured.paired)).sum())
    return found


def _not_unique(measured: Measured) -> Iterator[Finding]:
    """Number of redundant sticks, and of nodes just beside the end of the master (local).

    See ``linearized_contact``. Beside the end the cover is close to the threshold of a multiplier.
    """
    contact = measured.contact
    x, count, undecided = contact.operators.x, int(contact.redundant.sum()), contact.undecided
    where = format_point(x[contact.redundant.argmax()])
    yield Finding(
        "redundant", "sticking nodes that other pairs fix as well", count,
        f"{count} sticking nodes are constrained by other pairs as well, one at {where}: their "
        "shear is not unique; it is as close as possible to that of the last state",
        remark=0, where=where if count else "",
    )  # fmt: skip
    where = " and ".join(map(format_point, x[undecided]))
    yield Finding(
        "undecided", "nodes just beside the end of the master", len(x[undecided]),
        f"the master ends just beside the node at {where}, where the multiplier is handed over to "
        "or from the neighbouring node: there may be two solutions, with and without it; other "
        "steps may lead to the other one",
        remark=0, where=where,
    )  # fmt: skip
