# SPDX-License-Identifier: MIT
"""Regions of contact in space that the facets do not resolve; ``resolution`` is that of the plane.

As in the plane, three active nodes across a region are the fewest whose pressure has a maximum and
decreases to all sides: one node of the region is surrounded by active nodes. So are regions that
are narrower than the facets of the master.

A node at the rim of the surface has neighbours on one side only. Regions most of whose nodes are at
the rim, at a corner or at a sharp edge of the slave are left out, since their extent is that of the
edge: there the pressure is singular on each mesh.

**Forces across openings.** A dual function is negative on a part of its facets. Where the other
side bends away within a facet that is longer than the region of contact, the mean gap of an open
node may vanish, and the node carries a force far beyond the contact. Measured on spheres and
crossed cylinders, with the mean gap of the loaded nodes over the approach, estimated from force and
stiffness: up to 2.4 where pressures are accurate to 10 %; 4 to 15 with errors of 15 to 70 % on
six-node triangles; 36 and 100 where the force is 2.7 and 4.3 times the right one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.faces import CORNERS, Faces
from fenics_mortar.interface.nearest_points import nearest_on_master
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import largest_over_ranks
from fenics_mortar.utils.rounding import HALF_FACET, ROUNDING, TINY
from fenics_mortar.verify.checks.resolution import FACETS_OVER_WIDTH
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

IN_SPACE_ONLY = True

# Gap at nodes with forces over the approach of the bodies above which there is a remark [1]; the
# approach may be underestimated by a factor of two.
OPENING = 2.5


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Force on regions that are too narrow (collective)."""
    opening, where = _opening(measured)
    yield Finding(
        "openings", "gaps at nodes with forces / approach of the bodies", opening,
        f"nodes carry forces where the surfaces are apart, most of all at {where}: on average by "
        f"{opening:.2g} times the approach of the bodies. Forces may be far too large; "
        f"refine '{measured.contact.slave.name}' beside the contact, or take "
        "Discretization(gap_weights='standard')",
        remark=OPENING, where=where,
    )  # fmt: skip
    part, regions = _narrow_regions(measured)
    yield Finding(
        "unresolved_force",
        "force on regions that the facets do not resolve / normal force",
        part,
        f"{part:.0%} of the normal forces act on regions that the mesh does not resolve: {regions}",
        remark=LIMITS.at_corners,
    )


def _opening(measured: Measured) -> tuple[float, str]:
    """Mean gap of active nodes by forces over the approach of the bodies; where (collective)."""
    contact, modulus = measured.contact, float(measured.contact.modulus.max())
    pressure = np.where(contact.active, np.maximum(measured.pressure, 0.0), 0.0)
    pressed = float(pressure.max(initial=0.0)) > LIMITS.min_pressure * modulus
    if not pressed or contact.offset.any():
        return 0.0, ""
    force = pressure * contact.operators.weight
    approach = force.sum() / (modulus * np.sqrt(contact.operators.weight[contact.active].sum()))
    # gaps of active nodes are not zero under a law with a closing gap
    work = force * np.maximum(_gaps_of_nodes(contact) - np.abs(np.nan_to_num(contact.gap)), 0.0)
    mean = float(work.sum() / force.sum())
    return mean / approach, format_point(contact.operators.x[work.argmax()])


def _gaps_of_nodes(contact: Contact) -> Array:
    """Distances of the active nodes from the other side, along their normals, (n,) (local)."""
    if contact.obstacle is not None:
        return np.asarray(contact.on_obstacle.phi)
    o, gaps, there = contact.operators, np.zeros(contact.slave.num_nodes), contact.active
    corners, weights = nearest_on_master(o, np.flatnonzero(there))
    nearest = np.einsum("nk,nkc->nc", weights, o.m[corners])
    gaps[there] = ((nearest - o.x[there]) * o.n[there]).sum(axis=1)
    return gaps


def _narrow_regions(measured: Measured) -> tuple[float, str]:
    """Fraction of the normal forces in narrow regions, and the largest of them (collective)."""
    contact, pressure = measured.contact, measured.pressure
    opposite = _opposite_facets(contact)
    least = LIMITS.min_pressure * float(contact.modulus.max())
    if not float(pressure.max(initial=0.0)) > least:
        return 0.0, ""
    force = np.where(contact.active, np.maximum(pressure, 0.0) * contact.operators.weight, 0.0)
    edges = edges_between_nodes(contact.slave, at_corners=contact.at_vertices)
    surrounded = _surrounded(contact.active, edges)
    on_edge = _on_edge(contact)
    found = []
    for nodes in _regions(contact.active, edges):
        text = _describe_if_narrow(contact, nodes, surrounded, on_edge, opposite)
        if text:
            found.append((float(force[nodes].sum()), text))
    carried = sum(part for part, _ in found)
    return (carried / float(force.sum()), max(found)[1]) if found else (0.0, "")


def edges_between_nodes(surface: Faces, *, at_corners: bool) -> Indices:
    """Neighbouring nodes along the edges of all facets, and across those of order 2, (k, 2).

    Args:
        surface: The surface.
        at_corners: Whether corners alone carry multipliers.
    """
    size = surface.facets.shape[1]
    count = CORNERS[size]
    ring = list(range(count))
    pairs = [(i, (i + 1) % count) for i in ring]
    if size > count and not at_corners:
        pairs = [(i, count + i) for i in ring] + [(count + i, (i + 1) % count) for i in ring]
        middles = [count + i for i in ring]
        if size == 9:
            pairs += [(middle, 8) for middle in middles]
        else:
            pairs += [(middles[i], middles[(i + 1) % 3]) for i in range(3)]
    return np.unique(np.sort(surface.facets[:, pairs].reshape(-1, 2), axis=1), axis=0)


def _surrounded(active: Flags, edges: Indices) -> Flags:
    """Active nodes whose neighbours are all active, shape (n,), bool."""
    inside = active.copy()
    inside[edges[~active[edges[:, 1]], 0]] = False
    inside[edges[~active[edges[:, 0]], 1]] = False
    return inside


def _regions(active: Flags, edges: Indices) -> list[Indices]:
    """The nodes of each region of connected active nodes."""
    kept = edges[active[edges].all(axis=1)]
    graph = coo_array((np.ones(len(kept)), kept.T), shape=(active.size, active.size))
    labels = connected_components(graph, directed=False)[1]
    nodes = np.flatnonzero(active)
    return [nodes[labels[nodes] == label] for label in np.unique(labels[nodes])]


def _on_edge(contact: Contact) -> Flags:
    """Nodes at the rim or at sharp edges of the slave, not on symmetry planes, (n,), bool."""
    slave, o = contact.slave, contact.operators
    corners = o.x[slave.facets[:, [0, 1, CORNERS[slave.facets.shape[1]] - 1]]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), TINY)[:, None]
    cosines = np.einsum("fkc,fc->fk", o.n[slave.facets], normals)
    least = np.ones(slave.num_nodes)
    np.minimum.at(least, slave.facets, cosines)
    is_sharp = least < np.cos(0.5 * LIMITS.sharp_corner)
    on_plane = np.isfinite(contact.plane_normals).all(axis=1)
    return np.asarray((slave.is_open | is_sharp) & ~on_plane)


def _opposite_facets(contact: Contact) -> Array:
    """Size of the largest facet of the master opposite to each slave node, (n,) (collective)."""
    s, slave, m = contact.intersections(), contact.slave, contact.operators.m
    sizes = np.zeros(slave.num_nodes)
    if contact.obstacle is None and s.num_segments:
        corners = m[s.master[:, : CORNERS[s.master.shape[1]]]]
        a, b = corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0]
        areas = np.linalg.norm(np.cross(a, b), axis=1)
        areas *= HALF_FACET if corners.shape[1] == 3 else 1.0
        np.maximum.at(sizes, s.slave, np.sqrt(areas)[:, None])
    return largest_over_ranks(slave.comm, sizes)


def _describe_if_narrow(
    contact: Contact, nodes: Indices, surrounded: Flags, on_edge: Flags, opposite: Array
) -> str:
    """Describe a region of active ``nodes`` (k,) that is too narrow; "" if it is not (local)."""
    slave, o = contact.slave, contact.operators
    if on_edge[nodes].mean() > HALF_FACET:
        return ""
    is_narrow = not surrounded[nodes].any()
    facet = float(slave.nodal_lengths[nodes].max())
    area = float(o.cover[nodes].sum())
    width = area / (_extent(o.x[nodes]) + facet)
    behind = 0.0 if on_edge[nodes].any() else float(opposite[nodes].max())
    if not is_narrow and width >= behind * (1.0 - ROUNDING):
        return ""
    names = [slave.name] if is_narrow else []
    names += [contact.master.name] if contact.obstacle is None else []
    sides = " and ".join(f"'{name}'" for name in names)
    many = "s" if nodes.size > 1 else ""
    return (
        f"{nodes.size} active node{many} at {format_point(o.x[nodes].mean(axis=0))}, about "
        f"{width:.2g} wide on facets of {max(facet, behind):.2g}: their resultant is known, but "
        f"pressure and approach are not; refine {sides} there to facets of "
        f"{width / FACETS_OVER_WIDTH:.2g}, {FACETS_OVER_WIDTH} over the width"
    )


def _extent(x: Array) -> float:
    """Largest extent of points (k, 3) along their principal axis [length]."""
    about = x - x.mean(axis=0)
    axis = np.linalg.svd(about, full_matrices=False)[2][0]
    return float(np.ptp(about @ axis))
