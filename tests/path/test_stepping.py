# SPDX-License-Identifier: MIT
"""Adaptive load steps: exact reverts of failed steps, restarts, complete reports."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import internal, neo_hookean, pressed_blocks, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.law import Row
from fenics_mortar.path.stepping import StepLengths
from meshes import indenter_on_block

comm = MPI.COMM_WORLD
MESH = {"n_upper": 6, "n_lower": 9, "layers_upper": 4, "layers_lower": 4}


def ironing(on=comm, law=None):
    """A small ironing scene: the tool goes down for times to 1, then along."""
    data = read(
        indenter_on_block.build,
        comm=on,
        n_block=36,
        layers_block=10,
        n_indenter=8,
        layers_indenter=5,
    )
    V = fm.vector_space(data.mesh, 1)
    u, tool = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "block/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "indenter/top", tool),
    ]
    pair = fm.ContactPair(data, "block/top", "indenter/arc", law=law)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u, [pair], bcs=bcs, petsc_options_prefix="iron_"
    )

    def set_loads(time):
        tool.value[:] = (max(time - 1.0, 0.0), -0.7 * min(time, 1.0))

    return problem, set_loads


@pytest.mark.once
@pytest.mark.serial
def test_path_that_fails_in_one_step_is_finished_in_several():
    problem, set_loads = ironing()
    fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), stop=1.0)
    options = fm.SteppingOptions(step=5.0)
    path = fm.follow_path(problem, set_loads, options, start=1.0, stop=6.0)
    assert path.finished and path.num_cuts > 0
    assert path.steps[-1].time == 6.0
    assert sum(step.step for step in path.steps) == pytest.approx(5.0, rel=1e-12)
    small, set_small = ironing()
    fm.follow_path(small, set_small, fm.SteppingOptions(step=0.5), stop=6.0)
    z, exact = problem.equations.contacts[0].z, small.equations.contacts[0].z
    assert np.abs(z - exact).max() < 1e-10 * np.abs(exact).max()  # Newton's tolerance
    assert problem.certificate().pairs[0].violations() == []


def test_failed_step_leaves_the_state_unchanged():
    problem, set_loads = ironing()
    fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25), stop=1.0)
    before = problem.state()
    with pytest.raises(fm.NotConvergedError, match="a step of 5.0e\\+00 fails") as failure:
        options = fm.SteppingOptions(step=5.0, smallest=5.0)
        fm.follow_path(problem, set_loads, options, start=1.0, stop=6.0)
    after = problem.state()
    assert np.array_equal(after.u, before.u)
    assert np.array_equal(after.interfaces[0].z, before.interfaces[0].z)
    assert np.array_equal(after.interfaces[0].active, before.interfaces[0].active)
    path = failure.value.report
    assert not path.finished and len(path.failures) == 1 and not path.steps
    assert path.failures[0].reason in str(path)


def test_steps_grow_when_they_are_easy_and_end_exactly():
    scene = pressed_blocks(**MESH)
    push = scene.loads["push"]
    times = []

    def set_loads(time):
        push.value[1] = -0.1 * time

    options = fm.SteppingOptions(step=0.1, largest=0.3)
    path = fm.follow_path(
        scene.problem, set_loads, options, on_step=lambda time, report: times.append(time)
    )
    sizes = [step.step for step in path.steps]
    assert sizes[1] == pytest.approx(0.2) and max(sizes) <= 0.3
    assert times[-1] == 1.0 and len(times) == len(path.steps)
    assert path.num_iterations == sum(step.report.num_iterations for step in path.steps)


@pytest.mark.parametrize("writer, reader", [(comm, comm), (comm, MPI.COMM_SELF)])
def test_restart_continues_the_run_on_any_number_of_ranks(writer, reader, shared_path):
    options = fm.SteppingOptions(step=0.25)
    whole, set_whole = ironing(writer)
    fm.follow_path(whole, set_whole, options, stop=1.25)
    file = str(shared_path / "state.npz")
    fm.save_state(whole, file)
    fm.follow_path(whole, set_whole, options, start=1.25, stop=1.75)
    again, set_again = ironing(reader)
    fm.load_state(again, file)
    path = fm.follow_path(again, set_again, options, start=1.25, stop=1.75)
    z, exact = again.equations.contacts[0].z, whole.equations.contacts[0].z
    assert len(path.steps) == 2
    assert np.abs(z - exact).max() < 1e-12 * np.abs(exact).max()  # nothing is lost


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_state_of_degree_two_is_read_on_any_number_of_ranks(cell, shared_path):
    file = str(shared_path / "state.npz")
    together = pressed_blocks(degree=2, cell=cell, **MESH)
    together.u.interpolate(lambda X: np.stack([0.1 * X[0] ** 2, X[0] * X[1] - 0.2 * X[1] ** 2]))
    fm.save_state(together.problem, file)
    alone = pressed_blocks(degree=2, cell=cell, comm=MPI.COMM_SELF, **MESH)
    exact = alone.u.copy()
    exact.interpolate(lambda X: np.stack([0.1 * X[0] ** 2, X[0] * X[1] - 0.2 * X[1] ** 2]))
    fm.load_state(alone.problem, file)
    assert np.abs(alone.u.x.array - exact.x.array).max() < 1e-14


def test_state_of_another_degree_is_refused(shared_path):
    file = str(shared_path / "state.npz")
    fm.save_state(pressed_blocks(**MESH).problem, file)
    with pytest.raises(fm.MortarError, match="another mesh or degree"):
        fm.load_state(pressed_blocks(degree=2, **MESH).problem, file)


@pytest.mark.once
def test_state_of_another_mesh_is_refused(shared_path):
    file = str(shared_path / "state.npz")
    fm.save_state(pressed_blocks(**MESH).problem, file)
    other = pressed_blocks(n_upper=7, n_lower=9, layers_upper=4, layers_lower=9).problem
    with pytest.raises(fm.MortarError, match="another mesh"):
        fm.load_state(other, file)


def test_file_of_a_state_that_cannot_be_read_is_refused_by_all_ranks(shared_path):
    """A rank that raises alone would make the others wait."""
    problem = pressed_blocks(**MESH).problem
    with pytest.raises(fm.MortarError, match=r"cannot read '.*missing.npz': .*No such file"):
        fm.load_state(problem, shared_path / "missing")
    if comm.rank == 0:
        (shared_path / "text.npz").write_text("no arrays")
    comm.barrier()
    with pytest.raises(fm.MortarError, match=r"cannot read '.*text.npz'"):
        fm.load_state(problem, shared_path / "text.npz")
    with pytest.raises(fm.MortarError, match="cannot create the folder"):
        fm.save_state(problem, shared_path / "text.npz" / "state")


def test_state_is_read_under_the_name_of_rank_0(shared_path):
    problem = pressed_blocks(**MESH).problem
    problem.equations.contacts[0].change(z=np.ones_like(problem.equations.contacts[0].z))
    fm.save_state(problem, shared_path / "new" / f"state{'' if comm.rank == 0 else 'elsewhere'}")
    again = pressed_blocks(**MESH).problem
    fm.load_state(again, shared_path / "new" / "state")
    assert (again.equations.contacts[0].z == 1.0).all()


def test_state_with_slave_and_master_exchanged_is_refused(shared_path):
    fm.save_state(pressed_blocks(**MESH).problem, shared_path / "state")
    other = pressed_blocks(slave="lower", **MESH).problem
    with pytest.raises(fm.MortarError, match="a problem with other pairs"):
        fm.load_state(other, shared_path / "state")


@pytest.mark.parametrize(
    "options",
    [
        {"step": 0.0},
        {"step": "0.1"},
        {"step": 0.1, "smallest": 0.2},
        {"step": 0.1, "cut": 1.0},
        {"step": 0.1, "largest": None, "growth": [2.0]},
    ],
)
def test_stepping_options_that_cannot_work_are_refused(options):
    with pytest.raises(ValueError, match="expected 0 < smallest"):
        fm.SteppingOptions(**options)


@pytest.mark.parametrize("name", ["set_loads", "on_step"])
def test_error_of_a_function_of_the_user_on_one_rank_raises_on_all(name):
    """A rank that leaves alone would make the others wait; state and record are unchanged."""
    scene = pressed_blocks(**MESH)
    guilty = comm.rank == comm.size - 1

    def fail(time, *_):
        if guilty and time > 0.3:
            raise KeyError("no such load")

    def set_loads(time):
        scene.loads["push"].value[1] = -0.05 * time
        if name == "set_loads":
            fail(time)

    kind = KeyError if guilty else fm.MortarError
    message = "no such load" if guilty else f"{name} raised on rank {comm.size - 1}: KeyError"
    with pytest.raises(kind, match=message):
        options = fm.SteppingOptions(step=0.25)
        fm.follow_path(
            scene.problem, set_loads, options, on_step=fail if name == "on_step" else None
        )
    assert scene.problem.solve().converged


@pytest.mark.once
def test_work_balances_and_contact_work_is_small():
    """Frictionless contact stores nothing: its work is the error of facets and steps."""
    defects = []
    for n in (6, 12):
        scene = pressed_blocks(n_upper=n, n_lower=3 * n // 2, layers_upper=n, layers_lower=n)

        def set_loads(time, push=scene.loads["push"]):
            push.value[:] = (0.05 * time, -0.1 * time)

        path = fm.follow_path(scene.problem, set_loads, fm.SteppingOptions(step=1.5 / n))
        for step in path.steps:
            defect = step.work.bulk + step.work.contact - step.work.supports
            assert abs(defect) < 1e-12 * abs(step.work.supports)  # an identity, to rounding
        contact, supports = (
            sum(getattr(s.work, name) for s in path.steps) for name in ("contact", "supports")
        )
        defects.append(abs(contact) / supports)
    assert defects[0] < 2e-3 and defects[1] < 0.7 * defects[0], defects


@pytest.mark.serial
@pytest.mark.parametrize("below", ["body", "obstacle"])
def test_contact_work_under_a_dead_load_is_small(below):
    """Supports at rest do no work, so that the work of the bodies is that of contact."""
    scene = pressed_blocks(**MESH)
    data, u = scene.data, fem.Function(scene.u.function_space)
    load = fem.Constant(data.mesh, (0.0, 0.0))
    top = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags)
    residual = internal(u, neo_hookean(u, 100.0, 0.3)) - ufl.inner(
        load, ufl.TestFunction(u.function_space)
    ) * top(data.boundary_tag("upper/top"))
    other = "lower/top" if below == "body" else fm.Plane((1.0, 1.0), (0.0, 1.0))
    bcs = [fm.dirichlet(u.function_space, data, "lower/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(u.function_space, data, "upper/top", 0.0, component=0)]
    pair = fm.ContactPair(data, "upper/bottom", other)
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="dead_")

    def set_loads(time):
        load.value[1] = -10.0 * time

    path = fm.follow_path(problem, set_loads, fm.SteppingOptions(step=0.25))
    for step in path.steps:
        assert step.work.supports == 0.0 and abs(step.work.contact) <= step.work.largest
        assert step.work.defect < 0.05


class Stribeck(fm.Law):
    """Coulomb's law with a tanh in place of the jump; its coefficient falls with the slip."""

    def __init__(self, static, kinetic, fall, length):
        self.static, self.kinetic, self.fall, self.length = static, kinetic, fall, length

    def branch(self, node, before):
        return np.ones_like(before)

    def tangential(self, node, branch):
        part = np.tanh(node.slip / self.length)
        more = (self.static - self.kinetic) * np.exp(-np.abs(node.slip) / self.fall)
        slope = (self.kinetic + more) * (1.0 - part**2) / self.length - more / self.fall * np.abs(
            part
        )
        mu = (self.kinetic + more) * part
        return Row(node.z_tau - node.z_n * mu, 0.0, -node.z_n * slope, -mu, 1.0)

    def friction_limit(self, pressure):
        return self.static * pressure


@pytest.mark.serial
@pytest.mark.parametrize(
    "law, most",
    [
        (Stribeck(0.3, 0.3, 1.0, 1e-5), 120),  # cuts that do not help: 271 iterations
        (Stribeck(0.5, 0.2, 0.003, 1e-5), 200),  # 311
    ],
)
def test_steep_law_of_the_user_is_solved_by_damped_steps(law, most):
    scene = pressed_blocks(
        pair={"law": law}, problem={"newton": fm.NewtonOptions()}, n_upper=8, n_lower=13,
        layers_upper=4, layers_lower=4,
    )  # fmt: skip

    def set_loads(time):
        scene.loads["push"].value[:] = (0.1 * max(time - 1.0, 0.0), -0.05 * min(time, 1.0))

    path = fm.follow_path(scene.problem, set_loads, fm.SteppingOptions(step=0.25), stop=2.0)
    assert path.num_iterations < most and path.num_cuts < 8
    damped = any("restarted with damped steps" in n for s in path.steps for n in s.report.notes)
    assert damped or law.static > law.kinetic  # falling friction: a cut is as good as damping
    assert not scene.problem.equations.newton.line_search
    force = scene.contact.total_force
    assert 0.9 * law.kinetic < abs(force[0] / force[1]) < 1.02 * law.static


@pytest.mark.parametrize("start", [1.0, 0.9])
def test_a_length_that_fails_again_and_again_is_seldom_tried(start):
    """Steps of 0.3 fail up to the time 10, then none: one attempt in twenty, and then 1 again."""
    lengths, time, step, tried, cuts = StepLengths(), 0.0, start, [], 0
    while time < 20.0:
        tried.append(step)
        if step > 0.3 and time < 10.0:
            lengths.cut(step)
            step, cuts = 0.5 * step, cuts + 1
        else:
            time += step
            step = lengths.following(step, min(2.0 * step, 1.0))
    assert cuts < 9
    assert tried[1:3] == [0.5 * start, 0.25 * start]
    assert tried[3:5] == [0.5 * start, 0.25 * start]  # once more without a pause
    assert tried[5] == 0.25 * start
    assert tried[-1] == 1.0


def test_a_snap_does_not_make_the_steps_after_it_short():
    """Steps of 0.6 fail, and once, after many of them, those above a thousandth."""
    lengths, time, step, accepted = StepLengths(), 0.0, 1.0, 0
    while time < 40.0:
        if step > (0.6 if abs(time - 25.0) > 1e-3 else 1e-3):
            lengths.cut(step)
            step = 0.5 * step
        else:
            time, accepted = time + step, accepted + 1
            step = lengths.following(step, min(2.0 * step, 1.0))
    assert accepted < 120


def test_step_that_ends_in_a_wrong_state_is_not_accepted():
    """A tool that jumps into the block, with a search radius too short to find its surface."""
    data = read(
        indenter_on_block.build, n_block=24, layers_block=8, n_indenter=6, layers_indenter=4
    )
    V = fm.vector_space(data.mesh, 1)
    u, tool = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "indenter/top", tool),
    ]
    pair = fm.ContactPair(data, "indenter/arc", "block/top", search_radius=0.3)
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="jump_")

    def set_loads(time):
        tool.value[:] = (0.0, -0.9 * time)

    path = fm.follow_path(problem, set_loads, fm.SteppingOptions(step=1.0, largest=1.0))
    assert path.num_cuts > 0 and "contact was missed" in path.table()
    assert problem.equations.contacts[0].total_force[1] > 0.0
    assert problem.certificate().violations() == []
