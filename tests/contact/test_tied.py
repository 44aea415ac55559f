# SPDX-License-Identifier: MIT
"""Tied pairs: crosspoints, combination with other pairs, ranks, files, bad input."""

from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
from scenes import nodal, pair_options, read
from tied_scenes import (
    AROUND,
    ENDS,
    EXACT,
    ROLES,
    STRAIN,
    blocks,
    comm,
    four_blocks,
    linear,
    neo,
    off,
    ring_data,
    tied,
    tool_on_halves,
)

import ufl

import fenics_mortar as fm
from fenics_mortar.contact import tied_rows
from meshes.mapped_grids import Grid, block, build


@pytest.mark.parametrize("roles", list(product((True, False), repeat=4))[::3])
def test_four_tied_blocks_share_a_corner_for_all_roles(roles):
    data, pairs = four_blocks(roles)
    around = ["a/top", "b/top", "c/bottom", "d/bottom", "a/left", "c/left", "b/right", "d/right"]
    problem, exact = tied(data, pairs, around, STRAIN - np.eye(2), algorithm="condensed")
    problem.solve()
    assert off(problem, exact) < EXACT
    # nodes at the crosspoint and at the fixed ends carry no multiplier
    assert [int((~tie.multiplier_nodes).sum()) for tie in problem.equations.contacts] == [
        2,
        2,
        2,
        2,
    ]


@pytest.mark.once
def test_a_tie_that_yields_nodes_is_integrated_once(monkeypatch):
    """Although others have no partner: these are known."""
    data, calls = blocks(width_upper=1.6), []
    problem, _ = tied(data, [fm.TiedPair(data, *ROLES[0])], ENDS, STRAIN - np.eye(2))
    (tie,) = problem.equations.contacts
    evaluate = tied_rows.evaluate_mortar
    monkeypatch.setattr(tied_rows, "evaluate_mortar", lambda g: calls.append(g) or evaluate(g))
    before, carries = tie.multiplier_nodes, np.flatnonzero(tie.multiplier_nodes)
    assert not before.all()
    tie.drop(np.isin(np.arange(before.size), carries[:1]))
    assert len(calls) == 1 and np.array_equal(np.flatnonzero(tie.multiplier_nodes), carries[1:])


@pytest.mark.once
def test_four_tied_blocks_are_as_stiff_as_one():
    """Only top and bottom are fixed; the middle may not open."""
    found, stretch = [], np.diag([0.0, 0.1])
    data, pairs = four_blocks()
    problem, _ = tied(data, pairs, ["a/top", "b/top", "c/bottom", "d/bottom"], stretch)
    assert problem.solve().certificate.violations() == []
    found.append(problem.reaction(["a/top", "b/top"]).force[1])
    one = read(build, grids=[Grid("one", block(12, 12, width=2.0, height=2.0))])
    problem, _ = tied(one, [], ["one/top", "one/bottom"], stretch)
    problem.solve()
    found.append(problem.reaction("one/top", data=one).force[1])
    assert found[0] == pytest.approx(found[1], rel=0.01)


@pytest.mark.once
@pytest.mark.parametrize("slave, system", [("tool", "Condensed"), ("ground", "Saddle")])
def test_sliding_over_a_tied_joint_agrees_with_one_base(slave, system):
    problem, reports = tool_on_halves(slave=slave)
    assert type(problem.equations.system).__name__ == f"{system}System"
    contact, tie = problem.equations.contacts
    for report in reports:
        assert report.certificate.violations() == [] and report.num_iterations <= 8
        assert report.certificate.pairs[0]["shear"].value < 1e-10
    assert np.abs(tie.z).max() > 0.1
    one = tool_on_halves(slave=slave, joined=False)[0].contacts[0]
    assert contact.total_force[1] == pytest.approx(one.total_force[1], rel=0.01)
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes


@pytest.mark.once
@pytest.mark.parametrize("slave", ["tool", "ground"])
def test_contact_surface_may_cross_the_joint(slave):
    """Both halves are one curve, on which their two corners are one node; with friction."""
    problem, reports = tool_on_halves(slave=slave, law=fm.Coulomb(0.2))
    contact = problem.equations.contacts[0]
    ground = contact.master if slave == "tool" else contact.slave
    assert ground.num_nodes == 8 + 6 + 1
    assert np.count_nonzero(ground.following < 0) == np.count_nonzero(ground.previous < 0) == 1
    assert max(report.num_iterations for report in reports) <= 8
    assert reports[-1].certificate.violations() == []
    force = np.abs(problem.equations.contacts[0].total_force)
    assert force[0] == pytest.approx(0.2 * force[1], rel=0.02)  # the surface is approximately level
    assert min(problem.check_tangent(print_table=False).slopes.values()) > 1.95


def test_a_contact_surface_may_end_at_the_joint():
    """The corner has a multiplier of the tie only; the contact hands its function over."""
    problem, reports = tool_on_halves(slave="left/top")
    contact, tie = problem.equations.contacts
    corner = np.intersect1d(contact.slave.nodes, tie.slave.nodes)
    assert np.isin(corner, tie.slave.nodes[tie.may_carry]).all() and corner.size == 1
    assert not np.isin(corner, contact.slave.nodes[contact.may_carry]).any()
    assert type(problem.equations.system).__name__ == "SaddleSystem"
    assert max(report.num_iterations for report in reports) <= 8


def test_a_body_supported_by_a_tie_alone_does_not_float():
    """The upper of two tied blocks has no Dirichlet condition; it is pulled at its top."""
    data = blocks(layers_upper=2)

    def law(u):
        ds = ufl.Measure("ds", subdomain_data=data.facet_tags)(data.boundary_tag("upper/top"))
        pull = ufl.as_vector((0.0, 1.0))
        return linear(u) - ufl.inner(pull, ufl.TestFunction(u.function_space)) * ds

    pair = fm.TiedPair(data, *ROLES[0])
    problem, _ = tied(data, [pair], ["lower/bottom"], np.zeros((2, 2)), law=law)
    assert problem.equations.floating.bodies == []
    report = problem.solve()
    assert report.certificate.balance < 1e-13
    assert np.abs(problem.equations.contacts[0].pressure + 1.0).max() < 1e-10


def test_result_is_independent_of_the_number_of_ranks():
    together, alone = (tool_on_halves(comm=group)[0] for group in (comm, MPI.COMM_SELF))
    for one, other in zip(together.equations.contacts, alone.equations.contacts, strict=True):
        assert np.array_equal(one.active, other.active)
        assert np.abs(one.z - other.z).max() < 1e-10 * np.abs(other.z).max()


def test_states_and_tables_contain_ties(shared_path):
    problem, _ = tool_on_halves()
    fm.save_state(problem, str(shared_path / "state.npz"))
    other, _ = tool_on_halves()
    other.equations.bulk.u.x.array[:] = 0.0
    fm.load_state(other, str(shared_path / "state.npz"))
    assert np.abs(nodal(other) - nodal(problem)).max() < 1e-13
    assert "left/right - right/left" in fm.contact_table(other)


# Bad input


@pytest.mark.parametrize(
    "options, message",
    [
        ({"basis": "triple"}, "basis='triple'"),
        ({"gap": "closed"}, "gap='closed'"),
        ({"points": 1}, "points=1"),
        ({"search_radius": -1.0}, "search_radius=-1.0"),
        ({"max_angle": 90.0}, "max_angle=90.0"),
        ({"normals": "unit"}, "normals='unit' with TiedPair: a tie has basis, points, max_angle"),
        ({"discretization": "other_codes"}, "normals='unit' with TiedPair"),
        ({"integration": "nodes"}, "integration='nodes' with TiedPair"),
    ],
)
def test_unknown_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        fm.TiedPair(blocks(), *ROLES[0], **pair_options(options))


def test_invalid_ties_are_refused():
    data = blocks(gap=0.4)
    with pytest.raises(fm.MeshError, match="no boundary 'upper/botom'"):
        fm.TiedPair(data, "upper/botom", "lower/top")
    none = np.zeros((2, 2))
    with pytest.raises(fm.SurfaceError, match=r"farther apart than 0\.1 everywhere.*search_radius"):
        tied(data, [fm.TiedPair(data, *ROLES[0])], ENDS, none)
    data = blocks((1, 3))
    with pytest.raises(fm.SurfaceError, match="every slave node that has a partner is prescribed"):
        tied(data, [fm.TiedPair(data, *ROLES[0])], AROUND, none)
    with pytest.raises(fm.SurfaceError, match="share 1 nodes"):
        tied(data, [fm.TiedPair(data, "lower/top", "lower/left")], ENDS, none)
    with pytest.raises(ValueError, match="basis 'standard', so D is not diagonal"):
        pair = fm.TiedPair(data, *ROLES[0], **pair_options(basis="standard"))
        tied(data, [pair], ENDS, none, algorithm="condensed")
    sides = [block(1, 1, width=1.0, height=1.0, corner=corner) for corner in ((0, 0), (0.98, -1))]
    data = read(build, grids=list(map(Grid, ("upper", "lower"), sides)))
    with pytest.raises(fm.SurfaceError, match="faces it on less than 5 % of its facets"):
        tied(data, [fm.TiedPair(data, *ROLES[0])], ENDS, none)
    with pytest.raises(ValueError, match="a list of ContactPair and TiedPair"):
        tied(data, ["upper/bottom"], ENDS, none)


def test_straight_cells_of_degree_2_keep_the_gap_of_a_curve():
    data = ring_data(1)
    sides, none = ("inner/bottom", "outer/top"), np.zeros((2, 2))
    with pytest.raises(fm.SurfaceError, match="use a mesh of second order, or gap='kept'"):
        tied(data, [fm.TiedPair(data, *sides)], ["outer/bottom"], none, degree=2)
    pair = fm.TiedPair(data, *sides, gap="kept")
    tied(data, [pair], ["outer/bottom"], np.diag([0.01, 0.0]), degree=2)[0].solve()


def test_tied_bodies_without_supports_are_named():
    data, force = blocks(), (1.0, 0.0)

    def law(u):
        return neo(u) - ufl.inner(ufl.as_vector(force), ufl.TestFunction(u.function_space)) * ufl.dx

    problem, _ = tied(data, [fm.TiedPair(data, *ROLES[0])], [], np.zeros((2, 2)), law=law)
    with pytest.raises(fm.MortarError, match="body .* can .* freely: it is driven by loads"):
        problem.solve()
