# SPDX-License-Identifier: MIT
"""State of a problem as a value: all quantities from which a solve starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fenics_mortar.bulk.history import HistoryValues
from fenics_mortar.bulk.inertia import Rates
from fenics_mortar.contact.state import InterfaceState
from fenics_mortar.obstacles.rotations import places_towards
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.arrays import Array, Value
from fenics_mortar.utils.errors import MortarError
from fenics_mortar.verify.crossing import AcceptedPositions


@dataclass(frozen=True)
class State(Value):
    """All quantities from which a solve starts, as an immutable value; all methods are local.

    ``replaced`` and ``dataclasses.replace`` return changed copies.

    Attributes:
        u: Displacement and other unknowns of the bulk, shape (local dofs,) [length].
        interfaces: State of each pair.
        places: Places (x, y, angle) of the m obstacles and remote loads, shape (m, 3) [length,
            length, radian].
        accepted_positions: Positions of outlines and obstacles in the last accepted state.
        converged: Whether the last solve ended in this state.
        history: Values of the history functions of the bodies.
        rates: Velocity and accelerations, ``None`` in statics.
    """

    u: Array
    interfaces: tuple[InterfaceState, ...]
    places: Array
    accepted_positions: AcceptedPositions
    converged: bool
    history: HistoryValues
    rates: Rates | None = None

    def with_settings_of(self, other: State) -> State:
        """This state with the offsets, weights of gaps, time and undeformed operators of ``other``.

        Users set these for a problem, while this state may be an extrapolation of earlier states or
        the state of another model.
        """
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        return self.replaced(
            interfaces=tuple(
                a.replaced(offset=b.offset, c_n=b.c_n, reference=b.reference, load_time=b.load_time)
                for a, b in pairs
            ),
        )

    def counting_slip_from(self, other: State) -> State:
        """This state with the partners, instants, history and accepted positions of ``other``."""
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        return self.replaced(
            interfaces=tuple(
                a.replaced(
                    partners=b.partners,
                    accepted_partners=b.accepted_partners,
                    start_instant=b.start_instant,
                    accepted_instant=b.accepted_instant,
                )
                for a, b in pairs
            ),
            accepted_positions=other.accepted_positions,
            history=other.history,
        )

    def towards(self, other: State, fraction: float) -> State:
        """Interpolate to ``other`` by a ``fraction`` [1], with the active sets of this state."""
        pairs = zip(self.interfaces, other.interfaces, strict=True)
        return self.replaced(
            u=self.u + fraction * (other.u - self.u),
            interfaces=tuple(a.replaced(z=a.z + fraction * (b.z - a.z)) for a, b in pairs),
            places=places_towards(self.places, other.places, fraction),
        )


def check_state(
    state: Any,
    shape: tuple[int, ...],
    pairs: Sequence[tuple[int, ...]],
    num_movers: int,
    history: int,
) -> None:
    """Check that an object is a state of this problem (local).

    Args:
        state: The object.
        shape: Shape of the displacement of the problem.
        pairs: Shapes of the multipliers of its pairs.
        num_movers: Number of its obstacles and remote loads.
        history: Number of its local values of history functions.

    Raises:
        TypeError: If the object is not a state.
        MortarError: If its arrays have other shapes.
    """
    check_kind("state", state, State, "what state() of the same problem returned")
    found = [interface.z.shape for interface in state.interfaces]
    same = state.u.shape == shape and state.history.accepted.shape == (history,)
    if not (same and found == list(pairs) and len(state.places) == num_movers):
        raise MortarError(
            "the state belongs to another problem: expected a result of state() of this one"
        )
