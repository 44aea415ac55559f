# SPDX-License-Identifier: MIT
"""Places of a file that can be changed, and mutants drawn from them."""

from __future__ import annotations

import ast
import difflib
import random
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

PACKAGE = "fenics_mortar"


SIGNS = {ast.Add: "-", ast.Sub: "+"}
OPPOSITE = {
    ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
DROPPED = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.BitAnd, ast.BitOr)


@dataclass
class Mutant:
    """One change, from ``line`` to ``last``: ``text`` is the whole file.

    ``function``: the first line of the function, 0 where there is none.
    """

    path: str
    line: int
    last: int
    function: int
    kind: str
    difference: str
    text: str


class Changes(ast.NodeVisitor):
    """All places of a file that can be changed: (node, kind, new text), with their function."""

    def __init__(self, text: str):
        self.text, self.found, self.functions = text, [], [0]
        self.lines = text.splitlines(keepends=True)
        self.starts = list(accumulate(map(len, self.lines), initial=0))
        self.visit(ast.parse(text))

    def span(self, node: ast.AST) -> tuple[int, int]:
        """First and last offset of a node, which counts its columns in bytes of UTF-8."""
        ends = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
        first, last = (
            self.starts[line - 1] + len(self.lines[line - 1].encode()[:column].decode())
            for line, column in ends
        )
        return first, last

    def source(self, node: ast.AST) -> str:
        """Text of a node; parentheses do not belong to it, and an assignment needs them."""
        first, last = self.span(node)
        text = self.text[first:last]
        return f"({text})" if isinstance(node, ast.NamedExpr) else text

    def add(self, node: ast.AST, kind: str, new: str) -> None:
        new = new if kind == "statement" else f"({new})"
        self.found.append((node, self.span(node), kind, new, self.function))

    @property
    def function(self) -> int:
        return self.functions[-1]

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Skip annotations and decorators; a closure belongs to the enclosing function."""
        first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        self.functions.append(self.function or first)
        for part in (*node.args.defaults, *filter(None, node.args.kw_defaults), *node.body):
            self.visit(part)
        self.functions.pop()

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for part in node.body:
            self.visit(part)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def leave(self, node: ast.AST) -> None:
        """Skip texts of errors and notes, which are not tested literally."""

    visit_Raise = visit_JoinedStr = visit_Import = visit_ImportFrom = leave

    def visit_keyword(self, node: ast.keyword) -> None:
        """Skip ``strict`` of zip, a check of the code."""
        if node.arg != "strict":
            self.visit(node.value)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self.add(node, "statement", "pass")
            self.visit(node.value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self.add(node, "statement", "pass")
        self.visit(node.value)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if not any(isinstance(side, NO_TERMS) or is_text(side) for side in (node.left, node.right)):
            left, right = self.source(node.left), self.source(node.right)
            if type(node.op) in SIGNS:
                self.add(node, "sign", f"{left} {SIGNS[type(node.op)]} ({right})")
            if isinstance(node.op, DROPPED):
                self.add(node, "term", left)
                if not isinstance(node.op, (ast.Div, ast.Sub)):
                    self.add(node, "term", right)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, (ast.USub, ast.Not, ast.Invert)):
            kind = "sign" if isinstance(node.op, ast.USub) else "comparison"
            self.add(node, kind, self.source(node.operand))
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if len(node.ops) == 1:
            left, right = self.source(node.left), self.source(node.comparators[0])
            self.add(node, "comparison", f"{left} {OPPOSITE[type(node.ops[0])]} {right}")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        word = " or " if isinstance(node.op, ast.And) else " and "
        parts = [f"({self.source(each)})" for each in node.values]
        self.add(node, "comparison", word.join(parts))
        self.add(node, "term", parts[0])
        self.add(node, "term", parts[-1])
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """Whole numbers by one, others by a factor of ten; True and False exchanged."""
        if isinstance(node.value, bool):
            self.add(node, "constant", repr(not node.value))
        elif isinstance(node.value, int):
            self.add(node, "constant", repr(node.value + 1))
        elif isinstance(node.value, float):
            self.add(node, "constant", repr(10.0 * node.value if node.value else 1.0))


NO_TERMS = (ast.List, ast.Tuple, ast.ListComp, ast.JoinedStr)


def is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def draw(folder: Path, count: int, seed: int, only: list[str]) -> list[Mutant]:
    """``count`` different mutants of the package in ``folder``; the same for the same seed.

    ``only``: words, one of which the path of a file must hold; none for all files.
    """
    names = {path: str(path.relative_to(folder)) for path in (folder / PACKAGE).rglob("*.py")}
    chosen = [path for path in names if any(word in names[path] for word in only or [""])]
    texts = {path: path.read_text() for path in sorted(chosen)}
    changes = {path: Changes(text).found for path, text in texts.items()}
    texts = {path: text for path, text in texts.items() if changes[path]}
    count = min(count, sum(len(changes[path]) for path in texts))
    weights = [text.count("\n") for text in texts.values()]
    pick, mutants = random.Random(seed), {}
    while len(mutants) < count:
        (path,) = pick.choices(list(texts), weights)
        mutant = changed(path.relative_to(folder), texts[path], *pick.choice(changes[path]))
        if mutant is not None:
            mutants[mutant.path, mutant.difference] = mutant
    return list(mutants.values())


def changed(path: Path, old: str, node: ast.AST, span, kind: str, new: str, function: int):
    """The mutant, or None if the text is unchanged."""
    first, last = span
    text = old[:first] + new + old[last:]
    if ast.dump(ast.parse(text)) == ast.dump(ast.parse(old)):
        return None
    lines = difflib.unified_diff(old.splitlines(), text.splitlines(), lineterm="", n=0)
    difference = "\n".join(line for line in lines if line[:3] not in ("---", "+++"))
    return Mutant(str(path), node.lineno, node.end_lineno, function, kind, difference, text)
