# SPDX-License-Identifier: MIT
"""Bodies in space supported by contact alone: rest, slip, tipping, settling; closed forms."""

import numpy as np
import pytest
from refusal import refused
from scipy.spatial.transform import Rotation
from space_supported import (
    DOWN,
    FLOOR,
    GROUND,
    MU,
    arch_of_stones,
    ball_in_a_bowl,
    free_block,
    on_floor,
    overhanging,
    scene,
    wall_of_blocks,
)

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.rigid.body_motions import closing
from meshes.mapped_boxes import Box, block

TILTED = Rotation.from_rotvec([0.4, -0.7, 0.5]).as_matrix()
FREELY = r"body 'block' can {} freely: it is driven by loads"
SLIDES = "^body 'block' slides, with too little friction to hold it: it begins to move along"

# One block


@pytest.mark.parametrize("cell, order", [("hexahedron", 1), ("tetrahedron", 1), ("tetrahedron", 2)])
@pytest.mark.parametrize("sides", [("block/bottom", "ground/top"), ("ground/top", "block/bottom")])
def test_block_rests_under_its_weight(cell, order, sides):
    """The ground carries the weight, with its moment; the block does not move aside."""
    ground = block((4, 4, 2), size=(1.5, 1.5, 0.5), corner=(-0.75, -0.75, -0.5), order=order)
    upper = free_block(corner=(-0.4, -0.3, 0.0), order=order)
    made = scene(upper, Box("ground", ground), cell=cell, order=order).hold("ground/bottom")
    made.touch(sides).rests()
    force, moment = made.reaction("ground/bottom")
    assert np.allclose(force, [0.0, 0.0, 0.6], atol=1e-9)
    assert np.allclose(moment, np.cross([0.1, 0.2, 0.0], force), atol=1e-4)
    turn, shift = made.place()
    assert np.abs(turn - np.eye(3)).max() < 1e-2 and np.abs(shift).max() < 1e-3


@pytest.mark.parametrize("mu", [0.0, MU])
def test_block_falls_onto_the_ground(mu):
    made = scene(free_block(corner=(-0.5, -0.5, 0.4)), GROUND).hold("ground/bottom")
    report = made.touch(("block/bottom", "ground/top"), mu=mu).rests()
    assert "body 'block' was moved rigidly until contact stopped it, by about 0.4" in report.notes
    force, moment = made.reaction("ground/bottom")
    assert np.allclose(force, [0.0, 0.0, 0.6], atol=1e-6) and np.abs(moment).max() < 1e-5
    assert made.place()[1][2] == pytest.approx(-0.4, abs=1e-3)


@pytest.mark.parametrize("sides", [("block/bottom", "ground/top"), ("ground/top", "block/bottom")])
def test_closing_rates_of_all_motions_at_once_are_differences_of_gaps(sides):
    made = scene(free_block(corner=(-0.5, -0.5, 0.0)), GROUND).hold("ground/bottom").touch(sides)
    made.rests()
    equations = made.problem.equations
    bodies, bulk, (contact,) = equations.floating, equations.bulk, equations.contacts
    (body,) = bodies.bodies
    rates, start, gaps = closing(contact, body), bulk.u.x.array.copy(), []
    for coefficients in np.concatenate([np.eye(6), -np.eye(6)]):
        body.move(1e-6 * coefficients)
        equations.evaluate_operators()
        gaps.append(contact.now.gap.copy())
        bulk.u.x.array[:] = start
    differences = (np.array(gaps[6:]) - np.array(gaps[:6])) / 2e-6
    covered = contact.now.covered
    assert covered.sum() >= 4
    assert np.allclose(rates[:, covered], differences[:, covered], atol=1e-6)


def test_a_body_that_loses_all_contact_is_told():
    """A block between two plates that move apart; nothing holds it then."""
    plates = [fm.Plane((0.0, 0.0, z), (0.0, 0.0, 0.5 - z)) for z in (0.0, 1.0)]
    made = scene(free_block(size=(1.0, 1.0, 1.0)), loaded=())
    made.touch(("block/bottom", plates[0]), ("block/top", plates[1]))
    plates[1].move(z=-0.01)
    assert not any("lost all contact" in note for note in made.rests().notes)
    plates[1].move(z=0.01)
    told = [note for note in made.rests().notes if "lost all contact" in note]
    assert len(told) == 1
    assert "body 'block' has lost all contact" in told[0] and "by up to 0.01 in this" in told[0]


def test_tilted_block_lies_down_on_its_side():
    """It turns about its lowest corner while it falls."""
    turn = Rotation.from_rotvec([0.15, -0.1, 0.3]).as_matrix()
    made = scene(free_block(corner=(-0.5, -0.5, 0.3), turn=turn))
    made.touch(("block/bottom", fm.Plane(*FLOOR))).rests()
    back, _ = made.place()
    normal = back @ turn @ FLOOR[1]
    assert np.abs(normal - FLOOR[1]).max() < 1e-2
    assert np.allclose(made.on_obstacle(), [0.0, 0.0, -0.6], atol=1e-9)


@pytest.mark.once
@pytest.mark.parametrize("turn", [None, TILTED], ids=["upright", "tilted"])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_block_on_an_incline_sticks_up_to_the_angle_of_friction(angle, turn):
    """The load is that of a slope with tan(alpha) / mu = 0.95 and 1.05, downhill in any way."""
    downhill = np.array([np.cos(angle), np.sin(angle), 0.0])
    made = on_floor(0.95 * MU * downhill + DOWN, turn=turn)
    made.rests()
    R = np.eye(3) if turn is None else turn
    expected = R @ (0.6 * (0.95 * MU * downhill + DOWN))
    assert np.allclose(made.on_obstacle(), expected, atol=1e-9)
    assert np.abs(made.place()[1]).max() < 0.01
    with refused(fm.NotConvergedError, FREELY.format(r"move along .*")):
        on_floor(1.05 * MU * downhill + DOWN, turn=turn).problem.solve()


@pytest.mark.serial
@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi])
def test_block_tips_over_its_edge(angle):
    """A load below the friction limit, through the middle of a narrow block.

    The message tells how it tips, and the last of its moves: it has fallen on its side, where no
    pair stops it.
    """
    pull = np.array([np.cos(angle), np.sin(angle), 0.0])
    narrow = {"size": (0.4, 0.4, 1.0), "corner": (-0.2, -0.2, 0.0), "mu": 0.9}
    on_floor(0.36 * pull + DOWN, **narrow).rests()
    tips = "body 'block' tips over, which no friction can prevent: it begins to rotate about the"
    with refused(fm.NotConvergedError, tips, FREELY.format(r"move along .*")):
        on_floor(0.44 * pull + DOWN, **narrow).problem.solve()
    with refused(fm.NotConvergedError, SLIDES, FREELY.format("move along .*")):
        on_floor(0.95 * pull + DOWN, **{**narrow, "size": (0.4, 0.4, 0.3)}).problem.solve()


@pytest.mark.parametrize("load, mu", [((0, 0, 1), 0.3), ((0.3, 0, 1), 0.3), ((0.1, 0, 0.5), 0.9)])
def test_block_that_is_lifted_is_not_said_to_tip_over(load, mu):
    """It touches the floor, on which no node stays."""
    with refused(fm.NotConvergedError, f"^{FREELY.format('move along .*')}"):
        on_floor(np.array(load, float), mu=mu).problem.solve()


@pytest.mark.once
def test_block_that_falls_onto_a_corner_and_slides_is_not_said_to_tip_over():
    """It turns until it lies on its bottom, where friction may hold it."""
    turn = Rotation.from_rotvec([0.15, -0.1, 0.3]).as_matrix()

    def falling(mu):
        block = free_block(corner=(-0.5, -0.5, 0.3), turn=turn)
        made = scene(block, load=0.3 * np.eye(3)[0] + DOWN)
        return made.touch(("block/bottom", fm.Plane(*FLOOR)), mu=mu)

    falling(0.4).rests()
    met = r"\), after it was moved by about .*\. At last"
    remedy = "support it, prescribe its motion, or compute the motion with Dynamics"
    with refused(fm.NotConvergedError, SLIDES, met, FREELY.format("move along .*"), remedy):
        falling(0.2).problem.solve()


@pytest.mark.once
def test_block_that_hovers_beside_a_touching_body_is_not_said_to_tip_over():
    """The other body rests; the block falls and slides."""
    other = Box("stay", block((3, 3, 2), size=(0.4, 0.4, 1.0), corner=(-0.2, -0.2, 0.0)))
    hovering = free_block(corner=(2.0, -0.5, 0.3))
    made = scene(other, hovering, loaded=("stay", "block"), load=0.3 * np.eye(3)[0] + DOWN)
    floor = fm.Plane(*FLOOR)
    made.problem = fm.ContactProblem(
        made.residual, made.u,
        [fm.ContactPair(made.data, f"{name}/bottom", floor, law=fm.Coulomb(mu))
         for name, mu in (("stay", 0.9), ("block", 0.2))],
        petsc_options_prefix="space_beside_",
    )  # fmt: skip
    with refused(fm.NotConvergedError, SLIDES, FREELY.format("move along .*")):
        made.problem.solve()


@pytest.mark.once
def test_block_without_friction_slides_away_from_a_slight_push():
    with refused(fm.NotConvergedError, r"body 'block' can move along \(.*springs carry 5.0e-02 of"):
        on_floor(0.05 * np.eye(3)[0] + DOWN, mu=0.0).problem.solve()


def test_block_that_is_lifted_is_refused():
    with refused(fm.NotConvergedError, FREELY.format(r"move along \(0, 0, 1\)")):
        on_floor(-DOWN).problem.solve()
    made = scene(free_block()).touch()
    with refused(fm.NotConvergedError, r"the body around .* can move along \(0, 0, -1\) freely"):
        made.problem.solve()


@pytest.mark.parametrize("height", [0.0, 0.1])
def test_block_without_load_stays_where_it_is(height):
    made = scene(free_block(corner=(-0.5, -0.5, height)), GROUND, load=0.0 * DOWN)
    report = made.hold("ground/bottom").touch(("block/bottom", "ground/top")).rests()
    assert any(
        "nothing holds body 'block', and no" in note for note in report.certificate.remarks()
    )
    assert np.abs(made.u.x.array).max(initial=0.0) == 0.0


def test_idle_block_gives_way_to_the_ground():
    """The ground bulges below it, and takes it along without a force."""
    made = scene(free_block(corner=(-0.5, -0.5, 0.1)), GROUND, load=0.0 * DOWN)
    V = made.u.function_space
    bulge = fem.Function(V)
    bulge.interpolate(lambda x: np.outer(-DOWN, 0.13 * np.maximum(1.0 - x[0] ** 2 - x[1] ** 2, 0)))
    made.hold("ground/bottom").bcs.append(fm.dirichlet(V, made.data, "ground/top", bulge))
    report = made.touch(("block/bottom", "ground/top"), mu=0.0).rests()
    (remark,) = report.certificate.unsupported
    assert "nothing holds body 'block'" in remark and "out of the way" in remark
    turn, shift = made.place()
    assert 0.01 < shift[2] < 0.03 and np.allclose(turn, np.eye(3), atol=1e-9)
    assert np.abs(shift[:2]).max() < 1e-9


@pytest.mark.parametrize("mu", [0.0, MU])
def test_block_pressed_by_a_traction(mu):
    """The ground carries the traction times the area; with friction also its component aside."""
    made = scene(free_block(), GROUND, load=0.0 * DOWN).hold("ground/bottom")
    traction = np.array([0.5 * mu, 0.25 * mu, -1.0])
    ds = ufl.Measure("ds", domain=made.data.mesh, subdomain_data=made.data.facet_tags)
    v = ufl.TestFunction(made.u.function_space)
    value = fem.Constant(made.data.mesh, traction)
    made.residual -= ufl.inner(value, v) * ds(made.data.boundary_tag("block/top"))
    made.touch(("block/bottom", "ground/top"), mu=mu).rests()
    force, moment = made.reaction("ground/bottom")
    assert np.allclose(force, -traction, atol=1e-6)
    assert np.allclose(moment, -np.cross([0.0, 0.0, 0.6], traction), atol=3e-3)


@pytest.mark.parametrize("sides", [("block/bottom", "ground/top"), ("ground/top", "block/bottom")])
def test_block_beyond_an_edge_tips_at_half_its_length(sides):
    """Nodes of a slave beyond the edge carry force for the part of their facets on the ground."""
    made = overhanging(0.45, sides)
    made.rests()
    force, moment = made.reaction("ground/bottom")
    assert -moment[1] / force[2] == pytest.approx(0.95, abs=1e-3)
    with refused(fm.NotConvergedError, "body 'block'"):
        overhanging(0.52, sides).problem.solve()


def test_pressures_beyond_an_edge_are_a_violation():
    made = overhanging(0.52, ("block/bottom", "ground/top"))
    report = made.problem.solve(accept_violations=True)
    (message,) = report.certificate.violations()
    assert "pressures where the surfaces touch cannot balance body 'block'" in message
    assert "beside facets that are covered in part" in message


# Several bodies and pairs


@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_tower_of_two_blocks(gap):
    """Each contact carries what is above it, with the moments of the slope.

    While they fall by the gaps they also move aside, by about a half of a gap.
    """
    top = block((2, 2, 2), size=(0.6, 0.6, 0.6), corner=(-0.3, -0.3, 0.6 + 2 * gap))
    load = np.array([0.08, 0.05, -1.0])
    made = scene(
        Box("top", top), free_block(corner=(-0.5, -0.5, gap)), GROUND,
        loaded=("top", "block"), load=load,
    ).hold("ground/bottom")  # fmt: skip
    made.touch(("top/bottom", "block/top"), ("block/bottom", "ground/top")).rests()
    upper, lower = (contact.total_force for contact in made.problem.equations.contacts)
    assert np.allclose(upper, -0.216 * load, atol=1e-8)
    assert np.allclose(lower, -0.816 * load, atol=1e-8)
    force, moment = made.reaction("ground/bottom")
    height = (0.6 * 0.3 + 0.216 * 0.9) / 0.816
    assert np.allclose(force, -0.816 * load, atol=1e-8)
    assert np.allclose(moment, np.cross([0.0, 0.0, height], force), atol=4e-3 + 0.5 * gap)


@pytest.mark.once
def test_top_of_a_tower_slides_off():
    """Its pair has less friction than the load needs, the pair below has enough."""
    top = block((2, 2, 2), size=(0.6, 0.6, 0.6), corner=(-0.3, -0.3, 0.6))
    made = scene(Box("top", top), free_block(), loaded=("top", "block"), load=(0.2, 0.0, -1.0))
    pairs = [
        fm.ContactPair(made.data, "top/bottom", "block/top", law=fm.Coulomb(0.1)),
        fm.ContactPair(made.data, "block/bottom", fm.Plane(*FLOOR), law=fm.Coulomb(MU)),
    ]
    made.problem = fm.ContactProblem(
        made.residual, made.u, pairs, bcs=[], petsc_options_prefix="slides_off_"
    )
    with refused(fm.NotConvergedError, r"body 'top' can .* freely"):
        made.problem.solve()


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_block_in_a_corner(mu):
    """Three planes share nodes: forces balance the load, and stay in a second solve."""
    load = np.array([-0.2, -0.1, -1.0])
    made = scene(free_block(corner=(0.0, 0.0, 0.0)), load=load)
    walls = [fm.Plane((0.0, 0.0, 0.0), n) for n in np.eye(3)]
    made.touch(*zip(("block/left", "block/front", "block/bottom"), walls, strict=True), mu=mu)
    made.rests()
    forces = np.array([wall.reaction for wall in walls])
    assert np.allclose(forces[:, :3].sum(axis=0), 0.6 * load, atol=1e-9)
    if mu == 0.0:
        assert np.allclose(forces[:, :3], np.diag(0.6 * load), atol=1e-9)
    report = made.rests()
    assert report.num_iterations <= 1
    assert np.allclose([wall.reaction for wall in walls], forces, atol=1e-7)


@pytest.mark.parametrize("build", [wall_of_blocks, arch_of_stones])
def test_stiff_blocks_that_lean_on_each_other_need_few_iterations(build):
    made = build()
    report = made.rests()
    assert report.num_iterations <= 6 and "springs carry" not in str(report)
    x = made.problem.equations.bulk.u.x.array
    assert np.abs(x).max(initial=0.0) < 1e-3
    if build is wall_of_blocks:
        weight = 2.0 * 0.6 * 0.4 * 0.99 * 2.0 + 0.48
        assert made.on_obstacle()[2] == pytest.approx(-weight, rel=1e-9)
    else:
        left, right = (made.reaction(side)[0] for side in ("s0/left", "s4/right"))
        assert left[0] > 0.0 and np.allclose(left[0], -right[0], rtol=1e-6)
        assert np.allclose(left[2], right[2], rtol=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("angle", [0.3, 2.0])
def test_path_ends_where_friction_is_exceeded(angle):
    """The load on a block turns towards its base until it slides, at time 2 / 3."""
    made = on_floor(0.0 * DOWN)

    def load(time):
        pull = 0.6 * time * np.array([np.cos(angle), np.sin(angle), 0.0])
        made.load.value[:] = pull + min(1.0, 5.0 * time) * DOWN

    with pytest.raises(fm.NotConvergedError) as error:
        fm.follow_path(made.problem, load, fm.SteppingOptions(step=0.3, smallest=0.02))
    assert error.value.report.steps[-1].time == pytest.approx(MU / 0.6, abs=0.02)
    assert "body 'block' can move along" in str(error.value)


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_ball_rests_at_the_bottom_of_a_bowl(mu):
    made = ball_in_a_bowl(0.0, 0.0, 0.2, mu)
    report = made.rests()
    assert any(
        "'block' was moved rigidly until contact stopped it" in note for note in report.notes
    )
    force, moment = made.reaction("bowl/bottom")
    assert force[2] > 0.45 and np.abs(force[:2]).max() < 1e-7
    assert np.abs(moment).max() < 1e-4
    assert np.abs(made.place()[1][:2]).max() < 1e-4


def test_ball_rolls_towards_the_bottom_of_a_bowl():
    """It lies on facets beside the bottom: forces balance, along the line of its weight."""
    made = ball_in_a_bowl(0.3, 0.1, 0.3, 0.3)
    made.rests()
    turn, shift = made.place()
    at = np.array([0.3, 0.1, 0.3]) + shift
    assert np.hypot(*at[:2]) < 0.2 and np.trace(turn) < 2.99
    force, moment = made.reaction("bowl/bottom")
    assert force[2] > 0.45 and np.abs(force[:2]).max() < 1e-9
    assert np.allclose(moment[:2], np.cross(at, force)[:2], atol=2e-3)
