# SPDX-License-Identifier: MIT
"""Nodes that two surfaces share."""

import tracemalloc

import numpy as np
import pytest

from fenics_mortar.interface.traces import equal_pairs


@pytest.mark.parametrize("counts", [(0, 0), (0, 5), (5, 0), (40, 50), (300, 200)])
@pytest.mark.parametrize("largest", [20, 2000])
def test_equal_numbers_are_those_of_all_pairs(counts, largest):
    rng = np.random.default_rng(1)
    a, b = (rng.integers(0, largest, count) for count in counts)
    for one, other in ((a, b), (a, a)):
        found, expected = equal_pairs(one, other), np.nonzero(one[:, None] == other)
        assert all(map(np.array_equal, found, expected))


def test_equal_numbers_of_large_surfaces_need_little_memory():
    """An array of all pairs would have 100 MB."""
    nodes = np.arange(10_000)
    tracemalloc.start()
    j, l = equal_pairs(nodes, nodes[::-1].copy())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.array_equal(j, nodes) and np.array_equal(l, nodes[::-1])
    assert peak < 2e6
