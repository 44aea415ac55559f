# SPDX-License-Identifier: MIT
"""The linearized equations of a recorded step."""

from __future__ import annotations

from fenics_mortar.equations.linearized import LinearizedEquations
from fenics_mortar.equations.present import linearized
from fenics_mortar.problem import ContactProblem


def linearize(problem: ContactProblem) -> LinearizedEquations:
    """A = dR/ds at the present, evaluated state; factorized once (collective)."""
    e = problem.equations
    e.bulk.free_garbage()
    return linearized(e)
