# SPDX-License-Identifier: MIT
"""Problems of the benchmarks: neo-Hookean bodies, the upper pressed on the lower."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import neo_hookean, read_mesh
from meshes import half_cylinder_on_block, two_blocks

comm = MPI.COMM_WORLD


def read(build, *, refinements=0, **options):
    """A mesh of ``meshes/``, refined ``refinements`` times."""

    def refined():
        model = build(**options)
        for _ in range(refinements):
            model.mesh.refine()
        return model

    return read_mesh(refined)


def pressed(data, lower, upper, *, degree, stiff=(1.0, 1.0), **options):
    """The problem, and the constant that moves the upper body.

    Args:
        data: The mesh.
        lower: Names of the lower body, of its fixed side and of its contact surface.
        upper: Names of the other body likewise; its contact surface is the slave.
        degree: Degree of quadrature.
        stiff: Stiffness of the lower and of the upper body, as multiples of E = 104, nu = 0.3.
        options: Those of the problem.
    """
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    P = neo_hookean(u, 40.0, 60.0)
    dx = ufl.Measure("dx", subdomain_data=data.cell_tags, metadata={"quadrature_degree": degree})
    residual = sum(
        factor * ufl.inner(P, ufl.grad(v)) * dx(data.bodies[body])
        for factor, (body, *_) in zip(stiff, (lower, upper), strict=True)
    )
    moved = fem.Constant(data.mesh, (0.0, 0.0))
    bcs = [
        fm.dirichlet(V, data, lower[1], np.zeros(2)),
        fm.dirichlet(V, data, upper[1], moved),
    ]
    pair = fm.ContactPair(data, slave=upper[2], master=lower[2])
    options = {"petsc_options_prefix": "bench_", **options}
    return fm.ContactProblem(residual, u, [pair], bcs=bcs, **options), moved


def two_pressed_blocks(dofs, **options):
    """Problem with about ``dofs`` unknowns, slave facet length, constant that moves the top."""
    k = round(np.sqrt(dofs / 6))  # facets of the upper block: its side is 1, the lower 2.2 x 1
    data = read(two_blocks.build, n_upper=k, n_lower=2 * k, layers_upper=k, layers_lower=k)
    sides = ("lower", "lower/bottom", "lower/top"), ("upper", "upper/top", "upper/bottom")
    problem, top = pressed(data, *sides, degree=3, **options)
    top.value[1] = -0.01
    return problem, 1.0 / k, top


def half_cylinder(h, refinements, **options):
    """A half cylinder of radius 8 on a block, facets of ``h`` before they are refined.

    Returns:
        The problem, and the constant that moves the cylinder's flat side.
    """
    shape = {"radius": 8.0, "width": 48.0, "height": 24.0, "fine": 1.0, "growth": 0.2}
    data = read(half_cylinder_on_block.build, refinements=refinements, h=h, **shape)
    sides = ("block", "block/bottom", "block/top"), ("cylinder", "cylinder/top", "cylinder/arc")
    return pressed(data, *sides, degree=1, **options)


def size_of(problem):
    """Number of unknowns of the displacement."""
    return problem.equations.bulk.r.getSize()
