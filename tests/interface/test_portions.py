# SPDX-License-Identifier: MIT
"""Slave facets that face two portions of a master, one far behind the other."""

import numpy as np
import pytest
from scenes import internal, neo_hookean

from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid, mapped


def hook_and_catch(shift, far):
    """A catch, the slave, with the hook of a beam above its corner.

    Args:
        shift: Position of the beam's end along x, from that of the catch's upright side.
        far: Factor of all lengths.
    """

    def beam(s, t):
        hook = 0.08 * np.clip((s - 0.8) / 0.1, 0, 1) * np.clip((1.0 - s) / 0.06, 0, 1)
        return far * (s + 0.1 + shift), far * (0.06 * t - (1 - t) * hook)

    def catch(s, t):
        bump = 0.08 * np.exp(-(((s - 0.4) / 0.18) ** 2))
        return far * (1.1 + 0.5 * s), far * (t * (0.43 + bump) - 0.5)

    data = mapped_grids.mesh(
        [Grid("beam", mapped(24, 2, beam)), Grid("catch", mapped(16, 4, catch))]
    )
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("beam/left", "catch/bottom")]
    slave = [f"catch/{side}" for side in ("top", "left", "right")]
    master = [f"beam/{side}" for side in ("bottom", "right", "top")]
    pair = fm.ContactPair(data, slave, master)
    stress = neo_hookean(u, 1e3, 0.3)
    return fm.ContactProblem(internal(u, stress), u, [pair], bcs=bcs, petsc_options_prefix="test_")


@pytest.mark.parametrize("far", [1.0, 1e-6])
@pytest.mark.parametrize("shift", [0.0101, 0.02])
def test_far_portion_of_the_master_gives_no_pressure(shift, far):
    """The hook is 0.3 facets above the corner, the beam's lower side two facets farther."""
    problem = hook_and_catch(shift, far)
    contact = problem.equations.contacts[0]
    assert contact.covered.any() and (contact.gap[contact.covered] > 0.0).all()
    report = problem.solve()
    assert not contact.active.any() and report.certificate.violations() == []
