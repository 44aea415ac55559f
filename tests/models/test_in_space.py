# SPDX-License-Identifier: MIT
"""Errors of plane and axisymmetric models, from the problem in space."""

import numpy as np
import pytest
import space_scenes
from dimension_scenes import (
    FRAME,
    blocks_in_space,
    plane_blocks,
    plane_stress,
    plane_strip,
    ring_in_space,
    ring_of_revolution,
    strain_across,
    strip_in_space,
)
from heat_scenes import stacked_in_space

import fenics_mortar as fm
from fenics_mortar.bulk.cells import triangulate
from fenics_mortar.models.in_space import Section, extrapolate
from fenics_mortar.models.model_error import ENERGY, FORCE, PEAK, QUANTITIES
from fenics_mortar.obstacles.rigid_motion import rotation_by


def judged(plane, in_space):
    """Estimated and true errors of a plane problem."""
    plane.solve()
    check = fm.ModelCheck(0.02, in_space=in_space)
    check.prepare(plane)
    found = check.assess(plane).assumptions[-1]
    in_space._solid.solve()
    return found, in_space.compare(plane).errors


def in_space_of(plane, solid, kind):
    strain = strain_across(plane.equations.bulk.u) if kind == "stress" else None
    return fm.InSpace(solid, **FRAME, strain=strain)


@pytest.mark.parametrize("thickness", [0.1, 0.5, 8.0])
@pytest.mark.parametrize("kind", ["strain", "stress"])
def test_estimates_for_strips_of_a_thickness(kind, thickness):
    """Thin and thick ones: the estimate finds the better one of plane strain and plane stress."""
    plane = plane_strip(stress=plane_stress if kind == "stress" else None)
    solid = strip_in_space(thickness)
    before = solid.state()
    found, true = judged(plane, in_space_of(plane, solid, kind))
    assert found.name == f"plane {kind}" and "differs by" in found.indicator
    for name in QUANTITIES:
        assert 0.9 < found.errors[name] / true[name] < 1.1, (name, true, found.errors)
    if thickness == 0.1 and kind == "stress":  # pressures act on the widened strip, forces do not
        assert true[FORCE] < 0.01
    if thickness != 0.5:
        assert (true[ENERGY] < 0.22) == ((kind == "stress") == (thickness == 0.1))
    assert not before.u.any()


@pytest.mark.once
@pytest.mark.parametrize(
    "cells, order, law",
    [(("quadrilateral", "hexahedron"), 1, None), (("triangle", "tetrahedron"), 2, fm.Coulomb(0.3))],
)
def test_estimates_at_finite_strain(cells, order, law):
    """A fifth of the height is pressed in; the estimate ends before it has converged."""
    options = {"depth": 0.1, "finite": True, "order": order, "law": law}
    plane = plane_strip(cell=cells[0], **options)
    solid = strip_in_space(0.5, cell=cells[1], **options)
    found, true = judged(plane, fm.InSpace(solid, **FRAME))
    for name in QUANTITIES:
        assert 0.7 < found.errors[name] / true[name] < 1.4, (name, true, found.errors)


@pytest.mark.parametrize("order, law", [(1, None), (2, None), (1, fm.Coulomb(0.3))])
def test_plane_strain_between_held_faces_is_exact(order, law):
    """On the extruded mesh nothing is left, also of a path with slip that is reversed.

    With friction and quadratic facets it is not: slip up to the first contact, which sticks, is
    measured differently on these, by 1 % of the energy.
    """
    solid = strip_in_space(0.3, depth=0.0, layers=1, law=law, held=True, order=order)
    check = fm.ModelCheck(1e-4, in_space=fm.InSpace(solid, **FRAME))
    plane = plane_strip(depth=0.0, law=law, order=order, model_check=check)
    for x, y in ((0.0, -0.01), (0.01, -0.03), (0.04, -0.04), (0.0, -0.03)):
        plane.obstacles[0].move(x=x, y=y)
        solid.obstacles[0].move(x=x, z=y)
        before = solid.state()
        report = plane.solve().model_check
        errors = report.assumptions[-1].errors
        assert max(errors.values()) < 5e-5, (x, y, errors)
        after = solid.state()
        assert np.array_equal(before.u, after.u) and np.array_equal(before.places, after.places)
        assert before.interfaces[0].partners is after.interfaces[0].partners
    assert report.verdict(report.assumptions[-1]) == "enough"


@pytest.mark.serial
@pytest.mark.parametrize("tilt", [0.0, 0.005])
def test_estimates_for_a_ring_under_a_tilted_tool(tilt):
    """A tilt changes pressures, hardly the force; 20 facets around have 1.6 % less area."""
    solid, plane = ring_in_space(tilt=tilt), ring_of_revolution()
    found, true = judged(plane, fm.InSpace(solid))
    assert found.name == "axisymmetric"
    for name in QUANTITIES:
        assert 0.9 < found.errors[name] / true[name] < 1.1, (name, true, found.errors)
    area = 10.0 / np.pi * np.sin(np.pi / 10.0)
    assert true[FORCE] == pytest.approx(1.0 / area - 1.0, rel=0.15)
    assert (true[PEAK] > 0.1) == (tilt > 0.0)


def test_steps_in_space_that_fail(monkeypatch):
    """The problem in space tells nothing then, also not a displacement."""
    plane, solid = plane_strip(), strip_in_space(0.5)

    def fails(*_):
        solid.equations.bulk.values[:] = 1.0
        raise fm.MortarError("no step")

    monkeypatch.setattr("fenics_mortar.models.model_error.take_steps", fails)
    plane.solve()
    found = in_space_of(plane, solid, "strain").estimate(plane)
    assert found.indicator == "the steps in space fail" and np.isinf(found.errors[ENERGY])
    assert not solid.equations.bulk.values.any()


@pytest.mark.once
def test_estimate_on_a_mesh_that_is_not_revolved():
    """A disc of bricks whose nodes are anywhere; the difference of the meshes is an error, too."""
    found, true = judged(ring_of_revolution(hole=0.0), fm.InSpace(ring_in_space(hole=0.0)))
    for name in QUANTITIES:
        assert 0.9 < found.errors[name] / true[name] < 1.1, (name, true, found.errors)


def test_points_outside_take_the_nearest_values():
    """Of a linear field: on all sides and at a corner of the strip, and inside; on any rank."""
    space = plane_strip().equations.bulk.space
    body = triangulate(space, np.arange(len(space.V.tabulate_dof_coordinates())))
    field = np.stack([2.0 * body.X[:, 0] - body.X[:, 1], body.X[:, 1]], axis=1)
    points = np.array([(0.3, 0.2), (0.37, 0.6), (-1.1, 0.21), (1.3, 0.9), (0.1, -0.2)])
    on = np.array([(0.3, 0.2), (0.37, 0.5), (-1.0, 0.21), (1.0, 0.5), (0.1, 0.0)])
    found, distances = extrapolate(body, field, points)
    assert found == pytest.approx(
        np.stack([2.0 * on[:, 0] - on[:, 1], on[:, 1]], axis=1), rel=1e-12
    )
    assert distances == pytest.approx([0.0, 0.1, 0.1, 0.5, 0.2], abs=1e-12)
    nowhere, none = extrapolate(body, field, points[: 2 * (body.comm.rank == 0)])
    assert len(nowhere) == len(none) == 2 * (body.comm.rank == 0)


def test_place_of_an_obstacle_in_space():
    """Translations along the section, an angle about the axis that carries e_1 to e_2."""
    section = Section(**FRAME, origin=(1.0, 2.0, 3.0))
    place = section.place_in_space(np.array([0.1, 0.2, 0.5]))
    assert place == pytest.approx([0.1, 0.0, 0.2, 0.0, -0.5, 0.0])
    assert rotation_by(place[3:])[:, 0] == pytest.approx([np.cos(0.5), 0.0, np.sin(0.5)])
    revolved = Section((0.0, 3.0, 0.0), FRAME["first"], (0.0, 0.0, 0.0), revolved=True)
    assert revolved.place_in_space(np.array([0.0, 0.2, 0.0])) == pytest.approx([0, 0.2, 0, 0, 0, 0])


def test_driven_obstacle_of_the_plane_starts_in_its_place():
    """A roller under a force per length sinks as deep in space, if the faces are held."""
    solid = strip_in_space(0.3, depth=0.0, layers=1, held=True)
    check = fm.ModelCheck(in_space=fm.InSpace(solid, **FRAME))
    plane = plane_strip(depth=0.0, model_check=check)
    plane.obstacles[0].push(y=-2.0)
    solid.obstacles[0].push(z=-2.0 * 0.15)
    errors = plane.solve().model_check.assumptions[-1].errors
    assert plane.obstacles[0].place[1] < -0.01 and not solid.obstacles[0].place.any()
    assert max(errors.values()) < 5e-5


@pytest.mark.parametrize("kind", [fm.ContactPair, fm.TiedPair])
def test_two_bodies_at_one_interface(kind):
    """Each takes the displacement of its own body, also where both have nodes at one position.

    Between held faces contact is as in the plane; a tie has no multipliers on them.
    """
    push = (0.01, -0.02)
    for held in (True, False):
        solid, plane = blocks_in_space(kind, push, held=held), plane_blocks(kind, push)
        found, true = judged(plane, fm.InSpace(solid, **FRAME))
        for name in QUANTITIES:
            if held and kind is fm.ContactPair:
                assert found.errors[name] < 1e-5, found.errors
            else:
                assert 0.9 < found.errors[name] / true[name] < 1.1, (name, true, found.errors)


def test_other_places_and_pairs_are_refused():
    plane, solid = plane_strip(), strip_in_space(0.5, shift=0.3)
    plane.solve()
    with pytest.raises(fm.MeshError, match="0.3 away from the bodies of the plane problem"):
        fm.InSpace(solid, **FRAME).estimate(plane)
    with pytest.raises(ValueError, match="expected one on a mesh of solids"):
        fm.InSpace(plane)
    with pytest.raises(ValueError, match="not along the axis"):
        fm.InSpace(solid, axis=(1, 0, 0), first=(2, 0, 0)).prepare(plane)
    with pytest.raises(ValueError, match="this one is in space"):
        fm.InSpace(solid).prepare(solid)
    with pytest.raises(ValueError, match="expected None"):
        strain = strain_across(plane.equations.bulk.u)
        fm.InSpace(solid, strain=strain).prepare(ring_of_revolution())
    heated = stacked_in_space().problem([])
    with pytest.raises(ValueError, match="unknowns other than the displacement"):
        fm.InSpace(heated)
    with pytest.raises(ValueError, match="has 0 pairs, this one 1"):
        fm.InSpace(space_scenes.pressed().set_up().problem).prepare(plane)
    with pytest.raises(fm.MortarError, match="not solved"):
        fm.InSpace(solid, **FRAME).compare(plane)
    with pytest.raises(ValueError, match="in_space=.*: expected an InSpace"):
        fm.ModelCheck(in_space=solid)


def test_slaves_must_be_the_same():
    """The strip's left side instead of its top."""
    plane, solid = plane_strip(), strip_in_space(0.5)
    plane.solve()
    beside = fm.Plane((-2.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    pair = solid.equations.contacts[0].pair
    other = fm.ContactProblem(
        solid.equations.bulk.residual, solid.equations.bulk.u,
        [fm.ContactPair(pair.data, "strip/left", beside)], bcs=solid.equations.bulk.bcs[1:],
        petsc_options_prefix="other_",
    )  # fmt: skip
    with pytest.raises(fm.MeshError, match="slave 'strip/left': the node at .* is not on"):
        fm.InSpace(other, **FRAME).estimate(plane)
