# SPDX-License-Identifier: MIT
"""Regions of contact that the mesh does not resolve are named, others are not."""

from __future__ import annotations

import numpy as np
import pytest
import revolved
from scenes import internal, linear_elastic, pressed_blocks, read, rectangles

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid

UNRESOLVED, UNFIT = "that the mesh does not resolve", "do not fit"


def elastic(data, u, pair, bcs):
    residual = internal(u, linear_elastic(u, 100.0, 0.3))
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="resolution_")


def remarks(problem, text):
    report = problem.solve(accept_violations=True)
    found = [remark for remark in report.certificate.remarks() if text in remark]
    violations = report.certificate.violations()
    assert violations or all(any(remark in note for note in report.notes) for remark in found)
    return found


def disk(facets, master, *, slave="disk/bottom", degree=1, depth=0.01, half=False, columns=19):
    """A disk of radius 1, pressed on a block of width 2 or on an obstacle."""
    angles = (-0.5 * np.pi, 0.5 * np.pi) if half else (0.0, 2.0 * np.pi)
    arc = mapped_grids.sector(
        facets * degree, 4 * degree, radii=(0.4, 1.0), angles=angles, centre=(0.0, 1.0)
    )
    grids = [Grid("disk", arc, closed=not half)]
    base = mapped_grids.block(
        columns * degree, 3 * degree, width=2.0, height=0.6, corner=(-1.0, -0.6)
    )
    if isinstance(master, str):
        grids.append(Grid("block", base))
    data = read(mapped_grids.build, grids=grids, order=degree)
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "disk/top", (0.0, -depth))]
    if isinstance(master, str):
        bcs.append(fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)))
    if half:
        bcs += [fm.dirichlet(V, data, f"disk/{side}", 0.0, 0) for side in ("left", "right")]
    return elastic(data, u, fm.ContactPair(data, slave, master), bcs)


def block_under(obstacle, depth, size=0.1):
    data = read(rectangles, size=size, block=(-1.0, -1.0, 2.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    problem = elastic(data, fem.Function(V), fm.ContactPair(data, "block/top", obstacle), bcs)
    obstacle.move(y=-depth)
    return problem


@pytest.mark.parametrize(
    ("facets", "slave", "sides", "size"),
    [
        (24, "disk/bottom", "'disk/bottom' and 'block/top'", "0.26"),
        (12, "disk/bottom", "'disk/bottom' and 'block/top'", "0.5"),
        (80, "block/top", "'block/top' and 'disk/bottom'", "0.105"),
    ],
)
def test_contact_of_one_or_two_nodes_is_not_resolved(facets, slave, sides, size):
    master = "block/top" if slave == "disk/bottom" else "disk/bottom"
    (remark,) = remarks(disk(facets, master, slave=slave), UNRESOLVED)
    assert "active node" in remark and f"on facets of {size}" in remark
    assert f"refine {sides} there to facets of " in remark and "4 over the width" in remark


@pytest.mark.parametrize("facets", [16, 40])
def test_contact_of_one_node_with_an_obstacle_is_not_resolved(facets):
    (remark,) = remarks(disk(facets, fm.Plane((0.0, 0.0), (0.0, 1.0))), UNRESOLVED)
    assert "100% of the normal forces" in remark and "refine 'disk/bottom' there" in remark
    (remark,) = remarks(block_under(fm.Circle((0.0, 0.5), 0.5), 0.01, size=0.2), UNRESOLVED)
    assert "refine 'block/top' there to facets of" in remark


@pytest.mark.parametrize("depth", [0.002, 0.003])
def test_a_tip_between_two_nodes_of_the_slave_is_not_missed(depth):
    """Below the middle of a facet of 0.67 the mean gap is open: no node carries a force."""
    problem = disk(80, "disk/bottom", slave="block/top", depth=depth, columns=3)
    found = remarks(problem, "but no node of the pair ca")
    assert not problem.equations.contacts[0].active.any()
    (remark,) = found
    assert f"by {depth / (2.0 / 3.0):.2g} facets" in remark and "refine the slave there" in remark


def test_master_facets_wider_than_the_contact_are_not_resolved():
    (remark,) = remarks(disk(100, "block/top", columns=9), UNRESOLVED)
    assert "3 active nodes" in remark and "refine 'block/top' there" in remark


@pytest.mark.parametrize(("facets", "degree"), [(96, 1), (40, 2)])
def test_resolved_contact_has_no_remark(facets, degree):
    plane = fm.Plane((0.0, 0.0), (0.0, 1.0))
    assert remarks(disk(facets, plane, degree=degree, depth=0.02), UNRESOLVED) == []


def test_region_continues_beyond_a_symmetry_plane():
    """Two active nodes of half a disk are three of a whole one; one stays one."""
    plane = fm.Plane((0.0, 0.0), (0.0, 1.0))
    problem = disk(48, plane, depth=0.012, half=True)
    assert remarks(problem, UNRESOLVED) == []
    assert problem.equations.contacts[0].active.sum() == 2
    assert len(remarks(disk(20, plane, depth=0.01, half=True), UNRESOLVED)) == 1


@pytest.mark.parametrize("tool", ["cone", "sphere"])
@pytest.mark.parametrize(("radius", "count"), [(1.3, 2), (2.5, 3)])
def test_two_nodes_of_a_radius_about_the_axis_are_too_few(tool, radius, count):
    """Forces of Sneddon and Hertz: 20 % too large with two nodes, a few per cent with three."""
    if tool == "cone":
        obstacle, depth = fm.Plane((0.0, 0.0), (0.1, -1.0)), 0.05 * np.pi * radius
    else:
        obstacle, depth = fm.Circle((0.0, 50.0), 50.0), radius**2 / 50.0
    obstacle.move(y=-depth)
    block = mapped_grids.block(12, 12, width=12.0, height=12.0, corner=(0.0, -12.0))
    data = read(mapped_grids.build, grids=[Grid("block", block)])
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, "block/bottom", (0.0, 0.0)),
        fm.dirichlet(V, data, "block/left", 0.0, component=0),
    ]
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "block/top", obstacle, sliding="small")], bcs=bcs,
        geometry="axisymmetric", petsc_options_prefix="resolution_",
    )  # fmt: skip
    assert len(remarks(problem, UNRESOLVED)) == int(count < 3)
    assert problem.equations.contacts[0].active.sum() == count


def test_a_symmetry_plane_across_the_axis_is_none():
    """Half of a crowned disk in a rigid ring: two nodes, of three of the whole disk."""
    block = mapped_grids.block(12, 12, width=10.0, height=6.0)
    block[:, :, 0] *= 1.0 - block[:, :, 1] ** 2 / 1000.0
    data = read(mapped_grids.build, grids=[Grid("disk", block)])
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [
        fm.dirichlet(V, data, f"disk/{side}", 0.0, component=i)
        for i, side in enumerate(["left", "bottom"])
    ]
    ring = fm.Plane((9.99, 0.0), (-1.0, 0.0))
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "disk/right", ring, sliding="small")], bcs=bcs,
        geometry="axisymmetric", petsc_options_prefix="disk_",
    )  # fmt: skip
    assert remarks(problem, UNRESOLVED) == []
    assert problem.equations.contacts[0].active.sum() == 2


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("counts", [(1, 1), (1, 2), (2, 1), (1, 6), (5, 4)])
def test_flat_blocks_of_few_facets_have_no_remark(slave, counts):
    scene = pressed_blocks(slave=slave, n_upper=counts[0], n_lower=counts[1])
    scene.loads["push"].value[:] = (0.0, -0.02)
    assert remarks(scene.problem, UNRESOLVED) == [] and remarks(scene.problem, UNFIT) == []


@pytest.mark.parametrize(
    "obstacle",
    [
        lambda: fm.Polygon([(-0.5, 0), (0.5, 0), (0.5, 1), (-0.5, 1)], 0.01),
        lambda: fm.Polygon([(0, 0), (0.5, 1), (-0.5, 1)], 0.01),
        lambda: fm.Circle((0.0, 0.04), 0.04),
        lambda: fm.Plane((0, 0), (0, -1)),
    ],
    ids=["punch", "corner", "needle", "plane"],
)
def test_punches_and_point_supports_have_no_remark(obstacle):
    problem = block_under(obstacle(), 0.01)
    assert remarks(problem, UNRESOLVED) == [] and problem.equations.contacts[0].active.any()


def shaft_in_bush(facets, clearance, depth, *, degree=1, order=None, rigid=False, pair=None):
    order = order or degree
    shaft = mapped_grids.sector(facets * order, 4 * order, radii=(0.5, 1.0 - clearance))
    shell = mapped_grids.sector(
        facets * 6 // 5 * order, 4 * order, radii=(1.0, 1.6), angles=(0.03, 0.03 + 2 * np.pi)
    )
    grids = [Grid("shaft", shaft, closed=True)]
    grids += [] if rigid else [Grid("bush", shell, closed=True)]
    data = read(mapped_grids.build, grids=grids, order=order)
    V = fm.vector_space(data.mesh, degree)
    bcs = [fm.dirichlet(V, data, "shaft/top", (0.0, -clearance - depth))]
    bcs += [] if rigid else [fm.dirichlet(V, data, "bush/bottom", (0.0, 0.0))]
    master = fm.Circle((0.0, 0.0), 1.0, inside=True) if rigid else "bush/top"
    contact = fm.ContactPair(data, "shaft/bottom", master, **(pair or {}))
    return elastic(data, fem.Function(V), contact, bcs)


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize(("facets", "clearance", "depth"), [(50, 0.001, 0.002), (30, 0.01, 0.005)])
def test_straight_facets_of_conforming_curves_are_named_with_the_remedy(
    rigid, facets, clearance, depth
):
    problem = shaft_in_bush(facets, clearance, depth, rigid=rigid)
    (remark,) = remarks(problem, UNFIT)
    assert "take cells of order 2" in remark and "displacements of degree 2" in remark
    straight = problem.equations.contacts[0].total_force[1]
    curved = shaft_in_bush(facets, clearance, depth, rigid=rigid, degree=2)
    assert remarks(curved, UNFIT) == []
    assert abs(straight) < 0.9 * abs(curved.equations.contacts[0].total_force[1])


def test_fine_facets_fit():
    assert remarks(shaft_in_bush(100, 0.005, 0.01), UNFIT) == []


def test_facets_whose_gaps_are_removed_fit():
    closed = shaft_in_bush(50, 0.0, 0.001, pair={"initial_gap": 0.0})
    assert remarks(closed, UNFIT) == []
    assert closed.equations.contacts[0].active.any()


@pytest.mark.parametrize(("depth", "told"), [(0.012, False), (0.05, True)])
def test_tooth_in_a_facet_without_force_is_remarked(depth, told):
    """A plate presses on the left of a block; its tooth enters a facet on the right, as deep.

    The mean gaps of both nodes of that facet stay open.
    """

    def plate(s, t):
        height = np.where(s < 0.35, 0.49, 0.55)
        height = np.where(np.isclose(s, 0.875), 0.5 - 0.25 * depth, height)
        return s, height + t * (1.0 - height)

    block = mapped_grids.block(4, 2, width=1.0, height=0.5)
    grids = [Grid("block", block), Grid("plate", mapped_grids.mapped(16, 1, plate))]
    data = mapped_grids.mesh(grids)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, side, (0.0, 0.0)) for side in ("block/bottom", "plate/top")]
    problem = elastic(data, u, fm.ContactPair(data, "block/top", "plate/bottom"), bcs)
    certificate = problem.solve().certificate
    contact = problem.equations.contacts[0]
    x = contact.operators.x[:, 0]
    assert contact.active[x < 0.3].any() and not contact.active[x > 0.7].any()
    found = certificate.pairs[0]["idle"]
    assert found.value == pytest.approx(depth, rel=0.3)
    assert (found.verdict == "remark") == told
    texts = [t for t in certificate.remarks() if "enters an unloaded facet of the slave" in t]
    assert bool(texts) == told


def test_a_thin_strip_that_a_circle_bends_is_judged_as_any_body():
    """One node carries a pressure below 1e-6 of the modulus."""
    strip = mapped_grids.block(48, 2, width=1.0, height=0.01)
    data = read(mapped_grids.build, grids=[Grid("strip", strip)], order=2)
    V = fm.vector_space(data.mesh, 2)
    circle = fm.Circle((0.98, 1.01), 1.0)
    pair, clamped = fm.ContactPair(data, "strip/top", circle), (0.0, 0.0)
    problem = elastic(data, fem.Function(V), pair, [fm.dirichlet(V, data, "strip/left", clamped)])
    circle.move(y=-0.002)
    (remark,) = remarks(problem, UNRESOLVED)
    contact = problem.equations.contacts[0]
    assert "1 active node at" in remark
    assert 0.0 < np.max(contact.pressure) < 1e-6 * contact.modulus.max()


def test_a_restored_state_is_judged_by_its_own_forces():
    """The residual of a failed solve in between is not finite."""
    data = read(rectangles, size=0.1, block=(-1.0, -1.0, 2.0, 1.0))
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    circle = fm.Circle((0.0, 0.098), 0.1)
    logarithm = 1e-3 * ufl.ln(0.5 - u[1]) * ufl.TestFunction(V)[1]
    residual = internal(u, linear_elastic(u, 100.0, 0.3))
    residual += logarithm * ufl.dx(metadata={"quadrature_degree": 2})
    problem = fm.ContactProblem(
        residual, u, [fm.ContactPair(data, "block/top", circle)],
        bcs=[fm.dirichlet(V, data, "block/bottom", push)], petsc_options_prefix="restored_",
    )  # fmt: skip
    assert len(remarks(problem, UNRESOLVED)) == 1
    state, told = problem.state(), problem.certificate().remarks()
    push.value[:] = (0.0, 1.0)
    circle.move(y=1.0)
    with pytest.raises(fm.MortarError):
        problem.solve()
    push.value[:] = (0.0, 0.0)
    circle.move(y=0.0)
    problem.restore(state)
    assert problem.certificate().remarks() == told
