# SPDX-License-Identifier: MIT
"""The report of a model check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.models.model_error import QUANTITIES, Errors
from fenics_mortar.utils.files import Markdown


@dataclass(frozen=True)
class Assumption:
    """An assumption of a model and its estimated error.

    Attributes:
        name: The assumption.
        indicator: Deviation of the state from the assumption, as text.
        errors: Estimated relative error by quantity [1]; nan if unknown.
        mesh: Error of the mesh of the richer model, if known.
    """

    name: str
    indicator: str
    errors: Errors
    mesh: Assumption | None = None


@dataclass(frozen=True)
class ModelReport(Markdown):
    """Estimated errors of the assumptions of a solution; prints as a Markdown table; local.

    Attributes:
        assumptions: Each assumption; if there are several, the last one is their combination.
        tolerance: Allowed relative error of the quantity [1].
        quantity: "energy norm", "total force" or "peak pressure".
        discretisation: Relative error of the mesh [1], if known.
    """

    assumptions: list[Assumption]
    tolerance: float
    quantity: str
    discretisation: float | None = None

    @property
    def error(self) -> float:
        """Estimated relative error of the quantity due to all assumptions [1]."""
        return max((a.errors[self.quantity] for a in self.assumptions), default=0.0)

    @property
    def suffices(self) -> bool:
        """Whether the estimated error is within the tolerance; false if it is unknown."""
        return bool(self.error <= self.tolerance)

    def verdict(self, assumption: Assumption) -> str:
        """Verdict on one assumption, as text (local)."""
        error = assumption.errors[self.quantity]
        if np.isnan(error):
            return "unknown"
        if error <= self.tolerance:
            return "enough"
        of_meshes = [self.discretisation or 0.0]
        of_meshes += [assumption.mesh.errors[self.quantity]] if assumption.mesh else []
        return "refine the mesh first" if error <= max(of_meshes) else "not enough"

    def __str__(self) -> str:
        """Markdown table: one row per assumption, and the error of the mesh."""
        lines = ["| assumption | indicator | " + " | ".join(QUANTITIES) + " | verdict |"]
        lines.append("|---|---|" + "---:|" * len(QUANTITIES) + "---|")
        for a in self.assumptions:
            lines.append(_row(a, self.verdict(a)))
            lines += [_row(a.mesh, "")] if a.mesh else []
        if self.discretisation is not None:
            empty = " | " * (len(QUANTITIES) - 1)
            lines.append(f"| mesh | | {100 * self.discretisation:.2g} % {empty} | |")
        lines.append(
            f"\nestimated errors; the tolerance is {100 * self.tolerance:g} % in {self.quantity}"
        )
        return "\n".join(lines)


def _row(assumption: Assumption, verdict: str) -> str:
    """One row of the table."""
    cells = [f"{100 * assumption.errors[name]:.2g} %" for name in QUANTITIES]
    return f"| {' | '.join([assumption.name, assumption.indicator, *cells, verdict])} |"
