# # A pyramid with a square base is pressed into a block
#
# This demo shows an indenter with edges and a tip, at large strain, on quadratic
# tetrahedra.
#
# ## Problem
# A Vickers pyramid (136 degrees between opposite faces), a thousand times stiffer than the block,
# is pressed in by up to 0.4 mm; a quarter is meshed. As no length but the depth d is given, the
# force is $k E^* d^2$, with the same k at each depth and any strain. For a linear half-space and a
# cone of the same area at each depth, $k = 2 \tan(\alpha) / \pi$ with
# $\pi \tan^2 \alpha = 4 \tan^2 68^\circ$ (Sneddon).
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

comm, E, nu, size, n = MPI.COMM_WORLD, 100.0, 0.3, 8.0, 7
# -

# Cells grow away from the tip. Edges of tetrahedra follow the edge of the pyramid, x = y.


# +
def graded(s):
    return 1.2 * s + (size - 1.2) * s**6


def indenter(s, t, r):
    x, y, z = 0.25 * graded(s), 0.25 * graded(t), 0.25 * graded(r)
    return x, y, z + np.maximum(x, y) / np.tan(np.radians(68.0))


def block(s, t, r):
    return graded(s), graded(t), -graded(1 - r)


counts = {"pyramid": (n - 1, n - 1, 3), "block": (n, n, n)}
shapes = {"pyramid": indenter, "block": block}
boxes = [Box(name, mapped(counts[name], shape)) for name, shape in shapes.items()]
data = mesh(boxes, cell="tetrahedron", comm=comm)
V = fm.vector_space(data.mesh, 2)
u, v = fem.Function(V), ufl.TestFunction(V)
F = ufl.variable(fm.energies.deformation_gradient(u))
psi = fm.energies.neo_hookean(F, *fm.energies.lame(E, nu))
dx = ufl.dx(subdomain_data=data.cell_tags, degree=2)
soft, hard = (dx(data.bodies[name]) for name in ("block", "pyramid"))
residual = ufl.derivative(psi * soft + 1000 * psi * hard, u, v)

push = fem.Constant(data.mesh, (0.0, 0.0, 0.0))
sides = [[f"{name}/{side}" for name in counts] for side in ("left", "front")]
bcs = [fm.dirichlet(V, data, names, 0.0, k) for k, names in enumerate(sides)]
bcs += [fm.dirichlet(V, data, "pyramid/top", push), fm.dirichlet(V, data, "block/bottom", 0.0, 2)]
pair = fm.ContactPair(data, slave="block/top", master="pyramid/bottom")
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="pyramid_")
# -

# ## Load steps
# The picture shows the facets within the limits of its axes.

# +
cone = 4 * np.tan(np.radians(68)) / np.pi**1.5
rows = []
for depth in (0.2, 0.3, 0.4):
    push.value[2] = -depth
    report = problem.solve()
    force = -4 * problem.contacts[0].total_force[2]
    rows.append(force * (1 - nu**2) / E / depth**2)
    if comm.rank == 0:
        print(f"{depth} mm: {force:.2f} N, k {rows[-1]:.3f}, {report.num_iterations} iterations")
if comm.rank == 0:
    print(f"cone, linear: k {cone:.3f}")
P = ufl.diff(psi, F)
shown = {"label": "vertical compression [MPa]", "units": ("mm", "MPa"), "limits": (0.0, 100.0)}
near = {"xlim": (0, 1.99), "ylim": (0, 1.99), "zlim": (-1.2, 2)}
view = {"elev": 18, "azim": -130, "proj_type": "ortho"}
shown["ax"] = Figure((7.0, 5.5), layout="constrained").add_subplot(projection="3d", **near, **view)
fm.plot(problem, "results/pyramid.png", stress=-(P * F.T / ufl.det(F))[2, 2], **shown)
# -

# ## Check
# The force grows with the square of the depth.

assert np.ptp(rows) < 0.05 * rows[-1] and abs(rows[-1] / cone - 1) < 0.15
