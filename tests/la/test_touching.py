# SPDX-License-Identifier: MIT
"""The tangent of bodies that remain in contact: the product of its five matrices."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scenes import pressed_blocks
from space_pairs import pressed

import fenics_mortar as fm
from fenics_mortar.la import multigrid, touching
from fenics_mortar.la.touching import tangential_axes

comm = MPI.COMM_WORLD
ADD = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 5, "layers_lower": 5}


def enlarged(small, near, A):
    """A matrix of the size of ``A`` with the entries of one of the dofs ``near`` contact."""
    large = PETSc.Mat().createAIJ(A.getSizes(), nnz=60, comm=comm)
    starts, columns, values = small.getValuesCSR()
    for i, start, end in zip(near.owned, starts[:-1], starts[1:], strict=True):
        large.setValues(int(i), near.rows[columns[start:end]].astype("i"), values[start:end])
    large.assemble()
    return large


def checked(monkeypatch, dim=2, negligible=0.0):
    """Errors of the products of all cycles that are made from now on."""
    errors = []
    monkeypatch.setattr(touching, "MIN_BLOCK", negligible)
    compute = multigrid.touching.touching_tangent

    def compared(A, near, motion, equations, axes, stiffness):
        B = compute(A, near, motion, equations, axes, stiffness)
        R = PETSc.Mat().createAIJ(A.getSizes(), nnz=dim, comm=comm)
        first, end = A.getOwnershipRange()
        for i, of_node in zip(range(first, end, dim), axes, strict=True):
            R.setValues(range(i, i + dim), range(i, i + dim), of_node)
        R.assemble()
        T_R, L_T_R = (enlarged(small, near, A).matMult(R) for small in (motion, equations))
        for matrix in (T_R, L_T_R):
            matrix.axpy(1.0, R, ADD)
        product = L_T_R.transposeMatMult(A.matMult(T_R))
        size = product.norm()
        product.axpy(-1.0, B, ADD)
        errors.append(product.norm() / size)
        return B

    monkeypatch.setattr(multigrid.touching, "touching_tangent", compared)
    return errors


@pytest.mark.parametrize(
    "degree, basis, algorithm",
    [(1, "dual", "condensed"), (2, "dual", "condensed"), (2, "dual", "saddle"),
     (1, "standard", "saddle")],
)  # fmt: skip
def test_tangent_is_the_product_of_its_matrices(monkeypatch, degree, basis, algorithm):
    errors = checked(monkeypatch)
    problem = {"solver": "iterative", "algorithm": algorithm}
    pair = {"basis": basis, "law": fm.Coulomb(0.3)}
    scene = pressed_blocks(
        degree=degree, pair=pair, problem=problem, offset=1.4, inclination=0.3, **MESH
    )
    scene.loads["push"].value[:] = (0.02, -0.05)
    scene.problem.solve()
    assert errors and max(errors) < 1e-15


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_tangent_in_space_is_the_product_of_its_matrices(monkeypatch, algorithm):
    """Bodies are turned, so that no axis of the nodes is one of the mesh."""
    errors = checked(monkeypatch, 3)
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    problem = {"solver": "iterative", "algorithm": algorithm}
    scene = pressed("tetrahedron", law=fm.Coulomb(0.3), problem=problem, turn=turn)
    scene.move(0.02, 0.0, -0.04)
    assert errors and max(errors) < 1e-14


def test_negligible_blocks_are_left_out(monkeypatch):
    entries, dropped, compute = [], [], multigrid.touching.touching_tangent

    def compared(*given):
        few = compute(*given)
        with monkeypatch.context() as context:
            context.setattr(touching, "MIN_BLOCK", 0.0)
            all_of_them = compute(*given)
        entries.append([matrix.getInfo(True)["nz_used"] for matrix in (few, all_of_them)])
        all_of_them.axpy(-1.0, few, ADD)
        dropped.append(all_of_them.norm() / few.norm())
        return few

    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    scene = pressed("tetrahedron", problem={"solver": "iterative"}, turn=turn)
    monkeypatch.setattr(multigrid.touching, "touching_tangent", compared)
    scene.move(0.02, 0.0, -0.04)
    assert entries and all(few < 0.95 * many for few, many in entries)
    assert max(dropped) < 1e-3


def test_tangential_axes_are_those_along_the_contact():
    """The x axis of plane blocks, x and y of those in space."""
    scene = pressed_blocks(offset=0.0, **MESH)
    (contact,) = scene.problem.equations.contacts
    scene.loads["push"].value[:] = (0.0, -0.02)
    scene.problem.solve()
    assert tangential_axes(contact) == [0]
    solid = pressed("tetrahedron")
    solid.move(0.0, 0.0, -0.02)
    assert tangential_axes(solid.problem.equations.contacts[0]) == [0, 1]


def test_rows_and_columns_may_be_given_in_any_order():
    """PETSc's ``createSubMatrix`` fails on some ranks if columns of other ranks do not ascend."""
    n, size = 6, comm.size
    A = PETSc.Mat().createAIJ(((n, None), (n, None)), nnz=(n, n * size), comm=comm)
    first = n * comm.rank
    for i in range(first, first + n):
        A.setValues([i], range(n * size), np.ones(n * size))
    A.assemble()
    rows, columns = first + np.array([4, 1]), first + np.array([5, 0, 3])
    multigrid._leave_out(A, rows, columns)
    expected = np.ones((n, n * size))
    everywhere = np.concatenate(comm.allgather(columns))
    expected[np.ix_(rows - first, everywhere)] = 0.0
    assert (A[first : first + n, :] == expected).all()
