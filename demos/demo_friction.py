# # Friction: a cylinder pressed on a block and then sheared
#
# This demo compares shear and stick zone with the theory of Cattaneo and Mindlin.
#
# ## Problem
# The half cylinder of the Hertz demo is pressed on the block, with Coulomb's friction, $\mu =
# 0.2$, and then sheared by a force $Q < \mu P$. The edges, $|x| > c$, slide; the middle sticks:
#
# $$c = a \sqrt{1 - \frac{Q}{\mu P}}, \qquad
# q(x) = \mu p(x) - \mu p_0 \frac{c}{a} \sqrt{1 - (x/c)^2} \quad (|x| < c), \qquad
# q(x) = \mu p(x) \quad (|x| > c),$$
#
# with the half-width $a$ and the peak $p_0$ of Hertz. $P$ and $Q$ are the computed forces. The
# theory is for half planes that are pressed together without friction. Few facets are in contact
# and the exact shear has kinks, so the error is several per cent here; on the graded meshes of
# `studies/accuracy/cattaneo.py` it is about 1 %.
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
R, E, nu, friction = 8.0, 200.0, 0.3, 0.2
# -

model = None
if comm.rank == 0:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    model = half_cylinder_on_block.build(
        radius=R, width=48.0, height=24.0, h=0.02, fine=0.5, growth=0.15
    )
data = fm.read_gmsh(model, comm)

# The law is an option of the pair. Slip counts from the last solve: each solve is a load step.

# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, nu))
residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 1}), u, v)

push = fem.Constant(data.mesh, (0.0, 0.0))
bcs = [fm.dirichlet(V, data, "block/bottom", np.zeros(2))]
bcs += [fm.dirichlet(V, data, "cylinder/top", push)]
contact = fm.ContactPair(data, "cylinder/arc", "block/top", law=fm.Coulomb(friction))
problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, petsc_options_prefix="friction_")

for displacement in [*((0.0, -0.004 * k) for k in range(1, 11)), (0.002, -0.04), (0.004, -0.04)]:
    push.value[:] = displacement
    report = problem.solve()
# -

# ## Comparison

# +
pair, node = problem.equations.contacts[0], problem.equations.contacts[0].nodal
P, Q = pair.total_force[1], -pair.total_force[0]
a = np.sqrt(8 * P * R * (1 - nu**2) / (np.pi * E))
c = a * np.sqrt(1 - Q / (friction * P))
x, weights = pair.operators.x[:, 0], pair.operators.weight
x = x - (weights * node.z_n) @ x / (weights @ node.z_n)  # the contact has moved
p, stuck = (2 * P / (np.pi * a**2) * np.sqrt(np.maximum(r**2 - x**2, 0)) for r in (a, c))
exact = friction * (p - stuck)
error = np.sqrt(weights @ (np.abs(node.z_tau) - exact) ** 2 / (weights @ exact**2))
c_mesh = 0.5 * weights[pair.sticking].sum()
if comm.rank == 0:
    print(report.certificate)
    print(f"\nQ / (mu P) = {Q / (friction * P):.3f}, error of the shear in L2: {100 * error:.1f} %")
    print(f"half-width that sticks: theory {c:.4f} mm, computed {c_mesh:.4f} mm")
    Path("results").mkdir(exist_ok=True)
    figure = Figure((6, 3.2), layout="constrained")
    axes = figure.add_subplot(xlabel="x [mm]", ylabel="traction [MPa]", xlim=(-0.5, 0.5))
    axes.plot(x, friction * p, "k--", lw=1, label="mu times Hertz' pressure")
    axes.plot(x, exact, "k-", lw=1, label="Cattaneo and Mindlin")
    axes.plot(x, np.abs(node.z_tau), "o", ms=3, color="#c8102e", label="computed shear")
    axes.legend(frameon=False)
    figure.savefig("results/friction.png", dpi=150)
# -

# ## Check

assert error < 0.1 and abs(c_mesh / c - 1) < 0.05
