# SPDX-License-Identifier: MIT
"""Response of contacts to rigid motions of bodies: gaps, slips, loose motions (collective)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.directions import gap_rate, opening_rate, slip_rate
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.rigid.body_motions import BodyMotions
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.rigid.springs import unresisted
from fenics_mortar.utils.arrays import Array, Flags


def closing(bodies: BodyMotions, contact: Contact, body: FloatingBody) -> Array:
    """Closing rates of the mean gaps due to rigid motions, (motions, slave nodes) [1]."""
    return -_responses(bodies, contact, body, gap_rate)


def slipping(bodies: BodyMotions, contact: Contact, body: FloatingBody) -> Array:
    """Slip rates of the nodes due to rigid motions, (motions, slave nodes) [1].

    In space those along two tangents, (motions, slave nodes, 2).
    """
    components = () if contact.slave.dim == 2 else (contact.slave.dim - 1,)
    return _responses(bodies, contact, body, slip_rate, components)


def opening(bodies: BodyMotions, contact: Contact, body: FloatingBody) -> Array:
    """Opening rates of the nodes along n due to rigid motions, (motions, slave nodes) [1]."""
    return _responses(bodies, contact, body, opening_rate)


def is_ahead(
    bodies: BodyMotions, contact: Contact, body: FloatingBody, motion: Array, *, idle: bool = True
) -> bool:
    """Whether a motion (motions,) of the body closes the gap of a node (collective).

    Without ``idle``, nodes of bodies that are set aside do not count.
    """
    rates = (motion @ closing(bodies, contact, body))[idle | ~contact.set_aside]
    return bool((rates > RIGID.resisted * np.linalg.norm(motion)).any())


def nearly_touching(contact: Contact) -> Flags:
    """Slave nodes whose gap closes in a motion considered as rest, (slave nodes,) (local)."""
    gap = np.nan_to_num(contact.now.closing_gap, nan=np.inf)
    near = gap < RIGID.overlap * contact.slave.nodal_lengths
    return np.asarray(near & contact.multiplier_nodes)


def loose_bodies(bodies: BodyMotions, *, sticking: bool = True) -> list[FloatingBody]:
    """Bodies with the motions that active contact does not resist.

    Args:
        bodies: The floating bodies.
        sticking: Whether sticking nodes resist slip.
    """
    found = []
    for body in bodies.bodies:
        contacts = bodies.contacts_of(body)
        resisted = [closing(bodies, c, body)[:, c.active] for c in contacts]
        if sticking:
            with_friction = [c for c in contacts if c.sticking.any()]
            slips = [slipping(bodies, c, body)[:, c.sticking] for c in with_friction]
            resisted += [slip.reshape(len(body.motions), -1) for slip in slips]
        free = unresisted(np.hstack([np.zeros((len(body.motions), 0)), *resisted]))
        if len(free):
            found.append(replace(body, motions=free @ body.motions))
    return found


def _responses(
    bodies: BodyMotions,
    contact: Contact,
    body: FloatingBody,
    response: Callable[[ContactFields, Array, Array], Array],
    components: tuple[int, ...] = (),
) -> Array:
    """Response of a pair to each rigid motion of a body, shape (motions, slave nodes, ...).

    Args:
        bodies: The floating bodies.
        contact: The pair.
        body: The body.
        response: Function of fields and displacements of slave and master nodes.
        components: Shape of the response of a node.
    """
    found = np.zeros((len(body.motions), contact.slave.num_nodes, *components))
    o = contact.operators
    sides = (contact.slave, o.x), (contact.master, o.m)
    if any((bodies.labels_of(surface) == body.label).any() for surface, _ in sides):
        on_slave, on_master = (
            bodies.displacement(body, side.X if bodies.bulk.is_linear else x, bodies.parts_of(side))
            for side, x in sides
        )
        for i, motion in enumerate(zip(on_slave, on_master, strict=True)):
            found[i] = response(contact.now, *motion)
    return found
