# SPDX-License-Identifier: MIT
"""The stability study as a heat map, a Markdown table and a chart of iterations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from demos.studies.stability.families import FAMILIES, Family
from demos.studies.stability.methods import METHODS, REMEDIES, Method

Cell = dict[str, Any]
Cells = dict[tuple[str, str, str], Cell]

# Okabe and Ito's colours, for colour-blind readers; converged cells are blue, dark if slow.
CUT, WRONG, FAILED, END, NOTHING = "#f0c419", "#d55e00", "#2b2b2b", "#9a9a9a", "#ffffff"
FEWEST, MOST = 2.0, 14.0
# Size of the picture, of the names above and the legend below [inch].
WIDTH, HEAD, FOOT = 10.0, 1.5, 0.55
# States of cells that did not reach the end of their path, or ended in a wrong state.
BAD = ("wrong", "failed", "dead end")
# Newton iterations per load step of frictionless sliding blocks with a weighted gap and a minimum
# function, 40 steps: issues 13508 and 17189 of MOOSE
PUBLISHED = (2.3, 2.6)
SLIDING = ("ironing", "slide_off", "channel")


def draw_all(cells: Cells, folder: Path) -> None:
    """Write atlas.png, atlas.md and iterations.png; print a summary."""
    draw_map(cells).savefig(folder / "atlas.png", dpi=150)
    draw_iterations(cells).savefig(folder / "iterations.png", dpi=150)
    text = table(cells)
    (folder / "atlas.md").write_text(text)
    print(text.split("\n\n")[1])


def methods_of(cells: Cells) -> dict[str, Method]:
    """The methods available in this release."""
    there = {m for (_, _, m), cell in cells.items() if cell["state"] != "not available"}
    return {name: method for name, method in METHODS.items() if name in there}


def mean(cell: Cell) -> float:
    """Newton iterations per accepted step."""
    return float(np.mean(cell["iterations"])) if cell["iterations"] else np.nan


def steps_of(cells: Cells, method: str, families: Sequence[str] = ()) -> np.ndarray:
    """Iterations of all accepted steps of a method, in some families or in all."""
    mine = [
        c["iterations"]
        for (scene, _, m), c in cells.items()
        if m == method and (not families or scene in families)
    ]
    return np.array([n for iterations in mine for n in iterations])


# The heat map


def draw_map(cells: Cells) -> Figure:
    """Problems are rows, methods are columns; two panels side by side."""
    panels = split(list(FAMILIES.values()))
    rows = max(sum(1 + len(f.values) for f in panel) for panel in panels)
    height = 0.155 * rows + HEAD + FOOT
    figure = Figure((WIDTH, height))
    figure.suptitle(
        "Difficult problems: what becomes of each by each method",
        fontsize=12,
        weight="bold",
        y=1.0 - 0.18 / height,
    )
    for i, panel in enumerate(panels):
        place = (0.01 + i * 0.5, FOOT / height, 0.44, 1.0 - (HEAD + FOOT) / height)
        draw_panel(figure.add_axes(place), panel, cells, rows)
    figure.legend(
        handles=[
            Patch(color=blue(3.0), label="converged; number: Newton iterations per load step"),
            Patch(color=blue(11.0), label="the same, many iterations"),
            Patch(color=CUT, label="converged after load steps were cut"),
            Patch(color=WRONG, label="! wrong: a state that violates contact"),
            Patch(color=FAILED, label="× failed; empty: does not apply"),
            Patch(color=END, label="∅ dead end: no equilibrium next to the last state"),
        ],
        loc="lower center",
        ncol=3,
        fontsize=8.5,
        frameon=False,
    )
    return figure


def split(families: Sequence[Family]) -> list[list[Family]]:
    """Two lists of about equally many rows."""
    sizes = np.cumsum([1 + len(f.values) for f in families])
    half = int(np.searchsorted(sizes, sizes[-1] / 2)) + 1
    return [list(families[:half]), list(families[half:])]


def blue(iterations: float) -> Any:
    """Colour of converged cells: light for few iterations."""
    part = np.clip((iterations - FEWEST) / (MOST - FEWEST), 0.0, 1.0)
    return colormaps["Blues"](0.12 + 0.78 * part)


def draw_panel(axes: Any, families: Sequence[Family], cells: Cells, rows: int) -> None:
    """One column of families."""
    row, methods = 0, methods_of(cells)
    for family in families:
        axes.text(-2.6, row + 0.62, family.title, fontsize=7.5, weight="bold", va="center")
        for value in map(str, family.values):
            row += 1
            axes.text(-0.1, row + 0.5, label_of(value), fontsize=7, ha="right", va="center")
            for column, method in enumerate(methods):
                draw_cell(axes, column, row, cells.get((family.name, value, method)))
        row += 1
    axes.set(xlim=(-2.7, len(methods)), ylim=(rows, -0.1))
    axes.xaxis.tick_top()
    axes.set_xticks(np.arange(len(methods)) + 0.5)
    axes.set_xticklabels([m.title for m in methods.values()], rotation=55, ha="left", fontsize=7.5)
    axes.set_yticks([])
    axes.tick_params(length=0, pad=0)
    axes.spines[:].set_visible(False)


def label_of(value: str) -> str:
    """A value as text."""
    try:
        number = float(value)
    except ValueError:
        return value
    return f"{number:g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def draw_cell(axes: Any, column: int, row: int, cell: Cell | None) -> None:
    """A coloured box with the mean number of iterations."""
    color, label, ink = appearance(cell)
    axes.add_patch(
        Rectangle((column, row), 1, 1, facecolor=color, edgecolor="#ffffff", linewidth=0.8)
    )
    axes.text(column + 0.5, row + 0.53, label, fontsize=6.5, color=ink, ha="center", va="center")


def appearance(cell: Cell | None) -> tuple[Any, str, str]:
    """Colour, text and its colour of a cell."""
    if cell is None or cell["state"] in ("n/a", "not available"):
        return NOTHING, "·", "#999999"
    if cell["state"] == "failed":
        return FAILED, "×", "#ffffff"
    if cell["state"] == "dead end":
        return END, "∅", "#000000"
    if cell["state"] == "wrong":
        return WRONG, "!", "#ffffff"
    number = f"{mean(cell):.1f}" if mean(cell) < 9.95 else f"{mean(cell):.0f}"
    if cell["state"] == "cut":
        return CUT, number, "#000000"
    return blue(mean(cell)), number, "#000000" if mean(cell) < 8.0 else "#ffffff"


# The chart


def draw_iterations(cells: Cells) -> Figure:
    """Distribution of iterations per load step, compared with published numbers."""
    steps, sliding = steps_of(cells, "default"), steps_of(cells, "default", SLIDING)
    figure = Figure((6.4, 3.2), layout="constrained")
    axes = figure.add_subplot()
    counts = np.bincount(np.minimum(steps, 15), minlength=16)[1:]
    axes.bar(np.arange(1, 16), counts / max(counts.sum(), 1) * 100, color=blue(7.0), width=0.85)
    for value, style, label in (
        (np.median(steps) if steps.size else np.nan, "-", "median of all"),
        (np.mean(sliding) if sliding.size else np.nan, ":", "mean of the sliding problems"),
    ):
        axes.axvline(value, color="#000000", lw=1.8, ls=style, label=f"{label}: {value:.3g}")
    axes.axvspan(
        *PUBLISHED, color=WRONG, alpha=0.7, lw=0, label="published, a sliding block: 2.3-2.6"
    )
    axes.set(
        xlabel="Newton iterations of a load step (15: or more)",
        ylabel="load steps [%]",
        xticks=range(1, 16),
    )
    axes.set_title(
        f"Default method: iterations of {steps.size} load steps, all problems, to 1e-10",
        fontsize=10,
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    return figure


# The table


def table(cells: Cells) -> str:
    """Markdown: a summary, one table per family, and why cells failed or are wrong."""
    parts = ["# Difficult problems by method", summary(cells)]
    parts.append(
        "Numbers are Newton iterations per accepted load step; `c n`: n steps were cut; "
        "`wrong`, `failed`: see the reasons below the table; `dead end`: the driver has shown that "
        "no equilibrium is next to the last state; `·`: does not apply. Methods other than the "
        "default are given up where 1/64 of a problem's step fails, or after 500 linear systems "
        "and 20 for each of its steps."
    )
    parts.append(remedy_table(cells))
    parts += [family_table(family, cells) for family in FAMILIES.values()]
    return "\n\n".join(parts) + "\n"


def summary(cells: Cells) -> str:
    """Cells by state and iterations, one line per method."""
    lines = [
        "| method | converged | cut | wrong | failed | dead end | does not apply | median "
        "iterations |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name, method in methods_of(cells).items():
        states = Counter(c["state"] for (_, _, m), c in cells.items() if m == name)
        steps = steps_of(cells, name)
        row = [states[s] for s in ("converged", "cut", *BAD)]
        row += [states["n/a"] + states["not available"]]
        median = f"{np.median(steps):g}" if steps.size else "·"
        lines.append(f"| {method.title} | {' | '.join(map(str, row))} | {median} |")
    return "\n".join(lines)


def remedy_table(cells: Cells) -> str:
    """Table of problems that need the features of the default."""
    lines = ["## Remedies", "", "| remedy | problem | with | without | why |"]
    lines.append("|---|---|---:|---:|---|")
    for name, remedy in REMEDIES.items():
        place = remedy.scene, remedy.value
        with_it, without_it = (cells.get((*place, m)) for m in (remedy.beside, name))
        scene = f"{FAMILIES[remedy.scene].title}: {label_of(remedy.value)}"
        row = [remedy.title, scene, entry(with_it), entry(without_it)]
        row.append(short(without_it["reason"]) if without_it else "")
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


def family_table(family: Family, cells: Cells) -> str:
    """One row per value."""
    methods = methods_of(cells)
    lines = [f"## {family.title}", ""]
    lines.append(f"| | {' | '.join(m.title for m in methods.values())} |")
    lines.append("|---|" + "---:|" * len(methods))
    reasons: dict[str, list[str]] = {}
    for value in map(str, family.values):
        row = []
        for name, method in methods.items():
            cell = cells.get((family.name, value, name))
            row.append(entry(cell))
            if cell and cell["state"] in BAD:
                where = f"{label_of(value)} by {method.title}"
                length = 400 if cell["state"] == "dead end" else 220
                reason = f"{cell['state']}: {short(cell['reason'], length)}"
                reasons.setdefault(reason, []).append(where)
        lines.append(f"| {label_of(value)} | {' | '.join(row)} |")
    lines += ["", *(f"- {', '.join(where)}: {reason}" for reason, where in reasons.items())]
    return "\n".join(lines).rstrip()


def entry(cell: Cell | None) -> str:
    """A cell as text."""
    if cell is None or cell["state"] in ("n/a", "not available"):
        return "·"
    if cell["state"] in BAD:
        return f"**{cell['state']}**"
    return f"{mean(cell):.1f}" + (f" c {cell['cuts']}" if cell["state"] == "cut" else "")


def short(reason: str, length: int = 220) -> str:
    """The beginning of a reason, in one line."""
    line = " ".join(reason.split())
    return line if len(line) <= length else line[: length - 3] + "..."
