# SPDX-License-Identifier: MIT
"""Names, tags and surfaces that are rejected, and valid surfaces."""

import re

import gmsh
import numpy as np
import pytest
from array_meshes import (
    blocks_of_arrays,
    grid,
    mesh_of,
    problem_on,
    surface_of,
    tagged,
    tagged_facets,
)
from refusal import COMM, refused
from scenes import read
from small_scenes import SMALL, small_blocks

from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from meshes import mapped_boxes, two_blocks

# Names and tags


def test_unknown_side_lists_the_known_names():
    data = read(two_blocks.build, **SMALL)
    with refused(fm.MeshError, "no boundary 'punch'", "lower/bottom.*upper/top"):
        fm.ContactPair(data, "punch", "lower/top")
    with refused(fm.MeshError, "no boundary 'anvil'", "lower/bottom.*upper/top"):
        fm.ContactPair(data, "upper/bottom", "anvil")


@pytest.mark.parametrize("name", [None, ["upper/bottom", None], 1.5])
def test_invalid_name_is_refused_as_unknown(name):
    data = read(two_blocks.build, **SMALL)
    unknown = name[-1] if isinstance(name, list) else name
    with refused(fm.MeshError, re.escape(f"no boundary {unknown!r}"), "upper/bottom"):
        fm.ContactPair(data, name, "lower/top")


@pytest.mark.parametrize("empty", ["nothing", 77])
def test_boundary_without_facets_is_refused_and_those_with_facets_are_listed(empty):
    data = read(two_blocks.build, **SMALL)
    data.boundaries["nothing"] = 99
    with refused(fm.MeshError, f"boundary '?{empty}'? has no facets", "upper/top"):
        fm.ContactPair(data, "upper/bottom", empty)


@pytest.mark.parametrize("dim", [0, 2, None])
def test_facet_tags_of_another_dimension_are_refused(dim):
    mesh = blocks_of_arrays().mesh
    entities = np.arange(mesh.topology.index_map(dim or 0).size_local, dtype=np.int32)
    tags = dmesh.meshtags(mesh, dim or 0, entities, np.ones(entities.size, np.int32))
    data = fm.MeshData(mesh, None, None if dim is None else tags, {}, {"slave": 1, "master": 1})
    with refused(fm.MeshError, "facet_tags", "dimension 1"):
        problem_on(data)


# Surfaces


def test_slave_and_master_must_differ():
    scene_data = read(two_blocks.build, **SMALL)
    pair = fm.ContactPair(scene_data, "upper/bottom", "upper/bottom")
    with refused(fm.SurfaceError, "the same surface, 'upper/bottom'.* no master"):
        problem_on(scene_data, [pair])


def test_slave_and_master_must_not_share_a_node():
    data = read(two_blocks.build, **SMALL)
    pair = fm.ContactPair(data, "upper/bottom", "upper/left")
    with refused(fm.SurfaceError, r"share 1 nodes, one at \(0.6, 1\)", "different surfaces"):
        problem_on(data, [pair])


def test_a_node_must_not_be_slave_of_one_master_in_two_pairs():
    data = read(two_blocks.build, **SMALL)
    for master in ("lower/top", fm.Plane((0.0, 1.0), (0.0, 1.0))):
        pairs = [fm.ContactPair(data, side, master) for side in ("upper/bottom", "upper/right")]
        where = rf"1 nodes are slaves of '{master}' in two pairs, .*, one at \(1.6, 1\)"
        with refused(fm.SurfaceError, where, "in one list"):
            problem_on(data, pairs)


@pytest.mark.parametrize("cell", mapped_boxes.CELLS)
def test_masters_in_space_may_share_slave_nodes_where_they_meet_at_a_corner_only(cell):
    low = mapped_boxes.block((4, 2, 1), size=(1.0, 1.0, 0.5))
    high = mapped_boxes.block((3, 2, 1), size=(1.0, 1.0, 0.5), corner=(0.0, 0.0, 0.5))
    boxes = [mapped_boxes.Box("lower", low), mapped_boxes.Box("upper", high)]
    given = mapped_boxes.arrays(boxes, cell=cell)
    top = given["boundaries"].pop("lower/top")
    is_first = given["points"][top, 0].mean(axis=1) < 0.5
    given["boundaries"] |= {"lower/first": top[is_first], "lower/last": top[~is_first]}
    data = fm.mesh_from_arrays(**given)

    def problem_with(*masters):
        return problem_on(data, [fm.ContactPair(data, "upper/bottom", name) for name in masters])

    for side in ("left", "front", "back"):
        assert len(problem_with("lower/first", f"lower/{side}").contacts) == 2
    with refused(fm.SurfaceError, "12 nodes are slaves of 'lower/first' in two pairs"):
        problem_with("lower/first", "lower/last")


@pytest.mark.parametrize("other", ["lower/top", fm.Plane((0.0, 0.9), (0.0, 1.0))])
def test_a_node_may_be_slave_of_an_obstacle_and_of_another_master(other):
    data = read(two_blocks.build, **SMALL)
    wall = fm.Plane((-9.0, 0.0), (1.0, 0.0))
    pairs = [fm.ContactPair(data, "upper/bottom", master) for master in (wall, other)]
    assert len(problem_on(data, pairs).contacts) == 2


def test_facet_of_zero_length_is_refused():
    cells, x = grid(4, 2)
    x[12] = x[11]  # the top's second and third node: a quadrilateral becomes a triangle
    data = tagged(mesh_of(cells, x), slave=lambda x: x[1] > 0.9, master=lambda x: x[1] < 0.1)
    with refused(fm.SurfaceError, r"'slave': .* \(0.25, 1\) .*zero length"):
        problem_on(data)


def test_facets_inside_a_body_are_refused():
    cells, x = grid(8, 8)
    data = tagged(
        mesh_of(cells, x),
        slave=lambda x: np.isclose(x[0], 0.5) | np.isclose(x[1], 0.5),
        master=lambda x: x[1] < 0.1,
    )
    with refused(fm.SurfaceError, "'slave': 16 of .*not on the boundary", r"at \(", "outline"):
        problem_on(data)


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("tagged_by", ["both ranks", "owner", "the other"])
def test_facets_between_two_ranks_are_known_to_be_inside(tagged_by):
    """Without ghost cells (dolfinx 0.9) a rank has only one cell of such a facet."""
    cells, x = grid(8, 8)
    mesh = mesh_of(cells, x)
    mesh.topology.create_connectivity(1, 2)
    exterior = dmesh.exterior_facet_indices(mesh.topology)
    facet_cells, cell_map = mesh.topology.connectivity(1, 2), mesh.topology.index_map(2)
    owned = mesh.topology.index_map(1).size_local
    one_cell = np.array(
        [
            facet
            for facet in range(owned + mesh.topology.index_map(1).num_ghosts)
            if (facet_cells.links(facet) < cell_map.size_local).sum() == 1
        ],
        np.int32,
    )
    between = np.setdiff1d(one_cell, exterior)
    selected = {
        "both ranks": between,
        "owner": between[between < owned],
        "the other": between[between >= owned],
    }[tagged_by]
    number = COMM.allreduce(int((between < owned).sum()))
    assert number > 0
    bottom = dmesh.locate_entities(mesh, 1, lambda x: x[1] < 0.1)
    bottom = np.setdiff1d(bottom, selected)
    data = tagged_facets(mesh, {"slave": selected, "master": bottom})
    with refused(fm.SurfaceError, f"'slave': {number} of its facets are not on the boundary"):
        problem_on(data)


@pytest.mark.parametrize("case", ["two squares", "two holes"])
def test_branching_surface_is_refused(case):
    """Cells that meet in one corner only, with the whole outline as one surface.

    If the corner lies between ranks, dolfinx makes two nodes of it without a warning.
    """
    if case == "two squares":
        one, x = grid(2, 2)
        two, y = grid(2, 2, (1.0, 1.0), first=8)  # its first node is the last of the other square
        cells, x, where = np.concatenate([one, two]), np.concatenate([x, y[1:]]), r"\(1, 1\)"
    else:
        cells, x = grid(8, 8)
        cells, where = np.delete(cells, [1 + 8 * 1, 2 + 8 * 2], axis=0), r"\(0.25, 0.25\)"
    mesh = mesh_of(cells, x)
    mesh.topology.create_connectivity(1, 2)
    data = tagged_facets(mesh, {"outline": dmesh.exterior_facet_indices(mesh.topology)})
    pair = fm.ContactPair(data, "outline", "outline")
    with refused(fm.SurfaceError, f"'outline' branches at {where}", "split it"):
        problem_on(data, [pair])


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_direction_of_gmsh_lines_does_not_matter(cell):
    def square(turned):
        gmsh.model.add("square")
        p = [gmsh.model.geo.addPoint(x, y, 0.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
        ends = [(p[i], p[(i + 1) % 4]) for i in range(4)]
        lines = [gmsh.model.geo.addLine(*(reversed(e) if turned else e)) for e in ends]
        loop = gmsh.model.geo.addCurveLoop([-line if turned else line for line in lines])
        surface = gmsh.model.geo.addPlaneSurface([loop])
        for line in lines:
            gmsh.model.geo.mesh.setTransfiniteCurve(line, 5)
        gmsh.model.geo.mesh.setTransfiniteSurface(surface)
        if cell == "quadrilateral":
            gmsh.model.geo.mesh.setRecombine(2, surface)
        gmsh.model.geo.synchronize()
        for dim, tag, name in ((2, surface, "body"), (1, lines[2], "top")):
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)
        gmsh.model.mesh.generate(2)
        return gmsh.model

    usual, turned = (surface_of(read(square, turned=t), "top") for t in (False, True))
    assert np.allclose(usual.X, turned.X, atol=1e-15)
    assert np.array_equal(usual.facets, turned.facets)
    assert (usual.X[usual.facets[:, 0], 0] > usual.X[usual.facets[:, 1], 0]).all()


@pytest.mark.once
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_orientation_of_cells_does_not_matter(cell):
    results = []
    for turn in (False, True):
        data = blocks_of_arrays(cell, turn)
        u = fem.Function(fm.vector_space(data.mesh, 1))
        bcs = [
            fm.dirichlet(u.function_space, data, "base", (0.0, 0.0)),
            fm.dirichlet(u.function_space, data, "top", (0.01, -0.05)),
        ]
        problem = problem_on(data, u=u, bcs=bcs)
        problem.solve()
        contact = problem.equations.contacts[0]
        results.append([contact.slave.X, contact.slave.facets, contact.pressure])
    for one, other in zip(*results, strict=True):
        assert np.allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(one).max())
    assert results[0][2].min() > 1.0


def test_slave_out_of_reach_of_the_master_is_no_error():
    scene = small_blocks(gap=5.0)
    scene.loads["push"].value[:] = 0.0, -0.01
    assert scene.problem.solve().converged
    assert not scene.contact.active.any()
    assert np.isnan(scene.contact.gap).all()
