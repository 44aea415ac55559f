# SPDX-License-Identifier: MIT
"""Regions of contact that the facets do not resolve: too narrow, or of curves that do not fit.

**Narrow regions.** Few active nodes carry the correct resultant, but width, pressure and approach
are those of the facets. Three active nodes, two facets, are the fewest whose pressure has a maximum
and decreases to both sides: with them the approach of a cylinder is accurate to some per cent.

Regions with a corner or an end of the slave in them are left out, for these determine their extent:
a block that rests on its whole side, of any number of nodes, a punch, an edge that presses. So are
regions between two ends of the master that are a facet apart or more, and below an obstacle with a
radius of less than half a facet, a point support. There the pressure is singular, or does not
matter, on each mesh; ``corners`` judges its direction. A symmetry plane is no
end: the region continues beyond.

**Curves that do not fit.** Between nodes of two conforming curves with different straight facets
there are gaps and overlaps of their sagitta, h^2 / (8 R). If the bodies approach each other by
less, as a shaft in a bush of almost the same radius, the corners carry the force. Measured on such
a shaft, with gaps (root mean square) of 8, 51 and 69 % of the approach, estimated from force and
stiffness: the force is 7, 28 and 20 % too small. With curved cells of order 2 the gaps are below
0.5 %.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks
from fenics_mortar.utils.rounding import HALF_FACET, ROUNDING
from fenics_mortar.verify.checks.corners import facet_angles, runs_of
from fenics_mortar.verify.finding import CURVED, LIMITS, POINTS_BETWEEN, Finding, Measured

IN_PLANE_ONLY = True

# Number of active nodes of a region of contact, below which it is too narrow.
FEWEST_NODES = 3
# Gap between active nodes over the approach of the bodies above which there is a remark [1]: forces
# are 7 % too small.
FACET_GAPS = 0.1
# Number of facets over the width of a region that is advised: with four, pressures of a cylinder
# are accurate to some per cent.
FACETS_OVER_WIDTH = 4


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Force on regions that are too narrow, and gaps of facets that do not fit (collective)."""
    part, regions = _narrow_regions(measured.contact, measured.pressure)
    yield Finding(
        "unresolved_force", "force on regions that the facets do not resolve / normal force", part,
        f"{part:.0%} of the normal forces act on regions that the mesh does not resolve: {regions}",
        remark=LIMITS.at_corners,
    )  # fmt: skip
    gaps, where = _gaps_of_facets(measured.contact, measured.pressure)
    yield Finding(
        "facet_gaps", "gaps between nodes due to facets / approach of the bodies", gaps,
        "facets of the two sides do not fit: between the nodes, most of all at "
        f"{where}, the gap is {gaps:.0%} of the approach of the bodies: forces may be far too "
        f"small, and single pressures far too large; take {CURVED}, or finer facets",
        remark=FACET_GAPS, where=where,
    )  # fmt: skip


def _narrow_regions(contact: Contact, pressure: Array) -> tuple[float, str]:
    """Fraction of the normal forces in regions that are too narrow, and the largest of them.

    Collective.

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    force = np.where(contact.active, np.maximum(pressure, 0.0) * contact.operators.weight, 0.0)
    if not _is_pressed(contact, pressure):
        return 0.0, ""
    facets = _longest_facets(contact)
    found = [
        (float(force[nodes].sum()), text)
        for nodes in _regions(contact)
        if (text := _describe_if_narrow(contact, nodes, facets))
    ]
    carried = sum(part for part, _ in found)
    return (carried / float(force.sum()), max(found)[1]) if found else (0.0, "")


def _is_pressed(contact: Contact, pressure: Array) -> bool:
    """Whether pressures (slave nodes,) [stress] are more than rounding."""
    return float(pressure.max(initial=0.0)) > LIMITS.min_pressure * float(contact.modulus.max())


def _regions(contact: Contact) -> list[Indices]:
    """The slave nodes of each run of active nodes; inner nodes of facets may have no multiplier."""
    slave, active = contact.slave, contact.active
    if contact.at_vertices:
        active = active | (slave.inner & active[slave.previous] & active[slave.following])
    runs = runs_of(contact, active)
    return [np.flatnonzero(active & (runs == run)) for run in np.unique(runs[active])]


def _longest_facets(contact: Contact) -> tuple[Array, Array]:
    """Longest facets at each slave node, and of the master opposite, each (nodes,) (collective)."""
    slave, s, m = contact.slave, contact.intersections(), contact.operators.m
    own, opposite = np.zeros((2, slave.num_nodes))
    np.maximum.at(own, slave.facets, slave.lengths[:, None])
    if contact.obstacle is None:
        chords = np.hypot(*(m[s.master[:, -1]] - m[s.master[:, 0]]).T)
        np.maximum.at(opposite, s.slave, chords[:, None])
        opposite = largest_over_ranks(slave.comm, opposite)
    return own, opposite


def _describe_if_narrow(contact: Contact, nodes: Indices, facets: tuple[Array, Array]) -> str:
    """Describe a region of active ``nodes`` (k,) that is too narrow; "" if it is not."""
    slave, o = contact.slave, contact.operators
    on_plane = np.isfinite(contact.plane_normals).all(axis=1)
    before, after = facet_angles(contact)
    sharp = (after - before > LIMITS.sharp_corner) & ~on_plane
    if sharp[nodes].any() or _is_point_support(contact, nodes, float(facets[0][nodes].max())):
        return ""
    copies = 2 if on_plane[nodes].any() else 1
    active = int(contact.active[nodes].sum())
    count = copies * (active - 1) + 1
    width = copies * float(slave.nodal_lengths[nodes].sum())
    own, opposite = (float(lengths[nodes].max()) for lengths in facets)
    is_narrow = count < FEWEST_NODES or width < own
    beside = np.concatenate([slave.previous[nodes], slave.following[nodes]])
    beside = beside[(beside >= 0) & ~np.isin(beside, nodes)]
    if beside.size and not contact.covered[beside].any():  # between the ends of the master
        width = copies * float(o.cover[nodes].sum())
        is_narrow = width < own * (1.0 - ROUNDING)
    if not is_narrow and width >= opposite * (1.0 - ROUNDING):
        return ""
    names = [slave.name] if is_narrow else []
    names += [contact.master.name] if opposite > 0.0 and contact.master is not slave else []
    sides = " and ".join(f"'{name}'" for name in names)
    many, where = "s" if active > 1 else "", format_point(o.x[nodes].mean(axis=0))
    return (
        f"{active} active node{many} at {where}, {width:.3g} wide "
        f"on facets of {max(own, opposite):.3g}: their resultant is known, but pressure and "
        f"approach are not; refine {sides} there to facets of {width / FACETS_OVER_WIDTH:.2g}, "
        f"{FACETS_OVER_WIDTH} over the width"
    )


def _is_point_support(contact: Contact, nodes: Indices, facet: float) -> bool:
    """Whether the obstacle is round with a radius of less than half a facet at ``nodes`` (k,)."""
    if contact.obstacle is None:
        return False
    slave, n = contact.slave, contact.operators.n
    around = np.concatenate([nodes, slave.previous[nodes], slave.following[nodes]])
    around = around[around >= 0]
    points, normals = contact.on_obstacle.nearest_points()[around], n[around]
    across = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    sines = 0.5 * np.hypot(*(normals[:, None] - normals).transpose(2, 0, 1))
    i, j = np.unravel_index(int(np.argmax(sines)), sines.shape)
    return bool(across[i, j] < 2.0 * HALF_FACET * facet * sines[i, j])


def _turns_of(surface: Curve) -> Array:
    """Angles between the undeformed facets at each node, 90 degrees at ends, (nodes,) [radian]."""
    X, before, after = surface.X, surface.previous, surface.following
    chords = np.stack([X - X[before], X[after] - X], axis=1)
    cross = chords[:, 0, 0] * chords[:, 1, 1] - chords[:, 0, 1] * chords[:, 1, 0]
    turns = np.abs(np.arctan2(cross, (chords[:, 0] * chords[:, 1]).sum(axis=1)))
    return np.where((before < 0) | (after < 0), 0.5 * np.pi, turns)


def _sagittas(surface: Curve) -> Array:
    """Sagittas of curves through the undeformed facets at each node, (nodes,) [length]."""
    turns = _turns_of(surface)
    return np.where(turns < LIMITS.sharp_corner, turns, 0.0) * surface.nodal_lengths / 8.0


def _gaps_of_facets(contact: Contact, pressure: Array) -> tuple[float, str]:
    """Gaps of either sign between active nodes over the approach of the bodies (collective).

    Gaps are those of curved surfaces, at most the sagitta of their facets; larger ones are due to
    the deformation. The approach is estimated as force over stiffness. Where offsets remove gaps
    of the mesh, those between nodes exert no forces.

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].

    Returns:
        Their root mean square over the approach [1], zero without pressure; where they are largest.
    """
    slave, o, s = contact.slave, contact.operators, contact.intersections()
    if not _is_pressed(contact, pressure) or contact.offset.any():
        return 0.0, ""
    approach = float(np.maximum(pressure, 0.0) @ slave.nodal_lengths) / float(contact.modulus.max())
    gaps = o.sample_gaps(o.x + contact.now.offset[:, None] * o.n, s, POINTS_BETWEEN)
    # gaps of active nodes are not zero under a law with a closing gap
    known = np.abs(np.where(contact.active, np.nan_to_num(contact.gap), 0.0)).max(initial=0.0)
    curved = _sagittas(slave)[s.slave].max(axis=1)
    curved = np.maximum(curved, _sagittas(contact.master)[s.master].max(axis=1, initial=0.0))
    due_to_facets = np.minimum(np.maximum(np.abs(gaps) - known, 0.0), curved[:, None])
    squares = (due_to_facets**2).mean(axis=1)
    inside = contact.active[s.slave].all(axis=1)
    ends = o.x[s.slave[:, [0, -1]]]
    sizes = 0.5 * np.ptp(s.ends, axis=1) * np.hypot(*(ends[:, 1] - ends[:, 0]).T) * inside
    sums = sum_over_ranks(slave.comm, [sizes @ squares, sizes.sum()])
    if not sums[0] > 0.0:
        return 0.0, ""
    largest, where = 0.0, ""
    if inside.any():
        first = int(np.argmax(np.where(inside, squares, 0.0)))
        largest, where = float(squares[first]), format_point(ends[first].mean(axis=0))
    _, where = max(slave.comm.allgather((largest, where)))
    return float(np.sqrt(sums[0] / sums[1])) / approach, where
