# SPDX-License-Identifier: MIT
"""Speed against accuracy on the exact problem of Hertz: a table of rates and a picture.

    python3 demos/accuracy/chart.py            all choices of element, basis, integration, tangent
    python3 demos/accuracy/chart.py --quick    the four elements with the default choices

Writes ``rates.md`` and ``chart.png`` to ``results/accuracy``. Times are medians of repeated solves
in one process after a warm-up, but for the set-up, which includes the mesh and happens once; bulk,
contact and solve are the phases of Newton's method by the clocks of its report.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from norms import errors
from scenes_exact import ELEMENTS, Choice, hertz

import fenics_mortar as fm

Row = dict[str, Any]
PHASES = {
    "bulk": ("residual", "tangent"),
    "contact": ("search", "integrals", "assembly"),
    "solve": ("solve",),
    "other": ("other",),
}
# Energy: the solution is smooth but for r^(3/2) at the ends of the contact. Pressure: its root.
PREDICTED = {
    1: {"energy": 1.0, "pressure": 1.0, "pressure max": 0.5},
    2: {"energy": 1.5, "pressure": 1.0, "pressure max": 0.5},
}
COLOURS = {"P1": "#0072b2", "Q1": "#56b4e9", "P2": "#d55e00", "Q2": "#e69f00"}


def measure(n: int, choice: Choice, graded: bool, repeats: int) -> Row:
    """Solve ``repeats`` times and take the medians of the times; raises if it does not converge."""
    gc.collect()
    forget_peak()
    before, begin = memory("VmRSS"), time.perf_counter()
    posed = hertz(n, choice, graded=graded)
    setup, start, seconds = time.perf_counter() - begin, posed.problem.state(), []
    for _ in range(repeats):
        posed.problem.restore(start)
        report = posed.problem.solve()
        spent = report.total_seconds()
        seconds.append([sum(spent[part] for part in parts) for parts in PHASES.values()])
    row = {"n": n, "choice": choice, "graded": graded, "dofs": posed.u.x.array.size}
    row |= {"iterations": report.num_iterations, "set-up": setup}
    row |= dict(zip(PHASES, np.median(seconds, axis=0)))
    row["MB"] = memory("VmHWM") - before
    row["seconds"] = sum(row[phase] for phase in PHASES)
    return row | errors(posed)


def forget_peak() -> None:
    """Let the peak of memory start anew, where the system can (Linux)."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        print("peaks of memory are those since the start of the process")


def memory(what: str) -> float:
    """Memory of this process, "VmRSS" now or "VmHWM" at its peak [MB]; nan if not told."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return np.nan
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith(what)), np.nan)


def measure_all(
    choices: Sequence[Choice], sizes: Sequence[int], gradings: Sequence[bool], repeats: int
) -> list[Row]:
    """All rows; what fails is said and left out."""
    rows = []
    for choice, graded in product(choices, gradings):
        measure(sizes[0], choice, graded, 1)  # compiles
        for n in sizes:
            try:
                rows.append(measure(n, choice, graded, repeats))
            except fm.MortarError as error:
                print(f"{choice} graded={graded} n={n}: {error}", flush=True)
    return rows


def series(rows: Sequence[Row]) -> dict[tuple[Choice, bool], list[Row]]:
    """Rows of one choice and kind of mesh, from coarse to fine."""
    found: dict[tuple[Choice, bool], list[Row]] = {}
    for row in rows:
        found.setdefault((row["choice"], row["graded"]), []).append(row)
    return found


def rate(rows: Sequence[Row], name: str) -> float:
    """Rate of an error over the last two halvings of the facets.

    Over one halving it depends on where in its facet the end of the contact lies; over two it comes
    back to its place.
    """
    coarse, fine = rows[-3], rows[-1]
    return float(np.log(coarse[name] / fine[name]) / np.log(fine["n"] / coarse["n"]))


def table(rows: Sequence[Row]) -> str:
    """Fitted rates beside predicted ones, and what the finest mesh costs, in Markdown."""
    lines = [
        "| element | mesh | basis | integration | tangent | energy | pressure L2 | pressure max "
        "| finest: energy | dofs | iterations | set-up [s] | bulk | contact | solve | other "
        "| adds [MB] |",
        "|---|---|---|---|---|" + "---:|" * 12,
    ]
    for (choice, graded), mine in series(rows).items():
        if len(mine) < 3:
            continue
        predicted = PREDICTED[ELEMENTS[choice.element][1]]
        # no rate is predicted here for graded meshes
        rates = [
            f"{rate(mine, name):.2f}" + ("" if graded else f" ({value:g})")
            for name, value in predicted.items()
        ]
        last = mine[-1]
        cells = [choice.element, "graded" if graded else "uniform"]
        cells += [choice.basis, choice.integration, choice.linearization, *rates]
        cells += [f"{last['energy']:.1e}", str(last["dofs"]), str(last["iterations"])]
        cells += [f"{last[phase]:.3f}" for phase in ("set-up", *PHASES)]
        cells.append(f"{last['MB']:.0f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def draw(rows: Sequence[Row]) -> Figure:
    """Errors of energy and pressure over dofs and over seconds, with the default choices."""
    figure = Figure((9.5, 7.5), layout="constrained")
    axes = figure.subplots(2, 2, sharey="row")
    for (choice, graded), mine in series(rows).items():
        if choice != Choice(choice.element):
            for row, name in enumerate(("energy", "pressure")):
                x, y = [r["seconds"] for r in mine], [r[name] for r in mine]
                axes[row, 1].loglog(x, y, ".", ms=3, alpha=0.4, color=COLOURS[choice.element])
            continue
        style = {"color": COLOURS[choice.element], "ls": "--" if graded else "-", "marker": "o"}
        label = f"{choice.element}{', graded' if graded else ''}"
        for row, name in enumerate(("energy", "pressure")):
            for column, cost in enumerate(("dofs", "seconds")):
                x, y = [r[cost] for r in mine], [r[name] for r in mine]
                axes[row, column].loglog(x, y, ms=3, lw=1.2, label=label, **style)
    for row, name in enumerate(("energy", "pressure, L2")):
        axes[row, 0].set_ylabel(f"relative error: {name}")
    axes[1, 0].set_xlabel("unknown displacements")
    axes[1, 1].set_xlabel("seconds of a solve, mesh and set-up aside")
    for axis in axes.ravel():
        axis.grid(True, which="major", color="#dddddd", lw=0.6)
    axes[0, 0].legend(frameon=False, ncols=2, fontsize=8)
    figure.suptitle(
        "Hertz on boxes with the exact loads. Lines: dual basis, segments, full tangent;\n"
        "dots: all other choices of basis, integration and tangent"
    )
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="default choices, coarse meshes")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--finest", type=int, help="facets of the slave: 64, 128, ...")
    options = parser.parse_args()
    parts = (
        [("dual",), ("segments",), ("full",)]
        if options.quick
        else [
            ("dual", "standard"),
            ("segments", "elements"),
            ("full", "frozen"),
        ]
    )
    choices = [Choice(*names) for names in product(ELEMENTS, *parts)]
    finest = options.finest or (64 if options.quick else 128)
    sizes = [n for n in (16, 32, 64, 128, 256, 512) if n <= finest]
    rows = measure_all(choices, sizes, (False, True), options.repeats)
    folder = Path("results/accuracy")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rates.md").write_text(table(rows))
    draw(rows).savefig(folder / "chart.png", dpi=150)
    print(table(rows))


if __name__ == "__main__":
    main()
