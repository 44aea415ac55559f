# SPDX-License-Identifier: MIT
"""Cases of the random trial in space, equal on ranks and in all frames, and their judge."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

from demos.studies.stability import random_towers
from demos.studies.stability.random_physics import DRAWS, run_physics
from demos.studies.stability.random_towers import clipped
from demos.studies.stability.space_case import UPRIGHT, Friction, Solid, SpaceCase, Tool, moving
from demos.studies.stability.space_judge import distances, judge, nearest, winding
from demos.studies.stability.space_runs import compare, follow
from demos.studies.stability.space_scene import build, volume
from demos.studies.stability.trial import summary
from meshes.mapped_boxes import SIDES, Box, block, mapped

COMM = MPI.COMM_WORLD
FAMILIES = "towers", "patches", "plates", "tools"
# Seeds of short cases: solved again in a turned or mirrored frame and with exchanged roles, too.
SELECTED = {"towers": (3,), "patches": (3, 104), "plates": (106,), "tools": (207,)}
FLOOR = Tool("plane", np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, moving((0.0, 0.0, 0.0)))


def pressed(*, mu=0.3, cell="hexahedron", degree=1, tool=False, slide=0.02):
    """A block pressed onto a larger one or onto a plane, and moved aside."""
    upper = Box("upper", block((2, 2, 1), size=(0.6, 0.5, 0.4), corner=(-0.3, -0.25, 0.0)))
    solids = [Solid(upper, 1.0, 0.3)]
    held = {"upper/top": moving((0.0, 0.0, -0.02), (slide, 0.5 * slide, -0.02))}
    if not tool:
        lower = Box("lower", block((3, 3, 1), size=(1.0, 1.0, 0.4), corner=(-0.5, -0.5, -0.4)))
        solids.append(Solid(lower, 1.0, 0.3))
        held["lower/bottom"] = moving((0.0, 0.0, 0.0))
    pair = "upper/bottom", "floor" if tool else "lower/top"
    return SpaceCase(
        {}, solids, [pair], [Friction(mu)], held, {"floor": FLOOR} if tool else {}, cell, degree,
        2.0, 1, UPRIGHT, 0.02,
    )  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize(("family", "numbers"), SELECTED.items())
def test_random_cases_in_space_are_solved(family, numbers):
    records = [run_physics(family, number) for number in numbers]
    assert [record["outcome"] for record in records] == ["converged"] * len(records), summary(
        records
    )
    assert set(FAMILIES) == set(SELECTED) <= set(DRAWS)


@pytest.mark.serial
@pytest.mark.parametrize("family", FAMILIES)
def test_seed_gives_one_case(family):
    for number in range(8):
        abouts = [DRAWS[family](np.random.default_rng(number))[0] for _ in range(2)]
        assert repr(abouts[0]) == repr(abouts[1])
    assert repr(DRAWS[family](np.random.default_rng(9))[0]) != repr(abouts[0])


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("tool", [False, True])
def test_case_in_space_is_the_same_on_any_number_of_ranks(tool):
    case = pressed(cell="tetrahedron", tool=tool)
    alone, together = follow(case, MPI.COMM_SELF), follow(case, COMM)
    assert list(compare(alone, together, 1e-8, "on ranks")) == []
    assert alone.errors == together.errors == []


# The judge


@pytest.mark.serial
@pytest.mark.parametrize("tool", [False, True])
@pytest.mark.parametrize("spoilt", ["z", "shear", "overlap"])
def test_judge_detects_wrong_states_in_space(spoilt, tool):
    run = follow(pressed(tool=tool))
    scene, (_, before, now) = run.scene, run.positions
    assert run.errors == [] and list(judge(scene, before, now)) == []
    contact = scene.problem.equations.contacts[0]
    expected = "do not balance"
    if spoilt == "z":
        contact.change(z=1.001 * contact.z)
    elif spoilt == "shear":
        contact.change(z=contact.z * (2.0, 2.0, 1.0))
        expected = "exceeds its limit"
    else:
        nodes = np.unique(scene.triangles["upper/bottom"])
        now = now.copy()
        now[nodes, 2] -= 0.1
        expected = "facets deep in another body"
    assert any(expected in wrong for wrong in judge(scene, before, now))


@pytest.mark.serial
def test_judge_detects_friction_along_the_slip():
    run = follow(pressed(slide=0.1))
    scene, (_, before, now) = run.scene, run.positions
    back = 2.0 * now - before
    assert any("not against the slip" in wrong for wrong in judge(scene, back, now))


@pytest.mark.serial
def test_a_pressure_with_an_error_is_told_by_another_frame():
    case = pressed()
    one, other = follow(case), follow(replace(case, frame=replace(UPRIGHT, unit=7.0)))
    assert list(compare(one, other, 1e-9, "units")) == []
    other.forces[1] = 1.001 * other.forces[1]
    assert any("forces at time 2" in wrong for wrong in compare(one, other, 1e-9, "units"))
    other.springs = 0.0011
    assert list(compare(one, other, 1e-9, "units")) == []


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_surfaces_are_closed_and_outward(cell, degree):
    scene = build(pressed(cell=cell, degree=degree))
    hull = scene.X[scene.hulls["upper"]]
    size = np.einsum("nd,nd->n", hull[:, 0], np.cross(hull[:, 1], hull[:, 2])).sum() / 6.0
    assert size == pytest.approx(0.6 * 0.5 * 0.4)
    assert volume(scene.case.solids[0])[0] == pytest.approx(0.12)
    x = np.array([[0.0, 0.0, 0.2], [0.0, 0.0, -0.1], [0.29, 0.2, 0.39], [0.31, 0.2, 0.39]])
    assert np.allclose(winding(x, hull), [1.0, 0.0, 1.0, 0.0], atol=1e-9)
    _, weights, away = nearest(x, hull)
    assert np.allclose(away, [0.2, 0.1, 0.01, 0.01]) and np.allclose(weights.sum(axis=1), 1.0)


@pytest.mark.serial
def test_rings_are_closed():
    def position(s, t, r):
        angle = 2.0 * np.pi * s
        return [(1.0 + r) * np.cos(angle), t, (1.0 + r) * np.sin(angle)]

    ring = Box("ring", mapped((6, 1, 1), position), dict.fromkeys(SIDES, "ring/skin"), closed=True)
    case = replace(pressed(tool=True), solids=[Solid(ring, 1.0, 0.3)], held={})
    scene = build(replace(case, pairs=[("ring/skin", "floor")]))
    assert len(scene.X) == 6 * 2 * 2 and len(scene.hulls["ring"]) == 2 * 6 * 4


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["sphere", "cylinder", "torus", "extruded", "revolved", "plane"])
def test_distances_of_tools_are_those_of_obstacles(kind):
    """In a mirrored frame, moved and turned; inside a ring they are those of its nearest side."""
    rng = np.random.default_rng(1)
    frame = UPRIGHT.other(rng, mirrored=True)
    axis = np.array([0.6, 0.0, 0.8])
    motion = moving((0.1, -0.2, 0.3, 0.3, -0.5, 0.7), about=(0.3, 0.2, 0.1))
    point, across = np.array([0.1, 0.2, 0.3]), np.array([0.0, 1.0, 0.0])
    tool = Tool(kind, point, axis, 0.7, motion, across)
    obstacle = tool.make(frame, "tool")
    obstacle.place[:] = [*(frame.unit * frame.vector(motion.at(1.0)[:3])),
                         *frame.axial(motion.at(1.0)[3:])]  # fmt: skip
    x = rng.uniform(-2.0, 2.0, (50, 3))
    phi = obstacle.evaluate(frame.point(x))[0] / frame.unit
    assert np.allclose(tool.distance(x, 1.0), phi, atol=1e-12)


@pytest.mark.serial
def test_limit_of_a_block_is_that_of_friction_and_of_tipping():
    """Cones of 16 sides; a pull at the middle of its height."""
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    assert len(clipped(square, square + 0.25)) == 4
    area = np.column_stack([square, np.zeros(4)])
    for height, mu, limit in ((0.5, 0.3, 0.3), (2.0, 0.9, 0.5)):
        found = random_towers._factor(
            [area], np.array([[0.0, 0.0, 0.5 * height]]), np.ones(1), np.array([0.0, 0.0, -1.0]),
            (0, np.array([1.0, 0.0, 0.0])), mu, (1.0, 1.0),
        )  # fmt: skip
        assert found == pytest.approx(limit, rel=1e-6)


@pytest.mark.serial
def test_overlaps_are_measured_in_facets():
    scene = build(pressed())
    x = scene.positions()
    nodes = np.unique(scene.hulls["upper"])
    x[nodes, 2] -= 0.05
    facet = np.hypot(1 / 3, 1 / 3)
    assert distances(scene, x)["overlap"] == pytest.approx(0.05 / facet)
