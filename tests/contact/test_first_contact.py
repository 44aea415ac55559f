# SPDX-License-Identifier: MIT
"""First contact with friction and thermal expansion in one large step."""

import numpy as np
import pytest
from heat_scenes import heated

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, mapped


def approaching(seed):
    """A block above another one, apart, and the step that closes the gap; all numbers at random."""
    draw = np.random.default_rng(seed)
    geometry = ["plane", "axisymmetric"][draw.integers(2)]
    degrees = [(1, 1), (2, 1), (2, 2)][draw.integers(3)]
    columns = [int(draw.integers(5, 13)) for _ in range(2)]
    gap, bulge = 10.0 ** draw.uniform(-3, -1.3), [0.0, 0.05, 0.3][draw.integers(3)]
    tilt, nu = draw.uniform(-0.02, 0.02), [0.3, 0.45][draw.integers(2)]
    alpha, mu = 10.0 ** draw.uniform(-4, -3), draw.uniform(0.1, 0.8)

    def position(s, t):
        bottom = 2.0 + gap + bulge * (s - 0.43) ** 2 + tilt * s
        return 1.05 + 0.9 * s, bottom + t * (3.0 + gap - bottom)

    lower = Grid("lower", block(columns[0], 4, width=1.0, height=2.0, corner=(1.0, 0.0)))
    bodies = [lower, Grid("upper", mapped(columns[1], 3, position))]
    scene = heated(bodies, degrees=degrees, geometry=geometry, nu=nu, alpha=alpha)
    for side, body in (("bottom", "lower"), ("top", "upper")):
        scene.hold(side, f"{body}/{side}")
        scene.prescribe(f"T {side}", f"{body}/{side}", 1)
    h = [
        10.0 ** draw.uniform(-1, 3),
        fm.PressureConductance(10.0 ** draw.uniform(0, 3), 1.0),
        [fm.PressureConductance(100.0, 1.0), fm.GapConductance(0.3, 0.01)],
        float("inf"),
    ][seed % 4]
    heat = fm.Conductance(1, h, heating=["friction", None][draw.integers(2)])
    sides = ["upper/bottom", "lower/top"][:: int(draw.integers(2)) * 2 - 1]
    pair = fm.ContactPair(scene.data, *sides, law=fm.Coulomb(mu), fluxes=[heat])
    problem = scene.problem([pair])
    problem.time, down = 1.0, -gap - 10.0 ** draw.uniform(-2.5, -1.2)
    scene.set(top=(draw.uniform(-0.1, 0.1), down))
    scene.set(**{"T bottom": draw.uniform(-50, 50), "T top": draw.uniform(-100, 100)})
    return problem


@pytest.mark.parametrize("seed", [4, 6, 24])
def test_steps_to_first_contact_converge(seed):
    """Full steps alone fail in these: of 64 in 13; with a line search after them in 3."""
    report = approaching(seed).solve()
    assert report.certificate.violations() == []
