# SPDX-License-Identifier: MIT
"""Stability study: every problem by every method; a heat map, a table, a chart.

    python3 -m demos.studies.stability.atlas                    all: 15 minutes on two cores
    python3 -m demos.studies.stability.atlas --problems 'c*,roll' --methods default,frozen
    python3 -m demos.studies.stability.atlas --draw             from stored results

Cells are stored in ``results/stability/cells.jsonl`` when they finish; stored cells are not run
again unless ``--again`` is given. Batches of ``--problems`` may be run one after the other, or into
several folders (``--results``) whose ``cells.jsonl`` are concatenated for ``--draw``; of duplicate
cells the last record is used. Each worker is a separate process: a cell that hangs or crashes is
recorded as failed, and a new worker is started for the next cell.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from demos.studies.processes import mpirun, outer_environment

ROOT = Path(__file__).resolve().parents[3]
SECONDS = 120.0
# Largest relative difference of forces and displacements on several ranks and on one [1].
SAME = 1e-8

Task = dict[str, Any]


class Worker:
    """A process that computes cells; see ``cell``.

    Args:
        ranks: Number of MPI ranks.
        command: The program; for tests.
    """

    def __init__(self, ranks: int = 1, command: Sequence[str] | None = None) -> None:
        command = command or (sys.executable, "-m", "demos.studies.stability.cell")
        paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._errors = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            [*mpirun(ranks), *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=outer_environment() | {"PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,
        )
        self._buffer = b""

    @property
    def alive(self) -> bool:
        """Whether the process is alive."""
        return self._process.poll() is None

    def run(self, task: Task, seconds: float) -> Task:
        """The record of a cell; "failed" if the worker crashes or takes too long."""
        if not self.alive:  # writing to it would raise a signal that PETSc reports as an error
            return failed(f"no worker, exit code {self._process.returncode}: {self._last()}", 0.0)
        try:
            self._process.stdin.write(json.dumps(task).encode() + b"\n")
            self._process.stdin.flush()
            line = self._read_line(seconds)
        except BrokenPipeError:
            line = b""
        except TimeoutError:
            self.stop()
            return failed(f"time limit of {seconds:g} s", seconds)
        if not line:
            self.stop()
            return failed(f"crash, exit code {self._process.returncode}: {self._last()}", 0.0)
        return json.loads(line)

    def _read_line(self, seconds: float) -> bytes:
        """One line of the output, empty at its end."""
        end, pipe = time.monotonic() + seconds, self._process.stdout.fileno()
        while b"\n" not in self._buffer:
            left = end - time.monotonic()
            if left <= 0.0 or not select.select([pipe], [], [], left)[0]:
                raise TimeoutError
            branch = os.read(pipe, 65536)
            if not branch:
                return b""
            self._buffer += branch
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line

    def _last(self) -> str:
        """The last line that the process wrote to its standard error."""
        self._errors.seek(0)
        return (self._errors.read().decode(errors="replace").strip().splitlines() or [""])[-1]

    def stop(self) -> None:
        """Terminate the process and its child processes."""
        if self.alive:
            try:
                self._process.stdin.close()
                self._process.wait(2.0)
            except (OSError, subprocess.TimeoutExpired):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


def failed(reason: str, seconds: float) -> Task:
    """The record of a cell whose worker did not answer."""
    return {
        "state": "failed",
        "reason": reason,
        "iterations": [],
        "cuts": 0,
        "lost": 0,
        "seconds": seconds,
        "numbers": [],
    }


def run_all(
    tasks: Iterable[Task],
    keep: Callable[[Task, Task], None],
    *,
    workers: int = 2,
    seconds: float = SECONDS,
) -> None:
    """Run cells in parallel; ``keep(task, record)`` is called for one cell at a time."""
    waiting: queue.SimpleQueue[Task] = queue.SimpleQueue()
    for task in tasks:
        waiting.put(task)
    lock = threading.Lock()

    def work() -> None:
        worker, ranks = None, 0
        while True:
            try:
                task = waiting.get_nowait()
            except queue.Empty:
                break
            if worker is None or not worker.alive or ranks != task["ranks"]:
                if worker is not None:
                    worker.stop()
                ranks = task["ranks"]
                worker = Worker(ranks)
            record = worker.run(task, seconds)
            with lock:
                keep(task, record)
        if worker is not None:
            worker.stop()

    threads = [threading.Thread(target=work) for _ in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def all_tasks(scenes: str = "*", methods: str = "*") -> list[Task]:
    """The cells whose names match one of several patterns, separated by commas."""
    from demos.studies.stability.families import FAMILIES
    from demos.studies.stability.methods import METHODS, REMEDIES

    def chosen(name: str, patterns: str) -> bool:
        return any(fnmatch(name, pattern) for pattern in patterns.split(","))

    cells = [
        (family.name, str(value), method)
        for family in FAMILIES.values()
        for value in family.values
        for method in family.methods or METHODS
        if chosen(family.name, METHODS[method].scenes)
    ]
    cells += [(remedy.scene, remedy.value, name) for name, remedy in REMEDIES.items()]
    return [
        {"scene": s, "value": v, "method": m, "ranks": int(v) if s == "ranks" else 1}
        for s, v, m in cells
        if chosen(s, scenes) and chosen(m, methods)
    ]


def key_of(task: Task) -> tuple[str, str, str]:
    """Problem, value and method of a cell."""
    return task["scene"], task["value"], task["method"]


def read_cells(path: Path) -> dict[tuple[str, str, str], Task]:
    """The cells of a file, the last record of each."""
    if not path.exists():
        return {}
    return {key_of(cell): cell for cell in map(json.loads, path.read_text().splitlines())}


def compare_ranks(cells: dict[tuple[str, str, str], Task]) -> None:
    """Mark results on several ranks that differ from those on one rank as wrong."""
    for cell in (c for c in cells.values() if c["scene"] == "ranks"):
        alone = cells.get(("ranks", "1", cell["method"]))
        if alone is None or not cell["numbers"] or not alone["numbers"]:
            continue
        scale = max(map(abs, alone["numbers"]))
        off = max(abs(a - b) for a, b in zip(cell["numbers"], alone["numbers"])) / scale
        if cell["iterations"] != alone["iterations"] or off > SAME:
            cell["state"] = "wrong"
            cell["reason"] = f"not as on one rank: iterations {cell['iterations']}, off {off:.1e}"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    patterns = "patterns, separated by commas"
    parser.add_argument("--problems", dest="scenes", default="*", help=patterns)
    parser.add_argument("--methods", default="*", help=patterns)
    parser.add_argument("--again", action="store_true", help="run cells that are there too")
    parser.add_argument("--draw", action="store_true", help="run nothing")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--results", type=Path, default=Path("results/stability"))
    chosen = parser.parse_args()
    chosen.results.mkdir(parents=True, exist_ok=True)
    path = chosen.results / "cells.jsonl"
    done = {} if chosen.again else read_cells(path)
    tasks = all_tasks(chosen.scenes, chosen.methods)
    todo = [] if chosen.draw else [t for t in tasks if key_of(t) not in done]
    # cells on several ranks last: they would disturb the others
    todo.sort(key=lambda task: task["ranks"])
    begin, count = time.monotonic(), 0
    with path.open("a") as file:

        def keep(task: Task, record: Task) -> None:
            nonlocal count
            count += 1
            file.write(json.dumps({**task, **record}) + "\n")
            file.flush()
            print(
                f"{count}/{len(todo)} {' '.join(key_of(task))}: {record['state']} "
                f"{record['iterations']} {record['reason'][:90]}",
                flush=True,
            )

        run_all([t for t in todo if t["ranks"] == 1], keep, workers=chosen.workers)
        run_all([t for t in todo if t["ranks"] > 1], keep, workers=1)
    print(f"{count} cells in {time.monotonic() - begin:.0f} s")
    kept = read_cells(path)
    cells = {key_of(task): kept[key_of(task)] for task in all_tasks() if key_of(task) in kept}
    compare_ranks(cells)
    from demos.studies.stability.picture import draw_all

    draw_all(cells, chosen.results)


if __name__ == "__main__":
    main()
