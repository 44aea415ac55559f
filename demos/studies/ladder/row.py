# SPDX-License-Identifier: MIT
"""Result of one rung of the ladder at one load of a scene."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from demos.studies.ladder.scenes import TOLERANCE
from fenics_mortar.models.model_error import ENERGY, QUANTITIES

Errors = dict[str, float]
# Below this fraction true errors are those of Newton's tolerance.
SEEN = 1e-7
NOTHING = dict.fromkeys(QUANTITIES, np.nan)


@dataclass
class Row:
    """One rung at one load of a scene.

    Attributes:
        scene, load, rung: Which.
        dofs: Unknowns of the bodies.
        setup, seconds, check: Seconds to set the problem up, to solve it, to estimate its error;
            climbs and what friction could do are checked in each step, as a part of its solution.
        against: Seconds to solve the full model.
        iterations: Of all steps; of a climb those on the rungs where steps ended.
        true, estimate: Errors by quantity.
        mesh: Those that the mesh leaves.
        ended: On which rung a climb ended.
        reason: Why there is no solution.
    """

    scene: str
    load: float
    rung: str
    dofs: int
    setup: float = np.nan
    seconds: float = np.nan
    check: float = np.nan
    against: float = np.nan
    iterations: int = 0
    true: Errors = field(default_factory=NOTHING.copy)
    estimate: Errors = field(default_factory=NOTHING.copy)
    mesh: Errors = field(default_factory=NOTHING.copy)
    ended: str = ""
    reason: str = ""

    def factor(self, name: str) -> float:
        """Factor between estimate and truth; nan if there is no error, or no estimate."""
        true, estimate = self.true[name], self.estimate[name]
        if not true > SEEN or np.isnan(estimate):
            return np.nan
        return max(true / estimate, estimate / true) if estimate > 0.0 else np.inf

    def is_hidden(self, name: str) -> bool:
        """Whether truth and estimate differ by less than the error of the mesh."""
        return abs(self.true[name] - self.estimate[name]) <= self.mesh[name]

    @property
    def has_estimate(self) -> bool:
        """Whether its errors were estimated."""
        return not np.isnan(self.estimate[ENERGY])

    @property
    def verdict(self) -> tuple[bool, bool]:
        """Whether the estimate says that the rung is enough, and whether it is."""
        return self.estimate[ENERGY] <= TOLERANCE, self.true[ENERGY] <= TOLERANCE

    @property
    def name(self) -> str:
        """The rung, and where a climb ended."""
        return f"{self.rung}, ended on {self.ended}" if self.ended else self.rung
