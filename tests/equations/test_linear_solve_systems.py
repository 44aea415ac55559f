# SPDX-License-Identifier: MIT
"""Linear solves with obstacles, ties, mixed functions and multigrid; what is refused."""

from functools import partial

import numpy as np
import pytest
import test_mixed
import test_several_masters
import tied_scenes
from scenes import TIGHT, internal, linear_elastic, neo_hookean, pressed_blocks, read
from test_linear_solve import MESH, check, random_vector, rubbing
from test_obstacles import KINDS, block_under
from test_system import three_blocks

from dolfinx import fem

import fenics_mortar as fm


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("kind", ["open", "plane"])
def test_driven_obstacle(algorithm, kind):
    """Alone and with prescribed motions; units of angle and moment are those of the user."""
    obstacle = KINDS[kind]()
    problem = block_under(obstacle, algorithm=algorithm, pair={"law": fm.Coulomb(0.3)})
    obstacle.push(**({"y": -5.0, "moment": 0.1} if kind == "plane" else {"y": -5.0}))
    problem.solve()
    assert 0 < problem.equations.motions.driven.sum() < 3
    check(problem)


@pytest.mark.once
def test_two_obstacles_on_one_body():
    """One obstacle at rest and one driven, each with its own border of the matrix."""
    problem, _ = test_several_masters.disk(np.pi / 3, 0.02)
    problem.solve()
    check(problem)


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_several_pairs_and_ties(algorithm):
    data = read(three_blocks)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)),
        u,
        [
            fm.ContactPair(data, "middle/bottom", "low/top", law=fm.Coulomb(0.4)),
            fm.TiedPair(data, "high/bottom", "middle/top"),
        ],
        bcs=[
            fm.dirichlet(V, data, "low/bottom", np.zeros(2)),
            fm.dirichlet(V, data, "high/top", np.array([0.01, -0.1])),
        ],
        petsc_options_prefix="three_",
        algorithm=algorithm,
        newton=TIGHT,
    )
    problem.solve()
    check(problem)


@pytest.mark.once
def test_ties_with_a_crosspoint():
    data, pairs = tied_scenes.four_blocks()
    around = ["c/bottom", "d/bottom", "a/top", "b/top"]
    problem, _ = tied_scenes.tied(data, pairs, around, 0.05 * tied_scenes.STRAIN)
    problem.solve()
    check(problem)


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_mixed_function(algorithm):
    residual = partial(test_mixed.neo_hookean, nu=0.4999)
    scene, _ = test_mixed.pressed(residual, algorithm=algorithm)
    check(scene.problem, 1e-9)  # the pressure and its equation have other units


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_multigrid(algorithm):
    problem = rubbing(algorithm, solver="iterative", petsc_options={"ksp_rtol": 1e-13})
    check(problem)
    assert problem.equations.system.ksp.getType() == "fgmres"


def test_multigrid_of_tied_bodies():
    """The linear solver is the conjugate gradient method with the tolerance 1e-9."""
    data = tied_scenes.blocks((5, 8), width_lower=1.2)
    options = {"solver": "iterative", "petsc_options": {"ksp_rtol": 1e-13}}
    problem, _ = tied_scenes.tied(
        data, [fm.TiedPair(data, *tied_scenes.ROLES[0])], tied_scenes.ENDS,
        0.1 * tied_scenes.STRAIN, law=tied_scenes.linear, **options,
    )  # fmt: skip
    problem.solve()
    check(problem)
    assert problem.equations.system.ksp.getType() == "fgmres"


@pytest.mark.once
def test_transposed_solve_needs_about_as_many_iterations():
    problem = rubbing("condensed", solver="iterative")
    b, counts = random_vector(problem, 0, (1.0, 1.0, 1.0)), []
    for transpose in (False, True):
        problem.linear_solve(b, transpose=transpose)
        counts.append(problem.equations.system.ksp.getIterationNumber())
    assert counts[1] <= 1.5 * counts[0]


@pytest.mark.once
@pytest.mark.serial
def test_sensitivities_are_those_of_the_solution():
    """Sensitivities to the push and to a prescribed motion, and central differences."""
    step = 1e-4

    def solved(**change):
        lid = KINDS["plane"]()
        problem = block_under(lid)
        lid.push(y=-5.0 + change.get("y", 0.0), moment=0.1 + change.get("moment", 0.0))
        lid.move(x=1e-3 + change.get("x", 0.0))
        problem.solve()
        return problem, lid

    problem, _ = solved()
    functional = fm.LinearVector(q=np.array([[0.0, 1.0, 0.7]]))
    adjoint = problem.linear_solve(functional, transpose=True)
    for column, name in enumerate(("x", "y", "moment")):
        rhs = np.zeros((1, 3))
        rhs[0, column] = 1.0
        forward = problem.linear_solve(fm.LinearVector(q=rhs))
        (there, right), (back, left) = (solved(**{name: sign * step}) for sign in (1, -1))
        by_places = (right.place - left.place) / (2.0 * step)
        scale = np.abs(by_places).max()
        assert np.abs(forward.q[0] - by_places).max() < 1e-5 * scale
        by_z = (there.equations.contacts[0].z - back.equations.contacts[0].z) / (2.0 * step)
        assert np.abs(forward.z[0] - by_z).max() < 1e-5 * np.abs(by_z).max()
        gradient = adjoint.q[0, column]
        assert gradient == pytest.approx(by_places @ [0.0, 1.0, 0.7], abs=1e-5 * scale)


@pytest.mark.each
@pytest.mark.parametrize(
    "rhs, message",
    [
        ({"u": np.zeros(3)}, "u has the shape"),
        ({"z": []}, "z has values of 0 pairs: expected 1"),
        ({"z": [np.zeros((1, 2))]}, "z has the shape"),
        ({"q": np.zeros(3)}, "q has the shape"),
        ({"q": np.full((0, 3), 1.0), "z": [np.full((6, 2), np.nan)]}, "z is not finite"),
    ],
)
def test_invalid_right_hand_sides_are_refused(rhs, message):
    problem = pressed_blocks(**MESH).problem
    with pytest.raises(ValueError, match=message):
        problem.linear_solve(fm.LinearVector(**rhs))


@pytest.mark.parametrize("transpose", [False, True])
def test_free_body_is_singular(transpose):
    """Springs of Newton's method must not conceal the singularity."""
    data = read(three_blocks)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)),
        u,
        [fm.ContactPair(data, "middle/bottom", "low/top")],
        bcs=[fm.dirichlet(V, data, body, np.zeros(2)) for body in ("low/bottom", "high/top")],
        petsc_options_prefix="free_",
    )
    with pytest.raises(fm.MortarError, match="was not solved"):
        problem.linear_solve(
            fm.LinearVector(u=np.ones(problem.equations.bulk.num_owned)), transpose=transpose
        )
