# SPDX-License-Identifier: MIT
"""Energy, pressure and cost of impacts by scheme and step: tables and a chart in ``results/``.

``python3 -m demos.studies.dynamics.impacts``, about a minute.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import fenics_mortar as fm
from demos.studies.dynamics.other_schemes import ImplicitContact, NodalReturn, StabilizedNewmark
from demos.studies.dynamics.scenes import RHO, E, Scene, bar, dropped_block

C = np.sqrt(E / RHO)  # speed of waves along the bar
# Time steps over the time of a wave through a cell [1].
STEPS = (2.0, 1.0, 0.5)


class Method(NamedTuple):
    """A scheme, in tables and in the chart."""

    name: str
    scheme: str
    rho_inf: float
    kind: type = fm.Dynamics
    pressure: float = 1.0


METHODS = (
    Method("trapezoidal rule", "generalized_alpha", 1.0),
    Method("generalized alpha, 0.8", "generalized_alpha", 0.8),
    Method("generalized alpha, 0", "generalized_alpha", 0.0),
    Method("contact implicit", "generalized_alpha", 1.0, ImplicitContact, 0.5),
    Method("stabilized Newmark", "generalized_alpha", 1.0, StabilizedNewmark, 0.5),
    Method("energy by node", "generalized_alpha", 1.0, NodalReturn, 0.5),
    Method("massless", "massless", 1.0),
    Method("conserving", "conserving", 1.0),
    Method("conserving, 0.8", "conserving", 0.8),
)


class Result(NamedTuple):
    """One run: total energies and mean pressures by step, CPU seconds, iterations, momentum."""

    energies: np.ndarray
    pressures: np.ndarray
    times: np.ndarray
    seconds: float
    iterations: int
    momentum: np.ndarray


def move(
    made: Scene, method: Method, stop: float, dt: float, velocities: dict[str, Any]
) -> Result | None:
    """Run a problem by a method in steps ``dt``; ``None`` if it fails before the end."""
    options = {"scheme": method.scheme, "rho_inf": method.rho_inf, "energy": made.energy}
    options["velocity"] = made.velocity
    motion = method.kind(made.problem, RHO, **options)
    made.set_velocity(motion, velocities)
    pressures: list[float] = []

    def note(_time: float, _report: Any) -> None:
        pressures.append(method.pressure * made.problem.contacts[0].pressure.mean())

    start = time.process_time()
    try:
        record = motion.run(stop, fm.SteppingOptions(step=dt, smallest=dt / 8), on_step=note)
    except fm.NotConvergedError:
        return None
    seconds = time.process_time() - start
    energies = np.array([step.energies.total for step in record.steps]) / record.start.total
    times = np.array([step.time for step in record.steps])
    return Result(
        energies, np.array(pressures), times, seconds, record.num_iterations, motion.momentum()
    )


def bar_row(result: Result) -> tuple[list[str], float]:
    """Cells of the table of the bar, and the largest error of its energy."""
    speed, length = 0.1, 10.0
    closed = np.flatnonzero(result.pressures > 0.0)
    relative = result.pressures[closed] / (RHO * C * speed)
    inner = relative[len(relative) // 10 : -len(relative) // 10]
    duration = (result.times[closed[-1]] - result.times[closed[0]]) * C / (2.0 * length)
    rebound = result.momentum[1] / (RHO * length * speed)
    cells = [f"{duration:.3f}", f"{relative.mean():.3f}", f"{np.abs(inner - 1.0).mean():.3f}"]
    return [*cells, f"{rebound:.3f}"], float(np.abs(result.energies - 1.0).max())


def block_row(result: Result) -> tuple[list[str], float]:
    """Cells of the table of the block, and the largest error of its energy."""
    cells = [f"{result.energies.min():.4f}", f"{result.energies.max():.4f}"]
    return [*cells, f"{result.energies[-1]:.4f}"], float(np.abs(result.energies - 1.0).max())


def study(
    name: str,
    columns: str,
    build: Callable[[], Scene],
    row: Callable[[Result], tuple[list[str], float]],
    stop: float,
    velocities: dict[str, Any],
) -> dict[str, list[tuple[float, float, float]]]:
    """Print the table of a problem; return step, error of the energy and seconds by method."""
    print(f"\n{name}\n\n| scheme | step | {columns} | energy error | iterations | CPU [s] |")
    print("|---|" + "---:|" * (columns.count("|") + 5), flush=True)
    curves: dict[str, list[tuple[float, float, float]]] = {}
    made = build()
    move(made, METHODS[0], 0.2 * stop, 0.1 * stop, velocities)  # compiles forms, loads kernels
    for method in METHODS:
        for step in STEPS:
            made = build()
            result = move(made, method, stop, step * made.cell / C, velocities)
            if result is None:
                empty = " – |" * (columns.count("|") + 1)
                print(f"| {method.name} | {step:g} |{empty} fails | | |", flush=True)
                continue
            cells, error = row(result)
            curves.setdefault(method.name, []).append((step, error, result.seconds))
            cells += [f"{error:.1e}", f"{result.iterations}", f"{result.seconds:.1f}"]
            print(f"| {method.name} | {step:g} | {' | '.join(cells)} |", flush=True)
    return curves


def draw(curves: dict[str, dict[str, list[tuple[float, float, float]]]], path: Path) -> None:
    """Chart of the energy error against step and CPU time, one row per problem."""
    figure = Figure((9.0, 3.4 * len(curves)))
    axes = figure.subplots(len(curves), 2, sharey="row")
    for (name, methods), (left, right) in zip(curves.items(), axes, strict=True):
        for method, points in methods.items():
            step, error, seconds = np.array(points).T
            left.loglog(step, np.maximum(error, 1e-6), "o-", label=method, ms=4)
            right.loglog(seconds, np.maximum(error, 1e-6), "o-", ms=4)
        left.set(title=name, xlabel="step c / cell", ylabel="largest error of energy, 1e-6 if less")
        right.set(title=name, xlabel="CPU time [s]")
        for each, ticks in ((left, (0.5, 1.0, 2.0)), (right, (0.2, 0.5, 1.0, 2.0))):
            each.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            each.xaxis.set_minor_formatter(NullFormatter())
            each.grid(alpha=0.3, which="both")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="lower center", ncol=4, fontsize=8)
    figure.tight_layout(rect=(0.0, 0.07, 1.0, 1.0))
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run both problems."""
    columns = "contact time c / 2 l | pressure / rho c v | its error within | rebound / v"
    velocities = {"bar": (0.0, -0.1, 0.0)}
    stop = 0.1 + 3.0 * 10.0 / C
    walls = study("Bar on a wall", columns, lambda: bar(20), bar_row, stop, velocities)
    columns = "energy: min | max | end"
    blocks = study(
        "Block on block, neo-Hookean",
        columns,
        lambda: dropped_block(5),
        block_row,
        0.6,
        {"upper": (0.0, -1.0, 0.0)},
    )
    folder = Path("results")
    folder.mkdir(exist_ok=True)
    draw(
        {"Linear bar on a rigid wall": walls, "Neo-Hookean block on block": blocks},
        folder / "impacts.png",
    )


if __name__ == "__main__":
    main()
