# SPDX-License-Identifier: MIT
"""The report states which solver was used and why."""

from dataclasses import replace

import pytest
from scenes import linear_elastic, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.la import solver
from fenics_mortar.la.options import COSTS
from fenics_mortar.utils import compat

pytestmark = pytest.mark.serial
MESH = {"n_upper": 4, "n_lower": 5, "layers_upper": 2, "layers_lower": 2}
MULTIGRID = "gmres with multigrid" + (
    "" if compat.petsc_has("hypre") else " by PETSc's gamg, without hypre"
)
PETSC = "petsc" + (
    "" if compat.petsc_has("suitesparse", "amd") else " in order nd, without SuiteSparse"
)


def solver_of(**options):
    of_scene = {name: options.pop(name) for name in ("material", "pair") if name in options}
    scene = pressed_blocks(problem=options, **of_scene, **MESH)
    scene.loads["push"].value[1] = -0.02
    return scene.problem.solve().solver


@pytest.mark.parametrize(
    "options, phrase",
    [
        ({}, f"{PETSC} (fewer than 100,000 unknowns, at most 20,000 on one rank)"),
        ({"solver": "direct"}, f"{PETSC} (solver='direct', at most 20,000 on one rank)"),
        ({"solver": "iterative"}, f"{MULTIGRID} (solver='iterative')"),
        ({"petsc_options": {"mat_mumps_icntl_14": 80}}, "by mumps (PETSc options are given)"),
        ({"algorithm": "saddle"}, "saddle-point system (algorithm='saddle')"),
        (
            {"pair": {"discretization": fm.Discretization("standard")}},
            "so D is not diagonal), 66 unknowns",
        ),
        ({"linear_bulk": True, "material": linear_elastic}, "(linear_bulk=True)"),
    ],
)
def test_choices_have_reasons(options, phrase):
    assert phrase in solver_of(**options)


def test_many_unknowns_and_long_rows_are_reasons(monkeypatch):
    with monkeypatch.context() as changed:
        changed.setattr("fenics_mortar.la.condensed.costs_of", lambda dim: replace(COSTS, many=10))
        assert f"{MULTIGRID} (at least 10 unknowns)" in solver_of()
    monkeypatch.setattr(solver, "COSTS", replace(COSTS, long_rows=1))
    assert "factors by mumps (rows of factors longer than 1)" in solver_of()


def test_earlier_factors_are_counted_anew_in_each_solve(monkeypatch):
    monkeypatch.setattr(solver, "MIN_LAGGED", 0)
    scene = pressed_blocks(**MESH)
    for push in (-0.02, -0.021):
        scene.loads["push"].value[1] = push
        report = scene.problem.solve()
        phrase = f"of {report.num_iterations} solutions by gmres with earlier factors"
        assert phrase in report.solver
