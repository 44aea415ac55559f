# SPDX-License-Identifier: MIT
"""A pair as users read it: nodal fields along the slave surface, and forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.utils.arrays import Array, Flags, Indices


class PairView:
    """A contact or tied pair of a problem, ``problem.contacts[i]``: what was found on it.

    All arrays are equal on all ranks. Nodal ones are in the order of the slave nodes along the
    surface, at the present multipliers and the last evaluated displacement, which after a solve is
    the solution. None of this is collective.
    """

    def __init__(self, interface: Interface) -> None:
        self._interface = interface

    def __repr__(self) -> str:
        """The pair, its force and the number of its active nodes."""
        force = ", ".join(f"{component:.6g}" for component in self.total_force)
        return f"<{self.pair!r}: force ({force}), {self.active.sum()} nodes active>"

    def __dir__(self) -> list[str]:
        """The public attributes."""
        return [name for name in vars(type(self)) if not name.startswith("_")]

    @property
    def pair(self) -> Any:
        """The ``ContactPair`` or ``TiedPair``; its ``law`` may be set."""
        return self._interface.pair

    @property
    def nodes(self) -> Indices:
        """Global numbers of the slave nodes, shape (slave nodes,)."""
        return self._interface.slave.nodes

    @property
    def positions(self) -> Array:
        """Present positions of the slave nodes, shape (slave nodes, 2) [length]."""
        return self._interface.operators.x

    @property
    def normals(self) -> Array:
        """Outward unit normals of the slave nodes, shape (slave nodes, 2)."""
        return self._interface.operators.n

    @property
    def lengths(self) -> Array:
        """Length of undeformed slave surface that belongs to each node, (slave nodes,) [length]."""
        return self._interface.nodal_lengths

    @property
    def tractions(self) -> Array:
        """Multipliers z, minus the tractions on the slave, shape (slave nodes, 2) [stress]."""
        return self._interface.z

    @property
    def pressure(self) -> Array:
        """Normal part of the tractions, positive in compression, shape (slave nodes,) [stress]."""
        return self._interface.pressure

    @property
    def shear(self) -> Array:
        """Part of the tractions along the tangent, shape (slave nodes,) [stress]."""
        return self._interface.z_tau

    @property
    def gap(self) -> Array:
        """Mean gap of each node, nan where it has no partner, shape (slave nodes,) [length]."""
        return self._interface.gap

    @property
    def slip(self) -> Array:
        """Slip along the tangent in the last step, shape (slave nodes,) [length]."""
        return self._interface.slip

    @property
    def active(self) -> Flags:
        """Active set: nodes whose gap is closed, shape (slave nodes,), bool."""
        return self._interface.active

    @property
    def sticking(self) -> Flags:
        """Active nodes that stick by friction, or are tied, shape (slave nodes,), bool."""
        return self._interface.sticking

    @property
    def status(self) -> npt.NDArray[np.str_]:
        """Each node is "open", or by friction "stick" or "slip"; without it "slip"."""
        closed = np.where(self.sticking, "stick", "slip")
        return np.where(self.active, closed, "open")

    @property
    def forces(self) -> Array:
        """Contact forces on the slave nodes, shape (slave nodes, 2) [stress length].

        Collective.
        """
        return -self._interface.operators.force(self._interface.z)[0]

    @property
    def total_force(self) -> Array:
        """Total force that acts on the slave body, shape (2,) [stress length]."""
        return self._interface.total_force

    @property
    def offset(self) -> Array:
        """Length taken off the pointwise gap, shape (slave nodes,) [length].

        May be set, to ramp an interference of the mesh: go with ``t`` from 0 to 1 by
        ``contact.offset = (1 - t) * overlap``, where ``overlap`` is
        ``np.nan_to_num(contact.gap).clip(max=0)`` at the start.

        Raises:
            ValueError: If an offset of another shape, nan or inf is set.
        """
        return self._interface.offset

    @offset.setter
    def offset(self, lengths: Array) -> None:
        self._interface.offset = lengths

    @property
    def c_n(self) -> float:
        """Weight of the gap in the complementarity function; may be set."""
        return self._interface.c_n

    @c_n.setter
    def c_n(self, weight: float) -> None:
        self._interface.c_n = weight

    @property
    def state(self) -> InterfaceState:
        """Multipliers, sets and all else that the next solve begins from, as a value."""
        return self._interface.state
