# SPDX-License-Identifier: MIT
"""Work of friction by slip and by motions, where nothing moves but for rounding."""

import numpy as np
import pytest
import space_scenes
from refusal import refused
from scenes import TIGHT, internal, linear_elastic
from turning_scenes import rollers

from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.contact import slip
from fenics_mortar.equations import turns
from meshes import mapped_boxes, mapped_grids
from meshes.mapped_boxes import Box, mapped
from meshes.mapped_grids import Grid, sector


def test_sticking_to_an_obstacle_at_rest_is_no_difference():
    """Nodes that stick move by rounding alone, as the slip: their ratio is no number."""
    arc = sector(12, 3, radii=(0.2, 0.5), angles=(1.1 * np.pi, 1.9 * np.pi))
    data = mapped_grids.mesh([Grid("tread", arc)])
    V = fm.vector_space(data.mesh, 1)
    u, push = fem.Function(V), fem.Constant(data.mesh, (0.0, 0.0))
    ground = fm.Plane((-0.5, -0.5), (0.0, 1.0), name="ground")
    problem = fm.ContactProblem(
        internal(u, linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "tread/bottom", ground, law=fm.Coulomb(0.9))],
        bcs=[fm.dirichlet(V, data, "tread/top", push)], petsc_options_prefix="tread_", newton=TIGHT,
    )  # fmt: skip
    for depth in (0.03, 0.032, 0.034):
        push.value[1] = -depth
        certificate = problem.solve().certificate
        assert certificate.pairs[0]["friction_work"].value < 1e-3
    contact = problem.equations.contacts[0]
    assert contact.active.sum() == 3 and abs(contact.z_tau).max() > 0.01
    assert abs(contact.slip[contact.active]).max() < 1e-12


def lead_nothing(monkeypatch):
    """Count slip from the start of the step, not from where motions lead the nodes."""
    for module in (turns, slip):
        monkeypatch.setattr(module, "lead", lambda pair, *_: np.zeros(pair.slave.num_nodes))


@pytest.mark.parametrize("per_turn", [8, 16])
@pytest.mark.parametrize("ratio", [-1.0, -1.02])
def test_rolling_tyres_with_slip_of_unknown_direction_are_refused(ratio, per_turn, monkeypatch):
    """The way before nodes meet is many times the slip of tyres that roll on each other.

    Supports and the solution tell the turns of these tyres; here they are not asked.
    """
    problem, left, right = rollers(fm.Coulomb(0.2))
    right.move(x=-0.02)
    problem.solve()
    start = problem.state()
    left.move(angle=2.0 * np.pi / per_turn)
    right.move(x=-0.02, angle=ratio * 2.0 * np.pi / per_turn)
    assert problem.solve().certificate.pairs[0]["approach_slip"].verdict == "ok"
    places = left.place.copy(), right.place.copy()
    problem.restore(start)
    left.move(angle=places[0][2])
    right.move(x=-0.02, angle=places[1][2])
    lead_nothing(monkeypatch)
    with refused(fm.NotConvergedError, "direction of friction is unknown: take smaller steps"):
        problem.solve()


@pytest.mark.parametrize(("per_turn", "told"), [(12, False), (12, True), (72, True)])
def test_rolling_tyres_in_space_are_judged(per_turn, told, monkeypatch):
    """As in the plane; of small steps the slip is known."""
    if not told or per_turn == 72:
        lead_nothing(monkeypatch)

    def tyre(name, start, centre):
        def position(s, t, r):
            radius, angle = 0.3 + 0.2 * t, start + 2 * np.pi * s
            return centre + radius * np.cos(angle), 0.1 * r, radius * np.sin(angle)

        return Box(name, mapped((36, 1, 1), position), closed=True)

    data = mapped_boxes.mesh([tyre("left", 0.05, 0.0), tyre("right", 0.0, 1.0)])
    scene = space_scenes.of(data)
    left, right = (
        fm.RigidBoundary(data, f"{name}/front", pivot=(x, 0.0, 0.0))
        for name, x in (("left", 0.0), ("right", 1.0))
    )
    pair = fm.ContactPair(data, "left/back", "right/back", law=fm.Coulomb(0.2))
    problem = scene.set_up([pair], remote=[left, right]).problem
    right.move(x=-0.02)
    problem.solve()
    angle = 2.0 * np.pi / per_turn
    left.move(angle=(0.0, angle, 0.0))
    right.move(x=-0.02, angle=(0.0, -angle, 0.0))
    if not told:
        with refused(fm.NotConvergedError, "direction of friction is unknown"):
            problem.solve()
    else:
        assert problem.solve().certificate.pairs[0]["approach_slip"].verdict == "ok"
