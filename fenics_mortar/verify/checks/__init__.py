# SPDX-License-Identifier: MIT
"""Checks of the certificate: a new check is a new module here, and nothing else.

A module has ``of_contact(measured)``, for pairs in contact, or ``of_tie(tie)``, for tied pairs, or
both: collective functions that yield a ``Finding`` for each quantity that they measure. It holds
measurement, limits, what is printed and the advice. Quantities of one subject are in one module.
``IN_PLANE_ONLY = True`` marks a module whose checks follow curves, ``IN_SPACE_ONLY = True`` the
counterpart of such a one for faces.
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
def checks(kind: Kind, dim: int) -> tuple[Check, ...]:
    """The functions of this name in all modules of this folder, in the order of modules (local).

    In space, dim = 3, without the modules with ``IN_PLANE_ONLY``, in the plane without those with
    ``IN_SPACE_ONLY``.
    """
    names = sorted(module.name for module in iter_modules(__path__))
    modules = [import_module(f"{__name__}.{name}") for name in names]
    left_out = "IN_PLANE_ONLY" if dim == 3 else "IN_SPACE_ONLY"
    modules = [m for m in modules if not getattr(m, left_out, False)]
    return tuple(getattr(module, kind) for module in modules if hasattr(module, kind))
