# SPDX-License-Identifier: MIT
"""Contact of bodies of revolution against exact solutions.

Patch: u_r = (a - 1) r, u_z = (b - 1) z has constant strains. A cylinder under axial stretch b is
free at its side where P_rr = mu (a - 1/a) + lambda ln(a^2 b) / a = 0; the pressure is -P_zz / a^2.
"""

from itertools import product

import numpy as np
import pytest
import revolved
from revolved import cylinders, internal, on_axis
from scenes import TIGHT, pair_options, read
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.energies import lame
from meshes.mapped_grids import Grid, block, build

E, NU, STRETCH = 100.0, 0.3, 0.9
MATERIALS = [revolved.neo_hookean, revolved.linear_elastic]
# pressures are equal to round-off of the solution, some 1e-13, times the number of dofs' root
EXACT = 1e-11


def uniaxial(material):
    """Radial stretch and contact pressure under the axial stretch ``STRETCH``."""
    mu, lmbda = lame(E, NU)
    b = STRETCH
    if material is revolved.linear_elastic:
        a = 1 - NU * (b - 1)
        return a, -E * (b - 1) / a**2
    a = brentq(lambda a: mu * (a - 1 / a) + lmbda * np.log(a * a * b) / a, 0.9, 1.3, xtol=1e-15)
    return a, -(mu * (b - 1 / b) + lmbda * np.log(a * a * b) / b) / a**2


def homogeneous(material, stretches, names, data, sides, degree=1, pair=None, tie=False):
    """A problem with u = (stretches - 1) X prescribed on some boundaries, and that."""
    V = fm.vector_space(data.mesh, degree)
    u, exact = fem.Function(V), fem.Function(V)
    exact.interpolate(lambda X: np.stack([(s - 1) * x for s, x in zip(stretches, X)]))
    bcs = [fm.dirichlet(V, data, name, exact) for name in names]
    if "lower/left" not in names:
        bcs.append(on_axis(V, data, ["lower/left", "upper/left"]))
    contact = (fm.TiedPair if tie else fm.ContactPair)(data, *sides, **pair_options(pair))
    problem = fm.ContactProblem(
        internal(u, material(u, E, NU)), u, [contact], bcs=bcs, geometry="axisymmetric",
        newton=TIGHT, petsc_options_prefix="patch_",
    )  # fmt: skip
    return problem, exact


SLAVES = [["upper/bottom", "lower/top"], ["lower/top", "upper/bottom"]]
ENDS = ["lower/bottom", "upper/top"]


@pytest.mark.once
@pytest.mark.parametrize("degree, cell", product([1, 2], ["triangle", "quadrilateral"]))
@pytest.mark.parametrize("material", MATERIALS)
def test_axial_pressure_is_uniform(material, degree, cell):
    a, pressure = uniaxial(material)
    data = cylinders((5, 7), widths=(1.0, 1.0), bulge=False, cell=cell)
    choices = [{"basis": "dual"}, {"basis": "standard"}]
    if degree == 2:
        choices += [{"basis": "vertices"}, {"basis": "linear"}]
    for sides, choice in product(SLAVES, choices):
        problem, exact = homogeneous(material, (a, STRETCH), ENDS, data, sides, degree, choice)
        problem.solve()
        contact = problem.contacts[0]
        # On the axis the weight of a node is small: rounding over it is larger.
        assert np.abs(contact.pressure / pressure - 1).max() < 10 * EXACT
        size = np.pi * a**2 * pressure * (1 if sides[0] == "upper/bottom" else -1)
        assert contact.total_force[1] == pytest.approx(size, rel=EXACT)
        u = problem.equations.bulk.u
        assert np.abs(u.x.array - exact.x.array).max() < 1e-12


@pytest.mark.once
def test_all_round_pressure_passes_a_conical_interface():
    mu, lmbda = lame(E, NU)
    a = 0.95
    pressure = -(mu * (a - 1 / a) + 3 * lmbda * np.log(a) / a) / a**2
    grids = []
    for name, columns, start, stop in (("lower", 7, 0.0, 1.0), ("upper", 5, 1.0, 2.0)):
        r, t = np.meshgrid(np.linspace(0.4, 1.4, columns + 1), np.linspace(0, 1, 4), indexing="ij")
        slope = 0.3 * r * (t if name == "lower" else 1 - t)
        grids.append(Grid(name, np.stack([r, start + (stop - start) * t + slope], axis=2)))
    data = read(build, grids=grids, cell="triangle")
    names = [f"{body}/{side}" for body in ("upper", "lower") for side in ("left", "right")]
    for sides in SLAVES:
        problem, _ = homogeneous(revolved.neo_hookean, (a, a), [*names, *ENDS], data, sides)
        problem.solve()
        contact = problem.equations.contacts[0]
        z = contact.pressure[contact.multiplier_nodes]
        assert np.abs(z / pressure - 1).max() < EXACT


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
def test_tied_cylinders_deform_as_one(degree):
    a, _ = uniaxial(revolved.neo_hookean)
    data = cylinders((5, 7), widths=(1.0, 1.0), bulge=False)
    for sides in SLAVES:
        problem, exact = homogeneous(
            revolved.neo_hookean, (a, STRETCH), ENDS, data, sides, degree, tie=True
        )
        problem.solve()
        assert np.abs(problem.equations.bulk.u.x.array - exact.x.array).max() < 1e-12


# Press fit of tubes a < b < c in plane strain

A, B, C, INTERFERENCE = 1.0, 2.0, 3.0, 0.05
ELASTIC = {"inner": (300.0, 0.25), "outer": (100.0, 0.3)}


def pressed_on(count, material, *, overlap, sliding="finite"):
    """Pressure between two tubes with ``count`` quadratic cells over each wall."""
    problem = press_fit(count, material, overlap=overlap, sliding=sliding)
    pressure = problem.contacts[0].pressure
    assert np.ptp(pressure) < 1e-8 * pressure.mean()
    return float(pressure.mean())


def press_fit(count, material, *, overlap=False, sliding="finite"):
    """Two tubes in contact; the overlap is in the mesh or, by default, in the initial gap."""
    radii = {"inner": (A, B + INTERFERENCE * overlap), "outer": (B, C)}
    grids = [
        Grid(name, block(count, rows, width=R - r, height=0.1, corner=(r, 0.0)))
        for (name, (r, R)), rows in zip(radii.items(), (1, 2))
    ]
    data = read(build, grids=grids)
    V = fm.vector_space(data.mesh, 2)
    u, residual = fem.Function(V), 0
    dx = ufl.Measure("dx", subdomain_data=data.cell_tags, metadata={"quadrature_degree": 5})
    for name, values in ELASTIC.items():
        residual += internal(u, material(u, *values), dx(data.body_tag(name)))
    names = [f"{body}/{side}" for body in radii for side in ("bottom", "top")]
    gap = None if overlap else -INTERFERENCE
    pair = fm.ContactPair(data, "inner/right", "outer/left", initial_gap=gap, sliding=sliding)
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=[fm.dirichlet(V, data, names, 0.0, component=1)],
        geometry="axisymmetric", newton=TIGHT, petsc_options_prefix="fit_",
    )  # fmt: skip
    problem.solve()
    return problem


# Rounding of 128 cells over the wall, 128^2 times that of a number: by the processor's BLAS and by
# distributed factors 1e-12 to 2e-11.
ROUNDED = 5e-11


def lame_pressure():
    """Pressure of the press fit by linear elasticity, small against the radii."""
    compliance = 0.0
    for (E_, nu), sign, (r, R) in zip(ELASTIC.values(), (-1, 1), ((A, B), (B, C))):
        E_, nu = E_ / (1 - nu**2), nu / (1 - nu)
        compliance += ((R**2 + r**2) / (R**2 - r**2) + sign * nu) / E_
    return INTERFERENCE / (B * compliance)


def exact_pressure():
    """Pressure of the press fit at finite strain: radial equilibrium of both tubes, by shooting.

    With stretches p = r', q = r / R: P_rr' = (P_tt - P_rr) / R.
    """
    inner, outer = ELASTIC.values()

    def stresses(p, q, values):
        mu, lmbda = lame(*values)
        log = lmbda * np.log(p * q)
        return mu * (p - 1 / p) + log / p, mu * (q - 1 / q) + log / q

    def stretch(q, radial, values):
        """p for a radial stress."""
        return brentq(lambda p: stresses(p, q, values)[0] - radial, 0.3, 3.0, xtol=1e-15)

    def wall(r, p, radii, values):
        """r and p outside of a wall by those inside."""

        def slope(R, y):
            q, (mu, lmbda) = y[0] / R, lame(*values)
            P_r, P_t = stresses(y[1], q, values)
            by_p = mu * (1 + 1 / y[1] ** 2) + lmbda * (1 - np.log(y[1] * q)) / y[1] ** 2
            by_q = lmbda / (y[1] * q)
            return y[1], ((P_t - P_r) / R - by_q * (y[1] - q) / R) / by_p

        found = solve_ivp(slope, radii, (r, p), method="DOP853", rtol=3e-14, atol=1e-15)
        return found.y[:, -1]

    def fit(q):
        """Pressure, and the stress left outside, by the hoop stretch inside."""
        r, p = wall(q * A, stretch(q, 0.0, inner), (A, B + INTERFERENCE), inner)
        R = B + INTERFERENCE
        cauchy = stresses(p, r / R, inner)[0] * R / r
        start = r, stretch(r / B, cauchy * r / B, outer)
        r, p = wall(*start, (B, C), outer)
        return -cauchy, stresses(p, r / C, outer)[0]

    return fit(brentq(lambda q: fit(q)[1], 0.97, 1.0, xtol=1e-15))[0]


@pytest.mark.once
def test_press_fit_of_tubes_agrees_with_lame():
    """The error of displacements of degree 2 is of fourth order in nodal forces."""
    counts, exact = (4, 8, 128), lame_pressure()
    options = {"overlap": False, "sliding": "small"}
    errors = [pressed_on(n, revolved.linear_elastic, **options) / exact - 1 for n in counts]
    assert np.log2(errors[0] / errors[1]) > 3.7
    assert abs(errors[2]) < ROUNDED


@pytest.mark.once
def test_press_fit_of_tubes_at_finite_strain():
    counts, exact = (4, 8, 128), exact_pressure()
    errors = [pressed_on(n, revolved.neo_hookean, overlap=True) / exact - 1 for n in counts]
    assert np.log2(errors[0] / errors[1]) > 3.7
    assert abs(errors[2]) < ROUNDED
