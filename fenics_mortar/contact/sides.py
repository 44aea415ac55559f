# SPDX-License-Identifier: MIT
"""The two surfaces of a pair: extraction, checks, substitutes of nodes without weight."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.contact.discretization import PRESETS, Discretization
from fenics_mortar.interface.curve_surface import TURN, turn_between
from fenics_mortar.interface.extraction import extract_surface
from fenics_mortar.interface.faces import Faces
from fenics_mortar.interface.on_obstacle import surface_without_nodes
from fenics_mortar.interface.surfaces import POINTS, Surface
from fenics_mortar.kernels.space.shapes import ALLOWED, FINE, FINE_QUADRATIC, LINEAR, QUADRATIC
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import SurfaceError, format_point

# Distance of the middles of a quadrilateral's diagonals over the root of its area [1], above which
# 7 points are too few: where edges of both sides almost coincide their common point moves fast, the
# error of the quadrature with it, and Newton's method does not settle below that error.
DISTORTED = 0.05


def surfaces_of(pair: Any, space: DisplacementSpace, welds: Indices) -> tuple[Any, Any]:
    """Slave and master of a pair (collective).

    Both are the same object if the surface may touch itself. The surface of an obstacle has no
    nodes.

    Args:
        pair: The pair.
        space: Nodes and dofs of the displacement.
        welds: Pairs of nodes to be merged, shape (k, 2); see ``Surface.welded``.

    Raises:
        SurfaceError: On all ranks, if the surfaces share nodes other than tips of cracks.
    """
    tags = pair.data.facet_tags
    extracted = extract_surface(space, tags, pair.slave_tags, pair.slave_name)
    slave = extracted.welded(welds)
    if pair.master is None:
        return slave, slave
    if isinstance(pair.master, Obstacle):
        without_nodes = surface_without_nodes if slave.dim == 2 else Faces.without_nodes
        master = without_nodes(slave, pair.master_name)
    else:
        on_master = pair.data.boundary_tags(pair.master)
        master = extract_surface(space, tags, on_master, pair.master_name)
    master = master.welded(welds)
    _check_shared_nodes(slave, master)
    return slave, master


def _check_shared_nodes(slave: Any, master: Any) -> None:
    """Check that only tips of cracks are shared, where both surfaces end and fold back (local)."""
    j, turns = turns_at_shared(slave, master)
    wrong = np.flatnonzero(~(turns < TURN))
    if slave.dim == 3 and wrong.size:
        raise SurfaceError(
            f"slave '{slave.name}' and master '{master.name}' share {wrong.size} nodes, one at "
            f"{format_point(slave.X[j[wrong[0]]])}; expected surfaces of bodies that are not "
            "joined in the mesh: `fragment` and `removeDuplicateNodes` join them, and cracks in "
            "space are not supported"
        )
    if wrong.size:
        reason = (
            "bodies are joined by nodes that both have, as after `fragment` or "
            "`removeDuplicateNodes`; the faces of a crack share its tips, where both end, and "
            "have different nodes everywhere else, as by gmsh's plugin Crack"
            if np.isnan(turns[wrong]).any()
            else "they meet at a corner of one body and do not face each other"
        )
        raise SurfaceError(
            f"slave '{slave.name}' and master '{master.name}' share {wrong.size} nodes, one at "
            f"{format_point(slave.X[j[wrong[0]]])}; expected different surfaces that are not "
            f"joined in the mesh: {reason}"
        )


def turns_at_shared(slave: Any, master: Any) -> tuple[Indices, Array]:
    """Nodes of the slave that are in both surfaces, and turns of the outline there (local).

    Returns:
        Their numbers in the slave, shape (k,), and turns to the left [radian], negative at the tip
        of a crack; nan unless one surface ends where the other begins, shape (k,).
    """
    j, l = equal_pairs(slave.nodes, master.nodes)
    j, l = (k[(j != l) | (slave is not master)] for k in (j, l))
    turns = np.full(j.size, np.nan)
    if slave.dim == 3:
        return j, turns
    for before, i, after, k in ((slave, j, master, l), (master, l, slave, j)):
        ends = np.flatnonzero((before.following[i] < 0) & (after.previous[k] < 0))
        i, k = i[ends], k[ends]
        start = before.along(i, range(-before.degree, 0))[:, 0]
        stop = after.along(k, range(after.degree, after.degree + 1))[:, 0]
        turns[ends] = turn_between(before.X[i] - before.X[start], after.X[stop] - after.X[k])
    return j, turns


def equal_pairs(a: Indices, b: Indices) -> tuple[Indices, Indices]:
    """All positions with a[j] == b[l], in the order of j and then l, each (k,) (local).

    Numbers may occur several times; no array of all pairs is needed.
    """
    order = np.argsort(b, kind="stable")
    first, stop = (np.searchsorted(b, a, side, order) for side in ("left", "right"))
    counts = stop - first
    before = np.cumsum(counts) - counts
    at = np.arange(counts.sum()) + np.repeat(first - before, counts)
    return np.repeat(np.arange(a.size), counts), order[at]


def at_tips(slave: Any, master: Any) -> Flags:
    """Whether a slave node is also one of the other face, at the tip of a crack, (slave nodes,).

    It has no gap, and therefore no multiplier.
    """
    j, turns = turns_at_shared(slave, master)
    found = np.zeros(slave.num_nodes, bool)
    found[j[turns < TURN]] = True
    return found


def substitutes_of(slave: Any, *, at_vertices: bool) -> tuple[Indices, Indices]:
    """Nodes without weight, and the next nodes that may have a multiplier, each (k,)."""
    if slave.dim == 3:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    alone, step = np.flatnonzero(slave.weightless), slave.degree if at_vertices else 1
    before, after = slave.along(alone, range(-step, step + 1, 2 * step)).T
    return alone, np.where(after >= 0, after, before)


def points_per_segment(pair: Any, slave: Surface, master: Surface) -> int:
    """Gauss points per segment, with "elements" per facet, in space per triangle of common parts.

    Error of a uniform pressure with "elements", independent of the mesh: 0.1 % with 5 points on
    facets with two nodes; 5 % with 5 and 0.4 % with 10 points on facets with three. With fewer
    points than nodes the dual functions of a facet may not exist.

    Raises:
        ValueError: If the points of the pair are fewer than the nodes of a facet.
    """
    if slave.dim == 3:
        return _points_in_space(pair.discretization, slave, master)
    choice, degree = pair.discretization, slave.degree
    points = choice.points
    if points is None:
        on_facets = choice.integration == "elements" and master.num_nodes > 0
        return POINTS * (degree if on_facets else 1)
    if points <= degree:
        raise ValueError(
            f"points={points}: expected at least one per node of a facet, {degree + 1}"
        )
    return int(points)


def _points_in_space(choice: Discretization, slave: Any, master: Any) -> int:
    """Points of the rule of a triangle, see ``Discretization`` (local).

    Raises:
        ValueError: If there is no rule with the chosen number for these facets.
    """
    points = choice.points
    allowed = [n for n in ALLOWED if n >= slave.facets.shape[1]]
    if points is None:
        distorted = max(slave.distortion, master.distortion) > DISTORTED
        few, many = (LINEAR, FINE) if slave.degree == 1 else (QUADRATIC, FINE_QUADRATIC)
        as_others = choice == PRESETS["other_codes"]
        aligned = slave is master  # sides of a fold have the same mesh, edges coincide
        return many if (distorted or aligned) and not as_others else few
    if points not in allowed:
        raise ValueError(
            f"points={points}: expected one of {', '.join(map(str, allowed))}, the points of the "
            f"rules of a triangle, at least one per node of a facet of '{slave.name}'"
        )
    return int(points)
