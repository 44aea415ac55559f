# SPDX-License-Identifier: MIT
"""Initial guess of a solve: extrapolation of the last states.

``Predictor`` extrapolates the states of a path, linearly or in a ``MovingFrame``; ``Continuation``
does so for the solves of a user's loop.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fenics_mortar.bulk.cells import Triangles, triangulate
from fenics_mortar.contact.contact import Contact, begin_step
from fenics_mortar.contact.pair import Pretension
from fenics_mortar.contact.tied import Tie
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.newton.loop import Solve, then_solve
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import HALF_FACET, ROUNDING, Array, Flags, Indices

if TYPE_CHECKING:
    from fenics_mortar.equations.general import ContactEquations, State
    from fenics_mortar.interface.curve_surface import Curve


class _Side(NamedTuple):
    """A surface of a contact, and its body."""

    contact: int
    is_slave: bool
    surface: Curve
    body: int


class MovingFrame:
    """Positions of contacts on bodies, and extrapolation of states in the moving frame.

    If contact slides or rolls along a body by a facet or more per step, a node of that body is
    ahead of the contact in one state, in contact in the next and behind it afterwards.
    Extrapolation of nodal displacements then fails. In a frame that moves with the contact,
    displacements change little. Let X_c be the position of a contact on the undeformed body, the
    mean of its nodes weighted by their forces, and s its change in the last step, of length 1. The
    guess for a step of length r is

        u(X) = v + r (v - w),    v = u_n(X - r s),    w = u_(n-1)(X - (1 + r) s),

    which is linear extrapolation for s = 0; multipliers likewise along the slave surface. States
    are interpolated linearly on triangles between the body's nodes. Where X - r s or X - (1 + r) s
    is outside the body, linear extrapolation is used. The ends of a long body are hardly affected
    by contact in its middle. The surface of a round body is affected, and rolling bodies do not
    benefit from the frame.

    Measured on shallow ironing with friction, 80 facets on the block: steps of one facet take 6
    iterations from linear extrapolation or the last state, steps of three facets 11; from this
    guess 3 and 4.

    Args:
        problem: Its equations.
    """

    def __init__(self, problem: ContactEquations) -> None:
        self._problem, self._sides = problem, list[_Side]()
        plane = problem.bulk.space.dim == 2  # in space states are extrapolated linearly
        for number, contact in enumerate(problem.contacts if plane else ()):
            for surface in (contact.slave, contact.master):
                bodies = np.unique(problem.floating.labels_of(surface))
                if isinstance(contact, Contact) and bodies.size == 1:
                    is_slave = surface is contact.slave
                    self._sides.append(_Side(number, is_slave, surface, int(bodies[0])))
        self._bodies: dict[int, tuple[Indices, Triangles]] = {}

    def contact_centres(self) -> Array:
        """Undeformed positions of contacts, (sides, 2), nan if open [length] (collective)."""
        found = []
        for side in self._sides:
            contact = self._problem.contacts[side.contact]
            weight = np.hypot(*contact.now.forces[0 if side.is_slave else 1].T)
            with np.errstate(invalid="ignore"):
                found.append(weight @ side.surface.X / weight.sum())
        return np.array(found).reshape(-1, 2)

    def guess(self, last: State, before: State, moved: Array, ratio: float) -> State | None:
        """Extrapolate two states in the frame of the contacts (collective).

        Args:
            last: The last state.
            before: The state before it.
            moved: Change of ``contact_centres`` between them, shape (sides, 2) [length].
            ratio: Length of the next step over that of the last one.

        Returns:
            The state, with the active sets of the last one; ``None`` if no contact moves by half a
            facet or more.
        """
        motions = self.motions(moved, ratio)
        if not motions:
            return None
        guess = last.towards(before, -ratio)
        interfaces = list(guess.interfaces)
        u = guess.u.copy()
        for body, s in motions.items():
            dofs, mesh = self._body(body)
            v = mesh.interpolate(last.u[dofs], mesh.X - ratio * s)
            w = mesh.interpolate(before.u[dofs], mesh.X - (1.0 + ratio) * s)
            there = np.isfinite(v + w).all(axis=1)
            u[dofs[there]] = (v + ratio * (v - w))[there]
        for i, is_slave, surface, body in self._sides:
            if is_slave and body in motions:
                s = motions[body]
                v = carried_along(surface, last.interfaces[i].z, ratio * s)
                w = carried_along(surface, before.interfaces[i].z, (1.0 + ratio) * s)
                interfaces[i] = interfaces[i].replaced(z=v + ratio * (v - w))
        return guess.replaced(u=u, interfaces=tuple(interfaces))

    def motions(self, moved: Array, ratio: float) -> dict[int, Array]:
        """Motions of contacts by half a facet or more, by body, (2,) each [length] (local).

        Args:
            moved: Change of ``contact_centres`` in a step, shape (sides, 2) [length].
            ratio: Length of the next step over that of this one.
        """
        found = {}
        for body in {side.body for side in self._sides}:
            mine = [k for k, side in enumerate(self._sides) if side.body == body]
            facet = min(float(self._sides[k].surface.facet_sizes.min()) for k in mine)
            s = moved[mine].mean(axis=0)
            size = np.hypot(*s)
            distance = np.hypot(*(moved[mine] - s).T).max()
            if ratio * size > HALF_FACET * facet and distance <= EQUATIONS.same_direction * size:
                found[body] = s
        return found

    def _body(self, number: int) -> tuple[Indices, Triangles]:
        """Local dofs of the nodes of a body, (n, 2), and its local cells (local)."""
        if number not in self._bodies:
            space = self._problem.bulk.space
            mine = np.flatnonzero(self._problem.floating.labels == number)
            self._bodies[number] = space.dofs[mine], triangulate(space, mine)
        return self._bodies[number]


def carried_along(surface: Curve, values: Array, s: Array) -> Array:
    """Nodal values of a surface, carried along it by a motion (local).

    Args:
        surface: The surface.
        values: The values, shape (nodes, 2) [unit].
        s: The motion, shape (2,) [length].

    Returns:
        Shape (nodes, 2); beyond the ends of the surface the value at the end.
    """
    X, own = surface.X, np.arange(surface.num_nodes)
    before, after = (np.where(to >= 0, to, own) for to in (surface.previous, surface.following))
    chord = X[after] - X[before]
    along = chord @ s / np.hypot(*chord.T)
    path = np.cumsum(np.hypot(*np.diff(X, axis=0, prepend=X[:1]).T))
    return np.stack([np.interp(path - along, path, column) for column in values.T], axis=1)


class Point(NamedTuple):
    """An accepted state of the path, its time, and the positions of contacts on bodies."""

    time: float
    state: State
    contact_centres: Array


@dataclass
class _Kind:
    """A kind of guess: residual allowed after its first iteration [1], steps to be paused.

    ``residual``: that of its guess for the last step, zero if it was not used [stress length].
    """

    max_left: float
    residual: float = 0.0
    pause: int = 0
    left: int = 0


class Predictor:
    """Initial guess of a load step: the last state, or an extrapolation of the last states.

    Displacements, multipliers and motions driven by forces are extrapolated: linearly, or, where
    contact moves along a body by half a facet or more per step, in a frame that moves with it, see
    ``MovingFrame``. After extrapolation, most nodes have entered or left the contact before the
    first iteration. On straight parts of a path, linear extrapolation saves about one iteration per
    step; quadratic extrapolation does not save more, since states have kinks where nodes pass
    facets. If contact slides by whole facets with friction, linear extrapolation fails, and the
    moving frame saves two to seven iterations.

    The kind of the last step is used again without a comparison while its residual does not
    increase. The extrapolation is rejected if its residual is larger than at the last state, as
    where the path turns. It is abandoned if the first iteration from linear extrapolation hardly
    reduces the residual, or after too many iterations: consecutive states are then unrelated. In
    this case the step restarts from the last state, and the next one, two, four, ... steps use no
    guess of that kind.

    Args:
        problem: Its equations.
        time: Time of its present state.
    """

    def __init__(self, problem: ContactEquations, time: float) -> None:
        self._problem = problem
        self._frame = MovingFrame(problem)
        self._line, self._moving = _Kind(EQUATIONS.max_residual_left), _Kind(np.inf)
        self.begin(time)
        self._used: _Kind | None = None
        self._evaluated: State | None = None

    def begin(self, time: float) -> None:
        """Set the present state as the first one of a path, at a time (collective)."""
        self._path = deque([self._point(time)], maxlen=2)
        self._line.residual = self._moving.residual = 0.0

    @property
    def time(self) -> float:
        """Time of the last accepted state [time]."""
        return self._path[-1].time

    @property
    def last(self) -> State:
        """The last accepted state."""
        return self._path[-1].state

    def _point(self, time: float) -> Point:
        return Point(time, self._problem.state(), self._frame.contact_centres())

    @contextmanager
    def attempt(self, time: float, solve: Solve, *, guesses: bool = True) -> Iterator[Solve]:
        """Context of a solve for a time, from a guess or from the last state (collective).

        The context solves from a guess, if there is one, and accepts the state at its end.

        Args:
            time: Time of the present loads and prescribed values.
            solve: Function that solves from the present state.
            guesses: Whether a guess is used.

        Yields:
            Function to be called once: it returns the record, including iterations from an
            abandoned guess, after which it solves from the last state.
        """
        here = self._problem.state()
        kind = self._go_to_guess(time, here) if guesses else None
        for other in (self._line, self._moving):
            if other is not kind:
                other.left, other.residual = max(other.left - 1, 0), 0.0
        self._used = kind or self._used
        try:
            yield solve if kind is None else self._solve_from_guess(kind, here, solve)
        finally:
            self._problem.evaluated = None
        if not guesses:
            self._path = deque([self._path[-1]], self._path.maxlen)
        self._path.append(self._point(time))

    def _go_to_guess(self, time: float, here: State) -> _Kind | None:
        """Set the guess with the smallest residual, if smaller than at the present state.

        The kind of the last step is the only one if its residual has not increased. In the guess
        floating bodies have to be supported by contact, and pairs under pressure have to remain
        under pressure; otherwise the solve would move bodies and obstacles rigidly before the first
        iteration. The present state is evaluated only if its distance from the prescribed values
        does not exclude it.
        """
        problem = self._problem
        if len(self._path) < 2 or not problem.floating.supported_by_contact:
            return None
        begin_step(problem.contacts)
        problem.bulk.history.start_step()
        presses, smallest = self._under_pressure(), problem.residual.of_prescribed()
        best: tuple[float, _Kind | None, State] = np.inf, None, here
        self._evaluated = None
        for kind in sorted((self._line, self._moving), key=lambda kind: kind is not self._used):
            guess = self._guess(kind, time - self.time)
            if guess is None:
                continue
            places = np.where(problem.motions.found, guess.places, here.places)
            guess = guess.replaced(places=places).with_settings_of(here)
            guessed = self._residual_at(guess)
            if guessed < best[0] and not (presses & ~self._under_pressure()).any():
                best = guessed, kind, guess
                if guessed <= kind.residual:
                    break
        if self._evaluated is None:
            return None
        if best[0] >= smallest and best[0] >= self._residual_at(here):
            best = np.inf, None, here
        if best[1] is not None:
            best[1].residual = best[0]
        if self._evaluated is not best[2]:
            problem.restore(best[2])
        elif problem.floating.bodies or problem.motions.driven.any():
            problem.put(best[2])  # its own sets, on which rigid moves before the solve depend
        elif self._status is not None:
            problem.evaluated = best[2], self._status
        return best[1]

    def _guess(self, kind: _Kind, step: float) -> State | None:
        """Guess of a kind for a step of this length; ``None`` if paused or without one."""
        if kind.left:
            return None
        before, last = self._path[-2], self._path[-1]
        ratio = step / (last.time - before.time)
        if kind is self._line:
            return last.state.towards(before.state, -ratio)
        moved = last.contact_centres - before.contact_centres
        return self._frame.guess(last.state, before.state, moved, ratio)

    def _residual_at(self, state: State) -> float:
        """Set and evaluate a state; its residual, inf for inverted cells [stress length]."""
        problem, self._evaluated, self._status = self._problem, state, None
        problem.put(state)
        problem.start_step()
        if problem.bulk.inverted_cells()[0]:
            problem.evaluate_operators()
            return np.inf
        self._status = status = problem.evaluate(start=True)
        return status.residual if np.isfinite(status.residual) else np.inf

    def _under_pressure(self) -> Flags:
        """Marks of pairs under pressure, shape (contacts,), bool (local)."""
        return np.array([(c.pressure > 0.0).any() for c in self._problem.floating.contacts], bool)

    def _solve_from_guess(self, kind: _Kind, here: State, solve: Solve) -> Solve:
        """Solve; if convergence is poor, return to ``here``. The rest of it, see ``attempt``."""
        options = self._problem.newton
        few = min(EQUATIONS.max_guess_iterations, options.max_iterations)
        cautious = replace(options, tentative=True, max_remaining=kind.max_left, max_iterations=few)
        try:
            self._problem.newton = cautious
            report = solve()
        except errors.NotConvergedError as error:
            error.report.notes.append(f"extrapolated initial guess abandoned: {error}")
            abandoned = error.report
        else:
            kind.pause = 0
            return lambda: report
        finally:
            self._problem.newton = options
        kind.left = kind.pause = max(2 * kind.pause, 1)
        self._problem.restore(here)
        return partial(then_solve, abandoned, solve)


# Attributes of an interface's state that a user may have changed since the last solve.
COMPARED = (
    "z", "active", "branch", "multiplier_nodes", "partners", "accepted_partners",
    "accepted_instant",
)  # fmt: skip


# Values of all loads, distributed ones on this rank; laws as text.
Loads = tuple[list[Array], list[str]]


def loads_of(e: ContactEquations) -> Loads:
    """The present loads, in a fixed order (local)."""
    motions = e.motions
    of_movers = np.where(motions.found, motions.push(), motions.places)
    values = [*e.bulk.input_data.loads(), *of_movers]
    values += [load.motion.load.copy() for load in motions.spread]
    values += [np.array(contact.offset, float).ravel() for contact in e.contacts]
    ties = [contact.pair for contact in e.contacts if isinstance(contact, Tie)]
    values += [pair.present_jump() for pair in ties if not isinstance(pair, Pretension)]
    return values, [errors.as_text(contact.pair.law) for contact in e.floating.contacts]


class Continuation:
    """Successive solves as a load path: if loads continue, the last two states are extrapolated.

    A user's loop that changes loads and solves is a load path without time. The length of the next
    step follows from the loads: each prescribed value, constant and function of the forms, obstacle
    and offset has to change along its last change, all by the same ratio. The guess is the last
    state if

    - nothing changed, or loads change direction, reverse, start or stop;
    - a step is more than twice as long as the last one;
    - a law was changed;
    - the present state is not the result of the last solve;
    - the bodies have inertia.

    Otherwise the guess is extrapolated, if its residual is smaller than that of the last state.

    Args:
        equations: The equations of the problem.
    """

    def __init__(self, equations: ContactEquations) -> None:
        self._equations, self._predictor = equations, Predictor(equations, 0.0)
        self._past: list[Loads] = []
        self._step = 1.0

    @contextmanager
    def attempt(self, solve: Solve, *, guess: bool) -> Iterator[Solve]:
        """Context of a solve, from a guess if loads continue, else from the present state.

        The state at its end is accepted. Collective.

        Args:
            solve: Function that solves from the present state.
            guess: Whether to guess; never for bodies in motion, which have forces beyond the forms.

        Yields:
            Function that returns the record, see ``Predictor.attempt``.
        """
        guess &= self._equations.bulk.inertia is None
        if not (self._past and guess and self._is_last_state()):
            self._past = []
        if not guess:
            yield solve
            return
        loads = loads_of(self._equations)
        ratio = self._ratio(loads) if len(self._past) == 2 else 0.0
        step = self._step * ratio if ratio else 1.0
        if not self._past:
            yield solve
            self._predictor.begin(0.0)
        else:
            time = self._predictor.time + step
            with self._predictor.attempt(time, solve, guesses=ratio > 0.0) as finish:
                yield finish
        self._past, self._step = [*self._past[-1:], loads], step

    def _is_last_state(self) -> bool:
        """Whether the present state is the result of the last solve (collective)."""
        equations, last = self._equations, self._predictor.last
        history = equations.bulk.history.values
        same = np.array_equal(equations.bulk.u.x.array, last.u) and all(
            getattr(contact.state, name) is getattr(interface, name)
            for contact, interface in zip(equations.contacts, last.interfaces, strict=True)
            for name in COMPARED
        )
        found = equations.motions.found
        same &= np.array_equal(history.accepted, last.history.accepted)
        same &= np.array_equal(equations.motions.places[found], last.places[found])
        return ranks.on_all_ranks(equations.comm, same)

    def _ratio(self, loads: Loads) -> float:
        """Length of the next load step over that of the last [1]; 0.0 if loads do not continue.

        Collective.
        """
        values, (before, last, laws) = zip(*self._past, loads, strict=True)
        parts = []
        for a, b, c in zip(*values, strict=True):
            done, next_ = b - a, c - b
            parts.append((done @ done, done @ next_, next_ @ next_, a @ a + b @ b + c @ c))
        sums = ranks.sum_over_ranks(self._equations.comm, np.reshape(parts, (-1, 4)))
        sums[:, :3] *= sums[:, :3].max(axis=1, keepdims=True) > ROUNDING**2 * sums[:, 3:]
        done2, product, next2, _ = sums.T
        if before != laws or last != laws or not done2.any():
            return 0.0
        first = np.flatnonzero(done2)[0]
        ratio = float(product[first] / done2[first])
        aside2 = next2 - 2.0 * ratio * product + ratio**2 * done2
        continues = 0.0 < ratio <= EQUATIONS.longest * (1.0 + ROUNDING)
        return ratio if continues and (aside2 <= EQUATIONS.same_direction**2 * next2).all() else 0.0
