# SPDX-License-Identifier: MIT
"""Bodies that lean on each other and stand on one edge of their feet, the other one hardly open."""

import numpy as np
import pytest
from supported_parts import Body, Flat, Touch
from supported_problem import pose

import fenics_mortar as fm
from meshes.mapped_grids import Grid, mapped

FLOOR, ANGLE = Flat((0.0, 0.0), (0.0, 1.0), "floor"), np.radians(20.0)


def card(cells, side):
    """A card of length 1 that leans to x = 0, with a level foot and an upright head.

    Args:
        cells: Cells across.
        side: -1 or 1, the side of x = 0 it stands on.
    """
    height, across = np.cos(ANGLE), 0.04 / np.cos(ANGLE)
    inner, outer = side * np.sin(ANGLE), side * (np.sin(ANGLE) + across)

    def position(s, t):
        low, high = (outer, inner) if side < 0 else (inner, outer)
        near = s if side < 0 else 1.0 - s
        top = height + across / np.tan(ANGLE) * (1.0 - near)
        return (1.0 - t) * (low + s * (high - low)), t * top

    return mapped(cells, 8, position)


def cards(cells):
    """Two cards that lean on each other; the left one is pushed in the second step."""
    left, right = (Grid(name, card(cells, side)) for name, side in (("left", -1), ("right", 1)))
    touches = [
        Touch("left/bottom", FLOOR, fm.Coulomb(0.3)),
        Touch("right/bottom", FLOOR, fm.Coulomb(0.3)),
        Touch("left/top", "right/top", fm.Coulomb(0.1)),
    ]
    bodies = [Body(left, weight=1.0, push=1.0), Body(right, weight=1.0)]
    path = [{"weight": 1.0}, {"weight": 1.0, "push": 0.02}, {"weight": 1.0, "push": 0.03}]
    return pose("cards", bodies, touches, path, E=1e6)


@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("mu", [0.0, 0.1])
def test_ladder_at_a_smooth_wall_takes_few_iterations(mu, cells):
    """Where nodes of a smooth wall stuck in one step of each two, it took up to 181 iterations."""
    wall = Flat((np.sin(ANGLE), 0.0), (-1.0, 0.0), "wall")
    ladder = mapped(cells, 16, lambda s, t: (t * np.sin(ANGLE) + 0.05 * (s - 1.0), t))
    touches = [
        Touch("ladder/bottom", FLOOR, fm.Coulomb(0.4)),
        Touch("ladder/right", wall, fm.Coulomb(mu)),
    ]
    path = [{"weight": 1.0}]
    scene = pose("ladder", [Body(Grid("ladder", ladder), weight=1.0)], touches, path, E=1e6)
    (report,) = scene.solve()
    assert report.num_iterations <= 8 and report.certificate.springs == 0.0
    assert abs(scene.force(1)[1]) == pytest.approx(mu * abs(scene.force(1)[0]), abs=1e-9)


@pytest.mark.parametrize("cells", [2, 5])
def test_leaning_cards_bear_the_load_of_limit_analysis(cells):
    """The heads slide between the pushes 0.02 and 0.03; the limit load is 0.118.

    Only one node of a foot is active before. Limit analysis with these nodes alone would let the
    left card slide away.
    """
    scene = cards(cells)
    pushed = [(report, scene.largest()) for report in scene.solve()]
    assert all(report.certificate.violations() == [] for report, _ in pushed)
    assert pushed[-1][1] < 2e-4 and not any("moved" in note for note in pushed[-1][0].notes)
    shear, pressure = abs(scene.force(2)[1]), abs(scene.force(2)[0])
    assert shear == pytest.approx(0.1 * pressure, rel=2e-3)
