# SPDX-License-Identifier: MIT
"""Outlines of the bodies that limit the search of each pair (local)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.outline import Outline
from fenics_mortar.utils.arrays import Array


def set_outlines(contacts: Sequence[Contact | Tie], outline: Outline, labels: Array) -> None:
    """Pass the outlines of the bodies to each pair, ties first; tied bodies are treated as one.

    Args:
        contacts: The pairs.
        outline: The outlines of the bodies.
        labels: Body of each node of the outlines with tied bodies joined, shape (nodes, 1).
    """
    outline = replace(outline, bodies=labels[:, 0].astype(np.int64))
    for contact in sorted(contacts, key=lambda contact: isinstance(contact, Contact)):
        outline = contact.limit_sight(outline)
