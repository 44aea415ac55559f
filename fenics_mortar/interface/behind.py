# SPDX-License-Identifier: MIT
"""Bodies behind the facets of a slave surface, which limit the search; see ``outline``."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.utils.arrays import Array, Indices


class BodiesBehind(NamedTuple):
    """Bodies behind the facets of a slave surface: arguments of the kernels.

    Attributes:
        safe: Depth behind each slave facet up to which all partners count, shape (f,) [length].
        slave_bodies: Bodies of the slave facets, shape (f,).
        master_bodies: Bodies of the master facets, shape (m,).
        outline: Present positions of the nodes (b, dim) [length], segments (p, dim) with the body
            on the left, and bodies of the segments (p,); in space also a tree and space for hits.
    """

    safe: Array
    slave_bodies: Indices
    master_bodies: Indices
    outline: tuple[Any, ...]

    def of(self, facets: Indices) -> BodiesBehind:
        """The bodies behind the slave facets with the numbers ``facets`` (k,)."""
        return self._replace(safe=self.safe[facets], slave_bodies=self.slave_bodies[facets])


def nothing_behind(num_facets: int) -> BodiesBehind:
    """No bodies behind ``num_facets`` slave facets: no limits of the search."""
    none: Indices = np.empty(0, np.int64)
    outline = np.empty((0, 2)), np.empty((0, 2), np.int64), none
    return BodiesBehind(np.full(num_facets, np.inf), none, none, outline)
