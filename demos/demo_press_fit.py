# # Press fit: a hub on a shaft, and the force that pulls it off
#
# Bodies of revolution need only a mesh of their meridian half plane and the option
# `geometry="axisymmetric"`.
#
# ## Problem
# A hub of steel, outer radius $c = 20$ mm and 40 mm long, sits on a solid shaft of radius $b =
# 10$ mm that is 10 um too thick. Then the shaft is pulled, with Coulomb friction, until the hub
# slips. In a long hub an interference $D$ on the radius gives Lame's pressure (plane stress),
#
# $$p = \frac{D E}{b} \left(\frac{c^2 + b^2}{c^2 - b^2} + 1\right)^{-1}.$$
#
# The shaft beyond the hub raises the pressure at the ends of the hub, and contracts where it is
# pulled. Once the whole hub slips, the axial force is the friction limit, $\mu$ times the
# integral of the pressure, $2 \pi b \int p \, dz$.
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
from meshes.mapped_grids import Grid, block, build
from meshes.with_gmsh import gmsh

comm = MPI.COMM_WORLD
b, c, length, interference = 10.0, 20.0, 40.0, 0.01
E, nu, friction = 210e3, 0.3, 0.15
# -

# The axis is x = 0: x is the radius, y runs along the axis. The meshes need not match.

# +
model = None
if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    shaft = Grid("shaft", block(8, 50, width=b, height=80.0, corner=(0.0, -40.0)))
    hub = Grid("hub", block(8, 32, width=c - b, height=length, corner=(b, -length / 2)))
    model = build([shaft, hub])
data = fm.read_gmsh(model, comm)
# -

# The residual is integrated over the whole bodies, $2 \pi r\, dx$, and has the hoop strain $u_r
# / r$.

# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
r = ufl.SpatialCoordinate(data.mesh)[0]
strain = ufl.variable(fm.energies.strain(u, "axisymmetric"))
energy = fm.energies.linear_elastic(strain, *fm.energies.lame(E, nu))
residual = ufl.derivative(2 * np.pi * r * energy * ufl.dx(degree=3), u, v)
# -

# The radial displacement is zero on the axis. The hub rests against a ring at its upper end, where
# the shaft is pulled. The hub is shrunk on: it slides freely until it has cooled.
#
# The mesh has no overlap; the interference is a negative initial gap.

# +
pull, law = fem.Constant(data.mesh, 0.0), fm.Coulomb(0.0)
conditions = [("shaft/left", 0.0, 0), ("hub/top", 0.0, 1), ("shaft/top", pull, 1)]
bcs = [fm.dirichlet(V, data, *condition) for condition in conditions]
pair = fm.ContactPair(data, "hub/left", "shaft/right", law=law, initial_gap=-interference)
options = {"geometry": "axisymmetric", "petsc_options_prefix": "fit_"}
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, **options)
problem.solve()
contact = problem.equations.contacts[0]
z, fitted, force = contact.operators.x[:, 1], contact.pressure, []
shown = {"label": "hoop stress [MPa]", "units": ("mm", "MPa")}
fm.plot(problem, "results/press_fit.png", stress=ufl.diff(energy, strain)[2, 2], **shown)
law.mu = friction
for step in range(1, 9):
    pull.value = 0.004 * step
    problem.solve()
    force.append(problem.reaction("shaft/top").force[1])
# -

# ## Comparison

# +
slides = contact.sliding  # not the node on the ring: prescribed nodes have no friction
limit = friction * contact.operators.weight[slides] @ contact.pressure[slides]
lame = interference * E / (b * ((c**2 + b**2) / (c**2 - b**2) + 1))
middle = fitted[np.abs(z) < length / 4].mean()
if comm.rank == 0:
    print(f"pressure in the middle {middle:.2f} MPa, by Lame {lame:.2f} MPa")
    print(f"force {force[-1] / 1e3:.2f} kN, limit of friction {limit / 1e3:.2f} kN")
    figure = Figure((6, 3.2), layout="constrained")
    axes = figure.add_subplot(xlabel="z [mm]", ylabel="contact pressure [MPa]", ylim=(0, 240))
    axes.plot(z, fitted, "o-", z, contact.pressure, "s-", [-20, 20], [lame, lame], "k-", ms=3)
    axes.legend(["fitted", "slipping", "Lame"], frameon=False)
    figure.savefig("results/press_fit_pressure.png", dpi=150)
# -

# ## Check
# The pressure has an axial component where the shaft is indented.

assert slides.sum() == len(z) - 1 and abs(force[-1] / limit - 1) < 0.01 > abs(middle / lame - 1)
