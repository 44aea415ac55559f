# SPDX-License-Identifier: MIT
"""Each function of ``utils.compat``, on each release of dolfinx and any number of ranks."""

import os
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.utils import compat

COMM = MPI.COMM_WORLD
CELLS = ("triangle", "quadrilateral")


def unit_square(cell, n=4):
    return dmesh.create_unit_square(COMM, n, n, getattr(dmesh.CellType, cell))


def one_cell(cell):
    """Give a mesh of one cell, so that all ranks but one have none."""
    x = np.array([(0.0, 0.0), (2.0, 0.0), (0.0, 1.0), (2.0, 1.0)])[: 3 if cell == "triangle" else 4]
    cells = np.arange(len(x)).reshape(1, -1)
    own = slice(None) if COMM.rank == 0 else slice(0, 0)
    return compat.create_mesh(COMM, cells[own], x[own], cell)


def total(b):
    """Sum the owned entries over all ranks."""
    return COMM.allreduce(b.array_r.sum())


def area(mesh):
    one = fem.Constant(mesh, PETSc.ScalarType(1.0))
    return COMM.allreduce(fem.assemble_scalar(compat.form(one * ufl.dx(domain=mesh))))


def all_ranks(condition):
    return COMM.allreduce(bool(condition), MPI.LAND)


def test_scalars_are_real_where_petsc_is():
    assert compat.scalar_is_complex() == (PETSc.ScalarType in (np.complex64, np.complex128))


def test_parts_of_a_mixed_space_have_their_shapes():
    """Until dolfinx 0.6 every shape was taken for that of a plane vector."""
    mesh = dmesh.create_unit_square(MPI.COMM_WORLD, 2, 2)
    parts = ("Lagrange", 1, (2,)), ("DG", 0, (3,)), ("DG", 0, (2, 2)), ("DG", 0)
    w = fem.Function(compat.mixed_space(mesh, *parts))
    assert [part.ufl_shape for part in ufl.split(w)] == [(2,), (3,), (2, 2), ()]


@pytest.mark.parametrize("cell", CELLS)
def test_cell_name_is_that_of_the_cells(cell):
    assert compat.cell_name(unit_square(cell)) == cell


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", (1, 2))
def test_vector_space_has_two_components_per_node(cell, degree):
    V = compat.vector_space(unit_square(cell), degree)
    assert V.dofmap.bs == 2
    assert V.dofmap.index_map.size_global == (4 * degree + 1) ** 2
    assert ufl.TestFunction(V).ufl_shape == (2,)


@pytest.mark.parametrize("cell", CELLS)
def test_scalar_space_of_degree_zero_has_one_dof_per_cell(cell):
    mesh = unit_square(cell)
    V = compat.scalar_space(mesh, 0, "DG")
    assert V.dofmap.index_map.size_global == mesh.topology.index_map(2).size_global
    assert ufl.TestFunction(V).ufl_shape == ()


def test_scalar_space_is_continuous_by_default():
    assert compat.scalar_space(unit_square("triangle"), 1).dofmap.index_map.size_global == 25


def test_petsc_vec_and_function_share_their_memory():
    u = fem.Function(compat.vector_space(unit_square("triangle"), 1))
    v = compat.petsc_vec(u)
    v.set(3.0)
    v.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
    assert all_ranks((u.x.array == 3.0).all())
    u.x.array[:] = 5.0
    with v.localForm() as local:
        assert all_ranks(local.size == u.x.array.size and (local.array == 5.0).all())


@pytest.mark.parametrize("cell", CELLS)
def test_dofmap_and_geometry_dofmap_lead_to_the_same_points(cell):
    mesh = unit_square(cell)
    V = compat.vector_space(mesh, 1)
    dofs, nodes = compat.dofmap(V), compat.geometry_dofmap(mesh)
    cells = mesh.topology.index_map(2)
    assert dofs.dtype == nodes.dtype == np.int32
    assert all_ranks(len(dofs) == len(nodes) == cells.size_local + cells.num_ghosts)
    x = V.tabulate_dof_coordinates()
    assert all_ranks(np.allclose(x[dofs], mesh.geometry.x[nodes], atol=1e-15))


@pytest.mark.parametrize("cell", CELLS)
def test_dofmaps_keep_their_width_on_ranks_without_cells(cell):
    mesh = one_cell(cell)
    width = 3 if cell == "triangle" else 4
    assert all_ranks(compat.dofmap(compat.vector_space(mesh, 1)).shape[1] == width)
    assert all_ranks(compat.geometry_dofmap(mesh).shape[1] == width)
    assert area(mesh) == pytest.approx(1.0 if cell == "triangle" else 2.0, rel=1e-15)


@pytest.mark.parametrize("cell", CELLS)
def test_assembled_mass_matrix_and_load_agree(cell):
    """The mass matrix times ones is the load of a unit force, in each owned entry."""
    mesh = unit_square(cell)
    V = compat.vector_space(mesh, 1)
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    force = fem.Constant(mesh, PETSc.ScalarType((1.0, 1.0)))
    a, L = compat.form(ufl.inner(u, v) * ufl.dx), compat.form(ufl.inner(force, v) * ufl.dx)
    A, b, ones = compat.create_matrix(a), compat.create_vector(V), compat.create_vector(V)
    for _ in range(2):  # assembling anew replaces and does not add
        compat.assemble_matrix(A, a)
        compat.assemble_vector(b, L)
    ones.set(1.0)
    product = A.createVecLeft()
    A.mult(ones, product)
    assert all_ranks(np.allclose(product.array_r, b.array_r, rtol=1e-13, atol=1e-16))
    assert total(b) == pytest.approx(2.0, rel=1e-14)
    assert A.getBlockSize() == 2


def test_form_follows_its_constants():
    mesh = unit_square("triangle")
    factor = fem.Constant(mesh, PETSc.ScalarType(1.0))
    form = compat.form(factor * ufl.dx(domain=mesh))
    factor.value = 3.0
    assert COMM.allreduce(fem.assemble_scalar(form)) == pytest.approx(3.0, rel=1e-14)


def test_created_vector_is_zero_and_has_the_layout_of_its_space():
    V = compat.vector_space(unit_square("triangle"), 1)
    b, layout = compat.create_vector(V), V.dofmap.index_map
    assert b.sizes == (2 * layout.size_local, 2 * layout.size_global)
    assert b.getBlockSize() == 2
    with b.localForm() as local:
        owned_and_ghosts = 2 * (layout.size_local + layout.num_ghosts)
        assert all_ranks(local.size == owned_and_ghosts and not local.array_r.any())


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("shared", (False, True))
def test_mesh_from_arrays_has_the_right_area(cell, shared):
    """All arrays on one rank, or a strip of cells on each."""
    strips = COMM.size if shared else 1
    mine = [COMM.rank] if shared else range(1) if COMM.rank == 0 else []
    quads = [(2 * i, 2 * i + 1, 2 * i + 2, 2 * i + 3) for i in mine]
    triangles = [t for q in quads for t in (q[:3], q[1:])]
    columns = [*mine, strips] if strips - 1 in mine else mine
    x = np.array([(i, y) for i in columns for y in (0.0, 2.0)]).reshape(-1, 2)
    cells = np.array(quads if cell == "quadrilateral" else triangles, dtype=np.int64)
    cells = cells.reshape(-1, 4 if cell == "quadrilateral" else 3)
    mesh = compat.create_mesh(COMM, cells, x, cell)
    assert area(mesh) == pytest.approx(2.0 * strips, rel=1e-14)
    assert compat.cell_name(mesh) == cell


def test_mesh_from_arrays_can_have_curved_sides():
    """Basix puts the middle of the side opposite to vertex i at index 3 + i."""
    x = np.array([(0, 0), (1, 0), (0, 1), (0.5, 0.5), (0, 0.5), (0.5, -0.3)])
    own = slice(None) if COMM.rank == 0 else slice(0, 0)
    mesh = compat.create_mesh(COMM, np.arange(6).reshape(1, 6)[own], x[own], "triangle", 2)
    # a parabola of height 0.3 over a side of length 1 adds the area 2/3 0.3
    assert area(mesh) == pytest.approx(0.5 + 0.2, rel=1e-14)


@pytest.mark.parametrize("component", (None, 1))
def test_prescribed_values_are_set_on_ghosts_too(component):
    V = compat.vector_space(unit_square("triangle"), 1)
    space, value = (V, (3.0, 4.0)) if component is None else (V.sub(component), 4.0)
    facets = dmesh.locate_entities_boundary(V.mesh, 1, lambda x: np.isclose(x[0], 0.0))
    dofs = fem.locate_dofs_topological(space, 1, facets)
    bc = fem.dirichletbc(np.array(value, dtype=PETSc.ScalarType), dofs, space)
    u = fem.Function(V)
    compat.set_prescribed(u.x.array, [bc])
    left = np.isclose(V.tabulate_dof_coordinates()[:, 0], 0.0)
    values = u.x.array.reshape(-1, 2)
    assert all_ranks((values[left] == ((0.0 if component else 3.0), 4.0)).all())
    assert all_ranks((values[~left] == 0.0).all())


@pytest.mark.serial
def test_form_compiler_logs_nothing_and_leaves_the_root_logger_alone(tmp_path):
    """The cache is empty, so that everything is compiled."""
    code = """
import logging
from mpi4py import MPI
import ufl
from dolfinx import fem, mesh
import fenics_mortar as fm
from fenics_mortar.utils import compat
level, handlers = logging.root.level, logging.root.handlers[:]
m = compat.create_mesh(MPI.COMM_WORLD, [[0, 1, 2]], [[0, 0], [1, 0], [0, 1]], "triangle")
u = fem.Function(fm.vector_space(m, 1))
compat.form(3.25 * ufl.inner(u, ufl.TestFunction(u.function_space)) * ufl.dx)
compat.create_expression(3.25 * u, [[0.3, 0.3]])
assert (level, handlers, []) == (logging.root.level, logging.root.handlers, logging.root.filters)
with compat.quiet_compiler():
    logging.getLogger().warning("a warning")
"""
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    command = [sys.executable, "-c", code]
    root = Path(__file__).parents[2]
    run = subprocess.run(command, capture_output=True, text=True, env=env, cwd=root, check=False)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "fenics").is_dir()
    messages = [line for line in run.stderr.splitlines() if ":root:" in line or "a warning" in line]
    assert [line.removeprefix("WARNING:root:") for line in messages] == ["a warning"]
