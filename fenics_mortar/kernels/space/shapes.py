# SPDX-License-Identifier: MIT
"""Facets in space: nodes, linear pieces and shape functions; quadrature rules of a triangle.

Facets are triangles and quadrilaterals, linear or quadratic, with Lagrange shape functions.
Reference coordinates of the corners: (0, 0) (1, 0) (0, 1); (-1, -1) (1, -1) (1, 1) (-1, 1).
"""

import numpy as np

from fenics_mortar.kernels import kernel

# Coordinates of the nodes of the reference facets.
TRIANGLE = np.array([[0.0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
QUADRILATERAL = np.array(
    [[-1.0, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0], [0, 0]]
)
# Nodes of the linear pieces of each kind of facet.
ONE_TRIANGLE = np.array([[0, 1, 2]])
ONE_QUADRILATERAL = np.array([[0, 1, 2, 3]])
TRIANGLES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
QUADRILATERALS = np.array([[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]])
# Quadrilaterals: number of the function of each coordinate, of those that are 1 at -1, 1 and 0.
FIRST = (0, 1, 1, 0, 2, 1, 2, 0, 2)
SECOND = (0, 0, 1, 1, 0, 2, 1, 2, 2)


@kernel
def reference_nodes(count):
    """Coordinates of the nodes of a facet with ``count`` nodes, shape (K, 2)."""
    return TRIANGLE[:count] if count % 3 == 0 and count < 9 else QUADRILATERAL[:count]


@kernel
def pieces_of(count):
    """Local nodes of the linear pieces of a facet with ``count`` nodes, shape (1 or 4, 3 or 4)."""
    if count == 3:
        return ONE_TRIANGLE.copy()
    if count == 4:
        return ONE_QUADRILATERAL.copy()
    return TRIANGLES.copy() if count == 6 else QUADRILATERALS.copy()


@kernel
def piece_centres(count):
    """Coordinates of the centres of the pieces of a facet, shape (1 or 4, 2)."""
    pieces, nodes = pieces_of(count), reference_nodes(count)
    centres = np.zeros((pieces.shape[0], 2))
    for p in range(pieces.shape[0]):
        for node in pieces[p]:
            for d in range(2):
                centres[p, d] += nodes[node, d] / pieces.shape[1]
    return centres


@kernel
def tabulate_shapes(a, b, N):
    """Fill ``N`` (3, K) or (6, K): shape functions at (a, b), and their derivatives.

    These are in turn the derivatives by a, b, and, of six rows, by aa, ab, bb.
    """
    if N.shape[1] % 3 == 0 and N.shape[1] < 9:
        _tabulate_triangle(a, b, N)
    else:
        _tabulate_quadrilateral(a, b, N)


@kernel
def _tabulate_triangle(a, b, N):
    """Fill ``N`` for three or six nodes, by the barycentric coordinates."""
    bary, by_a, by_b = (1.0 - a - b, 1.0 * a, 1.0 * b), (-1.0, 1.0, 0.0), (-1.0, 0.0, 1.0)
    linear, seconds = N.shape[1] == 3, N.shape[0] == 6
    for k in range(3):
        slope = 1.0 + 0.0 * a if linear else 4.0 * bary[k] - 1.0
        N[0, k] = bary[k] if linear else bary[k] * (2.0 * bary[k] - 1.0)
        N[1, k], N[2, k] = slope * by_a[k], slope * by_b[k]
        if seconds:
            curvature = 0.0 if linear else 4.0
            N[3, k], N[4, k] = curvature * by_a[k] ** 2, curvature * by_a[k] * by_b[k]
            N[5, k] = curvature * by_b[k] ** 2
    for k in range(3, N.shape[1]):
        i, j = k - 3, (k - 2) % 3
        N[0, k] = 4.0 * bary[i] * bary[j]
        N[1, k] = 4.0 * (by_a[i] * bary[j] + bary[i] * by_a[j])
        N[2, k] = 4.0 * (by_b[i] * bary[j] + bary[i] * by_b[j])
        if seconds:
            N[3, k], N[5, k] = 8.0 * by_a[i] * by_a[j], 8.0 * by_b[i] * by_b[j]
            N[4, k] = 4.0 * (by_a[i] * by_b[j] + by_b[i] * by_a[j])


@kernel
def _along(a, linear):
    """Functions of one coordinate that are 1 at -1, 1 and 0, and both derivatives: 3 by 3."""
    if linear:
        zero = 0.0 * a
        return (
            (0.5 * (1.0 - a), 0.5 * (1.0 + a), zero),
            (zero - 0.5, zero + 0.5, zero),
            (zero, zero, zero),
        )
    one = 1.0 + 0.0 * a
    return (
        (0.5 * a * (a - 1.0), 0.5 * a * (a + 1.0), 1.0 - a * a),
        (a - 0.5, a + 0.5, -2.0 * a),
        (one, one, -2.0 * one),
    )


@kernel
def _tabulate_quadrilateral(a, b, N):
    """Fill ``N`` for four or nine nodes, by products of functions of one coordinate."""
    linear, seconds = N.shape[1] == 4, N.shape[0] == 6
    along_a, along_b = _along(a, linear), _along(b, linear)
    for k in range(N.shape[1]):
        i, j = FIRST[k], SECOND[k]
        N[0, k] = along_a[0][i] * along_b[0][j]
        N[1, k], N[2, k] = along_a[1][i] * along_b[0][j], along_a[0][i] * along_b[1][j]
        if seconds:
            N[3, k], N[4, k] = along_a[2][i] * along_b[0][j], along_a[1][i] * along_b[1][j]
            N[5, k] = along_a[0][i] * along_b[2][j]


# Points for linear and for curved slave facets. For two affine quadrilaterals 6 would be exact; on
# others 7 have a smaller error at the same cost of clipping.
LINEAR, QUADRATIC = 7, 12
# Points for quadrilaterals that are no parallelograms, at least.
FINE, FINE_QUADRATIC = 16, 25
# Allowed error of a uniform pressure between flat surfaces [1]. With n^2 points and a distortion d
# of the facets it is at most a factor of 10 times the power n of the ratio 0.75 d^2, as measured
# for d of 0.07 to 0.46 and n of 4 to 6, since integrands are rational functions.
UNIFORM, RATIO, FACTOR = 1e-11, 0.75, 10.0
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
COLLAPSED = (16, 25, 36, 49, 64)
# Points by the exponent n above; 7 points, which miss terms of the order d^2, behave as n = 2.
RATIONAL = {2: LINEAR, **{round(np.sqrt(points)): points for points in COLLAPSED}}
# Numbers of points for which there is a rule.
ALLOWED = (*_ORBITS, *COLLAPSED)


def points_for(degree, distortion, warp):
    """Points of the rule that passes a uniform pressure on facets of a ``distortion`` [1].

    Facets of ``degree`` 2 need a larger n by one. On facets with a ``warp``, the distortion across
    them [1], integrals over planes err by its square anyway.
    """
    allowed, ratio = max(UNIFORM, warp**2), RATIO * distortion**2
    enough = (
        points for n, points in RATIONAL.items() if FACTOR * ratio ** (n + 1 - degree) < allowed
    )
    return next(enough, COLLAPSED[-1])


def triangle_rule(points):
    """Barycentric coordinates (p, 3) and weights (p,) of the rule with p = ``points`` points.

    The sum of the weights is one. Symmetric rules of 3, 6, 7 and 12 points are exact for
    polynomials of degree 2, 4, 5 and 6 (Strang & Fix 1973; Dunavant 1985). Those of n^2 = 16, 25,
    ... 64 points are products of Gauss rules on a square with one side collapsed to a corner, exact
    up to degree 2 n - 1.

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


def triangles_of(facets):
    """Triangles (m, 3) between the nodes of facets (f, K), and the facet of each one, (m,)."""
    pieces = pieces_of(facets.shape[1])
    parts = [pieces[:, [0, i, i + 1]] for i in range(1, pieces.shape[1] - 1)]
    local = np.concatenate(parts)
    owner = np.repeat(np.arange(len(facets)), len(local))
    return facets[:, local].reshape(-1, 3), owner
