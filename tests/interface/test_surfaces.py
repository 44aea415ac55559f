# SPDX-License-Identifier: MIT
"""Surfaces: orientation, order, replication, gathering."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import read

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.interface.reference import facet_rule
from fenics_mortar.interface.traces import extract_surface
from fenics_mortar.mesh.space import DisplacementSpace, thickness_of
from meshes import mapped_grids, rings, two_blocks
from meshes.mapped_grids import Grid, block, build, sector

comm = MPI.COMM_WORLD
AROUND = thickness_of("axisymmetric", None)


def surface(build, name, degree=1, **options):
    data = read(build, **options)
    V = fm.vector_space(data.mesh, degree)
    return V, extract_surface(DisplacementSpace(V), data.facet_tags, data.boundary_tags(name), name)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("name, normal", [("upper/bottom", (0, -1)), ("lower/top", (0, 1))])
def test_body_lies_on_the_left_of_each_facet(name, normal, cell):
    _, side = surface(two_blocks.build, name, cell=cell)
    edges = side.X[side.facets[:, 1]] - side.X[side.facets[:, 0]]
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / side.facet_sizes[:, None]
    assert np.allclose(outward, normal, atol=1e-12)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_body_lies_on_the_left_of_thin_curved_cells(cell):
    """Rings so thin that chords of the outer circle lie inside the hole."""

    def ring(*, cell):
        x = sector(16, 2, radii=(0.98, 1.0))
        return mapped_grids.build([Grid("ring", x, closed=True)], cell=cell, order=2)

    for name, turn in (("ring/bottom", 1.0), ("ring/top", -1.0)):
        _, side = surface(ring, name, degree=2, cell=cell)
        a, b = side.X[side.facets[:, 0]], side.X[side.facets[:, -1]]
        assert (np.sign(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) == turn).all()


def test_open_curve_is_numbered_from_end_to_end():
    _, side = surface(two_blocks.build, "lower/top", n_lower=7)
    assert side.num_nodes == 8
    assert (np.diff(side.X[:, 0]) < 0).all()  # the body is on the left
    assert side.previous.tolist() == [-1, 0, 1, 2, 3, 4, 5, 6]
    assert side.following.tolist() == [1, 2, 3, 4, 5, 6, 7, -1]


def test_closed_curve_has_no_end_and_starts_at_its_leftmost_node():
    _, side = surface(rings.build, "inner/outside", n_inner=12)
    assert (side.previous >= 0).all() and (side.following >= 0).all()
    assert len(side.facets) == side.num_nodes == 12
    assert side.X[0] == pytest.approx(side.X[np.lexsort(side.X.T[::-1])[0]])


def test_surface_is_the_same_on_all_ranks_and_owned_once():
    _, side = surface(two_blocks.build, "upper/bottom")
    for array in (side.X, side.facets, side.nodes, side.owners):
        assert np.array_equal(comm.bcast(array), array)
    assert comm.allreduce(side.owned.size) == side.num_nodes
    assert (side.owners[side.owned] == comm.rank).all()


def test_numbering_does_not_depend_on_the_number_of_ranks():
    _, side = surface(two_blocks.build, "upper/bottom")
    data = read(two_blocks.build, comm=MPI.COMM_SELF)
    space = DisplacementSpace(fm.vector_space(data.mesh, 1))
    alone = extract_surface(space, data.facet_tags, data.boundary_tags("upper/bottom"), "alone")
    assert np.abs(side.X - alone.X).max() < 1e-15
    assert np.array_equal(side.facets, alone.facets)


def test_gather_brings_a_function_to_all_ranks():
    V, side = surface(two_blocks.build, "upper/bottom")
    u = fem.Function(V)
    u.interpolate(lambda X: np.stack([2 * X[0] + X[1], X[0] - X[1]]))
    exact = np.stack([2 * side.X[:, 0] + side.X[:, 1], side.X[:, 0] - side.X[:, 1]], axis=1)
    assert np.abs(side.gather(u.x.array) - exact).max() < 1e-14


def test_scatter_adds_each_value_once():
    V, side = surface(two_blocks.build, "upper/bottom")
    target = np.zeros(2 * V.dofmap.index_map.size_local)
    side.scatter_add(np.ones((side.num_nodes, 2)), target)
    assert comm.allreduce(target.sum()) == 2 * side.num_nodes


def test_nodal_lengths_sum_to_the_length():
    _, side = surface(two_blocks.build, "upper/bottom", width_upper=1.5)
    assert side.nodal_lengths.sum() == pytest.approx(1.5, rel=1e-14)
    assert side.nodal_lengths[0] == pytest.approx(side.nodal_lengths[1] / 2, rel=1e-12)


def test_areas_of_nodes_by_hand():
    """Nodes on a radius r, dr apart: 2 pi r dr, and pi (r +- dr / 2) dr of half a facet."""
    data = read(two_blocks.build, width_upper=1.5)
    around = DisplacementSpace(fm.vector_space(data.mesh, 1), thickness=AROUND)
    side = extract_surface(around, data.facet_tags, data.boundary_tags("upper/bottom"), "bottom")
    r, (size, *_) = side.X[:, 0], side.facet_sizes
    exact = 2.0 * np.pi * r * size
    for end in (0, -1):
        exact[end] = np.pi * (r[end] + np.sign(r.mean() - r[end]) * size / 2.0) * size
    assert side.nodal_areas == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("size, degree", [(2, 1), (3, 3)])
def test_points_at_the_nodes_integrate_by_the_trapezoidal_or_simpsons_rule(size, degree):
    points, weights = facet_rule("nodes", size, 7)
    assert points.tolist() == [-1.0, 0.0, 1.0][:: 4 - size]
    for power in range(degree + 1):
        assert weights @ points**power == pytest.approx((1 + (-1) ** power) / (power + 1))


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_quadratic_facets_have_their_middle_between_their_ends(cell):
    _, side = surface(two_blocks.build, "lower/top", degree=2, n_lower=7, cell=cell)
    assert side.num_nodes == 15 and len(side.facets) == 7
    assert (np.diff(side.X[:, 0]) < 0).all()
    assert side.facets.tolist() == [[k, k + 1, k + 2] for k in range(0, 14, 2)]
    assert np.array_equal(np.flatnonzero(side.inner), np.arange(1, 15, 2))
    a, middle, b = np.moveaxis(side.X[side.facets], 1, 0)
    assert np.allclose(middle, (a + b) / 2, atol=1e-15)
    thirds = side.facet_sizes[:, None] * np.array([1, 4, 1]) / 6
    exact = np.bincount(side.facets.ravel(), thirds.ravel())
    assert np.allclose(side.nodal_lengths, exact, rtol=1e-14)


def test_closed_quadratic_curve_starts_at_a_vertex():
    _, side = surface(rings.build, "inner/outside", degree=2, n_inner=11)
    assert (side.previous >= 0).all() and (side.following >= 0).all()
    assert len(side.facets) == 11 and side.num_nodes == 22
    assert np.array_equal(side.facets[:-1, 2], side.facets[1:, 0]) and side.facets[-1, 2] == 0
    assert np.abs(side.along(np.array([0]), range(-2, 3)) - [[20, 21, 0, 1, 2]]).max() == 0


@pytest.mark.parametrize("degree", [1, 2])
def test_curves_are_welded_where_an_end_is_a_start(degree):
    """Two bodies side by side, whose tops are one surface: their corners become one node."""
    grids = [
        Grid(name, block(columns, 2, width=1.0, height=1.0, corner=(x, 0.0)), {"top": "top"})
        for name, columns, x in (("left", 3, 0.0), ("right", 4, 1.0))
    ]
    V, side = surface(build, "top", degree, grids=grids)
    corners = side.nodes[np.abs(side.X[:, 0] - 1.0) < 1e-12]
    for welds in (corners, corners[::-1]):
        whole = side.welded(welds[None])
        assert whole.num_nodes == side.num_nodes - 1 == 7 * degree + 1
        assert welds[1] in whole.nodes and welds[0] not in whole.nodes
        (node,) = np.flatnonzero(whole.previous < 0)
        x = [whole.X[node, 0]]
        while whole.following[node] >= 0:
            assert whole.previous[whole.following[node]] == node
            node = whole.following[node]
            x.append(whole.X[node, 0])
        assert len(x) == whole.num_nodes and (np.diff(x) < 0).all()
        assert whole.facet_sizes.sum() == pytest.approx(2.0)
        assert np.array_equal(np.sort(whole.facets.ravel())[[0, -1]], [0, whole.num_nodes - 1])
        u = fem.Function(V)
        u.interpolate(lambda X: X[:2])
        assert np.abs(whole.gather(u.x.array) - whole.X).max() < 1e-14
        assert comm.allreduce(whole.owned.size) == whole.num_nodes
    inner = side.nodes[[1, 2]]
    assert side.welded(inner[None]).num_nodes == side.num_nodes
