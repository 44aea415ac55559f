# SPDX-License-Identifier: MIT
"""Families of problems of the stability study, and common shapes and supports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from demos.studies.stability.model import (
    Body,
    Grid,
    Pose,
    Scene,
    Support,
    block,
    legs,
    mapped,
)


@dataclass(frozen=True)
class Family:
    """One problem for several values of a parameter.

    Attributes:
        name: Name in the code and in the table.
        title: Name of the parameter in the picture.
        values: The values.
        build: Function that creates the problem for a value.
        methods: Names of the methods to compare, all if empty.
    """

    name: str
    title: str
    values: Sequence[Any]
    build: Callable[[Any], Scene]
    methods: Sequence[str] = ()


FAMILIES: dict[str, Family] = {}


def family(
    title: str, *values: Any, methods: Sequence[str] = ()
) -> Callable[[Callable[[Any], Scene]], Callable[[Any], Scene]]:
    """Register a family under the name of the function that builds its problems."""

    def register(build: Callable[[Any], Scene]) -> Callable[[Any], Scene]:
        FAMILIES[build.__name__] = Family(build.__name__, title, values, build, methods)
        return build

    return register


def scene_of(name: str, value: str) -> Scene:
    """The problem of a family for a value given as text."""
    chosen = FAMILIES[name]
    return chosen.build(next(v for v in chosen.values if str(v) == value))


# Shapes and supports


def down(depth: float, *, steps: int = 1, aside: float = 0.0, turn: float = 0.0) -> Callable:
    """Motion straight to one pose."""
    return legs((steps, (aside, -depth, turn)))


def punch(
    columns: int, rows: int, *, width: float, height: float, radius: float, middle: float = 0.0
) -> np.ndarray:
    """A block whose bottom is a parabola of that radius, its lowest point at (middle, 0)."""

    def position(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = width * (s - 0.5)
        low = x**2 / (2.0 * radius)
        return middle + x, low + (height - low) * t

    return mapped(columns, rows, position)


def turned(x: np.ndarray, angle: float) -> np.ndarray:
    """Positions rotated about the origin, counterclockwise [degree]."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return x @ np.array([[c, s], [-s, c]])


def ground(columns: int, rows: int, *, width: float, height: float, **material: Any) -> Body:
    """A block below y = 0, its middle at x = 0."""
    x = block(columns, rows, width=width, height=height, corner=(-width / 2, -height))
    return Body(Grid("ground", x), **material)


FIXED = Support(["ground/bottom"])


def punch_on_ground(steps: int, depth: float = 0.1, **options: Any) -> Scene:
    """A round punch on a block, both of the same material: Hertz's problem at finite strain."""
    material = {name: options.pop(name) for name in ("E", "nu") if name in options}
    upper = Body(Grid("punch", punch(24, 5, width=1.6, height=0.9, radius=1.0)), **material)
    lower = ground(30, 6, width=2.4, height=0.8, **material)
    return Scene(
        bodies=[lower, upper],
        pairs=[("punch/bottom", "ground/top")],
        supports=[FIXED, Support(["punch/top"], down(depth))],
        steps=steps,
        **options,
    )


def two_blocks(
    upper: np.ndarray, lower: np.ndarray, pose: Callable[[float], Pose], steps: int, **options: Any
) -> Scene:
    """An upper block, the slave, pressed on a lower one."""
    stiff = options.pop("stiff", {})
    bodies = [
        Body(Grid("ground", lower), stiff.get("ground", 1.0), options.get("nu", 0.3)),
        Body(Grid("upper", upper), stiff.get("upper", 1.0), options.pop("nu", 0.3)),
    ]
    return Scene(
        bodies=bodies,
        pairs=[("upper/bottom", "ground/top")],
        supports=[FIXED, Support(["upper/top"], pose)],
        steps=steps,
        **options,
    )


def expect(what: str, found: float, right: float, tolerance: float) -> str:
    """Message on a value off by more than a relative tolerance; "" otherwise."""
    off = abs(found / right - 1.0)
    return "" if off <= tolerance else f"{what} {found:.4g}, right is {right:.4g}"
