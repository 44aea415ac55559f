# SPDX-License-Identifier: MIT
"""Names declared by laws, and names of laws in messages."""

import pytest
from refusal import refused
from small_scenes import small_blocks

import fenics_mortar as fm
from demos.laws import Worn


@pytest.mark.parametrize(
    "names, words",
    [
        ({"memory": "depth"}, "memory of Named is 'depth': expected a tuple of names"),
        ({"memory": (1,)}, "expected a tuple of names"),
        ({"memory": ("depth", "depth")}, "has a name twice"),
        ({"fields": "mu"}, "fields of Named is 'mu'"),
        ({"fields": ("nu",)}, "Named has no attribute 'nu' of its fields"),
        ({"parameters": ("nu",)}, "Named has no attribute 'nu' of its parameters"),
    ],
)
def test_names_are_checked_at_set_up_and_when_a_law_is_set(names, words):
    law = type("Named", (Worn,), names)(0.3, 0.01)
    with refused(ValueError, words):
        small_blocks(pair={"law": law})
    problem = small_blocks(pair={"law": Worn(0.3, 0.01)}).problem
    problem.contacts[0].pair.law = law
    with refused(ValueError, words):
        problem.solve()


def test_a_derived_law_has_its_own_name_and_numbers():
    """Messages named ``Worn`` as Coulomb(0.3)."""
    assert repr(fm.Coulomb(0.3)) == "Coulomb(0.3)"
    assert repr(Worn(0.3, 0.01)).startswith("Worn(")
    assert "wear=0.01" in repr(Worn(0.3, 0.01))
    assert repr(type("Mine", (fm.Tresca,), {})(2.0)).startswith("Mine(")
