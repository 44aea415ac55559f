# SPDX-License-Identifier: MIT
"""Memory of a law: stored, restored, saved and restarted; errors; all solution methods."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from friction_scenes import block_on
from one_rank import LAST, raised_on_the_last_rank, several_ranks
from refusal import refused
from scenes import linear_elastic, nodal, pair_options, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.contact.fields import ContactFields
from fenics_mortar.laws import Cohesive, RateAndState, SoftLayer, Stribeck, Worn
from fenics_mortar.sensitivity.partials.history import by_parameter, change_of_rows
from fenics_mortar.utils.errors import NotFiniteError

comm = MPI.COMM_WORLD
SMALL = {"n_upper": 3, "n_lower": 4, "layers_upper": 2, "layers_lower": 2}


def rate_and_state():
    return RateAndState(0.4, 0.1, 0.05, 0.05, 0.005)


def blocks(law, **options):
    return pressed_blocks(**{"pair": {"law": law}, **SMALL, **options})


def drive(scene, steps):
    """Press and shear at a constant rate; ``steps`` are step numbers."""
    for number in steps:
        scene.problem.time = 0.5 * number
        scene.loads["push"].value[:] = 0.01 * number, -0.02 - 0.002 * number
        assert scene.problem.solve(predict=False).certificate.violations() == []


def memory(scene):
    return scene.contact.state.accepted_instant.memory


@pytest.mark.once
def test_restart_is_bitwise_identical(tmp_path):
    whole, part, rest = (blocks(rate_and_state()) for _ in range(3))
    drive(whole, range(1, 6))
    drive(part, range(1, 4))
    fm.save_state(part.problem, tmp_path / "state")
    fm.load_state(rest.problem, tmp_path / "state")
    assert rest.problem.time == 1.5
    assert (memory(rest)["theta"] == memory(part)["theta"]).all()
    drive(rest, range(4, 6))
    assert (memory(rest)["theta"] == memory(whole)["theta"]).all()
    assert (rest.u.x.array == whole.u.x.array).all()
    assert (rest.contact.z == whole.contact.z).all()


@several_ranks
def test_restart_on_another_number_of_ranks(tmp_path):
    path = comm.bcast(tmp_path) / "state"
    whole = blocks(rate_and_state())
    drive(whole, range(1, 4))
    if comm.rank == 0:
        alone = blocks(rate_and_state(), comm=MPI.COMM_SELF)
        drive(alone, range(1, 3))
        fm.save_state(alone.problem, path)
        kept = memory(alone)["theta"]
    comm.barrier()
    rest = blocks(rate_and_state())
    fm.load_state(rest.problem, path)
    assert (memory(rest)["theta"] == comm.bcast(kept if comm.rank == 0 else None)).all()
    drive(rest, range(3, 4))
    assert memory(rest)["theta"] == pytest.approx(memory(whole)["theta"], rel=1e-9)


def test_checkpoint_with_the_memory_of_another_law_is_refused(tmp_path):
    path = comm.bcast(tmp_path) / "state"
    fm.save_state(blocks(rate_and_state()).problem, path)
    with refused(fm.MortarError, "memory of another contact law: theta; this problem has depth"):
        fm.load_state(blocks(Worn(0.1, 0.1)).problem, path)


@pytest.mark.once
def test_failed_step_leaves_time_and_memory():
    one, other = (blocks(rate_and_state()) for _ in range(2))
    for scene in (one, other):
        drive(scene, [1])
    before, state = one.contact.state.accepted_instant, one.problem.state()
    one.problem.equations.newton = replace(one.problem.equations.newton, max_iterations=1)
    one.problem.time, one.loads["push"].value[0] = 0.7, 0.08
    with pytest.raises(fm.NotConvergedError):
        one.problem.solve(predict=False)
    assert one.contact.state.accepted_instant is before
    one.problem.restore(state)
    assert one.problem.time == 0.5
    one.problem.equations.newton = other.problem.equations.newton
    for scene in (one, other):
        drive(scene, [2])
    assert (memory(one)["theta"] == memory(other)["theta"]).all()


def test_law_receives_the_steps_of_a_path():
    """A path from time 3, with a cut, is the loop over the same times."""
    law = Worn(0.05, 2e-2)
    records = []
    path, loop = blocks(law), blocks(law)

    def loads(scene, time):
        scene.loads["push"].value[:] = 0.05 * (time - 3.0), -0.03

    path.problem.equations.newton = replace(path.problem.equations.newton, max_iterations=12)
    fm.follow_path(
        path.problem, lambda t: loads(path, t), fm.SteppingOptions(step=0.5, predict=False),
        start=3.0, stop=5.0,
        on_step=lambda time, _: records.append((time, path.contact.nodal.step)),
    )  # fmt: skip
    assert path.problem.time == 5.0
    before = 3.0
    for time, step in records:
        assert step == pytest.approx(time - before, rel=1e-12)
        before = time
        loads(loop, time)
        loop.problem.time = time
        loop.problem.solve(predict=False)
    assert memory(loop)["depth"] == pytest.approx(memory(path)["depth"], rel=1e-9)
    assert memory(path)["depth"].max() > 0.0


@pytest.mark.once
def test_another_law_starts_with_its_own_memory():
    scene = blocks(rate_and_state())
    drive(scene, [1])
    theta = memory(scene)["theta"]
    scene.contact.pair.law = RateAndState(0.3, 0.1, 0.05, 0.05, 0.005)
    drive(scene, [2])
    assert (memory(scene)["theta"] != 10.0).any() and theta.shape == memory(scene)["theta"].shape
    scene.contact.pair.law = Worn(0.1, 1e-2)
    drive(scene, [3])
    assert set(memory(scene)) == {"depth"}
    scene.contact.pair.law = fm.Coulomb(0.1)
    drive(scene, [4])
    assert not memory(scene) and type(scene.contact.now) is ContactFields


class Wrong(Worn):
    """Wear law, one method of which returns a wrong value from some time on."""

    def __init__(self, method, spoil):
        super().__init__(0.1, 1e-2)
        self.method, self._spoil, self._on = method, spoil, False

    def _answer(self, method, answer):
        return self._spoil(answer) if self._on and method == self.method else answer

    def closing_gap(self, node):
        return self._answer("closing_gap", super().closing_gap(node))

    def remember(self, node, branch):
        return self._answer("remember", super().remember(node, branch))

    def initial(self, X):
        return self._answer("initial", super().initial(X))

    def friction_limit_at(self, node):
        return self._answer("limit", super().friction_limit_at(node))

    def adhesion_at(self, node):
        return self._answer("adhesion", super().adhesion_at(node))


WRONG = [
    ("closing_gap", lambda row: row._replace(residual=np.nan * row[0]), NotFiniteError, "closing_"),
    ("closing_gap", lambda row: row._replace(by_slip=row[2][:1]), ValueError, r"shape \(1,\)"),
    ("closing_gap", lambda row: None, ValueError, "closing_gap returned None; expected a Row"),
    ("remember", lambda kept: {}, ValueError, "remember returned {}; expected arrays named depth"),
    ("remember", lambda kept: {"depth": kept["depth"][:2]}, ValueError, r"shape \(2,\)"),
    ("remember", lambda kept: {"depth": np.nan * kept["depth"]}, ValueError, "depth is not finite"),
    ("limit", lambda b: b - 1.0, NotFiniteError, "friction_limit returned -"),
    ("adhesion", lambda row: row._replace(residual=-1.0), ValueError, "adhesion returned -1"),
]


@pytest.mark.each
@pytest.mark.parametrize("method, spoil, kind, message", WRONG)
def test_invalid_results_are_refused(method, spoil, kind, message):
    law = Wrong(method, spoil)
    scene = blocks(law)
    drive(scene, [1])
    law._on = True
    with refused(kind, message):
        drive(scene, [2])
    law._on = False
    drive(scene, [2])


@several_ranks
@pytest.mark.parametrize("method", ["closing_gap", "remember", "limit"])
def test_law_that_raises_on_one_rank_raises_on_all(method):
    def fail(answer):
        if LAST:
            raise ZeroDivisionError("no law here")
        return answer

    law = Wrong(method, fail)
    scene = blocks(law)
    drive(scene, [1])
    law._on = True
    with raised_on_the_last_rank(ZeroDivisionError, "no law here"):
        drive(scene, [2])
    law._on = False
    drive(scene, [2])


def test_invalid_initial_memory_is_refused():
    law = Wrong("initial", lambda kept: {"depth": [0.0]})
    law._on = True
    with refused(ValueError, r"initial: depth has shape \(1,\)"):
        blocks(law)


def test_law_with_a_rate_needs_the_time():
    scene = blocks(Stribeck(0.4, 0.2, 0.05))
    with refused(fm.MortarError, "needs the length of the step.*set problem.time"):
        scene.problem.solve()
    drive(scene, [1])
    with refused(fm.MortarError, "the time 0.5 is not later than 0.5"):
        drive(scene, [1])


@pytest.mark.each
@pytest.mark.parametrize(
    "mu, message",
    [
        (np.array([0.1]), r"mu has shape \(1,\)"),
        (lambda X: X[:, 0] - 10.0, "mu=-.*: expected zero or a positive number"),
        (lambda X: np.nan * X[:, 0], "mu is not finite at"),
        (lambda X: 1 / 0, "division by zero"),
    ],
)
def test_invalid_fields_are_refused(mu, message):
    law = fm.Coulomb(0.1)
    scene = blocks(law)
    law.mu = mu
    with refused(
        ZeroDivisionError if "zero" in message and "or" not in message else ValueError, message
    ):
        drive(scene, [1])
    law.mu = 0.1
    drive(scene, [1])


@pytest.mark.once
def test_derivative_by_nodal_coefficients_of_friction():
    """One number for all nodes is the sum of the nodal derivatives."""
    found = []
    for mu in (0.1, np.full(4, 0.1)):
        scene = blocks(fm.Coulomb(mu))
        drive(scene, [1, 2])
        assert scene.contact.sliding.any()
        contact = scene.contact
        found.append(by_parameter(contact, "mu", change_of_rows) @ np.ones(np.size(mu)))
    assert np.abs(found[0]).max() > 0.0
    assert found[1] == pytest.approx(found[0], abs=1e-12 * np.abs(found[0]).max())


LAWS = {
    "wear": Worn(0.03, 2e-2),
    "compliance": SoftLayer(2000.0, 1.5, 0.3),
    "Stribeck": Stribeck(0.4, 0.2, 0.05, 0.1),
    "rate and state": rate_and_state(),
    "field": fm.Coulomb(lambda X: 0.2 + 0.1 * np.sin(X[:, 0])),
}


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize("name", LAWS)
def test_all_solvers_agree(name):
    states = []
    solvers = [
        {"algorithm": "condensed", "linear_bulk": False}, {"algorithm": "saddle"},
        {"solver": "iterative"}, {"linear_bulk": True},
    ]  # fmt: skip
    for solver in solvers:
        scene = blocks(LAWS[name], material=linear_elastic, problem=solver)
        drive(scene, [1, 2])
        states.append((nodal(scene.problem), scene.contact.z))
    for other in states[1:]:
        for a, b in zip(states[0], other, strict=True):
            assert np.abs(a - b).max() < 1e-7 * np.abs(a).max()


CHOICES = [
    {"basis": "standard"}, {"slip": "operators"}, {"integration": "elements"},
    {"gap_weights": "basis"}, {"sliding": "small"},
]  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize("choice", CHOICES, ids=lambda choice: next(iter(choice.values())))
@pytest.mark.parametrize("name", LAWS)
def test_tangent_by_all_discretizations(name, choice):
    pair = pair_options(choice, law=LAWS[name])
    material = {"material": linear_elastic} if "sliding" in choice else {}
    scene = pressed_blocks(pair=pair, **SMALL, **material)
    drive(scene, [1, 2])
    # Terms of higher order, or rounding, make the slope larger; a missing term makes it 1.
    assert scene.problem.check_tangent(print_table=False).slopes["whole"] > 1.98


@pytest.mark.serial
@pytest.mark.parametrize("name", LAWS)
def test_tangent_with_a_thickness(name):
    scene = blocks(LAWS[name], problem={"thickness": lambda X: 1.0 + 0.3 * X[:, 0]})
    drive(scene, [1, 2])
    assert scene.problem.check_tangent(print_table=False).slopes["whole"] > 1.98


@pytest.mark.parametrize("name", [*LAWS, "cohesive"])
def test_tangent_at_an_obstacle(name):
    """The motions of the circle are directions of the test, too."""
    circle = fm.Circle((0.5, -2.0), 2.01)
    law = Cohesive(2.0, 0.4) if name == "cohesive" else LAWS[name]
    problem, _ = block_on(circle, law=law)
    for number in (1,) if name == "cohesive" else (1, 2):
        problem.time = float(number)
        circle.move(x=0.02 * number)
        assert problem.solve().certificate.violations() == []
    assert problem.equations.contacts[0].acts.any()
    assert problem.check_tangent(print_table=False).slopes["whole"] > 1.98
