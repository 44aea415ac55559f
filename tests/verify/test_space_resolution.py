# SPDX-License-Identifier: MIT
"""Contact regions in space that facets do not resolve, and the work of friction in a step."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from refusal import refused
from space_pair_scenes import bodies, cap_on_block, cylinder_on_block, shaft_in_groove, two_blocks

import fenics_mortar as fm
from fenics_mortar.obstacles.rigid_motion import rotation_by
from fenics_mortar.verify.checks.friction_work import work_along_arcs
from fenics_mortar.verify.checks.resolution import _edges_between_nodes
from meshes.mapped_boxes import Box, block


def value_of(report, name):
    return report.certificate.pairs[0][name].value


def remarks_with(report, word):
    return [remark for remark in report.certificate.remarks() if word in remark]


@pytest.mark.parametrize(
    ("cell", "order"), [("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2)]
)
def test_a_cap_that_touches_with_a_node(cell, order):
    scene = cap_on_block(4, cell=cell, order=order)
    report = scene.move("upper/top", (0, 0, -0.002)).solve()
    assert value_of(report, "unresolved_force") == pytest.approx(1.0)
    assert remarks_with(report, "1 active node at (") and remarks_with(
        report, "refine 'upper/bottom'"
    )
    report = scene.move("upper/top", (0, 0, -0.1)).solve()
    assert value_of(report, "unresolved_force") == 0.0


@pytest.mark.once
def test_a_line_of_nodes_below_a_cylinder():
    scene = cylinder_on_block(4)
    report = scene.move("upper/top", (0, 0, -0.003)).solve()
    assert value_of(report, "unresolved_force") == pytest.approx(1.0)
    report = scene.move("upper/top", (0, 0, -0.05)).solve()
    assert value_of(report, "unresolved_force") == 0.0


@pytest.mark.once
def test_coarse_facets_of_the_master():
    scene = cap_on_block(12, coarse=1)
    report = scene.move("upper/top", (0, 0, -0.01)).solve()
    assert value_of(report, "unresolved_force") == pytest.approx(1.0)
    assert remarks_with(report, "refine 'lower/top'")


@pytest.mark.once
@pytest.mark.parametrize("count", [1, 3])
def test_whole_sides_and_edges_are_no_narrow_regions(count):
    scene = two_blocks(counts=((count, count, 1), (1, 1, 1)))
    assert value_of(scene.move("upper/top", (0, 0, -0.01)).solve(), "unresolved_force") == 0.0


@pytest.mark.once
def test_a_tilted_block_on_its_edge():
    upper = block((2, 2, 1), size=(1.0, 1.0, 0.5), corner=(0.0, 0.0, 0.0))
    c, s = np.cos(0.15), np.sin(0.15)
    upper = upper @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) + [0.3, 0.2, 1.001]
    lower = block((3, 3, 1), size=(1.6, 1.4, 1.0), corner=(-0.1, 0.0, 0.0))
    upper[..., 2] += 1.001 - upper[..., 2].min()
    boxes = [Box("upper", upper), Box("lower", lower)]
    scene = bodies(boxes, ["upper/top", "lower/bottom"], [("upper/bottom", "lower/top")])
    report = scene.move("upper/top", (0, 0, -0.01)).solve(accept_violations=True)
    assert scene.problem.contacts[0].active.any()
    assert value_of(report, "unresolved_force") == 0.0


@pytest.mark.once
@pytest.mark.parametrize("degrees", [5.0, 35.0])
def test_work_of_friction_by_slip_is_that_of_the_motions(degrees):
    scene, turn = shaft_in_groove(law=fm.Coulomb(0.3))
    turn(0.0)
    scene.solve()
    turn(degrees)
    turn(2.0 * degrees)
    report = scene.solve(accept_violations=True)
    assert 0.0 < value_of(report, "friction_work") < 0.03
    assert not remarks_with(report, "work of friction by slip")


@pytest.mark.parametrize("angle", [1e-9, 0.5, 1.5, 3.0])
def test_work_along_a_circle(angle):
    """A force that turns along with its node on a circle."""
    Q = rotation_by(np.array([0.0, 0.0, angle]))
    force, x = np.array([[0.0, 2.0, 0.7]]), np.array([[1.5, 0.0, 0.0]])
    work = work_along_arcs(force, force @ Q.T, x @ Q.T - x, Q[None])
    assert work == pytest.approx(2.0 * 1.5 * angle)


def corner_on_a_face(count, exchanged=False, order=1, **options):
    """A cube that stands on a corner of its own above a block, beside a node of the latter."""
    turn = np.cross((1.0, 1.0, 1.0), (0.0, 0.0, 1.0)) * np.arccos(3**-0.5) / 2**0.5
    cube = block((count,) * 3, order=order) @ rotation_by(turn).T
    lower = block((4, 4, 2), size=(2.0, 2.0, 1.0), corner=(-0.97, -0.98, -1.0), order=order)
    held = ["upper/top", "upper/right", "upper/back", "lower/bottom"]
    sides = ["upper/left", "upper/front", "upper/bottom"], "lower/top"
    boxes = Box("upper", cube), Box("lower", lower)
    return bodies(boxes, held, [sides[::-1] if exchanged else sides], order=order, **options)


@pytest.mark.once
def test_a_corner_on_a_face_touches_with_a_node():
    """The force at an approach depends on the facets, which is told."""
    scene = corner_on_a_face(2)
    for side in ("upper/top", "upper/right", "upper/back"):
        scene.move(side, (0, 0, -0.02))
    report = scene.solve()
    assert value_of(report, "unresolved_force") == pytest.approx(1.0)
    assert remarks_with(report, "1 active node at (")


def corners_of_cubes(beside, depth, count=2):
    """Two cubes on corners of their own, one above the other, whose sides are parallel."""
    turn = rotation_by(np.cross((1.0, 1.0, 1.0), (0.0, 0.0, 1.0)) * np.arccos(3**-0.5) / 2**0.5)
    upper = block((count,) * 3) @ turn.T + (*beside, 0.0)
    lower = block((count,) * 3, corner=(-1.0, -1.0, -1.0)) @ turn.T
    above, below = ("right", "back", "top"), ("left", "front", "bottom")
    held = [f"upper/{side}" for side in above] + [f"lower/{side}" for side in below]
    sides = [f"upper/{side}" for side in below], [f"lower/{side}" for side in above]
    scene = bodies((Box("upper", upper), Box("lower", lower)), held, [sides], law=fm.Coulomb(0.2))
    for side in above:
        scene.move(f"upper/{side}", (0, 0, -depth))
    return scene


@pytest.mark.once
def test_corners_that_touch_beside_each_other_are_not_resolved():
    """On 0.2 % of facets beside edges of the slave: on half the facets the force is a fifth."""
    report = corners_of_cubes((0.03, 0.01), 0.06).solve()
    assert value_of(report, "unresolved_force") == pytest.approx(1.0)


@pytest.mark.once
def test_corners_that_stand_on_each_other_are_told():
    with refused(fm.NotConvergedError, "touch on less than 5% of their facets, .* move one side"):
        corners_of_cubes((0.0, 0.0), 0.005).solve()


@pytest.mark.once
def test_a_corner_with_linear_multipliers_tells_the_quadratic_ones():
    """Mean gaps over the facets around the corner are open; those of its own node are not."""
    scene = corner_on_a_face(2, cell="tetrahedron", order=2)
    for side in ("upper/top", "upper/right", "upper/back"):
        scene.move(side, (0, 0, -0.08))
    with refused(fm.NotConvergedError, r"exchange slave and master, or .*basis='quadratic'"):
        scene.solve()


@pytest.mark.once
def test_nodes_that_open_and_close_in_turn_are_told_with_a_remedy():
    """Faces of the cube rise so far within facets of the block that mean gaps are negative."""
    scene = corner_on_a_face(4, exchanged=True)
    for side in ("upper/top", "upper/right", "upper/back"):
        scene.move(side, (0, 0, -0.01))
    told = "1 nodes of 'lower/top' open and close in turn, .* exchange slave and master"
    with refused(fm.NotConvergedError, told):
        scene.solve()


@pytest.mark.parametrize(("size", "at_vertices"), [(9, False), (9, True), (6, False), (6, True)])
def test_neighbours_on_a_face_of_order_two(size, at_vertices):
    """Along its sides by halves and across it; of corners alone if no others carry multipliers."""
    facets = np.arange(size)[None]
    contact = SimpleNamespace(slave=SimpleNamespace(dim=3, facets=facets), at_vertices=at_vertices)
    found = {tuple(map(int, edge)) for edge in _edges_between_nodes(contact)}
    count = 4 if size == 9 else 3
    sides = [(i, (i + 1) % count, count + i) for i in range(count)]
    if at_vertices:
        expected = {(a, b) for a, b, _ in sides}
    else:
        halves = {(end, middle) for a, b, middle in sides for end in (a, b)}
        middles = [middle for *_, middle in sides]
        across = {(m, 8) for m in middles} if size == 9 else {(3, 4), (4, 5), (3, 5)}
        expected = halves | across
    assert found == {tuple(sorted(edge)) for edge in expected}


def test_a_thin_sheet_that_a_cylinder_bends_is_judged_as_any_body():
    """Pressures of 1e-8 of the modulus; nodes beside the tip carry a tenth of the right force."""
    sheet = block((12, 2, 1), size=(1.0, 0.2, 0.01), order=2)
    cylinder = fm.Cylinder((0.98, 0.0, 0.11), (0.0, 1.0, 0.0), 0.1)
    scene = bodies([Box("sheet", sheet)], ["sheet/left"], [("sheet/top", cylinder)], order=2)
    cylinder.move(z=-0.002)
    report = scene.problem.solve()
    contact = scene.problem.equations.contacts[0]
    assert 0.0 < scene.problem.contacts[0].pressure.max() < 1e-6 * contact.modulus.max()
    assert remarks_with(report, "nodes carry forces where the surfaces are apart")


@pytest.mark.parametrize("x", [0.0, 10.0])
def test_pressures_that_are_rounding_are_not_judged(x):
    """A cap that touches a block without a load, as built or moved far along with it."""
    scene = cap_on_block(4)
    for side in ("upper/top", "lower/bottom"):
        scene.move(side, (x, 0, 0))
    report = scene.solve()
    assert value_of(report, "unresolved_force") == 0.0 and value_of(report, "openings") == 0.0
