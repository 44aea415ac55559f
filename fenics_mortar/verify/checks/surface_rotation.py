# SPDX-License-Identifier: MIT
"""Rotation of the surface since the undeformed mesh, by which small sliding misdirects forces.

It is the mean of the rotations from the normals of the contact forces to the present ones, weighted
by the normal forces: opposite rotations, as at both edges of an indented zone, cancel. With
friction in space the rotation of the slave about its normals counts as well, since it turns the
directions of slip and shear.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact.arcs import Material, vectors_of
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.utils.arrays import SMALL_ANGLE, TINY, Array, angles_between, norms
from fenics_mortar.utils.errors import call_together
from fenics_mortar.verify.finding import Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Angle of the mean rotation since the undeformed mesh (collective)."""
    if measured.contact.pair.sliding != "small":
        return
    degrees = float(np.degrees(rotation_since_reference(measured.contact)))
    yield Finding(
        "surface_rotation", "rotation of the surface, with small sliding", degrees,
        f"the contact surface has rotated by {degrees:.1f} degrees, but sliding='small' keeps the "
        "directions of the undeformed mesh: those of contact forces are wrong by this angle; use "
        "sliding='finite'",
        remark=float(np.degrees(SMALL_ANGLE)), unit="degrees",
    )  # fmt: skip


def rotation_since_reference(contact: Contact) -> float:
    """Angle of the mean rotation [radian]; 0.0 without contact (collective)."""
    on = contact.active
    if not on.any():
        return 0.0
    o, weighting = contact.operators, contact.options.weighting
    if contact.obstacle is not None:
        obstacle, given = contact.obstacle, -o.n
        what = f"the distance of '{obstacle.name}'"
        _, now, _ = call_together(contact.slave.comm, what, partial(obstacle.evaluate, o.x))
    else:
        given, _ = evaluate_normals(contact.slave, contact.slave.X, weighting)
        now, _ = evaluate_normals(contact.slave, o.x, weighting)
    rotations = _between(given, now)
    if contact.slave.dim == 3 and contact.pair.law.has_friction:
        rotations = rotations + _about_normals(contact, given)
    forces = np.abs(o.weight * contact.pressure)[on]
    mean = forces @ rotations[on] / max(float(forces.sum()), TINY)
    return float(np.linalg.norm(mean))


def _between(first: Array, last: Array) -> Array:
    """Rotations between normals (n, dim): angles (n, 1), in space vectors (n, 3) [radian]."""
    if first.shape[1] == 2:
        return angles_between(first, last)[:, None]
    across = np.cross(first, last)
    size, cosine = norms(across), (first * last).sum(axis=1)
    return np.asarray((np.arctan2(size, cosine) / np.maximum(size, TINY))[:, None] * across)


def _about_normals(contact: Contact, n: Array) -> Array:
    """Rotations of the slave's material about normals ``n``, vectors (n, 3) [radian] (local)."""
    slave, x = contact.slave, contact.operators.x
    still = np.zeros(x.shape, bool)
    turned = Material(csr_array(eye(len(x))), slave, slave.X, still).turned(x)
    vectors, _ = vectors_of(turned.Q)
    return np.asarray((vectors * n).sum(axis=1)[:, None] * n)
