# SPDX-License-Identifier: MIT
"""Progress of a path: records of the logger, nothing by default."""

import logging

import pytest
from refusal import COMM
from small_scenes import small_blocks

import fenics_mortar as fm


def follow(fails_at=None, **options):
    """Press small blocks in steps of 0.5; the step to ``fails_at`` fails once."""
    scene = small_blocks(gap=0.01)
    solve, failed = scene.problem.solve, []

    def solve_or_fail(**given):
        if scene.loads["push"].value[1] == fails_at and not failed:
            failed.append(1)
            raise fm.NotConvergedError("as told", fm.NewtonReport())
        return solve(**given)

    scene.problem.solve = solve_or_fail

    def set_loads(time):
        scene.loads["push"].value[1] = -0.04 * time

    return fm.follow_path(scene.problem, set_loads, fm.SteppingOptions(step=0.5), **options)


@pytest.mark.once
def test_path_is_silent_by_default(capfd):
    follow()
    assert capfd.readouterr() == ("", "")


def test_rank_0_logs_each_step_and_each_cut(caplog):
    caplog.set_level(logging.DEBUG, "fenics_mortar")
    path = follow(fails_at=-0.02)
    messages = [record.getMessage() for record in caplog.records if record.name == "fenics_mortar"]
    levels = [record.levelname for record in caplog.records if record.name == "fenics_mortar"]
    if COMM.rank:
        assert messages == []
        return
    assert path.num_cuts > 0 and messages[0] == "time 0.5: cut, as told"
    accepted = [line for line in messages if line.startswith("step ")]
    reports = [
        f"step {i}, time {s.time:.6g}: {s.report.reason}" for i, s in enumerate(path.steps, 1)
    ]
    assert accepted == reports
    assert levels == ["INFO", "DEBUG"] * (len(path.steps) + path.num_cuts)
    assert messages[-1] == str(path.steps[-1].report)
