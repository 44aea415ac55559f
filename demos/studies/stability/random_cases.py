# SPDX-License-Identifier: MIT
"""Random problems of contact, each from a seed: curves, meshes, materials, loads.

A problem is created in a local frame: bodies are about one wide, lie above each other, and the
softest has Young's modulus one. Then it is bent, rotated, translated, and scaled to random units.
Only numpy is used, so that a seed defines one problem on any number of ranks and in any release.

Only problems with a meaningful solution are kept, see ``objections``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from demos.studies.stability.case import Case, Prescribed
from demos.studies.stability.random_bodies import (
    Array,
    Body,
    Curve,
    corner_areas,
    depths,
    draw_block,
    draw_cells,
    draw_curve,
    put_above,
)

# Largest depth to which rigid bodies would overlap, over the thickness of the thinnest.
DEEPEST = 0.12
# Largest outward rise of a surface under the corner of a narrower body: above it the side of the
# body, which is not a contact surface, would also be in contact.
RISE = 0.05
# Smallest fraction of the narrower surface above the other one at the start, and after the slide.
LEAST_OVERLAP = 0.5, 0.25
# Smallest area at the corner of a cell over the largest in its body.
FLATTEST = 1e-3


def random_case(seed: int) -> Case:
    """Draw problems from a seed until there is no objection to one."""
    rng = np.random.default_rng(seed)
    draw = rng.choice([_two_bodies, _stack, _two_punches], p=[0.8, 0.1, 0.1])
    while True:
        case = _placed(rng, _with_options(rng, draw(rng, seed)))
        if not any(objections(case)):
            return case


def objections(case: Case) -> Iterator[str]:
    """Reasons to reject a problem, as text."""
    for body in case.bodies:
        areas = corner_areas(body.x[body.cells])
        if areas.min() < FLATTEST * areas.max():
            yield f"flat cells in {body.name}"
    yield from case.about["objections"]
    for time in (0, 1, 2):
        for slave, master in case.pairs:
            depth = max(
                rigid_depth(case, slave, master, time), rigid_depth(case, master, slave, time)
            )
            if depth > DEEPEST * min(body.thickness for body in case.bodies):
                yield f"{slave} and {master} overlap by {depth:.2g} at time {time}"


def rigid_depth(case: Case, boundary: str, other: str, time: int) -> float:
    """Depth of a boundary's nodes in the body of another one, all bodies moved as if rigid."""
    x = case.x.copy()
    for prescribed in case.prescribed:
        number = case.number_of(prescribed.boundary)
        x[slice(*case.first_nodes[number : number + 2])] = (
            case.bodies[number].x + prescribed.motion[time]
        )
    return float(depths(x[case.nodes_of(boundary)], x[case.outline_of(other)]).max(initial=0.0))


# Drawing


def _two_bodies(rng: np.random.Generator, seed: int) -> Case:
    """An upper body pushed or pressed onto a lower one, then slid."""
    pressed = rng.random() < 0.25
    sizes, about = _facet_sizes(rng)
    widths = [1.0, rng.choice([1.0, rng.uniform(0.6, 1.7)])]
    offset = 0.0 if widths[1] == 1.0 and rng.random() < 0.5 else rng.uniform(-0.4, 0.4)
    low, high, names = _curves(rng, max(sizes))
    contrast = 10.0 ** rng.uniform(-3.0, 3.0)
    E = np.array([contrast, 1.0]) / min(contrast, 1.0)
    cells = draw_cells(rng)
    lower = draw_block(rng, "lower", cells, sizes[0], (offset, widths[1]), low, None, E[0])
    shear = 0.0 if pressed else rng.uniform(-0.2, 0.2)
    upper = draw_block(rng, "upper", cells, sizes[1], (0.0, 1.0), None, high, E[1], shear)
    gap, gap_name = _gap(rng, min(sizes))
    upper = put_above(upper, lower, gap)
    slide = rng.choice([0.0, 1.0]) * rng.uniform(-3.0, 3.0) * max(sizes)
    objections = list(_corner_objections(upper, lower, slide))
    pairs = [("upper/bottom", "lower/top")]
    still = np.zeros((3, 2))
    prescribed = [Prescribed("lower/bottom", still)]
    traction, boundary, depth = still, "", 0.0
    if pressed:
        boundary = "upper/top"
        along = np.array([[0.0, 0.0], [0.0, 0.0], [slide, 0.0]])
        prescribed += [Prescribed(f"upper/{side}", along, 0) for side in ("left", "right")]
        pressure = 10.0 ** rng.uniform(-2.5, -1.3)
        traction = -pressure * np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    else:
        depth = _depth(rng, [lower, upper])
        prescribed.append(Prescribed("upper/top", _push(depth + gap, slide)))
    about |= {
        "scene": "pressed" if pressed else "pushed",
        "curves": names,
        "gap": gap_name,
        "contrast": float(contrast),
        "depth": float(depth),
        "slide/facet": float(slide / max(sizes)),
        "objections": objections,
    }
    return _case(rng, seed, about, [lower, upper], pairs, prescribed, boundary, traction)


def _stack(rng: np.random.Generator, seed: int) -> Case:
    """Three bodies above each other; the middle one is clamped or guided at its sides."""
    guided = rng.random() < 0.5
    sizes, about = _facet_sizes(rng)
    sizes = [*sizes, sizes[rng.integers(2)]]
    curves = [_curves(rng, max(sizes)) for _ in range(2)]
    E = 10.0 ** rng.uniform(-1.5, 1.5, 3)
    E /= E.min()
    cells = draw_cells(rng)
    width = rng.choice([1.0, rng.uniform(1.0, 1.5)])
    lower = draw_block(rng, "lower", cells, sizes[0], (0.0, width), curves[0][0], None, E[0])
    middle = draw_block(
        rng, "middle", cells, sizes[1], (0.0, width), curves[1][0], curves[0][1], E[1]
    )
    upper = draw_block(rng, "upper", cells, sizes[2], (0.0, 1.0), None, curves[1][1], E[2])
    gaps = [(0.0, "touching")] * 2 if guided else [_gap(rng, min(sizes)) for _ in range(2)]
    middle = put_above(middle, lower, gaps[0][0])
    upper = put_above(upper, middle, gaps[1][0])
    still = np.zeros((3, 2))
    slide = rng.choice([0.0, 1.0]) * rng.uniform(-2.0, 2.0) * max(sizes)
    objections = [*_corner_objections(middle, lower), *_corner_objections(upper, middle, slide)]
    depth = _depth(rng, [lower, middle, upper])
    component = 0 if guided else None
    prescribed = [
        Prescribed("lower/bottom", still),
        Prescribed("upper/top", _push(depth + gaps[1][0], slide)),
    ]
    prescribed += [Prescribed(f"middle/{side}", still, component) for side in ("left", "right")]
    about |= {
        "scene": "guided stack" if guided else "clamped stack",
        "curves": f"{curves[0][2]}, {curves[1][2]}",
        "gap": f"{gaps[0][1]}, {gaps[1][1]}",
        "contrast": float(E.max()),
        "depth": float(depth),
        "slide/facet": float(slide / max(sizes)),
        "objections": objections,
    }
    pairs = [("middle/bottom", "lower/top"), ("upper/bottom", "middle/top")]
    return _case(rng, seed, about, [lower, middle, upper], pairs, prescribed, "", still)


def _two_punches(rng: np.random.Generator, seed: int) -> Case:
    """Two narrow bodies pushed side by side onto one: the master of two pairs."""
    sizes, about = _facet_sizes(rng)
    tool_sizes = [sizes[1] / 2, sizes[rng.integers(2)] / 2]
    low, high, names = _curves(rng, max(sizes))
    other = _curves(rng, max(sizes))[1]
    contrast = 10.0 ** rng.uniform(-3.0, 3.0)
    E = np.array([contrast, 1.0]) / min(contrast, 1.0)
    cells = draw_cells(rng)
    lower = draw_block(rng, "lower", cells, sizes[0], (0.0, 1.4), low, None, E[0])
    gaps = [_gap(rng, min(sizes)) for _ in range(2)]
    still = np.zeros((3, 2))
    bodies, pairs, prescribed = [lower], [], [Prescribed("lower/bottom", still)]
    objections: list[str] = []
    depth = 0.0
    for i, (name, place, curve) in enumerate([("left", -0.4, high), ("right", 0.4, other)]):
        tool = draw_block(rng, name, cells, tool_sizes[i], (place, 0.5), None, curve, E[1])
        tool = put_above(tool, lower, gaps[i][0])
        objections += _corner_objections(tool, lower)
        bodies.append(tool)
        pairs.append((f"{name}/bottom", "lower/top"))
        depth = _depth(rng, [lower, tool])
        slide = rng.uniform(-0.1, 0.1)
        prescribed.append(Prescribed(f"{name}/top", _push(depth + gaps[i][0], slide)))
    about |= {
        "scene": "two tools",
        "curves": names,
        "gap": f"{gaps[0][1]}, {gaps[1][1]}",
        "contrast": float(contrast),
        "depth": float(depth),
        "objections": objections,
    }
    return _case(rng, seed, about, bodies, pairs, prescribed, "", still)


def _case(rng, seed, about, bodies, pairs, prescribed, pressed, traction) -> Case:
    """Assemble a problem; slaves are the upper sides until the roles are drawn."""
    step = float(rng.choice([0.1, 0.2, 0.25, 0.5, 1.0]))
    about |= {"step": step}
    return Case(seed, about, bodies, pairs, prescribed, pressed, traction, step)


def _push(depth: float, slide: float) -> Array:
    """Motion of a tool: down, then along."""
    return np.array([[0.0, 0.0], [0.0, -depth], [slide, -depth]])


def _depth(rng: np.random.Generator, bodies: list[Body]) -> float:
    """Overlap of rigid bodies, from small to nearly too large."""
    thinnest = min(body.thickness for body in bodies)
    return thinnest * DEEPEST * 10.0 ** rng.uniform(-1.3, 0.0)


def _facet_sizes(rng: np.random.Generator) -> tuple[list[float], dict[str, Any]]:
    """Facet lengths of two bodies, lower first, with a ratio from 1 to 10."""
    coarse, ratio = rng.integers(4, 11), rng.choice([1.0, 10.0 ** rng.uniform(0.0, 1.0)])
    sizes = [1.0 / coarse, max(1.0 / (coarse * ratio), 1.0 / 40.0)]
    if rng.random() < 0.5:
        sizes.reverse()
    return sizes, {"facets": f"{1 / sizes[0]:.0f}:{1 / sizes[1]:.0f}"}


def _gap(rng: np.random.Generator, facet: float) -> tuple[float, str]:
    """Distance of two bodies at the start."""
    kind = rng.choice(["touching", "overlap", "open"], p=[0.25, 0.15, 0.6])
    if kind == "touching":
        return 0.0, kind
    if kind == "overlap":
        return -facet * 10.0 ** rng.uniform(-6.0, -2.0), kind
    return 0.1 * rng.random(), kind


def _curves(rng: np.random.Generator, facet: float) -> tuple[Curve, Curve, str]:
    """The lower body's upper curve, the upper body's lower one, and their names."""
    low, name = draw_curve(rng, facet)
    if rng.random() < 0.2:
        return low, low, f"{name} on the same"
    high, other = draw_curve(rng, facet)
    return low, high, f"{other} on {name}"


def _corner_objections(upper: Body, lower: Body, slide: float = 0.0) -> Iterator[str]:
    """Reasons to reject: small overlap, and corners where the other surface rises outward."""
    curves = [upper.x[upper.sides["bottom"]], lower.x[lower.sides["top"]]]
    spans = [np.array([curve[0, 0], curve[-1, 0]]) for curve in curves]
    for shift, least in zip((0.0, slide), LEAST_OVERLAP):
        (left, right), (start, end) = spans[0] + shift, spans[1]
        if min(right, end) - max(left, start) < least * min(right - left, end - start):
            yield "little overlap"
    for curve, span, sign in ((curves[1], spans[0], 1.0), (curves[0], spans[1], -1.0)):
        for end, outward in zip(span, (-1.0, 1.0)):
            x = end + outward * np.linspace(-0.1, 0.1, 9)
            x = x[(x >= curve[0, 0]) & (x <= curve[-1, 0])]
            if x.size > 1:
                rise = sign * outward * np.diff(np.interp(x, *curve.T)) / np.diff(x)
                if rise.max() > RISE:
                    yield "a corner is touched from its side"


def _with_options(rng: np.random.Generator, case: Case) -> Case:
    """Draw roles and, in a quarter of the cases, options other than the defaults."""
    if rng.random() < 0.5 and case.can_be_swapped:
        case = case.swapped()
    case.about["slave"] = case.pairs[0][0]
    if rng.random() < 0.75:
        return case
    pair = {
        "basis": str(rng.choice(["dual", "standard"])),
        "normals": str(rng.choice(["opposite", "unit", "own"])),
        "points": int(rng.integers(3, 8)),
    }
    problem = {
        "algorithm": "saddle"
        if pair["basis"] == "standard"
        else str(rng.choice(["saddle", "condensed"]))
    }
    case.about["options"] = pair | problem
    return replace(case, pair_options=pair, problem_options=problem)


def _placed(rng: np.random.Generator, case: Case) -> Case:
    """Bend, rotate, translate and scale a problem; guides need directions along the axes."""
    guided = any(prescribed.component is not None for prescribed in case.prescribed)
    radius = np.inf
    if not guided and rng.random() < 0.25:
        radius = rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 6.0)
    quarter = int(rng.integers(4))
    angle = quarter * np.pi / 2 if guided else rng.uniform(-np.pi, np.pi)
    length, stress = 10.0 ** rng.uniform(-6.0, 6.0, 2)
    offset = rng.uniform(-3.0, 3.0, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    if guided:
        turn = np.round(turn)
    bodies = [
        replace(
            body,
            x=length * (_bent(body.x, radius) @ turn.T + offset),
            E=stress * body.E,
            thickness=length * body.thickness,
        )
        for body in case.bodies
    ]
    prescribed = [
        replace(
            h,
            motion=length * h.motion @ turn.T,
            component=None if h.component is None else int(np.abs(turn[:, h.component]).argmax()),
        )
        for h in case.prescribed
    ]
    about = case.about | {
        "bend": float(1.0 / radius),
        "angle": float(angle),
        "length": float(length),
        "stress": float(stress),
        "cells": f"{'triangles' if case.bodies[0].cells.shape[1] == 3 else 'quads'}",
        "dofs": 2 * len(case.x),
    }
    traction = stress * case.traction @ turn.T
    return replace(case, bodies=bodies, prescribed=prescribed, traction=traction, about=about)


def _bent(x: Array, radius: float) -> Array:
    """Bend the x axis to an arc."""
    if not np.isfinite(radius):
        return x
    r, angle = radius + x[:, 1], x[:, 0] / radius
    return np.stack([r * np.sin(angle), r * np.cos(angle) - radius], axis=1)
