# SPDX-License-Identifier: MIT
"""Interpolation in a body: in a rank's own cells, with little communication."""

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx import mesh as dmesh

import fenics_mortar as fm
from fenics_mortar.bulk.cells import DIVISIONS, Cells, triangles_of
from fenics_mortar.utils import compat

comm = MPI.COMM_WORLD
N = 24  # cells along the side of a square


class Counting:
    """A communicator that counts the rows sent to all ranks."""

    size, rank = comm.size, comm.rank

    def __init__(self):
        self.rows = 0

    def allgather(self, points):
        result = comm.allgather(points)
        self.rows += sum(map(len, result))
        return result

    def alltoall(self, answers):
        return comm.alltoall(answers)


def square(kind, degree, *, notch):
    """Local nodes and triangles of the unit square, perhaps without its upper right quarter."""
    cell = getattr(dmesh.CellType, kind)
    mesh = dmesh.create_unit_square(comm, N, N, cell)
    V = fm.vector_space(mesh, degree)
    X, mine = Cells(V).X, compat.dofmap(V)
    if notch:
        mine = mine[(X[mine].mean(axis=1) < 0.5).any(axis=1)]
    nodes = np.unique(mine)
    triangles = np.searchsorted(nodes, mine)[:, np.array(DIVISIONS[mine.shape[1]])]
    return X[nodes], triangles.reshape(-1, 3)


def carried(X, triangles, s, comm=comm):
    """A linear field carried along by ``s``."""
    return triangles_of(comm, X, triangles).interpolate(linear(X), X - s)


def linear(X):
    return X @ [[1.0, 2.0], [-3.0, 0.5]] + [0.1, 0.2]


@pytest.mark.parametrize("s", [(0.03, 0.05), (0.4, 0.3), (-0.11, 0.0)], ids=str)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("notch", [False, True])
@pytest.mark.parametrize("kind", ["triangle", "quadrilateral"])
def test_linear_fields_are_exact_inside_and_not_a_number_outside(kind, notch, degree, s):
    X, cells = square(kind, degree, notch=notch)
    at = X - s
    found = carried(X, cells, np.array(s))
    inside = ((at > 1e-9) & (at < 1 - 1e-9)).all(axis=1)
    outside = ((at < -1e-9) | (at > 1 + 1e-9)).any(axis=1)
    if notch:
        inside &= (at < 0.5 - 1e-9).any(axis=1)
        outside |= (at > 0.5 + 1e-9).all(axis=1)
    assert np.abs(found - linear(at))[inside].max(initial=0.0) < 1e-12
    assert np.isnan(found[outside]).all()
    assert comm.allreduce(inside.sum()) > 0 and comm.allreduce(outside.sum()) > 0


def test_ranks_exchange_only_what_lies_beyond_the_outlines_of_their_parts():
    """Two columns of nodes along each outline, not the body."""
    X, cells = square("triangle", 1, notch=False)
    counting = Counting()
    carried(X, cells, np.array([1.5 / N, 0.0]), counting)
    assert counting.rows <= 2 * comm.size * (N + 1)


def test_positions_on_nodes_of_other_ranks_are_found():
    """Rounding places some of them outside of the box around a part."""
    X, cells = square("quadrilateral", 1, notch=False)
    s = np.array([3.0 / N, 0.0])
    found = carried(X, cells, s)
    inside = (X - s)[:, 0] > -0.1 / N
    assert np.abs(found - linear(X - s))[inside].max(initial=0.0) < 1e-12


def test_rank_without_cells_of_the_body_takes_part():
    X, cells = square("triangle", 1, notch=False)
    if comm.rank:
        X, cells = X[:0], cells[:0]
    found = carried(X, cells, np.array([0.1, 0.1]))
    assert found.shape == X.shape


def test_boxes_are_small_if_neighbours_in_the_order_are_distant():
    """Boxes of eight successive triangles; in the given order each covers most of the square."""
    X, cells = square("triangle", 1, notch=False)
    shuffled = np.random.default_rng(1).permutation(cells)
    tree = triangles_of(comm, X, shuffled).boxes
    leaves = len(tree) // 2
    boxes = tree[leaves // 8 : leaves // 4]
    boxes = boxes[np.isfinite(boxes).all(axis=1)]
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    assert areas.mean() < 10 * 8 / (2 * N**2)
