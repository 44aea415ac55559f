# SPDX-License-Identifier: MIT
"""Solutions of linearized contact with friction: inequalities and branches."""

import numpy as np
import pytest

from fenics_mortar.rigid.complementarity import FrictionProblem, lemke, solve_friction


def problem(rng, n, *, rank=None, mu=0.5):
    """Gaps of n nodes of bodies with a random compliance."""
    A = rng.normal(size=(2 * n, rank or 2 * n))
    sign = np.repeat([1.0, -1.0], n)
    return FrictionProblem(sign[:, None] * (A @ A.T), rng.normal(size=2 * n), np.full(n, mu))


def violation(p, found):
    """Largest violation of the contact conditions, over the largest gap."""
    n = p.slope.size
    gap, slip = np.split(p.q + p.V @ np.concatenate([found.z_n, found.z_tau]), 2)
    limit = p.slope * found.z_n
    sticks = found.active & (found.branch == 0)
    slides = found.active & (found.branch != 0)
    parts = [
        -gap, -found.z_n, np.abs(gap[found.active]), np.abs(found.z_n[~found.active]),
        np.abs(slip[sticks]), np.abs(found.z_tau) - limit,
        np.abs(found.z_tau - found.branch * limit)[slides], -(found.branch * slip)[slides],
    ]  # fmt: skip
    assert len(gap) == n
    return max(part.max(initial=0.0) for part in parts) / np.abs(p.q).max()


@pytest.mark.parametrize("mu", [0.1, 0.6, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_all_conditions_hold_for_any_friction(seed, mu):
    p = problem(np.random.default_rng(seed), 12, mu=mu)
    assert violation(p, solve_friction(p)) < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_without_friction_there_is_no_shear(seed):
    p = problem(np.random.default_rng(seed), 8, mu=0.0)
    found = solve_friction(p)
    gap = (p.q + p.V @ np.concatenate([found.z_n, found.z_tau]))[:8]
    assert not found.z_tau.any()
    assert found.branch.all()  # sticking nodes would have a shear in the next Newton step
    assert min(gap.min(), found.z_n.min()) > -1e-9
    assert np.abs(gap * found.z_n).max() < 1e-9


@pytest.mark.parametrize("push, branch", [(0.2, 0), (0.4, 0), (0.6, 1), (-0.6, -1)])
def test_one_node_sticks_up_to_its_limit_and_slides_beyond(push, branch):
    """A node pressed with a force of one: it sticks if the push is below mu."""
    p = FrictionProblem(np.diag([1.0, -1.0]), np.array([-1.0, push]), np.array([0.5]))
    found = solve_friction(p)
    assert found.active.all()
    assert found.branch[0] == branch
    assert found.z_n[0] == pytest.approx(1.0)
    assert found.z_tau[0] == pytest.approx(np.clip(push, -0.5, 0.5))


def test_problem_without_solution_is_reported():
    assert lemke(np.array([[0.0]]), np.array([-1.0])) is None
    assert not lemke(np.eye(2), np.ones(2)).any()


def test_basis_is_regular_where_the_relaxation_vanishes_by_rounding():
    """The gap of the first node is rounding, and no pressure changes it."""
    M = np.array([[0.0, 1.0], [-1.0, 1.0]])
    basic = lemke(M, np.array([-1e-14, 1.0]))
    assert np.linalg.cond(np.where(basic, -M, np.eye(2))) < 10.0


@pytest.mark.parametrize("unit", [1e-15, 1e12])
def test_solutions_do_not_depend_on_the_unit(unit):
    random = np.random.default_rng(0)
    for _ in range(20):
        A, q = random.normal(size=(8, 8)), random.normal(size=8)
        basic = lemke(A @ A.T, unit * q)
        assert np.array_equal(basic, lemke(A @ A.T, q))
        z = np.where(basic, np.linalg.solve(np.where(basic, -A @ A.T, np.eye(8)), unit * q), 0.0)
        assert (z >= 0.0).all() and (A @ A.T @ z + unit * q >= -1e-9 * unit).all()
