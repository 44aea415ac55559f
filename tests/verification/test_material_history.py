# SPDX-License-Identifier: MIT
"""Bodies with history under contact against exact solutions of plasticity and viscoelasticity."""

from functools import partial

import numpy as np
import pytest
from history_scenes import Block, in_space, plastic, relaxed, viscous

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, arrays, block, mesh, sector

# Shear stress at which bodies yield, perfectly plastic.
K = 1.0
YIELD = {"sigma_y": np.sqrt(3.0) * K, "H": 0.0}


def problem_of(data, pair, law, bcs):
    """Problem of one perfectly plastic body of order 2, with two Gauss points in each direction."""
    V = fm.vector_space(data.mesh, 2)
    u, v = fem.Function(V), ufl.TestFunction(V)
    material = law(u, 2)
    residual = ufl.inner(material.stress, in_space(fm.energies.strain(v))) * ufl.dx(degree=2)
    return fm.ContactProblem(
        residual, u, [pair], bcs=[fm.dirichlet(V, data, *bc) for bc in bcs],
        history=material.history, petsc_options_prefix="yielding_",
    )  # fmt: skip


# Thick ring


def pressures_in_ring(columns, rows, fronts, a=1.0, b=2.0, E=200.0, nu=0.4999):
    """Mean pressures of a rigid disk that grows in a quarter of a ring until it yields to fronts.

    Without compression the displacement is K c^2 / (2 G r), with the front of yielding at c.
    """
    x = sector(2 * columns, 2 * rows, radii=(a, b), angles=(0.0, np.pi / 2))
    data = mesh([Grid("ring", x)], order=2)
    disk = fm.Circle((0.0, 0.0), a)
    bcs = [("ring/left", 0.0, 1), ("ring/right", 0.0, 0)]
    law = partial(plastic, E=E, nu=nu, **YIELD)
    problem = problem_of(data, fm.ContactPair(data, "ring/top", disk), law, bcs)
    found, before = [], 0.5
    for front in fronts:
        for c in np.linspace(before, front, 5)[1:]:  # small steps: the ring yields far
            disk.set_shape("radius", a + K * c**2 * (1.0 + nu) / (E * a))
            problem.solve()
        before = front
        found.append(float(np.hypot(*problem.contacts[0].total_force)) / (np.sqrt(2.0) * a))
    return np.array(found)


@pytest.mark.once
def test_pressure_in_a_thick_ring_is_that_of_hill():
    """Hill, The Mathematical Theory of Plasticity (1950), chapter V, without hardening.

    The error is that of the front within a cell; that of nu = 0.4999 instead of 1/2, and of eight
    columns, is 1.5e-4.
    """
    fronts = np.array([1.0, 1.2, 1.4, 1.6, 1.8])
    exact = K * (2.0 * np.log(fronts) + 1.0 - fronts**2 / 4.0)
    errors = [np.abs(pressures_in_ring(8, n, fronts) / exact - 1.0).max() for n in (4, 16)]
    assert errors[1] < 0.25 * errors[0] and errors[1] < 3e-4


def ring_by_traction(columns, rows, a, b, E=500.0, nu=0.4995):
    """A quarter of a ring with a traction on its bore, of displacement and mean stress.

    Returns:
        The problem, the traction, and functions of positions and stresses at all points.
    """
    x = sector(2 * columns, 2 * rows, radii=(a, b), angles=(0.0, np.pi / 2))
    data = mesh([Grid("ring", x)], order=2)
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w, (v, q) = fem.Function(W), ufl.TestFunctions(W)
    u, p = ufl.split(w)
    law = plastic(u, 4, mesh=data.mesh, E=E, nu=nu, **YIELD)
    stress = ufl.dev(law.stress) + p * ufl.Identity(3)
    where, kept = (fm.quadrature_function(data.mesh, 4, shape) for shape in ((2,), (3, 3)))
    traction, modulus = fem.Constant(data.mesh, 0.0), E / 3.0 / (1.0 - 2.0 * nu)
    ds = ufl.Measure("ds", domain=data.mesh, subdomain_data=data.facet_tags)
    residual = ufl.inner(stress, in_space(fm.energies.strain(v))) * ufl.dx(degree=4)
    residual += (ufl.div(u) - p / modulus) * q * ufl.dx(degree=4)
    bore = ds(data.boundary_tags("ring/top")[0], degree=4)
    residual += traction * ufl.inner(ufl.FacetNormal(data.mesh), v) * bore
    history = [*law.history, (where, ufl.SpatialCoordinate(data.mesh) + 0 * u), (kept, stress)]
    sides = [("ring/left", 0.0, 1), ("ring/right", 0.0, 0)]
    bcs = [fm.dirichlet(W.sub(0), data, *side) for side in sides]
    problem = fm.ContactProblem(
        residual, w, [], bcs=bcs, history=history, petsc_options_prefix="traction_"
    )
    return problem, traction, where, kept


def test_stresses_in_a_thick_ring_and_after_unloading():
    """Hill's stresses, and after an elastic unloading these minus Lame's.

    Unloading starts from stresses on the yield surface: if their rounding made points plastic in
    the first tangent, a perfectly plastic ring would not converge.
    """
    a, b, front = 1.3, 3.1, 2.2
    problem, traction, where, kept = ring_by_traction(6, 8, a, b)

    def pressure(c):
        return K * (2.0 * np.log(c / a) + 1.0 - c**2 / b**2)

    def error(unloaded):
        x, stress = where.x.array.reshape(-1, 2), kept.x.array.reshape(-1, 3, 3)[:, :2, :2]
        r = np.linalg.norm(x, axis=1)
        radial = np.einsum("ni,nij,nj->n", x, stress, x) / r**2
        both = np.stack([radial, np.trace(stress, axis1=1, axis2=2) - radial])
        sign = np.array([[-1.0], [1.0]])
        inside = K * (sign + front**2 / b**2 - 2.0 * np.log(front / r))
        outside = K * front**2 / b**2 * (1.0 + sign * b**2 / r**2)
        lame = unloaded * a**2 / (b**2 - a**2) * (1.0 + sign * b**2 / r**2)
        away = np.abs(r - front) > 0.15
        return np.abs(both - np.where(r < front, inside, outside) + lame)[:, away].max(initial=0.0)

    for c in np.linspace(0.9 * a, front, 12):
        traction.value = pressure(c)
        problem.solve()
    assert error(0.0) < 0.005 * K
    traction.value = 0.0
    assert problem.solve().num_iterations <= 2
    assert error(pressure(front)) < 0.015 * K


# Flat punch


def punched(n, depth, E=1e3, size=5.0):
    """Mean pressures under a flat rigid punch of the half-width 1 on half of a block, by depth.

    The punch is a plane that touches the part of the top within its width only. Cells are small at
    its edge, where the velocity jumps.
    """
    inside, outside = (np.linspace(0.0, 1.0, count + 1) ** 1.6 for count in (n, n + n // 2))
    x = np.append(1.0 - inside[::-1], 1.0 + (size - 1.0) * outside[1:])
    y = -0.8 * size * np.linspace(1.0, 0.0, 2 * n + 1) ** 1.5
    x, y = (np.interp(np.arange(2 * len(v) - 1) / 2, np.arange(len(v)), v) for v in (x, y))
    made = arrays([Grid("block", np.dstack(np.meshgrid(x, y, indexing="ij")))], order=2)
    top = made["boundaries"].pop("block/top")
    within = made["points"][top][:, :, 0].max(axis=1) < 1.0 + 1e-9
    made["boundaries"]["block/punched"] = top[within]
    data = fm.mesh_from_arrays(**made)
    punch = fm.Plane((0.0, 0.0), (0.0, -1.0))
    pair = fm.ContactPair(data, "block/punched", punch)
    sides = [("block/left", 0.0, 0), ("block/right", 0.0, 0), ("block/bottom", (0.0, 0.0))]
    problem = problem_of(data, pair, partial(plastic, E=E, nu=0.3, **YIELD), sides)
    found = []

    def record(time, report):
        found.append(-problem.contacts[0].total_force[1])

    options = fm.SteppingOptions(step=0.05, smallest=1e-4, largest=0.1, easy=6)
    fm.follow_path(problem, lambda t: punch.move(y=-depth * t), options, on_step=record)
    return np.array(found)


# Limit loads of displacements are upper bounds: by 1.0 % with 6 cells under the punch, measured; by
# 0.4 % with 12, in ten times the time.
@pytest.mark.once
def test_limit_of_the_mean_pressure_of_a_flat_punch_is_2_plus_pi_times_the_shear_stress():
    """Prandtl 1920 and Hill 1950, for the perfectly plastic half-plane."""
    pressures = punched(6, depth=0.04)
    assert (np.diff(pressures) > -1e-6).all()
    assert pressures[-1] / pressures[-2] < 1.001
    assert 0.0 < pressures[-1] / ((2.0 + np.pi) * K) - 1.0 < 0.012


# Creep


def test_creep_by_a_power_law_over_long_times():
    """A strip between rollers under a plane: q' = -3 mu A q^n at constant strain.

    To nine digits the implicit steps of the equation in one variable; these are of first order.
    """
    A, n, height = 1e-7, 5, 1.6
    data = mesh([Grid("strip", block(2, 4, width=0.7, height=height))], cell="triangle", order=2)
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("DG", 1))
    w, (v, test) = fem.Function(W), ufl.TestFunctions(W)
    u, dp = ufl.split(w)
    mu, lmbda = fm.energies.lame(1000.0, 0.3)
    dt, dx = fem.Constant(data.mesh, 1.0), ufl.dx(degree=2)
    old, kept = (fm.quadrature_function(data.mesh, 2, shape) for shape in ((3, 3), ()))
    strain = in_space(fm.energies.strain(u))
    s = 2 * mu * ufl.dev(strain - old)
    q = ufl.sqrt(1.5 * ufl.inner(s, s) + 1e-20)
    flow = 1.5 * dp / q * s
    stress = s - 2 * mu * flow + (lmbda + 2 * mu / 3) * ufl.tr(strain) * ufl.Identity(3)
    residual = ufl.inner(stress, in_space(fm.energies.strain(v))) * dx
    rate = A * ufl.max_value(q - 3 * mu * dp, 0.0) ** n
    residual += 3 * mu * (dp - dt * rate) * test * dx
    plane = fm.Plane((0.0, height), (0.0, -1.0))
    sides = [("strip/left", 0), ("strip/right", 0), ("strip/bottom", 1)]
    bcs = [fm.dirichlet(W.sub(0), data, name, 0.0, component) for name, component in sides]
    problem = fm.ContactProblem(
        residual, w, [fm.ContactPair(data, "strip/top", plane)], bcs=bcs,
        history=[(old, old + flow), (kept, q - 3 * mu * dp)], petsc_options_prefix="creep_",
    )  # fmt: skip
    strained = 0.02
    plane.move(y=-strained * height)
    times = np.geomspace(1e-3, 1e5, 60)
    first = expected = 2 * mu * strained
    for length in np.diff(times, prepend=0.0):
        dt.value = length
        problem.solve()
        before, factor = expected, 3 * mu * A * length
        roots = np.roots([factor, 0, 0, 0, 1, -before])
        expected = float(roots[np.abs(roots.imag) < 1e-12].real[0])
    assert kept.x.array == pytest.approx(expected, rel=1e-9)
    exact = (first ** (1 - n) + (n - 1) * 3 * mu * A * times[-1]) ** (1 / (1 - n))
    assert expected == pytest.approx(exact, rel=0.05)


# Viscoelastic indentation


def elastic(u, degree, dt):
    """Material of the first moment of ``viscous``."""
    return plastic(u, degree, sigma_y=1e9)


@pytest.mark.parametrize("solver", ["reduced", "all dofs"])
def test_force_on_a_roller_at_rest_decays_as_the_relaxation_function(solver):
    """F(t) / F(0) = G(t) / G(0): with constant nu displacement and contact do not change."""
    block, first = (
        Block(law, degree=2, linear_bulk=solver == "reduced") for law in (viscous, elastic)
    )
    first.press(0.01)
    time, ramp = 0.0, 1e-3
    for step in (ramp, 0.1, 0.2, 0.4, 1.0, 3.0):
        time += step
        report = block.press(0.01, dt=step)
        assert report.certificate.balance < 1e-10
        assert block.force / first.force == pytest.approx(relaxed(time, ramp), rel=1e-9)
    assert block.force < 0.3 * first.force


def test_force_of_a_growing_depth_is_the_integral_of_the_relaxation_function():
    """Of a punch with constant contact, in steps of different lengths, then at rest."""
    blocks = [Block(law, obstacle=fm.Plane((0.0, 1.0), (0.0, -1.0))) for law in (viscous, elastic)]
    depth, ramp, time = 1e-3, 0.8, 0.0
    blocks[1].press(depth)
    for step in (0.3, 0.1, 0.3, 0.1, 0.3, 0.1):
        time += step
        blocks[0].press(depth * min(time / ramp, 1.0), dt=step)
        expected = blocks[1].force * relaxed(time, ramp)
        assert blocks[0].force == pytest.approx(expected, rel=1e-9)
