# SPDX-License-Identifier: MIT
"""Unsupported bodies and singular systems."""

import pytest
from array_meshes import blocks_of_arrays, problem_on
from refusal import refused
from scenes import linear_elastic, read
from small_scenes import SMALL, pushed_block

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes import two_blocks


@pytest.mark.once
def test_body_pulled_off_is_named_with_its_motion():
    problem = pushed_block(load=1.0)
    with refused(fm.NotConvergedError, r"body 'upper' can (move|rotate) .* freely", "stop"):
        problem.solve()


def test_unnamed_body_is_described_by_its_position():
    """One that the lower body lifts."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.01))]
    problem = problem_on(data, u=u, bcs=bcs)
    (note,) = problem.solve().notes
    assert note.startswith("nothing holds the body around (0.9, 1.5), and no contact force acts")


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_touching_body_is_supported_by_contact(algorithm):
    """Nodes that touch are active from the start; only sliding is prescribed."""
    problem = pushed_block(pin=(0,), algorithm=algorithm)
    assert problem.solve().converged
    assert problem.equations.contacts[0].total_force[1] == pytest.approx(1.0, rel=1e-8)


# Singular systems


def test_body_without_stiffness_is_refused():
    data = read(two_blocks.build, **SMALL)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V, stress = u.function_space, linear_elastic(u, 100.0, 0.3)
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    work = ufl.inner(stress, ufl.grad(ufl.TestFunction(V)))
    residual = work * dx(data.bodies["lower"])
    bcs = [fm.dirichlet(V, data, b, (0.0, 0.0)) for b in ("lower/bottom", "upper/top")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    with refused(fm.MortarError, r"no stiffness at 15 nodes, one at \(.*\), of body 'upper'"):
        fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="test_errors_")


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_singular_system_is_reported_and_can_be_repaired(algorithm):
    data = read(two_blocks.build, **SMALL)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V, E = u.function_space, fem.Constant(data.mesh, 100.0)
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    stiff, soft = (
        ufl.inner(linear_elastic(u, modulus, 0.3), ufl.grad(ufl.TestFunction(V)))
        for modulus in (100.0, E)
    )
    residual = stiff * dx(data.bodies["lower"]) + soft * dx(data.bodies["upper"])
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(V, data, "upper/top", (0.0, -0.01))]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, algorithm=algorithm, petsc_options_prefix="test_errors_"
    )
    E.value = 0.0
    with refused(fm.NotConvergedError, "iteration 1: .*singular"):
        problem.solve()
    E.value = 100.0
    assert problem.solve().converged
