# SPDX-License-Identifier: MIT
"""Options of PETSc: read, reported if misspelt, rejected with a message."""

import subprocess
import sys

from petsc4py import PETSc

import pytest
from refusal import refused
from scenes import linear_elastic, pressed_blocks
from small_scenes import small_blocks

import fenics_mortar as fm


def solved_with(options, **more):
    scene = small_blocks(problem={"petsc_options": options, **more})
    scene.loads["push"].value[1] = -0.02
    return scene.problem


def test_misspelt_petsc_option_is_reported_once():
    problem = solved_with({"ksp_rtoll": 1e-3, "mat_mumps_icntl_7": 2})
    message = "did not use the option 'test_ksp_rtoll': misspelt"
    assert sum(message in note for note in problem.solve().notes) == 1
    assert not any("did not use" in note for note in problem.solve().notes)


@pytest.mark.parametrize("sliding", ["small", "finite"])
def test_misspelt_option_is_reported_with_linear_bulk(sliding):
    """The solver of the whole system is not used in this case."""
    options = {"ksp_rtoll": 1e-3, "ksp_type": "preonly"}
    on_line = PETSc.Options("test_")
    on_line["compliance_mat_mumps_icntl_144"] = 1
    try:
        scene = pressed_blocks(
            material=linear_elastic, pair={"sliding": sliding},
            problem={"petsc_options": options, "linear_bulk": True},
        )  # fmt: skip
        scene.loads["push"].value[1] = -0.02
        notes = scene.problem.solve().notes
    finally:
        on_line.delValue("compliance_mat_mumps_icntl_144")
    names = "'test_compliance_mat_mumps_icntl_144', 'test_ksp_rtoll': misspelt"
    assert sum(f"did not use the option {names}" in note for note in notes) == 1
    assert not any("did not use" in note for note in scene.problem.solve().notes)


@pytest.mark.once
def test_used_options_are_not_reported():
    problem = solved_with({"ksp_type": "gmres", "ksp_rtol": 1e-9, "pc_type": "lu"})
    assert not any("PETSc" in note for note in problem.solve().notes)
    problem = solved_with({"ksp_rtol": 1e-9}, solver="iterative")
    assert not any("PETSc" in note for note in problem.solve().notes)


@pytest.mark.parametrize("preconditioner", ["ilu", "jacobi"])
@pytest.mark.serial
def test_preconditioner_needs_no_options_that_undo_those_of_mumps(preconditioner):
    options = {"pc_type": preconditioner, "ksp_rtol": 1e-10, "ksp_max_it": 2000}
    report = solved_with(options, algorithm="condensed").solve()
    assert f"gmres with {preconditioner}" in report.solver
    assert not any("PETSc" in note for note in report.notes)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"ksp_type": "gmress"}, "KSP type gmress"),
        ({"ksp_type": "gmres", "ksp_rtol": "tiny"}, "tiny has no numeric"),
    ],
)
def test_invalid_petsc_value_is_named(options, message):
    with refused(fm.MortarError, f"PETSc rejected an option 'test_...': .*{message}"):
        solved_with(options)


def test_linear_solver_that_stops_too_early_is_not_called_singular():
    problem = solved_with({"ksp_type": "gmres", "pc_type": "jacobi", "ksp_rtol": 1e-3})
    message = (
        r"stopped too early: PETSc's reason 2 \(CONVERGED_RTOL\), reduce the tolerance .*ksp_rtol"
    )
    with refused(fm.NotConvergedError, f"^(?!.*singular).*{message}"):
        problem.solve()


def test_linear_solver_that_does_not_converge_is_not_called_singular():
    problem = solved_with({"ksp_type": "gmres", "pc_type": "jacobi", "ksp_max_it": 3})
    message = r"did not converge: PETSc's reason -3 \(DIVERGED_MAX_IT\)"
    with refused(fm.NotConvergedError, f"^(?!.*singular).*{message}"):
        problem.solve()


SCRIPT = """
import sys
from mpi4py import MPI
import petsc4py
petsc4py.init(sys.argv)
from test_petsc_options import solved_with
problem = solved_with({})
report = problem.solve()
print(problem.equations.system.ksp.getType(), *report.notes)
"""


@pytest.mark.serial
@pytest.mark.parametrize("options", [{}, {"ksp_type": "gmres", "ksp_monitor": ""}], ids=str)
def test_solver_is_shown_after_each_solve(options, capfd):
    """Shown again after the solver has been created anew for another pattern."""
    report = solved_with({"ksp_view": "", **options}).solve()
    shown = capfd.readouterr().out
    assert shown.count("KSP Object: (test_)") == report.num_iterations > 0
    assert shown.count("  0 KSP Residual norm") == (report.num_iterations if options else 0)


@pytest.mark.once
@pytest.mark.serial
def test_options_of_the_command_line_are_read():
    given = ["-test_ksp_type", "gmres", "-test_ksp_rtoll", "1e-3"]
    code = f"import sys; sys.path[:0] = {sys.path!r}\n{SCRIPT}"
    run = subprocess.run(
        [sys.executable, "-c", code, *given], capture_output=True, text=True, check=True
    )
    assert run.stdout.startswith("gmres")
    assert "did not use the option 'test_ksp_rtoll'" in run.stdout
