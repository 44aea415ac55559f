# SPDX-License-Identifier: MIT
"""Obstacles driven by forces and moments, whose positions are unknowns of the solve."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import TIGHT, internal, neo_hookean, read, rectangles
from test_obstacles import KINDS, block_under

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, build, mapped

comm = MPI.COMM_WORLD
E, NU = 100.0, 0.3
LOADS = ("x", "y", "moment")
SCENES = {
    "plane": ("y", "moment"),
    "circle": ("x", "y"),
    "hole": ("y",),
    "open": ("x", "y", "moment"),
    "closed": ("y", "moment"),
    "polygon": ("y",),
}


@pytest.mark.once
@pytest.mark.parametrize(
    "kind, degree, algorithm",
    [
        *[(kind, 1, "condensed") for kind in SCENES],
        ("plane", 1, "saddle"),
        ("open", 2, "condensed"),
        ("circle", 2, "saddle"),
    ],
)
def test_prescribed_force_agrees_with_prescribed_displacement(kind, degree, algorithm):
    """The reaction to a prescribed motion is fed back as a load to an obstacle further away."""
    moved, driven = KINDS[kind](), KINDS[kind]()
    given, found = (block_under(o, degree=degree, algorithm=algorithm) for o in (moved, driven))
    moved.move(x=0.03, y=-0.06, angle=0.02)
    given.solve()
    driven.move(x=0.03, angle=0.02)
    loads = dict(zip(LOADS, -moved.reaction, strict=True))
    driven.push(**{name: loads[name] for name in SCENES[kind]})
    report = found.solve()
    assert report.certificate.violations() == []
    assert any("contact force" in note for note in report.notes)
    z, exact = found.equations.contacts[0].z, given.equations.contacts[0].z
    # The last step is quadratic: the rest is rounding, 5e-13 of the pressure at a loose spline.
    assert np.abs(z - exact).max() < 1e-11 * np.abs(exact).max()
    assert np.abs(driven.place - moved.place).max() < 1e-11
    assert np.abs(driven.reaction - moved.reaction).max() < 1e-12 * np.abs(moved.reaction).max()


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_egg_rolls_to_equilibrium(degree):
    """An ellipse, free to move and to turn, on nodes that hardly resist its rolling: springs anchor
    it and let go. At rest it is pressed by its push alone, with an axis along the surface.
    """
    t = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    slope = np.radians(50.0)
    turn = np.array([[np.cos(slope), np.sin(slope)], [-np.sin(slope), np.cos(slope)]])
    points = np.column_stack([0.4 * np.cos(t), 0.25 * np.sin(t)]) @ turn
    egg = fm.Spline(np.array([0.53, 1.01 - points[:, 1].min()]) + points, name="egg")
    problem = block_under(egg, degree=degree)
    egg.push(x=0.0, y=-0.2, moment=0.0)
    report = problem.solve()
    assert report.certificate.violations() == []
    part = report.certificate.springs
    assert egg.reaction == pytest.approx((0.0, 0.2, 0.0), abs=0.2 * max(part, 1e-8))
    rise = (0.4**2 - 0.25**2) / 0.25  # of the height of its middle by the angle squared, twice
    tolerance = part * problem.equations.contacts[0].arm / rise
    assert egg.place[2] == pytest.approx(-slope, abs=1e-3 + tolerance)


@pytest.mark.once
@pytest.mark.parametrize(
    "kind, solver", [("plane", "direct"), ("open", "direct"), ("plane", "iterative")]
)
def test_newton_is_quadratic(kind, solver):
    """Without derivatives with respect to the motions, convergence would be linear."""
    obstacle = KINDS[kind]()
    problem = block_under(obstacle, solver=solver)
    obstacle.push(y=-5.0, moment=0.0)
    residuals = problem.solve().residuals
    assert residuals[-1] < 1e-3 * residuals[-2] < 1e-6 * residuals[-3]


def columns(obstacle, **heights):
    """Blocks side by side, fixed at their bottoms, with their tops against one obstacle."""
    boxes = {name: (2.0 * i, 0.0, 1.0, h) for i, (name, h) in enumerate(heights.items())}
    data = read(rectangles, size=0.25, **boxes)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    return fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [fm.ContactPair(data, f"{name}/top", obstacle) for name in boxes],
        bcs=[fm.dirichlet(V, data, f"{name}/bottom", (0.0, 0.0)) for name in boxes],
        newton=TIGHT,
        petsc_options_prefix="columns_",
    )


@pytest.mark.once
def test_lid_on_two_columns_finds_its_tilt():
    """The lid touches the higher column first, rotates, and then rests on both."""
    lid = fm.Plane((1.5, 1.3), (0.0, -1.0))
    problem = columns(lid, left=1.0, right=0.9)
    lid.push(y=-4.0, moment=-1.0)
    report = problem.solve()
    assert report.certificate.violations() == []
    assert any("moved until contact stopped it" in note for note in report.notes)
    left, right = (contact.total_force for contact in problem.equations.contacts)
    assert left + right == pytest.approx(-lid.reaction[:2], rel=1e-10)
    assert lid.reaction[1:] == pytest.approx((4.0, 1.0), rel=1e-10)
    assert lid.place[2] < -0.02
    assert min(left[1], right[1]) < 0.0


@pytest.mark.once
def test_path_rolls_back_and_restarts(shared_path):
    """The state is restored exactly, from memory and from a file."""
    obstacle = KINDS["open"]()
    problem = block_under(obstacle)

    def set_loads(time):
        obstacle.push(y=-6.0 * time, moment=0.5 * time)

    fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), stop=0.5)
    kept, z = obstacle.place.copy(), problem.equations.contacts[0].z.copy()
    state = problem.state()
    fm.save_state(problem, str(shared_path / "state.npz"))
    fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), start=0.5)
    end = obstacle.place.copy()
    assert np.abs(end - kept).max() > 0.01
    problem.restore(state)
    assert (obstacle.place == kept).all() and (problem.equations.contacts[0].z == z).all()
    other = KINDS["open"]()
    again = block_under(other)
    fm.load_state(again, str(shared_path / "state.npz"))
    assert (other.place == kept).all()
    obstacle = other
    fm.follow_path(again, set_loads, fm.SteppingOptions(step=0.25), start=0.5)
    assert np.abs(other.place - end).max() < 1e-12


@pytest.mark.once
def test_dragged_obstacle_stays_on_its_sticking_nodes():
    """Driven motions are nearly normal to the surface and cannot compensate for the drag."""
    lid = KINDS["plane"]()
    problem = block_under(lid, pair={"law": fm.Coulomb(0.3)})
    lid.push(y=-4.0, moment=0.0)
    problem.solve()
    before = lid.place.copy()
    lid.push(y=-5.0, moment=0.1)
    lid.move(x=1e-3)
    report = problem.solve()
    assert report.certificate.violations() == []
    assert not any("moved until contact" in note for note in report.notes)
    assert np.abs(lid.place - before).max() < 0.05
    assert problem.equations.contacts[0].sticking.any()


@pytest.mark.once
def test_contact_adds_no_energy():
    """The work of the push is that on the block, up to the square of the step size."""
    rests = []
    for step in (0.5, 0.25):
        lid = KINDS["plane"]()
        problem = block_under(lid)
        lid.push(y=-2.0, moment=0.1)
        problem.solve()

        def set_loads(time, lid=lid):
            lid.push(y=-2.0 - 6.0 * time, moment=0.1 + 0.5 * time)

        path = fm.follow_path(problem, set_loads, fm.SteppingOptions(step=step))
        rests.append(sum(step.work.contact for step in path.steps))
        assert abs(rests[-1]) < 2e-3 * sum(step.work.supports for step in path.steps)
    assert rests[0] / rests[1] == pytest.approx(4.0, rel=0.03)  # 3.94: a term of fourth order


def test_forces_and_moments_of_supports_and_obstacle_cancel():
    """About the origin."""
    obstacle = KINDS["open"]()
    problem = block_under(obstacle)
    obstacle.push(x=0.01, y=-6.0, moment=0.5)
    problem.solve()
    force, moment, _ = problem.reaction("lower/bottom")
    supports = np.array([*force, moment])
    pivot = obstacle.pivot + obstacle.place[:2]
    fx, fy, moment = np.array([0.01, -6.0, 0.5])
    loads = np.array([fx, fy, moment + pivot[0] * fy - pivot[1] * fx])
    assert np.abs(supports + loads).max() < 1e-10 * np.abs(loads).max()


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_body_falls_on_a_rigid_floor(algorithm):
    """The block is supported by the floor alone: it falls by its weight, with uniform pressure."""
    data = read(rectangles, size=0.25, block=(0.0, 0.3, 1.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    floor = fm.Plane((0.0, 0.0), (0.0, 1.0))
    weight = ufl.inner(ufl.as_vector((0.0, -0.5)), ufl.TestFunction(V)) * ufl.dx
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)) - weight,
        u,
        [fm.ContactPair(data, "block/bottom", floor)],
        newton=TIGHT,
        algorithm=algorithm,
        petsc_options_prefix="falls_",
    )
    report = problem.solve()
    assert report.certificate.violations() == []
    moment = -0.5 * (ufl.SpatialCoordinate(data.mesh)[0] + u[0]) * ufl.dx
    moment = comm.allreduce(fem.assemble_scalar(fem.form(moment)))
    assert floor.reaction == pytest.approx((0.0, -0.5, moment), abs=1e-9)
    assert moment == pytest.approx(-0.25, rel=0.01)  # it hardly moves sideways


@pytest.mark.once
def test_block_between_a_floor_and_a_lid():
    """The block is supported by two planes alone: one at rest, one driven."""
    data = read(rectangles, size=0.25, block=(0.0, 0.0, 1.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    floor, lid = fm.Plane((0.0, 0.0), (0.0, 1.0)), fm.Plane((0.5, 1.0), (0.0, -1.0))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [
            fm.ContactPair(data, "block/bottom", floor),
            fm.ContactPair(data, "block/top", lid),
        ],
        newton=TIGHT,
        petsc_options_prefix="between_",
    )
    lid.push(y=-3.0, moment=0.0)
    report = problem.solve()
    assert report.certificate.violations() == []
    assert floor.reaction == pytest.approx((0.0, -3.0, 0.5 * -3.0), abs=1e-9)
    pressure = problem.equations.contacts[1].pressure
    assert np.ptp(pressure) < 1e-9 * pressure.mean()


@pytest.mark.serial
@pytest.mark.parametrize("height", [0.98, 1.0, 1.2])
def test_oblique_push_is_held_by_friction_from_the_start(height):
    """Also of an obstacle in the air; a push above the friction drives it away."""
    obstacle = fm.Plane((0.5, height), (0.0, -1.0))
    problem = block_under(obstacle, pair={"law": fm.Coulomb(0.5)})
    obstacle.push(x=0.15, y=-1.0, moment=0.1)
    assert problem.solve().certificate.violations() == []
    assert np.abs(obstacle.reaction + np.array([0.15, -1.0, 0.1])).max() < 1e-10
    away = fm.Plane((0.5, height), (0.0, -1.0))
    problem = block_under(away, pair={"law": fm.Coulomb(0.5)})
    away.push(x=0.6, y=-1.0, moment=0.1)
    with pytest.raises(fm.MortarError, match="can move along .* freely"):
        problem.solve()
    beside = fm.Plane((0.5, 1.0), (0.0, -1.0))  # touches without pressure: nothing rubs
    problem = block_under(beside, pair={"law": fm.Coulomb(0.5)})
    beside.push(x=0.1)
    with pytest.raises(fm.MortarError, match="can move along .* freely"):
        problem.solve()


@pytest.mark.each
@pytest.mark.parametrize(
    "loads, message",
    [
        ({"y": 1.0}, "can move along (0, 1) freely"),
        ({"x": 1.0}, "can move along (1, 0) freely"),
        ({"moment": 1.0}, "can rotate about (0.5, 2.1) freely"),
    ],
)
def test_unsupported_obstacle_is_refused(loads, message):
    """A round one rotates about its centre in spite of contact; equal errors on all ranks."""
    plane, circle = fm.Plane((0.5, 1.1), (0.0, -1.0)), fm.Circle((0.5, 2.1), 1.0)
    refuse(circle if "moment" in loads else plane, loads, message)


def test_obstacle_that_no_facet_faces_is_refused():
    """The solid is below, like the block: the top of the block faces away from its surface."""
    refuse(fm.Plane((0.5, 1.1), (0.0, 1.0)), {"y": -1.0}, "the solid is on the side of the body")


def refuse(obstacle, loads, message):
    problem = block_under(obstacle)
    obstacle.push(**loads)
    with pytest.raises(fm.MortarError) as error:
        problem.solve()
    assert message in str(error.value)
    assert len(set(comm.allgather(str(error.value)))) == 1


@pytest.mark.serial
def test_loaded_obstacle_that_slides_away_is_named():
    """Pressed on the block first, then pushed along it."""
    obstacle = fm.Plane((0.5, 1.0), (0.0, -1.0))
    problem = block_under(obstacle)
    obstacle.push(y=-3.0)
    problem.solve()
    obstacle.push(x=1.0)
    with pytest.raises(fm.NotConvergedError) as error:
        problem.solve()
    assert "obstacle 'plane' can move along" in str(error.value)


@pytest.mark.serial
def test_sliding_wheel_moves_at_most_the_largest_move():
    """A force keeps it on the slope y = 0.3 x^2 and is removed in one step or along a path.

    It slides to the point where the slope is the coefficient of friction, x = 0.1667; its middle is
    then above sin(angle) further inside. Corners of facets turn the slope by up to 0.3 h = 0.02.
    """

    def position(s, t):
        x = 3.0 * s - 1.5
        return x, -1.0 + t * (1.0 + 0.3 * x**2)

    data = read(build, grids=[Grid("ground", mapped(48, 8, position))])
    V, wheel = fm.vector_space(data.mesh, 1), fm.Circle((0.6, 1.108), 1.0)
    u = fem.Function(V)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [fm.ContactPair(data, "ground/top", wheel, law=fm.Coulomb(0.1))],
        bcs=[fm.dirichlet(V, data, "ground/bottom", (0.0, 0.0))],
        petsc_options_prefix="pit_",
    )
    wheel.push(y=-1.0)
    problem.solve()
    start, force = problem.state(), -wheel.reaction[0]
    wheel.push(x=0.0)
    (violation,) = problem.solve(accept_violations=True).certificate.violations()
    assert "slid away" in violation
    end = wheel.place.copy()
    problem.restore(start)
    path = fm.follow_path(
        problem, lambda time: wheel.push(x=(1.0 - time) * force), fm.SteppingOptions(step=1.0)
    )
    assert path.num_cuts and "slid away" in path.steps[0].failures[0].reason
    assert np.abs(wheel.place - end).max() < 1e-9
    assert 0.6 + end[0] == pytest.approx(0.1667 - np.sin(np.arctan(0.1)), abs=1e-3)


def test_invalid_loads_are_refused():
    for load in ({"y": np.nan}, {"moment": (1.0,)}, {"x": np.inf}):
        with pytest.raises(ValueError):
            fm.Plane((0, 0), (0, 1)).push(**load)
