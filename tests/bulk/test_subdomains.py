# SPDX-License-Identifier: MIT
"""Tags of another mesh, and integrals over tags that no entity has."""

import numpy as np
import pytest
from array_meshes import bcs_of, blocks_of_arrays, grid, mesh_of, tagged, tagged_facets
from refusal import COMM, refused
from scenes import internal, neo_hookean

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from fenics_mortar import sensitivity


def larger(dim=1):
    """Tags of a mesh with more facets and cells than ``blocks_of_arrays``."""
    data = tagged(mesh_of(*grid(40, 30)), slave=lambda x: x[1] > 0.99)
    if dim == 1:
        return data.facet_tags
    cells = np.arange(data.mesh.topology.index_map(2).size_local, dtype=np.int32)
    return dmesh.meshtags(data.mesh, 2, cells, np.full(cells.size, 1, np.int32))


def smaller():
    """Tags of a mesh with fewer facets, which all exist on ``blocks_of_arrays``."""
    return tagged(mesh_of(*grid(2, 2)), slave=lambda x: x[1] > 0.99).facet_tags


def problem_with(load, data=None, **options):
    """Two blocks, whose residual has a further term, a function of data and test function."""
    data = blocks_of_arrays() if data is None else data
    u = fem.Function(fm.vector_space(data.mesh, 1))
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    v, pair = ufl.TestFunction(u.function_space), fm.ContactPair(data, "slave", "master")
    return fm.ContactProblem(
        residual - load(data, v), u, [pair], bcs=bcs_of(data, u.function_space),
        petsc_options_prefix="tags_", **options,
    )  # fmt: skip


@pytest.mark.each
@pytest.mark.parametrize("tags", [larger, smaller])
def test_facet_tags_of_another_mesh_are_refused(tags):
    data = blocks_of_arrays()
    with refused(fm.MeshError, "facet_tags belong to another mesh; expected tags of this one"):
        fm.MeshData(data.mesh, None, tags(), {}, {"slave": 1})
    with refused(fm.MeshError, "cell_tags belong to another mesh"):
        fm.MeshData(data.mesh, larger(2), data.facet_tags)


def test_facets_that_the_mesh_does_not_have_are_refused():
    """Such tags are made from facets of a larger mesh."""
    data = blocks_of_arrays()
    facets = np.arange(500, 600, dtype=np.int32)
    tags = dmesh.meshtags(data.mesh, 1, facets, np.ones(facets.size, np.int32))
    count = data.mesh.topology.index_map(1).size_local + data.mesh.topology.index_map(1).num_ghosts
    assert count < 500
    with refused(fm.MeshError, r"facet_tags have entity 500, but there are \d+ facets on rank 0"):
        fm.MeshData(data.mesh, None, tags)


def test_tags_of_another_kind_are_refused():
    """Facet tags in the place of cell tags gave the bodies of facets."""
    data = blocks_of_arrays()
    with refused(fm.MeshError, "cell_tags are of dimension 1; expected tags of dimension 2"):
        fm.MeshData(data.mesh, data.facet_tags, data.facet_tags)
    with refused(ValueError, "facet_tags=array.*: expected tags of dolfinx.mesh.meshtags"):
        fm.MeshData(data.mesh, None, np.arange(4))
    with refused(ValueError, "mesh=None: expected a mesh of dolfinx"):
        fm.MeshData(None, None, data.facet_tags)


@pytest.mark.each
@pytest.mark.parametrize(
    "measure, message",
    [
        (lambda d: ufl.ds(1, subdomain_data=larger()), "tags of ds in the residual belong to an"),
        (lambda d: ufl.ds(1, subdomain_data=smaller()), "tags of ds in the residual belong to an"),
        (lambda d: ufl.dx(1, subdomain_data=larger(2)), "tags of dx in the residual belong to an"),
        (lambda d: ufl.dx(1, subdomain_data=d.facet_tags), "dx .* of dimension 1; .* dimension 2"),
    ],
)
def test_measures_with_unsuitable_tags_are_refused(measure, message):
    with refused(fm.MeshError, message):
        problem_with(lambda data, v: v[1] * measure(data))


@pytest.mark.each
@pytest.mark.parametrize("number", [99, (4, 99)])
def test_a_load_on_a_tag_without_facets_is_refused_and_the_tags_are_listed(number):
    """Without the error the traction is zero."""
    known = r"no facet of the boundary has the tag 99.* 1 \('base'\), .*, 4 \('top'\): correct"
    with refused(fm.MeshError, r"the residual has an integral over ds\(99\), but " + known):
        problem_with(lambda data, v: v[1] * ufl.ds(number, subdomain_data=data.facet_tags))


def test_an_integral_over_a_tag_without_cells_is_refused():
    def load(data, v):
        cells = np.arange(data.mesh.topology.index_map(2).size_local, dtype=np.int32)
        tags = dmesh.meshtags(data.mesh, 2, cells, np.full(cells.size, 7, np.int32))
        return v[1] * ufl.dx(3, subdomain_data=tags)

    with refused(fm.MeshError, r"over dx\(3\), but no cell has the tag 3.* there are 7: correct"):
        problem_with(load)


def test_a_tagged_measure_without_tags_is_refused():
    with refused(fm.MeshError, r"ds\(4\), but this measure has no tags.*data=data.facet_tags"):
        problem_with(lambda data, v: v[1] * ufl.ds(4))


def test_facets_inside_a_body_are_no_boundary():
    data = blocks_of_arrays()
    middle = dmesh.locate_entities(data.mesh, 1, lambda x: np.isclose(x[1], 1.0 / 3.0))
    inner = tagged_facets(data.mesh, {"inner": middle}).facet_tags
    with refused(fm.MeshError, r"over ds\(1\), but no facet .* the tags there are none: correct"):
        problem_with(lambda data, v: v[1] * ufl.ds(1, subdomain_data=inner), data)
    if COMM.size == 1:  # on several, dolfinx needs cells of other ranks beside each facet
        problem_with(lambda data, v: ufl.avg(v[1]) * ufl.dS(1, subdomain_data=inner), data)


def test_the_tags_of_a_jacobian_are_checked():
    def jacobian(u):
        forms = ufl.TrialFunction(u.function_space), ufl.TestFunction(u.function_space)
        return ufl.inner(*forms) * ufl.ds(99, subdomain_data=data.facet_tags)

    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    with refused(fm.MeshError, r"the jacobian has an integral over ds\(99\)"):
        fm.ContactProblem(
            internal(u, neo_hookean(u, 100.0, 0.3)), u, [fm.ContactPair(data, "slave", "master")],
            jacobian=jacobian(u), petsc_options_prefix="tags_",
        )  # fmt: skip


def test_a_tag_on_some_ranks_only_is_accepted():
    """The traction acts on one facet."""

    def load(data, v):
        left = dmesh.locate_entities_boundary(
            data.mesh, 1, lambda x: np.isclose(x[0], 0.0) & (x[1] < 0.4)
        )
        one = tagged_facets(data.mesh, {"one": left}).facet_tags
        assert COMM.allreduce(left.size) >= 1
        return v[0] * ufl.ds(1, subdomain_data=one)

    forces = problem_with(load).forces()[0]
    assert COMM.allreduce(float(forces.sum())) == pytest.approx(-1.0 / 3.0, rel=1e-12)


def test_tags_of_an_energy_and_of_an_objective_are_checked():
    problem = problem_with(lambda data, v: v[1] * ufl.dx)
    data, u = problem.equations.contacts[0].pair.data, problem.equations.bulk.u
    form = u[1] * ufl.ds(99, subdomain_data=data.facet_tags)
    problem.solve()
    with refused(fm.MeshError, r"the objective has an integral over ds\(99\)"):
        fm.gradient(form, sensitivity.Offset(0), problem)
    with refused(fm.MeshError, r"the energy has an integral over ds\(99\)"):
        fm.Dynamics(problem, 1.0, energy=form)
