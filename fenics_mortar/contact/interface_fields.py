# SPDX-License-Identifier: MIT
"""Nodal fields of any interface, computed once from its state and its operators.

A field is computed when first read, and cached. New operators invalidate all fields; a new state
invalidates the fields that depend on a changed attribute. Each field lists the attributes of the
state on which it depends.

State of an interface: all quantities that a solve changes or passes to the next solve.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from fenics_mortar.contact.law_calls import Instant
from fenics_mortar.utils.arrays import Array, Flags, Indices, Value

if TYPE_CHECKING:
    from fenics_mortar.contact.law import Branches

# Attributes that follow from the others at the end of a solve; they are not written to files.
# Instants are written by ``io.checkpoint``.
DERIVED = {"derived": True}
# Time and memory before the first step, without a law.
FIRST = Instant.of(0.0, 1.0, {})


@dataclasses.dataclass(frozen=True, eq=False)
class InterfaceState(Value):
    """State of one interface, a value: ``dataclasses.replace`` makes another one.

    Arrays are read-only and equal on all ranks.

    Attributes:
        z: Multipliers, minus the traction on the slave, shape (slave nodes, 2) [stress]; on a tie
            with fields, further columns with their fluxes.
        conduction: Multipliers of the conductances of a contact, the flux of each at the carriers,
            zero elsewhere, shape (slave nodes, conductances) [flux]; see ``fluxes``.
        active: Active set, shape (slave nodes,), bool.
        branch: Branch of the law that each node is on, 0 where it sticks, shape (slave nodes,).
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool:
            false if it is prescribed or hardly covered.
        redundant: Whether the stick of a node follows from other constraints, so that it sticks
            elastically, shape (slave nodes,), bool; see ``linearized_contact``.
        partners: Material points that slip is counted from, the ``Partners`` of the slave nodes at
            the start of the step; ``None`` for a tie.
        accepted_partners: Partners at the last accepted state, used in the next step.
        c_n: Weight of the gap in the complementarity function [1]; reduced below the pair's value
            after a cycle of the active set.
        offset: Length subtracted from the pointwise gap, shape (slave nodes,) [length].
        reference: Operators of the undeformed mesh, with small sliding.
        load_time: Time of the present loads, at the end of the step [time].
        start_instant: ``Instant`` at the start of the step; the law reads its memory.
        accepted_instant: ``Instant`` of the last accepted state, used in the next step.
        force_decided: Nodes with tensile multiplier and compressive force, shape (slave nodes,),
            bool, and the forces of all nodes, shape (slave nodes, 2) [stress length], for the next
            active set; see ``Contact.move``.
        heading: In space, the directions in which nodes slid in the last iteration, zero where they
            did not, (slave nodes, 3) [1], and how often each has turned back in this solve, (slave
            nodes,), int; see ``rows``.
    """

    z: Array
    active: Flags
    branch: Branches
    multiplier_nodes: Flags
    redundant: Flags = dataclasses.field(metadata=DERIVED)
    partners: Any = dataclasses.field(default=None, metadata=DERIVED)
    accepted_partners: Any = dataclasses.field(default=None, metadata=DERIVED)
    c_n: float = 1.0
    offset: Any = 0.0
    conduction: Any = 0.0
    reference: Any = dataclasses.field(default=None, metadata=DERIVED)
    load_time: float = dataclasses.field(default=0.0, metadata=DERIVED)
    start_instant: Instant = dataclasses.field(default=FIRST, metadata=DERIVED)
    accepted_instant: Instant = dataclasses.field(default=FIRST, metadata=DERIVED)
    force_decided: tuple[Flags, Array] | None = dataclasses.field(default=None, metadata=DERIVED)
    heading: tuple[Array, Array] | None = dataclasses.field(default=None, metadata=DERIVED)

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of nodes, components and, of a contact, nodes and conductances (local)."""
        return *self.z.shape, *np.shape(self.conduction)

    def towards(self, other: InterfaceState, fraction: float) -> InterfaceState:
        """Interpolate the multipliers to ``other`` by a ``fraction`` [1] (local)."""
        z, q = self.z, self.conduction
        return self.replaced(
            z=z + fraction * (other.z - z), conduction=q + fraction * (other.conduction - q)
        )


# Names of the attributes that determine all others.
INDEPENDENT = tuple(
    attribute.name for attribute in dataclasses.fields(InterfaceState) if not attribute.metadata
)


class _Field:
    """A field that is cached until one of the named attributes of the state changes."""

    def __init__(self, function: Callable[[Any], Any], names: frozenset[str]) -> None:
        self.func, self.names, self.__doc__ = function, names, function.__doc__

    def __set_name__(self, _: type, name: str) -> None:
        self._name = name

    def __get__(self, fields: Any, _: type | None = None) -> Any:
        if fields is None:
            return self
        value = vars(fields)[self._name] = self.func(fields)
        return value


def field(*names: str) -> Callable[[Callable[[Any], Any]], Any]:
    """A field that depends on the operators and on the named attributes of the state."""
    return lambda function: _Field(function, frozenset(names))


@cache
def _dependent(kind: type[InterfaceFields]) -> dict[str, list[str]]:
    """Cached fields of a class that depend on each attribute of the state."""
    dependent: dict[str, list[str]] = {}
    for name in dir(kind):
        made = getattr(kind, name, None)
        for attribute in made.names if isinstance(made, _Field) else ():
            dependent.setdefault(attribute, []).append(name)
    return dependent


class Parts(NamedTuple):
    """Normal and tangential part of the multipliers, shape (slave nodes,) each [stress]."""

    z_n: Array
    z_tau: Array


def normal_parts(n: Array, vectors: Array) -> Array:
    """Parts of ``vectors`` (..., n, dim) along the normals, (..., n) [their unit] (local)."""
    return np.asarray(np.einsum("ja,...ja->...j", n, vectors))


def tangential(vectors: Array, n: Array) -> Array:
    """Parts of ``vectors`` (n, dim) across the normals [their unit] (local)."""
    return vectors - normal_parts(n, vectors)[:, None] * n


class InterfaceFields:
    """Fields of all interfaces.

    Args:
        interface: The interface.
        state: Its state.
        operators: D, M, gap and normals at the last evaluated displacement.

    Attributes:
        closing_gap: Gap that contact closes, nan at uncovered nodes, (slave nodes,) [length].
        z_n, z_tau: See ``Parts``.
        z_u: Multipliers of the displacement, shape (slave nodes, dim) [stress].
        acting: Operators with derivatives of the facets whose multipliers act or are not zero; in
            the plane, and of ties, those of all facets.
        covered: Whether a slave node has a multiplier and a partner, shape (slave nodes,), bool.
        acts: Whether the multiplier of a node may be nonzero, shape (slave nodes,), bool.
        sticking: Whether an active node sticks, shape (slave nodes,), bool.
    """

    closing_gap: Any = property(attrgetter("gap"))
    z_n: Any = property(attrgetter("parts.z_n"))
    z_tau: Any = property(attrgetter("parts.z_tau"))
    z_u: Any = property(attrgetter("state.z"))
    acting: Any = property(attrgetter("operators"))
    covered: Any = property(attrgetter("state.active"))
    acts: Any = property(attrgetter("state.active"))
    sticking: Any = property(attrgetter("state.active"))

    def __init__(self, interface: Any, state: InterfaceState, operators: Any) -> None:
        self.interface, self.state = interface, state
        self.operators: Any = operators
        self.nodal_lengths: Array = interface.slave.nodal_lengths
        self.nodal_areas: Array = interface.slave.nodal_areas

    def after(self, state: InterfaceState) -> Self:
        """The fields at another state and the same operators."""
        kind: Any = type(self)
        before, new, dependent = vars(self.state), object.__new__(kind), _dependent(kind)
        fields = vars(new)
        fields.update(vars(self), state=state)
        for attribute, value in vars(state).items():
            if value is not before[attribute]:
                for name in dependent.get(attribute, ()):
                    fields.pop(name, None)
        return new

    @property
    def has_partner(self) -> Flags:
        """Whether facets at a slave node are at least partly covered, (slave nodes,), bool."""
        covered, (alone, others) = self.operators.cover > 0.0, self.interface.substitutes
        covered[alone] = covered[others]
        return covered

    @property
    def offset(self) -> Array:
        """Length subtracted from the pointwise gap, the law's included, (slave nodes,) [length]."""
        return np.asarray(self.state.offset)

    @property
    def active_nodes(self) -> Indices:
        """Numbers of the active slave nodes along the surface, shape (active nodes,)."""
        return np.flatnonzero(self.state.active)

    @field("z")
    def parts(self) -> Parts:
        """Normal and tangential part of the multipliers; in space the latter is its size."""
        o, z = self.operators, self.z_u
        along = np.einsum("ja,ja->j", o.tau, z) if o.slave.dim == 2 else self.shear_size
        return Parts(np.einsum("ja,ja->j", o.n, z), along)

    @field("z")
    def forces(self) -> tuple[Array, Array]:
        """D^T z and -M^T z, see ``MortarOperators.force``; collective at the first access."""
        return self.operators.force(self.z_u)

    @property
    def slip(self) -> Array:
        """Slip along tau since the last accepted step, shape (slave nodes,) [length]."""
        return np.zeros(len(self.state.z))

    @property
    def steepness(self) -> float:
        """Largest d(nodal force)/d(slip), where it may exceed the bulk's stiffness [stress]."""
        return 0.0

    @property
    def friction_work(self) -> float:
        """Work of the shear at the end of the step along the slip in it [stress length^2]."""
        return float(self.shear_force @ self.slip)

    @property
    def pressure(self) -> Array:
        """Normal part z_n of the multiplier of every slave node, shape (slave nodes,) [stress]."""
        return self.fill_inside(self.z_n.copy())

    @property
    def shear_force(self) -> Array:
        """Tangential force w_j z_tau of every slave node, (slave nodes,) [stress length].

        In space along the direction of ``z_tau``.
        """
        return self.operators.weight * self.z_tau

    @property
    def shear(self) -> Array:
        """The multipliers without the pressure, shape (slave nodes, dim) [stress]."""
        return tangential(self.z_u, self.operators.n)

    @property
    def shear_size(self) -> Array:
        """Size of the shear, shape (slave nodes,) [stress]."""
        return np.asarray(np.linalg.norm(self.shear, axis=1))

    @property
    def surface_shear(self) -> Array:
        """Shear along tau, (slave nodes,) [stress]; in space vectors, (slave nodes, 3)."""
        return self.shear if self.operators.slave.dim == 3 else self.z_tau

    @property
    def surface_slip(self) -> Array:
        """Slip since the last accepted step, as ``surface_shear`` [length]."""
        return np.zeros_like(self.surface_shear)

    @property
    def total_force(self) -> Array:
        """Total force that acts on the slave body, shape (dim,) [stress length]."""
        return -self.operators.weight @ self.z_u

    def fill_inside(self, values: Array) -> Array:
        """Set values at inner nodes of facets to the mean of the end nodes.

        Only if multipliers are at vertices only. Nodes without weight get the values of their
        substitutes. ``values`` (slave nodes,) [any unit] are changed in place and returned.
        """
        alone, others = self.interface.substitutes
        if alone.size:
            values[alone] = values[others]
        if self.interface.at_vertices:
            values[:] = self.interface.slave.from_corners @ values
        return values
