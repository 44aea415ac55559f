# SPDX-License-Identifier: MIT
"""Picture of the errors and costs of simpler models."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from demos.studies.ladder.row import Row
from demos.studies.ladder.scenes import FULL, MODELS, SCENES, TOLERANCE
from fenics_mortar.models.model_error import ENERGY, FORCE

COLOURS = (
    "#c8102e", "#1f5fa8", "#2a8a3e", "#b07a00", "#7b3fa0", "#00857d", "#d0569a", "#5a5a5a",
)  # fmt: skip
SCENE_COLOURS = dict(zip((s.name for s in SCENES), COLOURS, strict=True))
MARKERS = dict(zip((r.name for r in MODELS), "Ds^vo*PX"))


def draw(rows: list[Row]) -> Figure:
    """Estimates over true errors; cost of simpler models."""
    figure = Figure((11, 5), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_estimates(left, rows)
    draw_costs(right, rows)
    return figure


def draw_estimates(axes, rows: list[Row]) -> None:
    """Estimates over true errors."""
    ends = np.array([1e-5, 300.0])
    axes.fill_between(ends, ends / 3, ends * 3, color="#e8e8e8", lw=0)
    axes.loglog(ends, ends, color="#888888", lw=0.8)
    for row in rows:
        style = {"color": SCENE_COLOURS[row.scene], "marker": MARKERS[row.model], "ls": ""}
        for name, fill in ((ENERGY, "full"), (FORCE, "none")):
            if row.factor(name) < np.inf:
                axes.plot(row.true[name], row.estimate[name], fillstyle=fill, ms=5, **style)
    for scene, colour in SCENE_COLOURS.items():
        axes.plot([], [], marker="o", color=colour, ls="", label=scene)
    axes.set(xlabel="true error", ylabel="estimated error", xlim=ends, ylim=ends)
    axes.set_title("filled: energy norm, open: total force; grey: a factor of 3", fontsize=10)
    scenes = axes.legend(frameon=False, fontsize=8)
    axes.add_artist(scenes)
    models = {row.model: None for row in rows if row.factor(ENERGY) < np.inf}
    for model in models:
        axes.plot([], [], marker=MARKERS[model], color="#666666", ls="", ms=5)
    axes.legend(axes.lines[-len(models) :], models, loc="lower right", frameon=False, fontsize=8)


def draw_costs(axes, rows: list[Row]) -> None:
    """Cost of each simpler model, full markers where its true error is within the tolerance."""
    names = [model.name for model in MODELS if not (model.leaves_out or model == FULL)]
    offsets = dict(zip(SCENE_COLOURS, np.linspace(-0.27, 0.27, len(SCENE_COLOURS))))
    for row in rows:
        if not row.reason and row.model in names:
            place = names.index(row.model) + offsets[row.scene]
            style = {"color": SCENE_COLOURS[row.scene], "marker": MARKERS[row.model], "ls": ""}
            fill = "full" if row.true[ENERGY] <= TOLERANCE else "none"
            axes.semilogx(row.seconds / row.against, place, fillstyle=fill, ms=7, **style)
    axes.axvline(1.0, color="#888888", lw=0.8, ls="--")
    axes.set(xlabel="processor time over that of the full model", ylim=(len(names) - 0.5, -0.5))
    axes.set_yticks(range(len(names)), [name.replace(", ", ",\n") for name in names])
    axes.set_xticks((ticks := (0.1, 0.2, 0.5, 1, 2, 4)), [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_title(f"filled: true error below {100 * TOLERANCE:g} %", fontsize=10)
