# SPDX-License-Identifier: MIT
"""Motions driven by forces, of obstacles and remote loads: unknowns q of the Newton system.

The balance of these forces borders the system of u and z. The few motions are
eliminated, see ``spread``, so that the sparse matrix and its solver are those of fixed obstacles.

Tangent springs regularize motions that active contact does not resist, see ``motions``. A driven
obstacle without contact is moved before the solve until contact stops it, see ``motions``.
If Newton's method fails for a rolling obstacle, springs anchor it like a body, see ``proximal``.

Linearized balance of driven motions: the border of the system of u and z.

The equations of displacement and multipliers, in either form, are extended by columns C_q and by a
row of balance for each motion,

    E_d du + M_q z + E_q dq = push - f_0,    M_q z = f_q - f_0,

where E are the derivatives of f_q at fixed z, and f_0 is the part of f_q that does not depend on z.

Of obstacles, C_q is in the rows of the contact law, and f_0 = 0. D does not depend on q, so the
rows of the bodies have no entries in the new columns. Of rigid boundaries, C_q is in the rows of
the prescribed dofs, du - V dq, and [E_d, M_q] are the sums of the equations of these dofs, which
the rows of the prescribed dofs replace, with the weights V.

Spread loads have two more unknowns each, in space six, on which their forces depend; see
``spread``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.obstacles.rigid_motion import by_further_motion, motion_between
from fenics_mortar.rigid.motions import (
    RigidMotions,
    describe_loose,
    follow,
    settle,
    slide_along_driven,
    tangent_springs,
)
from fenics_mortar.rigid.proximal import RIGID, Springs, anchored_stiffness, over_contact, slides
from fenics_mortar.rigid.spread import Border, BoundSpreadLoad, solve_bordered
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import sum_over_ranks


def border_of(motions: RigidMotions, system: LinearSystem) -> Border:
    """Border of all motions, driven or not, and of spread loads, see ``linearize_balance``."""
    motion = border = linearize_balance(motions, system)
    for load in motions.spread:
        spread = load.linearize(system)
        coupling = by_spread(motion, spread, system)
        spread.columns[:, system.bulk.prescribed_dofs] = 0.0
        border = border.joined(spread)
        border.corner[: len(coupling), -len(spread.corner) :] = coupling
    return border


def by_spread(motion: Border, spread: Border, system: LinearSystem) -> Array:
    """Derivatives of f_q by the unknowns of a spread load, (3 m, 2) [stress length] (collective).

    Its forces act on nodes that a rigid boundary prescribes, whose columns are -V.
    """
    return -sum_over_ranks(system.comm, motion.columns @ spread.columns.T)


def linearize_balance(motions: RigidMotions, system: LinearSystem) -> Border:
    """C_q, [E_d, M_q] and E_q of all motions, driven or not (collective).

    Args:
        motions: The rigid motions; their ``take_bulk_rows`` was called at this state.
        system: System of displacement and multipliers; columns and rows are its vectors.
    """
    count, size, each = motions.scales.size, system.bulk.num_owned, motions.scales.shape[1]
    columns = np.zeros((count, size + system.num_z_dofs))
    rows, corner = np.zeros_like(columns), np.zeros((count, count))
    for contact, z_dofs in zip(motions.contacts, system.z_dofs, strict=True):
        if contact.obstacle is None:
            continue
        first = each * motions.obstacles.index(contact.obstacle)
        own = slice(first, first + each)
        E_d, M_q, E_q = contact.on_obstacle.motion_force_derivatives(contact.z)
        acting = M_q * contact.acts[:, None]
        multipliers = size + system.local(contact, z_dofs)
        mine = contact.slave.owned
        columns[own, multipliers] += np.moveaxis(contact.rows.by_motions()[mine], 2, 0)
        rows[own, multipliers] += acting[:, mine]
        for flux in contact.fluxes:
            flux.add_by_motions(columns[own])
        for row, forces in zip(rows[own], E_d, strict=True):
            contact.slave.scatter_add(forces, row)
        corner[own, own] += E_q
    for number, load in enumerate(motions.remote, len(motions.obstacles)):
        own = slice(each * number, each * (number + 1))
        border = load.linearize(system)
        columns[own], rows[own], corner[own, own] = border.columns, border.rows, border.corner
    return Border(columns, rows, corner)


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
        """Move driven obstacles along with prescribed motions; see ``motions`` (collective).

        Args:
            evaluate: Function that evaluates the operators at the present state, not the active
                sets.
        """
        if self.driven_obstacles.any():
            evaluate()
            self.move(follow(self))

    def settle(self, evaluate: Callable[[], object]) -> list[str]:
        """Move driven obstacles until contact stops them; see ``motions`` (collective)."""
        self._start = self.places
        if not self.driven_obstacles.any():
            return []
        moved = settle(self, evaluate)
        self._start = self.places
        return moved

    def slide_along_driven(self) -> float:
        """Slide of obstacles along driven motions in the last solve [1]; see ``motions``."""
        return slide_along_driven(self, self._start)
