# SPDX-License-Identifier: MIT
"""Derivative of a contact's rows with respect to its offset, by the gap g_j - D_jk offset_k.

Multipliers, displacement, active set and weights of the rows are fixed.
"""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface.mortar import MortarOperators
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.ranks import sum_over_ranks


def weights_of_gaps(contact: Contact) -> Array:
    """Derivative of a node's two rows with respect to its weighted gap, (slave nodes, 2) [1].

    Contributions of the row of a closed gap and of the law, which depends on the mean gap (local).
    """
    f = contact.now
    normal, _, *weights = contact.rows.frame()
    per_weight = np.where(f.covered, 1.0 / np.where(f.covered, f.operators.weight, 1.0), 0.0)
    total = normal.copy()
    for weight, row in zip(weights, f.law_rows, strict=True):
        total -= weight * (row.by_gap * per_weight)[:, None]
    return total


def gap_along(o: MortarOperators, offset: Array) -> Array:
    """Change of the weighted gaps with the offset, (slave nodes,) [length^2] (collective).

    Args:
        o: The operators.
        offset: Change of the offset, shape (slave nodes,) [length].
    """
    return _nodal_sums(o, -np.einsum("ejk,ek->ej", o.D, offset[o.facet_nodes]))


def gap_back(o: MortarOperators, weights: Array) -> Array:
    """Gradient, by the offset, of the sum of weighted gaps times ``weights`` (collective).

    Args:
        o: The operators.
        weights: Shape (slave nodes,).

    Returns:
        Shape (slave nodes,) [unit of the weights times length].
    """
    return _nodal_sums(o, -np.einsum("ejk,ej->ek", o.D, weights[o.facet_nodes]))


def _nodal_sums(o: MortarOperators, entries: Array) -> Array:
    """Sums of entries of this rank's facets, shape (f, K), at the slave nodes (collective)."""
    total = np.zeros(len(o.x))
    np.add.at(total, o.facet_nodes, entries)
    return sum_over_ranks(o.slave.comm, total)


def rows_by_offset(contact: Contact, offset: Array) -> Array:
    """Change of the rows with the offset, shape (slave nodes, 2) [stress length] (collective).

    Args:
        contact: The contact, evaluated.
        offset: Change of the offset, shape (slave nodes,) [length].
    """
    return weights_of_gaps(contact) * gap_along(contact.operators, offset)[:, None]


def offset_by_rows(contact: Contact, rows: Array) -> Array:
    """Gradient of the sum of the rows times ``rows``, (slave nodes,) (collective).

    In the unit of ``rows`` times [stress].
    """
    weights = np.einsum("jc,jc->j", weights_of_gaps(contact), rows)
    return gap_back(contact.operators, weights)
