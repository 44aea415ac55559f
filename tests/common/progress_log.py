# SPDX-License-Identifier: MIT
"""Record of the tests that a process has begun, ended and failed, for ``tests/watch.py``."""

import os
from pathlib import Path

import pytest

# Environment variables with the rank of a process that mpirun started: Open MPI's, MPICH's.
RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK")


class ProgressLog:
    """Plugin of pytest: writes a line at once when a test begins, ends or fails.

    Args:
        folder: Folder of the records, with one file for each process that runs tests.
    """

    def __init__(self, folder):
        ranks = (os.environ.get(name) for name in RANKS)
        self._path = Path(folder) / f"{next(filter(None, ranks), 'serial')}-{os.getpid()}"

    def _write(self, what, name):
        with self._path.open("a") as file:
            file.write(f"{what}\t{name}\n")

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item):
        self._write("begun", item.nodeid)
        yield
        self._write("ended", item.nodeid)

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self._write("FAILED" if report.when == "call" else "ERROR", report.nodeid)

    def pytest_collectreport(self, report):
        if report.failed:
            self._write("ERROR", report.nodeid)


def progress_log(config):
    """The plugin for this process, ``None`` if nobody watches or xdist's workers run the tests."""
    folder, is_worker = config.option.progress, hasattr(config, "workerinput")
    if folder is None or (getattr(config.option, "numprocesses", None) and not is_worker):
        return None
    return ProgressLog(folder)
