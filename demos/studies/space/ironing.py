# SPDX-License-Identifier: MIT
"""Ironing: a stiff cylindrical shell is pressed deep into a soft slab and drawn along it.

    python3 -m demos.studies.space.ironing
    python3 -m demos.studies.space.ironing 0.2 3

Slab of 9 x 4 x 3, E = 1; shell of radius 3 and thickness 0.2, E = 1000; both neo-Hookean with
nu = 0.3; pressed in by 1.4 and drawn by 4, after Puso & Laursen (2004). Half of both is meshed. All
options are the default ones.
"""

from __future__ import annotations

import sys
from time import process_time
from typing import NamedTuple

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_boxes import Box, block, mapped, mesh

LENGTH, HALF_WIDTH, HEIGHT = 9.0, 2.0, 3.0
RADIUS, SHELL, HALF_SHELL_WIDTH = 3.0, 0.2, 2.6
SOFT, STIFF, NU = 1.0, 1000.0, 0.3
# motion of the shell down and along, place of its lowest line at first
PRESS, DRAW, START = 1.4, 4.0, 3.0
STEP = 0.1


class Ironing(NamedTuple):
    """Forces on the whole shell, iterations and failures.

    Attributes:
        pressed: Normal force when it is pressed in [stress length^2].
        normal: Mean normal force over the second half of the way [stress length^2].
        tangential: Mean tangential force there [stress length^2].
        scatter: Standard deviation of their ratio [1].
        steps: Number of steps.
        iterations: Of all steps.
        cuts: Number of steps that failed and were cut.
        dofs: Number of unknowns.
    """

    pressed: float
    normal: float
    tangential: float
    scatter: float
    steps: int
    iterations: int
    cuts: int
    dofs: int


def iron(mu: float, fineness: int, *, way: float = PRESS + DRAW) -> Ironing:
    """The whole path, or its first part; ``fineness``: cells of the slab along a length of 1."""

    def bent(s: np.ndarray, t: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, ...]:
        angle, radius = np.pi / 2.0 * (2.0 * s - 1.0), RADIUS - SHELL * r
        x, z = START + radius * np.sin(angle), HEIGHT + RADIUS - radius * np.cos(angle)
        return x, HALF_SHELL_WIDTH * t, z

    n = fineness
    slab = block((9 * n, 2 * n, 3 * n), size=(LENGTH, HALF_WIDTH, HEIGHT))
    shell = mapped((8 * n, 2 * n, 1), bent)
    data = mesh([Box("slab", slab), Box("shell", shell)])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 3})
    psi = fm.energies.neo_hookean(u, *fm.energies.lame(1.0, NU))
    energy = SOFT * psi * dx(data.bodies["slab"]) + STIFF * psi * dx(data.bodies["shell"])
    edges, motion = ["shell/left", "shell/right"], fem.Constant(data.mesh, np.zeros(3))
    problem = fm.ContactProblem(
        ufl.derivative(energy, u, v), u,
        [fm.ContactPair(data, "slab/top", "shell/bottom", law=fm.Coulomb(mu))],
        bcs=[
            fm.dirichlet(V, data, "slab/bottom", np.zeros(3)),
            fm.dirichlet(V, data, edges, motion),
            fm.dirichlet(V, data, "slab/front", 0.0, 1),
            fm.dirichlet(V, data, "shell/front", 0.0, 1),
        ],
        petsc_options_prefix="ironing_",
    )  # fmt: skip
    rows = []

    def move(distance: float) -> None:
        motion.value[:] = max(distance - PRESS, 0.0), 0.0, -min(distance, PRESS)

    def keep(distance: float, _: object) -> None:
        rows.append((distance, *(-2.0 * problem.reaction(edges).force)))

    path = fm.follow_path(problem, move, fm.SteppingOptions(STEP), stop=way, on_step=keep)
    distance, along, _, down = np.transpose(rows)
    pressed = down[np.searchsorted(distance, min(PRESS, way) - 1e-9)]
    late = distance > min(PRESS + DRAW / 2.0, way - 1e-9)
    return Ironing(
        pressed, down[late].mean(), -along[late].mean(), (along / down)[late].std(),
        len(rows), sum(step.report.num_iterations for step in path.steps),
        sum(len(step.failures) for step in path.steps), V.dofmap.index_map.size_global * 3,
    )  # fmt: skip


if __name__ == "__main__":
    mus = [float(sys.argv[1])] if sys.argv[1:] else [0.0, 0.2]
    print("| mu | cells per length | unknowns | pressed N | drawn N | T / N | scatter | ", end="")
    print("steps | iterations | cuts | s |")
    print("|---:" * 11 + "|")
    for mu in mus:
        for fineness in map(int, sys.argv[2:] or (2, 3)):
            begin = process_time()
            f = iron(mu, fineness)
            forces = f"{f.pressed:.3f} | {f.normal:.3f} | {f.tangential / f.normal:.4f}"
            counts = f"{f.steps} | {f.iterations} | {f.cuts} | {process_time() - begin:.0f}"
            print(
                f"| {mu} | {fineness} | {f.dofs} | {forces} | {f.scatter:.4f} | {counts} |",
                flush=True,
            )
