# SPDX-License-Identifier: MIT
"""Energy in a step: work of all forces, and the return of what errors of a time step change.

**Energy lost by errors of a time step, and its return by means of the impulses that cause them.**
Two errors of the trapezoidal rule change the energy. The work of the pressures is

    (f_n + f_(n+1)) . (u_(n+1) - u_n) / 2 = (z_n g_(n+1) - z_(n+1) g_n) / 2

in a step in which a node closes or opens. It should vanish; it is of second order, with the same
sign for most nodes of an impact. The work of nonlinear internal forces should be the difference of
the strain energies, the integral of r(u) . du from u_n to u_(n+1). Lobatto's rule with four points
on the straight line, exact for stresses up to fifth order in the displacement, differs from the
trapezoidal one by d . (u_(n+1) - u_n) with

    d = 5 (r(u_n) - r(u_a) - r(u_b) + r(u_(n+1))) / 12

and the states u_a and u_b at the fractions (1 - 1/sqrt(5)) / 2 and (1 + 1/sqrt(5)) / 2 of the line.

The sum of both over all steps, and of rotations, see ``corrections``, is the ``energy_deficit``. So
is, without damping, the work of forces on nodes without mass that are not in balance at the start.
After each step it is returned as far as possible: a fraction t of an impulse J is added to the
momentum of the bodies, which changes the energy by t v . J + t^2 J . M^-1 J / 2 and leaves the sum
of momenta unchanged. The first impulse is dt d: with t = 1 internal forces act with their mean
along the step (Quispel & McLaren 2008), with t = 0 by the trapezoidal rule, and errors of t between
0 and 2 are at most as large as its own. The second is that of the pressures, if a pair is closed,
with |t| <= 1. The third changes the amplitude of vibrations, see ``corrections``, the last
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
from fenics_mortar.contact.arcs import surface_rotation
from fenics_mortar.equations.general import State
from fenics_mortar.obstacles.rotations import motion_between
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import TINY
from fenics_mortar.verify.checks.friction_work import work_along_arcs

Forces = tuple[Array, Array, Array, Array, Array]


class Work(NamedTuple):
    """Work done in a step, by the trapezoidal rule [stress length^2] (local).

    Attributes:
        bulk: Energy stored in the bodies, minus the work of applied loads.
        supports: Work of the reactions.
        contact: Work of the contact forces.
        friction: Work of their tangential parts: the energy dissipated by friction. On nodes, these
            forces turn with the surface, see ``verify.checks.friction_work``.
        largest: Upper bound of the work of contact forces: sum of the norms of forces times those
            of the motions of their nodes and obstacles.
        rotated: Work included in ``friction`` that the trapezoidal rule misses on turning surfaces;
            zero in space.
    """

    bulk: float
    supports: float
    contact: float
    friction: float = 0.0
    largest: float = 0.0
    rotated: float = 0.0

    @property
    def pressure(self) -> float:
        """Work of the pressures [stress length^2].

        Pressures on closed gaps do no work: this is energy added by the discretization. It vanishes
        with the size of facets and steps, but slowly below a sliding corner, where the pressure is
        unbounded.
        """
        return self.contact - self.dissipated

    @property
    def imbalance(self) -> float:
        """Work of forces that are not in balance [stress length^2].

        At the start of a motion, nodes without mass need not be in balance.
        """
        return self.bulk + self.contact - self.supports

    @property
    def dissipated(self) -> float:
        """Work of friction by the trapezoidal rule alone [stress length^2].

        Bodies lose this energy in a time step, whose equations are those of straight paths.
        """
        return self.friction - self.rotated

    @property
    def defect(self) -> float:
        """Work of the pressures over the largest of all contributions [1].

        Under dead loads and fixed supports, ``bulk`` and ``supports`` consist of the work of
        contact alone. Therefore ``largest`` is included in the comparison: in sliding the ratio
        measures the friction added by the facets.
        """
        return abs(self.pressure) / max(*map(abs, self[:-1]), TINY)


def forces_of(problem: ContactProblem) -> Forces:
    """Forces of bulk and contact, on obstacles, and tangential parts of the last two (collective).

    Returns:
        Owned dofs of the bulk residual, of contact forces, forces and moments on obstacles,
        tangential contact forces and tangential forces and moments on obstacles [stress length,
        moments stress length^2].
    """
    shear, on_obstacles = problem.equations.residual.shear_forces()
    scales = problem.equations.motions.scales[: len(on_obstacles)]
    return *problem.forces(), shear, on_obstacles * scales


def work_of(
    problem: ContactProblem, start: State, end: State, before: Forces, after: Forces
) -> Work:
    """Work of the mean forces in a step; obstacles are treated as supports (collective).

    Args:
        problem: The problem.
        start: State at the start of the step.
        end: State at the end of the step.
        before: Forces at the start of the step, see ``forces_of``.
        after: Forces at the end of the step.
    """
    means = (0.5 * (a + b) for a, b in zip(before, after, strict=True))
    r, contact, on_obstacles, shear, shear_on_obstacles = means
    du, prescribed = (end.u - start.u)[: r.size], problem.equations.bulk.prescribed_dofs
    supports = (r + contact)[prescribed] @ du[prescribed]
    dofs = problem.equations.bulk.space.owned_dofs
    friction = shear @ du  # in space that of arcs is not known yet
    if problem.equations.bulk.space.dim == 2:
        angles = _rotations(problem, start, end)
        friction = work_along_arcs(before[3][dofs], after[3][dofs], du[dofs], angles).sum()
    work = np.array([r @ du, supports, contact @ du, friction, friction - shear @ du])
    work = problem.equations.comm.allreduce(work)
    places = zip(start.places[: len(on_obstacles)], end.places, strict=False)
    moved = np.reshape([motion_between(*ends, 1.0) for ends in places], on_obstacles.shape)
    work[1:3] += (on_obstacles * moved).sum()
    work[3] += (shear_on_obstacles * moved).sum()
    sizes = np.linalg.norm(contact[dofs], axis=1) @ np.linalg.norm(du[dofs], axis=1)
    largest = problem.equations.comm.allreduce(float(sizes)) + np.abs(on_obstacles * moved).sum()
    of_bulk, of_supports, of_contact, of_friction, rotated = map(float, work)
    return Work(of_bulk, of_supports, of_contact, of_friction, float(largest), rotated)


def _rotations(problem: ContactProblem, start: State, end: State) -> Array:
    """Rotations in a step of the surfaces at owned nodes, zero elsewhere, (nodes,) (collective).

    The mean of all surfaces of a node, as on both sides of a corner.
    """
    sums = np.zeros(problem.equations.bulk.num_owned)
    for contact in problem.equations.contacts:
        for surface in (contact.slave, contact.master):
            x_0, x = (surface.X + surface.gather(state.u) for state in (start, end))
            angles = surface_rotation(surface, x_0, x) if len(x) else np.zeros(0)
            surface.scatter_add(np.stack([angles, np.ones_like(angles)], axis=1), sums)
    angle, count = sums[problem.equations.bulk.space.owned_dofs].T
    return np.asarray(angle / np.maximum(count, 1.0))


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
