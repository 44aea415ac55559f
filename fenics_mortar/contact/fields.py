# SPDX-License-Identifier: MIT
"""State of an interface, and nodal fields of contacts: gap, slip, arguments and rows of the law.

``InterfaceState`` has all quantities that a solve changes or passes to the next solve. A field is
computed from it and the operators when first read, and cached. New operators invalidate all fields;
a new state invalidates the fields that depend on a changed attribute. Each field lists the
attributes of the state on which it depends.

The directional derivatives of all fields are replicated. Those in space are in ``space_fields``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from fenics_mortar.contact.law import (
    BUILT_IN,
    STICK,
    Frictionless,
    Nodal,
    Row,
    VectorRow,
    chain_rule,
)
from fenics_mortar.contact.law_calls import Instant
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices, Value

if TYPE_CHECKING:
    from fenics_mortar.contact.law import Branches
    from fenics_mortar.interface.mortar import Block

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
        opened: How often the shear of each node may have opened it in this solve, (slave nodes,),
            int [1], under a law that ``grazes``; see ``rows``.
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
    opened: Array | None = dataclasses.field(default=None, metadata=DERIVED)

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
    """Nodal fields that all interfaces have.

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


# Attributes of the state on which the arguments of a law and its tangential row depend.
LAW_ATTRIBUTES = ("z", "multiplier_nodes", "partners", "c_n", "load_time", "start_instant")
RULED = (*LAW_ATTRIBUTES, "active", "branch", "redundant")
# Stiffness of elastic stick over that of the bulk [1]. Curvature causes a slip of second order in
# the strains e; the shear is then 1000 e times the pressure.
ELASTIC = 1e3
# Decrease of adhesion with the gap, over the diagonal stiffness of a node [1], above which it is
# left out of the tangent. A surface node is about twice as compliant as its diagonal stiffness.
MAX_SOFTENING = 0.5


class Gaps(NamedTuple):
    """Covered nodes with their mean gaps; arrays of the slave nodes, zero where not covered.

    Attributes:
        covered: Whether a node is covered, shape (slave nodes,), bool.
        mean: Mean gaps g_j / w_j, shape (slave nodes,) [length].
        per_weight: 1 / w_j, shape (slave nodes,) [1 / length], in space [1 / area].
    """

    covered: Flags
    mean: Array
    per_weight: Array


class Arguments(NamedTuple):
    """Arguments of the law with the gap that contact closes, and this gap with its derivatives.

    The gap is ``None`` if it is the mean gap.
    """

    nodal: Nodal
    closing: Row | None


class ContactFields(InterfaceFields):
    """Fields of a contact; see ``contact`` for the complementarity function and the rows.

    Attributes:
        covered, mean_gap, per_weight: See ``Gaps``.
        nodal, closing: See ``Arguments``.
        row_tangents: Direction of the tangential row, (slave nodes, 2), in space of two [1].
        counted_slip: Slip that a step may keep, (slave nodes,) [length]; in space its vectors.
        memory_of_law: Memory at the start of the step as the law has it, in space along e.
    """

    covered: Any = property(attrgetter("gaps.covered"))
    mean_gap: Any = property(attrgetter("gaps.mean"))
    per_weight: Any = property(attrgetter("gaps.per_weight"))
    nodal: Any = property(attrgetter("arguments.nodal"))
    closing: Any = property(attrgetter("arguments.closing"))
    row_tangents: Any = property(attrgetter("operators.tau"))
    counted_slip: Any = property(attrgetter("slip"))
    surface_slip: Any = property(attrgetter("slip"))
    memory_of_law: Any = property(attrgetter("state.start_instant.memory"))

    @field("multiplier_nodes")
    def gaps(self) -> Gaps:
        """Covered nodes and mean gaps."""
        o = self.operators
        covered = self.state.multiplier_nodes & (o.diagonal > ROUNDING * self.nodal_areas)
        weight = np.where(covered, o.weight, 1.0)
        return Gaps(covered, np.where(covered, o.gap, 0.0) / weight, covered / weight)

    @field("multiplier_nodes")
    def gap(self) -> Array:
        """Mean gap of every covered slave node, nan elsewhere, (slave nodes,) [length]."""
        return self.fill_inside(np.where(self.covered, self.mean_gap, np.nan))

    @field(*LAW_ATTRIBUTES)
    def pull(self) -> Row:
        """Adhesion a of covered nodes, continued linearly to negative gaps, (slave nodes,) each."""
        law, none = self.interface.pair.law, np.zeros(len(self.state.z))
        if type(law) in BUILT_IN or not law.has_adhesion:
            return Row(none, none, none, none, none)
        node = self.nodal
        opened = replace(node, gap=np.maximum(node.gap, 0.0))
        row = self.interface.law_calls.row("adhesion_at", opened, self.covered)
        row = self.without_slip_on_planes(row)
        row = row._replace(residual=row.residual + row.by_gap * np.minimum(node.gap, 0.0))
        return Row(*(np.where(self.covered, values, 0.0) for values in row))

    def without_slip_on_planes(self, row: Row) -> Row:
        """The row with zero slip on symmetry planes."""
        on_plane = np.isfinite(self.interface.plane_normals[:, 0])
        return row._replace(by_slip=np.where(on_plane, 0.0, row.by_slip))

    @field(*LAW_ATTRIBUTES, "active")
    def attracted(self) -> Flags:
        """Open nodes under adhesion, shape (slave nodes,), bool.

        An elastic bond does not pull yet at a closed gap, but its row has the derivative.
        """
        pull = self.pull
        return ((pull.residual > 0.0) | (pull.by_gap > 0.0)) & ~self.state.active

    @field(*LAW_ATTRIBUTES, "active")
    def acts(self) -> Flags:
        """Whether the multiplier of a node may be nonzero, shape (slave nodes,), bool."""
        return self.state.active | self.attracted

    def friction_limit(self, pressure: Array) -> Array:
        """Friction limits at pressures (slave nodes,) and closed gaps [stress]."""
        node = replace(self.nodal, z_n=pressure, gap=np.zeros_like(pressure))
        return self.interface.law_calls.friction_limit(node)

    @property
    def tension(self) -> Array:
        """Tension beyond the adhesion, -(z_n + a), shape (slave nodes,) [stress]."""
        return -(self.z_n + self.pull.residual)

    @field("partners")
    def slip(self) -> Array:
        """See ``InterfaceFields``.

        Zero on symmetry planes, where the mesh has partners on one side only.
        """
        on_plane = np.isfinite(self.interface.plane_normals[:, 0])
        return np.where(on_plane, 0.0, self.state.partners.slip(self.operators))

    def remembered(self, memory: Mapping[str, Array]) -> Mapping[str, Array]:
        """Memory of the law at the end of the step, as it is stored [its units]."""
        return memory

    def slip_derivative(self, along: Array, *, summed: bool = True) -> Iterator[Block]:
        """Blocks of ``along`` times the derivative of the slip of the law, of this rank."""
        return self.state.partners.derivative(self.operators, along)

    @field(*LAW_ATTRIBUTES)
    def arguments(self) -> Arguments:
        """Arguments of the law, and its closing gap: the mean gap where no node is covered."""
        interface, time, start = self.interface, self.state.load_time, self.state.start_instant
        law, stiffness, on = interface.pair.law, interface.foundation, self.covered
        needs_slip = type(law) is not Frictionless
        slip = self.slip if needs_slip else np.zeros(stiffness.size)
        node = Nodal(
            self.mean_gap, slip, self.z_n, self.z_tau, stiffness, self.state.c_n * stiffness,
            interface.slave.X, self.operators.x, time,
            time - start.time if time > start.time else start.step, self.memory_of_law,
            interface.parameters,
        )  # fmt: skip
        if not law.has_closing_gap:
            return Arguments(node, None)
        row = interface.law_calls.row("closing_gap", node, on)
        row = self.without_slip_on_planes(row)
        plain = Row(node.gap, 1.0, 0.0, 0.0, 0.0)
        closing = Row(*(np.where(on, a, b) for a, b in zip(row, plain, strict=True)))
        return Arguments(replace(node, gap=closing.residual), closing)

    @property
    def closing_gap(self) -> Array:
        """Gap that contact closes, nan at uncovered nodes, (slave nodes,) [length]."""
        if not self.interface.pair.law.has_closing_gap:
            return self.gap
        return self.fill_inside(np.where(self.covered, self.nodal.gap, np.nan))

    @property
    def offset(self) -> Array:
        """Length subtracted from the pointwise gap: minus that of the law's layer [length]."""
        if not self.interface.pair.law.has_closing_gap:
            return np.asarray(self.state.offset)
        return np.asarray(self.state.offset - (self.nodal.gap - self.mean_gap))

    @property
    def sticking(self) -> Flags:
        """Whether an active node sticks, shape (slave nodes,), bool."""
        return self.state.active & (self.state.branch == STICK) & self.interface.follows_law

    @property
    def sliding(self) -> Flags:
        """Whether an active node slides against friction, shape (slave nodes,), bool."""
        follows_law = self.interface.follows_law & (self.friction_limit(self.pressure) > 0.0)
        return self.state.active & (self.state.branch != STICK) & follows_law

    @field(*RULED)
    def tangential_row(self) -> Row:
        """Tangential row of all nodes, open ones as if active, each (slave nodes,).

        Redundant nodes stick elastically, z_tau = z_tau,old + (k / l) u; see
        ``linearized_contact``.
        """
        state, node, law = self.state, self.nodal, self.interface.pair.law
        row = Frictionless().tangential(node, state.branch)
        if type(law) is not Frictionless:
            follows_law = self.interface.follows_law
            if not law.bridges_gap:
                follows_law = follows_law & ~self.attracted
            given = self.interface.law_calls.row("tangential", node, follows_law, state.branch)
            row = Row(*(np.where(follows_law, a, b) for a, b in zip(given, row, strict=True)))
        zero = np.zeros(len(state.z))
        row = Row(*np.broadcast_arrays(*row, zero)[:-1])
        if not state.redundant.any():
            return row
        k = node.stiffness
        shear = self.shear_of_stick / ELASTIC
        elastic = Row(shear - k * self.slip, zero, -k, zero, zero + 1.0 / ELASTIC)
        return Row(*(np.where(state.redundant, a, b) for a, b in zip(elastic, row, strict=True)))

    @field(*RULED)
    def law_rows(self) -> tuple[Row, ...]:
        """Rows of the contact law along tau, and along n for open nodes, each (slave nodes,).

        With a closing gap of the law its row is the third.

        Where adhesion decreases with the gap faster than the elastic forces increase, its
        derivative is left out of the tangent. With it a Newton step would close the gap, and the
        node would open and close alternately. Without it the gap grows over the iterations up to
        the next equilibrium.
        """
        pull, closing = self.pull, self.closing
        by_gap = pull.by_gap
        if by_gap.any() and not self.operators.linearization.exact:
            by_gap = np.where(self.decreases_fast, 0.0, by_gap)
        opening = Row(
            self.z_n + pull.residual, by_gap, pull.by_slip, pull.by_z_n + 1.0, pull.by_z_tau
        )
        rows = [self.tangential_row, opening]
        if closing is not None:
            rows = [*(chain_rule(row, closing) for row in rows), closing]
        return tuple([self.at_gaps(row) if np.any(row.by_slip) else row for row in rows])

    @property
    def shear_of_stick(self) -> Array:
        """Shear of redundant sticks less that at the accepted state, (slave nodes,) [stress]."""
        return self.nodal.z_tau - self.state.partners.shear

    @property
    def tangents(self) -> tuple[Array, ...]:
        """Tangents that laws do not turn, one or two in space, (slave nodes, dim) each [1]."""
        return (self.operators.tau,)

    def along_tangents(self, vectors: Array) -> Array:
        """Components of vectors (..., slave nodes, dim) along ``tangents``.

        Shape (..., slave nodes), in space (..., slave nodes, 2) [unit of the vectors].
        """
        return normal_parts(self.operators.tau, vectors)

    def at_gaps(self, row: Row) -> Row:
        """A row of the law with its whole derivative by the mean gap: slip depends on it."""
        return row._replace(by_gap=row.by_gap + row.by_slip * self.slip_by_gap)

    @field(*RULED)
    def vector_rows(self) -> tuple[VectorRow, ...]:
        """``law_rows`` with derivatives by vectors; in space along two tangents, then along n."""
        return tuple(map(self.by_vectors, self.law_rows))

    def by_vectors(self, row: Row) -> VectorRow:
        """A row with its derivatives by the vectors of multiplier and normal."""
        o, z, none = self.operators, self.state.z, np.zeros(len(self.z_n))
        by_n, by_tau = np.reshape(row.by_z_n, (-1, 1)), np.reshape(row.by_z_tau, (-1, 1))
        turned = z[:, ::-1] * (1.0, -1.0)  # z . dtau = turned . dn
        return VectorRow(
            row.residual + none, by_n * o.n + by_tau * o.tau, row.by_slip + none, row.by_gap + none,
            by_n * z + by_tau * turned,
        )  # fmt: skip

    @property
    def slip_by_gap(self) -> Array:
        """Derivative of the slip with respect to the mean gap, shape (slave nodes,) [1]."""
        partners, planes = self.state.partners, self.interface.plane_normals
        on = self.covered & np.isfinite(partners.least) & ~np.isfinite(planes[:, 0])
        return np.where(on, partners.at(self.operators).arc.by_gap, 0.0)

    @property
    def decreases_fast(self) -> Flags:
        """Nodes where adhesion drops faster than elastic forces grow, (slave nodes,), bool."""
        slope = -self.operators.diagonal * self.pull.by_gap
        return slope > self.interface.max_softening * self.interface.stiffness

    @property
    def steepness(self) -> float:
        """Largest d(nodal force)/d(slip), where it may exceed the bulk's stiffness [stress].

        Zero for laws of the package.
        """
        if type(self.interface.pair.law) in BUILT_IN:
            return 0.0
        force = self.operators.diagonal * np.abs(self.tangential_row.by_slip)
        return float(force[self.state.active].max(initial=0.0))
