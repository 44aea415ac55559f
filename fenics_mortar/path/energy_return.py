# SPDX-License-Identifier: MIT
"""Energy extracted by contact pressures in a time step, returned by means of their impulse.

By the trapezoidal rule the work of the pressures is

    (f_n + f_(n+1)) . (u_(n+1) - u_n) / 2 = (z_n g_(n+1) - z_(n+1) g_n) / 2

in a step in which a node closes or opens. It should vanish; it is of second order, with the same
sign for most nodes of an impact. The sum over all steps is stored as ``energy_deficit``.
After each step with contact it is returned as far as possible: a fraction t of the impulse of the
pressures is added to the momentum of the bodies. This changes the energy by
t v . J + t^2 J . M^-1 J / 2 and leaves the sum of momenta unchanged. Rigid rotations are left out,
see ``spin_return``. (Laursen & Love 2002 correct velocities in a similar way for each node.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from mpi4py import MPI

from fenics_mortar.bulk.inertia import Inertia
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.path.work import Forces, Work
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import ROUNDING


def return_energy(
    inertia: Inertia,
    bulk: Bulk,
    work: Work,
    half: float,
    forces: tuple[Forces, Forces],
    without_spin: Callable[[Array], Array] | None = None,
) -> None:
    """Correct the velocity by a fraction of the impulse of pressures in a step (collective).

    Args:
        inertia: Mass and rates, at the end of the step.
        bulk: The bodies.
        work: Work done in the step.
        half: Half the step [time].
        forces: Forces at its start and its end; see ``forces_of``.
        without_spin: Subtracts rigid rotations from a change of velocity.
    """
    energy_deficit = inertia.rates.energy_deficit + work.pressure
    inertia.rates = replace(inertia.rates, energy_deficit=energy_deficit)
    if abs(energy_deficit) <= ROUNDING * work.largest:
        return
    before, after = forces
    pressures = after[1] - after[3]
    if not bulk.comm.allreduce(bool(pressures.any()), MPI.LOR):
        pressures = before[1] - before[3]
    if not bulk.comm.allreduce(bool(pressures.any()), MPI.LOR):
        return
    change = inertia.acceleration_of(half * pressures, bulk.prescribed)
    if without_spin is not None:
        change = without_spin(change)
    velocity = inertia.rates.velocity
    power, square = inertia.product(velocity, change), inertia.product(change, change)
    t = fraction_of_impulse(energy_deficit, power, square)
    inertia.rates = replace(
        inertia.rates,
        velocity=velocity + t * change,
        energy_deficit=energy_deficit - (t * power + 0.5 * t**2 * square),
    )


def fraction_of_impulse(energy: float, power: float, square: float) -> float:
    """Smallest fraction t of an impulse, up to 1, that adds an energy: t power + t^2 square / 2.

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
    return min(max(t, -1.0), 1.0)
