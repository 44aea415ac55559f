# SPDX-License-Identifier: MIT
"""What the laws of an interface share: surfaces, multipliers, and the forces that these make."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.interface.mortar import Block, Linearization, MortarOperators
from fenics_mortar.interface.options import AT_VERTICES
from fenics_mortar.interface.segments import Segments
from fenics_mortar.interface.sight import Outline
from fenics_mortar.interface.surfaces import Surface, extract_surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import SurfaceError, place

NO_WELDS: Indices = np.empty((0, 2), np.int64)
# Gauss points per segment by default, or for each part of a facet between two nodes
POINTS = 5


@dataclass(frozen=True)
class Rows:
    """The rows of the multipliers: blocks . dd + A_z z = rhs, in force units.

    Attributes:
        blocks: Blocks with rows 2 j + component and displacement dofs as columns.
        A_z: Shape (slave nodes, 2, 2) [length].
        rhs: Shape (slave nodes, 2) [stress length].
    """

    blocks: list[Block]
    A_z: Array
    rhs: Array


class Interface(ABC):
    """Two surfaces with multipliers on the slave, which make the force D^T z and -M^T z.

    Attributes:
        slave, master: The surfaces.
        free: 1 where a component of a slave node is not prescribed, else 0, (slave nodes, 2).
        z: Multipliers, minus the traction on the slave, shape (slave nodes, 2) [stress].
        active: Whether the sides of a slave node stay together, shape (slave nodes,), bool.
        carries: Whether a slave node carries a multiplier, shape (slave nodes,), bool.
        oblique: Whether the one prescribed component of a slave node is neither along nor across
            its normal, and it still carries a multiplier, shape (slave nodes,), bool.
        piece: Piece of its law that each slave node is on, shape (slave nodes,).
        stiffness: Mean diagonal of the bulk tangent at each slave node, (slave nodes,) [stress].
        operators: D, M and what follows from them at the last evaluated state.
    """

    def __init__(
        self,
        pair: Any,
        space: DisplacementSpace,
        prescribed: npt.NDArray[np.bool_],
        welds: Indices = NO_WELDS,
    ) -> None:
        """Extract the surfaces (collective).

        Args:
            pair: The pair.
            space: The displacement's space.
            prescribed: Local dofs with Dirichlet values.
            welds: Pairs of nodes that are one, see ``Surface.welded``.
        """
        self.pair = pair
        tags = pair.data.facet_tags
        slave = extract_surface(space, tags, pair.slave_tag, pair.slave_name)
        self.slave: Surface = slave.welded(welds)
        self.master: Surface = self._master_surface(space).welded(welds)
        self._check_sides()
        self.free: Array = 1.0 - self.slave.gather(prescribed.astype(float))
        self.z: Array = np.zeros((self.slave.num_nodes, 2))
        self.active = np.zeros(self.slave.num_nodes, bool)
        self.stiffness: Array = np.ones(self.slave.num_nodes)
        self.carries = self._may_carry = ~self.active
        self.oblique = self.active.copy()
        self.piece = np.zeros(self.slave.num_nodes, np.int64)
        self.partners: Any = None
        self.accepted: Any = None
        self.operators: MortarOperators

    def _master_surface(self, space: DisplacementSpace) -> Surface:
        """Surface of the pair's other side (collective)."""
        name, data = self.pair.master_name, self.pair.data
        return extract_surface(space, data.facet_tags, data.boundary_tag(self.pair.master), name)

    def _check_sides(self) -> None:
        both = np.intersect1d(self.slave.nodes, self.master.nodes)
        if both.size:
            where = self.slave.X[np.flatnonzero(self.slave.nodes == both[0])[0]]
            raise SurfaceError(
                f"slave '{self.pair.slave_name}' and master '{self.pair.master_name}' share "
                f"{both.size} nodes, one at {place(where)}; the two sides must be different "
                "surfaces that are not joined in the mesh"
            )

    def see(self, outline: Outline) -> Outline:
        """Take note of the boundary of the mesh; return what others see of it (local)."""
        return outline

    @abstractmethod
    def evaluate(self, u: Array, linearization: Linearization) -> None:
        """Evaluate everything at the displacement ``u``, a local array (collective)."""

    def _points(self) -> int:
        """Gauss points per segment, with "elements" per facet: those of the pair, or the default.

        How well points on a facet pass a uniform pressure does not depend on the mesh: through 5 it
        passes to 0.1 % on facets with two nodes, to 5 % on those with three, through 10 to 0.4 %.
        With fewer points than nodes a facet may have no multiplier functions.
        """
        points, degree = self.pair.points, self.slave.degree
        if points is None:
            on_facets = self.pair.integration == "elements" and self.master.num_nodes > 0
            return POINTS * (degree if on_facets else 1)
        if points <= degree:
            raise ValueError(
                f"points={points}: at least as many as a facet has nodes, {degree + 1}"
            )
        return int(points)

    def move(self, z: Array, part: float, step: Array) -> None:
        """Go a part of the way to the multipliers of a linear system (collective).

        Args:
            z: These, shape (slave nodes, 2) [stress].
            part: How much of it.
            step: All of the displacements that go with them, owned dofs [length].
        """
        self.z = self.z + part * (z - self.z) if part < 1.0 else z

    @property
    def steepness(self) -> float:
        """Largest force by slip of a node, where that may be more than the bulk's [stress]."""
        return 0.0

    def take(self, z: Array) -> None:
        """Go to the multipliers of a state, shape (slave nodes, 2) [stress]."""
        self.z = z.copy()

    @property
    @abstractmethod
    def as_faced(self) -> MortarOperators:
        """The operators at the places of the nodes by which points of both sides are partners."""

    @abstractmethod
    def intersections(self) -> Segments:
        """Where the facets of this rank's share meet the master, whatever integrates the pair."""

    @abstractmethod
    def rows(self) -> Rows:
        """Rows of the multipliers, the law of the interface."""

    @abstractmethod
    def residual(self) -> Array:
        """What the rows make zero, as forces, shape (slave nodes, 2) [stress length]."""

    @abstractmethod
    def followed(self) -> Array:
        """What the rows say of an active node's own motion, over its stiffness.

        Plus or minus the dyads of the directions in which it follows its partners, shape (slave
        nodes, 2, 2).
        """

    @abstractmethod
    def accept(self) -> None:
        """Note what the next step needs of the last evaluated state (collective)."""

    @abstractmethod
    def start_step(self) -> None:
        """Begin a step at the accepted state."""

    def faced(self) -> tuple[Indices, Indices]:
        """Slave nodes, and the master nodes that they are coupled to beside those of M."""
        return np.empty(0, np.int64), np.empty(0, np.int64)

    @property
    def slip(self) -> Array:
        """Slip along tau since the last accepted step, shape (slave nodes,) [length]."""
        return np.zeros(self.slave.num_nodes)

    @property
    def z_tau(self) -> Array:
        """Tangential part of the multipliers, shape (slave nodes,) [stress]."""
        return np.asarray(np.einsum("ja,ja->j", self.operators.tau, self.z))

    @property
    def shear_force(self) -> Array:
        """Tangential force w_j z_tau of every slave node, (slave nodes,) [stress length]."""
        return self.operators.weight * self.z_tau

    @property
    def shear(self) -> Array:
        """The multipliers without the pressure, shape (slave nodes, 2) [stress]."""
        return self.operators.tau * self.z_tau[:, None]

    @property
    def nodal_lengths(self) -> Array:
        """Length of slave surface that belongs to each node, shape (slave nodes,) [length]."""
        return self.slave.nodal_lengths

    @property
    def nodes(self) -> Indices:
        """Global numbers of the nodes of both sides."""
        return np.concatenate([self.slave.nodes, self.master.nodes])

    @property
    def multiplier_nodes(self) -> Indices:
        """Global numbers of the slave nodes that may carry a multiplier."""
        return self.slave.nodes[self._may_carry]

    def has_master_of(self, other: Interface) -> bool:
        """Whether the masters of the two share a node."""
        return bool(np.intersect1d(self.master.nodes, other.master.nodes).size)

    @property
    def idle_nodes(self) -> Indices:
        """Global numbers of the other slave nodes: they bear forces of their neighbours."""
        return self.slave.nodes[~self._may_carry]

    @property
    def pressure(self) -> Array:
        """Normal part z_n of the multiplier of every slave node, shape (slave nodes,) [stress]."""
        return self._fill_inside(np.einsum("jc,jc->j", self.operators.n, self.z))

    @property
    def _at_vertices(self) -> bool:
        """Whether nodes inside facets have no multipliers."""
        return self.pair.basis in AT_VERTICES and self.pair.integration != "nodes"

    def _fill_inside(self, values: Array) -> Array:
        """Set nodes inside facets to the mean of the ends, if only these have multipliers."""
        if self._at_vertices:
            facets = self.slave.facets
            values[facets[:, 1:-1]] = values[facets[:, [0, -1]]].mean(axis=1, keepdims=True)
        return values

    @property
    def sticking(self) -> npt.NDArray[np.bool_]:
        """Whether an active node sticks, shape (slave nodes,), bool."""
        return self.active

    @property
    def acts(self) -> npt.NDArray[np.bool_]:
        """Whether a node has a multiplier that may not be zero, shape (slave nodes,), bool."""
        return self.active

    @property
    def active_nodes(self) -> Indices:
        """Numbers of the active slave nodes along the surface."""
        return np.flatnonzero(self.active)

    @property
    def total_force(self) -> Array:
        """Total force that acts on the slave body, shape (2,) [stress length]."""
        return -self.operators.weight @ self.z

    def force_blocks(self) -> list[Block]:
        """B^T: force by the multipliers that act; columns 2 j + component.

        Entry by entry, without the zeros of D and between components: they would fill the system.
        """
        o, s = self.operators, self.operators.segments
        return [
            self._force_entries(self.slave, o.facet_nodes, o.facet_nodes, o.D),
            self._force_entries(self.master, s.slave, s.master, -o.M),
        ]

    def _force_entries(self, surface: Surface, j: Indices, k: Indices, values: Array) -> Block:
        """Entries values[b, j, k] (b, 2, 2) of node k of ``surface`` and multiplier j."""
        used = (values != 0.0) & self.acts[j][:, :, None]
        j = np.broadcast_to(j[:, :, None], values.shape)[used]
        k = np.broadcast_to(k[:, None, :], values.shape)[used]
        columns = (2 * j[:, None] + np.arange(2)).reshape(-1, 1)
        rows = surface.dofs_of(k[:, None]).reshape(-1, 1)
        return Block(rows, columns, np.repeat(values[used], 2).reshape(-1, 1, 1))
