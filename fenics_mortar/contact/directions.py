# SPDX-License-Identifier: MIT
"""Directional derivatives of the nodal fields of a contact, replicated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.contact.interface_fields import InterfaceFields
from fenics_mortar.interface.linearization import Block
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import sum_over_ranks


def change_along(
    f: InterfaceFields, blocks: Sequence[Block], on_slave: Array, on_master: Array
) -> Array:
    """Product of blocks, whose rows are slave nodes, and a direction (collective).

    Args:
        f: Fields of the pair.
        blocks: Blocks of this rank.
        on_slave: Displacements of the slave nodes, shape (n, dim) [length].
        on_master: Displacements of the master nodes, shape (n, dim) [length].

    Returns:
        Shape (slave nodes,), equal on all ranks.
    """
    sides = f.interface.slave, f.interface.master
    dofs = np.concatenate([side.dofs_of(np.arange(side.num_nodes)) for side in sides])
    values = np.concatenate([on_slave.ravel(), on_master.ravel()])
    order = np.argsort(dofs)
    change = np.zeros(sides[0].num_nodes)
    for block in blocks:
        index = order[np.searchsorted(dofs[order], np.maximum(block.columns, dofs.min()))]
        direction = np.where(block.columns >= 0, values[index], 0.0)
        np.add.at(change, block.rows, np.einsum("bjq,bq->bj", block.values, direction))
    return sum_over_ranks(sides[0].comm, change)


def gap_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Change of the mean gaps; zero where not covered (collective); see ``change_along``."""
    change = change_along(f, f.operators.gap_derivative(), on_slave, on_master)
    return np.where(f.covered, change / np.where(f.covered, f.operators.weight, 1.0), 0.0)


def slip_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Slip of the nodes along their partners (local); see ``change_along``.

    In space the components along two tangents, shape (slave nodes, 2).
    """
    partners = f.state.partners
    return f.along_tangents(partners.D @ on_slave - partners.M @ on_master)


def opening_rate(f: ContactFields, on_slave: Array, on_master: Array) -> Array:
    """Opening along n, against which the pressure does work (local); see ``change_along``.

    This differs from the rate of the gap where n is not normal to both sides, as at corners.
    """
    partners = f.state.partners
    relative = partners.D @ on_slave - partners.M @ on_master
    return -np.asarray(np.einsum("ja,ja->j", f.operators.n, relative))
