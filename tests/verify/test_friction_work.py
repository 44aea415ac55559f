# SPDX-License-Identifier: MIT
"""Work of friction by slip and by motions, where nothing moves but for rounding."""

import numpy as np
from scenes import TIGHT, internal, linear_elastic

from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid, sector


def test_sticking_to_an_obstacle_at_rest_is_no_difference():
    """Nodes that stick move by rounding alone, as the slip: their ratio is no number."""
    arc = sector(12, 3, radii=(0.2, 0.5), angles=(1.1 * np.pi, 1.9 * np.pi))
    data = mapped_grids.mesh([Grid("tread", arc)])
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    ground = fm.Plane((-0.5, -0.5), (0.0, 1.0), name="ground")
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "tread/bottom", ground, law=fm.Coulomb(0.9))],
        bcs=[fm.dirichlet(V, data, "tread/top", push)], petsc_options_prefix="tread_", newton=TIGHT,
    )  # fmt: skip
    for depth in (0.03, 0.032, 0.034):
        push.value[1] = -depth
        certificate = problem.solve().certificate
        assert certificate.pairs[0]["friction_work"].value < 1e-3
    contact = problem.equations.contacts[0]
    assert contact.active.sum() == 3 and abs(contact.z_tau).max() > 0.01
    assert abs(contact.slip[contact.active]).max() < 1e-12
