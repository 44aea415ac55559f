# SPDX-License-Identifier: MIT
"""Nodes and dofs of the two sides of a pair, which are the rows of D and the columns of M."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.interface.surfaces import Surface, replicate
from fenics_mortar.mesh.numbering import numbered_dofs
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Array, Indices


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
