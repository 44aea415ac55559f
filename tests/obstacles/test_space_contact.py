# SPDX-License-Identifier: MIT
"""Contact of solids with rigid obstacles in space: tangents, friction, invariance, theory."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from refusal import refused
from space_scenes import held, solid

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from fenics_mortar.contact.view import describe_start
from fenics_mortar.obstacles.rigid_motion import rotation_by
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, mapped

TIGHT = fm.NewtonOptions(residual_tolerance=1e-12)
PUNCH = [(-0.4, 0.0), (0.4, 0.0), (0.4, 1.0), (-0.4, 1.0)]
# Obstacles above the block of ``solid``, whose top is at z = 1.5.
KINDS = {
    "plane": lambda: fm.Plane((0.5, 1.0, 1.48), (0.1, 0.05, -1.0)),
    "sphere": lambda: fm.Sphere((0.4, 1.1, 2.9), 1.45),
    "cylinder": lambda: fm.Cylinder((0.5, 1.0, 2.9), (1.0, 0.3, 0.1), 1.45),
    "cone": lambda: fm.Cone((0.5, 1.0, 1.3), (0.1, 0.1, 1.0), 1.4, rounding=0.2),
    "torus": lambda: fm.Torus((0.5, 1.0, 2.2), (0.0, 0.0, 1.0), 0.8, 0.72),
    "roller": lambda: fm.Extruded(
        fm.Circle((0.0, 2.9), 1.45), axis=(0, -1, 0), first=(1, 0, 0), origin=(0.4, 0.0, 0.0)
    ),
    "punch": lambda: fm.Revolved(fm.Polygon(PUNCH, 0.1), origin=(0.5, 1.0, 1.45)),
}
CASES = [
    *[(kind, "hexahedron", 1, 0.0) for kind in KINDS],
    *[(kind, "hexahedron", 1, 0.1) for kind in KINDS if kind != "punch"],
    *[("sphere", cell, order, 0.1) for cell in mapped_boxes.CELLS for order in (1, 2)],
]


def block_under(obstacle, cell="hexahedron", order=1, *, mu=0.0, pair=None, energy=None, **options):
    """A jiggled block that stands on its bottom, with its top against an obstacle."""
    scene = solid(cell, order, counts=(3, 4, 2), energy=energy or energies.neo_hookean)
    held(scene)
    pair = fm.ContactPair(scene.data, "block/top", obstacle, law=law_of(mu), **(pair or {}))
    return scene.set_up([pair], newton=TIGHT, **options)


def law_of(mu):
    """Coulomb's law, or none."""
    return fm.Coulomb(mu) if mu else None


@pytest.mark.once
@pytest.mark.parametrize("kind, cell, order, mu", CASES)
def test_tangent(kind, cell, order, mu):
    """With all nodes active if there is no friction, on obstacles that are translated and rotated.

    With friction at a solution: a slipping node that is about to stick has a tangent that is
    changed on purpose.
    """
    obstacle = KINDS[kind]()
    problem = block_under(obstacle, cell, order, mu=mu).problem
    problem.solve()
    obstacle.move(x=0.03, y=0.05, z=-0.01, angle=(0.02, 0.05, -0.03))
    contact = problem.equations.contacts[0]
    if mu:
        problem.solve()
    else:
        contact.change(active=contact.covered)
    check = problem.check_tangent(print_table=False)
    assert all(slope > 1.9 for slope in check.slopes.values()), check.slopes


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("kind", ["plane", "sphere"])
def test_small_sliding(kind, mu):
    """On obstacles that are translated and rotated: gaps are linear, but in rotations.

    Force and moments on the obstacle balance, to second order in its motion and that of the nodes.
    """
    obstacle = KINDS[kind]()
    options = {"pair": {"sliding": "small"}, "energy": energies.linear_elastic}
    problem = block_under(obstacle, mu=mu, **options).problem
    problem.solve()
    operators = problem.equations.contacts[0].state.reference.operators
    for way in (0.5, 1.0):
        obstacle.move(
            x=0.03 * way, y=0.05 * way, z=-0.01, angle=way * np.array((0.02, 0.05, -0.03))
        )
        assert problem.solve().converged
    contact = problem.equations.contacts[0]
    assert contact.state.reference.operators is operators
    assert np.array_equal(contact.operators.n, operators.n) and contact.active.any()
    slopes = problem.check_tangent(print_table=False).slopes
    assert slopes.pop("bulk") == slopes.pop("n") == slopes.pop("D") == np.inf
    assert all(1.9 < slope < 2.1 for slope in slopes.values() if np.isfinite(slope)), slopes
    gap = contact.operators.gap[contact.active]
    assert np.abs(gap).max() < 1e-12
    below = problem.reaction("block/bottom", data=contact.pair.data).force
    size = np.abs(obstacle.reaction[:3]).max()
    assert size > 0.01 and np.allclose(obstacle.reaction[:3], below, rtol=0, atol=1e-9 * size)


@pytest.mark.once
def test_small_sliding_differs_in_second_order():
    """Halved motions of a plane on a flat block leave a quarter of the difference."""
    differences = []
    for way in (1.0, 0.5):
        forces = []
        for sliding in ("small", "finite"):
            scene = solid_at(mapped_boxes.block((3, 4, 2)), energies.linear_elastic)
            held(scene)
            plane = fm.Plane((0.5, 0.5, 1.0), (0.0, 0.0, -1.0), pivot=(0.5, 0.5, 1.0))
            pair = fm.ContactPair(scene.data, "block/top", plane, law=law_of(0.3), sliding=sliding)
            scene.set_up([pair], newton=TIGHT)
            for x in (0.0, 0.01 * way):
                plane.move(x=x, y=0.5 * x, z=-0.01 * way, angle=way * np.array((0.004, 0.002, 0.0)))
                scene.problem.solve()
            forces.append(plane.reaction / way)
        differences.append(np.abs(forces[0] - forces[1])[:3].max())
    assert 1.7 < differences[0] / differences[1] < 2.3


@pytest.mark.once
@pytest.mark.parametrize("kind", KINDS)
def test_balance_and_algorithms(kind):
    """Condensed and saddle agree; forces and moments balance those of the bottom."""
    found = []
    for algorithm in ("condensed", "saddle"):
        obstacle = KINDS[kind]()
        scene = block_under(obstacle, algorithm=algorithm)
        obstacle.move(z=-0.01)
        report = scene.problem.solve()
        assert report.certificate.violations() == []
        about = obstacle.pivot + obstacle.place[:3]
        below = scene.problem.reaction("block/bottom", about, data=scene.data)
        size = np.abs(obstacle.reaction).max()
        assert obstacle.reaction[2] > 0.01
        assert np.allclose(obstacle.reaction[:3], below.force, rtol=0, atol=1e-9 * size)
        assert np.allclose(obstacle.reaction[3:], below.moment, rtol=0, atol=1e-9 * size)
        assert np.allclose(scene.problem.forces()[2][0], -obstacle.reaction, atol=1e-9 * size)
        found.append((scene.problem.equations.contacts[0].z, report.num_iterations))
    assert np.allclose(found[0][0], found[1][0], atol=1e-9 * np.abs(found[0][0]).max())
    assert found[0][1] == found[1][1]


def test_distance_of_a_user():
    """A ball by its function acts as ``Sphere``; a wrong gradient is found on all axes."""
    found = []
    for turned in (None, 0.0, 0.3):
        ball = fm.Sphere((0.4, 1.1, 2.9), 1.45)

        def distance(x, ball=ball, turned=turned):
            phi, gradient, hessian = ball.local(x)
            return phi, gradient @ rotation_by(np.array((0.0, turned, 0.0))).T, hessian

        obstacle = ball if turned is None else fm.SignedDistance(distance, pivot=ball.pivot)
        scene = block_under(obstacle)
        obstacle.move(z=-0.01)
        report = scene.problem.solve(accept_violations=True)
        found.append((obstacle.reaction, report.certificate.violations()))
    (exact, _), (same, none), (_, (message,)) = found
    assert np.abs(same - exact).max() < 1e-12 and none == []
    assert "turned by 17.2 degrees" in message  # 0.3 radian


@pytest.mark.parametrize("cell", mapped_boxes.CELLS)
@pytest.mark.parametrize("order", [1, 2])
def test_overlap_of_the_mesh_is_told(cell, order):
    """Of a ball that reaches below the top; none of one above it, although a mean gap is negative.

    Its points were those of the plane, read beyond their end.
    """
    for radius, gap in ((1.45, -0.1), (0.3, 0.02)):
        ball = fm.Sphere((1.0 / 3.0, 1.0, 1.5 + radius + gap), radius)
        scene = solid(cell, order, counts=(3, 4, 2), jiggle=0.0)
        scene.set_up([fm.ContactPair(scene.data, "block/top", ball)])
        told = describe_start(scene.problem.equations.contacts[0])
        assert ("overlap by up to" in told) == (gap < 0.0), told


def dragged(slope, ways, mu=0.3):
    """A flat block whose top rises by ``slope`` along x, under a plane that slides along its top.

    Returns:
        Force on the plane after the last of the ``ways`` (n, 2) in x and y.
    """
    x = mapped((3, 4, 2), lambda s, t, r: (s, 2.0 * t, r * (0.4 + slope * s)))
    scene = solid_at(x)
    held(scene)
    plane = fm.Plane((0.0, 0.0, 0.4), (slope, 0.0, -1.0))
    scene.set_up([fm.ContactPair(scene.data, "block/top", plane, law=fm.Coulomb(mu))])
    for a, b in [(0.0, 0.0), *ways]:
        plane.move(x=a, y=b, z=slope * a - 0.02)
        scene.problem.solve()
    return plane.reaction[:3]


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.0, 2.5])
def test_friction_is_along_the_pull_at_any_angle(angle):
    """A plane dragged over the block: |T| = mu N against its motion."""
    pull = np.array([np.cos(angle), np.sin(angle)])
    force = dragged(0.0, np.outer((0.1, 0.2, 0.3), pull))
    assert np.allclose(force[:2], -0.3 * force[2] * pull, rtol=0, atol=1e-3 * force[2])


@pytest.mark.parametrize("slope", [0.2, -0.1, -0.3])
def test_block_on_an_inclined_plane(slope):
    """Forces of a plane that is drawn along its slope, at full slip.

    It needs no force where it slides down a slope that is the coefficient of friction.
    """
    force = dragged(slope, [(0.1, 0.0), (0.2, 0.0), (0.3, 0.0)])
    ratio = (0.3 + slope) / (1.0 - 0.3 * slope)
    assert -force[0] / force[2] == pytest.approx(ratio, abs=1e-3)
    assert abs(force[1]) < 1e-3 * force[2]


def test_stick_while_everything_turns():
    """Body and obstacle turn together after sliding: forces turn with them, without slip."""
    obstacle = fm.Sphere((0.4, 1.1, 2.9), 1.45, pivot=(0.0, 0.0, 0.0))
    scene = solid(counts=(3, 4, 2))
    bottom = fem.Function(scene.u.function_space)
    scene.bcs.append(fm.dirichlet(bottom.function_space, scene.data, "block/bottom", bottom))
    pair = fm.ContactPair(scene.data, "block/top", obstacle, law=fm.Coulomb(0.4))
    problem = scene.set_up([pair], newton=TIGHT).problem
    problem.solve()
    obstacle.move(x=0.05, y=0.03, z=-0.02)
    problem.solve()
    before, turn = obstacle.reaction[:3].copy(), np.array((0.06, -0.04, 0.08))
    assert np.hypot(*before[:2]) > 0.1 * before[2]
    R = rotation_by(turn)
    bottom.interpolate(lambda x: (R - np.eye(3)) @ x)
    obstacle.move(**dict(zip("xyz", R @ obstacle.place[:3], strict=True)), angle=turn)
    problem.solve()
    assert np.allclose(obstacle.reaction[:3], R @ before, rtol=0, atol=1e-8 * np.abs(before).max())
    contact = problem.equations.contacts[0]
    assert np.abs(contact.now.tangential_slip[contact.active]).max() < 1e-4


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_results_do_not_depend_on_the_frame(mu):
    """All turned and moved far away: forces turn.

    Rounding decides whether one more iteration follows below the tolerance.
    """
    found, turn, shift = [], np.array((0.7, -1.2, 0.4)), np.array((10.0, -20.0, 5.0))
    for R, b, vector in ((np.eye(3), np.zeros(3), np.zeros(3)), (rotation_by(turn), shift, turn)):
        x = mapped_boxes.block((3, 4, 2), size=(1.0, 2.0, 1.5), jiggle=0.2)
        scene = solid_at(x @ R.T + b)
        held(scene)
        obstacle = fm.Sphere((0.4, 1.1, 2.9), 1.45, pivot=(0.0, 0.0, 0.0))
        obstacle.move(**dict(zip("xyz", b, strict=True)), angle=vector)
        pair = fm.ContactPair(scene.data, "block/top", obstacle, law=law_of(mu))
        scene.set_up([pair], newton=fm.NewtonOptions(residual_tolerance=1e-10))
        iterations = []
        for way in np.array([(0.0, 0.0, -0.01), (0.05, 0.02, -0.02)]):
            obstacle.place[:3] = R @ way + b
            iterations.append(scene.problem.solve().num_iterations)
        found.append((R.T @ obstacle.reaction[:3], iterations))
    (one, count), (other, same) = found
    assert np.allclose(one, other, rtol=0, atol=1e-9 * np.abs(one).max())
    assert np.abs(np.subtract(count, same)).max() <= 1


@dataclass
class Solid:
    """Any solid, as of ``space_scenes``."""

    data: Any
    u: Any
    residual: Any
    bcs: list = field(default_factory=list)
    problem: Any = None

    def set_up(self, pairs, **options):
        """Set up the problem."""
        self.problem = fm.ContactProblem(
            self.residual, self.u, pairs, bcs=self.bcs, petsc_options_prefix="test_", **options
        )
        return self


def solid_at(x, energy=energies.neo_hookean, order=1):
    """A solid of hexahedra with nodes at ``x``."""
    data = mapped_boxes.mesh([Box("block", x)], order=order)
    u = fem.Function(fm.vector_space(data.mesh, order))
    measure = u if energy is energies.neo_hookean else energies.strain(u)
    psi = energy(measure, *energies.lame(1.0, 0.3)) * ufl.dx(degree=2 * order + 2)
    return Solid(data, u, ufl.derivative(psi, u))


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_symmetry_planes(mu):
    """A quarter with two of them has a quarter of the force of the whole."""
    found = []
    for low, n in ((-1.0, 6), (0.0, 3)):
        x = mapped_boxes.block((n, n, 2), size=(1.0 - low,) * 2 + (1.0,), corner=(low, low, 0.0))
        scene = solid_at(x)
        held(scene)
        if low == 0.0:
            V = scene.u.function_space
            scene.bcs += [fm.dirichlet(V, scene.data, "block/left", 0.0, 0)]
            scene.bcs += [fm.dirichlet(V, scene.data, "block/front", 0.0, 1)]
        obstacle = fm.Sphere((0.0, 0.0, 3.0), 2.0)
        pair = fm.ContactPair(scene.data, "block/top", obstacle, law=law_of(mu))
        scene.set_up([pair], newton=TIGHT)
        for z in (-0.05, -0.15):
            obstacle.move(z=z)
            certificate = scene.problem.solve().certificate
        found.append((obstacle.reaction[2], certificate.pairs[0]["obstacle_angle"].value))
    (whole, angle), (part, angle_of_part) = found
    assert whole == pytest.approx(4.0 * part, rel=1e-9)
    assert angle_of_part == pytest.approx(angle, rel=1e-6)


def quarter(n=10, length=10.0, stretch=4.0):
    """A quarter of a linear block, with facets that grow from the middle of its top at 0."""

    def at(s):
        return length * np.sinh(stretch * s) / np.sinh(stretch)

    x = mapped((n, n, n), lambda s, t, r: (at(s), at(t), -at(1.0 - r)))
    scene = solid_at(x, energies.linear_elastic)
    held(scene)
    V = scene.u.function_space
    scene.bcs += [fm.dirichlet(V, scene.data, "block/left", 0.0, 0)]
    scene.bcs += [fm.dirichlet(V, scene.data, "block/front", 0.0, 1)]
    return scene


STIFFNESS = 1.0 / (1.0 - 0.3**2)


@pytest.mark.once
@pytest.mark.parametrize(
    "make, depth, force, power, error",
    [
        (
            lambda: fm.Sphere((0.0, 0.0, 10.0), 10.0), 0.1,
            4.0 / 3.0 * STIFFNESS * np.sqrt(10.0) * 0.1**1.5, 1.5, 0.04,
        ),
        (
            lambda: fm.Cone((0.0, 0.0, 0.0), (0, 0, 1), np.radians(80.0), rounding=0.05), 0.2,
            2.0 / np.pi * STIFFNESS * 0.2**2 * np.tan(np.radians(80.0)), 2.0, 0.06,
        ),
    ],
    ids=["Hertz", "cone"],
)  # fmt: skip
def test_half_space(make, depth, force, power, error):
    """Forces of a sphere and a cone pressed into a half space.

    The motion of a point load at the depth of the block is added to that of its fixed bottom.
    """
    obstacle = make()
    scene = quarter()
    scene.set_up([fm.ContactPair(scene.data, "block/top", obstacle)])
    obstacle.move(z=-depth)
    scene.problem.solve()
    found = 4.0 * obstacle.reaction[2]
    below = found * 1.3 * (3.0 - 2.0 * 0.3) / (2.0 * np.pi * 10.0)
    assert found == pytest.approx(force * (1.0 + below / depth) ** power, rel=error)


def test_obstacles_of_the_plane_are_refused():
    scene = solid()
    with refused(ValueError, r"'circle' has 2 coordinates, the mesh 3: .* Sphere"):
        fm.ContactPair(scene.data, "block/top", fm.Circle((0.0, 0.0), 1.0))


def test_facets_beyond_the_edge_of_a_punch_are_told():
    """The force of a flat punch is three times too large then; not so with other weights."""
    forces = []
    for weights in ("cover", "standard"):
        scene = quarter(8)
        profile = [(-1.0, 0.0), (1.0, 0.0), (1.0, 2.0), (-1.0, 2.0)]
        obstacle = fm.Revolved(fm.Polygon(profile, 0.02))
        choice = fm.Discretization(gap_weights=weights)
        scene.set_up([fm.ContactPair(scene.data, "block/top", obstacle, discretization=choice)])
        obstacle.move(z=-0.01)
        report = scene.problem.solve()
        told = "loaded nodes are 0" in str(report)
        assert told == (weights == "cover")
        forces.append(4.0 * obstacle.reaction[2])
    exact = 2.0 * STIFFNESS * 0.01
    assert forces[0] > 1.5 * exact and forces[1] == pytest.approx(exact, rel=0.3)
