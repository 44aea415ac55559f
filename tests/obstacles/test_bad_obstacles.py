# SPDX-License-Identifier: MIT
"""Users' distances and obstacles: errors and messages, equal on all ranks."""

import numpy as np
import pytest
from array_meshes import bcs_of, blocks_of_arrays, problem_on
from one_rank import LAST, raised_on_the_last_rank, several_ranks
from refusal import refused

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.utils.errors import NotConvergedError, NotFiniteError


def on_obstacle(obstacle, slave="slave", **options):
    """The upper of two blocks, pressed on an obstacle at y = 1."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = bcs_of(data, u.function_space)
    return problem_on(data, [fm.ContactPair(data, slave, obstacle)], bcs=bcs, u=u, **options)


class Floor:
    """Distance of y = 1, modified by a function from some time on."""

    def __init__(self, spoil, at_once=True):
        self.spoil, self.on = spoil, at_once
        self.obstacle = fm.SignedDistance(self, name="floor")

    def __call__(self, x):
        count = len(x)
        fields = x[:, 1] - 1.0, np.tile((0.0, 1.0), (count, 1)), np.zeros((count, 2, 2))
        return self.spoil(x, *fields) if self.on else fields


# Above the overlap of the scene.
LIFT = 0.05
NOT_FINITE = {
    "phi": lambda x, phi, g, H: (phi * np.nan, g, H),
    "phi somewhere": lambda x, phi, g, H: (np.where(x[:, 0] > 1.0, np.nan, phi), g, H),
    "infinite phi": lambda x, phi, g, H: (phi + np.inf, g, H),
    "gradient": lambda x, phi, g, H: (phi, g * np.nan, H),
    "Hessian": lambda x, phi, g, H: (phi, g, H * np.nan),
    "no gradient": lambda x, phi, g, H: (phi, 0.0 * g, H),
}


@pytest.mark.each
@pytest.mark.parametrize("what", NOT_FINITE)
@pytest.mark.parametrize("at_once", [True, False])
def test_distance_that_is_not_finite_is_refused_with_its_point(what, at_once):
    floor = Floor(NOT_FINITE[what], at_once)
    with refused(NotFiniteError, r"distance of 'floor'.* at [24] points, one at \("):
        problem = on_obstacle(floor.obstacle)
        problem.solve()
        floor.on = True
        problem.solve()
    floor.on = False
    assert on_obstacle(floor.obstacle).solve().converged


def test_body_behind_an_obstacle_is_told():
    """The message was that a node overlaps by ten facets, and to take smaller steps."""
    with refused(
        NotConvergedError, "whole body of 'slave' lies in .* 'plane' at the start of this solve, 3 "
        r"to 4 behind its surface, the latter at \(.*, 1\): .* move the obstacle back by 4"
    ):  # fmt: skip
        on_obstacle(fm.Plane((0.0, 5.0), (0.0, 1.0))).solve()


@pytest.mark.each
@pytest.mark.parametrize(
    "spoil, message",
    [
        (lambda x, phi, g, H: None, "returned NoneType; expected three arrays"),
        (lambda x, phi, g, H: (phi, g), "returned tuple; expected three arrays"),
        (lambda x, phi, g, H: (phi, g, H[0]), r"returned shapes .*; expected"),
        (lambda x, phi, g, H: (phi + 1j, g, H), "expected real numbers"),
        (lambda x, phi, g, H: (phi.astype(str), g, H), "expected real numbers"),
    ],
)
def test_invalid_distance_is_refused(spoil, message):
    with refused(ValueError, message):
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


@pytest.mark.each
@pytest.mark.parametrize("angle, message", [(0.05, "2.9 degrees"), (0.3, "17.2"), (0.01, None)])
def test_gradient_of_another_distance_is_a_violation_or_a_remark(angle, message):
    def turned(x, phi, g, H):
        return phi, np.tile((np.sin(angle), np.cos(angle)), (len(x), 1)), H

    problem = on_obstacle(Floor(turned).obstacle)
    report = problem.solve(accept_violations=True)
    violations = [text for text in report.certificate.violations() if "gradient" in text]
    assert bool(violations) == (message is not None)
    if message is None:
        assert any("turned by 0.6 degrees" in note for note in report.notes)
    else:
        assert message in violations[0]


@pytest.mark.each
@pytest.mark.parametrize(
    "factor, of_gradient, verdict",
    [
        (1e3, 1e3, "remark"), (0.5, 0.5, "remark"), (3.0, 1.0, "remark"),
        (1.2, 1.2, "remark"), (1.0, 1.0, "ok"), (1.0, 3.0, "ok"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("pressed", [True, False])
def test_distance_of_another_scale_is_told_with_and_without_forces(
    factor, of_gradient, verdict, pressed
):
    def scaled(x, phi, g, H):
        return factor * (phi if pressed else phi + LIFT), of_gradient * g, H

    problem = on_obstacle(Floor(scaled).obstacle)
    certificate = problem.solve(accept_violations=True).certificate
    (pair,) = certificate.pairs
    assert problem.contacts[0].pressure.any() == pressed
    assert pair["obstacle_gradient"].value < 1e-6
    assert pair["obstacle_scale"].verdict == verdict
    told = [text for text in certificate.remarks() if "has the length" in text]
    assert bool(told) == (verdict == "remark")


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
    """Certificate and estimate use additional points, different ones on each rank."""

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
    with refused(fm.MortarError, "distance of 'floor' differs between ranks"):
        problem.solve()


def test_distance_that_is_not_finite_in_an_iteration_raises_with_the_record():
    """Unlike errors at the initial state, errors at iterates may be avoided by a smaller step."""
    deep = Floor(lambda x, phi, g, H: (np.where(x[:, 1] < 0.9, np.nan, phi), g, H))
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    # The block does not touch the floor at first: the prescribed push moves it through.
    bcs = bcs_of(data, u.function_space, push=-0.3)
    problem = problem_on(data, [fm.ContactPair(data, "slave", deep.obstacle)], bcs=bcs, u=u)
    problem.equations.contacts[0].change(active=np.zeros_like(problem.equations.contacts[0].active))
    problem.equations.last_converged = True
    with refused(fm.NotConvergedError, "iteration 1: the distance of 'floor'.* is not finite"):
        problem.solve()


@pytest.mark.each
@pytest.mark.parametrize(
    "what, value, message",
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
def test_invalid_place_load_or_pivot_is_refused(what, value, message):
    obstacle = fm.Plane((0.0, 1.0), (0.0, 1.0))
    problem, kept = on_obstacle(obstacle), getattr(obstacle, what)
    setattr(obstacle, what, np.array(value))
    finite = np.array(value).dtype.kind == "f" and len(value) == len(kept)
    with refused(NotFiniteError if finite else fm.MortarError, message):
        problem.solve()
    setattr(obstacle, what, kept)
    assert problem.solve().converged


@pytest.mark.each
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
def test_obstacle_that_contains_the_body_is_refused(obstacle):
    """No facet faces it: a solve would converge without a force, also where it moved beforehand."""
    for way in (0.0, -0.2, 0.3):
        problem = on_obstacle(obstacle)
        obstacle.move(y=way)
        with refused(
            fm.MortarError, "lies inside obstacle .*: the solid is on the side of the bod"
        ):
            problem.solve()


def test_obstacle_beneath_a_body_whose_slave_is_on_top_does_not_contain_it():
    problem = on_obstacle(fm.Plane((0.0, -0.1), (0.0, 1.0)), slave="master")
    assert problem.solve().converged


@pytest.mark.parametrize("mu, told", [(30.0, 1), (lambda X: 3.0 * X[:, 0], 0), (0.3, 0), (2e2, 0)])
def test_coefficients_of_friction_like_angles_in_degrees_have_a_remark(mu, told):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    pair = fm.ContactPair(data, "slave", "master", law=fm.Coulomb(mu))
    notes = problem_on(data, [pair], bcs=bcs_of(data, u.function_space), u=u).solve().notes
    found = [note for note in notes if "an angle of friction" in note]
    assert len(found) == told and all("30 per cent are 0.3, and" in note for note in found)


def test_deep_obstacle_that_faces_the_body_is_an_interference():
    assert on_obstacle(fm.Plane((0.0, 1.02), (0.0, 1.0))).solve().converged


@pytest.mark.each
@pytest.mark.parametrize(
    "points, message",
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], r"intersects itself: edges from \(0, 0\) to \(1, 1\)"),
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "intersects itself"),
        ([(0, 0), (1, 0), (1, 1), (0, 0)], "intersects itself"),
        ([(0, 0), (1, 0), (2, 0)], "two edges of the polygon overlap"),
        ([(0, 0), (2, 0), (2, 2), (1, 0.01), (0, 2)], "reduced by rounding=0.02 intersects itself"),
        ([(0, 0), (0.03, 0), (0.03, 1), (0, 1)], r"rounding=0.02: expected less than 0.015"),
        ("abc", "points='abc': expected real numbers"),
    ],
)
def test_self_intersecting_polygon_is_refused(points, message):
    with pytest.raises(ValueError, match=message):
        fm.Polygon(points, 0.02)


@pytest.mark.parametrize("closed", [True, False])
def test_self_intersecting_spline_is_refused(closed):
    with pytest.raises(ValueError, match="the spline intersects itself"):
        fm.Spline([(0, 0), (2, 1), (2, 0), (0, 1)], closed=closed)


def test_self_intersection_of_a_spline_is_that_of_its_curve():
    """With four lines per interval only the first case crosses; with 64 and 512 the second one."""
    fm.Spline([(0, 0), (1, 0), (1.01, 0.01), (0.995, -0.004), (0.67, 0.74)])
    with pytest.raises(ValueError, match="the spline intersects itself"):
        fm.Spline([(0, 0), (1, 0), (1.2476, 0.0874), (0.8229, -0.0159), (0.4728, 0.842)])


def test_simple_polygons_and_splines_are_accepted():
    fm.Polygon([(0, 0), (3, 0), (3, 1), (2, 1), (2, 0.5), (1, 0.5), (1, 1), (0, 1)], 0.1)
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    fm.Spline(np.stack([np.cos(angles), np.sin(angles)], axis=1), closed=True)
    x = np.linspace(0.0, 1.0, 9)
    fm.Spline(np.stack([x, 0.1 * np.sin(9.0 * x)], axis=1))


@pytest.mark.each
@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: fm.Circle((0, 0), "1"), "radius='1': expected a positive length"),
        (lambda: fm.Circle((0, 0), 1.0, inside="no"), "inside='no': expected True or False"),
        (lambda: fm.Circle("ab", 1.0), "centre='ab': expected real numbers"),
        (lambda: fm.Plane((0, 0), (0, 1j)), "normal=.*: expected real numbers"),
        (lambda: fm.Plane((0, 0), (0, 1), name=None), "name=None: expected a text"),
        (lambda: fm.Plane((0, 0), (0, 1)).move(y="up"), "y='up': expected a finite number"),
        (lambda: fm.Plane((0, 0), (0, 1)).push(moment=1j), "moment=1j: expected a finite number"),
        (lambda: fm.Circle((0, 0), 1).push(moment=(0, 0, 2)), "in the plane the one about z"),
        (lambda: fm.Sphere((0, 0, 0), 1).push(moment=2.0), r"as on an axle, \(None, None, 2.0\)"),
        (
            lambda: fm.Polygon([(0, 0), (1, 0), (1, 1)], None),
            "rounding=None: expected a positive length",
        ),
        (lambda: fm.SignedDistance(3.0), "function=3.0: expected a function of points"),
    ],
)
def test_invalid_obstacle_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.once
def test_distance_may_reuse_its_arrays():
    store = np.zeros(1000)

    def again(x, phi, g, H):
        store[: len(x)] = phi
        return store[: len(x)], g, H

    usual, reused = (on_obstacle(Floor(f).obstacle) for f in (lambda x, *fields: fields, again))
    for problem in (usual, reused):
        assert problem.solve().certificate.violations() == []
    z = [problem.equations.contacts[0].z for problem in (usual, reused)]
    assert np.abs(z[0] - z[1]).max() < 1e-12 * np.abs(z[0]).max()
