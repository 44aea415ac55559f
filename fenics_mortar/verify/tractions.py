# SPDX-License-Identifier: MIT
"""Contact tractions on the facets of both surfaces of a pair, from nodal forces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.facing import Points, Rule, points_behind, points_of
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils.arrays import Array, Flags
from fenics_mortar.utils.ranks import sum_over_ranks
from fenics_mortar.verify.limits import LIMITS


def interface_tractions(
    pair: Interface, prescribed: Array, rule: Rule
) -> Iterator[tuple[Surface, Array]]:
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
    surface: Surface, forces: Array, clamped: Flags, here: Points, rule: Rule
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


def _sum_over_facets(surface: Surface, here: Points, values: Array) -> Array:
    """Sum values (n, ...) of segments over their facets, shape (facets, ...) (collective)."""
    sums = np.zeros((len(surface.facets), *values.shape[1:]))
    np.add.at(sums, here.facet, values)
    return sum_over_ranks(surface.comm, sums)


def _solve_on_covered(surface: Surface, blocks: Array, forces: Array, clamped: Flags) -> Array:
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


def _ends(surface: Surface, clamped: Flags) -> list[list[int]]:
    """Clamped nodes at ends of a surface, with the next two nodes if there are two (local)."""
    triples = [
        surface.along(np.flatnonzero(clamped & (before < 0)), range(0, 3 * way, way))
        for before, way in ((surface.previous, 1), (surface.following, -1))
    ]
    both = np.concatenate(triples)
    return both[(both >= 0).all(axis=1)].tolist()
