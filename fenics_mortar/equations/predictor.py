# SPDX-License-Identifier: MIT
"""Initial guess of a load step: the last state, or an extrapolation of the last states.

Displacements, multipliers and motions driven by forces are extrapolated: linearly, or, where
contact moves along a body by half a facet or more per step, in a frame that moves with it, see
``moving_frame``. After extrapolation, most nodes have entered or left the contact before the first
iteration. On straight parts of a path, linear extrapolation saves about one iteration per step;
quadratic extrapolation does not save more, since states have kinks where nodes pass facets. If
contact slides by whole facets with friction, linear extrapolation fails, and the moving frame saves
two to seven iterations.

The kind of the last step is used again without a comparison while its residual does not increase.
The extrapolation is rejected if its residual is larger than at the last state, as where the path
turns. It is abandoned if the first iteration from linear extrapolation hardly reduces the residual,
or after too many iterations: consecutive states are then unrelated. In this case the step restarts
from the last state, and the next one, two, four, ... steps use no guess of that kind.

Initial guess of bodies whose prescribed values turn: the whole body turns with them.

Newton's method starts from the last state, where only prescribed nodes are elsewhere. If these turn
by more than some degrees, as the hub of an arm, the cells beside them are distorted so much that
the iteration may fail. A body that follows rigidly has the stresses and the contact pressures that
it had before, turned.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact, begin_step
from fenics_mortar.equations.arguments import EQUATIONS
from fenics_mortar.equations.general import ContactEquations, State
from fenics_mortar.equations.moving_frame import MovingFrame
from fenics_mortar.newton.loop import NewtonReport, then_solve
from fenics_mortar.obstacles.rigid_motion import polar_rotation
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import NotConvergedError
from fenics_mortar.utils.ranks import sum_over_ranks
from fenics_mortar.verify.node_paths import SLENDER, STRETCHED


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

    def failed(self) -> None:
        """Pause for twice as many steps as the last time."""
        self.left = self.pause = max(2 * self.pause, 1)


class Predictor:
    """Extrapolation of the accepted states of a problem.

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

    def solve(
        self, time: float, solve: Callable[[], NewtonReport], *, guesses: bool = True
    ) -> NewtonReport:
        """Solve for a time from a guess or from the last state; accept the result (collective).

        Args:
            time: Time of the present loads and prescribed values.
            solve: Function that solves from the present state.
            guesses: Whether a guess is used.

        Returns:
            The record, including iterations from an abandoned guess.

        Raises:
            NotConvergedError: On all ranks, if the solve from the last state fails, too.
        """
        here = self._problem.state()
        kind = self._go_to_guess(time, here) if guesses else None
        for other in (self._line, self._moving):
            if other is not kind:
                other.left, other.residual = max(other.left - 1, 0), 0.0
        self._used = kind or self._used
        try:
            report = solve() if kind is None else self._solve_from_guess(kind, here, solve)
        finally:
            self._problem.evaluated = None
        if not guesses:
            self._path = deque([self._path[-1]], self._path.maxlen)
        self._path.append(self._point(time))
        return report

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
        elif problem.floating.bodies or problem.motions.any_driven:
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

    def _under_pressure(self) -> npt.NDArray[np.bool_]:
        """Marks of pairs under pressure, shape (contacts,), bool (local)."""
        contacts = [c for c in self._problem.contacts if isinstance(c, Contact)]
        return np.array([(c.pressure > 0.0).any() for c in contacts], bool)

    def _solve_from_guess(
        self, kind: _Kind, here: State, solve: Callable[[], NewtonReport]
    ) -> NewtonReport:
        """Solve; if convergence is poor, restart from ``here``."""
        options = self._problem.newton
        few = min(EQUATIONS.max_guess_iterations, options.max_iterations)
        cautious = replace(options, tentative=True, max_remaining=kind.max_left, max_iterations=few)
        try:
            self._problem.newton = cautious
            report = solve()
            kind.pause = 0
            return report
        except NotConvergedError as error:
            lost = error.report
            lost.notes.append(f"extrapolated initial guess abandoned: {error}")
        finally:
            self._problem.newton = options
        kind.failed()
        self._problem.restore(here)
        return then_solve(lost, solve)


# Rotation of prescribed nodes [radian], 6 degrees, below which bodies do not follow them: Newton's
# method needs few iterations then.
TURNED = 0.1

# Rigid motion: a point, its position after the motion [length], and the rotation (d, d) [1].
Motion = tuple[Array, Array, Array]


def turns_of_prescribed(e: ContactEquations) -> dict[int, Motion]:
    """Rigid motions of prescribed nodes to their values, of the bodies that turn (collective)."""
    bulk, dofs = e.bulk, e.bulk.space.owned_dofs
    values = bulk.values.copy()
    compat.set_prescribed(values, bulk.bcs)
    led = bulk.prescribed[dofs].all(axis=1)
    x, change = bulk.positions()[: len(dofs)], (values - bulk.values)[dofs]
    of_bodies = e.floating.labels[: len(dofs)][led], e.floating.num_bodies
    sums = sum_over_ranks(e.comm, _sums(x[led], (x + change)[led], *of_bodies))
    motions = map(_motion, sums)
    return {body: motion for body, motion in enumerate(motions) if motion is not None}


def turn(e: ContactEquations, motions: dict[int, Motion]) -> None:
    """Move bodies along with their prescribed nodes (local).

    Multipliers of slave nodes turn with their bodies; slip is counted from the accepted state.

    Args:
        e: The equations at the start of the motions; displacements and multipliers are changed.
        motions: Rigid motions by body.
    """
    bulk, dofs, x = e.bulk, e.bulk.space.dofs, e.bulk.positions()
    values = bulk.values.copy()
    compat.set_prescribed(values, bulk.bcs)
    for body, (start, end, R) in motions.items():
        mine = e.floating.labels == body
        at, moved = dofs[mine], end + (x[mine] - start) @ R.T - x[mine]
        bulk.values[at] = np.where(bulk.prescribed[at], values[at], bulk.values[at] + moved)
    for contact in e.contacts:
        z, bodies = contact.z.copy(), e.floating.labels_of(contact.slave)
        for body, (_, _, R) in motions.items():
            z[bodies == body] = z[bodies == body] @ R.T
        contact.change(z=z)


def _sums(x0: Array, x1: Array, bodies: Indices, count: int) -> Array:
    """Sums over nodes (n,) of each body: 1, x0, x1, x1 x0, x0^2 + x1^2, shape (count, k)."""
    n, d = x0.shape
    products = np.einsum("na,nb->nab", x1, x0).reshape(n, d * d)
    squares = (x0**2 + x1**2).sum(axis=1)[:, None]
    rows = np.hstack([np.ones((n, 1)), x0, x1, products, squares])
    found = np.zeros((count, rows.shape[1]))
    np.add.at(found, bodies, rows)
    return found


def _motion(sums: Array) -> Motion | None:
    """Rigid motion of a body that turns, from its row of ``_sums``; else ``None`` (local)."""
    d = {10: 2, 17: 3}[sums.size]
    if not sums[0]:
        return None
    start, end, products = np.split(sums[1:-1] / sums[0], [d, 2 * d])
    A = products.reshape(d, d) - np.outer(end, start)
    sizes = np.linalg.svd(A, compute_uv=False)
    if sizes[d - 2] <= SLENDER * np.sqrt(sums[-1] / sums[0]) * np.sqrt(sizes[0]):
        return None  # one point; in space points on a line
    R = polar_rotation(A)
    chord = float(np.linalg.norm(R - np.eye(d))) / np.sqrt(2.0)  # 2 sin(a / 2)
    moved = chord**2 * float(sizes.sum())
    apart = float(sums[-1] / sums[0] - start @ start - end @ end - 2.0 * (R * A).sum())
    return (start, end, R) if chord > TURNED and apart <= STRETCHED**2 * moved else None
