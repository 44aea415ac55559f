# SPDX-License-Identifier: MIT
"""Set-up of all tests: paths, a fresh numba cache, and a barrier after each test."""

import gc
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
for folder in (ROOT, ROOT / "meshes", ROOT / "tests", ROOT / "tests" / "kernels"):
    sys.path.insert(0, str(folder))
sys.path.append(str(ROOT / "demos" / "stability"))
# numba does not see that a helper in another file has changed: never trust an old cache. The test
# command gives all ranks one fresh folder; a plain pytest gets its own.
os.environ.setdefault("NUMBA_CACHE_DIR", tempfile.mkdtemp(prefix="fenics_mortar-numba-"))

from mpi4py import MPI  # noqa: E402

import pytest  # noqa: E402

# Without JIT a kernel takes a hundred times as long: of tests with many cases one of so many runs.
ONE_OF = 12


def pytest_collection_modifyitems(items):
    """Leave out what needs exactly one rank when there are several; kernels know no ranks."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        cases = Counter()
        for item in items:
            cases[item.function] += 1
            item.keep = cases[item.function] % ONE_OF == 1
        items[:] = [item for item in items if item.keep]
    for item in items:
        if "kernels" in item.path.parts:
            item.add_marker("serial")
    if MPI.COMM_WORLD.size > 1:
        items[:] = [item for item in items if "serial" not in item.keywords]


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
