# # Hertz: crossed cylinders
#
# This demo compares an elliptic contact in space with the theory of Hertz.
#
# ## Problem
# Two cylinders of radius $R = 40$ mm, whose axes meet at $\omega = 60$ degrees, are pressed
# together by $\delta = 0.01$ mm, without friction. Their distance is $A x^2 + B y^2$, with
#
# $$A = \sin^2(\omega/2) / R, \qquad B = \cos^2(\omega/2) / R.$$
#
# The contact is an ellipse with the axes a and b, eccentricity $e = \sqrt{1 - (b/a)^2}$ and
# pressure $p_0 \sqrt{1 - (x/a)^2 - (y/b)^2}$. With $E^* = E / (2 (1 - \nu^2))$ and the
# complete elliptic integrals $K(e)$ and $E(e)$ (Johnson, chapter 4)
#
# $$\frac{B}{A} = \frac{(a/b)^2 E - K}{K - E}, \qquad A = \frac{p_0 b}{E^* e^2 a^2} (K - E), \qquad
# \delta = \frac{p_0 b K}{E^*}, \qquad F = \tfrac23 \pi a b p_0.$$
#
# The axes that are computed follow from second moments of the forces, $\sum f x^2 = a^2 F / 5$.
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_boxes import Box, mapped, mesh

comm, R, E, nu, omega, depth, size = MPI.COMM_WORLD, 40.0, 200e3, 0.3, np.pi / 3, 0.01, 20.0
# -

# The cells are finest at the origin and follow the axes x and y of the ellipse.


# +
def graded(s):
    return 2.0 * s + (size - 2.0) * s**9


def cylinder(side):
    def position(s, t, r):
        x, y, z = graded(2 * s - 1), 0.5 * graded(2 * t - 1), graded(r if side > 0 else 1 - r)
        distance = y * np.cos(omega / 2) - side * x * np.sin(omega / 2)
        return x, y, side * (z + (1 - z / size) * (R - np.sqrt(R**2 - distance**2)))

    return position


upper = Box("upper", mapped((16, 16, 8), cylinder(1)))
data = mesh([upper, Box("lower", mapped((18, 18, 8), cylinder(-1)))], comm=comm)
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, nu))
residual = ufl.derivative(energy * ufl.dx(degree=3), u, v)
bcs = [fm.dirichlet(V, data, "upper/top", np.array([0.0, 0.0, -depth]))]
bcs += [fm.dirichlet(V, data, "lower/bottom", np.zeros(3))]
pairs = [fm.ContactPair(data, slave="upper/bottom", master="lower/top")]
problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="cylinders_")
problem.solve()
# -

# ## Comparison

# +
A, B, E_star = np.sin(omega / 2) ** 2 / R, np.cos(omega / 2) ** 2 / R, E / (2 * (1 - nu**2))


def ratio(q):  # of B and A, for q = b / a
    K, L = ellipk(1 - q**2), ellipe(1 - q**2)
    return (L / q**2 - K) / (K - L)


q = brentq(lambda q: ratio(q) - B / A, 0.01, 0.999)
K, L = ellipk(1 - q**2), ellipe(1 - q**2)
contact = problem.contacts[0]
f, x, y = contact.forces[:, 2], *contact.positions[:, :2].T
axes = np.sqrt(5 * np.array([f @ x**2, f @ y**2]) / f.sum())
a = (1.5 * f.sum() * (K - L) / (np.pi * E_star * A * (1 - q**2))) ** (1 / 3)
exact, found = (a, q * a, 1.5 * f.sum() / (np.pi * q * a**2)), (*axes, contact.pressure.max())
figure = Figure((11, 4.5), layout="constrained")
left = figure.add_subplot(1, 2, 1, projection="3d", elev=22, azim=-60)
right = figure.add_subplot(1, 2, 2, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
near, angle = (np.abs(x) < 1.6) & (np.abs(y) < 0.8), np.linspace(0, 2 * np.pi, 200)
drawn = right.tricontourf(x[near], y[near], contact.pressure[near], 12, cmap="YlGnBu")
figure.colorbar(drawn, ax=right, label="contact pressure [MPa]", location="bottom")
right.plot(a * np.cos(angle), q * a * np.sin(angle), "k")
fm.plot(problem, "results/crossed_cylinders.png", units=("mm", "MPa"), ax=left)
if comm.rank == 0:
    print("| | Hertz | computed | difference |\n|---|---:|---:|---:|")
    for name, h, c in zip(("a [mm]", "b [mm]", "largest pressure [MPa]"), exact, found):
        print(f"| {name} | {h:.4g} | {c:.4g} | {100 * (c / h - 1):+.1f} % |")
# -

# ## Check

assert np.abs(np.divide(found, exact) - 1).max() < 0.02
