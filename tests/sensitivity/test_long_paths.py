# SPDX-License-Identifier: MIT
"""Paths of twenty steps that slide over facets, all objectives by all controls."""

import numpy as np
import pytest
from scenes import linear_elastic
from taylor_scenes import ROLL, blocks, check, directions_of, obstacle_on_block
from test_gradient import OBJECTIVES

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.sensitivity import FrictionWork, TotalForce, total
from fenics_mortar.sensitivity.controls import dot
from fenics_mortar.sensitivity.forms import controls_of

# Force, and its derivatives by E and mu, of linear bodies that slide; computed on one rank.
OF_ONE_RANK = [2.9281517352363444, 0.02928151735236369, -7.018226176978864]
# Pressed in two steps, drawn over one and a half facets, and back by a half.
LONG = [(0.002, -0.03), (0.004, -0.05)]
LONG += [(0.01 + 0.37 * k / 13, -0.05) for k in range(13)] + [
    (0.35 - 0.02 * k, -0.048) for k in range(5)
]
LAWS = {
    "none": (fm.Frictionless, {}),
    "Tresca": (lambda: fm.Tresca(1.0), {"stress": 0.3}),
    "Coulomb": (lambda: fm.Coulomb(0.3), {"mu": 0.1}),
}


@pytest.mark.once
@pytest.mark.parametrize("law", LAWS)
def test_twenty_steps_over_facets(law):
    made, parameters = LAWS[law]
    scene = blocks(made(), places=LONG)
    objective = TotalForce(0, (1.0, 0.3)) + FrictionWork(0)
    names, sizes = ["E", "interference", *parameters], [10.0, 0.003, *parameters.values()]
    gradient = check(scene, objective, names, sizes, over_steps=total, step=5e-5, exact=1e-9)
    assert len(gradient.by_step[0]) == 20


def everything():
    scene = blocks(fm.Coulomb(0.3), places=LONG[:6])
    scene.controls["offset"] = sensitivity.Offset(0)
    return scene


@pytest.mark.once
def test_all_objectives_by_all_controls():
    """Adjoint = tangent-linear for each pair, from one gradient by all and one direction each."""
    scene = everything()
    names = ["E", "load", "place", "mu", "interference", "offset"]
    controls = [scene.controls[name] for name in names]
    directions = directions_of(scene, names, [1.0] * len(names))
    path, made = scene.solve(), controls_of(scene.problem, controls)
    for objective in OBJECTIVES.values():
        quantity = objective(scene)
        gradient = fm.gradient(quantity, controls, path, over_steps=total)
        for control, by_step, along, own in zip(
            controls, gradient.by_step, directions, made, strict=True
        ):
            tangent = sensitivity.tangent_linear(
                quantity, [control], [along], path, over_steps=total
            )
            by_nodes = [abs(dot(scene.problem, own, abs(part), abs(along))) for part in by_step]
            found = dot(scene.problem, own, sum(by_step), along)
            assert abs(found - tangent.derivative) <= 1e-10 * sum(by_nodes)


def test_loads_of_a_driven_obstacle_are_part_of_the_record():
    """It is pushed in the first step, and prescribed in the second."""
    roller = fm.Circle((0.45, 1.5), 0.5)
    roller.move(y=-0.03)
    roller.push(y=-3.0)
    scene = obstacle_on_block(roller, fm.Coulomb(0.3), places=ROLL)
    path = sensitivity.RecordedPath(scene.problem)
    scene.problem.solve(predict=False)
    path.record()
    force, E = TotalForce(0, (1.0, 0.2)), scene.controls["E"]
    expected = fm.gradient(force, E, path)[E]
    roller.move(y=1.5 * roller.place[1])
    scene.problem.solve(predict=False)
    path.record()
    found = fm.gradient(
        force, E, path, over_steps=lambda at: (float(at[0, 0]), np.array([[1.0], [0.0]]))
    )
    assert float(found[E]) == pytest.approx(float(expected), rel=1e-10)


def test_derivatives_are_those_of_one_rank():
    """Linear bodies of one modulus: the force is proportional to it, dF/dE = F / E."""
    scene = blocks(fm.Coulomb(0.3), linear_elastic, places=LONG[:6])
    controls = [scene.controls[name] for name in ("E", "mu")]
    gradient = fm.gradient(TotalForce(0, (1.0, 0.3)), controls, scene.solve(), over_steps=total)
    found = [gradient.value, *(float(gradient[control]) for control in controls)]
    assert found == pytest.approx(OF_ONE_RANK, rel=1e-10)
