# SPDX-License-Identifier: MIT
"""Length of a line inside a body, by its outline."""

import numpy as np
import pytest

from fenics_mortar.kernels.sight import (
    is_nearer_exit,
    length_inside,
    overlaps_point,
    tabulate_lengths,
)

LEAST = 1e-10


def outline(*rings):
    """Closed polygons (body, points), the body on their left."""
    x = np.concatenate([np.asarray(points, float) for _, points in rings])
    branches, bodies, first = [], [], 0
    for body, points in rings:
        k = np.arange(len(points))
        branches.append(first + np.stack([k, (k + 1) % len(points)], axis=1))
        bodies.append(np.full(len(points), body))
        first += len(points)
    return x, np.concatenate(branches), np.concatenate(bodies)


def box(low, high, width=1.0):
    """A rectangle between two heights."""
    return [(0, low), (width, low), (width, high), (0, high)]


def length(where, shape, x=0.4, down=False, own=0):
    """Length inside from a height, up or down."""
    direction = np.array([0.0, -1.0 if down else 1.0])
    return length_inside(np.array([x, where]), direction, shape, own, LEAST)


def test_length_of_a_line_ends_at_the_body():
    shape = outline((0, box(0.0, 0.3)), (1, box(0.1, 2.0)))
    assert length(0.0, shape) == pytest.approx(0.3)
    assert length(0.3, shape, down=True) == pytest.approx(0.3)
    assert length(0.1, shape, own=1) == pytest.approx(1.9)
    assert length(0.0, shape, own=2) == np.inf


def test_hollow_of_a_ring_is_not_inside():
    shape = outline((0, box(0.0, 1.0)), (0, [(0.2, 0.2), (0.2, 0.7), (0.8, 0.7), (0.8, 0.2)]))
    assert length(0.0, shape) == pytest.approx(0.2)
    assert length(0.7, shape) == pytest.approx(0.3)


def test_length_continues_through_an_overlapping_body():
    """Two arms of one body, one in the other."""
    shape = outline((0, box(0.0, 0.5)), (0, box(0.4, 0.9)))
    assert length(0.0, shape) == pytest.approx(0.9)
    assert length(0.4, shape) == pytest.approx(0.5)
    assert length(0.5, shape, down=True) == pytest.approx(0.5)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2, 2.5])
def test_lengths_behind_facets_are_independent_of_the_size_of_normals(angle):
    """The mean of nodal normals that differ is shorter than one."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    shape = outline((0, np.array(box(0.0, 0.3)) @ turn.T), (1, np.array(box(0.5, 0.6)) @ turn.T))
    x = np.array([(1.0, 0.0), (0.0, 0.0), (1.0, 0.5), (0.0, 0.5)]) @ turn.T
    n = np.array([(0.8, -0.6), (-0.8, -0.6), (0.6, -0.8), (-0.6, -0.8)]) @ turn.T
    lengths = np.empty(2)
    facets = np.array([[0, 1], [2, 3]])
    tabulate_lengths(x, n, facets, np.array([0, 1]), shape, 1e-10, lengths)
    assert lengths == pytest.approx([0.3, 0.1])


@pytest.mark.parametrize("x", [0.0, 1.0, 0.5])
def test_line_through_a_corner_is_counted_once(x):
    """A line through vertices is taken as wholly inside the body or wholly outside."""
    shape = outline((0, [(0, 0), (0.5, 0), (1, 0), (1, 1), (0.5, 1), (0, 1)]))
    assert length(0.0, shape, x=x) in (1.0, np.inf)
    assert length(0.0, shape, x=0.5) == pytest.approx(1.0)


def test_point_beside_its_facet_counts_as_on_it():
    """A point of a curved facet lies beside the chord, outside or inside the polygon."""
    shape = outline((0, box(0.0, 0.3)))
    for off in (-1e-3, 1e-3, -1e-16, 1e-16):
        assert length(off, shape) == pytest.approx(0.3 - off)


def test_many_crossings_are_sorted():
    shape = outline(*((0, box(k, k + 0.5)) for k in range(100)))
    assert length(0.0, shape) == pytest.approx(0.5)
    assert length(99.5, shape, down=True) == pytest.approx(0.5)


@pytest.mark.parametrize("thick, other", [(0.1, 0.1), (0.1, 1.0), (1.0, 0.1)])
@pytest.mark.parametrize("overlap", [-0.05, 0.01, 0.09])
def test_nearer_exit_counts(thick, other, overlap):
    """A slave overlaps a master: the master's bottom is behind by the overlap, its top by more.

    Without an overlap neither counts: the bottom has the master in front.
    """
    shape = outline((0, box(0.0, thick)), (1, box(overlap - other, overlap)))
    N = np.empty((3, 2))
    down = np.array([1.0, thick, 0.0, thick, 0.0, 1.0, 0.0, 1.0])
    low = np.array([0.0, overlap - other, 1.0, overlap - other])
    through = thick + other - overlap
    assert not is_nearer_exit(np.concatenate([down, low]), N, 0.1, through, shape, (0, 1), LEAST)
    if overlap > 0.0:
        up = np.array([0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, -1.0])
        top = np.array([1.0, overlap, 0.0, overlap])
        assert is_nearer_exit(np.concatenate([up, top]), N, 0.1, overlap, shape, (0, 1), LEAST)


@pytest.mark.parametrize("angle", np.linspace(0.05, 6.2, 24))
def test_back_of_a_strip_is_no_exit_of_its_own_facet(angle):
    """Slave and master on one part of one body, at any position: rounding does not decide."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    tapered = np.array([(0.0, 0.0), (1.0, -0.02), (1.0, 0.13), (0.0, 0.1)])
    x = 3.7 + tapered @ turn.T
    shape = outline((0, x))
    y = np.concatenate([x[[2, 3]].ravel(), np.tile(turn @ [0.0, 1.0], 2), x[:2].ravel()])
    N = np.empty((3, 2))
    for xi in np.linspace(-0.9, 0.9, 7):
        depth = 0.5 * ((0.13 + 0.02) * (1.0 - xi) + 0.1 * (1.0 + xi))
        assert not is_nearer_exit(y, N, xi, depth, shape, (0, 0), LEAST)


@pytest.mark.parametrize("overlap", [-1e-3, 1e-3, 0.05])
def test_back_of_a_winding_is_no_partner_where_windings_overlap(overlap):
    """Two windings of a strip of thickness 0.1, one into the other, as in iterates."""
    shape = outline((0, box(0.0, 0.1)), (0, box(0.1 - overlap, 0.2 - overlap)))
    N, up, down = np.empty((3, 2)), np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0, -1.0])

    def counts(height, normals, depth):
        ends = (0.0, 1.0) if normals is down else (1.0, 0.0)
        behind = height + depth if normals is down else height - depth
        y = [ends[0], height, ends[1], height, *normals, ends[1], behind, ends[0], behind]
        return overlaps_point(np.array(y), N, 0.1, depth, shape, 0, LEAST)

    assert not counts(0.2 - overlap, up, 0.1)  # its own back
    if overlap > 0.0:
        assert counts(0.1, up, overlap)
        assert counts(0.1 - overlap, down, overlap)
