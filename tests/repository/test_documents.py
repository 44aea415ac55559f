# SPDX-License-Identifier: MIT
"""Markdown files: relative links lead to files, and the script of the README compiles."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = [*ROOT.glob("*.md"), *ROOT.glob("demos/**/*.md")]
LINKS = re.compile(r"""\]\(([^)#:\s]+)(?:\#[^)]*)?\) | src="([^"]+)" """, re.VERBOSE)


@pytest.mark.serial
@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_relative_links_lead_to_files(file):
    links = ["".join(link) for link in LINKS.findall(file.read_text())]
    assert [link for link in links if not (file.parent / link).exists()] == []


@pytest.mark.serial
def test_the_readme_is_short():
    """Details belong to demos/guide, numbers to the READMEs of the studies."""
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


@pytest.mark.serial
def test_scripts_in_the_readme_compile():
    scripts = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert scripts
    for script in scripts:
        compile(script, "README.md", "exec")
