# SPDX-License-Identifier: MIT
"""Energy lost by errors of a time step, and its return by means of the impulses that cause them.

Two errors of the trapezoidal rule change the energy. The work of the pressures is

    (f_n + f_(n+1)) . (u_(n+1) - u_n) / 2 = (z_n g_(n+1) - z_(n+1) g_n) / 2

in a step in which a node closes or opens. It should vanish; it is of second order, with the same
sign for most nodes of an impact. The work of nonlinear internal forces should be the difference of
the strain energies, the integral of r(u) . du from u_n to u_(n+1). Lobatto's rule with four points
on the straight line, exact for stresses up to fifth order in the displacement, differs from the
trapezoidal one by d . (u_(n+1) - u_n) with

    d = 5 (r(u_n) - r(u_a) - r(u_b) + r(u_(n+1))) / 12

and the states u_a and u_b at the fractions (1 - 1/sqrt(5)) / 2 and (1 + 1/sqrt(5)) / 2 of the line.

The sum of both over all steps, and of rotations, see ``spin_return``, is the ``energy_deficit``. So
is, without damping, the work of forces on nodes without mass that are not in balance at the start.
After each step it is returned as far as possible: a fraction t of an impulse J is added to the
momentum of the bodies, which changes the energy by t v . J + t^2 J . M^-1 J / 2 and leaves the sum
of momenta unchanged. The first impulse is dt d: with t = 1 internal forces act with their mean
along the step (Quispel & McLaren 2008), with t = 0 by the trapezoidal rule, and errors of t between
0 and 2 are at most as large as its own. The second is that of the pressures, if a pair is closed,
with |t| <= 1. The third changes the amplitude of vibrations, see ``deformation_rate``, the last
one also the rigid motion that pressures change: it returns what the last pressures of an impact
cannot. Other
rigid motions are left out. (Laursen & Love 2002 correct velocities in a similar way for each node.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.inertia import Inertia
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.path.work import Forces
from fenics_mortar.utils.arrays import Array

# Largest relative change of the velocity of deformation and impact in a step, to return energy [1].
# Impacts in steps of a wave's time through a cell rarely need 0.1, longer steps need 0.3. The limit
# is for bodies without vibrations, whose rounding must not grow.
MAX_SCALING = 0.3
# Distance of the inner points of Lobatto's rule from the middle of a step [steps].
LOBATTO = 0.5 / math.sqrt(5.0)


class Impulse(NamedTuple):
    """A change of velocity and the fractions of it that may be added.

    Attributes:
        change: Array of all local dofs [length / time].
        smallest: Smallest fraction [1].
        largest: Largest fraction [1].
    """

    change: Array
    smallest: float
    largest: float


def internal_defect(bulk: Bulk, inertia: Inertia, start: Array, dt: float) -> Array:
    """Force d by which the trapezoidal rule exceeds Lobatto's in a step to the present state.

    Loads are those of the end of the step, and a velocity in the residual is the mean one; terms
    that are linear in the displacement have no part (collective).

    Args:
        bulk: The bodies, in the state at the end of the step.
        inertia: Mass and rates.
        start: Displacement at the start, shape (local dofs,) [length].
        dt: The step [time].

    Returns:
        Forces at the owned dofs [stress length].
    """
    u, end = bulk.values, bulk.values.copy()
    kept, mean = bulk.r.array_r.copy(), (end - start) / dt
    d = np.zeros(bulk.num_owned)
    for weight, fraction in ((1.0, 0.0), (-1.0, 0.5 - LOBATTO), (-1.0, 0.5 + LOBATTO), (1.0, 1.0)):
        place = (1.0 - fraction) * start + fraction * end
        u[:] = place
        if inertia.rate is not None:
            inertia.rate.set(1.0, place - mean)
        bulk.assemble_residual()
        d += 5.0 / 12.0 * weight * bulk.r.array_r[: bulk.num_owned]
    u[:] = end
    bulk.r.array[:] = kept
    return d


def pressure_impulse(
    inertia: Inertia, bulk: Bulk, forces: tuple[Forces, Forces], dt: float
) -> Array | None:
    """Change of velocity by half the impulse of pressures in a step; ``None`` if all are open.

    Args:
        inertia: Mass and rates.
        bulk: The bodies.
        forces: Forces at the start and the end of the step; see ``forces_of``.
        dt: The step [time].

    Returns:
        An array of all local dofs [length / time] (collective).
    """
    for found in reversed(forces):
        pressures = found[1] - found[3]
        if bulk.comm.allreduce(bool(pressures.any()), MPI.LOR):
            return inertia.acceleration_of(0.5 * dt * pressures, bulk.prescribed)
    return None


def return_energy(inertia: Inertia, impulses: Sequence[Impulse], rounding: float) -> None:
    """Add fractions of impulses that return the energy deficit as far as possible (collective).

    Args:
        inertia: Mass and rates, at the end of the step.
        impulses: The impulses, in this order.
        rounding: Energy that counts as zero [stress length^2].
    """
    for change, smallest, largest in impulses:
        energy, velocity = inertia.rates.energy_deficit, inertia.rates.velocity
        if abs(energy) <= rounding:
            return
        power, square = inertia.product(velocity, change), inertia.product(change, change)
        t = min(max(fraction_of_impulse(energy, power, square), smallest), largest)
        inertia.rates = replace(
            inertia.rates,
            velocity=velocity + t * change,
            energy_deficit=energy - (t * power + 0.5 * t**2 * square),
        )


def fraction_of_impulse(energy: float, power: float, square: float) -> float:
    """Smallest fraction t of an impulse that adds an energy: t power + t^2 square / 2.

    Args:
        energy: The energy [stress length^2].
        power: Velocity times impulse [stress length^2].
        square: The impulse's change of velocity times the impulse [stress length^2].

    Returns:
        t; if no t adds the energy, the t that comes closest.
    """
    inside = power**2 + 2.0 * square * energy
    if inside <= 0.0:
        t = -power / square if square > 0.0 else 0.0
    else:
        larger = abs(power) + math.sqrt(inside)
        t = math.copysign(2.0, power) * energy / larger if larger > 0.0 else 0.0
    return t
