# SPDX-License-Identifier: MIT
"""Random laws with memory on a column that is pressed on a plane: closed forms step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.stability.physics import SOLVED, certified, differs, follow, size
from fenics_mortar import laws
from meshes.mapped_grids import Grid, block, mesh


@dataclass
class Column:
    """A linear elastic block, nu = 0, on a plane, both rotated by an angle; its top is prescribed.

    Attributes:
        problem: The problem.
        top: Displacement of the top.
        plane: The plane, whose ``place`` moves along it.
        tangent, normal: Directions along and out of the plane.
        unit: Its height [length].
        E: Young's modulus [stress].
    """

    problem: fm.ContactProblem
    top: fem.Constant
    plane: fm.Plane
    tangent: Any
    normal: Any
    unit: float
    E: float

    @property
    def contact(self) -> Any:
        """The contact."""
        return self.problem.contacts[0]

    def rise(self, height: float) -> list[Any]:
        """Move the top to a height [unit] in adaptive steps; return their reports."""
        start, end = self.top.value.copy(), height * self.unit * self.normal

        def load(time: float) -> None:
            self.top.value[:] = start + time * (end - start)

        return follow(self.problem, load, 1)

    def slide(self, distance: float, duration: float) -> Any:
        """Move the plane along itself by a distance [unit] in a time; solve."""
        x, y, _ = self.plane.place + np.append(distance * self.unit * self.tangent, 0.0)
        self.plane.move(x=x, y=y)
        self.problem.time += duration
        return self.problem.solve()


def draw_memory(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Draw a law and a column."""
    kind = str(rng.choice(list(JUDGES)))
    about = {"scene": kind, "facets": int(rng.integers(2, 8)), "degree": int(rng.integers(1, 3))}
    unit, E, angle = size(rng, 1e-3, 1e3), size(rng, 1e-3, 1e6), rng.uniform(0.0, 2.0 * np.pi)
    law, solve = JUDGES[kind](rng, unit, E)

    def run() -> Any:
        column = _column(law, about["facets"], about["degree"], unit, E, angle)
        reports: list[Any] = []
        errors = list(solve(column, reports))
        violations, remarks = certified([column.problem])
        return reports, errors + violations, remarks

    return about | {"law": repr(law)}, run


def _column(law: Any, facets: int, degree: int, unit: float, E: float, angle: float) -> Column:
    """The column with height 1 and width 3 [unit], so that friction lifts no edge."""
    tangent = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([-tangent[1], tangent[0]])
    shape = block(degree * facets, 2 * degree, width=3.0, height=1.0)
    data = mesh([Grid("column", unit * shape @ np.stack([tangent, normal]))], order=degree)
    V = fm.vector_space(data.mesh, degree)
    u, v, top = fem.Function(V), ufl.TestFunction(V), fem.Constant(data.mesh, (0.0, 0.0))
    stress = E * ufl.sym(ufl.grad(u))
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2 * degree})
    plane = fm.Plane((0.0, 0.0), tuple(normal))
    pair = fm.ContactPair(data, "column/bottom", plane, law=law)
    bcs = [fm.dirichlet(V, data, "column/top", top)]
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="memory_")
    return Column(problem, top, plane, tangent, normal, unit, E)


def _wear(rng: np.random.Generator, unit: float, E: float) -> tuple[Any, Any]:
    """With a fixed top the pressure decreases by a factor in each step of a slide."""
    fraction, slip, depth = size(rng, 0.01, 1.0), size(rng, 0.01, 0.3), size(rng, 1e-4, 0.02)
    law = laws.Worn(0.0, fraction / E)

    def solve(column: Column, reports: list[Any]) -> Iterator[str]:
        reports += column.rise(-depth)
        for number in range(1, 5):
            reports.append(column.slide(-slip, 1.0))
            expected = depth * E / (1.0 + fraction * slip) ** number
            yield from differs(f"pressure {number}", column.contact.pressure, expected, SOLVED)
            worn = depth * unit - expected * unit / E
            yield from differs(f"depth {number}", column.contact.memory["depth"], worn, SOLVED)

    return law, solve


def _layer(rng: np.random.Generator, unit: float, E: float) -> tuple[Any, Any]:
    """Column and layer share the overlap."""
    m, stiff, depth = rng.uniform(1.0, 3.0), size(rng, 0.1, 1e3), size(rng, 1e-4, 0.02)
    law = laws.SoftLayer(stiff * E * (1.0 / (0.01 * unit)) ** m, m)

    def solve(column: Column, reports: list[Any]) -> Iterator[str]:
        for part in (0.5, 1.0, 0.3):
            reports += column.rise(-part * depth)
            overlap = -column.contact.gap
            expected = E * (part * depth - overlap / unit)
            yield from differs("pressure of the column", column.contact.pressure, expected, SOLVED)
            yield from differs(
                "pressure of the layer", column.contact.pressure, law.k * overlap**m, SOLVED
            )

    return law, solve


def _bond(rng: np.random.Generator, unit: float, E: float) -> tuple[Any, Any]:
    """A cohesive zone in series with the column: loaded, unloaded along the secant, broken."""
    reach, strength = size(rng, 0.01, 0.1), rng.uniform(0.05, 0.7)
    strength *= E * reach  # below the strength at which the column would snap back
    law = laws.Cohesive(strength, reach * unit)
    first, second = np.sort(rng.uniform(0.3, 0.9, 2))

    def solve(column: Column, reports: list[Any]) -> Iterator[str]:
        def pulled(gap: float) -> float:
            return strength * (1.0 - gap / reach)

        largest = 0.0
        for part, back in ((first, 0.6), (second, 0.5)):
            largest = max(part * reach, largest)
            for gap, traction in (
                (largest, pulled(largest)),
                (back * largest, back * pulled(largest)),
                (largest, pulled(largest)),
            ):
                reports += column.rise(gap + traction / E)
                yield from differs("the gap", column.contact.gap, gap * unit, 1e3 * SOLVED)
                pressure = column.contact.pressure
                yield from differs("the traction", pressure, -traction, 1e3 * SOLVED)
        reports += column.rise(1.1 * reach)
        if np.abs(column.contact.pressure).max() > 0.0:
            yield "a broken bond bears a force"

    return law, solve


def _rate(rng: np.random.Generator, unit: float, E: float) -> tuple[Any, Any]:
    """Stribeck's coefficient is that of the rate at each node."""
    static, kinetic = np.sort(rng.uniform(0.1, 0.8, 2))[::-1]
    rate, viscous, depth = size(rng, 0.01, 1.0), rng.uniform(0.0, 0.2), size(rng, 1e-4, 0.01)
    law = laws.Stribeck(static, kinetic, rate * unit, viscous / unit)

    def solve(column: Column, reports: list[Any]) -> Iterator[str]:
        column.problem.time += 1.0
        reports += column.rise(-depth)
        for speed in rng.uniform(0.1, 3.0, 3) * rate:
            for _ in range(4):
                reports.append(column.slide(0.05, 0.05 / speed))
            contact = column.contact
            found = np.abs(contact.slip) / (0.05 / speed)
            limit = law.coefficient(found) * contact.pressure
            yield from differs("the shear", np.abs(contact.shear), limit, SOLVED)

    return law, solve


def _state(rng: np.random.Generator, unit: float, E: float) -> tuple[Any, Any]:
    """Steady sliding: the coefficient of the rate and the age L / v."""
    a, b = rng.uniform(0.02, 0.2, 2)
    L, v_0 = size(rng, 0.01, 0.1), size(rng, 1e-3, 0.1)
    law = laws.RateAndState(rng.uniform(0.3, 0.7), a, b, L * unit, v_0 * unit)
    speed, depth = v_0 * size(rng, 0.3, 5.0), size(rng, 1e-4, 0.01)

    def solve(column: Column, reports: list[Any]) -> Iterator[str]:
        column.problem.time += 1.0
        reports += column.rise(-depth)
        for _ in range(25):
            reports.append(column.slide(L, L / speed))
        contact = column.contact
        power = (law.mu + b * np.log(v_0 / speed)) / a
        coefficient = a * np.arcsinh(0.5 * speed / v_0 * np.exp(power))
        expected = coefficient * contact.pressure
        yield from differs("the shear", np.abs(contact.shear), expected, 1e-5)
        age = contact.memory["theta"][contact.pressure > 0.0]
        yield from differs("the age", age, L / speed, 1e-5)

    return law, solve


JUDGES: dict[str, Callable[[np.random.Generator, float, float], tuple[Any, Any]]] = {
    "wear": _wear,
    "layer": _layer,
    "bond": _bond,
    "rate": _rate,
    "state": _state,
}
