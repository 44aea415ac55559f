# SPDX-License-Identifier: MIT
"""Conditions on the axis of revolution: what is refused, and radial dofs."""

from mpi4py import MPI

import numpy as np
import pytest
from revolved import cylinders, on_axis, pressed_cylinders
from scenes import pressed_blocks

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.bulk.revolution import radial_dofs_on_axis


@pytest.mark.each
@pytest.mark.parametrize(
    "options, error",
    [
        ({"geometry": "spherical"}, "geometry='spherical': expected one of plane, axisymmetric"),
        ({"geometry": "axisymmetric", "thickness": 1.0}, "body of revolution is 2 pi r"),
        ({"thickness": -1.0}, "thickness=-1.0: expected a positive length"),
        ({"thickness": lambda X: 0.0 * X[:, 0]}, "not positive lengths"),
        ({"thickness": lambda X: X}, "of shape .* and type float64 for"),
        ({"geometry": "axisymmetric"}, "nodes have x < 0"),
    ],
)
def test_invalid_axisymmetric_problems_are_refused(options, error):
    with pytest.raises((ValueError, fm.MortarError), match=error):
        pressed_blocks(problem=options, n_upper=2, n_lower=3, rotation=0.1)


def test_a_free_axis_is_refused():
    with pytest.raises(fm.MortarError, match="nodes on the axis may move away"):
        pressed_cylinders(axis_is_prescribed=False)


def test_radial_dofs_on_the_axis():
    """Dofs of x at x = 0, not at y = 0."""
    space = pressed_cylinders().problem.equations.bulk.space
    X = space.V.tabulate_dof_coordinates()[: space.num_nodes]
    dofs = space.owned_dofs[np.abs(X[:, 0]) < 1e-12, 0]
    assert set(radial_dofs_on_axis(space)) == set(dofs)
    counts = MPI.COMM_WORLD.allreduce(np.array([dofs.size, (np.abs(X[:, 1]) < 1e-12).sum()]))
    assert counts.all() and counts[0] != counts[1]


def test_a_residual_without_the_radius_is_refused():
    """Plane bodies would be loaded by forces of bodies of revolution."""
    data = cylinders((3, 4))
    V = fm.vector_space(data.mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    pairs = [fm.ContactPair(data, "upper/bottom", "lower/top")]
    bcs = [on_axis(V, data, ["upper/left", "lower/left"])]
    given = {"bcs": bcs, "geometry": "axisymmetric", "petsc_options_prefix": "plane_"}
    work, dx = ufl.inner(ufl.grad(u), ufl.grad(v)), ufl.dx(metadata={"quadrature_degree": 2})
    with pytest.raises(ValueError, match="does not contain the radius.*2 \\* pi \\* X"):
        fm.ContactProblem(work * dx, u, pairs, **given)
    radius = ufl.SpatialCoordinate(data.mesh)[0]
    fm.ContactProblem(radius * work * dx, u, pairs, **given)
