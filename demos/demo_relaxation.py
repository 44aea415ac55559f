# # Relaxation: a seal that leaks after some hours
#
# This demo shows how to
# - write a viscoelastic material at finite strains, with history in UFL,
# - take steps of time,
# - compare states before and after a rest.
#
# ## Problem
# A lid squeezes a round tube of rubber by a fifth of its radius (plane strain, no friction) and
# rests. The second Piola-Kirchhoff stress of a neo-Hookean body relaxes as in Simo's model,
#
# $$\mathbf S = g_\infty \mathbf S_0 + \mathbf Q, \qquad
#   \tau \dot{\mathbf Q} + \mathbf Q = (1 - g_\infty)\, \tau\, \dot{\mathbf S}_0,$$
#
# so that all stresses, and the force on the lid, decay from those of the fast squeeze to the part
# $g_\infty + (1 - g_\infty) \exp(-t/\tau)$ while nothing moves. When the lid is lifted fast, the
# seal no longer follows it.
#
# ## Implementation

# +
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import ufl
from dolfinx import fem

import this_clone

import fenics_mortar as fm
from meshes.mapped_grids import Grid, mesh, sector

mu, lmbda, rest, tau = 1.0, 8.0, 0.4, 1.0  # MPa, MPa, 1, h; lengths in mm
squeeze, fast = 0.4, 1e-3  # mm, h
quarter = sector(32, 8, radii=(1.2, 2.0), angles=(0.0, np.pi / 2))
data = mesh([Grid("tube", quarter)], order=2)
V = fm.vector_space(data.mesh, 2)
u, v, dt = fem.Function(V), ufl.TestFunction(V), fem.Constant(data.mesh, fast)
# -

# Two history functions at the quadrature points: the stress $\mathbf Q$ and the elastic stress
# $\mathbf S_0$ at the start of a step. The rule is exact where $\mathbf S_0$ is linear in time. A
# third one keeps the vertical pressure in the tube for the picture: once a step is accepted, the
# expression itself is that of a further step.

# +
Q, before = (fm.quadrature_function(data.mesh, 4, (2, 2)) for _ in range(2))
pressure = fm.quadrature_function(data.mesh, 4)
F = ufl.variable(fm.energies.deformation_gradient(u))
elastic = ufl.inv(F) * ufl.diff(fm.energies.neo_hookean(F, mu, lmbda), F)
decay = ufl.exp(-dt / tau)
viscous = decay * Q + (1 - rest) * (1 - decay) * tau / dt * (elastic - before)
stress = F * (rest * elastic + viscous)
cauchy = stress * F.T / ufl.det(F)
new = [(Q, viscous), (before, elastic), (pressure, -cauchy[1, 1])]
bcs = [fm.dirichlet(V, data, "tube/left", 0.0, 1), fm.dirichlet(V, data, "tube/right", 0.0, 0)]
pair = fm.ContactPair(data, "tube/bottom", lid := fm.Plane((0.0, 2.0), (0.0, -1.0)))
problem = fm.ContactProblem(
    ufl.inner(stress, ufl.grad(v)) * ufl.dx(degree=4), u, [pair], bcs=bcs, history=new,
    petsc_options_prefix="relaxation_",
)  # fmt: skip
# -

# ## Steps of time
# Fast down, hours of rest, and fast up until no force is left.


# +
def step(time, depth):
    dt.value = time
    lid.move(y=-depth)
    problem.solve()
    return -2 * problem.contacts[0].total_force[1]


for depth in np.linspace(0, squeeze, 9)[1:]:
    fresh = step(fast / 8, depth)
figure = Figure((12, 3.6), layout="constrained")
axes = figure.subplots(1, 3)
fm.plot(problem, ax=axes[0], stress=pressure, title="squeezed", limits=(0, 0.6))
times = np.array([0.1, 0.2, 0.3, 0.5, 1, 1.5, 2, 3])
forces = np.array([step(length, squeeze) for length in np.diff(times, prepend=0.0)])
fm.plot(problem, ax=axes[1], stress=pressure, title="after 3 h", limits=(0, 0.6))
lift = 0.0
while step(fast, squeeze - lift) > 0.0:
    lift += squeeze / 40
axes[2].plot(times, forces / fresh, "o-")
axes[2].set(title="force over that of the squeeze", xlabel="time [h]", ylim=(0, 1))
# -

# ## Comparison

exact = rest + (1 - rest) * np.exp(-times / tau)
if data.mesh.comm.rank == 0:
    Path("results").mkdir(exist_ok=True)
    figure.savefig("results/relaxation.png", dpi=150)
    print(f"force on the lid {fresh:.4f} N/mm, after 3 h {forces[-1]:.4f} N/mm")
    print(f"largest error of the decay {np.abs(forces / fresh / exact - 1).max():.1e}")
    print(f"the seal leaks when the lid is lifted by {lift:.2f} mm of {squeeze} mm")

# ## Check
# The force decays as the relaxation function, up to the time of the squeeze; the seal has set.

assert np.abs(forces / fresh / exact - 1).max() < fast / tau
assert 0.2 * squeeze < lift < squeeze
