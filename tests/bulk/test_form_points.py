# SPDX-License-Identifier: MIT
"""Cells are judged where the form is evaluated, and not at all with linear strains."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import neo_hookean
from space_scenes import held, solid

import basix
import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.bulk.checks import _assembled
from fenics_mortar.bulk.fluxes import FormPoints
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.verify.overlap import are_folds
from meshes.mapped_grids import Grid, block, mapped, mesh

I = ufl.Identity(2)


def with_logarithm(u, mu=1.0, lmbda=20.0):
    return energies.neo_hookean(u, mu, lmbda)


def with_polynomial(u, mu=1.0, lmbda=20.0):
    F = energies.deformation_gradient(u)
    J = ufl.det(F)
    return mu / 2 * (ufl.tr(F.T * F) - 2) - mu * ufl.ln(J) + lmbda / 2 * (J - 1) ** 2


def saint_venant(u):
    return energies.st_venant_kirchhoff(u, 4.0, 8.0)


def hardening(u):
    """Small strains, a law that is not linear."""
    e = ufl.sym(ufl.grad(u))
    s = ufl.sqrt(1e-4 + ufl.inner(ufl.dev(e), ufl.dev(e)))
    return ufl.conditional(ufl.gt(s, 0.1), s, 5 * s**2) + ufl.div(u) ** 2


def by_components(u):
    g = [[u[i].dx(j) for j in range(2)] for i in range(2)]
    return (g[0][0] ** 2 + g[1][1] ** 2 + 0.5 * (g[0][1] + g[1][0]) ** 2) ** 2


# A pad bonded between plates


def pad(rows, energy=with_logarithm, *, degree=2, cell="quadrilateral", push=0.0):
    data = mesh(
        [Grid("pad", block(2 * rows * degree, rows * degree, width=2.0, height=1.0))],
        cell=cell,
        order=degree,
    )
    V = fm.vector_space(data.mesh, degree)
    u, top = fem.Function(V), fem.Constant(data.mesh, (0.0, push))
    dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 1})
    bcs = [fm.dirichlet(V, data, "pad/bottom", (0.0, 0.0)), fm.dirichlet(V, data, "pad/top", top)]
    residual = ufl.derivative(energy(u) * dx, u, ufl.TestFunction(V))
    problem = fm.ContactProblem(residual, u, [], bcs=bcs, petsc_options_prefix="pad_")
    return problem, top


@pytest.mark.serial
@pytest.mark.parametrize("rows, energy", [(2, with_logarithm), (3, with_polynomial)])
def test_a_bonded_pad_is_compressed_although_cells_are_inverted_at_corners(rows, energy):
    """Two cells at each end of a plate, where the strain is unbounded on any mesh."""
    problem, top = pad(rows, energy)

    def press(time):
        top.value[1] = -0.5 * time

    path = fm.follow_path(problem, press, fm.SteppingOptions(step=0.2, smallest=0.02))
    assert path.finished
    report = path.steps[-1].report
    assert report.certificate.inverted == 0
    (remark,) = (note for note in report.notes if "inverted" in note)
    assert "4 cells are inverted at nodes" in remark and "quadrature degree" in remark


def test_a_pad_without_a_barrier_ends_where_cells_have_no_area():
    """Of the law of St. Venant-Kirchhoff; the corner cells at the plates are flat at the end."""
    problem, top = pad(4, lambda u: energies.st_venant_kirchhoff(u, 1.0, 20.0))

    def press(time):
        top.value[1] = -time

    steps = fm.SteppingOptions(step=0.02, smallest=1e-3, largest=0.02)
    with pytest.raises(fm.NotConvergedError, match="cells are inverted, one at") as error:
        fm.follow_path(problem, press, steps, stop=0.5)
    assert "take fm.energies.neo_hookean" in str(error.value)
    assert error.value.report.steps[-1].time == pytest.approx(0.29, abs=0.01)
    u = problem.equations.bulk.u
    points, _ = basix.make_quadrature(basix.CellType.quadrilateral, 5)
    J = compat.create_expression(ufl.det(I + ufl.grad(u)), points)
    on, cells = u.function_space.mesh, problem.equations.bulk.form_points._finite[0].cells
    least = compat.evaluate_expression(J, on, cells.astype(np.int32)).min(initial=1.0)
    assert 0.0 < on.comm.allreduce(float(least), MPI.MIN) < 0.05


@pytest.mark.parametrize("energy", [saint_venant, with_logarithm])
def test_a_state_inverted_where_the_form_is_evaluated_is_a_violation(energy):
    """A form without a barrier is finite there; its stress is that of no deformation."""
    problem, _ = pad(2, energy)
    u = problem.equations.bulk.u
    u.interpolate(lambda x: (0.0 * x[0], np.where(x[0] > 1.4, -2.0 * x[1], 0.0 * x[1])))
    certificate = problem.certificate()
    assert certificate.inverted > 0 and not certificate.inverted_nodes
    assert any("cells are inverted" in violation for violation in certificate.violations())


# The points


def points_of(residual, u):
    return FormPoints(residual, u, DisplacementSpace(u.function_space))


def squares(**options):
    """The bodies "one" and "two", side by side."""
    return mesh(
        [
            Grid(name, block(2, 2, width=1.0, height=1.0, corner=(x, 0.0)))
            for name, x in (("one", 0.0), ("two", 2.0))
        ],
        **options,
    )


def square(degree=1, cell="quadrilateral"):
    data = squares(cell=cell)
    V = fm.vector_space(data.mesh, degree)
    return data, fem.Function(V), ufl.TestFunction(V)


@pytest.mark.each
@pytest.mark.parametrize(
    "energy, finite",
    [
        (with_logarithm, True),
        (saint_venant, True),
        (hardening, False),
        (by_components, False),
        (lambda u: ufl.inner(ufl.grad(u), ufl.grad(u)) * (1 + u[0] ** 4), True),
        (lambda u: ufl.inner(ufl.grad(u), ufl.grad(u)), False),
    ],
)
def test_finite_strains_are_recognized(energy, finite):
    _, u, v = square()
    residual = ufl.derivative(energy(u) * ufl.dx(degree=2), u, v) - u[1] ** 3 * v[1] * ufl.ds
    assert points_of(residual, u).any == finite


@pytest.mark.parametrize("energy, finite", [(hardening, False), (with_logarithm, True)])
def test_finite_strains_of_mixed_functions_are_recognized(energy, finite):
    data, _, _ = square(cell="triangle")
    W = fm.mixed_space(data.mesh, ("Lagrange", 1), ("Lagrange", 2, (2,)))
    w = fem.Function(W)
    p, u = ufl.split(w)
    residual = ufl.derivative((energy(u) + p**4 + p * ufl.div(u)) * ufl.dx(degree=2), w)
    assert FormPoints(residual, w, DisplacementSpace(W, 1)).any == finite


def folded(places, x):
    """Positions at which a parabola in y inverts cells at y = 0 and not at the Gauss points."""
    return np.stack([places[:, 0], x(places[:, 1])], axis=1)


def test_each_integral_is_judged_at_its_own_points():
    """Quadratic motions with dx/dX = 1 - 1.3 (1 - y): negative below y = 0.231.

    Gauss points of degree 2 begin at 0.211 in a cell, those of degree 1 at 0.5.
    """
    data = squares(order=2)
    V = fm.vector_space(data.mesh, 2)
    u, v = fem.Function(V), ufl.TestFunction(V)
    space, tags = DisplacementSpace(V), data.cell_tags
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=tags)
    X = V.tabulate_dof_coordinates()[:, :2]
    x = folded(X, lambda y: y - 1.3 * (y - y**2 / 2))
    one, two = data.bodies["one"], data.bodies["two"]
    counts = []
    for first, second in ((1, 2), (1, 1), (2, 2)):
        energies = [with_logarithm(u) * dx(b, degree=d) for b, d in ((one, first), (two, second))]
        residual = ufl.derivative(sum(energies), u, v)
        inverted = FormPoints(residual, u, space).inverted(x)
        where = np.flatnonzero(inverted)
        assert np.isin(
            where, tags.find(two if first == 1 else one).tolist() + tags.find(two).tolist()
        ).all()
        counts.append(data.mesh.comm.allreduce(int(inverted.sum())))
    assert counts == [1, 0, 2]
    linear = ufl.derivative(hardening(u) * dx(one, degree=2), u, v)
    finite = ufl.derivative(with_logarithm(u) * dx(two, degree=2), u, v)
    found = FormPoints(linear + finite, u, space).inverted(x)
    assert data.mesh.comm.allreduce(int(found.sum())) == 1


@pytest.mark.each
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_points_are_those_of_given_and_estimated_rules(cell):
    _, u, v = square(degree=2, cell=cell)
    kind = getattr(basix.CellType, cell)
    X = u.function_space.tabulate_dof_coordinates()[:, :2]
    given = {"vertex": {"quadrature_rule": "vertex", "quadrature_degree": 1}}
    given["custom"] = {
        "quadrature_rule": "custom",
        "quadrature_points": np.array([[0.2, 0.3]]),
        "quadrature_weights": np.array([1.0]),
    }
    for metadata, count in ((given["vertex"], len(basix.geometry(kind))), (given["custom"], 1)):
        residual = ufl.derivative(with_logarithm(u) * ufl.dx(metadata=metadata), u, v)
        (group,) = points_of(residual, u)._finite
        assert len(group.gradients) == count
    residual = ufl.derivative(saint_venant(u) * ufl.dx, u, v)
    (group,) = points_of(residual, u)._finite
    # quadratic displacements: grad u has the degree 1, on quadrilaterals 4
    assert len(group.gradients) >= len(np.unique(X[0])) + 2
    assert points_of(residual, u).inverted(-X).sum() == 0


# Linear strains


def cone_on_block(half_angle, depth, *, degree=1, cell="quadrilateral", columns=24, **options):
    """A rigid cone pressed into a linear elastic block, small sliding."""

    def graded(s):
        return 20.0 * np.sinh(5.0 * s) / np.sinh(5.0)

    grid = mapped(columns, columns, lambda s, t: (graded(s), -graded(1 - t)))
    data = mesh([Grid("block", grid)], cell=cell, order=degree)
    V = fm.vector_space(data.mesh, degree)
    u, v, r = fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(data.mesh)[0]
    strain = energies.strain(u, "axisymmetric")
    energy = energies.linear_elastic(strain, *energies.lame(1.0, 0.3))
    residual = ufl.derivative(2 * np.pi * r * energy * ufl.dx(degree=2 * degree + 1), u, v)
    t = 30.0 * np.tan(np.radians(half_angle))
    cone = fm.Polygon([(t, 30.0), (0.0, 0.0), (-t, 30.0)], rounding=0.02)
    bcs = [fm.dirichlet(V, data, "block/left", 0.0, component=0)]
    bcs.append(fm.dirichlet(V, data, "block/bottom", 0.0, component=1))
    pair = fm.ContactPair(data, "block/top", cone, sliding="small")
    options = {"geometry": "axisymmetric", "petsc_options_prefix": "cone_", **options}
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, **options)
    cone.move(y=-depth)
    return problem


@pytest.mark.parametrize(
    "options", [{}, {"linear_bulk": False}, {"degree": 2, "cell": "triangle", "columns": 32}]
)
def test_a_cone_is_pressed_into_a_linear_elastic_block(options):
    """Sneddon's force 2 E tan(alpha) d^2 / (pi (1 - nu^2)); cells at the tip are inverted."""
    problem = cone_on_block(70.3, 1.0, **options)
    report = problem.solve()
    force = problem.contacts[0].total_force[1]
    theory = 2.0 * np.tan(np.radians(70.3)) / (np.pi * (1.0 - 0.3**2))
    assert abs(force) == pytest.approx(theory, rel=0.15)  # the block is 11 contact radii large
    assert report.num_iterations <= 6
    (remark,) = (note for note in report.notes if "inverted" in note)
    assert "the strains are not small" in remark
    assert report.certificate.inverted == 0


@pytest.mark.once
def test_a_fold_under_a_cone_is_not_a_crossing():
    """At the tip the surface crosses the axis."""
    problem = cone_on_block(45.0, 1.0)
    problem.solve()
    crossings = problem.equations.crossings
    assert max((crossing.facets for crossing in crossings.find()), default=0.0) < 1e-6
    crossings._slide_little = np.empty(0)
    assert crossings.find()[0].facets > 1.0


@pytest.mark.parametrize("x, crossed, is_fold", [
    ([(0, 0), (1, 1), (1, 0), (0, 1)], (0, 2), True),  # a bow: one half is inverted
    ([(np.cos(0.8 * k * np.pi), np.sin(0.8 * k * np.pi)) for k in range(5)], (0, 2), False),
])  # fmt: skip
def test_a_bow_is_a_fold_and_a_pentagram_overlaps_itself(x, crossed, is_fold):
    x = np.array(x, float)
    segments = np.stack([np.arange(len(x)), np.roll(np.arange(len(x)), -1)], axis=1)
    (a, b), (c, d) = x[segments[list(crossed)]]
    s, _ = np.linalg.solve(np.stack([b - a, c - d], axis=1), c - a)
    row = np.array([[*crossed, 1.0, 1.0, *(a + s * (b - a))]])
    assert are_folds(x, segments, np.zeros(len(x), int), row).tolist() == [is_fold]


def test_the_energy_of_the_scenes_has_finite_strains():
    _, u, v = square()
    residual = ufl.inner(neo_hookean(u, 1.0, 0.3), ufl.grad(v)) * ufl.dx(degree=2)
    assert points_of(residual, u).any


# Rules of one point


def reduced(cell, order):
    """Deviatoric work by a full rule, and volumetric work by one point; the space and ``u``."""
    x = block(4, 4, width=1.0, height=1.0)
    x[..., 0] += 0.1 * x[..., 1] ** 2
    data = mesh([Grid("pad", x)], cell=cell, order=order)
    V = fm.vector_space(data.mesh, order)
    u, v = fem.Function(V), ufl.TestFunction(V)
    full, one = (ufl.dx(metadata={"quadrature_degree": degree}) for degree in (4, 1))
    e = ufl.sym(ufl.grad(u))
    parts = ufl.inner(ufl.dev(e), ufl.sym(ufl.grad(v))) * full, 9.0 * ufl.div(u) * ufl.div(v) * one
    return data, V, u, parts


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("order", [1, 2])
def test_rules_of_one_point_are_right_or_refused(cell, order):
    """FFCx 0.5 evaluates the sum of both integrals at wrong points, but on straight triangles."""
    data, V, u, parts = reduced(cell, order)
    u.interpolate(lambda x: np.stack([x[0] * x[1], x[1] ** 2]))
    whole, *others = (_assembled(part, u) for part in (sum(parts), *parts))
    wrong = np.abs(whole - sum(others)).max(initial=0.0) > 1e-9
    wrong = data.mesh.comm.allreduce(bool(wrong), MPI.LOR)
    bcs = [fm.dirichlet(V, data, "pad/bottom", (0.0, 0.0))]
    given = {"bcs": bcs, "petsc_options_prefix": "one_"}
    if wrong:
        with pytest.raises(fm.MortarError, match="evaluates the residual at wrong points"):
            fm.ContactProblem(sum(parts), u, [], **given)
    else:
        fm.ContactProblem(sum(parts), u, [], **given)
    assert np.abs(u.x.array).max(initial=1.0) >= 1.0 and not (
        wrong and (cell, order) == ("triangle", 1)
    )


@pytest.mark.each
@pytest.mark.parametrize(
    "cell, order, degree, few",
    [
        ("hexahedron", 2, 3, True),  # 8 points for 81 dofs
        ("hexahedron", 2, 4, False),
        ("hexahedron", 1, 1, True),
        ("hexahedron", 1, 3, False),
        ("tetrahedron", 1, 0, False),
        ("tetrahedron", 2, 1, True),
        ("tetrahedron", 2, 2, False),
    ],
)
def test_forms_with_too_few_points_are_named_where_newton_fails(cell, order, degree, few):
    """Motions that no point of a cell resists are the reason in the message of a failed solve."""
    scene = solid(cell, order, counts=(2, 2, 1), jiggle=0.0)
    psi = fm.energies.neo_hookean(scene.u, *fm.energies.lame(100.0, 0.3))
    scene.residual = ufl.derivative(psi * ufl.dx(degree=degree), scene.u)
    held(scene)
    held(scene, (0.0, 0.0, -0.3), "block/top")
    with pytest.raises(fm.NotConvergedError) as caught:
        scene.set_up(newton=fm.NewtonOptions(max_iterations=1)).problem.solve()
    said = f"too few points in {4 if cell == 'hexahedron' else 24} cells"
    assert (said in str(caught.value)) == few
