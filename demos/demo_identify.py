# # Identify friction and stiffness from a force-displacement curve
#
# This demo computes the gradient of a misfit through a load path with sliding contact.
#
# ## Problem
# A block is pressed on another one and sheared: at first most of its nodes stick, in the end all
# slide. The normal force P and the shear force Q on it are known in all steps. Young's modulus E of
# both blocks and the coefficient of friction mu are unknown: they minimize the misfit
#
# $$J = \frac{1}{2} \sum_k (P_k - P_k^\mathrm{measured})^2 + (Q_k - Q_k^\mathrm{measured})^2.$$
#
# The "measured" forces are those of E = 210 and mu = 0.35 here, without noise. L-BFGS-B of scipy
# needs J and its gradient, computed by the adjoint method: one transposed solve per step.
#
# Where all nodes stick, J does not depend on mu: its derivative is zero, and an optimizer that gets
# there reports convergence. The variables are therefore the logarithms of E and mu. The first step
# of L-BFGS-B is at most one long, here a factor e; with mu itself it leads to the upper bound. The
# gradient has a remark if its derivative by mu is zero since all nodes stick.
#
# ## Implementation

# +
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes import two_blocks
from meshes.with_gmsh import gmsh

comm, measured_E, measured_mu, nu = MPI.COMM_WORLD, 210.0, 0.35, 0.3
# -

model = None
if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    model = two_blocks.build(n_upper=8, n_lower=17, layers_upper=6, layers_lower=6)
data = fm.read_gmsh(model, comm)

# E is a constant of the residual, mu a parameter of the law.

# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
E, law = fem.Constant(data.mesh, measured_E), fm.Coulomb(measured_mu)
energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, nu))
residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 2}), u, v)
push = fem.Constant(data.mesh, (0.0, 0.0))
bcs = [fm.dirichlet(V, data, "lower/bottom", np.zeros(2)), fm.dirichlet(V, data, "upper/top", push)]
pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=law)
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="identify_")
unloaded, slides = problem.state(), np.linspace(0.0, 0.06, 13)
forces = [fm.sensitivity.TotalForce(0, axis) for axis in np.eye(2)]
mu = fm.sensitivity.LawParameter(0, "mu")


def misfit(logarithms):  # and its derivatives by the logarithms of E and mu
    E.value, law.mu = np.exp(logarithms)
    problem.restore(unloaded)
    path = fm.sensitivity.RecordedPath(problem)
    for slide in slides:
        push.value[:] = (slide, -0.02)
        problem.solve(predict=False)
        path.record()
    found = fm.gradient(forces, [E, mu], path, over_steps=fm.sensitivity.least_squares(measured))
    history.append(found)
    return found.value, np.array([E.value * found[E], law.mu * found[mu]])


history, measured = [], np.zeros((slides.size, 2))
misfit(np.log([measured_E, measured_mu]))
measured = history.pop().values
start, bounds = np.log([150.0, 0.2]), np.log([(50.0, 1000.0), (0.05, 1.0)])
result = minimize(misfit, start, jac=True, bounds=bounds, tol=1e-20)
# -

# ## Comparison

# +
identified = np.exp(result.x)
errors = np.abs(identified / [measured_E, measured_mu] - 1)
if comm.rank == 0:
    print(f"{len(history)} paths; E and mu {identified}, relative errors {errors}")
    Path("results").mkdir(exist_ok=True)
    axes = Figure((6, 3.2), layout="constrained").add_subplot()
    axes.set(xlabel="displacement [mm]", ylabel="shear force [N/mm]", ylim=(-0.05, 1.5))
    for number, found in enumerate(history, 1):
        axes.plot(slides, -found.values[:, 0], "#c8102e", alpha=number / len(history), lw=1)
    axes.lines[-1].set_label("iterates, the last one darkest")
    axes.plot(slides, -measured[:, 0], "ko", ms=4, label="measured")
    axes.legend(frameon=False)
    axes.figure.savefig("results/identify.png", dpi=150)
# -

# ## Check

assert max(errors) < 1e-6 and not history[-1].remarks
