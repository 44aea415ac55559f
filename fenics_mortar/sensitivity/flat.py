# SPDX-License-Identifier: MIT
"""Remarks on objectives that do not depend on a parameter of a law, since no node follows it.

If all nodes in contact stick in all steps, a larger friction limit changes nothing: the derivative
is exactly zero in a whole region, and an optimizer that compares gradients with zero stops there.
The same holds for all parameters of a pair without contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.sensitivity.controls import LawParameter
from fenics_mortar.sensitivity.protocols import Control
from fenics_mortar.utils.arrays import Array

Status = Literal["open", "stick", "other"]


def status_of(contact: Interface) -> Status:
    """Whether no node of a pair is in contact, or all that are stick (local)."""
    if not contact.active.any():
        return "open"
    if not isinstance(contact, Contact) or not contact.pair.law.has_friction:
        return "other"
    can_slide = contact.active & contact.follows_law
    return "other" if (can_slide & ~contact.now.sticking).any() else "stick"


def flat_remarks(
    contacts: Sequence[Interface],
    statuses: Sequence[Sequence[Status]],
    controls: Sequence[Control],
    by_step: Sequence[Sequence[Array]],
) -> tuple[str, ...]:
    """Describe parameters of laws whose derivative is zero in a whole region (local).

    Args:
        contacts: The pairs.
        statuses: ``status_of`` the pairs, in each step that the objective depends on.
        controls: The controls.
        by_step: Contributions of the steps to the derivatives by each control.
    """
    found = []
    for control, parts in zip(controls, by_step, strict=True):
        if not isinstance(control, LawParameter) or any(part.any() for part in parts):
            continue
        seen = {each[control.pair] for each in statuses}
        if seen and "other" not in seen:
            contact = contacts[control.pair]
            found.append(
                f"the derivative by {control.name} is zero: in all {len(statuses)} steps "
                f"{_reason(contact, seen)} (a flat region, which is not a minimum)"
            )
    return tuple(found)


def _reason(contact: Interface, seen: set[Status]) -> str:
    """Why an objective is flat, and what helps (local)."""
    names = f"'{contact.slave.name}' on '{contact.master.name}'"
    if "stick" not in seen:
        return f"no node of {names} is in contact; choose steps or other parameters with contact"
    return (
        f"all nodes of {names} in contact stick, so that the objective does not depend on the "
        "friction limit; start with less friction, bound it to values with slip, or load until "
        "nodes slide"
    )
