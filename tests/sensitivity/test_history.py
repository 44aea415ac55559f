# SPDX-License-Identifier: MIT
"""Derivative of the rows of a step by the state at its start."""

from mpi4py import MPI

import numpy as np
import pytest
import sensitivity_scenes as scenes
from friction_scenes import block_on
from self_scenes import c_ring
from turning_scenes import rollers, shaft_in_ring, wheel_under_block

import fenics_mortar as fm
from fenics_mortar.contact.law import magnitude, row_of
from fenics_mortar.interface.mortar import LINEARIZATIONS
from fenics_mortar.sensitivity.history import StepHistory, at_pair

comm = MPI.COMM_WORLD
# Relative rounding of sums of some hundred terms [1].
DOT = 1e-12


def check(problem, before, sizes=(0.005, 1.0, 0.005), *, sticks=True, held=False):
    """Taylor test of slip and rows, and dot product with the transpose; returns the history.

    Prescribed values do not change if ``held``.
    """
    history = StepHistory(problem.equations, before)
    contact = problem.equations.contacts[0]
    present = problem.state()
    frames = [c.rows.frame() for c in problem.equations.contacts]
    d, y = scenes.random_vector(problem, 1, sizes), scenes.random_vector(problem, 2)
    if held:
        d.u[problem.equations.bulk.prescribed_dofs] = 0.0

    def at(value):
        def of(t):
            scenes.count_slip_from(problem, scenes.moved(problem, before, d, t), present)
            return value()

        return of

    change = history.pairs[0].fields["slip"] @ at_pair(problem.equations, 0, d)
    assert np.abs(change).max() > 0.1 * sizes[0]
    rate, errors = scenes.taylor(at(lambda: contact.slip.copy()), change)
    assert rate > 1.9, errors
    change = history.residuals @ d
    of_rows = np.concatenate([z.ravel() for z in change.z])
    assert of_rows.any() == sticks
    rate, errors = scenes.taylor(at(lambda: scenes.rows(problem, frames)), of_rows)
    assert rate > 1.9, errors
    assert change.u is None and change.q is None
    there, back = y.dot(change, comm), (history.residuals.T @ y).dot(d, comm)
    assert there == pytest.approx(back, rel=DOT, abs=1e-300)
    return history


@pytest.mark.once
@pytest.mark.parametrize("slip", ["partners", "operators"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    "law, sticks",
    [(fm.Coulomb(0.3), True), (fm.Coulomb(2.0), True), (fm.Coulomb(0.05), False)],
    ids=["mixed", "stick", "slip"],
)
def test_blocks(law, sticks, degree, slip):
    pair = {"slip": slip, "search_radius": 0.8}
    scene, before, _ = scenes.two_steps(law, degree=degree, pair=pair)
    contact = scene.contact
    mixed = contact.sticking.any() and contact.now.sliding.any()
    assert mixed == (law.mu == 0.3) and contact.sticking.any() == sticks
    check(scene.problem, before, sticks=sticks)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("slip", ["partners", "operators"])
def test_open_and_uncovered_nodes(slip, cell):
    """The slave is wider than the master and bent: its ends are open, some without a partner."""
    scene, before, _ = scenes.two_steps(
        fm.Tresca(3.0), slave="lower", cell=cell, pair={"slip": slip}, n_lower=9, n_upper=4,
        width_lower=1.8, width_upper=1.0,
    )  # fmt: skip
    contact = scene.contact
    assert contact.sticking.any() and (~contact.covered).any()
    check(scene.problem, before)


@pytest.mark.once
def test_nodes_that_were_open():
    """No node touches at the start of the step: half of the rotation of both sides is no slip."""
    scene, before, _ = scenes.two_steps(
        fm.Coulomb(0.3), pushes=((0.0, 0.01), (0.01, -0.05)), gap=0.005
    )
    assert not before.interfaces[0].active.any() and scene.contact.active.any()
    check(scene.problem, before)


def test_small_sliding():
    scene, before, _ = scenes.two_steps(fm.Coulomb(0.3), pair={"sliding": "small"})
    check(scene.problem, before)


@pytest.mark.once
@pytest.mark.parametrize("basis", ["standard", "vertices"])
def test_other_bases(basis):
    scene, before, _ = scenes.two_steps(fm.Coulomb(0.3), degree=2, pair={"basis": basis})
    check(scene.problem, before)


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("law", [fm.Coulomb(0.3), fm.Coulomb(3.0)], ids=["mixed", "stick"])
def test_obstacle_that_moves_and_turns(law, degree):
    circle = fm.Circle((0.4, -1.5), 1.52)
    problem, _ = block_on(circle, degree=degree, law=law, angle=0.02)
    states = []
    for x, angle in ((0.0, 0.0), (0.02, 0.01)):
        circle.move(x=x, angle=angle)
        problem.solve(predict=False)
        states.append(problem.state())
    scenes.exact(problem)
    contact = problem.equations.contacts[0]
    assert contact.sticking.any() and (~contact.active).any()
    check(problem, states[0])
    assert (circle.place == states[1].places[0]).all()


@pytest.mark.parametrize("angle", [0.5, 5.0])
def test_wheel_that_turns(angle):
    problem, wheel = wheel_under_block(fm.Coulomb(0.3))
    before = problem.state()
    wheel.move(angle=angle, x=0.02)
    problem.solve(predict=False, accept_violations=True)
    check(scenes.exact(problem), before, sticks=False)


@pytest.mark.parametrize("slip", ["partners", "operators"])
@pytest.mark.parametrize("degree", [1, 2])
def test_shaft_that_turns(degree, slip):
    """By an eighth of a turn; both sides are elastic."""
    shaft = shaft_in_ring(fm.Coulomb(0.3), degree=degree, columns=24 // degree, slip=slip)
    shaft.turn(0.2)
    before = shaft.problem.state()
    shaft.turn(0.2 + 0.25 * np.pi, predict=False)
    check(scenes.exact(shaft.problem), before, sticks=False)


@pytest.mark.once
def test_nodes_that_supports_carry_into_contact_are_refused():
    """Two tyres that turn by an eighth; in steps of half a degree nothing is carried."""
    problem, left, right = rollers(fm.Coulomb(0.2), columns=(48, 55), layers=2)
    right.move(x=-0.02)
    problem.solve()
    for number, angle in enumerate((0.009, 0.25 * np.pi)):
        before = problem.state()
        left.move(angle=angle)
        problem.solve(predict=False)
        scenes.exact(problem)
        if number == 0:
            assert StepHistory(problem.equations, before).pairs
            continue
        with pytest.raises(fm.MortarError, match=r"carried nodes into .* less than 0\.57 degrees"):
            StepHistory(problem.equations, before)


@pytest.mark.once
def test_another_state_before_is_refused():
    scene, before, now = scenes.two_steps(fm.Coulomb(0.3))
    with pytest.raises(fm.MortarError, match="is not counted from the state before"):
        StepHistory(scene.problem.equations, now)
    assert StepHistory(scene.problem.equations, before).pairs


def test_terms_that_are_left_out_are_refused():
    scene, before, _ = scenes.two_steps(fm.Coulomb(0.3), problem={"linearization": "no_normals"})
    scene.problem.equations.linearization = LINEARIZATIONS["no_normals"]
    scene.problem.equations.evaluate_operators()
    with pytest.raises(fm.MortarError, match="derivatives of a solution need"):
        StepHistory(scene.problem.equations, before)


def test_without_friction_there_is_no_history():
    scene, before, _ = scenes.two_steps(fm.Frictionless())
    history = StepHistory(scene.problem.equations, before)
    d = scenes.random_vector(scene.problem, 1)
    assert not history.pairs and not any(z.any() for z in (history.residuals @ d).z)


@pytest.mark.once
def test_a_surface_in_contact_with_itself():
    """Slave and master are one surface, with nodes that are both."""
    law = fm.Coulomb(0.3)
    ring = c_ring(lambda data: [fm.ContactPair(data, ["ring/first", "ring/last"], law=law)])
    ring.move(10, high=np.array([0.01, -0.16]))
    before = ring.problem.state()
    ring.moved["high"].value[:] = 0.012, -0.165
    ring.problem.solve(predict=False)
    scenes.exact(ring.problem)
    assert ring.contact.master is ring.contact.slave and ring.contact.sticking.any()
    check(ring.problem, before)


class Worn(fm.Coulomb):
    """Wear by Archard's law."""

    memory = ("depth",)

    def depth(self, node):
        return node.memory["depth"] + 0.01 * node.z_n * magnitude(node.slip)

    def closing_gap(self, node):
        return row_of(lambda at: at.gap + self.depth(at), node)

    def remember(self, node, branch):
        return {"depth": self.depth(node)}


def test_closing_gaps_that_depend_on_slip():
    """The gap of a worn surface depends on the slip, also of sliding nodes."""
    scene, before, _ = scenes.two_steps(Worn(0.05))
    check(scene.problem, before)
