# SPDX-License-Identifier: MIT
"""Boundaries of bodies in space that move as rigid ones, moved or loaded at a point."""

import numpy as np
import pytest
from refusal import COMM, refused
from space_scenes import POISSON, YOUNG, held, of, solid
from test_space_contact import TIGHT, law_of

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.obstacles.rigid_motion import place_after, turn_between
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block

MOVED = np.array((0.01, 0.0, -0.03, 0.01, 0.02, 0.01))
TOP = ("upper/top",)
CORNER = ("upper/bottom", "upper/left")
SIDES = {"upper": ("upper/bottom", "lower/top"), "lower": ("lower/top", "upper/bottom")}


def grip_on_block(rigid=TOP, mu=0.3, slave="upper", cell="hexahedron", order=1, **options):
    """A block with a rigid boundary, its only support, on a larger one."""
    boxes = [
        Box("upper", block((3, 3, 2), size=(1, 1, 0.5), corner=(0.2, 0.2, 0.5), order=order)),
        Box("lower", block((4, 4, 2), size=(1.4, 1.4, 0.5), order=order)),
    ]
    scene = of(mapped_boxes.mesh(boxes, cell=cell, order=order), order)
    held(scene, side="lower/bottom")
    grip = fm.RigidBoundary(scene.data, list(rigid), pivot=(0.5, 0.6, 1.3), name="grip")
    pair = fm.ContactPair(scene.data, *SIDES[slave], law=law_of(mu))
    scene.set_up([pair], remote=[grip], newton=TIGHT, **options)
    return scene, grip


def move(grip):
    """Prescribe ``MOVED``."""
    grip.move(x=MOVED[0], y=MOVED[1], z=MOVED[2], angle=MOVED[3:])


@pytest.mark.once
@pytest.mark.parametrize(
    "rigid, slave, mu",
    [(TOP, "upper", 0.3), (("upper/top", "upper/left"), "upper", 0.0), (CORNER, "lower", 0.0)],
)
def test_tangent_has_slopes_of_two(rigid, slave, mu):
    """With driven motions, also where the boundary shares nodes with either side of the contact."""
    scene, grip = grip_on_block(rigid, mu, slave)
    move(grip)
    scene.problem.solve()
    load = grip.reaction
    grip.push(x=load[0], y=load[1], z=load[2], moment=load[3:])
    slopes = scene.problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes


@pytest.mark.once
@pytest.mark.parametrize(
    "algorithm, cell, order",
    [("condensed", "hexahedron", 1), ("saddle", "hexahedron", 1), ("saddle", "tetrahedron", 2)],
)
def test_forces_and_motions_have_the_same_solution(algorithm, cell, order):
    """The reaction to a prescribed motion, as a push; the block falls on the other before."""
    options = {"mu": 0.0, "algorithm": algorithm, "cell": cell, "order": order}
    (moved, grip), (driven, free) = (grip_on_block(**options) for _ in range(2))
    move(grip)
    moved.problem.solve()
    free.move(x=MOVED[0], y=MOVED[1], angle=MOVED[3:])
    free.push(z=grip.reaction[2], moment=grip.reaction[3:])
    report = driven.problem.solve()
    assert report.certificate.violations() == []
    assert any("moved rigidly until contact stopped it" in note for note in report.notes)
    assert np.abs(free.reaction - grip.reaction).max() < 1e-10 * np.abs(grip.reaction).max()
    assert np.abs(free.place - grip.place).max() < 1e-9
    ratios = [b / a for a, b in zip(report.residuals[:-1], report.residuals[1:], strict=True)]
    assert min(ratios[-2:]) < 1e-3  # the last steps are quadratic, down to rounding


def test_reaction_by_name_is_that_of_the_boundary():
    """About the present pivot; with the other support it is in equilibrium."""
    scene, grip = grip_on_block()
    move(grip)
    scene.problem.solve()
    moment = 1.2 * grip.reaction[3:]
    grip.push(z=1.1 * grip.reaction[2], moment=moment)
    scene.problem.solve()
    assert grip.reaction[3:] == pytest.approx(moment, rel=1e-10)
    about = grip.pivot + grip.place[:3]
    both = [
        np.append(*scene.problem.reaction(side, about, data=scene.data)[:2])
        for side in ("upper/top", "lower/bottom")
    ]
    size, rest = np.abs(grip.reaction).max(), np.abs(both[0] + both[1])
    assert np.abs(both[0] - grip.reaction).max() < 1e-10 * size
    assert rest[:3].max() < 1e-10 * size
    assert rest[3:].max() < 1e-4 * size  # between two surfaces moments balance to third order


@pytest.mark.parametrize(
    "slave, master", [("block/top", "bar/bottom"), ("bar/bottom", "block/top")]
)
def test_lever_on_the_edge_of_a_block(slave, master):
    """A bar with a moment about the axle at its end, which only contact stops; covers are in part.

    The certificate judges by the moment whether the pressures can balance the bar.
    """
    bar = block((12, 2, 2), size=(4.0, 0.5, 0.5), corner=(0.0, 0.1, 1.0))
    under = block((3, 3, 3), size=(0.8, 0.7, 1.0), corner=(3.0, 0.0, 0.0))
    scene = of(mapped_boxes.mesh([Box("bar", bar), Box("block", under)]), 1)
    held(scene, side="block/bottom")
    axle = fm.RigidBoundary(scene.data, "bar/left", pivot=(0.0, 0.35, 1.25))
    pair = fm.ContactPair(scene.data, slave, master, law=fm.Coulomb(0.2))
    scene.set_up([pair], remote=[axle])
    axle.push(moment=(None, 3e-4 * YOUNG, None))
    scene.problem.solve()
    contact = scene.problem.contacts[0]
    arms, sign = contact.positions - axle.pivot, 1.0 if slave == "block/top" else -1.0
    moment = sign * np.cross(arms, contact.forces).sum(axis=0)[1]
    assert moment == pytest.approx(3e-4 * YOUNG, rel=0.01)  # third order in the facet length
    assert axle.reaction[4] == pytest.approx(3e-4 * YOUNG, rel=1e-8)


def test_forces_are_derivatives_of_the_energy_of_a_twisted_bar():
    """Of all six motions of its end after a turn by more than a radian, by central differences."""
    scene = solid(counts=(2, 2, 4), jiggle=0.1, size=(0.6, 0.5, 2.0))
    held(scene)
    end = fm.RigidBoundary(scene.data, "block/top", pivot=(0.2, 0.4, 2.3), name="end")
    problem = scene.set_up(remote=[end], newton=TIGHT).problem
    psi = energies.neo_hookean(scene.u, *energies.lame(YOUNG, POISSON)) * ufl.dx(degree=4)
    energy = fem.form(psi)
    place = np.array((0.05, -0.1, 0.1, 0.2, -0.1, 1.1))
    for part in (0.25, 0.5, 0.75, 1.0):
        end.place = part * place
        problem.solve()
    force, h, found = end.reaction.copy(), 1e-4, np.empty(6)
    for i, motion in enumerate(np.eye(6)):
        ends = []
        for sign in (1.0, -1.0):
            end.place = place_after(place, sign * h * motion, 1.0)
            problem.solve()
            ends.append(COMM.allreduce(fem.assemble_scalar(energy)))
        found[i] = (ends[0] - ends[1]) / (2.0 * h)
    assert np.abs(force - found).max() < 1e-6 * np.abs(force).max()  # 1e-8: h^2
    end.push(moment=(None, None, 0.9 * force[5]))  # on an axle
    report = problem.solve()
    assert end.reaction[5] == pytest.approx(0.9 * force[5], rel=1e-10)
    assert report.residuals[-1] < 1e-3 * report.residuals[-2] + 1e-14
    turn = turn_between(place[3:], end.place[3:])
    assert np.abs(turn[:2]).max() < 1e-12 and turn[2] < -0.05


def test_free_block_turns_with_its_boundary():
    """A finite rotation of a body that only this boundary supports needs no force."""
    scene = solid(counts=(2, 2, 2))
    grip = fm.RigidBoundary(scene.data, "block/bottom", pivot=(0.0, 0.0, 0.0), name="grip")
    problem = scene.set_up(remote=[grip], newton=TIGHT).problem
    grip.move(x=0.3, angle=(0.4, 0.5, -1.2))
    problem.solve()
    assert np.abs(grip.reaction).max() < 1e-9
    space = problem.equations.bulk.space
    moved = grip.displacement(space.positions()[space.dofs])
    assert np.abs(scene.u.x.array[space.dofs] - moved).max(initial=0.0) < 1e-9


def test_what_is_refused():
    scene = solid(counts=(2, 2, 2))
    with refused(ValueError, "expected three finite numbers"):
        fm.RigidBoundary(scene.data, "block/top", pivot=(0.0, 0.0))
    grip = fm.RigidBoundary(scene.data, "block/top", pivot=(0.0, 0.0, 0.0))
    with refused(ValueError, "one of them and None for the others"):
        grip.push(moment=(1.0, 2.0, None))
