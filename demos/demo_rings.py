# # Two rings collide in three dimensions
#
# This demo shows
# - impacts of solids, of whole surfaces without a choice of parts,
# - that the momentum, the angular momentum and, but for the work of friction, the energy remain.
#
# ## Problem
# A neo-Hookean ring of radius 1 m and thickness 0.6 m flies obliquely onto another one, which flies
# slowly towards it; nothing holds them. Coulomb's coefficient is 0.3. Units: m, s, kPa, t/m^3.
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
from meshes.mapped_boxes import Box, mapped, mesh

comm, mu = MPI.COMM_WORLD, 0.3
# -

# Rings of boxes whose left and right sides are one: around, and across a square mapped to a disc.


# +
def ring(name, centre, tilt):
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])

    def place(around, p, q):
        square = np.stack([2 * p - 1, 2 * q - 1])
        far, distance = np.abs(square).max(axis=0), np.linalg.norm(square, axis=0)
        to_disc = far / np.maximum(distance, 1e-12)
        out, up = 0.3 * square * (0.75 - 0.75 * far**2 + far**2 * to_disc)
        x, y = np.cos(2 * np.pi * around), np.sin(2 * np.pi * around)
        on_ring = np.stack([(1 + out) * x, (1 + out) * y, -up])
        return list(np.tensordot(turn, on_ring, 1) + np.reshape(centre, (3, 1, 1, 1)))

    sides = dict.fromkeys(("front", "back", "bottom", "top"), f"{name}/surface")
    return Box(name, mapped((16, 3, 3), place), sides, closed=True)


data = mesh([ring("upper", (0.25, 0.9, 0.95), 0.5), ring("lower", (0, 0, 0), 0.0)], comm=comm)
V = fm.vector_space(data.mesh, 1)
u, v = fem.Function(V), ufl.TestFunction(V)
psi = fm.energies.neo_hookean(u, *fm.energies.lame(100.0, 0.3))
energy = psi * ufl.dx(metadata={"quadrature_degree": 3})
pair = fm.ContactPair(data, "upper/surface", "lower/surface", law=fm.Coulomb(mu))
problem = fm.ContactProblem(ufl.derivative(energy, u, v), u, [pair], petsc_options_prefix="rings_")
motion = fm.Dynamics(problem, density=1.0, energy=energy)
for name, start in (("upper", (0.0, -1.0, -2.0)), ("lower", (0.0, 0.0, 0.5))):
    cells = data.cell_tags.find(data.bodies[name])
    motion.velocity.interpolate(lambda x, start=start: np.outer(start, np.ones(x.shape[1])), cells)
# -

# ## Motion
# They touch at once, rub, and part.

# +
before, records = motion.momentum(), []
figure = Figure((12, 3.4), layout="constrained")
for number, until in enumerate((0.0, 0.45, 1.2)):
    if until:
        records.append(motion.run(until, fm.SteppingOptions(step=0.03)))
    ax = figure.add_subplot(1, 4, number + 1, projection="3d", elev=20, azim=-40)
    fm.plot(problem, ax=ax, units=("m", "kPa"))
    ax.set_title(f"{until:g} s")
    ax.set_axis_off()
change = np.abs(motion.momentum() - before)
steps = [step for record in records for step in record.steps]
start, energies = records[0].start, [step.energies for step in steps]
rubbed = np.cumsum([step.work.shear for step in steps])
parts = [e.kinetic for e in energies], [e.strain for e in energies], rubbed
if comm.rank == 0:
    print(f"largest change of momentum and angular momentum {change.max():.0e}")
    print(f"energy {start.total:.4f} kJ, in the end {energies[-1].total:.4f} kJ")
    print(f"work of friction {rubbed[-1]:.4f} kJ")
    ax = figure.add_subplot(1, 4, 4, xlabel="time [s]", ylabel="energy [kJ]")
    ax.stackplot([step.time for step in steps], *parts, labels=("kinetic", "strain", "friction"))
    ax.legend(loc="lower left")
    Path("results").mkdir(exist_ok=True)
    figure.savefig("results/rings.png", dpi=130)
# -

# ## Check
# Both momenta remain to rounding; the rings have lost what friction took.

assert change.max() < 1e-10 and not problem.contacts[0].active.any()
assert abs(energies[-1].total + rubbed[-1] - start.total) < 1e-5 * start.total
