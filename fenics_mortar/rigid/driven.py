# SPDX-License-Identifier: MIT
"""Motions driven by forces, of obstacles and remote loads: unknowns q of the Newton system.

The balance of these forces borders the system of u and z, see ``balance``. The few motions are
eliminated, see ``bordered``, so that the sparse matrix and its solver are those of fixed obstacles.

Tangent springs regularize motions that active contact does not resist, see ``loose``. A driven
obstacle without contact is moved before the solve until contact stops it, see ``settling``.
If Newton's method fails for a rolling obstacle, springs anchor it like a body, see ``proximal``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.obstacles.places import by_further_motion, motion_between
from fenics_mortar.rigid import settling
from fenics_mortar.rigid.balance import border_of
from fenics_mortar.rigid.bordered import solve_bordered
from fenics_mortar.rigid.loose import describe_loose, tangent_springs
from fenics_mortar.rigid.motions import RigidMotions
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.rigid.spread import BoundSpreadLoad
from fenics_mortar.rigid.springs import Springs, anchored_stiffness, over_contact, slides
from fenics_mortar.utils.arrays import Array


class DrivenMotions(RigidMotions):
    """Rigid motions of a problem and the balance of the driven ones.

    Args:
        bulk: The bodies.
        contacts: The contacts of the problem, and its ties.
        remote: The remote loads, bound to the mesh.

    Attributes:
        springs: Anchored springs on obstacles, or ``None``.
    """

    def __init__(self, bulk: Bulk, contacts: Sequence[Any], remote: Sequence[Any] = ()) -> None:
        spread = [load for load in remote if isinstance(load, BoundSpreadLoad)]
        super().__init__(contacts, [load for load in remote if load not in spread], spread)
        bulk.spread = spread
        for load in self.remote:
            load.bind_forces(bulk, contacts)
        self.springs: Springs | None = None
        self._anchor = self._start = self.places

    def residual(self) -> Array:
        """f_q plus springs minus push, else 0, (m, 3) [stress length] (collective)."""
        if not self.movers:
            return self._none
        return np.where(self.driven, self.forces() + self._spring_forces() - self.push(), 0.0)

    def solve(
        self, x: Array, system: LinearSystem, stiffness: float, force: float
    ) -> tuple[Array, Array]:
        """Solve for displacements, multipliers and motions (collective).

        Args:
            x: Solution of the system without motions, see ``LinearSystem.step``.
            system: System of displacement and multipliers, assembled.
            stiffness: Stiffness of the bulk [stress].
            force: Size of all forces [stress length].

        Returns:
            The solution with motions, as ``x``, and the motions, shape (m, 3) [length].
        """
        driven, motion = self.driven, np.zeros(self.scales.shape)
        if self.are_unknown:
            border, count = border_of(self, system), self.scales.size
            border.corner[:count, :count] += self._stiffness_of_springs(stiffness, force)
            border = border.restricted_to(self.unknowns)
            push = (self.push() - self._spring_forces() - self._constant_forces())[driven]
            c = np.append(push, np.zeros(self.num_of_spread))
            x, found = solve_bordered(system.solve, border, x, c, system.comm)
            motion[driven] = found[: push.size]
        return x, motion

    def _constant_forces(self) -> Array:
        """Parts of f_q that are not linear in the multipliers, (m, 3) [stress length]."""
        on_obstacles = np.zeros_like(self.scales[: len(self.obstacles)])
        return np.vstack([on_obstacles, *(load.constant_force() for load in self.remote)])

    def _stiffness_of_springs(self, stiffness: float, force: float) -> Array:
        """Stiffness of anchored springs, or of tangent springs on loose motions; added to E_q."""
        if self.springs is not None:
            return self.springs.stiffness.reshape(-1, 1) * self._strain_by_motions()
        return tangent_springs(self, self.residual(), stiffness, force)

    def describe(self, force: float) -> str:
        """Description of loose motions driven by forces; "" if there are none (collective)."""
        return describe_loose(self, self.residual(), force)

    # Springs, see ``proximal``

    def anchor(self, elongation: float, stiffness: float) -> None:
        """Anchor driven motions at their present values by springs (collective).

        Args:
            elongation: Elongation of the springs under the resultant on the obstacle, or under the
                discretization error of its contact forces if larger [shortest facets].
            stiffness: Stiffness of the bulk [stress].
        """
        count = len(self.obstacles)
        springs = anchored_stiffness(
            np.linalg.norm(self.residual()[:count], axis=1),
            RIGID.negligible * self.contact_forces(),
            elongation * self.shortest_facet(),
            np.asarray(stiffness),
        )
        driven = np.zeros(self.scales.shape)
        driven[:count] = np.where(self.driven_obstacles, springs[:, None], 0.0)
        self._anchor = self.places
        self.springs = Springs(driven, np.zeros(driven.shape))

    def remove_springs(self) -> None:
        """Remove the anchored springs."""
        self.springs = None

    def max_motion(self) -> float:
        """Largest motion of an obstacle since ``anchor`` [shortest facets]."""
        if self.springs is None:
            return 0.0
        strain = np.where(self.driven, self.motions_since(self._anchor), 0.0)
        moves = np.linalg.norm(strain[: len(self.obstacles)], axis=1)
        return float(moves.max(initial=0.0)) / self.shortest_facet()

    def spring_fractions(self) -> list[tuple[str, float, bool]]:
        """Name, force of springs over contact force, whether it slides, of anchored obstacles."""
        if self.springs is None:
            return []
        forces = np.linalg.norm(self._spring_forces()[: len(self.obstacles)], axis=1)
        fractions = list(map(over_contact, forces, self.contact_forces()))
        return [
            (
                f"obstacle '{self.obstacles[i].name}'",
                float(fractions[i]),
                slides([(c, c.active) for c in self.contacts_of(i)]),
            )
            for i in np.flatnonzero(self.driven_obstacles.any(axis=1))
        ]

    def spring_energy(self) -> float:
        """Energy of the anchored springs [stress length^2]."""
        return 0.0 if self.springs is None else self.springs.energy(self._strain())

    def _spring_forces(self) -> Array:
        none = np.zeros(self.scales.shape)
        return none if self.springs is None else self.springs.forces(self._strain())

    def _strain(self) -> Array:
        """Motions since ``anchor``, shape (m, 3) [length]."""
        return self.motions_since(self._anchor)

    def _strain_by_motions(self) -> Array:
        """Derivative of ``_strain`` by further motions, shape (3 m, 3 m) [1]."""
        each = zip(self.movers, self._anchor, self.scales, strict=True)
        motions = ((motion_between(at, mover.place, s[-1]), s[-1]) for mover, at, s in each)
        return block_diag(*(by_further_motion(*motion) for motion in motions))

    # Before and after a solve

    def follow(self, evaluate: Callable[[], object]) -> None:
        """Move driven obstacles along with prescribed motions; see ``settling`` (collective).

        Args:
            evaluate: Function that evaluates the operators at the present state, not the active
                sets.
        """
        if self.driven_obstacles.any():
            evaluate()
            self.move(settling.follow(self))

    def settle(self, evaluate: Callable[[], object]) -> list[str]:
        """Move driven obstacles until contact stops them; see ``settling`` (collective)."""
        self._start = self.places
        if not self.driven_obstacles.any():
            return []
        moved = settling.settle(self, evaluate)
        self._start = self.places
        return moved

    def slide_along_driven(self) -> float:
        """Slide of obstacles along driven motions in the last solve [1]; see ``settling``."""
        return settling.slide_along_driven(self, self._start)
