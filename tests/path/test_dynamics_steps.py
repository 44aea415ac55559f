# SPDX-License-Identifier: MIT
"""Time steps of bodies with mass: sizes, restart, balances, arguments."""

from mpi4py import MPI

import numpy as np
import pytest
from test_dynamics import run, totals

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import read_mesh
from demos.studies.dynamics.scenes import (
    RHO,
    E,
    bar,
    dropped_block,
    free_block,
    oscillator,
)
from fenics_mortar.bulk.inertia import Rates
from fenics_mortar.path.time_steps import GeneralizedAlpha, fraction_of_impulse
from meshes.mapped_grids import Grid, block, build

# The steps


def test_a_step_follows_from_the_trapezoidal_rule():
    scheme = GeneralizedAlpha(1.0)
    u, zero = np.array([0.2]), np.zeros(1)
    rates = Rates(np.array([3.0]), np.array([2.0]), np.array([2.0]))
    new = np.array([0.7])
    dt = 0.1
    velocity, acceleration = (line(new) for line in scheme.rates(u, rates, dt)[:2])
    assert velocity == pytest.approx(2.0 * (new - u) / dt - rates.velocity)
    assert acceleration == pytest.approx(
        2.0 * (velocity - rates.velocity) / dt - rates.acceleration
    )
    assert GeneralizedAlpha(0.0).rates(u, Rates(zero, zero, zero), dt)[1].factor > 0.0


@pytest.mark.parametrize("energy", [0.3, -0.1, -5.0, 50.0, 0.0])
@pytest.mark.parametrize("power", [2.0, -2.0])
def test_a_fraction_of_an_impulse_adds_an_energy(energy, power):
    square = 3.0
    t = fraction_of_impulse(energy, power, square)
    if abs(energy) < 1.0:
        assert t * power + 0.5 * t**2 * square == pytest.approx(energy)


def test_a_restart_continues_bit_for_bit(tmp_path):
    def begin():
        made = dropped_block(3)
        motion = made.dynamics("conserving")
        made.set_velocity(motion, {"upper": (0.2, -1.0, 0.0)})
        return made, motion

    made, motion = begin()
    for number in range(16):
        motion.step(0.01)
        if number == 9:
            fm.save_state(made.problem, tmp_path / "state")
    assert made.problem.equations.contacts[0].active.any()
    other, again = begin()
    fm.load_state(other.problem, tmp_path / "state")
    assert again.time == pytest.approx(0.1)
    for _ in range(6):
        again.step(0.01)
    last_bits = 0.0 if MPI.COMM_WORLD.size == 1 else 1e-10  # on several, MUMPS adds in any order
    for one, two in ((other.u, made.u), (again.velocity, motion.velocity)):
        assert np.abs(one.x.array - two.x.array).max() <= last_bits


def test_a_checkpoint_of_statics_is_refused(shared_path):
    made = free_block()
    fm.save_state(made.problem, shared_path / "state")
    made.dynamics("massless")
    with pytest.raises(fm.MortarError, match="is a state at rest, and this problem has a Dynamics"):
        fm.load_state(made.problem, shared_path / "state")


@pytest.mark.usefixtures("several_ranks")
def test_result_is_independent_of_the_number_of_ranks():
    last = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        made = dropped_block(4, comm=comm)
        motion, record = run(made, 0.2, 0.01, velocities={"upper": (0.3, -1.0, 0.0)})
        last.append((totals(record), motion.momentum(), record.num_iterations))
    for one, other in zip(*last, strict=True):
        assert one == pytest.approx(other, rel=1e-8, abs=1e-10)


@pytest.mark.once
def test_linear_bulk_agrees_with_the_general_equations():
    found = []
    for linear_bulk in (True, False):
        made = dropped_block(4, is_linear=True, linear_bulk=linear_bulk)
        motion, _ = run(made, 0.3, 0.02, velocities={"upper": (0.1, -1.0, 0.0)})
        assert made.problem.equations.contacts[0].active.any()
        found.append(np.concatenate([made.u.x.array, motion.velocity.x.array]))
    assert np.abs(found[0] - found[1]).max() < 1e-8


def test_steps_follow_the_estimated_error():
    made, sizes = bar(20, gap=0.08), []
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"bar": (0.0, -0.1, 0.0)})
    options = fm.SteppingOptions(step=0.05, smallest=1e-3, largest=0.2)
    record = motion.run(1.5, options, tolerance=0.02)
    assert record.steps[-1].time == pytest.approx(1.5)
    sizes = np.diff([0.0, *(step.time for step in record.steps)])
    assert sizes.max() > 0.15 > 0.07 > sizes[:-1].min()  # free flight, impact
    assert all(step.error <= 0.02 or step.error == 0.0 for step in record.steps)


@pytest.mark.parametrize("rho", [0.8, 1.0])
def test_smooth_prescribed_motions_take_few_steps(rho):
    """Rates that alternate would cut the steps without end."""
    data = read_mesh(lambda: build([Grid("block", block(2, 3, width=1.0, height=1.0))]))
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    energy = fm.energies.linear_elastic(u, *fm.energies.lame(E, 0.3)) * ufl.dx(degree=2)
    top = fem.Constant(data.mesh, (0.0, 0.0))
    problem = fm.ContactProblem(
        ufl.derivative(energy, u, v), u,
        [fm.ContactPair(data, "block/bottom", fm.Plane((0.0, -50.0), (0.0, 1.0)))],
        bcs=[fm.dirichlet(V, data, "block/top", top)], petsc_options_prefix="smooth_",
    )  # fmt: skip
    motion = fm.Dynamics(problem, RHO, scheme="generalized_alpha", rho_inf=rho)

    def set_loads(time):
        top.value[1] = 0.1 * time**3

    options = fm.SteppingOptions(step=0.05, smallest=0.01, largest=0.1)
    record = motion.run(0.5, options, set_loads, tolerance=0.05)
    assert len(record.steps) < 15


def test_failed_step_is_reverted():
    made = dropped_block(3)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"upper": (0.0, -1.0, 0.0)})
    motion.step(0.01)
    before = made.problem.state()
    made.problem.equations.newton = fm.NewtonOptions(max_iterations=1)
    with pytest.raises(fm.NotConvergedError):
        motion.step(0.1)
    after = made.problem.state()
    assert np.array_equal(after.u, before.u)
    assert np.array_equal(after.rates.velocity, before.rates.velocity)
    assert motion.time == pytest.approx(0.01)
    with pytest.raises(fm.NotConvergedError, match="the motion ends at time 0.01"):
        motion.run(1.0, fm.SteppingOptions(step=0.1, smallest=0.1))


@pytest.mark.serial
def test_energy_and_work_balance():
    """Kinetic and strain energy change by the work of contact, by friction alone."""
    made, _ = oscillator(fm.Coulomb(0.3))
    made.u.x.array[::2] = 0.4
    _, record = run(made, 1.0, 0.02, "massless")
    _, _, _, first, *steps = record.steps  # the top jumps at the start
    change = steps[-1].energies.total - first.energies.total
    supports, pressures, friction = (
        sum(getattr(step.work, name) for step in steps)
        for name in ("supports", "pressure", "shear")
    )
    assert friction > 0.05
    assert change == pytest.approx(supports - pressures - friction, abs=1e-10)
    assert "friction" in str(record)


@pytest.mark.once
def test_the_tangent_is_exact():
    made = dropped_block(3)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"upper": (0.2, -1.0, 0.0)})
    for _ in range(8):
        motion.step(0.01)
    slopes = made.problem.check_tangent().slopes
    assert all(1.9 < slope < 2.1 for slope in slopes.values())


# Arguments


def test_invalid_arguments_are_refused():
    made = free_block()
    for options, message in (
        ({"scheme": "newmark"}, "scheme='newmark': expected one of"),
        ({"rho_inf": 1.5}, "expected a number from 0 to 1"),
        ({"velocity": 1.0}, "expected a Velocity"),
        ({"energy": 1.0}, "expected a UFL form"),
    ):
        with pytest.raises(ValueError, match=message):
            fm.Dynamics(made.problem, 1.0, **options)
    for density in (0.0, np.nan, "steel"):
        with pytest.raises(ValueError, match="density"):
            fm.Dynamics(made.problem, density)
    negative = fem.Constant(made.data.mesh, -1.0)
    with pytest.raises(fm.MortarError, match="positive finite density"):
        fm.Dynamics(made.problem, negative, velocity=made.velocity)
    motion = made.dynamics("massless")
    with pytest.raises(ValueError, match="has inertia already"):
        made.dynamics("massless")
    with pytest.raises(ValueError, match="dt"):
        motion.step(0.0)
    with pytest.raises(ValueError, match="stop"):
        motion.run(-1.0, fm.SteppingOptions(step=0.1))
    made.problem.obstacles[0].push(y=1.0)
    with pytest.raises(fm.MortarError, match="has no mass"):
        motion.step(0.1)


def test_no_error_estimate_without_inertia():
    made = free_block()
    made.dynamics("massless")
    with pytest.raises(fm.MortarError, match="inertia"):
        made.problem.estimate()


@pytest.mark.serial
def test_dynamics_of_mixed_functions():
    """An incompressible block of Taylor-Hood elements rebounds."""
    grid = Grid("block", block(3, 5, width=1.0, height=1.0, corner=(0.0, 0.02)))
    data = read_mesh(lambda: build([grid], cell="triangle"))
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w = fem.Function(W)
    energy = fm.energies.mixed_neo_hookean(*ufl.split(w), E / 3.0)
    residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 4}), w)
    pair = fm.ContactPair(data, "block/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))
    problem = fm.ContactProblem(residual, w, [pair], petsc_options_prefix="mixed_")
    motion = fm.Dynamics(problem, RHO)
    motion.velocity.x.array[problem.equations.bulk.space.dofs[:, 1]] = -0.5
    record = motion.run(0.6, fm.SteppingOptions(step=0.015))
    assert motion.momentum()[1] > 0.3
    assert 0.8 < record.steps[-1].energies.kinetic / record.start.kinetic < 1.0


@pytest.mark.once
@pytest.mark.parametrize("scheme", ["conserving", "massless", "generalized_alpha"])
def test_restored_state_gives_back_all_forces(scheme):
    """Inertia and damping are those of the state, not of the step after it."""
    made = bar(4, damping=0.5, gap=0.01)
    motion = made.dynamics(scheme, 0.8 if scheme == "generalized_alpha" else None)
    made.set_velocity(motion, {"bar": (-1.0, 0.0, 0.0)})
    for _ in range(8):
        motion.step(0.004)
    state, before = made.problem.state(), made.problem.forces()
    assert np.abs(before[0]).max() > 0.0
    motion.step(0.01)
    u = made.u.x.array.copy()
    made.problem.restore(state)
    for mine, theirs in zip(before, made.problem.forces(), strict=True):
        assert np.array_equal(mine, theirs)
    motion.step(0.01)
    assert np.abs(made.u.x.array - u).max() <= 1e-12 * np.abs(u).max()
