# SPDX-License-Identifier: MIT
"""Four scenes for all models of the hierarchy: Hertz, press fit, ironing, rolling.

A soft body, the slave, is in contact with a stiff tool: a meshed body or a rigid circle. Lengths
are in any unit, the soft body has Young's modulus 1; nu = 0.3, plane strain. Facets of the tool are
as short as the slave's: longer ones would deviate from the circle by more than the elastic
displacement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import lame, linear_elastic, neo_hookean, read_mesh
from meshes import mapped_grids
from meshes.mapped_grids import Grid, mapped, sector

NU = 0.3
MU, LMBDA = lame(1.0, NU)


@dataclass(frozen=True)
class Rung:
    """A model.

    Attributes:
        name: Its name.
        rigid: Whether the tool is an obstacle.
        strain: "linear" or "finite".
        sliding: "small" or "finite".
        linearization: Linearization of Newton's method.
        climbs: Whether solves begin with cheaper models.
        leaves_out: Coefficient of friction of the full model for comparison.
    """

    name: str
    rigid: bool = False
    strain: str = "finite"
    sliding: str = "finite"
    linearization: str = "full"
    climbs: bool = False
    leaves_out: float = 0.0


FULL = Rung("full")
# Tolerance of the automatic choice and the verdicts, in the energy norm [1].
TOLERANCE = 0.02
RUNGS = (
    Rung("rigid obstacle", rigid=True),
    Rung("linear bulk, small sliding", strain="linear", sliding="small"),
    Rung("linear bulk", strain="linear"),
    Rung("small sliding", sliding="small"),
    Rung("frozen tangent", linearization="frozen"),
    FULL,
    Rung("frictionless", leaves_out=0.3),
    Rung("climb", climbs=True),
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


def ironed(load: float, t: float) -> tuple[float, float, float]:
    """Motion down in the first half of the time, along in the second."""
    return load * max(2 * t - 1, 0.0), -0.08 * min(2 * t, 1.0), 0.0


def rolled(load: float, t: float) -> tuple[float, float, float]:
    """Motion down in the first half, rolling by ``load`` degrees in the second."""
    angle = np.radians(load) * max(2 * t - 1, 0.0)
    return angle, -0.02 * min(2 * t, 1.0), -angle


BOTTOM = (("soft/bottom", None),)
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
    Scene(
        "ironing",
        "slide / R",
        lambda load, k: graded_block(100 * k, 16 * k, 6.0, 2.0),
        lambda load, k: tool_segment(1.0, 60 * k, 5 * k),
        lambda load: (1.0, (0.0, 1.0)),
        BOTTOM,
        (0.01, 0.1, 1.0),
        motion=ironed,
        steps=16,
    ),
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
)


def first_piola(u: Any, strain: str) -> Any:
    """Stress of a body of Young's modulus 1, linear elastic or neo-Hookean."""
    if strain == "linear":
        return linear_elastic(u, MU, LMBDA)
    return neo_hookean(u, MU, LMBDA)


def read(scene: Scene, load: float, bodies: str = "soft tool", finer: int = 1) -> Any:
    """Mesh of some bodies of the scene, refined by the factor ``finer``."""
    soft, tool = Grid("soft", scene.soft(load, finer)), scene.tool(load, finer)
    grids = [grid for grid in (soft, tool) if grid.name in bodies.split()]
    return read_mesh(lambda: mapped_grids.build(grids), MPI.COMM_SELF)


@dataclass
class Posed:
    """A problem, the residual at finite strain, and a function that sets the load for a time."""

    problem: fm.ContactProblem
    finite: Any
    set_time: Callable[[float], None]


def internal_forces(scene: Scene, u: Any, data: Any, strain: str) -> Any:
    """Residual of the bodies of a mesh."""
    dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 2})
    work = ufl.inner(first_piola(u, strain), ufl.grad(ufl.TestFunction(u.function_space)))
    moduli = {"soft": 1.0, "tool": scene.ratio}
    return sum(moduli[name] * work * dx(tag) for name, tag in data.bodies.items())


def fix(V: Any, data: Any, places: Iterable[tuple[str, int | None]]) -> list[Any]:
    """Conditions that fix one component, or both, on boundaries."""
    return [
        fm.dirichlet(V, data, name, np.zeros(2) if which is None else 0.0, which)
        for name, which in places
    ]


def pose(scene: Scene, load: float, rung: Rung, data: Any, friction: float = 0.0) -> Posed:
    """Set up a scene with a model."""
    V = fm.vector_space(data.mesh, 1)
    u, grip = fem.Function(V), fem.Function(V)
    radius, centre = scene.circle(load)
    circle = fm.Circle(centre, radius)
    bcs = fix(V, data, scene.fixed + (() if rung.rigid else scene.symmetry))
    if scene.grip and not rung.rigid:
        bcs.append(fm.dirichlet(V, data, scene.grip, grip))
    master = circle if rung.rigid else "tool/bottom"
    law = fm.Coulomb(friction) if friction else None
    check = None
    if rung.climbs or rung.leaves_out:
        friction_left_out = rung.leaves_out or None
        check = fm.AdequacyCheck(TOLERANCE, hierarchy=rung.climbs, friction=friction_left_out)
    problem = fm.ContactProblem(
        internal_forces(scene, u, data, rung.strain),
        u,
        [fm.ContactPair(data, scene.slave, master, law=law, sliding=rung.sliding)],
        bcs=bcs,
        petsc_options_prefix="ladder_",
        linearization=rung.linearization,
        newton=fm.NewtonOptions(max_iterations=100),
        adequacy=check,
    )
    overlap = np.nan_to_num(problem.equations.contacts[0].gap)

    def set_time(t: float) -> None:
        x, y, angle = scene.motion(load, t)
        if scene.interference:
            problem.equations.contacts[0].offset = (1 - t) * overlap
        circle.move(x=x, y=y, angle=angle)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        middle = np.array(centre)[:, None]
        shift = np.array([[x], [y]])
        grip.interpolate(lambda X: turn @ (X[:2] - middle) + middle + shift - X[:2])

    return Posed(problem, internal_forces(scene, u, data, "finite"), set_time)


def elastic_tool(scene: Scene, circle: fm.Obstacle, data: Any) -> fm.ElasticObstacle:
    """The elastic body represented by the rigid circle, on a mesh of the tool alone."""
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    gripped = ((scene.grip, None),) if scene.grip else ()
    bcs = fix(V, data, (*scene.symmetry, *gripped))
    residual = internal_forces(scene, u, data, "linear")
    return fm.ElasticObstacle(circle, residual, u, data, "tool/bottom", bcs=bcs)
