# SPDX-License-Identifier: MIT
"""Segments found for the same positions are used again when multiplier nodes change."""

from dataclasses import fields

import numpy as np
import pytest
from scenes import pressed_blocks

from fenics_mortar.interface import integrals
from fenics_mortar.interface.mortar import LINEARIZATIONS

SEARCHED = LINEARIZATIONS["full"]


@pytest.mark.parametrize("drop, searches", [([3], 0), ([0, 1, 2, 3], 1)], ids=["one", "a facet"])
def test_operators_are_bitwise_those_of_a_new_search(drop, searches, monkeypatch):
    scene = pressed_blocks(n_upper=6, n_lower=8)
    scene.loads["push"].value[:] = 0.01, -0.05
    scene.problem.solve()
    contact, u = scene.contact, scene.problem.equations.bulk.u.x.array
    evaluation, state = contact.evaluation, contact.state
    nodes = state.multiplier_nodes.copy()
    nodes[drop] = False
    count, search = [0], integrals.find_segments

    def counted(*args, **options):
        count[0] += 1
        return search(*args, **options)

    monkeypatch.setattr(integrals, "find_segments", counted)
    contact.change(multiplier_nodes=nodes)
    found, _ = evaluation.evaluate(u, contact.state, SEARCHED)
    assert count[0] == searches
    evaluation._recent.clear()
    new, _ = evaluation.evaluate(u, contact.state, SEARCHED)
    assert count[0] == searches + 1
    for field in fields(new):
        one, other = getattr(found, field.name), getattr(new, field.name)
        if isinstance(other, np.ndarray):
            assert np.array_equal(one, other), field.name
