# SPDX-License-Identifier: MIT
"""Bodies with mass: impacts with known solutions, conservation, rates in time, restart."""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.dynamics.scenes import (
    RHO,
    E,
    bar,
    changes_in_free_flight,
    dropped_block,
    free_block,
    oscillator,
    rings,
    scene,
)
from meshes.mapped_grids import Grid, block

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


@pytest.mark.once
@pytest.mark.serial
def test_bar_rebounds_from_a_wall_by_wave_theory():
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
@pytest.mark.once
def test_a_bouncing_block_keeps_its_energy_over_six_impacts():
    made = free_block(gap=0.05, is_linear=True)
    made.gravity.value[:] = (0.0, -4.0)
    potential = fem.form(-RHO * ufl.inner(made.gravity, made.u) * ufl.dx)
    levels, active = [], []

    def note(time, report):
        levels.append(made.problem.equations.comm.allreduce(fem.assemble_scalar(potential)))
        active.append(report.iterations[-1].num_active > 0)

    velocities = {"block": (0.0, -0.5, 0.0)}
    _, record = run(made, 3.6, 0.02, velocities=velocities, on_step=note)
    total = (totals(record)[1:] + levels) / record.start.total
    impacts = np.count_nonzero(np.diff(np.array(active, int)) > 0)
    assert impacts >= 6
    assert np.abs(total - total[0]).max() < 0.03
    in_flight = np.convolve(active, np.ones(9), "same") == 0.0
    assert np.median(np.abs(total - total[0])[in_flight]) < 1e-10  # the energy deficit is returned
    assert abs(total[-1] - total[0]) < 1e-3


@pytest.mark.once
@pytest.mark.serial
def test_two_rings_exchange_momentum_by_the_trapezoidal_rule():
    """Momentum at the middle of equal steps, apart from the moment of mortar pressures."""
    made, dt = rings(24), 0.02
    motion = made.dynamics("massless")
    made.set_velocity(motion, {"left": (1.0, 0.0, 0.0)})
    start, moments, errors = motion.momentum(dt), 0.0, []
    contact = made.problem.equations.contacts[0]
    for _ in range(60):
        motion.step(dt)
        where, reaction = contact.operators.reaction(contact.z)
        x = np.concatenate([contact.operators.x, where])
        f = np.concatenate([contact.operators.force(contact.z)[0], reaction])
        moments -= dt * (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]).sum()
        change = motion.momentum(dt) - start
        errors.append((*change[:2], change[2] - moments))
        assert abs(moments) < 5e-4  # error of the facets; 1 is transferred
    errors = np.abs(errors).max(axis=0)
    assert errors[:2].max() < 1e-12
    assert errors[2] < 1e-11


@pytest.mark.once
@pytest.mark.parametrize("mu", [None, 0.4])
def test_two_rings_exchange_momentum_exactly(mu):
    """Linear and angular momentum at all times, with and without friction, unequal steps."""
    made = rings(24, law=None if mu is None else fm.Coulomb(mu))
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"left": (1.0, 0.0, 0.0)})
    start, energy, active, changes = motion.momentum(), motion.energies().total, 0, []
    for dt in np.random.default_rng(0).uniform(0.01, 0.03, 55):
        motion.step(dt)
        changes.append(motion.momentum() - start)
        active += made.problem.contacts[0].pressure.max() > 0.0
    assert active > 20
    assert np.abs(changes).max() < 1e-11  # about 1 is transferred
    if mu is None:
        assert motion.energies().total == pytest.approx(energy, rel=3e-3)


@pytest.mark.once
def test_steps_that_are_cut_keep_the_angular_momentum():
    """The next attempt starts from the moments of the accepted state."""
    made = rings(24)
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"left": (1.0, 0.0, 0.0)})
    for _ in range(22):
        motion.step(0.02)
    assert made.problem.contacts[0].pressure.max() > 0.0
    start = motion.momentum()
    options = fm.SteppingOptions(step=0.1, smallest=1e-3, largest=0.1)
    record = motion.run(0.7, options, tolerance=0.01)
    assert any(step.failures for step in record.steps)
    assert motion.momentum() == pytest.approx(start, abs=1e-11)


def test_supports_and_obstacles_change_angular_momentum():
    """A plane changes the angular momentum of a block that hits it obliquely."""
    turned = []
    for scheme in ("massless", "conserving"):
        made = free_block(gap=0.01, cells=6)
        made.gravity.value[:] = (3.0, 0.0)  # along the plane, which has no friction
        motion = made.dynamics(scheme)
        made.set_velocity(motion, {"block": (0.0, -1.0, 0.8)})
        start = motion.momentum()
        for _ in range(25):
            motion.step(0.01)
        turned.append(motion.momentum() - start)
    assert turned[1][2] < -0.1
    assert turned[0] == pytest.approx(turned[1], abs=2e-3)


# Exact solutions


@pytest.mark.once
@pytest.mark.serial
def test_an_oscillator_with_friction_comes_to_rest_where_it_sticks():
    """In each half period friction reduces the amplitude by 2 mu N / k, until it sticks."""
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
@pytest.mark.parametrize("stress, step, speed", [(2.0, 0.02, 0.5), (5.0, 0.01, 1.0)])
def test_an_oblique_impact_with_tresca_friction_goes_on(stress, step, speed):
    """Shear without pressure would peel off the corner of the upper block."""
    made = dropped_block(4, 0.05, law=fm.Tresca(stress))
    motion = made.dynamics("conserving")
    made.set_velocity(motion, {"upper": (speed, -0.5, 0.0)})
    record = motion.run(0.6, fm.SteppingOptions(step=step, smallest=step / 4.0))
    lost = record.start.total - record.steps[-1].energies.total
    assert 0.0 < lost < record.start.total
    assert lost == pytest.approx(record.friction_work, abs=2e-3 * record.start.total)
    assert record.num_cuts == 0 and record.num_iterations < 6 * len(record.steps)


@pytest.mark.serial
@pytest.mark.once
def test_oscillator_on_a_belt_sticks_and_slides():
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
    [("massless", 1.0), ("generalized_alpha", 0.5)],
)
def test_convergence_in_time_is_of_second_order(scheme, rho_inf):
    coarse, fine = changes_in_free_flight(scheme, rho_inf, 0.1, (20, 40, 80))
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
