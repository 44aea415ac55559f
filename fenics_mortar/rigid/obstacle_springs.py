# SPDX-License-Identifier: MIT
"""Springs that tie driven obstacles to where they are, as they do bodies: see ``release``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_mortar.rigid.floating import LEAST_SPRING
from fenics_mortar.rigid.motions import ObstacleMotions
from fenics_mortar.utils.arrays import Array

# Error of the forces on an obstacle, whose normals are exact, by the facets of the slave: over the
# contact force [1].
FACETS_ERR = 0.005


@dataclass(frozen=True)
class ObstacleSprings:
    """Springs on the motions of obstacles.

    Attributes:
        stiffness: Zero on prescribed motions, shape (obstacles, 3) [stress].
        anchor: Motions at which they are relaxed, shape (obstacles, 3) [length].
    """

    stiffness: Array
    anchor: Array

    def forces(self, at: Array) -> Array:
        """Forces of the springs at the motions ``at``, shape (obstacles, 3) [stress length]."""
        return self.stiffness * (at - self.anchor)

    def energy(self, at: Array) -> float:
        """Energy in the springs at the motions ``at`` [stress length^2]."""
        return 0.5 * float((self.forces(at) * (at - self.anchor)).sum())


def tie(
    motions: ObstacleMotions, residual: Array, travel: float, stiffness: float
) -> ObstacleSprings:
    """Springs that tie driven motions to where they are (local).

    Args:
        motions: The obstacles.
        residual: Of their balance, shape (obstacles, 3) [stress length].
        travel: Strain of an obstacle's springs under the forces that drive it, or under what facets
            may err of all contact forces on it, in shortest facets.
        stiffness: Of the bulk [stress].
    """
    drive = np.linalg.norm(residual, axis=1)
    drive = np.maximum(drive, FACETS_ERR * motions.contact_forces())
    springs = np.maximum(drive / (travel * motions.shortest_facet()), LEAST_SPRING * stiffness)
    return ObstacleSprings(
        np.where(motions.driven, springs[:, None], 0.0), motions.motions_of(motions.places)
    )


def held_parts(motions: ObstacleMotions, springs: ObstacleSprings) -> list[tuple[str, float]]:
    """Name of each driven obstacle, and the force of its springs over its contact force."""
    forces = np.linalg.norm(springs.forces(motions.motions_of(motions.places)), axis=1)
    parts = forces / np.maximum(motions.contact_forces(), 1e-300)
    return [
        (f"obstacle '{motions.obstacles[i].name}'", float(parts[i]))
        for i in np.flatnonzero(motions.driven.any(axis=1))
    ]
