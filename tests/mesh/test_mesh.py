# SPDX-License-Identifier: MIT
"""Reading gmsh meshes with their names, named boundary conditions, and the scripts of meshes/."""

from mpi4py import MPI
from petsc4py import PETSc

import gmsh
import numpy as np
import pytest

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

from fenics_mortar.mesh.data import MeshData
from fenics_mortar.mesh.dirichlet import dirichlet
from fenics_mortar.mesh.gmsh_reader import read_gmsh
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import MeshError
from meshes import half_cylinder_on_block, inclusion, indenter_on_block, rings, two_blocks

COMM = MPI.COMM_WORLD
CELLS = ("triangle", "quadrilateral")
SCRIPTS = {
    "two_blocks": two_blocks.build,
    "rings": rings.build,
    "indenter_on_block": indenter_on_block.build,
    "half_cylinder_on_block": lambda **options: half_cylinder_on_block.build(h=0.1, **options),
}


@pytest.fixture(autouse=True)
def gmsh_session():
    """Run gmsh on rank 0, silently."""
    if COMM.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
    yield
    if COMM.rank == 0:
        gmsh.finalize()


@pytest.fixture
def msh_path(tmp_path):
    """Give one path to all ranks."""
    return COMM.bcast(tmp_path / "mesh.msh")


def on_root(function, *args, **options):
    """Call ``function`` on rank 0 only; return its value there and ``None`` on the others."""
    return function(*args, **options) if COMM.rank == 0 else None


def read(build, **options):
    """Build a model on rank 0 and read it on all."""
    return read_gmsh(on_root(build, **options), COMM)


def measure(data, dim, entities):
    """Area of cells (``dim`` 2) or length of exterior facets (``dim`` 1), over all ranks."""
    entities = np.sort(entities).astype(np.int32)
    tags = dmesh.meshtags(data.mesh, dim, entities, np.ones(entities.size, dtype=np.int32))
    integral = ufl.Measure({1: "ds", 2: "dx"}[dim], domain=data.mesh, subdomain_data=tags)(1)
    one = fem.Constant(data.mesh, PETSc.ScalarType(1.0))
    return COMM.allreduce(fem.assemble_scalar(compat.form(one * integral)))


def area(data, body):
    return measure(data, 2, data.cell_tags.find(data.body_tag(body)))


def length(data, boundary):
    return measure(data, 1, data.boundary_facets(boundary))


def num_facets(data, boundary):
    owned = data.mesh.topology.index_map(1).size_local
    return COMM.allreduce(int((data.boundary_facets(boundary) < owned).sum()))


def nodes_on(data, boundary):
    """Coordinates of the vertices of a boundary on all ranks, shape (num_nodes, 2), sorted."""
    V = compat.scalar_space(data.mesh, 1)
    data.mesh.topology.create_connectivity(1, 2)
    dofs = fem.locate_dofs_topological(V, 1, data.boundary_facets(boundary))
    owned = dofs[dofs < V.dofmap.index_map.size_local]
    return gathered(V.tabulate_dof_coordinates()[owned, :2])


def gathered(x):
    """Put together the rows of all ranks, in an order that round-off does not change."""
    x = np.concatenate(COMM.allgather(x))
    return x[np.lexsort(x.round(10).T + 0.0)]


def raises_on_all_ranks(match, function, *args, **options):
    """Check that each rank gets a MeshError that says the same."""
    with pytest.raises(MeshError, match=match) as caught:
        function(*args, **options)
    assert len(set(COMM.allgather(str(caught.value)))) == 1


# Names


def test_names_are_known_on_all_ranks():
    data = read(two_blocks.build)
    sides = ("bottom", "right", "top", "left")
    assert sorted(data.bodies) == ["lower", "upper"]
    assert sorted(data.boundaries) == sorted(f"{b}/{s}" for b in data.bodies for s in sides)
    assert len(set(COMM.allgather(repr((data.bodies, data.boundaries))))) == 1


def test_unknown_boundary_name_lists_the_known_ones():
    data = MeshData(None, None, None, {"lower": 1}, {"lower/top": 2, "lower/bottom": 3})
    right = r"no boundary 'punch'; the mesh has \['lower/bottom', 'lower/top'\]"
    raises_on_all_ranks(right, data.boundary_tag, "punch")
    raises_on_all_ranks(r"no body 'punch'; the mesh has \['lower'\]", data.body_tag, "punch")


def test_tag_and_name_are_equally_good():
    data = MeshData(None, None, None, {"lower": 1}, {"lower/top": 2})
    assert data.boundary_tag("lower/top") == data.boundary_tag(2) == data.boundary_tag(np.int32(2))
    assert data.body_tag("lower") == data.body_tag(1) == 1


def test_mesh_made_by_hand_goes_by_its_integers():
    mesh = dmesh.create_unit_square(COMM, 3, 3)
    left = dmesh.locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[0], 0.0))
    tags = dmesh.meshtags(mesh, 1, np.sort(left), np.full(left.size, 5, dtype=np.int32))
    data = MeshData(mesh, None, tags)
    assert length(data, 5) == pytest.approx(1.0, rel=1e-14)
    raises_on_all_ranks(r"boundary 6 has no facets; the mesh has \[5\]", data.boundary_facets, 6)


# Reading


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("script", SCRIPTS)
def test_file_and_live_model_give_the_same_mesh(script, cell, msh_path):
    model = on_root(SCRIPTS[script], cell=cell)
    on_root(gmsh.write, str(msh_path))
    live, file = read_gmsh(model, COMM), read_gmsh(msh_path, COMM)
    assert (live.bodies, live.boundaries) == (file.bodies, file.boundaries)
    for body in live.bodies:
        assert area(file, body) == pytest.approx(area(live, body), rel=1e-13)
    for boundary in live.boundaries:
        assert np.allclose(nodes_on(file, boundary), nodes_on(live, boundary), atol=1e-14)
        assert num_facets(file, boundary) == num_facets(live, boundary)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("script", SCRIPTS)
def test_mesh_has_only_the_cells_asked_for_and_none_turned_over(script, cell):
    model = on_root(SCRIPTS[script], cell=cell)
    if COMM.rank == 0:
        (cell_type,), _, (nodes,) = model.mesh.getElements(2)
        tags, x, _ = model.mesh.getNodes()
        corners = nodes.reshape(-1, {"triangle": 3, "quadrilateral": 4}[cell])
        corners = x.reshape(-1, 3)[np.argsort(tags)][corners - 1]
        before, after = (np.roll(corners, shift, axis=1) - corners for shift in (1, -1))
        turn = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
        assert cell_type == {"triangle": 2, "quadrilateral": 3}[cell]
        assert (turn > 0.0).all()
    assert compat.cell_name(read_gmsh(model, COMM).mesh) == cell


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("script", SCRIPTS)
def test_boundaries_of_a_script_are_the_whole_boundary(script, cell):
    data = read(SCRIPTS[script], cell=cell)
    data.mesh.topology.create_connectivity(1, 2)
    exterior = dmesh.exterior_facet_indices(data.mesh.topology)
    named = data.boundary_facets(list(data.boundaries))
    assert COMM.allreduce(bool(np.isin(exterior, named).all()), MPI.LAND)
    assert sum(length(data, name) for name in data.boundaries) == pytest.approx(
        measure(data, 1, exterior), rel=1e-13
    )


@pytest.mark.parametrize("cell", CELLS)
def test_second_order_mesh_follows_the_circles(cell):
    def build(order):
        model = rings.build(cell=cell)
        model.mesh.setOrder(order)
        return model

    exact = np.pi * (2.0**2 - 1.0**2)
    errors = [1.0 - area(read(build, order=order), "inner") / exact for order in (1, 2)]
    assert errors[0] == pytest.approx(1.0 - 16 / np.pi * np.sin(np.pi / 16), rel=1e-10)
    assert abs(errors[1]) < 1e-3 * errors[0]


def test_nodes_numbered_with_holes_are_read(msh_path):
    """gmsh writes only nodes of physical groups, with the numbers they had."""

    def write_upper():
        model = two_blocks.build()
        for dim, tag in model.getPhysicalGroups():
            if model.getPhysicalName(dim, tag).startswith("lower"):
                model.removePhysicalGroups([(dim, tag)])
        gmsh.write(str(msh_path))

    on_root(write_upper)
    data = read_gmsh(msh_path, COMM)
    assert list(data.bodies) == ["upper"]
    assert area(data, "upper") == pytest.approx(1.0, rel=1e-13)
    assert num_facets(data, "upper/bottom") == 10


def test_reading_a_file_leaves_the_running_gmsh_session_alone(msh_path):
    def build_two():
        two_blocks.build()
        gmsh.write(str(msh_path))
        rings.build()
        gmsh.model.setCurrent("two_blocks")
        gmsh.option.setNumber("General.Verbosity", 0)  # terminal on, but silent
        gmsh.option.setNumber("General.Terminal", 1)

    def state():
        terminal = gmsh.option.getNumber("General.Terminal")
        return gmsh.model.getCurrent(), gmsh.model.list(), gmsh.model.getEntities(), terminal

    on_root(build_two)
    before = on_root(state)
    read_gmsh(msh_path, COMM)
    assert COMM.bcast(before == on_root(state))


def test_reading_a_file_needs_no_gmsh_session_and_leaves_none(msh_path):
    on_root(two_blocks.build)
    on_root(gmsh.write, str(msh_path))
    on_root(gmsh.finalize)
    data = read_gmsh(str(msh_path), COMM)
    running = compat.gmsh_is_initialized(gmsh)
    on_root(gmsh.initialize)  # for the fixture
    assert not COMM.bcast(running)
    assert area(data, "lower") == pytest.approx(2.2, rel=1e-13)


def test_last_rank_can_read(msh_path):
    on_root(two_blocks.build)
    on_root(gmsh.write, str(msh_path))
    COMM.barrier()
    data = read_gmsh(msh_path if COMM.rank == COMM.size - 1 else None, COMM, rank=COMM.size - 1)
    assert area(data, "lower") == pytest.approx(2.2, rel=1e-13)


# Errors


def plate(*, order=1, mesh=True, groups=True, dim=2, z=0.0, nan=False):
    """Build a plate that lacks something."""
    gmsh.model.add("plate")
    occ, model = gmsh.model.occ, gmsh.model
    occ.addRectangle(0, 0, 0, 1, 1) if dim == 2 else occ.addBox(0, 0, 0, 1, 1, 1)
    occ.rotate(occ.getEntities(dim), 0, 0, 0, 1, 0, 0, z)
    occ.synchronize()
    if groups:
        for _, surface in model.getEntities(2):
            model.setPhysicalName(2, model.addPhysicalGroup(2, [surface]), f"body {surface}")
    if mesh:
        model.mesh.generate(dim)
    if nan:
        model.mesh.setNode(2, [np.nan, 0.0, 0.0], [])
    return model


def with_second_group(dim):
    model = plate()
    for name in ("first", "second"):
        model.setPhysicalName(dim, model.addPhysicalGroup(dim, [1]), name)
    return model


def with_untagged_surface():
    model = plate(mesh=False)
    model.occ.addRectangle(2, 0, 0, 1, 1)
    model.occ.synchronize()
    model.mesh.generate(2)
    return model


def with_mixed_cells():
    model = two_blocks.build(cell="triangle")
    model.mesh.setRecombine(2, 1)
    model.mesh.clear()
    model.mesh.generate(2)
    return model


def with_serendipity_cells():
    model = two_blocks.build()
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
    model.mesh.setOrder(2)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
    return model


def with_curve_without_mesh():
    model = plate()
    occ = model.occ
    line = occ.addLine(occ.addPoint(2, 0, 0), occ.addPoint(3, 0, 0))
    occ.synchronize()
    model.setPhysicalName(1, model.addPhysicalGroup(1, [line]), "later")
    return model


@pytest.mark.parametrize(
    ("build", "match"),
    (
        (lambda: plate(groups=False), "surface 1 is in no physical group"),
        (lambda: plate(mesh=False), r"no elements of dimension 2; was .*generate\(2\)"),
        (lambda: plate(dim=3), "elements of dimension 3"),
        (lambda: plate(z=0.1), "z varies by 0.0998"),
        (lambda: plate(nan=True), "coordinates of 1 nodes are not finite, e.g. of node 2"),
        (lambda: with_second_group(2), r"surface 1 is in the physical groups \['body 1', 'first'"),
        (lambda: with_second_group(1), r"curve 1 is in the physical groups \['first', 'second'\]"),
        (with_untagged_surface, "surface 2 is in no physical group"),
        (with_curve_without_mesh, r"curve \d of physical group \['later'\] has no elements"),
        (with_mixed_cells, r"mixes \['Quadrilateral 4', 'Triangle 3'\]"),
        (with_serendipity_cells, r"type \['Quadrilateral 8'\] are not supported"),
        (lambda: None, "source is None; expected"),
        (lambda: 3.5, "source is 3.5; expected"),
        (lambda: "nowhere.msh", "no file 'nowhere.msh'"),
    ),
    ids=lambda value: value.replace(" ", "_")[:30] if isinstance(value, str) else "",
)
def test_what_cannot_be_read_raises_on_all_ranks(build, match):
    raises_on_all_ranks(match, read, build)


def test_file_of_something_else_raises_on_all_ranks(msh_path):
    on_root(msh_path.write_text, "$MeshFormat\nno mesh at all\n")
    raises_on_all_ranks("mesh.msh|no elements", read_gmsh, msh_path, COMM)


def test_file_with_one_name_twice_raises_on_all_ranks(msh_path):
    """gmsh's own sessions drop the second name, but files can hold it."""

    def write():
        two_blocks.build()
        gmsh.write(str(msh_path))
        msh_path.write_text(msh_path.read_text().replace("upper/left", "upper/right"))

    on_root(write)
    match = r"the physical groups \d+ and \d+ have the same name 'upper/right'"
    raises_on_all_ranks(match, read_gmsh, msh_path, COMM)


def test_missing_gmsh_raises_on_all_ranks(msh_path, monkeypatch):
    on_root(msh_path.write_text, "")
    with monkeypatch.context() as patch:
        patch.setitem(__import__("sys").modules, "gmsh", None)
        raises_on_all_ranks("the Python module gmsh is needed", read_gmsh, msh_path, COMM)


def test_rank_that_does_not_exist_cannot_read():
    raises_on_all_ranks(f"ranks 0 to {COMM.size - 1}", read_gmsh, None, COMM, rank=COMM.size)


# Boundary conditions


@pytest.fixture
def blocks():
    return read(two_blocks.build, n_upper=3, n_lower=4, layers_upper=2, layers_lower=2)


def prescribed(V, bc, untouched=7.0):
    """Set a boundary condition in a function; return x and u of the owned nodes of all ranks."""
    u = fem.Function(V)
    u.x.array[:] = untouched
    compat.set_prescribed(u.x.array, [bc])
    u.x.scatter_forward()
    owned = V.dofmap.index_map.size_local
    x = V.tabulate_dof_coordinates()[:owned, :2]
    rows = gathered(np.hstack([x, u.x.array.reshape(-1, 2)[:owned]]))
    return rows[:, :2], rows[:, 2:]


@pytest.mark.parametrize("degree", (1, 2))
def test_later_change_of_a_constant_acts(blocks, degree):
    V = compat.vector_space(blocks.mesh, degree)
    value = fem.Constant(blocks.mesh, PETSc.ScalarType((1.0, 2.0)))
    bc = dirichlet(V, blocks, "upper/top", value)
    value.value[1] = -3.0
    x, u = prescribed(V, bc)
    top = np.isclose(x[:, 1], 2.0)
    assert top.sum() == 3 * degree + 1
    assert (u[top] == (1.0, -3.0)).all() and (u[~top] == 7.0).all()


@pytest.mark.parametrize("component", (0, 1))
@pytest.mark.parametrize("constant", (False, True))
def test_one_component_leaves_the_other_free(blocks, component, constant):
    V = compat.vector_space(blocks.mesh, 1)
    value = fem.Constant(blocks.mesh, PETSc.ScalarType(0.0)) if constant else 0.5
    bc = dirichlet(V, blocks, "lower/bottom", value, component)
    if constant:
        value.value = 0.5
    x, u = prescribed(V, bc)
    bottom = np.isclose(x[:, 1], 0.0)
    assert (u[bottom, component] == 0.5).all() and (u[~bottom] == 7.0).all()
    assert (u[:, 1 - component] == 7.0).all()


def test_function_is_taken_node_by_node(blocks):
    V = compat.vector_space(blocks.mesh, 1)
    value = fem.Function(V)
    bc = dirichlet(V, blocks, "lower/left", value)
    value.interpolate(lambda x: x[:2] + 1.0)
    x, u = prescribed(V, bc)
    left = np.isclose(x[:, 0], 0.0)
    assert np.allclose(u[left], x[left] + 1.0) and (u[~left] == 7.0).all()


def test_several_boundaries_make_one_condition(blocks):
    V = compat.vector_space(blocks.mesh, 1)
    names = ["lower/left", blocks.boundary_tag("lower/right"), "lower/left"]
    x, u = prescribed(V, dirichlet(V, blocks, names, (0, 1)))
    sides = np.isclose(x[:, 0], 0.0) | np.isclose(x[:, 0], 2.2)
    assert sides.sum() == 6
    assert (u[sides] == (0, 1)).all() and (u[~sides] == 7.0).all()


def test_condition_needs_no_connectivity_made_before():
    x = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    own = slice(None) if COMM.rank == 0 else slice(0, 0)
    mesh = compat.create_mesh(COMM, np.arange(3).reshape(1, 3)[own], x[own], "triangle")
    mesh.topology.create_entities(1)
    facets = np.arange(mesh.topology.index_map(1).size_local, dtype=np.int32)
    data = MeshData(mesh, None, dmesh.meshtags(mesh, 1, facets, np.full_like(facets, 4)))
    V = compat.vector_space(mesh, 1)
    assert (prescribed(V, dirichlet(V, data, 4, (1.0, 2.0)))[1] == (1.0, 2.0)).all()


def test_condition_on_an_empty_boundary_raises_on_all_ranks(blocks):
    V = compat.vector_space(blocks.mesh, 1)
    match = r"boundary 99 has no facets; the mesh has \['lower/bottom',"
    raises_on_all_ranks(match, dirichlet, V, blocks, 99, (0.0, 0.0))
    raises_on_all_ranks("no boundary 'top'", dirichlet, V, blocks, "top", (0.0, 0.0))
    raises_on_all_ranks("no boundary is given", dirichlet, V, blocks, [], (0.0, 0.0))


def test_value_that_does_not_fit_raises_on_all_ranks(blocks):
    V, W = (compat.vector_space(blocks.mesh, 1) for _ in range(2))
    scalar = fem.Constant(blocks.mesh, PETSc.ScalarType(0.0))

    def raises(match, *args):
        raises_on_all_ranks(match, dirichlet, V, blocks, "lower/left", *args)

    raises(r"shape \(\); expected \(2,\)", 0.0)
    raises(r"shape \(\); expected \(2,\)", scalar)
    raises(r"shape \(2,\); expected \(\)", (0.0, 0.0), 1)
    raises("component is 2; expected 0, 1 or None", 0.0, 2)
    raises("belong to the same space", fem.Function(W))
    raises("prescribes both components", fem.Function(V), 0)


def test_space_that_does_not_fit_raises_on_all_ranks(blocks):
    other = compat.vector_space(read(two_blocks.build).mesh, 1)
    mixed = compat.mixed_space(blocks.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    for space, match in ((other, "another mesh"), (mixed, r"take W.sub\(0\)")):
        raises_on_all_ranks(match, dirichlet, space, blocks, "lower/left", (0.0, 0.0))


# The scripts of meshes/


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
    slant = 1.0 / np.cos(inclination)
    lengths = {
        "upper/bottom": slant,
        "upper/top": 1.0,
        "upper/left": 0.8 + 0.5 * np.tan(inclination),
        "lower/bottom": 2.2,
        "lower/top": 2.2 * slant,
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


def test_nodes_of_rings_are_at_the_angles_asked_for():
    angles = np.array([0.1, 0.5, 1.5, 2.0, 3.9, 5.5])
    data = read(rings.build, angles_inner=angles)
    x, y = nodes_on(data, "inner/outside").T
    assert np.sort(np.arctan2(y, x) % (2 * np.pi)) == pytest.approx(angles, abs=1e-15)


def test_indenter_has_the_size_and_place_of_shallow_ironing():
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


@pytest.mark.parametrize(
    ("build", "options"),
    (
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
def test_scripts_refuse_what_they_cannot_build(build, options):
    if COMM.rank == 0:
        with pytest.raises(ValueError, match=r"right is|expected|cannot|only|have to"):
            build(**options)


def test_half_cylinder_has_no_triangles_where_gmsh_alone_would_leave_some():
    build = half_cylinder_on_block.build
    data = read(build, cell="quadrilateral", h=0.15, growth=0.05)
    assert compat.cell_name(data.mesh) == "quadrilateral"
