# SPDX-License-Identifier: MIT
"""Binding of all pairs to the space of the displacement; removal of tied gaps from the mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.crosspoints import (
    drop_contact_nodes,
    drop_crosspoints,
    drop_shared_multipliers,
    tied_nodes,
)
from fenics_mortar.contact.interface import NO_NODES, NO_WELDS
from fenics_mortar.contact.pair import ContactPair
from fenics_mortar.contact.tied import Tie
from fenics_mortar.contact.tied_pair import TiedPair
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils.arrays import Flags
from fenics_mortar.utils.errors import SurfaceError


def bind(
    pairs: Sequence[ContactPair | TiedPair],
    space: DisplacementSpace,
    prescribed: Flags,
    *,
    chains: bool = True,
) -> list[Contact | Tie]:
    """Bind all pairs; remove the gaps of tied ones from the mesh (collective).

    Args:
        pairs: The pairs.
        space: Nodes and dofs of the displacement; nodes of the mesh may be moved.
        prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
        chains: Whether nodes may follow nodes that follow others; see ``crosspoints``.

    Returns:
        Contacts and ties in the order of the pairs.

    Raises:
        SurfaceError: On all ranks, if a surface is unsuitable or a gap cannot be removed.
    """
    ties = {pair: Tie(pair, space, prescribed) for pair in pairs if isinstance(pair, TiedPair)}
    every_tie = list(ties.values())
    if chains:
        drop_crosspoints(every_tie)
    tied = tied_nodes(every_tie) if chains else NO_NODES
    welds = np.concatenate([NO_WELDS, *(tie.welds() for tie in every_tie)])

    def all_bound() -> list[Contact | Tie]:
        return [
            ties[pair]
            if isinstance(pair, TiedPair)
            else Contact(pair, space, prescribed, welds, tied)
            for pair in pairs
        ]

    bound = all_bound()
    (drop_contact_nodes if chains else drop_shared_multipliers)(every_tie, bound)
    return all_bound() if close_gaps(every_tie, space) else bound


def close_gaps(ties: Sequence[Tie], space: DisplacementSpace) -> bool:
    """Move slave nodes of ties with gap="removed" onto their masters (collective).

    D and M remain those of the initial positions; the new positions satisfy their constraints.
    Several sweeps are needed, since a master may be the slave of another tie.

    Returns:
        Whether a node was moved.

    Raises:
        SurfaceError: If the mesh cannot represent the new positions.
    """
    closing = [tie for tie in ties if tie.pair.gap == "removed"]
    for sweep in range(len(closing) + 2):
        open_ties = [tie for tie in closing if tie.close_gap(space)]
        if not open_ties:
            return sweep > 0
        for tie in ties:
            tie.update_reference(space)
    raise SurfaceError(
        f"the gap of {open_ties[0].pair} cannot be removed: straight cells with a displacement of "
        f"degree 2 cannot represent a curved interface; use a mesh of second order, or gap='kept'"
    )
