# SPDX-License-Identifier: MIT
"""Errors for states that are not solutions and invalid pairs; laws with limits by node."""

import numpy as np
import pytest
from one_rank import either, raised_on_the_last_rank, several_ranks
from refusal import refused, refused_with_address
from scenes import internal, neo_hookean
from sensitivity_scenes import two_steps
from small_scenes import small_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.laws import Stribeck, Worn

FORCE = sensitivity.TotalForce(0, (0.0, 1.0))
MU = sensitivity.LawParameter(0, "mu")


def pressed(law=None):
    scene = small_blocks(pair={"law": law or fm.Coulomb(0.3)})
    scene.loads["push"].value[:] = (0.01, -0.02)
    scene.problem.time = 1.0
    scene.problem.solve()
    return scene


@pytest.mark.parametrize("changed", ["displacement", "load", "law"])
def test_a_state_of_other_loads_is_no_solution(changed):
    """Derivatives would be silently wrong, as would those of a path that is recorded too late."""
    scene = pressed()
    path = sensitivity.RecordedPath(scene.problem)
    path.record()
    if changed == "displacement":
        scene.u.x.array[:] *= 1.01
    elif changed == "load":
        scene.loads["push"].value[1] *= 1.01
    else:
        scene.problem.contacts[0].pair.law.mu = 0.2
    with refused(fm.MortarError, "the present state is not a solution"):
        fm.gradient(FORCE, MU, scene.problem)
    with refused(fm.MortarError, "record before changing them"):
        path.record()


def test_pairs_are_numbers_from_zero_on():
    """-1 would be the last pair for values, and no pair for controls: a wrong derivative."""
    problem = pressed().problem
    for make in (
        lambda i: sensitivity.TotalForce(i, (0.0, 1.0)),
        lambda i: sensitivity.LawParameter(i, "mu"),
        sensitivity.Interference,
        sensitivity.Offset,
    ):
        for number in (-1, 0.0, "a"):
            with refused(ValueError, "the number of a pair"):
                made = make(number)
                arguments = (FORCE, made) if hasattr(made, "vjp") else (made, MU)
                fm.gradient(*arguments, problem)
    with refused(ValueError, "pair 1: expected a number from 0 to 0"):
        fm.gradient(sensitivity.TotalForce(1, (0.0, 1.0)), MU, problem)
    with refused(ValueError, "pair 1: expected a number from 0 to 0"):
        fm.gradient(FORCE, sensitivity.Offset(1), problem)


def test_mean_gap_of_nodes_without_partner():
    wide = {"n_lower": 9, "n_upper": 4, "width_lower": 1.8, "width_upper": 1.0}
    scene, _, _ = two_steps(fm.Coulomb(0.3), slave="lower", **wide)
    alone = np.flatnonzero(~scene.contact.covered)
    with refused(fm.MortarError, "none of the slave nodes of MeanGap faces the master"):
        fm.gradient(sensitivity.MeanGap(0, alone), MU, scene.problem)


def test_steps_without_mean_gap_that_do_not_count():
    scene = small_blocks(pair={"law": fm.Coulomb(0.3), "search_radius": 0.3})
    path = sensitivity.RecordedPath(scene.problem)
    for number, height in enumerate((0.5, -0.02), 1):
        scene.loads["push"].value[:] = 0.01, height
        scene.problem.time = float(number)
        scene.problem.solve()
        path.record()
    gap = sensitivity.MeanGap(0)
    found = sensitivity.tangent_linear(gap**2, MU, 0.01, path)
    assert np.isnan(found.values[0]) and np.isfinite([found.value, found.derivative]).all()
    with refused(fm.MortarError, "quantity 0 has no value in step 0"):
        sensitivity.tangent_linear(gap, MU, 0.01, path, over_steps=sensitivity.total)

    def end(values):
        return values[-1, 0], np.array([[0.0], [1.0]])

    assert fm.gradient(gap**2, MU, path, over_steps=end).value == found.value


def test_numbers_of_quantities_and_functions_of_steps():
    problem = pressed().problem
    for direction in ((0.0, 1.0, 2.0), 1.0, (0.0, np.nan)):
        with refused(ValueError, "direction=", "two finite numbers"):
            fm.gradient(2.0 * sensitivity.TotalForce(0, direction), MU, problem)
    with refused(ValueError, "about="):
        fm.gradient(sensitivity.Moment(0, (0.0,)), MU, problem)
    for nodes in ([], [0.5], [-1]):
        with refused(ValueError, "numbers of slave nodes"):
            fm.gradient(sensitivity.MeanGap(0, nodes), MU, problem)
    with refused(ValueError, "slave nodes 0 to 4"):
        fm.gradient(sensitivity.MeanGap(0, [7]), MU, problem)
    for wrong, message in (
        (None, "expected a function"),
        (lambda values: 1.0, "expected a function"),
        (lambda values: (1.0, values, values), "expected a function"),
        (lambda values: (np.nan, values), "not finite"),
    ):
        with refused_with_address(ValueError, message):
            fm.gradient(FORCE, MU, problem, over_steps=wrong)
    with refused(ValueError, "no such obstacle"):
        place = sensitivity.ObstaclePlace(fm.Circle((0.0, 0.0), 1.0))
        fm.gradient(FORCE, place, problem)
    with refused(ValueError, "expected an obstacle"):
        fm.gradient(FORCE, sensitivity.ObstaclePlace(3), problem)


@several_ranks
def test_arguments_of_one_rank():
    """The constructor raised on one rank only, and the others waited in the next call."""
    problem = pressed().problem
    with raised_on_the_last_rank(ValueError, "the number of a pair"):
        fm.gradient(sensitivity.TotalForce(either(0, -1), (0.0, 1.0)), MU, problem)
    with raised_on_the_last_rank(ValueError, "the number of a pair"):
        sensitivity.tangent_linear(
            FORCE, sensitivity.LawParameter(either(0, -1), "mu"), 1.0, problem
        )
    with refused(fm.MortarError, "quantities is", "all ranks need the same"):
        fm.gradient(sensitivity.TotalForce(0, either((0.0, 1.0), (1.0, 0.0))), MU, problem)
    assert fm.gradient(FORCE, MU, problem).value > 0.0


def test_limits_by_node_have_distances_from_kinks():
    """Laws with ``limit`` alone, and coefficients that vary in space."""
    law = Stribeck(0.4, 0.2, 0.05)
    problem = pressed(law).problem
    found = fm.gradient(FORCE, sensitivity.Interference(0), problem)
    assert found.nearest_change is not None
    mixed = pressed(fm.Coulomb(lambda X: 0.3 + 0.0 * X[:, 0])).problem
    plain = pressed().problem
    by_node, by_number = (fm.gradient(FORCE, MU, made)[MU] for made in (mixed, plain))
    assert by_node.sum() == pytest.approx(by_number, rel=1e-9)


def test_interruption_in_compiled_code_is_recognized():
    """Numba reports it as a SystemError."""
    problem = pressed().problem

    def interrupted(values):
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    with pytest.raises(KeyboardInterrupt):
        fm.gradient(FORCE, MU, problem, over_steps=interrupted)
    assert fm.gradient(FORCE, MU, problem).value > 0.0


def test_nodal_positions_and_friction_work_of_ties_are_refused():
    """Both were an AttributeError before."""
    data = small_blocks().data
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/top", (0.0, -0.01)),
    ]
    tie = fm.TiedPair(data, "upper/bottom", "lower/top")
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, [tie], bcs=bcs, petsc_options_prefix="tied_")
    problem.solve()
    with refused(fm.MortarError, "TiedPair.* nodal positions as controls need contact"):
        fm.gradient(FORCE, sensitivity.NodalPositions(), problem)
    with refused(ValueError, "pair 0 is tied: FrictionWork needs a contact"):
        sensitivity.FrictionWork(0).value(problem)


def test_nodal_positions_with_memory_are_refused():
    """The derivative of the memory with respect to them is not known, and would be left out."""
    scene = small_blocks(pair={"law": Worn(0.3, 0.05)})
    path = sensitivity.RecordedPath(scene.problem)
    for push in ((0.01, -0.02), (0.02, -0.02)):
        scene.loads["push"].value[:] = push
        scene.problem.solve()
        path.record()
    positions = sensitivity.NodalPositions()
    with refused(fm.MortarError, "nodal positions: no derivative through the memory"):
        fm.gradient(FORCE, positions, path)
    with refused(fm.MortarError, "nodal positions: no derivative through the memory"):
        direction = np.zeros_like(positions.get(scene.problem))
        sensitivity.tangent_linear(FORCE, positions, direction, path)
