# SPDX-License-Identifier: MIT
"""An oscillator on a belt with friction that decreases with the rate: stick-slip."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fenics_mortar as fm
from demos.studies.dynamics.scenes import oscillator
from fenics_mortar.laws import Stribeck

STIFFNESS, PRESSURE, SPEED = 0.4, 0.1, 0.03
LAW = Stribeck(0.5, 0.2, 0.06)


def exact(stop: float):
    """Time and position of a point mass 1 on a spring that starts at rest on the belt.

    It sticks until the spring force is the static friction, then slides until its velocity is that
    of the belt.
    """
    time, place, times, places = 0.0, 0.0, [0.0], [0.0]

    def rates(_, y):
        friction = LAW.coefficient(SPEED - y[1]) * PRESSURE
        return [y[1], friction - STIFFNESS * y[0]]

    while time < stop:
        time += (LAW.static * PRESSURE / STIFFNESS - place) / SPEED
        start = time
        times.append(time)
        places.append(LAW.static * PRESSURE / STIFFNESS)

        def caught(now, y, start=start):
            return y[1] - SPEED if now > start + 0.01 else -1.0

        caught.terminal, caught.direction = True, 1
        slide = solve_ivp(
            rates, (start, start + 50.0), [places[-1], SPEED * (1.0 - 1e-9)], events=caught,
            rtol=1e-9, atol=1e-12, max_step=0.05,
        )  # fmt: skip
        times += slide.t.tolist()
        places += slide.y[0].tolist()
        time, place = times[-1], places[-1]
    return np.array(times), np.array(places)


@pytest.mark.serial
@pytest.mark.once
def test_stick_and_slip_follow_the_point_mass():
    """Two periods; the block is elastic, its shear wave takes 1/70 of a period."""
    made, belt = oscillator(LAW, pressure=PRESSURE, stiffness=STIFFNESS)
    motion, places = made.dynamics("conserving", 0.5), []
    made.set_velocity(motion, {"block": (SPEED, 0.0, 0.0)})
    motion.run(
        18.0,
        fm.SteppingOptions(step=0.15, smallest=0.15),
        lambda time: belt.move(x=SPEED * time),
        on_step=lambda time, _: places.append((time, made.mean(0), made.problem.time)),
    )
    time, place, recorded = np.array(places).T
    assert (recorded == time).all()  # the time passed to the law
    wanted = np.interp(time, *exact(18.0))
    assert np.ptp(wanted) > 0.15 and np.abs(place - wanted).max() < 0.03 * np.ptp(wanted)
