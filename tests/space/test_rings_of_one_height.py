# SPDX-License-Identifier: MIT
"""A ring pressed into another one of the same height: edges of nine-node facets coincide."""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_boxes import Box, mapped, mesh


@pytest.mark.parametrize("noise", [0.0, 1e-11])
def test_newton_reaches_rounding_where_edges_coincide(noise):
    """Labels of the clipped facets change by rounding, quadrature points do not.

    Nor do they where coordinates of the mesh are rounded.
    """

    def ring(inner, outer, count, turn):
        def position(s, t, z):
            angle, r = 2.0 * np.pi * s + turn, inner + (outer - inner) * t
            height = 0.5 * z + noise * np.sin(1e4 * (angle + 3.0 * r + 7.0 * z))
            return r * np.cos(angle), r * np.sin(angle), height

        return mapped((count, 2, 1), position, order=2)

    rings = {"hub": ring(1.0, 1.5, 16, 0.0), "rim": ring(1.5, 2.0, 20, 0.05)}
    data = mesh([Box(name, x, closed=True) for name, x in rings.items()], order=2)
    V = fm.vector_space(data.mesh, 2)
    u = fem.Function(V)
    psi = fm.energies.linear_elastic(u, *fm.energies.lame(100.0, 0.3)) * ufl.dx(degree=4)
    ends = [f"{name}/{side}" for name in rings for side in ("bottom", "top")]
    held = [("hub/front", i) for i in range(3)] + [("rim/back", i) for i in range(3)]
    bcs = [fm.dirichlet(V, data, side, 0.0, i) for side, i in [*held, (ends, 2)]]
    pair = fm.ContactPair(data, "hub/back", "rim/front", initial_gap=-0.01)
    problem = fm.ContactProblem(
        ufl.derivative(psi, u), u, [pair], bcs=bcs, petsc_options_prefix="rings_"
    )
    assert problem.solve().num_iterations <= 4
