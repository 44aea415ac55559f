# SPDX-License-Identifier: MIT
"""Work of friction in a step in space, by slip and by the motions of nodes and obstacle.

The counterpart of ``friction_work``. A force that turns with the material of a node, by the
rotation Q = exp(f) in a step, does the work

    (F_0 + Q^T F) / 2 . J(f)^-1 d

on a node that moves by d with a velocity that is constant in the frame of the material: on a screw
line. J is that of ``arcs``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact.arcs import Material, vectors_of
from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.obstacles.rotations import inverse_jacobians
from fenics_mortar.utils.arrays import Array, norms
from fenics_mortar.verify.checks.friction_work import (
    approach,
    findings,
    relative_difference,
    uncertain_rotation,
)
from fenics_mortar.verify.finding import Finding, Measured

IN_SPACE_ONLY = True


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Work of friction in the last step, and rotations of uncertain direction (collective)."""
    contact, law = measured.contact, measured.contact.pair.law
    if not (law.has_friction or law.needs_nodal_state):
        return
    yield from findings(_difference_of_work(contact), *uncertain_rotation(contact))
    partners = contact.partners
    if contact.obstacle is None and partners.mirrored is not None:
        found = partners.at(contact.operators)
        slave, master = (vectors_of(side.Q)[1] for side in (found.slave, found.master))
        relative = np.where(partners.present > 0.0, found.doubt, 0.0)
        yield from approach(measured, slave, master, relative)


def work_along_screws(before: Array, after: Array, moved: Array, Q: Array) -> Array:
    """Work on each node in a step, shape (n,) [stress length^3] (local).

    Args:
        before: Forces at the start of the step, shape (n, 3) [stress length^2].
        after: Forces at its end, likewise.
        moved: Motions of the nodes, shape (n, 3) [length].
        Q: Rotations of the material at the nodes, shape (n, 3, 3) [1].
    """
    mean = 0.5 * (before + np.einsum("nba,nb->na", Q, after))
    way = inverse_jacobians(vectors_of(Q)[0])
    return np.asarray(np.einsum("na,nab,nb->n", mean, way, moved))


def _difference_of_work(contact: Contact) -> float:
    """Difference of both measures of work over forces times motions [1] (collective).

    Zero if bodies were moved rigidly before the solve.
    """
    partners, o = contact.partners, contact.operators
    both = contact.active & partners.shear.any(axis=1)
    if not contact.pair.law.has_friction or partners.counted.any() or not both.any():
        return 0.0
    before = np.where(both[:, None], partners.shear, 0.0)
    after = np.where(both[:, None], contact.shear, 0.0)
    at, weight = partners.at(o), o.weight[:, None]
    if isinstance(o, ObstacleOperators):
        start = weight * before
        works = [_on_obstacle(contact, start, weight * after)]
        at_start = [start]
    else:
        start = partners.weight[:, None] * before
        works, at_start = [], [partners.D.T @ start, -(partners.M.T @ start)]
    turned = np.einsum("nab,nb->na", at.slave.Q, start)
    by_slip = 0.5 * float(((turned + weight * after) * at.slip).sum())
    sides = (o.slave, partners.x, o.x), (o.master, partners.m, o.m)
    at_end = o.force(after)
    turns = 1.0 if partners.mirrored is not None else 0.0  # directions of forces are kept then
    for f_0, f, (surface, x_0, x) in zip(at_start, at_end, sides):
        still = np.zeros(x.shape, bool)
        material = Material(turns * csr_array(eye(len(x))), surface, x_0, still)
        works.append(_sums(f_0, f, x - x_0, material.turned(x).Q))
    return relative_difference(works, by_slip, weight * after, o.x)


def _on_obstacle(contact: Contact, before: Array, after: Array) -> tuple[float, float]:
    """Work on an obstacle of shears (slave nodes, 3) at the nodes, and its bound (local)."""
    partners, o = contact.partners, contact.on_obstacle
    now, then = (o.obstacle.pivot + p[:3] for p in (o.obstacle.place, partners.place))
    Q = partners.at(o).slave.Q
    by_shift = _sums(-before, -after, np.broadcast_to(now - then, o.x.shape), Q)
    moments = np.cross(partners.x - then, before) + np.cross(o.x - now, after)
    by_turn = -0.5 * moments @ o.obstacle.turn_since(partners.place)
    return by_shift[0] + float(by_turn.sum()), by_shift[1] + float(np.abs(by_turn).sum())


def _sums(before: Array, after: Array, moved: Array, Q: Array) -> tuple[float, float]:
    """Sum of ``work_along_screws``, and that of mean forces times motions (local)."""
    forces = 0.5 * (norms(before) + norms(after))
    return float(work_along_screws(before, after, moved, Q).sum()), float(forces @ norms(moved))
