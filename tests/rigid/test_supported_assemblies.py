# SPDX-License-Identifier: MIT
"""Arches, walls and towers supported by friction stay up to the load of limit analysis."""

import numpy as np
import pytest
from supported import (
    arch,
    incline,
    t_junction,
    tower,
    wall,
)
from test_supported import BASES, MOST, gives_way, stays

import fenics_mortar as fm

# Several bodies


def bears(scene, number):
    """Both springings together carry the weight, each half up to the difference of the meshes."""
    left, right = scene.force(number - 1), scene.force(number)
    assert left + right == pytest.approx([0.0, 1.0], abs=1e-7)
    assert left[1] == pytest.approx(0.5, rel=0.005)


@pytest.mark.once
def test_arch_of_stiff_voussoirs_stands_if_it_is_thick_enough():
    """Milankovitch: t/R = 0.1075 for many voussoirs; for few by limit analysis."""
    scene = arch(0.15, 7)
    stays(scene, most=MOST)
    bears(scene, 7)
    gives_way(arch(0.07, 7))


@pytest.mark.parametrize(
    "thickness, number, options",
    [
        (0.15, 5, {}),
        (0.12, 5, {}),
        (0.2, 3, {}),
        (0.2, 4, {"mu": 0.6}),
        (0.2, 5, {"n": 2}),
        (0.15, 5, {"E": 1e4}),
        (0.15, 9, {}),
        (0.15, 11, {"mu": 0.5}),
    ],
    ids=str,
)
def test_arch_of_stiff_voussoirs_takes_few_iterations(thickness, number, options):
    """No springs are used: the sets are those of the linearized problem."""
    scene = arch(thickness, number, **options)
    (report,) = stays(scene, most=MOST)
    assert report.certificate.springs == 0.0
    bears(scene, number)


@pytest.mark.once
@pytest.mark.parametrize(
    "options",
    [
        {"rows": 3, "cols": 2, "mu": 1.0, "cells": (4, 6, 2)},
        {"rows": 4, "cols": 2, "mu": 1.0, "cells": (3, 5), "base": "body"},
        {"rows": 4, "cols": 3, "mu": 0.4, "cells": (3, 5), "push": 0.5, "E": 1e5},
        {"rows": 3, "cols": 2, "mu": 0.8, "cells": (3, 5), "push": 0.5, "press": 3.0},
    ],
    ids=str,
)
def test_walls_with_cycling_sets_converge(options):
    stays(wall(**options), most=MOST)


@pytest.mark.once
def test_bricks_that_tilt_on_their_edges_do_so_elastically():
    """Half a brick at the end rocks on two nodes: far, but in proportion to 1 / E."""
    moved = {}
    for E in (1e4, 1e6):
        scene = wall(3, 2, 0.9, cells=(5, 4, 3), layers=1, push=0.7, E=E)
        assert scene.verdict(1)[0].factor > 1.3
        for report in scene.solve():
            assert report.certificate.violations() == []
            assert report.certificate.springs == 0.0
        moved[E] = E * scene.largest()
    assert moved[1e4] == pytest.approx(moved[1e6], rel=0.03)


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("cells", [(2, 2, 3), (3, 4, 5)])
@pytest.mark.parametrize("side", [None, 0.0])
def test_joint_of_two_blocks_under_a_third_passes_the_patch_test(side, cells, slave):
    """All stick, and the exact state has no slip. ``test_redundancy``: a joint in the middle."""
    scene = t_junction(cells, side=side, slave=slave)
    scene.set()
    report = scene.problem.solve()
    assert report.certificate.violations() == []
    assert scene.wrong(scene) == "", scene.note(scene)


@pytest.mark.parametrize(
    "rows, cols, mu, cells",
    [
        (2, 1, 0.2, (4,)),
        (2, 1, 1.0, (4, 6, 2)),
        (2, 2, 0.1, (4, 6, 2)),
        (2, 2, 0.4, (4,)),
        (2, 2, 1.0, (4, 6, 2)),
        (3, 2, 0.2, (4, 6, 2)),
        (3, 2, 1.0, (4,)),
    ],
)
def test_brick_wall_bears_its_weight_and_a_lateral_load(rows, cols, mu, cells):
    scene = wall(rows, cols, mu, cells=cells)
    stays(scene, most=MOST)
    lowest = sum(scene.force(i) for i in range(cols))
    count = sum(body.weight for body in scene.bodies)
    assert lowest == pytest.approx([-0.25 * mu * count, count], rel=1e-5)


@pytest.mark.parametrize(
    "options",
    [
        {"friction": False, "push": 0.0},
        {"base": "body"},
        {"upright": False},
        {"load": "top", "push": 0.5},
        {"press": 2.0},
    ],
    ids=str,
)
def test_other_walls_of_five_bricks(options):
    stays(wall(2, 2, 0.6, **options), most=MOST)


@pytest.mark.once
def test_wall_fails_beyond_the_friction_limit():
    gives_way(wall(2, 1, 0.4, push=1.2))


@pytest.mark.once
@pytest.mark.parametrize("rows, cols, mu", [(4, 3, 0.3), (3, 9, 0.5)])
def test_large_wall(rows, cols, mu):
    stays(wall(rows, cols, mu, cells=(4, 2)), most=MOST)


@pytest.mark.parametrize("seed", range(1, 5))
def test_random_tower_bears_half_of_the_lateral_force_that_limit_analysis_allows(seed):
    stays(tower(seed), most=MOST)


@pytest.mark.once
def test_random_tower_fails_beyond_the_limit_load():
    gives_way(tower(1, part=1.2))


@pytest.mark.once
@BASES
def test_block_on_a_steep_incline_is_said_to_slide(base):
    """Down the incline, whatever follows after its lower end."""
    slides = (
        r"body 'block' slides, .* to move along \(0\.6967, -0\.7174\)\. At last body 'block' can"
    )
    with pytest.raises(fm.NotConvergedError, match=slides):
        list(incline(0.8, 0.5, base).solve())


@pytest.mark.once
@BASES
def test_path_of_an_incline_ends_at_the_angle_of_friction(base):
    """The block sticks up to the critical angle; the message states why the path ends."""
    mu = 0.5
    scene = incline(0.3, mu, base, turn=0.0)

    def tilt(time):
        scene.gravity.value[:] = np.sin(time), -np.cos(time)

    options = fm.SteppingOptions(step=0.1, smallest=1e-3)
    with pytest.raises(fm.NotConvergedError, match="freely") as error:
        fm.follow_path(scene.problem, tilt, options, start=0.2, stop=1.0)
    end = error.value.report.steps[-1].time
    # The limit is slightly higher on a soft base, by its indentation.
    assert np.arctan(mu) - 2e-3 < end < np.arctan(mu) + (1e-2 if base == "body" else 1e-9)
