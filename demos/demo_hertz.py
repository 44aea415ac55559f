# # Hertz: a cylinder pressed on a block
#
# This demo compares contact pressure and half-width with the theory of Hertz and draws them.
#
# ## Problem
# A half cylinder of radius $R = 8$ mm is pressed on a block of the same linear elastic material, in
# plane strain, without friction. Hertz's theory gives for a force $P$ per length
#
# $$a = \sqrt{\frac{4 P R}{\pi E^*}}, \qquad p = \frac{2 P}{\pi a} \sqrt{1 - (x/a)^2}, \qquad
# E^* = \frac{E}{2 (1 - \nu^2)}.$$
#
# $P$ is the computed contact force, so the comparison is that of the distribution. The theory is
# for half planes: its own error grows with $a / R$ and is below 1 % here. The computed
# half-width follows from the second moment of the pressure, $\int p x^2 / \int p = a^2 / 4$.
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
from meshes import half_cylinder_on_block
from meshes.with_gmsh import gmsh

comm = MPI.COMM_WORLD
R, E, nu = 8.0, 200.0, 0.3
# -

model = None
if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    model = half_cylinder_on_block.build(
        radius=R, width=48.0, height=24.0, h=0.02, fine=0.5, growth=0.15
    )
data = fm.read_gmsh(model, comm)

# The top of the cylinder goes down without moving sideways, the bottom of the block is fixed.

# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, nu))
residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 1}), u, v)

push = fem.Constant(data.mesh, (0.0, 0.0))
bcs = [fm.dirichlet(V, data, "block/bottom", np.zeros(2))]
bcs += [fm.dirichlet(V, data, "cylinder/top", push)]
contact = fm.ContactPair(data, slave="cylinder/arc", master="block/top")
problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, petsc_options_prefix="hertz_")

for depth in (0.02, 0.04):
    push.value[1] = -depth
    problem.solve()
# -

# ## Comparison

# +
pair = problem.equations.contacts[0]
x, p, weights = pair.operators.x[:, 0], pair.pressure, pair.operators.diagonal
P = pair.total_force[1]
E_star = E / (2 * (1 - nu**2))
a = np.sqrt(4 * P * R / (np.pi * E_star))
p0 = 2 * P / (np.pi * a)
a_mesh = 2 * np.sqrt((weights * p * x**2).sum() / (weights * p).sum())
near = np.abs(x) < 0.7 * a  # the peak from a fit: p^2 is linear in x^2
p0_mesh = np.sqrt(np.polyfit(x[near] ** 2, p[near] ** 2, 1)[1])
if comm.rank == 0:
    print(f"force {P:.4f} N/mm, {pair.active.sum()} nodes in contact, a / R = {a / R:.3f}\n")
    print("| | theory | computed | difference |\n|---|---:|---:|---:|")
    for name, exact, found in (("half-width [mm]", a, a_mesh), ("peak [MPa]", p0, p0_mesh)):
        print(f"| {name} | {exact:.5f} | {found:.5f} | {100 * (found / exact - 1):+.2f} % |")
    Path("results").mkdir(exist_ok=True)
    figure = Figure((6, 3.2), layout="constrained")
    axes = figure.add_subplot(xlabel="x [mm]", ylabel="contact pressure [MPa]", xlim=(-0.5, 0.5))
    axes.set_title(f"Half cylinder on block, {P:.2f} N/mm", fontsize=10)
    angle = np.linspace(0, np.pi, 200)
    axes.plot(a * np.cos(angle), p0 * np.sin(angle), "k-", lw=1, label="Hertz")
    axes.plot(x, p, "o", ms=3, color="#c8102e", label="computed, at the slave nodes")
    axes.legend(frameon=False)
    figure.savefig("results/hertz.png", dpi=150)
# -

# ## Check

assert abs(a_mesh / a - 1) < 0.02 and abs(p0_mesh / p0 - 1) < 0.02
