# # A block bounces on another one
#
# This demo shows how to
# - give bodies mass: `fm.Dynamics(problem, density)`,
# - move them in time steps through impacts, with loads and prescribed values in time,
# - read energies, momentum and the work of friction from the record.
#
# ## Problem
# A soft block falls on a wider one that stands on the ground, and bounces several times under a
# weak gravity of 2 m/s^2. Both are neo-Hookean gels in plane strain, with friction. Units are m, s,
# kPa and t/m^3. The trapezoidal rule would gain energy in each impact; the default scheme gives the
# nodes of the contact surface no mass, and returns the energy that contact takes in a step.
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, build
from meshes.with_gmsh import gmsh

comm, gap, fall = MPI.COMM_WORLD, 0.1, 1.0
# -

# Blocks of 1 m x 1 m and 2 m x 1 m, the upper one 0.1 m above the lower one.

# +
model = None
if comm.rank == 0:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    upper = Grid("upper", block(6, 6, width=1.0, height=1.0, corner=(-0.5, gap)))
    lower = Grid("lower", block(9, 5, width=2.0, height=1.0, corner=(-1.0, -1.0)))
    model = build([upper, lower])
blocks = fm.read_gmsh(model, comm)
if comm.rank == 0:
    gmsh.finalize()
# -

# The residual is that of statics: internal forces less gravity.

# +
V = fm.vector_space(blocks.mesh, 1)
u, v = fem.Function(V, name="displacement"), ufl.TestFunction(V)
E, nu, density = 100.0, 0.3, 1.0
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
dx = ufl.dx(metadata={"quadrature_degree": 3})
energy = psi * dx
weight = ufl.inner(fem.Constant(blocks.mesh, (0.0, -2.0)), v) * dx
residual = ufl.derivative(energy, u, v) - density * weight

pair = fm.ContactPair(blocks, "upper/bottom", "lower/top", law=fm.Coulomb(0.2))
bcs = [fm.dirichlet(V, blocks, "lower/bottom", (0.0, 0.0))]
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="impact_")
# -

# ## Motion
# The upper block starts downwards, and a little to the right.

# +
motion = fm.Dynamics(problem, density, energy=energy)
motion.velocity.interpolate(lambda x: (x[1] > gap / 2) * np.array([[0.2], [-fall]]))
steps, forces = fm.SteppingOptions(step=0.0125), []


def note(time: float, _report: object) -> None:
    forces.append((time, problem.contacts[0].total_force[1]))


impact = motion.run(0.3, steps, on_step=note)
shown = {"label": "compression [kPa]", "units": ("m", "kPa")}
fm.plot(problem, "results/impact.png", stress=-ufl.diff(psi, F)[1, 1], **shown)
record = motion.run(1.5, steps, on_step=note)
time, force = np.array(forces).T
if comm.rank == 0:
    print(f"{record}\n\nlargest contact force {force.max():.2f}")
# -

# ## Check
# The block rebounded, and only friction dissipated energy.

assert np.count_nonzero(np.diff(force != 0.0)) >= 2
assert 0.0 < impact.friction_work < 0.1 * impact.start.total
