# SPDX-License-Identifier: MIT
"""Assemblies in space on contact alone: a table on an incline, walls, a chain."""

import numpy as np
import pytest
from refusal import refused
from space_supported import chain_of_links, table_on_an_incline, wall_of_two_leaves

import fenics_mortar as fm


def test_table_on_an_incline_stands_below_the_angle_of_friction():
    """Four legs carry the weight, which acts in front of the lower ones."""
    made = table_on_an_incline(0.36, 0.4)
    made.rests()
    force = made.on_obstacle()
    assert np.abs(force[:2]).max() < 1e-9 * abs(force[2]) and force[2] < 0.0
    assert np.abs(made.place()[1]).max() < 1e-3


@pytest.mark.once
def test_table_slides_where_friction_is_too_small():
    slides = r"^body 'block' slides, .* it begins to move along \(0.93.*, -0.34.*\)\. At last body"
    with refused(fm.NotConvergedError, slides):
        table_on_an_incline(0.35, 0.2).problem.solve()


def test_table_tips_about_its_lower_legs_where_friction_is_large():
    """On an incline of 43 degrees; friction would hold up to 56."""
    tips = (
        r"body 'block' tips over, which no friction can prevent: it begins to rotate about the "
        r"axis \(0, 1, 0\) through \(0.512\d*, .*, -0.477\d*\)"
    )
    with refused(fm.NotConvergedError, tips):
        table_on_an_incline(0.75, 1.5, height=0.9).problem.solve()


@pytest.mark.serial
def test_wall_of_two_leaves_stands():
    """The floor carries the weight and its inclination."""
    made = wall_of_two_leaves()
    report = made.rests()
    assert report.num_iterations <= 6 and "springs carry" not in str(report)
    load = 6 * 0.49 * 0.4 * np.array([0.1, 0.15, -1.0])
    assert np.allclose(made.on_obstacle(), load, rtol=1e-8)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_chain_of_three_links_hangs(mu):
    """Each contact carries the weight below it, without a force aside."""
    made = chain_of_links(mu)
    made.rests()
    contacts = made.problem.equations.contacts
    on_ring, on_link = (c.operators.force(c.z)[0].sum(axis=0) for c in contacts)
    assert np.allclose(made.on_obstacle(), on_ring, atol=1e-12)
    assert np.allclose(on_ring, 2.0 * on_link, rtol=1e-6, atol=1e-8) and on_ring[2] < 0.0
