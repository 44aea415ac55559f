# SPDX-License-Identifier: MIT
"""Pictures and files of fields that exist at quadrature points only."""

import importlib

import numpy as np
import pytest
from small_scenes import small_blocks

import basix
import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.io.paraview import CellField
from fenics_mortar.utils import compat

DEGREE = 2


def at_points(mesh, shape, degree=DEGREE):
    """Function at the quadrature points of a degree."""
    if hasattr(ufl, "FiniteElement"):
        kind = {0: ufl.FiniteElement, 1: ufl.VectorElement, 2: ufl.TensorElement}[len(shape)]
        size = {"dim": shape[0]} if len(shape) == 1 else {"shape": shape} if shape else {}
        element = kind("Quadrature", mesh.ufl_cell(), degree, quad_scheme="default", **size)
        return fem.Function(fem.FunctionSpace(mesh, element))
    basix_ufl = importlib.import_module("basix.ufl")
    element = basix_ufl.quadrature_element(compat.cell_name(mesh), value_shape=shape, degree=degree)
    return fem.Function(fem.functionspace(mesh, element))


def fill(function, expression):
    """Values of an expression at the points of a quadrature function, on all local cells."""
    V = function.function_space
    cell = getattr(basix.CellType, compat.cell_name(V.mesh))
    points, _ = basix.make_quadrature(cell, DEGREE)
    dofs = compat.dofmap(V)
    cells = np.arange(len(dofs), dtype=np.int32)
    compiled = compat.create_expression(expression, points)
    values = np.asarray(compat.evaluate_expression(compiled, V.mesh, cells))
    function.x.array.reshape(-1, V.dofmap.bs)[dofs] = values.reshape(*dofs.shape, -1)


@pytest.mark.parametrize("shape", [(), (2,), (2, 2)])
def test_means_over_cells_of_a_quadrature_function_are_exact(shape):
    """A quadratic function of position, integrated exactly by its own points."""
    problem = small_blocks().problem
    mesh = problem.equations.bulk.V.mesh
    x = ufl.SpatialCoordinate(mesh)
    exact = {(): x[0] ** 2, (2,): x * x[1], (2, 2): ufl.outer(x, x)}[shape]
    stress = at_points(mesh, shape)
    fill(stress, exact)
    found = CellField(problem, stress + 0 * stress, "stress").evaluate()
    V = compat.scalar_space(mesh, 0, "DG")
    test, dx = ufl.TestFunction(V), ufl.dx(metadata={"quadrature_degree": 4})
    count = len(found)
    cells = compat.dofmap(V)[:count, 0]
    area = compat.local_sums(compat.form(test * dx(mesh)))[cells]
    for i in np.ndindex(shape):
        component = exact[i] if i else exact
        mean = compat.local_sums(compat.form(component * test * dx))[cells] / area
        assert np.abs(found[(slice(None), *i)] - mean).max(initial=0.0) < 1e-13


def test_a_component_that_is_zero_has_the_mean_zero():
    problem = small_blocks().problem
    value = at_points(problem.equations.bulk.V.mesh, ())
    value.x.array[:] = 3.0
    diagonal = ufl.as_tensor([[value, 0.0], [0.0, 2.0 * value]])
    found = CellField(problem, diagonal, "diagonal").evaluate()
    assert np.abs(found - np.diag([3.0, 6.0])).max(initial=0.0) < 1e-13


def test_pictures_and_files_take_quadrature_functions(shared_path):
    problem = small_blocks().problem
    mesh = problem.equations.bulk.V.mesh
    stress = at_points(mesh, (2, 2))
    fill(stress, ufl.Identity(2) * ufl.SpatialCoordinate(mesh)[0])
    problem.solve()
    fm.plot(problem, shared_path / "stress.png", stress=ufl.sqrt(ufl.inner(stress, stress)))
    fields = {"stress": stress, "xx": stress[0, 0]}
    with fm.ResultsWriter(shared_path / "out", problem, fields) as results:
        results.write(0.0)
    assert (shared_path / "stress.png").exists()


def test_functions_at_points_of_several_degrees_are_refused():
    problem = small_blocks().problem
    mesh = problem.equations.bulk.V.mesh
    both = at_points(mesh, ()) + at_points(mesh, (), degree=4)
    with pytest.raises(fm.MortarError, match=r"degrees \[2, 4\]; expected one degree"):
        CellField(problem, both, "sum")
