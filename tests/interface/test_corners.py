# SPDX-License-Identifier: MIT
"""Corners inside a slave surface: choice of the normal, and the resulting active sets."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_sight import Scene, at, whole

import fenics_mortar as fm
from fenics_mortar.interface.corners import SharpEdges
from meshes.mapped_grids import block


def arms(slave="left", mu=0.0, thickness=0.06, overlap=0.3, cells=9, **options):
    """An arm on another one, both clamped at their far ends, with whole outlines."""
    grids = [
        whole("left", block(14, 2, width=1.0, height=thickness, corner=(-1.0, -thickness))),
        whole("right", block(cells, 2, width=1.0, height=thickness, corner=(-overlap, 0.0))),
    ]
    pair = [slave, "right" if slave == "left" else "left"]
    law = fm.Coulomb(mu) if mu else fm.Frictionless()
    return Scene(
        grids, [pair], [(at(0, -1.0), None), (at(0, 1.0 - overlap), None)], law=law, **options
    )


BEFORE, AFTER, BOTH = 0, 1, -1
TIP = (-0.3, 0.0)


def chosen(scene, x=None, ends=None):
    """Facets at the corners of the slave, by their rounded positions in the mesh.

    With ``ends`` (m, 2, 2) of the master's facets, if not those of the scene.
    """
    slave, master, o = scene.contact.slave, scene.contact.master, scene.contact.operators
    x, m, edges = o.x if x is None else x, o.m, SharpEdges(slave)
    if ends is not None:
        m = np.reshape(ends, (-1, 2))
        master = SimpleNamespace(facets=np.arange(len(m)).reshape(-1, 2))
    sides = edges.choose(x, master, m, np.inf)
    at = zip(edges.nodes, sides, strict=True)
    return {tuple(np.round(slave.X[j], 6)): int(side) for j, side in at}


@pytest.mark.once
@pytest.mark.usefixtures("several_ranks")
def test_corners_that_lie_flat_take_the_normal_of_the_flat_facet():
    """The outline goes counter-clockwise: the lower side comes after the left end's corner."""
    scene = arms("right")
    found = chosen(scene)
    assert len(found) == 4
    assert found[TIP] == AFTER
    n = scene.contact.operators.n[np.isclose(scene.contact.slave.X, TIP).all(axis=1)]
    assert n[0] == pytest.approx([0.0, -1.0], abs=1e-12)


@pytest.mark.parametrize(
    "degrees, facet",
    [(0, AFTER), (15, AFTER), (30, BOTH), (45, BOTH), (60, BOTH), (75, BEFORE), (90, BEFORE)],
)
def test_the_nearest_of_three_normals_is_taken(degrees, facet):
    """A square corner above a flat, turned about it."""
    scene = arms("right")
    slave, X = scene.contact.slave, scene.contact.slave.X
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x = (X - TIP) @ turn.T + TIP + [0.0, 1e-3]
    assert chosen(scene, x)[TIP] == facet
    links, alone = SharpEdges(slave).links(np.full(4, BOTH))
    assert not alone.any() and np.array_equal(links, (slave.previous, slave.following))


@pytest.mark.parametrize("degrees, facet", [(34, BOTH), (39, BOTH), (41, AFTER), (62, AFTER)])
def test_a_corner_that_is_pressed_blunt_takes_the_average(degrees, facet):
    """Whichever facet the master, dented below the corner, happens to face."""
    scene = arms("right")
    c = scene.contact
    j = np.flatnonzero(np.isclose(c.slave.X, TIP).all(axis=1))
    x, half = c.operators.x.copy(), np.radians(degrees / 2)
    x[c.slave.previous[j]] = x[j] + 0.01 * np.array([-np.cos(half), np.sin(half)])
    x[c.slave.following[j]] = x[j] + 0.01 * np.array([np.cos(half), np.sin(half)])
    slope = 0.6 * half
    along = np.array([np.cos(slope), np.sin(slope)])
    below = x[j][0] - [0.0, 1e-4]
    assert chosen(scene, x, [[below + along, below - along]])[TIP] == facet


def test_a_facet_between_corners_keeps_its_partner_if_one_of_them_takes_its_normal():
    """The end of a bar of one cell: each corner by itself, and both."""
    bar = whole("bar", block(5, 1, width=1.0, height=0.1, corner=(0.0, 0.0)))
    ground = whole("ground", block(5, 1, width=1.0, height=0.1, corner=(0.0, -0.1)))
    slave = Scene([bar, ground], [("bar", "ground")], [(at(1, -0.1), None)]).contact.slave
    edges = SharpEdges(slave)
    x = slave.X[edges.nodes]
    low, high = (np.flatnonzero(np.isclose(x, (1.0, y)).all(axis=1))[0] for y in (0.0, 0.1))
    end = np.isclose(slave.X[slave.facets][:, :, 0], 1.0).all(axis=1)
    cases = (BEFORE, AFTER, True), (AFTER, AFTER, False), (BEFORE, BEFORE, False)
    for chosen_low, chosen_high, alone in cases:
        sides = np.full(edges.nodes.size, BOTH)
        sides[low], sides[high] = chosen_low, chosen_high
        (previous, following), found = edges.links(sides)
        assert found[end].all() == alone
        for j, side in zip(edges.nodes, sides, strict=True):
            assert (previous[j] == -1, following[j] == -1) == (side == AFTER, side == BEFORE)


def test_a_corner_between_two_walls_keeps_its_averaged_normal():
    """Both parts of the master are equally near: no facet is preferred."""
    scene = arms("right")
    walls = [[(1.0, 0.0), TIP], [TIP, (-0.3, 1.0)]]
    assert chosen(scene, ends=walls)[TIP] == BOTH
    assert chosen(scene, ends=walls[:1])[TIP] == AFTER


@pytest.mark.once
@pytest.mark.parametrize("slave", ["left", "right"])
@pytest.mark.parametrize("mu", [0.0, 0.2])
@pytest.mark.parametrize("cells", [9, 12])
def test_arm_slides_over_arm_with_either_role(slave, mu, cells):
    """The tips lie on the flats at first, then press on them at an angle: no step is cut."""
    scene = arms(slave, mu, cells=cells)
    path = scene.follow([(0.0, 0.0), (0.0, -0.12)], 6)
    assert path.num_cuts == 0
    assert path.steps[-1].report.certificate.violations() == []


def test_the_tangent_at_a_corner_is_exact():
    scene = arms("right", 0.2)
    scene.move(1, 0.0, -0.01)
    scene.problem.solve()
    slopes = scene.problem.check_tangent().slopes
    assert min(slopes.values()) > 1.9
