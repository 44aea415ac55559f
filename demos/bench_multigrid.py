# # Iterations of multigrid on ever finer meshes
#
# A half cylinder is pressed on a block in three load steps, both neo-Hookean; the cylinder is the
# slave. What counts is how often GMRES with multigrid iterates in one Newton iteration, in the mean
# over all steps, and by what factor that grows as the facets are halved. The first argument is how
# many times as stiff as the block the cylinder is, the second how often the mesh is refined:
#
#     python3 demos/bench_multigrid.py                    equal bodies, 2k to 121k unknowns
#     python3 demos/bench_multigrid.py 1000               a stiff cylinder
#     mpirun -n 2 python3 demos/bench_multigrid.py 1e-3 4    a stiff block, to 483k

# +
import sys

from bench_scene import comm, half_cylinder, size_of

RATIO = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
REFINEMENTS = int(sys.argv[2]) if len(sys.argv) > 2 else 3
DEPTHS = (0.05, 0.15, 0.25)
# -


# +
def measure(refinements):
    """Dofs, nodes in contact, Newton iterations, and linear iterations in each, mean and most."""
    stiff = (1.0, RATIO) if RATIO >= 1.0 else (1.0 / RATIO, 1.0)
    problem, push = half_cylinder(0.16, refinements, stiff=stiff, solver="iterative")
    seen = []  # 0, 1, 2, ... of every linear solve
    problem.system.ksp.setMonitor(lambda ksp, iteration, residual: seen.append(iteration))
    newton = 0
    for depth in DEPTHS:
        push.value[1] = -depth
        newton += problem.solve().num_iterations
    linear = len(seen) - seen.count(0)
    return size_of(problem), problem.contacts[0].active.sum(), newton, linear / newton, max(seen)


def say(*cells):
    if comm.rank == 0:
        print(f"| {' | '.join(cells)} |", flush=True)


say("dofs", "nodes in contact", "Newton", "linear in each", "the most", "growth")
say(*["---:"] * 6)
before = None
for refinements in range(REFINEMENTS + 1):
    dofs, active, newton, mean, most = measure(refinements)
    growth = f"{mean / before:.2f}" if before else ""
    say(f"{dofs}", f"{active}", f"{newton}", f"{mean:.1f}", f"{most}", growth)
    before = mean
# -
