# SPDX-License-Identifier: MIT
"""Words of the glossary in ``CONTRIBUTING.md``: each once, and names without the rejected words."""

import ast
import re
from pathlib import Path

import pytest

import fenics_mortar as fm

PACKAGE = Path(fm.__file__).parent
ROOT = PACKAGE.parent
GUIDE = (ROOT / "CONTRIBUTING.md").read_text()
# Parts of names in lower case: words between underscores, or from one capital to the next.
WORD = re.compile(r"[a-z]+|[A-Z][a-z]+|[A-Z]+(?![a-z])")


def glossary():
    """Cells of the rows of the glossary."""
    table = GUIDE.split("| word | meaning | not |\n")[1].split("\n\n")[0]
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()[1:]]


def names(module):
    """Names that a module defines or uses, with their lines."""
    for node in ast.walk(ast.parse(module.read_text())):
        for attribute in ("id", "arg", "attr", "name"):
            name = getattr(node, attribute, None)
            if isinstance(name, str):
                yield name, getattr(node, "lineno", 0)


# An entry such as "`part` of an increment" rejects one meaning only, which a search cannot find.
REJECTED = {
    word
    for row in glossary()
    for entry in row[2].split(", ")
    for word in re.findall(r"^`(\w+)`$", entry)
}

MODULES = [
    module
    for folder in (PACKAGE, ROOT / "demos", ROOT / "meshes", ROOT / "tests")
    for module in folder.rglob("*.py")
]
# Names given by Sphinx and GetFEM, and words of texts that are compared.
GIVEN = {
    "conf.py": {"release"},
    "peer_getfem.py": {"release"},
    "printed_lines.py": {"words"},
    "test_setup.py": {"words"},
    "test_words.py": {"words"},
}


@pytest.mark.serial
def test_each_word_of_the_glossary_has_one_entry():
    words = [word for row in glossary() for word in row[0].split(", ")]
    assert len(words) > 40 and len(words) == len(set(words))
    assert all(row[1] for row in glossary())


@pytest.mark.serial
def test_no_name_contains_a_rejected_word():
    assert {"held", "climb", "told", "travel"} <= REJECTED
    found = [
        f"{module}:{line}: {name}"
        for module in sorted(MODULES)
        for name, line in names(module)
        if not REJECTED.isdisjoint(word.lower() for word in WORD.findall(name))
        and name.lower() not in GIVEN.get(module.name, ())
    ]
    assert found == []
