# SPDX-License-Identifier: MIT
"""Scalar fields of a mixed function that are tied together with the displacement.

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

from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags

from fenics_mortar.contact.fluxes import NodalFlux
from fenics_mortar.contact.interface import acting_entries
from fenics_mortar.interface.faces import surface_of_vertices
from fenics_mortar.interface.integrals import evaluate_mortar
from fenics_mortar.interface.mortar import Block, Linearization, MortarOperators
from fenics_mortar.interface.segments import MortarOptions
from fenics_mortar.interface.space_integrals import evaluate_space
from fenics_mortar.interface.surfaces import MIN_SHARE
from fenics_mortar.interface.traces import Trace, trace_of
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import SurfaceError

NO_ROWS: Indices = np.empty((0, 1), np.int64)
NO_DOFS: Indices = np.empty(0, np.int64)


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

    def add_newton_loads(self, target: Array) -> None:
        """Nothing: the loads are linear in the multipliers."""

    conducting_dofs = NO_DOFS  # of finite conductances

    def expect(self, r: Array) -> None:
        """Do nothing: fluxes in derivatives are multipliers (local)."""

    def rounding(self) -> float:
        """Zero [stress length]: fluxes are multipliers (local)."""
        return 0.0

    @property
    def conducts(self) -> Flags:
        """Slave nodes with a multiplier of the field, shape (slave nodes,), bool."""
        conducts = np.zeros(self._tie.slave.num_nodes, bool)
        conducts[self.carriers] = True
        return conducts

    def derivative(self) -> list[Block]:
        """Empty: the loads do not depend on the unknowns of the bodies."""
        return []

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
    evaluate: Any = evaluate_mortar
    no_planes = np.full((slave.num_nodes, 2), np.nan)
    if slave.dim == 3:
        evaluate, no_planes = evaluate_space, np.tile(np.eye(3), (slave.num_nodes, 1, 1))
    return evaluate(
        slave, master, slave.X, master.X, nodes, no_planes, options, Linearization(False, False)
    )


def rows_of(active: Flags, matrix: csr_array) -> csr_array:
    """A matrix with the rows of active nodes only (local)."""
    kept = csr_array(diags(active.astype(float)) @ matrix)
    kept.eliminate_zeros()
    return kept
