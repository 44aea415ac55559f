# SPDX-License-Identifier: MIT
"""Friction in space: directions, rotated scenes, rigid rotations, plane scenes, symmetry planes."""

from types import SimpleNamespace

import numpy as np
import pytest
from scenes import read
from scipy.spatial.transform import Rotation
from space_pairs import KINDS, UPRIGHT, YOUNG, stack

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.contact.rows import stick_where_turning_back
from meshes import mapped_grids
from meshes.mapped_grids import Grid

MU = 0.3
SOLVED = fm.NewtonOptions(residual_tolerance=1e-12)
SIZES = ((0.8, 0.7, 0.5), (1.6, 1.6, 0.5))


def on_rigid_plane(cell="hexahedron", degree=1, *, law=None, **options):
    """A block on a plane: the lower body cannot deform at the interface, which stays flat."""
    given = {"sizes": SIZES, "offset": (0.3, 0.25, 0.0), "lower": (3, 3, 1), "poisson": 0.3}
    scene = stack(cell, degree, **{**given, **options})
    scene.hold("lower/top")
    return scene.press().set_up(law or fm.Coulomb(MU), newton=SOLVED)


@pytest.mark.serial
@pytest.mark.parametrize("angle", [0, 20, 45, 77])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_friction_is_along_the_pull_and_of_one_size(cell, degree, angle):
    """A block is pulled until all its nodes slide in steady motion.

    With multipliers at the corners of quadratic triangles the surface is not quite flat.
    """
    scene = on_rigid_plane(cell, degree, jiggle=0.15)
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    for way in (0.0, 0.1, 0.2, 0.3):
        scene.move(*(way * along - [0.0, 0.0, 0.02]))
    force, contact = scene.contact.total_force, scene.contact
    tolerance = 0.03 if (cell, degree) == ("tetrahedron", 2) else 2e-4
    assert (contact.status[contact.active] == "slip").all()
    assert np.abs(force[:2] + MU * force[2] * along[:2]).max() < tolerance * MU * force[2]
    size = np.linalg.norm(contact.shear, axis=1)[contact.active]
    assert np.abs(size - MU * contact.pressure[contact.active]).max() < 1e-8
    slip = contact.slip[contact.active]
    assert np.abs(np.cross(slip, contact.shear[contact.active])).max() < 1e-9 * size.max()
    weight = scene.problem.equations.contacts[0].operators.weight
    work = (weight[:, None] * contact.shear * contact.slip)[contact.active].sum()
    assert contact.friction_work == pytest.approx(float(work), rel=1e-9)


@pytest.mark.once
@pytest.mark.parametrize("cell, degree", [("hexahedron", 2), ("tetrahedron", 1)])
@pytest.mark.parametrize("c_t", [1.0, 10.0])
def test_large_weights_of_the_slip_do_not_turn_nodes_back_for_ever(cell, degree, c_t):
    """With w = z_t + c_t (k / l) s a node that should stick may slide to and fro instead."""
    results = []
    for weight in (0.1, c_t):
        scene = stack(cell, degree, sizes=SIZES, offset=(0.3, 0.25, 0.0), poisson=0.3)
        scene.press().set_up(fm.Coulomb(MU, c_t=weight), newton=SOLVED)
        for way in (0.0, 0.002, 0.01):
            assert scene.move(way, 0.5 * way, -0.02).num_iterations <= 15
        results.append(scene.contact.total_force)
    assert np.abs(results[1] - results[0]).max() < 1e-8 * np.abs(results[0]).max()


def test_a_node_that_turns_back_again_sticks_first():
    """The first time it may slide in the opposite direction, as where a load is reversed."""
    e = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    branch, heading = np.array([1, 1]), None
    for number, signs in enumerate(([1, 1], [-1, 1], [1, 1], [-1, -1])):
        along = np.array(signs)[:, None] * e
        fields = SimpleNamespace(
            acts=np.ones(2, bool), directions=SimpleNamespace(along=along, size=np.ones(2))
        )
        found, heading = stick_where_turning_back(fields, branch, heading, start=number == 0)
        assert found.tolist() == ([0, 1] if number == 2 else [1, 1])
    assert heading[1].tolist() == [2, 1]


def test_turns_are_counted_anew_in_each_solve():
    """Each reversal of a load may turn nodes back once without stick in between."""
    scene = on_rigid_plane()
    scene.move(0.0, 0.0, -0.02)
    (contact,) = scene.problem.equations.contacts
    turned = []
    for way in (0.2, -0.2, 0.2, -0.2):
        scene.move(way, 0.0, -0.02)
        turned.append(int(contact.state.heading[1].max()))
    assert max(turned) == turned[-1] == 1


@pytest.mark.once
def test_orthogonal_pulls():
    """Pulled along x until all slides, then along y: shear turns, against the total slip."""
    directions = []
    for steps in (1, 2, 4):
        scene = on_rigid_plane()
        scene.move(0.0, 0.0, -0.02)
        scene.move(0.2, 0.0, -0.02)
        for k in range(1, steps + 1):
            scene.move(0.2, 0.02 * k / steps, -0.02)
        force = scene.contact.total_force
        assert np.linalg.norm(force[:2]) == pytest.approx(MU * force[2], rel=1e-2)
        directions.append(np.arctan2(-force[1], -force[0]))
    coarse, fine = np.abs(np.diff(directions))
    assert 0.2 < directions[0] < np.pi / 2 + 0.01 and fine < 0.85 * coarse


@pytest.mark.parametrize("cell, degree", KINDS)
def test_rotation_of_the_scene_rotates_all_results(cell, degree):
    """Also the iterations are the same: no axis is preferred."""
    rotation = Rotation.from_rotvec([0.3, 1.1, -0.4]).as_matrix()
    found = []
    for turn in (UPRIGHT, rotation):
        options = {"offset": (0.25, 0.2, -0.003), "turn": turn, "lower": (3, 3, 1)}
        scene = stack(cell, degree, sizes=SIZES, poisson=0.3, **options).press()
        scene.set_up(fm.Coulomb(MU), newton=SOLVED)
        counts = [scene.move(0.0, 0.0, -0.03).num_iterations]
        counts.append(scene.move(0.05, 0.02, -0.03).num_iterations)
        contact = scene.contact
        order = np.lexsort(np.round(contact.positions @ turn, 6).T)
        fields = [contact.forces, contact.shear, contact.slip, contact.normals, contact.positions]
        found.append((counts, [(field @ turn)[order] for field in fields]))
    (counts, fields), (turned_counts, turned_fields) = found
    assert counts == turned_counts
    for field, turned in zip(fields, turned_fields, strict=True):
        assert np.abs(field - turned).max() < 1e-9 * max(1.0, np.abs(field).max())


@pytest.mark.parametrize("law", [fm.Coulomb(MU), fm.Coulomb(2.0)], ids=["slides", "sticks"])
@pytest.mark.parametrize("cell, degree", KINDS[:2])
def test_rigid_rotation_of_both_bodies_causes_no_slip(cell, degree, law):
    """Bodies in contact with sheared nodes turn together: forces turn with them."""
    scene = stack(cell, degree, sizes=SIZES, offset=(0.3, 0.25, 0.0), poisson=0.3)
    V = scene.u.function_space
    given = {side: fem.Function(V) for side in ("lower/bottom", "upper/top")}
    scene.bcs = [fm.dirichlet(V, scene.data, side, value) for side, value in given.items()]
    scene.set_up(law, newton=SOLVED)
    R = Rotation.from_rotvec([0.2, 0.3, -0.4]).as_matrix()

    def prescribe(turn):
        for side, value in given.items():
            motion = np.array([0.03, 0.01, -0.04]) * (side == "upper/top")
            value.interpolate(lambda x, m=motion: turn @ (x + m[:, None]) - x)

    prescribe(UPRIGHT)
    scene.problem.solve()
    force, slip = scene.contact.total_force, np.abs(scene.contact.slip).max()
    prescribe(R)
    X = V.tabulate_dof_coordinates()
    u = scene.u.x.array.reshape(-1, 3)
    u[:] = (X + u) @ R.T - X
    scene.problem.solve()
    assert np.abs(scene.contact.total_force - R @ force).max() < 1e-8 * np.abs(force).max()
    assert np.abs(scene.contact.slip).max() < 1e-10
    assert slip > 1e-3 or law.mu > 1.0
    assert abs(scene.contact.friction_work) < 1e-12


# Plane scenes


def in_the_plane(law, turn, degree, motions, sliding):
    """The plane scene of ``extruded``: displacements of the slave by position, and force."""
    lower = mapped_grids.block(5, 2, width=1.6, height=0.5, corner=(0.0, -0.5))
    upper = mapped_grids.block(4, 2, width=0.8, height=0.5, corner=(0.3, 0.0))
    grids = [Grid("lower", lower @ turn.T), Grid("upper", upper @ turn.T)]
    data = read(mapped_grids.build, grids=grids, cell="quadrilateral")
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    psi = energies.neo_hookean(u, *energies.lame(YOUNG, 0.3)) * ufl.dx(degree=4)
    push, fixed = fem.Constant(data.mesh, np.zeros(2)), fem.Constant(data.mesh, np.zeros(2))
    bcs = [fm.dirichlet(V, data, name, fixed) for name in ("lower/bottom", "lower/top")]
    bcs.append(fm.dirichlet(V, data, "upper/top", push))
    choice = fm.Discretization(slip="operators", gap_weights="basis")
    sides = "upper/bottom", "lower/top"
    pair = fm.ContactPair(data, *sides, law=law, sliding=sliding, discretization=choice)
    problem = fm.ContactProblem(
        ufl.derivative(psi, u), u, [pair], bcs=bcs, petsc_options_prefix="plane_", newton=SOLVED
    )
    for motion in motions:
        push.value[:] = turn @ motion
        problem.solve()
    contact = problem.contacts[0]
    return contact.positions @ turn, contact.total_force @ turn, contact.pressure


@pytest.mark.parametrize("angle", [0.0, 0.6])
@pytest.mark.parametrize("law", [None, fm.Coulomb(MU)], ids=["frictionless", "Coulomb"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("sliding", ["finite", "small"])
def test_extruded_plane_scenes_have_the_plane_solution(sliding, degree, law, angle):
    thickness, motions = 0.3, [(0.0, -0.02), (0.05, -0.02)]
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    scene = stack(
        "hexahedron", degree, upper=(4, 1, 2), lower=(5, 1, 2), jiggle=0.0, turn=turn, poisson=0.3,
        sizes=((0.8, thickness, 0.5), (1.6, thickness, 0.5)), offset=(0.3, 0.0, 0.0),
    )  # fmt: skip
    for body in ("upper", "lower"):
        for side in ("front", "back"):
            scene.roll(f"{body}/{side}", 1)
    if degree == 2:  # the nodes between front and back
        V, y = scene.u.function_space, scene.u.function_space.tabulate_dof_coordinates()[:, 1]
        dofs = fem.locate_dofs_geometrical(
            (V.sub(1), V.sub(1).collapse()[0]), lambda x: np.isclose(x[1], thickness / 2)
        )
        zero = fem.Function(V.sub(1).collapse()[0])
        scene.bcs.append(fem.dirichletbc(zero, dofs, V.sub(1)))
        assert np.isclose(y, thickness / 2).any()
    scene.hold("lower/top")
    scene.press().set_up(law, newton=SOLVED, pair={"sliding": sliding})
    for x, z in motions:
        scene.move(x, 0.0, z)
    positions, force, pressure = in_the_plane(
        law, np.array([[c, -s], [s, c]]), degree, motions, sliding
    )
    contact = scene.contact
    found = contact.positions @ turn
    assert np.abs(contact.total_force @ turn / thickness - [force[0], 0.0, force[1]]).max() < 1e-9
    front = np.flatnonzero(np.abs(found[:, 1]) < 1e-9)
    front, back = front[np.argsort(found[front, 0])], np.argsort(positions[:, 0])
    assert np.abs(found[front][:, [0, 2]] - positions[back]).max() < 1e-10
    assert np.abs(contact.pressure[front] - pressure[back]).max() < 1e-8 * YOUNG


def test_nodes_of_facets_with_nine_nodes_have_one_foundation_and_slide_where_they_close():
    """Stiffness over the force of a unit pressure: in the rows across, all three nodes are alike.

    With equal parts of the facet as areas a corner has a quarter of the foundation, sticks where it
    closes behind its neighbour that slides, is pulled off, and closes again.
    """
    sizes = (0.9, 0.3, 0.5), (1.3, 0.3, 0.5)
    counts = {"upper": (2, 1, 1), "lower": (3, 1, 1)}
    scene = stack("hexahedron", 2, sizes=sizes, offset=(0.15, 0.0, 0.0), jiggle=0.0, **counts)
    for side in ("upper/front", "upper/back", "lower/front", "lower/back"):
        scene.roll(side, 1)
    scene.press().set_up(fm.Tresca(0.02 * YOUNG), newton=SOLVED, pair={"sliding": "small"})
    counted = [
        scene.move(*place).num_iterations for place in ((0.0, 0.0, -0.02), (0.1, 0.0, -0.03))
    ]
    assert max(counted) <= 8
    (contact,) = scene.problem.equations.contacts
    rows = np.unique(np.round(contact.slave.X[:, 0], 6), return_inverse=True)[1].ravel()
    for row in range(rows.max() + 1):
        assert np.ptp(contact.pressure[rows == row]) < 1e-9 * contact.pressure.max()


# Symmetry planes


@pytest.mark.once
@pytest.mark.parametrize("law", [None, fm.Coulomb(MU)], ids=["frictionless", "Coulomb"])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_quarter_with_symmetry_planes_is_a_quarter_of_the_whole(degree, law):
    """The pressed block spreads; its nodes slide outwards, on planes of symmetry along them."""
    options = {"jiggle": 0.0, "poisson": 0.4}
    whole = stack(
        "hexahedron", degree, upper=(4, 4, 1), lower=(6, 6, 1), offset=(0.2, 0.2, 0.0),
        sizes=((0.8, 0.8, 0.5), (1.2, 1.2, 0.5)), **options,
    )  # fmt: skip
    quarter = stack(
        "hexahedron", degree, upper=(2, 2, 1), lower=(3, 3, 1),
        sizes=((0.4, 0.4, 0.5), (0.6, 0.6, 0.5)), **options,
    )  # fmt: skip
    quarter.roll("upper/left", 0)
    quarter.roll("upper/front", 1)
    for scene in (whole, quarter):
        scene.hold("lower/top")
        scene.press().set_up(law, newton=SOLVED)
        scene.move(0.0, 0.0, -0.02)
        scene.move(0.0, 0.0, -0.04)
    at = whole.contact.positions - [0.6, 0.6, 0.0]
    distances = np.linalg.norm(at[:, None] - quarter.contact.positions, axis=2)
    nearest = distances.argmin(axis=0)
    assert distances.min(axis=0).max() < 1e-10
    for name, size in (("pressure", YOUNG), ("shear", YOUNG), ("slip", 1.0)):
        one, all_ = getattr(quarter.contact, name), getattr(whole.contact, name)[nearest]
        assert np.abs(one - all_).max() < 1e-9 * size, name
    assert 4.0 * quarter.contact.total_force[2] == pytest.approx(whole.contact.total_force[2], 1e-9)
    if law:
        assert np.abs(quarter.contact.slip).max() > 1e-4
