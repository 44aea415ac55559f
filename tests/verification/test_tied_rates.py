# SPDX-License-Identifier: MIT
"""Rates of convergence of tied meshes to a manufactured solution, within 0.15 of theory.

A neo-Hookean body of two parts, 2 : 3 facets along the interface, fixed all around. The load is
of a smooth displacement of finite strain, so the traction on the interface is of no simple shape.
With order p the energy norm has the rate p and L2 p + 1, the curved interface included: nodes of
both sides are on the curve, cells of order p have curved sides.
"""

import numpy as np
import pytest
from scenes import TIGHT, neo_hookean, pair_options, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat
from meshes import mapped_grids

pytestmark = pytest.mark.serial
INTERFACES = {"flat": lambda x: 0.0 * x, "curved": lambda x: 0.15 * np.sin(np.pi * x)}


def parts(n, degree, interface):
    """Lower and upper part of the square -0.5 < y < 0.5, the interface between them."""

    def lower(s, t):
        return s, -0.5 + (interface(s) + 0.5) * t

    def upper(s, t):
        return s, interface(s) + (0.5 - interface(s)) * t

    return [
        mapped_grids.Grid("lower", mapped_grids.mapped(3 * n * degree, 2 * n * degree, lower)),
        mapped_grids.Grid("upper", mapped_grids.mapped(2 * n * degree, n * degree, upper)),
    ]


def solve(n, degree, interface, *, slave="upper/bottom", cell="quadrilateral", **pair):
    """The errors in the energy norm, that of the gradient, and in L2."""
    grids = parts(n, degree, INTERFACES[interface])
    data = read(mapped_grids.build, grids=grids, cell=cell, order=degree)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    x, y = ufl.SpatialCoordinate(data.mesh)
    exact = 0.1 * ufl.as_vector([ufl.sin(2 * x + y), ufl.cos(x - 2 * y)])
    dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 1})
    load = -ufl.div(neo_hookean(exact, 1.0, 0.3))
    residual = (ufl.inner(neo_hookean(u, 1.0, 0.3), ufl.grad(v)) - ufl.inner(load, v)) * dx
    given = fem.Function(V)
    given.interpolate(lambda X: 0.1 * np.stack([np.sin(2 * X[0] + X[1]), np.cos(X[0] - 2 * X[1])]))
    outside = ["lower/left", "lower/bottom", "lower/right", "upper/left", "upper/top"]
    bcs = [fm.dirichlet(V, data, [*outside, "upper/right"], given)]
    master = {"upper/bottom": "lower/top", "lower/top": "upper/bottom"}[slave]
    tie = fm.TiedPair(data, slave, master, **pair_options(pair))
    u.x.array[:] = given.x.array
    problem = fm.ContactProblem(
        residual, u, [tie], bcs=bcs, petsc_options_prefix="rates_", newton=TIGHT
    )
    problem.solve()
    off = u - exact
    squares = ufl.inner(ufl.grad(off), ufl.grad(off)) * dx, ufl.inner(off, off) * dx
    return np.sqrt([fem.assemble_scalar(compat.form(square)) for square in squares])


def rates(sizes, *scene, **options):
    errors = [solve(n, *scene, **options) for n in sizes]
    return np.log(errors[0] / errors[1]) / np.log(sizes[1] / sizes[0])


@pytest.mark.parametrize("slave, basis", [("upper/bottom", "dual"), ("lower/top", "standard")])
@pytest.mark.parametrize("interface", INTERFACES)
@pytest.mark.parametrize("degree, sizes", [(1, (6, 12)), (2, (4, 8))])
def test_tied_meshes_have_the_rates_of_one_mesh(degree, sizes, interface, slave, basis):
    found = rates(sizes, degree, interface, slave=slave, basis=basis)
    assert found == pytest.approx([degree, degree + 1], abs=0.15)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("gap", ["removed", "kept"])
def test_curved_interface_has_full_rates_with_either_gap(gap, cell):
    """The rotation of the interface is small, below 0.2."""
    found = rates((4, 8), 2, "curved", gap=gap, cell=cell)
    assert found == pytest.approx([2, 3], abs=0.15)
