# SPDX-License-Identifier: MIT
"""How far a solved state is from equilibrium between the nodes: an indicator for each cell.

The exact stress has div P + f = 0 in the bodies and one traction on both sides of every line; on
the boundary it is the given one or that of contact. What a solution lacks of it, in the norm of
energy:

    eta_T^2 = b h^2 |div P + f|^2 / Q + sum over sides of c h [P N - t] . Q^-1 [P N - t] + gap,

with Q_ik = dP_iJ / dF_kL N_J N_L, the stiffness of a layer across N (for linear elasticity
lambda + 2 mu along N and mu across it), in the cell its mean over N; t is the mean traction of the
two cells of an inner side, on the boundary the given one, on both contact surfaces that of the
multipliers. The discrete gap is closed in the mean only: penetration g counts by (Q_nn / 2 h) g^2,
what it takes to press it into the layers on both sides, and so does opening where all nodes of a
facet are active; elsewhere it counts by the work z_n g. Straight facets of a curved surface leave
gaps and overlaps that are none of the exact surface: there the estimate is high.
These are the terms of Hild and Nicaise (Numer. Math. 101, 2005) and of Krause, Veeser and Walloth
(Numer. Math. 130, 2015), who prove them for linear elasticity on a rigid obstacle.

Why not average the stress (Zienkiewicz and Zhu): that smears it over interfaces of materials, does
not see loads and contact, and gains less with degree 2. What a residual lacks are sharp constants;
b and c are those with which each term alone is exact for a layer of cells under a stress that
varies across it by one degree more than the cells can follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from fenics_mortar import compat
from fenics_mortar.bulk import Bulk
from fenics_mortar.contact import Contact
from fenics_mortar.fluxes import Fluxes, ReferenceCell
from fenics_mortar.interface import Interface
from fenics_mortar.surfaces import Array, Indices, Surface

# b and c by degree
IN_CELL = {1: 1 / 12, 2: 1 / 60}
ON_SIDE = {1: 1 / 6, 2: 1 / 10}
# Gauss points on a segment or facet of contact
POINTS = 4
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimate of the error of the displacement in the norm of energy.

    Attributes:
        cells: Indicator of each cell of this rank, shape (owned cells,) [stress^1/2 length].
        size: Norm of the solution itself, the root of the integral of P : grad u [likewise].
        parts: Norms of the terms: "cells", "sides" between cells, "boundary", "contact"
            (tractions) and "gap"; equal on all ranks, as are ``size`` and what follows of both.
        mesh: The mesh.
    """

    cells: Array
    size: float
    parts: dict[str, float]
    mesh: Any

    @property
    def total(self) -> float:
        """Estimate of the error of all bodies [stress^1/2 length]."""
        return float(np.sqrt(sum(part**2 for part in self.parts.values())))

    @property
    def relative(self) -> float:
        """The same by the norm of the solution, a plain number."""
        return self.total / self.size if self.size > 0.0 else np.inf

    def mark(self, part: float = 0.5) -> Indices:
        """Mark the fewest cells with this ``part`` of the squared estimate (Doerfler; collective).

        Returns:
            Their numbers on this rank. Cells with equal indicators are marked together.
        """
        mine = self.cells**2
        squares = np.sort(np.concatenate(self.mesh.comm.allgather(mine)))[::-1]
        enough = np.cumsum(squares) >= part * (1 - 1e-12) * squares.sum()
        return np.flatnonzero(mine >= squares[np.argmax(enough)] * (1 - 1e-12))


class Estimator:
    """The indicator for some bodies; compiled once.

    Args:
        bulk: The bodies.

    Raises:
        MortarError: If the residual has integrals that cannot be read.
    """

    def __init__(self, bulk: Bulk) -> None:
        """Read the form and compile (collective)."""
        self._mesh = bulk.V.mesh
        self._fluxes = Fluxes(bulk.residual, bulk.u, bulk.space)
        self._sides = Sides(bulk, self._fluxes.cell.sides)
        self._degree = self._sides.nodes.shape[2] - 1

    def evaluate(self, interfaces: Sequence[Interface]) -> ErrorEstimate:
        """Estimate the error of the present state, at which all is evaluated (collective).

        Tied surfaces count by their tractions; what their displacements differ by between the
        nodes does not.
        """
        cell, sides = self._fluxes.cell, self._sides
        inside, along = self._fluxes.in_cells()
        A = self._fluxes.moduli()
        volume = np.abs(np.linalg.det(inside.jacobian)) * cell.weights
        square = cell.fill * volume.sum(axis=1)
        Q = 0.5 * np.einsum("tiJkJ->tik", A)[:, None]
        work = (volume * _work(Q, inside.residual)).sum(axis=1)
        parts = {"cells": IN_CELL[self._degree] * square * work}

        N, measure = _outlines(along.jacobian, cell)
        Q = np.einsum("tiJkL,tsqJ,tsqL->tsqik", A, N, N)
        tractions = np.einsum("tsqiJ,tsqJ->tsqi", along.stress, N)
        defects, touching = self._defects(tractions, interfaces)
        height = square[:, None] / measure.sum(axis=2)
        work = ON_SIDE[self._degree] * height * (measure * _work(Q, defects)).sum(axis=2)
        boundary = ~sides.inner & ~touching
        for name, on in (("sides", sides.inner), ("boundary", boundary), ("contact", touching)):
            parts[name] = np.where(on, work, 0.0).sum(axis=1)

        layer = np.einsum("tsqik,tsqi,tsqk->tsq", Q, N, N).mean(axis=2) / height
        parts["gap"] = np.zeros(len(work))
        for contact in (pair for pair in interfaces if isinstance(pair, Contact)):
            squared_gap, work_of_gap = gap_defects(contact)
            t, s, facet = sides.of_surface(contact.slave)
            share = 0.5 if contact.obstacle is None else 1.0  # two layers, one behind the other
            work = share * layer[t, s] * squared_gap[facet] + work_of_gap[facet]
            np.add.at(parts["gap"], t, work)

        size2 = np.sum(volume * np.einsum("tpiJ,tpiJ->tp", inside.stress, inside.gradient))
        terms = [size2, *(part.sum() for part in parts.values())]
        sums = self._mesh.comm.allreduce(np.array(terms))
        size, *norms = np.sqrt(np.abs(sums)).tolist()
        indicator = np.sqrt(np.sum(list(parts.values()), axis=0))
        return ErrorEstimate(indicator, size, dict(zip(parts, norms, strict=True)), self._mesh)

    def _defects(self, tractions: Array, interfaces: Sequence[Interface]) -> tuple[Array, Mask]:
        """Tractions less what they ought to be, (cells, sides, q, 2), and which sides touch."""
        sides, s = self._sides, 2.0 * self._fluxes.cell.s - 1.0
        outer, touching = ~sides.inner, np.zeros(sides.inner.shape, bool)
        defects = 0.5 * sides.sum_of_both(tractions)
        t, k = np.nonzero(outer)
        defects[t, k] = tractions[t, k] - self._fluxes.loads(t, k, sides.facets[t, k])
        shape, _ = lagrange(s, self._degree)
        for pair in interfaces:
            forces = pair.operators.force(pair.z)
            for surface, force in zip((pair.slave, pair.master), forces, strict=True):
                if surface.num_nodes:
                    t, k, facet = sides.of_surface(surface)
                    nodal = nodal_tractions(surface, -force)[surface.facets[facet]]
                    backward = surface.nodes[surface.facets[facet, 0]] != sides.first(t, k)
                    nodal = np.where(backward[:, None, None], nodal[:, ::-1], nodal)
                    defects[t, k] -= np.einsum("qk,nkc->nqc", shape, nodal)
                    touching[t, k] = True
        held = sides.held & outer[..., None]
        return np.where(held[:, :, None, :], 0.0, defects), touching


class Sides:
    """The sides of the cells of this rank: which are one, their nodes, what is held.

    Attributes:
        facets: Local facets, shape (cells, sides).
        nodes: Local nodes of the displacement from end to end, (cells, sides, degree + 1).
        inner: Whether there is a cell on the other side, of any rank, shape (cells, sides).
        held: Whether a component is prescribed at all nodes, shape (cells, sides, 2).
    """

    def __init__(self, bulk: Bulk, vertices: Indices) -> None:
        """Find them (collective); ``vertices`` of each side of the reference cell, (sides, 2)."""
        V, self._comm = bulk.V, bulk.comm
        topology, layout, index_map = V.mesh.topology, V.dofmap.dof_layout, V.dofmap.index_map
        topology.create_connectivity(2, 1)
        num_cells, num_sides = topology.index_map(2).size_local, len(vertices)
        facets = topology.connectivity(2, 1).array[: num_cells * num_sides]
        self.facets: Indices = facets.reshape(num_cells, num_sides).astype(np.int64)
        closures = [layout.entity_closure_dofs(1, k) for k in range(num_sides)]
        along = [[a, *inside, b] for a, b, *inside in closures]
        self.nodes: Indices = compat.dofmap(V)[:num_cells][:, along].astype(np.int64)
        self.held = bulk.prescribed[bulk.space.dofs[self.nodes]].all(axis=2)
        names = index_map.local_to_global(self.nodes[..., [0, -1]].ravel().astype(np.int32))
        self._ends = np.asarray(names, np.int64).reshape(num_cells, num_sides, 2)
        self._most = index_map.size_global
        self._keys = self._key(self._ends)
        ones = np.ones((num_cells, num_sides, 1, 1))
        self.inner: Mask = self.sum_of_both(ones)[..., 0, 0] > 1.5

    def _key(self, ends: Indices) -> Indices:
        """One number for the two ends (..., 2) of a facet, whichever is first."""
        return ends.min(axis=-1) * self._most + ends.max(axis=-1)

    def first(self, t: Indices, k: Indices) -> Indices:
        """Global node where sides ``k`` (n,) of cells ``t`` (n,) begin, shape (n,)."""
        return self._ends[t, k, 0]

    def of_surface(self, surface: Surface) -> tuple[Indices, Indices, Indices]:
        """Cells, sides and facets of the surface that are one, each (n,) (local)."""
        keys = self._key(surface.nodes[surface.facets[:, [0, -1]]])
        order = np.argsort(keys)
        t, k = np.nonzero(~self.inner & np.isin(self._keys, keys))
        return t, k, order[np.searchsorted(keys[order], self._keys[t, k])]

    def sum_of_both(self, values: Array) -> Array:
        """Sum of values (cells, sides, q, c) of the cells of a facet; one where it is outside.

        Collective. The points q of each side lie symmetrically from its first to its last node.
        """
        backward = (self._ends[..., 0] > self._ends[..., 1])[..., None, None]
        one_way = np.where(backward, values[:, :, ::-1], values)
        keys, where, count = np.unique(self._keys, return_inverse=True, return_counts=True)
        where = where.reshape(self._keys.shape)
        total = np.zeros((keys.size, *values.shape[2:]))
        np.add.at(total, where, one_way)
        alone = np.flatnonzero(count == 1)
        pieces = self._comm.allgather((keys[alone], total[alone]))
        for _, (theirs, sums) in (p for p in enumerate(pieces) if p[0] != self._comm.rank):
            _, mine, their = np.intersect1d(keys[alone], theirs, True, return_indices=True)
            total[alone[mine]] += sums[their]
        return np.where(backward, total[where][:, :, ::-1], total[where])


def _work(Q: Array, t: Array) -> Array:
    """T . Q^-1 t for Q (..., 2, 2) and t (..., 2); the sizes of the eigenvalues count."""
    values, vectors = np.linalg.eigh(0.5 * (Q + np.swapaxes(Q, -1, -2)))
    along = np.einsum("...ik,...i->...k", vectors, t)
    return (along**2 / np.maximum(np.abs(values), np.finfo(float).tiny)).sum(axis=-1)


def _outlines(jacobian: Array, cell: ReferenceCell) -> tuple[Array, Array]:
    """Outer normals (cells, sides, q, 2) and weights (cells, sides, q) [length] of all sides."""
    length = np.linalg.norm(np.einsum("tsqcX,sX->tsqc", jacobian, cell.edges), axis=3)
    N = np.einsum("sX,tsqXc->tsqc", cell.normals, np.linalg.inv(jacobian))
    return N / np.linalg.norm(N, axis=3, keepdims=True), length * cell.side_weights


# Contact surfaces: replicated, as everything there


def lagrange(s: Array, degree: int) -> tuple[Array, Array]:
    """Shape functions along a facet at ``s`` in -1 ... 1 and their slopes: (..., degree + 1)."""
    if degree == 1:
        return np.stack([1 - s, 1 + s], -1) / 2, np.stack([-0.5 + 0 * s, 0.5 + 0 * s], -1)
    shape = np.stack([s * (s - 1) / 2, 1 - s**2, s * (s + 1) / 2], -1)
    return shape, np.stack([s - 0.5, -2 * s, s + 0.5], -1)


def nodal_tractions(surface: Surface, forces: Array) -> Array:
    """Nodal values of the traction whose forces on the nodes are ``forces``, both (n, 2).

    Per reference length [stress]: the projection to the functions of the displacement.
    """
    s, w = np.polynomial.legendre.leggauss(POINTS)
    shape, slope = lagrange(s, surface.degree)
    measure = w * np.linalg.norm(np.einsum("qk,mkc->mqc", slope, surface.X[surface.facets]), axis=2)
    blocks = np.einsum("mq,qj,qk->mjk", measure, shape, shape)
    rows, columns = (np.broadcast_to(surface.facets[a], blocks.shape) for a in _ROW_COLUMN)
    size = surface.num_nodes
    mass = coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (size, size))
    return np.asarray(splu(mass.tocsc()).solve(forces))


_ROW_COLUMN = (np.s_[:, :, None], np.s_[:, None, :])


def gap_defects(contact: Contact) -> tuple[Array, Array]:
    """What the gap does on each slave facet, two arrays (facets,) (collective).

    The integral of g^2 where the gap is wrong [length^3]: where it is a penetration, or where all
    nodes are active. And that of z_n g elsewhere [stress length^2].
    """
    o, segments = contact.operators, contact.intersections()
    s, w = np.polynomial.legendre.leggauss(POINTS)
    middle, half = segments.ends.mean(axis=1), np.diff(segments.ends)[:, 0] / 2
    shape, slope = lagrange(middle[:, None] + half[:, None] * s, contact.slave.degree)
    nodes = segments.slave
    measure = half[:, None] * w
    measure = measure * np.linalg.norm(np.einsum("nqk,nkc->nqc", slope, o.x[nodes]), axis=2)
    gap = o.sample_gaps(o.x + contact.offset[:, None] * o.n, segments, s)
    closed = contact.active[nodes[:, [0, -1]]].all(axis=1)[:, None]
    pressure = np.maximum(np.einsum("nqk,nk->nq", shape, contact.pressure[nodes]), 0.0)
    wrong = np.where(closed, gap, np.minimum(gap, 0.0))
    work = np.where(closed, 0.0, pressure * np.maximum(gap, 0.0))
    facet = np.repeat(segments.facets, np.diff(segments.offsets))
    sums = np.zeros((2, len(contact.slave.facets)))
    for row, density in zip(sums, (wrong**2, work), strict=True):
        np.add.at(row, facet, (measure * density).sum(axis=1))
    contact.slave.comm.Allreduce(MPI.IN_PLACE, sums)
    return sums[0], sums[1]
