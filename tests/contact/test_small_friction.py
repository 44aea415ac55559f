# SPDX-License-Identifier: MIT
"""Friction so small that errors of the traction after convergence exceed it."""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh


@pytest.mark.parametrize("mu", [1e-5, 1e-9])
def test_repeated_steps_settle_at_once(mu):
    """A node that slides stays so while its shear is at the limit within errors of the traction."""
    upper = Grid("upper", block(7, 5, width=1.0, height=0.5, corner=(0.6, 1.0)))
    data = mesh([upper, Grid("lower", block(20, 8, width=2.2, height=1.0))])
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    psi = fm.energies.neo_hookean(u, *fm.energies.lame(100.0, 0.3))
    residual = ufl.derivative(psi * ufl.dx(degree=3), u)
    bcs = [fm.dirichlet(V, data, "lower/bottom", np.zeros(2))]
    bcs += [fm.dirichlet(V, data, "upper/top", push)]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(mu))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="small_")
    iterations = []
    for push.value[:] in [(0.0, -0.05), (0.0, -0.05), (0.1, -0.05), (0.1, -0.05)]:
        iterations.append(problem.solve().num_iterations)
    assert iterations[1] == iterations[3] == 1
