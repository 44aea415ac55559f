# SPDX-License-Identifier: MIT
"""The forms of the linear system by the name of their algorithm."""

from __future__ import annotations

from typing import Literal

from fenics_mortar.la.condensed import CondensedSystem
from fenics_mortar.la.saddle import SaddleSystem
from fenics_mortar.la.system import LinearSystem

Algorithm = Literal["condensed", "saddle"]
SYSTEMS: dict[str, type[LinearSystem]] = {"condensed": CondensedSystem, "saddle": SaddleSystem}
