# SPDX-License-Identifier: MIT
"""Scalar fields across interfaces in space: exact solutions, tangents, balance, turns, ranks."""

from mpi4py import MPI

import numpy as np
import pytest
from heat_scenes import heated, roll_sides, stacked, stacked_in_space
from scipy.optimize import brentq
from space_pairs import KINDS, ROLES, TILTED, UPRIGHT

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_boxes import Box, block

HOT, CONDUCTIVITY = 10.0, 5.0
MIXED = [fm.PressureConductance(3.0, 5.0), fm.GapConductance(0.02, 0.01)]
# Degrees of displacement and temperature for each kind of cell.
DEGREES = [(cell, (degree, of_T)) for cell, degree in KINDS for of_T in range(1, degree + 1)]
ALGORITHMS = [
    (cell, degrees, algorithm)
    for cell, degrees in DEGREES
    for algorithm in ("condensed", "saddle")
    if (cell, degrees[0], algorithm) != ("tetrahedron", 2, "condensed")  # D is not diagonal
]
# Integrals of the functions of distorted quadrilaterals over common parts are not exact.
QUADRATURE = {"tetrahedron": 1e-12, "hexahedron": 1e-8}


def down(depth, x=0.0, y=0.0):
    return np.array([x, y, -depth])


def temperature_error(scene, expected):
    T, X = scene.at(1)
    return np.abs(T[:, 0] - expected(X)).max()


def balanced(problem):
    """Whether heat leaves one side and enters the other, up to the source and rounding."""
    flux, weight = problem.contacts[0].fluxes[0], problem.equations.contacts[0].operators.weight
    total = flux.into_slave + flux.into_master - float(weight @ flux.heating)
    return abs(total) < 1e-13 * (abs(flux.into_slave) + abs(flux.into_master))


# Ties


@pytest.mark.parametrize("roles", ROLES)
@pytest.mark.parametrize("cell, degrees", DEGREES)
def test_ties_transmit_a_linear_temperature_exactly(cell, degrees, roles):
    """Facets of both sides that do not match, distorted."""
    scene = stacked_in_space(degrees=degrees, cell=cell, alpha=0.0, nu=0.0, jiggle=0.2)
    pair = fm.TiedPair(scene.data, *roles, fields=[1])
    problem = scene.problem([pair])
    scene.set(top=down(0.06), hot=HOT)
    report = problem.solve()
    assert report.num_iterations <= 3 and not report.certificate.violations()
    assert temperature_error(scene, lambda X: HOT * X[:, 2] / 3.0) < HOT * QUADRATURE[cell]
    u, X = scene.at(0)
    assert np.abs(u - X[:, 2:] * down(0.02)).max() < QUADRATURE[cell]
    flux, way = problem.contacts[0].fluxes[0], 1.0 if roles == ROLES[0] else -1.0
    assert flux.into_master == pytest.approx(way * CONDUCTIVITY * HOT / 3.0, rel=1e-12)
    assert flux.into_slave == -flux.into_master and np.isinf(flux.conductance).all()
    assert flux.conduction == pytest.approx(flux.into_master, rel=1e5 * QUADRATURE[cell])


@pytest.mark.parametrize("roles", ROLES)
@pytest.mark.parametrize("cell, degrees", DEGREES)
def test_ties_of_surfaces_that_cover_each_other_in_part_are_in_balance(cell, degrees, roles):
    """A smaller block on a larger one: both systems, heat that enters above leaves below."""
    found = []
    for algorithm in ("condensed", "saddle"):
        if (cell, degrees, algorithm) not in ALGORITHMS:
            continue
        scene = stacked_in_space(degrees=degrees, cell=cell, overhang=0.4)
        pair = fm.TiedPair(scene.data, *roles, fields=[1])
        problem = scene.problem([pair], algorithm=algorithm)
        scene.set(top=down(0.05), hot=HOT)
        problem.solve()
        field = problem.equations.contacts[0].fluxes[0]
        loads = np.concatenate(field.loads())
        assert abs(loads.sum()) < 1e-13 * np.abs(loads).sum()
        check = problem.check_tangent(print_table=False)
        assert check.remainders["whole"].max() < 1e-12  # a linear problem
        assert abs(problem.contacts[0].fluxes[0].into_master) > 5.0
        found.append((scene.at(0)[0], scene.at(1)[0], problem.contacts[0].fluxes[0].conduction))
    for one, other in zip(found[0], found[-1], strict=True):
        assert np.abs(one - other).max() < 1e-11 * np.abs(one).max()


@pytest.mark.parametrize("overhang, jiggle", [(1.0, 0.0), (2.0, 0.1)])
def test_large_slaves_of_nine_nodes_are_tied_to_small_masters(overhang, jiggle):
    """Their flat interface has a gap of rounding, at nodes that straight cells cannot move."""
    lower = (4, 4, 2)
    options = {"degrees": (2, 2), "overhang": overhang, "jiggle": jiggle, "lower": lower}
    scene = stacked_in_space(**options)
    X = scene.data.mesh.geometry.x.copy()
    problem = scene.problem([fm.TiedPair(scene.data, *ROLES[1], fields=[1])])
    assert np.abs(scene.data.mesh.geometry.x - X).max() < 1e-8
    scene.set(top=down(0.02), hot=HOT)
    report = problem.solve()
    assert report.num_iterations <= 3 and not report.certificate.violations()


@pytest.mark.serial
@pytest.mark.parametrize("roles", ROLES)
@pytest.mark.parametrize("cell, degrees", DEGREES)
def test_meshes_that_match_are_solved_as_others(cell, degrees, roles):
    """A cube on a larger block, whose nodes coincide: edges cross at any places after Newton's
    first step. On the larger block as slave covers are narrow; their dual functions were rounding.
    """
    lower = Box("lower", block((5, 5, 2), size=(5 / 3, 5 / 3, 2.0)))
    upper = Box("upper", block((3, 3, 1), corner=(1 / 3, 1 / 3, 2.0)))
    scene = heated([lower, upper], degrees=degrees, cell=cell)
    scene.hold("bottom", "lower/bottom")
    scene.hold("top", "upper/top")
    scene.prescribe("cold", "lower/bottom", 1)
    scene.prescribe("hot", "upper/top", 1)
    heat = fm.Conductance(1, MIXED)
    problem = scene.problem([fm.ContactPair(scene.data, *roles, fluxes=[heat])])
    scene.set(top=down(0.02), hot=HOT)
    assert problem.solve().num_iterations <= 6 and balanced(problem)


def test_prescribed_temperatures_of_the_slave_carry_no_multiplier():
    scene = stacked_in_space(alpha=0.0)
    scene.prescribe("side", ["upper/left", "lower/left"], 1)
    problem = scene.problem([fm.TiedPair(scene.data, *ROLES[0], fields=[1])])
    scene.set(hot=3.0, cold=3.0, side=3.0)
    problem.solve()
    assert temperature_error(scene, lambda X: 3.0) < 1e-12
    tied = problem.equations.contacts[0]
    first = tied.slave.X[:, 0] < 1e-9
    assert first.any() and not tied.fluxes[0].conducts[first].any()


@pytest.mark.serial
def test_bodies_just_apart_do_not_close_by_inexact_linear_solves():
    """Flows of order 10 beside forces of 1e-6: nodes closed and opened in turn, for ever."""
    scene = stacked_in_space(degrees=(2, 1), alpha=0.0, overhang=0.4)
    problem = scene.problem(
        [fm.ContactPair(scene.data, *ROLES[0], fluxes=[fm.Conductance(1, 2.0)])]
    )
    scene.set(top=down(-1e-8), hot=HOT)
    assert problem.solve().num_iterations <= 4
    assert not problem.contacts[0].active.any() and problem.contacts[0].fluxes[0].into_slave == 0.0


# Conductances: closed forms


@pytest.mark.parametrize("roles", ROLES)
@pytest.mark.parametrize("cell, degrees", DEGREES)
def test_two_bars_with_a_conductance_of_pressure(cell, degrees, roles):
    """q = dT / (L_1 / k + L_2 / k + 1 / h(p)) with p of uniform compression."""
    scene = stacked_in_space(degrees=degrees, cell=cell, nu=0.0, alpha=0.0)
    h = fm.PressureConductance(3.0, 5.0)
    problem = scene.problem([fm.ContactPair(scene.data, *roles, fluxes=[fm.Conductance(1, h)])])
    scene.set(top=down(0.06), hot=HOT)
    problem.solve()
    pressure = 100.0 * 0.06 / 3.0
    q = HOT / (3.0 / CONDUCTIVITY + 1.0 / (3.0 * (pressure / 5.0) ** 0.95))
    flux, way = problem.contacts[0].fluxes[0], 1.0 if roles == ROLES[0] else -1.0
    assert problem.contacts[0].pressure == pytest.approx(pressure, rel=1e-9)
    assert flux.into_master == pytest.approx(way * q, rel=1e-11) and balanced(problem)
    jump = HOT - 3.0 / CONDUCTIVITY * q
    assert flux.jump == pytest.approx(way * jump, rel=1e-9)

    def expected(X):
        below, above = q * X[:, 2] / CONDUCTIVITY, HOT - q * (3.0 - X[:, 2]) / CONDUCTIVITY
        return np.where(X[:, 2] < 2.0, below, above)

    T, X = scene.at(1)
    inside = np.abs(X[:, 2] - 2.0) > 1e-9
    assert T[inside, 0] == pytest.approx(expected(X[inside]), abs=1e-9)


@pytest.mark.serial
@pytest.mark.parametrize("open_", [True, False])
def test_bars_that_expand_towards_each_other(open_):
    """The gap, or the pressure, of the bars' expansion makes the conductance: one equation."""
    scene = roll_sides(stacked_in_space(degrees=(2, 2), nu=0.0))
    law = fm.GapConductance(2.0, 0.1) if open_ else fm.PressureConductance(8.0, 1.0)
    pair = fm.ContactPair(scene.data, *ROLES[0], fluxes=[fm.Conductance(1, law)])
    problem = scene.problem([pair])
    lift = 0.2 if open_ else -0.001
    scene.set(top=down(-lift), hot=HOT)
    report = problem.solve()

    def rest(q):
        below, above = 2.0 * q / CONDUCTIVITY, HOT - q / CONDUCTIVITY
        gap = np.array([lift - 1e-3 * (2.0 * below / 2.0 + (above + HOT) / 2.0)])
        h = law(-100.0 * gap / 3.0, gap).h
        return q - float(h[0]) * (above - below)

    q, view = brentq(rest, 0.0, 20.0, xtol=1e-14), problem.contacts[0]
    assert view.active.any() != open_ and report.num_iterations <= 7
    assert view.fluxes[0].into_master == pytest.approx(q, rel=1e-9)


@pytest.mark.once
@pytest.mark.parametrize("cell, degrees", DEGREES)
def test_perfect_conduction_does_not_lock(cell, degrees):
    """A flux that varies along the contact: as in ties, on facets that do not match; else 10 %."""
    found = []
    for tie in (True, False):
        scene = stacked_in_space((4, 4, 2), (3, 3, 2), degrees=degrees, cell=cell, alpha=0.0)
        scene.bcs[-2:] = []
        scene.prescribe("left", "lower/left", 1)
        scene.prescribe("right", "upper/right", 1)
        sides = scene.data, *ROLES[0]
        pair = fm.TiedPair(*sides, fields=[1])
        if not tie:
            pair = fm.ContactPair(*sides, fluxes=[fm.Conductance(1, np.inf)])
        problem = scene.problem([pair])
        scene.set(top=down(0.02), right=HOT)
        problem.solve()
        found.append(problem.contacts[0].fluxes[0].into_master)
    assert found[1] == pytest.approx(found[0], rel=0.03)


# Tangents


def slid(cell, degrees, algorithm=None, heating=None, *, turn=UPRIGHT, steps=2, **options):
    """The block hangs over edges of the cube, which is the slave or the master; slid and hot."""
    law = fm.Coulomb(0.3) if heating == "friction" else None
    roles = options.pop("roles", ROLES[1])
    scene = stacked_in_space(degrees=degrees, cell=cell, overhang=0.37, turn=turn, **options)
    heat = fm.Conductance(1, MIXED, heating=heating, share=0.3)
    problem = scene.problem(
        [fm.ContactPair(scene.data, *roles, law=law, fluxes=[heat])], algorithm=algorithm
    )
    for step in range(1, steps + 1):
        scene.set(top=turn @ down(0.01 + 0.01 * step, 0.03 * step, 0.02 * step), hot=HOT)
        problem.time = float(step)
        problem.solve()
    return scene, problem


def power(p, X):
    """Source by sliding in a direction that is not resolved; positions have three components."""
    return p * X[:, 2], X[:, 2]


@pytest.mark.parametrize(
    "cell, degrees, algorithm, heating",
    [(*kind, "friction") for kind in ALGORITHMS]
    + [(*kind, None, None) for kind in DEGREES]
    + [("tetrahedron", (1, 1), None, power), ("hexahedron", (2, 1), None, power)],
)
def test_tangents_of_conducting_contacts_are_exact(cell, degrees, algorithm, heating):
    """Of partly covered facets, by field, pressure and slip."""
    problem = slid(cell, degrees, algorithm, heating, jiggle=0.1)[1]
    slopes = problem.check_tangent(print_table=False).slopes
    assert {name: s for name, s in slopes.items() if not 1.9 < s < 2.1 and np.isfinite(s)} == {}
    contact, o = problem.contacts[0], problem.equations.contacts[0].operators
    assert contact.active.any() and balanced(problem)
    assert (o.cover < 0.9 * o.slave.full_cover).any()
    source = float(o.weight @ contact.fluxes[0].heating)
    assert (source > 0.0) == (heating is not None)
    if heating == "friction":
        assert source == pytest.approx(contact.friction_work, rel=1e-12)


@pytest.mark.parametrize("cell, degrees", DEGREES)
def test_tangents_of_conduction_through_gaps_are_exact(cell, degrees):
    """The gap changes by the expansion."""
    scene = stacked_in_space(degrees=degrees, cell=cell, overhang=0.37, jiggle=0.1)
    heat = fm.Conductance(1, fm.GapConductance(0.5, 0.01))
    problem = scene.problem([fm.ContactPair(scene.data, *ROLES[1], fluxes=[heat])])
    scene.set(top=down(-0.04, 0.03, 0.02), hot=HOT)
    problem.solve()
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.1)
    assert not problem.contacts[0].active.any() and balanced(problem)
    assert problem.contacts[0].fluxes[0].into_slave > 5.0


@pytest.mark.parametrize("basis", ["standard", "linear"])
def test_tangents_with_other_multipliers(basis):
    scene = stacked_in_space(degrees=(2, 1), overhang=0.37)
    heat = fm.Conductance(1, MIXED)
    choice = fm.Discretization(basis=basis)
    pair = fm.ContactPair(scene.data, *ROLES[1], fluxes=[heat], discretization=choice)
    problem = scene.problem([pair])
    scene.set(top=down(0.02), hot=HOT)
    problem.solve()
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.1)
    assert balanced(problem)


@pytest.mark.once
@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_tangents_on_hot_obstacles_are_exact(cell, degree, pushed):
    """Motions of the obstacle are directions of the test; conduction through the gap, too."""
    scene = heated([Box("b", block((4, 4, 2), jiggle=0.1))], degrees=(degree, 1), cell=cell)
    scene.hold("bottom", "b/bottom")
    scene.prescribe("cold", "b/bottom", 1)
    hot, ball = fem.Constant(scene.data.mesh, 40.0), fm.Sphere((0.5, 0.45, 2.0), 1.0)
    heat = fm.Conductance(1, MIXED, heating="friction", temperature=hot)
    pair = fm.ContactPair(scene.data, "b/top", ball, law=fm.Coulomb(0.3), fluxes=[heat])
    problem = scene.problem([pair])
    for step in (1, 2):
        if pushed:
            ball.push(z=-2.0 * step)
        else:
            ball.move(z=-0.04 * step, x=0.01 * step)
        problem.time = step
        problem.solve()
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.1)
    view, flux = problem.contacts[0], problem.contacts[0].fluxes[0]
    weight = problem.equations.contacts[0].operators.weight
    source = float(weight @ flux.heating)
    assert flux.into_slave + flux.into_master == pytest.approx(source, rel=1e-10)
    assert source == pytest.approx(view.friction_work, rel=1e-12) and flux.into_slave > 10.0
    into_block = flux.into_slave
    hot.value, problem.time = 80.0, 3.0
    problem.solve()
    assert view.fluxes[0].into_slave > 1.5 * into_block


# Balance


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_frictional_heat_is_the_work_of_friction(share):
    """The heat stored in a block that slides on an insulated plane, step by step, to rounding."""
    capacity, dt, stored, work = 2.0, 0.1, [], []
    scene = heated([Box("b", block((3, 2, 1), size=(1.0, 0.8, 0.5)))], alpha=0.0)
    scene.hold("top", "b/top")
    old = fem.Function(scene.w.function_space)
    scene.residual += capacity * (scene.T - old.sub(1)) / dt * scene.test * scene.dx
    floor = fm.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    heat = fm.Conductance(1, 0.0, heating="friction", share=share, temperature=0.0)
    pair = fm.ContactPair(scene.data, "b/bottom", floor, law=fm.Coulomb(0.4), fluxes=[heat])
    problem, total = scene.problem([pair]), fem.form(capacity * scene.T * scene.dx)
    for step in range(1, 4):
        scene.set(top=down(0.02, 0.05 * step, 0.02 * step))
        problem.time = dt * step
        problem.solve()
        stored.append(scene.data.mesh.comm.allreduce(fem.assemble_scalar(total)))
        work.append(problem.contacts[0].friction_work)
        old.x.array[:] = scene.w.x.array
    assert min(work) > 0.0
    assert np.array(stored) == pytest.approx(share * np.cumsum(work), rel=1e-11)


@pytest.mark.parametrize("cell, degrees", DEGREES)
def test_loads_of_both_sides_balance_on_partly_covered_surfaces(cell, degrees):
    problem = slid(cell, degrees, steps=1)[1]
    found = problem.certificate().pairs[0]["balance of field 1"]
    assert found.verdict == "ok" and found.value < 1e-14
    assert problem.contacts[0].fluxes[0].into_slave > 1.0 and balanced(problem)


def test_a_field_that_is_solved_for_elsewhere():
    """The loads are linear in the field: their derivative is exact."""
    scene = stacked_in_space(overhang=0.37)
    V, S = fm.vector_space(scene.data.mesh, 1), fm.scalar_space(scene.data.mesh, 1)
    u, T, v = fem.Function(V), fem.Function(S), ufl.TestFunction(V)
    T.interpolate(lambda x: x[0] + x[2] ** 2)
    strain = fm.energies.elastic_strain(u, 1e-3 * T)
    stress = fm.energies.stress(fm.energies.linear_elastic, strain, *fm.energies.lame(100.0, 0.3))
    work = ufl.inner(stress, fm.energies.elastic_strain(v)) * ufl.dx(degree=4)
    bcs = [fm.dirichlet(V, scene.data, "lower/bottom", np.zeros(3))]
    bcs += [fm.dirichlet(V, scene.data, "upper/top", down(0.02))]
    pair = fm.ContactPair(scene.data, *ROLES[1], fluxes=[fm.Conductance(T, MIXED)])
    problem = fm.ContactProblem(work, u, [pair], bcs=bcs, petsc_options_prefix="apart_")
    problem.solve()
    before, A = problem.matrices.flux_loads(), problem.matrices.flux_derivative()
    change = A.createVecRight()
    change.array[:] = np.sin(np.arange(change.array.size))
    T.x.array[: change.array.size] += change.array
    T.x.scatter_forward()
    after = problem.matrices.flux_loads()
    scale = after.norm()
    after.axpy(-1.0, before)
    after.axpy(-1.0, A * change)
    assert scale > 0.01 and after.norm() < 1e-13 * scale


# Comparisons


def results(problem, turn):
    """Fields at the slave nodes, in the order of their positions before a turn."""
    view = problem.contacts[0]
    order = np.lexsort(np.round(view.slave.X @ turn, 7).T)
    flux, found = view.fluxes[0], {"pressure": view.pressure[order]}
    for name in ("jump", "conductance", "conduction", "heating"):
        found[name] = getattr(flux, name)[order]
    found["totals"] = np.array([flux.into_slave, flux.into_master])
    return found


def temperatures(scene, turn=UPRIGHT):
    """Temperatures of the nodes beside the interface, in the order of their positions."""
    T, X = scene.at(1)
    X = np.round(X @ turn, 7)
    T, X = T[X[:, -1] != 2.0, 0], X[X[:, -1] != 2.0]
    return T[np.lexsort(X.T)]


def assert_equal(found, expected, tolerance):
    for name, values in found.items():
        scale = max(1e-3, np.abs(expected[name]).max())
        assert np.abs(values - expected[name]).max() < tolerance * scale, name


@pytest.mark.parametrize(
    "cell, degrees, heating",
    [(*kind, None) for kind in DEGREES]
    + [("tetrahedron", (1, 1), "friction"), ("hexahedron", (1, 1), "friction")],
)
def test_results_turn_with_the_scene(cell, degrees, heating):
    found = []
    for turn in (UPRIGHT, TILTED):
        scene, problem = slid(cell, degrees, heating=heating, turn=turn)
        found.append(results(problem, turn) | {"T": temperatures(scene, turn)})
    assert_equal(*found, 1e-8)  # Newton's tolerance


@pytest.mark.serial
@pytest.mark.parametrize("tie", [False, True])
def test_an_extruded_scene_has_the_results_of_the_plane(tie):
    """Partly covered surfaces, slid, with heat of friction; motions are small.

    In the plane facets are projected along the normals of nodes, in space along those of facets:
    the difference is of the order of the strains.
    """
    small, found = 1e-6, []
    stiff = {"E": 100.0 / small, "alpha": 1e-3 * small}
    plane = stacked((5, 4), overhang=0.43, cell="quadrilateral", **stiff)
    plane.prescribe("shift", "upper/top", 0, 0)
    plane.bcs.pop(1)  # of the upper body's side
    lower = block((5, 2, 4), size=(1.43, 0.2, 2.0))
    upper = block((4, 2, 2), size=(1.0, 0.2, 1.0), corner=(0.0, 0.0, 2.0))
    solid = heated([Box("lower", lower), Box("upper", upper)], **stiff)
    solid.prescribe("lower side", "lower/left", 0, 0)
    for body in ("lower", "upper"):
        solid.prescribe(f"{body} plane", [f"{body}/front", f"{body}/back"], 0, 1)
    solid.prescribe("bottom", "lower/bottom", 0, 2)
    solid.prescribe("top", "upper/top", 0, 2)
    solid.prescribe("shift", "upper/top", 0, 0)
    solid.prescribe("cold", "lower/bottom", 1)
    solid.prescribe("hot", "upper/top", 1)
    for scene in (plane, solid):
        if tie:
            pair = fm.TiedPair(scene.data, *ROLES[0], fields=[1])
        else:
            heat = fm.Conductance(1, MIXED, heating="friction", share=0.3)
            options = {"law": fm.Coulomb(0.3), "discretization": "other_codes"}
            pair = fm.ContactPair(scene.data, *ROLES[1], fluxes=[heat], **options)
        problem = scene.problem([pair])
        for step in (1, 2):
            scene.set(top=-0.02 * step * small, shift=0.015 * step * small, hot=HOT)
            problem.time = step * small
            problem.solve()
        found.append(results(problem, np.eye(scene.data.mesh.geometry.dim)))
    expected, extruded = found
    assert np.abs(expected["conduction" if tie else "jump"]).max() > 1.0
    assert extruded.pop("totals") == pytest.approx(0.2 * expected.pop("totals"), rel=20.0 * small)
    for name in {"jump", "conduction"} if tie else expected:
        values = expected[name]
        scale = np.abs(values).max(initial=1e-3)
        for there in extruded[name].reshape(3, -1):
            assert np.abs(there - values).max() < 20.0 * small * scale, name


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize(
    "cell, degrees, options",
    [
        ("hexahedron", (1, 1), {}),
        ("tetrahedron", (2, 1), {}),
        ("hexahedron", (1, 1), {"upper": (1, 1, 1), "lower": (1, 1, 1)}),  # ranks without cells
    ],
)
def test_results_are_those_of_one_rank(cell, degrees, options):
    found = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        given = {"jiggle": 0.1, "comm": comm, **options}
        scene, problem = slid(cell, degrees, heating="friction", **given)
        found.append(results(problem, UPRIGHT) | {"T": temperatures(scene)})
    assert_equal(*found, 1e-8)


def test_parts_of_mixed_functions_are_written_by_ranks_without_cells(tmp_path):
    """One cell a body: dolfinx 0.5 cannot collapse scalar sub-spaces on ranks without cells."""
    scene, problem = slid("hexahedron", (1, 1), steps=1, upper=(1, 1, 1), lower=(1, 1, 1))
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    with fm.ResultsWriter(folder / "heat", problem, {"T": scene.w.sub(1)}) as results:
        results.write(0.0)
    assert any(b"T" in file.read_bytes() for file in folder.iterdir() if file.is_file())


def test_friction_may_vary_in_space():
    scene = stacked_in_space((3, 3, 1), (2, 2, 1))
    mu = fem.Function(fm.scalar_space(scene.data.mesh, 1))
    mu.interpolate(lambda x: 0.1 + 0.2 * x[0] + 0.05 * x[1])
    problem = scene.problem([fm.ContactPair(scene.data, *ROLES[0], law=fm.Coulomb(mu))])
    contact = problem.equations.contacts[0]
    expected = 0.1 + contact.slave.X @ [0.2, 0.05, 0.0]
    assert contact.parameters["mu"] == pytest.approx(expected, rel=1e-14)


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("cell, degrees", [("hexahedron", (1, 1)), ("tetrahedron", (2, 1))])
def test_ties_of_fields_on_ranks(cell, degrees):
    found = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        scene = stacked_in_space(degrees=degrees, cell=cell, overhang=0.4, comm=comm)
        problem = scene.problem([fm.TiedPair(scene.data, *ROLES[0], fields=[1])])
        scene.set(top=down(0.05), hot=HOT)
        problem.solve()
        flux = problem.contacts[0].fluxes[0]
        values = {"T": temperatures(scene), "q": np.sort(flux.conduction)}
        found.append(values | {"total": np.array([flux.into_master])})
    assert_equal(*found, 1e-9)
