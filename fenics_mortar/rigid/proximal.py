# SPDX-License-Identifier: MIT
"""Springs on bodies and obstacles that contact hardly holds: the proximal point method.

An anchored spring is part of the residual until it is removed, see ``solve_with_springs``. A
tangent spring regularizes a motion that active contact does not resist. Its stiffness is in
proportion to the force that drives the motion, so it vanishes at equilibrium (Levenberg-Marquardt),
and the converged solution is unaffected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.bodies import resistance
from fenics_mortar.newton.loop import NewtonOptions, NewtonReport, solve, then_solve
from fenics_mortar.obstacles.rigid_motion import RIGID
from fenics_mortar.utils.arrays import SOLVED, TINY, Array, Value
from fenics_mortar.utils.errors import NotConvergedError


class SpringForce(NamedTuple):
    """Force of anchored springs on a body or obstacle, see ``carried_by``.

    Attributes:
        name: Of the body or obstacle.
        fraction: Force of springs over the contact force on it [1].
        slides: Whether all its nodes with friction slide.
        how: The motion by which it stretches the springs; "" without a force.
        tips: Whether sticking of all its nodes could not prevent this motion either.
        closed: Whether it slides, and all its nodes that face another surface are in contact.
    """

    name: str
    fraction: float
    slides: bool
    how: str
    tips: bool
    closed: bool

    def __str__(self) -> str:
        """The force in words."""
        force = (
            f"springs carry {self.fraction:.1e} of the contact force on {self.name}"
            if np.isfinite(self.fraction)
            else f"springs carry all forces on {self.name}, which no contact force acts on"
        )
        return force + f", without which it would {self.how}" * (self.how != "")


class Nearest(NamedTuple):
    """The first state on a way where springs carry about the least, if this is negligible.

    Attributes:
        fraction: Largest force of springs over the contact force on a body [1].
        state: ``None`` where no state is known; states that carry half of ``fraction`` are nearer.
    """

    fraction: float
    state: Any


NOWHERE = Nearest(RIGID.recovery * RIGID.negligible, None)


class Remaining(NamedTuple):
    """Forces of anchored springs.

    Attributes:
        fraction: Largest force of springs over the contact force on a body or obstacle [1].
        sliding: Largest such force on bodies whose nodes with friction all slide [1].
        message: A sentence with the names of the bodies and obstacles on which springs carry more
            than a slight force; "" without one.
        endless: As ``sliding``, if no open node faces another surface, which could stop the slide.
    """

    fraction: float
    sliding: float
    message: str
    endless: float = 0.0

    def may_remain(self, largest: float = RIGID.negligible) -> bool:
        """Whether no force is above ``largest``, nor above a slight one on a body that slides."""
        return self.fraction <= largest and self.sliding <= RIGID.slight


def solve_with_springs(
    equations: Any, options: NewtonOptions, failed: NotConvergedError
) -> NewtonReport:
    """Solve with springs, and finally without springs or with weak ones (collective).

    The proximal point method for bodies and obstacles that roll or slide, with anchored springs. If
    contact hardly resists a rigid motion, for instance of a polygon that rolls from facet to facet,
    a Newton step along it is far too long. Anchored springs limit the step: a solve with springs
    converges, the springs are anchored at the new positions, and so on until the bodies come to
    rest (proximal point method, Rockafellar 1976). With conservative forces each solve decreases
    the potential, and the method converges to a minimum. The last solve is without springs.

    Contact forces on facets are not exactly conservative, since they act along averaged normals.
    The error may drive a rolling disk, which then has no equilibrium nearby. In this case weak
    springs remain, and a remark of the certificate states their force, unless it is slight. A
    slight slope drives a body as well: springs become weaker as long as they may remain, so that it
    moves on to its equilibrium; where it finds none it stays. Springs may not remain on a body
    whose nodes with friction all slide, since they would stop a steady slide.

    Args:
        equations: The equations, at the initial state.
        options: Options of the last solve.
        failed: Error of the solve without springs.

    Returns:
        The record of all iterations, including those of ``failed``.

    Raises:
        NotConvergedError: On all ranks, if the bodies do not come to rest; those that tip over at
            the first state on springs where one does come first in its message.
    """
    run = _OnSprings(equations, options, failed)
    try:
        return _solve_on(run)
    except NotConvergedError as error:
        if not run.tips:
            raise
        raise NotConvergedError(f"{run.tips[0]}; {error}", error.report) from failed


def _solve_on(run: _OnSprings) -> NewtonReport:
    """``solve_with_springs``."""
    equations, options, failed = run.equations, run.options, run.failed
    begin = equations.state()
    report, first, nearest = run.move(failed.report, NOWHERE)
    arrived, carried = equations.state(), equations.springs.remaining()
    if not run.topples(carried):
        try:
            return run.without(report)
        except NotConvergedError as error:
            report = error.report
    slides = carried.fraction <= RIGID.negligible and not carried.may_remain()
    if carried.fraction > RIGID.slight and not (slides or run.topples(carried)):
        equations.restore(arrived if carried.fraction < np.inf else begin)
        aim = RIGID.elongation if carried.fraction < np.inf else first
        try:
            report, _, nearest = run.move(report, nearest, balanced=True, aim=aim)
            arrived, carried = equations.state(), equations.springs.remaining()
            if not run.topples(carried):
                return run.without(report)
        except NotConvergedError as error:
            report = error.report
    repeats = RIGID.repeats
    if carried.fraction > RIGID.slight and nearest.state is not None:
        arrived, repeats = nearest.state, 1  # no equilibrium was on the way
    elif run.topples(carried):
        raise NotConvergedError(failed.report.reason, report)
    equations.restore(arrived)
    again = NotConvergedError(failed.report.reason, report)
    return solve_with_weak_springs(equations, options, again, repeats=repeats)


def solve_with_weak_springs(
    equations: Any, options: NewtonOptions, failed: NotConvergedError, *, repeats: int = 1,
    max_fraction: float = RIGID.negligible,
) -> NewtonReport:  # fmt: skip
    """Solve with weak springs that remain (collective).

    Args:
        equations: The equations, near a state that is unbalanced by small forces only.
        options: Options of the solves.
        failed: Error of the solve without springs.
        repeats: Number of solves, each with springs anchored at the result of the last one.
        max_fraction: Largest force of springs over the contact force on a body [1];
            ``RIGID.slight`` on bodies whose nodes with friction all slide.

    Returns:
        The record of all iterations, including those of ``failed``.

    Raises:
        NotConvergedError: On all ranks, if a solve fails or the force of springs is larger.
    """
    report, shorter = failed.report, RIGID.recovery ** (3 * np.arange(RIGID.max_failures))
    run = _OnSprings(equations, options, failed)
    for _ in range(repeats):
        for aim in (RIGID.elongation / shorter).tolist():
            report, reason = run.anchored(report, aim, touched=True)
            if not reason:
                break
        else:
            raise NotConvergedError(f"{failed}; {reason}", report) from failed
    carried = equations.springs.remaining()
    if not carried.may_remain(max_fraction):
        reasons = [str(failed), carried.message][:: -1 if carried.sliding > RIGID.slight else 1]
        raise NotConvergedError("; ".join(reasons), report) from failed
    return report


@dataclass(frozen=True)
class _OnSprings:
    """Solves of equations after one without springs that failed; records begin with ``report``.

    ``tips``: which bodies tip over at the first state where loads do work on a motion in which
    bodies separate, in words; later ones may have been thrown somewhere.
    """

    equations: Any
    options: NewtonOptions
    failed: NotConvergedError
    tips: list[str] = field(default_factory=list)

    def without(self, report: NewtonReport) -> NewtonReport:
        """Solve without springs."""
        self.equations.springs.remove_springs()
        return then_solve(report, partial(solve, self.equations, self.options))

    def move(
        self, report: NewtonReport, nearest: Nearest, *, balanced: bool = False,
        aim: float = RIGID.elongation,
    ) -> tuple[NewtonReport, float, Nearest]:  # fmt: skip
        """Solve with springs until their elongation vanishes, at most ``RIGID.max_solves`` times.

        Springs that carry negligible forces become weaker, down to the elongation ``aim`` by these
        forces: on a slight slope the first ones hold a body that slides on to its equilibrium.

        If ``balanced``, also until their force is slight, with ever weaker ones. A round body on
        one node hardly moves against the first ones, although they carry its moment, and has to
        roll until the next node supports it, too. Solves after which no contact force acts on a
        body have failed then: Newton's method has jumped. The first elongation is ``aim``.

        Bodies may not come to rest, such as a ball without friction, which the error of the contact
        forces turns forever. If they tip over, see ``topples``, by ever larger forces in
        ``RIGID.max_toppling`` successive solves, the way leads to no equilibrium nearby, and ends.

        Returns:
            The record of all iterations; the elongation of the first solve that did not fail (with
            longer ones another pass from the same state would fail, too); the nearest state.
        """
        # the last solve, without springs, uses the user's tolerance
        tolerance = max(SOLVED, self.options.residual_tolerance)
        rough = replace(self, options=replace(self.options, residual_tolerance=tolerance))
        springs, failures, first = self.equations.springs, 0, None
        share, slides, before, toppling = 1.0, [0.0], 0.0, 0
        for _ in range(RIGID.max_solves):
            report, reason = rough.anchored(report, aim, touched=balanced, share=share)
            if reason:
                aim, failures = aim / RIGID.recovery**3, failures + 1
                share = 1.0
                if failures == RIGID.max_failures:
                    raise NotConvergedError(self.failed.report.reason, report)
                continue
            first = first or aim
            if not self.tips:
                tips = springs.tipping()
                self.tips.extend([tips] * (tips != ""))
            rests = springs.max_motion() < RIGID.overlap * aim / RIGID.elongation
            carried = springs.remaining()
            slides.append(carried.endless)
            if _are_steady(slides[-RIGID.steady :]):
                raise NotConvergedError(f"{carried.message}; {self.failed}", report)
            if rests and not (balanced and carried.fraction > RIGID.slight):
                break
            grows = carried.fraction > before and self.topples(carried)
            before, toppling = carried.fraction, toppling + 1 if grows else 0
            if toppling == RIGID.max_toppling:
                break
            if carried.fraction <= nearest.fraction / RIGID.recovery:
                nearest = Nearest(carried.fraction, self.equations.state())
            aim, failures = RIGID.recovery * aim, 0
            aim = aim if rests else min(aim, RIGID.elongation)
            share = share / RIGID.recovery if carried.may_remain() else 1.0
        return report, first or aim, nearest

    def topples(self, carried: Remaining) -> bool:
        """Whether loads tip bodies over that springs hold by more than the error of contact."""
        return carried.fraction > RIGID.normals_err and self.equations.springs.tipping() != ""

    def anchored(
        self, report: NewtonReport, aim: float, *, touched: bool, share: float = 1.0
    ) -> tuple[NewtonReport, str]:
        """One solve with springs; a failure restores the state.

        Args:
            report: Record of the iterations before.
            aim: Elongation of the springs [shortest facets].
            share: Share of the error of contact forces that has this elongation at least [1].
            touched: Whether contact acts on all bodies; if not after the solve, it has failed.

        Returns:
            The record of all iterations, and the reason of a failure, "" without one.
        """
        equations, start = self.equations, self.equations.state()
        equations.springs.anchor(aim, share)
        try:
            report = then_solve(report, partial(solve, equations, self.options))
            carried = equations.springs.remaining()
            if not touched or carried.fraction < np.inf:
                return report, ""
            reason = carried.message
        except NotConvergedError as error:
            report, reason = error.report, str(error) or "not converged"
        equations.restore(start)
        return report, reason


def _are_steady(forces: Sequence[float]) -> bool:
    """Whether the last forces of springs over those of contact do not decrease (local)."""
    least, largest = min(forces), max(forces)
    return len(forces) == RIGID.steady and least > max(
        RIGID.negligible, (1.0 - RIGID.overlap) * largest
    )


@dataclass(frozen=True)
class Springs(Value):
    """Anchored springs, relaxed at a displacement and at places.

    Attributes:
        of_bodies: Stiffness of the springs on each body, by its label, shape (bodies,) [stress].
        of_motions: The same on obstacles and remote loads, shape (m, 3) [stress].
        u: The displacement, shape (owned dofs,) [length].
        places: The places, shape (m, 3) [length, length, radian].
    """

    of_bodies: Array
    of_motions: Array
    u: Array
    places: Array


class AnchoredSprings:
    """Anchored springs on floating bodies and driven obstacles; all methods are collective.

    Args:
        equations: The ``ContactEquations``.

    Attributes:
        present: The springs, ``None`` without.
    """

    def __init__(self, equations: Any) -> None:
        self._equations = equations
        self._bodies, self._motions = equations.floating, equations.motions
        self._bodies.springs = self._motions.springs = self
        self.present: Springs | None = None

    def anchor(self, elongation: float, share: float = 1.0) -> None:
        """Anchor floating bodies and driven obstacles at their present positions.

        The forces that drive a body now, or a ``share`` of the error of its contact forces, would
        elongate its springs by ``elongation`` shortest facets.
        """
        bodies, motions, stiffest = self._bodies, self._motions, self._equations.stiffest
        bulk, contact, _ = self._equations.residual.forces()
        total, residual = bulk + contact - motions.pushed_nodes(), motions.residual()
        of_bodies, of_motions = np.zeros(bodies.num_bodies), np.zeros(motions.scales.shape)
        for body in bodies.bodies:
            drive, err = body.resultant(total), share * RIGID.normals_err * body.contact_force()
            length = elongation * bodies.shortest_facet()
            of_bodies[body.label] = anchored_stiffness(drive, err, length, body.stiffest)
        on_obstacles = zip(motions.on_contacts, of_motions, residual, strict=False)
        for obstacle, stiffness, drive in on_obstacles:
            err = share * RIGID.negligible * obstacle.contact_force()
            length = elongation * motions.shortest_facet
            stiffness[obstacle.driven] = anchored_stiffness(drive, err, length, stiffest)
        self.present = Springs(of_bodies, of_motions, self._u(), motions.places)

    def remove_springs(self) -> None:
        """Remove the springs."""
        self.present = None

    def remove_idle(self) -> None:
        """Remove the springs on idle bodies."""
        if self.present is not None:
            self.present = self.present.replaced(of_bodies=self._acting(self.present))

    def max_motion(self) -> float:
        """Largest rigid motion since ``anchor`` [shortest facets]."""
        if self.present is None:
            return 0.0
        bodies, motions, change = self._bodies, self._motions, self._u() - self.present.u
        moves = [
            np.linalg.norm(body.rigid_fraction(change)) / bodies.shortest_facet()
            for body in bodies.bodies
            if body.label not in bodies.aside
        ]
        strain = np.where(motions.driven, motions.motions_since(self.present.places), 0.0)
        on_obstacles = strain[: len(motions.on_contacts)] / motions.shortest_facet
        return float(max([*moves, *np.linalg.norm(on_obstacles, axis=1)], default=0.0))

    def on_bodies(self) -> Array:
        """Forces on bodies, (owned dofs,), zero without springs [stress length].

        Springs on idle bodies only regularize the tangent.
        """
        if self.present is None:
            return np.zeros(self._bodies.bulk.num_owned)
        acting = self._bodies.spread(self._acting(self.present))
        return acting * (self._u() - self.present.u)

    def on_motions(self) -> Array:
        """Forces on motions, (m, 3), zero without springs [stress length]."""
        if self.present is None:
            return np.zeros(self._motions.scales.shape)
        return self.present.of_motions * self._motions.motions_since(self.present.places)

    def carried(self) -> list[SpringForce]:
        """Forces of the springs on each floating body, then on each driven obstacle."""
        if self.present is None:
            return []
        bodies, forces = self._bodies.bodies, self.on_bodies()
        contact = sum(body.contact_force() for body in bodies)
        shear = self._equations.residual.contact_force("shear")
        found = [
            carried_by(
                body, -body.resultant(forces), body.resultant(shear), body.rounding(contact),
                body.loose(rough=True),
            )
            for body in bodies
        ]  # fmt: skip
        on_obstacles = zip(self._motions.on_contacts, self.on_motions(), strict=False)
        return found + [
            carried_by(each, on, -each.force("shear"))
            for each, on in on_obstacles
            if each.driven.any()
        ]

    def remaining(self) -> Remaining:
        """Forces of the springs over contact forces."""
        carried = self.carried()
        held = [each for each in carried if each.fraction > RIGID.slight]
        return Remaining(
            max((each.fraction for each in carried), default=0.0),
            max((each.fraction for each in carried if each.slides), default=0.0),
            f"{', '.join(map(str, held))}: {_reason(held)}" if held else "",
            max((each.fraction for each in carried if each.closed), default=0.0),
        )

    def tipping(self) -> str:
        """Bodies that tip over at the present state, in words; "" if there are none."""
        bulk, _, _ = self._equations.residual.forces()
        return self._bodies.tipping(bulk)

    def _acting(self, springs: Springs) -> Array:
        """Stiffness of springs on bodies, zero for idle ones, shape (bodies,) [stress]."""
        idle = np.isin(np.arange(springs.of_bodies.size), list(self._bodies.aside))
        return np.where(idle, 0.0, springs.of_bodies)

    def _u(self) -> Array:
        """Displacement of the owned dofs [length]."""
        return self._bodies.bulk.values[: self._bodies.bulk.num_owned]


def _reason(held: Sequence[SpringForce]) -> str:
    """Why springs carry forces."""
    lost = [each.name for each in held if not np.isfinite(each.fraction)]
    if lost:
        have = "has" if len(lost) == 1 else "have"
        return f"{', '.join(lost)} {have} lost all contact; add a support, or prescribe the motion"
    tipping = [each.name for each in held if each.slides and each.tips]
    if tipping:
        return (
            f"loads turn {', '.join(tipping)} about the only place where contact acts, which no "
            "friction can prevent; move the loads or the supports, or prescribe the motion"
        )
    sliding = [each.name for each in held if each.slides]
    if sliding:
        return (
            f"all nodes with friction of {', '.join(sliding)} slide at their friction limit, which "
            "the loads exceed; reduce these, or prescribe the motion"
        )
    unbalanced = ", ".join(each.name for each in held if each.fraction > RIGID.normals_err)
    if unbalanced:
        return (
            f"the loads on {unbalanced}, with the pushes of obstacles, are not in balance, and no "
            "contact resists what is left of them: balance them, add a support, or prescribe the "
            "motion of one obstacle instead of its push"
        )
    return (
        "this may be no equilibrium: either loads drive the motion slightly, or the corners of the "
        "facets do, along whose averaged normals forces act; add a support, prescribe the motion, "
        "refine, or take the smoother side of a pair as slave"
    )


def anchored_stiffness(drive: Array, err: float, length: float, stiffness: float) -> float:
    """Stiffness of a spring with a given elongation under given forces [stress] (local).

    Args:
        drive: Forces that drive the motions, shape (motions,) [stress length].
        err: Discretization error of this force [stress length].
        length: Elongation of the spring under the larger of both [length].
        stiffness: Stiffness of the bulk [stress]; the spring of a body without force has the
            fraction ``RIGID.weakest_spring`` of it.
    """
    spring = max(float(np.linalg.norm(drive)), err) / length
    is_forceless = spring < RIGID.weakest_anchor * stiffness
    return RIGID.weakest_spring * stiffness if is_forceless else spring


def carried_by(
    mover: Any, springs: Array, shear: Array, rounding: float = 0.0, free: Array | None = None
) -> SpringForce:
    """What springs carry of the force on a body or obstacle (collective).

    Args:
        mover: The body or obstacle.
        springs: Force of the springs along its motions, shape (motions,) [stress length].
        shear: Force of friction along them, shape (motions,) [stress length].
        rounding: Force that is considered zero [stress length].
        free: Orthonormal motions that contact of any friction admits, (n, motions) [1].
    """
    size, contact = float(np.linalg.norm(springs)), mover.contact_force()
    acts = size > rounding
    fraction = size / contact if contact > 0.0 else np.inf
    sticks, slides = (
        any((getattr(contact, marks) & mover.at(contact)).any() for contact in mover.contacts)
        for marks in ("sticking", "sliding")
    )
    slides = slides and not sticks
    driven = shear @ springs >= 0.0  # by friction, which ends with the slip
    closed = (slides and not driven) and all(
        bool((c.active | ~c.now.has_partner)[mover.at(c)].all()) for c in mover.contacts
    )
    how = mover.describe(springs, directed=True) if acts else ""
    tips = free is not None and bool(np.linalg.norm(free @ springs) > RIGID.slight * contact)
    return SpringForce(mover.name, fraction if acts else 0.0, slides, how, tips, closed)


def tangent_stiffness(drive: Array, force: float) -> float:
    """Stiffness of a tangent spring over that of the bulk [1] (local).

    Args:
        drive: Resultant along the regularized motions, shape (n,) [stress length].
        force: Size of all forces [stress length].
    """
    relative = float(np.linalg.norm(drive)) / max(force, TINY)
    return float(np.clip(relative, RIGID.weakest_spring, 1.0))


def unresisted(responses: Array) -> Array:
    """Orthonormal combinations of motions that contact does not resist, (k, motions) [1] (local).

    Args:
        responses: Changes of gaps and slips due to each motion, shape (motions, n), replicated.
    """
    norms, combinations = resistance(responses, MPI.COMM_SELF)
    return combinations[norms <= RIGID.resisted]
