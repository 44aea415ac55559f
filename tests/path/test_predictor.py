# SPDX-License-Identifier: MIT
"""Steps begun at the extrapolation of the last two states: iterations saved, and exceptions."""

from dataclasses import replace
from itertools import pairwise
from operator import itemgetter

import numpy as np
import pytest
from scenes import pressed_blocks
from test_driven import columns
from test_obstacles import KINDS, block_under
from test_stepping import MESH, ironing

import fenics_mortar as fm
from fenics_mortar.equations.predictor import MovingFrame, Predictor

FACET = 1 / 3  # of the block under the tool
ROUGH = fm.Coulomb(0.1)


def paths(scene, step, **ends):
    """The records of a path without and with guesses, each with equal first steps."""
    found = []
    for predict in (False, True):
        problem, set_loads = scene()
        options = fm.SteppingOptions(step, predict=predict)
        found.append((fm.follow_path(problem, set_loads, options, **ends), problem))
    return found


def counts(path):
    """Iterations of all steps."""
    return np.array([step.report.num_iterations for step in path.steps])


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize("facets, law", [(1.0, None), (1.7, ROUGH), (3.0, ROUGH)])
def test_sliding_by_facets_takes_fewer_iterations(law, facets):
    """Each step moves the tool by some facets, after three steps that press it in."""
    along = facets * FACET

    def scene():
        problem, set_loads = ironing(law=law)
        return problem, lambda step: set_loads(step / 3 if step <= 3 else 1 + (step - 3) * along)

    stop = 3.0 + np.floor(3.0 / along)
    (plain, one), (guessed, other) = paths(scene, 1.0, stop=stop)
    assert plain.num_cuts == guessed.num_cuts == 0
    # in the first two steps along the motion of contact is not known yet
    assert (counts(plain) - counts(guessed))[5:].mean() >= 1.5
    assert np.median(counts(guessed)[5:]) <= 5
    z, exact = (problem.equations.contacts[0].z for problem in (other, one))
    assert np.abs(z - exact).max() < 1e-8 * np.abs(exact).max()


@pytest.mark.once
@pytest.mark.serial
def test_kinds_are_compared_only_if_the_residual_increases(monkeypatch):
    """The tool moves along: both kinds of guesses exist from the third step of this motion on."""
    tried, guess, residual_at = list[list](), Predictor._guess, Predictor._residual_at

    def record_guess(predictor, kind, step):
        found = guess(predictor, kind, step)
        if found is not None:
            tried[-1].append(kind)
        return found

    def record_residual(predictor, state):
        tried[-1].append(residual_at(predictor, state))
        return tried[-1][-1]

    monkeypatch.setattr(Predictor, "_guess", record_guess)
    monkeypatch.setattr(Predictor, "_residual_at", record_residual)
    problem, set_loads = ironing(law=ROUGH)
    predictor = Predictor(problem.equations, 0.0)
    for step in range(1, 15):
        set_loads(step / 3 if step <= 3 else 1 + 0.8 * (step - 3) * FACET)
        tried.append([])
        with predictor.attempt(float(step), problem.solve) as finish:
            finish()
    alone = []
    for last, now in pairwise(tried[5:]):
        used, residual = min(zip(last[::2], last[1::2], strict=True), key=itemgetter(1))
        alone.append(now[1] <= residual)
        assert now[0] is used and len(now) == (2 if alone[-1] else 4)
    assert any(alone) and not all(alone)


def travelling(columns, degree):
    """Blocks, the length of a column of the lower one, states of waves on it, its nodes."""
    scene = pressed_blocks(slave="lower", degree=degree, n_lower=columns, n_upper=5)
    problem, contact = scene.problem, scene.contact
    s = np.array([np.ptp(contact.slave.X[:, 0]) / columns, 0.0])
    X, dofs = (
        problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2],
        problem.equations.bulk.space.dofs,
    )
    lower = (
        problem.equations.floating.labels == problem.equations.floating.labels_of(contact.slave)[0]
    )

    def wave(X, time):
        x = (X - s * time) / s[0]
        return np.stack([np.sin(x[:, 0]) * x[:, 1], time + np.cos(2.0 * x[:, 0])], axis=1)

    def state(time):
        found = problem.state()
        u = found.u.copy()
        u[dofs] = wave(X, time)
        interface = replace(contact.state, z=wave(contact.slave.X, time))
        return replace(found, u=u, interfaces=(interface,))

    return scene, s, state, (X, dofs, lower)


@pytest.mark.parametrize("degree", [1, 2])
def test_states_move_with_the_contact(degree):
    """Waves that travel one column of nodes per step: the guess is the next state."""
    scene, s, state, (X, dofs, lower) = travelling(8, degree)
    problem, contact = scene.problem, scene.contact
    frame = MovingFrame(problem.equations)
    moved = np.where(np.array([side.is_slave for side in frame._sides])[:, None], s, 0.0)
    before, last, right = state(1.0), state(2.0), state(4.0)
    guess = frame.guess(last, before, moved, 2.0)
    left, line = contact.slave.X[:, 0].min() + 3.0 * s[0], last.towards(before, -2.0)
    inside, outside = X[:, 0] > left + 0.1 * s[0], X[:, 0] < left - 0.1 * s[0]
    assert np.abs((guess.u - right.u)[dofs[lower & inside]]).max(initial=0.0) < 1e-10
    for stays in (~lower, lower & outside):
        assert np.array_equal(guess.u[dofs[stays]], line.u[dofs[stays]])
    inside = contact.slave.X[:, 0] > left - 0.1 * s[0]
    assert np.abs((guess.interfaces[0].z - right.interfaces[0].z)[inside]).max() < 1e-10
    assert frame.guess(last, before, 0.1 * moved, 2.0) is None
    assert frame.guess(last, before, np.nan * moved, 2.0) is None


@pytest.mark.once
@pytest.mark.serial
def test_reversed_path_starts_from_its_last_state():
    """The tool goes down, and then along; before and after that guesses are far better."""
    (plain, _), (guessed, _) = paths(ironing, 0.25, stop=1.75)
    before, after = (
        np.array([step.report.residuals[0] for step in path.steps]) for path in (plain, guessed)
    )
    assert after[4] == pytest.approx(before[4], rel=1e-6)
    assert (after[[2, 3, 5, 6]] < 0.1 * before[[2, 3, 5, 6]]).all()


def blocks_with_two_states():
    """Two blocks pressed twice, their predictor, and a function that presses them further."""
    scene = pressed_blocks(**MESH)
    predictor = Predictor(scene.problem.equations, 0.0)

    def press(time, solve=scene.problem.solve):
        scene.loads["push"].value[1] = -0.05 * time
        with predictor.attempt(time, solve) as finish:
            return finish()

    press(1.0), press(2.0)
    return scene.problem, predictor, press


@pytest.mark.once
def test_guess_extrapolates_the_last_two_states():
    problem, predictor, press = blocks_with_two_states()
    last, before = predictor.last, predictor._path[-2].state
    starts = []

    def solve():
        starts.append(problem.state())
        return problem.solve()

    press(2.5, solve)
    assert np.abs(starts[0].u - (1.5 * last.u - 0.5 * before.u)).max() < 1e-14
    z, z_last, z_before = (state.interfaces[0].z for state in (starts[0], last, before))
    assert np.abs(z - (1.5 * z_last - 0.5 * z_before)).max() < 1e-12


@pytest.mark.once
def test_rejected_guess_is_reverted_and_made_less_often():
    """Tentative solves fail: results are those without guesses."""
    problem, predictor, press = blocks_with_two_states()
    options, starts, tentative = problem.equations.newton, [], []

    def solve():
        starts.append(problem.state())
        tentative.append(problem.equations.newton.tentative)
        report = problem.solve()
        if tentative[-1]:
            raise fm.NotConvergedError("no good", report)
        return report

    last, report = predictor.last, press(3.0, solve)
    assert tentative == [True, False] and problem.equations.newton == options
    assert np.array_equal(starts[1].u, last.u) and np.array_equal(
        starts[1].interfaces[0].z, last.interfaces[0].z
    )
    assert report.converged and any("guess abandoned: no good" in note for note in report.notes)
    for time in np.arange(4.0, 9.0):
        press(time, solve)
    assert tentative == [True, False, False, True, False, False, False, True, False]
    other, _, go_on = blocks_with_two_states()
    iterations = [go_on(time, other.solve).num_iterations for time in (3.0, 4.0)]
    assert report.num_iterations > iterations[0]


@pytest.mark.once
def test_failure_from_both_initial_guesses_reports_both():
    problem, _, press = blocks_with_two_states()
    problem.equations.newton = replace(
        problem.equations.newton, max_iterations=2, residual_tolerance=1e-14
    )
    with pytest.raises(fm.NotConvergedError, match="not converged in 2") as failure:
        press(4.0)
    assert failure.value.report.num_iterations > 2


@pytest.mark.once
def test_prescribed_obstacle_is_not_extrapolated():
    """The motion changes from vertical to horizontal: a guess must not move it further down."""
    tool = KINDS["circle"]()
    problem = block_under(tool)

    def set_loads(time):
        x, y = max(time - 1.0, 0.0), -min(time, 1.0)
        tool.place[:] = 0.0
        tool.move(x=0.04 * x, y=0.05 * y)

    places = []
    options = fm.SteppingOptions(0.25)
    path = fm.follow_path(
        problem, set_loads, options, stop=2.0, on_step=lambda *_: places.append(tool.place.copy())
    )
    assert path.num_cuts == 0
    exact = [(0.04 * max(t - 1.0, 0.0), -0.05 * min(t, 1.0), 0.0) for t in 0.25 * np.arange(1, 9)]
    assert np.abs(places - np.array(exact)).max() < 1e-15


@pytest.mark.once
def test_guess_that_opens_the_contact_is_rejected():
    """A solve would first move the lid until it touches, and count slip from there."""
    lid = fm.Plane((1.5, 1.0), (0.0, -1.0))
    problem = columns(lid, left=1.0, right=1.0)
    predictor, notes, starts = Predictor(problem.equations, 0.0), [], []

    def solve():
        starts.append(problem.equations.contacts[0].z.copy())
        return problem.solve()

    for time, force in enumerate([0.4, 0.15, 1e-5], start=1):
        lid.push(y=-force, moment=0.0)
        with predictor.attempt(float(time), solve) as finish:
            notes += finish().notes
    assert np.array_equal(starts[2], predictor._path[-2].state.interfaces[0].z)
    assert sum("until contact stopped it" in note for note in notes) == 1  # before the first solve
