# SPDX-License-Identifier: MIT
"""Linear solves with the tangent and its transpose, and an independently assembled matrix."""

from mpi4py import MPI

import numpy as np
import pytest
import test_adhesion
from scenes import internal, linear_elastic, neo_hookean, pressed_blocks
from test_operators import dense
from test_reduced import loaded_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.la.system import SaddleSystem

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
    order = [z_dofs.ravel() for z_dofs in system.z_dofs]
    order = np.concatenate([np.empty(0, np.int64), *order])
    scale = np.concatenate([np.empty(0), *(c.components.scale.ravel() for c in contacts)])
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
            E_d, M_q, E_q = contact.operators.motion_force_derivatives(contact.z)
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
    """The node's multiplier has a prescribed component, which is not condensed."""
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
    """Solves use the compliance of the contact dofs; no condensed system is assembled."""
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
    for z_number in (-0.02, 0.12):
        lift.value = z_number
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


def test_bending_of_a_strip_500_times_as_long_as_thick():
    """Its residual is rounding, 7e-5 of the load; the solution was refused as that of a singular A.

    The force on a prop at the end, lifted by a tenth of the free deflection q / (8 E I), is that of
    a beam, 3/8 q / 10; the prop is round, and touches the last facet.
    """
    count, thickness, modulus = 250, 0.002, 1e5
    x = [(x, y) for y in (0.0, thickness) for x in np.linspace(0.0, 1.0, count + 1)]
    cells = [(i, i + 1, i + count + 2, i + count + 1) for i in range(count)]
    sides = {"left": [(0, count + 1)], "bottom": [(i, i + 1) for i in range(count)]}
    data = fm.mesh_from_arrays(x, cells, bodies={"strip": range(count)}, boundaries=sides)
    V = fm.vector_space(data.mesh, 2)
    u, load = fem.Function(V), fem.Constant(data.mesh, (0.0, -0.1))
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    residual = internal(u, linear_elastic(u, modulus, 0.3))
    residual -= ufl.inner(load, ufl.TestFunction(V)) * dx
    weight, bending = 0.1 * thickness, modulus / 0.91 * thickness**3 / 12.0
    prop = fm.Circle((1.0, -5.0 - 0.9 * weight / 8.0 / bending), 5.0)
    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, "bottom", prop)],
        bcs=[fm.dirichlet(V, data, "left", (0.0, 0.0))], petsc_options_prefix="strip_",
    )  # fmt: skip
    problem.solve()
    force = problem.contacts[0].total_force[1]
    assert abs(force / (0.0375 * weight) - 1.0) < 0.01
