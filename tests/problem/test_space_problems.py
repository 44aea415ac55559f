# SPDX-License-Identifier: MIT
"""Bodies of tetrahedra and hexahedra without contact: solves, reactions, certificates, refusals."""

import numpy as np
import pytest
from mesh_measures import COMM
from refusal import refused
from space_scenes import EACH_CELL, POISSON, SIZE, YOUNG, held, pressed, solid, traction

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.bulk.bodies import find_floating_bodies, label_bodies
from fenics_mortar.utils import compat
from fenics_mortar.utils.errors import NOT_IN_SPACE
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block

EACH = pytest.mark.parametrize("cell, order", EACH_CELL)
# Force and moment of the top of ``pressed`` on one rank.
KNOWN = {
    ("tetrahedron", 1): (
        0.497070240292, 0.286365384228, -5.815616909726,
        -6.168177432711, 3.535617311292, -0.357346081576,
    ),
    ("tetrahedron", 2): (
        0.151716060683, 0.181526231979, -5.201771876194,
        -5.441820163496, 2.950777047882, -0.057012693174,
    ),
    ("hexahedron", 1): (
        0.288262158064, 0.179652541124, -5.484001397115,
        -5.752803546679, 3.21337827592, -0.19563206874,
    ),
    ("hexahedron", 2): (
        0.110630838507, 0.156945975168, -5.13079221296,
        -5.354332498683, 2.887835125783, -0.027822752278,
    ),
}  # fmt: skip
F = np.array([[1.1, 0.2, -0.1], [0.0, 0.9, 0.3], [0.1, -0.1, 0.8]])


@EACH
def test_affine_displacement_is_exact(cell, order):
    """A block whose whole surface moves affinely, at finite strains."""
    scene = solid(cell, order)
    V = scene.u.function_space
    moved = fem.Function(V)
    moved.interpolate(lambda x: (F - np.eye(3)) @ x)
    scene.bcs = [fm.dirichlet(V, scene.data, list(scene.data.boundaries), moved)]
    report = scene.set_up(newton=fm.NewtonOptions(residual_tolerance=1e-12)).problem.solve()
    assert np.abs(scene.u.x.array - moved.x.array).max() < 1e-12
    assert report.converged and report.num_iterations <= 8


@EACH
def test_pressed_block_balances_forces_and_moments(cell, order):
    scene = pressed(cell, order).set_up()
    report = scene.problem.solve()
    assert report.certificate.balance < 1e-12 and not report.certificate.violations()
    above, below = (
        scene.problem.reaction(f"block/{s}", data=scene.data) for s in ("top", "bottom")
    )
    assert above.force.shape == above.moment.shape == above.about.shape == (3,)
    assert above.force[2] < -1.0
    assert np.abs(above.force + below.force).max() < 1e-10 * np.abs(above.force).max()
    assert np.abs(above.moment + below.moment).max() < 1e-10 * np.abs(above.moment).max()
    about = np.array([1.0, -2.0, 3.0])
    shifted = scene.problem.reaction("block/top", about, data=scene.data)
    assert np.allclose(shifted.moment, above.moment - np.cross(about, above.force), rtol=1e-12)


def test_certificate_has_the_rows_of_space():
    report = pressed().set_up().problem.solve()
    text = str(report.certificate)
    assert "imbalance of all forces on a body" in text and "inverted cells" in text
    assert "crossing" in text and "bodies that pressures cannot balance" in text


@EACH
def test_results_do_not_depend_on_the_number_of_ranks(cell, order):
    """Reactions are those of one rank."""
    scene = pressed(cell, order).set_up()
    scene.problem.solve()
    force, moment, _ = scene.problem.reaction("block/top", data=scene.data)
    known = KNOWN[cell, order]
    assert np.allclose([*force, *moment], known, rtol=1e-9)


@EACH
def test_uniaxial_compression_of_a_linear_block(cell, order):
    """Sliding supports on three sides and one prescribed component: the stress is uniaxial."""
    scene = solid(cell, order, energy=energies.linear_elastic)
    V = scene.u.function_space
    for component, side in enumerate(("left", "front", "bottom")):
        scene.bcs.append(fm.dirichlet(V, scene.data, f"block/{side}", 0.0, component))
    scene.bcs.append(fm.dirichlet(V, scene.data, "block/top", -0.15, component=2))
    scene.set_up().problem.solve()
    force, moment, _ = scene.problem.reaction("block/top", data=scene.data)
    pressure = 0.1 * YOUNG * SIZE[0] * SIZE[1]
    assert np.allclose(force, [0.0, 0.0, -pressure], rtol=1e-10, atol=1e-12)
    exact = fem.Function(V)
    strain = -0.1 * np.array([-POISSON, -POISSON, 1.0])
    exact.interpolate(lambda x: strain[:, None] * x)
    assert np.abs(scene.u.x.array - exact.x.array).max() < 1e-12
    middle = SIZE / 2 * (1.0 + strain)
    assert np.allclose(moment, np.cross([middle[0], middle[1], 0.0], force), atol=1e-10)


def test_reaction_carries_a_traction():
    """Force and moment of the support are those of the load at the present positions."""
    scene = solid("hexahedron", 2)
    held(scene)
    load = np.array([0.1, -0.2, 0.05])
    traction(scene, "block/top", load)
    scene.set_up().problem.solve()
    force, moment, _ = scene.problem.reaction("block/bottom", data=scene.data)
    area = SIZE[0] * SIZE[1]
    assert np.allclose(force, -area * load, rtol=1e-10)
    x = ufl.SpatialCoordinate(scene.data.mesh) + scene.u
    ds = ufl.Measure("ds", domain=scene.data.mesh, subdomain_data=scene.data.facet_tags)
    top = ds(scene.data.boundary_tag("block/top"))
    lever = [COMM.allreduce(fem.assemble_scalar(compat.form(x[i] * top))) for i in range(3)]
    assert np.allclose(moment, -np.cross(lever, load), rtol=1e-9)


def test_incompressible_block_with_pressure():
    """A mixed function of displacement and pressure in space."""
    data = solid("tetrahedron", 2, jiggle=0.0).data
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (3,)), ("Lagrange", 1))
    w = fem.Function(W)
    u, p = ufl.split(w)
    psi = energies.mixed_neo_hookean(u, p, mu=1.0)
    residual = ufl.derivative(psi * ufl.dx(degree=4), w)
    bcs = [fm.dirichlet(W.sub(0), data, "block/bottom", (0.0, 0.0, 0.0))]
    bcs.append(fm.dirichlet(W.sub(0), data, "block/top", (0.0, 0.0, -0.2)))
    problem = fm.ContactProblem(residual, w, [], bcs=bcs, petsc_options_prefix="test_space_")
    problem.solve()
    J = ufl.det(energies.deformation_gradient(ufl.split(w)[0]))
    volume = COMM.allreduce(fem.assemble_scalar(compat.form(J * ufl.dx(degree=4))))
    assert volume == pytest.approx(SIZE.prod(), rel=1e-8)
    above = problem.reaction("block/top", data=data)
    assert above.force[2] < -1.0 and np.abs(above.force[:2]).max() < 0.05


def test_path_of_steps():
    scene = solid("tetrahedron")
    held(scene)
    push = held(scene, side="block/top")
    scene.set_up()

    def load(time):
        push.value[:] = (0.0, 0.0, -0.4 * time)

    fm.follow_path(scene.problem, load, fm.SteppingOptions(step=0.25))
    assert np.isclose(COMM.allreduce(scene.u.x.array.min(), min), -0.4)


# Bodies


def test_rigid_motions_of_a_free_block():
    """The tangent of a block resists none of its six rigid motions, as long as nothing holds it."""
    scene = pressed("tetrahedron", 2).set_up()
    bulk = scene.problem.equations.bulk
    bulk.assemble_tangent()
    free = np.zeros_like(bulk.prescribed)
    (body,) = find_floating_bodies(bulk, *label_bodies(bulk.V), free)
    assert body.motions.shape == (6, 6)
    X = np.random.default_rng(0).random((5, 3))
    motions = body.displacement(X, np.zeros(5, np.int64))
    assert np.linalg.matrix_rank(motions.reshape(6, 15)) == 6
    for motion in motions:  # distances do not change to first order
        change = motion[:, None] - motion
        assert np.abs((change * (X[:, None] - X)).sum(axis=2)).max() < 1e-12


def test_block_that_nothing_holds_stays_without_loads():
    """Also on a support of one component; any rigid motion along it would be a solution."""
    scene = solid()
    (remark,) = scene.set_up().problem.solve().certificate.remarks()
    assert "nothing holds the body around (0." in remark
    assert "free to move and turn in any direction" in remark
    scene.bcs = [fm.dirichlet(scene.u.function_space, scene.data, "block/bottom", 0.0, 2)]
    (remark,) = scene.set_up().problem.solve().certificate.remarks()
    assert "free to move along (" in remark and "rotate about the axis (0, 0, " in remark
    (body,) = scene.problem.equations.floating.bodies
    assert body.motions.shape == (3, 6)
    assert np.abs(scene.u.x.array).max(initial=0.0) == 0.0
    traction(scene, "block/top", (0.05, 0.0, 0.0))
    with refused(fm.NotConvergedError, r"the body around \(0\.\d+, .* can move along \(1, 0, 0\)"):
        scene.set_up().problem.solve()


# Cells


def test_inverted_cells_are_found():
    scene = pressed("hexahedron", 2).set_up()
    bulk = scene.problem.equations.bulk
    assert bulk.inverted_cells()[0] == 0
    scene.u.interpolate(lambda x: -2.0 * x * np.array([[0.0], [0.0], [1.0]]))
    count, where = bulk.inverted_cells()
    assert count == scene.data.mesh.topology.index_map(3).size_global
    assert where.count(",") == 2


def test_long_steps_do_not_invert_cells():
    """The first Newton step from the reference state is shortened."""
    scene = pressed("tetrahedron", 1, push=(0.0, 0.0, -1.2), jiggle=0.0).set_up()
    report = scene.problem.solve()
    assert report.converged and not report.certificate.inverted


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_flat_and_twisted_cells_are_refused(cell):
    scene = solid(cell, jiggle=0.0)
    held(scene)
    x = scene.data.mesh.geometry.x
    kept = x.copy()
    x[:, 2] = 0.0
    with refused(fm.MeshError, r"\d+ cells have no volume, one at \(.*, .*, 0\)"):
        scene.set_up()
    if cell == "hexahedron":
        x[:] = kept
        top = np.isclose(x[:, 2], SIZE[2]) & np.isclose(x[:, 0], 0.0) & np.isclose(x[:, 1], 0.0)
        x[top, 2] = -1.0
        with refused(fm.MeshError, "1 cells are twisted, one at"):
            scene.set_up()


@EACH
def test_folded_meshes_are_refused(cell, order):
    """A corner of the block is pushed through its neighbours, or a copy of the block is added."""
    if order == 1:
        scene = solid(cell, jiggle=0.0)
        held(scene)
        x = scene.data.mesh.geometry.x
        column = np.isclose(x[:, 0], 0.5) & np.isclose(x[:, 2], 0.75)
        x[column, 0] = 1.6
        with refused(fm.MeshError, "mesh is folded|twisted"):
            scene.set_up()
    boxes = [Box(name, block((1, 1, 1), order=order)) for name in ("one", "two")]
    data = mapped_boxes.mesh(boxes, cell=cell, order=order)
    u = fem.Function(fm.vector_space(data.mesh, order))
    residual = ufl.derivative(energies.neo_hookean(u, 1.0, 1.0) * ufl.dx(degree=2), u)
    with refused(fm.MeshError, r"covers a place twice: two facets .* coincide at \(.*, .*, .*\)"):
        fm.ContactProblem(residual, u, [], petsc_options_prefix="test_space_")


# Not yet in space


@pytest.mark.parametrize(
    "options, what",
    [
        ({"geometry": "axisymmetric"}, "axisymmetric"),
        ({"thickness": 2.0}, "thickness"),
    ],
)
def test_options_of_the_plane_are_refused(options, what):
    scene = pressed()
    name = NOT_IN_SPACE[what].replace("(", r"\(").replace(")", r"\)")
    with refused(NotImplementedError, f"not yet available in three dimensions: {name}"):
        scene.set_up(**options)


def test_energies_of_space():
    """The same energies of a deformation gradient of shape (3, 3) and of a displacement."""
    scene = solid()
    u = scene.u
    u.interpolate(lambda x: (F - np.eye(3)) @ x)
    mu, lmbda = energies.lame(YOUNG, POISSON)
    volume, J, C = SIZE.prod(), np.linalg.det(F), F.T @ F
    e, G = 0.5 * (F + F.T) - np.eye(3), 0.5 * (C - np.eye(3))

    def quadratic(e):
        return mu * (e**2).sum() + lmbda / 2 * np.trace(e) ** 2

    second = 0.5 * (np.trace(C) ** 2 - np.trace(C @ C))
    known = {
        "linear_elastic": quadratic(e),
        "neo_hookean": mu / 2 * (np.trace(C) - 3) - mu * np.log(J) + lmbda / 2 * np.log(J) ** 2,
        "st_venant_kirchhoff": quadratic(G),
        "mooney_rivlin": mu * (np.trace(C) * J ** (-2 / 3) - 3)
        + lmbda * (second * J ** (-4 / 3) - 3)
        + 0.5 * 7.0 * (J - 1) ** 2,
    }
    for name, value in known.items():
        more = (7.0,) if name == "mooney_rivlin" else ()
        psi = getattr(energies, name)(u, mu, lmbda, *more)
        found = COMM.allreduce(fem.assemble_scalar(compat.form(psi * ufl.dx(degree=3))))
        assert found == pytest.approx(volume * value, rel=1e-12), name
    strain = energies.elastic_strain(u, 0.01)
    found = [
        COMM.allreduce(fem.assemble_scalar(compat.form(strain[i, j] * ufl.dx(degree=3))))
        for i, j in np.ndindex(3, 3)
    ]
    assert np.allclose(found, volume * (e - 0.01 * np.eye(3)).ravel(), rtol=1e-10, atol=1e-12)
    with refused(NotImplementedError, "axisymmetry"):
        energies.strain(u, "axisymmetric")
