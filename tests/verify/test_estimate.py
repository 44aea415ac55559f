# SPDX-License-Identifier: MIT
"""The error estimate vanishes for exactly represented solutions, and marks other errors."""

import inspect
from functools import partial
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
import scenes

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from fenics_mortar.bulk.fluxes import Fluxes
from fenics_mortar.interface.reference import gauss_points
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat
from fenics_mortar.verify.defects import interface_tractions
from fenics_mortar.verify.estimate import ErrorEstimate
from meshes import two_blocks

# Blocks of different materials with rollers on the left and below, free on the right
MESH = {"n_upper": 3, "n_lower": 5, "layers_upper": 2, "layers_lower": 3}
# rounding by the number of dofs, the root of tiny squares included
EXACT = 1e-7


def column(
    law,
    degree,
    weight,
    cell="triangle",
    traction=-3.0,
    extra=None,
    pair=None,
    slave="upper",
    **mesh,
):
    """Two blocks, by default of equal width, under a traction and their weight."""
    widths = {"width_upper": 1.0, "width_lower": 1.0}
    data = scenes.read(two_blocks.build, cell=cell, **{**MESH, **widths, **mesh})
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
        residual += extra(u, v, ds)
    bcs = [fm.dirichlet(V, data, "lower/bottom", 0.0, component=1)]
    bcs.append(fm.dirichlet(V, data, ["lower/left", "upper/left"], 0.0, component=0))
    sides = ["upper/bottom", "lower/top"]
    pair = (pair or fm.ContactPair)(data, *(sides if slave == "upper" else reversed(sides)))
    return fm.ContactProblem(
        residual, u, [pair], bcs=bcs, petsc_options_prefix="estimate_", newton=scenes.TIGHT
    )


def rubbing(data, slave, master):
    return fm.ContactPair(data, slave, master, law=fm.Coulomb(0.3))


def move_upper(problem, step):
    """Move all nodes above the interface, also prescribed ones."""
    bulk = problem.equations.bulk
    u = bulk.u.x.array
    upper = np.zeros(bulk.space.dofs.shape[0], bool)
    tags = problem.equations.contacts[0].pair.data
    cells = tags.cell_tags.find(tags.body_tag("upper"))
    upper[np.unique(compat.dofmap(bulk.V)[cells])] = True
    u[bulk.space.dofs[upper]] += step


@pytest.mark.parametrize("pair", [fm.ContactPair, rubbing, fm.TiedPair])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize(
    "law, degree, weight",
    [(scenes.neo_hookean, 1, 0.0), (scenes.linear_elastic, 2, 5.0)],
)
def test_exact_fields_of_the_cells_have_no_error(law, degree, weight, cell, pair):
    """Uniform stress with degree 1, linear stress under weight with degree 2."""
    problem = column(law, degree, weight, cell, pair=pair)
    problem.solve()
    estimate = problem.estimate()
    assert estimate.relative < EXACT
    assert estimate.size > 0.0


@pytest.mark.once
@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("degree", [1, 2])
def test_end_of_a_pressure_inside_a_surface_gives_no_error(degree, slave):
    """Beside the narrow upper block an equal traction acts on the lower one: stress is uniform."""

    def beside(u, v, ds):
        x = ufl.SpatialCoordinate(u.function_space.mesh)
        at = ufl.And(ufl.gt(x[1], 0.999), ufl.gt(abs(x[0] - 1.0), 0.5))
        return 3.0 * ufl.conditional(at, v[1], 0.0) * ds

    wide = {"width_lower": 2.0, "n_lower": 8, "layers_lower": 4}
    problem = column(scenes.linear_elastic, degree, 0.0, extra=beside, slave=slave, **wide)
    problem.solve()
    assert problem.estimate().relative < EXACT


@pytest.mark.parametrize("slave", ["upper", "lower"])
@pytest.mark.parametrize("degree", [1, 2])
def test_partly_covered_facets_bear_their_force_on_the_cover(degree, slave):
    """Uniform pressure; the ends of the upper block are in the middle of lower facets."""
    wide = {"width_lower": 2.0, "n_lower": 7}
    problem = column(scenes.linear_elastic, degree, 0.0, slave=slave, **wide)
    (contact,), rule = problem.equations.contacts, gauss_points(2)
    contact.evaluate(problem.equations.bulk.u.x.array, problem.equations.linearization)
    contact.change(z=np.tile([1.0, -3.0], (len(contact.z), 1)))
    prescribed = problem.equations.bulk.prescribed.astype(float)
    for surface, tractions in interface_tractions(contact, prescribed):
        ends = np.sort(surface.X[surface.facets[:, [0, -1]], 0])
        covered = np.diff(np.clip(ends, 0.5, 1.5))
        force = np.einsum("q,fqc->fc", rule[1], tractions) * np.diff(ends) / 2
        sign = 1.0 if surface is contact.master else -1.0
        assert np.abs(force - sign * covered * [1.0, -3.0]).max() < 1e-13


@pytest.mark.once
def test_each_term_detects_its_error():
    """An inconsistent multiplier, load, and displacement."""
    problem = column(scenes.linear_elastic, 1, 0.0)
    problem.solve()
    good = problem.estimate()
    (contact,) = problem.equations.contacts
    contact.change(z=1.1 * contact.z)
    wrong = problem.estimate()
    assert wrong.parts["contact"] > 0.01 * wrong.size
    assert wrong.parts["sides"] == pytest.approx(good.parts["sides"], abs=EXACT * good.size)
    contact.change(z=contact.z / 1.1)
    contact.offset = np.full(contact.slave.num_nodes, 0.01)
    wrong = problem.estimate()
    # on the length 1 of the surface: half of (E / height of a layer) times the gap squared
    assert wrong.parts["gap"] == pytest.approx(np.sqrt(0.5 * 100.0 / 0.5) * 0.01, rel=1e-9)
    contact.offset = np.zeros(contact.slave.num_nodes)
    u = problem.equations.bulk.u.x.array
    u[problem.equations.bulk.space.dofs] += 1e-3 * np.sin(9 * problem.equations.bulk.positions())
    wrong = problem.estimate()
    for part in ("sides", "boundary", "contact"):
        assert wrong.parts[part] > 0.01 * wrong.size, part


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("sliding, gap", [("small", 0.0), ("finite", 0.1 * 0.01)])
def test_gap_is_that_of_the_model(sliding, gap, degree):
    """A surface tilted by 0.1 slips by 0.01: an overlap with finite sliding only."""
    problem = column(
        scenes.linear_elastic, degree, 0.0, pair=partial(fm.ContactPair, sliding=sliding)
    )
    problem.solve()
    (contact,) = problem.equations.contacts
    contact.change(active=np.ones_like(contact.active))
    u, dofs = problem.equations.bulk.u.x.array, problem.equations.bulk.space.dofs
    u[dofs[:, 1]] += 0.1 * problem.equations.bulk.positions().reshape(-1, 2)[:, 0]
    move_upper(problem, (0.01, 0.0))
    # except for the length 0.01 that slips off the end
    expected = np.sqrt(0.5 * 100.0 / 0.5) * gap
    assert problem.estimate().parts["gap"] == pytest.approx(expected, rel=0.01, abs=EXACT)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("pair, part", [(rubbing, "slip"), (fm.TiedPair, "gap")])
def test_slip_of_sticking_nodes_is_estimated(pair, part, degree):
    """On the length 1: half of (shear modulus E / 2 / height of a layer) times the slip squared."""
    problem = column(scenes.linear_elastic, degree, 0.0, pair=pair)
    problem.solve()
    assert problem.estimate().parts[part] < EXACT
    move_upper(problem, (0.01, 0.0))
    wrong = problem.estimate()
    assert wrong.parts[part] == pytest.approx(np.sqrt(0.5 * 50.0 / 0.5) * 0.01, rel=1e-9)


@pytest.mark.once
def test_sliding_shear_below_the_friction_limit_is_estimated():
    """At the limit 0.3 x 3, the slip 0.01 would dissipate work; the shear of zero does not."""
    problem = column(scenes.linear_elastic, 1, 0.0, pair=rubbing)
    problem.solve()
    (contact,) = problem.equations.contacts
    contact.change(branch=np.ones_like(contact.branch))
    move_upper(problem, (0.01, 0.0))
    wrong = problem.estimate()
    assert wrong.parts["slip"] == pytest.approx(np.sqrt(0.3 * 3.0 * 0.01), rel=1e-9)
    z, found = contact.z.copy(), []
    for shear in (0.9, -0.9):  # the limit, against the slip and along it
        contact.change(z=z + shear * contact.operators.tau)
        found.append(problem.estimate().parts["slip"])
    assert sorted(found) == pytest.approx([0.0, np.sqrt(2.0 * 0.9 * 0.01)], rel=1e-9, abs=EXACT)


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


def block_under_pressure(extra=None):
    """Incompressible blocks under all-round pressure do not move: all stress is the pressure."""
    data = scenes.read(two_blocks.build, cell="triangle", width_upper=1.0, width_lower=1.0, **MESH)
    W = fm.mixed_space(data.mesh, ("Lagrange", 2, (2,)), ("Lagrange", 1))
    w = fem.Function(W)
    (u, p), (v, q) = ufl.split(w), ufl.TestFunctions(W)
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    strain = ufl.sym(ufl.grad(u))
    residual = (ufl.inner(2 * strain - p * ufl.Identity(2), ufl.grad(v)) - q * ufl.div(u)) * dx
    if extra is not None:
        residual += extra(p, q) * dx
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags)
    top = data.boundary_tag("upper/top")
    residual += 0.01 * ufl.inner(ufl.FacetNormal(data.mesh), v) * ds(top)
    sides = [f"{body}/{side}" for body in ("lower", "upper") for side in ("left", "right")]
    bcs = [fm.dirichlet(W.sub(0), data, sides, 0.0, component=0)]
    bcs.append(fm.dirichlet(W.sub(0), data, "lower/bottom", 0.0, component=1))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    return fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="mixed_")


@pytest.mark.once
def test_mixed_functions_have_the_stress_and_the_constraint_of_their_pressure():
    """A stretch by 0.01 leaves div u = 0.01; half of it in each direction has 0.01^2 on area 2."""
    problem = block_under_pressure()
    problem.solve()
    assert problem.estimate().total < EXACT
    dofs = problem.equations.bulk.space.dofs
    problem.equations.bulk.u.x.array[dofs[:, 0]] += (
        0.01 * problem.equations.bulk.positions().reshape(-1, 2)[:, 0]
    )
    assert problem.estimate().parts["constraint"] == pytest.approx(0.01 * np.sqrt(2.0))


def test_unknowns_with_other_fluxes_are_refused():
    problem = block_under_pressure(lambda p, q: 0.1 * ufl.inner(ufl.grad(p), ufl.grad(q)))
    _, pressures = problem.equations.bulk.space.whole.sub(1).collapse()
    problem.equations.bulk.u.x.array[np.ravel(pressures)] = np.arange(np.size(pressures))
    with pytest.raises(fm.MortarError, match="gradient of a test function other than"):
        problem.estimate()


@pytest.mark.serial  # on several ranks dolfinx refuses them before, for a mesh without ghosts
def test_integrals_over_inner_facets_are_refused():
    def penalty(u, v, _):
        return ufl.inner(ufl.jump(u), ufl.jump(v)) * ufl.dS(metadata={"quadrature_degree": 2})

    problem = column(scenes.linear_elastic, 1, 0.0, extra=penalty)
    with pytest.raises(fm.MortarError, match="interior_facet"):
        problem.estimate()


@pytest.mark.once
@pytest.mark.serial
def test_forms_are_read_after_the_first_compilation_on_a_mesh_as_before_it(tmp_path):
    # dolfinx 0.5 gives the mesh's element a variant as it compiles: test functions and normals made
    # from then on look like those of another mesh
    mesh = dmesh.create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (1.0, 1.0)], [2, 2])
    V = fm.vector_space(mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    rule = {"metadata": {"quadrature_degree": 2}}
    residual = scenes.internal(u, scenes.neo_hookean(u, 100.0, 0.3))
    residual += 3.0 * ufl.inner(ufl.FacetNormal(mesh), v) * ufl.ds(domain=mesh, **rule)
    names = {"jit_params", "jit_options"} & set(inspect.signature(fem.form).parameters)
    fem.form(residual, **{name: {"cache_dir": str(tmp_path)} for name in names})
    fluxes = Fluxes(residual, u, DisplacementSpace(V))
    below = dmesh.locate_entities_boundary(mesh, 1, lambda x: x[1] == 0.0)
    mesh.topology.create_connectivity(1, 2)
    cells = np.array([mesh.topology.connectivity(1, 2).links(f)[0] for f in below], np.int32)
    inside, *_ = fluxes.in_cells(np.arange(mesh.topology.index_map(2).size_local))
    tractions = [fluxes.loads(cells, np.full(cells.size, side), below) for side in range(3)]
    assert np.abs(inside.stress).max() == 0.0
    # the pressure is along the normal of the lower side, whichever its number
    assert any(np.allclose(t, [0.0, 3.0]) for t in np.concatenate(tractions))


def test_estimate_prints_its_parts():
    parts = {"cells": 3.0, "gap": 4.0, "slip": 0.0}
    text = str(ErrorEstimate(np.ones(3), 50.0, parts, None))
    assert text.splitlines() == [
        "estimated error 10 % in the energy norm: 5.000e+00 of 5.000e+01",
        "",
        "| part | estimate | share of square |",
        "|---|---:|---:|",
        "| cells | 3.00e+00 | 36 % |",
        "| gap | 4.00e+00 | 64 % |",
    ]
    assert "estimated error" in str(ErrorEstimate(np.ones(3), 0.0, {"cells": 0.0}, None))
