# SPDX-License-Identifier: MIT
"""Bodies without sufficient Dirichlet conditions, supported by contact alone.

Before a solve, bodies that contact cannot support are moved until contact stops them, see
``body_settling``. In Newton's method, tangent springs regularize loose motions, which active
contact does not resist, see ``proximal``. If Newton's method fails, springs anchor the bodies, see
``proximal``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.law import STICK, Friction
from fenics_mortar.contact.tied import Tie
from fenics_mortar.rigid.body_motions import BodyMotions, HeldBodies, loose_bodies
from fenics_mortar.rigid.body_settling import BodySettling, Moves
from fenics_mortar.rigid.proximal import (
    RIGID,
    Springs,
    anchored_stiffness,
    over_contact,
    slides,
    tangent_stiffness,
)
from fenics_mortar.utils.arrays import SOLVED, Array


class FloatingBodies(BodyMotions):
    """Floating bodies of a problem and their springs; all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts and ties, bound to the same space.
        held: Their rigid boundaries.

    Attributes:
        springs: Anchored springs at the owned dofs, or ``None``.
        settling: Rigid moves before a solve.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], held: HeldBodies | None = None
    ) -> None:
        super().__init__(bulk, contacts, held)
        self.springs: Springs | None = None
        self.settling = BodySettling(self)

    @property
    def supported_by_contact(self) -> bool:
        """Whether active contact loads and supports all floating bodies."""
        return all(map(self.is_loaded, self.bodies)) and not self.loose()

    def loose(self) -> list[FloatingBody]:
        """Bodies with the rigid motions that neither active nor sticking nodes resist."""
        return loose_bodies(self)

    # Before and after a solve

    def settle(
        self, evaluate: Callable[[], tuple[Array, Array]], give_way: Callable[[Moves], Moves] = list
    ) -> list[str]:
        """Move the bodies that contact cannot support until it can; see ``body_settling``."""
        self.settling.begin()
        if not self.bodies:
            return []
        min_drive = RIGID.negligible if self.anchored else SOLVED
        return self.settling.settle(evaluate, give_way, min_drive)

    def start_with_stick(self) -> None:
        """Let nodes stick at the start of a solve that touch without multipliers (local).

        By their law they slide, as their friction limit is zero before pressures are known. Bodies
        that friction supports would be loose in the first iteration, and their slip would be large.
        In the plane the sets of the linearized problem follow; in space there are none.
        """
        for contact in self.contacts:
            sticks = contact.active & ~contact.z.any(axis=1) & contact.follows_law
            if isinstance(contact.pair.law, Friction) and sticks.any():
                contact.change(branch=np.where(sticks, STICK, contact.branch))

    # Springs in the tangent

    def add_springs(self, loose: Sequence[FloatingBody], total: Array, force: float) -> None:
        """Add springs to the diagonal of ``K`` that limit a step to elastic strains.

        Bodies that are not loose have weak springs: nodes may resist each motion but not all
        motions together, for example if polygons turn inside one another.

        Args:
            loose: The result of ``loose``.
            total: Sum of all forces, shape (owned dofs,) [stress length].
            force: Size of all forces [stress length].
        """
        if not self.bodies:
            return
        stiffness = {body.label: RIGID.weakest_spring * body.stiffest for body in self.bodies}
        for body in loose:
            drive = self.resultant(body, total)
            if np.linalg.norm(drive) > self.rounding(body, force):
                stiffness[body.label] = tangent_stiffness(drive, force) * body.stiffest
        springs = self._spread(stiffness) if self.springs is None else self.springs.stiffness
        self.bulk.add_to_diagonal(springs)

    def drop_undriven(
        self,
        loose: Sequence[FloatingBody],
        step: Array,
        motion: Array,
        total: Array,
        force: float,
    ) -> None:
        """Remove from a step the loose motions of idle bodies, and those driven by roundoff only.

        Args:
            loose: The result of ``loose``.
            step: Increment of the displacement, shape (owned dofs,) [length]; changed.
            motion: Increments of motions of obstacles and remote loads, (m, 3) [length]; changed.
            total: Sum of all forces, shape (owned dofs,) [stress length].
            force: Size of all forces [stress length].
        """
        for body in loose:
            idle = body.label in self.aside
            if self.anchored and not idle:
                continue
            drive = float(np.linalg.norm(self.resultant(body, total)))
            if idle or drive <= self.rounding(body, force):
                dofs, motions = self.motions(body)
                excess = self.rigid_fraction(body, step)
                step[dofs] -= (excess @ motions).reshape(dofs.shape)
                self.held.subtract(body, excess, motion)

    def remark(self, loose: Sequence[FloatingBody]) -> str:
        """Sentence on the tangent springs of loose bodies; "" if there are none."""
        apart = self.aside | {body.label for body in self.without_pair()}
        names = self.names([body for body in loose if body.label not in apart])
        return (
            f"a spring in the tangent regularizes {names}, which contact supports only in part"
            if names
            else ""
        )

    # Anchored springs, see ``proximal``

    def anchor(self, total: Array, elongation: float) -> None:
        """Anchor the bodies at their present positions by springs.

        Args:
            total: Sum of all forces, shape (owned dofs,) [stress length].
            elongation: Elongation of the springs under the resultant on the body, or under the
                discretization error of its contact forces if larger [shortest facets].
        """
        bodies, length = self.bodies, elongation * self.shortest_facet()
        stiffness = anchored_stiffness(
            np.array([np.linalg.norm(self.resultant(body, total)) for body in bodies]),
            np.array([RIGID.normals_err * self.contact_force(body) for body in bodies]),
            length,
            np.array([body.stiffest for body in bodies]),
        )
        springs = {body.label: float(k) for body, k in zip(bodies, stiffness, strict=True)}
        self.springs = Springs(self._spread(springs), self._place())

    @property
    def anchored(self) -> bool:
        """Whether there are anchored springs."""
        return self.springs is not None

    @property
    def acting_springs(self) -> Springs | None:
        """The anchored springs without those of idle bodies, which only regularize the tangent."""
        springs = self.springs
        for body in self.bodies:
            if springs is not None and body.label in self.aside:
                springs = springs.without(self.dofs_of(body))
        return springs

    def add_spring_forces(self) -> None:
        """Add the forces of anchored springs to the residual."""
        springs = self.acting_springs
        if springs is not None:
            self.bulk.r.array[: self.bulk.num_owned] += springs.forces(self._place())

    def spring_fractions(self) -> list[tuple[str, float, bool]]:
        """For each anchored body: name, force of springs over contact force, whether it slides."""
        springs = self.acting_springs
        if springs is None:
            return []
        forces = springs.forces(self._place())
        contact = [self.contact_force(body) for body in self.bodies]
        carried = [float(np.linalg.norm(self.resultant(body, forces))) for body in self.bodies]
        rounding = [self.rounding(body, sum(contact)) for body in self.bodies]
        return [
            (
                self.name_of(body.label),
                over_contact(by_springs if by_springs > least else 0.0, force),
                slides([(c, self.at_body(c, body)) for c in self.contacts]),
            )
            for body, by_springs, force, least in zip(
                self.bodies, carried, contact, rounding, strict=True
            )
        ]

    def spring_energy(self) -> float:
        """Energy of the anchored springs [stress length^2]."""
        springs = self.acting_springs
        mine = 0.0 if springs is None else springs.energy(self._place())
        return self.bulk.comm.allreduce(mine)

    def max_motion(self) -> float:
        """Largest rigid motion of a body since ``anchor`` [shortest facets]."""
        if self.springs is None:
            return 0.0
        change = self._place() - self.springs.anchor
        bodies = [body for body in self.bodies if body.label not in self.aside]
        moves = [np.linalg.norm(self.rigid_fraction(body, change)) for body in bodies]
        return float(max(moves, default=0.0)) / self.shortest_facet()

    def _place(self) -> Array:
        """Displacement of the owned dofs [length]."""
        return self.bulk.u.x.array[: self.bulk.num_owned]

    def _spread(self, stiffness: dict[int, float]) -> Array:
        """Stiffness of springs at the owned dofs (owned dofs,) [stress] from that of each body."""
        springs = np.zeros(self.bulk.num_owned)
        for body in self.bodies:
            springs[self.dofs_of(body)] = stiffness[body.label] / body.num_nodes
        return springs
