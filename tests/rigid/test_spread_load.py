# SPDX-License-Identifier: MIT
"""Loads at a point that are spread over a boundary, which stays free to deform."""

import numpy as np
import pytest
from array_meshes import tagged
from refusal import COMM, refused
from remote_scenes import INNER, NU, OUTER, E, blocks, cylinder, ring
from scenes import TIGHT, internal, linear_elastic, neo_hookean

import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm

G = E / (2.0 * (1.0 + NU))
DX = ufl.dx(metadata={"quadrature_degree": 4})
TORSION = 4.0 * np.pi * G * INNER**2 * OUTER**2 / (OUTER**2 - INNER**2)


def test_torque_on_a_bore_is_a_uniform_shear():
    """The stress of a ring in torsion: the mean angle is that of a rigid bore."""
    problem, hub = ring(linear_elastic, load=fm.SpreadLoad)
    hub.push(moment=1e-5 * TORSION)
    report = problem.solve()
    assert hub.place[2] == pytest.approx(1e-5, rel=2e-4)
    assert any("spread load 'hub', " in note for note in report.notes)


def test_resultants_act_about_the_moved_pivot():
    """Reaction of the support at finite strain: force, and moment about the moved pivot."""
    problem, hub = ring(neo_hookean, load=fm.SpreadLoad, pivot=(3.0, 1.0))
    hub.push(x=20.0, y=-10.0, moment=60.0)
    report = problem.solve()
    residuals = report.residuals
    assert residuals[-1] < 1e-3 * residuals[-2] < 1e-6 * residuals[-3]
    about = hub.pivot + hub.place[:2]
    force, moment, _ = problem.reaction("ring/bottom", about=about, data=hub.data)
    assert force == pytest.approx((-20.0, 10.0), rel=1e-10)
    assert moment == pytest.approx(-60.0, rel=1e-9)
    assert np.abs(hub.place).max() > 0.02


def test_motion_is_work_conjugate_to_the_load():
    """Work along a path of three loads, by Simpson's rule, is the stored energy."""
    problem, hub = ring(neo_hookean, load=fm.SpreadLoad, pivot=(1.5, 0.5))
    loads, places = [], []
    for s in np.linspace(0.0, 1.0, 9):
        hub.push(x=20.0 * s, y=-10.0 * s**2, moment=60.0 * s)
        problem.solve()
        loads.append(hub.load.copy())
        places.append(hub.place.copy())
    by_place = np.gradient(np.array(places), 0.125, axis=0, edge_order=2)
    power = (np.array(loads) * by_place).sum(axis=1)
    weights = np.array([1, 4, 2, 4, 2, 4, 2, 4, 1]) / 24.0
    psi = fm.energies.neo_hookean(problem.equations.bulk.u, *fm.energies.lame(E, NU))
    stored = COMM.allreduce(fem.assemble_scalar(fem.form(psi * DX)))
    assert weights @ power == pytest.approx(stored, rel=2e-3)


def test_pivot_follows_the_mean_motion_over_turns():
    """A strip is turned by its left end under a force at a point that moves with its right end."""
    problem, grip, pull = strip()
    pull.push(x=0.03, y=-0.02, moment=0.01)
    for angle in np.linspace(0.0, 2.5 * np.pi, 26)[1:]:
        grip.move(angle=angle)
        problem.solve(accept_violations=True)
    force, arm = pull.load[:2], pull.pivot + pull.place[:2] - grip.pivot
    moment = pull.load[2] + arm[0] * force[1] - arm[1] * force[0]
    assert grip.reaction == pytest.approx((*-force, -moment), rel=1e-8)
    assert pull.place[2] == pytest.approx(2.5 * np.pi, abs=0.2)


@pytest.mark.each
@pytest.mark.parametrize("shared", [False, True])
def test_tangent_has_slopes_of_two(shared):
    """Also if some nodes belong to the rigid boundary as well."""
    names = ["upper/right", "upper/top"] if shared else "upper/right"
    problem, grip = blocks("upper/top", spread=names)
    grip.move(y=-0.03, angle=0.01)
    pull = problem.equations.motions.spread[0].motion
    pull.push(x=1.0, y=-2.0, moment=0.3)
    problem.solve()
    grip.push(y=-3.0, moment=0.2)
    slopes = problem.check_tangent(print_table=False).slopes
    assert min(slopes.values()) > 1.95, slopes


def test_tangent_without_any_contact_has_slopes_of_two():
    problem, hub = ring(neo_hookean, load=fm.SpreadLoad)
    hub.push(x=20.0, moment=60.0)
    problem.solve()
    slopes = problem.check_tangent(print_table=False).slopes
    assert set(slopes) == {"bulk", "whole"} and min(slopes.values()) > 1.95, slopes


def test_solves_with_the_tangent_contain_the_load():
    """The derivative of the state by the moment of a grip, against a difference quotient."""
    problem, grip = blocks("upper/top", spread="upper/right", law=fm.Frictionless())
    pull = problem.equations.motions.spread[0].motion
    pull.push(x=1.0, y=-1.0, moment=0.3)
    grip.push(y=-2.0, moment=0.1)
    problem.solve()
    place, step = grip.place.copy(), 1e-5
    rhs = fm.LinearVector(q=np.array([[0.0, 0.0, 1.0]]))
    forward = problem.linear_solve(rhs)
    backward = problem.linear_solve(fm.LinearVector(q=np.eye(3)[1:2]), transpose=True)
    assert backward.q[0, 2] == pytest.approx(forward.q[0, 1], rel=1e-8)
    grip.push(moment=0.1 + step)
    problem.solve()
    assert (grip.place - place) / step == pytest.approx(forward.q[0], rel=1e-3)


def test_axial_load_of_a_body_of_revolution():
    """Uniform over the end of a cylinder: mean axial motion, no moment."""
    problem, end = cylinder(load=fm.SpreadLoad)
    end.push(y=-2.0)
    problem.solve()
    force, _, _ = problem.reaction("bottom", data=end.data)
    assert force[1] == pytest.approx(2.0, rel=1e-10)
    assert end.place[1] < 0.0 == end.place[0] == end.place[2]
    end.push(moment=1.0)
    with refused(fm.MortarError, "pushed radially or turned"):
        problem.solve()


def test_errors():
    """Motions cannot be prescribed, and the error estimate refuses."""
    problem, hub = ring(load=fm.SpreadLoad)
    with refused(ValueError, "has no prescribed motion"):
        hub.move(x=1.0)
    with refused(fm.MortarError, "the error estimate is not implemented with remote loads"):
        problem.estimate()
    hub.load = np.full(3, np.nan)
    with refused(fm.MortarError, "load of spread load 'hub'"):
        problem.solve()


def strip():
    """A strip on a rigid left end, with a load at a point beside its right end."""
    grid = dmesh.create_rectangle(COMM, [(0.0, 0.0), (2.0, 0.4)], (20, 4))
    data = tagged(grid, left=lambda x: np.isclose(x[0], 0.0), right=lambda x: np.isclose(x[0], 2.0))
    u = fem.Function(fm.vector_space(grid, 1))
    grip = fm.RigidBoundary(data, "left", pivot=(-0.5, 0.2))
    pull = fm.SpreadLoad(data, "right", pivot=(2.0, 0.5))
    problem = fm.ContactProblem(
        internal(u, neo_hookean(u, E, NU)),
        u,
        [],
        remote=[grip, pull],
        newton=TIGHT,
        petsc_options_prefix="strip_",
    )
    return problem, grip, pull
