# SPDX-License-Identifier: MIT
"""Plane and axisymmetric problems, and the bodies in space of which they are sections."""

from __future__ import annotations

import numpy as np
import revolved
from scenes import internal, linear_elastic, neo_hookean, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes import mapped_boxes, mapped_grids
from meshes.mapped_boxes import Box, mapped
from meshes.mapped_grids import Grid

YOUNG, POISSON = 100.0, 0.3
# The coordinates x, y of the plane are x, z in space, the strip is as thick along y.
FRAME = {"axis": (0.0, -1.0, 0.0), "first": (1.0, 0.0, 0.0)}
COUNTS, SIZE = (12, 5), (2.0, 0.5)


def plane_stress(u):
    """Cauchy's stress in the plane."""
    mu, lmbda = energies.lame(YOUNG, POISSON)
    lmbda = 2.0 * mu * lmbda / (lmbda + 2.0 * mu)
    e = energies.strain(u)
    return 2.0 * mu * e + lmbda * ufl.tr(e) * ufl.Identity(2)


def strain_across(u):
    """Strain out of the plane in plane stress."""
    return -POISSON / (1.0 - POISSON) * ufl.div(u)


def roller(depth):
    """A roller that is pressed into the top of the strip."""
    return fm.Circle((0.0, SIZE[1] + 1.0 - depth), 1.0)


def plane_strip(
    depth=0.02, *, stress=None, finite=False, law=None, order=1, cell="quadrilateral", **options
):
    """A strip on a rigid base, under a roller: plane strain, or the given stress of ``u``."""
    x = mapped_grids.block(*COUNTS, width=SIZE[0], height=SIZE[1], corner=(-SIZE[0] / 2, 0.0))
    data = read(lambda: mapped_grids.build([Grid("strip", x)], cell=cell))
    V = fm.vector_space(data.mesh, order)
    u = fem.Function(V)
    material = neo_hookean if finite else linear_elastic
    sigma = material(u, YOUNG, POISSON) if stress is None else stress(u)
    pair = fm.ContactPair(data, "strip/top", roller(depth), **({"law": law} if law else {}))
    return fm.ContactProblem(
        internal(u, sigma), u, [pair], bcs=[fm.dirichlet(V, data, "strip/bottom", (0.0, 0.0))],
        petsc_options_prefix="strip_", **options,
    )  # fmt: skip


def strip_in_space(
    thickness, depth=0.02, *, layers=3, finite=False, law=None, held=False, order=1,
    cell="hexahedron", shift=0.0,
):  # fmt: skip
    """Half of a strip of a ``thickness``, from its middle y = 0; its face is free, or ``held``."""
    x = mapped_boxes.block(
        (COUNTS[0], layers, COUNTS[1]), size=(SIZE[0], thickness / 2, SIZE[1]),
        corner=(-SIZE[0] / 2 + shift, 0.0, 0.0),
    )  # fmt: skip
    data = mapped_boxes.mesh([Box("strip", x)], cell=cell)
    V = fm.vector_space(data.mesh, order)
    u = fem.Function(V)
    energy = energies.neo_hookean if finite else energies.linear_elastic
    psi = energy(u, *energies.lame(YOUNG, POISSON))
    bcs = [fm.dirichlet(V, data, "strip/bottom", 0.0, i) for i in (0, 2)]
    across = ["strip/front", "strip/back"] if held else "strip/front"
    bcs.append(fm.dirichlet(V, data, across, 0.0, 1))
    bar = fm.Extruded(roller(depth), **FRAME)
    pair = fm.ContactPair(data, "strip/top", bar, **({"law": law} if law else {}))
    return fm.ContactProblem(
        ufl.derivative(psi * ufl.dx(degree=2 * order + 2), u),
        u,
        [pair],
        bcs=bcs,
        petsc_options_prefix="bar_",
    )


# Two blocks, the upper one narrower: number of cells, width and height, lower left corner.
BLOCKS = {
    "lower": ((7, 3), (1.4, 0.6), (-0.7, 0.0)),
    "upper": ((5, 3), (0.8, 0.6), (-0.4, 0.6)),
}


def plane_blocks(kind=fm.ContactPair, push=(0.0, -0.02), **options):
    """Two blocks in contact or tied; the top of the upper one is pushed."""
    grids = [
        Grid(name, mapped_grids.block(*counts, width=size[0], height=size[1], corner=corner))
        for name, (counts, size, corner) in BLOCKS.items()
    ]
    data = read(lambda: mapped_grids.build(grids))
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)),
           fm.dirichlet(V, data, "upper/top", push)]  # fmt: skip
    residual = internal(u, linear_elastic(u, YOUNG, POISSON))
    pair = kind(data, "upper/bottom", "lower/top")
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="stack_", **options)


def blocks_in_space(kind=fm.ContactPair, push=(0.0, -0.02), *, thickness=0.4, held=True):
    """The blocks, which lie beside each other in another order, with free or held faces."""
    boxes = [
        Box(name, mapped_boxes.block(
            (counts[0], 2 if name == "upper" else 3, counts[1]),
            size=(size[0], thickness, size[1]), corner=(corner[0], 0.0, corner[1]),
        ))
        for name, (counts, size, corner) in reversed(BLOCKS.items())
    ]  # fmt: skip
    data = mapped_boxes.mesh(boxes)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    psi = energies.linear_elastic(u, *energies.lame(YOUNG, POISSON))
    across = [f"{name}/{side}" for name in BLOCKS for side in ("front", "back")]
    bcs = [fm.dirichlet(V, data, across if held else across[::2], 0.0, 1)]
    for side, (x, z) in (("lower/bottom", (0.0, 0.0)), ("upper/top", push)):
        bcs += [fm.dirichlet(V, data, side, x, 0), fm.dirichlet(V, data, side, z, 2)]
    return fm.ContactProblem(
        ufl.derivative(psi * ufl.dx, u), u, [kind(data, "upper/bottom", "lower/top")], bcs=bcs,
        petsc_options_prefix="piled_",
    )  # fmt: skip


RADII, HEIGHT = (0.4, 1.0), 0.4


def ring_of_revolution(depth=0.01, *, hole=RADII[0]):
    """A ring or, without ``hole``, a disc on a rigid base under a rigid ring with a round edge."""
    x = mapped_grids.block(6, 4, width=RADII[1] - hole, height=HEIGHT, corner=(hole, 0.0))
    data = read(lambda: mapped_grids.build([Grid("ring", x)]))
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "ring/bottom", (0.0, 0.0))]
    bcs += [] if hole else [revolved.on_axis(V, data, "ring/left")]
    pair = fm.ContactPair(data, "ring/top", _tool(depth))
    return fm.ContactProblem(
        revolved.internal(u, revolved.linear_elastic(u, YOUNG, POISSON)), u, [pair], bcs=bcs,
        geometry="axisymmetric", petsc_options_prefix="ring_",
    )  # fmt: skip


def ring_in_space(depth=0.01, *, hole=RADII[0], tilt=0.0, around=20):
    """The same ring all around, or a disc of curved bricks; the rigid ring tilted by an angle."""

    def ring(s, t, r):
        angle, radius = 2.0 * np.pi * s, hole + (RADII[1] - hole) * t
        return radius * np.cos(angle), radius * np.sin(angle), HEIGHT * r

    def disc(s, t, r):
        x, y = 2.0 * s - 1.0, 2.0 * t - 1.0
        return x * np.sqrt(1.0 - y**2 / 2.0), y * np.sqrt(1.0 - x**2 / 2.0), HEIGHT * r

    counts = (around, 6, 4) if hole else (10, 10, 4)
    box = Box("ring", mapped(counts, ring if hole else disc), closed=hole > 0.0)
    data = mapped_boxes.mesh([box])
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    psi = energies.linear_elastic(u, *energies.lame(YOUNG, POISSON))
    tool = fm.Revolved(_tool(depth))
    tool.move(angle=(0.0, tilt, 0.0))
    return fm.ContactProblem(
        ufl.derivative(psi * ufl.dx(degree=3), u), u, [fm.ContactPair(data, "ring/top", tool)],
        bcs=[fm.dirichlet(V, data, "ring/bottom", (0.0, 0.0, 0.0))], petsc_options_prefix="disc_",
    )  # fmt: skip


def _tool(depth):
    """Half of the section of a torus that is pressed into the top by a depth."""
    return fm.Circle((0.7, HEIGHT + 1.0 - depth), 1.0)
