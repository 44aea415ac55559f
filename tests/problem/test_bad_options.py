# SPDX-License-Identifier: MIT
"""Rejected and allowed options of pairs, problems and Newton's method."""

import numpy as np
import pytest
from array_meshes import blocks_of_arrays, problem_on
from refusal import refused
from scenes import internal, neo_hookean, pair_options

import ufl
from dolfinx import fem

import fenics_mortar as fm


@pytest.mark.each
@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        ({"basis": "cubic"}, "basis='cubic': expected one of dual, standard"),
        ({"normals": "none"}, "normals='none': expected one of opposite, unit, own"),
        (
            {"integration": "gauss"},
            "integration='gauss': expected one of segments, elements, nodes",
        ),
        ({"points": 1}, "points=1: .*at least 2 per segment"),
        ({"integration": "elements", "points": 1}, "points=1: .*at least 2 per facet"),
        ({"integration": "nodes", "points": 3}, "points=3 with .*: the points are the nodes"),
        (
            {"integration": "nodes", "basis": "standard"},
            "basis='standard' with integration='nodes': .* expected 'dual'",
        ),
        (
            {"integration": "nodes", "gap_weights": "basis"},
            "gap_weights='basis' with integration='nodes': .* expected 'cover'",
        ),
        (
            {"basis": "standard", "gap_weights": "standard"},
            "gap_weights='standard' with basis='standard': Petrov-Galerkin needs dual",
        ),
        ({"discretization": "4C"}, "discretization='4C': expected one of default, other_codes, "),
        ({"discretization": None}, "discretization=None: expected an instance of Discretization"),
        ({"points": 2.5}, "points=2.5: .*whole number"),
        ({"search_radius": 0.0}, "search_radius=0.0: expected a positive length"),
        ({"search_radius": np.nan}, "search_radius=nan: expected a positive length"),
        ({"max_angle": 90.0}, "max_angle=90.0: expected a number between 0 and 90"),
        ({"c_n": -1.0}, "c_n=-1.0: expected a positive number"),
        ({"c_n": np.inf}, "c_n=inf: expected a positive number"),
        ({"c_n": "1"}, "c_n='1': expected a positive number"),
        ({"search_radius": [1.0]}, r"search_radius=\[1.0\]: expected a positive length"),
        ({"max_angle": None}, "max_angle=None: expected a number between 0 and 90"),
        ({"initial_gap": 1j}, "initial_gap=1j: expected a length"),
        ({"points": True}, "points=True: expected a whole number"),
        ({"law": fm.Coulomb}, "law=.*: expected an instance of Frictionless"),
    ],
)
def test_refused_option_of_a_pair_lists_allowed_values(option, allowed):
    data = blocks_of_arrays()
    with refused(ValueError, allowed):
        fm.ContactPair(data, "slave", "master", **pair_options(option))


@pytest.mark.parametrize(
    "kind, options",
    [(fm.ContactPair, {"integration": "elements"}), (fm.ContactPair, {}), (fm.TiedPair, {})],
)
def test_fewer_points_than_nodes_of_a_facet_are_refused(kind, options):
    """Two points cannot distinguish the three functions of a facet with one segment."""
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 2))
    pair = kind(data, "slave", "master", **pair_options(options, points=2))
    with refused(ValueError, "points=2: .*, 3$"):
        fm.ContactProblem(
            internal(u, neo_hookean(u, 100.0, 0.3)), u, [pair], petsc_options_prefix="test_errors_"
        )


@pytest.mark.each
@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        ({"algorithm": "dense"}, "algorithm='dense': expected one of condensed, saddle"),
        (
            {"linearization": "some"},
            "linearization='some': expected one of full, no_normals, no_segments, frozen",
        ),
        ({"pairs": "slave"}, "pairs='slave': .*list of ContactPair"),
        ({"pairs": None}, "pairs=None: .*list of ContactPair"),
        ({"bcs": [0.0]}, r"bcs=\[0.0\]: .*list of Dirichlet"),
        ({"newton": {"max_iterations": 5}}, "newton=.*: expected an instance of NewtonOptions"),
        ({"model_check": True}, "model_check=True: expected an instance of ModelCheck"),
        ({"petsc_options": "ksp_view"}, "petsc_options='ksp_view': expected a dictionary"),
        ({"jacobian": "exact"}, "jacobian='exact': expected a UFL form"),
        ({"linear_bulk": "yes"}, "linear_bulk='yes': expected True, False or None"),
        ({"algorithm": ["saddle"]}, r"algorithm=\['saddle'\]: expected one of condensed, saddle"),
    ],
)
def test_refused_option_of_a_problem_lists_allowed_values(option, allowed):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    options = {"pairs": [fm.ContactPair(data, "slave", "master")], **option}
    residual = internal(u, neo_hookean(u, 100.0, 0.3))
    with refused(ValueError, allowed):
        fm.ContactProblem(residual, u, petsc_options_prefix="test_errors_", **options)


def test_a_pair_without_its_list_is_refused():
    data = blocks_of_arrays()
    with refused(ValueError, r"pairs=ContactPair\('slave', 'master'\): .*list of ContactPair"):
        problem_on(data, fm.ContactPair(data, "slave", "master"))


def test_a_condition_without_its_list_is_refused():
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    bc = fm.dirichlet(u.function_space, data, "base", (0.0, 0.0))
    with refused(ValueError, "bcs is a DirichletBC: .*list of"):
        problem_on(data, u=u, bcs=bc)


@pytest.mark.parametrize("rank", [0, 2])
def test_energies_and_bilinear_forms_are_no_residuals(rank):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    form = ufl.inner(u, u) * ufl.dx(metadata={"quadrature_degree": 2})
    for argument in (ufl.TestFunction, ufl.TrialFunction)[:rank]:
        form = ufl.derivative(form, u, argument(u.function_space))
    pair = fm.ContactPair(data, "slave", "master")
    with refused(ValueError, r"one test function .*ufl.derivative\(energy, u, v\)"):
        fm.ContactProblem(form, u, [pair], petsc_options_prefix="test_errors_")


@pytest.mark.parametrize("algorithm", ["condensed", "saddle"])
def test_problem_without_pairs_is_solved(algorithm):
    data = blocks_of_arrays()
    u = fem.Function(fm.vector_space(data.mesh, 1))
    ends = {"base": 0.0, "master": 0.01, "slave": -0.01, "top": 0.0}
    bcs = [fm.dirichlet(u.function_space, data, name, (0.0, y)) for name, y in ends.items()]
    assert problem_on(data, [], u=u, bcs=bcs, algorithm=algorithm).solve().converged


def test_standard_basis_cannot_be_condensed():
    data = blocks_of_arrays()
    pair = fm.ContactPair(data, "slave", "master", **pair_options(basis="standard"))
    with refused(ValueError, "algorithm='condensed'.*not diagonal.*algorithm='saddle'"):
        problem_on(data, [pair], algorithm="condensed")


@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        ({"max_iterations": 0}, "max_iterations=0: expected a whole number, at least 1"),
        ({"residual_tolerance": -1.0}, "residual_tolerance=-1.0: expected a positive number"),
        ({"increment_tolerance": np.nan}, "increment_tolerance=nan: expected a positive number"),
        ({"max_iterations": 2.5}, "max_iterations=2.5: expected a whole number, at least 1"),
        ({"max_motion": "half"}, "max_motion='half': expected a positive number of facets"),
        ({"line_search": "no"}, "line_search='no': expected True or False"),
    ],
)
def test_refused_newton_option_lists_allowed_values(option, allowed):
    with refused(ValueError, allowed):
        fm.NewtonOptions(**option)
