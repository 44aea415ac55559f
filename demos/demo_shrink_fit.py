# # Shrink fit: a hot hub cools on a shaft, and heat flows across what it closes
#
# A temperature is the second part of a mixed function. One line lets it flow across the contact.
#
# ## Problem
# A ring of steel, outer radius $c = 20$ mm, whose bore is 10 um smaller than the shaft of radius
# $b = 10$ mm, is heated by 200 K, put over the cold shaft, and cools in moving air. At first heat
# crosses the air in the gap, then the surfaces that touch, the better the harder they press. In the
# end both are at the temperature of the air, and the pressure is that of Lame (plane stress),
#
# $$p = \frac{D E}{b} \left(\frac{c^2 + b^2}{c^2 - b^2} + 1\right)^{-1}.$$
#
# ## Implementation
#
# Units are mm, s, MPa and K: heat flows in N mm / s, that is mW.

# +
from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh

comm = MPI.COMM_WORLD
b, c, interference, hot = 10.0, 20.0, 0.01, 200.0
E, nu, alpha = 210e3, 0.3, 12e-6
conductivity, capacity, to_air = 45.0, 3.6, 0.2

shaft = Grid("shaft", block(10, 4, width=b, height=5.0))
hub = Grid("hub", block(10, 4, width=c - b, height=5.0, corner=(b, 0.0)))
data = mesh([shaft, hub], comm=comm)
W = fm.mixed_space(data.mesh, ("Lagrange", 1, (2,)), ("Lagrange", 1))
w, w_old, (v, s) = fem.Function(W), fem.Function(W), ufl.TestFunctions(W)
(u, T), T_old = ufl.split(w), ufl.split(w_old)[1]
w_old.sub(1).interpolate(lambda x: hot + 0 * x[0], data.cell_tags.find(data.body_tag("hub")))
# -

# The elastic strain is the one without the expansion. The heat stored in a step `dt` is that of
# the implicit Euler method.

# +
around = 2 * np.pi * ufl.SpatialCoordinate(data.mesh)[0]
dt = fem.Constant(data.mesh, 0.01)
rim = ufl.ds(data.boundary_tag("hub/right"), subdomain_data=data.facet_tags, degree=3)
elastic = fm.energies.elastic_strain(u, alpha * T, "axisymmetric")
stress = fm.energies.stress(fm.energies.linear_elastic, elastic, *fm.energies.lame(E, nu))
work = ufl.inner(stress, fm.energies.elastic_strain(v, geometry="axisymmetric"))
stored = capacity * (T - T_old) / dt * s + conductivity * ufl.inner(ufl.grad(T), ufl.grad(s))
residual = around * (work + stored) * ufl.dx(degree=3) + around * to_air * T * s * rim
# -

# The conductance of closed surfaces grows with the pressure; the air in the gap, and between the
# asperities of closed surfaces, conducts in addition. The hub slides freely.

# +
heat = fm.Conductance(1, [fm.PressureConductance(10.0, 50.0), fm.GapConductance(0.026, 0.003)])
pair = fm.ContactPair(data, "hub/left", "shaft/right", initial_gap=-interference, fluxes=[heat])
supports = [("shaft/left", 0), ("shaft/bottom", 1), ("hub/bottom", 1)]
bcs = [fm.dirichlet(W.sub(0), data, side, 0.0, component) for side, component in supports]
options = {"geometry": "axisymmetric", "petsc_options_prefix": "shrink_"}
problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, **options)
contact, time, course = problem.contacts[0], 0.0, []
while time < 1200.0:
    time += float(dt.value)
    problem.solve()
    flux = contact.fluxes[0]
    course.append((time, contact.pressure.mean(), flux.into_master / 1e3, flux.jump.mean()))
    w_old.x.array[:] = w.x.array
    if len(course) == 20:
        shown = {"label": "temperature [K]", "units": ("mm", "MPa"), "cmap": "inferno"}
        fm.plot(problem, "results/shrink_fit_field.png", stress=T, **shown)
    dt.value *= 1.15 if dt.value < 40.0 else 1.0
time, pressure, watts, jump = np.array(course).T
# -

# ## Comparison

# +
first, lame = (pressure > 0).argmax(), interference * E / (b * ((c**2 + b**2) / (c**2 - b**2) + 1))
if comm.rank == 0:
    print(f"contact after {time[first]:.2f} s, when {watts[first]:.0f} W flow into the shaft")
    print(f"pressure in the end {pressure[-1]:.2f} MPa, by Lame {lame:.2f} MPa")
    axes = (figure := Figure((6, 3.6), layout="constrained")).subplots(2, sharex=True)
    axes[0].semilogx(time, pressure, "C0", [0.01, 1200], [lame, lame], "k:", lw=1)
    axes[0].set_ylabel("pressure [MPa]")
    axes[0].legend(["contact", "Lame"], frameon=False)
    axes[1].semilogx(time, jump, "C3", time, watts, "C1")
    axes[1].set(xlabel="time [s]", ylabel="[K], [W]", ylim=(0, None))
    axes[1].legend(["jump of temperature", "heat flow"], frameon=False)
    figure.savefig("results/shrink_fit.png", dpi=150)
# -

# ## Check
# The heat flow peaks where contact closes.

assert abs(pressure[-1] / lame - 1) < 0.01 and watts.argmax() in (first, first + 1) and first > 20
