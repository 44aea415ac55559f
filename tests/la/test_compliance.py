# SPDX-License-Identifier: MIT
"""Compliance of the contact dofs and solves with its factors, against the dense stiffness."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import linear_elastic, pressed_blocks

from fenics_mortar.la import compliance as compliance_module
from fenics_mortar.la.compliance import Compliance, ContactDofs
from fenics_mortar.utils import compat

comm = MPI.COMM_WORLD
MESH = {"n_upper": 5, "n_lower": 7, "layers_upper": 3, "layers_lower": 3}


def pressed():
    """Stiffness and contact dofs of two linear blocks."""
    scene = pressed_blocks(material=linear_elastic, **MESH)
    equations = scene.problem.equations
    equations.bulk.assemble_tangent()
    return equations.bulk, ContactDofs(equations.contacts, equations.bulk)


def dense(bulk):
    """K with the rows and columns of prescribed dofs replaced by those of the identity."""
    size = bulk.r.getSize()
    K, prescribed = np.zeros((size, size)), np.zeros(size)
    first, end = bulk.K.getOwnershipRange()
    for i in range(first, end):
        columns, values = bulk.K.getRow(i)
        K[i, columns] = values
    prescribed[bulk.prescribed_dofs + first] = 1.0
    for array in (K, prescribed):
        comm.Allreduce(MPI.IN_PLACE, array)
    K[prescribed == 1.0], K[:, prescribed == 1.0] = 0.0, 0.0
    return K + np.diag(prescribed)


def error_of_solves(bulk, compliance, inverse, count):
    """Largest relative error of solves with random forces."""
    rng, largest = np.random.default_rng(3), 0.0
    first, end = bulk.K.getOwnershipRange()
    for _ in range(count):
        load = rng.normal(size=len(inverse))
        force = bulk.K.createVecLeft()
        force.array[:] = load[first:end]
        load[comm.allreduce((bulk.prescribed_dofs + first).tolist())] = 0.0
        exact = inverse @ load
        off = np.abs(compliance.solve(force).array_r - exact[first:end]).max(initial=0.0)
        largest = max(largest, comm.allreduce(off, MPI.MAX) / np.abs(exact).max())
    return largest


def test_compliance_is_the_inverse_at_the_contact_dofs():
    bulk, dofs = pressed()
    inverse = np.linalg.inv(dense(bulk))
    compliance = Compliance(bulk, dofs, "compliance_test_")
    if comm.rank == 0:
        free = dofs.free_globals[dofs.free]
        exact = np.zeros((dofs.size, dofs.size))
        exact[np.ix_(dofs.free, dofs.free)] = inverse[np.ix_(free, free)]
        assert np.abs(compliance.A - exact).max() < 1e-12 * np.abs(exact).max()
    else:
        assert compliance.A.shape == (0, 0)


def test_compliance_by_columns_is_that_of_the_schur_complement(monkeypatch):
    bulk, dofs = pressed()
    one = Compliance(bulk, dofs, "compliance_test_")
    monkeypatch.setattr(Compliance, "_is_accurate", lambda _: False)
    other = Compliance(bulk, dofs, "compliance_test_")
    assert one.A.shape == other.A.shape
    size = np.abs(one.A).max(initial=1e-300)
    assert np.abs(other.A - one.A).max(initial=0.0) < 1e-12 * size


@pytest.mark.parametrize("defect", [0.0, 1e-3])
def test_an_inaccurate_compliance_is_found(defect, monkeypatch):
    monkeypatch.setattr(compliance_module, "is_indefinite", lambda _: True)
    bulk, dofs = pressed()
    compliance = Compliance(bulk, dofs, "compliance_test_")
    if comm.rank == 0:
        compliance.A[dofs.free, :] *= 1.0 + defect
    assert compliance._is_accurate() == (defect == 0.0)


def test_solves_by_the_same_factors_and_later_by_those_of_cholmod(monkeypatch):
    monkeypatch.setattr(compliance_module, "MANY_SOLVES", 4)
    bulk, dofs = pressed()
    inverse = np.linalg.inv(dense(bulk))
    compliance = Compliance(bulk, dofs, "compliance_test_")
    later = "cholmod" if comm.size == 1 and compat.petsc_has("suitesparse", "cholmod") else "mumps"
    for count, solver in ((3, "mumps"), (3, later)):
        assert error_of_solves(bulk, compliance, inverse, count) < 1e-12
        assert compliance._factors.getFactorSolverType() == solver


def test_factors_up_to_a_schur_complement_read_the_options_of_the_user():
    bulk, dofs = pressed()
    options, name = PETSc.Options(), "compliance_schur_mat_mumps_icntl_23"
    options.setValue(name, 77)  # a limit of memory [MB]
    try:
        compliance = Compliance(bulk, dofs, "compliance_schur_")
    finally:
        options.delValue(name)
    assert compliance._factors.getFactorMatrix().getMumpsIcntl(23) == 77
    assert compliance._factors.getFactorMatrix().getMumpsIcntl(14) == 50
