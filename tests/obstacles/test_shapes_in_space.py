# SPDX-License-Identifier: MIT
"""Obstacles in space: distances, gradients and Hessians, places, integrals over facets."""

import numpy as np
import pytest

import fenics_mortar as fm
from fenics_mortar.interface.mortar import MortarOptions
from fenics_mortar.interface.on_obstacle import (
    OnFacets,
    integrate_facets,
    obstacle_normals,
    points_of,
)
from fenics_mortar.interface.reference import facet_rule, hand_over, tabulate
from fenics_mortar.kernels.space.shapes import reference_nodes
from fenics_mortar.obstacles.rigid_motion import (
    by_further_motion,
    motion_between,
    place_after,
    rotation_by,
    vector_of,
)

AXIS = np.array((0.3, -0.5, 1.0)) / np.linalg.norm((0.3, -0.5, 1.0))
PUNCH = [(-1.0, 0.0), (1.0, 0.0), (1.0, 2.0), (-1.0, 2.0)]
PROFILE = [(1.2, -1.0), (0.9, -0.3), (1.1, 0.4), (1.6, 1.0)]


def paraboloid(x):
    """No distance: z - x^2 / 2 - y^2 / 4."""
    one, zero = np.ones(len(x), x.dtype), np.zeros((len(x), 3, 3), x.dtype)
    zero[:, 0, 0], zero[:, 1, 1] = -1.0, -0.5
    gradient = np.stack([-x[:, 0], -0.5 * x[:, 1], one], axis=1)
    return x[:, 2] - 0.5 * x[:, 0] ** 2 - 0.25 * x[:, 1] ** 2, gradient, zero


SMOOTH = {
    "plane": lambda: fm.Plane((0.1, 0.2, 0.3), (0.2, 0.3, 1.0)),
    "sphere": lambda: fm.Sphere((0.1, 0.2, 0.3), 0.7),
    "hole": lambda: fm.Sphere((0.1, 0.2, 0.3), 3.0, inside=True),
    "cylinder": lambda: fm.Cylinder((0.1, 0.2, 0.3), AXIS, 0.4),
    "bore": lambda: fm.Cylinder((0.1, 0.2, 0.3), AXIS, 3.0, inside=True),
    "cone": lambda: fm.Cone((0.1, 0.2, 0.3), AXIS, 0.6, rounding=0.1),
    "sharp": lambda: fm.Cone((0.1, 0.2, 0.3), AXIS, 1.2),
    "torus": lambda: fm.Torus((0.1, 0.2, 0.3), AXIS, 1.0, 0.2),
    "extruded": lambda: fm.Extruded(
        fm.Circle((0.3, 0.1), 0.4), axis=AXIS, first=(1, 0, 0), origin=(0.1, 0.0, 0.2)
    ),
    "revolved": lambda: fm.Revolved(fm.Circle((0.3, 0.1), 0.4), axis=AXIS, origin=(0.1, 0, 0.2)),
    "function": lambda: fm.SignedDistance(paraboloid, pivot=(0.0, 0.0, 0.0)),
}
REAL = {
    "punch": lambda: fm.Revolved(fm.Polygon(PUNCH, 0.1), axis=AXIS),
    "groove": lambda: fm.Revolved(fm.Spline(PROFILE), axis=AXIS, origin=(0.1, 0.0, 0.2)),
    "rail": lambda: fm.Extruded(fm.Spline(PROFILE), axis=(0, 1, 0), first=(0, 0, 1)),
}
KINDS = {**SMOOTH, **REAL}
PLACE = np.array([0.05, -0.02, 0.03, 0.4, -0.3, 0.6])


@pytest.mark.each
@pytest.mark.serial
@pytest.mark.parametrize("kind", KINDS)
def test_fields_are_derivatives(kind):
    """Central differences after a motion; their error is rounding over the step."""
    obstacle = KINDS[kind]()
    assert obstacle.dim == 3
    obstacle.move(x=0.05, y=-0.02, z=0.03, angle=PLACE[3:])
    assert np.array_equal(obstacle.place, PLACE)
    x = np.random.default_rng(0).uniform(-1.5, 1.5, (60, 3))
    _, gradient, hessian = obstacle.evaluate(x)
    for i, step in enumerate(1e-5 * np.eye(3)):
        after, before = obstacle.evaluate(x + step), obstacle.evaluate(x - step)
        assert np.allclose((after[0] - before[0]) / 2e-5, gradient[:, i], atol=1e-7)
        assert np.allclose((after[1] - before[1]) / 2e-5, hessian[:, i], atol=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("kind", SMOOTH)
def test_fields_by_complex_step(kind):
    obstacle = SMOOTH[kind]()
    obstacle.place = PLACE.copy()
    x, h = np.random.default_rng(0).uniform(-1.5, 1.5, (60, 3)), 1e-30
    phi, gradient, hessian = obstacle.evaluate(x)
    size = np.abs(hessian).max()
    for i in range(3):
        phi, by, _ = (field.imag / h for field in obstacle.evaluate(x + 1j * h * np.eye(3)[i]))
        assert np.abs(phi - gradient[:, i]).max() < 1e-13
        assert np.abs(by - hessian[:, i]).max() < 1e-13 * max(size, 1.0)


@pytest.mark.serial
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "function"])
def test_fields_are_those_of_a_distance(kind):
    """|grad phi| = 1, H grad phi = 0, and x - phi grad phi is on the surface, beyond kinks."""
    obstacle = KINDS[kind]()
    obstacle.place = PLACE.copy()
    x = np.random.default_rng(1).uniform(-1.5, 1.5, (60, 3))
    phi, gradient, hessian = obstacle.evaluate(x)
    assert np.allclose(np.linalg.norm(gradient, axis=1), 1.0, rtol=0, atol=1e-13)
    along = np.abs(np.einsum("nab,nb->na", hessian, gradient)).max()
    assert along < 1e-11 * max(1.0, np.abs(hessian).max())
    outside = phi > 0.0
    assert outside.sum() > 5
    feet = obstacle.evaluate(x - phi[:, None] * gradient)[0][outside]
    assert np.abs(feet).max() < 1e-10


@pytest.mark.serial
def test_revolved_circle_is_a_sphere_and_a_torus():
    """Also on the axis."""
    x = np.random.default_rng(2).uniform(-2.0, 2.0, (40, 3))
    beside = 3.0 * AXIS + [(1e-9, 0, 0), (0, 1e-6, 0), (0, 0, 1e-4)]
    x = np.concatenate([x, np.outer((-2.0, -0.3, 0.4, 3.0), AXIS), beside])
    sphere, ball = fm.Sphere((0, 0, 0), 0.8), fm.Revolved(fm.Circle((0, 0), 0.8), axis=AXIS)
    for one, other in zip(sphere.evaluate(x), ball.evaluate(x), strict=True):
        assert np.allclose(one, other, rtol=1e-9, atol=1e-9)
    phi, gradient, _ = fm.Torus((0, 0, 0), (0, 0, 1), 2.0, 0.5).evaluate(
        np.array([(3.0, 0, 0), (0, 2.0, 1.0), (0, 0, 0)])
    )
    assert np.allclose(phi, (0.5, 0.5, 1.5)) and np.allclose(gradient[:2], [(1, 0, 0), (0, 0, 1)])
    assert np.linalg.norm(gradient[2]) == pytest.approx(1.0)


@pytest.mark.serial
def test_cone_by_hand():
    """A sharp one of 45 degrees upwards: below the tip, beside, on the axis inside; rounded."""
    x = np.array([(0.0, 0.0, -0.3), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5)])
    phi, gradient, _ = fm.Cone((0, 0, 0), (0, 0, 2), np.pi / 4).evaluate(x)
    half = np.sqrt(0.5)
    assert np.allclose(phi, (0.3, half, -0.5 * half), atol=1e-15)
    assert np.allclose(gradient, [(0, 0, -1), (half, 0, -half), (0, 0, -half)], atol=1e-15)
    phi = fm.Cone((0, 0, 0), (0, 0, 2), np.pi / 4, rounding=0.1).evaluate(x)[0]
    assert np.allclose(phi, (0.3 + 0.1 / half - 0.1, half, -0.5 * half), atol=1e-15)


@pytest.mark.serial
def test_rotation_vectors():
    """Matrix, its vector, and the derivative of the matrix, near 0 and pi too."""
    random = np.random.default_rng(3)
    for size in (0.0, 1e-9, 0.05, 0.0999, 0.1001, 1.0, 3.1, np.pi - 1e-10):
        w = random.normal(size=3)
        w *= size / np.linalg.norm(w)
        R = rotation_by(w)
        assert np.allclose(vector_of(R), w, rtol=0, atol=1e-14 + 1e-9 * (size > 3.14))
        for i, step in enumerate(1e-6 * np.eye(3)):
            dR = (rotation_by(w + step) - rotation_by(w - step)) / 2e-6
            assert np.allclose(np.cross(spins(w)[:, i], R.T).T, dR, rtol=0, atol=1e-9)


@pytest.mark.serial
def test_rotations_do_not_stretch():
    """Many rotation vectors, of up to three turns."""
    random = np.random.default_rng(3)
    for w in random.normal(size=(5000, 3)) * random.uniform(1e-6, 6.0, (5000, 1)):
        R = rotation_by(w)
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-15


def spins(w):
    """Spins about fixed axes by a change of a rotation vector: columns, by a complex step."""
    found = np.empty((3, 3))
    for i in range(3):
        W = rotation_by(w + 1e-30j * np.eye(3)[i]).imag / 1e-30 @ rotation_by(w).T
        found[:, i] = W[2, 1], W[0, 2], W[1, 0]
    return found


@pytest.mark.serial
def test_motions_add_by_rotations():
    """A further motion turns about fixed axes; more than half a turn is a vector of less."""
    sphere = fm.Sphere((0.1, 0.2, 0.3), 0.7, pivot=(1.0, 0.0, 0.0))
    sphere.place = PLACE.copy()
    x, motion = np.random.default_rng(4).normal(size=(5, 3)), np.array([1, 2, 3, 4, 5, 6]) * 0.1
    before, centre = sphere.to_space(x), sphere.pivot + sphere.place[:3]
    sphere.place = place_after(sphere.place, motion, 2.0)
    turned = (before - centre) @ rotation_by(motion[3:] / 2.0).T + centre + motion[:3]
    assert np.allclose(sphere.to_space(x), turned, atol=1e-14)
    assert np.allclose(sphere.displacement(x), turned - x, atol=1e-14)
    assert np.allclose(sphere.to_own_frame(turned), x, atol=1e-14)


@pytest.mark.serial
def test_motion_between_places_is_the_inverse_with_its_derivative():
    arm, motion = 2.0, np.array([1, 2, 3, 4, 5, 6]) * 0.1
    further, start = np.array([3, -1, 2, 2, -4, 1]) * 0.1, place_after(PLACE, motion, arm)
    assert np.allclose(motion_between(PLACE, start, arm), motion, atol=1e-14)
    ends = [
        motion_between(PLACE, place_after(start, step * further, arm), arm)
        for step in (1e-5, -1e-5)
    ]
    expected = by_further_motion(motion, arm) @ further
    assert np.allclose((ends[0] - ends[1]) / 2e-5, expected, atol=1e-9)


OPTIONS = {
    "weighting": "opposite", "points": 12, "radius": 1.0, "min_cosine": 0.0,
    "integration": "segments", "gap_weights": "cover",
}  # fmt: skip


def facets_of(size, count=3, seed=5):
    """Random warped facets of about one near (0, 0, 1)."""
    nodes = reference_nodes(size) * (1.0 if size in (3, 6) else 0.5)
    flat = np.column_stack([nodes, np.ones(size)])
    return flat + np.random.default_rng(seed).uniform(-0.04, 0.04, (count, size, 3))


@pytest.mark.each
@pytest.mark.serial
@pytest.mark.parametrize("kind", ["plane", "sphere", "cone", "torus", "extruded", "function"])
@pytest.mark.parametrize("size, basis", [(3, "dual"), (4, "dual"), (4, "standard"), (9, "dual")])
def test_facets_and_normals_by_complex_step(kind, size, basis):
    """Complex steps of nodes and of the motion, with nodes that hand their functions over."""
    arm, h = 0.7, 1e-30
    options = MortarOptions(basis=basis, **OPTIONS)
    x = facets_of(size)
    carries = np.random.default_rng(6).uniform(size=(3, size)) > 0.3
    carries[:, 0] = True
    points, weights = facet_rule(options.integration, size, options.points, 3)
    fixed = hand_over(carries, 3), tabulate(points, size), weights, options.kinds
    projectors = np.broadcast_to(np.diag([1.0, 0.0, 1.0]), (3, 3, 3))

    def evaluate(du, dw):
        obstacle = SMOOTH[kind]()
        obstacle.place = PLACE + dw
        D, dD, g, dg, dg_dq, _ = integrate_facets(OnFacets(x + du, *fixed), obstacle, arm)
        _, n, dn, dn_dq = obstacle_normals(obstacle, arm, (x + du)[:, 1], 1)
        _, p, dp, dp_dq = obstacle_normals(obstacle, arm, (x + du)[:, 1], 1, projectors)
        n, dn, dn_dq = (np.concatenate(pair) for pair in ((n, p), (dn, dp), (dn_dq, dp_dq)))
        return (D, g, n), (dD, dg, dn), (dg_dq, dn_dq)

    _, by_nodes, by_motions = evaluate(0.0, 0.0)
    by_place = np.eye(6)
    by_place[3:, 3:] = arm * spins(PLACE[3:])
    for q in range(3 * size):
        du = h * 1j * np.eye(3 * size)[q].reshape(size, 3)
        D, g, n = (value.imag / h for value in evaluate(du, 0.0)[0])
        for found, exact in zip((D, g), by_nodes[:2], strict=True):
            assert np.abs(exact[..., q] - found).max() < 2e-13
        if 3 <= q < 6:
            assert np.abs(by_nodes[2][:, :, q - 3] - n).max() < 1e-12
    for q in range(6):
        _, g, n = (value.imag / h for value in evaluate(0.0, h * 1j * np.eye(6)[q])[0])
        for found, exact in zip((g, n), by_motions, strict=True):
            assert np.abs(exact @ by_place[:, q] - found).max() < 1e-12


@pytest.mark.serial
@pytest.mark.parametrize("size", [3, 4, 6, 9])
def test_integrals_of_facets(size):
    """Sums are areas, dual D is diagonal, gaps of a plane above flat facets are exact."""
    nodes = reference_nodes(size) @ np.array([[1.0, 0.2], [-0.3, 0.8]])
    x = np.column_stack([nodes, np.zeros(size)])[None]
    options = MortarOptions(basis="dual", **OPTIONS)
    points, weights = facet_rule(options.integration, size, options.points, 3)
    area = (0.5 if size in (3, 6) else 4.0) * (0.8 + 0.06)
    plane = fm.Plane((0, 0, 1.0), (0.3, 0.2, -1.0))
    if size == 6:  # the integrals of the functions of the corners are zero
        options = MortarOptions(basis="standard", **OPTIONS)
    given = OnFacets(x, np.eye(size)[None], tabulate(points, size), weights, options.kinds)
    D, _, g, *_, d = integrate_facets(given, plane, 1.0)
    assert d.sum() == pytest.approx(area, rel=1e-13)
    assert D.sum() == pytest.approx(area, rel=1e-13)
    phi = plane.evaluate(x[0])[0]
    if size != 6:
        assert np.allclose(D[0], np.diag(d[0]), atol=1e-13)
        assert np.allclose(g[0], d[0] * phi, atol=1e-13)
    assert g.sum() == pytest.approx(d[0] @ phi, rel=1e-12)
    assert np.allclose(points_of(x, points)[0] @ (0, 0, 1), 0.0)


@pytest.mark.each
@pytest.mark.serial
@pytest.mark.parametrize(
    "make, error",
    [
        (lambda: fm.Plane((0, 0, 0), (0, 1)), "three finite"),
        (lambda: fm.Plane((0, 0, 0), (0, 0, 0)), "normal"),
        (lambda: fm.Sphere((0, 0), 1.0), "three finite"),
        (lambda: fm.Sphere((0, 0, 0), -1.0), "radius"),
        (lambda: fm.Cylinder((0, 0, 0), (0, 0, 0), 1.0), "direction"),
        (lambda: fm.Cylinder((0, 0, 0), (0, 0, 1), 0.0), "radius"),
        (lambda: fm.Cone((0, 0, 0), (0, 0, 1), 2.0), "half_angle"),
        (lambda: fm.Torus((0, 0, 0), (0, 0, 1), 1.0, 1.5), "section"),
        (lambda: fm.Extruded(fm.Sphere((0, 0, 0), 1.0)), "in space"),
        (lambda: fm.Extruded(fm.Circle((0, 0), 1.0), first=(0, 0, 1)), "not along the axis"),
        (lambda: fm.Revolved("circle"), "shape"),
        (lambda: fm.Sphere((0, 0, 0), 1.0).move(angle=0.1), "rotation vector"),
        (lambda: fm.Sphere((0, 0, 0), 1.0).move(z=np.nan), "finite"),
        (lambda: fm.Circle((0, 0), 1.0).move(z=0.1), "in the plane"),
    ],
)
def test_bad_input(make, error):
    with pytest.raises(ValueError, match=error):
        make()
