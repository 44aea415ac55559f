# SPDX-License-Identifier: MIT
"""Iterations with the tangent of the iteration before: equal results, estimate of the residual."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import nodal, pressed_blocks

import fenics_mortar as fm
from fenics_mortar.equations import last_tangent

comm = MPI.COMM_WORLD
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}
# Steps from which Newton's method converges well: the last iteration hardly changes the tangent.
PATH = [(0.0, -0.05), (0.004, -0.05), (0.008, -0.052), (0.01, -0.055)]
SCENES = {
    "condensed": {},
    "saddle": {"problem": {"algorithm": "saddle"}},
    "friction": {"pair": {"law": fm.Coulomb(0.2)}},
    "sliding": {"pair": {"law": fm.Coulomb(0.02)}, "slave": "lower"},
    "quadratic": {"degree": 2},
    "frozen": {"problem": {"linearization": "frozen"}},
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
        told = "with the last tangent" in report.solver
        assert told == (counts[-1][1] > 0)
    return scene, counts


@pytest.mark.once
@pytest.mark.parametrize("name", [name for name in SCENES if name != "frozen"])
def test_results_and_iterations_are_those_of_new_tangents(name, monkeypatch):
    one, counts = follow(name)
    monkeypatch.setattr(last_tangent, "NEGLIGIBLE", 0.0)
    other, of_new = follow(name)
    assert sum(kept for _, kept in counts) > 0
    assert [iterations for iterations, _ in counts] == [iterations for iterations, _ in of_new]
    u, w = nodal(one.problem), nodal(other.problem)
    assert largest(u - w) < 1e-12 * largest(u)
    assert largest(one.contact.z - other.contact.z) < 1e-10 * largest(one.contact.z)


@pytest.mark.once
@pytest.mark.parametrize("name", [name for name in SCENES if name != "frozen"])
def test_residual_after_the_step_follows_from_the_increments(name, monkeypatch):
    """Also far from the solution, where the estimate is above rounding."""
    monkeypatch.setattr(last_tangent, "NEGLIGIBLE", 1e7)
    estimates, solve = {}, last_tangent.LastTangent._solve

    def recorded(self, system, goal):
        step, changes = solve(self, system, goal)
        sizes = zip(self._sizes_of(step, changes), self._sizes, strict=True)
        residuals = self._record.residuals
        estimates[len(residuals)] = 2.0 * residuals[-1] * max(new / old for new, old in sizes)
        return step, changes

    monkeypatch.setattr(last_tangent.LastTangent, "_solve", recorded)
    scene, ratios = pressed_blocks(**{**MESH, **SCENES[name]}), []
    equations = scene.problem.equations
    for step in PATH:
        scene.loads["push"].value[:] = step
        estimates.clear()
        scene.problem.solve()
        residuals = equations._set_record.residuals
        ratios += [
            residuals[number] / estimate
            for number, estimate in estimates.items()
            if number < len(residuals) and estimate > 10.0 * equations.residual.attainable
        ]
    assert len(ratios) > 2 and max(ratios) < 5.0


def keep(scene):
    """A state and a record for which the last tangent serves."""
    e = scene.problem.equations
    e.advance()
    e.evaluate(start=False)
    e.linearize()
    e._last_tangent.keep(e.system, e.solve_linear())
    e._set_record.residuals[:], e._set_record.num_changed = [1.0, 1e-9], 0
    return e


def change_set(e):
    e._set_record.num_changed = 1


CHANGES = {
    "none": lambda e: None,
    "sets": change_set,
    "matrix": lambda e: e.bulk.assemble_tangent(),
    "state": lambda e: e.put(e.state()),
    "solve": lambda e: e.evaluate(start=True),
    "residual": lambda e: e._set_record.residuals.append(1e-3),
}


@pytest.mark.parametrize("changed", CHANGES)
def test_no_step_with_the_last_tangent_after_a_change(changed):
    scene = pressed_blocks(**MESH, problem={"newton": fm.NewtonOptions()})
    scene.loads["push"].value[:] = PATH[0]
    scene.problem.solve()
    e = keep(scene)
    CHANGES[changed](e)
    found = e._last_tangent.step(e.system, e.residual.force)
    assert (found is not None) == (changed == "none")
    assert e._last_tangent.step(e.system, e.residual.force) is None  # never twice
