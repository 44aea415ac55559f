# SPDX-License-Identifier: MIT
"""Was the model rich enough? Estimates beside true errors, and what a check leaves behind."""

import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, nodal, pressed_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.adequacy import (
    ENERGY,
    QUANTITIES,
    Snapshot,
    differences,
    largest_strain,
    strained,
)

MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}


def blocks(push, *, strain="linear", sliding="finite", solve=True, **check):
    """Two blocks, solved by a rung of the ladder; a check that knows the finite residual."""
    scene = pressed_blocks(**MESH)
    data, V, bcs = scene.data, scene.u.function_space, scene.problem.bulk.bcs
    u = fem.Function(V)
    laws = {"linear": linear_elastic, "finite": neo_hookean}
    forms = {name: internal(u, law(u, 100.0, 0.3)) for name, law in laws.items()}
    richer = {"finite_strain": forms["finite"]} if strain == "linear" else {}
    problem = fm.ContactProblem(
        forms[strain], u, [fm.ContactPair(data, "upper/bottom", "lower/top", sliding=sliding)],
        bcs=bcs, petsc_options_prefix="test_",
        adequacy=fm.AdequacyCheck(**{"tolerance": 0.02, **richer, **check}),
    )  # fmt: skip
    scene.loads["push"].value[:] = push
    return problem, (problem.solve() if solve else None)


RUNGS = [("linear", "finite"), ("finite", "small"), ("linear", "small")]


@pytest.mark.parametrize("strain, sliding", RUNGS)
@pytest.mark.parametrize("push", [(0.0, -0.02), (0.0, -0.15), (0.1, -0.1)])
def test_estimates_are_within_a_factor_of_the_true_error(push, strain, sliding):
    """One Newton step is right to first order; at strains of 15 % the rest is below a half."""
    problem, report = blocks(push, strain=strain, sliding=sliding)
    full, _ = blocks(push, strain="finite")
    true = differences(problem, Snapshot.of(problem), Snapshot.of(full))
    found = report.adequacy.assumptions[-1].errors
    for name in QUANTITIES:
        if true[name] > 1e-5:  # below, the cheap model is as good as rounding of other kinds
            assert true[name] / 2.0 < found[name] < 2.0 * true[name], (name, true, found)
    assert true[ENERGY] > 1e-5


def test_a_check_leaves_the_state_and_later_steps_as_they_are():
    problem, _ = blocks((0.05, -0.1), sliding="small")
    alone, _ = blocks((0.05, -0.1), sliding="small")
    alone._adequacy = None
    before = problem.state()
    problem._adequacy.assess(problem)
    after = problem.state()
    assert np.array_equal(before.u, after.u) and np.array_equal(before.z[0], after.z[0])
    assert np.array_equal(before.active[0], after.active[0])
    assert problem.contacts[0].operators.linearization.frozen
    one, other = problem.solve(), alone.solve()
    assert other.adequacy is None and one.num_iterations == other.num_iterations
    u, w = nodal(problem), nodal(alone)
    assert np.abs(u - w).max() < 1e-10 * np.abs(u).max()  # MUMPS on ranks rounds as it likes


def test_the_table_says_enough_and_not_enough():
    """One row per assumption and their sum; slip and rotation are what the scene makes."""
    _, report = blocks((0.1, -0.1), sliding="small")
    adequacy = report.adequacy
    names = [assumption.name for assumption in adequacy.assumptions]
    assert names == ["linear strain", "small sliding", "linear strain and small sliding"]
    assert [adequacy.verdict(a) for a in adequacy.assumptions] == ["not enough"] * 3
    assert not adequacy.suffices and "not enough" in str(adequacy) and "facets" in str(adequacy)
    _, report = blocks((0.0, -0.001), sliding="small")
    assert report.adequacy.suffices
    _, report = blocks((0.1, -0.1), sliding="small", discretisation=0.5)
    assert report.adequacy.verdict(report.adequacy.assumptions[1]) == "refine before you model more"


def test_the_full_model_assumes_nothing():
    _, report = blocks((0.0, -0.05), strain="finite")
    assert report.adequacy.assumptions == [] and report.adequacy.suffices


@pytest.mark.parametrize("ratio, verdict", [(None, "unknown"), (0.001, "enough"), (0.5, "not en")])
def test_rigid_obstacles_follow_the_rule_of_stiffness(ratio, verdict):
    scene = pressed_blocks(**MESH)
    u = fem.Function(scene.u.function_space)
    plane = fm.Plane((0.0, 0.99), (0.0, 1.0))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u,
        [fm.ContactPair(scene.data, "upper/bottom", plane)],
        bcs=scene.problem.bulk.bcs, petsc_options_prefix="test_",
        adequacy=fm.AdequacyCheck(stiffness_ratio=ratio),
    )  # fmt: skip
    scene.loads["push"].value[1] = -0.05
    adequacy = problem.solve().adequacy
    (assumption,) = adequacy.assumptions
    assert adequacy.verdict(assumption).startswith(verdict)
    assert adequacy.suffices == (verdict == "enough")


def test_small_sliding_on_an_obstacle_that_has_moved():
    """A richer model is set up where the obstacle is now, and yet counts from where it was."""
    scene = pressed_blocks(**MESH)
    found = {}
    for strain in ("linear", "finite"):
        u = fem.Function(scene.u.function_space)
        laws = {"linear": linear_elastic, "finite": neo_hookean}
        forms = {name: internal(u, law(u, 100.0, 0.3)) for name, law in laws.items()}
        tool = fm.Circle((1.1, -1.0), 2.0)
        pair = fm.ContactPair(scene.data, "upper/bottom", tool, sliding="small")
        check = fm.AdequacyCheck(finite_strain=forms["finite"], stiffness_ratio=0.001)
        problem = fm.ContactProblem(
            forms[strain], u, [pair], bcs=scene.problem.bulk.bcs, petsc_options_prefix="test_",
            adequacy=check if strain == "linear" else None,
        )  # fmt: skip
        tool.move(x=0.3, y=0.05)
        found[strain] = problem, problem.solve().adequacy
    problem, adequacy = found["linear"]
    true = differences(problem, Snapshot.of(problem), Snapshot.of(found["finite"][0]))
    errors = adequacy.assumptions[0].errors
    assert all(0.5 < errors[name] / true[name] < 2.0 for name in QUANTITIES), (errors, true)


def test_strain_and_rotation_of_a_known_state():
    """A turn by 0.1 radian after a stretch by 3 %, in every cell."""
    problem, _ = blocks((0.0, 0.0), strain="finite", solve=False)
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    H = turn @ np.diag([1.03, 1.0]) - np.eye(2)
    problem.bulk.u.interpolate(lambda X: H @ X[:2])
    assert largest_strain(problem) == pytest.approx((0.1, 0.03), rel=1e-10)


def test_rigid_motions_of_the_bodies_are_no_strain():
    """Both are stretched by 2 % and turned by 0.4 radian; what is left is the stretch, turned."""
    problem, _ = blocks((0.0, 0.0), strain="finite", solve=False)
    bulk = problem.bulk
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    bulk.u.interpolate(lambda X: turn @ np.diag([1.02, 1.0]) @ X[:2] - X[:2])
    rest = strained(problem, bulk.u.x.array[: bulk.num_owned])[bulk.space.owned_dofs] @ turn
    X = bulk.V.tabulate_dof_coordinates()[: len(rest), 0]
    assert rest[:, 0] == pytest.approx(0.02 * (X - 1.1), abs=1e-12)  # 1.1: the middle of both
    assert np.abs(rest[:, 1]).max(initial=0.0) < 1e-12


@pytest.mark.parametrize(
    "options, message",
    [
        ({"quantity": "stress"}, "quantity='stress': allowed are energy norm"),
        ({"tolerance": 0.0}, "tolerance=0.0: a positive number"),
        ({"stiffness_ratio": -1.0}, "stiffness_ratio=-1.0: a positive number"),
    ],
)
def test_options_are_checked(options, message):
    with pytest.raises(ValueError, match=message):
        fm.AdequacyCheck(**options)
