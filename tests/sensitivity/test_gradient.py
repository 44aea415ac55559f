# SPDX-License-Identifier: MIT
"""Derivatives of solutions: Taylor remainders of slope 2, adjoint against tangent-linear."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import linear_elastic
from scipy.optimize import minimize
from taylor_scenes import PRESS, SLIDE, blocks, check, obstacle_on_block, value_of, wave

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.sensitivity.forms import num_owned

comm = MPI.COMM_WORLD
LAWS = {
    "none": (fm.Frictionless, [], []),
    "Tresca": (lambda: fm.Tresca(1.0), ["stress"], [0.3]),
    "Coulomb": (lambda: fm.Coulomb(0.3), ["mu"], [0.1]),
}
FORMS = ["E", "load", "place"], [30.0, 3.0, 0.02]
FORCE = sensitivity.TotalForce(0, (1.0, 0.3))


def energy(scene):
    """A form of displacement and modulus."""
    u = scene.u
    return (ufl.inner(u, u) + 0.1 * u[0] + 0.01 * scene.controls["E"] * u[1]) * ufl.dx


OBJECTIVES = {
    "form": energy,
    "force": lambda _: FORCE,
    "moment": lambda _: sensitivity.Moment(0, (1.0, 0.5)),
    "peak": lambda _: sensitivity.PeakPressure(0),
    "pressure": lambda _: sensitivity.PressureIntegral(0, 2),
    "misfit": lambda _: (FORCE - 2.0) ** 2 + 3.0 * sensitivity.FrictionWork(0),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("places", [PRESS, SLIDE], ids=["press", "slide"])
def test_material_load_prescribed_and_law(law, places):
    made, names, sizes = LAWS[law]
    scene = blocks(made(), places=places)
    check(scene, energy(scene), FORMS[0] + names, FORMS[1] + sizes)


@pytest.mark.each
@pytest.mark.parametrize("name", OBJECTIVES)
def test_objectives_of_a_sliding_path(name):
    scene = blocks(fm.Coulomb(0.3), places=SLIDE)
    check(scene, OBJECTIVES[name](scene), ["E", "place", "mu"], [30.0, 0.02, 0.1])


@pytest.mark.serial
def test_function_of_the_values_of_all_steps():
    """History and explicit terms of every step."""
    scene = blocks(fm.Coulomb(0.3), places=SLIDE)
    objectives = [FORCE, sensitivity.FrictionWork(0), energy(scene)]
    misfit = sensitivity.least_squares(np.ones((len(SLIDE), 3)), scale=[1.0, 0.1, 2.0])
    gradient = check(
        scene, objectives, ["E", "place", "mu", "load"], [30.0, 0.02, 0.1, 3.0], over_steps=misfit
    )
    assert gradient.values.shape == (5, 3)
    check(
        scene,
        sensitivity.FrictionWork(0),
        ["mu", "place"],
        [0.1, 0.02],
        over_steps=sensitivity.total,
    )


@pytest.mark.once
@pytest.mark.parametrize(
    "options",
    [
        {"degree": 2},
        {"mesh": {"cell": "triangle"}, "algorithm": "saddle"},
        {"pair": {"basis": "standard"}},
        {"pair": {"slip": "operators"}},
        {"pair": {"sliding": "small"}},
        {"material": linear_elastic, "linear_bulk": True},
        {"solver": "iterative", "petsc_options": {"ksp_rtol": 1e-13}},
        {"linearization": "no_normals"},
    ],
    ids=["P2", "saddle", "standard", "operators", "small", "linear", "multigrid", "inexact"],
)
def test_elements_systems_and_models(options):
    scene = blocks(fm.Coulomb(0.3), places=SLIDE[:3], **options)
    check(scene, FORCE, ["E", "place", "mu"], [30.0, 0.02, 0.1])


def test_interference():
    scene = blocks(places=PRESS)
    check(scene, sensitivity.PeakPressure(0), ["interference", "E"], [0.02, 30.0])


@pytest.mark.once
@pytest.mark.parametrize("law", ["none", "Coulomb"])
def test_obstacle(law):
    """Position and radius of an obstacle, and the history of the slip along it."""
    made, names, sizes = LAWS[law]
    scene = obstacle_on_block(fm.Circle((0.52, 1.8), 0.8), made())
    check(scene, FORCE, ["E", "place", "radius", *names], [30.0, 0.01, 0.05, *sizes])


@pytest.mark.each
@pytest.mark.parametrize("name", ["form", "force", "misfit"])
def test_nodal_positions(name):
    """Shape derivatives, against problems on meshes that are bent as well."""
    X, law = sensitivity.NodalPositions(), fm.Coulomb(0.3)
    scene = blocks(law, places=SLIDE[:3])
    path, objective = scene.solve(), OBJECTIVES[name](scene)
    gradient = fm.gradient(objective, X, path)
    x, y = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2].T
    direction = wave(x, y).ravel()[: gradient[X].size]
    slope = comm.allreduce(float(gradient[X] @ direction))
    tangent = sensitivity.tangent_linear(objective, X, direction, path)
    assert tangent.derivative == pytest.approx(slope, rel=1e-10)
    remainders = []
    for step in (1e-3, 5e-4, 2.5e-4):
        bent = blocks(law, places=SLIDE[:3], bend=step)
        value = value_of(bent.solve(), OBJECTIVES[name](bent))
        remainders.append(abs(value - gradient.value - step * slope))
    assert (np.log2(np.array(remainders[:-1]) / remainders[1:]) > 1.9).all(), remainders


# Exact derivatives


def test_force_is_proportional_to_the_modulus():
    """Hertz: linear bodies of one modulus at a given approach, dF/dE = F / E."""
    scene = blocks(material=linear_elastic)
    scene.solve()
    E = scene.controls["E"]
    gradient = fm.gradient(sensitivity.TotalForce(0, (0.0, 1.0)), E, scene.problem)
    assert gradient[E] == pytest.approx(gradient.value / 100.0, rel=1e-10)


def test_friction_force_on_a_wedge():
    """H / P = (mu + t) / (1 - mu t) of a rigid plane with slope t that slides on a block."""
    slope, friction = 0.2, 0.3
    plane = fm.Plane((0.5, 1.1), (slope, -1.0))
    places = [(s, 0.2 * s - 0.12, 0.0) for s in (0.0, 0.1)]
    scene = obstacle_on_block(plane, fm.Coulomb(friction), places=places)
    path, mu = scene.solve(), scene.controls["mu"]
    pair = scene.problem.equations.contacts[0]
    assert pair.sliding[pair.active].all()
    H, P = (fm.gradient(sensitivity.TotalForce(0, axis), mu, path) for axis in np.eye(2))
    sign = np.sign(H.value / P.value)
    ratio = sign * H.value / P.value
    t = (ratio - friction) / (1.0 + friction * ratio)  # of the plane, or its negative
    assert abs(t) == pytest.approx(slope, rel=1e-9)
    by_mu = sign * (1.0 + t**2) / (1.0 - friction * t) ** 2
    assert float(H[mu]) == pytest.approx(by_mu * P.value + sign * ratio * float(P[mu]), rel=1e-9)


# Results, and restored states


def test_values_are_in_the_spaces_of_the_controls():
    scene = blocks(fm.Coulomb(0.3))
    scene.solve()
    E, load, push, mu = (scene.controls[name] for name in ("E", "load", "place", "mu"))
    gradient = fm.gradient(FORCE, [E, load, push, mu], scene.problem)
    assert gradient[E].shape == () and gradient[push].shape == (2,) and gradient[mu].shape == ()
    assert isinstance(gradient[load], fem.Function)
    assert gradient[load].function_space == load.function_space
    everywhere = fem.Function(load.function_space)
    everywhere.x.array[:] = 1.0
    change = sensitivity.tangent_linear(FORCE, load, everywhere, scene.problem).derivative
    owned = gradient[load].x.array[: num_owned(load.function_space)]
    assert abs(change) > 1e-3
    assert comm.allreduce(owned.sum()) == pytest.approx(change, rel=1e-8)
    with pytest.raises(KeyError, match="not one of the controls"):
        gradient[scene.u]


def test_state_and_values_are_restored():
    scene = blocks(fm.Coulomb(0.3), places=SLIDE[:3])
    path = scene.solve()
    push, problem = scene.controls["place"], scene.problem
    before, r = problem.state(), problem.equations.bulk.r.array.copy()
    push.value[:] = 7.0
    law = problem.equations.contacts[0].pair.law
    law.mu = 0.4
    fm.gradient(FORCE, push, path)
    sensitivity.tangent_linear(FORCE, push, [1.0, 0.0], path)
    assert (push.value == 7.0).all() and law.mu == 0.4
    after = problem.state()
    assert (after.u == before.u).all() and (problem.equations.bulk.r.array == r).all()
    assert after.interfaces[0].partners is before.interfaces[0].partners
    push.value[:], law.mu = SLIDE[2], 0.3
    assert problem.solve().num_iterations <= 1


def test_steps_contribute_the_derivatives_by_their_own_values():
    """Tangent-linear derivatives with respect to the position in one step only."""
    scene = blocks(fm.Coulomb(0.3), places=SLIDE[:3])
    path, push = scene.solve(), scene.controls["place"]
    gradient = fm.gradient(FORCE, push, path)
    for number, part in enumerate(gradient.by_step[0]):
        tangent = sensitivity.tangent_linear(
            FORCE, push, lambda k, number=number: [float(k == number), 0.0], path
        )
        assert tangent.derivative == pytest.approx(part[0], rel=1e-9)
        assert part.any()  # the shear depends on earlier steps


def test_paths_with_a_missing_step_are_refused():
    """Slip is counted from a state that is not in the path."""
    scene = blocks(fm.Coulomb(0.3), places=SLIDE[:3])
    path = scene.solve()
    del path.steps[1]
    with pytest.raises(fm.MortarError, match="is not counted from the state before"):
        fm.gradient(FORCE, scene.controls["E"], path)


def test_undecided_nodes_are_named():
    """Touching without pressure: each node may open or close."""
    scene = blocks(places=[(0.0, 0.0)])
    scene.solve()
    touching = fm.gradient(FORCE, scene.controls["place"], scene.problem)
    assert len(touching.undecided) == 5 and touching.nearest_change.distance == 0.0
    scene = blocks(fm.Coulomb(0.3))
    scene.solve()
    pressed = fm.gradient(FORCE, scene.controls["place"], scene.problem)
    assert not pressed.undecided and 0.0 < pressed.nearest_change.distance < 1.0
    assert "at a distance of" in str(pressed.nearest_change)


@pytest.mark.each
@pytest.mark.parametrize(
    "mu, depth, expected",
    [
        (0.6, 0.05, "all nodes of 'upper/bottom' on 'lower/top' in contact stick"),
        (0.6, -0.05, "no node of 'upper/bottom' on 'lower/top' is in contact"),
        (0.1, 0.05, None),
    ],
)
def test_a_friction_limit_without_effect_is_named(mu, depth, expected):
    """Equal blocks: all nodes stick with mu = 0.6, and some slide with mu = 0.1."""
    places = [(0.0, -0.6 * depth), (0.01, -depth), (0.03, -depth)]
    scene = blocks(fm.Coulomb(mu), places=places, mesh={"width_upper": 1.0, "width_lower": 1.0})
    path, control = scene.solve(), scene.controls["mu"]
    (contact,) = scene.problem.equations.contacts
    found = fm.gradient(FORCE, [control, scene.controls["E"]], path)
    assert (found[control] == 0.0) == (expected is not None)
    if expected is None:
        assert 0 < contact.now.sliding.sum() < contact.active.sum() and found.remarks == ()
        return
    (remark,) = found.remarks
    assert "the derivative by mu of pair 0 is zero" in remark and expected in remark
    assert remark in str(found) and not contact.now.sliding.any()
    assert fm.gradient(FORCE, scene.controls["E"], path).remarks == ()


def test_a_search_that_jumps_to_stick_is_not_at_a_minimum():
    """L-BFGS-B reports convergence where the derivative by mu is zero; the remark says why."""
    places = [(0.0, -0.03), (0.01, -0.05), (0.03, -0.05)]
    scene = blocks(fm.Coulomb(0.1), places=places, mesh={"width_upper": 1.0, "width_lower": 1.0})
    start, control, found = scene.problem.state(), scene.controls["mu"], []

    def misfit(x):
        control.set(scene.problem, x[0])
        scene.problem.restore(start)
        found.append(fm.gradient([FORCE], control, scene.solve(), over_steps=squares))
        return found[-1].value, np.atleast_1d(found[-1][control])

    squares = sensitivity.least_squares(np.zeros((3, 1)))
    misfit([0.1])
    squares = sensitivity.least_squares(found[-1].values)
    result = minimize(misfit, [0.05], jac=True, bounds=[(0.0, 1.0)], method="L-BFGS-B")
    assert result.success and result.x[0] > 0.3 and result.fun > 1e-6
    assert len(found[-1].remarks) == 1 and not found[1].remarks


def test_wrong_arguments_are_refused():
    scene = blocks()
    problem, push = scene.problem, scene.controls["place"]
    with pytest.raises(fm.MortarError, match="not the result of a solve"):
        fm.gradient(FORCE, push, problem)
    with pytest.raises(fm.MortarError, match="no steps"):
        fm.gradient(FORCE, push, sensitivity.RecordedPath(problem))
    scene.solve()
    with pytest.raises(ValueError, match="expected a RecordedPath"):
        fm.gradient(FORCE, push, 3)
    with pytest.raises(ValueError, match=r"control 1\.0: expected"):
        fm.gradient(FORCE, 1.0, problem)
    with pytest.raises(ValueError, match="displacement is an unknown"):
        fm.gradient(FORCE, scene.u, problem)
    with pytest.raises(ValueError, match="scalar UFL form or a quantity"):
        fm.gradient(2.0, push, problem)
    with pytest.raises(ValueError, match="depend on this control"):
        fm.gradient(FORCE, fem.Constant(scene.u.function_space.mesh, 1.0), problem)
    with pytest.raises(ValueError, match="with 1 arguments"):
        fm.gradient(problem.equations.bulk.residual, push, problem)
    with pytest.raises(ValueError, match="has the shape"):
        sensitivity.tangent_linear(FORCE, push, 1.0, problem)
    with pytest.raises(ValueError, match="over_steps returned"):
        fm.gradient(FORCE, push, problem, over_steps=lambda values: (0.0, 1.0))


def test_gradient_prints_a_line_for_each_control():
    scene = blocks(fm.Coulomb(0.3), places=SLIDE)
    path = scene.solve()
    mu = sensitivity.LawParameter(0, "mu")
    gradient = fm.gradient(FORCE, [mu, scene.controls["E"]], path)
    lines = str(gradient).splitlines()
    assert lines[0] == f"objective {gradient.value:.6g}" and len(lines) == 3
    assert lines[1].startswith("by control 0, mu of pair 0: ")
    assert float(lines[1].rpartition(": ")[2]) == pytest.approx(float(gradient[mu]), rel=1e-6)


@pytest.mark.parametrize(
    "objective, control, message",
    [
        ("force", "E", "objective 'force'"),
        (sensitivity.TotalForce(2, (1.0, 0.0)), "E", "pair 2: expected a number from 0 to 0"),
        (FORCE, sensitivity.Offset(1), "pair 1: expected a number from 0 to 0"),
    ],
)
def test_invalid_objective_or_pair_is_refused(objective, control, message):
    scene = blocks()
    scene.solve()
    with pytest.raises(ValueError, match=message):
        fm.gradient(objective, scene.controls.get(control, control), scene.problem)


def test_directions_of_a_list_of_controls_are_a_list():
    scene = blocks(fm.Coulomb(0.3), places=SLIDE)
    path, mu = scene.solve(), sensitivity.LawParameter(0, "mu")
    both = [sensitivity.tangent_linear(FORCE, *given, path) for given in ((mu, 1.0), ([mu], [1.0]))]
    assert both[0].derivative == both[1].derivative != 0.0
