# # Snap fit: a hook is pushed over a ridge, and pulled out again
#
# This demo shows large sliding with friction in both directions, the balance of work, and how
# little the result depends on which side is the slave.
#
# ## Problem
# An elastic arm with a hook is pushed over a ridge of the same plastic, snaps in, and is pulled out
# (plane strain, neo-Hookean, mu = 0.2). In the end both are undeformed again, so friction has
# dissipated all the work that was done at the end of the arm.
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
from meshes.mapped_grids import Grid, build, mapped
from meshes.with_gmsh import gmsh

comm, E, nu, stroke = MPI.COMM_WORLD, 2000.0, 0.35, 6.0
# -

# Hook and ridge are 1 mm high and overlap by 0.7 mm; their leading sides are gently inclined,
# their back sides steeper. Quadratic cells follow the curves; three quarters of them are at hook
# and ridge.


# +
def bump(x):
    rise = np.clip([x / 4.0, (6.0 - x) / 2.0], 0.0, 1.0)
    return np.prod(rise**2 * (3.0 - 2.0 * rise), axis=0)


def arm(s, t):
    x = np.interp(s, [0.0, 0.75, 1.0], [0.0, 6.0, 14.0])
    return 5.6 - x, 2.2 * t - (1.0 - t) * bump(x)


def base(s, t):
    x = np.interp(s, [0.0, 0.05, 0.8, 1.0], [0.0, 1.0, 7.0, 14.0])
    return x, -4.0 + t * (2.7 + bump(x - 1.0))


if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    build([Grid("arm", mapped(160, 4, arm)), Grid("base", mapped(120, 2, base))], order=2)
data = fm.read_gmsh(gmsh.model, comm)
V = fm.vector_space(data.mesh, 2)
# -

# ## Path
# The left end of the arm, "arm/right", is moved; the force there is the reaction.


# +
def run(slave, master):
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.variable(fm.energies.deformation_gradient(u))
    psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
    residual = ufl.derivative(psi * ufl.dx(degree=4), u, v)
    hand = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "arm/right", hand), fm.dirichlet(V, data, "base/bottom", (0, 0))]
    pair = fm.ContactPair(data, slave, master, law=fm.Coulomb(0.2))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="snap_")
    contact, rows = problem.contacts[0], [(0.0, 0.0, 0.0)]
    stress = (ufl.diff(psi, F) * F.T / ufl.det(F))[0, 0]
    for position in stroke * (1.0 - np.abs(np.linspace(-1.0, 1.0, 81)[1:])):
        hand.value[0] = position
        problem.solve()
        rows.append((position, problem.reaction("arm/right").force[0], contact.friction_work))
        if len(rows) == 54:
            label, units = "axial stress [MPa]", ("mm", "MPa")
            fm.plot(problem, "results/snap_fit.png", stress=stress, label=label, units=units)
    position, force, losses = np.transpose(rows)
    return position, force, np.diff(position) @ (force[1:] + force[:-1]) / 2, losses.sum()


hook, ridge = run("arm/bottom", "base/top"), run("base/top", "arm/bottom")
# -

# ## Comparison

# +
if comm.rank == 0:
    axes = Figure((6, 3.2), layout="constrained").add_subplot(ylabel="force on the arm [N/mm]")
    axes.set_xlabel("displacement of the arm [mm] (upper curves: in, lower curves: out)")
    for (position, force, work, loss), style, name in ((hook, "-", "hook"), (ridge, "--", "ridge")):
        print(f"slave {name}: push {force.max():.3f}, pull {-force.min():.3f} N/mm", end="; ")
        print(f"work {work:.4f} N, of friction {loss:.4f} N")
        axes.plot(position, force, style, label=f"slave: {name}")
    axes.legend()
    axes.figure.savefig("results/snap_fit_forces.png", dpi=150)
# -

# ## Check
# Friction accounts for all work. The peak forces depend on the facets and differ by some per cent.

assert max(abs(work / loss - 1) for _, _, work, loss in (hook, ridge)) < 0.01
assert abs(hook[2] / ridge[2] - 1) < 0.01 and abs(hook[1].min() / ridge[1].min() - 1) < 0.04
