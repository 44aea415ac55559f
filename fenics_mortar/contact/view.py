# SPDX-License-Identifier: MIT
"""Results on a pair: nodal fields along the slave surface, and forces.

The nodes and dofs of its two sides are the rows of D and the columns of M.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.fluxes import NodalFlux
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.interface.surfaces import Surface, replicate
from fenics_mortar.mesh.numbering import numbered_dofs
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Flags, Indices


@dataclass(frozen=True)
class PairSide:
    """Nodes of one side of a pair, ``problem.contacts[i].slave`` or ``.master``.

    The rows of ``problem.matrices.D(i)`` and ``M(i)`` and the columns of ``D(i)`` are the nodes of
    the slave in this order, the columns of ``M(i)`` those of the master: the shapes are (slave
    nodes, slave nodes) and (slave nodes, master nodes). All arrays are equal on all ranks. A rigid
    obstacle has no nodes.

    Attributes:
        name: Name of the boundary.
        X: Reference positions, shape (n, 2) [length].
        nodes: Global numbers in the space of the displacement, shape (n,).
        input_nodes: Numbers in the mesh input, see ``MeshData.node_dofs``; -1 for nodes that the
            input does not have, such as middles of straight edges; shape (n,).
        dofs: Global dofs of both components in the space of ``u``, shape (n, 2).

    Example:
        The contact forces D^T z on the slave and -M^T z on the master as a vector of all dofs, with
        the sign of internal forces; other terms on the interface are assembled likewise::

            contact, matrices = problem.contacts[0], problem.matrices
            forces = PETSc.Vec().createMPI((2 * V.dofmap.index_map.size_local, None), comm=comm)
            sides = (matrices.D(0), contact.slave, 1.0), (matrices.M(0), contact.master, -1.0)
            for matrix, side, sign in sides:
                on_nodes, rows = matrix.createVecs()
                (first, stop), (begin, end) = (v.getOwnershipRange() for v in (rows, on_nodes))
                for component in (0, 1):
                    rows.array[:] = contact.tractions[first:stop, component]
                    matrix.multTranspose(rows, on_nodes)
                    dofs = side.dofs[begin:end, component].astype(PETSc.IntType)
                    forces.setValues(dofs, sign * on_nodes.array, PETSc.InsertMode.ADD_VALUES)
            forces.assemble()
    """

    name: str
    X: Array
    nodes: Indices
    input_nodes: Indices
    dofs: Indices


def side_of(surface: Surface, space: DisplacementSpace) -> PairSide:
    """Nodes of a surface for users (collective)."""
    local, numbers = numbered_dofs(space.V)
    number_of = np.full(space.num_nodes, -1)
    owned = local < space.num_nodes
    number_of[local[owned]] = numbers[owned]
    first = space.V.dofmap.index_map.local_range[0]
    mine = number_of[surface.nodes[surface.owned] - first]
    input_nodes = replicate(np.stack([mine, mine], axis=1), surface.owners, surface.comm)[:, 0]
    X, nodes, dofs = surface.X.copy(), surface.nodes.copy(), surface.dofs.copy()
    return PairSide(surface.name, X, nodes, input_nodes, dofs)


class PairView:
    """Results on a contact or tied pair of a problem, ``problem.contacts[i]``; properties only.

    Forces and pressures are those on the slave. The outward normal of the slave is n, its tangent
    tau = (-n_y, n_x); slip and shear are positive along tau. In space these are tangential vectors,
    lengths of nodes are the roots of their areas, and all integrals are over areas.

    All arrays are copies, equal on all ranks. Nodal arrays follow the slave nodes along the
    surface, at the present multipliers and the last evaluated displacement; after a solve this is
    the solution. With degree 2, ends and midpoints of facets alternate along each curve, which
    begins with an end. All attributes but ``forces``, ``fluxes``, ``slave`` and ``master`` are
    local. More than 20 methods: one property for each result.

    Example:
        Pressure along the surface after a solve, as columns x, y, pressure::

            contact = problem.contacts[0]
            np.savetxt("pressure.txt", np.column_stack([contact.positions, contact.pressure]))
    """

    def __init__(self, interface: Interface, space: DisplacementSpace) -> None:
        self._interface, self._space = interface, space

    def __repr__(self) -> str:
        """Pair, total force and number of active nodes."""
        force = ", ".join(f"{component + 0.0:.6g}" for component in self.total_force)
        return f"<{self.pair!r}: force ({force}), {self.active.sum()} nodes active>"

    def __dir__(self) -> list[str]:
        """The public attributes."""
        return [name for name in vars(type(self)) if not name.startswith("_")]

    @property
    def pair(self) -> Any:
        """The ``ContactPair`` or ``TiedPair``; its ``law`` may be set."""
        return self._interface.pair

    @property
    def slave(self) -> PairSide:
        """Nodes and dofs of the slave, the rows of D and M; collective."""
        return side_of(self._interface.slave, self._space)

    @property
    def master(self) -> PairSide:
        """Nodes and dofs of the master, the columns of M; without nodes on obstacles; collective.

        Those of the slave if its surface may touch itself.
        """
        return side_of(self._interface.master, self._space)

    @property
    def nodes(self) -> Indices:
        """Global numbers of the slave nodes in the displacement's space, shape (slave nodes,).

        Values of a function of this space V at the slave nodes that a rank owns::

            first, end = V.dofmap.index_map.local_range
            mine = (first <= contact.nodes) & (contact.nodes < end)
            values = u.x.array.reshape(-1, dim)[contact.nodes[mine] - first]
        """
        return self._interface.slave.nodes.copy()

    @property
    def positions(self) -> Array:
        """Present positions of the slave nodes, shape (slave nodes, dim) [length].

        Before the first solve these are the positions in the mesh.
        """
        return self._interface.operators.x.copy()

    @property
    def normals(self) -> Array:
        """Outward unit normals of the slave nodes, shape (slave nodes, dim) [1]."""
        return self._interface.operators.n.copy()

    @property
    def lengths(self) -> Array:
        """Tributary length of each node, undeformed, shape (slave nodes,) [length]."""
        return self._interface.slave.nodal_lengths.copy()

    @property
    def tractions(self) -> Array:
        """Multipliers z, minus the tractions on the slave, shape (slave nodes, dim) [stress]."""
        return self._interface.z_u.copy()

    @property
    def pressure(self) -> Array:
        """Contact pressure z_n, positive in compression, shape (slave nodes,) [stress]."""
        return self._interface.pressure

    @property
    def shear(self) -> Array:
        """Multiplier z_tau along tau, shape (slave nodes,) [stress]; in space (slave nodes, 3).

        It has the sign of the slip: the shear traction on the slave is -z_tau. In space it is the
        tangential part of the multiplier, a vector.
        """
        now = self._interface.now
        return np.array(now.shear if self._interface.slave.dim == 3 else now.z_tau)

    @property
    def gap(self) -> Array:
        """Mean gap g_j / w_j, nan at nodes without partner, shape (slave nodes,) [length]."""
        return self._interface.gap.copy()

    @property
    def slip(self) -> Array:
        """Slip of the last step along tau, (slave nodes,) [length]; in space (slave nodes, 3).

        Slip of the slave relative to the master since the accepted state before the last solve.
        """
        now = self._interface.now
        return np.array(now.slip_in_space if self._interface.slave.dim == 3 else now.slip)

    @property
    def active(self) -> Flags:
        """Active set, the nodes whose gap is closed, shape (slave nodes,), bool."""
        return self._interface.active.copy()

    @property
    def sticking(self) -> Flags:
        """Active nodes that stick or are tied, shape (slave nodes,), bool."""
        return self._interface.sticking

    @property
    def status(self) -> npt.NDArray[np.str_]:
        """Status "open", "stick" or "slip" (also without friction), shape (slave nodes,)."""
        closed = np.where(self.sticking, "stick", "slip")
        return np.where(self.active, closed, "open")

    @property
    def forces(self) -> Array:
        """Contact forces on the slave nodes, shape (slave nodes, dim) [stress length].

        With a thickness, as for bodies of revolution, forces on the whole bodies [force].

        Collective.
        """
        return -self._interface.operators.force(self._interface.z_u)[0]

    @property
    def total_force(self) -> Array:
        """Total contact force on the slave body, shape (dim,) [stress length]."""
        return self._interface.total_force

    @property
    def friction_work(self) -> float:
        """Work of friction in the last step, by the shear at its end [stress length^2]."""
        return self._interface.now.friction_work

    @property
    def fluxes(self) -> list[NodalFlux]:
        """Fluxes of scalar fields, in the order of ``fluxes`` or ``fields``; collective."""
        return [flux.nodal() for flux in self._interface.all_fluxes]

    @property
    def offset(self) -> Array:
        """Length subtracted from the pointwise gap, shape (slave nodes,) [length].

        May be set, also by one number for all nodes. An interference of the mesh is ramped by
        ``contact.offset = (1 - t) * overlap`` with ``t`` from 0 to 1, where
        ``overlap = np.nan_to_num(contact.gap).clip(max=0)`` at the start; the wear of the last step
        is removed by ``contact.offset -= depth``.

        Raises:
            ValueError: If the new offset has a wrong shape or is not finite.
        """
        return self._interface.offset.copy()

    @offset.setter
    def offset(self, lengths: Array | float) -> None:
        self._interface.offset = lengths

    @property
    def memory(self) -> dict[str, Array]:
        """Memory of the law at the last accepted state by name, (slave nodes,) each [its units]."""
        instant = self._interface.accepted_instant
        return {} if instant is None else {n: v.copy() for n, v in instant.memory.items()}

    @property
    def c_n(self) -> float:
        """Weight of the gap in the complementarity function [1]; may be set."""
        return self._interface.c_n

    @c_n.setter
    def c_n(self, weight: float) -> None:
        self._interface.c_n = weight

    @property
    def state(self) -> InterfaceState:
        """Multipliers, active set and all other quantities of the interface's state, as a value."""
        return self._interface.state
