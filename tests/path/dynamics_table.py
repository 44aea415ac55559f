# SPDX-License-Identifier: MIT
"""Table of motions whose solution or invariants are known; half a minute, in serial.

``/usr/bin/python3 tests/program.py dynamics_table``. Impacts by scheme:
``demos.studies.dynamics.impacts``.
"""

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.dynamics.scenes import RHO, changes_in_free_flight, free_block, oscillator, rings


def row(what: str, found: str) -> None:
    """Print a row."""
    print(f"| {what} | {found} |", flush=True)


def colliding_rings() -> None:
    """Change of momentum, angular momentum and energy; steps of random sizes."""
    for mu in (None, 0.4):
        made = rings(24, law=None if mu is None else fm.Coulomb(mu))
        motion = made.dynamics("conserving")
        made.set_velocity(motion, {"left": (1.0, 0.0, 0.0)})
        start, changes, active = motion.momentum(), [], 0
        energy = motion.energies().total
        for dt in np.random.default_rng(0).uniform(0.01, 0.03, 60):
            motion.step(dt)
            changes.append(motion.momentum() - start)
            active += made.problem.contacts[0].pressure.max() > 0.0
        x, y, turn = np.abs(changes).max(axis=0)
        lost = motion.energies().total / energy - 1.0
        text = f"momentum {max(x, y):.0e}, angular {turn:.0e}, energy {lost:+.1e}"
        row(f"rings, mu {mu or 0}, {active} steps in contact", text)


def bounces() -> None:
    """Energy of a linear block under gravity that bounces on a plane."""
    for dt in (0.02, 0.01):
        made = free_block(gap=0.05, is_linear=True)
        made.gravity.value[:] = (0.0, -4.0)
        potential = fem.form(-RHO * ufl.inner(made.gravity, made.u) * ufl.dx)
        motion = made.dynamics("conserving")
        made.set_velocity(motion, {"block": (0.0, -0.5, 0.0)})
        totals, active = [], []
        for _ in range(round(6.0 / dt)):
            report = motion.step(dt)
            totals.append(motion.energies().total + fem.assemble_scalar(potential))
            active.append(report.iterations[-1].num_active > 0)
        impacts = np.count_nonzero(np.diff(np.array(active, int)) > 0)
        errors = np.abs(np.array(totals) / totals[0] - 1.0)
        flight = np.convolve(active, np.ones(9), "same") == 0.0
        text = f"largest error of energy {errors.max():.1e}, at the end {errors[-1]:.0e}, "
        text += f"in flight (median) {np.median(errors[flight]):.0e}"
        row(f"{impacts} bounces, step {dt}", text)


def stick_slip() -> None:
    """Oscillator on a belt: sticks, then slides about its rest, against the exact path.

    The path is that of a point mass: a block with E = 100 errs by 1.8 % by its own elasticity.
    """
    stiffness, pressure, mu, speed = 0.4, 0.1, 0.3, 0.03
    slides, omega = mu * pressure / stiffness, np.sqrt(stiffness)
    sticks, errors = slides / speed, []
    for dt in (0.24, 0.12, 0.06):
        made, belt = oscillator(fm.Coulomb(mu), pressure=pressure, stiffness=stiffness, modulus=1e4)
        motion = made.dynamics("conserving", 0.5)
        made.set_velocity(motion, {"block": (speed, 0.0, 0.0)})
        largest = 0.0
        for number in range(1, round((sticks + 9.0) / dt)):
            time = number * dt
            belt.move(x=speed * time)
            motion.step(dt)
            late = slides + speed / omega * np.sin(omega * (time - sticks))
            largest = max(largest, abs(made.mean(0) - (speed * time if time < sticks else late)))
        errors.append(largest * omega / speed)
    row("stick-slip oscillator, errors over v / omega", ", ".join(f"{e:.1e}" for e in errors))


def rates() -> None:
    """Rates of a block in free flight, from steps of three lengths."""
    for scheme, rho in (("conserving", 1.0), ("massless", 1.0), ("generalized_alpha", 0.5)):
        coarse, fine = changes_in_free_flight(scheme, rho, 0.2, (40, 80, 160))
        row(f"rate in time, {scheme}", f"{np.log2(coarse / fine):.2f}")


def main() -> None:
    """Print all."""
    print("| motion | found |\n|---|---|")
    for part in (colliding_rings, bounces, stick_slip, rates):
        part()


if __name__ == "__main__":
    main()
