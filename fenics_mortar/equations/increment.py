# SPDX-License-Identifier: MIT
"""Solution of the linearized equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_mortar.utils.arrays import Array

# Motions of nothing that moves.
NO_MOTION: Array = np.zeros((0, 3))


class Increment(NamedTuple):
    """Solution of the linearized equations.

    Attributes:
        u: Increment of the displacement and other unknowns of the bulk, owned dofs [length].
        z: The new multipliers of each pair, shape (slave nodes, 2) [stress].
        motion: Increments of the motions of m obstacles and remote loads, shape (m, 3) [length];
            ``NO_MOTION`` if none moves.
        remark: Remarks on the solution; "" if there are none.
    """

    u: Array
    z: list[Array]
    motion: Array
    remark: str
