# # Hot punch: heat across a contact in space
#
# A hot punch is pressed on a cold block and cools on it. It shrinks, so that it presses less and
# less and lets less heat pass: displacement and temperature are solved together.
#
# ## Problem
# A punch of steel, 20 x 20 x 20 mm, has a bottom with a radius of 2 m. It is 100 K hotter than the
# block of 40 x 40 x 15 mm on which it is pressed by 0.015 mm. The interface conducts
# $h (p / p_0)^{0.95}$; no heat leaves the bodies. By symmetry a quarter is enough.
#
# ## Implementation
# Units are mm, s, MPa and K.

# +
from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_boxes import Box, block, mapped, mesh

comm, hot, end = MPI.COMM_WORLD, 100.0, 40.0
E, nu, expansion, k, capacity = 210e3, 0.3, 12e-6, 45.0, 3.6


def crowned(s, t, r):
    x, y = 10.0 * s, 10.0 * t
    return x, y, (1 - r) * (x**2 + y**2) / 4000.0 + 20.0 * r


plate = block((8, 8, 5), size=(20.0, 20.0, 15.0), corner=(0.0, 0.0, -15.0))
data = mesh([Box("punch", mapped((7, 7, 6), crowned)), Box("block", plate)], comm=comm)
W = fm.mixed_space(data.mesh, ("Lagrange", 1, (3,)), ("Lagrange", 1))
w, w_old, (v, s) = fem.Function(W), fem.Function(W), ufl.TestFunctions(W)
(u, T), T_old = ufl.split(w), ufl.split(w_old)[1]
w_old.sub(1).interpolate(lambda x: hot + 0 * x[0], data.cell_tags.find(data.body_tag("punch")))
# -

# Thermal expansion, conduction and stored heat are UFL; one line lets heat flow across the contact.

# +
dx, dt = ufl.dx(subdomain_data=data.cell_tags, degree=3), end / 20
strain = fm.energies.elastic_strain(u, expansion * T)
stress = fm.energies.stress(fm.energies.linear_elastic, strain, *fm.energies.lame(E, nu))
residual = ufl.inner(stress, fm.energies.elastic_strain(v)) * dx
residual += (capacity * (T - T_old) / dt * s + k * ufl.dot(ufl.grad(T), ufl.grad(s))) * dx
heat = fm.Conductance(1, fm.PressureConductance(20.0, pressure=50.0))
pair = fm.ContactPair(data, "punch/bottom", "block/top", fluxes=[heat])
given = [(["punch/left", "block/left"], 0.0, 0), (["punch/front", "block/front"], 0.0, 1)]
given += [("block/bottom", 0.0, 2), ("punch/top", -0.015, 2)]
bcs = [fm.dirichlet(W.sub(0), data, *condition) for condition in given]
problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="punch_")
stored = [fem.form(capacity * T * dx(tag)) for tag in (data.bodies["punch"], data.bodies["block"])]
# -

# ## Time steps
# The picture shows the temperature after 10 s.

# +
contact, passed, course = problem.contacts[0], 0.0, []
figure = Figure((11, 4.5), layout="constrained")
left = figure.add_subplot(1, 2, 1, projection="3d", elev=22, azim=-120)
shown = {"label": "temperature [K]", "units": ("mm", "MPa"), "cmap": "inferno"}
for step in range(1, 21):
    report = problem.solve()
    w_old.x.array[:] = w.x.array
    passed += dt * contact.fluxes[0].into_master
    heats = [comm.allreduce(fem.assemble_scalar(form)) for form in stored]
    means = [heat / capacity / volume for heat, volume in zip(heats, (2000.0, 6000.0))]
    course.append((step * dt, *means, 4e-3 * contact.total_force[2]))
    if step == 5:
        fm.plot(problem, "results/hot_punch.png", stress=T, ax=left, **shown)
# -

# ## Check
# The report of the last step has its iterations and the force. What left the punch has passed the
# contact, and is in the block.

# +
if comm.rank == 0:
    print(report)
    print(f"passed {4e-6 * passed:.4f} kJ, stored in the block {4e-6 * heats[1]:.4f} kJ")
    print(f"force {course[0][3]:.1f} kN after 2 s, {course[-1][3]:.1f} kN after 40 s")
    right = figure.add_subplot(
        1, 2, 2, xlabel="time [s]", ylabel="mean temperature [K], force [kN]"
    )
    for k, name in enumerate(("punch [K]", "block [K]", "force [kN]"), start=1):
        right.plot(*np.array(course).T[[0, k]], label=name)
    right.legend(frameon=False)
    figure.savefig("results/hot_punch.png", dpi=150)
started = hot * capacity * 2000.0
assert abs(passed / heats[1] - 1) < 1e-7 and abs(sum(heats) / started - 1) < 2e-3
# -
