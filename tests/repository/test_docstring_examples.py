# SPDX-License-Identifier: MIT
"""Examples in docstrings run, and print the output shown."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = [
    path for path in sorted((ROOT / "fenics_mortar").rglob("*.py")) if ">>>" in path.read_text()
]


@pytest.mark.serial
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_examples_of_docstrings_run(file):
    name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    failed, attempted = doctest.testmod(importlib.import_module(name))
    assert attempted > 0
    assert failed == 0
