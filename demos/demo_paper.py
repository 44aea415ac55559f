# # The experiment of Foltyn and Vlach
#
# This demo repeats the static problem of L. Foltyn, O. Vlach: *Implementation of full linearization
# in semismooth Newton method for 2D contact problem* (2016), with its Table 1: the saddle-point
# system (Alg. 1), the condensed one (Alg. 2) and the fixed-point iteration, in which D, M and n are
# not linearized.
#
# ## Problem
# The paper specifies 10 x 10 elements in the slave body, 20 x 10 in the master body, displacements
# prescribed on the upper halves of the slave's sides and on the master's bottom, and a tolerance
# of 1e-9. It gives neither dimensions nor material nor load; those below are ours, so only the
# decay of the residuals can be compared. Our norms are relative to the contact force.
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
from meshes import two_blocks
from meshes.with_gmsh import gmsh

comm = MPI.COMM_WORLD
PAPER = {
    "Alg. 1": "6.13e+01 6.53e-01 5.62e-04 3.17e-07 8.08e-10",
    "Alg. 2": "6.13e+01 6.53e-01 5.62e-04 3.17e-07 7.85e-10",
    "fixed point": "6.00e+04 3.3 2.97 3.3e-3 3.13e-4 7.38e-6 4.75e-7 1.92e-8 1.01e-9 4.54e-11",
}
# -

model = None
if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    model = two_blocks.build(split=True)
blocks = fm.read_gmsh(model, comm)
if comm.rank == 0:
    gmsh.finalize()


# The upper halves of the slave's sides go down by 0.05 of its width; the bodies are compressible
# neo-Hookean in plane strain with the Lame parameters of E = 1000, nu = 0.3.


# +
def solve(**switches):
    """Solve from the undeformed state; return the displacement and the record."""
    V = fm.vector_space(blocks.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    psi = fm.energies.neo_hookean(u, mu=385.0, lmbda=577.0)
    residual = ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 3}), u, v)
    bcs = [fm.dirichlet(V, blocks, ["upper/left/top", "upper/right/top"], np.array([0.01, -0.05]))]
    bcs += [fm.dirichlet(V, blocks, "lower/bottom", np.zeros(2))]
    pair = fm.ContactPair(blocks, slave="upper/bottom", master="lower/top")
    options = {"newton": fm.NewtonOptions(residual_tolerance=1e-9), **switches}
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="p_", **options)
    report = problem.solve()
    return u.x.array, np.array(report.residuals[1:]) / report.force


OURS = {"Alg. 1": solve(algorithm="saddle"), "Alg. 2": solve(algorithm="condensed")}
OURS["fixed point"] = solve(linearization="frozen")
# -

# ## Table 1, the paper's beside ours

if comm.rank == 0:
    columns = {f"{name}, paper": PAPER[name].split() for name in PAPER}
    columns |= {f"{name}, ours": [f"{r:.2e}" for r in OURS[name][1]] for name in OURS}
    print("| k | " + " | ".join(columns) + " |\n" + "|---:" * (1 + len(columns)) + "|")
    for k in range(max(len(column) for column in columns.values())):
        cells = [column[k] if k < len(column) else "" for column in columns.values()]
        print(f"| {k + 1} | " + " | ".join(cells) + " |")
    Path("results").mkdir(exist_ok=True)
    axes = Figure((6, 3.2), layout="constrained").add_subplot(yscale="log")
    axes.set(xlabel="iteration", ylabel="residual / force")
    for marker, size, (name, (_, r)) in zip("osx", (9, 4, 6), OURS.items()):
        axes.plot(range(1, 1 + len(r)), r, marker, ls="-", ms=size, mfc="none", label=name)
    axes.legend(frameon=False)
    axes.figure.savefig("results/paper.png", dpi=150)

# ## Check
# Both algorithms have the same iterates; Newton's method converges quadratically, the fixed-point
# iteration linearly.

(u1, full), (u2, condensed), (_, fixed) = OURS.values()
assert np.allclose(u1, u2, rtol=0, atol=1e-12) and np.allclose(full[:-1], condensed[:-1], rtol=1e-6)
assert len(full) <= 6 and (full[1:] <= np.maximum(0.2 * full[:-1] ** 2, 1e-13)).all()
assert len(fixed) >= 2 * len(full)
