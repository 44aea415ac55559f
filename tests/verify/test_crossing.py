# SPDX-License-Identifier: MIT
"""Crossed surfaces, in a state or in a step, are reported."""

from __future__ import annotations

import re
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from crossing_scenes import DX, is_silent, messages_with, move_body, problem_of, turned
from scenes import nodal, pair_options, read, rectangles, rotation

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.verify.certificate import Certificate
from fenics_mortar.verify.finding import Crossing
from fenics_mortar.verify.passages import Passed
from meshes import mapped_boxes, mapped_grids, rings
from meshes.mapped_boxes import Box
from meshes.mapped_grids import Grid


def c_ring(push, *, degree=1, cell="quadrilateral", comm=MPI.COMM_WORLD):
    """A C, fixed at its back, with its two paired ends 0.37 apart, and forces on its right half."""
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


@pytest.mark.once
@pytest.mark.parametrize(("degree", "cell"), [(1, "quadrilateral"), (2, "triangle")])
def test_crossed_ends_of_a_ring_are_reported(degree, cell):
    _, problem = c_ring(0.9, degree=degree, cell=cell)
    report = problem.solve(accept_violations=True)
    assert np.abs(problem.equations.contacts[0].total_force).max() == 0.0  # no contact was detected
    (crossing,) = report.certificate.crossings
    assert crossing.facets > 3.0 and crossing.depth > 0.5
    assert messages_with(report, "body 'ring' crosses itself at (") and messages_with(
        report, "deep ("
    )
    assert messages_with(report, "went through body 'ring'")
    assert any("VIOLATED: body 'ring' crosses itself" in note for note in report.notes)
    assert problem.certificate().crossings == report.certificate.crossings
    assert not problem.certificate().passages  # passages belong to a solve, not to a state


def test_result_is_independent_of_the_number_of_ranks():
    """Outlines, their bodies and order do not depend on the partition."""
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


def waves(comm):
    """A block with crests, two of which reach into a flat one equally far, turned by 30 degrees."""
    lower = mapped_grids.block(24, 3, width=3.0, height=0.5)
    crests = np.cos(2 * np.pi * lower[..., 0]) * lower[..., 1]
    upper = mapped_grids.block(22, 3, width=2.2, height=0.5, corner=(0.4, 0.47))
    grids = [Grid("lower", lower + 0.16 * np.stack([0.0 * crests, crests], -1))]
    grids = [
        replace(g, x=g.x @ rotation(np.radians(30.0)).T) for g in (*grids, Grid("upper", upper))
    ]
    data = read(mapped_grids.build, comm=comm, grids=grids)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    fixed = [fm.dirichlet(u.function_space, data, ["lower/bottom", "upper/top"], (0.0, 0.0))]
    return problem_of(data, [pair], fixed, u)


@pytest.mark.parametrize("seed", range(4))
def test_rounding_does_not_decide_which_of_equal_crossings_is_named(seed):
    """Rounding differs with the number of ranks: the places named must not."""
    problem = waves(MPI.COMM_SELF)
    found = problem.equations.crossings.find()
    rng = np.random.default_rng(seed)
    u = problem.equations.bulk.u.x.array
    u += 1e-13 * rng.standard_normal(u.size)
    again = problem.equations.crossings.find()
    assert len(found) == 1 and found[0].facets > 0.3
    assert [crossing.where for crossing in found] == [crossing.where for crossing in again]


@pytest.mark.once
@pytest.mark.serial
def test_path_of_a_ring_ends_with_its_ends_in_contact():
    force, problem = c_ring(0.0)

    def load(time):
        force.value = 0.4 * time

    path = fm.follow_path(problem, load, fm.SteppingOptions(step=1.0, smallest=1e-3))
    assert path.finished and is_silent(path.steps[-1].report)
    o = problem.equations.contacts[0].operators
    assert abs(o.x.mean(axis=0)[1]) < 0.05 and problem.equations.contacts[0].total_force[1] != 0.0


@pytest.mark.once
def test_self_crossing_of_an_unpaired_outline_is_reported():
    """A U whose legs are bent through each other; paired surfaces are below."""
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
    u, openings = fem.Function(V), [fem.Constant(data.mesh, (x, 0.0)) for x in (0.2, -0.2)]
    bcs = [fm.dirichlet(V, data, "floor/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(V, data, f"clip/{e}", c) for e, c in zip(("left", "right"), openings)]
    problem = problem_of(data, [fm.ContactPair(data, "clip/bottom", "floor/top")], bcs, u)
    assert is_silent(problem.solve(accept_violations=True))
    for value, constant in zip((0.9, -0.9), openings, strict=True):
        constant.value[0] = value
    report = problem.solve(accept_violations=True)
    assert messages_with(report, "body 'clip' crosses itself") or messages_with(
        report, "'clip/bottom'"
    )
    assert report.certificate.crossings[0].facets > 0.5


@pytest.mark.parametrize("facets, remarked, violated", [(0.1, 0, 0), (0.44, 1, 0), (0.6, 0, 1)])
def test_shallow_crossing_is_a_remark(facets, remarked, violated):
    """Reported like a penetration of that depth, also for surfaces that are in no pair."""
    crossing = Crossing(("'strip/end'", "body 'strip'"), "(0, 0)", 0.1, facets)
    certificate = Certificate([], 0.0, 0, crossings=[crossing])
    assert (len(certificate.remarks()), len(certificate.violations())) == (remarked, violated)


# A step


def block_over_plate(thickness=0.3, size=0.15, *, height=0.4, **options):
    """A plate, fixed at its sides, and a block above it, moved at its top."""
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
def test_passage_through_a_plate_is_reported(thickness, size):
    push, problem = block_over_plate(thickness, size)
    push.value[:] = 0.05, -1.5
    report = problem.solve(accept_violations=True)
    assert not report.certificate.crossings
    violations = "; ".join(messages_with(report, "went through body"))
    assert "nodes of 'block/" in violations
    assert "entering at 'plate/top' and leaving at" in violations
    (height,) = re.findall(r"nodes of 'block/[^;]* one at \([^;]*?, (.*?)\) ended", violations)
    assert float(height) < -0.5  # present position of the node, below the plate
    report = problem.solve()  # it is beyond; no further passage
    assert report.certificate.violations() == []
    push.value[:] = 0.0, 0.0
    assert messages_with(problem.solve(accept_violations=True), "went through body")


@pytest.mark.once
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


def test_rigid_move_through_a_body_is_reported():
    """The plate is between the block and the floor that form a pair; the plate has a pair, too."""
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
    assert messages_with(report, "went through body 'plate'")


@pytest.mark.parametrize(
    "obstacle",
    [
        lambda: fm.Polygon([(-1, -0.2), (1, -0.2), (1, 0.0), (-1, 0.0)], 0.02, name="sheet"),
        lambda: fm.Polygon([(-1, -0.004), (1, -0.004), (1, 0), (-1, 0)], 0.001, name="sheet"),
        lambda: fm.Circle((0.0, -0.4), 0.4, name="sheet"),
    ],
)
@pytest.mark.parametrize("moves", ["block", "obstacle"])
def test_passage_through_an_obstacle_is_reported(obstacle, moves):
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
    assert messages_with(problem.solve(accept_violations=True), "went through obstacle 'sheet'")
    go(0.0, -2.5)
    assert is_silent(problem.solve(accept_violations=True))


def test_exit_through_the_first_facet_is_reported():
    """Numbers of exit facets begin at 0."""
    _, problem = block_over_plate()
    crossings = problem.equations.crossings
    outline = crossings.outline
    body = int(outline.segment_bodies[0])
    node = np.flatnonzero(outline.bodies != body)[0]
    passed = Passed(np.array([[node, node]]), *np.zeros((2, 1, 2)), np.array([[1, 0]]))
    (message,) = crossings.in_step._messages("nodes", passed, crossings.accepted.x, body)
    assert "went through" in message


# Outside pairs


def blocks_side_by_side(gap=0.02, **paired):
    """Two blocks on a ground, ``gap`` apart and pressed by 10 %: each expands by about 0.045."""
    data = read(
        rectangles,
        size=0.125,
        ground=(-1.5, -0.3, 3.0, 0.3),
        left=(-1.0 - 0.5 * gap, 0.0, 1.0, 1.0),
        right=(0.5 * gap, 0.0, 1.0, 1.0),
    )
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, -0.1)
    bcs = [fm.dirichlet(V, data, "ground/bottom", (0.0, 0.0))]
    for body, outer in (("left", "left"), ("right", "right")):
        bcs.append(fm.dirichlet(V, data, f"{body}/top", push, component=1))
        bcs.append(fm.dirichlet(V, data, f"{body}/{outer}", 0.0, component=0))
    pairs = [fm.ContactPair(data, f"{body}/bottom", "ground/top") for body in ("left", "right")]
    pairs += [fm.ContactPair(data, *sides) for sides in paired.get("sides", ())]
    return problem_of(data, pairs, bcs, u)


@pytest.mark.once
def test_a_shallow_overlap_of_surfaces_without_a_pair_is_a_violation():
    problem = blocks_side_by_side()
    with pytest.raises(fm.MortarError, match="no pair keeps these surfaces apart: add a Contact"):
        problem.solve()
    (crossing,) = outside_pairs(problem)
    assert 0.1 < crossing.facets < 0.5 and not crossing.is_paired
    assert crossing.admitted == 0.01
    with_pair = blocks_side_by_side(sides=[("left/right", "right/left")])
    assert with_pair.solve().certificate.violations() == []
    assert with_pair.contacts[2].total_force[0] < 0.0


@pytest.mark.once
def test_surfaces_of_different_pairs_are_named_as_such():
    """Both sides are in pairs, but not with each other."""
    others = [
        ("left/right", fm.Plane((5.0, 0.0), (-1.0, 0.0))),
        ("right/left", fm.Plane((-5.0, 0.0), (1.0, 0.0))),
    ]
    problem = blocks_side_by_side(sides=others)
    with pytest.raises(fm.MortarError, match=r"'left/\w+' and 'right/\w+' cross .* add a Contact"):
        problem.solve()


@pytest.mark.once
def test_blocks_at_a_distance_do_not_overlap():
    problem = blocks_side_by_side(0.1)
    problem.solve()
    assert not outside_pairs(problem)


def pressed_stack(depth, *, gap=0.02, in_space=False):
    """Two blocks in contact, and a third one without a pair, above them, that moves down."""
    if in_space:
        grid, build, size = mapped_boxes.block, mapped_boxes.mesh, {"size": (0.8, 0.8, 0.5)}
        counts, first, second = (2, 2, 2), (0.0, 0.0, 0.5), (0.1, 0.1, 1.0 + gap)
        whole, kind = {"size": (1.0, 1.0, 0.5)}, Box
    else:
        grid, build, size = mapped_grids.block, mapped_grids.mesh, {"width": 0.8, "height": 0.5}
        counts, first, second = (4, 2), (0.0, 0.5), (0.1, 1.0 + gap)
        whole, kind = {"width": 1.0, "height": 0.5}, Grid
    shapes = [grid(counts, **whole) if in_space else grid(*counts, **whole)]
    for corner, given in ((first, whole), (second, size)):
        shapes.append(
            grid(counts, corner=corner, **given) if in_space
            else grid(*counts, corner=corner, **given)
        )  # fmt: skip
    data = build(
        [kind(name, x) for name, x in zip(("lower", "upper", "tool"), shapes, strict=True)]
    )
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), np.array([0.0, 0.0, -0.01][-len(first) :])
    moved = {"lower/bottom": 0.0 * push, "upper/top": push, "tool/top": 100.0 * depth * push}
    bcs = [fm.dirichlet(V, data, name, tuple(value)) for name, value in moved.items()]
    return problem_of(data, [fm.ContactPair(data, "upper/bottom", "lower/top")], bcs, u)


@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize(("depth", "gap", "told"), [
    (0.1, 0.02, True), (0.01, 0.02, False),
    (0.01, -0.05, False),  # they overlap in the mesh already
])  # fmt: skip
def test_a_body_without_a_pair_that_moves_into_another_one_is_a_remark(depth, gap, told, in_space):
    certificate = pressed_stack(depth, gap=gap, in_space=in_space).solve().certificate
    found = [text for text in certificate.remarks() if "belongs to no pair" in text]
    assert len(found) == told and all("'tool'" in text and "'upper'" in text for text in found)


@pytest.mark.parametrize("push", [-0.3, -0.1])
def test_sides_that_boundary_conditions_hold_need_no_further_pair(push):
    """No contact keeps them apart; the pair is there already."""
    data = read(rectangles, size=0.25, left=(0.0, 0.0, 1.0, 1.0), right=(1.1, 0.05, 1.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    bcs = [fm.dirichlet(V, data, "left/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "right/bottom", (push, 0.0)))
    pair = fm.ContactPair(data, "left/right", "right/left")
    problem = problem_of(data, [pair], bcs, fem.Function(V))
    if push == -0.1:
        assert is_silent(problem.solve())
        return
    with pytest.raises(
        fm.MortarError, match="boundary conditions prescribe nodes of both"
    ) as found:
        problem.solve()
    assert "add a ContactPair" not in str(found.value)


@pytest.mark.parametrize(("depth", "wrong"), [(0.1, True), (0.01, False)])
def test_held_nodes_that_are_moved_into_an_obstacle_are_told(depth, wrong):
    data = read(rectangles, size=0.25, block=(0.0, 0.0, 1.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    bcs = [fm.dirichlet(V, data, "block/left", (0.0, -depth))]
    pair = fm.ContactPair(data, "block/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))
    problem = problem_of(data, [pair], bcs, fem.Function(V))
    report = problem.solve(accept_violations=True)
    messages = report.certificate.violations() if wrong else report.certificate.remarks()
    assert any("boundary conditions move nodes of the body into the" in text for text in messages)
    assert bool(report.certificate.violations()) == wrong


@pytest.mark.parametrize("move", [0.0, -0.02])
def test_held_nodes_that_the_mesh_has_in_an_obstacle_are_no_error(move):
    """Interference; what boundary conditions add to it is."""
    data = read(rectangles, size=0.1, block=(0.0, 0.0, 1.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    bcs = [fm.dirichlet(V, data, "block/left", (0.0, move))]
    pair = fm.ContactPair(data, "block/bottom", fm.Plane((0.0, 0.02), (0.0, 1.0)))
    problem = problem_of(data, [pair], bcs, fem.Function(V))
    certificate = problem.solve(accept_violations=True).certificate
    messages = messages_of_held(certificate.violations())
    assert bool(messages) == (move < 0.0) and all("0.02 deep" in text for text in messages)


def messages_of_held(messages):
    return [text for text in messages if "boundary conditions move nodes of the body" in text]


def outside_pairs(problem):
    return [crossing for crossing in problem.certificate().crossings if not crossing.is_paired]


def in_shaft(x):
    return np.hypot(*x.T) < 1.3


def polygons(n_inner, n_outer):
    """A shaft in a bush of the same radius, without a pair; they touch no obstacle."""
    data = read(rings.build, n_inner=n_inner, n_outer=n_outer, layers_inner=3, layers_outer=3)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    hole, wall = fm.Circle((0.0, 0.0), 0.5), fm.Circle((0.0, 0.0), 5.0, inside=True)
    pairs = [
        fm.ContactPair(data, "inner/inside", hole),
        fm.ContactPair(data, "outer/outside", wall),
    ]
    return problem_of(data, pairs, [], u)


@pytest.mark.once
@pytest.mark.parametrize(
    ("counts", "beyond_mesh"),
    [((12, 12), 0.06), ((24, 24), 0.03), ((16, 12), 0.0), ((48, 40), 0.0)],
)
def test_polygons_of_one_circle_overlap_by_discretization_only(counts, beyond_mesh):
    """Those with 12 sides by 7 % of a side as the shaft turns; a shift by 20 % is an overlap."""
    problem = polygons(*counts)
    find, deepest = problem.equations.crossings.find, 0.0
    for _ in range(7):
        assert all(crossing.facets <= crossing.admitted for crossing in find())
        deepest = max([deepest, *(crossing.facets for crossing in find())])
        move_body(problem, in_shaft, turned(np.zeros(2), 3.0))
    assert deepest >= beyond_mesh
    shift = np.array([0.2 * 4.0 * np.pi / min(counts), 0.0])
    move_body(problem, in_shaft, lambda x: x + shift)
    (crossing,) = find()
    assert crossing.facets > crossing.admitted and not crossing.is_paired


def overlapping(depth, in_space):
    """Two blocks, one of which begins ``depth`` below the top of the other, and one iteration."""
    if in_space:
        lower = Box("lower", mapped_boxes.block((3, 3, 2)))
        place = {"size": (0.6, 0.6, 1.0), "corner": (0.2, 0.2, 1.0 - depth)}
        data = mapped_boxes.mesh([lower, Box("upper", mapped_boxes.block((2, 2, 2), **place))])
    else:
        lower = Grid("lower", mapped_grids.block(3, 2, width=1.0, height=1.0))
        place = {"width": 0.6, "height": 1.0, "corner": (0.2, 1.0 - depth)}
        data = mapped_grids.mesh([lower, Grid("upper", mapped_grids.block(2, 2, **place))])
    u = fem.Function(fm.vector_space(data.mesh, 1))
    ends = ("lower/bottom", 0.0), ("upper/top", -0.01)
    bcs = [fm.dirichlet(u.function_space, data, n, (0.0,) * in_space + (0.0, w)) for n, w in ends]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(0.2))
    return problem_of(data, [pair], bcs, u, newton=fm.NewtonOptions(max_iterations=1))


@pytest.mark.parametrize("in_space", [False, True])
@pytest.mark.parametrize(("depth", "told"), [(0.25, True), (0.02, False)])
def test_overlap_of_the_mesh_is_named_where_the_first_solve_fails(depth, told, in_space):
    with pytest.raises(fm.NotConvergedError) as refusal:
        overlapping(depth, in_space).solve()
    said = re.compile(
        r"before the first solve .* cross at \(.*: move these bodies apart in the mesh"
    )
    assert bool(said.search(str(refusal.value))) == told
    assert any(map(said.match, refusal.value.report.notes)) == told
