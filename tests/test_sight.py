# SPDX-License-Identifier: MIT
"""What lies behind a slave surface: no partner is seen through the bodies, and no option needed."""

import mapped_grids
import numpy as np
import pytest
from mapped_grids import Grid, block, mapped, sector
from scenes import internal, linear_elastic, neo_hookean, nodal, read

from dolfinx import fem

import fenics_mortar as fm

SIDES = ("bottom", "right", "top", "left")
E, NU = 100.0, 0.3


def whole(name, x, **options):
    """A body whose outline has one name, its own."""
    return Grid(name, x, dict.fromkeys(SIDES, name), **options)


def at(axis, value):
    """Nodes where a coordinate has this value."""
    return lambda X: np.isclose(X[axis], value)


class Scene:
    """Bodies, pairs, and conditions: pairs of a place and a component, or both if it is None."""

    def __init__(self, grids, pairs, held, *, strain="finite", degree=1, tied=(), **options):
        self.data = data = read(lambda: mapped_grids.build(grids, order=degree))
        V = fm.vector_space(data.mesh, degree)
        self.u = u = fem.Function(V)
        self.moved = [fem.Function(V) for _ in held]
        bcs = []
        for function, (place, component) in zip(self.moved, held, strict=True):
            if component is None:
                dofs = fem.locate_dofs_geometrical(V, place)
                bcs.append(fem.dirichletbc(function, dofs))
            else:
                part = V.sub(component)
                dofs = fem.locate_dofs_geometrical((part, part.collapse()[0]), place)[0]
                bcs.append(fem.dirichletbc(0.0, dofs, part))
        stress = {"finite": neo_hookean, "linear": linear_elastic}[strain]
        contacts = [fm.ContactPair(data, *pair, **options) for pair in pairs]
        self.problem = fm.ContactProblem(
            internal(u, stress(u, E, NU)), u,
            [*contacts, *(fm.TiedPair(data, *pair) for pair in tied)], bcs=bcs,
            petsc_options_prefix="test_",
        )  # fmt: skip

    def move(self, number, x, y):
        """Prescribe the motion of the place of this number."""
        self.moved[number].x.array.reshape(-1, 2)[:] = x, y

    def follow(self, way, steps):
        """Go along ``way``, places (k, 2) of the second condition at equal times."""
        times = np.linspace(0.0, 1.0, len(way))

        def set_loads(time):
            self.move(1, *(np.interp(time, times, component) for component in np.transpose(way)))

        return fm.follow_path(self.problem, set_loads, fm.SteppingOptions(1.0 / steps))

    @property
    def contact(self):
        return self.problem.contacts[0]


def plates(outlines, slave="lower", height=0.1, degree=1, **options):
    """A plate on a wider one, pressed by its top; with outlines or the two sides that meet."""
    body, (a, b, rows) = whole if outlines else Grid, np.multiply(degree, (16, 9, 2))
    grids = [
        body("lower", block(a, rows, width=1.6, height=height, corner=(-0.8, -height))),
        body("upper", block(b, rows, width=0.9, height=height, corner=(-0.45, 0.0))),
    ]
    names = {"lower": "lower/top", "upper": "upper/bottom"}
    pair = [slave, "upper" if slave == "lower" else "lower"]
    pair = pair if outlines else [names[name] for name in pair]
    held = [(at(1, -height), None), (at(1, height), None)]
    return Scene(grids, [pair], held, degree=degree, **options)


@pytest.mark.parametrize("options", [
    {}, {"strain": "linear"}, {"integration": "elements"}, {"integration": "nodes"},
    {"sliding": "small"}, {"law": fm.Coulomb(0.3)},
])  # fmt: skip
def test_plates_with_whole_outlines_are_those_with_the_sides_that_meet(options):
    """Of the wider one as slave, whose nodes that meet the other have the same normals."""
    found = []
    for outlines in (True, False):
        scene = plates(outlines, **options)
        scene.move(1, 0.0, -0.01)
        assert scene.problem.solve().certificate.violations() == []
        found.append((nodal(scene.problem), scene.contact.total_force))
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-12
    assert found[0][1] == pytest.approx(found[1][1], abs=1e-9)
    assert abs(found[0][1][1]) > 1.0


@pytest.mark.parametrize("slave", ["lower", "upper"])
@pytest.mark.parametrize("degree", [1, 2])
def test_thin_plates_are_pressed_deep(slave, degree):
    """To half their thickness, in steps of a quarter of one: as one with twice its thickness."""
    scene = plates(True, slave, degree=degree)
    for depth in (0.025, 0.05, 0.075, 0.1):
        scene.move(1, 0.0, -depth)
        assert scene.problem.solve().certificate.violations() == []
    only = plates(False, slave, degree=degree)
    for depth in (0.025, 0.05, 0.075, 0.1):
        only.move(1, 0.0, -depth)
        only.problem.solve()
    assert scene.contact.total_force[1] == pytest.approx(only.contact.total_force[1], rel=0.05)


@pytest.mark.parametrize("slave", ["left", "right"])
@pytest.mark.parametrize("outlines", [False, True])
def test_beam_goes_past_a_beam(slave, outlines):
    """Aside, down and back by little more than both are thick: it rests below, unloaded."""
    body = whole if outlines else Grid
    grids = [
        body("left", block(10, 1, width=1.0, height=0.1, corner=(-1.0, -0.1))),
        body("right", block(10, 1, width=1.0, height=0.1, corner=(-0.05, 0.0))),
    ]
    names = {"left": "left/top", "right": "right/bottom"}
    pair = [slave, "right" if slave == "left" else "left"]
    pair = pair if outlines else [names[name] for name in pair]
    scene = Scene(grids, [pair], [(at(0, -1.0), None), (at(0, 0.95), None)])
    report = scene.follow([(0, 0), (0.2, 0.1), (0.2, -0.23), (-0.3, -0.23)], 12)
    assert report.num_cuts == 0 and not scene.contact.active.any()
    # and up again: now its top meets the other's bottom
    if outlines:
        report = scene.follow([(-0.3, -0.23), (-0.3, -0.17)], 3)
        assert report.num_cuts == 0 and scene.contact.active.any()
        assert scene.contact.total_force[1] * (1 if slave == "left" else -1) > 1e-6


def bump(x, middle, width):
    """A smooth bump of height one."""
    t = np.clip((x - middle) / width, -1.0, 1.0)
    return np.cos(0.5 * np.pi * t) ** 2


@pytest.mark.parametrize("slave", ["hook", "catch"])
def test_hook_snaps_behind_a_catch(slave):
    """A barb on an arm is pushed over a ridge, with whole outlines, and rests behind it."""

    def arm(s, t):
        x = 2.0 * s
        low = -0.15 * bump(x, 0.2, 0.2)
        return x, low + (0.12 - low) * t

    def ridge(s, t):
        x = -1.4 + 1.2 * s
        high = 0.1 * bump(x, -0.5, 0.25)
        return x, -0.35 + (0.2 + high) * t

    grids = [whole("hook", mapped(40, 2, arm)), whole("catch", mapped(30, 3, ridge))]
    pair = [slave, "catch" if slave == "hook" else "hook"]
    held = [(at(1, -0.35), None), (at(0, 2.0), None)]
    scene = Scene(grids, [pair], held)
    seen = []
    fm.follow_path(
        scene.problem,
        lambda time: scene.move(1, -1.2 * time, 0.03),
        fm.SteppingOptions(0.05),
        on_step=lambda time, report: seen.append(scene.contact.total_force.copy()),
    )
    pull = np.array(seen)[:, 0] * (1 if slave == "hook" else -1)
    assert pull.max() > 1e-3 and pull.min() < -1e-3  # up the ridge and down
    assert not scene.contact.active.any()


def tubes(outlines, slave="inner", degree=1, **options):
    """A tube in one that it is too wide for."""
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


@pytest.mark.parametrize("slave", ["inner", "outer"])
@pytest.mark.parametrize("degree", [1, 2])
def test_tube_in_a_tube_with_whole_outlines_is_that_with_the_sides_that_meet(slave, degree):
    found = []
    for outlines in (True, False):
        scene = tubes(outlines, slave, degree)
        assert scene.problem.solve().certificate.violations() == []
        contact = scene.contact
        found.append((nodal(scene.problem), contact.pressure[contact.active].mean()))
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-11
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-8)
    assert found[0][1] > 1e-3 * E


@pytest.mark.parametrize("slave", ["spiral", "wall"])
def test_spiral_is_touched_by_a_wall_at_its_outer_winding_only(slave):
    """Two windings, and a wall whose back faces the inner ones through both of them."""

    def spiral(s, t):
        angle = 4.0 * np.pi * s
        r = 0.5 + 0.3 * angle / (2.0 * np.pi) + 0.1 * (1.0 - t)
        return r * np.cos(angle), r * np.sin(angle)

    x = mapped(64, 1, spiral)
    right = x[:, :, 0].max()
    wall = block(2, 12, width=0.1, height=1.2, corner=(right + 0.01, -0.5))
    grids = [whole("spiral", x), whole("wall", wall)]
    pair = [slave, "wall" if slave == "spiral" else "spiral"]
    ends = [lambda X: np.hypot(X[0] - 0.55, X[1]) < 0.06, at(0, right + 0.11)]
    scene = Scene(grids, [pair], [(ends[0], None), (ends[1], None)])
    report = scene.follow([(0, 0), (-0.1, 0)], 5)
    assert report.num_cuts == 0
    contact = scene.contact
    assert contact.active.any() and abs(contact.total_force[0]) > 1e-4
    assert (contact.slave.X[contact.active, 0] > right - 0.05).all()
