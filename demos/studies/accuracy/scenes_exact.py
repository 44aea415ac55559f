# SPDX-License-Identifier: MIT
"""Contact problems with known solutions, on meshes of any size and element."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.accuracy.exact_curved import CurvedInterface
from demos.studies.accuracy.exact_flat import FlatInterface
from demos.studies.accuracy.exact_hertz import HalfPlanes
from demos.studies.accuracy.exact_rings import PressFit, linear
from demos.studies.accuracy.posed import (
    ELEMENTS,
    Choice,
    Posed,
    body_force,
    interpolate,
    piola,
    pose,
    read,
    spread,
)
from demos.studies.common import linear_elastic, neo_hookean
from fenics_mortar.energies import lame
from meshes import mapped_grids
from meshes.mapped_grids import Grid

# Half the side of the boxes of the Hertz problem. On uniform meshes the ends of the contact then
# lie a third or two thirds of a facet beyond a node, alternately: rates are steady over two
# halvings.
HALF_SIDE = 3.0  # half-widths


def hertz(n: int, choice: Choice, *, graded: bool = False) -> Posed:
    """Problem of Hertz on grids with n slave facets of degree 1, or n / 2 of degree 2."""
    return hertz_on(two_boxes(n, choice, HalfPlanes(), graded=graded), choice)


def two_boxes(n: int, choice: Choice, exact: HalfPlanes, *, graded: bool) -> Any:
    """Mesh of a parabola above a flat body, fine where the tractions have kinks if ``graded``."""
    cell, degree = ELEMENTS[choice.element]
    side, height = HALF_SIDE * exact.a, HALF_SIDE * exact.a

    def grid(n: int, sign: float) -> np.ndarray:
        columns, rows = n // degree * degree, n // 2 // degree * degree
        s, t = np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1)
        if graded:
            kinks = np.array([exact.a, exact.stuck])[: 2 if exact.stuck else 1] / side
            s = spread(columns, lambda s: kink_density(2 * s - 1, kinks))
            t = t**2
            if degree == 2:
                s[1::2], t[1::2] = (s[:-1:2] + s[2::2]) / 2, (t[:-1:2] + t[2::2]) / 2
        s, t = np.meshgrid(s, t, indexing="ij")
        x = side * (2 * s - 1)
        bottom = x**2 / (2 * exact.R) if sign > 0 else 0 * x
        return np.stack([x, bottom + t * (sign * height - bottom)], axis=2)

    upper, lower = grid(n, 1.0), grid(5 * n // 8, -1.0)[:, ::-1]
    return read([Grid("upper", upper), Grid("lower", lower)], cell, degree)


def of_body(exact: HalfPlanes, x: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Exact displacement at ``x`` (2, n) of a body; x may lie on the other side of y = 0."""
    y = np.where(upper, 1.0, -1.0) * np.maximum(np.abs(x[1]), 1e-30)
    return exact.displacement(np.stack([x[0], y]))


def gradient_of_body(exact: HalfPlanes, x: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Strain at ``x`` (2, n), shape (2, 2, n), which norms use as the gradient."""
    mu, lmbda = lame(exact.E, exact.nu)
    stress = exact.stress(np.stack([x[0], np.where(upper, 1, -1) * np.abs(x[1])]))
    trace = (stress[0, 0] + stress[1, 1]) * lmbda / (2 * (mu + lmbda))
    return (stress - trace * np.eye(2)[:, :, None]) / (2 * mu)


def hertz_on(data: Any, choice: Choice) -> Posed:
    """A parabola above (the slave) on a flat body: boxes with the exact loads on their sides."""
    exact = HalfPlanes()

    def loads(x: Any, v: Any, dx: Any, ds: Any) -> Any:
        names = [f"{body}/{side}" for body in ("upper", "lower") for side in ("left", "right")]
        normal = ufl.as_vector([ufl.sign(x[0]), 0])
        traction = ufl.dot(exact.ufl_stress(x), normal)
        return sum(ufl.inner(traction, v) * ds(data.boundary_tag(name)) for name in names)

    u, problem = pose(
        data,
        choice,
        linear_elastic,
        exact,
        "upper/bottom",
        "lower/top",
        displacement=partial(of_body, exact),
        prescribed_on={"upper/top": True, "lower/bottom": False},
        loads=loads,
    )
    return Posed(
        data,
        u,
        problem,
        "upper",
        partial(of_body, exact),
        partial(gradient_of_body, exact),
        lambda x: exact.pressure(x[0]),
        lame(exact.E, exact.nu),
        exact.a,
    )


def kink_density(x: np.ndarray, kinks: np.ndarray) -> np.ndarray:
    """Density of nodes over [-1, 1]: facets like the root of the distance from +- a kink."""
    distance = np.abs(np.abs(x)[:, None] - kinks)
    return (1 / np.sqrt(distance + 1e-6)).sum(axis=1)


def cattaneo(n: int, choice: Choice, *, graded: bool = False, **options: Any) -> Posed:
    """Boxes with friction, pressed already; ``solve`` shears them.

    The exact displacement is prescribed on all outer sides. The sticking half-width is half that of
    the contact: on uniform meshes both end a third or two thirds of a facet beyond a node.
    """
    exact = HalfPlanes(friction=0.3, stuck=0.25)
    data = two_boxes(n, choice, exact, graded=graded)
    degree = ELEMENTS[choice.element][1]
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.Measure("dx", data.mesh, metadata={"quadrature_degree": 2 * degree})
    values = {body: fem.Function(V) for body in ("upper", "lower")}
    sides = {"upper": ("top", "left", "right"), "lower": ("bottom", "left", "right")}
    bcs = [
        fm.dirichlet(V, data, f"{body}/{side}", value)
        for body, value in values.items()
        for side in sides[body]
    ]
    options = {"basis": choice.basis, "integration": choice.integration, **options}
    law, discretization = fm.Coulomb(exact.friction), fm.Discretization(**options)
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=law, discretization=discretization)
    residual = ufl.inner(linear_elastic(u, *lame(exact.E, exact.nu)), ufl.grad(v)) * dx
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="accuracy_")

    def prescribe(exact: HalfPlanes) -> None:
        for body, value in values.items():
            on = body == "upper"
            value.interpolate(lambda x, on=on: of_body(exact, x[:2], np.full(x.shape[1], on)))

    prescribe(replace(exact, friction=0.0))
    problem.solve()
    prescribe(exact)

    return Posed(
        data,
        u,
        problem,
        "upper",
        partial(of_body, exact),
        partial(gradient_of_body, exact),
        lambda x: exact.pressure(x[0]),
        lame(exact.E, exact.nu),
        shear=lambda x: exact.shear(x[0]),
    )


def press_fit(n: int, choice: Choice, *, law: str = "neo_hookean") -> Posed:
    """Two rings, n facets of the outer circle of the inner one; the outer ring is the slave."""
    cell, degree = ELEMENTS[choice.element]
    exact = PressFit(law=linear, interference=0.1) if law == "linear" else PressFit()
    (a, outside), (inside, c) = exact.rings

    def ring(n: int, radii: tuple[float, float]) -> np.ndarray:
        return mapped_grids.sector(n // degree * degree, n // 6 // degree * degree, radii=radii)

    grids = [
        Grid("inner", ring(n, (a, outside)), closed=True),
        Grid("outer", ring(4 * n // 3, (inside, c)), closed=True),
    ]
    data = read(grids, cell, degree)
    u, problem = pose(
        data,
        choice,
        linear_elastic if law == "linear" else neo_hookean,
        exact,
        "outer/top",
        "inner/bottom",
        displacement=lambda x, on: exact.displacement(x, ~on),
        prescribed_on={"inner/top": False, "outer/bottom": True},
    )
    return Posed(
        data,
        u,
        problem,
        "outer",
        lambda x, on: exact.displacement(x, ~on),
        lambda x, on: exact.gradient(x, ~on),
        lambda x: np.full(x.shape[1], exact.contact_pressure),
        lame(exact.E, exact.nu),
    )


def flat(n: int, choice: Choice, *, friction: float = 0.0, ends: float = 0.0) -> Posed:
    """The smooth manufactured solution; n facets of the slave, which is below.

    With friction the upper part is wider, and has slid by half the width of the slave. Outside the
    slave the exact traction acts on the upper part; ``ends`` is the stretch at the ends of the
    slave, without which the pressure is zero there.
    """
    cell, degree = ELEMENTS[choice.element]
    slides = {"friction": friction, "slid": 0.5, "stretches": (ends, 0.2)}
    exact = FlatInterface(**slides) if friction else FlatInterface()
    bodies = {"lower": True, "upper": False}

    def grid(rows: int, left: float, bottom: float) -> np.ndarray:
        rows, width = rows // degree * degree, 1.0 - left
        columns = round(rows * width)
        return mapped_grids.block(columns, rows, width=width, height=1.0, corner=(left, bottom))

    upper, lower = grid(2 * n // 3, -2 * exact.slid, 0.0), grid(n, 0.0, -1.0)
    data = read([Grid("upper", upper), Grid("lower", lower)], cell, degree)

    def displacement(x: np.ndarray, on: np.ndarray) -> np.ndarray:
        return exact.displacement(x, ~on)

    def gradient(x: np.ndarray, on: np.ndarray) -> np.ndarray:
        return exact.gradient(x, ~on)

    def stress(x: np.ndarray, on: np.ndarray) -> np.ndarray:
        return piola(gradient(x, on), *lame(exact.E, exact.nu))

    def loads(x: Any, v: Any, dx: Any, ds: Any) -> Any:
        P_x, P_y = (fem.Function(fm.vector_space(data.mesh, 2)) for _ in range(2))
        for J, column in enumerate((P_x, P_y)):
            interpolate(column, data, bodies, lambda x, on, J=J: stress(x, on)[:, J])
        beside = ufl.conditional(ufl.gt(abs(x[0] + exact.slid - 0.5), 0.5), 1.0, 0.0)
        tractions = {"upper/bottom": -beside * P_y, "lower/left": -P_x, "lower/right": P_x}
        work = ufl.inner(body_force(data, bodies, stress), v) * dx
        for name, traction in tractions.items():
            work += ufl.inner(traction, v) * ds(data.boundary_tag(name))
        return work

    prescribed_on = {f"upper/{side}": False for side in ("left", "right", "top")}
    u, problem = pose(
        data,
        choice,
        neo_hookean,
        exact,
        "lower/top",
        "upper/bottom",
        displacement=displacement,
        prescribed_on=prescribed_on | {"lower/bottom": True},
        loads=loads,
        friction=fm.Coulomb(friction) if friction else None,
    )
    interpolate(u, data, bodies, displacement)  # initial guess: one step from rest is too large
    return Posed(
        data,
        u,
        problem,
        "lower",
        displacement,
        gradient,
        lambda x: exact.pressure(x[0]),
        lame(exact.E, exact.nu),
        shear=(lambda x: friction * exact.pressure(x[0])) if friction else None,
    )


def curved(n: int, choice: Choice, *, tied: bool = False) -> Posed:
    """The smooth solution across a circle that sticks; n facets of the slave, which is outside."""
    cell, degree = ELEMENTS[choice.element]
    exact = CurvedInterface()
    a, b, c = exact.radii
    bodies = {"outer": True, "inner": False}

    def ring(n: int, radii: tuple[float, float]) -> np.ndarray:
        columns, rows = n // degree * degree, n // 2 // degree * degree
        return mapped_grids.sector(columns, rows, radii=radii, angles=(0.0, np.pi / 2))

    grids = [Grid("outer", ring(n, (b, c))), Grid("inner", ring(2 * n // 3, (a, b)))]
    data = read(grids, cell, degree)

    def displacement(x: np.ndarray, on: np.ndarray) -> np.ndarray:
        return exact.displacement(x)

    def gradient(x: np.ndarray, on: np.ndarray) -> np.ndarray:
        return exact.gradient(x)

    def loads(x: Any, v: Any, dx: Any, ds: Any) -> Any:
        force = body_force(
            data, bodies, lambda x, on: piola(gradient(x, on), *lame(exact.E, exact.nu))
        )
        return ufl.inner(force, v) * dx

    prescribed_on = {f"outer/{side}": True for side in ("bottom", "left", "right")}
    prescribed_on |= {f"inner/{side}": False for side in ("top", "left", "right")}
    u, problem = pose(
        data,
        choice,
        neo_hookean,
        exact,
        "outer/top",
        "inner/bottom",
        displacement=displacement,
        prescribed_on=prescribed_on,
        loads=loads,
        friction=fm.Tresca(10.0 * exact.E),
        tied=tied,
    )
    interpolate(u, data, bodies, displacement)  # initial guess: one step from rest is too large
    return Posed(
        data,
        u,
        problem,
        "outer",
        displacement,
        gradient,
        partial(exact.pressure, tied=tied),
        lame(exact.E, exact.nu),
    )


SCENES = {"hertz": hertz, "press fit": press_fit, "flat": flat, "curved": curved}
