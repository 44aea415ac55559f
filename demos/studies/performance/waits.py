# # Waiting times of users: a half disc pressed on a block, and 50 steps of ironing
#
# H1: a linear elastic half disc is pressed on a block of the same material, one solve; by default,
# with one factorization of the constant stiffness, with one in every iteration, and with quadratic
# elements and as many unknowns. H3: an indenter ten times stiffer is drawn along a neo-Hookean
# block without friction, in 50 given steps, by a plain loop of solves (with and without guesses)
# and by follow_path. Arguments are facets of the block's top, which give 1.3k, 4.7k and 18k
# unknowns, or facet lengths of the disc:
#
#     python3 -m demos.studies.performance.waits 50 100 200 0.0037 0.0018
#
# In serial, force and largest pressure at the end are printed, too, both per thickness and from the
# displacement alone: the residual of the bulk at the slave's nodes. With the argument `fine` they
# are those of quadratic elements on fine meshes. `waits_peer` measures other codes on these meshes
# in the same way, `waits_table` all of them.

# +
import sys
import time
from functools import partial

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, neo_hookean, read_mesh
from fenics_mortar.energies import lame
from meshes import half_cylinder_on_block, indenter_on_block

comm = MPI.COMM_WORLD
SIZES = [50, 100, 0.01, 0.0037]
STEPS, DOWN = 50, 10
# Young's modulus [stress] and Poisson's ratio; the indenter is ten times stiffer than the block
DISC, BLOCK, STIFFER = (1.0, 0.3), (689.6, 0.32), 10.0
HEAD = "scene | unknowns | CPU [s] | iterations | force | largest pressure | linear solver"
# -


# +
def meshed(build, degree, **numbers):
    """A mesh whose cells have the given degree."""

    def of_degree():
        model = build(**numbers)
        model.mesh.setOrder(degree)
        return model

    return read_mesh(of_degree)


def half_disc(h, degree=1, **options):
    """The problem of one press; its flat side is moved by 0.02 radii."""
    shape = {"radius": 1.0, "width": 4.0, "height": 2.0, "fine": 0.2, "growth": 0.15}
    data = meshed(half_cylinder_on_block.build, degree, h=degree * h, **shape)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    stress = linear_elastic(u, *lame(*DISC))
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2 * degree})
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "cylinder/top", (0.0, -0.02)))
    pair = fm.ContactPair(data, "cylinder/arc", "block/top")
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="h1_", **options)


def ironing(n, degree=1):
    """The problem, and a function that sets the position of the indenter at a time from 0 to 1."""
    numbers = {"n_block": n, "layers_block": n // 5}
    numbers |= {"n_indenter": 2 * (n // 10), "layers_indenter": n // 10}
    data = meshed(indenter_on_block.build, degree, **numbers)
    V = fm.vector_space(data.mesh, degree)
    u, v, tool = fem.Function(V), ufl.TestFunction(V), fem.Constant(data.mesh, (0.0, 0.0))
    rule = {"quadrature_degree": 2 * degree}
    dx = ufl.Measure("dx", data.mesh, subdomain_data=data.cell_tags, metadata=rule)
    work = ufl.inner(neo_hookean(u, *lame(*BLOCK)), ufl.grad(v))
    residual = work * dx(data.body_tag("block")) + STIFFER * work * dx(data.body_tag("indenter"))
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


def path(problem, move, steps=STEPS):
    """Reports of ``follow_path`` with the same steps."""
    found = fm.follow_path(problem, move, fm.SteppingOptions(1.0 / steps))
    return [step.report for step in found.steps]


def force_and_pressure(problem):
    """Vertical force on the slave [force / thickness] and largest nodal pressure [stress].

    Both of the present displacement: residuals of the bulk at the slave's nodes that are not
    prescribed, divided for the pressure by the undeformed integrals of the shape functions.
    """
    bulk, (contact,) = problem.equations.bulk, problem.equations.contacts
    slave = contact.slave
    bulk.assemble_residual()
    forces = np.where(bulk.prescribed, 0.0, bulk.r.array_r).reshape(-1, 2)[slave.nodes]
    ends = slave.X[slave.facets[:, [0, -1]]]
    shares = [1 / 2, 1 / 2] if slave.degree == 1 else [1 / 6, 2 / 3, 1 / 6]
    lengths = np.outer(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), shares)
    areas = np.bincount(slave.facets.ravel(), lengths.ravel(), slave.num_nodes)
    return abs(forces[:, 1].sum()), (np.linalg.norm(forces, axis=1) / areas).max()


def measure(name, problem, run):
    """Print size, seconds of the busiest rank, iterations, results and the solver."""
    start = time.process_time()
    reports = run()
    seconds = comm.allreduce(time.process_time() - start, MPI.MAX)
    print_row(name, problem, seconds, sum(r.num_iterations for r in reports), reports[-1].solver)


def print_row(name, problem, seconds, iterations, solver):
    """Print a row of the table; results are those of the problem's present displacement."""
    size = problem.equations.bulk.r.getSize()
    results = force_and_pressure(problem) if comm.size == 1 else (np.nan, np.nan)
    if comm.rank == 0:
        row = [name, str(size), f"{seconds:.3f}", str(iterations)]
        row += [f"{value:.6g}" for value in results]
        print(f"| {' | '.join([*row, solver])} |", flush=True)


def print_head():
    """Print the head of the table."""
    if comm.rank == 0:
        print(f"| {HEAD} |\n|---|---:|---:|---:|---:|---:|---|")


# -


# +
def fine():
    """Solve on fine meshes; the ironing in fewer, adaptive steps, which lead to the same end."""
    problem = half_disc(0.0018, degree=2)
    measure("H1", problem, partial(press, problem))
    problem, move = ironing(200, degree=2)
    measure("H3", problem, partial(path, problem, move, STEPS // 2))


def main():
    """Measure all sizes."""
    print_head()
    if "fine" in sys.argv:
        return fine()
    for size in [float(arg) for arg in sys.argv[1:]] or SIZES:
        if size < 1.0:
            for name, options in (
                ("H1", {}),
                ("H1, every iteration", {"linear_bulk": False}),
                ("H1 of degree 2", {"degree": 2}),
            ):
                problem = half_disc(size, **options)
                measure(name, problem, partial(press, problem))
            continue
        for name, run, options in (
            ("H3, loop", loop, {}),
            ("H3, loop without guesses", loop, {"predict": False}),
            ("H3, path", path, {}),
        ):
            problem, move = ironing(int(size))
            measure(name, problem, partial(run, problem, move, **options))


if __name__ == "__main__":
    main()
# -
