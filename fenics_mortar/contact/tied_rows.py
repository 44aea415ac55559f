# SPDX-License-Identifier: MIT
"""Operators, fields and rows of a tied pair, and the unknowns that it ties.

``TiedRows`` has the rows of the multipliers, whose ``TiedComponents`` are those of the displacement
and one of each tied scalar field. Each of these unknowns is a ``TiedPart``, with D and M of its
own.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, diags

from fenics_mortar.contact.conductance import NodalFlux
from fenics_mortar.contact.fields import InterfaceFields, field
from fenics_mortar.contact.interface import Components, acting_entries, blocks_of
from fenics_mortar.contact.rows import Frame, Rows
from fenics_mortar.interface.integrals import MortarInput, PlaneOperators, evaluate_mortar
from fenics_mortar.interface.mortar import Block, Linearization
from fenics_mortar.interface.space_mortar import SpaceOperators, evaluate_space
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.interface.traces import FieldTraces
from fenics_mortar.utils.errors import SurfaceError

if TYPE_CHECKING:
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices


@dataclass(frozen=True, kw_only=True)
class Jumps:
    """D and M of the reference configuration; positions and normals are the current ones.

    Attributes:
        weighted_jump: D u_s - M u_m [length^2], and the jumps of the tied fields [field length],
            shape (slave nodes, c).
    """

    weighted_jump: Array

    def gap_derivative(self) -> list[Block]:
        """Empty: there is no weighted gap."""
        return []


@dataclass(frozen=True, kw_only=True)
class TiedCurves(Jumps, PlaneOperators):
    """Operators of a tie in the plane."""


@dataclass(frozen=True, kw_only=True)
class TiedFaces(Jumps, SpaceOperators):
    """Operators of a tie in space."""


def tied_operators(o: Any, weighted_jump: Array) -> TiedCurves | TiedFaces:
    """Operators at the reference positions with jumps, without gap and derivatives (local)."""
    values = {field.name: getattr(o, field.name) for field in fields(o) if field.init}
    for name in {"dD", "dM", "dgap", "gap"} & values.keys():
        values[name] = np.zeros_like(values[name])
    values["linearization"] = Linearization(False, False, frozen=True)
    kind: Any = TiedCurves if o.slave.dim == 2 else TiedFaces
    return kind(**values, weighted_jump=weighted_jump)


class TiedFields(InterfaceFields):
    """Fields of a tie.

    Attributes:
        jump: D u_s - M u_m at the evaluated displacement, shape (slave nodes, dim) [length^2].
    """

    operators: TiedCurves | TiedFaces

    @property
    def jumps(self) -> Array:
        """Jumps of displacement and fields, shape (slave nodes, c) [length^2, field length]."""
        return self.operators.weighted_jump

    @property
    def jump(self) -> Array:
        """D u_s - M u_m, shape (slave nodes, dim) [length^2]."""
        return self.jumps[:, : self.operators.slave.dim]

    @field("z")
    def z_u(self) -> Array:
        """Multipliers of the displacement, shape (slave nodes, dim) [stress]."""
        return np.ascontiguousarray(self.state.z[:, : self.operators.slave.dim])

    @property
    def gap(self) -> Array:
        """Mean relative displacement, (slave nodes,), nan without multiplier [length]."""
        on = self.state.active
        weight = np.where(on, self.operators.weight, 1.0)
        return np.where(on, np.linalg.norm(self.jump, axis=1) / weight, np.nan)


class TiedRows:
    """Rows of a tie: transposed force blocks, so that the system is symmetric.

    The row of a multiplier node is the jump of the displacement, D u_s - M u_m, in all components;
    a prescribed jump is included in u_m. Rows of tied fields are their jumps.

    The frame consists of ``TiedComponents.idle`` and ``row_weight``. Rows of fields have the unit
    of their equations, those of displacements are symmetric to the forces.
    """

    def __init__(self, interface: Any) -> None:
        self._interface = interface

    def linearized(self) -> Rows:
        """The linearized rows; shapes and units are those of ``Rows``."""
        f: TiedFields = self._interface.now
        idle, weight = self.frame()
        weights = weight.ravel()
        loads = self._interface.load_blocks()
        blocks = [Block(j, i, values * weights[j[:, :, None]]) for i, j, values in loads]
        A_z = -idle[:, :, None] * np.eye(idle.shape[1])
        return Rows(blocks, A_z, -weight * f.jumps)

    def measure(self) -> tuple[float, float]:
        """Size of the nonlinear rows: the jump of active nodes."""
        f: TiedFields = self._interface.now
        of = self._interface.components
        rows = (f.interface.stiffness[:, None] / (of.weight * of.units)) * f.jumps
        gaps = np.where(f.state.active, f.gap, 0.0) / f.nodal_lengths
        return float((rows**2).sum()), float(gaps.max(initial=0.0))

    def followed(self) -> Array:
        """Diagonal blocks [1] of the rows of active nodes: all directions are constrained."""
        return np.tile(np.eye(self._interface.slave.dim), (len(self._interface.z), 1, 1))

    def frame(self) -> Frame:
        """Weights of the rows at the present state, see ``Frame``."""
        of = self._interface.components
        return of.idle, of.row_weight

    def weighted(self, frame: Frame) -> Array:
        """Rows weighted by ``frame``, zero at a solution, (slave nodes, dim) [stress length]."""
        f: TiedFields = self._interface.now
        idle, weight = frame
        return weight * f.jumps - idle * f.state.z


class TiedComponents(Components):
    """Components of a tie; constant, arrays have the shape of z (local).

    A tie's multipliers have the components of the displacement, and one of each tied field.

    A displacement of one causes forces of the stiffness k, and so do an amount ``unit`` of the
    field and its residual times ``to_force``. With fluxes scaled by k / (D to_force) and rows of
    jumps weighted by k / (D unit to_force), all entries have the size of those of the bulk in these
    rows.

    Attributes:
        dofs: Global dofs of the slave whose equations yield the components.
        acts: Whether a component carries load, bool.
        free: One: only free dofs carry multipliers.
        diagonal: D_jj where a component acts, else the nodal area [length].
        weight: Row sum of D where a component acts, else infinite [length].
        units, to_force: See ``bulk.residual``; one for displacements.
    """

    dofs: Any = property(attrgetter("_dofs"))
    acts: Any = property(attrgetter("_acts"))
    free: Any = property(attrgetter("_free"))
    diagonal: Any = property(attrgetter("_diagonal"))

    def __init__(self, tie: Any) -> None:
        super().__init__(tie)
        self.units, self.to_force = np.ones((2, *tie.z.shape))

    def read(self) -> None:
        """Read the operators of displacement and fields, after each integration (local)."""
        tie = self._interface
        shape = tie.z.shape
        self._dofs = np.tile(tie.slave.dofs[:, :1], shape[1])
        self._acts, self._free = np.zeros(shape, bool), np.ones(shape)
        self._diagonal = np.tile(tie.slave.nodal_areas[:, None], shape[1])
        self.weight = np.full(shape, np.inf)
        for part in tie.parts:
            self._dofs[np.ix_(part.at, part.components)] = part.sides[0][1]
            on, o = part.active, part.operators
            acting = np.ix_(part.at[on], part.components)
            self._acts[acting] = True
            self._diagonal[acting] = o.diagonal[on, None]
            self.weight[acting] = o.weight[on, None]

    def set_units(self, units: Array, to_force: Array, diagonal: Array) -> None:
        """Set the scales of all unknowns, see ``bulk.residual`` (collective)."""
        for c, flux in enumerate(self._interface.fluxes, self._interface.slave.dim):
            E = flux.interpolations[0]
            self.units[flux.at, c] = E @ flux.gathered(units)
            self.to_force[flux.at, c] = E @ flux.gathered(to_force)

    @property
    def row_weight(self) -> Array:
        """Factor of the rows of jumps, zero where no component acts [row / length / unit]."""
        return np.where(self.acts, self.scale / self.units, 0.0)

    @property
    def idle(self) -> Array:
        """Factor of components that do not act in their own rows, else zero [length]."""
        return np.where(self.acts, 0.0, self.diagonal)

    @property
    def some_carry(self) -> Flags:
        """Whether a slave node ever carries a component, shape (slave nodes,), bool."""
        return self.acts.any(axis=1)

    @property
    def all_carry(self) -> Flags:
        """Whether it may carry all of them, shape (slave nodes,), bool."""
        return self.acts.all(axis=1)


NO_ROWS: Indices = np.empty((0, 1), np.int64)


class TiedPart:
    """Unknowns that a pair ties: the displacement or a scalar field, with D and M of their own.

    Args:
        tie: The tie, with its surfaces and options.
        components: Numbers of the c components of the multipliers, shape (c,).
        sides: Slave and master, of n and m nodes, with dofs (n, c) and (m, c); see ``gather``.
        at: Numbers of the n nodes in the slave of the tie, shape (n,).
        free: Nodes at which the unknowns are not prescribed, shape (n,), bool.

    Attributes:
        components, sides, at: See the arguments.
        candidates: Nodes that may carry a multiplier, shape (n,), bool.
        multiplier_nodes: Candidates that are covered and have not yielded to other pairs.
        active: Whether a node carries a multiplier, shape (n,), bool.
        D, M: Rows of active nodes, shapes (n, n) and (n, m) [length].
        operators: D and M with the rows of all nodes.
        blocks: Blocks of the loads by the multipliers; columns index z.ravel() of the tie.
    """

    def __init__(self, tie: Any, components: Indices, sides: Any, at: Indices, free: Flags) -> None:
        self._tie, self.components, self.sides, self.at = tie, components, sides, at
        slave, _ = sides[0]
        self.candidates = free & ~(slave.weightless | tie.shared[at])
        if tie.at_vertices:
            self.candidates &= ~slave.inner
        self.multiplier_nodes = self.candidates

    def integrate(self, dropped: Flags) -> None:
        """Integrate D and M at the reference positions (collective).

        Args:
            dropped: Slave nodes of the tie that yielded to other pairs, (slave nodes,), bool. The
                cover of the others is as before.
        """
        nodes = self.multiplier_nodes & ~dropped[self.at]
        o = self.evaluated(nodes)
        uncovered = o.cover < MIN_SHARE * self.sides[0][0].full_cover
        if (nodes & uncovered).any():
            nodes = nodes & ~uncovered
            o = self.evaluated(nodes)
        self.operators, self.multiplier_nodes = o, nodes
        self.active = nodes & (o.diagonal > 0.0)
        self.D, self.M = (rows_of(self.active, matrix) for matrix in o.matrices)
        each = zip(self.sides, acting_entries(o, self.active), strict=True)
        entries = [(dofs[k], j, values) for (_, dofs), (j, k, values) in each]
        numbers = np.arange(self._tie.z.size).reshape(self._tie.z.shape)
        self.blocks = blocks_of(entries, numbers[np.ix_(self.at, self.components)])

    def evaluated(self, nodes: Flags) -> Any:
        """Operators at the reference positions with these multiplier nodes (collective).

        Those of the displacement if they are equal. There are no derivatives, and no normals of
        symmetry planes.
        """
        (slave, _), (master, _) = self.sides
        tie, exact = self._tie, Linearization(False, False)
        of_all = tie.displacement
        same = self is not of_all and slave is tie.slave
        if same and np.array_equal(nodes, of_all.multiplier_nodes):
            return of_all.operators
        planes = np.full((slave.num_nodes, 2), np.nan)
        if slave.dim == 3:
            planes = np.tile(np.eye(3), (slave.num_nodes, 1, 1))
        given = MortarInput(slave, master, slave.X, master.X, nodes, planes, tie.options, exact)
        return evaluate_mortar(given) if slave.dim == 2 else evaluate_space(given)

    @property
    def nodes(self) -> Indices:
        """Global numbers of the tied nodes of both sides, shape (k,) (local)."""
        (slave, _), (master, _) = self.sides
        covered = slave.nodes[self.operators.cover > 0.0]
        return np.concatenate([covered, master.nodes[np.unique(self.M.indices)]])

    def masters_of(self, node: int) -> Indices:
        """Global numbers of the master nodes that a slave node of the tie follows (local)."""
        return self.sides[1][0].nodes[self.M[np.flatnonzero(self.at == node)].indices]

    def gather(self, u: Array) -> list[Array]:
        """Values at the nodes of both sides, (n, c) and (m, c), of all unknowns (collective).

        Args:
            u: All unknowns, shape (local dofs,) [their units].
        """
        return [side.gather(u) for side, _ in self.sides]


class TiedField(TiedPart, FieldTraces):
    """A scalar field of a mixed function that a pair ties together with the displacement.

    To the linear system it is a flux, as ``fluxes.Flux``. A field T has one more component q of the
    tie's multipliers, its flux from slave to master, with

        sum_k D[j, k] T_k - sum_l M[j, l] T_l = 0,
        loads D^T q on the slave and -M^T q on the master.

    D and M are integrals over the facets of the tie, but with multiplier nodes of the field: all
    nodes at which it is not prescribed. On a symmetry plane the displacement is prescribed and a
    temperature is not. Since D and M reproduce constants, the fluxes of both sides cancel to
    rounding.

    A field of degree 1 beside a displacement of degree 2 has no dofs inside facets. Its D and M are
    those of linear facets with multipliers at vertices, one for each dof of the slave. With the
    quadratic functions it would have two constraints for each dof.

    Args:
        field: Number of the field's sub-space.
        component: Number of its component of the multipliers.
        tie: The tie, with its surfaces and options.
        space: The displacement's nodes, and the mixed space.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.

    Attributes:
        field: Number of the sub-space of the field.
        traces: Traces of the field on slave and master; their surfaces have n and m nodes.

    Raises:
        ValueError: On all ranks, if the space has no such field.
    """

    def __init__(
        self, field: int, component: int, tie: Any, space: DisplacementSpace, prescribed: Flags
    ) -> None:
        self.field, self._component = field, component
        sides, at = (tie.slave, tie.master), np.arange(tie.slave.num_nodes)
        FieldTraces.__init__(self, space, field, sides)
        if self.traces[0].dofs.shape[1] > 1:
            (slave, at), (master, _) = map(surface_of_vertices, sides)
            FieldTraces.__init__(self, space, field, (slave, master))
        on_sides = [(trace.surface, trace.dofs[:, :1]) for trace in self.traces]
        free = self.interpolations[0] @ self.gathered(prescribed) == 0.0
        TiedPart.__init__(self, tie, np.array([component]), on_sides, at, free)

    def integrate(self, dropped: Flags) -> None:
        """See ``TiedPart`` (collective).

        Raises:
            SurfaceError: On all ranks, if no multiplier is left.
        """
        super().integrate(dropped)
        if not self.active.any():
            raise SurfaceError(
                f"fields={list(self._tie.pair.fields)} of {self._tie.pair!r}: field {self.field} "
                "is prescribed at every slave node that has a partner; exchange slave and master, "
                "or omit the field"
            )

    def gather(self, u: Array) -> list[Array]:
        """See ``TiedPart`` [field]."""
        values = self.gathered(u)[:, None]
        return [E @ values for E in self.interpolations]

    @property
    def flux(self) -> Array:
        """Flux from slave to master, shape (n,) [flux] (local)."""
        return np.asarray(self._tie.z[self.at, self._component])

    def loads(self) -> list[Array]:
        """Loads of the nodes of both traces, (n,) and (m,) [flux length] (collective)."""
        return [side[:, 0] for side in self.operators.force(self.flux[:, None])]

    def nodal(self) -> NodalFlux:
        """The flux at the slave nodes of the tie, zero at nodes without multiplier (local).

        If there are multipliers at vertices only, values inside facets are means of the corners'.
        """
        nodal = np.zeros((3, self._tie.slave.num_nodes))
        jump, flux, tied = nodal
        on, weight = self.at[self.active], self.operators.weight[self.active]
        jump[on] = self._tie.now.jumps[on, self._component] / weight
        flux[on], tied[on] = self.flux[self.active], 1.0
        if self._tie.at_vertices or self.at.size < self._tie.slave.num_nodes:
            nodal[:] = nodal @ self._tie.slave.from_corners.T
        conductance = np.where(tied > 0.0, np.inf, 0.0)
        total = float(self.operators.weight @ self.flux)
        return NodalFlux(jump, conductance, flux, np.zeros_like(flux), -total, total)

    # Terms of the equations, see ``fluxes.Flux``

    def add_loads(self, target: Array) -> None:
        """Add the loads to ``target``, shape (owned dofs,) or longer (collective)."""
        sides = zip(self.interpolations, self.loads(), strict=True)
        self.add(sum(E.T @ loads for E, loads in sides), target)

    @property
    def conducts(self) -> Flags:
        """Slave nodes with a multiplier of the field, shape (slave nodes,), bool."""
        return self._tie.components.acts[:, self._component]

    def by_multipliers(self) -> Block:
        """Derivatives of the loads by multipliers; columns index z.ravel() (local)."""
        return Block(*map(np.concatenate, zip(*self.blocks, strict=True)))

    def pattern(self) -> Block:
        """Zeros at all entries of the constraint, in the rows of the slave's dofs (local)."""
        by_z = self.by_multipliers()
        rows = self._tie.components.dofs.ravel()[by_z.columns]
        return Block(rows, by_z.rows, np.zeros_like(by_z.values))


def rows_of(active: Flags, matrix: csr_array) -> csr_array:
    """A matrix with the rows of active nodes only (local)."""
    kept = csr_array(diags(active.astype(float)) @ matrix)
    kept.eliminate_zeros()
    return kept


def surface_of_vertices(surface: Any) -> tuple[Any, Indices]:
    """The surface without the inner nodes of its facets, in the plane or in space (local).

    Its facets are linear, between the vertices of quadratic ones, for fields of degree 1.

    Returns:
        The surface, and the numbers of its k nodes in the given one, shape (k,).
    """
    degree, kept, beside = surface.degree, np.flatnonzero(~surface.inner), {}
    if surface.dim == 2:
        every = np.arange(surface.num_nodes)
        before, after = surface.along(every, range(-degree, degree + 1, 2 * degree)).T
        beside = {"previous": before, "following": after}
    return surface.of_nodes(kept, facets=surface.corners, **beside), kept
