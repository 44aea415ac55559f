# # The time of a gradient beside that of its path
#
# A half cylinder is pressed on a block with friction and drawn sideways in 20 steps. The objective
# is the misfit of the forces of all steps; controls are the Young's modulus, mu, and a body force
# with as many numbers as there are unknowns. Times are CPU times; the argument is the number of
# refinements of the mesh:
#
#     python3 -m demos.studies.performance.gradient 1

# +
import sys
import time

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import lame, neo_hookean
from demos.studies.performance.scene import read
from meshes import half_cylinder_on_block

comm = MPI.COMM_WORLD
refinements = int(sys.argv[1]) if len(sys.argv) > 1 else 0
linear_bulk = "linear" in sys.argv
# -

# +
shape = {"radius": 8.0, "width": 48.0, "height": 24.0, "fine": 1.0, "growth": 0.2, "h": 0.1}
data = read(half_cylinder_on_block.build, refinements=refinements, **shape)
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
E, load, push = fem.Constant(data.mesh, 200.0), fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
mu, lmbda = lame(E, 0.3)
dx = ufl.dx(metadata={"quadrature_degree": 1})
residual = ufl.inner(neo_hookean(u, mu, lmbda), ufl.grad(v)) * dx - ufl.inner(load, v) * dx
bcs = [fm.dirichlet(V, data, "block/bottom", np.zeros(2))]
bcs += [fm.dirichlet(V, data, "cylinder/top", push)]
pair = fm.ContactPair(data, "cylinder/arc", "block/top", law=fm.Coulomb(0.2))
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="gradient_")
# -

# +
path, iterations, start = fm.RecordedPath(problem), 0, time.process_time()
for step in range(1, 21):
    push.value[:] = (0.02 * max(step - 8, 0), -0.02 * min(step, 8))
    iterations += problem.solve().num_iterations
    path.record()
forward = comm.allreduce(time.process_time() - start, MPI.MAX)
forces = [fm.sensitivity.TotalForce(0, direction) for direction in np.eye(2)]
controls = [E, fm.sensitivity.LawParameter(0, "mu"), load]
misfit = fm.sensitivity.least_squares(np.zeros((20, 2)))
for words in ("first, with compilation", "second"):
    start = time.process_time()
    gradient = fm.gradient(forces, controls, path, over_steps=misfit)
    backward = comm.allreduce(time.process_time() - start, MPI.MAX)
    if comm.rank == 0:
        print(
            f"{problem.equations.bulk.r.getSize()} unknowns, {iterations} iterations in 20 steps: "
            f"{forward:.2f} s; {words} gradient {backward:.2f} s, {backward / forward:.2f} of that"
        )
# -
