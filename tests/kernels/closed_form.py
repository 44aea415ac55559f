# SPDX-License-Identifier: MIT
"""Mortar integrals of two-node facets in closed form: the oracle of the package's kernels.

Derived independently for two nodes only: projections by formulas for lines, D and the dual
functions from mean and variance of the cover. Plain Python; derivatives by complex steps.

=======  ============================================================================
symbol   meaning
=======  ============================================================================
y        x1, x2 (slave nodes), n1, n2 (their normals), m1, m2 (master nodes), (12,)
S        covered part of a facet; |S| = int_S dxi, xm its mean, v its variance
=======  ============================================================================

Every basis reads Phi_1 = a - F (xi - xm), Phi_2 = 1 - Phi_1:

=================  ====================  ====================
basis              a                     F
=================  ====================  ====================
dual               (1 - xm) / 2          (1 - xm^2) / (2 v)
standard           (1 - xm) / 2          1 / 2
only node 1 left   1                     0
only node 2 left   0                     0
=================  ====================  ====================

The gap of node 1 is weighted by a (1 + (p - xm) (xi - xm) / v): p is the node or, by cover, the end
of S next to it.
"""

import numpy as np

from fenics_mortar.kernels.facets import BY_COVER, BY_STANDARD, DUAL, STANDARD

BOTH, ONLY_FIRST, ONLY_SECOND = 0, 1, 2


def master_to_slave(y, k):
    """``xi`` of the partner of master node ``k``: a quadratic."""
    c, a = (y[:2] + y[2:4]) / 2, (y[2:4] - y[:2]) / 2
    n, b = (y[4:6] + y[6:8]) / 2, (y[6:8] - y[4:6]) / 2
    r = y[8 + 2 * k : 10 + 2 * k] - c
    A = b[1] * a[0] - b[0] * a[1]
    B = b[0] * r[1] - b[1] * r[0] + n[1] * a[0] - n[0] * a[1]
    C = n[0] * r[1] - n[1] * r[0]
    root = np.sqrt(B * B - 4 * A * C)
    return -2 * C / (B + (root if B.real >= 0 else -root))


def slave_to_master(y, xi):
    """``eta`` and ``alpha`` of the partner x + alpha n of the slave point ``xi``."""
    N = np.array([(1 - xi) / 2, (1 + xi) / 2])
    x, n = N @ y[:4].reshape(2, 2), N @ y[4:8].reshape(2, 2)
    a, r = (y[10:] - y[8:10]) / 2, (y[8:10] + y[10:]) / 2 - x
    across = n[0] * a[1] - n[1] * a[0]
    return -(n[0] * r[1] - n[1] * r[0]) / across, (r[0] * a[1] - r[1] * a[0]) / across


def slope_of(basis, left, mean, variance):
    """The table above: (a, F)."""
    if left != BOTH:
        return (1.0 if left == ONLY_FIRST else 0.0), 0.0
    a = (1 - mean) / 2
    return a, (1 / 2 if basis == STANDARD else (1 - mean * mean) / (2 * variance))


def gap_weight(kinds, alone, sign, end, mean, variance):
    """The weight of a node's gap as a + S (xi - xm): (a, S); ``sign`` -1 of node 1, 1 of node 2."""
    basis, weights = kinds
    if alone != 0:
        return (1.0 if alone > 0 else 0.0), 0.0
    a = (1 + sign * mean) / 2
    if basis == STANDARD or weights == BY_STANDARD:
        return a, sign / 2
    return a, a * ((end if weights == BY_COVER else sign) - mean) / variance


def integrate_facet(kinds, left, segments):
    """D (2, 2), M (n, 2, 2), g (2,) and cover (2,) of one facet.

    ``kinds`` = (basis, weights of the gap); ``segments``: (y, is_fixed, ends, points, weights) of
    each segment.
    """
    ends = [
        [
            found[0] if fixed[0] else master_to_slave(y, 1),
            found[1] if fixed[1] else master_to_slave(y, 0),
        ]
        for y, fixed, found, _, _ in segments
    ]
    xi = [(a + b) / 2 + (b - a) / 2 * s for (a, b), (*_, s, _) in zip(ends, segments)]
    W = [(b - a) / 2 * w for (a, b), (*_, w) in zip(ends, segments)]
    first = xi[0][0]  # accurate for a single tiny interval, too
    size = sum(w.sum() for w in W)
    mean = first + sum(w @ (place - first) for w, place in zip(W, xi)) / size
    variance = sum(w @ (place - mean) ** 2 for w, place in zip(W, xi)) / size
    edge = segments[0][0][2:4] - segments[0][0][:2]
    J = np.sqrt(edge @ edge) / 2
    a, F = slope_of(kinds[0], left, mean, variance)
    half, N = F * variance / 2, np.array([(1 - mean) / 2, (1 + mean) / 2])
    D = J * size * np.array([a * N + [half, -half], (1 - a) * N + [-half, half]])
    if kinds[0] == DUAL and left == BOTH:
        D = np.diag(np.diag(D))
    lower = min((e[0] for e in ends), key=lambda end: end.real)
    upper = max((e[1] for e in ends), key=lambda end: end.real)
    alone = 0 if left == BOTH else 1 if left == ONLY_FIRST else -1
    weights = [
        gap_weight(kinds, alone, -1, lower, mean, variance),
        gap_weight(kinds, -alone, 1, upper, mean, variance),
    ]
    M, g = [], 0.0 * N
    for (y, *_), places, w in zip(segments, xi, W):
        of_segment = 0.0 * D
        for place, weight in zip(places, w):
            eta, alpha = slave_to_master(y, place)
            n = (1 - place) / 2 * y[4:6] + (1 + place) / 2 * y[6:8]
            phi, L = a - F * (place - mean), np.array([(1 - eta) / 2, (1 + eta) / 2])
            of_segment += J * weight * np.outer([phi, 1 - phi], L)
            psi = np.array([b + S * (place - mean) for b, S in weights])
            g = g + J * weight * alpha * np.sqrt(n @ n) * psi
        M.append(of_segment)
    return D, M, g, J * size * N
