# SPDX-License-Identifier: MIT
"""List the numeric thresholds of the package, with value, unit and reason, as Markdown.

    python3 -m demos.guide.thresholds > demos/guide/thresholds.md

A threshold is a name in upper case at the top of a module that is bound to a number, or a field of
a frozen class with a number as default, in a module that defines thresholds only.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).resolve().parents[2] / "fenics_mortar"
# Modules with frozen classes of thresholds that are no options of users.
OPTIONS = (
    "equations/arguments.py", "la/options.py", "obstacles/rigid_motion.py", "verify/finding.py",
)  # fmt: skip


class Threshold(NamedTuple):
    """A number with its module, name and meaning."""

    module: str
    name: str
    value: str
    meaning: str


def thresholds() -> list[Threshold]:
    """All thresholds, by module."""
    files = sorted(PACKAGE.rglob("*.py"))
    return [found for file in files for found in _in_module(file)]


def table() -> str:
    """The list as Markdown."""
    found = thresholds()
    lines = [
        "# Thresholds",
        "",
        f"{len(found)} numbers on which results or their cost may depend, each named once. "
        "`python3 -m demos.guide.thresholds` prints this list from the comments of the modules.",
        "",
        "| module | name | value | unit and reason |",
        "|---|---|---|---|",
    ]
    link = "[`{0}`](../../fenics_mortar/{0})"
    lines += [f"| {link.format(t.module)} | `{t.name}` | {t.value} | {t.meaning} |" for t in found]
    return "\n".join(lines)


def _in_module(file: Path) -> Iterator[Threshold]:
    module, text = str(file.relative_to(PACKAGE)), file.read_text()
    lines = text.splitlines()
    for node in ast.parse(text).body:
        if isinstance(node, ast.ClassDef) and module in OPTIONS:
            meanings = _attributes(ast.get_docstring(node) or "")
            for field in node.body:
                if isinstance(field, ast.AnnAssign) and _is_number(field.value):
                    name = ast.unparse(field.target)
                    yield Threshold(module, name, _value(field.value), meanings.get(name, ""))
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=True))
            for name, value in ((ast.unparse(a), b) for a, b in pairs):
                if name.isupper() and _is_number(value):
                    yield Threshold(module, name, _value(value), _comment(lines, node.lineno - 1))


def _is_number(value: ast.expr | None) -> bool:
    """Whether an expression is a nonzero number, or arithmetic of numbers."""
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) or _is_number(value.right)
    number = value.value if isinstance(value, ast.Constant) else None
    return type(number) in (int, float) and number != 0


def _value(value: ast.expr | None) -> str:
    return ast.unparse(value).replace("np.", "") if value is not None else ""


def _comment(lines: list[str], number: int) -> str:
    """The comment above a line."""
    first = number
    while lines[first - 1].startswith("#"):
        first -= 1
    return " ".join(line.removeprefix("#").strip() for line in lines[first:number])


def _attributes(docstring: str) -> dict[str, str]:
    """Meaning of each attribute in a docstring."""
    block = docstring.partition("Attributes:\n")[2]
    found = re.findall(r"^    (\w+): (.*(?:\n        .*)*)", block, re.MULTILINE)
    return {name: " ".join(reason.split()) for name, reason in found}


if __name__ == "__main__":
    print(table())
