# SPDX-License-Identifier: MIT
"""Corrections of the velocity after a time step, which conserve angular momentum and energy.

**Angular momentum lost by bodies in a time step, and its return by rigid rotations.** Closed mortar
gaps are zero on average, not at each point, and normals of nodes are not those of facets: pressures
of slave and master have a moment of third order in the length of the facets. The trapezoidal rule
conserves the angular momentum in the middle of equal steps, not that of present positions and
velocities. After each step the velocity of a rigid rotation about the centre of mass is added to
each body, so that

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
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.rigid_motion import moments_of, turned
from fenics_mortar.path.report import (
    MAX_SCALING,
    Forces,
    Impulse,
    Work,
    internal_defect,
    pressure_impulse,
    return_energy,
)
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices


class DeformationRate:
    """Velocities without momentum and angular momentum of any body; all methods are collective.

    Args:
        space: The displacement's nodes and dofs.
        inertia: Mass of the bodies.
        prescribed: Marks of the local dofs with prescribed values.
    """

    def __init__(self, space: DisplacementSpace, inertia: Inertia, prescribed: Flags) -> None:
        self._space, self._inertia, self._prescribed = space, inertia, prescribed
        self._label, self._count = label_bodies(space.V)

    def of(self, velocity: Array, x: Array) -> Array:
        """The part of a velocity that is orthogonal, in mass, to rigid motions; 0 if prescribed.

        Args:
            velocity: Array of all local dofs [length / time].
            x: Positions of the local nodes, shape (n, dim) [length].

        Returns:
            An array of all local dofs [length / time].
        """
        space, inertia, size = self._space, self._inertia, self._space.num_owned
        comm, owned = space.V.mesh.comm, space.num_nodes
        centre = comm.allreduce(np.array([*x[:owned].sum(axis=0), owned]))
        r = x - centre[:-1] / centre[-1]
        shifts = np.broadcast_to(np.eye(space.dim)[:, None], (space.dim, *x.shape))
        rigid = shifts[1:] if space.is_axisymmetric else np.concatenate([shifts, turned(r)])
        fields = np.zeros((len(rigid), velocity.size))
        fields[:, space.dofs] = rigid
        momenta = np.array([inertia.times_mass(field) for field in fields])
        rows = [m * v[:size] for m in momenta for v in (*fields, velocity)]
        sums = self._by_body(rows).reshape(len(rigid), len(rigid) + 1, self._count)
        rates = [
            np.linalg.lstsq(body[:, :-1], body[:, -1], rcond=ROUNDING)[0]
            for body in np.moveaxis(sums, 2, 0)
        ]
        weights = np.array(rates).reshape(self._count, len(rigid))[self._label]
        rest = velocity - sum(space.spread(w) * f for w, f in zip(weights.T, fields, strict=True))
        return np.where(self._prescribed, 0.0, rest)

    def _by_body(self, rows: list[Array]) -> Array:
        """Sums of values (owned dofs,) over the nodes of each body, equal on all ranks."""
        label = self._label[: self._space.num_nodes]
        dofs = self._space.owned_dofs
        nodal = [row[dofs].sum(axis=1) for row in rows]
        mine = np.array([np.bincount(label, values, self._count) for values in nodal])
        return np.asarray(self._space.V.mesh.comm.allreduce(mine))


@dataclass(frozen=True, eq=False)
class Balance:
    """Angular momentum of each body and the moments on it, about the origin; equal on all ranks.

    Attributes:
        momentum: Angular momentum, shape (axes, bodies) [stress length^2 time]; one axis in the
            plane, three in space.
        moment: Moment of all forces except those between bodies, likewise [stress length^2].
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
        velocity: Velocity at a rotation by one per time about each axis, arrays of all local dofs,
            (axes, local dofs) [length].
        inertia: Tensors of inertia, shape (groups, axes, axes) [stress length^2 time^2].
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
        self._supported = self._sum(marks.astype(float)[None])[0] > 0.0

    def balance(self) -> Balance:
        """Momenta and moments at the last evaluated state."""
        inertia, owned = self._inertia, self._space.owned_dofs
        rates, x = inertia.rates, self._positions()[: len(owned)]
        rows = [
            moments_of(x, inertia.times_mass(values)[owned])
            for values in (rates.velocity, rates.acceleration)
        ]
        contacts, axes = self._equations.contacts, len(rows[0])
        for contact in contacts:
            force = np.zeros(self._space.num_owned)
            on_slave, on_master = contact.now.forces
            contact.slave.scatter_add(on_slave, force)
            contact.master.scatter_add(on_master, force)
            f = force[owned]
            rows += [moments_of(x, f), np.abs(f).sum(axis=1)[None]]
        sums = self._sum(np.concatenate(rows))
        meshed = np.array([contact.obstacle is None for contact in contacts], bool)
        momentum, moment, of_pairs = np.split(sums, [axes, 2 * axes])
        of_pairs = of_pairs.reshape(len(contacts), axes + 1, self._count)
        sizes = of_pairs[:, axes] > 0.0
        moment = moment + of_pairs[meshed, :axes].sum(axis=0)
        return Balance(momentum, moment, sizes[meshed], sizes[~meshed].any(axis=0))

    def restore(self, before: Balance, after: Balance, dt: float) -> Rotations:
        """Balance the angular momentum at the end of a step.

        The energy added is subtracted from the energy to be returned, see ``report``.

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
        of_mass = self._inertia.times_mass(change)[owned]
        momentum = self._sum(moments_of(x[: len(owned)], of_mass))
        return change - self._rotate(rotations, momentum, moved)

    def _rotations(self, before: Balance, after: Balance) -> Rotations:
        links = [np.flatnonzero(b | a) for b, a in zip(before.touching, after.touching)]
        pairs = [np.stack([bodies[:-1], bodies[1:]], axis=1) for bodies in links]
        group, count = join_bodies(np.arange(self._count), self._count, pairs)
        space, x = self._space, self._positions()
        one = space.spread(np.ones(len(x)))
        mass = self._inertia.times_mass(one)[space.owned_dofs]
        own = x[: len(mass)]
        sums = self._sum(np.concatenate([mass[:, :1].T, (mass * own).T]))
        mass_of, *first = (np.bincount(group, row, count) for row in sums)
        r = x - (np.array(first) / mass_of).T[group[self._label]]
        turns = turned(r)
        velocity = np.zeros((len(turns), one.size))
        velocity[:, space.dofs] = turns
        of_mass = [self._inertia.times_mass(field)[space.owned_dofs] for field in velocity]
        second = self._sum(np.concatenate([moments_of(r[: len(mass)], p) for p in of_mass]))
        free, obstacles = (
            np.bincount(group, marks, count) == 0.0
            for marks in (self._supported, before.on_obstacle | after.on_obstacle)
        )
        inertia = np.array([np.bincount(group, row, count) for row in second])
        inertia = inertia.T.reshape(count, len(turns), len(turns)).astype(float)
        return Rotations(group, velocity, inertia, free, free & obstacles)

    def _rotate(self, rotations: Rotations, momentum: Array, moved: Flags) -> Array:
        """Rotations of the groups ``moved`` by angular momenta of the bodies, (local dofs,)."""
        group, inertia = rotations.group, rotations.inertia
        of_groups = np.array([np.bincount(group, row, len(inertia)) for row in momentum])
        rates = np.linalg.solve(inertia, of_groups.T[:, :, None])[:, :, 0]
        rates = np.where(moved[:, None], rates, 0.0)[group[self._label]].T
        parts = zip(rates, rotations.velocity, strict=True)
        return np.asarray(sum(self._space.spread(rate) * field for rate, field in parts))

    def _positions(self) -> Array:
        """Present positions of the local nodes, ghosts included, shape (n, dim) [length]."""
        return self._equations.bulk.positions()

    def _sum(self, rows: Array) -> Array:
        """Sums of values of the owned nodes of all ranks, (k, nodes), by body: (k, bodies)."""
        label = self._label[: self._space.num_nodes]
        mine = np.array([np.bincount(label, row, self._count) for row in rows])
        return np.asarray(self._space.V.mesh.comm.allreduce(mine))


class Corrections:
    """Return of angular momentum and energy, see ``report``; all methods are collective.

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
