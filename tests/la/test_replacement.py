# SPDX-License-Identifier: MIT
"""Replacement of multigrid's cycle: lasting losses count, other right-hand sides do not."""

from __future__ import annotations

import pytest

from fenics_mortar.la.multigrid import (
    EXCESS_OF_OTHER_SET,
    IGNORED_EXCESS,
    MAX_EXCESS,
    Replacement,
)

DIGITS = 5.0
# Iterations per digit of the solves of a load step with a new cycle.
STEP = 1.4, 1.7, 1.6, 1.75


def solve_steps(rule, steps, *, factor=1.0, rates=STEP, begin=0):
    """Record the solves of load steps, until a new cycle is due; return the number of solves."""
    solves = 0
    for _ in range(steps):
        for place in range(begin, len(rates)):
            if rule.is_due(0.0, DIGITS):
                return solves
            rule.record(factor * rates[place] * DIGITS, DIGITS, place)
            solves += 1
        begin = 0
    return solves


@pytest.mark.parametrize("begin", range(len(STEP)))
@pytest.mark.parametrize("rates", [STEP, STEP[::-1], STEP[:1], STEP[1:]])
def test_cycle_is_kept_if_only_right_hand_sides_differ(begin, rates):
    rule = Replacement(2)
    begin = min(begin, len(rates) - 1)
    assert solve_steps(rule, 50, rates=rates, begin=begin) == 50 * len(rates) - begin
    assert not rule.is_due(0.0, DIGITS)


def test_small_lasting_losses_are_not_counted():
    rule = Replacement(2)
    solve_steps(rule, 1)
    assert solve_steps(rule, 100, factor=1.0 + 0.99 * IGNORED_EXCESS) == 100 * len(STEP)


@pytest.mark.parametrize("factor", [1.2, 1.5, 2.0])
def test_cycle_is_replaced_as_soon_as_lasting_losses_have_cost_the_limit(factor):
    rule = Replacement(2)
    solve_steps(rule, 10)
    solves = solve_steps(rule, 20, factor=factor)
    assert rule.is_due(0.0, DIGITS)
    slowest = max(STEP) * DIGITS * (factor - 1.0 - IGNORED_EXCESS)
    assert MAX_EXCESS / slowest < solves < 1.0 + MAX_EXCESS / (slowest * STEP[0] / STEP[-1])


def test_losses_within_one_long_load_step_count():
    """No solve has the place of another one: each is compared with the slowest before it."""
    rule, rate, solves = Replacement(2), 1.5, 0
    while not rule.is_due(0.0, DIGITS):
        rule.record(rate * DIGITS, DIGITS, solves)
        rate, solves = rate + 0.3, solves + 1
    assert solves == 2 + int(MAX_EXCESS / (0.3 * DIGITS))


def test_better_solves_are_subtracted_but_not_credited():
    rule = Replacement(2)
    usual = 2.0 * DIGITS
    rule.record(usual, DIGITS, 0)
    for excess, is_due in ((-0.5, 0), (0.9, 0), (-0.3, 0), (0.35, 0), (0.1, 1)):
        rule.record((1.0 + IGNORED_EXCESS) * usual + excess * MAX_EXCESS, DIGITS, 0)
        assert rule.is_due(0.0, DIGITS) == is_due


def test_excess_is_expected_in_proportion_to_changed_nodes_and_digits():
    share = MAX_EXCESS / (EXCESS_OF_OTHER_SET * DIGITS)
    rule = Replacement(2)
    assert not rule.is_due(0.99 * share, DIGITS)
    assert rule.is_due(1.01 * share, DIGITS)
    assert not rule.is_due(1.01 * share, 0.5 * DIGITS)
