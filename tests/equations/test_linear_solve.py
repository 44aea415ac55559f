# SPDX-License-Identifier: MIT
"""Linear solves with the tangent and its transpose, and an independently assembled matrix."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
import test_adhesion
import test_mixed
import test_several_masters
import tied_scenes
from scenes import TIGHT, internal, linear_elastic, neo_hookean, pressed_blocks, read
from test_obstacles import KINDS, block_under
from test_operators import dense
from test_reduced import loaded_blocks
from test_system import three_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.la.saddle import SaddleSystem

comm = MPI.COMM_WORLD
MESH = {"n_upper": 5, "n_lower": 8, "layers_upper": 3, "layers_lower": 3}
# Relative error of one solve [1]; condition numbers are up to 1e5.
EXACT = 1e-10


def assembled(problem):
    """A on every rank: dofs by global number, multipliers in the order of pairs, places."""
    contacts, motions = problem.equations.contacts, problem.equations.motions
    problem.equations.bulk.assemble_tangent()
    system = SaddleSystem(problem.equations.bulk, contacts, "reference_", {})
    K, B_T, C, A_z = (dense(block) for block in system.blocks())
    order = [(2 * place[:, None] + np.arange(2)).ravel() for place in system.places]
    order = np.concatenate([np.empty(0, np.int64), *order])
    scale = np.concatenate([np.empty(0), *(np.repeat(system.scale(c), 2) for c in contacts)])
    B_T, A_z = B_T[:, order] / scale, A_z[np.ix_(order, order)] / scale
    C = C[order]
    fixed = np.concatenate(
        comm.allgather(problem.equations.bulk.prescribed_dofs + problem.equations.bulk.first)
    )
    K[fixed], B_T[fixed] = 0.0, 0.0
    K[fixed, fixed] = 1.0
    n, m, k = len(K), len(A_z), 3 * len(motions.obstacles)
    A = np.zeros((n + m + k, n + m + k))
    A[:n, :n], A[:n, n : n + m], A[n : n + m, :n], A[n : n + m, n : n + m] = K, B_T, C, A_z
    first = n
    for contact in contacts:
        count = 2 * contact.slave.num_nodes
        if contact.obstacle is not None:
            own = slice(start := n + m + 3 * motions.obstacles.index(contact.obstacle), start + 3)
            units = np.array([1.0, 1.0, contact.arm])
            E_d, M_q, E_q = contact.on_obstacle.motion_force_derivatives(contact.z)
            A[first : first + count, own] = contact.rows.by_motions().reshape(-1, 3) * units
            rows = units[:, None] * E_d.reshape(3, -1)
            np.add.at(A[own], (slice(None), contact.slave.dofs.ravel()), rows)
            A[own, first : first + count] = units[:, None] * (M_q * contact.acts[:, None]).reshape(
                3, -1
            )
            A[own, own] += units[:, None] * E_q * units
        first += count
    given = n + m + np.flatnonzero(~motions.driven.ravel())
    A[given] = 0.0
    A[given, given] = 1.0
    return A


def flat(problem, x):
    """All entries of a vector in the order of ``assembled``."""
    u = np.concatenate(comm.allgather(x.u))
    return np.concatenate([u, *(np.ravel(z) for z in x.z), np.ravel(x.q)])


def random_vector(problem, seed, sizes):
    """Random entries, equal on any number of ranks; ``sizes``: of u, z, q."""
    rng, bulk = np.random.default_rng(seed), problem.equations.bulk
    u = sizes[0] * rng.uniform(-1.0, 1.0, bulk.r.getSize())
    z = [sizes[1] * rng.uniform(-1.0, 1.0, c.z.shape) for c in problem.equations.contacts]
    q = sizes[2] * rng.uniform(-1.0, 1.0, problem.equations.motions.places.shape)
    return fm.LinearVector(u[bulk.first :][: bulk.num_owned], z, q)


def check(problem, exact=EXACT):
    """Both solves against the matrix, and against each other; the state stays."""
    u, z = problem.equations.bulk.u.x.array.copy(), [c.z.copy() for c in problem.equations.contacts]
    A = assembled(problem)
    b, c = (random_vector(problem, seed, (1.0, 1.0, 1.0)) for seed in (1, 2))
    for _ in range(2):  # factors are those of the state, independent of earlier ones
        x, y = problem.linear_solve(b), problem.linear_solve(c, transpose=True)
    for matrix, solution, rhs in ((A, x, b), (A.T, y, c)):
        found, wanted = flat(problem, solution), np.linalg.solve(matrix, flat(problem, rhs))
        parts = (
            problem.equations.bulk.r.getSize(),
            len(A) - 3 * len(problem.equations.motions.obstacles),
        )
        for mine, theirs in zip(np.split(found, parts), np.split(wanted, parts), strict=True):
            assert np.abs(mine - theirs).max(initial=0.0) <= exact * np.abs(theirs).max(initial=1.0)
    assert b.dot(y, comm) == pytest.approx(x.dot(c, comm), rel=exact)
    assert (problem.equations.bulk.u.x.array == u).all()
    assert all(
        (contact.z == before).all() for contact, before in zip(problem.equations.contacts, z)
    )


def rubbing(algorithm, *, pair=None, degree=1, material=neo_hookean, **options):
    """Blocks with some nodes set to sliding and open: not in equilibrium."""
    pair = {"law": fm.Coulomb(0.2), **(pair or {})}
    scene = pressed_blocks(
        pair=pair, problem={"algorithm": algorithm, **options}, degree=degree, material=material,
        rotation=0.04, **MESH,
    )  # fmt: skip
    for part in (0.5, 1.0):
        scene.loads["push"].value[:] = (0.02 * part, -0.06 * part)
        scene.problem.solve(accept_violations=True)
    contact = scene.contact
    numbers = np.arange(contact.slave.num_nodes)
    last, branch = numbers == numbers[-1], contact.branch
    if contact.pair.law.has_friction:
        branch = np.where((numbers == 1) | (numbers == 2), 1, branch)
    z = np.where(last[:, None], 0.0, contact.z)
    contact.change(active=contact.active & ~last, z=z, branch=branch)
    return scene.problem


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_friction(algorithm):
    problem = rubbing(algorithm)
    (contact,) = problem.equations.contacts
    assert contact.sticking.any() and contact.sliding.any() and not contact.active.all()
    check(problem)


@pytest.mark.once
@pytest.mark.parametrize(
    "pair, options",
    [
        ({"basis": "standard"}, {}),
        ({}, {"degree": 2}),
        ({"basis": "vertices"}, {"degree": 2}),
        ({"integration": "nodes"}, {}),
        ({"sliding": "small", "law": fm.Frictionless()}, {"linear_bulk": True}),
    ],
)
def test_multipliers_of_all_kinds(pair, options):
    check(rubbing(None, pair=pair, **options))


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_slave_node_on_a_symmetry_plane(algorithm):
    """Its multiplier has a prescribed component, which condensation leaves out."""
    law = test_adhesion.Sticky(0.3)
    problem, lift = test_adhesion.columns(law, algorithm=algorithm, linear_bulk=False)
    lift.value = -0.02
    problem.solve()
    (contact,) = problem.equations.contacts
    assert (contact.free[contact.active] == 0.0).any()
    check(problem)
    lift.value = 0.12
    problem.solve()
    assert contact.attracted.any()
    check(problem)


@pytest.mark.parametrize(
    "pair, options",
    [
        ({}, {}),
        ({"basis": "standard"}, {"algorithm": "saddle"}),
        ({"basis": "vertices"}, {"degree": 2}),
        ({"slip": "operators", "law": fm.Tresca(1.0)}, {}),
        ({"sliding": "small", "law": fm.Frictionless()}, {}),
    ],
)
def test_linear_bulk_factored_once(pair, options):
    """By the compliance of the contact dofs; the condensed system is not assembled."""
    given = {"linear_bulk": True, "material": linear_elastic, **options}
    problem = rubbing(given.pop("algorithm", None), pair=pair, **given)
    assert problem.equations.reduced_tangent() is not None
    matrix = vars(problem.equations.system).get("matrix")
    check(problem)
    assert vars(problem.equations.system).get("matrix") is matrix


def test_linear_bulk_with_a_symmetry_plane_and_adhesion():
    """Prescribed components of multipliers, and multipliers of open nodes."""
    law = test_adhesion.Sticky(0.3)
    problem, lift = test_adhesion.columns(law, material=linear_elastic, linear_bulk=True)
    for place in (-0.02, 0.12):
        lift.value = place
        problem.solve()
        (contact,) = problem.equations.contacts
        assert problem.equations.reduced_tangent() is not None
        check(problem)
    assert contact.attracted.any() and (contact.free == 0.0).any()


def test_factors_of_a_bulk_that_is_not_linear_are_not_used():
    """The user may call for them: Newton's method then converges, but they are no tangent."""
    problem, lift = test_adhesion.columns(fm.Frictionless(), linear_bulk=True)
    lift.value = -0.02
    problem.solve()
    assert problem.equations.reduced_tangent() is None
    check(problem)


def test_factors_of_other_data_are_not_used():
    """The modulus is another one than that of the factors."""
    problem, loads = loaded_blocks(True)
    loads["push"].value[1] = -0.03
    problem.solve()
    assert problem.equations.reduced_tangent() is not None
    loads["modulus"].value *= 2.0
    assert problem.equations.reduced_tangent() is None
    check(problem)
    loads["modulus"].value /= 2.0
    assert problem.equations.reduced_tangent() is not None
    check(problem)


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
    """One at rest, one driven, each with a separate border."""
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
    assert problem.equations.system.ksp.getType() == "gmres"


def test_multigrid_of_tied_bodies():
    """Its cycle is conjugate gradients with the tolerance 1e-9."""
    data = tied_scenes.blocks((5, 8), width_lower=1.2)
    options = {"solver": "iterative", "petsc_options": {"ksp_rtol": 1e-13}}
    problem, _ = tied_scenes.tied(
        data, [fm.TiedPair(data, *tied_scenes.ROLES[0])], tied_scenes.ENDS,
        0.1 * tied_scenes.STRAIN, law=tied_scenes.linear, **options,
    )  # fmt: skip
    problem.solve()
    check(problem)
    assert problem.equations.system.ksp.getType() == "gmres"


@pytest.mark.once
def test_transposed_iterations_are_about_as_many():
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
    "rhs, words",
    [
        ({"u": np.zeros(3)}, "u has the shape"),
        ({"z": []}, "z has values of 0 pairs: expected 1"),
        ({"z": [np.zeros((1, 2))]}, "z has the shape"),
        ({"q": np.zeros(3)}, "q has the shape"),
        ({"q": np.full((0, 3), 1.0), "z": [np.full((6, 2), np.nan)]}, "z is not finite"),
    ],
)
def test_wrong_right_hand_sides_are_refused(rhs, words):
    problem = pressed_blocks(**MESH).problem
    with pytest.raises(ValueError, match=words):
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
