# SPDX-License-Identifier: MIT
"""Bodies of revolution on a half space: Hertz's and Sneddon's solutions."""

import numpy as np
import pytest
import revolved
from revolved import graded, internal, on_axis
from scenes import read

from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from meshes.mapped_grids import Grid, build

# Hertz and Sneddon: a half space z < 0 with E* = 1 under bodies that it touches for r < 1

NU_SPACE = 0.3
SLOPE = 1e-3  # of the bodies at r = 1, so that the theory of small slopes holds
PRESSED, FAR, AXIS = 1, 2, 3


def point_load(force):
    """Displacement by Boussinesq of the half space under a force at the origin, as a function."""
    G = (1 - NU_SPACE) / 2  # of E* = 1

    def field(X):
        r, depth = X[0], -X[1]
        rho = np.maximum(np.hypot(r, depth), 1e-9)
        out = np.maximum(rho + depth, 1e-9)
        radial = r * depth / rho**3 - (1 - 2 * NU_SPACE) * r / (rho * out)
        down = depth**2 / rho**3 + 2 * (1 - NU_SPACE) / rho
        return force / (4 * np.pi * G) * np.stack([radial, -down])

    return field


def pressed_space(count, body, force, *, reach, degree=1, size=30.0, growth=0.2):
    """A half space under a rigid ``body``; far away it has the displacement by a point load.

    Args:
        count: Facets over a length of 1.
        body: The obstacle.
        force: The point load.
        reach: Part of the surface that may touch, r < reach.
        degree: Degree of displacements.
        size: Extent of the mesh.
        growth: Growth of the cells away from the body, from one to the next [1].
    """
    x = graded(1.0 / count, round(reach * count), growth, size)
    grid = np.stack(np.meshgrid(x, -x[::-1], indexing="ij"), axis=2)
    mesh = read(build, grids=[Grid("space", grid)]).mesh
    edge = size * (1 - 1e-9)
    places = {
        PRESSED: lambda X: np.isclose(X[1], 0.0) & (X[0] < reach * (1 + 1e-9)),
        FAR: lambda X: (X[0] > edge) | (X[1] < -edge),
        AXIS: lambda X: np.isclose(X[0], 0.0),
    }
    found = [dmesh.locate_entities_boundary(mesh, 1, at) for at in places.values()]
    facets, tags = np.concatenate(found), np.repeat(list(places), [len(f) for f in found])
    order = np.argsort(facets)
    tags = dmesh.meshtags(mesh, 1, facets[order], tags[order].astype(np.int32))
    data = fm.MeshData(mesh, None, tags)
    V = fm.vector_space(mesh, degree)
    u, far = fem.Function(V), fem.Function(V)
    far.interpolate(point_load(force))
    problem = fm.ContactProblem(
        internal(u, revolved.linear_elastic(u, 1 - NU_SPACE**2, NU_SPACE)), u,
        [fm.ContactPair(data, PRESSED, body)],
        bcs=[fm.dirichlet(V, data, FAR, far), on_axis(V, data, AXIS)],
        geometry="axisymmetric", petsc_options_prefix="space_",
    )  # fmt: skip
    problem.solve()
    contact = problem.equations.contacts[0]
    return contact.operators.x[:, 0], contact.pressure, contact.operators.weight, problem


def elastic_ball(count, growth=0.2):
    """A ball on a half space of the same material, E* = 1/2, by far fields of point loads."""
    force, size = 2 / 3 * SLOPE, 30.0
    grids = []
    for name, n in (("ball", count), ("space", round(0.7 * count))):
        x = graded(1.0 / n, round(1.5 * n), growth, size)
        r, depth = np.meshgrid(x, -x[::-1], indexing="ij")
        sphere = 1 / SLOPE - np.sqrt(1 / SLOPE**2 - r**2)
        z = depth if name == "space" else sphere - depth * (1 - sphere / size)
        grids.append(Grid(name, np.stack([r, z], axis=2)))
    data = read(build, grids=grids)
    V = fm.vector_space(data.mesh, 1)
    u, below, above = fem.Function(V), fem.Function(V), fem.Function(V)
    field = point_load(force)
    below.interpolate(lambda X: field(X))
    above.interpolate(lambda X: [[1], [-1]] * field([[1], [-1], [1]] * X) - [[0], [SLOPE]])
    # in the grid of the ball depth runs down: its bottom is the side at the space
    problem = fm.ContactProblem(
        internal(u, revolved.linear_elastic(u, 1 - NU_SPACE**2, NU_SPACE)), u,
        [fm.ContactPair(data, "ball/top", "space/top")],
        bcs=[
            fm.dirichlet(V, data, ["space/bottom", "space/right"], below),
            fm.dirichlet(V, data, ["ball/bottom", "ball/right"], above),
            on_axis(V, data, ["ball/left", "space/left"]),
        ],
        geometry="axisymmetric", petsc_options_prefix="ball_",
    )  # fmt: skip
    problem.solve()
    contact = problem.equations.contacts[0]
    return contact.operators.x[:, 0], contact.pressure, contact.operators.weight


def second_moment(r, p, w):
    """Mean of r^2 weighted by the forces p w of the nodes."""
    return (p * w) @ r**2 / (p @ w)


def error_of_hertz(r, p, w, force):
    """Error of the pressure in L2 (D), relative to Hertz with the radius 1."""
    exact = 1.5 * force / np.pi * np.sqrt(np.maximum(1 - r**2, 0.0))
    return np.sqrt((p - exact) ** 2 @ w / (exact**2 @ w))


@pytest.mark.once
def test_rigid_sphere_on_a_half_space():
    """a^3 = 3 F R / (4 E*), p0 = 1.5 F / (pi a^2); at the edge p is of class C^1/2: first order."""
    force, errors, peaks = 4 / 3 * SLOPE, [], []
    for count in (10, 20):
        sphere = fm.Circle((0.0, 1 / SLOPE - SLOPE), 1 / SLOPE)
        r, p, w, _ = pressed_space(count, sphere, force, reach=1.5)
        errors.append(error_of_hertz(r, p, w, force))
        peaks.append(p[r.argmin()] / (1.5 * (p @ w) / np.pi) - 1)
    assert errors[1] < 0.03 and 0.9 < np.log2(errors[0] / errors[1]) < 1.2
    assert p @ w == pytest.approx(force, rel=0.004)
    assert np.sqrt(2.5 * second_moment(r, p, w)) == pytest.approx(1.0, rel=0.002)
    assert abs(peaks[1]) < 0.012 and np.log2(peaks[0] / peaks[1]) > 0.9


@pytest.mark.serial
def test_rigid_sphere_with_displacements_of_degree_2():
    force, sphere = 4 / 3 * SLOPE, fm.Circle((0.0, 1 / SLOPE - SLOPE), 1 / SLOPE)
    r, p, w, _ = pressed_space(10, sphere, force, reach=1.5, degree=2)
    assert error_of_hertz(r, p, w, force) < 0.015
    assert p @ w == pytest.approx(force, rel=5e-4)
    assert np.sqrt(2.5 * second_moment(r, p, w)) == pytest.approx(1.0, rel=5e-4)
    assert p[r.argmin()] == pytest.approx(1.5 * (p @ w) / np.pi, rel=0.003)


@pytest.mark.once
def test_elastic_ball_on_a_half_space():
    """On the axis the pressure of linear displacements is of first order."""
    force, errors, peaks = 2 / 3 * SLOPE, [], []
    for count in (10, 20):
        r, p, w = elastic_ball(count)
        errors.append(error_of_hertz(r, p, w, force))
        peaks.append(p[r.argmin()] / (1.5 * (p @ w) / np.pi) - 1)
    assert errors[1] < 0.03 and 0.9 < np.log2(errors[0] / errors[1]) < 1.2
    assert p @ w == pytest.approx(force, rel=0.004)
    assert np.sqrt(2.5 * second_moment(r, p, w)) == pytest.approx(1.0, rel=0.002)
    assert abs(peaks[1]) < 0.025 and np.log2(peaks[0] / peaks[1]) > 0.9


@pytest.mark.once
def test_rigid_cone_on_a_half_space():
    """Sneddon: F = pi / 2 E* a^2 s for the slope s, p = E* s / 2 arcosh(a / r)."""
    force = np.pi / 2 * SLOPE
    cone = fm.Plane((0.0, -np.pi / 2 * SLOPE), (SLOPE, -1.0))
    r, p, w, _ = pressed_space(20, cone, force, reach=1.5)
    assert p @ w == pytest.approx(force, rel=0.004)
    assert np.sqrt(3 * second_moment(r, p, w)) == pytest.approx(1.0, rel=0.002)
    between = (r > 0.15) & (r < 0.85)
    assert p[between] == pytest.approx(SLOPE / 2 * np.arccosh(1 / r[between]), rel=0.03)


@pytest.mark.once
def test_flat_punch_on_a_half_space():
    """Boussinesq: F = 2 E* a d, p = F / (2 pi a sqrt(a^2 - r^2)); singular: first order in F."""
    force, errors = 2 * SLOPE, []
    for count in (10, 20):
        punch = fm.Plane((0.0, -SLOPE), (0.0, -1.0))
        r, p, w, _ = pressed_space(count, punch, force, reach=1.0)
        errors.append(p @ w / force - 1)
    assert errors[1] < 0.02 and 1.7 < errors[0] / errors[1] < 2.3
    inside = r < 0.7
    exact = force / (2 * np.pi * np.sqrt(1 - r[inside] ** 2))
    assert p[inside] == pytest.approx(exact, rel=0.025)
