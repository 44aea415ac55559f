# SPDX-License-Identifier: MIT
"""One cell of the stability study: a problem solved by a method, and the outcome.

As a program this module is a worker: it reads tasks from its standard input, one JSON object per
line, with "scene", "value" and "method", and writes one line per task. Under ``mpirun`` all ranks
form one worker.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from mpi4py import MPI

import numpy as np

from demos.studies.stability.families import scene_of
from demos.studies.stability.methods import ALL_METHODS, Method
from demos.studies.stability.model import Posed, Scene, fm, pose_problem
from fenics_mortar.newton.loop import NewtonReport

# Number of linear systems after which a contrast method is stopped: a constant, and a number for
# each of the problem's steps. Converging runs need fewer.
MOST_SYSTEMS = 500, 20
STATES = ("converged", "cut", "wrong", "failed", "dead end", "n/a", "not available")


class GivenUpError(Exception):
    """The limit of linear systems of a cell is exceeded."""


@dataclass
class Record:
    """Outcome of a cell.

    Attributes:
        state: One of ``STATES``.
        reason: Reason if it is not "converged", as text.
        iterations: Newton iterations of each accepted step.
        cuts: Number of failed attempts at steps.
        lost: Newton iterations of failed attempts.
        seconds: Wall time.
        numbers: Forces and size of the last state, to compare runs.
    """

    state: str
    reason: str = ""
    iterations: list[int] = field(default_factory=list)
    cuts: int = 0
    lost: int = 0
    seconds: float = 0.0
    numbers: list[float] = field(default_factory=list)


def run_cell(scene: Scene, method: Method, comm: MPI.Comm) -> Record:
    """Solve a problem by a method (collective)."""
    begin, record = time.perf_counter(), Record("failed")
    try:
        with method.override():
            _run(scene, method, comm, record)
    except TypeError as error:
        if "unexpected keyword" not in str(error):
            raise
        record.state, record.reason = "not available", str(error)
    record.seconds = round(time.perf_counter() - begin, 2)
    return record


def _run(scene: Scene, method: Method, comm: MPI.Comm, record: Record) -> None:
    """Fill the record of a cell."""
    newton = {"newton": fm.NewtonOptions(**method.newton)} if method.newton else {}
    try:
        posed = pose_problem(scene, comm, pair=method.pair, problem={**method.problem, **newton})
    except fm.MortarError as error:
        record.state = "n/a" if "condensed" in str(error) else "failed"
        record.reason = f"set-up: {error}"
        return
    violations: list[str] = []

    def look(moment: float, report: NewtonReport) -> None:
        record.iterations.append(report.num_iterations)
        if not violations:
            found = posed.problem.certificate().violations()
            violations.extend(f"at time {moment:.3g}: {v}" for v in found)

    try:
        if method.adaptive:
            _adaptive(posed, method, look, record)
        else:
            _fixed(posed, look, record)
    except (fm.MortarError, GivenUpError) as error:
        record.reason = str(error)
        if getattr(getattr(error, "report", None), "dead_end", ""):  # no equilibrium
            record.state = "dead end"
        elif "wrong state" in record.reason:  # reported by the driver, which rejects the state
            record.state = "wrong"
    else:
        wrong = scene.check(posed)
        violations += [wrong] if wrong else []
        record.state = "wrong" if violations else "cut" if record.cuts else "converged"
        record.reason = "; ".join(violations[:2])
        record.numbers = _numbers(posed)


def _adaptive(
    posed: Posed, method: Method, look: Callable[[float, Any], None], record: Record
) -> None:
    """``follow_path`` with its defaults; the first step is that of the problem."""
    step = 1.0 / posed.scene.steps
    options, set_loads = fm.SteppingOptions(step), posed.set_loads
    if method.smallest is not None:
        options, set_loads = replace(options, smallest=method.smallest * step), _count(posed)
    try:
        path = fm.follow_path(posed.problem, set_loads, options, on_step=look)
    except fm.NotConvergedError as failure:
        path = failure.report
        raise
    finally:
        if "path" in locals():
            record.cuts = path.num_cuts
            record.lost = path.num_iterations - sum(record.iterations)


def _count(posed: Posed) -> Callable[[float], None]:
    """``set_loads`` that raises an error if too many systems have been solved."""
    solved, most = 0, MOST_SYSTEMS[0] + MOST_SYSTEMS[1] * posed.scene.steps
    solve = posed.problem.solve

    def counting_solve(**options: bool) -> NewtonReport:
        nonlocal solved
        try:
            report = solve(**options)
        except fm.NotConvergedError as failure:
            solved += failure.report.num_iterations
            raise
        solved += report.num_iterations
        return report

    def set_loads(moment: float) -> None:
        if solved > most:
            raise GivenUpError(f"given up at {moment:.3g} after {solved} linear systems")
        posed.set_loads(moment)

    posed.problem.solve = counting_solve  # type: ignore[method-assign]
    return set_loads


def _fixed(posed: Posed, look: Callable[[float, Any], None], record: Record) -> None:
    """The problem's steps, one solve each."""
    for step in range(1, posed.scene.steps + 1):
        posed.set_loads(step / posed.scene.steps)
        try:
            report = posed.problem.solve(accept_violations=True)  # ``look`` records violations
        except fm.NotConvergedError as failure:
            record.cuts, record.lost = 1, failure.report.num_iterations
            raise fm.MortarError(f"step {step} of {posed.scene.steps}: {failure}") from failure
        look(step / posed.scene.steps, report)


def _numbers(posed: Posed) -> list[float]:
    """Forces of all pairs and the norm of all displacements."""
    bulk = posed.problem.equations.bulk
    mine = bulk.u.x.array[: bulk.num_owned]
    norm = np.sqrt(bulk.comm.allreduce(float(mine @ mine)))
    return [*map(float, posed.forces.ravel()), float(norm)]


def main() -> None:
    """Process tasks until there are no more."""
    comm = MPI.COMM_WORLD
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of libraries must not mix with the results
    while True:
        line = comm.bcast(sys.stdin.readline() if comm.rank == 0 else None)
        if not line.strip():
            return
        task = json.loads(line)
        method = ALL_METHODS[task["method"]]
        record = run_cell(scene_of(task["scene"], task["value"]), method, comm)
        gc.collect()
        comm.barrier()
        if comm.rank == 0:
            answers.write(json.dumps(asdict(record)) + "\n")
            answers.flush()


if __name__ == "__main__":
    main()
