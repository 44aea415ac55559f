# SPDX-License-Identifier: MIT
"""Record every solve and every gradient of a program.

    python3 -m demos.studies.same.record OUT.json PROGRAM [ARGUMENTS]

PROGRAM is a script, or a module after ``-m``. It runs as it would by itself; its solves, time
steps and gradients are recorded as numbers that any implementation of the same equations has:
iterations, residuals, forces of the pairs, norms of the displacement. A solve that fails is
recorded, too.
"""

from __future__ import annotations

import functools
import json
import runpy
import sys
import time
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

import fenics_mortar as fm
from fenics_mortar.equations.solver import Solver


class Record:
    """Solves and gradients in the order of the program."""

    def __init__(self) -> None:
        self.solves: list[dict[str, Any]] = []
        self.gradients: list[dict[str, Any]] = []

    def watch(self) -> None:
        """Replace the entry points by recording ones."""
        solve, gradient = Solver.solve, fm.gradient

        @functools.wraps(solve)
        def solved(solver: Any, *args: Any, **options: Any) -> Any:
            try:
                report = solve(solver, *args, **options)
            except fm.MortarError as error:
                self.solves.append({"failed": type(error).__name__})
                raise
            self.solves.append(_of_solve(solver, report))
            return report

        @functools.wraps(gradient)
        def differentiated(*args: Any, **options: Any) -> Any:
            found = gradient(*args, **options)
            values = [float(np.linalg.norm(np.ravel(sum(steps)))) for steps in found.by_step]
            self.gradients.append({"value": float(found.value), "norms": values})
            return found

        Solver.solve = solved
        fm.gradient = differentiated


def _of_solve(solver: Any, report: Any) -> dict[str, Any]:
    """Numbers of a solve; collective."""
    equations = solver._equations
    u = equations.bulk.by_input_node()[1]
    contacts = [c for c in equations.contacts if hasattr(c, "total_force")]
    return {
        "iterations": report.num_iterations,
        "residuals": [float(r) for r in report.residuals],
        "force": float(report.force),
        "forces": [[float(f) for f in c.total_force] for c in contacts],
        "active": [int(c.active.sum()) for c in contacts],
        "displacement": [float(np.linalg.norm(u)), float(np.abs(u).max(initial=0.0))],
    }


def main(arguments: list[str]) -> None:
    """Run a program and write its record on rank 0."""
    out, *program = arguments
    out = Path(out).resolve()
    record = Record()
    record.watch()
    start, failed = time.process_time(), ""
    is_module = program[0] == "-m"
    sys.argv = program[1:] if is_module else program
    sys.path.insert(0, str(Path(sys.argv[0]).resolve().parent))
    try:
        if is_module:
            runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(sys.argv[0], run_name="__main__")
    except SystemExit as end:
        failed = "" if not end.code else str(end.code)
    except Exception as error:  # the record says so
        failed = f"{type(error).__name__}: {error}"
    if MPI.COMM_WORLD.rank == 0:
        found = {"seconds": time.process_time() - start, "failed": failed, **vars(record)}
        out.write_text(json.dumps(found | {"cells": cells_of_atlas()}))


def cells_of_atlas() -> list[dict[str, Any]]:
    """Results of the stability study in this folder, from other processes, without times."""
    stored = Path("results/stability/cells.jsonl")
    if not stored.exists():
        return []
    cells = [json.loads(line) for line in stored.read_text().splitlines()]
    kept = [{k: v for k, v in cell.items() if k != "seconds"} for cell in cells]
    return sorted(kept, key=lambda cell: (cell["scene"], cell["value"], cell["method"]))


if __name__ == "__main__":
    main(sys.argv[1:])
