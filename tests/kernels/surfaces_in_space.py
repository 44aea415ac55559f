# SPDX-License-Identifier: MIT
"""Surfaces in space of each kind of facet, their integrals and derivatives as the package does."""

from itertools import pairwise

import numpy as np

from fenics_mortar.kernels.projection import OPPOSITE
from fenics_mortar.kernels.space.integrals import integrate_facets
from fenics_mortar.kernels.space.linearize import linearize_facets
from fenics_mortar.kernels.space.normals import facets_around, find_rings, tabulate_normals
from fenics_mortar.kernels.space.pairs import find_pairs
from fenics_mortar.kernels.space.shapes import LINEAR, QUADRATIC, triangle_rule

KINDS = (3, 4, 6, 9)


def rotation(rng):
    """A random rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def grid(kind, cells, others=None):
    """Nodes (n, 2) on the unit square and facets (f, K) of a regular mesh, counter-clockwise."""
    others = others or cells
    degree = 1 if kind in (3, 4) else 2
    a, b = degree * cells + 1, degree * others + 1
    s, t = np.meshgrid(np.linspace(0, 1, a), np.linspace(0, 1, b), indexing="ij")
    number, facets, d = np.arange(a * b).reshape(a, b), [], degree
    for i in range(0, a - 1, degree):
        for j in range(0, b - 1, degree):
            q = [number[i, j], number[i + d, j], number[i + d, j + d], number[i, j + d]]
            if d == 2:
                e = [number[i + 1, j], number[i + 2, j + 1], number[i + 1, j + 2], number[i, j + 1]]
                centre = number[i + 1, j + 1]
            if kind == 4:
                facets.append(q)
            elif kind == 9:
                facets.append([*q, *e, centre])
            elif kind == 3:
                facets += [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]
            else:
                facets.append([q[0], q[1], q[2], e[0], e[1], centre])
                facets.append([q[0], q[2], q[3], centre, e[2], e[3]])
    return np.stack([s.ravel(), t.ravel()], axis=1), np.array(facets)


def move_corners(points, facets, move):
    """Move the corners of a mesh by ``move`` (n, 2); nodes on edges stay at their middles."""
    kind = facets.shape[1]
    sides = 3 if kind in (3, 6) else 4
    corners = facets[:, :sides]
    moved = points.copy()
    moved[np.unique(corners)] += move[np.unique(corners)]
    for k in range(sides, min(kind, 2 * sides)):
        i, j = corners[:, k - sides], corners[:, (k - sides + 1) % sides]
        moved[facets[:, k]] = (moved[i] + moved[j]) / 2
    if kind == 9:
        moved[facets[:, 8]] = moved[corners].mean(axis=1)
    return moved


def reversed_facets(facets):
    """Facets that are seen from the other side."""
    order = {3: [0, 2, 1], 4: [0, 3, 2, 1], 6: [0, 2, 1, 5, 4, 3], 9: [0, 3, 2, 1, 7, 6, 5, 4, 8]}
    return facets[:, order[facets.shape[1]]]


def renumbered(facets, rng):
    """Facets that begin at other corners, at random."""
    count = 3 if facets.shape[1] in (3, 6) else 4
    first = rng.integers(0, count, (len(facets), 1))
    order = (first + np.arange(count)) % count
    on_edges = facets[:, count : 2 * count]
    parts = [np.take_along_axis(facets[:, :count], order, axis=1), facets[:, 2 * count :]]
    if on_edges.shape[1]:
        parts.insert(1, np.take_along_axis(on_edges, order, axis=1))
    return np.concatenate(parts, axis=1)


def cube_sphere(cells, split, grading=0.0, seed=0):
    """Nodes on the unit sphere and facets, quad4 or, where ``split``, tri3."""
    flat, quads = grid(4, cells)
    u = np.sign(2 * flat - 1) * np.abs(2 * flat - 1) ** (1 + grading)
    one = np.ones(len(u))
    points, facets = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            side = np.zeros((len(u), 3))
            side[:, axis], side[:, (axis + 1) % 3] = sign * one, u[:, 0]
            side[:, (axis + 2) % 3] = u[:, 1]
            own = quads if sign > 0 else quads[:, ::-1]
            facets.append(own + len(u) * len(points))
            points.append(side)
    points, facets = np.concatenate(points), np.concatenate(facets)
    _, first, inverse = np.unique(
        np.round(points, 9), axis=0, return_index=True, return_inverse=True
    )
    x, facets = points[first], np.ravel(inverse)[facets]
    x = x + 0.1 / cells * np.random.default_rng(seed).uniform(-1, 1, x.shape)
    if split:
        facets = np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]])
    return x / np.linalg.norm(x, axis=1, keepdims=True), facets


def normals(x, facets, weighting=OPPOSITE, projectors=None):
    """Normals (n, 3), their derivatives (n, 3, 3 S) and the rings (n, S)."""
    around = facets_around(facets, len(x))
    ring = find_rings(facets, len(x))
    n, dn = np.empty_like(x), np.empty((len(x), 3, 3 * ring.shape[1]), x.dtype)
    tabulate_normals(x, facets, around, ring, weighting, projectors, n, dn)
    return n, dn, ring


def rule_of(kind):
    """The default rule of slave facets."""
    return triangle_rule(LINEAR if kind in (3, 4) else QUADRATIC)


def integrate(geometry, slave, masters, offsets, rule=None):
    """De, Me, G, B, complete and folded."""
    (s, K), (p, others), kind = slave.shape, masters.shape, geometry[0].dtype
    shapes = (s, K), (s, K, K), (s, K), (p, K, others)
    values = *(np.empty(shape, kind) for shape in shapes), np.empty(s, bool), np.empty(s, bool)
    integrate_facets(geometry, slave, masters, offsets, rule or rule_of(K), values)
    return values


def places_of(masters, offsets):
    """Positions (p, K') of the nodes of each pair among those of its slave facet, and L."""
    places, most = np.empty_like(masters), 1
    for start, stop in pairwise(offsets):
        nodes, inverse = np.unique(masters[start:stop], return_inverse=True)
        places[start:stop] = np.reshape(inverse, places[start:stop].shape)
        most = max(most, len(nodes))
    return places, most


def linearize(geometry, slave, masters, offsets, coefficients, rule=None):
    """Derivatives (weight, gap, X, Y, vector), the places of master nodes, and L.

    Without values y of the master nodes as seventh coefficient these are their positions.
    """
    places, most = places_of(masters, offsets)
    (s, K), C = slave.shape, 3 * slave.shape[1] + 3 * most
    a, b = (coefficients[i].shape[2] for i in (3, 5))
    shapes = (s, K, C), (s, K, C + 3 * K), (s, a * K, C), (s, a * most, C), (s, K, b, C)
    out = tuple(np.full(shape, np.nan) for shape in shapes)
    y = coefficients[6] if len(coefficients) > 6 else geometry[2]
    coefficients = (*coefficients[:6], y[masters])
    linearize_facets(
        geometry, slave, masters, offsets, places, rule or rule_of(K), coefficients, out
    )
    return out, places, most


def find(x, slave, m, master, radius=1.0, min_cosine=0.1, numbers=None):
    """Offsets and master facets of the pairs of all slave facets, or of some."""
    numbers = np.arange(len(slave)) if numbers is None else numbers
    return find_pairs(x, m, slave, master, numbers, radius, min_cosine)
