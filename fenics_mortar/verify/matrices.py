# SPDX-License-Identifier: MIT
"""Mortar operators of the present state as PETSc objects, for users' block solvers and studies.

Rows of D, M, gap and normals are slave nodes in their order along the surface, distributed evenly
over the ranks; columns of D and M are slave and master nodes likewise. Columns of derivatives are
the displacement dofs of the space (global numbers dim node + component).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.fluxes import Flux
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.integrals import share_of
from fenics_mortar.interface.mortar import Block
from fenics_mortar.la.sparse import BlockMatrix
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices


class OperatorMatrices:
    """PETSc objects, created on demand from the operators of a pair (all methods collective).

    Rows of D, M and the gap, and columns of D, are the nodes of ``PairView.slave``, columns of M
    those of ``PairView.master``.
    """

    def __init__(self, bulk: Bulk, contacts: Sequence[Interface]) -> None:
        self._bulk, self._contacts = bulk, contacts

    def D(self, pair: int = 0) -> PETSc.Mat:
        """Slave matrix, shape (slave nodes, slave nodes) [length]."""
        o = self._contacts[pair].operators
        blocks = [Block(o.facet_nodes, o.facet_nodes, o.D)]
        return self._assemble(blocks, o.slave.num_nodes, o.slave.num_nodes)

    def M(self, pair: int = 0) -> PETSc.Mat:
        """Master matrix, shape (slave nodes, master nodes) [length]."""
        o = self._contacts[pair].operators
        blocks = [Block(o.segments.slave, o.segments.master, o.M)]
        return self._assemble(blocks, o.slave.num_nodes, o.master.num_nodes)

    def gap(self, pair: int = 0) -> PETSc.Vec:
        """Weighted gap, shape (slave nodes,) [length^2]."""
        return self._vector(self._contacts[pair].operators.gap[:, None])

    def normals(self, pair: int = 0) -> PETSc.Vec:
        """Averaged unit normals, shape (dim slave nodes,)."""
        return self._vector(self._contacts[pair].operators.n)

    def gap_derivative(self, pair: int = 0) -> PETSc.Mat:
        """dg/dd, shape (slave nodes, N) [length]."""
        o = self._contacts[pair].operators
        return self._assemble(o.gap_derivative(), o.slave.num_nodes, None)

    def normals_derivative(self, pair: int = 0) -> PETSc.Mat:
        """dn/dd, shape (dim slave nodes, N) [1 / length]."""
        o = self._contacts[pair].operators
        mine, dim = o.slave.owned, o.slave.dim
        block = Block(dim * mine[:, None] + np.arange(dim), o.normal_columns()[mine], o.dn[mine])
        return self._assemble([block], dim * o.slave.num_nodes, None)

    def slave_force_derivative(self, z: Array, pair: int = 0) -> PETSc.Mat:
        """d(D^T z)/dd at fixed ``z`` (slave nodes, dim), shape (N, N) [stress]."""
        return self._assemble(
            [self._contacts[pair].operators.slave_force_derivative(z)], None, None
        )

    def master_force_derivative(self, z: Array, pair: int = 0) -> PETSc.Mat:
        """-d(M^T z)/dd at fixed ``z`` (slave nodes, dim), shape (N, N) [stress]."""
        blocks = [self._contacts[pair].operators.master_force_derivative(z)]
        return self._assemble(blocks, None, None)

    def flux_loads(self, pair: int = 0, number: int = 0) -> PETSc.Vec:
        """Loads of a flux in the equation of its field, shape (dofs,) [flux length].

        Args:
            pair: Number of the pair.
            number: Number of the flux in the pair's ``fluxes``, with the field's own function.
        """
        flux = self._flux(pair, number)
        vector = compat.create_vector(flux.law.field.function_space)
        flux.add_loads(vector.array)
        return vector

    def flux_derivative(self, pair: int = 0, number: int = 0) -> PETSc.Mat:
        """Derivative of ``flux_loads`` by the field, shape (dofs, dofs) [flux length / field].

        Args:
            pair: Number of the pair.
            number: Number of the flux in the pair's ``fluxes``, with the field's own function.
        """
        flux = self._flux(pair, number)
        size = flux.law.field.function_space.dofmap.index_map.size_local
        self._bulk.free_garbage()
        return BlockMatrix(self._bulk.comm, size, size).assemble([flux.field_derivative()])

    def _flux(self, pair: int, number: int) -> Any:
        """A flux whose field is solved for in a problem of its own, with its present values.

        Raises:
            ValueError: On all ranks, if it is part of the mixed function.
        """
        contact: Any = self._contacts[pair]
        flux: Flux = contact.all_fluxes[number]
        if not flux.is_separate:
            raise ValueError(
                f"{flux.law!r}: the field is solved for with the displacement; expected "
                "Conductance(T, h) with the field's own function T"
            )
        flux.refresh()
        return flux

    def _assemble(self, blocks: list[Block], rows: int | None, columns: int | None) -> PETSc.Mat:
        """Assemble blocks; ``None`` means the displacement dofs as rows or columns."""
        self._bulk.free_garbage()
        sizes = [self._share(size) for size in (rows, columns)]
        mat = BlockMatrix(self._bulk.comm, *sizes).assemble(blocks)
        return mat

    def _share(self, size: int | None) -> int:
        if size is None:
            return self._bulk.num_owned
        return share_of(np.arange(size), self._bulk.comm).size

    def _vector(self, values: Array) -> PETSc.Vec:
        self._bulk.free_garbage()
        flat = values.ravel()
        mine: Indices = share_of(np.arange(flat.size), self._bulk.comm)
        vector = PETSc.Vec().createMPI((mine.size, None), comm=self._bulk.comm)
        vector.array[:] = flat[mine]
        return vector
