# SPDX-License-Identifier: MIT
"""Patch tests: a homogeneous state is reproduced across any interface up to rounding.

Uniaxial: two blocks of one material and width under a stretch, free sides. Finite strain: with
F = diag(a, b) of the compressible neo-Hookean law in plane strain, the side is free where
P_xx = mu (a - 1/a) + lambda ln(ab) / a = 0, and the pressure is -P_yy / a (Cauchy). Linear: the
stress acts on the undeformed, the multiplier on the deformed length, hence z = -sigma_yy / a.

Inclined interface: without friction it carries no uniaxial state, but it does carry all-round
pressure, F = a 1. Here the sides are prescribed as well, so the end nodes of the slave surface
carry no multiplier and hand their weight to their neighbours.
"""

from itertools import product

import numpy as np
import pytest
from scenes import (
    TIGHT,
    homogeneous_blocks,
    internal,
    linear_elastic,
    neo_hookean,
    pair_options,
    read,
    rotation,
)
from scipy.optimize import brentq

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from fenics_mortar.obstacles.rigid_motion import rotation_by
from meshes import two_blocks
from meshes.mapped_boxes import Box, mapped, mesh

E, NU, STRETCH = 100.0, 0.3, 0.9
RATIOS = [(4, 4), (5, 7), (3, 10), (1, 17)]
# pressures are equal to round-off of the solution, some 1e-13, times the number of dofs' root
EXACT = 1e-11


SLAVES = ("upper", "lower")
CELLS = ("triangle", "quadrilateral")


def half_of(*factors, skip=0):
    """Every second combination; the other half if ``skip`` is odd.

    With three factors all pairs of levels of two factors occur.
    """
    chosen = product(*(enumerate(factor) for factor in factors))
    return [
        tuple(level for _, level in each)
        for each in chosen
        if sum(number for number, _ in each) % 2 == skip % 2
    ]


def blocks(counts, angle):
    """Options of the mesh."""
    return {
        "n_upper": counts[0],
        "n_lower": counts[1],
        "layers_upper": 3,
        "layers_lower": 4,
        "rotation": np.radians(angle),
    }


def uniaxial(material):
    """Lateral stretch and contact pressure under the vertical stretch ``STRETCH``."""
    mu, lmbda = lame(E, NU)
    if material is linear_elastic:
        a = 1 - lmbda / (lmbda + 2 * mu) * (STRETCH - 1)
        stress = lmbda * (a - 1) + (lmbda + 2 * mu) * (STRETCH - 1)
        return a, -stress / a
    a = brentq(lambda a: mu * (a - 1 / a) + lmbda * np.log(a * STRETCH) / a, 0.9, 1.3, xtol=1e-15)
    return a, -(mu * (STRETCH - 1 / STRETCH) + lmbda * np.log(a * STRETCH) / STRETCH) / a


def assert_uniform(scene, pressure):
    contact = scene.contact
    z = contact.pressure[contact.multiplier_nodes]
    assert contact.active[contact.multiplier_nodes].all()
    assert np.abs(z / pressure - 1).max() < EXACT
    u, exact = scene.u.x.array, scene.loads["exact"].x.array
    assert np.abs(u - exact).max() < 1e-12


# several ranks: one general angle
TURNED = [
    (neo_hookean, 30),
    (linear_elastic, 30),
    *(pytest.param(neo_hookean, angle, marks=pytest.mark.serial) for angle in (0, 45, 90)),
]


@pytest.mark.once
@pytest.mark.parametrize("counts", RATIOS)
@pytest.mark.parametrize("material, angle", TURNED)
def test_uniaxial_pressure_is_uniform(material, angle, counts):
    a, pressure = uniaxial(material)
    turn = rotation(np.radians(angle))
    gradient = turn @ np.diag([a - 1, STRETCH - 1]) @ turn.T
    boundaries = ["lower/bottom", "upper/top"]
    for slave, cell in half_of(SLAVES, CELLS, skip=counts[0]):
        scene = homogeneous_blocks(
            gradient,
            boundaries,
            material=material,
            slave=slave,
            cell=cell,
            **blocks(counts, angle),
        )
        scene.problem.solve()
        assert_uniform(scene, pressure)


# one facet has no node inside, and the nodes at its ends are prescribed: two of them
@pytest.mark.once
@pytest.mark.parametrize("counts", [*RATIOS[:3], (2, 34)])
@pytest.mark.parametrize("material, angle", TURNED)
def test_all_round_pressure_passes_an_inclined_interface(material, counts, angle):
    mu, lmbda = lame(E, NU)
    a = 0.95
    pressure = -(mu * (a - 1 / a) + 2 * lmbda * np.log(a) / a) / a
    if material is linear_elastic:
        pressure = -2 * (mu + lmbda) * (a - 1) / a
    boundaries = [f"{body}/{side}" for body in SLAVES for side in ("left", "right")]
    for slave, cell in half_of(SLAVES, CELLS, skip=counts[0]):
        scene = homogeneous_blocks(
            (a - 1) * np.eye(2),
            [*boundaries, "lower/bottom", "upper/top"],
            material=material,
            slave=slave,
            cell=cell,
            inclination=np.radians(15),
            **blocks(counts, angle),
        )
        scene.problem.solve()
        assert_uniform(scene, pressure)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("integration", ["segments", "nodes"])
@pytest.mark.parametrize("angle", [0, 37])
def test_pressure_under_a_plane_is_uniform(angle, integration, degree):
    a, pressure = uniaxial(neo_hookean)
    turn = rotation(np.radians(angle))
    gradient = turn @ np.diag([a - 1, STRETCH - 1]) @ turn.T
    size = {"n_lower": 5, "layers_lower": 3, "width_lower": 1.0, "gap": 3.0}
    data = read(two_blocks.build, rotation=np.radians(angle), **size)
    V = fm.vector_space(data.mesh, degree)
    u, exact = fem.Function(V), fem.Function(V)
    exact.interpolate(lambda X: gradient @ X[:2])
    plane = fm.Plane(turn @ (0.5, STRETCH), turn @ (0.0, -1.0))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [fm.ContactPair(data, "lower/top", plane, **pair_options(integration=integration))],
        bcs=[
            fm.dirichlet(V, data, "lower/bottom", exact),
            fm.dirichlet(V, data, "upper/top", (0.0, 0.0)),
        ],
        newton=TIGHT,
        petsc_options_prefix="patch_",
    )
    problem.solve()
    z = problem.equations.contacts[0].pressure
    assert np.abs(z / pressure - 1).max() < EXACT


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("jiggle", [0.02, 0.1, 0.2])
def test_a_uniform_pressure_passes_jiggled_hexahedra(jiggle, degree):
    """In space, on a turned plane; facets are no parallelograms."""
    turned = rotation_by(np.array([0.4, -0.7, 0.2]))

    def box(counts, low, high, seed):
        def position(*parameters):
            x = (a + (b - a) * s for a, b, s in zip((0.0, 0.0, low), (1.0, 1.0, high), parameters))
            return np.einsum("ij,j...->i...", turned, np.array(np.broadcast_arrays(*x)))

        return mapped(counts, position, order=degree, jiggle=jiggle, seed=seed)

    boxes = [Box("lower", box((3, 2, 1), 0.0, 0.7, 1)), Box("upper", box((2, 3, 1), 0.7, 1.5, 2))]
    data = mesh(boxes, order=degree)
    V = fm.vector_space(data.mesh, degree)
    u, u_e = fem.Function(V), fem.Function(V)
    strain = turned @ np.diag([NU, NU, -1.0]) @ turned.T / E
    u_e.interpolate(lambda x: strain @ x)
    psi = fm.energies.linear_elastic(u, *lame(E, NU))
    residual = ufl.derivative(psi * ufl.dx(degree=2 * degree + 1), u, ufl.TestFunction(V))
    bcs = [fm.dirichlet(V, data, side, u_e) for side in ("lower/bottom", "upper/top")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top")
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="jiggled_")
    problem.solve()
    # per deformed area
    expected = 1.0 / (1.0 + NU / E) ** 2
    assert problem.contacts[0].pressure == pytest.approx(expected, rel=2.0 * EXACT)
