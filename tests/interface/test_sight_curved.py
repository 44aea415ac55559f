# SPDX-License-Identifier: MIT
"""Search behind curved slave surfaces: tubes and spirals."""

import re

import numpy as np
import pytest
from scenes import internal, neo_hookean, nodal, read
from test_sight import E, Scene, at, whole

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact.view import describe_overlap
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, mapped, sector


def tubes(outlines, slave="inner", degree=1, **options):
    """A tube in a narrower one."""
    body = whole if outlines else Grid
    count = 24 * degree
    grids = [
        body("inner", sector(count, 2 * degree, radii=(0.9, 1.004)), closed=True),
        body("outer", sector(count, 2 * degree, radii=(1.0, 1.1)), closed=True),
    ]
    names = {"inner": "inner/bottom", "outer": "outer/top"}
    pair = [slave, "outer" if slave == "inner" else "inner"]
    pair = pair if outlines else [names[name] for name in pair]
    axes = [lambda X: np.isclose(X[1], 0.0), lambda X: np.isclose(X[0], 0.0)]
    return Scene(grids, [pair], [(axes[0], 1), (axes[1], 0)], degree=degree, **options)


@pytest.mark.once
@pytest.mark.parametrize("slave", ["inner", "outer"])
@pytest.mark.parametrize("degree", [1, 2])
def test_tubes_with_whole_outlines_agree_with_chosen_sides(slave, degree):
    found = []
    for outlines in (True, False):
        scene = tubes(outlines, slave, degree)
        assert scene.problem.solve().certificate.violations() == []
        contact = scene.contact
        found.append((nodal(scene.problem), contact.pressure[contact.active].mean()))
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-11
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-8)
    assert found[0][1] > 1e-4 * E


@pytest.mark.once
@pytest.mark.parametrize("slave", ["spiral", pytest.param("wall", marks=pytest.mark.serial)])
def test_spiral_is_touched_by_a_wall_at_its_outer_winding_only(slave):
    """Two windings, and a wall whose back faces the inner ones through both of them."""

    def spiral(s, t):
        angle = 4.0 * np.pi * s
        r = 0.5 + 0.3 * angle / (2.0 * np.pi) + 0.1 * (1.0 - t)
        return r * np.cos(angle), r * np.sin(angle)

    x = mapped(64, 1, spiral)
    left = x[:, :, 0].min()
    wall = block(2, 12, width=0.1, height=1.2, corner=(left - 0.11, -0.57))
    pair = [slave, "wall" if slave == "spiral" else "spiral"]
    ends = [lambda X: np.hypot(X[0] - 0.55, X[1]) < 0.06, at(0, left - 0.11)]
    forces = []
    for radius in (None, 0.15):
        grids = [whole("spiral", x), whole("wall", wall)]
        fixed = [(ends[0], None), (ends[1], None)]
        scene = Scene(grids, [pair], fixed, search_radius=radius)
        assert scene.follow([(0, 0), (0.1, 0)], 5).num_cuts == 0
        contact = scene.contact
        assert (contact.slave.X[contact.active, 0] < left + 0.05).all()
        forces.append(contact.total_force)
    assert np.abs(forces[0]).max() > 1e-4
    assert forces[0] == pytest.approx(forces[1], rel=1e-8)


@pytest.mark.once
@pytest.mark.serial
def test_pressed_spiral_has_no_partners_on_its_own_back():
    """Windings overlap in iterates: the back of the outer one was taken for a partner."""

    def spiral(s, t):
        angle = 4.0 * np.pi * s
        r = 0.4 + 0.1 * angle / (2.0 * np.pi) + 0.04 * (1.0 - t)
        return r * np.cos(angle), r * np.sin(angle)

    data = read(mapped_grids.build, grids=[Grid("strip", mapped(80, 2, spiral))])
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Function(V)
    inner = fem.locate_dofs_geometrical(V, lambda x: np.hypot(x[0], x[1]) < 0.42)
    outer = fem.locate_dofs_geometrical(V, lambda x: np.hypot(x[0], x[1]) > 0.6 - 1e-9)
    bcs = [fem.dirichletbc(np.zeros(2), inner, V), fem.dirichletbc(push, outer)]
    pair = fm.ContactPair(data, "strip/top", "strip/bottom", law=fm.Coulomb(0.3))
    residual = internal(u, neo_hookean(u, 1e4, 0.3))
    problem = fm.ContactProblem(residual, u, [pair], bcs=bcs, petsc_options_prefix="wound_")

    def load(t):
        push.interpolate(lambda x: np.stack([np.full(x.shape[1], -0.13 * t), np.zeros(x.shape[1])]))

    fm.follow_path(problem, load, fm.SteppingOptions(step=0.1, smallest=1e-3))
    assert problem.certificate().violations() == []
    assert problem.contacts[0].active.any()


def test_deep_overlap_is_reported_with_the_search_radius():
    """Bodies meshed inside one another: the failure of Newton's method is described."""
    grids = [
        Grid("lower", block(16, 8, width=1.0, height=1.0, corner=(0.0, -1.0))),
        Grid("upper", block(12, 8, width=1.0, height=1.0, corner=(0.0, -0.45))),
    ]
    fixed = [(at(1, -1.0), None), (at(1, 0.55), None)]
    pair = "lower/top", "upper/bottom"
    scene = Scene(grids, [pair], fixed)
    scene.problem.equations.newton = fm.NewtonOptions(max_iterations=1)
    message = r"'lower/top' overlaps 'upper/bottom' by \d+\.\d facets; .* up to .* thick"
    try:
        scene.problem.solve()
    except fm.NotConvergedError:
        pass
    scene.u.x.array[:] = 0.0
    contact = scene.contact
    contact.evaluate(scene.u.x.array, scene.problem.equations.linearization)
    contact.change(active=contact.covered)
    assert re.search(message, describe_overlap(contact))
    assert re.search(message, scene.problem.equations.diagnose())
    (certificate,) = scene.problem.certificate().pairs
    (said,) = (v for v in certificate.violations() if "overlap" in v)
    assert re.search(r"at \(.*\), in facets; partners are searched up to", said)
