# SPDX-License-Identifier: MIT
"""The cells of this rank: area ratios, deformation gradients, and points inside other bodies."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

from fenics_mortar.bulk.form_points import areas_at, areas_or_nan
from fenics_mortar.bulk.reference_cell import nodal_gradients
from fenics_mortar.kernels.inside import find_inside
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Flags, Indices
from fenics_mortar.utils.errors import count_points
from fenics_mortar.utils.ranks import any_over_ranks, on_any_rank

# Nodes of a cell along its outline, by the number of nodes: dolfinx orders corners, edges,
# interior; those of quadrilaterals as a tensor product.
OUTLINE = {3: [0, 1, 2], 4: [0, 1, 3, 2], 6: [0, 5, 1, 3, 2, 4], 9: [0, 4, 1, 6, 3, 7, 2, 5]}


class Cells:
    """The owned cells of a space of plane vectors, in the reference state.

    Args:
        V: Space of the displacement.

    Attributes:
        X: Reference positions of the local nodes, ghosts included, shape (n, 2) [length].
    """

    def __init__(self, V: Any) -> None:
        self._comm: MPI.Comm = V.mesh.comm
        self._nodes = compat.dofmap(V)[: V.mesh.topology.index_map(2).size_local]
        self.X: Array = V.tabulate_dof_coordinates()[:, :2].copy()
        self._gradients = nodal_gradients(V)
        self._outline = np.array(OUTLINE[len(self._gradients)])
        self._undeformed_areas = areas_or_nan(self.X, self._nodes, self._gradients)

    def area_ratios(self, x: Array) -> Array:
        """Deformed over undeformed area at the nodes of the cells, (cells, nodes) (local).

        Args:
            x: Positions of the local nodes, shape (n, 2) [length].

        Returns:
            Ratios; nan at nodes where the undeformed cell has no area.
        """
        return areas_at(x, self._nodes, self._gradients) / self._undeformed_areas

    def hoop_strains(self, x: Array) -> Array:
        """Mean strain around the axis x = 0 of the cells, shape (cells,) (local).

        Args:
            x: Positions of the local nodes, shape (n, 2) [length].
        """
        now, before = (place[self._nodes, 0].mean(axis=1) for place in (x, self.X))
        return now / before - 1.0

    def count(self, marks: Flags) -> tuple[int, str]:
        """Number of marked owned cells, shape (cells,), and the position of one (collective).

        The position is that of the reference state, as text.
        """
        if not on_any_rank(self._comm, bool(marks.any())):
            return 0, "nowhere"
        return count_points(self._comm, self.X[self._nodes[marks]].mean(axis=1))

    def flat(self) -> tuple[int, str]:
        """Number of undeformed cells without area, and the position of one (collective)."""
        return self.count(np.isnan(self._undeformed_areas).all(axis=1))

    def deformation_gradients(self, x: Array) -> Array:
        """F at positions ``x`` (n, 2), averaged over the nodes, shape (cells, 2, 2) [1] (local)."""
        return np.einsum("eka,ekb->eab", x[self._nodes], self._shape_gradients)

    @cached_property
    def _shape_gradients(self) -> Array:
        """d(shape functions)/dX, averaged over a cell's nodes, (cells, nodes, 2) [1 / length]."""
        jacobian = np.einsum("eka,nkb->enab", self.X[self._nodes], self._gradients)
        gradients = np.einsum("nkb,enba->ekna", self._gradients, np.linalg.inv(jacobian))
        return np.asarray(gradients.mean(axis=2))

    def inside_other_body(
        self, x: Array, points: Array, bodies: Indices | Array, labels: Indices
    ) -> Flags:
        """Whether points lie inside a cell of another body than their own (collective).

        Args:
            x: Positions of the local nodes, shape (n, 2) [length].
            points: Positions, equal on all ranks, shape (p, 2) [length].
            bodies: Body of each point, shape (p,).
            labels: Body of each local node, negative for bodies that do not count, shape (n,).

        Returns:
            Flags, equal on all ranks, shape (p,).
        """
        inside = np.zeros(len(points), bool)
        if len(points) and len(self._nodes):
            find_inside(x, self._nodes, labels, self._outline, points, bodies, inside)
        return any_over_ranks(self._comm, inside)
