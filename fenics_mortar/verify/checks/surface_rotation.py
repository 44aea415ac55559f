# SPDX-License-Identifier: MIT
"""Rotation of the surface since the undeformed mesh, by which small sliding misdirects forces.

It is the mean of the rotations from the normals of the contact forces to the present ones, weighted
by the normal forces: opposite rotations, as at both edges of an indented zone, cancel. With
friction in space the rotation of the slave about its normals counts as well, since it turns the
directions of slip and shear.

Linear strains take a turn of a body by an angle a for a strain of cos a - 1 across its axis:
``turned_bodies`` compares it with the strains of the body.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact.arcs import Material, vectors_of
from fenics_mortar.interface.integrals import evaluate_normals
from fenics_mortar.obstacles.rigid_motion import polar, vector_of
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import SMALL_ANGLE, TINY, Array, angles_between, norms
from fenics_mortar.verify.finding import Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.rigid.body_motions import BodyMotions

# Strain of a turn over the strains of the body [1] above which forces may be wrong by more than the
# error of usual meshes.
TURN_STRAIN = 0.01
# Turn of a body [radian], 0.6 degrees, up to which there is no remark: its strain of 5e-5 is more
# than 1 % of those of bodies only that are hardly strained, as of one that stands on others and
# turns freely with them.
FREE_TURN = 0.01
# Scatter of the rotations in a body over their mean [1] above which it bends, which linear strains
# describe: half a beam is turned by the other half at 0.32, beams loaded at their ends have 0.45.
BENT = 0.25


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
        _, now, _ = errors.call_together(contact.slave.comm, what, partial(obstacle.evaluate, o.x))
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


def turned_bodies(bodies: BodyMotions) -> list[str]:
    """Sentences on turned bodies with linear strains that slide by finite distances (collective).

    Bodies that bend, and hardly turn as a whole, have no such strain; of stresses beyond UFL it is
    not known.
    """
    bulk = bodies.bulk
    if bulk.history.before_assembly is not None:
        return []
    pairs = [(c.slave, c.master, c.pair) for c in bodies.contacts]
    slide = [s for *sides, pair in pairs if pair.sliding == "finite" for s in sides if s.num_nodes]
    labels = np.unique(np.concatenate([np.empty(0, np.int64), *map(bodies.labels_of, slide)]))
    nodes, linear = compat.dofmap(bulk.V), bulk.form_points.linear
    free = ~bulk.prescribed[bulk.space.dofs].all(axis=1)  # stresses of held cells do not act
    linear = linear[free[nodes[linear]].any(axis=1)]
    if not labels.size or not ranks.on_any_rank(bulk.comm, linear.size > 0):
        return []
    F = bulk.cells.deformation_gradients(bulk.positions())[linear]
    values = np.column_stack([np.ones(len(F)), F.reshape(len(F), F.shape[1] ** 2), _squares(F)])
    sums = np.zeros((bodies.num_bodies, values.shape[1]))
    of_cells = bodies.labels[nodes[linear, 0]]
    np.add.at(sums, of_cells, bulk.cells.undeformed_areas()[linear, None] * values)
    sums = bulk.comm.bcast(ranks.sum_over_ranks(bulk.comm, sums))
    labels = labels[np.isfinite(sums[labels]).all(axis=1)]  # not of a state that is no number
    found = {label: _turn(sums[label] / max(sums[label, 0], TINY)) for label in labels.tolist()}
    return sorted(
        f"{bodies.name_of(label)} has turned by {np.degrees(turn):.2g} degrees, but its residual "
        f"has linear strains, for which this is a strain of {1.0 - np.cos(turn):.1g}, "
        f"{min(ratio, 1.0):.0%} of those in the body: contact forces may be wrong; take finite "
        "strains, as fm.energies.st_venant_kirchhoff"
        for label, (turn, ratio) in found.items()
        if turn > FREE_TURN and ratio > TURN_STRAIN
    )


def _squares(F: Array) -> Array:
    """Squares of the strains and spins of F (m, dim, dim), shape (m, 2) [1] (local)."""
    H = F - np.eye(F.shape[1])
    return np.stack([0.25 * ((H + s * H.swapaxes(1, 2)) ** 2).sum(axis=(1, 2)) for s in (1, -1)], 1)


def _turn(means: Array) -> tuple[float, float]:
    """Turn of a body [radian], zero if it bends, and the strain of the turn over those in the body.

    Args:
        means: Means over the body: one, F and ``_squares`` (local).
    """
    dim = math.isqrt(len(means) - 3)
    F, (strain, spin) = means[1:-2].reshape(1, dim, dim), means[-2:]
    mean = float(_squares(F)[0, 1])
    if spin - mean > BENT**2 * mean:
        return 0.0, 0.0
    turn = float(np.linalg.norm(vector_of(polar(F[0])[0])))
    return turn, math.sqrt(2.0) * (1.0 - math.cos(turn)) / max(math.sqrt(strain), TINY)
