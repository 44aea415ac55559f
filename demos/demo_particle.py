# # Particle: a heated matrix lets go of its particle, and grips it again
#
# ## Problem
# A stiff round particle sits in a hole of a matrix that expands four times as much. The matrix is
# heated from outside: the hole grows and the particle comes loose. Then only the gas in the gap
# brings heat to it. When the outside is cold again the matrix shrinks, closes the gap, and takes
# the heat back.
#
# A quarter is enough by symmetry. Units are mm, s, MPa and K.
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, mesh, sector

comm = MPI.COMM_WORLD
SIDES, quarter = {"left": 1, "right": 0}, (0.0, np.pi / 2)
particle = Grid("particle", sector(16, 6, radii=(0.2, 1.0), angles=quarter))
matrix = Grid("matrix", sector(20, 12, radii=(1.0, 4.0), angles=quarter))
data = mesh([particle, matrix], comm=comm)
W = fm.mixed_space(data.mesh, ("Lagrange", 1, (2,)), ("Lagrange", 1))
w, w_old, (v, s) = fem.Function(W), fem.Function(W), ufl.TestFunctions(W)
(u, T), T_old = ufl.split(w), ufl.split(w_old)[1]
# -

# Young's modulus, expansion, conductivity, and heat capacity per volume of both bodies.

# +
MATERIALS = {"particle": (400e3, 5e-6, 30.0, 3.0), "matrix": (70e3, 22e-6, 150.0, 2.4)}
dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 3})
dt, outside = fem.Constant(data.mesh, 0.003), fem.Constant(data.mesh, 0.0)
residual = 0
for body, (E, alpha, conductivity, capacity) in MATERIALS.items():
    e = fm.energies.elastic_strain(u, alpha * T)
    stress = fm.energies.stress(fm.energies.linear_elastic, e, *fm.energies.lame(E, 0.3))
    heat = capacity * (T - T_old) / dt * s + conductivity * ufl.inner(ufl.grad(T), ufl.grad(s))
    work = ufl.inner(stress, fm.energies.elastic_strain(v))
    residual += (work + heat) * dx(data.body_tag(body))

conduction = [fm.PressureConductance(100.0, 10.0), fm.GapConductance(0.03, 0.0005)]
pair = fm.ContactPair(
    data, "particle/bottom", "matrix/top", initial_gap=-2e-4, fluxes=[fm.Conductance(1, conduction)]
)
rollers = [(f"{body}/{side}", 0.0, i) for body in MATERIALS for side, i in SIDES.items()]
bcs = [fm.dirichlet(W.sub(0), data, *roller) for roller in rollers]
bcs += [fm.dirichlet(W.sub(1), data, "matrix/bottom", outside)]
problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="particle_")
contact, course, time = problem.contacts[0], [], 0.003 * np.arange(240)
for number in range(time.size):
    outside.value = 300.0 if 5 <= number < 60 else 0.0
    problem.solve()
    w_old.x.array[:] = w.x.array
    flux = contact.fluxes[0]
    course.append((contact.pressure.mean(), 1e3 * contact.gap.mean(), flux.into_slave / 1e3))
    if number == 40:
        shown = {"label": "temperature [K]", "units": ("mm", "MPa"), "cmap": "inferno"}
        fm.plot(problem, "results/particle_field.png", stress=T, scale=20, **shown)
pressure, gap, watts = np.array(course).T
# -

# ## Result

# +
if comm.rank == 0:
    print(f"largest gap {gap.max():.2f} um, heat flow through it up to {watts.max():.2f} W / mm")
    print(f"pressure before {pressure[0]:.2f} MPa, and after {pressure[-1]:.2f} MPa")
    axes = (figure := Figure((6, 3.6), layout="constrained")).subplots(2, sharex=True)
    axes[0].plot(time, pressure, "C0", time, gap, "C2")
    axes[0].legend(["pressure [MPa]", "gap [um]"], frameon=False)
    axes[1].plot(time, watts, "C1")
    axes[1].set(xlabel="time [s]", ylabel="into particle [W / mm]")
    figure.savefig("results/particle.png", dpi=150)
assert gap.max() > 5.0 and pressure[5:60].max() == 0.0 and np.isclose(*pressure[[0, -1]], 0.01)
# -
