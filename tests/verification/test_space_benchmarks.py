# SPDX-License-Identifier: MIT
"""Benchmarks in space on coarse meshes: shear with slip, rolling, impact of hollow bodies."""

import pytest

from demos.studies.space import mindlin
from demos.studies.space.half_spaces import KINDS
from demos.studies.space.ironing import iron
from demos.studies.space.rolling import roll
from demos.studies.space.tori import collide

pytestmark = pytest.mark.serial


@pytest.mark.once
def test_the_disc_that_sticks_under_a_shear_force():
    """Radius by Mindlin's theory, for three forces; at most three facets along it."""
    coarse, fine = (mindlin.root_mean_square(mindlin.measure(KINDS[0], n)) for n in (5, 7))
    assert coarse < 0.05
    assert fine < 0.01


@pytest.mark.once
@pytest.mark.parametrize("mu", [0.05, 0.5])
def test_a_ball_rolls_between_plates(mu):
    """Neither creep, (a / R)^2 = 0.02 at most, nor work of friction, nor a force, for any mu."""
    found = roll(8, 0.02, mu, steps=3)
    assert abs(found.creep) < 0.008
    assert abs(found.pull) < 0.005
    assert 0.0 <= found.work < 4e-4
    assert max(found.iterations) <= 8


@pytest.mark.once
def test_hollow_tori_collide():
    """A tenth of the whole impact, at large strains; the energy is that of the start to 1e-8."""
    found = collide(24, 0.5)
    assert found.momentum < 1e-11 and found.spin < 1e-11
    assert found.energy < 1e-7
    assert found.touched >= 4 and found.strain > 0.03
    assert found.iterations <= 6 * found.steps


@pytest.mark.once
def test_a_shell_is_pressed_into_a_slab_and_drawn():
    """Ironing on facets as long as a third of the height; no step fails, T is about mu N."""
    found = iron(0.2, 1, way=2.4)
    assert found.cuts == 0 and found.steps == 24
    assert found.iterations <= 5 * found.steps
    assert found.normal == pytest.approx(found.pressed, rel=0.1)
    assert 0.2 < found.tangential / found.normal < 0.27
