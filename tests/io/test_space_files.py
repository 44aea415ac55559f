# SPDX-License-Identifier: MIT
"""Files and pictures of solids, and states that continue in another run."""

from io import BytesIO

import meshio
import numpy as np
import pytest
from mesh_measures import COMM
from space_scenes import EACH_CELL, SIZE, held, pressed, solid
from test_results import steps

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.io import solids
from fenics_mortar.io.paraview import outline
from fenics_mortar.io.solids import rings_of_skin
from fenics_mortar.utils import compat

EACH = pytest.mark.parametrize("cell, order", EACH_CELL)
TYPES = {
    ("tetrahedron", 1): "tetra",
    ("tetrahedron", 2): "tetra10",
    ("hexahedron", 1): "hexahedron",
    ("hexahedron", 2): "hexahedron27",
}
A = np.array([[0.1, 0.2, 0.0], [-0.1, 0.3, 0.05], [0.0, 0.2, -0.2]])


@pytest.mark.each
@EACH
def test_files_contain_cells_and_fields(shared_path, cell, order):
    scene = pressed(cell, order, jiggle=0.2 if order == 1 else 0.0).set_up()
    scene.u.interpolate(lambda x: A @ x)
    V = compat.scalar_space(scene.data.mesh, 1)
    height = fem.Function(V)
    height.interpolate(lambda x: x[2])
    fields = {"gradient": ufl.grad(scene.u), "first": scene.u[0], "height": height}
    with fm.ResultsWriter(shared_path / "solid", scene.problem, fields) as results:
        results.write(0.5)
    files = steps(shared_path / "solid.pvd")
    assert list(files) == [0.5]
    volume, count = 0.0, 0
    for mesh in map(meshio.read, files[0.5]):
        (block,) = mesh.cells
        assert block.type == TYPES[cell, order]
        x, cells = mesh.points, block.data
        assert np.allclose(mesh.point_data["displacement"], x @ A.T, atol=1e-14)
        assert np.allclose(mesh.point_data["height"], x[:, 2], atol=1e-14)
        assert np.allclose(mesh.cell_data["gradient"][0].reshape(-1, 3, 3), A, atol=1e-12)
        middles = x[cells].mean(axis=1)
        if order == 1:
            assert np.allclose(mesh.cell_data["first"][0].ravel(), middles @ A[0], atol=1e-12)
        corners = {"tetrahedron": 4, "hexahedron": 8}[cell]
        if order == 2:  # VTK has the middles of the edges of the base first
            base = cells[:, : 3 if corners == 4 else 4]
            edges = 0.5 * (x[base] + x[np.roll(base, -1, axis=1)])
            middle = x[cells[:, corners : corners + base.shape[1]]]
            assert np.allclose(middle, edges, atol=1e-12)
        tetrahedra = [[0, 1, 2, 3]]
        if corners == 8:  # the volume of straight cells, from six tetrahedra
            tetrahedra = [[0, a, b, 6] for a, b in ((1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1))]
        for one in tetrahedra:
            edge = x[cells[:, one[1:]]] - x[cells[:, one[:1]]]
            volume += np.abs(np.linalg.det(edge)).sum() / 6.0
        count += len(cells)
    assert count == scene.data.mesh.topology.index_map(3).size_global
    assert volume == pytest.approx(SIZE.prod(), rel=0.02 if cell == "hexahedron" else 1e-12)


@EACH
def test_skin_covers_the_outside_once(cell, order):
    """Polygons of the outer facets have the area of a block, seen along each axis twice."""
    scene = solid(cell, order, jiggle=0.0)
    V = scene.u.function_space
    _, rings = rings_of_skin(V)
    X = V.tabulate_dof_coordinates()[rings]
    after = np.roll(X, -1, axis=1)
    areas = 0.5 * np.abs(np.cross(X, after).sum(axis=1)).sum(axis=0)
    found = np.array([COMM.allreduce(area) for area in areas])
    assert np.allclose(found, 2.0 * SIZE[[1, 0, 0]] * SIZE[[2, 2, 1]], rtol=1e-12)
    mean = COMM.allreduce(X.mean(axis=1).sum(axis=0)) / COMM.allreduce(len(X))
    assert np.allclose(mean[:2], SIZE[:2] / 2, rtol=1e-12)


@EACH
def test_plot_draws_solids(shared_path, cell, order):
    from matplotlib import image

    scene = pressed(cell, order).set_up()
    scene.problem.solve()
    options = {"stress": ufl.tr(ufl.grad(scene.u)), "label": "strain", "scale": 1.5}
    fm.plot(scene.problem, shared_path / "solid.png", title="Block", units=("mm", "MPa"), **options)
    COMM.barrier()
    pixels = image.imread(shared_path / "solid.png")[..., :3]
    assert min(pixels.shape[:2]) > 500
    blank = (pixels > 0.99).all(axis=-1).mean()
    assert 0.2 < blank < 0.8
    coloured = np.ptp(pixels, axis=-1) > 0.2
    assert coloured.mean() > 0.05
    fm.plot(scene.problem, shared_path / "grey.png")


def test_plot_draws_into_given_axes(monkeypatch):
    scene = pressed().set_up()
    monkeypatch.setattr(solids, "off_screen", lambda: False)
    axes = own_axes()
    fm.plot(scene.problem, ax=axes, title="One")
    if COMM.rank == 0:
        (bodies,) = axes.collections
        facets = 2 * 3 + 2 * 2 + 3 * 2  # the camera sees three sides
        assert len(bodies.get_facecolor()) == facets
        assert np.allclose(axes.get_xlim(), (0.0, SIZE[0])) and axes.get_title() == "One"


def test_axes_in_the_plane_are_refused_for_solids():
    from matplotlib.figure import Figure

    axes = Figure().add_subplot() if COMM.rank == 0 else None
    with pytest.raises(fm.MortarError, match="projection='3d'"):
        fm.plot(pressed().set_up().problem, ax=axes)


def own_axes(**options):
    """Axes in space on rank 0, ``None`` elsewhere."""
    from matplotlib.figure import Figure

    return Figure().add_subplot(projection="3d", **options) if COMM.rank == 0 else None


def image_of(axes):
    from matplotlib.image import imread

    file = BytesIO()
    axes.figure.savefig(file)
    file.seek(0)
    return imread(file)


BY_PYVISTA = pytest.mark.skipif(
    not solids.off_screen(), reason="pyvista is not installed, or EGL has no device"
)


@BY_PYVISTA
def test_ring_of_the_largest_pressure_where_facets_hide_it():
    scene, found = solid(), []
    plane = fm.Plane((0.5, 0.5, 0.98 * SIZE[2]), (0.0, 0.0, -1.0))
    scene.bcs = [fm.dirichlet(scene.u.function_space, scene.data, "block/bottom", (0.0, 0.0, 0.0))]
    scene.set_up([fm.ContactPair(scene.data, "block/top", plane)])
    scene.problem.solve()
    for elevation in (89.0, -89.0):  # a plane presses on the top
        axes = own_axes(elev=elevation)
        fm.plot(scene.problem, ax=axes)
        if axes is not None:
            image_of(axes)
            found += [axes.lines[0].get_markerfacecolor() == "none"]
    assert found in ([], [False, True])


def test_facets_within_limits_that_the_axes_have():
    scene = pressed().set_up()
    axes = own_axes(xlim=(-0.1, 0.8 * SIZE[0]))
    fm.plot(scene.problem, ax=axes)
    if axes is not None:
        assert np.allclose(axes.get_xlim(), (-0.1, 0.8 * SIZE[0]))
        assert np.allclose(axes.get_ylim(), (0.0, SIZE[1]))
    axes = own_axes()
    for stretch in (1.0, 2.0):  # of a second picture in the same axes
        fm.plot(scene.problem, ax=axes)
        if axes is not None:
            assert np.allclose(axes.get_zlim(), (0.0, stretch * SIZE[2]))
        scene.u.interpolate(lambda x: np.stack([0.0 * x[0], 0.0 * x[1], x[2]]))
    with pytest.raises(fm.MortarError, match="xlim=.*no facet lies within"):
        fm.plot(scene.problem, ax=own_axes(xlim=(50.0, 60.0)))
    with pytest.raises(fm.MortarError, match="inverted"):
        fm.plot(scene.problem, ax=own_axes(zlim=(2.0, -1.0)))


@BY_PYVISTA
@pytest.mark.parametrize("projection", ["ortho", "persp"])
def test_pyvista_has_the_camera_of_the_axes(monkeypatch, projection):
    """The images cover the same pixels, and parts of the bodies have the same colours in them."""
    scene, images = pressed().set_up(), []
    scene.problem.solve()
    for by_pyvista in (True, False):
        monkeypatch.setattr(solids, "off_screen", lambda by=by_pyvista: by)
        axes = own_axes(proj_type=projection)
        fm.plot(scene.problem, stress=ufl.div(scene.u), ax=axes)
        if axes is not None:
            images.append(image_of(axes)[..., :3])
    if COMM.rank == 0:
        one, other = images
        covers = one.min(axis=2) < 0.98, other.min(axis=2) < 0.98
        assert (covers[0] != covers[1]).mean() < 0.01 and 0.1 < covers[1].mean() < 0.9
        assert np.abs(one - other).mean() < 0.02


@EACH
def test_state_continues_in_another_problem(shared_path, cell, order):
    """A state is read into a new problem, and both go on alike."""
    scene, other = pressed(cell, order).set_up(), pressed(cell, order).set_up()
    scene.problem.solve()
    fm.save_state(scene.problem, shared_path / "state")
    fm.load_state(other.problem, shared_path / "state")
    assert np.array_equal(other.u.x.array, scene.u.x.array)
    reactions = [s.problem.reaction("block/top", data=s.data) for s in (scene, other)]
    assert np.allclose(reactions[0].force, reactions[1].force, rtol=1e-12)
    with pytest.raises(fm.MortarError, match="another mesh or degree"):
        fm.load_state(
            pressed(cell, order, counts=(2, 2, 2)).set_up().problem, shared_path / "state"
        )


def test_small_sliding_keeps_its_reference_operators(shared_path):
    """Operators for the place of the obstacle at the set-up of the first run, turned about axes."""
    made = []
    for turn in ((0.0, 0.1, 0.0), (0.3, 0.0, 0.2)):
        scene = solid()
        held(scene)
        ball = fm.Sphere((0.4, 1.1, 2.9), 1.45, pivot=(0.2, 0.8, 2.0))
        ball.move(angle=turn)
        pair = fm.ContactPair(scene.data, "block/top", ball, law=fm.Coulomb(0.3), sliding="small")
        made.append((scene.set_up([pair]).problem, ball))
    (problem, _), (again, _) = made
    problem.solve()
    fm.save_state(problem, shared_path / "state")
    fm.load_state(again, shared_path / "state")
    for one, ball in made:
        ball.move(x=0.02, z=-0.01, angle=(0.02, 0.1, 0.0))
        one.solve()
    z, w = problem.equations.contacts[0].z, again.equations.contacts[0].z
    assert np.abs(z).max() > 0.1 and np.abs(z - w).max() < 1e-9 * np.abs(z).max()


def test_surfaces_of_obstacles_move_with_them(shared_path):
    """Points are on the turned ball up to rounding, its triangles have its area; another is far."""
    ball = fm.Sphere((0.5, 0.4, 0.6), 0.25, pivot=(0.2, 0.8, 0.3), name="ball")
    far = fm.Plane((0.0, 0.1, 9.0), (0.0, 0.0, -1.0), name="far")
    scene = solid()
    held(scene)
    pairs = [fm.ContactPair(scene.data, "block/top", obstacle) for obstacle in (ball, far)]
    problem = scene.set_up(pairs).problem
    with fm.ResultsWriter(shared_path / "tools", problem) as results:
        for time, x in enumerate((0.0, 0.1)):
            ball.move(x=x, y=-0.1 * x, angle=(x, 0.1, 3 * x))
            results.write(time)
    for (file,) in steps(shared_path / "tools.pvd", "obstacles", "ball").values():
        mesh = meshio.read(file)
        corners = mesh.points[mesh.cells_dict["triangle"]]
        assert np.allclose(np.linalg.norm(mesh.points - (0.5, 0.4, 0.6), axis=1), 0.25, atol=1e-8)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(normals, axis=1).sum()
        assert area == pytest.approx(np.pi / 4.0, rel=0.01)
    assert np.allclose(mesh.points + mesh.point_data["displacement"], ball.to_space(mesh.points))
    for (file,) in steps(shared_path / "tools.pvd", "obstacles", "far").values():
        assert np.array_equal(meshio.read(file).points, np.tile([0.0, 0.1, 9.0], (3, 1)))


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
def test_small_obstacles_are_drawn_as_well_as_large_ones(dim):
    """Balls from a quarter to 1e-5 of the box; a thin ring, in the plane its section."""
    low, high = -np.ones(dim), np.arange(1.0, dim + 1.0)
    centre = np.array((0.3, 0.4, -0.2))[:dim]
    for radius in (0.5, 0.01, 2e-5):
        ball = fm.Sphere(centre, radius) if dim == 3 else fm.Circle(centre, radius)
        assert measured(*outline(ball, low, high)[:2]) == pytest.approx(
            np.pi * radius * (4.0 * radius if dim == 3 else 2.0), rel=0.01
        )
    if dim == 3:
        ring = fm.Torus(centre, (0.0, 0.1, 1.0), 0.2, 0.004)
        area = 4.0 * np.pi**2 * 0.2 * 0.004
        assert measured(*outline(ring, low, high)[:2]) == pytest.approx(area, rel=0.03)


def measured(points, parts):
    """Length of segments or area of triangles."""
    ends = points[parts]
    if ends.shape[1] == 2:
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
    normals = np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0])
    return 0.5 * np.linalg.norm(normals, axis=1).sum()


def test_moved_node_of_a_saved_mesh_is_named_with_three_coordinates(shared_path):
    scene = pressed().set_up()
    fm.save_state(scene.problem, shared_path / "state")
    other = solid(jiggle=0.1)
    held(other)
    held(other, (0.1, 0.05, -0.3), "block/top")
    with pytest.raises(fm.MortarError, match=r"its node at \(.*, .*, .*\) is .* away"):
        fm.load_state(other.set_up().problem, shared_path / "state")


def test_table_of_a_problem_without_pairs_has_a_head_only():
    table = fm.contact_table(pressed().set_up().problem)
    assert str(table).count("\n") == 1 and "force on slave" in str(table)


@pytest.mark.each
@EACH
def test_ranks_without_cells_take_part(shared_path, cell, order):
    """A body of one cube of nodes: solve, reactions, files, picture, state."""
    scene = pressed(cell, order, counts=(1, 1, 1), push=(0.0, 0.0, -0.15)).set_up()
    report = scene.problem.solve()
    assert report.certificate.balance < 1e-10
    above, below = (
        scene.problem.reaction(f"block/{s}", data=scene.data) for s in ("top", "bottom")
    )
    assert np.allclose(above.force, -below.force, rtol=1e-10, atol=1e-12)
    with fm.ResultsWriter(shared_path / "one", scene.problem, {"F": ufl.grad(scene.u)}) as results:
        results.write(0.0)
    fm.plot(scene.problem, shared_path / "one", stress=ufl.div(scene.u))
    fm.save_state(scene.problem, shared_path / "one")
    fm.load_state(scene.problem, shared_path / "one")
    assert len(steps(shared_path / "one.pvd")[0.0]) <= COMM.size
