# SPDX-License-Identifier: MIT
"""Iterations with the tangent of the iteration before: equal results, estimate of the residual."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from scenes import TIGHT, nodal, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.equations import residual

comm = MPI.COMM_WORLD
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}
# Steps from which Newton's method converges well: the last iteration hardly changes the tangent.
PATH = [(0.0, -0.05), (0.004, -0.05), (0.008, -0.052), (0.01, -0.055), (0.0105, -0.0551)]
SCENES = {
    "condensed": {},
    "saddle": {"problem": {"algorithm": "saddle"}},
    "friction": {"pair": {"law": fm.Coulomb(0.2)}},
    "sliding": {"pair": {"law": fm.Coulomb(0.02)}, "slave": "lower"},
    "quadratic": {"degree": 2},
}


def largest(values):
    return comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


def follow(name):
    """The scene after all steps, the iterations and those with the last tangent of each step."""
    given = SCENES[name]
    problem = {"newton": fm.NewtonOptions(), **given.get("problem", {})}
    scene = pressed_blocks(**{**MESH, **given, "problem": problem})
    counts = []
    for step in PATH:
        scene.loads["push"].value[:] = step
        report = scene.problem.solve()
        counts.append((report.num_iterations, scene.problem.equations.system.num_kept))
        assert ("with the last tangent" in report.solver) == (counts[-1][1] > 0)
    return scene, counts


@pytest.mark.once
@pytest.mark.parametrize("name", SCENES)
def test_results_and_iterations_are_those_of_new_tangents(name, monkeypatch):
    one, counts = follow(name)
    monkeypatch.setattr(residual, "MAX_ESTIMATE", 0.0)
    other, of_new = follow(name)
    assert sum(kept for _, kept in counts) > 0
    assert [iterations for iterations, _ in counts] == [iterations for iterations, _ in of_new]
    u, w = nodal(one.problem), nodal(other.problem)
    assert largest(u - w) < 1e-12 * largest(u)
    assert largest(one.contact.z - other.contact.z) < 1e-10 * largest(one.contact.z)


@pytest.mark.once
@pytest.mark.parametrize("name", SCENES)
def test_residual_after_the_step_follows_from_the_increments(name, monkeypatch):
    """Also far from the solution, where the estimate is above rounding."""
    monkeypatch.setattr(residual, "MAX_ESTIMATE", 1e7)
    estimates, estimate = {}, residual.estimate

    def recorded(residuals, ratio=None):
        estimates[len(residuals)] = estimate(residuals, ratio)
        return estimates[len(residuals)]

    monkeypatch.setattr(residual, "estimate", recorded)
    given = {**MESH, **SCENES[name]}
    newton = replace(TIGHT, increment_tolerance=1.0)
    given["problem"] = {"newton": newton, **given.get("problem", {})}
    scene, ratios = pressed_blocks(**given), []
    equations = scene.problem.equations
    for step in PATH:
        scene.loads["push"].value[:] = step
        estimates.clear()
        scene.problem.solve()
        residuals = equations._set_record.residuals
        ratios += [
            residuals[number] / estimated
            for number, estimated in estimates.items()
            if number < len(residuals) and estimated > 10.0 * equations.residual.attainable
        ]
    assert len(ratios) > 2 and max(ratios) < 10.0


def at_last_iteration():
    """Equations whose next iteration uses the last tangent."""
    scene = pressed_blocks(**MESH, problem={"newton": fm.NewtonOptions()})
    e = scene.problem.equations
    for step in PATH:
        scene.loads["push"].value[:] = step
        scene.problem.solve()
    scene.loads["push"].value[:] = (0.0145, -0.056)
    e.evaluate(start=True)
    for _ in range(10):
        e.advance()
        e.evaluate(start=False)
        residuals = e._set_record.residuals
        allowed = residual.MAX_ESTIMATE * e.residual.attainable
        if not e._set_record.num_changed and residual.estimate(residuals) < 1e-3 * allowed:
            return e
    raise AssertionError("no such iteration")


def change_sets(e):
    e._set_record.num_changed = 1


def use(e):
    e.advance()
    e.evaluate(start=False)
    e._set_record.num_changed = 0


CHANGES = {
    "none": lambda e: None,
    "sets": change_sets,
    "matrix": lambda e: e.bulk.assemble_tangent(),
    "state": lambda e: e.put(e.state()),
    "solve": lambda e: e.evaluate(start=True),
    "residual": lambda e: e._set_record.residuals.append(1e-3),
    "used": use,
}


@pytest.mark.parametrize("change", CHANGES)
def test_no_step_with_the_last_tangent_after_a_change(change):
    e = at_last_iteration()
    CHANGES[change](e)
    before = e.system.num_kept
    e.advance()
    assert e.system.num_kept - before == (change == "none")
