# SPDX-License-Identifier: MIT
"""Floating bodies of a problem, their rigid motions and the forces along them.

Bodies with remote loads: those that these support, and motions that pushes leave free.

A body may float along the driven motions of its rigid boundaries; sides of a section whose force is
given may float along its axis. The places of boundaries and sections follow the motion of the body.

Limit analysis by linear programming: whether contact can support rigid bodies.

Loads with resultants w on the rigid motions v of all bodies are in equilibrium with contact forces
that the law admits if and only if they do no work on any motion that these forces cannot resist
(kinematic theorem, Charnes, Lemke & Zienkiewicz 1959). With the opening rate g_j and the slip rate
u_j of each touching node, and admissible forces p_j >= -a_j, |s_j| <= s_j0 + mu_j (p_j + a_j),

    maximize  (w - sum_j a_j g_j) . v - sum_j s_j0 |u_j|,    g_j >= mu_j |u_j|,    |v| <= 1.

If the maximum is positive, the bodies move. If it is zero, contact may support them; the condition
is necessary but not sufficient, since Coulomb's law is not associated: gaps do not open by as much
as g_j >= mu_j |u_j| requires. The solution of the contact problem then decides.

In space u_j is a vector. With k directions e_i around the normal, the largest e_i . u_j is at most
|u_j|, and at least cos(pi / k) |u_j|: shears in the polygon with the corners e_i are admissible,
and all admissible ones are in the polygon around the circle, larger by 1 / cos(pi / k). Bodies that
shears in the inner polygons can support are supported, those that shears in the outer ones cannot
support move. If neither is the case, k is doubled; at last, with loads within 0.5 % of the limit
load, contact may support them.

Response of contacts to rigid motions of bodies: gaps, slips, loose motions (collective).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from mpi4py import MPI

import numpy as np
from scipy.sparse import csr_array, hstack, vstack

from fenics_mortar.bulk.bodies import (
    FloatingBody,
    PartMotion,
    centre_and_size,
    find_floating_bodies,
    join_bodies,
    label_bodies,
)
from fenics_mortar.bulk.residual import Bulk, mark_prescribed
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.fields import ContactFields, gap_rate, opening_rate, slip_rate
from fenics_mortar.contact.law import KINK
from fenics_mortar.obstacles.rigid_motion import TURNS, RigidMotion, place_after, rotation_by
from fenics_mortar.rigid.proximal import RIGID, unresisted
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, SOLVED, SUM_ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.errors import format_point

if TYPE_CHECKING:
    from fenics_mortar.contact.tied import Tie
    from fenics_mortar.interface.mortar import MortarOperators
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.mesh.data import MeshData


class HeldBodies:
    """Bodies with rigid boundaries or sections under pretension.

    Args:
        bulk: The bodies.
        remote: The remote loads of the problem, bound to the mesh.

    Attributes:
        prescribed_otherwise: Marks of the dofs with other Dirichlet conditions, (local dofs,).
        sections: Sections under pretension, with their positions among the remote loads.
    """

    def __init__(self, bulk: Bulk, remote: Sequence[Any]) -> None:
        conditions = [bc for bc in bulk.bcs if bc not in remote]
        self._boundaries = [(i, load) for i, load in enumerate(remote) if load in bulk.bcs]
        self.sections = [(i, load) for i, load in enumerate(remote) if load not in bulk.bcs]
        self._first = -len(remote)
        self.prescribed_otherwise: Flags = mark_prescribed(bulk.space, bulk.u, conditions)
        self._at: dict[int, list[tuple[int, Any]]] = {}

    def links(self, labels: Indices) -> list[Indices]:
        """Pairs of bodies with a common rigid boundary, (k, 2) each, from labels (collective)."""
        found = [load.labels(labels) for _, load in self._boundaries]
        return [np.stack([some[:-1], some[1:]], axis=1) for some in found]

    def set_bodies(self, labels: Indices) -> None:
        """Set the bodies of all boundaries from labels of the local nodes (collective)."""
        for number, load in self._boundaries:
            self._at.setdefault(int(load.labels(labels)[0]), []).append((number, load))

    def leaders(self, labels: Indices) -> dict[int, RigidMotion]:
        """Motions of rigid boundaries by the number of a part that they lead (local).

        Args:
            labels: Body of each part, shape (parts,).
        """
        first = {label: loads[0][1].motion for label, loads in self._at.items()}
        bodies = enumerate(labels.tolist())
        return {part: first[label] for part, label in bodies if label in first}

    def restricted(self, body: FloatingBody) -> FloatingBody:
        """A body with the motions that its remote loads do not prescribe (local)."""
        loads = self._loads(body)
        if not loads:
            return body
        prescribed = [np.isnan(load.motion.load) for _, load, _ in loads]
        pairs = zip(loads, prescribed, strict=True)
        return body.without(np.hstack([rates[:, on] for (_, _, rates), on in pairs]))

    def _loads(self, body: FloatingBody) -> list[tuple[int, Any, Array]]:
        """Loads of a body: number, load, its motions due to those of the body, (motions, 3) [1]."""
        found = [(n, load, load.motions_by(body)) for n, load in self._at.get(body.label, ())]
        at_sections = dict(self.sections)
        of_body = body.motions.shape[1] - len(body.sections)
        for column, section in enumerate(body.sections, of_body):
            rates = np.outer(body.motions[:, column], np.eye(of_body)[0])
            found.append((section.number, at_sections[section.number], rates))
        return found

    def move(self, body: FloatingBody, coefficients: Array) -> None:
        """Move the remote loads of a body along with it, in driven motions (local).

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        for _, load, rates in self._loads(body):
            change = np.where(np.isfinite(load.motion.load), coefficients @ rates, 0.0)
            load.motion.place = place_after(load.motion.place, change, load.arm)

    def subtract(self, body: FloatingBody, coefficients: Array, motion: Array) -> None:
        """Subtract the motions due to those of a body from increments ``motion`` (local).

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
            motion: Increments of obstacles and remote loads, shape (m, 3) [length]; changed.
                Empty if all are prescribed.
        """
        for number, _, rates in self._loads(body) if motion.size else ():
            motion[self._first + number] -= coefficients @ rates


class BodyMotions:
    """Bodies that Dirichlet conditions do not fix, and their motions; all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts and ties, bound to the same space.
        held: Their rigid boundaries.

    Attributes:
        bulk: The bodies.
        contacts: The contacts without ties.
        labels: Body of each local node, including ghosts, (local nodes,); bodies that are tied,
            also by sections under pretension, or have a rigid boundary in common are one.
        parts, num_parts: As ``labels`` without joining, and their number.
        leaders: Motions of rigid boundaries by the parts that these lead.
        num_bodies: Number of bodies.
        bodies: The floating bodies, after ``find`` and ``restrict``.
        aside: Labels of idle bodies that are set aside at present, see ``idle``.
    """

    def __init__(
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], held: HeldBodies | None = None
    ) -> None:
        self.bulk, self.held = bulk, held or HeldBodies(bulk, ())
        self.contacts = [contact for contact in contacts if isinstance(contact, Contact)]
        self._data: list[MeshData] = [contact.pair.data for contact in contacts]
        self._surface_parts: dict[int, Indices] = {}
        self.parts, self.num_parts = label_bodies(bulk.V)
        count = self.num_parts
        ties = [tie for tie in contacts if not isinstance(tie, Contact)]
        links = [self._links(tie) for tie in ties] + self.held.links(self.parts)
        self._body_of, self.num_bodies = join_bodies(np.arange(count), count, links)
        self.labels = self._body_of[self.parts]
        self._sections = self._separating(ties, links)
        self._periodic = [tie for tie in ties if tie.pair.translation.any()]
        self.held.set_bodies(self.labels)
        self.leaders = self.held.leaders(self._body_of)
        if self.leaders:
            for contact in self.contacts:
                sides = self.parts_of(contact.slave), self.parts_of(contact.master)
                contact.lead_by(partial(self._turns, *sides))
        self.bodies: list[FloatingBody] = []
        self._candidates: list[FloatingBody] = []
        self.aside: set[int] = set()

    def _links(self, tie: Tie) -> Indices:
        """Pairs of bodies joined by a tie, shape (n, 2)."""
        slave, master = self.parts_of(tie.slave), self.parts_of(tie.master)
        nodes = tie.M.tocoo()
        return np.stack([slave[nodes.row], master[nodes.col]], axis=1)

    def _separating(
        self, ties: Sequence[Tie], links: Sequence[Indices]
    ) -> dict[int, list[PartMotion]]:
        """Sections under pretension that separate bodies, by the labels of these."""
        found: dict[int, list[PartMotion]] = {}
        for number, load in self.held.sections:
            joined = [
                link for i, link in enumerate(links) if i >= len(ties) or ties[i] is not load.tie
            ]
            count = len(self._body_of)
            side, _ = join_bodies(np.arange(count), count, joined)
            slave, master = (int(self.parts_of(s)[0]) for s in (load.tie.slave, load.tie.master))
            if side[slave] != side[master]:
                motion = PartMotion(load.motion.name, number, load.axis, side == side[slave])
                found.setdefault(int(self._body_of[slave]), []).append(motion)
        return found

    def find(self) -> None:
        """Find floating bodies from the assembled ``K``; with inertia no body floats."""
        found: list[FloatingBody] = []
        if self.bulk.inertia is None:
            flags = self.held.prescribed_otherwise
            bodies = self.labels, self.num_bodies
            found = find_floating_bodies(self.bulk, *bodies, flags, self._sections, self.parts)
        for tie in self._periodic:
            label, translation = int(self.labels_of(tie.slave)[0]), tie.pair.translation
            found = [
                body if body.label != label else body.without_rotation(translation)
                for body in found
            ]
        self._candidates = found
        self.restrict()

    def restrict(self) -> None:
        """Set ``bodies`` for the motions that rigid boundaries prescribe at present (local)."""
        restricted = map(self.held.restricted, self._candidates)
        self.bodies = [body for body in restricted if len(body.motions)]

    # Nodes

    def _turns(self, *sides: Indices) -> tuple[Array, ...]:
        """Turns of the leaders of nodes, nan without one, (nodes, axes) each [radian] (local)."""
        dim = self.bulk.space.dim
        turns = np.full((self.num_parts, len(TURNS[dim])), np.nan)
        for part, leader in self.leaders.items():
            turns[part] = leader.place[dim:]
        return tuple(turns[parts] for parts in sides)

    def labels_of(self, surface: Surface) -> Indices:
        """Numbers of the bodies of a surface's nodes, (nodes,) (collective the first time)."""
        return self._body_of[self.parts_of(surface)]

    def parts_of(self, surface: Surface) -> Indices:
        """Parts of the mesh of a surface's nodes, (nodes,) (collective the first time)."""
        if id(surface) not in self._surface_parts:
            parts = surface.gather(self.bulk.space.spread(self.parts))[:, 0]
            self._surface_parts[id(surface)] = parts.astype(np.int64)
        return self._surface_parts[id(surface)]

    def dofs_of(self, body: FloatingBody) -> Indices:
        """Local dofs of the owned nodes of a body, shape (nodes, dim)."""
        return self.bulk.space.owned_dofs[self._nodes_of(body)]

    def _nodes_of(self, body: FloatingBody) -> Flags:
        """Whether an owned node belongs to a body."""
        return self.labels[: self.bulk.space.num_nodes] == body.label

    def motions(self, body: FloatingBody) -> tuple[Indices, Array]:
        """Dofs of a body's owned nodes (nodes, dim), its motions there (motions, dim nodes) [1].

        Forces of a linear bulk have no moment in the undeformed configuration.
        """
        x = self.bulk.cells.X if self.bulk.is_linear else self.bulk.positions()
        x = x[: self.bulk.space.num_nodes][self._nodes_of(body)]
        parts = self.parts[: self.bulk.space.num_nodes][self._nodes_of(body)]
        return self.dofs_of(body), body.displacement(x, parts).reshape(len(body.motions), -1)

    def displacement(self, body: FloatingBody, x: Array, parts: Indices) -> Array:
        """Motions of a body at points (n, 2) in parts (n,), shape (motions, n, 2) [1] (local).

        Zero in parts of other bodies, and in no part, -1.
        """
        mine = (parts >= 0) & (self._body_of[parts] == body.label)
        return body.displacement(x, parts) * mine[:, None]

    def shortest_facet(self) -> float:
        """Shortest slave facet of all contacts; without contacts the smallest body [length]."""
        sizes = [float(contact.slave.facet_sizes.min()) for contact in self.contacts]
        return min(sizes or [body.size for body in self.bodies])

    def extent(self) -> float:
        """Diagonal of the box around all bodies [length]."""
        x, comm = self.bulk.positions()[: self.bulk.space.num_nodes], self.bulk.comm
        low = comm.allreduce(x.min(axis=0, initial=np.inf), np.minimum)
        high = comm.allreduce(x.max(axis=0, initial=-np.inf), np.maximum)
        return float(np.linalg.norm(high - low))

    # Motions

    def move(self, body: FloatingBody, coefficients: Array) -> None:
        """Add a rigid motion without strain; its rotation is finite unless the bulk is linear.

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        dim, is_linear = len(body.centre), self.bulk.is_linear
        shift, angles, shifts = np.split(coefficients @ body.motions, [dim, dim + len(TURNS[dim])])
        mine = np.flatnonzero(self.labels == body.label)
        x = self.bulk.cells.X if is_linear else self.bulk.positions()
        angles = angles / body.size
        turn = (
            np.tensordot(angles, TURNS[dim], 1) if is_linear else rotation_by(angles) - np.eye(dim)
        )
        of_parts = sum(
            s * own[0] for s, own in zip(shifts, body.of_parts(self.parts[mine]), strict=True)
        )
        moved = (x[mine] - body.centre) @ turn.T + shift + of_parts
        self.bulk.u.x.array[self.bulk.space.dofs[mine]] += moved
        self.held.move(body, coefficients)

    def rigid_fraction(self, body: FloatingBody, change: Array) -> Array:
        """Rigid part of ``change`` (owned dofs,) of a body, shape (motions,) [length]."""
        dofs, motions = self.motions(body)
        coefficients = motions @ change[dofs].ravel()
        products = self.bulk.comm.allreduce(np.column_stack([motions @ motions.T, coefficients]))
        return np.linalg.solve(products[:, :-1], products[:, -1])

    # Forces

    def resultant(self, body: FloatingBody, total: Array) -> Array:
        """Resultant of ``total`` (owned dofs,) along motions, (motions,) [stress length]."""
        dofs, motions = self.motions(body)
        return self.bulk.comm.allreduce(-motions @ total[dofs].ravel())

    def contacts_of(self, body: FloatingBody) -> list[Contact]:
        """Contacts of a body."""
        return [contact for contact in self.contacts if self.at_body(contact, body).any()]

    def without_pair(self) -> list[FloatingBody]:
        """Floating bodies that no contact pair includes."""
        paired: set[int] = set()
        for surface in (side for c in self.contacts for side in (c.slave, c.master)):
            paired |= set(self.labels_of(surface).tolist())
        return [body for body in self.bodies if body.label not in paired]

    def repeats(self, body: FloatingBody) -> bool:
        """Whether ties make a body periodic in all directions: its place is free (local)."""
        moved = [
            tie.pair.translation
            for tie in self._periodic
            if int(self.labels_of(tie.slave)[0]) == body.label
        ]
        return bool(moved) and bool(np.linalg.matrix_rank(moved) == self.bulk.space.dim)

    def at_body(self, contact: Contact, body: FloatingBody) -> Flags:
        """Whether the force of a slave node may act on a body, shape (slave nodes,).

        A force acts on the body of the slave node and on the bodies of its partners.
        """
        on_slave = self.labels_of(contact.slave) == body.label
        on_master = self.labels_of(contact.master) == body.label
        if on_master.all() or not on_master.any():
            return on_slave | bool(on_master.any())
        return on_slave | self._faces(contact.operators, on_master)

    def _faces(self, operators: MortarOperators, on_master: Flags) -> Flags:
        """Whether slave nodes face any of the master nodes ``on_master``, (slave nodes,)."""
        s, found = operators.segments, np.zeros(len(operators.x), bool)
        faces = on_master[s.master].any(axis=1)
        found[s.slave[faces]] = True
        return self.bulk.comm.allreduce(found, np.logical_or)

    def contact_force(self, body: FloatingBody) -> float:
        """Integral of |pressure| over all contacts of a body [stress length]."""
        return sum(
            float((c.operators.cover * np.abs(c.pressure))[self.at_body(c, body)].sum())
            for c in self.contacts
        )

    def largest_multiplier(self, body: FloatingBody | None = None) -> float:
        """Largest component of the multipliers at a body or of all contacts [stress]."""
        z = [c.z if body is None else c.z[self.at_body(c, body)] for c in self.contacts]
        return max((float(np.abs(values).max(initial=0.0)) for values in z), default=0.0)

    def is_loaded(self, body: FloatingBody, before: float = 0.0) -> bool:
        """Whether a contact force acts on a body that is not rounding of those in the assembly.

        Args:
            body: The body.
            before: Largest multiplier at the body at the start of the solve [stress]; forces that
                have become small compared with it have no limit but zero.
        """
        rounding = max(SOLVED * before, ROUNDING * self.largest_multiplier())
        return any(
            (np.abs(c.z).max(axis=1) > np.maximum(SUM_ROUNDING * c.modulus, rounding))[
                self.at_body(c, body)
            ].any()
            for c in self.contacts
        )

    def rounding(self, body: FloatingBody, force: float) -> float:
        """Rounding of the resultant on a body [stress length].

        Args:
            body: The body.
            force: Size of all forces of the assembly [stress length].
        """
        largest = max(body.size, self.bulk.largest(self.bulk.values))
        return SUM_ROUNDING * force + RIGID.stiffness_rounding * body.stiffest * largest

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
        return f"the body around {format_point(centre_and_size(X[mine], bulk.comm)[0])}"

    def names(self, bodies: Sequence[FloatingBody]) -> str:
        """Names of bodies as text."""
        return " and ".join(sorted({self.name_of(body.label) for body in bodies}))

    def describe(self, loose: Sequence[FloatingBody]) -> str:
        """Loose bodies and their motions, as text."""
        return ", ".join(
            f"{self.name_of(body.label)} can {body.describe(motion)}"
            for body in loose
            for motion in np.eye(len(body.motions))
        )


# Numbers of directions of slip in space, tried in turn [1]: with 32 the limit loads of inner and
# outer polygon differ by 0.5 %, as the error of the discretization.
DIRECTIONS = (8, 16, 32)
# Response of a pair to displacements of slave and master nodes.
Response = Callable[[ContactFields, Array, Array], Array]


class Touching(NamedTuple):
    """n touching nodes of rigid bodies with m motions.

    Attributes:
        opening: Opening rate of each motion, shape (n, m) [1].
        slip: Slip rate of each motion, shape (n, m), in space along two tangents (n, 2, m) [1].
        slope: Coefficient of friction mu_j, inf for nodes that cannot slip, shape (n,) [1].
        shear: Friction s_j0 without pressure, shape (n,) [force].
        adhesion: Largest tensile force a_j, shape (n,) [force].
    """

    opening: Array
    slip: Array
    slope: Array
    shear: Array
    adhesion: Array


def unresisted_motion(loads: Array, touching: Touching) -> Array:
    """Rigid motion with the largest work of the loads that no contact force can resist (local).

    Args:
        loads: Resultants of the loads along the motions, shape (m,) [force].
        touching: The touching nodes.

    Returns:
        Coefficients of the motions, shape (m,), of absolute value at most one [length]; zero if
        contact may support the bodies.

    Raises:
        ArithmeticError: If the linear program fails.
    """
    size = float(np.abs(loads).sum())
    if size == 0.0:
        return np.zeros(loads.size)
    if touching.slip.ndim == 2:
        return _largest_work(loads, touching, np.stack([touching.slip, -touching.slip], axis=1))
    friction = touching.slope.any() or touching.shear.any()
    motion = np.zeros(loads.size)
    for count in DIRECTIONS if friction else (1,):
        slips = _along_directions(touching.slip, count)
        of_inner = _largest_work(loads, touching, slips)
        if not (friction and of_inner.any()):
            return of_inner
        motion = _largest_work(loads, touching, slips / np.cos(np.pi / count))
        if motion.any():
            break
    return motion


def _along_directions(slip: Array, count: int) -> Array:
    """Slips (n, 2, m) along ``count`` directions around the normal, shape (n, count, m) [1]."""
    angles = 2.0 * np.pi / count * np.arange(count)
    return np.einsum("ck,jcm->jkm", np.stack([np.cos(angles), np.sin(angles)]), slip)


def _largest_work(loads: Array, touching: Touching, slips: Array) -> Array:
    """See ``unresisted_motion``, with the largest of the ``slips`` (n, k, m) [1] for |u_j|."""
    size = float(np.abs(loads).sum())
    work = (loads - touching.adhesion @ touching.opening) / size
    sticks, bounded = np.isinf(touching.slope), touching.shear > 0.0
    slope, count = np.where(sticks, 0.0, touching.slope)[:, None], int(bounded.sum())
    along = np.moveaxis(slips, 1, 0)
    resisted = [
        *((slope * slip - touching.opening, 0.0) for slip in along),
        *((slip[sticks], 0.0) for slip in along),
        *((slip[bounded], 1.0) for slip in along),
    ]
    rows = vstack(
        [hstack([csr_array(row), -by_rate * _unit(len(row), count)]) for row, by_rate in resisted]
    )
    from scipy.optimize import linprog  # imported on first use: the import is slow

    costs = np.concatenate([-work, touching.shear[bounded] / size])
    bounds = [(-1.0, 1.0)] * loads.size + [(0.0, None)] * count
    found = linprog(
        costs,
        A_ub=rows,
        b_ub=np.zeros(rows.shape[0]),
        bounds=bounds,
        method="highs",
        options={"presolve": False},  # in scipy 1.10 it reports feasible programs as infeasible
    )
    if not found.success:
        raise ArithmeticError(f"linear program of rigid bodies: {found.message}")
    # SOLVED is above the feasibility tolerance of the linear program, 1e-7
    return found.x[: loads.size] if -found.fun > SOLVED else np.zeros(loads.size)


def _unit(rows: int, columns: int) -> csr_array:
    """Unit matrix if ``rows == columns``, else zeros, (rows, columns)."""
    shape = (rows, columns)
    return csr_array(np.eye(*shape)) if rows == columns else csr_array(shape)


def one_by_one(response: Response) -> Response:
    """A response to several motions from that to one (local)."""

    def all_of_them(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
        both = zip(on_slave, on_master, strict=True)
        return np.array([response(f, *motion) for motion in both])

    return all_of_them


def closing(bodies: BodyMotions, contact: Contact, body: FloatingBody) -> Array:
    """Closing rates of the mean gaps due to rigid motions, (motions, slave nodes) [1]."""
    return -_responses(bodies, contact, body, gap_rate)


def slipping(bodies: BodyMotions, contact: Contact, body: FloatingBody) -> Array:
    """Slip rates of the nodes due to rigid motions, (motions, slave nodes) [1].

    In space those along two tangents, (motions, slave nodes, 2).
    """
    components = () if contact.slave.dim == 2 else (contact.slave.dim - 1,)
    return _responses(bodies, contact, body, one_by_one(slip_rate), components)


def opening(bodies: BodyMotions, contact: Contact, body: FloatingBody) -> Array:
    """Opening rates of the nodes along n due to rigid motions, (motions, slave nodes) [1]."""
    return _responses(bodies, contact, body, one_by_one(opening_rate))


def is_ahead(bodies: BodyMotions, contact: Contact, body: FloatingBody, motion: Array) -> bool:
    """Whether a motion (motions,) of the body closes the gap of a node (collective)."""
    rates = motion @ closing(bodies, contact, body)
    return bool((rates > RIGID.resisted * np.linalg.norm(motion)).any())


def nearly_touching(contact: Contact) -> Flags:
    """Slave nodes whose gap closes in a motion considered as rest, (slave nodes,) (local)."""
    gap = np.nan_to_num(contact.now.closing_gap, nan=np.inf)
    near = gap < RIGID.overlap * contact.slave.nodal_lengths
    return np.asarray(near & contact.multiplier_nodes)


def loose_bodies(bodies: BodyMotions, *, sticking: bool = True) -> list[FloatingBody]:
    """Bodies with the motions that active contact does not resist.

    Args:
        bodies: The floating bodies.
        sticking: Whether sticking nodes resist slip.
    """
    found = []
    for body in bodies.bodies:
        contacts = bodies.contacts_of(body)
        resisted = [closing(bodies, c, body)[:, c.active] for c in contacts]
        if sticking:
            with_friction = [c for c in contacts if c.sticking.any()]
            slips = [slipping(bodies, c, body)[:, c.sticking] for c in with_friction]
            resisted += [slip.reshape(len(body.motions), -1) for slip in slips]
        responses = np.hstack([np.zeros((len(body.motions), 0)), *resisted])
        known = np.isfinite(responses).all(axis=0)  # not at folded facets of a failed iteration
        free = unresisted(responses[:, known])
        if len(free):
            found.append(replace(body, motions=free @ body.motions))
    return found


def bonded_motions(bodies: BodyMotions, some: Sequence[FloatingBody]) -> list[FloatingBody]:
    """Bodies with the motions that are left to them, moving together, by adhesion at closed gaps.

    A bond without friction lets its sides slide on each other; a broken one does not hold.

    Args:
        bodies: The floating bodies.
        some: Those that may move; others are at rest. Bodies without such a motion are left out.
    """
    if not some:
        return []
    responses = [np.zeros((sum(len(body.motions) for body in some), 0))]
    for contact in bodies.contacts:
        if contact.pair.law.has_adhesion:
            on, holds = _bonds(contact)
            for rate, nodes in ((opening, on), (slipping, on & holds)):
                rates = np.vstack([rate(bodies, contact, body) for body in some])
                responses.append(rates[:, nodes].reshape(len(rates), -1))
    ends = np.cumsum([len(body.motions) for body in some])[:-1]
    parts = np.split(unresisted(np.hstack(responses)), ends, axis=1)
    moving = []
    for body, part in zip(some, parts, strict=True):
        _, sizes, ways = np.linalg.svd(part, full_matrices=False)
        free = ways[sizes > RIGID.resisted]
        if len(free):
            moving.append(replace(body, motions=free @ body.motions))
    return moving


def _bonds(contact: Contact) -> tuple[Flags, Flags]:
    """Closed nodes with adhesion, and those whose bond resists slip, (slave nodes,) each (local).

    A bond that is partly damaged pulls as it opens.
    """
    touches = contact.active | nearly_touching(contact)
    pull = contact.now.adhesion_at_gap(KINK * contact.slave.nodal_lengths)
    slope, shear = contact.now.strength(float(pull.max(initial=0.0)))
    return touches & (pull > 0.0), contact.pair.law.bridges_gap | (slope > 0.0) | (shear > 0.0)


def _responses(
    bodies: BodyMotions,
    contact: Contact,
    body: FloatingBody,
    response: Response,
    components: tuple[int, ...] = (),
) -> Array:
    """Response of a pair to each rigid motion of a body, shape (motions, slave nodes, ...).

    Args:
        bodies: The floating bodies.
        contact: The pair.
        body: The body.
        response: Function of fields and displacements (motions, nodes, dim) of slave and master.
        components: Shape of the response of a node.
    """
    found = np.zeros((len(body.motions), contact.slave.num_nodes, *components))
    o = contact.operators
    sides = (contact.slave, o.x), (contact.master, o.m)
    has_nodes = any((bodies.labels_of(surface) == body.label).any() for surface, _ in sides)
    if has_nodes and len(body.motions):
        on_slave, on_master = (
            bodies.displacement(body, side.X if bodies.bulk.is_linear else x, bodies.parts_of(side))
            for side, x in sides
        )
        found[:] = response(contact.now, on_slave, on_master)
    return found
