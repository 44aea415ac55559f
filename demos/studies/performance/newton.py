# # Cost of a Newton iteration by phases
#
# Two neo-Hookean blocks, the upper pressed on the lower and slid along it by half a facet per load
# step, so that the contact pattern changes in most steps. All work of a load step is included:
# evaluations, certificate, everything in Python. Sizes are numbers of unknowns:
#
#     python3 -m demos.studies.performance.newton                     10k, 40k, 160k
#     python3 -m demos.studies.performance.newton iterative           the same by multigrid
#     python3 -m demos.studies.performance.newton direct iterative    both, and results/growth.png
#     python3 -m demos.studies.performance.newton iterative saddle    multipliers are unknowns
#     mpirun -n 2 python3 -m demos.studies.performance.newton 640_000 1_000_000
#
# Numbers are medians over the load steps, of the slowest rank in each phase. CPU time is that of
# the busiest rank, which depends less on other work on the machine. Memory is the peak so far of
# all ranks together: pass sizes in ascending order.

# +
import resource
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

from demos.studies.performance.scene import comm, size_of, two_pressed_blocks

STEPS = 5
CONTACT = ("search", "integrals", "assembly")
SOLVERS = [solver for solver in ("direct", "iterative") if solver in sys.argv] or ["direct"]
ALGORITHM = "saddle" if "saddle" in sys.argv else "condensed"
SIZES = [int(arg) for arg in sys.argv[1:] if arg[0].isdecimal()] or [10_000, 40_000, 160_000]
# -


# +
def measure(dofs, solver):
    """Dofs, iterations of a load step, and seconds per Newton iteration by phase."""
    problem, facet, top = two_pressed_blocks(dofs, solver=solver, algorithm=ALGORITHM)
    problem.solve()
    iterations, costs = [], []
    for _ in range(STEPS):
        top.value[0] += 0.5 * facet
        comm.barrier()
        start, busy = time.perf_counter(), time.process_time()
        report = problem.solve()
        whole, busy = time.perf_counter() - start, time.process_time() - busy
        seconds = report.total_seconds()
        seconds["other"] += whole - sum(seconds.values())
        iterations.append(report.num_iterations)
        costs.append(
            np.array([*seconds.values(), whole, comm.allreduce(busy, MPI.MAX)])
            / report.num_iterations
        )
    return (
        size_of(problem),
        np.median(iterations),
        dict(zip([*seconds, "all", "CPU"], np.median(costs, axis=0), strict=True)),
    )


def peak():
    """Gigabytes."""
    return comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024**2


# -


# +
def growth(sizes, seconds):
    """Exponent of the best fit by a power of the size."""
    return np.polyfit(np.log(sizes), np.log(seconds), 1)[0]


def report(solver):
    """Print a table; return sizes and CPU seconds."""
    sizes, costs = [], []
    for dofs in SIZES:
        size, iterations, cost = measure(dofs, solver)
        sizes.append(size)
        costs.append(cost)
        contact = sum(cost[phase] for phase in CONTACT)
        row = [str(size), f"{iterations:.0f}", *(f"{1e3 * cost[phase]:.2f}" for phase in cost)]
        row += [f"{100 * contact / cost['all']:.1f}", f"{peak():.2f}"]
        if comm.rank == 0:
            if len(sizes) == 1:
                ranks = f"{comm.size} rank{'s' * (comm.size > 1)}"
                print(f"\nms per Newton iteration, {ALGORITHM}, {solver}, {ranks}\n")
                titles = ["dofs", "iterations", *cost, "contact [%]", "peak [GiB]"]
                print("| " + " | ".join(titles) + " |")
                print("|" + "---:|" * (len(cost) + 4))
            print("| " + " | ".join(row) + " |", flush=True)
    if len(sizes) > 1 and comm.rank == 0:
        exponents = [f"{growth(sizes, [c[phase] for c in costs]):.2f}" for phase in cost]
        print("| growth | | " + " | ".join(exponents) + " | | |")
    return sizes, [cost["CPU"] for cost in costs]


measured = {solver: report(solver) for solver in SOLVERS}
# -

# ## Chart

# +
if len(SOLVERS) > 1 and len(SIZES) > 1 and comm.rank == 0:
    figure = Figure((6, 3.6), layout="constrained")
    axes = figure.add_subplot(xlabel="unknowns", ylabel="CPU seconds per Newton iteration")
    for (solver, (sizes, seconds)), style in zip(measured.items(), ("o-", "s-")):
        label = f"{solver}: unknowns to the power of {growth(sizes, seconds):.2f}"
        axes.loglog(sizes, seconds, style, color={"o-": "0.4", "s-": "#c8102e"}[style], label=label)
    axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    Path("results").mkdir(exist_ok=True)
    figure.savefig("results/growth.png", dpi=150)
# -
