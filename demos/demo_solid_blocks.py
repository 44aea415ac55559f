# # Two blocks in three dimensions, with friction
#
# This demo shows that in space a script is that of the plane with a mesh of solids: compare with
# `demo_two_blocks.py`.
#
# ## Problem
# A block of 1 x 1 x 0.5 mm stands, turned by 20 degrees, on one of 1.8 x 1.8 x 0.6 mm. The lower
# one is fixed at its bottom; the top of the upper one goes down by 0.1 mm and then sideways by
# 0.3 mm in a direction that is that of no edge. Both are compressible neo-Hookean, the lower one
# ten times stiffer; mu = 0.3.
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_boxes import Box, block, mesh

comm, E, nu, mu, turn = MPI.COMM_WORLD, 100.0, 0.3, 0.3, np.radians(20.0)
# -

# The sides of a box are named `upper/bottom` and so on.

axes = [[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
upper = block((7, 7, 4), size=(1.0, 1.0, 0.5), corner=(-0.5, -0.5, 0.0)) @ axes
lower = block((10, 10, 4), size=(1.8, 1.8, 0.6), corner=(-0.9, -0.9, -0.6))
blocks = mesh([Box("upper", upper), Box("lower", lower)], comm=comm)

# +
V = fm.vector_space(blocks.mesh, 1)
u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
P = ufl.diff(psi, F)
dx = ufl.dx(subdomain_data=blocks.cell_tags, metadata={"quadrature_degree": 3})
soft, hard = (dx(blocks.bodies[name]) for name in ("upper", "lower"))
residual = ufl.derivative(psi * soft + 10 * psi * hard, u, v)

fixed = fem.Constant(blocks.mesh, (0.0, 0.0, 0.0))
push = fem.Constant(blocks.mesh, (0.0, 0.0, 0.0))
bcs = [fm.dirichlet(V, blocks, "lower/bottom", fixed), fm.dirichlet(V, blocks, "upper/top", push)]
contact = fm.ContactPair(blocks, slave="upper/bottom", master="lower/top", law=fm.Coulomb(mu))
problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, petsc_options_prefix="solids_")
# -

# ## Load steps

# +
path = [(0.0, 0.0, -0.05), (0.0, 0.0, -0.1)]
path += [(0.06 * k, 0.045 * k, -0.1) for k in (1, 2, 3, 4)]
iterations = []
for push.value[:] in path:
    report = problem.solve()
    iterations.append(report.num_iterations)
force = problem.contacts[0].total_force
shear = np.hypot(force[0], force[1])
if comm.rank == 0:
    print(f"iterations of the steps {iterations}")
    print(
        f"force on the upper block {force.round(4)} N, shear over pressure {shear / force[2]:.4f}"
    )
shown = {"label": "vertical compression [MPa]", "units": ("mm", "MPa")}
fm.plot(problem, "results/solid_blocks.png", stress=-(P * F.T / ufl.det(F))[2, 2], **shown)
# -

# ## Check
# The block slides, against friction in the direction of the motion, (4, 3). Newton's method
# converges quadratically.

direction = np.array([force[1], -force[0]]) @ (4, 3) / 5 / shear
assert abs(shear / force[2] - mu) < 0.01 and abs(direction) < 0.02 and max(iterations) <= 8
