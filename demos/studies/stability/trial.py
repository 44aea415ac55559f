# SPDX-License-Identifier: MIT
"""Random problems: many of them, each solved along its load path with defaults, and checked.

    python3 -m demos.studies.stability.trial --cases 500    a line of JSON per case, a summary
    python3 -m demos.studies.stability.trial --case 17      one case, its report and picture
    python3 -m demos.studies.stability.trial --family supported  bodies supported by friction alone

The families are blocks pushed or pressed, with defaults ("pushed"), bodies supported by friction
("supported") or adhesion ("hanging"), those of ``random_shapes``: surfaces of one body ("own"),
thin bodies ("thin"), users' laws ("laws"), exchanged roles ("roles"), and those of
``random_physics``: bodies of revolution ("revolved"), impacts ("moving"), laws with memory
("memory"), self-contact ("itself"), obstacles that turn far ("turning"), wheels and shafts with
friction ("spinning"), bodies without load ("idle"), cracks ("cracks"), and those in space:
blocks without supports ("towers"), blocks pulled with friction ("patches"), thin plates ("plates")
and rough obstacles ("tools").

The outcome of a case is one of

- converged: the path was followed to its end, and no measured quantity is wrong there,
- failed: the package raised one of its errors,
- wrong: it converged to a state that is not a solution,
- dead end: it failed where the rigid bodies move by limit analysis,
- crash: any other error, or the process died,
- hang: the time limit was exceeded.

Some cases are solved again, with half the step size and with exchanged roles: two different
solutions of one case are wrong, too.
"""

from __future__ import annotations

import argparse
import json
import logging
import multiprocessing
import signal
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

import fenics_mortar as fm
from demos.studies.stability.case import Case
from demos.studies.stability.random_cases import random_case
from demos.studies.stability.random_physics import DRAWS, run_physics
from demos.studies.stability.random_shapes import shape_case
from demos.studies.stability.random_supported import hanging_case, supported_case
from demos.studies.stability.trial_judge import Record, check_again, errors, measure, run
from demos.studies.stability.trial_scene import build

# Seeds of the families: the first from zero on, the next ones from one million on, and so on.
FAMILIES = ("pushed", "supported", "hanging", "own", "thin", "laws", "roles", *DRAWS)
SEEDS_OF_FAMILY = 1_000_000
# Every n-th case is solved a second time.
EVERY = 4
# Limit of CPU seconds; a case takes one second, with its checks at most about twenty.
LIMIT = 100.0
# Limit of wall time over that of CPU time [1]: other programs run as well.
PATIENCE = 10.0


# Many cases


def case_of(seed: int) -> Case:
    """The case of a seed."""
    family, number = family_of(seed), seed % SEEDS_OF_FAMILY
    if family == "pushed":
        return random_case(number)
    if family == "supported":
        return replace(supported_case(number), seed=seed)
    if family == "hanging":
        return replace(hanging_case(number), seed=seed)
    return replace(shape_case(family, number), seed=seed)


def family_of(seed: int) -> str:
    """The family of a seed."""
    return FAMILIES[seed // SEEDS_OF_FAMILY]


def run_seed(seed: int) -> Record:
    """Run one case, and some of the cases again."""
    family = family_of(seed)
    if family in DRAWS:
        return run_physics(family, seed % SEEDS_OF_FAMILY) | {"seed": seed, "family": family}
    case = case_of(seed)
    record, _ = run(case)
    again = seed % EVERY == 0 or family_of(seed) == "roles"
    if record["outcome"] == "converged" and again:
        check_again(case, record)
    record.pop("objections", None)
    record["family"] = family_of(seed)
    return record


def _serve(connection: Any) -> None:
    """Run incoming seeds; the process ends if a case exceeds its limit of CPU time."""
    while True:
        seed, limit = connection.recv()
        signal.setitimer(signal.ITIMER_PROF, limit)
        record = run_seed(seed)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        connection.send(record)


class Worker:
    """A process that runs cases; it is replaced if it dies or does not respond."""

    def __init__(self) -> None:
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def run(self, seed: int, limit: float) -> Record:
        """Outcome of one case."""
        begin = time.perf_counter()
        try:
            if not self._process.is_alive():  # PETSc aborts a process that writes to a dead one
                raise EOFError
            self._connection.send((seed, limit))
            if self._connection.poll(PATIENCE * limit):
                return self._connection.recv()
            outcome, reason = "hang", f"no answer in {PATIENCE * limit:g} s"
        except EOFError:
            self._process.join()
            outcome, reason = "crash", f"the process died with code {self._process.exitcode}"
            if self._process.exitcode == -signal.SIGPROF:
                outcome, reason = "hang", f"no answer in {limit:g} s of computing"
        self.stop()
        self._start()
        seconds = time.perf_counter() - begin
        family = family_of(seed)
        return {
            "seed": seed, "family": family, "outcome": outcome, "reason": reason,
            "seconds": seconds,
        }  # fmt: skip

    def stop(self) -> None:
        """Terminate the process."""
        self._process.kill()
        self._process.join()


def run_many(seeds: range, path: Path, workers: int, limit: float) -> list[Record]:
    """Run cases in separate processes; write a line of JSON for each to ``path``."""
    pending, records = iter(seeds), []
    with path.open("w") as lines:

        def work() -> None:
            worker = Worker()
            for seed in pending:
                record = worker.run(seed, limit)
                records.append(record)
                lines.write(json.dumps(record) + "\n")
                lines.flush()
            worker.stop()

        with ThreadPoolExecutor(workers) as pool:
            for future in [pool.submit(work) for _ in range(workers)]:
                future.result()
    return sorted(records, key=lambda record: record["seed"])


def summary(records: list[Record]) -> str:
    """Counts, bad cases, and iterations, in Markdown."""
    lines = _counts(records)
    good = [record for record in records if record["outcome"] == "converged"]
    if good:
        per_step = np.concatenate([record["per_step"] for record in good])
        lines.append(
            f"Iterations per step: median {np.median(per_step):.0f}, 90 % at most "
            f"{np.percentile(per_step, 90):.0f}, largest {per_step.max()}; "
            f"{sum(record['cuts'] > 0 for record in good)} cases with cut steps, "
            f"{sum(record['cuts'] for record in good)} cuts in "
            f"{sum(record['steps'] for record in good)} steps."
        )
        for name in ("half the steps", "exchanged roles"):
            of = [(r[f"{name}: difference"], r["seed"]) for r in good if f"{name}: difference" in r]
            failed = [r["seed"] for r in records if r.get(name) == "failed"]
            largest = ", ".join(f"{value:.1e} (seed {seed})" for value, seed in sorted(of)[:-4:-1])
            lines += (
                [
                    f"Again with {name}: {len(of)} cases, response differs by a median of "
                    f"{np.median([value for value, _ in of]):.1e}, at most by {largest}; failed: "
                    f"{failed or 'none'}."
                ]
                if of
                else []
            )
        with_remarks = [record["seed"] for record in good if record.get("remarks")]
        lines.append(
            f"The certificate reports a coarse mesh in the cases {with_remarks or 'none'}."
        )
    bad = [record for record in records if record["outcome"] not in ("converged", "dead end")]
    if bad:
        lines += ["", "| seed | outcome | problem | reason |", "|---:|---|---|---|"]
    for record in bad:
        cells = [record["seed"], record["outcome"], record.get("scene", ""), record["reason"]]
        lines.append("| " + " | ".join(str(cell).replace("\n", " ") for cell in cells) + " |")
    return "\n".join(lines)


def _counts(records: list[Record]) -> list[str]:
    """Outcomes of each family, and of all if there are several, as lines of a table."""
    families: dict[str, list[Record]] = {}
    for record in records:
        families.setdefault(record.get("family", ""), []).append(record)
    if len(families) > 1:
        families["all"] = records
    kinds = ["converged", "failed", "wrong", "crash", "hang"]
    if any(record["outcome"] == "dead end" for record in records):
        kinds.insert(1, "dead end")
    lines = ["| family | cases | " + " | ".join(kinds) + " |"]
    lines.append("|---|---:|" + "---:|" * len(kinds))
    for family, some in families.items():
        outcomes = Counter(record["outcome"] for record in some)
        cells = [family, len(some), *(outcomes[kind] for kind in kinds)]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return [*lines, ""]


# One case in full


def show(seed: int, folder: Path) -> None:
    """Run one case; print its full record, and draw its final state."""
    logging.basicConfig(format="%(message)s")
    logging.getLogger("fenics_mortar").setLevel(logging.INFO)
    if family_of(seed) in DRAWS:
        for name, value in run_seed(seed).items():
            print(f"{name}: {value}")
        return
    case = case_of(seed)
    for name, value in case.about.items():
        print(f"{name}: {value}")
    begin = time.perf_counter()
    scene = build(case, MPI.COMM_SELF)
    problem, options = scene.problem, fm.SteppingOptions(step=case.step, smallest=case.smallest)
    try:
        path = fm.follow_path(problem, scene.set_loads, options, stop=case.stop)
        print(path.table())
    except fm.NotConvergedError as error:
        print(f"\n{error}\n")
        print(error.report.table())
        if error.report.failures:
            print(error.report.failures[0].table())
            print(error.report.failures[-1].table())
    print(f"{time.perf_counter() - begin:.1f} s")
    measured = measure(scene)
    for name, value in measured.items():
        print(f"{name}: {value}")
    print("wrong:", list(errors(scene, measured)) or "nothing")
    print(problem.certificate())
    fm.plot(problem, folder / f"case_{seed}", title=f"case {seed}")
    print(f"picture: {folder / f'case_{seed}.png'}")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=500, help="how many cases")
    parser.add_argument("--seed", type=int, default=1, help="the first seed")
    parser.add_argument("--case", type=int, help="run this seed alone and show it")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--limit", type=float, default=LIMIT, help="CPU seconds for a case")
    parser.add_argument("--folder", type=Path, default=Path("results"), help="where to write")
    parser.add_argument("--family", choices=FAMILIES, default="pushed", help="which problems")
    same = "the same as --family supported"
    parser.add_argument(
        "--supported", action="store_const", const="supported", dest="family", help=same
    )
    chosen = parser.parse_args()
    first = SEEDS_OF_FAMILY * FAMILIES.index(chosen.family)
    chosen.seed += first
    chosen.case = chosen.case and chosen.case + first
    chosen.folder.mkdir(parents=True, exist_ok=True)
    if chosen.case is not None:
        show(chosen.case, chosen.folder)
        return
    seeds = range(chosen.seed, chosen.seed + chosen.cases)
    path = chosen.folder / f"trial_{chosen.family}.jsonl"
    print(summary(run_many(seeds, path, chosen.workers, chosen.limit)))
    print(f"\nA line of JSON per case: {path}")


if __name__ == "__main__":
    main()
