# # Cost of the search for crossed surfaces
#
# Two neo-Hookean blocks, the upper pressed on the lower and slid along it by half a facet per load
# step, as in `newton.py`. After each solve the outlines of both are checked, in the state and along
# the step. One check per solve, compared with one Newton iteration:
#
#     python3 -m demos.studies.performance.crossing                   10k, 40k, 160k
#     mpirun -n 2 python3 -m demos.studies.performance.crossing 640_000
#
# CPU time of the busiest rank, medians over the load steps.

# +
import sys
import time

from mpi4py import MPI

import numpy as np

from demos.studies.performance.scene import comm, size_of, two_pressed_blocks

STEPS = 5
REPEATS = 10
SIZES = [int(arg) for arg in sys.argv[1:] if arg[0].isdecimal()] or [10_000, 40_000, 160_000]
# -


# +
def seconds_of(call, repeats=1):
    """CPU seconds of a call on the busiest rank, and its result."""
    start = time.process_time()
    for _ in range(repeats):
        result = call()
    return comm.allreduce(time.process_time() - start, MPI.MAX) / repeats, result


def measure(dofs):
    """Dofs, segments, seconds of an iteration, and of the checks of a state and of a step."""
    problem, facet, top = two_pressed_blocks(dofs)
    problem.solve()
    crossings, costs = problem.equations.crossings, []
    for _ in range(STEPS):
        top.value[0] += 0.5 * facet
        before = crossings.accepted
        seconds, report = seconds_of(problem.solve)
        crossings.restore(before, problem.equations.bulk.u.x.array.copy())
        state, found = seconds_of(crossings.find, REPEATS)
        step, passed = seconds_of(
            lambda: crossings.passages(problem.equations.motions.places), REPEATS
        )
        crossings.accept(problem.equations.motions.places)
        assert passed == ([], []) and all(crossing.facets < 0.1 for crossing in found)
        costs.append((seconds / report.num_iterations, state, step))
    return size_of(problem), len(crossings.outline.segments), *np.median(costs, axis=0)


# -


# +
rows = [measure(dofs) for dofs in SIZES]
if comm.rank == 0:
    print("| unknowns | segments | iteration [ms] | state [ms] | step [ms] | both / iteration |")
    print("|---:|---:|---:|---:|---:|---:|")
    for dofs, segments, iteration, state, step in rows:
        part = (state + step) / iteration
        times = " | ".join(f"{1e3 * value:.2f}" for value in (iteration, state, step))
        print(f"| {dofs:,} | {segments} | {times} | {part:.2%} |")
