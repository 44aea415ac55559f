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

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.interface import NO_WELDS, Interface, Rows
from fenics_mortar.contact.law_calls import Asker, raise_noted
from fenics_mortar.contact.laws import KINK, STICK, Frictionless, Nodal, Pieces, Row
from fenics_mortar.contact.multiplier_nodes import Carriers, normals_on_planes
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.slip import Measure, Partners, find_partners
from fenics_mortar.interface.integrals import evaluate_mortar, evaluate_normals
from fenics_mortar.interface.mortar import LINEARIZATIONS, Block, Linearization, MortarOperators
from fenics_mortar.interface.on_obstacle import (
    ObstacleOperators,
    evaluate_obstacle,
    surface_without_nodes,
)
from fenics_mortar.interface.options import MortarOptions
from fenics_mortar.interface.segments import Segments, find_segments
from fenics_mortar.interface.sight import Outline, Sight, View
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arguments import check_lengths
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import SurfaceError, place

# A node counts as covered if the diagonal of D is above this part of its length.
LEAST_NODE_COVER = 1e-10
# A pressure below this part of the stiffness and a gap below this part of the place are rounding.
ROUNDING = 1e-14
# Before the first solve a node is active if it touches: gap below this part of its length.
TOUCHING = 1e-8
# A node lies on the other surface, up to facets that stand for curves, within this part of its
# length.
NEAR = 0.5
# Stiffness of the elastic stick of overheld nodes over that of the bulk. The slip that curvature
# leaves is of second order in the strains e: it makes a shear of 1000 e of the pressure.
ELASTIC = 1e3
# Overlaps of active nodes are told of from so many facets on: iterates of Newton have smaller ones.
MANY = 2.0
# An overlap before the first solve is told of above this part of a node's length.
OVERLAP = 1e-6


class _Reference(NamedTuple):
    """Frozen operators of the undeformed mesh, and what they were evaluated with."""

    operators: Any
    carries: npt.NDArray[np.bool_]
    place: Array


class Contact(Interface):
    """One pair bound to a displacement space: surfaces, multipliers, active set, operators.

    Replicated: every attribute is equal on all ranks, except the blocks inside ``operators``.

    Attributes:
        slave, master: The surfaces.
        z: Multipliers, minus the traction on the slave, shape (slave nodes, 2) [stress].
        active: Active set, shape (slave nodes,), bool.
        piece: Piece of the law that each node is on, 0 where it sticks, shape (slave nodes,).
        overheld: Whether the stick of a node follows from other constraints, so that it sticks
            elastically, shape (slave nodes,), bool; see ``redundancy``.
        partners: What the slave nodes faced at the last accepted state.
        accepted: What they faced when the present state was accepted: the next step's partners.
        operators: D, M, gap and derivatives at the last evaluated state.
        sight: What it sees of the bodies behind the slave, ``None`` of an obstacle.
        offset: Length taken off the pointwise gap, interpolated between the slave nodes, shape
            (slave nodes,) [length]. May be set: to ramp an overlap of the mesh, go with ``t`` from
            0 to 1 by ``contact.offset = (1 - t) * overlap``, where ``overlap`` is
            ``np.nan_to_num(contact.gap).clip(max=0)`` at the start. Another shape, nan and inf are
            refused by a ``ValueError``.
        obstacle: The rigid master, or ``None``.
        arm: What its angle is multiplied by to be a turn [length].
        c_n: Weight of the gap at present; less than the pair's after a cycle of the active set.
        free: 1 where a component of a slave node is not prescribed, else 0, (slave nodes, 2).
        master_free: The same of the master nodes, (master nodes, 2).
        carries: Whether a slave node carries a multiplier, shape (slave nodes,), bool: not if it is
            held, nor while it is hardly covered.
        oblique: Whether the one prescribed component of a slave node is neither along nor across
            its normal, shape (slave nodes,), bool.
        asker: Asks the law of the pair.
    """

    def __init__(
        self,
        pair: ContactPair,
        space: DisplacementSpace,
        prescribed: npt.NDArray[np.bool_],
        welds: Indices = NO_WELDS,
    ) -> None:
        """Extract the surfaces (collective); see ``Interface``."""
        self.obstacle = pair.master if isinstance(pair.master, Obstacle) else None
        super().__init__(pair, space, prescribed, welds)
        normals, _ = evaluate_normals(self.slave, self.slave.X, pair.normals)
        self._carriers = Carriers(self.slave, normals, self.free, at_vertices=self._at_vertices)
        self._master_planes = self._find_master_planes(prescribed)
        self.master_free: Array = 1.0 - self.master.gather(prescribed.astype(float))
        self.carries = self._may_carry = self._carriers.possible
        self.oblique = self._carriers.oblique
        self.overheld = np.zeros(self.slave.num_nodes, bool)
        if not self.carries.any():
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
        self.offset = np.zeros(self.slave.num_nodes)
        self.c_n = pair.c_n
        self._reference: _Reference | None = None
        self.sight: Sight | None = None
        self._view: View | None = None
        self._borne: tuple[npt.NDArray[np.bool_], Array] | None = None
        self.partners: Partners
        self.accepted: Partners
        none = np.zeros(self.slave.num_nodes)
        self._nothing = none, none
        start = Nodal(none, none, none, none, none + 1.0, none)
        self.asker = Asker(pair.slave_name)
        at_rest = np.zeros(none.size, np.int64)
        self.piece: Pieces = self.asker.piece(pair.law, start, at_rest, self.slave.X)
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

    def _find_master_planes(self, prescribed: npt.NDArray[np.bool_]) -> Array:
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
        return self._offset

    @offset.setter
    def offset(self, lengths: Array) -> None:
        self._offset = check_lengths("offset", lengths, self.slave.num_nodes)

    @property
    def covered(self) -> npt.NDArray[np.bool_]:
        """Whether a slave node has a multiplier and a partner at the last evaluated state."""
        enough = self.operators.diagonal > LEAST_NODE_COVER * self.nodal_lengths
        return self.carries & enough

    @property
    def _mean_gap(self) -> Array:
        """Mean gap of every covered node, zero elsewhere, shape (slave nodes,) [length]."""
        o, on = self.operators, self.covered
        return np.where(on, o.gap / np.where(on, o.weight, 1.0), 0.0)

    @property
    def _adhesion(self) -> tuple[Array, Array]:
        """A at the mean gaps of covered nodes [stress], and its derivative; zero elsewhere.

        Overlaps have the straight continuation of a from zero.
        """
        if not self.pair.law.attracts:
            return self._nothing
        gap, on = self._mean_gap, self.covered
        open_gap = np.maximum(gap, 0.0)
        pull, by_gap = self.asker.adhesion(self.pair.law, open_gap, self.operators.x)
        pull = pull + by_gap * np.minimum(gap, 0.0)
        return np.where(on, pull, 0.0), np.where(on, by_gap, 0.0)

    @property
    def attracted(self) -> npt.NDArray[np.bool_]:
        """Whether an open node bears the adhesion of the contact law, (slave nodes,), bool."""
        return (self._adhesion[0] > 0.0) & ~self.active

    @property
    def acts(self) -> npt.NDArray[np.bool_]:
        """See ``Interface``."""
        return self.active | self.attracted

    @property
    def tension(self) -> Array:
        """Pull -z_n of each node beyond what the law allows, negative if less, (slave nodes,)."""
        return -(np.einsum("ja,ja->j", self.operators.n, self.z) + self._adhesion[0])

    @property
    def gap(self) -> Array:
        """Mean gap g_j / w_j of every covered slave node, nan elsewhere, (slave nodes,)."""
        gap = np.full(self.slave.num_nodes, np.nan)
        on = self.covered
        gap[on] = self.operators.gap[on] / self.operators.weight[on]
        return self._fill_inside(gap)

    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate the operators at the displacement ``u``, a local array (collective)."""
        view, x, m = self._look(u)
        if self.pair.sliding == "small":
            operators = self._after_small_motion(x, m)
        else:
            operators = self._evaluate(x, m, linearization, view)
        self.operators = operators.less_offset(self.offset) if self.offset.any() else operators
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
        planes, self._view = self._carriers.plane_normals, view
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
        kept = self._reference
        if kept is None or not np.array_equal(kept.carries, self.carries):
            kept = self._refer()
        if self.obstacle is None:
            return kept.operators.after_small_motion(x, m)
        dq = (self.obstacle.place - kept.place) * [1.0, 1.0, self.arm]
        return kept.operators.after_small_motion(x, m, dq)

    def _refer(self) -> _Reference:
        """Evaluate the operators of the undeformed mesh (collective)."""
        view, X, X_master = self._look(None)
        operators = self._evaluate(X, X_master, LINEARIZATIONS["frozen"], view).freeze()
        place = np.zeros(3) if self.obstacle is None else self.obstacle.place.copy()
        self._reference = _Reference(operators, self.carries.copy(), place)
        return self._reference

    @property
    def reference_place(self) -> Array:
        """Where the obstacle was for the operators of the undeformed mesh, (3,); nan if none."""
        return np.full(3, np.nan) if self._reference is None else self._reference.place

    def refer_to(self, place: Array, carries: npt.NDArray[np.bool_]) -> None:
        """Evaluate the operators of the undeformed mesh as they once were (collective).

        Args:
            place: ``reference_place`` of then, shape (3,); nan: there were none.
            carries: Nodes with multipliers of then, shape (slave nodes,).
        """
        self._reference, self.carries = None, carries.copy()
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
        if self.pair.sliding == "small" and self._reference is not None:
            return self._reference.operators
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
        self.offset, self.c_n = other.offset, other.c_n
        self._reference = other._reference or self._reference
        self._view = other._view or self._view

    def begin(self) -> None:
        """Forget how often nodes changed in the last solve, and what they bore."""
        self._carriers.begin()
        self._borne = None

    def move(self, z: Array, part: float, step: Array) -> None:
        """See ``Interface``; notes the nodes that press though their multipliers pull (collective).

        A linear system knows the force w z of a node to first order, w_old z + dw z_old. As the
        weight of a node more than doubles, at an edge that slides, the second term alone may be
        more than the force, and z pulls to make up for it. Such a node would be released, to come
        back an iteration or two later; it is its force that says if it presses.
        """
        old, o = self.z, self.operators
        super().move(z, part, step)
        pulls, self._borne = self.active & (self.tension > 0.0), None
        if pulls.any():
            sides = self.slave.gather(step), self.master.gather(step)
            change = part * self._change(o.weight_derivative(), *sides)
            pulls &= change > o.weight
            force = o.weight[:, None] * self.z + change[:, None] * old
            least = -o.weight * self._adhesion[0]
            self._borne = pulls & (np.einsum("ja,ja->j", o.n, force) > least), force

    def take(self, z: Array) -> None:
        """See ``Interface``; what nodes bore on the way elsewhere says nothing here."""
        super().take(z)
        self._borne = None

    def accept(self, slid: npt.NDArray[np.bool_] | None = None) -> None:
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
        self.accepted = replace(accepted, start=accepted.start - slip, shear=shear)

    def start_step(self) -> None:
        """Count slip from the accepted state."""
        self.partners = self.accepted

    def faced(self) -> tuple[Indices, Indices]:
        """Slave nodes, and the master nodes that slip couples them to."""
        return self.partners.pairs() if self.pair.law.rubs else super().faced()

    @property
    def nodal(self) -> Nodal:
        """What the law sees, at the last evaluated state."""
        o, stiffness = self.operators, self.stiffness / self.nodal_lengths
        return Nodal(
            gap=self._mean_gap,
            slip=self.slip,
            z_n=np.einsum("ja,ja->j", o.n, self.z),
            z_tau=self.z_tau,
            stiffness=stiffness,
            c_n=self.c_n * stiffness,
        )

    @property
    def slip(self) -> Array:
        """Slip along tau since the last accepted step, shape (slave nodes,) [length].

        Zero on symmetry planes: across them nothing slips, but the partners are on one side.
        """
        on_plane = np.isfinite(self._carriers.plane_normals[:, 0])
        return np.where(on_plane, 0.0, self.partners.slip(self.operators))

    @property
    def sticking(self) -> npt.NDArray[np.bool_]:
        """Whether an active node sticks, shape (slave nodes,), bool."""
        return self.active & (self.piece == STICK) & self._rubs

    @property
    def sliding(self) -> npt.NDArray[np.bool_]:
        """Whether an active node slides against friction, shape (slave nodes,), bool."""
        rubs = self._rubs & (self.pair.law.bound(self.pressure) > 0.0)
        return self.active & (self.piece != STICK) & rubs

    @property
    def friction_work(self) -> float:
        """What friction takes up in a step, by the shear at its end [stress length^2]."""
        return float(self.shear_force @ np.where(self.active, self.slip, 0.0))

    @property
    def _rubs(self) -> npt.NDArray[np.bool_]:
        """Whether a node follows the law: not if one of its components is prescribed."""
        return self.free.all(axis=1)

    def tangential_row(self) -> Row:
        """Tangential row of all nodes, open ones as if they were active, each (slave nodes,).

        Overheld nodes stick elastically, z_tau = z_tau,old + (k / l) u; see ``redundancy``.
        """
        node, rubs = self.nodal, self._rubs & ~self.attracted
        law, x = self.pair.law, self.operators.x
        ours = self.asker.tangential(law, node, self.piece, rubs, x)
        without = Frictionless().tangential(node, self.piece)
        row = Row(*(np.where(rubs, a, b) for a, b in zip(ours, without, strict=True)))
        if not self.overheld.any():
            return row
        k, zero = node.stiffness, np.zeros_like(node.slip)
        shear = (node.z_tau - self.partners.shear) / ELASTIC
        elastic = Row(shear - k * node.slip, zero, -k, zero, zero + 1.0 / ELASTIC)
        return Row(*(np.where(self.overheld, a, b) for a, b in zip(elastic, row, strict=True)))

    @property
    def steepness(self) -> float:
        """See ``Interface``: laws of the package are no steeper than the bulk is stiff."""
        if self.pair.law.is_of_package:
            return 0.0
        force = self.operators.diagonal * np.abs(self.tangential_row().by_slip)
        return float(force[self.active].max(initial=0.0))

    def _law_rows(self) -> tuple[Row, Row]:
        """What the contact law says along tau, and along n of open nodes; each (slave nodes,)."""
        (pull, by_gap), none = self._adhesion, np.zeros(len(self.z))
        z_n = np.einsum("ja,ja->j", self.operators.n, self.z)
        return self.tangential_row(), Row(z_n + pull, by_gap, none, none + 1.0, none)

    def update_carriers(self) -> int:
        """Hand over and take back multipliers, see ``carriers``; return how many changed.

        The operators have to be evaluated anew then. Points at the nodes cover a node or they do
        not, there is nothing to hand over.
        """
        if self.options.integration == "nodes":
            return 0
        before, cover = self.carries, self.operators.cover / self.nodal_lengths
        self.carries = self._carriers.update(before, cover)
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

    def slip_rate(self, on_slave: Array, on_master: Array) -> Array:
        """Slip of the nodes along their partners by displacements of both sides, (slave nodes,).

        Args:
            on_slave: Displacements of the slave nodes, shape (n, 2).
            on_master: Displacements of the master nodes, shape (n, 2).
        """
        relative = self.partners.D @ on_slave - self.partners.M @ on_master
        return np.asarray(np.einsum("ja,ja->j", self.operators.tau, relative))

    def opening_rate(self, on_slave: Array, on_master: Array) -> Array:
        """Opening along n, against which the pressure does work; see ``slip_rate``.

        The gap changes at another rate where n is not normal to both sides, as at corners.
        """
        relative = self.partners.D @ on_slave - self.partners.M @ on_master
        return -np.asarray(np.einsum("ja,ja->j", self.operators.n, relative))

    def strength(self, pressure: float) -> tuple[Array, Array, Array]:
        """Contact tractions that the law admits, about a pressure p, each (slave nodes,).

        Returns:
            Slope mu and shear s_0 of the line |z_tau| <= s_0 + mu z_n through the friction limits
            at p and 2 p, which bounds a concave limit from above outside of these; mu is inf where
            there is no limit. Third, the adhesion of a closed gap [stress].
        """
        law = self.pair.law
        ones, X = np.ones(len(self.z)), self.slave.X
        at = self.asker.bound(law, pressure * ones, X)
        beyond = self.asker.bound(law, 2.0 * pressure * ones, X)
        unlimited = np.isinf(at + beyond)
        at, beyond = (np.where(unlimited, 0.0, limit) for limit in (at, beyond))
        slope = (beyond - at) / pressure if pressure > 0.0 else np.zeros_like(at)
        shear = np.maximum(at - slope * pressure, 0.0)
        shear = np.where(self._rubs & (shear > KINK * at), shear, 0.0)
        slope = np.where(self._rubs, np.where(unlimited, np.inf, slope), 0.0)
        return slope, shear, self.asker.adhesion(law, 0.0 * ones, X)[0]

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
        if start:
            self.z[~np.isfinite(self.z)] = 0.0
        gap, on = self.gap, self.covered
        if self._borne is not None:
            (presses, force), self._borne = self._borne, None
            presses = presses & on
            self.z[presses] = force[presses] / self.operators.weight[presses, None]
        weight = self.c_n * self.stiffness / self.nodal_lengths
        push = np.where(self.attracted, 0.0, -self.tension)  # what is open bears the adhesion
        trial = np.where(on, push - weight * np.where(on, gap, 0.0), 0.0)
        # Where both pressure and gap are rounding, a node stays as it is.
        rounding = (np.abs(push) <= ROUNDING * self.stiffness) & (
            np.abs(np.nan_to_num(gap)) <= ROUNDING * np.abs(self.operators.x).max()
        )
        active = np.where(rounding, self.active & on, trial > 0.0)
        if start:
            active |= on & (np.where(on, gap, np.inf) <= TOUCHING * self.nodal_lengths)
        changed = active != self.active
        self.active = active
        self.z[~active] = -self._adhesion[0][~active, None] * self.operators.n[~active]
        law, x = self.pair.law, self.operators.x
        piece = self.asker.piece(law, self.nodal, self.piece, x)
        changed |= active & self._rubs & (piece != self.piece)
        self.piece = piece
        return int(changed.sum())

    def rows(self) -> Rows:
        """Rows of the multipliers: the gap, and what the contact law says.

        That of the gap is weighted by k_j / D_jj, those of the law by D_jj, so that all read like
        rows of the bulk; the two are then turned back to Cartesian components: n (row of the gap)
        - tau (tangential row), or of an open node - n (normal row) - tau (tangential row).
        """
        o = self.operators
        normal, idle, *laws = self.frame()
        blocks: list[Block] = []
        rhs, by_gap = -normal * o.gap[:, None], np.zeros_like(normal)
        A_z = -idle[:, None, None] * np.eye(2)
        for scaled, row in zip(laws, self._law_rows(), strict=True):
            by_z = row.by_z_tau[:, None] * o.tau + row.by_z_n[:, None] * o.n
            A_z = A_z - scaled[:, :, None] * by_z[:, None, :]
            rhs = rhs + scaled * (row.residual - np.einsum("ja,ja->j", by_z, self.z))[:, None]
            if scaled.any():
                blocks += self._nodal_rows(scaled, row)
            by_gap = by_gap + scaled * row.by_gap[:, None]
        return Rows([*self._gap_rows(normal, by_gap), *blocks], A_z, rhs)

    def residual(self) -> Array:
        """What the rows make zero, as forces: gap and contact law, (slave nodes, 2)."""
        tangential, opening = (row.residual for row in self._law_rows())
        gap = np.where(self.active, self.stiffness * np.nan_to_num(self.gap), 0.0)
        normal = np.where(self.attracted, self.operators.diagonal * opening, gap)
        return np.stack([normal, np.where(self.acts, self.operators.diagonal * tangential, 0.0)], 1)

    def followed(self) -> Array:
        """See ``Interface``: the normal row of an active node holds -k n_j . dd_j."""
        n = self.operators.n * self.active[:, None]
        return -np.einsum("ja,jb->jab", n, n)

    def frame(self) -> tuple[Array, Array, Array, Array]:
        """What weighs gaps, multipliers that do not act, and the two rows of the law.

        n k / D, the nodes' lengths, tau D, and n D of open nodes; zero for nodes that have no such
        row. Shapes (slave nodes, 2), (slave nodes,), (slave nodes, 2), (slave nodes, 2).
        """
        o, attracted = self.operators, self.attracted
        acts = self.active | attracted
        diagonal = np.where(acts, o.diagonal, self.nodal_lengths)
        closing = np.where(self.active, self.stiffness / diagonal, 0.0)
        idle = np.where(acts, 0.0, diagonal)
        along, opening = diagonal * acts, diagonal * attracted
        return o.n * closing[:, None], idle, o.tau * along[:, None], o.n * opening[:, None]

    def law(self, frame: tuple[Array, Array, Array, Array]) -> Array:
        """The two rows of each node that solutions make zero, weighted by ``frame``."""
        normal, idle, *laws = frame
        rows = normal * self.operators.gap[:, None] - idle[:, None] * self.z
        for scaled, row in zip(laws, self._law_rows(), strict=True):
            rows = rows - scaled * row.residual[:, None]
        return rows

    def _gap_rows(self, normal: Array, scaled_tau: Array) -> list[Block]:
        """Rows ``normal`` (slave nodes, 2) dg - ``scaled_tau`` d(g / w)."""
        o = self.operators
        per_weight = np.where(self.covered, 1.0 / np.where(self.covered, o.weight, 1.0), 0.0)
        along = scaled_tau * per_weight[:, None]
        blocks = [_normal_rows(block, normal - along) for block in o.gap_derivative()]
        if along.any():
            mean = along * (o.gap * per_weight)[:, None]
            blocks += [_normal_rows(block, mean) for block in o.weight_derivative()]
        return blocks

    def _nodal_rows(self, scaled: Array, row: Row) -> Iterator[Block]:
        """Rows -``scaled`` (slave nodes, 2) d(rho), but for the gaps in rho.

        The change of n and tau is that of the nodes that this rank owns.
        """
        o, j = self.operators, self.slave.owned[self.acts[self.slave.owned]]
        by_slip = scaled * row.by_slip[:, None]
        change = (
            row.by_z_tau[:, None] * o.tangential_derivative(self.z)
            + row.by_z_n[:, None] * o.normal_derivative(self.z)
            + row.by_slip[:, None] * o.tangential_derivative(self.partners.apart(o))
        )
        rows = 2 * j[:, None] + np.arange(2)
        yield Block(rows, o.normal_columns()[j], -scaled[j][:, :, None] * change[j][:, None, :])
        if by_slip.any():
            for block in self.partners.derivative(o):
                yield _normal_rows(block, -by_slip)

    def motion_rows(self) -> Array:
        """Derivative of the same rows by the motions of the obstacle, (slave nodes, 2, 3)."""
        o = self.on_obstacle
        normal, _, *laws = self.frame()
        shear = self.z[:, 1:] * o.dn_dq[:, 0] - self.z[:, :1] * o.dn_dq[:, 1]
        pressure = np.einsum("ja,jam->jm", self.z, o.dn_dq)
        slip = self.partners.derivative_by_motions(o)
        rows = np.einsum("ja,jm->jam", normal, o.dgap_dq)
        for scaled, row in zip(laws, self._law_rows(), strict=True):
            change = (
                row.by_z_tau[:, None] * shear
                + row.by_z_n[:, None] * pressure
                + row.by_slip[:, None] * slip
                + row.by_gap[:, None] * self.gap_by_motions()
            )
            rows = rows - np.einsum("ja,jm->jam", scaled, change)
        return rows

    def gap_by_motions(self) -> Array:
        """Derivative of the mean gaps by the motions, (slave nodes, 3); zero where not covered."""
        o, on = self.on_obstacle, self.covered[:, None]
        return np.where(on, o.dgap_dq / np.where(on, o.weight[:, None], 1.0), 0.0)

    @property
    def on_obstacle(self) -> ObstacleOperators:
        """The operators of a pair with an obstacle."""
        assert isinstance(self.operators, ObstacleOperators)
        return self.operators


def _normal_rows(block: Block, direction: Array) -> Block:
    """Turn rows of the weighted gap into two rows a node, along ``direction`` (slave nodes, 2)."""
    values = np.einsum("bja,bjq->bjaq", direction[block.rows], block.values)
    shape = len(block.rows), 2 * block.rows.shape[1]
    rows = (2 * block.rows[:, :, None] + np.arange(2)).reshape(shape)
    return Block(rows, block.columns, values.reshape(*shape, block.columns.shape[1]))
