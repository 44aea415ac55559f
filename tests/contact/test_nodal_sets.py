# SPDX-License-Identifier: MIT
"""Gaps, active set, size of rows and multiplier nodes, node by node, against their definition."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fenics_mortar.contact.fields import ContactFields, InterfaceFields, InterfaceState
from fenics_mortar.contact.law import Row
from fenics_mortar.contact.rows import MAX_CHANGES, ContactRows, MultiplierNodes, updated_set

RNG = np.random.default_rng(3)
N = 5  # slave nodes
UP = np.array([[0.0, 1.0]])


def test_gaps_are_means_of_covered_nodes():
    operators = SimpleNamespace(
        gap=np.array([2.0, 3.0, 4.0]), weight=np.full(3, 4.0), diagonal=np.array([1.0, 1.0, 1e-12])
    )
    state = SimpleNamespace(multiplier_nodes=np.array([True, False, True]))
    f = SimpleNamespace(operators=operators, state=state, nodal_areas=np.ones(3))
    covered, mean, per_weight = ContactFields.gaps.func(f)
    assert covered.tolist() == [True, False, False] and mean.tolist() == [0.5, 0.0, 0.0]
    assert per_weight.tolist() == [0.25, 0.0, 0.0]


def test_multipliers_are_split_along_normal_and_tangent():
    angle, z = RNG.uniform(0.0, 6.0, N), RNG.normal(size=(N, 2))
    n, tau = (np.stack([np.cos(a), np.sin(a)], axis=1) for a in (angle, angle + 0.5 * np.pi))
    operators = SimpleNamespace(n=n, tau=tau, slave=SimpleNamespace(dim=2))
    z_n, z_tau = InterfaceFields.parts.func(SimpleNamespace(operators=operators, z_u=z))
    assert np.abs(z_n[:, None] * n + z_tau[:, None] * tau - z).max() < 1e-14


def fields(gap, z, a, before, covered=True, modulus=5.0):
    """Nodes with c_n = 1 and length 1, whose law keeps the shear; normals along y."""
    gap, count = np.asarray(gap), len(z)
    pull = np.full(count, a)
    pair = SimpleNamespace(law=SimpleNamespace(bridges_gap=True, grazes=False))
    interface = SimpleNamespace(
        foundation=np.full(count, modulus), modulus=np.full(count, modulus), pair=pair,
        set_aside=np.zeros(count, bool),
    )  # fmt: skip
    return SimpleNamespace(
        interface=interface, nodal=SimpleNamespace(gap=gap), pull=Row(pull), z_n=z[:, 1],
        operators=SimpleNamespace(n=np.tile(UP, (count, 1)), x=np.full((count, 2), 10.0)),
        state=SimpleNamespace(z=z, c_n=1.0, active=np.full(count, before)),
        attracted=np.full(count, a > 0.0 and not before), covered=np.full(count, covered),
        nodal_lengths=np.full(count, 1e6),
    )  # fmt: skip


@pytest.mark.parametrize("gap, z_n, a, before, covered, active", [
    (0.1, 1.0, 0.0, False, True, True),  # 1 > 5 * 0.1
    (0.3, 1.0, 0.0, True, True, False),
    (0.1, 1.0, 0.0, True, False, False),
    (1e-14, 1e-14, 0.0, True, True, True),  # both are rounding: unchanged
    (1e-14, 1e-14, 0.0, False, True, False),
    (0.3, -2.0, 2.0, False, True, False),  # adhesion, open
    (-0.1, -2.0, 2.0, False, True, True),  # adhesion, overlapping
    (-0.1, -2.0, 1.0, True, True, False),  # pulled off: -1 < -0.5
])  # fmt: skip
def test_active_set(gap, z_n, a, before, covered, active):
    f = fields([gap], np.array([[0.5, z_n]]), a, before, covered)
    found, new = updated_set(f, start=False)
    assert found[0] == active
    expected = [0.5, z_n] if active else [0.5 * f.attracted[0], -a]
    assert new[0].tolist() == pytest.approx(expected)


def test_touching_nodes_are_active_at_the_start():
    f = fields([0.009, 0.02], np.zeros((2, 2)), 0.0, before=False)
    assert updated_set(f, start=True)[0].tolist() == [True, False]


def test_size_of_rows():
    """An active node, an open one under adhesion, an idle one."""
    active, attracted = np.array([True, False, False]), np.array([False, True, False])
    operators = SimpleNamespace(diagonal=np.array([2.0, 3.0, 4.0]), slave=SimpleNamespace(dim=2))
    f = SimpleNamespace(
        operators=operators, nodal=SimpleNamespace(gap=np.array([-0.5, 1.0, 2.0])),
        nodal_lengths=np.full(3, 0.25), interface=SimpleNamespace(stiffness=np.full(3, 8.0)),
        attracted=attracted, acts=active | attracted, state=SimpleNamespace(active=active),
        law_rows=(Row(np.full(3, 10.0)), Row(np.full(3, 0.1))),
    )  # fmt: skip
    squares, largest = ContactRows(SimpleNamespace(now=f)).measure()
    assert squares == pytest.approx(4.0**2 + 20.0**2 + 0.3**2 + 30.0**2) and largest == 2.0


def test_multiplier_nodes_stay_after_many_changes():
    """The first node has little cover, and its neighbour much."""
    sides = np.array([[-1, 1], [0, -1]])
    slave = SimpleNamespace(num_nodes=2, degree=1, along=lambda *_: sides, dim=2)
    nodes = MultiplierNodes(slave, np.tile(UP, (2, 1)), np.ones((2, 2)), at_vertices=False)
    both, cover = np.ones(2, bool), np.array([0.01, 1.0])
    for _ in range(MAX_CHANGES):
        new, changed = nodes.update(both, cover)
        assert changed == 1 and new.tolist() == [False, True]
    new, changed = nodes.update(both, cover)
    assert changed == 0 and new.all()


def test_states_of_a_pair_are_interpolated():
    """Multipliers and heat of perfect conduction; the sets are those of the first state."""
    on, off = np.ones(2, bool), np.zeros(2, bool)
    one = InterfaceState(np.zeros((2, 3)), on, 0 * on, on, off, conduction=np.array([1.0, 2.0]))
    other = replace(one, z=np.full((2, 3), 4.0), active=off, conduction=np.array([3.0, -2.0]))
    found = one.towards(other, 0.25)
    assert np.array_equal(found.z, np.full((2, 3), 1.0)) and found.active.all()
    assert np.array_equal(found.conduction, [1.5, 1.0])
