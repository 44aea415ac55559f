# SPDX-License-Identifier: MIT
"""Derivatives of all blocks in space, with every law, element and algorithm: Taylor slopes of 2."""

from dataclasses import dataclass

import numpy as np
import pytest
from space_pairs import KINDS, ROLES, TILTED, pressed, slopes, stack

import fenics_mortar as fm
from fenics_mortar import laws
from fenics_mortar.contact.law import Stick
from fenics_mortar.interface.mortar import EXACT

SOLVED = fm.NewtonOptions(residual_tolerance=1e-9)
# Triangles with six nodes have no diagonal D.
ALGORITHMS = [
    (*k, a) for k in KINDS for a in ("condensed", "saddle") if (*k, a) != (*KINDS[2], "condensed")
]


@dataclass(frozen=True)
class Viscous(laws.Law):
    """A shear that grows with the slip and the pressure, without branches: a user's law."""

    k: float

    def branch(self, node, before):
        """See ``Law``."""
        return np.ones_like(before)

    def friction_limit_at(self, node):
        """See ``Law``: none."""
        return np.full(node.slip.shape, np.inf)

    def tangential(self, node, branch):
        """See ``Law``."""
        shear = self.k * node.slip * (1.0 + node.z_n)
        return laws.Row(
            node.z_tau - shear, by_slip=-self.k * (1.0 + node.z_n), by_z_n=-self.k * node.slip,
            by_z_tau=1.0,
        )  # fmt: skip


LAWS = {
    "frictionless": None,
    "Coulomb": fm.Coulomb(0.3),
    "Tresca": fm.Tresca(1.0),
    "stick": Stick(),
    "viscous": Viscous(1.0),
    "soft layer": laws.SoftLayer(50.0, 2.0, mu=0.3),
    "cohesive": laws.Cohesive(1.0, 0.1),
    "cohesive in shear": laws.MixedCohesive(100.0, 1.0, 0.1),
    "wear": laws.Worn(0.1, 0.002),
    "rate": laws.Stribeck(0.3, 0.2, 0.1),
}


def slid(law, *kind, algorithm=None, motion=(0.04, 0.025, -0.055), **options):
    """Blocks pressed on each other, then slid."""
    problem = {"algorithm": algorithm, "newton": SOLVED}
    scene = pressed(*kind, law=law, problem=problem, **options)
    for time, place in enumerate(((0.0, 0.0, -0.05), motion), 1):
        scene.problem.time = float(time)
        scene.move(*place)
    return scene


def assert_exact(scene):
    found = slopes(scene)
    assert {name: s for name, s in found.items() if not 1.9 < s < 2.1 and np.isfinite(s)} == {}
    assert np.isfinite(found["whole"])


@pytest.mark.parametrize("law", LAWS, ids=lambda name: name.replace(" ", "_"))
@pytest.mark.parametrize("cell, degree, algorithm", ALGORITHMS)
def test_tangents_are_exact(cell, degree, algorithm, law):
    scene = slid(LAWS[law], cell, degree, algorithm=algorithm)
    assert scene.contact.active.any()
    assert_exact(scene)


def test_derivatives_of_a_bond_that_slides_back_are_those_of_a_solution():
    """The shear is larger than |w|, since the slip in w is against it."""
    scene = slid(LAWS["cohesive in shear"], motion=(0.06, 0.03, -0.055))
    scene.move(0.055, 0.032, -0.055)
    scene.problem.equations.linearization = EXACT
    # with less than the distance of a kink
    found = slopes(scene, steps=1e-4 * 0.5 ** np.arange(6))
    assert found["whole"] == pytest.approx(2.0, abs=0.1)


def hanging_over(law, cell, degree, roles, **options):
    """The upper block is pressed beyond an edge and a corner of the lower one, and slid."""
    options = {
        "offset": (0.57, 0.63, -0.003),
        "jiggle": 0.1,
        "upper": (4, 4, 1),
        "lower": (3, 3, 1),
        **options,
    }
    return slid(law, cell, degree, roles=roles, motion=(0.02, 0.01, -0.06), **options)


@pytest.mark.once
@pytest.mark.parametrize("law", ["frictionless", "Coulomb", "cohesive"])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_tangents_of_partly_covered_facets(cell, degree, law):
    for roles in ROLES:
        scene = hanging_over(LAWS[law], cell, degree, roles)
        assert 0 < scene.contact.active.sum() < scene.contact.active.size
        assert_exact(scene)


@pytest.mark.once
@pytest.mark.parametrize("law", ["frictionless", "Coulomb", "cohesive"])
def test_tangents_of_quadratic_multipliers(law):
    pair = {"discretization": fm.Discretization(basis="quadratic")}
    assert_exact(slid(LAWS[law], "tetrahedron", 2, pair=pair))
    for roles in ROLES:
        # A place with no kink within the largest step of the check on one, two or three ranks.
        options = {"pair": pair, "offset": (0.53, 0.66, -0.003)}
        scene = hanging_over(LAWS[law], "tetrahedron", 2, roles, **options)
        assert 0 < scene.contact.active.sum() < scene.contact.active.size
        assert_exact(scene)


@pytest.mark.parametrize("preset", ["other_codes", "petrov_galerkin"])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_tangents_of_presets(cell, degree, preset):
    pair = {"discretization": preset}
    if (cell, degree) == KINDS[2] and preset == "petrov_galerkin":
        pytest.skip("needs dual multipliers")
    assert_exact(hanging_over(fm.Coulomb(0.3), cell, degree, ROLES[0], pair=pair))


@pytest.mark.once
@pytest.mark.parametrize(
    "options", [{"normals": "own"}, {"basis": "standard"}, {"basis": "linear"}, {"points": 12}]
)
def test_tangents_of_discretizations(options):
    degree = 2 if options.get("basis") == "linear" else 1
    pair = {"discretization": fm.Discretization(**options)}
    assert_exact(slid(fm.Coulomb(0.3), "hexahedron", degree, turn=TILTED, pair=pair))


@pytest.mark.serial
@pytest.mark.parametrize("cell, degree", KINDS)
def test_tangents_with_offsets_and_initial_gaps(cell, degree):
    pair = {"initial_gap": 0.01}
    scene = slid(None, cell, degree, pair=pair, motion=(0.03, 0.01, -0.08))
    assert np.abs(scene.contact.offset + 0.013).max() < 1e-12
    shape = np.sin(5.0 * scene.contact.positions[:, 0])
    scene.contact.offset = scene.contact.offset + 0.003 * shape
    scene.move(0.03, 0.01, -0.08)
    assert_exact(scene)


@pytest.mark.parametrize("law", ["frictionless", "Coulomb", "viscous"])
@pytest.mark.parametrize("cell, degree", KINDS)
def test_tangents_on_symmetry_planes(cell, degree, law):
    """Nodes on planes slide along them; that on both planes not at all.

    The master extends beyond the planes: edges of both sides that almost coincide would leave
    steps of a size of 1e-5 of a facet for the Taylor test.
    """
    sizes = ((0.8, 0.7, 0.5), (1.2, 1.2, 0.5))
    scene = stack(cell, degree, sizes=sizes, offset=(0.25, 0.2, -0.003), poisson=0.3).press()
    for component, side in enumerate(("left", "front")):
        scene.roll(f"upper/{side}", component)
    scene.set_up(LAWS[law], newton=SOLVED)
    scene.move(0.0, 0.0, -0.05)
    scene.move(0.0, 0.0, -0.06)
    assert_exact(scene)


@pytest.mark.once
def test_tangents_of_curved_surfaces():
    """Warped facets, whose planes differ."""
    scene = slid(None, "hexahedron", 1, motion=(0.05, 0.03, -0.05))
    X = scene.u.function_space.tabulate_dof_coordinates()
    scene.u.x.array[2::3] += 0.03 * np.sin(3.0 * X[:, 0]) * np.cos(2.0 * X[:, 1])
    assert_exact(scene)


def test_derivatives_with_standard_functions_are_reproducible():
    """They were once computed from memory that was not set."""
    pair = {"discretization": fm.Discretization(basis="standard")}
    scene = slid(fm.Coulomb(0.3), "hexahedron", 1, pair=pair)
    contact, found = scene.problem.equations.contacts[0], []
    for _ in range(200):
        contact.evaluation._recent.clear()
        contact.evaluate(scene.u.x.array, scene.problem.equations.linearization)
        blocks = contact.operators.vector_derivative(contact.operators.x)
        found.append(np.concatenate([block.values.ravel() for block in blocks]))
    assert all(np.array_equal(values, found[0]) for values in found)


@pytest.mark.parametrize("cell, degree", KINDS)
def test_tangents_of_ties(cell, degree):
    scene = stack(cell, degree, poisson=0.3, turn=TILTED).press().set_up(tie=True, newton=SOLVED)
    scene.move(0.05, 0.02, -0.1)
    assert_exact(scene)


@pytest.mark.parametrize("cell, degree", KINDS)
def test_operators_near_some_nodes_have_the_derivatives_there(cell, degree):
    """Those of whole rows of the nodes; without nodes there are no facets."""
    scene = hanging_over(LAWS["Coulomb"], cell, degree, ROLES[0])
    contact = scene.problem.equations.contacts[0]
    o, z = contact.operators, contact.z
    nodes = np.zeros(len(o.x), bool)
    nodes[contact.active_nodes[:2]] = True
    near = o.near(nodes)
    assert len(near.facet_nodes) < len(o.facet_nodes) or o.slave.comm.size > 1
    assert len(o.near(np.zeros_like(nodes)).facet_nodes) == 0

    def row_sums(operators):
        sums = np.zeros(len(o.x))
        blocks = [*operators.gap_derivative(), *operators.weight_derivative()]
        for rows, columns, values in blocks:
            at = np.where(columns >= 0, np.sin(columns.astype(float)), 0.0)
            np.add.at(sums, rows, np.einsum("bjq,bq->bj", values, at))
        return o.slave.comm.allreduce(sums)[nodes]

    whole = row_sums(o)
    np.testing.assert_allclose(row_sums(near), whole, rtol=1e-12, atol=1e-14)
    only = np.where(nodes[:, None], z, 0.0)
    for of_all, of_some in zip(o.force_derivative(only), near.force_derivative(only), strict=True):
        assert np.isclose(*(np.abs(block.values).sum() for block in (of_all, of_some)), rtol=1e-12)
