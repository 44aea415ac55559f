# SPDX-License-Identifier: MIT
"""Floating bodies of a problem, their rigid motions and the forces along them.

``BodyMotions`` finds the bodies, each a ``BoundBody``. Functions yield the response of contacts to
their motions: rates of gaps and slips, and the motions that bonds leave to them (collective).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk import bodies as bulk_bodies
from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields, normal_parts
from fenics_mortar.contact.law import KINK
from fenics_mortar.contact.rows import adhesion_at_gap, change_along, strength
from fenics_mortar.obstacles.rigid_motion import RIGID, TURNS, RigidMotion, rotation_less_one
from fenics_mortar.rigid.complementarity import nearly_touching
from fenics_mortar.rigid.proximal import unresisted
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, SOLVED, SUM_ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.errors import NotFiniteError, format_point
from fenics_mortar.utils.ranks import any_over_ranks, largest_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.bulk.bodies import RemoteLoad
    from fenics_mortar.contact.tied import Tie
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.mesh.data import MeshData


@dataclass(frozen=True)
class BoundBody(bulk_bodies.FloatingBody):
    """A floating body in a problem, with its contacts and loads; all methods are collective.

    Attributes:
        among: All bodies of the problem.
    """

    among: BodyMotions = field(kw_only=True, repr=False)

    @property
    def name(self) -> str:
        """Its name, see ``BodyMotions.name_of``."""
        return self.among.name_of(self.label)

    # Motions

    @property
    def _nodes(self) -> Flags:
        """Whether an owned node belongs to the body."""
        return self.among.labels[: self.among.bulk.space.num_nodes] == self.label

    @property
    def dofs(self) -> Indices:
        """Local dofs of its owned nodes, shape (nodes, dim)."""
        return self.among.bulk.space.owned_dofs[self._nodes]

    def displacement(self, X: Array, parts: Indices) -> Array:
        """Free motions at points (n, dim) of parts (n,), shape (motions, n, dim) [1] (local).

        Zero in parts of other bodies, and in no part, -1.
        """
        mine = (parts >= 0) & (self.among.body_of[parts] == self.label)
        return super().displacement(X, parts) * mine[:, None]

    def nodal_motions(self) -> Array:
        """Its motions at ``dofs``, shape (motions, dim nodes) [1]."""
        mine = np.flatnonzero(self._nodes)
        moved = self.displacement(self.among.positions()[mine], self.among.parts[mine])
        return moved.reshape(len(self.motions), -1)

    def move(self, coefficients: Array) -> None:
        """Add a rigid motion without strain; its rotation is finite unless the bulk is linear.

        Args:
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        bulk, mine = self.among.bulk, np.flatnonzero(self.among.labels == self.label)
        x = self.among.positions()[mine]
        moved = np.tensordot(coefficients, self.displacement(x, self.among.parts[mine]), 1)
        if not bulk.is_linear:
            axes = TURNS[len(self.centre)]
            angles = (coefficients @ self.motions)[len(self.centre) :][: len(axes)] / self.size
            beyond_linear = rotation_less_one(angles) - np.tensordot(angles, axes, 1)
            moved += (x - self.centre) @ beyond_linear.T
        bulk.u.x.array[bulk.space.dofs[mine]] += moved
        self.move_loads(coefficients)

    def rigid_fraction(self, change: Array) -> Array:
        """Rigid part of ``change`` (owned dofs,), shape (motions,) [length]."""
        motions = self.nodal_motions()
        lower = self.factor(motions)
        products = self.among.bulk.comm.allreduce(motions @ change[self.dofs].ravel())
        return np.linalg.solve(lower.T, np.linalg.solve(lower, products))

    def factor(self, motions: Array) -> Array:
        """Cholesky's factor [1] of the products of its ``nodal_motions``.

        Raises:
            NotFiniteError: On all ranks, if the motions are dependent to rounding: an iteration has
                thrown the body so far away that its turns are lost beside its distance.
        """
        try:
            return np.linalg.cholesky(self.among.bulk.comm.allreduce(motions @ motions.T))
        except np.linalg.LinAlgError:
            raise NotFiniteError(f"{self.name} is far away from its place at the start") from None

    def loose(self, *, sticking: bool = True, rough: bool = False) -> Array:
        """Its motions that active contact does not resist, orthonormal (n, motions) [1].

        Args:
            sticking: Whether sticking nodes resist slip.
            rough: Whether all active nodes count as sticking.
        """
        count, contacts = len(self.motions), self.contacts
        responses = [closing(contact, self)[:, contact.active] for contact in contacts]
        for contact in contacts if sticking else ():
            sticks = contact.active if rough else contact.sticking
            if sticks.any():
                responses.append(slipping(contact, self)[:, sticks].reshape(count, -1))
        found = np.hstack([np.zeros((count, 0)), *responses])
        known = np.isfinite(found).all(axis=0)  # not at folded facets of a failed iteration
        return unresisted(found[:, known])

    # Remote loads

    def _loads(self) -> list[tuple[RemoteLoad, Array]]:
        """Its remote loads, and their motions due to those of the body, (motions, 3) [1]."""
        loads = [*self.among.boundaries_at(self.label), *((s.load, -1) for s in self.sections)]
        return [(load, load.motions_by(self, part)) for load, part in loads]

    def restricted(self) -> BoundBody:
        """The body with the motions that its remote loads do not prescribe (local)."""
        prescribed = [rates[:, ~load.driven] for load, rates in self._loads()]
        return self.without(np.hstack(prescribed)) if prescribed else self

    def move_loads(self, coefficients: Array) -> None:
        """Move its remote loads along with it, in driven motions (local).

        Args:
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        for load, rates in self._loads():
            load.move(np.where(load.driven, coefficients @ rates, 0.0))

    def subtract(self, coefficients: Array, step: Array, motion: Array) -> None:
        """Subtract a rigid motion from increments (local).

        Args:
            coefficients: Factors of its motions, shape (motions,) [length].
            step: Increment of the displacement, shape (owned dofs,) [length]; changed.
            motion: Increments of motions of obstacles and remote loads, (m, 3) [length]; changed.
                Empty if all are prescribed.
        """
        dofs = self.dofs
        step[dofs] -= (coefficients @ self.nodal_motions()).reshape(dofs.shape)
        for load, rates in self._loads() if motion.size else ():
            remote = self.among.remote
            motion[remote.index(load) - len(remote)] -= coefficients @ rates

    # Forces

    def resultant(self, total: Array) -> Array:
        """Resultant of ``total`` (owned dofs,) along motions, (motions,) [stress length]."""
        return self.among.bulk.comm.allreduce(-self.nodal_motions() @ total[self.dofs].ravel())

    @property
    def contacts(self) -> list[Contact]:
        """Its contacts."""
        return [contact for contact in self.among.contacts if self.at(contact).any()]

    def at(self, contact: Contact) -> Flags:
        """Whether the force of a slave node may act on the body, shape (slave nodes,).

        A force acts on the body of the slave node and on the bodies of its partners.
        """
        on_slave, on_master = (
            self.among.labels_of(side) == self.label for side in (contact.slave, contact.master)
        )
        if on_master.all() or not on_master.any():
            return on_slave | bool(on_master.any())
        segments, faces = contact.operators.segments, np.zeros(len(on_slave), bool)
        faces[segments.slave[on_master[segments.master].any(axis=1)]] = True
        return on_slave | any_over_ranks(self.among.bulk.comm, faces)

    def contact_force(self) -> float:
        """Integral of |pressure| over its contacts [stress length]."""
        return sum(
            float((c.operators.cover * np.abs(c.pressure))[self.at(c)].sum())
            for c in self.among.contacts
        )

    def is_loaded(self, before: float = 0.0) -> bool:
        """Whether a contact force acts on it that is not rounding of those in the assembly.

        Args:
            before: Largest multiplier at the body at the start of the solve [stress]; forces that
                have become small compared with it have no limit but zero.
        """
        largest = largest_multiplier(c.z for c in self.among.contacts)
        rounding = max(SOLVED * before, ROUNDING * largest)
        return any(
            (np.abs(c.z).max(axis=1) > np.maximum(SUM_ROUNDING * c.modulus, rounding))[
                self.at(c)
            ].any()
            for c in self.among.contacts
        )

    def rounding(self, force: float) -> float:
        """Rounding of the resultant on the body [stress length].

        Args:
            force: Size of all forces of the assembly [stress length].
        """
        bulk = self.among.bulk
        largest = max(self.size, bulk.largest(bulk.values))
        return SUM_ROUNDING * force + RIGID.stiffness_rounding * self.stiffest * largest


def largest_multiplier(z: Iterable[Array]) -> float:
    """Largest component of multipliers, (n, c) each [stress] (local)."""
    return max((float(np.abs(values).max(initial=0.0)) for values in z), default=0.0)


class BodyMotions:
    """Bodies that Dirichlet conditions do not fix, and their motions; all methods are collective.

    Remote loads support bodies, except for motions that pushes leave free: a body may float along
    the driven motions of its rigid boundaries; sides of a section whose force is given may float
    along its axis. The places of boundaries and sections follow the motion of the body.

    Args:
        bulk: The bodies.
        contacts: The contacts and ties, bound to the same space.
        boundaries: The rigid boundaries with their local nodes, shape (k,) each.
        sections: The loads of the sections under pretension, by the ties of these.

    Attributes:
        bulk: The bodies.
        contacts: The contacts without ties.
        remote: Both of them, the remote loads with motions.
        prescribed_otherwise: Marks of the dofs with Dirichlet conditions other than those of rigid
            boundaries, (local dofs,).
        labels: Body of each local node, including ghosts, (local nodes,); bodies that are tied,
            also by sections under pretension, or have a rigid boundary in common are one.
        parts, num_parts: As ``labels`` without joining, and their number.
        body_of: Body of each part, (parts,).
        leaders: Motions of rigid boundaries by the parts that these lead.
        num_bodies: Number of bodies.
        bodies: The floating bodies, after ``find`` and ``restrict``.
        aside: Labels of idle bodies that are set aside at present, see ``idle``.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie],
        boundaries: Sequence[tuple[RemoteLoad, Indices]], sections: Mapping[Tie, RemoteLoad],
    ) -> None:  # fmt: skip
        self.bulk, self.remote = bulk, [*(load for load, _ in boundaries), *sections.values()]
        conditions = [bc for bc in bulk.bcs if bc not in self.remote]
        self.prescribed_otherwise: Flags = mark_prescribed(bulk.space, bulk.u, conditions)
        self.contacts = [contact for contact in contacts if isinstance(contact, Contact)]
        self._data: list[MeshData] = [contact.pair.data for contact in contacts]
        self._surface_parts: dict[int, Indices] = {}
        self.parts, self.num_parts = bulk_bodies.label_bodies(bulk.V)
        ties = [tie for tie in contacts if not isinstance(tie, Contact)]
        tied = [(tie.M, self.parts_of(tie.slave), self.parts_of(tie.master)) for tie in ties]
        at_boundaries = [(load, self._parts_at(nodes)) for load, nodes in boundaries]
        self._boundaries = [(load, int(parts[0])) for load, parts in at_boundaries]
        links = [pairs_joined(*each) for each in tied]
        links += [np.stack([some[:-1], some[1:]], axis=1) for _, some in at_boundaries]
        self.body_of, self.num_bodies = bulk_bodies.join_bodies(self.num_parts, links)
        self.labels = self.body_of[self.parts]
        self._sections = self._separating(sections, ties, links)
        self._periodic = [  # bodies, and the translations of periodic ties
            (int(self.labels_of(tie.slave)[0]), tie.pair.translation)
            for tie in ties
            if tie.pair.translation.any()
        ]
        self.leaders: dict[int, RigidMotion] = {
            part: at[0][0].motion
            for part, label in enumerate(self.body_of.tolist())
            if (at := self.boundaries_at(label))
        }
        if self.leaders:
            for contact in self.contacts:
                sides = self.parts_of(contact.slave), self.parts_of(contact.master)
                contact.lead_by(partial(self._turns, *sides))
        self.bodies: list[BoundBody] = []
        self._candidates: list[BoundBody] = []
        self.aside: set[int] = set()

    def _separating(
        self, sections: Mapping[Tie, RemoteLoad], ties: Sequence[Tie], links: Sequence[Indices]
    ) -> dict[int, list[bulk_bodies.PartMotion]]:
        """Sections under pretension that separate bodies, by the labels of these."""
        found: dict[int, list[bulk_bodies.PartMotion]] = {}
        for tie, load in sections.items():
            section = ties.index(tie)
            side, _ = bulk_bodies.join_bodies(
                self.num_parts, [*links[:section], *links[section + 1 :]]
            )
            slave, master = (int(self.parts_of(s)[0]) for s in (tie.slave, tie.master))
            if side[slave] != side[master]:
                motion = bulk_bodies.PartMotion(load, tie.pair.axis, side == side[slave])
                found.setdefault(int(self.body_of[slave]), []).append(motion)
        return found

    def _parts_at(self, nodes: Indices) -> Indices:
        """Parts of the mesh at local nodes (k,) of all ranks, replicated, shape (n,)."""
        found = self.bulk.comm.allgather(set(self.parts[nodes].tolist()))
        return np.array(sorted(set().union(*found)))

    def boundaries_at(self, label: int) -> list[tuple[RemoteLoad, int]]:
        """The rigid boundaries of a body, and the lowest part of the mesh at each one (local)."""
        return [(load, part) for load, part in self._boundaries if self.body_of[part] == label]

    def find(self) -> None:
        """Find floating bodies from the assembled ``K``; with inertia no body floats."""
        found: list[bulk_bodies.FloatingBody] = []
        if self.bulk.inertia is None:
            flags = self.prescribed_otherwise
            bodies = self.labels, self.num_bodies
            found = bulk_bodies.find_floating_bodies(
                self.bulk, *bodies, flags, self._sections, self.parts
            )
        for label, translation in self._periodic:
            found = [
                body if body.label != label else body.without_rotation(translation)
                for body in found
            ]
        self._candidates = [BoundBody(**vars(body), among=self) for body in found]
        self.restrict()

    def restrict(self) -> None:
        """Set ``bodies`` for the motions that rigid boundaries prescribe at present (local)."""
        restricted = [body.restricted() for body in self._candidates]
        self.bodies = [body for body in restricted if len(body.motions)]

    # Nodes

    def positions(self) -> Array:
        """Positions of the local nodes at which forces act, (local nodes, dim) [length].

        Forces of a linear bulk have no moment in the undeformed configuration.
        """
        return self.bulk.cells.X if self.bulk.is_linear else self.bulk.positions()

    def _turns(self, *sides: Indices) -> tuple[Array, ...]:
        """Turns of the leaders of nodes, nan without one, (nodes, axes) each [radian] (local)."""
        dim = self.bulk.space.dim
        turns = np.full((self.num_parts, len(TURNS[dim])), np.nan)
        for part, leader in self.leaders.items():
            turns[part] = leader.place[dim:]
        return tuple(turns[parts] for parts in sides)

    def labels_of(self, surface: Surface) -> Indices:
        """Numbers of the bodies of a surface's nodes, (nodes,) (collective the first time)."""
        return self.body_of[self.parts_of(surface)]

    def parts_of(self, surface: Surface) -> Indices:
        """Parts of the mesh of a surface's nodes, (nodes,) (collective the first time)."""
        if id(surface) not in self._surface_parts:
            parts = surface.gather(self.bulk.space.spread(self.parts))[:, 0]
            self._surface_parts[id(surface)] = parts.astype(np.int64)
        return self._surface_parts[id(surface)]

    def shortest_facet(self) -> float:
        """Shortest slave facet of all contacts; without contacts the smallest body [length]."""
        sizes = [float(contact.slave.facet_sizes.min()) for contact in self.contacts]
        return min(sizes or [body.size for body in self.bodies])

    def extent(self, x: Array) -> float:
        """Diagonal of the box around all bodies, with local nodes at ``x`` (n, dim) [length]."""
        x = x[: self.bulk.space.num_nodes]
        ends = [side.max(axis=0, initial=-np.inf) for side in (x, -x)]
        return float(np.linalg.norm(largest_over_ranks(self.bulk.comm, ends).sum(axis=0)))

    # Forces

    def repeats(self, body: bulk_bodies.FloatingBody) -> bool:
        """Whether ties make a body periodic in all directions: its place is free (local)."""
        moved = [translation for label, translation in self._periodic if label == body.label]
        return bool(moved) and bool(np.linalg.matrix_rank(moved) == self.bulk.space.dim)

    def driven_by(self, forces: Array, size: float) -> set[int]:
        """Labels of the bodies on which forces have a resultant that is not rounding.

        Args:
            forces: The forces, shape (owned dofs,) [stress length].
            size: Sum of the sizes of all forces of the assembly on this rank [stress length].
        """
        size = self.bulk.comm.allreduce(size)
        return {
            body.label
            for body in self.bodies
            if np.linalg.norm(body.resultant(forces)) > body.rounding(size)
        }

    def loose(self, *, sticking: bool = True) -> list[BoundBody]:
        """Bodies with the motions that active contact does not resist, see ``BoundBody.loose``."""
        found = [
            replace(body, motions=body.loose(sticking=sticking) @ body.motions)
            for body in self.bodies
        ]
        return [body for body in found if len(body.motions)]

    # Names

    def name_of(self, label: int, labels: Indices | None = None) -> str:
        """Name of a body from the cell tags or its position (collective).

        Args:
            label: Number of the body.
            labels: Bodies of the local nodes, shape (nodes,); those of this object by default.
        """
        bulk, labels = self.bulk, self.labels if labels is None else labels
        first = compat.dofmap(bulk.V)[:, 0]
        for data in self._data:
            if data.cell_tags is None:
                continue
            for name, tag in data.bodies.items():
                found = labels[first[data.cell_tags.find(tag)]] == label
                if bulk.comm.allreduce(bool(found.any()), MPI.LOR):
                    return f"body '{name}'"
        X = bulk.V.tabulate_dof_coordinates()[: bulk.space.num_nodes, : bulk.space.dim]
        mine = labels[: len(X)] == label
        return f"the body around {format_point(bulk_bodies.centre_and_size(X[mine], bulk.comm)[0])}"


def names_of(bodies: Iterable[BoundBody]) -> str:
    """Names of bodies as text (collective)."""
    return " and ".join(sorted({body.name for body in bodies}))


# Response of a pair to displacements of slave and master nodes.
Response = Callable[[ContactFields, Array, Array], Array]


def closing(contact: Contact, *some: BoundBody) -> Array:
    """Closing rates of the mean gaps due to rigid motions, (motions of all, slave nodes) [1]."""
    return -_responses(contact, some, gap_rate)


def slipping(contact: Contact, *some: BoundBody) -> Array:
    """Slip rates of the nodes due to rigid motions, (motions of all, slave nodes) [1].

    In space those along two tangents, (motions, slave nodes, 2).
    """
    components = () if contact.slave.dim == 2 else (contact.slave.dim - 1,)
    return _responses(contact, some, slip_rate, components)


def opening(contact: Contact, *some: BoundBody) -> Array:
    """Opening rates of the nodes along n due to rigid motions, (motions of all, nodes) [1]."""
    return _responses(contact, some, opening_rate)


def pairs_joined(M: Any, slave: Indices, master: Indices) -> Indices:
    """Parts (n,) of slave nodes and (m,) of their masters by a matrix (n, m), (k, 2) (local)."""
    nodes = M.tocoo()
    return np.stack([slave[nodes.row], master[nodes.col]], axis=1)


def by_body(bodies: Sequence[bulk_bodies.FloatingBody], values: Array) -> list[Array]:
    """The ``values`` (motions of all, ...) of each body [their unit] (local)."""
    return np.split(values, np.cumsum([len(body.motions) for body in bodies])[:-1])


def bonded_motions(some: Sequence[BoundBody]) -> list[BoundBody]:
    """Bodies with the motions that are left to them, moving together, by adhesion at closed gaps.

    A bond without friction lets its sides slide on each other; a broken one does not hold.

    Args:
        some: Those that may move; others are at rest. Bodies without such a motion are left out.
    """
    if not some:
        return []
    responses = [np.zeros((sum(len(body.motions) for body in some), 0))]
    for contact in some[0].among.contacts:
        if contact.pair.law.has_adhesion:
            on, holds = _bonds(contact)
            for rate, nodes in ((opening, on), (slipping, on & holds)):
                rates = rate(contact, *some)
                responses.append(rates[:, nodes].reshape(len(rates), -1))
    parts, moving = by_body(some, unresisted(np.hstack(responses)).T), []
    for body, part in zip(some, parts, strict=True):
        _, sizes, ways = np.linalg.svd(part.T, full_matrices=False)
        free = ways[sizes > RIGID.resisted]
        if len(free):
            moving.append(replace(body, motions=free @ body.motions))
    return moving


def _bonds(contact: Contact) -> tuple[Flags, Flags]:
    """Closed nodes with adhesion, and those whose bond resists slip, (slave nodes,) each (local).

    A bond that is partly damaged pulls as it opens.
    """
    touches = contact.active | nearly_touching(contact)
    pull = adhesion_at_gap(contact.now, KINK * contact.slave.nodal_lengths)
    slope, shear = strength(contact.now, float(pull.max(initial=0.0)))
    return touches & (pull > 0.0), contact.pair.law.bridges_gap | (slope > 0.0) | (shear > 0.0)


def _responses(
    contact: Contact, some: Sequence[BoundBody], response: Response,
    components: tuple[int, ...] = (),
) -> Array:  # fmt: skip
    """Response of a pair to each rigid motion of some bodies, (motions, slave nodes, ...).

    Args:
        contact: The pair.
        some: The bodies that move.
        response: Function of fields and displacements (motions, nodes, dim) of slave and master.
        components: Shape of the response of a node.
    """
    o, count, bodies = contact.operators, sum(len(body.motions) for body in some), some[0].among
    found = np.zeros((count, contact.slave.num_nodes, *components))
    sides = [
        (side.X if bodies.bulk.is_linear else x, bodies.parts_of(side), bodies.labels_of(side))
        for side, x in ((contact.slave, o.x), (contact.master, o.m))
    ]
    for body, own in zip(some, by_body(some, found), strict=True):
        if len(own) and any((labels == body.label).any() for _, _, labels in sides):
            moved = (body.displacement(x, parts) for x, parts, _ in sides)
            own[:] = response(contact.now, *moved)
    return found


def gap_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Change of the mean gaps, (..., slave nodes); zero where not covered; see ``change_along``."""
    return f.per_weight * change_along(f, f.operators.gap_derivative(), on_slave, on_master)


def past_partners(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Motions of the nodes past their partners, (motions, nodes, dim) [length] (local).

    Args:
        f: Fields of the pair.
        on_slave: Displacements of the slave nodes, shape (motions, nodes, dim) [length].
        on_master: Displacements of the master nodes, likewise.
    """
    partners, both = f.state.partners, zip(on_slave, on_master, strict=True)
    return np.array([partners.D @ own - partners.M @ other for own, other in both])


def slip_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Slip of the nodes along their partners, (motions, nodes) [length] (local).

    In space along two tangents, (motions, nodes, 2); arguments as of ``past_partners``.
    """
    return f.along_tangents(past_partners(f, on_slave, on_master))


def opening_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Opening along n, against which the pressure does work, (motions, nodes) [length] (local).

    This differs from the rate of the gap where n is not normal to both sides, as at corners.
    """
    return -normal_parts(f.operators.n, past_partners(f, on_slave, on_master))
