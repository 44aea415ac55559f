# SPDX-License-Identifier: MIT
"""Derivatives with ties, driven obstacles, thickness, bodies of revolution, self-contact."""

from mpi4py import MPI

import numpy as np
import pytest
import revolved
from scenes import TIGHT
from self_scenes import c_ring
from taylor_scenes import (
    SLIDE,
    Path,
    blocks,
    check,
    obstacle_on_block,
    tied_blocks,
    value_of,
    wave,
)

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import sensitivity
from fenics_mortar.sensitivity import FrictionWork, PressureIntegral, TotalForce
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block

comm = MPI.COMM_WORLD


def sheared(u):
    """A form of the displacement."""
    return (ufl.inner(u, u) + 0.1 * u[0] + 0.2 * u[1]) * ufl.dx


@pytest.mark.parametrize("objective", ["force", "form"])
def test_ties(objective):
    """Non-matching blocks joined and sheared; displacements do not depend on the common modulus."""
    scene = tied_blocks([(0.05, -0.02), (0.1, 0.03)])
    sizes = {"E": 30.0, "load": 3.0, "place": 0.02}
    quantity = TotalForce(0, (1.0, 0.3))
    if objective == "form":
        quantity = sheared(scene.u)
        del sizes["E"]
    check(scene, quantity, list(sizes), list(sizes.values()))


@pytest.mark.parametrize("law", [None, fm.Coulomb(0.3)], ids=["none", "Coulomb"])
@pytest.mark.parametrize("shape", ["radius", "points"])
def test_driven_obstacles(law, shape):
    """A roller pressed by a force, and drawn by another force or a prescribed motion."""
    if shape == "radius":
        roller = fm.Circle((0.45, 1.5), 0.5)
    else:
        x = np.linspace(-0.3, 1.2, 7)
        roller = fm.Spline(np.stack([x, 1.0 + 0.4 * (x - 0.45) ** 2], axis=1))
    roller.move(y=-0.03, angle=0.1)
    loads = [(0.0, -3.0), (0.02, -5.0), (0.06, -5.0)]
    scene = obstacle_on_block(roller, law, places=loads)

    def move(place):
        roller.push(y=place[1])
        roller.move(x=place[0])

    scene.move = move
    roller.push(y=-3.0)
    scene.controls["load"] = sensitivity.ObstacleLoad(roller)
    del scene.controls["place"]
    names, sizes = ["E", shape], [30.0, 0.01]
    if law:
        names, sizes = [*names, "mu"], [*sizes, 0.1]
    check(scene, TotalForce(0, (1.0, 0.2)) + PressureIntegral(0, 2), names, sizes, step=2e-4)
    path = scene.solve()
    tangent = fm.gradient(TotalForce(0, (0.0, 1.0)), scene.controls["load"], path)
    assert abs(tangent[scene.controls["load"]][1]) == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("law", [None, fm.Coulomb(0.3), fm.Tresca(1.0)], ids=str)
@pytest.mark.parametrize(
    "thickness", [2.0, lambda x: 1.0 + 0.5 * x[:, 0]], ids=["number", "function"]
)
def test_thickness(law, thickness):
    scene = blocks(law, places=SLIDE[:3], thickness=thickness)
    names, sizes = ["E", "interference"], [30.0, 0.01]
    if law:
        name = law.parameters[0]
        names, sizes = [*names, name], [*sizes, 0.1]
    objective = TotalForce(0, (1.0, 0.2)) + PressureIntegral(0, 2) + FrictionWork(0)
    check(scene, objective, names, sizes, step=2e-4)


def shift(kind, x, y):
    """A smooth field, zero on the axis, shape (n, 2)."""
    return wave(x, y) * (x[:, None] if kind == "revolution" else 1.0)


def fitted(law, bend=0.0):
    """A hub on a shaft with interference, then pulled."""
    shaft = Grid("shaft", block(2, 8, width=1.0, height=4.0, corner=(0.0, -2.0)))
    hub = Grid("hub", block(2, 5, width=1.0, height=2.0, corner=(1.0, -1.0)))
    data = mapped_grids.mesh([shaft, hub])
    data.mesh.geometry.x[:, :2] += bend * shift("revolution", *data.mesh.geometry.x[:, :2].T)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    pull, E = fem.Constant(data.mesh, 0.0), fem.Constant(data.mesh, 100.0)
    conditions = [("shaft/left", 0.0, 0), ("hub/top", 0.0, 1), ("shaft/top", pull, 1)]
    bcs = [fm.dirichlet(u.function_space, data, *condition) for condition in conditions]
    pair = fm.ContactPair(data, "hub/left", "shaft/right", law=law, initial_gap=-0.02)
    problem = fm.ContactProblem(
        revolved.internal(u, revolved.neo_hookean(u, E, 0.3)), u, [pair],
        bcs=bcs, geometry="axisymmetric", newton=TIGHT, petsc_options_prefix="fit_",
    )  # fmt: skip

    def move(place):
        pull.value = place

    controls = {"E": E, "place": pull, "fit": sensitivity.Interference(0)}
    controls["law"] = sensitivity.LawParameter(0, "mu")
    return Path(problem, u, controls, move, [0.0, 0.005, 0.02, 0.05])


@pytest.mark.serial
@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_bodies_of_revolution(mu):
    scene = fitted(fm.Coulomb(mu) if mu else fm.Frictionless())
    names, sizes = ["E", "fit"], [30.0, 0.001]
    if mu:
        names, sizes = [*names, "place", "law"], [*sizes, 0.001, 0.05]
    check(scene, TotalForce(0, (1.0, 0.3)) + FrictionWork(0), names, sizes, step=2e-4)


@pytest.mark.parametrize("whole", [False, True], ids=["ends", "outline"])
@pytest.mark.parametrize("law", [None, fm.Coulomb(0.05)], ids=["none", "Coulomb"])
def test_surfaces_that_touch_themselves(law, whole):
    names = ["ring/first", "ring/last", *(["ring/top", "ring/bottom"] if whole else [])]
    ring = c_ring(lambda data: [fm.ContactPair(data, names, law=law)])
    controls = {"place": ring.moved["high"], "law": sensitivity.LawParameter(0, "mu")}

    def move(place):
        ring.moved["high"].value[:] = place

    places = [(0.0, -0.06), (0.0, -0.11), (0.0, -0.14), (0.005, -0.16), (0.01, -0.18)]
    scene = Path(ring.problem, ring.u, controls, move, places)
    names, sizes = (["place", "law"], [0.01, 0.01]) if law else (["place"], [0.01])
    check(scene, PressureIntegral(0, 2), names, sizes, step=2e-5)


def shape_scene(kind, bend):
    """A path on a bent mesh, at the offset of the straight one."""
    if kind == "revolution":
        scene = fitted(fm.Coulomb(0.2), bend)
        scene.problem.equations.contacts[0].offset = np.full(6, 0.02)
        scene.start = scene.problem.state()
        return scene
    return blocks(fm.Coulomb(0.3), places=SLIDE[:3], thickness=2.0, bend=bend)


def test_positions_with_a_thickness_that_varies_are_refused():
    scene = blocks(fm.Coulomb(0.3), places=SLIDE[:1], thickness=lambda x: 1.0 + 0.5 * x[:, 0])
    with pytest.raises(fm.MortarError, match="thickness depends on the position"):
        fm.gradient(TotalForce(0, (1.0, 0.3)), sensitivity.NodalPositions(), scene.solve())


@pytest.mark.parametrize("kind", ["number", "revolution"])
def test_nodal_positions(kind):
    """Weights of the interface depend on positions too."""
    X = sensitivity.NodalPositions()
    objective = TotalForce(0, (1.0, 0.3))
    scene = shape_scene(kind, 0.0)
    path = scene.solve()
    gradient = fm.gradient(objective, X, path)
    x, y = scene.problem.equations.bulk.V.tabulate_dof_coordinates()[:, :2].T
    direction = shift(kind, x, y).ravel()[: gradient[X].size]
    slope = comm.allreduce(float(gradient[X] @ direction))
    remainders = []
    for step in (1e-3, 5e-4, 2.5e-4):
        bent = shape_scene(kind, step)
        remainders.append(abs(value_of(bent.solve(), objective) - gradient.value - step * slope))
    assert (np.log2(np.array(remainders[:-1]) / remainders[1:]) > 1.9).all(), remainders
