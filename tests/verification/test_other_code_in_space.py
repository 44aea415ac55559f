# SPDX-License-Identifier: MIT
"""Regression cases in space of another code, 4C: displacements of a node after 20 or 30 steps.

The numbers are those of its input files tests/input_files/contact3D_slidingblock_duallagr.dat,
contact3D_slidingblock_coulomb.dat, contact3D_lin_duallagr.dat and contact3D_lin_stdlagr.dat (of
2025).
"""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_boxes import Box, block, mapped, mesh

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


# Displacement of a corner of the contact surface by the basis of the multipliers
PRESSED = {
    "dual": (2.01564729179116331e-01, 1.97016859285391449e-01, -9.76543776127697827e-01),
    "standard": (2.01566212937940359e-01, 1.97045747225171292e-01, -9.76566415201195248e-01),
}


@pytest.mark.parametrize("basis", PRESSED)
def test_a_damped_block_is_pressed_in_and_shifted(basis):
    """Trapezoidal rule; the motion of its top starts and ends at once, its rates alternate then."""
    half, corner = 1.999999911791123, np.array([-2.33029e-01, -7.0922e-01, 1.05])
    along, across = np.array([[0.942249, 0.476191, 0.0], [-0.476191, 0.942249, 0.0]])
    up = np.array([0.0, 0.0, 2.135242490542307 - 1.05])

    def turned(s, t, r):
        return [c + s * a + t * b + r * h for c, a, b, h in zip(corner, along, across, up)]

    counts, size = (8, 8, 2), (2.0 * half, 2.0 * half, 1.0)
    lower = Box("lower", block(counts, size=size, corner=(-half, -half, 0.0)))
    upper = Box("upper", mapped((1, 1, 1), turned))
    data = mesh([lower, upper])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    rate, dx = fm.Velocity(u), ufl.dx(metadata={"quadrature_degree": 3})
    stiffness = fem.Function(fm.scalar_space(data.mesh, 0, "DG"))
    for name, E in (("lower", 210.0), ("upper", 2100.0)):
        stiffness.x.array[data.cell_tags.find(data.body_tag(name))] = E
    mu, lmbda = fm.energies.lame(stiffness, 0.3)
    beta, F = 0.3 / (1.0 - 2.0 * 0.3), ufl.Identity(3) + ufl.grad(u)
    volumetric = (ufl.det(F) ** (-2.0 * beta) - 1.0) / beta
    residual = ufl.derivative(mu / 2.0 * (ufl.inner(F, F) - 3.0 + volumetric) * dx, u, v)
    # Rayleigh's damping
    density, strain = 7.8e-6, ufl.sym(ufl.grad(rate.expression))
    stress = 2.0 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(3)
    residual += 1e-5 * density * ufl.inner(rate.expression, v) * dx
    residual += 1e-5 * ufl.inner(stress, ufl.grad(v)) * dx

    def on_bottom_edges(x):
        beside = np.isclose(np.abs(x[:2]), half).any(axis=0)
        return np.isclose(x[2], 0.0) & beside

    top = fem.Constant(data.mesh, np.zeros(3))
    held = fem.dirichletbc(fem.Function(V), fem.locate_dofs_geometrical(V, on_bottom_edges))
    choices = fm.Discretization(basis, normals="unit", gap_weights="basis", slip="operators")
    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, "upper/bottom", "lower/top", discretization=choices)],
        bcs=[held, fm.dirichlet(V, data, "upper/top", top)],
        petsc_options_prefix="other_code_", newton=fm.NewtonOptions(residual_tolerance=1e-13),
    )  # fmt: skip
    motion = fm.Dynamics(problem, density, scheme="generalized_alpha", rho_inf=1.0, velocity=rate)
    facets = data.facet_tags.find(data.boundaries["upper/top"])
    dofs = fem.locate_dofs_topological(V, 2, facets)
    motion.velocity.x.array.reshape(-1, 3)[dofs, 2] = -2.0

    def set_loads(t):
        shift = np.interp(t, [0.5, 0.6], [0.0, 0.2])
        top.value[:] = shift, shift, -min(2.0 * t, 1.0)

    motion.run(0.6, fm.SteppingOptions(step=0.02), set_loads)
    node = lower.numbers().size + upper.numbers()[0, 0, 0]
    # the other code's iterations stop at 1e-8
    assert np.abs(data.nodal_values(u, [node])[0] - PRESSED[basis]).max() < 1e-9
