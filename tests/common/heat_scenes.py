# SPDX-License-Identifier: MIT
"""Thermoelastic bodies in contact: displacement and temperature in one mixed function."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import elastic_strain, lame, linear_elastic, stress
from fenics_mortar.utils import compat
from meshes import mapped_boxes
from meshes.mapped_boxes import Box
from meshes.mapped_grids import Grid, block, mesh


@dataclass
class Heated:
    """A thermoelastic problem.

    Attributes:
        data: The mesh.
        w: Displacement and temperature.
        residual: The form without contact; ``test`` is its test function of the temperature.
        dx: Measure.
        given: Prescribed values by name.
        bcs: Their conditions.
    """

    data: fm.MeshData
    w: Any
    residual: Any
    test: Any
    dx: Any
    T: Any
    geometry: str = "plane"
    given: dict[str, Any] = field(default_factory=dict)
    bcs: list[Any] = field(default_factory=list)

    def prescribe(self, name: str, boundary: Any, part: int, component: int | None = None) -> None:
        """Prescribe zero on a boundary, to be changed by ``set``."""
        self.given[name] = fem.Constant(self.data.mesh, 0.0)
        space = self.w.function_space.sub(part)
        self.bcs.append(fm.dirichlet(space, self.data, boundary, self.given[name], component))

    def hold(self, name: str, boundary: str) -> None:
        """Prescribe all components of the displacement on a boundary, to be changed by ``set``."""
        for component in range(self.data.mesh.geometry.dim):
            self.prescribe(f"{name}{component}", boundary, 0, component)

    def set(self, **values: Any) -> None:
        """Set prescribed values, vectors of boundaries that are held."""
        for name, value in values.items():
            names = [name] if name in self.given else [f"{name}{c}" for c in range(len(value))]
            for of_name, number in zip(names, np.atleast_1d(value)):
                self.given[of_name].value = number

    def problem(self, pairs: Any, **options: Any) -> fm.ContactProblem:
        """The problem with some pairs."""
        return fm.ContactProblem(
            self.residual, self.w, pairs, bcs=self.bcs, petsc_options_prefix="heat_",
            geometry=self.geometry, **options,
        )  # fmt: skip

    def at(self, part: int) -> tuple[np.ndarray, np.ndarray]:
        """Owned values of a part and positions of its dofs, gathered on all ranks."""
        space, dofs = compat.collapsed(self.w.function_space.sub(part))
        owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        values = self.w.x.array[dofs[:owned]]
        X = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local]
        X = X[:, : self.data.mesh.geometry.dim]
        comm = self.data.mesh.comm
        values = values.reshape(len(X), space.dofmap.index_map_bs)
        return np.concatenate(comm.allgather(values)), np.concatenate(comm.allgather(X))


def heated(
    bodies: Sequence[Grid | Box],
    *,
    degrees: tuple[int, int] = (1, 1),
    E: float = 100.0,
    nu: float = 0.3,
    alpha: float = 1e-3,
    conductivity: float = 5.0,
    geometry: str = "plane",
    **options: Any,
) -> Heated:
    """Bodies of one material with displacement and temperature of these degrees."""
    in_space = isinstance(bodies[0], Box)
    data = mapped_boxes.mesh(bodies, **options) if in_space else mesh(bodies, **options)
    dim = data.mesh.geometry.dim
    W = fm.mixed_space(data.mesh, ("Lagrange", degrees[0], (dim,)), ("Lagrange", degrees[1]))
    w, (v, s) = fem.Function(W), ufl.TestFunctions(W)
    u, T = ufl.split(w)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    around = 2 * np.pi * ufl.SpatialCoordinate(data.mesh)[0] if geometry == "axisymmetric" else 1.0
    e = elastic_strain(u, alpha * T, geometry)
    virtual = elastic_strain(v, geometry=geometry)
    residual = around * ufl.inner(stress(linear_elastic, e, *lame(E, nu)), virtual) * dx
    k = fem.Constant(data.mesh, conductivity)
    residual += around * k * ufl.inner(ufl.grad(T), ufl.grad(s)) * dx
    return Heated(data, w, residual, s, dx, T, geometry, {"conductivity": k})


def stacked(columns: tuple[int, int] = (5, 7), *, overhang: float = 0.0, **options: Any) -> Heated:
    """A block of height 1 on one of height 2, cold below and hot above, sides on rollers.

    ``overhang``: width of the lower block beyond that of the upper one, which is 1. Without it the
    right sides are on rollers, too.
    """
    lower = Grid("lower", block(columns[0], 4, width=1.0 + overhang, height=2.0))
    upper = Grid("upper", block(columns[1], 2, width=1.0, height=1.0, corner=(0.0, 2.0)))
    scene = heated([lower, upper], **options)
    for body in ("lower", "upper"):
        sides = [f"{body}/left"] if overhang else [f"{body}/left", f"{body}/right"]
        scene.prescribe(f"{body} side", sides, 0, 0)
    scene.prescribe("bottom", "lower/bottom", 0, 1)
    scene.prescribe("top", "upper/top", 0, 1)
    scene.prescribe("cold", "lower/bottom", 1)
    scene.prescribe("hot", "upper/top", 1)
    return scene


def stacked_in_space(
    upper: tuple[int, int, int] = (3, 2, 1),
    lower: tuple[int, int, int] = (2, 3, 2),
    *,
    overhang: float = 0.0,
    turn: Any = None,
    jiggle: float = 0.0,
    **options: Any,
) -> Heated:
    """A cube on a block of height 2, cold below and hot above; "bottom" and "top" are held.

    Args:
        upper: Numbers of cells of the cube.
        lower: Numbers of cells of the block.
        overhang: Width and depth of the block beyond those of the cube.
        turn: Matrix of a rotation of the whole scene.
        jiggle: See ``mapped_boxes.mapped``.
        options: See ``heated``.
    """
    below = mapped_boxes.block(
        lower, size=(1.0 + overhang, 1.0 + overhang, 2.0), jiggle=jiggle, seed=1
    )
    corner = 0.43 * overhang, 0.31 * overhang, 2.0
    above = mapped_boxes.block(upper, corner=corner, jiggle=jiggle, seed=2)
    places = [x if turn is None else x @ turn.T for x in (below, above)]
    scene = heated([Box("lower", places[0]), Box("upper", places[1])], **options)
    scene.hold("bottom", "lower/bottom")
    scene.hold("top", "upper/top")
    scene.prescribe("cold", "lower/bottom", 1)
    scene.prescribe("hot", "upper/top", 1)
    return scene


def roll_sides(scene: Heated) -> Heated:
    """Put all sides of both blocks in space on rollers."""
    for body in ("lower", "upper"):
        for component, sides in enumerate((("left", "right"), ("front", "back"))):
            names = [f"{body}/{side}" for side in sides]
            scene.prescribe(f"{body} {component}", names, 0, component)
    return scene
