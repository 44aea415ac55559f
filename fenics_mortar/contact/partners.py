# SPDX-License-Identifier: MIT
"""Partners of slave nodes at an accepted state, from the rows of D and M or the nearest facets."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array

from fenics_mortar.contact.arcs import orientation
from fenics_mortar.contact.slip import Measure, Pairing, Partners, centre_of
from fenics_mortar.interface.facing import face, nearest_facets
from fenics_mortar.interface.mortar import MortarOperators
from fenics_mortar.interface.on_obstacle import ObstacleOperators
from fenics_mortar.utils.arrays import Array, Indices

# Rows, columns and values of a matrix.
Entries = tuple[Indices, Indices, Array]


def find_partners(
    o: Any,
    faces: npt.NDArray[np.bool_],
    measure: Measure = "partners",
    *,
    least: Array,
    master_planes: Array | None,
    between: bool = False,
) -> Partners:
    """Partners at the state of ``o`` (collective).

    Args:
        o: Operators of the accepted state.
        faces: Slave nodes with rows in D and M, shape (slave nodes,), bool.
        measure: Measure of slip, see ``slip``.
        least: See ``Partners``.
        master_planes: Normals of master nodes on symmetry planes, nan elsewhere, (nodes, 2);
            ``None`` if surfaces do not rotate.
        between: Whether to find ``Partners.facing``.
    """
    none = np.zeros(len(o.x))
    if isinstance(o, ObstacleOperators):
        feet = o.nearest_points()
        own, place = o.obstacle.to_own_frame(feet), o.obstacle.place.copy()
        start = o.x - centre_of(o.obstacle)
        on_obstacle = csr_array(np.eye(len(o.x))), csr_array((len(o.x), 0)), start, none
        pairing = Pairing(lambda: on_obstacle)
        at = o.x, o.m, o.weight, least, own, place
        return Partners(pairing, o.n, master_planes, *at, none, none, none, none, none)
    s = o.segments
    per_weight = np.where(faces, 1.0 / np.where(faces, o.weight, 1.0), 0.0)
    on_slave = _replicate(o, o.facet_nodes, o.facet_nodes, o.D, per_weight)
    on_master = _replicate(o, s.slave, s.master, o.M, per_weight)
    present = per_weight if measure == "operators" else none
    vectors = present[:, None] * o.vectors if present.any() else 0.0  # collective

    def build() -> tuple[csr_array, csr_array, Array, Array]:
        own, nearest = _nearest(o, np.flatnonzero(~faces))
        D, M = _sum(own, on_slave, len(o.x), len(o.x)), _sum(nearest, on_master, len(o.x), len(o.m))
        angle = none if master_planes is None else orientation(o, M, master_planes).angle
        return D, M, D @ o.x - M @ o.m - vectors, angle

    facing = face(o, s) if between else None
    at = o.x, o.m, o.weight, least, np.zeros_like(o.x), np.zeros(3)
    return Partners(
        Pairing(build), o.n, master_planes, *at, present, none, none, none, none, facing
    )


def _replicate(
    o: MortarOperators, rows: Indices, columns: Indices, values: Array, scale: Array
) -> Entries:
    """Entries of the blocks (b, K, K) of all ranks with scaled rows, replicated (collective)."""
    used = (values != 0.0) & (scale[rows] != 0.0)[:, :, None]
    i = np.broadcast_to(rows[:, :, None], values.shape)[used]
    k = np.broadcast_to(columns[:, None, :], values.shape)[used]
    mine = i, k, values[used] * scale[i]
    if o.slave.comm.size == 1:
        return mine
    gathered = o.slave.comm.allgather(mine)
    i, k, v = (np.concatenate(column) for column in zip(*gathered, strict=True))
    return i, k, v


def _nearest(o: MortarOperators, j: Indices) -> tuple[Entries, Entries]:
    """Entries of D and M that pair the nodes ``j`` with the line of the nearest master facet."""
    roles = o.slave.roles
    candidates = None if roles is None else roles.masters_of_nodes(o.slave.facets, j)
    ends, fraction = nearest_facets(o.x[j], o.m, o.master, candidates)
    values = np.stack([1.0 - fraction, fraction], axis=1).ravel()
    return (j, j, np.ones(j.size)), (np.repeat(j, 2), ends.ravel(), values)


def _sum(one: Entries, other: Entries, rows: int, columns: int) -> csr_array:
    """Matrix of shape (rows, columns) with the entries of both."""
    i, k, v = (np.concatenate(entries) for entries in zip(one, other, strict=True))
    return coo_array((v, (i, k)), shape=(rows, columns)).tocsr()
