# SPDX-License-Identifier: MIT
"""Problems for simpler models: Hertz, press fit, ironing, rolling, and others.

The others have bodies of revolution, mass, a law with memory, or contact of a body with itself.

A soft body, the slave, is in contact with a stiff tool: a meshed body or a rigid circle. Lengths
are in any unit, the soft body has Young's modulus 1; nu = 0.3, plane strain. Facets of the tool are
as short as the slave's: longer ones would deviate from the circle by more than the elastic
displacement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import fenics_mortar as fm
from fenics_mortar import laws
from meshes import mapped_grids
from meshes.mapped_grids import Grid, mapped, sector


@dataclass(frozen=True)
class Model:
    """A model.

    Attributes:
        name: Its name.
        rigid: Whether the tool is an obstacle.
        strain: "linear" or "finite".
        sliding: "small" or "finite".
        linearization: Linearization of Newton's method.
        leaves_out: Coefficient of friction of the full model for comparison.
    """

    name: str
    rigid: bool = False
    strain: str = "finite"
    sliding: str = "finite"
    linearization: str = "full"
    leaves_out: float = 0.0


FULL = Model("full")
# Tolerance of the verdicts, in the energy norm [1].
TOLERANCE = 0.02
MODELS = (
    Model("rigid obstacle", rigid=True),
    Model("linear bulk, small sliding", strain="linear", sliding="small"),
    Model("linear bulk", strain="linear"),
    Model("small sliding", sliding="small"),
    Model("frozen tangent", linearization="frozen"),
    FULL,
    Model("frictionless", leaves_out=0.3),
)


@dataclass(frozen=True)
class Scene:
    """A soft body and a tool, and how the tool moves.

    Attributes:
        name: Its name.
        load: Meaning of the load's number.
        unit: Its unit.
        soft, tool: Functions that create the bodies for a load and a refinement factor of the
            cells.
        slave, master: The surfaces.
        circle: Radius and centre of the rigid obstacle, for a load.
        grip: Boundary of the tool that is moved; "" if there is none.
        fixed: Boundaries and components of the soft body that are fixed.
        symmetry: Fixed boundaries and components of the tool.
        motion: Motion (x, y, angle) of the tool at time 0 ... 1 of a load.
        interference: Whether instead the meshed overlap is applied gradually.
        ratio: Young's modulus of the tool.
        steps: Load steps.
        geometry: "plane" or "axisymmetric".
        law: Makes the law of the pair, for a load.
        duration: Time of an impact, over that of a wave through a length of one; the soft body with
            mass hits the tool, ``load`` is its speed over that of the waves. 0 in statics.
        pressure: Dead pressure on "soft/top" at the end of a load; then there is no tool, and
            ``slave`` may touch itself.
    """

    name: str
    load: str
    soft: Callable[[float, int], np.ndarray]
    tool: Callable[[float, int], Grid]
    circle: Callable[[float], tuple[float, tuple[float, float]]]
    fixed: tuple[tuple[str, int | None], ...]
    loads: tuple[float, ...]
    slave: str = "soft/top"
    grip: str = "tool/top"
    symmetry: tuple[tuple[str, int], ...] = ()
    motion: Callable[[float, float], tuple[float, float, float]] = lambda load, t: (0.0, 0.0, 0.0)
    interference: bool = False
    ratio: float = 20.0
    steps: int = 4
    geometry: str = "plane"
    law: Callable[[float], Any] | None = None
    duration: float = 0.0
    pressure: Callable[[float], float] | None = None

    def models(self) -> list[Model]:
        """The models that make sense: cheaper models have no inertia, see ``ModelCheck``."""
        moves, alone = self.duration > 0.0, self.pressure is not None
        return [
            model
            for model in MODELS
            if not (model.leaves_out and moves)
            and not (model.leaves_out and self.law is not None)
            and not (model.rigid and alone)
        ]


def graded_block(columns: int, rows: int, width: float, height: float) -> np.ndarray:
    """A block below y = 0, with rows that get thinner towards the top."""
    return mapped(
        columns,
        rows,
        lambda s, t: (width * (s - 0.5), -height * (0.35 * (1 - t) + 0.65 * (1 - t) ** 2)),
    )


def tool_segment(radius: float, columns: int, rows: int) -> Grid:
    """The lowest part of a thick ring that touches y = 0 from above."""
    angles = (-0.8 * np.pi, -0.2 * np.pi)
    shape = sector(columns, rows, radii=(0.5 * radius, radius), angles=angles, centre=(0.0, radius))
    return Grid("tool", shape)


def wheel(columns: int, rows: int) -> Grid:
    """A thick ring that touches y = 0 from above."""
    return Grid("tool", sector(columns, rows, radii=(0.4, 1.0), centre=(0.0, 1.0)), closed=True)


def half_block(columns: int, rows: int, width: float, height: float) -> np.ndarray:
    """A block below y = 0 right of the axis, its rows thinner towards the top."""
    x = graded_block(columns, rows, 2.0 * width, height)
    x[..., 0] = 0.5 * (x[..., 0] + width)
    return x


def hairpin(gap: float, along: int, across: int) -> np.ndarray:
    """Two arms of length 1 along x, a gap apart, and the bend that joins them."""
    radius, bend, arm = 0.2, 16 * along, 20 * along
    angles = -0.5 * np.pi - np.linspace(0.0, np.pi, bend + 1)
    x = np.linspace(1.0, 0.0, arm + 1)[:-1]
    arms = [np.stack([x, np.full(arm, y)], axis=1) for y in (-radius, radius)]
    turn = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    middle = np.concatenate([arms[0], turn, arms[1][::-1]])
    tangent = np.repeat([[-1.0, 0.0]], arm, axis=0)
    tangent = np.concatenate([
        tangent, np.stack([np.sin(angles), -np.cos(angles)], axis=1), -tangent
    ])  # fmt: skip
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    depth = (2.0 * radius - gap) * np.linspace(-0.5, 0.5, across + 1)
    return middle[:, None] + depth[:, None] * normal[:, None]


def no_tool(load: float, k: int) -> Grid:
    """Placeholder for problems without a tool."""
    return Grid("none", mapped_grids.block(1, 1, width=1.0, height=1.0))


def ironed(load: float, t: float) -> tuple[float, float, float]:
    """Motion down in the first half of the time, along in the second."""
    return load * max(2 * t - 1, 0.0), -0.08 * min(2 * t, 1.0), 0.0


def rolled(load: float, t: float) -> tuple[float, float, float]:
    """Motion down in the first half, rolling by ``load`` degrees in the second."""
    angle = np.radians(load) * max(2 * t - 1, 0.0)
    return angle, -0.02 * min(2 * t, 1.0), -angle


TO_THE_RIGHT = (-0.5 * np.pi, -0.2 * np.pi)
BOTTOM = (("soft/bottom", None),)
IRONING = Scene(
    "ironing",
    "slide / R",
    lambda load, k: graded_block(100 * k, 16 * k, 6.0, 2.0),
    lambda load, k: tool_segment(1.0, 60 * k, 5 * k),
    lambda load: (1.0, (0.0, 1.0)),
    BOTTOM,
    (0.01, 0.1, 1.0),
    motion=ironed,
    steps=16,
)

SCENES = (
    Scene(
        "Hertz",
        "depth / R",
        lambda load, k: graded_block(100 * k, 24 * k, 3.0, 1.5),
        lambda load, k: tool_segment(1.0, 160 * k, 5 * k),
        lambda load: (1.0, (0.0, 1.0)),
        BOTTOM,
        (0.001, 0.01, 0.05),
        motion=lambda load, t: (0.0, -load * t, 0.0),
    ),
    Scene(
        "press fit",
        "interference / b",
        lambda load, k: sector(100 * k, 10 * k, radii=(1.0, 1.5), angles=(0.0, np.pi / 2)),
        lambda load, k: Grid(
            "tool", sector(144 * k, 10 * k, radii=(0.5, 1.0 + load), angles=(0.0, np.pi / 2))
        ),
        lambda load: (1.0 + load, (0.0, 0.0)),
        (("soft/left", 1), ("soft/right", 0)),
        (0.001, 0.01, 0.05, 0.2),
        grip="",
        symmetry=(("tool/left", 1), ("tool/right", 0)),
        interference=True,
    ),
    IRONING,
    Scene(
        "rolling",
        "angle [degree]",
        lambda load, k: graded_block(120 * k, 16 * k, 4.0, 1.0),
        lambda load, k: wheel(240 * k, 6 * k),
        lambda load: (1.0, (0.0, 1.0)),
        BOTTOM,
        (0.5, 5.0, 30.0),
        motion=rolled,
        steps=12,
    ),
    Scene(
        "ball",
        "depth / R",
        lambda load, k: half_block(50 * k, 24 * k, 1.5, 1.5),
        lambda load, k: Grid(
            "tool",
            sector(80 * k, 5 * k, radii=(0.5, 1.0), angles=TO_THE_RIGHT, centre=(0.0, 1.0)),
        ),
        lambda load: (1.0, (0.0, 1.0)),
        (*BOTTOM, ("soft/left", 0)),
        (0.001, 0.01, 0.05),
        symmetry=(("tool/left", 0),),
        motion=lambda load, t: (0.0, -load * t, 0.0),
        geometry="axisymmetric",
    ),
    Scene(
        "impact",
        "speed / c",
        lambda load, k: graded_block(30 * k, 16 * k, 1.5, 1.0),
        lambda load, k: tool_segment(1.0, 60 * k, 5 * k),
        lambda load: (1.0, (0.0, 1.0)),
        (),
        (0.001, 0.01, 0.1),
        steps=24,
        duration=1.5,
    ),
    replace(IRONING, name="wear", law=lambda load: laws.Worn(0.2, 0.1)),
    Scene(
        "hairpin",
        "gap / length",
        lambda load, k: hairpin(load, 2 * k, 8 * k),
        no_tool,
        lambda load: (1.0, (0.0, 1.0)),
        (("soft/left", None), ("soft/right", None)),
        (0.002, 0.01, 0.03),
        slave="soft/bottom",
        grip="",
        steps=8,
        law=lambda load: fm.Coulomb(0.3),
        pressure=lambda load: 4.0 * load,
    ),
)
