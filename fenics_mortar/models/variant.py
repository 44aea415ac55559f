# SPDX-License-Identifier: MIT
"""Transfer of states between variants of a problem, see ``ContactProblem.variant``."""

from __future__ import annotations

from fenics_mortar.contact.contact import Contact
from fenics_mortar.problem import ContactProblem


def adopt(problem: ContactProblem, other: ContactProblem) -> None:
    """Set the state of ``problem`` to the present one of ``other``, its variant (collective)."""
    ours, theirs = problem.equations.contacts, other.equations.contacts
    for contact, of_other in zip(ours, theirs, strict=True):
        if isinstance(contact, Contact) and isinstance(of_other, Contact):
            contact.adopt(of_other)
    problem.restore(other.state())
