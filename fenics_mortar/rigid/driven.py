# SPDX-License-Identifier: MIT
"""Rigid obstacles that forces drive: their motions q are unknowns of the Newton system.

To the equations of displacement and multipliers, whatever their form, come the columns C_q of the
contact law, and for each driven motion the row of its balance,

    E_d dd + M_q z + E_q dq = push,    M_q z = f_q,

with E the derivatives of f_q at fixed z; D does not move with q, so that bulk rows have no columns.
The few motions are eliminated from this bordered system: with the answers (dd_i, z_i) of the other
equations to the columns, what is left is a small dense system. So the sparse matrix, its pattern
and what solves it are those of obstacles at rest.

A motion that active contact leaves loose gets a spring in the tangent as a floating body does, see
``floating``; a driven obstacle that touches nothing is moved before the solve until contact stops
it, and one on nodes that stick follows what is prescribed, as a wheel that is turned. Where an
obstacle rolls, and Newton fails, springs hold it as they do bodies, see ``release``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.contact import Contact
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.rigid.floating import (
    HELD,
    LARGEST_MOVE,
    LEAST_SPRING,
    LOADED,
    MOST_MOVES,
    TOUCH,
    closest_below,
)
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError, place

# A loose motion is driven by more than this part of the forces.
DRIVEN = 1e-12
# What the facets of the slave may err of the forces on an obstacle, whose normals are exact.
FACETS_ERR = 0.005
# Motions that sticking nodes feel less than this part of others do not follow what is prescribed.
FOLLOWED = 0.5
# A move before the solve that gives the push less way than this part of a facet is not worth it.
LEAST_WAY = 1e-3


class DrivenObstacles:
    """The obstacles of a problem, and the motions of them that forces drive.

    All is equal on all ranks. Motions are x, y and turn, the angle times the ``arm`` of the pair.

    Args:
        contacts: The contacts of the problem, and its ties.

    Attributes:
        obstacles: Those of the contacts, each once.
    """

    def __init__(self, contacts: Sequence[Any]) -> None:
        self._contacts = contacts
        found = [c.obstacle for c in contacts if c.obstacle is not None]
        self.obstacles: list[Obstacle] = list(dict.fromkeys(found))
        for obstacle in self.obstacles:
            pairs = [contact for contact in contacts if contact.obstacle is obstacle]
            for contact in pairs:
                contact.arm = max(c.arm for c in pairs)
        self._scales: Array = np.ones((len(self.obstacles), 3))
        for number, contact in self._pairs():
            self._scales[number, 2] = contact.arm
        self._springs: Array | None = None
        self._anchor: Array = np.zeros(self._scales.shape)
        self._start: Array = np.zeros(self._scales.shape)

    @property
    def places(self) -> Array:
        """Places (x, y, angle) of all obstacles, shape (obstacles, 3)."""
        return self._of_all("place")

    @places.setter
    def places(self, places: Array) -> None:
        for obstacle, where in zip(self.obstacles, places, strict=True):
            obstacle.place = where.copy()

    def motions_of(self, places: Array) -> Array:
        """Motions x, y, turn of (x, y, angle), shape (obstacles, 3) [length]."""
        return places * self._scales

    def largest(self) -> float:
        """Largest motion from where they were made [length]."""
        return float(np.abs(self.motions_of(self.places)).max(initial=0.0))

    @property
    def driven(self) -> npt.NDArray[np.bool_]:
        """Which motions forces drive, shape (obstacles, 3)."""
        return np.isfinite(self._of_all("load"))

    def forces(self, part: str = "z") -> Array:
        """f_q of the last evaluated state, shape (obstacles, 3) [stress length] (collective).

        ``part``: of the contacts' "z", or their "shear" only.
        """
        total = np.zeros(self._scales.shape)
        for number, contact in self._pairs():
            total[number] += contact.on_obstacle.motion_force(getattr(contact, part))
        return total

    def residual(self) -> Array:
        """f_q and springs less the push of driven motions, else 0, (obstacles, 3) (collective)."""
        return np.where(self.driven, self.forces() + self._spring_forces() - self._push(), 0.0)

    def record(self) -> list[str]:
        """Note the force and moment of contact on each obstacle; say it in words (collective)."""
        lines = []
        for obstacle, force in zip(self.obstacles, -self.forces() * self._scales, strict=True):
            obstacle.reaction = force
            lines.append(
                f"obstacle '{obstacle.name}', moved by {place(obstacle.place)} and turned by "
                f"{obstacle.place[2]:.4g}: contact force {place(force)}, moment {force[2]:.4g}"
            )
        return lines

    def move(self, change: Array) -> None:
        """Add motions, shape (obstacles, 3) [length]."""
        self.places = self.places + change / self._scales

    # The bordered system

    def solve(
        self, system: LinearSystem, stiffness: float, force: float
    ) -> tuple[PETSc.Vec, list[Array], Array]:
        """Solve for displacement, multipliers and motions (collective).

        Args:
            system: That of displacement and multipliers, assembled.
            stiffness: Of the bulk [stress].
            force: Size of the forces [stress length].

        Returns:
            Increment of the displacement, multipliers, and motions (obstacles, 3) [length].
        """
        dd, multipliers = system.solve()
        motion, driven = np.zeros(self._scales.shape), self.driven
        if not driven.any():
            return dd, multipliers, motion
        answers = [system.respond(self._columns(*which)) for which in np.argwhere(driven)]
        units = np.eye(motion.size)[driven.ravel()].reshape(-1, *motion.shape)
        springs = self._stiffness_of_springs(stiffness, force)
        parts = self.partial_derivatives()
        columns = [
            self.derivative(parts, change.array_r, dz, unit)
            + (springs @ unit.ravel()).reshape(-1, 3)
            for (change, dz), unit in zip(answers, units, strict=True)
        ]
        matrix = np.array([column[driven] for column in columns]).T
        at_rest = self.derivative(parts, dd.array_r, multipliers, 0.0 * motion)
        rhs = (self._push() - self._spring_forces() - at_rest)[driven]
        try:
            motion[driven] = np.linalg.solve(matrix, rhs)
        except np.linalg.LinAlgError as error:
            raise MortarError(f"the balance of the obstacles is singular: {error}") from error
        system.comm.Bcast(motion)
        for step, (change, z_change) in zip(motion[driven], answers, strict=True):
            dd.axpy(step, change)
            change.destroy()
            multipliers = [z + step * dz for z, dz in zip(multipliers, z_change, strict=True)]
        return dd, multipliers, motion

    def _columns(self, number: int, component: int) -> list[Array]:
        """-C_q of one motion for every contact."""
        mine = self.obstacles[number]
        return [
            -c.motion_rows()[:, :, component] if c.obstacle is mine else np.zeros_like(c.z)
            for c in self._contacts
        ]

    def partial_derivatives(self) -> list[tuple[Array, Array, Array]]:
        """E_d (3, slave nodes, 2), M_q (the same) and E_q (3, 3) of each pair (collective)."""
        return [
            contact.on_obstacle.motion_force_derivatives(contact.z) for _, contact in self._pairs()
        ]

    def derivative(
        self, parts: list[tuple[Array, Array, Array]], du: Array, dz: Sequence[Array], dq: Array
    ) -> Array:
        """E_d du + M_q dz + E_q dq, the change of f_q, shape (obstacles, 3) (collective).

        Args:
            parts: E_d, M_q and E_q of each pair.
            du: Displacement, the part of this rank.
            dz: Multipliers of every contact, shape (slave nodes, 2), of those that act.
            dq: Motions, shape (obstacles, 3).
        """
        total = np.zeros(self._scales.shape)
        multipliers = [z for z, c in zip(dz, self._contacts, strict=True) if c.obstacle is not None]
        for (number, contact), z, (E_d, M_q, E_q) in zip(
            self._pairs(), multipliers, parts, strict=True
        ):
            total[number] += np.einsum("mkc,kc->m", E_d, contact.slave.gather(du))
            total[number] += np.einsum("mjc,jc->m", M_q[:, contact.acts], z[contact.acts])
            total[number] += E_q @ dq[number]
        return total

    def _stiffness_of_springs(self, stiffness: float, force: float) -> Array:
        """Those of ``hold``, or on loose motions in proportion to what drives them; as E_q."""
        if self._springs is not None:
            return np.diag(self._springs.ravel())
        total = np.zeros((self._scales.size, self._scales.size))
        residual = self.residual()
        for number, loose in enumerate(self._loose()):
            own = slice(3 * number, 3 * number + 3)
            drive = float(np.linalg.norm(loose @ residual[number])) / max(force, 1e-300)
            total[own, own] = stiffness * np.clip(drive, LEAST_SPRING, 1.0) * (loose.T @ loose)
        return total

    def _loose(self) -> list[Array]:
        """Motions of each obstacle, (n, 3), that forces drive and active contact does not hold."""
        found = []
        for number, driven in enumerate(self.driven):
            motions = np.eye(3)[driven]
            closing = [c.gap_by_motions()[c.active] for c in self._contacts_of(number)]
            answers = np.concatenate([*closing, np.zeros((3, 3))]) @ motions.T
            _, norms, combinations = np.linalg.svd(answers, full_matrices=False)
            found.append(combinations[norms <= HELD] @ motions)
        return found

    def describe(self, force: float) -> str:
        """Loose motions that forces drive, in words; "" if there are none (collective)."""
        residual, found = self.residual(), []
        for number, (obstacle, loose) in enumerate(zip(self.obstacles, self._loose(), strict=True)):
            drive = loose @ residual[number]
            if np.linalg.norm(drive) > DRIVEN * force:
                found.append(f"obstacle '{obstacle.name}' can {_in_words(drive @ loose)}")
        return ", ".join(found)

    # Springs of their own, see ``release``

    def hold(self, travel: float, stiffness: float) -> None:
        """Tie driven motions to where they are (collective).

        Args:
            travel: How far the forces that drive an obstacle, or what facets may err of all on it,
                would strain its springs, in shortest facets.
            stiffness: Of the bulk [stress].
        """
        drive = np.linalg.norm(self.residual(), axis=1)
        drive = np.maximum(drive, FACETS_ERR * self._contact_forces())
        springs = np.maximum(drive / (travel * self._shortest_facet()), LEAST_SPRING * stiffness)
        self._springs = np.where(self.driven, springs[:, None], 0.0)
        self._anchor = self.motions_of(self.places)

    def let_go(self) -> None:
        """Take the springs of ``hold`` away."""
        self._springs = None

    @property
    def springs(self) -> tuple[Array | None, Array]:
        """Stiffness of the springs of ``hold``, if there are any, and where they are anchored."""
        return self._springs, self._anchor

    @springs.setter
    def springs(self, springs: tuple[Array | None, Array]) -> None:
        self._springs, self._anchor = springs

    def travel(self) -> float:
        """How far an obstacle has moved since ``hold``, in shortest facets."""
        moves = np.linalg.norm(np.where(self.driven, self._strain(), 0.0), axis=1)
        return float(moves.max(initial=0.0)) / self._shortest_facet()

    def parts_held(self) -> list[tuple[str, float]]:
        """Name and force of springs over the contact force on it, of driven obstacles."""
        if self._springs is None:
            return []
        forces = np.linalg.norm(self._spring_forces(), axis=1)
        parts = forces / np.maximum(self._contact_forces(), 1e-300)
        return [
            (f"obstacle '{self.obstacles[i].name}'", float(parts[i]))
            for i in np.flatnonzero(self.driven.any(axis=1))
        ]

    def spring_energy(self) -> float:
        """Energy in the springs of ``hold`` [stress length^2]."""
        return 0.5 * float((self._spring_forces() * self._strain()).sum())

    def _spring_forces(self) -> Array:
        return (
            np.zeros(self._scales.shape)
            if self._springs is None
            else self._springs * self._strain()
        )

    def _strain(self) -> Array:
        """Motions since ``hold``, shape (obstacles, 3) [length]."""
        return self.motions_of(self.places) - self._anchor

    def _contact_forces(self) -> Array:
        """Integral of the size of the pressure on each obstacle, (obstacles,) [stress length]."""
        total = np.zeros(len(self.obstacles))
        for number, contact in self._pairs():
            total[number] += contact.operators.cover @ np.abs(contact.pressure)
        return total

    def _shortest_facet(self) -> float:
        return min((float(c.slave.lengths.min()) for _, c in self._pairs()), default=1.0)

    def strayed(self) -> float:
        """How far an obstacle slid of its own accord in the last solve, in widths of its contact.

        Zero where nodes stick or have no friction: it counts what driven motions, found by the
        solve, make all nodes slide at the least.
        """
        found = np.where(self.driven, self.motions_of(self.places) - self._start, 0.0)
        widths = [0.0]
        for number, motion in enumerate(found):
            mine = self._contacts_of(number)
            slides = np.concatenate([c.sliding[c.active] for c in mine])
            if slides.size and slides.all():
                slips = [_slip_by_motions(c, c.active) @ motion for c in mine]
                width = sum(float(c.nodal_lengths[c.active].sum()) for c in mine)
                widths.append(float(np.abs(np.concatenate(slips)).min()) / width)
        return max(widths)

    # Before a solve

    def follow(self, evaluate: Callable[[], object]) -> None:
        """Move driven obstacles along with what is prescribed, so that nodes stick (collective).

        From where they were all nodes would slide, and nothing would say how far.

        Args:
            evaluate: Evaluates the operators at the present state, not the sets.
        """
        if not self.driven.any():
            return
        evaluate()
        moves = np.zeros(self._scales.shape)
        for number, driven in enumerate(self.driven):
            mine = self._contacts_of(number)
            slip = np.concatenate([c.slip[c.sticking] for c in mine])
            rows = np.concatenate([_slip_by_motions(c, c.sticking) for c in mine])[:, driven]
            moves[number, driven] = np.linalg.lstsq(rows, -slip, rcond=FOLLOWED)[0]
        self.move(moves)

    def settle(self, evaluate: Callable[[], object]) -> list[str]:
        """Move driven obstacles that carry no contact force until contact stops them (collective).

        Args:
            evaluate: Evaluates the contacts at the present state.

        Returns:
            Which were moved, in words.

        Raises:
            MortarError: On all ranks, if nothing stops an obstacle.
        """
        moved = dict[str, None]()
        if not self.driven.any():
            return []
        for _ in range(MOST_MOVES):
            evaluate()
            moves = np.array([self._next_move(i) for i in range(len(self.obstacles))])
            moving = np.flatnonzero(moves.any(axis=1))
            if not moving.size:
                self._start = self.motions_of(self.places)
                return [f"{name} was moved until contact stopped it" for name in moved]
            moved |= dict.fromkeys(f"obstacle '{self.obstacles[i].name}'" for i in moving)
            self.move(moves)
        stray = moving[0]
        raise MortarError(
            f"obstacle '{self.obstacles[stray].name}' can {_in_words(moves[stray])} freely: its "
            "push drives it, and no contact stops it; prescribe that motion by move()"
        )

    def _next_move(self, number: int) -> Array:
        """Motion of one obstacle towards contact, shape (3,); zero if it is there, or not driven.

        It is the one closest to the push that no node overlaps by more than touching, and that the
        push does work in: its potential is linear in the motions, so no move is ever taken back.
        """
        contacts = self._contacts_of(number)
        driven, push = self.driven[number], self._push()[number]
        loaded = any((c.pressure > LOADED * c.stiffness).any() for c in contacts)
        if loaded or not push.any():
            return np.zeros(3)
        motions = np.eye(3)[driven]
        along = (motions @ push) / np.linalg.norm(push)
        closing = np.concatenate([-contact.gap_by_motions() for contact in contacts])
        room = [np.nan_to_num(c.gap) + TOUCH * c.nodal_lengths for c in contacts]
        rows = np.vstack([closing @ motions.T, -along])
        room.append(np.zeros(1))
        wanted = LARGEST_MOVE * contacts[0].arm * along
        move = closest_below(wanted, rows, np.maximum(np.concatenate(room), 0.0))
        return move @ motions if move @ along > LEAST_WAY * self._shortest_facet() else np.zeros(3)

    def _pairs(self) -> Iterator[tuple[int, Contact]]:
        """The contacts that have an obstacle, with its number."""
        for contact in self._contacts:
            if contact.obstacle is not None:
                yield self.obstacles.index(contact.obstacle), contact

    def _contacts_of(self, number: int) -> list[Contact]:
        """The contacts of one obstacle."""
        return [contact for i, contact in self._pairs() if i == number]

    def _push(self) -> Array:
        """Loads along the motions, 0 where these are prescribed, (obstacles, 3) [stress length]."""
        return np.nan_to_num(self._of_all("load")) / self._scales

    def _of_all(self, name: str) -> Array:
        return np.array([getattr(o, name) for o in self.obstacles]).reshape(-1, 3)


def _slip_by_motions(contact: Contact, nodes: npt.NDArray[np.bool_]) -> Array:
    """Derivative of the slip of some nodes by the motions of their obstacle, (n, 3)."""
    return contact.partners.derivative_by_motions(contact.on_obstacle)[nodes]


def _in_words(motion: Array) -> str:
    """A motion x, y, turn in words."""
    x, y, turn = motion / np.abs(motion).max()
    if abs(turn) < 0.1:
        return f"move along {place((x + 0.0, y + 0.0))}"
    return "turn" if max(abs(x), abs(y)) < 0.1 else f"move along {place((x, y))} and turn"
