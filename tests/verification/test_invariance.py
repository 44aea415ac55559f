# SPDX-License-Identifier: MIT
"""Invariance to ranks, units and rigid motion; momentum, order of convergence, tangent."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import PARTLY_COVERED, disturbed, internal, neo_hookean, pressed_blocks, rotation
from scipy.spatial import cKDTree

from dolfinx import fem

import fenics_mortar as fm

comm = MPI.COMM_WORLD
MESH = {"n_upper": 9, "n_lower": 14, "layers_upper": 12, "layers_lower": 12}
PATH = [(0.01, -0.06), (0.2, -0.08)]


def solve(scene, path=PATH):
    reports = []
    for displacement in path:
        scene.loads["push"].value[:] = displacement
        reports.append(scene.problem.solve())
    return reports


def nodal(scene):
    """Positions and displacements of all nodes, on every rank."""
    owned = scene.problem.equations.bulk.num_owned // 2
    X = scene.u.function_space.tabulate_dof_coordinates()[:owned, :2]
    u = scene.u.x.array[: 2 * owned].reshape(-1, 2)
    across = scene.u.function_space.mesh.comm
    return np.concatenate(across.allgather(X)), np.concatenate(across.allgather(u))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_result_is_independent_of_the_number_of_ranks(slave, algorithm, degree):
    options = {"slave": slave, "degree": degree, "problem": {"algorithm": algorithm}, **MESH}
    together, alone = pressed_blocks(**options), pressed_blocks(comm=MPI.COMM_SELF, **options)
    reports, references = solve(together), solve(alone)
    for report, reference in zip(reports, references, strict=True):
        sets = [[(i.num_active, i.num_changed) for i in r.iterations] for r in (report, reference)]
        assert sets[0] == sets[1]
    assert np.array_equal(together.contact.active, alone.contact.active)
    z, exact = together.contact.z, alone.contact.z
    assert np.abs(z - exact).max() < 1e-10 * np.abs(exact).max()
    (X, u), (X_alone, u_alone) = nodal(together), nodal(alone)
    _, partner = cKDTree(X_alone).query(X)
    assert np.abs(u - u_alone[partner]).max() < 1e-10 * np.abs(u_alone).max()


def test_ranks_without_contact_nodes_and_cuts_through_the_interface_occur():
    """The meshes of these tests have such partitions."""
    tall = pressed_blocks(n_upper=3, n_lower=4, layers_upper=30, layers_lower=30)
    wide = pressed_blocks(
        n_upper=40, n_lower=60, layers_upper=2, layers_lower=8, width_upper=4.0, width_lower=4.4
    )
    counts = comm.allgather(tall.contact.slave.owned.size + tall.contact.master.owned.size)
    cut = comm.allgather(wide.contact.master.owned.size)
    if comm.size > 2:
        assert min(counts) == 0
    if comm.size > 1:
        assert np.count_nonzero(np.array(cut) > 5) > 1
    for scene in (tall, wide):
        scene.loads["push"].value[1] = -0.02
        assert scene.problem.solve().converged


@pytest.mark.once
def test_result_is_independent_of_units():
    """m and Pa, or mm and MPa: equal iterations and residuals relative to the force."""
    histories = []
    for length, stress in ((1e-3, 1e6), (1.0, 1.0), (1e3, 1e-6)):
        sizes = {name: length for name in ("width_upper", "height_upper", "height_lower")}
        scene = pressed_blocks(E=100.0 * stress, **sizes, width_lower=2.2 * length, **MESH)
        path = [(length * x, length * y) for x, y in PATH]
        reports = solve(scene, path)
        for report in reports:
            rows = [(i.num_active, i.num_changed) for i in report.iterations]
            histories.append((rows, np.array(report.residuals) / report.force))
    for step in range(2):
        rows, norms = histories[step]
        for other_rows, other in (histories[2 + step], histories[4 + step]):
            assert rows == other_rows
            large = norms > 1e-9  # below that rounding differs
            assert np.allclose(norms[large], other[large], rtol=1e-5)


@pytest.mark.once
@pytest.mark.parametrize("angle, degree", [(30.0, 1), (90.0, 1), (163.0, 1), (30.0, 2)])
def test_rigid_motion_of_everything_leaves_the_pressures(angle, degree):
    """The whole solved scene is rotated by its Dirichlet conditions and its initial state."""
    scene = pressed_blocks(degree=degree, **MESH)
    solve(scene, [(0.02, -0.06)])
    pressure = scene.contact.pressure.copy()
    u, V = scene.u, scene.u.function_space
    turn = rotation(np.radians(angle))
    turned = fem.Function(V)
    X = V.tabulate_dof_coordinates()[:, :2]
    turned.x.array[:] = ((X + u.x.array.reshape(-1, 2)) @ turn.T - X + [5.0, -3.0]).ravel()
    bcs = [fm.dirichlet(V, scene.data, name, turned) for name in ("lower/bottom", "upper/top")]
    moved = fem.Function(V)
    moved.x.array[:] = turned.x.array
    problem = fm.ContactProblem(
        internal(moved, neo_hookean(moved, 100.0, 0.3)),
        moved,
        [fm.ContactPair(scene.data, "upper/bottom", "lower/top", search_radius=0.5)],
        bcs=bcs,
        petsc_options_prefix="turned_",
        newton=fm.NewtonOptions(residual_tolerance=1e-12),
    )
    problem.solve()
    assert np.abs(problem.equations.contacts[0].pressure - pressure).max() < 1e-10 * pressure.max()


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_contact_forces_of_both_sides_cancel(slave, degree):
    scene = pressed_blocks(slave=slave, n_upper=7, n_lower=11, width_upper=2.4, degree=degree)
    solve(scene)  # the upper block overhangs: facets covered in part
    on_slave, on_master = scene.contact.operators.force(scene.contact.z)
    defect = np.abs(on_slave.sum(axis=0) + on_master.sum(axis=0)).max()
    assert defect < 1e-14 * (np.abs(on_slave).sum() + np.abs(on_master).sum())


def test_contact_force_is_the_reaction_of_the_fixed_boundary():
    scene = pressed_blocks(**MESH)
    solve(scene)
    force = scene.contact.total_force
    for name, sign in (("upper/top", -1.0), ("lower/bottom", 1.0)):
        defect = scene.problem.reaction(name).force - sign * force
        assert np.abs(defect).max() < 1e-10 * np.abs(force).max(), name


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_newton_is_quadratic_to_rounding(algorithm, degree):
    """r_{k+1} <= C r_k^2 with one C in the last three iterations above rounding."""
    scene = pressed_blocks(problem={"algorithm": algorithm}, degree=degree, **MESH)
    report = solve(scene, [(0.0, -0.06)])[-1]
    assert len({iteration.num_active for iteration in report.iterations}) == 1
    r = np.array(report.residuals[1:]) / report.force
    assert r.min() < 1e-12
    above = r[r > 1e-12]  # what follows is rounding
    constants = above[1:] / above[:-1] ** 2
    assert len(constants) >= 2 and constants.max() < 10 * constants.min()


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("basis", ["dual", "standard"])
@pytest.mark.parametrize("normals", ["opposite", "unit", "own"])
@pytest.mark.parametrize("degree", [1, 2])
def test_assembled_tangent_has_second_order_remainder(slave, basis, normals, degree):
    """Partly covered facets, all nodes moved at random, and the whole scene turned."""
    pair = {"basis": basis, "normals": normals}
    scene = disturbed(pressed_blocks(slave=slave, pair=pair, degree=degree, **PARTLY_COVERED))
    check = scene.problem.check_tangent(print_table=False)
    for name, slope in check.slopes.items():
        assert slope == pytest.approx(2.0, abs=0.05), (name, check.table())


@pytest.mark.parametrize("switch, blind", [("no_normals", "n"), ("no_segments", "M")])
def test_tangent_check_detects_a_missing_term(switch, blind):
    """Facets are partly covered; on others, terms of moving segment ends cancel."""
    scene = disturbed(pressed_blocks(slave="lower", problem={"linearization": switch}, **MESH))
    # small steps: a small missing term must rise above the second-order part
    steps = 1e-5 * 0.5 ** np.arange(5)
    slopes = scene.problem.check_tangent(steps=steps, print_table=False).slopes
    assert slopes[blind] == pytest.approx(1.0, abs=0.1)
    assert slopes["whole"] == pytest.approx(1.0, abs=0.1)
    assert slopes["bulk"] == pytest.approx(2.0, abs=0.05)


def test_tangent_is_exact_for_coinciding_nodes():
    """The kinks of M cancel there, but only if segments of zero length keep their derivatives."""
    inner = pressed_blocks(n_upper=10, n_lower=20, width_upper=1.0, width_lower=2.0)
    inner.problem.equations.evaluate(start=True)
    slopes = inner.problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95


@pytest.mark.once
def test_fixed_point_is_linear_and_needs_twice_the_iterations():
    counts = {}
    for linearization in ("full", "frozen"):
        scene = pressed_blocks(
            problem={
                "linearization": linearization,
                "newton": fm.NewtonOptions(residual_tolerance=1e-9),
            },
            **MESH,
        )
        counts[linearization] = solve(scene, [(0.01, -0.06)])[-1].num_iterations
    assert counts["full"] <= 6
    assert counts["frozen"] >= 2 * counts["full"]


def test_mesh_by_arrays_gives_the_same_as_gmsh():
    """Contact pairs by tag number on a mesh created without gmsh."""
    from dolfinx import mesh as dmesh

    from fenics_mortar.utils import compat

    def grid(nx, ny, left, low, width):
        x = np.stack(np.meshgrid(np.linspace(0, 1, nx + 1), np.linspace(0, 1, ny + 1)), axis=-1)
        first = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
        cells = first[:, None] + np.array([0, 1, nx + 1, nx + 2])
        return x.reshape(-1, 2) * [width, 1.0] + [left, low], cells

    (x1, cells1), (x2, cells2) = grid(20, 10, 0.0, 0.0, 2.2), grid(10, 10, 0.6, 1.0, 1.0)
    here = comm.rank == 0
    x = np.concatenate([x1, x2]) if here else np.zeros((0, 2))
    cells = np.concatenate([cells1, cells2 + len(x1)]) if here else np.zeros((0, 4), np.int64)
    mesh = compat.create_mesh(comm, cells, x, "quadrilateral")
    mesh.topology.create_connectivity(1, 2)

    exterior = dmesh.exterior_facet_indices(mesh.topology)
    midpoints = dmesh.compute_midpoints(mesh, 1, exterior)
    f2c = mesh.topology.connectivity(1, 2)
    cell_y = np.array(
        [
            dmesh.compute_midpoints(mesh, 2, f2c.links(f)[:1].astype(np.int32))[0, 1]
            for f in exterior
        ]
    ).reshape(-1)
    tags = np.zeros(exterior.size, np.int32)
    for tag, level, above in ((1, 0.0, False), (2, 1.0, False), (3, 1.0, True), (4, 2.0, True)):
        on = np.isclose(midpoints[:, 1], level) & ((cell_y > 1.0) == above)
        tags[on] = tag
    used = tags > 0
    facet_tags = dmesh.meshtags(mesh, 1, exterior[used], tags[used])
    data = fm.MeshData(mesh, None, facet_tags)
    V = fm.vector_space(mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, 1, np.zeros(2)),
        fm.dirichlet(V, data, 4, np.array([0.01, -0.06])),
    ]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)),
        u,
        [fm.ContactPair(data, 3, 2)],
        bcs=bcs,
        petsc_options_prefix="arrays_",
    )
    problem.solve()
    scene = pressed_blocks()
    solve(scene, [(0.01, -0.06)])
    z, exact = problem.equations.contacts[0].z, scene.contact.z
    assert np.abs(z - exact).max() < 1e-9 * np.abs(exact).max()
