# SPDX-License-Identifier: MIT
"""Points inside closed surfaces, edges that pierce them, times at which they meet."""

import numpy as np
import pytest
from surfaces_in_space import rotation

from fenics_mortar.kernels.passage import (
    find_events_in_space,
    roots_of_cubic,
)
from fenics_mortar.kernels.space.inside import RAY, depths_inside, find_piercings, winding_number
from fenics_mortar.kernels.space.triangles import nearest_triangle, square_on_triangle
from fenics_mortar.kernels.tree import build_tree

# Corners of a cube by x, y, z, and its sides seen from outside.
SIDES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def cube(count=1):
    """The unit cube, each side divided into ``count`` by ``count`` squares of two triangles."""
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    points, triangles = [], []
    grid = np.linspace(0.0, 1.0, count + 1)
    for a, b, c, d in SIDES:
        u, v = np.meshgrid(grid, grid, indexing="ij")
        at = [w.ravel()[:, None] for w in ((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v)]
        first = sum(len(p) for p in points)
        points.append(sum(w * corners[k] for w, k in zip(at, (a, b, c, d), strict=True)))
        for i in range(count):
            for j in range(count):
                p = first + np.array([0, count + 1, count + 2, 1]) + i * (count + 1) + j
                triangles += [p[[0, 1, 2]], p[[0, 2, 3]]]
    x, inverse = np.unique(np.round(np.concatenate(points), 9), axis=0, return_inverse=True)
    return x, inverse.ravel()[np.array(triangles)]


def tree(x, triangles):
    boxes = build_tree(x, triangles)
    return boxes, np.empty(len(boxes) // 2, np.int64)


def test_winding_numbers_of_a_turned_cube():
    x, triangles = cube(3)
    Q = rotation(np.random.default_rng(1))
    points = np.random.default_rng(0).uniform(-0.5, 1.5, (400, 3))
    inside = ((points > 0) & (points < 1)).all(axis=1)
    for turn in (np.eye(3), Q):
        turned = np.ascontiguousarray(x @ turn.T)
        boxes, hits = tree(turned, triangles)
        for p, is_inside in zip(points @ turn.T, inside, strict=True):
            expected = int(is_inside)
            assert winding_number(turned, triangles, boxes, hits, p) == expected
        inverted = np.ascontiguousarray(triangles[:, ::-1])
        assert winding_number(turned, inverted, boxes, hits, turn @ np.full(3, 0.4)) == -1


def solid_angles(x, triangles, p):
    """Winding number by the solid angles of all triangles (van Oosterom & Strackee 1983)."""
    a, b, c = np.moveaxis(x[triangles] - p, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    ab, bc, ca = ((v * w).sum(axis=1) for v, w in ((a, b), (b, c), (c, a)))
    volumes = (a * np.cross(b, c)).sum(axis=1)
    return np.arctan2(volumes, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2.0 * np.pi)


def test_winding_numbers_of_a_crumpled_surface():
    """One that crosses itself many times, by rays and by solid angles."""
    x, triangles = cube(3)
    rng = np.random.default_rng(5)
    x = x + rng.uniform(-0.4, 0.4, x.shape)
    boxes, hits = tree(x, triangles)
    for p in rng.uniform(-0.5, 1.5, (400, 3)):
        expected = pytest.approx(solid_angles(x, triangles, p), abs=1e-9)
        assert winding_number(x, triangles, boxes, hits, p) == expected


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_ray_through_edges_and_corners(count):
    """Points from which the ray passes through nodes and middles of edges, up to rounding."""
    x, triangles = cube(count)
    boxes, hits = tree(x, triangles)
    ray, middle = RAY / np.linalg.norm(RAY), np.full(3, 0.5)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    ends = x[edges]
    for place in (0.0, 0.3, 0.5, 1.0):
        for end in (1.0 - place) * ends[:, 0] + place * ends[:, 1]:
            for p in (end - 0.31 * ray, end + 0.27 * ray):
                if np.abs(np.abs(p - middle).max() - 0.5) > 1e-6:
                    expected = int(np.abs(p - middle).max() < 0.5)
                    assert winding_number(x, triangles, boxes, hits, p) == expected


def test_twice_covered_points_and_depths():
    x, triangles = cube(2)
    both = np.concatenate([x, x + np.array([0.5, 0.1, 0.1])])
    two = np.concatenate([triangles, triangles + len(x)])
    boxes, hits = tree(both, two)
    assert winding_number(both, two, boxes, hits, np.array([0.71, 0.52, 0.53])) == 2
    boxes, _ = tree(x, triangles)
    points = np.array([[0.5, 0.5, 0.9], [0.5, 0.5, 1.1], [0.03, 0.4, 0.5]])
    depths, nearest = depths_inside(x, triangles, boxes, points, 1e-3)
    assert depths == pytest.approx([0.1, 0.0, 0.03]) and nearest[1] == -1
    assert x[triangles[nearest[0]], 2] == pytest.approx([1, 1, 1])


def test_nearest_triangle_is_that_of_brute_force():
    x, triangles = cube(4)
    rng = np.random.default_rng(3)
    x = x + rng.uniform(-0.05, 0.05, x.shape)
    boxes, hits = tree(x, triangles)
    for p in rng.uniform(-0.5, 1.5, (60, 3)):
        squares = [square_on_triangle(p, *x[nodes]) for nodes in triangles]
        distance, nearest = nearest_triangle(x, triangles, boxes, hits, p, 0.01)
        assert distance**2 == pytest.approx(min(squares))
        assert squares[nearest] == pytest.approx(min(squares))
    weights = np.random.default_rng(4).dirichlet(np.ones(3), 4000)
    a, b, c = rng.uniform(size=(3, 3))
    p = rng.uniform(-1, 2, 3)
    sampled = np.linalg.norm(weights @ np.array([a, b, c]) - p, axis=1).min()
    assert np.sqrt(square_on_triangle(p, a, b, c)) == pytest.approx(sampled, abs=0.02)


def test_piercings_of_an_edge_through_a_cube():
    x, triangles = cube(2)
    x = np.concatenate([x, [[0.3, 0.21, -1.0], [0.3, 0.21, 3.0], [0.4, 0.22, 0.5]]])
    edges = np.array([[len(x) - 3, len(x) - 2], [len(x) - 1, len(x) - 2]])
    rows = find_piercings(x, edges, triangles, build_tree(x, triangles))
    first = rows[rows[:, 0] == 0]
    assert first[np.argsort(first[:, 2]), 2:] == pytest.approx(np.array([[0.25, -1], [0.5, 1]]))
    (second,) = rows[rows[:, 0] == 1]
    assert second[2:] == pytest.approx([0.2, 1.0])


def octahedron():
    """Outward triangles, and the corners, first those on the axes' negative sides."""
    triangles = [
        (0, 2, 1),
        (0, 1, 5),
        (0, 5, 4),
        (0, 4, 2),
        (3, 1, 2),
        (3, 5, 1),
        (3, 4, 5),
        (3, 2, 4),
    ]
    return np.concatenate([-np.eye(3), np.eye(3)]), np.array(triangles)


def test_an_edge_through_nodes_enters_and_leaves_once():
    """The triangles around a node share it on the line, whatever the numbers of the nodes are."""
    corners, triangles = octahedron()
    for seed in range(60):
        new, axis = np.random.default_rng(seed).permutation(8), 2.0 * np.eye(3)[seed % 3]
        x = np.empty((8, 3))
        x[new] = np.concatenate([corners, [-axis, axis]])
        numbered = np.ascontiguousarray(new[triangles])
        rows = find_piercings(x, new[None, 6:], numbered, build_tree(x, numbered))
        assert sorted(rows[:, 3]) == [-1.0, 1.0]
        assert np.allclose(np.sort(rows[:, 2]), [0.25, 0.75])


def test_roots_of_cubics():
    rng, work, roots = np.random.default_rng(2), np.empty(4), np.empty(4)
    for k in range(300):
        c = rng.uniform(-1, 1, 4) * (np.arange(4) <= 1 + k % 3)
        found = roots[: roots_of_cubic(c, work, roots)]
        exact = np.roots(c[::-1])
        exact = np.sort(exact[abs(exact.imag) < 1e-12].real)
        assert found == pytest.approx(exact[(exact > 0) & (exact < 1)], abs=1e-9)
    assert roots_of_cubic(np.array([1.0, 0, 0, 0]), work, roots) == 0
    assert roots_of_cubic(np.zeros(4), work, roots) == 2  # at both ends, without a slope


def test_times_at_which_a_node_meets_a_turning_triangle():
    x0 = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, 1.0], [3.0, 3.0, 1.0]])
    x1 = x0 + np.outer([0.2, 0.2, 0.2, -1.4, -1.4], [0, 0, 1])
    triangle, none = np.array([[0, 1, 2]]), np.empty((0, 3))
    (row,) = find_events_in_space(x0, x1, np.array([[3], [4]]), triangle, none)
    assert row[:4] == pytest.approx([0, 0, 1.0 / 1.6, 1.0])
    (row,) = find_events_in_space(x1, x0, np.array([[3], [4]]), triangle, none)
    assert row[:4] == pytest.approx([0, 0, 1.0 - 1.0 / 1.6, -1.0])
    assert not len(find_events_in_space(x0, x1, np.array([[0]]), triangle, none))


def test_times_at_which_edges_meet():
    x0 = np.array([[-1.0, 0, 1], [1, 0, 1], [0, -1, 0], [0, 3, 0]])
    x1 = x0 - [[0, 0, 4], [0, 0, 4], [0, 0, 0], [0, 0, 0]]
    edge, other, up = np.array([[0, 1]]), np.array([[2, 3]]), np.array([[0.0, 0, 1]])
    (row,) = find_events_in_space(x0, x1, edge, other, up)
    assert row == pytest.approx([0, 0, 0.25, 1.0, 0.5])
    (row,) = find_events_in_space(x0, x1, edge, other, -up)
    assert row[3] == -1.0
    assert not len(
        find_events_in_space(x0 + 5 * np.eye(3)[0] * [[1], [1], [0], [0]], x1, edge, other, up)
    )
