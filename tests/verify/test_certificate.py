# SPDX-License-Identifier: MIT
"""Certificates of solved states, and of states that are not solutions."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, pressed_blocks, read, rectangles, rotation
from turning_scenes import shaft_in_ring

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.verify import checks
from fenics_mortar.verify.certificate import Certificate, PairCertificate
from fenics_mortar.verify.checks.corners import end_pressure
from fenics_mortar.verify.finding import Finding, mean_friction
from meshes import indenter_on_block, mapped_grids, two_blocks
from meshes.mapped_grids import Grid, block


def solved(**options):
    scene = pressed_blocks(**options)
    scene.loads["push"].value[:] = (0.02, -0.06)
    scene.problem.solve()
    return scene


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("basis", ["dual", "standard"])
@pytest.mark.parametrize("degree", [1, 2])
def test_solved_state_has_no_violations(slave, basis, degree):
    scene = solved(slave=slave, pair={"basis": basis}, n_upper=7, n_lower=11, degree=degree)
    (certificate,) = scene.problem.certificate().pairs
    assert certificate.violations() == []
    assert certificate["force"].value < 1e-14 and certificate["shear"].value < 1e-12
    for name in ("overlap", "complementarity"):
        assert certificate[name].value < 1e-12  # rounding
    assert certificate["missed_nodes"].value == 0


def test_certificate_is_that_of_a_displacement_set_by_the_user():
    scene = solved(n_upper=4, n_lower=6)
    scene.problem.equations.bulk.u.x.array[:] *= 1.05
    (found,) = scene.problem.certificate().pairs
    scene.problem.equations.evaluate_operators()
    (again,) = scene.problem.certificate().pairs
    assert found["penetration"].value == again["penetration"].value
    assert found["complementarity"].value == again["complementarity"].value > 1e-4


def test_moment_of_flat_contact_balances():
    scene = pressed_blocks(n_upper=4, n_lower=6, nu=0.0, width_upper=1.0, width_lower=1.0)
    scene.loads["push"].value[1] = -0.02
    scene.problem.solve()
    assert scene.problem.certificate().pairs[0]["moment"].value < 1e-14  # to rounding


def test_penetration_inside_a_segment_is_measured():
    """The middle node of a quadratic facet enters a flat facet with the same ends."""
    scene = pressed_blocks(n_upper=4, n_lower=4, width_upper=1.0, width_lower=1.0, degree=2)
    slave = scene.contact.slave
    x = scene.contact.operators.x[slave.owned, 0]
    scene.u.x.array[slave.local_dofs[np.isclose(x, 0.375), 1]] -= 0.02
    (found,) = scene.problem.certificate().pairs
    assert found["penetration"].value == pytest.approx(0.02 / 0.25, rel=1e-12)


def test_tension_and_overlap_are_violations():
    scene = solved(n_upper=7, n_lower=11)
    contact = scene.contact
    z = contact.z.copy()
    z[3] *= -0.5
    contact.change(z=z)
    assert any("tension" in v for v in scene.problem.certificate().pairs[0].violations())
    z[3] *= -2.0
    contact.change(z=z)
    scene.u.x.array[:] *= 2.0
    contact.evaluate(scene.u.x.array, scene.problem.equations.linearization)
    assert any("overlap" in v for v in scene.problem.certificate().pairs[0].violations())


def test_penetration_between_nodes_is_reported():
    scene = solved(n_upper=7, n_lower=11)
    contact, u = scene.contact, scene.u
    start, up = u.x.array.copy(), contact.slave.local_dofs[:, 1]
    assert scene.problem.certificate().remarks() == []
    for facets, right, wrong in (
        (-0.3, r"penetration of 0.[23]\d .* at \(.*reduce it", "penetration of 0.[789]"),
        (0.3, "0.[23]. facets apart; finer", "0.[789]. facets apart"),
    ):
        for part, expected in ((1.0, right), (3.0, wrong)):
            u.x.array[:] = start
            u.x.array[up] += part * facets * contact.slave.facet_sizes.max()
            u.x.scatter_forward()
            contact.evaluate(u.x.array, scene.problem.equations.linearization)
            (pair,) = scene.problem.certificate().pairs
            assert any(re.search(expected, text) for text in (*pair.remarks(), *pair.violations()))
    contact.change(active=np.zeros_like(contact.active))
    assert pair["distance"].verdict == "violation"
    (pair,) = scene.problem.certificate().pairs
    assert pair["distance"].verdict == "ok" and pair.remarks() == []


@pytest.mark.once
def test_missed_contact_is_a_violation():
    """An indenter in the middle of the block with a search radius too short to find its surface."""
    data = read(
        indenter_on_block.build, n_block=24, layers_block=8, n_indenter=6, layers_indenter=4
    )
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "block/bottom", np.zeros(2)),
        fm.dirichlet(V, data, "indenter/top", np.array([3.0, -1.5])),
    ]
    pair = fm.ContactPair(data, "indenter/arc", "block/top", search_radius=0.3)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u, [pair], bcs=bcs, petsc_options_prefix="missed_"
    )
    with pytest.raises(fm.NotConvergedError, match="contact was missed.*; follow_path reverts"):
        problem.solve()  # no resistance: this converges
    u.x.array[:] = 0.0
    problem.solve(accept_violations=True)
    (certificate,) = problem.certificate().pairs
    assert np.abs(problem.equations.contacts[0].total_force).max() == 0.0
    assert certificate["missed_nodes"].value >= problem.equations.contacts[0].slave.num_nodes
    assert any("contact was missed" in v for v in certificate.violations())


def test_certificate_comes_with_the_report_and_prints():
    scene = pressed_blocks(n_upper=5, n_lower=7)
    scene.loads["push"].value[:] = (0.02, -0.06)
    report = scene.problem.solve()
    assert report.certificate.violations() == []
    assert report.certificate.balance < 1e-13  # to rounding, after a quadratic step
    (pair,) = report.certificate.pairs
    row = f"| penetration between the nodes [facet lengths] | {pair['penetration'].value:.2g} |"
    assert f"\n{row}  | 0.2 | 0.5 | ok |\n" in str(report.certificate)
    with pytest.raises(KeyError, match="'depth' is not measured for .* one of .*penetration"):
        pair["depth"]


def test_table_has_a_column_for_each_pair_and_one_verdict_for_each_row():
    found = [
        PairCertificate("a - b", (Finding("gap", "gap", -0.0, remark=0.1, unit="mm"),)),
        PairCertificate("c - d", (Finding("gap", "gap", 0.12345, "wide", 0.5, 0.1, "mm"),)),
        PairCertificate("e - f", (Finding("lost", "nodes lost", 2, limit=1),)),
        PairCertificate(
            "g - h", (Finding("mean", "mean", np.inf), Finding("n", "n", np.nan, "", 1.0))
        ),
    ]
    table = str(Certificate(found, 0.0, 0))
    columns = [*(pair.pair for pair in found), "all bodies"]
    for row in (
        f"| check | {' | '.join(columns)} | remark above | violation above | result |",
        "| gap [mm] | 0 | 0.12 |  |  |  | 0.1 | 0.5 | remark |",
        "| nodes lost |  |  | 2 |  |  |  | 1 | violation |",
        "| n |  |  |  | nan |  |  | 1 | violation |",
        "| mean |  |  |  | inf |  |  |  |  |",
        "| inverted cells |  |  |  |  | 0 |  | 0 | ok |",
        "e - f: nodes lost: 2 (allowed 1)",
    ):
        assert row in table.splitlines()
    assert Certificate(found[:2], 0.0, 0).remarks() == ["c - d: wide"]


NEW_CHECK = """
from fenics_mortar.verify.finding import Finding

def of_contact(measured):
    shortest = float(measured.contact.slave.facet_sizes.min())
    yield Finding("shortest", "shortest facet", shortest, "too long", limit=0.0, unit="mm")
"""


def test_new_check_is_one_new_module(tmp_path, monkeypatch):
    (tmp_path / "of_this_test.py").write_text(NEW_CHECK)
    monkeypatch.setattr(checks, "__path__", [*checks.__path__, str(tmp_path)])
    checks.checks.cache_clear()
    try:
        scene = pressed_blocks(n_upper=5, n_lower=7)
        with pytest.raises(fm.NotConvergedError, match="too long") as failed:
            scene.problem.solve()
    finally:
        checks.checks.cache_clear()
    shortest = float(scene.contact.slave.facet_sizes.min())
    assert failed.value.report.certificate.pairs[0]["shortest"].value == shortest
    assert f"| shortest facet [mm] | {shortest:.2g} |" in str(failed.value.report.certificate)


def test_lost_balance_is_a_violation():
    scene = solved(n_upper=5, n_lower=7)
    scene.contact.change(z=1.001 * scene.contact.z)
    assert any("balance" in v for v in scene.problem.certificate().violations())


@pytest.mark.once
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_state_without_load_has_no_violations(unit):
    """All forces are rounding; compared with each other they would not balance."""
    scene = pressed_blocks(
        width_upper=unit, width_lower=2.2 * unit, height_upper=unit, height_lower=unit
    )
    fm.follow_path(scene.problem, lambda time: None, fm.SteppingOptions(step=0.5))
    assert scene.problem.certificate().violations() == []


@pytest.mark.once
def test_nodes_of_another_pair_are_no_missed_contact():
    """Two tools on one block: nodes under the other tool have no partner in this pair."""
    boxes = {"left": (0.2, 1.0, 0.6, 0.4), "right": (1.2, 1.0, 0.6, 0.4)}
    data = read(rectangles, size=0.15, block=(0.0, 0.0, 2.0, 1.0), **boxes)
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, -0.08))
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(V, data, f"{name}/top", push) for name in ("left", "right")]
    pairs = [fm.ContactPair(data, f"{name}/bottom", "block/top") for name in ("left", "right")]
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="tools_")
    certificate = problem.solve().certificate
    assert min(abs(c.total_force[1]) for c in problem.equations.contacts) > 1.0
    assert [pair["missed_nodes"].value for pair in certificate.pairs] == [0, 0]


def test_nodes_beyond_the_edge_are_uncovered_but_not_inside():
    scene = solved(slave="lower", n_upper=7, n_lower=11)
    (certificate,) = scene.problem.certificate().pairs
    assert certificate["uncovered"].value > 0 and certificate["missed_nodes"].value == 0


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_pressing_corner_is_reported(slave):
    """A block turned by 20 degrees stands with a corner on a flat one."""
    low = mapped_grids.block(16, 4, width=2.0, height=0.5, corner=(-1.0, -0.5))
    high = mapped_grids.block(5, 5, width=0.5, height=0.5) @ rotation(np.radians(20)).T
    data = read(
        mapped_grids.build,
        grids=[mapped_grids.Grid("lower", low), mapped_grids.Grid("upper", high)],
        cell="quadrilateral",
    )
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/top", (0.0, -0.005)),
    ]
    sides = {"upper": ("upper/bottom", "lower/top"), "lower": ("lower/top", "upper/bottom")}
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, *sides[slave])], bcs=bcs, petsc_options_prefix="corner_"
    )
    report = problem.solve()
    (certificate,) = report.certificate.pairs
    remarks = [note for note in report.notes if "a corner presses" in note]
    assert certificate["surface_angle"].value == pytest.approx(
        np.sin(np.radians(20)), rel=0.15
    )  # it rotates slightly
    assert len(remarks) == 1 and certificate["surface_angle"].where in remarks[0]
    assert remarks[0] in str(report.certificate)


@pytest.mark.parametrize("slave", ["ring", "shaft"])
@pytest.mark.parametrize("degree, least, most", [(1, 0.08, 0.2), (2, 0.0, 0.02)])
def test_quadratic_curves_face_each_other(degree, least, most, slave):
    """A round shaft of 16 facets without friction in a ring of 20: no corner presses."""
    shaft = shaft_in_ring(
        fm.Frictionless(), degree=degree, columns=16, slave=slave, interference=0.1
    )
    (certificate,) = shaft.problem.certificate().pairs
    assert least <= certificate["surface_angle"].value < most
    assert degree == 1 or not certificate.remarks()


def dragged_wedge(slave, half, tilt, mu):
    """A wedge (half its angle and its tilt in degrees) pressed on a flat block, then dragged."""
    low = mapped_grids.block(40, 6, width=2.0, height=0.5, corner=(-1.0, -0.5))
    left, right = rotation(np.radians(half)) @ (0.0, 0.4), rotation(np.radians(-half)) @ (0.0, 0.4)

    def between(s, t):
        return (1.0 - s) * left[0] + t * right[0], (1.0 - s) * left[1] + t * right[1]

    sides = {"bottom": "wedge/tip", "right": "wedge/tip", "top": "wedge/top", "left": "wedge/top"}
    high = mapped_grids.mapped(4, 4, between) @ rotation(np.radians(tilt)).T
    grids = [mapped_grids.Grid("flat", low), mapped_grids.Grid("wedge", high, sides)]
    data = read(mapped_grids.build, grids=grids, cell="quadrilateral")
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, "flat/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "wedge/top", push),
    ]
    names = ["wedge/tip", "flat/top"]
    pair = fm.ContactPair(data, *(names if slave == "wedge" else names[::-1]), law=fm.Coulomb(mu))
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="wedge_")
    for motion in ((0.0, -0.015), (0.0, -0.03), (0.05, -0.03), (0.12, -0.03), (0.19, -0.03)):
        push.value[:] = motion
        report = problem.solve()
    return problem.equations.contacts[0], report


@pytest.mark.once
@pytest.mark.parametrize(
    "half, tilt, mu",
    [
        (60.0, 0.0, 0.2),
        *(
            pytest.param(*each, marks=pytest.mark.serial)
            for each in ((60.0, 0.0, 0.5), (75.0, 0.0, 0.2), (45.0, 10.0, 0.2))
        ),
    ],
)
def test_dragged_corner_with_a_wrong_force_is_reported(half, tilt, mu):
    """With the corner as slave the error of H/V is at least 7 %, as estimated; otherwise 2 %."""
    for slave, other in (("wedge", "flat/top"), ("flat", None)):
        contact, report = dragged_wedge(slave, half, tilt, mu)
        (certificate,) = report.certificate.pairs
        error = abs(abs(contact.total_force[0] / contact.total_force[1]) - mu)
        remarks = [note for note in report.notes if "corner" in note]
        assert certificate["friction"].value == pytest.approx(mu)
        if other:
            assert error > 0.06 * mu
            estimate = certificate["corner_shear"].value * (1.0 + mu**2)
            assert 0.75 < estimate / error < 1.35
            assert len(remarks) == 1 and f"take '{other}' as slave" in remarks[0]
        else:
            assert error < 0.03 * mu and not remarks and certificate["surface_angle"].value > 0.1


@pytest.mark.parametrize(("shift", "presses"), [((0.0, 0.08), True), ((0.0, 0.0), False)])
def test_pressed_prescribed_slave_node_is_reported(shift, presses):
    """The upper block is fixed at its left side; the lower one is pushed up, or both move."""
    data = read(two_blocks.build, n_upper=8, n_lower=14, layers_upper=6, layers_lower=6)
    V = fm.vector_space(data.mesh, 1)
    u, down = fem.Function(V), fem.Constant(data.mesh, (0.0, -0.02))
    bcs = [
        fm.dirichlet(V, data, "upper/top", down if not presses else (0.0, 0.0)),
        fm.dirichlet(V, data, "upper/left", np.zeros(2)),
        fm.dirichlet(V, data, "lower/bottom", shift),
    ]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="presses_")
    report = problem.solve()
    (certificate,) = report.certificate.pairs
    assert problem.equations.contacts[0].active.sum() > 2
    assert any("presses on a clamped slave node" in note for note in report.notes) == presses
    assert (certificate["end_pressure"].value > 2.0) == presses
    if presses:  # the node at the end of the fixed side
        assert certificate["end_pressure"].where == "(0.6, 1)"


def test_pressure_beside_a_clamped_end_is_compared_with_that_farther_away():
    """One node on each side counts as beside it, nodes up to three away as the next ones."""
    places = np.arange(6)
    around = SimpleNamespace(
        degree=1, along=lambda j, steps: along(places, j, steps), weightless=np.zeros(6, bool)
    )
    free, may_carry = np.ones((6, 2)), places > 0
    free[0] = 0.0
    x = np.stack([places, 0.5 * places], axis=1)
    contact = SimpleNamespace(
        slave=around, free=free, may_carry=may_carry, operators=SimpleNamespace(x=x)
    )
    found = end_pressure(contact, np.array([0.0, 6.0, 2.0, 1.0, 50.0, 9.0]))
    assert found == (3.0, "(0, 0)")
    assert end_pressure(contact, np.array([0.0, 0.1, 2.0, 1.0, 2.0, 2.0])) == (0.0, "")
    around.weightless[0] = True
    assert end_pressure(contact, np.array([0.0, 6.0, 2.0, 1.0, 50.0, 9.0]))[0] == 3.0
    free[0] = 0.0, 1.0  # on the axis of revolution
    assert end_pressure(contact, np.array([0.0, 6.0, 2.0, 1.0, 50.0, 9.0])) == (0.0, "")


def test_mean_friction_is_that_of_nodes_under_pressure_in_any_unit():
    limit, pressure = np.array([0.3, 0.0, 0.1, 0.2]), np.array([1.0, 2.0, -1.0, 0.5])
    for unit in (1e-6, 1.0, 1e6):
        assert mean_friction(unit * limit, unit * pressure) == pytest.approx(0.5 / 1.5)
    assert mean_friction(limit, -np.abs(pressure)) == 0.0


def along(places, nodes, steps):
    """Numbers of the places ``steps`` away from nodes of a line, -1 beyond its ends."""
    there = np.add.outer(nodes, np.array(steps))
    return np.where((there >= 0) & (there < len(places)), there, -1)


def test_edges_of_a_punch_are_no_corners():
    scene = solved(n_upper=7, n_lower=11)
    assert scene.problem.certificate().remarks() == []


@pytest.mark.each
@pytest.mark.parametrize("part, num_remarks", [(0.2, False), (0.04, False), (0.0495, True)])
def test_two_solutions_at_the_end_of_the_master_are_reported(part, num_remarks):
    """The master ends where s^2 / 2 of a node's length is covered, s of its facet."""
    lower = {"slave": "lower", "n_lower": 8, "width_lower": 2.0}
    width = 2.0 * (0.5 + 0.25 * np.sqrt(2.0 * part))
    scene = pressed_blocks(n_upper=5, layers_upper=2, layers_lower=2, width_upper=width, **lower)
    scene.problem.equations.evaluate(start=True)
    assert np.allclose(scene.contact.operators.cover[[1, 7]], 0.25 * part, rtol=1e-9)
    remarks = [r for r in scene.problem.certificate().remarks() if "two solutions" in r]
    assert len(remarks) == num_remarks
    assert all(where in remark for remark in remarks for where in ("(0.25, 1)", "(1.75, 1)"))


@pytest.mark.parametrize("even, basis", [(True, "dual"), (False, "dual"), (True, "standard")])
def test_resultant_beyond_the_end_of_the_master_is_reported(even, basis):
    """The whole force is at the far end of a facet of which 0.4 is covered, or uniform."""
    lower = {"slave": "lower", "n_lower": 8, "width_lower": 2.0, "pair": {"basis": basis}}
    scene = pressed_blocks(n_upper=5, layers_upper=2, layers_lower=2, width_upper=1.2, **lower)
    # covered from 0.4 to 1.6, the slave's nodes 0.25 apart
    scene.problem.equations.evaluate(start=True)
    contact, x = scene.contact, scene.contact.slave.X[:, 0]
    active = (x > 0.2) & (x < 1.8) if even else np.isclose(x, 0.25)
    contact.change(active=active, z=np.where(active, 1.0, 0.0)[:, None] * contact.operators.n)
    (certificate,) = scene.problem.certificate().pairs
    force = contact.operators.force(contact.z)[0][:, 1]
    centre = (force @ x) / force.sum()
    assert certificate["resultant_outside"].value == pytest.approx(
        max(0.4 - centre, 0.0) / 0.25, abs=1e-9
    )
    assert certificate["resultant_outside"].value == pytest.approx(0.0 if even else 0.6, abs=1e-9)
    remarks = [
        message for message in certificate.remarks() if "0.60 facets outside of the part" in message
    ]
    assert len(remarks) == (not even)


@pytest.mark.parametrize("material, angle, told", [
    (linear_elastic, 0.04, ["ring", "shaft"]),  # the pressure of the fit grows by 8 %
    (linear_elastic, 0.005, []),
    (neo_hookean, 0.04, []),
])  # fmt: skip
def test_turned_bodies_with_linear_strains_are_told(material, angle, told):
    shaft = shaft_in_ring(None, material=material, interference=0.01, degree=2)
    before = shaft.problem.contacts[0].pressure.mean()
    shaft.set_both(angle)
    remarks = shaft.problem.solve().certificate.remarks()
    found = [text.split("'")[1] for text in remarks if "linear strains" in text]
    assert found == told
    change = shaft.problem.contacts[0].pressure.mean() / before - 1.0
    assert (0.05 < change < 0.1) if told else abs(change) < 0.01


@pytest.mark.parametrize("material", [linear_elastic, neo_hookean])
def test_collapsed_cells_are_solved(material):
    """F is not known at corners that two nodes share."""
    data = read(mapped_grids.build, grids=[Grid("block", block(4, 4, width=1.0, height=1.0))])
    x = data.mesh.geometry.x
    x[np.hypot(x[:, 0] - 0.5, x[:, 1] - 0.5) < 0.1, 0] = 0.25  # onto the node beside it
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "block/top", (0.0, -0.01))]
    pair = fm.ContactPair(data, "block/bottom", fm.Plane((0.0, 0.0), (0.0, 1.0)))
    residual = internal(u, material(u, 100.0, 0.3))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="collapsed_")
    report = problem.solve()
    assert report.converged and report.certificate.violations() == []


def test_strains_of_bodies_that_are_held_as_a_whole_have_no_remark():
    """Their stresses act on nothing."""
    data = read(rectangles, size=0.25, lower=(0.0, 0.0, 1.0, 1.0), upper=(0.1, 1.0, 0.8, 0.5))
    V = fm.vector_space(data.mesh, 1)
    u, moved = fem.Function(V), fem.Function(V)
    turn = rotation(0.05) - np.eye(2)
    moved.interpolate(lambda x: turn @ x[:2] - np.array([[0.0], [0.01]]) * (x[1] > 1.4))
    bcs = [
        fem.dirichletbc(moved, fem.locate_dofs_geometrical(V, place))
        for place in (lambda x: x[1] > 1.4, lambda x: x[1] < 0.9)
    ]
    bcs.append(fm.dirichlet(V, data, "lower/top", moved))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u, [pair], bcs=bcs, petsc_options_prefix="held_"
    )
    remarks = problem.solve(accept_violations=True).certificate.remarks()
    assert [text.split("'")[1] for text in remarks if "linear strains" in text] == ["upper"]
