# SPDX-License-Identifier: MIT
"""Scalar fields across contact: conductances, tangent, closed forms, balance, bad input."""

from petsc4py import PETSc

import numpy as np
import pytest
from heat_scenes import heated, stacked
from scipy.optimize import brentq

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.conductance import SMALL_PRESSURE
from fenics_mortar.utils import compat
from meshes.mapped_grids import Grid, block, mesh

MIXED = [fm.PressureConductance(3.0, 5.0), fm.GapConductance(0.02, 0.01)]


# Conductances


@pytest.mark.parametrize("exponent", [0.5, 0.95, 1.0, 2.0])
def test_power_law_of_pressure_is_smooth(exponent):
    """Value and slope are continuous where the parabola ends; the slope is that of the value."""
    law = fm.PressureConductance(4.0, 50.0, exponent)
    ends = 50.0 * SMALL_PRESSURE * np.array([1.0 - 1e-9, 1.0 + 1e-9])
    h, slope, _ = law(ends, 0.0 * ends)
    assert h[1] == pytest.approx(h[0], rel=1e-8) and slope[1] == pytest.approx(slope[0], rel=1e-6)
    p = 50.0 * np.array([0.0, 0.3 * SMALL_PRESSURE, 0.5, 1.0, 3.0])
    step = 1e-6
    change = (law(p + step, 0 * p).h - law(p, 0 * p).h) / step
    assert change == pytest.approx(law(p + step / 2, 0 * p).by_pressure, rel=1e-5)
    assert law(p, 0 * p).h[3] == pytest.approx(4.0) and law(p, 0 * p).h[0] == 0.0


def test_conductances_are_added():
    law = fm.Conductance(1, [2.0, fm.GapConductance(0.6, 0.2), lambda p, g: (p, 1.0 + 0 * p, 0.0)])
    found = law.evaluate(np.array([3.0, 0.0]), np.array([0.0, 0.4]))
    assert found.h == pytest.approx([2.0 + 3.0 + 3.0, 1.0])
    assert found.by_pressure == pytest.approx([1.0, 1.0])
    assert found.by_gap == pytest.approx([-15.0, -0.6 / 0.36])


# Tangent


@pytest.mark.serial
@pytest.mark.parametrize("h", [2.0, MIXED[1], [np.inf, MIXED[1]]], ids=str)
def test_tangent_just_before_closing_is_that_of_open_contact(h):
    """Differences in which gaps close see neither the jump of a constant nor the kink of a gas."""
    scene = stacked(overhang=0.3, alpha=0.0)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, h)])
    problem = scene.problem([pair])
    scene.set(top=1e-8, hot=10.0)
    problem.solve()
    assert not problem.contacts[0].active.any()
    check = problem.check_tangent(print_table=False)
    assert check.remainders["whole"].max() < 1e-6 and check.slopes["whole"] > 1.95


def of_gas(p, g):
    """Conductance without a value at the gap zero."""
    apart = np.where(g > 0.0, g, 1.0)
    return np.where(g > 0.0, 0.1 / apart, p + 1.0), 1.0 * (g <= 0.0), -0.1 * (g > 0.0) / apart**2


def of_root(p, g):
    """Conductance with an infinite slope at the gap zero."""
    root = np.sqrt(np.where(g > 0.0, g, 1.0))
    h = 2.0 * p + 0.1 / (1.0 + np.sqrt(g))
    return h, 2.0 + 0.0 * p, -0.05 * (g > 0.0) / (1.0 + root) ** 2 / root


@pytest.mark.serial
@pytest.mark.parametrize("h", [of_gas, of_root])
@pytest.mark.parametrize("overhang", [0.0, 0.3])
def test_conductances_of_a_gap_may_be_singular_at_zero(overhang, h):
    """Open nodes have gaps that positions resolve; nodes without a partner have none."""
    scene = stacked(overhang=overhang)
    roles = ("upper/bottom", "lower/top")[:: -1 if overhang else 1]
    pair = fm.ContactPair(scene.data, *roles, fluxes=[fm.Conductance(1, h)])
    problem = scene.problem([pair])
    for top, hot in ((-0.02, 20.0), (1e-3, 20.0)):
        scene.set(top=top, hot=hot)
        assert problem.solve().num_iterations <= 8


@pytest.mark.once
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
@pytest.mark.parametrize("heating", [None, "friction", lambda p, X: (p * X[:, 0], X[:, 0])])
def test_tangent_has_slope_two(degrees, heating, algorithm):
    scene = stacked(degrees=degrees, overhang=0.7)
    scene.prescribe("shift", "upper/top", 0, 0)
    scene.bcs.pop(1)  # of the upper body's side
    law = fm.Coulomb(0.3) if heating == "friction" else None
    heat = fm.Conductance(1, MIXED, heating=heating, share=0.3)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", law=law, fluxes=[heat])
    problem = scene.problem([pair], algorithm=algorithm)
    for step in (1, 2):
        scene.set(top=-0.02 * step, shift=0.015 * step, hot=10.0)
        problem.time = step
        report = problem.solve()
    assert report.num_iterations <= 6
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.02)


@pytest.mark.once
@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize("geometry", ["plane", "axisymmetric"])
def test_tangent_on_an_obstacle_has_slope_two(geometry, pushed):
    """Motions of the obstacle are directions of the test; conduction through the gap, too."""
    scene = heated([Grid("b", block(6, 4, width=1.0, height=1.0))], geometry=geometry)
    for name, boundary, part, component in (
        ("x", "b/left", 0, 0), ("y", "b/bottom", 0, 1), ("cold", "b/bottom", 1, None),
    ):  # fmt: skip
        scene.prescribe(name, boundary, part, component)
    hot, ball = fem.Constant(scene.data.mesh, 40.0), fm.Circle((0.0, 2.0), 1.0)
    heat = fm.Conductance(1, MIXED, heating="friction", temperature=hot)
    pair = fm.ContactPair(scene.data, "b/top", ball, law=fm.Coulomb(0.3), fluxes=[heat])
    problem = scene.problem([pair])
    for step in (1, 2):
        if pushed:
            ball.push(y=-2.0 * step)
        else:
            ball.move(y=-0.02 * step)
        problem.time = step
        problem.solve()
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.02)
    flux = problem.contacts[0].fluxes[0]
    weight = problem.equations.contacts[0].operators.weight
    assert flux.into_slave + flux.into_master == pytest.approx(float(weight @ flux.heating))
    assert flux.jump.max() < 0.0 < flux.into_slave


# Closed forms


@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
@pytest.mark.parametrize("columns", [(5, 5), (5, 7)])
def test_two_bars_with_a_conductance_of_pressure(columns, degrees):
    """q = dT / (L_1 / k + L_2 / k + 1 / h(p)) with p of uniform compression; exact."""
    scene = stacked(columns, degrees=degrees, nu=0.0, alpha=0.0)
    h = fm.PressureConductance(3.0, 5.0)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, h)])
    problem = scene.problem([pair])
    scene.set(top=-0.06, hot=10.0)
    problem.solve()
    pressure = 100.0 * 0.06 / 3.0
    resistance = 3.0 / 5.0 + 1.0 / (3.0 * (pressure / 5.0) ** 0.95)
    flux = problem.contacts[0].fluxes[0]
    assert problem.contacts[0].pressure == pytest.approx(pressure, rel=1e-11)
    assert flux.into_master == pytest.approx(10.0 / resistance, rel=1e-11)
    assert flux.into_slave == pytest.approx(-flux.into_master, rel=1e-11)
    assert flux.jump == pytest.approx(10.0 - 3.0 / 5.0 * flux.into_master, rel=1e-10)
    T, X = scene.at(1)
    q = flux.into_master
    below = np.where(X[:, 1] <= 2.0, q * X[:, 1] / 5.0, 10.0 - q * (3.0 - X[:, 1]) / 5.0)
    inside = np.abs(X[:, 1] - 2.0) > 1e-9
    assert T[inside, 0] == pytest.approx(below[inside], abs=1e-10)


def test_conduction_through_a_gap():
    """Open bars exchange heat through the medium in the gap, with the gap of expansion."""
    scene = stacked((4, 4), degrees=(2, 1), nu=0.0)
    pair = fm.ContactPair(
        scene.data,
        "upper/bottom",
        "lower/top",
        fluxes=[fm.Conductance(1, fm.GapConductance(2.0, 0.1))],
    )
    problem = scene.problem([pair])
    scene.set(top=0.2, hot=10.0)
    problem.solve()

    def rest(q):
        below, above = 2.0 * q / 5.0, 10.0 - q / 5.0
        gap = 0.2 - 1e-3 * (2.0 * below / 2.0 + (above + 10.0) / 2.0)
        return q - 2.0 / (gap + 0.1) * (above - below)

    view = problem.contacts[0]
    assert not view.active.any()
    assert view.fluxes[0].into_master == pytest.approx(
        brentq(rest, 0.0, 20.0, xtol=1e-14), rel=1e-9
    )


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_bars_that_press_by_their_expansion(algorithm):
    """Hindered expansion of both bars makes the pressure, which makes the conductance."""
    scene = stacked((4, 6), degrees=(2, 2), nu=0.0)
    law = fm.PressureConductance(8.0, 1.0)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, law)])
    problem = scene.problem([pair], algorithm=algorithm)
    scene.set(hot=10.0, top=-0.001)
    report = problem.solve()

    def rest(q):
        below, above = 2.0 * q / 5.0, 10.0 - q / 5.0
        strain = 0.001 + 1e-3 * (2.0 * below / 2.0 + (above + 10.0) / 2.0)
        h = float(law(np.array([100.0 * strain / 3.0]), np.zeros(1)).h[0])
        return q - h * (above - below)

    assert report.num_iterations <= 7
    q = brentq(rest, 0.0, 20.0, xtol=1e-14)
    assert problem.contacts[0].fluxes[0].into_master == pytest.approx(q, rel=1e-9)


def shrink_fit(cells, interference, hot, law, nu=0.3):
    """A cylinder, radii 1 and 2, in a ring to 3: heat flow and pressure of a slice of height 1."""
    height = 1.0 / cells
    grids = [
        Grid("shaft", block(cells, 1, width=1.0, height=height, corner=(1.0, 0.0))),
        Grid("hub", block(cells + 1, 1, width=1.0, height=height, corner=(2.0, 0.0))),
    ]
    scene = heated(
        grids, degrees=(2, 2), geometry="axisymmetric", cell="quadrilateral", nu=nu, alpha=1e-6
    )
    for body in ("shaft", "hub"):
        for side in ("bottom", "top"):
            scene.prescribe(f"{body} {side}", f"{body}/{side}", 0, 1)
    scene.prescribe("hot", "shaft/left", 1)
    scene.prescribe("cold", "hub/right", 1)
    pair = fm.ContactPair(
        scene.data, "shaft/right", "hub/left", fluxes=[fm.Conductance(1, law)],
        initial_gap=-interference,
    )  # fmt: skip
    problem = scene.problem([pair])
    scene.set(hot=hot)
    problem.solve()
    view = problem.contacts[0]
    return view.fluxes[0].into_master / height, float(view.pressure.mean())


def expected_fit(interference, hot, law, nu=0.3):
    """Lame's rings with temperatures A + B ln r in plane strain: one equation for p."""
    a, b, c, E, k, alpha = 1.0, 2.0, 3.0, 100.0, 5.0, 1e-6

    def ring(inner, outer, p_in, p_out, T_in, T_out, at):
        """Radial displacement at ``at``."""
        s = (T_out - T_in) / np.log(outer / inner)

        def heat(r):  # int_inner^r T r dr
            x = np.log(r / inner)
            return T_in * (r**2 - inner**2) / 2 + s * (r**2 * (x / 2 - 0.25) + inner**2 * 0.25)

        factor = (1 + nu) / (1 - nu) * alpha
        mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
        # sigma_r = 2 (lmbda + mu) C_1 - 2 mu C_2 / r^2 - 2 mu factor heat(r) / r^2
        matrix = [[2 * (lmbda + mu), -2 * mu / r**2] for r in (inner, outer)]
        rhs = [-p + 2 * mu * factor * heat(r) / r**2 for r, p in ((inner, p_in), (outer, p_out))]
        one, two = np.linalg.solve(matrix, rhs)
        return factor * heat(at) / at + one * at + two / at

    def flow(p):
        h = float(law(np.array([p]), np.zeros(1)).h[0])
        per = [np.log(b / a) / (2 * np.pi * k), 1 / (2 * np.pi * b * h)]
        return hot / (per[0] + per[1] + np.log(c / b) / (2 * np.pi * k)), per

    def overlap(p):
        q, (inside, across) = flow(p)
        T_b, T_hub = hot - q * inside, hot - q * (inside + across)
        shaft = ring(a, b, 0.0, p, hot, T_b, b)
        hub = ring(b, c, p, 0.0, T_hub, 0.0, b)
        return interference + shaft - hub

    p = brentq(overlap, 1e-6, 100.0, xtol=1e-13)
    return flow(p)[0], p


def test_heat_through_a_shrink_fit():
    """Heat flow and pressure, from one equation for p; strains of 5e-5 are not negligible."""
    law = fm.PressureConductance(4.0, 0.01)
    exact = expected_fit(1e-4, 60.0, law)
    assert shrink_fit(8, 1e-4, 60.0, law) == pytest.approx(exact, rel=1e-4)


@pytest.mark.once
def test_heat_flow_of_a_hot_cylinder_converges():
    """A hot rigid cylinder under a force on an elastic block: heat flow and peak pressure."""

    def results(cells):
        grid = Grid("b", block(cells, cells, width=2.0, height=2.0))
        scene = heated([grid], degrees=(2, 2), alpha=2e-4)
        scene.prescribe("x", "b/left", 0, 0)
        scene.prescribe("y", "b/bottom", 0, 1)
        scene.prescribe("cold", "b/bottom", 1)
        cylinder = fm.Circle((0.0, 4.0), 2.0)
        cylinder.push(y=-4.0)
        heat = fm.Conductance(1, fm.PressureConductance(5.0, 10.0), temperature=100.0)
        problem = scene.problem([fm.ContactPair(scene.data, "b/top", cylinder, fluxes=[heat])])
        problem.solve()
        view = problem.contacts[0]
        return np.array([view.fluxes[0].into_slave, view.pressure.max()])

    finest = results(48)
    errors = [np.abs(results(cells) / finest - 1.0).max() for cells in (8, 24)]
    assert errors[1] < 4e-3 and errors[1] < errors[0] / 2.0


def sliding_block(share, *, steps=3, capacity=2.0):
    """A block that slides on an insulated plane; heat and friction work per step."""
    scene = heated([Grid("b", block(6, 3, width=1.0, height=0.5))], degrees=(1, 1), alpha=0.0)
    scene.prescribe("y", "b/top", 0, 1)
    scene.prescribe("x", "b/top", 0, 0)
    old = fem.Function(scene.w.function_space)
    dt = 0.1
    before = old.sub(1)
    scene.residual += capacity * (scene.T - before) / dt * scene.test * scene.dx
    floor = fm.Plane((0.0, 0.0), (0.0, 1.0))
    heat = fm.Conductance(1, 0.0, heating="friction", share=share, temperature=0.0)
    pair = fm.ContactPair(scene.data, "b/bottom", floor, law=fm.Coulomb(0.4), fluxes=[heat])
    problem = scene.problem([pair])
    stored, work = [], []
    total = fem.form(capacity * scene.T * scene.dx)
    for step in range(1, steps + 1):
        scene.set(y=-0.02, x=0.05 * step)
        problem.time = dt * step
        problem.solve()
        stored.append(scene.data.mesh.comm.allreduce(fem.assemble_scalar(total)))
        work.append(problem.contacts[0].friction_work)
        old.x.array[:] = scene.w.x.array
    return np.array(stored), np.array(work)


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_frictional_heat_is_the_work_of_friction(share):
    """The heat stored in a block that slides on an insulated plane, step by step, to rounding."""
    stored, work = sliding_block(share)
    assert work.min() > 0.0
    assert stored == pytest.approx(share * np.cumsum(work), rel=1e-11)


# Balance


@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
def test_loads_of_both_sides_balance_on_partly_covered_surfaces(degrees):
    scene = stacked((5, 7), degrees=degrees, overhang=0.43)
    pair = fm.ContactPair(
        scene.data, "lower/top", "upper/bottom", fluxes=[fm.Conductance(1, MIXED)]
    )
    problem = scene.problem([pair])
    scene.set(top=-0.05, hot=20.0)
    report = problem.solve()
    found = report.certificate.pairs[0]["balance of field 1"]
    assert found.verdict == "ok" and found.value < 1e-14
    flux = problem.contacts[0].fluxes[0]
    assert flux.into_slave == pytest.approx(-flux.into_master, rel=1e-13)
    assert flux.into_slave > 0.0


@pytest.mark.parametrize("degrees", [(1, 1), (2, 1), (2, 2)])
@pytest.mark.parametrize("h", [MIXED, float("inf")])
def test_certificate_knows_the_law_of_conduction(h, degrees):
    """Satisfied by a solution, also without flux; violated by other temperatures."""
    scene = stacked((5, 7), degrees=degrees, overhang=0.43, alpha=1e-5)
    pair = fm.ContactPair(scene.data, "lower/top", "upper/bottom", fluxes=[fm.Conductance(1, h)])
    problem = scene.problem([pair])
    for hot, cold in ((20.0, 0.0), (20.0, 19.9), (300.0, 300.0)):
        scene.set(top=-0.05, hot=hot, cold=cold)
        certificate = problem.solve().certificate.pairs[0]
        assert certificate["conduction of field 1"].verdict == "ok"
    _, dofs = compat.collapsed(scene.w.function_space.sub(1))
    scene.w.x.array[dofs] += 3.0 * np.sin(np.arange(len(dofs)))
    wrong = problem.certificate().pairs[0]["conduction of field 1"]
    assert wrong.verdict == "violation"


def test_temperatures_may_be_shifted():
    """The same constant added to all temperatures changes nothing but them."""
    found = []
    for shift in (0.0, 273.15):
        scene = stacked((5, 7), alpha=0.0, overhang=0.3)
        heat = fm.Conductance(1, MIXED)
        pair = fm.ContactPair(scene.data, "lower/top", "upper/bottom", fluxes=[heat])
        problem = scene.problem([pair])
        scene.set(top=-0.05, hot=20.0 + shift, cold=shift)
        problem.solve()
        found.append(problem.contacts[0].fluxes[0].into_slave)
    assert found[1] == pytest.approx(found[0], rel=1e-11)


@pytest.mark.serial
@pytest.mark.parametrize("h", [2.0, fm.PressureConductance(20.0, 5.0)], ids=str)
def test_bars_that_heat_flow_separates_have_a_steady_state_if_flow_begins_with_pressure(h):
    """Hot below: open bars close a gap of 0.02 by 0.021, and in contact shrink (Barber 1978)."""
    hot, gap, alpha = 10.5, 0.02, 1e-3
    scene = stacked((2, 3), nu=0.0, alpha=alpha)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, h)])
    problem = scene.problem([pair])
    scene.set(top=gap, cold=hot)
    if h == 2.0:
        with pytest.raises(fm.NotConvergedError, match=r"Conductance\(1, 2.0\) jumps at closing"):
            problem.solve()
        return

    def overlap(p):  # that of free bars of lengths 2 and 1, and that by which p shortens them
        flow = hot / (3.0 / 5.0 + 1.0 / h(np.array([p]), np.zeros(1)).h[0])
        return alpha * (2.0 * hot - flow * (2.0**2 - 1.0) / (2.0 * 5.0)) - gap - 3.0 * p / 100.0

    problem.solve()
    assert problem.contacts[0].pressure == pytest.approx(brentq(overlap, 1e-6, 1.0), rel=1e-9)


def beside_each_other(cells, degrees, *, h=None, algorithm=None, beyond=0.0):
    """Blocks pressed together, with the conductance ``h`` or tied.

    A side of the lower one is cold, the opposite side of the upper one is hot. The lower one ends
    ``beyond`` both sides of the upper one.
    """
    grid = block(cells[0], cells[0], width=1.0 + 2.0 * beyond, height=1.0, corner=(-beyond, 0.0))
    lower = Grid("lower", grid)
    upper = Grid("upper", block(cells[1], cells[1], width=1.0, height=1.0, corner=(0.0, 1.0)))
    scene = heated([lower, upper], degrees=degrees, alpha=1e-4, nu=0.0)
    for body in ("lower", "upper"):
        scene.prescribe(f"{body} x", [f"{body}/left", f"{body}/right"], 0, 0)
    scene.prescribe("bottom", "lower/bottom", 0, 1)
    scene.prescribe("top", "upper/top", 0, 1)
    scene.prescribe("cold", "lower/left", 1)
    scene.prescribe("hot", "upper/right", 1)
    sides = scene.data, "upper/bottom", "lower/top"
    pair = fm.TiedPair(*sides, fields=[1])
    if h is not None:
        pair = fm.ContactPair(*sides, fluxes=[fm.Conductance(1, h)])
    problem = scene.problem([pair], algorithm=algorithm)
    scene.set(top=-0.02, hot=10.0)
    problem.solve()
    return problem


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("degrees", [(1, 1), (2, 2)])
def test_perfect_conduction_is_that_of_a_tie(degrees, algorithm):
    """Fluxes that vary along the contact, and a slave node with a prescribed temperature.

    A tie integrates over undeformed facets. With quadratic functions ties and contacts hand over
    in other ways at prescribed nodes.
    """
    contact = beside_each_other((5, 7), degrees, h=np.inf, algorithm=algorithm)
    tie = beside_each_other((5, 7), degrees)
    found, expected = (p.contacts[0].fluxes[0].into_master for p in (contact, tie))
    assert found == pytest.approx(expected, rel=2e-5 if degrees == (1, 1) else 0.01)
    assert contact.contacts[0].fluxes[0].jump == pytest.approx(0.0, abs=1e-9)
    # The cover has a kink where both sides end at the same place.
    smooth = beside_each_other((5, 7), degrees, h=np.inf, algorithm=algorithm, beyond=0.13)
    slopes = smooth.check_tangent(print_table=False).slopes
    assert slopes["whole"] == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("h", [1e5, np.inf])
def test_large_conductances_do_not_lock_fields_of_degree_one(h):
    """Jumps of zero at all nodes of facets of degree 2 would be two constraints for each dof.

    The heat flow was wrong by 9 % then; ties on fine cells have 46.2.
    """
    flow = beside_each_other((10, 14), (2, 1), h=h).contacts[0].fluxes[0].into_master
    assert flow == pytest.approx(46.2, rel=0.03)


@pytest.mark.once
@pytest.mark.parametrize("pressed", [False, True])
@pytest.mark.parametrize("law", [None, fm.Coulomb(0.3)], ids=str)
def test_iterations_do_not_depend_on_a_large_conductance(law, pressed):
    """From 1e4 to 1e9 and inf, in a sliding contact: jumps of second order times h are large."""
    found, counts = [], []
    for h in (1e4, 1e7, 1e9, np.inf):
        scene = stacked((5, 7), overhang=0.3)
        scene.prescribe("shift", "upper/top", 0, 0)
        scene.bcs.pop(1)  # of the upper body's side
        own = fm.PressureConductance(h, 1.0) if pressed and h < np.inf else h
        heat = fm.Conductance(1, own)
        pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", law=law, fluxes=[heat])
        problem = scene.problem([pair])
        for step in (0, 1, 2):
            scene.set(top=-0.03, shift=0.07 * step, hot=10.0)
            counts.append(problem.solve().num_iterations)
        found.append(problem.contacts[0].fluxes[0].into_master)
    assert max(counts) <= 8
    assert problem.check_tangent(print_table=False).slopes["whole"] == pytest.approx(2.0, abs=0.02)
    errors = abs(np.array(found[:-1]) / found[-1] - 1.0)
    assert errors[0] < 1e-3 and errors[1] < 1e-6 and errors[2] < 1e-6, errors


def test_separate_fields_have_no_infinite_conductance():
    scene = stacked((3, 3))
    T = fem.Function(fm.scalar_space(scene.data.mesh, 1))
    heat = fm.Conductance(T, float("inf"))
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[heat])
    with pytest.raises(ValueError, match="expected a finite conductance, or the number"):
        scene.problem([pair])
    heat.h = 1.0
    problem = scene.problem([pair])
    scene.set(top=-0.03)
    problem.solve()
    heat.h = float("inf")
    with pytest.raises(fm.MortarError, match="expected a finite conductance"):
        problem.matrices.flux_loads()


@pytest.mark.each
@pytest.mark.parametrize(
    "case, names",
    [
        ("open", "body 'upper'"),
        ("adiabatic", "body 'upper'"),
        ("nowhere prescribed", "body 'lower' and body 'upper'"),
    ],
)
def test_heated_bodies_without_a_level_of_temperature_are_named(case, names):
    """A source in a body that no condition and no conduction holds: the system is singular."""
    scene = stacked((5, 7))
    scene.residual = scene.residual - 3.0 * scene.test * ufl.dx
    scene.bcs.pop(5)  # hot
    if case == "nowhere prescribed":
        scene.bcs.pop(4)
    heat = fm.Conductance(1, 0.0 if case == "adiabatic" else 2.0)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[heat])
    problem = scene.problem([pair])
    scene.set(top=0.03 if case == "open" else -0.03)
    with pytest.raises(fm.NotConvergedError, match=f"level of field 1 of {names}: neither"):
        problem.solve()


def test_a_body_that_no_heat_reaches_has_a_remark_that_its_level_is_any():
    """Without a source the state has a level by chance: that of the first guess, or of rounding."""
    scene = stacked((5, 7))
    scene.bcs.pop(5)  # hot
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, 2.0)])
    problem = scene.problem([pair])
    for top, told in ((0.03, True), (-0.03, False)):
        scene.set(top=top)
        remarks = problem.solve().certificate.remarks()
        found = [text for text in remarks if "level of field 1 of body 'upper': neither" in text]
        assert len(found) == told and not any("body 'lower'" in text for text in found)


def test_a_field_without_part_in_the_stress_leaves_its_accuracy():
    """Rubber on steel at 300 K everywhere: T has no displacement that is equivalent to it."""
    lower, upper = block(4, 2, width=0.02, height=0.01), block(3, 2, width=0.01, height=0.01)
    bodies = [Grid("lower", lower), Grid("upper", upper + np.array([0.003, 0.01]))]
    moduli = {"lower": 2e11, "upper": 2e4}
    data = mesh(bodies)
    W = fm.mixed_space(data.mesh, ("Lagrange", 1, (2,)), ("Lagrange", 1))
    w, q = fem.Function(W), ufl.TestFunctions(W)[1]
    u, T = ufl.split(w)
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    residual = 50.0 * ufl.inner(ufl.grad(T), ufl.grad(q)) * ufl.dx(degree=3)
    for name, E in moduli.items():
        psi = fm.energies.neo_hookean(u, *fm.energies.lame(E, 0.3)) * dx(
            data.bodies[name], degree=3
        )
        residual += ufl.derivative(psi, w, ufl.TestFunction(W))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, 2000.0)])
    sides = [(0, "lower/bottom", 0.0, 0), (0, "lower/bottom", 0.0, 1)]
    sides += [(0, "upper/top", 2e-4, 0), (0, "upper/top", -1.5e-3, 1)]
    sides += [(1, "lower/bottom", 300.0), (1, "upper/top", 300.0)]
    bcs = [fm.dirichlet(W.sub(part), data, *side) for part, *side in sides]
    problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="apart_")
    report = problem.solve()
    assert report.allowed < 1e-5 * report.force and report.certificate.balance < 1e-6


def solved_flow(expansion, conductivity=5.0, E=100.0):
    """Heat flow over conductivity, of nonlinear conduction through a contact."""
    scene = stacked((5, 7), alpha=expansion, conductivity=conductivity, E=E)
    more = 0.1 * scene.T**2 * ufl.inner(ufl.grad(scene.T), ufl.grad(scene.test))
    scene.residual = scene.residual + conductivity * more * scene.dx
    heat = fm.Conductance(1, 0.4 * conductivity)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[heat])
    problem = scene.problem([pair])
    scene.set(top=-0.02, hot=20.0)
    problem.solve()
    return problem.contacts[0].fluxes[0].into_master / conductivity


@pytest.mark.parametrize(
    "units", [(1e-9,), (1e-15,), (0.0, 1e-9, 1e9), (1e-15, 1e-8, 2e11)], ids=str
)
def test_a_field_of_little_part_in_the_stress_converges(units):
    """As residuals are measured as forces, that of T hardly counts, whatever the units of flows."""
    assert solved_flow(*units) == pytest.approx(solved_flow(1e-3), rel=1e-10)


@pytest.mark.parametrize("E, conductivity", [(100.0, 5.0), (2e11, 1e-6)])
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("heating", ["friction", None])
def test_temperatures_of_rounding_converge(heating, algorithm, E, conductivity):
    """Heat of friction at nodes that stick, and what remains of 300 K that are taken away."""
    grids = [Grid("lower", block(5, 3, width=2.0, height=1.0))]
    grids.append(Grid("upper", block(4, 3, width=1.0, height=1.0, corner=(0.4, 1.0))))
    scene = heated(grids, E=E, conductivity=conductivity, alpha=0.1 / E)
    scene.hold("bottom", "lower/bottom")
    scene.hold("top", "upper/top")
    scene.prescribe("cold", "lower/bottom", 1)
    scene.prescribe("hot", "upper/top", 1)
    heat = fm.Conductance(1, 0.7 * conductivity, heating=heating)
    law = fm.Coulomb(0.5) if heating else None
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", law=law, fluxes=[heat])
    problem = scene.problem([pair], algorithm=algorithm)
    steps = (
        ((0.0, -0.02), 0.0),
        ((0.001, -0.02), 0.0),
        ((0.001, -0.02), 300.0),
        ((0.001, -0.02), 0.0),
    )
    for number, (top, hot) in enumerate(steps, start=1):
        problem.time = float(number)
        scene.set(top=top, hot=hot)
        assert problem.solve().num_iterations <= 6
        largest = np.abs(scene.at(1)[0]).max()
        assert largest == pytest.approx(hot, abs=1e-2 * hot + 1e-2)


# Bad input


def refused(scene, match, pair=None, error=ValueError, **options):
    with pytest.raises(error, match=match):
        given = {"slave": "upper/bottom", "master": "lower/top", **(pair or {})}
        scene.problem([fm.ContactPair(scene.data, **given, **options)])


def test_unsuitable_fields_are_refused():
    scene = stacked()
    refused(scene, "another sub-space than the displacement", fluxes=[fm.Conductance(0, 1.0)])
    refused(scene, "another sub-space than the displacement", fluxes=[fm.Conductance(7, 1.0)])
    refused(scene, "two of one field", fluxes=[fm.Conductance(1, 1.0), fm.Conductance(1, 2.0)])
    refused(scene, "expected a list of Conductance", fluxes=[3.0])
    refused(scene, "expected a list of Conductance", fluxes=fm.Conductance(1, 1.0))
    refused(scene, "omit temperature", fluxes=[fm.Conductance(1, 1.0, temperature=3.0)])
    plane = {"master": fm.Plane((0.0, 1.9), (0.0, 1.0))}
    refused(scene, "give temperature", plane, fluxes=[fm.Conductance(1, 1.0)])
    refused(stacked(degrees=(1, 2)), "of degree 1 or of that", fluxes=[fm.Conductance(1, 1.0)])


@pytest.mark.parametrize(
    "arguments, match",
    [
        ((1, -1.0), "at least 0"),
        ((1, np.nan), "at least 0"),
        ((1, []), "at least one conductance"),
        ((1.5, 1.0), "number of a sub-space"),
        ((1, "h"), "a number that is at least 0, or a function"),
    ],
)
def test_wrong_arguments_are_named(arguments, match):
    with pytest.raises(ValueError, match=match):
        fm.Conductance(*arguments)
    for options, named in (({"share": 1.5}, "share"), ({"heating": "rub"}, "heating")):
        with pytest.raises(ValueError, match=named):
            fm.Conductance(1, 1.0, **options)


@pytest.mark.parametrize(
    "h, match",
    [
        (lambda p, g: (-1.0 + 0 * p, 0.0, 0.0), "expected a finite conductance"),
        (lambda p, g: (np.nan * p, 0.0, 0.0), "expected a finite conductance"),
        (lambda p, g: p, "expected h, dh/dp and dh/dg"),
    ],
)
def test_a_wrong_function_is_named(h, match):
    scene = stacked()
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, h)])
    with pytest.raises(fm.MortarError, match=match):
        problem = scene.problem([pair])
        scene.set(top=-0.01, hot=1.0)
        problem.solve()


def test_functions_may_read_values_that_change():
    """Fluxes and their derivatives follow what the functions of a law return at present."""
    numbers = {"h": 1.0, "power": 0.0}
    heat = fm.Conductance(
        1,
        lambda p, g: (numbers["h"] + 0.0 * p, 0.0, 0.0),
        heating=lambda p, X: (numbers["power"] + 0.0 * p, 0.0),
    )
    scene = stacked((4, 4), nu=0.0, alpha=0.0)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[heat])
    problem = scene.problem([pair])
    scene.set(top=-0.03, hot=10.0)
    problem.solve()
    flux = problem.equations.contacts[0].fluxes[0]
    assert flux.nodal().conductance == pytest.approx(1.0)
    numbers["h"] = 2.0
    assert flux.nodal().conductance == pytest.approx(2.0)
    numbers["power"] = 3.0
    assert flux.nodal().heating == pytest.approx(3.0)


def test_values_set_later_take_effect_or_are_refused():
    heat = fm.Conductance(1, 1.0)
    scene = stacked((4, 4), nu=0.0, alpha=0.0)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[heat])
    problem = scene.problem([pair])
    scene.set(top=-0.03, hot=10.0)
    for h in (1.0, [1.0, 2.0]):
        heat.h = h
        problem.solve()
        resistance = 3.0 / 5.0 + 1.0 / np.sum(h)
        flux = problem.contacts[0].fluxes[0]
        assert flux.into_master == pytest.approx(10.0 / resistance, rel=1e-10)
    for name, value in (
        ("h", -1.0), ("h", []), ("share", 7.0), ("scale", -1.0), ("scale", np.nan),
        ("heating", "rub"), ("temperature", "hot"), ("field", 0), ("capacity", 1.0),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=name):
            setattr(heat, name, value)
    assert heat.field == 1 and heat.h == [1.0, 2.0] and heat.scale == 1.0


def test_heat_of_friction_needs_the_length_of_the_step():
    """As laws of rates: no power of a step whose length is not given."""
    scene = stacked((4, 4))
    heat = fm.Conductance(1, 1.0, heating="friction")
    pair = fm.ContactPair(
        scene.data, "upper/bottom", "lower/top", law=fm.Coulomb(0.3), fluxes=[heat]
    )
    problem = scene.problem([pair])
    scene.set(top=-0.01)
    with pytest.raises(fm.MortarError, match="needs the length of the step"):
        problem.solve()
    problem.time = 0.1
    problem.solve()


# One after the other


def staggered(scene, h, *, top, hot, sweeps=12):
    """Displacement and temperature in problems of their own, by turns; the last heat flow."""
    mesh, boundaries = scene.data.mesh, ("lower/bottom", "upper/top")
    V, S = fm.vector_space(mesh, 2), fm.scalar_space(mesh, 2)
    u, T, s = fem.Function(V), fem.Function(S), ufl.TestFunction(S)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    e = fm.energies.elastic_strain(u, 1e-3 * T)
    sigma = fm.energies.stress(fm.energies.linear_elastic, e, *fm.energies.lame(100.0, 0.0))
    work = ufl.inner(sigma, fm.energies.elastic_strain(ufl.TestFunction(V))) * dx
    bcs = [fm.dirichlet(V, scene.data, f"{body}/{side}", 0.0, 0)
           for body in ("lower", "upper") for side in ("left", "right")]  # fmt: skip
    bcs += [fm.dirichlet(V, scene.data, name, y, 1) for name, y in zip(boundaries, (0.0, top))]
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(T, h)])
    problem = fm.ContactProblem(work, u, [pair], bcs=bcs, petsc_options_prefix="body_")
    heat = 5.0 * ufl.inner(ufl.grad(T), ufl.grad(s)) * dx
    given = [fm.dirichlet(S, scene.data, name, t) for name, t in zip(boundaries, (0.0, hot))]
    marks = np.full(T.x.array.size, np.nan)
    for values in (T.x.array, marks):
        compat.set_prescribed(values, given)
    owned = np.flatnonzero(np.isfinite(marks[: S.dofmap.index_map.size_local])).astype(np.int32)
    ksp = PETSc.KSP().create(mesh.comm)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    for _ in range(sweeps):
        problem.solve()
        A = compat.create_matrix(compat.form(ufl.derivative(heat, T)))
        compat.assemble_matrix(A, compat.form(ufl.derivative(heat, T)))
        b = compat.create_vector(S)
        compat.assemble_vector(b, compat.form(heat))
        b.axpy(1.0, problem.matrices.flux_loads())
        A.axpy(1.0, problem.matrices.flux_derivative())
        A.zeroRows(owned + A.getOwnershipRange()[0], 1.0)
        b.array[owned] = 0.0
        change = b.duplicate()
        ksp.setOperators(A)
        ksp.solve(b, change)
        T.x.array[: len(change.array)] -= change.array
        T.x.scatter_forward()
    problem.solve()
    return problem.contacts[0].fluxes[0], problem


@pytest.mark.serial
def test_problems_solved_by_turns_have_the_solution_of_both_together():
    law = fm.PressureConductance(8.0, 1.0)
    flux, problem = staggered(stacked((4, 6), degrees=(2, 2)), law, top=-0.001, hot=10.0)
    scene = stacked((4, 6), degrees=(2, 2), nu=0.0)
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=[fm.Conductance(1, law)])
    together = scene.problem([pair])
    scene.set(hot=10.0, top=-0.001)
    together.solve()
    expected = together.contacts[0].fluxes[0]
    assert flux.into_master == pytest.approx(expected.into_master, rel=1e-9)
    assert flux.jump == pytest.approx(expected.jump, rel=1e-8)
    assert problem.contacts[0].pressure == pytest.approx(together.contacts[0].pressure, rel=1e-8)
    with pytest.raises(ValueError, match="with the field's own function"):
        together.matrices.flux_loads()
