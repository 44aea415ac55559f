# SPDX-License-Identifier: MIT
"""Base of contacts and ties: two surfaces, multipliers and their forces."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from fenics_mortar.contact.fields import InterfaceFields
from fenics_mortar.contact.rows import Rows
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.interface.mortar import Block, Linearization, MortarOperators
from fenics_mortar.interface.options import AT_VERTICES
from fenics_mortar.interface.outline import Outline
from fenics_mortar.interface.segments import POINTS, Segments
from fenics_mortar.interface.surfaces import Surface, extract_surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import SurfaceError, place

NO_WELDS: Indices = np.empty((0, 2), np.int64)
NO_PAIRS: tuple[Indices, Indices] = (np.empty(0, np.int64), np.empty(0, np.int64))


def read_only(name: str) -> Any:
    """A read-only attribute of an interface, taken from its state or its present fields."""
    return property(attrgetter(name))


class Interface(ABC):
    """Two surfaces with multipliers z on the slave; nodal forces D^T z and -M^T z.

    The state is a value and is replaced by ``put`` only. ``now`` has the fields computed from state
    and operators; frequently used ones are read-only attributes.

    The class has more than 20 methods, most of one or two lines: they are the interface of a pair
    with any law for equations, linear algebra and certificate.

    Attributes:
        slave, master: The surfaces; one object if a surface may touch itself.
        free: 1 where a component of a slave node is not prescribed, else 0, (slave nodes, 2).
        stiffness: Mean diagonal of the bulk tangent at each slave node, (slave nodes,) [stress],
            times the thickness.
        modulus: ``stiffness`` over the mean thickness at each slave node, (slave nodes,) [stress].
        oblique: Whether the one prescribed component of a slave node is neither along nor across
            its normal, and it still carries a multiplier, shape (slave nodes,), bool.
        stand_ins: Nodes without weight, and the nodes whose fields they show, each (k,).
        now: Fields at the last evaluated displacement and the present state.
    """

    now: InterfaceFields
    offset: Any

    z, active, branch = (
        read_only("_state.z"),
        read_only("_state.active"),
        read_only("_state.branch"),
    )
    multiplier_nodes, redundant = (
        read_only("_state.multiplier_nodes"),
        read_only("_state.redundant"),
    )
    partners, accepted = read_only("_state.partners"), read_only("_state.accepted")
    past, committed = read_only("_state.past"), read_only("_state.committed")
    load_time = read_only("_state.load_time")
    operators, covered, acts = (
        read_only("now.operators"),
        read_only("now.covered"),
        read_only("now.acts"),
    )
    sticking, active_nodes = read_only("now.sticking"), read_only("now.active_nodes")
    pressure, slip, z_tau = read_only("now.pressure"), read_only("now.slip"), read_only("now.z_tau")
    shear, shear_force = read_only("now.shear"), read_only("now.shear_force")
    total_force, steepness = read_only("now.total_force"), read_only("now.steepness")
    gap, closing_gap = read_only("now.gap"), read_only("now.gap")

    def __init__(
        self,
        pair: Any,
        space: DisplacementSpace,
        prescribed: Flags,
        welds: Indices = NO_WELDS,
    ) -> None:
        """Extract the surfaces (collective).

        Args:
            pair: The pair.
            space: Nodes and dofs of the displacement.
            prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
            welds: Pairs of nodes to be merged, shape (k, 2); see ``Surface.welded``.
        """
        self.pair = pair
        tags = pair.data.facet_tags
        slave = extract_surface(space, tags, pair.slave_tags, pair.slave_name)
        self.slave: Surface = slave.welded(welds)
        if pair.master is None:
            self.master: Surface = self.slave
        else:
            self.master = self._master_surface(space).welded(welds)
            self._check_sides()
        count = self.slave.num_nodes
        self.free: Array = 1.0 - self.slave.gather(prescribed.astype(float))
        self.stiffness: Array = np.ones(count)
        self.modulus: Array = self.stiffness / self.slave.mean_thickness
        self._may_carry = np.ones(count, bool)
        self.oblique = np.zeros(count, bool)
        self.at_vertices: bool = pair.discretization.basis in AT_VERTICES
        self.stand_ins = self._find_stand_ins()
        none = np.zeros(count, bool)
        self._state = InterfaceState(
            z=np.zeros((count, 2)), active=none, branch=np.zeros(count, np.int64),
            multiplier_nodes=self._may_carry, redundant=none, offset=np.zeros(count),
        )  # fmt: skip

    @property
    def state(self) -> InterfaceState:
        """The present state."""
        return self._state

    def put(self, state: InterfaceState) -> None:
        """Go to a state; operators stay those of the last evaluated displacement (local)."""
        self._state = state
        if hasattr(self, "now"):
            self.now = self.now.after(state)

    def change(self, **values: Any) -> None:
        """Replace ``values`` of the state (local); see ``put``."""
        self.put(replace(self._state, **values))

    def show(self, operators: MortarOperators) -> None:
        """Set the operators of the present displacement (local)."""
        self.now = self._fields(operators)

    @property
    def full_offset(self) -> Array:
        """The offset, with that of a contact law, shape (slave nodes,) [length]."""
        return np.asarray(self.offset)

    @abstractmethod
    def _fields(self, operators: MortarOperators) -> InterfaceFields:
        """The fields of the present state with these operators."""

    def _find_stand_ins(self) -> tuple[Indices, Indices]:
        """Nodes without weight, and the next nodes that may have a multiplier, each (k,)."""
        alone, step = np.flatnonzero(self.slave.weightless), 1
        if self.at_vertices:
            step = self.slave.degree
        before, after = self.slave.along(alone, range(-step, step + 1, 2 * step)).T
        return alone, np.where(after >= 0, after, before)

    @property
    def has_partner(self) -> Flags:
        """Whether a part of the facets at a slave node is covered, shape (slave nodes,), bool."""
        covered, (alone, others) = self.operators.cover > 0.0, self.stand_ins
        covered[alone] = covered[others]
        return covered

    def set_stiffness(self, stiffness: Array) -> None:
        """Set ``stiffness``, shape (slave nodes,) [stress] (local)."""
        self.stiffness = stiffness
        self.modulus = stiffness / self.slave.mean_thickness
        if hasattr(self, "now"):
            self.show(self.operators)

    @property
    def c_n(self) -> float:
        """Present weight of the gap in the complementarity function [1]. May be set."""
        return self._state.c_n

    @c_n.setter
    def c_n(self, weight: float) -> None:
        self.change(c_n=weight)

    def _master_surface(self, space: DisplacementSpace) -> Surface:
        """Surface of the pair's other side (collective)."""
        name, data = self.pair.master_name, self.pair.data
        return extract_surface(space, data.facet_tags, data.boundary_tags(self.pair.master), name)

    def _check_sides(self) -> None:
        both = np.intersect1d(self.slave.nodes, self.master.nodes)
        if both.size:
            where = self.slave.X[np.flatnonzero(self.slave.nodes == both[0])[0]]
            raise SurfaceError(
                f"slave '{self.pair.slave_name}' and master '{self.pair.master_name}' share "
                f"{both.size} nodes, one at {place(where)}; expected different surfaces that are "
                "not joined in the mesh"
            )

    def see(self, outline: Outline) -> Outline:
        """Receive the outlines of the bodies; return those for the next interface (local)."""
        return outline

    @abstractmethod
    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate operators and fields at the displacement ``u``, (local dofs,) (collective)."""

    def _points(self) -> int:
        """Gauss points per segment, with "elements" per facet.

        Error of a uniform pressure with "elements", independent of the mesh: 0.1 % with 5 points on
        facets with two nodes; 5 % with 5 and 0.4 % with 10 points on facets with three. With fewer
        points than nodes the dual functions of a facet may not exist.
        """
        choice, degree = self.pair.discretization, self.slave.degree
        points = choice.points
        if points is None:
            on_facets = choice.integration == "elements" and self.master.num_nodes > 0
            return POINTS * (degree if on_facets else 1)
        if points <= degree:
            raise ValueError(
                f"points={points}: expected at least one per node of a facet, {degree + 1}"
            )
        return int(points)

    def move(self, z: Array, fraction: float, step: Array) -> None:
        """Apply a fraction of the increment of the multipliers (collective).

        Args:
            z: Multipliers of the linear system, shape (slave nodes, 2) [stress].
            fraction: Fraction of the increment [1].
            step: Full increment of the displacement, shape (owned dofs,) [length].
        """
        self.change(z=self.z + fraction * (z - self.z) if fraction < 1.0 else z)

    @property
    @abstractmethod
    def as_faced(self) -> MortarOperators:
        """Operators at the positions that define the partners."""

    @abstractmethod
    def intersections(self) -> Segments:
        """Intersections of this rank's slave facets with the master, for any integration."""

    @abstractmethod
    def rows(self) -> Rows:
        """Rows of the multipliers, the law of the interface."""

    @abstractmethod
    def residual(self) -> Array:
        """Residual of the rows as forces, shape (slave nodes, 2) [stress length]."""

    @abstractmethod
    def followed(self) -> Array:
        """Diagonal blocks of the rows of active nodes over their stiffness.

        Plus or minus the dyads of the constrained directions, shape (slave nodes, 2, 2) [1].
        """

    @abstractmethod
    def accept(self) -> None:
        """Take the last evaluated state as the accepted one (collective)."""

    @abstractmethod
    def start_step(self) -> None:
        """Start a step at the accepted state (local)."""

    def faced(self) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them in addition to M, each (k,)."""
        return NO_PAIRS

    @property
    def nodal_lengths(self) -> Array:
        """Tributary length of each slave node, undeformed, shape (slave nodes,) [length]."""
        return self.slave.nodal_lengths

    @property
    def nodal_areas(self) -> Array:
        """Nodal lengths times the mean thickness, shape (slave nodes,): size of weights."""
        return self.slave.nodal_areas

    @property
    def nodes(self) -> Indices:
        """Global numbers of the nodes of both sides, shape (slave and master nodes,)."""
        return np.concatenate([self.slave.nodes, self.master.nodes])

    @property
    def candidate_nodes(self) -> Indices:
        """Global numbers of the slave nodes that may carry a multiplier, shape (k,)."""
        return self.slave.nodes[self._may_carry]

    def has_master_of(self, other: Interface) -> bool:
        """Whether the two masters have a common node."""
        return bool(np.intersect1d(self.master.nodes, other.master.nodes).size)

    @property
    def idle_nodes(self) -> Indices:
        """Global numbers of the slave nodes that never carry a multiplier, shape (k,)."""
        return self.slave.nodes[~self._may_carry]

    def force_blocks(self) -> list[Block]:
        """Blocks of B^T, the force by acting multipliers; columns 2 j + component.

        Only nonzero entries, to keep the system sparse.
        """
        o, s = self.operators, self.operators.segments
        return [
            self._force_entries(self.slave, o.facet_nodes, o.facet_nodes, o.D),
            self._force_entries(self.master, s.slave, s.master, -o.M),
        ]

    def _force_entries(self, surface: Surface, j: Indices, k: Indices, values: Array) -> Block:
        """Entries values[b, j, k] (b, 2, 2) of node k of ``surface`` and multiplier j."""
        used = (values != 0.0) & self.acts[j][:, :, None]
        j = np.broadcast_to(j[:, :, None], values.shape)[used]
        k = np.broadcast_to(k[:, None, :], values.shape)[used]
        columns = (2 * j[:, None] + np.arange(2)).reshape(-1, 1)
        rows = surface.dofs[k].reshape(-1, 1)
        return Block(rows, columns, np.repeat(values[used], 2).reshape(-1, 1, 1))
