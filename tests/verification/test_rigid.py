# SPDX-License-Identifier: MIT
"""Rigid obstacles against theory: Hertz's line contact with one rigid side.

A force P per length on an elastic half cylinder of radius R on a rigid plane, or by a rigid
cylinder on an elastic block, makes

    a = sqrt(4 P R / (pi E*)),   p0 = 2 P / (pi a),   E* = E / (1 - nu^2)

in plane strain. The theory is for half planes: at a / R = 0.05 its own error is about 1 %.
"""

import numpy as np
import pytest
from scenes import internal, linear_elastic, read

from dolfinx import fem

import fenics_mortar as fm
from meshes import half_cylinder_on_block

R, E, NU = 8.0, 200.0, 0.3


def curved(degree, **options):
    """With degree 2 the inner nodes of facets lie on the circle."""
    model = half_cylinder_on_block.build(**options)
    model.mesh.setOrder(degree)
    return model


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=pytest.mark.serial)])
def test_half_cylinder_on_a_plane_and_cylinder_on_a_block(degree):
    """Both in one problem: the first is pressed by displacement, the second by an equal force."""
    data = read(
        curved,
        degree=degree,
        radius=R, width=48.0, height=24.0, h=0.04 * degree, fine=0.5, growth=0.25,
    )  # fmt: skip
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    plane, cylinder = fm.Plane((0.0, 0.0), (0.0, 1.0)), fm.Circle((0.0, R), R)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, E, NU)),
        u,
        [
            fm.ContactPair(data, "cylinder/arc", plane),
            fm.ContactPair(data, "block/top", cylinder),
        ],
        bcs=[
            fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)),
            fm.dirichlet(V, data, "cylinder/top", (0.0, -0.03)),
        ],
        petsc_options_prefix="rigid_",
    )
    problem.solve()
    cylinder.push(y=plane.reaction[1])
    report = problem.solve()
    assert report.certificate.violations() == []
    # After a quadratic step the error is rounding; the force passes through the centre.
    assert cylinder.reaction[1] == pytest.approx(-plane.reaction[1], rel=1e-11)
    assert abs(cylinder.reaction[2]) < 1e-13 * R * abs(plane.reaction[1])
    P = -plane.reaction[1]
    a = np.sqrt(4 * P * R * (1 - NU**2) / (np.pi * E))
    for contact in problem.equations.contacts:
        x, p, weights = contact.operators.x[:, 0], contact.pressure, contact.operators.weight
        a_mesh = 2 * np.sqrt((weights * p * x**2).sum() / (weights * p).sum())
        near = np.abs(x) < 0.7 * a  # the peak from a fit: p^2 is linear in x^2
        p0_mesh = np.sqrt(np.polyfit(x[near] ** 2, p[near] ** 2, 1)[1])
        assert a_mesh == pytest.approx(a, rel=0.02)
        assert p0_mesh == pytest.approx(2 * P / (np.pi * a), rel=0.02)
