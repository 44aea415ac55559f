# SPDX-License-Identifier: MIT
"""Contact of a surface with itself, and of surfaces that may all touch each other."""

import numpy as np
import pytest
from scenes import nodal
from self_scenes import c_ring, flattened_tube, strip_in_s, ten_bodies, tube

import fenics_mortar as fm

MU = fm.Coulomb(0.3)
ENDS = ["ring/first", "ring/last"]
RING = [*ENDS, "ring/top", "ring/bottom"]


def close(pairs, **options):
    """A ring whose ends are pressed together and along each other."""
    ring = c_ring(pairs, **options)
    ring.move(10, high=np.array([0.01, -0.18]))
    return ring


def with_itself(names, **options):
    return lambda data: [fm.ContactPair(data, names, **options)]


def imbalance(scene):
    """Resultant of the contact forces on slave and master nodes over their norms."""
    total, size = np.zeros(2), 0.0
    for contact in scene.problem.equations.contacts:
        for force in contact.operators.force(contact.z):
            total += force.sum(axis=0)
            size += np.abs(force).sum()
    return np.abs(total).max() / size


@pytest.mark.parametrize("law", [None, MU])
def test_ends_of_a_ring_agree_with_chosen_sides(law):
    """Two surfaces that may touch: the first one in the order is the slave."""
    chosen = close(lambda data: [fm.ContactPair(data, *ENDS, law=law)])
    found = close(with_itself(ENDS, law=law))
    assert found.problem.certificate().violations() == []
    assert found.contact.active.sum() == chosen.contact.active.sum() >= 3
    assert np.allclose(*(nodal(s.problem) for s in (found, chosen)), atol=1e-11)
    assert found.forces() == pytest.approx(chosen.forces(), rel=1e-9)
    assert imbalance(found) < 1e-12


@pytest.mark.once
def test_whole_outline_of_a_ring_agrees_with_chosen_sides():
    """Corners of the ends are inside of the surface; sides may be chosen either way."""
    both = [close(lambda data, e=e: [fm.ContactPair(data, *e)]) for e in (ENDS, ENDS[::-1])]
    whole = close(with_itself(RING))
    forces = [scene.forces()[0] for scene in both]
    assert whole.problem.certificate().violations() == []
    assert abs(whole.forces()[0] - np.mean(forces)) <= np.ptp(forces)
    slopes = whole.problem.check_tangent().slopes
    assert slopes["whole"] == pytest.approx(2.0, abs=0.05)


@pytest.mark.once
@pytest.mark.parametrize("order", [1, 2])
def test_strip_folded_into_an_s_touches_on_both_sides(order):
    """The middle arm is a master of the lower one, and a slave or master of the upper one."""
    strip = strip_in_s(with_itself("strip/outline"), order=order)
    strip.move(10, high=np.array([0.0, -0.25]))
    assert strip.problem.certificate().violations() == []
    o, contact = strip.contact.operators, strip.contact
    heights = np.sort(o.x[contact.active][:, 1])
    assert (np.diff(heights) > 0.04).sum() == 1  # two levels
    assert imbalance(strip) < 1e-12
    slopes = strip.problem.check_tangent().slopes
    assert slopes["whole"] == pytest.approx(2.0, abs=0.1)


@pytest.mark.once
def test_facets_are_no_masters_of_neighbours_or_of_their_masters():
    surface = strip_in_s(with_itself("strip/outline")).contact.slave
    count = len(surface.facets)
    masters = surface.roles.masters_of(np.arange(count))
    assert not (masters & masters.T).any()
    either = masters | masters.T
    near = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    near = np.minimum(near, count - near)  # facets are in order along the one closed curve
    assert not either[near <= 1].any() and either[near > 5].all()


@pytest.mark.once
def test_result_is_independent_of_node_numbers():
    one, other = (close(with_itself(RING), reverse=reverse) for reverse in (False, True))
    assert np.allclose(one.contact.slave.X, other.contact.slave.X, atol=1e-14)
    assert np.array_equal(one.contact.active, other.contact.active)
    assert np.allclose(one.contact.operators.x, other.contact.operators.x, atol=1e-11)


def test_start_of_a_hole_has_no_multiplier():
    """Roles change at this node; where nodes meet, the gap would be constrained twice."""
    inside = tube(with_itself("tube/inside")).contact
    assert (~inside.multiplier_nodes).sum() == 1
    assert np.allclose(inside.slave.X[~inside.multiplier_nodes], [[-0.85, 0.0]])
    outside = tube(with_itself("tube/outside")).contact
    assert outside.multiplier_nodes.sum() == outside.slave.num_nodes - num_prescribed(outside)


def num_prescribed(contact):
    return int((contact.free == 0.0).all(axis=1).sum())


@pytest.mark.once
@pytest.mark.parametrize("upright", [True, False])
def test_tube_pinched_until_its_inside_touches(upright):
    """If the tube lies on its side, roles change in the middle of the contact."""
    pinched = tube(with_itself("tube/inside"), upright=upright)
    displacement = np.array([0.0, 0.88]) if upright else np.array([0.88, 0.0])
    pinched.move(12, high=-displacement, low=displacement)
    assert pinched.problem.certificate().violations() == []
    assert pinched.contact.active.any() and pinched.forces()[0] > 1.0
    assert imbalance(pinched) < 1e-12


@pytest.mark.once
@pytest.mark.serial
def test_tube_pressed_flat_between_planes():
    """With friction: the inside touches itself over most of its length, first in the middle."""
    flat, path = flattened_tube(MU)
    assert path.num_cuts == 0
    assert flat.problem.certificate().violations() == []
    assert flat.contact.active.sum() > 20 and flat.contact.slave.num_nodes == 64
    slopes = flat.problem.check_tangent().slopes
    assert slopes["whole"] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("options", [{"integration": "elements"}, {"integration": "nodes"}])
def test_other_integrations_are_refused(options):
    with pytest.raises(ValueError, match="without a master"):
        tube(with_itself("tube/inside", discretization=fm.Discretization(**options)))


@pytest.mark.serial
def test_ten_bodies_that_may_all_touch():
    """All outlines are one list; numbers of 1 rank, equal on 2 and 3 (146.8 in 32 steps)."""
    stack = ten_bodies(lambda data, names: [fm.ContactPair(data, names, law=MU)], foundation=10.0)
    stack.move(4, high=np.array([0.0, -0.12]))
    contact = stack.contact
    assert stack.problem.certificate().violations() == []
    assert contact.active.sum() == 87
    assert np.abs(contact.z).sum() == pytest.approx(145.849247, rel=1e-6)
    assert imbalance(stack) < 1e-13
