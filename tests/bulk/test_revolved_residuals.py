# SPDX-License-Identifier: MIT
"""Residuals and conditions of plane bodies used with axisymmetry."""

import numpy as np
from refusal import refused
from revolved import cylinders, internal, neo_hookean
from scenes import internal as plane_internal
from scenes import neo_hookean as plane_neo_hookean

import ufl
from dolfinx import fem

import fenics_mortar as fm


def solved(residual_of, *, axis=0.0):
    """Two stacked cylinders pressed together; ``axis``: radial motion of the axis."""
    data = cylinders()
    V = fm.vector_space(data.mesh, 1)
    u, radial = fem.Function(V), fem.Constant(data.mesh, axis)
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", 0.0, component=1),
        fm.dirichlet(V, data, "upper/top", -0.02, component=1),
        fm.dirichlet(V, data, ["lower/left", "upper/left"], radial, component=0),
    ]
    problem = fm.ContactProblem(
        residual_of(u), u, [fm.ContactPair(data, "upper/bottom", "lower/top")], bcs=bcs,
        geometry="axisymmetric", petsc_options_prefix="revolved_",
    )  # fmt: skip
    return problem.solve()


def revolved(u):
    return internal(u, neo_hookean(u, 100.0, 0.3))


def test_a_residual_without_the_radius_is_refused():
    with refused(ValueError, "does not contain the radius in integrals over cells"):
        solved(lambda u: plane_internal(u, plane_neo_hookean(u, 100.0, 0.3)))


def test_the_radius_may_be_a_function():
    def by_function(u):
        r = fem.Function(fm.mixed_space(u.function_space.mesh, ("Lagrange", 1), ("Lagrange", 1)))
        r = r.sub(0).collapse()
        r.interpolate(lambda x: 2 * np.pi * x[0])
        stress = plane_neo_hookean(u, 100.0, 0.3)
        v = ufl.TestFunction(u.function_space)
        return r * ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4})

    assert solved(by_function).converged


def test_traction_without_the_radius_is_reported():
    def loaded(u, weight=1.0):
        traction = fem.Constant(u.function_space.mesh, (0.0, -1e-3))
        return (
            revolved(u) - weight * ufl.inner(traction, ufl.TestFunction(u.function_space)) * ufl.ds
        )

    def is_reported(residual_of):
        return any("boundary integrals without the radius" in n for n in solved(residual_of).notes)

    assert is_reported(loaded)
    assert not is_reported(lambda u: loaded(u, ufl.SpatialCoordinate(u.function_space.mesh)[0]))


def test_displacement_of_the_axis_is_refused():
    """A radial motion of the axis opens a hole along it, or moves material across it."""
    for motion in (0.01, -0.01):
        with refused(fm.MortarError, "nodes on the axis are moved away from it by 0.01"):
            solved(revolved, axis=motion)
