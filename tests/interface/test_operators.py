# SPDX-License-Identifier: MIT
"""D, M, gap, normals and derivatives as PETSc objects; shares of the ranks."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import pressed_blocks

from fenics_mortar.interface.integrals import share_of
from fenics_mortar.interface.reference import hand_over, inverse_of

comm = MPI.COMM_WORLD


def moved_scene(**options):
    """A state with partly covered facets, off any symmetry."""
    scene = pressed_blocks(n_upper=7, n_lower=5, width_upper=1.3, width_lower=1.2, **options)
    scene.u.interpolate(lambda X: np.stack([0.03 * X[1] + 0.01 * X[0] ** 2, -0.02 * X[0] * X[1]]))
    scene.u.x.scatter_forward()
    contact = scene.contact
    contact.evaluate(scene.u.x.array, scene.problem.equations.linearization)
    contact.update_active(start=True)
    return scene


def dense(mat):
    """The whole matrix on every rank."""
    rows = mat[slice(*mat.getOwnershipRange()), :]
    return np.concatenate(comm.allgather(rows))


def whole(vec):
    return np.concatenate(comm.allgather(vec.array))


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("basis", ["dual", "standard"])
@pytest.mark.parametrize("degree", [1, 2])
def test_row_sums_of_D_and_M_are_equal(slave, basis, degree):
    problem = moved_scene(slave=slave, pair={"basis": basis}, degree=degree).problem
    D, M = dense(problem.matrices.D(0)), dense(problem.matrices.M(0))
    assert np.abs(D.sum(axis=1) - M.sum(axis=1)).max() < 1e-15
    if basis == "dual":  # except for functions with negative integral, which are handed over
        kept = np.diag(D) > 0.0
        assert np.abs(D - np.diag(np.diag(D)))[:, kept].max() == 0.0
        assert kept.all() or degree == 2


def test_operators_do_not_depend_on_the_number_of_ranks():
    scene = moved_scene()
    reference = comm.bcast(scene.contact.operators.gap)
    assert np.array_equal(scene.contact.operators.gap, reference)
    D = dense(scene.problem.matrices.D(0))
    assert np.abs(np.diag(D) - scene.contact.operators.diagonal).max() < 1e-16


@pytest.mark.parametrize("degree", [1, 2])
def test_linear_fields_pass_exactly_from_master_to_slave(degree):
    scene = pressed_blocks(n_upper=7, n_lower=5, width_upper=1.0, width_lower=1.2, degree=degree)
    scene.problem.equations.evaluate(start=True)
    D, M, contact = (
        dense(scene.problem.matrices.D(0)),
        dense(scene.problem.matrices.M(0)),
        scene.contact,
    )
    linear = np.array([1.0, -2.0])
    assert np.abs(D @ contact.slave.X @ linear - M @ contact.master.X @ linear).max() < 1e-14


@pytest.mark.parametrize("degree", [1, 2])
def test_derivative_matrices_are_the_change_of_the_operators(degree):
    scene = moved_scene(degree=degree)
    problem, contact = scene.problem, scene.contact
    z = np.random.default_rng(0).uniform(-1, 1, contact.z.shape)
    matrices = problem.matrices
    found = {
        "gap": matrices.gap_derivative(),
        "normals": matrices.normals_derivative(),
        "slave": matrices.slave_force_derivative(z),
        "master": matrices.master_force_derivative(z),
    }
    size, first = problem.equations.bulk.num_owned, problem.equations.bulk.first
    direction = np.random.default_rng(1).uniform(-1, 1, problem.equations.bulk.r.getSize())
    mine = direction[first : first + size]
    u0 = scene.u.x.array[:size].copy()

    def functions(step):
        scene.u.x.array[:size] = u0 + step * mine
        scene.u.x.scatter_forward()
        contact.evaluate(scene.u.x.array, problem.equations.linearization)
        on_slave, on_master = contact.operators.force(z)
        forces = []
        for side, values in ((contact.slave, on_slave), (contact.master, on_master)):
            target = np.zeros(size)
            side.scatter_add(values, target)
            forces.append(np.concatenate(comm.allgather(target)))
        gap, normals = whole(problem.matrices.gap()), whole(problem.matrices.normals())
        return {"gap": gap, "normals": normals, "slave": forces[0], "master": forces[1]}

    # the central difference errs by (step / distance of nodes)^2 and by rounding, 1e-16 / step
    step = 2e-6
    plus, minus = functions(step), functions(-step)
    for name, matrix in found.items():
        exact = (plus[name] - minus[name]) / (2 * step)
        vector = matrix.createVecRight()
        vector.array[:] = mine
        error = np.abs(whole(matrix * vector) - exact).max() / np.abs(exact).max()
        assert error < 1e-8, name


def test_facets_are_distributed_evenly_over_ranks():
    sizes = comm.allgather(share_of(np.arange(101), comm).size)
    assert sum(sizes) == 101 and max(sizes) - min(sizes) <= 1


def test_functions_are_handed_to_the_nearest_multiplier_nodes():
    carries = [[1, 1, 1], [1, 0, 1], [0, 0, 1], [1, 1, 0], [0, 0, 0]]
    middle_to_both = [[1.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.5, 1.0]]
    all_to_last = [[0.0] * 3, [0.0] * 3, [1.0] * 3]
    last_to_middle = [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]]
    expected = [np.eye(3), middle_to_both, all_to_last, last_to_middle, np.zeros((3, 3))]
    assert (hand_over(np.array(carries, bool)) == expected).all()
    two = [[[1.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [1.0, 1.0]]]
    assert (hand_over(np.eye(2, dtype=bool)) == two).all()


@pytest.mark.serial
def test_cover_without_area_has_dual_functions_that_sum_to_one():
    """The mass matrix of a line across a facet is singular; others have their inverse."""
    values = np.array([0.7, 0.2, 0.1])
    line, whole_facet = np.outer(values, values), np.ones((3, 3)) + np.eye(3)
    inverses = inverse_of(np.array([line, np.zeros((3, 3)), whole_facet]))
    assert np.allclose(line @ inverses[0] @ line, line, rtol=0.0, atol=1e-14)
    dual = (line.sum(axis=1)[:, None] * inverses[0] @ values).sum()
    assert np.isclose(dual, 1.0, rtol=1e-13)
    assert not inverses[1].any()
    assert np.allclose(inverses[2] @ whole_facet, np.eye(3), rtol=0.0, atol=1e-14)
