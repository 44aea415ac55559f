# SPDX-License-Identifier: MIT
"""Paths of twenty steps that slide over facets, all objectives by all controls, checkpoints."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import linear_elastic
from taylor_scenes import ROLL, blocks, check, directions_of, obstacle_on_block
from test_gradient import OBJECTIVES

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.sensitivity import FrictionWork, TotalForce, total
from fenics_mortar.sensitivity.protocols import controls_of, dot

comm = MPI.COMM_WORLD
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


@pytest.mark.parametrize("every, on_disk", [(1, True), (3, False), (4, True), (9, False)])
def test_checkpoints_give_the_derivatives_of_the_whole_record(every, on_disk, tmp_path):
    scene, places = blocks(fm.Coulomb(0.3), places=LONG[:7]), LONG[:7]
    folder = comm.bcast(tmp_path) if on_disk else None
    problem, controls = scene.problem, [scene.controls[name] for name in ("E", "place", "mu")]
    whole = sensitivity.RecordedPath(problem)
    some = sensitivity.RecordedPath(problem, every=every, folder=folder)
    for place in places:
        scene.move(place)
        problem.solve(predict=False)
        whole.record()
        some.record()
    objective = TotalForce(0, (1.0, 0.3)) + FrictionWork(0)
    expected = fm.gradient(objective, controls, whole, over_steps=total)
    before = problem.state()
    found = fm.gradient(objective, controls, some, over_steps=total)
    assert (problem.state().u == before.u).all()
    for control in controls:
        assert np.allclose(found[control], expected[control], rtol=1e-8, atol=1e-10)
    along = [np.ones_like(found[control]) for control in controls]
    tangents = [sensitivity.tangent_linear(objective, controls, along, path, over_steps=total)
                for path in (whole, some)]  # fmt: skip
    assert tangents[1].derivative == pytest.approx(tangents[0].derivative, rel=1e-8)
    assert all(step.state.u.size == 0 for step in some.steps)


def test_checkpoints_with_a_driven_obstacle():
    """Loads of the obstacle are part of the record."""
    roller = fm.Circle((0.45, 1.5), 0.5)
    roller.move(y=-0.03)
    roller.push(y=-3.0)
    scene = obstacle_on_block(roller, fm.Coulomb(0.3), places=ROLL)
    paths = [
        sensitivity.RecordedPath(scene.problem),
        sensitivity.RecordedPath(scene.problem, every=5),
    ]
    for x, y in [(0.0, -3.0), (0.02, -5.0), (0.05, -6.0), (0.08, -6.0)]:
        roller.push(y=y)
        roller.move(x=x)
        scene.problem.solve(predict=False)
        for path in paths:
            path.record()
    objective, E = TotalForce(0, (1.0, 0.2)), scene.controls["E"]
    one, other = (fm.gradient(objective, E, path, over_steps=total) for path in paths)
    assert float(other[E]) == pytest.approx(float(one[E]), rel=1e-8)


def test_invalid_spacings_are_refused():
    with pytest.raises(ValueError, match="every=0: expected a spacing"):
        sensitivity.RecordedPath(blocks().problem, every=0)


def test_invalid_folder_is_refused():
    """Not taken as the folder "3"."""
    with pytest.raises(ValueError, match="folder=3: expected the name of a folder"):
        sensitivity.RecordedPath(blocks().problem, every=2, folder=3)


def test_derivatives_are_those_of_one_rank():
    """Linear bodies of one modulus: the force is proportional to it, dF/dE = F / E."""
    scene = blocks(fm.Coulomb(0.3), linear_elastic, places=LONG[:6])
    controls = [scene.controls[name] for name in ("E", "mu")]
    gradient = fm.gradient(TotalForce(0, (1.0, 0.3)), controls, scene.solve(), over_steps=total)
    found = [gradient.value, *(float(gradient[control]) for control in controls)]
    assert found == pytest.approx(OF_ONE_RANK, rel=1e-10)
