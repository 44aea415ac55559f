# SPDX-License-Identifier: MIT
"""Failed solves: messages, retained data, and the solution of a smaller step afterwards."""

import numpy as np
import pytest
from array_meshes import blocks_of_arrays, problem_on
from refusal import COMM, refused
from scenes import neo_hookean
from small_scenes import small_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm

# No convergence


def failure(problem):
    """Solve, and return the record of the failure."""
    with pytest.raises(fm.NotConvergedError) as caught:
        problem.solve()
    return caught.value.report


def assert_nothing_lost(problem, report):
    """The record so far, the displacement and the multipliers are accessible."""
    assert not report.converged
    assert len(report.iterations) >= 1
    assert report.reason in report.table()
    assert len(set(COMM.allgather(repr(report.residuals)))) == 1
    for contact in problem.equations.contacts:
        assert contact.z.shape == (contact.slave.num_nodes, 2)
        assert contact.active_nodes.size <= contact.slave.num_nodes
    assert problem.equations.bulk.inverted_cells()[0] >= 0


def test_exceeded_iterations_name_failed_tests_and_can_be_continued():
    scene = small_blocks(problem={"newton": fm.NewtonOptions(max_iterations=1)})
    scene.loads["push"].value[1] = -0.05
    with refused(fm.NotConvergedError, "not converged in 1 iterations", "residual .*allowed"):
        scene.problem.solve()
    report = failure(scene.problem)
    assert report.num_iterations == 1
    assert_nothing_lost(scene.problem, report)
    scene.problem.equations.newton = fm.NewtonOptions()
    assert scene.problem.solve().converged


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("material", [neo_hookean, "no logarithm"])
@pytest.mark.parametrize("first", [-0.05, None])
def test_inverted_cells_are_reported_and_a_smaller_step_converges(material, algorithm, first):
    material = squared_volume if material == "no logarithm" else material
    scene = small_blocks(material=material, problem={"algorithm": algorithm})
    push, contact = scene.loads["push"].value, scene.contact
    if first is not None:
        push[1] = first
        scene.problem.solve()
    u_before = scene.u.x.array.copy()
    push[1] = -5.0
    with refused(fm.NotConvergedError, r"cells are inverted( at nodes)?, one at \(.*\)"):
        scene.problem.solve()
    scene.u.x.array[:] = u_before
    assert_nothing_lost(scene.problem, failure(scene.problem))
    scene.u.x.array[:] = u_before
    push[1] = -0.08
    assert scene.problem.solve().converged
    again = contact.z.copy()
    fresh = small_blocks(material=material, problem={"algorithm": algorithm})
    fresh.loads["push"].value[1] = -0.08
    assert fresh.problem.solve().converged
    assert np.allclose(again, fresh.contact.z, rtol=1e-8, atol=1e-8 * np.abs(again).max())


def squared_volume(u, E, nu):
    """A law that is finite for inverted cells as well: neo-Hookean with (J - 1)^2."""
    F = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(F)
    return E / 3 * (F - ufl.cofac(F)) + E * (J - 1.0) * ufl.cofac(F)


def test_inverted_cells_are_counted_and_located():
    scene = small_blocks()
    scene.u.interpolate(lambda x: (np.zeros_like(x[0]), -2.0 * x[1]))
    where = r"30 cells are inverted, one at \(0.1\d+, 0.1667\)"
    with refused(fm.NotConvergedError, "iteration 0: .* not finite", where, "smaller load"):
        scene.problem.solve()
    assert_nothing_lost(scene.problem, failure(scene.problem))
    scene.u.x.array[:] = 0.0
    assert scene.problem.solve().converged


def test_inverted_cells_at_the_start_are_named():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    u.interpolate(lambda x: (np.zeros_like(x[0]), -2.0 * x[1]))
    with refused(fm.MortarError, r"21 cells are inverted, one at \(.*\)", "initial displacement"):
        problem_on(data, u=u)
