# SPDX-License-Identifier: MIT
"""Files and checkpoints of bodies of revolution."""

import meshio
import numpy as np
import pytest
import revolved
from test_results import COMM, steps

from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block


def fitted(geometry="axisymmetric"):
    """A hub on a solid shaft with interference, and the force that pulls the shaft."""
    shaft = Grid("shaft", block(2, 8, width=1.0, height=4.0, corner=(0.0, -2.0)))
    hub = Grid("hub", block(2, 5, width=1.0, height=2.0, corner=(1.0, -1.0)))
    data = mapped_grids.mesh([shaft, hub])
    u = fem.Function(fm.vector_space(data.mesh, 1))
    pull = fem.Constant(data.mesh, 0.0)
    conditions = [("shaft/left", 0.0, 0), ("hub/top", 0.0, 1), ("shaft/top", pull, 1)]
    bcs = [fm.dirichlet(u.function_space, data, *condition) for condition in conditions]
    law = fm.Coulomb(0.2)
    pair = fm.ContactPair(data, "hub/left", "shaft/right", law=law, initial_gap=-0.02)
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.neo_hookean(u, 100.0, 0.3)), u, [pair],
        bcs=bcs, geometry=geometry, petsc_options_prefix="fit_",
    )  # fmt: skip
    return problem, u, pull


def test_series_holds_pressures_as_stresses_and_positions_in_the_half_plane(shared_path):
    problem, u, _ = fitted()
    problem.solve()
    with fm.ResultsWriter(shared_path / "fit", problem, {"hoop": u[0]}) as results:
        results.write(0.0)
    (file,) = steps(shared_path / "fit.pvd", "surfaces", "hub/left")[0.0]
    surface, contact = meshio.read(file), problem.contacts[0]
    assert np.allclose(surface.points[:, 0], 1.0)
    assert np.array_equal(surface.point_data["contact_pressure"], contact.pressure)
    # a stress: the force is its integral over 2 pi r
    area = 2.0 * np.pi * 1.0 * 2.0
    force = abs(problem.contacts[0].forces[:, 0].sum())
    assert force == pytest.approx(contact.pressure.mean() * area, rel=0.1)
    parts = [meshio.read(part) for part in steps(shared_path / "fit.pvd")[0.0]]
    assert abs(min(part.points[:, 0].min() for part in parts)) < 1e-15
    assert all("hoop" in part.cell_data for part in parts)


def test_restart_agrees_with_the_uninterrupted_run(shared_path):
    problem, u, pull = fitted()
    problem.solve()
    pull.value = 0.01
    problem.solve()
    fm.save_state(problem, shared_path / "fit")
    COMM.barrier()
    again, v, pulled = fitted()
    pulled.value = 0.01
    fm.load_state(again, shared_path / "fit")
    for on, load in ((problem, pull), (again, pulled)):
        load.value = 0.02
        on.solve(predict=False)
    assert np.abs(u.x.array - v.x.array).max(initial=0.0) < 1e-14
    pressures = [p.contacts[0].pressure for p in (problem, again)]
    assert np.allclose(*pressures, rtol=1e-12)
    slips = [p.contacts[0].slip for p in (problem, again)]
    assert np.allclose(*slips, atol=1e-13)
