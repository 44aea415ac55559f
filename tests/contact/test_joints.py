# SPDX-License-Identifier: MIT
"""Ends of tied joints that other pairs share, and the sides of a periodic cell."""

from itertools import product

from mpi4py import MPI

import numpy as np
import pytest
from refusal import refused
from scenes import TIGHT, internal, neo_hookean, read
from tied_scenes import EXACT, blocks, comm, four_blocks, linear, neo, off, tied

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes.mapped_grids import Grid, block, build, mapped

DEPTH = 0.05
HALVES = ("left/right", "right/left")


def halves(tool=0, curved=True):
    """Two blocks side by side on a common floor, and a tool above, if it has columns."""
    floor = {"bottom": "floor"}
    left = block(8, 5, width=1.0, height=1.0, corner=(-1, 0))
    right = block(6, 7, width=1.0, height=1.0, corner=(0, 0))
    grids = [Grid("left", left, floor), Grid("right", right, floor)]
    if tool:

        def position(s, t):
            bottom = 1.0 + 0.5 * (s - 0.5) ** 2 * curved
            return (s - 0.5) * (1.0 if curved else 2.0), bottom + t * (1.5 - bottom)

        grids.append(Grid("tool", mapped(tool, 4, position)))
    return read(build, grids=grids)


def problem_of(data, pairs, conditions, law=neo):
    """Problem with zero displacement prescribed on boundaries, or values (name, value, ...)."""
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, *condition) for condition in conditions]
    options = {"petsc_options_prefix": "joint_", "newton": TIGHT}
    return fm.ContactProblem(law(u), u, pairs, bcs=bcs, **options)


def spread(problem, point):
    """Largest difference between the displacements of all nodes at a point [length]."""
    bulk = problem.equations.bulk
    X = bulk.V.tabulate_dof_coordinates()[: bulk.space.num_nodes, :2]
    here = bulk.u.x.array[bulk.space.owned_dofs[np.hypot(*(X - point).T) < 1e-9]]
    everywhere = np.concatenate(comm.allgather(here))
    assert len(everywhere) >= 2
    return float(np.ptp(everywhere, axis=0).max())


@pytest.mark.parametrize("roles", [HALVES, HALVES[::-1]])
@pytest.mark.parametrize("against", ["obstacle", "tool as master", "tool as slave"])
def test_a_joint_stays_closed_below_two_contacts(against, roles):
    data = halves(tool=0 if against == "obstacle" else 9)
    conditions = [("floor", np.zeros(2))]
    if against == "obstacle":
        tool = fm.Circle((0.0, 3.0 - DEPTH), 2.0)
    else:
        tool = "tool/bottom"
        conditions.append(("tool/top", np.array([0.0, -DEPTH])))
    sides = [(top, tool) for top in ("left/top", "right/top")]
    if against == "tool as slave":
        sides = [pair[::-1] for pair in sides]
    contacts = [fm.ContactPair(data, *pair) for pair in sides]
    problem = problem_of(data, [*contacts, fm.TiedPair(data, *roles)], conditions)
    report = problem.solve()
    # 22 % and 12 % of the indentation before; the tied facets are a fifth to a seventh of a block
    assert spread(problem, (0.0, 1.0)) < 2e-3 * DEPTH
    # one slave of two joined masters has two constraints where one surface would have one
    joined = [note for note in report.notes if "pass both masters in one list" in note]
    assert len(joined) == (against == "tool as slave")
    assert min(problem.check_tangent(print_table=False).slopes.values()) > 1.95


@pytest.mark.parametrize("roles", [HALVES, HALVES[::-1]])
@pytest.mark.parametrize("tool", [0, 11])
def test_uniform_pressure_passes_beside_a_joint(tool, roles):
    """Compression of 5 % or 10 %; sides and floor are frictionless."""
    data = halves(tool, curved=False)
    master = "tool/bottom" if tool else fm.Plane((0.0, 1.0 - DEPTH), (0.0, -1.0))
    conditions = [("floor", 0.0, 1), ("left/left", 0.0, 0)]
    if tool:
        conditions += [("tool/top", -2 * DEPTH, 1), ("tool/left", 0.0, 0)]
    contacts = [fm.ContactPair(data, top, master) for top in ("left/top", "right/top")]
    problem = problem_of(data, [*contacts, fm.TiedPair(data, *roles)], conditions)
    assert problem.solve().certificate.violations() == []
    pressure = np.concatenate([c.pressure[c.active] for c in problem.contacts[:2]])
    assert np.ptp(pressure) < 1e-10 * pressure.mean() and len(pressure) == 9 + 7 - 1
    tie = problem.equations.contacts[2]
    u = problem.equations.bulk.values
    ends = [side.gather(u)[side.X[:, 1].argmax()] for side in (tie.slave, tie.master)]
    assert np.abs(ends[0] - ends[1]).max() < EXACT


@pytest.mark.parametrize("roles", list(product((True, False), repeat=3))[::2])
def test_three_tied_blocks_stay_closed_where_they_meet(roles):
    """A slab on two blocks, indented above their joint."""
    grids = [
        Grid("a", block(9, 4, width=2.0, height=0.5, corner=(-1, 1))),
        Grid("b", block(5, 5, width=1.0, height=1.0, corner=(-1, 0)), {"bottom": "floor"}),
        Grid("c", block(7, 6, width=1.0, height=1.0, corner=(0, 0)), {"bottom": "floor"}),
    ]
    data = read(build, grids=grids)
    joints = [("a/bottom", "b/top"), ("a/bottom", "c/top"), ("b/right", "c/left")]
    both = zip(joints, roles, strict=True)
    ties = [fm.TiedPair(data, *(sides if first else sides[::-1])) for sides, first in both]
    contact = fm.ContactPair(data, "a/top", fm.Circle((0.1, 3.5 - DEPTH), 2.0))
    problem = problem_of(data, [contact, *ties], [("floor", np.zeros(2))])
    report = problem.solve()
    assert report.certificate.violations() == []
    assert not any("may open" in note for note in report.notes)
    # between b and c; 13 % before, now at most 1.1 % at this coarse mesh
    assert spread(problem, (0.0, 1.0)) < 0.012 * DEPTH


@pytest.mark.parametrize("algorithm, free", [("condensed", 0), (None, 3)])
def test_three_of_four_joints_have_a_multiplier_at_the_crosspoint(algorithm, free):
    data, pairs = four_blocks()
    around = ["a/top", "b/top", "c/bottom", "d/bottom", "a/left", "c/left", "b/right", "d/right"]
    problem, exact = tied(
        data, pairs, around, np.array([[0.1, 0.2], [0.05, -0.1]]), algorithm=algorithm
    )
    notes = [note for note in problem.solve().notes if "the joint may open" in note]
    assert off(problem, exact) < EXACT and len(notes) == (4 if algorithm else 0)
    ties = problem.equations.contacts
    ends = [np.flatnonzero(np.hypot(*(t.slave.X - (1.0, 1.0)).T) < 1e-9) for t in ties]
    assert sum(int(t.multiplier_nodes[j].sum()) for t, j in zip(ties, ends, strict=True)) == free


def test_a_contact_without_other_nodes_keeps_them_and_this_is_reported():
    """A layer of one cell between two blocks has no node besides those of its two joints."""
    floor = {"bottom": "floor"}
    widths = {"left": (-1.0, 0.9, 6), "glue": (-0.1, 0.2, 1), "right": (0.1, 0.9, 6)}
    grids = [
        Grid(name, block(n, 5, width=width, height=1.0, corner=(x, 0.0)), floor)
        for name, (x, width, n) in widths.items()
    ]
    data = read(build, grids=grids)
    tool = fm.Circle((0.0, 3.0 - DEPTH), 2.0)
    tops = [fm.ContactPair(data, f"{name}/top", tool) for name in widths]
    ties = [
        fm.TiedPair(data, f"glue/{a}", f"{a}/{b}")
        for a, b in (("left", "right"), ("right", "left"))
    ]
    problem = problem_of(data, [*tops, *ties], [("floor", np.zeros(2))])
    notes = [note for note in problem.solve().notes if "may open" in note]
    assert len(notes) == 2 and "(0.1, 1)" in " ".join(notes)
    assert not any("may open" in note for note in problem.solve().notes)  # said once


def test_ties_of_mixed_functions_say_what_they_tie():
    data = blocks()
    W = fm.mixed_space(data.mesh, ("Lagrange", 1, (2,)), ("Lagrange", 1))
    w = fem.Function(W)
    u, T = ufl.split(w)
    v, S = ufl.TestFunctions(W)
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    residual = (
        ufl.inner(ufl.grad(u), ufl.grad(v)) + ufl.inner(ufl.grad(T), ufl.grad(S)) + T * S
    ) * dx
    bcs = [
        fm.dirichlet(W.sub(0), data, name, np.zeros(2)) for name in ("lower/bottom", "upper/top")
    ]
    pair = fm.TiedPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="mixed_")
    assert any("does not tie sub-space 1" in note for note in problem.solve().notes)


# What a refused set-up or solve leaves


@pytest.mark.parametrize("cause", ["prefix", "no stiffness", "options"])
def test_a_refused_set_up_leaves_mesh_and_displacement_unchanged(cause):
    """The tie would move the nodes of the slave by 0.05 before the error."""
    data = blocks((4, 6), gap=0.05)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    u.interpolate(lambda X: 0.01 * X[:2])
    before = data.mesh.geometry.x.copy(), u.x.array.copy()
    tie = fm.TiedPair(data, "upper/bottom", "lower/top", search_radius=0.2)
    bcs = [fm.dirichlet(V, data, "lower/bottom", np.zeros(2))]
    residual, options = neo(u), {}
    if cause == "prefix":
        options = {"petsc_options": {"ksp_type": "no such solver"}}
    elif cause == "no stiffness":
        nothing = fem.Constant(data.mesh, 0.0)  # no stiffness anywhere
        residual = internal(u, nothing * neo_hookean(u, 100.0, 0.3))
    else:
        options = {"solver": "iterative", "algorithm": "condensed", "linear_bulk": True}
        tie = fm.TiedPair(
            data, "upper/bottom", "lower/top", search_radius=0.2,
            discretization=fm.Discretization(basis="standard"),
        )  # fmt: skip
    with pytest.raises((fm.MortarError, ValueError)):
        fm.ContactProblem(residual, u, [tie], bcs=bcs, petsc_options_prefix="no_", **options)
    assert np.array_equal(data.mesh.geometry.x, before[0])
    assert np.array_equal(u.x.array, before[1])


@pytest.mark.parametrize("after", [3, 8])
def test_a_refused_solve_leaves_the_state_unchanged(after):
    """The distance of a pushed lid is not a number from some call on, in part once it has moved."""
    data, calls = halves(), [-1000]

    def lid(x):
        calls[0] += 1
        nothing = np.zeros((len(x), 2, 2)) * (np.nan if calls[0] > after else 1.0)
        return 1.1 - x[:, 1], np.tile((0.0, -1.0), (len(x), 1)), nothing

    lid = fm.SignedDistance(lid)
    pairs = [fm.ContactPair(data, "left/top", lid), fm.TiedPair(data, *HALVES)]
    problem = problem_of(data, pairs, [("floor", np.zeros(2))])
    lid.push(y=-1.0)
    before = problem.state()
    calls[0] = 0
    with pytest.raises(fm.MortarError, match="is not finite") as caught:
        problem.solve()
    if not isinstance(caught.value, fm.NotConvergedError):  # which keeps the last iterate
        state = problem.state()
        assert np.array_equal(state.u, before.u) and np.array_equal(state.places, before.places)
        assert np.array_equal(state.interfaces[0].z, before.interfaces[0].z)


# Periodic cells


@pytest.mark.parametrize("counts", [(4, 4), (4, 7)])
@pytest.mark.parametrize("slave", ["right", "left"])
def test_a_periodic_cell_passes_a_macroscopic_strain(slave, counts):
    """Floor and roof prescribed; the sides follow each other, with F - 1 times the period."""
    gradient = np.array([[0.1, 0.2], [0.05, -0.1]])
    ends = {"bottom": "floor", "top": "roof"}
    grids = [
        Grid(name, block(6, rows, width=1.0, height=1.0, corner=(x, 0.0)), ends)
        for name, rows, x in (("a", counts[0], 0.0), ("b", counts[1], 1.0))
    ]
    data = read(build, grids=grids)
    sides = ("b/right", "a/left") if slave == "right" else ("a/left", "b/right")
    period = np.array([2.0 if slave == "right" else -2.0, 0.0])
    jump = fem.Constant(data.mesh, (0.0, 0.0))
    periodic = fm.TiedPair(data, *sides, translation=period, jump=jump)
    joint = fm.TiedPair(data, "a/right", "b/left")
    problem, exact = tied(data, [periodic, joint], ["floor", "roof"], gradient)
    jump.value[:] = gradient @ period
    report = problem.solve()
    assert off(problem, exact) < EXACT and report.certificate.violations() == []
    assert min(problem.check_tangent(print_table=False).slopes.values()) > 1.95


@pytest.mark.parametrize("given", [(0.0, 0.0), (-1.0, 0.0), (0.5, 0.25)])
def test_a_wrong_translation_is_refused_with_the_right_one(given):
    data = read(build, grids=[Grid("cell", block(6, 5, width=1.0, height=1.0))])
    tie = fm.TiedPair(data, "cell/right", "cell/left", translation=given)
    with refused(fm.SurfaceError, r"periodic cell, take translation=\(1, 0\)"):
        tied(data, [tie], ["cell/bottom"], np.eye(2))


def test_a_cell_that_is_periodic_in_both_directions_needs_no_support():
    """Its ties prevent a rotation; the corners have three constraints of four."""
    gradient = np.array([[0.1, 0.2], [0.05, -0.1]])
    data = read(build, grids=[Grid("cell", block(6, 5, width=1.0, height=1.0))])
    sides = {"right": ("left", (1.0, 0.0)), "top": ("bottom", (0.0, 1.0))}
    pairs = [
        fm.TiedPair(
            data, f"cell/{slave}", f"cell/{master}", translation=period, jump=gradient @ period
        )
        for slave, (master, period) in sides.items()
    ]
    problem, exact = tied(data, pairs, [], gradient, start=0.0)
    (body,) = problem.equations.floating.bodies
    assert np.abs(body.motions[:, 2]).max() < EXACT and len(body.motions) == 2
    assert problem.solve().certificate.violations() == []
    bulk = problem.equations.bulk
    off = (bulk.u.x.array - exact.x.array)[bulk.space.owned_dofs]
    everywhere = np.concatenate(comm.allgather(off))
    assert np.ptp(everywhere, axis=0).max() < EXACT  # a translation


def rough_layer(columns, phase, sides, periods=1):
    """A layer of period 2 with an asymmetric rough top, pressed by a plane."""

    def position(s, t):
        x = 2.0 * periods * s
        angle = np.pi * (x - phase)
        return x, t * (1.0 + 0.05 * np.cos(angle))

    data = read(
        build, grids=[Grid("layer", mapped(columns * periods, 6, position))], cell="quadrilateral"
    )
    pairs = [fm.ContactPair(data, "layer/top", fm.Plane((0.0, 1.01), (0.0, -1.0)))]
    conditions = [("layer/bottom", np.zeros(2))]
    if sides == "periodic":
        pairs.append(
            fm.TiedPair(data, "layer/right", "layer/left", translation=(2.0 * periods, 0.0))
        )
    else:
        conditions += [(f"layer/{side}", 0.0, 0) for side in ("left", "right")]
    problem = problem_of(data, pairs, conditions)
    assert problem.solve().certificate.violations() == []
    return problem.contacts[0]


@pytest.mark.parametrize("phase", [0.0, 0.05, 1.0])
def test_contact_across_a_seam_is_one_region(phase):
    """As resolved as in the middle of the cell, with two or three nodes on each side."""
    data = read(build, grids=[Grid("layer", mapped(16, 4, lambda s, t: wavy(2.0 * s, t, phase)))])
    pairs = [
        fm.ContactPair(data, "layer/top", fm.Plane((0.0, 1.01), (0.0, -1.0))),
        fm.TiedPair(data, "layer/right", "layer/left", translation=(2.0, 0.0)),
    ]
    report = problem_of(data, pairs, [("layer/bottom", np.zeros(2))]).solve()
    assert not any("does not resolve" in text for text in report.certificate.remarks())


def wavy(x, t, phase):
    return x, t * (1.0 + 0.05 * np.cos(np.pi * (x - phase)))


def test_a_periodic_rough_layer_is_a_part_of_a_wide_symmetric_one():
    wide = rough_layer(16, 1.0, "symmetric", periods=3)
    one = rough_layer(16, 1.0, "periodic")
    # equal meshes: equal to rounding
    assert one.total_force[1] == pytest.approx(wide.total_force[1] / 3.0, rel=1e-10)
    assert one.pressure.max() == pytest.approx(wide.pressure.max(), rel=1e-10)
    # contact across the seam: equal but for the pressure at the seam, once for both sides
    seam = rough_layer(16, 0.0, "periodic")
    assert seam.total_force[1] == pytest.approx(one.total_force[1], rel=1e-3)
    first, last = np.argsort(seam.slave.X[:, 0])[[0, -1]]
    assert seam.pressure[first] == seam.pressure[last] > 1.0
    assert seam.gap[first] == seam.gap[last]
    assert np.abs(seam.gap[last]) < 1e-12


@pytest.mark.parametrize(
    "options, message",
    [
        ({"translation": (1.0,)}, "translation="),
        ({"translation": (np.nan, 0.0)}, "translation="),
        ({"jump": (0.0, np.inf)}, "jump="),
    ],
)
def test_translations_and_jumps_are_two_finite_numbers(options, message):
    with pytest.raises(ValueError, match=message):
        fm.TiedPair(blocks(), "upper/bottom", "lower/top", **options)


def test_jumps_that_are_no_longer_finite_are_refused():
    data = blocks()
    jump = fem.Constant(data.mesh, (0.0, 0.0))
    pair = fm.TiedPair(data, "upper/bottom", "lower/top", jump=jump)
    problem, _ = tied(data, [pair], ["lower/bottom"], np.zeros((2, 2)), law=linear)
    jump.value[:] = (0.0, np.nan)
    with pytest.raises(ValueError, match="jump="):
        problem.solve()
    jump.value[:] = (0.0, 0.1)
    problem.solve()
    u = problem.equations.bulk.u.x.array
    assert comm.allreduce(float(u.max()), MPI.MAX) == pytest.approx(0.1)
