# SPDX-License-Identifier: MIT
"""Areas of cells at their nodes, against cross products of their sides."""

import numpy as np
import pytest

from fenics_mortar.kernels.facets import tabulate_volumes

TRIANGLE = np.tile([(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)], (3, 1, 1))
# of (1 - s)(1 - t), s (1 - t), (1 - s) t, s t at the nodes (0, 0), (1, 0), (0, 1), (1, 1)
NODES = [(0, 0), (1, 0), (0, 1), (1, 1)]
QUADRILATERAL = np.array(
    [[(t - 1, s - 1), (1 - t, -s), (-t, 1 - s), (t, s)] for s, t in NODES], dtype=float
)


@pytest.mark.parametrize(
    "gradients, around",
    [(TRIANGLE, [(1, 2), (2, 0), (0, 1)]), (QUADRILATERAL, [(1, 2), (3, 0), (0, 3), (2, 1)])],
)
def test_area_at_a_corner_is_the_cross_product_of_its_sides(gradients, around):
    x = np.array([(0.1, 0.2), (1.3, -0.1), (0.2, 1.1), (1.7, 1.9)]) + 100.0
    cells = np.arange(len(around))[None]
    areas = np.empty(cells.shape)
    tabulate_volumes(x, cells, gradients, areas)
    for corner, (one, other) in enumerate(around):
        (a, b), (c, d) = x[one] - x[corner], x[other] - x[corner]
        assert areas[0, corner] == pytest.approx(a * d - b * c, rel=1e-12)
