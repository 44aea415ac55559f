# SPDX-License-Identifier: MIT
"""Paths that turn where a node closes, as stated in the message at their end."""

import numpy as np
import pytest
from scenes import internal, neo_hookean, read

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.path.stepping import describe_turning_point
from meshes import mapped_grids
from meshes.mapped_grids import Grid, mapped

TURNS, PITCH, THICKNESS, PUSH = 2.0, 0.1, 0.04, 0.15


def spiral(s, t):
    """A strip wound twice; s along it, t from its outer to its inner side."""
    angle = 2.0 * np.pi * TURNS * s
    r = 0.4 + PITCH * angle / (2.0 * np.pi) + THICKNESS * (1.0 - t)
    return r * np.cos(angle), r * np.sin(angle)


def pushed_spiral():
    """The inner end is clamped, the outer one pushed inwards; the function sets the push."""
    data = read(mapped_grids.build, grids=[Grid("s", mapped(80, 2, spiral))], cell="quadrilateral")
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Function(V)
    inner = fem.locate_dofs_geometrical(V, lambda x: np.hypot(*x[:2]) < 0.4 + 0.5 * THICKNESS)
    end = 0.4 + PITCH * TURNS - 1e-9
    outer = fem.locate_dofs_geometrical(V, lambda x: np.hypot(*x[:2]) > end)
    bcs = [fem.dirichletbc(np.zeros(2), inner, V), fem.dirichletbc(push, outer)]
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, 1e4, 0.3)),
        u,
        [fm.ContactPair(data, "s/top", "s/bottom", law=fm.Coulomb(0.3))],
        bcs=bcs,
        petsc_options_prefix="spiral_",
    )

    def set_push(time):
        push.interpolate(lambda x: np.outer((-PUSH * time, 0.0), np.ones(x.shape[1])))

    return problem, set_push


@pytest.mark.serial
def test_turning_point_at_the_end_of_a_path_is_reported():
    """Two windings touch in one node, whose normal is not that of the facet opposite.

    Under pressure it would move further into it, since the strip is displaced along itself.
    """
    problem, set_push = pushed_spiral()
    fm.follow_path(problem, set_push, fm.SteppingOptions(0.25), stop=0.75)
    steps = fm.SteppingOptions(1 / 32, smallest=1 / 128)
    message = "linearized at the last one, has a turning point where the node at"
    with pytest.raises(fm.NotConvergedError, match=message) as error:
        fm.follow_path(problem, set_push, steps, start=0.75)
    assert message in error.value.report.dead_end
    before = problem.state()
    set_push(error.value.report.steps[-1].time - 1e-2)
    assert describe_turning_point(problem) == ""
    assert np.array_equal(problem.state().u, before.u)
