# SPDX-License-Identifier: MIT
"""What multigrid needs of contact: the tangent R^T L A T R, nodal axes, factors of a strip.

T and L differ from the identity only at contact surfaces: L A T is A plus a small matrix of the
dofs near them, as bodies that remain in contact have it. R turns the components of each node, in
the rows and columns of A. ``Strip`` has the factors of the rows and columns in a strip along
contact.

The nodal axes are aligned with contact tangents and interpolated smoothly in between, see
``turned_axes``; ``rigid_motions_along`` gives the rigid motions along them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
from scipy.sparse import bsr_array, csr_array

from fenics_mortar.bulk.bodies import centre_and_size, label_bodies
from fenics_mortar.bulk.node_blocks import CSR, LocalRows, from_local_csr, local_csr
from fenics_mortar.kernels.blocks import turn_blocks
from fenics_mortar.la import options
from fenics_mortar.la.sparse import SomeRows, with_rows
from fenics_mortar.obstacles.rigid_motion import rigid_motions
from fenics_mortar.utils import compat, ranks
from fenics_mortar.utils.arrays import ROUNDING, SMALL_ANGLE, Array, Indices

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.interface.surfaces import Surface

# Size of the block of two nodes over the root of the product of their stiffness [1], up to which
# it is left out. Near contact T and L make 3.9 million entries of 2.3 million in space; without
# blocks up to 1e-4 there are 2.6 million, set-up and cycle take four fifths of the time, and
# iterations remain, which rise by a quarter with 1e-2.
MIN_BLOCK = 1e-4


def touching_tangent(
    A: PETSc.Mat, near: SomeRows, motion: PETSc.Mat, equations: PETSc.Mat, axes: Array,
    stiffness: Array,
) -> PETSc.Mat:  # fmt: skip
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
    touching, dim = with_rows(A, _contact_change(A, near, motion, equations)), axes.shape[1]
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
    sizes = np.sqrt(of_rows[rows] * of_columns[blocks.indices])
    kept = np.abs(blocks.data).max(axis=(1, 2), initial=0.0) > MIN_BLOCK * sizes
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
    starts, columns = (a.astype(PETSc.IntType, copy=False) for a in (found.indptr, found.indices))
    return starts, columns, found.data


def _contact_change(A: PETSc.Mat, near: SomeRows, motion: PETSc.Mat, equations: PETSc.Mat) -> CSR:
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
    starts = near.starts(starts, A.getLocalSize()[0])
    return starts, near.rows[columns].astype(PETSc.IntType), values


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
    """At most ``TANGENTS`` active nodes with one constrained direction; ties constrain all."""
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


# Layers of cells of the strip on either side of contact, in the plane and in space, where the
# factors of a layer have long rows.
LAYERS = {2: 2, 3: 1}


class Strip:
    """Factored rows and columns of the dofs near contact surfaces; methods are collective.

    A solution in the strip is zero elsewhere, except at prescribed dofs: its product with the
    matrix differs from zero only in the rows next to these dofs. The product uses a copy of these
    entries instead of the whole matrix.

    In the plane the matrix is factored without pivoting, which takes half of the time, until the
    residual of a solution shows that pivots are needed, as with rows of multipliers. In space MUMPS
    factors it, on all ranks together.

    Args:
        bulk: The bodies.
        prefix: Prefix of PETSc's options.
        multipliers: Number of rows of multipliers after those of dofs; all are in the strip.

    Attributes:
        dofs: Owned dofs of the strip, shape (n,).
        num_rows: Rows of the strip, summed over all ranks.
    """

    def __init__(self, bulk: Bulk, prefix: str, multipliers: int) -> None:
        self._prefix, self._prescribed, self._comm = prefix, bulk.prescribed_dofs, bulk.comm
        self._bulk, self._multipliers = bulk, multipliers
        self.dofs = np.empty(0, np.int64)
        self._matrix: Any = None
        self._columns: Any = None
        self._factors: Any = None
        self._in_plane = bulk.space.dim == 2
        self._options = options.STRIP_FACTORS if self._in_plane else options.STRIP_IN_SPACE
        self._pattern = (0, 0.0)  # handle and number of entries of the matrix

    def move_to(self, dofs: Indices) -> None:
        """Put the strip around owned ``dofs`` (k,)."""
        bulk = self._bulk
        self.dofs = with_neighbours(bulk, dofs, LAYERS[bulk.space.dim])
        rows = np.arange(bulk.num_owned, bulk.num_owned + self._multipliers)
        self._rows = np.append(self.dofs, rows)
        self.num_rows = bulk.comm.allreduce(self._rows.size)
        self._solved = np.union1d(self._rows, self._prescribed)
        dofs = self._solved[self._solved < bulk.num_owned]
        self._touched = np.append(with_neighbours(bulk, dofs, 1), rows)
        self.forget_pattern()

    def factor(self, A: PETSc.Mat, *, keep: bool = False) -> None:
        """Factor the strip of ``A``, whose pattern may have changed, as it always has in space.

        Args:
            A: The matrix.
            keep: Whether the present factors, if there are any, serve as those of ``A``.
        """
        pattern = A.handle, A.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"]
        same = self._in_plane and pattern == self._pattern
        keep = keep and self._factors is not None
        if not ranks.on_all_ranks(self._comm, same):
            self.forget_pattern(keep_factors=keep)
            self._pattern = pattern
        first, _ = A.getOwnershipRange()
        whole, solved, touched = (
            PETSc.IS().createGeneral((rows + first).astype(PETSc.IntType), self._comm)
            for rows in (self._rows, self._solved, self._touched)
        )
        self._columns = A.createSubMatrix(touched, solved, self._columns)
        self._on_solved, self._on_touched = self._columns.createVecs()
        self._diagonal = A.getDiagonal().array_r[self._prescribed]
        if keep:
            return
        self._matrix = A.createSubMatrix(whole, whole, self._matrix)
        self._b, self._x = self._matrix.createVecs()
        self._compute_factors()
        if self._options is options.STRIP_FACTORS and not self._is_accurate():
            self._options = options.STRIP_PIVOTS
            self._compute_factors()

    def forget_pattern(self, *, keep_factors: bool = False) -> None:
        """Begin anew for the next matrix, whose pattern differs; its factors may be the present."""
        if self._columns is not None:
            self._columns.destroy()
        self._columns = None
        if keep_factors:
            return
        for of_pattern in (self._factors, self._matrix):
            if of_pattern is not None:
                of_pattern.destroy()
        self._factors = self._matrix = None

    def _compute_factors(self) -> None:
        """Factor the matrix, without pivoting in the order of elimination of the last one."""
        if self._factors is None or self._options is not options.STRIP_FACTORS:
            if self._factors is not None:
                self._factors.destroy()
            self._factors = PETSc.PC().create(self._comm)
            self._factors.setOptionsPrefix(self._prefix)
        with options.options_added(self._prefix, self._options):
            self._factors.setFromOptions()
            self._factors.setOperators(self._matrix)
            self._factors.setUp()

    def _is_accurate(self) -> bool:
        """Whether the residual of one solution is as small as without growth of the pivots."""
        self._b.set(1.0)
        self._factors.apply(self._b, self._x)
        size = self._b.norm()
        self._matrix.mult(self._x, self._b)
        self._b.shift(-1.0)
        return bool(self._b.norm() <= options.WITHOUT_PIVOTING * size)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, *, transpose: bool = False) -> None:
        """Solve for the rows of the strip and for prescribed dofs; other values are zero.

        Args:
            b: Right-hand side of the whole matrix.
            x: The solution; changed.
            transpose: Whether to solve with the transposed factors.
        """
        x.set(0.0)
        x.array[self._prescribed] = b.array_r[self._prescribed] / self._diagonal
        self._b.array[:] = b.array_r[self._rows]
        apply = self._factors.applyTranspose if transpose else self._factors.apply
        apply(self._b, self._x)
        x.array[self._rows] = self._x.array_r

    def subtract_product(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Subtract A x from ``b`` for a solution ``x`` of ``solve``.

        Args:
            x: The solution, zero outside of the strip and of prescribed dofs.
            b: Vector of the whole matrix; changed.
        """
        self._on_solved.array[:] = x.array_r[self._solved]
        self._columns.mult(self._on_solved, self._on_touched)
        b.array[self._touched] -= self._on_touched.array_r

    def subtract_transposed(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Subtract A^T x from ``b`` in the rows that ``solve`` uses.

        Args:
            x: Any vector.
            b: Vector of the whole matrix; changed.
        """
        self._on_touched.array[:] = x.array_r[self._touched]
        self._columns.multTranspose(self._on_touched, self._on_solved)
        b.array[self._solved] -= self._on_solved.array_r


def dofs_of(surfaces: Sequence[Surface]) -> Indices:
    """Owned dofs of the nodes of surfaces, shape (n,) (local)."""
    dofs = [np.empty(0, np.int64), *(surface.local_dofs.ravel() for surface in surfaces)]
    return np.unique(np.concatenate(dofs))


def with_neighbours(bulk: Bulk, dofs: Indices, layers: int) -> Indices:
    """Owned dofs, shape (n,), within ``layers`` of cells of owned ones (collective).

    By the cells: K has entries of contact, too, where its pattern was extended.
    """
    V, size = bulk.V, bulk.space.block_size
    index_map, cells = V.dofmap.index_map, compat.dofmap(V)
    count = index_map.size_local + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(count, dtype=np.int32))
    found = np.unique(dofs // size)
    for _ in range(layers):
        everywhere = np.concatenate(bulk.comm.allgather(numbers[found]))
        found = np.unique(cells[np.isin(numbers, everywhere)[cells].any(axis=1)])
    everywhere = np.unique(np.concatenate(bulk.comm.allgather(numbers[found])))
    first, end = index_map.local_range
    mine = everywhere[(everywhere >= first) & (everywhere < end)] - first
    return (size * mine[:, None] + np.arange(size)).ravel()
