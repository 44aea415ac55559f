# SPDX-License-Identifier: MIT
"""Derivatives through contact in space: adjoint against tangent-linear, slopes of remainders."""

from mpi4py import MPI

import numpy as np
import pytest
from one_rank import several_ranks
from refusal import refused
from space_taylor_scenes import ROLL, SLIDE, TiltedPlane, blocks, on_obstacle, shift, tower
from taylor_scenes import check, timed, value_of
from test_contact_controls import Regular

import fenics_mortar as fm
from fenics_mortar import energies, laws
from fenics_mortar.sensitivity import (
    ContactLength,
    FrictionWork,
    MeanGap,
    Moment,
    ObstacleLoad,
    PeakPressure,
    PressureIntegral,
    TotalForce,
    tangent_linear,
    total,
)

COMM = MPI.COMM_WORLD
EXACT = 1e-11
FORCE = TotalForce(0, (0.7, 0.4, 1.0))
FORMS, SIZES = ["E", "load", "place"], [10.0, 1.0, 0.01]


def checked(scene, objective, names, sizes, **options):
    return check(scene, objective, names, sizes, **{"exact": EXACT, "step": 1e-4, **options})


@pytest.mark.parametrize("cell, degree", [("hexahedron", 1), ("tetrahedron", 1)])
def test_forms_without_friction(cell, degree):
    checked(blocks(cell, degree), FORCE, FORMS, SIZES)


@pytest.mark.serial
@pytest.mark.parametrize("law", [fm.Coulomb(0.2), fm.Coulomb(2.0), fm.Tresca(1.0)], ids=str)
@pytest.mark.parametrize("cell, degree", [("hexahedron", 1), ("tetrahedron", 1)])
def test_friction(cell, degree, law):
    scene = blocks(cell, degree, law)
    names, sizes = [*FORMS, "offset"], [*SIZES, 0.003]
    sticks = getattr(law, "mu", 0.0) > 1.0
    if not sticks:
        names, sizes = [*names, law.parameters[0]], [*sizes, 0.05]
    checked(scene, FORCE + FrictionWork(0), names, sizes)
    contact = scene.problem.equations.contacts[0]
    assert contact.now.sliding.any() != sticks


def test_a_surface_in_contact_with_itself():
    """Slave and master are one surface."""
    scene = blocks(law=fm.Coulomb(0.2), roles=[["upper/bottom", "lower/top"]])
    checked(scene, FORCE + FrictionWork(0), [*FORMS, "offset"], [*SIZES, 0.003])
    contact = scene.problem.equations.contacts[0]
    assert contact.slave is contact.master and contact.now.sliding.any()


QUANTITIES = {
    "moment": Moment(0, (0.1, 0.2, 0.3), (1.0, 2.0, -1.0)),
    "pressure": PressureIntegral(0, 2),
    "peak": PeakPressure(0),
    "area": ContactLength(0),
    "work": FrictionWork(0),
}


@pytest.mark.once
@pytest.mark.parametrize("name", QUANTITIES)
def test_quantities(name):
    scene = blocks(law=fm.Coulomb(0.3))
    checked(scene, QUANTITIES[name], ["mu", "fit", "E"], [0.05, 0.003, 10.0], over_steps=total)


# Pressed, then opened under adhesion and sheared.
OPENING = [(0.0, 0.0, -0.01), (0.01, 0.005, 0.01), (0.015, 0.008, 0.03)]
# Sheared along one side, turned, and sheared back beyond the start.
AWAY = [(0.03, 0.005, -0.01), (0.02, 0.03, 0.01), (-0.02, 0.01, 0.01), (-0.05, -0.02, -0.005)]
LAWS = {
    "wear": (laws.Worn(0.3, 0.05), {"mu": 0.05, "wear": 0.01}),
    "rates": (laws.Stribeck(0.3, 0.2, 0.1), {"static": 0.05, "kinetic": 0.05, "rate": 0.05}),
    "layer": (laws.SoftLayer(50.0, 2.0, mu=0.3), {"mu": 0.05, "k": 5.0, "m": 0.1}),
    "bond": (laws.MixedCohesive(100.0, 2.0, 0.3), {"stiffness": 10.0, "strength": 0.2}),
    "bond there and back": (laws.MixedCohesive(100.0, 2.0, 0.3), {"stiffness": 10.0}, AWAY),
    "by node": (fm.Coulomb(lambda X: 0.2 + 0.1 * X[:, 0]), {"mu": 0.05}),
    "user's": (Regular(), {"weights": 0.1}),
    "adhesion": (laws.Cohesive(2.0, 0.3), {"strength": 0.3, "reach": 0.02}, OPENING),
}


@pytest.mark.once
@pytest.mark.parametrize("name", LAWS)
def test_laws_with_memory_layers_and_rates(name):
    law, sizes, *places = LAWS[name]
    sizes = {**sizes, "E": 10.0, "fit": 0.003}
    scene = timed(blocks(law=law, places=places[0] if places else SLIDE))
    checked(scene, FORCE + FrictionWork(0), list(sizes), list(sizes.values()))


@pytest.mark.serial
@pytest.mark.parametrize("law", [None, fm.Coulomb(0.3)], ids=["none", "Coulomb"])
@pytest.mark.parametrize("kind", ["small", "linear bulk", "saddle"])
def test_small_sliding_and_algorithms(kind, law):
    given = {
        "small": {"pair": {"sliding": "small"}},
        "linear bulk": {"energy": energies.linear_elastic, "problem": {"linear_bulk": True}},
        "saddle": {"problem": {"algorithm": "saddle"}},
    }
    scene = blocks(law=law, **given[kind])
    names, sizes = [*FORMS, "fit"], [*SIZES, 0.003]
    if kind == "linear bulk":
        names, sizes = names[1:], sizes[1:]
    if law:
        names, sizes = [*names, "mu"], [*sizes, 0.05]
    checked(scene, FORCE + FrictionWork(0), names, sizes)


@pytest.mark.serial
@pytest.mark.parametrize("law", [None, fm.Coulomb(0.3), fm.Coulomb(3.0)], ids=str)
def test_sphere(law):
    """With friction slip counts from points of the sphere, which depend on its shape."""
    scene = on_obstacle(law)
    names, sizes = ["E", "place", "radius"], [10.0, 0.003, 0.003]
    if law and law.mu < 1.0:
        names, sizes = [*names, "mu"], [*sizes, 0.05]
    objective = FORCE + PressureIntegral(0, 2) + 10.0 * MeanGap(0)
    checked(scene, objective + FrictionWork(0) if law else objective, names, sizes)


@pytest.mark.parametrize("law", [fm.Coulomb(0.3), laws.MixedCohesive(100.0, 2.0, 0.3)], ids=str)
def test_a_plane_that_is_tilted(law):
    """Of this shape the normals depend, and with them power and total slip."""
    places = [
        (0, 0, -0.05, 0, 0, 0),
        (0.03, 0.01, -0.07, 0, 0.01, 0),
        (0.08, -0.03, -0.07, 0, 0.01, 0),
    ]
    scene = on_obstacle(law, places=places, obstacle=TiltedPlane(0.05), shape="tilt")
    checked(scene, FORCE + 10.0 * FrictionWork(0), ["tilt"], [0.003])


@pytest.mark.parametrize("law", [None, fm.Coulomb(0.3)], ids=str)
def test_sphere_that_is_driven(law):
    scene = on_obstacle(law, places=[(0.0, -2.0), (0.02, -4.0), (0.05, -4.0)])
    sphere = scene.problem.obstacles[0]
    sphere.move(z=-0.02)
    sphere.push(z=-2.0)

    def move(place):
        sphere.push(z=place[1])
        sphere.move(x=place[0])

    scene.move = move
    checked(scene, FORCE + PressureIntegral(0, 2), ["E", "radius"], [10.0, 0.003])
    load = ObstacleLoad(sphere)
    found = fm.gradient(TotalForce(0, (0.0, 0.0, 1.0)), load, scene.solve())[load]
    assert abs(found[2]) == pytest.approx(1.0, rel=1e-9)
    assert np.abs(found[[0, 1, 3, 4, 5]]).max() < 1e-9


@pytest.mark.parametrize("cell, degree", [("hexahedron", 1), ("tetrahedron", 1)])
def test_ties(cell, degree):
    scene = blocks(cell, degree, tie=True, offset=(0.22, 0.2, 0.0), places=[(0.03, 0.0, -0.02)] * 2)
    checked(scene, FORCE + Moment(0, axis=(0.0, 1.0, 0.5)), FORMS, SIZES)


@pytest.mark.once
@pytest.mark.parametrize("cell, degree", [("tetrahedron", 2), ("hexahedron", 2)])
def test_quadratic_elements(cell, degree):
    more = {"places": SLIDE[:2], "upper": (2, 2, 1), "lower": (2, 2, 1)}
    scene = blocks(cell, degree, fm.Coulomb(0.2), **more)
    checked(scene, FORCE, ["E", "mu", "fit"], [10.0, 0.05, 0.003])


@pytest.mark.each
@pytest.mark.parametrize("mixed", [False, pytest.param(True, marks=pytest.mark.serial)])
def test_several_pairs_and_mixed_functions(mixed):
    """Blocks between blocks and an obstacle, that stick, slide and hold each other."""
    scene = tower([fm.Coulomb(2.0), fm.Tresca(1.0), fm.Coulomb(0.2)], mixed=mixed)
    objective = FORCE + FrictionWork(1) + FrictionWork(2) + MeanGap(2)
    names = ["E", "offset0", "offset1", "stress1", "mu2", "place"]
    checked(scene, objective, names, [5.0, 0.001, 0.001, 0.05, 0.02, 0.001])
    sliding = [contact.now.sliding.any() for contact in scene.problem.equations.contacts]
    assert sliding[-1]


def test_symmetry_planes():
    """Nodes on them slide in one direction."""
    scene = blocks(law=fm.Coulomb(0.2), half=True, places=[(0.0, 0.0, -0.02), (0.0, 0.03, -0.05)])
    checked(scene, FORCE + FrictionWork(0), ["E", "mu", "fit"], [10.0, 0.05, 0.003])
    assert scene.problem.equations.contacts[0].is_guided.any()


@pytest.mark.parametrize("law", [None, fm.Coulomb(0.2), fm.Coulomb(2.0)], ids=str)
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_nodal_positions(cell, law):
    """Of all nodes, through the positions from which slip is counted, too."""
    objective, places = FORCE + PressureIntegral(0, 2), SLIDE[1:]
    scene = blocks(cell, law=law, places=places)
    X, path = scene.controls["X"], scene.solve()
    gradient = fm.gradient(objective, X, path)
    points = scene.u.function_space.tabulate_dof_coordinates()
    direction = shift(points).ravel()[: gradient[X].size]
    slope = COMM.allreduce(float(gradient[X] @ direction))
    tangent = tangent_linear(objective, X, direction, path).derivative
    assert tangent == pytest.approx(slope, rel=EXACT)
    remainders = []
    for step in (1e-4, 5e-5):
        bent = blocks(cell, law=law, places=places, bend=step)
        remainders.append(abs(value_of(bent.solve(), objective) - gradient.value - step * slope))
    assert np.log2(remainders[0] / remainders[1]) > 1.9, remainders


@several_ranks
def test_derivatives_do_not_depend_on_the_number_of_ranks():
    """Those of all ranks together and of each rank alone."""
    found = []
    for comm in (COMM, MPI.COMM_SELF):
        scene = blocks(law=fm.Coulomb(0.2), places=SLIDE[:2], comm=comm)
        names = [scene.controls[name] for name in ("E", "place", "mu", "offset")]
        by_step = fm.gradient(FORCE + FrictionWork(0), names, scene.solve()).by_step
        found.append(np.concatenate([np.ravel(parts) for parts in by_step]))
    assert np.abs(found[0] - found[1]).max() < 1e-8 * np.abs(found[1]).max()


def test_arguments_in_space():
    """Vectors have three components, moments need an axis, and turns are of one kind."""
    scene = on_obstacle(places=ROLL[:1])
    path, (sphere,), E = scene.solve(), scene.problem.obstacles, scene.controls["E"]
    with refused(ValueError, "direction=", "three finite numbers"):
        fm.gradient(TotalForce(0, (0.0, 1.0)), E, path)
    with refused(ValueError, "about=", "three finite numbers"):
        fm.gradient(Moment(0, (0.0, 1.0), (0.0, 0.0, 1.0)), E, path)
    with refused(ValueError, "axis=None: expected the direction of an axis in space"):
        fm.gradient(Moment(0), E, path)
    sphere.move(angle=(0.1, 0.0, 0.0))
    sphere.push(moment=(None, None, 0.0))
    with refused(fm.MortarError, "place of .*: expected all of one kind, or no prescribed turn"):
        scene.controls["place"].jvp(scene.problem, np.ones(6))
