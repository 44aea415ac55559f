# # Hertz with small sliding and linear bulk, and the full model: what each costs
#
# A half cylinder is pressed on a block in ten steps; all but the model is the same. The full model
# is finite strain (a neo-Hookean law) with all of contact linearized; the cheap one is linear
# elastic with `sliding="small"`. The argument is about the number of unknowns. Seconds are those of
# the processor, medians of three runs, so that other work on the machine hardly counts:
#
#     python3 demos/bench_small_sliding.py 40_000

# +
import sys
import time
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

root = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(root), str(root / "meshes")]
import half_cylinder_on_block

import fenics_mortar as fm

comm = MPI.COMM_WORLD
dofs = int(sys.argv[1]) if len(sys.argv) > 1 else 40_000
REPEATS = 3
DEPTHS = np.linspace(0.001, 0.01, 10)
mu, lmbda = 76.9, 115.4
# -


# +
def small(u):
    """Stress of linear elasticity."""
    strain = ufl.sym(ufl.grad(u))
    return 2 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(2)


def finite(u):
    """First Piola-Kirchhoff stress of the neo-Hookean law."""
    F = ufl.Identity(2) + ufl.grad(u)
    inverse = ufl.inv(F).T
    return mu * (F - inverse) + lmbda * ufl.ln(ufl.det(F)) * inverse


def run(data, stress, **options):
    """Solve all steps; return displacement, force, seconds and iterations."""
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    residual = ufl.inner(stress(u), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2})
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
    """A mesh of about so many unknowns."""
    model = None
    if comm.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        size = np.sqrt(10_000 / dofs)
        model = half_cylinder_on_block.build(h=0.0125 * size, fine=0.2, growth=0.08 * size)
    data = fm.read_gmsh(model, comm)
    if comm.rank == 0:
        gmsh.finalize()
    return data


MODELS = {
    "full": (finite, {}),
    "linear bulk, finite sliding": (small, {}),
    "linear bulk, small sliding": (small, {"sliding": "small"}),
}
coarse, data = read(2_000), read(dofs)
runs = {name: [] for name in MODELS}
for number in range(REPEATS + 1):
    for name, (stress, options) in MODELS.items():  # the first, on a few cells, compiles
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
