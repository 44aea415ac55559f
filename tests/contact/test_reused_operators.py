# SPDX-License-Identifier: MIT
"""Operators are integrated again only if their arguments have changed."""

import numpy as np
import pytest
from scenes import pressed_blocks

from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.verify.checks.corners import runs_of

MESH = {"n_upper": 4, "n_lower": 5, "layers_upper": 2, "layers_lower": 2}


def test_operators_belong_to_the_last_place_of_the_obstacle():
    problem = pressed_blocks(**MESH).problem
    equations = problem.equations
    contact, u = equations.contacts[0], equations.bulk.u.x.array
    equations.evaluate_operators()
    first = contact.operators
    equations.evaluate_operators()
    assert contact.operators is first
    contact.evaluate(u, LINEARIZATIONS["no_normals"])
    assert contact.operators is not first
    equations.evaluate_operators()
    u += 1e-3
    equations.evaluate_operators()
    moved = contact.operators
    assert moved is not first and np.allclose(moved.x, first.x + 1e-3)
    carry = contact.multiplier_nodes.copy()
    carry[np.flatnonzero(carry)[0]] = False
    contact.change(multiplier_nodes=carry)
    equations.evaluate_operators()
    assert contact.operators is not moved
    problem.contacts[0].offset = np.full(contact.slave.num_nodes, 1e-3)
    equations.evaluate_operators()
    gap = contact.gap
    problem.contacts[0].offset -= 1e-3
    equations.evaluate_operators()
    assert np.allclose((contact.gap - gap)[contact.covered], 1e-3)


class Pair:
    """Attributes of a contact used by ``runs_of``: active set, and order along the curves."""

    def __init__(self, active, following):
        self.active, self.slave = np.array(active, bool), self
        self.previous = np.full(len(active), -1)
        self.previous[[k for k in following if k >= 0]] = np.flatnonzero(np.array(following) >= 0)


@pytest.mark.parametrize(
    "active, following, runs",
    [
        ([1, 1, 0, 1, 1], [1, 2, 3, 4, -1], [{0, 1}, {3, 4}]),
        ([1, 1, 0, 1, 1], [1, 2, 3, 4, 0], [{0, 1, 3, 4}]),
        ([1, 1, 1, 1], [1, 2, 3, 0], [{0, 1, 2, 3}]),
        ([1, 1, 1, 1], [2, -1, 3, 1], [{0, 1, 2, 3}]),
    ],
    ids=["open", "closed", "all of a closed curve", "numbers that jump"],
)
def test_runs_are_neighbouring_active_nodes(active, following, runs):
    pair = Pair(active, following)
    found = runs_of(pair)
    sets = [set(np.flatnonzero(pair.active & (found == run))) for run in set(found[pair.active])]
    assert sorted(map(sorted, sets)) == sorted(map(sorted, runs))
