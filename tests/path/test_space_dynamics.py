# SPDX-License-Identifier: MIT
"""Time steps of solids in contact: impact of two free blocks, momentum, tangent."""

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes.mapped_boxes import Box, block, mesh


def flying(cell, mu):
    """Two free blocks, one turned, that fly towards each other; the upper one also sideways."""
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    upper = block((2, 2, 2), size=(1.0, 1.0, 0.6), corner=(-0.5, -0.5, 0.02)) @ turn
    lower = block((3, 3, 2), size=(1.4, 1.4, 0.6), corner=(-0.7, -0.6, -0.6))
    data = mesh([Box("upper", upper), Box("lower", lower)], cell=cell, comm=MPI.COMM_WORLD)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    psi = energies.neo_hookean(u, *energies.lame(100.0, 0.3))
    residual = ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 3}), u, v)
    law = fm.Coulomb(mu) if mu else None
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=law)
    problem = fm.ContactProblem(residual, u, [pair], petsc_options_prefix="flying_")
    motion = fm.Dynamics(problem, density=1.0, scheme="generalized_alpha")
    for body, speed in (("upper", (0.4, 0.1, -1.0)), ("lower", (0.0, 0.0, 0.5))):
        cells = data.cell_tags.find(data.bodies[body])
        motion.velocity.interpolate(
            lambda x, speed=speed: np.outer(speed, np.ones_like(x[0])), cells
        )
    return problem, motion


@pytest.mark.parametrize(("cell", "mu"), [("hexahedron", 0.0), ("tetrahedron", 0.3)])
def test_an_impact_conserves_momentum(cell, mu):
    """Linear momentum to rounding; the angular one by the size of the steps, in all axes."""
    problem, motion = flying(cell, mu)
    before = motion.momentum()
    record = motion.run(0.12, fm.SteppingOptions(step=0.02))
    after = motion.momentum()
    assert before.shape == (6,)
    assert max(step.report.num_iterations for step in record.steps) <= 12
    assert any(contact.active.any() for contact in problem.contacts)
    size = np.abs(before[:3]).max()
    np.testing.assert_allclose(after[:3], before[:3], atol=1e-10 * size)
    np.testing.assert_allclose(after[3:], before[3:], atol=1e-2 * size)


def test_schemes_without_mass_are_refused():
    problem, _ = flying("hexahedron", 0.0)
    with pytest.raises(NotImplementedError, match="generalized_alpha"):
        fm.Dynamics(problem, density=1.0)
