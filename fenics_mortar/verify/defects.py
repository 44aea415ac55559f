# SPDX-License-Identifier: MIT
"""Tractions on contact surfaces, and violations of contact conditions between the nodes.

``interface_tractions`` and ``interface_defects`` yield them for both sides of a pair, for the error
estimate: tractions, gaps, slip and jumps at quadrature points of the facets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from fenics_mortar.contact.arcs import arc
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import mapped
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.interface.facing import Facing, Points, both_sides, points_of, rule_of
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.interface.reference import gauss_points, tabulate
from fenics_mortar.interface.space_mortar import find_pairs
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.ranks import sum_over_ranks
from fenics_mortar.verify.finding import LIMITS

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.surfaces import Surface

# Uncovered fraction of a facet [1] below which it is covered as a whole: distorted quadrilaterals,
# on which rules are inexact, are covered up to 3e-4.
WHOLE = 1e-3


def interface_tractions(pair: Interface, prescribed: Array) -> Iterator[tuple[Surface, Array]]:
    """Yield both surfaces with the tractions on their facets (collective).

    Args:
        pair: The interface.
        prescribed: 1 for prescribed dofs of the displacement, else 0, shape (local dofs,).

    Yields:
        A surface, and its tractions per reference area, shape (facets, q, dim) [stress], at the
        points of ``gauss_points``.
    """
    surfaces, forces = (pair.slave, pair.master), pair.operators.force(pair.z_u)
    o, segments = pair.partner_operators, pair.intersections()
    covers = both_sides(o, segments) if pair.master.num_nodes else (points_of(segments),)
    for surface, force, here in zip(surfaces, forces, covers):
        keeps = surface.gather(prescribed).all(axis=1)
        yield surface, facet_tractions(surface, -force, keeps, here)


def facet_tractions(surface: Surface, forces: Array, clamped: Flags, here: Points) -> Array:
    """Traction with given nodal forces, at the Gauss points of all facets (collective).

    On the covered surface the traction is a projection on the span of the displacement's shape
    functions, elsewhere it is zero: a pressure may end in a jump. On partly covered facets moments
    up to the second are reproduced.

    Args:
        surface: The surface.
        forces: Nodal forces, shape (nodes, dim) [stress area].
        clamped: Clamped nodes, shape (nodes,), bool. Their forces are not used where the traction
            can be extrapolated from nodes nearby, see ``_extrapolations``.
        here: Points on the covered parts, this rank's share.

    Returns:
        Traction per reference area, shape (facets, q, dim) [stress].
    """
    count = surface.corners.shape[1]
    points, weights = gauss_points(count)
    of_rule, of_cover = (_quadratics(s, count) for s in (points, here.s))
    mass = np.einsum("np,npj,npk->njk", here.measure(surface.X), here.shape, here.shape)
    moments = np.einsum("np,npa,npk->nak", here.weights, of_cover, here.shape)
    cover = here.weights.sum(axis=1)
    cover, moments, mass = (_sum_over_facets(surface, here, a) for a in (cover, moments, mass))
    cover = cover / weights.sum()
    bare = cover < LIMITS.bare
    moments[bare] = mass[bare] = 0.0
    at_points = of_rule @ np.linalg.inv(of_rule.T * weights @ of_rule) @ moments
    at_points[np.abs(cover - 1.0) < WHOLE] = tabulate(points, surface.facets.shape[1])[:, 0]
    nodal = _solve_on_covered(surface, mass, forces, clamped)
    return np.asarray(np.einsum("fqk,fkc->fqc", at_points, nodal[surface.facets]))


def _quadratics(s: Array, corners: int) -> Array:
    """Quadratic polynomials at points of reference facets, (..., P) (local).

    Args:
        s: Coordinates, shape (...), in space (..., 2).
        corners: Number of corners of the facets.
    """
    if corners == 2:
        return s[..., None] ** np.arange(3)
    powers = [(i, j) for i in range(3) for j in range(3) if corners == 4 or i + j <= 2]
    return np.stack([s[..., 0] ** i * s[..., 1] ** j for i, j in powers], axis=-1)


def _sum_over_facets(surface: Surface, here: Points, values: Array) -> Array:
    """Sum values (n, ...) of segments over their facets, shape (facets, ...) (collective)."""
    sums = np.zeros((len(surface.facets), *values.shape[1:]))
    np.add.at(sums, here.facet, values)
    return sum_over_ranks(surface.comm, sums)


def _solve_on_covered(surface: Surface, blocks: Array, forces: Array, clamped: Flags) -> Array:
    """Nodal tractions (nodes, dim) of ``forces``, with mass matrices (facets, K, K) (local)."""
    rows = np.broadcast_to(surface.facets[:, :, None], blocks.shape)
    columns = np.broadcast_to(surface.facets[:, None, :], blocks.shape)
    size = surface.num_nodes
    mass = coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (size, size)).tolil()
    rhs = forces.copy()
    alone = np.flatnonzero(mass.diagonal() == 0.0)
    mass[alone, alone], rhs[alone] = 1.0, 0.0
    for node, others, weights in _extrapolations(surface, clamped):
        mass[node], rhs[node] = 0.0, 0.0
        mass[node, [node, *others]] = blocks.max() * np.array([1.0, *-weights])
    return np.asarray(splu(mass.tocsc()).solve(rhs))


def _extrapolations(surface: Any, clamped: Flags) -> Iterator[tuple[int, Indices, Array]]:
    """Clamped nodes, nodes nearby that are not, and weights of linear extrapolation (local).

    In the plane nodes at ends of the surface, from the next two. In space all nodes from those of
    the facets around the facets at the node, by the least squares of a linear function, if these
    determine one.
    """
    if isinstance(surface, Curve):
        for end, first, second in _ends(surface, clamped):
            lengths = np.linalg.norm(surface.X[[end, first]] - surface.X[[first, second]], axis=1)
            ratio = lengths[0] / lengths[1]
            yield end, np.array([first, second]), np.array([1.0 + ratio, -ratio])
        return
    for node in np.flatnonzero(clamped):
        ring = surface.stencil[node]
        near = np.unique(surface.stencil[ring[ring >= 0]])
        near = near[(near >= 0) & ~clamped[near]]
        if near.size < 3:
            continue
        away = surface.X[near] - surface.X[node]
        axes = np.linalg.svd(away, full_matrices=False)[2][:2]
        table = np.column_stack([np.ones(near.size), away @ axes.T / np.abs(away).max()])
        if np.linalg.matrix_rank(table, tol=ROUNDING) == 3:
            yield int(node), near, np.linalg.pinv(table)[0]


def _ends(surface: Curve, clamped: Flags) -> list[list[int]]:
    """Clamped nodes at ends of a surface, with the next two nodes if there are two (local)."""
    triples = [
        surface.along(np.flatnonzero(clamped & (before < 0)), range(0, 3 * way, way))
        for before, way in ((surface.previous, 1), (surface.following, -1))
    ]
    both = np.concatenate(triples)
    return both[(both >= 0).all(axis=1)].tolist()


# Integrals over slave facets: dyads [area length^2], and work [stress length area].
Defects = tuple[Array, Array]


def interface_defects(pair: Interface) -> dict[str, Defects]:
    """Violations of contact conditions between the nodes, by kind (collective).

    Returns:
        For "gap" and "slip": integrals over the slave facets of dyads, whose work is given by the
        stiffness of a layer, shape (facets, dim, dim) [area length^2], and of additional work,
        shape (facets,) [stress length area].
    """
    if isinstance(pair, Contact):
        return {"gap": gap_defects(pair), "slip": slip_defects(pair)}
    o, (facing, _) = pair.operators, both_sides(pair.partner_operators, pair.intersections())
    jump = facing.difference(o.x - pair.slave.X, o.m - pair.master.X)
    return {"gap": _on_facets(pair, facing, jump, 0.0 * facing.weights)}


def gap_defects(contact: Contact) -> Defects:
    """Penetration, or the gap where all corners are active; otherwise the work z_n g (collective).

    With adhesion a(g) the work is (z_n + a) g, zero for open contact.
    """
    here, gap = _gaps(contact)
    closed = contact.active[_corners(contact, here)].all(axis=1)[:, None]
    wrong, opening = np.where(closed, gap, np.minimum(gap, 0.0)), np.maximum(gap, 0.0)
    pull = _adhesion(contact, here, opening)
    pressure = np.maximum(here.of(contact.pressure) + pull, 0.0)
    work = np.where(closed, 0.0, pressure * opening)
    return _on_facets(contact, here, wrong[..., None] * here.direction(contact.operators.n), work)


def _corners(contact: Contact, here: Points) -> Indices:
    """Slave nodes at the corners of the facets of points, shape (n, c)."""
    return contact.slave.corners[here.facet]


def _adhesion(contact: Contact, here: Points, opening: Array) -> Array:
    """Adhesion at points with gaps ``opening`` (n, q) [stress] (collective)."""
    law = contact.pair.law
    if not law.has_adhesion:
        return np.zeros_like(opening)
    node = replace(mapped(contact.nodal, here.of), gap=opening)
    comm = contact.slave.comm
    return np.asarray(call_together(comm, repr(law), partial(law.adhesion_at, node)).residual)


def _gaps(contact: Contact) -> tuple[Points, Array]:
    """Points, and gaps minus the offset there, shape (n, q) [length] (collective).

    With small sliding gaps are linear in the motion, like nodal gaps.
    """
    o, first, segments = contact.operators, contact.partner_operators, contact.intersections()
    offset = contact.now.offset[:, None] * o.n
    if isinstance(first, ObstacleOperators) and isinstance(o, ObstacleOperators):
        here = points_of(segments)
        gap = first.sample_gaps(first.x + offset, segments, rule_of(segments)[0])
        return here, gap + here.of(o.phi - first.phi)
    here, _ = both_sides(first, segments)
    away = here.difference(o.x + offset, o.m)
    return here, -np.einsum("nqc,nqc->nq", here.direction(o.n), away)


def slip_defects(contact: Contact) -> Defects:
    """Slip where all corners stick; otherwise the missing work of friction (collective).

    The missing work is that of the friction limit minus that of the shear. The slip is that of the
    last step between points that faced each other at its start, or nodal slip on obstacles, whose
    surface has no mesh.
    """
    law = contact.pair.law
    if not law.needs_slip:
        count, dim = len(contact.slave.facets), contact.slave.dim
        return np.zeros((count, dim, dim)), np.zeros(count)
    here, slip = _slips(contact)
    corners, held = _corners(contact, here), ~contact.follows_law
    sticking = contact.sticking[corners]
    sticks = ((sticking | held[corners]).all(axis=1) & sticking.any(axis=1))[:, None]
    bound = contact.now.friction_limit(contact.pressure)
    raise_stored(contact.slave.comm, [contact])
    bound = here.of(np.where(contact.active, bound, 0.0))
    shear = here.of(np.where(contact.active[:, None], contact.shear, 0.0))
    turned = np.linalg.norm(here.of(contact.operators.n), axis=2)  # shorter where normals differ
    work = np.einsum("nqc,nqc->nq", shear, slip) / turned
    lost = np.maximum(bound * np.linalg.norm(slip, axis=2) - work, 0.0)
    work = np.where(sticks | (bound <= 0.0), 0.0, lost)
    return _on_facets(contact, here, np.where(sticks[..., None], slip, 0.0), work)


def _slips(contact: Contact) -> tuple[Points, Array]:
    """Points, and the slip of the last step there, shape (n, q, dim) [length] (collective)."""
    o, partners = contact.operators, contact.partners
    if o.slave.dim == 2:
        facing = partners.facing
        here = points_of(o.segments) if facing is None else facing
        slip = here.of(contact.slip) if facing is None else _slip_between(contact, facing)
        return here, slip[..., None] * here.direction(o.tau)
    if contact.obstacle is not None:
        here = points_of(o.segments)
        return here, here.of(contact.now.surface_slip)
    here, start = _faced_before(contact)
    return here, _across(here.difference(o.x, o.m) - start, here.direction(o.n))


def _faced_before(contact: Contact) -> tuple[Facing, Array]:
    """Points in space that faced each other at the start of the step, and their vectors (local).

    The vectors, turned with the slave, have shape (n, q, 3) [length].
    """
    o, partners, first = contact.operators, contact.partners, contact.partner_operators
    if partners is None:  # no accepted state
        here, _ = both_sides(first, contact.intersections())
        return here, here.difference(o.x, o.m)
    segments = first.segments
    if contact.pair.sliding != "small":
        first = replace(first, x=partners.x, m=partners.m)
        at = first.slave, first.master, first.x, first.m, segments.facets, contact.options
        segments = find_pairs(*at, contact.evaluation.behind)
    here, _ = both_sides(first, segments)
    start = here.difference(partners.x, partners.m)
    return here, np.einsum("nqab,nqb->nqa", here.of(partners.rotation_of_slave(o)), start)


def _across(vectors: Array, n: Array) -> Array:
    """Parts of ``vectors`` (n, q, dim) across unit vectors."""
    return vectors - np.einsum("nqa,nqa->nq", vectors, n)[..., None] * n


def _slip_between(contact: Contact, facing: Facing) -> Array:
    """Slip of the last step at points that faced each other, shape (n, q) [length] (local)."""
    o = contact.operators
    theta = facing.of(contact.partners.relative_turn(o))
    now = facing.difference(o.x, o.m), facing.direction(o.n)
    return arc(now, (facing.start, facing.normals), theta, -theta).slip


def _on_facets(pair: Interface, here: Points, wrong: Array, work: Array) -> Defects:
    """Integrals of densities over slave facets, (facets, dim, dim) and (facets,) (collective).

    Args:
        pair: The interface.
        here: Points of this rank's share.
        wrong: Vectors of the dyads, shape (n, q, dim) [length].
        work: Density of additional work, shape (n, q) [stress length].
    """
    measure, dim = here.measure(pair.operators.x), wrong.shape[2]
    dyads = np.einsum("nq,nqi,nqk->nik", measure, wrong, wrong).reshape(-1, dim**2)
    thickness = pair.slave.thickness
    if thickness is not None:  # the stiffness of the layer includes the thickness
        work = work * here.of(thickness.at(pair.operators.x))
    values = np.column_stack([dyads, (measure * work).sum(axis=1)])
    sums = _sum_over_facets(pair.slave, here, values)
    return sums[:, :-1].reshape(-1, dim, dim), sums[:, -1]
