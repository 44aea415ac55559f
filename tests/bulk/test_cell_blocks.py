# SPDX-License-Identifier: MIT
"""The tangent assembled in blocks from the cells of each rank, and copied to rows."""

from mpi4py import MPI
from petsc4py import PETSc

import pytest
from scenes import pressed_blocks

import ufl
from dolfinx import mesh

import fenics_mortar as fm
from fenics_mortar.bulk.node_blocks import CellBlocks
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import SUM_ROUNDING

comm = MPI.COMM_WORLD
ROUNDING = SUM_ROUNDING if comm.size > 1 else 0.0


def difference(A, B):
    """Norm of A - B over that of B."""
    both = A.duplicate(copy=True)
    both.axpy(-1.0, B)
    return both.norm() / B.norm()


def assembled(form):
    """Matrix of a form, assembled by PETSc in rows."""
    rows = compat.create_matrix(form)
    compat.assemble_matrix(rows, form)
    return rows


def square_of(n):
    """A square of n by n by two triangles. Each call may distribute it in another way."""
    return mesh.create_unit_square(comm, n, n, ghost_mode=mesh.GhostMode.shared_facet)


def form_on(square, degree, *, facets):
    """Form of a square, with an integral over interior facets or not."""
    V = fm.vector_space(square, degree)
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    x = ufl.SpatialCoordinate(square)
    metadata = {"quadrature_degree": 2}
    form = (1.0 + x[0]) * ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx(metadata=metadata)
    if facets:
        jump = ufl.inner(ufl.jump(ufl.grad(u)), ufl.jump(ufl.grad(v)))
        form += x[1] * jump * ufl.dS(metadata=metadata)
    return compat.form(form)


@pytest.mark.parametrize("n, degree, facets", [
    (1, 1, False), (4, 1, False), (4, 2, False), (4, 1, True), (3, 2, True)
])  # fmt: skip
def test_rows_are_sums_over_ranks(n, degree, facets):
    form = form_on(square_of(n), degree, facets=facets)
    expected, rows = assembled(form), assembled(form)
    blocks = CellBlocks(rows)
    for factor in (3.0, 2.0):
        rows.scale(factor)
        compat.assemble_matrix(blocks.blocks, form)
        blocks.copy_to(rows)
        assert difference(rows, expected) <= ROUNDING


def test_entries_outside_of_all_blocks_become_zero():
    square = square_of(4)
    narrow, wide = (form_on(square, 1, facets=facets) for facets in (False, True))
    rows = assembled(narrow)
    blocks = CellBlocks(rows)
    rows.axpy(1.0, assembled(wide), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    compat.assemble_matrix(blocks.blocks, narrow)
    blocks.copy_to(rows)
    assert difference(rows, assembled(narrow)) <= ROUNDING


@pytest.mark.parametrize("degree", [1, 2])
def test_tangents_by_rows_and_by_blocks_are_identical(degree):
    scene = pressed_blocks(degree=degree, n_upper=4, n_lower=5)
    scene.loads["push"].value[:] = 0.01, -0.05
    scene.problem.solve()  # with contact in the tangent, whose pattern it extends
    bulk = scene.problem.equations.bulk
    bulk.assemble_tangent()
    plain = assembled(bulk._tangent)
    assert bulk.K.getInfo()["nz_used"] > plain.getInfo()["nz_used"]
    assert bulk._blocks is not None
    assert difference(bulk.K, plain) <= ROUNDING
