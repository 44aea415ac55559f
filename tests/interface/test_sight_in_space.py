# SPDX-License-Identifier: MIT
"""Whole outlines as surfaces in space: no partners through bodies, normals at sharp edges."""

from dataclasses import replace

import numpy as np
import pytest
from refusal import refused
from space_pair_scenes import bodies

import fenics_mortar as fm
from fenics_mortar.interface.corners import SharpEdges
from fenics_mortar.kernels.sight import first_exit
from fenics_mortar.kernels.space.inside import crossings, is_hidden, is_nearer_elsewhere
from fenics_mortar.kernels.space.shapes import triangles_of
from fenics_mortar.kernels.tree import build_tree
from meshes import mapped_boxes
from meshes.mapped_boxes import SIDES, Box, block, mapped

LEAST = 1e-12
EACH_CELL = [("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)]


def turn(axis, degrees):
    """Rotation about an axis (Rodrigues)."""
    n, angle = np.asarray(axis, float) / np.linalg.norm(axis), np.radians(degrees)
    K = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def outline(name, but=()):
    """One name for all sides of a body but some."""
    return {side: name for side in SIDES if side not in but}


def plates(whole, *, cell="hexahedron", order=1, gap=0.2, height=0.05, exchanged=False):
    """Two plates held at two sides each, with outlines or with the sides that meet."""
    names = [outline(body, ("left", "right")) if whole else {} for body in ("lower", "upper")]
    low = block((4, 4, 1), size=(1.0, 1.0, height), order=order)
    high = block((5, 5, 1), size=(1.0, 1.0, height), corner=(0.0, 0.0, height + gap), order=order)
    pair = ("upper", "lower") if whole else ("upper/bottom", "lower/top")
    held = [f"{body}/{side}" for body in ("lower", "upper") for side in ("left", "right")]
    boxes = [Box(*given) for given in zip(("lower", "upper"), (low, high), names, strict=True)]
    return bodies(boxes, held, [pair[::-1] if exchanged else pair], cell=cell, order=order)


def lowered(scene, depth):
    """Forces on the lower plate after the upper one is lowered."""
    for side in ("upper/left", "upper/right"):
        scene.move(side, (0.0, 0.0, -depth))
    scene.solve()
    return np.array([scene.problem.reaction(f"lower/{side}").force for side in ("left", "right")])


@pytest.mark.once
@pytest.mark.parametrize("exchanged", [False, True])
@pytest.mark.parametrize(("cell", "order"), EACH_CELL)
def test_thin_plates_with_outlines_are_those_with_sides(cell, order, exchanged):
    options = {"cell": cell, "order": order, "exchanged": exchanged}
    expected = lowered(plates(False, **options), 0.21)
    assert np.abs(expected[:, 2]).min() > 1e-3
    assert lowered(plates(True, **options), 0.21) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("height", [0.02, 0.3])
def test_plates_that_hover_do_not_touch(height):
    assert np.abs(lowered(plates(True, height=height), 0.15)).max() < 1e-12


def on_a_block(turned, whole, *, cell="hexahedron", order=1, law=None):
    """A small block above the middle of a wide one, whose outline or top is the slave."""
    low = block((5, 5, 2), size=(2.0, 2.0, 0.3), corner=(-1.0, -1.0, -0.3), order=order)
    high = block((3, 3, 2), size=(0.8, 0.8, 0.4), corner=(-0.4, -0.4, 0.0), order=order)
    high = high @ turned.T
    high[..., 2] -= high[..., 2].min()
    lower = outline("lower", ("bottom",)) if whole else {}
    boxes = [Box("lower", low, lower), Box("upper", high, outline("upper", ("top",)))]
    slave = "lower" if whole else "lower/top"
    pairs, held = [(slave, "upper")], ["lower/bottom", "upper/top"]
    return bodies(boxes, held, pairs, cell=cell, order=order, law=law)


@pytest.mark.parametrize(
    ("axis", "degrees"), [((0, 1, 0), 45.0), ((0, 1, 0), 20.0), ((1, -1, 0), 54.7)]
)
@pytest.mark.parametrize(("cell", "order"), EACH_CELL[:2])
def test_sides_of_a_wide_block_see_nothing_through_it(cell, order, axis, degrees):
    """Wedge, edge and tip above the middle: the sides are as far behind as half of both bodies."""
    forces = []
    for whole in (False, True):
        scene = on_a_block(turn(axis, degrees), whole, cell=cell, order=order)
        scene.move("upper/top", (0.0, 0.0, -0.05)).solve()
        forces.append(scene.problem.reaction("lower/bottom").force)
    assert forces[0][2] > 1e-3
    assert forces[1] == pytest.approx(forces[0], abs=1e-8)


def test_an_edge_inside_a_facet_that_does_not_see_it_is_told():
    """The edge enters the facets between their nodes, whose mean gaps stay open."""
    scene = on_a_block(turn((0, 1, 0), 20.0), False, cell="tetrahedron", order=2)
    with pytest.raises(fm.NotConvergedError, match="too coarse for this tip or edge"):
        scene.move("upper/top", (0.0, 0.0, -0.05)).solve()


def test_friction_on_outlines():
    forces = []
    for whole in (False, True):
        scene = on_a_block(np.eye(3), whole, law=fm.Coulomb(0.3))
        for step in (1, 2):
            scene.move("upper/top", (0.02 * step, 0.0, -0.02 * step)).solve()
        forces.append(scene.problem.reaction("lower/bottom").force)
    assert forces[1] == pytest.approx(forces[0], abs=1e-8)


@pytest.mark.serial
def test_a_sliver_of_cover_is_handed_over():
    """The corner of the master is on a facet's edge: beyond it a node has 1e-6 of its cover."""
    scene = on_a_block(np.eye(3), False, cell="tetrahedron", order=2, law=fm.Coulomb(0.3))
    for step in (1, 2, 3):
        report = scene.move("upper/top", (step / 60.0, 0.0, -step / 60.0)).solve()
        assert report.num_iterations < 15
    contact = scene.problem.equations.contacts[0]
    assert np.abs(contact.z[contact.active]).max() < 100.0 * np.abs(contact.z).mean()


def test_tangent_with_one_sided_normals():
    scene = on_a_block(turn((0, 1, 0), 20.0), True)
    scene.move("upper/top", (0.0, 0.0, -0.03)).solve()
    slopes = scene.problem.check_tangent().slopes
    assert min(slopes.values()) > 1.9, slopes


# --- kernels ------------------------------------------------------------------------------------
def shape_of(*boxes):
    """Boxes ((low corner), (high corner), body) as the argument ``outline`` of the kernels."""
    x, triangles, bodies, first = [], [], [], 0
    for low, high, body in boxes:
        corners = np.array([(i, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 1)], float)
        x.append(np.asarray(low) + corners * (np.asarray(high) - np.asarray(low)))
        faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        found = triangles_of(np.array(faces))[0]
        triangles.append(first + found)
        bodies.append(np.full(len(found), body))
        first += 8
    x, triangles = np.concatenate(x), np.concatenate(triangles)
    boxes = build_tree(x, triangles)
    return x, triangles, np.concatenate(bodies), boxes, np.empty(len(boxes) // 2, np.int64)


def length(start, direction, shape, own=0):
    """Length inside of a body along a line."""
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    return first_exit(crossings(np.asarray(start, float), direction, shape, own, LEAST))


def test_length_of_a_line_ends_at_the_body():
    shape = shape_of(((0, 0, 0), (1, 2, 0.3), 0), ((0, 0, 0.1), (1, 1, 2), 1))
    assert length((0.4, 0.3, 0.0), (0, 0, 1), shape) == pytest.approx(0.3)
    assert length((0.4, 0.3, 0.3), (0, 0, -1), shape) == pytest.approx(0.3)
    assert length((0.4, 0.3, 0.1), (0, 0, 1), shape, own=1) == pytest.approx(1.9)
    assert length((0.4, 0.3, 0.0), (0, 0, 1), shape, own=2) == np.inf
    assert length((0.0, 0.5, 0.1), (3, 4, 0), shape) == pytest.approx(5.0 / 3.0)


@pytest.mark.parametrize("place", [(0.5, 0.5), (0.0, 0.25), (1.0, 1.0), (0.25, 0.25), (0.7, 0.3)])
def test_line_through_an_edge_is_counted_once(place):
    """A line through an edge is taken as wholly inside the body or wholly outside."""
    shape = shape_of(((0, 0, 0), (1, 1, 1), 0))
    assert length((*place, 0.0), (0, 0, 1), shape) in (1.0, np.inf)
    found = crossings(np.array([*place, -1.0]), np.array([0.0, 0.0, 1.0]), shape, 0, LEAST)
    assert found[1].sum() == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_closed_surfaces_are_left_as_often_as_they_are_entered(seed):
    rng = np.random.default_rng(seed)
    shape = shape_of(((0, 0, 0), (1, 1, 1), 0), ((0.3, 0.2, 0.1), (0.9, 1.4, 0.7), 0))
    for _ in range(50):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        start = rng.uniform(-1.0, 2.0, 3) - 10.0 * direction
        assert crossings(start, direction, shape, 0, LEAST)[1].sum() == 0.0


def behind(shape, own, other):
    """Argument ``behind`` for a slave facet and a master facet of two bodies."""
    return np.zeros(1), np.array([own]), np.array([other]), shape


def test_partners_through_both_bodies_are_hidden():
    """A thick body over a thin one: overlaps up to half of both thicknesses together count."""
    start, up = np.array([0.4, 0.3, 0.0]), np.array([0.0, 0.0, 1.0])
    for depth, hidden in ((0.2, False), (0.6, False), (0.7, True), (1.3, True)):
        shape = shape_of(((0, 0, -1), (1, 1, 0), 0), ((0, 0, -depth), (1, 1, 0.3 - depth), 1))
        assert is_hidden(start, up, depth, behind(shape, 0, 1), (0, 0), (LEAST, LEAST)) == hidden
    apart = shape_of(((0, 0, -1), (1, 1, 0), 0), ((0, 0, -2), (1, 1, -1.5), 1))
    assert is_hidden(start, up, 2.0, behind(apart, 0, 1), (0, 0), (LEAST, LEAST))


def test_bodies_without_an_end_are_not_hidden():
    """The line does not leave the master, as where an outline is open: nothing is known of it."""
    start, up = np.array([0.4, 0.3, 0.0]), np.array([0.0, 0.0, 1.0])
    x, triangles, bodies, boxes, hits = shape_of(((0, 0, -0.1), (1, 1, 0), 0))
    shape = x, triangles, bodies, boxes, hits
    assert not is_hidden(start, up, 0.3, behind(shape, 0, 1), (0, 0), (LEAST, LEAST))


@pytest.mark.parametrize("own", [1.0, 0.1])
def test_bodies_that_end_within_a_bulge_are_thin(own):
    """Beside an edge a line is in a body for less than its curved facets are off their triangles.

    Else all that is far behind would be a partner there.
    """
    start, up, bulges = np.array([0.4, 0.3, 0.0]), np.array([0.0, 0.0, 1.0]), (0.2, 0.2)
    shape = shape_of(((0, 0, -own), (1, 1, 0), 0), ((0, 0, -2.05), (1, 1, -2), 1))
    assert is_hidden(start, up, 2.05, behind(shape, 0, 1), (0, 0), bulges)
    assert not is_hidden(start, up, 0.05, behind(shape, 0, 1), (0, 0), bulges)


def test_parts_of_one_body_are_told_by_their_order():
    start, up = np.array([0.4, 0.3, 0.0]), np.array([0.0, 0.0, 1.0])
    for depth, hidden in ((0.2, False), (1.0, True)):
        other = ((0, 0, -depth), (1, 1, 0.5), 0) if not hidden else ((0, 0, -3), (1, 1, -2), 0)
        shape = shape_of(((0, 0, -1), (1, 1, 0), 0), other)
        assert is_hidden(start, up, depth, behind(shape, 0, 0), (0, 0), (LEAST, LEAST)) == hidden


def test_partner_much_nearer_to_another_part():
    """The side of a wide block and a tip that has entered its top."""
    x, triangles, _, boxes, hits = shape_of(((-1, -1, -0.3), (1, 1, 0), 0))
    start, side = np.array([-1.0, 0.0, -0.03]), np.array([-1.0, 0.0, 0.0])
    for depth, nearer in ((0.9, True), (0.05, False)):
        assert is_nearer_elsewhere(start, side, depth, (x, triangles, boxes, hits)) == nearer


# --- sharp edges --------------------------------------------------------------------------------
def cube(order, cell="hexahedron"):
    """A contact whose slave is the outline of a cube above a plate."""
    high = block((2, 2, 2), corner=(0.0, 0.0, 0.1), order=order)
    low = block((3, 3, 1), size=(3.0, 3.0, 1.0), corner=(-1.0, -1.0, -1.0), order=order)
    boxes = [Box("upper", high, outline("upper", ("top",))), Box("lower", low)]
    held, pairs = ["upper/top", "lower/bottom"], [("upper", "lower/top")]
    scene = bodies(boxes, held, pairs, cell=cell, order=order)
    return scene.problem.equations.contacts[0]


@pytest.mark.parametrize(("cell", "order"), EACH_CELL)
def test_edges_of_a_cube_take_the_normal_of_the_side_that_faces_the_plate(cell, order):
    contact = cube(order, cell)
    slave, o = contact.slave, contact.operators
    bottom = np.isclose(slave.X[:, 2], 0.1)
    assert o.n[bottom] == pytest.approx(np.tile([0.0, 0.0, -1.0], (bottom.sum(), 1)), abs=1e-14)
    on_edge = (np.isclose(slave.X, [0, 0, 0.1]) | np.isclose(slave.X, [1, 1, 9])).sum(axis=1) > 1
    assert sorted(SharpEdges(slave).nodes) == np.flatnonzero(on_edge).tolist()
    assert np.isclose(slave.X[o.segments.slave][..., 2], 0.1).all()


def thin_wedge(degrees, whole, *, cell="hexahedron", order=1):
    """A wedge whose edge is pressed on a block by one of its sides, which is tilted by 3 degrees.

    With outlines or with the sides that meet.
    """
    slope, height = np.tan(np.radians(degrees)), 0.3
    high = mapped(
        (5, 2, 2),
        lambda s, t, r: ((s + (1.0 - s) * r) * height / slope + 0.3 * s, 0.5 * t, r * height),
        order=order,
    )
    low = block((4, 4, 2), size=(0.7, 1.0, 0.5), corner=(-0.25, -0.25, -0.5), order=order)
    names = [outline("upper", ("top", "right")), outline("lower", ("bottom",))]
    boxes = [Box("upper", high @ turn([0.0, 1.0, 0.0], -3.0).T), Box("lower", low)]
    if whole:
        boxes = [replace(box, joined=joined) for box, joined in zip(boxes, names, strict=True)]
    held = ["upper/top", "upper/right", "lower/bottom"]
    pair = ("upper", "lower") if whole else ("upper/bottom", "lower/top")
    return bodies(boxes, held, [pair], cell=cell, order=order)


@pytest.mark.once
@pytest.mark.parametrize("degrees", [1.0, 30.0, 44.0, 100.0])
@pytest.mark.parametrize(("cell", "order"), EACH_CELL)
def test_edges_of_wedges_are_sharp(degrees, cell, order):
    slave = thin_wedge(degrees, True, cell=cell, order=order).problem.equations.contacts[0].slave
    at_edge = np.flatnonzero(np.linalg.norm(slave.X[:, [0, 2]], axis=1) < LEAST)
    assert at_edge.size == 2 * order + 1 and np.isin(at_edge, SharpEdges(slave).nodes).all()


@pytest.mark.once
def test_a_thin_wedge_with_its_outline_is_pressed_by_its_edge_as_with_its_side():
    """On a flat without friction there is no force along it."""
    forces = []
    for whole in (True, False):
        scene = thin_wedge(30.0, whole)
        for side in ("upper/top", "upper/right"):
            scene.move(side, (0.0, 0.0, -0.02))
        assert scene.solve().certificate.violations() == []
        forces.append(scene.problem.reaction("lower/bottom").force)
    assert forces[0] == pytest.approx(forces[1], abs=1e-9)
    assert np.abs(forces[0][:2]).max() < 0.01 * forces[0][2]


def test_an_upright_knife_is_pressed_as_its_message_advises():
    """Its sides are steeper than the largest angle, which the refusal names.

    With a larger one the knife as slave presses along the average of the normals of its sides,
    which is oblique where facets of one side are smaller.
    """
    high = mapped(
        (5, 2, 2),
        lambda s, t, r: ((s + (1 - s) * r) * 0.3 / np.tan(np.pi / 6) + 0.3 * s, 0.5 * t, 0.3 * r),
    )
    high = high @ turn([0.0, 1.0, 0.0], -75.0).T + [0.0, 0.25, 0.0]
    low = block((4, 4, 2), size=(1.0, 1.0, 0.5), corner=(-0.5, 0.0, -0.5))
    boxes = [Box("knife", high), Box("lower", low)]
    held, sides = ["knife/top", "knife/right", "lower/bottom"], ["knife/bottom", "knife/left"]

    def solve(*pair, **options):
        scene = bodies(boxes, held, [pair], **options)
        for side in held[:2]:
            scene.move(side, (0.0, 0.0, -0.02))
        remarks = scene.solve().certificate.remarks()
        return scene.problem.reaction("lower/bottom").force, remarks

    for pair in (("lower/top", sides), (sides, "lower/top")):
        told = r"to 70 degrees; .* wedge is pressed, Discretization\(max_angle.* slave"
        with refused(fm.NotConvergedError, told):
            solve(*pair)
    force, remarks = solve("lower/top", sides, max_angle=80.0)
    assert force[2] > 0.1 and np.abs(force[:2]).max() < 1e-9 and "along" not in remarks[0]
    oblique, (told,) = solve(sides, "lower/top", max_angle=80.0)
    assert np.abs(oblique[:2]).max() > 0.5 * oblique[2]
    assert "a sharp edge of the slave presses" in told and "take 'lower/top' as slave" in told


def pyramid():
    """A pyramid whose four sides have a hundred facets each at the apex, and a plate."""
    s, one = np.linspace(-1.0, 1.0, 101)[:-1], np.ones(100)
    ring = np.concatenate([np.stack(c, axis=1) for c in (
        (s, -one), (one, s), (-s, one), (-one, -s))])  # fmt: skip
    contact = cube(1, "tetrahedron")
    X = np.concatenate([[[0.0, 0.0, 3.0]], np.column_stack([ring, np.zeros(400)])])
    k = 1 + np.arange(400)
    facets = np.stack([np.zeros(400, np.int64), k, np.roll(k, -1)], axis=1)
    return replace(contact.slave, X=X, facets=facets, nodes=np.arange(401)), contact.master


def test_sides_at_the_apex_of_a_pyramid_of_many_facets():
    slave, _ = pyramid()
    sides = SharpEdges(slave).sides[: slave.around[0][1]]
    assert 0 in SharpEdges(slave).nodes and sorted(np.bincount(sides)) == [100] * 4


@pytest.mark.parametrize(("degrees", "left"), [(17.0, 400), (19.0, 400), (31.0, 100)])
def test_the_apex_of_a_pyramid_that_is_pressed_blunt_takes_the_average(degrees, left):
    """Its sides, on a plate that is nearer to one of them than to the average, keep partners."""
    slave, plate = pyramid()
    angle = np.radians(degrees)
    x = slave.X * [1.0, 1.0, np.tan(angle) / 3.0] @ turn([1.0, 0.0, 0.0], 180.0).T
    x[:, 2] += 1e-4 - x[0, 2]
    m = plate.X @ turn([0.0, 1.0, 0.0], 0.6 * degrees).T
    edges = SharpEdges(slave)
    (starts, _, _), alone = edges.links(edges.choose(x, plate, m, 1.0))
    assert starts[1] == left and (alone.sum() == 0) == (left == 400)


def test_flat_and_round_surfaces_have_no_sharp_edges():
    contact = cube(1)
    assert not SharpEdges(contact.master).nodes.size
    assert set(mapped_boxes.CELLS) == {cell for cell, _ in EACH_CELL}
