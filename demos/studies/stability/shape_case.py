# SPDX-License-Identifier: MIT
"""A problem of thin or folded bodies, or of a pad, and its assembly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from demos.studies.stability.case import Case, Prescribed
from demos.studies.stability.random_bodies import Array
from demos.studies.stability.shapes import Shape
from demos.studies.stability.user_laws import Rule


@dataclass(frozen=True)
class ShapeCase(Case):
    """A problem of thin or folded bodies, or of a pad.

    Attributes:
        rules: Law of each pair.
        planes: Rigid planes by name, a point and a normal, among the masters.
        ends_free: Whether there is no contact at the end, and no strain.
        pressure: Pressure of the first pair at the end, if known [stress].
    """

    rules: list[Rule] = field(default_factory=list)
    planes: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    ends_free: bool = False
    pressure: float | None = None

    @property
    def stop(self) -> float:
        """Final time of the prescribed motion."""
        return float(max(len(prescribed.motion) for prescribed in self.prescribed) - 1)

    @property
    def smallest(self) -> float:
        """Smallest step: a thousandth of the motion."""
        return 1e-3

    @property
    def can_be_swapped(self) -> bool:
        """Planes cannot be slaves."""
        return not self.planes and super().can_be_swapped


def motion_along(points: Sequence[Any]) -> Array:
    """Positions at times 0, 1, 2 and so on, shape (times, 2); the first is the initial one."""
    return np.array([(0.0, 0.0), *points], float)


def grips(name: str, motion: Array) -> list[Prescribed]:
    """The fixed grip and the moved one of a body."""
    return [Prescribed(f"{name}/fixed", np.zeros((2, 2))), Prescribed(f"{name}/moved", motion)]


def shape_case(
    rng: np.random.Generator,
    seed: int,
    family: str,
    about: dict[str, Any],
    bodies: list[Shape],
    pairs: list[tuple[str, str]],
    prescribed: list[Prescribed],
    step: float = 0.0,
) -> ShapeCase:
    """Assemble a problem; some problems have friction."""
    mu = float(rng.choice([0.0, 0.0, rng.uniform(0.1, 0.5)]))
    step = step or float(rng.choice([0.1, 0.2, 0.25]))
    about = {"family": family, **about, "friction": mu, "step": step}
    rules = [Rule("Coulomb", mu)] * len(pairs)
    still = np.zeros((2, 2))
    return ShapeCase(seed, about, list(bodies), pairs, prescribed, "", still, step, rules=rules)
