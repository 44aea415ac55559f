# SPDX-License-Identifier: MIT
"""Bodies of very different stiffness: solved as accurately as rounding admits, and checked so."""

import numpy as np
import pytest
from scenes import neo_hookean
from small_scenes import small_blocks
from space_pair_scenes import two_blocks

import ufl

import fenics_mortar as fm
from fenics_mortar import energies

# Stiffness of the upper block over that of the lower one.
RATIOS = [1e-14, 1e-10, 1e-5, 1e5, 1e10, 1e14]


def factor_of(ratio):
    """The factor of the stiffness as a function of the displacement, for its mesh."""

    def factor(u):
        x = ufl.SpatialCoordinate(u.function_space.mesh)
        return ufl.conditional(x[u.function_space.mesh.geometry.dim - 1] > 1.0, ratio, 1.0)

    return factor


def in_the_plane(ratio, slave, degree=1, law=None):
    """Forces of contact and support over the softer stiffness, and the problem."""
    factor = factor_of(ratio)
    scene = small_blocks(
        material=lambda u, *data: factor(u) * neo_hookean(u, *data), slave=slave, degree=degree,
        pair={"law": law} if law else None, problem={"newton": fm.NewtonOptions()},
    )  # fmt: skip
    scene.loads["push"].value[:] = 0.01, -0.02
    return measured(scene, min(ratio, 1.0), {"upper": -1.0, "lower": 1.0}[slave])


def in_space(ratio, slave, **options):
    factor = factor_of(ratio)
    sides = ["upper/bottom", "lower/top"]
    scene = two_blocks(
        pairs=[tuple(sides if slave == "upper" else sides[::-1])],
        energy=lambda u, *data: factor(u) * energies.neo_hookean(u, *data), **options,
    )  # fmt: skip
    scene.move("upper/top", (0.01, 0.0, -0.02))
    return measured(scene, min(ratio, 1.0), {"upper": -1.0, "lower": 1.0}[slave])


def measured(scene, unit, sign):
    report = scene.problem.solve()
    assert not report.certificate.violations()
    pair, support = scene.problem.contacts[0], scene.problem.reaction("lower/bottom")
    return sign * pair.total_force / unit, support.force / unit, scene


@pytest.mark.once
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("degree", [1, 2])
def test_forces_beside_a_much_stiffer_body_are_those_of_the_softer_one(ratio, degree):
    """Above a ratio of 1e5 the softer body touches a rigid one; it is the slave."""
    slave, nearly_rigid = ("upper", 1e-6) if ratio < 1.0 else ("lower", 1e6)
    expected, _, _ = in_the_plane(nearly_rigid, slave, degree)
    force, _, _ = in_the_plane(ratio, slave, degree)
    assert np.abs(force - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("ratio", [1e-10, 1e10])
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("degree", [1, 2])
def test_roles_and_friction_beside_a_much_stiffer_body(ratio, slave, degree):
    nearly_rigid = 1e5 ** np.sign(np.log(ratio))
    expected, _, _ = in_the_plane(nearly_rigid, slave, degree, fm.Coulomb(0.2))
    force, _, _ = in_the_plane(ratio, slave, degree, fm.Coulomb(0.2))
    assert np.abs(force - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.mark.parametrize("ratio", [1e-10, 1e10])
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_roles_beside_a_much_stiffer_body_in_space(ratio, slave):
    expected, _, _ = in_space(1e5 ** np.sign(np.log(ratio)), slave)
    force, _, _ = in_space(ratio, slave)
    assert np.abs(force - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.mark.parametrize("ratio", [1e-10, 1.0, 1e10])
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_wrong_contact_forces_beside_a_stiffer_body_are_refused(ratio, slave):
    """By a thousandth: on the soft body they are out of balance."""
    _, _, scene = in_the_plane(ratio, slave)
    scene.contact.change(z=1.001 * scene.contact.z)
    assert any("balance" in text for text in scene.problem.certificate().violations())


@pytest.mark.parametrize(("ratio", "rounded"), [(1e-14, 1), (1e-9, 0), (1e9, 0), (1e14, 1)])
def test_reactions_of_a_body_so_stiff_that_they_are_rounding_are_a_remark(ratio, rounded):
    _, _, scene = in_the_plane(ratio, "upper")
    found = scene.problem.certificate().rounded
    assert len(found) == rounded
    assert all(f"body '{'upper' if ratio > 1.0 else 'lower'}'" in text for text in found)


def test_rounding_of_a_stiff_body_that_touches_nothing_is_no_remark():
    _, _, scene = in_the_plane(1e14, "upper")
    scene.loads["push"].value[:] = (0.0, 0.5)
    assert scene.problem.solve().certificate.rounded == []
