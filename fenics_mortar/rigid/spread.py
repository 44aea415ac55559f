# SPDX-License-Identifier: MIT
"""Loads and motions given at a point: what users give, and what the equations need of them.

A ``SpreadLoad`` is spread over a boundary that stays free to deform, a ``RigidBoundary`` moves as a
rigid one, and a section under pretension has a force or a shortening along its axis. In a problem
they are a ``BoundSpreadLoad``, a ``BoundRigidBoundary`` and a ``BoundSection``. What has a place,
also an obstacle, is a ``Mover``. Shapes are those of the plane.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.bulk.bodies import FloatingBody, RemoteLoad
from fenics_mortar.interface.surfaces import Surface, outward_normals
from fenics_mortar.interface.traces import extract_surface
from fenics_mortar.la.sparse import BlockMatrix, Border
from fenics_mortar.mesh.data import MeshData, Names, joined_names
from fenics_mortar.obstacles import rigid_motion
from fenics_mortar.rigid.proximal import tangent_stiffness
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import ROUNDING, SMALL_ANGLE, Array, Flags, Indices, Numbers, norms

if TYPE_CHECKING:
    from fenics_mortar.bulk.residual import Bulk
    from fenics_mortar.contact.interface import Interface
    from fenics_mortar.contact.tied import Tie
    from fenics_mortar.la.system import LinearSystem
    from fenics_mortar.mesh.space import DisplacementSpace


class Mover(ABC):
    """What moves rigidly in a problem: an obstacle, a boundary, or the sides of a section.

    Attributes:
        motion: Place and loads, those of the user's object.
        arm: Length by which angles are multiplied [length].
        reacts: Factor of ``force`` in the reaction of the user's object [1].
        force_name: What messages call this reaction.
    """

    motion: Any
    arm: float
    reacts, force_name = 1.0, "force"
    _space: DisplacementSpace

    @property
    def name(self) -> str:
        """Kind and name, for messages."""
        return f"{self.motion.kind} '{self.motion.name}'"

    @property
    def scales(self) -> Array:
        """Motions per component of the place, shape (3,) [1, length]."""
        dim = self.motion.dim
        return np.append(np.ones(dim), np.full(self.motion.place.size - dim, self.arm))

    @property
    def driven(self) -> Flags:
        """Whether forces drive a motion, shape (3,), bool."""
        return np.isfinite(self.motion.load)

    def push(self) -> Array:
        """Loads along driven motions, 0 for prescribed ones, (3,) [stress length] (local)."""
        return np.nan_to_num(self.motion.load) / self.scales

    def move(self, change: Array) -> None:
        """Add ``change`` to the motion, shape (3,) [length] (local)."""
        self.motion.place = rigid_motion.place_after(self.motion.place, change, self.arm)

    @abstractmethod
    def force(self) -> Array:
        """f_q, shape (3,) [stress length] (collective)."""

    @abstractmethod
    def linearize(self, system: LinearSystem) -> Border:
        """Columns, rows and corner of the balance (collective)."""

    def constant_force(self) -> Array:
        """The part of f_q that is not linear in the multipliers, (3,) [stress length]."""
        return np.zeros(self.motion.place.size)

    def loose(self) -> Array:
        """Orthonormal driven motions that nothing resists, (n, 3) [1]; none by default."""
        return np.zeros((0, self.motion.place.size))

    def tangent_spring(self, residual: Array, stiffness: float, force: float) -> Array:
        """Stiffness of a spring on loose motions, in proportion to the driving force (local).

        Args:
            residual: Residual of the balance, shape (3,) [stress length].
            stiffness: Stiffness of the bulk [stress].
            force: Size of all forces [stress length].

        Returns:
            Addition to E_q, shape (3, 3) [stress].
        """
        loose = self.loose()
        return stiffness * tangent_stiffness(loose @ residual, force) * (loose.T @ loose)

    def record(self) -> str:
        """Set the reaction of the user's object; return a sentence (collective)."""
        force = self.reacts * self.force() * self.scales
        is_axial = self._space.is_axisymmetric  # radial forces and moments vanish around the axis
        self.motion.reaction = force * [0.0, 1.0, 0.0] if is_axial else force
        load = rigid_motion.describe_load(force, self.force_name, is_axial=is_axial)
        return f"{self.name}{rigid_motion.describe_place(self.motion.place)}: {load}"


class BoundaryMotion(rigid_motion.RigidMotion):
    """Motion and loads given at a point of a boundary (the constructor is collective).

    Args:
        data: Mesh, tags and names.
        boundary: Name or tag of the boundary, or a list of names.
        pivot: The point, shape (2,), in space (3,) [length].
        name: Name used in messages; by default that of the boundary.

    Attributes:
        data: The mesh, with tags and names.
        tags: Tags of the boundary.
        unloaded: Loads at first, nan where motions are prescribed.

    Raises:
        ValueError: If name or pivot is of another type, or the pivot is not finite.
        MeshError: If a name or tag is unknown or has no facets.
    """

    unloaded = float("nan")

    def __init__(
        self, data: MeshData, boundary: Names, *, pivot: npt.ArrayLike, name: str | None = None
    ) -> None:
        errors.check_kind("data", data, MeshData, "the MeshData of the mesh")
        self.data, own = data, type(self).__name__
        with errors.together(data.mesh.comm, own):
            given = joined_names(boundary) if name is None else name
            super().__init__(given, errors.check_vector("pivot", pivot, data.mesh.geometry.dim))
            self.tags = data.boundary_tags(boundary)
        here = {"boundary": self.tags, "pivot": self.pivot, "name": self.name}
        errors.check_same_texts(data.mesh.comm, own, here)
        data.boundary_facets(boundary)
        self.load[:] = self.unloaded

    def __repr__(self) -> str:
        """The name."""
        return f"{type(self).__name__}({self.name!r})"

    def bind(self, space: DisplacementSpace) -> BoundSpreadLoad | BoundRigidBoundary:
        """The load, or the Dirichlet condition, of the boundary's nodes in a space (collective).

        Args:
            space: Nodes and dofs of the displacement.

        Raises:
            SurfaceError: On all ranks, if facets are not on the boundary of the mesh.
        """
        kind: Any = BoundSpreadLoad if isinstance(self, SpreadLoad) else BoundRigidBoundary
        return kind(self, space)


def refuse_remote(loads: Sequence[Any], purpose: str) -> None:
    """Raise an error where remote loads are not implemented (local, equal on all ranks).

    Raises:
        MortarError: If there are any.
    """
    if loads:
        name = f"{loads[0].motion.kind} '{loads[0].motion.name}'"
        raise errors.MortarError(f"{purpose} with remote loads, as {name}")


def check_remote(remote: Any) -> None:
    """Reject remote loads of a wrong type, or given twice (local).

    Raises:
        ValueError: If they are not a list of different remote loads.
    """
    if not isinstance(remote, Sequence) or not all(hasattr(load, "bind") for load in remote):
        raise ValueError(f"remote={remote!r}: expected a list of remote loads, e.g. RigidBoundary")
    if len(set(map(id, remote))) < len(remote):
        raise ValueError(f"remote={remote!r}: a remote load is given twice")


class SpreadLoad(BoundaryMotion):
    """Force and moment at a point, spread over a boundary that stays free to deform.

    Nodal forces are those of a traction c + A x, with the given force and the given moment about
    the pivot, which follows the mean motion of the boundary. Forces keep their directions. All
    loads are zero at first. Methods are local; set loads equally on all ranks.

    Args:
        data: Mesh with names.
        boundary: Name or tag of the boundary, or a list of them.
        pivot: Point at which the load acts, shape (2,), in space (3,) [length]; anywhere.
        name: Name used in messages; by default that of the boundary.

    Attributes:
        name, pivot, load: See ``RigidMotion``; no motion is prescribed.
        place: Mean motion after the last solve, work-conjugate to the load: translation of the
            pivot and rotation, shape (3,) [length, length, radian]; in space (6,), with a rotation
            vector.
        reaction: The load, after the last solve, of the shape of ``place``, units as ``load``.

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

    def move(self, **motions: Any) -> None:
        """Raise an error: the boundary is free.

        Args:
            motions: See ``BoundaryMotion.move`` [length, radian].

        Raises:
            ValueError: Always.
        """
        raise ValueError(
            f"spread load '{self.name}' has no prescribed motion: expected push(), or a "
            "RigidBoundary, whose motion can be prescribed"
        )


class BoundSpreadLoad:
    """A spread load in the space of a problem; arrays of nodes are replicated.

    The mean motion of the boundary is the rigid one next to the displacements,

        minimize  int |x - x_P - R (X - P)|^2 dA.

    With means X_0 and x_0, R is the polar rotation of int x X'^T dA with X' = X - X_0, and
    x_P = x_0 + R (P - X_0). In plane and space e_i are the axes of rotation. With v = R X' and its
    moments v_k = int N_k v dA at the nodes, the mass matrix times v, the spin t of R follows from

        S t = sum_k (e_i x v_k) . dx_k,    S_ij = sum_k (e_i x v_k) . (e_j x x_k).

    The nodal forces are work-conjugate to the mean motion, f_k = F . dx_P/dx_k + M . dt/dx_k, that
    is

        f_k = a_k F / sum(a) + w x v_k,    S w = m = M + l x F,    l = R (P - X_0),

    with a_k = int N_k dA: a traction c + A x with the resultants F and M about the moved pivot.
    They depend on t and S. With q = sum_k (e_i x v_k) . (w x dx_k), the part of dS w at constant v,

        df_k = dw x v_k + w x (t x v_k),    S dw = (L - N) t - q,

        L_ij = (e_i x (e_j x l)) . F,    N_ij = sum_k (e_i x (e_j x v_k)) . (w x x_k):

    columns and rows of the border, with t and q as unknowns, two in the plane and six in space.

    Args:
        motion: The load of the user.
        space: Nodes and dofs of the displacement.

    Attributes:
        motion: The load of the user.
        num_unknowns: Number of its unknowns t and q.
    """

    def __init__(self, motion: SpreadLoad, space: DisplacementSpace) -> None:
        """Find the boundary (collective)."""
        self.motion, self._space, self._axes = motion, space, rigid_motion.TURNS[motion.dim]
        self.num_unknowns = 2 * len(self._axes)
        tags = motion.data.facet_tags, motion.tags
        self._surface = extract_surface(space, *tags, motion.name)
        self.update_reference()

    def update_reference(self) -> None:
        """Read positions, which ties may change; begin without turn (collective)."""
        self._X = self._surface.gather(self._space.positions())
        self._mass = self._surface.mass
        self._areas = self._mass.sum(axis=1)
        self._mean = self._areas @ self._X / self._areas.sum()
        self._turn = np.zeros(len(self._axes))

    def evaluate(self, u: Array) -> None:
        """Compute the mean motion and forces at ``u``, shape (local dofs,) (collective)."""
        arms, here = self._X - self._mean, self._surface.gather(u)
        areas, dim, total = self._areas, self.motion.dim, self._areas.sum()
        self._x = self._X + here
        is_axial = self._space.is_axisymmetric  # nothing turns
        R = np.eye(dim) if is_axial else rigid_motion.polar(self._x.T @ (self._mass @ arms))[0]
        self._turn = rigid_motion.vector_beside(R, self._turn)
        self._v = arms @ R.T
        around = self._around(self._mass @ self._v)
        S = np.einsum("kia,kja->ij", around, self._around(self._x))
        self._per_moment = np.zeros(S.shape) if is_axial else np.linalg.inv(S)
        self._g = np.einsum("ij,kja->kia", self._per_moment, around)
        self._lever = R @ (self.motion.pivot - self._mean)
        moved = (R - np.eye(dim)) @ (self.motion.pivot - self._mean)
        self._place = np.array([*(areas @ here / total + moved), *self._turn])
        if is_axial:
            self._place[0] = 0.0
        force, moment = np.split(self.motion.load, [dim])
        w = self._per_moment @ (moment + self._around(self._lever[None])[0] @ force)
        self._W = np.tensordot(w, self._axes, 1)
        self._forces = areas[:, None] * (force / total) + self._mass @ self._v @ self._W.T

    def _around(self, vectors: Array) -> Array:
        """Products e_i x of vectors (n, 2), shape (n, 1, 2); in space (n, 3, 3) (local)."""
        return np.einsum("iab,kb->kia", self._axes, vectors)

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
        """Columns and rows of t and q, at the last evaluated state (local)."""
        v = self._mass @ self._v
        force, around = self.motion.load[: self.motion.dim], self._around(v)
        twice = self._axes[:, None] @ self._axes
        W, count = self._W, self.num_unknowns
        L = np.einsum("ijab,b,a->ij", twice, self._lever, force)
        N = np.einsum("ijab,kb,ka->ij", twice, v, self._x @ W.T)
        dw = self._per_moment @ (L - N)
        by_t = np.einsum("ij,kia->kja", dw, around) + around @ W.T
        columns, rows, corner = border = Border.empty(system, count)
        for target, fields in ((columns, (-by_t, self._g)), (rows, (self._g, around @ W))):
            nodal = np.concatenate(fields, axis=1)
            for number in range(count):
                self._surface.scatter_add(nodal[:, number], target[number])
        corner -= np.eye(count)
        return border

    def record(self) -> str:
        """Set place and reaction of the user's load; return a sentence (local)."""
        self.motion.place, self.motion.reaction = self._place.copy(), self.motion.load.copy()
        load = rigid_motion.describe_load(self.motion.load)
        return f"spread load '{self.motion.name}'{rigid_motion.describe_place(self._place)}: {load}"


class BoundSection(Mover, RemoteLoad):
    """A section in the space of a problem, a remote load as ``BoundRigidBoundary``.

    The force in a tie is the load of its jump along an axis. The rows of the tie are
    D u_s - M (u_m + s a) for the shortening s along the axis a. The force that tightens the section
    is conjugate to s,

        f_q = -sum_j m_j a . z_j = push,    m = M 1,

    so that column and row of the border are transposed, up to the weights of the tie's rows. Where
    only contact resists the motion of the sides of a section along its axis, they float: see
    ``body_motions``.

    Args:
        tie: The tie of its faces.
        bulk: The bodies.

    Attributes:
        tie: The tie of its faces.
        motion: Shortening and force of the user's section.
        axis: Direction in which the slave moves into the master, shape (dim,) [1].
        arm: One, since nothing turns [length].
    """

    arm = 1.0

    def __init__(self, tie: Any, bulk: Bulk) -> None:
        """Find the axis (local)."""
        self.tie: Tie = tie
        self._pair, self.motion, self._bulk = tie.pair, tie.pair.motion, bulk
        if not self._pair.axis.any():
            self._pair.axis = _normal_of(tie.slave)
        self.axis: Array = self._pair.axis

    def force(self) -> Array:
        """The force that tightens the section, as the first of (3,) [stress length] (local)."""
        shortening = np.eye(self.motion.place.size)[0]
        return float((self._by_multipliers() * self.tie.z).sum()) * shortening

    def pushed_nodes(self) -> Array:
        """The push beyond the tie's force, on both faces, (owned dofs,) [stress length] (local).

        The resultant on the body is zero, those on the parts beside the section drive them.
        """
        found, weights = np.zeros(self._bulk.num_owned), self._weights()
        missing = float(np.nan_to_num(self.motion.load[0] - self.force()[0]))
        z = np.outer(self.tie.active, missing / weights.sum() * self.axis)
        self.tie.scatter_add(self.tie.operators.force(z), found)
        return found

    def motions_by(self, body: FloatingBody, part: int) -> Array:
        """The shortening due to the motions of a body, as the first of (motions, 3) [1] (local)."""
        rigid = self.motion.place.size
        number = [section.load for section in body.sections].index(self)
        return np.outer(body.motions[:, rigid + number], np.eye(rigid)[0])

    def _by_multipliers(self) -> Array:
        """Derivative of f_q with respect to the multipliers, of their shape [length]."""
        by_z = np.zeros_like(self.tie.z)
        by_z[:, : self.motion.dim] = -np.outer(self._weights(), self.axis)
        return by_z

    def _weights(self) -> Array:
        """The weights m = M 1, shape (slave nodes,) [length]."""
        return np.asarray(self.tie.M @ np.ones(self.tie.master.num_nodes))

    def linearize(self, system: LinearSystem) -> Border:
        """Border of the shortening: its column in the tie's rows, and its balance (local)."""
        _, weight = self.tie.rows.frame()
        by_z = self._by_multipliers()
        columns, rows, _ = border = Border.empty(system, self.motion.place.size)
        (z_dofs,) = (z_dofs for contact, z_dofs in system.numbered() if contact is self.tie)
        at, owned = system.bulk.num_owned + system.local(self.tie, z_dofs), self.tie.slave.owned
        columns[0, at], rows[0, at] = (weight * by_z)[owned], by_z[owned]
        return border

    def record(self) -> str:
        """Set the force of the user's section; return it and the shortening in words (local)."""
        self.motion.reaction = self.force()
        force, shortening = self.motion.reaction[0], self._pair.shortening
        return f"section '{self.motion.name}', shortened by {shortening:.4g}: force {force:.4g}"


def _normal_of(slave: Surface) -> Array:
    """Outward normal of a straight or flat surface, shape (dim,) [1] (local, equal on all ranks).

    Raises:
        SurfaceError: If the surface is curved.
    """
    normals = outward_normals(slave.X[slave.facets])
    mean = normals.sum(axis=0)
    if np.linalg.norm(mean) < np.cos(SMALL_ANGLE) * norms(normals).sum():
        raise errors.SurfaceError(
            f"section '{slave.name}' is not straight: give the axis= of the pretension, the "
            "direction in which the slave moves into the master"
        )
    return np.asarray(mean / np.linalg.norm(mean))


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


class BoundRigidBoundary(Mover, RemoteLoad):
    """A rigid boundary in the space of a problem; also the Dirichlet condition of its nodes.

    Its nodes k have the displacements

        u_k = U + (R(angle) - 1) (X_k - P)

    with the pivot P and q = (U, angle arm), in space with the rotation vector. They are prescribed
    dofs with values that depend on q. The forces r_k of bodies and contact on these nodes are in
    balance with force and moment at the pivot,

        f_q = sum_k V_k(q) . r_k = push,    V_k = du_k / dq,

    which is one row of the border per motion, see ``driven``. With l_k from the present pivot to
    the node, V_k of a turn about e_i is e_i x l_k / arm, and the derivative of the moments by the
    turns at constant r is

        E_ij = sum_k (e_i x (e_j x l_k)) . r_k / arm^2,

    in the plane -l . r / arm^2.

    Args:
        motion: The boundary of the user.
        space: Nodes and dofs of the displacement.

    Attributes:
        motion: The boundary of the user.
        nodes: Global numbers of its nodes, replicated, shape (n,).
        arm: Largest distance of a node from the pivot [length].
        local_nodes: Its local nodes, with ghosts, shape (k,).
        function_space, g: Of a Dirichlet condition; it has no constant or function.
    """

    g = None

    def __init__(self, motion: RigidBoundary, space: DisplacementSpace) -> None:
        """Find the owned and ghost nodes of the boundary (collective)."""
        self.motion, self._space, self.function_space = motion, space, space.whole
        surface = extract_surface(space, motion.data.facet_tags, motion.tags, motion.name)
        self.nodes: Indices = np.unique(surface.nodes)
        index_map = space.V.dofmap.index_map
        count = index_map.size_local + index_map.num_ghosts
        local = index_map.local_to_global(np.arange(count, dtype=np.int32))
        here = np.flatnonzero(np.isin(local, self.nodes))
        self.local_nodes: Indices = here
        self._here, self._owned = space.dofs[here], here < space.num_nodes
        self._dofs: Indices = self._here[self._owned]  # owned ones, shape (k, 2)
        self._comm = surface.comm
        self._surface = surface
        self.update_reference()

    def update_reference(self) -> None:
        """Read the positions, which ties may change, and the arm of turns (collective)."""
        positions = self._space.positions()
        self._X = positions[self._here]
        arms = np.linalg.norm(self._surface.gather(positions) - self.motion.pivot, axis=1)
        self.arm = float(arms.max())

    # As a Dirichlet condition

    def dof_indices(self) -> tuple[Numbers, int]:
        """Local dofs of the nodes, ghosts included, and the number of owned ones (local)."""
        owned, ghosts = self._dofs.ravel(), self._here[~self._owned].ravel()
        return np.concatenate([owned, ghosts]).astype(np.int32), owned.size

    def set(self, values: Array) -> None:
        """Write the displacements at the present place into ``values`` (local dofs,) (local)."""
        values[self._here] = self.motion.displacement(self._X)

    def driven_dofs(self) -> Flags:
        """Marks of local dofs that a push drives, shape (local dofs,), bool (local)."""
        marked = self._space.spread(np.zeros(len(self._space.dofs))) > 0.0
        V = self.motion.motions(self.motion.to_space(self._X), self.arm)[:, self.driven]
        marked[self._here] = (np.abs(V) > ROUNDING).any(axis=1)
        return marked

    # Balance

    def bind_forces(self, bulk: Bulk, contacts: Sequence[Interface]) -> None:
        """Set the source of forces: the bodies, and the contacts at nodes of this boundary.

        Args:
            bulk: The bodies.
            contacts: All contacts and ties.
        """
        self._bulk = bulk
        self._touching = [c for c in contacts if np.isin(c.nodes, self.nodes).any()]

    def _velocities(self) -> Array:
        """V of the owned nodes, shape (k, 3, 2) [1]."""
        return self.motion.motions(self.motion.to_space(self._X[self._owned]), self.arm)

    def _along_motions(self, forces: Array) -> Array:
        """V . ``forces`` (k, 2) of the owned nodes, summed over ranks, shape (3,) (collective)."""
        return ranks.sum_over_ranks(self._comm, np.einsum("kmc,kc->m", self._velocities(), forces))

    def constant_force(self) -> Array:
        """Forces of the bodies alone along the motions, (3,) [stress length] (collective)."""
        return self._along_motions(self._bulk.r.array_r[self._dofs])

    def force(self) -> Array:
        """Resultants of bodies and contact about the pivot, (3,) [stress length] (collective)."""
        return self._along_motions(self._forces())

    def _forces(self) -> Array:
        """Forces of bodies and contact at the owned nodes, shape (k, 2) [stress length]."""
        total = self._bulk.r.array_r[: self._bulk.num_owned].copy()
        for contact in self._touching:
            contact.scatter_add(contact.now.forces, total)
        return total[self._dofs]

    def pushed_nodes(self) -> Array:
        """The push as forces on nodes, (owned dofs,) [stress length] (collective)."""
        found = np.zeros(self._bulk.num_owned)
        factors = np.linalg.solve(self._products(), self.push())
        found[self._dofs] = np.einsum("kmc,m->kc", self._velocities(), factors)
        return found

    def centripetal(self, v: Array) -> Array:
        """Acceleration towards the pivot of a rotating boundary, (owned dofs,) (collective).

        Args:
            v: Velocities, of which it has the rotation, shape (local dofs,) [length / time].
        """
        found, rates = np.zeros(self._bulk.num_owned), self._along_motions(v[self._dofs])
        dim = self.motion.dim
        spin = np.linalg.solve(self._products(), rates)[dim:] / self.arm
        W = np.tensordot(spin, rigid_motion.TURNS[dim], 1)
        found[self._dofs] = self._levers() @ (W @ W).T
        return found

    def _products(self) -> Array:
        """Products of the motions of all nodes, shape (3, 3) [1] (collective)."""
        V = self._velocities()
        return ranks.sum_over_ranks(self._comm, np.einsum("kmc,knc->mn", V, V))

    def _levers(self) -> Array:
        """Owned nodes minus the pivot, shape (k, 2) [length]."""
        return self.motion.to_space(self._X[self._owned]) - self.motion.present_pivot

    def motions_by(self, body: FloatingBody, part: int) -> Array:
        """The motions due to those of a body, at a part of it, shape (motions, 3) [1] (local)."""
        velocity = body.displacement(self.motion.present_pivot[None], np.array([part]))[:, 0]
        dim, count = self.motion.dim, self.motion.place.size
        return np.column_stack([velocity, body.motions[:, dim:count] * (self.arm / body.size)])

    def take_bulk_rows(self) -> None:
        """Store V^T K, before contact changes K (collective)."""
        self._by_bulk = compat.products(self._bulk.K, self.nodal_motions(), transpose=True)

    def nodal_motions(self) -> Array:
        """V at the owned dofs, zero elsewhere, shape (3, owned dofs) [1]."""
        values = np.zeros((self.motion.place.size, self._bulk.num_owned))
        values[:, self._dofs] = np.moveaxis(self._velocities(), 1, 0)
        return values

    def linearize(self, system: LinearSystem) -> Border:
        """Columns of the prescribed dofs, rows and corner of the balance (collective)."""
        V, size, dim = self.nodal_motions(), self._bulk.num_owned, self.motion.dim
        columns, rows, corner = border = Border.empty(system, len(V))
        columns[:, :size], rows[:, :size] = -V, self._by_bulk
        if self._touching:
            rows += _by_contact(system, V)
        moments = np.einsum("ka,kb->ab", self._forces(), self._levers()) / self.arm**2
        twice, moments = (
            rigid_motion.TURNS[dim][:, None] @ rigid_motion.TURNS[dim],
            ranks.sum_over_ranks(self._comm, moments),
        )
        corner[dim:, dim:] = np.einsum("ijab,ab->ij", twice, moments)
        return border


def _by_contact(system: LinearSystem, V: Array) -> Array:
    """V^T [K_c, B^T] for V (m, owned dofs), shape (m, n) (collective)."""
    size, sizes = system.bulk.num_owned, (system.bulk.num_owned, system.num_z_dofs)
    K_c = BlockMatrix(system.comm, size, size).assemble(system.force_derivative())
    B_T = BlockMatrix(system.comm, *sizes).assemble(system.force_blocks())
    scales = system.collect(contact.components.scale for contact in system.contacts)
    by_z = compat.products(B_T, V, transpose=True) / scales
    found = np.hstack([compat.products(K_c, V, transpose=True), by_z])
    K_c.destroy()
    B_T.destroy()
    return found
