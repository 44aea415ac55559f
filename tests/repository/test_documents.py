# SPDX-License-Identifier: MIT
"""Markdown files: relative links lead to files, and the script of the README compiles."""

import ast
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
    assert 120 <= len((ROOT / "README.md").read_text().splitlines()) <= 150


@pytest.mark.serial
def test_scripts_in_the_readme_compile():
    scripts = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert scripts
    for script in scripts:
        compile(script, "README.md", "exec")


@pytest.mark.serial
@pytest.mark.once
def test_troubleshooting_quotes_messages_of_the_code():
    """Headings are messages of the package or of meshes, with … in place of variable parts."""
    page = (ROOT / "demos" / "guide" / "site" / "troubleshooting.md").read_text()
    quoted = re.findall(r"^### `(.*)`$", page, re.MULTILINE)
    messages = [
        re.sub(r"\s+", " ", text)
        for folder in ("fenics_mortar", "meshes")
        for file in (ROOT / folder).rglob("*.py")
        for text in texts_of(ast.parse(file.read_text()))
    ]
    unknown = [quote for quote in quoted if not any(has_in_order(text, quote) for text in messages)]
    assert quoted and unknown == []


def has_in_order(text, quote):
    """Whether a text has the parts of a quote between its …, in this order."""
    start = 0
    for part in quote.split("…"):
        found = text.find(part, start)
        if found < 0:
            return False
        start = found + len(part)
    return True


def texts_of(tree):
    """All strings of a module, with … for inserted values."""
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "…" for part in node.values]
            yield "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
