# SPDX-License-Identifier: MIT
"""Programs that measure run to their end, at their smallest sizes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from demos.studies.processes import mpirun, outer_environment

ROOT = Path(__file__).resolve().parents[2]
# Module in demos/studies with arguments.
PROGRAMS = [
    "performance.linear_bulk 400",
    "performance.linear_bulk 400 space",
    "performance.multigrid 1 0",
    "performance.newton 400",
    "performance.ranks 400",
]


@pytest.mark.serial
@pytest.mark.once
@pytest.mark.each
@pytest.mark.parametrize("program", PROGRAMS)
def test_program_of_performance_runs(program, tmp_path):
    name, *arguments = program.split()
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        [sys.executable, "-m", f"demos.studies.{name}", *arguments], cwd=tmp_path,
        env=environment, capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert "|" in ended.stdout or "faster" in ended.stdout


@pytest.mark.serial
def test_ranks_are_started_by_the_mpi_of_this_python():
    """By another MPI's mpirun they would not know of each other."""
    program = "from mpi4py import MPI; print(MPI.COMM_WORLD.size)"
    ended = subprocess.run(
        [*mpirun(2), sys.executable, "-c", program], env=outer_environment(), capture_output=True,
        text=True, timeout=120,
    )  # fmt: skip
    assert "".join(ended.stdout.split()) == "22", ended.stderr[-2000:]
