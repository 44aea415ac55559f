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

# +
import sys

import numpy as np

from demos.studies.performance.scene import comm, half_cylinder, size_of

ALGORITHM = "saddle" if "saddle" in sys.argv else "condensed"
NUMBERS = [arg for arg in sys.argv[1:] if arg != "saddle"]
RATIO = float(NUMBERS[0]) if NUMBERS else 1.0
REFINEMENTS = int(NUMBERS[1]) if len(NUMBERS) > 1 else 3
DEPTHS = (0.05, 0.15, 0.25)
# -


# +
def measure(refinements):
    """Dofs, nodes in contact, Newton iterations, linear ones in each, and for eight digits."""
    stiff = (1.0, RATIO) if RATIO >= 1.0 else (1.0 / RATIO, 1.0)
    options = {"solver": "iterative", "algorithm": ALGORITHM}
    problem, push = half_cylinder(0.16, refinements, stiff=stiff, **options)
    residuals = []  # iteration and residual: 0, 1, 2, ... in each linear solve
    problem.equations.system.ksp.setMonitor(
        lambda ksp, iteration, residual: residuals.append((iteration, residual))
    )
    newton = 0
    for depth in DEPTHS:
        push.value[1] = -depth
        newton += problem.solve().num_iterations
    number, residual = np.array(residuals).T
    (first,) = np.nonzero(number == 0)
    last = np.append(first[1:], number.size) - 1
    linear, digits = number[last].sum(), np.log10(residual[first] / residual[last]).sum()
    active = problem.equations.contacts[0].active.sum()
    return size_of(problem), active, newton, linear / newton, 8 * linear / digits


def show(*cells):
    if comm.rank == 0:
        print(f"| {' | '.join(cells)} |", flush=True)


show("dofs", "nodes in contact", "Newton", "linear in each", "for 8 digits", "growth")
show(*["---:"] * 6)
before = None
for refinements in range(REFINEMENTS + 1):
    dofs, active, newton, mean, whole = measure(refinements)
    growth = f"{whole / before:.2f}" if before else ""
    show(f"{dofs}", f"{active}", f"{newton}", f"{mean:.1f}", f"{whole:.1f}", growth)
    before = whole
# -
