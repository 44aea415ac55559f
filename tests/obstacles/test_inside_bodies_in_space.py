# SPDX-License-Identifier: MIT
"""Rigid obstacles inside bodies in space, and passages of bodies and obstacles through each other.

Each scene of the first kind has no nodal force, so that Newton's method is content with it.
"""

from types import SimpleNamespace

import numpy as np
import pytest
import space_scenes
from refusal import refused

import fenics_mortar as fm
from fenics_mortar.contact.view import or_other_weights
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block

CUBE = {"size": (1.0, 1.0, 1.0), "jiggle": 0.0, "counts": (3, 3, 3)}
BLADE = [(0.0, -0.1), (2.0, -0.1), (2.0, 0.1), (0.0, 0.1)]


def ball(radius=0.25, at=(0.5, 0.5, 1.3)):
    return fm.Sphere(at, radius)


def paddle(origin=(-0.5, 0.0, 1.5)):
    """A blade that is turned about the y axis."""
    shape = fm.Polygon(BLADE, 0.02, name="blade")
    return fm.Extruded(shape, axis=(0, 1, 0), first=(1, 0, 0), origin=origin)


def scene_with(obstacle, side="block/top", *, cell="hexahedron", law=None, **options):
    """A cube on its bottom, with an obstacle for one side."""
    scene = space_scenes.solid(cell, **{**CUBE, **options})
    space_scenes.held(scene)
    scene.set_up([fm.ContactPair(scene.data, side, obstacle, law=law)])
    return scene.problem


def solved(problem, obstacle, *moves):
    """The last report; obstacles move between the solves."""
    for move in moves:
        obstacle.move(**move)
        report = problem.solve()
    assert report.certificate.passages == [] and report.certificate.violations() == []
    return report


INSIDE = {
    "ball": (ball, {"z": -0.8}, "obstacle 'sphere' cross at .* 0.356 deep"),
    "at a side": (lambda: ball(at=(1.3, 0.5, 0.5)), {"x": -0.15}, "cross at .* 0.1 deep"),
    "at the start": (lambda: ball(at=(0.5, 0.5, 0.5)), {"x": 0.0}, "cross at .* 0.356 deep"),
    "needle": (
        lambda: fm.Cone((0.5, 0.5, 1.02), (0, 0, 1), 0.1), {"z": -0.3},
        "'block/top' and obstacle 'cone' cross at .* 0.28 deep",
    ),
    "needle at a side": (
        lambda: fm.Cone((1.05, 0.5, 0.5), (1, 0, 0), 0.2), {"x": -0.3},
        "body 'block' and obstacle 'cone' cross at .* 0.25 deep .* no pair",
    ),
    "blade": (
        lambda: fm.Extruded(
            fm.Polygon([(-0.002, 0.0), (0.002, 0.0), (0.0, 1.0)], 0.001, name="blade"),
            axis=(0, -1, 0), first=(1, 0, 0), origin=(0.45, 0.0, 1.02),
        ),
        {"z": -0.3}, "obstacle 'blade' cross at .* 0.2.* deep",
    ),
}  # fmt: skip


@pytest.mark.each
@pytest.mark.parametrize("name", INSIDE)
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_obstacle_inside_a_body_is_a_violation(name, cell):
    make, move, message = INSIDE[name]
    obstacle = make()
    problem = scene_with(obstacle, cell=cell)
    obstacle.move(**move)
    with refused(fm.NotConvergedError, message):
        problem.solve()


def test_tip_a_little_below_a_facet_is_a_remark():
    """Where no node carries force less than a tenth of a facet is admitted."""
    obstacle = fm.Cone((0.5, 0.5, 1.02), (0, 0, 1), 0.2)
    problem = scene_with(obstacle)
    obstacle.move(z=-0.04)
    report = problem.solve()
    assert report.certificate.violations() == []
    penetration, overlap = report.certificate.remarks()
    assert "no node of the pair carries a force" in penetration
    assert "cross at (0.5, 0.5, 0.98), 0.02 deep" in overlap
    obstacle.move(z=-0.1)
    with refused(fm.NotConvergedError, "cross at .* 0.08 deep .* no node carries force there"):
        problem.solve()


THIN = {"size": (1.0, 1.0, 0.04), "counts": (2, 2, 1)}


def ball_below(depth):
    """Below the middle of a facet, as deep in the plate."""
    return fm.Sphere((0.25, 0.25, depth - 0.5), 0.5)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_more_than_half_through_a_thin_plate_is_measured_from_the_slave(cell):
    """The back of the plate is nearer, but it is not there that a pair is missing."""
    obstacle = ball_below(0.0)
    problem = plate_above(obstacle, cell)
    obstacle.move(z=0.03)
    (remark,) = [r for r in problem.solve().certificate.remarks() if "cross at" in r]
    assert "'block/bottom' and obstacle 'sphere' cross at (0.25, 0.25, 0.03)" in remark
    assert "more than half the thickness" in remark
    obstacle.move(z=0.055)
    with refused(fm.NotConvergedError, "cross at .* a thin body, between the nodes of their pair"):
        problem.solve()


def plate_above(obstacle, cell="hexahedron"):
    """A thin plate held by its top above an obstacle."""
    scene = space_scenes.solid(cell, **{**CUBE, **THIN})
    space_scenes.held(scene, side="block/top")
    scene.set_up([fm.ContactPair(scene.data, "block/bottom", obstacle)])
    return scene.problem


def test_held_end_that_is_moved_into_an_obstacle_is_told():
    scene = space_scenes.solid(**{**CUBE, "size": (1.0, 1.0, 0.2), "counts": (4, 2, 1)})
    motion = space_scenes.held(scene, side="block/left")
    floor = fm.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    scene.set_up([fm.ContactPair(scene.data, "block/bottom", floor)])
    scene.problem.solve()
    motion.value[2] = -0.15
    inside = "boundary conditions move nodes of the body into the obstacle, 0.15 deep"
    with refused(fm.NotConvergedError, inside):
        scene.problem.solve()


def test_held_end_in_an_obstacle_as_meshed_is_left_to_the_initial_gap():
    scene = space_scenes.solid(**{**CUBE, "size": (1.0, 1.0, 0.2), "counts": (4, 4, 1)})
    space_scenes.held(scene, side="block/left")
    floor = fm.Plane((0.0, 0.0, 0.05), (0.0, 0.0, 1.0))
    scene.set_up([fm.ContactPair(scene.data, "block/bottom", floor, initial_gap=0.0)])
    assert not any("boundary cond" in r for r in scene.problem.solve().certificate.remarks())


@pytest.mark.parametrize("radius, told", [(0.25, "edges of at most 0.12, half"), (0.01, "a sharp")])
def test_ball_between_nodes_tells_the_facets_that_it_needs(radius, told):
    obstacle = ball(radius, (0.5, 0.5, 1.0 + radius))
    problem = scene_with(obstacle)
    obstacle.move(z=-0.05)
    with refused(fm.NotConvergedError, f"no node carries force there.*{told}"):
        problem.solve()


def test_large_ball_between_nodes_of_linear_multipliers_tells_the_quadratic_ones():
    """Facets are fine beside the ball: not they are to blame, there is no tip."""
    obstacle = ball(2.0, (0.3, 0.2, 3.0))
    problem = scene_with(obstacle, cell="tetrahedron", order=2)
    obstacle.move(z=-0.06)
    told = "for this tip or edge: refine the slave there, or take Discretization(basis='quadratic')"
    assert any(told in remark for remark in problem.solve().certificate.remarks())


@pytest.mark.parametrize("order", [1, 2])
def test_other_weights_are_advised_beside_an_edge_where_they_are_positive(order):
    """Standard functions of nine nodes have negative parts, as the dual ones have."""
    a, counts = 0.3, {1: (3, 3, 3), 2: (1, 1, 1)}[order]
    shape = fm.Polygon([(-a, 0.0), (a, 0.0), (a, 2.0), (-a, 2.0)], rounding=0.01 * a)
    punch = fm.Revolved(shape, origin=(0.52, 0.47, 1.0))
    problem = scene_with(punch, order=order, counts=counts)
    punch.move(z=-0.02)
    remarks = problem.solve().certificate.remarks()
    (remark,) = [text for text in remarks if "facets reach beyond an edge" in text]
    assert ("gap_weights='standard'" in remark) == (order == 1)


def test_weights_that_a_pair_has_are_not_advised():
    for weights, advised in (("cover", True), ("standard", False)):
        pair = SimpleNamespace(discretization=fm.Discretization(gap_weights=weights))
        contact = SimpleNamespace(basis="dual", slave=SimpleNamespace(degree=1), pair=pair)
        assert bool(or_other_weights(contact)) == advised


def test_nodes_that_are_loaded_far_from_a_small_ball_are_refused():
    """Its depth is a third of its radius, a fifth of the facets: the force has any direction."""
    scene = space_scenes.solid("tetrahedron", order=2, **{**CUBE, "counts": (1, 1, 1)})
    space_scenes.held(scene)
    obstacle, quadratic = ball(0.2, (0.62, 0.41, 1.2)), fm.Discretization(basis="quadratic")
    scene.set_up([fm.ContactPair(scene.data, "block/top", obstacle, discretization=quadratic)])
    obstacle.move(z=-0.06)
    with refused(fm.NotConvergedError, "loaded nodes are .* facets away from the obstacle"):
        scene.problem.solve()


@pytest.mark.parametrize("cell, order", [("hexahedron", 1), ("tetrahedron", 2)])
def test_other_weights_of_gaps_are_advised_to_dual_multipliers_only(cell, order):
    """Linear multipliers on triangles with six nodes are not dual."""
    obstacle = ball(1.0, (0.3, 0.2, 2.0))
    problem = scene_with(obstacle, cell=cell, order=order)
    obstacle.move(z=-0.06)
    remarks = problem.solve().certificate.remarks()
    assert any("loaded nodes are" in remark for remark in remarks)
    assert any("gap_weights" in remark for remark in remarks) == (cell == "hexahedron")


PASSED = {
    "ball": (ball, {"z": -3.0}, "went through body 'block'"),
    "large ball": (lambda: ball(3.0, (0.5, 0.5, 4.1)), {"z": -8.0}, "went through"),
    "rod": (
        lambda: fm.Cylinder((0.0, 0.5, 1.2), (1, 0.1, 0), 0.05), {"z": -2.0},
        "points of obstacle 'cylinder' went through body 'block'",
    ),
    "paddle": (paddle, {"angle": (0.0, 3.0, 0.0)}, "nodes of .* went through obstacle 'blade'"),
    "paddle, a whole turn": (
        paddle, {"angle": (0.0, 2.0 * np.pi, 0.0)}, "nodes of .* went through obstacle 'blade'",
    ),
}  # fmt: skip


@pytest.mark.each
@pytest.mark.parametrize("name", PASSED)
def test_passage_in_a_step_is_a_violation(name):
    make, move, message = PASSED[name]
    obstacle = make()
    problem = scene_with(obstacle)
    solved(problem, obstacle, {"x": 0.0})
    obstacle.move(**move)
    with refused(fm.NotConvergedError, f"{message}.* since the last accepted state"):
        problem.solve()


FREE = {
    "paddle beside": (lambda: paddle((-2.2, 0.0, 0.5)), {"angle": (0.0, 6.0, 0.0)}),
    "ball past a side": (lambda: ball(at=(1.3, -1.0, 0.5)), {"y": 3.0}),
    "lifted": (ball, {"x": 5.0, "z": 2.0}),
    "spinning": (lambda: ball(0.3, (0.5, 0.5, 1.31)), {"angle": (0.0, 0.0, 7.0)}),
}


@pytest.mark.each
@pytest.mark.parametrize("name", FREE)
def test_obstacle_that_passes_beside_a_body_is_none(name):
    make, move = FREE[name]
    obstacle = make()
    solved(scene_with(obstacle, law=fm.Coulomb(0.3)), obstacle, {"x": 0.0}, move)


@pytest.mark.each
@pytest.mark.parametrize("angle", [0.5, 2.0, 2.0 * np.pi])
def test_wheel_that_turns_on_a_body_does_not_pass(angle):
    """Nodes under a wheel are on chords of its surface in its frame."""
    wheel = fm.Cylinder((0.5, 0.0, 2.0), (0, 1, 0), 1.0)
    problem = scene_with(wheel, law=fm.Coulomb(0.1), counts=(6, 2, 3))
    moves = {"z": -0.02}, {"z": -0.02, "angle": (0.0, angle, 0.0)}
    solved(problem, wheel, *moves)
    assert wheel.reaction[2] > 0.0


def overhanging(size):
    """Mesh of a body with a ledge, x < 1 and z > 0, and a part that hangs down beside it."""
    ledge = Box("ledge", block((int(1 / size), 2, 2)))
    low = Box("low", block((2, 2, 4), size=(0.5, 1.0, 2.0), corner=(1.0, 0.0, -1.0)))
    found = mapped_boxes.arrays([ledge, low])
    x, number = np.unique(np.round(found["points"], 9), axis=0, return_inverse=True)
    number = number.ravel()
    cells, sides = number[found["cells"]], found["boundaries"]
    names = "ledge/bottom", "ledge/top"
    sides = {name: number[sides[name]] for name in names}
    return fm.mesh_from_arrays(x, cells, {"block": np.arange(len(cells))}, sides)


@pytest.mark.parametrize("size", [0.5, 0.1])
def test_body_over_the_edge_of_a_floor(size):
    """A floor is a plane without an edge: what hangs over the edge is below it."""
    data = overhanging(size)
    floor = fm.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    scene = space_scenes.of(data)
    space_scenes.held(scene, (0.0, 0.0, -0.02), "ledge/top")
    scene.set_up([fm.ContactPair(data, "ledge/bottom", floor)])
    report = scene.problem.solve()
    assert report.certificate.violations() == []
    assert floor.reaction[2] < 0.0
