# SPDX-License-Identifier: MIT
"""Folder of numba's cache for the present kernels, shared by checkouts in which they are equal."""

import hashlib
import os
import shutil
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Time after which caches of other kernels that no run uses are removed [s].
KEPT = 24 * 3600.0


def digest(*parts):
    return hashlib.sha256(b"".join(parts)).hexdigest()[:12]


def folder_of_kernels(root=ROOT):
    """The folder, named by the contents of all kernels; a temporary one if none can be written."""
    kernels = sorted((root / "fenics_mortar" / "kernels").rglob("*.py"))
    contents = digest(*(kernel.name.encode() + kernel.read_bytes() for kernel in kernels))
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fenics_mortar"
    folder = home / f"numba-{contents}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError:
        return tempfile.mkdtemp(prefix="fenics_mortar-numba-")
    for other in home.glob("numba-*"):
        if other != folder and time.time() - other.stat().st_mtime > KEPT:
            shutil.rmtree(other, ignore_errors=True)
    return str(folder)


if __name__ == "__main__":
    print(folder_of_kernels())
