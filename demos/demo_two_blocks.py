# # Two blocks pressed together
#
# This demo shows how to
# - make a mesh of bodies with named surfaces, also under `mpirun`,
# - write any bulk energy in UFL,
# - put two surfaces in contact with one line,
# - solve load steps by the semismooth Newton method, and look at the results.
#
# ## Problem
# A block of 1 x 1 mm with 10 facets stands on one of 2.2 x 1 mm with 20. The lower one is fixed at
# its bottom; the top of the upper one goes down by 0.15 mm and then to the right by 0.2 mm. Both
# are compressible neo-Hookean, plane strain. There is no friction.
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh

comm = MPI.COMM_WORLD
# -

# The sides of a grid are named `upper/bottom` and so on. A gmsh file or model with names, as of
# `meshes/two_blocks.py`, works the same: `fm.read_gmsh("two_blocks.msh", comm)`.

upper = Grid("upper", block(10, 10, width=1.0, height=1.0, corner=(0.6, 1.0)))
lower = Grid("lower", block(20, 10, width=2.2, height=1.0))
blocks = mesh([upper, lower], comm=comm)

# The bulk: displacement, energy and residual are plain UFL [mm, MPa].

# +
V = fm.vector_space(blocks.mesh, 1)
u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)

E, nu = 100.0, 0.3
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
P = ufl.diff(psi, F)
residual = ufl.inner(P, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 3})
# -

# Prescribed displacements are `Constant`s that the loop below changes.

fixed = fem.Constant(blocks.mesh, (0.0, 0.0))
push = fem.Constant(blocks.mesh, (0.0, 0.0))
bcs = [fm.dirichlet(V, blocks, "lower/bottom", fixed), fm.dirichlet(V, blocks, "upper/top", push)]

# Contact is one line: the slave carries the multiplier, its points are projected to the master.

contact = fm.ContactPair(blocks, slave="upper/bottom", master="lower/top")
problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, petsc_options_prefix="two_blocks_")

# ## Load steps

path = [(0.0, -0.05 * k) for k in (1, 2, 3)] + [(0.1 * k, -0.15) for k in (1, 2)]
with fm.ResultsWriter("results/two_blocks", problem, {"stress": P * F.T / ufl.det(F)}) as results:
    for step, displacement in enumerate(path, start=1):
        push.value[:] = displacement
        report = problem.solve()
        results.write(step)
        if comm.rank == 0:
            print(
                f"\nstep {step}: top moved by ({push.value[0]:g}, {push.value[1]:g}) mm\n\n{report}"
            )

table = fm.contact_table(problem)
shown = {"label": "vertical compression [MPa]", "units": ("mm", "MPa")}
fm.plot(problem, "results/two_blocks.png", stress=-(P * F.T / ufl.det(F))[1, 1], **shown)
if comm.rank == 0:
    print(f"\n{table}")

# ## Check
# Newton's method converges quadratically, and the contact forces on the two blocks cancel.

on_slave, on_master = problem.equations.contacts[0].operators.force(problem.equations.contacts[0].z)
assert report.num_iterations <= 8
assert np.abs(on_slave.sum(axis=0) + on_master.sum(axis=0)).max() < 1e-12 * np.abs(on_slave).max()
