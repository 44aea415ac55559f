# SPDX-License-Identifier: MIT
"""Attributes set after the problem was created: checked by the next solve."""

import numpy as np
import pytest
from array_meshes import blocks_of_arrays, problem_on
from refusal import refused, refused_with_address
from small_scenes import small_blocks
from spoilt_law import rubbing_blocks

import fenics_mortar as fm


@pytest.mark.parametrize(
    "name, value",
    [
        ("discretization", fm.Discretization(c_n=-1.0)),
        ("search_radius", -3.0),
        ("discretization", fm.Discretization(basis="standard")),
        ("sliding", "small"),
        ("discretization", "other_codes"),
        ("initial_gap", 0.0),
        ("slave_name", "upper/top"),
    ],
)
def test_option_of_a_pair_that_is_set_after_the_problem_is_refused(name, value):
    """Such a change would have no effect, or only a partial one."""
    scene = rubbing_blocks(fm.Coulomb(0.3))
    setattr(scene.contact.pair, name, value)
    with refused(fm.MortarError, f"{name} of ContactPair.* was set after .* new problem"):
        scene.problem.solve()


@pytest.mark.parametrize(
    "name, value, message",
    [
        ("discretization", fm.Discretization(c_n=-1.0), "c_n=-1.0"),
        ("discretization", fm.Discretization(basis="cubic"), "basis='cubic'"),
        ("discretization", "other_codes", "discretization='other_codes': expected an instance of"),
        ("law", None, "law=None"),
    ],
)
def test_option_of_a_pair_that_is_set_before_the_problem_is_checked(name, value, message):
    data = blocks_of_arrays()
    pair = fm.ContactPair(data, "slave", "master")
    setattr(pair, name, value)
    with refused(ValueError, message):
        problem_on(data, [pair])


@pytest.mark.parametrize("value", [-1.0, np.nan, 0.0, "1"])
def test_weight_of_the_gap_that_is_set_later_is_checked(value):
    scene = small_blocks()
    scene.contact.c_n = value
    with refused(ValueError, "contact.c_n=.*: expected a positive number"):
        scene.problem.solve()


def test_state_of_another_problem_is_refused_and_nothing_changes():
    scene, other = small_blocks(), small_blocks(degree=2)
    before = scene.u.x.array.copy()
    with refused(fm.MortarError, "the state belongs to another problem"):
        scene.problem.restore(other.problem.state())
    with refused(ValueError, r"state=None: expected what state\(\) of the same problem returned"):
        scene.problem.restore(None)
    assert np.array_equal(scene.u.x.array, before)


def test_variant_by_an_unknown_option_is_refused():
    with refused_with_address(ValueError, "slidin='small': expected one of .*sliding"):
        small_blocks().problem.variant(slidin="small")


@pytest.mark.once
@pytest.mark.parametrize("part", [0.0, 2.0, "half"])
def test_fraction_of_the_error_to_mark_is_checked(part):
    scene = small_blocks()
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    with refused(ValueError, "fraction=.*: expected a number above 0 and up to 1"):
        scene.problem.estimate().mark(part)


@pytest.mark.parametrize("newton", [None, {"max_iterations": 3}, fm.NewtonOptions])
def test_invalid_newton_options_are_refused(newton):
    scene = small_blocks()
    scene.problem.equations.newton = newton
    with refused(ValueError, "newton=.*: expected an instance of NewtonOptions"):
        scene.problem.solve()


@pytest.mark.each
@pytest.mark.parametrize(
    "obstacle, name, value, cure",
    [
        (lambda: fm.Plane((0.0, 1.0), (0.0, 1.0)), "normal", (0.0, -1.0), "another obstacle in a"),
        (lambda: fm.Plane((0.0, 1.0), (0.0, 1.0)), "point", (0.0, 3.0), "another obstacle in a"),
        (lambda: fm.Circle((0.9, -9.0), 10.0), "radius", 0.2, r"use set_shape\('radius', ...\)"),
        (lambda: fm.Circle((0.9, -9.0), 10.0), "centre", (0.9, 0.0), "use set_shape"),
        (
            lambda: fm.Spline([(3.0, 1.0), (0.9, 1.0), (-1.0, 1.0)], name="circle"),
            "points",
            [(3.0, 0.0), (0.9, 0.0), (-1.0, 0.0)],
            r"use set_shape\('points', ...\)",
        ),
    ],
)
def test_dimension_of_an_obstacle_that_is_set_as_an_attribute_is_refused(
    obstacle, name, value, cure
):
    """Such attributes are not read; the solve would be that of the old shape."""
    data, tool = blocks_of_arrays(), obstacle()
    problem = problem_on(data, [fm.ContactPair(data, "slave", tool)])
    setattr(tool, name, value)
    with refused(ValueError, f"{name} of obstacle '.*' was set, which has no effect: .*{cure}"):
        problem.solve()


@pytest.mark.each
@pytest.mark.parametrize(
    "law, name, known",
    [
        (fm.Coulomb(0.3), "friction", "this law has mu, max_shear, c_t, limit_by"),
        (fm.Tresca(0.3), "limit_by", "this law has stress, c_t"),
        (fm.Frictionless(), "mu", "this law has no parameters"),
    ],
)
def test_parameter_that_a_law_does_not_have_is_refused(law, name, known):
    scene = rubbing_blocks(law)
    setattr(law, name, 0.1)
    with refused(ValueError, rf"{name} of {type(law).__name__}\(.*no effect: {known}"):
        scene.problem.solve()


def test_argument_of_a_problem_that_is_set_as_an_attribute_is_refused():
    problem = small_blocks().problem
    problem.newton = fm.NewtonOptions(max_iterations=1)
    with refused(
        ValueError, "newton of the problem was set, .* problem.equations.newton may be set"
    ):
        problem.solve()
