# SPDX-License-Identifier: MIT
"""Bad input: a clear error of the right class on every rank, no hang, and nothing lost.

Every refusal is collective: `refused` fails unless all ranks raise the same error.
"""

import re
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

import gmsh
import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, pair_options, pressed_blocks, read

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from fenics_mortar.interface.surfaces import extract_surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from meshes import two_blocks

COMM = MPI.COMM_WORLD
SMALL = {"n_upper": 4, "n_lower": 6, "layers_upper": 3, "layers_lower": 3}


@contextmanager
def refused(kind, *parts):
    """Check that each rank raises ``kind``, all with one message that has all ``parts``."""
    error = None
    try:
        yield
    except Exception as raised:
        error = raised
    everywhere = COMM.allgather((type(error).__name__, str(error)))
    assert {name for name, _ in everywhere} == {kind.__name__}, everywhere
    assert len(set(everywhere)) == 1, everywhere
    for part in parts:
        assert re.search(part, everywhere[0][1]), everywhere[0][1]


# Meshes from arrays


def mesh_of(cells, x, cell="quadrilateral"):
    """Create a mesh from what rank 0 gives."""
    if COMM.rank:
        cells, x = np.empty((0, np.shape(cells)[1]), int), np.empty((0, 2))
    mesh = compat.create_mesh(COMM, cells, x, cell)
    mesh.topology.create_entities(1)
    return mesh


def tagged(mesh, **boundaries):
    """Tag the facets of which all vertices satisfy a condition; name them in the order given."""
    facets = [dmesh.locate_entities(mesh, 1, where) for where in boundaries.values()]
    return tagged_facets(mesh, dict(zip(boundaries, facets, strict=True)))


def tagged_facets(mesh, boundaries):
    """Tag and name local facets."""
    facets = np.concatenate([np.empty(0, np.int32), *boundaries.values()]).astype(np.int32)
    sizes = [found.size for found in boundaries.values()]
    tags = np.repeat(np.arange(1, 1 + len(sizes)), sizes).astype(np.int32)
    order = np.argsort(facets, kind="stable")
    facet_tags = dmesh.meshtags(mesh, 1, facets[order], tags[order])
    return fm.MeshData(mesh, None, facet_tags, {}, dict(zip(boundaries, range(1, 9), strict=False)))


def grid(nx, ny, corner=(0.0, 0.0), size=(1.0, 1.0), first=0):
    """Quadrilaterals and nodes of a rectangle; nodes are numbered from ``first`` on."""
    X, Y = np.meshgrid(np.linspace(0, 1, nx + 1), np.linspace(0, 1, ny + 1))
    x = np.array(corner) + np.stack([X.ravel(), Y.ravel()], axis=1) * size
    i, j = (index.ravel() for index in np.meshgrid(np.arange(nx), np.arange(ny)))
    corners = i + (nx + 1) * j
    return first + np.stack([corners, corners + 1, corners + nx + 1, corners + nx + 2], axis=1), x


def triangles(cells):
    """Two triangles of each quadrilateral."""
    return np.concatenate([cells[:, [0, 1, 3]], cells[:, [0, 3, 2]]])


def blocks_of_arrays(cell="quadrilateral", turn=False):
    """Two blocks that touch at y = 1; ``turn`` gives every cell negative orientation."""
    lower, x = grid(4, 3, (0.0, 0.0), (2.0, 1.0))
    upper, y = grid(3, 3, (0.4, 1.5), (1.0, 1.0), first=len(x))
    cells = np.concatenate([lower, upper])
    cells = triangles(cells) if cell == "triangle" else cells
    if turn:
        cells = cells[:, [0, 2, 1] if cell == "triangle" else [1, 0, 3, 2]]
    mesh = mesh_of(cells, np.concatenate([x, y]), cell)
    places = {"base": 0.0, "master": 1.0, "slave": 1.5, "top": 2.5}
    data = tagged(mesh, **{k: lambda x, y=y: np.isclose(x[1], y) for k, y in places.items()})
    moved = mesh.geometry.x
    moved[moved[:, 1] > 1.25, 1] -= 0.5
    return data


def problem_on(data, pairs=None, material=neo_hookean, u=None, **options):
    """Contact of the boundaries ``slave`` and ``master``, without Dirichlet conditions."""
    u = fem.Function(fm.vector_space(data.mesh, 1)) if u is None else u
    pairs = [fm.ContactPair(data, "slave", "master")] if pairs is None else pairs
    options = {"petsc_options_prefix": "test_errors_", **options}
    return fm.ContactProblem(internal(u, material(u, 100.0, 0.3)), u, pairs, **options)


def surface_of(data, name):
    V = fm.vector_space(data.mesh, 1)
    return extract_surface(DisplacementSpace(V), data.facet_tags, data.boundary_tag(name), name)


def small_blocks(**options):
    return pressed_blocks(**SMALL, **options)


# Names and tags


def test_unknown_name_of_a_side_lists_the_known_ones():
    data = read(two_blocks.build, **SMALL)
    with refused(fm.MeshError, "no boundary 'punch'", "lower/bottom.*upper/top"):
        fm.ContactPair(data, "punch", "lower/top")
    with refused(fm.MeshError, "no boundary 'anvil'", "lower/bottom.*upper/top"):
        fm.ContactPair(data, "upper/bottom", "anvil")


@pytest.mark.parametrize("name", [None, ["upper/bottom"], 1.5])
def test_what_is_no_name_is_refused_as_unknown(name):
    data = read(two_blocks.build, **SMALL)
    with refused(fm.MeshError, re.escape(f"no boundary {name!r}"), "upper/bottom"):
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
    with refused(fm.SurfaceError, "'upper/bottom'.* share 5 nodes, one at", "different surfaces"):
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
        with refused(fm.SurfaceError, where, "one name"):
            problem_on(data, pairs)


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


@pytest.mark.ranks
@pytest.mark.parametrize("tagged_by", ["both ranks", "owner", "the other"])
def test_facets_between_two_ranks_are_known_to_be_inside(tagged_by):
    """Without ghost cells (dolfinx 0.9) a rank sees only one cell of such a facet."""
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

    If the corner lies between ranks, dolfinx makes two nodes of it, without a word.
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


# Numbers that are not finite


def test_mesh_with_a_coordinate_that_is_not_finite_is_refused():
    cells, x = grid(6, 6)
    x[24] = np.nan  # inside
    data = tagged(mesh_of(cells, x), slave=lambda x: x[1] > 0.9, master=lambda x: x[1] < 0.1)
    with refused(fm.MeshError, "coordinates of 1 nodes are not finite", "node 24"):
        problem_on(data)


def test_cell_without_area_is_named():
    cells, x = grid(4, 4)
    x[12] = x[6]  # in the middle: one of the triangles becomes a line
    data = tagged(
        mesh_of(triangles(cells), x, "triangle"),
        slave=lambda x: x[1] > 0.9,
        master=lambda x: x[1] < 0.1,
    )
    with refused(fm.MeshError, r"cells have no area, one at \(0.\d+, 0.\d+\)"):
        problem_on(data)


def test_displacement_that_is_not_finite_is_refused_by_problem_and_solve():
    scene = small_blocks()
    scene.loads["push"].value[1] = -0.01
    u = scene.u.x.array
    u[: 2 if COMM.rank == COMM.size - 1 else 0] = np.nan
    with refused(fm.MortarError, "displacement is not finite at 1 nodes, one at", "reset"):
        scene.problem.solve()
    with refused(fm.MortarError, "displacement is not finite at 1 nodes, one at", "reset"):
        problem_on(scene.data, [scene.contact.pair], u=scene.u)
    u[:] = 0.0
    assert scene.problem.solve().converged


def test_mesh_that_was_moved_after_set_up_is_refused():
    scene = small_blocks()
    scene.loads["push"].value[1] = -0.01
    nodes = scene.data.mesh.geometry.x
    kept = nodes.copy()
    nodes[: 1 if COMM.rank == COMM.size - 1 else 0, 0] += 1e-3
    with refused(fm.MortarError, "the mesh was moved after the problem was set up", "new problem"):
        scene.problem.solve()
    nodes[:] = kept
    assert scene.problem.solve().converged


def test_load_that_is_not_finite_is_named():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V, v = u.function_space, ufl.TestFunction(u.function_space)
    traction = fem.Constant(data.mesh, (0.0, 0.0))
    weight = fem.Function(V)
    value = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "base", value), fm.dirichlet(V, data, "top", (0.0, -0.01))]
    load = ufl.inner(traction, v) * ufl.ds + ufl.inner(weight, v) * ufl.dx
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)) - load,
        u,
        [fm.ContactPair(data, "slave", "master")],
        bcs=bcs,
        petsc_options_prefix="test_errors_",
    )
    traction.value[1] = np.nan
    with refused(fm.MortarError, r"a constant of the residual is \[ ?0. +nan\]"):
        problem.solve()
    if COMM.size > 1:
        traction.value[1] = 0.1 if COMM.rank == 0 else 0.0
        where = f"0.1 on rank 0 and 0 on rank {min(COMM.size - 1, 1)}"
        with refused(fm.MortarError, f"a constant of the residual is {where}"):
            problem.solve()
    traction.value[1] = 0.0
    weight.name = "weight"
    weight.x.array[: 2 if COMM.rank == COMM.size - 1 else 0] = np.inf
    with refused(fm.MortarError, "function 'weight' of the residual is not finite"):
        problem.solve()
    weight.x.array[:] = 0.0
    value.value[0] = np.nan
    with refused(fm.MortarError, r"prescribed displacement is not finite at 5 nodes, one at \("):
        problem.solve()
    value.value[0] = 0.0
    assert problem.solve().converged


@pytest.mark.parametrize(
    ("offset", "message"),
    [
        (0.01, r"shape \(\), type float64: .*shape \(5,\)"),
        ([0.01], r"shape \(1,\), type float64"),
        ([[0.0, 0.0]] * 5, r"shape \(5, 2\), type float64"),
        ([1j] * 5, r"shape \(5,\), type complex128: expected finite lengths"),
        ([0.0, 0.0, np.nan, 0.0, 0.0], r"offset\[2\]=nan: expected finite lengths of shape \(5,\)"),
        ([0.0, 0.0, 0.0, 0.0, -np.inf], r"offset\[4\]=-inf: expected finite lengths"),
    ],
)
def test_offset_that_is_refused_says_what_is_allowed_and_leaves_the_old_one(offset, message):
    contact = small_blocks().contact
    before = contact.offset
    with refused(ValueError, message):
        contact.offset = offset
    assert contact.offset is before
    contact.offset = list(range(5))
    assert contact.offset.dtype == float and contact.offset[4] == 4.0


def test_offset_that_is_not_finite_since_it_was_set_is_refused_by_solve():
    scene = small_blocks()
    with refused(ValueError, "read-only"):
        scene.contact.offset[3] = np.nan
    scene.contact.change(offset=np.full(scene.contact.slave.num_nodes, np.nan))
    with refused(ValueError, r"offset of 'upper/bottom'\[0\]=nan: expected finite lengths"):
        scene.problem.solve()


@pytest.mark.ranks
@pytest.mark.parametrize(
    "what", ["offset of", "a prescribed displacement", "place of", "push of", "nan in offset of"]
)
def test_input_that_differs_on_one_rank_is_refused_by_all(what):
    """Each rank would go its own way, and the run hang or end in MPI."""
    wrong = float(COMM.rank == COMM.size - 1)
    if what in ("place of", "push of"):
        data = blocks_of_arrays()
        u, circle = fem.Function(fm.vector_space(data.mesh, 1)), fm.Circle((0.9, 4.0), 1.5)
        bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))]
        problem = problem_on(data, [fm.ContactPair(data, "top", circle)], bcs=bcs, u=u)
        circle.move(y=-0.01 * wrong) if what == "place of" else circle.push(y=-1.0 - wrong)
    else:
        scene = small_blocks()
        problem, contact = scene.problem, scene.contact
        if what == "a prescribed displacement":
            scene.loads["push"].value[1] = -0.01 * wrong
        elif wrong:
            contact.change(offset=np.full(5, 0.01 if what == "offset of" else np.nan))
    last = COMM.size - 1
    with refused(fm.MortarError, what.removeprefix("nan in "), f"on rank 0 and .* on rank {last}"):
        problem.solve()


def test_distance_that_raises_on_one_rank_raises_on_all():
    """Nodes are known on all ranks, integration points are shared out."""
    fails = []

    def plane(x):
        if fails and len(x) != 5:
            raise ZeroDivisionError("no distance here")
        return 1.01 - x[:, 1], np.tile((0.0, -1.0), (len(x), 1)), np.zeros((len(x), 2, 2))

    data = blocks_of_arrays()
    u, solid = fem.Function(fm.vector_space(data.mesh, 1)), fm.SignedDistance(plane, name="lid")
    bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))]
    pair = fm.ContactPair(
        data, "master", solid, **pair_options(points=6)
    )  # on 1 to 4 facets, with 5 nodes
    problem = problem_on(data, [pair], bcs=bcs, u=u)
    problem.solve()
    last = COMM.size - 1
    fails += [True] if COMM.rank == last else []
    kind, words = (
        (ZeroDivisionError, "^no distance here")
        if COMM.rank == last
        else (fm.MortarError, f"distance of 'lid' raised on rank {last}: ZeroDivisionError: no dis")
    )
    with pytest.raises(kind, match=words):
        problem.solve()
    fails.clear()
    assert problem.solve().converged


def test_material_parameter_that_is_not_finite_on_one_rank_is_named():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    E = fem.Function(compat.scalar_space(data.mesh, 0, "DG"), name="stiffness")
    E.x.array[:] = 100.0
    E.x.array[: 1 if COMM.rank == 0 else 0] = np.nan
    with refused(fm.MortarError, "function 'stiffness' of the residual is not finite"):
        fm.ContactProblem(
            internal(u, neo_hookean(u, E, 0.3)),
            u,
            [fm.ContactPair(data, "slave", "master")],
            petsc_options_prefix="test_errors_",
        )


# Platform, mesh and space


def test_complex_petsc_is_refused(monkeypatch):
    monkeypatch.setattr(compat, "scalar_is_complex", lambda: True)
    with refused(fm.MortarError, "complex scalars", "real scalars"):
        small_blocks()


def test_mesh_in_space_is_refused():
    mesh = dmesh.create_unit_cube(COMM, 2, 2, 2)
    mesh.topology.create_entities(2)
    facets = dmesh.locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[0], 0.0))
    tags = dmesh.meshtags(mesh, 2, np.sort(facets), np.ones(facets.size, np.int32))
    data = fm.MeshData(mesh, None, tags, {}, {"slave": 1, "master": 1})
    u = fem.Function(fm.vector_space(mesh, 1))
    with refused(fm.MeshError, "dimension 3", "plane bodies"):
        problem_on(data, u=u, material=lambda u, E, nu: ufl.grad(u))


@pytest.mark.parametrize("space", ["P3", "scalar", "DG 1", "DG 2", "CR 1"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_space_other_than_plane_vectors_of_degree_one_or_two_is_refused(space, cell):
    data = blocks_of_arrays(cell)
    mesh = data.mesh
    if space.startswith("P"):
        V = fm.vector_space(mesh, int(space[1]))
    elif space == "scalar":
        V = compat.scalar_space(mesh, 1)
    elif cell == "quadrilateral" and space == "CR 1":
        pytest.skip("no such element")
    else:
        V = vectors_of(mesh, *space.split())
    u = fem.Function(V)
    residual = ufl.inner(ufl.grad(u), ufl.grad(ufl.TestFunction(V))) * ufl.dx
    pair = fm.ContactPair(data, "slave", "master")
    with refused(fm.MortarError, r"vector_space\(mesh, 1\) or vector_space\(mesh, 2\)"):
        fm.ContactProblem(residual, u, [pair], petsc_options_prefix="test_errors_")


def vectors_of(mesh, family, degree):
    """A space of plane vectors that is not Lagrange's."""
    if hasattr(ufl, "VectorElement"):
        return fem.FunctionSpace(mesh, ufl.VectorElement(family, mesh.ufl_cell(), int(degree)))
    return fem.functionspace(mesh, (family, int(degree), (2,)))


def test_curved_cells_are_refused():
    def build():
        model = two_blocks.build(**SMALL)
        model.mesh.setOrder(2)
        return model

    data = read(build)
    with refused(fm.MeshError, "curved cells", "first order"):
        problem_on(data, [fm.ContactPair(data, "upper/bottom", "lower/top")])


def test_pair_on_another_mesh_is_refused():
    one, other = blocks_of_arrays(), blocks_of_arrays()
    with refused(fm.MeshError, "'slave' - 'master' belongs to another mesh"):
        problem_on(one, [fm.ContactPair(other, "slave", "master")])


@pytest.mark.parametrize("case", ["mesh", "degree"])
def test_dirichlet_condition_of_another_space_is_refused(case):
    data, other = blocks_of_arrays(), blocks_of_arrays()
    V = fm.vector_space(other.mesh, 1) if case == "mesh" else fm.vector_space(data.mesh, 2)
    bc = fm.dirichlet(V, other if case == "mesh" else data, "base", (0.0, 0.0))
    with refused(fm.MortarError, "Dirichlet condition 0 belongs to another space", "space of u"):
        problem_on(data, bcs=[bc])


# Bodies that are not held


def pushed_block(*, gap=0.0, pin=(), load=-1.0, algorithm=None):
    """Upper block under a traction, without Dirichlet conditions but those of a corner."""
    data = read(two_blocks.build, **SMALL, gap=gap)
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    ds = ufl.Measure("ds", domain=data.mesh, subdomain_data=data.facet_tags)
    traction = fem.Constant(data.mesh, (0.0, load))
    work = ufl.inner(traction, v) * ds(data.boundaries["upper/top"])
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    data.mesh.topology.create_connectivity(0, 2)
    corner = dmesh.locate_entities(
        data.mesh, 0, lambda x: np.isclose(x[0], 0.6) & np.isclose(x[1], 2.0 + gap)
    )
    for component in pin:
        dofs = fem.locate_dofs_topological(V.sub(component), 0, corner)
        bcs.append(fem.dirichletbc(PETSc.ScalarType(0.0), dofs, V.sub(component)))
    return fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)) - work,
        u,
        [fm.ContactPair(data, "upper/bottom", "lower/top")],
        bcs=bcs,
        algorithm=algorithm,
        petsc_options_prefix="test_errors_",
    )


def test_body_that_loads_pull_off_is_named_with_its_motion():
    problem = pushed_block(load=1.0)
    with refused(fm.NotConvergedError, r"body 'upper' can (move|rotate) .* freely", "stop"):
        problem.solve()


def test_body_is_described_by_its_place_where_there_are_no_names():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bcs = [fm.dirichlet(u.function_space, data, "base", (0.0, 0.01))]
    problem = problem_on(data, u=u, bcs=bcs)
    with refused(
        fm.MortarError, r"body around \(0.9, 1.5\) can move along \(0, 1\) freely", "pushed"
    ):
        problem.solve()


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_contact_alone_holds_a_body_that_touches(algorithm):
    """Nodes that touch are active from the start; only sliding along is held by a condition."""
    problem = pushed_block(pin=(0,), algorithm=algorithm)
    assert problem.solve().converged
    assert problem.equations.contacts[0].total_force[1] == pytest.approx(1.0, rel=1e-8)


# Singular systems


def test_body_without_stiffness_is_refused():
    data = read(two_blocks.build, **SMALL)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V, stress = u.function_space, linear_elastic(u, 100.0, 0.3)
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    work = ufl.inner(stress, ufl.grad(ufl.TestFunction(V)))
    residual = work * dx(data.bodies["lower"])
    bcs = [fm.dirichlet(V, data, b, (0.0, 0.0)) for b in ("lower/bottom", "upper/top")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    with refused(fm.MortarError, r"no stiffness at 15 nodes, one at \(.*\), of body 'upper'"):
        fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="test_errors_")


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_singular_system_is_reported_and_can_be_mended(algorithm):
    data = read(two_blocks.build, **SMALL)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    V, E = u.function_space, fem.Constant(data.mesh, 100.0)
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    stiff, soft = (
        ufl.inner(linear_elastic(u, modulus, 0.3), ufl.grad(ufl.TestFunction(V)))
        for modulus in (100.0, E)
    )
    residual = stiff * dx(data.bodies["lower"]) + soft * dx(data.bodies["upper"])
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(V, data, "upper/top", (0.0, -0.01))]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=bcs, algorithm=algorithm, petsc_options_prefix="test_errors_"
    )
    E.value = 0.0
    with refused(fm.NotConvergedError, "iteration 1: .*singular"):
        problem.solve()
    E.value = 100.0
    assert problem.solve().converged


# No convergence


def failure(problem):
    """Solve, and return the record of the failure."""
    with pytest.raises(fm.NotConvergedError) as caught:
        problem.solve()
    return caught.value.report


def assert_nothing_lost(problem, report):
    """The record so far, the displacement and the multipliers can be looked at."""
    assert not report.converged
    assert len(report.iterations) >= 1
    assert report.reason in report.table()
    assert len(set(COMM.allgather(repr(report.residuals)))) == 1
    for contact in problem.equations.contacts:
        assert contact.z.shape == (contact.slave.num_nodes, 2)
        assert contact.active_nodes.size <= contact.slave.num_nodes
    assert problem.equations.bulk.inverted_cells()[0] >= 0


def test_too_few_iterations_say_what_is_missing_and_can_be_continued():
    scene = small_blocks(problem={"newton": fm.NewtonOptions(max_iterations=1)})
    scene.loads["push"].value[1] = -0.05
    with refused(fm.NotConvergedError, "not converged in 1 iterations", "residual .*allowed"):
        scene.problem.solve()
    report = failure(scene.problem)
    assert report.num_iterations == 1
    assert_nothing_lost(scene.problem, report)
    scene.problem.newton = fm.NewtonOptions()
    assert scene.problem.solve().converged


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
@pytest.mark.parametrize("material", [neo_hookean, "no logarithm"])
@pytest.mark.parametrize("first", [-0.05, None])
def test_step_too_large_speaks_of_inverted_cells_and_a_smaller_one_is_solved_after_it(
    material, algorithm, first
):
    material = squared_volume if material == "no logarithm" else material
    scene = small_blocks(material=material, problem={"algorithm": algorithm})
    push, contact = scene.loads["push"].value, scene.contact
    if first is not None:
        push[1] = first
        scene.problem.solve()
    u_before = scene.u.x.array.copy()
    push[1] = -5.0
    with refused(fm.NotConvergedError, r"cells (are inverted, one at \(.*\)|would have inverted)"):
        scene.problem.solve()
    scene.u.x.array[:] = u_before
    assert_nothing_lost(scene.problem, failure(scene.problem))
    scene.u.x.array[:] = u_before
    push[1] = -0.08
    assert scene.problem.solve().converged
    again = contact.z.copy()
    fresh = small_blocks(material=material, problem={"algorithm": algorithm})
    fresh.loads["push"].value[1] = -0.08
    assert fresh.problem.solve().converged
    assert np.allclose(again, fresh.contact.z, rtol=1e-8, atol=1e-8 * np.abs(again).max())


def squared_volume(u, E, nu):
    """A law that is finite for inverted cells as well: neo-Hookean with (J - 1)^2."""
    F = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(F)
    return E / 3 * (F - ufl.cofac(F)) + E * (J - 1.0) * ufl.cofac(F)


def test_inverted_cells_are_counted_and_located():
    scene = small_blocks()
    scene.u.interpolate(lambda x: (np.zeros_like(x[0]), -2.0 * x[1]))
    where = r"30 cells are inverted, one at \(0.1\d+, 0.1667\)"
    with refused(fm.NotConvergedError, "iteration 0: .* not finite", where, "smaller load"):
        scene.problem.solve()
    assert_nothing_lost(scene.problem, failure(scene.problem))
    scene.u.x.array[:] = 0.0
    assert scene.problem.solve().converged


def test_inverted_cells_at_the_start_are_named():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    u.interpolate(lambda x: (np.zeros_like(x[0]), -2.0 * x[1]))
    with refused(fm.MortarError, r"21 cells are inverted, one at \(.*\)", "initial displacement"):
        problem_on(data, u=u)


# Options


@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        ({"basis": "quadratic"}, "basis='quadratic': expected one of dual, standard"),
        ({"normals": "none"}, "normals='none': expected one of opposite, unit, own"),
        (
            {"integration": "gauss"},
            "integration='gauss': expected one of segments, elements, nodes",
        ),
        ({"points": 1}, "points=1: .*at least 2 per segment"),
        ({"integration": "elements", "points": 1}, "points=1: .*at least 2 per facet"),
        ({"integration": "nodes", "points": 3}, "points=3 with .*: the points are the nodes"),
        (
            {"integration": "nodes", "basis": "standard"},
            "basis='standard' with integration='nodes': .* expected 'dual'",
        ),
        (
            {"integration": "nodes", "gap_weights": "basis"},
            "gap_weights='basis' with integration='nodes': .* expected 'cover'",
        ),
        (
            {"basis": "standard", "gap_weights": "standard"},
            "gap_weights='standard' with basis='standard': Petrov-Galerkin needs dual",
        ),
        ({"discretization": "4C"}, "discretization='4C': expected one of default, other_codes, "),
        ({"discretization": None}, "discretization=None: expected an instance of Discretization"),
        ({"points": 2.5}, "points=2.5: .*whole number"),
        ({"search_radius": 0.0}, "search_radius=0.0: expected a positive length"),
        ({"search_radius": np.nan}, "search_radius=nan: expected a positive length"),
        ({"max_angle": 90.0}, "max_angle=90.0: expected a number between 0 and 90"),
        ({"c_n": -1.0}, "c_n=-1.0: expected a positive number"),
        ({"c_n": np.inf}, "c_n=inf: expected a positive number"),
        ({"c_n": "1"}, "c_n='1': expected a positive number"),
        ({"search_radius": [1.0]}, r"search_radius=\[1.0\]: expected a positive length"),
        ({"max_angle": None}, "max_angle=None: expected a number between 0 and 90"),
        ({"initial_gap": 1j}, "initial_gap=1j: expected a length"),
        ({"points": True}, "points=True: expected a whole number"),
        ({"law": fm.Coulomb}, "law=.*: expected an instance of Frictionless"),
    ],
)
def test_option_of_a_pair_that_is_refused_says_what_is_allowed(option, allowed):
    data = blocks_of_arrays()
    with refused(ValueError, allowed):
        fm.ContactPair(data, "slave", "master", **pair_options(option))


@pytest.mark.parametrize(
    "kind, options",
    [(fm.ContactPair, {"integration": "elements"}), (fm.ContactPair, {}), (fm.TiedPair, {})],
)
def test_fewer_points_than_nodes_of_a_facet_are_refused(kind, options):
    """Two points do not tell the three functions of a facet apart that has one segment."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 2))
    pair = kind(data, "slave", "master", **pair_options(options, points=2))
    with refused(ValueError, "points=2: .*, 3$"):
        fm.ContactProblem(
            internal(u, neo_hookean(u, 100.0, 0.3)), u, [pair], petsc_options_prefix="test_errors_"
        )


@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        ({"algorithm": "dense"}, "algorithm='dense': expected one of condensed, saddle"),
        (
            {"linearization": "some"},
            "linearization='some': expected one of full, no_normals, no_segments, frozen",
        ),
        ({"pairs": "slave"}, "pairs='slave': .*list of ContactPair"),
        ({"pairs": None}, "pairs=None: .*list of ContactPair"),
        ({"bcs": [0.0]}, r"bcs=\[0.0\]: .*list of Dirichlet"),
        ({"newton": {"max_iterations": 5}}, "newton=.*: expected an instance of NewtonOptions"),
        ({"adequacy": True}, "adequacy=True: expected an instance of AdequacyCheck"),
        ({"petsc_options": "ksp_view"}, "petsc_options='ksp_view': expected a dictionary"),
        ({"jacobian": "exact"}, "jacobian='exact': expected a UFL form"),
        ({"linear_bulk": "yes"}, "linear_bulk='yes': expected True, False or None"),
        ({"algorithm": ["saddle"]}, r"algorithm=\['saddle'\]: expected one of condensed, saddle"),
    ],
)
def test_option_of_a_problem_that_is_refused_says_what_is_allowed(option, allowed):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    options = {"pairs": [fm.ContactPair(data, "slave", "master")], **option}
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    with refused(ValueError, allowed):
        fm.ContactProblem(residual, u, petsc_options_prefix="test_errors_", **options)


def test_a_pair_without_its_list_is_refused():
    data = blocks_of_arrays()
    with refused(ValueError, r"pairs=ContactPair\('slave', 'master'\): .*list of ContactPair"):
        problem_on(data, fm.ContactPair(data, "slave", "master"))


def test_a_condition_without_its_list_is_refused():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bc = fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))
    with refused(ValueError, "bcs is a DirichletBC: .*list of"):
        problem_on(data, u=u, bcs=bc)


@pytest.mark.parametrize("rank", [0, 2])
def test_energies_and_bilinear_forms_are_no_residuals(rank):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    form = ufl.inner(u, u) * ufl.dx(metadata={"quadrature_degree": 2})
    for argument in (ufl.TestFunction, ufl.TrialFunction)[:rank]:
        form = ufl.derivative(form, u, argument(u.function_space))
    pair = fm.ContactPair(data, "slave", "master")
    with refused(ValueError, r"one test function .*ufl.derivative\(energy, u, v\)"):
        fm.ContactProblem(form, u, [pair], petsc_options_prefix="test_errors_")


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_problem_without_pairs_is_solved(algorithm):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    ends = {"base": 0.0, "master": 0.01, "slave": -0.01, "top": 0.0}
    bcs = [fm.dirichlet(u.function_space, data, name, (0.0, y)) for name, y in ends.items()]
    assert problem_on(data, [], u=u, bcs=bcs, algorithm=algorithm).solve().converged


def test_standard_basis_cannot_be_condensed():
    data = blocks_of_arrays()
    pair = fm.ContactPair(data, "slave", "master", **pair_options(basis="standard"))
    with refused(ValueError, "algorithm='condensed'.*not diagonal.*algorithm='saddle'"):
        problem_on(data, [pair], algorithm="condensed")


@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        ({"max_iterations": 0}, "max_iterations=0: expected a whole number, at least 1"),
        ({"residual_tolerance": -1.0}, "residual_tolerance=-1.0: expected a positive number"),
        ({"increment_tolerance": np.nan}, "increment_tolerance=nan: expected a positive number"),
        ({"max_iterations": 2.5}, "max_iterations=2.5: expected a whole number, at least 1"),
        ({"max_motion": "half"}, "max_motion='half': expected a positive number of facets"),
        ({"line_search": "no"}, "line_search='no': expected True or False"),
    ],
)
def test_newton_option_that_is_refused_says_what_is_allowed(option, allowed):
    with refused(ValueError, allowed):
        fm.NewtonOptions(**option)
