# SPDX-License-Identifier: MIT
"""Moves of driven obstacles before a solve, and their slide during a solve.

An obstacle without contact is moved until contact stops it. An obstacle on sticking nodes follows
the prescribed motions, for instance a wheel that is turned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.rows import gap_by_motions
from fenics_mortar.rigid.motions import RigidMotions, describe_motion, slip_by_motions
from fenics_mortar.rigid.moves import closest_move
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.rounding import SUM_ROUNDING


def follow(motions: RigidMotions) -> Array:
    """Moves of driven obstacles with prescribed motions, such that nodes stick (local).

    Without these moves all nodes would slide by an undetermined distance. A move minimizes slip and
    opening of the sticking nodes; slip alone would not determine a motion along their normals.
    Operators are those of the present state.

    Returns:
        Shape (m, 3) [length], zero for remote loads.
    """
    moves = np.zeros(motions.scales.shape)
    for number, driven in enumerate(motions.driven_obstacles):
        mine = motions.contacts_of(number)
        slip = np.concatenate([_slip(c)[c.sticking].ravel() for c in mine])
        along = [slip_by_motions(c, c.sticking).reshape(-1, driven.size) for c in mine]
        across = np.concatenate([gap_by_motions(c.now)[c.sticking] for c in mine])
        rows = np.concatenate([*along, across])[:, driven]
        sizes = np.linalg.norm(rows, axis=0)  # units of turn and translation differ
        sizes[sizes == 0.0] = 1.0
        desired = np.concatenate([-slip, np.zeros(len(across))])
        moves[number, driven] = (
            np.linalg.lstsq(rows / sizes, desired, rcond=RIGID.followed)[0] / sizes
        )
    return moves


def _slip(contact: Contact) -> Array:
    """Slip of the nodes, (nodes,) [length]; in space along both tangents, (nodes, 2)."""
    now = contact.now
    return contact.slip if contact.slave.dim == 2 else now.along_tangents(now.slip_in_space)


def settle(motions: RigidMotions, evaluate: Callable[[], object]) -> list[str]:
    """Move driven obstacles without contact force until contact stops them (collective).

    Args:
        motions: The obstacles.
        evaluate: Function that evaluates the contacts at the present state.

    Returns:
        A sentence for each obstacle that was moved.

    Raises:
        MortarError: On all ranks, if no contact stops an obstacle.
    """
    moved = dict[str, None]()
    for _ in range(RIGID.max_moves):
        evaluate()
        moves = np.zeros(motions.scales.shape)
        for i in range(len(motions.obstacles)):
            moves[i] = _next_move(motions, i)
        moving = np.flatnonzero(moves.any(axis=1))
        if not moving.size:
            return [f"{name} was moved until contact stopped it" for name in moved]
        moved |= dict.fromkeys(f"obstacle '{motions.obstacles[i].name}'" for i in moving)
        motions.move(moves)
    free = moving[0]
    raise MortarError(
        f"obstacle '{motions.obstacles[free].name}' can {describe_motion(moves[free])} freely: its "
        "push drives it, and no contact stops it; prescribe that motion by move()"
    )


def _next_move(motions: RigidMotions, number: int) -> Array:
    """Motion of an obstacle towards contact, (3,) [length]; zero if loaded or not driven.

    The motion closest to the push for which no node overlaps by more than ``RIGID.overlap`` and the
    push does positive work. The potential of the push is linear; therefore no move is reversed
    later.
    """
    contacts = motions.contacts_of(number)
    driven, push = motions.driven[number], motions.push()[number]
    loaded = any((c.pressure > SUM_ROUNDING * c.modulus).any() for c in contacts)
    if loaded or not push.any():
        return np.zeros(push.size)
    basis = np.eye(push.size)[driven]
    along = (basis @ push) / np.linalg.norm(push)
    closing = [-gap_by_motions(contact.now) @ basis.T for contact in contacts]
    desired = RIGID.largest_move * contacts[0].arm * along
    move = closest_move(desired, closing, contacts, back=-along)
    if move @ along > RIGID.sliver * motions.shortest_facet():
        return move @ basis
    return np.zeros(push.size)


def slide_along_driven(motions: RigidMotions, start: Array) -> float:
    """Largest slide of obstacles along driven motions, over their contact width [1] (local).

    Zero for obstacles with a node that sticks or has no friction.

    Args:
        motions: The obstacles.
        start: Places at the start of the solve, shape (m, 3) [length, radian].
    """
    found = np.where(motions.driven, motions.motions_since(start), 0.0)
    widths = [0.0]
    for number, motion in enumerate(found[: len(motions.obstacles)]):
        mine = motions.contacts_of(number)
        slides = np.concatenate([c.sliding[c.active] for c in mine])
        if motion.any() and slides.size and slides.all():
            slips = [slip_by_motions(c, c.active) @ motion for c in mine]
            each = np.concatenate([slip.reshape(len(slip), -1) for slip in slips])
            widths.append(float(np.linalg.norm(each, axis=1).min()) / _width(mine))
    return max(widths)


def _width(contacts: Sequence[Contact]) -> float:
    """Width of the active part of contacts [length]; in space the root of its area."""
    power = contacts[0].slave.dim - 1
    sizes = [float((c.slave.nodal_lengths[c.active] ** power).sum()) for c in contacts]
    return float(sum(sizes) ** (1.0 / power))
