# SPDX-License-Identifier: MIT
"""Idle bodies: without load and contact force they stay, or give way without a force."""

import numpy as np
import pytest
from idle_scenes import disk_on_block, particle, queue, row, squeezed, wedge, without_pair
from scenes import linear_elastic, neo_hookean

import fenics_mortar as fm
from fenics_mortar.newton.loop import solve
from fenics_mortar.rigid.idle import IdleBodies
from fenics_mortar.utils.arrays import nonnegative_least_squares

# Rounding of gaps over the size of the scene [1]: of sums over the nodes of a facet.
ROUNDING = 1e-13


def pairs_of(scene, name):
    """Contacts in which a body takes part."""
    contacts = scene.problem.equations.contacts
    return [c for c in contacts if name in f"{c.slave.name} {c.master.name}"]


def overlap(contact):
    """Largest mean overlap of a covered node [length]."""
    return float(np.max(-contact.now.mean_gap[contact.now.covered], initial=0.0))


def assert_idle(scene, report, names, size=1.0):
    """No force acts on the bodies, they overlap nothing, and the report states this."""
    for name in names:
        for contact in pairs_of(scene, name):
            assert not contact.z.any()
            assert overlap(contact) <= ROUNDING * size
        remarks = report.certificate.remarks()
        assert any("nothing holds" in text and f"'{name}'" in text for text in remarks)
    assert report.certificate.violations() == []


@pytest.mark.parametrize("slave", ["loaded", "idle"])
@pytest.mark.parametrize("mu, base", [(0.0, "plane"), (0.3, "plane"), (0.3, "body")])
def test_a_block_beside_a_pressed_one_gives_way_without_a_force(mu, base, slave):
    """The side of the pressed block bulges by nu times its strain; the other one moves so far."""
    scene = row(mu, base, slave=slave)
    for load, report in zip((1.0, 5.0), scene.solve(), strict=True):
        assert_idle(scene, report, ["idle0"])
        x, y, turn = scene.motion("idle0")
        # Half the width times nu (1 + nu) times the pressure at the bottom over E is an upper
        # bound on a plane; an elastic ground bulges the block once more.
        most = (1.0 if base == "plane" else 2.0) * 0.5 * 0.39 * load / 1e3
        assert 0.2 * most < x < most
        assert abs(y) < x and abs(turn) < 3.0 * x


@pytest.mark.parametrize("material", [linear_elastic, neo_hookean])
@pytest.mark.parametrize("idle, hover", [(1, 0.0), (2, 0.0), (2, 0.3)])
def test_blocks_in_no_pair_stay(idle, hover, material):
    """Also where the ground rises into them by less than the error of displacements."""
    scene, alone = (without_pair(n, hover=hover, material=material) for n in (idle, 0))
    (report,), _ = list(scene.solve()), list(alone.solve())
    assert report.certificate.violations() == []
    for k in range(idle):
        assert not scene.moved[scene.nodes(f"idle{k}")].any()
    names = " and ".join(f"body 'idle{k}'" for k in range(idle))
    remarks = report.certificate.remarks()
    assert sum(f"nothing holds {names}, and no contact force" in text for text in remarks) == 1
    springs = [note for note in report.notes if "spring" in note]
    assert not any("springs carry" in note or "idle" in note for note in springs), springs


def test_force_of_the_pressed_block_is_that_without_a_neighbour():
    with_idle, alone = row(0.3, idle=1, loads=(2.0,)), row(0.3, idle=0, loads=(2.0,))
    for scene in (with_idle, alone):
        list(scene.solve())
    pressures = [s.problem.equations.contacts[0].pressure for s in (with_idle, alone)]
    assert np.abs(pressures[0] - pressures[1]).max() < 1e-9 * pressures[1].max()


@pytest.mark.parametrize("mu, load", [(0.0, 2.2), (0.0, 2.4), (0.0, 2.8), (0.0, 3.0), (0.3, 3.0)])
def test_a_row_of_idle_blocks_gives_way_together(mu, load):
    scene = row(mu, idle=3, loads=(load,))
    (report,) = scene.solve()
    assert_idle(scene, report, ["idle0", "idle1", "idle2"])
    moves = [scene.motion(f"idle{k}")[0] for k in range(3)]
    assert 0.0 < moves[0] < 2e-3
    assert moves == pytest.approx([moves[0]] * 3, rel=0.1)


def test_nonnegative_least_squares_with_dependent_columns():
    """No component can decrease the residual, and none that is positive can at all."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        rows, columns = rng.integers(1, 12), rng.integers(1, 60)
        rank = rng.integers(1, rows + 1)
        A = np.round(2.0 * rng.normal(size=(rows, rank))) @ rng.normal(size=(rank, columns))
        A[:, columns // 2 : 2 * (columns // 2)] = A[:, : columns // 2]
        b = rng.normal(size=rows)
        x = nonnegative_least_squares(A, b)
        descent = A.T @ (b - A @ x) / max(np.linalg.norm(A), 1.0)
        assert (x >= 0.0).all() and descent.max() < 1e-11
        assert np.abs(descent[x > 0.0]).max(initial=0.0) < 1e-11


@pytest.mark.serial
def test_a_body_that_nothing_pushes_stays_exactly():
    """It lies beside the pressed one and does not touch it, and another hovers above the ground."""
    for options in ({"gap": 0.02}, {"gap": 0.02, "hover": 0.05}):
        scene = row(0.3, loads=(1.0, 5.0, 2.0), **options)
        for report in scene.solve():
            assert np.abs(scene.motion("idle0")).max() < 1e-15
            assert any("left in place" in note for note in report.notes)


@pytest.mark.once
def test_a_block_that_gave_way_stays_when_the_load_decreases():
    scene = row(0.3, loads=(5.0, 1.0, 0.0))
    moves = []
    for report in scene.solve():
        assert_idle(scene, report, ["idle0"])
        moves.append(scene.motion("idle0"))
    assert np.abs(np.array(moves) - moves[0]).max() < 1e-15


@pytest.mark.once
@pytest.mark.parametrize("length, stress", [(1e-6, 1e6), (1e3, 1e-6)])
def test_units_do_not_matter(length, stress):
    """Motions of an idle block over the unit of length, in two systems of units."""
    scenes = row(0.3, loads=(5.0,)), row(0.3, loads=(5.0,), length=length, stress=stress)
    for scene, size in zip(scenes, (1.0, length), strict=True):
        (report,) = scene.solve()
        assert_idle(scene, report, ["idle0"], size)
    moves = [scene.motion("idle0") * [1.0 / size, 1.0 / size, 1.0]
             for scene, size in zip(scenes, (1.0, length), strict=True)]  # fmt: skip
    assert moves[1] == pytest.approx(moves[0], abs=1e-8 * np.abs(moves[0]).max())


@pytest.mark.once
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a_block_squeezed_and_released_carries_force_and_then_none(mu):
    """Between two planes; it does not follow the one that moves away."""
    scene = squeezed(mu)
    contacts, right = scene.problem.equations.contacts, scene.obstacles["right"]
    right.move(x=-0.002)
    scene.problem.solve()
    before = scene.motion("block")
    assert all(c.pressure.max() > 0.1 for c in contacts)
    for opening in (0.001, 0.01):
        right.move(x=opening)
        report = scene.problem.solve()
        assert report.certificate.violations() == []
        assert not any(c.z.any() for c in contacts)
        assert any("nothing holds body 'block'" in note for note in report.notes)
        # It expands by 2e-3 and does not follow the jaw.
        assert np.abs(scene.motion("block") - before).max() < 2e-3


@pytest.mark.parametrize("mu, order, finite", [(0.3, 1, False), (0.3, 2, False), (0.3, 1, True)])
def test_a_particle_comes_loose_and_is_heated_again(mu, order, finite):
    """Off the centre of its hole. No load turns it, in an undeformed hole or a shrunk one."""
    problem, strain = particle(order, mu, finite=finite)
    contact = problem.equations.contacts[0]
    for value in (0.01, 0.0, -0.01, 0.01, -0.01, 0.02):
        strain.value = value
        report = problem.solve()
        assert report.certificate.violations() == []
        assert report.num_iterations <= 12
        assert contact.z.any() == (value > 0.0)
        # Clearance, offset and thermal strains are below 0.02.
        assert np.abs(problem.equations.bulk.u.x.array).max() < 0.02
        idle = any("nothing holds" in note for note in report.notes)
        assert idle == (value <= 0.0)


@pytest.mark.serial
@pytest.mark.parametrize("weight", [1.0, 10.0])
def test_a_disk_rests_on_a_block_although_contact_is_narrower_than_a_facet(weight):
    """With linear strain a finite rotation strains the disk: rigid moves are infinitesimal."""
    problem, load = disk_on_block(1e5, columns=6)
    load.value = weight
    report = problem.solve()
    assert report.certificate.violations() == []
    force = problem.equations.contacts[0].total_force
    # Exact but for forces of springs, which are below 0.5 %, and the polygon of cells of order 2.
    assert force[1] == pytest.approx(weight, rel=1e-4)
    assert abs(force[0]) < 0.005 * weight


@pytest.mark.serial
@pytest.mark.parametrize("around, mu, weight", [(14, 0.1, 1.0), (24, 0.3, 0.02)])
def test_a_disk_that_touches_a_block_with_one_node_rolls_onto_two(around, mu, weight):
    """Against springs, which carry its moment meanwhile: small motions are no equilibrium.

    Too weak springs lift it off; the second weight is 2e-7 of the stiffness.
    """
    problem, load = disk_on_block(1e5, mu, centre=0.013, columns=6, around=around)
    load.value = weight
    report = problem.solve()
    assert report.certificate.violations() == []
    contact = problem.equations.contacts[0]
    assert contact.total_force[1] == pytest.approx(weight, rel=1e-3)
    assert contact.active.sum() == 2


@pytest.mark.parametrize("gravity", [(0.0, 1.0), (0.5, -1.0)])
def test_a_load_that_nothing_supports_is_refused_beside_idle_bodies(gravity):
    """Also if it pushes an idle block, which nothing stops."""
    scene = row(0.3, gravity=gravity)
    with pytest.raises(fm.NotConvergedError, match="'loaded' can .* freely: it is driven by loads"):
        list(scene.solve())


@pytest.mark.once
def test_idle_blocks_between_a_load_and_a_wall_are_pushed_to_the_wall():
    """There is a gap before each of them; all carry the force in the end."""
    scene = queue(push=0.4)
    (report,) = scene.solve()
    assert report.certificate.violations() == []
    contacts = scene.problem.equations.contacts
    assert all(abs(c.total_force[0]) == pytest.approx(0.4, rel=1e-8) for c in contacts[:3])
    assert scene.motion("block0")[0] == pytest.approx(0.06, abs=5e-3)


def test_a_wedge_squeezed_out_by_prescribed_motions_is_refused():
    """Without friction; nothing stops it."""
    scene = wedge()
    scene.obstacles["left"].move(x=0.01)
    scene.obstacles["right"].move(x=-0.01)
    with pytest.raises(
        fm.MortarError, match="'wedge' can move along .* contact pushed it away.*give it"
    ):
        scene.problem.solve()


@pytest.mark.parametrize("mu, slave, gap", [(0.14, "idle", 0.04), (0.3, "loaded", 0.0)])
def test_a_block_whose_whole_load_is_removed_stays_where_it_was(mu, slave, gap):
    """The forces that friction needed before drive nothing, and vanish."""
    scene = row(mu, "body", slave=slave, gap=gap, loads=(4.0, 0.0), E=1e3)
    before = None
    for load, report in zip((4.0, 0.0), scene.solve(), strict=True):
        assert report.certificate.violations() == []
        now = np.concatenate([scene.motion(name) for name in ("loaded", "idle0")])
        if before is not None:
            # The strain is 4e-3: the block springs back by about as much.
            assert np.abs(now - before).max() < 1e-2
        before = now
        assert (load > 0.0) == any(c.z.any() for c in scene.problem.equations.contacts)


@pytest.mark.once
def test_an_idle_body_does_not_stay_pressed_on_its_spring():
    """Idle rollers of a bearing leant on theirs, and weak springs were refused for them.

    All idle bodies take part in contact first if some of them support others.
    """
    scene = row()
    scene.set(weight=1.0)
    scene.problem.solve()
    scene.set(weight=5.0)
    equations = scene.problem.equations
    idle, floating = equations.idle, equations.floating
    body = next(b for b in floating.bodies if b.name == "body 'idle0'")
    towards = np.tile([-1e-3, 0.0], equations.bulk.num_owned // 2)
    body.move(body.rigid_fraction(towards))  # it overlaps the loaded block
    idle.reset(may_be_aside=True)
    idle.find(equations.evaluate_forces)
    idle.first = set()
    equations.springs.anchor(0.25)
    solve(equations, equations.newton)
    carried = {each.name: each.fraction for each in equations.springs.carried()}
    assert carried["body 'idle0'"] == 0.0
    assert not any(contact.z.any() for contact in pairs_of(scene, "idle0"))


def test_a_body_set_aside_that_a_step_throws_far_is_brought_home_at_once(monkeypatch):
    """Newton steps from wrong contacts throw idle bodies by many times their size."""
    scene, place, rounds = row(0.3, loads=(1.0,)), IdleBodies.place, []

    def thrown(self, evaluate):
        aside = [body for body in self._unloaded if body.label in self._bodies.aside]
        for body in aside if not rounds else ():
            body.move(40.0 * body.size * np.eye(len(body.motions))[1])

        def counted():
            rounds.append(1)
            return evaluate()

        return place(self, counted)

    monkeypatch.setattr(IdleBodies, "place", thrown)
    list(scene.solve())
    assert rounds and len(rounds) < 20
    assert np.abs(scene.motion("idle0")).max() < 1e-2
