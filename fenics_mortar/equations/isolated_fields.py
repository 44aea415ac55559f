# SPDX-License-Identifier: MIT
"""Bodies on which nothing determines the level of a scalar field, such as a temperature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from fenics_mortar.bulk.bodies import join_bodies
from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.tied import Tie
from fenics_mortar.contact.tied_field import rows_of
from fenics_mortar.rigid.floating import FloatingBodies
from fenics_mortar.utils import compat
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.ranks import largest_over_ranks, sum_over_ranks
from fenics_mortar.utils.rounding import ROUNDING


def describe_isolated(bulk: Bulk, contacts: Sequence[Interface], floating: FloatingBodies) -> str:
    """Name the bodies and fields whose level nothing determines; "" if none (collective).

    Args:
        bulk: The bodies.
        contacts: All pairs.
        floating: The bodies with their names.
    """
    found = []
    for field in range(bulk.space.whole.num_sub_spaces if bulk.space.is_mixed else 0):
        part_of = None if field == bulk.space.part else _part_of_dofs(bulk, floating, field)
        if part_of is None:
            continue
        count = floating.num_parts
        links = list(_conducting(contacts, floating, field))
        group, _ = join_bodies(np.arange(count + 1), count + 1, links)
        resistance = np.bincount(group, _resistance(bulk, part_of, count), count + 1)
        for label in np.unique(group[:count]):
            if label != group[count] and resistance[label] == 0.0:
                parts = np.flatnonzero(group == label)
                names = " and ".join(
                    sorted(floating.name_of(int(p), floating.parts) for p in parts)
                )
                found.append(
                    f"nothing determines the level of field {field} of {names}: neither Dirichlet "
                    "conditions, nor its equation, nor conduction across contact"
                )
    return "; ".join(found)


def _part_of_dofs(bulk: Bulk, floating: FloatingBodies, field: int) -> Indices | None:
    """Part of the mesh of each owned dof of a scalar field, -1 for others; ``None`` for vectors."""
    Q, numbers = bulk.space.whole.sub(field).collapse()
    if Q.dofmap.index_map_bs > 1 or Q.num_sub_spaces:
        return None
    cells = floating.parts[compat.dofmap(bulk.V)[:, :1]]
    dofs = np.asarray(numbers, np.int64).ravel()[compat.dofmap(Q)]
    part_of = np.full(bulk.u.x.array.size, -1)
    part_of[dofs] = cells
    return part_of[: bulk.num_owned]


def _resistance(bulk: Bulk, part_of: Indices, count: int) -> Array:
    """1 for parts whose equations or conditions resist a constant field, else 0, (count + 1,).

    The last entry is that of no part. With ``bulk.K`` assembled anew.
    """
    bulk.assemble_tangent()
    x, y = bulk.K.createVecs()
    ones, sizes = part_of >= 0, np.zeros((2, count + 1))
    x.array[:] = ones
    bulk.K.mult(x, y)
    for size, values in zip(sizes, (y.array_r, bulk.K.getDiagonal().array_r), strict=True):
        np.maximum.at(size, part_of[ones], np.abs(values[ones]))
    x.destroy()
    y.destroy()
    response, own = largest_over_ranks(bulk.comm, sizes)
    fixed = ones & bulk.prescribed[: ones.size]
    prescribed = sum_over_ranks(bulk.comm, np.bincount(part_of[fixed], minlength=count + 1))
    return np.where((prescribed > 0.0) | (response > ROUNDING * own), 1.0, 0.0)


def _conducting(
    contacts: Sequence[Interface], floating: FloatingBodies, field: int
) -> Iterator[Indices]:
    """Pairs of parts between which a field flows, (k, 2) each; the number of parts: an obstacle."""
    for contact in contacts:
        for flux in contact.fluxes:
            slave, *master = (floating.parts_of(trace.surface) for trace in flux.traces)
            if isinstance(contact, Tie):
                if flux.field == field:
                    yield _partners(flux.M, slave, master[0])
            elif flux.law.field == field:
                on = flux.nodal().conductance > 0.0
                none = np.full(slave[on].size, floating.num_parts)
                M = rows_of(on, contact.operators.matrices[1])
                yield _partners(M, slave, *master) if master else np.stack([slave[on], none], 1)


def _partners(M: Any, slave: Indices, master: Indices) -> Indices:
    """Parts of slave nodes and of their masters, (k, 2)."""
    nodes = M.tocoo()
    return np.stack([slave[nodes.row], master[nodes.col]], axis=1)
