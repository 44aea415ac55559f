# SPDX-License-Identifier: MIT
"""The strip along contact surfaces: products of its solutions, and reuse of the cycle."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import pressed_blocks
from space_pairs import pressed

import fenics_mortar as fm
from fenics_mortar.la.multigrid import ContactPreconditioner, Replacement
from fenics_mortar.la.touching import Strip

comm = MPI.COMM_WORLD
MESH = {"n_upper": 12, "n_lower": 20, "layers_upper": 12, "layers_lower": 12}


def solved(**problem):
    """Multigrid and matrix after a solve."""
    scene = pressed_blocks(problem={"solver": "iterative", **problem}, **MESH)
    scene.loads["push"].value[1] = -0.05
    scene.problem.solve()
    system = scene.problem.equations.system
    return system.solver.multigrid, system.matrix, scene


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_products_with_solutions_of_the_strip_need_only_its_neighbourhood(algorithm):
    multigrid, A, _ = solved(algorithm=algorithm)
    strip = multigrid._strip
    strip.factor(A)
    assert strip._columns.getInfo(True)["nz_used"] < 0.7 * A.getInfo(True)["nz_used"]
    b, x = A.createVecLeft(), A.createVecRight()
    first, end = A.getOwnershipRange()
    b.array[:] = np.cos(np.arange(first, end) ** 2.0)
    strip.solve(b, x)
    whole, rest = A.createVecLeft(), b.copy()
    A.mult(x, whole)
    strip.subtract_product(x, rest)
    assert (b - whole - rest).norm() < 1e-12 * b.norm()
    A.multTranspose(b, whole)
    b.copy(rest)
    strip.subtract_transposed(b, rest)
    left = (b - whole - rest).array_r[strip._solved]
    assert np.abs(left).max(initial=0.0) < 1e-12 * whole.norm()


def test_cycle_is_kept_while_a_small_share_of_the_active_nodes_changes():
    multigrid, _, scene = solved()
    active = scene.problem.equations.contacts[0].active
    assert active.sum() >= 10
    multigrid._replacement, multigrid._sets = Replacement(2), [active.copy()]
    multigrid._sets[0][np.flatnonzero(active)[:2]] = False
    assert not multigrid._is_outdated()
    multigrid._sets[0][:] = False
    assert multigrid._is_outdated()


@pytest.mark.parametrize("algorithm, options", [("condensed", "petsc"), ("saddle", "mumps")])
def test_rows_of_multipliers_need_pivots(algorithm, options):
    multigrid, A, _ = solved(algorithm=algorithm)
    strip = multigrid._strip
    assert strip._options["redundant_pc_factor_mat_solver_type"] == options
    b, x = A.createVecLeft(), A.createVecRight()
    b.array[strip._rows] = np.cos(strip._rows**2.0)
    strip.solve(b, x)
    residual = b.copy()
    strip.subtract_product(x, residual)
    assert np.abs(residual.array_r[strip._rows]).max(initial=0.0) < 1e-10


def test_factors_are_updated_with_values_and_renewed_with_the_pattern():
    multigrid, A, _ = solved()
    strip = multigrid._strip
    before = strip._factors.handle
    A.scale(2.0)
    strip.factor(A)
    assert strip._factors.handle == before
    other = A.copy()
    strip.factor(other)
    b, x = other.createVecLeft(), other.createVecRight()
    b.array[strip._rows] = 1.0
    strip.solve(b, x)
    strip.subtract_product(x, b)
    assert np.abs(b.array_r[strip._rows]).max(initial=0.0) < 1e-10


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_in_space_an_assembly_frees_what_belongs_to_the_last_matrix(algorithm):
    """Factors only if the sets have changed."""
    problem = {"solver": "iterative", "algorithm": algorithm}
    scene = pressed("tetrahedron", law=fm.Coulomb(0.3), problem=problem)
    scene.move(0.02, 0.0, -0.04)
    system, (contact,) = scene.problem.equations.system, scene.problem.equations.contacts
    before, strip = system.matrix, system.solver.multigrid._strip
    system.assemble()
    assert before.getRefCount() == 1  # that of this test
    assert system.matrix.handle != before.handle
    assert strip._factors is not None
    contact.change(active=contact.active & (np.arange(contact.active.size) % 3 > 0))
    system.assemble()
    assert strip._factors is None


def test_in_space_the_strip_is_factored_while_sets_change(monkeypatch):
    """Of a load step; with the factors of the iteration before, the solution is the same."""
    made, states = [], []
    compute = Strip._compute_factors
    monkeypatch.setattr(Strip, "_compute_factors", lambda strip: made.append(compute(strip)))
    for keeps in (True, False):
        if not keeps:
            monkeypatch.setattr(ContactPreconditioner, "_keeps_factors", lambda multigrid: False)
        made.clear()
        scene = pressed("tetrahedron", law=fm.Coulomb(0.3), problem={"solver": "iterative"})
        report = scene.move(0.02, 0.0, -0.04)
        changed = [it.num_changed > 0 for it in report.iterations[:-1]]
        assert len(made) == (1 + sum(changed[1:]) if keeps else len(changed))
        assert not keeps or len(made) < len(changed)
        states.append(scene.problem.equations.bulk.values.copy())
    assert np.abs(states[0] - states[1]).max() < 1e-9 * np.abs(states[1]).max()


def test_in_space_the_strip_is_that_of_the_present_sets_and_of_those_of_the_cycle():
    """Nodes that came and left since the cycle was made are no part of it."""
    scene = pressed("tetrahedron", problem={"solver": "iterative"})
    scene.move(0.0, 0.0, -0.04)
    equations, rows = scene.problem.equations, []
    (contact,), multigrid = equations.contacts, equations.system.solver.multigrid
    all_of_them, x = contact.active, contact.slave.X[:, 0]
    half = all_of_them & (x < np.median(x))
    multigrid.reset(None)
    for active in (half, all_of_them, half, all_of_them & ~half):
        contact.change(active=active)
        equations.linearize()
        equations.solve_linear()
        rows.append(multigrid._strip.num_rows)
    assert rows[0] == rows[2] < rows[1]
    assert rows[3] == rows[1]  # the cycle is as stiff as if the other half were still in contact
