# SPDX-License-Identifier: MIT
"""Hanging nodes, which are refused; cracks, slits and touching bodies, which are not."""

from time import process_time

import numpy as np
import pytest
from array_meshes import grid
from refusal import COMM, refused

import fenics_mortar as fm
from fenics_mortar.mesh.edges import check_hanging_nodes
from meshes.mapped_grids import Grid, mapped
from meshes.mapped_grids import mesh as made

# The first hanging node, as text of a message, by the number of fine cells beside a coarse one.
ALONG_1 = {2: r"\(1, 0.25\)", 3: r"\(1, 0.1667\)"}


def joined(*grids):
    """Quadrilaterals (as in gmsh) of several grids, which have nodes of equal positions once."""
    cells, first, x = [], 0, []
    for own, nodes in grids:
        cells.append(own[:, [0, 1, 3, 2]] + first)
        x, first = [*x, nodes], first + len(nodes)
    x, cells = np.concatenate(x), np.concatenate(cells)
    _, one, number = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)
    return x[one], number.ravel()[cells]


def of_triangles(x, cells):
    return x, np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])


def of_second_order(x, cells):
    """With middles of edges and, of quadrilaterals, centres."""
    edges = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    parts = [x, x[edges].mean(axis=1)]
    columns = [cells, len(x) + number.reshape(cells.shape)]
    if cells.shape[1] == 4:
        columns.append(len(x) + len(edges) + np.arange(len(cells))[:, None])
        parts.append(x[cells].mean(axis=1))
    return np.concatenate(parts), np.hstack(columns)


def mesh_of(x, cells, **boundaries):
    bodies = {"body": np.arange(len(cells))}
    given = (x, cells, bodies, boundaries) if COMM.rank == 0 else (None,) * 4
    return fm.mesh_from_arrays(*given)


@pytest.mark.each
@pytest.mark.parametrize("ratio", [2, 3])
@pytest.mark.parametrize("triangles", [False, True])
@pytest.mark.parametrize("order", [1, 2])
def test_hanging_nodes_are_refused_with_their_place(ratio, triangles, order):
    """Two coarse cells beside 2 ``ratio`` fine ones; both sides have nodes at y = 0, 0.5 and 1."""
    x, cells = joined(grid(2, 2), grid(ratio, 2 * ratio, (1.0, 0.0)))
    x, cells = of_triangles(x, cells) if triangles else (x, cells)
    x, cells = of_second_order(x, cells) if order == 2 else (x, cells)
    where = f"{2 * (ratio - 1)} hanging nodes: node 7 at {ALONG_1[ratio]} lies inside the edge"
    with refused(fm.MeshError, where, "divide this cell at the node, too"):
        mesh_of(x, cells)


@pytest.mark.parametrize("angle", [0.3, 2.5])
def test_hanging_nodes_on_inclined_edges_are_refused(angle):
    c, s = np.cos(angle), np.sin(angle)
    x, cells = joined(grid(2, 2), grid(3, 3, (1.0, 0.0)))
    with refused(fm.MeshError, "3 hanging nodes: node 7 at"):
        mesh_of(x @ np.array([[c, s], [-s, c]]) + 10.0, cells)


def test_hanging_node_at_the_end_of_the_finer_side_is_refused():
    """The fine cells end at y = 0.75, inside an edge of a coarse cell."""
    x, cells = joined(grid(2, 2), grid(3, 3, (1.0, 0.0), (1.0, 0.75)))
    with refused(fm.MeshError, r"2 hanging nodes: node 7 at \(1, 0.25\)"):
        mesh_of(x, cells)


def test_hanging_node_on_a_curved_edge_is_refused():
    """Second order: halves of a parabola beside the whole one."""
    a, b, m = np.array([(1.0, 0.0), (0.0, 1.0), (0.7, 0.7)])

    def at(t):
        return a * (1 - t) * (1 - 2 * t) + b * t * (2 * t - 1) + m * 4 * t * (1 - t)

    far, half = np.array([1.5, 1.5]), at(0.5)
    x = np.array(
        [a, b, (0.0, 0.0), m, (0.0, 0.5), (0.5, 0.0), half, far, at(0.25), at(0.75),
         (half + far) / 2, (a + far) / 2, (b + far) / 2]
    )  # fmt: skip
    cells = np.array([(0, 1, 2, 3, 4, 5), (0, 7, 6, 11, 10, 8), (6, 7, 1, 10, 12, 9)])
    with refused(fm.MeshError, r"1 hanging nodes: node 6 at \(0.7, 0.7\).* node 0 to node 1 of"):
        mesh_of(x, cells)
    x[6] += 1e-3  # not on the edge: a hole
    mesh_of(x, cells)


def test_bodies_that_touch_with_other_nodes_are_accepted():
    (lower, x), (upper, y) = grid(2, 2), grid(3, 3, (0.0, 1.0))
    cells = np.concatenate([lower, len(x) + upper])[:, [0, 1, 3, 2]]
    assert mesh_of(np.concatenate([x, y]), cells).mesh.topology.index_map(2).size_global == 13


def test_nodes_far_from_curved_edges_are_found_without_overflow():
    """The foot of such a node on a parabola is nowhere; the iterates for it grew without bound."""

    def wheel(s, t):
        angle, r = np.pi / 2 * (s**1.5 - 1.0), 1.0 - 0.7 * t
        return r * np.cos(angle), 1.0 + r * np.sin(angle)

    ground = mapped(14, 8, lambda s, t: (1.2 * s**1.5, -0.8 + 0.8 * t))
    with np.errstate(over="raise", invalid="raise"):
        made([Grid("wheel", mapped(12, 6, wheel)), Grid("ground", ground)], order=2)


@pytest.mark.parametrize("columns", [(2, 3, 4), (4, 5, 6)], ids=["inside", "to the outside"])
def test_cracks_with_two_nodes_at_each_place_are_accepted(columns):
    x, cells = joined(grid(6, 2, size=(6.0, 1.0)))
    upper = x[cells].mean(axis=1)[:, 1] > 0.5
    for column in columns:
        node = int(np.flatnonzero(np.isclose(x, (column, 0.5)).all(axis=1))[0])
        cells[upper] = np.where(cells[upper] == node, len(x), cells[upper])
        x = np.concatenate([x, x[[node]]])
    mesh_of(x, cells)


@pytest.mark.parametrize("both", [True, False])
def test_slits_with_other_nodes_are_accepted_if_their_sides_have_names(both):
    """The two sides of the slit have their ends in common only."""
    x, cells = joined(grid(2, 2, size=(6.0, 2.0)), grid(3, 2, (0.0, 2.0), (6.0, 2.0)))
    ends = [[(0, 2.0), (3, 2.0), (6, 2.0)], [(0, 2.0), (2, 2.0), (4, 2.0), (6, 2.0)]]
    chains = [
        [int(np.flatnonzero(np.isclose(x, p).all(axis=1))[0]) for p in chain] for chain in ends
    ]
    sides = [np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains]
    if both:
        mesh_of(x, cells, under=sides[0], over=sides[1])
        return
    for names in ({}, {"under": sides[0]}, {"all": np.concatenate(sides)}):
        with refused(fm.MeshError, "3 hanging nodes", "boundaries of different names"):
            mesh_of(x, cells, **names)


@pytest.mark.serial
def test_hanging_nodes_in_a_file_are_refused(tmp_path):
    file = tmp_path / "hanging.msh"
    x, cells = joined(grid(1, 1), grid(2, 2, (1.0, 0.0)))
    nodes = "".join(f"{i + 1}\n" for i in range(len(x))) + "".join(f"{a} {b} 0\n" for a, b in x)
    rows = "".join(
        f"{i + 1} {' '.join(str(n + 1) for n in cell)}\n" for i, cell in enumerate(cells)
    )
    file.write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 1 \"body\"\n$EndPhysicalNames\n"
        "$Entities\n0 0 1 0\n1 0 0 0 2 1 0 1 1 0\n$EndEntities\n"
        f"$Nodes\n1 {len(x)} 1 {len(x)}\n2 1 0 {len(x)}\n{nodes}$EndNodes\n"
        f"$Elements\n1 {len(cells)} 1 {len(cells)}\n2 1 3 {len(cells)}\n{rows}$EndElements\n"
    )  # fmt: skip
    with refused(fm.MeshError, r"1 hanging nodes: node \d at \(1, 0.5\)"):
        fm.read_gmsh(file, COMM)


@pytest.mark.serial
def test_the_time_of_the_search_grows_with_the_number_of_cells():
    none, times = (np.empty((0, 2), np.int64), np.empty(0, np.int32)), []
    for n in (100, 400):
        x, cells = joined(grid(n, n))
        best = np.inf
        for _ in range(3):
            start = process_time()
            check_hanging_nodes(x, cells, *none)
            best = min(best, process_time() - start)
        times.append(best)
    # Of the processor: 16 times as many cells; 256 pairs for each pair.
    assert times[1] < 80.0 * times[0]
