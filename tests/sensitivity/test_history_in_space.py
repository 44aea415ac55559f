# SPDX-License-Identifier: MIT
"""Derivative of the rows of a step in space by the state at its start."""

import pytest
import sensitivity_scenes as scenes
from space_pairs import KINDS, ROLES
from space_taylor_scenes import blocks, on_obstacle, twisted
from test_history import check

import fenics_mortar as fm

# Nine-node facets that do not match stall above tighter tolerances; the rows need no solution.
ROUGH = {"newton": fm.NewtonOptions(residual_tolerance=1e-10)}


def last_step(scene):
    """The problem after all steps with all derivatives, and the state before the last one."""
    path = scene.solve()
    scene.problem.restore(path.steps[-1].state)
    return scenes.exact(scene.problem), path.before(len(path.steps) - 1)


@pytest.mark.once
@pytest.mark.parametrize("roles", ROLES, ids=["small_slave", "large_slave"])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_blocks(cell, degree, roles):
    """Some nodes of the large slave have no partner before, but nearest points."""
    problem, before = last_step(blocks(cell, degree, fm.Coulomb(0.3), roles=roles, problem=ROUGH))
    contact = problem.equations.contacts[0]
    assert contact.now.sliding.any()
    assert roles == ROLES[0] or (~contact.covered).any()
    check(problem, before)


@pytest.mark.parametrize("law", [fm.Coulomb(2.0), fm.Tresca(2.0)], ids=str)
def test_stick_and_laws(law):
    problem, before = last_step(blocks(law=law))
    check(problem, before)


def test_nodes_that_were_open():
    scene = blocks(law=fm.Coulomb(0.3), places=[(0.0, 0.0, 0.02), (0.01, 0.005, -0.05)])
    problem, before = last_step(scene)
    assert not before.interfaces[0].active.any()
    check(problem, before)


@pytest.mark.serial
def test_redundant_sticks():
    """They stick elastically, from the shear of the earlier state."""
    problem, before = last_step(blocks(law=fm.Coulomb(2.0)))
    contact = problem.equations.contacts[0]
    contact.change(redundant=contact.sticking & before.interfaces[0].active)
    problem.equations.evaluate_operators()
    assert contact.redundant.any()
    check(problem, before)


@pytest.mark.serial
def test_small_sliding():
    problem, before = last_step(blocks(law=fm.Coulomb(0.3), pair={"sliding": "small"}))
    check(problem, before)


@pytest.mark.serial
def test_standard_basis():
    check(*last_step(blocks(law=fm.Coulomb(0.3), pair={"basis": "standard"})))


@pytest.mark.serial
def test_symmetry_planes():
    """Edges of both sides coincide on the plane, and stay there."""
    scene = blocks(law=fm.Coulomb(0.3), places=[(0.0, 0.0, -0.02), (0.0, 0.02, -0.05)], half=True)
    problem, before = last_step(scene)
    assert problem.equations.contacts[0].is_guided.any()
    check(problem, before, held=True)


@pytest.mark.once
def test_bodies_that_turn_past_each_other():
    """Both turn in the step, the upper one farther: materials and their relative rotation."""
    problem, before = last_step(twisted(fm.Coulomb(0.3)))
    contact = problem.equations.contacts[0]
    assert contact.partners.at(contact.operators).doubt.max() > 0.1
    check(problem, before)


@pytest.mark.once
def test_sphere_that_turns_far():
    places = [(0.0, 0.0, -0.05, 0.1, 0.2, 0.3), (0.02, 0.0, -0.05, 0.1, 0.9, 0.6)]
    check(*last_step(on_obstacle(fm.Coulomb(0.3), places=places)))


@pytest.mark.parametrize("law", [fm.Coulomb(0.3), fm.Coulomb(3.0)], ids=["mixed", "stick"])
@pytest.mark.parametrize("cell, degree", KINDS[:2])
def test_sphere_that_moves_and_turns(cell, degree, law):
    problem, before = last_step(on_obstacle(law, cell, degree))
    check(problem, before)
