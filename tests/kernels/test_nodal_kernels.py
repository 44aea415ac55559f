# SPDX-License-Identifier: MIT
"""Kernels of forces and blocks, against numpy and against their definition."""

import numpy as np
import pytest

from fenics_mortar.interface.integrals import _force_block
from fenics_mortar.kernels import blocks

RNG = np.random.default_rng(3)
N = 5  # slave nodes


def unit_normals():
    angle = RNG.uniform(0.0, 6.0, N)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_forces_are_products_with_D_and_M():
    facets, slave, master = np.array([[0, 1], [1, 2]]), np.array([[0, 1]]), np.array([[1, 0]])
    D, M, z = RNG.normal(size=(2, 2, 2)), RNG.normal(size=(1, 2, 2)), RNG.normal(size=(3, 2))
    on_slave, on_master = np.zeros((3, 2)), np.zeros((2, 2))
    blocks.add_contact_forces(D, z, facets, facets, 1.0, on_slave)
    blocks.add_contact_forces(M, z, slave, master, -1.0, on_master)
    expected = np.zeros((3, 2))
    np.add.at(expected, facets, np.einsum("ejk,ejc->ekc", D, z[facets]))
    assert np.abs(on_slave - expected).max() < 1e-14
    assert np.abs(on_master[[1, 0]] + M[0].T @ z[:2]).max() < 1e-14


def test_forces_are_summed_and_measured():
    bulk, contact, prescribed = RNG.normal(size=6), RNG.normal(size=4), np.arange(6) % 2 == 1
    factors, total = np.array([1.0, 2.0, 3.0, 4.0]), np.empty(4)
    free, on_contact, reactions = blocks.add_forces(bulk, contact, factors, prescribed, total)
    assert np.abs(total - (bulk[:4] + contact)).max() == 0.0
    squares = (factors * total) ** 2
    assert free == pytest.approx(squares[::2].sum())
    assert reactions == pytest.approx(squares[1::2].sum())
    assert on_contact == pytest.approx(((factors * contact) ** 2).sum())


def test_rows_are_expanded_and_derivatives_weighed():
    nodes, values, directions = (
        np.array([[0, 2], [2, 1]]),
        RNG.normal(size=(2, 2, 3)),
        unit_normals(),
    )
    rows, expanded = np.empty((2, 4), np.int64), np.empty((2, 4, 3))
    blocks.expand_rows(directions, nodes, values, rows, expanded)
    assert rows.tolist() == [[0, 1, 4, 5], [4, 5, 2, 3]]
    expected = np.einsum("bja,bjq->bjaq", directions[nodes], values).reshape(2, 4, 3)
    assert np.abs(expanded - expected).max() < 1e-14
    dX, z = RNG.normal(size=(3, 2, 2, 6)), RNG.normal(size=(3, 2, 2))
    block = _force_block(dX, z, np.arange(12).reshape(3, 2, 2), np.zeros((3, 6), int))
    expected = np.einsum("pjkq,pjc->pkcq", dX, z).reshape(3, 4, 6)
    assert np.abs(block.values - expected).max() < 1e-14
    assert block.rows.tolist() == np.arange(12).reshape(3, 4).tolist()


def test_entries_of_condensed_forces():
    """-B^T Z - A_z Z of two nodes on one facet, of which one acts, with one master node each."""
    D, M = np.array([[[2.0, 0.0], [0.0, 3.0]]]), np.array([[[1.0, 0.5], [0.0, 2.0]]])
    facets, dofs, acts = np.array([[0, 1]]), np.array([[2, 3], [0, 1]]), np.array([True, False])
    Z, A_z = np.array([[0.5, 0.25], [0.0, 0.0]]), np.arange(8.0).reshape(2, 2, 2)
    slave_rows, master_rows = np.arange(4).reshape(2, 2), 4 + np.arange(4).reshape(2, 2)
    i, j = np.empty((2, 24), np.int32)
    v = np.empty(24)
    count = blocks.gather_forces(
        D, facets, slave_rows, M, facets, facets, master_rows, Z, A_z, np.arange(2), acts, dofs,
        i, j, v,
    )  # fmt: skip
    found, expected = np.zeros((8, 4)), np.zeros((8, 4))
    np.add.at(found, (i[:count], j[:count]), v[:count])
    for c in range(2):
        expected[c, 2 + c] = -D[0, 0, 0] * Z[0, c]
        expected[[4 + c, 6 + c], 2 + c] = M[0, 0] * Z[0, c]
    expected[:2, 2:] -= A_z[0] * Z[0]
    assert np.abs(found - expected).max() < 1e-15
    assert count == 2 + 4 + 4


def test_blocks_and_products_are_packed():
    rows, columns = np.array([[7, -1, 8]]), np.array([[2, -1, 3]])
    values = np.array([[[1.0, 2.0, 0.0], [3.0, 4.0, 5.0], [0.0, 6.0, 0.0]]])
    numbers, starts, places = np.empty(9, int), np.zeros(10, int), np.empty(9, int)
    counts, packed = np.zeros(2, np.int64), np.empty(9)
    target = counts, numbers, starts, places, packed
    blocks.pack_rows(rows, columns, values, *target)
    assert counts.tolist() == [1, 1]  # the last row has a value in column -1 only
    # rows 5: 2 (row 0) + 3 (row 1) and 6: -1 (row 1), of rows 0: 7 and 8, 1: 9 and zero
    entries = np.array([2, 1, 1]), np.array([1, 0, 1]), np.array([-1.0, 2.0, 3.0])
    csr = np.array([0, 2, 4]), np.array([2, 6, 6, 0]), np.array([7.0, 8.0, 9.0, 0.0])
    blocks.pack_product(*entries, *csr, np.array([4, 5, 6]), 7, *target)
    assert counts.tolist() == [3, 4] and numbers[:3].tolist() == [7, 5, 6]
    assert starts[:4].tolist() == [0, 1, 3, 4] and places[:4].tolist() == [2, 2, 6, 6]
    assert packed[:4].tolist() == [1.0, 14.0, 16.0 + 27.0, -9.0]


def test_only_acting_multipliers_need_room_in_the_pattern():
    known = np.array([0 * 4 + 1, 0 * 4 + 2, 0 * 4 + 3])  # facet of node 0 with master nodes 1, 2
    slave, master = np.array([[0, 1], [1, 2]]), np.array([[1, 2], [2, 0]])
    acting = np.array([True, False, False])
    assert blocks.are_known(known, slave, master, acting, 3)
    assert not blocks.are_known(known, slave, master, ~acting, 3)
    assert not blocks.are_known(known[:0], slave, master, acting, 3)
