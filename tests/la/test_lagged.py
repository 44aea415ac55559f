# SPDX-License-Identifier: MIT
"""Factors of an earlier iteration as preconditioner of GMRES."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import pressed_blocks

from fenics_mortar.la import solver as solver_module
from fenics_mortar.la.options import SMALL
from fenics_mortar.la.solver import STEPS, LinearSolver

pytestmark = pytest.mark.serial
RANDOM = np.random.default_rng(3)
BASE = RANDOM.random((40, 40)) + 20.0 * np.eye(40)
ONE_ROW = np.zeros((40, 40))
ONE_ROW[7] = RANDOM.random(40)


def dense(values, bsize=2):
    starts = np.arange(0, values.size + 1, len(values), dtype=PETSc.IntType)
    columns = np.tile(np.arange(len(values), dtype=PETSc.IntType), len(values))
    csr = starts, columns, values.ravel()
    return PETSc.Mat().createAIJ(values.shape, bsize=bsize, csr=csr, comm=MPI.COMM_SELF)


@pytest.fixture
def factorizations(monkeypatch):
    """Counts the direct solves; factors serve again in systems of any size."""
    monkeypatch.setattr(solver_module, "MIN_LAGGED", 0)
    count, attempt = [0], LinearSolver._attempt

    def counted(self, *args):
        count[0] += 1
        return attempt(self, *args)

    monkeypatch.setattr(LinearSolver, "_attempt", counted)
    return count


def solved_with_factors_of(change, factorizations, **options):
    """Relative residual with a changed matrix, and direct solves, after one with ``BASE``."""
    few, b, M = LinearSolver(MPI.COMM_SELF, "lag_", SMALL, lambda: None), RANDOM.random(40), None
    bsize = options.get("bsize", 2)
    M = dense(BASE, bsize)
    few.solve(M, b)
    M.axpy(1.0, dense(change, bsize))
    few.same_step, few.forcing = options.get("same_step", True), options.get("forcing", 1e-8)
    x = few.solve(M, b, transpose=options.get("transpose", False))
    A = (BASE + change).T if options.get("transpose") else BASE + change
    assert few.forcing == 0.0
    assert not few.remark
    y = few.solve(M, b)  # now with rounding errors only
    assert np.linalg.norm((BASE + change) @ y - b) < 1e-13 * np.linalg.norm(b)
    return np.linalg.norm(A @ x - b) / np.linalg.norm(b), factorizations[0] - 2


def test_changed_row_needs_no_factorization(factorizations):
    residual, count = solved_with_factors_of(ONE_ROW, factorizations)
    assert (residual < 1e-8, count) == (True, 0)


@pytest.mark.parametrize("bsize", [1, 2])
def test_earlier_factors_serve_as_preconditioner(bsize, factorizations):
    """Factors of the present matrix would leave rounding errors only."""
    change = 0.2 * np.random.default_rng(5).random((40, 40))
    residual, count = solved_with_factors_of(change, factorizations, bsize=bsize)
    assert 1e-13 < residual < 1e-8 and count == 0


@pytest.mark.parametrize(
    "options", [{"same_step": False}, {"forcing": 0.0}, {"transpose": True}], ids=str
)
def test_other_solves_are_direct(options, factorizations):
    residual, count = solved_with_factors_of(ONE_ROW, factorizations, **options)
    assert residual < 1e-13
    assert count == 1


def test_another_matrix_is_factored(factorizations):
    change = 20.0 * RANDOM.random((40, 40)) + np.diag(40.0 * np.arange(40.0))
    residual, count = solved_with_factors_of(change, factorizations)
    assert residual < 1e-13
    assert count == 1


def test_systems_with_few_unknowns_are_factored(factorizations, monkeypatch):
    monkeypatch.setattr(solver_module, "MIN_LAGGED", 41)
    assert solved_with_factors_of(ONE_ROW, factorizations)[1] == 1


def test_newton_needs_the_iterations_of_exact_solves(factorizations, monkeypatch):
    found = []
    for least in (10**9, 0):
        monkeypatch.setattr(solver_module, "MIN_LAGGED", least)
        factorizations[0] = 0
        scene = pressed_blocks(n_upper=8, n_lower=10)
        scene.loads["push"].value[:] = 0.01, -0.05
        report = scene.problem.solve()
        found.append((report.num_iterations, factorizations[0], scene.contact.z.copy()))
    (exact, all_factored, z), (lagged, some, z_lagged) = found
    assert lagged == exact == all_factored
    assert some < exact
    assert np.abs(z_lagged - z).max() < 1e-9 * np.abs(z).max()
    assert STEPS > 1
