# SPDX-License-Identifier: MIT
"""Redundant stick: nodes whose stick already follows from other constraints.

A closed gap and stick are one constraint each. If several pairs share nodes, stick constraints may
depend on other constraints. Examples: the two closed gaps of a groove fix a node completely; a
facet of body C across the joint of A and B keeps the corners of both on one line; where four blocks
meet, two of the four sticks close a loop. The shear is then not unique, and the linear system is
singular, or nearly singular if a gap opens by rounding.

A redundant node sticks elastically with k = 1000 k_j,

    z_tau = z_tau,old + (k / l_j) u,      u: slip since the last accepted state,

up to the friction limit. As long as the stick is redundant, u vanishes up to the curvature of the
constraints, and the shear is constant: among all admissible shears it is the one nearest to the
last. If the stick is no longer redundant, for example if one flank of a groove moves, u is a true
slip, and the node soon slides.

In space a node sticks along two tangents; it is redundant if one of both sticks is.

Dependence is found from the rows (D_jk n, -M_jl n) and (D_jk tau, -M_jl tau) at the last accepted
state. A row whose slave node belongs to no other pair cannot be part of a vanishing sum. Only rows
of shared slave nodes are therefore compared, a few per corner. The curves of a surface that may
touch itself count as pairs: at a junction of cracks, nodes belong to two of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.utils.arrays import SAME_PLACE, Array, Indices

# Norm of the remainder of a normalized row after projection [1] below which the row is dependent.
# The remainder of a redundant row is of the order of the strains of the step.
DEPENDENT = 0.1


class _Entries(NamedTuple):
    """Entries of the rows of gaps and sticks of a pair.

    Attributes:
        row: Number of the row, dim j for the gap of slave node j, the next ones for its sticks.
        node: Global number of the node.
        value: Coefficients of its components, shape (entries, dim) [1].
        own: Whether the entry is of D, not of M.
    """

    row: Indices
    node: Indices
    value: Array
    own: npt.NDArray[np.bool_]


class Redundancy:
    """Search for redundant sticks of all pairs; replicated, all methods are local.

    Args:
        interfaces: All pairs.
    """

    def __init__(self, interfaces: Sequence[Interface]) -> None:
        self._contacts = [c for c in interfaces if isinstance(c, Contact)]
        self._curves = [_curves(contact) for contact in self._contacts]
        nodes = [_occurrences(contact) for contact in self._contacts]
        found, count = np.unique(np.concatenate([[], *nodes]), return_counts=True)
        self._shared = found[count > 1]

    def mark(self) -> None:
        """Mark the redundant sticks of the present active sets in the states of all contacts.

        The mark of a sticking node is kept: a joint closed up to rounding may open and close
        repeatedly, and this must not change the law at neighbouring nodes.
        """
        if not self._shared.size:
            return
        for contact in self._contacts:
            contact.change(redundant=contact.redundant & contact.sticking)
        if not any(map(self._sticks_at_shared, self._contacts)):
            return
        parts = [self._entries(contact) for contact in self._contacts]
        pair = np.repeat(np.arange(len(parts)), [part.row.size for part in parts])
        row, node, value, own = (np.concatenate(fields) for fields in zip(*parts, strict=True))
        dim = value.shape[1]
        curve = [of[part.row // dim] for of, part in zip(self._curves, parts, strict=True)]
        kept = repeating(pair + len(parts) * np.concatenate(curve), row, node, own)
        if not kept.any():
            return
        pair, row, node, value = pair[kept], row[kept], node[kept], value[kept]
        rows, index = np.unique(
            np.stack([row % dim, pair, row // dim]), axis=1, return_inverse=True
        )
        nodes, column = np.unique(node, return_inverse=True)
        matrix = np.zeros((rows.shape[1], nodes.size, dim))
        np.add.at(matrix, (index.ravel(), column.ravel()), value)
        sticks, pair, slave_node = rows
        redundant = dependent(matrix.reshape(len(matrix), -1)) & (sticks > 0)
        for i in np.unique(pair[redundant]):
            marks = self._contacts[i].redundant.copy()
            marks[slave_node[redundant & (pair == i)]] = True
            self._contacts[i].change(redundant=marks)

    def begin(self) -> None:
        """Clear all marks."""
        for contact in self._contacts:
            contact.change(redundant=np.zeros(contact.slave.num_nodes, bool))

    def _sticks_at_shared(self, contact: Contact) -> bool:
        """Whether a sticking node is shared with another pair."""
        sticks = contact.slave.nodes[contact.sticking]
        return bool(sticks.size and np.isin(sticks, self._shared).any())

    @staticmethod
    def _entries(contact: Contact) -> _Entries:
        """Normalized rows of active gaps and sticks; prescribed components are zero.

        Entries of nodes that are coupled only because positions differ by rounding are dropped.
        """
        parts = list(_directed_entries(contact))
        row, node, value, own = (np.concatenate(fields) for fields in zip(*parts, strict=True))
        length = np.sqrt(np.bincount(row, (value**2).sum(axis=1)))[row]
        value = value / np.where(length > 0.0, length, 1.0)[:, None]
        couples = np.abs(value).max(axis=1) > SAME_PLACE
        return _Entries(row[couples], node[couples], value[couples], own[couples])


def _curves(contact: Contact) -> Indices:
    """Curve of each slave node of a surface that may touch itself, else 0, (slave nodes,)."""
    curves, roles = np.zeros(contact.slave.num_nodes, np.int64), contact.slave.roles
    if roles is not None:
        curves[contact.slave.facets] = roles.keys[:, 1:]
    return curves


def _occurrences(contact: Contact) -> Indices:
    """Nodes of a pair; twice those that two curves share on a surface that may touch itself."""
    itself = contact.slave is contact.master
    return contact.slave.nodes if itself else np.unique(contact.nodes)


def _directed_entries(contact: Contact) -> Iterator[_Entries]:
    """Entries of D and M at the last accepted state, along the present n and tangents."""
    o, partners = contact.operators, contact.partners
    sticks = [(contact.sticking, tangent) for tangent in contact.now.tangents]
    for kind, (on, direction) in enumerate([(contact.active, o.n), *sticks]):
        for surface, matrix, free, sign in (
            (contact.slave, partners.D, contact.free, 1.0),
            (contact.master, partners.M, contact.master_free, -1.0),
        ):
            entries = csr_array(matrix).tocoo()
            mine = on[entries.row]
            j, k, c = entries.row[mine], entries.col[mine], sign * entries.data[mine]
            value = c[:, None] * direction[j] * free[k]
            own = np.full(j.size, sign > 0.0)
            row = o.n.shape[1] * j.astype(np.int64) + kind
            yield _Entries(row, surface.nodes[k], value, own)


def repeating(
    pair: Indices, row: Indices, node: Indices, own: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Entries of rows that may be part of a vanishing sum.

    Rows with a slave node that is in no row of another pair are removed, repeatedly.

    Args:
        pair: Number of the pair or curve of each entry, shape (entries,).
        row: Number of its row in the pair, shape (entries,).
        node: Number of its node, shape (entries,).
        own: Whether an entry is that of a slave node, shape (entries,), bool.

    Returns:
        Shape (entries,), bool.
    """
    kept = np.ones(row.size, bool)
    _, number = np.unique(np.stack([pair, row]), axis=1, return_inverse=True)
    number = number.ravel()
    while kept.any():
        couples = np.unique(np.stack([node[kept], pair[kept]]), axis=1)
        found, count = np.unique(couples[0], return_counts=True)
        alone = own & ~np.isin(node, found[count > 1])
        lost = np.bincount(number, alone & kept)[number] > 0
        if not (kept & lost).any():
            break
        kept &= ~lost
    return kept


def dependent(rows: Array) -> npt.NDArray[np.bool_]:
    """Rows that depend linearly on preceding rows, up to ``DEPENDENT``, shape (rows,), bool.

    Args:
        rows: Normalized or zero rows, shape (rows, columns).
    """
    basis = np.empty((0, rows.shape[1]))
    found = np.zeros(len(rows), bool)
    for i, row in enumerate(rows):
        rest = row - basis.T @ (basis @ row)
        rest -= basis.T @ (basis @ rest)
        size = float(np.linalg.norm(rest))
        found[i] = size < DEPENDENT
        if not found[i]:
            basis = np.vstack([basis, rest / size])
    return found
