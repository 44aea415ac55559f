# # Press fit: a hub on a shaft, and the force that pulls it off
#
# Bodies of revolution need the mesh of their meridian half plane only, and one word:
# `geometry="axisymmetric"`.
#
# ## Problem
# A hub of steel, outer radius c = 20 mm and 40 mm long, sits on a solid shaft of radius b = 10 mm
# that is 10 um too thick. Then the shaft is pulled, with Coulomb friction, until the hub slips. In
# a long hub the pressure is that of Lame, of the interference D on the radius (plane stress),
#
# p = D E / (b ((c^2 + b^2) / (c^2 - b^2) + 1)).
#
# The shaft beyond the hub adds to the pressure at its ends. Once all of it slips, the axial force
# is that of friction, mu times the integral of the pressure, 2 pi b int p dz.
#
# ## Implementation

# +
import sys
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

root = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(root)]
import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, build

comm = MPI.COMM_WORLD
b, c, length, interference = 10.0, 20.0, 40.0, 0.01
E, nu, friction = 210e3, 0.3, 0.15
# -

# The axis is x = 0: x is the radius, y runs along the axis. The meshes need not match.

# +
model = None
if comm.rank == 0:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    shaft = block(8, 50, width=b, height=80.0, corner=(0.0, -40.0))
    hub = block(8, 32, width=c - b, height=length, corner=(b, -length / 2))
    model = build([Grid("shaft", shaft), Grid("hub", hub)])
data = fm.read_gmsh(model, comm)
# -

# The residual is integrated over the whole bodies, 2 pi r dx, and has a third strain, u_r / r.

# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
r = ufl.SpatialCoordinate(data.mesh)[0]
mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
strain, hoop = ufl.sym(ufl.grad(u)), u[0] / r
trace = ufl.tr(strain) + hoop
stress = 2 * mu * strain + lmbda * trace * ufl.Identity(2)
hoop_stress = 2 * mu * hoop + lmbda * trace
dx = 2 * np.pi * r * ufl.dx(metadata={"quadrature_degree": 3})
residual = ufl.inner(stress, ufl.grad(v)) * dx + hoop_stress * v[0] / r * dx
# -

# On the axis the radius does not change. The hub leans on a ring at its upper end, the shaft is
# pulled up at its upper end.

# +
pull = fem.Constant(data.mesh, 0.0)
bcs = [
    fm.dirichlet(V, data, "shaft/left", 0.0, component=0),
    fm.dirichlet(V, data, "hub/top", 0.0, component=1),
    fm.dirichlet(V, data, "shaft/top", pull, component=1),
]
law = fm.Coulomb(friction)
pair = fm.ContactPair(data, "hub/left", "shaft/right", law=law, initial_gap=-interference)
problem = fm.ContactProblem(
    residual, u, [pair], bcs=bcs, geometry="axisymmetric", petsc_options_prefix="fit_"
)
contact = problem.equations.contacts[0]
problem.solve()
z, fitted = contact.operators.x[:, 1], contact.pressure
forces = [(0.0, 0.0)]
fm.plot(
    problem, "results/press_fit.png", stress=hoop_stress, label="hoop stress [MPa]", scale=200.0
)
for step in range(1, 13):
    pull.value = 0.004 * step
    problem.solve()
    forces.append((float(pull.value), abs(contact.total_force[1])))
# -

# ## Comparison

# +
lame = interference * E / (b * ((c**2 + b**2) / (c**2 - b**2) + 1))
normal = contact.operators.weight @ contact.pressure
held, last = forces[-2][1], forces[-1][1]
middle = np.abs(z) < length / 4
if comm.rank == 0:
    print("| | by Lame's pressure | computed |\n|---|---:|---:|")
    print(f"| pressure in the middle [MPa] | {lame:.2f} | {fitted[middle].mean():.2f} |")
    by_lame = friction * lame * 2 * np.pi * b * length
    print(f"| force that pulls the hub off [kN] | {by_lame / 1e3:.2f} | {last / 1e3:.2f} |")
    figure = Figure((8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(z, fitted, "o-", ms=3, color="#c8102e", label="fitted")
    left.plot(z, contact.pressure, "s-", ms=2, lw=0.8, color="#1f6f8b", label="slipping")
    left.axhline(lame, color="k", lw=1, label="Lame")
    left.set(xlabel="z [mm]", ylabel="contact pressure [MPa]", ylim=(0, None))
    left.legend(frameon=False)
    right.plot(*(np.array(forces) * [1e3, 1e-3]).T, "o-", ms=3, color="#c8102e")
    right.set(xlabel="pull [um]", ylabel="axial force [kN]", ylim=(0, None))
    figure.savefig("results/press_fit_pressure.png", dpi=150)
# -

# ## Check

assert abs(fitted[middle].mean() / lame - 1) < 0.05
assert abs(last / (friction * normal) - 1) < 1e-8 and abs(last / held - 1) < 0.02
