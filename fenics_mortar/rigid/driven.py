# SPDX-License-Identifier: MIT
"""Rigid obstacles that forces drive: their motions q are unknowns of the Newton system.

The few motions are eliminated from the system that their balance borders, see ``balance`` and
``bordered``: the sparse matrix, its pattern and its solver are those of obstacles at rest.

A motion that active contact leaves loose gets a spring in the tangent, see ``loose``; a driven
obstacle that touches nothing is moved before the solve until contact stops it, see ``settling``.
If Newton's method fails for a rolling obstacle, springs anchor it like a body, see ``proximal``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.la.system import LinearSystem
from fenics_mortar.rigid import settling
from fenics_mortar.rigid.balance import linearize_balance
from fenics_mortar.rigid.bordered import Border, solve_bordered
from fenics_mortar.rigid.loose import describe_loose, tangent_springs
from fenics_mortar.rigid.motions import ObstacleMotions
from fenics_mortar.rigid.options import RIGID
from fenics_mortar.rigid.springs import Springs, anchored_stiffness, slides
from fenics_mortar.utils.arrays import Array


class DrivenObstacles(ObstacleMotions):
    """The obstacles of a problem, and the balance of their driven motions.

    Args:
        contacts: The contacts of the problem, and its ties.

    Attributes:
        springs: Springs of ``anchor``, if there are any.
    """

    def __init__(self, contacts: Sequence[Any]) -> None:
        super().__init__(contacts)
        self.springs: Springs | None = None
        self._start: Array = np.zeros(self.scales.shape)

    def residual(self) -> Array:
        """f_q and springs less the push of driven motions, else 0, (obstacles, 3) (collective)."""
        return np.where(self.driven, self.forces() + self._spring_forces() - self.push(), 0.0)

    def solve(
        self, system: LinearSystem, stiffness: float, force: float
    ) -> tuple[PETSc.Vec, list[Array], Array]:
        """Solve for displacement, multipliers and motions (collective).

        Args:
            system: System of displacement and multipliers, assembled.
            stiffness: Of the bulk [stress].
            force: Size of the forces [stress length].

        Returns:
            Increment of the displacement, multipliers, and motions (obstacles, 3) [length].
        """
        driven, motion = self.driven, np.zeros(self.scales.shape)
        x = system.step()
        if driven.any():
            balance = linearize_balance(self, system)
            corner = balance.corner + self._stiffness_of_springs(stiffness, force)
            border = Border(balance.columns, balance.rows, corner).part(driven.ravel())
            push = (self.push() - self._spring_forces())[driven]
            x, motion[driven] = solve_bordered(system.solve, border, x, push, system.comm)
        du, z = system.split(x)
        step = PETSc.Vec().createMPI((du.size, None), comm=system.comm)
        step.array[:] = du
        return step, z, motion

    def _stiffness_of_springs(self, stiffness: float, force: float) -> Array:
        """Stiffness of the springs of ``anchor``, or else of those on loose motions; as E_q."""
        if self.springs is not None:
            return np.diag(self.springs.stiffness.ravel())
        return tangent_springs(self, self.residual(), stiffness, force)

    def describe(self, force: float) -> str:
        """Loose motions that forces drive, in words; "" if there are none (collective)."""
        return describe_loose(self, self.residual(), force)

    # Springs, see ``proximal``

    def anchor(self, elongation: float, stiffness: float) -> None:
        """Anchor driven motions at their present values by springs (collective).

        Args:
            elongation: Elongation of an obstacle's springs under the forces that drive it, or under
                the error of the contact forces on it by the slave's facets, in shortest facets.
            stiffness: Of the bulk [stress].
        """
        springs = anchored_stiffness(
            np.linalg.norm(self.residual(), axis=1),
            RIGID.negligible * self.contact_forces(),
            elongation * self.shortest_facet(),
            np.asarray(stiffness),
        )
        driven = np.where(self.driven, springs[:, None], 0.0)
        self.springs = Springs(driven, self.motions_of(self.places))

    def remove_springs(self) -> None:
        """Remove the springs of ``anchor``."""
        self.springs = None

    def max_motion(self) -> float:
        """Largest motion of an obstacle since ``anchor``, in shortest facets."""
        if self.springs is None:
            return 0.0
        strain = self.motions_of(self.places) - self.springs.anchor
        moves = np.linalg.norm(np.where(self.driven, strain, 0.0), axis=1)
        return float(moves.max(initial=0.0)) / self.shortest_facet()

    def spring_fractions(self) -> list[tuple[str, float, bool]]:
        """Name, force of springs over contact force, whether it slides, of those on springs."""
        if self.springs is None:
            return []
        forces = np.linalg.norm(self._spring_forces(), axis=1)
        fractions = forces / np.maximum(self.contact_forces(), 1e-300)
        return [
            (
                f"obstacle '{self.obstacles[i].name}'",
                float(fractions[i]),
                slides([(c, c.active) for c in self.contacts_of(i)]),
            )
            for i in np.flatnonzero(self.driven.any(axis=1))
        ]

    def spring_energy(self) -> float:
        """Energy in the springs of ``anchor`` [stress length^2]."""
        here = self.motions_of(self.places)
        return 0.0 if self.springs is None else self.springs.energy(here)

    def _spring_forces(self) -> Array:
        here = self.motions_of(self.places)
        return np.zeros(self.scales.shape) if self.springs is None else self.springs.forces(here)

    # Before and after a solve

    def follow(self, evaluate: Callable[[], object]) -> None:
        """Move driven obstacles along with prescribed motions; see ``settling`` (collective).

        Args:
            evaluate: Evaluates the operators at the present state, not the sets.
        """
        if self.driven.any():
            evaluate()
            self.move(settling.follow(self))

    def settle(self, evaluate: Callable[[], object]) -> list[str]:
        """Move driven obstacles until contact stops them; see ``settling`` (collective)."""
        if not self.driven.any():
            return []
        moved = settling.settle(self, evaluate)
        self._start = self.motions_of(self.places)
        return moved

    def own_slide(self) -> float:
        """Slide of an obstacle of its own accord in the last solve; see ``settling.own_slide``."""
        return settling.own_slide(self, self._start)
