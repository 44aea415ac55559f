# SPDX-License-Identifier: MIT
"""What is not yet available in three dimensions: one list, one error, one page."""

from pathlib import Path

import pytest

from fenics_mortar.utils.errors import NOT_IN_SPACE, refuse_in_space

PAGE = Path(__file__).parents[2] / "demos" / "guide" / "limits.md"


@pytest.mark.parametrize("what", NOT_IN_SPACE)
def test_refusal_names_the_feature(what):
    with pytest.raises(NotImplementedError) as caught:
        refuse_in_space(what, "here")
    assert str(caught.value).endswith(f"in three dimensions: {NOT_IN_SPACE[what]} (here)")


def test_page_of_limits_lists_every_refused_feature():
    table = PAGE.read_text().split("| not yet in three dimensions |")[1].split("\n\n")[0]
    rows = [line.strip("| ") for line in table.splitlines() if line.startswith("| ")]
    assert rows == list(NOT_IN_SPACE.values())
