# # Two gears under a torque
#
# A bore that moves as a rigid boundary may be turned, or loaded by a torque about its centre: its
# angle is then an unknown of the solve.
#
# ## Problem
# A pinion of 12 teeth turns a wheel of 18 against a torque of 400 N mm/mm, without friction
# (neo-Hookean, plane strain). The flanks are waves and not involutes: speed and torque of the
# driver vary within a pitch. After a pitch the stored energy is the same, so the mean torque of
# the driver is 12 / 18 of that of the wheel, whatever the shape of the teeth.
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
from meshes.mapped_grids import Grid, mapped, mesh

comm = MPI.COMM_WORLD
teeth, height, distance = (12, 18), 1.0, 30.3  # radii of the pitch circles are 12 and 18 mm
E, nu, torque, steps = 1000.0, 0.3, 400.0, 12
# -

# A gear is a ring whose outer radius is a wave, with 16 facets per tooth. A tooth of the pinion
# stands in a gap of the wheel, with play.


# +
def gear(count: int, start: float, centre: float, wave: float) -> np.ndarray:
    def position(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = 2 * np.pi * s + start
        outside = count + wave * np.cos(count * angle)
        r = outside + (0.5 * count - outside) * t
        return centre + r * np.cos(angle), r * np.sin(angle)

    return mapped(16 * count, 8, position)


pinion, wheel = gear(teeth[0], 0.0, 0.0, height), gear(teeth[1], np.pi, distance, -height)
data = mesh([Grid("pinion", pinion, closed=True), Grid("wheel", wheel, closed=True)])
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
F = ufl.variable(fm.energies.deformation_gradient(u))
P = ufl.diff(fm.energies.neo_hookean(F, *fm.energies.lame(E, nu)), F)
residual = ufl.inner(P, ufl.grad(v)) * ufl.dx(degree=3)
# -

# The bores are named "top" in this mesh, the outlines "bottom". No Dirichlet condition is needed:
# the wheel is turned freely by its torque until the teeth meet.

driver = fm.RigidBoundary(data, "pinion/top", pivot=(0.0, 0.0), name="driver")
driven = fm.RigidBoundary(data, "wheel/top", pivot=(distance, 0.0), name="driven")
pair = fm.ContactPair(data, "pinion/bottom", "wheel/bottom")
options = {"remote": [driver, driven], "petsc_options_prefix": "gears_"}
problem = fm.ContactProblem(residual, u, [pair], **options)

# ## One pitch
# `place` has the angle of the wheel, `reaction` the torque of the driver.

# +
driven.push(moment=torque)
angles, found = np.linspace(0.0, 2 * np.pi / teeth[0], steps + 1), []
for angle in angles:
    driver.move(angle=angle)
    problem.solve()
    found.append((driven.place[2] + teeth[0] / teeth[1] * angle, driver.reaction[2]))
shown = {"label": "horizontal stress [MPa]", "units": ("mm", "MPa")}
fm.plot(problem, "results/gears.png", stress=(P * F.T / ufl.det(F))[0, 0], **shown)
error, moment = np.array(found).T
mean = moment[1:].mean()  # periodic: the trapezoidal rule
if comm.rank == 0:
    print(f"mean torque {mean:.1f}, of rigid gears {torque * teeth[0] / teeth[1]:.1f} N mm/mm")
    print(f"torque {moment.min():.1f} to {moment.max():.1f}, after a pitch {moment[-1]:.1f}")
    figure = Figure((6, 3), layout="constrained")
    axes = figure.subplots(1, 2)
    axes[0].plot(np.degrees(angles), np.degrees(error - error[0]), "o-")
    axes[0].set(xlabel="angle of the pinion [deg]", ylabel="transmission error [deg]")
    axes[1].plot(np.degrees(angles), moment, "o-", angles[[0, -1]] * 180 / np.pi, [mean, mean])
    axes[1].set(xlabel="angle of the pinion [deg]", ylabel="torque of the driver [N mm/mm]")
    figure.savefig("results/gears_torque.png", dpi=150)
# -

# ## Check

assert abs(mean * teeth[1] / teeth[0] / torque - 1) < 0.01 and abs(moment[-1] - moment[0]) < 1e-4
