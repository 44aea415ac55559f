# # Brake: the heat of friction in a disc and its pads
#
# In a model of bodies of revolution they slide around the axis, out of the plane. The power of
# friction is then a function of pressure and radius, $\mu\, p\, \omega\, r$.
#
# ## Problem
# An annular pad is pressed on a disc of steel that slows down from 100 rad/s to rest in 4 s.
# The pad takes the share $e_p / (e_p + e_d)$ of the heat, by the effusivities $e = \sqrt{k \rho
# c}$. The mean pressure stays the same; but both bodies expand and press harder where they are hot.
#
# ## Implementation
#
# Units are mm, s, MPa and K. By symmetry half the disc is enough.

# +
from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, mapped, mesh

comm = MPI.COMM_WORLD
friction, omega, piston = 0.35, 100.0, 1.5
disc = Grid("disc", mapped(36, 8, lambda s, t: (60.0 + 60.0 * s, 10.0 * (1 - (1 - t) ** 2))))
pad = Grid("pad", mapped(22, 8, lambda s, t: (75.0 + 35.0 * s, 10.0 + 10.0 * t**2)))
data = mesh([disc, pad], comm=comm)
W = fm.mixed_space(data.mesh, ("Lagrange", 1, (2,)), ("Lagrange", 1))
w, w_old, (v, s) = fem.Function(W), fem.Function(W), ufl.TestFunctions(W)
(u, T), T_old = ufl.split(w), ufl.split(w_old)[1]
# -

# Each body has its own material: Young's modulus, expansion, conductivity, and heat capacity per
# volume.

# +
MATERIALS = {"disc": (210e3, 12e-6, 45.0, 3.6), "pad": (1e3, 10e-6, 5.0, 2.5)}
dx = ufl.dx(subdomain_data=data.cell_tags, metadata={"quadrature_degree": 3})
around, dt = 2 * np.pi * ufl.SpatialCoordinate(data.mesh)[0], fem.Constant(data.mesh, 0.05)
residual, stored = 0, 0
for body, (E, alpha, conductivity, capacity) in MATERIALS.items():
    e = fm.energies.elastic_strain(u, alpha * T, "axisymmetric")
    stress = fm.energies.stress(fm.energies.linear_elastic, e, *fm.energies.lame(E, 0.3))
    work = ufl.inner(stress, fm.energies.elastic_strain(v, geometry="axisymmetric"))
    heat = capacity * (T - T_old) / dt * s + conductivity * ufl.inner(ufl.grad(T), ufl.grad(s))
    residual += around * (work + heat) * dx(data.body_tag(body))
    stored += around * capacity * T * dx(data.body_tag(body))
back = ufl.ds(data.boundary_tag("pad/top"), subdomain_data=data.facet_tags, degree=3)
residual += around * piston * v[1] * back
# -

# The power of friction, and its derivative by the pressure, is a function of the pressures and
# positions at the nodes of the slave; `omega` changes in the loop below.


# +
def power(p, X):
    return friction * p * omega * X[:, 0], friction * omega * X[:, 0]


effusivity = {body: np.sqrt(k * rho_c) for body, (_, _, k, rho_c) in MATERIALS.items()}
share = effusivity["pad"] / sum(effusivity.values())
heat = fm.Conductance(1, fm.PressureConductance(20.0, 10.0), heating=power, share=share)
pair = fm.ContactPair(data, "pad/bottom", "disc/top", fluxes=[heat])
bcs = [fm.dirichlet(W.sub(0), data, "disc/bottom", 0.0, 1)]
options = {"geometry": "axisymmetric", "petsc_options_prefix": "brake_"}
problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, **options)

contact, work, course = problem.contacts[0], 0.0, []
for step in range(1, 81):
    omega = 100.0 * (1.0 - step / 80)
    problem.solve()
    weight = problem.equations.contacts[0].operators.weight  # of nodes, 2 pi r included
    work += float(dt.value) * weight @ contact.fluxes[0].heating
    w_old.x.array[:] = w.x.array
    course.append(contact.pressure)
    if step == 40:
        shown = {"label": "temperature [K]", "units": ("mm", "MPa"), "cmap": "inferno"}
        fm.plot(problem, "results/brake_field.png", stress=T, **shown)
# -

# ## Check
# What is stored is the work of friction: nothing else enters or leaves.

# +
stored = comm.allreduce(fem.assemble_scalar(fem.form(stored)))
if comm.rank == 0:
    print(f"work of friction {work / 1e6:.4f} kJ, heat stored {stored / 1e6:.4f} kJ")
    figure = Figure((6, 3.2), layout="constrained")
    axes = figure.add_subplot(xlabel="r [mm]", ylabel="pressure [MPa]")
    for step in (0, 9, 39, 79):
        axes.plot(contact.positions[:, 0], course[step], label=f"{0.05 * (step + 1):g} s")
    axes.legend(frameon=False)
    figure.savefig("results/brake.png", dpi=150)
assert abs(stored / work - 1) < 1e-9 and course[39].max() > 1.5 * piston
# -
