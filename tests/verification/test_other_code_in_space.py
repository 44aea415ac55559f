# SPDX-License-Identifier: MIT
"""Regression cases in space of another code, 4C: displacements of a node after twenty steps.

The numbers are those of its input files tests/input_files/contact3D_slidingblock_duallagr.dat and
contact3D_slidingblock_coulomb.dat (of 2025).
"""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_boxes import Box, block, mesh

pytestmark = pytest.mark.serial


def bodies(boxes, E, nu):
    """Mesh, displacement and test function; residual of St. Venant-Kirchhoff's law."""
    data = mesh(boxes)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    energy = fm.energies.st_venant_kirchhoff(u, *fm.energies.lame(E, nu)) * dx
    return data, u, v, ufl.derivative(energy, u, v)


def in_contact(data, residual, u, moved, law=None):
    """Problem of these bodies; ``moved``: prescribed displacements by the names of sides."""
    V, options = u.function_space, {"law": law, "discretization": "other_codes"}
    return fm.ContactProblem(
        residual, u, [fm.ContactPair(data, "upper/bottom", "lower/top", **options)],
        bcs=[fm.dirichlet(V, data, side, value) for side, value in moved.items()],
        petsc_options_prefix="other_code_", newton=fm.NewtonOptions(residual_tolerance=1e-13),
    )  # fmt: skip


def test_a_block_slides_over_the_edge_of_another_one():
    """Statics without friction; in the end slave facets are partly covered."""
    lower = Box("lower", block((3, 3, 3), corner=(-0.5, -0.5, -0.5)))
    upper = Box("upper", block((2, 2, 2), corner=(-0.5, -0.5, 0.5)))
    data, u, _, residual = bodies([lower, upper], 2250.0, 0.3)
    top = fem.Constant(data.mesh, np.zeros(3))
    problem = in_contact(data, residual, u, {"lower/bottom": np.zeros(3), "upper/top": top})
    for t in np.linspace(0.05, 1.0, 20):
        along, down = np.interp(t, [0.1, 1.0], [0.0, 0.6]), np.interp(t, [0.0, 0.1], [0.0, 0.05])
        top.value[:] = along, 0.0, -down
        assert problem.solve().num_iterations <= 4
    node = lower.numbers().size + upper.numbers()[-1, -1, 0]
    expected = 5.84941381185625109e-01, -9.50754912838651942e-04, -5.46898606858939457e-02
    assert np.abs(data.nodal_values(u, [node])[0] - expected).max() < 1e-12


@pytest.mark.once
def test_a_block_without_supports_sticks_and_slides():
    """Trapezoidal rule and Coulomb's friction; the block is pushed along both axes."""
    low, high = (
        np.array([6.99999988e-01, 8.00000012e-01, 0.0]),
        np.array([1.70000005, 1.79999995, 1.0]),
    )
    lower = Box("lower", block((10, 10, 1), size=(10.0, 10.0, 0.5), corner=(0.0, 0.0, -0.5)))
    upper = Box("upper", block((1, 1, 1), size=high - low, corner=low))
    data, u, v, residual = bodies([lower, upper], 1e6, 0.0)
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags)
    left, front, top = (ds(data.boundaries[f"upper/{side}"]) for side in ("left", "front", "top"))
    push, weight = fem.Constant(data.mesh, 0.0), fem.Constant(data.mesh, 0.0)
    residual -= push * (v[0] * left + v[1] * front) - weight * v[2] * top
    problem = in_contact(data, residual, u, {"lower/bottom": np.zeros(3)}, fm.Coulomb(0.1))
    motion = fm.Dynamics(problem, density=1.0, scheme="generalized_alpha", rho_inf=1.0)

    def set_loads(t):
        weight.value, push.value = 10.0 * min(t, 1.0), max(t - 1.0, 0.0)

    motion.run(2.0, fm.SteppingOptions(step=0.1), set_loads)
    node = lower.numbers().size + upper.numbers()[0, -1, -1]
    displacement, velocity = (data.nodal_values(f, [node])[0, :2] for f in (u, motion.velocity))
    expected = 4.5234589836608396e-03, 4.5227405266592543e-03
    assert np.abs(displacement - expected).max() < 1e-11
    # velocities are differences of displacements over half a step, those of a tolerance of 1e-7
    expected = 4.3231966810024856e-02, 4.3231449937417551e-02
    assert np.abs(velocity - expected).max() < 2e-10
