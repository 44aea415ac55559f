# SPDX-License-Identifier: MIT
"""Types of arrays, and arrays that are values."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


def freeze(value: Any) -> None:
    """Replace arrays of a frozen dataclass that can be written to by copies that can not."""
    for name, array in vars(value).items():
        if isinstance(array, np.ndarray) and array.flags.writeable:
            array = array.copy()
            array.flags.writeable = False
            object.__setattr__(value, name, array)
