# # A bolt in a nut: the first thread carries most
#
# This demo shows a pair of surfaces in contact at many points. With linear bulk and small sliding
# all loads share one factorization.
#
# ## Problem
# A bolt of steel, about M10, with a round thread of 1.5 mm is pulled out of its nut, which rests on
# its lower face. Both are bodies of revolution, with rings as threads and without friction. The
# bolt stretches and the nut shortens, so the pitches differ, and the first thread carries most:
# about a third of the load in handbooks, more without friction.
#
# ## Implementation

# +
from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, build, mapped
from meshes.with_gmsh import gmsh

comm, E, nu, pitch, threads = MPI.COMM_WORLD, 210e3, 0.3, 1.5, 7
# -

# The axis is x = 0. The threads of the nut are 0.01 mm wider.


# +
def radius(y):
    return 4.55 - 0.4 * np.sin(2 * np.pi * y / pitch)


def bolt(s, t):
    y = pitch * (-3 + 11 * t)
    return s * radius(y), y


def nut(s, t):
    y = pitch * threads * t
    return 8.0 + (1 - s) * (radius(y) + 0.01 - 8.0), y


if comm.rank == 0:
    gmsh.initialize(["", "-v", "0"])
    build([Grid("bolt", mapped(10, 352, bolt)), Grid("nut", mapped(10, 280, nut))])
data = fm.read_gmsh(gmsh.model, comm)


V = fm.vector_space(data.mesh, 1)
u, v, r = fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(data.mesh)[0]
strain = ufl.variable(fm.energies.strain(u, "axisymmetric"))
energy = fm.energies.linear_elastic(strain, *fm.energies.lame(E, nu))
pull = fem.Constant(data.mesh, 0.0)
ds = ufl.ds(data.boundaries["bolt/bottom"], subdomain_data=data.facet_tags)(degree=3)
residual = ufl.derivative(2 * np.pi * r * energy * ufl.dx(degree=3), u, v)
residual += 2 * np.pi * r * pull * v[1] * ds
bcs = [fm.dirichlet(V, data, "bolt/left", 0.0, 0), fm.dirichlet(V, data, "nut/bottom", 0.0, 1)]
pair = fm.ContactPair(data, "nut/left", "bolt/right", sliding="small")
options = {"geometry": "axisymmetric", "petsc_options_prefix": "thread_"}
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, **options)
# -

# ## Loads

# +
contact = problem.contacts[0]
thread = np.clip(contact.positions[:, 1] // pitch, 0, threads - 1).astype(int)
for pull.value in (100.0, 200.0, 300.0):
    problem.solve()
    load = pull.value * np.pi * radius(-3 * pitch) ** 2
    shares = np.bincount(thread, -contact.forces[:, 1]) / load
    if comm.rank == 0:
        print(f"{load / 1e3:.2f} kN; shares of the threads {shares.round(3)}")
stress, label, units = ufl.diff(energy, strain), "axial stress [MPa]", ("mm", "MPa")
fm.plot(problem, "results/thread.png", stress=stress[1, 1], label=label, units=units, scale=20)
# -

# ## Check
# All threads together carry the load.

assert abs(shares.sum() - 1) < 1e-8 and 0.35 < shares[0] < 0.5 and (np.diff(shares[:-1]) < 0).all()
