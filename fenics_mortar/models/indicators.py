# SPDX-License-Identifier: MIT
"""Descriptions of a state's deviations from the assumptions of its model; errors of obstacles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.models.elastic_obstacle import ElasticObstacle
from fenics_mortar.models.model_error import (
    estimate_wider,
    largest_slip,
    largest_strain,
    sliding_little,
)
from fenics_mortar.models.report import Assumption
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array


def rigid_obstacle(problem: ContactProblem, elastic: ElasticObstacle) -> Assumption:
    """Errors of a rigid obstacle: its elasticity, and the facets of its mesh (collective)."""
    touching = contacts_of(problem, elastic)
    yielding, flatness = elastic.displacements(touching), elastic.flatness(touching)
    by_mesh = Assumption(
        f"mesh of {elastic.obstacle}",
        f"facets deviate by {largest(flatness):.2g}",
        estimate_wider(problem, touching, flatness),
    )
    return Assumption(
        f"rigid {elastic.obstacle}",
        f"displacement of its surface {largest(yielding):.2g}",
        estimate_wider(problem, touching, yielding),
        by_mesh,
    )


def contacts_of(problem: ContactProblem, elastic: ElasticObstacle) -> list[Contact]:
    """The contacts with the obstacle of an elastic obstacle (local)."""
    contacts = [contact for contact in problem.equations.contacts if isinstance(contact, Contact)]
    return [contact for contact in contacts if contact.obstacle is elastic.obstacle]


def largest(lengths: Sequence[Array]) -> float:
    """Largest absolute value of ``lengths``, arrays of any shape [length] (local)."""
    return max((float(np.abs(length).max(initial=0.0)) for length in lengths), default=0.0)


def describe_strain(problem: ContactProblem) -> str:
    """Describe the largest rotation and strain of all cells (collective)."""
    rotation, strain = largest_strain(problem)
    return f"rotation {np.degrees(rotation):.2g}°, strain {100 * strain:.2g} %"


def describe_sliding(problem: ContactProblem) -> str:
    """Describe the largest slip and rotation of normals of pairs with small sliding (local)."""
    slip, angle = np.max([largest_slip(contact) for contact in sliding_little(problem)], axis=0)
    return f"slip {slip:.2g} facets, normals rotate by {np.degrees(angle):.2g}°"
