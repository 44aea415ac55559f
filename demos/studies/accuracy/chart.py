# SPDX-License-Identifier: MIT
"""Speed against accuracy on the exact problem of Hertz: tables of rates and pictures.

    python3 -m demos.studies.accuracy.chart            all choices of element, basis, rule, tangent
    python3 -m demos.studies.accuracy.chart --quick    the four elements with the default choices
    python3 -m demos.studies.accuracy.chart --redraw   stored measurements, and other codes

Writes to ``results/accuracy``: ``summary.md`` and ``chart.png``, the short version, ``rates.md``
and ``choices.png``, with all choices. Other codes on the same meshes are drawn if ``peer_*.py``
have been run. Times are medians of repeated runs in one process after a warm-up, each from the mesh
arrays to the solution. ``seconds`` are CPU times with one thread, which depend little on the load
of the machine: source ``.ci/env.sh`` first. Bulk, contact and solve are phases of Newton's method
by the clocks of its report; set-up is the wall time before it.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

import fenics_mortar as fm
from demos.studies.accuracy.norms import errors
from demos.studies.accuracy.posed import ELEMENTS, Choice
from demos.studies.accuracy.report import DEFAULT, OURS, PHASES, SIZES, Row, read, report, write
from demos.studies.accuracy.scenes_exact import hertz

# Clocks of Newton's report that belong to each phase except the set-up
CLOCKS = (("residual", "tangent"), ("search", "integrals", "assembly"), ("solve",), ("other",))


def measure(n: int, choice: Choice, graded: bool, repeats: int) -> Row:
    """Pose and solve ``repeats`` times, medians of the times; raises if it does not converge."""
    gc.collect()
    forget_peak()
    before, seconds, phases = memory("VmRSS"), [], []
    for _ in range(repeats):
        begin, start = time.perf_counter(), time.process_time()
        posed = hertz(n, choice, graded=graded)
        setup = time.perf_counter() - begin
        report = posed.problem.solve()
        seconds.append(time.process_time() - start)
        spent = report.total_seconds()
        phases.append([setup, *(sum(spent[part] for part in parts) for parts in CLOCKS)])
    row: Row = {"code": OURS, "n": n, **vars(choice), "graded": graded}
    row |= {"dofs": posed.u.x.array.size, "iterations": report.num_iterations}
    row |= dict(zip(PHASES, np.median(phases, axis=0).tolist()))
    row["seconds"] = float(np.median(seconds))
    row["MB"] = memory("VmHWM") - before
    return row | {name: float(error) for name, error in errors(posed).items()}


def forget_peak() -> None:
    """Reset the peak of memory if the system supports it (Linux)."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        print("peaks of memory are those since the start of the process")


def memory(what: str) -> float:
    """Memory of this process, "VmRSS" now or "VmHWM" at its peak [MB]; nan if unknown."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return np.nan
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith(what)), np.nan)


def measure_all(
    choices: Sequence[Choice], sizes: Sequence[int], gradings: Sequence[bool], repeats: int
) -> list[Row]:
    """All rows; failures are printed and omitted."""
    rows = []
    for choice, graded in product(choices, gradings):
        measure(sizes[0], choice, graded, 1)  # compiles
        for n in sizes:
            try:
                rows.append(measure(n, choice, graded, repeats))
            except fm.MortarError as error:
                print(f"{choice} graded={graded} n={n}: {error}", flush=True)
    return rows


def all_choices() -> list[Choice]:
    """All combinations of choices; multipliers at vertices are for quadratic facets only."""
    bases = {1: ("dual", "standard"), 2: ("dual", "standard", "vertices")}
    return [
        Choice(element, *names)
        for element, (_, degree) in ELEMENTS.items()
        for names in product(bases[degree], ("segments", "elements"), ("full", "frozen"))
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="default choices, coarse meshes")
    parser.add_argument("--redraw", action="store_true", help="measure nothing")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--finest", type=int, help="facets of the slave: 64, 128, ...")
    options = parser.parse_args()
    if not options.redraw:
        choices = (
            [Choice(element, *DEFAULT) for element in ELEMENTS] if options.quick else all_choices()
        )
        finest = options.finest or (64 if options.quick else 128)
        sizes = [n for n in SIZES if n <= finest]
        write("ours", measure_all(choices, sizes, (False, True), options.repeats))
    print(report(read()))


if __name__ == "__main__":
    main()
