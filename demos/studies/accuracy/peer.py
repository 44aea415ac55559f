# SPDX-License-Identifier: MIT
"""Input of a problem for another code, and evaluation of its results on the problem of Hertz.

The nodes, the cells, the prescribed displacements and the nodal loads are those of our own problem,
as arrays; the errors are those of ``norms.py``, of the peer's displacement and pressure at the same
nodes. Each ``peer_*.py`` in this folder solves it with one code; the problems of
``demos.studies.performance.waits`` are solved by the same functions.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from demos.studies.accuracy.norms import bulk_errors, contact_errors
from demos.studies.accuracy.posed import Choice, Posed
from demos.studies.accuracy.report import SIZES, Row, peer_table, write
from demos.studies.accuracy.scenes_exact import hertz
from fenics_mortar.energies import lame
from fenics_mortar.utils import compat

# Nodes of a cell in the order of most codes, by dimension and number of nodes: corners
# counterclockwise, below and above in space, then the middles of the sides
AROUND = {
    (2, 3): [0, 1, 2],
    (2, 4): [0, 1, 3, 2],
    (2, 6): [0, 1, 2, 5, 3, 4],
    (2, 9): [0, 1, 3, 2, 4, 6, 7, 5, 8],
    (3, 4): [0, 1, 2, 3],
    (3, 8): [0, 1, 3, 2, 4, 5, 7, 6],
}


@dataclass
class Given:
    """The problem as arrays, in the plane or of solids of degree 1 (d = 2 or 3).

    Attributes:
        x: Nodes, shape (n, d) [length].
        cells: Nodes of the cells, counterclockwise, shape (m, nodes of a cell).
        upper: Whether a cell is of the upper body, which has the slave surface, shape (m,).
        slave: Nodes of the slave surface, shape (k,).
        facets: Nodes of its facets, by their numbers in ``slave``, middle last in the plane, around
            the facet in space, shape (f, 2, 3 or 4).
        master: Nodes of the facets of the master surface, likewise, shape (g, 2, 3 or 4).
        prescribed: Whether a component is prescribed, shape (n, d).
        values: Prescribed values, shape (n, d) [length].
        load: Nodal loads, shape (n, d) [stress length^(d - 1)].
        E: Young's modulus of the upper body [stress].
        nu: Poisson's ratio.
        stiffness: Young's modulus of the other body over E [1].
        finite: Whether the bodies are neo-Hookean; else linear elastic.
        deformed: Whether the deformed surfaces are in contact; else displacements are so small that
            partners and normals are those of the undeformed ones.
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
    stiffness: float = 1.0
    finite: bool = False
    deformed: bool = False

    def lame(self, upper: bool = True) -> tuple[float, float]:
        """Lame's parameters mu and lambda of a body [stress]."""
        return lame(self.E * (1.0 if upper else self.stiffness), self.nu)

    def cells_of(self, upper: bool) -> np.ndarray:
        """Nodes of the cells of a body."""
        return self.cells[self.upper == upper]

    def exchanged(self) -> Given:
        """The same problem with the other surface as the slave."""
        slave, facets = np.unique(self.master, return_inverse=True)
        facets, master = facets.reshape(self.master.shape), self.slave[self.facets]
        return replace(self, slave=slave, facets=facets, master=master)


@dataclass
class Answer:
    """Result of a code.

    Attributes:
        u: Displacement, shape (n, d) [length].
        pressure: Pressure at the slave's nodes, shape (k,) [stress].
        iterations: Number of Newton iterations.
        solver: Kind of contact and linear solver.
    """

    u: np.ndarray
    pressure: np.ndarray
    iterations: int
    solver: str


# Solves for prescribed displacements (n, d), from the last solution on
Solve = Callable[[np.ndarray], Answer]
# Creates a code's model; raises if it cannot pose the problem
Pose = Callable[[Given], Solve]


def given(problem: Any, body: np.ndarray, E: float, nu: float, **options: Any) -> Given:
    """Arrays of our own, unsolved problem; ``body``: numbers of the cells of the slave body."""
    bulk, (contact,) = problem.equations.bulk, problem.equations.contacts
    cells = compat.dofmap(bulk.V)
    dim = bulk.space.dim
    cells = cells[:, AROUND[dim, cells.shape[1]]]
    x = bulk.V.tabulate_dof_coordinates()[:, :dim].copy()
    corners = [1, 3, 4] if cells.shape[1] == 8 else range(1, dim + 1)
    edges = x[cells[:, corners]] - x[cells[:, :1]]
    assert np.all(np.linalg.det(edges) > 0.0), "cells must be counterclockwise"
    bulk.assemble_residual()
    upper = np.zeros(len(cells), bool)
    upper[body] = True
    across = contact.slave.facets.shape[1]
    order = [0, -1, 1][: contact.slave.degree + 1] if dim == 2 else range(across)
    return Given(
        x=x,
        cells=cells,
        upper=upper,
        slave=contact.slave.nodes,
        facets=contact.slave.facets[:, order],
        master=contact.master.nodes[contact.master.facets[:, order]],
        prescribed=bulk.prescribed.reshape(-1, dim).copy(),
        values=prescribed(problem),
        load=-bulk.r.array_r.reshape(-1, dim),
        E=E,
        nu=nu,
        **options,
    )


def given_hertz(posed: Posed) -> Given:
    """Arrays of a problem of Hertz."""
    mu, lmbda = posed.lame
    body = posed.data.cell_tags.find(posed.data.body_tag(posed.slave))
    nu = lmbda / (2 * (lmbda + mu))
    return given(posed.problem, body, 2 * mu * (1 + nu), nu)


def prescribed(problem: Any) -> np.ndarray:
    """Present prescribed values, shape (n, d) [length], 0 where there are none."""
    bulk = problem.equations.bulk
    values = np.zeros_like(bulk.r.array_r)
    compat.set_prescribed(values, bulk.bcs)
    return values.reshape(-1, bulk.space.dim)


def areas(problem: Given) -> np.ndarray:
    """Integrals of the shape functions over the slave surface, in the plane per thickness, (k,)."""
    (dim, count), x = (problem.x.shape[1], problem.facets.shape[1]), problem.x[problem.slave]
    first, second, *others = x[problem.facets].transpose(1, 0, 2)
    size = np.linalg.norm(second - first, axis=1)
    shares = [1 / 6, 1 / 6, 2 / 3] if (dim, count) == (2, 3) else count * [1 / count]
    if dim == 3:  # the area of a rectangle or a triangle
        size = np.linalg.norm(np.cross(second - first, others[0] - first), axis=1)
        size *= 1.0 if count == 4 else 0.5
    return np.bincount(problem.facets.ravel(), np.outer(size, shares).ravel())


def measure(name: str, pose: Pose, n: int, element: str, graded: bool, repeats: int) -> Row:
    """Pose and solve ``repeats`` times after a warm-up; errors, median seconds of the processor."""
    posed = hertz(n, Choice(element), graded=graded)
    problem = given_hertz(posed)
    answer, seconds = pose(problem)(problem.values), []
    for _ in range(repeats):
        begin = time.process_time()
        answer = pose(problem)(problem.values)
        seconds.append(time.process_time() - begin)
    posed.u.x.array[:] = answer.u.ravel()
    row: Row = {"code": name, "n": n, "element": element, "graded": graded}
    row |= {"dofs": answer.u.size, "iterations": answer.iterations}
    row |= {"seconds": float(np.median(seconds))}
    found = bulk_errors(posed) | contact_errors(posed, answer.pressure)
    return row | {key: float(value) for key, value in found.items()}


def run(name: str, pose: Pose, elements: Sequence[str]) -> None:
    """Measure on all meshes; write the rows for ``chart.py --redraw`` and print them."""
    parser = argparse.ArgumentParser(description=f"The problem of Hertz, solved by {name}.")
    parser.add_argument("--finest", type=int, default=128, help="facets of the slave: 64, 128, ...")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    sizes = [n for n in SIZES if n <= options.finest]
    rows = [
        measure(name, pose, n, element, graded, options.repeats)
        for element, graded, n in product(elements, (False, True), sizes)
    ]
    write(f"peer_{name.split()[0].lower()}", rows)
    print(peer_table(rows))
