# SPDX-License-Identifier: MIT
"""Friction: derivatives, exact states, objectivity, history, work, ranks."""

from dataclasses import replace
from typing import get_args

from mpi4py import MPI

import numpy as np
import pytest
from scenes import (
    TIGHT,
    homogeneous_blocks,
    internal,
    linear_elastic,
    neo_hookean,
    nodal,
    pair_options,
    pressed_blocks,
    read,
    rectangles,
    rotation,
)
from test_demos import run

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.laws import Nodal, Row
from fenics_mortar.contact.slip import Measure
from meshes import indenter_on_block, mapped_grids
from meshes.mapped_grids import Grid, mapped

MESH = {"n_upper": 6, "n_lower": 9, "layers_upper": 4, "layers_lower": 4}
SMALL = {"n_upper": 3, "n_lower": 4, "layers_upper": 2, "layers_lower": 2}
LAWS = {
    "coulomb": fm.Coulomb(0.3),
    "by pressure": fm.Coulomb(0.3, limit_by="pressure"),
    "capped": fm.Coulomb(0.3, max_shear=2.0),
    "tresca": fm.Tresca(1.0),
}
E, NU = 100.0, 0.3
WORKS = "contact", "friction"


class Creeping(fm.Law):
    """What the docstring of ``laws`` shows."""

    def branch(self, node: Nodal, before):
        return np.ones_like(before)

    def tangential(self, node: Nodal, branch) -> Row:
        part = np.tanh(node.slip / 0.01)
        return Row(
            node.z_tau - 0.3 * node.z_n * part,
            by_slip=-0.3 * node.z_n * (1.0 - part**2) / 0.01,
            by_z_n=-0.3 * part,
            by_z_tau=1.0,
        )

    def friction_limit(self, pressure):
        return 0.3 * pressure


MEASURES = [{"slip": slip} for slip in get_args(Measure)]


def blocks(law, *, degree=1, mesh=None, pair=None, **problem):
    mesh = mesh or (MESH if degree == 1 else SMALL)
    return pressed_blocks(degree=degree, pair={"law": law, **(pair or {})}, problem=problem, **mesh)


def drive(scene, *pushes):
    """Solve for each place of the top; return the records."""
    records = []
    for push in pushes:
        scene.loads["push"].value[:] = push
        records.append(scene.problem.solve())
        assert records[-1].certificate.violations() == []
    return records


def block_on(obstacle, *, degree=1, law=None, angle=0.0, weight=0.0):
    """A block of 1 x 0.5 on y = 0, turned by ``angle``, held at its top; weight frees it in y."""
    data = read(rectangles, size=0.25 * degree, block=(0.0, 0.0, 1.0, 0.5))
    x = data.mesh.geometry.x
    x[:, :2] = x[:, :2] @ rotation(angle).T
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    load = fem.Constant(data.mesh, (0.0, weight))
    residual = internal(u, neo_hookean(u, E, NU)) + ufl.inner(load, v) * ufl.dx
    along = fem.Constant(data.mesh, 0.0)
    held = fm.dirichlet(V, data, "block/top", along, component=0)
    if not weight:
        held = fm.dirichlet(V, data, "block/top", (0.0, 0.0))
    pair = fm.ContactPair(data, "block/bottom", obstacle, law=law)
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=[held], petsc_options_prefix="test_", newton=TIGHT
    )
    return problem, along


def slopes(problem, branches=None):
    """Slopes of the whole system; 1 where a term is missing."""
    if branches is not None:
        problem.equations.contacts[0].change(
            branch=np.resize(branches, problem.equations.contacts[0].branch.size)
        )
    return problem.check_tangent(print_table=False).slopes["whole"]


@pytest.mark.parametrize(
    "law, pair",
    [
        *((law, {}) for law in [*LAWS, "creeping"]),
        ("coulomb", {"slip": "operators"}),
        ("coulomb", {"slip": "operators", "basis": "standard"}),
    ],
)
@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_has_slope_two(law, pair, degree):
    """Mixed as solved, then all sticking, all sliding, and sliding both ways by force."""
    scene = blocks(LAWS.get(law) or Creeping(), degree=degree, pair=pair)
    drive(scene, (0.0, -0.03), (0.02, -0.04))
    for branches in (None, [0], [1], [1, 0, -1, 0]):
        assert slopes(scene.problem, branches) == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("degree", [1, 2])
def test_tangent_on_an_obstacle_has_slope_two(degree):
    """The obstacle's motions take part: they are directions of the test."""
    circle = fm.Circle((0.5, -2.0), 2.03)
    problem, _ = block_on(circle, degree=degree, law=fm.Coulomb(0.4))
    problem.solve()
    circle.move(x=0.01, angle=0.002)
    problem.solve()
    for branches in (None, [0], [1, 0, -1]):
        assert slopes(problem, branches) == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("algorithm", ["saddle", "condensed"])
@pytest.mark.parametrize("degree", [1, 2])
def test_sticking_blocks_are_one(algorithm, degree):
    """A homogeneous deformation with shear: the multiplier is minus Cauchy's traction.

    It is exact but for rounding: the state lies in both spaces, and the meshes do not match.
    """
    gradient = np.array([[0.01, 0.03], [0.0, -0.1]])
    sides = [f"{body}/{side}" for body in ("upper", "lower") for side in ("left", "right")]
    scene = homogeneous_blocks(
        gradient,
        ["upper/top", "lower/bottom", *sides],
        degree=degree,
        pair={"law": fm.Coulomb(0.9)},
        problem={"algorithm": algorithm},
        **SMALL,
    )
    scene.problem.solve()
    contact, F = scene.contact, np.eye(2) + gradient
    mu, lmbda = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    J = np.linalg.det(F)
    cauchy = (mu * (F @ F.T - np.eye(2)) + lmbda * np.log(J) * np.eye(2)) / J
    on = contact.covered
    exact = cauchy @ [0.0, 1.0]  # the slave's normal is (0, -1), z minus its traction
    assert contact.sticking[on].all()
    assert np.abs(exact[0]) > 1.0
    assert np.abs(contact.z[on] - exact).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_sliding_block_drags_with_the_whole_bound(law):
    scene = blocks(LAWS[law])
    records = drive(scene, (0.0, -0.1), (0.1, -0.1), (0.2, -0.1), (0.3, -0.1))
    contact = scene.contact
    assert contact.active.all() and not contact.sticking.any()
    node = contact.nodal
    bound = 0.3 * node.z_n if law == "coulomb" else np.full_like(node.z_n, 1.0)
    assert np.abs(np.abs(node.z_tau) - bound).max() < 1e-12 * node.z_n.max()
    assert max(record.num_iterations for record in records) <= 8


def test_shear_outside_the_cone_is_told():
    scene = blocks(fm.Coulomb(0.3))
    drive(scene, (0.0, -0.1), (0.1, -0.1))
    assert scene.problem.certificate().pairs[0].shear < 1e-10
    scene.contact.pair.law = fm.Coulomb(0.2)
    told = scene.problem.certificate()
    assert told.pairs[0].shear == pytest.approx(0.1, rel=1e-6)
    assert any("shear" in violation for violation in told.violations())


def test_wedge_takes_the_closed_form():
    """H = W (tan a + mu) / (1 - mu tan a), however the block deforms: the plane stays plane."""
    angle, mu, weight = 0.2, 0.3, 4.0
    plane = fm.Plane((0.0, 0.0), (-np.sin(angle), np.cos(angle)))
    problem, along = block_on(plane, law=fm.Coulomb(mu), angle=angle, weight=weight)
    for travel in (0.05, 0.1):
        along.value = travel
        problem.solve()
    contact, W = problem.equations.contacts[0], 0.5 * weight
    assert contact.active.any() and not contact.sticking.any()
    force = contact.total_force
    H = W * (np.tan(angle) + mu) / (1.0 - mu * np.tan(angle))
    assert force == pytest.approx([-H, W], rel=1e-8)


@pytest.mark.parametrize("pair", MEASURES)
@pytest.mark.parametrize("degree", [1, 2])
def test_slip_by_operators_is_the_usual_one(degree, pair):
    """-tau . [(D - D_old) x - (M - M_old) x] per weight; that by partners is close to it."""
    mesh = {**(MESH if degree == 1 else SMALL), "gap": 0.01}
    scene = blocks(fm.Coulomb(0.3), mesh=mesh, degree=degree, pair=pair)
    drive(scene, (0.0, -0.06), (0.05, -0.07))
    contact, u = scene.contact, scene.u.x.array
    old, faced = contact.operators, contact.covered
    contact.start_step()
    X = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    moved = 0.03 * np.sin(X @ [[1.0, 2.0], [3.0, 1.0]])
    u += (moved + np.where(X[:, 1:] > 1.005, [0.05, -0.01], 0.0)).ravel()
    contact.evaluate(u, scene.problem.equations.linearization)
    new, both = contact.operators, faced & contact.covered
    jump = new.jump(new.x, new.m) - old.jump(new.x, new.m)
    usual = -np.einsum("ja,ja->j", new.tau, jump)[both] / old.weight[both]
    off = np.abs(contact.slip[both] - usual).max() / np.abs(usual).max()
    assert both.any()
    assert off < 1e-13 if pair["slip"] == "operators" else 1e-6 < off < 1e-2


@pytest.mark.parametrize("pair", MEASURES)
@pytest.mark.parametrize("degree", [1, 2])
def test_rigid_rotation_is_no_slip(degree, pair):
    """Two bodies with a curved, open interface beyond its ends; all turn by one radian."""
    scene = blocks(fm.Coulomb(0.3), degree=degree, pair=pair)
    drive(scene, (0.03, -0.05))
    contact, u = scene.contact, scene.u.x.array
    contact.start_step()
    X = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    x = X + u.reshape(-1, 2)
    u[:] = (x @ rotation(1.0).T + [3.0, -2.0] - X).ravel()
    contact.evaluate(u, scene.problem.equations.linearization)
    assert np.abs(contact.slip).max() < 1e-13


def test_slip_on_an_obstacle_is_against_its_material():
    """A plane that moves along itself under a held block, and one that turns with the block."""
    plane = fm.Plane((0.0, 0.0), (0.0, 1.0))
    problem, _ = block_on(plane, law=fm.Coulomb(0.3))
    plane.move(x=0.2)
    contact, u = problem.equations.contacts[0], problem.equations.bulk.u
    contact.start_step()
    contact.evaluate(u.x.array, problem.equations.linearization)
    # tau = (1, 0) for n = (0, -1): the block moves along -tau relative to the plane
    assert np.allclose(contact.slip, -0.2 * contact.operators.tau[:, 0], atol=1e-15)
    plane.move(x=0.0, angle=0.7)
    x = problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    u.x.array[:] = (x @ rotation(0.7).T - x).ravel()
    contact.evaluate(u.x.array, problem.equations.linearization)
    assert np.abs(contact.slip).max() < 1e-14


@pytest.mark.parametrize("pair", MEASURES)
def test_nodes_that_enter_slip_by_the_motion_of_their_material(pair):
    """A block slides over the edge of another: nodes that faced nothing have the rigid slip."""
    scene = blocks(fm.Coulomb(0.3), mesh={**MESH, "offset": 1.8, "gap": 0.1}, pair=pair)
    contact = scene.contact
    uncovered = ~contact.covered
    assert uncovered.any()
    contact.start_step()
    X = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    upper = X[:, 1] > 1.05
    moved = np.where(upper[:, None], [-0.4, 0.0], 0.0).ravel()
    for _ in range(2):
        contact.evaluate(moved, scene.problem.equations.linearization)
        contact.update_multiplier_nodes()
    assert (contact.covered & uncovered).any()
    assert np.abs(np.abs(contact.slip) - 0.4).max() < 1e-13


@pytest.mark.serial
def test_closing_arcs_do_not_slip():
    """Two mirrored arcs are flattened: by the slave's tangent they slip by gap times angle."""
    radius = 8.0
    boxes = {"upper": (-1.0, 0.001, 2.0, 0.2), "lower": (-1.0, -0.201, 2.0, 0.2)}
    data = read(rectangles, size=0.1, **boxes)
    x = data.mesh.geometry.x
    x[:, 1] += np.sign(x[:, 1]) * x[:, 0] ** 2 / (2 * radius)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("upper/top", "lower/bottom")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(0.3))
    residual = internal(u, linear_elastic(u, E, NU))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="test_")
    contact = problem.equations.contacts[0]
    contact.start_step()
    X = V.tabulate_dof_coordinates()[:, :2]
    flat = np.zeros(X.shape)
    flat[:, 1] = -np.sign(X[:, 1]) * X[:, 0] ** 2 / (2 * radius)
    contact.evaluate(flat.ravel(), problem.equations.linearization)
    by_slave = np.abs(contact.slave.X[:, 0]) ** 3 / radius**2
    inside = contact.covered & (by_slave < 0.8 * by_slave.max())
    assert np.abs(contact.slip[inside]).max() < 0.1 * by_slave[inside].max()


@pytest.mark.serial
def test_reversal_closes_a_loop():
    """Forth and back twice: the second loop is the first, and friction takes up its area."""
    scene = blocks(fm.Coulomb(0.3))
    top = [0.04, 0.08, 0.04, 0.0, -0.04, -0.08, -0.04, 0.0]
    times = np.arange(1.0, 18.0)
    places = dict(zip(times, [0.0, *top, *top], strict=True))
    found = []

    def set_loads(time):
        before = places.get(np.floor(time), 0.0)
        after = places.get(np.ceil(time), 0.0)
        scene.loads["push"].value[:] = (before + (time % 1.0) * (after - before), -0.05)

    def keep(time, report):
        found.append(scene.contact.total_force[0])

    set_loads(1.0)
    scene.problem.solve()
    options = fm.SteppingOptions(step=1.0)
    path = fm.follow_path(scene.problem, set_loads, options, start=1.0, stop=17.0, on_step=keep)
    drag = np.array(found)
    assert path.num_cuts == 0
    assert np.abs(drag[8:] - drag[:8])[1:].max() < 1e-3 * drag.max()
    assert drag[9] == pytest.approx(-drag[13], rel=1e-6)
    second = path.steps[8:]
    friction = sum(step.work.friction for step in second)
    supports = sum(step.work.supports for step in second)
    assert friction > 0.0
    assert supports == pytest.approx(friction, rel=0.05)


def ironing(cells: int):
    """A round tool pressed into a block and drawn along it over four facets; the path's record."""
    data = read(
        indenter_on_block.build,
        n_block=36 * cells,
        layers_block=10 * cells,
        n_indenter=8 * cells,
        layers_indenter=5 * cells,
    )
    V = fm.vector_space(data.mesh, 1)
    u, tool = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "block/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "indenter/top", tool),
    ]
    pair = fm.ContactPair(data, "block/top", "indenter/arc", law=fm.Coulomb(0.3))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="test_"
    )

    def set_loads(time):
        tool.value[:] = (max(time - 1.0, 0.0), -0.5 * min(time, 1.0))

    fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), stop=1.5)
    return fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), start=1.5, stop=2.5)


@pytest.mark.serial
def test_ironing_in_long_steps_balances_its_work():
    """What contact takes up is the work of friction, but for what vanishes with the facets."""
    defects = []
    for cells in (1, 2):
        path = ironing(cells)
        assert path.num_cuts == 0
        assert np.median([step.report.num_iterations for step in path.steps]) <= 5 + cells
        contact, friction = (sum(getattr(s.work, k) for s in path.steps) for k in WORKS)
        assert friction > 0.0
        defects.append(abs(contact / friction - 1.0))
    assert defects[0] < 0.02
    assert defects[1] < 0.6 * defects[0]  # at first order it would be a half


@pytest.mark.parametrize("pair", MEASURES)
def test_rejected_step_leaves_no_trace(shared_path, pair):
    """Restored in memory and from a file, the same step has the same answer.

    On one rank to the last bit; on several, MUMPS adds up in any order.
    """
    last_bits = 0.0 if MPI.COMM_WORLD.size == 1 else 1e-12
    scene = blocks(fm.Coulomb(0.3), pair=pair)
    drive(scene, (0.0, -0.05), (0.03, -0.05))
    start = scene.problem.state()
    fm.save_state(scene.problem, str(shared_path / "state.npz"))
    drive(scene, (0.08, -0.05))
    z, u = scene.contact.z.copy(), nodal(scene.problem)
    drive(scene, (-0.05, -0.04))
    scene.problem.restore(start)
    drive(scene, (0.08, -0.05))
    for now, before in ((scene.contact.z, z), (nodal(scene.problem), u)):
        assert np.abs(now - before).max() <= last_bits * np.abs(before).max()
    other = blocks(fm.Coulomb(0.3), pair=pair)
    fm.load_state(other.problem, str(shared_path / "state.npz"))
    drive(other, (0.08, -0.05))
    assert np.abs(other.contact.z - z).max() < 1e-12 * np.abs(z).max()


@pytest.mark.parametrize("pair", MEASURES)
def test_ranks_agree(pair):
    """The same path on one rank: nodes stick and slide alike."""
    path = (0.0, -0.05), (0.03, -0.05), (0.12, -0.05)
    law = fm.Coulomb(0.3)
    mine = pressed_blocks(pair={"law": law, **pair}, comm=MPI.COMM_SELF, **MESH)
    ours = blocks(law, pair=pair)
    drive(mine, *path[:2])
    drive(ours, *path[:2])
    assert np.array_equal(mine.contact.sticking, ours.contact.sticking)
    assert 0 < ours.contact.sticking.sum() < ours.contact.active.sum()
    first, second = drive(mine, path[2])[0], drive(ours, path[2])[0]
    assert first.num_iterations == second.num_iterations
    assert np.array_equal(mine.contact.branch, ours.contact.branch)
    for quantity in ("z", "slip", "friction_work"):
        one, all_ = (np.asarray(getattr(scene.contact, quantity)) for scene in (mine, ours))
        assert np.abs(all_ - one).max() < 1e-11 * np.abs(one).max()


@pytest.mark.serial
def test_four_ranks_agree(tmp_path):
    """The test above on more ranks than the others run on."""
    test = f"{__file__}::test_ranks_agree[pair0]"
    finished = run(tmp_path, 4, "-m", "pytest", "-q", "-p", "no:cacheprovider", test)
    assert finished.returncode == 0, finished.stdout[-2000:] + finished.stderr[-2000:]


@pytest.mark.parametrize("pair", MEASURES)
def test_both_algorithms_and_contact_dofs_agree(pair):
    """Condensed, saddle point, and reduced to the contact dofs of a linear bulk."""
    answers = []
    for options in ({"algorithm": "condensed"}, {"algorithm": "saddle"}, {"linear_bulk": True}):
        scene = pressed_blocks(
            material=linear_elastic,
            pair={"law": fm.Coulomb(0.3), **pair},
            problem=options,
            **MESH,
        )
        drive(scene, (0.0, -0.02), (0.03, -0.02))
        answers.append(scene.contact.z)
    for answer in answers[1:]:
        assert np.abs(answer - answers[0]).max() < 1e-10 * np.abs(answers[0]).max()


@pytest.mark.serial
@pytest.mark.parametrize(
    "wrong",
    [
        lambda: fm.Coulomb(-0.1),
        lambda: fm.Coulomb(0.1, c_t=0.0),
        lambda: fm.Coulomb(0.1, limit_by="force"),
        lambda: fm.Coulomb(0.1, max_shear=0.0),
        lambda: fm.Tresca(-1.0),
        lambda: fm.ContactPair(fm.MeshData(None, None, None), 1, 2, law="coulomb"),
        lambda: fm.ContactPair(
            fm.MeshData(None, None, None), 1, 2, **pair_options(slip="textbook")
        ),
    ],
)
def test_wrong_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match=r"mu=|c_t=|limit_by=|max_shear=|stress=|law=|slip="):
        wrong()


def test_edge_that_shear_peels_off_is_named_with_a_law_that_has_a_solution():
    """A circle slid on a block: where an edge node closes, its shear opens it again."""
    circle, law = fm.Circle((1.3, 2.0), 1.0), fm.Tresca(0.1 * E)
    grid = Grid("block", mapped(20, 6, lambda s, t: (4.0 * s, t)))
    data = read(lambda: mapped_grids.build([grid]))
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [fm.dirichlet(u.function_space, data, "block/bottom", (0.0, 0.0))]
    pair = fm.ContactPair(data, "block/top", circle, law=law)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="test_"
    )
    circle.move(y=-0.05)
    problem.solve()
    pressed = problem.state()
    circle.move(x=0.1)
    with pytest.raises(fm.NotConvergedError, match=r"1 nodes of 'block/top' .*one at \(1.6.*peel"):
        problem.solve()
    problem.restore(replace(pressed, places=problem.equations.motions.places))
    pair.law = fm.Coulomb(1.0, max_shear=law.stress)
    problem.solve()
    contact = problem.equations.contacts[0]
    assert np.abs(contact.z_tau).max() == pytest.approx(law.stress, rel=1e-9)
    edge = contact.active_nodes[0]
    assert contact.z_tau[edge] == pytest.approx(contact.pressure[edge], rel=1e-9)
    assert 0.0 < contact.pressure[edge] < 0.1 * law.stress


def bowed_block_under_a_tool(half, degree):
    """Shears, pressures and slips right of x = 0 of a flat tool on a bowed block, or on its half.

    The master is the bowed one: its normals on the plane are not those of its last facet.
    """
    left, k = (0.0, 1) if half else (-1.0, 2)

    def block(columns, rows, width, low, high, bow):
        return mapped(
            columns * k,
            rows,
            lambda s, t: (
                width * (left + (1.0 - left) * s),
                low + (high - low) * t - bow * t * (width * (left + (1.0 - left) * s)) ** 2,
            ),
        )

    grids = [
        Grid("soft", block(4, 3, 1.0, 0.0, 0.6, 0.1)),
        Grid("tool", block(3, 2, 1.2, 0.62, 1.2, 0.0)),
    ]
    data = read(lambda: mapped_grids.build(grids))
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "soft/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(V, data, "tool/top", (0.0, -0.05))]
    bcs += [fm.dirichlet(V, data, f"{body}/left", 0.0, 0) for body in ("soft", "tool") if half]
    pair = fm.ContactPair(data, "tool/bottom", "soft/top", law=fm.Tresca(0.5))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="test_",
        newton=TIGHT,
    )  # fmt: skip
    problem.solve()
    contact = problem.equations.contacts[0]
    order = np.argsort(contact.slave.X[:, 0])
    order = order[contact.slave.X[order, 0] > -1e-9]
    return contact.z_tau[order], contact.pressure[order], contact.slip[order]


@pytest.mark.parametrize("degree", [1, 2])
def test_half_of_a_symmetric_scene_has_the_shears_and_slips_of_the_whole(degree):
    """What is left is the solver's tolerance."""
    (shear, pressure, slip), (half_shear, half_pressure, half_slip) = (
        bowed_block_under_a_tool(half, degree) for half in (False, True)
    )
    assert np.abs(shear).max() > 0.04 * pressure.max()
    assert np.abs(half_pressure - pressure).max() < 1e-9 * pressure.max()
    assert np.abs(half_shear - shear).max() < 1e-9 * pressure.max()
    assert half_slip[0] == 0.0
    assert np.abs(half_slip - slip).max() < 1e-9 * np.abs(slip).max()
