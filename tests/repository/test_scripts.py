# SPDX-License-Identifier: MIT
"""Paths of scripts: shared helpers only; and a script beside the clone without its environment."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Helpers: of demos, of tests, and the settings of Sphinx, which nothing else imports.
HELPERS = {
    "demos/this_clone.py", "tests/conftest.py", "demos/guide/site/conf.py",
    "demos/studies/same/record.py",
}  # fmt: skip
SCRIPT = "import fenics_mortar as fm; print('found', fm.__version__, fm.read_gmsh.__module__)"


def test_only_helpers_change_the_path():
    found = {
        str(file.relative_to(ROOT))
        for folder in ("fenics_mortar", "meshes", "demos", "tests")
        for file in (ROOT / folder).rglob("*.py")
        if re.search(r"^\s*sys\.path(\.| *\[.*\] *=| *=| *\+=)", file.read_text(), re.M)
    }
    assert found == HELPERS


@pytest.fixture
def beside(tmp_path):
    """A script beside a clone of the name that the installation page advises."""
    clone = tmp_path / "fenics-mortar"
    clone.mkdir()
    (clone / "fenics_mortar").symlink_to(ROOT / "fenics_mortar")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    return script


def run(script, path):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    return subprocess.run(
        [sys.executable, script], cwd=script.parent, env=environment | path, capture_output=True,
        text=True, timeout=120,
    )  # fmt: skip


def is_installed(folder):
    """Whether this Python finds the package in a folder without it, and without a path."""
    program = folder / "elsewhere" / "program.py"
    program.parent.mkdir()
    program.write_text(SCRIPT)
    return run(program, {}).returncode == 0


@pytest.mark.serial
def test_script_beside_the_clone_without_environment_finds_no_package(beside):
    ended = run(beside, {})
    if ended.stdout and is_installed(beside.parent):
        pytest.skip("the package is installed for this Python, as by .ci/setup_venv.sh")
    assert ended.returncode == 1
    assert "fenics-mortar" in (ROOT / "demos/guide/installation.md").read_text()
    assert "No module named 'fenics_mortar'" in ended.stderr


@pytest.mark.serial
@pytest.mark.once
def test_script_beside_the_clone_with_environment_runs(beside):
    ended = run(beside, {"PYTHONPATH": str(beside.parent / "fenics-mortar")})
    assert ended.returncode == 0, ended.stderr
    assert "fenics_mortar.mesh.gmsh_reader" in ended.stdout
