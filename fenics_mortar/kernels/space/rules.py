# SPDX-License-Identifier: MIT
"""Quadrature rules of a triangle, with weights whose sum is one.

Symmetric rules of 3, 6, 7 and 12 points are exact for polynomials of degree 2, 4, 5 and 6 (Strang &
Fix 1973; Dunavant 1985). Those of n^2 = 16, 25 and 36 points are products of Gauss rules on a
square with one side collapsed to a corner, exact up to degree 2 n - 1.
"""

import numpy as np

# Points for linear and for curved slave facets. For two affine quadrilaterals 6 would be exact; on
# others 7 have a smaller error at the same cost of clipping.
LINEAR, QUADRATIC = 7, 12
# Points for quadrilaterals that are no parallelograms: errors of a uniform pressure are 2e-11, 2e-9
# and 3e-8 where nodes are moved by 10, 20 and 30 %, instead of 3e-8, 5e-7 and 4e-6 with 7.
FINE, FINE_QUADRATIC = 16, 25
# Orbits of each rule: (weight of a point, barycentric coordinates: all their permutations).
_ROOT = np.sqrt(15.0)
_ORBITS = {
    3: [(1 / 3, (2 / 3, 1 / 6, 1 / 6))],
    6: [
        (0.223381589678011, (0.108103018168070, 0.445948490915965, 0.445948490915965)),
        (0.109951743655322, (0.816847572980459, 0.091576213509771, 0.091576213509771)),
    ],
    7: [
        (9 / 40, (1 / 3, 1 / 3, 1 / 3)),
        ((155 - _ROOT) / 1200, ((9 + 2 * _ROOT) / 21, (6 - _ROOT) / 21, (6 - _ROOT) / 21)),
        ((155 + _ROOT) / 1200, ((9 - 2 * _ROOT) / 21, (6 + _ROOT) / 21, (6 + _ROOT) / 21)),
    ],
    12: [
        (0.116786275726379, (0.501426509658179, 0.249286745170910, 0.249286745170910)),
        (0.050844906370207, (0.873821971016996, 0.063089014491502, 0.063089014491502)),
        (0.082851075618374, (0.053145049844817, 0.310352451033784, 0.636502499121399)),
    ],
}
COLLAPSED = (16, 25, 36)
# Numbers of points for which there is a rule.
ALLOWED = (*_ORBITS, *COLLAPSED)


def triangle_rule(points):
    """Barycentric coordinates (p, 3) and weights (p,) of the rule with so many ``points``.

    Raises:
        KeyError: There is no rule with so many points.
    """
    if points in COLLAPSED:
        return _collapsed(round(np.sqrt(points)))
    bary, weights = [], []
    for weight, (a, b, c) in _ORBITS[points]:
        orbit = [(a, b, c), (b, c, a), (c, a, b), (a, c, b), (c, b, a), (b, a, c)]
        distinct = list(dict.fromkeys(orbit))
        bary += distinct
        weights += [weight] * len(distinct)
    table, sums = np.array(bary), np.array(weights)
    return table / table.sum(axis=1, keepdims=True), sums / sums.sum()


def _collapsed(n):
    """Barycentric coordinates (n^2, 3) and weights (n^2,) of a product of Gauss rules."""
    (a, of_a), (b, of_b) = np.polynomial.legendre.leggauss(n), _gauss_jacobi(n)
    u, v = (part.ravel() for part in np.meshgrid((1.0 + a) / 2, (1.0 + b) / 2, indexing="ij"))
    weights = np.outer(of_a, of_b).ravel()
    return np.stack([v, (1.0 - v) * u, (1.0 - v) * (1.0 - u)], axis=1), weights / weights.sum()


def _gauss_jacobi(n):
    """Points and weights, with any sum, of Gauss's rule on [-1, 1] for the weight 1 - x.

    Eigenvalues of the matrix of the recurrence of Jacobi's polynomials (Golub & Welsch 1969).
    """
    k, m = np.arange(n), np.arange(1, n)
    beside = np.sqrt(m * (m + 1.0)) / (2.0 * m + 1.0)
    matrix = np.diag(-1.0 / ((2.0 * k + 1.0) * (2.0 * k + 3.0)))
    points, vectors = np.linalg.eigh(matrix + np.diag(beside, 1) + np.diag(beside, -1))
    return points, vectors[0] ** 2
