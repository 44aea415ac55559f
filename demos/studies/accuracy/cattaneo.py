# SPDX-License-Identifier: MIT
"""Shear of Cattaneo and Mindlin: errors and rates of elements and meshes, and two cylinders.

    python3 -m demos.studies.accuracy.cattaneo

Bodies of one material are pressed together and then sheared, Q < mu P. The middle |x| < c sticks,
the rest of the contact slides:

    c = a sqrt(1 - Q / (mu P)),    q = mu p0 (sqrt(1 - (x/a)^2) - (c/a) sqrt(1 - (x/c)^2)),

the second root within c only. The first table is for two half planes: boxes with the exact
displacement on their outer sides, so that all errors are those of the mesh. The shear has roots at
+-a and +-c: its error in L2 is of order h on uniform meshes for any element. With facets
proportional to the root of the distance from these points it decreases faster, with P2 about like
h^2.

The second table is of two half cylinders of radius 8, E = 200, nu = 0.3, mu = 0.2, with facets of
the second degree, refined alike. The flat sides do not rotate: they are moved until the
force is P, and the shear force along the contact, which rotates slightly, is Q = 0.468 mu P. P = 10
is the usual benchmark: a = 0.680778, c = 0.496511, peak of the shear 1.279571. The theory is for
half planes; its error decreases with the force, on a mesh scaled with a. As in ``cylinders``,
forces are per undeformed length.

The third table is for P = 10, pressed in one step without and with friction. In theory both are
equal, since equal bodies do not slip; ``contact.slip`` explains the difference.

Writes the tables and a picture to ``results/accuracy/cattaneo.md`` and ``.png``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.accuracy import cylinders
from demos.studies.accuracy.cylinders import MODULUS, NU, RADIUS, E
from demos.studies.accuracy.norms import errors
from demos.studies.accuracy.posed import Choice
from demos.studies.accuracy.scenes_exact import cattaneo
from demos.studies.common import linear_elastic
from fenics_mortar.contact.pair import Measure
from fenics_mortar.energies import lame

FRICTION, PART = 0.2, 0.468080  # Q over mu P
SIZES, LOADS, FACET = (32, 64, 128), (10.0, 2.5, 0.625), 0.15


def half_planes(n: int, element: str, *, graded: bool, **options: str) -> tuple[float, int]:
    """Error of the shear in L2, and number of iterations of the shear step."""
    posed = cattaneo(n, Choice(element), graded=graded, **options)
    report = posed.problem.solve()
    return errors(posed)["shear"], report.num_iterations


class Sheared(NamedTuple):
    """Two sheared cylinders, lengths over a and shears over mu p0.

    Attributes:
        x: Positions of the slave's nodes, shape (n,).
        length: Tributary length of each node, shape (n,).
        shear: Shear at the nodes, shape (n,).
        stuck: Sticking half-width.
    """

    x: np.ndarray
    length: np.ndarray
    shear: np.ndarray
    stuck: float

    @property
    def exact(self) -> np.ndarray:
        """The shear of the theory."""
        return theory(self.x)

    @property
    def error(self) -> float:
        """Error of the shear in L2."""
        off = self.length @ (self.shear - self.exact) ** 2
        return float(np.sqrt(off / (self.length @ self.exact**2)))


def theory(x: np.ndarray) -> np.ndarray:
    """Shear over mu p0 at x over a."""
    c2 = 1 - PART
    return np.sqrt(np.maximum(1 - x**2, 0.0)) - np.sqrt(np.maximum(c2 - x**2, 0.0))


def two_cylinders(
    force: float, h: float, *, has_friction: bool = False, slip: Measure = "partners"
) -> Sheared:
    """Press by ``force`` in one step and shear; ``h`` is the facet length over the half-width.

    ``has_friction``: with friction from the start, not only after the pressing.
    """
    degree = 2
    a = np.sqrt(4 * force * (RADIUS / 2) / (np.pi * MODULUS))
    data = cylinders.mesh(h * a, degree, a, (a, a * np.sqrt(1 - PART)))
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    stress = linear_elastic(u, *lame(E, NU))
    push = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "lower/flat", (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/flat", push),
    ]
    law, discretization = fm.Coulomb(FRICTION), fm.Discretization(slip=slip)
    pair = fm.ContactPair(data, "upper/arc", "lower/arc", law=law, discretization=discretization)
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="cattaneo_")
    (contact,) = problem.equations.contacts
    stiffness = np.pi * E / (4 * (1 - NU**2) * np.log(4 * RADIUS / a))  # approximately
    if not has_friction:
        pair.law = fm.Frictionless()
    move_until(problem, push, 1, -force / stiffness, force, lambda: contact.total_force[1])
    pair.law = fm.Coulomb(FRICTION)
    shear = PART * FRICTION * force
    move_until(problem, push, 0, shear / stiffness, shear, lambda: abs(contact.shear_force.sum()))
    length, peak = contact.slave.nodal_lengths, FRICTION * 2 * force / (np.pi * a)
    by_length = np.abs(contact.shear_force) / length
    stuck = length[contact.sticking].sum() / 2
    return Sheared(contact.slave.X[:, 0] / a, length / a, by_length / peak, stuck / a)


def move_until(
    problem: fm.ContactProblem,
    push: fem.Constant,
    component: int,
    guess: float,
    force: float,
    found: Callable[[], float],
) -> None:
    """Move the flat side until the force is as prescribed, by the secant method from one state."""
    start, before, last = problem.state(), 0.0, found()
    move = guess
    while abs(last / force - 1) > 1e-6:
        problem.restore(start)
        push.value[component] = move
        problem.solve()
        now = found()
        before, move = move, move + (force - now) * (move - before) / (now - last)
        last = now


def rate_table() -> str:
    """Errors of the shear of half planes, and rates by halves of h."""
    sizes = " | ".join(f"n = {n}" for n in SIZES)
    lines = [f"| element | mesh | {sizes} | rate |", "|---|---|" + "---:|" * (len(SIZES) + 1)]
    for element in ("P1", "P2"):
        for graded in (False, True):
            errors = [half_planes(n, element, graded=graded)[0] for n in SIZES]
            rate = -np.polyfit(np.log(SIZES), np.log(errors), 1)[0]
            cells = " | ".join(f"{100 * error:.2f} %" for error in errors)
            mesh = "graded" if graded else "uniform"
            lines.append(f"| {element} | {mesh} | {cells} | {rate:.2f} |")
    return "\n".join(lines)


def cylinder_table(all_sheared: dict[float, Sheared]) -> str:
    """Results of the cylinders over those of the theory."""
    lines = ["| P | a / R | half-width that sticks, c / a | peak | error in L2 |"]
    lines.append("|---:|" + "---:|" * 4)
    for force, found in all_sheared.items():
        a = np.sqrt(4 * force * (RADIUS / 2) / (np.pi * MODULUS))
        stuck, peak = found.stuck / np.sqrt(1 - PART), found.shear.max() / np.sqrt(PART)
        cells = f"{force:g} | {a / RADIUS:.3f} | {stuck:.4f} | {peak:.4f}"
        lines.append(f"| {cells} | {100 * found.error:.2f} % |")
    return "\n".join(lines)


def pressing_table() -> str:
    """Results after pressing without and with friction."""
    lines = ["| friction while pressed | slip by | error in L2 |", "|---|---|---:|"]
    for has_friction, slip in ((False, "partners"), (True, "partners"), (True, "operators")):
        found = two_cylinders(LOADS[0], FACET, has_friction=has_friction, slip=slip)
        lines.append(f"| {'yes' if has_friction else 'no'} | {slip} | {100 * found.error:.2f} % |")
    return "\n".join(lines)


def draw(found: Sheared) -> Figure:
    """Computed and theoretical shear of one pair of cylinders."""
    figure = Figure((6, 3.2), layout="constrained")
    axes = figure.add_subplot(xlabel="x / a", ylabel="traction / (mu p0)", xlim=(-1.3, 1.3))
    x = np.linspace(-1.3, 1.3, 2001)
    axes.plot(x, np.sqrt(np.maximum(1 - x**2, 0)), "k--", lw=1, label="mu times Hertz' pressure")
    axes.plot(x, theory(x), "k-", lw=1, label="Cattaneo and Mindlin")
    axes.plot(found.x, found.shear, "o", ms=3, color="#c8102e", label="computed shear")
    axes.legend(frameon=False)
    return figure


def main() -> None:
    folder = Path("results/accuracy")
    folder.mkdir(parents=True, exist_ok=True)
    found = {force: two_cylinders(force, FACET) for force in LOADS}
    tables = []
    for table in (rate_table, lambda: cylinder_table(found), pressing_table):
        tables.append(table())
        print(tables[-1] + "\n", flush=True)
    (folder / "cattaneo.md").write_text("\n\n".join(tables) + "\n")
    draw(found[LOADS[0]]).savefig(folder / "cattaneo.png", dpi=150)


if __name__ == "__main__":
    main()
