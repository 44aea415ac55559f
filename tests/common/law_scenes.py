# SPDX-License-Identifier: MIT
"""A block pressed on a moving plane, with a uniform pressure without friction."""

from scenes import TIGHT, internal, linear_elastic, read, rectangles

from dolfinx import fem

import fenics_mortar as fm

E, HEIGHT = 100.0, 0.5


def block_on_plane(law, *, degree=1, nu=0.0, material=linear_elastic, size=0.25, **problem):
    """A block of 1 x ``HEIGHT``; its top is moved by the constant, the plane by the obstacle."""
    data = read(rectangles, size=size * degree, block=(0.0, 0.0, 1.0, HEIGHT))
    V = fm.vector_space(data.mesh, degree)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    plane = fm.Plane((0.0, 0.0), (0.0, 1.0))
    pair = fm.ContactPair(data, "block/bottom", plane, law=law)
    problem_ = fm.ContactProblem(
        internal(u, material(u, E, nu)), u, [pair],
        bcs=[fm.dirichlet(V, data, "block/top", push)],
        petsc_options_prefix="test_", newton=TIGHT, **problem,
    )  # fmt: skip
    return problem_, push, plane
