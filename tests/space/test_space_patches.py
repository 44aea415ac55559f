# SPDX-License-Identifier: MIT
"""Patch tests of contacts and ties in space: constant stress, balance of forces and moments."""

from itertools import product

import numpy as np
import pytest
from refusal import refused
from space_pairs import KINDS, ROLES, TILTED, UPRIGHT, YOUNG, off, stack

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.interface.reference import functions_of, rule_of_triangles, tabulate

EXACT = {"discretization": fm.Discretization(points=36)}
STRETCH = 0.9
# Without lateral stress, as Poisson's ratio is zero.
PRESSURE = -YOUNG / 2 * (STRETCH - 1 / STRETCH)


def compressed(x):
    """Displacement of both blocks where the stretch is ``STRETCH`` along z."""
    return np.stack([0.0 * x[0], 0.0 * x[0], (STRETCH - 1.0) * (x[2] + 0.5)])


def errors(scene):
    """Errors of displacement and traction, each relative; the certificate has no violations."""
    report = scene.move(0.0, 0.0, STRETCH - 1.0)
    assert report.certificate.violations() == [] and report.certificate.balance < 1e-13
    pair = report.certificate.pairs[0]
    assert max(pair["force"].value, pair["moment"].value) < 1e-13
    contact, carries = scene.contact, scene.problem.equations.contacts[0].may_carry
    assert (contact.active == carries).all()
    along_normals = PRESSURE * contact.normals[carries]
    assert np.abs(contact.tractions[carries] - along_normals).max() < 1e-3 * PRESSURE
    assert np.abs(contact.shear).max() < 1e-3 * PRESSURE
    return off(scene, compressed), np.abs(contact.pressure / PRESSURE - 1.0).max()


@pytest.mark.parametrize("turn", [UPRIGHT, TILTED], ids=["upright", "tilted"])
@pytest.mark.parametrize("tie", [False, True], ids=["contact", "tie"])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_uniform_pressure_passes_any_straight_facets(cell, degree, tie, turn):
    for roles in ROLES:
        scene = stack(cell, degree, turn=turn).press().set_up(tie=tie, roles=roles, pair=EXACT)
        of_u, of_p = errors(scene)
        assert of_u < 1e-12 and of_p < 1e-11


QUADRATIC = {"discretization": fm.Discretization(basis="quadratic", points=36)}


@pytest.mark.parametrize("turn", [UPRIGHT, TILTED], ids=["upright", "tilted"])
@pytest.mark.parametrize("tie", [False, True], ids=["contact", "tie"])
@pytest.mark.parametrize("lower", [(2, 3, 1), (5, 4, 1)])
def test_uniform_pressure_passes_quadratic_multipliers(lower, tie, turn):
    for roles in ROLES:
        scene = stack("tetrahedron", 2, turn=turn, lower=lower).press()
        of_u, of_p = errors(scene.set_up(tie=tie, roles=roles, pair=QUADRATIC))
        contact = scene.problem.equations.contacts[0]
        assert of_u < 1e-12 and of_p < 1e-11 and contact.may_carry.all()


def test_quadratic_multipliers_are_dual_to_functions_of_positive_integral():
    functions, (points, weights) = functions_of(6, "quadratic"), rule_of_triangles(6)
    N = tabulate(points, 6)[:, 0]
    D = 2.0 * (functions @ N.T * weights) @ N
    assert functions.sum(axis=0) == pytest.approx(np.ones(6))
    assert D.sum(axis=1) == pytest.approx(np.repeat([2 / 15, 1 / 5], 3))
    exact = np.diag(np.repeat([2 / 15, 1 / 3], 3))
    exact[[3, 3, 4, 4, 5, 5], [0, 1, 1, 2, 2, 0]] = -1 / 15
    assert D == pytest.approx(exact, abs=1e-14)
    assert (functions_of(3, "quadratic") == np.eye(3)).all()  # of fields of degree 1 on ties


@pytest.mark.once
@pytest.mark.parametrize("cell, degree", KINDS)
def test_uniform_pressure_passes_if_one_side_is_much_finer(cell, degree):
    for roles in ROLES:
        scene = stack(cell, degree, upper=(5, 4, 1), lower=(1, 2, 1), turn=TILTED).press()
        of_u, of_p = errors(scene.set_up(roles=roles, pair=EXACT))
        assert of_u < 1e-12 and of_p < 1e-10


@pytest.mark.once
@pytest.mark.parametrize("cell, degree", KINDS[2:])
def test_cells_of_order_2_with_straight_edges_are_those_of_order_1(cell, degree):
    jiggle = 0.2 if cell == "hexahedron" else 0.0  # diagonals of jiggled squares would bend
    scene = stack(cell, degree, order=2, jiggle=jiggle, turn=TILTED).press().set_up(pair=EXACT)
    of_u, of_p = errors(scene)
    assert of_u < 1e-12 and of_p < 1e-11


@pytest.mark.once
@pytest.mark.parametrize("tie", [False, True], ids=["contact", "tie"])
@pytest.mark.parametrize("cell, degree", KINDS[2:])
def test_edges_that_bend_within_the_surface_leave_an_error(cell, degree, tie):
    """Common parts are polygons of straight pieces; forces balance all the same."""
    found = []
    for n in (1, 2):
        counts = {"upper": (3 * n, 2 * n, 1), "lower": (2 * n, 3 * n, 1)}
        scene = stack(cell, degree, order=2, bend=0.1, jiggle=0.0, quadrature=6, **counts)
        found.append(errors(scene.press().set_up(tie=tie, pair=EXACT)))
    assert found[0][0] < 1e-5 and found[0][1] < 1e-3
    assert found[1][0] < 0.2 * found[0][0]


def test_default_rule_passes_to_the_error_of_its_quadrature():
    for cell, degree, bound in (("hexahedron", 1, 1e-8), ("hexahedron", 2, 1e-10)):
        scene = stack(cell, degree, turn=TILTED).press().set_up()
        assert errors(scene)[1] < bound


GRADIENT = np.array([[0.1, 0.0, -0.1], [0.0, 0.0, 0.0], [0.2, 0.0, -0.2]])


# Jiggle of the meshes, and bound of the error of a strain that passes a tie: jiggled quadrilaterals
# are no parallelograms, on which the rule of 36 points is not exact.
JIGGLED = [(0.0, 1e-13), (0.1, 1e-10)]


def error_behind_a_tie(scene, gradient, names, roles):
    """Largest error of a homogeneous strain, prescribed on boundaries, that passes a tie."""
    V = scene.u.function_space
    exact = fem.Function(V)
    turned = scene.turn @ gradient @ scene.turn.T
    exact.interpolate(lambda x: turned @ x)
    scene.bcs = [fm.dirichlet(V, scene.data, name, exact) for name in names]
    scene.u.x.array[:] = 0.9 * exact.x.array
    scene.set_up(tie=True, roles=roles, pair=EXACT).problem.solve()
    return np.abs(scene.u.x.array - exact.x.array).max()


@pytest.mark.parametrize("cell, degree", KINDS)
def test_homogeneous_strain_passes_a_tie_with_prescribed_ends(cell, degree):
    """Nodes at two ends of the slave hand their functions over; other sides are free of stress."""
    names = ["lower/bottom", "upper/top"]
    names += [f"{block}/{side}" for block in ("lower", "upper") for side in ("left", "right")]
    for roles, (jiggle, bound) in product(ROLES, JIGGLED):
        counts = {"upper": (4, 3, 1), "lower": (3, 4, 1)}
        scene = stack(cell, degree, jiggle=jiggle, turn=TILTED, **counts)
        assert error_behind_a_tie(scene, GRADIENT, names, roles) < bound


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
def test_homogeneous_strain_passes_a_tie_with_all_sides_prescribed(degree):
    gradient = np.array([[0.1, 0.2, -0.1], [0.0, -0.1, 0.3], [0.1, -0.1, -0.2]])
    counts = {"upper": (4, 3, 1), "lower": (3, 4, 1)}
    for jiggle, bound in JIGGLED:
        scene = stack("hexahedron", degree, jiggle=jiggle, poisson=0.3, **counts)
        names = [name for name in scene.data.boundaries if name not in ROLES[0]]
        assert error_behind_a_tie(scene, gradient, names, ROLES[1]) < bound


def test_points_without_a_rule_are_refused_by_number():
    with refused(ValueError, "points=5: expected one of 6, 7, 12, 16, 25, 36, .* 'upper/bottom'"):
        stack().press().set_up(pair={"discretization": fm.Discretization(points=5)})
    with refused(ValueError, "points=6: expected one of 12, 16, 25, 36"):
        stack(degree=2).press().set_up(pair={"discretization": fm.Discretization(points=6)})


@pytest.mark.once
@pytest.mark.parametrize("tie", [False, True], ids=["contact", "tie"])
def test_parallelograms_and_triangles_need_few_points(tie):
    """Also where all nodes coincide, and after tiny shifts."""
    for cell, points in (("hexahedron", 6), ("tetrahedron", 3)):
        for shift in (0.0, 1e-16, 1e-13, 1e-9, 1e-5):
            sizes = ((1.0 - 2 * shift, 1.0, 0.5), (1.0, 1.0, 0.5))
            counts = {"upper": (2, 2, 1), "lower": (2, 2, 1)}
            scene = stack(cell, 1, sizes=sizes, offset=(shift, 0, 0), jiggle=0.0, **counts)
            pair = {"discretization": fm.Discretization(points=points)}
            scene.press().set_up(tie=tie, pair=pair)
            scene.move(0.0, 0.0, STRETCH - 1.0)
            assert off(scene, compressed) < 1e-12 + shift
