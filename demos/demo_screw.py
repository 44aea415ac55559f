# # A screw under load, turned up and down against friction
#
# This demo shows contact of helical surfaces that turn on each other, and friction that reverses.
#
# ## Problem
# A nut with one turn of a square thread, radii 4 and 5 mm, sits on two turns of a screw of pitch
# 3 mm. It is pressed down, turned by 0.3 rad so that it climbs, and back. The load W and the
# friction coefficient $\mu = \tan \rho$ give the torque of a ring of radius r on a helix of slope
# $\tan \alpha = P / (2 \pi r)$:
#
# $$T = W r \tan(\alpha + \rho) \text{ upwards}, \qquad
# T = W r \tan(\alpha - \rho) \text{ downwards}.$$
#
# The thread of the screw is held on its inside, that of the nut on its outside.
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

comm, E, nu, mu, pitch = MPI.COMM_WORLD, 200e3, 0.3, 0.15, 3.0
# -


# +
def thread(start, turns, low, high):
    def position(s, t, r):
        angle, radius = 2 * np.pi * (start + turns * s), 4.0 + t
        z = pitch * angle / (2 * np.pi) + low + (high - low) * r
        return radius * np.cos(angle), radius * np.sin(angle), z

    return position


screw = Box("screw", mapped((60, 4, 2), thread(0.0, 2.0, -1.2, 0.0)))
nut = Box("nut", mapped((31, 4, 2), thread(0.4, 1.0, 0.0, 1.2)))
data = mesh([screw, nut], comm=comm)
V = fm.vector_space(data.mesh, 1)
u, v, turned = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
P = ufl.diff(psi, F)
residual = ufl.inner(P, ufl.grad(v)) * ufl.dx(degree=3)
bcs = [fm.dirichlet(V, data, "screw/front", np.zeros(3))]
bcs += [fm.dirichlet(V, data, "nut/back", turned)]
pair = fm.ContactPair(data, slave="nut/bottom", master="screw/top", law=fm.Coulomb(mu))
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="screw_")
# -

# ## Load steps
# The nut moves down by 0.005 mm; then it turns and climbs by the pitch.

# +
rows, way = [], [0.0, *np.linspace(0.0, 0.3, 9), *np.linspace(0.3, 0.15, 5)]
for angle in way:
    c, s, climb = np.cos(angle) - 1, np.sin(angle), pitch * angle / (2 * np.pi) - 0.005
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 0.0]])
    turned.interpolate(lambda x, turn=turn, up=climb: turn @ x + [[0.0], [0.0], [up]])
    report = problem.solve()
    on_nut = problem.reaction("nut/back")
    rows.append((-on_nut.force[2], on_nut.moment[2], report.num_iterations))
load, torque, iterations = np.array(rows).T
contact = problem.contacts[0]
f = contact.forces[:, 2]
radius = f @ np.hypot(*contact.positions[:, :2].T) / f.sum()
alpha, rho = np.arctan(pitch / (2 * np.pi * radius)), np.arctan(mu)
theory = radius * np.tan([alpha + rho, alpha - rho])
found = torque[[9, -1]] / load[[9, -1]]
if comm.rank == 0:
    print(f"iterations {iterations.astype(int)}")
    print(f"torque over load [mm]: upwards {found[0]:.4f}, downwards {found[1]:.4f}")
    print(f"theory, at r = {radius:.3f} mm: {theory[0]:.4f}, {theory[1]:.4f}")
figure = Figure((11, 4.5), layout="constrained")
places = figure.add_gridspec(1, 2, width_ratios=[3, 2])
left = figure.add_subplot(places[0], projection="3d", elev=22, azim=-60)
right = figure.add_subplot(places[1], xlabel="angle [rad]", ylabel="torque over load [mm]")
shown = {"label": "norm of the deviatoric stress [MPa]", "units": ("mm", "MPa")}
right.plot(way, torque / load, "o-")
right.hlines(theory, 0, 0.3, "k", "dashed")
stress = ufl.sqrt(ufl.inner(ufl.dev(P), ufl.dev(P)))
fm.plot(problem, "results/screw.png", stress=stress, ax=left, **shown)
# -

# ## Check

assert np.abs(found - theory).max() < 0.005 * radius
