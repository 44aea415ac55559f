# SPDX-License-Identifier: MIT
"""Derivatives through the memory of laws: wear, rates and states, over several steps."""

import pytest
from taylor_scenes import SLIDE, blocks, check, timed

from fenics_mortar import sensitivity
from fenics_mortar.laws import RateAndState, SoftLayer, Stribeck, Worn
from fenics_mortar.sensitivity import FrictionWork, PressureIntegral, TotalForce

OBJECTIVE = TotalForce(0, (1.0, 0.3)) + 0.1 * PressureIntegral(0, 2) + FrictionWork(0)


@pytest.mark.parametrize(
    "law, sizes",
    [
        (Worn(0.3, 0.05), {"mu": 0.1, "wear": 0.01}),
        (Worn(0.0, 0.05), {"wear": 0.01}),
        (
            RateAndState(0.4, 0.02, 0.01, 0.02, 0.05),
            {"mu": 0.1, "a": 0.005, "b": 0.005, "L": 0.01, "v_0": 0.01},
        ),
        (SoftLayer(2e3, 2.0, 0.3), {"mu": 0.1, "k": 100.0, "m": 0.1}),
        (
            Stribeck(0.4, 0.2, 0.05, 0.1),
            {"static": 0.1, "kinetic": 0.1, "rate": 0.01, "viscous": 0.05},
        ),
    ],
    ids=["wear", "wear without friction", "rate and state", "layer", "Stribeck"],
)
def test_laws_of_the_package(law, sizes):
    scene = timed(blocks(law, places=SLIDE))
    for name in sizes:
        scene.controls[name] = sensitivity.LawParameter(0, name)
    scene.controls["offset"] = sensitivity.Offset(0)
    names = ["E", "offset", *sizes]
    check(scene, OBJECTIVE, names, [30.0, 0.003, *sizes.values()], step=2e-4)
