# SPDX-License-Identifier: MIT
"""Independent checks of problems of thin and folded bodies, and of laws.

Overlap of surfaces of one body is determined from its outline by winding numbers. Laws are checked
node by node with forces from the residual of the bulk, by independent formulas.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from demos.studies.stability.case import Case
from demos.studies.stability.random_bodies import Array, distances
from demos.studies.stability.shape_case import ShapeCase
from demos.studies.stability.user_laws import Rule

# Largest relative error of the pressure between tubes, whose circles have straight facets [1].
OF_TUBES = 0.05
# Largest deviation of bodies without contact from their prescribed positions, over their size [1].
AT_REST = 1e-6
# Largest deviation of nodal forces from the law, over the largest force [1]; slip over the slope's
# length, or the facet, below which it may be zero [1].
OF_LAW, NO_SLIP = 1e-5, 1e-7


def own_overlap(case: Case, x: Array, one: str, other: str) -> float:
    """Depth of two chains of one body in each other [length]."""
    outline = x[case.outline_of(one)]
    deepest = 0.0
    for nodes, partner in ((case.nodes_of(one), other), (case.nodes_of(other), one)):
        away = distances(x[nodes], x[case.nodes_of(partner)])
        inside = windings(_just_outside(case, x, nodes, one), outline) > 0
        deepest = max(deepest, float((away * inside).max()))
    return deepest


def _just_outside(case: Case, x: Array, nodes: Array, boundary: str) -> Array:
    """Positions of nodes of an outline, moved slightly out of the body, shape (nodes, 2)."""
    around = case.outline_of(boundary)
    line = x[around]
    chord = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    out = np.column_stack([chord[:, 1], -chord[:, 0]])  # the outline goes counter-clockwise
    place = {node: k for k, node in enumerate(around.tolist())}
    which = [place[node] for node in nodes.tolist()]
    return x[nodes] + 1e-6 * out[which]


def windings(points: Array, outline: Array) -> Array:
    """Winding numbers of a closed polygon about points, shape (points,)."""
    a = outline[None] - points[:, None]
    b = np.roll(a, -1, axis=1)
    angle = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=2))
    return np.rint(angle.sum(axis=1) / (2.0 * np.pi)).astype(int)


def shape_errors(scene: Any, forces: Array, x: Array, before: Array) -> Iterator[str]:
    """Messages on errors of the final state of a shape's path.

    Args:
        scene: The problem at its final state.
        forces: Forces of the bulk on the nodes, in the order of the input, shape (nodes, 2).
        x: Positions of the nodes at this state [length].
        before: Positions at the previous accepted step.
    """
    case = scene.case
    if case.ends_free:
        yield from _strained(case, x)
    if case.pressure is not None:
        yield from _other_pressure(case, forces, x)
    for (slave, master), rule in zip(case.pairs, case.rules, strict=True):
        if master in case.planes:
            normal = case.planes[master][1]
            yield from _against_law(case, slave, normal, rule, (forces, x, before))
    if len(case.pairs) == 1 and "pad" in case.about["scene"] and not case.planes:
        yield from _too_much_shear(case, forces)


def _strained(case: ShapeCase, x: Array) -> Iterator[str]:
    """Messages on bodies whose positions are not those of a rigid motion."""
    for prescribed in case.prescribed:
        number = case.number_of(prescribed.boundary)
        body = case.bodies[number]
        nodes = slice(*case.first_nodes[number : number + 2])
        away = np.abs(x[nodes] - body.x - prescribed.motion[-1]).max() / np.ptp(body.x)
        if not away < AT_REST:
            yield f"{body.name} is strained at the end, where nothing touches: {away:.1e}"


def _other_pressure(case: ShapeCase, forces: Array, x: Array) -> Iterator[str]:
    """Message if the mean pressure of a closed pair differs from the known one."""
    nodes = case.nodes_of(case.pairs[0][0])[:-1]
    centre = x[nodes].mean(axis=0)
    arms = x[nodes] - centre
    radius = np.linalg.norm(arms, axis=1)
    prescribed = np.concatenate([case.nodes_of(h.boundary) for h in case.prescribed])
    free = ~np.isin(nodes, prescribed)
    inward = np.abs((forces[nodes] * arms).sum(axis=1) / radius)[free].mean()
    pressure = inward / (2.0 * np.pi * radius.mean() / len(nodes))
    error = abs(pressure / case.pressure - 1.0)
    if not error < OF_TUBES:
        yield f"the pressure is {error:.1%} off Lame's {case.pressure:.3g}"


def _against_law(
    case: ShapeCase, slave: str, normal: Array, rule: Rule, state: tuple[Array, Array, Array]
) -> Iterator[str]:
    """Messages on nodal forces on a plane that do not follow from pressure and slip by the law."""
    forces, x, before = state
    nodes = case.nodes_of(slave)
    along = np.array([normal[1], -normal[0]])
    facets = np.linalg.norm(np.diff(x[nodes], axis=0), axis=1)
    share = 0.5 * (np.r_[facets, 0.0] + np.r_[0.0, facets])
    pressure, shear = forces[nodes] @ normal / share, forces[nodes] @ along / share
    slip = (x - before)[nodes] @ along
    size = np.abs(pressure).max()
    if not size > 0.0:
        yield "nothing presses"
        return
    pull = rule.stress if rule.kind == "sticky" else 0.0
    if pressure.min() < -pull - OF_LAW * size:
        yield f"nodes pull by {-pressure.min() / size:.1e} of the largest pressure"
    least, most = shears(rule, slip, np.maximum(pressure, 0.0), NO_SLIP * facets.max())
    off = max((least + shear).max(), (-shear - most).max()) / size
    if not off < OF_LAW:
        yield f"shears are off the law by {off:.1e} of the largest pressure"


def shears(rule: Rule, slip: Array, pressure: Array, nothing: float) -> tuple[Array, Array]:
    """Smallest and largest shear admitted by a law for a slip; ``nothing``: slip treated as zero.

    The shear is positive against a positive slip.
    """
    if rule.kind == "tanh":
        value = rule.mu * pressure * np.tanh(slip / rule.length)
        return value, value
    if rule.kind == "Stribeck":
        fall = np.exp(-((slip / (10.0 * rule.length)) ** 2))
        factor = rule.kinetic + (rule.mu - rule.kinetic) * fall
        value = factor * pressure * np.tanh(slip / rule.length)
        return value, value
    limit = rule.mu * pressure
    if rule.kind == "saturating":
        limit = rule.mu * pressure * rule.stress / (rule.stress + pressure)
    return np.where(slip > nothing, limit, -limit), np.where(slip < -nothing, -limit, limit)


def _too_much_shear(case: ShapeCase, forces: Array) -> Iterator[str]:
    """Message if the total shear of a pad on a block exceeds mu times the total pressure."""
    pad = "pad/bottom"
    along, across = forces[case.nodes_of(pad)].sum(axis=0) @ _frame(case, pad)
    pulled = case.rules[0].stress * _length(case, pad) if case.rules[0].kind == "sticky" else 0.0
    most = case.rules[0].mu * (across + pulled)
    if not abs(along) <= most * (1.0 + 1e-3):  # the base bends: normals turn
        yield f"shear {abs(along):.3g} above {most:.3g}, which friction bears"


def _frame(case: ShapeCase, boundary: str) -> Array:
    """Unit vectors along a straight boundary and into its body, as columns."""
    line = case.x[case.nodes_of(boundary)]
    e = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    n = np.array([-e[1], e[0]])
    body = case.bodies[case.number_of(boundary)]
    return np.column_stack([e, n if (body.x.mean(axis=0) - line[0]) @ n > 0.0 else -n])


def _length(case: ShapeCase, boundary: str) -> float:
    """Length of a straight boundary."""
    line = case.x[case.nodes_of(boundary)]
    return float(np.linalg.norm(line[-1] - line[0]))
