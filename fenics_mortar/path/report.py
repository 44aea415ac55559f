# SPDX-License-Identifier: MIT
"""Records of load paths and of motions, with the work and the energies of each step.

A ``PathReport`` consists of accepted steps, each a ``PathStep``, a ``DynamicsReport`` of time
steps, each a ``TimeStep``. ``Work`` is that of all forces in a step, and ``EnergyErrors`` remark on
what errors of time steps change. ``log_solve`` logs the progress of a path, ``remarks_on_idle``
remarks on loads that do not change.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.contact import needing_time
from fenics_mortar.contact.law import Frictionless, Row
from fenics_mortar.equations.predictor import loads_of
from fenics_mortar.obstacles.rigid_motion import motion_between
from fenics_mortar.utils import files, ranks
from fenics_mortar.utils.arrays import TINY, Array

if TYPE_CHECKING:
    from fenics_mortar.equations.general import State
    from fenics_mortar.newton.loop import NewtonReport
    from fenics_mortar.problem import ContactProblem

Forces = tuple[Array, Array, Array, Array, Array, list[Array]]


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
        layers: Work that normal forces of the laws take: adhesion as gaps open, soft layers as they
            are compressed, wear as it proceeds.
    """

    bulk: float
    supports: float
    contact: float
    shear: float = 0.0
    largest: float = 0.0
    friction: float = 0.0
    layers: float = 0.0

    @property
    def pressure(self) -> float:
        """Work of the pressures without that of ``layers`` [stress length^2].

        Pressures on closed gaps do no work: this is energy added by the discretization. It vanishes
        with the size of facets and steps, but slowly below a sliding corner, where the pressure is
        unbounded.
        """
        return self.contact - self.shear - self.layers

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
        moments stress length^2], and of all pairs the rows of ``_layers``.
    """
    equations = problem.equations
    residual, motions = equations.residual, equations.motions
    on_obstacles = motions.obstacle_forces("shear")
    on_obstacles = on_obstacles * motions.scales[: len(on_obstacles)]
    layers = [_layers(contact) for contact in equations.contacts]
    return *problem.forces(), residual.contact_force("shear"), on_obstacles, layers


def _layers(contact: Any) -> Array:
    """Normal forces and adhesion at the slave nodes, and the lengths along which they do work.

    The gap that contact closes, and the layer's thickness, the mean gap without it; nan at nodes
    that are not covered, and no nodes where the law has neither layer nor adhesion; (4, nodes).
    """
    law, f = getattr(contact.pair, "law", Frictionless()), contact.now
    if not (law.has_closing_gap or law.has_adhesion):
        return np.empty((4, 0))
    w, closing = f.operators.weight, np.where(f.covered, f.nodal.gap, np.nan)
    return np.array([w * f.z_n, w * f.pull.residual, closing, f.mean_gap - closing])


def _work_of_layers(contact: Any, before: Array, after: Array, *, in_time: bool) -> float:
    """Work that the normal forces of a law take between two results of ``_layers``.

    In time steps by Lobatto's rule for adhesion, and for the pressure of a soft layer by its
    thickness: ``Corrections`` returns what the mean forces have done in excess.
    """
    if not before.size:
        return 0.0
    (pressure, pull), f, law = 0.5 * (before[:2] + after[:2]), contact.now, contact.pair.law
    (opening, thickening), calls, node = after[2:] - before[2:], contact.law_calls, f.nodal

    def row(method: str, fraction: float, gap: Array) -> Row:
        gap, slip = np.where(f.covered, gap, 0.0), fraction * node.slip
        return calls.row(method, replace(node, gap=gap, slip=slip), f.covered)

    def adhesion(fraction: float) -> Array:
        gap = np.maximum(before[2] + fraction * opening, 0.0)
        return f.operators.weight * row("adhesion_at", fraction, gap).residual

    def of_layer(fraction: float) -> Array:
        found = row("closing_gap", fraction, before[3] + fraction * thickening)
        slope = np.where(found.by_z_n == 0.0, np.inf, found.by_z_n)  # without a pressure of its own
        return f.operators.weight * (node.z_n - found.residual / slope)

    if in_time and law.has_adhesion:
        pull = pull - excess_of_trapezoids(adhesion)
    if in_time and law.has_closing_gap and not law.memory:  # wear depends on the slip
        pressure = pressure - excess_of_trapezoids(of_layer)
    return float(np.nansum(pull * opening - pressure * thickening))


# Distance of the inner points of Lobatto's rule from the middle of a step [steps].
LOBATTO = 0.5 / 5.0**0.5


def excess_of_trapezoids(force: Callable[[float], Array]) -> Array:
    """Mean of a force in a step by the trapezoidal rule, minus that by Lobatto's with four points.

    Args:
        force: Function of the fraction of the step, shape (n,) [any unit].

    Returns:
        Shape (n,) [unit of the force].
    """
    inner = force(0.5 - LOBATTO) + force(0.5 + LOBATTO)
    return 5.0 / 12.0 * (force(0.0) - inner + force(1.0))


def work_of(
    problem: ContactProblem, start: State, end: State, before: Forces, after: Forces,
    *, in_time: bool = False,
) -> Work:  # fmt: skip
    """Work of the mean forces in a step; obstacles are treated as supports (collective).

    Args:
        problem: The problem.
        start: State at the start of the step.
        end: State at the end of the step.
        before: Forces at the start of the step, see ``forces_of``.
        after: Forces at the end of the step.
        in_time: Whether it is a time step, in which the error of the mean forces of layers counts.
    """
    means = (0.5 * (a + b) for a, b in zip(before[:-1], after[:-1], strict=True))
    r, contact, on_obstacles, shear, shear_on_obstacles = means
    equations, du = problem.equations, (end.u - start.u)[: r.size]
    prescribed, dofs = equations.bulk.prescribed_dofs, equations.bulk.space.owned_dofs
    supports = (r + contact)[prescribed] @ du[prescribed]
    sizes = np.linalg.norm(contact[dofs], axis=1) @ np.linalg.norm(du[dofs], axis=1)
    work = np.array([r @ du, supports, contact @ du, shear @ du, sizes, 0.0, 0.0])
    work = equations.comm.allreduce(work)
    places = zip(start.places[: len(on_obstacles)], end.places, strict=False)
    moved = np.reshape([motion_between(*ends, 1.0) for ends in places], on_obstacles.shape)
    work[1:3] += (on_obstacles * moved).sum()
    work[3] += (shear_on_obstacles * moved).sum()
    work[4] += np.abs(on_obstacles * moved).sum()
    work[5] = sum(pair.now.friction_work for pair in equations.contacts)
    layers = partial(_work_of_layers, in_time=in_time)
    work[6] = sum(map(layers, equations.contacts, before[-1], after[-1]))
    return Work(*map(float, work))


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


class _OfSteps(files.Markdown):
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
        return "\n".join([files.markdown_table(head, rows), *(["", *reasons] if reasons else [])])

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
        deficit: Largest energy lost and not returned, zero unless the scheme is "conserving"
            [likewise].
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
            kinetic: Kinetic energy at its end [stress length^2].
            deficit: Energy lost so far and not returned [likewise].
            size: The step [time].
            time: Its end [time].
        """
        return EnergyErrors(
            kinetic=max(self.kinetic, kinetic),
            deficit=max(self.deficit, deficit, key=abs),
            contact=self.contact - work.pressure,
            friction=self.friction - work.shear,
            imbalance=self.imbalance if self.time else work.imbalance,
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
        errors = EnergyErrors(kinetic=self.start.kinetic)
        for step in self.steps:
            totals = step.energies.kinetic, step.deficit
            errors = errors.after(step.work, *totals, size=step.size, time=step.time)
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
        return files.markdown_table([*head, "strain energy", "work of friction"], rows)

    def __str__(self) -> str:
        """The table, and the remark if there is one."""
        return "\n\n".join(filter(None, (self.table(), self.remark())))


LOGGER = logging.getLogger("fenics_mortar")
LOGGER.addHandler(logging.NullHandler())


def log_solve(comm: MPI.Comm, line: str, report: NewtonReport) -> None:
    """Log the end of a step, accepted or not, and its solve, on rank 0 (local).

    Records are those of the logger ``fenics_mortar``: each accepted step and each cut with level
    INFO, and the table of each solve with level DEBUG. Nothing is shown unless the program sets up
    logging::

        logging.basicConfig()
        logging.getLogger("fenics_mortar").setLevel(logging.INFO)
    """
    if comm.rank == 0:
        LOGGER.info("%s", line)
        LOGGER.debug("%s", report)


def values_to_set(problem: ContactProblem) -> list[Any]:
    """Values that ``set_loads`` may set, in a fixed order (local)."""
    values, laws = loads_of(problem.equations)
    shapes = [value for obstacle in problem.obstacles for value in obstacle.shape().values()]
    return [*values, *laws, *shapes]


def remarks_on_idle(problem: ContactProblem, num_steps: int, *, changed: bool) -> list[str]:
    """Remark on several steps in which no rank had other loads than before them (collective).

    Laws that depend on the time may be the reason for such a path.

    Args:
        problem: The problem after the steps.
        num_steps: Number of accepted steps.
        changed: Whether the loads changed on this rank.
    """
    timed = any(map(needing_time, problem.equations.floating.contacts))
    if ranks.on_any_rank(problem.equations.comm, changed) or timed or num_steps < 2:
        return []
    return [
        "set_loads changed no constant, function, prescribed value, obstacle or law of the "
        "problem in any step: set values in place, e.g. push.value[1] = -0.03 * time"
    ]
