# SPDX-License-Identifier: MIT
"""A sphere on a plane of the same material, pressed and then sheared (Mindlin).

    python3 -m demos.studies.space.mindlin

With a tangential force Q below mu F, the disc r < c of the contact r < a sticks, and the bodies
shift:

    c = a (1 - Q / (mu F))^(1/3),
    shift = 3 mu F (2 - nu) / (8 G a) [1 - (1 - Q / (mu F))^(2/3)]

(Johnson, 7.40 and 7.42; slip is assumed to be along Q, an error of a few per cent of the shift).
Half of both bodies is meshed. Displacements far away are those of point forces: that of Boussinesq,
and for Q that of Cerruti.

What friction could carry in excess of what it does, mu p - |q|, is a pressure of Hertz with the
radius c, mu p_0 / a (c^2 - r^2)^(1/2): its second moment gives c,

    c^2 = 5/2 sum d r^2 / sum d,    d = mu f_n - |f_t| at the nodes.

The area of the cells of the nodes that stick is known up to one row of nodes only.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from dolfinx import fem

import fenics_mortar as fm
from demos.studies.space.half_spaces import (
    E_STAR,
    KINDS,
    NU,
    OUTER,
    E,
    Kind,
    boussinesq,
    cerruti,
    elastic_residual,
    symmetry,
    two_boxes,
)

R, MU = 1000.0, 0.3
FORCE = 4.0 / 3.0 * E_STAR / R
SHARES = (0.3, 0.6, 0.9)
# numbers of cells along half a side, by degree
COUNTS = {1: (5, 7, 9, 12), 2: (3, 4, 6)}


def shift(share: float) -> float:
    """Relative displacement of points far away, for Q / (mu F)."""
    G = E / (2.0 * (1.0 + NU))
    return 3.0 * MU * FORCE * (2.0 - NU) / (8.0 * G) * (1.0 - (1.0 - share) ** (2.0 / 3.0))


class Step(NamedTuple):
    """Results beside those of the theory.

    Attributes:
        given: Q / (mu F) of the shift.
        found: The one that is computed.
        radius: c / a.
        expected: That of the theory for ``found``.
        by_area: c / a of a disc of the area of the cells of the nodes that stick.
        iterations: Newton iterations.
    """

    given: float
    found: float
    radius: float
    expected: float
    by_area: float
    iterations: int


def measure(kind: Kind, n: int) -> list[Step]:
    """Results for ``SHARES``."""
    sags = lambda x, y: (x**2 + y**2) / (2.0 * R), lambda x, y: 0.0 * x
    data = two_boxes(kind, n, sags, both=True)
    V = fm.vector_space(data.mesh, kind.degree)
    u, far = fem.Function(V), {"upper": fem.Function(V), "lower": fem.Function(V)}
    bcs = symmetry(V, data, list(far))
    for name, value in far.items():
        outside = [f"{name}/{side}" for side in ("left", "right", "back", OUTER[name])]
        bcs.append(fm.dirichlet(V, data, outside, value))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(MU))
    problem = fm.ContactProblem(
        elastic_residual(u, kind), u, [pair], bcs=bcs, petsc_options_prefix="mindlin_"
    )
    steps = []
    for share in (0.0, *SHARES):
        for name, side, motion in (("upper", 1.0, -1.0 / R), ("lower", -1.0, 0.0)):
            far[name].interpolate(partial(_far, share, side, motion))
        iterations = problem.solve().num_iterations
        if share > 0.0:
            steps.append(_step(problem.contacts[0], share, iterations))
    return steps


def _step(contact: fm.PairView, share: float, iterations: int) -> Step:
    """The results of a solved state."""
    force = 2.0 * contact.total_force
    found = abs(force[0]) / (MU * force[2])
    a = (0.75 * force[2] * R / E_STAR) ** (1.0 / 3.0)
    excess = MU * contact.forces[:, 2] - np.hypot(*contact.forces[:, :2].T)
    squares = np.square(contact.positions[:, :2]).sum(axis=1)
    radius = np.sqrt(2.5 * (excess @ squares) / excess.sum())
    weights = contact.forces[:, 2] / np.maximum(contact.pressure, 1e-9 * E)
    area = 2.0 * weights[contact.sticking].sum()
    expected = (1.0 - found) ** (1.0 / 3.0)
    return Step(share, found, radius / a, expected, np.sqrt(area / np.pi) / a, iterations)


def _far(share: float, side: float, motion: float, x: np.ndarray) -> np.ndarray:
    """Displacement far away; points of the upper body move by the shift along x too."""
    u = boussinesq(FORCE, side, motion, x) + cerruti(-side * share * MU * FORCE, side, x)
    u[0] += shift(share) if motion else 0.0
    return u


def table(kind: Kind) -> str:
    """Rows of all meshes and steps, and the rate of the root mean square of the errors of c."""
    lines = [
        f"{kind.name}, Q / (mu F) from the shift of the theory\n",
        "| n | Q / (mu F), theory | computed | c / a, theory for it | computed | error [%] | "
        "by area [%] | iterations |",
        "|---:" * 8 + "|",
    ]
    errors = []
    for n in COUNTS[kind.degree]:
        steps = measure(kind, n)
        for step in steps:
            radii = np.array([step.radius, step.by_area])
            error, by_area = 100.0 * (radii / step.expected - 1.0)
            lines.append(
                f"| {n} | {step.given} | {step.found:.4f} | {step.expected:.3f} | "
                f"{step.radius:.3f} | {error:.1f} | {by_area:.1f} | {step.iterations} |"
            )
        errors.append(root_mean_square(steps))
    rate = -np.polyfit(np.log(COUNTS[kind.degree]), np.log(errors), 1)[0]
    means = ", ".join(f"{100.0 * error:.1f} %" for error in errors)
    return "\n".join(lines) + f"\n\nRoot mean squares: {means}; rate {rate:.1f}.\n"


def root_mean_square(steps: list[Step]) -> float:
    """Of the relative errors of the radius c."""
    return float(np.sqrt(np.mean([(step.radius / step.expected - 1.0) ** 2 for step in steps])))


if __name__ == "__main__":
    for some in KINDS[:2]:
        print(table(some), flush=True)
