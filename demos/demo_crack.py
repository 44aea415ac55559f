# # Crack: a slit that slides under compression and opens in tension
#
# The two faces of a crack are the two sides of a `ContactPair`. They share the nodes at the tips,
# which carry no multiplier, and have different nodes at the same positions everywhere else.
#
# ## Problem
# A large plate has a slit of half-length $a = 1$ mm, inclined by 37 degrees (plane strain, linear
# elastic). The plate is compressed by 1 MPa in y. The faces are pressed together by $\sigma$ and,
# with Coulomb's friction, slide if the shear $\tau$ exceeds $\mu \sigma$. In an infinite plane, the
# slip at the distance $x$ from the centre is
#
# $$s = \frac{4 (1 - \nu^2)}{E} (\tau - \mu \sigma) \sqrt{a^2 - x^2}.$$
#
# In tension the same formula with $\sigma$ alone gives the opening, and with $\tau$ the slip.
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
from meshes import cracked_plate
from meshes.with_gmsh import gmsh

comm = MPI.COMM_WORLD
E, nu, direction = 100.0, 0.3, np.array([0.8, 0.6])
# -

# gmsh cuts the plate along the slit and meshes both faces. A mesh with a curve in its middle can be
# cut by gmsh's plugin Crack; then both faces have one name.

# +
model = None
if comm.rank == 0:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    model = cracked_plate.build(points=(-direction, direction), width=30.0, height=30.0)
data = fm.read_gmsh(model, comm)

V = fm.vector_space(data.mesh, 2)
u, v = fem.Function(V), ufl.TestFunction(V)
energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, nu))
residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 2}), u, v)
pull = fem.Constant(data.mesh, 0.0)
ds = ufl.Measure("ds", subdomain_data=data.facet_tags, metadata={"quadrature_degree": 2})
residual -= pull * v[1] * ds(data.boundary_tag("plate/top"))
bcs = [fm.dirichlet(V, data, "plate/left", 0.0, component=0)]
bcs += [fm.dirichlet(V, data, "plate/bottom", 0.0, component=1)]
# -

# A list of both faces, as one surface that may touch itself, gives the same result. Strains are
# small here, and the closed form is linear: hence `sliding="small"`.

# +
pair = ["crack/upper", "crack/lower"]
normal, shear = direction[0] ** 2, direction[0] * direction[1]
curves = {}
for what, sides, friction, load in (
    ("opening in tension", pair, 0.0, 1.0), ("slip, mu = 0", pair, 0.0, -1.0),
    ("slip, mu = 0.3", pair, 0.3, -1.0), ("slip, mu = 0.3, one surface", [pair], 0.3, -1.0),
):  # fmt: skip
    u.x.array[:], pull.value = 0.0, load
    contact = fm.ContactPair(data, *sides, law=fm.Coulomb(friction), sliding="small")
    problem = fm.ContactProblem(residual, u, [contact], bcs=bcs, petsc_options_prefix="crack_")
    view = problem.contacts[0]
    x = view.positions @ direction
    problem.solve()
    jump = view.gap if load > 0 else np.where(view.active, np.abs(view.slip), np.nan)
    stress_on_faces = normal if load > 0 else shear - friction * normal
    exact = 4 * (1 - nu**2) / E * stress_on_faces * np.sqrt(np.maximum(1 - x**2, 0.0))
    curves[what] = np.array([x, jump, exact])[:, np.argsort(x)]
# -

# ## Comparison

# +
centres = {what: c[1:, np.nanargmin(c[0] ** 2 + 0 * c[1])] for what, c in curves.items()}
if comm.rank == 0:
    Path("results").mkdir(exist_ok=True)
    figure = Figure((6, 3.4), layout="constrained")
    axes = figure.add_subplot(xlabel="x [mm]", ylabel="slip or opening [mm]")
    for (what, (x, jump, exact)), mark in zip(curves.items(), "sd^x", strict=True):
        print("{}: {:.3f} um, exact {:.3f} um".format(what, *(1e3 * centres[what])))
        axes.plot(x, exact, "k-", lw=0.8)
        axes.plot(x, jump, mark, ms=4, label=what)
    axes.legend(frameon=False, fontsize="small", loc="lower center")
    figure.savefig("results/crack.png", dpi=150)
# -

# ## Check
# The width of the plate changes the result by about $(a / 15\,\mathrm{mm})^2 = 0.4$ %.

assert all(abs(computed / exact - 1) < 0.01 for computed, exact in centres.values())
