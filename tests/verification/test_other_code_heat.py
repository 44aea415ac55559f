# SPDX-License-Identifier: MIT
"""Heat across contact by pressure, against published numbers of two other codes.

4C, tests/input_files/tsi_contact3D_conduction: a cube of 2 x 2 x 2 hexahedra is pressed on one of
3 x 3 x 3, with large strains and h = 5 p; its conductivity is per undeformed volume.

MOOSE, modules/combined, gap_heat_transfer_mortar/small-2d: a block of steel pressed on one of
aluminium, with h = 2 k_s k_a / (k_s + k_a) p (p in Pa) at a pressure of about 1 Pa. Temperatures of
both sides of the contact after each of four steps; nothing flows across it in the first one.
"""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import elastic_strain, lame, linear_elastic, stress
from meshes import mapped_boxes
from meshes.mapped_boxes import Box
from meshes.mapped_grids import Grid, block, mesh

# [K], of aluminium and steel.
PUBLISHED = np.array(
    [
        [274.54218894081, 596.09071419843],
        [279.79845747129, 482.1971190453],
        [277.73745580107, 465.58479574915],
        [277.00159201603, 460.42385174134],
    ]
)
# The other code counts positions from the left end of the steel: a rounding of 1e-16 m is 6e-6 of
# its displacement of 1.8e-11 m, and 6.1e-7 of a temperature. Here bodies are more compliant by
# SOFTER, with the same pressure: rounding is 4e-10 of the displacement, areas change by 1e-8.
SOFTER = 1e3
# By name: E [Pa], nu, conductivity [W/m/K], capacity per volume [J/m^3/K].
MATERIALS = {"steel": (193e9, 0.29, 16.2, 4000.0), "aluminium": (68e9, 0.36, 210.0, 2430.0)}


pytestmark = pytest.mark.serial


def test_temperatures_between_cubes_are_those_published():
    lower = Box("lower", mapped_boxes.block((3, 3, 3), corner=(0.5, 0.5, -0.5)))
    upper = Box("upper", mapped_boxes.block((2, 2, 2), corner=(0.5, 0.5, 0.5)))
    data = mapped_boxes.mesh([lower, upper])
    W = fm.mixed_space(data.mesh, ("Lagrange", 1, (3,)), ("Lagrange", 1))
    w, (v, q) = fem.Function(W), ufl.TestFunctions(W)
    u, T = ufl.split(w)
    F = ufl.Identity(3) + ufl.grad(u)
    first = F * 4000.0 * (F.T * F - ufl.Identity(3)) / 2.0  # nu = 0
    flow = 52.0 * ufl.inv(F.T * F) * ufl.grad(T)
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    residual = (ufl.inner(first, ufl.grad(v)) + ufl.inner(flow, ufl.grad(q))) * dx
    heat = fm.Conductance(1, lambda p, g: (5.0 * p, 5.0 + 0.0 * p, 0.0 * p))
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", fluxes=[heat])
    bcs = []
    for side, depth, hot in (("lower/bottom", 0.0, 20.0), ("upper/top", 0.015, 40.0)):
        moved = enumerate((0.0, 0.0, -depth))
        bcs += [fm.dirichlet(W.sub(0), data, side, value, i) for i, value in moved]
        bcs += [fm.dirichlet(W.sub(1), data, side, hot)]
    problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="cubes_")
    problem.solve()
    below, above = at_contact(w, [16, 9], axis=2, at=0.5)
    assert below == pytest.approx(28.4892531639532720, rel=1e-12)
    assert above == pytest.approx(31.5107468360475238, rel=1e-12)


def test_temperatures_on_both_sides_of_a_contact_are_those_published():
    left, right = (block(40, 1, width=1.0, height=0.5, corner=(x, 0.0)) for x in (-1.0, 0.0))
    data = mesh([Grid("steel", left), Grid("aluminium", right)])
    W = fm.mixed_space(data.mesh, ("Lagrange", 1, (2,)), ("Lagrange", 1))
    w, before, (v, q) = fem.Function(W), fem.Function(W), ufl.TestFunctions(W)
    (u, T), T_before = ufl.split(w), ufl.split(before)[1]
    for state in (w, before):
        state.sub(1).interpolate(lambda x: np.full(x.shape[1], 525.0))
    dx, residual = ufl.Measure("dx", domain=data.mesh, subdomain_data=data.cell_tags), 0
    for name, (E, nu, k, capacity) in MATERIALS.items():
        elastic = stress(linear_elastic, elastic_strain(u), *lame(E / SOFTER, nu))
        form = ufl.inner(elastic, elastic_strain(v)) + k * ufl.inner(ufl.grad(T), ufl.grad(q))
        form += capacity * (T - T_before) / 60.0 * q
        residual += form * dx(data.bodies[name], degree=3)
    flows = fem.Constant(data.mesh, 0.0)
    k_s, k_a = MATERIALS["steel"][2], MATERIALS["aluminium"][2]

    def conductance(p, g):
        slope = float(flows.value) * 2.0 * k_s * k_a / (k_s + k_a)
        return slope * p, slope + 0.0 * p, 0.0 * p

    pair = fm.ContactPair(
        data, "aluminium/left", "steel/right", fluxes=[fm.Conductance(1, conductance)]
    )
    sides = [(0, "steel/bottom", 0.0, 1), (0, "aluminium/bottom", 0.0, 1)]
    sides += [(0, "steel/left", 1.8e-11 * SOFTER, 0), (0, "aluminium/right", 0.0, 0)]
    sides += [(1, "steel/left", 800.0), (1, "aluminium/right", 250.0)]
    bcs = [fm.dirichlet(W.sub(part), data, *side) for part, *side in sides]
    problem = fm.ContactProblem(residual, w, [pair], bcs=bcs, petsc_options_prefix="published_")
    found = []
    for _ in PUBLISHED:
        problem.solve()
        before.x.array[:] = w.x.array
        found.append([here.mean() for here in at_contact(w, [2, 2])])
        flows.value = 1.0
    assert np.array(found) == pytest.approx(PUBLISHED, rel=7e-7)


def at_contact(w, counts, axis=0, at=0.0):
    """Temperatures of the colder and the hotter side, at their numbers of nodes at the contact."""
    T = w.sub(1).collapse()
    values = T.x.array[np.abs(T.function_space.tabulate_dof_coordinates()[:, axis] - at) < 1e-9]
    return np.split(np.sort(values), np.cumsum(counts)[:-1])
