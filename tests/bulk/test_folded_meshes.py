# SPDX-License-Identifier: MIT
"""Meshes that cover an area twice, and similar valid meshes."""

import gmsh
import numpy as np
import pytest
from array_meshes import blocks_of_arrays, grid, mesh_of, problem_on, tagged, triangles
from one_rank import COMM
from refusal import refused
from scenes import linear_elastic, neo_hookean, read, rectangles

from dolfinx import fem

import fenics_mortar as fm


def strip_across_itself():
    """Squares one after the other, joined to the last two only; nodes of others coincide."""
    places = [
        (0, 0),
        (1, 0),
        (2, 0),
        (3, 0),
        (3, 1),
        (3, 2),
        (2, 2),
        (1, 2),
        (1, 1),
        (1, 0),
        (1, -1),
    ]
    cells, x = [], []
    for column, row in places:
        joined = {tuple(x[node]): node for cell in cells[-2:] for node in cell}
        cell = []
        for corner in ((0, 0), (1, 0), (0, 1), (1, 1)):
            at = column + corner[0], row + corner[1]
            if at not in joined:
                joined[at] = len(x)
                x.append(at)
            cell.append(joined[at])
        cells.append(cell)
    return np.array(cells), np.array(x, float)


def folded(kind):
    """Cells, nodes and kind of cells of a mesh that covers an area twice, or of a valid one."""
    cells, x = grid(8, 4)
    cell = "quadrilateral"
    if kind == "a second copy":
        more, again = grid(8, 4, first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, again])
    elif kind == "an inclusion without a hole":
        more, inner = grid(2, 2, (0.4, 0.4), (0.2, 0.2), first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, inner])
    elif kind == "a turned cell":
        cells[5] = cells[5][[0, 1, 3, 2]]
    elif kind == "a node too far":
        x[22] = 0.9, 0.6
    elif kind == "a node too far, triangles":
        x[22] = 0.9, 0.6
        cells, cell = triangles(cells), "triangle"
    elif kind == "folded back":
        right = x[:, 0] > 0.5
        x[right, 0] = 1.0 - x[right, 0]
    elif kind in ("wound", "wound up"):
        cells, x = grid(60, 2)
        angle, grows = np.radians(400.0) * x[:, 0], 0.3 if kind == "wound up" else 0.1
        radius = 1.0 + 0.2 * x[:, 1] + grows * x[:, 0]
        x = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    elif kind == "a strip on itself":
        cells, x = strip_across_itself()
    elif kind == "in an arc":
        x = np.stack(
            [(2.0 + x[:, 1]) * np.cos(6 * x[:, 0]), (2 + x[:, 1]) * np.sin(6 * x[:, 0])], 1
        )
    elif kind == "side by side":
        more, again = grid(8, 4, (1.0, 0.0), first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, again])
    elif kind == "overlapping in part":
        more, again = grid(8, 4, (0.9, 0.03), first=len(x))
        cells, x = np.concatenate([cells, more]), np.concatenate([x, again])
    elif kind == "turned cells":
        cells[::2] = cells[::2][:, [1, 0, 3, 2]]
    return cells, x, cell


def problem_on_folded(kind):
    cells, x, cell = folded(kind)
    data = tagged(mesh_of(cells, x, cell), base=lambda X: X[1] < 1e-9)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))]
    return problem_on(data, [], material=linear_elastic, u=u, bcs=bcs)


@pytest.mark.each
@pytest.mark.parametrize(
    "kind, message",
    [
        ("a second copy", "covers a place twice: two facets"),
        ("an inclusion without a hole", r"body around \(0.5, 0.5\) lies inside the one around"),
        ("a turned cell", r"1 cells are twisted, one at \(0.6875, 0.125\)"),
        ("a node too far", "cells are twisted"),
        ("a node too far, triangles", "facets have the cells of both sides on the same side"),
        ("folded back", "facets have the cells of both sides on the same side"),
        ("wound", "a body overlaps itself: its outline crosses itself at"),
        ("a strip on itself", "a body overlaps itself: its outline crosses itself at"),
    ],
)
def test_overlapping_cells_are_refused(kind, message):
    with refused(fm.MeshError, message):
        problem_on_folded(kind)


@pytest.mark.parametrize(
    "kind", ["wound up", "in an arc", "side by side", "overlapping in part", "turned cells"]
)
def test_mesh_without_overlapping_cells_is_accepted(kind):
    problem_on_folded(kind)


def test_oversized_shaft_is_an_interference():
    """The outline lies inside the other body, which has a hole at this position."""
    inner, x = grid(3, 3, (-0.51, -0.51), (1.02, 1.02))
    frame, y = grid(6, 6, (-1.5, -1.5), (3.0, 3.0), first=len(x))
    middle = np.abs(np.concatenate([x, y])[frame].mean(axis=1)).max(axis=1) < 0.5
    cells = np.concatenate([inner, frame[~middle]])
    used, numbers = np.unique(cells, return_inverse=True)
    x = np.concatenate([x, y])[used]
    data = tagged(mesh_of(numbers.reshape(cells.shape), x), base=lambda X: X[1] < -1.4)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    problem_on(data, [], material=linear_elastic, u=u)


def test_duplicate_elements_are_refused():
    def twice():
        model = rectangles(0.5, body=(0.0, 0.0, 1.0, 1.0))
        _, _, (nodes,) = model.mesh.getElements(2)
        top = int(model.mesh.getElements(2)[1][0].max()) + 1
        model.mesh.addElementsByType(model.getEntities(2)[0][1], 2, [top], nodes[[1, 2, 0]])
        return model

    with refused(fm.MeshError, r"1 cells are duplicates, one at \("):
        read(twice)
    if COMM.rank == 0:
        gmsh.finalize()


def test_negative_stiffness_is_reported():
    def minus(u, E, nu):
        return -neo_hookean(u, E, nu)

    with refused(fm.MortarError, "all stiffnesses are negative: check the signs"):
        problem_on(blocks_of_arrays(), material=minus)
