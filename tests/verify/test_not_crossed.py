# SPDX-License-Identifier: MIT
"""Surfaces that touch, slide far or rotate without crossing: no messages."""

from __future__ import annotations

import numpy as np
import pytest
from crossing_scenes import is_silent, move_body, problem_of, turned
from scenes import internal, neo_hookean, pressed_blocks, read, rectangles, rotation
from test_crossing import block_over_plate
from tied_scenes import tool_on_halves

from dolfinx import fem

import fenics_mortar as fm
from meshes import half_cylinder_on_block, mapped_grids, rings
from meshes.mapped_grids import Grid


def test_state_set_by_the_user_begins_a_new_step():
    """A block put beyond the plate by the user has not passed through it."""
    push, problem = block_over_plate()
    problem.solve(accept_violations=True)
    push.value[:] = 0.0, -1.5
    move_body(problem, lambda x: x[:, 1] > 0.05, lambda x: x - [0.0, 1.5])
    assert is_silent(problem.solve(accept_violations=True))


@pytest.mark.once
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


@pytest.mark.once
@pytest.mark.parametrize("half", [np.pi / 6, np.pi / 3])
def test_disk_in_a_groove_of_plates_is_silent(half):
    """Two plates that overlap at the tip intentionally: they are not a pair."""
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


@pytest.mark.once
@pytest.mark.parametrize("slave", ["tool", "ground"])
def test_tool_over_the_joint_of_tied_bodies_is_silent(slave):
    _, reports = tool_on_halves(slave=slave)
    assert all(is_silent(report) for report in reports)


@pytest.mark.once
@pytest.mark.parametrize("interference", [0.0, 0.02])
def test_press_fit_is_silent(interference):
    data = read(rings.build, interference=interference, n_inner=40, n_outer=48)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "inner/inside", (0.0, 0.0))]
    problem = problem_of(data, [fm.ContactPair(data, "inner/outside", "outer/inside")], bcs, u)
    assert is_silent(problem.solve(accept_violations=True))


@pytest.mark.once
def test_press_fit_by_offsets_is_silent():
    """A deep interference of many facets, applied gradually."""
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


@pytest.mark.once
@pytest.mark.parametrize("angle", [10.0, 100.0, 180.0, 300.0])
def test_pressed_blocks_that_turn_together_are_silent(angle):
    """Rotated by any angle in one step, about a distant point."""
    scene = pressed_blocks(n_upper=5, n_lower=7)
    scene.loads["push"].value[:] = (0.0, -0.04)
    scene.problem.solve(accept_violations=True)
    x, crossings = scene.problem.equations.bulk.positions(), scene.problem.equations.crossings
    scene.u.x.array[scene.problem.equations.bulk.space.dofs] += turned([3.0, -2.0], angle)(x) - x
    assert crossings.passages(scene.problem.equations.motions.places) == ([], [])
    assert not [crossing for crossing in crossings.find() if crossing.facets > 0.2]


@pytest.mark.parametrize("angle", [30.0, 80.0, 170.0])
def test_ring_that_turns_on_a_shaft_is_silent(angle):
    """Straight paths would lead through the shaft."""
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
    assert problem.equations.crossings.passages(problem.equations.motions.places) == ([], [])
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
    assert problem.equations.crossings.passages(problem.equations.motions.places) == ([], [])
