# SPDX-License-Identifier: MIT
"""Fractions of displacement increments that leave the cells enough area."""

import numpy as np
import pytest
from array_meshes import blocks_of_arrays, problem_on


@pytest.mark.parametrize("given, added", [(1.0, 0.25), (0.3, 0.3), (0.6, 0.3)])
def test_a_step_that_would_turn_cells_over_is_halved(given, added):
    """The fraction f of this step leaves 1 - 2 f of each cell's area; a fifth is required."""
    bulk = problem_on(blocks_of_arrays()).equations.bulk
    X = bulk.space.V.tabulate_dof_coordinates()[: bulk.space.num_nodes, 1]
    step = np.zeros(bulk.num_owned)
    step[bulk.space.owned_dofs[:, 1]] = -2.0 * X
    before = bulk.u.x.array[: bulk.num_owned].copy()
    assert bulk.move(step, given) == added
    assert np.allclose(bulk.u.x.array[: bulk.num_owned], before + added * step, atol=1e-14)
