# SPDX-License-Identifier: MIT
"""Adaptive refinement by the error estimate, compared with uniform meshes.

    python3 -m demos.studies.accuracy.adapt            degree 1 and 2
    python3 -m demos.studies.accuracy.adapt --quick    fewer levels

Problem of Hertz with exact solution: solve, estimate, mark, create a new mesh with smaller cells in
place of the marked ones, until the error of the pressure is that of the finest uniform mesh. Writes
``adapt.md`` and ``adapt.png`` to ``results/accuracy``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from matplotlib.figure import Figure

import fenics_mortar as fm
from demos.studies.accuracy.exact_hertz import HalfPlanes
from demos.studies.accuracy.norms import errors
from demos.studies.accuracy.posed import Choice
from demos.studies.accuracy.scenes_exact import HALF_SIDE, hertz_on
from fenics_mortar.utils import compat
from meshes._shared import add_lines, add_points, add_surface, generate
from meshes.with_gmsh import gmsh

Row = dict[str, Any]
Size = Callable[[float, float], float]
SIDE = HALF_SIDE * HalfPlanes().a
# Growth of the cell size with distance [1]
GROWTH = 0.4
# Fraction of the squared estimate in the marked cells, and factor of their size [1]: in small
# steps, so that the last mesh is not much finer than necessary
PART, FACTOR = 0.3, 0.6
COLOURS = {"P1": "#0072b2", "P2": "#d55e00"}


def boxes(size: Size, degree: int) -> Any:
    """Mesh of the two boxes with cells of the given sizes; the upper one rests on a parabola."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.add("boxes")
    bodies, boundaries = {}, {}
    for name, y in (("upper", (0.0, SIDE)), ("lower", (-SIDE, 0.0))):
        corners = [(-SIDE, y[0]), (SIDE, y[0]), (SIDE, y[1]), (-SIDE, y[1])]
        lines = add_lines(add_points(corners), closed=True)
        bodies[name] = [add_surface(lines, "triangle")]
        for side, line in zip(("bottom", "right", "top", "left"), lines):
            boundaries[f"{name}/{side}"] = [line]
    model = generate(bodies, boundaries, lambda dim, tag, x, y: size(x, y))
    model.mesh.setOrder(degree)
    data = fm.read_gmsh(model, MPI.COMM_SELF)
    gmsh.finalize()
    x = data.mesh.geometry.x
    cells = data.cell_tags.find(data.body_tag("upper"))
    nodes = np.unique(compat.geometry_dofmap(data.mesh)[cells])
    x[nodes, 1] += x[nodes, 0] ** 2 / (2 * HalfPlanes().R) * (1 - x[nodes, 1] / SIDE)
    return data


def corners_of(mesh: Any) -> np.ndarray:
    """Corners of all triangles, shape (cells, 3, 2)."""
    return mesh.geometry.x[compat.geometry_dofmap(mesh)[:, :3], :2]


def refined(mesh: Any, marked: np.ndarray) -> Size:
    """Smaller sizes in the marked cells, unchanged elsewhere, with limited growth."""
    corners = corners_of(mesh)
    edges = corners[:, 1:] - corners[:, :1]
    sizes = np.sqrt(2 * np.abs(np.linalg.det(edges)) / np.sqrt(3))
    sizes[marked] *= FACTOR
    x, y = corners.mean(axis=1).T

    def size(px: float, py: float) -> float:
        return float((sizes + GROWTH * np.hypot(x - px, y - py)).min())

    return size


def solve(size: Size, element: str) -> tuple[Row, Any, Any]:
    """Errors and estimate on a new mesh."""
    data = boxes(size, int(element[1]))
    posed = hertz_on(data, Choice(element))
    posed.problem.solve()
    estimate = posed.problem.estimate()
    found = errors(posed)
    row = {"dofs": posed.u.x.array.size, "energy": found["energy"], "pressure": found["pressure"]}
    row |= {"estimate": estimate.relative, "effectivity": estimate.relative / found["energy"]}
    return row, estimate, data.mesh


def uniform(element: str, sizes: Sequence[float]) -> list[Row]:
    return [solve(lambda x, y, h=h: h, element)[0] for h in sizes]


def adaptive(element: str, size: float, goal: float, most: int = 60) -> tuple[list[Row], Any]:
    """Solve, mark, refine until the pressure error is ``goal``; return all rows and the mesh."""
    rows, field = [], lambda x, y: size
    for _ in range(most):
        row, estimate, mesh = solve(field, element)
        rows.append(row)
        if row["pressure"] <= goal:
            break
        field = refined(mesh, estimate.mark(PART))
    return rows, mesh


def table(runs: dict[tuple[str, str], list[Row]]) -> str:
    """All solves, in Markdown."""
    names = ["dofs", "pressure", "energy", "estimate", "effectivity"]
    lines = [f"| element | mesh | {' | '.join(names)} |", "|---|---|" + "---:|" * len(names)]
    for (element, kind), rows in runs.items():
        for row in rows:
            cells = [f"{row['dofs']}", *(f"{row[name]:.2e}" for name in names[1:4])]
            cells.append(f"{row['effectivity']:.2f}")
            lines.append(f"| {element} | {kind} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def saved(runs: dict[tuple[str, str], list[Row]], element: str) -> float:
    """Unknowns of the finest uniform mesh over those of the first graded mesh of equal accuracy."""
    return runs[element, "uniform"][-1]["dofs"] / runs[element, "graded"][-1]["dofs"]


def draw(runs: dict[tuple[str, str], list[Row]], mesh: Any) -> Figure:
    """Errors of pressure and energy over dofs, and the last mesh around the contact."""
    figure = Figure((11.0, 4.2), layout="constrained")
    *axes, picture = figure.subplots(1, 3, width_ratios=(1, 1, 1.15))
    for axis, name in zip(axes, ("pressure", "energy")):
        for (element, kind), rows in runs.items():
            dofs, style = (
                [row["dofs"] for row in rows],
                {"color": COLOURS[element], "ms": 3.5, "lw": 1.2},
            )
            line = "o-" if kind == "graded" else "o--"
            axis.loglog(
                dofs, [row[name] for row in rows], line, label=f"{element}, {kind}", **style
            )
            if name == "energy":
                axis.loglog(dofs, [row["estimate"] for row in rows], "x", **style)
        axis.set(xlabel="unknown displacements", ylabel=f"relative error: {name}")
        axis.grid(True, which="major", color="#dddddd", lw=0.6)
    axes[0].legend(frameon=False, fontsize=8, handlelength=3.5)
    axes[1].plot([], [], "x", color="#666666", label="estimate")
    axes[1].legend(frameon=False, fontsize=8, handlelength=3.5)
    picture.triplot(*mesh.geometry.x[:, :2].T, compat.geometry_dofmap(mesh)[:, :3], lw=0.3, c="k")
    a = HalfPlanes().a
    picture.plot([-a, a], [0, 0], color=COLOURS["P2"], lw=1.5)
    picture.set(
        aspect="equal",
        xlim=(-SIDE, SIDE),
        ylim=(-SIDE, SIDE),
        title="last P2 mesh; orange: contact",
    )
    picture.set_axis_off()
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer levels")
    levels = 3 if parser.parse_args().quick else 5
    runs: dict[tuple[str, str], list[Row]] = {}
    for element in COLOURS:
        sizes = [0.4 / 2**k for k in range(levels - (element == "P2"))]
        runs[element, "uniform"] = uniform(element, sizes)
        goal = runs[element, "uniform"][-1]["pressure"]
        runs[element, "graded"], mesh = adaptive(element, sizes[0], goal)
    folder = Path("results/accuracy")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "adapt.md").write_text(table(runs))
    draw(runs, mesh).savefig(folder / "adapt.png", dpi=150, bbox_inches="tight")
    print(table(runs))
    for element in COLOURS:
        print(f"{element}: graded meshes take {saved(runs, element):.1f} times fewer unknowns")


if __name__ == "__main__":
    main()
