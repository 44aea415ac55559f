# SPDX-License-Identifier: MIT
"""Paths whose solutions are differentiated, and Taylor tests of the derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scenes import TIGHT, neo_hookean, pair_options, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.sensitivity.controls import dot
from fenics_mortar.sensitivity.forms import controls_of, quantities_of
from fenics_mortar.sensitivity.objective import last
from meshes import mapped_grids, two_blocks
from meshes.mapped_grids import Grid, block

MESH = {"n_upper": 4, "n_lower": 5, "layers_upper": 2, "layers_lower": 2}
# Positions of the upper block: pressed, then drawn over facets and back.
PRESS = [(0.003, -0.05)]
SLIDE = [(0.002, -0.03), (0.01, -0.05), (0.05, -0.05), (0.12, -0.05), (0.1, -0.045)]
# Positions of a circle, likewise.
ROLL = [(0.0, -0.03, 0.1), (0.01, -0.05, 0.1), (0.06, -0.05, 0.1)]


@dataclass
class Path:
    """A problem, its controls by name, and the loads of its steps.

    Attributes:
        problem: The problem.
        u: Its displacement.
        controls: The controls by name. "place" is that of the upper block or of the obstacle; a
            change of it acts in all steps.
        move: Function that sets the position of a step.
        places: The positions of the steps.
    """

    problem: fm.ContactProblem
    u: Any
    controls: dict[str, Any]
    move: Callable[[Any], None]
    places: list[Any]

    def __post_init__(self):
        self.start = self.problem.state()

    def solve(self, names=(), changes=()) -> sensitivity.RecordedPath:
        """Solve all steps from the undeformed state with changed controls; reset the controls."""
        self.problem.restore(self.start)
        made = controls_of(self.problem, [self.controls[n] for n in names]) if names else []
        before = [control.get(self.problem) for control in made]
        path, shift = sensitivity.RecordedPath(self.problem), 0.0
        for name, control, value, change in zip(names, made, before, changes):
            if name == "place":
                shift = change
            else:
                control.set(self.problem, value + change)
        if any(isinstance(control, sensitivity.ObstacleShape) for control in made):
            self.problem.restore(self.problem.state())  # slip counts from points of this shape
            self.problem.accept()
        for place in self.places:
            self.move(np.asarray(place) + shift)
            self.problem.solve(predict=False)
            path.record()
        for control, value in zip(made, before, strict=True):
            control.set(self.problem, value)
        return path


def timed(scene: Path) -> Path:
    """The path with steps of length 0.5, for laws of time."""
    move, problem = scene.move, scene.problem

    def later(place):
        problem.time = problem.time + 0.5
        move(place)

    scene.move = later
    return scene


def blocks(
    law=None,
    material=neo_hookean,
    *,
    degree=1,
    pair=None,
    places=PRESS,
    mesh=None,
    bend=0.0,
    **more,
):
    """Two blocks, bent; controls: modulus, body force, place, mu or stress, interference."""
    data = read(two_blocks.build, **{**MESH, **(mesh or {})})
    data.mesh.geometry.x[:, :2] += bend * wave(*data.mesh.geometry.x[:, :2].T)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    E, load = fem.Constant(data.mesh, 100.0), fem.Function(V, name="load")
    fixed, push = (fem.Constant(data.mesh, (0.0, 0.0)) for _ in range(2))
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    residual = ufl.inner(material(u, E, 0.3), ufl.grad(v)) * dx - ufl.inner(load, v) * dx
    bcs = [fm.dirichlet(V, data, "lower/bottom", fixed), fm.dirichlet(V, data, "upper/top", push)]
    options = pair_options(pair, law=law or fm.Frictionless())
    pairs = [fm.ContactPair(data, "upper/bottom", "lower/top", **options)]
    given = {"petsc_options_prefix": "taylor_", "newton": TIGHT, **more}
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, **given)
    controls = {
        "E": E, "load": load, "place": push, "interference": sensitivity.Interference(0),
        "mu": sensitivity.LawParameter(0, "mu"), "stress": sensitivity.LawParameter(0, "stress"),
    }  # fmt: skip

    def move(place):
        push.value[:] = place

    return Path(problem, u, controls, move, places)


def obstacle_on_block(obstacle, law=None, *, degree=1, places=ROLL, **more):
    """A block, fixed at its bottom, under an obstacle that is moved."""
    data = read(two_blocks.build, width_lower=1.0, gap=3.0, n_lower=8, layers_lower=3, n_upper=1)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    E = fem.Constant(data.mesh, 100.0)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    residual = ufl.inner(neo_hookean(u, E, 0.3), ufl.grad(v)) * dx
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    pairs = [fm.ContactPair(data, "lower/top", obstacle, law=law or fm.Frictionless())]
    given = {"petsc_options_prefix": "taylor_", "newton": TIGHT, **more}
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, **given)
    controls = {
        "E": E, "place": sensitivity.ObstaclePlace(obstacle),
        "mu": sensitivity.LawParameter(0, "mu"),
        **{name: sensitivity.ObstacleShape(obstacle, name) for name in obstacle.shape()},
    }  # fmt: skip

    def move(place):
        obstacle.place = place

    return Path(problem, u, controls, move, places)


def tied_blocks(places, *, degree=1):
    """Non-matching blocks joined by a tie; controls: modulus, body force, place."""
    grids = [
        Grid("lower", block(3, 2, width=1.0, height=0.5)),
        Grid("upper", block(4, 2, width=1.0, height=0.5, corner=(0.0, 0.5))),
    ]
    data = mapped_grids.mesh(grids)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    E, load = fem.Constant(data.mesh, 100.0), fem.Function(V, name="load")
    push = fem.Constant(data.mesh, (0.0, 0.0))
    residual = ufl.inner(neo_hookean(u, E, 0.3), ufl.grad(v)) * ufl.dx(degree=2)
    residual -= ufl.inner(load, v) * ufl.dx
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0, 0)), fm.dirichlet(V, data, "upper/top", push)]
    tie = fm.TiedPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        residual, u, [tie], bcs=bcs, newton=TIGHT, petsc_options_prefix="ties_"
    )

    def move(place):
        push.value[:] = place

    return Path(problem, u, {"E": E, "load": load, "place": push}, move, places)


def wave(x, y, *z):
    """A smooth field, shape (n, 2), in space (n, 3)."""
    parts = np.sin(3.0 * x + y), np.cos(2.0 * y - x), *(np.sin(x - 2.0 * y + at) for at in z)
    return np.stack(parts, axis=1)


def value_of(path, objective, over_steps=last):
    """The objective of a recorded path."""
    problem, values = path.problem, []
    quantities = quantities_of(problem, objective)
    with path.visited():
        for number in range(len(path.steps)):
            path.go_to(number)
            values.append([quantity.value(problem, path.before(number)) for quantity in quantities])
    return over_steps(np.array(values))[0]


def directions_of(scene, names, sizes):
    """Directions of controls, equal on any number of ranks."""
    rng, found = np.random.default_rng(1), []
    for name, size in zip(names, sizes, strict=True):
        (control,) = controls_of(scene.problem, scene.controls[name])
        value = control.get(scene.problem)
        if getattr(control, "is_distributed", False):
            space = scene.problem.equations.bulk.space
            x = space.V.tabulate_dof_coordinates()[:, : space.dim]
            found.append(size * wave(*x.T).ravel()[: value.size])
        else:
            found.append(size * rng.uniform(0.5, 1.0, value.shape))
    return found


def check(scene, objective, names, sizes, *, over_steps=last, step=1e-3, exact=1e-10):
    """Taylor remainders of slope 2, and adjoint against tangent-linear derivatives.

    Args:
        scene: The path.
        objective: See ``gradient``.
        names: Names of the controls that are changed together.
        sizes: Size of the change of each, such that sets stay within ``step`` of it.
        over_steps: See ``gradient``.
        step: Largest step along these changes.
        exact: Allowed difference of the two derivatives, relative.

    Returns:
        The gradient.
    """
    controls = [scene.controls[name] for name in names]
    directions = directions_of(scene, names, sizes)
    path = scene.solve()
    gradient = fm.gradient(objective, controls, path, over_steps=over_steps)
    tangent = sensitivity.tangent_linear(
        objective, controls, directions, path, over_steps=over_steps
    )
    made = controls_of(scene.problem, controls)
    parts = [
        dot(scene.problem, control, sum(by_step), direction)
        for control, by_step, direction in zip(made, gradient.by_step, directions, strict=True)
    ]
    found, size = sum(parts), sum(map(abs, parts))
    assert all(parts), parts
    assert abs(found - tangent.derivative) <= exact * size, (found, tangent.derivative)
    start = value_of(path, objective, over_steps)
    assert abs(start - gradient.value) <= 1e-12 * abs(start)
    remainders = []
    for fraction in (1.0, 0.5, 0.25):
        h = step * fraction
        there = scene.solve(names, [h * direction for direction in directions])
        remainders.append(abs(value_of(there, objective, over_steps) - start - h * found))
    slopes = np.log2(np.array(remainders[:-1]) / remainders[1:])
    # If the objective is linear, remainders are errors of the solves: 1e-13 of the forces.
    rounding = 1e-11 * (abs(start) + size)
    assert remainders[0] <= rounding or slopes.min() > 1.9, (remainders, slopes, found)
    return gradient
