# SPDX-License-Identifier: MIT
"""Regression cases in space of another code, 4C: displacements of a node after 20 or 30 steps.

The numbers are those of its input files tests/input_files/contact3D_slidingblock_duallagr.dat,
contact3D_slidingblock_coulomb.dat, contact3D_lin_duallagr.dat, contact3D_lin_stdlagr.dat,
meshtying3D_structure_stdlagr.dat, meshtying3D_structure_stdlagr_meshrelocation_no.dat and
meshtying3D_structure_quad_const.dat (of 2025).
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


# Upper and lower body of the warped tie: cells along each edge, places of the nodes on the surface
# and of those one layer behind, by the numbers of nodes from the middle; float32 in the source.
WARPED = {
    "low": (
        5, -10.0,
        {
            (0, 0): (1.03949356, 1.03949356, 0.891355097),
            (1, 0): (3.07911992, 1.04742837, 0.456316084),
            (1, 1): (3.09480667, 3.09480667, -0.00865180418),
            (2, 0): (5.0, 1.06335199, -0.405275881),
            (2, 1): (5.0, 3.12593055, -0.923580110),
            (2, 2): (5.0, 5.0, -1.92893219),
        },
        {
            (0, 0): (1.04113817, 1.04113817, -1.19610584),
            (1, 0): (3.08202028, 1.04431212, -1.57744312),
            (1, 1): (3.08829498, 3.08829498, -1.97075188),
            (2, 0): (5.0, 1.05068159, -2.32422066),
            (2, 1): (5.0, 3.10074449, -2.73886418),
            (2, 2): (5.0, 5.0, -3.54314566),
        },
    ),
    "high": (
        6, 10.0,
        {
            (0, 0): (0.0, 0.0, 1.0),
            (1, 0): (1.72611046, 0.0, 0.849900663),
            (1, 1): (1.73034966, 1.73034966, 0.695967197),
            (2, 0): (3.40778589, 0.0, 0.401435792),
            (2, 1): (3.41303968, 1.74307489, 0.236495540),
            (2, 2): (3.42872405, 3.42872405, -0.254275143),
            (3, 0): (5.0, 0.0, -0.339745969),
            (3, 1): (5.0, 1.76429915, -0.521365166),
            (3, 2): (5.0, 3.45459795, -1.05860507),
            (3, 3): (5.0, 5.0, -1.92893219),
        },
        {
            (0, 0): (0.0, 0.0, 2.60393333),
            (1, 0): (1.73211503, 0.0, 2.46571732),
            (1, 1): (1.73388147, 1.73388147, 2.32590389),
            (2, 0): (3.41488218, 0.0, 2.05500698),
            (2, 1): (3.41707134, 1.73918366, 1.91060734),
            (2, 2): (3.42360640, 3.42360640, 1.48226953),
            (3, 0): (5.0, 0.0, 1.38354504),
            (3, 1): (5.0, 1.74802709, 1.23219573),
            (3, 2): (5.0, 3.43438721, 0.784495771),
            (3, 3): (5.0, 5.0, 0.0592231750),
        },
    ),
}  # fmt: skip


def warped(name):
    """A body between a plane and the warped surface; layers but the last have equal heights."""
    n, height, *layers = WARPED[name]
    i, j = np.meshgrid(np.arange(n + 1) - 0.5 * n, np.arange(n + 1) - 0.5 * n, indexing="ij")
    a, b = np.abs(i).astype(int), np.abs(j).astype(int)
    low, high = np.minimum(a, b), np.maximum(a, b)
    on, behind = (
        np.array(
            [[table[k] for k in zip(*row, strict=True)] for row in zip(high, low, strict=True)]
        )
        for table in layers
    )
    for x in (on, behind):
        x[a < b, :2] = x[a < b, 1::-1]
        x[..., 0] *= np.sign(i)
        x[..., 1] *= np.sign(j)
    flat = np.stack([10.0 / n * i, 10.0 / n * j, np.full(i.shape, height)], axis=2)
    x = [flat + (behind - flat) * t for t in np.linspace(0.0, 1.0, n)] + [on]
    return Box(name, np.stack(x if height < 0.0 else x[::-1], axis=2))


# Last displacement of the prescribed side, and those of two nodes, by the treatment of gaps.
PULLED = {
    "removed": (
        (2.0, 2.0, 2.0),
        (3.92176628029872298e-01, 7.01434329653051192e-01, 6.63600533116916913e-01),
        (8.97800845002964643e-01, 7.78867675435034879e-01, 4.94154829059914757e-01),
    ),
    "kept": (
        (6.0, 6.0, 3.0),
        (1.43804600207093625, 2.00367638932147862, 1.09124537963873025),
        (2.65221247746680389, 2.43286724284057465, 2.01704383584107028e-01),
    ),
}


@pytest.mark.parametrize("gap", PULLED)
def test_two_blocks_tied_by_a_warped_surface_are_pulled_apart(gap):
    """Standard multipliers; facets of five cells on those of six, whose shapes do not fit."""
    data = mesh([warped("low"), warped("high")])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    mu, _ = fm.energies.lame(10.0, 0.3)
    beta, F = 0.3 / (1.0 - 2.0 * 0.3), ufl.Identity(3) + ufl.grad(u)
    volumetric = (ufl.det(F) ** (-2.0 * beta) - 1.0) / beta
    energy = mu / 2.0 * (ufl.inner(F, F) - 3.0 + volumetric)
    top, (pull, *expected) = fem.Constant(data.mesh, np.zeros(3)), PULLED[gap]
    tie = fm.TiedPair(
        data, "low/top", "high/bottom", gap=gap, discretization=fm.Discretization("standard")
    )
    problem = fm.ContactProblem(
        ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 3}), u, v), u, [tie],
        bcs=[
            fm.dirichlet(V, data, "low/bottom", np.zeros(3)),
            fm.dirichlet(V, data, "high/top", top),
        ],
        petsc_options_prefix="other_code_", newton=fm.NewtonOptions(residual_tolerance=1e-13),
    )  # fmt: skip
    for t in np.linspace(0.25, 1.0, 4):
        top.value[:] = t * np.array(pull)
        problem.solve()
    numbers = warped("low").numbers()
    found = data.nodal_values(u, [numbers[5, 0, 4], numbers[3, 5, 5]])
    # inner nodes of the source are rounded to seven digits
    assert np.abs(found - expected).max() < 2e-9


def test_tied_blocks_of_quadratic_hexahedra():
    """Dual multipliers at nine nodes; the tolerance of the other code is 1e-8."""
    lower = Box("lower", block((3, 3, 3), corner=(0.5, 0.5, -0.5), order=2))
    upper = Box("upper", block((2, 2, 2), corner=(0.5, 0.5, 0.5), order=2))
    data = mesh([lower, upper], order=2)
    V = fm.vector_space(data.mesh, 2)
    u = fem.Function(V)
    energy = fm.energies.st_venant_kirchhoff(u, *fm.energies.lame(4e4, 0.3))
    dx = ufl.dx(metadata={"quadrature_degree": 5})
    push = np.array([0.2, 0.3, -0.3])
    problem = fm.ContactProblem(
        ufl.derivative(energy * dx, u, ufl.TestFunction(V)), u,
        [fm.TiedPair(data, "upper/bottom", "lower/top")],
        bcs=[
            fm.dirichlet(V, data, "lower/bottom", np.zeros(3)),
            fm.dirichlet(V, data, "upper/top", push),
        ],
        petsc_options_prefix="other_code_",
    )  # fmt: skip
    problem.solve()
    node = lower.numbers().size + upper.numbers()[1, 3, 0]
    expected = 9.24386659442858749e-02, 1.59350586404330058e-01, -1.64982108327472510e-01
    assert np.abs(data.nodal_values(u, [node])[0] - expected).max() < 2e-8
