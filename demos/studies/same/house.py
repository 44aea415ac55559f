# SPDX-License-Identifier: MIT
"""Figures of the code of the package: lines, modules, functions, chains of imports.

    python3 -m demos.studies.same.house
    python3 -m demos.studies.same.house run     also of a run: frames, calls, seconds of import

Lines of code are those without comments, docstrings and blank lines. The longest chain of imports
is the largest number of modules each of which imports the next one when it is imported itself; the
second number also counts imports that only annotations need. The way to the first integral over the
interface is counted from ``problem.solve``, both included.
"""

from __future__ import annotations

import ast
import io
import os
import statistics
import subprocess
import sys
import tempfile
import tokenize
from collections import Counter
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "fenics_mortar"
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
SCOPES = (ast.Module, ast.ClassDef, *FUNCTIONS)
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip


def lines_of(node: ast.AST) -> set[int]:
    """Numbers of the lines of a node of a syntax tree."""
    return set(range(node.lineno, node.end_lineno + 1))


class Module:
    """Counts of a file.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        text = path.read_text()
        self.tree = ast.parse(text)
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        code = set[int]()
        for token in tokens:
            if token.type not in NO_CODE:
                code |= set(range(token.start[0], token.end[0] + 1))
        nodes = list(ast.walk(self.tree))
        for scope in nodes:
            if isinstance(scope, SCOPES) and ast.get_docstring(scope, clean=False) is not None:
                code -= lines_of(scope.body[0])
        imports, signatures = set[int](), set[int]()
        self.functions = []
        for node in nodes:
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                imports |= lines_of(node) & code
            if isinstance(node, FUNCTIONS):
                body = set().union(*map(lines_of, node.body)) & code
                signatures |= (lines_of(node) & code) - body
                self.functions.append(len(body))
        self.code, self.framing = len(code), len(imports | signatures)

    def imported(self, *, for_types: bool = False) -> list[str]:
        """Names of what the file imports when it is imported, or is checked for types."""
        names, stack = [], list(self.tree.body)
        while stack:
            node = stack.pop()
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names += [f"{node.module}.{alias.name}" for alias in node.names] + [node.module]
            elif isinstance(node, ast.Try) or (
                isinstance(node, ast.If)
                and (for_types or "TYPE_CHECKING" not in ast.dump(node.test))
            ):
                stack += node.body
        return names


def longest_chain(modules: dict[str, Module], *, for_types: bool = False) -> list[str]:
    """Names of the longest chain of modules that import each other, the first one at the top."""
    used = {
        name: sorted({*module.imported(for_types=for_types)} & {*modules} - {name})
        for name, module in modules.items()
    }

    @cache
    def chain(name: str) -> tuple[str, ...]:
        return (name, *max(map(chain, used[name]), key=len, default=()))

    return list(max(map(chain, used), key=len))


# CPU seconds of the import of the package, after dolfinx.
IMPORT = """
import time
import dolfinx, dolfinx.fem.petsc
begin = time.process_time()
import fenics_mortar
print(time.process_time() - begin)
"""


def import_seconds(number: int = 5) -> float:
    """Median CPU seconds of the import of the package beyond those of dolfinx, from bytecode."""
    found = list[float]()
    with tempfile.TemporaryDirectory() as folder:
        given = {**os.environ, "PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        for _ in range(1 + number):  # the first one writes the bytecode
            run = [sys.executable, "-c", IMPORT]
            ended = subprocess.run(run, capture_output=True, text=True, check=True, env=given)
            found.append(float(ended.stdout))
    return statistics.median(found[1:])


def print_run() -> None:
    """Print the figures of a run: two blocks with 1,100 unknowns."""
    from demos.studies.performance import trace_iteration  # sets up problems, imports dolfinx

    *_, calls, crossings = trace_iteration.measure()
    way = trace_iteration.trace_way()
    print(f"frames to the first integral   {len(way.frames)}")
    print(f"modules that u passes          {len(way.modules)}")
    print(f"Python calls of an iteration   {calls}, {crossings} between modules")
    print(f"import beyond dolfinx          {import_seconds():.2f} s of CPU time")


def main() -> None:
    """Print the figures."""
    paths = sorted(PACKAGE.rglob("*.py"))
    names = {
        path: ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in paths
    }
    modules = {names[path]: Module(path) for path in paths}
    code = [module.code for module in modules.values()]
    functions = sorted(size for module in modules.values() for size in module.functions)
    folders = Counter(path.parent for path in paths if path.name != "__init__.py")
    most, files = folders.most_common(1)[0]
    chain = longest_chain(modules)
    framing = sum(module.framing for module in modules.values())
    largest = max(modules, key=lambda name: modules[name].code)
    print(f"lines of code                  {sum(code)}")
    print(f"modules                        {len(code)}")
    print(f"lines of a module, median      {statistics.median(code):.0f}")
    print(f"lines of the largest           {modules[largest].code} ({largest})")
    print(f"imports and signatures         {100 * framing / sum(code):.0f} % of the lines")
    print(f"lines of a function            median {statistics.median(functions):.0f}, "
          f"90th percentile {functions[9 * len(functions) // 10]}")  # fmt: skip
    print(f"files of the largest folder    {files} ({most.relative_to(ROOT)})")
    print(f"longest chain of imports       {len(chain)} files: {chain[0]} ... {chain[-1]}")
    print(f"  with those for annotations   {len(longest_chain(modules, for_types=True))} files")
    if "run" in sys.argv[1:]:
        print_run()


if __name__ == "__main__":
    main()
