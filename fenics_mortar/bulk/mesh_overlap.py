# SPDX-License-Identifier: MIT
"""Check at the set-up of a problem that the mesh covers no point of the plane twice.

A mesh of straight cells covers each point at most once if

- the two cells of each inner facet lie on opposite sides of it, and no cell is twisted: otherwise
  the mesh is folded at the facet;
- the outline of a body does not cross itself: otherwise the body overlaps itself without a fold,
  for example a strip wound by more than one turn;
- no two facets of the outlines coincide with their bodies on the same side, and no body lies
  completely inside another one: otherwise two bodies occupy the same area, for example an inclusion
  and a matrix without a hole.

Partly overlapping bodies are accepted as interference, and so are paired surfaces of one body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dolfinx import mesh as dmesh

from fenics_mortar.bulk.bodies import label_bodies
from fenics_mortar.bulk.cells import OUTLINE
from fenics_mortar.contact.interface import Interface
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MeshError, count_points, format_point
from fenics_mortar.utils.lines import lines_cross, near, near_pairs
from fenics_mortar.utils.rounding import SAME_PLACE


class _Outline(NamedTuple):
    """Facets of the outlines of all bodies, equal on all ranks.

    ``start``, ``end``: ends, the body on the left, ``inner``: middle of its cell, each (n, 2);
    ``body``: number of the body (n,).
    """

    start: Array
    end: Array
    inner: Array
    body: Indices


def check_mesh_overlap(V: Any, contacts: Sequence[Interface]) -> None:
    """Reject a mesh that covers a point twice (collective; facets are compared to 1e-6).

    Args:
        V: Space of the displacement.
        contacts: The pairs, whose surfaces may overlap.

    Raises:
        MeshError: On all ranks; the message has a position.
    """
    mesh = V.mesh
    mesh.topology.create_connectivity(1, 2)
    count = compat.num_corners(mesh)
    cells = compat.geometry_dofmap(mesh)[:, :count].astype(np.int64)
    x = mesh.geometry.x[:, :2]
    sides = _sides(mesh, x, cells, mesh.topology.index_map(2).size_local)
    _refuse(mesh, "cells are twisted", _twisted(x, cells))
    _refuse(
        mesh,
        "facets have the cells of both sides on the same side: the mesh is folded there",
        _folded(mesh, sides),
    )
    _check_outline(_outline(V, x, cells, sides), contacts)


def _refuse(mesh: Any, what: str, positions: Array) -> None:
    count, where = count_points(mesh.comm, positions)
    if count:
        raise MeshError(f"{count} {what}, one at {where}; correct the mesh")


def _twisted(x: Array, cells: Indices) -> Array:
    """Midpoints of the cells whose corners turn in different directions, (n, 2) (local)."""
    corners = x[cells[:, OUTLINE[cells.shape[1]]]]
    after = np.roll(corners, -1, axis=1) - corners
    before = np.roll(after, 1, axis=1)
    turns = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    smallest = SAME_PLACE * np.abs(turns).max(axis=1, initial=0.0)
    both = (turns.min(axis=1, initial=0.0) < -smallest) & (
        turns.max(axis=1, initial=0.0) > smallest
    )
    return np.asarray(corners[both].mean(axis=1))


class _Sides(NamedTuple):
    """The facets of local cells, one row per cell and facet.

    ``facet``: local number; ``ends``: positions of its ends, the one with the lower number
    in the mesh input first, (n, 2, 2); ``side``: 1 if the cell lies on the left, else -1; ``cell``.
    """

    facet: Indices
    ends: Array
    side: Array
    cell: Indices


def _sides(mesh: Any, x: Array, cells: Indices, owned: int) -> _Sides:
    """Side of each facet on which its cell lies, for the first ``owned`` cells (local)."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim, tdim - 1)
    table = mesh.topology.connectivity(tdim, tdim - 1)
    count = cells.shape[1]
    facets = table.array[: owned * count].reshape(-1, count)
    # dolfinx: facet i of a triangle is opposite to corner i, those of a quadrilateral 01 02 13 23.
    local = {3: [[1, 2], [0, 2], [0, 1]], 4: [[0, 1], [0, 2], [1, 3], [2, 3]]}[count]
    nodes = cells[:owned][:, local].reshape(-1, 2)
    given = np.asarray(mesh.geometry.input_global_indices)[nodes]
    nodes = np.where((given[:, :1] < given[:, 1:]), nodes, nodes[:, ::-1])
    ends = x[nodes]
    middle = np.repeat(x[cells[:owned]].mean(axis=1), count, axis=0)
    along, inward = ends[:, 1] - ends[:, 0], middle - ends[:, 0]
    side = np.sign(along[:, 0] * inward[:, 1] - along[:, 1] * inward[:, 0])
    return _Sides(facets.ravel().astype(np.int64), ends, side, np.repeat(np.arange(owned), count))


def _folded(mesh: Any, sides: _Sides) -> Array:
    """Midpoints of the owned facets whose two cells lie on the same side, (n, 2) (collective).

    Without ghost cells, a rank has only one cell of a facet between two ranks; such facets are
    gathered.
    """
    index_map = mesh.topology.index_map(1)
    sums, count = np.zeros((2, index_map.size_local + index_map.num_ghosts))
    np.add.at(sums, sides.facet, sides.side)
    np.add.at(count, sides.facet, 1.0)
    first = np.unique(sides.facet, return_index=True)[1]
    middles = np.full((sums.size, 2), np.nan)
    middles[sides.facet[first]] = sides.ends[first].mean(axis=1)
    wrong = middles[(np.abs(sums) > 1.0) & (count > 1.0)]
    outer = dmesh.exterior_facet_indices(mesh.topology)
    once = np.setdiff1d(np.flatnonzero(count == 1.0), outer).astype(np.int32)
    if mesh.comm.size == 1:
        return wrong
    number = index_map.local_to_global(once)
    everywhere = mesh.comm.allgather((number, sums[once]))
    numbers, signs = (np.concatenate(arrays) for arrays in zip(*everywhere, strict=True))
    known, inverse = np.unique(numbers, return_inverse=True)
    total, times = np.bincount(inverse.ravel(), signs), np.bincount(inverse.ravel())
    bad = known[(np.abs(total) > 1.0) & (times > 1)]
    begin, end = index_map.local_range
    mine = once[np.isin(number, bad) & (number >= begin) & (number < end)]
    return np.concatenate([wrong, middles[mine]])


def _outline(V: Any, x: Array, cells: Indices, sides: _Sides) -> _Outline:
    """The outlines of all bodies, on all ranks (collective)."""
    mesh = V.mesh
    labels, _ = label_bodies(V)
    outer = np.isin(sides.facet, dmesh.exterior_facet_indices(mesh.topology))
    ends = np.where(sides.side[:, None, None] > 0.0, sides.ends, sides.ends[:, ::-1])[outer]
    body = labels[compat.dofmap(V)[sides.cell[outer], 0]]
    inner = x[cells[sides.cell[outer]]].mean(axis=1)
    everywhere = mesh.comm.allgather((ends, inner, body))
    ends, inner, body = (np.concatenate(arrays) for arrays in zip(*everywhere, strict=True))
    return _Outline(ends[:, 0], ends[:, 1], inner, body)


def _check_outline(outline: _Outline, contacts: Sequence[Interface]) -> None:
    """Reject outlines that cross themselves, coincide or enclose each other (local)."""
    start, end, _, body = outline
    pairs = near_pairs(start, end)
    middles, along = 0.5 * (start + end), end - start
    lengths = np.linalg.norm(along, axis=1)
    i, j = pairs.T
    near = np.linalg.norm(middles[i] - middles[j], axis=1) <= SAME_PLACE * lengths[i]
    same = np.linalg.norm(along[i] - along[j], axis=1) <= SAME_PLACE * lengths[i]
    if (near & same).any():
        where = middles[i[np.argmax(near & same)]]
        raise MeshError(
            f"the mesh covers an area twice: two facets of outlines coincide at "
            f"{format_point(where)}, with their bodies on the same side; remove the copy"
        )
    paired = _on_surfaces(outline, contacts)
    pairs = pairs[(body[i] == body[j]) & ~(paired[i] & paired[j])]
    crosses = lines_cross(start, end, pairs, SAME_PLACE)
    after = _following(outline)
    i, j = pairs.T
    separate = (after[i] != j) & (after[j] != i) & ~crosses
    touches = np.flatnonzero(separate)[lines_cross(start, end, pairs[separate], touching=True)]
    crosses[touches] = _cross_at_nodes(outline, after, pairs[touches])
    if crosses.any():
        where = middles[pairs[np.argmax(crosses), 0]]
        raise MeshError(
            f"a body overlaps itself: its outline crosses itself at {format_point(where)}; correct "
            "the mesh"
        )
    _check_nested(outline)


def _following(outline: _Outline) -> Indices:
    """Next facet of the same body along the outline, or the facet itself, (n,) (local)."""
    keys = [
        [(*x, body) for x, body in zip(ends.tolist(), outline.body.tolist(), strict=True)]
        for ends in (outline.start, outline.end)
    ]
    first = {key: i for i, key in enumerate(keys[0])}
    return np.array([first.get(key, i) for i, key in enumerate(keys[1])], np.int64)


def _cross_at_nodes(outline: _Outline, after: Indices, pairs: Indices) -> npt.NDArray[np.bool_]:
    """Whether the outline crosses itself at a node of one of two touching facets, (k,) (local).

    In this case the line through the facet and the previous or next one crosses the other facet, or
    the line through the other facet and its neighbour.
    """
    start, end = outline.start, outline.end
    before = np.arange(len(after))
    before[after] = np.arange(len(after))
    i, j = pairs.T
    found = np.zeros(len(pairs), bool)
    for one in ((i, i), (i, after[i]), (before[i], i)):
        for other in ((j, j), (j, after[j]), (before[j], j)):
            lines = np.concatenate([start[one[0]], start[other[0]]])
            ends = np.concatenate([end[one[1]], end[other[1]]])
            both = np.arange(2 * len(pairs)).reshape(2, -1).T
            found |= lines_cross(lines, ends, both, SAME_PLACE)
    return found


def _on_surfaces(outline: _Outline, contacts: Sequence[Interface]) -> npt.NDArray[np.bool_]:
    """Whether facets of the outline belong to a surface of a pair, (n,) (local)."""
    sides = [side for contact in contacts for side in (contact.slave, contact.master)]
    known = [side.X[side.facets[:, [0, -1]]].mean(axis=1) for side in sides if len(side.facets)]
    if not known or not len(outline.start):
        return np.zeros(len(outline.start), bool)
    middles = 0.5 * (outline.start + outline.end)
    lengths = np.linalg.norm(outline.end - outline.start, axis=1)
    positions, radius = np.concatenate(known), max(lengths.min(), SAME_PLACE * lengths.max())
    i, j = near(middles, positions, float(radius))
    close = np.linalg.norm(middles[i] - positions[j], axis=1) <= SAME_PLACE * lengths[i]
    found = np.zeros(len(middles), bool)
    found[i[close]] = True
    return found


def _check_nested(outline: _Outline) -> None:
    """Reject a body inside another one that has no hole for it (local)."""
    start, end, inside, body = outline
    bodies = np.unique(body)
    boxes = {b: (start[body == b].min(axis=0), start[body == b].max(axis=0)) for b in bodies}
    for inner in bodies:
        for outer in bodies:
            (low, high), (lower, higher) = boxes[inner], boxes[outer]
            if inner == outer or not ((low > lower).all() and (high < higher).all()):
                continue
            mine, other = body == inner, body == outer
            if _inside(inside[mine], start[other], end[other]).all() and not (
                _inside(start[other], start[mine], end[mine]).any()
            ):
                raise MeshError(
                    f"the body around {format_point(start[mine].mean(axis=0))} lies inside the one "
                    f"around {format_point(start[other].mean(axis=0))}, which has no hole there: "
                    "cut one"
                )


def _inside(points: Array, start: Array, end: Array) -> npt.NDArray[np.bool_]:
    """Whether points (n, 2) lie in an outline, by the facets that a ray from each crosses."""
    inside = np.zeros(len(points), bool)
    for k, (x, y) in enumerate(points):
        meets = (start[:, 1] > y) != (end[:, 1] > y)
        a, b = start[meets], end[meets]
        at = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        inside[k] = (at > x).sum() % 2 == 1
    return inside
