# # Time of a gradient compared with that of its path
#
# A half cylinder is pressed on a block with friction and drawn sideways in 20 steps. The objective
# is the misfit of the forces of all steps; controls are the Young's modulus, mu, and a body force
# with as many numbers as there are unknowns. Times are CPU times; the arguments are the number of
# refinements of the mesh and one of
#
# - "linear": the bodies are linear, and the path has factors of the bulk;
# - "small": sliding is small, too, and there is no friction;
# - "saddle", "multigrid": another linear system, or an iterative solver;
# - "driven": a rigid circle in place of the half cylinder, pressed by a force:
#
#       python3 -m demos.studies.performance.gradient 1 linear

# +
import sys
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, neo_hookean
from demos.studies.performance.scene import read
from fenics_mortar.energies import lame
from meshes import half_cylinder_on_block

comm = MPI.COMM_WORLD
refinements = next((int(arg) for arg in sys.argv[1:] if arg.isdecimal()), 0)
kind = next((arg for arg in sys.argv[1:] if arg.isalpha()), "")
linear, small, driven = kind in ("linear", "small"), kind == "small", kind == "driven"
# -

# +
shape = {"radius": 8.0, "width": 48.0, "height": 24.0, "fine": 1.0, "growth": 0.2, "h": 0.1}
data = read(half_cylinder_on_block.build, refinements=refinements, **shape)
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
E, load, push = fem.Constant(data.mesh, 200.0), fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
mu, lmbda = lame(E, 0.3)
dx = ufl.dx(metadata={"quadrature_degree": 1})
stress = linear_elastic(u, mu, lmbda) if linear else neo_hookean(u, mu, lmbda)
residual = ufl.inner(stress, ufl.grad(v)) * dx - ufl.inner(load, v) * dx
bcs = [fm.dirichlet(V, data, "block/bottom", np.zeros(2))]
law = fm.Frictionless() if small else fm.Coulomb(0.2)
roller = fm.Circle((0.0, 8.0), 8.0)
if driven:  # the half cylinder stays where it is
    bcs += [fm.dirichlet(V, data, "cylinder/top", np.zeros(2))]
    pair = fm.ContactPair(data, "block/top", roller, law=law)
else:
    bcs += [fm.dirichlet(V, data, "cylinder/top", push)]
    sliding = "small" if small else "finite"
    pair = fm.ContactPair(data, "cylinder/arc", "block/top", law=law, sliding=sliding)
options = {"petsc_options_prefix": "gradient_", "linear_bulk": linear}
options |= {"algorithm": "saddle"} if kind == "saddle" else {}
options |= {"solver": "iterative"} if kind == "multigrid" else {}
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, **options)
# -

# +
path, iterations, start = fm.sensitivity.RecordedPath(problem), 0, time.process_time()
for step in range(1, 21):
    along, down = 0.02 * max(step - 8, 0), 0.02 * min(step, 8)
    push.value[:] = (along, -down)
    if driven:
        roller.push(y=-60.0 * down)
        roller.move(x=along)
    iterations += problem.solve().num_iterations
    path.record()
forward = comm.allreduce(time.process_time() - start, MPI.MAX)
forces = [fm.sensitivity.TotalForce(0, direction) for direction in np.eye(2)]
controls = [E, load, *([] if small else [fm.sensitivity.LawParameter(0, "mu")])]
misfit = fm.sensitivity.least_squares(np.zeros((20, 2)))
for run in ("first, with compilation", "second"):
    start = time.process_time()
    gradient = fm.gradient(forces, controls, path, over_steps=misfit)
    backward = comm.allreduce(time.process_time() - start, MPI.MAX)
    if comm.rank == 0:
        print(
            f"{problem.equations.bulk.r.getSize()} unknowns, {iterations} iterations in 20 steps: "
            f"{forward:.2f} s; {run} gradient {backward:.2f} s, {backward / forward:.2f} of that"
        )
# -
