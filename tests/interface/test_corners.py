# SPDX-License-Identifier: MIT
"""Corners inside a slave surface: choice of the normal, and the resulting active sets."""

import numpy as np
import pytest
from test_sight import Scene, at, whole

import fenics_mortar as fm
from fenics_mortar.interface.corners import choose_facets, corners_of, one_sided
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


def chosen(scene, x=None):
    """Facets at the corners of the slave, by their rounded positions in the mesh."""
    c = scene.contact
    corners = corners_of(c.slave)
    o = c.operators
    facets = choose_facets(
        c.slave, corners, o.x if x is None else x, o.m[c.master.facets[:, [0, -1]]]
    )
    return {tuple(np.round(c.slave.X[j], 6)): int(f) for j, f in zip(corners, facets, strict=True)}


@pytest.mark.once
@pytest.mark.ranks
def test_corners_that_lie_flat_take_the_normal_of_the_flat_facet():
    """The outline goes counter-clockwise: the lower side comes after the left end's corner."""
    scene = arms("right")
    found = chosen(scene)
    assert len(found) == 4
    assert found[(-0.3, 0.0)] == 1
    n = scene.contact.operators.n[np.isclose(scene.contact.slave.X, (-0.3, 0.0)).all(axis=1)]
    assert n[0] == pytest.approx([0.0, -1.0], abs=1e-12)


@pytest.mark.parametrize(
    "degrees, facet", [(0, 1), (15, 1), (30, 0), (45, 0), (60, 0), (75, -1), (90, -1)]
)
def test_the_nearest_of_three_normals_is_taken(degrees, facet):
    """A square corner above a flat, turned about it."""
    scene = arms("right")
    c, X = scene.contact, scene.contact.slave.X
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    tip = np.array([-0.3, 0.0])
    x = (X - tip) @ turn.T + tip + [0.0, 1e-3]
    assert chosen(scene, x)[(-0.3, 0.0)] == facet
    _, alone = one_sided(c.slave, corners_of(c.slave), np.array([0, 0, 0, 0]))
    assert not alone.any()


@pytest.mark.parametrize("degrees, facet", [(34, 0), (39, 0), (41, 1), (62, 1)])
def test_a_corner_that_is_pressed_blunt_takes_the_average(degrees, facet):
    """Whichever facet the master, dented below the corner, happens to face."""
    c = arms("right").contact
    j = np.flatnonzero(np.isclose(c.slave.X, (-0.3, 0.0)).all(axis=1))
    x, half = c.operators.x.copy(), np.radians(degrees / 2)
    x[c.slave.previous[j]] = x[j] + 0.01 * np.array([-np.cos(half), np.sin(half)])
    x[c.slave.following[j]] = x[j] + 0.01 * np.array([np.cos(half), np.sin(half)])
    slope = 0.6 * half
    along = np.array([np.cos(slope), np.sin(slope)])
    below = x[j][0] - [0.0, 1e-4]
    assert choose_facets(c.slave, j, x, np.array([[below + along, below - along]]))[0] == facet


def test_a_facet_between_corners_keeps_its_partner_if_one_of_them_takes_its_normal():
    """The end of a bar of one cell: each corner by itself, and both."""
    bar = whole("bar", block(5, 1, width=1.0, height=0.1, corner=(0.0, 0.0)))
    ground = whole("ground", block(5, 1, width=1.0, height=0.1, corner=(0.0, -0.1)))
    slave = Scene([bar, ground], [("bar", "ground")], [(at(1, -0.1), None)]).contact.slave
    corners = corners_of(slave)
    x = slave.X[corners]
    low, high = (np.flatnonzero(np.isclose(x, (1.0, y)).all(axis=1))[0] for y in (0.0, 0.1))
    end = np.isclose(slave.X[slave.facets][:, :, 0], 1.0).all(axis=1)
    for chosen_low, chosen_high, alone in ((-1, 1, True), (1, 1, False), (-1, -1, False)):
        facets = np.zeros(len(corners), int)
        facets[low], facets[high] = chosen_low, chosen_high
        assert one_sided(slave, corners, facets)[1][end].all() == alone


def test_a_corner_between_two_walls_keeps_its_averaged_normal():
    """Both parts of the master are equally near: no facet is preferred."""
    scene = arms("right")
    c = scene.contact
    x = c.operators.x
    walls = np.array([[(1.0, 0.0), (-0.3, 0.0)], [(-0.3, 0.0), (-0.3, 1.0)]])
    j = np.flatnonzero(np.isclose(c.slave.X, (-0.3, 0.0)).all(axis=1))
    assert choose_facets(c.slave, j, x, walls)[0] == 0
    assert choose_facets(c.slave, j, x, walls[:1])[0] == 1


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
