# SPDX-License-Identifier: MIT
"""The report states which solver was used and why."""

from dataclasses import replace

import numpy as np
import pytest
import space_supported
from scenes import linear_elastic, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.la import solver
from fenics_mortar.la.options import COSTS
from fenics_mortar.utils import compat
from meshes.mapped_boxes import Box, block

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


def test_factors_get_more_memory_where_pivots_need_it():
    """Friction holds a block between three planes; the estimate of MUMPS is too low for it."""
    made = space_supported.scene(Box("block", block((2, 2, 2))), load=(0.05, 0.0, -0.3))
    planes = {"bottom": ((0, 0, 0), (0, 0, 1)), "left": ((0, 0, 0), (1, 0, 0))}
    planes["right"] = (1, 0, 0), (-1, 0, 0)
    made.touch(*[(f"block/{side}", fm.Plane(*plane)) for side, plane in planes.items()], mu=0.8)
    assert made.problem.solve().num_iterations <= 8
    force = sum(contact.forces.sum(axis=0) for contact in made.problem.contacts)
    assert np.abs(force - [-0.05, 0.0, 0.3]).max() < 1e-9
