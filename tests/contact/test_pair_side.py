# SPDX-License-Identifier: MIT
"""Nodes and dofs of the sides of a pair: a user's own terms from D, M and the multipliers."""

from petsc4py import PETSc

import numpy as np
import pytest
from refusal import COMM
from scenes import TIGHT, internal, neo_hookean

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, arrays, block

GRIDS = [
    Grid("lower", block(5, 2, width=1.2, height=1.0, corner=(-0.1, 0.0))),
    Grid("upper", block(4, 2, width=1.0, height=1.0, corner=(0.0, 1.0))),
]
FIXED = "lower/bottom", "upper/top"


def pressed(degree=1, sides=("upper/bottom", "lower/top")):
    """Blocks with friction, pressed and sheared; also the points of the mesh."""
    given = arrays(GRIDS)
    data = fm.mesh_from_arrays(**given)
    V = fm.vector_space(data.mesh, degree)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.01, -0.04))
    bcs = [fm.dirichlet(V, data, name, p) for name, p in zip(FIXED, ((0.0, 0.0), push))]
    pair = fm.ContactPair(data, *sides, law=fm.Coulomb(0.3))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u, [pair], bcs=bcs, newton=TIGHT,
        petsc_options_prefix="side_",
    )  # fmt: skip
    problem.solve()
    return problem, given["points"]


def mixed():
    """Pressure and displacement, in this order, pressed."""
    data = fm.mesh_from_arrays(**arrays(GRIDS))
    W = fm.mixed_space(data.mesh, ("Lagrange", 1), ("Lagrange", 2, (2,)))
    w = fem.Function(W)
    (p, u), (q, v) = ufl.split(w), ufl.TestFunctions(W)
    stress = 80.0 * ufl.sym(ufl.grad(u)) + p * ufl.Identity(2)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    residual = (ufl.inner(stress, ufl.grad(v)) + q * (ufl.div(u) - 0.01 * p)) * dx
    push = fem.Function(W.sub(1).collapse()[0])
    push.interpolate(lambda x: np.stack([0.0 * x[0], -0.02 * (x[1] > 1.5)]))
    bcs = [fm.dirichlet(W.sub(1), data, name, push) for name in FIXED]
    problem = fm.ContactProblem(
        residual, w, [fm.ContactPair(data, "upper/bottom", "lower/top")], bcs=bcs, newton=TIGHT,
        displacement=1, petsc_options_prefix="side_",
    )  # fmt: skip
    problem.solve()
    return problem


def assembled(problem, num_owned):
    """Contact forces at all dofs and their sums by side: the example of ``PairSide``."""
    contact, matrices = problem.contacts[0], problem.matrices
    forces = PETSc.Vec().createMPI((num_owned, None), comm=COMM)
    sides = (matrices.D(0), contact.slave, 1.0), (matrices.M(0), contact.master, -1.0)
    sums = np.zeros((2, 2))
    for total, (matrix, side, sign) in zip(sums, sides, strict=True):
        assert matrix.size == (len(contact.slave.X), len(side.X))
        on_nodes, rows = matrix.createVecs()
        (first, stop), (begin, end) = (v.getOwnershipRange() for v in (rows, on_nodes))
        for component in (0, 1):
            rows.array[:] = contact.tractions[first:stop, component]
            matrix.multTranspose(rows, on_nodes)
            dofs = side.dofs[begin:end, component].astype(PETSc.IntType)
            forces.setValues(dofs, sign * on_nodes.array, PETSc.InsertMode.ADD_VALUES)
            total[component] = sign * on_nodes.sum()
    forces.assemble()
    return forces, sums


@pytest.mark.parametrize("make", [pressed, lambda: pressed(2), lambda: (mixed(), None)])
def test_forces_of_a_user_are_those_of_the_contact(make):
    problem, _ = make()
    exact = problem.forces()[1]
    forces, (on_slave, on_master) = assembled(problem, exact.size)
    total = problem.contacts[0].total_force
    size = np.abs(total).max()
    assert size > 0.5
    assert np.abs(on_slave + total).max() < 1e-13 * size
    assert np.abs(on_slave + on_master).max() < 1e-13 * size
    assert np.abs(forces.array - exact).max(initial=0.0) < 1e-13 * size


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_are_those_of_the_mesh_input(degree):
    problem, points = pressed(degree)
    contact, space = problem.contacts[0], problem.equations.bulk.V
    data = contact.pair.data
    for side, name in ((contact.slave, "upper/bottom"), (contact.master, "lower/top")):
        assert side.name == name
        known = side.input_nodes >= 0
        assert known.sum() == {"upper/bottom": 5, "lower/top": 6}[name]
        assert np.abs(points[side.input_nodes[known]] - side.X[known]).max() < 1e-15
        assert known.all() or degree == 2
        first, stop = space.dofmap.index_map.local_range
        mine = known & (first <= side.nodes) & (side.nodes < stop)
        here = data.node_dofs(space, side.input_nodes[mine])
        assert np.array_equal(here, side.nodes[mine] - first)
        assert np.array_equal(side.dofs, 2 * side.nodes[:, None] + np.arange(2))
        everywhere = COMM.allgather([a.tolist() for a in (side.nodes, side.input_nodes, side.X)])
        assert all(other == everywhere[0] for other in everywhere)
    moved = data.nodal_values(problem.equations.bulk.u, contact.slave.input_nodes)
    corners = contact.slave.input_nodes >= 0
    assert np.allclose(
        (contact.slave.X + moved)[corners], contact.positions[corners], rtol=0.0, atol=1e-14
    )


def test_sides_of_obstacles_and_of_a_surface_itself():
    contact = pressed(sides=("upper/bottom", fm.Plane((0.0, 1.0), (0.0, 1.0))))[0].contacts[0]
    assert contact.master.X.shape == contact.master.dofs.shape == (0, 2)
    assert contact.master.nodes.size == contact.master.input_nodes.size == 0
    itself = pressed(sides=[["upper/bottom", "lower/top"]])[0].contacts[0]
    assert np.array_equal(itself.master.nodes, itself.slave.nodes)
    assert itself.slave.nodes.size == 11
    itself.slave.X[:] = 0.0  # a copy
    assert np.ptp(itself.slave.X) > 1.0
