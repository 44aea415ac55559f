# SPDX-License-Identifier: MIT
"""Bodies may overlap by as much as a soft layer admits, also by several facets."""

import numpy as np
import pytest
from scenes import read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import neo_hookean
from fenics_mortar.energies import lame
from fenics_mortar.laws import SoftLayer
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, sector

DEPTH = 0.3


def pressed(shape, sides, *, stiffness, law):
    """A stiff body pressed 0.3 into a wide block with facets of 0.08 and a soft layer."""
    upper = {
        "block": Grid("upper", block(8, 4, width=1.0, height=0.5, corner=(-0.5, 0.0))),
        "disk": Grid("upper", sector(24, 3, radii=(0.3, 0.6), centre=(0.0, 0.6)), closed=True),
    }[shape]
    lower = Grid("lower", block(24, 6, width=2.0, height=0.6, corner=(-1.0, -0.6)))
    data = read(mapped_grids.build, grids=[upper, lower])
    V = fm.vector_space(data.mesh, 1)
    u, v, push = fem.Function(V), ufl.TestFunction(V), fem.Constant(data.mesh, (0.0, 0.0))
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    residual = ufl.inner(neo_hookean(u, *lame(stiffness, 0.3)), ufl.grad(v)) * dx
    fixed = fm.dirichlet(V, data, "lower/bottom", np.zeros(2))
    moved = fm.dirichlet(V, data, "upper/top", push)
    pair = fm.ContactPair(data, *sides, law=law)
    problem = fm.ContactProblem(
        residual, u, [pair], bcs=[fixed, moved], petsc_options_prefix="soft_"
    )

    def load(time):
        push.value[1] = -DEPTH * time

    return problem, load


@pytest.mark.parametrize("shape", ["block", "disk"])
@pytest.mark.parametrize("swapped", [False, True])
def test_deep_layer_is_no_crossing(shape, swapped):
    """3.6 facets: master nodes, and those of other sides of the slave, are in the layer, too."""
    sides = ["upper/bottom", "lower/top"][:: -1 if swapped else 1]
    problem, load = pressed(shape, sides, stiffness=100.0, law=SoftLayer(0.5, 1.0))
    record = fm.follow_path(problem, load, fm.SteppingOptions(step=0.25, smallest=0.25))
    assert len(record.steps) == 4
    crossings = problem.certificate().crossings
    assert max((crossing.facets for crossing in crossings), default=0.0) < 0.1
    assert np.nanmin(problem.contacts[0].gap) == pytest.approx(-DEPTH, abs=5e-3)


def test_bodies_deeper_than_their_layer_cross():
    """The disk is put 0.3 deep into the block, by hand, and the layer admits 0.01."""
    problem, _ = pressed("disk", ["lower/top", "upper/bottom"], stiffness=1.0, law=fm.Coulomb(0.1))
    bulk, contact = problem.equations.bulk, problem.equations.contacts[0]
    high = bulk.space.V.tabulate_dof_coordinates()[:, 1] > 0.0
    bulk.u.x.array[bulk.space.dofs[high, 1]] = -DEPTH
    contact.offset = np.full(contact.slave.num_nodes, -0.01)
    (crossing,) = problem.certificate().crossings
    assert crossing.facets > 1.0
