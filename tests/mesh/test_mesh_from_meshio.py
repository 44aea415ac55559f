# SPDX-License-Identifier: MIT
"""Meshes from meshio: the same bodies, boundaries and contact as from arrays and from gmsh."""

import gmsh
import meshio
import numpy as np
import pytest
from refusal import COMM, refused
from scenes import TIGHT, internal, neo_hookean

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.utils import compat
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block

GRIDS = {
    order: [
        Grid("lower", block(5 * order, 2 * order, width=1.2, height=1.0, corner=(-0.1, 0.0))),
        Grid("upper", block(4 * order, 2 * order, width=1.0, height=0.5, corner=(0.0, 1.0))),
    ]
    for order in (1, 2)
}
TYPES = {3: "triangle", 4: "quad", 6: "triangle6", 9: "quad9"}
AREAS = {"lower": 1.2, "upper": 0.5}
LENGTHS = {
    "lower/bottom": 1.2, "lower/right": 1.0, "lower/top": 1.2, "lower/left": 1.0,
    "upper/bottom": 1.0, "upper/right": 0.5, "upper/top": 1.0, "upper/left": 0.5,
}  # fmt: skip


def given(cell="quadrilateral", order=1):
    """Arrays of two blocks."""
    return mapped_grids.arrays(GRIDS[order], cell=cell, order=order)


def blocks_of(arrays):
    """Cells and lines of each body and boundary as blocks of meshio, and their names."""
    cells, bodies = arrays["cells"], arrays["bodies"]
    blocks = [(TYPES[cells.shape[1]], cells[numbers]) for numbers in bodies.values()]
    lines = {2: "line", 3: "line3"}
    blocks += [(lines[ends.shape[1]], ends) for ends in arrays["boundaries"].values()]
    return blocks, [*bodies, *arrays["boundaries"]]


def with_sets(arrays, **options):
    """The mesh of meshio with the names of ``arrays`` as cell sets."""
    blocks, names = blocks_of(arrays)
    sizes = [len(nodes) for _, nodes in blocks]
    sets = {
        name: [np.arange(size if i == k else 0) for k, size in enumerate(sizes)]
        for i, name in enumerate(names)
    }
    return meshio.Mesh(arrays["points"], blocks, cell_sets=sets, **options)


def with_tags(arrays, key="gmsh:physical", first=7):
    """The mesh of meshio with integer tags from ``first`` on, in steps of 2."""
    blocks, names = blocks_of(arrays)
    data = [np.full(len(nodes), first + 2 * i, np.int32) for i, (_, nodes) in enumerate(blocks)]
    points = np.column_stack([arrays["points"], np.zeros(len(arrays["points"]))])
    dims = [2 if nodes.shape[1] > 3 or kind == "triangle" else 1 for kind, nodes in blocks]
    groups = {n: np.array([first + 2 * i, d]) for i, (n, d) in enumerate(zip(names, dims))}
    mesh = meshio.Mesh(points, blocks, cell_data={key: data})
    mesh.field_data = groups if key == "gmsh:physical" else {}
    return mesh


def from_file(path, mesh, file_format):
    """Write the mesh and read it again, on rank 0."""
    if COMM.rank:
        return None
    meshio.write(path, mesh, file_format=file_format)
    return meshio.read(path)


def on_rank_0(mesh):
    return mesh if COMM.rank == 0 else None


def sizes(data):
    """Areas of bodies and lengths of boundaries by name."""
    one = fem.Constant(data.mesh, 1.0)
    dx = ufl.Measure("dx", data.mesh, subdomain_data=data.cell_tags)
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags)
    return [
        {n: COMM.allreduce(fem.assemble_scalar(fem.form(one * m(tag)))) for n, tag in tags.items()}
        for m, tags in ((dx, data.bodies), (ds, data.boundaries))
    ]


def solution(data, names=None):
    """Displacement at the input nodes and contact pressure of pressed blocks."""
    usual = "lower/bottom", "upper/top", "upper/bottom", "lower/top"
    fixed, moved, slave, master = names or usual
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, fixed, (0.0, 0.0)), fm.dirichlet(V, data, moved, (0.01, -0.04))]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)),
        u,
        [fm.ContactPair(data, slave, master, law=fm.Coulomb(0.3))],
        bcs=bcs,
        newton=TIGHT,
        petsc_options_prefix="meshio_",
    )
    problem.solve()
    count = len(given()["points"])
    contact = problem.contacts[0]
    order = np.argsort(contact.positions[:, 0])
    return data.nodal_values(u, np.arange(count)), contact.pressure[order]


def assert_equal(data, other):
    """The same sizes and the same solution of a contact problem, to rounding."""
    (areas, lengths), (known_areas, known_lengths) = sizes(data), sizes(other)
    assert areas == pytest.approx(known_areas, rel=1e-13)
    assert lengths == pytest.approx(known_lengths, rel=1e-13)
    found, exact = solution(data), solution(other)
    for one, another in zip(found, exact, strict=True):
        assert np.abs(one - another).max() < 1e-10 * np.abs(another).max()


KINDS = [("triangle", 1), ("quadrilateral", 1), ("triangle", 2), ("quadrilateral", 2)]


@pytest.mark.parametrize("cell, order", KINDS)
def test_cell_sets_are_bodies_and_boundaries(cell, order):
    arrays = given(cell, order)
    data = fm.mesh_from_meshio(on_rank_0(with_sets(arrays)), comm=COMM)
    assert compat.cell_name(data.mesh) == cell
    areas, lengths = sizes(data)
    assert areas == pytest.approx(AREAS) and lengths == pytest.approx(LENGTHS)
    known = fm.mesh_from_arrays(**arrays)
    assert (data.bodies, data.boundaries) == (known.bodies, known.boundaries)
    if order == 1:
        assert_equal(data, known)


@pytest.mark.parametrize("file_format", ["gmsh22", "gmsh", "vtk", "vtu", "medit"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_files_with_tags(cell, file_format, tmp_path):
    """Names in files of gmsh, numbers in those of Medit and VTK; tags stay as they are."""
    suffix = {"gmsh22": "msh", "gmsh": "msh", "medit": "mesh"}.get(file_format, file_format)
    arrays = given(cell)
    keys = {"medit": "medit:ref", "vtk": "material", "vtu": "part"}
    path = COMM.bcast(tmp_path) / f"blocks.{suffix}"
    if file_format == "gmsh":
        mesh = of_gmsh(path, cell)
    else:
        mesh = with_tags(arrays, keys.get(file_format, "gmsh:physical"))
        mesh = from_file(path, mesh, file_format)
    data, known = fm.mesh_from_meshio(mesh, comm=COMM), fm.mesh_from_arrays(**arrays)
    names = [*known.bodies, *known.boundaries]
    if file_format == "gmsh":
        assert (data.bodies, data.boundaries) == of_reader(path)
    else:
        numbers = [7 + 2 * i for i in range(len(names))]
        named = file_format == "gmsh22"
        assert list({**data.bodies, **data.boundaries}.items()) == [
            (name if named else str(n), n) for name, n in zip(names, numbers, strict=True)
        ]
        if not named:  # by the number, and by its name
            assert solution(data, (11, 23, "19", 15))[1].max() > 1.0
            data = fm.MeshData(
                data.mesh, data.cell_tags, data.facet_tags,
                dict(zip(names[:2], numbers[:2])), dict(zip(names[2:], numbers[2:])),
            )  # fmt: skip
    assert_equal(data, known)


def of_gmsh(path, cell):
    """The mesh as written by gmsh in its present format, and read by meshio, on rank 0."""
    if COMM.rank:
        return None
    mapped_grids.build(GRIDS[1], cell=cell)
    gmsh.write(str(path))
    return meshio.read(path)


def of_reader(path):
    """Names and tags of ``read_gmsh``."""
    data = fm.read_gmsh(path, COMM)
    return data.bodies, data.boundaries


def test_files_of_abaqus(tmp_path):
    """Element sets are bodies, node sets boundaries, with unused nodes and a set of all nodes."""
    arrays = given("triangle")
    x = np.concatenate([arrays["points"], [(99.0, 99.0)]])
    cells = [("triangle", arrays["cells"][numbers]) for numbers in arrays["bodies"].values()]
    none = np.empty(0, int)
    lower, upper = (np.arange(len(nodes)) for _, nodes in cells)
    sets = {"lower": [lower, none], "upper": [none, upper]}
    nodes = {n.replace("/", "-"): np.unique(ends) for n, ends in arrays["boundaries"].items()}
    nodes |= {"all": np.arange(len(x)), "reference": np.array([len(x) - 1])}
    mesh = meshio.Mesh(x, cells, cell_sets=sets, point_sets=nodes)
    mesh = from_file(COMM.bcast(tmp_path) / "blocks.inp", mesh, "abaqus")
    sets = r"\['all', 'lower-bottom', .*from which bodies= and boundaries= choose"
    with refused(fm.MeshError, "is in the boundaries", sets):
        fm.mesh_from_meshio(mesh, comm=COMM)
    chosen = [name for name in nodes if name not in ("all", "reference")]
    data = fm.mesh_from_meshio(mesh, boundaries=chosen, comm=COMM)
    assert [*data.boundaries] == chosen
    data = fm.MeshData(
        data.mesh, data.cell_tags, data.facet_tags, data.bodies,
        {name.replace("-", "/"): tag for name, tag in data.boundaries.items()},
    )  # fmt: skip
    assert_equal(data, fm.mesh_from_arrays(**arrays))
    with refused(fm.MeshError, "no boundary 'reference'"):
        fm.mesh_from_meshio(mesh, boundaries=["reference"], comm=COMM)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_node_sets_of_quadratic_cells(cell):
    """A facet whose middle is not in the set is none of it, even if its ends are."""
    arrays = given(cell, 2)
    nodes = {name: np.unique(facets) for name, facets in arrays["boundaries"].items()}
    middles = arrays["boundaries"]["lower/top"][:, 2]
    nodes["lower/top"] = np.setdiff1d(nodes["lower/top"], middles[:1])
    kind = TYPES[arrays["cells"].shape[1]]
    mesh = meshio.Mesh(arrays["points"], [(kind, arrays["cells"])], point_sets=nodes)
    data = fm.mesh_from_meshio(on_rank_0(mesh), comm=COMM)
    areas, lengths = sizes(data)
    assert areas == pytest.approx({"body": 1.7})  # without sets of cells
    assert lengths == pytest.approx({**LENGTHS, "lower/top": 1.2 * 4 / 5})


def test_cells_of_eight_nodes_keep_their_shape():
    """The ninth node of a bent cell is that of the same map: areas are equal."""
    x = np.array([(0, 0), (2, 0), (2, 1), (0, 1), (1, -0.3), (2.1, 0.5), (1.2, 1.2), (-0.1, 0.4)])
    mesh = meshio.Mesh(x, [("quad8", [range(8)])], point_sets={"bottom": [0, 1, 4]})
    data = fm.mesh_from_meshio(on_rank_0(mesh), comm=COMM)
    xi, w = np.polynomial.legendre.leggauss(4)
    areas, lengths = sizes(data)
    assert areas["body"] == pytest.approx(area_of_serendipity(x, xi, w), rel=1e-13)
    slope = 0.6 * xi  # of y = -0.3 (1 - s^2), x = 1 + s
    assert lengths["bottom"] == pytest.approx(float(w @ np.hypot(1.0, slope)), rel=1e-3)


def area_of_serendipity(x, points, weights):
    """Area of one cell of eight nodes, by its own shape functions."""
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    area = 0.0
    for s, a in zip(points, weights):
        for t, b in zip(points, weights):
            i, j = signs.T
            dN = np.zeros((8, 2))
            dN[:4, 0] = i * (1 + j * t) * (2 * i * s + j * t) / 4
            dN[:4, 1] = j * (1 + i * s) * (2 * j * t + i * s) / 4
            dN[4:, 0] = -s * (1 - t), (1 - t * t) / 2, -s * (1 + t), -(1 - t * t) / 2
            dN[4:, 1] = -(1 - s * s) / 2, -t * (1 + s), (1 - s * s) / 2, -t * (1 - s)
            area += a * b * np.linalg.det(x.T @ dN)
    return area


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_clockwise_cells_give_the_same_contact(cell):
    arrays = given(cell)
    known = fm.mesh_from_arrays(**arrays)
    arrays["cells"] = arrays["cells"][:, ::-1]
    arrays["boundaries"] = {name: ends[:, ::-1] for name, ends in arrays["boundaries"].items()}
    assert_equal(fm.mesh_from_meshio(on_rank_0(with_sets(arrays)), comm=COMM), known)


def test_names_of_med_and_tags_without_name():
    """Families of Salome: a negative tag may have several names; 0 is no family."""
    arrays = given()
    blocks, names = blocks_of(arrays)
    families = {-1 - i: [name] for i, name in enumerate(names)}
    families[-3].append("support")  # lower/bottom
    families[-9].append("support")  # upper/top
    data = [np.full(len(nodes), -1 - i) for i, (_, nodes) in enumerate(blocks)]
    data[3][:] = 0  # lower/right
    mesh = meshio.Mesh(arrays["points"], blocks, cell_data={"cell_tags": data})
    mesh.cell_tags = families
    chosen = ["lower/top", "upper/bottom", "support"]
    made = fm.mesh_from_meshio(on_rank_0(mesh), boundaries=chosen, comm=COMM)
    assert (made.bodies, made.boundaries) == (
        {"upper": 1, "lower": 2},
        {"lower/top": 1, "upper/bottom": 2, "support": 3},
    )
    assert sizes(made)[1] == pytest.approx({"lower/top": 1.2, "upper/bottom": 1.0, "support": 2.2})
    with refused(fm.MeshError, "no boundary 'lower/right'"):
        fm.mesh_from_meshio(on_rank_0(mesh), boundaries=["lower/right"], comm=COMM)


def test_tags_from_zero_on_and_sets_beside_tags():
    """Tag 0 of cells is a body, whose tag is free; cells in a set need no tag."""
    arrays = given()
    mesh = with_tags(arrays, "MaterialIDs", first=0)
    data = fm.mesh_from_meshio(on_rank_0(mesh), comm=COMM)
    assert data.bodies == {"0": 1, "2": 2}
    assert [*data.boundaries.values()] == [4 + 2 * i for i in range(8)]
    mesh.cell_data["other"] = mesh.cell_data["MaterialIDs"]
    with refused(fm.MeshError, "arrays of integers, .'MaterialIDs', 'other'.; choose by tags="):
        fm.mesh_from_meshio(on_rank_0(mesh), comm=COMM)
    assert fm.mesh_from_meshio(on_rank_0(mesh), tags="other", comm=COMM).bodies == data.bodies
    mesh.cell_sets = {"base": [np.arange(len(mesh.cells[0].data)), *[None] * 9]}
    mixed = fm.mesh_from_meshio(on_rank_0(mesh), tags="other", comm=COMM)
    assert mixed.bodies == {"base": 1, "2": 2}
    assert sizes(mixed)[0] == pytest.approx({"base": 1.2, "2": 0.5})


def test_numbers_of_nodes_are_rows_of_the_points():
    """Points without cells are ignored, wherever they are, also at another z."""
    arrays = given()
    on_cells = np.column_stack([arrays["points"], np.full(len(arrays["points"]), 3.0)])
    x = np.concatenate([[(0.0, 0.0, 0.0), (np.nan, 5.0, 1.0)], on_cells])
    arrays["boundaries"] = {name: ends + 2 for name, ends in arrays["boundaries"].items()}
    arrays["points"], arrays["cells"] = x, arrays["cells"] + 2
    data = fm.mesh_from_meshio(on_rank_0(with_sets(arrays)), comm=COMM)
    assert data.mesh.geometry.dim == 2
    u = fem.Function(fm.vector_space(data.mesh, 1))
    u.interpolate(lambda X: X[:2])
    found = data.nodal_values(u, np.arange(len(x)))
    assert np.isnan(found[:2]).all()
    assert np.abs(found[2:] - x[2:, :2]).max() < 1e-14


def test_errors_say_what_there_is():
    arrays = given()
    x, cells = arrays["points"], arrays["cells"]

    def refuse(mesh, *parts, **options):
        with refused(fm.MeshError, *parts):
            fm.mesh_from_meshio(on_rank_0(mesh), comm=COMM, **options)

    quads = [("quad", cells)]
    refuse("blocks.msh", "mesh is 'blocks.msh'; expected a mesh of meshio")
    both = meshio.Mesh(x, [("triangle", cells[:1, :3]), ("quad", cells[1:])])
    refuse(both, r"has \['quad', 'triangle'\]; expected cells of one of the types triangle, ")
    wedge = meshio.Mesh(np.eye(6, 3), [("wedge", [[0, 1, 2, 3, 4, 5]])])
    refuse(wedge, r"has \['wedge'\]; expected cells")
    refuse(meshio.Mesh(x, [("line", cells[:, :2])]), r"has \['line'\]")
    bent = np.column_stack([x, x[:, 0]])
    refuse(meshio.Mesh(bent, quads), "z varies by 1.2; expected a mesh of the x-y plane")
    refuse(meshio.Mesh(x, quads), "no body 'steel'", r"bodies \['body'\]", bodies=["steel"])
    refuse(meshio.Mesh(x, quads), r"tags='ref': cell_data has \[\]", tags="ref")
    halves = {"a": [np.arange(3)], "all": [np.arange(len(cells))]}
    overlap = meshio.Mesh(x, quads, cell_sets=halves)
    refuse(overlap, "cell 0 is in the bodies 'a' and 'all'", r"bodies \['a', 'all'\]")
    refuse(overlap, "cells are in no body", r"bodies \['a', 'all'\]", bodies="a")
    parts = meshio.Mesh(x, quads, cell_data={"part": [np.full(len(cells), 0.5)]})
    refuse(parts, "'part'. is not one integer for each cell", tags="part")
    with refused(fm.MeshError, "rank 9 should give the mesh"):
        fm.mesh_from_meshio(None, comm=COMM, rank=9)
    assert fm.mesh_from_meshio(on_rank_0(overlap), bodies=["all"], comm=COMM).bodies == {"all": 1}


@pytest.mark.each
@pytest.mark.parametrize("beside", [[], [("triangle", [[0, 1, 2]])], [("tetra", [[0, 1, 2, 3]])]])
def test_prisms_are_refused_with_the_types_of_solids(beside):
    """Also where the file has their triangles, which are not taken for the cells."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
    mesh = meshio.Mesh(np.array(points, float), [("wedge", [[0, 1, 2, 3, 4, 5]]), *beside])
    with pytest.raises(fm.MeshError, match=r"'wedge'\]; expected .* tetra, .*hexahedron27"):
        fm.mesh_from_meshio(mesh)
