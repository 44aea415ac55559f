# SPDX-License-Identifier: MIT
"""Errors of the contact direction at corners, and pressure beside clamped slave nodes.

The force on a corner of the slave acts along its averaged normal, not along the normal of the
smooth surface on which it presses. The error has the effect of friction and is compared with the
friction. With the smooth surface as slave the direction is correct, but the position of a master's
corner between two slave nodes is uncertain by up to a tenth of the facet. Relative to the facet
length, neither error decreases with refinement. Both are detected by normals of the two sides that
are not opposite.

A clamped slave node carries no multiplier; its neighbours carry its force. If a body presses on the
very end of a clamped surface, its whole force acts on that neighbour, which can move: the force is
far too small on any mesh. This is detected by a pressure peak at the neighbour.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.laws import STICK
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import agreed, any_over_ranks, sum_over_ranks
from fenics_mortar.verify.balance import positive_or_one
from fenics_mortar.verify.limits import LIMITS


def oblique_forces(contact: Contact, pressure: Array) -> dict[str, Any]:
    """Fraction of the normal forces along the master's facets, and its position (collective).

    Args:
        contact: The pair. For an obstacle, which has no facets, the result is empty.
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    o, s = contact.operators, contact.operators.segments
    if contact.obstacle is not None:
        return {}
    chords = o.m[s.master[:, -1]] - o.m[s.master[:, 0]]
    chords /= np.hypot(*chords.T)[:, None]
    forces = np.abs(o.M.sum(axis=2) * pressure[s.slave])
    along = forces * np.abs(np.einsum("sjc,sc->sj", o.n[s.slave], chords))
    size = contact.slave.num_nodes
    nodal = np.stack([np.bincount(s.slave.ravel(), v.ravel(), size) for v in (forces, along)])
    nodal = sum_over_ranks(contact.slave.comm, nodal)
    total = positive_or_one(float(nodal[0].sum()))
    return {
        "oblique": float(nodal[1].sum()) / total,
        "oblique_at": format_point(o.x[nodal[1].argmax()]),
        **_at_corners(contact, nodal[0], total),
    }


def mean_friction(limit: Array, pressure: Array) -> float:
    """Sum of friction limits over sum of pressures, of nodes under pressure [1] (local).

    Args:
        limit: Friction limit of each node, shape (slave nodes,) [stress].
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    presses = (pressure > 0.0) & (limit > 0.0)
    return float(limit[presses].sum() / pressure[presses].sum()) if presses.any() else 0.0


def _at_corners(contact: Contact, forces: Array, total: float) -> dict[str, Any]:
    """Force along the surface due to averaged normals at corners of the slave (collective).

    The force on a node acts along its averaged normal. If the normal of the nearby master lies
    between those of the two slave facets at the node, a corner of the slave presses on the master,
    and the correct direction is the normal of the master. Otherwise it is the normal of the nearer
    slave facet. Beyond the end of a slave surface the body may continue at any angle.

    Args:
        contact: The pair.
        forces: Norms of the normal forces, shape (slave nodes,) [stress length].
        total: Their sum [stress length].
    """
    o = contact.operators
    before, after = facet_angles(contact)
    corners = (contact.active & (after - before > LIMITS.corner)).nonzero()[0]
    corners = agreed(contact.slave.comm, corners)
    if not corners.size:
        return {}
    runs = np.where(contact.active, runs_of(contact), -1)
    kept, labels = np.unique(runs[corners], return_inverse=True)
    low, high = np.minimum(before[corners], 0.0), np.maximum(after[corners], 0.0)
    around = [_master_around(contact, runs == run) for run in kept]
    normals = np.array([normal for normal, _ in around])
    angle = np.clip(_angle(o.n[corners], -normals[labels]), low, high)
    error = np.abs(np.bincount(labels, forces[corners] * np.sin(angle))).sum()
    largest, where = 0.0, ""
    for k in np.flatnonzero([is_flat for _, is_flat in around]):
        mine = labels == k
        first = np.flatnonzero(mine)[forces[corners[mine]].argmax()]
        across = _rotated(o.n[corners[first]], angle[first])
        if (contact.branch[corners[mine]] == STICK).any():
            excess = _excess_shear(contact, runs == kept[k], across)
            if excess > largest:
                largest, where = excess, format_point(o.x[corners[first]])
    return {
        "misdirected": float(error) / total, "excess_shear": largest, "excess_shear_at": where,
    }  # fmt: skip


def facet_angles(contact: Contact) -> tuple[Array, Array]:
    """Angles from the nodal normals to those of the facets before and after (local).

    Returns:
        Two arrays (slave nodes,) [radian]. At an end of the surface the body may continue at any
        angle: a quarter turn.
    """
    o, slave = contact.operators, contact.slave
    before, after = (
        np.where(beside < 0, end, _angle(o.n, _right_of(way * (o.x[beside] - o.x))))
        for beside, end, way in (
            (slave.previous, -np.pi / 2, -1.0),
            (slave.following, np.pi / 2, 1.0),
        )
    )
    return before, after


def _excess_shear(contact: Contact, run: Flags, across: Array) -> float:
    """Shear force of a run over the friction limit at its pressures, minus one [1] (local).

    Args:
        contact: The pair.
        run: Nodes of the run, shape (slave nodes,), bool.
        across: Direction of the pressures, a unit vector pointing out of the slave, shape (2,).
    """
    pressure = np.where(run, contact.z @ across, 0.0)
    limit = contact.now.friction_limit(pressure)
    weight = contact.operators.weight
    allowed = float((weight * np.where(run & (pressure > 0.0), limit, 0.0)).sum())
    shear = abs(float((weight * (contact.z @ _right_of(across[None])[0]))[run].sum()))
    return shear / allowed - 1.0 if allowed > 0.0 else 0.0


def _rotated(a: Array, angle: float) -> Array:
    """The vector ``a`` (2,), rotated to the left by ``angle`` [radian]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * a[0] - s * a[1], s * a[0] + c * a[1]])


def _master_around(contact: Contact, run: Flags) -> tuple[Array, bool]:
    """Normal of the master opposite to slave nodes, and whether it is flat (collective).

    The normal, shape (2,), is not scaled. It is that of a chord that extends beyond the nodes by
    some facets, since facets below a corner are indented.

    Args:
        contact: The pair.
        run: The active nodes of a run, shape (slave nodes,), bool.
    """
    o, s, master = contact.operators, contact.operators.segments, contact.master
    faced = np.zeros(master.num_nodes, bool)
    faced[s.master[run[s.slave].any(axis=1)]] = True
    faced = any_over_ranks(contact.slave.comm, faced)
    on_facet = faced[master.facets].all(axis=1)
    for _ in range(LIMITS.around_corner):
        faced[master.facets[on_facet]] = True
        on_facet = faced[master.facets].any(axis=1)
    ends = o.m[master.facets[on_facet]]
    chords = ends[:, -1] - ends[:, 0]
    along = chords.sum(axis=0)
    is_flat = bool((np.abs(_angle(chords, along)) < LIMITS.corner).all())
    return _right_of(along[None])[0], is_flat


def _right_of(directions: Array) -> Array:
    """Rotate vectors (n, 2) by a quarter turn to the right."""
    return np.stack([directions[:, 1], -directions[:, 0]], axis=1)


def _angle(a: Array, b: Array) -> Array:
    """Angles from vectors ``a`` to ``b``, shapes (..., 2) [radian]."""
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.arctan2(cross, (a * b).sum(axis=-1))


def runs_of(contact: Contact, active: Flags | None = None) -> Indices:
    """Numbers of the runs of neighbouring active nodes, shape (slave nodes,).

    Args:
        contact: The pair.
        active: Marked nodes instead of the active ones, shape (slave nodes,), bool.
    """
    active, before = contact.active if active is None else active, contact.slave.previous
    own = np.arange(active.size)
    back = np.where(active & (before >= 0) & active[before], before, own)
    least = own  # smallest number of the nodes passed backwards
    for _ in range(active.size.bit_length()):
        least, back = np.minimum(least, least[back]), back[back]
    return least[back]  # that of the first node, or of a whole closed curve


def end_pressure(contact: Contact, pressure: Array) -> dict[str, Any]:
    """Largest ratio of the pressure beside a clamped slave node to that of the next nodes (local).

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    slave, degree = contact.slave, contact.slave.degree
    prescribed = (contact.free == 0.0).any(axis=1) & ~contact.may_carry
    if not prescribed.any():
        return {}
    around = slave.along(np.flatnonzero(prescribed), range(-3 * degree, 3 * degree + 1))
    there = np.where(around >= 0, pressure[around], 0.0)
    beside = there[:, 2 * degree : 4 * degree + 1].max(axis=1, initial=0.0)
    there[:, 2 * degree : 4 * degree + 1] = 0.0
    counts = beside > LIMITS.at_corners * pressure.max(initial=0.0)
    beside = np.where(counts, beside, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(beside / there.max(axis=1, initial=0.0), posinf=np.inf)
    if not ratio.any():
        return {}
    where = contact.operators.x[np.flatnonzero(prescribed)[ratio.argmax()]]
    return {"end_pressure": float(ratio.max()), "end_pressure_at": format_point(where)}
