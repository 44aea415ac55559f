# SPDX-License-Identifier: MIT
"""Ends of paths: surfaces that slip off each other, and friction without equilibrium."""

from dataclasses import fields
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from demos.studies.stability import family
from demos.studies.stability.model import Body, Grid, Scene, Support, block, fm, legs, pose_problem
from fenics_mortar.path.stepping import _slid_away, reason_for_end

# Load increment beyond a state, over the whole load [1].
ONWARD = 1e-4


def posed(scene):
    """A scene by the default method, on all ranks."""
    return pose_problem(scene, MPI.COMM_WORLD, pair={}, problem={})


def cantilevers(motion):
    """One is pushed past another: their tips separate at 0.551 of the displacement."""
    left = block(8, 1, width=1.0, height=0.1, corner=(-1.0, -0.1))
    right = block(7, 1, width=1.0, height=0.1, corner=(-0.05, 0.0))
    return Scene(
        bodies=[Body(Grid("left", left)), Body(Grid("right", right))],
        pairs=[("left/top", "right/bottom")],
        supports=[Support(["left/left"]), Support(["right/right"], motion)],
        steps=10,
    )


def ironing(mu):
    """A round tool pressed into a block and drawn along it."""
    tool = family.punch(8, 2, width=0.8, height=0.5, radius=0.5, middle=-1.0)
    path = legs((3, (0.0, -0.15, 0.0)), (15, (1.5, -0.15, 0.0)))
    return Scene(
        bodies=[
            family.ground(30, 4, width=4.0, height=0.8),
            Body(Grid("tool", tool), E=10.0),
        ],
        pairs=[("ground/top", "tool/bottom")],
        supports=[family.FIXED, Support(["tool/top"], path)],
        steps=18,
        pair={"law": fm.Coulomb(mu)},
    )


# Scene, its last equilibrium, phrases of the message
ENDS = {
    "slip off": (
        cantilevers(family.down(1.0)),
        0.551,
        "'left/top' and 'right/bottom' slip off each other",
    ),
    "friction": (
        ironing(2.0),
        8.25 / 18,
        "stick and slip violates the law of friction",
    ),
}


@pytest.mark.serial
@pytest.mark.parametrize("end", ENDS)
def test_reason_for_the_end_of_a_path_is_reported(end):
    scene, last, message = ENDS[end]
    at = posed(scene)
    steps = fm.SteppingOptions(1.0 / scene.steps)
    assert fm.follow_path(at.problem, at.set_loads, steps, stop=last).dead_end == ""
    short = fm.SteppingOptions(2e-3, smallest=2e-3)
    with pytest.raises(fm.NotConvergedError, match=message) as error:
        fm.follow_path(at.problem, at.set_loads, short, start=last)
    assert message in error.value.report.dead_end
    assert error.value.report.num_cuts == 1


@pytest.mark.serial
@pytest.mark.parametrize("end", ENDS)
def test_no_end_is_reported_if_the_path_continues(end):
    """The same scenes earlier; the state is not changed by the check."""
    scene, *_ = ENDS[end]
    at = posed(scene)
    fm.follow_path(at.problem, at.set_loads, fm.SteppingOptions(1.0 / scene.steps), stop=7 / 18)
    assert end == "slip off" or at.problem.equations.contacts[0].sliding.any()
    before = at.problem.state()
    at.set_loads(7 / 18 + ONWARD)
    assert reason_for_end(at.problem) == ""
    after = at.problem.state()
    assert np.array_equal(before.u, after.u)
    for one, other in zip(before.interfaces, after.interfaces, strict=True):
        assert all(getattr(one, part.name) is getattr(other, part.name) for part in fields(one))


@pytest.mark.serial
def test_cantilevers_have_an_equilibrium_beyond_their_dead_end():
    """A detour aside, down and back leads to an unloaded state, one arm below the other.

    The arm is lowered by slightly more than the thickness of both.
    """
    around = legs((2, (0.2, 0.1, 0.0)), (8, (0.2, -0.21, 0.0)), (2, (0.0, -0.21, 0.0)))
    at = posed(cantilevers(around))
    fm.follow_path(at.problem, at.set_loads, fm.SteppingOptions(1 / 12))
    assert not at.forces.any()
    assert not at.problem.certificate().violations()


@pytest.mark.serial
@pytest.mark.parametrize(("stopped_by", "slid"), [("wall", False), ("friction", True), ("", True)])
def test_only_a_body_stopped_by_a_wall_is_at_rest(stopped_by, slid):
    """Before the step, friction transmitted a force to the body, and the wall none."""

    def pair(name, slip, force):
        state = SimpleNamespace(z=np.full((2, 2), force), active=np.array([True, False]))
        law = SimpleNamespace(has_friction=name == "friction")
        slave = SimpleNamespace(nodal_lengths=np.array([0.5, 0.5]))
        active = np.array([False, name == stopped_by])
        now = SimpleNamespace(
            pair=SimpleNamespace(law=law), slip=np.array([slip, 0.0]), slave=slave, active=active
        )
        return now, state

    contacts, states = zip(pair("friction", 2.0, 1.0), pair("wall", 0.0, 0.0), strict=True)
    block = SimpleNamespace(contacts=contacts, name="the block")
    floating = SimpleNamespace(settling=SimpleNamespace(moved=[block]))
    equations = SimpleNamespace(contacts=contacts, floating=floating)
    reason = _slid_away(SimpleNamespace(equations=equations), SimpleNamespace(interfaces=states))
    assert ("slid by 4.00 facets" in reason) == slid
