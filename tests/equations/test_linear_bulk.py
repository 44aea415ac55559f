# SPDX-License-Identifier: MIT
"""Use of one factorization of the bulk: from the first solve on if its predicted cost is lower."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, nodal, pressed_blocks, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.la.options import COSTS
from meshes import half_cylinder_on_block

comm = MPI.COMM_WORLD
MESH = {"n_upper": 7, "n_lower": 11, "layers_upper": 4, "layers_lower": 4}


def largest(values):
    return comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


def solved(material, push=-0.05, **options):
    scene = pressed_blocks(material=material, problem=options, **MESH)
    scene.loads["push"].value[1] = push
    return scene, scene.problem.solve()


def bent(u, E, nu):
    """A linear law where cells are stretched, a stiffer one where they are pressed."""
    stress = linear_elastic(u, E, nu)
    return ufl.conditional(ufl.lt(ufl.div(u), 0.0), 2.0, 1.0) * stress


@pytest.mark.once
def test_first_solve_on_contact_dofs_reports_its_reason():
    scene, report = solved(linear_elastic)
    dofs = 2 * (scene.contact.slave.num_nodes + scene.contact.master.num_nodes)
    assert f"factored once, Newton's method on {dofs} contact dofs" in report.solver
    assert "predicted: once" in report.solver and report.solver in str(report)
    general, other = solved(linear_elastic, linear_bulk=False)
    assert "factors by" in other.solver
    assert report.num_iterations == other.num_iterations and not report.notes
    assert largest(nodal(scene.problem) - nodal(general.problem)) < 1e-9


@pytest.mark.parametrize("material", [neo_hookean, bent])
def test_nonlinear_residuals_are_recognized(material):
    scene, report = solved(material)
    assert not scene.problem.equations.bulk.is_linear
    assert "linear bulk" not in report.solver and "factors by" in report.solver


@pytest.mark.parametrize(
    "options, message", [({"dense": 1e9}, "are many"), ({"per_entry": 1e9}, "memory")]
)
def test_costly_dense_matrices_are_avoided(monkeypatch, options, message):
    monkeypatch.setattr(
        "fenics_mortar.equations.reduced.costs_of", lambda dim: replace(COSTS, **options)
    )
    scene, report = solved(linear_elastic)
    assert message in report.solver and "factored in every iteration" in report.solver
    assert scene.problem._solver.linear_bulk.choose()[0] is None


@pytest.mark.once
def test_dense_matrices_are_made_for_many_solves(monkeypatch):
    """The general method was predicted to be cheaper for one solve; after many solves it is not."""
    unknowns = pressed_blocks(material=linear_elastic, **MESH).problem.equations.bulk.r.getSize()
    twice = COSTS.factors(unknowns, 2 * COSTS.expected) / (1e-6 * unknowns)
    dear = replace(COSTS, once=twice, dense=0.0)
    monkeypatch.setattr("fenics_mortar.equations.reduced.costs_of", lambda dim: dear)
    scene, report = solved(linear_elastic)
    assert "every iteration" in report.solver
    for push in np.linspace(-0.06, -0.1, 5):
        scene.loads["push"].value[1] = push
        report = scene.problem.solve()
    assert "factored once" in report.solver


def disc_on_block(reduced):
    """A half disc on a block; its facets are a tenth of the displacement of its flat side."""
    build = half_cylinder_on_block.build
    data = read(build, radius=1.0, width=4.0, height=2.0, h=0.012, fine=0.05, growth=0.4)
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, -0.12))
    bcs = [fm.dirichlet(V, data, "block/bottom", (0.0, 0.0))]
    bcs.append(fm.dirichlet(V, data, "cylinder/top", push))
    pair = fm.ContactPair(data, "cylinder/arc", "block/top")
    residual = internal(u, linear_elastic(u, 1.0, 0.3))
    return fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="test_", linear_bulk=reduced
    )


@pytest.mark.once
def test_steps_that_would_invert_cells_are_shortened_as_on_all_dofs():
    """One node touches at first, and the cells of the disc would be inverted."""
    one, other = (disc_on_block(reduced) for reduced in (False, True))
    general, report = one.solve(), other.solve()
    assert min(it.fraction for it in general.iterations) < 1.0
    assert [it.fraction for it in general.iterations] == [it.fraction for it in report.iterations]
    assert "factored once" in report.solver and not any("astray" in n for n in report.notes)
    assert largest(nodal(one) - nodal(other)) < 1e-9
