# SPDX-License-Identifier: MIT
"""The estimate of the error vanishes for what the cells can follow, and marks what they cannot."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import scenes
import two_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.estimate import ErrorEstimate

# Blocks of unlike material with rollers on the left and below, free on the right
MESH = {"n_upper": 3, "n_lower": 5, "layers_upper": 2, "layers_lower": 3}
# rounding by the number of dofs, the root of tiny squares included
EXACT = 1e-7


def column(law, degree, weight, cell="triangle", traction=-3.0, extra=None):
    """Two blocks of equal width under a traction on top and their own weight."""
    data = scenes.read(two_blocks.build, cell=cell, width_upper=1.0, width_lower=1.0, **MESH)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    rule = {"quadrature_degree": 4}
    dx = ufl.Measure("dx", data.mesh, subdomain_data=data.cell_tags, metadata=rule)
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags, metadata=rule)
    residual = -ufl.inner(ufl.as_vector([0.0, traction]), v) * ds(data.boundary_tag("upper/top"))
    residual -= ufl.inner(fem.Constant(data.mesh, (0.0, -weight)), v) * dx
    for body, E in (("upper", 100.0), ("lower", 300.0)):
        stress = law(u, E, 0.0)
        residual += ufl.inner(stress, ufl.grad(v)) * dx(data.body_tag(body))
    if extra is not None:
        residual += extra(u, v)
    bcs = [fm.dirichlet(V, data, "lower/bottom", 0.0, component=1)]
    bcs.append(fm.dirichlet(V, data, ["lower/left", "upper/left"], 0.0, component=0))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    return fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="estimate_", newton=scenes.TIGHT
    )


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize(
    "law, degree, weight",
    [(scenes.neo_hookean, 1, 0.0), (scenes.linear_elastic, 2, 5.0)],
)
def test_no_error_is_seen_in_what_the_cells_can_follow(law, degree, weight, cell):
    """Uniform stress with degree 1, stress that is linear under the own weight with degree 2."""
    problem = column(law, degree, weight, cell)
    problem.solve()
    estimate = problem.estimate()
    assert estimate.relative < EXACT
    assert estimate.size > 0.0


def test_every_term_sees_what_is_wrong():
    """A multiplier, a load, and a displacement that do not fit."""
    problem = column(scenes.linear_elastic, 1, 0.0)
    problem.solve()
    good = problem.estimate()
    (contact,) = problem.contacts
    contact.z *= 1.1
    wrong = problem.estimate()
    assert wrong.parts["contact"] > 0.01 * wrong.size
    assert wrong.parts["sides"] == pytest.approx(good.parts["sides"], abs=EXACT * good.size)
    contact.z /= 1.1
    contact.offset = np.full(contact.slave.num_nodes, 0.01)
    wrong = problem.estimate()
    # on the length 1 of the surface: half of (E / height of a layer) times the gap squared
    assert wrong.parts["gap"] == pytest.approx(np.sqrt(0.5 * 100.0 / 0.5) * 0.01, rel=1e-3)
    contact.offset[:] = 0.0
    u = problem.bulk.u.x.array
    u[problem.bulk.space.dofs] += 1e-3 * np.sin(9 * problem.bulk.positions())
    wrong = problem.estimate()
    for part in ("sides", "boundary", "contact"):
        assert wrong.parts[part] > 0.01 * wrong.size, part


def test_estimate_does_not_depend_on_the_ranks():
    def pressed(comm):
        scene = scenes.pressed_blocks(comm=comm, cell="triangle", n_upper=6, n_lower=8)
        scene.loads["push"].value[:] = (0.02, -0.1)
        scene.problem.solve()
        return scene.problem.estimate()

    alone, together = pressed(MPI.COMM_SELF), pressed(MPI.COMM_WORLD)
    squares = MPI.COMM_WORLD.allreduce(float(np.sum(together.cells**2)))
    # the tolerance of Newton, in the root of squares
    assert np.sqrt(squares) == pytest.approx(together.total, rel=1e-12)
    for name, part in alone.parts.items():
        assert together.parts[name] == pytest.approx(part, rel=1e-6), name
    assert together.size == pytest.approx(alone.size, rel=1e-6)
    marked = MPI.COMM_WORLD.allreduce(len(together.mark(0.5)))
    assert marked == len(alone.mark(0.5))


def test_fewest_cells_are_marked():
    mesh = SimpleNamespace(comm=MPI.COMM_SELF)
    estimate = ErrorEstimate(np.sqrt([1.0, 4.0, 2.0, 3.0]), 1.0, {"cells": np.sqrt(10.0)}, mesh)
    assert estimate.mark(0.4).tolist() == [1]
    assert estimate.mark(0.5).tolist() == [1, 3]
    assert estimate.mark(0.7).tolist() == [1, 3]
    assert estimate.mark(1.0).tolist() == [0, 1, 2, 3]


def test_mixed_functions_have_the_stress_of_their_pressure():
    """A block under all-round pressure does not move: all stress is the pressure."""
    data = scenes.read(two_blocks.build, cell="triangle", width_upper=1.0, width_lower=1.0, **MESH)
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w = fem.Function(W)
    (u, p), (v, q) = ufl.split(w), ufl.TestFunctions(W)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    strain = ufl.sym(ufl.grad(u))
    residual = (ufl.inner(2 * strain - p * ufl.Identity(2), ufl.grad(v)) - q * ufl.div(u)) * dx
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags)
    top = data.boundary_tag("upper/top")
    residual += 0.01 * ufl.inner(ufl.FacetNormal(data.mesh), v) * ds(top)
    sides = [f"{body}/{side}" for body in ("lower", "upper") for side in ("left", "right")]
    bcs = [fm.dirichlet(W.sub(0), data, sides, 0.0, component=0)]
    bcs.append(fm.dirichlet(W.sub(0), data, "lower/bottom", 0.0, component=1))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="mixed_")
    problem.solve()
    assert problem.estimate().total < EXACT


@pytest.mark.serial  # on several ranks dolfinx refuses them before, for a mesh without ghosts
def test_integrals_over_inner_facets_are_refused():
    def penalty(u, v):
        return ufl.inner(ufl.jump(u), ufl.jump(v)) * ufl.dS(metadata={"quadrature_degree": 2})

    problem = column(scenes.linear_elastic, 1, 0.0, extra=penalty)
    with pytest.raises(fm.MortarError, match="interior_facet"):
        problem.estimate()
