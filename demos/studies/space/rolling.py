# SPDX-License-Identifier: MIT
"""A ball rolls between two plates of the same material.

    python3 -m demos.studies.space.rolling

The plates approach by the squeeze d each, so that the contacts have the radius a = sqrt(R d)
(Hertz), and the upper one moves along x. Nothing else holds the ball, of which half is meshed.
Since strains of equal bodies are equal in the contact, the ball rolls without creep, up to terms of
order (a / R)^2, whatever the coefficient of friction mu > 0; friction does no work, but for a
little at the edge of the contact, and no force is needed (Johnson, Contact Mechanics, chapter 8).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_boxes import Box, mapped, mesh

# radius of the ball, Poisson's ratio, width and thickness of the plates in contact radii
R, NU, WIDTH, THICKNESS = 1.0, 0.3, 12.0, 6.0
STEPS, TRAVEL = 8, 0.84


class Rolling(NamedTuple):
    """Measures after a way of the ball.

    Attributes:
        creep: Way of the ball over angle and radius, less 1 [1].
        pull: Tangential force over the normal one [1].
        work: Work of friction over mu N times the way of the plate [1].
        radius: Contact radius of Hertz for the normal force [length].
        iterations: Newton iterations of the steps.
    """

    creep: float
    pull: float
    work: float
    radius: float
    iterations: list[int]


def graded(s: np.ndarray, share: float) -> np.ndarray:
    """Odd map of [-1, 1] to itself whose slope at 0 is ``share``."""
    return share * s + (1.0 - share) * s**5


def ball(n: int, squeeze: float) -> Box:
    """Half of the ball, n cells across; at the poles their length is 4 a / n for any squeeze."""
    share = 2.5 * np.sqrt(squeeze)

    def position(s: np.ndarray, t: np.ndarray, r: np.ndarray) -> list[np.ndarray]:
        x, y = (np.tan(np.pi / 4.0 * graded(q, share)) for q in (2.0 * s - 1.0, t))
        z = 2.0 * r - 1.0
        cube = np.stack([x, y, z * (1.5 - 0.5 * z**2)])
        far, distance = np.abs(cube).max(axis=0), np.linalg.norm(cube, axis=0)
        to_ball = far / np.maximum(distance, 1e-12)
        return list(R * cube * (0.75 - 0.75 * far**2 + far**2 * to_ball))

    return Box("ball", mapped((n, n // 2, n), position))


def plate(name: str, side: float, n: int, squeeze: float) -> Box:
    """Half of a plate on the ``side`` +1 or -1 of the ball, with finer cells at the contact."""
    a = np.sqrt(R * squeeze)

    def position(s: np.ndarray, t: np.ndarray, r: np.ndarray) -> list[np.ndarray]:
        x, y = (0.5 * WIDTH * a * graded(q, 0.45) for q in (2.0 * s - 1.0, t))
        depth = r if side > 0.0 else 1.0 - r
        return [x, y, side * (R + THICKNESS * a * (0.4 * depth + 0.6 * depth**3))]

    return Box(name, mapped((3 * n // 2, 3 * n // 4, n // 2), position))


def roll(n: int, squeeze: float, mu: float, steps: int = STEPS) -> Rolling:
    """Press the plates, and move the upper one by ``steps`` steps of ``TRAVEL`` a / 8."""
    boxes = [ball(n, squeeze), plate("lower", -1.0, n, squeeze), plate("upper", 1.0, n, squeeze)]
    data = mesh(boxes)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    psi = fm.energies.neo_hookean(u, *fm.energies.lame(1.0, NU))
    lower, upper = (fem.Constant(data.mesh, np.zeros(3)) for _ in range(2))
    problem = fm.ContactProblem(
        ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 3}), u, v), u,
        [
            fm.ContactPair(data, *sides, law=fm.Coulomb(mu))
            for sides in (("ball/bottom", "lower/top"), ("ball/top", "upper/bottom"))
        ],
        bcs=[
            fm.dirichlet(V, data, [f"{box.name}/front" for box in boxes], 0.0, 1),
            fm.dirichlet(V, data, "lower/bottom", lower),
            fm.dirichlet(V, data, "upper/top", upper),
        ],
        petsc_options_prefix="rolling_",
    )  # fmt: skip
    below, above = problem.contacts
    for part in (1.0 / 3.0, 2.0 / 3.0, 1.0):
        lower.value[2], upper.value[2] = part * squeeze, -part * squeeze
        problem.solve()
    force = 2.0 * below.total_force[2]
    radius = float((1.5 * force * R * (1.0 - NU**2)) ** (1.0 / 3.0))
    work, iterations = 0.0, []
    for step in range(1, steps + 1):
        upper.value[0] = TRAVEL * np.sqrt(R * squeeze) * step / STEPS
        iterations.append(problem.solve().num_iterations)
        work += 2.0 * (below.friction_work + above.friction_work)
    way, angle = motion_of_core(u)
    pull = above.total_force[0] / abs(above.total_force[2])
    work /= mu * force * upper.value[0]
    return Rolling(way / (R * angle) - 1.0, pull, work, radius, iterations)


def motion_of_core(u: fem.Function) -> tuple[float, float]:
    """Mean way along x and mean angle of the nodes in the middle half of the ball, on one rank."""
    X = u.function_space.tabulate_dof_coordinates()
    core = np.linalg.norm(X, axis=1) < 0.5 * R
    X, moved = X[core], u.x.array.reshape(-1, 3)[core]
    way = moved.mean(axis=0)[0]
    x = X + moved - moved.mean(axis=0)
    sine, cosine = x[:, 0] @ X[:, 2] - x[:, 2] @ X[:, 0], x[:, 0] @ X[:, 0] + x[:, 2] @ X[:, 2]
    return float(way), float(np.arctan2(sine, cosine))


if __name__ == "__main__":
    print("| n | mu | a / R | creep [%] | force / N | work / (mu N way) | iterations |")
    print("|---:" * 6 + "|---|")
    for n, squeeze, mu in (
        (12, 0.02, 0.3), (12, 0.02, 0.05), (16, 0.02, 0.3), (12, 0.01, 0.3), (12, 0.005, 0.3),
    ):  # fmt: skip
        found = roll(n, squeeze, mu)
        row = f"{100.0 * found.creep:.3f} | {found.pull:.1e} | {found.work:.1e}"
        print(f"| {n} | {mu} | {found.radius / R:.3f} | {row} | {found.iterations} |", flush=True)
