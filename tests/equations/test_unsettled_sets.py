# SPDX-License-Identifier: MIT
"""Active sets that do not converge, without floating bodies: sets of the linearized problem."""

import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, read, rectangles
from small_scenes import pushed_block, small_blocks

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.equations.linearized_contact import LinearizedContact, displacements
from fenics_mortar.obstacles.rigid_motion import RIGID
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block

THICKNESS, E = 0.01, 1e5


def plates(cell, law):
    """A thin plate that rests flat on another one, which is clamped at both ends; its push."""
    lower = block(48, 2, width=2.0, height=THICKNESS, corner=(-1.0, -THICKNESS))
    upper = block(30, 4, width=1.2, height=3 * THICKNESS, corner=(-0.5, 0.0))
    grids = [Grid("lower", lower), Grid("upper", upper)]
    data = read(mapped_grids.build, grids=grids, cell=cell, order=2)
    V = fm.vector_space(data.mesh, 2)
    u, push = fem.Function(V), fem.Function(V)
    loaded = fem.locate_dofs_geometrical(
        V, lambda x: np.isclose(x[1], 3 * THICKNESS) & (np.abs(x[0] - 0.1) < 0.3)
    )
    bcs = [fm.dirichlet(V, data, f"lower/{side}", (0.0, 0.0)) for side in ("left", "right")]
    pair = fm.ContactPair(data, "upper/bottom", "lower/top", law=law)
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, 0.3)),
        u,
        [pair],
        bcs=[*bcs, fem.dirichletbc(push, loaded)],
        petsc_options_prefix="plates_",
    )
    return problem, push


@pytest.mark.once
@pytest.mark.parametrize("mu", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_sets_of_touching_thin_plates_converge(cell, mu):
    """Bent plates open and close over wide parts simultaneously; the force grows with the push."""
    problem, push = plates(cell, fm.Coulomb(mu) if mu else None)
    forces = []
    for depth in (1e-6, 2e-6):
        push.interpolate(lambda x, d=depth: np.outer((0.0, -d), np.ones(x.shape[1])))
        report = problem.solve(predict=False)
        assert report.num_iterations <= 20
        forces.append(problem.contacts[0].forces[:, 1].sum())
    assert forces[0] > 0.0
    assert forces[1] / forces[0] == pytest.approx(2.0, rel=1e-3)  # a receding contact is linear


def test_no_linearized_problem_without_possible_contact():
    """No node can touch, as after a hook has snapped; this raised an error of numpy before."""
    scene = small_blocks()
    scene.loads["push"].value[1] = 1.0
    scene.problem.solve()
    e = scene.problem.equations
    assert not LinearizedContact(e).applies


def test_floating_body_moves_as_on_its_weakest_springs():
    """The factorized springs are stiffer by orders of magnitude; the rest is added for motions."""
    e = pushed_block().equations
    e.bulk.assemble_tangent()
    (body,) = e.floating.bodies
    motions = body.nodal_motions()
    forces = np.zeros((e.bulk.num_owned, len(motions)))
    forces[body.dofs.ravel()] = motions.T
    moves = displacements(e.bulk, e.floating, forces)
    weakest = RIGID.weakest_spring * body.stiffest / body.num_nodes
    assert np.abs(weakest * moves - forces).max(initial=0.0) < 1e-6


def test_multipliers_of_the_linearized_problem_are_those_of_small_loads():
    """A block of two tied parts pushed onto another, both parts supported."""
    data = read(
        rectangles,
        size=0.21,
        lower=(-0.5, 0.0, 1.0, 1.0),
        middle=(-0.4, 1.0, 0.8, 0.5),
        upper=(-0.4, 1.5, 0.8, 0.5),
    )
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, -1e-5))
    bcs = [fm.dirichlet(V, data, name, push) for name in ("middle/left", "upper/top")]
    bcs.append(fm.dirichlet(V, data, "lower/bottom", (0.0, 0.0)))
    pairs = [
        fm.ContactPair(data, "middle/bottom", "lower/top", law=fm.Coulomb(0.3)),
        fm.TiedPair(data, "middle/top", "upper/bottom"),
    ]
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u, pairs, bcs=bcs, petsc_options_prefix="tie_"
    )
    equations = problem.equations
    contact = equations.contacts[0]
    equations.evaluate(start=True)
    equations.bulk.assemble_tangent()
    linearized = LinearizedContact(equations)
    assert linearized.choose_sets(lambda: None)
    z = contact.z.copy()
    problem.solve()
    assert np.abs(contact.z).max() > 1e-4
    assert np.abs(contact.z - z).max() < 1e-4 * np.abs(z).max()
