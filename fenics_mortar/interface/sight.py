# SPDX-License-Identifier: MIT
"""Limits of the search behind a slave surface, from the present outlines of a pair's bodies.

Without a limit, the back of a plate would find partners through the plate. Such a partner is
farther behind the slave surface than half the thickness of both bodies together, see
``kernels.sight`` and, of faces, ``kernels.space.sight``. Thicknesses are measured in the present
state, since bodies bend and are compressed.

Up to a safe depth the limit is not evaluated. The cost per iteration is therefore that of gathering
the outlines, which include the positions of both surfaces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.interface.behind import BodiesBehind
from fenics_mortar.interface.outline import Outline
from fenics_mortar.kernels import sight
from fenics_mortar.kernels.space import sight as space_sight
from fenics_mortar.kernels.tree import build_tree
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.rounding import ROUNDING

# Safe depth over the undeformed thickness behind a facet [1]; the depth is at most the facet's
# length. Bodies are not compressed to a smaller fraction, nor bent within a shorter length.
SAFE = 0.25


class Sight:
    """Outlines of the bodies of a slave and a master surface.

    Args:
        outline: Outlines of the bodies of all pairs; tied bodies have a common number.
        slave, master: The surfaces, ``Curve`` or ``Faces``.
        normals: Normals of the slave nodes in the undeformed mesh, shape (slave nodes, dim).

    Attributes:
        outline: Outlines of the bodies of the two surfaces.
    """

    def __init__(self, outline: Outline, slave: Any, master: Any, normals: Array) -> None:
        bodies = [outline.bodies_of(side) for side in (slave, master)]
        self.outline = outline = outline.of_bodies(np.unique(np.concatenate(bodies)))
        self._slave_bodies, self._master_bodies = bodies
        self._of_slave, self._of_master = map(outline.indices_of, (slave.nodes, master.nodes))
        self._segment_bodies = outline.segment_bodies
        lengths = np.empty(len(slave.facets))
        at = slave.X, normals, slave.facets, bodies[0], self._arrays(outline.X), ROUNDING, lengths
        (sight if slave.dim == 2 else space_sight).tabulate_lengths(*at)
        self._safe = np.minimum(SAFE * lengths, slave.facet_sizes)

    def _arrays(self, x: Array) -> tuple[Any, ...]:
        """Argument ``outline`` of the kernels for outlines with nodes at ``x`` (b, dim)."""
        segments = self.outline.segments
        arrays = x, segments, self._segment_bodies
        if x.shape[1] == 2:
            return arrays
        boxes = build_tree(x, segments)
        return *arrays, boxes, np.empty(len(boxes) // 2, np.int64)

    def behind_at(self, u: Array | None) -> tuple[BodiesBehind, Array, Array]:
        """The bodies behind the slave at a displacement (collective).

        Args:
            u: Displacement, shape (local dofs,) [length]; None for the undeformed state.

        Returns:
            The bodies, and displacements of slave and master nodes, each (nodes, dim) [length].
        """
        X = self.outline.X
        moved = np.zeros_like(X) if u is None else self.outline.gather(u)
        behind = BodiesBehind(
            self._safe, self._slave_bodies, self._master_bodies, self._arrays(X + moved)
        )
        return behind, moved[self._of_slave], moved[self._of_master]
