# SPDX-License-Identifier: MIT
"""Work of friction in a step, by slip and by the motions of nodes and obstacles.

By slip it is the sum of shear forces times slips. By motions it is that of the forces on the nodes
of both sides and on the obstacle, which follow from D and M of both ends of the step. The measures
are independent of each other, and equal but for discretization errors if slip is the way along the
surface: a chord of a quarter of a turn is 10 % shorter.

The force on a node turns with the normal of the surface by an angle a, and so does its velocity:
the mean force is that of both forces rotated by a / 2 and -a / 2, and the path is the chord times
(a / 2) / sin(a / 2). A constant tangential force on a turning shaft then does the work of its
moment. Only nodes that transfer shear at both ends of the step are compared.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fenics_mortar.contact.arcs import MAX_ROTATION, quarter_turn, surface_rotation
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.slip import centre_of
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.utils.arrays import Array, Flags, norms
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.rounding import SUM_ROUNDING, TINY
from fenics_mortar.verify.finding import LIMITS, Finding, Measured

IN_PLANE_ONLY = True

# Difference between the work of friction by slip and by motions, over shear forces times motions,
# above which there is a remark [1]. In ironing with long steps, where nodes turn and stretch, it is
# 1.2 %; elsewhere below 0.3 %. A chord in place of the arc of 30 degrees is 1.1 % too short, of 45
# degrees 2.6 %; both count twice in a sine.
FRICTION_WORK = 0.03

# Rotation of both sides in a step before nodes come into contact [radian], 30 degrees, above which
# there is a remark: slip is then up to 4.5 % too small.
BOTH_TURN = np.pi / 6.0
# Error of the slip of such nodes over the slip [1], of all nodes by their friction limits, above
# which its sense may be wrong; the error is known up to a third of it.
SENSE = 0.7

Forces = tuple[Array, Array]


def work_along_arcs(before: Array, after: Array, moved: Array, angle: Array) -> Array:
    """Work on each node in a step, shape (n,) [stress length^2] (local).

    Args:
        before: Forces at the start of the step, shape (n, 2) [stress length].
        after: Forces at its end, likewise.
        moved: Motions of the nodes, shape (n, 2) [length].
        angle: Rotations of the surface at the nodes, shape (n,) [radian].
    """
    c, s = np.cos(0.5 * angle)[:, None], np.sin(0.5 * angle)[:, None]
    mean = 0.5 * (c * (before + after) + s * quarter_turn(before - after))
    longer = 1.0 / np.sinc(0.5 * angle / np.pi)
    return np.asarray(longer * np.einsum("nc,nc->n", mean, moved))


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Work of friction in the last step, and rotations of uncertain direction (collective)."""
    contact, law = measured.contact, measured.contact.pair.law
    if not (law.has_friction or law.needs_nodal_state):
        return
    yield from findings(_difference_of_work(contact), *uncertain_rotation(contact))
    if contact.obstacle is None and contact.rotating_planes is not None:
        o, partners = contact.operators, contact.partners
        slave = np.abs(surface_rotation(o.slave, partners.x, o.x))
        master = np.abs(partners.M @ surface_rotation(o.master, partners.m, o.m))
        yield from approach(measured, slave, master)


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
        _on_rotation(degrees, where), limit=float(np.degrees(MAX_ROTATION)),
        remark=float(np.degrees(LIMITS.two_ways)), unit="degrees", where=where,
    )  # fmt: skip


def _on_rotation(degrees: float, where: str) -> str:
    """What a rotation whose direction is uncertain means."""
    rotation = f"the rotation of the sides relative to each other in the step, at {where}, is"
    most = float(np.degrees(MAX_ROTATION))
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
    shear = np.where(contact.active, contact.z_tau, 0.0)
    both = (shear != 0.0) & (partners.shear != 0.0)
    if not contact.pair.law.has_friction or partners.counted.any() or not both.any():
        return 0.0
    before = np.where(both, partners.weight * partners.shear, 0.0)
    after = np.where(both, o.weight * shear, 0.0)
    by_slip = 0.5 * (before + after) @ contact.slip
    works = _works_on_nodes(contact, both, before)
    if isinstance(o, ObstacleOperators):
        works = [*works, _work_on_obstacle(contact, before, after)]
    return relative_difference(works, float(by_slip), after, o.x)


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


def _works_on_nodes(contact: Contact, both: Flags, before: Array) -> list[tuple[float, float]]:
    """Work of the shear on the nodes of each side, and its upper bound (collective)."""
    partners, o = contact.partners, contact.operators
    start = before[:, None] * quarter_turn(partners.normals)
    at_start = partners.D.T @ start, -(partners.M.T @ start)
    at_end = o.force(np.where(both[:, None], contact.shear, 0.0))
    sides = (o.slave, partners.x, o.x), (o.master, partners.m, o.m)
    return [
        _sums(f_0, f, x - x_0, surface_rotation(surface, x_0, x))
        for f_0, f, (surface, x_0, x) in zip(at_start, at_end, sides, strict=True)
        if len(x)
    ]


def _work_on_obstacle(contact: Contact, before: Array, after: Array) -> tuple[float, float]:
    """Work on an obstacle, by forces of the slave nodes and their moments; its bound (local)."""
    partners, o = contact.partners, contact.on_obstacle
    now, then = centre_of(o.obstacle), o.obstacle.pivot + partners.place[:2]
    angle = surface_rotation(o.slave, partners.x, o.x)
    start, end = (
        (-size[:, None] * quarter_turn(n), -size * np.einsum("jc,jc->j", n, x - centre))
        for size, n, x, centre in (
            (before, partners.normals, partners.x, then),
            (after, o.n, o.x, now),
        )
    )
    moved = np.broadcast_to(now - then, o.x.shape)
    by_turn = 0.5 * float(o.obstacle.place[2] - partners.place[2]) * (start[1] + end[1])
    by_force, size = _sums(start[0], end[0], moved, angle)
    return by_force + float(by_turn.sum()), size + float(np.abs(by_turn).sum())


def _sums(before: Array, after: Array, moved: Array, angle: Array) -> tuple[float, float]:
    """Sum of ``work_along_arcs``, and that of mean forces times motions (local)."""
    forces = 0.5 * (np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1))
    work = work_along_arcs(before, after, moved, angle)
    return float(work.sum()), float(forces @ np.linalg.norm(moved, axis=1))


def approach(
    measured: Measured, slave: Array, master: Array, relative: Array | float = 0.0
) -> Iterator[Finding]:
    """Rotation of both sides before nodes came into contact in the step (local).

    The slip that is counted until then is that of two rigid frames beside each other. It is exact
    if one of them rests. If the sides turn by a and b while the gap closes from g, as
    g (1 - cos a t) / (1 - cos a), slip is wrong by b g (1 - sin a / a) / (1 - cos a): of bodies
    that rub by a part 1 - sin a / a, of those that roll on each other by many times their slip.
    That is compared with the slip, and with the one that strains the bodies up to the friction
    limit. Slip by "operators" leaves out the gap g from which nodes come: half of the relative
    rotation turns it into slip.

    Args:
        measured: The pair.
        slave: Sizes of the rotations of the slave's material at its nodes, (slave nodes,) [radian].
        master: Those of the master's material at the partners.
        relative: Relative rotation at nodes whose slip is measured by "operators", else zero.
    """
    contact = measured.contact
    partners, o = contact.partners, contact.operators
    start = norms(partners.D @ partners.x - partners.M @ partners.m)
    apart = np.maximum(start, norms(partners.gap_vectors(o)))
    new = contact.active & (partners.pressure == 0.0) & (apart > contact.slave.nodal_lengths)
    both = np.where(new, np.minimum(slave, master), 0.0)
    degrees, where = float(np.degrees(both.max())), format_point(o.x[both.argmax()])
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


def uncertain_rotation(contact: Contact) -> tuple[float, str]:
    """Largest relative rotation of both sides in the step, as far as it is not known.

    Collective in space, at the first access to ``MortarOperators.vectors``; in the plane local.

    Returns:
        ``Partners.doubt`` of an active node [radian], and its position.
    """
    found = contact.partners.doubt(contact.operators, contact.turns())
    doubt = np.where(contact.active, found, 0.0)
    at = contact.operators.x[doubt.argmax()]
    return float(doubt.max()), format_point(at)
