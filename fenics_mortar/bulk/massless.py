# SPDX-License-Identifier: MIT
"""A mass matrix without mass at some nodes, and with unchanged rigid-body inertia.

The kinetic energy of the nodes S is taken from the velocity of their nearest neighbours inside the
body: v_S = W v_I with weights W of sum one. With P = (I, W) the matrix P^T M P has zero rows and
columns at S and the same total mass; masses are shifted by about a cell. A quadratic polynomial s
of the position, one for each body, restores centre of mass and moments of inertia:

    M_r = S P^T M P S,    S = diag(s(X_i)),    s = 1 + O(h^2).

(Khenous, Laborde & Renard 2008 obtain such a matrix by optimization.) If a body has so few cells
across that s is not positive, W are the smallest weights that extrapolate affine fields. They
preserve all moments without s, but the pressure behind a wave then oscillates with the frequency of
a cell.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations_with_replacement
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from fenics_mortar.bulk.bodies import centre_and_size, label_bodies
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, format_point
from fenics_mortar.utils.rounding import EPSILON, MAX_STEPS, ROUNDING, SAME_PLACE

# Pairs of the fields 1, x, y (and z) whose products are the moments of a body, by dimension.
MOMENTS = {dim: list(combinations_with_replacement(range(1 + dim), 2)) for dim in (2, 3)}
# Function from offsets of points to their weights; None if there are too few points.
Weigh = Callable[[Array], Array | None]


def redistributed(space: DisplacementSpace, M: PETSc.Mat, nodes: Indices) -> tuple[Any, Any]:
    """The matrices M_r and P (collective).

    Args:
        space: The displacement's nodes and dofs.
        M: The mass matrix.
        nodes: Global numbers of the nodes S, equal on all ranks, shape (k,).

    Raises:
        MortarError: On all ranks, if a body is a single layer of cells.
    """
    P = _projection(space, M, nodes, _nearest)
    moved = M.ptap(P)
    values = _scales(space, M, moved)
    if values is None:
        P = _projection(space, M, nodes, _extrapolating)
        return M.ptap(P), P
    scales = moved.createVecLeft()
    scales.array[:] = values
    moved.diagonalScale(scales, scales)
    return moved, P


def _scales(space: DisplacementSpace, M: PETSc.Mat, moved: PETSc.Mat) -> Array | None:
    """Factors of owned dofs that restore the moments of M; ``None`` if there are none."""
    comm, dofs, dim = space.V.mesh.comm, space.owned_dofs, space.dim
    labels, count = label_bodies(space.V)
    labels, X = labels[: len(dofs)], space.V.tabulate_dof_coordinates()[: len(dofs), :dim]
    num_nodes, scales = space.V.dofmap.index_map.size_global, np.ones(space.num_owned)
    for label in range(count):
        mine = labels == label
        centre, size = centre_and_size(X[mine], comm)
        fields = np.zeros((1 + dim, space.num_owned))  # 1, x, y (and z) as first components
        fields[0, dofs[mine, 0]] = 1.0
        fields[1:, dofs[mine, 0]] = ((X[mine] - centre) / size).T
        powers = np.array([fields[a] * fields[b] for a, b in MOMENTS[dim]])
        target = _moments(M, fields, fields, comm)
        factors = np.zeros(len(MOMENTS[dim]))
        for _ in range(MAX_STEPS):
            scaled = (1.0 + factors @ powers) * fields
            missing = target - _moments(moved, scaled, scaled, comm)
            # the number of all nodes: no rank may leave this loop alone
            if np.abs(missing).max() <= EPSILON * num_nodes * np.abs(target).max():
                break
            by_factors = [2.0 * _moments(moved, scaled, p * fields, comm) for p in powers]
            factors = factors + np.linalg.lstsq(np.transpose(by_factors), missing, rcond=None)[0]
        mass = 1.0 + factors @ powers[:, dofs[mine, 0]]
        smallest = comm.allreduce(float(mass.min(initial=np.inf)), min)
        if np.abs(missing).max() > ROUNDING * np.abs(target).max() or smallest <= 0.0:
            return None
        scales[dofs[mine]] = mass[:, None]
    return scales


def _moments(M: PETSc.Mat, one: Array, other: Array, comm: MPI.Comm) -> Array:
    """Symmetric parts of one_a . M other_b for all ``MOMENTS``, equal on all ranks."""
    products = comm.allreduce(one @ np.array([times(M, field) for field in other]).T)
    pairs = MOMENTS[len(one) - 1]
    return np.array([0.5 * (products[a, b] + products[b, a]) for a, b in pairs])


def times(M: PETSc.Mat, values: Array) -> Array:
    """M times ``values`` (owned dofs,), of the same shape [mass times their unit] (collective)."""
    x, y = M.createVecs()
    x.array[:] = values
    M.mult(x, y)
    return y.array_r.copy()


def _projection(
    space: DisplacementSpace, layout: PETSc.Mat, nodes: Indices, weigh: Weigh
) -> PETSc.Mat:
    """The matrix P, shape (N, N); its columns at dofs of S are zero (collective)."""
    index_map, first = space.V.dofmap.index_map, space.V.dofmap.index_map.local_range[0]
    stencils = _stencils(space.V, np.unique(nodes), weigh)
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


def _stencils(V: Any, nodes: Indices, weigh: Weigh) -> dict[int, tuple[Indices, Array]]:
    """Neighbours inside the body and their weights for each node, equal on all ranks."""
    cells, _ = _cells_at(V, nodes)
    near, at = _cells_at(V, np.unique(cells))
    where = dict(zip(near.ravel().tolist(), at.reshape(-1, at.shape[2]), strict=True))
    ring = _neighbours(near)
    without = set(nodes.tolist())
    found = {}
    for node in nodes.tolist():
        first = ring[node] - without
        both = set().union(*(ring[n] for n in ring[node])) - without
        around = both if weigh is _extrapolating or not first else first
        numbers = np.array(sorted(around, key=lambda n: tuple(where[n])), np.int64)
        offsets = np.array([where[n] - where[node] for n in numbers.tolist()]).reshape(
            -1, at.shape[2]
        )
        weights = weigh(offsets)
        if weights is None:
            raise MortarError(
                f"the body at {format_point(where[node])} has fewer than two layers of nodes "
                "behind the slave surface, which could carry its mass: refine the body, take the "
                "other side as the slave, or use scheme='generalized_alpha'"
            )
        found[node] = numbers, weights
    return found


def _nearest(offsets: Array) -> Array | None:
    """Weights of points at ``offsets`` (n, dim) for a value at the origin: 1 for the nearest."""
    square = (offsets**2).sum(axis=1)
    weights = (square.min(initial=np.inf) / square) ** 2
    return weights / weights.sum() if weights.size else None


def _extrapolating(offsets: Array) -> Array | None:
    """Smallest weights of points at ``offsets`` (n, dim) that extrapolate affine fields to zero.

    Squared weights are multiplied by r^2 in the norm, so that near points have larger weights.
    """
    square = (offsets**2).sum(axis=1)
    size = np.sqrt(square.max(initial=0.0)) or 1.0
    fields = np.vstack([np.ones(len(offsets)), offsets.T / size])
    gram = (fields / square) @ fields.T
    if np.linalg.matrix_rank(gram, tol=SAME_PLACE * np.abs(gram).max(initial=1.0)) < len(gram):
        return None
    return (np.linalg.solve(gram, np.eye(len(gram))[0]) @ fields) / square


def _cells_at(V: Any, nodes: Indices) -> tuple[Indices, Array]:
    """Nodes (n, k) of all cells at ``nodes``, and their positions (n, k, dim) [length]."""
    comm, mesh = V.mesh.comm, V.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    local = compat.dofmap(V)[:owned]
    index_map = V.dofmap.index_map
    count = index_map.size_local + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(count, dtype=np.int32))
    touched = np.isin(numbers, nodes)[local].any(axis=1)
    cells = comm.allgather(numbers[local[touched]])
    positions = comm.allgather(V.tabulate_dof_coordinates()[local[touched], : mesh.geometry.dim])
    return np.concatenate(cells).astype(np.int64), np.concatenate(positions)


def _neighbours(cells: Indices) -> dict[int, set[int]]:
    """Nodes that share a cell with each node, the node itself included."""
    ring: dict[int, set[int]] = {}
    for cell in cells.tolist():
        for node in cell:
            ring.setdefault(node, set()).update(cell)
    return ring
