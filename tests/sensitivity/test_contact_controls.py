# SPDX-License-Identifier: MIT
"""Derivatives of the equations by controls of contact, at a fixed state."""

from mpi4py import MPI

import numpy as np
import pytest
import sensitivity_scenes as scenes
from friction_scenes import block_on
from scenes import TIGHT, internal, neo_hookean, read, rectangles
from test_adhesion import Sticky, columns

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.law import STICK, Row, row_of
from fenics_mortar.interface.mortar import EXACT, Linearization
from fenics_mortar.sensitivity.controls import (
    Interference,
    LawParameter,
    ObstacleLoad,
    ObstaclePlace,
    ObstacleShape,
    Offset,
)
from fenics_mortar.sensitivity.forms import contact_by_positions, free
from fenics_mortar.sensitivity.history import check_exact

comm = MPI.COMM_WORLD
DOT = 1e-12
# Error of difference quotients, see ``differentiate_shape`` [1].
QUOTIENT = 1e-10


def check(problem, control, before=None, *, step=1.0, least=1e-6, alike=DOT):
    """Taylor test of the rows, and dot product with the transpose."""
    start = control.get(problem)
    dm = step * np.random.default_rng(3).uniform(0.5, 1.0, start.shape)
    frames, present = [c.rows.frame() for c in problem.equations.contacts], problem.state()
    change = control.jvp(problem, dm, before)
    y = scenes.random_vector(problem, 2)
    there, back = y.dot(change, comm), float(np.vdot(control.vjp(problem, y, before), dm))
    assert there == pytest.approx(back, rel=alike)

    def value(t):
        control.set(problem, start + t * dm)
        if before is None:
            problem.equations.evaluate_operators()
        else:
            scenes.count_slip_from(problem, before, with_offsets(problem, present))
        return scenes.rows(problem, frames)

    of_rows = np.concatenate([z.ravel() for z in change.z])
    assert np.abs(of_rows).max() > least
    rate, errors = scenes.taylor(value, of_rows)
    assert rate > 1.9, errors
    control.set(problem, start)


def with_offsets(problem, state):
    return state.with_settings_of(problem.state())


class Regular(fm.Law):
    """Regularized friction whose parameters are a number and an array."""

    parameters = "length", "weights"

    def __init__(self):
        self.length, self.weights = 0.01, np.array([0.3, 0.1])

    def branch(self, node, before):
        return np.ones_like(before)

    def tangential(self, node, branch):
        fraction = np.tanh(node.slip / self.length)
        mu = self.weights[0] + self.weights[1] * fraction**2
        slope = (1.0 - fraction**2) / self.length
        by_fraction = self.weights[0] + 3.0 * self.weights[1] * fraction**2
        return Row(
            node.z_tau - mu * node.z_n * fraction,
            by_slip=-node.z_n * by_fraction * slope,
            by_z_n=-mu * fraction,
            by_z_tau=1.0,
        )

    def friction_limit(self, pressure):
        return self.weights.sum() * pressure


class Rough(Regular):
    """Law whose residual is not analytic in the parameter."""

    def tangential(self, node, branch):
        row = super().tangential(node, branch)
        return row._replace(residual=row.residual - node.z_n * np.abs(self.length))


LAWS = [
    (fm.Coulomb(0.3), "mu"),
    (fm.Coulomb(0.05), "mu"),
    (fm.Coulomb(0.5, max_shear=0.3), "max_shear"),
    (fm.Tresca(0.5), "stress"),
    (Regular(), "length"),
    (Regular(), "weights"),
]


@pytest.mark.once
@pytest.mark.parametrize("law, name", LAWS)
def test_parameters_of_laws(law, name):
    scene, _, _ = scenes.two_steps(law)
    value = np.max(getattr(law, name))
    check(scene.problem, LawParameter(0, name), step=0.1 * value)


class Soft(fm.Coulomb):
    """Coulomb's friction on a layer that yields to the pressure; derivatives by complex step."""

    parameters = "mu", "layer"
    layer = 50.0

    def closing_gap(self, node):
        return row_of(lambda at: at.gap + at.z_n / self.layer, node)


def test_parameters_of_a_layer_and_fields():
    """The stiffness of a soft layer, and a coefficient of friction that varies in space."""
    scene, *_ = scenes.two_steps(Soft(lambda X: 0.1 + 0.05 * X[:, 0]))
    problem, friction = scene.problem, LawParameter(0, "mu")
    check(problem, LawParameter(0, "layer"), step=5.0)
    check(problem, Offset(0), step=0.01)
    assert friction.get(problem).shape == (scene.contact.slave.num_nodes,)
    start = friction.get(problem)
    dm = np.linspace(0.01, 0.02, start.size)
    frames, change = [scene.contact.rows.frame()], friction.jvp(problem, dm)
    y = scenes.random_vector(problem, 2)
    assert friction.vjp(problem, y) @ dm == pytest.approx(y.dot(change, comm), rel=DOT)
    value = scenes.rows(problem, frames)
    friction.set(problem, start + dm)
    scene.contact.adopt_law()
    problem.equations.evaluate_operators()
    moved = scenes.rows(problem, frames)  # linear in the coefficient
    assert np.abs(moved - value - change.z[0].ravel()).max() < 1e-12
    assert np.abs(change.z[0]).max() > 1e-4


@pytest.mark.once
def test_rows_of_sticking_nodes_do_not_depend_on_the_limit():
    scene, _, _ = scenes.two_steps(fm.Coulomb(2.0))
    assert scene.contact.sticking.sum() == scene.contact.active.sum()
    assert not LawParameter(0, "mu").jvp(scene.problem, np.array(1.0)).z[0].any()


def test_unknown_and_non_analytic_parameters_are_refused():
    scene, _, _ = scenes.two_steps(Rough())
    with pytest.raises(ValueError, match="parameter of .*: expected one of"):
        LawParameter(0, "mu").get(scene.problem)
    with pytest.raises(ValueError, match="contradicts difference quotients"):
        LawParameter(0, "length").jvp(scene.problem, np.array(1.0))


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("sliding", ["finite", "small"])
def test_offset_and_interference(sliding, degree):
    scene, _, _ = scenes.two_steps(fm.Coulomb(0.3), degree=degree, pair={"sliding": sliding})
    check(scene.problem, Offset(0), step=0.01)
    check(scene.problem, Interference(0), step=0.01)


class Fading(Sticky):
    parameters = ("pull",)
    pull = 2.0

    def adhesion(self, gap):
        pull = self.pull * np.exp(-gap / 0.1)
        return pull, -pull / 0.1


@pytest.mark.once
def test_adhesion_of_open_nodes():
    """The parameter of a law with adhesion, and the offset, in rows of open nodes."""
    problem, lift = columns(Fading(0.3))
    lift.value = 0.05
    problem.solve()
    scenes.exact(problem)
    contact = problem.equations.contacts[0]
    assert contact.attracted.any()
    check(problem, LawParameter(0, "pull"))
    check(problem, Offset(0), step=0.01)
    contact.pair.law.pull = 1000.0
    slopes = []
    for linearization in (EXACT, Linearization()):
        problem.equations.linearization = linearization
        problem.equations.evaluate_operators()
        slopes.append(contact.now.law_rows[1].by_gap[contact.attracted])
    assert contact.now.decreases_fast[contact.attracted].all()
    assert (slopes[0] != 0.0).all() and (slopes[1] == 0.0).all()


def test_steep_adhesion_of_open_nodes_is_refused_with_small_sliding():
    """The tangent omits the derivative of a steep adhesion; closed nodes do not need it."""
    problem, lift = columns(Fading(0.3), sliding="small")
    (contact,) = problem.equations.contacts
    for height in (-0.05, 0.05):
        lift.value, contact.pair.law.pull = height, 2.0
        problem.solve(accept_violations=True)
        contact.pair.law.pull = 1000.0
        problem.equations.evaluate_operators()
        assert contact.now.decreases_fast.any()
        assert contact.attracted.any() == (height > 0.0)
        if height < 0.0:
            check_exact(contact)
        else:
            with pytest.raises(fm.MortarError, match="adhesion that decreases fast"):
                check_exact(contact)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("law", [fm.Frictionless(), fm.Coulomb(0.3)], ids=["smooth", "rough"])
def test_radius(law, inside, degree):
    centre = (0.45, 1.5) if inside else (0.4, -1.5)
    problem, before = slid_block(fm.Circle(centre, 1.515, inside=inside), law, degree)
    check(problem, ObstacleShape(problem.obstacles[0], "radius"), before, step=0.1)


def slid_block(obstacle, law, degree=1):
    """A block on an obstacle that was moved in a second step; its state before."""
    problem, _ = block_on(obstacle, degree=degree, law=law, angle=0.02)
    states = []
    for x, angle in ((0.0, 0.0), (0.02, 0.01)):
        obstacle.move(x=x, angle=angle)
        problem.solve(predict=False)
        states.append(problem.state())
    scenes.exact(problem)
    return problem, states[0] if law.has_friction else None


@pytest.mark.each
@pytest.mark.parametrize(
    "law", [fm.Frictionless(), fm.Coulomb(0.3), fm.Coulomb(3.0)], ids=["smooth", "slides", "sticks"]
)
def test_points_of_a_spline(law):
    """The slip of sticking nodes only, counted from the points of the earlier state."""
    x = np.linspace(-1.0, 2.0, 9)
    spline = fm.Spline(np.stack([x, 0.015 - 0.1 * (x - 0.5) ** 2], axis=1)[::-1])
    problem, before = slid_block(spline, law)
    check(problem, ObstacleShape(spline, "points"), before, step=0.05, alike=QUOTIENT)


def test_obstacles_without_that_shape_and_small_sliding_are_refused():
    for name in ("points", ["radius"]):
        with pytest.raises(ValueError, match="shape parameter=.*: expected one of radius"):
            ObstacleShape(fm.Circle((0.0, 0.0), 1.0), name).check()
    with pytest.raises(ValueError, match="has no parameter"):
        fm.Plane((0.0, 0.0), (0.0, 1.0)).set_shape("radius", np.array(1.0))


def test_places_and_loads_enter_the_rows_of_motions():
    circle = fm.Circle((0.4, -1.5), 1.515)
    problem, _ = slid_block(circle, fm.Frictionless())
    circle.push(x=0.0)
    dm, y = np.array([1.0, 2.0, 3.0]), scenes.random_vector(problem, 1)
    place, load = ObstaclePlace(circle), ObstacleLoad(circle)
    assert place.jvp(problem, dm).q[0].tolist() == [0.0, -2.0, -3.0]
    assert load.jvp(problem, dm).q[0].tolist() == [-1.0, 0.0, 0.0]
    for control in (place, load):
        there = y.dot(control.jvp(problem, dm), comm)
        assert there == pytest.approx(dm @ control.vjp(problem, y))
    place.set(problem, dm)
    load.set(problem, dm)
    assert circle.place.tolist() != [1.0, 2.0, 3.0] and circle.place[1:].tolist() == [2.0, 3.0]
    assert circle.load[0] == 1.0 and np.isnan(circle.load[1:]).all()


def by_positions(problem, d, y, before=None):
    """Change of the residuals with the positions, after the dot product with the transpose."""
    e, operator = problem.equations, contact_by_positions(problem, before)
    change = free(e, operator @ fm.LinearVector(u=d.u))
    back = (operator.T @ free(e, y)).u @ d.u
    assert y.dot(change, comm) == pytest.approx(comm.allreduce(back), rel=DOT)
    return change


@pytest.mark.parametrize("degree", [1, 2])
def test_positions(degree):
    """Forces and rows with all nodes moved, in the state before as well."""
    scene, before, present = scenes.two_steps(fm.Coulomb(0.3), degree=degree)
    problem = scene.problem
    d, y = scenes.random_vector(problem, 1, (0.005, 0.0, 0.0)), scenes.random_vector(problem, 2)
    change = by_positions(problem, d, y, before)
    frames = [c.rows.frame() for c in problem.equations.contacts]
    prescribed = problem.equations.bulk.prescribed_dofs

    def value(t):
        then, now = (scenes.moved(problem, state, d, t) for state in (before, present))
        scenes.count_slip_from(problem, then, now)
        force = problem.equations.residual.forces()[1]
        force[prescribed] = 0.0
        return np.concatenate([*comm.allgather(force), scenes.rows(problem, frames)])

    derivative = np.concatenate([*comm.allgather(change.u), *(z.ravel() for z in change.z)])
    rate, errors = scenes.taylor(value, derivative)
    assert rate > 1.9, errors


def test_positions_of_driven_obstacles():
    """The balance of a driven obstacle depends on the positions of the slave nodes."""
    circle = fm.Circle((0.4, -1.5), 1.515)
    problem, _ = slid_block(circle, fm.Frictionless())
    circle.push(y=0.05, moment=0.0)
    d, y = scenes.random_vector(problem, 1, (0.005, 0.0, 0.0)), scenes.random_vector(problem, 2)
    present, change = problem.state(), by_positions(problem, d, y)
    assert change.q[0, 0] == 0.0 and change.q[0, 1:].all()

    def value(t):
        problem.equations.put(scenes.moved(problem, present, d, t))
        problem.equations.evaluate_operators()
        motions = problem.equations.motions
        return np.where(motions.driven, motions.forces() * motions.scales, 0.0).ravel()

    rate, errors = scenes.taylor(value, change.q.ravel())
    assert rate > 1.9, errors


def test_positions_need_finite_sliding():
    scene, _, _ = scenes.two_steps(fm.Frictionless(), pair={"sliding": "small"})
    with pytest.raises(fm.MortarError, match="undeformed mesh"):
        contact_by_positions(scene.problem)


def test_normal_at_a_symmetry_plane_does_not_depend_on_the_shape():
    """The circle is not symmetric itself, so that its own normal there would change."""
    circle = fm.Circle((0.1, -1.5), 1.52)
    data = read(rectangles, size=0.25, block=(0.0, 0.0, 1.0, 0.5))
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "block/top", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "block/left", 0.0, component=0))
    pair = fm.ContactPair(data, "block/bottom", circle)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u, [pair], bcs=bcs, petsc_options_prefix="test_",
        newton=TIGHT,
    )  # fmt: skip
    problem.solve()
    scenes.exact(problem)
    (contact,) = problem.equations.contacts
    on_plane = np.isfinite(contact.plane_normals[:, 0])
    assert on_plane.sum() == 1 and contact.active[on_plane].all()
    check(problem, ObstacleShape(circle, "radius"), step=0.1)


class Glue(fm.Law):
    """Elastic resistance to slip, with a row of sticking nodes that depends on a parameter."""

    parameters = ("resistance",)
    resistance = 5.0

    def branch(self, node, before):
        return np.full_like(before, STICK)

    def tangential(self, node, branch):
        k = self.resistance
        return Row(node.z_tau + k * node.slip, by_slip=k * np.ones_like(node.slip), by_z_tau=1.0)

    def friction_limit(self, pressure):
        return np.full_like(pressure, np.inf)


def test_rows_of_redundant_sticks_do_not_depend_on_the_law():
    scene, _, _ = scenes.two_steps(Glue())
    problem, contact = scene.problem, scene.contact
    first = np.flatnonzero(contact.sticking)[0]
    contact.change(redundant=np.arange(contact.slave.num_nodes) == first)
    problem.equations.evaluate_operators()
    change = LawParameter(0, "resistance").jvp(problem, np.array(1.0)).z[0]
    assert not change[first].any() and change[contact.sticking].any()
    check(problem, LawParameter(0, "resistance"))
