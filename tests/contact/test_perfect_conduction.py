# SPDX-License-Identifier: MIT
"""Perfect conduction across contact: multipliers of one component, zero where contact is open."""

import pickle

from mpi4py import MPI

import numpy as np
import pytest
from heat_scenes import heated, stacked, stacked_in_space

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.contact import fluxes
from meshes.mapped_boxes import Box
from meshes.mapped_boxes import block as box
from meshes.mapped_grids import Grid, block, mapped

SIDES = "upper/bottom", "lower/top"
INF = float("inf")
DEGREES = [(1, 1), (2, 1), (2, 2)]


def conducting(scene, h=INF, *, law=None, heating=None, share=0.5, **options):
    """The problem with conduction across the contact of two blocks."""
    heat = fm.Conductance(1, h, heating=heating, share=share)
    pair = fm.ContactPair(scene.data, *SIDES, law=law, fluxes=[heat])
    return scene.problem([pair], **options)


def humped(degrees=(1, 1), *, columns=(8, 11), **options):
    """A block with a round lower side on a flat one: contact grows with the load."""

    def position(s, t):
        bottom = 2.0 + 0.05 * (s - 0.43) ** 2
        return 1.05 + 0.9 * s, bottom + t * (3.0 - bottom)

    lower = Grid("lower", block(columns[0], 4, width=1.0, height=2.0, corner=(1.0, 0.0)))
    scene = heated(
        [lower, Grid("upper", mapped(columns[1], 3, position))], degrees=degrees, **options
    )
    scene.hold("bottom", "lower/bottom")
    scene.hold("top", "upper/top")
    scene.prescribe("cold", "lower/bottom", 1)
    scene.prescribe("hot", "upper/top", 1)
    return scene


def total_of(problem):
    """Heat that enters both sides, over the largest of them."""
    flux = problem.contacts[0].fluxes[0]
    return abs(flux.into_slave + flux.into_master) / abs(flux.into_slave)


def conduction_where_open(problem):
    """Conduction at slave nodes that are open."""
    return problem.contacts[0].fluxes[0].conduction[~problem.contacts[0].active]


# Closed forms


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("degrees", DEGREES)
def test_two_bars_have_one_temperature_where_they_touch(degrees, algorithm):
    """T = 20/3 at the interface and the flow 50/3, to 1e-12, at any level of temperature."""
    for level in (0.0, 300.0):
        scene = stacked((5, 7), degrees=degrees, nu=0.0, alpha=1e-4)
        tight = fm.NewtonOptions(residual_tolerance=1e-13)
        problem = conducting(scene, algorithm=algorithm, newton=tight)
        scene.set(top=-0.06, hot=level + 10.0, cold=level)
        problem.solve()
        flux = problem.contacts[0].fluxes[0]
        assert np.isinf(flux.conductance).all()
        assert np.abs(flux.jump).max() < 1e-12 * (level + 10.0)
        assert flux.into_master == pytest.approx(50.0 / 3.0, rel=1e-12 * (1.0 + level))
        assert flux.conduction == pytest.approx(50.0 / 3.0, rel=1e-10)
        T, X = scene.at(1)
        on = np.abs(X[:, 1] - 2.0) < 1e-9
        assert T[on, 0] == pytest.approx(level + 20.0 / 3.0, abs=1e-12 * (level + 10.0))


def test_bars_in_space_have_one_temperature():
    scene = stacked_in_space(alpha=0.0, nu=0.0)
    problem = conducting(scene, newton=fm.NewtonOptions(residual_tolerance=1e-13))
    scene.set(top=(0.0, 0.0, -0.03), hot=10.0)
    problem.solve()
    flux = problem.contacts[0].fluxes[0]
    assert np.abs(flux.jump).max() < 1e-11
    assert flux.into_master == pytest.approx(50.0 / 3.0, rel=1e-11)


@pytest.mark.parametrize("degrees", [(1, 1), (2, 2)])
def test_bonded_surfaces_are_those_of_a_tie(degrees):
    """The same heat flow, temperatures and displacements as TiedPair(fields=[1])."""
    found = []
    for tied in (False, True):
        scene = stacked((5, 7), degrees=degrees, nu=0.0, alpha=0.0)
        pair = fm.ContactPair(scene.data, *SIDES, fluxes=[fm.Conductance(1, INF)])
        if tied:
            pair = fm.TiedPair(scene.data, *SIDES, fields=[1])
        problem = scene.problem([pair])
        scene.set(top=-0.03, hot=10.0)
        problem.solve()
        flux = problem.contacts[0].fluxes[0]
        found.append((scene.at(1)[0], scene.at(0)[0], flux.conduction, flux.into_master))
    for of_contact, of_tie in zip(*found, strict=True):
        scale = np.abs(of_tie).max()
        assert np.abs(of_contact - of_tie).max() < 1e-10 * scale


# Partly open


@pytest.mark.parametrize("degrees", DEGREES)
def test_open_nodes_conduct_nothing(degrees):
    """Zero at open nodes, the jump zero at closed ones, balance to rounding on both systems."""
    found = []
    for algorithm in ("condensed", "saddle"):
        scene = humped(degrees)
        problem = conducting(
            scene, algorithm=algorithm, newton=fm.NewtonOptions(residual_tolerance=1e-12)
        )
        scene.set(top=(0.0, -0.01), hot=5.0)
        report = problem.solve()
        flux, active = problem.contacts[0].fluxes[0], problem.contacts[0].active
        open_ = conduction_where_open(problem)
        assert active.any() and open_.size and (open_ == 0.0).all()
        assert total_of(problem) < 1e-13
        assert np.abs(flux.jump[active]).max() < 1e-10
        assert report.certificate.pairs[0]["balance of field 1"].verdict == "ok"
        found.append((scene.at(1)[0], flux.conduction))
    for one, other in zip(*found, strict=True):
        assert np.abs(one - other).max() < 1e-10 * np.abs(other).max()


@pytest.mark.parametrize("h", [INF, fm.PressureConductance(1e3, 1.0)])
def test_linear_temperatures_conduct_where_quadratic_ones_do(h):
    """Zero at open nodes also for degree 1 beside 2; the heat flow is that of degree 2 to 2 %.

    Heat flows the same way at all closed nodes. Nodal fluxes have the total in their sum.
    """
    found = []
    for degrees in ((2, 2), (2, 1)):
        scene = humped(degrees)
        problem = conducting(scene, h)
        scene.set(top=(0.0, -0.01), hot=5.0)
        problem.solve()
        flux, active = problem.contacts[0].fluxes[0], problem.contacts[0].active
        assert active.any() and (flux.conduction[~active] == 0.0).all()
        assert (flux.conduction[active] > 0.0).all()
        weight = problem.equations.contacts[0].now.operators.weight
        assert weight @ flux.conduction == pytest.approx(flux.into_master, rel=1e-12)
        finite = active & np.isfinite(flux.conductance)
        law = flux.conductance[finite] * flux.jump[finite]
        assert flux.conduction[finite] == pytest.approx(law, rel=1e-10)
        found.append(flux.into_master)
    assert found[1] == pytest.approx(found[0], rel=0.02)


@pytest.mark.serial
def test_contact_that_opens_and_closes_converges_quadratically():
    """Sets change in each load step; then residuals fall quadratically down to rounding."""
    scene = humped((2, 1))
    problem = conducting(scene, newton=fm.NewtonOptions(residual_tolerance=1e-12))
    sizes = []
    for top, hot in ((-0.005, 5.0), (-0.02, 5.0), (-0.02, 15.0), (-0.004, 5.0), (0.01, 5.0)):
        scene.set(top=(0.0, top), hot=hot)
        report = problem.solve()
        sizes.append(int(problem.contacts[0].active.sum()))
        steps = [r.residual / report.iterations[0].residual for r in report.iterations]
        changes = [r.num_changed for r in report.iterations]
        last = len(changes) - 1 - next((i for i, c in enumerate(changes[::-1]) if c), 0)
        for before, after in zip(steps[last + 1 :], steps[last + 2 :], strict=False):
            assert after < max(1e4 * before**2, 1e-10), (top, steps)
        assert report.num_iterations <= 12
        assert (conduction_where_open(problem) == 0.0).all()
    assert sizes[0] < sizes[1] < sizes[2] and sizes[3] < sizes[2] and sizes[4] == 0
    T, X = scene.at(1)
    upper = T[X[:, 1] > 2.02]
    assert upper == pytest.approx(5.0, abs=1e-10)  # apart: the upper block has one temperature


def test_contact_closes_by_heat_and_opens_as_it_cools():
    """Blocks expand towards each other; a gas conducts where they are apart."""
    scene = stacked((5, 7), degrees=(1, 1), nu=0.0, overhang=0.3)
    problem = conducting(scene, [INF, fm.GapConductance(0.5, 0.01)])
    closed = []
    for hot in (1.0, 20.0, 1.0):
        scene.set(top=0.01, hot=hot, cold=hot)
        assert problem.solve().num_iterations <= 9
        closed.append(bool(problem.contacts[0].active.any()))
        flux = problem.contacts[0].fluxes[0]
        assert np.isinf(flux.conductance[problem.contacts[0].active]).all()
    assert closed == [False, True, False]


# Tangent


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("geometry", ["plane", "axisymmetric"])
def test_tangents_are_exact(geometry, degrees, algorithm):
    scene = humped(degrees, geometry=geometry, alpha=1e-4)
    problem = conducting(scene, algorithm=algorithm, law=fm.Coulomb(0.3), heating="friction")
    for step, shift in ((1, 0.0), (2, 0.01)):
        scene.set(top=(shift, -0.01), hot=5.0 * shift / 0.01)
        problem.time = float(step)
        problem.solve()
    steps = 1e-4 * 0.5 ** np.arange(6)
    slopes = problem.check_tangent(steps=steps, print_table=False).slopes
    assert {n: s for n, s in slopes.items() if not 1.9 < s < 2.1 and np.isfinite(s)} == {}


@pytest.mark.parametrize("of_pressure", [fm.PressureConductance(1e3, 1.0), INF, 7.0])
def test_tangents_of_means_by_conductance_are_exact(of_pressure):
    """Where some nodes of a carrier are open, or conduct through a gas, by pressure and gap."""
    scene = humped((2, 1), alpha=1e-4)
    problem = conducting(scene, [of_pressure, fm.GapConductance(0.2, 0.01)])
    scene.set(top=(0.0, -0.01), hot=10.0)
    problem.solve()
    active = problem.contacts[0].active
    assert active.any() and not active.all()
    steps = 1e-4 * 0.5 ** np.arange(6)
    slopes = problem.check_tangent(steps=steps, print_table=False).slopes
    assert {n: s for n, s in slopes.items() if not 1.9 < s < 2.1 and np.isfinite(s)} == {}


@pytest.mark.parametrize(
    "cell, degrees", [("hexahedron", (1, 1)), ("tetrahedron", (1, 1)), ("hexahedron", (2, 1))]
)
def test_tangents_in_space_are_exact(cell, degrees):
    scene = stacked_in_space(overhang=0.37, degrees=degrees, cell=cell, jiggle=0.1)
    problem = conducting(scene)
    scene.set(top=(0.03, 0.02, -0.02), hot=10.0)
    problem.solve()
    slopes = problem.check_tangent(print_table=False).slopes
    assert {n: s for n, s in slopes.items() if not 1.9 < s < 2.1 and np.isfinite(s)} == {}
    assert total_of(problem) < 1e-13


@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize("in_space", [False, True])
def test_obstacles_of_a_given_temperature(in_space, pushed):
    """The slave has the obstacle's temperature where it touches, also under a given force."""
    grids = [Grid("b", block(8, 4, width=1.0, height=1.0))]
    ball = fm.Circle((0.45, 3.0), 2.0)
    if in_space:
        grids, ball = [Box("b", box((4, 4, 2), jiggle=0.1))], fm.Sphere((0.5, 0.45, 3.0), 2.0)
    scene = heated(grids, alpha=1e-4)
    scene.hold("bottom", "b/bottom")
    scene.prescribe("cold", "b/bottom", 1)
    heat = fm.Conductance(1, INF, temperature=40.0)
    problem = scene.problem([fm.ContactPair(scene.data, "b/top", ball, fluxes=[heat])])
    down = {"z" if in_space else "y": -1.0 if pushed else -0.02}
    (ball.push if pushed else ball.move)(**down)
    report = problem.solve()
    view = problem.contacts[0]
    assert np.abs(view.fluxes[0].jump[view.active]).max() < 1e-8
    assert view.fluxes[0].into_slave > 1.0 and report.num_iterations <= 9
    slopes = problem.check_tangent(print_table=False).slopes
    assert slopes["whole"] == pytest.approx(2.0, abs=0.1)


# Friction, large conductances


@pytest.mark.serial
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_heat_of_friction_is_shared(share):
    """Both sides together have the work of friction, to rounding."""
    scene = humped((2, 2), alpha=0.0)
    law = fm.Coulomb(0.4)
    problem = conducting(
        scene, law=law, heating="friction", share=share,
        newton=fm.NewtonOptions(residual_tolerance=1e-13),
    )  # fmt: skip
    for step in (1, 2):
        scene.set(top=(0.02 * step, -0.02), hot=0.0)
        problem.time = 1e-5 * step
        problem.solve()
    view, flux = problem.contacts[0], problem.contacts[0].fluxes[0]
    work = view.friction_work / 1e-5
    assert work > 0.0
    assert flux.into_slave + flux.into_master == pytest.approx(work, rel=1e-12)
    assert np.abs(flux.jump[view.active]).max() < 1e-7 * np.abs(scene.at(1)[0]).max()


@pytest.mark.once
def test_large_conductances_approach_perfect_conduction():
    """As 1 / h, in any number of iterations below ten, up to 1e13; then rounding."""
    found = {}
    for h in (1e3, 1e4, 1e5, 1e6, 1e9, 1e13, INF):
        scene = humped(alpha=0.0)
        problem = conducting(scene, h, newton=fm.NewtonOptions(residual_tolerance=1e-13))
        scene.set(top=(0.0, -0.01), hot=310.0, cold=300.0)
        assert problem.solve().num_iterations <= 9
        found[h] = problem.contacts[0].fluxes[0].into_master
    errors = np.array([found[INF] / found[h] - 1.0 for h in (1e3, 1e4, 1e5, 1e6)])
    assert errors[:-1] / errors[1:] == pytest.approx([10.0] * 3, rel=0.05)
    assert found[1e9] == pytest.approx(found[INF], rel=3e-7)
    assert found[1e13] == pytest.approx(found[INF], rel=1e-10)


# State


def test_conduction_is_part_of_the_state(shared_path):
    """Restored, pickled, and read from a file: no iteration is left to do."""
    scene = humped((2, 1))
    problem = conducting(scene)
    scene.set(top=(0.0, -0.01), hot=5.0)
    problem.solve()
    expected = problem.contacts[0].fluxes[0]
    fm.save_state(problem, shared_path / "heat")
    state = pickle.loads(pickle.dumps(problem.state()))
    scene.set(top=(0.0, -0.02), hot=15.0)
    problem.solve()
    assert problem.contacts[0].fluxes[0].into_master > 1.1 * expected.into_master
    scene.set(top=(0.0, -0.01), hot=5.0)
    problem.restore(state)
    assert problem.contacts[0].fluxes[0].into_master == expected.into_master
    assert problem.solve().num_iterations <= 1
    again = humped((2, 1))
    other = conducting(again)
    again.set(top=(0.0, -0.01), hot=5.0)
    fm.load_state(other, shared_path / "heat")
    assert np.array_equal(other.contacts[0].fluxes[0].conduction, expected.conduction)
    assert other.solve().num_iterations <= 1


@pytest.mark.once
def test_a_path_with_cuts_ends_where_one_solve_does():
    """A failed step leaves no trace in the conduction of the state."""
    found = []
    for most in (4, 30):
        scene = humped()
        problem = conducting(scene, newton=fm.NewtonOptions(max_iterations=most))

        def load(time, scene=scene):
            scene.set(top=(0.0, -0.03 * time), hot=15.0 * time)

        path = fm.follow_path(problem, load, fm.SteppingOptions(step=1.0))
        found.append((problem.contacts[0].fluxes[0].conduction, path.num_cuts))
    (cut, cuts), (whole, none) = found
    assert cuts > 0 and none == 0
    assert np.abs(cut - whole).max() < 1e-8 * np.abs(whole).max()


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), "in space"])
def test_results_are_those_of_one_rank(degrees):
    found = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        if degrees == "in space":
            scene = stacked_in_space(overhang=0.37, alpha=1e-4, jiggle=0.1, comm=comm)
            shifts = (0.0, 0.0, -0.01), (0.01, 0.0, -0.01)
        else:
            scene = humped(degrees, alpha=1e-4, comm=comm)
            shifts = (0.0, -0.01), (0.01, -0.01)
        tight = fm.NewtonOptions(residual_tolerance=1e-12)
        problem = conducting(scene, law=fm.Coulomb(0.3), heating="friction", newton=tight)
        for step, shift in enumerate(shifts):
            scene.set(top=shift, hot=5.0 * step)
            problem.time = step + 1.0
            problem.solve()
        flux = problem.contacts[0].fluxes[0]
        found.append([flux.conduction, flux.jump, flux.into_master, flux.into_slave])
    for one, other in zip(*found, strict=True):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-9)


# Derivatives


def solved(values, algorithm=None):
    """A problem, and an objective of both fields."""
    scene = humped((2, 1))
    tight = fm.NewtonOptions(residual_tolerance=1e-13)
    problem = conducting(scene, newton=tight, algorithm=algorithm)
    scene.set(top=(0.0, values["top"]), hot=values["hot"], conductivity=values["conductivity"])
    problem.solve()
    u, T = ufl.split(scene.w)
    return scene, problem, (T**2 + 100.0 * ufl.inner(u, u)) * ufl.dx(degree=4)


@pytest.mark.serial
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_gradients_are_those_of_perfect_conduction(algorithm):
    """Adjoint, in one direction, and by differences; temperatures do not depend on k."""
    start = {"hot": 20.0, "top": -0.02, "conductivity": 5.0}
    scene, problem, form = solved(start, algorithm)
    names = {"hot": "hot", "top": "top1", "conductivity": "conductivity"}
    controls = {name: scene.given[of] for name, of in names.items()}
    found = fm.gradient(form, list(controls.values()), problem)
    value = float(scene.data.mesh.comm.allreduce(fem.assemble_scalar(fem.form(form))))
    for name, control in controls.items():
        along = sensitivity.tangent_linear(form, control, 1.0, problem).derivative
        size = value / abs(start[name])
        # rounding of two solves: 2e-12 to 5e-12, with PETSc, numpy and BLAS of wheels 2.2e-11
        assert along == pytest.approx(float(found[control]), abs=1e-10 * size)
        if name == "conductivity":
            assert abs(along) < 1e-12 * size
            continue
        ends, step = [], 1e-5 * abs(start[name])
        for sign in (1.0, -1.0):
            at = solved({**start, name: start[name] + sign * step}, algorithm)
            own = fem.assemble_scalar(fem.form(at[2]))
            ends.append(float(at[0].data.mesh.comm.allreduce(own)))
        assert along == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=1e-5)


@pytest.mark.parametrize("h", [INF, fm.PressureConductance(1e6, 1.0)])
def test_both_gradients_agree_on_a_pushed_obstacle(h, monkeypatch):
    """With a bound of conductances in the tangent that both solves exceed; motions take part."""
    monkeypatch.setattr(fluxes, "STIFFEST", 1e2)
    scene = heated([Grid("b", block(8, 4, width=1.0, height=1.0))])
    scene.hold("bottom", "b/bottom")
    scene.prescribe("cold", "b/bottom", 1)
    ball = fm.Circle((0.45, 3.0), 2.0)
    heat = fm.Conductance(1, h, temperature=40.0)
    problem = scene.problem([fm.ContactPair(scene.data, "b/top", ball, fluxes=[heat])])
    ball.push(y=-2.0)
    problem.solve()
    u, T = ufl.split(scene.w)
    form = (T**2 + 1e4 * ufl.inner(u, u)) * ufl.dx(degree=4)
    controls = [scene.given["cold"], scene.given["conductivity"]]
    found = fm.gradient(form, controls, problem)
    for control in controls:
        along = sensitivity.tangent_linear(form, control, 1.0, problem).derivative
        assert along == pytest.approx(float(found[control]), rel=1e-8)


# Refusals


def test_infinite_conductance_of_a_function_is_refused():
    """A function that returns inf hides from what is decided at set-up."""
    scene = stacked((3, 3))
    problem = conducting(scene, lambda p, g: (np.inf + 0.0 * p, 0.0, 0.0))
    scene.set(top=-0.03)
    with pytest.raises(fm.MortarError, match="expected a finite conductance"):
        problem.solve()
