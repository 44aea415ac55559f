# SPDX-License-Identifier: MIT
"""Shallow ironing: forces between published curves, and order of convergence on three meshes."""

import pytest

import fenics_mortar as fm
from demos.studies.accuracy import ironing

pytestmark = pytest.mark.serial


def test_order_of_convergence_follows_from_three_errors():
    for order in (1.0, 2.0, 2.5):
        coarse, middle, finest = (0.3 * n**-order for n in (10, 20, 40))
        assert ironing.rate(coarse - finest, middle - finest) == pytest.approx(order)


@pytest.mark.once
def test_force_pressed_in_with_friction_lies_between_published_ones():
    found, _ = ironing.forces("P2", 40, (0.5, 1.0), fm.Coulomb(ironing.FRICTION), 0.05)
    (_, early), (along, up) = found
    for name, force in (("V(0.5)", early), ("V(1)", up), ("H(1)", -along)):
        least, most = ironing.BAND[name]
        assert least <= force <= most, (name, force)
