# SPDX-License-Identifier: MIT
"""Support reactions by name: exact loads, and balance with all other forces."""

from itertools import pairwise

import numpy as np
import pytest
import revolved
from few_cells import Blocks
from refusal import COMM, refused
from scenes import TIGHT, internal, linear_elastic, neo_hookean

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mesh

E, NU = 100.0, 0.3
DX = ufl.dx(metadata={"quadrature_degree": 4})


def same_everywhere(reaction):
    """The reaction, after a check that it is the same on all ranks, to the last digit."""
    mine = *reaction.force, reaction.moment, *reaction.about
    assert set(COMM.allgather(mine)) == {mine}
    return reaction


def stack(left=0.0, L=1.0, columns=(3, 4)):
    """Two blocks of width L, the lower of height L, the upper of 0.5 L, with the axis at x = 0."""
    grids = [
        Grid("lower", block(columns[0], 2, width=L, height=L, corner=(left * L, 0.0))),
        Grid("upper", block(columns[1], 2, width=L, height=0.5 * L, corner=(left * L, L))),
    ]
    return mesh(grids)


def uniaxial(data, push, modulus=E, degree=1, **options):
    """Blocks that may expand to the right, with the top moved by ``push``."""
    V = fm.vector_space(data.mesh, degree)
    u, thickness = fem.Function(V), options.get("thickness", 1.0)
    bcs = [fm.dirichlet(V, data, ["lower/left", "upper/left"], 0.0, 0)]
    bcs += [fm.dirichlet(V, data, "lower/bottom", 0.0, 1)]
    bcs += [fm.dirichlet(V, data, "upper/top", push, 1)]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    residual = thickness * internal(u, linear_elastic(u, modulus, NU))
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, newton=TIGHT, petsc_options_prefix="reaction_", **options
    )
    problem.solve()
    return problem


@pytest.mark.parametrize(
    "L, modulus, degree, thickness",
    [(1.0, E, 1, None), (1e-3, 1e9 * E, 2, 0.25), (1e4, 1e-6 * E, 1, None)],
)
def test_reaction_is_the_exact_load_in_any_units(L, modulus, degree, thickness):
    """Plane strain and free sides: uniform stress, E / (1 - nu^2) times the strain."""
    data, strain = stack(left=2.0, L=L), 0.01
    options = {} if thickness is None else {"thickness": thickness * L}
    problem = uniaxial(data, -1.5 * L * strain, modulus, degree, **options)
    load = modulus / (1 - NU**2) * strain * L * options.get("thickness", 1.0)
    middle = 2.5 * L + 0.5 * L * NU / (1 - NU) * strain  # the sides move
    top = same_everywhere(problem.reaction("upper/top"))
    assert top.force == pytest.approx((0.0, -load), rel=1e-9, abs=1e-11 * load)
    assert top.moment == pytest.approx(-load * middle, rel=1e-9)
    bottom = same_everywhere(problem.reaction("lower/bottom", about=(middle, 7.0 * L)))
    assert bottom.force == pytest.approx(-top.force, rel=1e-9, abs=1e-11 * load)
    assert abs(bottom.moment) < 1e-9 * load * L
    assert bottom.about.tolist() == [middle, 7.0 * L]


def test_only_prescribed_components_count_and_corners_count_for_each_name():
    """Upper corners are prescribed in x by the left side, and in y by the top."""
    problem = uniaxial(stack(), -0.015)
    top, left = problem.reaction("upper/top"), problem.reaction("upper/left")
    both, twice = (
        problem.reaction(names) for names in (["upper/top", "upper/left"], ["upper/top"] * 2)
    )
    corner = top.force + left.force - both.force
    assert top.force == pytest.approx(twice.force, rel=1e-14)
    assert abs(corner[1]) > 0.1 * abs(top.force[1])  # the y of the corner is in both of them
    assert both.force[1] == pytest.approx(top.force[1], rel=1e-12)
    assert left.force[1] == pytest.approx(corner[1], rel=1e-9)
    tag = problem.equations.contacts[0].pair.data.boundaries["upper/top"]
    assert np.array_equal(problem.reaction(tag).force, top.force)


def loaded(law, supports, degree=1):
    """Two blocks with weight, a traction and a driven circle on top, held by ``supports``."""
    data = stack(columns=(4, 3))
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    weight, pull = ufl.as_vector((0.3, -1.0)), ufl.as_vector((0.5, 0.2))
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags)
    residual = internal(u, neo_hookean(u, E, NU)) - ufl.inner(weight, v) * DX
    residual -= ufl.inner(pull, v) * ds(data.boundary_tag("lower/right"))
    ball = fm.Circle((0.5, 3.5), 2.0)
    ball.push(y=-2.0)
    pairs = [
        fm.ContactPair(data, "upper/bottom", "lower/top", law=law),
        fm.ContactPair(data, "upper/top", ball, law=law),
    ]
    bcs = [fm.dirichlet(V, data, name, 0.0, component) for name, component in supports]
    problem = fm.ContactProblem(
        residual, u, pairs, bcs=bcs, newton=TIGHT, petsc_options_prefix="reaction_"
    )
    problem.solve()
    loads = 1.5 * np.array([0.3, -1.0]) + np.array([0.5, 0.2])
    return problem, ball, loads


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("law", [fm.Frictionless(), fm.Coulomb(0.4)])
def test_reactions_loads_and_obstacles_balance(law, degree):
    """With contact, friction, body load, traction and a driven obstacle, to rounding."""
    supports = [("lower/bottom", 0), ("lower/bottom", 1), ("upper/left", 0), ("lower/left", 0)]
    problem, ball, loads = loaded(law, supports, degree)
    names = sorted({name for name, _ in supports})
    all_supports = same_everywhere(problem.reaction(names))
    defect = all_supports.force + loads - ball.reaction[:2]
    assert np.abs(defect).max() < 1e-11 * np.abs(all_supports.force).max()
    side = problem.reaction("upper/left")  # no corner with another support
    on_upper = side.force + problem.contacts[0].total_force - ball.reaction[:2]
    weight = 0.5 * np.array([0.3, -1.0])
    assert np.abs(on_upper + weight)[0] < 1e-11 * np.abs(all_supports.force).max()
    if isinstance(law, fm.Coulomb):
        assert abs(problem.contacts[0].total_force[0]) > 1e-3


def test_reaction_on_bodies_of_revolution():
    """Cylinders of radius 1 under axial strain: E times the strain times the area."""
    data, strain = stack(), 0.01
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, ["lower/left", "upper/left"], 0.0, 0)]
    bcs += [fm.dirichlet(V, data, "lower/bottom", 0.0, 1)]
    bcs += [fm.dirichlet(V, data, "upper/top", -1.5 * strain, 1)]
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.linear_elastic(u, E, NU)),
        u,
        [fm.ContactPair(data, "upper/bottom", "lower/top")],
        bcs=bcs,
        geometry="axisymmetric",
        newton=TIGHT,
        petsc_options_prefix="reaction_",
    )
    problem.solve()
    load = E * strain * np.pi
    top, bottom = map(problem.reaction, ("upper/top", "lower/bottom"))
    assert same_everywhere(top).force[1] == pytest.approx(-load, rel=1e-9)
    assert bottom.force[1] == pytest.approx(load, rel=1e-9)
    assert top.moment == bottom.moment == 0.0
    contact = problem.contacts[0].total_force
    assert contact[1] == pytest.approx(load, rel=1e-9)


@pytest.mark.parametrize("part", [0, 1])
def test_reaction_in_a_mixed_space(part):
    """Displacement first or second; a prescribed pressure at the support exerts no force."""
    data = stack(columns=(4, 3))
    elements = [("Lagrange", 2, (2,)), ("Lagrange", 1)]
    W = fm.mixed_space(data.mesh, *(elements if part == 0 else elements[::-1]))
    w = fem.Function(W)
    split, tests = ufl.split(w), ufl.TestFunctions(W)
    (u, v), (p, q) = (split[part], tests[part]), (split[1 - part], tests[1 - part])
    stress = 80.0 * ufl.sym(ufl.grad(u)) + p * ufl.Identity(2)
    residual = (ufl.inner(stress, ufl.grad(v)) + q * (ufl.div(u) - 0.01 * p)) * DX
    push = fem.Function(W.sub(part).collapse()[0])
    push.interpolate(lambda x: np.stack([0.0 * x[0] + 0.01 * x[1], -0.02 * (x[1] > 1.2)]))
    names = "lower/bottom", "upper/top"
    bcs = [fm.dirichlet(W.sub(part), data, name, push) for name in names]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(0.3))
    problem = fm.ContactProblem(
        residual, w, [pair], bcs=bcs, newton=TIGHT, displacement=part,
        petsc_options_prefix="reaction_",
    )  # fmt: skip
    problem.solve()
    bottom, top = (same_everywhere(problem.reaction(name)) for name in names)
    force = problem.contacts[0].total_force
    assert force[1] > 0.5 and abs(force[0]) > 0.01
    assert top.force == pytest.approx(-force, rel=1e-10)
    assert bottom.force == pytest.approx(force, rel=1e-10)


@pytest.mark.parametrize("scheme", ["generalized_alpha", "massless"])
def test_reactions_include_inertia(scheme):
    """By the trapezoidal rule: the momentum changes by the mean of supports and loads."""
    data = mesh([Grid("bar", block(2, 5, width=1.0, height=2.0))])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    load = np.array([0.2, -1.0])
    residual = internal(u, neo_hookean(u, E, NU)) - ufl.inner(ufl.as_vector(load), v) * DX
    plane = fm.Plane((0.0, 3.0), (0.0, -1.0))  # out of reach
    problem = fm.ContactProblem(
        residual,
        u,
        [fm.ContactPair(data, "bar/top", plane)],
        bcs=[fm.dirichlet(V, data, "bar/bottom", (0.0, 0.0))],
        newton=TIGHT,
        petsc_options_prefix="reaction_",
    )
    motion, dt = fm.Dynamics(problem, 1.0, scheme=scheme, rho_inf=1.0), 0.02
    motion.step(dt)  # the first acceleration is computed here
    momenta, forces = [motion.momentum()], [problem.reaction("bar/bottom").force + 2.0 * load]
    for _ in range(4):
        motion.step(dt)
        momenta.append(motion.momentum())
        forces.append(same_everywhere(problem.reaction("bar/bottom")).force + 2.0 * load)
    for (p, q), (f, g) in zip(pairwise(momenta), pairwise(forces), strict=True):
        assert (q - p)[:2] == pytest.approx(0.5 * dt * (f + g), abs=1e-10)
    assert np.abs(forces[0]).max() > 0.1  # not in static equilibrium


def test_errors_name_the_boundaries():
    problem = uniaxial(stack(), -0.015)
    with refused(fm.MeshError, "no boundary 'top'", "'lower/bottom', .*'upper/top'"):
        problem.reaction("top")
    with refused(fm.MeshError, "no boundary is given"):
        problem.reaction([])
    advice = "expected one with a Dirichlet condition: .'lower/fixed', 'upper/moved'.$"
    with refused(fm.MeshError, "'lower/top \\+ upper/bottom' has no prescribed dof", advice):
        Blocks(3).problem.reaction(["lower/top", "upper/bottom"])
    with refused(ValueError, "about=3", "expected a point"):
        problem.reaction("upper/top", about=3)
    with refused(ValueError, "expected a point"):
        problem.reaction("upper/top", about=(0.0, np.nan))
    with refused(fm.MeshError, "another mesh"):
        problem.reaction("upper/top", data=stack())


def test_a_problem_without_pairs_needs_the_names():
    data = stack()
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, name, (0.0, -0.01 * k))
        for k, name in enumerate(("lower/bottom", "lower/top", "upper/bottom", "upper/top"))
    ]
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, E, NU)), u, [], bcs=bcs, petsc_options_prefix="reaction_"
    )
    problem.solve()
    with refused(fm.MeshError, "without pairs", "expected data="):
        problem.reaction("upper/top")
    forces = [problem.reaction(n, data=data).force for n in ("lower/bottom", "lower/top")]
    assert forces[0] == pytest.approx(-forces[1], rel=1e-10, abs=1e-12)
    assert forces[0][1] > 0.5


@pytest.mark.usefixtures("several_ranks")
def test_names_are_the_same_on_all_ranks():
    problem = uniaxial(stack(), -0.015)
    with refused(fm.MortarError, "reaction: boundary is"):
        problem.reaction("upper/top" if COMM.rank else "lower/bottom")


@pytest.mark.parametrize("follows", [True, False])
def test_torque_of_the_guide_is_the_moment_of_the_reaction(follows):
    """A clamped bar, bent by tractions on its end (features/supports of the guide).

    Steps turn the end by 0.04, which changes the moment by 0.1 % in a step.
    """
    data = mesh([Grid("bar", block(2, 18, width=0.25, height=3.0))])
    V = fm.vector_space(data.mesh, 2)
    u, v, X = fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(data.mesh)
    top = ufl.ds(subdomain_data=data.facet_tags, degree=4)(data.boundaries["bar/top"])
    M, angle = (fem.Constant(data.mesh, value) for value in (0.0, 0.0))
    centre = fem.Constant(data.mesh, (0.125, 3.0))
    arm, across, x = X - centre, ufl.perp(X - centre), X + u

    def integral(f):
        return COMM.allreduce(fem.assemble_scalar(fem.form(f * top)))

    def turn():
        return np.arctan2(integral(ufl.inner(across, x)), integral(ufl.inner(arm, x)))

    J = integral(ufl.inner(arm, arm))
    traction = M / J * (ufl.cos(angle) * across - ufl.sin(angle) * arm)
    residual = ufl.inner(neo_hookean(u, E, NU), ufl.grad(v)) * DX - ufl.inner(traction, v) * top
    bcs = [fm.dirichlet(V, data, "bar/bottom", (0.0, 0.0))]
    far = fm.ContactPair(data, "bar/left", fm.Plane((-9.0, 0.0), (1.0, 0.0)))
    problem = fm.ContactProblem(residual, u, [far], bcs=bcs, petsc_options_prefix="torque_")
    for moment in np.linspace(0.0, 0.03, 16)[1:]:
        M.value, angle.value = moment, turn() if follows else 0.0
        problem.solve()
    reaction = same_everywhere(problem.reaction("bar/bottom", about=(1.0, 2.0)))
    assert turn() > 0.5
    if follows:
        assert reaction.moment == pytest.approx(-0.03, rel=3e-3)
    else:  # the end is not rigid
        assert reaction.moment == pytest.approx(-0.03 * np.cos(turn()), rel=0.03)
    assert np.abs(reaction.force).max() < 1e-12
