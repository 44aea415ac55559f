# SPDX-License-Identifier: MIT
"""Sections under pretension in space: bolt and plates as two springs, heads that do not touch."""

import numpy as np
import pytest
from heat_scenes import heated
from refusal import refused
from space_scenes import YOUNG, Solid, held, of
from test_space_contact import TIGHT

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block, mapped

PRELOAD, EXTERNAL = 0.2, 0.15


def joint(cell, order):
    """A bolt of two halves beside two plates in contact, without Poisson's effect.

    Returns:
        The scene, the section, the rigid boundary on the tops of both, and both stiffnesses.
    """
    areas, half = (0.5 * 0.5, 1.5 * 1.0), 1.0
    shape = {"nut": (0.0, 0.0), "bolt": (0.0, half), "plate": (1.0, 0.0), "cover": (1.0, half)}
    boxes = []
    for name, (x, z) in shape.items():
        size = (0.5, 0.5, half) if x == 0.0 else (1.5, 1.0, half)
        counts = (2, 2, 2) if name in ("nut", "plate") else (2, 1, 1)
        boxes.append(Box(name, block(counts, size=size, corner=(x, 0.0, z), order=order)))
    data = mapped_boxes.mesh(boxes, cell=cell, order=order)
    u = fem.Function(fm.vector_space(data.mesh, order))
    psi = energies.linear_elastic(u, *energies.lame(YOUNG, 0.0)) * ufl.dx(degree=4)
    scene = Solid(data, u, ufl.derivative(psi, u), [])
    for side in ("nut/bottom", "plate/bottom"):
        held(scene, side=side)
    section = fm.Pretension(data, slave="bolt/bottom", master="nut/top", name="bolt")
    top = fm.RigidBoundary(data, ["bolt/top", "cover/top"], pivot=(0.7, 0.3, 2.0), name="top")
    pair = fm.ContactPair(data, "cover/bottom", "plate/top")
    scene.set_up([section, pair], remote=[top], newton=TIGHT)
    return scene, section, top, [YOUNG * area / (2.0 * half) for area in areas]


@pytest.mark.parametrize("cell, order", [("hexahedron", 1), ("tetrahedron", 2)])
def test_bolt_and_plates_share_an_external_load_as_two_springs(cell, order):
    """Bars without Poisson's effect: stiffness, shortening and F_0 + F k_b / (k_b + k_p)."""
    scene, bolt, top, (k_b, k_p) = joint(cell, order)
    top.push(z=0.0)
    bolt.push(PRELOAD)
    report = scene.problem.solve()
    assert report.certificate.violations() == []
    assert bolt.axis == pytest.approx((0.0, 0.0, -1.0), abs=1e-12)
    assert bolt.force == pytest.approx(PRELOAD, rel=1e-12)
    assert bolt.shortening == pytest.approx(PRELOAD * (1.0 / k_b + 1.0 / k_p), rel=1e-8)
    assert scene.problem.contacts[1].total_force[2] == pytest.approx(PRELOAD, rel=1e-10)
    assert any("section 'bolt', shortened by" in note for note in report.notes)
    bolt.lock()
    top.push(z=EXTERNAL)
    scene.problem.solve()
    assert bolt.force == pytest.approx(PRELOAD + EXTERNAL * k_b / (k_b + k_p), rel=1e-8)
    top.push(z=2.0)  # the plates separate: the bolt carries the load alone
    scene.problem.solve()
    assert bolt.force == pytest.approx(2.0, rel=1e-9)
    assert not scene.problem.contacts[1].pressure.any()


def jack(gap=0.1):
    """A column of two halves, pushed apart at its section, below a rigid plane at a gap."""
    boxes = [
        Box("lower", block((2, 2, 2), size=(1.0, 1.0, 1.0))),
        Box("upper", block((2, 2, 2), size=(1.0, 1.0, 1.0), corner=(0.0, 0.0, 1.0))),
    ]
    scene = of(mapped_boxes.mesh(boxes))
    held(scene, side="lower/bottom")
    section = fm.Pretension(scene.data, "upper/bottom", "lower/top", name="jack")
    plane = fm.Plane((0.5, 0.5, 2.0 + gap), (0.0, 0.0, -1.0))
    pair = fm.ContactPair(scene.data, "upper/top", plane, law=fm.Coulomb(0.3))
    scene.set_up([section, pair], newton=TIGHT)
    return scene, section, plane


def test_column_is_pushed_apart_until_it_touches():
    """Its upper half floats along the axis; the elongation that is found has the same force."""
    scene, section, plane = jack()
    section.push(-0.5)
    report = scene.problem.solve()
    assert report.certificate.violations() == []
    assert any("was moved rigidly until contact stopped it" in note for note in report.notes)
    assert section.force == pytest.approx(-0.5, rel=1e-10)
    assert plane.reaction[2] == pytest.approx(0.5, rel=1e-9)
    assert 0.1 < -section.shortening < 0.3
    slopes = scene.problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes
    other, moved, _ = jack()
    moved.move(section.shortening)
    other.problem.solve()
    assert moved.force == pytest.approx(-0.5, rel=1e-6)  # slip is counted from another place


def test_push_that_nothing_resists_names_section_and_body():
    scene, section, _ = jack()
    section.push(0.5)
    with refused(fm.NotConvergedError, "can be shortened at section 'jack'"):
        scene.problem.solve()


def test_axis_is_the_normal_of_the_slave_or_given():
    """An inclined axis is scaled; a section that is not flat needs one."""
    wavy = [
        mapped((2, 2, 1), lambda s, t, r, low=low: (s, t, low + r * (1 - low) + 0.2 * s * s))
        for low in (0.0, 1.0)
    ]
    wavy[1][..., 2] += np.arange(2)[None, None] * 1.0
    data = mapped_boxes.mesh([Box("lower", wavy[0]), Box("upper", wavy[1])])
    u = fem.Function(fm.vector_space(data.mesh, 1))
    for axis, expected in (((0.0, -3.0, -4.0), (0.0, -0.6, -0.8)), (None, None)):
        psi = energies.neo_hookean(u, *energies.lame(YOUNG, 0.3)) * ufl.dx(degree=4)
        scene = Solid(data, u, ufl.derivative(psi, u), [])
        held(scene, side="lower/bottom")
        section = fm.Pretension(data, "upper/bottom", "lower/top", axis=axis)
        if axis is None:
            with refused(fm.SurfaceError, "is not straight: give the axis="):
                scene.set_up([section])
            continue
        scene.set_up([section])
        assert section.axis == pytest.approx(expected)
    with refused(ValueError, "axis is zero"):
        fm.Pretension(data, "upper/bottom", "lower/top", axis=(0.0, 0.0, 0.0))


def test_heat_through_a_bolted_stack():
    """The hot cover extends beyond the plate; its bolt alone holds it, and is a load in the check.

    Bars in series: q = T / (2 L / k + 1 / h(p)), through bolt and stack.
    """
    names = {"plate": (0.0, 0.0, 1.0), "cover": (0.0, 1.0, 1.0)}
    names |= {"nut": (2.0, 0.0, 0.5), "bolt": (2.0, 1.0, 0.5)}
    boxes = []
    for number, (name, (x, z, width)) in enumerate(names.items()):
        counts = (3 + number, 3 + number, 2) if x == 0.0 else (number, number, 2)
        cells = block(counts, size=(width, width, 1.0), corner=(x, 0.0, z))
        boxes.append(Box(name, cells))
    scene = heated(boxes, nu=0.0, alpha=1e-4, conductivity=5.0)
    scene.hold("bottom", ["plate/bottom", "nut/bottom"])
    scene.prescribe("cold", ["plate/bottom", "nut/bottom"], 1)
    scene.prescribe("hot", ["cover/top", "bolt/top"], 1)
    heat = fm.Conductance(1, fm.PressureConductance(20.0, pressure=1.0))
    pair = fm.ContactPair(scene.data, "cover/bottom", "plate/top", fluxes=[heat])
    bolt = fm.Pretension(scene.data, slave="bolt/bottom", master="nut/top", fields=[1])
    top = fm.RigidBoundary(scene.data, ["cover/top", "bolt/top"], pivot=(0.5, 0.5, 2.0))
    problem = scene.problem([bolt, pair], remote=[top], newton=TIGHT)
    scene.set(hot=100.0)
    top.push(z=0.0)
    bolt.push(1.0)
    report = problem.solve()
    assert report.certificate.violations() == []
    through = [view.fluxes[0].into_master for view in problem.contacts]
    assert through == pytest.approx([100.0 / 0.4 * 0.25, 100.0 / (0.4 + 1.0 / 20.0)], rel=0.01)
