# SPDX-License-Identifier: MIT
"""Freeze the results of today's code, and compare those of tomorrow's with them.

    python3 -m demos.studies.same.compare freeze            into results/same/frozen
    python3 -m demos.studies.same.compare                   the same programs again, and a table
    python3 -m demos.studies.same.compare freeze two_blocks gradients

The programs are all demos (each load step and gradient), the stability study by the default method,
the chart of accuracy, and the problems of ``waits``, each in a process of its own on one rank. Each
solve, gradient and difficult problem is compared with the one of the same number: iterations must
be equal, and forces, displacements and gradients equal to rounding, of which Newton's method leaves
more where it stops at a residual just below its limit. Times are CPU seconds of the whole program,
for which an idle machine is needed.

Run ``freeze`` before a change of the house, and the comparison after each commit of it. Kernels are
compiled by a first program, so that they do not count.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
FOLDER = Path("results/same")
# Programs that are no demos: module and arguments.
STUDIES = {
    "atlas": ("-m", "demos.studies.stability.atlas", "--methods", "default"),
    "chart": ("-m", "demos.studies.accuracy.chart"),
    "waits": ("-m", "demos.studies.performance.waits", "50"),
}
# Largest relative difference of forces, displacements and gradients: rounding of solutions.
ROUNDING = 1e-9
# Residuals above this fraction of the first one are compared; those below are rounding themselves.
COMPARED = 1e-6
# Relative difference of residuals, which depend on the order of sums more than results do.
RESIDUALS = 1e-3


def programs() -> dict[str, tuple[str, ...]]:
    """Names of the programs, and their arguments for Python."""
    demos = sorted((ROOT / "demos").glob("demo_*.py"))
    return {demo.stem.removeprefix("demo_"): (str(demo),) for demo in demos} | STUDIES


def record(name: str, arguments: tuple[str, ...], folder: Path) -> dict[str, Any]:
    """Run a program; returns its record, see ``record``."""
    folder.mkdir(parents=True, exist_ok=True)
    out = (folder / f"{name}.json").resolve()
    out.unlink(missing_ok=True)
    place = folder / name
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    command = [sys.executable, "-m", "demos.studies.same.record", str(out), *arguments]
    ended = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    if not out.exists():
        raise SystemExit(f"{name} wrote no record:\n{ended.stderr[-2000:]}")
    return json.loads(out.read_text())


def differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """What differs between two records of a program, in words."""
    if one["failed"] != other["failed"]:
        yield f"ends with '{other['failed']}', before with '{one['failed']}'"
    for kind in ("solves", "gradients", "cells"):
        if len(one[kind]) != len(other[kind]):
            yield f"{len(other[kind])} {kind}, before {len(one[kind])}"
        for number, (a, b) in enumerate(zip(one[kind], other[kind], strict=False), start=1):
            for what in _different(a, b):
                yield f"{kind[:-1]} {number}: {what}"


def _different(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[str]:
    for name in sorted(set(a) | set(b)):
        before, now = a.get(name), b.get(name)
        if isinstance(before, (int, str)) or before is None or name == "active":
            if before != now:
                yield f"{name} {now}, before {before}"
            continue
        x, y = (np.array(list(_flat(value)), float) for value in (before, now))
        if name == "residuals":
            size = min(x.size, y.size)
            x, y = x[:size], y[:size]
            kept = x > COMPARED * x.max(initial=0.0)
            off = float((np.abs(x - y)[kept] / x[kept]).max(initial=0.0))
            limit = RESIDUALS
        elif x.shape != y.shape:
            off, limit = np.inf, 0.0
        else:
            off = float(np.abs(x - y).max(initial=0.0) / (np.abs(x).max(initial=0.0) or 1.0))
            limit = ROUNDING
        if off > limit:
            yield f"{name} differ by {off:.1e}"


def _flat(value: Any) -> Iterator[float]:
    if isinstance(value, list):
        for part in value:
            yield from _flat(part)
    else:
        yield float(value)


def table(rows: list[tuple[str, dict[str, Any], dict[str, Any], list[str]]]) -> str:
    """A row per program: solves, iterations, CPU seconds before and now, differences."""
    lines = ["| program | solves | iterations | CPU s before | now | differences |"]
    lines += ["|---|---:|---:|---:|---:|---|"]
    for name, before, now, found in rows:
        iterations = sum(solve.get("iterations", 0) for solve in now["solves"])
        iterations += sum(sum(cell["iterations"]) for cell in now["cells"])
        described = "none" if not found else f"{len(found)}: {'; '.join(found[:3])}"
        lines.append(
            f"| {name} | {len(now['solves'])} | {iterations} | {before['seconds']:.1f} "
            f"| {now['seconds']:.1f} | {described} |"
        )
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Freeze or compare; the number of programs that differ."""
    freeze = arguments[:1] == ["freeze"]
    names = arguments[1:] if freeze else arguments
    known = programs()
    unknown = set(names) - set(known)
    if unknown:
        raise SystemExit(f"no program {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    rows = []
    for name in names or known:
        frozen = FOLDER / "frozen" / f"{name}.json"
        if freeze:
            made = record(name, known[name], FOLDER / "frozen")
            print(f"{name}: {len(made['solves'])} solves, {made['seconds']:.1f} s", flush=True)
            continue
        if not frozen.exists():
            raise SystemExit(f"{frozen} is not there: run 'freeze' with the code before")
        before, now = json.loads(frozen.read_text()), record(name, known[name], FOLDER / "now")
        rows.append((name, before, now, list(differences(before, now))))
        print(table(rows[-1:]).splitlines()[-1], flush=True)
    if rows:
        (FOLDER / "table.md").write_text(table(rows) + "\n")
    return sum(bool(found) for *_, found in rows)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
