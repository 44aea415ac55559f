# # Cost of Hertz with small sliding and linear bulk, and with the full model
#
# A half cylinder is pressed on a block in ten steps; everything except the model is equal. The full
# model is finite strain (a neo-Hookean law) with all of contact linearized; the cheap one is linear
# elastic with `sliding="small"`. The argument is the approximate number of unknowns. Seconds are
# CPU times, medians of three runs, so that other work on the machine has little effect:
#
#     python3 -m demos.studies.performance.small_sliding 40_000

# +
import sys
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, neo_hookean, read_mesh
from meshes import half_cylinder_on_block

comm = MPI.COMM_WORLD
dofs = int(sys.argv[1]) if len(sys.argv) > 1 else 40_000
REPEATS = 3
DEPTHS = np.linspace(0.001, 0.01, 10)
LAME = 76.9, 115.4  # mu and lambda [stress]
# -


# +
def run(data, stress, **options):
    """Solve all steps; return displacement, force, seconds and iterations."""
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    residual = ufl.inner(stress(u, *LAME), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2})
    push = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "block/bottom", np.zeros(2))]
    bcs += [fm.dirichlet(V, data, "cylinder/top", push)]
    pair = fm.ContactPair(data, "cylinder/arc", "block/top", **options)
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="bench_")
    seconds, iterations = [], []
    for depth in DEPTHS:
        push.value[1] = -depth
        comm.barrier()
        start = time.process_time()
        iterations.append(problem.solve().num_iterations)
        seconds.append(time.process_time() - start)
    return u.x.array.copy(), problem, np.array(seconds), iterations


# -


# +
def read(dofs):
    """A mesh with about ``dofs`` unknowns."""
    size = np.sqrt(10_000 / dofs)
    options = {"h": 0.0125 * size, "fine": 0.2, "growth": 0.08 * size}
    return read_mesh(lambda: half_cylinder_on_block.build(**options))


MODELS = {
    "full": (neo_hookean, {}),
    "linear bulk, finite sliding": (linear_elastic, {}),
    "linear bulk, small sliding": (linear_elastic, {"sliding": "small"}),
}
coarse, data = read(2_000), read(dofs)
runs = {name: [] for name in MODELS}
for number in range(REPEATS + 1):
    for name, (stress, options) in MODELS.items():  # the first run, on a few cells, compiles
        result = run(data if number else coarse, stress, **options)
        runs[name] = [*runs[name], result] if number else []
# -

# +
u, problem, *_ = runs["full"][0]
if comm.rank == 0:
    size, active = problem.equations.bulk.r.getSize(), problem.equations.contacts[0].active
    print(f"{size} dofs, {active.sum()} of {len(active)} nodes active")
    print("| model | first step [s] | all steps [s] | iterations | faster | force | off |")
    print("|---|---:|---:|---:|---:|---:|---:|")
seconds = {name: np.median([run[2] for run in found], axis=0) for name, found in runs.items()}
full = seconds["full"]
for name, found in runs.items():
    w, other, _, iterations = found[0]
    mine = seconds[name]
    off = np.linalg.norm(w - u) / np.linalg.norm(u)
    force = other.equations.contacts[0].total_force[1]
    if comm.rank == 0:
        cells = [f"{mine[0]:.2f}", f"{mine.sum():.2f}", f"{sum(iterations)}"]
        cells += [f"{full[0] / mine[0]:.1f}, {full.sum() / mine.sum():.1f}"]
        print(f"| {name} | {' | '.join([*cells, f'{force:.5f}', f'{100 * off:.2f} %'])} |")
# -
