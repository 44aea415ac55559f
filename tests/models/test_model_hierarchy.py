# SPDX-License-Identifier: MIT
"""Solves with the model hierarchy: final models and restored states."""

import numpy as np
import pytest
from model_check_scenes import MESH
from scenes import TIGHT, internal, neo_hookean, nodal, pressed_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.models.model_error import ENERGY, QUANTITIES, SolutionQuantities, differences

STRICT = {"tolerance": 1e-6, "discretisation": 1e-6}
PATH = [(0.0, -0.02), (0.05, -0.1), (0.1, -0.1)]


def hierarchy_path(law=None, **check):
    """Blocks with the full model or with the hierarchy, and the number of factorizations of K."""
    scene = pressed_blocks(**MESH)
    u = fem.Function(scene.u.function_space)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", law=law)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u, [pair], bcs=scene.problem.equations.bulk.bcs,
        petsc_options_prefix="test_", newton=TIGHT,
        model_check=fm.ModelCheck(hierarchy=True, **check) if check else None,
    )  # fmt: skip
    steps, advance = [], problem.equations.advance
    problem.equations.advance = lambda: steps.append(1) or advance()
    return problem, scene.loads["push"].value, steps


@pytest.mark.parametrize("law", [None, fm.Coulomb(0.2)])
def test_hierarchy_ends_on_the_full_model_if_needed(law):
    """Slip is counted from the accepted states, independent of the models tried in between."""
    (full, push, _), (problem, same_push, _) = hierarchy_path(law), hierarchy_path(law, **STRICT)
    for step in PATH:
        push[:] = same_push[:] = step
        full.solve()
        report = problem.solve()
        assert report.certificate.violations() == []
        assert report.model_check.suffices and not report.model_check.assumptions
        u, w = nodal(full), nodal(problem)
        assert np.abs(u - w).max() < 1e-9 * np.abs(u).max()
        z, w = full.equations.contacts[0].z, problem.equations.contacts[0].z
        assert np.abs(z - w).max() < 1e-8 * np.abs(z).max()


def test_hierarchy_ends_on_a_sufficient_model():
    """One step of the full model per load; the result is that of the cheap model.

    No step for the second load, which is only a tenth above the checked one.
    """
    (full, push, steps), (problem, same_push, few) = (
        hierarchy_path(),
        hierarchy_path(tolerance=0.05),
    )
    for depth in (0.005, 0.0055, 0.02):
        push[1] = same_push[1] = -depth
        full.solve()
        report = problem.solve()
        (assumption,) = report.model_check.assumptions
        assert assumption.name == "linear strain and small sliding" and report.model_check.suffices
        assert report.certificate.violations() == []
        true = differences(problem, SolutionQuantities.of(problem), SolutionQuantities.of(full))
        for name in QUANTITIES:  # errors of the model's forces
            assert 0.9 < assumption.errors[name] / true[name] < 1.1, (name, true)
    assert len(few) == 2 and len(steps) >= 8


def test_hierarchy_ends_on_an_intermediate_model():
    """Slip of a facet with hardly any strain: linear bulk with finite sliding."""
    problem, push, steps = hierarchy_path(tolerance=0.02)
    full, same_push, _ = hierarchy_path()
    push[:] = same_push[:] = (0.3, -0.003)
    names = [a.name for a in problem.solve().model_check.assumptions]
    assert names == ["linear strain"]
    full.solve()
    true = differences(problem, SolutionQuantities.of(problem), SolutionQuantities.of(full))
    assert 1e-5 < true[ENERGY] < 0.02
    del steps[:]
    problem.solve()
    assert not steps  # the cheaper model is not tried again, and this one not checked again


@pytest.mark.once
def test_hierarchy_ends_at_the_error_of_the_mesh():
    """The error of the mesh is known or estimated, and stated in the table."""
    for known in ({}, {"discretisation": 0.5}):
        problem, push, _ = hierarchy_path(tolerance=1e-4, **known)
        push[1] = -0.02
        model_check = problem.solve().model_check
        (assumption,) = model_check.assumptions
        assert not model_check.suffices and model_check.discretisation > model_check.error
        assert model_check.verdict(assumption) == "refine the mesh first"


@pytest.mark.once
def test_mesh_error_and_model_error_are_separate():
    """Slip of facets with small sliding causes residuals that are not errors of the mesh."""
    problem, push, _ = hierarchy_path(tolerance=1e-4)
    (full, same_push, _) = hierarchy_path()
    push[:] = same_push[:] = (0.4, -0.03)
    model_check = problem.solve().model_check
    full.solve()
    assert model_check.discretisation == pytest.approx(full.estimate().relative, rel=0.2)
    true = differences(problem, SolutionQuantities.of(problem), SolutionQuantities.of(full))[ENERGY]
    assert true < model_check.discretisation


@pytest.mark.once
def test_hierarchy_continues_after_a_failed_model(monkeypatch):
    """A cheap model without solution has no effect."""
    (full, push, _), (problem, same_push, _) = hierarchy_path(), hierarchy_path(tolerance=0.5)
    hierarchy = problem.equations.model_check._hierarchy
    hierarchy._enter(1)
    hierarchy._enter(0)
    assert len(hierarchy._made) == len(hierarchy._cheaper) == 2
    for model in hierarchy._made.values():

        def fail(model=model):
            model.equations.bulk.u.x.array[:] = 0.01
            raise fm.MortarError("no")

        monkeypatch.setattr(model, "solve", fail)
    push[:] = same_push[:] = PATH[1]
    full.solve()
    problem.solve()
    u, w = nodal(full), nodal(problem)
    assert np.abs(u - w).max() < 1e-9 * np.abs(u).max()
