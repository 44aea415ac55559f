# SPDX-License-Identifier: MIT
"""Speed against accuracy in space: Hertz's sphere, beside other codes on the same meshes.

    python3 -m demos.studies.space.chart                               ours
    python3 -m demos.studies.space.chart --peer getfem                 its direct solver
    kratos/bin/python -m demos.studies.space.chart --peer kratos       direct and AMGCL
    ngsolve/bin/python -m demos.studies.space.chart --peer ngsolve     its direct solver
    python3 -m demos.studies.space.chart --redraw                      what was stored

Writes to ``results/space``: a file of rows by code, and ``chart.png``. Seconds are those of the
processor from the mesh as arrays to the third of three loads, after a warm-up on a coarse mesh.
Errors are root mean squares over the loads: of the force, by residuals of the bulk at the nodes of
the slave, and of the pressure at nodes within 0.9 radii of the contact, over its largest value.
Other codes are posed with cells of degree 1; their pressures are these residuals over nodal areas.
GetFEM's contact is that by ray tracing.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from demos.studies.accuracy.peer import given, prescribed
from demos.studies.space.half_spaces import NU, E, Kind
from demos.studies.space.hertz import SCENES, Hertz, loads, pose
from fenics_mortar.utils.errors import MortarError

mpl.use("agg")
FOLDER, OURS = Path("results/space"), "fenics_mortar"
KINDS = [
    Kind("hexahedra", "hexahedron", 1, (6, 9, 12, 16)),
    Kind("tetrahedra", "tetrahedron", 1, (6, 9, 12, 16)),
    Kind("quadratic hexahedra", "hexahedron", 2, (3, 4, 6, 8)),
    Kind("quadratic tetrahedra", "tetrahedron", 2, (3, 4, 6, 8)),
]
# By code, its solvers and the finest mesh; n = 16 takes minutes with others
SOLVERS = {
    "kratos": {"auto": 12, "iterative": 16},
    "getfem": {"auto": 16},
    "ngsolve": {"auto": 16},
    OURS: {"auto": 16},
}
NAMES = {"kratos": "Kratos", "getfem": "GetFEM", "ngsolve": "NGSolve"}
COLOURS = dict(zip((kind.name for kind in KINDS), ("#56b4e9", "#0072b2", "#e69f00", "#d55e00")))
STYLES = {
    OURS: ("o", "-"),
    "Kratos, factors": ("s", ":"),
    "Kratos, AMGCL": ("D", "-."),
    "GetFEM, factors": ("^", "--"),
    "NGSolve, factors": ("v", (0, (1, 3))),
}
Row = dict[str, Any]


def nodal_forces(problem: Any) -> np.ndarray:
    """Forces on the slave's nodes along z by residuals of the bulk, of the present displacement."""
    bulk, slave = problem.equations.bulk, problem.equations.contacts[0].slave
    bulk.assemble_residual()
    free = np.where(bulk.prescribed, 0.0, bulk.r.array_r).reshape(-1, 3)
    forces = free[slave.nodes, 2]
    return forces * np.sign(forces.sum())


def pressure_by_areas(problem: Any) -> np.ndarray:
    """Nodal forces over the integrals of the shape functions of facets of degree 1."""
    slave = problem.equations.contacts[0].slave
    first, *_, third = slave.X[slave.facets].transpose(1, 0, 2)[:3]
    ahead, diagonal = slave.X[slave.facets[:, 1]] - first, third - first
    whole = np.linalg.norm(np.cross(ahead, diagonal), axis=1)
    # rectangles and triangles: an equal share of the area for each node
    share = whole / (4.0 if slave.facets.shape[1] == 4 else 6.0)
    count = slave.facets.shape[1]
    return nodal_forces(problem) / np.bincount(slave.facets.ravel(), np.repeat(share, count))


def errors(problem: Any, pressure: np.ndarray, hertz: Hertz) -> tuple[float, float]:
    """Relative error of the force, and of the pressure at the slave's nodes over the largest."""
    slave = problem.equations.contacts[0].slave
    force = 4.0 * nodal_forces(problem).sum()
    squares = (np.square(slave.X[:, :2]) / np.square(hertz[:2])).sum(axis=1)
    inner = squares < 0.81
    difference = pressure[inner] / hertz.p0 - np.sqrt(1.0 - squares[inner])
    return force / hertz.force - 1.0, np.sqrt(np.mean(np.square(difference)))


def ours(kind: Kind, n: int) -> Row:
    """A row of this package."""
    start = time.process_time()
    posed, found, iterations = pose(SCENES["sphere"], kind, n), [], []
    problem, spent = posed.problem, time.process_time() - start
    for hertz in loads(SCENES["sphere"]):
        posed.press(hertz)
        start = time.process_time()
        iterations.append(problem.solve().num_iterations)
        spent += time.process_time() - start
        found.append(errors(problem, problem.contacts[0].pressure, hertz))
    return row(OURS, kind, n, spent, iterations, found, problem)


def of_peer(peer: str, solver: str, kind: Kind, n: int) -> Row:
    """A row of another code."""
    posed, found, iterations = pose(SCENES["sphere"], kind, n), [], []
    problem = posed.problem
    upper = problem.equations.contacts[0].pair.data
    body = upper.cell_tags.find(upper.body_tag("upper"))
    posed.press(loads(SCENES["sphere"])[0])
    arrays = given(problem, body, E, NU, deformed=peer == "getfem")
    start = time.process_time()
    make = import_module(f"demos.studies.accuracy.peer_{peer}").pose
    solve = make(arrays) if solver == "auto" else make(arrays, solver)
    spent = time.process_time() - start
    for hertz in loads(SCENES["sphere"]):
        posed.press(hertz)
        values, start = prescribed(problem), time.process_time()
        answer = solve(values)
        spent += time.process_time() - start
        iterations.append(answer.iterations)
        problem.equations.bulk.u.x.array[:] = answer.u.ravel()
        found.append(errors(problem, pressure_by_areas(problem), hertz))
    code = f"{NAMES[peer]}, {'AMGCL' if solver == 'iterative' else 'factors'}"
    return row(code, kind, n, spent, iterations, found, problem)


def row(
    code: str,
    kind: Kind,
    n: int,
    seconds: float,
    iterations: list[int],
    found: Sequence[tuple[float, float]],
    problem: Any,
) -> Row:
    """Names of the columns and their values."""
    force, pressure = np.sqrt(np.mean(np.square(found), axis=0))
    cells = {"code": code, "cells": kind.name, "n": n, "dofs": problem.equations.bulk.r.getSize()}
    cells |= {"force": float(force), "pressure": float(pressure), "iterations": iterations}
    return cells | {"seconds": seconds}


def line(cells: Row) -> str:
    """A row of the table."""
    percent = (f"{100.0 * cells[name]:.2f}" for name in ("force", "pressure"))
    ends = [str(cells["iterations"]), f"{cells['seconds']:.2f}"]
    starts, dofs = [cells[name] for name in ("code", "cells", "n")], f"{cells['dofs']:,}"
    return f"| {' | '.join(map(str, [*starts, dofs, *percent, *ends]))} |"


def measure(peer: str | None, finest: int) -> list[Row]:
    """Rows of one code; a warm-up on the coarsest mesh is left out."""
    rows: list[Row] = []
    for kind in KINDS if peer is None else KINDS[:2]:
        for solver, last in SOLVERS[peer or OURS].items():
            sizes = [n for n in kind.counts if n * kind.degree <= min(finest, last)]
            for n in [sizes[0], *sizes]:
                try:
                    cells = of_peer(peer, solver, kind, n) if peer else ours(kind, n)
                except (MortarError, RuntimeError, NotImplementedError) as error:
                    print(f"{kind.name}, n = {n}: {error}", flush=True)
                    continue
                rows.append(cells)
                print(line(cells), flush=True)
            del rows[-len(sizes) - 1]
    return rows


def draw(rows: Sequence[Row]) -> None:
    """Errors of force and pressure against seconds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.6), layout="constrained")
    *panels, key = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 0.45))
    for axes, name in zip(panels, ("force", "pressure"), strict=True):
        plot(axes, rows, name)
    key.axis("off")
    key.legend(*panels[0].get_legend_handles_labels(), fontsize=9, loc="center left")
    figure.savefig(FOLDER / "chart.png", dpi=130)


def plot(axes: Axes, rows: Sequence[Row], name: str) -> None:
    """One error of all codes."""
    for code, (marker, dashes) in STYLES.items():
        for kind, colour in COLOURS.items():
            some = [r for r in rows if (r["code"], r["cells"]) == (code, kind)]
            if some:
                seconds, error = ([r[key] for r in some] for key in ("seconds", name))
                style = {"marker": marker, "linestyle": dashes, "color": colour}
                axes.loglog(seconds, 100.0 * np.array(error), label=f"{code}, {kind}", **style)
    axes.set_xlabel("seconds of the processor, three loads")
    axes.set_ylabel(f"error of the {name} [%]")
    axes.grid(alpha=0.3, which="both")


def main() -> None:
    """Measure one code, and draw all that were stored."""
    parser = argparse.ArgumentParser(description="Hertz's sphere, error against seconds.")
    parser.add_argument("--peer", choices=tuple(NAMES))
    parser.add_argument("--finest", type=int, default=16, help="largest n times degree")
    parser.add_argument("--redraw", action="store_true", help="measure nothing")
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    if not options.redraw:
        print("| code | cells | n | dofs | force [%] | pressure [%] | iterations | s |")
        print("|---|---|---:|---:|---:|---:|---:|---:|", flush=True)
        rows = measure(options.peer, options.finest)
        text = "".join(json.dumps(cells) + "\n" for cells in rows)
        (FOLDER / f"{options.peer or OURS}.jsonl").write_text(text)
    files = sorted(FOLDER.glob("*.jsonl"))
    draw([json.loads(text) for file in files for text in file.read_text().splitlines()])


if __name__ == "__main__":
    main()
