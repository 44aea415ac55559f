# # Ironing with linear bulk: one factorization of K, or one in every iteration
#
# A round indenter is pressed into a block of the same linear elastic material and drawn along it,
# 0.8 facets per load step. Both methods solve the same steps alternately; the time of 100 steps is
# extrapolated from those of the slide. Times are CPU times of the busiest rank, which depend less
# on other work on the machine. The argument is the number of unknowns, 160 000 by default; with
# "direct" the general method uses factors instead of multigrid, with "space" the bodies are solids
# of hexahedra, with friction, and with "small" sliding is small:
#
#     python3 -m demos.studies.performance.linear_bulk 40_000
#     python3 -m demos.studies.performance.linear_bulk 20_000 space

# +
import resource
import sys
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, read_mesh
from meshes import indenter_on_block, mapped_boxes
from meshes.mapped_boxes import Box, mapped

comm = MPI.COMM_WORLD
sizes = [int(arg) for arg in sys.argv[1:] if arg[0].isdecimal()]
dofs = sizes[0] if sizes else 160_000
solver = "direct" if "direct" in sys.argv else "auto"
sliding = "small" if "small" in sys.argv else "finite"
SLIDES = 10
# -


# +
def in_the_plane():
    """Mesh, slave, master, law, pressing and sliding motions of an indenter."""
    k = max(round(np.sqrt(dofs / 2616)), 1)
    numbers = {"n_block": 60, "layers_block": 20, "n_indenter": 12, "layers_indenter": 9}
    numbers = {name: k * number for name, number in numbers.items()}
    data = read_mesh(lambda: indenter_on_block.build(**numbers))
    pressing = [(0.0, -0.2 - depth) for depth in (0.01, 0.03, 0.05)]
    slides = [(0.16 / k * step, -0.25) for step in range(1, SLIDES + 1)]
    return data, "block/top", "indenter/arc", None, pressing, slides


def in_space():
    """As ``in_the_plane``: a block of n cells each way with a spherical bottom, and one below it.

    Cells are graded towards the surfaces of contact.
    """
    n, radius = max(round((dofs / 6.0) ** (1 / 3)) - 1, 2), 2.0

    def above(s, t, r):
        x, y = s - 0.5, t - 0.5
        sagitta = radius - np.sqrt(radius**2 - x**2 - y**2)
        return x, y, sagitta * (1.0 - r**1.5) + 0.8 * r**1.5

    def below(s, t, r):
        return 1.4 * (s - 0.5), 1.4 * (t - 0.5), -((1.0 - r) ** 1.5)

    boxes = [Box("indenter", mapped((n, n, n), above)), Box("block", mapped((n, n, n), below))]
    data = mapped_boxes.mesh(boxes, comm=comm)
    pressing = [(0.0, 0.0, -depth) for depth in (0.01, 0.02, 0.03)]
    slides = [(0.2 / n * step, 0.1 / n * step, -0.03) for step in range(1, SLIDES + 1)]
    return data, "indenter/bottom", "block/top", fm.Coulomb(0.3), pressing, slides


def set_up(data, slave, master, law, linear_bulk):
    """The problem, and the constant that moves the indenter."""
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    stress = linear_elastic(u, 100.0, 150.0)
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 2})
    tool = fem.Constant(data.mesh, (0.0,) * data.mesh.geometry.dim)
    bcs = [fm.dirichlet(V, data, "block/bottom", 0.0 * tool.value)]
    bcs += [fm.dirichlet(V, data, "indenter/top", tool)]
    pair = fm.ContactPair(data, slave=slave, master=master, law=law, sliding=sliding)
    problem = fm.ContactProblem(
        residual,
        u,
        [pair],
        bcs=bcs,
        petsc_options_prefix="bench_",
        solver=solver,
        linear_bulk=linear_bulk,
    )
    return problem, tool


def measure(problem, tool, displacement):
    """Seconds and iterations of a load step."""
    tool.value[:] = displacement
    start = time.process_time()
    report = problem.solve()
    return comm.allreduce(time.process_time() - start, MPI.MAX), report.num_iterations


def peak():
    """Peak memory so far [GB]."""
    return comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024**2


# -

# +
*scene, pressing, slides = in_space() if "space" in sys.argv else in_the_plane()
problems = [set_up(*scene, linear_bulk) for linear_bulk in (False, True)]
pressed = [[], []]
for which, (problem, tool) in enumerate(problems):
    pressed[which] = [measure(problem, tool, displacement) for displacement in pressing]
    pressed[which].append(peak())
slid = [[measure(*each, displacement) for each in problems] for displacement in slides]

u, w = (problem.equations.bulk.u.x.array for problem, _ in problems)
difference = comm.allreduce(float(np.abs(u - w).max(initial=0.0)), MPI.MAX)
bulk = problems[0][0].equations.bulk
if comm.rank == 0:
    contact = problems[0][0].equations.contacts[0]
    print(f"{bulk.r.getSize()} dofs, {contact.slave.dofs.size + contact.master.dofs.size} of them")
    print(f"of contact, {contact.active.sum()} active nodes, {comm.size} ranks;")
    print(f"the two end {difference:.1e} apart\n")
    print("| path | to press [s] | iterations | a slide [s] | 100 slides [s] | peak [GiB] |")
    print("|---|---:|---:|---:|---:|---:|")
    totals = []
    for which, name in enumerate(("general", "factored once")):
        press = sum(seconds for seconds, _ in pressed[which][:-1])
        slide = np.median([step[which][0] for step in slid])
        count = np.mean([step[which][1] for step in slid])
        totals.append(press + 100 * slide)
        cells = [f"{press:.1f}", f"{count:.1f}", f"{slide:.3f}", f"{totals[-1]:.1f}"]
        print(f"| {name} | {' | '.join(cells)} | {pressed[which][-1]:.2f} |")
    print(f"\nfactored once is {totals[0] / totals[1]:.1f} times faster")
# -
