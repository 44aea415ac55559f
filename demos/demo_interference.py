# # Interference of a press fit for a given pressure
#
# This demo computes the interference at each node of a press fit that gives a prescribed pressure.
#
# ## Problem
# A hub of steel, outer radius $c = 20$ mm and 40 mm long, sits on a solid shaft of radius $b =
# 10$ mm. With a uniform interference the pressure is largest at the ends of the hub, where fits
# wear by fretting. The target is $p_0 = 100$ MPa in the middle, falling to $p_0 / 5$ at the
# ends,
#
# $$p = p_0 \left(1 - 0.8 \left(\frac{2 z}{40\,\mathrm{mm}}\right)^4\right).$$
#
# The unknown is the interference $D(z)$ at each node of the hub. It minimizes the mean square of
# the difference from that pressure. In a long hub Lame's formula relates both at each point,
#
# $$D = \frac{p b}{E} \left(\frac{c^2 + b^2}{c^2 - b^2} + 1\right).$$
#
# ## Implementation

# +
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh

b, c, length, E, nu, p0 = 10.0, 20.0, 40.0, 210e3, 0.3, 100.0  # mm, MPa
lame = b / E * ((c**2 + b**2) / (c**2 - b**2) + 1)  # interference per pressure
# -

# As in `demo_press_fit`: x is the radius, y runs along the axis.

# +
shaft = Grid("shaft", block(8, 50, width=b, height=80.0, corner=(0.0, -40.0)))
hub = Grid("hub", block(8, 40, width=c - b, height=length, corner=(b, -length / 2)))
data = mesh([shaft, hub])
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
r = ufl.SpatialCoordinate(data.mesh)[0]
strain = fm.energies.strain(u, "axisymmetric")
energy = fm.energies.linear_elastic(strain, *fm.energies.lame(E, nu))
residual = ufl.derivative(2 * np.pi * r * energy * ufl.dx(degree=3), u, v)
conditions = [("shaft/left", 0.0, 0), ("hub/top", 0.0, 1), ("shaft/top", 0.0, 1)]
bcs = [fm.dirichlet(V, data, *condition) for condition in conditions]
pair = fm.ContactPair(data, "hub/left", "shaft/right", initial_gap=-lame * p0)
options = {"geometry": "axisymmetric", "petsc_options_prefix": "interference_"}
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, **options)
# -

# The offset of a node is the interference there. The unknowns of L-BFGS-B are in units of Lame's
# interference for p0.

# +
contact, offset = problem.contacts[0], fm.sensitivity.Offset(0)
z, pressures = contact.positions[:, 1], []
target = p0 * (1 - 0.8 * (2 * z / length) ** 4)
objective = fm.sensitivity.PressureFunctional(
    0, lambda p: ((p - target) / p0) ** 2, lambda p: 2 * (p - target) / p0**2
)


def misfit(interference):  # the misfit and its derivatives
    contact.offset = lame * p0 * interference
    problem.solve()
    pressures.append(contact.pressure)
    found = fm.gradient(objective, offset, problem)
    return found.value, lame * p0 * found[offset]


result = minimize(misfit, np.ones(z.size), jac=True, method="L-BFGS-B", options={"ftol": 1e-11})
# -

# ## Comparison

# +
found, error = 1e3 * lame * p0 * result.x, np.abs(pressures[-1] / target - 1).max()
middle = np.abs(found / (1e3 * lame * target) - 1)[np.abs(z) < length / 8].max()
if data.mesh.comm.rank == 0:
    print(f"{len(pressures)} solves: largest relative error of the pressure {error:.1e}")
    print(f"in the middle {found[z.size // 2]:.2f} um, by Lame {1e3 * lame * p0:.2f} um")
    Path("results").mkdir(exist_ok=True)
    left, right = (figure := Figure((9, 3.4), layout="constrained")).subplots(1, 2)
    left.set(xlabel="z [mm]", ylabel="contact pressure [MPa]", ylim=(0, 250))
    left.plot(z, pressures[0], "C7.-", z, target, "k", z, pressures[-1], "C3o", ms=4)
    left.legend(["interference of Lame", "target", f"after {len(pressures)} solves"], frameon=False)
    right.set(xlabel="z [mm]", ylabel="interference on the radius [$\\mu$m]", ylim=(0, 14))
    uniform = np.full(z.size, 1e3 * lame * p0)
    right.plot(z, uniform, "C7", z, 1e3 * lame * target, "k--", z, found, "C3o-", ms=4)
    right.legend(["of Lame for $p_0$", "of Lame for the local pressure", "found"], frameon=False)
    figure.savefig("results/interference.png", dpi=150)
# -

# ## Check

assert error < 1e-3 and middle < 0.05
