# SPDX-License-Identifier: MIT
"""Named boundary conditions."""

from petsc4py import PETSc

import numpy as np
import pytest
from mesh_measures import COMM, gathered, raises_on_all_ranks, read

from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.mesh.data import MeshData, dirichlet
from fenics_mortar.utils import compat
from meshes import two_blocks


@pytest.fixture
def blocks():
    return read(two_blocks.build, n_upper=3, n_lower=4, layers_upper=2, layers_lower=2)


def prescribed(V, bc, untouched=7.0):
    """Set a boundary condition in a function; return x and u of the owned nodes of all ranks."""
    u = fem.Function(V)
    u.x.array[:] = untouched
    compat.set_prescribed(u.x.array, [bc])
    u.x.scatter_forward()
    owned = V.dofmap.index_map.size_local
    x = V.tabulate_dof_coordinates()[:owned, :2]
    rows = gathered(np.hstack([x, u.x.array.reshape(-1, 2)[:owned]]))
    return rows[:, :2], rows[:, 2:]


@pytest.mark.parametrize("degree", (1, 2))
def test_changed_constant_changes_the_condition(blocks, degree):
    V = compat.vector_space(blocks.mesh, degree)
    value = fem.Constant(blocks.mesh, PETSc.ScalarType((1.0, 2.0)))
    bc = dirichlet(V, blocks, "upper/top", value)
    value.value[1] = -3.0
    x, u = prescribed(V, bc)
    top = np.isclose(x[:, 1], 2.0)
    assert top.sum() == 3 * degree + 1
    assert (u[top] == (1.0, -3.0)).all() and (u[~top] == 7.0).all()


@pytest.mark.parametrize("component", (0, 1))
@pytest.mark.parametrize("constant", (False, True))
def test_one_component_leaves_the_other_free(blocks, component, constant):
    V = compat.vector_space(blocks.mesh, 1)
    value = fem.Constant(blocks.mesh, PETSc.ScalarType(0.0)) if constant else 0.5
    bc = dirichlet(V, blocks, "lower/bottom", value, component)
    if constant:
        value.value = 0.5
    x, u = prescribed(V, bc)
    bottom = np.isclose(x[:, 1], 0.0)
    assert (u[bottom, component] == 0.5).all() and (u[~bottom] == 7.0).all()
    assert (u[:, 1 - component] == 7.0).all()


def test_function_prescribes_nodal_values(blocks):
    V = compat.vector_space(blocks.mesh, 1)
    value = fem.Function(V)
    bc = dirichlet(V, blocks, "lower/left", value)
    value.interpolate(lambda x: x[:2] + 1.0)
    x, u = prescribed(V, bc)
    left = np.isclose(x[:, 0], 0.0)
    assert np.allclose(u[left], x[left] + 1.0) and (u[~left] == 7.0).all()


def test_several_boundaries_make_one_condition(blocks):
    V = compat.vector_space(blocks.mesh, 1)
    names = ["lower/left", blocks.boundary_tag("lower/right"), "lower/left"]
    x, u = prescribed(V, dirichlet(V, blocks, names, (0, 1)))
    sides = np.isclose(x[:, 0], 0.0) | np.isclose(x[:, 0], 2.2)
    assert sides.sum() == 6
    assert (u[sides] == (0, 1)).all() and (u[~sides] == 7.0).all()


def test_condition_needs_no_connectivity_made_before():
    x = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    own = slice(None) if COMM.rank == 0 else slice(0, 0)
    mesh = compat.create_mesh(COMM, np.arange(3).reshape(1, 3)[own], x[own], "triangle")
    mesh.topology.create_entities(1)
    facets = np.arange(mesh.topology.index_map(1).size_local, dtype=np.int32)
    data = MeshData(mesh, None, dmesh.meshtags(mesh, 1, facets, np.full_like(facets, 4)))
    V = compat.vector_space(mesh, 1)
    assert (prescribed(V, dirichlet(V, data, 4, (1.0, 2.0)))[1] == (1.0, 2.0)).all()


def test_condition_on_an_empty_boundary_raises_on_all_ranks(blocks):
    V = compat.vector_space(blocks.mesh, 1)
    match = r"boundary 99 has no facets; the mesh has \['lower/bottom',"
    raises_on_all_ranks(match, dirichlet, V, blocks, 99, (0.0, 0.0))
    raises_on_all_ranks("no boundary 'top'", dirichlet, V, blocks, "top", (0.0, 0.0))
    raises_on_all_ranks("no boundary is given", dirichlet, V, blocks, [], (0.0, 0.0))


def test_value_that_does_not_fit_raises_on_all_ranks(blocks):
    V, W = (compat.vector_space(blocks.mesh, 1) for _ in range(2))
    scalar = fem.Constant(blocks.mesh, PETSc.ScalarType(0.0))

    def raises(match, *args):
        raises_on_all_ranks(match, dirichlet, V, blocks, "lower/left", *args)

    raises(r"shape \(\); expected \(2,\)", 0.0)
    raises(r"shape \(\); expected \(2,\)", scalar)
    raises(r"shape \(2,\); expected \(\)", (0.0, 0.0), 1)
    raises("component is 2; expected 0, 1 or None", 0.0, 2)
    raises("belong to the same space", fem.Function(W))
    raises("prescribes both components", fem.Function(V), 0)


def test_space_that_does_not_fit_raises_on_all_ranks(blocks):
    other = compat.vector_space(read(two_blocks.build).mesh, 1)
    mixed = compat.mixed_space(blocks.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    for space, match in ((other, "another mesh"), (mixed, r"take W.sub\(0\)")):
        raises_on_all_ranks(match, dirichlet, space, blocks, "lower/left", (0.0, 0.0))
