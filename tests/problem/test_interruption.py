# SPDX-License-Identifier: MIT
"""After a KeyboardInterrupt anywhere the problem is restored and usable."""

import re
import sys
from dataclasses import fields
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from dimension_scenes import FRAME, plane_strip, strip_in_space
from model_check_scenes import blocks as model_blocks
from scenes import linear_elastic, neo_hookean, nodal, pressed_blocks
from test_driven import block_under
from test_floating import falling_disk

import fenics_mortar as fm
from fenics_mortar.utils import compat
from fenics_mortar.utils.clock import clock
from fenics_mortar.utils.errors import as_interruption

comm = MPI.COMM_WORLD
MESH = {"n_upper": 5, "n_lower": 7, "layers_upper": 2, "layers_lower": 2}
PACKAGE = str(Path(fm.__file__).parent)


class Interrupt:
    """Count of the lines of the package that are run, with an interruption at one of them."""

    def __init__(self, at=None):
        self.at, self.count = at, 0

    def __call__(self, frame, event, argument):
        if (
            not frame.f_code.co_filename.startswith(PACKAGE)
            or "kernels" in frame.f_code.co_filename
        ):
            return None
        if event == "line":
            self.count += 1
            if self.count == self.at:
                raise KeyboardInterrupt
        return self

    def run(self, work):
        """Do the work; return whether it was interrupted."""
        sys.settrace(self)
        try:
            work()
        except KeyboardInterrupt:
            return True
        finally:
            sys.settrace(None)
        return False


def everything(problem):
    """Copies of all data that a solve may change and an interruption must restore."""
    state = problem.state()
    contacts = [c.operators for c in problem.equations.contacts]
    options = PETSc.Options("test_").getAll()
    springs = id(problem.equations.springs.present)  # a frozen value
    return state, contacts, options, problem.equations.newton, springs, clock.depth


def are_equal(one, other):
    (a, b), rest = (one[0], other[0]), zip(one[1:], other[1:], strict=True)
    same = np.array_equal(a.u, b.u) and np.array_equal(a.places, b.places)
    same &= a.converged == b.converged
    for p, q in zip(a.interfaces, b.interfaces, strict=True):
        same &= all(getattr(p, part.name) is getattr(q, part.name) for part in fields(p))
    (kept, now), *others = rest
    same &= all(o is p for o, p in zip(kept, now, strict=True))
    return same and all(x == y for x, y in others)


def interrupt_at_random(problem, work, seed, *, times):
    """Interrupt some work at random lines: each time the problem is restored and usable.

    Args:
        problem: The problem.
        work: Function to be interrupted; starts from the present state.
        seed: Seed of the lines.
        times: Number of interruptions.
    """
    start = problem.state()
    counter = Interrupt()
    counter.run(work)
    end = problem.state()
    rng = np.random.default_rng(seed)
    for at in rng.integers(1, counter.count + 1, times):
        problem.restore(start)
        before = everything(problem)
        if not Interrupt(int(at)).run(work):
            continue  # warm caches leave out some lines
        assert are_equal(before, everything(problem)), at
        work()
        now = problem.state()
        assert np.abs(now.u - end.u).max() < 1e-9 * np.abs(end.u).max(), at  # Newton's tolerance
        for here, there in zip(now.interfaces, end.interfaces, strict=True):
            assert np.abs(here.z - there.z).max() < 1e-8 * np.abs(here.z).max(), at


SCENES = {
    "friction": {"pair": {"law": fm.Coulomb(0.3)}},
    "saddle": {"problem": {"algorithm": "saddle"}},
    "iterative": {"problem": {"solver": "iterative"}},
    "linear": {"material": linear_elastic, "problem": {"linear_bulk": True}},
    "small": {
        "material": linear_elastic,
        "pair": {"sliding": "small"},
        "problem": {"linear_bulk": True},
    },
}


@pytest.mark.serial
@pytest.mark.parametrize("name", SCENES)
def test_a_solve_may_be_interrupted_anywhere(name):
    scene = pressed_blocks(**{"material": neo_hookean, **SCENES[name]}, **MESH)
    push = scene.loads["push"].value
    push[1] = -0.05
    scene.problem.solve()
    push[:] = (0.1, -0.1)
    interrupt_at_random(scene.problem, scene.problem.solve, seed=len(name), times=12)


@pytest.mark.once
@pytest.mark.serial
def test_a_solve_with_springs_may_be_interrupted_anywhere():
    """A disk that may roll, by the proximal point method with springs."""
    problem = falling_disk(0.1)
    interrupt_at_random(problem, problem.solve, seed=3, times=2)


@pytest.mark.once
@pytest.mark.serial
def test_a_driven_obstacle_may_be_interrupted_anywhere():
    lid = fm.Plane((1.0, 1.02), (0.0, -1.0), name="lid")
    problem = block_under(lid)
    lid.push(y=-0.2, moment=0.0)
    interrupt_at_random(problem, problem.solve, seed=4, times=8)


@pytest.mark.once
@pytest.mark.serial
def test_a_path_may_be_interrupted_anywhere():
    """The path continues from the last accepted step; the error has a note with its time."""
    scene = pressed_blocks(pair={"law": fm.Coulomb(0.3)}, **MESH)
    times = [0.0]

    def set_loads(time):
        scene.loads["push"].value[:] = (0.1 * time, -0.1 * min(2.0 * time, 1.0))

    def follow(start=0.0):
        options = fm.SteppingOptions(step=0.25)
        fm.follow_path(
            scene.problem, set_loads, options, start=start, on_step=lambda t, _: times.append(t)
        )

    problem, start, rng = scene.problem, scene.problem.state(), np.random.default_rng(0)
    counter = Interrupt()
    counter.run(follow)
    end = problem.state()
    for line in rng.integers(1, counter.count + 1, 6):
        problem.restore(start)
        times[:] = [0.0]
        try:
            sys.settrace(Interrupt(int(line)))
            follow()
        except KeyboardInterrupt as error:
            sys.settrace(None)
            noted = getattr(error, "__notes__", [""])
            at = re.match(r"the problem is at time (\S+), its last", noted[0])
            assert at is not None or len(times) == 1 or times[-1] == 1.0
            reached = times[-1] if at is None else float(at[1])
            assert reached in (times[-1], times[-1] + 0.25)  # on_step comes after the step
            if reached < 1.0:
                follow(reached)
        finally:
            sys.settrace(None)
        assert np.abs(problem.state().u - end.u).max() < 1e-9 * np.abs(end.u).max(), line


@pytest.mark.once
@pytest.mark.serial
def test_a_model_check_may_be_interrupted_anywhere():
    problem, _ = model_blocks((0.0, -0.02), strain="finite", friction=0.3)
    (bc,) = [bc for bc in problem.equations.bulk.bcs if hasattr(bc.g, "value") and bc.g.value.any()]
    bc.g.value[:] = (0.02, -0.03)
    start = problem.equations.model_check.snapshot()
    interrupt_at_random(problem, lambda: (start(), problem.solve()), seed=1, times=6)


@pytest.mark.once
@pytest.mark.serial
def test_an_estimate_by_a_problem_in_space_may_be_interrupted_anywhere(monkeypatch):
    """Errors are the same afterwards, with slip counted from the same state."""
    law = fm.Coulomb(0.3)
    solid = strip_in_space(0.3, depth=0.0, layers=1, law=law)
    check = fm.ModelCheck(in_space=fm.InSpace(solid, **FRAME))
    plane = plane_strip(depth=0.0, law=law, model_check=check)

    def errors(x, y):
        plane.obstacles[0].move(x=x, y=y)
        solid.obstacles[0].move(x=x, z=y)
        return plane.solve().model_check.assumptions[-1].errors

    errors(0.0, -0.02)
    start, state = check.snapshot(), plane.state()
    expected = errors(0.02, -0.03)
    plane.restore(state)
    start()
    plane.obstacles[0].move(x=0.02, y=-0.03)
    interrupt_at_random(plane, lambda: (start(), plane.solve()), seed=2, times=6)
    plane.restore(state)
    start()
    assert errors(0.02, -0.03) == pytest.approx(expected, rel=1e-6)
    assert not solid.state().u.any()
    calls, restore = [], type(solid).restore

    def interrupted(problem, state):
        calls.append(state)
        if len(calls) == 3:  # that at the end of the comparison
            raise KeyboardInterrupt
        restore(problem, state)

    monkeypatch.setattr(type(solid), "restore", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plane.solve()
    monkeypatch.undo()
    assert len(calls) == 3 and not solid.state().u.any()


@pytest.mark.once
def test_an_error_of_a_law_of_the_user_leaves_the_problem_as_it_was():
    class Law(fm.Coulomb):
        fails = False

        def friction_limit(self, z_n):
            if self.fails:
                raise KeyError("no such speed")
            return super().friction_limit(z_n)

    law = Law(0.3)
    scene = pressed_blocks(pair={"law": law}, **MESH)
    scene.loads["push"].value[1] = -0.05
    scene.problem.solve()
    before = everything(scene.problem)
    scene.loads["push"].value[:] = (0.1, -0.1)
    law.fails = True
    with pytest.raises((KeyError, fm.MortarError)):
        scene.problem.solve()
    law.fails = False
    assert are_equal(before, everything(scene.problem))
    assert scene.problem.solve().converged


def test_a_second_interruption_while_matrices_are_created_again_is_harmless(monkeypatch):
    """The tangent was destroyed before its successor existed, and the next solve crashed."""
    scene = pressed_blocks(**MESH)
    scene.loads["push"].value[1] = -0.01
    create = compat.create_matrix

    def interrupted(form):
        monkeypatch.setattr(compat, "create_matrix", create)
        raise KeyboardInterrupt

    scene.problem.equations.interrupted = True
    monkeypatch.setattr(compat, "create_matrix", interrupted)
    with pytest.raises(KeyboardInterrupt):
        scene.problem.solve()
    assert scene.problem.solve().converged


@pytest.mark.parametrize("chain", [1, 2])
def test_interruption_in_compiled_code_is_recognized(chain, monkeypatch):
    """Numba raises a SystemError that has the interruption as its cause."""
    scene = pressed_blocks(**MESH)
    scene.loads["push"].value[1] = -0.01
    before = nodal(scene.problem)

    def kernel(*arguments):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            for _ in range(chain):
                outer = SystemError("returned a result with an exception set")
                outer.__cause__ = error
                error = outer
            raise error from error.__cause__

    monkeypatch.setattr(type(scene.contact), "evaluate", kernel)
    with pytest.raises(KeyboardInterrupt):
        scene.problem.solve()
    monkeypatch.undo()
    assert np.array_equal(nodal(scene.problem), before)
    assert scene.problem.solve().converged


def test_other_system_errors_are_unchanged():
    error = SystemError("mine")
    assert as_interruption(error) is error
