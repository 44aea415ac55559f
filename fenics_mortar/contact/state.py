# SPDX-License-Identifier: MIT
"""State of an interface: all quantities that a solve changes or passes to the next solve."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from fenics_mortar.contact.law import Branches
from fenics_mortar.utils.arrays import Array, Flags, Value

# Attributes that follow from the others at the end of a solve; they are not written to files.
# Instants are written by ``law_calls``.
DERIVED = {"derived": True}


@dataclasses.dataclass(frozen=True, eq=False)
class InterfaceState(Value):
    """State of one interface, a value: ``dataclasses.replace`` makes another one.

    Arrays are read-only and equal on all ranks.

    Attributes:
        z: Multipliers, minus the traction on the slave, shape (slave nodes, 2) [stress]; on a tie
            with fields, further columns with their fluxes.
        conduction: Multipliers of the conductances of a contact, the flux of each at the carriers,
            zero elsewhere, shape (slave nodes, conductances) [flux]; see ``fluxes``.
        active: Active set, shape (slave nodes,), bool.
        branch: Branch of the law that each node is on, 0 where it sticks, shape (slave nodes,).
        multiplier_nodes: Whether a slave node carries a multiplier, shape (slave nodes,), bool:
            false if it is prescribed or hardly covered.
        redundant: Whether the stick of a node follows from other constraints, so that it sticks
            elastically, shape (slave nodes,), bool; see ``redundancy``.
        partners: Material points that slip is counted from, the ``Partners`` of the slave nodes at
            the start of the step; ``None`` for a tie.
        accepted_partners: Partners at the last accepted state, used in the next step.
        c_n: Weight of the gap in the complementarity function [1]; reduced below the pair's value
            after a cycle of the active set.
        offset: Length subtracted from the pointwise gap, shape (slave nodes,) [length].
        reference: Operators of the undeformed mesh, with small sliding.
        load_time: Time of the present loads, at the end of the step [time].
        start_instant: ``Instant`` at the start of the step; the law reads its memory; ``None`` for
            a tie.
        accepted_instant: ``Instant`` of the last accepted state, used in the next step.
        force_decided: Nodes with tensile multiplier and compressive force, shape (slave nodes,),
            bool, and the forces of all nodes, shape (slave nodes, 2) [stress length], for the next
            active set; see ``Contact.move``.
        heading: In space, the directions in which nodes slid in the last iteration, zero where they
            did not, (slave nodes, 3) [1], and how often each has turned back in this solve, (slave
            nodes,), int; see ``active_set``.
    """

    z: Array
    active: Flags
    branch: Branches
    multiplier_nodes: Flags
    redundant: Flags = dataclasses.field(metadata=DERIVED)
    partners: Any = dataclasses.field(default=None, metadata=DERIVED)
    accepted_partners: Any = dataclasses.field(default=None, metadata=DERIVED)
    c_n: float = 1.0
    offset: Any = 0.0
    conduction: Any = 0.0
    reference: Any = dataclasses.field(default=None, metadata=DERIVED)
    load_time: float = dataclasses.field(default=0.0, metadata=DERIVED)
    start_instant: Any = dataclasses.field(default=None, metadata=DERIVED)
    accepted_instant: Any = dataclasses.field(default=None, metadata=DERIVED)
    force_decided: tuple[Flags, Array] | None = dataclasses.field(default=None, metadata=DERIVED)
    heading: tuple[Array, Array] | None = dataclasses.field(default=None, metadata=DERIVED)

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of nodes, components and, of a contact, nodes and conductances (local)."""
        return *self.z.shape, *np.shape(self.conduction)

    def towards(self, other: InterfaceState, fraction: float) -> InterfaceState:
        """Interpolate the multipliers to ``other`` by a ``fraction`` [1] (local)."""
        z, q = self.z, self.conduction
        return self.replaced(
            z=z + fraction * (other.z - z), conduction=q + fraction * (other.conduction - q)
        )


# Names of the attributes that determine all others.
INDEPENDENT = tuple(
    attribute.name for attribute in dataclasses.fields(InterfaceState) if not attribute.metadata
)
