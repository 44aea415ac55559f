# # Waiting times of users: a half disc pressed on a block, and 50 steps of ironing
#
# H1: a linear elastic half disc is pressed on a block of the same material, one solve; by default,
# with one factorization of the constant stiffness, and with one in every iteration. H3: an indenter
# ten times stiffer is drawn along a neo-Hookean block without friction, in 50 given steps, by a
# plain loop of solves (with and without guesses) and by follow_path. Arguments are facets of the
# block's top, which give 1.3k, 4.7k and 18k unknowns, or facet lengths of the disc:
#
#     python3 -m demos.studies.performance.waits 50 100 200 0.0037 0.0018

# +
import sys
import time
from functools import partial

from mpi4py import MPI

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import lame, linear_elastic, neo_hookean, read_mesh
from meshes import half_cylinder_on_block, indenter_on_block

comm = MPI.COMM_WORLD
ARGS = [float(arg) for arg in sys.argv[1:]] or [50, 100, 0.01, 0.0037]
STEPS, DOWN = 50, 10
# -


# +
def half_disc(h, **options):
    """The problem of one press; its flat side is moved by 0.02 radii."""
    shape = {"radius": 1.0, "width": 4.0, "height": 2.0, "fine": 0.2, "growth": 0.15}
    data = read_mesh(lambda: half_cylinder_on_block.build(h=h, **shape))
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    stress = linear_elastic(u, *lame(1.0, 0.3))
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2})
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "cylinder/top", (0.0, -0.02)))
    pair = fm.ContactPair(data, "cylinder/arc", "block/top")
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="h1_", **options)


def ironing(n):
    """The problem, and a function that sets the position of the indenter at a time from 0 to 1."""
    numbers = {"n_block": n, "layers_block": n // 5}
    numbers |= {"n_indenter": 2 * (n // 10), "layers_indenter": n // 10}
    data = read_mesh(lambda: indenter_on_block.build(**numbers))
    V = fm.vector_space(data.mesh, 1)
    u, v, tool = fem.Function(V), ufl.TestFunction(V), fem.Constant(data.mesh, (0.0, 0.0))
    rule = {"quadrature_degree": 2}
    dx = ufl.Measure("dx", data.mesh, subdomain_data=data.cell_tags, metadata=rule)
    work = ufl.inner(neo_hookean(u, *lame(689.6, 0.32)), ufl.grad(v))
    residual = work * dx(data.body_tag("block")) + 10 * work * dx(data.body_tag("indenter"))
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "indenter/top", tool))
    pair = fm.ContactPair(data, "block/top", "indenter/arc")
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="h3_")

    def move(t):
        down = DOWN / STEPS
        tool.value[:] = 5.0 * max(t - down, 0.0) / (1.0 - down), -min(t / down, 1.0)

    return problem, move


def press(problem):
    """Report of one solve."""
    return [problem.solve()]


def loop(problem, move, **options):
    """Reports of a plain loop."""
    reports = []
    for step in range(1, STEPS + 1):
        move(step / STEPS)
        reports.append(problem.solve(**options))
    return reports


def path(problem, move):
    """Reports of ``follow_path`` with the same steps."""
    found = fm.follow_path(problem, move, fm.SteppingOptions(1.0 / STEPS))
    return [step.report for step in found.steps]


def measure(name, problem, run):
    """Print size, seconds of the busiest rank, iterations, the solver."""
    start = time.process_time()
    reports = run()
    seconds = comm.allreduce(time.process_time() - start, MPI.MAX)
    count = sum(report.num_iterations for report in reports)
    size = problem.equations.bulk.r.getSize()
    if comm.rank == 0:
        row = [name, str(size), f"{seconds:.2f}", str(count), reports[-1].solver]
        print(f"| {' | '.join(row)} |", flush=True)


# -

# +
if comm.rank == 0:
    print("| scene | unknowns | CPU [s] | iterations | linear solver |\n|---|---:|---:|---:|---|")
for size in ARGS:
    if size < 1.0:
        for name, options in (("", {}), (", every iteration", {"linear_bulk": False})):
            problem = half_disc(size, **options)
            measure(f"H1{name}", problem, partial(press, problem))
    else:
        problem, move = ironing(int(size))
        measure("H3, loop", problem, partial(loop, problem, move))
        problem, move = ironing(int(size))
        measure("H3, loop without guesses", problem, partial(loop, problem, move, predict=False))
        problem, move = ironing(int(size))
        measure("H3, path", problem, partial(path, problem, move))
# -
