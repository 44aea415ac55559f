# SPDX-License-Identifier: MIT
"""Thresholds of model errors and of the model hierarchy, each with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModelOptions:
    """Thresholds that no user sets.

    Attributes:
        max_corrections: Largest number of steps of the richer model.
        linear: Fraction of the residual left by a step above which another one follows [1].
        settled: Change of an error by another step that is accepted in any case, relative to the
            solution [1].
        max_error: Relative error above which the result of a model is not used as initial guess
            [1].
        recheck: Growth of deviations or errors of a model since the last check from which they are
            checked again [1].
        points_on_facet: Gauss points on a facet of the slave, which may face several facets of an
            elastic obstacle with kinks.
        batch: Points whose nearest facets are searched at a time, which limits memory.
    """

    max_corrections: int = 6
    linear: float = 0.1
    settled: float = 1e-3
    max_error: float = 0.5
    recheck: float = 2.0
    points_on_facet: int = 12
    batch: int = 2000


MODELS = ModelOptions()
