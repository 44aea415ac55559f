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
facet are active; elsewhere it counts by the work z_n g. Likewise the slip s of a step: by Q along
the facet where all its nodes stick, elsewhere by the work b |s| - z_tau s that a law with the bound
b would have it take up and the multiplier does not. The jump of tied surfaces counts by all of Q.
Straight facets of a curved surface leave gaps and overlaps that are none of the exact surface:
there the estimate is high. What is left of the constraints of mixed functions, as of
incompressibility, counts by the energy of the least change of grad u that takes it away.

These are the terms of Hild and Nicaise (Numer. Math. 101, 2005) and of Krause, Veeser and Walloth
(Numer. Math. 130, 2015), who prove them for linear elasticity on a rigid obstacle.

Why not average the stress (Zienkiewicz and Zhu): that smears it over interfaces of materials, does
not see loads and contact, and gains less with degree 2. What a residual lacks are sharp constants;
b and c are those with which each term alone is exact for a layer of cells under a stress that
varies across it by one degree more than the cells can follow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from numpy.polynomial.legendre import legvander
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from fenics_mortar.bulk.fluxes import Fluxes, ReferenceCell
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.facing import GAUSS, Points, Rule, face, points_behind, points_of
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.interface.segments import Segments, gauss_rule
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_number
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import call_together, together

# b and c by degree
IN_CELL = {1: 1 / 12, 2: 1 / 60}
ON_SIDE = {1: 1 / 6, 2: 1 / 10}
# A facet of which less than this is covered, of its length 2, counts as bare
LEAST_COVER = 0.02
TINY = float(np.finfo(float).tiny)
Mask = npt.NDArray[np.bool_]
# Dyads of the slave facets [length^3], and what counts by itself [stress length^2]
Defects = tuple[Array, Array]


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimate of the error of the displacement in the norm of energy.

    Attributes:
        cells: Indicator of each cell of this rank, shape (owned cells,) [stress^1/2 length].
        size: Norm of the solution itself, the root of the integral of P : grad u [likewise].
        parts: Norms of the terms: "cells", "constraint" (of mixed functions), "sides" between
            cells, "boundary", "contact" (tractions), "gap" (of tied surfaces: their jump) and
            "slip"; equal on all ranks, as are ``size`` and what follows of both.
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

        Raises:
            ValueError: If ``part`` is no number above 0 and up to 1.
        """
        right = "a number above 0 and up to 1"
        with together(self.mesh.comm, "mark"):
            check_number("part", part, right, lambda number: 0.0 < number <= 1.0)
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
        self._held = bulk.prescribed.astype(float)

    def evaluate(self, interfaces: Sequence[Interface]) -> ErrorEstimate:
        """Estimate the error of the present state, at which all is evaluated (collective)."""
        cell, sides = self._fluxes.cell, self._sides
        inside, along = self._fluxes.in_cells()
        A, C = self._fluxes.moduli()
        volume = np.abs(np.linalg.det(inside.jacobian)) * cell.weights
        square = cell.fill * volume.sum(axis=1)
        Q = 0.5 * np.einsum("tiJkJ->tik", A)[:, None]
        work = (volume * _work(Q, inside.residual)).sum(axis=1)
        parts = {"cells": IN_CELL[self._degree] * square * work}
        work = (volume * _work_of_constraints(A, C, inside.constraint)).sum(axis=1)
        parts["constraint"] = work

        N, measure = _outlines(along.jacobian, cell)
        Q = np.einsum("tsqikL,tsqL->tsqik", np.einsum("tiJkL,tsqJ->tsqikL", A, N), N)
        tractions = np.einsum("tsqiJ,tsqJ->tsqi", along.stress, N)
        defects, touching = self._defects(tractions, interfaces)
        height = square[:, None] / measure.sum(axis=2)
        work = ON_SIDE[self._degree] * height * (measure * _work(Q, defects)).sum(axis=2)
        boundary = ~sides.inner & ~touching
        for name, on in (("sides", sides.inner), ("boundary", boundary), ("contact", touching)):
            parts[name] = np.where(on, work, 0.0).sum(axis=1)

        layer = Q.mean(axis=2) / height[..., None, None]
        parts |= {name: np.zeros(len(work)) for name in ("gap", "slip")}
        for pair in interfaces:
            t, s, facet = sides.of_surface(pair.slave)
            share = 0.5 if pair.master.num_nodes else 1.0  # two layers, one behind the other
            for name, (dyads, lost) in interface_defects(pair).items():
                work = share * np.einsum("tik,tik->t", layer[t, s], dyads[facet]) + lost[facet]
                np.add.at(parts[name], t, work)

        size2 = np.sum(volume * np.einsum("tpiJ,tpiJ->tp", inside.stress, inside.gradient))
        terms = [size2, *(part.sum() for part in parts.values())]
        sums = self._mesh.comm.allreduce(np.array(terms))
        size, *norms = np.sqrt(np.abs(sums)).tolist()
        indicator = np.sqrt(np.sum(list(parts.values()), axis=0))
        return ErrorEstimate(indicator, size, dict(zip(parts, norms, strict=True)), self._mesh)

    def _defects(self, tractions: Array, interfaces: Sequence[Interface]) -> tuple[Array, Mask]:
        """Tractions less what they ought to be, (cells, sides, q, 2), and which sides touch."""
        sides = self._sides
        outer, touching = ~sides.inner, np.zeros(sides.inner.shape, bool)
        defects = 0.5 * sides.sum_of_both(tractions)
        t, k = np.nonzero(outer)
        defects[t, k] = tractions[t, k] - self._fluxes.loads(t, k, sides.facets[t, k])
        rule = gauss_rule(self._fluxes.cell.s.size)
        for pair in interfaces:
            for surface, given in interface_tractions(pair, self._held, rule):
                t, k, facet = sides.of_surface(surface)
                backward = surface.nodes[surface.facets[facet, 0]] != sides.first(t, k)
                values = np.where(backward[:, None, None], given[facet, ::-1], given[facet])
                defects[t, k] -= values
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
    """T . Q^-1 t for Q (..., 2, 2) and t (..., 2); the sizes of the eigenvalues m +- r count."""
    a, b, d = Q[..., 0, 0], 0.5 * (Q[..., 0, 1] + Q[..., 1, 0]), Q[..., 1, 1]
    m, half = 0.5 * (a + d), 0.5 * (a - d)
    r, square = np.hypot(half, b), (t**2).sum(axis=-1)
    split = half * (t[..., 0] ** 2 - t[..., 1] ** 2) + 2.0 * b * t[..., 0] * t[..., 1]
    split = split / np.maximum(r, TINY)
    sizes = (np.maximum(np.abs(eigenvalue), TINY) for eigenvalue in (m + r, m - r))
    parts = (
        0.5 * (square + sign * split) / size for sign, size in zip((1, -1), sizes, strict=True)
    )
    return np.asarray(sum(parts))


def _work_of_constraints(A: Array, C: Array, c: Array) -> Array:
    """Twice the energy of the least grad u that takes the constraints back to zero, (cells, p).

    Args:
        A: Moduli with the other unknowns kept, shape (cells, 2, 2, 2, 2).
        C: Derivative of the constraints by grad u, shape (cells, constraints, 2, 2).
        c: Values of the constraints, shape (cells, p, constraints).
    """
    flat = C.reshape(*C.shape[:2], 4)
    H = np.einsum("tak,tpk->tpa", np.linalg.pinv(flat), c)
    return np.abs(np.einsum("tpa,tab,tpb->tp", H, A.reshape(-1, 4, 4), H))


def _outlines(jacobian: Array, cell: ReferenceCell) -> tuple[Array, Array]:
    """Outer normals (cells, sides, q, 2) and weights (cells, sides, q) [length] of all sides."""
    length = np.linalg.norm(np.einsum("tsqcX,sX->tsqc", jacobian, cell.edges), axis=3)
    N = np.einsum("sX,tsqXc->tsqc", cell.normals, np.linalg.inv(jacobian))
    return N / np.linalg.norm(N, axis=3, keepdims=True), length * cell.side_weights


# Contact surfaces: replicated, as everything there


def interface_tractions(
    pair: Interface, held: Array, rule: Rule
) -> Iterator[tuple[Surface, Array]]:
    """Give both surfaces with the tractions on their facets (collective).

    Args:
        pair: The interface.
        held: 1 where a dof of the displacement is prescribed, a local array.
        rule: Of Gauss, of q points on a facet.

    Yields:
        A surface, and tractions per reference length, shape (facets, q, 2) [stress].
    """
    surfaces, forces = (pair.slave, pair.master), pair.operators.force(pair.z)
    for surface, force, here in zip(surfaces, forces, _covers(pair)):
        keeps = surface.gather(held).all(axis=1)
        yield surface, facet_tractions(surface, -force, keeps, here, rule)


def facet_tractions(surface: Surface, forces: Array, held: Mask, here: Points, rule: Rule) -> Array:
    """Traction whose forces on the nodes are ``forces`` at points of all facets (collective).

    It is one of the functions of the displacement where the surface is covered, the projection to
    them, and zero elsewhere: a pressure may end in a jump. On a facet that is covered in part it
    has the same moments up to the number of points.

    Args:
        surface: The surface.
        forces: Shape (nodes, 2) [stress length].
        held: Nodes at which forces are of no consequence, shape (nodes,): at the end of a surface
            the traction goes on there from the two nodes next to it.
        here: Points that stand for the cover, of this rank's share.
        rule: Of Gauss, of q points on a facet.

    Returns:
        Per reference length, shape (facets, q, 2) [stress].
    """
    polynomials = legvander(here.s, len(rule[0]) - 1) @ np.linalg.inv(
        legvander(rule[0], len(rule[0]) - 1)
    )
    at_points = np.einsum("np,npq,npk->nqk", here.weights, polynomials / rule[1], here.shape)
    mass = np.einsum("np,npj,npk->njk", here.measure(surface.X), here.shape, here.shape)
    cover = here.weights.sum(axis=1)
    cover, at_points, mass = (_sum_over_facets(surface, here, a) for a in (cover, at_points, mass))
    hardly = cover < LEAST_COVER
    at_points[hardly] = mass[hardly] = 0.0
    nodal = _solve_on_covered(surface, mass, forces, held)
    return np.asarray(np.einsum("fqk,fkc->fqc", at_points, nodal[surface.facets]))


def _sum_over_facets(surface: Surface, here: Points, values: Array) -> Array:
    """Sums (facets, ...) of what belongs to parts of facets, shape (n, ...) (collective)."""
    sums = np.zeros((len(surface.facets), *values.shape[1:]))
    np.add.at(sums, here.facet, values)
    surface.comm.Allreduce(MPI.IN_PLACE, sums)
    return sums


def _solve_on_covered(surface: Surface, blocks: Array, forces: Array, held: Mask) -> Array:
    """Nodal tractions (nodes, 2) of ``forces`` by the mass matrices (facets, K, K) of facets."""
    rows, columns = (np.broadcast_to(surface.facets[a], blocks.shape) for a in _ROW_COLUMN)
    size = surface.num_nodes
    mass = coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (size, size)).tolil()
    rhs = forces.copy()
    alone = np.flatnonzero(mass.diagonal() == 0.0)
    mass[alone, alone], rhs[alone] = 1.0, 0.0
    for end, first, second in _ends(surface, held):
        part = np.linalg.norm(surface.X[[end, first]] - surface.X[[first, second]], axis=1)
        ratio = part[0] / part[1]
        mass[end], rhs[end] = 0.0, 0.0
        mass[end, [end, first, second]] = blocks.max() * np.array([1.0, -1.0 - ratio, ratio])
    return np.asarray(splu(mass.tocsc()).solve(rhs))


def _covers(pair: Interface) -> list[Points]:
    """Points that stand for the parts of slave and master that face each other (local)."""
    o, segments = pair.as_faced, pair.intersections()
    behind = [points_behind(o, segments)] if pair.master.num_nodes else []
    return [points_of(segments), *behind]


def _ends(surface: Surface, held: Mask) -> list[list[int]]:
    """Held nodes at ends of a surface, and the two next to each, if there are two."""
    triples = [
        surface.along(np.flatnonzero(held & (before < 0)), range(0, 3 * way, way))
        for before, way in ((surface.previous, 1), (surface.following, -1))
    ]
    both = np.concatenate(triples)
    return both[(both >= 0).all(axis=1)].tolist()


_ROW_COLUMN = (np.s_[:, :, None], np.s_[:, None, :])


def interface_defects(pair: Interface) -> dict[str, Defects]:
    """What is wrong between the nodes of an interface, by its kind (collective)."""
    if isinstance(pair, Contact):
        return {"gap": gap_defects(pair), "slip": slip_defects(pair)}
    o, facing = pair.operators, face(pair.as_faced, pair.intersections())
    jump = facing.apart(o.x - pair.slave.X, o.m - pair.master.X)
    return {"gap": _on_facets(pair, facing, jump, 0.0 * facing.s)}


def gap_defects(contact: Contact) -> Defects:
    """The gap where it is a penetration, or where all nodes are active; else z_n g (collective).

    With adhesion a(g) it is (z_n + a) g, of which an open contact has none.
    """
    o, segments = contact.operators, contact.intersections()
    here, gap = points_of(segments), _gaps(contact, segments)
    closed = contact.active[here.slave[:, [0, -1]]].all(axis=1)[:, None]
    wrong, opening = np.where(closed, gap, np.minimum(gap, 0.0)), np.maximum(gap, 0.0)
    pull, _ = _ask(contact, "adhesion", opening)
    pressure = np.maximum(here.of(contact.pressure) + pull, 0.0)
    work = np.where(closed, 0.0, pressure * opening)
    return _on_facets(contact, here, wrong[..., None] * here.direction(o.n), work)


def _ask(contact: Contact, what: str, values: Array) -> Any:
    """What the law of a contact answers; what it raises is raised on all ranks (collective)."""
    law = contact.pair.law
    return call_together(contact.slave.comm, repr(law), partial(getattr(law, what), values))


def _gaps(contact: Contact, segments: Segments) -> Array:
    """Gaps less the offset at the points of segments, shape (n, q) [length] (collective).

    With small sliding they are linear in the motion, as those of the nodes are.
    """
    o, first = contact.operators, contact.as_faced
    gap = first.sample_gaps(first.x + contact.offset[:, None] * o.n, segments, GAUSS[0])
    if isinstance(first, ObstacleOperators) and isinstance(o, ObstacleOperators):
        return gap + points_of(segments).of(o.phi - first.phi)
    here = face(first, segments)
    moved = here.apart(o.x - first.x, o.m - first.m)
    return gap - np.einsum("nqc,nqc->nq", here.direction(o.n), moved)


def slip_defects(contact: Contact) -> Defects:
    """The slip where all nodes stick; else what the bound would take up, and the shear does not.

    Collective. It is the slip of the last step: that of points that faced each other at its start,
    or along an obstacle, whose surface has no mesh, that of the nodes.
    """
    o, facing = contact.operators, contact.partners.facing
    here = points_of(o.segments) if facing is None else facing
    slip = here.of(contact.slip) if facing is None else facing.slip(o)
    ends, held = here.slave[:, [0, -1]], ~contact.free.all(axis=1)
    sticking = contact.sticking[ends]
    sticks = ((sticking | held[ends]).all(axis=1) & sticking.any(axis=1))[:, None]
    node, bound = contact.nodal, _ask(contact, "bound", contact.pressure)
    shear, bound = (here.of(np.where(contact.active, a, 0.0)) for a in (node.z_tau, bound))
    lost = np.maximum(bound * np.abs(slip) - shear * slip, 0.0)
    work = np.where(sticks | (bound <= 0.0), 0.0, lost)
    wrong = np.where(sticks, slip, 0.0)
    return _on_facets(contact, here, wrong[..., None] * here.direction(o.tau), work)


def _on_facets(pair: Interface, here: Points, wrong: Array, work: Array) -> Defects:
    """Integrals over slave facets, (facets, 2, 2) and (facets,), of densities (collective).

    Args:
        pair: The interface.
        here: Points of this rank's share.
        wrong: Vectors whose dyads count by the stiffness of a layer, shape (n, q, 2) [length].
        work: What counts by itself, shape (n, q) [stress length].
    """
    measure = here.measure(pair.operators.x)
    dyads = np.einsum("nq,nqi,nqk->nik", measure, wrong, wrong).reshape(-1, 4)
    sums = np.zeros((len(pair.slave.facets), 5))
    np.add.at(sums, here.facet, np.column_stack([dyads, (measure * work).sum(axis=1)]))
    pair.slave.comm.Allreduce(MPI.IN_PLACE, sums)
    return sums[:, :4].reshape(-1, 2, 2), sums[:, 4]
