# SPDX-License-Identifier: MIT
"""Derivatives through cohesive zones and adhesion: one path each, and all objectives of a step."""

import pytest
from proof_matrix import between_blocks, row_of
from taylor_scenes import blocks, check

from fenics_mortar import sensitivity
from fenics_mortar.laws import Cohesive, MixedCohesive
from fenics_mortar.sensitivity import MeanGap, TotalForce, total

# Closed, opened, closed in part along the secant, opened further.
OPENED = [(0.0, -0.01), (0.0, 0.04), (0.01, 0.09), (0.015, 0.06), (0.02, 0.08), (0.02, 0.13)]


@pytest.mark.serial
@pytest.mark.parametrize(
    "law, sizes",
    [
        (Cohesive(2.0, 0.15), {"strength": 0.3, "reach": 0.02}),
        (MixedCohesive(100.0, 2.0, 0.25), {"stiffness": 10.0, "strength": 0.2, "reach": 0.02}),
    ],
    ids=["opening", "opening and slip"],
)
def test_damage_along_a_path(law, sizes):
    """The largest opening is part of the history; open nodes slip where the bond has shear."""
    scene = blocks(law, places=OPENED)
    scene.controls |= {name: sensitivity.LawParameter(0, name) for name in sizes}
    scene.controls["offset"] = sensitivity.Offset(0)
    names = ["E", "place", "offset", *sizes]
    changes = [30.0, 0.003, 0.003, *sizes.values()]
    check(scene, TotalForce(0, (1.0, 0.3)) + 0.1 * MeanGap(0), names, changes, over_steps=total,
          step=2e-4)  # fmt: skip
    assert scene.problem.equations.contacts[0].attracted.all()


@pytest.mark.parametrize("law", ["mixed", "adhesion"])
def test_all_objectives_by_all_controls(law):
    """A row of the proof matrix."""
    scene, sizes = between_blocks(law, "P1", "step")
    row = row_of(scene, sizes)
    assert law == "mixed" or scene.problem.equations.contacts[0].attracted.all()
    assert row.pairs >= 66 and row.rounding < 0.6 * row.pairs
    assert row.difference <= 1e-10 and row.slope > 1.9, row.weak
