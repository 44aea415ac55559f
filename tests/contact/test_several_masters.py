# SPDX-License-Identifier: MIT
"""One slave surface and several masters: each node has a multiplier for each of them."""

import numpy as np
import pytest
from scenes import TIGHT, internal, linear_elastic, neo_hookean, nodal, pair_options, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, sector

E, NU = 100.0, 0.3
MATERIALS = {"linear": linear_elastic, "finite": neo_hookean}


def flanks(half):
    """The sides of a groove whose tip is the origin, ``half`` [radian] from its middle."""
    c, s = np.cos(half), np.sin(half)
    return fm.Plane((0, 0), (c, s), name="left"), fm.Plane((0, 0), (-c, s), name="right")


def problem_on(data, slave, masters, *, strain="finite", bcs=None, load=None, pair=None, **options):
    """A slave against several masters."""
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    residual = internal(u, MATERIALS[strain](u, E, NU))
    if load is not None:
        residual -= ufl.inner(ufl.as_vector(load), ufl.TestFunction(V)) * ufl.dx
    pairs = [fm.ContactPair(data, slave, master, **pair_options(pair)) for master in masters]
    return fm.ContactProblem(
        residual, u, pairs, bcs=[] if bcs is None else bcs(V), newton=TIGHT,
        petsc_options_prefix="test_", **options,
    )  # fmt: skip


def disk(half, depth=None, **options):
    """A disk in a groove: pushed down at its middle, or heavy without Dirichlet conditions."""
    sides = flanks(half)
    shape = sector(72, 4, radii=(0.5, 1.0), centre=(0.0, 1.0 / np.sin(half)))
    data = read(lambda: mapped_grids.build([Grid("disk", shape, closed=True)]))
    middle = {"load": (0.0, -0.5)}
    if depth is not None:
        middle = {"bcs": lambda V: [fm.dirichlet(V, data, "disk/top", (0.0, -depth))]}
    return problem_on(data, "disk/bottom", sides, **middle, **options), sides


@pytest.mark.once
@pytest.mark.parametrize("half", [np.pi / 4, np.pi / 3])
@pytest.mark.parametrize("depth", [None, 0.02])
def test_flanks_of_a_groove_share_the_load_of_a_disk(half, depth):
    """Each flank carries W / (2 sin half) along its normal, with equal numbers of nodes."""
    problem, sides = disk(half, depth)
    report = problem.solve()
    assert report.certificate.violations() == []
    weight = -sum(side.reaction[1] for side in sides)
    exact = 0.5 * weight / np.sin(half) * np.array([np.cos(half), np.sin(half)])
    assert np.allclose(sides[0].reaction[:2], -exact, atol=1e-9 * weight)
    assert np.allclose(sides[1].reaction[:2], exact * [1.0, -1.0], atol=1e-9 * weight)
    one, other = problem.equations.contacts
    assert one.active.sum() == other.active.sum() >= 2
    if depth is None:  # 72 facets of the outer and the inner circle
        outer, inner = (36 * r**2 * np.sin(np.pi / 36) for r in (1.0, 0.5))
        assert weight == pytest.approx(0.5 * (outer - inner), rel=1e-9)


@pytest.mark.once
def test_nearest_master_is_the_only_visible_one():
    """The nearer flank as a single obstacle: another formula with equal results."""
    problem, sides = disk(np.pi / 4, 0.02)
    problem.solve()

    def nearer(x):
        fields = [side.evaluate(x) for side in sides]
        left = fields[0][0] <= fields[1][0]
        return tuple(
            np.where(left.reshape(-1, *([1] * (a.ndim - 1))), a, b) for a, b in zip(*fields)
        )

    data = problem.equations.contacts[0].pair.data
    one = problem_on(
        data, "disk/bottom", [fm.SignedDistance(nearer)],
        bcs=lambda V: [fm.dirichlet(V, data, "disk/top", (0.0, -0.02))],
    )  # fmt: skip
    one.solve()
    u, w = nodal(problem), nodal(one)
    assert np.abs(u - w).max() < 1e-10 * np.abs(u).max()


@pytest.mark.once
def test_tangent_is_exact_for_both_systems():
    """Taylor slopes with nodes active on both masters; reasons against condensation."""
    problem, _ = disk(np.pi / 3, 0.02)
    for contact in problem.equations.contacts:
        contact.change(active=contact.covered)
    assert (problem.equations.contacts[0].active & problem.equations.contacts[1].active).sum() > 10
    check = problem.check_tangent(print_table=False)
    assert all(slope > 1.9 for slope in check.slopes.values()), check.slopes
    with pytest.raises(ValueError, match="are slaves of 'right', too; use algorithm='saddle'"):
        disk(np.pi / 3, 0.02, algorithm="condensed")


def tip(strain, part=0.02, **options):
    """A square that stands on its corner in a groove, compressed by ``part`` from above."""
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    x = block(6, 5, width=1.0, height=1.0) @ turn.T
    grid = Grid("square", x, {"bottom": "low", "left": "low", "right": "high", "top": "high"})
    data = read(lambda: mapped_grids.build([grid]))

    def smaller(V):
        exact = fem.Function(V)
        exact.interpolate(lambda X: -part * X[:2])
        return [fm.dirichlet(V, data, "high", exact)]

    return problem_on(data, "low", flanks(np.pi / 4), strain=strain, bcs=smaller, **options)


@pytest.mark.once
@pytest.mark.parametrize("sliding", ["finite", "small"])
@pytest.mark.parametrize("strain", ["linear", "finite"])
def test_corner_in_the_tip_of_a_groove_is_pressed_evenly(strain, sliding):
    """The corner node carries half a facet of each flank: uniform pressure is exact."""
    problem = tip(strain, pair={"sliding": sliding})
    report = problem.solve()
    assert report.certificate.violations() == [] and not report.notes[2:]
    corner = np.argmin(np.hypot(*problem.equations.contacts[0].slave.X.T))
    mu, lmbda = lame(E, NU)
    stress = {  # P, a force over a length of the undeformed mesh
        "linear": 2 * (mu + lmbda) * 0.02,
        "finite": mu * (1 / 0.98 - 0.98) - lmbda * 2 * np.log(0.98) / 0.98,
    }
    length = {"small": 1.0, "finite": 0.98}  # of a segment, to which pressures of the model refer
    u, X = (
        problem.equations.bulk.u.x.array.reshape(-1, 2),
        problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2],
    )
    assert np.abs(u + 0.02 * X).max() < 1e-12
    for contact in problem.equations.contacts:
        assert contact.active[corner]
        on = contact.active & (np.abs(contact.slave.X).max(axis=1) < 0.7)  # the last is prescribed
        assert np.allclose(contact.pressure[on] * length[sliding], stress[strain], rtol=1e-9)


@pytest.mark.once
def test_obstacles_are_driven_separately():
    """Two walls of a channel press a disk supported by them alone, each with a separate force."""
    walls = (
        fm.Plane((-1.05, 0.0), (1.0, 0.0), name="left"),
        fm.Plane((1.0, 0.0), (-1.0, 0.0), name="right"),
    )
    shape = sector(72, 4, radii=(0.5, 1.0))
    data = read(lambda: mapped_grids.build([Grid("disk", shape, closed=True)]))
    problem = problem_on(data, "disk/bottom", walls)
    walls[0].push(x=2.0)
    report = problem.solve()
    assert report.certificate.violations() == []
    assert walls[1].reaction[:2] == pytest.approx((2.0, 0.0), abs=1e-8)
    assert walls[0].place[0] > 0.05


@pytest.mark.once
@pytest.mark.parametrize("law", [None, fm.Coulomb(0.2)])
def test_two_bodies_side_by_side_as_masters(law):
    """A block on two supports, a gap between them: equal and opposite forces, by symmetry."""
    grids = [
        Grid("beam", block(14, 4, width=2.0, height=0.4, corner=(-1.0, 0.0))),
        Grid("left", block(4, 3, width=0.6, height=0.5, corner=(-1.1, -0.5))),
        Grid("right", block(4, 3, width=0.6, height=0.5, corner=(0.5, -0.5))),
    ]
    data = read(lambda: mapped_grids.build(grids))
    problem = problem_on(
        data, "beam/bottom", ["left/top", "right/top"], pair={"law": law},
        bcs=lambda V: [
            fm.dirichlet(V, data, "beam/top", (0.0, -0.02)),
            fm.dirichlet(V, data, "left/bottom", (0.0, 0.0)),
            fm.dirichlet(V, data, "right/bottom", (0.0, 0.0)),
        ],
    )  # fmt: skip
    assert problem.solve().certificate.violations() == []
    one, other = (contact.total_force for contact in problem.equations.contacts)
    assert np.allclose(one, other * [-1.0, 1.0], atol=1e-9 * np.abs(one).max())
    assert one[1] > 0.1 and (law is None or abs(one[0]) > 1e-3)
    slopes = problem.check_tangent(print_table=False).slopes
    assert all(slope > 1.9 for slope in slopes.values()), slopes


def cornered(meshed, **options):
    """A square pressed into the corner of floor and wall with friction, and the constants."""
    sides = {"bottom": "low", "right": "low", "left": "high", "top": "high"}
    grids = [Grid("square", block(6, 6, width=1.0, height=1.0), sides)]
    if meshed:
        grids += [
            Grid("floor", block(9, 3, width=1.17, height=0.5, corner=(-0.2, -0.5))),
            Grid("wall", block(3, 9, width=0.5, height=1.17, corner=(1.0, 0.03))),
        ]
    data = read(lambda: mapped_grids.build(grids))
    press, up, left = (fem.Constant(data.mesh, (0.0, 0.0)) for _ in range(3))
    floor, wall = fm.Plane((0.0, 0.0), (0.0, 1.0)), fm.Plane((1.0, 0.0), (-1.0, 0.0))
    moved = {"high": press} | ({"floor/bottom": up, "wall/right": left} if meshed else {})

    def move(depth, a, b):
        press.value[:] = depth, -depth
        up.value[1], left.value[0] = a, -b
        floor.move(y=a)
        wall.move(x=-b)

    problem = problem_on(
        data, "low", ["floor/top", "wall/left"] if meshed else [floor, wall],
        bcs=lambda V: [fm.dirichlet(V, data, name, value) for name, value in moved.items()],
        pair={"law": fm.Coulomb(0.9)}, **options,
    )  # fmt: skip
    return problem, move


# Compression; then floor and wall approach together and one by one, the floor retreats a little,
# both are removed, and everything is applied in one step. Columns: compression, floor, wall.
PATH = [
    (0.003, 0.0, 0.0), (0.003, 0.01, 0.01), (0.003, 0.012, 0.01), (0.003, 0.012, 0.013),
    (0.003, 0.011, 0.013), (0.0, -0.01, -0.01), (0.003, 0.01, 0.01),
]  # fmt: skip


@pytest.mark.parametrize(
    "meshed, strain, linear_bulk",
    [(False, "finite", None), (True, "finite", None), (False, "linear", True)],
)
def test_corner_sticks_to_floor_and_wall(meshed, strain, linear_bulk):
    """Two gaps and two stick constraints act on the corner: singular if both are obstacles.

    With deformable floor and wall it can stick to both.
    """
    problem, move = cornered(meshed, strain=strain, linear_bulk=linear_bulk)
    corner = np.argmin(np.hypot(*(problem.equations.contacts[0].slave.X - [1.0, 0.0]).T))
    redundant = []
    for step in PATH:
        move(*step)
        report = problem.solve()
        assert report.certificate.violations() == [] and report.num_iterations < 10
        redundant.append(
            [bool(contact.redundant[corner]) for contact in problem.equations.contacts]
        )
        for contact in problem.equations.contacts:
            assert np.abs(contact.slip[contact.sticking]).max(initial=0.0) < 1e-12
        if not meshed and all(contact.active[corner] for contact in problem.equations.contacts):
            place = problem.equations.contacts[0].operators.x[corner]
            assert place == pytest.approx((1.0 - step[2], step[1]), abs=1e-12)
    both, one, other = [True, True], [True, False], [False, True]
    if meshed:
        assert not np.any(redundant)
    else:
        assert redundant[:4:2] + redundant[3:4] == [both, one, other]
