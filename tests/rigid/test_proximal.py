# SPDX-License-Identifier: MIT
"""Proximal point method: initial states of its solves, and elongation of the springs."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_scenes import pushed_block
from supported_parts import Body, Flat, Touch
from supported_problem import floor_of, pose
from turning_scenes import shaft_in_ring

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.equations import solver
from fenics_mortar.equations.diagnosis import Remedies
from fenics_mortar.rigid import proximal
from fenics_mortar.rigid.proximal import carried_by
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block


class Scripted:
    """Equations with springs; each solve ends as defined by the script, and moves by one."""

    def __init__(self, script):
        self.script, self.place, self.springs, self.anchored = list(script), 0, self, []
        self.shares, self.ends = [], []

    def state(self):
        return self.place

    def restore(self, state):
        self.place, self.fraction = state, 0.0

    def anchor(self, elongation, share):
        self.shares.append(share)
        self.anchored.append((self.place, elongation))

    def remove_springs(self):
        pass

    def max_motion(self):
        return 1.0 if self.script else 0.0

    def tipping(self):
        return "falls" if "falls" in self.ends else ""

    def remaining(self):
        return proximal.Remaining(self.fraction, 0.0, "scripted")

    def solve(self, equations, options):
        self.place += 1
        report = fm.NewtonReport(converged=True)
        how = self.script.pop(0) if self.script else "yes"
        self.ends = [how]
        words = {"lifted": np.inf, "yes": 0.0, "no": 0.0, "falls": 0.5}
        self.fraction = words[how] if how in words else float(how)
        if how == "no":
            raise fm.NotConvergedError("scripted", report)
        return report


def test_bodies_that_tip_over_on_springs_come_first_in_the_message(monkeypatch):
    with pytest.raises(fm.NotConvergedError, match="^falls; at first"):
        run(monkeypatch, "yes falls no no no no no")


def run(monkeypatch, script):
    scripted = Scripted(script.split())
    monkeypatch.setattr(proximal, "solve", scripted.solve)
    failed = fm.NotConvergedError("at first", fm.NewtonReport(reason="at first"))
    try:
        proximal.solve_with_springs(scripted, fm.NewtonOptions(), failed)
    finally:
        places, elongations = zip(*scripted.anchored, strict=True)
        scripted.places, scripted.elongations = places, np.array(elongations)
    return scripted


def test_springs_are_anchored_where_the_last_good_solve_ended(monkeypatch):
    assert run(monkeypatch, "no yes no yes").places == (0, 0, 1, 1)


def test_elongation_recovers_after_failures_up_to_the_first(monkeypatch):
    """An eighth after a failure, twice after a success [shortest facets]."""
    scripted = run(monkeypatch, "yes no no yes yes yes yes yes yes yes")
    first = np.array([1, 1, 1 / 8, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1]) / 4
    assert scripted.elongations == pytest.approx(first)


def test_second_pass_from_the_start_leaves_out_what_failed_there(monkeypatch):
    """Bodies that lose contact are followed again, with the elongation of the first good solve."""
    scripted = run(monkeypatch, "no no " + 22 * "lifted " + "no")
    assert scripted.places[24] == 0
    assert scripted.elongations[[0, 1, 2, 24]] == pytest.approx(np.array([64, 8, 1, 1]) / 256)


def test_bodies_that_errors_of_contact_forces_turn_for_ever_remain_where_they_carry_least(
    monkeypatch,
):
    """If the springs carry too much after both passes, and without them nothing is found."""
    passes = "0.1 0.02 0.003 0.004 " + 20 * "0.008 " + "no " + 24 * "0.008 "
    scripted = run(monkeypatch, passes + "no 0.0032")
    assert scripted.places[-1] == 3 and len(scripted.places) == 49
    assert scripted.fraction == 0.0032
    scripted = run(monkeypatch, 2 * (24 * "0.004 " + "no ") + "0.0032 ")
    assert scripted.places[-1] == 1 and len(scripted.places) == 49


def test_bodies_do_not_run_away_on_an_incline_without_a_stop():
    """The loads drive a block everywhere by the same negligible force: it stays, with a remark."""
    problem = on_an_incline(0.004, stop=np.inf)
    assert problem.solve().certificate.held.startswith("springs carry 4.0e-03")
    assert np.abs(problem.state().u).max() < 0.1


def test_springs_that_carry_little_become_weaker(monkeypatch):
    """Halved after each solve in which they carry a negligible force; anew where they fail."""
    shares = run(monkeypatch, "0.1 0.004 0.004 0.004 0.006 0.004 no 0.004 yes yes").shares
    assert shares[:10] == [1, 1, 1 / 2, 1 / 4, 1 / 8, 1, 1 / 2, 1, 1 / 2, 1 / 4]


def on_a_hill(radius, at, room):
    """A block of size 1 with weight 0.2 on a hill, ``at`` beside the top; a wall after ``room``."""
    n = 8 if radius == 10.0 else 4
    grid = Grid("block", mapped_grids.block(n, n, width=1.0, height=1.0, corner=(at - 0.5, 0.0)))
    data = mapped_grids.mesh([grid])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = fm.energies.neo_hookean(u, *fm.energies.lame(100.0, 0.3))
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    hill = fm.Circle((0.0, -radius), radius, name="hill")
    pairs = [fm.ContactPair(data, "block/bottom", hill)]
    if room < np.inf:
        wall = fm.Plane((at + 0.5 + room, 0.0), (-1.0, 0.0), name="wall")
        pairs.append(fm.ContactPair(data, "block/right", wall))
    residual = ufl.derivative(energy * dx, u, v) + 0.2 * v[1] * dx
    return fm.ContactProblem(residual, u, pairs, bcs=[], petsc_options_prefix="hill_")


@pytest.mark.parametrize(
    ("radius", "at", "room"),
    [(10.0, 0.02, 0.04), pytest.param(50.0, 0.1, 0.2, marks=pytest.mark.serial)],
)
def test_a_block_slides_off_a_hill_until_it_meets_a_wall(radius, at, room):
    """Beside the top springs carry little, and then more, on the way to the only equilibrium."""
    problem = on_a_hill(radius, at, room)
    certificate = problem.solve().certificate
    assert certificate.springs == 0.0 and certificate.held == "" and certificate.remarks() == []
    slope = (at + room) / radius  # at the centre of the block, which is at the wall
    assert -problem.contacts[1].total_force[0] == pytest.approx(0.2 * slope, rel=0.15)


def on_an_incline(slope, stop):
    """A block of width 1 and height 0.6 with a weight of 0.6; a stop at ``stop``."""
    data = mapped_grids.mesh([Grid("block", mapped_grids.block(2, 2, width=1.0, height=0.6))])
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = fm.energies.linear_elastic(u, *fm.energies.lame(100.0, 0.3))
    residual = ufl.derivative(energy * ufl.dx, u, v) + (v[1] - slope * v[0]) * ufl.dx
    pairs = [fm.ContactPair(data, "block/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))]
    if stop < np.inf:
        pairs.append(fm.ContactPair(data, "block/right", fm.Plane((stop, 0.0), (-1.0, 0.0))))
    return fm.ContactProblem(residual, u, pairs, bcs=[], petsc_options_prefix="incline_")


def test_a_block_slides_down_a_slight_incline_until_it_meets_a_stop():
    """The first springs hold it at rest: weight times slope, a tenth of what slides on a hill."""
    slope, problem = 2e-4, on_an_incline(2e-4, stop=1.4)
    certificate = problem.solve().certificate
    assert certificate.springs == 0.0 and certificate.remarks() == []
    assert problem.contacts[1].total_force[0] == pytest.approx(-0.6 * slope, rel=1e-6)


def test_a_block_that_springs_hold_on_a_hill_has_a_remark():
    """The force of the springs is that of the slope."""
    problem = on_a_hill(50.0, 0.1, np.inf)
    (remark,) = problem.solve().certificate.remarks()
    carried = problem.certificate().springs
    slope = (0.1 + problem.state().u[0::2].mean()) / 50.0
    assert carried == pytest.approx(slope, rel=0.1)
    assert remark.startswith(f"springs carry {carried:.1e} of the contact force on body 'block'")
    assert "without which it would move along (1, -0.002" in remark


def test_five_failures_in_a_row_are_too_many(monkeypatch):
    assert run(monkeypatch, "no no no no yes no no no no yes").places[-1] == 1
    with pytest.raises(fm.NotConvergedError, match="at first"):
        run(monkeypatch, "no no no no no yes")


def test_springs_begin_where_the_solve_without_them_began(monkeypatch):
    problem = pushed_block(pin=(0,))
    problem.equations.evaluate(start=True)
    start, begun = problem.state(), []

    def fails(equations, options):
        problem.equations.bulk.u.x.array[:] += 1e-3
        raise fm.NotConvergedError("scripted", fm.NewtonReport())

    def with_springs(equations, options, failed):
        begun.append(problem.equations.bulk.u.x.array.copy())
        return fm.NewtonReport(converged=True)

    monkeypatch.setattr(solver.loop, "solve", fails)
    monkeypatch.setattr(solver, "solve_with_springs", with_springs)
    monkeypatch.setattr(problem.equations.remedies, "drifts", lambda: False)
    problem._solver._solve()
    assert np.array_equal(begun[0], start.u)


def test_springs_without_contact_are_reported():
    cases = {(1.0, 4.0): 0.25, (0.0, 0.0): 0.0, (1e-9, 0.0): np.inf}
    for (springs, contact), expected in cases.items():
        carried = carried_by(disk(contact), np.array([0.0, springs]), np.zeros(2))
        assert carried == ("disk", expected, False, "turn" if springs else "", False, False)


def disk(force, contacts=(), at=None):
    """A body that turns, with its contact force."""
    return SimpleNamespace(
        name="disk", contacts=contacts, at=at, contact_force=lambda: force,
        describe=lambda motion, *, directed: "turn",
    )  # fmt: skip


@pytest.mark.parametrize(("own", "expected"), [([0], True), ([0, 1], False), ([3], False)])
def test_a_body_slides_if_no_node_of_its_own_sticks(own, expected):
    """Nodes 0 and 2 slide, 1 sticks, 3 is open; the others belong to another body."""
    contact = SimpleNamespace(
        sliding=np.array([True, False, True, False]), sticking=np.arange(4) == 1,
        active=np.arange(4) < 3, now=SimpleNamespace(has_partner=np.ones(4, bool)),
    )  # fmt: skip
    body = disk(1.0, [contact], lambda contact: np.isin(np.arange(4), own))
    carried = carried_by(body, np.ones(1), -np.ones(1))
    assert carried.slides == expected and carried.closed == expected


def test_a_residual_that_is_not_finite_is_no_slight_force():
    """Weak springs would start from the state of a failed iteration, five times."""
    floating = SimpleNamespace(anchored=False, loose=list, bodies=[disk(0.0)])
    forces = SimpleNamespace(force=1.0)
    equations = SimpleNamespace(contacts=[], floating=floating, residual=forces)
    remedies = Remedies(equations, lambda snap: False)
    remedies.residuals += [1.0, 0.0]
    assert "disk" in remedies.drifts()
    remedies.residuals[-1] = float("nan")
    assert not remedies.drifts()


@pytest.mark.parametrize("E, push", [(1e2, 0.45), (1e3, 0.495)])
def test_a_block_that_tips_over_within_its_last_facet_is_refused_soon(E, push):
    """Its edge yields, and no place balances it; in 531 and 424 iterations with all springs."""
    bodies, floor = floor_of("body", width=3.0, columns=13, left=-1.0)
    grid = Grid("block", block(4, 8, width=1.0, height=2.0))
    bodies = [Body(grid, weight=1.0, push=1.0), *bodies]
    path = [{"weight": 1.0}, {"weight": 1.0, "push": push}]
    scene = pose("tips", bodies, [Touch("block/bottom", floor, fm.Coulomb(0.9))], path, E=E)
    with pytest.raises(fm.NotConvergedError, match="'block' tips over") as failed:
        list(scene.solve())
    assert failed.value.report.num_iterations < 100


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_planes_that_press_a_block_out_of_balance_are_said_to(mu):
    """Nothing resists what is left of their pushes; with one of them held there is balance."""
    law = fm.Coulomb(mu) if mu else None
    planes = [
        Flat((0.0, 0.0), (1.0, 0.0), "left", force=(1.2, 0.0)),
        Flat((1.0, 0.0), (-1.0, 0.0), "right", force=(-1.0, 0.0)),
    ]
    touches = [Touch(f"block/{plane.name}", plane, law) for plane in planes]
    bodies = [Body(Grid("block", block(4, 3, width=1.0, height=0.6)))]
    scene = pose("jaws", bodies, touches, [{}])
    with pytest.raises(fm.NotConvergedError, match="not in balance.*prescribe the motion of one"):
        scene.problem.solve()
    scene.obstacles["left"].move(x=0.0)
    scene.problem.solve()
    assert scene.force(0)[0] == pytest.approx(1.0)


def test_a_moment_above_the_friction_of_a_press_fit_is_told_first_and_soon():
    """Nothing is open that could stop the shaft: 296 iterations before."""
    shaft = shaft_in_ring(fm.Coulomb(0.3), interference=0.01, on_axle=True)
    contact = shaft.problem.equations.contacts[0]
    limit = 0.3 * float(contact.operators.weight @ contact.pressure)
    shaft.axle.push(moment=1.2 * limit)
    with pytest.raises(fm.NotConvergedError, match="^springs carry .* slide at their ") as found:
        shaft.problem.solve()
    assert len(found.value.report.iterations) < 70
