# SPDX-License-Identifier: MIT
"""Checks of what users set: an error names the option, shows its value and says what is right."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt


def check_choice(name: str, value: Any, allowed: Iterable[str]) -> None:
    """Refuse all but the words that are allowed (local).

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name}={value!r}: allowed are {', '.join(allowed)}")


def check_number(
    name: str, value: Any, right: str, allows: Callable[[Any], bool], *, whole: bool = False
) -> None:
    """Refuse what is no real number, or no whole one, or one that is not allowed (local).

    Args:
        name: Name of the option.
        value: What it was set to.
        right: What would be right, in words.
        allows: Whether a number is allowed; of nan it has to be false.
        whole: Whether it has to be whole.

    Raises:
        ValueError: For another value.
    """
    kind = np.asarray(value, object if np.ndim(value) else None).dtype.kind
    if kind not in ("iu" if whole else "iuf") or not allows(value):
        raise ValueError(f"{name}={value!r}: {right}")


def check_lengths(name: str, values: Any, count: int) -> npt.NDArray[np.float64]:
    """Refuse all but finite numbers of shape (count,); return them, not copied (local).

    Raises:
        ValueError: For other values.
    """
    right = f"finite lengths of shape ({count},), one a slave node, are allowed"
    lengths = np.asarray(values)
    if lengths.shape != (count,) or lengths.dtype.kind not in "iuf":
        raise ValueError(f"{name} has shape {lengths.shape}, type {lengths.dtype}: {right}")
    bad = np.flatnonzero(~np.isfinite(lengths))
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}]={lengths[bad[0]]}: {right}")
    return lengths.astype(float, copy=False)


def check_flag(name: str, value: Any) -> None:
    """Refuse all but ``True`` and ``False`` (local).

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}={value!r}: True or False")


def check_kind(name: str, value: Any, kind: type | tuple[type, ...], right: str) -> None:
    """Refuse objects of another kind (local).

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, kind):
        raise ValueError(f"{name}={value!r}: {right}")
