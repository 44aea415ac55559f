# SPDX-License-Identifier: MIT
"""Records of load paths and of motions.

Progress of a path: records of the logger ``fenics_mortar``, and a remark on idle loads.

Rank 0 logs each accepted step and each cut with level INFO, and the table of each solve with level
DEBUG. Nothing is shown unless the program sets up logging::

    logging.basicConfig()
    logging.getLogger("fenics_mortar").setLevel(logging.INFO)

Energy in a step: work of all forces, and the return of what errors of a time step change.

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

The sum of both over all steps, and of rotations, see ``dynamics``, is the ``energy_deficit``. So
is, without damping, the work of forces on nodes without mass that are not in balance at the start.
After each step it is returned as far as possible: a fraction t of an impulse J is added to the
momentum of the bodies, which changes the energy by t v . J + t^2 J . M^-1 J / 2 and leaves the sum
of momenta unchanged. The first impulse is dt d: with t = 1 internal forces act with their mean
along the step (Quispel & McLaren 2008), with t = 0 by the trapezoidal rule, and errors of t between
0 and 2 are at most as large as its own. The second is that of the pressures, if a pair is closed,
with |t| <= 1. The third changes the amplitude of vibrations, see ``dynamics``, the last
one also the rigid motion that pressures change: it returns what the last pressures of an impact
cannot. Other
rigid motions are left out. (Laursen & Love 2002 correct velocities in a similar way for each node.)
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import Contact, needing_time
from fenics_mortar.equations.solver import loads_of
from fenics_mortar.obstacles.rigid_motion import motion_between
from fenics_mortar.utils.arrays import TINY, Array
from fenics_mortar.utils.files import Markdown, markdown_table
from fenics_mortar.utils.ranks import on_any_rank

if TYPE_CHECKING:
    from fenics_mortar.bulk.inertia import Inertia
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.equations.general import State
    from fenics_mortar.newton.loop import NewtonReport
    from fenics_mortar.problem import ContactProblem

Forces = tuple[Array, Array, Array, Array, Array]


class Work(NamedTuple):
    """Work done in a step [stress length^2], but for ``friction`` by the trapezoidal rule (local).

    Attributes:
        bulk: Energy stored in the bodies, minus the work of applied loads.
        supports: Work of the reactions.
        contact: Work of the contact forces.
        shear: Work of their tangential parts: energy that bodies lose to friction in a time step.
        largest: Upper bound of the work of contact forces: sum of the norms of forces times those
            of the motions of their nodes and obstacles.
        friction: Energy that the laws dissipate, see ``PairView.friction_work``; the sum of all
            pairs.
    """

    bulk: float
    supports: float
    contact: float
    shear: float = 0.0
    largest: float = 0.0
    friction: float = 0.0

    @property
    def pressure(self) -> float:
        """Work of the pressures [stress length^2].

        Pressures on closed gaps do no work: this is energy added by the discretization. It vanishes
        with the size of facets and steps, but slowly below a sliding corner, where the pressure is
        unbounded.
        """
        return self.contact - self.shear

    @property
    def imbalance(self) -> float:
        """Work of forces that are not in balance [stress length^2].

        At the start of a motion, nodes without mass need not be in balance.
        """
        return self.bulk + self.contact - self.supports

    @property
    def defect(self) -> float:
        """Work of the pressures over the largest of all contributions [1].

        Under dead loads and fixed supports, ``bulk`` and ``supports`` consist of the work of
        contact alone. Therefore ``largest`` is included in the comparison: in sliding the ratio
        measures the friction added by the facets.
        """
        return abs(self.pressure) / max(*map(abs, self), TINY)


def forces_of(problem: ContactProblem) -> Forces:
    """Forces of bulk and contact, on obstacles, and tangential parts of the last two (collective).

    Returns:
        Owned dofs of the bulk residual, of contact forces, forces and moments on obstacles,
        tangential contact forces and tangential forces and moments on obstacles [stress length,
        moments stress length^2].
    """
    residual, motions = problem.equations.residual, problem.equations.motions
    on_obstacles = motions.obstacle_forces("shear")
    on_obstacles = on_obstacles * motions.scales[: len(on_obstacles)]
    return *problem.forces(), residual.contact_force("shear"), on_obstacles


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
    equations, du = problem.equations, (end.u - start.u)[: r.size]
    prescribed, dofs = equations.bulk.prescribed_dofs, equations.bulk.space.owned_dofs
    supports = (r + contact)[prescribed] @ du[prescribed]
    sizes = np.linalg.norm(contact[dofs], axis=1) @ np.linalg.norm(du[dofs], axis=1)
    work = np.array([r @ du, supports, contact @ du, shear @ du, sizes, 0.0])
    work = equations.comm.allreduce(work)
    places = zip(start.places[: len(on_obstacles)], end.places, strict=False)
    moved = np.reshape([motion_between(*ends, 1.0) for ends in places], on_obstacles.shape)
    work[1:3] += (on_obstacles * moved).sum()
    work[3] += (shear_on_obstacles * moved).sum()
    work[4] += np.abs(on_obstacles * moved).sum()
    work[5] = sum(pair.now.friction_work for pair in equations.contacts)
    return Work(*map(float, work))


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


@dataclass(frozen=True)
class PathStep:
    """One accepted step.

    Attributes:
        time: Time at the end of the step [time].
        step: Size of the step [time].
        report: Record of its solve.
        failures: Records of failed attempts at larger steps.
        work: Work done in the step.
    """

    time: float
    step: float
    report: NewtonReport
    failures: list[NewtonReport]
    work: Work


class _OfSteps(Markdown):
    """Base of records with accepted ``steps``, and ``failures`` after the last one; local."""

    steps: list[Any]
    failures: list[NewtonReport]

    @property
    def num_iterations(self) -> int:
        """Number of linear systems solved, including failed attempts."""
        of_steps = [report for step in self.steps for report in (step.report, *step.failures)]
        return sum(report.num_iterations for report in (*of_steps, *self.failures))

    @property
    def num_cuts(self) -> int:
        """Number of failed attempts."""
        return sum(len(step.failures) for step in self.steps) + len(self.failures)


@dataclass
class PathReport(_OfSteps):
    """Record of a path, complete on success and on failure; prints as a Markdown table.

    All methods are local.

    Attributes:
        steps: The accepted steps: see ``PathStep``.
        failures: Records of failed attempts at the step after the last accepted one.
        finished: Whether the end of the path was reached.
        dead_end: Reason why no equilibrium exists beyond the last step, if this is certain; else
            "".
        notes: Remarks on the whole path.
    """

    steps: list[PathStep] = field(default_factory=list)
    failures: list[NewtonReport] = field(default_factory=list)
    finished: bool = False
    dead_end: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def friction_work(self) -> float:
        """Work of friction on the path, see ``PairView.friction_work`` [stress length^2]."""
        return sum(step.work.friction for step in self.steps)

    def table(self) -> str:
        """Markdown table, one row per accepted step, reasons of failures, and remarks.

        The last column is ``Work.defect``.
        """
        rows, reasons = [], []
        for number, step in enumerate(self.steps, start=1):
            active = step.report.iterations[-1].num_active
            cells = [f"{number}", f"{step.time:.6g}", f"{step.step:.3g}"]
            cells += [f"{step.report.num_iterations}", f"{active}", f"{len(step.failures)}"]
            rows.append([*cells, f"{step.work.defect:.1e}"])
            reasons += [f"- step {number}: {failure.reason}" for failure in step.failures]
        reasons += [f"- step {len(self.steps) + 1}: {failure.reason}" for failure in self.failures]
        reasons += [f"- {note}" for note in self.notes]
        head = ["step", "time", "size", "iterations", "active", "cuts", "contact work"]
        return "\n".join([markdown_table(head, rows), *(["", *reasons] if reasons else [])])

    def __str__(self) -> str:
        """The table."""
        return self.table()


# Smallest energy added by contact pressures, over the largest kinetic energy [1], for a remark in
# the report. Without mass at the contact surface it is at most 0.08 in the study of impacts.
ADDED = 0.1
# Largest energy that errors of the time steps may have added or taken at any time with
# "conserving", over the largest kinetic energy [1], without a remark.
CONSERVED = 1e-3
# Findings of the certificate on facets that do not resolve the contact.
RESOLUTION = ("unresolved_force", "facet_gaps")


class Energies(NamedTuple):
    """Energies and momentum of a state (local).

    Attributes:
        kinetic: Kinetic energy [stress length^2].
        strain: Strain energy, nan without the argument ``energy`` [stress length^2].
        momentum: Linear momentum [stress length time] and angular momentum about the origin
            [stress length^2 time], shape (3,), in space (6,).
    """

    kinetic: float
    strain: float
    momentum: Array

    @property
    def total(self) -> float:
        """Kinetic and strain energy [stress length^2]."""
        return self.kinetic + self.strain


@dataclass(frozen=True)
class TimeStep:
    """One time step.

    Attributes:
        time: Time at the end of the step [time].
        report: Record of its solve.
        failures: Records of failed attempts at larger steps.
        error: Estimated error [1]; see ``Dynamics.error``.
        work: Work done in the step by the trapezoidal rule; ``work.bulk`` is the change of kinetic
            and strain energy, minus the work of applied loads.
        energies: Energies at the end of the step.
        size: Length of the step [time].
        deficit: Energy lost by errors of the time steps so far and not returned, zero unless the
            scheme is "conserving" [stress length^2].
    """

    time: float
    report: NewtonReport
    failures: list[NewtonReport]
    error: float
    work: Work
    energies: Energies
    size: float = 0.0
    deficit: float = 0.0


class EnergyErrors(NamedTuple):
    """Energy that errors of the time steps added or took, of either sign (local).

    Attributes:
        kinetic: Largest kinetic energy [stress length^2].
        deficit: Energy lost and not returned, zero unless the scheme is "conserving" [likewise].
        contact: Energy that contact pressures added [likewise].
        friction: Energy that friction added [likewise].
        imbalance: Work of forces that are not in balance in the first step [likewise].
        size: Largest step, 0 if unknown [time].
        time: End of the last step [time].
    """

    kinetic: float = 0.0
    deficit: float = 0.0
    contact: float = 0.0
    friction: float = 0.0
    imbalance: float = 0.0
    size: float = 0.0
    time: float = 0.0

    def after(
        self, work: Work, kinetic: float, deficit: float, *, size: float, time: float
    ) -> EnergyErrors:
        """The errors after one more step.

        Args:
            work: Work done in the step.
            kinetic: Largest kinetic energy so far [stress length^2].
            deficit: Energy lost so far and not returned [likewise].
            size: The step [time].
            time: Its end [time].
        """
        return EnergyErrors(
            kinetic=kinetic,
            deficit=deficit,
            contact=self.contact - work.pressure,
            friction=self.friction - work.shear,
            imbalance=self.imbalance if self.size else work.imbalance,
            size=max(self.size, size),
            time=time,
        )

    def _found(self, scheme: str) -> list[tuple[str, float]]:
        """What has errors above its limit, and their share in the kinetic energy [1]."""
        energies = [
            ("the time steps", -self.deficit, CONSERVED),
            ("contact pressures", 0.0 if scheme == "conserving" else self.contact, ADDED),
            ("friction", max(self.friction, 0.0), ADDED),
        ]
        shares = [(who, energy / max(self.kinetic, TINY), limit) for who, energy, limit in energies]
        return [(who, share) for who, share, limit in shares if abs(share) > limit]

    def worst(self, scheme: str) -> float:
        """Largest share of an error above its limit, 0 without [1]."""
        return max((abs(share) for _, share in self._found(scheme)), default=0.0)

    def remark(self, scheme: str, rho_inf: float) -> str:
        """What the errors are and what would reduce them, apart from what is in use.

        Args:
            scheme: The time scheme; see ``Dynamics``.
            rho_inf: Its spectral radius at infinite frequency [1].

        Returns:
            The remark; "" if the errors are small.
        """
        conserving, size, found = scheme == "conserving", self.size, self._found(scheme)
        if not self.kinetic or not found:
            return ""
        messages = [
            f"{who} {'added' if share > 0 else 'took'} {abs(share):.2g}" for who, share in found
        ]
        excess = self.worst(scheme) / CONSERVED
        if conserving and abs(self.imbalance) > 0.5 * abs(self.deficit) > 0.0:
            advice = "a finer contact surface: its nodes were not in balance at the start"
        elif scheme == "generalized_alpha":  # its surfaces have mass: smaller steps do not help
            smaller = ", or a smaller rho_inf" * (rho_inf > 0.0)
            advice = f"scheme='conserving' ('massless' of bodies with history){smaller}"
        else:
            steps = f"steps of {0.9 * size / excess**0.5:.2g}" if size else "smaller steps"
            steps += f", for an error of {CONSERVED:g}, as it is of second order" * bool(size)
            advice = steps if conserving else f"scheme='conserving', or {steps}"
        return (
            f"{' and '.join(messages)} of the largest kinetic energy, an error of the time steps: "
            f"take {advice}"
        )


@dataclass
class DynamicsReport(_OfSteps):
    """Record of a motion; prints as a Markdown table; all methods are local.

    Attributes:
        start: Energies at the start of the motion.
        steps: The time steps.
        failures: Records of failed attempts at the step after the last one.
        scheme: The time scheme; see ``Dynamics``.
        rho_inf: Its spectral radius at infinite frequency [1].
    """

    start: Energies
    steps: list[TimeStep] = field(default_factory=list)
    failures: list[NewtonReport] = field(default_factory=list)
    scheme: str = "massless"
    rho_inf: float = 1.0

    @property
    def friction_work(self) -> float:
        """Energy dissipated by friction [stress length^2].

        By the mean of the shear at both ends of each step. It may be negative with
        "generalized_alpha" for contact of nodes with mass: their shear and slip alternate from step
        to step. The shear at the end of a step always opposes the slip in it.
        """
        return sum(step.work.shear for step in self.steps)

    @property
    def contact_energy(self) -> float:
        """Energy that contact pressures added, an error of the time steps [stress length^2].

        Pressures on closed gaps do no work. With "conserving" this energy is returned, except for
        the ``deficit`` of the last step.
        """
        return -sum(step.work.pressure for step in self.steps)

    def remark(self) -> str:
        """Remarks on errors of the energy, and on facets too coarse for the contact; "" if small.

        The former names what would reduce the error, apart from what is in use. The latter is that
        of the certificate of the step with most nodes in contact.
        """
        return "\n\n".join(filter(None, (self._of_energy(), self._of_resolution())))

    def _of_resolution(self) -> str:
        """Remark on regions of contact that the facets do not resolve, even at their largest."""
        if not self.steps:
            return ""
        largest = max(self.steps, key=lambda step: step.report.iterations[-1].num_active)
        certificate = largest.report.certificate
        found = [
            f"{pair.pair}: {finding.message}"
            for pair in ([] if certificate is None else certificate.pairs)
            for finding in pair.findings
            if finding.name in RESOLUTION and finding.verdict == "remark"
        ]
        return "; ".join([f"at the time {largest.time:.6g}", *found]) if found else ""

    def _of_energy(self) -> str:
        """Remark on energy added or extracted by errors of the time steps; "" if small."""
        if not self.steps:
            return ""
        errors = EnergyErrors(
            kinetic=max(e.kinetic for e in (self.start, *(s.energies for s in self.steps))),
            deficit=max((s.deficit for s in self.steps), key=abs),
            contact=self.contact_energy,
            friction=-self.friction_work,
            imbalance=self.steps[0].work.imbalance,
            size=max(s.size for s in self.steps),
        )
        return errors.remark(self.scheme, self.rho_inf)

    def table(self) -> str:
        """Markdown table, one row per step."""
        head = ["step", "time", "iterations", "active", "cuts", "error", "kinetic energy"]
        rows, friction = [], 0.0
        for number, step in enumerate(self.steps, start=1):
            friction += step.work.shear
            cells = [f"{number}", f"{step.time:.6g}", f"{step.report.num_iterations}"]
            cells += [f"{step.report.iterations[-1].num_active}", f"{len(step.failures)}"]
            cells += [f"{step.error:.1e}", f"{step.energies.kinetic:.5g}"]
            rows.append([*cells, f"{step.energies.strain:.5g}", f"{friction:.4g}"])
        return markdown_table([*head, "strain energy", "work of friction"], rows)

    def __str__(self) -> str:
        """The table, and the remark if there is one."""
        return "\n\n".join(filter(None, (self.table(), self.remark())))


LOGGER = logging.getLogger("fenics_mortar")
LOGGER.addHandler(logging.NullHandler())


class Progress:
    """Log of one path; all methods are local.

    Args:
        comm: Communicator of the problem; rank 0 logs.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._logs, self._num_steps = comm.rank == 0, 0

    def accept(self, time: float, report: NewtonReport) -> None:
        """Log the accepted step to ``time``."""
        self._num_steps += 1
        self._log(f"step {self._num_steps}, time {time:.6g}: {report.reason}", report)

    def cut(self, time: float, reason: str, report: NewtonReport) -> None:
        """Log the failed step to ``time``."""
        self._log(f"time {time:.6g}: cut, {reason}", report)

    def _log(self, line: str, report: NewtonReport) -> None:
        if self._logs:
            LOGGER.info("%s", line)
            LOGGER.debug("%s", report)


class IdleLoads:
    """Comparison of the loads of all steps with those before the path.

    Args:
        problem: The problem, before the first step.
    """

    def __init__(self, problem: ContactProblem) -> None:
        self._problem, self._changed = problem, False
        self._first = self._loads()

    def look(self) -> None:
        """Compare the present loads (local)."""
        if not self._changed:
            pairs = zip(self._first, self._loads(), strict=True)
            self._changed = not all(np.array_equal(a, b) for a, b in pairs)

    def remarks(self, num_steps: int) -> list[str]:
        """The remark after several steps without any change; else none (collective).

        Laws that depend on the time may be the reason for such a path.

        Args:
            num_steps: Number of accepted steps.
        """
        contacts, comm = self._problem.equations.contacts, self._problem.equations.comm
        timed = any(isinstance(c, Contact) and needing_time(c) for c in contacts)
        if on_any_rank(comm, self._changed) or timed or num_steps < 2:
            return []
        return [
            "set_loads changed no constant, function, prescribed value, obstacle or law of the "
            "problem in any step: set values in place, e.g. push.value[1] = -0.03 * time"
        ]

    def _loads(self) -> list[Any]:
        """Values that ``set_loads`` may set, in a fixed order (local)."""
        loads, obstacles = loads_of(self._problem.equations), self._problem.obstacles
        shapes = [value for obstacle in obstacles for value in obstacle.shape().values()]
        return [*loads.values, *loads.laws, *shapes]
