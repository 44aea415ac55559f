# SPDX-License-Identifier: MIT
"""Checks of the certificate: a new check is a new module here, and nothing else.

A module has ``of_contact(measured)``, for pairs in contact, or ``of_tie(tie)``, for tied pairs, or
both: collective functions that yield a ``Finding`` for each quantity that they measure. It holds
measurement, limits, what is printed and the advice. Quantities of one subject are in one module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Literal

from fenics_mortar.verify.finding import Finding

Check = Callable[[Any], Iterable[Finding]]
Kind = Literal["of_contact", "of_tie"]


@cache
def checks(kind: Kind) -> tuple[Check, ...]:
    """The functions of this name in all modules of this folder, in the order of modules (local)."""
    names = sorted(module.name for module in iter_modules(__path__))
    modules = [import_module(f"{__name__}.{name}") for name in names]
    return tuple(getattr(module, kind) for module in modules if hasattr(module, kind))
