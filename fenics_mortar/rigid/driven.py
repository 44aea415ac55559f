# SPDX-License-Identifier: MIT
"""Motions driven by forces, of obstacles and remote loads: unknowns q of the Newton system.

**Motions** are x, y and turn, the angle times the ``arm`` of the pair or boundary, all in units of
length. Shapes and units below are those of the plane; in space there are six motions instead of
three, see ``obstacles.rigid_motion``. Arrays have the rows of the obstacles, then those of the
remote loads. All values are replicated.

**Linearized balance.** The equations of displacement and multipliers, in either form, are extended
by columns C_q and by a row of balance for each motion,

    E_d du + M_q z + E_q dq = push - f_0,    M_q z = f_q - f_0,

where E are the derivatives of f_q at fixed z, and f_0 is the part of f_q that does not depend on z.
The few motions are eliminated, see ``spread``, so that the sparse matrix and its solver are those
of fixed obstacles.

Of obstacles, C_q is in the rows of the contact law, and f_0 = 0. D does not depend on q, so the
rows of the bodies have no entries in the new columns. Of rigid boundaries, C_q is in the rows of
the prescribed dofs, du - V dq, and [E_d, M_q] are the sums of the equations of these dofs, which
the rows of the prescribed dofs replace, with the weights V. Spread loads have two more unknowns
each, in space six, on which their forces depend.

**Before a solve** an obstacle without contact is moved until contact stops it. An obstacle on
sticking nodes follows the prescribed motions, for instance a wheel that is turned.

**Loose motions**, which active contact does not resist, have tangent springs; if Newton's method
fails for a rolling obstacle, springs anchor it like a body, see ``proximal``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag

from fenics_mortar.bulk.bodies import describe_motion
from fenics_mortar.contact.rows import gap_by_motions
from fenics_mortar.obstacles.rigid_motion import (
    TURNS,
    RigidMotion,
    by_further_motion,
    describe_load,
    describe_place,
    motion_between,
    place_after,
)
from fenics_mortar.rigid.body_motions import Touching, touches, unresisted_motion
from fenics_mortar.rigid.complementarity import closest_move
from fenics_mortar.rigid.proximal import (
    RIGID,
    Carried,
    Springs,
    anchored_stiffness,
    carried_by,
    tangent_stiffness,
    unresisted,
)
from fenics_mortar.rigid.spread import Border, BoundSpreadLoad, solve_bordered
from fenics_mortar.utils.arrays import ROUNDING, SUM_ROUNDING, Array, Flags
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.utils.ranks import sum_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.la.system import LinearSystem
    from fenics_mortar.obstacles.obstacle import Obstacle
    from fenics_mortar.rigid.spread import BoundRigidBoundary, BoundSection


def slip_by_motions(contact: Contact, nodes: Flags) -> Array:
    """Rate of slip of some nodes by obstacle motions at present, (n, 3) [1].

    In space along both tangents, (n, 2, 6). This is not the derivative of the slip of a step, which
    also depends on motions along the normal if the obstacle has turned.
    """
    o = contact.on_obstacle
    V = np.moveaxis(o.obstacle.motions(o.x, o.arm), 1, 0)
    return -np.moveaxis(contact.now.along_tangents(V), 0, -1)[nodes]


def _slip(contact: Contact) -> Array:
    """Slip of the nodes, (nodes,) [length]; in space along both tangents, (nodes, 2)."""
    now = contact.now
    return contact.slip if contact.slave.dim == 2 else now.along_tangents(now.surface_slip)


def _width(contacts: Sequence[Contact]) -> float:
    """Width of the active part of contacts [length]; in space the root of its area."""
    power = contacts[0].slave.dim - 1
    sizes = [float((c.slave.nodal_lengths[c.active] ** power).sum()) for c in contacts]
    return float(sum(sizes) ** (1.0 / power))


def loose_motions(motions: DrivenMotions) -> list[Array]:
    """Loose motions of each obstacle, an orthonormal basis (n, motions) [1] each (local)."""
    found = []
    for number, driven in enumerate(motions.driven_obstacles):
        basis = np.eye(driven.size)[driven]
        closing = [gap_by_motions(c.now)[c.active] for c in motions.contacts_of(number)]
        found.append(
            unresisted(basis @ np.concatenate([*closing, np.zeros((0, driven.size))]).T) @ basis
        )
    return found


def tangent_springs(
    motions: DrivenMotions, residual: Array, stiffness: float, force: float
) -> Array:
    """Stiffness of springs on loose motions, in proportion to the driving force (local).

    Args:
        motions: The rigid motions.
        residual: Residual of the balance, shape (m, 3) [stress length].
        stiffness: Stiffness of the bulk [stress].
        force: Size of all forces [stress length].

    Returns:
        Addition to E_q, shape (3 m, 3 m) [stress].
    """
    total, each = np.zeros((motions.scales.size,) * 2), motions.scales.shape[1]
    for number, loose in enumerate(loose_motions(motions)):
        own = slice(each * number, each * (number + 1))
        relative = tangent_stiffness(loose @ residual[number], force)
        total[own, own] = stiffness * relative * (loose.T @ loose)
    return total


def border_of(motions: DrivenMotions, system: LinearSystem) -> Border:
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


def linearize_balance(motions: DrivenMotions, system: LinearSystem) -> Border:
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


class DrivenMotions:
    """Rigid motions of the obstacles and remote loads of a problem, and the balance of driven ones.

    Args:
        bulk: The bodies.
        contacts: The contacts of the problem, and its ties.
        remote: The remote loads, bound to the mesh.

    Attributes:
        contacts: The contacts and ties.
        obstacles: Obstacles of the contacts, without duplicates.
        remote: The remote loads with motions.
        spread: Those that are spread over boundaries free to deform.
        movers: All objects with a place: the m obstacles and remote loads.
        exist: Whether there are movers or spread loads.
        pairs: Contacts with an obstacle, with the number of the obstacle.
        scales: Motions per (x, y, angle), shape (m, 3), in space (m, 6) [1, length].
        springs: Anchored springs on obstacles, or ``None``; their anchors are places.
    """

    def __init__(self, bulk: Bulk, contacts: Sequence[Any], remote: Sequence[Any] = ()) -> None:
        self.contacts = contacts
        self.spread = [load for load in remote if isinstance(load, BoundSpreadLoad)]
        self.remote: list[BoundSection | BoundRigidBoundary] = [
            load for load in remote if load not in self.spread
        ]
        found = [c.obstacle for c in contacts if c.obstacle is not None]
        self.obstacles: list[Obstacle] = list(dict.fromkeys(found))
        self.pairs: list[tuple[int, Contact]] = [
            (self.obstacles.index(c.obstacle), c) for c in contacts if c.obstacle is not None
        ]
        self.movers: list[RigidMotion] = [*self.obstacles, *(load.motion for load in self.remote)]
        self.exist = bool(self.movers or self.spread)
        self._dim, self._size = bulk.space.dim, len(TURNS[bulk.space.dim]) + bulk.space.dim
        arms = [max(c.arm for c in self.contacts_of(i)) for i in range(len(self.obstacles))]
        for number, contact in self.pairs:
            contact.set_arm(arms[number])
        arms += [load.arm for load in self.remote]
        self.scales: Array = np.ones((len(self.movers), self._size))
        self.scales[:, self._dim :] = np.reshape(arms, (-1, 1))
        bulk.spread = self.spread
        for load in self.remote:
            load.bind_forces(bulk, contacts)
        self.springs: Springs | None = None
        self._start = self.places

    @property
    def places(self) -> Array:
        """Places (x, y, angle) of all movers, shape (m, 3) [length, length, radian]."""
        return self._of_all("place")

    @places.setter
    def places(self, places: Array) -> None:
        for mover, where in zip(self.movers, places, strict=True):
            mover.place = where.copy()

    @property
    def obstacle_places(self) -> Array:
        """Places of the obstacles alone, shape (obstacles, 3) [length, length, radian]."""
        return self.places[: len(self.obstacles)]

    def motions_since(self, places: Array) -> Array:
        """Motions from earlier places (m, 3) to the present ones, shape (m, 3) [length]."""
        each = zip(places, self.places, self.scales, strict=True)
        found = [motion_between(before, now, scale[-1]) for before, now, scale in each]
        return np.reshape(found, self.scales.shape)

    def move(self, change: Array) -> None:
        """Add ``change`` to the motions, shape (m, 3) [length] (local)."""
        for mover, motion, scale in zip(self.movers, change, self.scales, strict=True):
            mover.place = place_after(mover.place, motion, scale[-1])

    def of_obstacle(self, contact: Any, change: Array) -> Array:
        """Those of ``change`` [length] that move a contact's obstacle, (3,), or (0,) (local)."""
        if contact.obstacle is None or not change.size:
            return np.zeros(0)
        return change[self.obstacles.index(contact.obstacle)]

    def largest(self) -> float:
        """Largest motion since the movers were created [length]."""
        return float(np.abs(self.places * self.scales).max(initial=0.0))

    @property
    def are_unknown(self) -> bool:
        """Whether the tangent has a border: driven motions or spread loads (local)."""
        return bool(self.spread) or bool(self.driven.any())

    @property
    def unknowns(self) -> Flags:
        """Marks of the unknowns of the border: of ``driven``, then all of spread loads (local).

        Two of each spread load, in space six, shape (3 m + 2 spread loads,), bool.
        """
        of_spread = sum(load.num_unknowns for load in self.spread)
        return np.append(self.driven.ravel(), np.ones(of_spread, bool))

    @property
    def driven(self) -> Flags:
        """Whether forces drive a motion, shape (m, 3), bool."""
        return np.isfinite(self._of_all("load"))

    @property
    def found(self) -> Flags:
        """Components of the places that a solve determines, shape (m, 3), bool.

        Those that forces drive; in space all components of a rotation that they drive in part.
        """
        found = self.driven
        found[:, self._dim :] = found[:, self._dim :].any(axis=1, keepdims=True)
        return found

    @property
    def driven_obstacles(self) -> Flags:
        """Whether forces drive a motion of an obstacle, shape (obstacles, 3), bool."""
        return self.driven[: len(self.obstacles)]

    def push(self) -> Array:
        """Loads of all obstacles and remote loads; 0 where prescribed, (m, 3) [stress length]."""
        return np.nan_to_num(self._of_all("load")) / self.scales

    def pushed_nodes(self) -> Array | float:
        """Pushes on rigid boundaries as forces on their nodes, (owned dofs,) [stress length].

        Zero without remote loads; collective.
        """
        return sum(load.pushed_nodes() for load in self.remote)

    def forces(self) -> Array:
        """f_q of all motions, rows as of ``places``, (m, 3) [stress length] (collective)."""
        return np.vstack([self.obstacle_forces(), *(load.force() for load in self.remote)])

    def obstacle_forces(self, multipliers: str = "z") -> Array:
        """f_q of the obstacles alone, shape (obstacles, 3) [stress length] (collective).

        Args:
            multipliers: Multipliers included: all ("z") or their tangential part ("shear").
        """
        total = np.zeros((len(self.obstacles), self._size))
        for number, contact in self.pairs:
            total[number] += contact.on_obstacle.motion_force(getattr(contact, multipliers))
        return total

    def contact_forces(self) -> Array:
        """Integral of |pressure| on each obstacle, shape (obstacles,) [stress length]."""
        total = np.zeros(len(self.obstacles))
        for number, contact in self.pairs:
            total[number] += contact.operators.cover @ np.abs(contact.pressure)
        return total

    def record(self) -> list[str]:
        """Set the ``reaction`` of each mover; return a sentence for each (collective)."""
        lines, thicknesses = [], [contact.slave.thickness for _, contact in self.pairs]
        # of revolution: radial forces and moments vanish around the axis
        is_axial = any(t is not None and t.by_x != 0.0 for t in thicknesses)
        forces = -self.obstacle_forces() * self.scales[: len(self.obstacles)]
        for obstacle, force in zip(self.obstacles, forces, strict=True):
            obstacle.reaction = force * [0.0, 1.0, 0.0] if is_axial else force
            load = describe_load(force, "contact force", is_axial=is_axial)
            lines.append(f"obstacle '{obstacle.name}'{describe_place(obstacle.place)}: {load}")
        lines += [load.record() for load in self.remote]
        return lines + [load.record() for load in self.spread]

    def contacts_of(self, number: int) -> list[Contact]:
        """The contacts of one obstacle."""
        return [contact for i, contact in self.pairs if i == number]

    def shortest_facet(self) -> float:
        """Shortest slave facet of all pairs with obstacles, 1 if there are none [length]."""
        return min((float(c.slave.facet_sizes.min()) for _, c in self.pairs), default=1.0)

    def _of_all(self, name: str) -> Array:
        """An attribute of all movers, shape (m, 3)."""
        return np.array([getattr(mover, name) for mover in self.movers]).reshape(-1, self._size)

    def residual(self) -> Array:
        """f_q plus springs minus push, else 0, (m, 3) [stress length] (collective)."""
        return np.where(self.driven, self.forces() + self._spring_forces() - self.push(), 0.0)

    def solve(
        self, x: Array, system: LinearSystem, stiffness: float, force: float
    ) -> tuple[Array, Array]:
        """Solve for displacements, multipliers and motions if these ``are_unknown`` (collective).

        Args:
            x: Solution of the system without motions, see ``LinearSystem.step``.
            system: System of displacement and multipliers, assembled.
            stiffness: Stiffness of the bulk [stress].
            force: Size of all forces [stress length].

        Returns:
            The solution with motions, as ``x``, and the motions, shape (m, 3) [length].
        """
        driven, motion = self.driven, np.zeros(self.scales.shape)
        border, count = border_of(self, system), self.scales.size
        border.corner[:count, :count] += self._stiffness_of_springs(stiffness, force)
        border = border.restricted_to(self.unknowns)
        push, c = self.push() - self._spring_forces(), np.zeros(len(border.corner))
        for on_mover, load in zip(push[len(self.obstacles) :], self.remote, strict=True):
            on_mover -= load.constant_force()
        c[: driven.sum()] = push[driven]
        x, found = solve_bordered(system.solve, border, x, c, system.comm)
        motion[driven] = found[: driven.sum()]
        return x, motion

    def _stiffness_of_springs(self, stiffness: float, force: float) -> Array:
        """Stiffness of anchored springs, or of tangent springs on loose motions; added to E_q."""
        if self.springs is not None:
            strain = self.motions_since(self.springs.anchor)
            by_motions = block_diag(*map(by_further_motion, strain, self.scales[:, -1]))
            return self.springs.stiffness.reshape(-1, 1) * by_motions
        return tangent_springs(self, self.residual(), stiffness, force)

    def describe(self, force: float) -> str:
        """Description of loose motions driven by forces; "" if there are none (collective).

        Args:
            force: Size of all forces [stress length].
        """
        found, residual = [], self.residual()
        for number, loose in enumerate(loose_motions(self)):
            drive = loose @ residual[number]
            if np.linalg.norm(drive) > SUM_ROUNDING * force:
                how = self._describe(number, drive @ loose)
                found.append(f"obstacle '{self.obstacles[number].name}' can {how}")
        return ", ".join(found)

    def _describe(self, number: int, motion: Array) -> str:
        """Description of a motion (3,) [length] of an obstacle."""
        obstacle, arm = self.obstacles[number], self.scales[number, -1]
        centre = obstacle.pivot + obstacle.place[: self._dim]
        return describe_motion(motion / np.linalg.norm(motion), centre, arm)

    # Springs, see ``proximal``

    def anchor(self, elongation: float, stiffness: float, share: float) -> None:
        """Anchor driven motions at their present values by springs (collective).

        Args:
            elongation: Elongation of the springs under the resultant on the obstacle, or under the
                ``share`` of the error of its contact forces if larger [shortest facets].
            stiffness: Stiffness of the bulk [stress].
            share: See ``elongation`` [1].
        """
        drives, length = self.residual(), elongation * self.shortest_facet()
        springs = np.zeros(self.scales.shape)
        for number, contact in enumerate(self.contact_forces()):
            drive, err = float(np.linalg.norm(drives[number])), share * RIGID.negligible * contact
            spring = anchored_stiffness(drive, err, length, stiffness)
            springs[number, self.driven[number]] = spring
        self.springs = Springs(springs, self.places)

    def max_motion(self) -> float:
        """Largest motion of an obstacle since ``anchor`` [shortest facets]."""
        if self.springs is None:
            return 0.0
        strain = np.where(self.driven, self.motions_since(self.springs.anchor), 0.0)
        moves = np.linalg.norm(strain[: len(self.obstacles)], axis=1)
        return float(moves.max(initial=0.0)) / self.shortest_facet()

    def carried_by_springs(self) -> list[Carried]:
        """Forces of the springs on each anchored obstacle."""
        if self.springs is None:
            return []
        forces, contact = self._spring_forces(), self.contact_forces()
        return [
            carried_by(
                float(np.linalg.norm(forces[i])),
                contact[i],
                f"obstacle '{self.obstacles[i].name}'",
                [(c, c.active) for c in self.contacts_of(i)],
                partial(self._describe, i, forces[i]),
            )
            for i in np.flatnonzero(self.driven_obstacles.any(axis=1))
        ]

    def _spring_forces(self) -> Array:
        """Forces of the anchored springs, zero without, (m, 3) [stress length]."""
        if self.springs is None:
            return np.zeros(self.scales.shape)
        return self.springs.stiffness * self.motions_since(self.springs.anchor)

    # Before and after a solve

    def follow(self, evaluate: Callable[[], object]) -> None:
        """Move driven obstacles with prescribed motions, such that nodes stick (collective).

        Without these moves all nodes would slide by an undetermined distance. A move minimizes slip
        and opening of the sticking nodes; slip alone would not determine a motion along their
        normals. Remote loads stay.

        Args:
            evaluate: Function that evaluates the operators at the present state, not the active
                sets.
        """
        if not self.driven_obstacles.any():
            return
        evaluate()
        moves = np.zeros(self.scales.shape)
        for number, driven in enumerate(self.driven_obstacles):
            mine = self.contacts_of(number)
            slip = np.concatenate([_slip(c)[c.sticking].ravel() for c in mine])
            along = [slip_by_motions(c, c.sticking).reshape(-1, driven.size) for c in mine]
            across = np.concatenate([gap_by_motions(c.now)[c.sticking] for c in mine])
            rows = np.concatenate([*along, across])[:, driven]
            sizes = np.linalg.norm(rows, axis=0)  # units of turn and translation differ
            sizes[sizes == 0.0] = 1.0
            desired = np.concatenate([-slip, np.zeros(len(across))])
            found = np.linalg.lstsq(rows / sizes, desired, rcond=RIGID.followed)[0]
            moves[number, driven] = found / sizes
        self.move(moves)

    def settle(self, evaluate: Callable[[], object]) -> list[str]:
        """Move driven obstacles without contact force until contact stops them (collective).

        Args:
            evaluate: Function that evaluates the contacts at the present state.

        Returns:
            A sentence for each obstacle that was moved.

        Raises:
            MortarError: On all ranks, if no contact stops an obstacle.
        """
        self._start = self.places
        if not self.driven_obstacles.any():
            return []
        moved = dict[str, None]()
        for _ in range(RIGID.max_moves):
            evaluate()
            moves = np.zeros(self.scales.shape)
            for i in range(len(self.obstacles)):
                moves[i] = self._next_move(i)
            moving = np.flatnonzero(moves.any(axis=1))
            if not moving.size:
                self._start = self.places
                return [f"{name} was moved until contact stopped it" for name in moved]
            moved |= dict.fromkeys(f"obstacle '{self.obstacles[i].name}'" for i in moving)
            self.move(moves)
        free = moving[0]
        name, how = self.obstacles[free].name, self._describe(free, moves[free])
        raise MortarError(
            f"obstacle '{name}' can {how} freely: its push drives it, and no contact stops it; "
            "prescribe that motion by move()"
        )

    def _next_move(self, number: int) -> Array:
        """Motion of an obstacle towards contact, (3,) [length]; zero if loaded or not driven.

        The motion closest to the push for which no node overlaps by more than ``RIGID.overlap`` and
        the push does positive work. The potential of the push is linear; therefore no move is
        reversed later.
        """
        contacts = self.contacts_of(number)
        driven, push = self.driven[number], self.push()[number]
        loaded = any((c.pressure > SUM_ROUNDING * c.modulus).any() for c in contacts)
        if loaded or not push.any() or self._may_be_held(number):
            return np.zeros(push.size)
        basis = np.eye(push.size)[driven]
        along = (basis @ push) / np.linalg.norm(push)
        closing = [-gap_by_motions(contact.now) @ basis.T for contact in contacts]
        desired = RIGID.largest_move * contacts[0].arm * along
        move = closest_move(desired, closing, contacts, back=-along)
        if move @ along > RIGID.sliver * self.shortest_facet():
            return move @ basis
        return np.zeros(push.size)

    def _may_be_held(self, number: int) -> bool:
        """Whether friction may hold an obstacle against its push, by limit analysis (local).

        Not where nothing presses: the push closes no touching node, and none overlaps.
        """
        contacts, driven = self.contacts_of(number), self.driven[number]
        pairs = [(c, touches(c)) for c in contacts]
        weight = sum(float(c.operators.weight[on].sum()) for c, on in pairs)
        if weight == 0.0 or not any(c.pair.law.has_friction for c in contacts):
            return False
        push = self.push()[number, driven]
        found, size, presses = [], float(np.linalg.norm(push)), False
        for c, on in pairs:
            slope, shear = c.now.strength(size / weight)
            opens, slips = gap_by_motions(c.now)[on], slip_by_motions(c, on)
            overlaps = c.now.closing_gap < -ROUNDING * c.slave.nodal_lengths
            presses |= bool(
                (opens[:, driven] @ push < -ROUNDING * size).any() or overlaps[on].any()
            )
            forces = c.operators.weight * [shear, c.now.largest_adhesion()]
            found.append((opens[:, driven], slips[..., driven], slope[on], *forces[:, on]))
        touching = Touching(*map(np.concatenate, zip(*found, strict=True)))
        return presses and not unresisted_motion(push, touching).any()

    def slide_along_driven(self) -> float:
        """Largest slide of obstacles along driven motions, over their contact width [1] (local).

        In the last solve; zero for obstacles with a node that sticks or has no friction.
        """
        found = np.where(self.driven, self.motions_since(self._start), 0.0)
        widths = [0.0]
        for number, motion in enumerate(found[: len(self.obstacles)]):
            mine = self.contacts_of(number)
            slides = np.concatenate([c.sliding[c.active] for c in mine])
            if motion.any() and slides.size and slides.all():
                slips = [slip_by_motions(c, c.active) @ motion for c in mine]
                each = np.concatenate([slip.reshape(len(slip), -1) for slip in slips])
                widths.append(float(np.linalg.norm(each, axis=1).min()) / _width(mine))
        return max(widths)
