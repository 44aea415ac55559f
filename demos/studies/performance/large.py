# # A million unknowns on two cores
#
# A half cylinder is pressed on a block, both neo-Hookean, in three load steps from first contact.
# Each refinement halves all cells:
#
#     mpirun -n 2 python3 -m demos.studies.performance.large            16k unknowns
#     mpirun -n 2 python3 -m demos.studies.performance.large 4          1M
#     mpirun -n 2 python3 -m demos.studies.performance.large 3 direct   260k, by factors
#
# CPU seconds are those of the busiest rank: unlike wall times they hardly depend on other work on
# the machine. Memory is the peak of all ranks together, meshing included.

# +
import resource
import sys
import time

from mpi4py import MPI

from demos.studies.performance.scene import comm, half_cylinder, size_of

SOLVER = "direct" if "direct" in sys.argv else "iterative"
REFINEMENTS = int(next((arg for arg in sys.argv[1:] if arg.isdecimal()), 1))
DEPTHS = (0.05, 0.15, 0.25)
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
show(f"peak {peak():.2f} GiB")
# -
