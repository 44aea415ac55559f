# # Ironing in three dimensions: a die is pressed into a slab and drawn along it, with friction
#
# This demo shows large sliding in space across many facets, with Coulomb's friction.
#
# ## Problem
# A die with a cylindrical bottom of radius 1.5 mm is pressed 0.4 mm into a slab of 6 x 2.4 x 1.5 mm
# that is a tenth as stiff, and then drawn 2.4 mm along it; mu = 0.2. Both are compressible
# neo-Hookean. Half of both is meshed, up to the symmetry plane y = 0.
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
from meshes.mapped_boxes import Box, block, mapped, mesh

comm, E, nu, mu, R = MPI.COMM_WORLD, 10.0, 0.3, 0.2, 1.5
# -


# +
def die(s, t, r):
    angle = 0.6 * (2 * s - 1)
    x, z = R * np.sin(angle), R * (1 - np.cos(angle))
    return 1.5 + x, 0.8 * t, z + r * (0.8 - z)


slab = block((20, 5, 5), size=(6.0, 1.2, 1.5), corner=(0.0, 0.0, -1.5))
data = mesh([Box("die", mapped((8, 4, 2), die)), Box("slab", slab)], comm=comm)
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
P = ufl.diff(psi, F)
dx = ufl.dx(subdomain_data=data.cell_tags, degree=3)
soft, hard = (dx(data.bodies[name]) for name in ("slab", "die"))
residual = ufl.derivative(psi * soft + 10 * psi * hard, u, v)

tool = fem.Constant(data.mesh, (0.0, 0.0, 0.0))
bcs = [fm.dirichlet(V, data, "slab/bottom", np.zeros(3)), fm.dirichlet(V, data, "die/top", tool)]
bcs += [fm.dirichlet(V, data, "slab/front", 0.0, 1), fm.dirichlet(V, data, "die/front", 0.0, 1)]
pair = fm.ContactPair(data, slave="slab/top", master="die/bottom", law=fm.Coulomb(mu))
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="ironing_")
# -

# ## Load steps
# The path parameter is the distance that the die travels, down and then along [mm].


# +
def move(distance):
    tool.value[:] = (max(distance - 0.4, 0.0), 0.0, -min(distance, 0.4))


def keep(distance, report):
    rows.append((distance, *problem.reaction("die/top").force, report.num_iterations))


rows = []
path = fm.follow_path(problem, move, fm.SteppingOptions(0.1), stop=2.8, on_step=keep)
distance, H, _, N, iterations = np.abs(rows).T
late = distance > 1.5
ratios = (H / N)[late]
if comm.rank == 0:
    print(f"horizontal over vertical force {ratios.mean():.3f} +- {ratios.std():.3f}")
    print(f"{len(rows)} steps, median of the iterations {np.median(iterations):g}")
shown = {"label": "vertical compression [MPa]", "units": ("mm", "MPa")}
figure = Figure((11, 4.5), layout="constrained")
places = figure.add_gridspec(1, 2, width_ratios=[3, 2])
left = figure.add_subplot(places[0], projection="3d", elev=22, azim=-60)
right = figure.add_subplot(places[1], xlabel="way of the die [mm]", ylabel="force on the half [N]")
right.plot(distance, N, distance, H)
right.legend(["vertical", "horizontal"], frameon=False)
stress = -(P * F.T / ufl.det(F))[2, 2]
fm.plot(problem, "results/ironing_in_space.png", stress=stress, ax=left, **shown)
# -

# ## Check
# The die slides. Its force exceeds that of friction because it climbs the side of its groove.

assert mu < ratios.mean() < 1.6 * mu and ratios.std() < 0.05 * mu and np.median(iterations) <= 6
