# SPDX-License-Identifier: MIT
"""Common functions of the random problems of ``random_physics``: problems of grids, checks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import fenics_mortar as fm

# Largest relative difference of a solution from a closed form by Newton's tolerance [1].
SOLVED = 1e-7


def size(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two positive ones, uniform in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def differs(what: str, found: Any, expected: Any, allowed: float) -> Iterator[str]:
    """Messages on differences above a fraction of the largest expected number."""
    found, expected = np.broadcast_arrays(np.asarray(found), np.asarray(expected))
    error = np.abs(found - expected).max() / max(np.abs(expected).max(), np.finfo(float).tiny)
    if not error < allowed:
        worst = np.abs(found - expected).argmax()
        yield (
            f"{what} is {found.flat[worst]:.6g} instead of {expected.flat[worst]:.6g}: the error "
            f"of {error:.1e} exceeds {allowed:.1e}"
        )


def follow(problem: fm.ContactProblem, load: Any, steps: int) -> list[Any]:
    """Follow a path from 0 to 1 in at least ``steps`` steps; return the reports of its steps."""
    options = fm.SteppingOptions(step=1.0 / steps, smallest=1e-3 / steps)
    return [step.report for step in fm.follow_path(problem, load, options).steps]


def certified(problems: Sequence[fm.ContactProblem]) -> tuple[list[str], list[str]]:
    """Violations and remarks of certificates."""
    found = [problem.certificate() for problem in problems]
    return [w for c in found for w in c.violations()], [r for c in found for r in c.remarks()]
