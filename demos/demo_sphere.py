# # Hertz: a quarter of a sphere pressed on a flat
#
# This demo shows symmetry planes and graded meshes in space, and compares with the theory of Hertz.
#
# ## Problem
# A sphere of radius $R = 100$ mm is pressed on a flat of the same material by $\delta = 0.01$ mm,
# without friction. Hertz's theory gives
#
# $$a = \sqrt{R \delta}, \qquad F = \tfrac43 E^* \sqrt{R \delta^3}, \qquad
# p = \frac{3 F}{2 \pi a^2} \sqrt{1 - (r/a)^2}, \qquad E^* = \frac{E}{2 (1 - \nu^2)}$$
#
# for force, radius and pressure of the contact. The planes x = 0 and y = 0 are planes of symmetry.
# The radius that is computed follows from the second moment of the forces,
# $\sum f r^2 = \frac25 a^2 F$, the peak from a linear fit of $p^2$ over $r^2$.
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
from meshes.mapped_boxes import Box, mapped, mesh

comm, R, E, nu, size, depth, n = MPI.COMM_WORLD, 100.0, 200e3, 0.3, 30.0, 0.01, 12
# -

# The cells grow away from the origin. Only a part of both bodies is meshed, whose size is 30 times
# the radius of the contact; it is a little stiffer than half-spaces are.


# +
def graded(s):
    return 2.0 * s + (size - 2.0) * s**9


def sphere(s, t, r):
    x, y, z = graded(s), graded(t), graded(r)
    return x, y, z + (1 - z / size) * (R - np.sqrt(R**2 - x**2 - y**2))


def flat(s, t, r):
    return 1.1 * graded(s), 1.1 * graded(t), -graded(1 - r)


boxes = [Box("sphere", mapped((n, n, n), sphere)), Box("flat", mapped((n + 3, n + 3, n), flat))]
data = mesh(boxes, comm=comm)
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
strain = ufl.variable(ufl.sym(ufl.grad(u)))
energy = fm.energies.linear_elastic(strain, *fm.energies.lame(E, nu))
residual = ufl.derivative(energy * ufl.dx(degree=3), u, v)
symmetric = [
    ([f"sphere/{side}", f"flat/{side}"], 0.0, k) for k, side in enumerate(("left", "front"))
]
given = *symmetric, ("sphere/top", -depth, 2), ("flat/bottom", 0.0, 2)
bcs = [fm.dirichlet(V, data, *condition) for condition in given]
pair = fm.ContactPair(data, slave="sphere/bottom", master="flat/top")
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="sphere_")
report = problem.solve()
# -

# ## Comparison

# +
contact, E_star = problem.contacts[0], E / (2 * (1 - nu**2))
f, r = contact.forces[:, 2], np.hypot(*contact.positions[:, :2].T)
inner = r < 0.7 * np.sqrt(R * depth)
F = 4 * f.sum()
a = (0.75 * F * R / E_star) ** (1 / 3)
peak = np.sqrt(np.polyfit(r[inner] ** 2, contact.pressure[inner] ** 2, 1)[1])
found = F, np.sqrt(2.5 * f @ r**2 / f.sum()), peak
exact = 4 / 3 * E_star * np.sqrt(R * depth**3), a, 1.5 * F / (np.pi * a**2)
if comm.rank == 0:
    print(f"{contact.active.sum()} nodes in contact, {report.num_iterations} iterations")
    print("| | Hertz | computed | difference |\n|---|---:|---:|---:|")
    for name, h, c in zip(("force [N]", "radius [mm]", "peak [MPa]"), exact, found):
        print(f"| {name} | {h:.4g} | {c:.4g} | {100 * (c / h - 1):+.1f} % |")
shown = {"label": "vertical compression [MPa]", "units": ("mm", "MPa")}
figure = Figure((11, 5), layout="constrained")
places = figure.add_gridspec(1, 2, width_ratios=[3, 2])
near = {"xlim": (0, 2.5), "ylim": (0, 2.5), "zlim": (-2.5, 2.5)}
left = figure.add_subplot(places[0], projection="3d", elev=15, azim=-125, **near)
right = figure.add_subplot(places[1], xlabel="r [mm]", ylabel="contact pressure [MPa]", xlim=(0, 2))
angle = np.linspace(0, np.pi / 2)
right.plot(a * np.cos(angle), exact[2] * np.sin(angle), "k", label="Hertz")
right.plot(r, contact.pressure, "o", label="computed, at the nodes")
right.legend(frameon=False)
stress = -ufl.diff(energy, strain)[2, 2]
fm.plot(problem, "results/sphere.png", stress=stress, ax=left, **shown)
# -

# ## Check
# Radius and peak are those of Hertz for the force that is computed.

error = np.abs(np.divide(found, exact) - 1)
assert error[0] < 0.06 and error[1:].max() < 0.01
