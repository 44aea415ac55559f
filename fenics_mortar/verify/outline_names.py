# SPDX-License-Identifier: MIT
"""Names of the surfaces and bodies along the outlines, for messages on crossings."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.contact.tied import Tie
from fenics_mortar.interface.outline import Outline


class OutlineNames:
    """Names of the segments, bodies and nodes of the outlines.

    Args:
        outline: The outlines of the bodies.
        contacts: All pairs, whose surfaces have names.
        name_of_body: Function that returns the name of a body by its number (collective).
    """

    def __init__(
        self,
        outline: Outline,
        contacts: Sequence[Contact | Tie],
        name_of_body: Callable[[int], str],
    ) -> None:
        self._outline, self._name_of_body = outline, name_of_body
        self._bodies: dict[int, str] = {}
        self._surfaces: list[str] = []
        self._surface_of = np.full(len(outline.segments), -1)
        for contact in contacts:
            for surface in (contact.slave, contact.master):
                if surface.num_nodes and f"'{surface.name}'" not in self._surfaces:
                    self._surface_of[outline.are_of(surface)] = len(self._surfaces)
                    self._surfaces.append(f"'{surface.name}'")

    def segment(self, segment: int) -> str:
        """Name of the surface of a segment, or else of its body (collective)."""
        if self._surface_of[segment] >= 0:
            return self._surfaces[self._surface_of[segment]]
        return self.body(int(self._outline.segment_bodies[segment]))

    def body(self, body: int) -> str:
        """Name of a body (collective)."""
        if body not in self._bodies:
            self._bodies[body] = self._name_of_body(body)
        return self._bodies[body]

    def node(self, node: int) -> str:
        """Name of a surface of a node, or else of its body (collective)."""
        at = (self._outline.segments == node).any(axis=1)
        surface = self._surface_of[at].max(initial=-1)
        return self._surfaces[surface] if surface >= 0 else self.segment(int(np.argmax(at)))
