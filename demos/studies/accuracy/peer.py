# SPDX-License-Identifier: MIT
"""Input of the problem of Hertz for another code, and evaluation of its results.

The nodes, the cells, the prescribed displacements and the nodal loads are those of our own problem,
as arrays; the errors are those of ``norms.py``, of the peer's displacement and pressure at the same
nodes. Each ``peer_*.py`` in this folder solves it with one code.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from demos.studies.accuracy.norms import bulk_errors, contact_errors
from demos.studies.accuracy.posed import Choice, Posed
from demos.studies.accuracy.report import SIZES, Row, peer_table, write
from demos.studies.accuracy.scenes_exact import hertz
from fenics_mortar.utils import compat

# Nodes of a cell in the order of most codes: corners counterclockwise, then the middles of the
# sides
AROUND = {3: [0, 1, 2], 4: [0, 1, 3, 2], 6: [0, 1, 2, 5, 3, 4], 9: [0, 1, 3, 2, 4, 6, 7, 5, 8]}


@dataclass
class Given:
    """The problem as arrays.

    Attributes:
        x: Nodes, shape (n, 2) [length].
        cells: Nodes of the cells, counterclockwise, shape (m, nodes of a cell).
        upper: Whether a cell is of the upper body, which has the slave surface, shape (m,).
        slave: Nodes of the slave surface, shape (k,).
        facets: Nodes of its facets, by their numbers in ``slave``, middle last, shape (f, 2 or 3).
        master: Nodes of the facets of the master surface, middle last, shape (g, 2 or 3).
        prescribed: Whether a component is prescribed, shape (n, 2).
        values: Prescribed values, shape (n, 2) [length].
        load: Nodal loads per thickness, shape (n, 2) [stress length].
        E: Young's modulus [stress].
        nu: Poisson's ratio.
    """

    x: np.ndarray
    cells: np.ndarray
    upper: np.ndarray
    slave: np.ndarray
    facets: np.ndarray
    master: np.ndarray
    prescribed: np.ndarray
    values: np.ndarray
    load: np.ndarray
    E: float
    nu: float


@dataclass
class Answer:
    """Result of a code: displacement (n, 2), pressure at the slave's nodes (k,), iterations."""

    u: np.ndarray
    pressure: np.ndarray
    iterations: int


def given(posed: Posed) -> Given:
    """Arrays of our own, unsolved problem."""
    bulk, (contact,) = posed.problem.equations.bulk, posed.problem.equations.contacts
    cells = compat.dofmap(bulk.V)
    cells = cells[:, AROUND[cells.shape[1]]]
    x = bulk.V.tabulate_dof_coordinates()[:, :2].copy()
    tail = x[cells[:, 1]] - x[cells[:, 0]], x[cells[:, 2]] - x[cells[:, 0]]
    assert np.all(np.linalg.det(np.stack(tail, axis=-1)) > 0), "cells must be counterclockwise"
    bulk.assemble_residual()
    mu, lmbda = posed.lame
    tags = np.zeros(len(cells), bool)
    tags[posed.data.cell_tags.find(posed.data.body_tag(posed.slave))] = True
    order = [0, -1, 1][: contact.slave.degree + 1]
    return Given(
        x=x,
        cells=cells,
        upper=tags,
        slave=contact.slave.nodes,
        facets=contact.slave.facets[:, order],
        master=contact.master.nodes[contact.master.facets[:, order]],
        prescribed=bulk.prescribed.reshape(-1, 2).copy(),
        values=prescribed(posed).reshape(-1, 2),
        load=-bulk.r.array_r.reshape(-1, 2),
        E=mu * (3 * lmbda + 2 * mu) / (lmbda + mu),
        nu=lmbda / (2 * (lmbda + mu)),
    )


def prescribed(posed: Posed) -> np.ndarray:
    """Prescribed values of all dofs, 0 where there are none."""
    values = np.zeros_like(posed.u.x.array)
    compat.set_prescribed(values, posed.problem.equations.bulk.bcs)
    return values


def measure(
    name: str, solve: Callable[[Given], Answer], n: int, element: str, graded: bool, repeats: int
) -> Row:
    """Solve ``repeats`` times after a warm-up; errors, and median seconds of the processor."""
    posed = hertz(n, Choice(element), graded=graded)
    problem = given(posed)
    answer, seconds = solve(problem), []
    for _ in range(repeats):
        begin = time.process_time()
        answer = solve(problem)
        seconds.append(time.process_time() - begin)
    posed.u.x.array[:] = answer.u.ravel()
    row: Row = {"code": name, "n": n, "element": element, "graded": graded}
    row |= {"dofs": answer.u.size, "iterations": answer.iterations}
    row |= {"seconds": float(np.median(seconds))}
    found = bulk_errors(posed) | contact_errors(posed, answer.pressure)
    return row | {key: float(value) for key, value in found.items()}


def run(name: str, solve: Callable[[Given], Answer], elements: Sequence[str]) -> None:
    """Measure on all meshes; write the rows for ``chart.py --redraw`` and print them."""
    parser = argparse.ArgumentParser(description=f"The problem of Hertz, solved by {name}.")
    parser.add_argument("--finest", type=int, default=128, help="facets of the slave: 64, 128, ...")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    sizes = [n for n in SIZES if n <= options.finest]
    rows = [
        measure(name, solve, n, element, graded, options.repeats)
        for element, graded, n in product(elements, (False, True), sizes)
    ]
    write(f"peer_{name.split()[0].lower()}", rows)
    print(peer_table(rows))
