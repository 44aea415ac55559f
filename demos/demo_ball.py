# # Hertz: a ball pressed on a flat, on four meshes
#
# This demo shows bodies of revolution on graded meshes, and how fast results converge.
#
# ## Problem
# A ball of radius $R = 8$ mm is pressed on a flat of the same linear elastic material, without
# friction. Hertz's theory gives radius and pressure of the contact under a force $P$:
#
# $$a^3 = \frac{3 P R}{4 E^*}, \qquad p = p_0 \sqrt{1 - (r/a)^2}, \qquad
# p_0 = \frac{3 P}{2 \pi a^2},$$
#
# where $E^* = E / (2 (1 - \nu^2))$: the peak $p_0$ is 3/2 of the mean pressure. $P$ is the computed
# contact force. The computed radius follows from the second moment of the nodal forces,
# $\sum f r^2 = \frac{2}{5} a^2 P$, the computed peak from a linear fit of $p^2$ over $r^2$.
#
# At the edge of the contact the pressure goes to zero like a square root, which the last facet,
# of length $h$, does not resolve: the error of $p$ is of order $\sqrt{h}$ over this length, and
# its root mean square should fall like $h$. Radius and peak depend less on the edge. Errors vary
# with the position of the edge in its facet, so they are averaged over nine loads.
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
from meshes.mapped_grids import Grid, build, mapped
from meshes.with_gmsh import gmsh

comm, R, E, nu, size, meshes = MPI.COMM_WORLD, 8.0, 200e3, 0.3, 4.0, np.array([16, 32, 64, 128])
# -

# The axis is x = 0. Each mesh has n x n cells in the ball, whose lengths grow exponentially away
# from the origin; only the part of the ball below y = 4 mm is meshed. Hertz's theory
# neglects tangential displacements of the surface, and so does `sliding="small"`, with which all
# loads share one factorization.


# +
def graded(s):
    return size * np.sinh(6 * s) / np.sinh(6)


def ball(s, t):
    return graded(s), graded(t) + (1 - graded(t) / size) * (R - np.sqrt(R**2 - graded(s) ** 2))


def run(n):
    if comm.rank == 0:
        gmsh.initialize(["", "-v", "0"])
        flat = mapped(5 * n // 4, n, lambda s, t: (1.5 * graded(s), -1.5 * graded(1 - t)))
        build([Grid("ball", mapped(n, n, ball)), Grid("flat", flat)])
    data = fm.read_gmsh(gmsh.model, comm)
    V, push = fm.vector_space(data.mesh, 1), fem.Constant(data.mesh, 0.0)
    u, v, r = fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(data.mesh)[0]
    strain = fm.energies.strain(u, "axisymmetric")
    energy = fm.energies.linear_elastic(strain, *fm.energies.lame(E, nu))
    residual = ufl.derivative(2 * np.pi * r * energy * ufl.dx(degree=3), u, v)
    given = (["ball/left", "flat/left"], 0.0, 0), ("ball/top", push, 1), ("flat/bottom", 0.0, 1)
    pair = fm.ContactPair(data, "ball/bottom", "flat/top", sliding="small")
    options = {"geometry": "axisymmetric", "petsc_options_prefix": "ball_"}
    options["bcs"] = [fm.dirichlet(V, data, *condition) for condition in given]
    problem = fm.ContactProblem(residual, u, [pair], **options)
    contact, r, rows = problem.contacts[0], problem.contacts[0].positions[:, 0], []
    for push.value in np.linspace(-0.0004, -0.0008, 9):
        problem.solve()
        p, f = contact.pressure, contact.forces[:, 1]
        a = (1.5 * f.sum() * R * (1 - nu**2) / E) ** (1 / 3)
        hertz = 1.5 * f.sum() / (np.pi * a**2) * np.sqrt(1 - np.minimum(r / a, 1) ** 2)
        radius, inner = np.sqrt(2.5 * f @ r**2 / f.sum()), r < 0.7 * a
        peak = np.sqrt(np.polyfit(r[inner] ** 2, p[inner] ** 2, 1)[1])
        w = r * np.gradient(r) / (r * np.gradient(r) @ hertz**2)
        rows.append((np.sqrt(w @ (p - hertz) ** 2), radius / a - 1, peak / hertz[0] - 1))
    return np.sqrt(np.mean(np.square(rows), 0)), r, p, hertz, peak * np.pi * radius**2 / f.sum()


# -

# ## Comparison

# +
errors, r, p, hertz, ratio = zip(*[run(n) for n in meshes])
rates = -np.polyfit(np.log(meshes), np.log(errors), 1)[0]
if comm.rank == 0:
    print(f"{np.array(errors)}\nrates {rates.round(2)}; peak / mean {ratio[-1]:.4f}")
    Path("results").mkdir(exist_ok=True)
    left, right = (figure := Figure((9, 3.4), layout="constrained")).subplots(1, 2)
    left.set(xlabel="r [mm]", ylabel="contact pressure [MPa]", xlim=(0, 0.1))
    left.plot(r[0], p[0], "s", r[1], p[1], "^", r[3], p[3], "o", r[3], hertz[3], "k", ms=4)
    left.legend([*(f"{n} x {n} cells" for n in meshes[[0, 1, 3]]), "Hertz"], frameon=False)
    right.set(xlabel="n, for n x n cells", ylabel="relative error", xlim=(10, 200))
    right.loglog(meshes, errors, "o-", meshes, 2 / meshes, "k--", meshes, 8 / meshes**2, "k:")
    right.legend(["pressure", "radius", "peak", "order 1", "order 2"], frameon=False)
    figure.savefig("results/ball.png", dpi=150)
# -

# ## Check

assert 0.8 < rates[0] < 1.3 and rates[1:].min() > 1.3 and abs(ratio[-1] / 1.5 - 1) < 0.005
