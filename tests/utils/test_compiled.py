# SPDX-License-Identifier: MIT
"""The log names what is compiled, not what comes from a cache."""

import fcntl
import gc
import importlib.util
import logging
import os
import subprocess
import sys
import time
import uuid
from pathlib import Path

from mpi4py import MPI

import numba
import numpy as np
import pytest

import ufl
from dolfinx import mesh

from fenics_mortar import kernels
from fenics_mortar.utils import compat

pytestmark = pytest.mark.serial
ROOT = Path(__file__).resolve().parents[2]


def test_a_form_is_named_when_it_is_compiled(caplog):
    caplog.set_level(logging.INFO, "fenics_mortar")
    square = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    new = float(uuid.uuid4().int % 10**12)  # in no cache
    area = new * ufl.dx(domain=square)
    compat.form(area)
    (message,) = (record.getMessage() for record in caplog.records)
    assert message.startswith("compiled an integral in ")
    compat.form(area)
    assert len(caplog.records) == 1


def source_of(kernels, folder):
    """A file of kernels that no earlier run has compiled: caches outlive folders of tests."""
    path = folder / f"kernels_{uuid.uuid4().hex}.py"
    path.write_text(kernels)
    return path


def imported(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


KERNELS = """
from fenics_mortar.kernels import kernel

@kernel
def double(x):
    return 2.0 * x

@kernel
def fourfold(x):
    return double(double(x))
"""

FAILING = """
from fenics_mortar.kernels import kernel

@kernel
def add(x):
    return x + 1

@kernel
def fail(x):
    return add(x).nothing
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_kernel_is_named_when_it_is_compiled(caplog, tmp_path):
    caplog.set_level(logging.INFO, "fenics_mortar")
    path = source_of(KERNELS, tmp_path)
    for count in (2, 2):  # the second time both come from the cache
        module = imported(path)
        assert module.fourfold(1.0) == module.fourfold(1.0) == 4.0
        messages = [record.getMessage() for record in caplog.records]
        assert len(messages) == count and {"double", "fourfold"} == {
            m.split()[3].strip(";") for m in messages
        }


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_machine_code_is_made_and_kept_for_kernels_that_python_calls_only(tmp_path):
    path = source_of(KERNELS, tmp_path)
    module = imported(path)

    def kept():
        # Beside the source, or in a folder of NUMBA_CACHE_DIR for it.
        folder = Path(module.fourfold.stats.cache_path)
        return sorted(p.name.split("-")[0] for p in folder.glob(f"{path.stem}.*.nbi"))

    double, fourfold = (f"{path.stem}.{name}" for name in ("double", "fourfold"))
    assert module.fourfold(1.5) == 6.0 and kept() == [fourfold]
    assert module.double(1.5) == 3.0 and kept() == [double, fourfold]


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_kernels_are_compiled_again_when_any_kernel_of_the_package_has_changed(
    caplog, monkeypatch, tmp_path
):
    """One in another file may be part of their machine code; numba compares their own file only."""
    caplog.set_level(logging.INFO, "fenics_mortar")
    path = source_of(KERNELS, tmp_path)
    assert kernels.DIGEST == kernels._digest()
    for digest, count in (("old", 2), ("old", 2), ("new", 4), ("new", 4)):
        monkeypatch.setattr(kernels, "DIGEST", digest)
        assert imported(path).fourfold(1.0) == 4.0 and len(caplog.records) == count


COMPILING = """
import logging, sys, time
logging.basicConfig(format="%(message)s", stream=sys.stdout)
logging.getLogger("fenics_mortar").setLevel(logging.INFO)
module = __import__(sys.argv[1])
print("ready", flush=True)
time.sleep(max(0.0, float(sys.stdin.readline()) - time.time()))
assert module.fourfold(1.0) == 4.0
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_one_of_several_processes_compiles_a_kernel(tmp_path):
    """Also if they are of clones in other folders, whose files are of another time."""
    first = source_of(KERNELS, tmp_path)
    clone = tmp_path / "clone" / tmp_path.name / first.name
    clone.parent.mkdir(parents=True)
    clone.write_text(first.read_text())
    os.utime(clone, (0, 0))
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    started = [
        subprocess.Popen(
            [sys.executable, "-c", COMPILING, path.stem],
            env=environment | {"PYTHONPATH": f"{ROOT}:{path.parent}"},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for path in (first, clone)
    ]  # fmt: skip
    assert [process.stdout.readline() for process in started] == ["ready\n"] * 2
    both = time.time() + 0.1
    for process in started:
        process.stdin.write(f"{both}\n")
        process.stdin.flush()
    said = "".join(process.communicate(timeout=60)[0] for process in started)
    assert said.count("compiling the kernel fourfold") == 1


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_kernel_that_cannot_be_compiled_lets_other_processes_go_on(tmp_path):
    module = imported(source_of(FAILING, tmp_path))
    for _ in range(2):  # the second time numba remembers the failure, and does not compile
        with pytest.raises(numba.TypingError, match="nothing"):
            module.fail(1)
        (lock,) = Path(module.fail.stats.cache_path).glob(f"{module.__name__}.*.lock")
        with lock.open() as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_lock_that_cannot_be_opened_is_no_obstacle(tmp_path):
    """As one of another user in a common folder; here it is the name of a folder."""
    module = imported(source_of(KERNELS, tmp_path))
    folder = Path(module.fourfold.stats.cache_path)
    name = module.fourfold._cache._impl.filename_base
    (folder / f"{name}.lock").mkdir(parents=True)
    assert module.fourfold(1.0) == 4.0
    assert list(folder.glob(f"{name}*.nbi"))


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("collects", [True, False])
def test_garbage_collection_is_as_before_when_a_kernel_is_compiled(collects, tmp_path):
    module = imported(source_of(FAILING, tmp_path))
    enabled = gc.isenabled()
    try:
        (gc.enable if collects else gc.disable)()
        assert module.add(1) == 2 and gc.isenabled() == collects
        with pytest.raises(numba.TypingError, match="nothing"):
            module.fail(1)
        assert gc.isenabled() == collects
    finally:
        (gc.enable if enabled else gc.disable)()


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_kernels_of_others_are_not_named(caplog):
    caplog.set_level(logging.INFO, "fenics_mortar")
    assert numba.njit(lambda x: 2.0 * x)(1.0) == 2.0
    assert not caplog.records


def test_the_package_changes_neither_garbage_collection_nor_numba_for_others():
    program = (
        "import gc; from numba.core import event; "
        "import fenics_mortar; after = {k: v for k, v in event._registered.items() if v};"
        "print(gc.get_freeze_count(), sum(map(len, after.values())))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["0", "0"]


def test_wrappers_of_numba_that_have_no_module_are_compiled():
    """``np.full`` with a tuple has such a wrapper; with an empty cache its kernels failed."""

    def filled(n):
        return np.full((n, 2), -1)

    assert numba.njit(filled)(3).sum() == -6
