# SPDX-License-Identifier: MIT
"""Measurements of ``chart.py`` and ``peer_*.py``: stored in files, tabulated and drawn."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

# One solve: ``code``, ``element``, ``graded``, ``n``, ``dofs``, ``seconds``, the errors by name;
# ours have ``basis``, ``integration`` and ``linearization``, too.
Row = dict[str, Any]
FOLDER = Path("results/accuracy")
OURS = "fenics_mortar"
DEFAULT = ("dual", "segments", "full")
SIZES = (16, 32, 64, 128, 256, 512)
COSTS = ("seconds", "dofs")
PHASES = ("set-up", "bulk", "contact", "solve", "other")
# Energy: the solution is smooth except for r^(3/2) at the ends of the contact. Pressure: r^(1/2).
PREDICTED = {
    1: {"energy": 1.0, "pressure": 1.0, "pressure max": 0.5},
    2: {"energy": 1.5, "pressure": 1.0, "pressure max": 0.5},
}
# Largest deviation of a fitted rate, and smallest number of facets in contact for a fit: with
# fewer, multipliers at vertices overshoot at the ends of contact by up to half of the peak
NEAR, LEAST_FACETS = 0.15, 5.0
COLOURS = {"P1": "#0072b2", "Q1": "#56b4e9", "P2": "#d55e00", "Q2": "#e69f00"}
MARKERS = "^sDv"
# Elements for which other codes are drawn; the tables have all
DRAWN = ("Q1", "Q2")
DASHES = {"segments": "-", "elements": "--"}


def write(name: str, rows: Sequence[Row]) -> None:
    """Store rows in a file, replacing an existing one."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / f"{name}.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


def read() -> list[Row]:
    """All stored rows."""
    files = sorted(FOLDER.glob("*.jsonl"))
    return [json.loads(line) for file in files for line in file.read_text().splitlines()]


def choice(row: Row) -> tuple[str, ...]:
    """Basis, integration and tangent of a row of this package; other codes have their own."""
    return tuple(row.get(name, "") for name in ("basis", "integration", "linearization"))


def series(rows: Sequence[Row]) -> dict[tuple, list[Row]]:
    """Rows by code, element, choice and kind of mesh, each from coarse to fine."""
    found: dict[tuple, list[Row]] = {}
    for row in sorted(rows, key=lambda row: row["n"]):
        found.setdefault((row["code"], row["element"], choice(row), row["graded"]), []).append(row)
    return found


def rate(rows: Sequence[Row], name: str) -> float:
    """Rate of an error over the last two halvings of the facets.

    Over one halving it depends on the position of the end of contact in its facet; after two
    halvings the position is the same again.
    """
    coarse, fine = rows[-3], rows[-1]
    return float(np.log(coarse[name] / fine[name]) / np.log(fine["n"] / coarse["n"]))


def rate_beside(rows: Sequence[Row], name: str, expected: float) -> str:
    """The fitted rate, the predicted one in brackets, and the reason for a difference as text.

    A third of the slave's facets are in contact.
    """
    found, coarsest = rate(rows, name), rows[-3]
    in_contact = coarsest["n"] / int(coarsest["element"][1]) / 3
    cell = f"{found:.2f} ({expected:g})"
    if abs(found - expected) <= NEAR:
        return cell
    if in_contact < LEAST_FACETS:
        return f"{cell}, too coarse: from {in_contact:.1f} facets in contact on"
    return f"{cell}, not as predicted"


def cost(rows: Sequence[Row], target: float, what: str) -> str:
    """Seconds or dofs for which the energy error is ``target``, interpolated between the rows.

    With "~" if extrapolated from the last two rows; "-" if this is too far.
    """
    error, spent = (np.log([row[name] for row in rows]) for name in ("energy", what))
    if error[-1] > np.log(3 * target):
        return "-"
    last = int(np.clip(np.searchsorted(-error, -np.log(target)), 1, len(rows) - 1))
    part = (np.log(target) - error[last - 1]) / (error[last] - error[last - 1])
    value = np.exp(spent[last - 1] + part * (spent[last] - spent[last - 1]))
    return ("~" if error[-1] > np.log(target) else "") + f"{float(f'{value:.2g}'):,g}"


def markdown(head: str, left: int, lines: Sequence[Sequence[str]]) -> str:
    """Markdown table; ``head``: names of the columns, of which ``left`` are left-aligned."""
    rule = "|" + "---|" * left + "---:|" * (head.count("|") + 1 - left)
    body = ["| " + " | ".join(cells) + " |" for cells in lines]
    return "\n".join([f"| {head} |", rule, *body]) + "\n"


def mesh_name(graded: bool) -> str:
    return "graded" if graded else "uniform"


def predicted(element: str) -> dict[str, float]:
    return PREDICTED[int(element[1])]


def full_table(rows: Sequence[Row]) -> str:
    """Fitted and predicted rates, and cost on the finest mesh, for all choices."""
    head = (
        "element | mesh | basis | integration | tangent | energy | pressure L2 | pressure max "
        "| finest: energy | dofs | iterations | set-up [s] | bulk | contact | solve | other "
        "| adds [MB]"
    )
    lines = []
    for (code, element, names, graded), mine in series(rows).items():
        if code != OURS or len(mine) < 3:
            continue
        # no rates are predicted for graded meshes
        rates = [
            f"{rate(mine, name):.2f}" if graded else rate_beside(mine, name, value)
            for name, value in predicted(element).items()
        ]
        last = mine[-1]
        cells = [element, mesh_name(graded), *names, *rates, f"{last['energy']:.1e}"]
        cells += [str(last["dofs"]), str(last["iterations"])]
        cells += [f"{last[phase]:.3f}" for phase in PHASES]
        lines.append([*cells, f"{last['MB']:.0f}"])
    return markdown(head, 5, lines)


def short_table(rows: Sequence[Row]) -> str:
    """Fitted and predicted rates on uniform meshes, with the default choices and "vertices"."""
    lines = []
    for (code, element, names, graded), mine in series(rows).items():
        basis, *others = names
        if code != OURS or graded or basis == "standard" or tuple(others) != DEFAULT[1:]:
            continue
        if len(mine) >= 3:
            rates = [rate_beside(mine, *pair) for pair in predicted(element).items()]
            sizes = f"{mine[-3]['n']} to {mine[-1]['n']}"
            lines.append([element + ("" if basis == "dual" else f", {basis}"), sizes, *rates])
    return markdown("element | n | energy | pressure, L2 | pressure, max", 1, lines)


def cost_table(rows: Sequence[Row], target: float = 0.01) -> str:
    """Seconds and dofs for an energy error of ``target``, default choices and other codes."""
    lines = [
        [code, element, mesh_name(graded), *(cost(mine, target, what) for what in COSTS)]
        for (code, element, names, graded), mine in series(rows).items()
        if names in (DEFAULT, ("", "", "")) and len(mine) >= 2
    ]
    return markdown(f"code | element | mesh | seconds to {100 * target:g} % | dofs", 3, lines)


def peer_table(rows: Sequence[Row]) -> str:
    """Errors and seconds of all rows with the default choices, and of other codes."""
    head = (
        "code | element | mesh | n | energy | displacement L2 | pressure L2 | pressure max "
        "| resultant | iterations | seconds"
    )
    names = ("energy", "displacement", "pressure", "pressure max", "resultant")
    lines = []
    for row in rows:
        if choice(row) in (DEFAULT, ("", "", "")):
            cells = [row["code"], row["element"], mesh_name(row["graded"]), str(row["n"])]
            cells += [f"{row[name]:.1e}" for name in names]
            lines.append([*cells, str(row["iterations"]), f"{row['seconds']:.3f}"])
    return markdown(head, 3, lines)


def draw_chart(rows: Sequence[Row]) -> Figure:
    """Energy error over seconds, with other codes, and over dofs, with graded meshes."""
    figure = Figure((9.6, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    peers = sorted({row["code"] for row in rows} - {OURS})
    for (code, element, names, graded), mine in series(rows).items():
        style = {"color": COLOURS[element], "ms": 4.5}
        if code != OURS:
            if element not in DRAWN:
                continue
            style |= {"marker": MARKERS[peers.index(code)], "mfc": "white", "lw": 1.0, "ls": ":"}
        elif names == DEFAULT:
            style |= {"marker": "o", "lw": 2.0, "ls": "--" if graded else "-"}
        else:
            continue
        if not graded:
            plot(left, mine, "seconds", **style)
        if code == OURS:
            plot(right, mine, "dofs", **style)
            if not graded:
                last = mine[-1]
                place = {"xytext": (6, 0), "textcoords": "offset points", "va": "center"}
                right.annotate(
                    element, (last["dofs"], last["energy"]), color=style["color"], **place
                )
    left.set_xlabel("seconds of one core, from the mesh to the answer")
    left.set_ylabel("relative error of the energy")
    left.set_title("against time, with peers on the same meshes", fontsize=10)
    right.set_xlabel("unknown displacements")
    right.set_title("against size, with graded meshes", fontsize=10)
    first = min((row for row in rows if row["code"] == OURS), key=lambda row: row["dofs"])
    triangle(right, 4 * first["dofs"], 0.2, 1.0, "order 1", above=True)
    triangle(right, 1.3 * first["dofs"], 0.013, 1.5, "order 3/2", above=False)
    right.margins(x=0.12)
    handles = [left.plot([], [], "-o", color=COLOURS[name], label=name)[0] for name in COLOURS]
    for code, marker in zip(peers, MARKERS):
        handles += left.plot([], [], ":", marker=marker, mfc="white", color="#444444", label=code)
    left.legend(
        handles=handles,
        frameon=False,
        fontsize=9,
        ncols=2,
        loc="lower left",
        title="lines: fenics_mortar; dotted: peers",
        alignment="left",
        title_fontsize=9,
    )
    line = right.plot([], [], "-", color="#444444", label="uniform")
    line += right.plot([], [], "--", color="#444444", label="graded")
    right.legend(handles=line, frameon=False, fontsize=9, loc="lower left")
    return figure


def plot(axis: Axes, rows: Sequence[Row], over: str, name: str = "energy", **style: Any) -> None:
    """Draw an error over a cost, both logarithmic."""
    axis.loglog([row[over] for row in rows], [row[name] for row in rows], **style)
    axis.grid(True, which="major", color="#dddddd", lw=0.6)
    axis.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
    if over == "seconds":
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_locator(NullLocator())


def triangle(axis: Axes, x: float, y: float, order: float, text: str, *, above: bool) -> None:
    """Draw the slope of an order in h, half as large in dofs; the corner is above or below it."""
    x, y = np.array([x, 4 * x]), y * np.array([1.0, 0.5**order])
    axis.fill([*x, x[int(above)]], [*y, y[int(not above)]], fc="#eeeeee", ec="#888888", lw=0.8)
    offset = {"xytext": (0, 3 if above else -3), "textcoords": "offset points"}
    place = (np.sqrt(x[0] * x[1]), y[int(not above)])
    style = {"ha": "center", "va": "bottom" if above else "top", "fontsize": 9}
    axis.annotate(text, place, color="#444444", **offset, **style)


def draw_choices(rows: Sequence[Row]) -> Figure:
    """Pressure error over seconds, graded meshes: one panel per element, one line per choice."""
    figure = Figure((9.6, 6.4), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    colours = {"dual": "#0072b2", "standard": "#d55e00", "vertices": "#009e73"}
    for axis, element in zip(axes.ravel(), COLOURS):
        axis.set_title(element, fontsize=10)
        for (code, name, names, graded), mine in series(rows).items():
            basis, integration, tangent = names
            if (code, name, tangent, graded) != (OURS, element, "full", True):
                continue
            style = {"color": colours[basis], "marker": "o", "ms": 3.5}
            style |= {"ls": DASHES[integration], "lw": 1.6}
            plot(axis, mine, "seconds", "pressure", **style)
    for axis in axes[:, 0]:
        axis.set_ylabel("relative error of the pressure, L2")
    for axis in axes[1]:
        axis.set_xlabel("seconds of one core, from the mesh to the answer")
    lines = [axes[0, 0].plot([], [], color=c, label=name)[0] for name, c in colours.items()]
    for name, dash in DASHES.items():
        lines += axes[0, 0].plot([], [], dash, color="#444444", label=name)
    axes[0, 0].legend(handles=lines, frameon=False, fontsize=8, ncols=2, loc="lower left")
    return figure


def report(rows: Sequence[Row]) -> str:
    """Write the tables and pictures of all rows; return the short tables."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    short = "\n".join([short_table(rows), cost_table(rows), peer_table(rows)])
    (FOLDER / "rates.md").write_text(full_table(rows))
    (FOLDER / "summary.md").write_text(short)
    draw_chart(rows).savefig(FOLDER / "chart.png", dpi=110)
    draw_choices(rows).savefig(FOLDER / "choices.png", dpi=110)
    return short
