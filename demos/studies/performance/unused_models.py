# SPDX-License-Identifier: MIT
"""Cost of an iteration with thickness, memory, mass and contact with itself, and without them.

/usr/bin/python3 -m demos.studies.performance.unused_models

Two blocks of 1,100 unknowns, one frictionless pair, solved without any of these models and with a
trivial version of each: the thickness 1, a closing gap that is the gap, a density of 1e-12, and a
surface in contact with itself. Printed are Python calls of one Newton iteration, those among
them into the modules of the four models, CPU time of an iteration, median of several alternate
solves, and the difference of the displacements from those without models.
"""

import sys
import time
from functools import partial

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import neo_hookean
from demos.studies.performance.scene import read
from demos.studies.performance.trace_iteration import Trace
from meshes import two_blocks

MODULES = {
    "thickness": ("mesh/thickness",),
    "memory": ("contact/law_calls",),
    "mass": ("bulk/inertia", "path/dynamics", "path/time_steps"),
    "itself": ("interface/self_contact",),
}
DX = ufl.dx(metadata={"quadrature_degree": 3})
TIGHT = fm.NewtonOptions(residual_tolerance=1e-13)
REPEATS, DENSITY = 15, 1e-12


class PlainLayer(fm.Frictionless):
    """A closing gap that is the gap."""

    def closing_gap(self, node):
        """The gap, by complex step."""
        return fm.laws.row_of(lambda at: at.gap + 0.0, node)


def pose(model, data):
    """The problem, the constant that moves the top, and the function that solves a step.

    Args:
        model: One of ``MODULES``, or "" for none.
        data: The mesh.
    """
    V = fm.vector_space(data.mesh, 1)
    u, v, moved = fem.Function(V), ufl.TestFunction(V), fem.Constant(data.mesh, (0.0, 0.0))
    residual = ufl.inner(neo_hookean(u, 40.0, 60.0), ufl.grad(v)) * DX
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "upper/top", moved),
    ]
    sides = ["upper/bottom", "lower/top"]
    law = {"law": PlainLayer()} if model == "memory" else {}
    pair = fm.ContactPair(data, *([sides] if model == "itself" else sides), **law)
    options = {"thickness": 1.0} if model == "thickness" else {}
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, newton=TIGHT, petsc_options_prefix="unused_", **options
    )
    if model != "mass":
        return problem, moved, problem.solve
    motion = fm.Dynamics(problem, DENSITY, scheme="generalized_alpha", rho_inf=0.0)
    return problem, moved, partial(motion.step, 1.0)


def calls_of(model, data):
    """Python calls of an iteration, median, and those into modules of each model, largest."""
    problem, moved, step = pose(model, data)
    trace, advance = Trace(), problem.equations.advance

    def marked():
        trace.mark()
        return advance()

    problem.equations.advance = marked
    moved.value[1] = -0.03
    sys.setprofile(trace)
    step()
    sys.setprofile(None)
    trace.mark()
    rows = trace.rows[1:-1]
    into = {
        name: max(sum(n for f, n in row[2].items() if f.startswith(files)) for row in rows)
        for name, files in MODULES.items()
    }
    return int(np.median([row[0] for row in rows])), into


def milliseconds(model, data):
    """CPU time of an iteration [ms] in one solve, and the displacement."""
    problem, moved, step = pose(model, data)
    moved.value[1] = -0.03
    start = time.process_time()
    report = step()
    spent = 1e3 * (time.process_time() - start)
    return spent / report.num_iterations, problem.equations.bulk.u.x.array.copy()


def main():
    data = read(two_blocks.build, n_upper=20, n_lower=28)
    models = ["", *MODULES]
    for model in models:  # forms are compiled, kernels loaded
        milliseconds(model, data)
    runs = [[milliseconds(model, data) for model in models] for _ in range(REPEATS)]
    spent = np.array([[ms for ms, _ in run] for run in runs])
    plain = runs[0][0][1]
    names = " | ".join(f"into {name}" for name in MODULES)
    print(f"| model | calls | {names} | ms | over none | difference |")
    print("|---|" + "---:|" * (len(MODULES) + 4))
    for i, model in enumerate(models):
        calls, into = calls_of(model, data)
        ratio = float(np.median(spent[:, i] / spent[:, 0]))
        difference = np.abs(runs[0][i][1] - plain).max()
        cells = [model or "none", str(calls), *(str(n) for n in into.values())]
        cells += [f"{np.median(spent[:, i]):.2f}", f"{ratio:.2f}", f"{difference:.0e}"]
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
