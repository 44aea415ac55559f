# SPDX-License-Identifier: MIT
"""Contacts and ties in space on any number of ranks, also on ranks without cells or facets."""

from mpi4py import MPI

import numpy as np
import pytest
from space_pairs import KINDS, ROLES, stack

import fenics_mortar as fm
from fenics_mortar import laws

COMM = MPI.COMM_WORLD
SOLVED = fm.NewtonOptions(residual_tolerance=1e-12)
FEW = {"upper": (1, 1, 1), "lower": (1, 1, 1)}
SIZES = ((0.8, 0.7, 0.5), (1.2, 1.2, 0.5))


def results(comm, cell, degree, law=None, roles=ROLES[0], *, tie=False, algorithm=None, **options):
    """Iterations and all fields of two steps, sorted by position."""
    given = {"sizes": SIZES, "offset": (0.25, 0.2, -0.003), "poisson": 0.3, **options}
    scene = stack(cell, degree, comm=comm, **given).press()
    scene.set_up(law, roles=roles, tie=tie, newton=SOLVED, algorithm=algorithm)
    reports = [scene.move(0.0, 0.0, -0.04), scene.move(0.03, 0.01, -0.04)]
    contact = scene.contact
    order = np.lexsort(np.round(contact.positions, 7).T)
    names = ("positions", "normals", "tractions", "pressure", "shear", "slip", "gap", "forces")
    fields = {name: np.nan_to_num(getattr(contact, name)[order]) for name in names}
    fields["reaction"] = scene.problem.reaction("upper/top", data=scene.data).force
    fields["moment"] = scene.problem.reaction("upper/top", data=scene.data).moment
    assert all(report.certificate.violations() == [] for report in reports)
    slopes = scene.problem.check_tangent(print_table=False, steps=[2e-4, 1e-4]).slopes
    assert abs(slopes["whole"] - 2.0) < 0.1
    return [report.num_iterations for report in reports], list(contact.status[order]), fields


def assert_equal(*arguments, **options):
    iterations, status, fields = results(COMM, *arguments, **options)
    alone, status_alone, fields_alone = results(MPI.COMM_SELF, *arguments, **options)
    assert iterations == alone and status == status_alone
    for name, field in fields.items():
        scale = max(1.0, np.abs(fields_alone[name]).max())
        assert np.abs(field - fields_alone[name]).max() < 1e-9 * scale, name


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("cell, degree", KINDS)
def test_results_are_those_of_one_rank(cell, degree):
    """Slaves of linear cells are covered partly, too."""
    for roles in ROLES[: 3 - degree]:
        assert_equal(cell, degree, fm.Coulomb(0.3), roles)


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize(
    "law", [None, fm.Tresca(1.0), laws.Worn(0.1, 0.002), laws.MixedCohesive(100.0, 1.0, 0.1)]
)
def test_laws_on_ranks(law):
    assert_equal("hexahedron", 1, law, algorithm="saddle")


def sizes_while_sliding(comm, algorithm):
    """Norm of the matrix after each of three steps, and whether the tangent's pattern stays."""
    scene = stack("hexahedron", comm=comm, sizes=SIZES, offset=(0.25, 0.2, -0.003), poisson=0.3)
    scene.press().set_up(fm.Coulomb(0.3), newton=SOLVED, algorithm=algorithm)
    bulk = scene.problem.equations.bulk
    before, norms = bulk.K.getInfo()["nz_used"], []
    for x in (0.0, 0.1, 0.2):
        scene.move(x, 0.3 * x, -0.04)
        norms.append(scene.problem.equations.system.matrix.norm())
    return norms, bulk.K.getInfo()["nz_used"] == before and bulk.num_patterns == 1


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_no_pattern_of_contact_is_made(algorithm):
    """The matrix has the entries of the state, on any ranks; those of the bodies stay as they are.

    Zeros for what may come into contact were made anew in the second iteration on several ranks.
    """
    norms, stays = sizes_while_sliding(COMM, algorithm)
    assert stays
    assert np.allclose(norms, sizes_while_sliding(MPI.COMM_SELF, algorithm)[0], rtol=1e-9)


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("cell, degree", KINDS)
def test_ties_on_ranks(cell, degree):
    assert_equal(cell, degree, tie=True)


@pytest.mark.usefixtures("several_ranks")
@pytest.mark.parametrize("tie", [False, True])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_two_cells_on_ranks(cell, degree, tie):
    """One cube each: ranks have no slave facets, or no cells."""
    law = None if tie else fm.Coulomb(0.3)
    assert_equal(cell, degree, law, tie=tie, **FEW)


@pytest.mark.usefixtures("several_ranks")
def test_five_cells_on_ranks():
    assert_equal("hexahedron", 1, fm.Coulomb(0.3), upper=(1, 2, 1), lower=(3, 1, 1))
