# SPDX-License-Identifier: MIT
"""Slip: by partners and by operators, objective, on obstacles, at edges and symmetry planes."""

import numpy as np
import pytest
from friction_scenes import MEASURES, MESH, NU, SMALL, E, block_on, blocks, drive
from scenes import TIGHT, internal, linear_elastic, neo_hookean, read, rectangles, rotation

from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid, mapped


@pytest.mark.once
@pytest.mark.parametrize("pair", MEASURES)
@pytest.mark.parametrize("degree", [1, 2])
def test_slip_by_operators_agrees_with_its_formula(degree, pair):
    """-tau . [(D - D_old) x - (M - M_old) x] per weight; that by partners is close to it.

    That is its part without the rotation of both sides relative to each other, see ``arcs``.
    """
    mesh = {**(MESH if degree == 1 else SMALL), "gap": 0.01}
    scene = blocks(fm.Coulomb(0.3), mesh=mesh, degree=degree, pair=pair)
    drive(scene, (0.0, -0.06), (0.05, -0.07))
    contact, u = scene.contact, scene.u.x.array
    old, faced = contact.operators, contact.covered
    contact.start_step()
    X = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    moved = 0.03 * np.sin(X @ [[1.0, 2.0], [3.0, 1.0]])
    u += (moved + np.where(X[:, 1:] > 1.005, [0.05, -0.01], 0.0)).ravel()
    contact.evaluate(u, scene.problem.equations.linearization)
    new, both = contact.operators, faced & contact.covered
    jump = new.jump(new.x, new.m) - old.jump(new.x, new.m)
    usual = -np.einsum("ja,ja->j", new.tau, jump)[both] / old.weight[both]
    partners = contact.partners
    vectors = partners.vectors(new)
    along = np.einsum("ja,ja->j", new.tau, vectors)
    along -= np.einsum("ja,ja->j", old.tau, partners.start)
    off, rotated = (
        np.abs(a[both] - usual).max() / np.abs(usual).max() for a in (along, contact.slip)
    )
    assert both.any()
    assert rotated < 1e-2
    assert off < 1e-13 if pair["slip"] == "operators" else 1e-6 < off < 1e-2


@pytest.mark.once
@pytest.mark.parametrize("pair", MEASURES)
@pytest.mark.parametrize("degree, angle", [(1, 1.0), (2, 1.0), (1, 3.0), (1, 5.0)])
def test_rigid_rotation_gives_no_slip(degree, angle, pair):
    """Two bodies with a curved, open interface beyond its ends; all turn by an angle."""
    scene = blocks(fm.Coulomb(0.3), degree=degree, pair=pair)
    drive(scene, (0.03, -0.05))
    contact, u = scene.contact, scene.u.x.array
    contact.start_step()
    X = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    x = X + u.reshape(-1, 2)
    u[:] = (x @ rotation(angle).T + [3.0, -2.0] - X).ravel()
    contact.evaluate(u, scene.problem.equations.linearization)
    assert np.abs(contact.slip).max() < 1e-13


def test_slip_on_an_obstacle_is_relative_to_its_material():
    """A plane that moves tangentially under a fixed block, and one that rotates with the block."""
    plane = fm.Plane((0.0, 0.0), (0.0, 1.0))
    problem, _ = block_on(plane, law=fm.Coulomb(0.3))
    plane.move(x=0.2)
    contact, u = problem.equations.contacts[0], problem.equations.bulk.u
    contact.start_step()
    contact.evaluate(u.x.array, problem.equations.linearization)
    # tau = (1, 0) for n = (0, -1): the block moves along -tau relative to the plane
    assert np.allclose(contact.slip, -0.2 * contact.operators.tau[:, 0], atol=1e-15)
    plane.move(x=0.0, angle=0.7)
    x = problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    u.x.array[:] = (x @ rotation(0.7).T - x).ravel()
    contact.evaluate(u.x.array, problem.equations.linearization)
    assert np.abs(contact.slip).max() < 1e-14


@pytest.mark.parametrize("pair", MEASURES)
def test_entering_nodes_slip_by_the_motion_of_their_material(pair):
    """A block slides over the edge of another: nodes without partners have the rigid slip."""
    scene = blocks(fm.Coulomb(0.3), mesh={**MESH, "offset": 1.8, "gap": 0.1}, pair=pair)
    contact = scene.contact
    uncovered = ~contact.covered
    assert uncovered.any()
    contact.start_step()
    X = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2]
    upper = X[:, 1] > 1.05
    moved = np.where(upper[:, None], [-0.4, 0.0], 0.0).ravel()
    for _ in range(2):
        contact.evaluate(moved, scene.problem.equations.linearization)
        contact.update_multiplier_nodes()
    assert (contact.covered & uncovered).any()
    assert np.abs(np.abs(contact.slip) - 0.4).max() < 1e-13


@pytest.mark.serial
def test_closing_arcs_do_not_slip():
    """Two mirrored arcs are flattened: by the slave's tangent they slip by gap times angle."""
    radius = 8.0
    boxes = {"upper": (-1.0, 0.001, 2.0, 0.2), "lower": (-1.0, -0.201, 2.0, 0.2)}
    data = read(rectangles, size=0.1, **boxes)
    x = data.mesh.geometry.x
    x[:, 1] += np.sign(x[:, 1]) * x[:, 0] ** 2 / (2 * radius)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("upper/top", "lower/bottom")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=fm.Coulomb(0.3))
    residual = internal(u, linear_elastic(u, E, NU))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="test_")
    contact = problem.equations.contacts[0]
    contact.start_step()
    X = V.tabulate_dof_coordinates()[:, :2]
    flat = np.zeros(X.shape)
    flat[:, 1] = -np.sign(X[:, 1]) * X[:, 0] ** 2 / (2 * radius)
    contact.evaluate(flat.ravel(), problem.equations.linearization)
    by_slave = np.abs(contact.slave.X[:, 0]) ** 3 / radius**2
    inside = contact.covered & (by_slave < 0.8 * by_slave.max())
    assert np.abs(contact.slip[inside]).max() < 0.1 * by_slave[inside].max()


def bowed_block_under_a_tool(half, degree):
    """Shears, pressures and slips right of x = 0 of a flat tool on a bowed block, or on its half.

    The master is the bowed one: its normals on the plane are not those of its last facet.
    """
    left, k = (0.0, 1) if half else (-1.0, 2)

    def block(columns, rows, width, low, high, bow):
        return mapped(
            columns * k,
            rows,
            lambda s, t: (
                width * (left + (1.0 - left) * s),
                low + (high - low) * t - bow * t * (width * (left + (1.0 - left) * s)) ** 2,
            ),
        )

    grids = [
        Grid("soft", block(4, 3, 1.0, 0.0, 0.6, 0.1)),
        Grid("tool", block(3, 2, 1.2, 0.62, 1.2, 0.0)),
    ]
    data = read(lambda: mapped_grids.build(grids))
    V = fm.vector_space(data.mesh, degree)
    u = fem.Function(V)
    bcs = [fm.dirichlet(V, data, "soft/bottom", (0.0, 0.0))]
    bcs += [fm.dirichlet(V, data, "tool/top", (0.0, -0.05))]
    bcs += [fm.dirichlet(V, data, f"{body}/left", 0.0, 0) for body in ("soft", "tool") if half]
    pair = fm.ContactPair(data, "tool/bottom", "soft/top", law=fm.Tresca(0.5))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="test_",
        newton=TIGHT,
    )  # fmt: skip
    problem.solve()
    contact = problem.equations.contacts[0]
    order = np.argsort(contact.slave.X[:, 0])
    order = order[contact.slave.X[order, 0] > -1e-9]
    return contact.z_tau[order], contact.pressure[order], contact.slip[order]


@pytest.mark.once
@pytest.mark.parametrize("degree", [1, 2])
def test_half_model_has_the_shears_and_slips_of_the_full_model(degree):
    """The remaining difference is the solver's tolerance."""
    (shear, pressure, slip), (half_shear, half_pressure, half_slip) = (
        bowed_block_under_a_tool(half, degree) for half in (False, True)
    )
    assert np.abs(shear).max() > 0.02 * pressure.max()
    assert np.abs(half_pressure - pressure).max() < 1e-9 * pressure.max()
    assert np.abs(half_shear - shear).max() < 1e-9 * pressure.max()
    assert half_slip[0] == 0.0
    assert np.abs(half_slip - slip).max() < 1e-9 * np.abs(slip).max()
