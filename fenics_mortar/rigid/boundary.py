# SPDX-License-Identifier: MIT
"""Boundaries of deformable bodies that move as rigid ones, moved or loaded at a point.

The nodes k of the boundary have the displacements

    u_k = U + (R(angle) - 1) (X_k - P)

with the pivot P and q = (U, angle arm), in space with the rotation vector. They are prescribed dofs
with values that depend on q. The forces r_k of bodies and contact on these nodes are in balance
with force and moment at the pivot,

    f_q = sum_k V_k(q) . r_k = push,    V_k = du_k / dq,

which is one row of the border per motion, see ``driven``. With l_k from the present pivot to the
node, V_k of a turn about e_i is e_i x l_k / arm, and the derivative of the moments by the turns at
constant r is

    E_ij = sum_k (e_i x (e_j x l_k)) . r_k / arm^2,

in the plane -l . r / arm^2. Shapes below are those of the plane.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.bulk.bodies import FloatingBody
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.interface.traces import extract_surface
from fenics_mortar.la.sparse import BlockMatrix
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.obstacles.rigid_motion import TURNS, describe_place
from fenics_mortar.rigid.spread import Border, BoundaryMotion
from fenics_mortar.utils.arrays import ROUNDING, Array, Flags, Indices
from fenics_mortar.utils.errors import format_point
from fenics_mortar.utils.ranks import sum_over_ranks


class RigidBoundary(BoundaryMotion):
    """A boundary of a deformable body that moves as a rigid one: a hub, a grip, an axle.

    ``move`` prescribes motions, ``push`` force and moment at the pivot, as of an obstacle. At first
    all motions are prescribed as zero. All nodes of the boundary have prescribed displacements, in
    no need of a Dirichlet condition. Methods are local; set motions and loads equally on all ranks.

    Args:
        data: Mesh with names.
        boundary: Name or tag of the boundary, or a list of them, which form one rigid boundary.
        pivot: Point at which motions and loads are given, shape (2,), in space (3,) [length];
            anywhere, it moves with the boundary.
        name: Name used in messages; by default that of the boundary.

    Attributes:
        name, pivot, place, load: See ``RigidMotion``; units with a thickness as of
            ``ContactProblem``.
        reaction: Force and moment about the pivot that the rest exerts on the body through this
            boundary after the last solve, shape (3,), units as ``load``: the push where there is
            one; in space three of each, shape (6,). With axisymmetry the axial force [force] alone.

    Raises:
        ValueError: If name or pivot is of another type, or the pivot is not finite.
        MeshError: If a name or tag is unknown or has no facets.

    Note:
        The constructor is collective.

    Example:
        A torque on the bore of a gear, free to turn about its centre::

            bore = fm.RigidBoundary(data, "gear/bore", pivot=(0.0, 0.0))
            problem = fm.ContactProblem(
                residual, u, pairs, bcs=bcs, remote=[bore], petsc_options_prefix="gear_"
            )
            bore.push(moment=12.0)
            problem.solve()
            print(bore.place[2], bore.reaction)
    """

    kind = "rigid boundary"

    def bind(self, space: DisplacementSpace) -> BoundRigidBoundary:
        """The nodes of the boundary in a space (collective).

        Args:
            space: Nodes and dofs of the displacement.

        Raises:
            SurfaceError: On all ranks, if facets are not on the boundary of the mesh.
        """
        return BoundRigidBoundary(self, space)


class BoundRigidBoundary:
    """A rigid boundary in the space of a problem; also the Dirichlet condition of its nodes.

    Args:
        motion: The boundary of the user.
        space: Nodes and dofs of the displacement.

    Attributes:
        motion: The boundary of the user.
        nodes: Global numbers of its nodes, replicated, shape (n,).
        arm: Largest distance of a node from the pivot [length].
        function_space, g: Of a Dirichlet condition; it has no constant or function.
    """

    g = None

    def __init__(self, motion: RigidBoundary, space: DisplacementSpace) -> None:
        """Find the nodes (collective)."""
        self.motion, self._space, self.function_space = motion, space, space.whole
        surface = extract_surface(space, motion.data.facet_tags, motion.tags, motion.name)
        self.nodes: Indices = np.unique(surface.nodes)
        index_map = space.V.dofmap.index_map
        count = index_map.size_local + index_map.num_ghosts
        local = index_map.local_to_global(np.arange(count, dtype=np.int32))
        here = np.flatnonzero(np.isin(local, self.nodes))
        self._nodes, self._here, self._owned = here, space.dofs[here], here < space.num_nodes
        self._comm = surface.comm
        self._surface = surface
        self.update_reference()

    def update_reference(self) -> None:
        """Read the reference positions from the mesh, which ties may move (collective)."""
        positions = self._space.positions()
        self._X = positions[self._here]
        arms = np.linalg.norm(self._surface.gather(positions) - self.motion.pivot, axis=1)
        self.arm = float(arms.max())

    # As a Dirichlet condition

    def dof_indices(self) -> tuple[npt.NDArray[np.int32], int]:
        """Local dofs of the nodes, ghosts included, and the number of owned ones (local)."""
        owned, ghosts = self._here[self._owned].ravel(), self._here[~self._owned].ravel()
        return np.concatenate([owned, ghosts]).astype(np.int32), owned.size

    def set(self, values: Array) -> None:
        """Write the displacements at the present place into ``values`` (local dofs,) (local)."""
        values[self._here] = self.motion.displacement(self._X)

    def driven_dofs(self) -> Flags:
        """Marks of local dofs that a push drives, shape (local dofs,), bool (local)."""
        marked = self._space.spread(np.zeros(len(self._space.dofs))) > 0.0
        driven = np.isfinite(self.motion.load)
        V = self.motion.motions(self.motion.to_space(self._X), self.arm)[:, driven]
        marked[self._here] = (np.abs(V) > ROUNDING).any(axis=1)
        return marked

    # Balance

    def bind_forces(self, bulk: Bulk, contacts: list[Interface]) -> None:
        """Set the source of forces: the bodies, and the contacts at nodes of this boundary.

        Args:
            bulk: The bodies.
            contacts: All contacts and ties.
        """
        self._bulk = bulk
        self._touching = [c for c in contacts if np.isin(c.nodes, self.nodes).any()]

    @property
    def _dofs(self) -> Indices:
        """Owned dofs, shape (k, 2)."""
        return self._here[self._owned]

    def _velocities(self) -> Array:
        """V of the owned nodes, shape (k, 3, 2) [1]."""
        return self.motion.motions(self.motion.to_space(self._X[self._owned]), self.arm)

    def _along_motions(self, forces: Array) -> Array:
        """V . ``forces`` (k, 2) of the owned nodes, summed over ranks, shape (3,) (collective)."""
        return sum_over_ranks(self._comm, np.einsum("kmc,kc->m", self._velocities(), forces))

    def constant_force(self) -> Array:
        """Forces of the bodies alone along the motions, (3,) [stress length] (collective)."""
        return self._along_motions(self._bulk.r.array_r[self._dofs])

    def force(self) -> Array:
        """f_q at the last evaluated state, shape (3,) [stress length] (collective)."""
        return self._along_motions(self._forces())

    def _forces(self) -> Array:
        """Forces of bodies and contact at the owned nodes, shape (k, 2) [stress length]."""
        total = self._bulk.r.array_r[: self._bulk.num_owned].copy()
        for contact in self._touching:
            on_slave, on_master = contact.now.forces
            contact.slave.scatter_add(on_slave, total)
            contact.master.scatter_add(on_master, total)
        return total[self._dofs]

    def pushed_nodes(self) -> Array:
        """The push as forces on nodes, (owned dofs,) [stress length] (collective)."""
        found = np.zeros(self._bulk.num_owned)
        factors = np.linalg.solve(self._products(), self.push())
        found[self._dofs] = np.einsum("kmc,m->kc", self._velocities(), factors)
        return found

    def push(self) -> Array:
        """Loads along driven motions, 0 for prescribed ones, (3,) [stress length] (local)."""
        return np.nan_to_num(self.motion.load) / self.motion.scales(self.arm)

    def centripetal(self, v: Array) -> Array:
        """Acceleration towards the pivot of a rotating boundary, (owned dofs,) (collective).

        Args:
            v: Velocities, of which it has the rotation, shape (local dofs,) [length / time].
        """
        found, rates = np.zeros(self._bulk.num_owned), self._along_motions(v[self._dofs])
        dim = self.motion.dim
        spin = np.linalg.solve(self._products(), rates)[dim:] / self.arm
        W = np.tensordot(spin, TURNS[dim], 1)
        found[self._dofs] = self._levers() @ (W @ W).T
        return found

    def _products(self) -> Array:
        """Products of the motions of all nodes, shape (3, 3) [1] (collective)."""
        V = self._velocities()
        return sum_over_ranks(self._comm, np.einsum("kmc,knc->mn", V, V))

    def _levers(self) -> Array:
        """Owned nodes minus the pivot, shape (k, 2) [length]."""
        return self.motion.to_space(self._X[self._owned]) - self._pivot()

    def motions_by(self, body: FloatingBody) -> Array:
        """The motions due to those of a floating body, shape (motions, 3) [1] (local)."""
        velocity = body.displacement(self._pivot()[None], self._part)[:, 0]
        dim, count = self.motion.dim, self.motion.place.size
        return np.column_stack([velocity, body.motions[:, dim:count] * (self.arm / body.size)])

    def labels(self, labels: Indices) -> Indices:
        """Bodies of the nodes, replicated, shape (n,), from those of local nodes (collective)."""
        mine = set(labels[self._nodes].tolist())
        found = np.array(sorted(set().union(*self._comm.allgather(mine))))
        self._part = found[:1]
        return found

    def record(self) -> str:
        """Set the reaction of the user's boundary; return a sentence (collective)."""
        force, dim = self.force() * self.motion.scales(self.arm), self.motion.dim
        if self._space.is_axisymmetric:
            force *= [0.0, 1.0, 0.0]
        self.motion.reaction = force
        moment = f"{force[2] + 0.0:.4g}" if dim == 2 else format_point(force[3:])
        load = f"force {format_point(force[:dim])}, moment {moment}"
        if self._space.is_axisymmetric:
            load = f"axial force {force[1] + 0.0:.4g}"
        return f"rigid boundary '{self.motion.name}'{describe_place(self.motion.place)}: {load}"

    def take_bulk_rows(self) -> None:
        """Store V^T K, before contact changes K (collective)."""
        self._by_bulk = _transposed_times(self._bulk.K, self.nodal_motions())

    def nodal_motions(self) -> Array:
        """V at the owned dofs, zero elsewhere, shape (3, owned dofs) [1]."""
        values = np.zeros((self.motion.place.size, self._bulk.num_owned))
        values[:, self._dofs] = np.moveaxis(self._velocities(), 1, 0)
        return values

    def linearize(self, system: LinearSystem) -> Border:
        """Columns of the prescribed dofs, rows and corner of the balance (collective)."""
        V, size, dim = self.nodal_motions(), self._bulk.num_owned, self.motion.dim
        columns = np.zeros((len(V), size + system.num_z_dofs))
        rows, corner = np.zeros_like(columns), np.zeros((len(V), len(V)))
        columns[:, :size], rows[:, :size] = -V, self._by_bulk
        if self._touching:
            rows += _by_contact(system, V)
        moments = np.einsum("ka,kb->ab", self._forces(), self._levers()) / self.arm**2
        twice = TURNS[dim][:, None] @ TURNS[dim]
        corner[dim:, dim:] = np.einsum("ijab,ab->ij", twice, sum_over_ranks(self._comm, moments))
        return Border(columns, rows, corner)

    def _pivot(self) -> Array:
        """Present position of the pivot, shape (2,) [length]."""
        return self.motion.pivot + self.motion.place[: self.motion.dim]


def _by_contact(system: LinearSystem, V: Array) -> Array:
    """V^T [K_c, B^T] for V (m, owned dofs), shape (m, n) (collective)."""
    size, sizes = system.bulk.num_owned, (system.bulk.num_owned, system.num_z_dofs)
    K_c = BlockMatrix(system.comm, size, size).assemble(system.force_derivative())
    B_T = BlockMatrix(system.comm, *sizes).assemble(system.force_blocks())
    by_z = _transposed_times(B_T, V) / system.collect(map(system.scale, system.contacts))
    found = np.hstack([_transposed_times(K_c, V), by_z])
    K_c.destroy()
    B_T.destroy()
    return found


def _transposed_times(matrix: Any, vectors: Array) -> Array:
    """Transposed matrix times each row of ``vectors``, owned entries (collective)."""
    right, left = matrix.createVecs()
    found = np.empty((len(vectors), right.getLocalSize()))
    for row, vector in zip(found, vectors, strict=True):
        left.array[:] = vector
        matrix.multTranspose(left, right)
        row[:] = right.array_r
    right.destroy()
    left.destroy()
    return found
