# SPDX-License-Identifier: MIT
"""Contact of a surface in space with itself, and of surfaces that may all touch each other."""

from dataclasses import replace

import numpy as np
import pytest
from heat_scenes import stacked_in_space
from refusal import refused
from scenes import TIGHT, nodal
from self_scenes import strip_in_s
from space_pair_scenes import bodies
from space_self_scenes import clamp, cracked, extruded_strip, flattened_tube, stack, tube

import fenics_mortar as fm
from fenics_mortar.contact import contact as contact_module
from fenics_mortar.energies import linear_elastic
from fenics_mortar.interface.corners import SharpEdges
from fenics_mortar.interface.facing import nearest_on_master
from fenics_mortar.obstacles.rigid_motion import rotation_by
from meshes.mapped_boxes import SIDES, Box, block

MU = fm.Coulomb(0.3)
SLOT = ["slot/below", "slot/above"]
# Sum of the components of the contact forces of the strip in space.
FORCE_OF_STRIP = 3.8039581977
TURN = rotation_by(np.array([0.4, -0.7, 0.2]))


def with_itself(names, **options):
    return lambda data: [fm.ContactPair(data, names, **options)]


def chosen(slave, master, **options):
    return lambda data: [fm.ContactPair(data, slave, master, **options)]


def pressed(pairs, *, motion=(0.0, 0.0, -0.2), **options):
    """The clamp with its slot closed."""
    scene = clamp(pairs, newton=TIGHT, **options)
    turn = options.get("turn", np.eye(3))
    scene.move(2, high=turn @ motion)
    return scene


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_faces_of_a_slot_press_on_each_other_uniformly(turn):
    scene = pressed(with_itself(SLOT), narrower=0, turn=turn)
    pressures = scene.pressures()
    assert pressures.size == 36  # of one face
    assert np.ptp(pressures) < 1e-10 * pressures.mean()
    assert scene.imbalance() < 1e-14
    assert scene.problem.certificate().violations() == []


@pytest.mark.parametrize("law", [None, MU])
def test_slot_agrees_with_chosen_sides(law):
    """Two surfaces that may touch: the one with the smaller mean size of facets is the slave."""
    motion = (0.0, 0.0, -0.2) if law is None else (0.03, 0.02, -0.2)
    options = {"motion": motion, "nu": 0.3}
    found = pressed(with_itself(SLOT, law=law), **options)
    pair = pressed(chosen(*SLOT[::-1], law=law), **options)
    assert found.contact.active.sum() == pair.contact.active.sum() == 16
    assert np.allclose(*(nodal(s.problem) for s in (found, pair)), rtol=0.0, atol=1e-8)
    assert found.problem.certificate().violations() == []
    if law is not None:
        assert np.abs(found.contact.now.shear_size).max() > 0.1
    slopes = found.problem.check_tangent().slopes
    assert slopes["whole"] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("jiggle", [0.0, 0.15])
def test_roles_may_change_within_the_contact(monkeypatch, jiggle):
    """On the line where they do, nodes that face each other share a gap, and one multiplier."""
    order = contact_module.in_contact_with_itself

    def in_two_halves(surface, may_carry):
        found = order(surface, may_carry)
        x, _, z = surface.X[surface.facets].mean(axis=1).T
        keys, first = found.roles.keys.copy(), (x < 0.5) == (z < 1.05)
        keys[np.lexsort((keys[:, 0], ~first)), 0] = np.arange(x.size)
        return replace(found, roles=replace(found.roles, keys=keys))

    monkeypatch.setattr(contact_module, "in_contact_with_itself", in_two_halves)
    scene = pressed(with_itself(SLOT), count=4, narrower=0, jiggle=jiggle)
    pressures, z = scene.pressures(), scene.contact.operators.x[scene.contact.active, 2]
    assert np.ptp(pressures) < 1e-3 * pressures.mean()
    assert 25 <= pressures.size <= 27 and np.ptp(z) < 1e-3
    assert scene.imbalance() < 1e-14
    assert scene.problem.certificate().violations() == []


def test_three_blocks_named_by_one_list():
    """The block in the middle is supported by contact alone."""
    scene = stack(with_itself_of_names, newton=TIGHT)
    scene.move(2, high=(0.0, 0.0, -0.15))
    pressures = scene.pressures()
    assert pressures.size == 16 + 25  # of the finer side of each slot
    assert np.ptp(pressures) < 1e-6 * pressures.mean()  # facets are no parallelograms
    assert scene.imbalance() < 1e-14
    assert scene.problem.certificate().violations() == []


def with_itself_of_names(data, names):
    return [fm.ContactPair(data, names)]


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_heat_flows_across_one_list_of_surfaces_as_across_pairs(mu):
    found = []
    for of_pair in (True, False):
        scene = stacked_in_space(overhang=0.2, alpha=1e-2)
        sides = ["upper/bottom", "lower/top"]
        flux = fm.Conductance(1, fm.PressureConductance(0.5, 0.9))
        given = sides if of_pair else [sides]
        pair = fm.ContactPair(scene.data, *given, law=fm.Coulomb(mu), fluxes=[flux])
        scene.set(top=(0.01, 0.0, -0.05), hot=10.0)
        scene.problem([pair], newton=TIGHT).solve()
        found.append(scene.w.x.array.copy())
    # Facets begin at other corners, and so do the triangles that curved ones are integrated over.
    np.testing.assert_allclose(found[1], found[0], atol=1e-7)


def test_backs_of_blocks_are_no_partners():
    """Of whole blocks, upper sides do not see the lower sides of their own block."""
    names = [f"b{i}/{side}" for i in range(3) for side in SIDES]
    scene = stack(lambda data, _: [fm.ContactPair(data, names)], newton=TIGHT)
    scene.problem.solve()
    o = scene.contact.operators
    assert o.segments.num_segments and (o.gap[o.cover > 0.0] > 0.0).all()
    heights = [side[s].mean(axis=1)[:, 2] for side, s in
               ((o.x, o.segments.slave), (o.m, o.segments.master))]  # fmt: skip
    assert np.allclose(np.abs(heights[0] - heights[1]), 0.05)
    scene.move(1, high=(0.0, 0.0, -0.15))
    assert scene.contact.active.sum() >= 25
    assert scene.problem.certificate().violations() == []


@pytest.mark.parametrize("gap", [0.0, 0.02])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_pressure_between_blocks_of_one_outline_is_uniform(cell, gap):
    """All sides of three blocks are one surface: edges take the normals of the sides that touch."""
    heights, counts = (0.0, 0.5 + gap, 1.0 + 2.0 * gap), (3, 4, 3)
    free = {side: "skin" for side in SIDES}
    names = [{**free, "bottom": "bottom"}, free, {**free, "top": "top"}]
    boxes = [
        Box(f"block {z}", block((n, n, 2), size=(1.0, 1.0, 0.5), corner=(0.0, 0.0, z)), joined)
        for z, n, joined in zip(heights, counts, names, strict=True)
    ]
    scene = bodies(boxes, ["bottom", "top"], [("skin", None)], cell=cell, poisson=0.0)
    scene.move("top", (0.0, 0.0, -0.05 - 2.0 * gap)).solve()
    contact = scene.problem.equations.contacts[0]
    pressures = contact.z[contact.active] @ [0.0, 0.0, 1.0]
    assert contact.active.sum() == 50
    assert np.abs(pressures) == pytest.approx(np.abs(pressures).mean(), rel=1e-9)


@pytest.mark.once
def test_extruded_strip_is_that_of_the_plane():
    """In contact on both sides of the middle arm; the plane projects along other normals."""
    with_outline, motion = with_itself("strip/outline"), np.array([0.0, -0.25, 0.0])
    plane, solid = strip_in_s(with_outline), extruded_strip(with_outline)
    expected, path = plane.move(10, high=motion[:2]), solid.move(10, high=motion)
    assert path.num_cuts == 0 and solid.problem.certificate().violations() == []
    o, contact = solid.contact.operators, solid.contact
    force = np.linalg.norm(o.force(contact.z)[0], axis=1).sum() / 0.1
    assert force == pytest.approx(plane.forces()[0], rel=1e-3)
    middles = contact.slave.X[:, :2], plane.contact.slave.X
    near = np.linalg.norm(middles[0][:, None] - middles[1], axis=2).argmin(axis=1)
    u, v = (scene.contact.slave.gather(scene.u.x.array) for scene in (plane, solid))
    assert np.abs(v[:, :2] - u[near]).max() < 1e-3 * np.abs(u).max()
    counts = [sum(step.report.num_iterations for step in each.steps) for each in (expected, path)]
    assert counts[1] < 1.3 * counts[0]


@pytest.mark.once
def test_strip_in_an_s_touches_on_both_sides():
    strip = extruded_strip(with_itself("strip/outline"), layers=2, flat=False, sides=SIDES)
    path = strip.move(10, high=(0.0, -0.25, 0.0))
    assert path.num_cuts == 0 and strip.problem.certificate().violations() == []
    force = np.abs(strip.contact.operators.force(strip.contact.z)[0]).sum()
    assert force == pytest.approx(FORCE_OF_STRIP, rel=1e-6)  # as on 1, 2 and 3 ranks
    heights = np.sort(strip.contact.operators.x[strip.contact.active, 1])
    assert heights.size > 30 and (np.diff(heights) > 0.04).sum() >= 1  # two levels
    assert strip.imbalance() < 1e-12
    slopes = strip.problem.check_tangent().slopes
    assert slopes["whole"] == pytest.approx(2.0, abs=0.1)


@pytest.mark.once
@pytest.mark.parametrize("law", [None, MU])
def test_tube_pressed_flat_touches_itself(law):
    """Roles change at the bends alone: all slave nodes in contact are on one side."""
    flat, path = flattened_tube(law, steps=10)
    assert path.num_cuts == 0
    assert max(step.report.num_iterations for step in path.steps) <= 12
    assert flat.problem.certificate().violations() == []
    sides = np.sign(flat.contact.slave.X[flat.contact.active, 1])
    assert sides.size > 20 and (sides == sides[0]).all()
    assert flat.imbalance() < 1e-12
    y = flat.u.function_space.tabulate_dof_coordinates()[:, 1]
    u = flat.u.x.array.reshape(-1, 3)
    u[:, 1] -= 0.09 * np.tanh(y / 0.3)[: len(u)]  # through itself
    violations = flat.problem.certificate().violations()
    of_tube = [text for text in violations if "plane" not in text]
    for what in ("penetration of", "overlap", "cross"):
        assert any(what in text for text in of_tube)


VARIANTS = {
    "tetrahedra": ({"cell": "tetrahedron"}, {"law": MU}),
    "tetrahedra of degree 2": ({"cell": "tetrahedron", "order": 2}, {}),
    "hexahedra of degree 2": ({"order": 2}, {}),
    "small sliding": ({"energy": linear_elastic}, {"law": MU, "sliding": "small"}),
    "linear bulk": ({"energy": linear_elastic, "linear_bulk": True}, {"law": MU}),
    "linear bulk and small sliding": (
        {"energy": linear_elastic, "linear_bulk": True}, {"sliding": "small"},
    ),
}  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize("name", VARIANTS)
def test_other_elements_and_equations_agree_with_chosen_sides(name):
    options, of_pair = VARIANTS[name]
    options = {"motion": (0.005, 0.002, -0.14), "nu": 0.3, "count": 4, **options}
    found = pressed(with_itself(SLOT, **of_pair), **options)
    pair = pressed(chosen(*SLOT[::-1], **of_pair), **options)
    assert found.contact.active.sum() == pair.contact.active.sum() >= 9
    assert np.allclose(*(nodal(s.problem) for s in (found, pair)), rtol=0.0, atol=1e-7)
    assert found.imbalance() < 1e-14
    assert found.problem.certificate().violations() == []


@pytest.mark.parametrize("option", ["algorithm", "solver"])
def test_only_saddle_point_and_direct_solvers(option):
    value = {"algorithm": "condensed", "solver": "iterative"}[option]
    with pytest.raises(ValueError, match=f"{option}='{value}'"):
        clamp(with_itself(SLOT), **{option: value})


def test_missed_contact_is_called_wrong():
    scene = clamp(with_itself(SLOT, search_radius=1e-3))
    scene.moved["high"].value[:] = 0.0, 0.0, -0.25
    with refused(fm.NotConvergedError, "wrong state: .* cross at .* contact was missed"):
        scene.problem.solve()


def test_cracks_are_refused():
    with refused(fm.SurfaceError, r"folds back on itself at \(0.*, as at the tip of a crack"):
        cracked(with_itself(SLOT))


def test_order_does_not_depend_on_numbers():
    """Facets of the clamp, and of the clamp with the numbers of its nodes reversed."""
    scene = clamp(with_itself(SLOT))
    surface = scene.contact.slave
    may_carry = scene.contact.may_carry
    order = np.random.default_rng(0).permutation(surface.num_nodes)
    place = np.argsort(order)
    facets = place[surface.facets][np.random.default_rng(1).permutation(len(surface.facets))]
    other = replace(surface, X=surface.X[order], facets=facets, roles=None)
    other = contact_module.in_contact_with_itself(other, may_carry[order])
    by_order = [np.argsort(s.roles.keys[:, 0]) for s in (surface, other)]
    middles = [s.X[s.facets].mean(axis=1)[o] for s, o in zip((surface, other), by_order)]
    assert np.allclose(*middles, rtol=0.0, atol=1e-12)


def test_sides_of_a_fold_have_one_role_each():
    """Columns of a tube and their mirror images in any plane through its axis, however it lies."""
    count, rng = 32, np.random.default_rng(3)
    scene = tube(with_itself("tube/inside"), columns=count)
    surface, may_carry = scene.contact.slave, scene.contact.may_carry
    middles = surface.X[surface.facets].mean(axis=1)
    angles = np.arctan2(middles[:, 1], middles[:, 0]) * count / (2 * np.pi)
    columns = np.lexsort((middles[:, 2], np.floor(angles) % count)).reshape(count, 2)
    for _ in range(5):
        Q = rotation_by(rng.uniform(-2.0, 2.0, 3))
        turned = replace(surface, X=surface.X @ Q.T, roles=None)
        found = contact_module.in_contact_with_itself(turned, may_carry)
        order = found.roles.keys[columns, 0]
        for crease in range(count):
            sides = crease + np.arange(count // 2), crease - 1 - np.arange(count // 2)
            first = order[sides[0] % count] < order[sides[1] % count]
            assert first.all() or not first.any()


def test_neighbours_are_no_masters_of_each_other():
    surface = clamp(with_itself(SLOT)).contact.slave
    masters = surface.roles.masters_of(np.arange(len(surface.facets)))
    assert not (masters & masters.T).any()
    share = (surface.facets[:, None, :, None] == surface.facets[None, :, None]).any(axis=(2, 3))
    assert not (masters & (share.astype(int) @ share > 0)).any()
    # every other two facets have roles
    far = share.astype(int) @ share == 0
    assert (masters | masters.T)[far].all()


def test_nearest_points_are_on_another_part():
    scene = clamp(with_itself(SLOT))
    scene.problem.solve()
    o = scene.contact.operators
    upper = np.flatnonzero(o.x[:, 2] > 1.05)
    corners, weights = nearest_on_master(o, upper)
    places = np.einsum("kc,kcd->kd", weights, o.x[corners])
    assert np.allclose(places, o.x[upper] - [0.0, 0.0, 0.1])


def beside_a_wall(gap, whole):
    """A block on a finer one is pressed down, and aside to a wall of one cell.

    With outlines that may all touch each other, or with the sides that meet.
    """
    but = {"block": ("top", "left"), "below": ("bottom",), "wall": ("right",)}
    shapes = {
        "block": block((2, 2, 2), size=(1.0, 1.0, 0.5)),
        "below": block((9, 7, 1), size=(1.8, 1.4, 0.4), corner=(-0.4, -0.2, -0.4)),
        "wall": block((1, 1, 1), size=(1.0, 1.8, 1.4), corner=(1.0 + gap, -0.4, 0.02)),
    }
    names = {
        body: {side: body for side in SIDES if whole and side not in left_out}
        for body, left_out in but.items()
    }
    boxes = [Box(name, x, names[name]) for name, x in shapes.items()]
    pairs = [("below/top", "block/bottom"), ("block/right", "wall/left")]
    held = ["block/top", "below/bottom", "wall/right"]
    pairs = [(list(shapes), None)] if whole else pairs
    scene = bodies(boxes, held, pairs, newton=TIGHT)
    return scene.move("block/top", (gap + 0.02, 0.0, -0.02))


@pytest.mark.once
@pytest.mark.parametrize("gap", [0.05, 0.4])
def test_a_sharp_edge_takes_the_normal_of_the_side_that_faces_its_own_masters(gap):
    """The block below is nearer to the edge than the wall, but its slave: roles follow sizes."""
    scene = beside_a_wall(gap, True)
    assert scene.solve().certificate.violations() == []
    contact = scene.problem.equations.contacts[0]
    sharp = SharpEdges(contact.slave).nodes
    X = contact.slave.X[sharp]
    of_block = np.abs(X[:, 1] - 0.5) < 0.6
    at_edge = sharp[of_block & np.isclose(X[:, [0, 2]], [1.0, 0.0]).all(axis=1)]
    assert at_edge.size == 3
    assert np.abs(contact.operators.n[at_edge] - [1.0, 0.0, 0.0]).max() < 0.05
    if gap == 0.4:  # the edge is beyond the block below: only sides of the pairs touch
        expected = beside_a_wall(gap, False)
        expected.solve()
        assert scene.u.x.array == pytest.approx(expected.u.x.array, abs=1e-8)
