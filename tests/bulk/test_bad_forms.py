# SPDX-License-Identifier: MIT
"""Residuals and Jacobians on spaces other than that of the displacement."""

import pytest
from array_meshes import bcs_of, blocks_of_arrays, grid, mesh_of, tagged
from refusal import COMM, refused
from scenes import internal, neo_hookean

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat


def problem_with(space=None, jacobian=None):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    v = ufl.TestFunction(space(data.mesh) if space else u.function_space)
    stress, dx = neo_hookean(u, 100.0, 0.3), ufl.dx(metadata={"quadrature_degree": 4})
    residual = (ufl.inner(stress, ufl.grad(v)) if v.ufl_shape else v * ufl.tr(stress)) * dx
    given = {"jacobian": jacobian(u)} if jacobian else {}
    pair = fm.ContactPair(data, "slave", "master")
    return fm.ContactProblem(
        residual, u, [pair], bcs=bcs_of(data, u.function_space), petsc_options_prefix="f_", **given
    )


@pytest.mark.parametrize(
    "space",
    [lambda mesh: compat.scalar_space(mesh, 1), lambda mesh: fm.vector_space(mesh, 2)],
    ids=["scalar", "degree 2"],
)
def test_test_function_of_another_space_is_refused(space):
    with refused(ValueError, "test function of the residual belongs to another space than u"):
        problem_with(space)


def test_test_function_of_an_equal_space_is_taken():
    assert problem_with(lambda mesh: fm.vector_space(mesh, 1)).solve().converged


def stiffness_on(space):
    def form(u):
        V = space(u.function_space.mesh)
        trial, test = ufl.TrialFunction(V), ufl.TestFunction(V)
        return 100.0 * ufl.inner(ufl.grad(trial), ufl.grad(test)) * ufl.dx

    return form


@pytest.mark.parametrize(
    "jacobian, message",
    [
        (
            stiffness_on(lambda mesh: fm.vector_space(mesh, 2)),
            "function of the jacobian belongs to an",
        ),
        (
            stiffness_on(lambda mesh: compat.scalar_space(mesh, 1)),
            "of the jacobian belongs to another",
        ),
        (
            lambda u: ufl.inner(u, ufl.TestFunction(u.function_space)) * ufl.dx,
            "jacobian needs one test and one trial function",
        ),
        (lambda u: ufl.inner(u, u) * ufl.dx, "jacobian needs one test and one trial"),
    ],
)
def test_jacobian_on_another_space_is_refused(jacobian, message):
    with refused(ValueError, message):
        problem_with(jacobian=jacobian)


def test_residual_without_the_unknown_is_refused():
    data = blocks_of_arrays()
    u, other = (fem.Function(fm.vector_space(data.mesh, 1)) for _ in range(2))
    residual = internal(other, neo_hookean(other, 100.0, 0.3))
    with refused(ValueError, "the residual does not depend on u"):
        fm.ContactProblem(residual, u, [], petsc_options_prefix="f_")


def other_mesh():
    """A mesh of fewer cells, and of equal ones."""
    return [tagged(mesh_of(*grid(2, 2))).mesh, blocks_of_arrays().mesh]


@pytest.mark.each
@pytest.mark.parametrize("number", [0, 1], ids=["other", "equal"])
@pytest.mark.parametrize("what", ["function", "coordinate", "measure", "jacobian"])
def test_data_of_another_mesh_is_refused(what, number):
    """A function of a mesh of fewer cells crashed the assembly."""
    mesh, data = other_mesh()[number], blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    v, given = ufl.TestFunction(u.function_space), {}
    residual, dx = internal(u, neo_hookean(u, 100.0, 0.3)), ufl.dx(data.mesh)
    load = fem.Function(compat.scalar_space(mesh, 1), name="load")
    messages = {
        "function": "residual contains function 'load' of another mesh than that of u",
        "coordinate": "residual contains SpatialCoordinate of another mesh",
        "measure": "residual has an integral over cells of another mesh",
        "jacobian": "jacobian contains function 'load' of another mesh",
    }
    if what == "function":
        residual += load * v[1] * dx
    elif what == "coordinate":
        residual += ufl.SpatialCoordinate(mesh)[0] * v[1] * dx
    elif what == "measure":
        residual += v[1] * ufl.dx(mesh)
    else:
        du = ufl.TrialFunction(u.function_space)
        given["jacobian"] = ufl.derivative(residual, u, du) + load * ufl.inner(du, v) * dx
    with refused(ValueError, messages[what]):
        fm.ContactProblem(
            residual, u, [fm.ContactPair(data, "slave", "master")],
            bcs=bcs_of(data, u.function_space), petsc_options_prefix="f_", **given,
        )  # fmt: skip


def test_a_constant_of_another_mesh_is_a_number():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    load = fem.Constant(other_mesh()[0], 0.1)
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    residual -= load * ufl.TestFunction(u.function_space)[1] * ufl.dx(data.mesh)
    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, "slave", "master")], bcs=bcs_of(data, u.function_space),
        petsc_options_prefix="f_",
    )  # fmt: skip
    assert COMM.allreduce(float(problem.forces()[0].sum())) == pytest.approx(-0.3, rel=1e-12)
