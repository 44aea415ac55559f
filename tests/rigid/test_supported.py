# SPDX-License-Identifier: MIT
"""Bodies supported by friction or adhesion remain at rest up to the limit load."""

import numpy as np
import pytest
from supported import (
    block_and_wall,
    hanging,
    incline,
    jaws,
    ladder,
    pressed,
    wheel,
)
from supported_problem import NU

import fenics_mortar as fm

E = 1e4
# Largest number of Newton iterations of a step of an assembly supported by contact alone.
MOST = 10
BASES = pytest.mark.parametrize("base", ["plane", "body"])


def stays(scene, most=None):
    """Solve all steps: states without violations, with elastic displacements only."""
    reports = []
    for step, report in enumerate(scene.solve()):
        assert scene.verdict(step)[0].feasible, "limit analysis"
        assert report.certificate.violations() == []
        assert scene.largest() <= scene.small, report.notes
        assert not scene.wrong(scene)
        assert most is None or report.num_iterations <= most, report.notes
        reports.append(report)
    return reports


def gives_way(scene):
    """The last step has no solution according to limit analysis and to the package's message."""
    last = len(scene.path) - 1
    verdict, _ = scene.verdict(last)
    assert not verdict.feasible or verdict.factor < 1.0
    for loads in scene.path[:last]:
        scene.set(**loads)
        scene.problem.solve()
    scene.set(**scene.path[last])
    with pytest.raises(fm.MortarError) as error:
        scene.problem.solve()
    assert len(str(error.value)) > 20


# One body


@pytest.mark.once
@pytest.mark.parametrize("mu, base", [(0.2, "body"), (0.9, "plane")])
def test_block_on_an_incline_sticks_up_to_the_angle_of_friction(mu, base):
    """The contact force is the weight, upright; the shear strains the block a little downhill."""
    for factor in (0.5, 0.95):
        slope = np.arctan(factor * mu)
        scene = incline(slope, mu, base)
        stays(scene)
        assert scene.force(0) == pytest.approx([-np.sin(slope), np.cos(slope)], abs=1e-8)
        sheared = np.sin(slope) * 0.5 / (E / (2 * (1 + NU)))  # by the whole weight at its top
        slid = scene.motion("block")[0]
        assert 0.0 < slid < sheared if base == "plane" else 0.0 < slid < 20.0 * sheared
    gives_way(incline(np.arctan(1.05 * mu), mu, base))


@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi / 2])
def test_incline_is_independent_of_the_orientation(turn):
    scene, upright = incline(0.4, 0.5, turn=turn), incline(0.4, 0.5)
    for each in (scene, upright):
        stays(each)
    assert np.abs(scene.moved - upright.moved).max() < 1e-6 * upright.largest()


@BASES
@pytest.mark.parametrize("push", [0.001, 0.1, 0.45])
def test_block_below_the_friction_limit_does_not_slide(push, base):
    scene = block_and_wall(push, 0.5, base)
    stays(scene)
    sheared = push * 0.5 / (E / (2 * (1 + NU)))
    assert scene.motion("block")[0] < (sheared if base == "plane" else 20.0 * sheared)
    assert scene.force(1) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert scene.force(0) == pytest.approx([-push, 1.0], abs=1e-7)


@BASES
def test_block_under_weight_and_push_sticks_in_one_step(base):
    stays(block_and_wall(0.1, 0.5, base, at_once=True))


@BASES
def test_block_beyond_the_friction_limit_slides_to_the_wall(base):
    """The wall carries the push minus friction, which acts against the slide."""
    scene = block_and_wall(0.6, 0.5, base)
    scene.set(**scene.path[0])
    scene.problem.solve()
    scene.set(**scene.path[1])
    try:
        report = scene.problem.solve()
    except fm.MortarError:
        return
    assert report.certificate.violations() == []
    assert scene.motion("block")[0] == pytest.approx(0.3, rel=0.01)
    assert scene.force(1)[0] == pytest.approx(-0.1, rel=0.02)


@pytest.mark.once
@pytest.mark.parametrize("groove", ["planes", "body"])
def test_wheel_in_a_groove_sticks_below_its_limit_torque(groove):
    for part in (0.01, 0.9):
        scene = wheel(part, groove=groove)
        stays(scene)
        assert abs(scene.motion("wheel")[2]) < 1e-3


@pytest.mark.once
@BASES
def test_ladder_stands_above_its_critical_angle(base):
    """For the thin ladder tan = 1 / (2 mu); for the thick one the angle of limit analysis."""
    for factor in (1.03, 1.3):
        scene = ladder(np.arctan(factor / 0.8), 0.4, base=base)
        stays(scene)
        thrust = -scene.force(1)[0]
        assert thrust == pytest.approx(0.5 * 0.8 / factor, rel=0.1)
        assert scene.force(0) == pytest.approx([thrust, 1.0], abs=1e-4)
    gives_way(ladder(np.arctan(0.9 / 0.8), 0.4, base=base))


def test_sticking_corner_beyond_the_friction_cone_is_a_violation():
    """The averaged normal of a slave's corner is half-way between floor and ladder."""
    scene = ladder(np.arctan(0.7 / 0.8), 0.4, base="body", on_corner=True)
    assert scene.verdict(0)[0].factor < 1.0
    scene.set(weight=1.0)
    message = r"a corner of the slave sticks at .* above the friction limit.* take 'ground/top' as"
    with pytest.raises(fm.NotConvergedError, match=message) as caught:
        scene.problem.solve()
    (certificate, _) = caught.value.report.certificate.pairs
    thrust, weight = scene.force(0)
    assert certificate["excess_shear"].value == pytest.approx(thrust / weight / 0.4 - 1.0, abs=0.01)


def test_sticking_corner_within_the_friction_cone_is_a_remark():
    scene = ladder(np.arctan(1.3 / 0.8), 0.4, base="body", on_corner=True)
    (report,) = stays(scene)
    assert report.certificate.pairs[0]["excess_shear"].value == 0.0
    assert any("act along the surface" in note for note in report.notes)


@pytest.mark.once
@BASES
def test_block_hangs_from_a_ceiling_up_to_its_adhesion(base):
    for weight in (0.1, 0.8):
        scene = hanging(weight, 1.0, base)
        stays(scene)
        assert scene.force(0) == pytest.approx([0.0, weight], abs=1e-7)
    gives_way(hanging(1.2, 1.0, base))


@BASES
def test_block_pressed_to_a_ceiling_is_supported_by_friction(base):
    scene = hanging(-0.5, 1.0, base, push=0.1)
    stays(scene)
    assert scene.force(0) == pytest.approx([-0.1, -0.5], abs=1e-7)


@pytest.mark.once
@pytest.mark.parametrize("kind", ["planes", "bodies"])
def test_block_between_jaws_is_supported_by_friction(kind):
    """The limit load of two jaws is 2 mu P."""
    for weight in (0.0, 0.3, 0.9):
        scene = jaws(weight, 1.0, 0.5, kind)
        stays(scene)
        forces = np.array([scene.force(i) for i in range(2)])
        assert np.abs(forces[:, 0]) == pytest.approx([1.0, 1.0], abs=1e-6)
        assert forces[:, 1].sum() == pytest.approx(weight, abs=1e-6)
    gives_way(jaws(1.1, 1.0, 0.5, kind))


@pytest.mark.parametrize("kind", ["planes", "bodies"])
def test_row_of_three_blocks_between_jaws(kind):
    stays(jaws(0.1, 2.0, 0.8, kind, blocks=3), most=MOST)


@pytest.mark.once
@BASES
def test_block_moves_along_with_the_body_that_presses_it(base):
    scene = pressed(0.0, base=base)
    stays(without_judge(scene))
    force = scene.force(0)[1]
    most = 0.5 * force / scene.bodies[0].push
    for part in (0.1, 0.9):
        scene = pressed(part * most, base=base)
        stays(without_judge(scene))
        assert scene.force(0) == pytest.approx([-0.5 * part * force, force], rel=0.02)
    scene = pressed(1.1 * most, base=base)
    with pytest.raises(fm.MortarError):
        list(scene.solve())


def without_judge(scene):
    """Prescribed motions cause forces that are unknown to limit analysis."""
    scene.verdict = lambda step: (type("Verdict", (), {"feasible": True}), 0.0)
    return scene
