# SPDX-License-Identifier: MIT
"""Cracks: faces that share their tips, as the two sides of a pair or as one surface."""

from itertools import pairwise

import gmsh
import numpy as np
import pytest
from crack_scenes import (
    LMBDA,
    branched,
    crossed,
    edge_crack,
    in_plane,
    jump_at,
    jump_of_crack,
    one,
    slit,
    strained,
    two,
)
from crack_scenes import MU as MODULUS
from refusal import refused
from scenes import neo_hookean, nodal, read

import fenics_mortar as fm
from meshes import cracked_plate

MU = fm.Coulomb(0.3)
BOTH_WAYS = pytest.mark.parametrize("sides", [two, one])
# Compressed and sheared so that the crack slides; pulled and sheared; in axes of the crack.
SLIDES, OPEN = (-0.2, -1.0, 0.7), (0.0, 1.0, 0.3)
CLOSED_GRADIENT = [[-0.01, 0.03], [0.0, -0.03]]


def imbalance(scene):
    """Resultant of the contact forces on slave and master nodes over their norms."""
    total, size = np.zeros(2), 0.0
    for contact in scene.problem.equations.contacts:
        for force in contact.operators.force(contact.z):
            total += force.sum(axis=0)
            size += np.abs(force).sum()
    return np.abs(total).max() / max(size, 1e-12)  # open cracks have none


def is_right(scene):
    return scene.problem.certificate().violations() == [] and imbalance(scene) < 1e-13


@BOTH_WAYS
@pytest.mark.parametrize("cell, order", [("quadrilateral", 2), ("triangle", 1)])
def test_closed_crack_slides_as_in_a_plane(sides, cell, order):
    """Slip 4 (1 - nu^2) / E (|tau| - mu sigma) at the centre; uniform pressure and shear."""
    pairs = sides(law=MU, sliding="small")
    scene = in_plane(slit(8, cell=cell, ratio=2.0), pairs, SLIDES, mu_f=0.3, order=order)
    assert is_right(scene)
    jump = jump_at(scene, (0.0, 0.0))
    assert jump == pytest.approx([jump_of_crack(0.4), 0.0], rel=0.008, abs=1e-15)
    contact = scene.contact
    assert contact.active.sum() == 15 and not contact.sticking.any()
    assert np.allclose(contact.pressure[contact.active], 1.0, rtol=1e-9)
    assert np.allclose(np.abs(contact.z_tau[contact.active]), 0.3, rtol=1e-9)


@pytest.mark.once
@pytest.mark.parametrize(("ratio", "order"), [(1.0, 1.0), (2.0, 2.0)])
def test_slip_of_an_inclined_crack_converges_as_its_tips_are_resolved(ratio, order):
    """The square root at the tips: of first order with even cells, of second with graded ones."""
    angle, found = np.radians(30.0), []
    for count in (8, 16):
        pairs, mesh = two(law=MU, sliding="small"), slit(count, ratio=ratio)
        scene = in_plane(mesh, pairs, SLIDES, mu_f=0.3, angle=angle)
        slip = jump_at(scene, (0.0, 0.0), angle=angle)[0]
        found.append(1.0 - slip / jump_of_crack(0.4))
    assert np.log2(found[0] / found[1]) == pytest.approx(order, abs=0.05)
    assert found[1] < (0.012 if ratio == 1.0 else 0.002)


@BOTH_WAYS
def test_closed_crack_with_linear_cells(sides):
    scene = in_plane(slit(16), sides(law=MU, sliding="small"), SLIDES, mu_f=0.3, degree=1)
    assert is_right(scene)
    assert jump_at(scene, (0.0, 0.0))[0] == pytest.approx(jump_of_crack(0.4), rel=0.025)


@BOTH_WAYS
def test_crack_that_sticks_is_as_if_it_were_not_there(sides):
    scene = in_plane(slit(4), sides(law=MU, sliding="small"), (0.0, -1.0, 0.2), mu_f=0.3)
    assert is_right(scene)
    assert scene.contact.sticking.sum() == scene.contact.active.sum() == 7
    assert np.abs(jump_at(scene, (0.0, 0.0))).max() < 1e-14


@BOTH_WAYS
@pytest.mark.parametrize("degree", [1, 2])
def test_crack_in_tension_opens_as_in_a_plane(sides, degree):
    scene = in_plane(slit(8), sides(law=MU), OPEN, degree=degree)
    assert scene.problem.certificate().violations() == []
    exact = jump_of_crack(np.array([0.3, 1.0]))
    assert jump_at(scene, (0.0, 0.0)) == pytest.approx(exact, rel=0.06 if degree == 1 else 0.015)
    assert not scene.contact.active.any()


@BOTH_WAYS
@pytest.mark.parametrize("cell, degree", [("quadrilateral", 1), ("triangle", 2)])
def test_inclined_crack_at_finite_strain(sides, cell, degree):
    """Turned by 35 degrees; the tangent is exact, also with the tip in two places."""
    options = {"material": neo_hookean, "loads": (0.5, 1.0), "degree": degree, "angle": 0.6}
    load = 3.0 * np.array(SLIDES)
    scene = in_plane(slit(4, cell=cell), sides(law=MU), load, mu_f=0.3, **options)
    assert is_right(scene)
    check = scene.problem.check_tangent(print_table=False)
    assert all(slope == pytest.approx(2.0, abs=0.05) for slope in check.slopes.values())
    estimate = scene.problem.estimate()
    assert 0.01 < estimate.relative < 0.2
    shear = np.abs(scene.contact.z_tau) / np.maximum(scene.contact.pressure, 1e-9)
    assert np.allclose(shear[scene.contact.active], 0.3, rtol=1e-8)


@pytest.mark.parametrize("degree", [1, 2])
def test_crack_from_the_side_has_one_tip(degree):
    """The result is that of a pair, if both faces are one surface."""
    options = {"degree": degree, "material": neo_hookean}
    scenes = [
        strained(edge_crack(4).data(), sides(law=MU), CLOSED_GRADIENT, **options)
        for sides in (two, one)
    ]
    assert all(is_right(scene) for scene in scenes)
    tips = [int((~scene.contact.may_carry).sum()) for scene in scenes]
    assert tips == [1, 2]  # one surface has the tip twice
    assert scenes[0].contact.active.sum() == scenes[1].contact.active.sum() > 1
    assert np.allclose(*(nodal(scene.problem) for scene in scenes), atol=1e-10)


SIDES = [f"plate/{side}" for side in ("bottom", "right", "top")]
GMSH_FACES = ("crack/upper", "crack/lower")


@BOTH_WAYS
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("points", [
    [(-2.0, 0.0), (-0.6, 0.0), (0.2, 0.6)],
    [(-1.2, 0.0), (-0.4, -0.4), (0.1, 0.7), (1.0, 0.7)],  # turns by 92 degrees
])  # fmt: skip
def test_kinked_crack(sides, degree, points):
    """From the left side, or inside of the plate; the kinks are corners of one of the parts."""
    data = read(cracked_plate.build, points=points, width=4.0, height=4.0, h=0.15)
    pairs = sides(GMSH_FACES, law=MU) if sides is two else sides(*GMSH_FACES, law=MU)
    options = {"material": neo_hookean, "degree": degree, "sides": SIDES, "loads": (0.5, 1.0)}
    scene = strained(data, pairs, [[-0.02, 0.03], [0.0, -0.03]], **options)
    assert is_right(scene)
    assert scene.contact.active.sum() > 5


FACES = [("a1", "a2"), ("b1", "b2"), ("c1", "c2")]
PARTS = [("w1", "w2"), ("w2", "w3"), ("w3", "w1")]
GRADIENTS = [CLOSED_GRADIENT, [[0.01, 0.05], [0.0, -0.02]], [[0.02, 0.0], [0.0, 0.02]]]


@pytest.mark.parametrize("gradient", GRADIENTS)
def test_cracks_that_meet_in_a_junction(gradient):
    """As pairs of faces and as one surface; opening and slip are 0.01 to 0.03."""
    ways = [("face", two(*FACES), ("a2", "a1")), ("part", one("w1", "w2", "w3"), ("w1", "w3"))]
    jumps = []
    for by, pairs, names in ways:
        options = {"material": neo_hookean, "loads": (0.5, 1.0)}
        scene = strained(branched(8, by=by).data(), pairs, gradient, **options)
        assert is_right(scene)
        jumps.append(jump_at(scene, (-0.25, 0.0), names))
    assert np.ptp(jumps, axis=0).max() < 1e-3 and np.abs(jumps).max() > 0.01


# With half of the load in a step, quadratic facets of parts do not converge on all machines.
HALVES, QUARTERS = (0.5, 1.0), (0.25, 0.5, 0.75, 1.0)


@pytest.mark.parametrize("by, pairs, degree, loads", [
    ("face", two(*FACES, law=MU), 1, HALVES),
    ("face", two(*FACES, law=MU), 2, HALVES),
    ("part", two(*PARTS, law=MU), 1, HALVES),
    ("part", two(*PARTS, law=MU), 2, QUARTERS),
    ("part", one("w1", "w2", "w3", law=MU), 1, HALVES),
    ("part", one("w1", "w2", "w3", law=MU), 2, HALVES),
])  # fmt: skip
def test_junction_with_friction(by, pairs, degree, loads):
    """Nodes at the junction meet the others at the same place; their paths go through nothing."""
    options = {"degree": degree, "loads": loads, "material": neo_hookean}
    scene = strained(branched(8, by=by).data(), pairs, CLOSED_GRADIENT, **options)
    assert is_right(scene)


@pytest.mark.parametrize("arms", ["left right down", "left right down up"])
@pytest.mark.parametrize("gradient", [[[-0.02, 0.01], [0.01, -0.03]], [[0.01, 0.04], [0.0, -0.02]]])
def test_short_cracks_at_a_junction_do_not_cross(arms, gradient):
    """Two facets each: an outline followed round a tip is back at the same place."""
    names = [(f"{arm}1", f"{arm}2") for arm in arms.split()]
    options = {"material": neo_hookean, "degree": 1, "loads": (0.5, 1.0)}
    for pairs in (two(*names), one(*np.ravel(names).tolist())):
        assert is_right(strained(crossed(arms).data(), pairs, gradient, **options))


CROSSING = "left right down up"
CROSSING_FACES = [(f"{arm}1", f"{arm}2") for arm in CROSSING.split()]
SHEARED = [[-0.005, 0.03], [0.0, -0.03]]


@pytest.mark.parametrize("gradient, mu, degree", [
    ([[-0.02, 0.01], [0.01, -0.03]], 0.3, 1),  # two of four sticks at the crossing are redundant
    ([[-0.03, -0.01], [-0.01, -0.02]], 0.0, 1),  # parts across the crossing touch in a point
    (SHEARED, 0.3, 2),  # and hide a whole facet by an overlap of rounding
])  # fmt: skip
def test_cracks_that_cross(gradient, mu, degree):
    """One surface of all faces has the slips and openings of a pair for each crack."""
    law, jumps = fm.Coulomb(mu), []
    for pairs in (two(*CROSSING_FACES, law=law), one(*sum(CROSSING_FACES, ()), law=law)):
        options = {"material": neo_hookean, "loads": (0.5, 1.0), "degree": degree}
        scene = strained(crossed(CROSSING).data(), pairs, gradient, **options)
        assert is_right(scene)
        places = zip([(-0.25, 0.0), (0.25, 0.0), (0.0, -0.25), (0.0, 0.25)], CROSSING_FACES)
        jumps.append([jump_at(scene, *place) for place in places])
    assert np.ptp(jumps, axis=0).max() < 1e-5


@pytest.mark.serial
def test_a_corner_that_slides_past_a_crossing_needs_pairs_of_the_parts_across():
    """By half a facet; without them the parts overlap by as much, which the report names.

    In quarters of the load rounding decides whether the second step converges.
    """
    gradient = [[-0.02, 0.15], [0.0, -0.04]]
    options = {"material": neo_hookean, "degree": 1, "loads": np.arange(1, 9) / 8.0}
    across = (["left1", "down2"], ["up2", "right1"]), (["left2", "up1"], ["right2", "down1"])
    for further, least, most in (((), 0.4, 0.5), (across, 0.0, 0.05)):
        pairs = two(*CROSSING_FACES, *further)
        scene = strained(crossed(CROSSING, 16).data(), pairs, gradient, **options)
        deepest = max(c.facets for c in scene.problem.equations.crossings.find())
        assert least <= deepest < most
        remarks = scene.problem.certificate().remarks()
        assert any(" cross at " in text for text in remarks) == (not further)


@BOTH_WAYS
def test_corner_goes_from_one_part_to_another_where_cracks_cross(sides):
    """Parts overlap by 0.04 facets at the crossing; the corner of a third went through neither."""
    names = CROSSING_FACES if sides is two else sum(CROSSING_FACES, ())
    data = crossed(CROSSING, 16, "triangle").data()
    gradient = [[-0.002, 0.003], [-0.027, -0.033]]
    assert is_right(strained(data, sides(*names), gradient, degree=1, loads=(0.5, 1.0)))


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_multigrid_for_a_crack(algorithm):
    """Cells round the tip belong to both faces."""
    options = {"algorithm": algorithm, "linear_bulk": False}
    scenes = [
        in_plane(slit(8), two(law=MU), 0.1 * np.array(SLIDES), solver=solver, **options)
        for solver in ("direct", "iterative")
    ]
    assert np.allclose(*(nodal(scene.problem) for scene in scenes), atol=1e-9)


def by_plugin(edge):
    """Square with a kinked crack, cut by gmsh's plugin; both faces have the name ``crack``."""
    model, geo = gmsh.model, gmsh.model.geo
    model.add("crack")
    corners = [geo.addPoint(x, y, 0.0, 0.5) for x, y in ((-2, -2), (2, -2), (2, 2), (-2, 2))]
    points = [geo.addPoint(x, y, 0.0, 0.3) for x, y in ((-2 if edge else -1, 0), (0, 0.4), (1, 0))]
    loop = corners + (points[:1] if edge else [])
    rim = [geo.addLine(a, b) for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]
    crack = [geo.addLine(a, b) for a, b in pairwise(points)]
    surface = geo.addPlaneSurface([geo.addCurveLoop(rim)])
    geo.synchronize()
    model.mesh.embed(1, crack, 2, surface)
    for dim, entities, name in ((2, [surface], "plate"), (1, rim, "rim"), (1, crack, "crack")):
        tag = model.addPhysicalGroup(dim, entities)
        model.setPhysicalName(dim, tag, name)
    mouth = model.addPhysicalGroup(0, points[:1]) if edge else 0
    model.mesh.generate(2)
    gmsh.plugin.setNumber("Crack", "Dimension", 1)
    gmsh.plugin.setNumber("Crack", "PhysicalGroup", tag)
    gmsh.plugin.setNumber("Crack", "OpenBoundaryPhysicalGroup", mouth)
    gmsh.plugin.run("Crack")
    return model


@pytest.mark.parametrize("edge", [True, False])
def test_crack_by_the_plugin_of_gmsh(edge):
    scene = strained(read(by_plugin, edge=edge), one("crack", law=MU), CLOSED_GRADIENT)
    assert is_right(scene)
    contact = scene.contact
    assert (~contact.may_carry).sum() == 4  # both tips, or one and the prescribed mouth, twice
    assert 2 * contact.active.sum() == contact.may_carry.sum()


@BOTH_WAYS
@pytest.mark.parametrize("degree", [1, 2])
def test_faces_with_different_meshes(sides, degree):
    """Uniform compression of the plate and of the crack, whatever the facets of its faces."""
    pairs = two(GMSH_FACES) if sides is two else one(*GMSH_FACES)
    mesh = {"width": 4.0, "height": 4.0, "h": 0.3, "facets": (5, 7)}
    data = read(cracked_plate.build, points=((-1.0, 0.0), (1.0, 0.0)), **mesh)
    rim = [*SIDES, "plate/left"]
    scene = strained(data, pairs, [[0.0, 0.0], [0.0, -0.01]], degree=degree, sides=rim)
    assert is_right(scene)
    pressure = scene.contact.pressure[scene.contact.active]
    assert pressure == pytest.approx(0.01 * (LMBDA + 2 * MODULUS), rel=1e-9)
    assert np.allclose(scene.u.x.array.reshape(-1, 2)[:, 0], 0.0, atol=1e-13)


# Refusals


def glued(nodes):
    """A plate with a slit whose faces have been joined again at some nodes of the slit."""
    mesh = slit(4)
    upper, lower = (mesh.boundaries[name] for name in ("upper", "lower"))
    for x in nodes:
        one_, other = (
            int(faces.ravel()[np.abs(mesh.x[faces.ravel(), 0] - x).argmin()])
            for faces in (upper, lower)
        )
        mesh.cells[mesh.cells == other] = one_
        lower[lower == other] = one_
    return mesh.data()


@pytest.mark.serial  # with two ranks the joint may be a corner of both, and is not joined
def test_faces_joined_between_their_tips_are_refused():
    data = glued([0.0])
    expected = "share 1 nodes, one at .*`fragment`.* the faces of a crack share its tips"
    with refused(fm.SurfaceError, expected, "plugin Crack"):
        strained(data, two(), CLOSED_GRADIENT)
    with refused(fm.SurfaceError, "branches at", "different nodes"):
        strained(data, one(), CLOSED_GRADIENT)
