# SPDX-License-Identifier: MIT
"""Places of rigid bodies in the plane and in space: motions between them, and places after these.

A place has the translation of the pivot and the angle, in space the rotation vector, see
``rigid_motion``. A motion q has translations and turns about fixed axes, the angles times a length
``arm``; in space its turns are a rotation vector, too: the place after it has the rotation
exp(turn / arm) R. The vector of this rotation is the one next to that before, so that a body may
turn any number of times.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.obstacles.rotations import (
    inverse_jacobians,
    rotation_by,
    turn_between,
    vector_beside,
)
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point

# Number of coordinates by the number of motions.
DIMENSIONS = {3: 2, 6: 3}


def place_after(place: Array, motion: Array, arm: float) -> Array:
    """The place after a further motion, shape (m,) [length, radian] (local).

    Args:
        place: The place before, shape (m,) [length, radian].
        motion: The motion q, shape (m,) [length].
        arm: Length by which angles are multiplied [length].
    """
    if place.size == 3:
        return place + motion / [1.0, 1.0, arm]
    after = rotation_by(motion[3:] / arm) @ rotation_by(place[3:])
    return np.append(place[:3] + motion[:3], vector_beside(after, place[3:]))


def motion_between(before: Array, after: Array, arm: float) -> Array:
    """The motion q that leads from one place to another, shape (m,) [length] (local).

    In space rotations about one axis have any size, others that of the shortest way.
    """
    if before.size == 3:
        return (after - before) * [1.0, 1.0, arm]
    turn = turn_between(before[3:], after[3:])
    return np.append(after[:3] - before[:3], arm * turn)


def by_further_motion(motion: Array, arm: float) -> Array:
    """Derivative of ``motion_between`` by a further motion after it, shape (m, m) [1] (local)."""
    derivative = np.eye(motion.size)
    if motion.size == 6:
        derivative[3:, 3:] = inverse_jacobians(motion[None, 3:] / arm)[0]
    return derivative


def places_towards(places: Array, others: Array, fraction: float) -> Array:
    """Places of m bodies on the way to other ones, both (m, 3) or (m, 6) (local).

    Args:
        places: The places at the fraction 0 [length, radian].
        others: Those at the fraction 1.
        fraction: Part of the way [1]; extrapolation below 0 and above 1.
    """
    found = [
        place_after(place, fraction * motion_between(place, other, 1.0), 1.0)
        for place, other in zip(places, others, strict=True)
    ]
    return np.reshape(found, places.shape)


def describe_place(where: Array) -> str:
    """Description of a place, shape (m,); "" at the initial position (local)."""
    dim = DIMENSIONS[where.size]
    moved, turn = where[:dim], where[dim:]
    phrases = [f"moved by {format_point(moved)}"] if moved.any() else []
    by = f"{turn[0]:.4g}" if dim == 2 else format_point(turn)
    phrases += [f"turned by {by}"] if turn.any() else []
    return ", " + " and ".join(phrases) if phrases else ""
