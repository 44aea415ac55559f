# SPDX-License-Identifier: MIT
"""Checks of models: estimates compared with true errors, and restored states."""

import numpy as np
import pytest
from model_check_scenes import MESH, blocks
from scenes import internal, linear_elastic, neo_hookean, nodal, pressed_blocks, read, rotation

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.law import Stick
from fenics_mortar.mesh.space import set_by_input_node
from fenics_mortar.models.model_error import (
    ENERGY,
    PEAK,
    QUANTITIES,
    SolutionQuantities,
    differences,
    estimate_wider,
    largest_strain,
    shear_demand,
    strained,
)
from meshes import mapped_grids, two_blocks
from meshes.mapped_grids import Grid, block, sector

MODELS = [("linear", "finite"), ("finite", "small"), ("linear", "small")]


@pytest.mark.once
@pytest.mark.parametrize("strain, sliding", MODELS)
@pytest.mark.parametrize("push", [(0.0, -0.02), (0.0, -0.15), (0.1, -0.1)])
def test_estimates_are_within_a_factor_of_the_true_error(push, strain, sliding):
    """One Newton step is correct to first order; at strains of 15 % the rest is below a half."""
    problem, report = blocks(push, strain=strain, sliding=sliding)
    full, _ = blocks(push, strain="finite")
    true = differences(problem, SolutionQuantities.of(problem), SolutionQuantities.of(full))
    found = report.model_check.assumptions[-1].errors
    for name in QUANTITIES:
        if true[name] > 1e-5:  # below, errors of the cheap model are rounding
            assert true[name] / 2.0 < found[name] < 2.0 * true[name], (name, true, found)
    assert true[ENERGY] > 1e-5


@pytest.mark.once
def test_check_changes_neither_state_nor_later_steps():
    problem, _ = blocks((0.05, -0.1), sliding="small")
    alone, _ = blocks((0.05, -0.1), sliding="small")
    alone.equations.model_check = None
    before = problem.state()
    problem.equations.model_check.assess(problem)
    after = problem.state()
    assert np.array_equal(before.u, after.u) and np.array_equal(
        before.interfaces[0].z, after.interfaces[0].z
    )
    assert np.array_equal(before.interfaces[0].active, after.interfaces[0].active)
    assert problem.equations.contacts[0].operators.linearization.frozen
    one, other = problem.solve(), alone.solve()
    assert other.model_check is None and one.num_iterations == other.num_iterations
    u, w = nodal(problem), nodal(alone)
    assert np.abs(u - w).max() < 1e-10 * np.abs(u).max()  # rounding of MUMPS


@pytest.mark.once
def test_table_contains_the_verdicts():
    """One row per assumption and their sum; slip and rotation are those of the scene."""
    _, report = blocks((0.1, -0.1), sliding="small")
    model_check = report.model_check
    names = [assumption.name for assumption in model_check.assumptions]
    assert names == ["linear strain", "small sliding", "linear strain and small sliding"]
    assert [model_check.verdict(a) for a in model_check.assumptions] == ["not enough"] * 3
    assert (
        not model_check.suffices
        and "not enough" in str(model_check)
        and "facets" in str(model_check)
    )
    _, report = blocks((0.0, -0.001), sliding="small")
    assert report.model_check.suffices
    _, report = blocks((0.1, -0.1), sliding="small", discretisation=0.5)
    assert report.model_check.verdict(report.model_check.assumptions[1]) == "refine the mesh first"


@pytest.mark.once
def test_the_full_model_assumes_nothing():
    _, report = blocks((0.0, -0.05), strain="finite")
    assert report.model_check.assumptions == [] and report.model_check.suffices


@pytest.mark.parametrize("ratio, verdict", [(None, "unknown"), (0.001, "enough"), (0.5, "not en")])
def test_rigid_obstacles_follow_the_rule_of_stiffness(ratio, verdict):
    scene = pressed_blocks(**MESH)
    u = fem.Function(scene.u.function_space)
    plane = fm.Plane((0.0, 0.99), (0.0, 1.0))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u,
        [fm.ContactPair(scene.data, "upper/bottom", plane)],
        bcs=scene.problem.equations.bulk.bcs, petsc_options_prefix="test_",
        model_check=fm.ModelCheck(stiffness_ratio=ratio),
    )  # fmt: skip
    scene.loads["push"].value[1] = -0.05
    model_check = problem.solve().model_check
    (assumption,) = model_check.assumptions
    assert model_check.verdict(assumption).startswith(verdict)
    assert model_check.suffices == (verdict == "enough")


SOFT = Grid("soft", block(12, 5, width=1.0, height=0.5))
TOOL = block(16, 6, width=1.6, height=0.8, corner=(-0.3, -0.8))
STIFFER = 20.0


def soft_on(tool, *, angle=0.0):
    """A soft block on a stiffer one, both meshed, or on a rotated plane."""
    turn = rotation(angle)
    shape = Grid("tool", TOOL @ turn.T)
    grids = [SOFT, shape] if tool == "meshed" else [SOFT]
    data, alone = (read(lambda g=g: mapped_grids.build(g)) for g in (grids, [shape]))
    u, w = (fem.Function(fm.vector_space(d.mesh, 1)) for d in (data, alone))
    dx, v = ufl.dx(subdomain_data=data.cell_tags), ufl.TestFunction(u.function_space)
    residual = sum(
        ufl.inner(neo_hookean(u, E, 0.3), ufl.grad(v)) * dx(data.bodies[name])
        for name, E in (("soft", 100.0), ("tool", 100.0 * STIFFER)) if name in data.bodies
    )  # fmt: skip
    rise = np.array([0.02, 0.03])
    plane = fm.Plane((0.0, 0.0), turn @ [0.0, 1.0])
    plane.move(x=rise[0], y=rise[1], angle=-angle)
    fixed = [fm.dirichlet(u.function_space, data, "soft/top", (0.0, 0.0))]
    if tool == "meshed":
        fixed.append(fm.dirichlet(u.function_space, data, "tool/bottom", rise))
    pair = fm.ContactPair(data, "soft/bottom", "tool/top" if tool == "meshed" else plane)
    problem = fm.ContactProblem(residual, u, [pair], bcs=fixed, petsc_options_prefix="test_")
    problem.solve()
    elastic = internal(w, linear_elastic(w, 100.0 * STIFFER, 0.3))
    grip = [fm.dirichlet(w.function_space, alone, "tool/bottom", (0.0, 0.0))]
    return problem, lambda bcs=grip: fm.ElasticObstacle(
        plane, elastic, w, alone, "tool/top", bcs=bcs
    )


@pytest.mark.once
def test_meshed_tool_gives_the_error_of_a_rigid_obstacle():
    """Correct up to second order, a tenth here, for any frame of the tool's mesh."""
    full, _ = soft_on("meshed")
    found = []
    for angle in (0.0, 0.7):
        problem, tool = soft_on("rigid", angle=angle)
        before, offset = problem.state(), problem.equations.contacts[0].offset
        (assumption,) = fm.ModelCheck(elastic_obstacles=[tool()]).assess(problem).assumptions
        assert np.array_equal(problem.state().u, before.u)
        assert (
            problem.equations.contacts[0].offset is offset
            and "of its surface" in assumption.indicator
        )
        found.append(assumption.errors)
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    other, (nodes, u) = SolutionQuantities.of(full), full.equations.bulk.by_input_node()
    here = SolutionQuantities.of(problem)
    bulk, count = problem.equations.bulk, SOFT.x[:, :, 0].size
    set_by_input_node(bulk.space, bulk.u, nodes[:count], u[:count])
    other.u = bulk.values[: bulk.num_owned].copy()
    true = differences(problem, here, other)
    for name in QUANTITIES:
        assert 0.85 < found[0][name] / true[name] < 1.15, (name, true, found[0])


def ring_on(tool, data):
    """A quarter of a ring around a larger, stiffer ring, or around a circle."""
    V = fm.vector_space(data.mesh, 1)
    u, circle = fem.Function(V), fm.Circle((0.0, 0.0), 1.01)
    bodies = {"meshed": ("soft", "tool"), "circle": ("soft",), "alone": ("tool",)}[tool]
    dx, v = ufl.dx(subdomain_data=data.cell_tags), ufl.TestFunction(V)
    forms = [
        ufl.inner(linear_elastic(u, {"soft": 100.0, "tool": 1000.0}[name], 0.3), ufl.grad(v))
        * dx(data.bodies[name])
        for name in bodies
    ]
    sides = (("left", 1), ("right", 0))
    bcs = [fm.dirichlet(V, data, f"{b}/{side}", 0.0, i) for b in bodies for side, i in sides]
    if tool == "alone":
        return lambda of: fm.ElasticObstacle(of, forms[0], u, data, "tool/bottom", bcs=bcs)
    pair = fm.ContactPair(data, "soft/top", "tool/bottom" if tool == "meshed" else circle)
    problem = fm.ContactProblem(sum(forms), u, [pair], bcs=bcs, petsc_options_prefix="test_")
    problem.solve()
    return problem


def test_report_contains_faceting_and_elasticity_of_a_meshed_tool():
    """With 9 facets on a quarter circle the deviation is at most (pi / 18)^2 / 8 = 3.8e-3.

    The sum of both is the difference from the meshed tool up to second order, about the square of
    their sum: 10 to 30 % of the overlap.
    """
    quarter = (0.0, np.pi / 2)
    soft = Grid("soft", sector(6, 4, radii=(1.0, 1.5), angles=quarter))
    tool = Grid("tool", sector(9, 4, radii=(0.5, 1.01), angles=quarter))
    meshes = {"circle": [soft], "meshed": [soft, tool], "alone": [tool]}
    rigid, full, alone = (
        ring_on(name, read(lambda g=grids: mapped_grids.build(g))) for name, grids in meshes.items()
    )
    (contact,) = rigid.equations.contacts
    elastic = alone(contact.obstacle)
    give, flatness = elastic.displacements([contact])[0], elastic.flatness([contact])[0]
    on = contact.active
    assert 0.5 * 3.8e-3 < flatness[on].mean() < 0.8 * 3.8e-3  # two thirds of the largest
    found = estimate_wider(rigid, [contact], [give + flatness])
    forces = [problem.equations.contacts[0].total_force for problem in (rigid, full)]
    true = np.linalg.norm(forces[0] - forces[1]) / np.linalg.norm(forces[1])
    assert 0.85 < found["total force"] / true < 1.15
    peaks = [problem.equations.contacts[0].pressure.max() for problem in (rigid, full)]
    assert 0.7 < found[PEAK] / (abs(peaks[0] / peaks[1] - 1)) < 1.3
    check = fm.ModelCheck(1e-3, elastic_obstacles=[elastic]).assess(rigid)
    assert check.verdict(check.assumptions[0]) == "refine the mesh first"
    assert "facets deviate" in str(check)


def test_tool_without_supports_is_refused():
    _, tool = soft_on("rigid")
    with pytest.raises(ValueError, match="body of plane can move"):
        tool([])


def test_small_sliding_on_an_obstacle_that_has_moved():
    """A richer model is set up at the obstacle's present position, not at its first."""
    scene = pressed_blocks(**MESH)
    found = {}
    for strain in ("linear", "finite"):
        u = fem.Function(scene.u.function_space)
        materials = {"linear": linear_elastic, "finite": neo_hookean}
        forms = {name: internal(u, law(u, 100.0, 0.3)) for name, law in materials.items()}
        tool = fm.Circle((1.1, -1.0), 2.0)
        pair = fm.ContactPair(scene.data, "upper/bottom", tool, sliding="small")
        check = fm.ModelCheck(finite_strain=forms["finite"], stiffness_ratio=0.001)
        problem = fm.ContactProblem(
            forms[strain], u, [pair], bcs=scene.problem.equations.bulk.bcs,
            petsc_options_prefix="test_", model_check=check if strain == "linear" else None,
        )  # fmt: skip
        tool.move(x=0.3, y=0.05)
        found[strain] = problem, problem.solve().model_check
    problem, model_check = found["linear"]
    true = differences(
        problem, SolutionQuantities.of(problem), SolutionQuantities.of(found["finite"][0])
    )
    errors = model_check.assumptions[0].errors
    assert all(0.5 < errors[name] / true[name] < 2.0 for name in QUANTITIES), (errors, true)


def test_strain_and_rotation_of_a_known_state():
    """A rotation by 0.1 radian after a stretch of 3 %, in every cell."""
    problem, _ = blocks((0.0, 0.0), strain="finite", solve=False)
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    H = turn @ np.diag([1.03, 1.0]) - np.eye(2)
    problem.equations.bulk.u.interpolate(lambda X: H @ X[:2])
    assert largest_strain(problem) == pytest.approx((0.1, 0.03), rel=1e-10)


def test_rigid_motions_of_the_bodies_are_no_strain():
    """Both are stretched by 2 % and rotated by 0.4 radian; the remainder is the rotated stretch."""
    problem, _ = blocks((0.0, 0.0), strain="finite", solve=False)
    bulk = problem.equations.bulk
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    bulk.u.interpolate(lambda X: turn @ np.diag([1.02, 1.0]) @ X[:2] - X[:2])
    rest = strained(problem, bulk.u.x.array[: bulk.num_owned])[bulk.space.owned_dofs] @ turn
    X = bulk.V.tabulate_dof_coordinates()[: len(rest), 0]
    assert rest[:, 0] == pytest.approx(0.02 * (X - 1.1), abs=1e-12)  # 1.1: the middle of both
    assert np.abs(rest[:, 1]).max(initial=0.0) < 1e-12


@pytest.mark.parametrize(
    "options, message",
    [
        ({"quantity": "stress"}, "quantity='stress': expected one of energy norm"),
        ({"tolerance": 0.0}, "tolerance=0.0: expected a positive number"),
        ({"stiffness_ratio": -1.0}, "stiffness_ratio=-1.0: expected a positive number"),
    ],
)
def test_options_are_checked(options, message):
    with pytest.raises(ValueError, match=message):
        fm.ModelCheck(**options)


@pytest.mark.parametrize(
    "width, push, friction, verdict",
    [
        (1.0, (0.0, -0.05), 0.3, "enough"),  # equal blocks: no tendency to slip
        (2.2, (0.0, -0.05), 0.01, "enough"),
        (2.2, (0.0, -0.05), 0.3, "not enough"),
        (2.2, (0.1, -0.1), 0.05, "not enough"),
    ],
)
def test_frictionless_against_stick(width, push, friction, verdict):
    """Stick and the required friction predict the result of Coulomb's law."""
    found = {}
    for law in (fm.Frictionless(), fm.Coulomb(friction)):
        scene = pressed_blocks(**MESH, width_upper=1.0, width_lower=width, pair={"law": law})
        scene.loads["push"].value[:] = push
        scene.problem.solve()
        found[type(law)] = scene.problem
    problem, rough = found.values()
    before = problem.state()
    check = fm.ModelCheck(0.02, friction=friction)
    (assumption,) = (model_check := check.assess(problem)).assumptions
    assert np.array_equal(problem.state().u, before.u)
    assert model_check.verdict(assumption) == verdict and "stick requires" in assumption.indicator
    true = differences(problem, SolutionQuantities.of(problem), SolutionQuantities.of(rough))
    assert (true[ENERGY] <= 0.02) == (verdict == "enough")
    for name in QUANTITIES:
        assert 0.8 < assumption.errors[name] / true[name] < 1.25, (name, true, assumption.errors)


def test_frictionless_check_needs_a_pair_with_friction():
    for law, has_demand in ((fm.Coulomb(0.3), False), (Stick(), True)):
        scene = pressed_blocks(**MESH, pair={"law": law})
        scene.loads["push"].value[:] = (0.02, -0.05)
        scene.problem.solve()
        assert np.abs(scene.contact.shear_force).max() > 0.0
        assert (shear_demand(scene.problem) > 0.0) == has_demand


@pytest.mark.once
def test_friction_counts_the_slip_of_all_steps():
    """Shear of four steps, of which the last makes a quarter."""
    found = []
    for law, check in (
        (fm.Frictionless(), fm.ModelCheck(friction=0.3)),
        (fm.Coulomb(0.3), None),
    ):
        scene = pressed_blocks(
            **MESH,
            width_upper=1.0,
            width_lower=2.2,
            pair={"law": law},
            problem={"model_check": check},
        )
        for depth in (0.02, 0.04, 0.06, 0.08):
            scene.loads["push"].value[1] = -depth
            report = scene.problem.solve()
        found.append((scene.problem, report))
    (problem, report), (rough, _) = found
    true = differences(problem, SolutionQuantities.of(problem), SolutionQuantities.of(rough))
    (assumption,) = report.model_check.assumptions
    for name in QUANTITIES:
        assert 0.8 < assumption.errors[name] / true[name] < 1.25, (name, true, assumption.errors)


def test_a_tie_has_no_friction_to_neglect():
    data = read(two_blocks.build, **MESH)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u,
        [fm.TiedPair(data, "upper/bottom", "lower/top")],
        bcs=bcs, petsc_options_prefix="test_",
    )  # fmt: skip
    problem.solve()
    assert fm.ModelCheck(friction=0.3).assess(problem).assumptions == []
