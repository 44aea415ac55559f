# SPDX-License-Identifier: MIT
"""Bodies in space without supports, under dead loads, for tests of rigid motions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes import mapped_boxes
from meshes.mapped_boxes import SIDES, Box, block, mapped

YOUNG, POISSON, MU = 1e3, 0.3, 0.4
DOWN = np.array([0.0, 0.0, -1.0])
GROUND = Box("ground", block((4, 4, 2), size=(1.5, 1.5, 0.5), corner=(-0.75, -0.75, -0.5)))
FLOOR = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@dataclass
class Scene:
    """Bodies with dead loads per volume; ``load`` is that of all bodies in ``loaded``."""

    data: fm.MeshData
    u: Any
    residual: Any
    load: Any
    bcs: list[Any]
    problem: Any = None

    def hold(self, side):
        """Fix a side."""
        self.bcs.append(fm.dirichlet(self.u.function_space, self.data, side, (0.0, 0.0, 0.0)))
        return self

    def touch(self, *pairs, mu=MU, **options):
        """Set up the problem with pairs of sides or of a side and an obstacle."""
        law = fm.Coulomb(mu) if mu else None
        made = [fm.ContactPair(self.data, *sides, law=law) for sides in pairs]
        self.problem = fm.ContactProblem(
            self.residual, self.u, made,
            **{"bcs": self.bcs, "petsc_options_prefix": "space_floating_", **options},
        )  # fmt: skip
        return self

    def rests(self):
        """Solve; the state has no violations."""
        report = self.problem.solve()
        assert report.certificate.violations() == []
        return report

    def reaction(self, side):
        """Force and moment on a fixed side about the origin."""
        force, moment, _ = self.problem.reaction(side, (0.0, 0.0, 0.0), data=self.data)
        return force, moment

    def on_obstacle(self):
        """Force on the obstacle of the first pair."""
        return self.problem.equations.contacts[0].obstacle.reaction[:3]

    def place(self):
        """Turn and shift of the first floating body: its best rigid fit."""
        e = self.problem.equations
        body = e.floating.bodies[0]
        mine = e.floating.labels[: e.bulk.space.num_nodes] == body.label
        X = e.bulk.cells.X[: mine.size][mine]
        x = e.bulk.positions()[: mine.size][mine]
        sums = e.comm.allreduce(np.vstack([x.sum(axis=0), (X - body.centre).T @ x]))
        shift = sums[0] / body.num_nodes - body.centre
        left, _, right = np.linalg.svd(sums[1:].T)
        turn = left @ right
        return turn, shift


def scene(*boxes, loaded=("block",), load=DOWN, cell="hexahedron", order=1, young=YOUNG):
    """Bodies of boxes, without conditions."""
    data = mapped_boxes.mesh(boxes, cell=cell, order=order)
    u = fem.Function(fm.vector_space(data.mesh, order))
    dx = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags)
    psi = energies.neo_hookean(u, *energies.lame(young, POISSON)) * dx(degree=4)
    force = fem.Constant(data.mesh, np.array(load, float))
    v = ufl.TestFunction(u.function_space)
    work = sum(ufl.inner(force, v) * dx(data.bodies[name]) for name in loaded)
    return Scene(data, u, ufl.derivative(psi, u) - work, force, [])


def free_block(size=(1.0, 1.0, 0.6), corner=(-0.5, -0.5, 0.0), turn=None, order=1, **options):
    """A block, turned about the origin by a matrix."""
    x = block((3, 3, 2), size=size, corner=corner, order=order, **options)
    return Box("block", x if turn is None else x @ turn.T)


def on_floor(load, mu=MU, turn=None, **options):
    """A block on a rigid plane, with the load given before the turn."""
    R = np.eye(3) if turn is None else turn
    made = scene(free_block(turn=turn, **options), load=R @ np.array(load, float))
    return made.touch(("block/bottom", fm.Plane(FLOOR[0], R @ FLOOR[1])), mu=mu)


def overhanging(part, sides):
    """A block on a ground that ends at x = 1, of which this part is beyond."""
    upper = block((5, 5, 2), size=(1.0, 1.0, 0.3), corner=(part, 0.1, 0.0))
    ground = block((3, 4, 2), size=(1.0, 1.2, 0.5), corner=(0.0, 0.0, -0.5))
    made = scene(Box("block", upper), Box("ground", ground), young=1e4).hold("ground/bottom")
    return made.touch(sides)


def wall_of_blocks():
    """A block in the middle on two, which carry two more: walls of stiff blocks on a plane."""
    boxes = []
    for level, row in enumerate(
        ([(0.0, 0.98), (1.0, 1.0)], [(0.0, 2.0)], [(0.0, 0.98), (1.0, 1.0)])
    ):
        for i, (x, length) in enumerate(row):
            cells = 6 if length == 2.0 else 3, 2, 2
            corner = x, 0.0, 0.4 * level
            boxes.append(Box(f"{level}{i}", block(cells, size=(length, 0.6, 0.4), corner=corner)))
    made = scene(*boxes, loaded=[box.name for box in boxes], young=1e5)
    floor = fm.Plane(*FLOOR)
    pairs = [(f"0{i}/bottom", floor) for i in range(2)]
    pairs += [(f"0{i}/top", "10/bottom") for i in range(2)]
    return made.touch(*pairs, *[(f"2{i}/bottom", "10/top") for i in range(2)], mu=0.5)


def arch_of_stones(count=5):
    """Wedges of an arch between two that are held at their outer ends."""

    def stone(number):
        def position(s, t, r):
            angle, radius = np.pi * (0.9 - 0.8 * (number + s) / count), 2.0 + 0.7 * r
            return [radius * np.cos(angle), 0.6 * t, radius * np.sin(angle)]

        return Box(f"s{number}", mapped((2, 2, 2), position))

    boxes = [stone(number) for number in range(count)]
    made = scene(*boxes, loaded=[box.name for box in boxes], young=1e5)
    made.hold("s0/left").hold(f"s{count - 1}/right")
    return made.touch(*[(f"s{i}/right", f"s{i + 1}/left") for i in range(count - 1)], mu=0.7)


def ball_in_a_bowl(x, y, z, mu):
    """A ball of cells over a bowl of elastic cells, which is a paraboloid."""

    def ball(*parameters):
        X = np.stack([2.0 * p - 1.0 for p in parameters])
        far, norm = np.abs(X).max(axis=0), np.linalg.norm(X, axis=0)
        to_sphere = np.where(norm > 0.0, far / np.where(norm > 0.0, norm, 1.0), 0.0)
        X = 0.5 * X * ((1.0 - far**2) * 0.6 + far**2 * to_sphere)
        return [a + b for a, b in zip(X, (x, y, z), strict=True)]

    def bowl(s, t, r):
        a, b = 1.6 * s - 0.8, 1.6 * t - 0.8
        return [a, b, 0.3 * (a**2 + b**2) - 0.5 - 0.4 * (1.0 - r)]

    joined = {side: "block/surface" for side in SIDES}
    boxes = Box("block", mapped((4, 4, 4), ball), joined), Box("bowl", mapped((6, 6, 2), bowl))
    made = scene(*boxes).hold("bowl/bottom")
    return made.touch(("block/surface", "bowl/top"), mu=mu)


def wall_of_two_leaves():
    """Two courses of stiff blocks in two leaves, whose upper blocks bridge the joints below."""
    boxes, floor, pairs = [], fm.Plane(*FLOOR), []
    for leaf in range(2):
        for i in range(2):
            corner = 1.02 * i, 0.5 * leaf, 0.0
            boxes.append(Box(f"{leaf}a{i}", block((3, 2, 1), size=(1.0, 0.49, 0.4), corner=corner)))
            pairs += [(f"{leaf}a{i}/bottom", floor), (f"{leaf}a{i}/top", f"{leaf}b/bottom")]
        corner = 0.5, 0.5 * leaf, 0.4
        boxes.append(Box(f"{leaf}b", block((4, 2, 1), size=(1.0, 0.49, 0.4), corner=corner)))
    made = scene(*boxes, loaded=[box.name for box in boxes], load=(0.1, 0.15, -1.0), young=1e5)
    return made.touch(*pairs, mu=0.5)


def chain_of_links(mu):
    """Two elastic rings that hang on each other below a rigid one."""

    def link(name, centre, axis):
        def position(s, t, r):
            u, v = 2.0 * t - 1.0, 2.0 * r - 1.0
            far, norm = np.maximum(np.abs(u), np.abs(v)), np.hypot(u, v)
            to_circle = np.where(norm > 0.0, far / np.where(norm > 0.0, norm, 1.0), 0.0)
            factor = 0.1 * (0.7 * (1.0 - far**2) + far**2 * to_circle)
            along, across, angle = factor * v, factor * u, 2.0 * np.pi * s
            x, z = (0.3 + along) * np.cos(angle), (0.3 + along) * np.sin(angle) + centre
            return [across, x, z] if axis == 0 else [x, across, z]

        return Box(
            name, mapped((16, 3, 3), position), {s: f"{name}/skin" for s in SIDES}, closed=True
        )

    boxes = link("upper", -0.4, 0), link("lower", -0.8, 1)
    made = scene(*boxes, loaded=["upper", "lower"], load=0.01 * DOWN, young=100.0)
    ring = fm.Torus((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.3, 0.1)
    return made.touch(("upper/skin", ring), ("lower/skin", "upper/skin"), mu=mu)


def table_on_an_incline(angle, mu, height=0.5):
    """A slab on four feet, on a plane that falls along x."""
    x = block((7, 7, 2), size=(1.4, 1.0, 1.0), corner=(-0.7, -0.5, 0.0))
    foot = np.isin(np.arange(8), (0, 1, 6, 7))
    lift = np.where(np.logical_and.outer(foot, foot), 0.0, height)[..., None]
    x[..., 2] = lift + (height + 0.2 - lift) * np.linspace(0.0, 1.0, 3)
    c, s = np.cos(angle), np.sin(angle)
    down = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    made = scene(Box("block", x @ down.T), load=1e-4 * DOWN, young=10.0)
    return made.touch(("block/bottom", fm.Plane(FLOOR[0], down @ FLOOR[1])), mu=mu)
