# SPDX-License-Identifier: MIT
"""Active sets: complementarity, touching nodes, nodes without partner, weight c_n, merged sets."""

import numpy as np
import pytest
from scenes import pressed_blocks

import fenics_mortar as fm

MESH = {"n_upper": 7, "n_lower": 9, "layers_upper": 3, "layers_lower": 3}


@pytest.mark.once
def test_touching_nodes_are_active_at_the_start_and_open_ones_are_not():
    touching = pressed_blocks(**MESH)
    touching.problem.equations.evaluate(start=True)
    assert touching.contact.active.all()
    opened = pressed_blocks(gap=0.01, **MESH)
    opened.problem.equations.evaluate(start=True)
    assert not opened.contact.active.any()
    assert opened.contact.gap == pytest.approx(0.01, rel=1e-10)


def test_node_without_partner_has_no_gap_and_is_never_active():
    scene = pressed_blocks(slave="lower", **MESH)
    scene.contact.change(z=np.tile([0.0, 1e3], (len(scene.contact.z), 1)))
    scene.problem.equations.evaluate(start=True)
    alone = ~scene.contact.covered
    assert alone.any() and np.isnan(scene.contact.gap[alone]).all()
    assert not scene.contact.active[alone].any()


def test_complementarity_holds_at_each_node():
    scene = pressed_blocks(gap=0.02, rotation=0.3, **MESH)
    turn = np.array([np.sin(0.3), -np.cos(0.3)])
    scene.loads["push"].value[:] = 0.05 * turn
    scene.problem.solve()
    contact = scene.contact
    assert (contact.pressure >= 0.0).all()
    assert (contact.gap > -1e-12).all()
    assert np.abs(contact.pressure * contact.gap).max() < 1e-10 * contact.pressure.max()


@pytest.mark.once
@pytest.mark.parametrize("c_n", [1e-8, 1e-5, 1.0, 1e3, 1e8])
def test_result_does_not_depend_on_the_weight_of_the_gap(c_n):
    """If the weight is too large, active sets cycle: the cycle is ended and recorded."""
    pressures, reports = [], []
    for value in (1e-3, c_n):
        scene = pressed_blocks(pair={"c_n": value}, gap=0.01, **MESH)
        scene.loads["push"].value[:] = (0.01, -0.06)
        reports.append(scene.problem.solve())
        pressures.append(scene.contact.pressure)
    assert np.abs(pressures[0] - pressures[1]).max() < 1e-10 * pressures[0].max()
    if c_n <= 1.0:
        assert abs(reports[0].num_iterations - reports[1].num_iterations) <= 1
        assert not reports[1].notes
    else:
        assert "does not converge" in reports[1].table()


def test_merged_sets_contain_all_nodes_of_the_cycle():
    scene = pressed_blocks(gap=0.01, **MESH)
    problem, contact = scene.problem, scene.contact
    problem.equations.evaluate(start=True)
    for node in (1, 2):
        at = np.arange(len(contact.z))[:, None] == node
        contact.change(z=np.where(at, 1e6 * contact.operators.n, 0.0))
        problem.equations.evaluate(start=False)
    assert contact.active_nodes.tolist() == [2]
    assert "last 2 iterations" in problem.equations.remedies.merge_sets(2)
    assert contact.active_nodes.tolist() == [1, 2]
    assert contact.c_n <= 1e-3


def test_total_force_is_the_sum_of_nodal_forces():
    scene = pressed_blocks(**MESH)
    scene.loads["push"].value[1] = -0.05
    scene.problem.solve()
    on_slave, _ = scene.contact.operators.force(scene.contact.z)
    assert np.abs(scene.contact.total_force + on_slave.sum(axis=0)).max() < 1e-13
    assert scene.contact.total_force[1] > 0.0  # the upper block is pushed up


@pytest.mark.once
def test_node_with_growing_cover_stays_active(monkeypatch):
    """An edge slides by a facet, and the cover of the node under it increases strongly.

    The linear system contains the nodal force; by its multiplier alone, which is tensile, the node
    would open and close again two iterations later.
    """
    scene = pressed_blocks(slave="lower", pair={"law": fm.Coulomb(0.3)}, **MESH)
    contact, facet = scene.contact, scene.contact.slave.nodal_lengths.max()
    for push in ((0.04, -0.05), (0.04, -0.1)):
        scene.loads["push"].value[:] = push
        scene.problem.solve()
    edge = contact.active_nodes[0]
    before = contact.operators.cover[edge]
    look, active = scene.problem.equations.evaluate, []

    def note(*, start):
        status = look(start=start)
        active.append(contact.active[edge])
        return status

    monkeypatch.setattr(scene.problem.equations, "evaluate", note)
    scene.loads["push"].value[:] = (0.04 + 0.9 * facet, -0.1)
    scene.problem.solve()
    assert contact.operators.cover[edge] > 3.0 * before
    assert all(active)


@pytest.mark.serial
def test_force_of_a_node_with_growing_cover_is_w_z_to_first_order(monkeypatch):
    """(w + dw) z for z = z_old, and the change of z times the old weight."""
    scene = pressed_blocks(slave="lower", pair={"law": fm.Coulomb(0.3)}, **MESH)
    contact, equations, u = scene.contact, scene.problem.equations, scene.u
    facet, moved = contact.slave.nodal_lengths.max(), []
    for push in ((0.04, -0.05), (0.04, -0.1)):
        scene.loads["push"].value[:] = push
        scene.problem.solve()
    move, linearize, begun = contact.move, equations.linearize, []

    def begin():
        begun.append(u.x.array.copy())
        linearize()

    def note(z, fraction, step):
        old, weight = contact.z.copy(), contact.operators.weight.copy()
        move(z, fraction, step)
        if contact.state.force_decided is not None:
            moved.append(
                (begun[-1], old, weight, fraction * step, contact.z, contact.state.force_decided)
            )

    monkeypatch.setattr(contact, "move", note)
    monkeypatch.setattr(equations, "linearize", begin)
    scene.loads["push"].value[:] = (0.04 + 0.9 * facet, -0.1)
    scene.problem.solve()
    moved = [each for each in moved if each[-1][0].any()]
    u0, old, weight, step, z, (presses, force) = moved[0]
    part = 1e-6  # well above rounding, 1e-10, and below the next segment
    contact.evaluate(u0 + part * step, equations.linearization)
    growth = (contact.operators.weight - weight) / part
    expected = weight[:, None] * z + growth[:, None] * old
    assert force[presses] == pytest.approx(expected[presses], rel=1e-4)


@pytest.mark.once
def test_operators_belong_to_the_multiplier_nodes(monkeypatch):
    """If a node's function is handed over or returned, all operators are integrated again."""
    scene = pressed_blocks(gap=0.01, **{**MESH, "layers_lower": 1})
    contact, equations, u = scene.contact, scene.problem.equations, scene.u
    X = u.function_space.tabulate_dof_coordinates()
    upper, changes = X[:, 1] > 1.005, 0
    for shift in np.linspace(0.0, 1.2, 49):
        u.x.array[::2][upper] = shift
        before = contact.multiplier_nodes.copy()
        equations.evaluate(start=False)
        changes += (before != contact.multiplier_nodes).any()
        found = contact.operators
        contact.evaluate(u.x.array, equations.linearization)
        for name in ("D", "gap", "weight", "diagonal"):
            again = getattr(contact.operators, name)
            assert np.array_equal(getattr(found, name), again, equal_nan=True), name
    assert changes > 2
