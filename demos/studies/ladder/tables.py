# SPDX-License-Identifier: MIT
"""Markdown tables of simpler models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from demos.studies.ladder.row import SEEN, Row
from demos.studies.ladder.scenes import FULL, MODELS, SCENES
from fenics_mortar.models.model_error import ENERGY, FORCE, PEAK, QUANTITIES


def percent(value: float) -> str:
    """A fraction in percent."""
    return "" if np.isnan(value) else "0" if value < SEEN else f"{100 * value:.2g}"


def table(rows: list[Row]) -> str:
    """Markdown: errors and estimates in percent, verdict, cost."""
    lines = [
        "| problem | load | model | energy norm: true | estimate | force: true | estimate | "
        "peak: true | estimate | verdict | right | dofs | set-up s | s | check s | iterations |",
        "|---|---:|---|" + "---:|" * 6 + "---|---|" + "---:|" * 5,
    ]
    for row in rows:
        start = f"| {row.scene} | {row.load:g} |"
        if row.reason:
            lines.append(f"{start} {row.model} | {row.reason[:60]} |" + " |" * 12)
            continue
        pairs = [percent(kind[name]) for name in QUANTITIES for kind in (row.true, row.estimate)]
        answer, is_so = row.verdict
        verdict = ["enough" if answer else "not enough", "yes" if answer == is_so else "NO"]
        cells = [*pairs, *(verdict if row.has_estimate else ("", ""))]
        seconds = [f"{s:.2f}" for s in (row.setup, row.seconds)]
        check = "" if np.isnan(row.check) else f"{row.check:.2f}"
        cells += [str(row.dofs), *seconds, check, str(row.iterations)]
        lines.append(f"{start} {row.model} | {' | '.join(cells)} |")
        if row.model == FULL.name:
            left = " | ".join(f"{percent(row.mesh[name])} |" for name in QUANTITIES)
            lines.append(f"{start} error of the mesh | {left} |" + " |" * 7)
    return "\n".join(lines) + "\n"


def summary(rows: list[Row]) -> str:
    """Number of estimates within a factor of three, by model."""
    lines = [
        "| model | cases | energy norm and force within a factor 3 | largest factor | "
        "peak pressure within a factor 3 | largest factor | "
        "others that are off by less than the error of the mesh | verdicts right |",
        "|---|" + "---:|" * 7,
    ]
    ratio = dict.fromkeys(QUANTITIES, 1.0 / SCENES[0].ratio)
    rigid = [r for r in rows if r.model == MODELS[0].name]
    by_rule = [
        replace(r, model="rigid obstacle, by the ratio of moduli", estimate=ratio) for r in rigid
    ]
    everything = [*rows, *by_rule]
    for model in dict.fromkeys(r.model for r in everything):
        mine = [r for r in everything if r.model == model and r.has_estimate and not r.reason]
        mine = [r for r in mine if r.true[ENERGY] > SEEN]
        if mine:
            cells = [model, str(len(mine))]
            for names in ((ENERGY, FORCE), (PEAK,)):
                factors = [f for r in mine for n in names if np.isfinite(f := r.factor(n))]
                cells += [f"{sum(f <= 3 for f in factors)} of {len(factors)}"]
                cells += [f"{max(factors):.1f}"]
            out = [r.is_hidden(n) for r in mine for n in QUANTITIES if r.factor(n) > 3]
            cells += [f"{sum(out)} of {len(out)}" if out else ""]
            cells += [str(sum(answer == is_so for answer, is_so in (r.verdict for r in mine)))]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def report(rows: list[Row]) -> str:
    """All tables."""
    return "\n".join(
        [
            "# Simpler models: all numbers\n",
            "Errors and estimates in percent; seconds of the processor.\n",
            summary(rows),
            table(rows),
        ]
    )
