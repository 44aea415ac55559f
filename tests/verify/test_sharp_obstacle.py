# SPDX-License-Identifier: MIT
"""Obstacles that press between two nodes of a flat surface, in the plane and in space."""

import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, read, rectangles

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes import half_cylinder_on_block, mapped_boxes


def tip(*middles):
    """A solid with a sharp tip at each of the ``middles`` on y = 0."""
    sides = [(x + dx, y) for x in middles for dx, y in ((-0.2, -0.1), (0.0, 0.0), (0.2, -0.1))]
    return fm.Polygon([*sides, (3.0, -1.0), (-3.0, -1.0)][::-1], 0.005)


def loose_block(obstacle, law, force):
    """A block of 1 x 0.5 with nine facets on its lower side and a uniform force on its volume."""
    data = read(rectangles, size=0.125, block=(-0.5, 0.0, 1.0, 0.5))
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    load = fem.Constant(data.mesh, tuple(map(float, force)))
    residual = internal(u, neo_hookean(u, 1000.0, 0.3))
    residual -= ufl.inner(load, v) * ufl.dx(metadata={"quadrature_degree": 1})
    pair = fm.ContactPair(data, "block/bottom", obstacle, law=law)
    return fm.ContactProblem(residual, u, [pair], bcs=[], petsc_options_prefix="test_")


@pytest.mark.parametrize("mu", [0.1, 0.5])
def test_block_on_a_tip_beside_its_centre_is_not_balanced(mu):
    """Forces along both flanks acted at nodes one facet apart, and their moment balanced it."""
    ends = [(0.18, 0.0), (-0.12, -0.5), (0.52, -0.5), (0.22, 0.0)]
    with pytest.raises(fm.NotConvergedError):
        loose_block(fm.Polygon(ends, 0.01), fm.Coulomb(mu), (0.0, -1.0)).solve()


@pytest.mark.parametrize("middle", [0.0, 0.03])
def test_tips_do_not_support_a_block_sideways_without_friction(middle):
    """The tips resisted a sideways force of 5 % of the weight, although without friction."""
    tips = tip(middle - 0.335, middle + 0.335)
    for pull in (0.0, 0.05):
        problem = loose_block(tips, fm.Frictionless(), (pull, -1.0))
        if pull:
            with pytest.raises(fm.NotConvergedError, match="cannot balance|freely"):
                problem.solve()
        else:
            report = problem.solve()
            assert any("sharper than they are" in remark for remark in report.notes)


@pytest.mark.parametrize("radius", [0.3, 1.0])
def test_round_obstacles_are_not_sharp(radius):
    """Half cylinders on a plane with radii of three and of ten facets."""
    data = read(half_cylinder_on_block.build, h=0.1)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("block/bottom", "cylinder/top")]
    ball = fm.Circle((0.0, radius), radius)
    pairs = [fm.ContactPair(data, "block/top", ball)]
    pairs.append(fm.ContactPair(data, "cylinder/arc", fm.Plane((0.0, -0.02), (0.0, 1.0))))
    residual = internal(u, linear_elastic(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="test_")
    for depth in (0.01, 0.05):
        ball.move(y=-depth)
        certificate = problem.solve().certificate
        assert max(pair["obstacle_angle"].value for pair in certificate.pairs) < 0.05
        assert np.abs(problem.contacts[0].total_force[1]) > 0.1


def pressed(obstacle, counts, size, held, order, modulus, cell="hexahedron"):
    """A block in space, fixed at the side ``held``, with an ``obstacle`` above its top."""
    box = mapped_boxes.Box("block", mapped_boxes.block(counts, size=size, order=order))
    data = mapped_boxes.mesh([box], cell=cell, order=order)
    V = fm.vector_space(data.mesh, order)
    u = fem.Function(V)
    psi = fm.energies.neo_hookean(u, *fm.energies.lame(modulus, 0.0))
    residual = ufl.derivative(psi * ufl.dx(degree=2 * order), u)
    pair = fm.ContactPair(data, "block/top", obstacle, law=fm.Coulomb(0.2))
    bcs = [fm.dirichlet(V, data, f"block/{held}", (0.0, 0.0, 0.0))]
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="test_")


def angle_of(report):
    return report.certificate.pairs[0]["obstacle_angle"].value


@pytest.mark.once
@pytest.mark.parametrize(
    ("cell", "cells", "expected"),
    [("hexahedron", 12, 0.084), ("tetrahedron", 24, 0.68), ("hexahedron", 24, 1.0)],
)
def test_cylinder_that_enters_the_last_facets_of_a_sheet(cell, cells, expected):
    """The end beside it carried the force, up to 12 times too small, without a remark."""
    thickness, arm, depth = 0.01, 0.98, 0.002
    cylinder = fm.Cylinder((arm, 0.0, thickness + 0.1), (0.0, 1.0, 0.0), 0.1)
    problem = pressed(cylinder, (cells, 2, 1), (1.0, 0.2, thickness), "left", 2, 1e6, cell)
    cylinder.move(z=-depth)
    report = problem.solve()
    beam = 3.0 * 1e6 * (0.2 * thickness**3 / 12.0) * depth / arm**3
    assert cylinder.reaction[2] / beam == pytest.approx(expected, abs=0.01)
    told = any("sharper than they are" in remark for remark in report.certificate.remarks())
    assert told == (angle_of(report) > 0.19) == (expected != 1.0)


@pytest.mark.once
@pytest.mark.parametrize("middle", [(1.3, 0.5), (1.3, 1.2)])
def test_edge_or_corner_of_a_block_on_a_sphere_beside_it_is_not_sharp(middle):
    """Beyond the rim of its top the block continues at a right angle."""
    beside = np.maximum(np.subtract(middle, 1.0), 0.0)
    ball = fm.Sphere((*middle, 0.5 + (1.0 - beside @ beside) ** 0.5), 1.0)
    problem = pressed(ball, (4, 4, 2), (1.0, 1.0, 0.5), "bottom", 1, 100.0)
    ball.move(z=-0.02)
    report = problem.solve()
    assert abs(ball.reaction[0]) > 0.2 * abs(ball.reaction[2]) > 0.0
    assert angle_of(report) < 0.02


@pytest.mark.once
def test_a_block_that_tips_over_when_it_is_compressed_says_so():
    """Rigid it would stand, up to a ratio of 2; the message listed its free motions in the air."""
    problem = loose_block(fm.Plane((0.0, 0.0), (0.0, 1.0)), fm.Coulomb(5.0), (360.0, -200.0))
    problem.equations.newton = fm.NewtonOptions(max_iterations=8)
    message = r"^body 'block' tips over, .*: it begins to rotate about \(0.5, .*\); not converged"
    with pytest.raises(fm.NotConvergedError, match=message):
        problem.solve()
