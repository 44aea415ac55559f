# SPDX-License-Identifier: MIT
"""What lies behind a slave surface: the outlines of the bodies of a pair, in their present place.

The back of a plate faces whatever lies below it, through the plate and through that body. Such a
partner is farther behind the slave surface than both bodies are thick; see ``kernels.sight`` for
the rule. The lengths are those in the present state: bodies bend and are compressed, and where an
end of a beam looks along its axis the length of the undeformed mesh says nothing.

To a safe depth nobody asks. So this costs an iteration the positions of the outlines, from which
those of the two surfaces are taken, and else only where a partner is farther behind than that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_mortar.interface.outline import Outline
from fenics_mortar.interface.surfaces import Surface
from fenics_mortar.kernels.sight import tabulate_lengths
from fenics_mortar.utils.arrays import Array, Indices

# Partners count without question to this part of the length of the undeformed body behind a facet,
# and to the length of the facet at the most: no body is compressed to less, nor does one bend away
# in less.
SAFE = 0.25
# Ends of a body within this part of a facet from where a line begins are those of that facet.
ROUNDING = 1e-10


class View(NamedTuple):
    """What lies behind the facets of a slave surface, as the kernels take it.

    Attributes:
        safe: Depth behind each slave facet to which any partner counts, shape (f,) [length].
        slave_bodies: Bodies of the slave facets, shape (f,).
        master_bodies: Bodies of the master facets, shape (m,).
        outline: Present positions of nodes (b, 2) [length], pieces (p, 2) with the body on their
            left, and bodies of these, shape (p,).
    """

    safe: Array
    slave_bodies: Indices
    master_bodies: Indices
    outline: tuple[Array, Indices, Indices]

    def of(self, facets: Indices) -> View:
        """The view of some of the slave facets, shape (k,)."""
        return self._replace(safe=self.safe[facets], slave_bodies=self.slave_bodies[facets])


def open_view(num_facets: int) -> View:
    """A view through everything."""
    none: Indices = np.empty(0, np.int64)
    outline = np.empty((0, 2)), np.empty((0, 2), np.int64), none
    return View(np.full(num_facets, np.inf), none, none, outline)


class Sight:
    """Outlines of the bodies of a slave and a master surface, and the nodes of these on them.

    Args:
        outline: Outlines of all bodies in pairs; those tied to each other have one number.
        slave, master: The surfaces.
        normals: Normals of the slave nodes in the undeformed mesh, shape (slave nodes, 2).

    Attributes:
        outline: Outlines of the bodies of the two.
    """

    def __init__(self, outline: Outline, slave: Surface, master: Surface, normals: Array) -> None:
        bodies = [outline.bodies_of(side) for side in (slave, master)]
        self.outline = outline = outline.of_bodies(np.unique(np.concatenate(bodies)))
        self._slave_bodies, self._master_bodies = bodies
        self._of_slave, self._of_master = map(outline.places_of, (slave.nodes, master.nodes))
        self._segment_bodies = outline.segment_bodies
        lengths = np.empty(len(slave.facets))
        tabulate_lengths(
            slave.X, normals, slave.facets, bodies[0], self._pieces(outline.X), ROUNDING, lengths
        )
        self._safe = np.minimum(SAFE * lengths, slave.lengths)

    def _pieces(self, x: Array) -> tuple[Array, Indices, Indices]:
        return x, self.outline.segments, self._segment_bodies

    def look(self, u: Array | None) -> tuple[View, Array, Array]:
        """The view at the displacement ``u``, a local array, or undeformed (collective).

        Returns:
            The view, and the displacements of the nodes of slave and master, each (nodes, 2).
        """
        X = self.outline.X
        moved = np.zeros_like(X) if u is None else self.outline.gather(u)
        view = View(self._safe, self._slave_bodies, self._master_bodies, self._pieces(X + moved))
        return view, moved[self._of_slave], moved[self._of_master]
