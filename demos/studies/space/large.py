# SPDX-License-Identifier: MIT
"""A half ball pressed on a block up to a million unknowns: what contact costs beside the bulk.

    python3 -m demos.studies.space.large 0.024
    mpirun -n 2 python3 -m demos.studies.space.large 0.0062

Both bodies are neo-Hookean tetrahedra; the flat side of the ball is moved by a fiftieth of its
radius. Arguments are sizes of facets at the contact. "Bare" are the same bodies without a contact
pair, under a body force, with the same multigrid. Seconds of a Newton iteration are those of the
processor, of the busiest rank, with patterns and set-up of multigrid; "integrals" and "assembly"
are shares of contact in them; "linear" are iterations of a solve with nodes in contact. Memory is
the peak of each rank, with reading the mesh, which rank 0 makes.
"""

from __future__ import annotations

import argparse
import resource
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import neo_hookean, read_mesh
from meshes import half_ball_on_block

comm = MPI.COMM_WORLD
LAME, DOWN, FORCE, COARSE = (0.4, 0.6), 0.02, 0.1, 0.08
HEAD = (
    "ranks | unknowns | iterations | linear in each | for 8 digits | s in each | bare | ratio "
    "| integrals [%] | assembly [%] | GiB"
)


def pressed(data: fm.MeshData, contact: bool) -> fm.ContactProblem:
    """The problem, or the bare bodies under a body force."""
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 1})
    residual = ufl.inner(neo_hookean(u, *LAME), ufl.grad(v)) * dx
    if not contact:
        residual -= FORCE * v[2] * dx
    top = (0.0, 0.0, -DOWN if contact else 0.0)
    bcs = [
        fm.dirichlet(V, data, "block/bottom", (0.0, 0.0, 0.0)),
        fm.dirichlet(V, data, "ball/top", top),
    ]
    pairs = [fm.ContactPair(data, "ball/sphere", "block/top")] if contact else []
    options = {"petsc_options_prefix": "large_", "solver": "iterative"}
    return fm.ContactProblem(residual, u, pairs, bcs=bcs, **options)


def solve(problem: fm.ContactProblem) -> tuple[fm.NewtonReport, float]:
    """The report and the seconds of an iteration, of the processor of the busiest rank.

    Without the points of the form, which UFL finds once, whatever the number of cells.
    """
    _ = problem.equations.bulk.form_points
    start = time.process_time()
    report = problem.solve()
    spent = comm.allreduce(time.process_time() - start, MPI.MAX)
    return report, spent / report.num_iterations


def row(h: float) -> str:
    """A row of the table."""
    data = read_mesh(lambda: half_ball_on_block.build(h=h))
    _, bare = solve(pressed(data, contact=False))
    problem, norms = pressed(data, contact=True), []
    problem.equations.system.ksp.setMonitor(lambda ksp, *at: norms.append(at))
    report, seconds = solve(problem)
    number, norm = np.array(norms).T
    (first,) = np.nonzero(number == 0)
    last = np.append(first[1:], number.size) - 1
    several = number[last] > 1  # without contact, conjugate gradients inside are one iteration
    first, last = first[several], last[several]
    linear = number[last].sum()
    digits = np.log10(norm[first] / norm[last]).sum()
    memory = comm.allgather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2)
    phases = report.total_seconds()
    shares = [100 * phases[name] / sum(phases.values()) for name in ("integrals", "assembly")]
    cells = [comm.size, f"{problem.equations.bulk.r.getSize():,}", report.num_iterations]
    cells += [f"{linear / len(last):.1f}", f"{8 * linear / digits:.1f}"]
    cells += [f"{value:.2f}" for value in (seconds, bare, seconds / bare)]
    cells += [f"{share:.1f}" for share in shares]
    cells.append(" + ".join(f"{peak:.2f}" for peak in memory))
    return f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    """Measure all sizes."""
    parser = argparse.ArgumentParser(description="A half ball pressed on a block, on ranks.")
    parser.add_argument("sizes", nargs="+", type=float)
    sizes = parser.parse_args().sizes
    if comm.rank == 0:
        print(f"| {HEAD} |\n|{'---:|' * HEAD.count('|')}---:|", flush=True)
    row(COARSE)  # loads forms and kernels
    for h in sizes:
        line = row(h)
        if comm.rank == 0:
            print(line, flush=True)


if __name__ == "__main__":
    main()
