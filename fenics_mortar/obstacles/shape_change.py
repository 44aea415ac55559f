# SPDX-License-Identifier: MIT
"""Derivatives of signed distances by parameters of the shape, from difference quotients.

Central quotients with steps h and h / 2 are extrapolated, (4 d(h / 2) - d(h)) / 3: the error is of
the order of h^4 and of the rounding of distances over h.
"""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np

from fenics_mortar.utils.arrays import Array

# Step of central differences of distances, over the size of the parameter or the length of a facet
# [1]: on a spline of nine points the truncation error is 1e-11, the rounding over the step 1e-12.
DIFFERENCE = 2e-4


def differentiate_shape(
    obstacle: Any, x: Array, name: str, direction: Array
) -> tuple[Array, Array]:
    """Derivatives of phi (n,) and of its gradient (n, 2) along a direction (local).

    Args:
        obstacle: The obstacle; it is not changed.
        x: Points in its own frame, shape (n, 2) [length].
        name: Name of the parameter.
        direction: Shape of the parameter.
    """
    value, count = np.asarray(obstacle.shape()[name]), len(x)
    if not direction.any():
        return np.zeros(count), np.zeros((count, 2))
    size = np.ptp(value) if value.size > 1 else np.abs(value).max()
    h = DIFFERENCE * (size or 1.0) / np.abs(direction).max()

    def quotient(step: float) -> Array:
        fields = []
        for sign in (1.0, -1.0):
            other = copy(obstacle)
            other.set_shape(name, value + sign * step * direction)
            phi, gradient, _ = other.local(x)
            fields.append(np.column_stack([phi, gradient]))
        return (fields[0] - fields[1]) / (2.0 * step)

    change = (4.0 * quotient(0.5 * h) - quotient(h)) / 3.0
    return change[:, 0], change[:, 1:]
