# SPDX-License-Identifier: MIT
"""History functions: updated by accepted steps only, part of the state, saved and restored."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest
from history_scenes import Block, in_space, plastic, viscous
from refusal import refused

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.bulk.history import History
from fenics_mortar.mesh.space import by_cell

comm = MPI.COMM_WORLD
DEPTHS = (0.004, 0.008, 0.012)
# Iterations that suffice for the step from 0.004 to 0.008, but not for the first one to 0.012.
FEW = fm.NewtonOptions(residual_tolerance=1e-13, max_iterations=5)


def are_equal(*values):
    """Whether two arrays are equal, bit for bit on one rank.

    Parallel factorizations add numbers in the order in which messages arrive; displacements and
    strains of the scene are about 0.01.
    """
    one, other = values
    return np.array_equal(one, other) if comm.size == 1 else np.abs(one - other).max() < 1e-11


def with_history(of, **options):
    """A block of linear elasticity and the history that ``of`` makes of displacement and degree."""

    def law(u, degree, dt):
        elastic = plastic(u, degree, sigma_y=1e9)
        elastic.history = of(u, degree)
        return elastic

    return Block(law, **options)


# Values


@pytest.mark.parametrize("cell, degree", [("quadrilateral", 1), ("triangle", 2)])
def test_new_values_are_those_of_the_expressions_at_the_points(cell, degree):
    """Of a tensor that is known at all points; means over cells are exact."""
    made = {}

    def of(u, points):
        made["f"] = fm.quadrature_function(u.function_space.mesh, points, (2, 2))
        x = ufl.SpatialCoordinate(u.function_space.mesh)
        made["exact"] = ufl.outer(x, x + u)
        return [(made["f"], made["exact"])]

    block = with_history(of, cell=cell, degree=degree)
    block.press(0.004)
    difference = made["f"] - made["exact"]
    dx = ufl.dx(degree=2 * degree)
    square = fem.assemble_scalar(fem.form(ufl.inner(difference, difference) * dx))
    assert comm.allreduce(square) < 1e-28
    assert comm.allreduce(np.abs(made["f"].x.array).max(initial=0.0), MPI.MAX) > 0.5


def test_all_expressions_are_evaluated_before_a_function_changes():
    made = {}

    def of(u, points):
        mesh = u.function_space.mesh
        made["a"], made["b"] = (fm.quadrature_function(mesh, points) for _ in range(2))
        return [(made["a"], made["b"] + 0 * u[0]), (made["b"], made["a"] + 1.0 + 0 * u[0])]

    block = with_history(of)
    found = []
    for depth in DEPTHS:
        block.press(depth)
        found.append([made[name].x.array.copy() for name in "ab"])
    for (a, b), numbers in zip(found, [(0.0, 1.0), (1.0, 1.0), (1.0, 2.0)], strict=True):
        assert (a == numbers[0]).all() and (b == numbers[1]).all()


def test_values_set_by_the_user_are_those_at_the_start_of_the_next_step():
    """A block that has hardened before yields later."""
    block, hard = Block(), Block()
    block.press(0.004)
    hard.material.shown["alpha"].x.array[:] = 1e3
    hard.press(0.004)
    elastic = Block(partial(plastic, sigma_y=1e9))
    elastic.press(0.004)
    assert hard.force == pytest.approx(elastic.force, rel=1e-10)
    assert block.force < 0.8 * elastic.force


# Forces at the present state


def test_forces_of_a_viscous_body_are_those_of_the_end_of_the_step(shared_path):
    """Not those after another step; also from a file, and of a tangent with history."""
    block = Block(viscous)
    for depth in DEPTHS:
        report = block.press(depth, dt=0.3)
    assert report.certificate.balance < 1e-11
    reaction = block.problem.reaction("block/bottom").force[1]
    assert reaction == pytest.approx(block.force, rel=1e-10)
    slopes = block.problem.check_tangent(print_table=False).slopes
    assert slopes["bulk"] == np.inf and slopes["whole"] > 1.9
    fm.save_state(block.problem, shared_path / "state")
    other = Block(viscous)
    other.dt.value = 0.3
    fm.load_state(other.problem, shared_path / "state")
    again = other.problem.reaction("block/bottom").force[1]
    assert again == pytest.approx(reaction, rel=1e-12)
    assert other.problem.certificate().balance < 1e-11


def test_tangent_with_plastic_flow_is_consistent():
    block = Block()
    reports = [block.press(depth) for depth in DEPTHS]
    slopes = block.problem.check_tangent(print_table=False).slopes
    assert min(slopes["bulk"], slopes["whole"]) > 1.9
    residuals = np.array(reports[0].residuals)
    assert residuals[-2] < residuals[-3] ** 1.5 < 1e-3


def test_one_step_far_beyond_yield_takes_few_iterations():
    """Full steps diverge, and would be followed by damped ones at best."""
    law = partial(plastic, sigma_y=0.3, H=0.0)
    block = Block(law, degree=2, columns=6, obstacle=fm.Circle((0.0, 2.0), 1.0))
    report = block.press(0.03)
    assert report.num_iterations <= 15
    assert block.material.shown["alpha"].x.array.max() > 20 * 0.3 / 200.0


@pytest.mark.serial
def test_history_functions_are_no_loads():
    """Steps of equal length are extrapolated, while plastic strains do not grow in proportion."""
    block = Block()
    reports = [block.press(depth) for depth in np.linspace(0.002, 0.012, 6)]
    plain = Block()
    others = [plain.press(depth, predict=False) for depth in np.linspace(0.002, 0.012, 6)]
    assert sum(r.num_iterations for r in reports) < sum(r.num_iterations for r in others)
    assert np.abs(block.values - plain.values).max() < 1e-9


# Steps that are not accepted


def test_failed_solves_do_not_change_history():
    block, plain = Block(), Block()
    block.press(DEPTHS[0], predict=False)
    plain.press(DEPTHS[0], predict=False)
    state = block.problem.state()
    block.problem.equations.newton = fm.NewtonOptions(max_iterations=1)
    with pytest.raises(fm.NotConvergedError):
        block.press(0.02)
    now = block.problem.state().history
    assert np.array_equal(now.accepted, state.history.accepted)
    block.problem.restore(state)
    block.problem.equations.newton = plain.problem.equations.newton
    block.press(DEPTHS[1], predict=False)
    plain.press(DEPTHS[1], predict=False)
    assert are_equal(block.values, plain.values)


def test_states_that_violate_their_certificate_do_not_change_history(monkeypatch):
    block = Block()
    block.press(DEPTHS[0])
    before = block.problem.state().history
    certificate = "fenics_mortar.verify.certificate.Certificate.violations"
    with monkeypatch.context() as wrong:
        wrong.setattr(certificate, lambda self: ["wrong on purpose"])
        with pytest.raises(fm.NotConvergedError, match="wrong on purpose"):
            block.press(DEPTHS[1])
        assert np.array_equal(block.problem.state().history.accepted, before.accepted)
        block.press(DEPTHS[1], accept_violations=True)
    change = np.abs(block.problem.state().history.accepted - before.accepted)
    assert comm.allreduce(change.max(initial=0.0), MPI.MAX) > 1e-4


def test_a_state_is_restored_with_its_history():
    block = Block(viscous)
    block.press(DEPTHS[0], predict=False)
    state = block.problem.state()
    force = block.problem.reaction("block/bottom").force
    block.press(DEPTHS[2], predict=False)
    first = block.values
    block.problem.restore(state)
    assert are_equal(block.problem.reaction("block/bottom").force, force)
    block.press(DEPTHS[2], predict=False)
    assert are_equal(block.values, first)


def test_new_values_that_are_not_finite_are_refused_and_nothing_changes():
    made = {}

    def of(u, points):
        made["f"] = fm.quadrature_function(u.function_space.mesh, points)
        made["f"].name = "wear"
        return [(made["f"], ufl.sqrt(u[1]))]

    block = with_history(of)
    state = block.problem.state()
    with refused(fm.MortarError, r"the new value of history function 'wear' is not finite in \d+ "):
        block.press(DEPTHS[0])
    assert np.array_equal(block.problem.state().u, state.u) and not made["f"].x.array.any()


# Paths


@pytest.mark.serial
def test_a_path_with_cuts_ends_in_the_state_of_a_loop_over_its_steps():
    block, plain = Block(newton=FEW), Block()

    def set_loads(time):
        block.obstacle.move(y=-0.012 * time)

    options = fm.SteppingOptions(step=1.0, smallest=0.05, predict=False)
    path = fm.follow_path(block.problem, set_loads, options)
    assert path.num_cuts > 0
    for step in path.steps:
        plain.press(0.012 * step.time, predict=False)
    assert are_equal(block.values, plain.values)


def test_time_steps_with_cuts_end_in_the_state_of_single_steps():
    """A plastic block that is pressed by a moving roller."""
    blocks = [Block(newton=FEW), Block()]
    motions = [fm.Dynamics(block.problem, 1e-4, scheme="massless") for block in blocks]

    def set_loads(time, block=blocks[0]):
        block.obstacle.move(y=-0.012 * time)

    record = motions[0].run(1.0, fm.SteppingOptions(step=1.0, smallest=0.05), set_loads)
    assert any(step.failures for step in record.steps)
    for step in record.steps:
        set_loads(step.time, blocks[1])
        motions[1].step(step.size)
    assert are_equal(blocks[0].values, blocks[1].values)
    assert comm.allreduce(blocks[0].material.shown["alpha"].x.array.max(initial=0.0), MPI.MAX) > 0


def test_steps_of_time_follow_from_the_time_at_their_start():
    """A path whose time is a constant and that cuts one step, as a loop over its steps."""

    def law(u, degree, time):
        start = fm.quadrature_function(u.function_space.mesh, degree)
        material = viscous(u, degree, time - start)
        material.history.append((start, time))
        return material

    block, plain, refused_at = Block(law), Block(viscous), []

    def load(time):
        fails = time > 0.6 and not refused_at
        refused_at.extend([time] * fails)
        limit = 1 if fails else 30
        block.problem.equations.newton = fm.NewtonOptions(limit, residual_tolerance=1e-13)
        block.dt.value = time
        block.obstacle.move(y=-0.012 * time)

    path = fm.follow_path(block.problem, load, fm.SteppingOptions(step=0.5, predict=False))
    assert path.num_cuts == 1 and len(path.steps) > 2
    before = 0.0
    for step in path.steps:
        plain.press(0.012 * step.time, dt=step.time - before, predict=False)
        before = step.time
    assert block.force == pytest.approx(plain.force, rel=1e-10)


# Files


@pytest.mark.parametrize("law", [plastic, viscous])
def test_a_run_from_a_file_equals_the_whole_run(shared_path, law):
    block, other = Block(law), Block(law)
    for depth in DEPTHS[:2]:
        block.press(depth, dt=0.3, predict=False)
    fm.save_state(block.problem, shared_path / "state")
    fm.load_state(other.problem, shared_path / "state")
    assert are_equal(other.values, block.values)
    for each in (block, other):
        each.press(DEPTHS[2], dt=0.3, predict=False)
    assert are_equal(other.values, block.values)


@pytest.mark.parametrize("cell, degree", [("quadrilateral", 1), ("triangle", 2)])
def test_a_file_is_read_on_another_number_of_ranks(shared_path, cell, degree):
    block = Block(cell=cell, degree=degree)
    block.press(DEPTHS[0])
    fm.save_state(block.problem, shared_path / "state")
    alone = Block(cell=cell, degree=degree, comm=MPI.COMM_SELF)
    fm.load_state(alone.problem, shared_path / "state")
    both = [each.problem.equations.bulk.history.saved_data() for each in (block, alone)]
    assert both[0].keys() == both[1].keys() and len(both[0]) == 5
    assert all(np.array_equal(both[0][name], both[1][name]) for name in both[0])


def test_files_of_other_history_are_refused(shared_path):
    fm.save_state(Block().problem, shared_path / "state")
    with refused(fm.MortarError, "with 2 history functions; this one has 3"):
        fm.load_state(Block(viscous).problem, shared_path / "state")
    fm.save_state(with_history(lambda u, points: ()).problem, shared_path / "none")
    with refused(fm.MortarError, "with 0 history functions; this one has 2"):
        fm.load_state(Block().problem, shared_path / "none")


def test_stresses_are_written_and_drawn(shared_path):
    """An expression of old values, and a stress kept in a history function; means over cells."""
    block = Block(viscous)
    block.press(DEPTHS[0], dt=0.3)
    kept = block.material.shown["stress"]
    fm.plot(block.problem, shared_path / "stress.png", stress=ufl.sqrt(ufl.inner(kept, kept)))
    fields = {"kept": kept, "yy": block.material.stress[1, 1]}
    with fm.ResultsWriter(shared_path / "out", block.problem, fields) as results:
        results.write(0.0)
    assert (shared_path / "stress.png").exists()
    comm.barrier()


# What is refused

MESH = {"columns": 2, "rows": 1}


def function_and(make):
    """Law with the pair of a function, of degree 2 and called "f", and the result of ``make``."""

    def of(u, points):
        f = fm.quadrature_function(u.function_space.mesh, points)
        f.name = "f"
        return make(f, u)

    return of


@pytest.mark.each
@pytest.mark.parametrize(
    "make, message",
    [
        (lambda f, u: [f], "expected a list of pairs"),
        (lambda f, u: f, "expected a list of pairs"),
        (lambda f, u: [(u, u)], "'u' is not a quadrature function"),
        (lambda f, u: [(f, 1.0)], "the new value of history function 'f'.*a UFL expression"),
        (lambda f, u: [(f, u)], r"has the shape \(2,\): expected that of the function, \(\)"),
        (lambda f, u: [(f, u[0]), (f, u[1])], "history has a function twice"),
        (
            lambda f, u: [(f, ufl.TestFunction(u.function_space)[0])],
            "'f' has a test or trial function",
        ),
        (
            lambda f, u: [(f, f + fm.quadrature_function(u.function_space.mesh, 4))],
            "'f' is of degree 2, and its new value contains quadrature functions of other degrees",
        ),
    ],
)
def test_wrong_pairs_are_refused(make, message):
    with refused(ValueError, message):
        with_history(function_and(make), **MESH)


@pytest.mark.each
@pytest.mark.parametrize(
    "measure, message",
    [
        (
            ufl.dx(degree=4),
            r"of degree 2, and an integral of the residual .* of degree 4: expected",
        ),
        (ufl.ds(degree=2), "'f' has no values on facets, and an integral of the residual has it"),
    ],
)
def test_integrals_at_other_points_are_refused(measure, message):
    block = Block(**MESH)
    V, f = block.u.function_space, fm.quadrature_function(block.data.mesh, 2)
    f.name = "f"
    strain = in_space(fm.energies.strain(ufl.TestFunction(V)))
    residual = ufl.inner(in_space(fm.energies.strain(block.u)), strain) * ufl.dx(degree=2)
    residual += f * ufl.TestFunction(V)[0] * measure
    with refused(ValueError, message):
        fm.ContactProblem(residual, block.u, [], history=[(f, f)], petsc_options_prefix="refused_")


def test_functions_of_a_wrong_degree_or_shape_are_refused():
    mesh = Block(**MESH).data.mesh
    for degree, shape in ((-1, ()), (1.5, ()), (2, 3), (2, (0,)), (2, (3, 3, 3))):
        with refused(ValueError, "degree|shape"):
            fm.quadrature_function(mesh, degree, shape)
    with refused(ValueError, "mesh"):
        fm.quadrature_function(None, 2)


def test_features_without_history_refuse_it_by_name():
    block = Block(**MESH)
    block.press(DEPTHS[0])
    named = "does not support bodies with history .here of 'plastic_strain', 'alpha'."
    with refused(fm.MortarError, rf"estimate\(\) {named}"):
        block.problem.estimate()
    with refused(fm.MortarError, f"the gradient of a path {named}"):
        fm.gradient(fm.sensitivity.TotalForce(0, (0.0, 1.0)), [], block.problem)
    with refused(ValueError, "scheme='conserving' returns lost energy, and does not support"):
        fm.Dynamics(block.problem, 1.0)
    with refused(ValueError, "model_check does not support history"):
        Block(**MESH, model_check=fm.ModelCheck())


def test_values_by_cells_do_not_depend_on_the_partition():
    """Of a function that differs at all points."""
    block, alone = (Block(cell="triangle", comm=c) for c in (comm, MPI.COMM_SELF))
    found = []
    for each in (block, alone):
        f = fm.quadrature_function(each.data.mesh, 2)
        x = ufl.SpatialCoordinate(each.data.mesh)
        values = History([(f, x[0] + 7.0 * x[1])]).new_values()
        found.append(by_cell(f, values))
    for one, other in zip(*found, strict=True):
        assert np.abs(one - other).max() < 1e-14
