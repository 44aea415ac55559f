# SPDX-License-Identifier: MIT
"""The scenes: families of one problem each, swept over what makes it hard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from demos.studies.stability.model import (
    Body,
    Grid,
    Pose,
    Posed,
    Scene,
    Support,
    Tool,
    block,
    fm,
    legs,
    mapped,
    sector,
)


@dataclass(frozen=True)
class Family:
    """One problem for several values of what makes it hard.

    Attributes:
        name: Name in the code and in the table.
        title: What is swept, as the picture says it.
        values: The values.
        build: Makes the scene for a value.
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
    """Register a family under the name of the function that builds its scenes."""

    def register(build: Callable[[Any], Scene]) -> Callable[[Any], Scene]:
        FAMILIES[build.__name__] = Family(build.__name__, title, values, build, methods)
        return build

    return register


def scene_of(name: str, value: str) -> Scene:
    """The scene of a family for a value in words."""
    chosen = FAMILIES[name]
    return chosen.build(next(v for v in chosen.values if str(v) == value))


# Shapes and supports


def down(depth: float, *, steps: int = 1, aside: float = 0.0, turn: float = 0.0) -> Callable:
    """Straight to one pose."""
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
    """Positions turned about the origin, counterclockwise [degree]."""
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
    """Say what is off by more than a relative tolerance."""
    off = abs(found / right - 1.0)
    return "" if off <= tolerance else f"{what} {found:.4g}, right is {right:.4g}"


# Size of steps


@family("punch pushed in: step / facet", 0.1, 0.5, 1, 2.5, 5)
def step_size(ratio: float) -> Scene:
    """Half a facet to five facets at once, a quarter of the punch's radius in all."""
    return punch_on_ground(steps=round(5 / ratio), depth=0.25)


@family("ironing: slide per step / facet", 0.1, 0.5, 1, 3, 10)
def ironing(facets: float) -> Scene:
    """A round tool, ten times stiffer, pressed into a block and drawn along it."""
    count = {0.1: 20, 0.5: 16, 1: 15, 3: 6, 10: 2}[facets]
    tool = punch(12, 4, width=0.8, height=0.5, radius=0.5, middle=-1.0)
    slide = facets * count * 0.1
    return Scene(
        bodies=[
            ground(40, 6, width=4.0, height=0.8),
            Body(Grid("tool", tool), E=10.0),
        ],
        pairs=[("ground/top", "tool/bottom")],
        supports=[
            FIXED,
            Support(["tool/top"], legs((3, (0.0, -0.15, 0.0)), (count, (slide, -0.15, 0.0)))),
        ],
        steps=3 + count,
    )


@family("ironing with friction: mu", 0.1, 0.3, 0.6, 1, 2)
def rubbing(mu: float) -> Scene:
    """The same with friction, a facet per step."""
    return replace(ironing(1), pair={"law": fm.Coulomb(mu)})


@family("ironing, mu = 0.3: slide per step / facet", 0.1, 0.5, 1, 3, 10)
def rubbing_fast(facets: float) -> Scene:
    """The same with friction: nodes slide far in one step, and enter while they do."""
    return replace(ironing(facets), pair={"law": fm.Coulomb(0.3)})


@family("block drawn to and fro, mu = 0.3: steps per stroke", 1, 2, 5, 20)
def reversal(steps: int) -> Scene:
    """A block on a block; in each stroke all nodes go from sliding by sticking to sliding."""
    there, back, low = (0.1, -0.04, 0.0), (-0.1, -0.04, 0.0), (0.0, -0.04, 0.0)
    upper = block(8, 6, width=0.8, height=0.5, corner=(-0.4, 0.0))
    lower = block(18, 6, width=1.6, height=0.5, corner=(-0.8, -0.5))
    path = legs((steps, low), (steps, there), (2 * steps, back), (2 * steps, there), (steps, low))
    return two_blocks(upper, lower, path, 7 * steps, pair={"law": fm.Coulomb(0.3)})


@family("pressed on a slope of 27 degrees: mu", 0, 0.2, 0.4, 0.5, 0.6, 1, 2)
def slope(mu: float) -> Scene:
    """A block whose bottom rises by one half, pressed straight down; it sticks above mu = 0.5."""

    def above(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = 0.8 * (s - 0.5)
        return x, 0.5 * x + (0.6 - 0.5 * x) * t

    def below(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = 1.6 * (s - 0.5)
        return x, -0.8 + (0.8 + 0.5 * x) * t

    upper, lower = mapped(8, 6, above), mapped(18, 6, below)
    return two_blocks(upper, lower, down(0.06, steps=3), 3, pair={"law": fm.Coulomb(mu)})


@family("roll by 30 degrees: degrees per step", 1, 5, 10, 30)
def roll(degrees: float) -> Scene:
    """Half a wheel pressed on a block and rolled along it."""
    count, angle = round(30 / degrees), np.radians(30)
    wheel = sector(40, 4, radii=(0.4, 1.0), angles=(1.1 * np.pi, 1.9 * np.pi), centre=(0.0, 1.0))
    return Scene(
        bodies=[ground(36, 6, width=3.0, height=0.8), Body(Grid("wheel", wheel))],
        pairs=[("wheel/bottom", "ground/top")],
        supports=[
            FIXED,
            Support(
                ["wheel/left", "wheel/right", "wheel/top"],
                legs((1, (0.0, -0.06, 0.0)), (count, (angle, -0.06, -angle))),
                centre=(0.0, 1.0),
            ),
        ],
        steps=1 + count,
    )


@family("pressed blocks turned by 90 degrees: degrees per step", 5, 15, 30, 45)
def turn_all(degrees: float) -> Scene:
    """Two blocks pressed together, then both ends turned about one centre: the force turns too."""
    count = round(90 / degrees)
    centre = (0.0, -0.8)

    def pose(time: float) -> Pose:
        *_, angle = around(time)
        push = -0.05 * min(1.0, time * (count + 1))
        return -np.sin(angle) * push, np.cos(angle) * push, angle

    around = legs((1, (0.0, 0.0, 0.0)), (count, (0.0, 0.0, np.pi / 2)))
    scene = two_blocks(
        block(8, 6, width=1.0, height=0.8, corner=(-0.5, 0.0)),
        block(14, 6, width=1.6, height=0.8, corner=(-0.8, -0.8)),
        pose,
        count + 1,
        check=lambda posed: (
            "" if abs(posed.forces[0, 1]) < 1e-6 * abs(posed.forces[0, 0]) else "force not turned"
        ),
    )
    supports = [
        Support(["ground/bottom"], around, centre=centre),
        Support(["upper/top"], pose, centre=centre),
    ]
    return replace(scene, supports=supports)


@family("block bounces along a plank, 40 steps", "linear", "neo-Hookean")
def bouncing(material: str) -> Scene:
    """After MOOSE's test of this name, whose iterations are published: five bounces of a block."""

    def pose(time: float) -> Pose:
        return 2.0 * time, 0.2 * np.cos(10.0 * np.pi * time) - 0.2, 0.0

    return two_blocks(
        block(5, 5, width=0.6, height=0.6, corner=(-1.3, 0.21)),
        block(24, 5, width=3.0, height=0.8, corner=(-1.5, -0.8)),
        pose,
        40,
        linear=material == "linear",
    )


# Contrast of stiffness and mesh


@family("stiffness of slave / master", 1e-6, 1e-3, 1, 1e3, 1e6)
def stiffness(ratio: float) -> Scene:
    """Two blocks pressed unevenly."""
    return two_blocks(
        block(8, 6, width=1.0, height=0.8, corner=(-0.5, 0.0)),
        block(14, 6, width=1.6, height=0.8, corner=(-0.8, -0.8)),
        down(0.06, turn=0.03),
        4,
        stiff={"upper": ratio},
    )


@family("facets of slave : master", "2:60", "3:30", "9:10", "30:3", "60:2")
def mesh_ratio(ratio: str) -> Scene:
    """The same with few facets on many."""
    slave, master = map(int, ratio.split(":"))
    return two_blocks(
        block(slave, 5, width=1.0, height=0.8, corner=(-0.5, 0.0)),
        block(master, 5, width=1.2, height=0.8, corner=(-0.6, -0.8)),
        down(0.06, turn=0.03),
        4,
    )


@family("nodes on nodes, shifted by", 0.0, 1e-16, 1e-14, 1e-12, 1e-9, 1e-6)
def node_on_node(shift: float) -> Scene:
    """Matching meshes: the last node of the slave leaves the edge of the master by a hair."""
    return two_blocks(
        block(8, 4, width=1.0, height=0.6, corner=(-0.5 + shift, 0.0)),
        block(8, 4, width=1.0, height=0.6, corner=(-0.5, -0.6)),
        down(0.06),
        3,
        nu=0.0,
        # plane strain without lateral strain: one bar of height 1.2, compressed by 0.06
        check=lambda posed: expect("force", posed.forces[0, 1], bar_force(0.06 / 1.2), 1e-4),
    )


def bar_force(shortening: float, E: float = 1.0) -> float:
    """Force of a bar of width 1, nu = 0, neo-Hookean: P = mu (F - 1 / F), mu = E / 2."""
    F = 1.0 - shortening
    return 0.5 * E * (1.0 / F - F)


# Edges and partial cover


@family("cover of the last slave facet", 1, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
def edge_cover(cover: float) -> Scene:
    """The slave hangs over the edge of the master."""
    end = 0.75 + 0.25 * cover
    return two_blocks(
        block(4, 4, width=1.0, height=0.8),
        block(10, 5, width=end + 0.3, height=0.8, corner=(-0.3, -0.8)),
        down(0.05),
        2,
    )


@family("slide over a table's edge: facets per step", 0.25, 1, 2)
def slide_off(facets: float) -> Scene:
    """A block drawn over an edge until half of it hangs."""
    count = round(4 / facets)
    return two_blocks(
        block(8, 5, width=1.0, height=0.6),
        block(11, 5, width=1.5, height=0.8, corner=(-0.3, -0.8)),
        legs((1, (0.0, -0.03, 0.0)), (count, (0.7, -0.03, 0.0))),
        1 + count,
    )


@family("island on one slave facet: width / facet", 0.5, 0.1, 1e-2, 1e-3, 1e-4)
def island(ratio: float) -> Scene:
    """The master, a slender bar, stands in the middle of one facet of the slave."""
    width = 0.4 * ratio
    bar = block(2, 4, width=width, height=0.4, corner=(-width / 2, 0.0))
    return Scene(
        bodies=[ground(5, 4, width=2.0, height=0.8), Body(Grid("bar", bar))],
        pairs=[("ground/top", "bar/bottom")],
        supports=[FIXED, Support(["bar/top"], down(0.02))],
        steps=2,
    )


# Corners


def square(name: str, angle: float, place: tuple[float, float], upwards: bool) -> Body:
    """A square that stands on a corner, or hangs below it; that corner is at ``place``."""
    x = turned(block(6, 6, width=0.8, height=0.8), angle)
    x = np.array(place) + (-x if upwards else x)
    joined = {side: f"{name}/tip" for side in ("bottom", "left")}
    joined |= {side: f"{name}/back" for side in ("top", "right")}
    return Body(Grid(name, x, joined=joined))


@family("corner on flat: angle, who is slave", *(
    f"{a} {who}" for a in (45, 30, 10, 3) for who in ("corner", "flat")
))  # fmt: skip
def corner_on_flat(value: str) -> Scene:
    """A square pressed on a block with one corner first."""
    angle, who = value.split()
    sides = ("tip/tip", "ground/top") if who == "corner" else ("ground/top", "tip/tip")
    return Scene(
        bodies=[
            ground(20, 6, width=2.0, height=0.8),
            square("tip", float(angle), (0.03, 0.0), upwards=False),
        ],
        pairs=[sides],
        supports=[FIXED, Support(["tip/back"], down(0.12))],
        steps=4,
    )


@family("corner close above a flat: gap / facet", 0.1, 1e-2, 1e-3)
def near_miss(ratio: float) -> Scene:
    """It comes down by half of the gap: there must be no force, whatever lies beside the edge."""
    gap = 0.1 * ratio
    return Scene(
        bodies=[
            ground(20, 6, width=2.0, height=0.8),
            square("tip", 10.0, (0.03, gap), upwards=False),
        ],
        pairs=[("ground/top", "tip/tip")],
        supports=[FIXED, Support(["tip/back"], down(gap / 2))],
        steps=1,
        check=lambda posed: "" if not posed.forces.any() else "force without touch",
    )


@family("corner on corner: offset / facet", 0.0, 0.01, 0.1, 0.5, 1.5)
def corner_on_corner(offset: float) -> Scene:
    """Two squares, tip to tip, a little beside each other."""
    return Scene(
        bodies=[
            square("lower", 45, (0.0, 0.0), upwards=True),
            square("upper", 45, (offset * 0.8 / 6, 0.0), upwards=False),
        ],
        pairs=[("upper/tip", "lower/tip")],
        supports=[Support(["lower/back"]), Support(["upper/back"], down(0.15))],
        steps=5,
    )


@family("wedge in a groove: kink of the slave in degrees", 10, 30, 60, 90)
def kinked_slave(angle: float) -> Scene:
    """A block with a bottom like a roof upside down in the groove that fits it."""
    slope = np.tan(np.radians(angle / 2))

    def wedge(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low = slope * np.abs(s - 0.5)
        return s - 0.5, low + (1.2 - low) * t

    def groove(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = 1.5 * (s - 0.5)
        return x, -0.8 + (0.8 + slope * np.abs(x)) * t

    return two_blocks(mapped(8, 6, wedge), mapped(14, 6, groove), down(0.06), 3)


# Curved and thin bodies


@family("parabola between two slave nodes: facet / radius", 0.2, 0.5, 1)
def between_nodes(ratio: float) -> Scene:
    """A fine round master touches a coarse flat slave between its nodes."""
    facet = 0.25
    tool = punch(24, 4, width=0.25, height=0.3, radius=facet / ratio, middle=0.11)
    return Scene(
        bodies=[ground(8, 4, width=2.0, height=0.8), Body(Grid("tool", tool), E=10.0)],
        pairs=[("ground/top", "tool/bottom")],
        supports=[FIXED, Support(["tool/top"], down(0.05))],
        steps=2,
    )


@family("ring between plates: thickness / radius", 0.2, 0.1, 0.05)
def thin_ring(thickness: float) -> Scene:
    """Nothing but contact supports the ring; the rays of the plates meet it twice."""
    ring = sector(48, 2, radii=(1.0 - thickness, 1.0), centre=(0.0, 1.0))
    plates = [
        Body(Grid(name, block(24, 2, width=2.4, height=0.2, corner=(-1.2, y))), E=10.0)
        for name, y in (("ground", -0.2), ("plate", 2.0))
    ]
    return Scene(
        bodies=[*plates, Body(Grid("ring", ring, closed=True))],
        pairs=[("ground/top", "ring/bottom"), ("plate/bottom", "ring/bottom")],
        supports=[FIXED, Support(["plate/top"], down(0.5))],
        steps=10,
        check=lambda posed: expect("force above", posed.forces[1, 1], -posed.forces[0, 1], 1e-6),
    )


@family("thin sheet, both faces the master: thickness / facet", 2, 1, 0.5)
def thin_sheet(ratio: float) -> Scene:
    """The wrong face of the sheet is in reach of the punch."""
    thickness = 0.05 * ratio
    sheet = block(40, 2, width=2.0, height=thickness, corner=(-1.0, -thickness))
    faces = dict.fromkeys(("bottom", "top"), "sheet/faces")
    ends = dict.fromkeys(("left", "right"), "sheet/ends")
    tool = punch(24, 4, width=0.8, height=0.5, radius=0.5)
    return Scene(
        bodies=[Body(Grid("sheet", sheet, joined=faces | ends)), Body(Grid("tool", tool))],
        pairs=[("tool/bottom", "sheet/faces")],
        supports=[Support(["sheet/ends"]), Support(["tool/top"], down(0.25))],
        steps=5,
    )


@family("sheet hit in one step: step / thickness", 1, 5, 20)
def tunnelling(ratio: float) -> Scene:
    """The punch would be behind the sheet at once: it starts above and ends below."""
    thickness = 0.2 / ratio
    sheet = block(40, 2, width=2.0, height=thickness, corner=(-1.0, -thickness - 0.05))
    ends = dict.fromkeys(("left", "right"), "sheet/ends")
    tool = punch(24, 4, width=0.8, height=0.5, radius=0.5)
    return Scene(
        bodies=[Body(Grid("sheet", sheet, joined=ends)), Body(Grid("tool", tool))],
        pairs=[("tool/bottom", "sheet/top")],
        supports=[Support(["sheet/ends"]), Support(["tool/top"], down(0.25))],
        steps=1,
    )


@family("one cantilever pushed past another: overlap / length", 0.05, 0.2)
def cantilevers(overlap: float) -> Scene:
    """The tips bend, slip off each other and spring back: the way goes through a jump."""
    left = block(24, 3, width=1.0, height=0.1, corner=(-1.0, -0.1))
    right = block(20, 3, width=1.0, height=0.1, corner=(-overlap, 0.0))
    return Scene(
        bodies=[Body(Grid("left", left)), Body(Grid("right", right))],
        pairs=[("left/top", "right/bottom")],
        supports=[Support(["left/left"]), Support(["right/right"], down(1.0))],
        steps=20,
        check=lambda posed: "" if not posed.forces.any() else "force after they have parted",
    )


@family("block pushed into a narrower channel: facets per step", 0.5, 2, 5)
def channel(facets: float) -> Scene:
    """Two walls bend the block in: 4 % interference, each side a pair of its own."""
    count = round(20 / facets)
    mouth = mapped(
        30, 4, lambda s, t: (3.0 * s, 0.5 - 0.02 * np.clip((3.0 * s - 0.9) / 0.6, 0, 1) + 0.5 * t)
    )
    walls = {"upper": mouth, "lower": mouth[:, ::-1] * np.array([1.0, -1.0])}
    pushed = block(12, 12, width=0.8, height=1.0, corner=(0.05, -0.5))
    return Scene(
        bodies=[
            Body(Grid("pushed", pushed)),
            *(Body(Grid(name, x), E=10.0) for name, x in walls.items()),
        ],
        pairs=[("pushed/top", "upper/bottom"), ("pushed/bottom", "lower/top")],
        supports=[
            Support(["upper/top"]),
            Support(["lower/bottom"]),
            Support(["pushed/left"], legs((count, (20 * 0.8 / 12, 0.0, 0.0))), component=0),
        ],
        steps=count,
    )


def rings(facets: str) -> list[Body]:
    """Two rings of so many facets, inner : outer."""
    inner, outer = map(int, facets.split(":"))
    return [
        Body(Grid("inner", sector(inner, 3, radii=(1.0, 2.0)), closed=True)),
        Body(Grid("outer", sector(outer, 3, radii=(2.0, 3.0)), closed=True)),
    ]


@family("press fit of polygons: facets inner : outer", "12:16", "24:32", "48:64")
def press_fit(facets: str) -> Scene:
    """An interference of 1 % of the radius; the inner ring is free to turn."""
    a, b, c, nu, interference = 1.0, 2.0, 3.0, 0.3, 0.02
    # Lame for small strain, E = 1: radial displacement over pressure of the inner ring, free
    # inside, and of the outer one, fixed outside
    inner = b * (1 + nu) * ((1 - 2 * nu) * b**2 + a**2) / (b**2 - a**2)
    outer = (1 + nu) * (c**2 / b - b) / (1 / (1 - 2 * nu) + c**2 / b**2)
    right = interference / (inner + outer)

    def check(posed: Posed) -> str:
        contact = posed.problem.equations.contacts[0]
        weights = contact.operators.diagonal
        mean = float(weights @ contact.pressure / weights.sum())
        return expect("mean pressure", mean, right, 0.02 + (4 / int(facets.split(":")[0])) ** 2)

    return Scene(
        bodies=rings(facets),
        pairs=[("inner/bottom", "outer/top")],
        supports=[Support(["outer/bottom"])],
        steps=1,
        pair={"initial_gap": -interference},
        check=check,
    )


@family("polygon turned in a polygon by 30 degrees: facets", "12:16", "24:32", "48:64")
def turned_polygon(facets: str) -> Scene:
    """Concentric rings without play: corners have to pass each other."""
    return Scene(
        bodies=rings(facets),
        pairs=[("inner/bottom", "outer/top")],
        supports=[
            Support(["outer/bottom"]),
            Support(["inner/top"], legs((6, (0.0, 0.0, np.pi / 6)))),
        ],
        steps=6,
    )


def arch_and_tool(angle: float, thickness: float, **tool: Any) -> tuple[list[Body], float]:
    """A clamped arch of radius 1 below a round tool, not quite above its middle; and its rise."""
    half = np.radians(angle)
    ends = (np.pi / 2 + half, np.pi / 2 - half)
    arch = sector(64, 2, radii=(1.0 - thickness, 1.0), angles=ends, centre=(0.0, -1.0))[:, ::-1]
    round_tool = punch(16, 4, width=0.5, height=0.4, radius=0.5, middle=0.02)
    bodies = [Body(Grid("arch", arch)), Body(Grid("tool", round_tool), E=10.0, **tool)]
    return bodies, 1.0 - np.cos(half)


@family("arch pushed through: half angle in degrees", 20, 40, 60, 90)
def pushed_arch(angle: float) -> Scene:
    """The force passes a maximum, the arch bends to one side and ends upside down."""
    bodies, rise = arch_and_tool(angle, 0.03)
    return Scene(
        bodies=bodies,
        pairs=[("tool/bottom", "arch/top")],
        supports=[
            Support(["arch/left", "arch/right"]),
            Support(["tool/top"], down(1.6 * rise)),
        ],
        steps=13,
    )


@family("arch under a weight: weight / what it bears", 0.5, 0.9, 1.2)
def loaded_arch(ratio: float) -> Scene:
    """Above its limit load the arch snaps through: a jump, to where it hangs."""
    bodies, _ = arch_and_tool(50.0, 0.05, weight=(0.0, -ratio * 2.39e-4 / 0.2))
    return Scene(
        bodies=bodies,
        pairs=[("tool/bottom", "arch/top")],
        supports=[
            Support(["arch/left", "arch/right"]),
            Support(["tool/left", "tool/right"], component=0),
        ],
        steps=10,
    )


# Bodies supported by contact alone


@family("wheel falls on a block: gap / radius", 0.0, 0.1, 1, 10)
def falling_wheel(gap: float) -> Scene:
    """Own weight, no Dirichlet condition on the wheel."""
    weight = 0.02
    x = sector(40, 3, radii=(0.3, 1.0), centre=(0.03, 1.0 + gap))
    area = 0.5 * 40 * np.sin(2 * np.pi / 40) * (1.0**2 - 0.3**2)
    return Scene(
        bodies=[
            ground(30, 5, width=3.0, height=0.8),
            Body(Grid("wheel", x, closed=True), weight=(0.0, -weight)),
        ],
        pairs=[("wheel/bottom", "ground/top")],
        supports=[FIXED],
        steps=2,
        check=lambda posed: expect(
            "force",
            posed.forces[0, 1],
            weight * area,
            1e-6 + posed.problem.certificate().springs,  # forces of springs are told, not wrong
        ),
    )


@family("block between plates: roles, gap / height", *(
    f"{roles} {gap}" for roles in ("slave-slave", "slave-master") for gap in (0.0, 0.05)
))  # fmt: skip
def sandwich(value: str) -> Scene:
    """Three bodies on one another; nothing but contact supports the middle one."""
    roles, gap = value.split()
    g = float(gap)
    shapes = {
        "ground": block(12, 3, width=1.2, height=0.5, corner=(-0.6, -0.5)),
        "middle": block(7, 4, width=0.8, height=1.0, corner=(-0.4, g)),
        "plate": block(10, 3, width=1.2, height=0.5, corner=(-0.6, 1.0 + 2 * g)),
    }
    above = ("middle/top", "plate/bottom")
    return Scene(
        bodies=[Body(Grid(name, x)) for name, x in shapes.items()],
        pairs=[("middle/bottom", "ground/top"), above if roles == "slave-slave" else above[::-1]],
        supports=[FIXED, Support(["plate/top"], down(0.1 + 2 * g))],
        steps=4,
        check=lambda posed: expect(
            "force below", abs(posed.forces[0, 1]), abs(posed.forces[1, 1]), 1e-6
        ),
    )


@family("three bodies meet in a point: slit between two", 0.0, 0.02)
def three_bodies(slit: float) -> Scene:
    """Two blocks side by side on a third, pressed down and together."""
    left = Grid(
        "left",
        block(5, 5, width=0.6, height=0.6, corner=(-0.6 - slit / 2, 0.0)),
        joined={"bottom": "both/bottom"},
    )
    right = Grid(
        "right",
        block(6, 7, width=0.6, height=0.6, corner=(slit / 2, 0.0)),
        joined={"bottom": "both/bottom"},
    )
    together = 0.02 + slit / 2
    return Scene(
        bodies=[ground(16, 5, width=1.6, height=0.6), Body(left), Body(right)],
        pairs=[("ground/top", "both/bottom"), ("right/left", "left/right")],
        supports=[
            FIXED,
            Support(["left/top", "right/top"], down(0.05), component=1),
            Support(["left/left"], down(0.0, aside=together), component=0),
            Support(["right/right"], down(0.0, aside=-together), component=0),
        ],
        steps=3,
    )


@family("prescribed slave nodes", "one end", "both ends", "across", "along")
def clamped_slave(which: str) -> Scene:
    """A block fixed at its sides, so at the ends of the slave, is pushed from below."""
    sides = ["upper/left"] if which == "one end" else ["upper/left", "upper/right"]
    component = {"across": 0, "along": 1}.get(which)
    return Scene(
        bodies=[
            Body(Grid("upper", block(10, 5, width=1.0, height=0.6, corner=(-0.5, 0.0)))),
            ground(14, 5, width=1.4, height=0.6),
        ],
        pairs=[("upper/bottom", "ground/top")],
        supports=[
            Support(["ground/bottom"], legs((1, (0.0, 0.05, 0.0)))),
            Support(["upper/top"]),
            Support(sides, component=component),
        ],
        steps=2,
    )


# Parameters


@family("cells", "quadrilaterals", "triangles")
def cells(kind: str) -> Scene:
    """The punch again."""
    return punch_on_ground(steps=4, depth=0.12, cell=kind[:-1])


@family("weight of the gap c_n", 1e-8, 1e-4, 1, 1e4, 1e8)
def weight_of_gap(c_n: float) -> Scene:
    """The result must not depend on it."""
    return punch_on_ground(steps=4, depth=0.12, pair={"c_n": c_n})


@family("Poisson's ratio", 0.3, 0.45, 0.49, 0.499, 0.4999)
def poisson(nu: float) -> Scene:
    """Nearly incompressible bodies."""
    return punch_on_ground(steps=4, depth=0.08, nu=nu)


@family("unload and touch again: steps per leg", 1, 4)
def unload(count: int) -> Scene:
    """Down, up, aside, down, up."""
    low, high = -0.08, 0.1
    path = legs(
        *(
            (count, (x, y, 0.0))
            for x, y in ((0.0, low), (0.0, high), (0.3, high), (0.3, low), (0.3, high))
        )
    )
    scene = punch_on_ground(
        steps=5 * count,
        check=lambda posed: "" if not posed.forces.any() else "force after unloading",
    )
    return replace(scene, supports=[FIXED, Support(["punch/top"], path)])


@family("unit of length", 1e-6, 1e-3, 1, 1e3, 1e6)
def unit_of_length(scale: float) -> Scene:
    """The same in other units."""
    return punch_on_ground(steps=4, depth=0.12).scaled(scale, 1.0)


@family("unit of stress", 1e-6, 1, 1e6, 1e12)
def unit_of_stress(scale: float) -> Scene:
    """The same in other units."""
    return punch_on_ground(steps=4, depth=0.12).scaled(1.0, scale)


def egg() -> fm.Spline:
    """An ellipse on its side, turned by 60 degrees."""
    t = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    x = turned(np.column_stack([0.4 * np.cos(t), 0.25 * np.sin(t)]), 60.0)
    return fm.Spline(x - [-0.03, x[:, 1].min() - 0.01], name="tool")


# What a rigid tool is, and what else of it moves as forces say
TOOLS: dict[str, tuple[Callable[[], fm.Obstacle], dict[str, float]]] = {
    "roller": (lambda: fm.Circle((0.0, 0.55), 0.5, name="tool"), {}),
    "corner": (
        lambda: fm.Polygon([(0.9, 0.85), (0.0, 0.05), (-0.6, 0.85)], 0.05, name="tool"), {},
    ),
    "loose plate": (lambda: fm.Plane((0.15, 0.05), (0.1, -1.0), name="tool"), {"moment": 0.0}),
    "free egg": (egg, {"x": 0.0, "moment": 0.0}),
}  # fmt: skip


@family("rigid tool by force: tool, force / (E width)", *(
    f"{tool}, {force}" for tool in TOOLS for force in (0.01, 0.05, 0.2)
))  # fmt: skip
def rigid_tool(value: str) -> Scene:
    """It comes from a distance; the plate is tilted, pushed aside of its middle; the egg rolls."""
    tool, part = value.split(", ")
    make, loose = TOOLS[tool]
    force = -1.6 * float(part)
    return Scene(
        bodies=[ground(16, 6, width=1.6, height=0.8)],
        pairs=[("ground/top", "tool")],
        supports=[FIXED],
        steps=4,
        motions=[Tool("tool", make, {"y": force} | loose)],
        check=lambda posed: expect("force", posed.forces[0, 1], force, 1e-5),
    )


@family("few facets on a round master: facets", 3, 5)
def coarse_on_round(facets: int) -> Scene:
    """Three facets of the slave on a convex master: sets like to cycle."""
    dome = mapped(
        24, 5, lambda s, t: (2.0 * (s - 0.5), -0.8 + (0.8 - 0.5 * (2.0 * (s - 0.5)) ** 2 / 1.5) * t)
    )
    return two_blocks(
        block(facets, 3, width=1.0, height=0.6, corner=(-0.45, 0.0)), dome, down(0.2), 4
    )


@family("ranks", 1, 2, 3, 4, 5, methods=("default", "saddle", "standard"))
def ranks(count: int) -> Scene:
    """Ironing with a partly covered surface: the same iterations and forces on any ranks."""
    return replace(ironing(1), ranks=count)
