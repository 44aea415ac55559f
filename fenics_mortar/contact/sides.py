# SPDX-License-Identifier: MIT
"""The two surfaces of a pair: extraction, checks, substitutes of nodes without weight."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.interface.measures import POINTS
from fenics_mortar.interface.on_obstacle import surface_without_nodes
from fenics_mortar.interface.surfaces import Surface, extract_surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils.arrays import Indices
from fenics_mortar.utils.errors import SurfaceError, format_point


def surfaces_of(pair: Any, space: DisplacementSpace, welds: Indices) -> tuple[Surface, Surface]:
    """Slave and master of a pair (collective).

    Both are the same object if the surface may touch itself. The surface of an obstacle has no
    nodes.

    Args:
        pair: The pair.
        space: Nodes and dofs of the displacement.
        welds: Pairs of nodes to be merged, shape (k, 2); see ``Surface.welded``.

    Raises:
        SurfaceError: On all ranks, if the surfaces share nodes.
    """
    tags = pair.data.facet_tags
    extracted = extract_surface(space, tags, pair.slave_tags, pair.slave_name)
    slave = extracted.welded(welds)
    if pair.master is None:
        return slave, slave
    if isinstance(pair.master, Obstacle):
        master = surface_without_nodes(slave, pair.master_name)
    else:
        on_master = pair.data.boundary_tags(pair.master)
        master = extract_surface(space, tags, on_master, pair.master_name)
    master = master.welded(welds)
    _check_that_they_differ(slave, master)
    return slave, master


def _check_that_they_differ(slave: Surface, master: Surface) -> None:
    both = np.intersect1d(slave.nodes, master.nodes)
    if both.size:
        where = slave.X[np.flatnonzero(slave.nodes == both[0])[0]]
        raise SurfaceError(
            f"slave '{slave.name}' and master '{master.name}' share "
            f"{both.size} nodes, one at {format_point(where)}; expected different surfaces that "
            "are not joined in the mesh"
        )


def substitutes_of(slave: Surface, *, at_vertices: bool) -> tuple[Indices, Indices]:
    """Nodes without weight, and the next nodes that may have a multiplier, each (k,)."""
    alone, step = np.flatnonzero(slave.weightless), slave.degree if at_vertices else 1
    before, after = slave.along(alone, range(-step, step + 1, 2 * step)).T
    return alone, np.where(after >= 0, after, before)


def points_per_segment(pair: Any, slave: Surface, master: Surface) -> int:
    """Gauss points per segment, with "elements" per facet.

    Error of a uniform pressure with "elements", independent of the mesh: 0.1 % with 5 points on
    facets with two nodes; 5 % with 5 and 0.4 % with 10 points on facets with three. With fewer
    points than nodes the dual functions of a facet may not exist.

    Raises:
        ValueError: If the points of the pair are fewer than the nodes of a facet.
    """
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
