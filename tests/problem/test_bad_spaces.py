# SPDX-License-Identifier: MIT
"""Rejected builds of PETSc, meshes, spaces and conditions."""

import numpy as np
import pytest
from array_meshes import blocks_of_arrays, problem_on
from refusal import COMM, refused
from scenes import read
from small_scenes import SMALL, small_blocks

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from fenics_mortar.utils import compat
from meshes import two_blocks

# Platform, mesh and space


def test_complex_petsc_is_refused(monkeypatch):
    monkeypatch.setattr(compat, "scalar_is_complex", lambda: True)
    with refused(fm.MortarError, "complex scalars", "real scalars"):
        small_blocks()


def test_mesh_of_a_line_is_refused():
    mesh = dmesh.create_unit_interval(COMM, 4)
    ends = dmesh.locate_entities_boundary(mesh, 0, lambda x: np.isclose(x[0], 0.0))
    tags = dmesh.meshtags(mesh, 0, np.sort(ends), np.ones(ends.size, np.int32))
    data = fm.MeshData(mesh, None, tags, {}, {"slave": 1, "master": 1})
    u = fem.Function(fm.vector_space(mesh, 1))
    with refused(fm.MeshError, "dimension 1", "plane bodies, 2 in 2, or solids, 3 in 3"):
        problem_on(data, u=u, material=lambda u, E, nu: ufl.grad(u))


@pytest.mark.parametrize("space", ["P3", "scalar", "DG 1", "DG 2", "CR 1"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_space_other_than_plane_vectors_of_degree_one_or_two_is_refused(space, cell):
    data = blocks_of_arrays(cell)
    mesh = data.mesh
    if space.startswith("P"):
        V = fm.vector_space(mesh, int(space[1]))
    elif space == "scalar":
        V = compat.scalar_space(mesh, 1)
    elif cell == "quadrilateral" and space == "CR 1":
        pytest.skip("no such element")
    else:
        V = vectors_of(mesh, *space.split())
    u = fem.Function(V)
    residual = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(V))) * ufl.dx
    pair = fm.ContactPair(data, "slave", "master")
    with refused(fm.MortarError, r"vector_space\(mesh, 1\) or vector_space\(mesh, 2\)"):
        fm.ContactProblem(residual, u, [pair], petsc_options_prefix="test_errors_")


def vectors_of(mesh, family, degree):
    """A space of plane vectors that is not Lagrange's."""
    if hasattr(ufl, "VectorElement"):
        return fem.FunctionSpace(mesh, ufl.VectorElement(family, mesh.ufl_cell(), int(degree)))
    return fem.functionspace(mesh, (family, int(degree), (2,)))


def test_curved_cells_are_refused():
    def build():
        model = two_blocks.build(**SMALL)
        model.mesh.setOrder(2)
        return model

    data = read(build)
    with refused(fm.MeshError, "curved cells", "first order"):
        problem_on(data, [fm.ContactPair(data, "upper/bottom", "lower/top")])


def test_pair_on_another_mesh_is_refused():
    one, other = blocks_of_arrays(), blocks_of_arrays()
    with refused(fm.MeshError, "'slave' - 'master' belongs to another mesh"):
        problem_on(one, [fm.ContactPair(other, "slave", "master")])


@pytest.mark.parametrize("case", ["mesh", "degree"])
def test_dirichlet_condition_of_another_space_is_refused(case):
    data, other = blocks_of_arrays(), blocks_of_arrays()
    V = fm.vector_space(other.mesh, 1) if case == "mesh" else fm.vector_space(data.mesh, 2)
    bc = fm.dirichlet(V, other if case == "mesh" else data, "base", (0.0, 0.0))
    with refused(fm.MortarError, "Dirichlet condition 0 belongs to another space", "space of u"):
        problem_on(data, bcs=[bc])
