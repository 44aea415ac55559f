# SPDX-License-Identifier: MIT
"""Each numeric threshold of the package has one name, a unit and a reason, and is in the list."""

from collections import Counter
from pathlib import Path

import pytest

from demos.guide.thresholds import table, thresholds

LIST = Path(__file__).resolve().parents[2] / "demos" / "guide" / "thresholds.md"

pytestmark = pytest.mark.serial


def test_the_list_is_that_of_the_modules():
    assert LIST.read_text() == table() + "\n"


def test_no_name_has_two_meanings():
    counts = Counter(threshold.name.lower() for threshold in thresholds())
    assert {name for name, count in counts.items() if count > 1} == set()


def test_each_has_a_meaning_and_each_quantity_a_unit():
    for threshold in thresholds():
        assert threshold.meaning, threshold
        counts = threshold.value.isdigit()
        assert counts or "[" in threshold.meaning, threshold


def test_some_are_found_in_modules_and_in_frozen_classes():
    found = {threshold.name: threshold for threshold in thresholds()}
    assert found["HALF_FACET"].value == "0.5"
    assert found["normals_err"].module == "obstacles/rigid_motion.py"
