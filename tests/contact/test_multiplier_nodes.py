# SPDX-License-Identifier: MIT
"""Slave nodes that carry a multiplier on hardly covered surfaces."""

from types import SimpleNamespace

import numpy as np
import pytest

from fenics_mortar.contact.rows import MultiplierNodes
from fenics_mortar.interface.surfaces import MIN_SHARE

COUNT = 4


def line():
    """Nodes in a row, as a surface of straight facets."""

    def along(nodes, steps):
        places = nodes[:, None] + np.array(list(steps))
        return np.where((places >= 0) & (places < COUNT), places, -1)

    return SimpleNamespace(num_nodes=COUNT, degree=1, along=along, dim=2)


@pytest.mark.parametrize("cover, carry", [
    ([0.0, 0.99, 1.01, 0.0], [1, 1, 1, 1]),  # equal covers: rounding must not decide
    ([0.0, 0.5, 1.5, 0.0], [1, 1, 1, 1]),
    ([0.0, 0.99, 3.0, 20.0], [1, 0, 1, 1]),
    ([0.99, 20.0, 20.0, 0.99], [0, 1, 1, 0]),
    ([1.01, 20.0, 20.0, 1.01], [1, 1, 1, 1]),
])  # fmt: skip
def test_function_is_handed_over_to_a_covered_neighbour(cover, carry):
    """Covers are in units of the limit below which a function is handed over."""
    nodes = MultiplierNodes(
        line(), np.tile([0.0, 1.0], (COUNT, 1)), np.ones((COUNT, 2)), at_vertices=False
    )
    found, changed = nodes.update(np.ones(COUNT, bool), MIN_SHARE * np.array(cover))
    used = np.array(cover) > 0.0
    assert (found[used] == np.array(carry, bool)[used]).all()
    assert changed == (~found).sum()
