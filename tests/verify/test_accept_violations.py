# SPDX-License-Identifier: MIT
"""States that violate their certificate raise, unless they are accepted."""

import pytest
from refusal import refused
from small_scenes import small_blocks
from spoilt_law import Spoilt, rubbing_blocks

import fenics_mortar as fm


@pytest.mark.once
def test_wrong_state_raises_unless_accepted():
    """The law's friction limit, unlike its tangential row, is too small: shears exceed it."""
    law = Spoilt("friction_limit", lambda bound: 0.5 * bound)
    law._on = False
    scene = rubbing_blocks(law)
    scene.problem.solve()
    start, accepted = scene.problem.state(), scene.contact.accepted_partners
    law._on = True
    scene.loads["push"].value[0] = 0.01
    parts = "wrong state: .*shear .*allowed", r"solve\(accept_violations=True\) returns the state"
    with refused(fm.NotConvergedError, *parts):
        scene.problem.solve()
    assert scene.contact.accepted_partners is accepted
    scene.problem.restore(start)
    report = scene.problem.solve(accept_violations=True)
    assert report.converged and report.certificate.violations()
    assert scene.contact.accepted_partners is not accepted
    law._on = False
    scene.problem.restore(start)
    assert scene.problem.solve().certificate.violations() == []


def test_error_contains_the_record_of_the_wrong_state():
    law = Spoilt("friction_limit", lambda bound: 0.5 * bound)
    with pytest.raises(fm.NotConvergedError) as caught:
        rubbing_blocks(law).problem.solve()
    report = caught.value.report
    assert not report.converged and report.certificate.violations()
    assert report.reason in report.table()
    assert any(note.startswith("VIOLATED") for note in report.notes)
    assert "follow_path" not in str(caught.value)  # smaller steps would not help


@pytest.mark.parametrize("value", [1, None, "yes"])
def test_accept_violations_is_a_flag(value):
    with refused(ValueError, "accept_violations=.*: expected True or False"):
        small_blocks().problem.solve(accept_violations=value)
