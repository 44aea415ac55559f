# SPDX-License-Identifier: MIT
"""Derivatives of quantities of contact by controls of contact, through whole paths."""

import numpy as np
import pytest
from friction_scenes import block_on
from taylor_scenes import SLIDE, Path, blocks, check
from test_adhesion import columns
from test_contact_controls import Fading, Regular, Soft
from test_quantities import QUANTITIES

import fenics_mortar as fm
from fenics_mortar.sensitivity.controls import (
    Interference,
    LawParameter,
    ObstaclePlace,
    ObstacleShape,
    Offset,
)
from fenics_mortar.sensitivity.objective import last, total
from fenics_mortar.sensitivity.protocols import FrictionWork, MeanGap, PressureIntegral, TotalForce

# Step of Taylor tests [1]; sets change nearby.
STEP = 2e-4


def between_blocks(law, parameter, **options):
    """Blocks that slide over facets; a parameter of their law, offsets and modulus as controls."""
    scene = blocks(law, places=SLIDE, **options)
    scene.controls.update(offset=Offset(0), fit=Interference(0))
    if parameter:
        scene.controls["law"] = LawParameter(0, parameter)
    return scene


@pytest.mark.once
@pytest.mark.parametrize("name", [name for name in QUANTITIES if name != "gap"])
def test_quantities_by_friction_and_offset(name):
    scene = between_blocks(fm.Coulomb(0.3), "mu")
    over_steps = total if name == "work" else last
    sizes = [0.1, 0.01, 10.0]
    check(scene, QUANTITIES[name], ["law", "offset", "E"], sizes, over_steps=over_steps, step=STEP)


@pytest.mark.once
@pytest.mark.parametrize(
    "law, parameter",
    [
        (fm.Frictionless(), ""),
        (fm.Tresca(1.0), "stress"),
        (fm.Coulomb(0.1), "mu"),
        (fm.Coulomb(2.0), ""),  # where all nodes stick, the coefficient has no effect
        (fm.Coulomb(0.5, max_shear=2.0), "max_shear"),
        (Regular(), "weights"),
        (Soft(0.3), "mu"),
    ],
    ids=["none", "Tresca", "slip", "stick", "limited", "user's", "layer"],
)
@pytest.mark.parametrize("degree", [1, 2])
def test_laws(law, parameter, degree):
    scene = between_blocks(law, parameter, degree=degree)
    names, sizes = ["fit", "E"], [0.01, 10.0]
    if parameter:
        names, sizes = [*names, "law"], [*sizes, 0.1]
    check(scene, QUANTITIES["function"], names, sizes, step=STEP)


def test_law_that_changes_between_the_steps():
    """Each step is linearized with the law of its own solve."""
    law = fm.Coulomb(0.3)
    scene = blocks(law, places=SLIDE[:3:2])
    move = scene.move

    def move_and_wear(place):
        law.mu = 0.1 + 0.1 * abs(place[0])
        move(place)

    scene.move = move_and_wear
    check(scene, TotalForce(0, (1.0, 0.3)), ["E"], [10.0], over_steps=total, step=STEP)


@pytest.mark.once
@pytest.mark.parametrize("slip", ["partners", "operators"])
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_measures_of_slip_and_algorithms(algorithm, slip):
    scene = between_blocks(fm.Coulomb(0.3), "mu", pair={"slip": slip}, algorithm=algorithm)
    check(scene, TotalForce(0, (1.0, 0.3)), ["law", "fit", "E"], [0.1, 0.01, 10.0], step=STEP)


def on_obstacle(obstacle, law, shape, *, degree=1):
    """A block on an obstacle that moves and turns."""
    problem, _ = block_on(obstacle, degree=degree, law=law, angle=0.02)
    controls = {"place": ObstaclePlace(obstacle), "shape": ObstacleShape(obstacle, shape)}
    if law.has_friction:
        controls["law"] = LawParameter(0, law.parameters[0])

    def move(place):
        obstacle.move(x=place[0], y=place[1], angle=place[2])

    places = [(0.0, 0.0, 0.0), (0.01, 0.0, 0.005), (0.03, 0.0, 0.01)]
    return Path(problem, problem.equations.bulk.u, controls, move, places)


@pytest.mark.parametrize(
    "law", [fm.Frictionless(), fm.Tresca(1.0), fm.Coulomb(0.3), fm.Coulomb(3.0)], ids=str
)
@pytest.mark.parametrize("degree", [1, 2])
def test_place_and_radius_of_an_obstacle(degree, law):
    scene = on_obstacle(fm.Circle((0.4, -1.5), 1.515), law, "radius", degree=degree)
    names, sizes = ["place", "shape"], [0.01, 0.01]
    if law.has_friction and getattr(law, "mu", 0.0) < 1.0:  # else all nodes stick
        names, sizes = [*names, "law"], [*sizes, 0.1]
    objective = TotalForce(0, (1.0, 1.0)) + PressureIntegral(0, 2) * 0.1 + FrictionWork(0)
    check(scene, objective, names, sizes, step=STEP)


@pytest.mark.once
def test_points_of_a_spline():
    x = np.linspace(-1.0, 2.0, 9)
    spline = fm.Spline(np.stack([x, 0.015 - 0.1 * (x - 0.5) ** 2], axis=1)[::-1])
    scene = on_obstacle(spline, fm.Coulomb(0.3), "points")
    check(scene, TotalForce(0, (1.0, 1.0)), ["shape", "place"], [0.01, 0.01], step=STEP)


def test_adhesion():
    """Open nodes under adhesion: their pressures depend on the gap."""
    problem, lift = columns(Fading(0.3))
    controls = {"law": LawParameter(0, "pull"), "offset": Offset(0)}

    def move(place):
        lift.value = place

    scene = Path(problem, problem.equations.bulk.u, controls, move, [0.2])
    objective = TotalForce(0, (0.0, 1.0)) + 10.0 * MeanGap(0)
    check(scene, objective, ["law", "offset"], [0.1, 0.01])
    assert problem.equations.contacts[0].attracted.any()
