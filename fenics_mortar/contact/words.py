# SPDX-License-Identifier: MIT
"""A contact in words: overlaps, and the distance within which partners are looked for."""

from __future__ import annotations

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.interface import Interface
from fenics_mortar.utils.errors import place

# Overlaps of active nodes are reported from so many facets on: Newton iterates have smaller ones.
MANY = 2.0
# An overlap before the first solve is reported above this fraction of a node's length.
OVERLAP = 1e-6


def describe_start(contact: Interface) -> str:
    """Overlap of the present state, or that no node has a partner; "" if there is neither."""
    if not isinstance(contact, Contact):
        return ""
    if not contact.covered.any():
        return (
            f"no node of '{contact.slave.name}' faced '{contact.master.name}' before the first "
            f"solve: nothing within {contact.options.radius:.3g} along its "
            "normals, so the pair bears no force until they come nearer"
        )
    overlap = -np.nan_to_num(contact.gap)
    j = int(np.argmax(overlap / contact.nodal_lengths))
    if overlap[j] <= OVERLAP * contact.nodal_lengths[j]:
        return ""
    return (
        f"'{contact.slave.name}' and '{contact.master.name}' overlap by up to {overlap[j]:.3g} at "
        f"{place(contact.operators.x[j])} before the first solve, which counts as interference; "
        "initial_gap=0 would take it for an error of the mesh"
    )


def describe_reach(contact: Contact) -> str:
    """The distance within which partners are looked for."""
    if contact.obstacle is not None:
        return f"up to {contact.options.radius:.3g}"
    return (
        f"up to {contact.options.radius:.3g}, behind the surface at most up to half of what both "
        "bodies are thick there"
    )


def describe_overlap(contact: Interface) -> str:
    """The active node with the largest overlap; "" if that is a few facets only."""
    if not isinstance(contact, Contact):
        return ""
    overlap = np.where(contact.active, -np.nan_to_num(contact.gap) / contact.nodal_lengths, 0.0)
    j = int(np.argmax(overlap))
    if overlap[j] <= MANY:
        return ""
    depth = overlap[j] * contact.nodal_lengths[j]
    return (
        f"the node at {place(contact.operators.x[j])} of '{contact.slave.name}' overlaps "
        f"'{contact.master.name}' by {overlap[j]:.1f} facets; partners are looked for "
        f"{describe_reach(contact)}: take smaller steps, or, if that is no contact, a "
        f"search_radius below {depth:.3g}"
    )
