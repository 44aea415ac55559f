# SPDX-License-Identifier: MIT
"""Angular momentum lost by bodies in a time step, and its return by rigid rotations.

Closed mortar gaps are zero on average, not at each point, and normals of nodes are not those of
facets: pressures of slave and master have a moment of third order in the length of the facets. The
trapezoidal rule conserves the angular momentum in the middle of equal steps, not that of present
positions and velocities. After each step the velocity of a rigid rotation about the centre of mass
is added to each body, so that

    L_(n+1) - L_n = dt / 2 (T_n + T_(n+1))

with the moments T of loads, internal forces and obstacles, without those exerted by other bodies.
Bodies in contact rotate together. Bodies with prescribed dofs are not corrected, since their
supports exert moments. Linear momentum is already balanced, and is not changed by rotations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_mortar.bulk.bodies import join_bodies, label_bodies
from fenics_mortar.bulk.inertia import Inertia
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array, Flags, Indices


@dataclass(frozen=True, eq=False)
class Balance:
    """Angular momentum of each body and the moments on it, about the origin; equal on all ranks.

    Attributes:
        momentum: Angular momentum, shape (bodies,) [stress length^2 time].
        moment: Moment of all forces except those between bodies, shape (bodies,) [stress length^2].
        touching: Whether a pair exerts forces on a body, shape (pairs, bodies), bool.
        on_obstacle: Whether an obstacle exerts forces on a body, shape (bodies,), bool.
    """

    momentum: Array
    moment: Array
    touching: Flags
    on_obstacle: Flags


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rigid rotations of groups of bodies about their centres of mass.

    Attributes:
        group: Group of each body, shape (bodies,).
        velocity: Velocity at a rotation by one per time, array of all local dofs [length].
        inertia: Moments of inertia, shape (groups,) [stress length^2 time^2].
        free: Whether no dof of a group is prescribed, shape (groups,), bool.
        between_bodies: Whether a group also has no forces from obstacles, (groups,), bool.
    """

    group: Indices
    velocity: Array
    inertia: Array
    free: Flags
    between_bodies: Flags


class SpinReturn:
    """Angular momentum of the bodies and its correction; all methods are collective.

    Args:
        problem: The problem; not axisymmetric.
        inertia: Mass and rates of the bodies.
    """

    def __init__(self, problem: ContactProblem, inertia: Inertia) -> None:
        self._equations, self._inertia = problem.equations, inertia
        self._space = problem.equations.bulk.space
        self._label, self._count = label_bodies(self._space.V)
        marks = problem.equations.bulk.prescribed[self._space.owned_dofs].any(axis=1)
        self._supported = self._sum(marks.astype(float)) > 0.0

    def balance(self) -> Balance:
        """Momenta and moments at the last evaluated state."""
        inertia, owned = self._inertia, self._space.owned_dofs
        rates, x = inertia.rates, self._positions()[: len(owned)]
        rows = [
            _moment(x, inertia.times_mass(values)[owned])
            for values in (rates.velocity, rates.acceleration)
        ]
        contacts = self._equations.contacts
        for contact in contacts:
            force = np.zeros(self._space.num_owned)
            on_slave, on_master = contact.now.forces
            contact.slave.scatter_add(on_slave, force)
            contact.master.scatter_add(on_master, force)
            f = force[owned]
            rows += [_moment(x, f), np.abs(f).sum(axis=1)]
        sums = self._sum(*rows).reshape(-1, self._count)
        meshed = np.array([contact.obstacle is None for contact in contacts], bool)
        moments, sizes = sums[2::2], sums[3::2] > 0.0
        moment = sums[1] + moments[meshed].sum(axis=0)
        return Balance(sums[0], moment, sizes[meshed], sizes[~meshed].any(axis=0))

    def restore(self, before: Balance, after: Balance, dt: float) -> Rotations:
        """Balance the angular momentum at the end of a step.

        The energy added is subtracted from the energy to be returned, see ``energy_return``.

        Args:
            before: Balance at the start of the step.
            after: Balance at its end.
            dt: The step [time].

        Returns:
            The rotations of bodies that touched in the step.
        """
        inertia, rotations = self._inertia, self._rotations(before, after)
        missing = before.momentum + 0.5 * dt * (before.moment + after.moment) - after.momentum
        change = self._rotate(rotations, missing, rotations.free)
        rates = inertia.rates
        added = inertia.product(change, rates.velocity + 0.5 * change)
        inertia.rates = replace(
            rates, velocity=rates.velocity + change, energy_deficit=rates.energy_deficit - added
        )
        return rotations

    def without_spin(self, rotations: Rotations, change: Array, moved: Flags) -> Array:
        """Subtract the rotation from a change of velocity by internal forces or between bodies.

        Args:
            rotations: See ``restore``.
            change: Array of all local dofs [length / time].
            moved: Groups whose angular momentum stays unchanged, shape (groups,), bool.

        Returns:
            The change without angular momentum, likewise.
        """
        x, owned = self._positions(), self._space.owned_dofs
        momentum = self._sum(_moment(x[: len(owned)], self._inertia.times_mass(change)[owned]))
        return change - self._rotate(rotations, momentum, moved)

    def _rotations(self, before: Balance, after: Balance) -> Rotations:
        links = [np.flatnonzero(b | a) for b, a in zip(before.touching, after.touching)]
        pairs = [np.stack([bodies[:-1], bodies[1:]], axis=1) for bodies in links]
        group, count = join_bodies(np.arange(self._count), self._count, pairs)
        space, x = self._space, self._positions()
        one = space.spread(np.ones(len(x)))
        mass = self._inertia.times_mass(one)[space.owned_dofs]
        own = x[: len(mass)]
        sums = self._sum(mass[:, 0], *(mass * own).T).reshape(3, self._count)
        mass_of, *first = (np.bincount(group, row, count) for row in sums)
        r = x - (np.array(first) / mass_of).T[group[self._label]]
        velocity = np.zeros_like(one)
        velocity[space.dofs] = np.stack([-r[:, 1], r[:, 0]], axis=1)
        of_mass = self._inertia.times_mass(velocity)[space.owned_dofs]
        second = self._sum(_moment(r[: len(mass)], of_mass))
        free, obstacles = (
            np.bincount(group, marks, count) == 0.0
            for marks in (self._supported, before.on_obstacle | after.on_obstacle)
        )
        inertia = np.bincount(group, second, count).astype(float)
        return Rotations(group, velocity, inertia, free, free & obstacles)

    def _rotate(self, rotations: Rotations, momentum: Array, moved: Flags) -> Array:
        """Rotations of the groups ``moved`` by angular momenta of the bodies, (local dofs,)."""
        group, inertia = rotations.group, rotations.inertia
        of_groups = np.bincount(group, momentum, len(inertia))
        rate = np.where(moved, of_groups / inertia, 0.0)
        return self._space.spread(rate[group[self._label]]) * rotations.velocity

    def _positions(self) -> Array:
        """Present positions of the local nodes, ghosts included, shape (n, 2) [length]."""
        return self._equations.bulk.positions()

    def _sum(self, *rows: Array) -> Array:
        """Sums of nodal values by body, of the owned nodes of all ranks, (rows times bodies,)."""
        label = self._label[: self._space.num_nodes]
        mine = np.concatenate([np.bincount(label, row, self._count) for row in rows])
        return self._space.V.mesh.comm.allreduce(mine)


def _moment(x: Array, p: Array) -> Array:
    """Moments about the origin of vectors ``p`` (n, 2) at ``x`` (n, 2), shape (n,)."""
    return x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0]
