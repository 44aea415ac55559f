# SPDX-License-Identifier: MIT
"""A half ball pressed on a block: seconds, iterations and memory, also of other codes.

    python3 -m demos.studies.space.waits 0.036 0.018 0.010
    python3 -m demos.studies.space.waits --solver iterative 0.018
    kratos/bin/python -m demos.studies.space.waits --peer kratos 0.036
    kratos/bin/python -m demos.studies.space.waits --peer kratos --solver iterative 0.036
    python3 -m demos.studies.space.waits --peer getfem 0.036

Both bodies are linear elastic, of the same material; the flat side of the ball is moved by a
fiftieth of its radius. Arguments are sizes of facets at the contact; each is measured in a process
of its own. Seconds are those of the processor, of the solve (with the model of another code) and of
the whole process, with imports, mesh and set-up. Force and largest pressure are computed from the
displacement alone: residuals of the bulk at the slave's nodes. How other codes are installed and
posed: ``demos/studies/accuracy/peer_*.py``.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from importlib import import_module
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.accuracy.peer import Given, given
from demos.studies.common import read_mesh
from meshes import half_ball_on_block

MATERIAL, DOWN = (1.0, 0.3), 0.02
HEAD = "code | unknowns | solve [s] | process [s] | iterations | MB | force | peak | solver"
COLUMNS = "|---|---:|---:|---:|---:|---:|---:|---:|---|"


def half_ball(h: float, **options: Any) -> fm.ContactProblem:
    """The problem with facets of size ``h``."""
    data = read_mesh(lambda: half_ball_on_block.build(h=h))
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    energy = fm.energies.linear_elastic(u, *fm.energies.lame(*MATERIAL))
    residual = ufl.derivative(
        energy * ufl.dx(metadata={"quadrature_degree": 1}), u, ufl.TestFunction(V)
    )
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "ball/top", (0.0, 0.0, -DOWN)))
    pair = fm.ContactPair(data, "ball/sphere", "block/top")
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="h1_", **options)


def arrays(problem: fm.ContactProblem) -> Given:
    """The same as arrays, for another code."""
    data = problem.contacts[0].pair.data
    ball = data.cell_tags.find(data.body_tag("ball"))
    return given(problem, ball, *MATERIAL, deformed=True)


def force_and_pressure(problem: fm.ContactProblem) -> tuple[float, float]:
    """Vertical force on the slave and largest pressure, of the present displacement."""
    bulk, slave = problem.equations.bulk, problem.equations.contacts[0].slave
    bulk.assemble_residual()
    forces = np.where(bulk.prescribed, 0.0, bulk.r.array_r).reshape(-1, 3)[slave.nodes]
    corners = slave.X[slave.facets]
    sides = corners[:, 1:] - corners[:, :1]
    thirds = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 6.0
    areas = np.bincount(slave.facets.ravel(), np.repeat(thirds, 3), slave.num_nodes)
    return abs(forces[:, 2].sum()), (np.linalg.norm(forces, axis=1) / areas).max()


def measure(h: float, solver: str, peer: str | None) -> str:
    """A row of the table."""
    problem = half_ball(h, solver=solver)
    size = problem.equations.bulk.r.getSize()
    name, start = peer or "fenics_mortar", time.process_time()
    if peer is None:
        report = problem.solve()
        iterations, by = report.num_iterations, report.solver
    else:
        posed = arrays(problem)
        start = time.process_time()
        pose = import_module(f"demos.studies.accuracy.peer_{peer}").pose
        try:
            answer = (pose(posed, solver) if solver != "auto" else pose(posed))(posed.values)
        except (RuntimeError, NotImplementedError) as error:
            return f"| {name} | {size} {6 * '| - '}| {error} |"
        problem.equations.bulk.u.x.array[:] = answer.u.ravel()
        iterations, by = answer.iterations, answer.solver
    end = time.process_time()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    force, pressure = force_and_pressure(problem)
    row = [name, size, f"{end - start:.2f}", f"{end:.1f}", iterations, f"{memory:.0f}"]
    return f"| {' | '.join(map(str, [*row, f'{force:.5g}', f'{pressure:.4g}', by]))} |"


def main() -> None:
    """Measure all sizes, each in its own process."""
    parser = argparse.ArgumentParser(description="A half ball pressed on a block.")
    parser.add_argument("sizes", nargs="+", type=float)
    parser.add_argument("--solver", default="auto")
    parser.add_argument("--peer", choices=("kratos", "getfem"))
    parser.add_argument("--row", action="store_true", help="print the row of one size only")
    options = parser.parse_args()
    if options.row:
        print(measure(options.sizes[0], options.solver, options.peer), flush=True)
        return
    print(f"| {HEAD} |\n{COLUMNS}", flush=True)
    module = [sys.executable, "-m", "demos.studies.space.waits", "--row"]
    given_options = ["--solver", options.solver]
    given_options += ["--peer", options.peer] if options.peer else []
    for size in options.sizes:
        done = subprocess.run([*module, *given_options, str(size)], capture_output=True, text=True)
        lines = [line for line in done.stdout.splitlines() if line.startswith("| ")]
        print(lines[-1] if lines else f"| failed: {done.stderr[-500:]} |", flush=True)


if __name__ == "__main__":
    main()
