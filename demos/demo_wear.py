# # A clutch wears: from uniform pressure to uniform wear
#
# This demo changes the shape of a surface from step to step, by `contact.offset`. The law
# `fm.laws.Worn` does so within each step, for any friction in the plane, and admits larger steps.
#
# ## Problem
# A ring with a soft lining, $a = 60$ mm $< r < b = 110$ mm, is pressed on a rotating disk by a
# force $P$. By Archard's law it wears by the depth $k p s$, where $s = 2 \pi r$ is the sliding
# distance of one revolution. Handbooks have two formulas for the torque of a clutch. For a new
# one, with uniform pressure,
#
# $$T = \frac{2}{3} \mu P \frac{b^3 - a^3}{b^2 - a^2},$$
#
# and for one that wears uniformly, because $p = P / (2 \pi (b - a) r)$,
#
# $$T = \mu P \frac{a + b}{2}.$$
#
# The computed torque goes from one to the other. Friction acts out of the meridian plane and does
# not change the pressure, so the computation leaves it out.
#
# ## Implementation

# +
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, build
from meshes.with_gmsh import gmsh

comm, a, b, load, k = MPI.COMM_WORLD, 60.0, 110.0, 1.0, 1e-7  # mm, MPa, mm^2/N

if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    ring = block(30, 15, width=b - a, height=30.0, corner=(a, 0.0))
    disk = block(35, 5, width=70.0, height=12.0, corner=(50.0, -12.0))
    build([Grid("ring", ring), Grid("disk", disk)])
data = fm.read_gmsh(gmsh.model, comm)
# -

# Disk and plate are of steel; the lining, 6 mm thick, has a thousandth of its stiffness. Only
# contact keeps the ring from moving down.


# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
r, y = ufl.SpatialCoordinate(data.mesh)
E, nu = ufl.conditional(ufl.And(y > 0, y < 6), 200, 200e3), 0.3
strain = fm.energies.strain(u, "axisymmetric")
energy = fm.energies.linear_elastic(strain, *fm.energies.lame(E, nu))
residual = ufl.derivative(2 * np.pi * r * energy * ufl.dx(degree=3), u, v)
ds = ufl.ds(subdomain_data=data.facet_tags, degree=3)
residual += 2 * np.pi * r * load * v[1] * ds(data.boundaries["ring/top"])
options = {"geometry": "axisymmetric", "petsc_options_prefix": "wear_"}
options["bcs"] = [fm.dirichlet(V, data, "disk/bottom", (0.0, 0.0))]
pair = fm.ContactPair(data, "ring/bottom", "disk/top")
problem = fm.ContactProblem(residual, u, [pair], **options)
# -

# ## Wear
# After every 100 revolutions the worn depth is removed from the surface. With many more in a step,
# the pressure would oscillate between points that are worn too much and too little.

# +
contact, pressures, torques = problem.contacts[0], [], []
radius = contact.positions[:, 0]
turns = np.arange(0, 5001, 100)
for _ in turns:
    problem.solve()
    pressures.append(contact.pressure)
    torques.append(radius @ contact.forces[:, 1] / 1e3)  # over mu [Nm]
    contact.offset -= k * contact.pressure * 2 * np.pi * radius * 100
# -

# ## Comparison

# +
P = load * np.pi * (b**2 - a**2)
new, worn = P / 1.5e3 * (b**3 - a**3) / (b**2 - a**2), P / 2e3 * (a + b)
theory = P / (2 * np.pi * (b - a) * radius)
if comm.rank == 0:
    print(f"T / mu [Nm]: new {torques[0]:.1f} ({new:.1f}), worn {torques[-1]:.1f} ({worn:.1f})")
    Path("results").mkdir(exist_ok=True)
    left, right = (figure := Figure((9, 3.4), layout="constrained")).subplots(1, 2)
    left.set(xlabel="r [mm]", ylabel="pressure [MPa]", ylim=(0.6, 1.5))
    for step, colour in (0, "#bbbbbb"), (5, "#f4a582"), (15, "#d6604d"), (50, "#67001f"):
        left.plot(radius, pressures[step], "o-", ms=3, color=colour, label=f"{turns[step]} turns")
    left.plot(radius, theory, "k--", label="uniform wear")
    left.legend()
    right.set(xlabel="turns", ylabel="torque / friction coefficient [Nm]", ylim=(2260, 2340))
    right.plot(turns, torques, color="#67001f")
    right.hlines([new, worn], 0, turns[-1], "k", "--")
    right.text(3000, 2330.5, "uniform pressure"), right.text(3000, 2272, "uniform wear")
    figure.savefig("results/wear.png", dpi=150)
# -

# ## Check

assert np.abs(pressures[-1] / theory - 1).max() < 0.005 and abs(torques[-1] / worn - 1) < 5e-4
