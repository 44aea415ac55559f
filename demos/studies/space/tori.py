# SPDX-License-Identifier: MIT
"""Two hollow tori collide without friction: momentum, angular momentum and energy.

    python3 -m demos.studies.space.tori
    python3 -m demos.studies.space.tori 48

Neo-Hookean, E = 2250, nu = 0.3, density 0.1; radii 76 and 24, thickness 4.5. The upper torus is
tilted by 45 degrees and flies down with the velocity 30, onto one side of the lower one. Nothing
holds them. Scenes of this kind are in Puso & Laursen (2004) and Popp, Gitterle, Gee & Wall (2010).
"""

from __future__ import annotations

import sys
from time import process_time
from typing import NamedTuple

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm

E, NU, DENSITY = 2250.0, 0.3, 0.1
MAJOR, MINOR, WALL = 76.0, 24.0, 4.5
# height of the upper centre, which leaves a distance of 2; velocity
HEIGHT, SPEED = 98.3, 30.0
STEP = 0.05


class Impact(NamedTuple):
    """Changes from the start, of all steps.

    Attributes:
        momentum: Largest change of momentum over the momentum [1].
        spin: Largest change of the angular momentum over momentum and height [1].
        energy: Largest change of the energy over the energy [1].
        strain: Largest strain energy over the energy [1].
        touched: Largest number of nodes in contact at once.
        apart: Whether there is no contact in the end.
        iterations: Newton iterations of all steps.
        steps: Number of steps.
    """

    momentum: float
    spin: float
    energy: float
    strain: float
    touched: int
    apart: bool
    iterations: int
    steps: int


def torus(
    around: int, across: int, turn: np.ndarray, centre: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, cells and facets of the outer side, of one layer of hexahedra; see the arguments.

    Args:
        around: Cells along the large circle.
        across: Cells along the small one.
        turn: Rotation, (3, 3).
        centre: The centre [length].
    """
    i, j, k = np.meshgrid(np.arange(around), np.arange(across), np.arange(2), indexing="ij")
    phi, theta = 2.0 * np.pi * i / around, 2.0 * np.pi * j / across
    radius = MINOR - WALL * (1 - k)
    out = MAJOR + radius * np.cos(theta)
    x = np.stack([out * np.cos(phi), out * np.sin(phi), radius * np.sin(theta)], axis=-1)

    def number(di: int, dj: int, k: int) -> np.ndarray:
        a, b = np.meshgrid(np.arange(around) + di, np.arange(across) + dj, indexing="ij")
        return (((a % around) * across + b % across) * 2 + k).ravel()

    cycle = (0, 0), (1, 0), (1, 1), (0, 1)
    inner, outer = (np.stack([number(*at, k) for at in cycle], axis=1) for k in (0, 1))
    return x.reshape(-1, 3) @ turn.T + centre, np.hstack([inner, outer]), outer


def collide(around: int, until: float) -> Impact:
    """The collision to the time ``until``; ``around`` cells along the large circle."""
    c = np.sqrt(0.5)
    tilt = np.array([[c, 0.0, c], [0.0, 1.0, 0.0], [-c, 0.0, c]])
    tori = [
        torus(around, around // 3, turn, centre)
        for turn, centre in ((tilt, (0.0, 0.0, HEIGHT)), (np.eye(3), (0.0, 0.0, 0.0)))
    ]
    points, count = len(tori[0][0]), len(tori[0][1])
    (x, cells, upper), (x_2, cells_2, lower) = tori
    data = fm.mesh_from_arrays(
        np.concatenate([x, x_2]), np.concatenate([cells, cells_2 + points]),
        bodies={"upper": np.arange(count), "lower": count + np.arange(count)},
        boundaries={"upper/outside": upper, "lower/outside": lower + points},
    )  # fmt: skip
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = fm.energies.neo_hookean(u, *fm.energies.lame(E, NU))
    energy *= ufl.dx(metadata={"quadrature_degree": 3})
    problem = fm.ContactProblem(
        ufl.derivative(energy, u, v), u, [fm.ContactPair(data, "upper/outside", "lower/outside")],
        petsc_options_prefix="tori_",
    )  # fmt: skip
    motion = fm.Dynamics(problem, density=DENSITY, energy=energy)
    flying = data.cell_tags.find(data.bodies["upper"])
    motion.velocity.interpolate(lambda x: np.outer((0.0, 0.0, -SPEED), np.ones(x.shape[1])), flying)
    before, momenta, touched = motion.momentum(), [], []

    def note(*_: object) -> None:
        momenta.append(motion.momentum() - before)
        touched.append(int(problem.contacts[0].active.sum()))

    record = motion.run(until, fm.SteppingOptions(step=STEP), on_step=note)
    start, size = record.start.total, np.linalg.norm(before[:3])
    totals, strains = np.transpose([[s.energies.total, s.energies.strain] for s in record.steps])
    change = np.abs(momenta).max(axis=0)
    return Impact(
        change[:3].max() / size, change[3:].max() / (size * HEIGHT),
        np.abs(totals - start).max() / start, strains.max() / start,
        max(touched), touched[-1] == 0,
        sum(step.report.num_iterations for step in record.steps), len(record.steps),
    )  # fmt: skip


if __name__ == "__main__":
    print("| cells around | momentum | angular momentum | energy | strain energy |", end=" ")
    print("nodes in contact | apart | steps | iterations | s |")
    print("|---:" * 10 + "|")
    for around in map(int, sys.argv[1:] or (24, 36)):
        begin = process_time()
        found = collide(around, 8.0)
        row = " | ".join(f"{value:.1e}" for value in found[:3])
        print(
            f"| {around} | {row} | {found.strain:.2f} | {found.touched} | {found.apart} | "
            f"{found.steps} | {found.iterations} | {process_time() - begin:.0f} |",
            flush=True,
        )
