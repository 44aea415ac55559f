# SPDX-License-Identifier: MIT
"""The ladder of models: true error, estimate and cost of every rung, scene by scene.

    python3 demos/ladder/chart.py

writes ``results/ladder/ladder.md`` and ``ladder.png``; a few minutes, in serial. The true error is
the difference from the full model on the same mesh, on the soft body alone where the tool is rigid.
Seconds are those of the processor, so that other work on the machine does not count.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scenes_ladder import FULL, RUNGS, SCENES, Posed, Rung, Scene, pose, read
from scipy.spatial import cKDTree

import fenics_mortar as fm
from fenics_mortar.adequacy import ENERGY, FORCE, QUANTITIES, Snapshot, differences

TOLERANCE = 0.02
# Below this part true errors are those of Newton's tolerance.
SEEN = 1e-7
SCENE_COLOURS = dict(zip((s.name for s in SCENES), ("#c8102e", "#1f5fa8", "#2a8a3e", "#b07a00")))
MARKERS = dict(zip((r.name for r in RUNGS), "Ds^vo*"))


@dataclass
class Row:
    """One rung at one load of a scene; ``reason`` says why there is no solution."""

    scene: str
    load: float
    rung: str
    dofs: int
    seconds: float = np.nan
    iterations: int = 0
    check: float = np.nan
    true: dict[str, float] | None = None
    estimate: dict[str, float] | None = None
    reason: str = ""

    @property
    def factor(self) -> float:
        """Largest factor between estimate and truth, of energy and force."""
        if self.true is None or self.estimate is None:
            return np.nan
        seen = [name for name in (ENERGY, FORCE) if self.true[name] > SEEN]
        ratios = [self.estimate[name] / self.true[name] for name in seen]
        return max((max(r, 1 / r) if r > 0 else np.inf for r in ratios), default=np.nan)


def follow(scene: Scene, posed: Posed, row: Row) -> bool:
    """Take all steps; whether they were taken."""
    start = time.process_time()
    try:
        for t in np.arange(1, scene.steps + 1) / scene.steps:
            posed.set_time(t)
            row.iterations += posed.problem.solve().num_iterations
    except fm.MortarError as error:
        row.reason = str(error)
        return False
    row.seconds = time.process_time() - start
    return True


def true_errors(posed: Posed, full: Posed) -> dict[str, float]:
    """Differences from the full model at the nodes of the cheap one."""
    both = [p.problem.bulk for p in (posed, full)]
    mine, theirs = (bulk.V.tabulate_dof_coordinates() for bulk in both)
    problem, reference = posed.problem, Snapshot.of(full.problem)
    # the two sides of an interface may share places: of equal meshes nodes go by their number
    place = np.arange(len(mine))
    if len(mine) != len(theirs):
        soft = full.problem.floating.labels == full.problem.floating.labels[soft_node(full)]
        place = np.flatnonzero(soft)[cKDTree(theirs[soft]).query(mine)[1]]
    reference.u = reference.u.reshape(-1, 2)[place].ravel()
    return differences(problem, Snapshot.of(problem), reference)


def soft_node(posed: Posed) -> int:
    """A node of the soft body."""
    return int(posed.problem.contacts[0].slave.nodes[0])


def estimated_errors(scene: Scene, rung: Rung, posed: Posed) -> dict[str, float]:
    """What ``AdequacyCheck`` says of all assumptions together."""
    finite = posed.finite if rung.strain == "linear" else None
    check = fm.AdequacyCheck(finite_strain=finite, stiffness_ratio=1.0 / scene.ratio)
    assumptions = check.assess(posed.problem).assumptions
    return assumptions[-1].errors if assumptions else dict.fromkeys(QUANTITIES, 0.0)


def measure(scene: Scene, load: float) -> Iterator[Row]:
    """All rungs of a scene at a load."""
    meshes = {rigid: read(scene, load, rigid) for rigid in (False, True)}
    solved: dict[str, tuple[Posed, Row]] = {}
    for rung in (FULL, *(rung for rung in RUNGS if rung != FULL)):
        posed = pose(scene, load, rung, meshes[rung.rigid])
        row = Row(scene.name, load, rung.name, posed.problem.bulk.r.getSize())
        if follow(scene, posed, row):
            solved[rung.name] = posed, row
            row.true = true_errors(posed, solved[FULL.name][0]) if FULL.name in solved else None
            start = time.process_time()
            row.estimate = estimated_errors(scene, rung, posed)
            row.check = time.process_time() - start
        yield row


def percent(value: float) -> str:
    return "0" if value < SEEN else f"{100 * value:.2g}"


def table(rows: list[Row]) -> str:
    """Markdown: errors and estimates in percent, verdict, cost."""
    lines = [
        "| scene | load | rung | energy norm: true | estimate | force: true | estimate | "
        "peak: true | estimate | verdict | right | dofs | s | check s | iterations |",
        "|---|---:|---|" + "---:|" * 6 + "---|---|" + "---:|" * 4,
    ]
    for row in rows:
        start = f"| {row.scene} | {row.load:g} | {row.rung} |"
        if row.true is None or row.estimate is None:
            lines.append(f"{start} {row.reason[:60]} |" + " |" * 11)
            continue
        pairs = [percent(kind[name]) for name in QUANTITIES for kind in (row.true, row.estimate)]
        said, is_so = (kind[ENERGY] <= TOLERANCE for kind in (row.estimate, row.true))
        cells = [*pairs, "enough" if said else "not enough", "yes" if said == is_so else "NO"]
        cells += [str(row.dofs), f"{row.seconds:.2f}", f"{row.check:.2f}", str(row.iterations)]
        lines.append(f"{start} {' | '.join(cells)} |")
    return "\n".join(lines) + "\n\n" + summary(rows)


def summary(rows: list[Row]) -> str:
    """How many estimates are within a factor of three, by rung."""
    lines = ["| rung | cases | estimates within a factor 3 | largest factor | verdicts right |"]
    lines.append("|---|---:|---:|---:|---:|")
    for rung in RUNGS:
        mine = [r for r in rows if r.rung == rung.name and np.isfinite(r.factor)]
        if mine:
            factors = np.array([r.factor for r in mine])
            right = sum(
                (r.true[ENERGY] <= TOLERANCE) == (r.estimate[ENERGY] <= TOLERANCE) for r in mine
            )
            cells = [rung.name, str(len(mine)), str((factors <= 3).sum())]
            lines.append("| " + " | ".join([*cells, f"{factors.max():.1f}", str(right)]) + " |")
    return "\n".join(lines) + "\n"


def draw(rows: list[Row]) -> Figure:
    """Estimates over true errors; true errors over cost."""
    figure = Figure((11, 5), layout="constrained")
    left, right = figure.subplots(1, 2)
    ends = np.array([1e-5, 300.0])
    left.fill_between(ends, ends / 3, ends * 3, color="#e8e8e8", lw=0)
    left.loglog(ends, ends, color="#888888", lw=0.8)
    cost = {(r.scene, r.load): r.seconds for r in rows if r.rung == FULL.name}
    for row in rows:
        if row.true is None or row.estimate is None:
            continue
        style = {"color": SCENE_COLOURS[row.scene], "marker": MARKERS[row.rung], "ls": ""}
        for name, fill in ((ENERGY, "full"), (FORCE, "none")):
            if row.true[name] > SEEN:
                left.plot(row.true[name], row.estimate[name], fillstyle=fill, ms=5, **style)
        error = max(row.true[ENERGY], 1e-6)
        right.loglog(row.seconds / cost[row.scene, row.load], error, ms=6, **style)
    for rung, marker in MARKERS.items():
        right.plot([], [], marker=marker, color="#555555", ls="", label=rung)
    for scene, colour in SCENE_COLOURS.items():
        left.plot([], [], marker="o", color=colour, ls="", label=scene)
    right.axhline(TOLERANCE, color="#888888", lw=0.8, ls="--")
    left.set(xlabel="true error", ylabel="estimated error", xlim=ends, ylim=ends)
    left.set_title("filled: energy norm, open: total force; grey: a factor of 3", fontsize=10)
    right.set(xlabel="seconds over those of the full model", ylabel="true error, energy norm")
    right.set_title("errors of 0 are drawn at 1e-6", fontsize=10)
    for axes in (left, right):
        axes.legend(frameon=False, fontsize=8)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", help="only this one")
    options = parser.parse_args()
    rows = []
    for scene in SCENES:
        for load in scene.loads if options.scene in (None, scene.name) else ():
            for row in measure(scene, load):
                rows.append(row)
                print(f"{row.scene} {row.load:g} {row.rung}: {row.seconds:.1f} s {row.reason}")
    folder = Path("results/ladder")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ladder.md").write_text(table(rows))
    draw(rows).savefig(folder / "ladder.png", dpi=130)
    print(table(rows))


if __name__ == "__main__":
    main()
