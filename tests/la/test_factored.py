# SPDX-License-Identifier: MIT
"""Factorization of the bulk on one rank: by CHOLMOD if possible, else by MUMPS."""

from petsc4py import PETSc

import numpy as np
import pytest

from fenics_mortar.la.solver import factored, factored_by_cholmod
from fenics_mortar.utils import compat

pytestmark = pytest.mark.serial


def matrix(entries):
    K = PETSc.Mat().createAIJ(2 * [len(entries)], comm=PETSc.COMM_SELF)
    K.setUp()
    K[:, :] = entries
    K.assemble()
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return K


def solve(pc, b):
    x = PETSc.Vec().createSeq(len(b))
    pc.apply(PETSc.Vec().createWithArray(np.array(b), comm=PETSc.COMM_SELF), x)
    return x.array


@pytest.mark.skipif(
    not compat.petsc_has("suitesparse", "cholmod"), reason="PETSc has no SuiteSparse"
)
def test_definite_matrix_is_factored_by_cholmod():
    pc = factored_by_cholmod(matrix([[4.0, 1.0], [1.0, 3.0]]), "definite_")
    assert solve(pc, [1.0, 2.0]) == pytest.approx([1.0 / 11.0, 7.0 / 11.0])


def test_indefinite_matrix_is_factored_by_mumps(capfd):
    """Dense enough that CHOLMOD uses Cholesky's L L^T, as for large meshes."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(200, 200))
    K = matrix(A + A.T)
    assert factored_by_cholmod(K, "mixed_") is None
    assert capfd.readouterr() == ("", "")
    x = rng.normal(size=200)
    assert solve(factored(K, "mixed_"), (A + A.T) @ x) == pytest.approx(x, rel=1e-8)
