# SPDX-License-Identifier: MIT
"""What the equations need of a load or motion given at a point: a remote load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.la.system import LinearSystem
from fenics_mortar.rigid.bordered import Border
from fenics_mortar.utils.arrays import Array
from fenics_mortar.utils.errors import MortarError


class RemoteMotion(Protocol):
    """A remote load in the space of a problem; all methods are collective.

    Attributes:
        motion: The object of the user, with place and loads.
        arm: Length that turns angles into motions [length].
    """

    motion: Any
    arm: float

    def bind_forces(self, bulk: Bulk, contacts: Sequence[Any]) -> None:
        """Set the source of forces: the bodies, contacts and ties."""

    def force(self) -> Array:
        """f_q at the last evaluated state, shape (3,) [stress length]."""

    def constant_force(self) -> Array:
        """The part of f_q that is not linear in the multipliers, shape (3,) [stress length]."""

    def take_bulk_rows(self) -> None:
        """Store products with the tangent of the bodies, before contact changes it."""

    def linearize(self, system: LinearSystem) -> Border:
        """C_q, [E_d, M_q] and E_q of the three motions; see ``balance``."""

    def pushed_nodes(self) -> Array | float:
        """The push as forces on nodes with its resultants, (owned dofs,) [stress length]."""

    def record(self) -> str:
        """Set the ``reaction`` of the user's object; return a sentence."""


def refuse_remote(loads: Sequence[Any], purpose: str) -> None:
    """Raise an error where remote loads are not implemented (local, equal on all ranks).

    Raises:
        MortarError: If there are any.
    """
    if loads:
        name = f"{loads[0].motion.kind} '{loads[0].motion.name}'"
        raise MortarError(f"{purpose} with remote loads, as {name}")


def check_remote(remote: Any) -> None:
    """Reject remote loads of a wrong type, or given twice (local).

    Raises:
        ValueError: If they are not a list of different remote loads.
    """
    if not isinstance(remote, Sequence) or not all(hasattr(load, "bind") for load in remote):
        raise ValueError(f"remote={remote!r}: expected a list of remote loads, e.g. RigidBoundary")
    if len(set(map(id, remote))) < len(remote):
        raise ValueError(f"remote={remote!r}: a remote load is given twice")
