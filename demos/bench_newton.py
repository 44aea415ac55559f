# # What a Newton iteration costs, phase by phase
#
# Two neo-Hookean blocks, the upper pressed on the lower and slid along it by half a facet per load
# step, so that most steps have a contact pattern of their own. All work of a load step counts: the
# evaluations, the certificate, everything in Python. Sizes are numbers of unknowns:
#
#     python3 demos/bench_newton.py                     10k, 40k, 160k
#     python3 demos/bench_newton.py iterative           the same by multigrid
#     mpirun -n 2 python3 demos/bench_newton.py 640_000 1_000_000
#
# Numbers are medians over the load steps, of the slowest rank in each phase. Memory is the peak of
# the process so far, of all ranks together: give sizes in ascending order.

# +
import resource
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
import two_blocks

import fenics_mortar as fm

comm = MPI.COMM_WORLD
STEPS = 5
CONTACT = ("search", "integrals", "assembly")
SOLVER = "iterative" if "iterative" in sys.argv[1:] else "direct"
# -


# +
def set_up(dofs):
    """The problem with about so many unknowns, the length of a slave facet, what moves the top."""
    k = round(np.sqrt(dofs / 6))  # facets of the upper block: its side is 1, the lower 2.2 x 1
    model = None
    if comm.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        model = two_blocks.build(n_upper=k, n_lower=2 * k, layers_upper=k, layers_lower=k)
    data = fm.read_gmsh(model, comm)
    if comm.rank == 0:
        gmsh.finalize()
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.Identity(2) + ufl.grad(u)
    P = 40.0 * (F - ufl.inv(F).T) + 60.0 * ufl.ln(ufl.det(F)) * ufl.inv(F).T
    residual = ufl.inner(P, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 3})
    top = fem.Constant(data.mesh, (0.0, -0.01))
    bcs = [fm.dirichlet(V, data, "lower/bottom", np.zeros(2))]
    bcs += [fm.dirichlet(V, data, "upper/top", top)]
    pair = fm.ContactPair(data, slave="upper/bottom", master="lower/top")
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="bench_", solver=SOLVER
    )
    return problem, 1.0 / k, top


def measure(dofs):
    """Dofs, iterations of a load step, and seconds per Newton iteration by phase."""
    problem, facet, top = set_up(dofs)
    problem.solve()
    iterations, costs = [], []
    for _ in range(STEPS):
        top.value[0] += 0.5 * facet
        comm.barrier()
        start = time.perf_counter()
        report = problem.solve()
        whole = time.perf_counter() - start
        seconds = report.total_seconds()
        seconds["other"] += whole - sum(seconds.values())
        iterations.append(report.num_iterations)
        costs.append(np.array([*seconds.values(), whole]) / report.num_iterations)
    size = problem.bulk.V.dofmap.index_map.size_global * 2
    return size, np.median(iterations), dict(zip([*seconds, "all"], np.median(costs, axis=0)))


def peak():
    """Gigabytes."""
    return comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024**2


# -

# +
sizes, costs = [], []
for dofs in [int(arg) for arg in sys.argv[1:] if arg != SOLVER] or [10_000, 40_000, 160_000]:
    size, iterations, cost = measure(dofs)
    sizes.append(size)
    costs.append(cost)
    contact = sum(cost[phase] for phase in CONTACT)
    row = [str(size), f"{iterations:.0f}", *(f"{1e3 * cost[phase]:.2f}" for phase in cost)]
    row += [f"{100 * contact / cost['all']:.1f}", f"{peak():.2f}"]
    if comm.rank == 0:
        if len(sizes) == 1:
            print(f"ms per Newton iteration, {SOLVER}, {comm.size} rank{'s' * (comm.size > 1)}\n")
            titles = ["dofs", "iterations", *cost, "contact [%]", "peak [GiB]"]
            print("| " + " | ".join(titles) + " |")
            print("|" + "---:|" * (len(cost) + 4))
        print("| " + " | ".join(row) + " |", flush=True)
if len(sizes) > 1 and comm.rank == 0:
    growth = [np.polyfit(np.log(sizes), np.log([c[phase] for c in costs]), 1)[0] for phase in cost]
    print("| growth | | " + " | ".join(f"{g:.2f}" for g in growth) + " | | |")
# -
