# SPDX-License-Identifier: MIT
"""What users hand in and set at any time: refused or told, on all ranks alike.

As in ``test_errors``, where names, surfaces, meshes and options at set-up are; here are functions
of users, attributes that are set later, what differs between ranks, and folded meshes.
"""

import subprocess
import sys
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

import gmsh
import numpy as np
import pytest
from scenes import (
    internal,
    linear_elastic,
    neo_hookean,
    pair_options,
    pressed_blocks,
    read,
    rectangles,
)
from test_errors import (
    blocks_of_arrays,
    grid,
    mesh_of,
    problem_on,
    refused,
    small_blocks,
    tagged,
    triangles,
)

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import NotFiniteError

COMM = MPI.COMM_WORLD
LAST = COMM.rank == COMM.size - 1
several_ranks = pytest.mark.ranks


@contextmanager
def raised_on_the_last_rank(kind, words):
    """Check that the last rank raises ``kind``, and all others an error that says so."""
    with pytest.raises(kind if LAST else fm.MortarError) as caught:
        yield
    expected = words if LAST else f"raised on rank {COMM.size - 1}: {kind.__name__}: .*{words}"
    caught.match(expected)


def bcs_of(data, V, push=-0.02):
    return [fm.dirichlet(V, data, "base", (0.0, 0.0)), fm.dirichlet(V, data, "top", (0.0, push))]


# Distances and obstacles


def on_obstacle(obstacle, slave="slave", **options):
    """The upper of two blocks, pressed on an obstacle at y = 1."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = bcs_of(data, u.function_space)
    return problem_on(data, [fm.ContactPair(data, slave, obstacle)], bcs=bcs, u=u, **options)


class Floor:
    """Distance of y = 1 that a function spoils from some time on."""

    def __init__(self, spoil, at_once=True):
        self.spoil, self.on = spoil, at_once
        self.obstacle = fm.SignedDistance(self, name="floor")

    def __call__(self, x):
        count = len(x)
        fields = x[:, 1] - 1.0, np.tile((0.0, 1.0), (count, 1)), np.zeros((count, 2, 2))
        return self.spoil(x, *fields) if self.on else fields


NOT_FINITE = {
    "phi": lambda x, phi, g, H: (phi * np.nan, g, H),
    "phi somewhere": lambda x, phi, g, H: (np.where(x[:, 0] > 1.0, np.nan, phi), g, H),
    "infinite phi": lambda x, phi, g, H: (phi + np.inf, g, H),
    "gradient": lambda x, phi, g, H: (phi, g * np.nan, H),
    "Hessian": lambda x, phi, g, H: (phi, g, H * np.nan),
    "no gradient": lambda x, phi, g, H: (phi, 0.0 * g, H),
}


@pytest.mark.parametrize("what", NOT_FINITE)
@pytest.mark.parametrize("at_once", [True, False])
def test_distance_that_is_not_finite_is_refused_with_a_place(what, at_once):
    floor = Floor(NOT_FINITE[what], at_once)
    with refused(NotFiniteError, r"distance of 'floor'.* at [24] points, one at \("):
        problem = on_obstacle(floor.obstacle)
        problem.solve()
        floor.on = True
        problem.solve()
    floor.on = False
    assert on_obstacle(floor.obstacle).solve().converged


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda x, phi, g, H: None, "returned NoneType; expected three arrays"),
        (lambda x, phi, g, H: (phi, g), "returned tuple; expected three arrays"),
        (lambda x, phi, g, H: (phi, g, H[0]), r"returned shapes .*; expected"),
        (lambda x, phi, g, H: (phi + 1j, g, H), "expected real numbers"),
        (lambda x, phi, g, H: (phi.astype(str), g, H), "expected real numbers"),
    ],
)
def test_what_is_no_distance_is_refused(spoil, words):
    with refused(ValueError, words):
        on_obstacle(Floor(spoil).obstacle)


@several_ranks
def test_distance_that_is_not_finite_on_one_rank_is_refused_by_all():
    floor = Floor(lambda x, phi, g, H: (phi * (np.nan if LAST else 1.0), g, H), at_once=False)
    problem = on_obstacle(floor.obstacle)
    floor.on = True
    with refused(NotFiniteError, "distance of 'floor'.* is not finite"):
        problem.solve()
    floor.on = False
    assert problem.solve().converged


@several_ranks
def test_distance_that_raises_at_nodes_on_one_rank_raises_on_all():
    def fails(x, *fields):
        if LAST:
            raise ZeroDivisionError("no distance here")
        return fields

    floor = Floor(fails, at_once=False)
    problem = on_obstacle(floor.obstacle)
    floor.on = True
    with raised_on_the_last_rank(ZeroDivisionError, "no distance here"):
        problem.solve()
    floor.on = False
    assert problem.solve().converged


@several_ranks
@pytest.mark.parametrize("after", ["solve", "estimate"])
def test_distance_that_raises_between_the_nodes_on_one_rank_raises_on_all(after, monkeypatch):
    """Certificate and estimate look at points of their own, each rank at those of its share."""

    def fails(x, *fields):
        if LAST:
            raise ZeroDivisionError("no distance here")
        return fields

    floor, sample = Floor(fails, at_once=False), ObstacleOperators.sample_gaps

    def spoilt_sample(self, *arguments):
        floor.on = True
        try:
            return sample(self, *arguments)
        finally:
            floor.on = False

    problem = on_obstacle(floor.obstacle)
    if after == "estimate":
        problem.solve()
    monkeypatch.setattr(ObstacleOperators, "sample_gaps", spoilt_sample)
    with raised_on_the_last_rank(ZeroDivisionError, "no distance here"):
        problem.solve() if after == "solve" else problem.estimate()


@several_ranks
def test_distance_that_differs_on_one_rank_is_refused():
    floor = Floor(lambda x, phi, g, H: (phi + 1e-3 * LAST, g, H), at_once=False)
    problem = on_obstacle(floor.obstacle)
    floor.on = True
    with refused(fm.MortarError, "distance of 'floor' is not the same on all ranks"):
        problem.solve()


def test_distance_that_is_not_finite_far_from_a_start_is_a_failure_that_holds_the_record():
    """What the iterates reach may be cured by a smaller step, unlike what a solve begins with."""
    deep = Floor(lambda x, phi, g, H: (np.where(x[:, 1] < 0.9, np.nan, phi), g, H))
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    # The block is not held against the floor at first: the prescribed push moves it through.
    bcs = bcs_of(data, u.function_space, push=-0.3)
    problem = problem_on(data, [fm.ContactPair(data, "slave", deep.obstacle)], bcs=bcs, u=u)
    problem.equations.contacts[0].change(active=np.zeros_like(problem.equations.contacts[0].active))
    problem.equations.last_converged = True
    with refused(fm.NotConvergedError, "iteration 1: the distance of 'floor'.* is not finite"):
        problem.solve()


@pytest.mark.parametrize(
    "what, value, words",
    [
        ("place", (0.0, np.nan, 0.0), r"place of obstacle 'plane' is \[.*nan.*3 finite numbers"),
        ("place", (np.inf, 0.0, 0.0), "place of obstacle 'plane'.*3 finite numbers"),
        (
            "place",
            (0.0, 0.0),
            r"place of obstacle 'plane' is array\(\[0., 0.\]\): expected 3 finite",
        ),
        ("place", (0.0, 0.0, "a"), "place of obstacle 'plane'.*3 finite"),
        ("load", (np.nan, np.inf, np.nan), "load of obstacle 'plane'.*3 finite numbers, or nan"),
        ("load", (0.0, 0.0), "load of obstacle 'plane'.*3 finite numbers, or nan"),
        ("pivot", (np.nan, 0.0), "pivot of obstacle 'plane'.*2 finite numbers"),
    ],
)
def test_place_push_or_pivot_that_is_none_is_refused(what, value, words):
    obstacle = fm.Plane((0.0, 1.0), (0.0, 1.0))
    problem, kept = on_obstacle(obstacle), getattr(obstacle, what)
    setattr(obstacle, what, np.array(value))
    finite = np.array(value).dtype.kind == "f" and len(value) == len(kept)
    with refused(NotFiniteError if finite else fm.MortarError, words):
        problem.solve()
    setattr(obstacle, what, kept)
    assert problem.solve().converged


@pytest.mark.parametrize(
    "obstacle",
    [
        fm.Plane((0.0, 1.0), (0.0, -1.0)),
        fm.Plane((0.0, 0.5), (0.0, -1.0)),
        fm.Circle((0.9, -10.0), 11.0, inside=True),
        fm.Spline([(-1.0, 1.0), (0.9, 1.0), (3.0, 1.0)], name="spline"),
        Floor(lambda x, phi, g, H: (-phi, -g, H)).obstacle,
    ],
    ids=["plane", "plane far off", "circle", "spline", "distance"],
)
def test_obstacle_whose_solid_is_where_the_body_is_is_refused(obstacle):
    """No facet faces it: a solve used to end without a force."""
    problem = on_obstacle(obstacle)
    with refused(fm.MortarError, "lies inside obstacle .*: the solid is on the side of the body"):
        problem.solve()


def test_obstacle_that_goes_deep_but_faces_the_body_is_an_interference():
    assert on_obstacle(fm.Plane((0.0, 1.02), (0.0, 1.0))).solve().converged


@pytest.mark.parametrize(
    "points, words",
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], r"intersects itself: edges from \(0, 0\) to \(1, 1\)"),
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "intersects itself"),
        ([(0, 0), (1, 0), (1, 1), (0, 0)], "intersects itself"),
        ([(0, 0), (1, 0), (2, 0)], "two edges of the polygon overlap"),
        ([(0, 0), (2, 0), (2, 2), (1, 0.01), (0, 2)], "less its rounding=0.02 intersects itself"),
        ("abc", "points='abc': expected real numbers"),
    ],
)
def test_polygon_that_meets_itself_is_refused(points, words):
    with pytest.raises(ValueError, match=words):
        fm.Polygon(points, 0.02)


@pytest.mark.parametrize("closed", [True, False])
def test_spline_that_meets_itself_is_refused(closed):
    with pytest.raises(ValueError, match="the spline intersects itself"):
        fm.Spline([(0, 0), (2, 1), (2, 0), (0, 1)], closed=closed)


def test_polygons_and_splines_that_do_not_meet_themselves_are_taken():
    fm.Polygon([(0, 0), (3, 0), (3, 1), (2, 1), (2, 0.5), (1, 0.5), (1, 1), (0, 1)], 0.1)
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    fm.Spline(np.stack([np.cos(angles), np.sin(angles)], axis=1), closed=True)
    x = np.linspace(0.0, 1.0, 9)
    fm.Spline(np.stack([x, 0.1 * np.sin(9.0 * x)], axis=1))


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: fm.Circle((0, 0), "1"), "radius='1': expected a positive length"),
        (lambda: fm.Circle((0, 0), 1.0, inside="no"), "inside='no': expected True or False"),
        (lambda: fm.Circle("ab", 1.0), "centre='ab': expected real numbers"),
        (lambda: fm.Plane((0, 0), (0, 1j)), "normal=.*: expected real numbers"),
        (lambda: fm.Plane((0, 0), (0, 1), name=None), "name=None: expected a text"),
        (lambda: fm.Plane((0, 0), (0, 1)).move(y="up"), "y='up': expected a finite number"),
        (lambda: fm.Plane((0, 0), (0, 1)).push(moment=1j), "moment=1j: expected a finite number"),
        (
            lambda: fm.Polygon([(0, 0), (1, 0), (1, 1)], None),
            "rounding=None: expected a positive length",
        ),
        (lambda: fm.SignedDistance(3.0), "function=3.0: expected a function of points"),
    ],
)
def test_what_is_no_obstacle_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()


# Laws


class Spoilt(fm.Coulomb):
    """Coulomb's law with adhesion, an answer of which is spoilt from some time on."""

    def __init__(self, method, spoil):
        super().__init__(0.3)
        self.method, self._spoil, self._on = method, spoil, True

    def _answer(self, method, answer):
        return self._spoil(answer) if self._on and method == self.method else answer

    def branch(self, node, before):
        return self._answer("branch", super().branch(node, before))

    def tangential(self, node, branch):
        return self._answer("tangential", super().tangential(node, branch))

    def friction_limit(self, pressure):
        return self._answer("friction_limit", super().friction_limit(pressure))

    def adhesion(self, gap):
        pull = 0.1 * np.exp(-gap / 0.1)
        return self._answer("adhesion", (pull, -pull / 0.1))


def rubbing_blocks(law):
    scene = small_blocks(pair={"law": law})
    scene.loads["push"].value[:] = 0.005, -0.02
    return scene


def spoil_row(name):
    return lambda row: row._replace(**{name: np.nan * np.asarray(getattr(row, name))})


WRONG_ANSWERS = [
    ("branch", lambda p: p * np.nan, NotFiniteError, "branch returned numbers .* not finite at 5"),
    ("branch", lambda p: p[:2], ValueError, r"branch returned an array of shape \(2,\)"),
    ("branch", lambda p: None, ValueError, "branch returned an array of .* type object"),
    ("branch", lambda p: p + 0.5, ValueError, "branch returned .*; expected integers"),
    ("tangential", spoil_row("residual"), NotFiniteError, r"not finite at 5 nodes .* one at \("),
    ("tangential", spoil_row("by_slip"), NotFiniteError, "tangential returned numbers"),
    ("tangential", lambda row: None, ValueError, "tangential returned None; expected a Row"),
    ("tangential", lambda row: row._replace(residual=row[0][:2]), ValueError, r"shape \(2,\)"),
    (
        "friction_limit",
        lambda b: b * np.nan,
        NotFiniteError,
        "friction_limit returned nan for a pressure of",
    ),
    (
        "friction_limit",
        lambda b: b - 1.0,
        NotFiniteError,
        "friction_limit returned -0.* for a pressure of",
    ),
    (
        "friction_limit",
        lambda b: b[:2],
        ValueError,
        r"friction_limit returned an array of shape \(2,\)",
    ),
    ("adhesion", lambda a: (a[0] * np.nan, a[1]), NotFiniteError, "adhesion returned numbers"),
    ("adhesion", lambda a: (-a[0], a[1]), ValueError, "adhesion returned -0.1 .* positive stress"),
    ("adhesion", lambda a: a[0], ValueError, "adhesion returned array.* expected two arrays"),
    ("adhesion", lambda a: (a[0][:1], a[1][:1]), ValueError, r"array of shape \(1,\)"),
]


@pytest.mark.parametrize("method, spoil, kind, words", WRONG_ANSWERS)
def test_answer_of_a_law_that_is_none_is_refused(method, spoil, kind, words):
    law = Spoilt(method, spoil)
    law._on = False
    scene = rubbing_blocks(law)
    scene.problem.solve()
    law._on = True
    scene.loads["push"].value[0] = 0.01
    with refused(kind, r"Coulomb\(0.3\): ", words):
        scene.problem.solve()
    law._on = False
    assert scene.problem.solve().converged
    law._on = True
    with refused(kind, words):
        rubbing_blocks(law).problem.solve()


@several_ranks
@pytest.mark.parametrize("method", ["branch", "tangential", "friction_limit", "adhesion"])
@pytest.mark.parametrize("hierarchy", [False, True])
def test_law_that_raises_on_one_rank_raises_on_all(method, hierarchy):
    def fail(answer):
        if LAST:
            raise ZeroDivisionError("no law here")
        return answer

    law = Spoilt(method, fail)
    law._on = False
    adequacy = fm.AdequacyCheck(hierarchy=True) if hierarchy else None
    scene = small_blocks(pair={"law": law}, problem={"adequacy": adequacy})
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    law._on = True
    scene.loads["push"].value[0] = 0.01
    with raised_on_the_last_rank(ZeroDivisionError, "no law here"):
        scene.problem.solve()
    law._on = False
    assert scene.problem.solve().converged


@several_ranks
def test_law_with_other_answers_on_one_rank_is_refused():
    law = Spoilt("tangential", lambda row: row._replace(residual=row[0] * (2.0 if LAST else 1.0)))
    with refused(fm.MortarError, "equations of contact are not the same on all ranks"):
        rubbing_blocks(law).problem.solve()


@pytest.mark.parametrize(
    "law, name, value, words",
    [
        (fm.Coulomb(0.3), "mu", -0.5, "mu=-0.5: expected zero or a positive number"),
        (fm.Coulomb(0.3), "mu", np.nan, "mu=nan: expected zero or a positive number"),
        (fm.Coulomb(0.3), "mu", "0.3", "mu='0.3': expected zero or a positive number"),
        (fm.Coulomb(0.3), "mu", None, "mu=None"),
        (fm.Coulomb(0.3), "max_shear", -1.0, "max_shear=-1.0: expected a positive stress"),
        (fm.Coulomb(0.3), "c_t", 0.0, "c_t=0.0: expected a positive number"),
        (fm.Coulomb(0.3), "c_t", np.nan, "c_t=nan: expected a positive number"),
        (fm.Coulomb(0.3), "limit_by", "gap", "limit_by='gap': expected one of trial, pressure"),
        (fm.Tresca(1.0), "stress", -1.0, "stress=-1.0: expected zero or a positive number"),
        (fm.Tresca(1.0), "stress", np.inf, "stress=inf: expected zero or a positive number"),
    ],
)
def test_parameter_of_a_law_that_was_set_later_is_refused(law, name, value, words):
    scene, kept = rubbing_blocks(law), getattr(law, name)
    setattr(law, name, value)
    with refused(ValueError, words):
        scene.problem.solve()
    setattr(law, name, kept)
    assert scene.problem.solve().converged


def test_law_of_a_user_refuses_its_own_parameters():
    class Rough(fm.Coulomb):
        def check(self):
            super().check()
            if self.mu > 1.0:
                raise ValueError(f"mu={self.mu}: too rough")

    scene = rubbing_blocks(Rough(0.3))
    scene.contact.pair.law.mu = 2.0
    with refused(ValueError, "mu=2.0: too rough"):
        scene.problem.solve()


@pytest.mark.parametrize("law", [None, 0.3, fm.Coulomb])
def test_what_was_set_for_a_law_and_is_none_is_refused(law):
    scene = rubbing_blocks(fm.Coulomb(0.3))
    scene.contact.pair.law = law
    with refused(ValueError, "law of ContactPair.*: expected an instance of Frictionless, Coulomb"):
        scene.problem.solve()


@several_ranks
def test_law_whose_parameter_differs_on_one_rank_is_refused():
    scene = rubbing_blocks(fm.Coulomb(0.3))
    scene.contact.pair.law.mu = 0.1 if LAST else 0.3
    with refused(fm.MortarError, r"law of pair 0 is Coulomb\(.*mu=0.3.* on rank 0 and .*mu=0.1"):
        scene.problem.solve()


def test_law_cannot_write_into_the_state():
    class Careless(fm.Coulomb):
        def tangential(self, node, branch):
            node.z_tau[:] = 0.0
            return super().tangential(node, branch)

    with refused(ValueError, "read-only"):
        rubbing_blocks(Careless(0.3)).problem.solve()


def test_distance_may_use_its_arrays_again():
    store = np.zeros(1000)

    def again(x, phi, g, H):
        store[: len(x)] = phi
        return store[: len(x)], g, H

    usual, reused = (on_obstacle(Floor(f).obstacle) for f in (lambda x, *fields: fields, again))
    for problem in (usual, reused):
        assert problem.solve().certificate.violations() == []
    z = [problem.equations.contacts[0].z for problem in (usual, reused)]
    assert np.abs(z[0] - z[1]).max() < 1e-12 * np.abs(z[0]).max()


# Attributes that are set later


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
    """It would have no effect, or half of one."""
    scene = rubbing_blocks(fm.Coulomb(0.3))
    setattr(scene.contact.pair, name, value)
    with refused(fm.MortarError, f"{name} of ContactPair.* was set after .* new problem"):
        scene.problem.solve()


@pytest.mark.parametrize(
    "name, value, words",
    [
        ("discretization", fm.Discretization(c_n=-1.0), "c_n=-1.0"),
        ("discretization", fm.Discretization(basis="cubic"), "basis='cubic'"),
        ("discretization", "other_codes", "discretization='other_codes': expected an instance of"),
        ("law", None, "law=None"),
    ],
)
def test_option_of_a_pair_that_is_set_before_the_problem_is_checked(name, value, words):
    data = blocks_of_arrays()
    pair = fm.ContactPair(data, "slave", "master")
    setattr(pair, name, value)
    with refused(ValueError, words):
        problem_on(data, [pair])


@pytest.mark.parametrize("value", [-1.0, np.nan, 0.0, "1"])
def test_weight_of_the_gap_that_is_set_later_is_checked(value):
    scene = small_blocks()
    scene.contact.c_n = value
    with refused(ValueError, "contact.c_n=.*: expected a positive number"):
        scene.problem.solve()


@pytest.mark.parametrize("name, shape", [("z", (2, 2)), ("active", (2,)), ("branch", (7,))])
def test_state_of_a_contact_of_another_shape_is_refused(name, shape):
    scene = small_blocks()
    scene.contact.change(**{name: np.zeros(shape)})
    with refused(fm.MortarError, f"{name} of ContactPair.* has shape"):
        scene.problem.solve()


@pytest.mark.parametrize("value", [[[0.0, 0.0]] * 5, np.zeros((5, 2), complex)])
def test_multipliers_of_another_kind_are_refused(value):
    scene = small_blocks()
    scene.contact.change(z=value)
    with pytest.raises((ValueError, fm.MortarError), match="z of ContactPair"):
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
    with refused_words(ValueError, "slidin='small': expected one of .*sliding"):
        small_blocks().problem.variant(slidin="small")


@pytest.mark.parametrize("part", [0.0, 2.0, "half"])
def test_part_of_the_error_to_mark_is_checked(part):
    scene = small_blocks()
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    with refused(ValueError, "fraction=.*: expected a number above 0 and up to 1"):
        scene.problem.estimate().mark(part)


@pytest.mark.parametrize("newton", [None, {"max_iterations": 3}, fm.NewtonOptions])
def test_what_was_set_for_options_of_newton_and_is_none_is_refused(newton):
    scene = small_blocks()
    scene.problem.newton = newton
    with refused(ValueError, "newton=.*: expected an instance of NewtonOptions"):
        scene.problem.solve()


# What differs between ranks


def either(one, other):
    """The second on the last of several ranks."""
    return other if LAST and COMM.size > 1 else one


@several_ranks
@pytest.mark.parametrize(
    "name, one, other",
    [
        ("sliding", "finite", "small"),
        ("discretization", fm.Discretization(), fm.Discretization(basis="standard")),
        ("discretization", "default", "other_codes"),
        ("discretization", fm.Discretization(points=5), fm.Discretization(points=7)),
        ("initial_gap", None, 0.0),
        ("search_radius", 1.0, 0.01),
        ("law", fm.Coulomb(0.3), fm.Coulomb(0.2)),
        ("law", fm.Coulomb(0.3), None),
    ],
)
def test_option_of_a_pair_that_differs_on_one_rank_is_refused(name, one, other):
    data = blocks_of_arrays()
    with refused(fm.MortarError, f"ContactPair: {name} is .* on rank 0 and .* on rank"):
        fm.ContactPair(data, "slave", "master", **{name: either(one, other)})


@several_ranks
def test_option_that_one_rank_refuses_is_refused_by_all():
    data = blocks_of_arrays()
    with raised_on_the_last_rank(ValueError, "basis='cubic': expected one of"):
        fm.ContactPair(data, "slave", "master", **pair_options(basis=either("dual", "cubic")))
    with raised_on_the_last_rank(ValueError, "gap='open': expected one of"):
        fm.TiedPair(data, "slave", "master", gap=either("kept", "open"))
    with raised_on_the_last_rank(ValueError, "algorithm='dense': expected one of"):
        problem_on(data, algorithm=either("saddle", "dense"))
    with refused(fm.MeshError, "no boundary 'sleeve'"):
        fm.ContactPair(data, either("slave", "sleeve"), "master")
    V = fm.vector_space(data.mesh, 1)
    with refused(fm.MeshError, "no boundary 'bass'"):
        fm.dirichlet(V, data, either("base", "bass"), (0.0, 0.0))
    with refused(fm.MortarError, "boundary is"):
        fm.dirichlet(V, data, either("base", "top"), (0.0, 0.0))


@several_ranks
def test_sides_that_differ_on_one_rank_are_refused():
    data = blocks_of_arrays()
    with refused(fm.MortarError, "ContactPair: slave_name is 'slave' on rank 0 and 'top'"):
        fm.ContactPair(data, either("slave", "top"), "master")


@several_ranks
@pytest.mark.parametrize(
    "name, one, other",
    [
        ("algorithm", "condensed", "saddle"),
        ("solver", "direct", "iterative"),
        ("linearization", "full", "frozen"),
        ("newton", fm.NewtonOptions(), fm.NewtonOptions(max_iterations=1)),
        ("petsc_options_prefix", "a_", "b_"),
        ("petsc_options", {}, {"ksp_type": "gmres"}),
        ("linear_bulk", None, True),
    ],
)
def test_option_of_a_problem_that_differs_on_one_rank_is_refused(name, one, other):
    data = blocks_of_arrays()
    with refused(fm.MortarError, f"ContactProblem: {name} is .* on rank 0 and .* on rank"):
        problem_on(data, **{name: either(one, other)})


@several_ranks
def test_pairs_conditions_and_forms_that_differ_on_one_rank_are_refused():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    pairs, bcs = [fm.ContactPair(data, "slave", "master")], bcs_of(data, u.function_space)
    with refused(fm.MortarError, "pairs is 1 on rank 0 and 0 on rank"):
        problem_on(data, either(pairs, []), u=u, bcs=bcs)
    with refused(fm.MortarError, "bcs is 2 on rank 0 and 1 on rank"):
        problem_on(data, pairs, u=u, bcs=either(bcs, bcs[:1]))

    def material(u, E, nu):
        return neo_hookean(u, either(E, 2.0 * E), nu)

    with refused(fm.MortarError, "residual is .*a form with the signature"):
        problem_on(data, pairs, u=u, bcs=bcs, material=material)


@several_ranks
@pytest.mark.parametrize("what", ["newton", "c_n"])
def test_option_that_is_set_later_and_differs_on_one_rank_is_refused(what):
    scene = small_blocks()
    if what == "newton":
        scene.problem.newton = fm.NewtonOptions(max_iterations=either(30, 1))
    else:
        scene.contact.c_n = either(1e-3, 1e-2)
    with refused(fm.MortarError, f"{what}.* is .* on rank 0 and .* on rank"):
        scene.problem.solve()


@several_ranks
def test_steps_that_differ_on_one_rank_are_refused():
    scene = small_blocks()
    options = fm.SteppingOptions(either(0.5, 0.25))
    with refused(fm.MortarError, "follow_path: options is .*step=0.5.* and .*step=0.25"):
        fm.follow_path(scene.problem, lambda t: None, options)
    with refused(fm.MortarError, "follow_path: stop is 1.0 on rank 0 and 2.0 on rank"):
        fm.follow_path(
            scene.problem, lambda t: None, fm.SteppingOptions(0.5), stop=either(1.0, 2.0)
        )


# Meshes that cover a place twice


def folded(kind):
    """Cells, nodes and kind of cells of a mesh that covers a place twice, or does not."""
    cells, x = grid(8, 4)
    cell = "quadrilateral"
    if kind == "a second copy":
        more, again = grid(8, 4, first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, again])
    elif kind == "an inclusion without a hole":
        more, inner = grid(2, 2, (0.4, 0.4), (0.2, 0.2), first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, inner])
    elif kind == "a turned cell":
        cells[5] = cells[5][[0, 1, 3, 2]]
    elif kind == "a node too far":
        x[22] = 0.9, 0.6
    elif kind == "a node too far, triangles":
        x[22] = 0.9, 0.6
        cells, cell = triangles(cells), "triangle"
    elif kind == "folded back":
        right = x[:, 0] > 0.5
        x[right, 0] = 1.0 - x[right, 0]
    elif kind in ("wound", "wound up"):
        cells, x = grid(60, 2)
        angle, grows = np.radians(400.0) * x[:, 0], 0.3 if kind == "wound up" else 0.1
        radius = 1.0 + 0.2 * x[:, 1] + grows * x[:, 0]
        x = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    elif kind == "in an arc":
        x = np.stack(
            [(2.0 + x[:, 1]) * np.cos(6 * x[:, 0]), (2 + x[:, 1]) * np.sin(6 * x[:, 0])], 1
        )
    elif kind == "side by side":
        more, again = grid(8, 4, (1.0, 0.0), first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, again])
    elif kind == "overlapping in part":
        more, again = grid(8, 4, (0.9, 0.03), first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, again])
    elif kind == "turned cells":
        cells[::2] = cells[::2][:, [1, 0, 3, 2]]
    return cells, x, cell


def problem_on_folded(kind):
    cells, x, cell = folded(kind)
    data = tagged(mesh_of(cells, x, cell), base=lambda X: X[1] < 1e-9)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))]
    return problem_on(data, [], material=linear_elastic, u=u, bcs=bcs)


@pytest.mark.parametrize(
    "kind, words",
    [
        ("a second copy", "fills a place twice"),
        ("an inclusion without a hole", r"body around \(0.5, 0.5\) lies inside the one around"),
        ("a turned cell", r"1 cells are twisted, one at \(0.6875, 0.125\)"),
        ("a node too far", "cells are twisted"),
        ("a node too far, triangles", "facets have the cells of both sides on the same side"),
        ("folded back", "facets have the cells of both sides on the same side"),
        ("wound", "a body overlaps itself: its outline crosses itself at"),
    ],
)
def test_mesh_that_covers_a_place_twice_is_refused(kind, words):
    with refused(fm.MeshError, words):
        problem_on_folded(kind)


@pytest.mark.parametrize(
    "kind", ["wound up", "in an arc", "side by side", "overlapping in part", "turned cells"]
)
def test_mesh_that_covers_places_once_is_taken(kind):
    problem_on_folded(kind)


def test_shaft_that_is_too_large_for_its_hole_is_an_interference():
    """All of its outline lies in the other body, but that has a hole there."""
    inner, x = grid(3, 3, (-0.51, -0.51), (1.02, 1.02))
    frame, y = grid(6, 6, (-1.5, -1.5), (3.0, 3.0), first=len(x))
    middle = np.abs(np.concatenate([x, y])[frame].mean(axis=1)).max(axis=1) < 0.5
    cells = np.concatenate([inner, frame[~middle]])
    used, numbers = np.unique(cells, return_inverse=True)
    x = np.concatenate([x, y])[used]
    data = tagged(mesh_of(numbers.reshape(cells.shape), x), base=lambda X: X[1] < -1.4)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    problem_on(data, [], material=linear_elastic, u=u)


def test_elements_that_are_there_twice_are_refused():
    def twice():
        model = rectangles(0.5, body=(0.0, 0.0, 1.0, 1.0))
        _, _, (nodes,) = model.mesh.getElements(2)
        top = int(model.mesh.getElements(2)[1][0].max()) + 1
        model.mesh.addElementsByType(model.getEntities(2)[0][1], 2, [top], nodes[[1, 2, 0]])
        return model

    with refused(fm.MeshError, r"1 elements are duplicates, one at \("):
        read(twice)
    if COMM.rank == 0:
        gmsh.finalize()


def test_all_stiffnesses_negative_is_told():
    def minus(u, E, nu):
        return -neo_hookean(u, E, nu)

    with refused(fm.MortarError, "all stiffnesses are negative: check the signs"):
        problem_on(blocks_of_arrays(), material=minus)


# Forms


def problem_with(space=None, jacobian=None):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    v = ufl.TestFunction(space(data.mesh) if space else u.function_space)
    stress, dx = neo_hookean(u, 100.0, 0.3), ufl.dx(metadata={"quadrature_degree": 4})
    residual = (ufl.inner(stress, ufl.grad(v)) if v.ufl_shape else v * ufl.tr(stress)) * dx
    given = {"jacobian": jacobian(u)} if jacobian else {}
    pair = fm.ContactPair(data, "slave", "master")
    return fm.ContactProblem(
        residual, u, [pair], bcs=bcs_of(data, u.function_space), petsc_options_prefix="f_", **given
    )


@pytest.mark.parametrize(
    "space",
    [lambda mesh: compat.scalar_space(mesh, 1), lambda mesh: fm.vector_space(mesh, 2)],
    ids=["scalar", "degree 2"],
)
def test_test_function_of_another_space_is_refused(space):
    with refused(ValueError, "test function of the residual belongs to another space than u"):
        problem_with(space)


def test_test_function_of_an_equal_space_is_taken():
    assert problem_with(lambda mesh: fm.vector_space(mesh, 1)).solve().converged


def stiffness_on(space):
    def form(u):
        V = space(u.function_space.mesh)
        trial, test = ufl.TrialFunction(V), ufl.TestFunction(V)
        return 100.0 * ufl.inner(ufl.grad(trial), ufl.grad(test)) * ufl.dx

    return form


@pytest.mark.parametrize(
    "jacobian, words",
    [
        (
            stiffness_on(lambda mesh: fm.vector_space(mesh, 2)),
            "function of the jacobian belongs to an",
        ),
        (
            stiffness_on(lambda mesh: compat.scalar_space(mesh, 1)),
            "of the jacobian belongs to another",
        ),
        (
            lambda u: ufl.inner(u, ufl.TestFunction(u.function_space)) * ufl.dx,
            "jacobian needs one test and one trial function",
        ),
        (lambda u: ufl.inner(u, u) * ufl.dx, "jacobian needs one test and one trial"),
    ],
)
def test_jacobian_on_another_space_is_refused(jacobian, words):
    with refused(ValueError, words):
        problem_with(jacobian=jacobian)


def test_residual_without_the_unknown_is_refused():
    data = blocks_of_arrays()
    u, other = (fem.Function(fm.vector_space(data.mesh, 1)) for _ in range(2))
    residual = internal(other, neo_hookean(other, 100.0, 0.3))
    with refused(ValueError, "the residual does not depend on u"):
        fm.ContactProblem(residual, u, [], petsc_options_prefix="f_")


# Paths


@pytest.mark.parametrize(
    "options, more, words",
    [
        (
            0.1,
            {},
            r"options=0.1: expected an instance of SteppingOptions, as SteppingOptions\(step=0.1\)",
        ),
        ({"step": 0.1}, {}, "options=.*: expected an instance of SteppingOptions"),
        (None, {"start": 1.0, "stop": 0.0}, "start=1.0 is beyond stop=0.0: times increase"),
        (None, {"stop": np.nan}, "stop=nan: expected a finite number"),
        (None, {"stop": np.inf}, "stop=inf: expected a finite number"),
        (None, {"start": "0"}, "start='0': expected a finite number"),
        (None, {"on_step": 1}, "on_step=1: expected a function"),
        (None, {"set_loads": 0.1}, "set_loads=0.1: expected a function of the time"),
        (None, {"problem": None}, "problem=None: expected a ContactProblem"),
    ],
)
def test_path_that_cannot_be_followed_is_refused(options, more, words):
    given = {
        "problem": small_blocks().problem,
        "set_loads": lambda time: None,
        "options": options or fm.SteppingOptions(0.5),
        **more,
    }
    with refused(ValueError, words):
        fm.follow_path(**given)


def test_path_from_its_end_on_has_no_steps():
    scene = small_blocks()
    options = fm.SteppingOptions(0.5)
    path = fm.follow_path(scene.problem, lambda time: None, options, start=1.0, stop=1.0)
    assert path.finished and not path.steps


# Pairs and conditions


@pytest.mark.parametrize("kinds", [(fm.ContactPair, fm.ContactPair), (fm.ContactPair, fm.TiedPair)])
def test_the_same_two_sides_paired_both_ways_are_refused(kinds):
    data = blocks_of_arrays()
    sides = ("slave", "master"), ("master", "slave")
    pairs = [kind(data, *names) for kind, names in zip(kinds, sides, strict=True)]
    tied = fm.TiedPair in kinds
    words = "cannot be tied" if tied else "same two sides with exchanged roles"
    with refused(fm.SurfaceError if tied else fm.MortarError, words):
        problem_on(data, pairs)


@pytest.mark.parametrize("move", [0.1, 1e4, 0.0])
@pytest.mark.parametrize("material", [neo_hookean, linear_elastic])
def test_rigid_motion_without_pairs_is_sound(move, material):
    """Forces are rounding then, and so is their sum."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    names = ("base", "master", "slave", "top")
    bcs = [fm.dirichlet(u.function_space, data, name, (move, 0.0)) for name in names]
    report = problem_on(data, [], u=u, bcs=bcs, material=material).solve()
    assert report.certificate.violations() == []


def test_sum_of_forces_without_pairs_is_still_looked_at():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    names = ("base", "master", "slave", "top")
    bcs = [fm.dirichlet(u.function_space, data, name, (0.1, 0.0)) for name in names]
    problem = problem_on(data, [], u=u, bcs=bcs)
    problem.solve()
    u.x.array[: 6 if COMM.rank == 0 else 0] += 0.05
    u.x.scatter_forward()
    problem.equations.evaluate(start=False)
    assert any("balance" in words for words in problem.certificate().violations())


@pytest.mark.parametrize("value, component", [((0.1, 0.0), None), (0.1, 0)])
def test_conditions_that_contradict_each_other_are_told_once(value, component):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V = u.function_space
    bcs = [*bcs_of(data, V), fm.dirichlet(V, data, "base", value, component)]
    problem = problem_on(data, u=u, bcs=bcs)
    words = "conditions 0 and 2 prescribe different values of the same component at 5 nodes"
    (told,) = (note for note in problem.solve().notes if words in note)
    assert "the later one, is used" in told
    assert not any(words in note for note in problem.solve().notes)


def test_conditions_that_agree_are_not_told_of():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V = u.function_space
    bcs = [*bcs_of(data, V), fm.dirichlet(V, data, "base", 0.0, 0)]
    assert not any("conditions" in note for note in problem_on(data, u=u, bcs=bcs).solve().notes)


@pytest.mark.parametrize(
    "boundary, value, component, words",
    [
        ("base", "zero", None, "prescribed value is 'zero'; expected numbers"),
        ("base", (1j, 0.0), None, "prescribed value is .*; expected numbers"),
        ("base", lambda x: x, None, "prescribed value is .*; expected numbers"),
        ("base", 0.0, [0, 1], r"component is \[0, 1\]; expected 0, 1 or None"),
        (None, (0.0, 0.0), None, "no boundary None"),
        (1.5, (0.0, 0.0), None, "no boundary 1.5"),
        (True, (0.0, 0.0), None, "no boundary True"),
    ],
)
def test_what_is_no_condition_is_refused(boundary, value, component, words):
    data = blocks_of_arrays()
    with refused_words(fm.MeshError, words):
        fm.dirichlet(fm.vector_space(data.mesh, 1), data, boundary, value, component)


@contextmanager
def refused_words(kind, words):
    """As ``refused``, of a message that shows an object, whose address differs."""
    with pytest.raises(kind, match=words):
        yield
    COMM.barrier()


@pytest.mark.parametrize(
    "call, words",
    [
        (
            lambda d, V: fm.dirichlet(V, None, "base", (0.0, 0.0)),
            "data=None: expected the MeshData",
        ),
        (
            lambda d, V: fm.dirichlet(None, d, "base", (0.0, 0.0)),
            "V=None: expected a space of dolfinx",
        ),
        (lambda d, V: fm.vector_space(d.mesh, 0), "degree=0: expected a whole number, at least 1"),
        (lambda d, V: fm.vector_space(d, 1), "mesh=.*: expected a mesh of dolfinx"),
        (
            lambda d, V: fm.MeshData(d.mesh, None, d.facet_tags, {}, ["a"]),
            "boundaries=.*dictionary",
        ),
        (
            lambda d, V: fm.MeshData(d.mesh, None, d.facet_tags, {}, {"a": 1.5}),
            r"\['a'\]=1.5: expected an in",
        ),
        (lambda d, V: fm.read_gmsh("x.msh", None), "comm=None: expected a communicator"),
        (lambda d, V: fm.read_gmsh("x.msh", COMM, rank=0.5), "rank=0.5: expected an integer"),
        (lambda d, V: fm.contact_table(None), "problem=None: expected a ContactProblem"),
        (lambda d, V: fm.ResultsWriter("a", None), "problem=None: expected a ContactProblem"),
        (lambda d, V: fm.plot(None, "a"), "problem=None: expected a ContactProblem"),
    ],
)
def test_argument_of_a_wrong_kind_is_refused_in_words(call, words):
    data = blocks_of_arrays()
    with refused_words(ValueError, words):
        call(data, fm.vector_space(data.mesh, 1))


@pytest.mark.parametrize(
    "options, words",
    [
        ({"petsc_options": {3: 1}}, "petsc_options with 3: expected a name such as 'ksp_rtol'"),
        ({"petsc_options": {"-ksp_rtol": 1}}, "petsc_options with '-ksp_rtol': expected a name"),
        ({"displacement": "u"}, "displacement='u': expected the number of a sub-space"),
        ({"displacement": 3}, "displacement=3: the function u is not mixed"),
        ({"adequacy": fm.AdequacyCheck}, "adequacy=.*: expected an instance of AdequacyCheck"),
    ],
)
def test_option_of_a_problem_of_a_wrong_kind_is_refused(options, words):
    with refused(ValueError, words):
        problem_on(blocks_of_arrays(), **options)


# Results and tools


def test_results_of_a_wrong_kind_are_refused(shared_path):
    problem = small_blocks().problem
    with refused(ValueError, "path=None: expected the name of a file"):
        fm.ResultsWriter(None, problem)
    with refused(ValueError, "fields=3: expected a dictionary of UFL expressions"):
        fm.ResultsWriter(shared_path / "a", problem, 3)
    other = fem.Function(fm.vector_space(blocks_of_arrays().mesh, 1))
    with refused(fm.MortarError, "field 'a' cannot be .* function or constant of another mesh"):
        fm.ResultsWriter(shared_path / "a", problem, {"a": other[0]})
    writer = fm.ResultsWriter(shared_path / "a", problem)
    for time in (np.nan, "1", None):
        with refused(ValueError, "time=.*: expected a finite number"):
            writer.write(time)


@several_ranks
def test_fields_that_differ_on_one_rank_are_refused(shared_path):
    scene = small_blocks()
    with refused(fm.MortarError, "number of fields is 0 on rank 0 and 1 on rank"):
        fm.ResultsWriter(shared_path / "a", scene.problem, either({}, {"a": scene.u[0]}))


def tool_of(**more):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V = u.function_space
    given = {
        "obstacle": fm.Plane((0, 1), (0, 1)),
        "residual": internal(u, linear_elastic(u, 100.0, 0.3)),
        "u": u,
        "data": data,
        "surface": "master",
        "bcs": bcs_of(data, V),
        **{name: value(data, u) for name, value in more.items()},
    }
    return fm.ElasticObstacle(**given)


@pytest.mark.parametrize(
    "more, kind, words",
    [
        ({"obstacle": lambda d, u: None}, ValueError, "obstacle=None: expected a rigid obstacle"),
        ({"u": lambda d, u: None}, ValueError, "u=None: expected a function of dolfinx"),
        ({"data": lambda d, u: blocks_of_arrays()}, fm.MeshError, "another mesh than u"),
        ({"residual": lambda d, u: ufl.inner(u, u) * ufl.dx}, ValueError, "one test function"),
        (
            {
                "residual": lambda d, u: (
                    u[0] * ufl.TestFunction(compat.scalar_space(d.mesh, 1)) * ufl.dx
                )
            },
            ValueError,
            "test function of the residual belongs to another space",
        ),
        (
            {"bcs": lambda d, u: bcs_of(d, u.function_space)[0]},
            ValueError,
            "bcs=.*: expected a list of D",
        ),
    ],
)
def test_tool_of_a_wrong_kind_is_refused(more, kind, words):
    with refused_words(kind, words):
        tool_of(**more)


# States that violate their certificate


def test_solve_to_a_wrong_state_raises_unless_told_not_to():
    """The law's bound, unlike its tangential row, is too small: shears are outside of it."""
    law = Spoilt("friction_limit", lambda bound: 0.5 * bound)
    law._on = False
    scene = rubbing_blocks(law)
    scene.problem.solve()
    start, accepted = scene.problem.state(), scene.contact.accepted
    law._on = True
    scene.loads["push"].value[0] = 0.01
    parts = "wrong state: .*shear .*allowed", r"solve\(accept_violations=True\) returns it"
    with refused(fm.NotConvergedError, *parts):
        scene.problem.solve()
    assert scene.contact.accepted is accepted
    scene.problem.restore(start)
    report = scene.problem.solve(accept_violations=True)
    assert report.converged and report.certificate.violations()
    assert scene.contact.accepted is not accepted
    law._on = False
    scene.problem.restore(start)
    assert scene.problem.solve().certificate.violations() == []


def test_wrong_state_is_in_the_record_that_the_error_holds():
    law = Spoilt("friction_limit", lambda bound: 0.5 * bound)
    with pytest.raises(fm.NotConvergedError) as caught:
        rubbing_blocks(law).problem.solve()
    report = caught.value.report
    assert not report.converged and report.certificate.violations()
    assert report.reason in report.table()
    assert any(note.startswith("VIOLATED") for note in report.notes)
    assert "follow_path" not in str(caught.value)  # smaller steps would not help


@pytest.mark.parametrize("value", [1, None, "yes"])
def test_word_of_who_accepts_violations_is_true_or_false(value):
    with refused(ValueError, "accept_violations=.*: expected True or False"):
        small_blocks().problem.solve(accept_violations=value)


# PETSc's options


def solved_with(options, **more):
    scene = small_blocks(problem={"petsc_options": options, **more})
    scene.loads["push"].value[1] = -0.02
    return scene.problem


def test_misspelt_option_of_petsc_is_told_once():
    problem = solved_with({"ksp_rtoll": 1e-3, "mat_mumps_icntl_7": 2})
    words = "did not use the option 'test_ksp_rtoll': misspelt"
    assert sum(words in note for note in problem.solve().notes) == 1
    assert not any("did not use" in note for note in problem.solve().notes)


@pytest.mark.parametrize("sliding", ["small", "finite"])
def test_misspelt_option_is_told_where_the_linear_bulk_is_factored_once(sliding):
    """The solver of the whole system never runs there."""
    options = {"ksp_rtoll": 1e-3, "ksp_type": "preonly"}
    on_line = PETSc.Options("test_")
    on_line["compliance_mat_mumps_icntl_144"] = 1
    try:
        scene = pressed_blocks(
            material=linear_elastic, pair={"sliding": sliding},
            problem={"petsc_options": options, "linear_bulk": True},
        )  # fmt: skip
        scene.loads["push"].value[1] = -0.02
        notes = scene.problem.solve().notes
    finally:
        on_line.delValue("compliance_mat_mumps_icntl_144")
    names = "'test_compliance_mat_mumps_icntl_144', 'test_ksp_rtoll': misspelt"
    assert sum(f"did not use the option {names}" in note for note in notes) == 1
    assert not any("did not use" in note for note in scene.problem.solve().notes)


def test_options_that_petsc_uses_are_not_told_of():
    problem = solved_with({"ksp_type": "gmres", "ksp_rtol": 1e-9, "pc_type": "lu"})
    assert not any("PETSc" in note for note in problem.solve().notes)
    problem = solved_with({"ksp_rtol": 1e-9}, solver="iterative")
    assert not any("PETSc" in note for note in problem.solve().notes)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"ksp_type": "gmress"}, "KSP type gmress"),
        ({"ksp_type": "gmres", "ksp_rtol": "tiny"}, "tiny has no numeric"),
    ],
)
def test_value_that_petsc_refuses_is_told_in_words(options, words):
    with refused(fm.MortarError, f"PETSc rejected an option 'test_...': .*{words}"):
        solved_with(options)


def test_linear_solver_that_stops_too_early_is_not_called_singular():
    problem = solved_with({"ksp_type": "gmres", "pc_type": "jacobi", "ksp_rtol": 1e-3})
    words = (
        r"stopped too early: PETSc's reason 2 \(CONVERGED_RTOL\), reduce the tolerance .*ksp_rtol"
    )
    with refused(fm.NotConvergedError, f"^(?!.*singular).*{words}"):
        problem.solve()


def test_linear_solver_that_does_not_converge_is_not_called_singular():
    problem = solved_with({"ksp_type": "gmres", "pc_type": "jacobi", "ksp_max_it": 3})
    words = r"did not converge: PETSc's reason -3 \(DIVERGED_MAX_IT\)"
    with refused(fm.NotConvergedError, f"^(?!.*singular).*{words}"):
        problem.solve()


SCRIPT = """
import sys
import petsc4py
petsc4py.init(sys.argv)
from test_inputs import solved_with
problem = solved_with({})
report = problem.solve()
print(problem.equations.system.ksp.getType(), *report.notes)
"""


@pytest.mark.serial
def test_options_of_the_command_line_are_read():
    given = ["-test_ksp_type", "gmres", "-test_ksp_rtoll", "1e-3"]
    code = f"import sys; sys.path[:0] = {sys.path!r}\n{SCRIPT}"
    run = subprocess.run(
        [sys.executable, "-c", code, *given], capture_output=True, text=True, check=True
    )
    assert run.stdout.startswith("gmres")
    assert "did not use the option 'test_ksp_rtoll'" in run.stdout
