# # Plasticity: a roller leaves an imprint
#
# This demo shows how to
# - write a material with history in UFL: its stress and the new values of its history functions,
# - let accepted steps alone update them,
# - draw them.
#
# ## Problem
# A rigid roller of radius $R$ is pressed into an elastic-plastic block and lifted again (plane
# strain, von Mises, linear hardening, small strains, no friction). As long as the block is
# elastic, the pressure is that of Hertz, with the peak $p_0$ under the force $P$ per length
#
# $$p_0 = \sqrt{\frac{P E^*}{\pi R}}, \qquad E^* = \frac{E}{1 - \nu^2}.$$
#
# It yields first below the surface, at the depth of 0.7 half-widths of the contact, when
# $p_0 = 1.79\,\sigma_y$ (Johnson, *Contact Mechanics*, 1985). The radius is chosen such that the
# half-width is 1 mm then. Far beyond, the block flows to the side and piles up beside the roller.
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
from meshes.mapped_grids import Grid, mesh

E, nu, sigma_y, hardening = 210e3, 0.3, 500.0, 500.0  # MPa, mm
p0, modulus = 1.79 * sigma_y, E / (1 - nu**2)  # at first yield
R, first_yield, deepest = modulus / (2 * p0), np.pi * p0 / 2, 0.36  # mm, N/mm, mm
# -

# Half of the block, by symmetry, of quadratic cells with 2 x 2 points of quadrature: plastic flow
# keeps the volume, and with more points, or linear cells, it would lock.

# +
x = 0.66 * np.append(np.arange(16), 15 + 450 * np.linspace(0, 1, 10)[1:] ** 3)
y = -200 * np.linspace(1, 0, 19) ** 4
data = mesh([Grid("block", np.dstack(np.meshgrid(x, y, indexing="ij")))])
V = fm.vector_space(data.mesh, 2)
u, v = fem.Function(V), ufl.TestFunction(V)
plastic = fm.quadrature_function(data.mesh, 2, (3, 3))  # plastic strain at the start of a step
p = fm.quadrature_function(data.mesh, 2)  # its length
# -

# The stress at the end of a step is elastic, or returned to the yield surface along the radius.
# `ufl.derivative` of it is the consistent tangent. The small threshold makes each step start with
# the elastic one, whatever rounding does to stresses on the yield surface.


# +
def in_space(e):
    return ufl.as_tensor([[e[0, 0], e[0, 1], 0], [e[1, 0], e[1, 1], 0], [0, 0, 0]])


mu, lmbda = fm.energies.lame(E, nu)
s = 2 * mu * ufl.dev(in_space(fm.energies.strain(u)) - plastic)
q = ufl.sqrt(1.5 * ufl.inner(s, s) + 1e-10)  # von Mises stress, if the step were elastic
f = q - sigma_y - hardening * p
dp = ufl.conditional(f > 1e-9 * sigma_y, f, 0.0) / (3 * mu + hardening)
flow = 1.5 * dp / q * s
stress = s - 2 * mu * flow + (lmbda + 2 * mu / 3) * ufl.div(u) * ufl.Identity(3)
residual = ufl.inner(stress, in_space(fm.energies.strain(v))) * ufl.dx(degree=2)
bcs = [fm.dirichlet(V, data, "block/left", 0.0, 0), fm.dirichlet(V, data, "block/bottom", (0, 0))]
pair = fm.ContactPair(data, "block/top", roller := fm.Circle((0.0, R), R))
new = [(plastic, plastic + flow), (p, p + dp)]
problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, history=new, petsc_options_prefix="p_")
# -

# ## Load steps
# The roller moves down in steps of about equal growth of the contact, and up.

# +
top, forces, lengths = problem.contacts[0], [], []


def record(time, report):
    forces.append(-2 * top.total_force[1])
    lengths.append(data.mesh.comm.allreduce(p.x.array.sum()))


def follow(set_depth, stop):
    options = fm.SteppingOptions(step=0.03, smallest=1e-3, growth=1.2)
    fm.follow_path(problem, set_depth, options, stop=stop, on_step=record)
    return top.positions[np.argsort(top.positions[:, 0])].T


under = follow(lambda time: roller.move(y=-deepest * time**2), 1.0)
hardness, largest = forces[-1] / (2 * top.positions[top.active, 0].max() * sigma_y), lengths[-1]
free = follow(lambda time: roller.move(y=-deepest * (1 - time)), 0.55)
figure = Figure((8, 6), layout="constrained")
above, below = figure.subplots(2, height_ratios=(1, 2), sharex=True)
above.plot(under[0], 1e3 * under[1], free[0], 1e3 * free[1])
above.set(title="surface under load and unloaded, by the height in um")
fm.plot(problem, ax=below, stress=p, label="accumulated plastic strain", units=("mm", "MPa"))
below.set(xlim=(0, 20), ylim=(-14, 1))
# -

# ## Comparison

found = forces[np.flatnonzero(lengths)[0]]
if data.mesh.comm.rank == 0:
    Path("results").mkdir(exist_ok=True)
    figure.savefig("results/plasticity.png", dpi=150)
    print(f"first yield below {found:.0f} N/mm, by theory at {first_yield:.0f} N/mm")
    print(f"mean pressure {hardness:.2f} sigma_y, of a flat punch {(2 + np.pi) / 3**0.5:.2f}")
    print(f"imprint {-1e3 * free[1].min():.0f} um, pile-up {1e3 * free[1].max():.0f} um")

# ## Check
# The block yields where theory says, unloads almost elastically, keeps an imprint, and piles up.

assert first_yield < 1.1 * found < 1.5 * first_yield
assert largest <= lengths[-1] < 1.01 * largest and top.total_force[1] == 0.0
assert -deepest < free[1].min() < -0.4 * deepest and free[1].max() > 0.01
