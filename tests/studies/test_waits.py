# SPDX-License-Identifier: MIT
"""Waiting times: forces of the scenes, their arrays for other codes, and the table of all codes."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from demos.studies.accuracy.peer import areas, given
from demos.studies.performance import waits_table
from demos.studies.performance.waits import DISC, force_and_pressure, half_disc
from demos.studies.performance.waits_peer import body_of_slave

pytestmark = pytest.mark.serial
OLD = "| scene | unknowns | CPU [s] | iterations | linear solver |"
NEW = "| scene | unknowns | CPU [s] | iterations | force | largest pressure | linear solver |"


@pytest.fixture(scope="module", params=[1, 2])
def disc(request):
    problem = half_disc(0.1 / request.param, degree=request.param)
    problem.solve()
    return problem


def test_force_and_pressure_are_those_of_the_multipliers(disc):
    force, largest = force_and_pressure(disc)
    (contact,) = disc.equations.contacts
    supported = np.flatnonzero(disc.equations.bulk.prescribed.reshape(-1, 2).all(axis=1))
    below = supported[disc.equations.bulk.V.tabulate_dof_coordinates()[supported, 1] < -1.0]
    assert force == pytest.approx(disc.equations.bulk.r.array_r.reshape(-1, 2)[below, 1].sum())
    assert largest == pytest.approx(contact.pressure.max(), rel=0.03)


def test_arrays_of_the_exchanged_problem_have_the_other_surface(disc):
    arrays = given(disc, body_of_slave(disc), *DISC)
    on_slave = np.isin(arrays.cells_of(True), arrays.slave)
    assert on_slave.any() and not np.isin(arrays.cells_of(False), arrays.slave).any()
    other = arrays.exchanged()
    assert set(other.slave) == set(arrays.master.ravel())
    np.testing.assert_array_equal(other.slave[other.facets], arrays.master)
    assert areas(other).sum() == pytest.approx(4.0)  # the top of the block
    again = other.exchanged()
    np.testing.assert_array_equal(again.slave[again.facets], arrays.slave[arrays.facets])


def printed(code, *lines):
    command = [sys.executable, "-c", "import sys; print('noise'); print(sys.argv[1])"]
    return waits_table.run(code, [*command, "\n".join(lines)], dict(os.environ), Path.cwd())


def test_table_has_medians_of_all_codes_and_deviations_from_the_fine_mesh():
    rows = printed("fine", NEW, "|---|", "| H1 | 900 | 1 | 5 | 2.0 | 4.0 | x |")
    for seconds in ("3.0", "1.0", "2.0"):
        rows += printed("now", NEW, f"| H1 | 90 | {seconds} | 5 | 2.02 | 3.96 | once (predicted) |")
    rows += printed("before", OLD, "| H1 | 90 | 4.0 | 7 | y |", "| H1, other | 90 | 4.0 | 7 | y |")
    rows += printed("Kratos", NEW, "| H1 | 90 | - | - | - | - | not possible |")
    lines = waits_table.table(rows).splitlines()[2:]
    assert lines == [
        "| H1 | 90 | now | 2.00 | 5 | 1.00 | 1.00 | once |",
        "| H1 | 90 | before | 4.00 | 7 |  |  | y |",
        "| H1 | 90 | Kratos | - | - | - | - | not possible |",
    ]
    assert len(waits_table.draw(rows).axes) == 2


def test_failure_of_a_code_is_an_error():
    with pytest.raises(RuntimeError, match="now.*failed"):
        waits_table.run("now", [sys.executable, "-c", "1/0"], dict(os.environ), Path.cwd())


@pytest.mark.parametrize("code", ["getfem", "kratos", "ngsolve"])
def test_other_codes_find_the_same_force(code, disc):
    pytest.importorskip({"kratos": "KratosMultiphysics"}.get(code, code))
    peer = pytest.importorskip(f"demos.studies.accuracy.peer_{code}")
    force, _ = force_and_pressure(disc)
    arrays = given(disc, body_of_slave(disc), *DISC, deformed=True)
    if code == "kratos" and arrays.facets.shape[1] == 3:
        with pytest.raises(NotImplementedError):
            peer.pose(arrays)
        return
    u, own = peer.pose(arrays)(arrays.values).u, disc.equations.bulk.u.x.array.copy()
    disc.equations.bulk.u.x.array[:] = u.ravel()
    assert force_and_pressure(disc)[0] == pytest.approx(force, rel=0.06)  # two facets touch
    disc.equations.bulk.u.x.array[:] = own
