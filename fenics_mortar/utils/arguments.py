# SPDX-License-Identifier: MIT
"""Checks of user options: an error names the option, its value and the expected one."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt


def check_choice(name: str, value: Any, allowed: Iterable[str]) -> None:
    """Reject all but the allowed values (local).

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name}={value!r}: expected one of {', '.join(allowed)}")


def check_number(
    name: str, value: Any, expected: str, allows: Callable[[Any], bool], *, whole: bool = False
) -> None:
    """Reject values that are not real numbers, not integers or not allowed (local).

    Args:
        name: Name of the option.
        value: Its value.
        expected: Description of an allowed value.
        allows: Whether a number is allowed, as a function; must return false for nan.
        whole: Whether it has to be an integer.

    Raises:
        ValueError: For another value.
    """
    kind = np.asarray(value, object if np.ndim(value) else None).dtype.kind
    if kind not in ("iu" if whole else "iuf") or not allows(value):
        raise ValueError(f"{name}={value!r}: expected {expected}")


def check_lengths(name: str, values: Any, count: int) -> npt.NDArray[np.float64]:
    """Reject all but finite lengths; return them, shape (count,) [length], not copied (local).

    One number is the length at all nodes.

    Raises:
        ValueError: For other values.
    """
    expected = f"expected finite lengths of shape ({count},), one per slave node, or one for all"
    lengths = np.asarray(values)
    if lengths.ndim == 0:
        lengths = np.full(count, lengths)
    if lengths.shape != (count,) or lengths.dtype.kind not in "iuf":
        raise ValueError(f"{name} has shape {lengths.shape}, type {lengths.dtype}: {expected}")
    bad = np.flatnonzero(~np.isfinite(lengths))
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}]={lengths[bad[0]]}: {expected}")
    return lengths.astype(float, copy=False)


def check_flag(name: str, value: Any) -> None:
    """Reject all but ``True`` and ``False`` (local).

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}={value!r}: expected True or False")


def check_kind(name: str, value: Any, kind: type | tuple[type, ...], expected: str) -> None:
    """Reject objects of another type (local).

    Args:
        name: Name of the option.
        value: Its value.
        kind: Allowed types.
        expected: Description of an allowed value.

    Raises:
        ValueError: For another value.
    """
    if not isinstance(value, kind):
        raise ValueError(f"{name}={value!r}: expected {expected}")


def parameters_of(given: Any) -> list[str]:
    """Names of the arguments of an object's constructor (local)."""
    found = inspect.signature(type(given)).parameters.values()
    return [p.name for p in found if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]


def check_no_effect(owner: str, given: Any, names: Iterable[str], cure: str) -> None:
    """Reject attributes that were set although nothing reads them (local).

    Args:
        owner: Description of the object.
        given: The object.
        names: Names that it does not have itself.
        cure: What to do instead.

    Raises:
        ValueError: If the object has one of them.
    """
    found = sorted(vars(given).keys() & set(names))
    if found:
        raise ValueError(f"{found[0]} of {owner} was set, which has no effect: {cure}")
