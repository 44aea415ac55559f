# SPDX-License-Identifier: MIT
"""Runs of tests that are stopped, by a limit or a signal, or crash: no failed test is lost."""

import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import progress_log
import pytest
import watch

from demos.studies.processes import mpirun, outer_environment

pytestmark = pytest.mark.serial

SETTINGS = f"""
import sys; sys.path.insert(0, {str(Path(progress_log.__file__).parent)!r})
from progress_log import progress_log

def pytest_addoption(parser):
    parser.addoption("--progress")

def pytest_configure(config):
    log = progress_log(config)
    if log is not None:
        config.pluginmanager.register(log)
"""
TEST = """
import os, pathlib, time, pytest

def test_passes():
    pass

def test_fails():
    assert False

@pytest.fixture
def broken():
    raise ValueError

def test_has_no_fixture(broken):
    pass

def test_ends_late():
    pathlib.Path(f"begun-{os.getpid()}").touch()
    if "CRASH" in os.environ:
        os._exit(3)
    time.sleep(600)
"""
LOST = ["FAILED test_it.py::test_fails", "ERROR test_it.py::test_has_no_fixture"]
# Commands before and arguments after pytest, and how the test that was running is named.
RUNS = {
    "serial": ([], [], ""),
    "cores": ([], ["-n", "2", "--dist", "loadfile"], ""),
    "ranks": (mpirun(2), [], r" on rank 0, 1"),
}


@pytest.fixture
def start(tmp_path):
    """Start the tests under watch; their number of processes, and command, in a new folder."""
    (tmp_path / "pytest.ini").write_text("[pytest]\n")  # no folder above is that of the tests
    (tmp_path / "conftest.py").write_text(SETTINGS)
    (tmp_path / "test_it.py").write_text(TEST)
    started = []

    def started_with(before=(), after=(), limit=600, **more):
        pytest_ = [sys.executable, "-m", "pytest", "-q", "--color=no", "-p", "no:cacheprovider"]
        command = [sys.executable, watch.__file__, str(limit), *before, *pytest_, *after]
        process = subprocess.Popen(
            command, cwd=tmp_path, env=outer_environment() | more, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        started.append(process)
        return process

    yield started_with
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.parametrize("kind", RUNS)
def test_names_are_printed_by_a_run_that_is_stopped(kind, start, tmp_path):
    before, after, where = RUNS[kind]
    process, count = start(before, after), 2 if before else 1
    while len(list(tmp_path.glob("begun-*"))) < count and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 128 + signal.SIGTERM, printed
    lines = printed.splitlines()
    assert set(LOST) <= set(lines), printed
    running = f"ERROR test_it.py::test_ends_late - running{where} when the run ended"
    assert running in lines and not re.search("^(FAILED|ERROR).*passes", printed, re.M), printed


def test_names_are_printed_by_a_run_that_crashes(start):
    process = start(CRASH="1")
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 3
    assert {*LOST, "##### the run ended early"} <= set(printed.splitlines()), printed


def test_run_that_ends_prints_what_pytest_prints(start):
    process = start(after=["-k", "not late"])
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 1 and "#####" not in printed and "2 passed" not in printed
    process = start(after=["-k", "passes"])
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == 0 and "1 passed" in printed and "#####" not in printed, printed


def test_run_is_stopped_without_progress_not_after_some_time(tmp_path):
    """Lines of records for several times the limit, then none."""
    limit, ends = 1.0, []
    process = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(600)"], process_group=0
    )

    def work():
        begin = time.monotonic()
        while time.monotonic() - begin < 3.0 * limit:
            with (tmp_path / "serial-1").open("a") as file:
                file.write("begun\ta\nended\ta\n")
            time.sleep(0.1 * limit)
        ends.append(time.monotonic())

    worker = threading.Thread(target=work)
    worker.start()
    why = watch.watch(process, tmp_path, limit)
    worker.join()
    assert why == "no test has ended for 1 s" and process.returncode == -signal.SIGTERM
    assert time.monotonic() - ends[0] > 0.5 * limit


def test_the_script_of_all_tests_watches_them():
    script = (Path(watch.__file__).parent / "run.sh").read_text()
    assert '"$FENICS_MORTAR_PYTHON" "$root/tests/watch.py" "$limit" "$@"' in script
    assert not re.search(r"^\s*timeout ", script, re.M)
