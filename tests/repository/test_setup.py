# SPDX-License-Identifier: MIT
"""Scripts, installation by pip, and text forbidden in files of the repository."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = [".ci/env.sh", ".ci/lint.sh", ".ci/run", ".ci/setup.sh", "demos/run.sh", "tests/run.sh"]

pytestmark = pytest.mark.serial


def run(*command, path=None, **kwargs):
    """Run a command; ``path`` goes before the others on PATH."""
    hidden = ("PYTHONPATH", "OMPI_", "PMIX_")
    env = {name: value for name, value in os.environ.items() if not name.startswith(hidden)}
    if path is not None:
        env["PATH"] = f"{path}:{env['PATH']}"
    command = [str(part) for part in command]
    kwargs |= {"env": env, "text": True, "capture_output": True, "timeout": 300}
    return subprocess.run(command, **kwargs)


def put_command(folder, name, body):
    """Write a shell script that replaces a command."""
    script = folder / name
    script.write_text(f"#!/bin/sh\n{body}\n")
    script.chmod(0o755)


@pytest.mark.parametrize("script", SCRIPTS)
def test_shell_script_has_no_syntax_error(script):
    result = run("bash", "-n", ROOT / script)
    assert result.returncode == 0, result.stderr


def test_setup_survives_another_python_first_on_path(tmp_path):
    for name in ("python3", "python", "mpirun", "mpiexec"):
        put_command(tmp_path, name, "echo wrong one >&2; exit 1")
    result = run("bash", ROOT / ".ci/setup.sh", "test", path=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "/usr/bin/python3" in result.stdout
    assert "wrong one" not in result.stderr
    assert "missing" not in result.stdout


def test_setup_without_rights_prints_the_command_for_an_administrator(tmp_path):
    put_command(tmp_path, "id", "echo 1000")
    put_command(tmp_path, "sudo", "exit 1")
    put_command(tmp_path, "apt-get", "echo installed something; exit 1")
    installed = "for p in python3-dolfinx gcc; do printf '%s=installed ' $p; done; exit 1"
    put_command(tmp_path, "dpkg-query", installed)
    result = run("bash", ROOT / ".ci/setup.sh", "demo", path=tmp_path, stdin=subprocess.DEVNULL)
    assert result.returncode == 10
    assert "installed something" not in result.stdout
    (command,) = re.findall(r"^ +(apt-get update && apt-get install .*)$", result.stderr, re.M)
    assert "--no-install-recommends" in command
    assert "python3-numba" in command
    assert "libopenblas0-pthread" in command
    assert "python3-dolfinx" not in command


@pytest.mark.parametrize("works", [True, False])
def test_setup_folds_apt_output_into_one_line(tmp_path, monkeypatch, works):
    flag, logs = tmp_path / "installed", tmp_path / "logs"
    logs.mkdir()
    monkeypatch.setenv("TMPDIR", str(logs))
    put_command(tmp_path, "id", "echo 0")
    known = f"[ -e {flag} ] && exec /usr/bin/dpkg-query \"$@\"; printf 'gcc=installed '; exit 1"
    put_command(tmp_path, "dpkg-query", known)
    ends = f"touch {flag}" if works else "exit 100"
    put_command(tmp_path, "apt-get", f"seq 500 | sed 's/^/unpacking /'; {ends}")
    result = run("bash", ROOT / ".ci/setup.sh", "demo", path=tmp_path)
    (log,) = logs.glob("fenics_mortar-setup.*.log")
    assert log.read_text().count("unpacking") >= 1000  # of update and install
    assert "unpacking" not in result.stdout and str(log) in result.stdout
    if works:
        assert result.returncode == 0, result.stderr
        assert result.stdout.count("apt-get update: done") == 1
        assert result.stdout.count("apt-get install: done") == 1
    else:
        assert result.returncode == 10
        assert "unpacking 500" in result.stderr and "unpacking 400\n" not in result.stderr


def test_unknown_demo_lists_the_known_ones():
    result = run("bash", ROOT / "demos/run.sh", "no_such_demo")
    assert result.returncode == 2
    demos = sorted(path.stem.removeprefix("demo_") for path in (ROOT / "demos").glob("demo_*.py"))
    listed = result.stderr.split("demos:")[1].split()
    assert listed == demos
    assert "two_blocks" in demos


@pytest.mark.slow
def test_pip_installs_the_package_beside_debians_dolfinx(tmp_path):
    source, venv = tmp_path / "source", tmp_path / "venv"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "fenics_mortar", source / "fenics_mortar", ignore=ignore)

    made = run("/usr/bin/python3", "-m", "venv", "--system-site-packages", venv)
    assert made.returncode == 0, made.stdout + made.stderr
    pip = [venv / "bin/python", "-m", "pip", "install", "--no-build-isolation", "--no-index"]
    installed = run(*pip, "--no-compile", source, cwd=tmp_path)
    assert installed.returncode == 0, installed.stdout + installed.stderr

    code = "import fenics_mortar as fm; print('found', fm.__version__, fm.__file__)"
    imported = run(venv / "bin/python", "-c", code, cwd=tmp_path)
    assert imported.returncode == 0, imported.stderr
    # MPI may print warnings of its own.
    version, file = re.search(r"^found (\S+) (\S+)$", imported.stdout, re.M).groups()
    shown = run(venv / "bin/python", "-m", "pip", "show", "fenics_mortar", cwd=tmp_path).stdout
    assert f"Version: {version}\n" in shown
    folder = Path(file).parent
    assert venv in folder.parents
    for path in (source / "fenics_mortar").rglob("*.py"):
        assert (folder / path.relative_to(source / "fenics_mortar")).is_file(), f"no {path}"


# Split, so that this file does not contain them.
FORBIDDEN = [
    "py" + "pi.org",
    "pythonhosted" + ".org",
    "deb" + ".debian.org",
    "snapshot" + ".debian.org",
    "artifact" + "-registry",
    "artifact" + "registry",
    "index" + "-url",
    "/wo" + "rk/",
    "/root/" + ".",
    "/home" + "/",
    "/opt" + "/",
]


def files_of_the_repository():
    """Text files of the checkout, without what git or a run put there."""
    made = re.compile(r"\.git|__pycache__|results|build|dist|\.hypothesis|.*_cache|.*\.egg-info")
    for path in sorted(ROOT.rglob("*")):
        if any(made.fullmatch(part) for part in path.relative_to(ROOT).parts):
            continue
        if path.is_file() and path.suffix not in {".msh", ".png", ".pdf"}:
            yield path


def test_no_file_names_a_registry_or_a_path_of_one_machine():
    found = [
        f"{path.relative_to(ROOT)}: {words}"
        for path in files_of_the_repository()
        for words in FORBIDDEN
        if words in path.read_text(encoding="utf-8", errors="ignore")
    ]
    assert not found, "\n".join(found)
