# SPDX-License-Identifier: MIT
"""Work of friction in a step, by slip and by the motions of nodes and obstacles.

By slip it is the sum of shear forces times slips. By motions it is that of the forces on the nodes
of both sides and on the obstacle, which follow from D and M of both ends of the step. The measures
are independent of each other, and equal but for discretization errors if slip is the way along the
surface: a chord of a quarter of a turn is 10 % shorter.

A force that turns with the material of a node, by the rotation Q = exp(f) in a step, does the work

    (F_0 + Q^T F) / 2 . J(f)^-1 d

on a node that moves by d with a velocity that is constant in the frame of the material: on an arc,
in space on a screw line. J is that of ``arcs``. A constant tangential force on a turning shaft then
does the work of its moment. Only nodes that transfer shear at both ends of the step are compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, eye

from fenics_mortar.contact import arcs
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.obstacles.rigid_motion import inverse_jacobians, moments_of
from fenics_mortar.utils.arrays import SUM_ROUNDING, TINY, Array, first_largest, norms
from fenics_mortar.utils.errors import format_point
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.arcs import Led
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.interface.surfaces import Surface

# Difference between the work of friction by slip and by motions, over shear forces times motions,
# above which there is a remark [1]. In ironing with long steps, where nodes turn and stretch, it is
# 1.2 %; elsewhere below 0.3 %. A chord in place of the arc of 30 degrees is 1.1 % too short, of 45
# degrees 2.6 %; both count twice in a sine.
FRICTION_WORK = 0.03

# Rotation of both sides in a step before nodes come into contact, less that by supports [radian],
# 30 degrees, above which there is a remark: slip is then up to 4.5 % too small.
BOTH_TURN = np.pi / 6.0
# Error of the slip of such nodes over the slip [1], of all nodes by their friction limits, above
# which its sense may be wrong; the error is known up to a third of it.
SENSE = 0.7


def work_along_arcs(before: Array, after: Array, moved: Array, turned: Array) -> Array:
    """Work on each node in a step, shape (n,) [stress length^d] (local).

    Args:
        before: Forces at the start of the step, shape (n, d) [stress length^(d - 1)].
        after: Forces at its end, likewise.
        moved: Motions of the nodes, shape (n, d) [length].
        turned: Rotations of the material at the nodes, in the plane angles (n,) [radian], in space
            matrices (n, 3, 3) [1].
    """
    Q = turned
    if moved.shape[1] == 2:
        before, after, moved = (np.pad(v, ((0, 0), (0, 1))) for v in (before, after, moved))
        c, s, none = np.cos(turned), np.sin(turned), 0.0 * turned
        Q = np.array([[c, -s, none], [s, c, none], [none, none, none + 1.0]]).transpose(2, 0, 1)
    mean = 0.5 * (before + np.einsum("nba,nb->na", Q, after))
    way = inverse_jacobians(arcs.vectors_of(Q)[0])
    return np.asarray(np.einsum("na,nab,nb->n", mean, way, moved))


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Work of friction in the last step, and rotations of uncertain direction (collective)."""
    contact, law = measured.contact, measured.contact.pair.law
    if not law.needs_slip:
        return
    yield from findings(_difference_of_work(contact), *uncertain_rotation(contact))
    if contact.obstacle is None and contact.across_planes is not None:
        yield from _approach(measured)


def findings(work: float, rotation: float, where: str) -> Iterator[Finding]:
    """Findings of a difference of work [1] and an uncertain rotation [radian] there (local)."""
    degrees = float(np.degrees(rotation))
    yield Finding(
        "friction_work", "work of friction by slip and by motions: difference", work,
        f"the work of friction by slip differs by {work:.0%} from that of the motions of nodes and "
        "obstacle in the step: slip is not resolved; take smaller steps or finer facets",
        remark=FRICTION_WORK,
    )  # fmt: skip
    yield Finding(
        "rotation", "rotation in the step whose direction is uncertain", degrees,
        _on_rotation(degrees, where), limit=float(np.degrees(arcs.MAX_ROTATION)),
        remark=float(np.degrees(LIMITS.two_ways)), unit="degrees", where=where,
    )  # fmt: skip


def _on_rotation(degrees: float, where: str) -> str:
    """What a rotation whose direction is uncertain means."""
    rotation = f"the rotation of the sides relative to each other in the step, at {where}, is"
    most = float(np.degrees(arcs.MAX_ROTATION))
    if degrees > most:
        return (
            f"{rotation} known up to a full turn only, and with it the direction of slip: take "
            f"smaller steps, in which bodies turn by less than {most:.0f} degrees"
        )
    return (
        f"{rotation} {degrees:.0f} degrees, if not {360.0 - degrees:.0f} the other way round, with "
        "slip in the other direction: the ends of the step do not tell; if bodies turned by more "
        f"than {most:.0f} degrees, take smaller steps, follow_path, or a RigidBoundary, whose "
        "angle is known"
    )


def _difference_of_work(contact: Contact) -> float:
    """Difference of both measures of work over forces times motions [1] (collective).

    Zero if bodies were moved rigidly before the solve.
    """
    partners, o = contact.partners, contact.operators
    in_space, on_obstacle = o.slave.dim == 3, isinstance(o, ObstacleOperators)
    then = partners.shear
    if not in_space:
        then = then[:, None] * arcs.quarter_turn(partners.normals)
    both = (contact.active & (contact.z_tau != 0.0) & then.any(axis=1))[:, None]
    if not contact.pair.law.has_friction or partners.counted.any() or not both.any():
        return 0.0
    before = np.where(both, partners.weight[:, None] * then, 0.0)
    shear = np.where(both, contact.shear, 0.0)
    after = o.weight[:, None] * shear
    if in_space:
        at = partners.at(o)
        turned = np.einsum("nab,nb->na", at.slave.Q, before)
        by_slip = 0.5 * float(((turned + after) * at.slip).sum())
    else:
        sums = partners.weight * partners.shear + o.weight * contact.z_tau
        sizes = np.where(both[:, 0], sums, 0.0)
        by_slip = 0.5 * float(sizes @ contact.slip)
    starts = partners.D.T @ before, -(partners.M.T @ before)
    sides = (o.slave, partners.x, o.x), (o.master, partners.m, o.m)
    works = [
        _sums(f_0, f, x - x_0, _rotations(contact, surface, x_0, x))
        for f_0, f, (surface, x_0, x) in zip(starts, o.force(shear), sides, strict=False)
        if len(x)
    ]
    if on_obstacle:
        works.append(_work_on_obstacle(contact, before, after))
    return relative_difference(works, by_slip, after, o.x)


def _rotations(contact: Contact, surface: Surface, x_0: Array, x: Array) -> Array:
    """Rotations of the material at nodes, see ``work_along_arcs``; in space none if they are small.

    There directions of forces are kept with small sliding.
    """
    if surface.dim == 2:
        return arcs.surface_rotation(surface, x_0, x)  # type: ignore[arg-type]
    turns = 0.0 if contact.across_planes is None else 1.0
    weights, still = turns * csr_array(eye(len(x))), np.zeros(x.shape, bool)
    return arcs.Material(weights, surface, x_0, still).turned(x).Q


def relative_difference(
    works: list[tuple[float, float]], by_slip: float, forces: Array, x: Array
) -> float:
    """Difference of two measures of work [1] (local).

    Motions in the rounding of positions, as of nodes that stick to an obstacle, count as equal.

    Args:
        works: Parts of the work by motions, with their upper bounds [stress length^d].
        by_slip: Work by slip.
        forces: Shear forces at the end of the step, shape (n, ...) [stress length^(d - 1)].
        x: Positions of the slave nodes, shape (n, d) [length].
    """
    by_motions, size = (sum(values) for values in zip(*works, strict=True))
    rounding = SUM_ROUNDING * float(np.abs(x).max() * np.abs(forces).sum())
    return float(abs(by_motions - by_slip)) / max(size, rounding, TINY)


def _work_on_obstacle(contact: Contact, before: Array, after: Array) -> tuple[float, float]:
    """Work on an obstacle of shears (slave nodes, dim) at the nodes, and its bound (local)."""
    partners, o = contact.partners, contact.operators
    obstacle, dim = o.obstacle, o.obstacle.dim
    now, then = (obstacle.pivot + place[:dim] for place in (obstacle.place, partners.place))
    turned = partners.at(o).slave.Q if dim == 3 else arcs.surface_rotation(o.slave, partners.x, o.x)
    by_shift = _sums(-before, -after, np.broadcast_to(now - then, o.x.shape), turned)
    moments = moments_of(partners.x - then, before) + moments_of(o.x - now, after)
    by_turn = -0.5 * obstacle.turn_since(partners.place) @ moments
    return by_shift[0] + float(by_turn.sum()), by_shift[1] + float(np.abs(by_turn).sum())


def _sums(before: Array, after: Array, moved: Array, turned: Array) -> tuple[float, float]:
    """Sum of ``work_along_arcs``, and that of mean forces times motions (local)."""
    forces = 0.5 * (norms(before) + norms(after))
    work = work_along_arcs(before, after, moved, turned)
    return float(work.sum()), float(forces @ norms(moved))


def _approach(measured: Measured) -> Iterator[Finding]:
    """Rotation of both sides before nodes came into contact in the step (local).

    Motions that lead nodes are known, see ``arcs``, and left out. By other turns the slip that is
    counted until then is that of two rigid frames beside each other. It is exact if one of them
    rests. If the sides turn by a and b while the gap closes from g, as
    g (1 - cos a t) / (1 - cos a), slip is wrong by b g (1 - sin a / a) / (1 - cos a): of bodies
    that rub by a part 1 - sin a / a, of those that roll on each other by many times their slip.
    That is compared with the slip, and with the one that strains the bodies up to the friction
    limit. Slip by "operators" leaves out the gap g from which nodes come: half of the relative
    rotation turns it into slip.
    """
    contact, partners, o = measured.contact, measured.contact.partners, measured.contact.operators
    led = partners.led
    ends = (partners,) if led is None else (partners, led)
    relative: Array | float = 0.0
    if o.slave.dim == 2:
        slave, master = (
            np.abs(_from_start(led, *turns))
            for turns in (
                [arcs.surface_rotation(o.slave, at.x, o.x) for at in ends],
                [partners.M @ arcs.surface_rotation(o.master, at.m, o.m) for at in ends],
            )
        )
    else:
        found = partners.at(o)
        slave, master = (arcs.vectors_of(side.Q)[1] for side in (found.slave, found.master))
        relative = np.where(partners.present > 0.0, found.doubt, 0.0)
    start = norms(_from_start(led, *(partners.D @ at.x - partners.M @ at.m for at in ends)))
    apart = np.maximum(start, norms(partners.gap_vectors(o)))
    new = contact.active & (partners.pressure == 0.0) & (apart > contact.slave.nodal_lengths)
    both = np.where(new, np.minimum(slave, master), 0.0)
    degrees, where = float(np.degrees(both.max())), format_point(o.x[first_largest(both)])
    sagitta = np.maximum(1.0 - np.cos(slave), TINY)
    error = both * start * (1.0 - np.sinc(slave / np.pi)) / sagitta
    error += np.where(new, 0.5 * relative * start, 0.0)
    slip = partners.slip(o)
    sizes = np.abs(slip) if slip.ndim == 1 else norms(slip)
    bound, shared = measured.friction_limit, np.where(contact.active, o.weight, 0.0)
    limit = np.where(np.isfinite(bound), bound, 0.0)  # without a limit nodes do not slide
    width = float(shared.sum()) ** (1.0 / (contact.slave.dim - 1))
    sizes = sizes + width * limit / contact.modulus
    doubt = float((shared * limit) @ error) / max(float((shared * limit) @ sizes), TINY)
    turned = (
        f"nodes came into contact, one at {where}, after both sides had turned by {degrees:.0f} "
        "degrees in the step; slip is counted from its start, and"
    )
    yield Finding(
        "approach", "rotation of both sides before nodes came into contact", degrees,
        f"{turned} may be wrong by {1.0 - np.sinc(both.max() / np.pi):.0%}, or more where bodies "
        "roll: take smaller steps",
        remark=float(np.degrees(BOTH_TURN)), unit="degrees", where=where,
    )  # fmt: skip
    yield Finding(
        "approach_slip", "error of slip by rotations of both sides / slip", doubt,
        f"{turned} is wrong by {doubt:.2g} times its size, so that the direction of friction is "
        "unknown: take smaller steps",
        limit=SENSE, where=where,
    )  # fmt: skip


def _from_start(led: Led | None, *values: Array) -> Array:
    """Values at nodes since the start of the step, or where they are led since the motions."""
    return values[0] if led is None else led.origin(*values)


def uncertain_rotation(contact: Contact) -> tuple[float, str]:
    """Largest relative rotation of both sides in the step, as far as it is not known.

    Collective in space, at the first access to ``MortarOperators.vectors``; in the plane local.

    Returns:
        ``Partners.doubt`` of an active node [radian], and its position.
    """
    found = contact.partners.doubt(contact.operators, contact.turns(), contact.active)
    doubt = np.where(contact.active, found, 0.0)
    at = contact.operators.x[doubt.argmax()]
    return float(doubt.max()), format_point(at)
