# SPDX-License-Identifier: MIT
"""Moves of driven obstacles before a solve, and how far a solve has moved them of its own accord.

An obstacle that touches nothing is moved until contact stops it; one on nodes that stick follows
the prescribed motions, as a wheel that is turned.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fenics_mortar.rigid.motions import ObstacleMotions, in_words, slip_by_motions
from fenics_mortar.rigid.moves import closest_move
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError


def follow(motions: ObstacleMotions) -> Array:
    """Moves of driven obstacles along with prescribed motions, so that nodes stick (local).

    From where they were all nodes would slide, and nothing would say how far. A move is the one
    with the least slip and opening of these nodes: slip alone would move an obstacle far off along
    their normals. Operators are those of the present state.

    Returns:
        Shape (obstacles, 3) [length].
    """
    moves = np.zeros(motions.scales.shape)
    for number, driven in enumerate(motions.driven):
        mine = motions.contacts_of(number)
        slip = np.concatenate([c.slip[c.sticking] for c in mine])
        along = np.concatenate([slip_by_motions(c, c.sticking) for c in mine])
        across = np.concatenate([c.gap_by_motions()[c.sticking] for c in mine])
        rows = np.concatenate([along, across])[:, driven]
        sizes = np.linalg.norm(rows, axis=0)  # a turn has other units than a translation
        sizes[sizes == 0.0] = 1.0
        wanted = np.concatenate([-slip, np.zeros(slip.size)])
        moves[number, driven] = (
            np.linalg.lstsq(rows / sizes, wanted, rcond=RIGID.followed)[0] / sizes
        )
    return moves


def settle(motions: ObstacleMotions, evaluate: Callable[[], object]) -> list[str]:
    """Move driven obstacles that carry no contact force until contact stops them (collective).

    Args:
        motions: The obstacles.
        evaluate: Evaluates the contacts at the present state.

    Returns:
        Sentences that name those that were moved.

    Raises:
        MortarError: On all ranks, if nothing stops an obstacle.
    """
    moved = dict[str, None]()
    for _ in range(RIGID.max_moves):
        evaluate()
        moves = np.array([_next_move(motions, i) for i in range(len(motions.obstacles))])
        moving = np.flatnonzero(moves.any(axis=1))
        if not moving.size:
            return [f"{name} was moved until contact stopped it" for name in moved]
        moved |= dict.fromkeys(f"obstacle '{motions.obstacles[i].name}'" for i in moving)
        motions.move(moves)
    stray = moving[0]
    raise MortarError(
        f"obstacle '{motions.obstacles[stray].name}' can {in_words(moves[stray])} freely: its "
        "push drives it, and no contact stops it; prescribe that motion by move()"
    )


def _next_move(motions: ObstacleMotions, number: int) -> Array:
    """Motion of one obstacle towards contact, shape (3,); zero if it is there, or not driven.

    It is the one closest to the push that no node overlaps by more than touching, and that the push
    does work in: its potential is linear in the motions, so no move is ever taken back.
    """
    contacts = motions.contacts_of(number)
    driven, push = motions.driven[number], motions.push()[number]
    loaded = any((c.pressure > RIGID.rounding * c.modulus).any() for c in contacts)
    if loaded or not push.any():
        return np.zeros(3)
    basis = np.eye(3)[driven]
    along = (basis @ push) / np.linalg.norm(push)
    closing = [-contact.gap_by_motions() @ basis.T for contact in contacts]
    wanted = RIGID.largest_move * contacts[0].arm * along
    move = closest_move(wanted, closing, contacts, back=-along)
    if move @ along > RIGID.least_advance * motions.shortest_facet():
        return move @ basis
    return np.zeros(3)


def own_slide(motions: ObstacleMotions, start: Array) -> float:
    """Slide of an obstacle along all of its nodes by driven motions, in widths of its contact.

    Zero where a node sticks or has no friction; largest of all obstacles.

    Args:
        motions: The obstacles.
        start: Motions at the start of the solve, shape (obstacles, 3) [length].
    """
    found = np.where(motions.driven, motions.motions_of(motions.places) - start, 0.0)
    widths = [0.0]
    for number, motion in enumerate(found):
        mine = motions.contacts_of(number)
        slides = np.concatenate([c.sliding[c.active] for c in mine])
        if slides.size and slides.all():
            slips = [slip_by_motions(c, c.active) @ motion for c in mine]
            width = sum(float(c.nodal_lengths[c.active].sum()) for c in mine)
            widths.append(float(np.abs(np.concatenate(slips)).min()) / width)
    return max(widths)
