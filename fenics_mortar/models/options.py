# SPDX-License-Identifier: MIT
"""Thresholds of model errors and of the model hierarchy, each with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModelOptions:
    """Thresholds that are no options of users.

    Attributes:
        max_corrections: Largest number of steps of the richer model.
        linear: Remaining fraction of the residual after a step [1] above which another step
            follows.
        settled: Expected change of an error by another step, relative to the solution [1], that is
            always accepted.
        max_error: Relative error [1] above which the result of a model is not used as initial
            guess.
        recheck: Growth of a model's deviations or errors since the last check above which they are
            checked again [1].
        points_on_facet: Gauss points on a facet of the slave, which may face several facets of an
            elastic obstacle with kinks.
        batch: Number of points whose nearest facets are searched at a time, to limit memory.
    """

    max_corrections: int = 6
    linear: float = 0.1
    settled: float = 1e-3
    max_error: float = 0.5
    recheck: float = 2.0
    points_on_facet: int = 12
    batch: int = 2000


MODELS = ModelOptions()
