# SPDX-License-Identifier: MIT
"""Few unknowns: factors without pivoting, and MUMPS where these fail."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import pressed_blocks

from fenics_mortar.la.options import DIRECT, SMALL
from fenics_mortar.la.solver import LinearSolver
from fenics_mortar.utils.errors import MortarError

pytestmark = pytest.mark.serial
MESH = {"n_upper": 4, "n_lower": 5, "layers_upper": 2, "layers_lower": 2}


def solver_of(**options):
    scene = pressed_blocks(problem=options, **MESH)
    return scene.problem.equations.system.ksp.getPC().getFactorSolverType()


def test_few_unknowns_are_factored_without_pivoting():
    assert solver_of(algorithm="condensed") == "petsc"


@pytest.mark.parametrize(
    "options", [{"algorithm": "saddle"}, {"petsc_options": {"mat_mumps_icntl_14": 80}}]
)
def test_saddle_points_and_user_options_use_mumps(options):
    assert solver_of(**options) == "mumps"


def solver(options, *, may_factor=True):
    made = LinearSolver(MPI.COMM_SELF, "few_", options, lambda: None)
    made.may_factor = may_factor
    return made


def matrix(values):
    rows = np.arange(0, values.size + 1, values.shape[1], dtype=PETSc.IntType)
    columns = np.tile(np.arange(values.shape[1], dtype=PETSc.IntType), len(values))
    return PETSc.Mat().createAIJ(
        values.shape, csr=(rows, columns, values.ravel()), comm=MPI.COMM_SELF
    )


@pytest.mark.parametrize("corner", [0.0, 1e-25], ids=["zero", "growing"])
@pytest.mark.parametrize("transpose", [False, True])
def test_failed_pivots_are_solved_by_mumps(corner, transpose):
    A = np.array([[corner, 1.0, 2.0], [3.0, corner, 4.0], [5.0, 6.0, corner]])
    b, few = np.array([1.0, 2.0, 3.0]), solver(SMALL)
    x = few.solve(matrix(A), b, transpose=transpose)
    assert np.allclose((A.T if transpose else A) @ x, b, rtol=1e-12)
    assert "without pivoting failed" in few.remark and "MUMPS" in few.remark
    assert few.ksp.getPC().getFactorSolverType() == DIRECT["pc_factor_mat_solver_type"]


def test_a_singular_matrix_is_refused_by_both():
    with pytest.raises(MortarError, match="singular"):
        solver(SMALL).solve(matrix(np.ones((3, 3))), np.array([1.0, 2.0, 3.0]))


@pytest.mark.parametrize("net", [1e-4, 3e-3])
@pytest.mark.parametrize("options", [SMALL, DIRECT])
def test_a_small_load_that_a_singular_matrix_cannot_carry_is_refused(options, net):
    """The residual is as small as in bending of thin bodies, but a refinement doubles x."""
    random, n = np.random.default_rng(0), 60
    step = np.eye(n, k=1)[:-1] - np.eye(n)[:-1]
    A, b = step.T @ np.diag(random.uniform(1.0, 2.0, n - 1)) @ step, random.normal(size=n)
    b = (b - b.mean()) / np.linalg.norm(b - b.mean()) + net / np.sqrt(n)
    with pytest.raises(MortarError, match="singular"):
        solver(options).solve(matrix(A), b)


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_pivots_are_independent_of_units(unit):
    A, b = np.diag([2.0, 3.0, 4.0]) + 0.1, np.array([1.0, 2.0, 3.0])
    few = solver(SMALL, may_factor=False)
    x = few.solve(matrix(1e-12 * unit * A), b)
    assert np.allclose(1e-12 * unit * A @ x, b, rtol=1e-13)
    assert not few.remark


@pytest.mark.parametrize("transpose", [False, True])
def test_rounding_of_large_terms_that_cancel_is_no_failure(transpose):
    """A chain of springs of 1e8 on springs of 1, moved as a whole: forces are 1, terms 4e8."""
    n = 40
    step = np.eye(n, k=1)[:-1] - np.eye(n)[:-1]
    A, b = np.eye(n) + 1e8 * step.T @ step, np.ones(n)
    few = solver(SMALL)
    x = few.solve(matrix(A), b, transpose=transpose)
    assert not few.remark
    assert np.allclose(x, 1.0, rtol=1e-6)


def matrix_in_pairs(values):
    """The matrix of a whole number of nodes, without its zeros."""
    rows, columns = np.nonzero(values)
    starts = np.searchsorted(rows, np.arange(len(values) + 1)).astype(PETSc.IntType)
    csr = starts, columns.astype(PETSc.IntType), values[rows, columns]
    return PETSc.Mat().createAIJ(values.shape, bsize=2, csr=csr, comm=MPI.COMM_SELF)


@pytest.mark.parametrize("transpose", [False, True])
def test_rows_in_pairs_are_factored_in_blocks(transpose):
    random = np.random.default_rng(1)
    few, b = solver(SMALL, may_factor=False), random.random(40)
    A = np.where(random.random((40, 40)) < 0.4, random.random((40, 40)), 0.0) + 20.0 * np.eye(40)
    M = matrix_in_pairs(A)
    for factor in (1.0, 2.0):  # new values in the same pattern
        M.scale(factor)
        x = few.solve(M, factor * b, transpose=transpose)
        assert np.allclose((A.T if transpose else A) @ x, b, rtol=1e-13)
        factors = few.ksp.getPC().getFactorMatrix()
        assert factors.getBlockSize() == 2 and "baij" in factors.getType()
    few.reset_pattern()
    more = matrix_in_pairs(A + np.rot90(np.eye(40)))
    assert np.allclose((A + np.rot90(np.eye(40))) @ few.solve(more, b), b, rtol=1e-13)


def test_failed_pivot_of_a_block_is_solved_by_mumps():
    A, b = np.kron([[0.0, 1.0], [1.0, 1.0]], np.eye(2)), np.arange(4.0)
    few = solver(SMALL)
    assert np.allclose(A @ few.solve(matrix_in_pairs(A), b), b, rtol=1e-13)
    assert "without pivoting failed" in few.remark


@pytest.mark.parametrize("size, solves", [(100, "petsc"), (130, "mumps")])
def test_long_rows_are_factored_by_mumps(size, solves):
    random = np.random.default_rng(2)
    few, b = solver(SMALL), random.random(size)
    A = random.random((size, size)) + size * np.eye(size)
    for _ in range(2):
        assert np.allclose(A @ few.solve(matrix_in_pairs(A), b), b, rtol=1e-13)
        assert few.ksp.getPC().getFactorSolverType() == solves
    assert not few.remark
