# SPDX-License-Identifier: MIT
"""Paths with invalid arguments."""

import numpy as np
import pytest
from refusal import refused
from remote_scenes import ring
from scenes import linear_elastic
from small_scenes import small_blocks

from dolfinx import fem

import fenics_mortar as fm


@pytest.mark.each
@pytest.mark.parametrize(
    "options, more, message",
    [
        (
            0.1,
            {},
            r"options=0.1: expected an .* SteppingOptions, such as SteppingOptions\(step=0.1\)",
        ),
        ({"step": 0.1}, {}, "options=.*: expected an instance of SteppingOptions"),
        (None, {"start": 1.0, "stop": 0.0}, "start=1.0 is beyond stop=0.0: times increase"),
        (None, {"stop": np.nan}, "stop=nan: expected a finite number"),
        (None, {"stop": np.inf}, "stop=inf: expected a finite number"),
        (None, {"start": "0"}, "start='0': expected a finite number"),
        (None, {"on_step": 1}, "on_step=1: expected a function"),
        (None, {"set_loads": 0.1}, "set_loads=0.1: expected a function of the time"),
        (None, {"problem": None}, "problem=None: expected a ContactProblem"),
    ],
)
def test_invalid_path_is_refused(options, more, message):
    given = {
        "problem": small_blocks().problem,
        "set_loads": lambda time: None,
        "options": options or fm.SteppingOptions(0.5),
        **more,
    }
    with refused(ValueError, message):
        fm.follow_path(**given)


def test_path_from_its_end_has_no_steps():
    scene = small_blocks()
    options = fm.SteppingOptions(0.5)
    path = fm.follow_path(scene.problem, lambda time: None, options, start=1.0, stop=1.0)
    assert path.finished and not path.steps


@pytest.mark.parametrize("in_place", [True, False])
def test_loads_that_never_change_are_remarked(in_place):
    """A new constant in ``set_loads`` is no part of the problem."""
    scene = small_blocks()
    push = scene.loads["push"]

    def set_loads(time):
        given = push if in_place else fem.Constant(scene.data.mesh, (0.0, 0.0))
        given.value[1] = -0.02 * time

    path = fm.follow_path(scene.problem, set_loads, fm.SteppingOptions(step=0.5))
    remarks = [note for note in path.notes if "set_loads changed no constant" in note]
    assert len(remarks) == (0 if in_place else 1)
    assert all(note in str(path) for note in path.notes)


@pytest.mark.parametrize("kind", [fm.RigidBoundary, fm.SpreadLoad])
def test_loads_at_a_point_are_loads(kind):
    problem, hub = ring(linear_elastic, columns=8, rows=1, load=kind)
    options = fm.SteppingOptions(step=0.5)
    path = fm.follow_path(problem, lambda time: hub.push(moment=0.01 * time), options)
    assert path.finished and not path.notes
