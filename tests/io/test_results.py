# SPDX-License-Identifier: MIT
"""Files and tables contain the data of the problem."""

import re
import xml.etree.ElementTree as ET

from mpi4py import MPI

import meshio
import numpy as np
import pytest
import scenes
from heat_scenes import stacked
from test_obstacles import block_under

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.bulk.cells import midpoint_of
from fenics_mortar.io.paraview import ResultsWriter, contact_table
from fenics_mortar.io.picture import plot
from fenics_mortar.utils import compat

COMM = MPI.COMM_WORLD
CELLS = ("triangle", "quadrilateral")
KINDS = {
    ("triangle", 1): "triangle",
    ("triangle", 2): "triangle6",
    ("quad", 1): "quad",
    ("quad", 2): "quad9",
}
FIXED = ("lower/bottom", "upper/top")
SMALL = {"n_upper": 4, "n_lower": 6, "layers_upper": 4, "layers_lower": 3, "gap": 0.01}


def pressed(cell="quadrilateral", **options):
    scene = scenes.pressed_blocks(cell=cell, **SMALL, **options)
    scene.loads["push"].value[:] = (0.02, -0.05)
    return scene


def steps(index, group="bodies", name=None):
    """Times and files of a block of a .pvd, by step; read after all ranks have written."""
    COMM.barrier()
    files = {}
    for entry in ET.parse(index).getroot().iter("DataSet"):
        step = index.parent / entry.get("file")
        (block,) = [b for b in ET.parse(step).getroot().iter("Block") if b.get("name") == group]
        parts = [d for d in block.iter("DataSet") if name in (None, d.get("name"))]
        found = [step.parent / part.get("file") for part in parts]
        files.setdefault(float(entry.get("timestep")), []).extend(found)
    return files


def midpoints(scene):
    """Rows (x, y) of the midpoints of the owned cells."""
    num_cells = scene.data.mesh.topology.index_map(2).size_local
    X = scene.u.function_space.tabulate_dof_coordinates()[:, :2]
    return X[compat.dofmap(scene.u.function_space)[:num_cells]].mean(axis=1)


def table_of(X, values):
    """Values by rounded position: the order of points in files is not that of the mesh."""
    return {tuple(np.round(x[:2], 9) + 0.0): np.asarray(v) for x, v in zip(X, values, strict=True)}


def gathered(X, values):
    branches = COMM.allgather(table_of(X, values))
    return {key: value for branch in branches for key, value in branch.items()}


def assert_equal_tables(found, right):
    assert found.keys() == right.keys()
    for key, value in right.items():
        assert np.array_equal(found[key], value), key


@pytest.mark.each
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_bulk_files_contain_displacement_and_fields_of_every_step(shared_path, cell, degree):
    scene = pressed(cell, degree=degree)
    u, grad = scene.u, ufl.grad(scene.u)
    fields = {
        "det": ufl.det(ufl.Identity(2) + grad),
        "first": grad[0, :],
        "grad": grad,
        "full": ufl.as_tensor([[grad[0, 0], 0, 1], [0, 2, 0], [3, 0, grad[1, 1]]]),
    }
    right = {}
    with ResultsWriter(shared_path / "series", scene.problem, fields) as results:
        for time in (0.0, 0.25):
            results.write(time)
            X = scene.u.function_space.tabulate_dof_coordinates()
            right[time] = gathered(X, np.pad(u.x.array.reshape(-1, 2), ((0, 0), (0, 1))))
            if time == 0.0:
                scene.problem.solve()
    files = steps(shared_path / "series.pvd")
    assert list(files) == [0.0, 0.25]
    V = compat.scalar_space(scene.data.mesh, 0, "DG")
    components = [values_in_cells(V, grad[i, j]) for i in range(2) for j in range(2)]
    for time, branches in files.items():
        meshes = [meshio.read(branch) for branch in branches]
        found = {}
        for mesh in meshes:
            found |= table_of(mesh.points, mesh.point_data["displacement"])
        assert_equal_tables(found, right[time])
        num_cells = sum(len(mesh.cells[0].data) for mesh in meshes)
        assert num_cells == scene.data.mesh.topology.index_map(2).size_global
    # the last step: values at the midpoints of cells, with zeros for the third direction
    right = gathered(midpoints(scene), np.stack(components, axis=1))
    for mesh in meshes:
        kind, corner_count = {"triangle": ("triangle", 3), "quadrilateral": ("quad", 4)}[cell]
        assert mesh.cells[0].type == KINDS[kind, degree]
        found = {name: mesh.cell_data[name][0] for name in fields}
        for i, nodes in enumerate(mesh.cells[0].data):
            corners = mesh.points[nodes[:corner_count], :2]
            after = np.roll(corners, -1, axis=0)
            if degree == 2:  # VTK has the middle of the edge between corners i and i + 1 next
                middles = mesh.points[nodes[corner_count : 2 * corner_count], :2]
                assert np.allclose(middles, 0.5 * (corners + after), atol=1e-12)
            xx, xy, yx, yy = right[tuple(np.round(corners.mean(axis=0), 9) + 0.0)]
            assert np.allclose(found["det"][i], (1 + xx) * (1 + yy) - xy * yx, rtol=1e-12)
            assert np.allclose(found["first"][i], [xx, xy, 0], atol=1e-14)
            assert np.allclose(found["grad"][i], [xx, xy, 0, yx, yy, 0, 0, 0, 0], atol=1e-14)
            assert np.allclose(found["full"][i], [xx, 0, 1, 0, 2, 0, 3, 0, yy], atol=1e-14)
            crosses = corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]
            area = 0.5 * abs(crosses.sum())
            assert area > 0.8 * 0.5 * np.prod(np.ptp(corners, axis=0))  # no bow tie


@pytest.mark.parametrize("cell", CELLS)
def test_functions_of_lagrange_spaces_are_written_at_nodes(shared_path, cell):
    """Parts of mixed functions, too; linear functions are averaged at midpoints of edges."""
    scene = pressed(cell, degree=2)
    mesh = scene.data.mesh
    scalar = fem.Function(compat.scalar_space(mesh, 2))
    scalar.interpolate(lambda x: x[0] ** 2 + x[0] * x[1])
    mixed = fem.Function(fm.mixed_space(mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1)))
    mixed.sub(0).interpolate(lambda x: np.stack([x[0] * x[1], x[1] ** 2]))
    mixed.sub(1).interpolate(lambda x: 3 * x[0] - x[1])
    constant = fem.Function(compat.scalar_space(mesh, 0, "DG"))
    fields = {"s": scalar, "v": mixed.sub(0), "p": mixed.sub(1), "c": constant}
    with ResultsWriter(shared_path / "series", scene.problem, fields) as results:
        results.write(0.0)
        scalar.x.array[:] *= 2.0
        results.write(1.0)
    for factor, files in zip((1.0, 2.0), steps(shared_path / "series.pvd").values()):
        for file in files:
            found = meshio.read(file)
            assert set(found.point_data) == {"displacement", "s", "v", "p"}
            assert set(found.cell_data) == {"c"}
            x, y = found.points[:, 0], found.points[:, 1]
            near = {"rtol": 0, "atol": 1e-12}
            assert np.allclose(found.point_data["s"], factor * (x**2 + x * y), **near)
            assert np.allclose(found.point_data["p"], 3 * x - y, **near)
            right = np.stack([x * y, y**2, 0 * x], axis=1)
            assert np.allclose(found.point_data["v"], right, **near)


def test_name_of_a_nodal_field_is_checked(shared_path):
    scene = pressed()
    with pytest.raises(fm.MortarError, match="other than 'displacement'"):
        ResultsWriter(shared_path / "series", scene.problem, {"displacement": scene.u})


def values_in_cells(V, expression):
    """Values of a scalar at the midpoints of the owned cells."""
    points = midpoint_of(compat.cell_name(V.mesh))
    cells = np.arange(V.mesh.topology.index_map(2).size_local, dtype=np.int32)
    return compat.evaluate_expression(
        compat.create_expression(expression, points), V.mesh, cells
    ).ravel()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_contact_files_contain_the_nodal_fields(shared_path, slave, degree):
    scene = pressed(slave=slave, degree=degree)
    c = scene.contact
    with ResultsWriter(shared_path / "series.pvd", scene.problem) as results:
        results.write(-1.0)
        scene.problem.solve()
        results.write(2.5)
    files = steps(shared_path / "series.pvd", "surfaces", c.slave.name)
    assert list(files) == [-1.0, 2.5]
    before, after = (meshio.read(branches[0]) for branches in files.values())
    assert np.allclose(before.point_data["contact_pressure"], 0.0)
    assert np.nanmin(before.point_data["gap"]) == pytest.approx(0.01, rel=1e-9)
    assert c.active.any()
    assert np.array_equal(after.points[:, :2], c.slave.X)
    ends_first = [0, 1] if degree == 1 else [0, 2, 1]
    assert np.array_equal(after.cells[0].data, c.slave.facets[:, ends_first])
    data = after.point_data
    assert np.array_equal(data["contact_pressure"], c.pressure)
    assert data["contact_pressure"].max() > 1.0
    assert np.array_equal(data["status"], c.active)
    assert np.array_equal(data["gap"], c.gap, equal_nan=True)
    assert np.isnan(data["gap"]).any() == (slave == "lower")
    assert np.array_equal(data["normal"][:, :2], c.operators.n)
    assert np.array_equal(data["displacement"][:, :2], c.slave.gather(scene.u.x.array))
    assert np.abs(data["tangential_traction"]).max() < 1e-9 * c.pressure.max()


def test_file_names_may_contain_dots_and_new_folders(shared_path):
    scene = pressed()
    folder = shared_path / "not" / "there"
    results = ResultsWriter(folder / "nu_0.3", scene.problem)
    for time in range(3):
        results.write(time)
    branches = [branch for files in steps(folder / "nu_0.3.pvd").values() for branch in files]
    assert len(set(branches)) == len(branches) >= 3
    assert all(branch.is_file() for branch in branches)


def test_ranks_without_cells_are_allowed(shared_path):
    mesh = dict.fromkeys(("n_upper", "n_lower", "layers_upper", "layers_lower"), 1)
    scene = scenes.pressed_blocks(**mesh)  # two cells
    grad = ufl.grad(scene.u)
    ResultsWriter(shared_path / "series", scene.problem, {"grad": grad}).write(0.0)
    meshes = [meshio.read(branch) for branch in steps(shared_path / "series.pvd")[0.0]]
    assert sum(len(mesh.cells[0].data) for mesh in meshes) == 2
    plot(scene.problem, shared_path / "picture", stress=grad[0, 0])
    contact_table(scene.problem)


def test_two_slaves_of_one_name_in_files_get_two_series(shared_path):
    scene = pressed()
    scene.problem.equations.contacts = 2 * scene.problem.equations.contacts
    ResultsWriter(shared_path / "series", scene.problem).write(0.0)
    for i in range(2):
        found = steps(shared_path / "series.pvd", "surfaces", f"upper/bottom {i}")[0.0]
        assert len(found) == 1 and found[0].is_file()


def test_surfaces_have_their_fluxes(shared_path):
    """Jump, conduction and heat of friction of each field, those of ``fluxes``."""
    scene = stacked((2, 3))
    heat = [fm.Conductance(1, 2.0, heating=lambda p, X: (p * X[:, 0], X[:, 0]))]
    pair = fm.ContactPair(scene.data, "upper/bottom", "lower/top", fluxes=heat)
    problem = scene.problem([pair])
    scene.set(top=-0.02, hot=3.0)
    problem.solve()
    with ResultsWriter(shared_path / "hot", problem, {"T": scene.w.sub(1)}) as results:
        results.write(0.0)
    (file,) = steps(shared_path / "hot.pvd", "surfaces", "upper/bottom")[0.0]
    found, flux = meshio.read(file).point_data, problem.contacts[0].fluxes[0]
    for name in ("jump", "conduction", "heating"):
        assert np.array_equal(found[f"{name}_0"], getattr(flux, name)) and found[f"{name}_0"].any()


def test_outlines_of_obstacles_move_with_them(shared_path):
    """Points are on the curve up to rounding, moved to its present place; circles are closed."""
    motions = (
        fm.Circle((0.5, 1.5), 0.25, name="ball"),
        fm.Plane((0.0, 1.1), (0.0, -1.0), name="far"),
    )
    problem = block_under(motions[0])
    problem.equations.motions.obstacles.append(motions[1])
    motions[1].move(y=100.0)
    with ResultsWriter(shared_path / "series", problem) as results:
        for time, motion in enumerate([(0.0, 0.0, 0.0), (0.1, -0.3, 0.5)]):
            motions[0].move(x=motion[0], y=motion[1], angle=motion[2])
            results.write(time)
            (file,) = steps(shared_path / "series.pvd", "obstacles", "ball")[time]
            mesh = meshio.read(file)
            own, moved = mesh.points[:, :2], mesh.points + mesh.point_data["displacement"]
            lines, x = mesh.cells_dict["line"], moved[:, :2]
            assert np.allclose(x, motions[0].to_space(own), atol=1e-12)
            assert np.allclose(np.linalg.norm(own - (0.5, 1.5), axis=1), 0.25, atol=1e-9)
            length = np.linalg.norm(np.diff(x[lines], axis=1), axis=2).sum()
            assert length == pytest.approx(np.pi * 0.5, rel=2e-4)  # chords
    for (file,) in steps(shared_path / "series.pvd", "obstacles", "far").values():
        out_of_sight = meshio.read(file)
        assert np.array_equal(out_of_sight.points, np.tile([0.0, 1.1, 0.0], (2, 1)))
        assert np.allclose(out_of_sight.point_data["displacement"], [0.0, 100.0, 0.0])


@pytest.mark.each
@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"displacement": 1}, "'displacement'"),
        ({"": 1}, "non-empty string"),
        ({"number": 1.0}, "field 'number'"),
        ({"rank 3": "third"}, r"shape is \(2, 2, 2\)"),
        ({"test": "test"}, "test or trial function"),
    ],
)
def test_invalid_field_raises_on_all_ranks(shared_path, fields, message):
    scene = pressed()
    u = scene.u
    special = {"third": ufl.grad(ufl.grad(u)), "test": ufl.TestFunction(u.function_space)}
    fields = {name: special.get(e, e) for name, e in fields.items()}
    with pytest.raises(fm.MortarError, match=message):
        ResultsWriter(shared_path / "series", scene.problem, fields)
    COMM.barrier()  # hangs if a rank has left


def test_invalid_path_raises_on_all_ranks(shared_path):
    scene = pressed()
    if COMM.rank == 0:
        (shared_path / "file").write_text("in the way")
        (shared_path / "series.pvd").mkdir()
        (shared_path / "picture.png").mkdir()
    COMM.barrier()
    with pytest.raises(fm.MortarError, match="folder"):
        ResultsWriter(shared_path / "file" / "series", scene.problem)
    with pytest.raises(fm.MortarError, match="folder"):
        plot(scene.problem, shared_path / "file" / "picture.png")
    with pytest.raises(fm.MortarError, match="is not a file name"):
        ResultsWriter("", scene.problem)
    with pytest.raises(fm.MortarError, match=r"series\.pvd"):
        ResultsWriter(shared_path / "series", scene.problem).write(0.0)
    with pytest.raises(fm.MortarError, match=r"picture\.png"):
        plot(scene.problem, shared_path / "picture.png")


def test_path_of_rank_0_is_used(shared_path):
    scene = pressed()
    ResultsWriter(shared_path / f"rank{COMM.rank}", scene.problem).write(0.0)
    branches = steps(shared_path / "rank0.pvd")[0.0]
    assert all(branch.is_file() for branch in branches)
    assert not (shared_path / "rank1.pvd").exists()


def test_table_shows_opposite_forces_that_separate_the_bodies():
    scene = pressed()
    scene.problem.solve()
    table = contact_table(scene.problem)
    assert set(COMM.allgather(table)) == {table}
    head, line, row = table.splitlines()
    assert head.count("|") == line.count("|") == row.count("|")
    pair, slave, master, total, active, pressure, gap = row.strip("| ").split(" | ")
    assert pair == "upper/bottom - lower/top"
    slave, master, total = (
        np.array([float(x) for x in re.findall(r"[-+.e\d]+", force)])
        for force in (slave, master, total)
    )
    assert slave[1] > 0.1  # the upper body is pushed up
    assert np.allclose(slave, -master, rtol=1e-3)
    assert np.abs(total).max() < 1e-12 * slave[1]
    assert slave[1] == pytest.approx(reaction(scene)[1], rel=1e-4)
    assert active == f"{scene.contact.active.sum()} of {scene.contact.slave.num_nodes}"
    assert float(pressure) == pytest.approx(scene.contact.pressure.max(), rel=1e-4)
    assert abs(float(gap)) < 1e-9


def reaction(scene):
    """Reaction at the bottom of the lower body, from the internal forces alone."""
    bulk = scene.problem.equations.bulk
    bulk.assemble_residual()
    X = bulk.V.tabulate_dof_coordinates()[: bulk.num_owned // 2]
    forces = bulk.r.array_r[: bulk.num_owned].reshape(-1, 2)[X[:, 1] < 1e-9]
    return COMM.allreduce(forces.sum(axis=0))


def test_table_has_no_gap_where_nothing_is_near():
    scene = pressed(pair={"search_radius": 1e-3})
    assert contact_table(scene.problem).splitlines()[2].endswith("| 0.0000e+00 | - |")
