# SPDX-License-Identifier: MIT
"""Set-up of all tests: paths, a fresh numba cache, and a barrier after each test."""

import gc
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Names of modules are unique among the folders of tests.
for module in sorted((ROOT / "tests").rglob("*.py")):
    if str(module.parent) not in sys.path:
        sys.path.insert(0, str(module.parent))
sys.path.insert(0, str(ROOT))
# numba does not see that a helper in another file has changed: never trust an old cache. The test
# command gives all ranks one fresh folder; a plain pytest gets its own.
os.environ.setdefault("NUMBA_CACHE_DIR", tempfile.mkdtemp(prefix="fenics_mortar-numba-"))

from mpi4py import MPI  # noqa: E402

import pytest  # noqa: E402

# Without JIT a kernel takes a hundred times as long: of tests with many cases one of so many runs.
ONE_OF = 12
# Tests run on several ranks because bodies are cut there: of many cases the first and the last do.
CASES_ON_RANKS = 2
# One half of all kernels each: two processes compile them, others load them from the cache.
COMPILING = ("test_crossing_kernels", "test_mortar_kernels")


def pytest_collection_modifyitems(items):
    """Leave out what needs exactly one rank, or several; kernels and files with slow tests first.

    Each kernel is compiled once, before many processes need it. Where a core works on one file at a
    time, the longest must not be the last. Kernels know no ranks. What only several ranks run is no
    repetition: there all cases do.
    """
    for item in items:
        if of_kernels(item):
            item.add_marker("serial")
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        items[:] = [item for cases in by_function(items) for item in cases[::ONE_OF]]
    if MPI.COMM_WORLD.size == 1:
        items[:] = [item for item in items if "ranks" not in item.keywords]
    else:
        items[:] = [item for item in items if "serial" not in item.keywords]
        items[:] = [item for cases in by_function(items) for item in on_ranks(cases)]
    slow = Counter(item.path for item in items if "slow" in item.keywords)
    items.sort(key=lambda item: -slow[item.path])
    items.sort(key=lambda item: (item.path.stem not in COMPILING, not of_kernels(item)))


def of_kernels(item):
    return "kernels" in item.path.parts


def by_function(items):
    """Tests in lists of the cases of one function each."""
    cases = {}
    for item in items:
        cases.setdefault((item.path, item.cls, item.originalname), []).append(item)
    return cases.values()


def on_ranks(cases):
    """Of many cases some from the first to the last: all that is varied differs between those."""
    if "ranks" in cases[0].keywords or len(cases) <= CASES_ON_RANKS:
        return cases
    last = len(cases) - 1
    return [cases[round(i * last / (CASES_ON_RANKS - 1))] for i in range(CASES_ON_RANKS)]


@pytest.fixture(autouse=True)
def together():
    """Destructors of PETSc objects are collective: collect garbage in step, then wait.

    What survives is modules and caches: frozen, it is not looked through after each test again.
    """
    yield
    gc.collect()
    gc.freeze()
    MPI.COMM_WORLD.barrier()


@pytest.fixture
def shared_path(tmp_path):
    """The temporary folder of rank 0, on all ranks."""
    return Path(MPI.COMM_WORLD.bcast(str(tmp_path)))
