# SPDX-License-Identifier: MIT
"""Two bodies in space in contact, or about to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from crossing_scenes import move_body

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block, mapped


@dataclass
class TwoBodies:
    """Bodies with prescribed motions of some of their sides.

    Attributes:
        motions: Prescribed displacement of each side, by its name.
    """

    data: fm.MeshData
    u: Any
    pairs: list[Any]
    problem: Any
    motions: dict[str, Any]

    def move(self, side, value):
        """Set the prescribed displacement of a side; return the scene."""
        self.motions[side].value[:] = value
        return self

    def solve(self, **options):
        return self.problem.solve(**options)

    @property
    def crossings(self):
        return self.problem.equations.crossings


def bodies(
    boxes,
    held,
    pairs,
    *,
    cell="hexahedron",
    order=1,
    law=None,
    radius=None,
    comm=MPI.COMM_WORLD,
    turned=(),
    energy=energies.neo_hookean,
    poisson=0.3,
    basis="dual",
    max_angle=70.0,
    **options,
):
    """Problem of ``boxes`` with the sides ``held`` prescribed and ``pairs`` (slave, master).

    The motions of the sides ``turned`` are functions.
    """
    data = mapped_boxes.mesh(boxes, cell=cell, order=order, comm=comm)
    V = fm.vector_space(data.mesh, order)
    u = fem.Function(V, name="u")
    psi = energy(u, *energies.lame(100.0, poisson)) * ufl.dx(degree=2 * order + 1)
    motions = {side: fem.Constant(data.mesh, (0.0, 0.0, 0.0)) for side in held}
    motions |= {side: fem.Function(V) for side in turned}
    bcs = [fm.dirichlet(V, data, side, value) for side, value in motions.items()]
    given = {"discretization": fm.Discretization(basis=basis, max_angle=max_angle)}
    if law is not None:
        given["law"] = law
    if radius is not None:
        given["search_radius"] = radius
    contacts = [fm.ContactPair(data, slave=s, master=m, **given) for s, m in pairs]
    problem = fm.ContactProblem(
        ufl.derivative(psi, u), u, contacts, bcs=bcs, petsc_options_prefix="pair_", **options
    )
    return TwoBodies(data, u, contacts, problem, motions)


def two_blocks(gap=0.0, counts=((2, 2, 1), (3, 3, 1)), shift=(0.2, 0.2), pairs=None, **options):
    """A block above a larger one."""
    upper = Box(
        "upper",
        block(counts[0], size=(1.0, 1.0, 0.5), corner=(*shift, 1.0 + gap), **_order(options)),
    )
    lower = Box("lower", block(counts[1], size=(1.4, 1.4, 1.0), **_order(options)))
    held = ["upper/top", "lower/bottom"]
    return bodies([upper, lower], held, pairs or [("upper/bottom", "lower/top")], **options)


def cap_on_block(count=4, radius=2.0, gap=0.0, coarse=None, **options):
    """A block with a spherical bottom above a block."""

    def position(s, t, r):
        x, y = s - 0.5, t - 0.5
        sagitta = radius - np.sqrt(radius**2 - x**2 - y**2)
        return x, y, 1.0 + gap + sagitta * (1.0 - r) + 0.8 * r

    upper = Box("upper", mapped((count, count, 2), position, **_order(options)))
    lower = Box(
        "lower",
        block(
            (coarse or count + 1, coarse or count + 1, 2),
            size=(1.4, 1.4, 1.0),
            corner=(-0.7, -0.7, 0.0),
            **_order(options),
        ),
    )
    held = ["upper/top", "lower/bottom"]
    return bodies([upper, lower], held, [("upper/bottom", "lower/top")], **options)


def cylinder_on_block(count=4, radius=2.0):
    """A block with a cylindrical bottom, the axis along y, above a wider block."""

    def position(s, t, r):
        x = s - 0.5
        sagitta = radius - np.sqrt(radius**2 - x**2)
        return x, t - 0.5, 1.0 + sagitta * (1.0 - r) + 0.8 * r

    upper = Box("upper", mapped((2 * count, count, 2), position))
    lower = block((2 * count + 1, count + 1, 2), size=(1.4, 1.4, 1.0), corner=(-0.7, -0.7, 0.0))
    held = ["upper/top", "lower/bottom"]
    return bodies([upper, Box("lower", lower)], held, [("upper/bottom", "lower/top")])


def shaft_in_groove(radius=0.5, press=0.01, **options):
    """A sector of a shaft in a groove; return also the function that presses and turns it."""

    def sector(inner, outer, angle):
        def position(s, t, r):
            a, q = angle * (s - 0.5), outer + (inner - outer) * r
            return q * np.sin(a), 0.4 * t, -q * np.cos(a)

        return position

    shaft = Box("shaft", mapped((4, 1, 1), sector(0.3, radius, 0.5)))
    groove = Box("groove", mapped((16, 1, 1), sector(radius, 0.8, 2.4)))
    pairs = [("shaft/bottom", "groove/top")]
    scene = bodies([shaft, groove], ["groove/bottom"], pairs, turned=["shaft/top"], **options)

    def turn(degrees):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        scene.motions["shaft/top"].interpolate(
            lambda X: (
                np.stack([c * X[0] - s * X[2] - X[0], 0.0 * X[1], s * X[0] + c * X[2] - X[2]])
                + press * np.stack([s + 0 * X[0], 0 * X[0], -c + 0 * X[0]])
            )
        )

    return scene, turn


def _order(options):
    return {"order": options.get("order", 1)}


def plates():
    """A thin plate above another one, whose partners are searched nearby."""
    upper = Box("plate", block((2, 2, 1), size=(1.0, 1.0, 0.1), corner=(0.2, 0.2, 1.2)))
    lower = Box("lower", block((3, 3, 1), size=(1.4, 1.4, 0.2), corner=(0.0, 0.0, 0.8)))
    held = ["plate/top", "lower/left", "lower/right"]
    return bodies([upper, lower], held, [("plate/bottom", "lower/top")], radius=0.15)


def rods(pair=("two/front", "one/back")):
    """Two crossed rods of 0.1, without nodes near the crossing, 0.1 apart."""
    one = Box("one", block((1, 1, 3), size=(0.1, 0.1, 1.0), corner=(-0.05, -0.05, -0.5)))
    two = Box("two", block((3, 1, 1), size=(1.0, 0.1, 0.1), corner=(-0.5, 0.15, -0.05)))
    held = ["one/bottom", "one/top", "two/left", "two/right"]
    return bodies([one, two], held, [pair], radius=0.2)


def arc_and_block():
    """A strip of length 6 beside a block."""
    arc = Box("arc", block((24, 1, 1), size=(6.0, 0.3, 0.2), corner=(0.0, 0.0, 2.0)))
    other = Box("other", block((1, 1, 1)))
    return bodies([arc, other], ["arc/left", "other/bottom"], [("arc/bottom", "other/top")])


def crossings_of(scene, where, new):
    """Crossings with the body at ``where`` (X -> bool) moved to ``new`` (X) directly."""
    scene.u.x.array[:] = 0.0
    move_body(scene.problem, where, new)
    scene.problem.equations.evaluate_operators()
    return scene.crossings.find()


def bent(angle):
    """Map a strip from x = 0 to 6 to an arc with an ``angle``."""
    radius = 6.0 / angle

    def new(X):
        a, r = X[:, 0] / radius, radius - X[:, 2] + 2.0
        return np.stack([r * np.sin(a), X[:, 1], 2.0 + radius - r * np.cos(a)], axis=1)

    return new
