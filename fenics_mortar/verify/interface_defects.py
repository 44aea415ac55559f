# SPDX-License-Identifier: MIT
"""Tractions on sides of cells and violations of contact conditions, for the error estimate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.arcs import arc
from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.contact.nodal import at_points
from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.interface.facing import (
    GAUSS,
    Facing,
    Points,
    Rule,
    face,
    points_behind,
    points_of,
)
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.interface.segments import Segments
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import call_together
from fenics_mortar.utils.ranks import sum_over_ranks
from fenics_mortar.verify.finding import LIMITS


class CellSides:
    """CellSides of the owned cells: facets, nodes, neighbours and prescribed components.

    The constructor is collective.

    Args:
        bulk: The bodies.
        vertices: Vertices of each side of the reference cell, shape (sides, 2).

    Attributes:
        facets: Local facets, shape (cells, sides).
        nodes: Local nodes of the displacement in order, shape (cells, sides, degree + 1).
        inner: Whether there is a cell on the other side, on any rank, shape (cells, sides).
        prescribed: Whether a component is prescribed at all nodes, shape (cells, sides, 2).
    """

    def __init__(self, bulk: Bulk, vertices: Indices) -> None:
        V, self._comm = bulk.V, bulk.comm
        topology, layout, index_map = V.mesh.topology, V.dofmap.dof_layout, V.dofmap.index_map
        topology.create_connectivity(2, 1)
        num_cells, num_sides = topology.index_map(2).size_local, len(vertices)
        facets = topology.connectivity(2, 1).array[: num_cells * num_sides]
        self.facets: Indices = facets.reshape(num_cells, num_sides).astype(np.int64)
        closures = [layout.entity_closure_dofs(1, k) for k in range(num_sides)]
        along = [[a, *inside, b] for a, b, *inside in closures]
        self.nodes: Indices = compat.dofmap(V)[:num_cells][:, along].astype(np.int64)
        self.prescribed = bulk.prescribed[bulk.space.dofs[self.nodes]].all(axis=2)
        names = index_map.local_to_global(self.nodes[..., [0, -1]].ravel().astype(np.int32))
        self._ends = np.asarray(names, np.int64).reshape(num_cells, num_sides, 2)
        self._num_nodes = index_map.size_global
        self._keys = self._key(self._ends)
        ones = np.ones((num_cells, num_sides, 1, 1))
        self.inner: Flags = self.sum_of_both(ones)[..., 0, 0] > 1.5

    def _key(self, ends: Indices) -> Indices:
        """One number for the two ends (..., 2) of a facet, in any order."""
        return ends.min(axis=-1) * self._num_nodes + ends.max(axis=-1)

    def first(self, t: Indices, k: Indices) -> Indices:
        """First global nodes of sides ``k`` (n,) of cells ``t`` (n,), shape (n,) (local)."""
        return self._ends[t, k, 0]

    def of_surface(self, surface: Curve) -> tuple[Indices, Indices, Indices]:
        """Cells, their sides, and the facets of the surface on these sides, each (n,) (local)."""
        keys = self._key(surface.nodes[surface.facets[:, [0, -1]]])
        order = np.argsort(keys)
        t, k = np.nonzero(~self.inner & np.isin(self._keys, keys))
        return t, k, order[np.searchsorted(keys[order], self._keys[t, k])]

    def sum_of_both(self, values: Array) -> Array:
        """Sum of values (cells, sides, q, c) of the one or two cells of a facet (collective).

        The q points of each side lie symmetrically between its first and its last node. The
        result has the shape of ``values`` [unit of values].
        """
        backward = (self._ends[..., 0] > self._ends[..., 1])[..., None, None]
        one_way = np.where(backward, values[:, :, ::-1], values)
        keys, where, count = np.unique(self._keys, return_inverse=True, return_counts=True)
        where = where.reshape(self._keys.shape)
        total = np.zeros((keys.size, *values.shape[2:]))
        np.add.at(total, where, one_way)
        alone = np.flatnonzero(count == 1)
        branches = self._comm.allgather((keys[alone], total[alone]))
        for _, (theirs, sums) in (p for p in enumerate(branches) if p[0] != self._comm.rank):
            _, mine, their = np.intersect1d(keys[alone], theirs, True, return_indices=True)
            total[alone[mine]] += sums[their]
        return np.where(backward, total[where][:, :, ::-1], total[where])


def interface_tractions(
    pair: Interface, prescribed: Array, rule: Rule
) -> Iterator[tuple[Curve, Array]]:
    """Yield both surfaces with the tractions on their facets (collective).

    Args:
        pair: The interface.
        prescribed: 1 for prescribed dofs of the displacement, else 0, shape (local dofs,).
        rule: Gauss rule with q points on a facet.

    Yields:
        A surface, and its tractions per reference length, shape (facets, q, 2) [stress].
    """
    surfaces, forces = (pair.slave, pair.master), pair.operators.force(pair.z_u)
    for surface, force, here in zip(surfaces, forces, _covers(pair)):
        keeps = surface.gather(prescribed).all(axis=1)
        yield surface, facet_tractions(surface, -force, keeps, here, rule)


def facet_tractions(
    surface: Curve, forces: Array, clamped: Flags, here: Points, rule: Rule
) -> Array:
    """Traction with given nodal forces, at points of all facets (collective).

    On the covered surface the traction is a projection on the span of the displacement's shape
    functions, elsewhere it is zero: a pressure may end in a jump. On partly covered facets moments
    are reproduced up to the order of the quadrature points.

    Args:
        surface: The surface.
        forces: Nodal forces, shape (nodes, 2) [stress length].
        clamped: Clamped nodes, shape (nodes,), bool. Their forces are not used; at a clamped end of
            a surface the traction is extrapolated from the next two nodes.
        here: Points on the covered parts, this rank's share.
        rule: Gauss rule with q points on a facet.

    Returns:
        Traction per reference length, shape (facets, q, 2) [stress].
    """
    polynomials = legvander(here.s, len(rule[0]) - 1) @ np.linalg.inv(
        legvander(rule[0], len(rule[0]) - 1)
    )
    at_points = np.einsum("np,npq,npk->nqk", here.weights, polynomials / rule[1], here.shape)
    mass = np.einsum("np,npj,npk->njk", here.measure(surface.X), here.shape, here.shape)
    cover = here.weights.sum(axis=1)
    cover, at_points, mass = (_sum_over_facets(surface, here, a) for a in (cover, at_points, mass))
    bare = cover < LIMITS.bare
    at_points[bare] = mass[bare] = 0.0
    nodal = _solve_on_covered(surface, mass, forces, clamped)
    return np.asarray(np.einsum("fqk,fkc->fqc", at_points, nodal[surface.facets]))


def _sum_over_facets(surface: Curve, here: Points, values: Array) -> Array:
    """Sum values (n, ...) of segments over their facets, shape (facets, ...) (collective)."""
    sums = np.zeros((len(surface.facets), *values.shape[1:]))
    np.add.at(sums, here.facet, values)
    return sum_over_ranks(surface.comm, sums)


def _solve_on_covered(surface: Curve, blocks: Array, forces: Array, clamped: Flags) -> Array:
    """Nodal tractions (nodes, 2) of ``forces``, with mass matrices (facets, K, K) (local)."""
    rows = np.broadcast_to(surface.facets[:, :, None], blocks.shape)
    columns = np.broadcast_to(surface.facets[:, None, :], blocks.shape)
    size = surface.num_nodes
    mass = coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (size, size)).tolil()
    rhs = forces.copy()
    alone = np.flatnonzero(mass.diagonal() == 0.0)
    mass[alone, alone], rhs[alone] = 1.0, 0.0
    for end, first, second in _ends(surface, clamped):
        lengths = np.linalg.norm(surface.X[[end, first]] - surface.X[[first, second]], axis=1)
        ratio = lengths[0] / lengths[1]
        mass[end], rhs[end] = 0.0, 0.0
        mass[end, [end, first, second]] = blocks.max() * np.array([1.0, -1.0 - ratio, ratio])
    return np.asarray(splu(mass.tocsc()).solve(rhs))


def _covers(pair: Interface) -> list[Points]:
    """Points on the parts of slave and master that face each other (local)."""
    o, segments = pair.partner_operators, pair.intersections()
    behind = [points_behind(o, segments)] if pair.master.num_nodes else []
    return [points_of(segments), *behind]


def _ends(surface: Curve, clamped: Flags) -> list[list[int]]:
    """Clamped nodes at ends of a surface, with the next two nodes if there are two (local)."""
    triples = [
        surface.along(np.flatnonzero(clamped & (before < 0)), range(0, 3 * way, way))
        for before, way in ((surface.previous, 1), (surface.following, -1))
    ]
    both = np.concatenate(triples)
    return both[(both >= 0).all(axis=1)].tolist()


# Integrals over slave facets: dyads [length^3], and work [stress length^2].
Defects = tuple[Array, Array]


def interface_defects(pair: Interface) -> dict[str, Defects]:
    """Violations of contact conditions between the nodes, by kind (collective).

    Returns:
        For "gap" and "slip": integrals over the slave facets of dyads, whose work is given by the
        stiffness of a layer, shape (facets, 2, 2) [length^3], and of additional work, shape
        (facets,) [stress length^2].
    """
    if isinstance(pair, Contact):
        return {"gap": gap_defects(pair), "slip": slip_defects(pair)}
    o, facing = pair.operators, face(pair.partner_operators, pair.intersections())
    jump = facing.difference(o.x - pair.slave.X, o.m - pair.master.X)
    return {"gap": _on_facets(pair, facing, jump, 0.0 * facing.s)}


def gap_defects(contact: Contact) -> Defects:
    """Penetration, or the gap where all nodes are active; otherwise the work z_n g (collective).

    With adhesion a(g) the work is (z_n + a) g, zero for open contact.
    """
    o, segments = contact.operators, contact.intersections()
    here, gap = points_of(segments), _gaps(contact, segments)
    closed = contact.active[here.slave[:, [0, -1]]].all(axis=1)[:, None]
    wrong, opening = np.where(closed, gap, np.minimum(gap, 0.0)), np.maximum(gap, 0.0)
    pull = _adhesion(contact, here, opening)
    pressure = np.maximum(here.of(contact.pressure) + pull, 0.0)
    work = np.where(closed, 0.0, pressure * opening)
    return _on_facets(contact, here, wrong[..., None] * here.direction(o.n), work)


def _adhesion(contact: Contact, here: Points, opening: Array) -> Array:
    """Adhesion at points with gaps ``opening`` (n, q) [stress] (collective)."""
    law = contact.pair.law
    if not law.has_adhesion:
        return np.zeros_like(opening)
    node = replace(at_points(contact.nodal, here.of), gap=opening)
    comm = contact.slave.comm
    return np.asarray(call_together(comm, repr(law), partial(law.adhesion_at, node)).residual)


def _gaps(contact: Contact, segments: Segments) -> Array:
    """Gaps minus the offset at points of segments, shape (n, q) [length] (collective).

    With small sliding gaps are linear in the motion, like nodal gaps.
    """
    o, first = contact.operators, contact.partner_operators
    gap = first.sample_gaps(first.x + contact.now.offset[:, None] * o.n, segments, GAUSS[0])
    if isinstance(first, ObstacleOperators) and isinstance(o, ObstacleOperators):
        return gap + points_of(segments).of(o.phi - first.phi)
    here = face(first, segments)
    moved = here.difference(o.x - first.x, o.m - first.m)
    return gap - np.einsum("nqc,nqc->nq", here.direction(o.n), moved)


def slip_defects(contact: Contact) -> Defects:
    """Slip where all nodes stick; otherwise the missing work of friction (collective).

    The missing work is that of the friction limit minus that of the shear. The slip is that of the
    last step between points that faced each other at its start, or nodal slip on obstacles, whose
    surface has no mesh.
    """
    o, facing = contact.operators, contact.partners.facing
    here = points_of(o.segments) if facing is None else facing
    slip = here.of(contact.slip) if facing is None else _slip_between(contact, facing)
    ends, prescribed = here.slave[:, [0, -1]], ~contact.free.all(axis=1)
    sticking = contact.sticking[ends]
    sticks = ((sticking | prescribed[ends]).all(axis=1) & sticking.any(axis=1))[:, None]
    node, bound = contact.nodal, contact.now.friction_limit(contact.pressure)
    raise_stored(contact.slave.comm, [contact])
    shear, bound = (here.of(np.where(contact.active, a, 0.0)) for a in (node.z_tau, bound))
    lost = np.maximum(bound * np.abs(slip) - shear * slip, 0.0)
    work = np.where(sticks | (bound <= 0.0), 0.0, lost)
    wrong = np.where(sticks, slip, 0.0)
    return _on_facets(contact, here, wrong[..., None] * here.direction(o.tau), work)


def _slip_between(contact: Contact, facing: Facing) -> Array:
    """Slip of the last step at points that faced each other, shape (n, q) [length] (local)."""
    o = contact.operators
    theta = facing.of(contact.partners.at(o).rotations.theta)
    now = facing.difference(o.x, o.m), facing.direction(o.n)
    return arc(now, (facing.start, facing.normals), theta, -theta).slip


def _on_facets(pair: Interface, here: Points, wrong: Array, work: Array) -> Defects:
    """Integrals of densities over slave facets, (facets, 2, 2) and (facets,) (collective).

    Args:
        pair: The interface.
        here: Points of this rank's share.
        wrong: Vectors of the dyads, shape (n, q, 2) [length].
        work: Density of additional work, shape (n, q) [stress length].
    """
    measure = here.measure(pair.operators.x)
    dyads = np.einsum("nq,nqi,nqk->nik", measure, wrong, wrong).reshape(-1, 4)
    sums, thickness = np.zeros((len(pair.slave.facets), 5)), pair.slave.thickness
    if thickness is not None:  # the stiffness of the layer includes the thickness
        work = work * here.of(thickness.at(pair.operators.x))
    np.add.at(sums, here.facet, np.column_stack([dyads, (measure * work).sum(axis=1)]))
    sums = sum_over_ranks(pair.slave.comm, sums)
    return sums[:, :4].reshape(-1, 2, 2), sums[:, 4]
