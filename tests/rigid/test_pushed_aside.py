# SPDX-License-Identifier: MIT
"""Bodies that contact alone supports, and that tools or trays push: few iterations, no jumps."""

from __future__ import annotations

import numpy as np
import pytest
from supported import Assembly
from supported_parts import Body, Flat, Touch
from supported_problem import floor_of, pose

import fenics_mortar as fm
from fenics_mortar.rigid.complementarity import Touching, motion_past
from meshes.mapped_grids import Grid, block


def before_tool(mu: float, base: str, *, rough: float = 0.0, upper: bool = False) -> Assembly:
    """A block that friction holds, in contact with a plane, "tool"; another block may lie on it."""
    bodies, floor = floor_of(base, width=3.0, columns=17, left=-1.0)
    bodies.append(Body(Grid("block", block(8, 4, width=1.0, height=0.5)), weight=1.0))
    tool = Flat((0.0, 0.0), (1.0, 0.0), "tool")
    touches = [Touch("block/bottom", floor, fm.Coulomb(mu))]
    touches += [Touch("block/left", tool, fm.Coulomb(rough) if rough else None)]
    if upper:
        grid = block(7, 3, width=0.9, height=0.4, corner=(0.04, 0.5))
        bodies.append(Body(Grid("upper", grid), weight=1.0))
        touches.append(Touch("upper/bottom", "block/top", fm.Coulomb(mu)))
    return pose("before tool", bodies, touches, [{"weight": 1.0}])


@pytest.mark.parametrize(
    "mu, base, rough, way",
    [(0.6, "body", 0.0, 0.2), (0.3, "body", 0.3, 0.2), (0.3, "plane", 0.3, 0.05)],
)
def test_first_push_of_a_block_that_friction_holds_takes_few_iterations(mu, base, rough, way):
    """Without the move aside 42, 45 and 41 iterations; force by Coulomb's law."""
    scene = before_tool(mu, base, rough=rough)
    list(scene.solve())
    scene.obstacles["tool"].move(x=way)
    report = scene.problem.solve()
    assert report.num_iterations <= 8
    assert report.certificate.violations() == []
    assert scene.motion("block")[0] == pytest.approx(way, abs=1e-3)
    push, shear = scene.force(1), scene.force(0)
    assert push[0] == pytest.approx(mu * abs(shear[1]), rel=1e-4)


@pytest.mark.parametrize("way", [0.1, 0.2])
def test_a_pushed_block_slides_and_is_not_tipped_onto_its_corner(way):
    """It slides, as the push is low; Newton's method alone found it leaning on the tool at 0.6."""
    scene = before_tool(0.6, "plane")
    list(scene.solve())
    scene.obstacles["tool"].move(x=way)
    scene.problem.solve()
    assert scene.motion("block") == pytest.approx([way, 0.0, 0.0], abs=1e-3)


def test_a_block_on_a_pushed_one_is_carried_along():
    """Friction between them is that below with half of the force."""
    scene = before_tool(0.4, "body", upper=True)
    list(scene.solve())
    scene.obstacles["tool"].move(x=0.3)
    report = scene.problem.solve()
    assert report.num_iterations <= 8
    assert [scene.motion(name)[0] for name in ("block", "upper")] == pytest.approx(
        [0.3, 0.3], abs=2e-3
    )


@pytest.mark.parametrize("gap, ways", [(0.0, (0.02, 1.0e-5)), (0.01, (0.005, 0.012, 0.03))])
def test_a_tray_lifts_an_idle_body(gap, ways):
    """It goes along with the tray where this touches it, and the report says that nothing holds."""
    tray = Flat((0.0, 0.0), (0.0, 1.0), "tray")
    grid = block(4, 3, width=0.8, height=0.4, corner=(0.0, gap))
    touches = [Touch("block/bottom", tray, fm.Coulomb(0.3))]
    scene = pose("tray", [Body(Grid("block", grid))], touches, [{}])
    place = 0.0
    for way in ways:
        place += way
        scene.obstacles["tray"].move(y=place)
        report = scene.problem.solve()
        assert scene.motion("block") == pytest.approx([0.0, max(place - gap, 0.0), 0.0], abs=1e-9)
        assert any("nothing holds body 'block'" in note for note in report.notes)


def test_a_body_in_no_pair_stays():
    """Nothing can push it."""
    scene = pose("alone", [Body(Grid("block", block(2, 2, width=1.0, height=1.0)))], [], [{}])
    scene.problem.solve()
    assert scene.largest() == 0.0


@pytest.mark.parametrize("way, mu, most", [((0.2, 0.0), 0.1, 60), ((0.2, 0.1), 0.5, 5)])
def test_a_block_on_a_tray_is_carried_along(way, mu, most):
    """Friction that drives it ends with the slip: a steady slide is not without end."""
    tray = Flat((0.0, 0.0), (0.0, 1.0), "tray")
    grid = Grid("block", block(8, 4, width=1.0, height=0.5))
    touches = [Touch("block/bottom", tray, fm.Coulomb(mu))]
    scene = pose("carried", [Body(grid, weight=1.0)], touches, [{"weight": 1.0}])
    list(scene.solve())
    scene.obstacles["tray"].move(x=way[0], y=way[1])
    report = scene.problem.solve()
    assert scene.motion("block") == pytest.approx([*way, 0.0], abs=1e-3)
    assert report.num_iterations <= most


def test_a_block_on_a_turning_tray_follows_it_once():
    tray = Flat((0.0, 0.0), (0.0, 1.0), "tray")
    grid = Grid("block", block(8, 4, width=1.0, height=0.5, corner=(1.0, 0.0)))
    touches = [Touch("block/bottom", tray, fm.Coulomb(0.9))]
    scene = pose("turned", [Body(grid, weight=1.0)], touches, [{"weight": 1.0}])
    list(scene.solve())
    scene.obstacles["tray"].move(angle=0.3)
    assert scene.problem.solve().num_iterations <= 10
    assert scene.motion("block")[2] == pytest.approx(0.3, abs=0.01)


def test_motion_past_slides_or_tips():
    """A block of weight one and width two, pushed at a height: slides below 1 / mu, else tips."""

    def motion(height: float, mu: float) -> np.ndarray:
        """Translations and rotation about the middle of the bottom; nodes are its corners."""
        opening = np.array([[0.0, 1.0, -1.0], [0.0, 1.0, 1.0], [1.0, 0.0, -height]])
        slip = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        none = np.zeros(3)
        nodes = Touching(opening, slip, none, np.array([0.5 * mu, 0.5 * mu, 0.0]), none)
        found = motion_past(np.array([0.0, -1.0, 0.0]), nodes, np.array([0.0, 0.0, -0.1]), none)
        assert found is not None
        return found

    assert motion(1.0, 0.5) == pytest.approx([0.1, 0.0, 0.0], abs=1e-9)
    assert motion(4.0, 0.5) == pytest.approx([0.0, 0.025, -0.025], abs=1e-9)
    between = Touching(np.array([[1.0], [-1.0]]), np.zeros((2, 1)), *np.zeros((3, 2)))
    assert motion_past(np.zeros(1), between, np.array([-0.1, 0.05]), np.zeros(2)) is None
