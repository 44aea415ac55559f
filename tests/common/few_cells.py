# SPDX-License-Identifier: MIT
"""Two blocks of two, three or five cells in all, so that some of several ranks have none."""

from __future__ import annotations

import numpy as np
from array_meshes import grid
from scenes import TIGHT, internal, neo_hookean

from dolfinx import fem

import fenics_mortar as fm

# Positions of the upper body: beside the lower one, so that no two nodes coincide.
OVER = 0.11
# Columns of cells of the lower and the upper body of squares, by the number of all cells.
COLUMNS = {2: (1, 1), 3: (2, 1), 5: (3, 2)}


def squares(count, left, bottom):
    """A row of squares of height 1 and length 1 in all: corners of cells and nodes."""
    cells, x = grid(count, 1, (left, bottom))
    return cells[:, [0, 1, 3, 2]], x


def lower_triangles(count):
    """One to three triangles under the line y = 1, the left side on the line x = 0."""
    x = np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (1.7, 1.0)])
    return np.array([(0, 2, 1), (0, 3, 2), (3, 4, 2)])[:count], x[: 2 + count]


def upper_triangles(count):
    """One or two triangles on the line y = 1."""
    x = np.array([(0.0, 1.0), (1.0, 1.0), (0.0, 2.0), (1.0, 2.0)]) + np.array([OVER, 0.0])
    return np.array([(0, 1, 2), (1, 3, 2)])[:count], x[: 2 + count]


# Lower and upper body by cell and number of all cells; names and ends of their boundaries.
BODIES = {
    "quadrilateral": lambda lower, upper: (squares(lower, 0.0, 0.0), squares(upper, OVER, 1.0)),
    "triangle": lambda lower, upper: (lower_triangles(lower), upper_triangles(upper)),
}


def with_middles(cells, x):
    """Cells with the middles of their edges, quadrilaterals with their centre, and all nodes."""
    corners = cells.shape[1]
    ends = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2)
    edges, number = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    new = [cells, len(x) + number.reshape(-1, corners)]
    points = [x, x[edges].mean(axis=1)]
    if corners == 4:
        new.append(len(x) + len(edges) + np.arange(len(cells))[:, None])
        points.append(x[cells].mean(axis=1))
    return np.concatenate(new, axis=1), np.concatenate(points)


def facets_where(cells, x, condition):
    """Ends of the outer edges whose ends satisfy a condition, shape (f, 2)."""
    ends = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, count = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
    return edges[(count == 1) & condition(*x[edges].T).all(axis=0)]


def arrays(count, cell="quadrilateral", degree=1):
    """Points, cells, bodies "lower" and "upper" that meet at y = 1, and boundaries.

    "lower/fixed" and "upper/moved" are for Dirichlet conditions, "lower/top" and "upper/bottom" for
    contact.
    """
    (cells, x), (other, y) = BODIES[cell](*COLUMNS[count])
    level = {"quadrilateral": lambda x, y: y, "triangle": lambda x, y: x}[cell]
    far = {"quadrilateral": 2.0, "triangle": OVER}[cell]
    over = {
        "lower/fixed": facets_where(cells, x, lambda x, y: level(x, y) == 0.0),
        "lower/top": facets_where(cells, x, lambda x, y: y == 1.0),
        "upper/bottom": len(x) + facets_where(other, y, lambda x, y: y == 1.0),
        "upper/moved": len(x) + facets_where(other, y, lambda x, y: np.isclose(level(x, y), far)),
    }
    cells, points = np.concatenate([cells, len(x) + other]), np.concatenate([x, y])
    numbers = np.arange(len(cells))
    bodies = {"lower": numbers[: -len(other)], "upper": numbers[-len(other) :]}
    if degree == 2:
        cells, points = with_middles(cells, points)
    return points, cells, bodies, over


def mesh(count, cell="quadrilateral", degree=1):
    """The mesh of ``arrays``, of ``count`` cells together."""
    return fm.mesh_from_arrays(*arrays(count, cell, degree))


def bcs_of(data, V, push):
    """Conditions of the lower body, fixed, and of the upper one, moved by ``push``."""
    return [
        fm.dirichlet(V, data, "lower/fixed", (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/moved", push),
    ]


class Blocks:
    """Two bodies, the lower one fixed, the upper one moved by ``push``.

    Attributes:
        data: Mesh and names.
        u: Displacement.
        push: Prescribed displacement of the upper body.
        problem: The problem.
    """

    def __init__(
        self, count=2, cell="quadrilateral", degree=1, *, pairs=None, law=None,
        material=neo_hookean, data=None, **options,
    ):  # fmt: skip
        self.data = mesh(count, cell, degree) if data is None else data
        V = fm.vector_space(self.data.mesh, degree)
        self.u = fem.Function(V, name="u")
        self.push = fem.Constant(self.data.mesh, (0.0, 0.0))
        residual = internal(self.u, material(self.u, 100.0, 0.3))
        if pairs is None:
            pairs = [fm.ContactPair(self.data, "upper/bottom", "lower/top", law=law)]
        given = {"petsc_options_prefix": "few_", "newton": TIGHT, **options}
        bcs = bcs_of(self.data, V, self.push)
        self.problem = fm.ContactProblem(residual, self.u, pairs, bcs=bcs, **given)

    def press(self, x=0.002, y=-0.02):
        """Solve with the upper body moved."""
        self.push.value[:] = x, y
        return self.problem.solve()
