# SPDX-License-Identifier: MIT
"""Bodies held at one end, which turns far in one step: the whole body turns with it."""

import numpy as np
import pytest
from scenes import internal, neo_hookean, rotation
from space_scenes import solid
from turning_scenes import rollers

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.obstacles.rigid_motion import rotation_less_one
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, mapped


def largest_error(problem, x, exact):
    """Largest distance of displacements from ``exact`` (n, d) at the nodes ``x`` (n, d)."""
    found = problem.equations.bulk.positions() - x
    return problem.equations.comm.allreduce(float(np.abs(found - exact).max(initial=0.0)), max)


def turned_by(R):
    """Function of a displacement that turns about the origin; R is the rotation minus one."""
    return lambda x: R @ x[: len(R)]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("degrees", [60.0, -100.0, 170.0])
def test_arm_follows_its_end(degrees, degree):
    """Without contact it ends without stress; a block that it does not touch stays."""
    grids = [
        Grid("arm", block(10 * degree, 2 * degree, width=1.1, height=0.12, corner=(-0.1, -0.06))),
        Grid("block", block(2 * degree, 2 * degree, width=0.3, height=0.3, corner=(1.3, 0.0))),
    ]
    data = mapped_grids.mesh(grids, order=degree)
    V = fm.vector_space(data.mesh, degree)
    u, end = fem.Function(V), fem.Function(V)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 10.0, 0.3)), u,
        [fm.ContactPair(data, "block/left", "arm/right", law=fm.Coulomb(0.2))],
        bcs=[
            fm.dirichlet(V, data, "arm/left", end),
            fm.dirichlet(V, data, "block/right", (0.0, 0.0)),
        ],
        petsc_options_prefix="arm_",
    )  # fmt: skip
    x = problem.equations.bulk.positions()
    R = rotation(np.radians(degrees)) - np.eye(2)
    end.interpolate(turned_by(R))
    problem.solve(accept_violations=True)
    exact = np.where(x[:, :1] < 1.2, x @ R.T, 0.0)
    assert largest_error(problem, x, exact) < 1e-6


def test_body_in_space_follows_its_end():
    scene = solid(counts=(2, 2, 8), size=np.array([0.2, 0.2, 1.5]), jiggle=0.0)
    end = fem.Function(scene.u.function_space)
    scene.bcs.append(fm.dirichlet(scene.u.function_space, scene.data, "block/bottom", end))
    problem = scene.set_up().problem
    x = problem.equations.bulk.positions()
    R = rotation_less_one(np.array([1.5, -0.4, 0.7]))
    end.interpolate(turned_by(R))
    problem.solve()
    assert largest_error(problem, x, x @ R.T) < 1e-6


def test_rollers_in_contact_turn_on():
    """Two tyres on rigid hubs, turned by an eighth: the same state as in steps of a sixteenth."""
    problem, left, right = rollers(fm.Coulomb(0.2))

    def turn(*angles):
        problem.restore(start)
        for angle in angles:
            left.move(angle=angle)
            right.move(x=-0.02, angle=angle)
            report = problem.solve()
        return problem.contacts[0].total_force, report.certificate.pairs[0]["approach"]

    right.move(x=-0.02)
    problem.solve()
    start = problem.state()
    eighth = np.pi / 4.0
    force, far = turn(eighth)
    steps, near = turn(0.25 * eighth, 0.5 * eighth, eighth)
    assert force == pytest.approx(steps, rel=1e-3)
    assert (far.verdict, near.verdict) == ("ok", "ok")
    assert far.value < 5.0 and "before" in far.check  # degrees, without those of the hubs


@pytest.mark.parametrize("degrees", [-192.0, -160.0])
def test_blade_turns_past_a_post_that_it_does_not_touch(degrees):
    """At first beyond the post, at the end beside it; the other way round it would hit the post."""
    at, post = np.radians(133.0), {"width": 0.26, "height": 0.4, "corner": (-0.3, -1.0)}

    def blade(s, t):
        along, across = 0.17 + 1.25 * s, 0.11 * (t - 0.5)
        c, s = np.cos(at), np.sin(at)
        return c * along - s * across, s * along + c * across

    sides = {side: "blade/sides" for side in ("bottom", "right", "top")}
    grids = [
        Grid("post", block(3, 2, **post), joined={"right": "post/sides", "left": "post/sides"}),
        Grid("blade", mapped(6, 2, blade), joined=sides),
    ]
    data = mapped_grids.mesh(grids, cell="triangle")
    V = fm.vector_space(data.mesh, 1)
    u, axle = fem.Function(V), fm.RigidBoundary(data, "blade/left", pivot=(0.0, 0.0))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "post/sides", "blade/sides")],
        bcs=[fm.dirichlet(V, data, "post/bottom", (0.0, 0.0))],
        remote=[axle], petsc_options_prefix="blade_",
    )  # fmt: skip
    axle.move(angle=np.radians(degrees))
    assert problem.solve().num_iterations == 1


def near_a_circle(x):
    """Distance from a circle that the arm leans on, not known deep inside."""
    away = x - np.array([0.85, 0.16])
    r = np.linalg.norm(away, axis=1)
    n = away / r[:, None]
    hessian = (np.eye(2) - n[:, :, None] * n[:, None]) / r[:, None, None]
    return np.where(r < 0.085, np.nan, r - 0.1), n, hessian


@pytest.mark.each
@pytest.mark.parametrize("stop", ["block", "circle", "distance"])
def test_arm_is_stopped_by_what_it_leans_on(stop):
    """It bends; turned as a whole it would be inside the stop, and Newton's method stay there."""
    grids = [Grid("arm", block(16, 2, width=1.1, height=0.12, corner=(-0.1, -0.06)))]
    if stop == "block":
        grids += [Grid("stop", block(3, 2, width=0.4, height=0.2, corner=(0.75, 0.06)))]
    data = mapped_grids.mesh(grids)
    V = fm.vector_space(data.mesh, 1)
    u, axle = fem.Function(V), fm.RigidBoundary(data, "arm/left", pivot=(-0.1, 0.0))
    tools = {"circle": fm.Circle((0.85, 0.16), 0.1), "distance": fm.SignedDistance(near_a_circle)}
    master = tools.get(stop, "stop/bottom")
    bcs = [fm.dirichlet(V, data, "stop/top", (0.0, 0.0))] if stop == "block" else []
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 100.0, 0.3)), u, [fm.ContactPair(data, "arm/top", master)],
        bcs=bcs, remote=[axle], petsc_options_prefix="arm_",
    )  # fmt: skip
    axle.move(angle=np.radians(10.0))
    assert problem.solve().num_iterations < 12
    assert problem.contacts[0].total_force[1] < 0.0
