# SPDX-License-Identifier: MIT
"""Progress of a path: records of the logger, a bar, nothing by default."""

import logging
import sys
from types import SimpleNamespace

import pytest
from refusal import COMM, refused
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


BARS = []


class Bar:
    """Replacement of tqdm."""

    def __init__(self, total, **_):
        self.total, self.n, self.closed, self.postfix = total, 0.0, False, ""
        BARS.append(self)

    def set_postfix_str(self, text, refresh):
        self.postfix = text

    def update(self, amount):
        self.n += amount

    def close(self):
        self.closed = True


def test_bar_follows_the_time_on_rank_0(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", SimpleNamespace(tqdm=Bar))
    BARS.clear()
    follow(progress=True, stop=2.0)
    follow(fails_at=-0.02, progress=True)
    assert len(BARS) == (2 if COMM.rank == 0 else 0)
    for bar, total in zip(BARS, (2.0, 1.0)):
        assert bar.closed and bar.total == bar.n == total
        assert bar.postfix.endswith("0 cuts" if total == 2.0 else "1 cuts")


def test_bar_is_closed_where_a_path_ends(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", SimpleNamespace(tqdm=Bar))
    BARS.clear()

    def stop(time, report):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        follow(progress=True, on_step=stop)
    assert all(bar.closed for bar in BARS)


def test_bar_without_tqdm_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    with refused(ValueError, "progress=True needs the package tqdm: Debian's python3-tqdm"):
        follow(progress=True)
    with refused(ValueError, "progress=1: expected True or False"):
        follow(progress=1)
