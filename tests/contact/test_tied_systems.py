# SPDX-License-Identifier: MIT
"""Tied pairs: constant and symmetric systems, conjugate gradients."""

import numpy as np
import pytest
from scenes import nodal
from test_operators import dense
from tied_scenes import ENDS, ROLES, blocks, comm, linear, tied

import fenics_mortar as fm


def test_matrix_of_a_linear_bulk_is_constant_and_the_condensed_one_symmetric():
    """A T = Q^T K Q, with the slave's motion eliminated, in the rows of the other nodes."""
    data, gradient = blocks(), np.array([[0.0, 0.3], [0.0, 0.2]])
    pair = fm.TiedPair(data, *ROLES[0])
    problem, _ = tied(data, [pair], ENDS, gradient, start=0.0, law=linear, algorithm="condensed")
    before = dense(problem.tangent)
    problem.solve()
    A = dense(problem.tangent)
    assert np.abs(A - before).max() < 1e-13 * np.abs(A).max()
    tie, T = problem.equations.contacts[0], np.eye(len(A))
    slave, master = tie.slave.dofs, tie.master.dofs
    follow = tie.M.toarray() / tie.D.diagonal()[:, None]
    for c in range(2):
        T[slave[:, c]] = 0.0
        T[np.ix_(slave[:, c], master[:, c])] = follow
    kept = np.setdiff1d(np.arange(len(A)), [*slave.ravel(), *prescribed(problem)])
    reduced = (A @ T)[np.ix_(kept, kept)]
    assert np.abs(reduced - reduced.T).max() < 1e-13 * np.abs(reduced).max()
    assert np.linalg.eigvalsh(reduced).min() > 0.0
    assert np.abs((A @ T)[slave.ravel()]).max() < 1e-13 * np.abs(A).max()


def prescribed(problem):
    bulk = problem.equations.bulk
    return np.concatenate(comm.allgather(bulk.prescribed_dofs + bulk.first))


def test_saddle_matrix_is_symmetric():
    data, gradient = blocks((6, 5), width_lower=1.3), np.array([[0.0, 0.3], [0.0, 0.2]])
    pair = fm.TiedPair(data, *ROLES[0])
    problem, _ = tied(data, [pair], ENDS, gradient, start=0.0, algorithm="saddle")
    problem.solve()
    problem.equations.bulk.assemble_tangent()
    _, B_T, C, _ = (dense(part) for part in problem.equations.system.blocks())
    assert np.abs(B_T - C.T).max() < 1e-14 * np.abs(C).max() and np.abs(C).max() > 1.0


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
def test_conjugate_gradients_with_multigrid_solve_the_reduced_system(degree):
    """Equal numbers of iterations on a refined mesh, and the result of a direct solver."""
    shear, counts = np.array([[0.0, 0.3], [0.0, 0.2]]), []
    for n in (1, 2):
        data = blocks((5 * n, 8 * n), layers_upper=5 * n, layers_lower=8 * n, width_lower=1.2)
        found = []
        for solver in ("direct", "iterative"):
            pair = fm.TiedPair(data, *ROLES[0])
            problem, _ = tied(
                data, [pair], ENDS, shear, degree=degree, start=0.0, solver=solver,
                newton=fm.NewtonOptions(),
            )  # fmt: skip
            problem.solve()
            found.append(nodal(problem))
        assert np.abs(found[0] - found[1]).max() < 1e-8
        cycle = problem.equations.system.ksp.getPC().getPythonContext()._cycle
        assert cycle.getType() == "cg" and problem.equations.system.ksp.getIterationNumber() <= 3
        counts.append(cycle.getIterationNumber())
    assert counts[1] <= 1.5 * counts[0] and counts[0] < 60
