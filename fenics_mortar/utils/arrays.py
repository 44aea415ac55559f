# SPDX-License-Identifier: MIT
"""Types of arrays, and arrays that are values."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


class Value:
    """Base of frozen dataclasses whose arrays are read-only."""

    def __post_init__(self) -> None:
        """Replace writable arrays by read-only copies."""
        for name, array in vars(self).items():
            if isinstance(array, np.ndarray) and array.flags.writeable:
                array = array.copy()
                array.flags.writeable = False
                object.__setattr__(self, name, array)
