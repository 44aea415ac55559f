# SPDX-License-Identifier: MIT
"""Regions of contact that the facets do not resolve: narrow ones, curves that do not fit, openings.

**Narrow regions.** Few active nodes carry the correct resultant, but width, pressure and approach
are those of the facets. Three active nodes, two facets, are the fewest whose pressure has a maximum
and decreases to both sides: with them the approach of a cylinder is accurate to some per cent. In
space one node of such a region is surrounded by active nodes. Regions that are narrower than the
facets of the master are too narrow as well.

Regions with a corner or an end of the slave in them are left out, for these determine their extent:
a block that rests on its whole side, of any number of nodes, a punch, an edge that presses. So are
regions between two ends of the master that are a facet apart or more, and below an obstacle with a
radius of less than half a facet, a point support. There the pressure is singular, or does not
matter, on each mesh; ``corners`` judges its direction. A node that leaves its multiplier to a tie
belongs to the region beside it; at the seam of a periodic cell it is an end of the slave, beyond
which the region goes on across the seam. A symmetry plane is no end: the region continues beyond.
On the axis of bodies of revolution three active nodes are needed over the radius: the force of a
cone or sphere at a given approach is up to 20 % too large with two, and 3 % with three.
In space a node at the rim has neighbours on one side only: regions most of whose nodes are at the
rim, at a corner or at a sharp edge of the slave are left out, since their extent is that of the
edge. A single node is not: a corner on a face, or two edges that cross, touch at a point, whose
size under a force is that of the facets alone. The force at a given approach falls with their size
until more nodes are active: measured on a cube's corner, by a factor of 7 from 2 to 8 cells a side,
on crossed edges by 5 from 4 to 12. Nor are nodes whose facets the other side hardly covers, as
where two corners stand beside each other: on cubes by a factor of 5 from 2 to 4 cells a side.

**Curves that do not fit.** Between nodes of two conforming curves with different straight facets
there are gaps and overlaps of their sagitta, h^2 / (8 R). If the bodies approach each other by
less, as a shaft in a bush of almost the same radius, the corners carry the force. Measured on such
a shaft, with gaps (root mean square) of 8, 51 and 69 % of the approach, estimated from force and
stiffness: the force is 7, 28 and 20 % too small. With curved cells of order 2 the gaps are below
0.5 %.

**Forces across openings.** A dual function is negative on a part of its facets. Where the other
side bends away within a facet that is longer than the region of contact, the mean gap of an open
node may vanish, and the node carries a force far beyond the contact. Measured on spheres and
crossed cylinders, with the mean gap of the loaded nodes over the approach, estimated from force and
stiffness: up to 2.4 where pressures are accurate to 10 %; 4 to 15 with errors of 15 to 70 % on
six-node triangles; 36 and 100 where the force is 2.7 and 4.3 times the right one.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenics_mortar.contact.view import or_other_weights
from fenics_mortar.interface.facing import nearest_on_master
from fenics_mortar.interface.reference import CORNERS
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.utils import arrays, errors, ranks
from fenics_mortar.verify.checks.corners import facet_angles
from fenics_mortar.verify.finding import CURVED, LIMITS, POINTS_BETWEEN, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.interface.curve_surface import Curve
    from fenics_mortar.utils.arrays import Array, Flags, Indices

# Number of active nodes of a region of contact, below which it is too narrow.
FEWEST_NODES = 3
# Gap between active nodes over the approach of the bodies above which there is a remark [1]: forces
# are 7 % too small.
FACET_GAPS = 0.1
# Number of facets over the width of a region that is advised: with four, pressures of a cylinder
# are accurate to some per cent.
FACETS_OVER_WIDTH = 4
# Gap at nodes with forces over the approach of the bodies above which there is a remark [1]; the
# approach may be underestimated by a factor of two.
OPENING = 2.5


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Force on regions that are too narrow, and on gaps of any kind (collective)."""
    part, regions = _narrow_regions(measured)
    yield Finding(
        "unresolved_force", "force on regions that the facets do not resolve / normal force", part,
        f"{part:.0%} of the normal forces act on regions that the mesh does not resolve: {regions}",
        remark=LIMITS.at_corners,
    )  # fmt: skip
    if measured.contact.slave.dim == 3:
        yield _opening(measured)
        return
    gaps, where = _gaps_of_facets(measured)
    yield Finding(
        "facet_gaps", "gaps between nodes due to facets / approach of the bodies", gaps,
        "facets of the two sides do not fit: between the nodes, most of all at "
        f"{where}, the gap is {gaps:.0%} of the approach of the bodies: forces may be far too "
        f"small, and single pressures far too large; take {CURVED}, or finer facets",
        remark=FACET_GAPS, where=where,
    )  # fmt: skip


def _opening(measured: Measured) -> Finding:
    """Mean gap of active nodes in space by forces over the approach of the bodies (collective)."""
    contact = measured.contact
    pressure = np.where(contact.active, np.maximum(measured.pressure, 0.0), 0.0)
    opening, where = 0.0, ""
    if measured.is_pressed and pressure.any() and not contact.offset.any():
        force, modulus = pressure * contact.operators.weight, float(contact.modulus.max())
        size = np.sqrt(contact.operators.weight[contact.active].sum())
        # gaps of active nodes are not zero under a law with a closing gap
        work = force * np.maximum(_gaps_of_nodes(contact) - np.abs(np.nan_to_num(contact.gap)), 0.0)
        opening = float(work.sum() / force.sum()) / (force.sum() / (modulus * size))
        where = errors.format_point(contact.operators.x[arrays.first_largest(work)])
    return Finding(
        "openings", "gaps at nodes with forces / approach of the bodies", opening,
        f"nodes carry forces where the surfaces are apart, most of all at {where}: on average by "
        f"{opening:.2g} times the approach of the bodies. Forces may be several times too large or "
        f"too small; refine '{contact.slave.name}' beside the contact{or_other_weights(contact)}",
        remark=OPENING, where=where,
    )  # fmt: skip


def _gaps_of_nodes(contact: Contact) -> Array:
    """Distances of the active nodes from the other side, along their normals, (n,) (local)."""
    if contact.obstacle is not None:
        return np.asarray(contact.operators.phi)
    o, gaps, there = contact.operators, np.zeros(contact.slave.num_nodes), contact.active
    corners, weights = nearest_on_master(o, np.flatnonzero(there))
    nearest = np.einsum("nk,nkc->nc", weights, o.m[corners])
    gaps[there] = ((nearest - o.x[there]) * o.n[there]).sum(axis=1)
    return gaps


def _narrow_regions(measured: Measured) -> tuple[float, str]:
    """Fraction of the normal forces in narrow regions, and the largest of these (collective)."""
    contact, pressure = measured.contact, measured.pressure
    slave, active = contact.slave, contact.active
    if not measured.is_pressed:
        return 0.0, ""
    if slave.dim == 2 and contact.at_vertices:  # inner nodes of facets have no multiplier
        active = active | (slave.inner & active[slave.previous] & active[slave.following])
    edges, facets = _edges_between_nodes(contact), _largest_facets(contact)
    active = active | (contact.tied & ~contact.may_carry & _beside(active, edges))
    measure = partial(_on_curve, contact, facets)
    if slave.dim == 3:
        surrounded = active & ~_beside(~active, edges)  # their neighbours are all active
        measure = partial(_on_faces, contact, facets, surrounded, _on_edge(contact))
    force = np.where(contact.active, np.maximum(pressure, 0.0) * contact.operators.weight, 0.0)
    found = list[tuple[float, str]]()
    for nodes in _regions(active, edges):
        region = measure(nodes)
        if region and (
            region.is_narrow or region.width < region.opposite * (1.0 - arrays.ROUNDING)
        ):
            found.append((float(force[nodes].sum()), _describe(contact, nodes, region)))
    carried = sum(part for part, _ in found)
    return (carried / float(force.sum()), max(found)[1]) if found else (0.0, "")


def _edges_between_nodes(contact: Contact) -> Indices:
    """Neighbouring nodes of the slave, along curves, or along edges of faces, (k, 2).

    On faces of order 2 also across them, unless corners alone carry multipliers.
    """
    surface = contact.slave
    if surface.dim == 2:
        return np.concatenate([surface.facets[:, k : k + 2] for k in range(surface.degree)])
    size = surface.facets.shape[1]
    count = CORNERS[size]
    ring = list(range(count))
    pairs = [(i, (i + 1) % count) for i in ring]
    if size > count and not contact.at_vertices:
        pairs = [(i, count + i) for i in ring] + [(count + i, (i + 1) % count) for i in ring]
        middles = [count + i for i in ring]
        if size == 9:
            pairs += [(middle, 8) for middle in middles]
        else:
            pairs += [(middles[i], middles[(i + 1) % 3]) for i in range(3)]
    return np.unique(np.sort(surface.facets[:, pairs].reshape(-1, 2), axis=1), axis=0)


def _beside(nodes: Flags, edges: Indices) -> Flags:
    """Nodes with a neighbour among ``nodes``, shape (n,), bool."""
    found = np.zeros_like(nodes)
    found[edges[nodes[edges[:, 1]], 0]] = True
    found[edges[nodes[edges[:, 0]], 1]] = True
    return found


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
    normals /= np.maximum(np.linalg.norm(normals, axis=1), arrays.TINY)[:, None]
    cosines = np.einsum("fkc,fc->fk", o.n[slave.facets], normals)
    least = np.ones(slave.num_nodes)
    np.minimum.at(least, slave.facets, cosines)
    is_sharp = least < np.cos(0.5 * LIMITS.sharp_corner)
    on_plane = np.isfinite(contact.plane_normals).all(axis=1)
    return np.asarray((slave.is_open | is_sharp) & ~on_plane)


def _largest_facets(contact: Contact) -> tuple[Array, Array]:
    """Sizes of the facets at each slave node, and of the master's opposite, (n,) (collective).

    In the plane those of the longest facets; on faces the slave's are the nodal lengths.
    """
    slave, s, m = contact.slave, contact.intersections(), contact.operators.m
    own, opposite = np.zeros((2, slave.num_nodes))
    if slave.dim == 3:
        own = slave.nodal_lengths
    else:
        np.maximum.at(own, slave.facets, slave.facet_sizes[:, None])
    if contact.obstacle is not None:
        return own, opposite
    if slave.dim == 2:
        sizes = arrays.norms(m[s.master[:, -1]] - m[s.master[:, 0]])
    else:
        corners = m[s.master[:, : CORNERS[s.master.shape[1]]]]
        areas = arrays.norms(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0])
        )
        sizes = np.sqrt(areas * (arrays.HALF_FACET if corners.shape[1] == 3 else 1.0))
    np.maximum.at(opposite, s.slave, sizes[:, None])
    return own, ranks.largest_over_ranks(slave.comm, opposite)


class _Region(NamedTuple):
    """A region of active nodes.

    Attributes:
        width: Its width [length].
        own, opposite: Sizes of the largest facets of both sides [length].
        is_narrow: Whether it has too few nodes for the facets of the slave.
    """

    width: float
    own: float
    opposite: float
    is_narrow: bool


def _describe(contact: Contact, nodes: Indices, region: _Region) -> str:
    """Describe a region of ``nodes`` (k,) that is too narrow (local)."""
    with_itself, active = contact.master is contact.slave, int(contact.active[nodes].sum())
    names = [contact.slave.name] * (region.is_narrow or with_itself)
    if region.opposite > 0.0 and not with_itself:
        names.append(contact.master.name)
    sides = " and ".join(f"'{name}'" for name in names)
    many, about = "s" * (active > 1), "about " * (contact.slave.dim == 3)
    return (
        f"{active} active node{many} at "
        f"{errors.format_point(contact.operators.x[nodes].mean(axis=0))}, "
        f"{about}{region.width:.3g} wide on facets of {max(region.own, region.opposite):.3g}: "
        f"their resultant is known, but pressure and approach are not; refine {sides} there to "
        f"facets of {region.width / FACETS_OVER_WIDTH:.2g}, {FACETS_OVER_WIDTH} over the width"
    )


def _on_curve(contact: Contact, facets: tuple[Array, Array], nodes: Indices) -> _Region | None:
    """A region of ``nodes`` (k,) of a curve; ``None`` where a corner or a point ends it (local)."""
    slave, o = contact.slave, contact.operators
    on_plane = np.isfinite(contact.plane_normals).all(axis=1)
    before, after = facet_angles(contact)
    sharp = (after - before > LIMITS.sharp_corner) & ~on_plane
    own, opposite = (float(sizes[nodes].max()) for sizes in facets)
    if sharp[nodes].any() or _is_point_support(contact, nodes, own):
        return None
    copies = 2 if on_plane[nodes].any() else 1
    revolved = slave.thickness is not None and slave.thickness.by_x != 0.0
    radial = np.abs(contact.plane_normals[nodes[on_plane[nodes]], 0])
    in_circle = revolved and bool((radial < 0.5).any())  # on the axis the normal is along it
    count = (1 if in_circle else copies) * (int(contact.active[nodes].sum()) - 1) + 1
    width = copies * float(slave.nodal_lengths[nodes].sum())
    is_narrow = count < FEWEST_NODES or width < own
    beside = np.concatenate([slave.previous[nodes], slave.following[nodes]])
    beside = beside[(beside >= 0) & ~np.isin(beside, nodes)]
    if beside.size and not contact.covered[beside].any():  # between the ends of the master
        width = copies * float(o.cover[nodes].sum())
        is_narrow = width < own * (1.0 - arrays.ROUNDING)
    return _Region(width, own, opposite, is_narrow)


def _on_faces(
    contact: Contact, facets: tuple[Array, Array], surrounded: Flags, on_edge: Flags, nodes: Indices
) -> _Region | None:
    """A region of ``nodes`` (k,) of faces; ``None`` where an edge ends it (local)."""
    o, (own, opposite) = contact.operators, (float(sizes[nodes].max()) for sizes in facets)
    is_sliver = o.cover[nodes].sum() < MIN_SHARE * contact.slave.full_cover[nodes].sum()
    if len(nodes) > 1 and on_edge[nodes].mean() > arrays.HALF_FACET and not is_sliver:
        return None
    about = o.x[nodes] - o.x[nodes].mean(axis=0)
    axis = np.linalg.svd(about, full_matrices=False)[2][0]
    width = float(o.cover[nodes].sum()) / (float(np.ptp(about @ axis)) + own)
    opposite = 0.0 if on_edge[nodes].any() else opposite
    return _Region(width, own, opposite, not surrounded[nodes].any())


def _is_point_support(contact: Contact, nodes: Indices, facet: float) -> bool:
    """Whether the obstacle is round with a radius of less than half a facet at ``nodes`` (k,)."""
    if contact.obstacle is None:
        return False
    slave, n = contact.slave, contact.operators.n
    around = np.concatenate([nodes, slave.previous[nodes], slave.following[nodes]])
    around = around[around >= 0]
    points, normals = contact.operators.nearest_points()[around], n[around]
    across = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    sines = 0.5 * np.hypot(*(normals[:, None] - normals).transpose(2, 0, 1))
    i, j = np.unravel_index(int(np.argmax(sines)), sines.shape)
    return bool(across[i, j] < 2.0 * arrays.HALF_FACET * facet * sines[i, j])


def _sagittas(surface: Curve) -> Array:
    """Sagittas of curves through the undeformed facets at each node, (nodes,) [length]."""
    X, before, after = surface.X, surface.previous, surface.following
    turns = np.abs(arrays.angles_between(X - X[before], X[after] - X))
    is_curve = (before >= 0) & (after >= 0) & (turns < LIMITS.sharp_corner)
    return np.where(is_curve, turns, 0.0) * surface.nodal_lengths / 8.0


def _gaps_of_facets(measured: Measured) -> tuple[float, str]:
    """Gaps of either sign between active nodes over the approach of the bodies (collective).

    Gaps are those of curved surfaces, at most the sagitta of their facets; larger ones are due to
    the deformation. The approach is estimated as force over stiffness. Where offsets remove gaps
    of the mesh, those between nodes exert no forces.

    Returns:
        Their root mean square over the approach [1], zero without pressure; where they are largest.
    """
    contact = measured.contact
    slave, o, s = contact.slave, contact.operators, contact.intersections()
    if not measured.is_pressed or contact.offset.any():
        return 0.0, ""
    approach = float(np.maximum(measured.pressure, 0.0) @ slave.nodal_lengths) / float(
        contact.modulus.max()
    )
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
    sums = ranks.sum_over_ranks(slave.comm, [sizes @ squares, sizes.sum()])
    if not sums[0] > 0.0:
        return 0.0, ""
    largest, where = 0.0, ""
    if inside.any():
        first = int(np.argmax(np.where(inside, squares, 0.0)))
        largest, where = float(squares[first]), errors.format_point(ends[first].mean(axis=0))
    _, where = max(slave.comm.allgather((largest, where)))
    return float(np.sqrt(sums[0] / sums[1])) / approach, where
