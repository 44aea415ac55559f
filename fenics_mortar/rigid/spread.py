# SPDX-License-Identifier: MIT
"""Loads at a point that are spread over a boundary, which stays free to deform.

The mean motion of the nodes k with areas a_k is the rigid one next to their displacements,

    minimize  sum_k a_k |x_k - x_P - R(angle) (X_k - P)|^2.

With means X_0 and x_0, X'_k = X_k - X_0, and the numbers of the plane,

    r (cos, sin)(angle) = sum_k a_k (X'_k . x_k, X'_k x x_k),    x_P = x_0 + R (P - X_0).

The nodal forces are work-conjugate to it: f_k = F . dx_P/dx_k + M dangle/dx_k, that is

    f_k = a_k F / sum(a) + m g_k,    g_k = dangle/dx_k = a_k e_z x R X'_k / r,    m = M + l x F,

with l = R (P - X_0): a traction c + A x with the resultants F and M about the moved pivot. They
depend on angle and r. With h_k = dr/dx_k = a_k R X'_k their derivative is of rank two,

    -df/dx = (l . F) g g^T + (m / r) (h g^T + g h^T),

two columns and rows of the border, with (dangle, dr) as unknowns.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.interface.extraction import extract_surface
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.rigid_motion import describe_place
from fenics_mortar.rigid.bordered import Border
from fenics_mortar.rigid.remote import BoundaryMotion
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import format_point


class SpreadLoad(BoundaryMotion):
    """Force and moment at a point, spread over a boundary that stays free to deform.

    Nodal forces are those of a traction c + A x, weighted by nodal areas, with the given force and
    the given moment about the pivot, which follows the mean motion of the boundary. Forces keep
    their directions. All loads are zero at first. Methods are local; set loads equally on all
    ranks.

    Args:
        data: Mesh with names.
        boundary: Name or tag of the boundary, or a list of them.
        pivot: Point at which the load acts, shape (2,) [length]; anywhere in the plane.
        name: Name used in messages; by default that of the boundary.

    Attributes:
        name, pivot, load: See ``RigidMotion``; no motion is prescribed.
        place: Mean motion after the last solve, work-conjugate to the load: translation of the
            pivot and rotation, shape (3,) [length, length, radian].
        reaction: The load, after the last solve, shape (3,).

    Raises:
        ValueError: If name or pivot is of another type, or the pivot is not finite.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        The constructor is collective.

    Example:
        The force of a pin on the eye of a rod::

            pin = fm.SpreadLoad(data, "rod/eye", pivot=(10.0, 0.0))
            problem = fm.ContactProblem(
                residual, u, pairs, bcs=bcs, remote=[pin], petsc_options_prefix="rod_"
            )
            pin.push(x=100.0)
            problem.solve()
    """

    kind, unloaded = "spread load", 0.0

    def move(
        self,
        *,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        angle: npt.ArrayLike | None = None,
    ) -> None:
        """Raise an error: the boundary is free.

        Raises:
            ValueError: Always.
        """
        raise ValueError(
            f"spread load '{self.name}' has no prescribed motion: expected push(), or a "
            "RigidBoundary, whose motion can be prescribed"
        )

    def bind(self, space: DisplacementSpace) -> BoundSpreadLoad:
        """The nodes of the boundary in a space (collective).

        Args:
            space: Nodes and dofs of the displacement.

        Raises:
            SurfaceError: On all ranks, if facets are not on the boundary of the mesh.
        """
        return BoundSpreadLoad(self, space)


class BoundSpreadLoad:
    """A spread load in the space of a problem; arrays of nodes are replicated.

    Args:
        motion: The load of the user.
        space: Nodes and dofs of the displacement.

    Attributes:
        motion: The load of the user.
    """

    def __init__(self, motion: SpreadLoad, space: DisplacementSpace) -> None:
        """Find the nodes (collective)."""
        self.motion, self._space = motion, space
        tags = motion.data.facet_tags, motion.tags
        self._surface = extract_surface(space, *tags, motion.name)
        self.update_reference()

    def update_reference(self) -> None:
        """Read the reference positions from the mesh, which ties may move (collective)."""
        self._X = self._surface.gather(self._space.positions())
        self._areas = self._surface.full_cover
        self._mean = self._areas @ self._X / self._areas.sum()
        self._angle = 0.0

    def evaluate(self, u: Array) -> None:
        """Compute the mean motion and forces at ``u``, shape (local dofs,) (collective)."""
        arms, here = self._X - self._mean, self._surface.gather(u)
        x, total = self._X + here, self._areas.sum()
        cosine = float(self._areas @ (arms * x).sum(axis=1))
        sine = float(self._areas @ (arms[:, 0] * x[:, 1] - arms[:, 1] * x[:, 0]))
        self._r, turn = float(np.hypot(cosine, sine)), float(np.arctan2(sine, cosine))
        if self._space.is_axisymmetric:
            turn, self._r = 0.0, np.inf  # nothing turns
        turns = np.round((self._angle - turn) / (2.0 * np.pi))
        self._angle = turn + 2.0 * np.pi * turns
        rotation = _rotation(turn)
        self._h = self._areas[:, None] * (arms @ rotation.T)
        self._g = np.stack([-self._h[:, 1], self._h[:, 0]], axis=1) / self._r
        self._lever = rotation @ (self.motion.pivot - self._mean)
        moved = (rotation - np.eye(2)) @ (self.motion.pivot - self._mean)
        self._place = np.array([*(self._areas @ here / total + moved), self._angle])
        if self._space.is_axisymmetric:
            self._place[0] = 0.0
        force = self.motion.load[:2]
        twist = self._lever[0] * force[1] - self._lever[1] * force[0]
        self._m = float(self.motion.load[2] + twist)
        self._forces = np.outer(self._areas / total, force) + self._m * self._g

    def add_to_residual(self, bulk: Bulk) -> None:
        """Subtract the forces at the present displacement from ``bulk.r`` (collective)."""
        self.evaluate(bulk.values)
        self._surface.scatter_add(-self._forces, bulk.r.array)

    def forces(self, size: int) -> Array:
        """Forces at the owned dofs at the last evaluated state, (size,) [stress length] (local)."""
        found = np.zeros(size)
        self._surface.scatter_add(self._forces, found)
        return found

    def linearize(self, system: LinearSystem) -> Border:
        """Columns and rows of (dangle, dr), at the last evaluated state (local)."""
        by_r = self._m / self._r
        by_angle = float(self._lever @ self.motion.load[:2]) * self._g + by_r * self._h
        columns, rows = np.zeros((2, 2, system.bulk.num_owned + system.num_z_dofs))
        for row, nodal in ((columns[0], by_angle), (columns[1], by_r * self._g)):
            self._surface.scatter_add(nodal, row)
        for row, nodal in ((rows[0], self._g), (rows[1], self._h)):
            self._surface.scatter_add(nodal, row)
        return Border(columns, rows, -np.eye(2))

    def record(self) -> str:
        """Set place and reaction of the user's load; return a sentence (local)."""
        self.motion.place, self.motion.reaction = self._place.copy(), self.motion.load.copy()
        moment = self.motion.load[2]
        load = f"force {format_point(self.motion.load[:2])}, moment {moment + 0.0:.4g}"
        return f"spread load '{self.motion.name}'{describe_place(self._place)}: {load}"


def _rotation(angle: float) -> Array:
    """Rotation matrix, shape (2, 2) [1]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
