# SPDX-License-Identifier: MIT
"""Surfaces that crossed, in a state or in a step, are told of; those that touch are not."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from scenes import (
    internal,
    neo_hookean,
    nodal,
    pair_options,
    pressed_blocks,
    read,
    rectangles,
    rotation,
)
from test_tied import tool_on_halves

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes import half_cylinder_on_block, mapped_grids, rings
from meshes.mapped_grids import Grid

DX = ufl.dx(metadata={"quadrature_degree": 2})


def told(report, word):
    return [violation for violation in report.certificate.violations() if word in violation]


def is_silent(report):
    return not (report.certificate.violations() or report.certificate.passages)


def problem_of(data, pairs, bcs, u, load=0.0, **options):
    residual = internal(u, neo_hookean(u, 100.0, 0.3)) - load
    return fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="cross_", **options)


def move_body(problem, where, new):
    """Put the nodes of the body that is at ``where`` (x -> bool) to ``new`` (x) by hand."""
    bulk, labels = problem.equations.bulk, problem.equations.floating.labels
    x = bulk.positions()
    found = {body for mine in problem.comm.allgather(labels[where(x)].tolist()) for body in mine}
    assert len(found) == 1
    mine = labels == found.pop()
    bulk.u.x.array[bulk.space.dofs[mine]] += (new(x) - x)[mine]


def turned(centre, degrees):
    return lambda x: (x - centre) @ rotation(np.radians(degrees)).T + centre


# A state


def c_ring(push, *, degree=1, cell="quadrilateral", comm=MPI.COMM_WORLD):
    """A C, held at its back, with its two paired ends 0.37 apart, and forces on its right half."""
    shape = mapped_grids.sector(40, 3, radii=(0.8, 1.0), angles=(0.2, 2.0 * np.pi - 0.2))
    data = read(mapped_grids.build, comm=comm, grids=[Grid("ring", shape)], cell=cell)
    V = fm.vector_space(data.mesh, degree)
    u, v, X = fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(data.mesh)
    force = fem.Constant(data.mesh, push)
    load = ufl.conditional(ufl.gt(X[0], 0.5), -force * ufl.sign(X[1]), 0.0) * v[1] * DX
    back = fem.locate_dofs_geometrical(V, lambda X: X[0] < -0.9)
    bcs = [fem.dirichletbc(np.zeros(2), back, V)]
    pair = fm.ContactPair(data, "ring/left", "ring/right")
    return force, problem_of(data, [pair], bcs, u, load)


@pytest.mark.parametrize(("degree", "cell"), [(1, "quadrilateral"), (2, "triangle")])
def test_ends_of_a_ring_that_went_past_each_other_are_told(degree, cell):
    _, problem = c_ring(1.0, degree=degree, cell=cell)
    report = problem.solve(accept_violations=True)
    assert np.abs(problem.equations.contacts[0].total_force).max() == 0.0  # contact saw nothing
    (crossing,) = report.certificate.crossings
    assert crossing.facets > 3.0 and crossing.depth > 0.5
    assert told(report, "body 'ring' crosses itself at (") and told(report, "deep (")
    assert told(report, "went through body 'ring'")
    assert any("VIOLATED: body 'ring' crosses itself" in note for note in report.notes)
    assert problem.certificate().crossings == report.certificate.crossings
    assert not problem.certificate().passages  # of a solve, not of a state


def test_result_is_that_of_one_rank():
    """Outlines, their bodies and order do not depend on who owns what."""
    reports, outlines = [], []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        _, problem = c_ring(1.0, comm=comm)
        reports.append(problem.solve(accept_violations=True))
        outlines.append(problem.equations.crossings.outline)
    for name in ("X", "segments", "ends"):
        assert np.allclose(*(getattr(outline, name) for outline in outlines))
    assert np.array_equal(*(outline.neighbours() for outline in outlines))
    (mine,), (alone,) = (report.certificate.crossings for report in reports)
    assert mine.depth == pytest.approx(alone.depth) and mine.facets == pytest.approx(alone.facets)
    assert set(mine.sides) == set(alone.sides)
    assert len(reports[0].certificate.passages) == len(reports[1].certificate.passages) == 1
    everywhere = MPI.COMM_WORLD.allgather(str(reports[0].certificate))
    assert len(set(everywhere)) == 1


def test_path_of_a_ring_ends_with_its_ends_in_contact():
    force, problem = c_ring(0.0)

    def load(time):
        force.value = 0.4 * time

    path = fm.follow_path(problem, load, fm.SteppingOptions(step=1.0, smallest=1e-3))
    assert path.finished and is_silent(path.steps[-1].report)
    o = problem.equations.contacts[0].operators
    assert abs(o.x.mean(axis=0)[1]) < 0.05 and problem.equations.contacts[0].total_force[1] != 0.0


def test_unpaired_part_of_a_body_that_crosses_itself_is_told():
    """A U whose legs are bent through each other; what is paired is below."""
    arc = mapped_grids.sector(16, 2, radii=(0.4, 0.6), angles=(np.pi, 2.0 * np.pi))
    legs = [mapped_grids.block(2, 12, width=0.2, height=1.5, corner=(x, 0.0)) for x in (-0.6, 0.4)]
    legs[0] = legs[0][::-1][:, ::-1].swapaxes(0, 1)[:, ::-1]
    shape = np.concatenate([
        np.stack([np.linspace((-0.6, 1.5), (-0.6, 0.0), 12, endpoint=False),
                  np.linspace((-0.5, 1.5), (-0.5, 0.0), 12, endpoint=False),
                  np.linspace((-0.4, 1.5), (-0.4, 0.0), 12, endpoint=False)], axis=1),
        arc,
        np.stack([np.linspace((0.6, 0.0), (0.6, 1.5), 13)[1:],
                  np.linspace((0.5, 0.0), (0.5, 1.5), 13)[1:],
                  np.linspace((0.4, 0.0), (0.4, 1.5), 13)[1:]], axis=1),
    ])  # fmt: skip
    floor = mapped_grids.block(6, 2, width=2.0, height=0.3, corner=(-1.0, -0.92))
    data = read(mapped_grids.build, grids=[Grid("clip", shape), Grid("floor", floor)])
    V = fm.vector_space(data.mesh, 1)
    u, apart = fem.Function(V), [fem.Constant(data.mesh, (x, 0.0)) for x in (0.2, -0.2)]
    bcs = [fm.dirichlet(V, data, "floor/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(V, data, f"clip/{e}", c) for e, c in zip(("left", "right"), apart)]
    problem = problem_of(data, [fm.ContactPair(data, "clip/bottom", "floor/top")], bcs, u)
    assert is_silent(problem.solve(accept_violations=True))
    for value, constant in zip((0.9, -0.9), apart, strict=True):
        constant.value[0] = value
    report = problem.solve(accept_violations=True)
    assert told(report, "body 'clip' crosses itself") or told(report, "'clip/bottom'")
    assert report.certificate.crossings[0].facets > 0.5


# A step


def block_over_plate(thickness=0.3, size=0.15, *, height=0.4, **options):
    """A plate, held at its sides, and a block above it, moved at its top."""
    data = read(
        rectangles,
        size=size,
        plate=(-1.0, -thickness, 2.0, thickness),
        block=(-0.31, 0.1, 0.6, height),
    )
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, f"plate/{side}", (0.0, 0.0)) for side in ("left", "right")]
    bcs.append(fm.dirichlet(V, data, "block/top", push))
    pair = fm.ContactPair(data, "block/bottom", "plate/top", **pair_options(options))
    return push, problem_of(data, [pair], bcs, u)


@pytest.mark.parametrize(("thickness", "size"), [(0.3, 0.15), (0.04, 0.2)])
def test_block_that_jumps_through_a_plate_is_told(thickness, size):
    push, problem = block_over_plate(thickness, size)
    push.value[:] = 0.05, -1.5
    report = problem.solve(accept_violations=True)
    assert not report.certificate.crossings
    (violation, *others) = told(report, "went through body")
    assert "nodes of 'block/" in violation + "".join(others)
    assert "in by 'plate/top' and out by" in violation + "".join(others)
    report = problem.solve()  # it is beyond; nothing goes on
    assert report.certificate.violations() == []
    push.value[:] = 0.0, 0.0
    assert told(problem.solve(accept_violations=True), "went through body")


def test_path_of_a_block_through_a_plate_is_cut_and_ends_in_contact():
    """One step takes a low block beyond a thin plate; step by step it bends the plate."""
    push, problem = block_over_plate(0.1, 0.1, height=0.2, search_radius=0.15)

    def load(time):
        push.value[:] = 0.0, -0.5 * time

    path = fm.follow_path(problem, load, fm.SteppingOptions(step=1.0, smallest=1e-3))
    assert path.finished and is_silent(path.steps[-1].report)
    assert "went through body" in path.steps[0].failures[0].reason
    assert problem.equations.contacts[0].total_force[1] > 0.1


def test_path_that_only_leads_through_a_plate_ends_where_it_began():
    push, problem = block_over_plate()

    def load(time):
        push.value[:] = 0.0, -1.5 * time

    with pytest.raises(fm.NotConvergedError, match="went through body"):
        fm.follow_path(problem, load, fm.SteppingOptions(step=1.0, smallest=0.9))
    assert np.abs(nodal(problem)).max() == 0.0


def test_falling_body_that_is_moved_through_another_is_told():
    """The plate is between the block and the floor it is paired with; the plate has a pair, too."""
    data = read(
        rectangles,
        size=0.2,
        floor=(-1.0, -2.0, 2.0, 0.4),
        plate=(-1.0, -0.2, 2.0, 0.2),
        block=(-0.31, 0.1, 0.6, 0.4),
    )
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    load = fem.Constant(data.mesh, -1.0) * v[1] * DX
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("floor/bottom", "plate/left")]
    pairs = [
        fm.ContactPair(data, "block/bottom", "floor/top", search_radius=5.0),
        fm.ContactPair(data, "plate/bottom", "floor/top", search_radius=0.1),
    ]
    report = problem_of(data, pairs, bcs, u, load).solve(accept_violations=True)
    assert told(report, "went through body 'plate'")


@pytest.mark.parametrize(
    "obstacle",
    [
        lambda: fm.Polygon([(-1, -0.2), (1, -0.2), (1, 0.0), (-1, 0.0)], 0.02, name="sheet"),
        lambda: fm.Polygon([(-1, -0.004), (1, -0.004), (1, 0), (-1, 0)], 0.001, name="sheet"),
        lambda: fm.Circle((0.0, -0.4), 0.4, name="sheet"),
    ],
)
@pytest.mark.parametrize("moves", ["block", "obstacle"])
def test_obstacle_that_is_gone_through_is_told(obstacle, moves):
    sheet = obstacle()
    data = read(rectangles, size=0.2, block=(-0.31, 0.1, 0.6, 0.4))
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    pair = fm.ContactPair(data, "block/bottom", sheet)
    problem = problem_of(data, [pair], [fm.dirichlet(V, data, "block/top", push)], u)
    assert is_silent(problem.solve(accept_violations=True))

    def go(x, y):
        if moves == "block":
            push.value[:] = x, y
        else:
            sheet.move(x=-x, y=-y)

    go(0.3, 0.2)
    assert is_silent(problem.solve(accept_violations=True))
    go(0.05, -2.0)
    assert told(problem.solve(accept_violations=True), "went through obstacle 'sheet'")
    go(0.0, -2.5)
    assert is_silent(problem.solve(accept_violations=True))


# Nothing crossed


def test_what_users_set_begins_a_step_of_its_own():
    """Who puts the block beyond the plate by hand has not moved it through."""
    push, problem = block_over_plate()
    problem.solve(accept_violations=True)
    push.value[:] = 0.0, -1.5
    move_body(problem, lambda x: x[:, 1] > 0.05, lambda x: x - [0.0, 1.5])
    assert is_silent(problem.solve(accept_violations=True))


def test_hertz_is_silent():
    data = read(half_cylinder_on_block.build, h=0.05)
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "cylinder/top", push))
    problem = problem_of(data, [fm.ContactPair(data, "cylinder/arc", "block/top")], bcs, u)
    for depth in (-0.02, -0.1, -0.3):
        push.value[1] = depth
        report = problem.solve(accept_violations=True)
        assert is_silent(report) and max(c.facets for c in report.certificate.crossings) < 0.2


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_ironing_by_many_facets_a_step_is_silent(degree):
    """The sides of the tool move by ten facets, and its corners over the wave ahead of it."""
    data = read(rectangles, size=0.15, block=(-1.5, -0.6, 3.0, 0.6), tool=(-1.21, 0.01, 0.5, 0.4))
    V = fm.vector_space(data.mesh, degree)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "tool/top", push))
    residual = internal(u, neo_hookean(u, 10.0, 0.3))
    pairs = [fm.ContactPair(data, "block/top", "tool/bottom")]
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="iron_")
    for place in ((0.0, -0.05), (0.75, -0.05), (1.9, -0.05), (1.9, 0.2), (0.0, 0.2), (0.0, -0.05)):
        push.value[:] = place
        assert is_silent(problem.solve(accept_violations=True))


@pytest.mark.parametrize("half", [np.pi / 6, np.pi / 3])
def test_disk_in_a_groove_of_plates_is_silent(half):
    """Two plates that overlap at the tip, as is meant: they are no pair."""
    plates = []
    for name, side in (("left", 1.0), ("right", -1.0)):
        plate = mapped_grids.block(20, 2, width=2.0, height=0.2, corner=(0.0, 0.0))
        angle = np.pi / 2 - side * half
        across = plate if side < 0.0 else plate * [1.0, -1.0]
        plates.append(Grid(name, across @ rotation(angle).T))
    centre = (0.0, 0.501 / np.sin(half))
    disk = Grid("disk", mapped_grids.sector(44, 3, radii=(0.2, 0.5), centre=centre), closed=True)
    data = read(mapped_grids.build, grids=[*plates, disk])
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [fm.dirichlet(V, data, f"{name}/top", (0.0, 0.0)) for name in ("left", "right")]
    bcs.append(fm.dirichlet(V, data, "disk/top", push))
    pairs = [fm.ContactPair(data, "disk/bottom", f"{name}/bottom") for name in ("left", "right")]
    problem = problem_of(data, pairs, bcs, u)
    for depth in (-0.01, -0.05):
        push.value[1] = depth
        assert is_silent(problem.solve(accept_violations=True))
        assert (
            problem.equations.contacts[0].active.any()
            and problem.equations.contacts[1].active.any()
        )


@pytest.mark.parametrize("slave", ["tool", "ground"])
def test_tool_over_the_joint_of_tied_bodies_is_silent(slave):
    _, reports = tool_on_halves(slave=slave)
    assert all(is_silent(report) for report in reports)


@pytest.mark.parametrize("interference", [0.0, 0.02])
def test_press_fit_is_silent(interference):
    data = read(rings.build, interference=interference, n_inner=40, n_outer=48)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "inner/inside", (0.0, 0.0))]
    problem = problem_of(data, [fm.ContactPair(data, "inner/outside", "outer/inside")], bcs, u)
    assert is_silent(problem.solve(accept_violations=True))


def test_press_fit_by_offsets_is_silent():
    """A deep interference, many facets, that is worked in little by little."""
    data = read(rings.build, interference=0.3, n_inner=80, n_outer=88)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "inner/inside", (0.0, 0.0))]
    pair = fm.ContactPair(data, "inner/outside", "outer/inside")
    problem = problem_of(data, [pair], bcs, u)
    contact = problem.equations.contacts[0]
    overlap = np.nan_to_num(contact.gap)
    for part in (0.8, 0.6):
        contact.offset = part * overlap
        assert is_silent(problem.solve(accept_violations=True))


@pytest.mark.parametrize("angle", [10.0, 100.0, 180.0, 300.0])
def test_pressed_blocks_that_turn_together_are_silent(angle):
    """However far, in one step, and about a far point."""
    scene = pressed_blocks(n_upper=5, n_lower=7)
    scene.loads["push"].value[:] = (0.0, -0.04)
    scene.problem.solve(accept_violations=True)
    x, crossings = scene.problem.equations.bulk.positions(), scene.problem.equations.crossings
    scene.u.x.array[scene.problem.equations.bulk.space.dofs] += turned([3.0, -2.0], angle)(x) - x
    assert crossings.passages(scene.problem.equations.motions.places) == []
    assert not [crossing for crossing in crossings.find() if crossing.facets > 0.2]


@pytest.mark.parametrize("angle", [30.0, 80.0, 170.0])
def test_ring_that_turns_on_a_shaft_is_silent(angle):
    """Straight ways would draw it through the shaft."""
    shaft = mapped_grids.sector(24, 2, radii=(0.5, 1.0))
    ring = mapped_grids.sector(28, 2, radii=(1.0, 1.4))
    data = read(
        mapped_grids.build,
        grids=[Grid("shaft", shaft, closed=True), Grid("ring", ring, closed=True)],
    )
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("shaft/top", "ring/bottom")]
    problem = problem_of(data, [fm.ContactPair(data, "shaft/bottom", "ring/top")], bcs, u)
    move_body(problem, lambda x: np.hypot(*x.T) > 1.2, turned([0.0, 0.0], angle))
    assert problem.equations.crossings.passages(problem.equations.motions.places) == []
    assert not [c for c in problem.equations.crossings.find() if c.facets > 0.2]


def test_disk_that_rolls_far_in_one_step_is_silent():
    """Over a plate and over an obstacle, by 100 degrees."""
    disk = mapped_grids.sector(36, 3, radii=(0.3, 1.0), centre=(0.0, 1.0))
    plate = mapped_grids.block(40, 2, width=6.0, height=0.1, corner=(-2.0, -0.1))
    data = read(mapped_grids.build, grids=[Grid("disk", disk, closed=True), Grid("plate", plate)])
    V = fm.vector_space(data.mesh, 1)
    u, inner = fem.Function(V), fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "plate/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "disk/top", inner),
    ]
    floor = fm.Plane((0.0, 0.0), (0.0, 1.0))
    pairs = [
        fm.ContactPair(data, "disk/bottom", "plate/top"), fm.ContactPair(data, "disk/bottom", floor)
    ]  # fmt: skip
    problem = problem_of(data, pairs, bcs, u)
    roll = turned([0.0, 1.0], -100.0)
    move_body(problem, lambda x: x[:, 1] > 0.5, lambda x: np.add(roll(x), [np.radians(100.0), 0.0]))
    assert problem.equations.crossings.passages(problem.equations.motions.places) == []
