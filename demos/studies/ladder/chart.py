# SPDX-License-Identifier: MIT
"""The ladder of models: true error, estimate and cost of every rung and of the automatic climb.

    python3 -m demos.studies.ladder.chart

writes ``results/ladder/ladder.md`` and ``ladder.png``; a few minutes, in serial. What it measures
is kept beside them: ``--scene NAME`` measures one scene anew and draws all, ``--redraw`` none.

The true error is the difference from the full model on the same mesh, on the soft body alone where
the tool is rigid: then a part of it is that the meshed tool has facets in place of a curve, and the
estimate counts that in. The error of that mesh stands beside it: of the norm of energy as
``problem.estimate()`` says, of forces and pressures the difference from the full model on a mesh of
half the size. Seconds are those of the processor, so that other work on the machine does not count.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

import fenics_mortar as fm
from demos.studies.ladder.scenes import (
    FULL,
    RUNGS,
    SCENES,
    TOLERANCE,
    Posed,
    Rung,
    Scene,
    elastic_tool,
    pose,
    read,
)
from fenics_mortar.models.indicators import contacts_of
from fenics_mortar.models.model_error import (
    ENERGY,
    FORCE,
    PEAK,
    QUANTITIES,
    Snapshot,
    differences,
    estimate_wider,
)

Errors = dict[str, float]
Solved = tuple[Posed, "Row"]
# Runs of a climb and of the full model in turns, and what is taken of them.
REPEATS, TIMES = 3, ("setup", "seconds")
# Below this part true errors are those of Newton's tolerance.
SEEN = 1e-7
NOTHING = dict.fromkeys(QUANTITIES, np.nan)
SCENE_COLOURS = dict(zip((s.name for s in SCENES), ("#c8102e", "#1f5fa8", "#2a8a3e", "#b07a00")))
MARKERS = dict(zip((r.name for r in RUNGS), "Ds^vo*PX"))
CLIMB = RUNGS[-1].name
# What the climb calls its rungs, and what this chart does.
ENDED = {
    "linear strain and small sliding": "linear bulk, small sliding",
    "linear strain": "linear bulk",
    "small sliding": "small sliding",
}


@dataclass
class Row:
    """One rung at one load of a scene.

    Attributes:
        scene, load, rung: Which.
        dofs: Unknowns of the bodies.
        setup, seconds, check: Seconds to set the problem up, to solve it, to estimate its error;
            climbs and what friction could do are checked in each step, as a part of its solution.
        against: Seconds to solve the full model.
        iterations: Of all steps; of a climb those on the rungs where steps ended.
        true, estimate: Errors by quantity.
        mesh: Those that the mesh leaves.
        ended: On which rung a climb ended.
        reason: Why there is no solution.
    """

    scene: str
    load: float
    rung: str
    dofs: int
    setup: float = np.nan
    seconds: float = np.nan
    check: float = np.nan
    against: float = np.nan
    iterations: int = 0
    true: Errors = field(default_factory=NOTHING.copy)
    estimate: Errors = field(default_factory=NOTHING.copy)
    mesh: Errors = field(default_factory=NOTHING.copy)
    ended: str = ""
    reason: str = ""

    def factor(self, name: str) -> float:
        """Factor between estimate and truth; nan if there is no error."""
        true, estimate = self.true[name], self.estimate[name]
        if not true > SEEN:
            return np.nan
        return max(true / estimate, estimate / true) if estimate > 0.0 else np.inf

    def is_hidden(self, name: str) -> bool:
        """Whether truth and estimate differ by less than the error of the mesh."""
        return abs(self.true[name] - self.estimate[name]) <= self.mesh[name]

    @property
    def verdict(self) -> tuple[bool, bool]:
        """Whether the estimate says that the rung is enough, and whether it is."""
        return self.estimate[ENERGY] <= TOLERANCE, self.true[ENERGY] <= TOLERANCE

    @property
    def name(self) -> str:
        """The rung, and where a climb ended."""
        return f"{self.rung}, ended on {self.ended}" if self.ended else self.rung


def clocked(do: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """What a function returns, and the seconds it takes."""
    start = time.process_time()
    return do(*arguments), time.process_time() - start


def follow(scene: Scene, posed: Posed, row: Row) -> bool:
    """Take all steps; whether they were taken."""
    start = time.process_time()
    try:
        for t in np.arange(1, scene.steps + 1) / scene.steps:
            posed.set_time(t)
            report = posed.problem.solve(accept_violations=True)  # also of poor models
            row.iterations += report.num_iterations
    except fm.MortarError as error:
        row.reason = str(error)
        return False
    row.seconds = time.process_time() - start
    if report.adequacy is not None:
        found = report.adequacy.assumptions
        if row.rung == CLIMB:
            row.ended = ENDED[found[-1].name] if found else FULL.name
        row.estimate = found[-1].errors if found else dict.fromkeys(QUANTITIES, 0.0)
    return True


def true_errors(posed: Posed, full: Posed) -> Errors:
    """Differences from the full model at the nodes of the cheap one."""
    both = [p.problem.equations.bulk for p in (posed, full)]
    mine, theirs = (bulk.V.tabulate_dof_coordinates() for bulk in both)
    problem, reference = posed.problem, Snapshot.of(full.problem)
    # the two sides of an interface may share places: of equal meshes nodes go by their number
    place = np.arange(len(mine))
    if len(mine) != len(theirs):
        soft = (
            full.problem.equations.floating.labels
            == full.problem.equations.floating.labels[soft_node(full)]
        )
        place = np.flatnonzero(soft)[cKDTree(theirs[soft]).query(mine)[1]]
    reference.u = reference.u.reshape(-1, 2)[place].ravel()
    return differences(problem, Snapshot.of(problem), reference)


def soft_node(posed: Posed) -> int:
    """A node of the soft body."""
    return int(posed.problem.equations.contacts[0].slave.nodes[0])


def mesh_errors(scene: Scene, load: float, full: Posed) -> Errors:
    """What the mesh of the full model leaves."""
    finer = pose(scene, load, FULL, read(scene, load, finer=2))
    coarse = full.problem.estimate().relative
    if not follow(scene, finer, Row(scene.name, load, "mesh", 0)):
        return NOTHING | {ENERGY: coarse}
    here, there = (Snapshot.of(posed.problem) for posed in (full, finer))
    force = np.linalg.norm(here.force - there.force) / np.linalg.norm(there.force)
    peak = np.abs(here.peak - there.peak).max() / there.peak.max()
    return {ENERGY: coarse, FORCE: float(force), PEAK: float(peak)}


def estimated_errors(scene: Scene, load: float, rung: Rung, posed: Posed) -> Errors:
    """What ``AdequacyCheck`` says of all assumptions together."""
    if rung.rigid:
        return by_meshed_tool(scene, load, posed)
    finite = posed.finite if rung.strain == "linear" else None
    assumptions = fm.AdequacyCheck(finite_strain=finite).assess(posed.problem).assumptions
    return assumptions[-1].errors if assumptions else dict.fromkeys(QUANTITIES, 0.0)


def by_meshed_tool(scene: Scene, load: float, posed: Posed) -> Errors:
    """What it is worth that a circle neither gives way nor has the facets of a mesh."""
    (circle,) = posed.problem.equations.motions.obstacles
    tool = elastic_tool(scene, circle, read(scene, load, "tool"))
    touching = contacts_of(posed.problem, tool)
    parts = zip(tool.displacements(touching), tool.flatness(touching), strict=True)
    return estimate_wider(posed.problem, touching, [a + b for a, b in parts])


def solved(scene: Scene, load: float, rung: Rung, data: Any, friction: float = 0.0) -> Solved:
    """A scene by a rung, and its row, without errors."""
    posed, setup = clocked(pose, scene, load, rung, data, friction)
    row = Row(scene.name, load, rung.name, posed.problem.equations.bulk.r.getSize(), setup)
    follow(scene, posed, row)
    return posed, row


def race(scene: Scene, load: float, rung: Rung, data: Any, row: Row) -> None:
    """Take the seconds of a rung and of the full model in turns: medians of a few runs each."""
    mine, theirs = zip(
        *[[solved(scene, load, r, data)[1] for r in (rung, FULL)] for _ in range(REPEATS)]
    )
    row.setup, row.seconds = (float(np.median([getattr(r, n) for r in mine])) for n in TIMES)
    row.against = float(np.median([r.seconds for r in theirs]))


def measure(scene: Scene, load: float) -> Iterator[Row]:
    """All rungs of a scene at a load."""
    meshes = {rigid: read(scene, load, "soft" if rigid else "soft tool") for rigid in (True, False)}
    full = solved(scene, load, FULL, meshes[False])
    mesh = mesh_errors(scene, load, full[0])
    for rung in (FULL, *(rung for rung in RUNGS if rung != FULL)):
        posed, row = full if rung == FULL else solved(scene, load, rung, meshes[rung.rigid])
        reference, straight = full
        if rung.leaves_out:
            reference, straight = solved(scene, load, FULL, meshes[False], rung.leaves_out)
        row.mesh, row.against, row.reason = mesh, straight.seconds, row.reason or straight.reason
        if rung.climbs:
            race(scene, load, rung, meshes[False], row)
        if not row.reason:
            row.true = true_errors(posed, reference)
            if not (rung.climbs or rung.leaves_out):
                row.estimate, row.check = clocked(estimated_errors, scene, load, rung, posed)
        yield row


def measure_all(scene: Scene) -> Iterator[Row]:
    """All rungs of a scene at all its loads, told of as they come."""
    for load in scene.loads:
        for row in measure(scene, load):
            print(f"{row.scene} {row.load:g} {row.name}: {row.seconds:.1f} s {row.reason}")
            yield row


def percent(value: float) -> str:
    """A part in percent."""
    return "" if np.isnan(value) else "0" if value < SEEN else f"{100 * value:.2g}"


def table(rows: list[Row]) -> str:
    """Markdown: errors and estimates in percent, verdict, cost."""
    lines = [
        "| scene | load | rung | energy norm: true | estimate | force: true | estimate | "
        "peak: true | estimate | verdict | right | dofs | set-up s | s | check s | iterations |",
        "|---|---:|---|" + "---:|" * 6 + "---|---|" + "---:|" * 5,
    ]
    for row in rows:
        start = f"| {row.scene} | {row.load:g} |"
        if row.reason:
            lines.append(f"{start} {row.name} | {row.reason[:60]} |" + " |" * 12)
            continue
        pairs = [percent(kind[name]) for name in QUANTITIES for kind in (row.true, row.estimate)]
        said, is_so = row.verdict
        cells = [*pairs, "enough" if said else "not enough", "yes" if said == is_so else "NO"]
        seconds = [f"{s:.2f}" for s in (row.setup, row.seconds)]
        check = "" if np.isnan(row.check) else f"{row.check:.2f}"
        cells += [str(row.dofs), *seconds, check, str(row.iterations)]
        lines.append(f"{start} {row.name} | {' | '.join(cells)} |")
        if row.rung == FULL.name:
            left = " | ".join(f"{percent(row.mesh[name])} |" for name in QUANTITIES)
            lines.append(f"{start} error of the mesh | {left} |" + " |" * 7)
    return "\n".join(lines) + "\n"


def summary(rows: list[Row]) -> str:
    """How many estimates are within a factor of three, by rung."""
    lines = [
        "| rung | cases | energy norm and force within a factor 3 | largest factor | "
        "peak pressure within a factor 3 | largest factor | "
        "others that are off by less than the error of the mesh | verdicts right |",
        "|---|" + "---:|" * 7,
    ]
    ratio = dict.fromkeys(QUANTITIES, 1.0 / SCENES[0].ratio)
    rigid = [r for r in rows if r.rung == RUNGS[0].name]
    by_rule = [
        replace(r, rung="rigid obstacle, by the ratio of moduli", estimate=ratio) for r in rigid
    ]
    everything = [*rows, *by_rule]
    for rung in dict.fromkeys(r.rung for r in everything):
        mine = [r for r in everything if r.rung == rung and not r.reason and r.true[ENERGY] > SEEN]
        if mine:
            cells = [rung, str(len(mine))]
            for names in ((ENERGY, FORCE), (PEAK,)):
                factors = [f for r in mine for n in names if np.isfinite(f := r.factor(n))]
                cells += [f"{sum(f <= 3 for f in factors)} of {len(factors)}"]
                cells += [f"{max(factors):.1f}"]
            out = [r.is_hidden(n) for r in mine for n in QUANTITIES if r.factor(n) > 3]
            cells += [f"{sum(out)} of {len(out)}" if out else ""]
            cells += [str(sum(said == is_so for said, is_so in (r.verdict for r in mine)))]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def climbs(rows: list[Row]) -> Iterator[tuple[Row, Row]]:
    """The climbs, each with the full model."""
    full = {(r.scene, r.load): r for r in rows if r.rung == FULL.name}
    for row in rows:
        if row.ended:
            yield row, full[row.scene, row.load]


def climb_table(rows: list[Row]) -> str:
    """Where climbs ended, and what they cost beside the full model, set-up and all."""
    lines = [
        "| scene | load | the climb ended on | error, energy norm | s | straight to the full model "
        "| part |",
        "|---|---:|---|" + "---:|" * 4,
    ]
    for row, full in climbs(rows):
        mine, theirs = row.setup + row.seconds, full.setup + row.against
        cells = [row.scene, f"{row.load:g}", row.ended, f"{percent(row.true[ENERGY])} %"]
        cells += [f"{mine:.2f}", f"{theirs:.2f}", f"{mine / theirs:.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def report(rows: list[Row]) -> str:
    """All tables."""
    return "\n".join(
        [
            "Errors and estimates in percent; seconds of the processor.\n",
            summary(rows),
            f"The climb allows {100 * TOLERANCE:g} % in the norm of energy, or the error of the "
            "mesh; seconds with set-up, medians of runs in turns.\n",
            climb_table(rows),
            table(rows),
        ]
    )


def draw(rows: list[Row]) -> Figure:
    """Estimates over true errors; cost of simpler models; cost of climbs."""
    figure = Figure((11, 8.5), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=(5, 3.5))
    left, right = top.subplots(1, 2)
    draw_estimates(left, rows)
    draw_costs(right, rows)
    draw_climbs(bottom.subplots(), list(climbs(rows)))
    return figure


def draw_estimates(axes, rows: Iterable[Row]) -> None:
    """Estimates over true errors."""
    ends = np.array([1e-5, 300.0])
    axes.fill_between(ends, ends / 3, ends * 3, color="#e8e8e8", lw=0)
    axes.loglog(ends, ends, color="#888888", lw=0.8)
    for row in rows:
        style = {"color": SCENE_COLOURS[row.scene], "marker": MARKERS[row.rung], "ls": ""}
        for name, fill in ((ENERGY, "full"), (FORCE, "none")):
            if row.factor(name) < np.inf:
                axes.plot(row.true[name], row.estimate[name], fillstyle=fill, ms=5, **style)
    for scene, colour in SCENE_COLOURS.items():
        axes.plot([], [], marker="o", color=colour, ls="", label=scene)
    axes.set(xlabel="true error", ylabel="estimated error", xlim=ends, ylim=ends)
    axes.set_title("filled: energy norm, open: total force; grey: a factor of 3", fontsize=10)
    axes.legend(frameon=False, fontsize=8)


def draw_costs(axes, rows: list[Row]) -> None:
    """Cost of each simpler model, full markers where its true error is within the tolerance."""
    names = [rung.name for rung in RUNGS if not (rung.leaves_out or rung.climbs or rung == FULL)]
    offsets = dict(zip(SCENE_COLOURS, np.linspace(-0.27, 0.27, len(SCENE_COLOURS))))
    for row in rows:
        if not row.reason and row.rung in names:
            place = names.index(row.rung) + offsets[row.scene]
            style = {"color": SCENE_COLOURS[row.scene], "marker": MARKERS[row.rung], "ls": ""}
            fill = "full" if row.true[ENERGY] <= TOLERANCE else "none"
            axes.semilogx(row.seconds / row.against, place, fillstyle=fill, ms=7, **style)
    axes.axvline(1.0, color="#888888", lw=0.8, ls="--")
    axes.set(xlabel="processor time over that of the full model", ylim=(len(names) - 0.5, -0.5))
    axes.set_yticks(range(len(names)), [name.replace(", ", ",\n") for name in names])
    axes.set_xticks((ticks := (0.1, 0.2, 0.5, 1, 2, 4)), [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_title(f"filled: true error below {100 * TOLERANCE:g} %", fontsize=10)


def draw_climbs(axes, pairs: list[tuple[Row, Row]]) -> None:
    """Seconds of climbs over those of the full model, with where they ended."""
    for place, (row, full) in enumerate(pairs):
        part = (row.setup + row.seconds) / (full.setup + row.against)
        axes.barh(place, part, color=SCENE_COLOURS[row.scene], height=0.7)
        text = f"{row.ended}: {percent(row.true[ENERGY])} %"
        axes.text(0.01, place, text, va="center", color="white", fontsize=9)
    axes.axvline(1.0, color="#888888", lw=0.8, ls="--")
    axes.set_yticks(range(len(pairs)), [f"{row.scene} {row.load:g}" for row, _ in pairs])
    axes.invert_yaxis()
    axes.set_xlabel("processor time over that of the full model, with set-up")
    axes.set_title(
        "hierarchy=True: model of the last step, and its true error (allowed: "
        f"{100 * TOLERANCE:g} %, or the error of the mesh)",
        fontsize=10,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", help="measure only this one anew")
    parser.add_argument("--redraw", action="store_true", help="draw what was measured before")
    options = parser.parse_args()
    if not options.redraw:
        list(measure(SCENES[1], SCENES[1].loads[-1]))  # forms are compiled, kernels loaded
    folder = Path("results/ladder")
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for scene in SCENES:
        kept = folder / f"{scene.name.replace(' ', '_')}.json"
        if options.scene in (None, scene.name) and not options.redraw:
            mine = list(measure_all(scene))
            kept.write_text(json.dumps([asdict(row) for row in mine]))
        if kept.exists():
            rows += [Row(**row) for row in json.loads(kept.read_text())]
    (folder / "ladder.md").write_text(report(rows))
    draw(rows).savefig(folder / "ladder.png", dpi=130)
    print(report(rows))


if __name__ == "__main__":
    main()
