# SPDX-License-Identifier: MIT
"""Contact on the displacement part of a mixed function: nearly and fully incompressible bodies.

The neo-Hookean law of a displacement u and a pressure p, plane strain:

    P = mu (F - F^-T) + p J F^-T,    J - 1 = p / kappa,    kappa = 2 mu nu / (1 - 2 nu)

With F = diag(a, b) the side is free where P_xx = 0, that is p b = mu (1 / a - a).
"""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
from scenes import TIGHT, Scene, pair_options, pressed_blocks, read
from scipy.optimize import brentq

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.equations.diagnosis import describe_isolated
from meshes import two_blocks

comm = MPI.COMM_WORLD
E, STRETCH = 100.0, 0.9
TAYLOR_HOOD = ("Lagrange", 2, (2,)), ("Lagrange", 1)
GENERIC = {"n_upper": 5, "n_lower": 7, "layers_upper": 3, "layers_lower": 4}


def shear_and_compliance(nu):
    """Shear modulus and 1 / kappa, zero if incompressible."""
    mu = E / (2 * (1 + nu))
    return mu, (1 - 2 * nu) / (2 * mu * nu)


def neo_hookean(w, nu, part=0, scale=1.0, test=None):
    """Residual of displacement ``part`` and pressure, whose equation has the factor ``scale``."""
    mu, compliance = shear_and_compliance(nu)
    test = test or ufl.TestFunction(w.function_space)
    (u, p), (v, q) = (ufl.split(function) for function in (w, test))
    if part == 1:
        u, p, v, q = p, u, q, v
    F, p = ufl.variable(energies.deformation_gradient(u)), ufl.variable(p)
    psi = energies.mixed_neo_hookean(F, p, mu, compliance)
    work = ufl.inner(ufl.diff(psi, F), ufl.grad(v)) + scale * q * ufl.diff(psi, p)
    return work * ufl.dx(metadata={"quadrature_degree": 4})


def three_fields(w, nu):
    """Residual with a third unknown, the change of volume: J and p / kappa are equal to it."""
    mu, compliance = shear_and_compliance(nu)
    u, p, t = ufl.split(w)
    psi = energies.mixed_neo_hookean(u, p, mu) - p * t + t**2 / (2 * compliance)
    return ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 4}), w)


def linear_elastic(w, nu):
    """Residual for small strains."""
    mu, compliance = shear_and_compliance(nu)
    psi = energies.mixed_linear_elastic(*ufl.split(w), mu, compliance)
    return ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 4}), w)


def blocks(
    residual,
    *,
    parts=TAYLOR_HOOD,
    part=0,
    algorithm=None,
    basis="dual",
    comm=comm,
    sides_slide=False,
    linear_bulk=None,
    **mesh,
):
    """Two blocks, the lower one fixed or sliding, the upper one moved at its top by ``push``."""
    data = read(two_blocks.build, comm=comm, **{**GENERIC, **mesh})
    W = fm.mixed_space(data.mesh, *parts)
    w, push = fem.Function(W), fem.Constant(data.mesh, 0.0)
    V = W.sub(part)
    bcs = [fm.dirichlet(V, data, "upper/top", push, 1)]
    if sides_slide:
        bcs.append(fm.dirichlet(V, data, "lower/bottom", 0.0, 1))
        bcs += [fm.dirichlet(V, data, f"{body}/left", 0.0, 0) for body in ("lower", "upper")]
    else:
        bcs.append(fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)))
        bcs.append(fm.dirichlet(V, data, "upper/top", 0.01, 0))
    contact = fm.ContactPair(data, "upper/bottom", "lower/top", **pair_options(basis=basis))
    problem = fm.ContactProblem(
        residual(w), w, [contact], bcs=bcs, algorithm=algorithm, displacement=part,
        newton=TIGHT, linear_bulk=linear_bulk, petsc_options_prefix="test_",
    )  # fmt: skip
    return Scene(data, w, problem, {"push": push})


def part_of(w, part):
    """Values of one part of a mixed function, on all ranks."""
    _, dofs = w.function_space.sub(part).collapse()
    return np.concatenate(w.function_space.mesh.comm.allgather(w.x.array[np.ravel(dofs)]))


def uniaxial(nu):
    """Lateral stretch a, pressure p of the bodies and contact pressure under ``STRETCH``."""
    mu, compliance = shear_and_compliance(nu)

    def change_of_volume(a):
        return a * STRETCH - 1 - compliance * mu * (1 / a - a) / STRETCH

    a = brentq(change_of_volume, 0.9, 1.3, xtol=1e-15)
    p = mu * (1 / a - a) / STRETCH
    return a, p, -(mu * (STRETCH - 1 / STRETCH) + p * a) / a


@pytest.mark.once
@pytest.mark.parametrize("nu", [0.4999, 0.5])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("basis", ["dual", "standard"])
def test_uniaxial_pressure_of_incompressible_blocks_is_uniform(basis, cell, nu):
    scene = blocks(
        partial(neo_hookean, nu=nu), cell=cell, basis=basis, sides_slide=True,
        width_upper=1.0, width_lower=1.0,
    )  # fmt: skip
    for push in (-0.1, -0.2):  # for a height of two
        scene.loads["push"].value = push
        report = scene.problem.solve()
    a, p, pressure = uniaxial(nu)
    assert np.abs(scene.contact.pressure / pressure - 1).max() < 1e-10
    assert np.abs(part_of(scene.u, 1) / p - 1).max() < 1e-10
    assert part_of(scene.u, 0).max() == pytest.approx(a - 1, abs=1e-10)
    assert report.num_iterations <= 5 and not report.certificate.violations()


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_tangent_is_exact(algorithm):
    scene = blocks(partial(neo_hookean, nu=0.4999), algorithm=algorithm)
    scene.loads["push"].value = -0.02
    scene.problem.solve()
    slopes = scene.problem.check_tangent().slopes
    assert all(slope > 1.9 for slope in slopes.values()), slopes


def pressed(residual, push=-0.04, **options):
    """Blocks after a push, and the report."""
    scene = blocks(residual, **options)
    scene.loads["push"].value = push
    report = scene.problem.solve()
    assert not report.certificate.violations()
    return scene, report


def test_results_do_not_depend_on_the_number_of_ranks():
    residual = partial(neo_hookean, nu=0.4999)
    (together, _), (alone, _) = (pressed(residual, comm=c) for c in (comm, MPI.COMM_SELF))
    z, exact = together.contact.z, alone.contact.z
    assert np.abs(z - exact).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.once
def test_condensed_and_saddle_agree():
    residual = partial(neo_hookean, nu=0.5)
    one, other = (pressed(residual, algorithm=a)[0].u for a in ("condensed", "saddle"))
    assert np.abs(one.x.array - other.x.array).max() < 1e-9 * np.abs(one.x.array).max()


@pytest.mark.once
def test_displacement_may_be_any_sub_space():
    exact, _ = pressed(partial(neo_hookean, nu=0.4999))
    scene, _ = pressed(partial(neo_hookean, nu=0.4999, part=1), parts=TAYLOR_HOOD[::-1], part=1)
    z = scene.contact.z
    assert np.abs(z - exact.contact.z).max() < 1e-10 * np.abs(z).max()


@pytest.mark.once
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_convergence_does_not_depend_on_the_scale_of_the_pressure_equation(scale):
    """Residuals are forces and increments lengths for any unit of the pressure's rows."""
    plain, report = pressed(partial(neo_hookean, nu=0.4999))
    scaled, again = pressed(partial(neo_hookean, nu=0.4999, scale=scale))
    assert again.num_iterations == report.num_iterations
    for name in ("residual", "increment"):
        one, other = ([getattr(i, name) for i in r.iterations[1:4]] for r in (again, report))
        assert one == pytest.approx(other, rel=1e-3), name
    z, exact = scaled.contact.z, plain.contact.z
    assert np.abs(z - exact).max() < 1e-8 * np.abs(exact).max()


@pytest.mark.once
def test_three_fields_agree_with_two_fields():
    parts = (("Lagrange", 2, (2,)), ("DG", 0), ("DG", 0))
    three, report = pressed(partial(three_fields, nu=0.4), parts=parts)
    two, _ = pressed(partial(neo_hookean, nu=0.4), parts=parts[:2])
    z, exact = three.contact.z, two.contact.z
    assert np.abs(z - exact).max() < 1e-9 * np.abs(exact).max()
    assert report.num_iterations <= 7


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_linear_bulk_of_an_enclosed_incompressible_body_is_factored_once(slave):
    """With fixed contact dofs the lower block is inside a rigid boundary: K is singular there."""
    found = []
    for linear_bulk in (True, False):
        data = read(two_blocks.build, comm=comm, **GENERIC)
        W = fm.mixed_space(data.mesh, *TAYLOR_HOOD)
        w, push = fem.Function(W), [fem.Constant(data.mesh, 0.0) for _ in range(2)]
        V = W.sub(0)
        fixed = ["lower/bottom", "lower/left", "lower/right"]
        bcs = [fm.dirichlet(V, data, "upper/top", value, i) for i, value in enumerate(push)]
        bcs += [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in fixed]
        names = ("upper/bottom", "lower/top")
        pair = fm.ContactPair(data, *(names if slave == "upper" else names[::-1]))
        problem = fm.ContactProblem(
            linear_elastic(w, 0.5), w, [pair], bcs=bcs, displacement=0, newton=TIGHT,
            linear_bulk=linear_bulk, petsc_options_prefix="test_",
        )  # fmt: skip
        for step in ((0.0, -0.01), (0.01, -0.02)):
            for constant, value in zip(push, step, strict=True):
                constant.value = value
            report = problem.solve()
        found.append((w.x.array.copy(), report))
    (one, report), (other, _) = found
    assert "factored once" in report.solver and "failed" not in str(report)
    assert np.abs(one - other).max(initial=0.0) < 1e-8 * np.abs(other).max(initial=1e-300)


@pytest.mark.parametrize("enclosed", [False, True])
@pytest.mark.parametrize("stabilization", [0.0, 0.1])
def test_level_of_pressure_is_missing_in_enclosed_bodies_only(stabilization, enclosed):
    """A constant has no stiffness of its own: a free boundary determines its level."""
    data = read(two_blocks.build, comm=comm, **GENERIC)
    equal = ("Lagrange", 1, (2,)), ("Lagrange", 1)
    W = fm.mixed_space(data.mesh, *(equal if stabilization else TAYLOR_HOOD))
    w = fem.Function(W)
    gradients = [ufl.grad(ufl.split(f)[1]) for f in (w, ufl.TestFunction(W))]
    stabilizing = stabilization * ufl.inner(*gradients) * ufl.dx(data.mesh, degree=2)
    held = ["upper/top", "lower/bottom", "lower/left", "lower/right"] + ["lower/top"] * enclosed
    bcs = [fm.dirichlet(W.sub(0), data, name, (0.0, 0.0)) for name in held]
    problem = fm.ContactProblem(
        linear_elastic(w, 0.5) - stabilizing, w,
        [fm.ContactPair(data, "upper/bottom", "lower/top")], bcs=bcs,
        displacement=0, petsc_options_prefix="test_",
    )  # fmt: skip
    e = problem.equations
    found = describe_isolated(e.bulk, e.contacts, e.floating)
    assert ("level of field 1 of body 'lower':" in found) == enclosed
    assert "upper" not in found and bool(found) == enclosed


@pytest.mark.once
def test_linear_bulk_is_factored_once():
    once, each_time = (
        blocks(partial(linear_elastic, nu=0.5), linear_bulk=reduced) for reduced in (True, False)
    )
    for push in (-0.02, -0.04):
        for scene in (once, each_time):
            scene.loads["push"].value = push
            assert not scene.problem.solve().certificate.violations()
    assert once.problem._solver.linear_bulk.choose()[0] is not None
    w, exact = once.u.x.array, each_time.u.x.array
    assert np.abs(w - exact).max() < 1e-9 * np.abs(exact).max()
    assert np.abs(once.contact.z - each_time.contact.z).max() < 1e-9 * np.abs(exact).max()


@pytest.mark.once
@pytest.mark.parametrize("driven", [False, True])
def test_rigid_obstacle_presses_an_incompressible_block(driven):
    data = read(two_blocks.build, width_lower=1.0, gap=3.0, n_lower=4, layers_lower=3)
    W = fm.mixed_space(data.mesh, *TAYLOR_HOOD)
    w, obstacle = fem.Function(W), fm.Circle((0.6, 2.0), 1.0)
    bcs = [fm.dirichlet(W.sub(0), data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    pair = fm.ContactPair(data, "lower/top", obstacle)
    problem = fm.ContactProblem(
        neo_hookean(w, nu=0.5), w, [pair], bcs=bcs, newton=TIGHT, petsc_options_prefix="test_"
    )
    if driven:
        obstacle.push(y=-1.0)
    else:
        obstacle.move(y=-0.05)
    report = problem.solve()
    assert report.certificate.balance < 1e-10 and not report.certificate.violations()
    if driven:
        assert problem.equations.contacts[0].total_force[1] == pytest.approx(-1.0, abs=1e-10)
    slopes = problem.check_tangent().slopes
    assert all(slope > 1.9 for slope in slopes.values()), slopes


@pytest.mark.once
def test_linear_displacements_alone_lock_where_mixed_ones_do_not():
    """Forces at one displacement, nu = 0.4999: P2-P1 on the coarse mesh is within 1 % of a fine
    one; P1 on the coarse one is several times too stiff."""

    def displacement_only(u, E, nu):
        mu, compliance = shear_and_compliance(nu)
        F = ufl.Identity(2) + ufl.grad(u)
        J, inverse = ufl.det(F), ufl.inv(F).T
        return mu * (F - inverse) + (J - 1) / compliance * J * inverse

    mesh = {"cell": "triangle", "n_upper": 5, "n_lower": 7, "layers_upper": 3, "layers_lower": 4}
    fine = {name: 2 * value if name != "cell" else value for name, value in mesh.items()}
    forces = [
        pressed(partial(neo_hookean, nu=0.4999), push=-0.004, **sizes)[0].contact.total_force[1]
        for sizes in (mesh, fine)
    ]
    linear = pressed_blocks(material=displacement_only, nu=0.4999, E=E, **mesh)
    linear.loads["push"].value[:] = (0.01, -0.004)
    linear.problem.solve()
    assert forces[0] == pytest.approx(forces[1], rel=0.01)
    assert linear.contact.total_force[1] > 3 * forces[1]


@pytest.mark.once
@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_body_without_conditions_is_supported_by_contact_alone(gap):
    """A traction drives the upper block down; at a free top the bodies' pressure is the load."""
    data = read(two_blocks.build, **GENERIC, gap=gap)
    W = fm.mixed_space(data.mesh, *TAYLOR_HOOD)
    w, v = fem.Function(W), ufl.TestFunctions(W)[0]
    ds = ufl.Measure("ds", domain=data.mesh, subdomain_data=data.facet_tags)
    load = ufl.inner(fem.Constant(data.mesh, (0.0, -1.0)), v) * ds(data.boundaries["upper/top"])
    bcs = [fm.dirichlet(W.sub(0), data, "lower/bottom", (0.0, 0.0))]
    problem = fm.ContactProblem(
        neo_hookean(w, nu=0.4999) - load,
        w,
        [fm.ContactPair(data, "upper/bottom", "lower/top")],
        bcs=bcs,
        petsc_options_prefix="test_",
    )
    report = problem.solve()
    assert problem.equations.contacts[0].total_force == pytest.approx((0.0, 1.0), abs=1e-9)
    assert report.certificate.balance < 1e-10 and not report.certificate.violations()
