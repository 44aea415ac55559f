# SPDX-License-Identifier: MIT
"""Pairs, conditions, results and obstacles: arguments of a wrong type."""

import numpy as np
import pytest
from array_meshes import bcs_of, blocks_of_arrays, problem_on
from one_rank import COMM, either, several_ranks
from refusal import refused, refused_with_address
from scenes import internal, linear_elastic, neo_hookean
from small_scenes import small_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat


@pytest.mark.parametrize("kinds", [(fm.ContactPair, fm.ContactPair), (fm.ContactPair, fm.TiedPair)])
def test_the_same_two_sides_paired_both_ways_are_refused(kinds):
    data = blocks_of_arrays()
    sides = ("slave", "master"), ("master", "slave")
    pairs = [kind(data, *names) for kind, names in zip(kinds, sides, strict=True)]
    with refused(fm.MortarError, "same two surfaces with exchanged roles"):
        problem_on(data, pairs)


@pytest.mark.parametrize("move", [0.1, 1e4, 0.0])
@pytest.mark.parametrize("material", [neo_hookean, linear_elastic])
def test_rigid_motion_without_pairs_has_no_violations(move, material):
    """Forces are rounding then, and so is their sum."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    names = ("base", "master", "slave", "top")
    bcs = [fm.dirichlet(u.function_space, data, name, (move, 0.0)) for name in names]
    report = problem_on(data, [], u=u, bcs=bcs, material=material).solve()
    assert report.certificate.violations() == []


def test_sum_of_forces_is_checked_without_pairs():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    names = ("base", "master", "slave", "top")
    bcs = [fm.dirichlet(u.function_space, data, name, (0.1, 0.0)) for name in names]
    problem = problem_on(data, [], u=u, bcs=bcs)
    problem.solve()
    u.x.array[: 6 if COMM.rank == 0 else 0] += 0.05
    u.x.scatter_forward()
    problem.equations.evaluate(start=False)
    assert any("balance" in message for message in problem.certificate().violations())


@pytest.mark.parametrize("value, component", [((0.1, 0.0), None), (0.1, 0)])
def test_contradicting_conditions_are_reported_once(value, component):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V = u.function_space
    bcs = [*bcs_of(data, V), fm.dirichlet(V, data, "base", value, component)]
    problem = problem_on(data, u=u, bcs=bcs)
    message = "conditions 0 and 2 prescribe different values of the same component at 5 nodes"
    (note,) = (note for note in problem.solve().notes if message in note)
    assert "the later one, is used" in note
    assert not any(message in note for note in problem.solve().notes)


def test_agreeing_conditions_are_not_reported():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V = u.function_space
    bcs = [*bcs_of(data, V), fm.dirichlet(V, data, "base", 0.0, 0)]
    assert not any("conditions" in note for note in problem_on(data, u=u, bcs=bcs).solve().notes)


@pytest.mark.each
@pytest.mark.parametrize(
    "boundary, value, component, message",
    [
        ("base", "zero", None, "prescribed value is 'zero'; expected numbers"),
        ("base", (1j, 0.0), None, "prescribed value is .*; expected numbers"),
        ("base", lambda x: x, None, "prescribed value is .*; expected numbers"),
        ("base", 0.0, [0, 1], r"component is \[0, 1\]; expected 0, 1 or None"),
        (None, (0.0, 0.0), None, "no boundary None"),
        (1.5, (0.0, 0.0), None, "no boundary 1.5"),
        (True, (0.0, 0.0), None, "no boundary True"),
    ],
)
def test_invalid_condition_is_refused(boundary, value, component, message):
    data = blocks_of_arrays()
    with refused_with_address(fm.MeshError, message):
        fm.dirichlet(fm.vector_space(data.mesh, 1), data, boundary, value, component)


@pytest.mark.parametrize(
    "call, message",
    [
        (
            lambda d, V: fm.dirichlet(V, None, "base", (0.0, 0.0)),
            "data=None: expected the MeshData",
        ),
        (
            lambda d, V: fm.dirichlet(None, d, "base", (0.0, 0.0)),
            "V=None: expected a space of dolfinx",
        ),
        (lambda d, V: fm.vector_space(d.mesh, 0), "degree=0: expected a whole number, at least 1"),
        (lambda d, V: fm.vector_space(d, 1), "mesh=.*: expected a mesh of dolfinx"),
        (
            lambda d, V: fm.MeshData(d.mesh, None, d.facet_tags, {}, ["a"]),
            "boundaries=.*dictionary",
        ),
        (
            lambda d, V: fm.MeshData(d.mesh, None, d.facet_tags, {}, {"a": 1.5}),
            r"\['a'\]=1.5: expected an in",
        ),
        (lambda d, V: fm.read_gmsh("x.msh", None), "comm=None: expected a communicator"),
        (lambda d, V: fm.read_gmsh("x.msh", COMM, rank=0.5), "rank=0.5: expected an integer"),
        (lambda d, V: fm.contact_table(None), "problem=None: expected a ContactProblem"),
        (lambda d, V: fm.ResultsWriter("a", None), "problem=None: expected a ContactProblem"),
        (lambda d, V: fm.plot(None, "a"), "problem=None: expected a ContactProblem"),
    ],
)
def test_argument_of_a_wrong_type_is_refused(call, message):
    data = blocks_of_arrays()
    with refused_with_address(ValueError, message):
        call(data, fm.vector_space(data.mesh, 1))


@pytest.mark.each
@pytest.mark.parametrize(
    "options, message",
    [
        ({"petsc_options": {3: 1}}, "petsc_options with 3: expected a name such as 'ksp_rtol'"),
        ({"petsc_options": {"-ksp_rtol": 1}}, "petsc_options with '-ksp_rtol': expected a name"),
        ({"displacement": "u"}, "displacement='u': expected the number of a sub-space"),
        ({"displacement": 3}, "displacement=3: the function u is not mixed"),
        ({"model_check": fm.ModelCheck}, "model_check=.*: expected an instance of ModelCheck"),
    ],
)
def test_option_of_a_wrong_type_is_refused(options, message):
    with refused(ValueError, message):
        problem_on(blocks_of_arrays(), **options)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_numbers_of_a_form_that_are_not_finite_are_refused(number):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    v = ufl.TestFunction(u.function_space)
    load = ufl.inner(ufl.as_vector((number, 0.0)), v) * ufl.ds
    residual = internal(u, linear_elastic(u, 100.0, 0.3)) - load
    message = f"the residual contains the number {number} in an integral over the boundary"
    with refused(ValueError, message):
        fm.ContactProblem(residual, u, [], petsc_options_prefix="test_numbers_")


# Results and tools


def test_checkpoint_without_a_name_is_refused():
    problem = small_blocks().problem
    for use in (fm.save_state, fm.load_state):
        with refused(ValueError, "path=3: expected the name of a file"):
            use(problem, 3)


def test_results_of_a_wrong_type_are_refused(shared_path):
    problem = small_blocks().problem
    with refused(ValueError, "path=None: expected the name of a file"):
        fm.ResultsWriter(None, problem)
    with refused(ValueError, "fields=3: expected a dictionary of UFL expressions"):
        fm.ResultsWriter(shared_path / "a", problem, 3)
    other = fem.Function(fm.vector_space(blocks_of_arrays().mesh, 1))
    with refused(fm.MortarError, "field 'a' cannot be .* function or constant of another mesh"):
        fm.ResultsWriter(shared_path / "a", problem, {"a": other[0]})
    writer = fm.ResultsWriter(shared_path / "a", problem)
    for time in (np.nan, "1", None):
        with refused(ValueError, "time=.*: expected a finite number"):
            writer.write(time)


@several_ranks
def test_fields_that_differ_on_one_rank_are_refused(shared_path):
    scene = small_blocks()
    with refused(fm.MortarError, "number of fields is 0 on rank 0 and 1 on rank"):
        fm.ResultsWriter(shared_path / "a", scene.problem, either({}, {"a": scene.u[0]}))


def tool_of(**more):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V = u.function_space
    given = {
        "obstacle": fm.Plane((0, 1), (0, 1)),
        "residual": internal(u, linear_elastic(u, 100.0, 0.3)),
        "u": u,
        "data": data,
        "surface": "master",
        "bcs": bcs_of(data, V),
        **{name: value(data, u) for name, value in more.items()},
    }
    return fm.ElasticObstacle(**given)


@pytest.mark.each
@pytest.mark.parametrize(
    "more, kind, message",
    [
        ({"obstacle": lambda d, u: None}, ValueError, "obstacle=None: expected a rigid obstacle"),
        ({"u": lambda d, u: None}, ValueError, "u=None: expected a function of dolfinx"),
        ({"data": lambda d, u: blocks_of_arrays()}, fm.MeshError, "another mesh than u"),
        ({"residual": lambda d, u: ufl.inner(u, u) * ufl.dx}, ValueError, "one test function"),
        (
            {
                "residual": lambda d, u: (
                    u[0] * ufl.TestFunction(compat.scalar_space(d.mesh, 1)) * ufl.dx
                )
            },
            ValueError,
            "test function of the residual belongs to another space",
        ),
        (
            {"bcs": lambda d, u: bcs_of(d, u.function_space)[0]},
            ValueError,
            "bcs=.*: expected a list of D",
        ),
    ],
)
def test_tool_of_a_wrong_type_is_refused(more, kind, message):
    with refused_with_address(kind, message):
        tool_of(**more)


def test_a_body_with_negative_stiffness_is_named():
    """The other body has a positive one."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    X = ufl.SpatialCoordinate(data.mesh)
    E = ufl.conditional(ufl.gt(X[1], 1.0), 100.0, -50.0)
    residual = internal(u, linear_elastic(u, E, 0.3))
    with refused(fm.MortarError, r"all stiffnesses of the body around \(1, 0.5\) are negative"):
        fm.ContactProblem(
            residual, u, [fm.ContactPair(data, "slave", "master")],
            bcs=bcs_of(data, u.function_space), petsc_options_prefix="negative_",
        )  # fmt: skip


def test_nodes_pressed_twice_along_the_same_normal_are_named():
    """By two obstacles with the same surface: the system is singular. On all ranks the first."""
    data = blocks_of_arrays()
    planes = [fm.Plane((0.0, 1.0), (0.0, 1.0), name=name) for name in ("one", "two")]
    u = fem.Function(fm.vector_space(data.mesh, 1))
    pairs = [fm.ContactPair(data, "slave", plane) for plane in planes]
    problem = problem_on(data, pairs, u=u, bcs=bcs_of(data, u.function_space))
    named = "4 nodes of 'slave' are pressed along the same normal by 'one' and 'two', one at "
    with refused(fm.NotConvergedError, named, r"one at \(0.4, 1\)", "leave out one"):
        problem.solve()


def test_a_function_among_the_conditions_is_refused():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    with refused_with_address(ValueError, "expected a list of Dirichlet conditions"):
        problem_on(data, u=u, bcs=[*bcs_of(data, u.function_space), u])
