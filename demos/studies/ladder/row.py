# SPDX-License-Identifier: MIT
"""Result of one model at one load of a problem."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from demos.studies.ladder.scenes import TOLERANCE
from fenics_mortar.models.model_error import ENERGY, QUANTITIES

Errors = dict[str, float]
# Fraction below which true errors are those of Newton's tolerance [1].
SEEN = 1e-7
NOTHING = dict.fromkeys(QUANTITIES, np.nan)


@dataclass
class Row:
    """One model at one load of a problem.

    Attributes:
        scene, load, model: Names of problem and model, and the load.
        dofs: Unknowns of the bodies.
        setup, seconds, check: CPU seconds of set-up, solution and error estimate; for possible
            friction the check in each step is part of the solution.
        against: Seconds to solve the full model.
        iterations: Those of all steps.
        true, estimate: Errors by quantity.
        mesh: Errors of the mesh.
        reason: Reason if there is no solution.
    """

    scene: str
    load: float
    model: str
    dofs: int
    setup: float = np.nan
    seconds: float = np.nan
    check: float = np.nan
    against: float = np.nan
    iterations: int = 0
    true: Errors = field(default_factory=NOTHING.copy)
    estimate: Errors = field(default_factory=NOTHING.copy)
    mesh: Errors = field(default_factory=NOTHING.copy)
    reason: str = ""

    def factor(self, name: str) -> float:
        """Ratio of estimated and true error; nan if there is no error, or no estimate."""
        true, estimate = self.true[name], self.estimate[name]
        if not true > SEEN or np.isnan(estimate):
            return np.nan
        return max(true / estimate, estimate / true) if estimate > 0.0 else np.inf

    def is_hidden(self, name: str) -> bool:
        """Whether true and estimated error differ by less than the error of the mesh."""
        return abs(self.true[name] - self.estimate[name]) <= self.mesh[name]

    @property
    def has_estimate(self) -> bool:
        """Whether its errors were estimated."""
        return not np.isnan(self.estimate[ENERGY])

    @property
    def verdict(self) -> tuple[bool, bool]:
        """Whether the model suffices by the estimate, and by the true error."""
        return self.estimate[ENERGY] <= TOLERANCE, self.true[ENERGY] <= TOLERANCE
