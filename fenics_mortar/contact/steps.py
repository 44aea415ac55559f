# SPDX-License-Identifier: MIT
"""Start and end of a step of all pairs: slip, time and memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mpi4py import MPI

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.instant import Instant
from fenics_mortar.contact.interface import Interface
from fenics_mortar.contact.law_calls import raise_stored
from fenics_mortar.utils.errors import MortarError, check_same


def begin_step(contacts: Sequence[Interface]) -> None:
    """Adopt the present laws, and start a step at the accepted state (collective).

    Raises:
        MortarError: On all ranks, if a law needs the length of the step and the time is not later
            than that of the accepted state.
        Exception: Any error of a law, on all ranks.
    """
    for contact in contacts:
        if isinstance(contact, Contact):
            contact.adopt_law()
            _check_time(contact)
        contact.start_step()


def needing_time(contact: Contact) -> list[Any]:
    """Laws and conductances of a contact that need the length of the step (local)."""
    law, fluxes = contact.pair.law, contact.pair.fluxes
    heated = [flux for flux in fluxes if flux.heating == "friction"] if law.has_friction else []
    return [law, *heated] if law.needs_time else heated


def _check_time(contact: Contact) -> None:
    """Raise an error for a step of zero length if a law or a source needs the length (local)."""
    now, before = contact.state.load_time, contact.state.accepted_instant.time
    needing = needing_time(contact)
    if needing and not now > before:
        raise MortarError(
            f"{needing[0]!r} needs the length of the step, but the time {now:g} is not later "
            f"than {before:g}, that of the last accepted state: set problem.time before each "
            "solve, or use follow_path or Dynamics, which set it"
        )


def instants_of(comm: MPI.Comm, contacts: Sequence[Interface]) -> list[Instant | None]:
    """Time and memory of all pairs at the end of the present step; ``None`` for ties (collective).

    Raises:
        Exception: Any error of a law, on all ranks.
        MortarError: On all ranks, if the memory of a law differs between ranks.
    """
    found = [_instant_of(c) if isinstance(c, Contact) else None for c in contacts]
    raise_stored(comm, contacts)
    memories = [
        (f"{name} of {contact.pair.law!r}", values)
        for contact, instant in zip(contacts, found, strict=True)
        if instant is not None
        for name, values in instant.memory.items()
    ]
    if memories:
        check_same(comm, memories)
    return found


def _instant_of(contact: Contact) -> Instant:
    """Time and memory at the end of the present step (local)."""
    law, node = contact.pair.law, contact.nodal
    memory = node.memory
    if law.memory:
        memory = contact.law_calls.remember(law, node, contact.branch)
    return Instant.of(contact.state.load_time, node.step, memory)


def commit(contacts: Sequence[Interface], instants: Sequence[Instant | None]) -> None:
    """Set the accepted time and memory, from which the next step starts (local)."""
    for contact, instant in zip(contacts, instants, strict=True):
        contact.change(accepted_instant=instant)


def start_clock(contacts: Sequence[Interface], time: float) -> None:
    """Set the time of the accepted state (local)."""
    for contact in contacts:
        instant = contact.state.accepted_instant
        if instant is not None and instant.time != time:
            instant = replace(instant, time=time)
        contact.change(accepted_instant=instant, load_time=time)
