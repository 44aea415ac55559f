# SPDX-License-Identifier: MIT
"""Scripts of meshes/: sizes, names, positions of nodes."""

import numpy as np
import pytest
from mesh_measures import CELLS, COMM, area, length, nodes_on, num_facets, read

import fenics_mortar as fm
from fenics_mortar.interface.traces import surfaces_of
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from meshes import (
    cracked_plate,
    half_cylinder_on_block,
    inclusion,
    indenter_on_block,
    rings,
    two_blocks,
)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("inclination", (0.0, 0.3))
@pytest.mark.parametrize("rotation", (0.0, 2.0))
def test_areas_and_lengths_of_two_blocks_are_exact(cell, inclination, rotation):
    data = read(
        two_blocks.build,
        cell=cell,
        n_upper=5,
        n_lower=7,
        layers_upper=4,
        layers_lower=3,
        height_upper=0.8,
        gap=0.1,
        inclination=inclination,
        rotation=rotation,
        grading=2.0,
    )
    secant = 1.0 / np.cos(inclination)
    lengths = {
        "upper/bottom": secant,
        "upper/top": 1.0,
        "upper/left": 0.8 + 0.5 * np.tan(inclination),
        "lower/bottom": 2.2,
        "lower/top": 2.2 * secant,
        "lower/right": 1.0 + 1.1 * np.tan(inclination),
    }
    assert area(data, "upper") == pytest.approx(0.8, rel=1e-13)
    assert area(data, "lower") == pytest.approx(2.2, rel=1e-13)
    for name, right in lengths.items():
        assert length(data, name) == pytest.approx(right, rel=1e-13), name
    assert [num_facets(data, n) for n in ("upper/bottom", "lower/top", "upper/left")] == [5, 7, 4]


def test_gap_of_two_blocks_is_normal_to_the_inclined_interface():
    data = read(two_blocks.build, inclination=0.3, gap=0.1)
    normal = np.array([-np.sin(0.3), np.cos(0.3)])
    heights = [nodes_on(data, name) @ normal for name in ("upper/bottom", "lower/top")]
    assert [np.ptp(h) for h in heights] == pytest.approx([0.0, 0.0], abs=1e-14)
    assert heights[0].mean() - heights[1].mean() == pytest.approx(0.1, rel=1e-13)


def test_upper_sides_of_two_blocks_split_at_half_height():
    data = read(two_blocks.build, split=True)
    for side in ("left", "right"):
        assert f"upper/{side}" not in data.boundaries
        for half, low, high in (("bottom", 1.0, 1.5), ("top", 1.5, 2.0)):
            y = nodes_on(data, f"upper/{side}/{half}")[:, 1]
            assert np.allclose(np.sort(y), np.linspace(low, high, 6), rtol=0.0, atol=1e-14)


def test_grading_of_two_blocks_makes_thin_layers_at_the_interface():
    data = read(two_blocks.build, grading=4.0, layers_upper=5, layers_lower=6)
    for side, thin, thick in (("upper/left", 0, -1), ("lower/left", -1, 0)):
        layers = np.diff(np.sort(nodes_on(data, side)[:, 1]))
        assert layers[thick] / layers[thin] == pytest.approx(4.0, rel=1e-6)


def test_facets_of_two_blocks_do_not_match_unless_made_to():
    data = read(two_blocks.build)
    upper, lower = (np.sort(nodes_on(data, n)[:, 0]) for n in ("upper/bottom", "lower/top"))
    common = np.isclose(upper[:, None], lower, atol=1e-9).any(axis=1)
    assert not common[1:5].any()


@pytest.mark.parametrize("cell", CELLS)
def test_nodes_of_rings_are_on_their_circles(cell):
    data = read(rings.build, cell=cell, interference=0.01, n_inner=13, n_outer=17)
    radii = {"inner/inside": 1.0, "inner/outside": 2.01, "outer/inside": 2.0, "outer/outside": 3.0}
    for name, radius in radii.items():
        count = 13 if name.startswith("inner") else 17
        distances = np.hypot(*nodes_on(data, name).T)
        assert len(distances) == num_facets(data, name) == count
        assert abs(distances - radius).max() < 1e-14 * radius
        polygon = 2 * count * radius * np.sin(np.pi / count)
        assert length(data, name) == pytest.approx(polygon, rel=1e-13)
    polygons = 0.5 * 17 * np.sin(2 * np.pi / 17) * (3.0**2 - 2.0**2)
    assert area(data, "outer") == pytest.approx(polygons, rel=1e-13)


def test_nodes_of_rings_are_at_the_given_angles():
    angles = np.array([0.1, 0.5, 1.5, 2.0, 3.9, 5.5])
    data = read(rings.build, angles_inner=angles)
    x, y = nodes_on(data, "inner/outside").T
    assert np.sort(np.arctan2(y, x) % (2 * np.pi)) == pytest.approx(angles, abs=1e-15)


def test_indenter_has_the_size_and_position_of_shallow_ironing():
    data = read(indenter_on_block.build, n_indenter=10)
    x, y = nodes_on(data, "indenter/arc").T
    assert (x.min(), x.max()) == pytest.approx((0.2, 1.4), abs=1e-15)
    assert (y.min(), y.max()) == pytest.approx((4.2, 4.5), abs=1e-14)
    assert abs(np.hypot(x - 0.8, y - 4.95) - 0.75).max() < 1e-14
    chord = 2 * 0.75 * np.sin(np.arcsin(0.8) / 10)
    assert length(data, "indenter/arc") == pytest.approx(10 * chord, rel=1e-12)
    assert length(data, "indenter/left") == pytest.approx(0.9, rel=1e-13)
    assert length(data, "indenter/top") == pytest.approx(1.2, rel=1e-13)
    assert area(data, "block") == pytest.approx(48.0, rel=1e-13)


@pytest.mark.parametrize("cell", CELLS)
def test_half_cylinder_is_fine_where_it_meets_the_block(cell):
    data = read(half_cylinder_on_block.build, cell=cell, h=0.02, gap=0.1)
    x, y = nodes_on(data, "cylinder/arc").T
    assert abs(np.hypot(x, y - 1.1) - 1.0).max() < 1e-14
    for boundary, size in (("cylinder/arc", 0.02), ("block/top", 0.014)):
        x = np.sort(nodes_on(data, boundary)[:, 0])
        facets = np.diff(x[abs(x) < 0.15])
        assert np.isclose(x, 0.0, atol=1e-14).sum() == 1
        assert 0.85 * size < facets.min() and facets.max() < 1.1 * size
    assert area(data, "block") == pytest.approx(8.0, rel=1e-13)
    assert area(data, "cylinder") == pytest.approx(0.5 * np.pi, rel=5e-3)


@pytest.mark.parametrize("order", (1, 2))
def test_inclusion_and_plate_meet_on_the_circle(order):
    data = read(inclusion.build, order=order)
    assert area(data, "inclusion") == pytest.approx(np.pi / 4, rel=1e-3 if order == 1 else 1e-6)
    assert area(data, "plate") == pytest.approx(100 - np.pi / 4, rel=1e-4)
    assert [num_facets(data, f"{body}/arc") for body in ("inclusion", "plate")] == [24, 8]
    for body in ("inclusion", "plate"):
        assert np.hypot(*nodes_on(data, f"{body}/arc").T) == pytest.approx(1.0, abs=1e-12)
    lengths = np.diff(np.sort(nodes_on(data, "plate/left")[:, 1]))
    assert lengths.max() / lengths.min() == pytest.approx(8.0, rel=1e-6)


@pytest.mark.parametrize("points, tips", [
    ([(-0.8, -0.6), (0.8, 0.6)], [(-0.8, -0.6), (0.8, 0.6)]),
    ([(-2.0, 0.0), (0.0, 0.5), (1.0, 0.0)], [(1.0, 0.0)]),
])  # fmt: skip
def test_faces_of_a_crack_share_its_tips(points, tips):
    data = read(cracked_plate.build, points=points, width=4.0, height=4.0, h=0.2, order=2)
    assert area(data, "plate") == pytest.approx(16.0, rel=1e-12)
    upper, lower = (nodes_on(data, f"crack/{face}") for face in ("upper", "lower"))
    assert np.allclose(upper[np.argsort(upper[:, 0])], lower[np.argsort(lower[:, 0])], atol=1e-12)
    for tip in points:
        assert (np.hypot(*(upper - tip).T) < 1e-12).any()
    num_facets_of_faces = [num_facets(data, f"crack/{face}") for face in ("upper", "lower")]
    assert num_facets_of_faces[0] == num_facets_of_faces[1] > 4
    pair = fm.ContactPair(data, "crack/upper", "crack/lower")
    V = fm.vector_space(data.mesh, 1)
    slave, master = surfaces_of(pair, DisplacementSpace(V), np.empty((0, 2), np.int64))
    shared = slave.X[np.isin(slave.nodes, master.nodes)]
    assert np.allclose(shared[np.argsort(shared[:, 0])], tips, atol=1e-12)


@pytest.mark.parametrize(
    ("build", "options"),
    (
        (cracked_plate.build, {"points": [(-0.8, 0.0), (30.0, 0.0)]}),
        (cracked_plate.build, {"points": [(0.8, 0.0), (0.8, 0.5)]}),
        (inclusion.build, {"radius": 11.0}),
        (two_blocks.build, {"cell": "hexagon"}),
        (two_blocks.build, {"split": True, "layers_upper": 3}),
        (two_blocks.build, {"n_upper": 0}),
        (rings.build, {"angles_inner": [0.0, 1.0, 0.5]}),
        (rings.build, {"a": 2.0, "b": 1.0}),
        (rings.build, {"n_outer": 2}),
        (indenter_on_block.build, {"n_indenter": 5}),
    ),
)
def test_scripts_refuse_invalid_arguments(build, options):
    if COMM.rank == 0:
        with pytest.raises(ValueError, match=r"right is|expected|cannot|only|have to"):
            build(**options)


def test_half_cylinder_has_no_triangles_where_gmsh_alone_would_leave_some():
    build = half_cylinder_on_block.build
    data = read(build, cell="quadrilateral", h=0.15, growth=0.05)
    assert compat.cell_name(data.mesh) == "quadrilateral"
