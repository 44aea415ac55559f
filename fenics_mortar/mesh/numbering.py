# SPDX-License-Identifier: MIT
"""Values of a function by node numbers of the mesh input, independent of the number of ranks."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MortarError, raise_together


def by_input_node(space: DisplacementSpace, u: Any) -> tuple[Indices, Array]:
    """Names and values of all nodes, on all ranks (collective).

    Args:
        space: The displacement's nodes and dofs.
        u: Function of the whole space.

    Returns:
        Names of the nodes, see ``compat.input_nodes``, shape (n, k), in ascending order, and their
        values, shape (n, 2); in a mixed space each dof counts as a node, shape (n, 1).
    """
    comm, size = space.V.mesh.comm, space.block_size
    owned = space.num_owned // size
    nodes = np.concatenate(comm.allgather(compat.input_nodes(space.whole)[:owned]))
    values = np.concatenate(comm.allgather(u.x.array.reshape(-1, size)[:owned]))
    order = np.lexsort(nodes.T[::-1])
    return nodes[order], values[order]


def set_by_input_node(space: DisplacementSpace, u: Any, nodes: Indices, values: Array) -> None:
    """Set a function from the result of ``by_input_node``, also on other ranks (collective).

    Args:
        space: The displacement's nodes and dofs.
        u: The function.
        nodes: Names of all nodes, shape (n, k).
        values: Values there, shape (n, components of a node).

    Raises:
        MortarError: On all ranks, if the nodes are those of another mesh or degree.
    """
    mine = compat.input_nodes(space.whole)
    wrong = nodes.ndim != 2 or nodes.shape[1] != mine.shape[1]
    if not wrong:
        both, number = np.unique(np.concatenate([nodes, mine]), axis=0, return_inverse=True)
        wrong = len(both) != len(nodes)
    error = MortarError("the saved state belongs to another mesh or degree") if wrong else None
    raise_together(space.V.mesh.comm, error)
    of_name = np.empty(len(both), np.int64)
    number = number.ravel()
    of_name[number[: len(nodes)]] = np.arange(len(nodes))
    u.x.array[:] = values[of_name[number[len(nodes) :]]].ravel()
