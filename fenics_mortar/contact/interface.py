# SPDX-License-Identifier: MIT
"""Base of contacts and ties: two surfaces with multipliers, their operators, state and forces.

``Interface`` is the base class. Its ``Components`` are what linear systems need of the multipliers;
``OperatorEvaluation`` evaluates the operators of a contact.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenics_mortar.contact.fields import InterfaceFields, InterfaceState
from fenics_mortar.contact.pair import PRESETS, Discretization
from fenics_mortar.interface import integrals
from fenics_mortar.interface.corners import SharpEdges
from fenics_mortar.interface.mortar import LINEARIZATIONS, Block, Linearization, MortarOperators
from fenics_mortar.interface.on_obstacle import evaluate_obstacle
from fenics_mortar.interface.outline import Outline, Sight
from fenics_mortar.interface.reference import AT_VERTICES, Basis
from fenics_mortar.interface.space_mortar import evaluate_space
from fenics_mortar.interface.surfaces import POINTS, Surface
from fenics_mortar.interface.traces import at_tips, substitutes_of, surfaces_of
from fenics_mortar.kernels.space import shapes
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.obstacles.rigid_motion import at_place
from fenics_mortar.utils.clock import clock

if TYPE_CHECKING:
    from fenics_mortar.interface.mortar import BodiesBehind, MortarOptions
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices

# Distance of the middles of a quadrilateral's diagonals over the root of its area [1], above which
# 7 points are too few: where edges of both sides almost coincide their common point moves fast, the
# error of the quadrature with it, and Newton's method does not settle below that error.
DISTORTED = 0.05

# Phase of the clock for ``integrals``.
INTEGRALS = clock("integrals")


def points_per_segment(pair: Any, slave: Surface, master: Surface) -> int:
    """Gauss points per segment, with "elements" per facet, in space per triangle of common parts.

    Error of a uniform pressure with "elements", independent of the mesh: 0.1 % with 5 points on
    facets with two nodes; 5 % with 5 and 0.4 % with 10 points on facets with three. With fewer
    points than nodes the dual functions of a facet may not exist.

    Raises:
        ValueError: If the points of the pair are fewer than the nodes of a facet.
    """
    if slave.dim == 3:
        return _points_in_space(pair.discretization, slave, master)
    choice, degree = pair.discretization, slave.degree
    points = choice.points
    if points is None:
        on_facets = choice.integration == "elements" and master.num_nodes > 0
        return POINTS * (degree if on_facets else 1)
    if points <= degree:
        raise ValueError(
            f"points={points}: expected at least one per node of a facet, {degree + 1}"
        )
    return int(points)


def _points_in_space(choice: Discretization, slave: Any, master: Any) -> int:
    """Points of the rule of a triangle, see ``Discretization`` (local).

    Raises:
        ValueError: If there is no rule with the chosen number for these facets.
    """
    points = choice.points
    allowed = [n for n in shapes.ALLOWED if n >= slave.facets.shape[1]]
    if points is None:
        linear = slave.degree == 1
        few = shapes.LINEAR if linear else shapes.QUADRATIC
        many = shapes.FINE if linear else shapes.FINE_QUADRATIC
        if choice == PRESETS["other_codes"]:
            return few
        distortion, warp = map(max, slave.distortion, master.distortion)
        aligned = slave is master  # sides of a fold have the same mesh, edges coincide
        least = many if distortion > DISTORTED or aligned else few
        return max(least, shapes.points_for(slave.degree, distortion, warp))
    if points not in allowed:
        raise ValueError(
            f"points={points}: expected one of {', '.join(map(str, allowed))}, the points of the "
            f"rules of a triangle, at least one per node of a facet of '{slave.name}'"
        )
    return int(points)


class Components:
    """What linear systems need of each component of an interface's multipliers (local).

    Arrays have the shape of z.

    Args:
        interface: The interface; its present fields are used.

    Attributes:
        dofs: Global dofs of the slave whose equations yield the components.
        free: 0 where the dof of an acting component is prescribed, else 1.
        to_force: Factor that turns rows of the multipliers into forces.
        some_carry: Whether a slave node ever carries a component, shape (slave nodes,), bool.
        all_carry: Whether it may carry all of them, shape (slave nodes,), bool.
    """

    dofs: Any = property(attrgetter("_interface.slave.dofs"))
    free: Any = property(attrgetter("_interface.free"))
    to_force: Any = 1.0
    some_carry: Any = property(attrgetter("_interface.may_carry"))
    all_carry: Any = property(attrgetter("_interface.may_carry"))

    def __init__(self, interface: Any) -> None:
        self._interface = interface

    def set_units(self, units: Array, to_force: Array, diagonal: Array) -> None:
        """Set the scales of all unknowns, see ``bulk.residual`` (collective).

        Args:
            units: Amounts of the unknowns, shape (owned dofs,).
            to_force: Factors of the equations, shape (owned dofs,).
            diagonal: Diagonal of the tangent of the bodies, shape (owned dofs,).
        """
        for flux in self._interface.fluxes:
            flux.set_conduction(to_force, np.abs(diagonal))

    @property
    def acts(self) -> Flags:
        """Whether a component may be nonzero."""
        return np.broadcast_to(self._interface.acts[:, None], self._interface.z.shape)

    @property
    def diagonal(self) -> Array:
        """D_jj where a component acts, else the nodal area [length]."""
        i = self._interface
        of_nodes = np.where(i.acts, i.operators.diagonal, i.slave.nodal_areas)
        return np.broadcast_to(of_nodes[:, None], i.z.shape)

    @property
    def inverse(self) -> Array:
        """1 / D_jj where a component acts and its dof is free, else 0 [1 / length]."""
        return np.where(self.acts, self.free / self.diagonal, 0.0)

    @property
    def scale(self) -> Array:
        """z_j / zeta_j, see ``la.system`` [stress / length]."""
        return self._interface.stiffness[:, None] / (self.diagonal * self.to_force)


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
        foundation: ``stiffness`` over the node's area, (slave nodes,) [stress / length].
        may_carry: Whether a slave node ever carries a multiplier, shape (slave nodes,), bool.
        oblique: Whether the one prescribed component of a slave node is neither along nor across
            its normal, and it carries a multiplier, shape (slave nodes,), bool.
        substitutes: Nodes without weight, and the nodes whose fields are shown in their place, each
            (k,).
        rows: Rows of the multipliers, the law of the interface.
        components: Dofs and scales of the components of the multipliers.
        fluxes: Fluxes of scalar fields across the interface, see ``fluxes``.
        conductances: The fluxes that are not multipliers of a tie.
        all_fluxes: ``fluxes``, and those of fields that are solved for in other problems.
        state: The present state.
        now: Fields at the last evaluated displacement and the present state.
        z: Multipliers, shape (slave nodes, c); c is dim, on a tie dim and the number of tied
            fields.
        z_u: Its components of the displacement, shape (slave nodes, dim) [stress].
        c_n: Present weight of the gap in the complementarity function [1]. May be set.
        offset: Length subtracted from the pointwise gap, shape (slave nodes,) [length].
    """

    now: InterfaceFields
    rows: Any
    offset: Any
    _kind: type[InterfaceFields]

    state, c_n = read_only("_state"), settable("c_n", lambda _, weight: weight)
    z, active = read_only("_state.z"), read_only("_state.active")
    branch, multiplier_nodes = read_only("_state.branch"), read_only("_state.multiplier_nodes")
    redundant, partners = read_only("_state.redundant"), read_only("_state.partners")
    accepted_partners = read_only("_state.accepted_partners")
    accepted_instant = read_only("_state.accepted_instant")
    operators, gap = read_only("now.operators"), read_only("now.gap")
    covered, acts = read_only("now.covered"), read_only("now.acts")
    sticking, active_nodes = read_only("now.sticking"), read_only("now.active_nodes")
    pressure, slip, z_tau = read_only("now.pressure"), read_only("now.slip"), read_only("now.z_tau")
    shear, shear_force = read_only("now.shear"), read_only("now.shear_force")
    total_force, z_u = read_only("now.total_force"), read_only("now.z_u")

    def __init__(
        self, pair: Any, space: DisplacementSpace, prescribed: Flags, welds: Indices = NO_WELDS
    ) -> None:
        """Extract the surfaces (collective).

        Args:
            pair: The pair.
            space: Nodes and dofs of the displacement.
            prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
            welds: Pairs of nodes to be merged, shape (k, 2); see ``Surface.welded``.
        """
        self.pair = pair
        self.slave, self.master = surfaces_of(pair, space, welds)
        self.obstacle = pair.master if isinstance(pair.master, Obstacle) else None
        count = self.slave.num_nodes
        self.shared: Flags = at_tips(self.slave, self.master)
        self.free: Array = 1.0 - self.slave.gather(prescribed.astype(float))
        self.set_stiffness(np.ones(count))
        self.may_carry = np.ones(count, bool)
        self.oblique = np.zeros(count, bool)
        self.basis: Basis = integrals.basis_on(self.slave, pair.discretization.basis)
        self.at_vertices: bool = self.basis in AT_VERTICES
        self.all_fluxes = self.fluxes = self.conductances = NO_FLUXES
        self.components = Components(self)
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
        self.stiffness: Array = stiffness
        self.modulus: Array = stiffness / self.slave.mean_thickness
        self.foundation: Array = stiffness / self.slave.nodal_areas
        if hasattr(self, "now"):
            self.set_operators(self.operators)

    def limit_sight(self, outline: Outline) -> Outline:
        """Store the outlines of the bodies; return those for the next interface (local)."""
        return outline

    @abstractmethod
    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate operators and fields at the displacement ``u``, (local dofs,) (collective)."""

    @property
    def other_roles(self) -> str:
        """Advice to exchange slave and master; "" for a surface in contact with itself."""
        slave, master = self.slave.name, self.master.name
        return f"take '{master}' as slave and '{slave}' as master, or " * (slave != master)

    @property
    @abstractmethod
    def partner_operators(self) -> Any:
        """Operators at the positions that define the partners."""

    @abstractmethod
    def intersections(self) -> integrals.Segments:
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
        self.scatter_add(self.now.forces, target)
        for flux in self.fluxes:
            flux.add_loads(target)

    def scatter_add(self, forces: tuple[Array, Array], target: Array) -> None:
        """Add forces of both sides, as ``now.forces``, to ``target`` (owned dofs,) (local)."""
        self.slave.scatter_add(forces[0], target)
        self.master.scatter_add(forces[1], target)

    def load_blocks(self) -> list[Block]:
        """Blocks of all loads' derivatives by z; columns index z.ravel() (collective)."""
        return [*self.force_blocks(), *(flux.by_multipliers() for flux in self.fluxes)]

    def coupled_by_slip(self) -> tuple[Indices, Indices]:
        """Slave nodes and the master nodes coupled to them in addition to M, each (k,)."""
        return NO_PAIRS

    @property
    def nodes(self) -> Indices:
        """Global numbers of the nodes of both sides, shape (slave and master nodes,)."""
        return np.concatenate([self.slave.nodes, self.master.nodes])

    def force_blocks(self) -> list[Block]:
        """Blocks of B^T, the force by acting multipliers; columns index z.ravel().

        Only nonzero entries, to keep the system sparse. Without fluxes.
        """
        return blocks_of(self.force_entries(), np.arange(self.z.size).reshape(self.z.shape))

    def force_entries(self) -> Iterator[tuple[Indices, Indices, Array]]:
        """Dofs (p, dim), nodes of acting multipliers (p,), D and -M (p,) [length] of each side."""
        for side, (j, k, values) in zip(
            (self.slave, self.master), acting_entries(self.operators, self.acts), strict=True
        ):
            yield side.dofs[k], j, values


def blocks_of(entries: Iterable[tuple[Indices, Indices, Array]], numbers: Indices) -> list[Block]:
    """Blocks of forces by multipliers (local).

    Args:
        entries: Of each side dofs (p, c), nodes of the multipliers (p,) and values (p,) [length].
        numbers: Columns of the components of each multiplier, shape (nodes, c).
    """
    return [
        Block(i.reshape(-1, 1), numbers[j].reshape(-1, 1), np.repeat(v, i.shape[1])[:, None, None])
        for i, j, v in entries
    ]


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


class Reference(NamedTuple):
    """Frozen operators of the undeformed mesh, with multiplier nodes and obstacle position.

    Pickles and files omit the operators, which belong to a communicator; they are ``None`` then,
    and are integrated again in the next evaluation.
    """

    operators: Any
    multiplier_nodes: Flags
    place: Array

    def __reduce__(self) -> tuple[Any, ...]:
        """How a pickle or a deep copy makes it again (local)."""
        return Reference, (None, self.multiplier_nodes, self.place)


def place_of(reference: Reference | None, obstacle: Obstacle | None) -> Array:
    """Place of the obstacle in frozen operators, (m,) [length, radian]; nan without them.

    With a master surface shape (3,), not used.
    """
    size = 3 if obstacle is None else obstacle.place.size
    return np.full(size, np.nan) if reference is None else reference.place


@dataclass(eq=False)
class OperatorEvaluation:
    """Evaluation of the operators of one contact with a master surface or an obstacle.

    The state is not changed. With small sliding, D, M and normals are those of the undeformed mesh;
    the gap is the present one.

    Args:
        slave: The slave.
        master: The master.
        obstacle: The rigid master, or ``None``.
        arm: Length by which angles of the obstacle are multiplied [length].
        planes: Normals of slave nodes on symmetry planes, nan elsewhere, shape (slave nodes, 2); in
            space matrices that remove components of normals, shape (slave nodes, 3, 3).
        options: Basis, quadrature, search.
        small: Whether sliding is small.
    """

    slave: Any
    master: Any
    obstacle: Obstacle | None
    arm: float
    planes: Array
    options: MortarOptions
    small: bool
    sight: Sight | None = field(default=None, init=False)
    behind: BodiesBehind | None = field(default=None, init=False)
    # of the last state and two initial guesses, also with the multiplier nodes of their cover
    _recent: deque[tuple[bytes, bytes, Linearization, MortarOperators]] = field(
        default_factory=partial(deque, maxlen=5), init=False
    )

    @cached_property
    def sharp_edges(self) -> SharpEdges:
        """Corners of the slave, in space its sharp edges."""
        return SharpEdges(self.slave)

    def limit_sight(self, outline: Outline) -> None:
        """Limit the distance of partners behind the slave by the thickness of the bodies (local).

        Without effect on obstacles.
        """
        if self.obstacle is None:
            slave = self.slave
            normals, _ = integrals.evaluate_normals(slave, slave.X, self.options.weighting)
            self.sight = Sight(outline, slave, self.master, normals)
            self._recent.clear()

    def evaluate(
        self, u: Array, state: InterfaceState, linearization: Linearization
    ) -> tuple[MortarOperators, Reference | None]:
        """Evaluate the operators at a displacement (collective).

        Args:
            u: Displacement, shape (local dofs,) [length].
            state: State, of which multiplier nodes, offset and frozen operators are used.
            linearization: Derivatives to evaluate.

        Without an obstacle, the operators of an earlier call are returned if their arguments are
        unchanged: initial guesses and the first iterate of a step have equal positions.

        Returns:
            The operators, and those of the undeformed mesh if sliding is small.
        """
        behind, x, m = self._positions_at(u)
        if self.small:
            found, kept = self._after_small_motion(x, m, state, linearization)
        else:
            self.behind, kept = behind, None
            found = self._integrate(x, m, state.multiplier_nodes, linearization, behind)
        return found.minus_offset(state.offset) if state.offset.any() else found, kept

    def _after_small_motion(
        self, x: Array, m: Array, state: InterfaceState, linearization: Linearization
    ) -> tuple[MortarOperators, Reference]:
        """Operators of small sliding with nodes at ``x`` and ``m``, see ``evaluate``."""
        kept, nodes = state.reference, state.multiplier_nodes
        if kept is not None and kept.operators is None:
            with at_place(self.obstacle, kept.place):
                kept = self._evaluate_reference(nodes)
        if kept is None or not np.array_equal(kept.multiplier_nodes, nodes):
            kept = self._evaluate_reference(nodes)
        place = [] if self.obstacle is None else [kept.place]
        moved = kept.operators.after_small_motion(x, m, *place)
        exact = replace(moved.linearization, exact=linearization.exact)
        return replace(moved, linearization=exact), kept

    def _evaluate_reference(self, multiplier_nodes: Flags) -> Reference:
        """Evaluate the operators of the undeformed mesh (collective).

        Args:
            multiplier_nodes: Whether a slave node carries a multiplier, (slave nodes,), bool.
        """
        self.behind, X, m = self._positions_at(None)
        operators = self._integrate(X, m, multiplier_nodes, LINEARIZATIONS["frozen"], self.behind)
        place = np.zeros(3) if self.obstacle is None else self.obstacle.place.copy()
        return Reference(operators.freeze(), multiplier_nodes, place)

    def at_outline(self, outline: Outline, x: Array, state: InterfaceState) -> MortarOperators:
        """Frozen operators with the nodes of outlines at given positions (collective).

        Args:
            outline: Outlines of the bodies of all pairs.
            x: Positions of their nodes, shape (n, dim) [length].
            state: See ``evaluate``.
        """
        on_slave, on_master = (x[outline.indices_of(s.nodes)] for s in (self.slave, self.master))
        behind = None
        if self.sight is not None:
            behind = self.sight.behind(x[outline.indices_of(self.sight.outline.nodes)])
        nodes, frozen = state.multiplier_nodes, LINEARIZATIONS["frozen"]
        found = self._integrate(on_slave, on_master, nodes, frozen, behind)
        return found.minus_offset(state.offset) if state.offset.any() else found

    def intersections(self, o: MortarOperators) -> Any:
        """Intersections of this rank's slave facets with the master, for any integration (local).

        Args:
            o: Operators at the positions that define the partners.
        """
        if self.options.integration == "segments" or self.obstacle is not None or o.slave.dim == 3:
            return o.segments
        options = replace(self.options, integration="segments", points=POINTS)
        at = o.x, o.n, o.m, o.segments.facets
        return integrals.find_segments(self.slave, self.master, *at, options, self.behind)

    def _positions_at(self, u: Array | None) -> tuple[Any, Array, Array]:
        """Bodies behind the slave; positions of both sides, undeformed for None (collective)."""
        sides = self.slave, self.master
        if self.sight is not None:
            behind, *moved = self.sight.behind_at(u)
        else:
            behind, moved = None, [0.0 * side.X if u is None else side.gather(u) for side in sides]
        x, m = [side.X + change for side, change in zip(sides, moved, strict=True)]
        return behind, x, m

    def _integrate(
        self, x: Array, m: Array, multiplier_nodes: Flags, linearization: Linearization,
        behind: BodiesBehind | None,
    ) -> MortarOperators:  # fmt: skip
        """Operators with slave nodes at ``x`` and master nodes at ``m`` (collective).

        Without an obstacle a recent result for the same arguments, see ``evaluate``, or with the
        search of one for other multiplier nodes.
        """
        takes_one = self.options.corners and self.obstacle is None
        given = integrals.MortarInput(
            self.slave, self.master, x, m, multiplier_nodes, self.planes, self.options,
            linearization, behind, self.sharp_edges if takes_one else None,
        )  # fmt: skip
        if self.obstacle is not None:
            with INTEGRALS:
                return evaluate_obstacle(given, self.obstacle, self.arm)
        points = (np.concatenate([x, m]) if behind is None else behind.outline[0]).tobytes()
        nodes, searched = multiplier_nodes.tobytes(), None
        for at, of_nodes, terms, operators in self._recent:
            same = at == points and terms == linearization
            if same and of_nodes == nodes:
                return operators
            searched = operators if same else searched
        evaluate: Any = integrals.evaluate_mortar if self.slave.dim == 2 else evaluate_space
        with INTEGRALS:
            operators = evaluate(given if searched is None else given._replace(searched=searched))
        self._recent.appendleft((points, nodes, linearization, operators))
        return operators
