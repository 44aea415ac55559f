# SPDX-License-Identifier: MIT
"""Cases of the randomised trial, equal on any number of ranks, and their checks."""

import json
from collections import Counter
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

import fenics_mortar as fm
from demos.studies.dynamics.scenes import Scene
from demos.studies.stability import random_cracks, random_idle
from demos.studies.stability.limit_analysis import judge
from demos.studies.stability.random_cases import objections, random_case
from demos.studies.stability.random_physics import DRAWS, run_physics
from demos.studies.stability.random_shapes import FAMILIES, shape_case
from demos.studies.stability.random_supported import hanging_case, supported_case
from demos.studies.stability.shape_judge import OF_LAW, own_overlap, shape_errors, shears, windings
from demos.studies.stability.supported_limits import earliest_end_of_mesh, end_of_mesh, rigid
from demos.studies.stability.touching import touching_nodes
from demos.studies.stability.trial import Worker, case_of, summary
from demos.studies.stability.trial_judge import check_again, confirm, errors, measure, run
from demos.studies.stability.trial_scene import build
from fenics_mortar.contact.view import PairView
from fenics_mortar.mesh.space import input_nodes

COMM = MPI.COMM_WORLD
SEEDS = range(1, 21)
# pushed, pressed, two tools, clamped and guided stack, small ones
ON_RANKS = (2, 8, 10, 9, 129)
# Of bodies supported by friction: row, block, wall, tower, T-junction, groove
SUPPORTED_SEEDS = (1, 2, 3, 8, 18, 21, 37)
# 2 folds once, spirals; tubes, plates, arms, a plate by its corners; pads, one that peels off
OTHER_SEEDS = (
    3_000_003, 3_000_020, 4_000_001, 4_000_002, 4_000_003, 4_000_006, 4_000_027, 5_000_002,
    5_000_005, 5_000_039,
)  # fmt: skip
AGAIN_SEEDS = (4_000_016, 5_000_004)
# The last one on a coarse ground, near its limit.
HANGING_SEEDS = (2, 3, 5, 19)
# Number of cases of each family; a bar left out here is run by another test.
COUNTS = {
    "revolved": 5, "moving": 2, "memory": 5, "itself": 2, "turning": 8, "spinning": 5, "idle": 4,
    "cracks": 4,
}  # fmt: skip
# Families of test_space_trial.
IN_SPACE = {"towers", "patches", "plates", "tools"}
# An idle block that touches the side of the pressed one; cracks by their scene.
BESIDE, CRACKS = 20, {"open": 11, "slides": 1, "sticks": 3}
# Largest relative difference of solutions on several ranks, by Newton's tolerance [1].
SAME = 1e-8


@pytest.mark.serial
def test_random_cases_converge_and_none_is_wrong():
    records = [run(random_case(seed))[0] for seed in SEEDS]
    table = summary(records)
    outcomes = Counter(record["outcome"] for record in records)
    assert not outcomes["crash"] and not outcomes["wrong"], table
    assert outcomes["converged"] == len(SEEDS), table
    assert {record["scene"] for record in records} >= {"pushed", "pressed", "two tools"}


@pytest.mark.serial
@pytest.mark.parametrize(("family", "count"), COUNTS.items())
def test_random_cases_beyond_plane_statics_have_known_solutions(family, count):
    records = [run_physics(family, number) for number in range(count)]
    assert [record["outcome"] for record in records] == ["converged"] * count, summary(records)
    assert set(DRAWS) - set(COUNTS) == IN_SPACE


@pytest.mark.serial
@pytest.mark.parametrize("family", ["revolved", "memory", "cracks"])
def test_a_pressure_with_an_error_is_judged_wrong(monkeypatch, family):
    right = PairView.pressure.fget
    monkeypatch.setattr(PairView, "pressure", property(lambda view: 1.001 * right(view)))
    assert run_physics(family, 1)["outcome"] == "wrong"


@pytest.mark.serial
def test_impacts_that_gain_energy_are_judged_wrong(monkeypatch):
    """With the trapezoidal rule a bar on a wall, whose exact solution is known, gains energy."""
    original = Scene.dynamics
    monkeypatch.setattr(Scene, "dynamics", lambda made, _: original(made, "generalized_alpha", 1.0))
    assert run_physics("moving", 5)["outcome"] == "wrong"


@pytest.mark.serial
def test_an_idle_body_that_does_not_give_way_or_bears_a_force_is_judged_wrong(monkeypatch):
    """The block beside the pressed one is where it was, and its pairs have a force."""
    right, first = random_idle.Scene.positions, []

    def positions(scene):
        x = right(scene)
        first[:] = first or [x]
        for name, nodes in scene.bodies.items():
            if name.startswith("idle"):
                x[nodes] = first[0][nodes]
        return x

    with monkeypatch.context() as patched:
        patched.setattr(random_idle.Scene, "positions", positions)
        assert "overlaps" in run_physics("idle", BESIDE)["reason"]
    forces = PairView.forces.fget
    monkeypatch.setattr(PairView, "forces", property(lambda view: forces(view) + 1e-9))
    assert "a force of" in run_physics("idle", BESIDE)["reason"]


@pytest.mark.serial
@pytest.mark.parametrize("scene", ["open", "slides", "sticks"])
def test_a_crack_that_moves_otherwise_is_judged_wrong(monkeypatch, scene):
    right = random_cracks._jump
    monkeypatch.setattr(random_cracks, "_jump", lambda *of: spoilt(*right(*of)))

    def spoilt(x, jump):
        return x, 0.7 * jump + (1e-12 if scene == "sticks" else 0.0)

    assert run_physics("cracks", CRACKS[scene])["outcome"] == "wrong"


@pytest.mark.once
@pytest.mark.serial
def test_bodies_supported_by_friction_stay_or_reach_a_dead_end_that_limit_analysis_confirms():
    records = [run(supported_case(seed))[0] for seed in SUPPORTED_SEEDS]
    table = summary(records)
    assert {record["outcome"] for record in records} <= {"converged", "dead end"}, table
    by_seed = {record["seed"]: record for record in records}
    assert by_seed[37]["outcome"] == "dead end" and by_seed[37]["end"] < 2.0
    scenes = {"row", "block", "wall", "tower", "T-junction", "groove"}
    assert {record["scene"] for record in records} == scenes


@pytest.mark.once
@pytest.mark.serial
def test_folded_and_thin_bodies_and_pads_have_expected_ends():
    records = [run(case_of(seed))[0] for seed in OTHER_SEEDS]
    assert {record["outcome"] for record in records} == {"converged"}, summary(records)
    assert {record["family"] for record in records} == {"own", "thin", "laws"}


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize("seed", AGAIN_SEEDS)
def test_exchanged_roles_of_thin_bodies_agree(seed):
    case = case_of(seed)
    record, _ = run(case)
    check_again(case, record)
    assert record["outcome"] == record["exchanged roles"] == "converged", record["reason"]
    assert record["exchanged roles: difference"] < 1e-2


@pytest.mark.once
@pytest.mark.serial
def test_blocks_hang_by_adhesion():
    records = [run(hanging_case(seed))[0] for seed in HANGING_SEEDS]
    assert {record["outcome"] for record in records} == {"converged"}, summary(records)
    assert {record["scene"] for record in records} >= {"glued", "1 hanging"}


@pytest.mark.serial
def test_failed_block_stops_within_one_node_of_its_ground():
    """Beyond its limit, nodal forces would support it again once its edge has passed a node."""
    record, _ = run(hanging_case(18))
    assert record["outcome"] == "dead end", record["reason"]
    assert "slid by 0.4" in record["reason"] and "depends on inertia" in record["reason"]
    assert record["time"] == pytest.approx(end_of_mesh(hanging_case(18)), rel=0.01)


def test_jaw_fails_between_the_two_limit_loads():
    """A block between two jaws slides before the pressures reach those of limit analysis."""
    case = supported_case(31)
    assert earliest_end_of_mesh(case) < 1.9 < end_of_mesh(case) < case.end
    record = {"outcome": "failed", "time": 1.9375}
    confirm(case, record)
    assert record["outcome"] == "dead end" and record["confirmed by"] == "earliest end of mesh"


def test_nodal_forces_bear_less_than_distributed_ones():
    """A block on a clamped one whose nodes are inside of its edges: the lever is that of a node."""
    case = hanging_case(19)
    assert case.pairs[0][0] == "ground/top"
    slave, block = (case.x[case.nodes_of(name)] for name in case.pairs[0])
    places = np.sort([x[0] for x, _ in touching_nodes(slave, block)])
    assert places.size == 3 and np.ptp(places) < 0.8 * np.ptp(block[:, 0])
    assert end_of_mesh(case) < 0.9 * case.end
    swapped = replace(case, pairs=[case.pairs[0][::-1]])
    assert end_of_mesh(swapped) == pytest.approx(case.end)


@pytest.mark.serial
@pytest.mark.parametrize("family", FAMILIES)
def test_shapes_are_drawn_reproducibly(family):
    """Outlines are counter-clockwise, also after refinement; grips are not surfaces."""
    for seed in range(1, 9):
        case, again = shape_case(family, seed), shape_case(family, seed)
        assert np.array_equal(case.x, again.x) and case.about == again.about
        for body in (*case.bodies, *case.refined().bodies):
            centre = body.x[body.cells].mean(axis=1)
            if "around" in body.sides:
                assert (windings(centre, body.x[body.outline]) == 1).all()
            assert not set(body.surfaces) & set(body.grips)


@pytest.mark.serial
def test_judge_detects_crossing_arms():
    case = case_of(3_000_003)
    (one, other), x = case.pairs[0], case.x.copy()
    assert own_overlap(case, x, one, other) == 0.0
    arms = x[case.nodes_of(one)].mean(axis=0), x[case.nodes_of(other)].mean(axis=0)
    x[case.nodes_of(one)] += 1.1 * (arms[1] - arms[0])
    depth = own_overlap(case, x, one, other)
    assert depth == pytest.approx(0.1 * np.linalg.norm(arms[1] - arms[0]), rel=0.1)


@pytest.mark.once
@pytest.mark.serial
def test_judge_detects_wrong_forces_pressures_and_strains():
    case = case_of(5_000_002)
    _, scene = run(case)
    forces, x, rule = scene.bulk_forces(), scene.positions(), case.rules[0]
    normal = case.planes[case.pairs[0][1]][1]
    nodes = case.nodes_of(case.pairs[0][0])
    along = np.array([normal[1], -normal[0]])
    shear = forces[nodes] @ along
    slipped = x + 1e3 * rule.length * np.sign(shear.sum()) * along
    assert next(shape_errors(scene, forces, slipped, x)).startswith("shears are off the law")
    forces[nodes] *= -1.0
    assert any("nodes pull" in wrong for wrong in shape_errors(scene, forces, x, x))
    tubes = case_of(4_000_003)
    _, scene = run(tubes)
    state = scene.bulk_forces(), scene.positions(), scene.positions()
    assert list(shape_errors(scene, *state)) == []
    assert "off Lame's" in next(shape_errors(scene, 1.1 * state[0], *state[1:]))
    moved = replace(tubes, pressure=None, ends_free=True)
    scene.case = moved
    assert any("is strained at the end" in wrong for wrong in shape_errors(scene, *state))


@pytest.mark.serial
def test_shears_of_a_law_are_those_of_its_residual():
    """Formulas of the check compared with the laws, at slips of both signs."""
    slip, pressure = np.linspace(-3.0, 3.0, 13), np.linspace(0.1, 2.0, 13)
    for seed in range(1, 30):
        (rule,) = case_of(5_000_000 + seed).rules
        low, high = shears(rule, slip * rule.length, pressure * rule.stress, 0.0)
        law = rule.law()
        bound = law.friction_limit(pressure * rule.stress)
        assert (low <= high).all() and (np.maximum(-low, high) <= bound * (1 + OF_LAW)).all()
        if rule.kind in ("tanh", "Stribeck"):
            value, _ = law.coefficient(slip * rule.length)
            assert np.allclose(low, value * pressure * rule.stress, rtol=1e-12)
        else:
            assert np.allclose(np.where(slip > 0, high, -low), bound, rtol=1e-12)


@pytest.mark.once
@pytest.mark.serial
def test_limit_analysis_of_a_case_is_the_same_in_its_units_and_where_it_is_turned():
    """The load of each case is a fraction of its limit load: its factor in real units is known."""
    for seed in range(1, 31):
        case = supported_case(seed)
        found = judge(rigid(case))
        assert found.feasible == (case.end > 0.0)
        if found.feasible and np.isfinite(case.end):
            assert found.factor == pytest.approx(case.end - 1.0, rel=1e-5)


@pytest.mark.serial
def test_only_dead_ends_of_failing_bodies_are_confirmed():
    """Only at the limit load, without slip before; few nodes, so that the program is small."""
    case = supported_case(10)
    assert 1.2 < case.end < 2.0
    late, early = case.end + 0.2, 0.5 * case.end
    for given, outcome in (
        ({"outcome": "failed", "time": case.end}, "dead end"),
        ({"outcome": "failed", "time": early}, "failed"),
        ({"outcome": "failed", "time": early, "refused": 2.0}, "dead end"),
        ({"outcome": "failed", "time": late}, "wrong"),
        ({"outcome": "converged", "time": 2.0, "moved": 0.0}, "wrong"),
        ({"outcome": "converged", "time": early, "moved": 2.0 * case.yielding}, "wrong"),
        ({"outcome": "converged", "time": early, "moved": 0.0}, "converged"),
    ):
        record = {"reason": "", **given}
        confirm(case, record)
        assert record["outcome"] == outcome, record


@pytest.mark.skipif(COMM.size == 1, reason="needs several ranks")
@pytest.mark.parametrize("seed", ON_RANKS)
def test_case_is_the_same_on_any_number_of_ranks(seed):
    case = random_case(seed)
    (one, _), (all_ranks, _) = run(case, MPI.COMM_SELF), run(case, COMM)
    assert one["outcome"] == all_ranks["outcome"] == "converged", (one, all_ranks)
    assert one["per_step"] == all_ranks["per_step"]
    size = np.abs(one["response"]).max()
    assert np.abs(np.subtract(one["response"], all_ranks["response"])).max() <= SAME * size


def test_seed_gives_one_reasonable_case_everywhere():
    case, again = random_case(7), random_case(7)
    assert np.array_equal(case.x, again.x) and np.array_equal(case.cells, again.cells)
    numbers = COMM.allgather((case.x.tobytes(), case.cells.tobytes(), repr(case.prescribed)))
    assert len(set(numbers)) == 1
    assert not any(objections(case))
    assert not np.array_equal(case.x.shape, random_case(8).x.shape)


@pytest.mark.serial
def test_refined_case_has_the_same_outline():
    for case in (random_case(1), random_case(2)):
        finer = case.refined()
        assert len(finer.cells) == 4 * len(case.cells)
        for prescribed in case.prescribed:
            coarse = case.x[case.nodes_of(prescribed.boundary)]
            assert np.array_equal(finer.x[finer.nodes_of(prescribed.boundary)][::2], coarse)


@pytest.mark.once
@pytest.mark.serial
def test_judge_detects_wrong_states():
    case = random_case(2)
    _, scene = run(case)
    contact, u = scene.problem.equations.contacts[0], scene.problem.equations.bulk.u.x.array
    assert list(errors(scene, measure(scene))) == []
    good, z = u.copy(), contact.z.copy()
    contact.change(z=1.01 * z)
    assert any("contact force and stresses differ" in wrong for wrong in judged(scene))
    contact.change(z=z)
    push = case.prescribed[1].motion[1]
    upper = np.isin(
        input_nodes(scene.problem.equations.bulk.V)[:, 0], np.arange(*case.first_nodes[1:])
    )
    for factor, message in ((-30.0, "facets apart"), (20.0, "penetration of")):
        u[:] = good
        u.reshape(-1, 2)[upper] += factor * push
        contact.evaluate(u, scene.problem.equations.linearization)
        found = judged(scene)
        assert [message in wrong for wrong in found].count(True) == 1
    assert not any("a force acts over a distance" in wrong for wrong in found), "they cross"


def judged(scene):
    """Messages on errors, with the residual of the present state."""
    scene.problem.equations.bulk.assemble_residual()
    return list(errors(scene, measure(scene)))


@pytest.mark.once
@pytest.mark.serial
def test_second_solution_that_differs_is_wrong():
    case = random_case(12)
    record, _ = run(case)
    check_again(case, record)
    assert record["outcome"] == "converged" and record["half the steps"] == "converged"
    record["response"] = (1.001 * np.array(record["response"])).tolist()
    check_again(case, record)
    assert record["outcome"] == "wrong"
    assert "half the steps change the response by 1.0e-03" in record["reason"]
    json.dumps(record)


@pytest.mark.once
@pytest.mark.serial
def test_process_that_does_not_answer_or_dies_is_replaced():
    worker = Worker()
    try:
        assert worker.run(6, 0.0)["outcome"] == "hang"
        worker._process.kill()
        worker._process.join()
        assert worker.run(6, 60.0)["outcome"] == "crash"
        assert worker.run(6, 60.0)["outcome"] == "converged"
    finally:
        worker.stop()


@pytest.mark.serial
def test_springs_do_not_end_a_slide_at_the_friction_limit():
    """One node of a jaw is guided and has no shear: the other nodes bear less than the load."""
    scene = build(case_of(1_000_031), MPI.COMM_SELF)
    scene.set_loads(1.0)
    scene.problem.solve()
    scene.set_loads(2.0)
    with pytest.raises(fm.NotConvergedError, match="slide at their friction limit"):
        scene.problem.solve()
