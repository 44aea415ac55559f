# SPDX-License-Identifier: MIT
"""Base of contacts and ties: two surfaces, their state, multipliers and forces."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import Any

import numpy as np

from fenics_mortar.contact.components import Components
from fenics_mortar.contact.interface_fields import InterfaceFields
from fenics_mortar.contact.rows import InterfaceRows
from fenics_mortar.contact.sides import at_tips, substitutes_of, surfaces_of
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.interface.mortar import Block, Linearization, MortarOperators
from fenics_mortar.interface.outline import Outline
from fenics_mortar.interface.segments import AT_VERTICES, Basis, Segments, basis_on
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array, Flags, Indices

NO_WELDS: Indices = np.empty((0, 2), np.int64)
NO_NODES: Indices = np.empty(0, np.int64)
NO_FLUXES: list[Any] = []
NO_PAIRS: tuple[Indices, Indices] = (np.empty(0, np.int64), np.empty(0, np.int64))


def read_only(name: str) -> Any:
    """Read-only attribute of an interface, an attribute of its state or of its present fields."""
    return property(attrgetter(name))


def settable(name: str, check: Callable[[Any, Any], Any]) -> Any:
    """Attribute of the state that may be set; the value is ``check(interface, value)``."""

    def change(interface: Any, value: Any) -> None:
        interface.change(**{name: check(interface, value)})

    return property(attrgetter(f"_state.{name}"), change)


class Interface(ABC):
    """Two surfaces with multipliers z on the slave; nodal forces D^T z and -M^T z.

    The state is a value and is replaced by ``put`` only. ``now`` has the fields computed from state
    and operators; frequently used ones are read-only attributes.

    Attributes:
        pair: The pair.
        slave, master: The surfaces; one object if a surface may touch itself.
        obstacle: The rigid master, or ``None``.
        basis: Basis of the multipliers on the slave, see ``options.basis_on``.
        shared: Whether a slave node is also a node of the other face, at the tip of a crack, shape
            (slave nodes,), bool.
        free: 1 where a component of a slave node is not prescribed, else 0, (slave nodes,
            dim).
        stiffness: Mean diagonal of the bulk tangent at each slave node, (slave nodes,) [stress],
            times the thickness.
        modulus: ``stiffness`` over the mean thickness at each slave node, (slave nodes,) [stress].
        foundation: ``modulus`` over the node's length, (slave nodes,) [stress / length].
        may_carry: Whether a slave node ever carries a multiplier, shape (slave nodes,), bool.
        oblique: Whether the one prescribed component of a slave node is neither along nor across
            its normal, and it carries a multiplier, shape (slave nodes,), bool.
        substitutes: Nodes without weight, and the nodes whose fields are shown in their place, each
            (k,).
        rows: Rows of the multipliers, the law of the interface.
        components: Dofs and scales of the components of the multipliers.
        fluxes: Fluxes of scalar fields across the interface, see ``fluxes``.
        all_fluxes: These, and those of fields that are solved for in other problems.
        state: The present state.
        now: Fields at the last evaluated displacement and the present state.
        z: Multipliers, shape (slave nodes, c); c is dim, on a tie dim and the number of tied
            fields.
        z_u: Its components of the displacement, shape (slave nodes, dim) [stress].
        c_n: Present weight of the gap in the complementarity function [1]. May be set.
        offset: Length subtracted from the pointwise gap, shape (slave nodes,) [length].
    """

    now: InterfaceFields
    rows: InterfaceRows
    offset: Any
    _kind: type[InterfaceFields]

    state, c_n = read_only("_state"), settable("c_n", lambda _, weight: weight)
    z, active = read_only("_state.z"), read_only("_state.active")
    branch, multiplier_nodes = read_only("_state.branch"), read_only("_state.multiplier_nodes")
    redundant, partners = read_only("_state.redundant"), read_only("_state.partners")
    accepted_partners, heading = read_only("_state.accepted_partners"), read_only("_state.heading")
    accepted_instant = read_only("_state.accepted_instant")
    operators, gap = read_only("now.operators"), read_only("now.gap")
    covered, acts = read_only("now.covered"), read_only("now.acts")
    sticking, active_nodes = read_only("now.sticking"), read_only("now.active_nodes")
    pressure, slip, z_tau = read_only("now.pressure"), read_only("now.slip"), read_only("now.z_tau")
    shear, shear_force = read_only("now.shear"), read_only("now.shear_force")
    total_force, z_u = read_only("now.total_force"), read_only("now.z_u")

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
        self.slave: Any
        self.master: Any
        self.slave, self.master = surfaces_of(pair, space, welds)
        self.obstacle = pair.master if isinstance(pair.master, Obstacle) else None
        count = self.slave.num_nodes
        self.shared: Flags = at_tips(self.slave, self.master)
        self.free: Array = 1.0 - self.slave.gather(prescribed.astype(float))
        self.stiffness: Array
        self.modulus: Array
        self.foundation: Array
        self.set_stiffness(np.ones(count))
        self.may_carry = np.ones(count, bool)
        self.oblique = np.zeros(count, bool)
        self.basis: Basis = basis_on(self.slave, pair.discretization.basis)
        self.at_vertices: bool = self.basis in AT_VERTICES
        self.all_fluxes: list[Any] = NO_FLUXES
        self.fluxes, self.components = NO_FLUXES, Components(self)
        self.substitutes = substitutes_of(self.slave, at_vertices=self.at_vertices)
        none = np.zeros(count, bool)
        self._state = InterfaceState(
            z=np.zeros((count, self.slave.dim)), active=none, branch=np.zeros(count, np.int64),
            multiplier_nodes=self.may_carry, redundant=none, offset=np.zeros(count),
        )  # fmt: skip

    def put(self, state: InterfaceState) -> None:
        """Replace the state; the operators of the last evaluated displacement are kept (local)."""
        self._state = state
        if hasattr(self, "now"):
            self.now = self.now.after(state)

    def change(self, **values: Any) -> None:
        """Replace ``values`` of the state (local); see ``put``."""
        self.put(self._state.replaced(**values))

    def set_operators(self, operators: MortarOperators) -> None:
        """Set the operators of the present displacement (local)."""
        self.now = self._kind(self, self._state, operators)

    def set_stiffness(self, stiffness: Array) -> None:
        """Set ``stiffness``, shape (slave nodes,) [stress] (local)."""
        self.stiffness = stiffness
        self.modulus = stiffness / self.slave.mean_thickness
        self.foundation = self.modulus / self.slave.nodal_lengths
        if hasattr(self, "now"):
            self.set_operators(self.operators)

    def limit_sight(self, outline: Outline) -> Outline:
        """Store the outlines of the bodies; return those for the next interface (local)."""
        return outline

    @abstractmethod
    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate operators and fields at the displacement ``u``, (local dofs,) (collective)."""

    @property
    @abstractmethod
    def partner_operators(self) -> Any:
        """Operators at the positions that define the partners."""

    @abstractmethod
    def intersections(self) -> Segments:
        """Intersections of this rank's slave facets with the master, for any integration."""

    # Solution and steps

    def begin(self) -> None:
        """Begin a solve (local); without effect on a tie."""

    @abstractmethod
    def update_active(self, *, start: bool = False) -> int:
        """Update the active set; return the number of changes (local)."""

    def update_multiplier_nodes(self) -> int:
        """Update the multiplier nodes; return the number of changes (local)."""
        return 0

    def move(self, z: Array, fraction: float, step: Array) -> None:
        """Apply a fraction of the increment of the multipliers (collective).

        Args:
            z: Multipliers of the linear system, shape (slave nodes, c) [stress].
            fraction: Fraction of the increment [1].
            step: Full increment of the displacement, shape (owned dofs,) [length].
        """
        self.change(z=self.z + fraction * (z - self.z) if fraction < 1.0 else z)

    def accept(self, slid: Flags | None = None) -> None:
        """Accept the last evaluated state (collective); no effect on a tie.

        Args:
            slid: Nodes that keep their present slip, shape (slave nodes,), bool.
        """

    def start_step(self) -> None:
        """Start a step at the accepted state (local); without effect on a tie."""

    def set_initial_gap(self) -> None:
        """Set the offset for the pair's ``initial_gap`` (local); without effect on a tie."""

    # Nodes and forces

    def add_loads(self, target: Array) -> None:
        """Add B^T z and the loads of fluxes (collective).

        Args:
            target: Local array, shape (owned dofs,) or longer [stress length], those of fluxes
                [flux length]; changed in place.
        """
        on_slave, on_master = self.now.forces
        self.slave.scatter_add(on_slave, target)
        self.master.scatter_add(on_master, target)
        for flux in self.fluxes:
            flux.add_loads(target)

    def load_blocks(self) -> list[Block]:
        """Blocks of all loads' derivatives by z; columns index z.ravel() (collective)."""
        return [*self.force_blocks(), *self.flux_blocks()]

    def flux_blocks(self) -> list[Block]:
        """Blocks of the fluxes' derivatives by z; columns index z.ravel() (collective)."""
        return [flux.by_multipliers() for flux in self.fluxes]

    def coupled_by_slip(self) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them in addition to M, each (k,)."""
        return NO_PAIRS

    @property
    def nodes(self) -> Indices:
        """Global numbers of the nodes of both sides, shape (slave and master nodes,)."""
        return np.concatenate([self.slave.nodes, self.master.nodes])

    def force_blocks(self) -> list[Block]:
        """Blocks of B^T, the force by acting multipliers; columns index z.ravel().

        Only nonzero entries, to keep the system sparse. Without ``flux_blocks``.
        """
        blocks, count = [], self.z.shape[1]
        for dofs, j, values in self.force_entries():
            dim = dofs.shape[1]
            columns = (count * j[:, None] + np.arange(dim)).reshape(-1, 1)
            blocks.append(
                Block(dofs.reshape(-1, 1), columns, np.repeat(values, dim).reshape(-1, 1, 1))
            )
        return blocks

    def force_entries(self) -> Iterator[tuple[Indices, Indices, Array]]:
        """Dofs (p, dim), nodes of acting multipliers (p,), D and -M (p,) [length] of each side."""
        for side, (j, k, values) in zip(
            (self.slave, self.master), acting_entries(self.operators, self.acts), strict=True
        ):
            yield side.dofs[k], j, values


def acting_entries(o: MortarOperators, acts: Flags) -> Iterator[tuple[Indices, Indices, Array]]:
    """Nonzero entries of D, then of -M, in this rank's rows of acting multipliers (local).

    Args:
        o: The operators.
        acts: Whether a multiplier acts, shape (slave nodes,), bool.

    Yields:
        Slave nodes of the multipliers, nodes of the side and values [length], (p,) each.
    """
    s, nodes = o.segments, o.facet_nodes
    for j, k, values in ((nodes, nodes, o.D), (s.slave, s.master, -o.M)):
        used = (values != 0.0) & acts[j][:, :, None]
        places = (np.broadcast_to(p, values.shape)[used] for p in (j[:, :, None], k[:, None, :]))
        yield *places, values[used]
