# SPDX-License-Identifier: MIT
"""Limit analysis of the trial, compared with closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from demos.studies.stability.limit_analysis import (
    GROUND,
    Point,
    Structure,
    friction_needed,
    judge,
    least_factor,
)

UP = np.array([0.0, 1.0])


def wrench(x, force):
    """Force and its moment about the origin."""
    return np.array([*force, x[0] * force[1] - x[1] * force[0]])


def block_on(mu, *, width, height, dead, live=(0.0, 0.0), at=None):
    """A block on y = 0 with loads in its centre; ``at``: where the live one is."""
    centre = np.array([0.5 * width, 0.5 * height])
    points = [Point(0, GROUND, np.array([x, 0.0]), UP, mu) for x in (0.0, width)]
    return Structure(
        points,
        np.array([wrench(centre, dead)]),
        np.array([wrench(centre if at is None else at, live)]),
    )


@pytest.mark.parametrize("mu", [0.2, 0.5, 1.0, 3.0])
def test_block_on_an_incline_slides_at_mu_and_tips_at_its_slenderness(mu):
    width, height = 0.4, 0.5
    critical = np.arctan(min(mu, width / height))
    for angle, stays in ((0.999 * critical, True), (1.001 * critical, False)):
        down = np.array([np.sin(angle), -np.cos(angle)])
        assert judge(block_on(mu, width=width, height=height, dead=down)).feasible == stays


@pytest.mark.parametrize("mu, slides", [(0.3, True), (0.9, False)])
def test_pushed_block_slides_or_tips(mu, slides):
    width, height, weight = 0.8, 1.0, 2.0
    found = judge(block_on(mu, width=width, height=height, dead=(0, -weight), live=(1.0, 0.0)))
    exact = weight * min(mu, width / height)
    assert found.factor == pytest.approx(exact, rel=1e-9)
    push = block_on(mu, width=width, height=height, dead=(0, -weight), live=(1.0, 0.0))
    assert least_factor(push) == pytest.approx(exact, rel=1e-6)
    rates = found.mechanism[0] / np.abs(found.mechanism[0]).max()
    assert (abs(rates[2]) < 1e-9) == slides
    assert rates[0] > 0.0 or rates[2] < 0.0, "along the push"


def test_ladder_slips_at_twice_mu():
    """Floor with friction, wall without."""
    mu = 0.4
    critical = np.arctan(1.0 / (2.0 * mu))
    for angle, stays in ((1.001 * critical, True), (0.999 * critical, False)):
        head = np.array([np.cos(angle), np.sin(angle)])
        points = [
            Point(0, GROUND, np.zeros(2), UP, mu),
            Point(0, GROUND, head, np.array([-1.0, 0.0]), 0.0),
        ]
        weight = np.array([wrench(0.5 * head, (0.0, -1.0))])
        assert judge(Structure(points, weight, 0.0 * weight)).feasible == stays


def arch(thickness, number):
    """A semicircular arch of mean radius one under its weight, without slip."""
    angles = np.linspace(0.0, np.pi, number + 1)
    points = []
    for k, angle in enumerate(angles):
        one, other = (k, k - 1) if k < number else (GROUND, k - 1)
        n = np.array([-np.sin(angle), np.cos(angle)])
        for radius in (1.0 - 0.5 * thickness, 1.0 + 0.5 * thickness):
            x = radius * np.array([np.cos(angle), np.sin(angle)])
            points.append(Point(one, other, x, n, 3.0))
    middle = 0.5 * (angles[1:] + angles[:-1])
    half = 0.5 * (angles[1] - angles[0])
    radius = np.sin(half) / half * (1.0 + thickness**2 / 12.0)
    centres = radius * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    dead = np.array([wrench(centre, (0.0, -1.0)) for centre in centres])
    return Structure(points, dead, 0.0 * dead)


def test_arch_stands_above_milankovitch_thickness():
    """Thickness 0.1075 radii; with finitely many joints slightly less is sufficient."""
    assert judge(arch(0.1080, 120)).feasible
    assert not judge(arch(0.1060, 120)).feasible


def test_tower_of_two_blocks():
    """Offset by an eighth: the upper one slides, or both tip about the lower one's corner."""
    width, height, off = 1.0, 1.0, 0.125
    for mu, exact in ((0.2, 0.2), (2.0, (0.5 + 0.5 - off) / 1.5)):
        points = [Point(0, GROUND, np.array([x, 0.0]), UP, mu) for x in (0.0, width)]
        points += [Point(1, 0, np.array([x, height]), UP, mu) for x in (off, width)]
        centre = np.array([off + 0.5 * width, 1.5 * height])
        dead = np.array([wrench((0.5, 0.5), (0, -1.0)), wrench(centre, (0, -1.0))])
        live = np.array([np.zeros(3), wrench(centre, (1.0, 0.0))])
        assert judge(Structure(points, dead, live)).factor == pytest.approx(exact, rel=1e-9)


def test_wheel_in_a_groove_bears_the_torque_of_two_sliding_points():
    mu, half = 0.3, np.sqrt(0.5)
    points = [
        Point(0, GROUND, np.array([s * half, -half]), np.array([-s * half, half]), mu)
        for s in (1.0, -1.0)
    ]
    dead, live = np.array([[0.0, -1.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    exact = np.sqrt(2.0) * mu / (1.0 + mu**2)
    assert judge(Structure(points, dead, live)).factor == pytest.approx(exact, rel=1e-9)


def test_block_between_jaws_and_under_a_ceiling():
    """The limit load of two guided jaws is 2 mu P, that of adhesion its strength."""
    sides = [(0, GROUND, 0.0, 1.0), (0, 1, 1.0, -1.0)]
    points = [
        Point(one, other, np.array([x, y]), np.array([n, 0.0]), 0.5)
        for one, other, x, n in sides
        for y in (0.0, 1.0)
    ]
    dead = np.array([np.zeros(3), wrench((1.0, 0.5), (-3.0, 0.0))])
    live = np.array([wrench((0.5, 0.5), (0.0, -1.0)), np.zeros(3)])
    guided = np.array([[0, 0, 0], [0, 1, 1]], bool)
    assert judge(Structure(points, dead, live, guided)).factor == pytest.approx(3.0, rel=1e-9)
    glued = [Point(0, GROUND, np.array([x, 1.0]), -UP, 0.5, pull=0.7) for x in (0.0, 1.0)]
    hanging = Structure(glued, np.zeros((1, 3)), live[:1])
    assert judge(hanging).factor == pytest.approx(1.4, rel=1e-9)
    aside = np.array([wrench((0.5, 1.0), (1.0, 0.0))])
    assert judge(replace(hanging, live=aside)).factor == pytest.approx(0.0, abs=1e-9)
    pressed = replace(hanging, dead=-live[:1], live=aside)
    assert judge(pressed).factor == pytest.approx(0.5, rel=1e-9), "adhesion adds no friction"


def test_friction_needed_is_that_of_the_incline():
    angle, mu = 0.3, 0.8
    down = np.array([np.sin(angle), -np.cos(angle)])
    on = block_on(mu, width=1.0, height=0.5, dead=down)
    assert friction_needed(on) == pytest.approx(np.tan(angle) / mu, rel=1e-4)
