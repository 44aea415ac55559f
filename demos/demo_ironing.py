# # Ironing: a round indenter is pressed into a block and drawn along it, with friction
#
# This demo shows finite strain and large sliding with Coulomb's friction, against published forces.
#
# ## Problem
# Shallow ironing (geometry after Yastrebov 2011): an indenter with a round bottom of radius 0.75 mm
# goes down by 1 mm, 0.8 mm of it into a block of 12 x 4 mm that is ten times softer, and slides
# 10 mm along it. Both are compressible neo-Hookean, nu = 0.32, and mu = 0.3.
#
#     python3 demos/demo_ironing.py          steps of 1/8 mm, 40 facets on the block
#     python3 demos/demo_ironing.py 0.02 60  steps as published; the picture shows earlier runs too
#
# ## Implementation

# +
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes import indenter_on_block
from meshes.with_gmsh import gmsh

comm, E, nu = MPI.COMM_WORLD, 689.6, 0.32
step, n = map(float, sys.argv[1:] or (0.125, 40))
# -

model = None
if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    layers = {"layers_block": round(0.3 * n), "layers_indenter": round(0.15 * n)}
    model = indenter_on_block.build(n_block=int(n), n_indenter=2 * round(0.1 * n), **layers)
data = fm.read_gmsh(model, comm)

# +
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
P = ufl.diff(psi, F)
dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 3})
soft, hard = (dx(data.bodies[name]) for name in ("block", "indenter"))
residual = ufl.derivative(psi * soft + 10 * psi * hard, u, v)

fixed, tool = (fem.Constant(data.mesh, (0.0, 0.0)) for _ in range(2))
bcs = [fm.dirichlet(V, data, "block/bottom", fixed), fm.dirichlet(V, data, "indenter/top", tool)]
contact = fm.ContactPair(data, slave="block/top", master="indenter/arc", law=fm.Coulomb(0.3))
problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, petsc_options_prefix="ironing_")
# -

# ## Load steps
# The path parameter is the distance that the indenter travels, down and then along [mm].


# +
def move(distance):
    tool.value[:] = (max(distance - 1.0, 0.0), -min(distance, 1.0))


def keep(distance, report):
    rows.append((distance, *problem.reaction("indenter/top").force, report.num_iterations))
    if np.isclose(distance, 6.0):
        shown = {"label": "vertical compression [MPa]", "units": ("mm", "MPa")}
        fm.plot(problem, "results/ironing.png", stress=-(P * F.T / ufl.det(F))[1, 1], **shown)


rows, options = [], fm.SteppingOptions(step)
path = fm.follow_path(problem, move, options, stop=11.0, on_step=keep)
distance, H, V, iterations = np.abs(rows).T
# -

# ## Comparison
# Six pairs of V and H are published, with the indenter down and 5 mm further [N/mm]. They scatter
# widely; the change with meshes and steps of this computation is much smaller.

# +
positions = (1.0, 1.0, 6.0, 6.0)
bands = (267.9, 332.0), (55.0, 71.0), (337.4, 421.0), (102.1, 188.8)
found = [np.interp(x, distance, force) for x, force in zip(positions, (V, H, V, H))]
if comm.rank == 0:
    print(f"V, H: {np.round(found, 1)} N/mm; iterations a step: {np.median(iterations):g}")
    np.savetxt(f"results/ironing_{n:03.0f}.txt", np.abs(rows))
    axes = Figure((7, 3.5), layout="tight").add_subplot(xlabel="distance [mm]")
    axes.set(ylabel="force [N/mm]", title="Shallow ironing: vertical (V) and horizontal (H) force")
    axes.vlines(positions, *np.transpose(bands), color="lightgray", lw=8, label="published")
    for file, line in zip(sorted(Path("results").glob("ironing_*.txt")), ("--", "-", ":")):
        x, *forces = np.loadtxt(file, usecols=(0, 2, 1)).T
        for force, y, color in zip("VH", forces, ("#1f5fa8", "#c8102e")):
            axes.plot(x, y, line, color=color, label=f"{force}, {int(file.stem[-3:])} facets")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes.figure.savefig("results/ironing_forces.png", dpi=150)
# -

# ## Check

assert all(low < force < high for force, (low, high) in zip(found, bands))
assert path.num_cuts == 0 and np.median(iterations[distance > 1.0]) <= 5
