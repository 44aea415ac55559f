# SPDX-License-Identifier: MIT
"""Summary picture of the stability study: fraction of its problems solved by each method.

Reads atlas.md and writes summary.png beside it:

    python3 -m demos.studies.stability.summary
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from demos.studies.stability.picture import CUT, END, FAILED, WRONG

HERE = Path(__file__).parent
# Columns of the table in atlas.md, their colours and labels
OUTCOMES = {
    "converged": ("#4f8fc4", "converged"),
    "cut": (CUT, "converged after load steps were cut"),
    "dead end": (END, "dead end: no equilibrium near"),
    "failed": (FAILED, "failed"),
    "wrong": (WRONG, "wrong state"),
}


def read_counts(text: str) -> dict[str, dict[str, int]]:
    """Number of problems of each outcome, for each method, from the first table of atlas.md."""
    lines = [line for line in text.split("\n\n")[1].splitlines() if line.startswith("|")]
    head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return {row[0]: {name: int(row[head.index(name)]) for name in OUTCOMES} for row in rows}


def draw_summary(counts: dict[str, dict[str, int]]) -> Figure:
    """Draw a bar for each method."""
    figure = Figure((8.0, 0.3 * len(counts) + 1.2), layout="tight")
    axes = figure.subplots()
    totals = np.array([sum(outcomes.values()) for outcomes in counts.values()])
    names = [f"{method} ({total})" for method, total in zip(counts, totals, strict=True)]
    left = np.zeros(len(counts))
    for outcome, (colour, outcome_label) in OUTCOMES.items():
        share = 100.0 * np.array([outcomes[outcome] for outcomes in counts.values()]) / totals
        axes.barh(names, share, left=left, color=colour, label=outcome_label, height=0.75)
        left += share
    axes.invert_yaxis()
    axes.set(xlim=(0.0, 100.0), xlabel="share of the problems that a method applies to [%]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower center", bbox_to_anchor=(0.35, 1.0), ncols=3, frameon=False, fontsize=8)
    return figure


def main() -> None:
    """Draw the picture."""
    counts = read_counts((HERE / "atlas.md").read_text())
    draw_summary(counts).savefig(HERE / "summary.png", dpi=150)


if __name__ == "__main__":
    main()
