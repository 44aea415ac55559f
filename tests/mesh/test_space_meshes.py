# SPDX-License-Identifier: MIT
"""Meshes of tetrahedra and hexahedra: from arrays, gmsh and meshio, with names, tags and errors."""

import gmsh
import meshio
import numpy as np
import pytest
from mesh_measures import COMM, area, length, num_facets, on_root, raises_on_all_ranks, read
from refusal import refused

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.mesh.space import KINDS, codes_of
from fenics_mortar.utils import compat
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block, mapped

KIND = [(cell, order) for cell in mapped_boxes.CELLS for order in (1, 2)]
EACH = pytest.mark.parametrize("cell, order", KIND)
NODES = {(kind.name, kind.degree): number for (_, number), kind in KINDS.items()}
TYPES = {4: "tetra", 10: "tetra10", 8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"}
FACES = {3: "triangle", 4: "quad"}


def bent(s, t, r):
    """Map of a cube to a body of volume 2 whose sides are parabolas."""
    return s + 0.1 * t**2 - 0.3 * r**2, 2.0 * t + 0.2 * r**2, r


def boxes(order=1):
    """A body of volume 2, jiggled or bent, and a block of volume 3 that touch nowhere."""
    if order == 1:
        body = block((3, 2, 2), size=(1.0, 2.0, 1.0), jiggle=0.2)
    else:
        body = mapped((3, 2, 2), bent, order=2)
    plate = block((2, 3, 1), size=(2.0, 3.0, 0.5), corner=(0.0, 0.0, 4.0), order=order)
    return [Box("body", body), Box("plate", plate)]


def arrays(cell, order):
    return mapped_boxes.arrays(boxes(order), cell=cell, order=order)


def check_boxes(data):
    """Check volumes and areas of the bodies of ``boxes``."""
    assert area(data, "body") == pytest.approx(2.0, rel=1e-12)
    assert area(data, "plate") == pytest.approx(3.0, rel=1e-12)
    assert length(data, "plate/top") == pytest.approx(6.0, rel=1e-12)
    assert length(data, "plate/front") == pytest.approx(1.0, rel=1e-12)
    assert length(data, "plate/right") == pytest.approx(1.5, rel=1e-12)


@EACH
def test_names_volumes_and_areas(cell, order):
    data = mapped_boxes.mesh(boxes(order), cell=cell, order=order)
    assert compat.cell_name(data.mesh) == cell
    assert (data.cell_tags.dim, data.facet_tags.dim) == (3, 2)
    assert set(data.bodies) == {"body", "plate"} and len(data.boundaries) == 12
    check_boxes(data)
    assert num_facets(data, "body/top") == 6 * (2 if cell == "tetrahedron" else 1)


@EACH
def test_nodes_keep_their_numbers(cell, order):
    """Dofs of the space of the same order lie at the points of all nodes of the input."""
    given = arrays(cell, order)
    data = fm.mesh_from_arrays(**given)
    V = fm.vector_space(data.mesh, order)
    u = fem.Function(V)
    u.interpolate(lambda x: x)
    found = data.nodal_values(u, np.arange(len(given["points"])))
    assert np.abs(found - given["points"]).max() < 1e-14
    assert len(given["points"]) == V.dofmap.index_map.size_global


@EACH
def test_left_handed_map_gives_the_same_boundaries(cell, order):
    body = mapped((2, 3, 2), lambda s, t, r: (s, t, -r), order=order)
    data = mapped_boxes.mesh([Box("body", body)], cell=cell, order=order)
    assert area(data, "body") == pytest.approx(1.0, rel=1e-12)
    assert all(length(data, name) == pytest.approx(1.0) for name in data.boundaries)


def test_closed_ring_has_no_ends():
    def position(s, t, r):
        angle, radius = 2.0 * np.pi * s, 1.0 + t
        return radius * np.cos(angle), radius * np.sin(angle), r

    ring = Box("ring", mapped((16, 2, 2), position, order=2), closed=True)
    data = mapped_boxes.mesh([ring], order=2)
    assert set(data.boundaries) == {f"ring/{side}" for side in mapped_boxes.SIDES[2:]}
    assert area(data, "ring") == pytest.approx(3.0 * np.pi, rel=1e-3)


@EACH
@pytest.mark.parametrize("version, binary", [(4.1, 0), (4.1, 1), (2.2, 0), (None, 0)])
def test_gmsh_files_and_live_models(cell, order, version, binary, tmp_path):
    path = COMM.bcast(tmp_path / "boxes.msh")

    def build():
        model = mapped_boxes.build(boxes(order), cell=cell, order=order)
        if version is None:
            return model
        gmsh.option.setNumber("Mesh.SaveAll", 0)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.write(str(path))
        return path

    data = fm.read_gmsh(on_root(build), COMM)
    check_boxes(data)
    assert num_facets(data, "body/bottom") == 6 * (2 if cell == "tetrahedron" else 1)


def sphere(order):
    occ, model = gmsh.model.occ, gmsh.model
    model.add("sphere")
    occ.addSphere(0, 0, 0, 1)
    occ.addBox(2, 0, 0, 1, 1, 1)
    occ.synchronize()
    for name, solid in (("ball", 1), ("box", 2)):
        model.setPhysicalName(3, model.addPhysicalGroup(3, [solid]), name)
        sides = [tag for _, tag in model.getBoundary([(3, solid)])]
        model.setPhysicalName(2, model.addPhysicalGroup(2, np.abs(sides)), f"{name}/outside")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
    model.mesh.generate(3)
    model.mesh.setOrder(order)
    return model


def test_bodies_of_gmsh_itself():
    data = read(sphere, order=2)
    assert area(data, "ball") == pytest.approx(4.0 / 3.0 * np.pi, rel=2e-3)
    assert length(data, "ball/outside") == pytest.approx(4.0 * np.pi, rel=2e-3)
    assert length(data, "box/outside") == pytest.approx(6.0, rel=1e-12)


def with_sets(given, columns=None):
    """The mesh of meshio with the names of arrays as cell sets."""
    cells, bodies, faces = given["cells"][:, :columns], given["bodies"], given["boundaries"]
    blocks = [(TYPES[cells.shape[1]], cells[numbers]) for numbers in bodies.values()]
    blocks += [(FACES[nodes.shape[1]], nodes) for nodes in faces.values()]
    sets = {
        name: [np.arange(len(nodes) if i == k else 0) for k, (_, nodes) in enumerate(blocks)]
        for i, name in enumerate([*bodies, *faces])
    }
    return meshio.Mesh(given["points"], blocks, cell_sets=sets)


@pytest.mark.parametrize(
    "cell, order, columns", [*((*k, None) for k in KIND), ("hexahedron", 2, 20)]
)
def test_meshes_of_meshio(cell, order, columns):
    data = fm.mesh_from_meshio(on_root(lambda: with_sets(arrays(cell, order), columns)))
    check_boxes(data)
    assert compat.geometry_dofmap(data.mesh).shape[1] == NODES[cell, order]


def test_node_sets_of_meshio_are_boundaries():
    given = arrays("tetrahedron", 2)
    lid = np.flatnonzero(np.isclose(given["points"][:, 2], 4.5))
    mesh = meshio.Mesh(given["points"], [("tetra10", given["cells"])], point_sets={"lid": lid})
    data = fm.mesh_from_meshio(on_root(lambda: mesh))
    assert length(data, "lid") == pytest.approx(6.0, rel=1e-12)


def test_codes_of_faces_differ():
    """Different faces have different codes, in any order of the corners the same."""
    faces = np.array(np.meshgrid(*3 * [np.arange(40)])).reshape(3, -1).T
    faces = faces[(np.diff(faces, axis=1) > 0).all(axis=1)]
    codes = codes_of(faces, 40)
    assert np.unique(codes).size == len(faces)
    assert np.array_equal(codes, codes_of(faces[:, [2, 0, 1]], 40))


@pytest.mark.parametrize("order", [1, 2])
def test_dirichlet_conditions_in_space(order):
    data = mapped_boxes.mesh(boxes(order), order=order)
    V = fm.vector_space(data.mesh, order)
    whole = fm.dirichlet(V, data, "plate/left", (1.0, 2.0, 3.0))
    part = fm.dirichlet(V, data, ["plate/top", "plate/bottom"], 4.0, component=2)
    u = fem.Function(V)
    compat.set_prescribed(u.x.array, [whole, part])
    owned = V.dofmap.index_map.size_local
    x, values = V.tabulate_dof_coordinates()[:owned], u.x.array.reshape(-1, 3)[:owned]
    plate = x[:, 2] > 3.9
    left = plate & np.isclose(x[:, 0], 0.0)
    lids = np.isclose(x[:, 2], 4.0) | np.isclose(x[:, 2], 4.5)
    assert (values[left, :2] == (1.0, 2.0)).all() and (values[left & ~lids, 2] == 3.0).all()
    assert (values[lids, 2] == 4.0).all() and (values[lids & ~left, :2] == 0.0).all()
    assert COMM.allreduce(int(left.sum())) == (3 * order + 1) * (order + 1)


def test_errors_of_dirichlet_conditions():
    data = mapped_boxes.mesh(boxes())
    V = fm.vector_space(data.mesh, 1)
    with refused(fm.MeshError, "component is 3; expected 0, 1, 2 or None for all"):
        fm.dirichlet(V, data, "body/top", 0.0, component=3)
    with refused(fm.MeshError, r"shape \(2,\); expected \(3,\)"):
        fm.dirichlet(V, data, "body/top", (0.0, 0.0))
    with refused(fm.MeshError, "a number prescribes one component, component=0, 1 or 2"):
        fm.dirichlet(V, data, "body/top", 0.0)


# Errors


def one_cube(**changed):
    """Arrays of one hexahedron, changed."""
    given = mapped_boxes.arrays([Box("cube", block((1, 1, 1)))])
    return {**given, "boundaries": {"top": given["boundaries"]["cube/top"]}, **changed}


@pytest.mark.each
@pytest.mark.parametrize(
    "changed, message",
    [
        (
            {"cells": [(0, 1, 2, 3, 4, 5)]},
            r"cells have shape \(1, 6\); expected \(m, 4\) or \(m, 10",
        ),
        ({"cells": [range(9)]}, r"\(1, 9\).*z of the points varies: for a mesh of the x-y plane"),
        ({"cells": [(0, 1, 2, 3, 4, 5, 6, 8)]}, "a cell has the node 8; the points are 0 to 7"),
        ({"cells": [(0, 1, 2, 3, 4, 5, 6, 6)]}, "cell 0 has a node twice"),
        ({"boundaries": {"top": [(0, 1)]}}, r"shape \(1, 2\); expected \(f, 4\): .* 4 corners"),
        (
            {"boundaries": {"top": [(0, 1, 2, 7)]}},
            "1 facets are not faces of cells, one of the nod",
        ),
        (
            {"boundaries": {"a": [(1, 3, 5, 7)], "b": [(7, 5, 3, 1)]}},
            r"in the boundaries \['a', 'b",
        ),
        ({"bodies": {}}, r"1 cells are in no body, one at \(0.5, 0.5, 0.5\)"),
    ],
)
def test_bad_arrays_raise_on_all_ranks(changed, message):
    with refused(fm.MeshError, message):
        fm.mesh_from_arrays(**one_cube(**changed))


@EACH
def test_hanging_nodes_raise_on_all_ranks(cell, order):
    """A block beside a finer one, with common nodes where positions are equal."""
    given = mapped_boxes.arrays(
        [
            Box("coarse", block((1, 1, 1), order=order)),
            Box("fine", block((2, 2, 2), corner=(1.0, 0.0, 0.0), order=order)),
        ],
        cell=cell,
        order=order,
    )
    separate = fm.mesh_from_arrays(**given)
    assert area(separate, "fine") == pytest.approx(1.0, rel=1e-12)
    _, first, number = np.unique(
        given["points"].round(9), axis=0, return_index=True, return_inverse=True
    )
    given["cells"] = first[number.ravel()][given["cells"]]
    given["boundaries"] = {}
    with refused(fm.MeshError, r"[45] hanging nodes: node \d+ at \(1, .* lies inside the edge"):
        fm.mesh_from_arrays(**given)


def test_crack_with_named_sides_is_no_hanging_node():
    """Two blocks of different meshes joined along one line, with named sides."""
    given = mapped_boxes.arrays(
        [
            Box("left", block((1, 1, 1))),
            Box("right", block((1, 2, 1), corner=(1.0, 0.0, 0.0))),
        ]
    )
    x = given["points"]
    for end in ((1.0, 0.0, 0.0), (1.0, 1.0, 0.0)):
        one, other = np.flatnonzero(np.isclose(x, end).all(axis=1))
        given["cells"][given["cells"] == other] = one
        for facets in given["boundaries"].values():
            facets[facets == other] = one
    data = fm.mesh_from_arrays(**given)
    assert area(data, "right") == pytest.approx(1.0, rel=1e-12)
    with refused(fm.MeshError, r"1 hanging nodes: node \d+ at \(1, 0.5, 0\)"):
        fm.mesh_from_arrays(**{**given, "boundaries": {}})


def prism():
    gmsh.model.add("prism")
    base = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    solids = gmsh.model.occ.extrude([(2, base)], 0, 0, 1, [1], recombine=True)
    gmsh.model.occ.synchronize()
    volume = next(tag for dim, tag in solids if dim == 3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), "prism")
    gmsh.model.mesh.generate(3)
    return gmsh.model


def only_surfaces(groups=True):
    gmsh.model.add("box")
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(2)
    return gmsh.model


def test_bad_models_raise_on_all_ranks():
    raises_on_all_ranks(r"type \['Prism 6'\] are not supported; expected e.g. 'Tetra", read, prism)
    raises_on_all_ranks(r"was model.mesh.generate\(3\) called\?", read, only_surfaces)
    with refused(NotImplementedError, "in three dimensions: cells of order 3 .*Tetrahedron 20"):
        read(sphere, order=3)
