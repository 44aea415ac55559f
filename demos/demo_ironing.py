# # Ironing: a round indenter is pressed into a block and drawn along it
#
# This demo shows finite strain, large sliding and load steps of several facets.
#
# ## Problem
# Shallow ironing, the frictionless variant (geometry after Yastrebov 2011): an indenter with a
# round bottom of the radius 0.75 mm goes down by 1 mm, 0.8 mm of it into a block of 12 x 4 mm, ten
# times softer, and is drawn by 10 mm along it. Both are compressible neo-Hookean, nu = 0.32. Each
# step of the slide goes over two facets of the block, more than three of the indenter.
#
# ## Implementation

# +
import sys
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

root = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(root), str(root / "meshes")]
import indenter_on_block

import fenics_mortar as fm

comm = MPI.COMM_WORLD
E, nu = 689.6, 0.32
# -

model = None
if comm.rank == 0:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    model = indenter_on_block.build()
data = fm.read_gmsh(model, comm)
if comm.rank == 0:
    gmsh.finalize()

# Young's modulus is a function, constant in each body.

# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
F = ufl.Identity(2) + ufl.grad(u)
J = ufl.det(F)
mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
P = mu * (F - ufl.inv(F).T) + lmbda * ufl.ln(J) * ufl.inv(F).T
dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 3})
bodies = {"block": 1.0, "indenter": 10.0}
residual = sum(
    factor * ufl.inner(P, ufl.grad(v)) * dx(data.bodies[name]) for name, factor in bodies.items()
)

held = fem.Constant(data.mesh, (0.0, 0.0))
tool = fem.Constant(data.mesh, (0.0, 0.0))
bcs = [fm.dirichlet(V, data, "block/bottom", held), fm.dirichlet(V, data, "indenter/top", tool)]
contact = fm.ContactPair(data, slave="block/top", master="indenter/arc")
problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, petsc_options_prefix="ironing_")
# -

# ## Load steps: down in 10, along in 25

# +
path = [(0.0, -0.1 * k) for k in range(1, 11)] + [(0.4 * k, -1.0) for k in range(1, 26)]
forces, iterations = [], []
for step, displacement in enumerate(path, start=1):
    tool.value[:] = displacement
    report = problem.solve()
    iterations.append(report.num_iterations)
    forces.append(-problem.contacts[0].total_force)  # on the master, the indenter
    if comm.rank == 0:
        print(f"step {step:2}: {iterations[-1]} iterations, force {np.round(forces[-1], 2)} N/mm")
    if step == 22:
        fm.plot(problem, "results/ironing.png", stress=-(P * F.T / J)[1, 1], label="pressure [MPa]")
# -

# ## Check
# Pressed down the force is upwards; sliding without friction on a long block takes next to none.

vertical, horizontal = np.array(forces)[:, 1], np.array(forces)[:, 0]
assert np.all(np.diff(vertical[1:10]) > 0)
assert np.abs(horizontal[14:24]).max() < 0.05 * vertical[14:24].min()
assert np.mean(iterations[10:]) < 12
