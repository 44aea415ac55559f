# SPDX-License-Identifier: MIT
"""Crossed bodies in space, in a state or in a step, are reported; sound states are not."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from crossing_scenes import messages_with
from scipy.spatial.transform import Rotation
from space_pair_scenes import (
    arc_and_block,
    bent,
    bodies,
    cap_on_block,
    crossings_of,
    plates,
    rods,
    two_blocks,
)
from space_scenes import held, solid

import fenics_mortar as fm
from fenics_mortar.obstacles.rigid_motion import RigidPath
from fenics_mortar.utils.errors import MeshError
from fenics_mortar.verify.node_paths import Paths, StepEnds
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block, mapped


def is_sound(report):
    return not (report.certificate.violations() or report.certificate.remarks())


def is_above(X):
    return X[:, 2] > 1.0 + 1e-9


def is_second(X):
    return X[:, 1] > 0.1


def is_strip(X):
    return X[:, 2] > 1.9


@pytest.mark.once
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_pressed_and_sliding_blocks_are_sound(cell, order):
    scene = two_blocks(cell=cell, order=order, law=fm.Coulomb(0.2))
    for push in ((0, 0, -0.04), (0.1, 0.05, -0.06)):
        report = scene.move("upper/top", push).solve()
        assert is_sound(report)
    crossing = max(report.certificate.crossings, key=lambda c: c.facets)
    assert 0.0 < crossing.facets < 0.05 and crossing.is_paired and not crossing.hint


@pytest.mark.serial
def test_ironing_with_a_cap_is_sound():
    scene = cap_on_block(law=fm.Coulomb(0.3))
    for push in ((0, 0, -0.03), (0, 0, -0.05), (0.1, 0.02, -0.05), (0.2, 0.04, -0.05)):
        assert is_sound(scene.move("upper/top", push).solve())


@pytest.mark.once
def test_the_hull_does_not_depend_on_the_partition():
    hulls = [two_blocks(comm=comm).crossings.outline for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)]
    for name in ("X", "segments", "ends"):
        assert np.allclose(*(getattr(hull, name) for hull in hulls))
    hull = hulls[0]
    areas = np.bincount(hull.segment_bodies, hull.lengths(hull.X) ** 2 / 2.0)
    assert np.sort(areas[areas > 0]) == pytest.approx([4.0, 2 * 1.4 * 1.4 + 4 * 1.4])
    assert len(hull.edges[0]) == 3 * len(hull.segments) // 2
    x, n = hull.X, hull.normals(hull.X)
    a, b, c = np.moveaxis(x[hull.segments], 1, 0)
    volume = np.einsum("mc,mc->", np.cross(b - a, c - a) / 6.0, a)
    assert volume == pytest.approx(0.5 + 1.96) and np.allclose(np.linalg.norm(n, axis=1), 1.0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_depth_of_a_block_in_another(cell, order):
    scene = two_blocks(cell=cell, order=order)
    crossing = crossings_of(scene, is_above, lambda X: X - [0, 0, 0.3])[0]
    assert crossing.depth == pytest.approx(0.3)
    assert crossing.facets == pytest.approx(
        0.3 / (0.5 if cell == "hexahedron" else 0.5 / np.sqrt(2)), rel=0.1
    )
    assert "'upper/bottom'" in crossing.sides or "'lower/top'" in crossing.sides


def test_deep_crossings_of_a_pair_are_violations():
    scene = two_blocks()
    crossing, *_ = crossings_of(scene, is_above, lambda X: X - [0, 0, 0.3])
    assert crossing.facets > crossing.admitted


@pytest.mark.once
def test_bodies_without_a_pair_between_their_sides():
    """The upper block goes sideways into the lower one, where no pair is."""
    scene = two_blocks(pairs=[("upper/left", "lower/right")])
    (crossing,) = crossings_of(scene, is_above, lambda X: X - [0, 0, 0.02])
    assert crossing.depth == pytest.approx(0.02) and crossing.facets > crossing.admitted
    assert not crossing.is_paired and "add a ContactPair" in str(crossing)


@pytest.mark.once
@pytest.mark.parametrize(
    ("pair", "text"),
    [
        (("two/top", "one/top"), "add a ContactPair"),
        (("two/bottom", "one/left"), "edges or corners meet"),
    ],
)
def test_edges_that_cross_without_a_node_inside(pair, text):
    scene = rods(pair)
    found = crossings_of(scene, is_second, lambda X: X + np.array([0.02, -0.12, 0.013]))
    (crossing,) = (crossing for crossing in found if text in str(crossing))
    assert crossing.depth == pytest.approx(0.02) and crossing.facets > crossing.admitted
    assert not crossings_of(scene, is_second, lambda X: X + np.array([0.02, -0.08, 0.013]))


# Places between the nodes of a unit square, of two triangles or one quadrilateral [length].
BETWEEN = [
    ("tetrahedron", 1, (0.62, 0.31)),
    ("tetrahedron", 2, (0.62, 0.31)),
    ("hexahedron", 1, (0.5, 0.5)),
    ("hexahedron", 2, (0.62, 0.31)),
]


@pytest.mark.parametrize("facets, verdict", [(0.01, ""), (0.03, "remark"), (0.13, "violation")])
@pytest.mark.parametrize("cell, order, at", BETWEEN)
def test_a_ball_between_the_nodes_of_a_facet_is_told(cell, order, at, facets, verdict):
    """No node carries force: all means of the gap over the functions of nodes are positive."""
    scene = solid(cell, order, counts=(1, 1, 1), size=np.ones(3), jiggle=0.0)
    depth = facets * (1.0 if cell == "hexahedron" else np.sqrt(0.5))
    held(scene)
    ball = fm.Sphere((*at, 1.2 - depth), 0.2)
    scene.set_up([fm.ContactPair(scene.data, "block/top", ball)])
    certificate = scene.problem.solve(accept_violations=True).certificate
    assert not scene.problem.contacts[0].active.any()
    given = {"violation": certificate.violations(), "remark": certificate.remarks()}
    assert [kind for kind in given if "no node carries force" in str(given[kind])] == [
        *filter(None, [verdict])
    ]
    advised = "basis='quadratic'" in str(given)  # of linear multipliers on quadratic facets
    assert advised == (bool(verdict) and (cell, order) == ("tetrahedron", 2))


@pytest.mark.once
def test_a_body_that_crosses_itself():
    scene = arc_and_block()
    assert not crossings_of(scene, is_strip, bent(1.8 * np.pi))
    (crossing,) = crossings_of(scene, is_strip, bent(2.1 * np.pi))
    assert all("arc" in side for side in crossing.sides) and crossing.facets > crossing.admitted


@pytest.mark.once
def test_missed_contact_is_told():
    scene = two_blocks(gap=0.3, radius=0.05)
    report = scene.move("upper/top", (0, 0, -0.45)).solve(accept_violations=True)
    assert messages_with(report, "13 nodes are inside another body and have no partner")
    assert messages_with(report, "no facets of their pair face each other there")


def test_a_plate_that_went_through_another_one():
    scene = plates()
    with pytest.raises(fm.MortarError, match="went through body 'lower'"):
        scene.move("plate/top", (0, 0, -1.0)).solve()


@pytest.mark.once
def _passages(scene, x1, x0=None):
    """Messages on the step to the positions ``x1``, from the accepted ones or ``x0``."""
    crossings = scene.crossings
    ends = StepEnds(crossings.accepted.x if x0 is None else x0, x1)
    return crossings.in_step.find(ends, crossings._allowed)[0]


@pytest.mark.once
@pytest.mark.parametrize(("ahead", "through"), [(-1.27, True), (-4.5, False), (1.5, False)])
def test_a_plate_that_went_obliquely_through_another_one(ahead, through):
    """By less than a tenth of the way between entry and exit below the surface; or beside it."""
    scene = plates()
    x0, hull = scene.crossings.accepted.x, scene.crossings.outline
    upper = (hull.bodies == hull.bodies[np.argmax(hull.X[:, 2])])[:, None]
    start = x0 + upper * [ahead, 0.0, 0.0]
    told = _passages(scene, start + upper * [5.85 * 0.55, 0.0, -0.55], start)
    assert bool(told) == through


def test_a_plate_that_went_through_in_turned_frames():
    """All bodies turn by 100 degrees in the same step."""
    scene = plates()
    x0 = scene.crossings.accepted.x
    hull = scene.crossings.outline
    upper = hull.bodies == hull.bodies[np.argmax(hull.X[:, 2])]
    c, s = np.cos(np.radians(100.0)), np.sin(np.radians(100.0))
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    for drop, count in ((1.0, 2), (0.25, 0)):
        x1 = (x0 - [0, 0, drop] * upper[:, None]) @ turn.T + [3.0, 1.0, -2.0]
        assert len(_passages(scene, x1)) == count


@pytest.mark.once
@pytest.mark.parametrize("seed", [0, 179, 211])
def test_nodes_that_begin_on_a_surface_go_through_it(seed):
    """One of 18 nodes begins outside, up to rounding, and yet leaves the body first."""
    crossings = plates().crossings
    hull, random = crossings.outline, np.random.default_rng(seed)
    upper = hull.bodies == hull.bodies[np.argmax(hull.X[:, 2])]
    gap = hull.X[upper, 2].min() - hull.X[~upper, 2].max()
    start = hull.X + upper[:, None] * [*random.uniform(-0.05, 0.05, 2), -gap]
    along = np.array([start, start - upper[:, None] * [0.0, 0.0, 1.0]])
    turn = Rotation.random(random_state=seed).as_matrix()
    shift = np.random.default_rng(seed).uniform(-3.0, 3.0, 3)
    lower = int(hull.bodies[~upper][0])
    passed, _ = crossings.in_step.nodes_through(along @ turn.T + shift, lower, upper)
    assert len(passed.ends) == upper.sum()


@pytest.mark.once
def test_rods_that_crossed_without_a_node_within_the_other():
    scene = rods()
    for side in ("two/left", "two/right"):
        scene.move(side, (0.01, -0.5, 0.013))
    report = scene.solve(accept_violations=True)
    assert not report.certificate.crossings
    assert messages_with(report, "edges of 'two/front' went through body 'one'")


@pytest.mark.once
@pytest.mark.parametrize("climb", [0.0, 3.0])
def test_a_bar_that_a_rod_passed_on_its_way_along_it(climb):
    """Nodes of the rod pass beside the bar, and the rod ends beside another part of it."""
    corners = [(-0.05, -0.05), (0.05, -0.05), (0.05, 0.05), (-0.05, 0.05)]
    bar = fm.Extruded(fm.Polygon(corners, 1e-3), name="bar")
    rod = Box("rod", block((3, 1, 1), size=(1.2, 0.2, 0.2), corner=(-0.6, -1.0, 0.0)))
    held = ["rod/left", "rod/right"]
    scene = bodies([rod], held, [("rod/back", bar)])
    for side in held:
        scene.move(side, (0.0, 1.8, climb))
    report = scene.solve(accept_violations=True)
    assert not report.certificate.crossings
    (told,) = messages_with(report, "went through")
    assert "points of obstacle 'bar'" in told


@pytest.mark.once
def test_bodies_that_pass_beside_each_other():
    scene = plates()
    hull, x0 = scene.crossings.outline, scene.crossings.accepted.x
    upper = (hull.bodies == hull.bodies[np.argmax(hull.X[:, 2])])[:, None]
    for moved in ((3.0, 0, -0.25), (0, 0, 1.0), (0.3, 0.2, -0.2)):
        assert not _passages(scene, x0 + upper * moved)


def test_nodes_of_a_body_that_turns_go_along_arcs():
    rng = np.random.default_rng(0)
    x0, angle = rng.normal(size=(20, 3)), np.radians(120.0)
    c, s = np.cos(angle), np.sin(angle)
    x1 = x0 @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [1, 2, 3]
    given = StepEnds(x0, x1), np.zeros(20, np.int64), {-1: RigidPath(*np.zeros((3, 3)))}
    assert len(Paths(*given, np.inf).seen_from(-1)) == 4
    paths = Paths(*given, 0.01)
    along = paths.seen_from(-1)
    sagitta = np.linalg.norm(x0 - x0.mean(axis=0), axis=1).max() * (
        1.0 - np.cos(0.5 * angle / (len(along) - 1))
    )
    assert 0.003 < sagitta < 0.01  # the farthest point is taken to be a corner of their box
    assert np.allclose(along[0], x0) and np.allclose(along[-1], x1)
    sizes = np.linalg.norm(along - along.mean(axis=1, keepdims=True), axis=2)
    assert np.allclose(sizes, sizes[0])
    assert np.allclose(paths.seen_from(0), paths.seen_from(0)[:1])


@pytest.mark.parametrize("cell", mapped_boxes.CELLS)
def test_a_body_inside_another_one_without_a_hole_is_refused(cell):
    inner = Box("inner", block((1, 1, 1), size=(0.3, 0.3, 0.3), corner=(0.2, 0.4, 0.3)))
    outer = Box("outer", block((3, 3, 3)))
    with pytest.raises(MeshError, match=r"lies inside another one.*cut .*outer"):
        bodies([inner, outer], ["outer/bottom"], [("inner/bottom", "outer/top")], cell=cell)


def wound(turns):
    """A strip of a ring with one turn or more, on itself from there on."""

    def position(s, t, r):
        angle = 2.0 * np.pi * turns * s
        return (1.0 + 0.3 * r) * np.cos(angle), t, (1.0 + 0.3 * r) * np.sin(angle)

    return Box("strip", mapped((24, 1, 1), position))


def test_a_strip_wound_by_more_than_one_turn_is_refused():
    base = Box("base", block((2, 2, 1), size=(4.0, 1.0, 0.5), corner=(-2.0, 0.0, -2.0)))
    given = ["base/bottom"], [("strip/top", "base/top")]
    bodies([wound(0.9), base], *given)
    with pytest.raises(MeshError, match="a body overlaps itself"):
        bodies([wound(1.17), base], *given)


def thin_plate_above_a_cap(thickness=0.02, radius=0.5):
    """A thin plate held by its top, and a cap below the middle of one of its inner facets."""

    def position(s, t, r):
        x, y = 0.2 * (s - 0.5), 0.2 * (t - 0.5)
        return 0.375 + x, 0.375 + y, -0.3 + r * (0.3 - radius + np.sqrt(radius**2 - x**2 - y**2))

    plate = Box("plate", block((4, 4, 1), size=(1.0, 1.0, thickness)))
    cap = Box("cap", mapped((4, 4, 1), position))
    return bodies([plate, cap], ["plate/top", "cap/bottom"], [("plate/bottom", "cap/top")])


def is_cap(X):
    return X[:, 2] < -0.1


@pytest.mark.once
def test_overlap_beyond_the_middle_of_a_thin_body_is_that_of_the_pair():
    """The top of the cap is nearer to the back of the plate; above it, this is told."""
    scene = thin_plate_above_a_cap()
    (found,) = crossings_of(scene, is_cap, lambda X: X + np.array([0, 0, 0.015]))
    assert "'cap/top' and 'plate/bottom' cross at (0.375, 0.375, 0.015), 0.015" in str(found)
    assert "half the thickness" in found.hint and found.remark < found.facets < found.admitted
    found = crossings_of(scene, is_cap, lambda X: X + np.array([0, 0, 0.03]))
    assert not [each for each in found if "add a ContactPair" in str(each)]
    (through,) = [each for each in found if "has gone through" in str(each)]
    assert through.facets > through.admitted


def roofs(shift, height=0.3, pair=("upper/top", "lower/top"), **options):
    """Two blocks with ridges that cross at right angles, ``shift`` beside nodes of both."""

    def roof(s, t, r):
        rise = r * (0.4 + height * (1.0 - np.abs(2.0 * s - 1.0)))
        return s - 0.5, t - 0.5 + shift, rise - 0.4 - height

    def turned(s, t, r):
        x, y, z = roof(s, 1.0 - t, r)
        return -y, x, -z

    boxes = Box("lower", mapped((4, 4, 1), roof)), Box("upper", mapped((4, 4, 1), turned))
    return bodies(boxes, ["lower/bottom", "upper/bottom"], [pair], **options)


@pytest.mark.parametrize("cell", mapped_boxes.CELLS)
def test_ridges_that_cross_between_nodes_are_told(cell):
    """The force is 0, and a quarter of the right one; with a node at the crossing it is right."""
    forces = {}
    for shift, depth, told in ((0.0, 0.06, False), (0.125, 0.01, True), (0.125, 0.06, True)):
        scene = roofs(shift, cell=cell).move("upper/bottom", (0, 0, -depth))
        report = scene.solve(accept_violations=True)
        assert bool(messages_with(report, "two edges cross there")) == told
        assert bool(report.certificate.violations()) == told
        forces[shift, depth] = scene.problem.contacts[0].total_force
    found = np.array([np.linalg.norm(force) for force in forces.values()])
    assert found[1] == 0.0 and found[2] < 0.5 * found[0]


def test_blunt_ridges_without_a_pair_are_a_remark():
    """They may be coarse curves, which reach into each other by their sagittas."""
    scene = roofs(0.125, height=0.15, pair=("upper/left", "lower/left"))
    (crossing,) = crossings_of(scene, lambda X: X[:, 2] > 0.01, lambda X: X - [0.0, 0.0, 0.03])
    assert crossing.remark < crossing.facets < crossing.admitted


def test_edges_of_blocks_that_lie_on_each_other_are_no_ridges():
    """The edge of a block over the corner of another one crosses two edges beside their faces."""

    def upper(s, t, r):
        return s + t - 1.485, t - s - 0.485, 1.0 + 0.5 * r

    boxes = Box("lower", block((2, 2, 2))), Box("upper", mapped((1, 1, 1), upper))
    sides = ["lower/bottom", "upper/top"], [("upper/bottom", "lower/top")]
    found = crossings_of(bodies(boxes, *sides), is_above, lambda X: X - [0.0, 0.0, 0.02])
    assert found and all(each.facets < each.admitted for each in found)
