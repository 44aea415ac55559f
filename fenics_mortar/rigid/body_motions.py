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
from scipy.sparse import coo_array, csr_array, hstack

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
from fenics_mortar.obstacles.rigid_motion import TURNS, RigidMotion, place_after, rotation_less_one
from fenics_mortar.rigid.proximal import RIGID, unresisted
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, SOLVED, SUM_ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.errors import NotFiniteError, format_point
from fenics_mortar.utils.ranks import any_over_ranks, largest_over_ranks

if TYPE_CHECKING:
    from fenics_mortar.contact.tied import Tie
    from fenics_mortar.interface.surfaces import Surface
    from fenics_mortar.mesh.data import MeshData


class HeldBodies:
    """Bodies with rigid boundaries or sections under pretension.

    Args:
        bulk: The bodies.
        remote: The remote loads of the problem, bound to the mesh.

    Attributes:
        prescribed_otherwise: Marks of the dofs with other Dirichlet conditions, (local dofs,).
        sections: Sections under pretension.
    """

    def __init__(self, bulk: Bulk, remote: Sequence[Any]) -> None:
        conditions = [bc for bc in bulk.bcs if bc not in remote]
        self._remote = list(remote)
        self._boundaries = [load for load in remote if load in bulk.bcs]
        self.sections = [load for load in remote if load not in bulk.bcs]
        self.prescribed_otherwise: Flags = mark_prescribed(bulk.space, bulk.u, conditions)
        self._at: dict[int, list[Any]] = {}

    def links(self, parts: Indices) -> list[Indices]:
        """Pairs of parts with a common rigid boundary, (k, 2) each (collective).

        Args:
            parts: Part of the mesh of each local node, shape (local nodes,).
        """
        found = [load.parts_of(parts) for load in self._boundaries]
        return [np.stack([some[:-1], some[1:]], axis=1) for some in found]

    def set_bodies(self, body_of: Indices) -> dict[int, RigidMotion]:
        """Set the bodies of all boundaries; motions of boundaries by the parts they lead (local).

        Args:
            body_of: Body of each part of the mesh, shape (parts,).
        """
        for load in self._boundaries:
            self._at.setdefault(int(body_of[load.part]), []).append(load)
        leaders = {label: loads[0].motion for label, loads in self._at.items()}
        return {part: leaders[k] for part, k in enumerate(body_of.tolist()) if k in leaders}

    def restricted(self, body: FloatingBody) -> FloatingBody:
        """A body with the motions that its remote loads do not prescribe (local)."""
        loads = self._loads(body)
        if not loads:
            return body
        return body.without(
            np.hstack([rates[:, np.isnan(load.motion.load)] for load, rates in loads])
        )

    def _loads(self, body: FloatingBody) -> list[tuple[Any, Array]]:
        """Loads of a body, and their motions due to those of the body, (motions, 3) [1]."""
        found = [(load, load.motions_by(body)) for load in self._at.get(body.label, ())]
        of_body = body.motions.shape[1] - len(body.sections)
        for column, section in enumerate(body.sections, of_body):
            rates = np.outer(body.motions[:, column], np.eye(of_body)[0])
            found.append((section.load, rates))
        return found

    def move(self, body: FloatingBody, coefficients: Array) -> None:
        """Move the remote loads of a body along with it, in driven motions (local).

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        for load, rates in self._loads(body):
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
        for load, rates in self._loads(body) if motion.size else ():
            last = self._remote.index(load) - len(self._remote)  # after the obstacles
            motion[last] -= coefficients @ rates


class BodyMotions:
    """Bodies that Dirichlet conditions do not fix, and their motions; all methods are collective.

    Args:
        bulk: The bodies.
        contacts: The contacts and ties, bound to the same space.
        remote: The remote loads with motions, bound to the mesh.

    Attributes:
        bulk: The bodies.
        held: The bodies with rigid boundaries or sections.
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
        self, bulk: Bulk, contacts: Sequence[Contact | Tie], remote: Sequence[Any]
    ) -> None:
        self.bulk, self.held = bulk, HeldBodies(bulk, remote)
        self.contacts = [contact for contact in contacts if isinstance(contact, Contact)]
        self._data: list[MeshData] = [contact.pair.data for contact in contacts]
        self._surface_parts: dict[int, Indices] = {}
        self.parts, self.num_parts = label_bodies(bulk.V)
        ties = [tie for tie in contacts if not isinstance(tie, Contact)]
        tied = [(tie.M, self.parts_of(tie.slave), self.parts_of(tie.master)) for tie in ties]
        links = [pairs_joined(*each) for each in tied] + self.held.links(self.parts)
        self._body_of, self.num_bodies = join_bodies(self.num_parts, links)
        self.labels = self._body_of[self.parts]
        self._sections = self._separating(ties, links)
        self._periodic = [tie for tie in ties if tie.pair.translation.any()]
        self.leaders = self.held.set_bodies(self._body_of)
        if self.leaders:
            for contact in self.contacts:
                sides = self.parts_of(contact.slave), self.parts_of(contact.master)
                contact.lead_by(partial(self._turns, *sides))
        self.bodies: list[FloatingBody] = []
        self._candidates: list[FloatingBody] = []
        self.aside: set[int] = set()

    def _separating(
        self, ties: Sequence[Tie], links: Sequence[Indices]
    ) -> dict[int, list[PartMotion]]:
        """Sections under pretension that separate bodies, by the labels of these."""
        found: dict[int, list[PartMotion]] = {}
        for load in self.held.sections:
            section = ties.index(load.tie)
            side, _ = join_bodies(self.num_parts, [*links[:section], *links[section + 1 :]])
            slave, master = (int(self.parts_of(s)[0]) for s in (load.tie.slave, load.tie.master))
            if side[slave] != side[master]:
                motion = PartMotion(load, side == side[slave])
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

    def extent(self, x: Array) -> float:
        """Diagonal of the box around all bodies, with local nodes at ``x`` (n, dim) [length]."""
        x = x[: self.bulk.space.num_nodes]
        ends = [side.max(axis=0, initial=-np.inf) for side in (x, -x)]
        return float(np.linalg.norm(largest_over_ranks(self.bulk.comm, ends).sum(axis=0)))

    # Motions

    def move(self, body: FloatingBody, coefficients: Array) -> None:
        """Add a rigid motion without strain; its rotation is finite unless the bulk is linear.

        Args:
            body: The body.
            coefficients: Factors of its motions, shape (motions,) [length].
        """
        mine = np.flatnonzero(self.labels == body.label)
        x = self.bulk.cells.X if self.bulk.is_linear else self.bulk.positions()
        moved = np.tensordot(coefficients, body.displacement(x[mine], self.parts[mine]), 1)
        if not self.bulk.is_linear:
            axes = TURNS[len(body.centre)]
            angles = (coefficients @ body.motions)[len(body.centre) :][: len(axes)] / body.size
            beyond_linear = rotation_less_one(angles) - np.tensordot(angles, axes, 1)
            moved += (x[mine] - body.centre) @ beyond_linear.T
        self.bulk.u.x.array[self.bulk.space.dofs[mine]] += moved
        self.held.move(body, coefficients)

    def rigid_fraction(self, body: FloatingBody, change: Array) -> Array:
        """Rigid part of ``change`` (owned dofs,) of a body, shape (motions,) [length]."""
        dofs, motions = self.motions(body)
        lower = self.factor(body, motions)
        along = np.linalg.solve(lower, self.bulk.comm.allreduce(motions @ change[dofs].ravel()))
        return np.linalg.solve(lower.T, along)

    def factor(self, body: FloatingBody, motions: Array) -> Array:
        """Cholesky's factor [1] of the products of a body's motions at owned dofs (collective).

        Raises:
            NotFiniteError: On all ranks, if the motions are dependent to rounding: an iteration has
                thrown the body so far away that its turns are lost beside its distance.
        """
        try:
            return np.linalg.cholesky(self.bulk.comm.allreduce(motions @ motions.T))
        except np.linalg.LinAlgError:
            name = self.name_of(body.label)
            raise NotFiniteError(f"{name} is far away from its place at the start") from None

    # Forces

    def resultant(self, body: FloatingBody, total: Array) -> Array:
        """Resultant of ``total`` (owned dofs,) along motions, (motions,) [stress length]."""
        dofs, motions = self.motions(body)
        return self.bulk.comm.allreduce(-motions @ total[dofs].ravel())

    def contacts_of(self, body: FloatingBody) -> list[Contact]:
        """Contacts of a body."""
        return [contact for contact in self.contacts if self.at_body(contact, body).any()]

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
        segments, faces = contact.operators.segments, np.zeros(len(on_slave), bool)
        faces[segments.slave[on_master[segments.master].any(axis=1)]] = True
        return on_slave | any_over_ranks(self.bulk.comm, faces)

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
            if np.linalg.norm(self.resultant(body, forces)) > self.rounding(body, size)
        }

    def loose(self, *, sticking: bool = True) -> list[FloatingBody]:
        """Bodies with the motions that active contact does not resist.

        Args:
            sticking: Whether sticking nodes resist slip.
        """
        found = []
        for body in self.bodies:
            contacts = self.contacts_of(body)
            resisted = [closing(self, c, body)[:, c.active] for c in contacts]
            for contact in contacts if sticking else ():
                if contact.sticking.any():
                    slips = slipping(self, contact, body)[:, contact.sticking]
                    resisted.append(slips.reshape(len(body.motions), -1))
            responses = np.hstack([np.zeros((len(body.motions), 0)), *resisted])
            known = np.isfinite(responses).all(axis=0)  # not at folded facets of a failed iteration
            free = unresisted(responses[:, known])
            if len(free):
                found.append(replace(body, motions=free @ body.motions))
        return found

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
        angles = 2.0 * np.pi / count * np.arange(count)
        directions = np.stack([np.cos(angles), np.sin(angles)])
        slips = np.einsum("ck,jcm->jkm", directions, touching.slip)
        of_inner = _largest_work(loads, touching, slips)
        if not (friction and of_inner.any()):
            return of_inner
        motion = _largest_work(loads, touching, slips / np.cos(np.pi / count))
        if motion.any():
            break
    return motion


def _largest_work(loads: Array, touching: Touching, slips: Array) -> Array:
    """``unresisted_motion`` with the largest of the ``slips`` (n, k, m) [1] for |u_j|."""
    size = float(np.abs(loads).sum())
    work = (loads - touching.adhesion @ touching.opening) / size
    sticks, bounded = np.isinf(touching.slope), touching.shear > 0.0
    slope, count = np.where(sticks, 0.0, touching.slope)[:, None], int(bounded.sum())
    along = np.moveaxis(slips, 1, 0)
    resisted = [slope * along - touching.opening, along[:, sticks], along[:, bounded]]
    rates = csr_array(np.concatenate([each.reshape(-1, loads.size) for each in resisted]))
    rubbing = np.arange(len(along) * count)  # the last rows: slips are at most the |u_j|
    at = rates.shape[0] - rubbing.size + rubbing, rubbing % count
    rows = hstack([rates, coo_array((-np.ones(rubbing.size), at), (rates.shape[0], count))])
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


def closing(bodies: BodyMotions, contact: Contact, *some: FloatingBody) -> Array:
    """Closing rates of the mean gaps due to rigid motions, (motions of all, slave nodes) [1]."""
    return -_responses(bodies, contact, some, gap_rate)


def slipping(bodies: BodyMotions, contact: Contact, *some: FloatingBody) -> Array:
    """Slip rates of the nodes due to rigid motions, (motions of all, slave nodes) [1].

    In space those along two tangents, (motions, slave nodes, 2).
    """
    components = () if contact.slave.dim == 2 else (contact.slave.dim - 1,)
    return _responses(bodies, contact, some, slip_rate, components)


def opening(bodies: BodyMotions, contact: Contact, *some: FloatingBody) -> Array:
    """Opening rates of the nodes along n due to rigid motions, (motions of all, nodes) [1]."""
    return _responses(bodies, contact, some, opening_rate)


def pairs_joined(M: Any, slave: Indices, master: Indices) -> Indices:
    """Parts (n,) of slave nodes and (m,) of their masters by a matrix (n, m), (k, 2) (local)."""
    nodes = M.tocoo()
    return np.stack([slave[nodes.row], master[nodes.col]], axis=1)


def by_body(bodies: Sequence[FloatingBody], values: Array) -> list[Array]:
    """The ``values`` (motions of all, ...) of each body [their unit] (local)."""
    return np.split(values, np.cumsum([len(body.motions) for body in bodies])[:-1])


def nearly_touching(contact: Contact) -> Flags:
    """Slave nodes whose gap closes in a motion considered as rest, (slave nodes,) (local)."""
    gap = np.nan_to_num(contact.now.closing_gap, nan=np.inf)
    near = gap < RIGID.overlap * contact.slave.nodal_lengths
    return np.asarray(near & contact.multiplier_nodes)


def touches(contact: Contact) -> Flags:
    """Active nodes and, if there are any, open ones that nearly touch, (slave nodes,) (local).

    Open nodes with adhesion do not: their forces are loads.
    """
    on = contact.active & ~contact.set_aside
    near = nearly_touching(contact) & ~contact.z.any(axis=1) & ~contact.set_aside
    return on | near if on.any() else on


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
                rates = rate(bodies, contact, *some)
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
    pull = contact.now.adhesion_at_gap(KINK * contact.slave.nodal_lengths)
    slope, shear = contact.now.strength(float(pull.max(initial=0.0)))
    return touches & (pull > 0.0), contact.pair.law.bridges_gap | (slope > 0.0) | (shear > 0.0)


def _responses(
    bodies: BodyMotions,
    contact: Contact,
    some: Sequence[FloatingBody],
    response: Response,
    components: tuple[int, ...] = (),
) -> Array:
    """Response of a pair to each rigid motion of some bodies, (motions, slave nodes, ...).

    Args:
        bodies: The floating bodies.
        contact: The pair.
        some: The bodies that move.
        response: Function of fields and displacements (motions, nodes, dim) of slave and master.
        components: Shape of the response of a node.
    """
    o, count = contact.operators, sum(len(body.motions) for body in some)
    found = np.zeros((count, contact.slave.num_nodes, *components))
    sides = [
        (side.X if bodies.bulk.is_linear else x, bodies.parts_of(side), bodies.labels_of(side))
        for side, x in ((contact.slave, o.x), (contact.master, o.m))
    ]
    for body, own in zip(some, by_body(some, found), strict=True):
        if len(own) and any((labels == body.label).any() for _, _, labels in sides):
            moved = (bodies.displacement(body, x, parts) for x, parts, _ in sides)
            own[:] = response(contact.now, *moved)
    return found
