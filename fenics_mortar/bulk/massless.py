# SPDX-License-Identifier: MIT
"""A mass matrix that gives no mass to some nodes, without a change of the rigid body's inertia.

The kinetic energy of the nodes S is taken from the velocity that their neighbours inside the body
extrapolate: v_S = W v_I with weights W that are exact for affine fields. With P = (I, W) the
redistributed matrix is M_r = P^T M P. Rows and columns of S vanish, M_r is positive on the other
nodes, and total mass, centre of mass, and moments of inertia are those of M, since P leaves affine
fields unchanged. (Khenous, Laborde & Renard 2008 obtain such a matrix by optimization.)
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import numpy as np

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, place
from fenics_mortar.utils.rounding import SAME_PLACE


def extrapolation(space: DisplacementSpace, layout: PETSc.Mat, nodes: Indices) -> PETSc.Mat:
    """The matrix P that replaces values at some nodes by extrapolated ones (collective).

    Args:
        space: The displacement's nodes and dofs.
        layout: A matrix of the dofs of the space.
        nodes: Global numbers of the nodes S, equal on all ranks, shape (k,).

    Returns:
        P, shape (N, N); its columns at dofs of S are zero.

    Raises:
        MortarError: On all ranks, if the nodes within two cells of a node of S do not determine an
            affine field.
    """
    index_map, first = space.V.dofmap.index_map, space.V.dofmap.index_map.local_range[0]
    stencils = _stencils(space.V, np.unique(nodes))
    comm = space.V.mesh.comm
    dofs = space.owned_dofs + space.first  # of the owned nodes
    others = np.unique(np.concatenate([*(s for s, _ in stencils.values()), nodes[:0]]))
    mine = others[(others >= first) & (others < first + index_map.size_local)]
    known = comm.allgather((mine, dofs[mine - first]))
    dofs_of = {int(n): d for numbers, values in known for n, d in zip(numbers, values, strict=True)}
    rows: dict[int, tuple[Array, Array]] = {}
    for node, (around, weights) in stencils.items():
        if first <= node < first + index_map.size_local:
            around_dofs = np.array([dofs_of[int(n)] for n in around])
            for component, row in enumerate(dofs[node - first]):
                rows[int(row)] = around_dofs[:, component], weights
    return _identity_but(rows, layout)


def _identity_but(rows: dict[int, tuple[Array, Array]], layout: PETSc.Mat) -> PETSc.Mat:
    """The identity with some owned rows replaced: global row, its columns and values."""
    start, end = layout.getOwnershipRange()
    entries = [rows.get(i, (np.array([i]), np.ones(1))) for i in range(start, end)]
    sizes = [len(columns) for columns, _ in entries]
    ends = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]).astype(PETSc.IntType)
    columns = np.concatenate([np.empty(0), *(c for c, _ in entries)]).astype(PETSc.IntType)
    values = np.concatenate([np.empty(0), *(v for _, v in entries)])
    P = PETSc.Mat().createAIJ(layout.getSizes(), csr=(ends, columns, values), comm=layout.comm)
    P.setBlockSizes(*layout.getBlockSizes())
    return P


def _stencils(V: Any, nodes: Indices) -> dict[int, tuple[Indices, Array]]:
    """Neighbours inside the body and their weights for each node, equal on all ranks."""
    cells, X = _cells_at(V, nodes)
    near, at = _cells_at(V, np.unique(cells))
    where = dict(zip(near.ravel().tolist(), at.reshape(-1, 2), strict=True))
    ring = _neighbours(near)
    inside = set(near.ravel().tolist()) - set(nodes.tolist())
    found = {}
    for node in nodes.tolist():
        around = set().union(*(ring[n] for n in ring[node])) & inside
        numbers = np.array(sorted(around, key=lambda n: tuple(where[n])), np.int64)
        offsets = np.array([where[n] for n in numbers.tolist()]).reshape(-1, 2) - where[node]
        found[node] = numbers, _weights(offsets, where[node])
    return found


def _weights(offsets: Array, X: Array) -> Array:
    """Smallest weights of points at ``offsets`` (n, 2) that extrapolate affine fields to zero.

    A point at distance r counts with r^2: near ones have the larger weights.
    """
    square = (offsets**2).sum(axis=1)
    size = np.sqrt(square.max(initial=0.0))
    fields = np.vstack([np.ones(len(offsets)), offsets.T / size]) if size else np.zeros((3, 0))
    gram = (fields / square) @ fields.T if size else np.zeros((3, 3))
    if np.linalg.matrix_rank(gram, tol=SAME_PLACE * np.abs(gram).max(initial=1.0)) < 3:
        raise MortarError(
            f"the body at {place(X)} has fewer than two layers of nodes behind the slave surface, "
            "which cannot take over its mass: refine the body, take the other side as the slave, "
            "or use scheme='generalised_alpha'"
        )
    return (np.linalg.solve(gram, [1.0, 0.0, 0.0]) @ fields) / square


def _cells_at(V: Any, nodes: Indices) -> tuple[Indices, Array]:
    """Nodes (n, k) of all cells that have one of ``nodes``, and their places (n, k, 2)."""
    comm, mesh = V.mesh.comm, V.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    local = compat.dofmap(V)[:owned]
    index_map = V.dofmap.index_map
    count = index_map.size_local + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(count, dtype=np.int32))
    touched = np.isin(numbers, nodes)[local].any(axis=1)
    cells = comm.allgather(numbers[local[touched]])
    places = comm.allgather(V.tabulate_dof_coordinates()[local[touched], :2])
    return np.concatenate(cells).astype(np.int64), np.concatenate(places)


def _neighbours(cells: Indices) -> dict[int, set[int]]:
    """Nodes that share one of the cells with a node, itself included."""
    ring: dict[int, set[int]] = {}
    for cell in cells.tolist():
        for node in cell:
            ring.setdefault(node, set()).update(cell)
    return ring
