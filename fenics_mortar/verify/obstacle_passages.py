# SPDX-License-Identifier: MIT
"""Passages of nodes through rigid obstacles in a step.

The signed distance of an obstacle is sampled along a path in the frame of the obstacle, with steps
equal to the distance (sphere tracing, Hart 1996), and steps of a small fraction of a facet near the
surface. A path passes through the obstacle if the gradients at entry and exit are opposed, the path
between them is deep inside, not along the surface as that of a node on a round obstacle that turns,
and the obstacle extends by half a facet to both sides; otherwise the path goes round an edge. So
some path passes through each round obstacle whose radius is a facet or more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.kernels.passage import OPPOSED
from fenics_mortar.obstacles.obstacle import Obstacle, is_of_package
from fenics_mortar.utils.arrays import HALF_FACET, TINY, Array, Flags, Indices, first_largest, norms
from fenics_mortar.utils.errors import call_together, format_point
from fenics_mortar.verify.finding import LIMITS

if TYPE_CHECKING:
    from fenics_mortar.contact.interface import Interface

ADVICE = "since the last accepted state: take smaller steps"


def passed_through(obstacle: Obstacle, knots: Array, offset: Array, lengths: Array) -> Array:
    """Distance from the surface of nodes that passed through an obstacle, else 0 (local).

    Args:
        obstacle: The obstacle; its present position is not used.
        knots: Positions of s nodes in the frame of the obstacle at start, intermediate times and
            end, shape (m + 1, s, d) [length].
        offset: Length subtracted from the distance of each node, shape (s,) [length].
        lengths: Tributary length of each node, shape (s,) [length].

    Returns:
        Shape (s,) [length].
    """
    sections = np.linalg.norm(np.diff(knots, axis=0), axis=2)
    far = np.concatenate([np.zeros((1, len(offset))), np.cumsum(sections, axis=0)])
    (start, start_slope), (end, end_slope) = (
        _distance(obstacle, knots[k], offset) for k in (0, -1)
    )
    is_hit = np.maximum(start, 0.0) + np.maximum(end, 0.0) <= far[-1]
    turned = (start_slope * end_slope).sum(axis=1) < np.cos(LIMITS.section_turn)
    is_long = far[-1] > HALF_FACET * lengths  # it may return to the side where it began
    which = np.flatnonzero(is_hit & (turned | is_long) & (far[-1] > 0.0))
    through = np.zeros(len(offset))
    if which.size:
        passed = _trace(obstacle, knots[:, which], far[:, which], offset[which], lengths[which])
        through[which] = np.where(passed, np.maximum(end[which], TINY), 0.0)
    return through


def nodes_through(
    comm: MPI.Comm, obstacle: Obstacle, paths: tuple[Array, Array, Array], x1: Array,
    name: Callable[[int], str],
) -> list[str]:  # fmt: skip
    """Message on nodes that went through an obstacle, if there are any (collective).

    Args:
        comm: Communicator.
        obstacle: The obstacle.
        paths: Knots, offset and lengths, see ``passed_through``.
        x1: Positions of the s nodes at the end, shape (s, d) [length].
        name: Function that returns the name of the surface of one of them.
    """
    what = f"the distance of '{obstacle.name}'"
    depth = call_together(comm, what, partial(passed_through, obstacle, *paths))
    count, first = int((depth > 0.0).sum()), first_largest(depth) if len(depth) else 0
    if not count:
        return []
    return [
        f"{count} nodes of {name(first)} went through obstacle '{obstacle.name}', and one at "
        f"{format_point(x1[first])} ended {depth[first]:.3g} beyond its surface, {ADVICE}"
    ]


def _distance(obstacle: Obstacle, x: Array, offset: Array) -> tuple[Array, Array]:
    """Distances (s,) minus offset, lower bounds if |grad phi| > 1, and unit gradients (s, d)."""
    phi, gradient, _ = obstacle.local(x)
    size = np.maximum(norms(gradient), TINY)
    return (phi - offset) / np.maximum(size, 1.0), gradient / size[:, None]


def _trace(obstacle: Obstacle, knots: Array, far: Array, offset: Array, lengths: Array) -> Flags:
    """Whether paths passed through; ``knots`` (m + 1, s, d) at arc lengths ``far`` (m + 1, s)."""
    total = far[-1]
    # near the surface points are as close as the smallest distance with a remark
    min_step = np.maximum(LIMITS.coarse_distance * lengths, total / LIMITS.max_points)
    at, passed = np.zeros(len(total)), np.zeros(len(total), bool)
    before = _at(knots, far, at)
    distance, slope = _distance(obstacle, before, offset)
    entry, entry_slope, inside = before.copy(), slope.copy(), distance < 0.0
    deepest, crosses = np.maximum(-distance, 0.0), np.zeros(len(total), bool)
    for _ in range(2 * LIMITS.max_points):
        if (at >= total).all():
            break
        at = np.minimum(at + np.maximum(np.abs(distance), min_step), total)
        here = _at(knots, far, at)
        distance, now = _distance(obstacle, here, offset)
        enters, leaves = ~inside & (distance < 0.0), inside & (distance >= 0.0)
        entry = np.where(enters[:, None], before, entry)
        entry_slope = np.where(enters[:, None], slope, entry_slope)
        deepest = np.maximum(np.where(enters, 0.0, deepest), -distance)
        crosses = (crosses & ~enters) | ((slope * now).sum(axis=1) < OPPOSED)
        step = here - before
        skips = ~inside & (distance >= 0.0)  # thinner than the spacing of the points
        skips &= ((step * slope).sum(axis=1) < 0.0) & ((step * now).sum(axis=1) > 0.0)
        first = np.where(leaves[:, None], entry_slope, slope)
        middle = np.where(leaves[:, None], 0.5 * (entry + here), 0.5 * (before + here))
        opposed = (leaves | skips) & ((first * now).sum(axis=1) < OPPOSED)
        least = np.minimum(HALF_FACET * lengths, LIMITS.deep * norms(here - entry))
        opposed &= skips | crosses | (deepest > least)
        if opposed.any():
            opposed[opposed] = _goes_on(
                obstacle, middle[opposed], first[opposed], lengths[opposed],
                offset[opposed] + 2.0 * min_step[opposed],
            )  # fmt: skip
        passed |= opposed
        before, slope, inside = here, now, distance < 0.0
    return passed


def _goes_on(obstacle: Obstacle, x: Array, normal: Array, lengths: Array, offset: Array) -> Flags:
    """Whether the obstacle extends by half a facet to both sides of points on their paths."""
    reach, sides = HALF_FACET * lengths[:, None], list[Array]()
    for along in directions_across(normal):
        sides += [_distance(obstacle, x + sign * reach * along, offset)[0] for sign in (1.0, -1.0)]
    return np.asarray((np.array(sides) <= 0.0).all(axis=0))


def directions_across(normal: Array) -> list[Array]:
    """Unit vectors across unit normals (s, d), one in the plane, two in space, (s, d) each [1]."""
    if normal.shape[1] == 2:
        return [np.stack([-normal[:, 1], normal[:, 0]], axis=1)]
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    first /= norms(first)[:, None]
    return [first, np.cross(normal, first)]


def _at(knots: Array, far: Array, at: Array) -> Array:
    """Points at arc lengths ``at`` (s,) of paths with ``knots`` (m + 1, s, d) at ``far``."""
    k = np.clip((far <= at).sum(axis=0) - 1, 0, len(far) - 2)
    every = np.arange(len(at))
    start, end = far[k, every], far[k + 1, every]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.nan_to_num((at - start) / (end - start), posinf=0.0, neginf=0.0)
    return knots[k, every] + fraction[:, None] * (knots[k + 1, every] - knots[k, every])


def nodes_off_pairs(obstacle: Obstacle, outline: Any, slaves: Indices) -> Flags:
    """Nodes that no pair keeps out of an obstacle, of bodies that are clear of it (collective).

    Other bodies overlap it in the mesh, beside a slave or without one, as where a plane goes on
    beyond the wall that it stands for.

    Args:
        obstacle: The obstacle.
        outline: Outlines or hulls of all bodies.
        slaves: Numbers of the slave nodes of its pairs, shape (k,).

    Returns:
        Shape (n,), bool.
    """
    off, beside = np.ones((2, len(outline.X)), bool)
    off[slaves] = False
    if not is_of_package(obstacle):  # a user's function need be a distance beside pairs only
        off &= np.isin(outline.bodies, outline.bodies[slaves])
        beside &= off
    beside[outline.segments[~off[outline.segments].all(axis=1)]] = False
    at = np.flatnonzero(beside)
    evaluate = partial(obstacle.evaluate, outline.X[at])
    phi = call_together(outline.comm, f"the distance of '{obstacle.name}'", evaluate)[0]
    inside = phi < -LIMITS.unpaired * outline.node_sizes(outline.X)[at]
    return np.asarray(off & ~np.isin(outline.bodies, outline.bodies[at[inside]]))


def pairs_of_obstacles(
    contacts: Sequence[Interface], slaves: Sequence[Indices]
) -> dict[Obstacle, list[tuple[Contact, Indices]]]:
    """The pairs with each obstacle, and the numbers of their slave nodes in the outlines (local).

    Args:
        contacts: All pairs.
        slaves: Numbers of the slave nodes of each pair.
    """
    pairs = dict[Obstacle, list[tuple[Contact, Indices]]]()
    for contact, there in zip(contacts, slaves, strict=True):
        if isinstance(contact, Contact) and contact.obstacle is not None:
            pairs.setdefault(contact.obstacle, []).append((contact, there))
    return pairs
