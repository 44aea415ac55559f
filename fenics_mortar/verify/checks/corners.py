# SPDX-License-Identifier: MIT
"""Errors at corners of both sides, at clamped ends, and of resultants beyond the end of a side.

The force on a corner of the slave acts along its averaged normal, not along the normal of the
smooth surface on which it presses. The error has the effect of friction and is compared with the
friction. With the smooth surface as slave the direction is correct, but the position of a master's
corner between two slave nodes is uncertain by up to a tenth of the facet. Relative to the facet
length, neither error decreases with refinement. Both are detected by normals of the two sides that
are not opposite.

In space the force on a sharp edge of the slave that is oblique to the master on both sides, as that
of a knife, acts along an average that depends on the facets beside the edge, not along the normal
of the surface on which the edge presses.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fenics_mortar.contact.arcs import quarter_turn, rotated_by
from fenics_mortar.contact.law import STICK
from fenics_mortar.kernels.projection import lagrange
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import Array, Flags, Indices, angles_between, first_largest
from fenics_mortar.verify.checks.balance import positive_or_one
from fenics_mortar.verify.finding import INFINITE, LIMITS, Finding, Measured

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact

# With friction, fraction of the friction above which there is a remark on forces along the surface
# at corners [1]. Measured on wedges of 90 to 150 degrees: if the error of the ratio of shear and
# normal force is 5 %, the estimate is 3.5 to 6 %.
OF_FRICTION = 0.04
# Number of facets beside a corner that define the direction of the opposite surface.
AROUND_CORNER = 3


def of_contact(measured: Measured) -> Iterator[Finding]:
    """Errors at corners of slave and master, at clamped and at free ends (collective).

    In space at sharp edges of the slave.
    """
    if measured.contact.slave.dim == 3:
        yield from _at_sharp_edges(measured)
        return
    yield from _at_clamped_ends(measured)
    yield from _of_surfaces(measured)
    yield from _of_resultants(measured)


def _of_surfaces(measured: Measured) -> Iterator[Finding]:
    """Angle between the surfaces, friction, and errors at corners of the slave (collective).

    Yields:
        ``surface_angle``: fraction of the forces along the slave normals that acts along the facets
        of the master, of first order in the facet length where both surfaces are smooth, of second
        order on quadratic facets;
        ``corner_shear``: fraction of the normal forces that acts along the surface because corners
        of the slave have averaged normals, an error of the ratio of shear and normal force, with
        contributions of neighbouring active nodes added with their signs; ``excess_shear``: where
        corners of the slave stick on a flat master, excess of the shear along the master over the
        friction limit at the pressure on it, over that limit; ``friction``: friction limit over
        pressure, mean of all nodes under pressure, inf for the law ``Stick``. The last three with
        friction only. For an obstacle, which has no facets, ``friction`` alone.
    """
    contact, friction = measured.contact, measured.friction
    if contact.pair.law.has_friction:
        yield Finding("friction", "mean friction limit / pressure", friction)
    if contact.obstacle is not None:
        return
    forces, along = _forces_along_master(contact, measured.pressure)
    total = positive_or_one(float(forces.sum()))
    angle = float(along.sum()) / total
    where = errors.format_point(contact.operators.x[first_largest(along)])
    shear, excess, sticks_at = _at_corners(measured, forces, total)
    is_slave = shear > 0.5 * LIMITS.at_corners
    known = "direction and depth are" if is_slave else "depth is"
    remedy = "take the other side as slave, round it" if is_slave else "round it"
    yield Finding(
        "surface_angle", "angle between facing surfaces", angle,
        f"{angle:.0%} of the normal forces act along the master's facets, most of them at {where}: "
        f"where a corner presses, {known} accurate to a fraction of a facet only; {remedy}, or "
        "refine the facets",
        remark=INFINITE if friction > 0.0 else LIMITS.at_corners, unit="sine", where=where,
    )  # fmt: skip
    if not contact.pair.law.has_friction:
        return
    limit = min(LIMITS.at_corners, max(OF_FRICTION * friction, LIMITS.negligible))
    yield Finding(
        "corner_shear", "force along the surface due to corners / normal force", shear,
        f"{shear:.1%} of the normal forces act along the surface, compared with a friction of "
        f"{friction:.2g}: a corner of the slave presses at {where}, along its averaged normal; "
        f"{contact.other_roles}round the corner",
        remark=limit if friction > 0.0 else INFINITE, where=where,
    )  # fmt: skip
    yield Finding(
        "excess_shear", "shear of sticking corners above the friction limit / that limit", excess,
        f"a corner of the slave sticks at {sticks_at}, but the shear along '{contact.master.name}' "
        f"is {excess:.1%} above the friction limit: the direction of the force on a corner, that "
        f"of its averaged normal, is not resolved; {contact.other_roles}round the corner",
        limit=LIMITS.at_corners, remark=OF_FRICTION, where=sticks_at,
    )  # fmt: skip


def _forces_along_master(contact: Contact, pressure: Array) -> tuple[Array, Array]:
    """Normal forces and their components along the master's facets, (slave nodes,) (collective).

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].

    Returns:
        Two arrays of norms, each (slave nodes,) [stress length].
    """
    o, s = contact.operators, contact.operators.segments
    m, x = o.m[s.master], o.x[s.slave]
    chords = m[:, -1] - m[:, 0]
    part = np.einsum("sjc,sc->sj", x - m[:, :1], chords) / (chords**2).sum(axis=1)[:, None]
    slopes = lagrange(2.0 * np.clip(part, 0.0, 1.0) - 1.0, contact.master.degree)[1]
    tangents = np.einsum("sjk,skc->sjc", slopes, m)  # where facets are nearest to the nodes
    tangents /= np.hypot(tangents[..., 0], tangents[..., 1])[..., None]
    forces = np.abs(o.M.sum(axis=2) * pressure[s.slave])
    along = forces * np.abs(np.einsum("sjc,sjc->sj", o.n[s.slave], tangents))
    size = contact.slave.num_nodes
    nodal = np.stack([np.bincount(s.slave.ravel(), v.ravel(), size) for v in (forces, along)])
    forces, along = ranks.sum_over_ranks(contact.slave.comm, nodal)
    return forces, along


def _at_corners(measured: Measured, forces: Array, total: float) -> tuple[float, float, str]:
    """Force along the surface due to averaged normals at corners of the slave (collective).

    The force on a node acts along its averaged normal. If the normal of the nearby master lies
    between those of the two slave facets at the node, a corner of the slave presses on the master,
    and the correct direction is the normal of the master. Otherwise it is the normal of the nearer
    slave facet. Beyond the end of a slave surface the body may continue at any angle.

    Args:
        measured: The pair.
        forces: Norms of the normal forces, shape (slave nodes,) [stress length].
        total: Their sum [stress length].
    """
    contact = measured.contact
    o = contact.operators
    before, after = facet_angles(contact)
    corners = (contact.active & (after - before > LIMITS.corner)).nonzero()[0]
    corners = ranks.agreed(contact.slave.comm, corners)
    if not corners.size:
        return 0.0, 0.0, ""
    runs = np.where(contact.active, runs_of(contact), -1)
    kept, labels = np.unique(runs[corners], return_inverse=True)
    low, high = np.minimum(before[corners], 0.0), np.maximum(after[corners], 0.0)
    around = [_master_around(contact, runs == run) for run in kept]
    normals = np.array([normal for normal, _ in around])
    angle = np.clip(angles_between(o.n[corners], -normals[labels]), low, high)
    error = np.abs(np.bincount(labels, forces[corners] * np.sin(angle))).sum()
    largest, where = 0.0, ""
    for k in np.flatnonzero([is_flat for _, is_flat in around]):
        mine = labels == k
        first = np.flatnonzero(mine)[first_largest(forces[corners[mine]])]
        across = rotated_by(o.n[corners[first]], angle[first])
        if (contact.branch[corners[mine]] == STICK).any():
            excess = _excess_shear(measured, runs == kept[k], across)
            if excess > largest:
                largest, where = excess, errors.format_point(o.x[corners[first]])
    return float(error) / total, largest, where


def facet_angles(contact: Contact) -> tuple[Array, Array]:
    """Angles from the nodal normals to those of the facets before and after (local).

    Returns:
        Two arrays (slave nodes,) [radian]. At an end of the surface the body may continue at any
        angle: a quarter turn.
    """
    o, slave = contact.operators, contact.slave
    before, after = (
        np.where(beside < 0, end, angles_between(o.n, -quarter_turn(way * (o.x[beside] - o.x))))
        for beside, end, way in (
            (slave.previous, -np.pi / 2, -1.0),
            (slave.following, np.pi / 2, 1.0),
        )
    )
    return before, after


def _excess_shear(measured: Measured, run: Flags, across: Array) -> float:
    """Shear force of a run over the friction limit at its pressures, minus one [1] (local).

    Limits are at least those over which the error of the solution is no remark.

    Args:
        measured: The pair.
        run: Nodes of the run, shape (slave nodes,), bool.
        across: Direction of the pressures, a unit vector pointing out of the slave, shape (2,).
    """
    contact = measured.contact
    pressure = np.where(run, contact.z @ across, 0.0)
    limit = contact.now.friction_limit(pressure)
    weight = contact.operators.weight
    allowed = float((weight * np.where(run & (pressure > 0.0), limit, 0.0)).sum())
    shear = abs(float((weight * (contact.z @ -quarter_turn(across)))[run].sum()))
    return shear / max(allowed, measured.solved / OF_FRICTION) - 1.0 if allowed > 0.0 else 0.0


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
    faced = ranks.any_over_ranks(contact.slave.comm, faced)
    on_facet = faced[master.facets].all(axis=1)
    for _ in range(AROUND_CORNER):
        faced[master.facets[on_facet]] = True
        on_facet = faced[master.facets].any(axis=1)
    ends = o.m[master.facets[on_facet]]
    chords = ends[:, -1] - ends[:, 0]
    along = chords.sum(axis=0)
    is_flat = bool((np.abs(angles_between(chords, along)) < LIMITS.corner).all())
    return -quarter_turn(along), is_flat


def runs_of(contact: Contact) -> Indices:
    """Numbers of the runs of neighbouring active nodes, shape (slave nodes,)."""
    active, before = contact.active, contact.slave.previous
    own = np.arange(active.size)
    back = np.where(active & (before >= 0) & active[before], before, own)
    least = own  # smallest number of the nodes passed backwards
    for _ in range(active.size.bit_length()):
        least, back = np.minimum(least, least[back]), back[back]
    return least[back]  # that of the first node, or of a whole closed curve


# Ratio of the pressure beside clamped slave nodes to that of the next nodes above which there is a
# remark [1].
END_PRESSURE = 2.0


def _at_clamped_ends(measured: Measured) -> Iterator[Finding]:
    """Largest ratio of the pressure beside a clamped slave node to that of the next nodes."""
    ratio, where = end_pressure(measured.contact, measured.pressure)
    yield Finding(
        "end_pressure", "pressure beside a clamped slave node / that farther away", ratio,
        f"a body presses on a clamped slave node, at {where}, which carries no multiplier: the "
        "force may be far too small; take the other body as slave",
        remark=END_PRESSURE, where=where,
    )  # fmt: skip


def end_pressure(contact: Contact, pressure: Array) -> tuple[float, str]:
    """Largest ratio [1], and the position of the clamped node; 0 and "" without one (local).

    A clamped slave node carries no multiplier; its neighbours carry its force. If a body presses on
    the very end of a clamped surface, its whole force acts on that neighbour, which can move: the
    force is far too small on any mesh. This is detected by a pressure peak at the neighbour. A node
    on the axis of revolution without a weight, of quadratic facets, is not clamped: only its radial
    component is prescribed, and pressures below a tip are large there.

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].
    """
    slave, degree = contact.slave, contact.slave.degree
    on_axis = slave.weightless & (contact.free == 1.0).any(axis=1)
    prescribed = (contact.free == 0.0).any(axis=1) & ~contact.may_carry & ~on_axis
    if not prescribed.any():
        return 0.0, ""
    around = slave.along(np.flatnonzero(prescribed), range(-3 * degree, 3 * degree + 1))
    there = np.where(around >= 0, pressure[around], 0.0)
    beside = there[:, 2 * degree : 4 * degree + 1].max(axis=1, initial=0.0)
    there[:, 2 * degree : 4 * degree + 1] = 0.0
    counts = beside > LIMITS.at_corners * pressure.max(initial=0.0)
    beside = np.where(counts, beside, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(beside / there.max(axis=1, initial=0.0), posinf=np.inf)
    if not ratio.any():
        return 0.0, ""
    where = contact.operators.x[np.flatnonzero(prescribed)[ratio.argmax()]]
    return float(ratio.max()), errors.format_point(where)


def _of_resultants(measured: Measured) -> Iterator[Finding]:
    """Largest distance of a resultant beyond the cover, over the longest facet (collective).

    The resultant of the pressure lies on the covered part of the surface. By balance of forces and
    moments, a node at the uncovered end of a partly covered facet carries a fraction of the force
    on the covered part. If such a facet is the only active one, as under a body about to tip over
    an edge, the whole force may be carried by that node, beyond the edge. The limit load is then
    larger than in the limit of fine meshes.

    Runs with tensile nodes are excluded, since their resultant may lie anywhere; so are obstacles,
    which have no ends.
    """
    contact = measured.contact
    if contact.obstacle is not None:
        return
    o, runs = contact.operators, runs_of(contact)
    forces = np.einsum("jc,jc->j", contact.now.forces[0], o.n)
    found = [
        _beyond(contact, np.flatnonzero(contact.active & (runs == run)), forces)
        for run in np.unique(runs[contact.active])
    ]
    beyond, where = max(found, default=(0.0, ""))
    yield Finding(
        "resultant_outside", "resultant of pressures beyond the covered surface", beyond,
        f"the resultant of the pressures acts at {where}, {beyond:.2f} facets outside of the part "
        "of the slave that the master covers: the limit load of this mesh may be above that of a "
        "finer one",
        remark=LIMITS.coarse_distance, unit="facet lengths", where=where,
    )  # fmt: skip


def _beyond(contact: Contact, nodes: Indices, forces: Array) -> tuple[float, str]:
    """Distance of the resultant beyond the cover in facets, and its position (collective)."""
    o, s = contact.operators, contact.intersections()
    marked = np.zeros(len(o.x), bool)
    marked[nodes] = True
    touched = marked[s.slave].any(axis=1)
    first, last = o.x[s.slave[touched, 0]], o.x[s.slave[touched, -1]]
    along = ranks.sum_over_ranks(contact.slave.comm, (last - first).sum(axis=0))
    size = float(np.linalg.norm(along))
    along = along / positive_or_one(size)
    fractions = 0.5 * (1.0 + s.ends[touched])
    covered = (first @ along)[:, None] + ((last - first) @ along)[:, None] * fractions
    longest = float(np.linalg.norm(last - first, axis=1).max(initial=0.0))
    bounds = np.array([covered.max(initial=-np.inf), -covered.min(initial=np.inf), longest])
    bounds = ranks.largest_over_ranks(contact.slave.comm, bounds)
    pulls = bool((forces[nodes] < 0.0).any()) or not forces[nodes].any()
    if pulls or size == 0.0:
        return 0.0, ""
    centre = forces[nodes] @ o.x[nodes] / forces[nodes].sum()
    at = float(centre @ along)
    return max(at - bounds[0], -at - bounds[1], 0.0) / float(bounds[2]), errors.format_point(centre)


def _at_sharp_edges(measured: Measured) -> Iterator[Finding]:
    """Fraction of the normal forces that acts along the master at sharp edges (collective)."""
    contact, limit = measured.contact, LIMITS.at_corners
    sharp = contact.evaluation.sharp_edges.nodes
    if contact.obstacle is not None or not sharp.size:
        return
    forces, along = _forces_along_faces(contact, measured.pressure)
    shear = float(along[sharp].sum()) / positive_or_one(float(forces.sum()))
    compared, where = (
        "",
        errors.format_point(contact.operators.x[sharp[first_largest(along[sharp])]]),
    )
    if contact.pair.law.has_friction and measured.friction > 0.0:
        limit = min(limit, max(OF_FRICTION * measured.friction, LIMITS.negligible))
        compared = f", compared with a friction of {measured.friction:.2g}"
    yield Finding(
        "corner_shear", "force along the surface due to sharp edges / normal force", shear,
        f"{shear:.1%} of the normal forces act along '{contact.master.name}'{compared}: a sharp "
        f"edge of the slave presses at {where}, along the normal of a facet beside it, or their "
        "average; "
        f"{contact.other_roles}round the edge",
        remark=limit, where=where,
    )  # fmt: skip


def _forces_along_faces(contact: Contact, pressure: Array) -> tuple[Array, Array]:
    """Normal forces and their components along the master's facets, (slave nodes,) (collective).

    Args:
        contact: The pair.
        pressure: Normal multipliers, shape (slave nodes,) [stress].

    Returns:
        Two arrays of norms, each (slave nodes,) [stress length^2].
    """
    o, s = contact.operators, contact.operators.segments
    nodes, corners = o.facet_nodes[s.owner], o.m[s.master[:, : contact.master.corners.shape[1]]]
    ends = corners[:, -2] - corners[:, 0], corners[:, -1] - corners[:, -3]  # diagonals or edges
    normals = np.cross(*ends)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    forces = (o.M.sum(axis=2) * pressure[nodes])[..., None] * o.n[nodes]
    across = np.einsum("pkc,pc->pk", forces, normals)
    nodal = np.zeros((2, len(o.x), 3))
    np.add.at(nodal[0], nodes, forces)
    np.add.at(nodal[1], nodes, forces - across[..., None] * normals[:, None])
    total, along = np.linalg.norm(ranks.sum_over_ranks(contact.slave.comm, nodal), axis=2)
    return total, along
