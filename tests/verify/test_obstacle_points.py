# SPDX-License-Identifier: MIT
"""Small obstacles inside a body, between its nodes."""

import numpy as np
import pytest
import space_pair_scenes
from scenes import internal, neo_hookean, read
from test_obstacles import block_under

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.verify.overlap import depths_of_obstacle
from meshes import two_blocks

FACET = 0.125


def needle(x, y):
    """Corners of a thin solid with its tip at (x, y), below a body of the needle."""
    return [(x, y), (x + 0.01, y + 0.3), (x, y + 0.31), (x - 0.01, y + 0.3)]


def dot(x, y):
    """Signed distance of a disk with its lowest point at (x, y)."""

    def distance(points):
        d = points - [x, y + 0.04]
        r = np.linalg.norm(d, axis=1)
        e = d / r[:, None]
        across = np.eye(2) - np.einsum("ia,ib->iab", e, e)
        return r - 0.04, e, across / r[:, None, None]

    return distance


SMALL = {
    "dust": lambda x: fm.Circle((x, 1.02), 0.01),
    "wire": lambda x: fm.Circle((x, 1.09), 0.08),
    "needle": lambda x: fm.Polygon(needle(x, 1.01), 1e-3),
    "pin": lambda x: fm.Spline([(x - 0.02, 1.4), (x, 1.01), (x + 0.02, 1.4)]),
    "function": lambda x: fm.SignedDistance(dot(x, 1.01)),
}


@pytest.mark.parametrize("x", [0.56, 0.535])
@pytest.mark.parametrize("kind", SMALL)
def test_small_obstacle_inside_a_body_is_a_crossing(kind, x):
    """A step moves it by a facet or more into the block, between two nodes of the surface."""
    for depth in (0.15, 0.35):
        obstacle = SMALL[kind](x)
        problem = block_under(obstacle)
        obstacle.move(y=-0.01 - depth)
        with pytest.raises(fm.NotConvergedError, match="cross at"):
            problem.solve()


@pytest.mark.parametrize("gap", [None, 0.0, 0.2])
def test_obstacle_that_bears_a_body_does_not_cross_it(gap):
    """An initial gap counts as a gap where the surfaces touch: it admits an overlap."""
    for obstacle in (fm.Circle((0.5, 1.5), 0.5), fm.Plane((0.5, 1.0), (0.0, -1.0))):
        if gap and isinstance(obstacle, fm.Circle):
            continue  # only the nodes beside its lowest point touch
        problem = block_under(obstacle, pair={"initial_gap": gap})
        obstacle.move(y=-0.05 - (gap or 0.0))
        crossings = problem.solve().certificate.crossings
        assert not crossings or crossings[0].facets < 0.1
        assert problem.contacts[0].total_force[1] < -1.0


def test_points_that_a_function_without_distance_misses_are_left_out():
    """A function of half the distance: x + phi n of the upper nodes lies inside the block."""

    def half_distance(x):
        size = len(x)
        return 0.5 * (x[:, 1] - 0.8), np.tile([0.0, 0.5], (size, 1)), np.zeros((size, 2, 2))

    obstacle = fm.SignedDistance(half_distance)
    obstacle.move(y=-1.0)
    problem = block_under(obstacle)
    problem.solve(accept_violations=True)
    crossings = problem.equations.crossings
    x = crossings.outline.positions(problem.equations.bulk.u.x.array)
    contact = problem.equations.contacts[0]
    points = contact.operators.nearest_points()
    assert ((points[:, 1] > 0.0) & (points[:, 1] < 1.0)).all()
    slave = crossings.outline.indices_of(contact.slave.nodes)
    assert not len(depths_of_obstacle(contact, crossings.outline, slave, x)[0])


# Bodies without a pair with an obstacle


def below_another(obstacle):
    """A block of 1 x 1 with a pair with the obstacle, below one with a pair with the first one."""
    data = read(two_blocks.build, width_lower=1.0, gap=1.0, n_lower=8, layers_lower=6)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
    pairs = [fm.ContactPair(data, "lower/top", obstacle)]
    pairs.append(fm.ContactPair(data, "upper/bottom", "lower/top"))
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    return fm.ContactProblem(residual, u, pairs, bcs=bcs, petsc_options_prefix="test_")


def below_another_in_space(obstacle):
    """The same of 1.4 x 1.4 x 1 in space, with a gap of 0.5."""
    pairs = [("lower/top", obstacle), ("upper/bottom", "lower/top")]
    return space_pair_scenes.two_blocks(gap=0.5, pairs=pairs).problem


WITHOUT_PAIR = {
    "plane": (below_another, lambda: fm.Circle((0.5, 1.5), 0.2), "y"),
    "space": (below_another_in_space, lambda: fm.Sphere((0.7, 0.7, 1.25), 0.2), "z"),
}


@pytest.mark.parametrize("dim", WITHOUT_PAIR)
def test_bodies_without_a_pair_with_an_obstacle_do_not_let_it_pass(dim):
    """It went into the upper block, and through it in one step, in silence."""
    build, obstacle_of, along = WITHOUT_PAIR[dim]
    for way, message in ((0.35, "body 'upper' and .* no pair with this"), (2.5, "went through")):
        obstacle = obstacle_of()
        problem = build(obstacle)
        obstacle.move(**{along: 0.01})
        assert not problem.solve().certificate.remarks()
        obstacle.move(**{along: way})
        with pytest.raises(fm.NotConvergedError, match=message):
            problem.solve()


def test_plane_without_a_pair_with_a_body_is_a_remark():
    """It may stand for a wall that ends before; the other body may be above that wall."""
    for start, remarks in ((1.2, 1), (0.5, 0)):
        obstacle = fm.Plane((start, 0.0), (-1.0, 0.0))
        problem = below_another(obstacle)
        obstacle.move(x=0.9 - start)
        found = problem.solve(accept_violations=True).certificate
        assert sum("no pair with this obstacle" in r for r in found.remarks()) == remarks
