# # The profile of a roller with a uniform contact pressure
#
# This demo optimizes the shape of a rigid body, with the gradient of the pressure under it.
#
# ## Problem
# A rigid roller is pressed on an elastic block, in plane strain and without friction. Under a flat
# profile the pressure would be infinite at the ends, under a circular one it is that of Hertz.
# Which profile gives the pressure $p_0$ at $|x| < a$ and zero beyond? On a half plane it is the
# deflection of the surface by this pressure, with $s = x / a$ and $E^* = E / (1 - \nu^2)$,
#
# $$z = \frac{2 p_0 a}{\pi E^*} \left((1 + s) \ln(1 + s) + (1 - s) \ln(1 - s)\right).$$
#
# Its slope has a logarithmic singularity at the ends. It is the plane counterpart of the
# logarithmic profile that Lundberg (1939) derived for the long and narrow contact of a bearing's
# roller, $z \sim \ln 1 / (1 - s^2)$, which is steeper.
#
# The unknowns are the heights of the points of a spline. L-BFGS-B of scipy minimizes the mean
# square of $(p - p_\mathrm{target}) / p_0$, starting from the circle whose Hertzian half-width
# is $a$.
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
from meshes.mapped_grids import Grid, mesh

E, nu, a, p0 = 210e3, 0.3, 1.0, 1000.0  # MPa, mm
unit = 2 * p0 * a / (np.pi * E / (1 - nu**2))  # of the profile [mm]
# -

# The mesh is half of the block, about 30 a wide and high; x = a is in the middle of a facet.

# +
x = a / 40.5 * np.append(np.arange(50), 49 + 1166 * np.linspace(0, 1, 17)[1:] ** 3)
y = -30 * a * np.linspace(1, 0, 25) ** 3.5
data = mesh([Grid("block", np.stack(np.meshgrid(x, y, indexing="ij"), axis=2))])
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, nu))
residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 2}), u, v)
bcs = [fm.dirichlet(V, data, "block/left", 0.0, 0), fm.dirichlet(V, data, "block/bottom", (0, 0))]
# -

# The load drives the roller; half of it acts on this half of the block. The pressure depends on the
# slopes between the points, and the heights follow from these. The unknowns are the slopes times
# the square roots of their intervals, so that all have about the same effect on the pressure.

# +
at = 1.05 * a * np.sin(np.linspace(0, 1, 13) * np.pi / 2)
number, roots = np.arange(-12, 13), np.sqrt(np.diff(at) / a)  # -1: mirror image of 1


def points(slopes):
    heights = unit * np.append(0.0, np.cumsum(roots * slopes))
    return np.stack([np.sign(number) * at[abs(number)], heights[abs(number)]], axis=1)


circle = np.diff(2 * (at / a) ** 2) / roots
roller = fm.Spline(points(circle))
roller.push(y=-p0 * a)
pair, options = fm.ContactPair(data, "block/top", roller), {"petsc_options_prefix": "profile_"}
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, **options)
contact, shape = problem.contacts[0], fm.sensitivity.ObstacleShape(roller, "points")
nodes, pressures = contact.positions[:, 0], []
objective = fm.sensitivity.PressureFunctional(
    0, lambda p: (p / p0 - (nodes < a)) ** 2, lambda p: 2 / p0 * (p / p0 - (nodes < a))
)


def misfit(slopes):  # the misfit and its derivatives
    shape.set(problem, points(slopes))
    problem.solve()
    pressures.append(contact.pressure / p0)
    found = fm.gradient(objective, shape, problem)
    by_heights = np.bincount(abs(number), unit * found[shape][:, 1])[1:]
    return found.value, roots * np.cumsum(by_heights[::-1])[::-1]


result = minimize(misfit, circle, jac=True, method="L-BFGS-B", options={"maxfun": 30})
# -

# ## Comparison

# +
s, found = np.linspace(0, 1, 400)[:-1], points(result.x)[12:, 1] / unit
plane = (1 + s) * np.log(1 + s) + (1 - s) * np.log(1 - s)
error = np.abs(found - np.interp(at / a, s, plane))[at < a].max()
uneven = np.abs(pressures[-1] - 1)[nodes < 0.99 * a].max()
if data.mesh.comm.rank == 0:
    print(f"{len(pressures)} solves: profile within {error:.1e}, pressure within {uneven:.1e}")
    Path("results").mkdir(exist_ok=True)
    left, right = (figure := Figure((9, 3.4), layout="constrained")).subplots(1, 2)
    left.set(xlabel="x / a", ylabel="pressure / $p_0$", xlim=(0, 1.2), ylim=(0, 1.5))
    left.plot(nodes, np.transpose([pressures[i] for i in (0, 1, -1)]), ".-")
    left.legend(["circle (Hertz)", "first step", f"after {len(pressures)} solves"], frameon=False)
    right.set(xlabel="x / a", ylabel="height / (2 $p_0$ a / $\\pi$ E*)", xlim=(0, 1.1), ylim=(0, 2))
    right.plot(s, 2 * s**2, s, -0.5 * np.log(1 - s**2), "k:", s, plane, "k", at, found, "C2o")
    right.legend(["circle", "Lundberg, long rollers", "theory, plane", "found"], frameon=False)
    figure.savefig("results/profile.png", dpi=150)
# -

# ## Check

assert error < 1e-3 and uneven < 0.005
