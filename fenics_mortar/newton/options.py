# SPDX-License-Identifier: MIT
"""Tolerances and limits of Newton's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.utils.arguments import check_flag, check_number


@dataclass(frozen=True)
class NewtonOptions:
    """Tolerances and limits of Newton's method, relative and independent of units; local.

    Attributes:
        max_iterations: Largest number of linear systems.
        residual_tolerance: Residual over the largest force so far [1].
        increment_tolerance: Largest displacement increment over the largest displacement [1].
        line_search: Halve steps that raise the residual; see ``damping``.
        max_motion: Largest motion of a surface in one iteration over its shortest facet [1].
        tentative: Fail at once instead of trying fallbacks; the caller has another initial guess.
        max_remaining: Largest residual after the first iteration over the initial one [1]; the
            solve fails above it.

    Raises:
        ValueError: If an option has a value that is not allowed.
    """

    max_iterations: int = 30
    residual_tolerance: float = 1e-10
    increment_tolerance: float = 1e-6
    line_search: bool = False
    max_motion: float = np.inf
    tentative: bool = False
    max_remaining: float = np.inf

    def __post_init__(self) -> None:
        """Check the numbers."""
        expected = "a whole number, at least 1"
        check_number("max_iterations", self.max_iterations, expected, lambda n: n >= 1, whole=True)
        for what in ("residual_tolerance", "increment_tolerance"):
            value = getattr(self, what)
            check_number(what, value, "a positive number", lambda number: 0.0 < number < np.inf)
        expected = "a positive number"
        check_number("max_remaining", self.max_remaining, expected, lambda number: number > 0.0)
        expected = "a positive number of facets"
        check_number("max_motion", self.max_motion, expected, lambda number: number > 0.0)
        for what in ("line_search", "tentative"):
            check_flag(what, getattr(self, what))

    @property
    def damped(self) -> bool:
        """Whether steps are damped by ``line_search`` or ``max_motion``."""
        return self.line_search or bool(np.isfinite(self.max_motion))
