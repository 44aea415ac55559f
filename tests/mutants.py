# SPDX-License-Identifier: MIT
"""Strength of the tests: change the package at random in one place, and check that a test fails.

    python3 tests/mutants.py                    40 mutants, in a temporary copy of the checkout
    python3 tests/mutants.py -n 100 --seed 3    others
    python3 tests/mutants.py --only sparse      in files whose path holds this word only
    python3 tests/mutants.py --again FILE       those of an earlier log, at their present positions
    python3 tests/mutants.py -- --cases 1       arguments of pytest for the run that records lines

A mutant is one change in one file of the package: of a sign, a constant or a comparison, or a term,
factor or statement dropped. Files are drawn by their number of lines. First all tests run once in
serial, and the lines run by each test are recorded (``--map FILE`` stores this map, or reads an
existing one). Then the tests that run the changed line are run for each mutant, cheapest first,
until one fails or ``--budget`` seconds of CPU time are used; survivors are tested on two ranks,
too. Lines of compiled functions are not traced: their tests are those of files that import the
module, first without JIT. Prints a table, and survivors with position and difference;
``--log FILE`` has a line of JSON for each mutant. With ``--again`` the similarity of the changed
lines decides where they are now, and those that are gone are listed. The test that detected a
mutant then runs first, so that no map is needed as long as it does; those with a reason why they
survive, ``survives``, are not run. ``tests/mutation/sample.jsonl`` is such a log.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from mutation.mutant_changes import PACKAGE, Mutant, draw
from mutation.mutant_lines import ROOT, trace_tests
from mutation.mutant_runs import Run
from mutation.mutant_sample import read_sample

NOT_COPIED = (".git", "__pycache__", "results", ".*_cache")


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
        command = [sys.executable, str(script), "--trace", str(path.resolve()), "--", *arguments]
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
            print(f"{each['difference']}\n{each['survives']}".strip())
    print(f"\n{table(results)}")


def chosen(folder: Path, given: argparse.Namespace) -> list[tuple[Mutant, dict]]:
    """Mutants drawn, or those of a log with their entries."""
    if given.again is None:
        drawn = draw(folder, given.n, given.seed, given.only)
        return [(mutant, {}) for mutant in drawn[given.skip :]]
    sample = read_sample(folder, given.again)
    for _, entry in filter(lambda each: each[0] is None, sample):
        print(f"gone: {entry['path']}:{entry['line']} ({entry['kind']})\n{entry['difference']}")
    return [each for each in sample if each[0] is not None][given.skip :]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=40, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--skip", type=int, default=0, help="leave out the first ones")
    word = "a part of the path of the files to change; may be repeated"
    parser.add_argument("--only", action="append", default=[], help=word)
    parser.add_argument("--again", type=Path, help="repeat the mutants of this log")
    parser.add_argument("--budget", type=float, default=40.0, help="CPU seconds of tests each")
    parser.add_argument("--map", type=Path, help="file of the lines that each test runs")
    parser.add_argument("--log", type=Path, help="file that gets a line for each mutant")
    parser.add_argument("--list", action="store_true", help="only print the mutants")
    parser.add_argument("--trace", help=argparse.SUPPRESS)
    parser.add_argument("tests", nargs="*", help="after ``--``: arguments of pytest")
    given = parser.parse_args()
    if given.trace:
        trace_tests(given.trace, given.tests)
        return
    folder = copy_checkout()
    try:
        mutants = chosen(folder, given)
        if given.list:
            for mutant, _ in mutants:
                print(f"{mutant.path}:{mutant.line} ({mutant.kind})\n{mutant.difference}")
            return
        see = partial(seen_by_tests, folder, given.map or folder / "lines.json", given.tests)
        run, results = Run(folder, see, given.budget), []
        for mutant, entry in mutants:
            last = run.repeat(mutant, entry)
            results.append({**last, "survives": entry.get("survives", "")})
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
