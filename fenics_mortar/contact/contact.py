# SPDX-License-Identifier: MIT
"""Contact of a pair: weighted gap, active set, complementarity, and the rows of the multiplier.

The complementarity function of slave node j is (Popp, Gee & Wall 2009; Foltyn & Vlach 2016, eq. 6)

    C_j = z_n - max(0, z_n - c_j g_j / w_j),    z_n = n_j . z_j,

with g_j the weighted gap and w_j = int Phi_j, the row sum of D and D_jj of most dual functions; the
node is active where z_n - c_j g_j / w_j > 0. Its two rows in the linear system, for the increment
dd of the displacement and the new multiplier z, read

    active:     G_j dd = -g_j,     d(tau_j) . z_j^k + tau_j . z_j = 0
    inactive:   z_j = 0.

The second row of an active node is that of frictionless contact; in general it is rho_j = 0 with
rho of the contact law, see ``laws``, the slip in it from ``slip``, and the derivatives of all that
rho depends on. With adhesion a(g) the complementarity function has z_n + a in place of z_n, and the
normal row of an inactive node that its partner attracts is z_n + a(g_j / w_j) = 0.

c_j = c k_j / l_j with k_j the mean diagonal entry of the bulk tangent at the node (about Young's
modulus), l_j its length and c a plain number: nothing depends on units.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np

from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.interface import NO_WELDS, Interface, read_only
from fenics_mortar.contact.law_calls import Asker, raise_noted
from fenics_mortar.contact.laws import Nodal
from fenics_mortar.contact.multiplier_nodes import Carriers, normals_on_planes
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.rows import (
    Frame,
    Rows,
    frame_of,
    gap_by_motions,
    law_of,
    motion_rows_of,
    residual_of,
    rows_of,
)
from fenics_mortar.contact.slip import Measure, find_partners
from fenics_mortar.interface.mortar import (
    LINEARIZATIONS,
    Block,
    Linearization,
    MortarOperators,
    MortarOptions,
    evaluate_mortar,
    evaluate_normals,
)
from fenics_mortar.interface.on_obstacle import (
    evaluate_obstacle,
    surface_without_nodes,
)
from fenics_mortar.interface.segments import Segments, find_segments
from fenics_mortar.interface.sight import Outline, Sight, View
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arguments import check_lengths
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import SurfaceError, place

# A pressure below this part of the stiffness and a gap below this part of the place are rounding.
ROUNDING = 1e-14
# Before the first solve a node is active if it touches: gap below this part of its length.
TOUCHING = 1e-8
# A node lies on the other surface, up to facets that stand for curves, within this part of its
# length.
NEAR = 0.5
# The place of a reference that there is not.
NO_PLACE = np.full(3, np.nan)
# Overlaps of active nodes are told of from so many facets on: iterates of Newton have smaller ones.
MANY = 2.0
# An overlap before the first solve is told of above this part of a node's length.
OVERLAP = 1e-6


class Reference(NamedTuple):
    """Frozen operators of the undeformed mesh, and what they were evaluated with."""

    operators: Any
    carries: Flags
    place: Array


class Contact(Interface):
    """One pair bound to a displacement space: surfaces, multipliers, active set, operators.

    Replicated: every attribute is equal on all ranks, except the blocks inside ``operators``.

    Attributes:
        sight: Bodies behind the slave, seen along its normals; ``None`` of an obstacle.
        obstacle: The rigid master, or ``None``.
        arm: Length by which angles of the obstacle are multiplied [length].
        master_free: 1 where a component of a master node is not prescribed, else 0, (nodes, 2).
        asker: Calls the law of the pair.
        rubs: Whether a node follows the law: not if one of its components is prescribed, shape
            (slave nodes,), bool.
        plane_normals: Normals of slave nodes on symmetry planes, nan elsewhere, (slave nodes, 2).
        offset, c_n: See ``InterfaceState``. May be set. To ramp an overlap of the mesh, go with
            ``t`` from 0 to 1 by ``contact.offset = (1 - t) * overlap``, where ``overlap`` is
            ``np.nan_to_num(contact.gap).clip(max=0)`` at the start. An offset of another shape, nan
            and inf are refused by a ``ValueError``.
    """

    now: ContactFields

    attracted, tension = read_only("now.attracted"), read_only("now.tension")
    nodal, sliding, friction_work = (
        read_only("now.nodal"),
        read_only("now.sliding"),
        read_only("now.friction_work"),
    )
    on_obstacle = read_only("now.on_obstacle")

    def __init__(
        self,
        pair: ContactPair,
        space: DisplacementSpace,
        prescribed: Flags,
        welds: Indices = NO_WELDS,
    ) -> None:
        """Extract the surfaces (collective); see ``Interface``."""
        self.obstacle = pair.master if isinstance(pair.master, Obstacle) else None
        super().__init__(pair, space, prescribed, welds)
        normals, _ = evaluate_normals(self.slave, self.slave.X, pair.normals)
        self._carriers = Carriers(self.slave, normals, self.free, at_vertices=self.at_vertices)
        self._master_planes = self._find_master_planes(prescribed)
        self.master_free: Array = 1.0 - self.master.gather(prescribed.astype(float))
        self._may_carry = self._carriers.possible
        self.plane_normals = self._carriers.plane_normals
        self.rubs: Flags = self.free.all(axis=1)
        self.oblique = self._carriers.oblique
        if not self._may_carry.any():
            raise SurfaceError(f"every node of slave surface '{pair.slave_name}' is prescribed")
        self.arm = float(np.hypot(*np.ptp(self.slave.X, axis=0)))
        self.options = MortarOptions(
            pair.basis,
            pair.normals,
            pair.gap_weights,
            pair.integration,
            self._points(),
            pair.search_radius or self._reach(),
            float(np.cos(np.radians(pair.max_angle))),
        )
        self.sight: Sight | None = None
        self._view: View | None = None
        none = np.zeros(self.slave.num_nodes)
        start = Nodal(none, none, none, none, none + 1.0, none)
        self.asker = Asker(pair.slave_name)
        at_rest = np.zeros(none.size, np.int64)
        piece = self.asker.piece(pair.law, start, at_rest, self.slave.X)
        self.change(carries=self._may_carry, piece=piece, c_n=pair.c_n)
        raise_noted(self.slave.comm, [self])

    def _master_surface(self, space: DisplacementSpace) -> Surface:
        """Surface of the pair's other side; that of an obstacle has no nodes (collective)."""
        if self.obstacle is not None:
            return surface_without_nodes(self.slave, self.pair.master_name)
        return super()._master_surface(space)

    def see(self, outline: Outline) -> Outline:
        """See ``Interface``: through what partners may lie behind the slave.

        Not behind an obstacle: what faces it from outside has it in front.
        """
        if self.obstacle is None:
            normals, _ = evaluate_normals(self.slave, self.slave.X, self.pair.normals)
            self.sight = Sight(outline, self.slave, self.master, normals)
        return outline

    def _find_master_planes(self, prescribed: Flags) -> Array:
        """Normals of master nodes on symmetry planes, nan elsewhere (collective)."""
        if self.obstacle is not None:
            return self.master.X
        normals, _ = evaluate_normals(self.master, self.master.X, "opposite")
        return normals_on_planes(normals, 1.0 - self.master.gather(prescribed.astype(float)))

    def has_master_of(self, other: Interface) -> bool:
        """Whether the two have the same obstacle, or masters that share a node."""
        same = self.obstacle is not None and self.obstacle is other.pair.master
        return same or super().has_master_of(other)

    def _reach(self) -> float:
        """Distance at which partners are looked for by default."""
        if self.obstacle is not None:
            return np.inf
        return min(float(np.hypot(*np.ptp(side.X, axis=0))) for side in (self.slave, self.master))

    @property
    def offset(self) -> Array:
        """Length taken off the pointwise gap, shape (slave nodes,) [length]."""
        return self._state.offset

    @offset.setter
    def offset(self, lengths: Array) -> None:
        self.change(offset=check_lengths("offset", lengths, self.slave.num_nodes))

    def _fields(self, operators: MortarOperators) -> ContactFields:
        return ContactFields(self, self._state, operators)

    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate the operators at the displacement ``u``, a local array (collective)."""
        view, x, m = self._look(u)
        if self.pair.sliding == "small":
            operators = self._after_small_motion(x, m)
        else:
            operators = self._evaluate(x, m, linearization, view)
        self.show(operators.less_offset(self.offset) if self.offset.any() else operators)
        if self.pair.slip == "operators":
            _ = self.operators.vectors  # by all ranks

    def _look(self, u: Array | None) -> tuple[View | None, Array, Array]:
        """The view at ``u``, or undeformed, and the places of slave and master (collective)."""
        sides = self.slave, self.master
        if self.sight is not None:
            view, *moved = self.sight.look(u)
        else:
            view, moved = None, [0.0 * side.X if u is None else side.gather(u) for side in sides]
        x, m = (side.X + change for side, change in zip(sides, moved, strict=True))
        return view, x, m

    @property
    def _slip_measure(self) -> Measure:
        """The pair's, where there is a choice."""
        one = self.obstacle is not None or self.pair.sliding == "small"
        return "partners" if one else self.pair.slip

    def _evaluate(
        self, x: Array, m: Array, linearization: Linearization, view: View | None
    ) -> MortarOperators:
        """The operators where the nodes are at ``x`` and ``m`` (collective)."""
        planes, self._view = self.plane_normals, view
        if self.obstacle is None:
            return evaluate_mortar(
                self.slave, self.master, x, m, self.carries, planes, self.options, linearization,
                view,
            )  # fmt: skip
        return evaluate_obstacle(
            self.slave, self.master, self.obstacle, self.arm, x, self.carries, planes,
            self.options, linearization,
        )  # fmt: skip

    def _after_small_motion(self, x: Array, m: Array) -> MortarOperators:
        """The operators of the undeformed mesh, with the gap of the present positions."""
        kept = self._state.reference
        if kept is None or not np.array_equal(kept.carries, self.carries):
            kept = self._refer()
        if self.obstacle is None:
            return kept.operators.after_small_motion(x, m)
        dq = (self.obstacle.place - kept.place) * [1.0, 1.0, self.arm]
        return kept.operators.after_small_motion(x, m, dq)

    def _refer(self) -> Reference:
        """Evaluate the operators of the undeformed mesh (collective)."""
        view, X, X_master = self._look(None)
        operators = self._evaluate(X, X_master, LINEARIZATIONS["frozen"], view).freeze()
        place = np.zeros(3) if self.obstacle is None else self.obstacle.place.copy()
        reference = Reference(operators, self.carries, place)
        self.change(reference=reference)
        return reference

    @property
    def reference_place(self) -> Array:
        """Where the obstacle was for the operators of the undeformed mesh, (3,); nan if none."""
        return NO_PLACE if self._state.reference is None else self._state.reference.place

    def refer_to(self, place: Array, carries: Flags) -> None:
        """Evaluate the operators of the undeformed mesh as they once were (collective).

        Args:
            place: ``reference_place`` of then, shape (3,); nan: there were none.
            carries: Nodes with multipliers of then, shape (slave nodes,).
        """
        self.change(reference=None, carries=carries)
        if np.isnan(place).any():
            return
        if self.obstacle is None:
            self._refer()
            return
        now, self.obstacle.place = self.obstacle.place, place.copy()
        try:
            self._refer()
        finally:
            self.obstacle.place = now

    @property
    def as_faced(self) -> MortarOperators:
        """The operators at the places of the nodes by which points of both sides are partners.

        With small sliding these are those of the undeformed mesh.
        """
        if self.pair.sliding == "small" and self._state.reference is not None:
            return self._state.reference.operators
        return self.operators

    def intersections(self) -> Segments:
        """Where the facets of this rank's share meet the master, whatever integrates the pair."""
        o, options = self.as_faced, self.options
        if options.integration == "segments" or self.obstacle is not None:
            return o.segments
        return find_segments(
            self.slave, self.master, o.x, o.n, o.m, facets=o.segments.facets,
            radius=options.radius, least_cosine=options.least_cosine, view=self._view,
        )  # fmt: skip

    def adopt(self, other: Contact) -> None:
        """Take over offset, weight and undeformed operators of the same pair by another model."""
        self.change(
            offset=other.offset,
            c_n=other.c_n,
            reference=other.state.reference or self.state.reference,
        )
        self._view = other._view or self._view

    def begin(self) -> None:
        """Forget how often nodes changed in the last solve, and what they bore."""
        self._carriers.begin()
        self.change(borne=None)

    def move(self, z: Array, part: float, step: Array) -> None:
        """See ``Interface``; notes the nodes that press though their multipliers pull (collective).

        A linear system knows the force w z of a node to first order, w_old z + dw z_old. As the
        weight of a node more than doubles, at an edge that slides, the second term alone may be
        more than the force, and z pulls to make up for it. Such a node would be released, to come
        back an iteration or two later; it is its force that says if it presses.
        """
        old, o = self.z, self.operators
        super().move(z, part, step)
        pulls, borne = self.active & (self.tension > 0.0), None
        if pulls.any():
            sides = self.slave.gather(step), self.master.gather(step)
            change = part * self._change(o.weight_derivative(), *sides)
            pulls &= change > o.weight
            force = o.weight[:, None] * self.z + change[:, None] * old
            least = -o.weight * self.now.adhesion[0]
            borne = pulls & (np.einsum("ja,ja->j", o.n, force) > least), force
        self.change(borne=borne)

    def accept(self, slid: Flags | None = None) -> None:
        """Note what the slave nodes face at the last evaluated state (collective).

        Args:
            slid: Nodes whose slip so far goes on to count, shape (slave nodes,), bool.
        """
        slip = np.zeros(len(self.z)) if slid is None else np.where(slid, self.slip, 0.0)
        touches = self.active | (self.pair.sliding == "small")
        accepted = find_partners(
            self.operators,
            self.covered,
            touches,
            self._slip_measure,
            master_planes=self._master_planes,
            between=self.pair.law.rubs,
        )
        shear = np.where(self.active, self.z_tau, 0.0)
        self.change(accepted=replace(accepted, start=accepted.start - slip, shear=shear))

    def start_step(self) -> None:
        """Count slip from the accepted state."""
        self.change(partners=self.accepted)

    def faced(self) -> tuple[Indices, Indices]:
        """Slave nodes, and the master nodes that slip couples them to."""
        return self.partners.pairs() if self.pair.law.rubs else super().faced()

    def update_carriers(self) -> int:
        """Hand over and take back multipliers, see ``carriers``; return how many changed.

        The operators have to be evaluated anew then. Points at the nodes cover a node or they do
        not, there is nothing to hand over.
        """
        if self.options.integration == "nodes":
            return 0
        before, cover = self.carries, self.operators.cover / self.nodal_lengths
        self.change(carries=self._carriers.update(before, cover))
        return int((self.carries != before).sum())

    @property
    def undecided(self) -> Indices:
        """Nodes that may as well carry a multiplier as not; see ``Carriers.undecided``."""
        if self.options.integration == "nodes":
            return np.empty(0, np.int64)
        return self._carriers.undecided(self.operators.cover / self.nodal_lengths, self.active)

    def set_initial_gap(self) -> None:
        """Set the offset that gives nodes near the other surface the pair's ``initial_gap``."""
        if self.pair.initial_gap is not None:
            near = np.abs(np.nan_to_num(self.gap, nan=np.inf)) <= NEAR * self.nodal_lengths
            self.offset = np.where(near, np.nan_to_num(self.gap) - self.pair.initial_gap, 0.0)

    def describe_start(self) -> str:
        """Overlap of the present state, or that nothing faces, in words; "" if there is neither."""
        if not self.covered.any():
            return (
                f"no node of '{self.slave.name}' faced '{self.master.name}' before the first "
                f"solve: nothing within {self.options.radius:.3g} along its "
                "normals, so the pair bears no force until they come nearer"
            )
        overlap = -np.nan_to_num(self.gap)
        j = int(np.argmax(overlap / self.nodal_lengths))
        if overlap[j] <= OVERLAP * self.nodal_lengths[j]:
            return ""
        return (
            f"'{self.slave.name}' and '{self.master.name}' overlap by up to {overlap[j]:.3g} at "
            f"{place(self.operators.x[j])} before the first solve, which counts as interference; "
            "initial_gap=0 would take it for an error of the mesh"
        )

    @property
    def reach(self) -> str:
        """How far away partners are looked for, in words."""
        if self.obstacle is not None:
            return f"up to {self.options.radius:.3g}"
        return (
            f"up to {self.options.radius:.3g}, behind the surface at most up to half of what both "
            "bodies are thick there"
        )

    def describe_overlap(self) -> str:
        """The active node that overlaps the most, in words; "" if by a few facets only."""
        overlap = np.where(self.active, -np.nan_to_num(self.gap) / self.nodal_lengths, 0.0)
        j = int(np.argmax(overlap))
        if overlap[j] <= MANY:
            return ""
        depth = overlap[j] * self.nodal_lengths[j]
        return (
            f"the node at {place(self.operators.x[j])} of '{self.slave.name}' overlaps "
            f"'{self.master.name}' by {overlap[j]:.1f} facets; partners are looked for "
            f"{self.reach}: take smaller steps, or, if that is no contact, a search_radius below "
            f"{depth:.3g}"
        )

    def gap_change(self, on_slave: Array, on_master: Array) -> Array:
        """Derivative of the mean gaps in a direction (collective); zero where not covered.

        Args:
            on_slave: Displacements of the slave nodes, shape (n, 2).
            on_master: Displacements of the master nodes, shape (n, 2).
        """
        change = self._change(self.operators.gap_derivative(), on_slave, on_master)
        on = self.covered
        change[on] /= self.operators.weight[on]
        return np.where(on, change, 0.0)

    def _change(self, blocks: list[Block], on_slave: Array, on_master: Array) -> Array:
        """What blocks of slave nodes change in a direction, (slave nodes,) (collective)."""
        sides = (self.slave, self.master)
        dofs = np.concatenate([side.dofs_of(np.arange(side.num_nodes)) for side in sides])
        values = np.concatenate([on_slave.ravel(), on_master.ravel()])
        order = np.argsort(dofs)
        change = np.zeros(self.slave.num_nodes)
        for block in blocks:
            place = order[np.searchsorted(dofs[order], np.maximum(block.columns, dofs.min()))]
            direction = np.where(block.columns >= 0, values[place], 0.0)
            np.add.at(change, block.rows, np.einsum("bjq,bq->bj", block.values, direction))
        self.slave.comm.Allreduce(MPI.IN_PLACE, change)
        return change

    def update_active(self, *, start: bool = False) -> int:
        """Set the active set from the complementarity function; return how many nodes changed.

        With ``start`` nodes that touch join it, since before the first solve there is no pressure
        that could tell; multipliers that a failed solve left as nan are forgotten. Those of open
        nodes become what the contact law says.
        """
        z = np.where(np.isfinite(self.z), self.z, 0.0) if start else self.z
        gap, on, o = self.gap, self.covered, self.operators
        if self.state.borne is not None:
            presses, force = self.state.borne
            presses = presses & on
            z = np.where(presses[:, None], force / np.where(presses, o.weight, 1.0)[:, None], z)
        if z is not self.z:
            self.change(z=z, borne=None)
        weight = self.c_n * self.stiffness / self.nodal_lengths
        push = np.where(self.attracted, 0.0, -self.tension)  # what is open bears the adhesion
        trial = np.where(on, push - weight * np.where(on, gap, 0.0), 0.0)
        # Where both pressure and gap are rounding, a node stays as it is.
        rounding = (np.abs(push) <= ROUNDING * self.stiffness) & (
            np.abs(np.nan_to_num(gap)) <= ROUNDING * np.abs(o.x).max()
        )
        active = np.where(rounding, self.active & on, trial > 0.0)
        if start:
            active |= on & (np.where(on, gap, np.inf) <= TOUCHING * self.nodal_lengths)
        changed = active != self.active
        open_z = -self.now.adhesion[0][:, None] * o.n
        self.change(active=active, z=np.where(active[:, None], z, open_z), borne=None)
        piece = self.asker.piece(self.pair.law, self.nodal, self.piece, o.x)
        changed |= active & self.rubs & (piece != self.piece)
        self.change(piece=piece)
        return int(changed.sum())

    def rows(self) -> Rows:
        """Rows of the multipliers; see ``rows``."""
        return rows_of(self.now, self.frame())

    def residual(self) -> Array:
        """Left side of the nonlinear rows, as forces, (slave nodes, 2) [stress length]."""
        return residual_of(self.now)

    def followed(self) -> Array:
        """See ``Interface``: the normal row of an active node holds -k n_j . dd_j."""
        n = self.operators.n * self.active[:, None]
        return -np.einsum("ja,jb->jab", n, n)

    def frame(self) -> Frame:
        """Weights of the rows; see ``rows.Frame``."""
        return frame_of(self.now)

    def law(self, frame: Frame) -> Array:
        """The two rows of each node that solutions make zero, weighted by ``frame``."""
        return law_of(self.now, frame)

    def motion_rows(self) -> Array:
        """Derivative of the rows by the motions of the obstacle, (slave nodes, 2, 3)."""
        return motion_rows_of(self.now, self.frame())

    def gap_by_motions(self) -> Array:
        """Derivative of the mean gaps by the motions, (slave nodes, 3); zero where not covered."""
        return gap_by_motions(self.now)
