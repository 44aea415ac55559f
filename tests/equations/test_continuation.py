# SPDX-License-Identifier: MIT
"""Successive solves start from extrapolated states if loads continue, as load paths do."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import pressed_blocks

import fenics_mortar as fm

MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}
ROUGH = fm.Coulomb(0.2)


class Starts:
    """A scene, and the initial displacement of each solve."""

    def __init__(self, **options):
        self.scene = pressed_blocks(**MESH, **options)
        self.problem, self.u = self.scene.problem, []
        equations = self.problem.equations
        evaluate = equations.evaluate

        def first(*, start):
            if start:
                self.u.append(equations.bulk.u.x.array.copy())
            return evaluate(start=start)

        equations.evaluate = first

    def solve(self, x, y, **options):
        """Solve; return where Newton's method began, and the report."""
        self.scene.loads["push"].value[:] = (x, y)
        report = self.problem.solve(**options)
        return self.u[-1], report

    def state(self):
        return self.problem.equations.bulk.u.x.array.copy()


def extrapolated(before, last, ratio=1.0):
    return last + ratio * (last - before)


def pressed_twice(**options):
    """The scene and its states after proportional loads."""
    starts = Starts(**options)
    states = []
    for y in (-0.05, -0.1):
        starts.solve(0.0, y)
        states.append(starts.state())
    return starts, states


@pytest.mark.once
@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_loads_that_continue_start_from_the_last_two_states(ratio):
    starts, states = pressed_twice()
    begun, report = starts.solve(0.0, -0.1 - 0.05 * ratio)
    assert np.abs(begun - extrapolated(*states, ratio)).max(initial=0.0) < 1e-12
    plain, states = pressed_twice()
    begun, _ = plain.solve(0.0, -0.1 - 0.05 * ratio, predict=False)
    assert np.array_equal(begun, states[1])
    assert np.abs(plain.state() - starts.state()).max(initial=0.0) < 1e-8
    assert report.residuals[0] < 0.2 * plain.problem.solve().residuals[0] or report.converged


@pytest.mark.once
@pytest.mark.parametrize(
    "load", [(0.0, -0.08), (0.05, -0.1), (0.05, -0.12), (0.0, -0.1), (0.0, -0.3)],
    ids=["back", "aside", "turned", "stays", "far"],
)  # fmt: skip
def test_loads_that_do_not_continue_start_from_the_last_state(load):
    starts, states = pressed_twice(pair={"law": ROUGH})
    begun, report = starts.solve(*load)
    assert np.array_equal(begun, states[1]) and report.converged


@pytest.mark.once
def test_after_a_reversal_two_new_states_are_extrapolated():
    starts, states = pressed_twice()
    begun, _ = starts.solve(0.0, -0.08)
    assert np.array_equal(begun, states[1])
    back = starts.state()
    begun, _ = starts.solve(0.0, -0.06)
    assert np.abs(begun - extrapolated(states[1], back)).max(initial=0.0) < 1e-12


@pytest.mark.once
def test_states_and_laws_set_by_the_user_are_not_extrapolated():
    starts, states = pressed_twice(pair={"law": ROUGH})
    starts.problem.equations.bulk.u.x.array[:] = states[0]
    assert np.array_equal(starts.solve(0.0, -0.15)[0], states[0])
    starts, states = pressed_twice(pair={"law": ROUGH})
    starts.scene.contact.pair.law = fm.Coulomb(0.1)
    assert np.array_equal(starts.solve(0.0, -0.15)[0], states[1])
    starts, states = pressed_twice(pair={"law": ROUGH})
    starts.problem.accept()
    assert np.array_equal(starts.solve(0.0, -0.15)[0], states[1])


@pytest.mark.once
def test_step_cut_by_the_user_continues_the_path():
    """After a failed guess the next step has no guess; the following one has a guess."""
    starts, states = pressed_twice()
    here, options = starts.problem.state(), starts.problem.equations.newton
    starts.problem.equations.newton = replace(options, max_iterations=1, residual_tolerance=1e-15)
    with pytest.raises(fm.NotConvergedError):
        starts.solve(0.0, -0.15)
    starts.problem.equations.newton = options
    starts.problem.restore(here)
    assert np.array_equal(starts.solve(0.0, -0.125)[0], states[1])
    cut = starts.state()
    begun, _ = starts.solve(0.0, -0.15)
    assert np.abs(begun - extrapolated(states[1], cut)).max(initial=0.0) < 1e-12


@pytest.mark.once
def test_plain_loop_needs_the_iterations_of_follow_path():
    loads = np.linspace(0.0, 1.0, 6)[1:]

    def at(scene, time):
        scene.loads["push"].value[:] = (0.0, -0.2 * time)

    scene = pressed_blocks(**MESH)
    path = fm.follow_path(scene.problem, lambda time: at(scene, time), fm.SteppingOptions(loads[0]))
    counts = {}
    for predict in (True, False):
        scene = pressed_blocks(**MESH)
        counts[predict] = []
        for time in loads:
            at(scene, time)
            counts[predict].append(scene.problem.solve(predict=predict).num_iterations)
    # a path also uses the unloaded state
    assert counts[True][2:] == [step.report.num_iterations for step in path.steps][2:]
    assert sum(counts[True]) < sum(counts[False])


def test_bodies_with_inertia_start_from_the_last_state():
    """The acceleration of bodies is a load, too, which a static state does not contain."""
    starts, states = pressed_twice()
    motion = fm.Dynamics(starts.problem, 1.0)
    states = [states[-1]]
    for y in (-0.11, -0.12, -0.13):
        starts.scene.loads["push"].value[:] = (0.0, y)
        motion.step(0.1)
        assert np.array_equal(starts.u[-1], states[-1])
        states.append(starts.state())


@pytest.mark.once
def test_a_guess_is_evaluated_once(monkeypatch):
    """One assembly for the guess and for each iteration; the result is that of another one."""
    starts, _ = pressed_twice()
    equations, assembled = starts.problem.equations, []
    assemble = equations.bulk.assemble_residual

    def counted():
        assembled.append(1)
        assemble()

    monkeypatch.setattr(equations.bulk, "assemble_residual", counted)
    _, report = starts.solve(0.0, -0.15)
    assert len(assembled) == 1 + report.num_iterations
    assert equations.evaluated is None
    residual = equations.residual.measure()
    assert equations.evaluate(start=True).residual == pytest.approx(residual, rel=1e-12)


@pytest.mark.once
def test_the_evaluation_of_a_guess_ends_with_the_solve(monkeypatch):
    """After an interruption new loads are evaluated."""
    starts, states = pressed_twice()
    equations = starts.problem.equations

    def interrupt(_):
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr("fenics_mortar.equations.solver.begin_step", interrupt)
        with pytest.raises(KeyboardInterrupt):
            starts.solve(0.0, -0.15)
    assert equations.evaluated is None
    _, report = starts.solve(0.0, -0.12)
    assert report.converged and np.abs(starts.state() - states[1]).max(initial=0.0) > 0.0
    other, _ = pressed_twice()
    other.solve(0.0, -0.12, predict=False)
    assert np.abs(other.state() - starts.state()).max(initial=0.0) < 1e-8
