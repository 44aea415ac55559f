# SPDX-License-Identifier: MIT
"""Linearized contact with friction along a load path: no solutions beyond a jump."""

import numpy as np
import pytest
from test_complementarity import problem, violation

from fenics_mortar.rigid.complementarity import (
    FrictionProblem,
    Sets,
    TurningPoint,
    _follow,
    follow_loads,
    solve_friction,
)

# One node whose normal and tangential compliance are coupled. At mu = 2 > 1 / |coupling| it may
# have no equilibrium next to a state in which it slides (Klarbring 1990).
COUPLED = np.array([[1.0, -1.0], [1.0, -2.0]])
# It slides with a pressure of one if gap and slip without multipliers are one and three.
SLIDES = Sets(np.array([True]), np.array([1]), np.array([1.0]), np.array([2.0]))


def unloaded(n):
    """Sets and gaps of n nodes that touch without pressure."""
    none = np.zeros(n)
    return Sets(none > 0.0, none.astype(np.int64), none, none), none


@pytest.mark.parametrize("mu", [0.1, 0.6, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_surfaces_that_just_touch_are_loaded(seed, mu):
    """All gaps and pressures are zero at first; all conditions hold at the end."""
    p = problem(np.random.default_rng(seed), 12, mu=mu)
    assert violation(p, follow_loads(p, *unloaded(12))) < 1e-5


def test_path_without_nodes_ends_at_once():
    """All surfaces may be separated at the end of a path."""
    p = FrictionProblem(np.zeros((0, 0)), np.zeros(0), np.zeros(0))
    assert follow_loads(p, *unloaded(0)).active.size == 0


@pytest.mark.parametrize("seed", range(5))
def test_loaded_state_continues(seed):
    """A path between two solutions without friction, which are unique."""
    rng = np.random.default_rng(seed)
    p = problem(rng, 10, mu=0.0)
    first = solve_friction(p)
    gap = (p.q + p.V @ np.concatenate([first.z_n, first.z_tau]))[:10]
    then = p._replace(q=rng.normal(size=20))
    found = follow_loads(then, first, np.maximum(gap, 0.0))
    assert found.z_n == pytest.approx(solve_friction(then).z_n, abs=1e-9)


def test_sliding_node_continues():
    """With mu = 0.5 the node slides at pressures of 1 for q = (-0.5, 0) and 2 for (-1, 0.1)."""
    p = FrictionProblem(COUPLED, np.array([-1.0, 0.1]), np.array([0.5]))
    found = follow_loads(p, SLIDES._replace(z_tau=np.array([0.5])), np.zeros(1))
    assert found.branch[0] == 1
    assert found.z_n[0] == pytest.approx(2.0)


@pytest.mark.parametrize("pulled", [1e-6, 0.1])
def test_no_solution_beyond_a_jump(pulled):
    """Under tension the node can neither stick nor slide; it opens by a jump."""
    p = FrictionProblem(COUPLED, np.array([1.0 + pulled, 3.0]), np.array([2.0]))
    assert not solve_friction(p).active.any()
    assert follow_loads(p, SLIDES, np.zeros(1)).fraction == 0.0


def test_path_with_a_later_turning_point_is_abandoned():
    """The node sticks first and then reaches its limit, where the path turns."""
    sticks = SLIDES._replace(branch=np.array([0]), z_tau=np.array([1.5]))
    # Without slip and gap q = (z_tau - z_n, 2 z_tau - z_n), which is (0.5, 2) at first.
    near = FrictionProblem(COUPLED, np.array([0.6, 2.1]), np.array([2.0]))
    assert follow_loads(near, sticks, np.zeros(1)).z_tau[0] == pytest.approx(1.5)
    far = near._replace(q=np.array([1.1, 2.1]))
    assert not solve_friction(far).active.any()
    assert follow_loads(far, sticks, np.zeros(1)) == TurningPoint(
        pytest.approx(5 / 17, abs=1e-3), 0
    )


@pytest.mark.parametrize("growth", [0.0, 1e-17, -1e-17, 1e-8])
def test_a_load_that_grows_without_end_by_rounding_turns(growth):
    """The pressure of the first node enters at half the loads and hardly changes its gap."""
    M, q = np.array([[growth, 0.0], [1.0, 1.0]]), np.array([-1.0, 1.0])
    end = _follow(M, np.ones(2), q, np.zeros(2, bool))
    if growth > 1e-12:
        assert end.tolist() == [True, False]
    else:
        assert end == TurningPoint(0.5, 0)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_paths_do_not_depend_on_the_unit_of_length(unit):
    """The first of two nodes without friction hardly moves by its own pressure."""
    V = np.diag([1e-8, 1.0, -1.0, -1.0])
    V[1, 0] = 1.0
    p = FrictionProblem(V, unit * np.array([-1.0, 1.0, 0.0, 0.0]), np.zeros(2))
    found = follow_loads(p, unloaded(2)[0], np.full(2, unit))
    assert found.active.tolist() == [True, False]
