# # Ironing with linear bulk: one factorization of K, or one in every iteration
#
# A round indenter is pressed into a block of the same linear elastic material and drawn along it,
# 0.8 facets per load step. Both methods solve the same steps alternately; the time of 100 steps is
# extrapolated from those of the slide. Times are CPU times of the busiest rank, which depend less
# on other work on the machine. The argument is the number of unknowns, 160 000 by default; with
# "direct" the general method uses factors instead of multigrid:
#
#     python3 -m demos.studies.performance.linear_bulk 40_000

# +
import resource
import sys
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, read_mesh
from meshes import indenter_on_block

comm = MPI.COMM_WORLD
sizes = [int(arg) for arg in sys.argv[1:] if arg[0].isdecimal()]
dofs = sizes[0] if sizes else 160_000
solver = "direct" if "direct" in sys.argv else "auto"
SLIDES = 10
# -


# +
def set_up(data, linear_bulk):
    """The problem, and the constant that moves the indenter."""
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    stress = linear_elastic(u, 100.0, 150.0)
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2})
    tool = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "block/bottom", np.zeros(2))]
    bcs += [fm.dirichlet(V, data, "indenter/top", tool)]
    pair = fm.ContactPair(data, slave="block/top", master="indenter/arc")
    problem = fm.ContactProblem(
        residual,
        u,
        [pair],
        bcs=bcs,
        petsc_options_prefix="bench_",
        solver=solver,
        linear_bulk=linear_bulk,
    )
    return problem, tool


def measure(problem, tool, displacement):
    """Seconds and iterations of a load step."""
    tool.value[:] = displacement
    start = time.process_time()
    report = problem.solve()
    return comm.allreduce(time.process_time() - start, MPI.MAX), report.num_iterations


def peak():
    """Peak memory so far [GB]."""
    return comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024**2


# -

# +
k = max(round(np.sqrt(dofs / 2616)), 1)
numbers = {"n_block": 60, "layers_block": 20, "n_indenter": 12, "layers_indenter": 9}
data = read_mesh(
    lambda: indenter_on_block.build(**{name: k * number for name, number in numbers.items()})
)
pressing = [(0.0, -0.2 - depth) for depth in (0.01, 0.03, 0.05)]
sliding = [(0.16 / k * step, -0.25) for step in range(1, SLIDES + 1)]
problems = [set_up(data, linear_bulk) for linear_bulk in (False, True)]
pressed = [[], []]
for which, (problem, tool) in enumerate(problems):
    pressed[which] = [measure(problem, tool, displacement) for displacement in pressing]
    pressed[which].append(peak())
slid = [[measure(*each, displacement) for each in problems] for displacement in sliding]

u, w = (problem.equations.bulk.u.x.array for problem, _ in problems)
difference = comm.allreduce(float(np.abs(u - w).max()), MPI.MAX)
size = problems[0][0].equations.bulk.V.dofmap.index_map.size_global * 2
if comm.rank == 0:
    print(f"{size} dofs, {comm.size} ranks; the two end {difference:.1e} apart\n")
    print("| path | to press [s] | iterations | a slide [s] | 100 slides [s] | peak [GiB] |")
    print("|---|---:|---:|---:|---:|---:|")
    totals = []
    for which, name in enumerate(("general", "factored once")):
        press = sum(seconds for seconds, _ in pressed[which][:-1])
        slide = np.median([step[which][0] for step in slid])
        count = np.mean([step[which][1] for step in slid])
        totals.append(press + 100 * slide)
        cells = [f"{press:.1f}", f"{count:.1f}", f"{slide:.3f}", f"{totals[-1]:.1f}"]
        print(f"| {name} | {' | '.join(cells)} | {pressed[which][-1]:.2f} |")
    print(f"\nfactored once is {totals[0] / totals[1]:.1f} times faster")
# -
