# SPDX-License-Identifier: MIT
"""The tangent of linear bodies is kept while contact terms are added to it."""

import numpy as np
from scenes import internal, linear_elastic, pressed_blocks, read

from dolfinx import fem

import fenics_mortar as fm
from meshes import two_blocks


def product(bulk):
    """K times an irregular vector, which depends on the numbers of its dofs alone."""
    x, y = bulk.K.createVecs()
    first, end = x.getOwnershipRange()
    x.array[:] = np.sin(np.arange(first, end) ** 2.0)
    bulk.K.mult(x, y)
    return y.array_r.copy()


def assembled_anew(bulk):
    bulk.renew_tangent()
    bulk.assemble_tangent()
    return product(bulk)


def test_kept_tangent_is_that_of_the_form():
    given = {"linear_bulk": False, "algorithm": "condensed"}
    scene = pressed_blocks(material=linear_elastic, problem=given)
    scene.loads["push"].value[1] = -0.05
    bulk = scene.problem.equations.bulk
    assert scene.problem.solve().num_iterations >= 2
    assert bulk._constant is not None
    bulk.assemble_tangent()
    kept = product(bulk)
    np.testing.assert_allclose(kept, assembled_anew(bulk), atol=1e-14 * np.abs(kept).max())


def test_kept_tangent_follows_constants_of_the_form():
    data = read(two_blocks.build)
    V = fm.vector_space(data.mesh, 1)
    u, stiffness = fem.Function(V), fem.Constant(data.mesh, 1.0)
    push = fem.Constant(data.mesh, (0.0, -0.05))
    bcs = [fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "upper/top", push))
    problem = fm.ContactProblem(
        stiffness * internal(u, linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "upper/bottom", "lower/top")], bcs=bcs, linear_bulk=False,
        algorithm="condensed", petsc_options_prefix="kept_",
    )  # fmt: skip
    problem.solve()
    force = problem.contacts[0].total_force
    stiffness.value = 2.0
    problem.solve()
    np.testing.assert_allclose(problem.contacts[0].total_force, 2.0 * force, rtol=1e-8, atol=1e-8)
    bulk = problem.equations.bulk
    bulk.assemble_tangent()
    kept = product(bulk)
    np.testing.assert_allclose(kept, assembled_anew(bulk), atol=1e-14 * np.abs(kept).max())
