# SPDX-License-Identifier: MIT
"""Laws with memory, rate and layers, against closed forms; the tangent of each."""

from math import factorial

import numpy as np
import pytest
from law_scenes import HEIGHT, E, block_on_plane
from refusal import refused
from scenes import internal, linear_elastic, pressed_blocks, read, rectangles
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.laws import Cohesive, MixedCohesive, RateAndState, SoftLayer, Stribeck, Worn
from fenics_mortar.utils import compat
from meshes.mapped_boxes import Box
from meshes.mapped_boxes import block as box
from meshes.mapped_boxes import mesh as boxes
from meshes.mapped_grids import Grid, block
from meshes.mapped_grids import mesh as grids

SMALL = {"n_upper": 3, "n_lower": 4, "layers_upper": 2, "layers_lower": 2}
LAWS = {
    "wear": Worn(0.03, 2e-2),
    "compliance": SoftLayer(2000.0, 1.5, 0.3),
    "linear compliance": SoftLayer(200.0, 1.0, 0.2),
    "cohesive": Cohesive(2.0, 0.4),
    "mixed cohesive": MixedCohesive(100.0, 2.0, 0.4),
    "Stribeck": Stribeck(0.4, 0.2, 0.05, 0.1),
    "rate and state": RateAndState(0.4, 0.2, 0.1, 0.2, 0.01),
    "field": fm.Coulomb(lambda X: 0.2 + 0.1 * np.sin(X[:, 0])),
}


@pytest.mark.parametrize("degree", [1, 2])
def test_wear_under_a_fixed_top_is_implicit_euler(degree):
    """p' = -(E / H) wear p |v|: p decreases by the same factor in each step."""
    law = Worn(0.0, 1e-2)
    problem, push, plane = block_on_plane(law, degree=degree)
    push.value[1] = -0.05
    problem.solve()
    contact, slip = problem.contacts[0], 0.2
    pressure = 0.05 * E / HEIGHT
    assert contact.pressure == pytest.approx(pressure, rel=1e-11)
    for number in range(1, 4):
        plane.move(x=number * slip)
        assert problem.solve().certificate.violations() == []
        expected = pressure / (1.0 + E / HEIGHT * law.wear * slip) ** number
        assert contact.pressure == pytest.approx(expected, rel=1e-10)
        depth = contact.memory["depth"]
        assert depth == pytest.approx((pressure - expected) * HEIGHT / E, rel=1e-9)
        assert contact.gap == pytest.approx(-depth, abs=1e-12)


@pytest.mark.once
@pytest.mark.parametrize("m", [1.0, 2.0])
def test_soft_layer_pressure_follows_from_its_overlap(m):
    k, depth = 400.0, 0.04
    problem, push, _ = block_on_plane(SoftLayer(k, m))
    push.value[1] = -depth
    assert problem.solve().certificate.violations() == []
    contact = problem.contacts[0]
    # p = k o^m and p = E (depth - o) / H
    assert contact.pressure == pytest.approx(k * (-contact.gap) ** m, rel=1e-11)
    assert contact.pressure == pytest.approx(E / HEIGHT * (depth + contact.gap), rel=1e-11)


def test_cohesive_zone_is_loaded_unloaded_and_broken():
    strength, reach = 2.0, 0.04
    law = Cohesive(strength, reach)
    problem, push, _ = block_on_plane(law)
    contact, stiffness = problem.contacts[0], E / HEIGHT
    left, largest = strength / reach, np.nan
    for up, opening in ((0.005, 0.0), (0.02, None), (0.01, None), (0.03, None), (0.06, None)):
        push.value[1] = up
        assert problem.solve().certificate.violations() == []
        if up == 0.005:
            expected = stiffness * up
            gap = opening
        elif up == 0.01:  # back, on the secant of the largest gap
            secant = strength * (1.0 - largest / reach) / largest
            gap = stiffness * up / (stiffness + secant)
            expected = secant * gap
        elif up == 0.06:
            gap, expected = up, 0.0
        else:
            gap = (stiffness * up - strength) / (stiffness - left)
            expected, largest = strength - left * gap, gap
        assert contact.gap == pytest.approx(gap, abs=1e-12)
        assert contact.pressure == pytest.approx(-expected, abs=1e-10)
    push.value[1] = 0.01  # permanently broken
    problem.solve()
    assert np.abs(contact.pressure).max() < 1e-10


@pytest.mark.once
def test_rate_and_state_becomes_steady():
    """After a slip of 30 L all nodes slide at the rate of the plane, in the steady state."""
    law = RateAndState(0.4, 0.02, 0.03, 0.01, 0.01)
    problem, push, plane = block_on_plane(law)
    push.value[1] = -0.02
    for v in (0.01, 0.1):
        start = problem.time
        for number in range(1, 13):
            problem.time = start + number * 0.025 / v
            plane.move(x=plane.place[0] + 0.025)
            assert problem.solve().certificate.violations() == []
        contact = problem.contacts[0]
        steady = law.mu + (law.a - law.b) * np.log(v / law.v_0)
        coefficient = contact.shear / contact.pressure
        assert np.abs(coefficient) == pytest.approx(steady, rel=1e-9)
        theta = contact.memory["theta"]
        assert theta == pytest.approx(law.L / v, rel=1e-9)


@pytest.mark.once
def test_stribeck_friction_decreases_with_the_rate():
    law = Stribeck(0.4, 0.2, 0.05, 0.1)
    problem, push, plane = block_on_plane(law)
    push.value[1] = -0.02
    for v in (0.02, 0.1, 1.0):
        for _ in range(3):
            problem.time += 0.1 / v
            plane.move(x=plane.place[0] + 0.1)
            assert problem.solve().certificate.violations() == []
        contact = problem.contacts[0]
        coefficient, step = -contact.shear / contact.pressure, 0.1 / v
        assert coefficient == pytest.approx(law.coefficient(-contact.slip / step), rel=1e-10)
        expected = 0.2 + 0.2 * np.exp(-v / 0.05) + 0.1 * v
        assert coefficient == pytest.approx(expected, rel=1e-3)


@pytest.mark.each
@pytest.mark.parametrize("kind", ["array", "position", "function", "quadratic"])
def test_coefficient_of_friction_is_a_field(kind):
    law = fm.Coulomb(0.0)
    problem, push, plane = block_on_plane(law)
    contact = problem.contacts[0]
    X = contact.positions

    def mu(x):
        return 0.1 + 0.2 * x[0]

    if kind == "array":
        law.mu = mu(X.T)
    elif kind == "position":
        law.mu = lambda X: mu(X.T)
    else:
        mesh = problem.equations.bulk.V.mesh
        V = compat.scalar_space(mesh, 1 if kind == "function" else 2)
        law.mu = fem.Function(V)
        law.mu.interpolate(mu)
    push.value[1] = -0.02
    problem.solve()
    plane.move(x=0.05)
    assert problem.solve().certificate.violations() == []
    assert -contact.shear == pytest.approx(mu(X.T) * contact.pressure, rel=1e-10)


@pytest.mark.once
@pytest.mark.each
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", LAWS)
def test_tangent_has_slope_two(name, degree):
    scene = pressed_blocks(degree=degree, pair={"law": LAWS[name]}, **SMALL)
    push, problem = scene.loads["push"], scene.problem
    sign = 1.0 if "cohesive" in name else -1.0
    for number in (1, 2):
        problem.time = float(number)
        push.value[:] = (0.01 * number, sign * 0.02 * number)
        problem.solve(accept_violations=True)
    assert scene.contact.acts.any()
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.02)


@pytest.mark.once
@pytest.mark.each
@pytest.mark.parametrize("kind", ["vector", "discontinuous", "another mesh"])
def test_invalid_fields_are_refused(kind):
    law = fm.Coulomb(0.1)
    problem, push, _ = block_on_plane(law)
    V = problem.equations.bulk.V
    if kind == "another mesh":
        other, *_ = block_on_plane(law)
        V = compat.scalar_space(other.equations.bulk.V.mesh, 1)
    elif kind == "discontinuous":
        V = compat.scalar_space(V.mesh, 0, "DG")
    push.value[1] = -0.02
    law.mu = fem.Function(V)
    with refused(ValueError, "expected a scalar and continuous function on the mesh"):
        problem.solve()


@pytest.mark.parametrize("slip", [0.0, 1e-16, 1e-9, 1e-3, 0.019, 0.021, 0.3])
def test_the_state_of_friction_has_its_slope_at_any_slip(slip):
    """theta' = 1 - v theta / L, also without slip, where the mean of the decay is 0 / 0."""
    law, none = RateAndState(0.4, 0.2, 0.1, 0.2, 0.01), np.zeros(1)
    node = fm.laws.Nodal(
        none, none + slip, none, none, none, none, step=2.0, memory={"theta": none + 3.0}
    )
    row, x = fm.laws.row_of(law.theta, node), slip / law.L
    mean = sum((-x) ** k / factorial(k + 1) for k in range(30))
    slope = sum(-(k + 1) * (-x) ** k / factorial(k + 2) for k in range(30))
    assert row.residual == pytest.approx(3.0 * np.exp(-x) + 2.0 * mean, rel=1e-14)
    assert row.by_slip == pytest.approx((-3.0 * np.exp(-x) + 2.0 * slope) / law.L, rel=1e-13)


def test_a_bond_is_damaged_by_opening_and_slip_together():
    """A block of 1e7 times the bond's stiffness: its motion is the jump, in any order of modes."""
    k, strength, reach, stiff = 100.0, 2.0, 0.1, 1e7
    law, largest = MixedCohesive(k, strength, reach), 0.0

    def material(u, E, nu):
        return stiff * linear_elastic(u, 1.0, nu)

    problem, push, _ = block_on_plane(law, material=material)
    contact = problem.contacts[0]
    for motion in ((0.0, 0.005), (0.005, 0.01), (0.03, 0.02), (0.01, 0.01), (-0.04, 0.05)):
        push.value[:] = motion
        assert problem.solve().certificate.violations() == []
        jump = np.hypot(*motion)
        largest = max(largest, jump)
        softened = strength * (reach - largest) / ((reach - strength / k) * largest)
        secant = min(k, softened)
        assert contact.pressure == pytest.approx(-secant * motion[1], rel=1e-4)
        assert contact.shear == pytest.approx(secant * motion[0], rel=1e-4, abs=1e-10)
        assert problem.check_tangent().slopes["whole"] > 1.95
    push.value[:] = 0.09, 0.08
    problem.solve()
    assert np.abs([contact.pressure, contact.shear]).max() == 0.0


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
def test_a_bond_has_the_traction_of_its_total_slip_however_it_turns(dim):
    """Sheared along x, along y in space, back and beyond the start, while the whole scene turns."""
    k, strength, reach = 20.0, 4.0, 1.0
    law, largest = MixedCohesive(k, strength, reach), strength / k
    if dim == 2:
        lower = Grid("lower", block(4, 2, width=2.0, height=0.5, corner=(-1.0, -0.5)))
        upper = Grid("upper", block(3, 2, width=1.0, height=0.5, corner=(-0.5, 0.0)))
    else:
        lower = Box("lower", box((3, 3, 1), size=(2.0, 2.0, 0.5), corner=(-1.0, -1.0, -0.5)))
        upper = Box("upper", box((2, 2, 1), size=(1.0, 1.0, 0.5), corner=(-0.5, -0.5, 0.0)))
    data = (grids if dim == 2 else boxes)([upper, lower])
    V = fm.vector_space(data.mesh, 1)
    u, below, above = (fem.Function(V) for _ in range(3))
    sides = [("lower/bottom", below), ("upper/top", above)]
    problem = fm.ContactProblem(
        ufl.derivative(fm.energies.neo_hookean(u, 1e7, 1e7) * ufl.dx(degree=3), u),
        u,
        [fm.ContactPair(data, "upper/bottom", "lower/top", law=law)],
        bcs=[fm.dirichlet(V, data, *side) for side in sides],
        petsc_options_prefix="bond_",
    )
    contact, axis = problem.contacts[0], (0.36, 0.48, 0.8) if dim == 3 else (0.0, 0.0, 1.0)
    motions = [(0.1, 0.0), (0.1, 0.1), (0.0, 0.2), (-0.1, 0.1), (0.3, -0.2), (0.0, 0.0)]
    for number, motion in enumerate(motions):
        Q = Rotation.from_rotvec(0.3 * number * np.array(axis)).as_matrix()[:dim, :dim]
        jump = np.array([*motion[: dim - 1], 0.01])
        for place, shift in ((below, 0.0 * jump), (above, jump)):
            place.interpolate(lambda x, Q=Q, shift=shift: Q @ (x[:dim] + shift[:, None]) - x[:dim])
        assert problem.solve().certificate.violations() == []
        largest = max(largest, float(np.linalg.norm(jump)))
        secant = strength * (reach - largest) / ((reach - strength / k) * largest)
        assert Q.T @ contact.total_force == pytest.approx(-secant * jump, rel=1e-4, abs=1e-5)
        if dim == 3:
            slid = np.stack([contact.memory[f"slid_{axis}"] for axis in "xyz"], axis=1)
            assert slid @ Q == pytest.approx(np.tile([*motion, 0.0], (len(slid), 1)), abs=1e-6)
        if number % 2:
            assert problem.check_tangent().slopes["whole"] > 1.95


@pytest.mark.parametrize("stiffness", [200.0, 2e3, 1e6])
def test_an_elastic_bond_and_a_block_are_springs_in_series(stiffness):
    """Whether the bond is softer or stiffer than the block."""
    law = MixedCohesive(stiffness, strength=5.0, reach=1.0)
    problem, push, _ = block_on_plane(law)
    push.value[1] = 0.01
    report = problem.solve()
    traction = 0.01 / (1.0 / stiffness + HEIGHT / E)
    assert problem.contacts[0].pressure == pytest.approx(-traction, rel=1e-9)
    assert report.num_iterations < 10


def test_an_elastic_bond_carries_a_body_without_other_supports():
    """A closed bond has no force yet, but one that opens does."""
    scene = pressed_blocks(
        material=linear_elastic, nu=0.0, **SMALL, width_upper=1.0, width_lower=1.0
    )
    data, u = scene.data, scene.u
    V = u.function_space
    law = MixedCohesive(1e3, strength=5.0, reach=0.1)
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=law)
    ds = ufl.ds(subdomain_data=data.facet_tags)(data.boundary_tag("upper/top"))
    residual = internal(u, linear_elastic(u, 100.0, 0.0)) - 2.0 * ufl.TestFunction(V)[1] * ds
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="hung_")
    assert problem.solve().certificate.violations() == []
    assert problem.contacts[0].pressure == pytest.approx(-2.0, rel=1e-9)
    assert problem.contacts[0].gap == pytest.approx(2e-3, rel=1e-9)


class Fading(fm.Frictionless):
    """Adhesion that decreases exponentially, by a user."""

    def adhesion(self, gap):
        return np.exp(-gap / REACH), -np.exp(-gap / REACH) / REACH


REACH = 0.7 * HEIGHT / E  # the adhesion drops faster than the force of the block


@pytest.mark.parametrize("load", [0.98, 1.001, 1.02])
@pytest.mark.parametrize("law", [Cohesive(1.0, REACH), Fading()], ids=repr)
def test_bonds_break_in_one_step_just_above_their_limit(law, load):
    """Of the strength one; full steps alternate between closed gaps and a force beyond it."""
    problem, push, _ = block_on_plane(law, size=0.5)
    push.value[1] = load * HEIGHT / E
    assert problem.solve().certificate.violations() == []
    pull = load
    if load > 1.0:
        gap = brentq(lambda g: load - E / HEIGHT * g - np.exp(-g / REACH), REACH / 2, load)
        pull = 0.0 if isinstance(law, Cohesive) else np.exp(-gap / REACH)
    assert problem.contacts[0].pressure == pytest.approx(-pull, rel=1e-8, abs=1e-12)


def test_an_attempt_that_begins_where_a_distance_is_not_finite_fails_as_a_solve():
    """Bonds of the law would be solved for from the last iterate; a path cuts the step."""

    def distance(x):
        gradient = np.zeros_like(x)
        gradient[:, 1] = 1.0
        return np.where(x[:, 1] < -0.1, np.nan, x[:, 1]), gradient, np.zeros((len(x), 2, 2))

    data = read(rectangles, size=0.25, block=(0.0, 0.02, 1.0, 0.52))
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, -0.16))
    tool = fm.SignedDistance(distance)
    pair = fm.ContactPair(data, "block/bottom", tool, law=Cohesive(1.0, 0.002))
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u, [pair],
        bcs=[fm.dirichlet(V, data, "block/top", push)], petsc_options_prefix="bonds_",
    )  # fmt: skip
    start = problem.state()
    with pytest.raises(fm.NotConvergedError, match="not finite") as failed:
        problem.solve()
    assert failed.value.report.iterations
    problem.restore(start)

    def set_loads(time):
        push.value[1] = -0.16 * time

    assert fm.follow_path(problem, set_loads, fm.SteppingOptions(step=1.0)).steps[-1].time == 1.0


@pytest.mark.parametrize("new", ["wear", "cohesive", "mixed cohesive", "field"])
def test_a_new_law_may_be_asked_for_results_before_the_next_solve(new):
    scene = pressed_blocks(pair={"law": fm.Coulomb(0.3)}, **SMALL)
    problem = scene.problem
    scene.loads["push"].value[:] = (0.01, -0.02)
    problem.solve()
    problem.contacts[0].pair.law = LAWS[new]
    assert problem.certificate().pairs
    assert problem.contacts[0].memory == {}  # that of the accepted state is kept
    problem.solve()
    assert tuple(problem.contacts[0].memory) == LAWS[new].memory


@pytest.mark.parametrize("law", [Cohesive(1.0, 0.2), MixedCohesive(1e5, 1.0, 0.2)], ids=repr)
def test_bonds_unload_and_load_again_along_a_steep_line(law):
    """The line to the origin is three times as steep as the elastic line of a surface node."""
    scene = pressed_blocks(pair={"law": law}, material=linear_elastic, **SMALL)
    scene.loads["push"].value[1] = 0.0165
    scene.problem.solve()
    forces = {}
    for motion in (0.008, 0.0, 0.004, 0.008, 0.0165):
        scene.loads["push"].value[1] = motion
        report = scene.problem.solve()
        assert report.num_iterations <= 8 and report.certificate.violations() == []
        force = scene.contact.total_force[1]
        assert force == pytest.approx(forces.setdefault(motion, force), rel=1e-6)
    assert forces[0.004] == pytest.approx(0.5 * forces[0.008], rel=1e-3)
