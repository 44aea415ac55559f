# SPDX-License-Identifier: MIT
"""Search behind a slave surface: no partners through the bodies, without options."""

import numpy as np
import pytest
from scenes import internal, linear_elastic, neo_hookean, nodal, pair_options, read, rotation

from dolfinx import fem

import fenics_mortar as fm
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, mapped

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

    def __init__(self, grids, pairs, fixed, *, strain="finite", degree=1, tied=(), **options):
        self.data = data = read(lambda: mapped_grids.build(grids, order=degree))
        V = fm.vector_space(data.mesh, degree)
        self.u = u = fem.Function(V)
        self.moved = [fem.Function(V) for _ in fixed]
        bcs = []
        for function, (place, component) in zip(self.moved, fixed, strict=True):
            if component is None:
                dofs = fem.locate_dofs_geometrical(V, place)
                bcs.append(fem.dirichletbc(function, dofs))
            else:
                part = V.sub(component)
                dofs = fem.locate_dofs_geometrical((part, part.collapse()[0]), place)[0]
                bcs.append(fem.dirichletbc(0.0, dofs, part))
        stress = {"finite": neo_hookean, "linear": linear_elastic}[strain]
        contacts = [fm.ContactPair(data, *pair, **pair_options(options)) for pair in pairs]
        self.problem = fm.ContactProblem(
            internal(u, stress(u, E, NU)), u,
            [*contacts, *(fm.TiedPair(data, *pair) for pair in tied)], bcs=bcs,
            petsc_options_prefix="test_",
        )  # fmt: skip

    def move(self, number, x, y):
        """Prescribe the motion of the condition with this number."""
        self.moved[number].x.array.reshape(-1, 2)[:] = x, y

    def follow(self, positions, steps):
        """Move the second condition through ``positions`` (k, 2) at equal intervals of time."""
        times = np.linspace(0.0, 1.0, len(positions))

        def set_loads(time):
            self.move(
                1, *(np.interp(time, times, component) for component in np.transpose(positions))
            )

        return fm.follow_path(self.problem, set_loads, fm.SteppingOptions(1.0 / steps))

    @property
    def contact(self):
        return self.problem.equations.contacts[0]


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
    fixed = [(at(1, -height), None), (at(1, height), None)]
    return Scene(grids, [pair], fixed, degree=degree, **options)


@pytest.mark.once
@pytest.mark.parametrize("slave", ["lower", "upper"])
@pytest.mark.parametrize("options", [
    {}, {"strain": "linear"}, {"integration": "elements"}, {"integration": "nodes"},
    {"sliding": "small"}, {"law": fm.Coulomb(0.3)},
])  # fmt: skip
def test_plates_with_whole_outlines_agree_with_chosen_sides(options, slave):
    """Equal for either slave, since a corner on a flat surface has the normal of that surface.

    With friction, the material at a corner turns by the average of its facets, of one or of two:
    slip differs by second order in the rotation.
    """
    found = []
    for outlines in (True, False):
        scene = plates(outlines, slave, **options)
        scene.move(1, 0.0, -0.01)
        assert scene.problem.solve().certificate.violations() == []
        found.append((nodal(scene.problem), scene.contact.total_force))
    u, force = (1e-10, 1e-8) if "law" in options else (1e-12, 1e-9)
    assert np.abs(found[0][0] - found[1][0]).max() < u
    assert found[0][1] == pytest.approx(found[1][1], abs=force)
    assert abs(found[0][1][1]) > 1.0


@pytest.mark.once
@pytest.mark.parametrize("slave", ["lower", "upper"])
@pytest.mark.parametrize("degree, depths", [(1, [0.025, 0.05, 0.075, 0.1]), (2, [0.025, 0.05])])
def test_thin_plates_are_pressed_deep(slave, degree, depths):
    """Pressed to half their thickness in steps of an eighth; equal to chosen sides."""
    forces = []
    for outlines in (True, False):
        scene = plates(outlines, slave, degree=degree)
        for depth in depths:
            scene.move(1, 0.0, -depth)
            assert scene.problem.solve().certificate.violations() == []
        forces.append(scene.contact.total_force[1])
    assert forces[0] == pytest.approx(forces[1], rel=1e-8)


def test_facets_longer_than_plates_are_thick_have_no_partner_through_both():
    """The lower plate's bottom and the upper one's top face each other, two thicknesses behind."""
    grids = [
        whole("lower", block(4, 1, width=1.6, height=0.1, corner=(-0.8, -0.1))),
        whole("upper", block(3, 1, width=0.9, height=0.1, corner=(-0.45, 0.0))),
    ]
    fixed = [(at(0, -0.8), None), (at(1, 0.1), None)]
    contact = Scene(grids, [("lower", "upper")], fixed).contact
    bottom = np.isclose(contact.slave.X[:, 1], -0.1)
    assert bottom.any() and contact.covered[~bottom].any()
    assert not contact.covered[bottom].any()


@pytest.mark.parametrize("slave", ["lower", "upper"])
def test_thin_plate_is_pressed_by_more_than_its_thickness_in_one_step(slave):
    """The plate starts above a thick block and ends inside: the shorter way out is backwards."""
    grids = [
        Grid("lower", block(12, 6, width=1.2, height=1.0, corner=(-0.6, -1.0))),
        Grid("upper", block(9, 1, width=0.9, height=0.05, corner=(-0.45, 0.01))),
    ]
    names = {"lower": "lower/top", "upper": "upper/bottom"}
    pair = names[slave], names["upper" if slave == "lower" else "lower"]
    scene = Scene(grids, [pair], [(at(1, -1.0), None), (at(1, 0.06), None)])
    scene.move(1, 0.0, -0.09)
    assert scene.problem.solve().certificate.violations() == []
    assert abs(scene.contact.total_force[1]) > 1.0


@pytest.mark.once
def test_search_radius_also_limits_partners_behind():
    """If the radius is smaller than the overlap of two bodies, no partner is found."""
    data = read(lambda: mapped_grids.build([
        Grid("lower", block(4, 4, width=1.0, height=1.0, corner=(0.0, -0.9))),
        Grid("upper", block(5, 4, width=1.0, height=1.0, corner=(0.0, 0.0))),
    ]))  # fmt: skip
    V = fm.vector_space(data.mesh, 1)
    for radius, found in ((None, True), (0.11, True), (0.09, False)):
        u = fem.Function(V)
        pair = fm.ContactPair(data, "lower/top", "upper/bottom", search_radius=radius)
        bcs = [fm.dirichlet(V, data, name, (0.0, 0.0)) for name in ("lower/bottom", "upper/top")]
        problem = fm.ContactProblem(
            internal(u, linear_elastic(u, E, NU)), u, [pair], bcs=bcs, petsc_options_prefix="test_"
        )
        assert problem.equations.contacts[0].covered.any() == found


@pytest.mark.once
@pytest.mark.parametrize("coated", ["slave", "master"])
def test_thickness_of_tied_bodies_is_their_sum(coated):
    """Pressed in one step by more than the coating is thick."""
    thin, thick = 0.01, 0.5
    low = thin if coated == "slave" else 0.0
    high = thin if coated == "master" else 0.0
    grids = [
        Grid("base", block(8, 4, width=1.0, height=thick, corner=(-0.5, -thick - low))),
        Grid("cap", block(7, 4, width=0.9, height=thick, corner=(-0.45, 0.005 + high))),
    ]
    if coated == "slave":
        grids.append(Grid("coat", block(12, 1, width=1.0, height=thin, corner=(-0.5, -thin))))
        pair, tie = ("coat/top", "cap/bottom"), ("coat/bottom", "base/top")
    else:
        grids.append(Grid("coat", block(12, 1, width=0.9, height=thin, corner=(-0.45, 0.005))))
        pair, tie = ("base/top", "coat/bottom"), ("coat/top", "cap/bottom")
    fixed = [(at(1, -thick - low), None), (at(1, thick + 0.005 + high), None)]
    scene = Scene(grids, [pair], fixed, tied=[tie])
    scene.move(1, 0.0, -0.05)
    assert scene.problem.solve().certificate.violations() == []
    assert abs(scene.contact.total_force[1]) > 1.0


@pytest.mark.once
@pytest.mark.parametrize("slave", ["left", "right"])
@pytest.mark.parametrize("outlines", [False, True])
def test_beam_passes_a_beam(slave, outlines):
    """A detour aside, down by slightly more than both thicknesses, and back: unloaded below."""
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


@pytest.mark.parametrize(
    "slave, barb, wide",
    [
        ("catch", 0.1, 0.35),
        *(
            pytest.param(*each, marks=pytest.mark.serial)
            for each in (
                ("hook", 0.1, 0.35),
                ("catch", 0.15, 0.2),
                ("hook", 0.1, 0.12),  # a barb of five facets
                ("catch", 0.1, 0.12),
            )
        ),
    ],
)
def test_hook_snaps_behind_a_catch(slave, barb, wide):
    """A barb on an arm is pushed over a ridge, with whole outlines, and rests behind it."""

    def arm(s, t):
        x, low = 2.0 * s, -barb * bump(2.0 * s, wide, wide)
        return x, low + (0.12 - low) * t

    def ridge(s, t):
        x, high = -1.7 + 1.5 * s, 0.1 * bump(-1.7 + 1.5 * s, -0.6, wide + 0.05)
        return x, -0.2 - barb + (0.2 + high) * t

    grids = [whole("hook", mapped(40, 2, arm)), whole("catch", mapped(36, 3, ridge))]
    pair = [slave, "catch" if slave == "hook" else "hook"]
    fixed = [(at(1, -0.2 - barb), None), (at(0, 2.0), None)]
    scene = Scene(grids, [pair], fixed)
    records = []
    fm.follow_path(
        scene.problem,
        lambda time: scene.move(1, -1.5 * time, 0.03),
        fm.SteppingOptions(0.05, smallest=1e-3),
        on_step=lambda time, report: records.append((time, *scene.contact.total_force)),
    )
    time, force, _ = np.transpose(records)
    first = (0.6 - wide - 0.05) / 1.5  # until then the bumps are beside each other
    assert np.abs(force[time < first]).max(initial=0.0) == 0.0
    push = force * (1.0 if slave == "hook" else -1.0)
    assert push.max() > 1e-4 and push.min() < -1e-5  # up the ridge and down
    assert not scene.contact.active.any()


def on_its_corner(tilt, reach, wall):
    """A block, tilted by ``tilt`` [degree], on a corner; the floor ends ``reach`` beyond it."""
    names = dict.fromkeys(SIDES, "rest")
    turn = rotation(np.radians(tilt))

    def tilted(s, t):
        return tuple((s - 1.0) * row[0] + t * row[1] for row in turn)

    grids = [
        whole("block", mapped(6, 6, tilted)),
        Grid("floor", block(12, 4, width=1.5 + reach, height=0.5, corner=(-1.5, -0.5)), names),
    ]
    if wall:
        grids.append(Grid("wall", block(3, 14, width=0.3, height=2.0, corner=(0.6, -0.2)), names))
    fixed = [
        (lambda X: np.isclose(X[1], -0.5) | (X[0] > 0.6 - 1e-6), None),
        (lambda X: turn[:, 1] @ X[:2] > 1.0 - 1e-6, None),
    ]
    scene = Scene(grids, [("block", "rest")], fixed)
    scene.move(1, 0.0, -0.02)
    scene.problem.solve()
    return scene.contact


@pytest.mark.once
@pytest.mark.parametrize("tilt, reach", [(-10.0, 0.1), (-25.0, 0.1), (-10.0, 0.3)])
def test_touching_corner_has_no_partner_on_a_distant_wall(tilt, reach):
    """The wall is opposite to the facet that faces the floor, 3 to 4 facets away."""
    forces = []
    for wall in (False, True):
        contact = on_its_corner(tilt, reach, wall)
        assert contact.active.sum() == 1
        forces.append(contact.total_force)
    assert forces[0] == pytest.approx(forces[1], rel=1e-8)
