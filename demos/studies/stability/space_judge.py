# SPDX-License-Identifier: MIT
"""Checks of a solved state in space by own sums and distances.

Forces are those of the residual that dolfinx assembles, distances are between nodes and triangles,
slip is the motion of nodes past the point that was nearest.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from demos.studies.stability.random_bodies import Array
from demos.studies.stability.space_scene import SpaceScene

# Largest sum of forces that balance over the sum of their norms, by Newton's tolerance [1].
BALANCE = 1e-7
# Forces below this part of the strain are zero, in units of stress and length [1].
NOTHING = 1e-6
# Largest excess of shear over its limit, or of tension, over the largest pressure, likewise [1].
OF_LAW = 1e-7
# Largest moment of the forces of slave and master over the sum of the forces times the longest
# facet, by averaged normals and curvature [1].
MOMENT = 0.1
# Largest depth of a node in another body, and distance over which a force acts, over the longest
# facet, by the mean over facets [1].
PENETRATION, SEPARATION = 0.1, 0.1
# Largest distance of averaged normals from those of the triangles around a node, beyond that of the
# mean of these from them [1].
NORMALS = 0.1
# Smallest part of the friction work of own slips in the product of the norms [1].
AGAINST = 0.8


def judge(scene: SpaceScene, before: Array, now: Array) -> Iterator[str]:
    """Messages on errors of a solved state; positions of the nodes are (n, 3) [unit] (collective).

    Args:
        scene: The problem.
        before: At the accepted state before the last step.
        now: Of the solved state.
    """
    certificate = scene.problem.certificate()
    yield from certificate.violations()
    forces = scene.contact_forces()
    size = sum(float(np.abs(a).sum() + np.abs(b).sum()) for a, b in forces)
    load = float(np.abs(scene.forces(scene.external)).sum())
    least = NOTHING * scene.case.strain
    yield from _balanced(scene, forces, max(size, load, least), certificate.springs)
    for number, pair in enumerate(scene.case.pairs):
        contact = scene.problem.equations.contacts[number]
        on_slave, on_master = forces[number]
        if pair[1] in scene.case.tools:
            yield from _tool(scene, pair[1], on_slave, now, size)
        else:
            yield from _opposite(scene, pair, on_slave, on_master, now, size)
            yield from _normals(scene, pair, contact, now)
        yield from _law(scene, number, contact, size)
        yield from _slip(scene, number, before, now)
    measured = distances(scene, now)
    if not certificate.remarks():
        if not measured["overlap"] < PENETRATION:
            yield f"nodes are {measured['overlap']:.2g} facets deep in another body"
        if not measured["separation"] < SEPARATION:
            yield f"a force acts over a distance of {measured['separation']:.2g} facets"


def _balanced(scene: SpaceScene, forces: Any, size: float, springs: float) -> Iterator[str]:
    """The residual and the contact forces add to zero at all nodes that are not prescribed."""
    total = scene.forces(scene.internal) - scene.forces(scene.external)
    total = total + sum(a + b for a, b in forces)
    worst = np.abs(total[~scene.prescribed]).max(initial=0.0)
    if not worst <= (BALANCE + springs) * size:
        yield f"forces at a node do not balance by {worst / size:.1e}"


def _tool(scene: SpaceScene, name: str, force: Array, now: Array, size: float) -> Iterator[str]:
    """The reaction of a tool is the sum of the forces on the slave, with its moment."""
    frame, tool = scene.case.frame, scene.case.tools[name]
    pivot = tool.motion.about + tool.motion.at(scene.time)[:3]
    moment = np.cross(now - pivot, force).sum(axis=0)
    scale = frame.stress * frame.unit**2
    reaction = scene.tools[name].reaction
    found = reaction[:3] @ frame.turn / scale
    turning = np.linalg.det(frame.turn) * reaction[3:] @ frame.turn / (scale * frame.unit)
    arm = float(np.linalg.norm(now - pivot, axis=1).max())
    if not np.abs(found - force.sum(axis=0)).max() <= BALANCE * size:
        yield f"the reaction of {name} is {found}, the sum of forces {force.sum(axis=0)}"
    if not np.abs(turning - moment).max() <= BALANCE * size * arm:
        yield f"the moment on {name} is {turning}, that of the forces {moment}"


def _opposite(
    scene: SpaceScene, pair: Any, one: Array, other: Array, now: Array, size: float
) -> Iterator[str]:
    """Forces of slave and master are opposite, their moments nearly."""
    total = one.sum(axis=0) + other.sum(axis=0)
    if not np.abs(total).max() <= BALANCE * size:
        yield f"forces of {pair} do not balance by {np.abs(total).max() / size:.1e}"
    moment = np.cross(now, one + other).sum(axis=0)
    facet = max(longest(now, scene.triangles[side]) for side in pair)
    if not np.abs(moment).max() <= MOMENT * size * facet:
        yield f"moments of {pair} do not balance by {np.abs(moment).max() / (size * facet):.1e}"


def _law(scene: SpaceScene, number: int, contact: Any, size: float) -> Iterator[str]:
    """No tension, and no shear above its limit, by the multipliers and the package's normals."""
    z = contact.z_u / scene.case.frame.stress
    n = contact.operators.n
    if not size or not len(z):
        return
    normal = (z * n).sum(axis=1)
    shear = np.linalg.norm(z - normal[:, None] * n, axis=1)
    largest = np.abs(normal).max()
    if not normal.min() >= -OF_LAW * largest:
        yield f"a node of pair {number} pulls with {-normal.min() / largest:.1e}"
    excess = (shear - scene.case.laws[number].limit(normal)).max()
    if not excess <= OF_LAW * max(largest, shear.max()):
        yield f"shear of pair {number} exceeds its limit by {excess / largest:.1e}"


def _normals(scene: SpaceScene, pair: Any, contact: Any, now: Array) -> Iterator[str]:
    """Normals are near to those of the triangles around a node."""
    triangles = scene.triangles[pair[0]]
    x, normal, spread = now[triangles], np.zeros_like(now), np.zeros(len(now))
    area = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    for corner in range(3):
        np.add.at(normal, triangles[:, corner], area)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]
    facing = area / np.linalg.norm(area, axis=1)[:, None]
    for corner in range(3):
        away = np.linalg.norm(facing - normal[triangles[:, corner]], axis=1)
        np.maximum.at(spread, triangles[:, corner], away)
    nodes = slave_nodes(scene, contact, now)
    theirs = contact.operators.n @ scene.case.frame.turn
    off = np.linalg.norm(normal[nodes] - theirs, axis=1) - spread[nodes]
    worst = off[contact.active].max(initial=0.0)
    if not worst < NORMALS:
        yield f"normals of {pair[0]} differ by {worst:.2g} more than the facets"


def slave_nodes(scene: SpaceScene, contact: Any, now: Array) -> Array:
    """Numbers of the slave nodes, by their places."""
    x = scene.case.frame.own(contact.operators.x)
    candidates = np.unique(scene.triangles[scene.case.pairs[_number(scene, contact)][0]])
    away = np.linalg.norm(x[:, None] - now[candidates], axis=2)
    return np.asarray(candidates[away.argmin(axis=1)])


def _number(scene: SpaceScene, contact: Any) -> int:
    return [c is contact for c in scene.problem.equations.contacts].index(True)


def _slip(scene: SpaceScene, number: int, before: Array, now: Array) -> Iterator[str]:
    """Friction acts against the slip, and nodes that slip transfer the limit."""
    contact, pair = scene.problem.equations.contacts[number], scene.case.pairs[number]
    rule, frame = scene.case.laws[number], scene.case.frame
    view = scene.problem.contacts[number]
    sliding = view.active & ~view.sticking
    if not rule.mu or not sliding.any():
        return
    z, n = contact.z_u / frame.stress, contact.operators.n
    pressure = (z * n).sum(axis=1)
    shear = z - pressure[:, None] * n
    limit = rule.limit(pressure)
    off = np.abs(np.linalg.norm(shear, axis=1) - limit)[sliding].max()
    if not off <= OF_LAW * np.abs(z).max():
        yield f"nodes of pair {number} slip below the limit by {off / np.abs(z).max():.1e}"
    nodes = slave_nodes(scene, contact, now)
    way = now[nodes] - before[nodes] - partner_motion(scene, pair[1], nodes, before, now)
    normal = n @ frame.turn
    way -= (way * normal).sum(axis=1)[:, None] * normal
    work, norm = (shear @ frame.turn * way).sum(axis=1), np.linalg.norm(way, axis=1)
    product = np.linalg.norm(shear, axis=1) * norm
    facet = longest(now, scene.triangles[pair[0]])
    far = sliding & (norm > 0.02 * facet)
    if pair[1] not in scene.case.tools:  # beyond the end of the other surface it turns the distance
        _, _, off = nearest(before[nodes], before[scene.triangles[pair[1]]])
        far &= off < SEPARATION * facet
    if far.any() and not work[far].sum() >= AGAINST * product[far].sum():
        part = work[far].sum() / product[far].sum()
        yield f"friction of pair {number} is not against the slip: {part:.2f}"


def partner_motion(
    scene: SpaceScene, master: str, nodes: Array, before: Array, now: Array
) -> Array:
    """Motion (n, 3) of the points of the other surface that were nearest to nodes."""
    x = before[nodes]
    if master in scene.case.tools:
        motion = scene.case.tools[master].motion
        return np.asarray(motion.moved(motion.back(x, scene.last), scene.time) - x)
    triangles = scene.triangles[master]
    which, weights, _ = nearest(x, before[triangles])
    moved = now[triangles[which]] - before[triangles[which]]
    return np.asarray(np.einsum("nk,nkd->nd", weights, moved))


# Distances


def distances(scene: SpaceScene, now: Array) -> dict[str, float]:
    """Largest depth of a node, and largest distance of an active pair, in facets."""
    found = {"overlap": 0.0, "separation": 0.0}
    for number, pair in enumerate(scene.case.pairs):
        nodes = np.unique(scene.triangles[pair[0]])
        facet = longest(now, scene.triangles[pair[0]])
        if pair[1] in scene.case.tools:
            away = scene.case.tools[pair[1]].distance(now[nodes], scene.time)
            deepest = -float(away.min())
        else:
            facet = max(facet, longest(now, scene.triangles[pair[1]]))
            deepest, away = 0.0, np.array([np.inf])
            for one, other in (pair, pair[::-1]):
                x = now[np.unique(scene.triangles[one])]
                surface = now[scene.triangles[other]]
                _, _, off = nearest(x, surface)
                inside = winding(x, now[scene.hulls[other.split("/")[0]]]) > 0.5
                deepest = max(deepest, float(off[inside].max(initial=0.0)))
                away = np.append(away, np.where(inside, -off, off))
        found["overlap"] = max(found["overlap"], deepest / facet)
        if scene.problem.contacts[number].active.any():
            found["separation"] = max(found["separation"], float(away.min()) / facet)
    return found


def longest(x: Array, triangles: Array) -> float:
    """Longest edge of triangles (n, 3) of nodes at x [unit]."""
    corners = x[triangles]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())


def nearest(x: Array, triangles: Array) -> tuple[Array, Array, Array]:
    """Nearest triangle (n,), weights of its corners (n, 3) and distance (n,) of points (n, 3).

    The nearest point of a triangle (m, 3, 3) is that of its plane, if inside, or of an edge.
    """
    a, b, c = (triangles[None, :, i] for i in range(3))
    points = x[:, None]
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = ((p * q).sum(axis=2) for p, q in ((u, u), (u, v), (v, v)))
    wu, wv = (w * u).sum(axis=2), (w * v).sum(axis=2)
    det = uu * vv - uv**2
    s, t = (vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det
    inside = np.stack([1.0 - s - t, s, t], axis=2)
    candidates = [np.where((inside >= 0.0).all(axis=2)[..., None], inside, np.nan)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        p, q = triangles[None, :, i], triangles[None, :, j]
        along = ((points - p) * (q - p)).sum(axis=2) / ((q - p) ** 2).sum(axis=2)
        weights = np.zeros((*along.shape, 3))
        weights[..., j] = np.clip(along, 0.0, 1.0)
        weights[..., i] = 1.0 - weights[..., j]
        candidates.append(weights)
    all_weights = np.stack(candidates)
    at = np.einsum("knmi,mid->knmd", all_weights, triangles)
    off = np.linalg.norm(points[None] - at, axis=3)
    off = np.where(np.isnan(off), np.inf, off)
    best = off.min(axis=0).argmin(axis=1)
    rows = np.arange(len(x))
    kind = off[:, rows, best].argmin(axis=0)
    return best, all_weights[kind, rows, best], off[kind, rows, best]


def winding(x: Array, triangles: Array) -> Array:
    """Number of turns of a closed surface (m, 3, 3) around points (n, 3), by solid angles.

    Van Oosterom & Strackee (1983).
    """
    r = triangles[None] - x[:, None, None]
    d = np.linalg.norm(r, axis=3)
    a, b, c = r[:, :, 0], r[:, :, 1], r[:, :, 2]
    top = (a * np.cross(b, c)).sum(axis=2)
    ab, bc, ca = ((p * q).sum(axis=2) for p, q in ((a, b), (b, c), (c, a)))
    below = d.prod(axis=2) + ab * d[..., 2] + bc * d[..., 0] + ca * d[..., 1]
    return np.asarray(np.arctan2(top, below).sum(axis=1) / (2.0 * np.pi))
