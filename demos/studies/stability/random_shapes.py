# SPDX-License-Identifier: MIT
"""Random problems of bodies other than blocks, each from a seed.

- own: surfaces of one body in contact, such as the ends of a C-ring or the arms of a folded strip,
- thin: plates, arms, hooks and tubes, most with their whole outlines as surfaces,
- laws: a pad is pressed and slid, with users' laws,
- roles: one of the first two, or a pad with Coulomb's friction, always solved with both roles.

All are driven by prescribed motions of parts of boundaries, at times 0, 1, 2 and so on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from demos.studies.stability import shape_scenes as scenes
from demos.studies.stability.placement import draw_placement
from demos.studies.stability.shape_case import ShapeCase

FAMILIES = ("own", "thin", "laws", "roles")


def shape_case(family: str, seed: int) -> ShapeCase:
    """Draw a problem of a family."""
    rng = np.random.default_rng([seed, 71, FAMILIES.index(family)])
    draws: dict[str, list[Any]] = {
        "own": [scenes.ring, scenes.folds, scenes.folds, scenes.spiral],
        "thin": [scenes.plates, scenes.passing, scenes.catching, scenes.hook, scenes.tubes],
        "laws": [scenes.pad],
    }
    draws["roles"] = draws["own"] + draws["thin"] + 4 * [scenes.pad]
    draw = draws[family][rng.integers(len(draws[family]))]
    case = draw(rng, seed, family)
    if rng.random() < 0.5 and case.can_be_swapped:
        case = case.swapped()
    case.about["slave"] = case.pairs[0][0]
    return _placed(rng, case)


# Surfaces of one body


# Thin bodies


# Laws


# All


def _placed(rng: np.random.Generator, case: ShapeCase) -> ShapeCase:
    """Rotate, translate and scale a problem; guides need directions along the axes."""
    placement = draw_placement(
        rng, guided=any(prescribed.component is not None for prescribed in case.prescribed)
    )
    rotation, length, stress = placement.rotation, placement.length, placement.stress
    bodies = list(map(placement.body, case.bodies))
    prescribed = [
        replace(
            h,
            motion=length * h.motion @ rotation.T,
            component=None
            if h.component is None
            else int(np.abs(rotation[:, h.component]).argmax()),
        )
        for h in case.prescribed
    ]
    about = (
        case.about
        | placement.about(bodies)
        | {
            "dofs": 2 * len(case.x),
        }
    )
    return replace(
        case,
        bodies=bodies,
        prescribed=prescribed,
        planes={
            name: (placement.points(x), n @ rotation.T) for name, (x, n) in case.planes.items()
        },
        rules=[rule.scaled(length, stress) for rule in case.rules],
        pressure=None if case.pressure is None else stress * case.pressure,
        about=about,
    )
