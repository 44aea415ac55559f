# SPDX-License-Identifier: MIT
"""Placement of a random problem: rotation, translation, units of length and stress."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from demos.studies.stability.random_bodies import Array, Body


@dataclass(frozen=True)
class Placement:
    """A rotation by ``angle`` [radian], a translation, and units of length and stress.

    Attributes:
        rotation: The rotation, shape (2, 2).
        offset: The shift, before lengths are scaled, shape (2,).
    """

    angle: float
    rotation: Array
    offset: Array
    length: float
    stress: float

    def points(self, x: Array) -> Array:
        """Points (n, 2) after the placement."""
        return self.length * (x @ self.rotation.T + self.offset)

    def body(self, body: Body) -> Body:
        """A body after the placement."""
        return replace(
            body,
            x=self.points(body.x),
            E=self.stress * body.E,
            thickness=self.length * body.thickness,
        )

    def about(self, bodies: Sequence[Body]) -> dict[str, Any]:
        """Entries of the description of a problem."""
        return {
            "angle": float(self.angle),
            "length": float(self.length),
            "stress": float(self.stress),
            "cells": "triangles" if bodies[0].cells.shape[1] == 3 else "quads",
        }


def draw_placement(rng: np.random.Generator, *, guided: bool) -> Placement:
    """Draw a placement; guides need directions along the axes."""
    angle = rng.integers(4) * np.pi / 2 if guided else rng.uniform(-np.pi, np.pi)
    if rng.random() < 0.3:
        angle = 0.0
    length, stress = 10.0 ** rng.uniform(-4.0, 4.0, 2)
    offset = rng.uniform(-3.0, 3.0, 2)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return Placement(angle, np.round(rotation) if guided else rotation, offset, length, stress)
