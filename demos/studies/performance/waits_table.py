# SPDX-License-Identifier: MIT
"""Table of the problems of ``waits``: this version, an earlier one and other codes, by turns.

    python3 -m demos.studies.performance.waits_table --against FOLDER --peers PYTHON 50 100 0.0037
    python3 -m demos.studies.performance.waits_table --redraw

Each repetition runs each code once, in a process of its own, on all sizes of ``waits``; seconds of
the processor and iterations are medians. FOLDER is another checkout, whose own ``waits`` is run, or
the script given by ``--script`` if it has an older layout. PYTHON is an interpreter that can import
the other codes, see ``demos/studies/accuracy/peer_*.py``. Force and largest pressure are compared
with those of ``waits fine``. Writes measurements, table and picture to ``results/waits``. Source
``.ci/env.sh`` first.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from demos.studies.accuracy.report import markdown

ROOT, RESULTS = Path(__file__).resolve().parents[3], Path("results/waits")
MODULES = "demos.studies.performance"
SIZES = ["50", "100", "0.0037"]
NOW, BEFORE, FINE = "now", "before", "fine"
PEERS = ("GetFEM", "Kratos", "NGSolve")
COLOURS = {NOW: "#0072b2", BEFORE: "#999999"}
COLOURS |= dict(zip(PEERS, ("#d55e00", "#009e73", "#cc79a7"), strict=True))
LABELS = {NOW: "fenics_mortar", BEFORE: "fenics_mortar, before"}
# Problems of the table, and of the panels of the picture
SCENES = ("H1", "H1 of degree 2", "H3, loop", "H3, path")
PANELS = {"H1": "half disc on a block (H1)", "H3, loop": "ironing in 50 steps (H3)"}
# Columns with numbers
NUMBERS = ("CPU [s]", "iterations", "force", "largest pressure")
# One row that a code printed: ``code``, ``scene``, ``unknowns``, and the other columns as text
Row = dict[str, Any]


def run(code: str, command: Sequence[str], environment: dict[str, str], folder: Path) -> list[Row]:
    """Rows printed by a command."""
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{code}: {' '.join(command)} failed:\n{done.stderr[-2000:]}")
    lines = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in done.stdout.splitlines()
        if line.startswith(("| scene", "| H"))
    ]
    head, *cells = lines
    return [{"code": code} | dict(zip(head, row, strict=True)) for row in cells]


def commands(options: argparse.Namespace) -> dict[str, tuple[list[str], dict[str, str], Path]]:
    """Command, environment and folder of each code."""
    sizes, here = options.sizes or SIZES, dict(os.environ)
    found = {NOW: ([sys.executable, "-m", f"{MODULES}.waits", *sizes], here, ROOT)}
    if options.against:
        folder = Path(options.against).resolve()
        there = here | {"PYTHONPATH": os.pathsep.join(map(str, (folder, folder / "meshes")))}
        what = ["-m", f"{MODULES}.waits"]
        if options.script:
            what = [str(Path(options.script).resolve())]
        found[BEFORE] = ([sys.executable, *what, *sizes], there, folder)
    if options.peers:
        for code in PEERS:
            command = [options.peers, "-m", f"{MODULES}.waits_peer", code.lower()]
            command += options.peer_sizes.split() if options.peer_sizes else sizes
            found[code] = (command, here, ROOT)
    return found


def measure(options: argparse.Namespace) -> list[Row]:
    """Rows of all repetitions, and of the fine meshes."""
    rows = run(FINE, [sys.executable, "-m", f"{MODULES}.waits", "fine"], dict(os.environ), ROOT)
    for turn in range(options.repeats):
        for code, command in commands(options).items():
            print(f"{turn + 1} of {options.repeats}: {code}", file=sys.stderr, flush=True)
            rows += run(code, *command)
    return rows


def medians(rows: Sequence[Row]) -> list[Row]:
    """One row for each code, problem and size, with medians of seconds and iterations."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if row["scene"] in SCENES and row["code"] != FINE:
            found.setdefault((row["scene"], row["unknowns"], row["code"]), []).append(row)
    order = [NOW, BEFORE, *PEERS]
    keys = sorted(found, key=lambda k: (SCENES.index(k[0]), int(k[1]), order.index(k[2])))
    return [found[key][0] | {name: middle(found[key], name) for name in NUMBERS} for key in keys]


def middle(rows: Sequence[Row], name: str) -> float | None:
    """Median of a column; ``None`` if a code has no such column or could not solve."""
    values = [float(row[name]) for row in rows if row.get(name, "-") not in ("-", "")]
    return median(values) if values else None


def table(rows: Sequence[Row]) -> str:
    """Markdown table of all codes; "off" is the deviation from the fine mesh."""
    exact = {row["scene"]: row for row in rows if row["code"] == FINE}
    lines = []
    for row in medians(rows):
        right = exact[row["scene"][:2]]
        cells = [row["scene"], f"{int(row['unknowns']):,}", row["code"]]
        seconds, iterations, *values = (row[name] for name in NUMBERS)
        cells += ["-"] * 4 if seconds is None else [f"{seconds:.2f}", f"{iterations:.0f}"]
        if seconds is not None:
            cells += [off(value, right[name]) for value, name in zip(values, NUMBERS[2:])]
        lines.append([*cells, row["linear solver"].split(" (")[0]])
    head = "problem | unknowns | code | CPU [s] | iterations | force off [%] | pressure off [%]"
    return markdown(f"{head} | solver", 3, lines)


def off(value: float | None, right: str) -> str:
    """Deviation [%]."""
    return "" if value is None else f"{100 * abs(value / float(right) - 1):.2f}"


def draw(rows: Sequence[Row]) -> Figure:
    """Seconds over unknowns, a panel for each problem."""
    figure = Figure((9.6, 4.2), layout="constrained")
    axes = figure.subplots(1, len(PANELS))
    for axis, (scene, title) in zip(axes, PANELS.items()):
        mine = [row for row in medians(rows) if row["scene"] == scene and row["CPU [s]"]]
        for code, colour in COLOURS.items():
            points = [(int(row["unknowns"]), row["CPU [s]"]) for row in mine if row["code"] == code]
            if points:
                own = code in (NOW, BEFORE)
                style = {"lw": 2.2 if own else 1.2, "ls": "-" if own else ":", "marker": "o"}
                axis.loglog(*zip(*points), color=colour, label=LABELS.get(code, code), **style)
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("unknown displacements")
        axis.grid(True, which="major", color="#dddddd", lw=0.6)
        for side, form in ((axis.xaxis, "{x:,.0f}"), (axis.yaxis, "{x:g}")):
            side.set_major_locator(LogLocator(subs=(1, 2, 5)))
            side.set_major_formatter(form)
            side.set_minor_locator(NullLocator())
    axes[0].set_ylabel("processor seconds")
    axes[0].legend(frameon=False, fontsize=9)
    return figure


def main() -> None:
    """Measure, unless stored measurements are to be drawn, and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="*", help="arguments of waits")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--against", help="folder of another checkout")
    parser.add_argument("--script", help="script to run there instead of its waits")
    parser.add_argument("--peers", help="interpreter with the other codes")
    parser.add_argument("--peer-sizes", help='sizes of the other codes, "50 0.0037", if not all')
    parser.add_argument("--redraw", action="store_true", help="measure nothing")
    options = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    stored = RESULTS / "rows.json"
    if not options.redraw:
        stored.write_text(json.dumps(measure(options), indent=1))
    rows = json.loads(stored.read_text())
    (RESULTS / "table.md").write_text(table(rows))
    draw(rows).savefig(RESULTS / "waits.png", dpi=110)
    print(table(rows))


if __name__ == "__main__":
    main()
