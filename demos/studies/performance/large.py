# # A million unknowns on two cores
#
# A half cylinder is pressed on a block, both neo-Hookean, in three load steps from first contact.
# Each refinement halves all cells:
#
#     mpirun -n 2 python3 -m demos.studies.performance.large            16k unknowns
#     mpirun -n 2 python3 -m demos.studies.performance.large 4          1M
#     mpirun -n 2 python3 -m demos.studies.performance.large 3 direct   260k, by factors
#     python3 -m demos.studies.performance.large chart                  results/large.png
#
# Each run adds a line to results/large.csv; the chart shows the last one of each size and solver.
#
# CPU seconds are those of the busiest rank: unlike wall times they hardly depend on other work on
# the machine. Memory is the peak of all ranks together, meshing included.

# +
import csv
import resource
import sys
import time
from pathlib import Path

from mpi4py import MPI

from matplotlib.figure import Figure

from demos.studies.performance.scene import comm, half_cylinder, size_of

SOLVER = "direct" if "direct" in sys.argv else "iterative"
REFINEMENTS = int(next((arg for arg in sys.argv[1:] if arg.isdecimal()), 1))
DEPTHS = (0.05, 0.15, 0.25)
MEASURED = Path("results/large.csv")  # solver, ranks, unknowns, CPU seconds an iteration, GiB
# -


# +
def draw():
    """Draw CPU seconds of an iteration and memory against the number of unknowns."""
    with MEASURED.open() as file:
        last = {(solver, int(size)): row for solver, _, size, *row in csv.reader(file)}
    figure = Figure((6, 3.2), layout="constrained")
    for place, name in enumerate(("CPU seconds per iteration", "memory [GiB]")):
        axes = figure.add_subplot(1, 2, place + 1, xlabel="unknowns", ylabel=name)
        for solver, style in (("direct", "0.4"), ("iterative", "#c8102e")):
            sizes = sorted(size for kind, size in last if kind == solver)
            values = [float(last[solver, size][place]) for size in sizes]
            if sizes:
                axes.loglog(sizes, values, "o-", color=style, label=solver)
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    figure.savefig(MEASURED.with_suffix(".png"), dpi=150)


if "chart" in sys.argv:
    draw()
    sys.exit()
# -

problem, push = half_cylinder(0.08, REFINEMENTS, solver=SOLVER)


def peak():
    """Gigabytes."""
    return comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024**2


def show(line):
    if comm.rank == 0:
        print(line, flush=True)


# +
show(f"{size_of(problem)} dofs, {SOLVER}, {comm.size} ranks\n")
show("| depth [mm] | force [N/mm] | nodes in contact | iterations | on the clock [s] | CPU [s] |")
show("|---:|---:|---:|---:|---:|---:|")
iterations, clock, cpu, phases = 0, 0.0, 0.0, {}
for depth in DEPTHS:
    push.value[1] = -depth
    start = time.perf_counter(), time.process_time()
    report = problem.solve()
    spent = time.perf_counter() - start[0], time.process_time() - start[1]
    wall, busy = (comm.allreduce(seconds, MPI.MAX) for seconds in spent)
    iterations, clock, cpu = iterations + report.num_iterations, clock + wall, cpu + busy
    for phase, seconds in report.total_seconds().items():
        phases[phase] = phases.get(phase, 0.0) + seconds
    contact = problem.equations.contacts[0]
    cells = [f"{depth:.2f}", f"{contact.total_force[1]:.6f}", f"{contact.active.sum()}"]
    cells += [f"{report.num_iterations}", f"{wall:.1f}", f"{busy:.1f}"]
    show(f"| {' | '.join(cells)} |")
show(f"| all | | | {iterations} | {clock:.1f} | {cpu:.1f} |\n")
whole = sum(phases.values())
show(", ".join(f"{phase} {100 * seconds / whole:.1f} %" for phase, seconds in phases.items()))
memory = peak()
show(f"peak {memory:.2f} GiB")
if comm.rank == 0:
    MEASURED.parent.mkdir(exist_ok=True)
    with MEASURED.open("a") as file:
        row = SOLVER, comm.size, size_of(problem), cpu / iterations, memory
        csv.writer(file).writerow(row)
# -
