# SPDX-License-Identifier: MIT
"""Random impacts: conserved quantities, and waves in a bar."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import fenics_mortar as fm
from demos.studies.dynamics.scenes import RHO, E, bar, scene
from demos.studies.stability.physics import differs, size
from meshes.mapped_grids import Grid, block

# Energy that the scheme "conserving" may change in an impact, over that at the start [1]; the
# study of impacts has 0.5 % at a tenth of the speed of sound.
OF_ENERGY = 0.02
# Moment of the mortar pressures, of third order in the facets' length, over m v l [1].
OF_MOMENT = 5e-3
SPEED_OF_SOUND = np.sqrt(E / RHO)


def draw_moving(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Draw two blocks in flight, or a bar on a wall."""
    return _blocks(rng) if rng.random() < 0.7 else _bar(rng)


def _blocks(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A block that flies on another one, both free, with spins, offset and friction."""
    widths, heights = rng.uniform(0.6, 1.4, 2), rng.uniform(0.6, 1.2, 2)
    counts, mu = rng.integers(4, 8, 2), float(rng.choice([0.0, rng.uniform(0.1, 0.8)]))
    gap, speed = size(rng, 0.01, 0.1), size(rng, 0.2, 1.0)
    aside, angle = rng.uniform(-0.3, 0.3), rng.uniform(0.0, 2.0 * np.pi)
    spins, slide = rng.uniform(-0.3, 0.3, 2) * speed, rng.uniform(-0.5, 0.5) * speed
    linear = bool(rng.random() < 0.3)
    about = {
        "scene": "blocks", "mu": mu, "speed": speed, "facets": counts.tolist(), "linear": linear,
    }  # fmt: skip

    def solve() -> Any:
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, s], [-s, c]])
        places = ((-0.5 * widths[0], -heights[0]), (aside - 0.5 * widths[1], gap))
        grids = [
            Grid(name, block(n, n, width=w, height=h, corner=place) @ turn)
            for name, n, w, h, place in zip(("low", "high"), counts, widths, heights, places)
        ]
        law = fm.Coulomb(mu) if mu else None
        is_linear = linear and mu == 0.0
        made = scene(grids, [("high/bottom", "low/top")], law=law, is_linear=is_linear)
        motion = made.dynamics("conserving")
        ahead = np.array([[0.0, 0.3 * speed], [slide, -speed]]) @ turn
        flights = ((*v, spin) for v, spin in zip(ahead, spins))
        made.set_velocity(motion, dict(zip(("low", "high"), flights)))
        dt = 0.8 * made.cell / SPEED_OF_SOUND
        start, reports, touched = motion.momentum(dt), [], False
        energy = motion.energies().total
        for _ in range(round((gap / speed + 0.5) / dt)):
            reports.append(motion.step(dt))
            contact = made.problem.equations.contacts[0]
            touched = touched or bool(contact.active.any())
        change = motion.momentum(dt) - start
        mass = RHO * (widths * heights).sum()
        errors = [] if touched else ["the blocks did not meet"]
        errors += differs("momentum over m v", 1.0 + change[:2] / (mass * speed), 1.0, 1e-9)
        if not is_linear:  # linear elastic stresses resist rotations, which changes the moment
            errors += differs("moment over m v l", 1.0 + change[2] / (mass * speed), 1.0, OF_MOMENT)
        total = motion.energies().total / energy
        if not (total < 1.0 + OF_ENERGY and (mu or total > 1.0 - OF_ENERGY)):
            errors.append(f"the energy ends at {total:.4f} of that at the start")
        errors += made.problem.certificate().violations()
        return reports, errors, []

    return about, solve


def _bar(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """A bar on a wall: contact for 2 l / c, rebound at its speed."""
    cells, length = int(rng.integers(20, 33)), rng.uniform(4.0, 15.0)
    speed, gap = size(rng, 0.01, 0.3), size(rng, 1e-3, 0.05)
    step = rng.uniform(0.3, 1.0)
    about = {"scene": "bar", "cells": cells, "speed": speed, "step": step}

    def solve() -> Any:
        made = bar(cells, length, gap, linear_bulk=False)
        motion = made.dynamics("conserving")
        made.set_velocity(motion, {"bar": (0.0, -speed, 0.0)})
        dt = step * made.cell / SPEED_OF_SOUND
        reports, touches = [], []
        start = motion.energies().total
        for _ in range(int((gap / speed + 3.0 * length / SPEED_OF_SOUND) / dt) + 1):
            reports.append(motion.step(dt))
            if made.problem.contacts[0].pressure.max() > 0.0:
                touches.append(motion.time)
        errors = list(differs("energy", motion.energies().total, start, 1e-8))
        duration = 2.0 * length / SPEED_OF_SOUND
        errors += differs("time of contact", np.ptp(touches), duration, 2.5 / cells + dt / duration)
        rebound = motion.momentum()[1] / (RHO * length)
        errors += differs("rebound", rebound, speed, 4.0 / cells)
        return reports, errors, []

    return about, solve
