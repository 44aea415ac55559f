# SPDX-License-Identifier: MIT
"""Gaps and overlaps of the mesh: kept and reported, closed, or used as interference; ramped."""

import numpy as np
import pytest
from scenes import (
    TIGHT,
    internal,
    linear_elastic,
    neo_hookean,
    pair_options,
    pressed_blocks,
    read,
)

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.view import describe_overlap
from fenics_mortar.energies import lame
from meshes import mapped_grids, rings
from meshes.mapped_grids import Grid, block

E, NU = 100.0, 0.3


def press_fit(material=neo_hookean, n_inner=16, n_outer=12, fixed=(), **pair):
    """Rings between the radii 1, 2 and 3; the outer one fixed at its outside, the inner one free.

    If free, the inner polygon rotates to one of several best-fitting positions.
    """
    data = read(rings.build, n_inner=n_inner, n_outer=n_outer, layers_inner=3, layers_outer=3)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("outer/outside", *fixed)]
    contact = fm.ContactPair(data, "inner/outside", "outer/inside", **pair_options(pair))
    residual = internal(u, material(u, E, NU))
    return fm.ContactProblem(
        residual, u, [contact], bcs=bcs, newton=TIGHT, petsc_options_prefix="fit_"
    )


def lame_pressure(interference):
    """Pressure of an elastic ring in one fixed at its outside, plane strain (Lame)."""
    a, b, c = 1.0, 2.0, 3.0
    mu, lmbda = lame(E, NU)
    # u = A r + B / r, stress_rr = 2 (lmbda + mu) A - 2 mu B / r^2; unit pressure at r = b.
    stress = np.array([[1.0, -mu / (lmbda + mu) / a**2], [1.0, -mu / (lmbda + mu) / b**2]])
    inner = np.linalg.solve(stress, [0.0, -0.5 / (lmbda + mu)])
    outer = np.linalg.solve(
        [[c, 1.0 / c], [1.0, -mu / (lmbda + mu) / b**2]], [0.0, -0.5 / (lmbda + mu)]
    )
    per_pressure = (outer - inner) @ [b, 1.0 / b]
    return interference / per_pressure


@pytest.mark.once
def test_overlap_of_polygons_is_reported_as_interference():
    problem = press_fit()
    report = problem.solve()
    assert "overlap by up to" in report.table() and "initial_gap=0" in report.table()
    assert problem.equations.contacts[0].pressure.max() > 1e-3 * E
    assert "overlap" not in problem.solve().table()


@pytest.mark.once
def test_a_prescribed_interference_is_no_overlap():
    """By the option, or by the offset; polygons beyond half a facet keep their overlap."""
    for of_option, of_offset in ((-1e-4, 0.0), (None, 1e-4)):
        problem = press_fit(linear_elastic, initial_gap=of_option)
        if of_offset:
            problem.contacts[0].offset += of_offset
        report = problem.solve()
        assert problem.contacts[0].pressure.max() > 0.0
        assert not any("overlap" in note for note in report.notes)


@pytest.mark.parametrize("initial_gap", [-0.05, 0.0])
def test_overlaps_that_an_initial_gap_leaves_are_reported(initial_gap):
    """The blocks are meshed 0.9 facets inside each other."""
    data = read(mapped_grids.build, grids=[
        Grid("lower", block(10, 6, width=1.0, height=1.0, corner=(0.0, -1.0))),
        Grid("upper", block(10, 6, width=1.0, height=1.0, corner=(0.0, -0.09))),
    ])  # fmt: skip
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", initial_gap=initial_gap)
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="deep_"
    )
    (note,) = (n for n in problem.solve().notes if "overlap by up to" in n)
    assert "up to 0.09 at" in note and "up to half a facet" in note
    assert "move the bodies apart in the mesh" in note


def test_a_deep_interference_is_named_as_such_with_its_cure():
    problem = press_fit(initial_gap=-2.5)
    (contact,) = problem.equations.contacts
    contact.change(active=contact.covered)
    message = describe_overlap(contact)
    assert "has an interference of 2.5 (" in message and "increase it in steps" in message
    assert "overlap" not in message and "search_radius" not in message


@pytest.mark.each
@pytest.mark.parametrize("sunk", [0.0, 1e-3])
@pytest.mark.parametrize("slave", ["block", "disk", "below an obstacle"])
def test_curves_that_touch_a_block_do_not_overlap_with_it(slave, sunk):
    """Mean gaps of dual functions at a tangent point are negative; 1e-3 deep is an overlap."""
    radius, high = 2.0, 3.0 - sunk
    grids = [Grid("block", block(20, 4, width=2.0, height=1.0))]
    round_side = mapped_grids.sector(64, 4, radii=(1.0, radius), centre=(1.0, high))
    grids += [Grid("disk", round_side, closed=True)] * (slave != "below an obstacle")
    data = mapped_grids.mesh(grids)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    sides = {"block": ("block/top", "disk/bottom"), "disk": ("disk/bottom", "block/top")}
    circle = fm.Circle((1.0, high), radius)
    pair = fm.ContactPair(data, *sides.get(slave, ("block/top", circle)))
    fixed = ["block/bottom"] + ["disk/top"] * (slave != "below an obstacle")
    bcs = [fm.dirichlet(u.function_space, data, fixed, (0.0, 0.0))]
    residual = internal(u, linear_elastic(u, E, NU))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="tangent_")
    assert any("overlap by up to" in note for note in problem.solve().notes) == (sunk > 0.0)


def test_pair_without_partners_is_reported():
    """The inside of the inner ring faces its hole: no part of the outer ring is ahead of it."""
    data = read(rings.build, n_inner=16, n_outer=12, layers_inner=3, layers_outer=3)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("outer/outside", "inner/outside")]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)), u,
        [fm.ContactPair(data, "inner/inside", "outer/outside", search_radius=0.5)],
        bcs=bcs, petsc_options_prefix="away_",
    )  # fmt: skip
    table = problem.solve().table()
    assert "no node of 'inner/inside' faced 'outer/outside'" in table and "within 0.5" in table
    assert "faced" not in problem.solve().table()


@pytest.mark.once
def test_closed_gaps_leave_polygons_without_stress():
    problem = press_fit(initial_gap=0.0)
    assert np.abs(problem.equations.contacts[0].gap).max() < 1e-15
    report = problem.solve()
    assert not any("overlap" in note for note in report.notes)
    assert np.abs(problem.equations.bulk.u.x.array).max(initial=0.0) < 1e-13
    assert np.abs(problem.equations.contacts[0].z).max() < 1e-12 * E


@pytest.mark.once
@pytest.mark.parametrize("n, uneven", [(24, 0.003), (48, 0.001)])
def test_interference_of_polygons_gives_the_pressure_of_circles(n, uneven):
    """Three layers of cells have an error of 0.6 % on either mesh; only the facets are uneven."""
    problem = press_fit(linear_elastic, n, n + n // 3, initial_gap=-1e-4)
    problem.solve()
    pressure = problem.equations.contacts[0].pressure
    assert pressure.mean() == pytest.approx(lame_pressure(1e-4), rel=0.01)
    assert np.ptp(pressure) < uneven * pressure.mean()


@pytest.mark.once
def test_ramped_overlap_ends_in_the_same_state():
    direct, ramped = (press_fit(fixed=("inner/inside",)) for _ in range(2))
    direct.solve()
    contact = ramped.equations.contacts[0]
    overlap = np.nan_to_num(contact.gap).clip(max=0.0)

    def set_loads(time):
        contact.offset = (1.0 - time) * overlap

    path = fm.follow_path(ramped, set_loads, fm.SteppingOptions(step=0.25))
    assert len(path.steps) == 4
    z, exact = contact.z, direct.equations.contacts[0].z
    assert np.abs(z - exact).max() < 1e-12 * np.abs(exact).max()  # both to rounding


@pytest.mark.once
@pytest.mark.parametrize("basis", ["dual", "standard"])
def test_derivatives_with_an_offset(basis):
    """Blocks that stand off their edges, so that facets are partly covered, too."""
    scene = pressed_blocks(
        n_upper=5, n_lower=7, layers_upper=2, layers_lower=2, slave="lower", pair={"basis": basis}
    )
    scene.loads["push"].value[:] = (0.02, -0.03)
    scene.problem.solve()
    random = np.random.default_rng(2)
    scene.contact.offset = random.uniform(-0.01, 0.01, scene.contact.slave.num_nodes)
    check = scene.problem.check_tangent(print_table=False)
    assert all(slope > 1.9 for slope in check.slopes.values()), check.table()


@pytest.mark.once
def test_offset_moves_the_surface_by_as_much():
    """An offset of -d equals a block higher by d, except for the lever arm of tilted facets."""
    mesh = {"n_upper": 5, "n_lower": 7, "layers_upper": 3, "layers_lower": 3}
    shifted = pressed_blocks(pair={"initial_gap": 0.02}, **mesh)
    opened = pressed_blocks(gap=0.02, **mesh)
    for scene in (shifted, opened):
        scene.loads["push"].value[:] = (0.0, -0.06)
        scene.problem.solve()
    z, exact = shifted.contact.z, opened.contact.z
    assert np.abs(z - exact).max() < 1e-3 * np.abs(exact).max()


@pytest.mark.parametrize("degree", [1, 2])
def test_initial_gap_of_a_slave_of_one_facet(degree):
    """On several ranks all except one have no facet to integrate."""
    scene = pressed_blocks(n_upper=1, n_lower=3, gap=0.05, degree=degree, pair={"initial_gap": 0.0})
    scene.problem.solve()
    assert np.abs(scene.contact.gap[scene.contact.covered]).max() < 1e-12
