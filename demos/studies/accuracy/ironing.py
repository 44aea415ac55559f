# SPDX-License-Identifier: MIT
"""Shallow ironing on three meshes: forces compared with the finest mesh and published values.

    python3 -m demos.studies.accuracy.ironing            P1, Q1 and P2, with and without friction
    python3 -m demos.studies.accuracy.ironing --quick    one mesh each, no orders

A round indenter goes 1 mm down, 0.8 mm of it into a block ten times softer, and 5 mm along it
(geometry and material after Yastrebov 2011). No exact solution is known. Without friction the force
at a position does not depend on the path: it is compared with that of the finest mesh, at positions
that correspond to different points of a facet. With an error C h^p on three meshes, each with half
the size h of the previous one, the ratio of the differences from the finest mesh is 2^p + 1, which
determines p.

With Coulomb's friction, mu = 0.3, there are published curves: Fischer and Wriggers (2006), Hartmann
et al. (2009), Yastrebov (2011), Poulios and Renard (2015), Code_Aster and solids4foam, collected
with the tutorial "shallowIroning" of solids4foam. They differ by a quarter in the vertical and by
more in the horizontal force. The only requirement is therefore that computed forces lie between
them; the vertical force without friction does so, too. Writes ``ironing.md`` to
``results/accuracy``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.accuracy.posed import ELEMENTS
from demos.studies.accuracy.report import FOLDER, markdown
from demos.studies.common import neo_hookean
from fenics_mortar.energies import lame
from meshes import indenter_on_block
from meshes.with_gmsh import gmsh

E, NU, STIFFER = 689.6, 0.32, 10.0
FRICTION = 0.3
# Facets of the block's top of degree 1, half as many of degree 2
SIZES = (40, 80, 160)
# Times: down from 0 to 1, 10 mm along from 1 to 2. Steps of a path with friction.
FIXED = (1.0, 1.11, 1.23, 1.37, 1.5)
PUBLISHED_AT = (0.5, 1.0, 1.5)
STEP = 0.02
# Smallest and largest published force at these times [N]: vertical, horizontal
BAND = {
    "V(0.5)": (81.5, 96.2),
    "V(1)": (267.9, 332.0),
    "H(1)": (55.0, 71.0),
    "V(1.5)": (337.4, 421.0),
    "H(1.5)": (102.1, 188.8),
}


def pose(element: str, n: int, law: fm.Law | None = None) -> tuple[fm.ContactProblem, Any]:
    """The problem on a mesh of n facets of degree 1, and the motion of the indenter's top."""
    cell, degree = ELEMENTS[element]
    size = n // degree
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    model = indenter_on_block.build(
        cell=cell,
        n_block=size,
        layers_block=size // 5,
        n_indenter=2 * (size // 10),
        layers_indenter=size // 10,
        grading=4.0,
    )
    model.mesh.setOrder(degree)
    data = fm.read_gmsh(model, MPI.COMM_SELF)
    gmsh.finalize()
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    rule = {"quadrature_degree": 2 * degree}
    dx = ufl.Measure("dx", data.mesh, subdomain_data=data.cell_tags, metadata=rule)
    mu, lmbda = lame(E, NU)
    work = ufl.inner(neo_hookean(u, mu, lmbda), ufl.grad(v))
    residual = work * dx(data.body_tag("block")) + STIFFER * work * dx(data.body_tag("indenter"))
    tool = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "indenter/top", tool))
    pair = fm.ContactPair(data, "block/top", "indenter/arc", law=law)
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="ironing_"), tool


def forces(
    element: str, n: int, times: Sequence[float], law: fm.Law | None = None, step: float = 0.1
) -> tuple[np.ndarray, int]:
    """Forces on the indenter along and up at some times (times, 2) [N / mm], and dofs."""
    problem, tool = pose(element, n, law)

    def move(time: float) -> None:
        tool.value[:] = 10.0 * max(time - 1.0, 0.0), -min(time, 1.0)

    found = []
    for start, stop in pairwise((0.0, *times)):
        fm.follow_path(problem, move, fm.SteppingOptions(step), start=start, stop=stop)
        found.append(-problem.equations.contacts[0].total_force)
    return np.array(found), problem.equations.bulk.u.x.array.size


def rate(coarse: float, middle: float) -> float:
    """Order of an error from the differences of two meshes from the finest of three."""
    ratio = coarse / middle - 1.0
    return float(np.log2(ratio)) if ratio > 0.0 else np.nan


def self_convergence(elements: Sequence[str], sizes: Sequence[int]) -> str:
    """Vertical forces without friction, their differences from the finest mesh, and its order."""
    lines = []
    for element in elements:
        runs = [forces(element, n, FIXED, step=0.05) for n in sizes]
        vertical = np.array([found[:, 1] for found, _ in runs])
        off = np.sqrt(((vertical / vertical[-1] - 1.0) ** 2).mean(axis=1))
        for n, (_, dofs), values, distance in zip(sizes, runs, vertical, off):
            cells = [element, str(n), str(dofs), *(f"{value:.2f}" for value in values)]
            cells.append(f"{distance:.1e}" if distance else "")
            lines.append([*cells, f"{rate(*off[:2]):.2f}" if n == sizes[-1] > sizes[1] else ""])
    times = " | ".join(f"V({time:g})" for time in FIXED)
    return markdown(f"element | n | dofs | {times} | from the finest | order", 1, lines)


def against_print(elements: Sequence[str], sizes: Sequence[int], step: float) -> str:
    """Forces with friction, and the smallest and largest published ones."""
    lines = [["published", "", "", *(f"{least:g} to {most:g}" for least, most in BAND.values())]]
    for element in elements:
        for n in sizes:
            found, dofs = forces(element, n, PUBLISHED_AT, fm.Coulomb(FRICTION), step)
            values = dict(zip(BAND, [found[0, 1], found[1, 1], found[1, 0], *found[2, ::-1]]))
            cells = [
                f"{abs(value):.1f}" + ("" if low <= abs(value) <= high else " (outside)")
                for value, (low, high) in zip(values.values(), BAND.values())
            ]
            lines.append([element, str(n), str(dofs), *cells])
    return markdown(f"element | n | dofs | {' | '.join(BAND)}", 1, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the coarsest mesh only")
    sizes = SIZES[:1] if parser.parse_args().quick else SIZES
    elements = ("P1", "Q1", "P2")
    text = "Without friction:\n\n" + self_convergence(elements, sizes)
    text += f"\nWith friction, mu = {FRICTION}:\n\n" + against_print(elements, sizes[:2], STEP)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "ironing.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
