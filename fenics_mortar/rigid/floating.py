# SPDX-License-Identifier: MIT
"""Bodies that their Dirichlet conditions leave free: contact alone holds them.

Before a solve a body that loads drive where active contact does not hold it is moved rigidly until
contact stops it: each move is the one closest to the drive that opens no node more than a little
beyond touching, a quadratic program in the few rigid motions.

While Newton iterates, a spring in the tangent keeps what active contact leaves loose. Its stiffness
is in proportion to what drives these motions, so it vanishes at equilibrium (Levenberg-Marquardt).
The residual knows no spring: a converged state holds neither its force nor its energy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from fenics_mortar.bulk.bodies import (
    FloatingBody,
    centre_and_size,
    find_floating_bodies,
    join_bodies,
    label_bodies,
    resistance,
)
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.directions import gap_rate, opening_rate, slip_rate
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.mesh.data import MeshData
from fenics_mortar.newton.loop import NewtonReport
from fenics_mortar.rigid.holding import Touching, unresisted_motion
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, NotConvergedError, place

# Active contact holds a motion if it closes or opens gaps by more than this part of it.
HELD = 1e-3
# Least stiffness of the spring against a rigid motion over the largest diagonal entry of K: enough
# for a regular matrix.
LEAST_SPRING = 1e-6
# A resultant is rounding below the first part of the forces, or the second of stiffness and size.
UNDRIVEN, NOISE = 1e-12, 1e-13
# A body moves until a node overlaps by this part of its length, so that it is active then.
TOUCH = 0.01
# Largest rigid motion in one move over the size of the body: gaps are linear in less than that.
LARGEST_MOVE = 0.2
MOST_MOVES = 200
# So many moves in a row below TOUCH of the shortest facet: contact has stopped the bodies but for a
# creep to where they rest, as of a disk in a ring, which Newton's method does better.
CREEPING = 10
# A body is driven if the loads' resultant is above this part of the sum of their sizes; one that
# springs have held, above the second.
DRIVEN, DRIVEN_HELD = 1e-6, 0.005
# Averaged normals of facets err by about this part of the forces.
FACETS_ERR = 0.05
# A node is loaded if its pressure is above this part of the stiffness there.
LOADED = 1e-12
# A rigid motion below this part of the body's size is rounding.
ROUNDING = 1e-6


class FloatingBodies:
    """What holds the floating bodies of a problem; all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts, bound to the same space.

    Attributes:
        labels: Body of each local node, ghosts included. Tied ones are one body.
        bodies: The floating ones, once they have been looked for.
        touched: The active sets of the contacts, ties left out, where ``settle`` began.
    """

    def __init__(self, bulk: Bulk, contacts: Sequence[Contact | Tie]) -> None:
        self._bulk = bulk
        self._contacts = [contact for contact in contacts if not isinstance(contact, Tie)]
        self._data: list[MeshData] = [contact.pair.data for contact in contacts]
        self._surface_labels: dict[int, Array] = {}
        self.labels, count = label_bodies(bulk.V)
        links = [self._links(tie) for tie in contacts if isinstance(tie, Tie)]
        self.labels, self._num_bodies = join_bodies(self.labels, count, links)
        self._surface_labels.clear()  # those of bodies before ties joined them
        self.bodies: list[FloatingBody] = []
        self._unloaded: list[FloatingBody] = []
        self._start: Array = bulk.u.x.array
        self.touched: list[npt.NDArray[np.bool_]] = []
        self._springs: Array | None = None
        self._anchor: Array = bulk.u.x.array

    def _links(self, tie: Tie) -> Indices:
        """Pairs of bodies that a tie joins."""
        slave, master = self.labels_of(tie.slave), self.labels_of(tie.master)
        nodes = tie.M.tocoo()
        return np.stack([slave[nodes.row], master[nodes.col]], axis=1).astype(np.int64)

    def find(self) -> None:
        """Look for floating bodies, with ``K`` as assembled."""
        self.bodies = find_floating_bodies(self._bulk, self.labels, self._num_bodies)

    def settle(self, evaluate: Callable[[], tuple[Array, Array]]) -> list[str]:
        """Move the bodies that contact cannot hold rigidly, until it can; see ``holding``.

        Args:
            evaluate: Evaluates the contacts at the present state; returns the forces of the bulk
                and those of contact (owned parts).

        Returns:
            Which bodies were moved, in words.

        Raises:
            NotConvergedError: On all ranks, if nothing stops a body.
        """
        if not self.bodies:
            return []
        self._unloaded = [body for body in self.bodies if not self._is_loaded(body)]
        moved, creeping, extent = dict[int, float](), 0, self._extent()
        for number in range(MOST_MOVES):
            forces = evaluate()
            if number == 0:
                self.touched = [contact.active.copy() for contact in self._contacts]
            driven, moves = self._next_moves(*forces, begun=number > 0)
            creeping = creeping + 1 if self._creep(driven, moves) else 0
            if not driven or creeping > CREEPING:
                self._start = self._bulk.u.x.array.copy()
                names = sorted(self.name_of(label) for label in sorted(moved))
                return [f"{name} was moved rigidly until contact stopped it" for name in names]
            for body, move in zip(driven, moves, strict=True):
                self._move(body, move)
                way = float(np.linalg.norm(move @ body.motions))
                moved[body.label] = moved.get(body.label, 0.0) + way
            ways = [moved[body.label] for body in driven]
            if all(map(self._is_gone, driven, moves, ways, [extent] * len(ways))):
                break
        words = (
            f"{self.name_of(driven[0].label)} can {driven[0].describe(moves[0])} freely: loads "
            "drive it, and neither Dirichlet conditions nor contact stop it"
        )
        raise NotConvergedError(words, NewtonReport(reason=words))

    @property
    def held_by_contact(self) -> bool:
        """Whether active contact loads and holds all of them."""
        return all(map(self._is_loaded, self.bodies)) and not self.loose()

    def loose(self, *, sticking: bool = True) -> list[FloatingBody]:
        """The bodies with the motions that active contact does not hold either.

        Args:
            sticking: Whether sticking nodes hold a body, too.
        """
        found = []
        for body in self.bodies:
            contacts = self._contacts_of(body)
            held = [self._closing(c, body)[:, c.active] for c in contacts]
            if sticking:
                rubbing = [c for c in contacts if c.sticking.any()]
                held += [self._slipping(c, body)[:, c.sticking] for c in rubbing]
            none = np.zeros((len(body.motions), 0))
            norms, combinations = resistance(np.hstack([none, *held]), MPI.COMM_SELF)
            free = combinations[norms <= HELD]
            if len(free):
                found.append(replace(body, motions=free @ body.motions))
        return found

    def add_springs(self, loose: Sequence[FloatingBody], total: Array, force: float) -> None:
        """Add springs to the diagonal of ``K``, which keep a step where the forces would strain to.

        A body that is not loose gets a weak one: what holds each node may not hold them together,
        as with polygons that turn in one another.

        Args:
            loose: What ``loose`` found.
            total: Sum of all forces (owned part).
            force: Size of the forces.
        """
        if not self.bodies:
            return
        springs = self._springs
        if springs is None:
            stiffness = {body.label: LEAST_SPRING * body.stiffest for body in self.bodies}
            for body in loose:
                drive = float(np.linalg.norm(self._resultant(body, total))) / max(force, 1e-300)
                stiffness[body.label] = float(np.clip(drive, LEAST_SPRING, 1.0)) * body.stiffest
            springs = self._spread(stiffness)
        self._bulk.add_to_diagonal(springs)

    def hold(self, total: Array, travel: float) -> None:
        """Tie the bodies to where they are by springs of their own; see ``release``.

        Args:
            total: Sum of all forces (owned part).
            travel: How far the forces that drive a body, or what facets may err of all on it, would
                strain its springs, in shortest facets.
        """
        length = travel * self._shortest_facet()
        stiffness = {}
        for body in self.bodies:
            drive = float(np.linalg.norm(self._resultant(body, total)))
            drive = max(drive, FACETS_ERR * self._contact_force(body))
            stiffness[body.label] = max(drive / length, LEAST_SPRING * body.stiffest)
        self._springs, self._anchor = self._spread(stiffness), self._bulk.u.x.array.copy()

    def stiff_travel(self, total: Array) -> float:
        """The ``travel`` at which springs of ``hold`` are as stiff as the bodies."""
        least = [float(np.linalg.norm(self._resultant(b, total))) / b.stiffest for b in self.bodies]
        return max(least, default=0.0) / self._shortest_facet()

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

    @property
    def held(self) -> bool:
        """Whether springs of ``hold`` are there."""
        return self._springs is not None

    def add_spring_forces(self) -> None:
        """Add what the springs of ``hold`` pull with to the residual."""
        if self._springs is not None:
            self._bulk.r.array[: self._bulk.num_owned] += self._spring_forces()

    def _spring_forces(self) -> Array:
        none = np.zeros(self._bulk.num_owned)
        return none if self._springs is None else self._springs * self._strain()

    def _strain(self) -> Array:
        """Displacement since ``hold`` (owned part)."""
        return (self._bulk.u.x.array - self._anchor)[: self._bulk.num_owned]

    def parts_held(self) -> list[tuple[str, float]]:
        """Name and force of springs over the contact force on it, of each body that has some."""
        held = self.bodies if self.held else []
        return [(self.name_of(body.label), self._part_held(body)) for body in held]

    def _part_held(self, body: FloatingBody) -> float:
        force = np.linalg.norm(self._resultant(body, self._spring_forces()))
        return float(force) / max(self._contact_force(body), 1e-300)

    def _contact_force(self, body: FloatingBody) -> float:
        """Integral of the size of the pressure over all pairs of a body [stress length]."""
        total = 0.0
        for contact in self._contacts:
            on_slave = self.labels_of(contact.slave) == body.label
            on_master = bool((self.labels_of(contact.master) == body.label).any())
            forces = contact.operators.cover * np.abs(contact.pressure)
            total += float(forces[on_slave | on_master].sum())
        return total

    def spring_energy(self) -> float:
        """Energy in the springs of ``hold`` [stress length^2]."""
        return 0.5 * self._bulk.comm.allreduce(float(self._strain() @ self._spring_forces()))

    def travel(self) -> float:
        """How far a body has moved as a rigid one since ``hold``, in shortest facets."""
        change = self._strain()
        moves = [np.linalg.norm(self._rigid_part(body, change)) for body in self.bodies]
        return float(max(moves, default=0.0)) / self._shortest_facet()

    def _spread(self, stiffness: dict[int, float]) -> Array:
        """Stiffness of the springs at the owned dofs from that of each body."""
        springs = np.zeros(self._bulk.num_owned)
        for body in self.bodies:
            springs[self._dofs_of(body)] = stiffness[body.label] / body.num_nodes
        return springs

    def drop_undriven(
        self, loose: Sequence[FloatingBody], step: PETSc.Vec, total: Array, force: float
    ) -> None:
        """Take the loose motions that only rounding drives out of a step.

        Args:
            loose: What ``loose`` found.
            step: Increment of the displacement; changed.
            total: Sum of all forces (owned part).
            force: Size of the forces.
        """
        for body in loose if self._springs is None else []:
            drive = float(np.linalg.norm(self._resultant(body, total)))
            if drive <= UNDRIVEN * force + NOISE * body.stiffest * body.size:
                dofs, motions = self._motions(body)
                excess = self._rigid_part(body, step.array_r) @ motions
                step.array[dofs] -= excess.reshape(-1, 2)

    def check(self) -> list[str]:
        """What became of bodies that had no contact force before the solve and have none now.

        Returns:
            Which of them contact pushed along, towards something that may stop them.

        Raises:
            MortarError: On all ranks, if nothing is there to stop a body that gave way.
        """
        notes = []
        for body in self._unloaded:
            change = (self._bulk.u.x.array - self._start)[: self._bulk.num_owned]
            motion = self._rigid_part(body, change)
            if np.linalg.norm(motion) <= ROUNDING * body.size or self._is_loaded(body):
                continue
            if not any(self._is_ahead(contact, body, motion) for contact in self._contacts):
                raise MortarError(
                    f"{self.name_of(body.label)} can {body.describe(motion)} freely: pushed "
                    "by contact it gave way, since its Dirichlet conditions do not hold it"
                )
            notes.append(f"{self.name_of(body.label)} was pushed along by contact without a force")
        return notes

    def _is_ahead(self, contact: Contact, body: FloatingBody, motion: Array) -> bool:
        """Whether a motion of the body closes a gap: it opens those towards what pushes it."""
        closing = motion @ self._closing(contact, body)
        return bool((closing > HELD * np.linalg.norm(motion)).any())

    def describe(self, loose: Sequence[FloatingBody]) -> str:
        """The loose bodies and how they can move, in words."""
        return ", ".join(
            f"{self.name_of(body.label)} can {body.describe(motion)}"
            for body in loose
            for motion in np.eye(len(body.motions))
        )

    def names(self, bodies: Sequence[FloatingBody]) -> str:
        """Names of bodies in words."""
        return " and ".join(sorted({self.name_of(body.label) for body in bodies}))

    def remark(self, loose: Sequence[FloatingBody]) -> str:
        """What is done about the loose bodies, in words."""
        names = self.names(loose)
        return (
            f"a spring in the tangent keeps {names}, which contact holds in part" if names else ""
        )

    def name_of(self, label: int, labels: Indices | None = None) -> str:
        """Name of a body from the cell tags, or where it is; ``labels``: other ones than these."""
        bulk, labels = self._bulk, self.labels if labels is None else labels
        first = compat.dofmap(bulk.V)[:, 0]
        for data in self._data:
            if data.cell_tags is None:
                continue
            for name, tag in data.bodies.items():
                found = labels[first[data.cell_tags.find(tag)]] == label
                if bulk.comm.allreduce(bool(found.any()), MPI.LOR):
                    return f"body '{name}'"
        X = bulk.V.tabulate_dof_coordinates()[: bulk.space.num_nodes, :2]
        mine = labels[: len(X)] == label
        return f"the body around {place(centre_and_size(X[mine], bulk.comm)[0])}"

    def _next_moves(
        self, bulk: Array, contact: Array, *, begun: bool
    ) -> tuple[list[FloatingBody], list[Array]]:
        """The bodies that move, and the coefficients of their motions.

        A body that carries contact force moves only as active contact lets it. Without friction and
        adhesion a facet holds a body that stands for a round one, which would roll on: there limit
        analysis decides only on bodies that touch before they have moved or borne anything.
        """
        total, sizes = bulk + contact, np.abs(bulk) + np.abs(contact)
        unloaded = [body for body in self.bodies if not self._is_loaded(body)]
        labels = {body.label for body in unloaded}
        loose = [b for b in self.loose(sticking=False) if b.label not in labels]
        driven = [(body, self._drive(body, total, sizes)) for body in (*unloaded, *loose)]
        driven = [(body, drive) for body, drive in driven if drive.any()]
        if not driven:
            return [], []
        laws = [contact.pair.law for contact in self._contacts]
        if any(law.has_friction or law.has_adhesion for law in laws):
            asked = {body.label for body, _ in driven}
        else:
            asked = set() if begun else labels
        if asked:
            gone = self._not_held(bulk) | {body.label for body in self.bodies} - asked
            driven = [(body, drive) for body, drive in driven if body.label in gone]
        if not driven:
            return [], []
        wanted = np.concatenate([LARGEST_MOVE * body.size * drive for body, drive in driven])
        closing = [np.empty((0, wanted.size))] + [
            np.vstack([self._closing(contact, body) for body, _ in driven]).T
            for contact in self._contacts
        ]
        room = [np.empty(0)] + [
            np.maximum(np.nan_to_num(contact.gap) + TOUCH * contact.nodal_lengths, 0.0)
            for contact in self._contacts
        ]
        move = closest_below(wanted, np.concatenate(closing), np.concatenate(room))
        moves = np.split(move, np.cumsum([len(body.motions) for body, _ in driven])[:-1])
        moving = [
            (body, move)
            for (body, _), move in zip(driven, moves, strict=True)
            if np.linalg.norm(move) > TOUCH**2 * self._shortest_facet()
        ]
        return [body for body, _ in moving], [move for _, move in moving]

    def _not_held(self, bulk: Array) -> set[int]:
        """Labels of the bodies that no contact force within the laws' bounds can hold.

        Args:
            bulk: Forces of the bulk, minus the loads (owned part).
        """
        loads = np.concatenate([self._resultant(body, bulk) for body in self.bodies])
        size = float(np.abs(loads).sum())
        weight = sum(float(c.operators.weight[c.active].sum()) for c in self._contacts)
        pressure = size / weight if weight > 0.0 else 0.0
        if not self._contacts:
            return {body.label for body in self.bodies}
        parts = [self._touching(contact, pressure) for contact in self._contacts]
        motion = unresisted_motion(loads, Touching(*map(np.concatenate, zip(*parts, strict=True))))
        ends = np.cumsum([len(body.motions) for body in self.bodies])[:-1]
        moves = zip(self.bodies, np.split(motion, ends), strict=True)
        return {body.label for body, move in moves if np.abs(move).max() > HELD}

    def _touching(self, contact: Contact, pressure: float) -> Touching:
        """The active nodes of a pair as the floating bodies meet there; a typical pressure."""
        on, weight = contact.active, contact.operators.weight
        opening = [
            self._responses(contact, body, partial(opening_rate, contact.now))
            for body in self.bodies
        ]
        slip = [self._slipping(contact, body) for body in self.bodies]
        slope, shear, adhesion = contact.now.strength(pressure)
        return Touching(
            np.concatenate(opening).T[on],
            np.concatenate(slip).T[on],
            slope[on],
            (weight * shear)[on],
            (weight * adhesion)[on],
        )

    def _extent(self) -> float:
        """Diagonal of the box around all bodies [length] (collective)."""
        x, comm = self._bulk.positions()[: self._bulk.space.num_nodes], self._bulk.comm
        low = comm.allreduce(x.min(axis=0, initial=np.inf), np.minimum)
        high = comm.allreduce(x.max(axis=0, initial=-np.inf), np.maximum)
        return float(np.hypot(*(high - low)))

    def _is_gone(self, body: FloatingBody, move: Array, way: float, extent: float) -> bool:
        """Whether a body has moved past all others, and is not on its way to an obstacle."""
        if way <= extent:
            return False
        return not any(self._is_ahead(contact, body, move) for contact in self._contacts_of(body))

    def _creep(self, driven: list[FloatingBody], moves: list[Array]) -> bool:
        """Whether no body moves by more than it may overlap."""
        each = zip(driven, moves, strict=True)
        lengths = [float(np.linalg.norm(move @ body.motions)) for body, move in each]
        return max(lengths, default=0.0) <= TOUCH * self._shortest_facet()

    def _drive(self, body: FloatingBody, total: Array, sizes: Array) -> Array:
        """Direction in which the forces drive the body, of size one; zero if they do not."""
        drive = self._resultant(body, total)
        size = self._bulk.comm.allreduce(float(sizes[self._dofs_of(body)].sum()))
        norm = float(np.linalg.norm(drive))
        least = (DRIVEN_HELD if self.held else DRIVEN) * size
        return drive / norm if norm > least else np.zeros(len(drive))

    def _resultant(self, body: FloatingBody, total: Array) -> Array:
        """Resultant of the forces along the body's motions, shape (motions,)."""
        dofs, motions = self._motions(body)
        return self._bulk.comm.allreduce(-motions @ total[dofs].ravel())

    def _move(self, body: FloatingBody, coefficients: Array) -> None:
        """Add a rigid motion; its rotation is a true one, so nothing is strained."""
        x, y, turn = coefficients @ body.motions
        angle = turn / body.size
        mine = np.flatnonzero(self.labels == body.label)
        arm = self._bulk.positions()[mine] - body.centre
        cosine, sine = np.cos(angle) - 1.0, np.sin(angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        self._bulk.u.x.array[self._bulk.space.dofs[mine]] += arm @ turn.T + np.array([x, y])

    def _motions(self, body: FloatingBody) -> tuple[Indices, Array]:
        """Dofs (nodes, 2) of a body's owned nodes, and its motions there, (motions, 2 * nodes)."""
        x = self._bulk.positions()[: self._bulk.space.num_nodes][self._nodes_of(body)]
        return self._dofs_of(body), body.displacement(x).reshape(len(body.motions), -1)

    def _nodes_of(self, body: FloatingBody) -> npt.NDArray[np.bool_]:
        """Which of the owned nodes are of a body."""
        return self.labels[: self._bulk.space.num_nodes] == body.label

    def _dofs_of(self, body: FloatingBody) -> Indices:
        """Local dofs of the owned nodes of a body, shape (nodes, 2)."""
        return self._bulk.space.owned_dofs[self._nodes_of(body)]

    def _rigid_part(self, body: FloatingBody, change: Array) -> Array:
        """Coefficients of the body's motions in a displacement (owned part), shape (motions,)."""
        dofs, motions = self._motions(body)
        answer = motions @ change[dofs].ravel()
        products = self._bulk.comm.allreduce(np.column_stack([motions @ motions.T, answer]))
        return np.linalg.solve(products[:, :-1], products[:, -1])

    def _closing(self, contact: Contact, body: FloatingBody) -> Array:
        """Change of the mean gaps by the free motions, closing positive: (motions, slave nodes)."""
        return -self._responses(contact, body, partial(gap_rate, contact.now))

    def _slipping(self, contact: Contact, body: FloatingBody) -> Array:
        """Slip of the nodes by the free motions, shape (motions, slave nodes)."""
        return self._responses(contact, body, partial(slip_rate, contact.now))

    def _contacts_of(self, body: FloatingBody) -> list[Contact]:
        """The pairs that a body takes part in."""
        return [
            contact
            for contact in self._contacts
            if (self.labels_of(contact.slave) == body.label).any()
            or (self.labels_of(contact.master) == body.label).any()
        ]

    def _responses(
        self, contact: Contact, body: FloatingBody, response: Callable[[Array, Array], Array]
    ) -> Array:
        """Response of a pair to each free motion of a body, shape (motions, slave nodes).

        Args:
            contact: The pair.
            body: The body.
            response: That to displacements of slave and master nodes.
        """
        found = np.zeros((len(body.motions), contact.slave.num_nodes))
        o = contact.operators
        sides = (contact.slave, o.x), (contact.master, o.m)
        mine = [self.labels_of(surface) == body.label for surface, _ in sides]
        if any(side.any() for side in mine):
            on_slave, on_master = (
                body.displacement(x) * on[:, None] for on, (_, x) in zip(mine, sides, strict=True)
            )
            for i, motion in enumerate(zip(on_slave, on_master, strict=True)):
                found[i] = response(*motion)
        return found

    def _is_loaded(self, body: FloatingBody) -> bool:
        """Whether any contact force acts on a body."""
        for contact in self._contacts_of(body):
            loaded = np.abs(contact.pressure) > LOADED * contact.stiffness
            on_slave = self.labels_of(contact.slave) == body.label
            on_master = bool((self.labels_of(contact.master) == body.label).any())
            if (loaded & (on_slave | on_master)).any():
                return True
        return False

    def _shortest_facet(self) -> float:
        sizes = [float(contact.slave.lengths.min()) for contact in self._contacts]
        return min(sizes or [body.size for body in self.bodies])

    def labels_of(self, surface: Surface) -> Array:
        """Bodies of the nodes of a surface, shape (nodes,) (collective the first time)."""
        if id(surface) not in self._surface_labels:
            self._surface_labels[id(surface)] = surface.gather(
                self._bulk.space.spread(self.labels)
            )[:, 0]
        return self._surface_labels[id(surface)]


def closest_below(wanted: Array, rows: Array, room: Array) -> Array:
    """The vector closest to ``wanted`` with ``rows @ vector <= room``, where ``room >= 0``.

    A least-distance problem, solved by nonnegative least squares (Lawson & Hanson 1974, ch. 23).

    Args:
        wanted: Shape (n,).
        rows: Shape (m, n).
        room: Shape (m,).
    """
    excess = rows @ wanted - room
    if not (excess > 0.0).any():
        return wanted
    system = np.vstack([-rows.T, excess])
    target = np.zeros(wanted.size + 1)
    target[-1] = 1.0
    multipliers, _ = nnls(system, target)
    *change, last = system @ multipliers - target
    return wanted - np.array(change) / last
