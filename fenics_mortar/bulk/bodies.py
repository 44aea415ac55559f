# SPDX-License-Identifier: MIT
"""Separate bodies of a mesh, and their rigid motions without resistance of the bulk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import ROUNDING, TINY, Array, Flags, Indices
from fenics_mortar.utils.errors import format_point

# Rotation or translation of a motion of size one [1] below which messages leave it out.
MINOR = 0.1


@dataclass(frozen=True)
class PartMotion:
    """Translation of one side of a section of a body along an axis, against the other side.

    Attributes:
        name: Name of the section.
        number: Position of its load among the remote loads with motions.
        axis: Direction in which the side moves when the body is tightened, shape (2,) [1].
        moves: Whether a part of the mesh moves, shape (parts,), bool.
    """

    name: str
    number: int
    axis: Array
    moves: Flags


@dataclass(frozen=True)
class FloatingBody:
    """A body with rigid motions that neither Dirichlet conditions nor the bulk tangent resist.

    Sections may separate it into parts, which then move against each other.

    Attributes:
        label: Number of the body.
        centre: Mean reference position of its nodes, shape (dim,) [length].
        size: Radius of gyration of its nodes [length].
        motions: Orthonormal combinations of the translations, of the rotations about the centre
            times ``size``, one in the plane and three in space, and of the motion of each section,
            shape (number of free motions, 3 + s) or, in space, (number, 6 + s).
        stiffest: Largest diagonal entry of K in the body [stress].
        num_nodes: Number of its nodes on all ranks.
        sections: The s sections that separate it.
    """

    label: int
    centre: Array
    size: float
    motions: Array
    stiffest: float
    num_nodes: int
    sections: Sequence[PartMotion] = ()

    def displacement(self, X: Array, parts: Indices) -> Array:
        """Free motions at points, shape (motions, n, dim) [1] (local).

        Args:
            X: The points, shape (n, dim) [length].
            parts: Parts of the mesh in which they lie, shape (n,).
        """
        rigid = rigid_motions(X, self.centre, self.size)
        return np.einsum("fm,mnc->fnc", self.motions, np.vstack([rigid, *self.of_parts(parts)]))

    def of_parts(self, parts: Indices) -> list[Array]:
        """Unit motion of each section at points in ``parts`` (n,), (1, n, 2) [1] each (local)."""
        return [np.outer(motion.moves[parts], motion.axis)[None] for motion in self.sections]

    def without(self, responses: Array) -> FloatingBody:
        """This body with its motions of zero response; it may have none left (local).

        Args:
            responses: Responses to each motion, shape (motions, n) [1].
        """
        left, sizes, _ = np.linalg.svd(responses)
        rank = int((sizes > ROUNDING * max(1.0, sizes.max(initial=0.0))).sum())
        return replace(self, motions=left[:, rank:].T @ self.motions)

    def without_rotation(self, distance: Array) -> FloatingBody:
        """This body with its motions that move two points alike; it may have none left (local).

        Args:
            distance: Vector from one point to the other, shape (2,) [length].
        """
        here, there = np.moveaxis(
            rigid_motions(
                self.centre + np.stack([0.0 * distance, distance]), self.centre, self.size
            ),
            1,
            0,
        )
        turning = (there - here) * (self.size / np.linalg.norm(distance))
        return self.without(self.motions[:, : len(turning)] @ turning)

    def describe(self, motion: Array, *, directed: bool = False) -> str:
        """Describe a free motion (local).

        Args:
            motion: Factors of ``motions``, shape (number of free motions,).
            directed: Whether the sign of a translation matters.
        """
        shares = np.round(motion @ self.motions / np.linalg.norm(motion), 4)
        rigid, at_sections = np.split(shares + 0.0, [len(shares) - len(self.sections)])
        if np.abs(at_sections).max(initial=0.0) > MINOR:
            most = int(np.abs(at_sections).argmax())
            how = "be shortened" if at_sections[most] > 0.0 or not directed else "be pulled apart"
            return f"{how} at section '{self.sections[most].name}'"
        if len(self.centre) == 3:
            return describe_in_space(rigid[:3], rigid[3:])
        x, y, rotation = rigid
        x, y = (x, y) if directed or rotation or (x, y) > (0.0, 0.0) else (-x, -y)
        if abs(rotation) > MINOR:
            pole = self.centre + self.size / rotation * np.array([-y, x])
            return f"rotate about {format_point(pole)}"
        return f"move along {format_point((x + 0.0, y + 0.0))}"


def describe_in_space(translation: Array, rotation: Array, *, verb: str = "rotate") -> str:
    """Describe a motion of size one in space by its larger parts (local)."""
    parts = [
        f"{does} {format_point(vector)}"
        for does, vector in (("move along", translation), (f"{verb} about the axis", rotation))
        if np.linalg.norm(vector) > MINOR
    ]
    return " and ".join(parts)


def rigid_motions(X: Array, centre: Array, size: float) -> Array:
    """Translations and rotations about ``centre`` over ``size`` at ``X`` (n, dim) [1] (local).

    Returns:
        Shape (3, n, 2) in the plane: two translations and the rotation; (6, n, 3) in space: three
        translations and the rotations about the three axes.
    """
    r = (X - centre) / size
    if X.shape[1] == 3:
        axes = np.eye(3)
        moved = np.repeat(axes[:, None], len(X), axis=1)
        return np.concatenate([moved, np.cross(axes[:, None], r[None])])
    one, zero = np.ones(len(X)), np.zeros(len(X))
    rows = [(one, zero), (zero, one), (-r[:, 1], r[:, 0])]
    return np.array([np.stack(row, axis=1) for row in rows])


def label_bodies(V: Any) -> tuple[Indices, int]:
    """Number the connected components of the mesh (collective).

    Returns:
        Body of each local node of the space ``V``, ghosts included, shape (local nodes,), and the
        number of bodies.
        Bodies are numbered by their lowest node; the order may depend on the partition.
    """
    comm, index_map, dofs = V.mesh.comm, V.dofmap.index_map, compat.dofmap(V)
    owned, count = index_map.size_local, index_map.size_local + index_map.num_ghosts
    first = np.repeat(dofs[:, :1], dofs.shape[1] - 1, axis=1).ravel()
    links = coo_array((np.ones(first.size), (first, dofs[:, 1:].ravel())), shape=(count, count))
    count_here, component = connected_components(links, directed=False)
    offsets = np.concatenate([[0], np.cumsum(comm.allgather(count_here))])
    component = component + offsets[comm.rank]
    begin, end = index_map.local_range
    ghosts = np.concatenate(comm.allgather(np.asarray(index_map.ghosts)))
    ghost_component = np.concatenate(comm.allgather(component[owned:]))
    mine = (ghosts >= begin) & (ghosts < end)
    pairs = np.stack([ghost_component[mine], component[ghosts[mine] - begin]], axis=1)
    pairs = np.concatenate(comm.allgather(np.unique(pairs, axis=0)))
    total = int(offsets[-1])
    bridges = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(total, total))
    bodies, body = connected_components(bridges, directed=False)
    return body[component].astype(np.int64), bodies


def join_bodies(labels: Indices, num_bodies: int, links: Sequence[Indices]) -> tuple[Indices, int]:
    """Merge linked bodies: new ``labels`` and number of bodies (local).

    Args:
        labels: Body of each local node, shape (n,).
        num_bodies: Number of bodies.
        links: Pairs of bodies, equal on all ranks, shapes (k, 2).
    """
    pairs = np.concatenate([np.empty((0, 2), np.int64), *links])
    bridges = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(num_bodies, num_bodies))
    count, body = connected_components(bridges, directed=False)
    return body[labels].astype(np.int64), count


def find_floating_bodies(
    bulk: Bulk,
    labels: Indices,
    num_bodies: int,
    prescribed: Flags | None = None,
    sections: Mapping[int, Sequence[PartMotion]] = MappingProxyType({}),
    parts: Indices | None = None,
) -> list[FloatingBody]:
    """Find bodies with free rigid motions, with ``bulk.K`` as assembled (collective).

    A motion is free if its resistance is rounding compared with the stiffness of the body.

    Args:
        bulk: Residual and tangent of the bodies.
        labels: Body of each local node, shape (local nodes,).
        num_bodies: Number of bodies.
        prescribed: Marks of the local dofs that resist, (local dofs,); by default the prescribed.
        sections: Sections of bodies, by their labels.
        parts: Part of the mesh of each local node, shape (local nodes,); needed with sections.
    """
    held = (bulk.prescribed if prescribed is None else prescribed)[: bulk.num_owned]
    dofs = bulk.space.owned_dofs
    X = bulk.V.tabulate_dof_coordinates()[: len(dofs), : bulk.space.dim]
    labels = labels[: len(dofs)]
    parts = (labels if parts is None else parts)[: len(dofs)]
    diagonal = np.abs(bulk.K.getDiagonal().array_r)
    found = []
    for label in range(num_bodies):
        mine = labels == label
        body = centre_and_size(X[mine], bulk.comm)
        own = tuple(sections.get(label, ()))
        count = len(rigid_motions(X[:0], *body)) + len(own)
        basis = FloatingBody(label, *body, np.eye(count), TINY, 0, own)
        motions = np.zeros((count, bulk.num_owned))
        motions[:, dofs[mine]] = basis.displacement(X[mine], parts[mine])
        at_prescribed = np.where(held, motions, 0.0)
        stiffest = diagonal[dofs[mine]].max(initial=0.0)
        stiffest = max(bulk.comm.allreduce(float(stiffest), MPI.MAX), TINY)
        stiff = bulk.to_force * _apply(bulk.K, motions) / stiffest
        size, directions = resistance(np.hstack([at_prescribed, stiff]), bulk.comm)
        num_nodes = bulk.comm.allreduce(int(mine.sum()))
        free = directions[size < ROUNDING * np.sqrt(num_nodes)]
        if len(free):
            found.append(replace(basis, motions=free, stiffest=stiffest, num_nodes=num_nodes))
    return found


def resistance(responses: Array, comm: MPI.Comm) -> tuple[Array, Array]:
    """Resistance to motions, as norms of the forces that they cause (collective).

    Args:
        responses: Local forces due to each of m motions, shape (m, n).
        comm: Communicator of the forces.

    Returns:
        Norms of the forces due to m orthonormal combinations of the motions [stress length], in
        descending order, and these combinations, shape (m, m) [1]. Unlike eigenvalues of the
        Gram matrix, the norms are accurate to rounding.
    """
    count = len(responses)
    triangle = np.linalg.qr(np.vstack([responses.T, np.zeros((count, count))]), mode="r")
    _, norms, combinations = np.linalg.svd(np.concatenate(comm.allgather(triangle)))
    return norms, combinations


def centre_and_size(X: Array, comm: MPI.Comm) -> tuple[Array, float]:
    """Mean and radius of gyration [length] of points (n, dim) of all ranks (collective)."""
    count = comm.allreduce(len(X))
    centre = comm.allreduce(X.sum(axis=0)) / count
    return centre, float(np.sqrt(comm.allreduce(((X - centre) ** 2).sum()) / count))


def _apply(K: Any, vectors: Array) -> Array:
    """K times each row of ``vectors``, owned entries (collective)."""
    x, y = K.createVecs()
    result = np.empty_like(vectors)
    for row, vector in zip(result, vectors, strict=True):
        x.array[:] = vector
        K.mult(x, y)
        row[:] = y.array_r
    return result
