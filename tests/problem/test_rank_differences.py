# SPDX-License-Identifier: MIT
"""Differences between ranks raise errors on all ranks."""

import numpy as np
import pytest
from array_meshes import bcs_of, blocks_of_arrays, grid, mesh_of, problem_on, tagged
from one_rank import COMM, either, raised_on_the_last_rank, several_ranks
from refusal import refused
from scenes import internal, neo_hookean, pair_options
from small_scenes import small_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat


@several_ranks
@pytest.mark.parametrize(
    "name, one, other",
    [
        ("sliding", "finite", "small"),
        ("discretization", fm.Discretization(), fm.Discretization(basis="standard")),
        ("discretization", "default", "other_codes"),
        ("discretization", fm.Discretization(points=5), fm.Discretization(points=7)),
        ("initial_gap", None, 0.0),
        ("search_radius", 1.0, 0.01),
        ("law", fm.Coulomb(0.3), fm.Coulomb(0.2)),
        ("law", fm.Coulomb(0.3), None),
    ],
)
def test_option_of_a_pair_that_differs_on_one_rank_is_refused(name, one, other):
    data = blocks_of_arrays()
    with refused(fm.MortarError, f"ContactPair: {name} is .* on rank 0 and .* on rank"):
        fm.ContactPair(data, "slave", "master", **{name: either(one, other)})


@several_ranks
def test_option_that_one_rank_refuses_is_refused_by_all():
    data = blocks_of_arrays()
    with raised_on_the_last_rank(ValueError, "basis='cubic': expected one of"):
        fm.ContactPair(data, "slave", "master", **pair_options(basis=either("dual", "cubic")))
    with raised_on_the_last_rank(ValueError, "gap='open': expected one of"):
        fm.TiedPair(data, "slave", "master", gap=either("kept", "open"))
    with raised_on_the_last_rank(ValueError, "algorithm='dense': expected one of"):
        problem_on(data, algorithm=either("saddle", "dense"))
    with refused(fm.MeshError, "no boundary 'sleeve'"):
        fm.ContactPair(data, either("slave", "sleeve"), "master")
    V = fm.vector_space(data.mesh, 1)
    with refused(fm.MeshError, "no boundary 'bass'"):
        fm.dirichlet(V, data, either("base", "bass"), (0.0, 0.0))
    with refused(fm.MortarError, "boundary is"):
        fm.dirichlet(V, data, either("base", "top"), (0.0, 0.0))


@several_ranks
def test_sides_that_differ_on_one_rank_are_refused():
    data = blocks_of_arrays()
    with refused(fm.MortarError, "ContactPair: slave_name is 'slave' on rank 0 and 'top'"):
        fm.ContactPair(data, either("slave", "top"), "master")


@several_ranks
@pytest.mark.parametrize(
    "name, one, other",
    [
        ("algorithm", "condensed", "saddle"),
        ("solver", "direct", "iterative"),
        ("linearization", "full", "frozen"),
        ("newton", fm.NewtonOptions(), fm.NewtonOptions(max_iterations=1)),
        ("petsc_options_prefix", "a_", "b_"),
        ("petsc_options", {}, {"ksp_type": "gmres"}),
        ("linear_bulk", None, True),
    ],
)
def test_option_of_a_problem_that_differs_on_one_rank_is_refused(name, one, other):
    data = blocks_of_arrays()
    with refused(fm.MortarError, f"ContactProblem: {name} is .* on rank 0 and .* on rank"):
        problem_on(data, **{name: either(one, other)})


@several_ranks
def test_pairs_conditions_and_forms_that_differ_on_one_rank_are_refused():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    pairs, bcs = [fm.ContactPair(data, "slave", "master")], bcs_of(data, u.function_space)
    with refused(fm.MortarError, "pairs is 1 on rank 0 and 0 on rank"):
        problem_on(data, either(pairs, []), u=u, bcs=bcs)
    with refused(fm.MortarError, "bcs is 2 on rank 0 and 1 on rank"):
        problem_on(data, pairs, u=u, bcs=either(bcs, bcs[:1]))

    def material(u, E, nu):
        return neo_hookean(u, either(E, 2.0 * E), nu)

    with refused(fm.MortarError, "residual is .*a form with the signature"):
        problem_on(data, pairs, u=u, bcs=bcs, material=material)


@several_ranks
@pytest.mark.parametrize("what", ["newton", "c_n"])
def test_option_that_is_set_later_and_differs_on_one_rank_is_refused(what):
    scene = small_blocks()
    if what == "newton":
        scene.problem.equations.newton = fm.NewtonOptions(max_iterations=either(30, 1))
    else:
        scene.contact.c_n = either(1e-3, 1e-2)
    with refused(fm.MortarError, f"{what}.* is .* on rank 0 and .* on rank"):
        scene.problem.solve()


@several_ranks
def test_steps_that_differ_on_one_rank_are_refused():
    scene = small_blocks()
    options = fm.SteppingOptions(either(0.5, 0.25))
    with refused(fm.MortarError, "follow_path: options is .*step=0.5.* and .*step=0.25"):
        fm.follow_path(scene.problem, lambda t: None, options)
    with refused(fm.MortarError, "follow_path: stop is 1.0 on rank 0 and 2.0 on rank"):
        fm.follow_path(
            scene.problem, lambda t: None, fm.SteppingOptions(0.5), stop=either(1.0, 2.0)
        )


@several_ranks
@pytest.mark.parametrize("which", ["rank 0", "owned"])
@pytest.mark.parametrize("what", ["load", "displacement"])
def test_function_that_is_not_set_on_all_ranks_is_refused(what, which):
    """Each rank would take its own values at common nodes: the result depends on the partition."""
    data = tagged(
        mesh_of(*grid(6, 6)),
        slave=lambda x: np.isclose(x[1], 1.0),
        base=lambda x: np.isclose(np.abs(x[0] - 0.5), 0.5) | np.isclose(x[1], 0.0),
    )
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V, v = u.function_space, ufl.TestFunction(u.function_space)
    given = fem.Function(V, name="given")
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    if what == "load":
        residual -= ufl.inner(given, v) * ufl.dx
    bcs = [fm.dirichlet(V, data, "base", given if what == "displacement" else (0.0, 0.0))]
    pair = fm.ContactPair(data, "slave", fm.Plane((0.0, 1.001), (0.0, -1.0)))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="given_")
    if which == "owned":
        given.x.array[: 2 * V.dofmap.index_map.size_local] = 0.01
    elif COMM.rank == 0:
        given.x.array[:] = 0.01
    name = "function 'given' of the residual" if what == "load" else "the prescribed displacement"
    with refused(fm.MortarError, f"{name} has other values at .* ghost dofs than", "scatter_forw"):
        problem.solve()
    given.x.array[:] = 0.01
    assert problem.solve().converged


@several_ranks
def test_values_in_cells_of_other_ranks_do_not_matter():
    """A modulus by cells, set on the cells of each rank."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    E = fem.Function(compat.scalar_space(data.mesh, 0, "DG"))
    E.x.array[: data.mesh.topology.index_map(2).size_local] = 100.0
    residual = internal(u, neo_hookean(u, E, 0.3))
    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, "slave", "master")], bcs=bcs_of(data, u.function_space),
        petsc_options_prefix="cells_",
    )  # fmt: skip
    assert problem.solve().converged


@several_ranks
def test_forms_have_equal_signatures_whichever_rank_compiles():
    """The compiler of dolfinx 0.5 replaces an element of the mesh on the ranks that compile."""
    data = blocks_of_arrays()
    if COMM.rank == 0:
        compat.settle_coordinate_element(data.mesh)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    assert problem_on(data, u=u, bcs=bcs_of(data, u.function_space)).solve().converged
