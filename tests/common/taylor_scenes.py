# SPDX-License-Identifier: MIT
"""Paths of blocks whose solutions are differentiated, and Taylor tests of the derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scenes import TIGHT, lame, pair_options, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.sensitivity.form_controls import FormControl
from fenics_mortar.sensitivity.over_steps import last
from fenics_mortar.sensitivity.protocols import controls_of, dot, quantities_of
from meshes import two_blocks

MESH = {"n_upper": 4, "n_lower": 5, "layers_upper": 2, "layers_lower": 2}
# Push of the upper block: pressed, then shifted until nodes slide over facets.
PRESS = [(0.003, -0.05)]
SLIDE = [(0.002, -0.03), (0.01, -0.05), (0.05, -0.05), (0.12, -0.05), (0.1, -0.045)]


def neo_hookean(u, E, nu):
    """First Piola-Kirchhoff stress with a modulus that may be a constant or a function."""
    mu, lmbda = lame(E, nu)
    F = ufl.Identity(2) + ufl.grad(u)
    inverse = ufl.inv(F).T
    return mu * (F - inverse) + lmbda * ufl.ln(ufl.det(F)) * inverse


def linear(u, E, nu):
    """Cauchy stress of linear elasticity with such a modulus."""
    mu, lmbda = lame(E, nu)
    strain = ufl.sym(ufl.grad(u))
    return 2 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(2)


@dataclass
class Scene:
    """A problem with controls by name, and the path of its solves.

    The control "push" is the prescribed displacement: a change acts in all steps.
    """

    problem: fm.ContactProblem
    u: Any
    controls: dict[str, Any]
    pushes: list[tuple[float, float]]

    def __post_init__(self):
        self.start, self.shift = self.problem.state(), np.zeros(2)

    def solve(self) -> fm.RecordedPath:
        """Solve all steps from the undeformed state, with the present offsets."""
        self.problem.restore(self.start.with_settings_of(self.problem.state()))
        path = fm.RecordedPath(self.problem)
        for push in self.pushes:
            self.controls["push"].value[:] = push + self.shift
            self.problem.solve(predict=False)
            path.record()
        return path

    def changed(self, names: list[str], directions: list[Any], step: float) -> fm.RecordedPath:
        """The path with changed controls, which are reset."""
        made = controls_of(self.problem, [self.controls[name] for name in names])
        before = [control.get(self.problem) for control in made]
        for name, control, value, direction in zip(names, made, before, directions):
            if name == "push":
                self.shift = step * direction
            else:
                control.set(self.problem, value + step * direction)
        try:
            return self.solve()
        finally:
            self.shift = np.zeros(2)
            for control, value in zip(made, before, strict=True):
                control.set(self.problem, value)


def blocks(
    law=None, material=neo_hookean, *, degree=1, pair=None, pushes=PRESS, mesh=None, **options
):
    """Two blocks; controls: modulus E, body force, push, pull on a side, stiffness by cells."""
    data = read(two_blocks.build, **{**MESH, **(mesh or {})})
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    E, field = fem.Constant(data.mesh, 100.0), fem.Function(V, name="load")
    fixed, push = (fem.Constant(data.mesh, (0.0, 0.0)) for _ in range(2))
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    residual = ufl.inner(material(u, E, 0.3), ufl.grad(v)) * dx - ufl.inner(field, v) * dx
    bcs = [fm.dirichlet(V, data, "lower/bottom", fixed), fm.dirichlet(V, data, "upper/top", push)]
    sides = "upper/bottom", "lower/top"
    law = law or fm.Frictionless()
    contact = fm.ContactPair(data, *sides, **pair_options(pair, law=law))
    given = {"petsc_options_prefix": "sensitivity_", "newton": TIGHT, **options}
    problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, **given)
    controls = {"E": E, "load": field, "push": push}
    return Scene(problem, u, controls, pushes)


def value_of(path, objective, over_steps=last):
    """The objective of a path."""
    problem = path.problem
    (quantity,) = quantities_of(problem, objective)
    values = []
    with path.visited():
        for number in range(len(path.steps)):
            path.go_to(number)
            values.append([quantity.value(problem, path.before(number))])
    return over_steps(np.array(values))[0]


def random_directions(scene, names, sizes, seed=0):
    """Random directions, alike on any number of ranks for replicated controls."""
    rng, found = np.random.default_rng(seed), []
    for name, size in zip(names, sizes, strict=True):
        (control,) = controls_of(scene.problem, scene.controls[name])
        value = control.get(scene.problem)
        if isinstance(control, FormControl) and control.is_distributed:
            X = scene.problem.equations.bulk.V.tabulate_dof_coordinates()
            u = np.stack([np.sin(3.0 * X[:, 0] + X[:, 1]), np.cos(2.0 * X[:, 1] - X[:, 0])], 1)
            found.append(size * u.ravel()[: value.size])
        else:
            found.append(size * rng.uniform(0.5, 1.0, value.shape))
    return found


def check(scene, objective, names, sizes, *, over_steps=last, step=1e-3, exact=1e-10):
    """Taylor remainders of slope 2, and adjoint against tangent-linear derivatives.

    Args:
        scene: The scene.
        objective: See ``gradient``.
        names: Names of the controls that are changed together.
        sizes: Size of the change of each, which is of order one in what it changes.
        over_steps: See ``gradient``.
        step: Largest step along these changes.
        exact: Allowed difference of the two derivatives, relative.

    Returns:
        The gradient.
    """
    controls = [scene.controls[name] for name in names]
    directions = random_directions(scene, names, sizes)
    path = scene.solve()
    gradient = fm.gradient(objective, controls, path, over_steps=over_steps)
    tangent = fm.tangent_linear(objective, controls, directions, path, over_steps=over_steps)
    made = controls_of(scene.problem, controls)
    parts = [
        dot(scene.problem, control, sum(by_step), direction)
        for control, by_step, direction in zip(made, gradient.by_step, directions, strict=True)
    ]
    found, size = sum(parts), sum(map(abs, parts))
    assert abs(found - tangent.derivative) <= exact * size, (found, tangent.derivative)
    start = value_of(path, objective, over_steps)
    assert abs(start - gradient.value) <= 1e-12 * abs(start)
    remainders = []
    for fraction in (1.0, 0.5, 0.25):
        h = step * fraction
        there = value_of(scene.changed(names, directions, h), objective, over_steps)
        remainders.append(abs(there - start - h * found))
    slopes = np.log2(np.array(remainders[:-1]) / remainders[1:])
    print(
        f"{names}: {found:.6g}, adjoint - tangent {found - tangent.derivative:.1e}, "
        f"remainders {remainders}, slopes {slopes}, {gradient.nearest_change}"
    )
    noise = 1e-9 * step * size
    assert remainders[-1] <= noise or slopes.min() > 1.9, (remainders, slopes, found)
    return gradient
