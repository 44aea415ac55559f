# SPDX-License-Identifier: MIT
"""Cache of compiled kernels of the tests: never that of other kernels."""

import os
from pathlib import Path

import pytest
from kernel_cache import KEPT, folder_of_kernels

pytestmark = pytest.mark.serial


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    kernels = tmp_path / "checkout" / "fenics_mortar" / "kernels"
    kernels.mkdir(parents=True)
    for name in ("one.py", "helper.py"):
        (kernels / name).write_text(f"# {name}\n")
    return tmp_path / "checkout"


def test_cache_is_another_folder_when_any_kernel_has_changed(checkout):
    before = folder_of_kernels(checkout)
    assert folder_of_kernels(checkout) == before and Path(before).is_dir()
    (checkout / "fenics_mortar" / "kernels" / "helper.py").write_text("# changed\n")
    assert folder_of_kernels(checkout) != before


def test_only_old_unused_caches_are_deleted(checkout):
    folder = Path(folder_of_kernels(checkout))
    old, recent, of_others = map(folder.with_name, ("numba-0", "numba-1", "lint-venv"))
    for each in (old, recent, of_others):
        each.mkdir()
    for each in (old, of_others, folder):
        past = folder.stat().st_mtime - 2 * KEPT
        os.utime(each, (past, past))
    assert folder_of_kernels(checkout) == str(folder)
    assert not old.exists()
    assert recent.exists() and of_others.exists() and folder.exists()


def test_cache_that_cannot_be_written_is_a_temporary_one(checkout, tmp_path):
    (tmp_path / "cache").write_text("no folder")
    one, other = folder_of_kernels(checkout), folder_of_kernels(checkout)
    assert one != other and Path(one).is_dir()
