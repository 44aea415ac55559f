# SPDX-License-Identifier: MIT
"""Bodies in space without contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block

EACH_CELL = [(cell, order) for cell in mapped_boxes.CELLS for order in (1, 2)]
SIZE = np.array([1.0, 2.0, 1.5])
YOUNG, POISSON = 10.0, 0.3


@dataclass
class Solid:
    """A block of ``SIZE`` with its lower left front corner at the origin."""

    data: fm.MeshData
    u: Any
    residual: Any
    bcs: list[Any]
    problem: Any = None

    def set_up(self, pairs=(), **options):
        """Set up the problem, without pairs by default."""
        self.problem = fm.ContactProblem(
            self.residual,
            self.u,
            list(pairs),
            **{"bcs": self.bcs, "petsc_options_prefix": "test_space_", **options},
        )
        return self


def solid(cell="hexahedron", order=1, *, counts=(2, 3, 2), energy=energies.neo_hookean, **options):
    """A block without conditions and loads."""
    x = block(counts, order=order, **{"size": SIZE, "jiggle": 0.2, **options})
    return of(mapped_boxes.mesh([Box("block", x)], cell=cell, order=order), order, energy)


def of(data, order=1, energy=energies.neo_hookean):
    """The bodies of a mesh without conditions and loads."""
    u = fem.Function(fm.vector_space(data.mesh, order), name="u")
    psi = energy(u, *energies.lame(YOUNG, POISSON)) * ufl.dx(degree=4)
    return Solid(data, u, ufl.derivative(psi, u), [])


def held(scene, value=(0.0, 0.0, 0.0), side="block/bottom"):
    """Prescribe all components on a side; return the constant."""
    constant = fem.Constant(scene.data.mesh, np.array(value, float))
    scene.bcs.append(fm.dirichlet(scene.u.function_space, scene.data, side, constant))
    return constant


def pressed(cell="hexahedron", order=1, push=(0.1, 0.05, -0.3), **options):
    """A block that stands on its bottom, with its top moved."""
    scene = solid(cell, order, **options)
    held(scene)
    held(scene, push, "block/top")
    return scene


def traction(scene, side, value):
    """Add a dead load per undeformed area on a side."""
    tags = scene.data.facet_tags
    ds = ufl.Measure("ds", domain=scene.data.mesh, subdomain_data=tags)
    load = fem.Constant(scene.data.mesh, np.array(value, float))
    v = ufl.TestFunction(scene.u.function_space)
    scene.residual -= ufl.inner(load, v) * ds(scene.data.boundary_tag(side))
    return load
