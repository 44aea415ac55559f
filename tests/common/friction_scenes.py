# SPDX-License-Identifier: MIT
"""Blocks with friction, on each other or on an obstacle, and functions that move them."""

from typing import get_args

from scenes import TIGHT, internal, neo_hookean, pressed_blocks, read, rectangles, rotation

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.pair import Measure

MESH = {"n_upper": 6, "n_lower": 9, "layers_upper": 4, "layers_lower": 4}
SMALL = {"n_upper": 3, "n_lower": 4, "layers_upper": 2, "layers_lower": 2}
LAWS = {
    "coulomb": fm.Coulomb(0.3),
    "by pressure": fm.Coulomb(0.3, limit_by="pressure"),
    "capped": fm.Coulomb(0.3, max_shear=2.0),
    "tresca": fm.Tresca(1.0),
}
E, NU = 100.0, 0.3


MEASURES = [{"slip": slip} for slip in get_args(Measure)]


def blocks(law, *, degree=1, mesh=None, pair=None, **problem):
    mesh = mesh or (MESH if degree == 1 else SMALL)
    return pressed_blocks(degree=degree, pair={"law": law, **(pair or {})}, problem=problem, **mesh)


def drive(scene, *pushes):
    """Solve for each position of the top; return the records."""
    records = []
    for push in pushes:
        scene.loads["push"].value[:] = push
        records.append(scene.problem.solve())
        assert records[-1].certificate.violations() == []
    return records


def block_on(obstacle, *, degree=1, law=None, angle=0.0, weight=0.0):
    """A block of 1 x 0.5 on y = 0, turned by ``angle``, fixed at its top; weight frees it in y."""
    data = read(rectangles, size=0.25 * degree, block=(0.0, 0.0, 1.0, 0.5))
    x = data.mesh.geometry.x
    x[:, :2] = x[:, :2] @ rotation(angle).T
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    load = fem.Constant(data.mesh, (0.0, weight))
    residual = internal(u, neo_hookean(u, E, NU)) + ufl.inner(load, v) * ufl.dx
    along = fem.Constant(data.mesh, 0.0)
    fixed = fm.dirichlet(V, data, "block/top", along, component=0)
    if not weight:
        fixed = fm.dirichlet(V, data, "block/top", (0.0, 0.0))
    pair = fm.ContactPair(data, "block/bottom", obstacle, law=law)
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=[fixed], petsc_options_prefix="test_", newton=TIGHT
    )
    return problem, along
