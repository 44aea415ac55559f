# SPDX-License-Identifier: MIT
"""States are values: frozen, listed once, replaced by one method, and restored bit for bit."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from scenes import neo_hookean, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.contact.fields import InterfaceState
from fenics_mortar.equations.general import State

PARTS = {field.name for field in fields(InterfaceState)}
# Attributes that may be set, and those that an interface has in its state only.
NOT_SHOWN = {
    "offset", "c_n", "reference", "force_decided", "load_time", "start_instant", "conduction",
}  # fmt: skip


@pytest.mark.parametrize("kind", [State, InterfaceState])
def test_states_are_frozen(kind):
    problem = pressed_blocks(n_upper=3, n_lower=4).problem
    state = problem.state() if kind is State else problem.state().interfaces[0]
    for field in fields(state):
        with pytest.raises(AttributeError):
            setattr(state, field.name, None)
        value = getattr(state, field.name)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable, field.name
    if kind is State:
        positions = problem.state().accepted_positions
        assert not positions.x.flags.writeable and not positions.places.flags.writeable


@pytest.mark.parametrize("name", sorted(PARTS - NOT_SHOWN))
def test_interface_is_changed_by_its_state_only(name):
    contact = pressed_blocks(n_upper=3, n_lower=4).contact
    with pytest.raises(AttributeError):
        setattr(contact, name, None)


def numbers(value, name="", seen=None):
    """All arrays and numbers below a value, by their path."""
    if isinstance(value, np.ndarray | float | int | bool):
        yield name, np.asarray(value)
    elif hasattr(value, "indptr"):
        yield name, value.toarray()
    elif isinstance(value, tuple | list):
        for i, part in enumerate(value):
            yield from numbers(part, f"{name}[{i}]")
    elif is_dataclass(value):
        for field in fields(value):
            if field.name not in ("slave", "master", "obstacle"):
                yield from numbers(getattr(value, field.name), f"{name}.{field.name}")


def everything(problem):
    """Status, state, operators, fields and rows of a problem, evaluated at its present state."""
    status = problem.equations.evaluate(start=False, by_contact=True)
    found = dict(numbers(status, "status")) | dict(numbers(problem.state(), "state"))
    for contact in problem.equations.contacts:
        rows, f = contact.rows.linearized(), contact.now
        found |= dict(numbers(contact.operators, "operators"))
        found |= dict(numbers(rows, "rows")) | dict(numbers(f.nodal, "nodal"))
        found |= {"gap": f.gap, "pressure": f.pressure, "slip": f.slip}
    return found


@pytest.mark.once
@pytest.mark.parametrize("pair", [{}, {"law": fm.Coulomb(0.3)}, {"sliding": "small"}])
def test_restored_state_is_bitwise_identical(pair):
    """After other loads, another offset, a cycle's weight of the gap and a failed solve."""
    scene = pressed_blocks(material=neo_hookean, n_upper=6, n_lower=9, pair=pair)
    problem, contact, push = scene.problem, scene.contact, scene.loads["push"]
    push.value[:] = (0.01, -0.03)
    problem.solve()
    problem.equations.bulk.assemble_residual()
    before, state = everything(problem), problem.state()
    contact.offset = np.linspace(0.0, 0.002, contact.slave.num_nodes)
    contact.c_n = 1e-3
    push.value[:] = (0.04, -0.05)
    problem.solve()
    problem.equations.newton = fm.NewtonOptions(max_iterations=1)
    push.value[:] = (0.0, -0.2)
    with pytest.raises(fm.NotConvergedError):
        problem.solve()
    push.value[:] = (0.01, -0.03)
    problem.restore(state)
    problem.equations.bulk.assemble_residual()
    after = everything(problem)
    assert before.keys() == after.keys() and len(before) > 60
    for name, value in before.items():
        assert np.array_equal(value, after[name], equal_nan=value.dtype.kind == "f"), name


def test_offset_and_weight_are_set_through_the_pair():
    problem = pressed_blocks(n_upper=3, n_lower=4).problem
    view = problem.contacts[0]
    view.offset, view.c_n = np.full(4, 0.01), 0.5
    state = problem.state().interfaces[0]
    assert state.c_n == 0.5 and (state.offset == 0.01).all()
    with pytest.raises(ValueError, match="offset"):
        view.offset = np.zeros(2)


def test_pair_shows_public_results():
    scene = pressed_blocks(n_upper=6, n_lower=9, pair={"law": fm.Coulomb(0.3)})
    scene.loads["push"].value[:] = (0.0, -0.02)
    scene.problem.solve()
    (view,) = scene.problem.contacts
    assert len(dir(view)) <= 23 and not any(name.startswith("_") for name in dir(view))
    assert set(view.status) <= {"open", "stick", "slip"}
    assert np.abs(view.forces.sum(axis=0) - view.total_force).max() < 1e-12
    assert (view.pressure[view.active] > 0.0).all() and view.positions.shape == view.tractions.shape
    assert "nodes active" in repr(view)
    gap = view.gap.copy()
    for name in ("gap", "slip", "positions", "normals", "tractions", "shear", "lengths", "nodes"):
        getattr(view, name)[:] = 0  # a copy
    assert np.array_equal(view.gap, gap, equal_nan=True) and view.tractions.any()
    assert scene.problem.certificate().violations() == []
