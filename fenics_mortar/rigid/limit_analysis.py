# SPDX-License-Identifier: MIT
"""Limit analysis by linear programming: whether contact can support rigid bodies.

Loads with resultants w on the rigid motions v of all bodies are in equilibrium with contact forces
that the law admits if and only if they do no work on any motion that these forces cannot resist
(kinematic theorem, Charnes, Lemke & Zienkiewicz 1959). With the opening rate g_j and the slip rate
u_j of each touching node, and admissible forces p_j >= -a_j, |s_j| <= s_j0 + mu_j (p_j + a_j),

    maximize  (w - sum_j a_j g_j) . v - sum_j s_j0 |u_j|,    g_j >= mu_j |u_j|,    |v| <= 1.

If the maximum is positive, the bodies move. If it is zero, contact may support them; the condition
is necessary but not sufficient, since Coulomb's law is not associated: gaps do not open by as much
as g_j >= mu_j |u_j| requires. The solution of the contact problem then decides.

In space u_j is a vector. With k directions e_i around the normal, the largest e_i . u_j is at most
|u_j|, and at least cos(pi / k) |u_j|: shears in the polygon with the corners e_i are admissible,
and all admissible ones are in the polygon around the circle, larger by 1 / cos(pi / k). Bodies that
shears in the inner polygons can support are supported, those that shears in the outer ones cannot
support move. If neither is the case, k is doubled; at last, with loads within 0.5 % of the limit
load, contact may support them.

Response of contacts to rigid motions of bodies: gaps, slips, loose motions (collective).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, hstack, vstack

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields, gap_rate, opening_rate, slip_rate
from fenics_mortar.rigid.body_motions import BodyMotions
from fenics_mortar.rigid.proximal import RIGID, unresisted
from fenics_mortar.utils.arrays import SOLVED, Array, Flags

# Numbers of directions of slip in space, tried in turn [1]: with 32 the limit loads of inner and
# outer polygon differ by 0.5 %, as the error of the discretization.
DIRECTIONS = (8, 16, 32)


class Touching(NamedTuple):
    """n touching nodes of rigid bodies with m motions.

    Attributes:
        opening: Opening rate of each motion, shape (n, m) [1].
        slip: Slip rate of each motion, shape (n, m), in space along two tangents (n, 2, m) [1].
        slope: Coefficient of friction mu_j, inf for nodes that cannot slip, shape (n,) [1].
        shear: Friction s_j0 without pressure, shape (n,) [force].
        adhesion: Largest tensile force a_j, shape (n,) [force].
    """

    opening: Array
    slip: Array
    slope: Array
    shear: Array
    adhesion: Array


def unresisted_motion(loads: Array, touching: Touching) -> Array:
    """Rigid motion with the largest work of the loads that no contact force can resist (local).

    Args:
        loads: Resultants of the loads along the motions, shape (m,) [force].
        touching: The touching nodes.

    Returns:
        Coefficients of the motions, shape (m,), of absolute value at most one [length]; zero if
        contact may support the bodies.

    Raises:
        ArithmeticError: If the linear program fails.
    """
    size = float(np.abs(loads).sum())
    if size == 0.0:
        return np.zeros(loads.size)
    if touching.slip.ndim == 2:
        return _largest_work(loads, touching, np.stack([touching.slip, -touching.slip], axis=1))
    friction = touching.slope.any() or touching.shear.any()
    motion = np.zeros(loads.size)
    for count in DIRECTIONS if friction else (1,):
        slips = _along_directions(touching.slip, count)
        of_inner = _largest_work(loads, touching, slips)
        if not (friction and of_inner.any()):
            return of_inner
        motion = _largest_work(loads, touching, slips / np.cos(np.pi / count))
        if motion.any():
            break
    return motion


def _along_directions(slip: Array, count: int) -> Array:
    """Slips (n, 2, m) along ``count`` directions around the normal, shape (n, count, m) [1]."""
    angles = 2.0 * np.pi / count * np.arange(count)
    return np.einsum("ck,jcm->jkm", np.stack([np.cos(angles), np.sin(angles)]), slip)


def _largest_work(loads: Array, touching: Touching, slips: Array) -> Array:
    """See ``unresisted_motion``, with the largest of the ``slips`` (n, k, m) [1] for |u_j|."""
    size = float(np.abs(loads).sum())
    work = (loads - touching.adhesion @ touching.opening) / size
    sticks, bounded = np.isinf(touching.slope), touching.shear > 0.0
    slope, count = np.where(sticks, 0.0, touching.slope)[:, None], int(bounded.sum())
    along = np.moveaxis(slips, 1, 0)
    resisted = [
        *((slope * slip - touching.opening, 0.0) for slip in along),
        *((slip[sticks], 0.0) for slip in along),
        *((slip[bounded], 1.0) for slip in along),
    ]
    rows = vstack(
        [hstack([csr_array(row), -by_rate * _unit(len(row), count)]) for row, by_rate in resisted]
    )
    from scipy.optimize import linprog  # imported on first use: the import is slow

    costs = np.concatenate([-work, touching.shear[bounded] / size])
    bounds = [(-1.0, 1.0)] * loads.size + [(0.0, None)] * count
    found = linprog(
        costs,
        A_ub=rows,
        b_ub=np.zeros(rows.shape[0]),
        bounds=bounds,
        method="highs",
        options={"presolve": False},  # in scipy 1.10 it reports feasible programs as infeasible
    )
    if not found.success:
        raise ArithmeticError(f"linear program of rigid bodies: {found.message}")
    # SOLVED is above the feasibility tolerance of the linear program, 1e-7
    return found.x[: loads.size] if -found.fun > SOLVED else np.zeros(loads.size)


def _unit(rows: int, columns: int) -> csr_array:
    """Unit matrix if ``rows == columns``, else zeros, (rows, columns)."""
    shape = (rows, columns)
    return csr_array(np.eye(*shape)) if rows == columns else csr_array(shape)


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
        responses = np.hstack([np.zeros((len(body.motions), 0)), *resisted])
        known = np.isfinite(responses).all(axis=0)  # not at folded facets of a failed iteration
        free = unresisted(responses[:, known])
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
