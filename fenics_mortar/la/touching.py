# SPDX-License-Identifier: MIT
"""The tangent of bodies that remain in contact, in components along nodal axes: R^T L A T R.

T and L differ from the identity only at contact surfaces: L A T is A plus a small matrix of the
dofs near them. R turns the components of each node, in the rows and columns of A.

Nodal axes for multigrid: aligned with contact tangents, interpolated smoothly in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_array, csr_array

from fenics_mortar.bulk.bodies import centre_and_size, label_bodies
from fenics_mortar.bulk.node_blocks import CSR, LocalRows, from_local_csr, local_csr
from fenics_mortar.kernels.node_blocks import turn_blocks
from fenics_mortar.la.sparse import SomeRows, with_rows
from fenics_mortar.obstacles.rigid_motion import rigid_motions
from fenics_mortar.utils.arrays import ROUNDING, SMALL_ANGLE, Array, Indices

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface


# Size of the block of two nodes over the root of the product of their stiffness [1], up to which
# it is left out. Near contact T and L make 3.9 million entries of 2.3 million in space; without
# blocks up to 1e-4 there are 2.6 million, set-up and cycle take four fifths of the time, and
# iterations remain, which rise by a quarter with 1e-2.
MIN_BLOCK = 1e-4


def touching_tangent(
    A: PETSc.Mat,
    near: SomeRows,
    motion: PETSc.Mat,
    equations: PETSc.Mat,
    axes: Array,
    stiffness: Array,
) -> PETSc.Mat:
    """R^T L A T R, without blocks of nodes that are at most ``MIN_BLOCK`` (collective).

    Args:
        A: Tangent of the displacements, with dim dofs per node [stress].
        near: The dofs near contact: all entries of A in rows or columns of T - 1 and L - 1 lie
            in their rows and columns.
        motion: T - 1 of these dofs [1].
        equations: L^T - 1 of these dofs [1].
        axes: Axes of the owned nodes, in columns, shape (nodes, dim, dim) [1].
        stiffness: Stiffness of the owned nodes, shape (nodes,) [stress].
    """
    touching, dim = with_rows(A, _change_by_contact(A, near, motion, equations)), axes.shape[1]
    comm = A.comm.tompi4py()
    own, *others = local_csr(touching)
    found = [(_in_blocks(own, own.columns, stiffness, stiffness, dim), axes)]
    for part in others:
        nodes, number = np.unique(np.asarray(part.numbers) // dim, return_inverse=True)
        columns = (dim * number + np.asarray(part.numbers) % dim)[part.columns]
        of_nodes = np.stack([_values_at(A, axes[:, k], nodes) for k in range(dim)], axis=1)
        there = _values_at(A, np.repeat(stiffness[:, None], dim, axis=1), nodes)[:, 0]
        found.append((_in_blocks(part, columns, stiffness, there, dim), of_nodes))
    touching.destroy()  # before another copy of the entries is made
    turned = [_turned(blocks, axes, of_columns) for blocks, of_columns in found]
    if others:
        starts, columns, values = turned[1]
        columns = dim * nodes[columns // dim] + columns % dim
        turned[1] = starts, columns.astype(PETSc.IntType, copy=False), values
    B = from_local_csr(comm, turned[0], turned[-1])
    B.setBlockSize(dim)
    return B


def _in_blocks(
    part: LocalRows, columns: Indices, of_rows: Array, of_columns: Array, dim: int
) -> bsr_array:
    """Some columns of a matrix, as blocks of nodes, without negligible ones (local).

    Args:
        part: These columns.
        columns: Local numbers of the columns of its entries, shape (entries,).
        of_rows: Stiffness of the nodes of the rows, shape (n,) [stress].
        of_columns: That of the nodes of the columns, shape (m,) [stress].
        dim: Number of dofs of a node.
    """
    shape = dim * of_rows.size, dim * of_columns.size
    blocks = csr_array((part.values(), columns, part.starts), shape=shape).tobsr((dim, dim))
    blocks.sort_indices()
    rows = np.repeat(np.arange(of_rows.size), np.diff(blocks.indptr))
    kept = np.abs(blocks.data).max(axis=(1, 2), initial=0.0) > MIN_BLOCK * np.sqrt(
        of_rows[rows] * of_columns[blocks.indices]
    )
    if part.numbers is None:
        kept |= rows == blocks.indices  # of tied nodes these are zero
    starts = np.append(0, np.cumsum(np.bincount(rows[kept], minlength=of_rows.size)))
    return bsr_array((blocks.data[kept], blocks.indices[kept], starts), shape=shape)


def _turned(blocks: bsr_array, of_rows: Array, of_columns: Array) -> CSR:
    """Some columns of R^T B R (local).

    Args:
        blocks: These columns of B; changed.
        of_rows: Axes of the nodes of the rows, shape (n, dim, dim) [1].
        of_columns: Those of the nodes of the columns, shape (m, dim, dim) [1].
    """
    turn_blocks(blocks.indptr, blocks.indices, blocks.data, of_rows, of_columns)
    found = blocks.tocsr()
    return (
        found.indptr.astype(PETSc.IntType, copy=False),
        found.indices.astype(PETSc.IntType, copy=False),
        found.data,
    )


def _change_by_contact(
    A: PETSc.Mat, near: SomeRows, motion: PETSc.Mat, equations: PETSc.Mat
) -> CSR:
    """L A T - A, with entries near contact only."""
    dofs = PETSc.IS().createGeneral(near.owned.astype(PETSc.IntType), A.comm)
    K = A.createSubMatrix(dofs, dofs)
    change = K.matMult(motion)
    K.axpy(1.0, change, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    gathered = equations.transposeMatMult(K)
    change.axpy(1.0, gathered, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    starts, columns, values = change.getValuesCSR()
    for matrix in (K, gathered, change):
        matrix.destroy()
    return (
        near.starts(starts, A.getLocalSize()[0]),
        near.rows[columns].astype(PETSc.IntType),
        values,
    )


def _values_at(A: PETSc.Mat, values: Array, nodes: Indices) -> Array:
    """Values (m, dim) at any ``nodes`` (m,), from those at the owned ones, (n, dim)."""
    owned, size = A.createVecRight(), values.shape[1]
    owned.array[:] = values.ravel()
    dofs = size * nodes[:, None].astype(PETSc.IntType) + np.arange(size, dtype=PETSc.IntType)
    numbers = PETSc.IS().createGeneral(dofs.ravel(), comm=PETSc.COMM_SELF)
    found = PETSc.Vec().createSeq(dofs.size, comm=PETSc.COMM_SELF)
    PETSc.Scatter().create(owned, numbers, found, None).scatter(owned, found)
    return found.array_r.reshape(-1, size)


ComplexArray = npt.NDArray[np.complex128]

# Maximum number of tangents per contact that define axes: neighbouring tangents differ little.
TANGENTS = 32
# Maximum number of bodies with rigid motions of their own in the near-null space: an aggregate of
# some ten nodes has 20 dofs, and becomes a node with one dof for each motion.
OWN_MOTIONS = 4


def turned_axes(bulk: Bulk, contacts: Sequence[Interface]) -> Array:
    """Axes of the owned nodes, in rows of their first dofs, (num_owned, dim, dim) [1] (local).

    Columns are the axes. Nodes with some prescribed components keep the axes of the mesh.
    """
    dofs = bulk.space.owned_dofs
    if bulk.space.dim == 3:
        from scipy.spatial.transform import Rotation  # 50 ms, for solids only

        turns = _turns_in_space(contacts, bulk.positions()[: len(dofs)])
        turns[bulk.prescribed[dofs].any(axis=1)] = 0.0
        axes = np.empty((bulk.num_owned, 3, 3))
        if len(turns):  # none on ranks without nodes, which scipy refuses
            axes[dofs[:, 0]] = Rotation.from_rotvec(turns).as_matrix()
        return axes
    t = _tangents(contacts, bulk.positions()[: len(dofs)])
    t[bulk.prescribed[dofs].sum(axis=1) == 1] = 1.0
    axes = np.empty((bulk.num_owned, 2, 2))
    axes[dofs[:, 0]] = np.stack([t.real, -t.imag, t.imag, t.real], axis=1).reshape(-1, 2, 2)
    return axes


def _tangents(contacts: Sequence[Interface], x: Array) -> ComplexArray:
    """First axes (n,) at the positions x (n, 2), as complex numbers.

    Means of the contact tangents, weighted by the inverse fourth power of the distance. A quarter
    turn only exchanges axes: the tangents of each contact are rotated by the number of quarter
    turns for which they are closest to the axes of the mesh.
    """
    z, mean = x @ [1.0, 1.0j], np.full(len(x), 1e-300 + 0.0j)
    for points, tangents in map(sliding_nodes, contacts):
        tangents = tangents * (-1.0j) ** quarter_turns(tangents)
        if np.abs(np.angle(tangents)).max(initial=0.0) < SMALL_ANGLE:
            tangents = np.ones_like(tangents)
        for point, tangent in zip(points, tangents, strict=True):
            away = z - point
            mean += tangent / np.maximum(away.real**2 + away.imag**2, 1e-100) ** 2
    return mean / np.abs(mean)


def _turns_in_space(contacts: Sequence[Interface], x: Array) -> Array:
    """Rotation vectors (n, 3) of the axes at the positions x (n, 3) [radian].

    Means, weighted as in the plane, of the smallest rotations of an axis of the mesh to the normals
    of each contact.
    """
    turns, weights = np.zeros(x.shape), np.full(len(x), 1e-300)
    for contact in contacts:
        j, axis = sliding_in_space(contact)
        if not j.size:
            continue
        n = contact.operators.n[j]
        e = np.eye(3)[axis] * np.sign(n[:, axis].sum())
        across = np.cross(e, n)
        sine = np.linalg.norm(across, axis=1)
        angles = np.arctan2(sine, n @ e)
        turned = across * (angles / np.maximum(sine, 1e-100))[:, None]
        if angles.max() < SMALL_ANGLE:
            turned = np.zeros_like(turned)
        for point, turn in zip(contact.operators.x[j], turned, strict=True):
            weight = 1.0 / np.maximum(((x - point) ** 2).sum(axis=1), 1e-100) ** 2
            turns += weight[:, None] * turn
            weights += weight
    return np.asarray(turns / weights[:, None])


def _untied(contact: Interface) -> Indices:
    """At most ``TANGENTS`` active nodes with one constrained direction, those of ties have all."""
    F = contact.rows.followed()
    j = np.flatnonzero(contact.active & (np.einsum("jab,jba->j", F, F) < 1.5))
    return j[np.linspace(0.0, max(j.size - 1, 0), min(j.size, TANGENTS)).astype(int)]


def sliding_in_space(contact: Interface) -> tuple[Indices, int]:
    """At most ``TANGENTS`` active, untied nodes, and the mesh axis nearest to their mean normal."""
    j = _untied(contact)
    return j, int(np.abs(contact.operators.n[j].sum(axis=0)).argmax())


def quarter_turns(tangents: ComplexArray) -> int:
    """Number of quarter turns from the first axis of the mesh to the mean tangent of a contact."""
    return round(np.angle(tangents.sum()) / (np.pi / 2.0))


def sliding_nodes(contact: Interface) -> tuple[ComplexArray, ComplexArray]:
    """Positions and tangents of at most ``TANGENTS`` active, untied nodes, complex, (n,) each."""
    o, j = contact.operators, _untied(contact)
    return o.x[j] @ [1.0, 1.0j], o.tau[j] @ [1.0, 1.0j]


def tangential_axes(contact: Interface) -> list[int]:
    """Numbers of the nodal axes that are tangents of a contact; none if no node slides."""
    if contact.slave.dim == 3:
        j, normal = sliding_in_space(contact)
        return [axis for axis in range(3) if axis != normal] if j.size else []
    _, tangents = sliding_nodes(contact)
    return [quarter_turns(tangents) % 2] if tangents.size else []


def rigid_motions_along(axes: Array, bulk: Bulk, B: PETSc.Mat) -> PETSc.NullSpace:
    """Near-null space of the tangent along nodal axes: rigid motions of each body (collective).

    Bodies may slide: with motions of all bodies together there are a third more iterations on flat
    contact, a fifth less on curved contact.

    Args:
        axes: As of ``turned_axes``.
        bulk: The bodies.
        B: Tangent of the owned dofs along the axes.
    """
    dofs = bulk.space.owned_dofs
    x = bulk.positions()[: len(dofs)]
    labels, count = label_bodies(bulk.V)
    bodies = [labels[: len(dofs)] == body for body in range(count)]
    if count > OWN_MOTIONS:
        bodies = [np.ones(len(dofs), bool)]
    vectors: list[PETSc.Vec] = []
    for body in bodies:
        for motion in rigid_motions(x, *centre_and_size(x[body], bulk.comm)):
            vector = B.createVecRight()
            along = np.einsum("na,nab->nb", motion, axes[dofs[:, 0]])
            vector.array[dofs] = np.where(body[:, None], along, 0.0)
            vector.array[bulk.prescribed_dofs] = 0.0
            size = vector.norm()
            for other in vectors:
                vector.axpy(-other.dot(vector), other)
            if vector.normalize() > ROUNDING * size:
                vectors.append(vector)
    return PETSc.NullSpace().create(vectors=vectors, comm=B.comm)
