# SPDX-License-Identifier: MIT
"""Names declared by laws, and names of laws in messages."""

import numpy as np
import pytest
from refusal import refused
from small_scenes import small_blocks

import fenics_mortar as fm
from fenics_mortar.contact.law import Nodal, Row
from fenics_mortar.laws import Worn


@pytest.mark.parametrize(
    "names, message",
    [
        ({"memory": "depth"}, "memory of Named is 'depth': expected a tuple of names"),
        ({"memory": (1,)}, "expected a tuple of names"),
        ({"memory": ("depth", "depth")}, "has a name twice"),
        ({"fields": "mu"}, "fields of Named is 'mu'"),
        ({"summed_slip": "slid"}, "summed_slip of Named is 'slid': expected a name in its memory"),
        ({"fields": ("nu",)}, "Named has no attribute 'nu' of its fields"),
        ({"parameters": ("nu",)}, "Named has no attribute 'nu' of its parameters"),
    ],
)
def test_names_are_checked_at_set_up_and_when_a_law_is_set(names, message):
    law = type("Named", (Worn,), names)(0.3, 0.01)
    with refused(ValueError, message):
        small_blocks(pair={"law": law})
    problem = small_blocks(pair={"law": Worn(0.3, 0.01)}).problem
    problem.contacts[0].pair.law = law
    with refused(ValueError, message):
        problem.solve()


def test_derived_law_prints_its_name_and_parameters():
    """Messages named ``Worn`` as Coulomb(0.3)."""
    assert repr(fm.Coulomb(0.3)) == "Coulomb(0.3)"
    assert repr(Worn(0.3, 0.01)).startswith("Worn(")
    assert "wear=0.01" in repr(Worn(0.3, 0.01))
    assert repr(type("Mine", (fm.Tresca,), {})(2.0)).startswith("Mine(")


@pytest.mark.serial
def test_closing_gap_of_a_law_without_a_layer_is_the_gap():
    """Derivatives are checked, too, since laws with a layer add to them."""
    gap = np.array([-0.1, 0.0, 0.3])
    row = fm.Coulomb(0.3).closing_gap(Nodal(gap, *np.zeros((5, 3))))
    assert row == Row(gap, by_gap=1.0, by_slip=0.0, by_z_n=0.0, by_z_tau=0.0)


def test_slip_couples_nodes_of_laws_with_friction_or_nodal_state_alone():
    """Other nodes need no entries in the matrix."""
    clinging = type("Clinging", (fm.Frictionless,), {})
    for law, couples in ((fm.Frictionless(), 0), (clinging(), 0), (fm.Coulomb(0.3), 1)):
        slave, master = small_blocks(pair={"law": law}).contact.coupled_by_slip()
        assert len(slave) == len(master) and bool(len(slave)) == bool(couples)


class Limited(fm.Coulomb):
    """Its friction limit is 7 stresses, in both methods that give one."""

    def friction_limit(self, pressure):
        return np.full_like(pressure, 7.0)


class LimitedAnew(Limited):
    def limit(self, node):
        return np.full_like(node.z_n, 5.0), 0.0, 0.0


@pytest.mark.parametrize("kind, limit", [(fm.Coulomb, 0.6), (Limited, 7.0), (LimitedAnew, 5.0)])
def test_friction_limit_is_that_of_the_most_derived_class(kind, limit):
    numbers = np.zeros(3)
    node = Nodal(numbers, numbers, numbers + 2.0, numbers, numbers + 1.0, numbers + 1.0)
    assert np.array_equal(kind(0.3).friction_limit_at(node), np.full(3, limit))
