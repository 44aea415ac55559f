# SPDX-License-Identifier: MIT
"""Derivatives of solutions: Taylor remainders of slope 2, adjoint against tangent-linear."""

import pytest
from taylor_scenes import SLIDE, blocks, check

import ufl

import fenics_mortar as fm

LAWS = {
    "none": fm.Frictionless,
    "Tresca": lambda: fm.Tresca(1.0),
    "Coulomb": lambda: fm.Coulomb(0.3),
}
CONTROLS = (["E", "load", "push"], [30.0, 3.0, 0.02])


def work(scene):
    u = scene.u
    return (ufl.inner(u, u) + 0.1 * u[0] + 0.01 * scene.controls["E"] * u[1]) * ufl.dx


@pytest.mark.parametrize("law", LAWS)
def test_single_step(law):
    scene = blocks(LAWS[law]())
    check(scene, work(scene), *CONTROLS)


@pytest.mark.parametrize("law", LAWS)
def test_sliding_path(law):
    scene = blocks(LAWS[law](), pushes=SLIDE)
    check(scene, work(scene), *CONTROLS)
