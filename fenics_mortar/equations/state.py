# SPDX-License-Identifier: MIT
"""The state of a problem, as a value: all that a solve begins from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from fenics_mortar.bulk.inertia import Rates
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array, freeze
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.verify.crossing import Standing


@dataclass(frozen=True)
class State:
    """All that a solve begins from: a value, ``dataclasses.replace`` makes another one.

    Attributes:
        u: Displacement and other unknowns of the bulk, the part of this rank.
        interfaces: State of each pair.
        places: Places of the obstacles, shape (obstacles, 3).
        standing: Places of outlines and obstacles at the last accepted state.
        converged: Whether the last solve ended in this state.
        rates: Velocity and accelerations, ``None`` in statics.
    """

    u: Array
    interfaces: tuple[InterfaceState, ...]
    places: Array
    standing: Standing
    converged: bool
    rates: Rates | None = None

    def __post_init__(self) -> None:
        """Take copies of arrays that can be written to."""
        freeze(self)

    def with_settings_of(self, other: State) -> State:
        """This state with the offsets, weights of gaps and undeformed operators of another one.

        These are set by users and kept by a problem, where this state may be a guess from earlier
        ones, or that of another model.
        """
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        return replace(
            self,
            interfaces=tuple(
                replace(a, offset=b.offset, c_n=b.c_n, reference=b.reference) for a, b in pairs
            ),
        )

    def counting_slip_from(self, other: State) -> State:
        """This state with the partners and ways of another one."""
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        return replace(
            self,
            interfaces=tuple(
                replace(a, partners=b.partners, accepted=b.accepted) for a, b in pairs
            ),
            standing=other.standing,
        )

    def towards(self, other: State, part: float) -> State:
        """Part of the way to another state, with the sets of this one."""
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        return replace(
            self,
            u=self.u + part * (other.u - self.u),
            interfaces=tuple(replace(a, z=a.z + part * (b.z - a.z)) for a, b in pairs),
            places=self.places + part * (other.places - self.places),
        )


def check_state(state: Any, shape: tuple[int, ...], pairs: Sequence[tuple[int, ...]]) -> None:
    """Refuse an object that is no state, or one of another problem (local).

    Args:
        state: The object.
        shape: Shape of the displacement of the problem.
        pairs: Shapes of the multipliers of its pairs.

    Raises:
        TypeError: If it is no state.
        MortarError: If its arrays have other shapes.
    """
    check_kind("state", state, State, "what state() of the same problem returned")
    found = [interface.z.shape for interface in state.interfaces]
    if state.u.shape != shape or found != list(pairs):
        raise MortarError(
            "the state belongs to another problem: expected a result of state() of this one"
        )
