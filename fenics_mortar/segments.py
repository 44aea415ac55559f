# SPDX-License-Identifier: MIT
"""Which slave facet meets which master facet, and on which interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fenics_mortar.kernels import search
from fenics_mortar.surfaces import Array, Indices, Surface

# Facets covered by less than this (in xi) are left out; overlaps below it are rounding.
LEAST_COVER = 1e-10
# A facet counts as fully covered if less than this (in xi) is missing; its dual basis is then
# that of the whole facet.
FULL_COVER = 1e-12


@dataclass(frozen=True)
class Segments:
    """Segments of some slave facets, found at given positions.

    Attributes:
        facets: Slave facets looked at, shape (f,).
        partial: Whether the multiplier functions of a facet move with its segments, shape (f,): it
            is curved, or a part of it has no partner.
        offsets: Segments of facet i are offsets[i]:offsets[i + 1], shape (f + 1,).
        pair_offsets: The same for the pairs of segments coupled by these functions, (f + 1,).
        slave: Slave nodes of each segment, shape (n, K).
        master: Master nodes, shape (n, K).
        end_is_node: Whether the lower / upper end is a slave node, shape (n, 2); else it is the
            partner of the last / first master node.
        pairs: Segments (i, k) of which M of i depends on the nodes of k, shape (p, 2).
    """

    facets: Indices
    partial: npt.NDArray[np.bool_]
    offsets: Indices
    pair_offsets: Indices
    slave: Indices
    master: Indices
    end_is_node: npt.NDArray[np.bool_]
    pairs: Indices

    @property
    def num_segments(self) -> int:
        """Number of segments."""
        return self.slave.shape[0]


def find_segments(
    slave: Surface,
    master: Surface,
    x: Array,
    n: Array,
    m: Array,
    *,
    facets: Indices,
    radius: float,
    least_cosine: float,
) -> Segments:
    """Find the segments of the given slave facets.

    Args:
        slave: The side that carries the multiplier.
        master: The side projected to.
        x: Current positions of the slave nodes, shape (slave nodes, 2) [length].
        n: Unit normals of the slave nodes, shape (slave nodes, 2).
        m: Current positions of the master nodes, shape (master nodes, 2) [length].
        facets: Slave facets to look at, shape (f,).
        radius: Farthest distance along the normal, on either side [length].
        least_cosine: Least cosine between the slave's normal and the reversed master's.

    Returns:
        The segments; where several master facets lie over one another, the nearest.

    Note:
        Local: no communication.
    """
    offsets, master_facets, end_is_node, ends = search.find_segments(
        (x, n, m), slave.facets[facets], master.facets, radius, (least_cosine, LEAST_COVER)
    )
    counts = np.diff(offsets)
    owner = np.repeat(np.arange(facets.size), counts)
    cover = np.bincount(owner, ends[:, 1] - ends[:, 0], facets.size)
    partial = (cover < 2.0 - FULL_COVER) | (slave.degree > 1)
    pair_counts = np.where(partial, counts**2, counts)
    pair_offsets = np.concatenate([[0], np.cumsum(pair_counts)])
    return Segments(
        facets,
        partial,
        offsets,
        pair_offsets,
        slave.facets[facets][owner],
        master.facets[master_facets],
        end_is_node,
        _pairs(offsets, pair_counts, partial),
    )


def _pairs(offsets: Indices, pair_counts: Indices, partial: npt.NDArray[np.bool_]) -> Indices:
    """Segments (i, k) of each pair, k running fastest within a facet."""
    counts = np.diff(offsets)
    facet = np.repeat(np.arange(counts.size), pair_counts)
    place = np.arange(facet.size) - np.repeat(np.cumsum(pair_counts) - pair_counts, pair_counts)
    count = np.maximum(counts[facet], 1)
    i = np.where(partial[facet], place // count, place)
    k = np.where(partial[facet], place % count, place)
    return offsets[facet][:, None] + np.stack([i, k], axis=1)
