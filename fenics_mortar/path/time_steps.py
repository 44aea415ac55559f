# SPDX-License-Identifier: MIT
"""Time steps: the scheme, accelerations at the start, corrections of the velocity after a step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import join_bodies, label_bodies
from fenics_mortar.obstacles.rigid_motion import moments_of, turned
from fenics_mortar.path.report import Forces, Work, excess_of_trapezoids
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.ranks import sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.bulk.inertia import Inertia, Rates
    from fenics_mortar.problem import ContactProblem


class Line(NamedTuple):
    """A quantity that is linear in the displacement at the end of a step, factor (u - origin)."""

    factor: float
    origin: Array

    def __call__(self, u: Array) -> Array:
        """Its value at the displacement ``u``."""
        return self.factor * (u - self.origin)

    def times(self, factor: float, plus: Array) -> Line:
        """The line of this quantity times ``factor``, and ``plus``."""
        factor *= self.factor
        return Line(factor, self.origin - plus / factor)

    def as_line(self, other: Line, dofs: Flags, u: Array) -> Line:
        """This line with the values of another line at dofs of known displacement.

        Args:
            other: The other line.
            dofs: Marks of these dofs, shape (dofs,), bool.
            u: Displacement at the end of the step at these dofs, shape (dofs,) [length].
        """
        origin = u - other(u) / self.factor
        return Line(self.factor, np.where(dofs, origin, self.origin))


@dataclass(frozen=True)
class GeneralizedAlpha:
    """The generalized-alpha method with all forces at the end of the step (Chung & Hulbert 1993).

    In the form of Arnold & Bruels (2007), w is the acceleration that balances all forces at the
    same time,

        M w_(n+1) + f_int(u_(n+1)) - f_ext + B^T z_(n+1) = 0,

    and a an average of it,

        (1 - am) a_(n+1) + am a_n = (1 - af) w_(n+1) + af w_n.

    With Newmark's formulas for u and v from a, this is the generalized-alpha method whose internal,
    external and contact forces are (1 - af) f_(n+1) + af f_n. Multipliers are those of the end of
    the step, in balance with gaps, loads and prescribed values of the same time.

    ``rho`` is the spectral radius at infinite frequency, between 0 and 1. rho = 1 is the
    trapezoidal rule, which conserves the energy of linear bodies; with rho = 0 unresolved
    frequencies are damped within one step.
    """

    rho: float

    def rates(self, u: Array, rates: Rates, dt: float) -> tuple[Line, Line, Line]:
        """Velocity, acceleration and its average at the end of the step.

        Args:
            u: Displacement at the start of the step, shape (dofs,) [length].
            rates: Rates at the start of the step.
            dt: The step [time].
        """
        am, af = (2.0 * self.rho - 1.0) / (self.rho + 1.0), self.rho / (self.rho + 1.0)
        gamma = 0.5 + af - am  # Newmark's, for second order
        beta = 0.25 * (0.5 + gamma) ** 2  # for the largest dissipation of high frequencies
        start = u + dt * rates.velocity + dt**2 * (0.5 - beta) * rates.average
        average = Line(1.0 / (beta * dt**2), start)
        velocity = average.times(gamma * dt, rates.velocity + (1.0 - gamma) * dt * rates.average)
        rest = (am * rates.average - af * rates.acceleration) / (1.0 - af)
        return velocity, average.times((1.0 - am) / (1.0 - af), rest), average

    def lines(
        self, u: Array, rates: Rates, dt: float, prescribed: Flags, end: Array
    ) -> tuple[Line, Line, Line]:
        """As ``rates``, with prescribed motions.

        Rates of ``prescribed`` motions follow from these motions alone, by the method for rho = 0,
        which is of second order as well. With rho = 1 they would alternate permanently after a jump
        of the velocity or for inconsistent initial rates; with rho = 0 such errors vanish in three
        steps. If prescribed motions accelerate, energies balance up to terms of second order. The
        scheme "generalized_alpha" marks none in steps of given size: other codes have the rates of
        the method itself.

        Args:
            u: Displacement at the start of the step, shape (dofs,) [length].
            rates: Rates at the start of the step.
            dt: The step [time].
            prescribed: Marks of such dofs, shape (dofs,), bool.
            end: Displacement of these dofs at the end of the step [length].
        """
        damped = GeneralizedAlpha(0.0).rates(u, rates, dt)
        pairs = zip(self.rates(u, rates, dt), damped, strict=True)
        velocity, acceleration, average = (a.as_line(b, prescribed, end) for a, b in pairs)
        return velocity, acceleration, average


def first_acceleration(problem: ContactProblem, inertia: Inertia) -> Array:
    """Accelerations that balance the forces, (local dofs,) [length / time^2] (collective).

    At the start of a motion, also of rigid boundaries that forces drive. With V_m the motions of a
    boundary's nodes k, and the angular velocity w of these,

        u''_k = sum_m a_m V_m,k - w^2 (x_k - x_P),    V_m . (M u'' + f) = push_m,

    where free nodes follow from M u'' + f = 0: a solve with M for each driven motion. The forces of
    sections act on both faces. Accelerations of nodes with prescribed motions are zero.

    Args:
        problem: The problem, with rates whose acceleration is zero.
        inertia: Mass and velocity.
    """
    bulk, comm = problem.equations.bulk, problem.equations.comm
    motions = problem.equations.motions
    forces, contact, _ = problem.forces()
    total = forces + contact - sum(section.pushed_nodes() for section in motions.sections)
    w = inertia.acceleration_of(-total, bulk.prescribed)
    driven = [load for load in motions.boundaries if load.driven.any()]
    if not driven:
        return w
    turning = np.sum([load.centripetal(inertia.velocity.x.array) for load in driven], axis=0)
    w = w + _followed(inertia, bulk, turning)
    V = np.concatenate([load.nodal_motions()[load.driven] for load in driven])
    fields = [_followed(inertia, bulk, motion) for motion in V]
    of_motions = [inertia.times_mass(field) for field in fields]
    at_present = inertia.times_mass(w) + inertia.carried(total)
    products = sum_over_ranks(comm, V @ np.column_stack([*of_motions, at_present]))
    push = np.concatenate([load.push()[load.driven] for load in driven])
    a = np.linalg.solve(products[:, :-1], push - products[:, -1])
    return w + np.tensordot(a, np.array(fields), axes=1)


def _followed(inertia: Inertia, bulk: Any, on_boundary: Array) -> Array:
    """Accelerations ``on_boundary`` (owned dofs,), with those of free nodes without other forces.

    An array of all local dofs (collective).
    """
    given = inertia.with_ghosts(on_boundary)
    return given + inertia.acceleration_of(-inertia.times_mass(given), bulk.prescribed)


# Largest relative change of the velocity of deformation and impact in a step, to return energy [1].
# Impacts in steps of a wave's time through a cell rarely need 0.1, longer steps need 0.3. The limit
# is for bodies without vibrations, whose rounding must not grow.
MAX_SCALING = 0.3


class Balance(NamedTuple):
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


class Corrections:
    """Return of angular momentum and energy after a time step; all methods are collective.

    **Angular momentum lost by bodies in a time step, and its return by rigid rotations.** Closed
    mortar gaps are zero on average, not at each point, and normals of nodes are not those of
    facets: pressures of slave and master have a moment of third order in the length of the facets.
    The trapezoidal rule conserves the angular momentum in the middle of equal steps, not that of
    present positions and velocities. After each step the velocity of a rigid rotation about the
    centre of mass is added to each body, so that

        L_(n+1) - L_n = dt / 2 (T_n + T_(n+1))

    with the moments T of loads, internal forces and obstacles, without those exerted by other
    bodies. Bodies in contact rotate together. Bodies with prescribed dofs are not corrected, since
    their supports exert moments. Linear momentum is already balanced, and is not changed by
    rotations: those about the centre of mass of a group are its rigid motions, of shifts and
    rotations about the middle of all nodes, whose linear momentum is zero.

    **Energy lost by errors of a time step, and its return by means of the impulses that cause
    them.** Two errors of the trapezoidal rule change the energy. The work of the pressures is

        (f_n + f_(n+1)) . (u_(n+1) - u_n) / 2 = (z_n g_(n+1) - z_(n+1) g_n) / 2

    in a step in which a node closes or opens. It should vanish; it is of second order, with the
    same sign for most nodes of an impact. The work of nonlinear internal forces should be the
    difference of the strain energies, the integral of r(u) . du from u_n to u_(n+1). Lobatto's rule
    with four points on the straight line, exact for stresses up to fifth order in the displacement,
    differs from the trapezoidal one by d . (u_(n+1) - u_n) with

        d = 5 (r(u_n) - r(u_a) - r(u_b) + r(u_(n+1))) / 12

    and the states u_a and u_b at the fractions (1 - 1/sqrt(5)) / 2 and (1 + 1/sqrt(5)) / 2 of the
    line.

    The sum of both over all steps, and of that of rotations, is the ``energy_deficit``. So is,
    without damping, the work of forces on nodes without mass that are not in balance at the start.
    After each step it is returned as far as possible: a fraction t of an impulse J is added to the
    momentum of the bodies, which changes the energy by t v . J + t^2 J . M^-1 J / 2 and leaves the
    sum of momenta unchanged. The first impulse is dt d: with t = 1 internal forces act with their
    mean along the step (Quispel & McLaren 2008), with t = 0 by the trapezoidal rule, and errors of
    t between 0 and 2 are at most as large as its own. The second is that of the pressures, if a
    pair is closed, with |t| <= 1. The third changes the amplitude of vibrations, the last one also
    the rigid motion that pressures change: it returns what the last pressures of an impact cannot.
    Other rigid motions are left out. (Laursen & Love 2002 correct velocities in a similar way for
    each node.)

    Args:
        problem: The problem.
        inertia: Mass and rates of the bodies.
        conserves: Whether the scheme is the trapezoidal rule. Otherwise it dissipates vibrations,
            and only the energy lost by contact is returned.
    """

    def __init__(self, problem: ContactProblem, inertia: Inertia, *, conserves: bool) -> None:
        self._bulk, self._contacts = problem.equations.bulk, problem.equations.contacts
        self._inertia, self._conserves, self._space = inertia, conserves, self._bulk.space
        self._label, self._count = label_bodies(self._space.V)
        supported = self._bulk.prescribed[self._space.owned_dofs].any(axis=1)
        self._free = self._sum(supported[None])[0] == 0.0

    def _sum(self, rows: Array) -> Array:
        """Sums of values of the owned nodes of all ranks, (k, nodes), by body: (k, bodies)."""
        label = self._label[: self._space.num_nodes]
        mine = np.array([np.bincount(label, row, self._count) for row in rows])
        return sum_over_ranks(self._bulk.comm, mine)

    def begin(self) -> None:
        """Note the angular momentum at the start of a step."""
        if not self._space.is_axisymmetric:
            self._before = self.balance()

    def balance(self) -> Balance:
        """Momenta and moments at the last evaluated state."""
        inertia, owned = self._inertia, self._space.owned_dofs
        rates, x = inertia.rates, self._bulk.positions()[: len(owned)]
        rows = [
            moments_of(x, inertia.times_mass(values)[owned])
            for values in (rates.velocity, rates.acceleration)
        ]
        contacts, axes = self._contacts, len(rows[0])
        for contact in contacts:
            force = np.zeros(self._space.num_owned)
            contact.scatter_add(contact.now.forces, force)
            f = force[owned]
            rows += [moments_of(x, f), np.abs(f).sum(axis=1)[None]]
        sums = self._sum(np.concatenate(rows))
        meshed = np.array([contact.obstacle is None for contact in contacts], bool)
        momentum, moment, of_pairs = np.split(sums, [axes, 2 * axes])
        of_pairs = of_pairs.reshape(len(contacts), axes + 1, self._count)
        sizes = of_pairs[:, axes] > 0.0
        moment = moment + of_pairs[meshed, :axes].sum(axis=0)
        return Balance(momentum, moment, sizes[meshed], sizes[~meshed].any(axis=0))

    def correct(self, work: Work, dt: float, start: Array, forces: tuple[Forces, Forces]) -> None:
        """Return the angular momentum and energy lost in a step.

        Args:
            work: Work done in the step.
            dt: The step [time].
            start: Displacement at its start, shape (local dofs,) [length].
            forces: Forces at its start and end.
        """
        bulk, inertia, energy = self._bulk, self._inertia, work.pressure
        if self._conserves and inertia.rate is None and inertia.rates.time <= dt:
            energy -= work.imbalance  # in the first step; damping is not returned
        internal, pressures = None, self._pressure_impulse(forces, dt)
        if self._conserves and not bulk.is_linear:
            d = self._internal_defect(start, dt)
            energy += bulk.comm.allreduce(float(d @ (bulk.values - start)[: bulk.num_owned]))
            internal = inertia.acceleration_of(dt * d, bulk.prescribed)
        self.find_rigid()
        if not self._space.is_axisymmetric:
            internal, pressures = self._return_spin(dt, internal, pressures)
        rates = inertia.rates
        inertia.rates = replace(rates, energy_deficit=rates.energy_deficit + energy)
        impulses = [(internal, 0.0, 2.0), (pressures, -1.0, 1.0)]
        if self._conserves:
            for found in (None,) if pressures is None else (None, pressures):
                impulses.append((self._free_part(rates.velocity, found), -MAX_SCALING, MAX_SCALING))
        for change, smallest, largest in impulses:
            if change is not None:
                self._return_energy(change, smallest, largest, ROUNDING * work.largest)

    def _return_energy(
        self, change: Array, smallest: float, largest: float, rounding: float
    ) -> None:
        """Add a fraction of a change of velocity that returns the energy as far as possible.

        Args:
            change: Array of all local dofs [length / time].
            smallest: Smallest fraction [1].
            largest: Largest fraction [1].
            rounding: Energy that counts as zero [stress length^2].
        """
        inertia, rates = self._inertia, self._inertia.rates
        energy, velocity = rates.energy_deficit, rates.velocity
        if abs(energy) <= rounding:
            return
        power, square = inertia.product(velocity, change), inertia.product(change, change)
        t = min(max(fraction_of_impulse(energy, power, square), smallest), largest)
        left = energy - (t * power + 0.5 * t**2 * square)
        inertia.rates = replace(rates, velocity=velocity + t * change, energy_deficit=left)

    def _internal_defect(self, start: Array, dt: float) -> Array:
        """Force d by which the trapezoidal rule exceeds Lobatto's in a step to the present state.

        Loads are those of the end of the step, and a velocity in the residual is the mean one;
        terms that are linear in the displacement have no part.

        Args:
            start: Displacement at the start, shape (local dofs,) [length].
            dt: The step [time].

        Returns:
            Forces at the owned dofs [stress length].
        """
        bulk, rate = self._bulk, self._inertia.rate
        u, end = bulk.values, bulk.values.copy()
        kept, mean = bulk.r.array_r.copy(), (end - start) / dt

        def forces(fraction: float) -> Array:
            u[:] = place = (1.0 - fraction) * start + fraction * end
            if rate is not None:
                rate.set(1.0, place - mean)
            bulk.assemble_residual()
            return np.array(bulk.r.array_r[: bulk.num_owned])

        d = excess_of_trapezoids(forces)
        u[:] = end
        bulk.r.array[:] = kept
        return d

    def _pressure_impulse(self, forces: tuple[Forces, Forces], dt: float) -> Array | None:
        """Change of velocity by half the impulse of pressures; ``None`` if all pairs are open.

        An array of all local dofs [length / time], for the forces at the start and the end.
        """
        for found in reversed(forces):
            pressures = found[1] - found[3]
            if self._bulk.comm.allreduce(bool(pressures.any()), MPI.LOR):
                return self._inertia.acceleration_of(0.5 * dt * pressures, self._bulk.prescribed)
        return None

    def find_rigid(self) -> None:
        """Set velocities of rigid motions at the present positions, and their momenta.

        Shifts, and rotations about the middle of all nodes, over their distance from it: arrays of
        all local dofs.
        """
        space, x, owned = self._space, self._bulk.positions(), self._space.num_nodes
        *middle, count = sum_over_ranks(self._bulk.comm, [*x[:owned].sum(axis=0), owned])
        self._middle = np.array(middle) / count
        r = x - self._middle
        squares = sum_over_ranks(self._bulk.comm, [float((r[:owned] ** 2).sum())])
        self._size = float(np.sqrt(squares[0] / count))
        shifts = np.broadcast_to(np.eye(space.dim)[:, None], (space.dim, *x.shape))
        turns = turned(r) / self._size
        rigid = shifts[1:] if space.is_axisymmetric else np.concatenate([shifts, turns])
        self._rigid = np.zeros((len(rigid), self._bulk.values.size))
        self._rigid[:, space.dofs] = rigid
        self._of_mass = np.array([self._inertia.times_mass(field) for field in self._rigid])
        self._products = np.stack([self._momenta(field) for field in self._rigid], axis=2)

    def _momenta(self, velocity: Array) -> Array:
        """Products of a velocity and the rigid ones by the mass, (bodies, motions)."""
        products = self._of_mass * velocity[: self._of_mass.shape[1]]
        return self._sum(products[:, self._space.owned_dofs].sum(axis=2)).T

    def _moving(self, momenta: Array, group: Indices) -> Array:
        """Velocity of rigid motions of groups of bodies with such momenta, (local dofs,)."""
        products, sums = np.zeros_like(self._products), np.zeros_like(momenta)
        np.add.at(products, group, self._products)
        np.add.at(sums, group, momenta)
        inverse = np.linalg.pinv(products, ROUNDING, hermitian=True)
        rates = (inverse @ sums[:, :, None])[group[self._label], :, 0].T
        parts = zip(rates, self._rigid, strict=True)
        return np.asarray(sum(self._space.spread(rate) * field for rate, field in parts))

    def deformation(self, velocity: Array) -> Array:
        """The part of a velocity orthogonal, in mass, to rigid motions; 0 if prescribed.

        Arrays of all local dofs [length / time]; see ``find_rigid``.
        """
        rest = velocity - self._moving(self._momenta(velocity), np.arange(self._count))
        return np.where(self._bulk.prescribed, 0.0, rest)

    def _return_spin(
        self, dt: float, internal: Array | None, pressures: Array | None
    ) -> tuple[Array | None, Array | None]:
        """Balance the angular momentum at the end of a step by rotations of groups of bodies.

        The energy added is subtracted from the energy to be returned. Returns the changes of
        velocity by internal forces, and by pressures between bodies, without angular momentum.
        """
        inertia, rates = self._inertia, self._inertia.rates
        before, after = self._before, self.balance()
        links = [np.flatnonzero(b | a) for b, a in zip(before.touching, after.touching)]
        pairs = [np.stack([bodies[:-1], bodies[1:]], axis=1) for bodies in links]
        group, count = join_bodies(self._count, pairs)
        free, between = (
            (np.bincount(group, held, count) == 0.0)[group]
            for held in (~self._free, ~self._free | before.on_obstacle | after.on_obstacle)
        )

        def spinning(spins: Array, moved: Flags) -> Array:
            momenta = np.zeros(self._products.shape[:2])
            momenta[moved, self._space.dim :] = spins[moved]
            return self._moving(momenta, group)

        def without_spin(change: Array | None, moved: Flags) -> Array | None:
            """The change without angular momentum about the origin, as the balance."""
            if change is None:
                return None
            shifts, spins = np.split(self._momenta(change), [self._space.dim], axis=1)
            about = np.broadcast_to(self._middle, shifts.shape)
            return change - spinning(spins + moments_of(about, shifts).T / self._size, moved)

        missing = before.momentum + 0.5 * dt * (before.moment + after.moment) - after.momentum
        change = spinning(missing.T / self._size, free)
        added = inertia.product(change, rates.velocity + 0.5 * change)
        lost = rates.energy_deficit - added
        inertia.rates = replace(rates, velocity=rates.velocity + change, energy_deficit=lost)
        return without_spin(internal, free), without_spin(pressures, between)

    def _free_part(self, velocity: Array, pressures: Array | None) -> Array:
        """The part of a velocity that may change in an impact, (local dofs,) [length / time].

        Velocities of deformation, and rigid motions as those caused by the pressures.
        """
        inertia, part = self._inertia, self.deformation(velocity)
        if pressures is not None:
            rigid = pressures - self.deformation(pressures)
            power, square = inertia.product(rigid, velocity), inertia.product(rigid, rigid)
            part += power / square * rigid if square > 0.0 else 0.0
        return part


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
