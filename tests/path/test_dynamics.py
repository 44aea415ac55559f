# SPDX-License-Identifier: MIT
"""Bodies with mass: impacts with known solutions, conservation, rates in time, restart."""

from mpi4py import MPI

import numpy as np
import pytest

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
    rings,
    scene,
)
from fenics_mortar.bulk.inertia import Rates
from fenics_mortar.path.energy_return import fraction_of_impulse
from fenics_mortar.path.time_scheme import GeneralizedAlpha
from meshes.mapped_grids import Grid, block, build

C = np.sqrt(E / RHO)  # speed of waves in a bar with nu = 0


def run(scene, stop, dt, scheme="conserving", rho_inf=None, velocities=None, **options):
    """Move a scene in equal steps; returns motion and record."""
    motion = scene.dynamics(scheme, rho_inf)
    scene.set_velocity(motion, velocities or {})
    steps = fm.SteppingOptions(step=dt, smallest=min(1e-6, dt))
    return motion, motion.run(stop, steps, **options)


def totals(record):
    return np.array([record.start.total, *(step.energies.total for step in record.steps)])


# The mass matrix


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
def test_massless_nodes_leave_the_inertia_of_rigid_bodies(degree):
    made = rings(12, 4, degree=degree)
    full = made.dynamics("generalized_alpha")._inertia
    less = rings(12, 4, degree=degree).dynamics("massless")._inertia
    surface = made.problem.equations.contacts[0].slave
    assert np.abs(less.M.getDiagonal().array_r[surface.local_dofs]).max(initial=0.0) == 0.0
    x = made.problem.equations.bulk.space.positions()
    rigid = np.array([np.tile(row, x.size // 2) for row in ((1.0, 0.0), (0.0, 1.0))])
    turn = x.reshape(-1, 2)[:, ::-1] * (-1.0, 1.0)
    fields = [*rigid, turn.ravel(), x]  # affine in the reference position
    for a in fields:
        for b in fields:
            assert less.product(a, b) == pytest.approx(full.product(a, b), abs=1e-10)


def test_a_body_of_one_layer_of_cells_cannot_take_over_the_mass():
    with pytest.raises(fm.MortarError, match="fewer than two layers"):
        grid = Grid("bar", block(4, 1, width=4.0, height=1.0))
        scene([grid], [("bar/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))]).dynamics("massless")


# Impacts


@pytest.mark.serial
def test_a_bar_rebounds_from_a_wall_as_waves_say():
    made, speed, length = bar(40), 0.1, 10.0
    pressures = []

    def note(time, report):
        contact = made.problem.contacts[0]
        pressures.append((time, contact.pressure.mean(), contact.gap.mean()))

    velocities = {"bar": (0.0, -speed, 0.0)}
    motion, record = run(made, 0.1 + 3 * length / C, 0.025, velocities=velocities, on_step=note)
    time, pressure, _ = np.array(pressures).T
    closed = np.flatnonzero(pressure > 0.0)
    assert np.array_equal(closed, np.arange(closed[0], closed[-1] + 1))  # no chatter
    duration = time[closed[-1]] - time[closed[0]]
    assert duration == pytest.approx(2 * length / C, rel=0.01)
    relative = pressure[closed] / (RHO * C * speed)
    assert relative.mean() == pytest.approx(1.0, abs=0.03)
    assert np.abs(relative[8:-8] - 1.0).mean() < 0.005  # behind the front of the wave
    assert motion.momentum()[1] / (RHO * length * speed) == pytest.approx(1.0, abs=0.03)
    assert np.abs(totals(record) / record.start.total - 1.0).max() < 3e-4
    assert record.num_iterations < 2.5 * len(record.steps)


@pytest.mark.once
@pytest.mark.serial
def test_the_trapezoidal_rule_with_massive_contact_gains_energy():
    made = bar(20)
    _, record = run(made, 1.5, 0.05, "generalized_alpha", 1.0, {"bar": (0.0, -0.1, 0.0)})
    assert totals(record)[-1] > 2.0 * record.start.total


@pytest.mark.serial
@pytest.mark.long
def test_a_bouncing_block_keeps_its_energy_over_ten_impacts():
    made = free_block(gap=0.05, is_linear=True)
    made.gravity.value[:] = (0.0, -4.0)
    potential = fem.form(-RHO * ufl.inner(made.gravity, made.u) * ufl.dx)
    levels, active = [], []

    def note(time, report):
        levels.append(made.problem.comm.allreduce(fem.assemble_scalar(potential)))
        active.append(report.iterations[-1].num_active > 0)

    velocities = {"block": (0.0, -0.5, 0.0)}
    _, record = run(made, 6.0, 0.02, velocities=velocities, on_step=note)
    total = (totals(record)[1:] + levels) / record.start.total
    impacts = np.count_nonzero(np.diff(np.array(active, int)) > 0)
    assert impacts >= 10
    assert np.abs(total - total[0]).max() < 0.03
    in_flight = np.convolve(active, np.ones(9), "same") == 0.0
    assert np.median(np.abs(total - total[0])[in_flight]) < 1e-10  # what is owed is returned
    assert abs(total[-1] - total[0]) < 1e-3


@pytest.mark.once
@pytest.mark.serial
def test_two_rings_exchange_momentum():
    for scheme, allowed in (("massless", 1e-11), ("conserving", 1e-4)):
        made, dt = rings(24), 0.02
        motion = made.dynamics(scheme)
        made.set_velocity(motion, {"left": (1.0, 0.0, 0.0)})
        start, moments, errors = motion.momentum(dt), 0.0, []
        equations = made.problem.equations
        for _ in range(60):
            motion.step(dt)
            where, reaction = equations.contacts[0].operators.reaction(equations.contacts[0].z)
            slave = equations.contacts[0].operators.force(equations.contacts[0].z)[0]
            x, f = np.concatenate([equations.contacts[0].operators.x, where]), [slave, reaction]
            f = np.concatenate(f)
            moments -= dt * (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]).sum()
            change = motion.momentum(dt) - start
            errors.append((*change[:2], change[2] - moments))
            assert abs(moments) < 5e-4  # of the facets; about 1 moves from ring to ring
        errors = np.abs(errors).max(axis=0)
        assert errors[:2].max() < 1e-12
        assert errors[2] < allowed


# Exact solutions


@pytest.mark.serial
def test_an_oscillator_with_friction_comes_to_rest_where_it_sticks():
    """Each half period friction takes 2 mu N / k from the amplitude, until the spring is weaker."""
    stiffness, pressure, mu = 0.4, 0.1, 0.3
    made, _ = oscillator(fm.Coulomb(mu), pressure=pressure, stiffness=stiffness)
    sliding, half = mu * pressure / stiffness, np.pi / np.sqrt(stiffness)
    start, places = 3.5 * sliding, []

    def note(time, report):
        places.append((time, made.mean(0)))

    made.u.x.array[::2] = start
    _, record = run(made, 2.8 * half, half / 30, rho_inf=0.5, on_step=note)
    time, place = np.array(places).T
    for number, amplitude in ((1.0, -1.5), (2.0, -0.5), (2.8, -0.5)):
        now = np.interp(number * half, time, place)
        assert now == pytest.approx(amplitude * sliding, abs=0.02 * start)
    assert np.ptp(place[time > 2.2 * half]) < 1e-3 * start  # it sticks
    lost = 0.5 * stiffness * (start**2 - place[-1] ** 2)
    assert record.friction_work == pytest.approx(lost, rel=0.01)


@pytest.mark.serial
@pytest.mark.long
def test_a_belt_carries_an_oscillator_until_it_slides_about_its_rest():
    """Stick up to x = mu N / k, then x - mu N / k = v / omega sin(omega t) for one period."""
    stiffness, pressure, mu, speed = 0.4, 0.1, 0.3, 0.03
    made, belt = oscillator(fm.Coulomb(mu), pressure=pressure, stiffness=stiffness)
    slides, omega, places = mu * pressure / stiffness, np.sqrt(stiffness), []
    sticks = slides / speed
    motion = made.dynamics("conserving", 0.5)  # without waves in the block
    made.set_velocity(motion, {"block": (speed, 0.0, 0.0)})

    def note(time, report):
        places.append((time, made.mean(0)))

    motion.run(
        sticks + 9.0,
        fm.SteppingOptions(step=0.06),
        lambda time: belt.move(x=speed * time),
        on_step=note,
    )
    time, place = np.array(places).T
    exact = np.where(
        time < sticks,
        speed * time,
        slides + speed / omega * np.sin(omega * (time - sticks)),
    )
    assert np.abs(place - exact).max() < 0.03 * speed / omega


@pytest.mark.once
def test_drag_slows_a_body_exponentially():
    errors = []
    for dt in (0.1, 0.05):
        made = bar(4, damping=0.5, gap=10.0)
        velocities = {"bar": (0.0, -1.0, 0.0)}
        motion, _ = run(made, 1.0, dt, "generalized_alpha", 1.0, velocities)
        errors.append(abs(-motion.momentum()[1] / 10.0 - np.exp(-0.5)))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.once
@pytest.mark.serial
@pytest.mark.parametrize(
    ("scheme", "rho_inf"),
    [pytest.param("massless", 1.0, marks=pytest.mark.long), ("generalized_alpha", 0.5)],
)
def test_the_rate_in_time_is_two(scheme, rho_inf):
    """A neo-Hookean block that turns and vibrates in free flight, against finer steps."""
    found = []
    for number in (20, 40, 80):
        made = free_block(cells=2)
        motion = made.dynamics(scheme, rho_inf)
        made.set_velocity(motion, {"block": (0.5, 0.2, 3.0)})
        for _ in range(number):
            motion.step(0.1 / number)
        found.append(made.u.x.array.copy())
    coarse, fine = (np.abs(found[i] - found[i + 1]).max() for i in (0, 1))
    assert 3.2 < coarse / fine < 5.0


def test_no_body_floats_and_free_flight_conserves_momentum():
    made = free_block()
    assert made.problem.equations.floating.bodies
    motion = made.dynamics("massless")
    assert not made.problem.equations.floating.bodies
    made.set_velocity(motion, {"block": (0.5, 0.2, 3.0)})
    start = motion.momentum(0.02)
    for _ in range(20):
        motion.step(0.02)
    assert motion.momentum(0.02) == pytest.approx(start, abs=1e-11)


# The steps


def test_a_step_follows_from_the_trapezoidal_rule():
    scheme = GeneralizedAlpha(1.0)
    u, zero = np.array([0.2]), np.zeros(1)
    rates = Rates(np.array([3.0]), np.array([2.0]), np.array([2.0]))
    new = np.array([0.7])
    dt = 0.1
    velocity = scheme.velocity(u, rates, dt)(new)
    assert velocity == pytest.approx(2.0 * (new - u) / dt - rates.velocity)
    assert scheme.acceleration(u, rates, dt)(new) == pytest.approx(
        2.0 * (velocity - rates.velocity) / dt - rates.acceleration
    )
    assert GeneralizedAlpha(0.0).acceleration(u, Rates(zero, zero, zero), dt).factor > 0.0


@pytest.mark.parametrize("energy", [0.3, -0.1, -5.0, 50.0, 0.0])
@pytest.mark.parametrize("power", [2.0, -2.0])
def test_a_fraction_of_an_impulse_adds_an_energy(energy, power):
    square = 3.0
    t = fraction_of_impulse(energy, power, square)
    assert abs(t) <= 1.0
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
    with pytest.raises(fm.MortarError, match="'acceleration' is missing"):
        fm.load_state(made.problem, shared_path / "state")


@pytest.mark.ranks
def test_ranks_do_not_matter():
    last = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        made = dropped_block(4, comm=comm)
        motion, record = run(made, 0.2, 0.01, velocities={"upper": (0.3, -1.0, 0.0)})
        last.append((totals(record), motion.momentum(), record.num_iterations))
    for one, other in zip(*last, strict=True):
        assert one == pytest.approx(other, rel=1e-8, abs=1e-10)


@pytest.mark.once
def test_linear_bulk_is_the_same():
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


def test_a_failed_step_is_taken_back():
    made = dropped_block(3)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"upper": (0.0, -1.0, 0.0)})
    motion.step(0.01)
    before = made.problem.state()
    made.problem.newton = fm.NewtonOptions(max_iterations=1)
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
        for name in ("supports", "pressure", "friction")
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


def test_what_is_refused():
    made = free_block()
    for options, words in (
        ({"scheme": "newmark"}, "scheme='newmark': expected one of"),
        ({"rho_inf": 1.5}, "expected a number from 0 to 1"),
        ({"velocity": 1.0}, "expected a Velocity"),
        ({"energy": 1.0}, "expected a UFL form"),
    ):
        with pytest.raises(ValueError, match=words):
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
def test_mixed_functions_move():
    """An incompressible block of Taylor-Hood elements rebounds."""
    grid = Grid("block", block(3, 5, width=1.0, height=1.0, corner=(0.0, 0.02)))
    data = read_mesh(lambda: build([grid], cell="triangle"))
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w = fem.Function(W)
    (u, p), (v, q) = ufl.split(w), ufl.TestFunctions(W)
    F = ufl.Identity(2) + ufl.grad(u)
    J, inverse = ufl.det(F), ufl.inv(F).T
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    stress = E / 3.0 * (F - inverse) + p * J * inverse
    residual = ufl.inner(stress, ufl.grad(v)) * dx + (J - 1.0) * q * dx
    pair = fm.ContactPair(data, "block/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))
    problem = fm.ContactProblem(residual, w, [pair], petsc_options_prefix="mixed_")
    motion = fm.Dynamics(problem, RHO)
    motion.velocity.x.array[problem.equations.bulk.space.dofs[:, 1]] = -0.5
    record = motion.run(0.6, fm.SteppingOptions(step=0.015))
    assert motion.momentum()[1] > 0.3
    assert 0.8 < record.steps[-1].energies.kinetic / record.start.kinetic < 1.0
