# SPDX-License-Identifier: MIT
"""Rigid obstacles: fields, derivatives, uniform pressure, theory, balance, bad input."""

import numpy as np
import pytest
from refusal import refused
from scenes import TIGHT, internal, linear_elastic, neo_hookean, pair_options, read

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.interface.mortar import MortarOptions
from fenics_mortar.interface.on_obstacle import OnFacets, integrate_facets, obstacle_normals
from fenics_mortar.interface.reference import facet_rule, hand_over, tabulate
from meshes import two_blocks

E, NU = 100.0, 0.3


def ellipse(x):
    """A smooth function that is no distance: sqrt(x^2 / 4 + y^2) - 1, moved to (0.5, 2.01)."""
    A, y = np.diag([0.25, 1.0]), x - [0.5, 2.01]
    r = np.sqrt(np.einsum("ia,ab,ib->i", y, A, y))
    e = y @ A / r[:, None]
    hessian = (A - np.einsum("ia,ib->iab", e, e)) / r[:, None, None]
    return r - 1.0, e, hessian


ARC = np.linspace(np.pi, 2 * np.pi, 9)
KINDS = {
    "plane": lambda: fm.Plane((0.5, 1.01), (0.1, -1.0)),
    "circle": lambda: fm.Circle((0.6, 2.0), 1.0),
    "hole": lambda: fm.Circle((0.6, -1.0), 2.01, inside=True),
    "open": lambda: fm.Spline([(-0.5, 1.2), (0.5, 1.0), (0.9, 1.05), (1.5, 1.3)]),
    "closed": lambda: fm.Spline(
        [*np.stack([0.6 + np.cos(ARC), 2 + np.sin(ARC)], 1).tolist(), (0.6, 3.0)], closed=True
    ),
    "polygon": lambda: fm.Polygon([(-0.2, 2.0), (0.4, 0.96), (0.7, 0.99), (1.2, 2.0)], 0.1),
    "function": lambda: fm.SignedDistance(ellipse),
}


def block_under(obstacle, *, degree=1, pair=None, material=neo_hookean, width=1.0, **options):
    """The lower block, fixed at its bottom, with its top against ``obstacle``."""
    size = {"n_lower": 8, "layers_lower": 6} if degree == 1 else {"n_lower": 4, "layers_lower": 3}
    data = read(two_blocks.build, width_lower=width, gap=3.0, **size)
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    options = {"petsc_options_prefix": "test_", "newton": TIGHT, **options}
    return fm.ContactProblem(
        internal(u, material(u, E, NU)), u,
        [fm.ContactPair(data, "lower/top", obstacle, **pair_options(pair))], bcs=bcs, **options,
    )  # fmt: skip


# Pivot


PIVOT, SHIFT = np.array((2.0, -3.0)), np.array((0.1, -0.2))
WITH_PIVOT = {
    "plane": lambda **given: fm.Plane((0.5, 1.01), (0.1, -1.0), **given),
    "circle": lambda **given: fm.Circle((0.6, 2.0), 1.0, **given),
    "hole": lambda **given: fm.Circle((0.6, -1.0), 2.01, inside=True, **given),
    "open": lambda **given: fm.Spline([(-0.5, 1.2), (0.5, 1.0), (0.9, 1.05), (1.5, 1.3)], **given),
    "closed": lambda **given: fm.Spline(
        [(0.1, 0.0), (1.0, 0.1), (1.1, 1.0), (0.0, 0.9)], closed=True, **given
    ),
    "polygon": lambda **given: fm.Polygon(
        [(-0.2, 2.0), (0.4, 0.96), (0.7, 0.99), (1.2, 2.0)], 0.1, **given
    ),
    "function": lambda **given: fm.SignedDistance(ellipse, **given),
}


def same_fields(one, other, x):
    fields = zip(one.evaluate(x), other.evaluate(x), strict=True)
    return all(np.allclose(a, b, rtol=1e-12, atol=1e-12) for a, b in fields) and np.allclose(
        one.salient_points(), other.salient_points(), rtol=1e-14, atol=1e-14
    )


@pytest.mark.parametrize("kind", [fm.Circle, fm.Sphere])
def test_salient_points_are_on_all_sides_of_a_ball(kind):
    centre = np.array((1.0, -2.0, 3.0))[: 2 if kind is fm.Circle else 3]
    away = (kind(centre, 0.5).salient_points() - centre) / 0.5
    assert len(away) == 3 ** len(centre) - 1
    assert np.allclose(np.linalg.norm(away, axis=1), 1.0, atol=1e-14)
    # opposite points, and as many across as along each axis
    assert np.allclose(away.T @ away, len(away) / len(centre) * np.eye(len(centre)), atol=1e-13)
    assert np.allclose(away.sum(axis=0), 0.0, atol=1e-13)


@pytest.mark.each
@pytest.mark.parametrize("kind", WITH_PIVOT)
def test_surface_does_not_depend_on_the_pivot(kind):
    """Neither on a pivot given at first nor on one set later; rotations are about it."""
    x = np.random.default_rng(1).uniform(-0.5, 2.5, (20, 2))
    usual, given, later = (WITH_PIVOT[kind](**options) for options in ({}, {"pivot": PIVOT}, {}))
    later.pivot = PIVOT.copy()
    assert same_fields(usual, given, x) and same_fields(usual, later, x)
    for obstacle in (usual, given, later):
        obstacle.move(x=SHIFT[0], y=SHIFT[1])
    assert same_fields(usual, given, x) and same_fields(usual, later, x)
    c, s = np.cos(0.7), np.sin(0.7)
    turned = (x - PIVOT) @ np.array([[c, s], [-s, c]]) + PIVOT
    phi = usual.evaluate(x + SHIFT)[0]
    for obstacle in (given, later):
        obstacle.move(angle=0.7)
        assert np.allclose(obstacle.evaluate(turned + SHIFT)[0], phi, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "kind, name, value",
    [
        ("circle", "radius", 0.8),
        ("hole", "radius", 1.5),
        ("open", "points", [(-0.4, 1.3), (0.4, 1.1), (0.9, 1.0), (1.4, 1.2)]),
        ("closed", "points", [(0.0, 0.0), (1.0, 0.0), (1.2, 1.0), (0.0, 1.0)]),
    ],
)
def test_shape_that_is_set_does_not_depend_on_pivot_and_place(kind, name, value):
    """The same holds for derivatives by the shape."""
    x = np.random.default_rng(2).uniform(-0.5, 2.5, (20, 2))
    usual, other = WITH_PIVOT[kind](), WITH_PIVOT[kind](pivot=PIVOT)
    other.move(x=SHIFT[0], y=SHIFT[1])
    for obstacle in (usual, other):
        obstacle.set_shape(name, np.array(value))
    assert np.array_equal(other.pivot, PIVOT) and np.array_equal(other.place, (*SHIFT, 0.0))
    fields = zip(usual.evaluate(x), other.evaluate(x + SHIFT), strict=True)
    assert all(np.allclose(a, b, rtol=1e-11, atol=1e-11) for a, b in fields)
    direction = np.random.default_rng(3).normal(size=np.shape(value))
    changes = (o.local_by_shapes(x, name, direction[None]) for o in (usual, other))
    assert all(np.allclose(a, b, rtol=1e-9, atol=1e-9) for a, b in zip(*changes, strict=True))


def test_pivot_of_a_turned_obstacle_is_not_changed():
    """Before it turns its solution does not depend on it."""
    found = []
    for pivot in ((0.6, 2.0), PIVOT):
        circle = fm.Circle((0.6, 2.0), 1.01)
        problem = block_under(circle)
        circle.pivot = np.array(pivot)
        problem.solve()
        found.append(problem.contacts[0].tractions)
    assert np.allclose(*found, rtol=1e-9, atol=1e-9)
    circle.move(angle=0.01)
    problem.solve()
    circle.pivot = np.array((0.0, 0.0))
    with refused(fm.MortarError, r"pivot of obstacle 'circle' .* after .* turned by 0.01 radian"):
        problem.solve()
    circle.pivot = PIVOT.copy()
    assert problem.solve().converged


@pytest.mark.each
@pytest.mark.serial
@pytest.mark.parametrize("kind", KINDS)
def test_fields_are_derivatives(kind):
    """Central differences, after a motion, also beyond the ends of an open curve: straight there.

    Their error is rounding over the step.
    """
    obstacle = KINDS[kind]()
    obstacle.move(x=0.1, y=-0.2, angle=0.3)
    left, right = (-1.5, 2.5) if kind == "open" else (0.1, 0.8)
    x = np.random.default_rng(0).uniform((left, 0.6), (right, 0.9), (20, 2))
    _, gradient, hessian = obstacle.evaluate(x)
    for i, step in enumerate(1e-5 * np.eye(2)):
        after, before = obstacle.evaluate(x + step), obstacle.evaluate(x - step)
        assert np.allclose((after[0] - before[0]) / 2e-5, gradient[:, i], atol=1e-7)
        assert np.allclose((after[1] - before[1]) / 2e-5, hessian[:, i], atol=1e-6)


@pytest.mark.each
@pytest.mark.serial
@pytest.mark.parametrize("kind", ["plane", "circle", "hole"])
@pytest.mark.parametrize("pair", ["dual", "standard", "petrov", "nodes"])
def test_facets_and_normals_by_complex_step(kind, pair):
    """Random curved facets, with complex steps of their nodes and of the obstacle's motion."""
    random = np.random.default_rng(3)
    x = np.array([[0.0, 0.9], [0.2, 0.93], [0.4, 0.9]])[None] + random.uniform(0.0, 0.02, (4, 3, 2))
    arm, h = 0.7, 1e-30
    choice = {"basis": "dual", "gap_weights": "cover", "integration": "segments", **PAIRS[pair]}
    options = MortarOptions(weighting="opposite", points=5, radius=1.0, min_cosine=0.0, **choice)
    weights = hand_over(random.uniform(size=(4, 3)) > 0.3)
    points, of_points = facet_rule(options.integration, 3, options.points)
    fixed = weights, tabulate(points, 3), of_points, options.kinds

    def evaluate(du, dq):
        obstacle = KINDS[kind]()
        obstacle.place = np.array([0.02, -0.03, 0.1]) + dq / [1.0, 1.0, arm]
        D, dD, g, dg, dg_dq, _ = integrate_facets(OnFacets(x + du, *fixed), obstacle, arm)
        _, n, dn, dn_dq = obstacle_normals(obstacle, arm, (x + du)[:, 1], 2)
        return (D, g, n), (dD, dg, dn), (dg_dq, dn_dq)

    _, by_nodes, by_motions = evaluate(0.0, np.zeros(3))
    for q in range(6):
        du = h * 1j * np.eye(6)[q].reshape(3, 2)
        D, g, n = (value.imag / h for value in evaluate(du, np.zeros(3))[0])
        for found, exact in zip((D, g), by_nodes[:2], strict=True):
            assert np.abs(exact[..., q] - found).max() < 1e-13
        if q in (2, 3):  # the components of the node in the middle, whose normal it is
            assert np.abs(by_nodes[2][:, :, 2 + q] - n).max() < 1e-12
    for q in range(3):
        _, g, n = (value.imag / h for value in evaluate(0.0, h * 1j * np.eye(3)[q])[0])
        for found, exact in zip((g, n), by_motions, strict=True):
            assert np.abs(exact[..., q] - found).max() < 1e-13


@pytest.mark.serial
def test_polygon_by_hand():
    """An L, clockwise: points beside an edge, off a rounded corner, in the concave one, inside."""
    corners = [(0, 0), (0, 2), (1, 2), (1, 1), (2, 1), (2, 0)]
    x = np.array([[0.5, -0.3], [2.3, -0.4], [1.2, 1.1], [0.9, 0.4], [0.8, 0.8]])
    phi, gradient, hessian = fm.Polygon(corners, 0.1).evaluate(x)
    corner = np.array([0.4, -0.5]) / np.hypot(0.4, 0.5)
    deep = np.array([1.0, 1.0]) / np.sqrt(2.0)
    far = np.hypot(0.4, 0.5), np.hypot(0.1, 0.1)
    assert np.allclose(phi, [0.3, far[0] - 0.1, 0.1, -0.4, -far[1] - 0.1], atol=1e-14)
    assert np.allclose(gradient, [(0, -1), corner, (0, 1), (0, -1), deep], atol=1e-14)
    flat, edgewise = np.zeros((2, 2)), (np.eye(2) - np.outer(corner, corner)) / far[0]
    inward = -(np.eye(2) - np.outer(deep, deep)) / far[1]
    assert np.allclose(hessian, [flat, edgewise, flat, flat, inward], atol=1e-13)


PAIRS = {
    "dual": {},
    "standard": {"basis": "standard"},
    "vertices": {"basis": "vertices"},
    "linear": {"basis": "linear"},
    "petrov": {"gap_weights": "standard"},
    "nodes": {"integration": "nodes"},
}


@pytest.mark.once
@pytest.mark.parametrize(
    "kind, degree, pair",
    [
        *[(kind, 1, "dual") for kind in KINDS],
        *[("circle", degree, pair) for degree in (1, 2) for pair in PAIRS],
    ],
)
def test_tangent(kind, degree, pair):
    """Friction on obstacles that are translated and rotated."""
    obstacle = KINDS[kind]()
    rough = {"law": fm.Coulomb(0.3)} if pair == "dual" else {}
    problem = block_under(obstacle, degree=degree, pair=PAIRS[pair] | rough)
    obstacle.move(x=0.03, y=-0.02, angle=0.05)
    contact = problem.equations.contacts[0]
    contact.offset = np.random.default_rng(1).uniform(-0.01, 0.01, contact.slave.num_nodes)
    contact.change(active=contact.covered)
    check = problem.check_tangent(print_table=False)
    assert all(slope > 1.9 for slope in check.slopes.values()), check.slopes


@pytest.mark.once
@pytest.mark.parametrize("kind", KINDS)
def test_balance_and_algorithms(kind):
    """Condensed and saddle agree up to the solver's rounding; the certificate has no violations."""
    found = []
    for algorithm in ("condensed", "saddle"):
        obstacle = KINDS[kind]()
        problem = block_under(obstacle, algorithm=algorithm)
        obstacle.move(y=-0.05)
        report = problem.solve()
        assert problem.equations.contacts[0].active.any()
        assert report.certificate.violations() == []
        found.append((problem.equations.contacts[0].z, report.num_iterations))
    assert np.allclose(found[0][0], found[1][0], atol=1e-9 * np.abs(found[0][0]).max())
    assert found[0][1] == found[1][1]


def test_forces_on_an_obstacle_are_those_of_its_reaction():
    """The moment is about the pivot, in units of force times length for a block of any width."""
    obstacle = KINDS["plane"]()
    problem = block_under(obstacle, width=2.2)
    obstacle.move(y=-0.05)
    problem.solve()
    force, moment = obstacle.reaction[:2], obstacle.reaction[2]
    assert np.linalg.norm(force) > 0.1 and abs(moment) > 0.01
    assert problem.forces()[2][0] == pytest.approx(-obstacle.reaction, rel=1e-12)
    x, f = problem.contacts[0].positions, problem.contacts[0].forces
    arms = x - (obstacle.pivot + obstacle.place[:2])
    assert moment == pytest.approx(-(arms[:, 0] * f[:, 1] - arms[:, 1] * f[:, 0]).sum(), rel=0.02)


@pytest.mark.each
@pytest.mark.parametrize(
    "make",
    [
        lambda: fm.Plane((0, 0), (0, 0)),
        lambda: fm.Circle((0, 0), -1.0),
        lambda: fm.Spline([(0, 0), (1, 0)]),
        lambda: fm.Polygon([(0, 0), (1, 0), (0, 1)], 0.0),
        lambda: fm.Polygon([(0, 0), (1, 0), (0, 1)], 0.5),
        lambda: fm.Polygon([(0, 0), (0, 0), (0, 1)], 0.1),
        lambda: fm.Spline([(0, 0), (0, 0), (1, 0)]),
        lambda: fm.Plane((0, np.nan), (0, 1)),
        lambda: fm.Plane((0, 0), (0, 1)).move(x=(1.0,)),
        lambda: fm.Plane((0, 0), (0, 1)).move(angle=np.inf),
        lambda: fm.SignedDistance(lambda x: (x, x, x)).evaluate(np.zeros((3, 2))),
    ],
)
def test_bad_input(make):
    with pytest.raises(ValueError):
        make()


def test_linear_bulk_with_an_obstacle():
    """Newton's method on the contact dofs and on all dofs have equal results, also if driven."""
    found = []
    for reduced in (True, False):
        obstacle = KINDS["circle"]()
        problem = block_under(obstacle, material=linear_elastic, linear_bulk=reduced)
        obstacle.move(x=0.02, y=-0.05)
        problem.solve()
        z = problem.equations.contacts[0].z.copy()
        obstacle.push(y=-1.2 * obstacle.reaction[1])
        problem.solve()
        found.append((z, problem.equations.contacts[0].z))
    for reduced, exact in zip(*found, strict=True):
        assert np.abs(reduced - exact).max() < 1e-9 * np.abs(exact).max()
