# # Tied meshes: a finely meshed inclusion in a coarse plate under tension
#
# `TiedPair` joins two bodies whose meshes do not match. It is used beside `ContactPair` in the list
# of pairs.
#
# ## Problem
# A round inclusion of radius 1 mm is ten times as stiff as the plate around it (plane strain,
# linear elastic). The plate is pulled by $T = 1$ MPa in x; by symmetry one quarter is computed.
# In a large plate the stress inside the inclusion is uniform (Goodier 1933), with $\kappa = 3 -
# 4 \nu$, $G'$ of the inclusion and $G$ of the plate,
#
# $$\frac{\sigma_{xx} + \sigma_{yy}}{T} = \frac{G' (\kappa + 1)}{2 G' + G (\kappa - 1)}, \qquad
# \frac{\sigma_{xx} - \sigma_{yy}}{T} = \frac{G' (\kappa + 1)}{\kappa G' + G}.$$
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes import inclusion
from meshes.with_gmsh import gmsh

comm = MPI.COMM_WORLD
nu, G = 0.3, {"inclusion": 1000.0, "plate": 100.0}
# -

# Cells of second order have curved sides. The arc has 24 facets inside and 8 outside.

# +
model = None
if comm.rank == 0:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    model = inclusion.build(width=8.0, n_inclusion=24, n_plate=8, order=2)
data = fm.read_gmsh(model, comm)

V = fm.vector_space(data.mesh, 2)
u, v = fem.Function(V), ufl.TestFunction(V)
strain = fm.energies.strain(u)
dx = ufl.Measure("dx", subdomain_data=data.cell_tags, metadata={"quadrature_degree": 2})
ds = ufl.Measure("ds", subdomain_data=data.facet_tags, metadata={"quadrature_degree": 2})
energy = fm.energies.linear_elastic(strain, 1.0, 2 * nu / (1 - 2 * nu))  # over G
residual = -v[0] * ds(data.boundary_tag("plate/right"))
for name, shear_modulus in G.items():
    residual += ufl.derivative(shear_modulus * energy * dx(data.body_tag(name)), u, v)
# -

# The inclusion is supported by symmetry and by the tie. The end nodes of the tie are prescribed by
# symmetry; their neighbours take over their multipliers.

# +
bcs = [fm.dirichlet(V, data, [f"{body}/left" for body in G], 0.0, component=0)]
bcs += [fm.dirichlet(V, data, [f"{body}/bottom" for body in G], 0.0, component=1)]
tie = fm.TiedPair(data, slave="inclusion/arc", master="plate/arc")
problem = fm.ContactProblem(residual, u, [tie], bcs=bcs, petsc_options_prefix="tied_")
problem.solve()
shown = {"label": "strain in x", "scale": 50.0, "units": ("mm", "MPa")}
fm.plot(problem, "results/tied.png", stress=strain[0, 0], **shown)
# -

# ## Comparison
# The force on the quarter of the inclusion is the stress in it times the radius.

# +
arc, kappa = problem.equations.contacts[0], 3 - 4 * nu
mean = G["inclusion"] * (kappa + 1) / (2 * G["inclusion"] + G["plate"] * (kappa - 1)) / 2
deviator = G["inclusion"] * (kappa + 1) / (kappa * G["inclusion"] + G["plate"]) / 2
exact = np.array([mean + deviator, mean - deviator])
table = fm.contact_table(problem)
if comm.rank == 0:
    print(table)
    print(f"\nstress in the inclusion over T: {arc.total_force.round(4)}, exact {exact.round(4)}")
# -

# ## Check
# The finite width of the plate causes a relative error of about $(1/8)^2$, radius over width.

assert np.abs(arc.total_force - exact).max() < 0.03
assert problem.certificate().violations() == []
