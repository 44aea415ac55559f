# SPDX-License-Identifier: MIT
"""Scenes with idle bodies: floating, without load, and touched by bodies with load."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scenes import linear_elastic, read
from supported_parts import Body, Flat, Touch
from supported_problem import Assembly, floor_of, pose

import ufl
from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, mapped, sector


def row(
    mu: float = 0.0,
    base: str = "plane",
    *,
    idle: int = 1,
    gap: float = 0.0,
    hover: float = 0.0,
    slave: str = "loaded",
    loads: tuple[float, ...] = (1.0, 5.0),
    width: float = 0.7,
    height: float = 0.6,
    on_ground: bool = True,
    E: float = 1e3,
    length: float = 1.0,
    stress: float = 1.0,
    **options: Any,
) -> Assembly:
    """A block under its weight, and idle blocks beside it in a row, on the ground.

    Args:
        mu: Coefficient of friction of all pairs.
        base: "plane" or "body".
        idle: Number of idle blocks.
        gap: Between the blocks [length].
        hover: Height of the idle blocks above the ground [length].
        slave: The slave of the pair of the block with load: "loaded" or "idle".
        loads: Weights of the steps.
        width: Of an idle block [length].
        height: Of an idle block [length].
        on_ground: Whether idle blocks have a pair with the ground.
        E: Young's modulus.
        length: Unit of length.
        stress: Unit of stress.
        options: See ``pose``.
    """
    law = fm.Coulomb(mu) if mu else None
    loaded = Grid("loaded", length * block(4, 3, width=1.0, height=0.8))
    bodies = [Body(loaded, weight=stress * length)]
    columns, wide = 11, 2.0 + idle * width
    under, floor = floor_of(base, width=length * wide, columns=columns, left=-0.5 * length)
    touches, before, x = [Touch("loaded/bottom", floor, law)], "loaded/right", 1.0 + gap
    for k in range(idle):
        grid = block(3 + k % 2, 4, width=width, height=height, corner=(x, hover))
        bodies.append(Body(Grid(f"idle{k}", length * grid)))
        sides = before, f"idle{k}/left"
        touches.append(Touch(*(sides if slave == "loaded" else sides[::-1]), law))
        touches += [Touch(f"idle{k}/bottom", floor, law)] * on_ground
        before, x = f"idle{k}/right", x + width + gap
    path = [{"weight": load} for load in loads]
    return pose("row", [*bodies, *under], touches, path, E=stress * E, **options)


def without_pair(
    idle: int = 1, *, hover: float = 0.0, weight: float = 1.0, E: float = 1e3, **options: Any
) -> Assembly:
    """A block under its weight on an elastic ground, and blocks in no pair on or above it."""
    bodies = [Body(Grid("loaded", block(4, 3, width=1.0, height=0.8)), weight=1.0)]
    for k in range(idle):
        grid = block(3, 3 + k, width=0.6, height=0.5, corner=(1.4 + 0.9 * k, hover))
        bodies.append(Body(Grid(f"idle{k}", grid)))
    under, floor = floor_of("body", width=2.0 + 0.9 * idle, columns=12, left=-0.5)
    touches = [Touch("loaded/bottom", floor, fm.Coulomb(0.3))]
    path = [{"weight": weight}]
    return pose("without pair", [*bodies, *under], touches, path, E=E, **options)


def squeezed(mu: float, *, E: float = 1e3) -> Assembly:
    """A block between two planes, "left" and "right", which are moved."""
    law = fm.Coulomb(mu) if mu else None
    left, right = Flat((0.0, 0.0), (1.0, 0.0), "left"), Flat((1.0, 0.0), (-1.0, 0.0), "right")
    bodies = [Body(Grid("block", block(4, 3, width=1.0, height=0.6)))]
    touches = [Touch("block/left", left, law), Touch("block/right", right, law)]
    return pose("squeezed", bodies, touches, [{}], E=E)


def wedge(slope: float = 0.3, *, E: float = 1e3) -> Assembly:
    """A wedge that widens upwards between two planes without friction, "left" and "right"."""

    def position(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (2.0 * s - 1.0) * (0.4 + slope * t), t

    left = Flat((-0.4, 0.0), (1.0, slope), "left")
    right = Flat((0.4, 0.0), (-1.0, slope), "right")
    touches = [Touch("wedge/left", left), Touch("wedge/right", right)]
    return pose("wedge", [Body(Grid("wedge", mapped(3, 4, position)))], touches, [{}], E=E)


def queue(push: float, *, gap: float = 0.02, mu: float = 0.0, E: float = 1e3) -> Assembly:
    """Three blocks on a level plane before a wall, with gaps; the first one is pushed."""
    law = fm.Coulomb(mu) if mu else None
    wall = Flat((3.0 + 3.0 * gap, 0.0), (-1.0, 0.0), "wall")
    floor = Flat((0.0, 0.0), (0.0, 1.0), "floor")
    bodies = [
        Body(
            Grid(f"block{k}", block(3, 3 + k % 2, width=1.0, height=0.5, corner=(k + k * gap, 0))),
            push=float(k == 0),
        )
        for k in range(3)
    ]
    touches = [Touch(f"block{k}/right", f"block{k + 1}/left", law) for k in (0, 1)]
    touches += [Touch("block2/right", wall, law)]
    touches += [Touch(f"block{k}/bottom", floor, law) for k in range(3)]
    return pose("queue", bodies, touches, [{"push": push}], E=E)


def particle(
    order: int = 1,
    mu: float = 0.3,
    *,
    finite: bool = False,
    centre: tuple[float, float] = (0.003, 0.002),
    clearance: float = 0.005,
    E: float = 1e3,
    nu: float = 0.3,
) -> tuple[fm.ContactProblem, fem.Constant]:
    """A round particle in a hole of radius one; its thermal strain is the constant."""
    radii = (0.3, 1.0 - clearance)
    grids = [
        Grid("particle", sector(24 * order, 2 * order, radii=radii, centre=centre), closed=True),
        Grid("plate", sector(32 * order, 2 * order, radii=(1.0, 3.0)), closed=True),
    ]
    data = read(mapped_grids.build, comm=MPI.COMM_WORLD, grids=grids, order=order)
    V = fm.vector_space(data.mesh, order)
    u, v = fem.Function(V), ufl.TestFunction(V)
    options = {"subdomain_data": data.cell_tags, "metadata": {"quadrature_degree": 4}}
    dx = ufl.Measure("dx", domain=data.mesh, **options)
    strain = fem.Constant(data.mesh, PETSc.ScalarType(0.0))

    def energy(T: Any) -> Any:
        if not finite:
            e = fm.energies.strain(u) - T * ufl.Identity(2)
            return fm.energies.linear_elastic(e, *fm.energies.lame(E, nu))
        elastic = fm.energies.deformation_gradient(u) / (1.0 + T)
        return (1.0 + T) ** 2 * fm.energies.neo_hookean(elastic, *fm.energies.lame(E, nu))

    bodies = (("particle", strain), ("plate", 0.0))
    residual = sum(ufl.derivative(energy(T) * dx(data.body_tag(name)), u, v) for name, T in bodies)
    law = fm.Coulomb(mu) if mu else None
    pair = fm.ContactPair(data, "particle/bottom", "plate/top", law=law)
    bcs = [fm.dirichlet(V, data, "plate/bottom", (0.0, 0.0))]
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="particle_")
    return problem, strain


def disk_on_block(
    E: float = 1e5, mu: float = 0.3, *, centre: float = 0.0, columns: int = 8, around: int = 24
) -> tuple[fm.ContactProblem, fem.Constant]:
    """A disk of radius 0.5 under its weight, the constant, on a block; P2, linear elastic."""
    grids = [
        Grid(
            "disk",
            sector(2 * around, 4, radii=(0.1, 0.5), angles=TURN, centre=(centre, 0.5)),
            closed=True,
        ),
        Grid("block", block(2 * columns, 4, width=2.0, height=0.5, corner=(-1.0, -0.5))),
    ]
    data = read(mapped_grids.build, comm=MPI.COMM_WORLD, grids=grids, order=2)
    V = fm.vector_space(data.mesh, 2)
    u, v = fem.Function(V), ufl.TestFunction(V)
    options = {"subdomain_data": data.cell_tags, "metadata": {"quadrature_degree": 4}}
    dx = ufl.Measure("dx", domain=data.mesh, **options)
    weight = fem.Constant(data.mesh, PETSc.ScalarType(0.0))
    density = ufl.inner(linear_elastic(u, E, 0.3), ufl.grad(v))
    residual = sum(density * dx(tag) for tag in data.bodies.values())
    residual += weight / (0.24 * np.pi) * v[1] * dx(data.body_tag("disk"))
    pair = fm.ContactPair(data, "disk/bottom", "block/top", law=fm.Coulomb(mu))
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="disk_")
    return problem, weight


# Angles of a closed circle whose nodes are not below its centre [radian].
TURN = (0.03, 0.03 + 2.0 * np.pi)
