# SPDX-License-Identifier: MIT
"""A solve: rigid moves, Newton's method with fallbacks, certificate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.contact.contact import Contact, begin_step, commit, instants_of
from fenics_mortar.contact.law import BUILT_IN
from fenics_mortar.contact.tied import Tie
from fenics_mortar.contact.view import describe_start
from fenics_mortar.equations import turns
from fenics_mortar.equations.diagnosis import describe_isolated
from fenics_mortar.equations.reduced import LinearBulk, ReducedEquations
from fenics_mortar.newton import loop
from fenics_mortar.obstacles.rigid_motion import RIGID, RigidPath
from fenics_mortar.rigid.floating import check_settled, settle
from fenics_mortar.rigid.proximal import solve_with_springs, solve_with_weak_springs
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import HALF_FACET, Array
from fenics_mortar.utils.clock import clock
from fenics_mortar.verify.certificate import Certificate, certify, tipping_bodies

if TYPE_CHECKING:
    from fenics_mortar.equations.general import ContactEquations
    from fenics_mortar.la.system import LinearSystem


class Solver:
    """Solution of the equations of a problem; all methods are collective.

    Args:
        equations: The equations; their state is changed.
        create_system: Function that creates their linear system.
        linear_bulk: Whether to solve on the contact dofs alone; see ``LinearBulk``.
        prefix: Prefix of PETSc's options.
    """

    def __init__(
        self, equations: ContactEquations, create_system: Callable[[], LinearSystem],
        *, linear_bulk: bool | None, prefix: str,
    ) -> None:  # fmt: skip
        self._equations, self._create_system = equations, create_system
        self._damps_first = self._may_cut = False
        equations.system = create_system()
        self.linear_bulk = LinearBulk(equations, linear_bulk, prefix)
        equations.reduced_tangent = self.linear_bulk.tangent
        equations.evaluate_operators()  # of the undeformed mesh
        for contact in equations.contacts:
            contact.set_initial_gap()
        equations.evaluate_operators()
        self.accept()
        self._starts = [(c, describe_start(c), c.offset) for c in equations.contacts]

    def _describe_starts(self) -> list[str]:
        """Messages on the undeformed mesh, once; none on pairs whose offset the user has set."""
        starts, self._starts = self._starts, []
        return [t for contact, t, before in starts if t and np.array_equal(contact.offset, before)]

    def _blame_mesh(self, error: errors.NotConvergedError) -> None:
        """Add to the error of the first solve that bodies of the mesh overlap deeply."""
        found = self._equations.crossings.wrong_at_start()
        if found:
            text = f"before the first solve {'; '.join(found)}: move these bodies apart in the mesh"
            error.args = (f"{error}; {text}",)
            error.report.notes.insert(0, text)

    def renew(self) -> None:
        """Create matrices and solvers again that may be incomplete after an interruption."""
        self._equations.bulk.renew_tangent()
        self._equations.bulk.assemble_tangent()
        self._equations.system = self._create_system()
        self.linear_bulk.reset()

    def accept(self) -> None:
        """Accept the last evaluated state: slip and paths of nodes are counted from it."""
        for contact in self._equations.contacts:
            contact.accept()
        self._equations.start_step()
        self._equations.crossings.accept(self._equations.motions.obstacle_places)

    def certificate(self, **of_step: Any) -> Certificate:
        """Measure balance, signs, penetration and crossings of the last evaluated state.

        All ranks have the numbers of rank 0, so that no rank refuses a state alone.

        Args:
            of_step: Measures of the step that led to the state, see ``Certificate``.
        """
        e = self._equations
        unbalanced, inside = e.motions.residual(), e.crossings.nodes_inside()
        solved = max(e.newton.residual_tolerance * e.residual.force, e.residual.attainable)
        certificate = certify(e.contacts, e.floating, unbalanced, inside, solved)
        tipping = tipping_bodies(e.floating, certificate.pairs, self._loads_of_motions())
        springs, crossings = e.springs.remaining(), e.crossings.find()
        carried = {"springs": springs.fraction, "held": springs.message}
        found = {**carried, "crossings": crossings, "tipping": tipping, **of_step}
        return ranks.agreed(e.comm, replace(certificate, **found))

    def _loads_of_motions(self) -> Array:
        """Loads at points less the forces of ties, with those in sections (owned dofs,) [force]."""
        e = self._equations
        loads = np.zeros(e.bulk.num_owned) - e.motions.pushed_nodes()
        for tie in (pair for pair in e.contacts if isinstance(pair, Tie)):
            for side, forces in zip((tie.slave, tie.master), tie.now.forces, strict=True):
                side.scatter_add(forces, loads)
        return -loads

    def solve(
        self, remarks: Sequence[str], *, accept_violations: bool, may_cut: bool
    ) -> loop.NewtonReport:
        """Solve from the present state; see ``ContactProblem.solve``.

        Args:
            remarks: First remarks of the record.
            accept_violations: Whether a state that violates its certificate is returned.
            may_cut: Whether a smaller step follows if this one fails.
        """
        e, self._may_cut = self._equations, may_cut
        clock.read()
        e.crossings.begin(e.motions.obstacle_places)
        begin_step(e.contacts)
        e.bulk.history.start_step()
        try:
            report, moved = self._move_and_solve()
            isolated = describe_isolated(e.bulk, e.contacts, e.floating)
            unsupported = [*e.idle.describe_unsupported(), *filter(None, [isolated])]
            e.idle.end()
            instants = instants_of(e.comm, e.contacts)
            history = e.bulk.history.new_values()
        except Exception as error:  # of any type, equal on all ranks
            if self._starts and isinstance(error, errors.NotConvergedError):
                self._blame_mesh(error)
            e.last_converged = False
            e.crossings.leave()
            e.springs.remove_springs()
            e.idle.end()
            raise
        e.last_converged = True
        before = e.state()
        for contact in e.contacts:
            contact.accept()
        commit(e.contacts, instants)
        e.bulk.history.accept(history)
        e.bulk.free_garbage()
        places, at_start = e.motions.obstacle_places, e.crossings.accepted
        passages, possible = e.crossings.passages(places)
        certificate = self.certificate(
            drift=e.motions.slide_along_driven(), passages=passages, possible_passages=possible
        )
        uncertain = e.crossings.led.messages(at_start, places, certificate.pairs_with("rotation"))
        certificate = replace(certificate, uncertain_turns=uncertain, unsupported=unsupported)
        report.certificate = certificate
        violations = certificate.violations()
        messages = [f"VIOLATED: {violation}" for violation in violations]
        judged = [*unsupported, *messages] if messages else certificate.remarks()
        reactions = e.motions.record()
        begun = [*remarks, *self._describe_starts(), *e.crossings.led.taken(at_start)]
        report.notes[:] = loop.merge_repeated([*begun, *moved, *judged, *reactions, *report.notes])
        if violations and not accept_violations:
            e.put(e.state().counting_slip_from(before).replaced(converged=False))
            raise _wrong_state(report, violations, moving=e.bulk.inertia is not None)
        e.crossings.accept(e.motions.obstacle_places)
        return report

    def _move_and_solve(self) -> tuple[loop.NewtonReport, list[str]]:
        """Rigid moves and a solve, and sentences on moved bodies.

        If this fails after idle bodies were set aside, all of them take part in contact: those that
        other bodies squeeze may stay where they are by symmetry only, as without friction. If it
        fails after ``push_aside``, the solve without this comes first.
        """
        e, failed = self._equations, None
        start, may_push, may_be_aside, pushed = e.state(), True, True, False
        while True:
            e.idle.reset(may_be_aside=may_be_aside)
            try:
                moved = self._move()
                pushed = may_push and turns.push_aside(e, e.idle.first)
                report = turns.follow_solution(
                    e, self._solve(follows=not pushed), partial(self._solve, follows=False)
                )
                moved += check_settled(e.floating, e.idle.reach())
                break
            except errors.MortarError as error:
                if failed is not None:
                    raise failed from error
                if not (e.idle.were_aside or pushed) or e.newton.tentative:
                    raise
                if not pushed:
                    failed, may_be_aside = error, False
                may_push = pushed = False
            e.springs.remove_springs()
            e.restore(start)
        return report, moved

    def _move(self) -> list[str]:
        """Rigid moves before a solve; sentences on moved bodies."""
        e = self._equations
        e.motions.follow(e.evaluate_operators)
        moved = e.motions.settle(partial(e.evaluate_contacts, start=True))
        moved += settle(e.floating, partial(e.idle.evaluate, e.evaluate_forces), e.idle.give_way)
        e.springs.remove_springs()
        if moved:
            self._accept_moved()
        turns.lead_by_motions(e, solved=False)
        e.idle.find(e.evaluate_forces)
        return moved

    def _solve(self, *, follows: bool = True) -> loop.NewtonReport:
        """Solve on the contact dofs if the bulk is linear, else on all dofs, from several starts.

        Where prescribed values turn bodies, and others with them, the first start is after these
        turns: from far away Newton's method may end on the other side of an obstacle. Where they
        would turn into others, or through them, this is the last start: Newton's method would stay
        there.

        Args:
            follows: Whether bodies may turn with others first, see ``with_followers``.
        """
        e = self._equations
        reduced, remarks = self.linear_bulk.choose()
        if reduced is not None:
            report = self._solve_reduced(reduced)
            if report is not None:
                report.solver = self.linear_bulk.choice
                report.notes[:0] = filter(None, remarks)
                return report
            remarks = [
                "the reduced iteration on the contact dofs failed: this step was solved on all dofs"
            ]
        e.system.solver.count_anew()
        start, may_turn = e.state(), not e.newton.tentative and e.bulk.inertia is None
        given = turns.turns_of_prescribed(e) if may_turn else {}
        followed = turns.with_followers(e, given) if may_turn and follows else given
        turned = [each for each in (followed, given)[len(followed) == len(given) :] if each]
        met = [(self._meets(each, start, followed=each is not given), each) for each in turned]
        clear, blocked = ([each for is_met, each in met if is_met is b] for b in (False, True))
        newton, starts = self._newton(), [*clear, {}, *blocked]
        for motions in starts:
            try:
                if motions:
                    turns.turn(e, motions, followed=motions is not given)
                if len(motions) > len(given):  # values tell no turns of others
                    turns.lead_by_motions(e, solved=True)
                report = newton()
                break
            except errors.NotConvergedError as error:
                if e.newton.tentative:
                    raise
                failed = error
            if motions is not starts[-1]:
                e.restore(start)
                failed.report.notes.append(f"{failed}: other bodies turn first, or none")
                newton = partial(loop.then_solve, failed.report, self._newton())
        else:
            report = self._solve_anew(start, failed)
        self.linear_bulk.count(report.num_iterations)
        why = [e.system.describe_solver(), self.linear_bulk.choice if reduced is None else ""]
        report.solver = "; ".join(filter(None, why))
        report.notes[:0] = remarks
        return report

    def _solve_reduced(self, reduced: ReducedEquations) -> loop.NewtonReport | None:
        """Solve on the contact dofs; the start again and ``None`` if that is no solution."""
        e = self._equations
        start = e.state()
        try:
            report = loop.solve(reduced, e.newton)
            reduced.finish()
            status = e.evaluate(start=False)
            force = max(report.force, status.force)
            solves = status.residual <= loop.allowed_residual(status, force, e.newton)
            if solves and not e.bulk.inverted_cells()[0]:
                return report
        except errors.NotConvergedError:
            if e.newton.tentative:
                raise
        e.restore(start)
        return None

    def _solve_anew(self, start: Any, failed: errors.NotConvergedError) -> loop.NewtonReport:
        """Solve on all dofs with damped steps or springs after Newton's method failed.

        In a large step that closes contact with friction, nodes stick or slide along slips that are
        far from the solution's, and full steps may never settle: of 128 such steps with thermal
        expansion 19 failed, all with and none without friction; a line search solves 17 of them.
        Users' laws may be steep or not monotonic, and full steps oscillate about a kink: what
        converged last is tried first. Bodies that float have the proximal point method instead.
        """
        e = self._equations
        floats = bool(e.floating.bodies) or e.motions.driven_obstacles.any()
        softens = bool(self._softening()) and not (floats and e.remedies.drifts())
        if self._has_own_law or softens or not floats:
            try:
                return self._restart(start, failed)
            except errors.NotConvergedError as error:
                if not floats:
                    raise
                failed = error
        if e.remedies.drifts():
            try:
                return solve_with_weak_springs(e, e.newton, failed, max_fraction=RIGID.slight)
            except errors.NotConvergedError as with_springs:
                failed = errors.NotConvergedError(failed.report.reason, with_springs.report)
        e.restore(start)
        return solve_with_springs(e, e.newton, failed)

    def _meets(self, motions: dict[int, RigidPath], start: Any, *, followed: bool) -> bool | None:
        """Whether bodies turn by ``motions`` into others or through them (collective).

        Newton's method resolves overlaps of less than half a facet, which contact sees. ``None`` if
        contact is not defined there, as by a distance that is finite near its surface only.
        """
        e = self._equations
        try:
            turns.turn(e, motions, followed=followed)
            deep = any(c.facets > max(c.admitted, HALF_FACET) for c in e.crossings.find())
            found = deep or bool(e.crossings.passages(e.motions.obstacle_places)[0])
        except errors.NotFiniteError:  # on all ranks
            return None
        finally:
            e.restore(start)
        return ranks.agreed(e.comm, found)

    def _restart(self, start: Any, failed: errors.NotConvergedError) -> loop.NewtonReport:
        """Newton's method with damped steps after full ones, with a user's law also reversely.

        Bonds that soften have no derivative then: gaps grow up to the next equilibrium, also where
        a whole body is more compliant than its nodes, by which slow softening is recognized.

        Raises:
            NotConvergedError: If this fails as well, steps were damped, nothing rubs or softens, or
                only rubs and the step may be cut.
        """
        e = self._equations
        rubs = any(contact.pair.law.has_friction for contact in e.floating.contacts)
        again = rubs and not (self._damps or self._may_cut)
        others = [(not self._damps, True)] if self._has_own_law or again else []
        # a bond about to break is left by full steps alone, and equilibrium found with derivatives
        softens = [(False, True), (False, False)] if self._softening() else []
        if e.newton.damped or not (others or softens):
            raise failed
        last = failed
        for damped, anew in dict.fromkeys([*softens, *others]):
            how = f"{'restarted' if anew else 'continued'} with {'damped' if damped else 'full'}"
            last.report.notes.append(f"{how} steps: {last}")
            if anew:
                e.restore(start)
            try:
                for c in self._softening():
                    c.omit_softening(always=anew)
                report = loop.then_solve(last.report, self._newton(damped))
            except errors.NotConvergedError as error:
                last = error
                continue
            except errors.NotFiniteError as error:  # where the attempt before has ended
                last = errors.NotConvergedError(str(error), last.report)
                continue
            finally:
                for c in self._softening():
                    c.omit_softening(always=False)
            self._damps_first = damped
            return report
        raise errors.NotConvergedError(str(failed), last.report) from None

    def _softening(self) -> list[Contact]:
        """Contacts with adhesion, which may decrease with the gap."""
        return [c for c in self._equations.floating.contacts if c.pair.law.has_adhesion]

    @property
    def _damps(self) -> bool:
        """Whether damped steps are tried first: for bodies with history, which may yield.

        With a user's law those that converged last. Full steps from elastic strains far beyond
        yield diverge; in smaller steps damped ones are full.
        """
        e = self._equations
        of_law = self._damps_first and self._has_own_law and not e.newton.tentative
        return of_law or bool(e.bulk.history.functions)

    @property
    def _has_own_law(self) -> bool:
        """Whether a contact has a user's law."""
        return not all(type(c.pair.law) in BUILT_IN for c in self._equations.floating.contacts)

    def _newton(self, damped: bool | None = None) -> Callable[[], loop.NewtonReport]:
        """Newton's method, by default as it converged last; to be called at a state."""
        e = self._equations
        options = e.newton
        if damped is not None and not self._may_cut:
            options = replace(options, max_iterations=2 * options.max_iterations)
        if (self._damps if damped is None else damped) and not options.damped:
            options = replace(options, line_search=True)
        return partial(loop.solve, loop.Damped(e, options) if options.damped else e, options)

    def _accept_moved(self) -> None:
        """Count slip from the positions after rigid moves, except for nodes that slid.

        Motion of a body towards another one is not slip; motion along a surface in contact is slip.
        """
        e = self._equations
        touched = iter(e.floating.settling.touched)
        for contact in e.contacts:
            if isinstance(contact, Contact):
                before = next(touched, np.zeros_like(contact.active))
                contact.accept(slid=before & contact.active)
            else:
                contact.accept()
        e.start_step()


def _wrong_state(
    report: loop.NewtonReport, violations: Sequence[str], *, moving: bool
) -> errors.NotConvergedError:
    """Error for a state that violates its certificate, with advice; ``Dynamics`` accepts none."""
    report.reason = f"converged to a wrong state: {'; '.join(violations)}"
    report.converged = False
    smaller = any("smaller steps" in message or "inverted" in message for message in violations)
    advice = "follow_path reverts and cuts such a step; " * (smaller and not moving)
    if not moving:
        advice += "solve(accept_violations=True) returns the state"
    return errors.NotConvergedError("; ".join(filter(None, (report.reason, advice))), report)
