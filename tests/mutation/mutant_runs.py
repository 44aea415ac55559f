# SPDX-License-Identifier: MIT
"""A copy of the checkout in which mutants are tested."""

from __future__ import annotations

import ast
import functools
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from operator import or_
from pathlib import Path

from mutation.mutant_changes import PACKAGE, Mutant
from mutation.mutant_lines import cpu, file_of

from demos.studies.processes import mpirun

START = 8.0  # CPU seconds of a process of pytest before its first test, on a slow machine
COMPILATION = 60.0  # CPU seconds in which all kernels are compiled, on a slow machine
# Number of tests of a compiled function, which take about ten seconds without JIT.
INTERPRETED = 30
# CPU time over that of the tests [1] above which a process is considered to hang.
PATIENCE = 6.0


@dataclass
class Run:
    """A temporary copy of the checkout for running tests; ``see`` returns the map of lines."""

    folder: Path
    see: Callable[[], dict]
    budget: float

    @functools.cached_property
    def seen(self) -> dict:
        return self.see()

    def pytest(self, tests, allowed, *, ranks=1, jit=True, cache=None) -> tuple[str, str]:
        """(outcome, first test that failed); ``allowed`` is the CPU time of each rank [s]."""
        environment = {**os.environ, "NUMBA_DISABLE_JIT": "0" if jit else "1"}
        environment["NUMBA_CACHE_DIR"] = str(cache or self.folder / "numba")
        environment["PYTHONPATH"] = str(self.folder)
        options = ["-x", "-q", "--color=no", "-p", "no:cacheprovider"]
        command = [sys.executable, "-m", "pytest", *options, *tests]
        limited = f'ulimit -t {int(PATIENCE * allowed)}; exec "$@"'
        try:
            ended = subprocess.run(
                ["bash", "-c", limited, "limited", *mpirun(ranks), *command],
                cwd=self.folder, env=environment, capture_output=True, text=True,
                stdin=subprocess.DEVNULL, timeout=10.0 * PATIENCE * allowed,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "hangs", ""
        if ended.returncode in (0, 4, 5):  # 4, 5: there is no such test, or none is left to run
            return "survived", ""
        beginnings = ("FAILED ", "ERROR ")
        failed = [line for line in ended.stdout.splitlines() if line.startswith(beginnings)]
        return ("killed" if failed else "ends"), (failed or [""])[0][:300]

    def is_compiled(self, mutant: Mutant) -> bool:
        """Whether a compiled function changes, or a constant of a module that has some."""
        compiled = [first for path, first in self.seen["compiled"] if path == mutant.path]
        return mutant.function in compiled or (not mutant.function and bool(compiled))

    def tests_of(self, mutant: Mutant) -> list[tuple[str, float]]:
        """Tests and their CPU time [s]: those that run the lines changed, or else the file.

        Those that import the module if it is compiled, or has no lines but those of its import.
        """
        tests, lines = self.seen["tests"], self.seen["lines"].get(mutant.path, {})
        if self.is_compiled(mutant) or not lines:
            near = near_tests(self.folder, mutant.path)
            found = [test for test in tests if file_of(test["name"]) in near]
        else:
            changed = [str(line) for line in range(mutant.line, mutant.last + 1)]
            bits = [int(lines[line], 16) for line in changed if line in lines]
            bits = functools.reduce(or_, bits or (int(each, 16) for each in lines.values()), 0)
            found = [test for number, test in enumerate(tests) if bits >> number & 1]
        found = [(test["name"], test["seconds"]) for test in found if not test["failed"]]
        return varied(sorted(found, key=lambda each: each[1]))

    def judge(self, mutant: Mutant) -> dict:
        """Apply the mutant, run its tests, and revert it."""
        return self.apply(mutant, self.groups(mutant), self.cache_without(mutant.path))

    def repeat(self, mutant: Mutant, entry: dict) -> dict:
        """As ``judge``, by the test of an earlier log first; known survivors are not run."""
        if entry.get("survives"):
            return self.apply(mutant, [], None)
        if entry.get("by"):
            test = entry["by"].removeprefix("FAILED ").removeprefix("ERROR ").split(" - ")[0]
            result = self.apply(mutant, [([(test, COMPILATION)], entry.get("options", {}))], None)
            if result["outcome"] != "survived":
                return result
        return self.judge(mutant)

    def apply(self, mutant: Mutant, groups: Iterable, cache: Path | None) -> dict:
        """Result of a mutant by groups of tests, with an own cache of numba if one is given."""
        begin, file = cpu(), self.folder / mutant.path
        old, stamps = file.read_text(), file.stat()
        file.write_text(mutant.text)
        outcome, by, options = "survived", "", {}
        try:
            for group, options in groups:
                names, allowed = [name for name, _ in group], START + sum(s for _, s in group)
                if cache and options.get("jit", True):
                    allowed += COMPILATION
                outcome, by = self.pytest(names, allowed, cache=cache, **options)
                if outcome == "killed" or (outcome != "survived" and options.get("jit", True)):
                    break
        finally:
            file.write_text(old)
            os.utime(file, ns=(stamps.st_atime_ns, stamps.st_mtime_ns))
            if cache:
                shutil.rmtree(cache)
        result = {**asdict(mutant), "outcome": outcome, "by": by, "options": options}
        del result["text"]
        return {**result, "seconds": cpu() - begin}

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
        if compiled:  # without JIT the time of a test is unknown: hanging tests are ignored
            yield varied(chosen, cases=1)[:INTERPRETED], {"jit": False}
        yield chosen[:40], {}
        if chosen[40:]:
            yield chosen[40:], {}
        if not compiled:
            yield chosen, {"ranks": 2}

    def cache_without(self, path: str) -> Path | None:
        """A copy of numba's cache without kernels affected by a module; None if there are none."""
        if not any(path == other for other, _ in self.seen["compiled"]):
            return None
        cache = Path(tempfile.mkdtemp(prefix="numba-", dir=self.folder))
        shutil.copytree(self.folder / "numba", cache, dirs_exist_ok=True)
        *_, reached = importers(self.folder, path)
        for stem in {Path(each).stem for each in reached}:
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


def near_tests(folder: Path, path: str) -> set[str]:
    """Files of tests that import a module, or else one of those that import it, and so on."""
    for reached in importers(folder, path):
        found = importing_tests(folder, set(map(module_name, reached)))
        if found:
            return found
    return set()


def importing_tests(folder: Path, modules: set[str]) -> set[str]:
    """Files of tests that import one of the modules, or a helper of the tests that does."""
    files = sorted((folder / "tests").rglob("*.py"))
    names = modules | {file.stem for file in files if imports(file, modules)}
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


def importers(folder: Path, path: str) -> Iterator[set[str]]:
    """Paths of a module, then also of those that import it at first, at second hand, and so on."""
    files = {str(p.relative_to(folder)): p for p in sorted((folder / PACKAGE).rglob("*.py"))}
    reached, new = set(), {path}
    while new:
        reached = reached | new
        yield reached
        names = {module_name(each) for each in new}
        new = {each for each, file in files.items() if each not in reached and imports(file, names)}
