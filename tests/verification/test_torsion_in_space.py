# SPDX-License-Identifier: MIT
"""Moments of friction and of twist in space against closed forms; a bar that is cut and turned."""

import numpy as np
import pytest

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.space import torsion
from demos.studies.space.half_spaces import KINDS
from meshes.mapped_boxes import Box, mapped, mesh

HEXAHEDRA, QUADRATIC, TETRAHEDRA = KINDS
pytestmark = pytest.mark.serial


@pytest.mark.once
@pytest.mark.parametrize("kind", [HEXAHEDRA, QUADRATIC], ids=lambda kind: kind.name)
def test_a_ring_that_is_spun(kind):
    """M = 2/3 mu F (b^3 - a^3) / (b^2 - a^2), whatever the mesh; strains are 1e-3."""
    error, iterations = torsion.ring(kind, 3)
    assert abs(error) < 1e-5 and iterations <= 3


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_twist_of_a_bar_with_a_tied_cut_converges_as_that_of_one_bar(kind):
    coarse, fine = (torsion.bar(kind, n)[0] for n in (2, 4))
    whole = torsion.bar(kind, 4, cut=False)[0]
    rate = 1.7 if kind.degree == 1 else 2.7
    assert np.log2(abs(coarse / fine)) > rate
    assert abs(fine) < 1.6 * abs(whole)


@pytest.mark.once
def test_forces_across_openings_are_told():
    """The facets beside the contact have lengths of one and five contact radii."""
    problem, ball = torsion.sphere_on_half_space(HEXAHEDRA, 6)
    certificate = problem.solve().certificate
    assert ball.reaction[2] > 2.0 * torsion.FORCE
    assert any("where the surfaces are apart" in remark for remark in certificate.remarks())
    problem, ball = torsion.sphere_on_half_space(HEXAHEDRA, 9)
    assert problem.solve().certificate.remarks() == []
    assert ball.reaction[2] == pytest.approx(torsion.FORCE, rel=0.15)


def warped_cut(x, y):
    return 1.0 + 0.15 * np.sin(2.0 * x + 0.3) * np.cos(1.5 * y)


@pytest.mark.parametrize(("cell", "order"), [("hexahedron", 1), ("tetrahedron", 1)])
def test_a_bar_with_a_warped_cut_turns_without_forces(cell, order):
    """The sides of the cut do not fit; the tie keeps their places, turned by 90 degrees too."""

    def part(name, count, low, high):
        def position(s, t, r):
            x, y = s - 0.5, t - 0.5
            return x, y, low(x, y) + (high(x, y) - low(x, y)) * r

        return Box(name, mapped((count, count, count), position, order=order))

    flat = [lambda x, y, z=z: 0.0 * x + z for z in (0.0, 2.0)]
    boxes = [part("lower", 3, flat[0], warped_cut), part("upper", 4, warped_cut, flat[1])]
    data = mesh(boxes, cell=cell, order=order)
    V = fm.vector_space(data.mesh, 1)
    u, turned = fem.Function(V), fem.Function(V)
    energy = fm.energies.neo_hookean(u, *fm.energies.lame(1.0, 0.3))
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    problem = fm.ContactProblem(
        ufl.derivative(energy * dx, u, ufl.TestFunction(V)), u,
        [fm.TiedPair(data, "upper/bottom", "lower/top")],
        bcs=[fm.dirichlet(V, data, ["lower/bottom", "upper/top"], turned)],
        petsc_options_prefix="turned_",
    )  # fmt: skip
    problem.solve()
    turned.interpolate(lambda x: np.array([-x[1] - x[0], x[0] - x[1], 0.0 * x[0]]))
    u.x.array[:] = turned.x.array
    report = problem.solve()
    assert report.num_iterations <= 1
    force, moment, _ = problem.reaction("upper/top")
    assert np.abs(force).max() < 1e-11 and np.abs(moment).max() < 1e-11
