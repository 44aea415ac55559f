# # Plasticity: a roller leaves an imprint
#
# This demo shows how to
# - write a material with internal variables in UFL,
# - update them after each load step,
# - let a force drive a rigid tool.
#
# ## Problem
# A rigid roller of radius $R$ is pressed on an elastic-plastic block and lifted again (plane
# strain, von Mises, linear hardening, small strains, no friction). As long as the block is
# elastic, the pressure is that of Hertz, with the peak $p_0$ under the force $P$ per length
#
# $$p_0 = \sqrt{\frac{P E^*}{\pi R}}, \qquad E^* = \frac{E}{1 - \nu^2}.$$
#
# It yields first below the surface, at the depth of 0.7 half-widths of the contact, when
# $p_0 = 1.79\,\sigma_y$ (Johnson, *Contact Mechanics*, 1985). The radius is chosen such that the
# half-width is 1 mm then.
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
from meshes.mapped_grids import Grid, mesh

E, nu, sigma_y, hardening = 210e3, 0.3, 500.0, 2e3  # MPa, mm
p0, modulus = 1.79 * sigma_y, E / (1 - nu**2)  # at first yield
R, first_yield = modulus / (2 * p0), np.pi * p0 / 2  # mm, N/mm
# -

# Half of the block, by symmetry. Triangles of degree 1 have one quadrature point: functions of
# degree 0 hold the internal variables, the plastic strain and its length `p`.

# +
x = 0.1 * np.append(np.arange(40), 39 + 560 * np.linspace(0, 1, 21)[1:] ** 3)
y = -60 * np.linspace(1, 0, 41) ** 3.5
data = mesh([Grid("block", np.dstack(np.meshgrid(x, y, indexing="ij")))], cell="triangle")
V, H = fm.vector_space(data.mesh, 1), fm.mixed_space(data.mesh, *4 * [("DG", 0)])
u, v, old, new = fem.Function(V), ufl.TestFunction(V), fem.Function(H), fem.Function(H)
xx, yy, xy, p = ufl.split(old)
# -

# The stress at the end of a step is a function of the displacement and of the internal variables at
# its beginning: elastic, or returned to the yield surface along the radius. `ufl.derivative` of it
# is the consistent tangent.


# +
def in_space(e):
    return ufl.as_tensor([[e[0, 0], e[0, 1], 0], [e[0, 1], e[1, 1], 0], [0, 0, 0]])


mu, lmbda = fm.energies.lame(E, nu)
strain = in_space(fm.energies.strain(u))
s = 2 * mu * ufl.dev(strain - ufl.as_tensor([[xx, xy, 0], [xy, yy, 0], [0, 0, -xx - yy]]))
q = ufl.sqrt(1.5 * ufl.inner(s, s) + 1e-10)  # von Mises stress, if the step were elastic
limit = sigma_y + hardening * p
dp = ufl.conditional(q > limit, (q - limit) / (3 * mu + hardening), 0.0)
flow = 1.5 * dp / q * s
stress = s - 2 * mu * flow + (lmbda + 2 * mu / 3) * ufl.tr(strain) * ufl.Identity(3)
residual = ufl.inner(stress, in_space(fm.energies.strain(v))) * ufl.dx(degree=0)
bcs = [fm.dirichlet(V, data, "block/left", 0.0, 0), fm.dirichlet(V, data, "block/bottom", (0, 0))]
pair = fm.ContactPair(data, "block/top", roller := fm.Circle((0.0, R), R))
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="plasticity_")
values = (xx + flow[0, 0], yy + flow[1, 1], xy + flow[0, 1], p + dp)
updates = [fem.Expression(value, np.array([[1 / 3, 1 / 3]])) for value in values]
# -

# ## Load steps
# The internal variables are updated after each step.


# +
def step(load):
    roller.push(y=-load / 2)  # on half of the block
    problem.solve()
    for i, update in enumerate(updates):
        new.sub(i).interpolate(update)
    old.x.array[:] = new.x.array
    return data.mesh.comm.allreduce(new.split()[3].collapse().x.array.max(), MPI.MAX)


up = first_yield * np.array([*np.arange(0.25, 0.8, 0.25), *np.arange(0.85, 1.3, 0.05), 2, 3, 4])
plastic = [step(load) for load in up]
contact = problem.contacts[0]
peak, loaded = contact.pressure.max() / sigma_y, contact.positions[:, 1].min()
axes = Figure((6, 4.2), layout="constrained").add_subplot()
fm.plot(problem, ax=axes, stress=p, label="accumulated plastic strain", units=("mm", "MPa"))
axes.set(xlim=(0, 5), ylim=(-4, 1))
down = [step(load) for load in up[-1] * np.array([0.75, 0.5, 0.25, 0.1, 0.01])]
imprint = contact.positions[:, 1].min()
# -

# ## Comparison

found = up[np.flatnonzero(plastic)[0]]
if data.mesh.comm.rank == 0:
    Path("results").mkdir(exist_ok=True)
    axes.figure.savefig("results/plasticity.png", dpi=150)
    print(f"first yield at {found:.0f} N/mm, by theory {first_yield:.0f} N/mm")
    print(f"peak pressure over sigma_y {peak:.2f}, elastic {2 * p0 / sigma_y:.2f}")
    print(f"imprint {-1e3 * imprint:.2f} um, under load {-1e3 * loaded:.2f} um")

# ## Check
# The block yields where theory says, keeps an imprint, and unloads elastically.

assert abs(found / first_yield - 1) < 0.1
assert loaded < imprint < 0.0 == down[-1] - plastic[-1]
