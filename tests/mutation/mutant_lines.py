# SPDX-License-Identifier: MIT
"""Lines of the package run by each test, and CPU times of the tests."""

from __future__ import annotations

import json
import os
import resource
import sys
from collections import defaultdict
from pathlib import Path

from mutation.mutant_changes import PACKAGE

ROOT = Path(__file__).resolve().parents[2]


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
        """Trace function of Python: None for functions outside the package."""
        name = frame.f_code.co_filename
        if name not in self.paths:
            inside = name.startswith(self.prefix)
            self.paths[name] = name[len(str(ROOT)) + 1 :] if inside else None
        path = self.paths[name]
        if path is not None:
            self.now.add((path, frame.f_lineno))
            return self.trace

    def pytest_runtest_logstart(self, nodeid, location):
        """Set the trace function for each test again: some tests set and remove trace functions."""
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
        """Lines run by fixtures are assigned to all tests of a file."""
        sys.settrace(None)
        bits = defaultdict(int)
        for number, test in enumerate(self.tests):
            bits[file_of(test["name"])] |= 1 << number
        for file, places in self.of_fixtures.items():
            for place in places:
                self.by_line[place] |= bits[file]

    def compiled(self) -> list[tuple[str, int]]:
        """Functions compiled by numba, whose lines are not traced."""
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
        record = {"tests": self.tests, "lines": lines, "compiled": self.compiled()}
        Path(path).write_text(json.dumps(record))


def file_of(test: str) -> str:
    """The file of a test that pytest names."""
    return test.split("::")[0]


def cpu() -> float:
    """CPU time of this process and of its finished child processes [s]."""
    kinds = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    usage = [resource.getrusage(kind) for kind in kinds]
    return sum(each.ru_utime + each.ru_stime for each in usage)


def trace_tests(path: str, arguments: list[str]) -> None:
    """Run the tests and write which lines each runs; demos are processes of their own."""
    import pytest

    lines = Lines()
    without = [f"--ignore=tests/repository/test_{name}.py" for name in ("demos", "tutorial")]
    pytest.main(["-q", "-p", "no:cacheprovider", *without, *arguments], plugins=[lines])
    lines.write(path)
