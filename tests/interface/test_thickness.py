# SPDX-License-Identifier: MIT
"""Axisymmetry and thickness: areas, derivatives of all options, forces, refused input."""

from itertools import cycle, product

from mpi4py import MPI

import numpy as np
import pytest
import revolved
from revolved import cylinders, disturbed, on_axis, pressed_cylinders
from scenes import TIGHT, neo_hookean, pressed_blocks, read
from test_operators import dense

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, build, sector

comm = MPI.COMM_WORLD
DEGREES = [(degree, cell) for degree in (1, 2) for cell in ("triangle", "quadrilateral")]


class Sticky(fm.Coulomb):
    """Friction, and adhesion that decreases exponentially."""

    def adhesion(self, gap):
        """Stress and its derivative."""
        pull = 5.0 * np.exp(-gap / 0.02)
        return pull, -pull / 0.02


def frustums(x):
    """Area of the surface of revolution of a polygon (nodes, 2), ordered by radius."""
    x = x[np.argsort(x[:, 0])]
    return np.pi * (x[:-1, 0] + x[1:, 0]) @ np.hypot(*np.diff(x, axis=0).T)


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("basis", ["dual", "standard"])
def test_D_and_M_are_areas_of_frustums(slave, basis):
    """The lower cylinder is wider than the upper one, which covers one of its facets in part."""
    scene = pressed_cylinders(slave=slave, pair={"basis": basis}, gap=0.01)
    scene.problem.equations.evaluate_operators()
    o = scene.contact.operators
    area = frustums(o.x)
    if slave == "upper":
        assert o.weight.sum() == pytest.approx(area, rel=1e-14)
        assert o.cover == pytest.approx(scene.contact.slave.full_cover, rel=1e-13)
    else:
        assert o.weight.sum() < 0.95 * area
    D, M = dense(scene.problem.matrices.D(0)), dense(scene.problem.matrices.M(0))
    assert np.abs(D.sum(axis=1) - M.sum(axis=1)).max() < 1e-14
    if basis == "dual":
        assert np.abs(D - np.diag(np.diag(D))).max() == 0.0
    axis = np.abs(o.x[:, 0]) < 1e-14
    assert axis.sum() == 1 and scene.contact.covered[axis].all()


OPTIONS = [
    {},
    {"gap_weights": "basis"},
    {"gap_weights": "standard"},
    {"basis": "standard"},
    {"law": fm.Coulomb(0.3)},
    {"law": fm.Tresca(2.0)},
    {"law": Sticky(0.3)},
    {"law": fm.Coulomb(0.3), "slip": "operators", "normals": "unit"},
    {"integration": "elements"},
    {"sliding": "small", "law": fm.Coulomb(0.3)},
]


@pytest.mark.once
@pytest.mark.parametrize("axis", [True, False])
@pytest.mark.parametrize("degree, cell", DEGREES)
def test_tangent_is_exact(degree, cell, axis):
    choices = [*OPTIONS]
    if degree == 2:
        choices += [{"basis": "vertices"}, {"basis": "linear"}]
    # Alternate sides: slave and master are exchanged between triangles and quadrilaterals.
    sides = ("upper", "lower") if cell == "triangle" else ("lower", "upper")
    for choice, slave in zip(choices, cycle(sides)):
        holes = (0.0, 0.0) if axis else (0.4, 0.3)
        scene = pressed_cylinders(
            slave=slave, pair=choice, degree=degree, cell=cell, gap=-0.01, holes=holes
        )
        slopes = disturbed(scene).problem.check_tangent(print_table=False).slopes
        assert min(slopes.values()) > 1.9, (choice, slave, slopes)


def pressed_by(tool, data, law, degree=1):
    """The lower cylinder under an obstacle; the upper one is fixed."""
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    fixed = fem.Constant(data.mesh, (0.0, 0.0))
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.neo_hookean(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "lower/top", tool, law=law)],
        bcs=[
            fm.dirichlet(V, data, ["lower/bottom", "upper/top"], fixed),
            on_axis(V, data, ["lower/left", "upper/left"]),
        ],
        geometry="axisymmetric", petsc_options_prefix="axis_",
    )  # fmt: skip
    return revolved.Scene(data, u, problem)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("law", [fm.Frictionless(), fm.Coulomb(0.3), Sticky(0.3)])
def test_tangent_is_exact_on_obstacles(law, degree):
    data = cylinders((3, 7), gap=2.0)
    tools = [
        fm.Circle((0.0, 1.99), 1.0, name="sphere"),
        fm.Plane((0.0, 1.0), (0.3, -1.0), name="cone"),
        fm.Plane((0.0, 1.02), (0.0, -1.0), name="plate"),
        fm.Polygon([(0.3, 1.03), (0.8, 1.03), (0.8, 2.0), (0.3, 2.0)], 0.05, name="punch"),
    ]
    for tool in tools:
        tool.push(y=-1.0)
        scene = disturbed(pressed_by(tool, data, law, degree))
        slopes = scene.problem.check_tangent(print_table=False).slopes
        assert min(slopes.values()) > 1.9, (tool.name, slopes)


@pytest.mark.once
def test_tangent_is_exact_with_a_thickness_of_the_material():
    for degree, slave in product([1, 2], ["upper", "lower"]):
        scene = pressed_blocks(
            slave=slave, degree=degree, n_upper=5, n_lower=4, width_upper=1.3, gap=-0.01,
            pair={"law": fm.Coulomb(0.3)}, problem={"thickness": lambda X: 1.0 + X[:, 0] ** 2},
        )  # fmt: skip
        slopes = disturbed(scene).problem.check_tangent(print_table=False).slopes
        assert min(slopes.values()) > 1.9, (degree, slave, slopes)


def with_thickness(scene, factor, thickness, nu=0.3):
    """The problem of a scene with a thickness, ``factor`` in UFL."""
    v = ufl.TestFunction(scene.u.function_space)
    work = ufl.inner(neo_hookean(scene.u, 100.0, nu), ufl.grad(v))
    return fm.ContactProblem(
        factor * work * ufl.dx(metadata={"quadrature_degree": 5}), scene.u,
        [scene.contact.pair], bcs=scene.problem.equations.bulk.bcs, thickness=thickness,
        newton=TIGHT, petsc_options_prefix="thick_",
    )  # fmt: skip


def test_thickness_multiplies_forces_and_no_pressures():
    """With the same thickness of the bulk, everything except the forces is unchanged."""
    scene = pressed_blocks(n_upper=5, n_lower=7, width_upper=0.8, pair={"law": fm.Coulomb(0.2)})
    scene.loads["push"].value[:] = (0.01, -0.05)
    found = []
    for thickness in (None, 3.0):  # one mesh: two may be distributed differently
        scene.u.x.array[:] = 0.0
        problem = with_thickness(scene, thickness or 1.0, thickness)
        report = problem.solve()
        contact = problem.contacts[0]
        found.append((scene.u.x.array.copy(), contact.pressure, contact.total_force, report))
    (u, p, F, report), (u_thick, p_thick, F_thick, other) = found
    assert np.abs(u - u_thick).max() < 1e-12
    assert np.abs(p - p_thick).max() < 1e-10 * p.max()
    assert F_thick == pytest.approx(3.0 * F, rel=1e-10)
    assert report.num_iterations == other.num_iterations


@pytest.mark.parametrize("degree", [1, 2])
def test_uniform_stress_passes_where_the_thickness_varies(degree):
    """t = 1 + x / 2 and u_y = -0.1 y: with nu = 0 the stress is uniaxial, div (t P) = 0."""
    scene = pressed_blocks(n_upper=5, n_lower=7, width_upper=1.0, width_lower=1.0, degree=degree)
    x = ufl.SpatialCoordinate(scene.data.mesh)
    problem = with_thickness(scene, 1 + x[0] / 2, lambda X: 1.0 + X[:, 0] / 2, nu=0.0)
    nodes = scene.data.mesh.geometry.x[:, 1]
    height = comm.allreduce(float(nodes.max()), MPI.MAX) - comm.allreduce(
        float(nodes.min()), MPI.MIN
    )
    scene.loads["push"].value[1] = -0.1 * height
    problem.solve()
    pressure = problem.contacts[0].pressure
    assert np.ptp(pressure) < 1e-11 * pressure.max()
    assert pressure.max() == pytest.approx(50.0 * (1 / 0.9 - 0.9), rel=1e-11)


@pytest.mark.once
def test_all_solvers_agree():
    found = []
    for options in (
        {},
        {"algorithm": "saddle"},
        {"solver": "iterative"},
        {"solver": "iterative", "algorithm": "saddle"},
    ):
        scene = pressed_cylinders(counts=(9, 12), problem=options, pair={"law": fm.Coulomb(0.3)})
        scene.loads["push"].value[1] = -0.05
        scene.problem.solve()
        certificate = scene.problem.certificate()
        assert certificate.violations() == [] and certificate.balance < 1e-12
        found.append(scene.contact.z)
    for z in found[1:]:
        assert np.abs(z - found[0]).max() < 1e-7 * np.abs(found[0]).max()


@pytest.mark.once
@pytest.mark.parametrize("sliding", ["finite", "small"])
def test_linear_bulk_is_factored_once(sliding):
    found = []
    for linear_bulk in (True, False):
        scene = pressed_cylinders(
            material=revolved.linear_elastic, pair={"sliding": sliding},
            problem={"linear_bulk": linear_bulk},
        )  # fmt: skip
        scene.loads["push"].value[1] = -0.05
        scene.problem.solve()
        found.append(scene.contact.z)
    assert np.abs(found[0] - found[1]).max() < 1e-10 * np.abs(found[0]).max()


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_estimate_is_finite_and_falls_with_the_mesh(degree):
    totals = []
    for n in (1, 2):
        scene = pressed_cylinders(counts=(4 * n, 5 * n), layers=2 * n, degree=degree)
        scene.loads["push"].value[1] = -0.05
        scene.problem.solve()
        estimate = scene.problem.estimate()
        assert np.isfinite(estimate.cells).all()
        totals.append(estimate.relative)
    assert totals[1] < 0.8 * totals[0]


@pytest.mark.once
def test_a_body_free_along_the_axis_is_found_and_pressed_by_a_total_force():
    """The only rigid motion of a body of revolution is along the axis."""
    data = cylinders((5, 7), bulge=False)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    X, ds = ufl.SpatialCoordinate(data.mesh), ufl.Measure("ds", subdomain_data=data.facet_tags)
    load = 2 * np.pi * X[0] * 2.0 * v[1] * ds(data.boundary_tag("upper/top"))
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.neo_hookean(u, 100.0, 0.3)) + load, u,
        [fm.ContactPair(data, "upper/bottom", "lower/top")],
        bcs=[
            fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)),
            on_axis(V, data, ["lower/left", "upper/left"]),
        ],
        geometry="axisymmetric", petsc_options_prefix="axis_",
    )  # fmt: skip
    (body,) = problem.equations.floating.bodies
    assert np.abs(body.motions) == pytest.approx(np.array([[0.0, 1.0, 0.0]]), abs=1e-9)
    problem.solve()
    assert problem.contacts[0].total_force[1] == pytest.approx(2.0 * np.pi, rel=1e-9)
    assert problem.certificate().balance < 1e-8


def test_a_floating_ring_is_free_along_the_axis_only():
    scene = pressed_cylinders(holes=(0.5, 0.5), upper_is_prescribed=False)
    (body,) = scene.problem.equations.floating.bodies
    assert np.abs(body.motions) == pytest.approx(np.array([[0.0, 1.0, 0.0]]), abs=1e-9)
    with pytest.raises(fm.MortarError, match=r"upper.* can move along \(0, 1\)"):
        scene.problem.solve()


def test_an_obstacle_pushed_along_the_axis_feels_the_total_force():
    data = cylinders((3, 7), gap=2.0)
    sphere = fm.Circle((0.0, 2.05), 1.0, name="sphere")
    sphere.push(y=-3.0)
    problem = pressed_by(sphere, data, fm.Frictionless()).problem
    report = problem.solve()
    assert problem.contacts[0].total_force[1] == pytest.approx(-3.0, rel=1e-9)
    assert sphere.reaction == pytest.approx([0.0, 3.0, 0.0], rel=1e-9)  # all around the axis
    assert any(note.endswith("axial contact force 3") for note in report.notes)
    sphere.push(x=0.0)
    with pytest.raises(fm.MortarError, match="sphere.*moves along its axis only"):
        problem.solve()


def test_model_check_of_small_strains_and_of_a_rigid_sphere():
    """With an elastic sphere, ten times as stiff, the force is smaller by 1 / 11 (Hertz)."""
    centre = (0.0, 2.0)
    sphere = sector(40, 12, radii=(0.2, 1.0), angles=(-np.pi / 2, 0.0), centre=centre)
    data = cylinders((3, 60), gap=2.0, bulge=False, layers=12)
    ball = read(build, grids=[Grid("ball", sphere)])
    W = fm.vector_space(ball.mesh, 1)
    w = fem.Function(W)
    circle = fm.Circle((0.0, 2.0 - 0.01), 1.0, name="sphere")
    tool = fm.ElasticObstacle(
        circle, revolved.internal(w, revolved.linear_elastic(w, 1000.0, 0.3)), w, ball,
        "ball/bottom",
        bcs=[fm.dirichlet(W, ball, "ball/right", (0.0, 0.0)), on_axis(W, ball, "ball/left")],
    )  # fmt: skip
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    rich = revolved.internal(u, revolved.neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "lower/top", circle, sliding="small")],
        bcs=[
            fm.dirichlet(V, data, ["lower/bottom", "upper/top"], (0.0, 0.0)),
            on_axis(V, data, ["lower/left", "upper/left"]),
        ],
        geometry="axisymmetric", petsc_options_prefix="axis_",
        model_check=fm.ModelCheck(0.05, finite_strain=rich, elastic_obstacles=[tool]),
    )  # fmt: skip
    report = problem.solve()
    errors = {a.name: a.errors["total force"] for a in report.model_check.assumptions}
    assert errors["linear strain"] < 0.01
    assert 0.07 < errors["rigid sphere"] < 0.13
