# SPDX-License-Identifier: MIT
"""Options of adaptive load steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.equations.options import EQUATIONS
from fenics_mortar.utils.arguments import check_flag, check_number


@dataclass(frozen=True)
class SteppingOptions:
    """Options of adaptive load steps; times are in units of the path parameter.

    Attributes:
        step: Size of the first step [time]; ``largest`` if this is smaller.
        smallest: Smallest step size [time]: failure of such a step ends the path.
        largest: Largest step size [time]; ``step`` if ``None``.
        easy: Number of Newton iterations up to which the next step grows.
        growth: Factor by which the next step grows [1].
        cut: Factor by which a failed step is reduced [1].
        predict: Whether initial guesses are extrapolated, see ``predictor``.

    Raises:
        ValueError: If a value is not allowed.
    """

    step: float
    smallest: float = 1e-6
    largest: float | None = None
    easy: int = 6
    growth: float = EQUATIONS.longest
    cut: float = 0.5
    predict: bool = True

    def __post_init__(self) -> None:
        """Reject values that are not allowed (local)."""
        expected = "0 < smallest <= step and largest, growth at least 1, cut between 0 and 1"
        largest = self.step if self.largest is None else self.largest
        for name, value, allows in (
            ("step", self.step, lambda step: 0.0 < step < np.inf),
            ("smallest", self.smallest, lambda smallest: 0.0 < smallest <= self.step),
            ("largest", largest, lambda largest: largest >= self.smallest),
            ("growth", self.growth, lambda growth: growth >= 1.0),
            ("cut", self.cut, lambda cut: 0.0 < cut < 1.0),
        ):
            check_number(name, value, expected, allows)
        check_number("easy", self.easy, "a number of iterations", lambda easy: easy >= 0)
        check_flag("predict", self.predict)
        object.__setattr__(self, "step", min(self.step, largest))
