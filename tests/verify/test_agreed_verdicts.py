# SPDX-License-Identifier: MIT
"""Verdicts on numbers that differ between ranks, as by their last digits, are those of rank 0."""

import numpy as np
import pytest
from model_check_scenes import blocks
from one_rank import several_ranks
from refusal import COMM
from small_scenes import small_blocks

import fenics_mortar as fm
from fenics_mortar.verify.finding import Finding

pytestmark = several_ranks
FIRST, LAST = 0, COMM.size - 1
STEPS = fm.SteppingOptions(0.5, smallest=0.25)


def equal_on_ranks(value):
    return all(other == value for other in COMM.allgather(value))


def attempt(call):
    """Whether the call raises an error of convergence, on each rank, and its result."""
    try:
        result, failed = call(), False
    except fm.NotConvergedError as error:
        result, failed = error.report, True
    return result, COMM.allgather(failed)


def out_of_balance(rank):
    return lambda *_: (float(COMM.rank == rank), np.zeros(2))


def in_tension(rank):
    tension = Finding("tension", "tension", float(COMM.rank == rank), limit=0.5)
    return lambda *_: (lambda _: [tension],)


MEASURES = {"balance_of_bodies": out_of_balance, "checks": in_tension}


@pytest.mark.parametrize("rank", [FIRST, LAST])
@pytest.mark.parametrize("name", MEASURES)
def test_state_that_one_rank_would_refuse_is_refused_by_all_or_none(rank, name, monkeypatch):
    monkeypatch.setattr(f"fenics_mortar.verify.certificate.{name}", MEASURES[name](rank))
    scene = small_blocks()
    scene.loads["push"].value[:] = 0.0, -0.02
    report, failed = attempt(scene.problem.solve)
    assert failed == COMM.size * [rank == FIRST]
    certificate = report.certificate
    assert bool(certificate.violations()) == (rank == FIRST) and equal_on_ranks(certificate)
    assert equal_on_ranks(scene.problem.certificate()) and equal_on_ranks(report.notes)


@pytest.mark.parametrize("rank", [FIRST, LAST])
@pytest.mark.parametrize("name", ["_past_each_other", "_slid_away"])
def test_step_that_one_rank_takes_for_a_jump_is_refused_by_all_or_none(rank, name, monkeypatch):
    scene = small_blocks()
    jumped = "jumped" if COMM.rank == rank else ""
    monkeypatch.setattr(f"fenics_mortar.path.stepping.{name}", lambda *_: jumped)

    def load(time):
        scene.loads["push"].value[:] = 0.0, -0.02 * time

    report, failed = attempt(lambda: fm.follow_path(scene.problem, load, STEPS))
    assert failed == COMM.size * [rank == FIRST] and equal_on_ranks(len(report.steps))


@pytest.mark.parametrize("rank", [FIRST, LAST])
def test_models_are_sufficient_on_all_ranks_or_none(rank, monkeypatch):
    def relative(difference, size):
        return float(COMM.rank == rank)

    monkeypatch.setattr("fenics_mortar.models.model_error.relative", relative)
    _, report = blocks((0.0, -0.02))
    assert report.model_check.suffices == (rank == LAST)
    errors = [assumption.errors for assumption in report.model_check.assumptions]
    assert equal_on_ranks(errors) and equal_on_ranks(report.num_iterations)
