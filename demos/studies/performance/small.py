# SPDX-License-Identifier: MIT
"""Small problems: an ironing run at 1,300 unknowns, and whole processes of the smallest Hertz.

    /usr/bin/python3 -m demos.studies.performance.small             the run, step by step
    /usr/bin/python3 -m demos.studies.performance.small path        the same by follow_path
    /usr/bin/python3 -m demos.studies.performance.small profile     and the most expensive functions
    /usr/bin/python3 -m demos.studies.performance.small process     imports, set-up, whole process

Frictionless neo-Hookean bodies; an indenter goes 0.5 mm down in 10 steps and 4 mm along in 40.
Times are CPU times, except for those of whole processes, from start to exit. Such a process reads a
``.msh`` file of a half disc on a block, sets up, and solves once, linear elastic.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

STEPS = 50
# Number of processes whose median is used.
PROCESSES = 7
# A program that imports dolfinx only, and one that records the time after each part.
EMPTY = "import dolfinx, dolfinx.fem.petsc"
PROGRAM = """
import time
import dolfinx, dolfinx.fem.petsc
marks = [time.perf_counter()]
from mpi4py import MPI
import ufl
from dolfinx import fem
import fenics_mortar as fm
marks.append(time.perf_counter())
data = fm.read_gmsh({path!r}, MPI.COMM_SELF)
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
energy = fm.energies.linear_elastic(u, 40.0, 60.0)
residual = ufl.derivative(energy * ufl.dx(metadata={{"quadrature_degree": 1}}), u, v)
top = fem.Constant(data.mesh, (0.0, -0.05))
bcs = [
    fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)),
    fm.dirichlet(V, data, "cylinder/top", top),
]
pair = fm.ContactPair(data, slave="cylinder/arc", master="block/top")
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="hertz_")
marks.append(time.perf_counter())
report = problem.solve()
marks.append(time.perf_counter())
print(u.x.array.size, report.num_iterations, *marks)
"""


def ironing(n_block=66, layers=8):
    """The problem with about 1,300 unknowns, and the constant that moves the indenter's top."""
    from mpi4py import MPI

    import ufl
    from dolfinx import fem

    import fenics_mortar as fm
    from demos.studies.common import neo_hookean
    from meshes import indenter_on_block
    from meshes.with_gmsh import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    model = indenter_on_block.build(
        n_block=n_block, layers_block=layers, n_indenter=8, layers_indenter=5, grading=3.0
    )
    data = fm.read_gmsh(model, MPI.COMM_SELF)
    gmsh.finalize()
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    metadata = {"quadrature_degree": 2}
    dx = ufl.Measure("dx", data.mesh, subdomain_data=data.cell_tags, metadata=metadata)
    work = ufl.inner(neo_hookean(u, 261.2, 464.3), ufl.grad(v))
    residual = work * dx(data.body_tag("block")) + 10.0 * work * dx(data.body_tag("indenter"))
    tool = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "indenter/top", tool),
    ]
    pair = fm.ContactPair(data, slave="block/top", master="indenter/arc")
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="ironing_"), tool


def load(tool, t):
    """Position of the indenter at a time 0 ... 1 [mm]."""
    tool.value[:] = 5.0 * max(t - 0.2, 0.0), -0.5 * min(t / 0.2, 1.0)


def run(problem, tool, *, path):
    """Solve all steps; return their reports."""
    import fenics_mortar as fm

    if path:
        options = fm.SteppingOptions(1.0 / STEPS)
        return [
            step.report for step in fm.follow_path(problem, lambda t: load(tool, t), options).steps
        ]
    reports = []
    for step in range(STEPS):
        load(tool, (step + 1) / STEPS)
        reports.append(problem.solve())
    return reports


def measure_run(*, path, profile):
    """Print iterations, seconds, milliseconds per iteration by phase, and the force."""
    import fenics_mortar.utils.clock as clock_module

    clock_module.time = SimpleNamespace(perf_counter=time.process_time)
    begin = time.process_time()
    problem, tool = ironing()
    setup = time.process_time() - begin
    if profile:
        import cProfile
        import pstats

        profiler = cProfile.Profile()
        profiler.enable()
    start = time.process_time()
    reports = run(problem, tool, path=path)
    seconds = time.process_time() - start
    if profile:
        profiler.disable()
        pstats.Stats(profiler).sort_stats("cumtime").print_stats(70)
        pstats.Stats(profiler).sort_stats("tottime").print_stats(45)
    iterations = sum(report.num_iterations for report in reports)
    phases = {}
    for report in reports:
        for name, value in report.total_seconds().items():
            phases[name] = phases.get(name, 0.0) + value
    size = problem.equations.bulk.u.x.array.size
    force = -problem.equations.contacts[0].total_force
    print(f"{size} unknowns, {len(reports)} steps, {iterations} iterations, set-up {setup:.2f} s")
    print(f"solve {seconds:.3f} s, {1e3 * seconds / iterations:.2f} ms per iteration, of which")
    each = {name: 1e3 * value / iterations for name, value in phases.items()}
    print("  " + ", ".join(f"{name} {value:.2f}" for name, value in each.items()))
    print(
        f"  (of all phases {sum(each.values()):.2f}; certificate, guess and the like are the rest)"
    )
    print(f"force {force[0]:.12g} {force[1]:.12g}")


def process(program):
    """Run a program in a new process; return the seconds from start to exit, and its output."""
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "", "OPENBLAS_NUM_THREADS": "1"}
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True, text=True, check=True, env=environment,
    )  # fmt: skip
    return time.perf_counter() - start, done.stdout


def measure_processes():
    """Print medians of whole processes, after one that fills the caches, as Python does."""
    from meshes import half_cylinder_on_block
    from meshes.with_gmsh import gmsh

    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "hertz.msh")
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        half_cylinder_on_block.build(h=0.025)
        gmsh.write(path)
        gmsh.finalize()
        program, rows = PROGRAM.format(path=path), []
        process(program)
        for _ in range(PROCESSES):
            empty, _ = process(EMPTY)
            whole, output = process(program)
            size, iterations, *marks = map(float, output.split())
            rows.append([empty, *np.diff(marks), whole, whole - empty])
    names = "import of dolfinx alone", "import", "read and set up", "solve", "all", "difference"
    print(f"{size:.0f} unknowns, {iterations:.0f} iterations, medians of {PROCESSES} processes [s]")
    for name, value in zip(names, np.median(rows, axis=0)):
        print(f"  {name}: {value:.3f}")


if __name__ == "__main__":
    if "process" in sys.argv:
        measure_processes()
    else:
        measure_run(path="path" in sys.argv, profile="profile" in sys.argv)
