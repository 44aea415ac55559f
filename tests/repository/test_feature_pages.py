# SPDX-License-Identifier: MIT
"""The code on the pages of features and on the start page runs, after the program of the README."""

import re
from pathlib import Path

import gmsh
import pytest

from meshes import two_blocks

ROOT = Path(__file__).resolve().parents[2]
FEATURES = ROOT / "demos" / "guide" / "features"
PAGES = sorted(FEATURES.glob("*.md"))
START = ROOT / "demos" / "guide" / "site" / "index.md"
pytestmark = pytest.mark.serial


def code(page):
    """All Python blocks of a page, one after the other."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.M | re.S))


@pytest.fixture
def names(tmp_path, monkeypatch):
    """Names of the README's program before its load steps, in a folder with its mesh."""
    monkeypatch.chdir(tmp_path)
    gmsh.initialize(["", "-v", "0"])
    two_blocks.build()
    gmsh.write("two_blocks.msh")
    defined = {}
    program, _, steps = code(ROOT / "README.md").partition("\nwith fm.ResultsWriter(")
    assert steps
    exec(f"import numpy as np\n{program}", defined)
    yield defined
    gmsh.finalize()


@pytest.mark.parametrize("page", [*PAGES, START], ids=lambda page: page.stem)
def test_code_of_a_page_runs_and_solves(page, names):
    exec(code(page), names)
    certificate = names["problem"].certificate()
    assert certificate.violations() == []
    assert max(abs(pair.pressure.max()) for pair in names["problem"].contacts) > 0.0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_has_code_and_a_picture_and_is_linked(page):
    text = page.read_text()
    assert "```python" in text and re.search(r"^!\[.+\]\(.+\.png\)$", text, re.M)
    assert f"(features/{page.name})" in (FEATURES.parent / "features.md").read_text()
