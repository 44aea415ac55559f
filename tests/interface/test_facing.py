# SPDX-License-Identifier: MIT
"""Facets faced by points, computed by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from fenics_mortar.interface.facing import nearest_facets

pytestmark = pytest.mark.serial


def test_nearest_facet_contains_the_nearest_point():
    m = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)])
    surface = SimpleNamespace(facets=np.array([[0, 1], [1, 2]]))
    x = np.array([(0.8, 0.1), (0.9, 0.6), (0.2, -0.3), (-0.5, 0.1), (1.2, 2.5)])
    ends, places = nearest_facets(x, m, surface)
    assert ends.tolist() == [[0, 1], [1, 2], [0, 1], [0, 1], [1, 2]]
    assert places == pytest.approx([0.8, 0.3, 0.2, -0.5, 1.25])
