# SPDX-License-Identifier: MIT
"""All scenes of ``supported.py`` solved by the present code, and compared with limit analysis.

``/usr/bin/python3 tests/program.py supported_table [begin of names]``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from supported import (
    arch,
    block_and_wall,
    hanging,
    incline,
    jaws,
    ladder,
    pressed,
    t_junction,
    tower,
    wall,
    wheel,
)
from supported_problem import Assembly

import fenics_mortar as fm

# Distance of the factor of limit analysis from one, above which the verdict is certain [1].
MARGIN = 0.02


def everything() -> Iterator[tuple[Callable[..., Assembly], dict[str, Any]]]:
    """The scenes of the table."""
    for mu in (0.2, 0.5, 0.9):
        for base in ("plane", "body"):
            for factor in (0.5, 0.95, 1.05, 1.3):
                yield incline, {"slope": np.arctan(factor * mu), "mu": mu, "base": base}
    for base in ("plane", "body"):
        for push in (0.001, 0.1, 0.45, 0.6):
            yield block_and_wall, {"push": push, "base": base}
        yield block_and_wall, {"push": 0.1, "base": base, "at_once": True}
    for groove in ("planes", "body"):
        for part in (0.01, 0.5, 0.95, 1.1):
            yield wheel, {"part": part, "groove": groove}
    for base in ("plane", "body"):
        for factor in (0.9, 0.97, 1.03, 1.3):
            yield ladder, {"angle": np.arctan(factor / 0.8), "mu": 0.4, "base": base}
    for base in ("plane", "body"):
        for weight in (0.1, 0.8, 1.2):
            yield hanging, {"weight": weight, "base": base}
        yield hanging, {"weight": -0.5, "push": 0.1, "base": base}
    for kind in ("planes", "bodies"):
        for weight in (0.0, 0.3, 0.9, 1.1):
            yield jaws, {"weight": weight, "kind": kind}
        yield jaws, {"weight": 0.1, "force": 2.0, "mu": 0.8, "blocks": 3, "kind": kind}
    for base in ("plane", "body"):
        for push in (0.1, 0.7, 1.4):
            yield pressed, {"push": push, "base": base}
    for number in (5, 9):
        for thickness in (0.2, 0.12, 0.09, 0.06):
            yield arch, {"thickness": thickness, "number": number}
    for side in (None, 0.0, 0.5):
        for cells in ((2, 2, 3), (3, 3, 3), (3, 4, 5), (2, 2, 4)):
            for slave in ("upper", "lower"):
                yield t_junction, {"cells": cells, "side": side, "slave": slave}
    yield wall, {"rows": 2, "cols": 2, "friction": False, "push": 0.0}
    for rows, cols in ((2, 1), (2, 2), (3, 2)):
        for mu in (0.2, 0.6, 1.0):
            for cells in ((4,), (4, 6, 2)):
                yield wall, {"rows": rows, "cols": cols, "mu": mu, "cells": cells}
    yield wall, {"rows": 2, "cols": 2, "base": "body"}
    yield wall, {"rows": 2, "cols": 2, "upright": False}
    yield wall, {"rows": 2, "cols": 2, "load": "top", "push": 0.5}
    yield wall, {"rows": 2, "cols": 2, "press": 2.0}
    yield wall, {"rows": 4, "cols": 3}
    yield wall, {"rows": 6, "cols": 4, "cells": (4, 2)}
    for seed in range(1, 9):
        yield tower, {"seed": seed}


def trial(build: Callable[..., Assembly], options: dict[str, Any]) -> dict[str, Any]:
    """Set up one scene, solve it step by step, and judge."""
    begin = time.perf_counter()
    row: dict[str, Any] = {"scene": f"{build.__name__} {options}", "steps": []}
    try:
        scene = build(**options)
    except Exception as error:
        return row | {"steps": [f"set-up: {type(error).__name__}: {error}"], "judgement": "WRONG"}
    row["scene"] = scene.name
    good = True
    for step, loads in enumerate(scene.path):
        expected, allowed = limit(scene, step)
        scene.set(**loads)
        outcome, ended = "", ""
        try:
            report = scene.problem.solve()
            moved, defects = scene.largest(), report.certificate.violations()
            ended = "stays" if moved <= scene.small else "moved"
            if scene.stop is not None and abs(moved / scene.stop - 1.0) < 0.01:
                ended = "at its stop"
            if defects:
                ended = "violated"
            elif scene.wrong(scene):
                ended = "wrong"
            text = defects[0][:60] if defects else "clean"
            outcome = f"{report.num_iterations} it, moved {moved:.2g}, {text} {scene.note(scene)}"
            outcome += f" {scene.wrong(scene)}"
        except fm.MortarError as error:
            ended, outcome = "refused", f"{type(error).__name__}: {str(error)[:110]}"
        except Exception as error:
            ended, outcome = "crash", f"{type(error).__name__}: {str(error)[:110]}"
        rights = {"stays": {"stays"}, "moves": {"refused"}, "open": {"stays", "refused", "moved"}}
        right = ended in rights[allowed]
        if scene.stop is not None:
            right = ended in {"stays": {"stays"}, "moves": {"at its stop"}}.get(allowed, {ended})
        good &= right
        row["steps"].append(
            f"{expected} | {outcome.replace('|', '/')} | {'right' if right else 'WRONG'}"
        )
        if ended != "stays":
            break
    return row | {"judgement": "right" if good else "WRONG", "seconds": time.perf_counter() - begin}


def limit(scene: Assembly, step: int) -> tuple[str, str]:
    """Result of limit analysis for a step as text, and whether bodies stay, move, or either."""
    if not any(body.weight for body in scene.bodies):
        return "by construction", _of_pressing(scene, step)
    verdict, needed = scene.verdict(step)
    allowed = "open"
    if verdict.feasible and verdict.factor > 1.0 + MARGIN:
        allowed = "stays"
    bears_more = verdict.factor * (1.0 + scene.reserve) if verdict.factor else 0.0
    if not verdict.feasible or bears_more < 1.0 - MARGIN:
        allowed = "moves"
    text = "feasible" if verdict.feasible and verdict.factor >= 1.0 else "infeasible"
    factor = abs(verdict.factor)
    return f"{text}, factor {factor:.3f}, friction needed {needed:.3f}", allowed


def _of_pressing(scene: Assembly, step: int) -> str:
    """Result of limit analysis under a prescribed motion: mu times its force."""
    if step == 0:
        return "stays"
    push = scene.path[step]["push"] * sum(body.push for body in scene.bodies)
    part = push / (scene.touches[0].law.mu * scene.force(0)[1])
    return "stays" if part < 1.0 - MARGIN else "moves" if part > 1.0 + MARGIN else "open"


def main() -> None:
    """Print a row per step of each scene."""
    wanted = sys.argv[1:]
    print("| scene | step | judge | outcome | |\n|---|---|---|---|---|")
    count, right, begin = 0, 0, time.perf_counter()
    for build, options in everything():
        if wanted and not any(build.__name__.startswith(name) for name in wanted):
            continue
        row = trial(build, options)
        count, right = count + 1, right + (row["judgement"] == "right")
        for number, step in enumerate(row["steps"], start=1):
            print(f"| {row['scene']} | {number} | {step} |", flush=True)
    print(f"\n{right} of {count} scenes right, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
