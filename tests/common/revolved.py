# SPDX-License-Identifier: MIT
"""Bodies of revolution: materials, meshes of the meridian half plane, whole problems."""

from __future__ import annotations

from typing import Any

import numpy as np
from scenes import TIGHT, Scene, pair_options, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies import common
from fenics_mortar.bulk.revolution import radial_dofs_on_axis
from fenics_mortar.energies import lame
from meshes.mapped_grids import Grid, block, build


def neo_hookean(u, E, nu):
    """First Piola-Kirchhoff stress of shape (3, 3), the axis of the hoop last."""
    return common.neo_hookean(u, *lame(E, nu), "axisymmetric")


def linear_elastic(u, E, nu):
    """Cauchy stress of linear elasticity of shape (3, 3), the axis of the hoop last."""
    return common.linear_elastic(u, *lame(E, nu), "axisymmetric")


def internal(u, stress, dx=None):
    """Virtual work of a stress, whole bodies; the radius cancels around the axis, for rounding."""
    v, X = ufl.TestFunction(u.function_space), ufl.SpatialCoordinate(u.function_space.mesh)
    dx = dx or ufl.dx(metadata={"quadrature_degree": 5})
    in_plane = ufl.as_tensor([[stress[i, j] for j in range(2)] for i in range(2)])
    return 2 * np.pi * (ufl.inner(in_plane, ufl.grad(v)) * X[0] + stress[2, 2] * v[0]) * dx


def bent(x, top):
    """A block whose top, or bottom, is bulged by 0.1 r^2, smooth on the axis."""
    height = np.linspace(0, 1, x.shape[1]) if top else np.linspace(1, 0, x.shape[1])
    x = x.copy()
    x[:, :, 1] += 0.1 * height * x[:, :, 0] ** 2
    return x


def cylinders(
    counts=(5, 7), *, holes=(0.0, 0.0), widths=(1.0, 1.2), gap=0.0, bulge=True, cell="triangle",
    layers=3,
):  # fmt: skip
    """Two stacked cylinders about x = 0, upper and lower; the latter at z < 1.

    ``bulge``: whether their faces are paraboloids.
    """
    upper = block(counts[0], layers, width=widths[0], height=1.0, corner=(holes[0], 1.0 + gap))
    lower = block(counts[1], layers + 1, width=widths[1], height=1.0, corner=(holes[1], 0.0))
    if bulge:
        lower, upper = bent(lower, top=True), bent(upper, top=False)
    return read(build, grids=[Grid("lower", lower), Grid("upper", upper)], cell=cell)


def on_axis(V, data, names):
    """Condition that prescribes the radial component of boundaries on the axis."""
    return fm.dirichlet(V, data, names, 0.0, component=0)


def pressed_cylinders(
    *,
    material=neo_hookean,
    slave: str = "upper",
    pair: dict[str, Any] | None = None,
    problem: dict[str, Any] | None = None,
    degree: int = 1,
    E: float = 100.0,
    nu: float = 0.3,
    axis_is_prescribed: bool = True,
    upper_is_prescribed: bool = True,
    **mesh: Any,
) -> Scene:
    """Two stacked cylinders, the lower fixed at its bottom; the upper one's top is moved."""
    data = cylinders(**mesh)
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    fixed, push = (fem.Constant(data.mesh, (0.0, 0.0)) for _ in range(2))
    bcs = [fm.dirichlet(V, data, "lower/bottom", fixed), fm.dirichlet(V, data, "upper/top", push)]
    bcs = bcs if upper_is_prescribed else bcs[:1]
    if axis_is_prescribed and not any(mesh.get("holes", ())):
        bcs.append(on_axis(V, data, ["lower/left", "upper/left"]))
    sides = ["upper/bottom", "lower/top"]
    contact = fm.ContactPair(
        data, *(sides if slave == "upper" else sides[::-1]), **pair_options(pair)
    )
    options = {"petsc_options_prefix": "revolved_", "newton": TIGHT, **(problem or {})}
    problem_ = fm.ContactProblem(
        internal(u, material(u, E, nu)), u, [contact], bcs=bcs, geometry="axisymmetric", **options
    )
    return Scene(data, u, problem_, {"push": push})


def graded(fine: float, count: int, growth: float, size: float) -> np.ndarray:
    """Coordinates from 0: ``count`` cells of length ``fine``, then growing ones up to ``size``."""
    lengths = [fine] * count
    while sum(lengths) < size:
        lengths.append(lengths[-1] * (1.0 + growth))
    x = np.concatenate([[0.0], np.cumsum(lengths)])
    x[count:] = x[count] + (x[count:] - x[count]) * (size - x[count]) / (x[-1] - x[count])
    return x


def disturbed(scene: Scene) -> Scene:
    """All nodes off the axis moved at random; the covered ones are active."""
    equations = scene.problem.equations
    bulk = equations.bulk
    perturbation = np.random.default_rng(0).uniform(-0.01, 0.01, bulk.r.getSize())
    scene.u.x.array[: bulk.num_owned] = perturbation[bulk.first :][: bulk.num_owned]
    scene.u.x.array[radial_dofs_on_axis(bulk.space)] = 0.0
    scene.u.x.scatter_forward()
    for contact in equations.contacts:
        contact.evaluate(scene.u.x.array, equations.linearization)
        contact.change(active=contact.covered)
    return scene
