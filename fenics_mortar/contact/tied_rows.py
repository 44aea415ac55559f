# SPDX-License-Identifier: MIT
"""Operators, fields and rows of a tied pair.

The row of a multiplier node is the jump of the displacement, D u_s - M u_m, in all components; a
prescribed jump is included in u_m. Rows of tied fields are their jumps.

A tie's multipliers have the components of the displacement, and one of each tied field.

A displacement of one causes forces of the stiffness k, and so do an amount ``unit`` of the field
and its residual times ``to_force``. With fluxes scaled by k / (D to_force) and rows of jumps
weighted by k / (D unit to_force), all entries have the size of those of the bulk in these rows.

Scalar fields of a mixed function that are tied together with the displacement.

A field T has one more component q of the tie's multipliers, its flux from slave to master, with

    sum_k D[j, k] T_k - sum_l M[j, l] T_l = 0,    loads D^T q on the slave and -M^T q on the master.

D and M are integrals over the facets of the tie, but with multiplier nodes of the field: all nodes
at which it is not prescribed. On a symmetry plane the displacement is prescribed and a temperature
is not. Since D and M reproduce constants, the fluxes of both sides cancel to rounding.

A field of degree 1 beside a displacement of degree 2 has no dofs inside facets. Its D and M are
those of linear facets with multipliers at vertices, one for each dof of the slave. With the
quadratic functions it would have two constraints for each dof.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array, diags

from fenics_mortar.contact.fluxes import NodalFlux
from fenics_mortar.contact.interface import Components, acting_entries
from fenics_mortar.contact.interface_fields import InterfaceFields, field
from fenics_mortar.contact.rows import Frame, Rows
from fenics_mortar.interface.faces import surface_of_vertices
from fenics_mortar.interface.integrals import MortarInput, PlaneOperators, evaluate_mortar
from fenics_mortar.interface.mortar import Block, Linearization, MortarOperators
from fenics_mortar.interface.space_mortar import SpaceOperators, evaluate_space
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.interface.traces import Trace, trace_of
from fenics_mortar.utils.errors import SurfaceError

if TYPE_CHECKING:
    from fenics_mortar.interface.integrals import MortarOptions
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices


@dataclass(frozen=True, kw_only=True)
class TiedCurves(PlaneOperators):
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
class TiedFaces(SpaceOperators):
    """As ``TiedCurves``, in space."""

    weighted_jump: Array

    def gap_derivative(self) -> list[Block]:
        """Empty: there is no weighted gap."""
        return []


TiedOperators = TiedCurves | TiedFaces


class TiedFields(InterfaceFields):
    """Fields of a tie.

    Attributes:
        jump: D u_s - M u_m at the evaluated displacement, shape (slave nodes, dim) [length^2].
    """

    operators: TiedOperators

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

    The frame consists of ``TiedComponents.idle`` and ``row_weight``. Rows of fields have the
    unit of their equations, those of displacements are symmetric to the forces.
    """

    def __init__(self, interface: Any) -> None:
        self._interface = interface

    def linearized(self) -> Rows:
        """The linearized rows; shapes and units are those of ``Rows``."""
        f: TiedFields = self._interface.now
        idle, weight = self.frame()
        weights = weight.ravel()
        blocks = [
            Block(columns, rows, values * weights[columns[:, :, None]])
            for rows, columns, values in self._interface.load_blocks()
        ]
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

    def __init__(self, tie: Any) -> None:
        super().__init__(tie)
        self.units, self.to_force = np.ones((2, *tie.z.shape))

    def read(self) -> None:
        """Read the operators of displacement and fields, after each integration (local)."""
        tie = self._interface
        o, shape = tie.operators, tie.z.shape
        areas, active, dim = tie.slave.nodal_areas, tie.active, tie.slave.dim
        self._dofs, self._acts = np.empty(shape, np.int64), np.zeros(shape, bool)
        self.diagonal, self.weight = np.empty(shape), np.full(shape, np.inf)
        self._free = np.ones(shape)
        self._dofs[:, :dim], self._dofs[:, dim:] = tie.slave.dofs, tie.slave.dofs[:, :1]
        self._acts[:, :dim] = active[:, None]
        self.diagonal[:] = areas[:, None]
        self.diagonal[active, :dim] = o.diagonal[active, None]
        self.weight[active, :dim] = o.weight[active, None]
        for c, flux in enumerate(tie.fluxes, dim):
            on, of_flux = flux.carriers, flux.operators
            self._dofs[flux.at, c] = flux.traces[0].dofs[:, 0]
            self._acts[on, c] = True
            self.diagonal[on, c] = of_flux.diagonal[flux.active]
            self.weight[on, c] = of_flux.weight[flux.active]

    def set_units(self, units: Array, to_force: Array, diagonal: Array) -> None:
        """Set the scales of all unknowns, see ``bulk.residual`` (collective)."""
        for c, flux in enumerate(self._interface.fluxes, self._interface.slave.dim):
            self.units[flux.at, c] = flux.traces[0].gather(units)
            self.to_force[flux.at, c] = flux.traces[0].gather(to_force)

    @property
    def inverse(self) -> Array:
        """1 / D_jj where a component acts and its dof is free, else 0 [1 / length]."""
        return np.where(self.acts, 1.0 / self.diagonal, 0.0)

    @property
    def scale(self) -> Array:
        """z_j / zeta_j, see ``la.system`` [stress / length]."""
        return self._interface.stiffness[:, None] / (self.diagonal * self.to_force)

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


class TiedField:
    """A scalar field tied by a pair; to the linear system a flux, as ``fluxes.Flux``.

    Args:
        field: Number of the field's sub-space.
        component: Number of its component of the multipliers.
        tie: The tie, with its surfaces and options.
        space: The displacement's nodes, and the mixed space.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.

    Attributes:
        field: Number of the field's sub-space.
        traces: Traces of the field on slave and master; their surfaces have n and m nodes.
        at: Numbers of the n nodes in the slave of the tie, shape (n,).
        dofs: All dofs of the traces, shape (d,), replicated.
        active: Whether a node carries a multiplier of the field, shape (n,), bool.
        D, M: Rows of active nodes, shapes (n, n) and (n, m) [length].
        operators: D and M with the rows of all nodes.

    Raises:
        ValueError: On all ranks, if the space has no such field.
    """

    active: Flags
    operators: MortarOperators
    D: csr_array
    M: csr_array

    def __init__(
        self, field: int, component: int, tie: Any, space: DisplacementSpace, prescribed: Flags
    ) -> None:
        self.field, self._component, self._tie = field, component, tie
        sides = tie.slave, tie.master
        self.traces: list[Trace] = [trace_of(space, field, side) for side in sides]
        self.at: Indices = np.arange(tie.slave.num_nodes)
        if self.traces[0].dofs.shape[1] > 1:
            (slave, self.at), (master, _) = map(surface_of_vertices, sides)
            self.traces = [trace_of(space, field, side) for side in (slave, master)]
        self.dofs: Indices = np.unique(np.concatenate([t.dofs.ravel() for t in self.traces]))
        self._candidates = self._possible(prescribed)
        self._block: Block

    @property
    def slave(self) -> Any:
        """The slave, with linear facets for a field of degree 1 (local)."""
        return self.traces[0].surface

    @property
    def carriers(self) -> Indices:
        """Slave nodes of the tie that carry a multiplier of the field, shape (k,) (local)."""
        return self.at[self.active]

    def _possible(self, prescribed: Flags) -> Flags:
        """Nodes that may carry a multiplier (collective)."""
        slave, tie = self.slave, self._tie
        possible = self.traces[0].gather(prescribed.astype(float)) == 0.0
        possible &= ~(slave.weightless | tie.shared[self.at])
        return possible & ~slave.inner if tie.at_vertices else possible

    # Set-up

    def integrate(self, dropped: Flags) -> None:
        """Integrate D and M at the reference positions (collective).

        Args:
            dropped: Slave nodes of the tie that yielded to other pairs, (slave nodes,), bool.

        Raises:
            SurfaceError: On all ranks, if no multiplier is left.
        """
        nodes = self._candidates & ~dropped[self.at]
        o = self._evaluated(nodes)
        uncovered = o.cover < MIN_SHARE * self.slave.full_cover
        if (nodes & uncovered).any():
            nodes = nodes & ~uncovered
            o = self._evaluated(nodes)
        self.operators, self.active = o, nodes & (o.diagonal > 0.0)
        if not self.active.any():
            raise SurfaceError(
                f"fields={list(self._tie.pair.fields)} of {self._tie.pair!r}: field {self.field} "
                "is prescribed at every slave node that has a partner; exchange slave and master, "
                "or omit the field"
            )
        self.D, self.M = (rows_of(self.active, matrix) for matrix in o.matrices)
        self._block = self._load_block()

    def _evaluated(self, nodes: Flags) -> Any:
        """Operators with these multiplier nodes; those of the displacement if they are equal."""
        tie = self._tie
        if self.slave is tie.slave and np.array_equal(nodes, tie.multiplier_nodes):
            return tie.operators
        slave, master = (trace.surface for trace in self.traces)
        return evaluate_reference(slave, master, nodes, tie.options)

    def _load_block(self) -> Block:
        """Loads by the fluxes; columns index z.ravel() of the tie."""
        count = self._tie.z.shape[1]
        parts = [
            (trace.dofs[k, :1], count * self.at[j, None] + self._component, values)
            for trace, (j, k, values) in zip(
                self.traces, acting_entries(self.operators, self.active), strict=True
            )
        ]
        rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        return Block(rows, columns, values[:, None, None])

    @property
    def nodes(self) -> Indices:
        """Global numbers of the tied nodes of both sides, shape (k,) (local)."""
        masters = self.traces[1].surface.nodes[np.unique(self.M.indices)]
        return np.concatenate([self.slave.nodes[self.operators.cover > 0.0], masters])

    def masters_of(self, node: int) -> Indices:
        """Global numbers of the master nodes that a slave node of the tie follows (local)."""
        j = np.flatnonzero(self.at == node)
        masters = self.M[j].indices if j.size else np.empty(0, np.int64)
        return self.traces[1].surface.nodes[masters]

    # Values

    def weighted_jump(self, u: Array) -> Array:
        """D T_s - M T_m, shape (n,) [field length], of all unknowns ``u`` (collective)."""
        on_slave, on_master = (trace.gather(u) for trace in self.traces)
        return np.asarray(self.D @ on_slave - self.M @ on_master)

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
        on, weight = self.carriers, self.operators.weight[self.active]
        jump[on] = self._tie.now.jumps[on, self._component] / weight
        flux[on], tied[on] = self.flux[self.active], 1.0
        if self._tie.at_vertices or self.at.size < self._tie.slave.num_nodes:
            inner, corners, weights = self._tie.slave.between_corners
            nodal[:, inner] = (nodal[:, corners] * weights).sum(axis=2)
        conductance = np.where(tied > 0.0, np.inf, 0.0)
        total = float(self.operators.weight @ self.flux)
        return NodalFlux(jump, conductance, flux, np.zeros_like(flux), -total, total)

    # Terms of the equations, see ``fluxes.Flux``

    def add_loads(self, target: Array) -> None:
        """Add the loads to ``target``, shape (owned dofs,) or longer (collective)."""
        for trace, loads in zip(self.traces, self.loads(), strict=True):
            trace.scatter_add(loads, target)

    @property
    def conducts(self) -> Flags:
        """Slave nodes with a multiplier of the field, shape (slave nodes,), bool."""
        return self._tie.components.acts[:, self._component]

    def by_multipliers(self) -> Block:
        """Derivatives of the loads by multipliers; columns index z.ravel() (local)."""
        return self._block

    def pattern(self) -> Block:
        """Zeros at all entries of the constraint, in the rows of the slave's dofs (local)."""
        rows = self._tie.components.dofs.ravel()[self._block.columns]
        return Block(rows, self._block.rows, np.zeros_like(self._block.values))


def evaluate_reference(slave: Any, master: Any, nodes: Flags, options: MortarOptions) -> Any:
    """Operators at the reference positions with these multiplier nodes (collective).

    There are no derivatives, and no normals of symmetry planes.
    """
    no_planes = np.full((slave.num_nodes, 2), np.nan)
    if slave.dim == 3:
        no_planes = np.tile(np.eye(3), (slave.num_nodes, 1, 1))
    exact = Linearization(False, False)
    given = MortarInput(slave, master, slave.X, master.X, nodes, no_planes, options, exact)
    return evaluate_mortar(given) if slave.dim == 2 else evaluate_space(given)


def rows_of(active: Flags, matrix: csr_array) -> csr_array:
    """A matrix with the rows of active nodes only (local)."""
    kept = csr_array(diags(active.astype(float)) @ matrix)
    kept.eliminate_zeros()
    return kept
