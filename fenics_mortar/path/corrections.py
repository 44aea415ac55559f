# SPDX-License-Identifier: MIT
"""Corrections of the velocity after a time step, which conserve angular momentum and energy."""

from __future__ import annotations

from dataclasses import replace

from fenics_mortar.bulk.inertia import Inertia
from fenics_mortar.path.deformation_rate import DeformationRate
from fenics_mortar.path.energy_return import (
    MAX_SCALING,
    Impulse,
    internal_defect,
    pressure_impulse,
    return_energy,
)
from fenics_mortar.path.spin_return import Balance, SpinReturn
from fenics_mortar.path.work import Forces, Work
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import ROUNDING


class Corrections:
    """See ``energy_return`` and ``spin_return``; all methods are collective.

    Args:
        problem: The problem.
        inertia: Mass and rates of the bodies.
        conserves: Whether the scheme is the trapezoidal rule. Otherwise it dissipates vibrations,
            and only the energy lost by contact is returned.
    """

    def __init__(self, problem: ContactProblem, inertia: Inertia, *, conserves: bool) -> None:
        self._bulk, self._inertia, self._conserves = problem.equations.bulk, inertia, conserves
        space = self._bulk.space
        self._spin = None if space.is_axisymmetric else SpinReturn(problem, inertia)
        self._deformation = DeformationRate(space, inertia, self._bulk.prescribed)

    def balance(self) -> Balance | None:
        """Angular momentum at the present state; ``None`` with axisymmetry."""
        return None if self._spin is None else self._spin.balance()

    def correct(
        self,
        work: Work,
        dt: float,
        start: Array,
        forces: tuple[Forces, Forces],
        before: Balance | None,
    ) -> None:
        """Return the angular momentum and energy lost in a step.

        Args:
            work: Work done in the step.
            dt: The step [time].
            start: Displacement at its start, shape (local dofs,) [length].
            forces: Forces at its start and end.
            before: Angular momentum at its start.
        """
        bulk, inertia = self._bulk, self._inertia
        energy = work.pressure
        if self._conserves and inertia.rate is None and inertia.rates.time <= dt:
            energy -= work.imbalance  # in the first step; damping is not returned
        internal, pressures = None, pressure_impulse(inertia, bulk, forces, dt)
        if self._conserves and not bulk.is_linear:
            d = internal_defect(bulk, inertia, start, dt)
            moved = (bulk.values - start)[: bulk.num_owned]
            energy += bulk.comm.allreduce(float(d @ moved))
            internal = inertia.acceleration_of(dt * d, bulk.prescribed)
        after = self.balance()
        if self._spin is not None and before is not None and after is not None:
            turns = self._spin.restore(before, after, dt)
            if internal is not None:
                internal = self._spin.without_spin(turns, internal, turns.free)
            if pressures is not None:
                pressures = self._spin.without_spin(turns, pressures, turns.between_bodies)
        rates = inertia.rates
        inertia.rates = replace(rates, energy_deficit=rates.energy_deficit + energy)
        impulses = []
        if internal is not None:
            impulses.append(Impulse(internal, 0.0, 2.0))
        if pressures is not None:
            impulses.append(Impulse(pressures, -1.0, 1.0))
        if self._conserves:
            for found in (None,) if pressures is None else (None, pressures):
                part = self._free_part(rates.velocity, found)
                impulses.append(Impulse(part, -MAX_SCALING, MAX_SCALING))
        return_energy(inertia, impulses, ROUNDING * work.largest)

    def _free_part(self, velocity: Array, pressures: Array | None) -> Array:
        """The part of a velocity that may change in an impact, (local dofs,) [length / time].

        Velocities of deformation, and rigid motions as those caused by the pressures.
        """
        inertia, x = self._inertia, self._bulk.positions()
        part = self._deformation.of(velocity, x)
        if pressures is not None:
            rigid = pressures - self._deformation.of(pressures, x)
            power, square = inertia.product(rigid, velocity), inertia.product(rigid, rigid)
            part += power / square * rigid if square > 0.0 else 0.0
        return part
