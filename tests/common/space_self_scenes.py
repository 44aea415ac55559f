# SPDX-License-Identifier: MIT
"""Bodies in space that touch themselves or each other, with and without chosen sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from self_scenes import strip_ends, strip_shape

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes import mapped_boxes
from meshes.mapped_boxes import SIDES, Box, block, mapped

YOUNG = 100.0
UPRIGHT = np.eye(3)


@dataclass
class Closed:
    """A problem loaded by prescribed motions of parts of the bodies.

    Attributes:
        moved: Prescribed displacement of each part, by its name.
    """

    data: fm.MeshData
    u: Any
    problem: Any
    moved: dict[str, Any]

    @property
    def contact(self):
        return self.problem.equations.contacts[0]

    def move(self, steps, **motions):
        """Move parts proportionally to new positions; return the path's report."""
        start = {name: self.moved[name].value.copy() for name in motions}

        def load(time):
            for name, motion in motions.items():
                self.moved[name].value[:] = start[name] + time * (np.array(motion) - start[name])

        options = fm.SteppingOptions(step=1.0 / steps, smallest=1e-2 / steps)
        return fm.follow_path(self.problem, load, options=options)

    def pressures(self):
        """Pressures at the active nodes."""
        return self.contact.now.z_n[self.contact.active]

    def imbalance(self):
        """Resultant of the contact forces on both sides over the sum of their sizes."""
        total, size = np.zeros(3), 0.0
        for force in self.contact.operators.force(self.contact.z):
            total, size = total + force.sum(axis=0), size + np.abs(force).sum()
        return np.abs(total).max() / size


def closed(data, parts, pairs, *, nu=0.0, order=1, across=None, energy=energies.neo_hookean,
           **options):  # fmt: skip
    """A problem with the prescribed ``parts``, functions of x (3, n) that mark nodes.

    ``across``: function that marks nodes which keep their z.
    """
    V = fm.vector_space(data.mesh, order)
    u, moved, bcs = fem.Function(V, name="u"), {}, []
    for name, where in parts.items():
        moved[name] = fem.Constant(data.mesh, (0.0, 0.0, 0.0))
        bcs.append(fem.dirichletbc(moved[name], fem.locate_dofs_geometrical(V, where), V))
    if across is not None:
        W, _ = V.sub(2).collapse()
        dofs = fem.locate_dofs_geometrical((V.sub(2), W), across)
        bcs.append(fem.dirichletbc(fem.Function(W), dofs, V.sub(2)))
    psi = energy(u, *energies.lame(YOUNG, nu)) * ufl.dx(degree=2 * order + 1)
    problem = fm.ContactProblem(
        ufl.derivative(psi, u), u, pairs(data), bcs=bcs, petsc_options_prefix="self_", **options
    )
    return Closed(data, u, problem, moved)


def one_body(boxes, cell, tolerance=1e-9):
    """Mesh of boxes whose nodes at equal places are one node; sides "inner" are left out."""
    found = mapped_boxes.arrays(boxes, cell=cell)
    _, first, number = np.unique(
        np.round(found["points"] / tolerance), axis=0, return_index=True, return_inverse=True
    )
    number = number.ravel()
    found["points"], found["cells"] = found["points"][first], number[found["cells"]]
    found["boundaries"] = {
        name: number[facets] for name, facets in found["boundaries"].items() if name != "inner"
    }
    found["bodies"] = {"body": np.arange(len(found["cells"]))}
    return fm.mesh_from_arrays(**found)


def clamp(pairs, *, count=5, gap=0.1, jiggle=0.15, narrower=1, turn=UPRIGHT,
          cell="hexahedron", **options):  # fmt: skip
    """Two blocks between the jaws of a clamp, one body; the slot between them is open by ``gap``.

    All nodes of the lower jaw are fixed, those of the upper one are moved. Blocks of equal width
    are pressed uniformly with Poisson's ratio 0. Facets in the slot are squares, of the upper block
    rectangles of different widths; it is narrower by so many cells on each side.
    """
    n, m, edge = count, count - 2 * narrower, narrower / count
    inner = 1.0 - 2.0 * edge
    lower = block((n, n, 2), size=(1.0, 1.0, 1.0))
    upper = block((m, m, 2), size=(inner, inner, 1.0), corner=(edge, edge, 1.0 + gap))
    shifts = jiggle / n * np.random.default_rng(1).uniform(-1.0, 1.0, (2, m + 1))
    shifts[:, [0, -1]] = 0.0
    upper[:, :, :2, :2] += np.stack(np.meshgrid(*shifts, indexing="ij"), axis=2)[:, :, None]
    boxes = [
        Box("lower", lower, joined=_inner(top="slot/below")),
        Box("upper", upper, joined=_inner(bottom="slot/above")),
        Box("spine", block((1, n, 3), size=(0.5, 1.0, 2.0 + gap), corner=(-1.0, 0.0, 0.0)),
            joined=_inner()),
    ]  # fmt: skip
    for z in (-0.25, 2.0 + gap):
        for x, width, cells in ((-1.0, 0.5, 1), (-0.5, 0.5, 1), (0.0, 1.0, n)):
            jaw = block((cells, n, 1), size=(width, 1.0, 0.25), corner=(x, 0.0, z))
            boxes.append(Box("jaw", jaw, joined=_inner()))
    data = one_body([Box(box.name, box.x @ turn.T, joined=box.joined) for box in boxes], cell)
    held = {
        "low": lambda x: turn[:, 2] @ x < 1e-9,
        "high": lambda x: turn[:, 2] @ x > 2.0 + gap - 1e-9,
    }
    return closed(data, held, pairs, **options)


def _inner(**names):
    """Names of the sides of a box: those that are not ``names`` are no boundaries."""
    return {side: names.get(side, "inner") for side in SIDES}


def cracked(pairs, *, count=2, **options):
    """A block with a crack from its middle to its right side, whose faces share the front."""
    boxes = []
    for name, z, side in (("below", 0.0, "top"), ("above", 1.0, "bottom")):
        for x, joined in ((-1.0, _inner()), (0.0, _inner(**{side: f"slot/{name}"}))):
            shape = block((count, count, count), corner=(x, 0.0, z))
            if z > 0.0 and x == 0.0:
                shape[1:, :, 0, 2] += 1e-6  # nodes of its own
            boxes.append(Box(name, shape, joined=joined))
    held = {"low": lambda x: x[2] < 1e-9, "high": lambda x: x[2] > 2.0 - 1e-9}
    return closed(one_body(boxes, "hexahedron"), held, pairs, **options)


def stack(pairs, *, counts=(2, 3, 4), gap=0.05, jiggle=0.15, **options):
    """Three blocks above each other; ``pairs`` has the mesh and the names of the four sides."""
    names = {("b0", "top"), ("b1", "bottom"), ("b1", "top"), ("b2", "bottom")}
    boxes = [
        Box(f"b{i}", block((n, n, 2), size=(1.0, 1.0, 0.5), corner=(0.0, 0.0, i * (0.5 + gap)),
                           jiggle=jiggle, seed=i))
        for i, n in enumerate(counts)
    ]  # fmt: skip
    sides = sorted(f"{name}/{side}" for name, side in names)
    data = mapped_boxes.mesh(boxes)
    top = 1.5 + 2 * gap
    held = {"low": lambda x: x[2] < 1e-9, "high": lambda x: x[2] > top - 1e-9}
    return closed(data, held, lambda data: pairs(data, sides), **options)


def tube(pairs, *, columns=32, layers=2, length=0.5, start=0.0, **options):
    """A tube along z whose first column of nodes is at the angle ``start`` [columns]."""

    def position(s, t, r):
        radius, angle = 0.85 + 0.15 * r, 2 * np.pi * (start / columns - s)
        return radius * np.cos(angle), radius * np.sin(angle), length * t

    names = {"bottom": "tube/inside", "top": "tube/outside"}
    shape = mapped((columns, layers, 2), position)
    data = mapped_boxes.mesh([Box("tube", shape, joined=names, closed=True)])
    return closed(data, {}, pairs, nu=0.3, **options)


def flattened_tube(law=None, *, steps=20, depth=0.86, **options):
    """A tube pressed flat between two planes until its inside touches itself, and the path."""
    planes = [fm.Extruded(fm.Plane((0.0, y), (0.0, -y))) for y in (1.0, -1.0)]

    def pairs(data):
        outside = [fm.ContactPair(data, "tube/outside", plane, law=law) for plane in planes]
        return [fm.ContactPair(data, "tube/inside", law=law), *outside]

    made = tube(pairs, **options)

    def load(time):
        for plane, shift in zip(planes, (-depth, depth)):
            plane.move(y=shift * time)

    stepping = fm.SteppingOptions(step=1.0 / steps, smallest=0.01 / steps)
    return made, fm.follow_path(made.problem, load, stepping)


def extruded_strip(pairs, *, layers=1, flat=True, sides=("bottom", "top"), **options):
    """The strip of ``self_scenes`` extruded along z; with ``flat`` no node leaves its plane.

    ``sides``: those that are the boundary "strip/outline".
    """
    section = strip_shape()
    z = np.linspace(0.0, 0.1 * layers, layers + 1)
    shape = np.empty((len(section), layers + 1, section.shape[1], 3))
    shape[..., :2], shape[..., 2] = section[:, None], z[:, None]
    joined = dict.fromkeys(sides, "strip/outline")
    data = mapped_boxes.mesh([Box("strip", shape, joined=joined)])
    across = (lambda x: np.full(x.shape[1], True)) if flat else None
    return closed(data, strip_ends(section), pairs, nu=0.3, across=across, **options)
