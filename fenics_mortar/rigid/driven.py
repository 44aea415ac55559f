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
The few motions are eliminated, see ``la.sparse``, so that the sparse matrix and its solver are
those of fixed obstacles.

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
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag

from fenics_mortar.bulk.bodies import describe_motion
from fenics_mortar.contact.rows import gap_by_motions
from fenics_mortar.la.sparse import Border, solve_bordered
from fenics_mortar.obstacles.rigid_motion import RIGID, TURNS, by_further_motion, motion_between
from fenics_mortar.rigid.complementarity import Touching, closest_move, touches, unresisted_motion
from fenics_mortar.rigid.proximal import AnchoredSprings, unresisted
from fenics_mortar.rigid.spread import BoundRigidBoundary, BoundSection, BoundSpreadLoad, Mover
from fenics_mortar.utils import errors, ranks
from fenics_mortar.utils.arrays import ROUNDING, SUM_ROUNDING, Array, Flags

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.la.system import LinearSystem
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.obstacles.obstacle import Obstacle


def slip_by_motions(contact: Contact, nodes: Flags) -> Array:
    """Rate of slip of some nodes by obstacle motions at present, (n, 3) [1].

    In space along both tangents, (n, 2, 6). This is not the derivative of the slip of a step, which
    also depends on motions along the normal if the obstacle has turned.
    """
    o = contact.operators
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


class BoundObstacle(Mover):
    """An obstacle in a problem, with its contacts.

    Args:
        obstacle: The obstacle of the user.
        space: Nodes and dofs of the displacement.
        contacts: All contacts and ties; those with the obstacle get its arm.

    Attributes:
        motion: The obstacle of the user.
        contacts: Its contacts.
        arm: Length by which its angles are multiplied [length].
    """

    reacts, force_name = -1.0, "contact force"

    def __init__(
        self, obstacle: Obstacle, space: DisplacementSpace, contacts: Sequence[Any]
    ) -> None:
        self.motion, self._space = obstacle, space
        self.contacts: list[Contact] = [c for c in contacts if c.obstacle is obstacle]
        self.arm = max(c.arm for c in self.contacts)
        for contact in self.contacts:
            contact.set_arm(self.arm)

    # Balance

    def force(self, multipliers: str = "z") -> Array:
        """f_q of the obstacle, shape (3,) [stress length] (collective).

        Args:
            multipliers: Multipliers included: all ("z") or their tangential part ("shear").
        """
        total = np.zeros(self.motion.place.size)
        for contact in self.contacts:
            total += contact.operators.motion_force(getattr(contact, multipliers))
        return total

    def contact_force(self) -> float:
        """Integral of |pressure| on the obstacle [stress length]."""
        return sum(float(c.operators.cover @ np.abs(c.pressure)) for c in self.contacts)

    def linearize(self, system: LinearSystem) -> Border:
        """Columns of the contact law, rows and corner of the balance (collective)."""
        columns, rows, corner = border = Border.empty(system, self.motion.place.size)
        for contact, z_dofs in system.numbered():
            if contact not in self.contacts:
                continue
            E_d, M_q, E_q = contact.operators.motion_force_derivatives(contact.z)
            acting = M_q * contact.acts[:, None]
            multipliers = system.bulk.num_owned + system.local(contact, z_dofs)
            mine = contact.slave.owned
            columns[:, multipliers] += np.moveaxis(contact.rows.by_motions()[mine], 2, 0)
            rows[:, multipliers] += acting[:, mine]
            for flux in contact.fluxes:
                flux.add_by_motions(columns)
            for row, forces in zip(rows, E_d, strict=True):
                contact.slave.scatter_add(forces, row)
            corner += E_q
        return border

    def loose(self) -> Array:
        """Motions that forces drive and active contact does not resist, see ``Mover`` (local)."""
        basis = np.eye(self.driven.size)[self.driven]
        closing = [gap_by_motions(c.now)[c.active] for c in self.contacts]
        return unresisted(basis @ np.concatenate(closing).T) @ basis

    def describe(self, motion: Array, *, directed: bool = True) -> str:
        """Description of a motion (3,) [length]; see ``describe_motion``."""
        one = motion / np.linalg.norm(motion)
        return describe_motion(one, self.motion.present_pivot, self.arm, directed=directed)

    def at(self, contact: Contact) -> Flags:
        """Slave nodes of one of its contacts whose force acts on it, (slave nodes,)."""
        return contact.active

    # Before and after a solve

    def follow(self) -> Array:
        """Motion that minimizes slip and opening of the sticking nodes, (3,) [length].

        Slip alone would not determine a motion along their normals.
        """
        mine, driven, motion = self.contacts, self.driven, np.zeros(self.motion.place.size)
        slip = np.concatenate([_slip(c)[c.sticking].ravel() for c in mine])
        along = [slip_by_motions(c, c.sticking).reshape(-1, driven.size) for c in mine]
        across = np.concatenate([gap_by_motions(c.now)[c.sticking] for c in mine])
        rows = np.concatenate([*along, across])[:, driven]
        sizes = np.linalg.norm(rows, axis=0)  # units of turn and translation differ
        sizes[sizes == 0.0] = 1.0
        desired = np.concatenate([-slip, np.zeros(len(across))])
        found = np.linalg.lstsq(rows / sizes, desired, rcond=RIGID.followed)[0]
        motion[driven] = found / sizes
        return motion

    def next_move(self, least: float) -> Array:
        """Motion towards contact, (3,) [length]; zero if loaded, not driven, or negligible.

        The motion closest to the push for which no node overlaps by more than ``RIGID.overlap`` and
        the push does positive work. The potential of the push is linear; therefore no move is
        reversed later.

        Args:
            least: Length of the longest advance that is considered zero [length].
        """
        contacts, push = self.contacts, self.push()
        loaded = any((c.pressure > SUM_ROUNDING * c.modulus).any() for c in contacts)
        if loaded or not push.any() or self._may_be_held():
            return np.zeros(push.size)
        basis = np.eye(push.size)[self.driven]
        along = (basis @ push) / np.linalg.norm(push)
        closing = [-gap_by_motions(contact.now) @ basis.T for contact in contacts]
        move = closest_move(RIGID.largest_move * self.arm * along, closing, contacts, back=-along)
        return move @ basis if move @ along > least else np.zeros(push.size)

    def _may_be_held(self) -> bool:
        """Whether friction may hold an obstacle against its push, by limit analysis (local).

        Not where nothing presses: the push closes no touching node, and none overlaps.
        """
        driven, pairs = self.driven, [(c, touches(c)) for c in self.contacts]
        weight = sum(float(c.operators.weight[on].sum()) for c, on in pairs)
        if weight == 0.0 or not any(c.pair.law.has_friction for c in self.contacts):
            return False
        push = self.push()[driven]
        found, size, presses = [], float(np.linalg.norm(push)), False
        for c, on in pairs:
            opens, slips = gap_by_motions(c.now)[:, driven], slip_by_motions(c, on)[..., driven]
            overlaps = c.now.closing_gap < -ROUNDING * c.slave.nodal_lengths
            presses |= bool(((opens @ push < -ROUNDING * size) | overlaps)[on].any())
            found.append(Touching.of(c, on, opens[on], slips, size / weight))
        return presses and not unresisted_motion(push, Touching.joined(found)).any()

    def slide(self, motion: Array) -> float:
        """Slide by a motion (3,) [length] over the contact width [1] (local).

        Zero with a node that sticks or has no friction.
        """
        slides = np.concatenate([c.sliding[c.active] for c in self.contacts])
        if not (motion.any() and slides.size and slides.all()):
            return 0.0
        slips = [slip_by_motions(c, c.active) @ motion for c in self.contacts]
        each = np.concatenate([slip.reshape(len(slip), -1) for slip in slips])
        return float(np.linalg.norm(each, axis=1).min()) / _width(self.contacts)


def border_of(motions: DrivenMotions, system: LinearSystem) -> Border:
    """Border of all motions, driven or not, and of spread loads, see ``linearize_balance``."""
    motion = border = linearize_balance(motions, system)
    for load in motions.spread:
        spread = load.linearize(system)
        coupling = by_spread(motion, spread, system)
        spread.columns[:, system.bulk.prescribed_dofs] = 0.0
        border = Border.joined([border, spread])
        border.corner[: len(coupling), -len(spread.corner) :] = coupling
    return border


def by_spread(motion: Border, spread: Border, system: LinearSystem) -> Array:
    """Derivatives of f_q by the unknowns of a spread load, (3 m, 2) [stress length] (collective).

    Its forces act on nodes that a rigid boundary prescribes, whose columns are -V.
    """
    return -ranks.sum_over_ranks(system.comm, motion.columns @ spread.columns.T)


def linearize_balance(motions: DrivenMotions, system: LinearSystem) -> Border:
    """C_q, [E_d, M_q] and E_q of all motions, driven or not (collective).

    Args:
        motions: The rigid motions; ``take_bulk_rows`` of boundaries was called at this state.
        system: System of displacement and multipliers; columns and rows are its vectors.
    """
    borders = (mover.linearize(system) for mover in motions.movers)
    return Border.joined([Border.empty(system, 0), *borders])


class DrivenMotions:
    """Rigid motions of the obstacles and remote loads of a problem, and the balance of driven ones.

    Args:
        bulk: The bodies.
        contacts: The contacts of the problem, and its ties.
        remote: The remote loads, bound to the mesh.

    Attributes:
        obstacles: Obstacles of the contacts, without duplicates.
        boundaries, sections: The rigid boundaries, and the sections under pretension.
        remote: Boundaries and sections: the remote loads with motions.
        spread: Remote loads that are spread over boundaries free to deform.
        on_contacts: The obstacles with their contacts.
        movers: All with a place: the m obstacles and remote loads.
        exist: Whether there are movers or spread loads.
        shortest_facet: Shortest facet of all pairs with obstacles, 1 if there are none [length].
        scales: Motions per (x, y, angle), shape (m, 3), in space (m, 6) [1, length].
        springs: Anchored springs, which set this attribute.
    """

    springs: AnchoredSprings

    def __init__(self, bulk: Bulk, contacts: Sequence[Any], remote: Sequence[Any]) -> None:
        self.spread = [load for load in remote if isinstance(load, BoundSpreadLoad)]
        self.boundaries = [load for load in remote if isinstance(load, BoundRigidBoundary)]
        self.sections = [load for load in remote if isinstance(load, BoundSection)]
        self.remote: list[BoundRigidBoundary | BoundSection] = [*self.boundaries, *self.sections]
        found = [c.obstacle for c in contacts if c.obstacle is not None]
        self.obstacles: list[Obstacle] = list(dict.fromkeys(found))
        self.on_contacts = [BoundObstacle(each, bulk.space, contacts) for each in self.obstacles]
        self.movers: list[Mover] = [*self.on_contacts, *self.remote]
        self.exist = bool(self.movers or self.spread)
        self.shortest_facet = min(
            (float(c.slave.facet_sizes.min()) for o in self.on_contacts for c in o.contacts),
            default=1.0,
        )
        self._dim, self._size = bulk.space.dim, len(TURNS[bulk.space.dim]) + bulk.space.dim
        self.scales: Array = self._of_all(lambda mover: mover.scales)
        bulk.spread = self.spread
        for load in self.boundaries:
            load.bind_forces(bulk, contacts)
        self._start = self.places

    @property
    def places(self) -> Array:
        """Places (x, y, angle) of all movers, shape (m, 3) [length, length, radian]."""
        return self._of_all(lambda mover: mover.motion.place)

    @places.setter
    def places(self, places: Array) -> None:
        for mover, where in zip(self.movers, places, strict=True):
            mover.motion.place = where.copy()

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
        for mover, motion in zip(self.movers, change, strict=True):
            mover.move(motion)

    def of_obstacle(self, contact: Any, values: Any) -> Any:
        """Row of ``values`` (m, ...) of a contact's obstacle, a view, or (0,) without (local)."""
        if contact.obstacle is None or not values.size:
            return np.zeros(0)
        return values[self.obstacles.index(contact.obstacle)]

    def largest(self) -> float:
        """Largest motion since the movers were created [length]."""
        return float(np.abs(self.places * self.scales).max(initial=0.0))

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
        return np.isfinite(self._of_all(lambda mover: mover.motion.load))

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
        return self._of_all(lambda mover: mover.push())

    def pushed_nodes(self) -> Array | float:
        """Pushes on rigid boundaries as forces on their nodes, (owned dofs,) [stress length].

        Zero without remote loads; collective.
        """
        return sum(load.pushed_nodes() for load in self.remote)

    def forces(self) -> Array:
        """f_q of all motions, rows as of ``places``, (m, 3) [stress length] (collective)."""
        return self._of_all(lambda mover: mover.force())

    def obstacle_forces(self, multipliers: str = "z") -> Array:
        """f_q of the obstacles alone, shape (obstacles, 3) [stress length] (collective).

        Args:
            multipliers: Multipliers included: all ("z") or their tangential part ("shear").
        """
        found = [each.force(multipliers) for each in self.on_contacts]
        return np.reshape(found, (-1, self._size))

    def record(self) -> list[str]:
        """Set the ``reaction`` of each mover; return a sentence for each (collective)."""
        found = [mover.record() for mover in self.movers]
        return found + [load.record() for load in self.spread]

    def _of_all(self, values: Callable[[Mover], Array]) -> Array:
        """Values of all movers, shape (m, 3)."""
        return np.reshape([values(mover) for mover in self.movers], (-1, self._size))

    def residual(self) -> Array:
        """f_q plus springs minus push, else 0, (m, 3) [stress length] (collective)."""
        return np.where(self.driven, self.forces() + self.springs.on_motions() - self.push(), 0.0)

    def solve(
        self, x: Array, system: LinearSystem, stiffness: float, force: float
    ) -> tuple[Array, Array]:
        """Solve for displacements, multipliers and motions, if there are ``unknowns`` (collective).

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
        push, c = self.push() - self.springs.on_motions(), np.zeros(len(border.corner))
        push -= self._of_all(lambda mover: mover.constant_force())
        c[: driven.sum()] = push[driven]
        x, found = solve_bordered(system.solve, border, x, c, system.comm)
        motion[driven] = found[: driven.sum()]
        return x, motion

    def _stiffness_of_springs(self, stiffness: float, force: float) -> Array:
        """Stiffness of anchored springs, or of tangent springs on loose motions; added to E_q."""
        anchored = self.springs.present
        if anchored is not None:
            strain = self.motions_since(anchored.places)
            by_motions = block_diag(*map(by_further_motion, strain, self.scales[:, -1]))
            return anchored.of_motions.reshape(-1, 1) * by_motions
        pairs = zip(self.movers, self.residual(), strict=True)
        return block_diag(*(mover.tangent_spring(r, stiffness, force) for mover, r in pairs))

    def describe(self, force: float) -> list[str]:
        """Descriptions of loose motions driven by forces (collective).

        Args:
            force: Size of all forces [stress length].
        """
        found = []
        for obstacle, residual in zip(self.on_contacts, self.residual(), strict=False):
            loose = obstacle.loose()
            drive = loose @ residual
            if np.linalg.norm(drive) > SUM_ROUNDING * force:
                found.append(f"{obstacle.name} can {obstacle.describe(drive @ loose)}")
        return found

    # Before and after a solve

    def follow(self, evaluate: Callable[[], object]) -> None:
        """Move driven obstacles with prescribed motions, such that nodes stick (collective).

        Without these moves all nodes would slide by an undetermined distance. Remote loads stay.

        Args:
            evaluate: Function that evaluates the operators at the present state, not the active
                sets.
        """
        if not self.driven_obstacles.any():
            return
        evaluate()
        for obstacle, motion in [(each, each.follow()) for each in self.on_contacts]:
            obstacle.move(motion)

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
        moved, least = dict[str, None](), RIGID.sliver * self.shortest_facet
        for _ in range(RIGID.max_moves):
            evaluate()
            moves = [(each, each.next_move(least)) for each in self.on_contacts]
            moves = [(obstacle, move) for obstacle, move in moves if move.any()]
            if not moves:
                self._start = self.places
                return [f"{name} was moved until contact stopped it" for name in moved]
            for obstacle, move in moves:
                obstacle.move(move)
                moved[obstacle.name] = None
        free, move = moves[0]
        raise errors.MortarError(
            f"{free.name} can {free.describe(move)} freely: its push drives it, and no contact "
            "stops it; prescribe that motion by move()"
        )

    def slide_along_driven(self) -> float:
        """Largest slide of obstacles along driven motions, over their contact width [1] (local).

        In the last solve; zero for obstacles with a node that sticks or has no friction.
        """
        motions = np.where(self.driven, self.motions_since(self._start), 0.0)
        pairs = zip(self.on_contacts, motions, strict=False)
        return max((obstacle.slide(motion) for obstacle, motion in pairs), default=0.0)
