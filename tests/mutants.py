# SPDX-License-Identifier: MIT
"""How strong the tests are: change the package at random in one place, and see if a test fails.

    python3 tests/mutants.py                    40 mutants, in a temporary copy of the checkout
    python3 tests/mutants.py -n 100 --seed 3    others
    python3 tests/mutants.py --only sparse      in files whose path holds this word only

A mutant is one change in one file of the package: of a sign, a constant or a comparison, or a term,
factor or statement dropped. Files are drawn by their number of lines. First all tests run once in
serial, and the lines that each test runs are noted (``--map FILE`` keeps that, or reads it if it is
there). Then each mutant gets the tests that run the line changed, cheapest first, until one fails
or they have used ``--budget`` seconds of CPU time; what survives in serial gets the same tests on
two ranks. Of compiled functions no lines are seen: their tests are those of files that import the
module, first without JIT. Needs nothing but what the tests need. Prints a table, and
survivors with place and difference; ``--log FILE`` has a line of JSON for each mutant.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import functools
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass
from itertools import accumulate
from operator import or_
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "fenics_mortar"
NOT_COPIED = (".git", "__pycache__", "results", ".*_cache")
START = 8.0  # CPU seconds of a process of pytest before its first test, on a slow machine
# As many tests of a compiled function as take about ten seconds without JIT, cases in turn.
INTERPRETED = 30
# A process that uses this many times the CPU time of its tests hangs; busy cores are not counted.
PATIENCE = 6.0

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


# Changes of a file


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
        first, last = self.span(node)
        return self.text[first:last]

    def add(self, node: ast.AST, kind: str, new: str) -> None:
        new = new if kind == "statement" else f"({new})"
        self.found.append((node, self.span(node), kind, new, self.function))

    @property
    def function(self) -> int:
        return self.functions[-1]

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Neither annotations nor decorators; a closure counts to the function around it."""
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
        """Words of an error or a note are no behaviour that is to be tested to the letter."""

    visit_Raise = visit_JoinedStr = visit_Import = visit_ImportFrom = leave

    def visit_keyword(self, node: ast.keyword) -> None:
        """``strict`` of zip is a check of the code itself."""
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


def draw(folder: Path, count: int, seed: int, only: str) -> list[Mutant]:
    """``count`` different mutants of the package in ``folder``; the same for the same seed."""
    texts = {path: path.read_text() for path in sorted((folder / PACKAGE).rglob("*.py"))}
    texts = {path: text for path, text in texts.items() if only in str(path.relative_to(folder))}
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
    """The mutant, or None if it reads as before."""
    first, last = span
    text = old[:first] + new + old[last:]
    if ast.dump(ast.parse(text)) == ast.dump(ast.parse(old)):
        return None
    lines = difflib.unified_diff(old.splitlines(), text.splitlines(), lineterm="", n=0)
    difference = "\n".join(line for line in lines if line[:3] not in ("---", "+++"))
    return Mutant(str(path), node.lineno, node.end_lineno, function, kind, difference, text)


# Which tests run which lines


class Lines:
    """A plugin of pytest: the lines of the package that each test runs, and its CPU time [s].

    Tests are numbered in the order in which they run; ``by_line`` holds for each (path, line) the
    set of tests as the bits of an integer.
    """

    def __init__(self):
        self.prefix = str(ROOT / PACKAGE) + os.sep
        self.paths, self.now, self.used = {}, set(), cpu()
        self.tests, self.by_line, self.of_fixtures = [], defaultdict(int), defaultdict(set)

    def trace(self, frame, event, argument):
        """Trace function of Python: None where a function is none of the package."""
        name = frame.f_code.co_filename
        if name not in self.paths:
            inside = name.startswith(self.prefix)
            self.paths[name] = name[len(str(ROOT)) + 1 :] if inside else None
        path = self.paths[name]
        if path is not None:
            self.now.add((path, frame.f_lineno))
            return self.trace

    def pytest_runtest_logstart(self, nodeid, location):
        """Anew for each test: some set a trace function of their own, and then none."""
        self.tests.append({"name": nodeid, "failed": False})
        self.now, self.used = set(), cpu()
        sys.settrace(self.trace)

    def pytest_runtest_logreport(self, report):
        test = self.tests[-1]
        test["failed"] |= report.failed
        if report.when == "setup":
            self.of_fixtures[file_of(test["name"])] |= self.now
        if report.when == "teardown":
            test["seconds"] = cpu() - self.used
            for place in self.now:
                self.by_line[place] |= 1 << (len(self.tests) - 1)

    def pytest_sessionfinish(self):
        """What fixtures run counts for all tests of a file, as they may share the fixture."""
        sys.settrace(None)
        bits = defaultdict(int)
        for number, test in enumerate(self.tests):
            bits[file_of(test["name"])] |= 1 << number
        for file, places in self.of_fixtures.items():
            for place in places:
                self.by_line[place] |= bits[file]

    def compiled(self) -> list[tuple[str, int]]:
        """Functions that numba compiles: no line of them is seen."""
        found = set()
        for module in [each for name, each in sys.modules.items() if name.startswith(PACKAGE)]:
            for value in vars(module).values():
                code = getattr(getattr(value, "py_func", None), "__code__", None)
                if code and code.co_filename.startswith(self.prefix):
                    found.add((code.co_filename[len(str(ROOT)) + 1 :], code.co_firstlineno))
        return sorted(found)

    def write(self, path: str) -> None:
        lines = defaultdict(dict)
        for (file, line), tests in sorted(self.by_line.items()):
            lines[file][line] = hex(tests)
        seen = {"tests": self.tests, "lines": lines, "compiled": self.compiled()}
        Path(path).write_text(json.dumps(seen))


def file_of(test: str) -> str:
    """The file of a test that pytest names."""
    return test.split("::")[0]


def cpu() -> float:
    """CPU time of this process and of those that it has started and that have ended [s]."""
    kinds = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    usage = [resource.getrusage(kind) for kind in kinds]
    return sum(each.ru_utime + each.ru_stime for each in usage)


def trace_tests(path: str, arguments: list[str]) -> None:
    """Run the tests and write which lines each runs; demos are processes of their own."""
    import pytest

    lines = Lines()
    pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not demo", *arguments], plugins=[lines])
    lines.write(path)


# Runs


@dataclass
class Run:
    """A temporary copy of the checkout, and how tests run in it."""

    folder: Path
    seen: dict
    budget: float

    def pytest(self, tests, allowed, *, ranks=1, jit=True, cache=None) -> tuple[str, str]:
        """(outcome, first test that failed); ``allowed`` is the CPU time of each rank [s]."""
        environment = {**os.environ, "NUMBA_DISABLE_JIT": "0" if jit else "1"}
        environment["NUMBA_CACHE_DIR"] = str(cache or self.folder / "numba")
        environment["PYTHONPATH"] = str(self.folder)
        options = ["-x", "-q", "--color=no", "-p", "no:cacheprovider"]
        command = [sys.executable, "-m", "pytest", *options, *tests]
        if ranks > 1:
            command = ["mpirun.openmpi", "-n", str(ranks), *command]
        limited = f'ulimit -t {int(PATIENCE * allowed)}; exec "$@"'
        try:
            ended = subprocess.run(
                ["bash", "-c", limited, "limited", *command],
                cwd=self.folder, env=environment, capture_output=True, text=True,
                stdin=subprocess.DEVNULL, timeout=10.0 * PATIENCE * allowed,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "hangs", ""
        if ended.returncode == 0 or ended.returncode == 5:  # 5: no test was left to run
            return "survived", ""
        words = ("FAILED ", "ERROR ")
        failed = [line for line in ended.stdout.splitlines() if line.startswith(words)]
        return ("killed" if failed else "ends"), (failed or [""])[0][:300]

    def is_compiled(self, mutant: Mutant) -> bool:
        return [mutant.path, mutant.function] in self.seen["compiled"]

    def tests_of(self, mutant: Mutant) -> list[tuple[str, float]]:
        """Tests and their CPU time [s]: those that run the lines changed, or else the file."""
        tests, lines = self.seen["tests"], self.seen["lines"].get(mutant.path, {})
        if self.is_compiled(mutant):
            near = importing_tests(self.folder, module_name(mutant.path))
            found = [test for test in tests if file_of(test["name"]) in near]
        else:
            changed = [str(line) for line in range(mutant.line, mutant.last + 1)]
            bits = [int(lines[line], 16) for line in changed if line in lines]
            bits = functools.reduce(or_, bits or (int(each, 16) for each in lines.values()), 0)
            found = [test for number, test in enumerate(tests) if bits >> number & 1]
        found = [(test["name"], test["seconds"]) for test in found if not test["failed"]]
        return varied(sorted(found, key=lambda each: each[1]))

    def judge(self, mutant: Mutant) -> dict:
        """Apply the mutant, run its tests, and take it back."""
        begin, file = cpu(), self.folder / mutant.path
        old, stamps = file.read_text(), file.stat()
        cache = self.cache_without(mutant.path)
        file.write_text(mutant.text)
        outcome, by = "survived", ""
        try:
            for group, options in self.groups(mutant):
                names, allowed = [name for name, _ in group], START + sum(s for _, s in group)
                if cache and options.get("jit", True):
                    allowed += 60.0  # kernels are compiled anew
                outcome, by = self.pytest(names, allowed, cache=cache, **options)
                if outcome == "killed" or (outcome != "survived" and options.get("jit", True)):
                    break
        finally:
            file.write_text(old)
            os.utime(file, ns=(stamps.st_atime_ns, stamps.st_mtime_ns))
            if cache:
                shutil.rmtree(cache)
        result = {**asdict(mutant), "outcome": outcome, "by": by, "seconds": cpu() - begin}
        return {name: value for name, value in result.items() if name != "text"}

    def groups(self, mutant: Mutant):
        """Groups of tests, one after the other, with options of ``pytest``."""
        chosen, used = [], 0.0
        for name, seconds in self.tests_of(mutant):
            if used + seconds < self.budget or not chosen:
                chosen.append((name, seconds))
                used += seconds
        if not chosen:
            return
        compiled = self.is_compiled(mutant)
        if compiled:  # without JIT a test takes longer than is known: what hangs says nothing
            yield varied(chosen, cases=1)[:INTERPRETED], {"jit": False}
        yield chosen[:40], {}
        if chosen[40:]:
            yield chosen[40:], {}
        if not compiled:
            yield chosen, {"ranks": 2}

    def cache_without(self, path: str) -> Path | None:
        """A copy of numba's cache without what a compiled module changes; None: it changes none."""
        if not any(path == other for other, _ in self.seen["compiled"]):
            return None
        cache = Path(tempfile.mkdtemp(prefix="numba-", dir=self.folder))
        shutil.copytree(self.folder / "numba", cache, dirs_exist_ok=True)
        for stem in importers(self.folder, path):
            for file in cache.rglob(f"{stem}.*"):
                file.unlink()
        return cache


def varied(tests: list[tuple[str, float]], cases: int = 12) -> list[tuple[str, float]]:
    """The first few cases of each test function before the other cases."""
    seen, first, later = Counter(), [], []
    for name, seconds in tests:
        function = name.split("[")[0]
        seen[function] += 1
        (first if seen[function] <= cases else later).append((name, seconds))
    return first + later


def module_name(path: str) -> str:
    parts = Path(path).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def importing_tests(folder: Path, module: str) -> set[str]:
    """Files of tests that import a module, or a helper of the tests that does."""
    files = sorted((folder / "tests").rglob("*.py"))
    names = {module, *(file.stem for file in files if imports(file, {module}))}
    return {str(file.relative_to(folder)) for file in files if imports(file, names)}


def imports(path: Path, names: set[str]) -> bool:
    """Whether a file imports one of these modules."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import) and any(each.name in names for each in node.names):
            return True
        if isinstance(node, ast.ImportFrom) and node.module:
            if {node.module, *(f"{node.module}.{each.name}" for each in node.names)} & names:
                return True
    return False


def importers(folder: Path, path: str) -> set[str]:
    """Stems of a module and of all modules that import it, at first or second hand."""
    files = {str(p.relative_to(folder)): p for p in sorted((folder / PACKAGE).rglob("*.py"))}
    reached, new = set(), {path}
    while new:
        reached |= new
        names = {module_name(each) for each in new}
        new = {each for each, file in files.items() if each not in reached and imports(file, names)}
    return {Path(each).stem for each in reached}


# The command


def copy_checkout() -> Path:
    folder = Path(tempfile.mkdtemp(prefix=f"{PACKAGE}-mutants-"))
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*NOT_COPIED), dirs_exist_ok=True)
    return folder


def seen_by_tests(folder: Path, path: Path, arguments: list[str]) -> dict:
    """The map of lines: read, or made by one run of all tests."""
    if not path.exists():
        environment = {**os.environ, "PYTHONPATH": str(folder)}
        environment["NUMBA_CACHE_DIR"] = str(folder / "numba")
        script = folder / "tests" / Path(__file__).name
        command = [sys.executable, str(script), "--trace", str(path.resolve()), *arguments]
        subprocess.run(command, cwd=folder, env=environment, check=True)
    return json.loads(path.read_text())


def table(results: list[dict]) -> str:
    rows, kinds = [], sorted({each["kind"] for each in results})
    for kind in [*kinds, "all"]:
        of_kind = [each for each in results if kind in ("all", each["kind"])]
        killed = sum(each["outcome"] != "survived" for each in of_kind)
        rows.append(f"{kind:12s} {killed:4d} of {len(of_kind):4d} killed")
    return "\n".join(rows)


def report(results: list[dict]) -> None:
    for each in results:
        if each["outcome"] == "survived":
            print(f"\nsurvived: {each['path']}:{each['line']} ({each['kind']})")
            print(each["difference"])
    print(f"\n{table(results)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=40, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--skip", type=int, default=0, help="leave out the first ones")
    parser.add_argument("--only", default="", help="a part of the path of the files to change")
    parser.add_argument("--budget", type=float, default=40.0, help="CPU seconds of tests each")
    parser.add_argument("--map", type=Path, help="file of the lines that each test runs")
    parser.add_argument("--log", type=Path, help="file that gets a line for each mutant")
    parser.add_argument("--list", action="store_true", help="only print the mutants")
    parser.add_argument("--trace", help=argparse.SUPPRESS)
    parser.add_argument("tests", nargs="*", help="files of tests, if not all")
    given = parser.parse_args()
    if given.trace:
        trace_tests(given.trace, given.tests)
        return
    folder = copy_checkout()
    try:
        mutants = draw(folder, given.n, given.seed, given.only)[given.skip :]
        if given.list:
            for mutant in mutants:
                print(f"{mutant.path}:{mutant.line} ({mutant.kind})\n{mutant.difference}")
            return
        seen = seen_by_tests(folder, given.map or folder / "lines.json", given.tests)
        run, results = Run(folder, seen, given.budget), []
        for mutant in mutants:
            results.append(run.judge(mutant))
            last = results[-1]
            print(f"{last['outcome']:9s} {last['seconds']:6.1f} s  {mutant.path}:{mutant.line}  "
                  f"{mutant.kind}  {last['by'][:90]}", flush=True)  # fmt: skip
            if given.log:
                with given.log.open("a") as log:
                    log.write(json.dumps(last) + "\n")
        report(results)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
