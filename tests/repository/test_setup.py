# SPDX-License-Identifier: MIT
"""Scripts, installation by pip, and text forbidden in files of the repository."""

import itertools
import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = [".ci/run", *(f".ci/{path.name}" for path in (ROOT / ".ci").glob("*.sh"))]
SCRIPTS += ["demos/run.sh", "demos/guide/build.sh", "tests/run.sh"]

pytestmark = pytest.mark.serial
on_debian = pytest.mark.skipif(
    sys.executable != "/usr/bin/python3", reason="about Debian's packages, which are not used here"
)


def run(*command, path=None, way="debian", **kwargs):
    """Run a command; ``path`` goes before the others on PATH, ``way`` is that of set-up."""
    hidden = ("PYTHONPATH", "OMPI_", "PMI", "CC")
    env = {name: value for name, value in os.environ.items() if not name.startswith(hidden)}
    env |= {"FENICS_MORTAR_SETUP": way}
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


def commands_of(workflow):
    """Its commands as YAML reads them: blocks of lines, or one line, which ends at " #"."""
    lines = workflow.read_text().splitlines()
    for i, line in enumerate(lines):
        key = re.match(r"([ -]*)run: *(.*)", line)
        if key and key[2] == "|":
            inside = itertools.takewhile(
                re.compile(" " + " " * len(key[1]) + "|$").match, lines[i + 1 :]
            )
            yield textwrap.dedent("\n".join(inside))
        elif key:
            yield key[2].split(" #")[0]


@pytest.mark.parametrize("name", ["release", "tests"])
def test_commands_of_workflow_have_no_syntax_error(name):
    commands = list(commands_of(ROOT / f".github/workflows/{name}.yml"))
    assert len(commands) >= 4
    for command in commands:
        result = run("bash", "-n", "-c", command)
        assert result.returncode == 0, f"{command}: {result.stderr}"


@pytest.mark.parametrize("script", SCRIPTS)
def test_shell_script_has_no_syntax_error(script):
    result = run("bash", "-n", ROOT / script)
    assert result.returncode == 0, result.stderr


@on_debian
def test_setup_survives_another_python_first_on_path(tmp_path):
    for name in ("python3", "python", "mpirun", "mpiexec"):
        put_command(tmp_path, name, "echo wrong one >&2; exit 1")
    result = run("bash", ROOT / ".ci/setup.sh", "test", "0.2", path=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "/usr/bin/python3" in result.stdout
    assert "wrong one" not in result.stderr
    assert "missing" not in result.stdout


@on_debian
def test_setup_without_rights_prints_the_command_for_an_administrator(tmp_path):
    put_command(tmp_path, "id", "echo 1000")
    put_command(tmp_path, "sudo", "exit 1")
    put_command(tmp_path, "apt-get", "echo installed something; exit 1")
    installed = "for p in python3-dolfinx gcc; do printf '%s=installed ' $p; done; exit 1"
    put_command(tmp_path, "dpkg-query", installed)
    result = run(
        "bash", ROOT / ".ci/setup.sh", "demo", "0.2", path=tmp_path, stdin=subprocess.DEVNULL
    )
    assert result.returncode == 10
    assert "installed something" not in result.stdout
    (command,) = re.findall(r"^ +(apt-get update && apt-get install .*)$", result.stderr, re.M)
    assert "--no-install-recommends" in command
    assert "python3-numba" in command
    assert "libopenblas0-pthread" in command
    assert "python3-dolfinx" not in command


@on_debian
@pytest.mark.parametrize("works", [True, False])
def test_setup_tells_the_size_and_how_far_apt_is(tmp_path, monkeypatch, works):
    flag, logs = tmp_path / "installed", tmp_path / "logs"
    logs.mkdir()
    monkeypatch.setenv("TMPDIR", str(logs))
    put_command(tmp_path, "id", "echo 0")
    known = f"[ -e {flag} ] && exec /usr/bin/dpkg-query \"$@\"; printf 'gcc=installed '; exit 1"
    put_command(tmp_path, "dpkg-query", known)
    put_command(
        tmp_path,
        "apt-get",
        f"""seq 500 | sed 's/^/unpacking /'
        case "$*" in
            *--print-uris*) echo Need to get 547 MB of archives. ;;
            install*) echo 0 upgraded, 7 newly installed, 0 to remove.
                echo Get:3 server trixie/main amd64 libfoo amd64 1.0; sleep 1
                {f"touch {flag}" if works else "exit 100"} ;;
        esac""",
    )
    result = run("bash", ROOT / ".ci/setup.sh", "demo", "0.2", path=tmp_path)
    (log,) = logs.glob("fenics_mortar-setup.*.log")
    assert log.read_text().count("unpacking") >= 1000  # of update and install
    assert "unpacking" not in result.stdout and str(log) in result.stdout
    if works:
        assert result.returncode == 0, result.stderr
        assert result.stdout.count("apt-get update: done") == 1
        size, progress, done = (
            result.stdout.index(line)
            for line in (
                "\nsetup: Need to get 547 MB of archives.\n",
                " s: loading 1 of 7: libfoo\n",
                "\nsetup: apt-get install: done in ",
            )
        )
        assert size < progress < done
    else:
        assert result.returncode == 10
        assert "unpacking 500" in result.stderr and "unpacking 400\n" not in result.stderr
        assert "FENICS_MORTAR_SETUP=venv" in result.stderr


# A Python that does what set-up by pip asks for, and writes down what it is asked.
PYTHON = r"""
echo "$*" >>"{calls}"
case "$*" in
    *ensurepip*) [ ! -e "{folder}/no-ensurepip" ] ;;
    *"print('python"*) echo python3.14 ;;
    *get_path*) echo /nowhere ;;
    *get_config_var*) echo some-cc ;;
    *"-m pip "*)
        echo "  Downloading numpy-2.5.whl (15.7 MB)"
        sleep 1
        [ ! -e "{folder}/no-pip" ] ;;
    *check.py*) echo checked ;;
    "-m venv "*) mkdir -p "$3/bin"; cp "$0" "$3/bin/python" ;;
esac
"""


@pytest.fixture
def clone(tmp_path):
    """Set-up in a folder of its own: a function that runs it, and the folder of commands."""
    root, folder = tmp_path / "clone", tmp_path / "bin"
    folder.mkdir()
    shutil.copytree(ROOT / ".ci", root / ".ci")
    shutil.copy(ROOT / "pyproject.toml", root)
    put_command(folder, "uname", "echo Linux x86_64")
    put_command(folder, "getconf", "echo glibc 2.34")
    put_command(folder, "some-cc", "exit 0")
    put_command(folder, "python3.14", PYTHON.format(calls=folder / "calls", folder=folder))

    def setup(kind="test", way="venv"):
        return run("bash", root / ".ci/setup.sh", kind, "0.2", path=folder, way=way)

    setup.root, setup.folder = root, folder
    return setup


def test_setup_by_pip_tells_size_and_progress_and_is_done_once(clone):
    for kind in ("demo", "test"):
        result = clone(kind)
        assert result.returncode == 0, result.stderr
        assert result.stdout.endswith("checked\n")
        if kind == "demo":
            size, progress, done = (
                re.search(text, result.stdout).start()
                for text in (
                    r"about \d+ MB to load",
                    r"loading numpy, with it 15 of",
                    "pip: done in",
                )
            )
            assert size < progress < done
    assert (clone.folder / "calls").read_text().count("-m pip install") == 1
    with (clone.root / "pyproject.toml").open("a") as file:
        file.write("# a newer release\n")
    assert clone().returncode == 0
    assert (clone.folder / "calls").read_text().count("-m pip install") == 2


def test_setup_by_pip_that_fails_is_tried_again_and_keeps_what_others_made(clone):
    (clone.folder / "no-pip").touch()
    for _ in range(2):
        result = clone()
        assert result.returncode == 10 and "numpy-2.5.whl" in result.stderr
    shutil.rmtree(clone.root / ".venv")
    (clone.root / ".venv").mkdir()
    result = clone()
    assert result.returncode == 10 and "was not made by this script" in result.stderr


LACKING = {
    "machine": ("uname", "echo Linux aarch64", "x86-64"),
    "libc": ("getconf", "echo glibc 2.31", "glibc 2.34 or newer"),
    "musl": ("getconf", "exit 1", "glibc 2.34 or newer"),
    "venv": ("no-ensurepip", "", "apt-get install python3.14-venv"),
    "compiler": ("some-cc", "echo no Python.h >&2; exit 1", "dnf install python3-devel gcc"),
    "python": ("python", "exit 1", "no Python 3.12 to 3.14"),
}


@pytest.mark.parametrize("what", LACKING)
def test_setup_by_pip_names_what_is_lacking_and_the_cure(what, clone):
    command, body, cure = LACKING[what]
    names = ["python3.14", "python3.13", "python3.12", "python3"]
    for name in names if command == "python" else [command]:
        put_command(clone.folder, name, body)
    result = clone()
    assert result.returncode == 10
    assert cure in result.stderr
    assert not (clone.root / ".venv").exists()


@on_debian
def test_setup_without_rights_goes_by_pip(clone):
    put_command(clone.folder, "id", "echo 1000")
    put_command(clone.folder, "sudo", "exit 1")
    put_command(clone.folder, "dpkg-query", "printf 'gcc=installed '; exit 1")
    result = clone(way="")
    assert result.returncode == 0, result.stderr
    assert re.search(r"^ +apt-get update && apt-get install .*python3-dolfinx", result.stdout, re.M)
    assert (clone.root / ".venv/complete").exists()


def test_unknown_demo_lists_the_known_ones():
    result = run("bash", ROOT / "demos/run.sh", "no_such_demo")
    assert result.returncode == 2
    demos = sorted(path.stem.removeprefix("demo_") for path in (ROOT / "demos").glob("demo_*.py"))
    listed = result.stderr.split("demos:")[1].split()
    assert listed == demos
    assert "two_blocks" in demos


@on_debian
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
    made = re.compile(
        r"\.git|\.venv|__pycache__|results|build|dist|\.hypothesis|.*_cache|.*\.egg-info"
    )
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
