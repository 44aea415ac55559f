# # Iterations of multigrid under mesh refinement
#
# A half cylinder is pressed on a block in three load steps, both neo-Hookean; the cylinder is the
# slave. The result is the number of GMRES iterations with multigrid for eight digits, averaged
# over all Newton iterations (which need fewer digits), and its growth if facets are halved. The
# first argument is the stiffness of the cylinder over that of the block, the second the number of
# refinements; with "saddle" multipliers are unknowns of the system:
#
#     python3 -m demos.studies.performance.multigrid                     equal bodies, 2k to 121k
#     python3 -m demos.studies.performance.multigrid 1000 3 saddle       a stiff cylinder
#     mpirun -n 2 python3 -m demos.studies.performance.multigrid 1e-3 4    a stiff block, to 483k
#     python3 -m demos.studies.performance.multigrid 1 2 hypre gamg 5
#
# The last one compares cycles by turns, five times each: CPU times are medians of all three load
# steps together. The cycle that is not the default one is set as a user sets it, by options of
# PETSc; a PETSc without hypre has "gamg" only.

# +
import sys
import time

from mpi4py import MPI

import numpy as np

from demos.studies.performance.scene import comm, half_cylinder, size_of
from fenics_mortar.la.options import GAMG, HYPRE
from fenics_mortar.utils import compat

ALGORITHM = "saddle" if "saddle" in sys.argv else "condensed"
NAMED = {"hypre": HYPRE, "gamg": GAMG}
DEFAULT = "hypre" if compat.petsc_has("hypre") else "gamg"
CYCLES = [name for name in NAMED if name in sys.argv] or [DEFAULT]
NUMBERS = [arg for arg in sys.argv[1:] if arg != "saddle" and arg not in NAMED]
RATIO = float(NUMBERS[0]) if NUMBERS else 1.0
REFINEMENTS = int(NUMBERS[1]) if len(NUMBERS) > 1 else 3
REPEATS = int(NUMBERS[2]) if len(NUMBERS) > 2 else 1
DEPTHS = (0.05, 0.15, 0.25)
# -


# +
def measure(refinements, cycle):
    """Dofs, nodes in contact, Newton steps, linear ones in each and for eight digits, CPU [s]."""
    stiff = (1.0, RATIO) if RATIO >= 1.0 else (1.0 / RATIO, 1.0)
    options = {"solver": "iterative", "algorithm": ALGORITHM}
    if cycle != DEFAULT:
        options["petsc_options"] = {f"cycle_{name}": value for name, value in NAMED[cycle].items()}
    problem, push = half_cylinder(0.16, refinements, stiff=stiff, **options)
    residuals = []  # iteration and residual: 0, 1, 2, ... in each linear solve
    problem.equations.system.ksp.setMonitor(
        lambda ksp, iteration, residual: residuals.append((iteration, residual))
    )
    newton, begin = 0, time.process_time()
    for depth in DEPTHS:
        push.value[1] = -depth
        newton += problem.solve().num_iterations
    busy = comm.allreduce(time.process_time() - begin, MPI.MAX)
    number, residual = np.array(residuals).T
    (first,) = np.nonzero(number == 0)
    last = np.append(first[1:], number.size) - 1
    linear, digits = number[last].sum(), np.log10(residual[first] / residual[last]).sum()
    active = problem.equations.contacts[0].active.sum()
    return size_of(problem), active, newton, linear / newton, 8 * linear / digits, busy


def show(*cells):
    if comm.rank == 0:
        print(f"| {' | '.join(cells)} |", flush=True)


heads = "cycle", "dofs", "nodes in contact", "Newton", "linear in each", "for 8 digits"
show(*heads, "growth", "CPU [s]")
show("---", *["---:"] * (len(heads) + 1))
before = {}
for refinements in range(REFINEMENTS + 1):
    runs = {cycle: [] for cycle in CYCLES}
    for _ in range(REPEATS):
        for cycle in CYCLES:
            runs[cycle].append(measure(refinements, cycle))
    for cycle in CYCLES:
        dofs, active, newton, mean, whole, busy = np.median(runs[cycle], axis=0)
        growth = f"{whole / before[cycle]:.2f}" if cycle in before else ""
        counts = (f"{number:.0f}" for number in (dofs, active, newton))
        show(cycle, *counts, f"{mean:.1f}", f"{whole:.1f}", growth, f"{busy:.2f}")
        before[cycle] = whole
# -
