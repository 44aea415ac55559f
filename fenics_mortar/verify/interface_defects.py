# SPDX-License-Identifier: MIT
"""Violations of contact conditions between the nodes of a pair, for the error estimate."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from fenics_mortar.contact.arcs import arc
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.contact.nodal import at_points
from fenics_mortar.interface.facing import GAUSS, Facing, Points, face, points_of
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.interface.segments import Segments
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.ranks import sum_over_ranks

# Integrals over slave facets: dyads [length^3], and work [stress length^2].
Defects = tuple[Array, Array]


def interface_defects(pair: Interface) -> dict[str, Defects]:
    """Violations of contact conditions between the nodes, by kind (collective).

    Returns:
        For "gap" and "slip": integrals over the slave facets of dyads, whose work is given by the
        stiffness of a layer, shape (facets, 2, 2) [length^3], and of additional work, shape
        (facets,) [stress length^2].
    """
    if isinstance(pair, Contact):
        return {"gap": gap_defects(pair), "slip": slip_defects(pair)}
    o, facing = pair.operators, face(pair.partner_operators, pair.intersections())
    jump = facing.difference(o.x - pair.slave.X, o.m - pair.master.X)
    return {"gap": _on_facets(pair, facing, jump, 0.0 * facing.s)}


def gap_defects(contact: Contact) -> Defects:
    """Penetration, or the gap where all nodes are active; otherwise the work z_n g (collective).

    With adhesion a(g) the work is (z_n + a) g, zero for open contact.
    """
    o, segments = contact.operators, contact.intersections()
    here, gap = points_of(segments), _gaps(contact, segments)
    closed = contact.active[here.slave[:, [0, -1]]].all(axis=1)[:, None]
    wrong, opening = np.where(closed, gap, np.minimum(gap, 0.0)), np.maximum(gap, 0.0)
    pull = _adhesion(contact, here, opening)
    pressure = np.maximum(here.of(contact.pressure) + pull, 0.0)
    work = np.where(closed, 0.0, pressure * opening)
    return _on_facets(contact, here, wrong[..., None] * here.direction(o.n), work)


def _adhesion(contact: Contact, here: Points, opening: Array) -> Array:
    """Adhesion at points with gaps ``opening`` (n, q) [stress] (collective)."""
    law = contact.pair.law
    if not law.has_adhesion:
        return np.zeros_like(opening)
    node = replace(at_points(contact.nodal, here.of), gap=opening)
    comm = contact.slave.comm
    return np.asarray(call_together(comm, repr(law), partial(law.adhesion_at, node)).residual)


def _gaps(contact: Contact, segments: Segments) -> Array:
    """Gaps minus the offset at points of segments, shape (n, q) [length] (collective).

    With small sliding gaps are linear in the motion, like nodal gaps.
    """
    o, first = contact.operators, contact.partner_operators
    gap = first.sample_gaps(first.x + contact.now.offset[:, None] * o.n, segments, GAUSS[0])
    if isinstance(first, ObstacleOperators) and isinstance(o, ObstacleOperators):
        return gap + points_of(segments).of(o.phi - first.phi)
    here = face(first, segments)
    moved = here.difference(o.x - first.x, o.m - first.m)
    return gap - np.einsum("nqc,nqc->nq", here.direction(o.n), moved)


def slip_defects(contact: Contact) -> Defects:
    """Slip where all nodes stick; otherwise the missing work of friction (collective).

    The missing work is that of the friction limit minus that of the shear. The slip is that of the
    last step between points that faced each other at its start, or nodal slip on obstacles, whose
    surface has no mesh.
    """
    o, facing = contact.operators, contact.partners.facing
    here = points_of(o.segments) if facing is None else facing
    slip = here.of(contact.slip) if facing is None else _slip_between(contact, facing)
    ends, prescribed = here.slave[:, [0, -1]], ~contact.free.all(axis=1)
    sticking = contact.sticking[ends]
    sticks = ((sticking | prescribed[ends]).all(axis=1) & sticking.any(axis=1))[:, None]
    node, bound = contact.nodal, contact.now.friction_limit(contact.pressure)
    raise_stored(contact.slave.comm, [contact])
    shear, bound = (here.of(np.where(contact.active, a, 0.0)) for a in (node.z_tau, bound))
    lost = np.maximum(bound * np.abs(slip) - shear * slip, 0.0)
    work = np.where(sticks | (bound <= 0.0), 0.0, lost)
    wrong = np.where(sticks, slip, 0.0)
    return _on_facets(contact, here, wrong[..., None] * here.direction(o.tau), work)


def _slip_between(contact: Contact, facing: Facing) -> Array:
    """Slip of the last step at points that faced each other, shape (n, q) [length] (local)."""
    o = contact.operators
    theta = facing.of(contact.partners.at(o).rotations.theta)
    now = facing.difference(o.x, o.m), facing.direction(o.n)
    return arc(now, (facing.start, facing.normals), theta, -theta).slip


def _on_facets(pair: Interface, here: Points, wrong: Array, work: Array) -> Defects:
    """Integrals of densities over slave facets, (facets, 2, 2) and (facets,) (collective).

    Args:
        pair: The interface.
        here: Points of this rank's share.
        wrong: Vectors of the dyads, shape (n, q, 2) [length].
        work: Density of additional work, shape (n, q) [stress length].
    """
    measure = here.measure(pair.operators.x)
    dyads = np.einsum("nq,nqi,nqk->nik", measure, wrong, wrong).reshape(-1, 4)
    sums, thickness = np.zeros((len(pair.slave.facets), 5)), pair.slave.thickness
    if thickness is not None:  # the stiffness of the layer includes the thickness
        work = work * here.of(thickness.at(pair.operators.x))
    np.add.at(sums, here.facet, np.column_stack([dyads, (measure * work).sum(axis=1)]))
    sums = sum_over_ranks(pair.slave.comm, sums)
    return sums[:, :4].reshape(-1, 2, 2), sums[:, 4]
