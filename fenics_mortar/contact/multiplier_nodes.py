# SPDX-License-Identifier: MIT
"""Which slave nodes of a contact carry a multiplier.

A node held in one component, whose normal is about along the other one, lies on a symmetry plane:
by symmetry its normal is along the free component. If its normal is oblique, it is held for another
reason, and keeps its normal. A node held along its normal, or altogether, carries no multiplier.

A node that the master hardly covers hands its multiplier function to a neighbour. Its own
multiplier z_j bears a force w_j z_j that does not vanish with its weight w_j, so that it grows
without bound as the cover vanishes. Scaled rows keep the linear systems regular; they do not keep
z_j small, nor the active set settled. An edge pressed by 2 % and slid past 2.5 slave nodes in 40
steps (block on block, mean pressure 1.4):

==========================  ==========  ================  ================
41 load steps               friction    handed over       never
==========================  ==========  ================  ================
iterations                  0           129, at most 4    134, at most 6
largest nodal pressure      0           9.6               671
iterations                  0.3         132, at most 5    156, at most 12
largest nodal pressure      0.3         24                5e4
steps without solution      0.3         0                 2
==========================  ==========  ================  ================

Total forces agree to 0.6 %. A gradual transfer, s Phi_j to the node and (1 - s) Phi_j to its
neighbour, would not help: for s > 0 these functions span the same space as before.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.utils.arrays import Array, Indices

# A slave node held in one component lies on a symmetry plane if the cosine between its normal and
# the free component is above the first (20 degrees), and is held along its normal if below the
# second.
PLANE_COSINE, HELD_COSINE = 0.94, 0.1
# Covered fraction of a node below which it hands its multiplier to one that is covered more.
HAND_OVER = 0.05
# Changes of one node in one solve: with and without its multiplier the cover may be on the other
# side of HAND_OVER, and the iteration would not end.
MAX_CHANGES = 4
# Fraction of HAND_OVER by which the cover may change with the multiplier.
VERGE = 0.1


def normals_on_planes(normals: Array, free: Array) -> Array:
    """Normals of nodes on symmetry planes, nan elsewhere, shape (nodes, 2).

    Args:
        normals: Normals of the undeformed surface, shape (nodes, 2).
        free: 1 where a component of a node is not prescribed, else 0, shape (nodes, 2).
    """
    half_held = free.sum(axis=1) == 1.0
    on_plane = half_held & (np.abs(normals * free).max(axis=1) > PLANE_COSINE)
    return np.where(on_plane[:, None], np.sign(normals) * free, np.nan)


class MultiplierNodes:
    """The slave nodes that may carry multipliers, and those that do; equal on all ranks.

    Args:
        slave: The slave surface.
        normals: Normals of the undeformed surface, shape (slave nodes, 2).
        free: 1 where a component of a slave node is not prescribed, else 0, (slave nodes, 2).
        at_vertices: Whether nodes inside facets have no multipliers.

    Attributes:
        possible: Whether a node carries a multiplier if it is covered, shape (slave nodes,), bool.
        oblique: Whether its one prescribed component is neither along nor across its normal, shape
            (slave nodes,), bool.
        plane_normals: Normals on symmetry planes, nan elsewhere, shape (slave nodes, 2).
    """

    def __init__(self, slave: Surface, normals: Array, free: Array, *, at_vertices: bool) -> None:
        self.plane_normals = normals_on_planes(normals, free)
        on_plane, half_held = np.isfinite(self.plane_normals[:, 0]), free.sum(axis=1) == 1.0
        cosine = np.abs(normals * free).max(axis=1)
        self.oblique = half_held & ~on_plane & (cosine > HELD_COSINE)
        self.possible = (free.sum(axis=1) == 2.0) | on_plane | self.oblique
        if at_vertices:
            self.possible &= ~slave.inner
        step = slave.degree if at_vertices else 1
        self._sides = slave.along(np.arange(slave.num_nodes), range(-step, step + 1, 2 * step)).T
        self._changes: Indices = np.zeros(slave.num_nodes, np.int64)

    def begin(self) -> None:
        """Forget how often nodes changed in the last solve."""
        self._changes[:] = 0

    def update(
        self, multiplier_nodes: npt.NDArray[np.bool_], cover: Array
    ) -> npt.NDArray[np.bool_]:
        """Which nodes carry a multiplier from now on (local).

        Args:
            multiplier_nodes: Which ones do at present, shape (slave nodes,).
            cover: The part of each node that is covered, shape (slave nodes,).
        """
        wanted = self.possible & ~((cover < HAND_OVER) & self._helped(cover))
        changed = (wanted != multiplier_nodes) & (self._changes < MAX_CHANGES)
        self._changes += changed
        return np.where(changed, wanted, multiplier_nodes)

    def undecided(self, cover: Array, active: npt.NDArray[np.bool_]) -> Indices:
        """Numbers of the nodes beside active ones that are covered by about ``HAND_OVER``.

        Whether such a node carries a multiplier changes the surface a little, and with it the cover
        that decides on it: with and without, there may be two solutions.
        """
        near = self._helped(cover) & (np.abs(cover - HAND_OVER) < VERGE * HAND_OVER)
        beside = ((self._sides >= 0) & active[self._sides]).any(axis=0)
        return np.flatnonzero(near & beside)

    def _helped(self, cover: Array) -> npt.NDArray[np.bool_]:
        """Whether nodes have neighbours to hand their multipliers to, (slave nodes,), bool."""
        strong = self.possible & (cover > HAND_OVER)
        safe, helped = np.ones(cover.size, bool), np.zeros(cover.size, bool)
        for neighbour in self._sides:
            there = neighbour >= 0
            safe &= ~there | strong[neighbour] | (cover[neighbour] == 0.0)
            helped |= there & strong[neighbour]
        return safe & helped
