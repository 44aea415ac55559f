# SPDX-License-Identifier: MIT
"""Set-up of all tests: paths, a numba cache of these kernels, and a barrier after each test."""

import gc
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Names of modules are unique among the folders of tests.
for module in sorted((ROOT / "tests").rglob("*.py")):
    if str(module.parent) not in sys.path:
        sys.path.insert(0, str(module.parent))
sys.path.insert(0, str(ROOT))
from kernel_cache import folder_of_kernels  # noqa: E402

os.environ.setdefault("NUMBA_CACHE_DIR", folder_of_kernels())

from mpi4py import MPI  # noqa: E402

import pytest  # noqa: E402
from progress_log import progress_log  # noqa: E402
from rank_failures import RankFailures  # noqa: E402

# Without JIT a kernel takes a hundred times as long: one of this many cases of a test is run.
ONE_OF = 20
# Number of cases on several ranks, where only the partition matters: the first and the last one.
CASES_ON_RANKS = 2
# Folders of the longest tests.
LONG = ("trial", "studies", "verification", "repository", "rigid")
# One half of all kernels each: two processes compile them, others load them from the cache.
COMPILING = ("test_crossing_kernels", "test_mortar_kernels")
FAILURES = RankFailures(MPI.COMM_WORLD)


def pytest_addoption(parser):
    group = parser.getgroup("fenics_mortar")
    cases = "cases of a test function in serial; 0: all. Tests marked once then run in serial only"
    group.addoption("--cases", type=int, default=0, help=cases)
    group.addoption("--progress", metavar="FOLDER", help="folder of the records of tests/watch.py")


def pytest_configure(config):
    log = progress_log(config)
    if log is not None:
        config.pluginmanager.register(log)
    if MPI.COMM_WORLD.size > 1:
        config.pluginmanager.register(FAILURES)


def pytest_collection_modifyitems(config, items):
    """Deselect tests for another number of ranks, and those not in the short run.

    Kernels and folders of long tests come first.

    Each kernel is compiled once, before many processes need it. The longest files must not be the
    last, since a core runs one file at a time. Kernels do not depend on ranks.
    """
    for item in items:
        if of_kernels(item):
            item.add_marker("serial")
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        items[:] = [item for cases in by_function(items) for item in cases[::ONE_OF]]
    alone = MPI.COMM_WORLD.size == 1
    without, cases = {"several_ranks" if alone else "serial"}, config.option.cases
    if cases and not alone:
        without.add("once")
    items[:] = [item for item in items if without.isdisjoint(marks(item))]
    functions = enumerate(by_function(items))
    items[:] = [item for number, all_ in functions for item in some(all_, number, cases)]
    items.sort(key=lambda item: folder(item) not in LONG)
    items.sort(key=lambda item: (item.path.stem not in COMPILING, not of_kernels(item)))


def folder(item):
    return item.path.relative_to(ROOT / "tests").parts[0]


def of_kernels(item):
    return folder(item) == "kernels"


def marks(item):
    """Names of the marks and fixtures of a test: its keywords have names of folders, too."""
    return {mark.name for mark in item.iter_markers()} | set(item.fixturenames)


def by_function(items):
    """Tests in lists of the cases of one function each."""
    cases = {}
    for item in items:
        cases.setdefault((item.path, item.cls, item.originalname), []).append(item)
    return cases.values()


def count_of(cases, asked):
    """Number of cases of a test function to be run, 0 for all, of the number asked for.

    All cases run of kernel tests, which are fast, of tests for each file or demo, and of tests for
    several ranks only.
    """
    first = cases[0]
    if "several_ranks" in marks(first) or folder(first) in ("kernels", "repository"):
        return 0
    each = "each" in marks(first)
    if MPI.COMM_WORLD.size == 1:
        return 0 if each else min(asked, 1) if "once" in marks(first) else asked
    return 1 if asked and not each else CASES_ON_RANKS


def some(cases, number, asked):
    """Cases from the first to the last one, which differ most.

    A single case is alternately the first or the last one of the functions; of tests marked once
    it is the last one.
    """
    last, count = len(cases) - 1, count_of(cases, asked)
    if not 0 < count <= last:
        return cases
    if count == 1:
        return [cases[last if "once" in marks(cases[0]) else last * (number % 2)]]
    return [cases[round(i * last / (count - 1))] for i in range(count)]


@pytest.fixture(autouse=True)
def together():
    """Destructors of PETSc objects are collective: collect garbage on all ranks, then wait.

    Surviving objects are modules and caches; they are frozen, so that they are not traversed again.
    """
    yield
    gc.collect()
    gc.freeze()
    FAILURES.wait()


@pytest.fixture
def several_ranks():
    """Of tests that need several ranks, which are not run in serial."""


@pytest.fixture
def shared_path(tmp_path):
    """The temporary folder of rank 0, on all ranks."""
    return Path(MPI.COMM_WORLD.bcast(str(tmp_path)))
