# SPDX-License-Identifier: MIT
"""Paths in space whose solutions are differentiated."""

import numpy as np
from scenes import pair_options
from scipy.spatial.transform import Rotation
from space_pairs import ROLES, YOUNG, stack
from taylor_scenes import Path

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar import energies, sensitivity
from meshes import mapped_boxes
from meshes.mapped_boxes import Box, block

SIZES = ((0.8, 0.7, 0.5), (1.2, 1.2, 0.5))
# Pressed, then drawn over a part of a facet, and aside.
SLIDE = [(0.0, 0.0, -0.03), (0.03, 0.02, -0.05), (0.09, 0.03, -0.05)]
# Places of a sphere: pressed, then moved and turned about two axes.
ROLL = [(0.0, 0.0, -0.03, 0.0, 0.0, 0.0), (0.02, 0.01, -0.05, 0.02, 0.05, 0.03)]
ROLL += [(0.05, 0.02, -0.05, 0.03, 0.1, 0.02)]
SOLVED = fm.NewtonOptions(residual_tolerance=1e-12)


def blocks(
    cell="hexahedron", degree=1, law=None, *, places=SLIDE, pair=None, tie=False, roles=ROLES[0],
    energy=energies.neo_hookean, bend=0.0, half=False, problem=None, **more,
):  # fmt: skip
    """A smaller block on a larger one; controls: modulus, body force, place, offsets, law."""
    corner = (0.0, 0.2, -0.003) if half else (0.22, 0.2, -0.003)
    scene = stack(cell, degree, **{"sizes": SIZES, "offset": corner, **more})
    mesh, V, u = scene.data.mesh, scene.u.function_space, scene.u
    mesh.geometry.x[:] += bend * shift(mesh.geometry.x)
    E, load = fem.Constant(mesh, YOUNG), fem.Function(V, name="load")
    lame = energies.lame(E, 0.3)
    psi = (energy(u, *lame) - ufl.inner(load, u)) * ufl.dx(degree=2 * degree)
    scene.residual = ufl.derivative(psi, u)
    for body in ("upper", "lower") if half else ():
        scene.roll(f"{body}/left", 0)
    given = {"newton": SOLVED, **(problem or {})}
    scene.press().set_up(law, roles=roles, pair=pair_options(pair), tie=tie, **given)
    controls = {
        "E": E, "load": load, "place": scene.push, "fit": sensitivity.Interference(0),
        "offset": sensitivity.Offset(0), "X": sensitivity.NodalPositions(),
    }  # fmt: skip
    for name in law.parameters if law else ():
        controls[name] = sensitivity.LawParameter(0, name)

    def move(place):
        scene.push.value[:] = place

    return Path(scene.problem, u, controls, move, places)


def shift(x):
    """A smooth field of positions (n, 3)."""
    a, b, c = x.T
    return np.stack([np.sin(2.0 * a + b), np.cos(b - c), 0.5 * np.sin(a - 2.0 * b + c)], axis=1)


class TiltedPlane(fm.Obstacle):
    """The half-space above a plane through a point, turned by a tilt about y."""

    def __init__(self, tilt):
        super().__init__("tilted", (0.45, 0.55, 0.0))
        self._tilt = tilt

    def shape(self):
        return {"tilt": np.asarray(self._tilt)}

    def set_shape(self, name, value):
        self._tilt = float(np.asarray(value).item())

    def local(self, x):
        n = -np.array([np.sin(self._tilt), 0.0, np.cos(self._tilt)])
        return (x - self.pivot) @ n, np.tile(n, (len(x), 1)), np.zeros((len(x), 3, 3))

    def local_by_shapes(self, x, name, directions):
        dn = np.reshape(directions, (-1, 1)) * np.array(
            [-np.cos(self._tilt), 0, np.sin(self._tilt)]
        )
        return dn @ (x - self.pivot).T, np.tile(dn[:, None], (1, len(x), 1))


def on_obstacle(
    law=None, cell="hexahedron", degree=1, *, places=None, obstacle=None, shape="radius", **more
):
    """An obstacle pressed on a block, moved and turned; controls: modulus, place, shape, law."""
    scene = stack(cell, degree, lower=(4, 4, 1), **more)
    mesh, u = scene.data.mesh, scene.u
    E = fem.Constant(mesh, YOUNG)
    psi = energies.neo_hookean(u, *energies.lame(E, 0.3)) * ufl.dx(degree=2 * degree)
    scene.hold("lower/bottom")
    for side in ("upper/top", "upper/bottom"):  # stays away
        scene.hold(side, (0.0, 0.0, 3.0))
    sphere = obstacle or fm.Sphere((0.45, 0.55, 1.0), 1.01)
    pair = fm.ContactPair(scene.data, "lower/top", sphere, law=law)
    problem = fm.ContactProblem(
        ufl.derivative(psi, u),
        u,
        [pair],
        bcs=scene.bcs,
        petsc_options_prefix="ball_",
        newton=SOLVED,
    )
    controls = {
        "E": E, "place": sensitivity.ObstaclePlace(sphere),
        shape: sensitivity.ObstacleShape(sphere, shape),
    }  # fmt: skip
    for name in law.parameters if law else ():
        controls[name] = sensitivity.LawParameter(0, name)

    def move(place):
        sphere.place = place

    return Path(problem, u, controls, move, ROLL if places is None else places)


def twisted(law):
    """A block that is pressed and twisted on another one, while both turn."""
    scene = stack(
        sizes=((0.6, 0.6, 0.4), (1.4, 1.4, 0.4)), offset=(0.4, 0.4, -0.003), lower=(4, 4, 1)
    )
    V, centre = scene.u.function_space, np.array([[0.7], [0.7], [0.0]])
    lower, upper = (fem.Function(V) for _ in range(2))
    for side, motion in (("lower/bottom", lower), ("upper/top", upper)):
        scene.bcs.append(fm.dirichlet(V, scene.data, side, motion))
    scene.set_up(law, newton=fm.NewtonOptions(residual_tolerance=1e-11))

    def move(place):
        both, twist = place
        R = Rotation.from_rotvec(both * np.array([0.3, -0.2, 1.0])).as_matrix()
        T, down = Rotation.from_rotvec([0.0, 0.0, twist]).as_matrix(), [[0.0], [0.0], [-0.02]]
        lower.interpolate(lambda x: R @ (x - centre) + centre - x)
        upper.interpolate(lambda x: R @ (T @ (x - centre) + down) + centre - x)

    return Path(scene.problem, scene.u, {}, move, [(0.0, 0.0), (0.0, 0.05), (0.1, 0.25)])


def tower(laws, *, mixed=False):
    """Three blocks on each other, and a plane that moves down and aside on top: three pairs.

    Controls: modulus, offsets of the pairs, place of the plane, coefficients of friction.

    Args:
        laws: Laws of the pairs from the bottom up.
        mixed: Whether the pressure is an unknown, with displacements of degree 2.
    """
    low, boxes = 0.0, []
    for seed, (counts, size) in enumerate(
        [((2, 2, 1), 1.2), ((1, 2, 1), 0.9), ((2, 1, 1), 0.7)], start=1
    ):
        corner = (0.5 - 0.5 * size, 0.45 - 0.5 * size, low)
        x = block(counts, size=(size, size, 0.4), corner=corner, jiggle=0.1, seed=seed)
        boxes.append(Box(f"b{seed}", x))
        low += 0.397
    cell = "tetrahedron" if mixed else "hexahedron"
    data = mapped_boxes.mesh(boxes, cell=cell)
    E = fem.Constant(data.mesh, YOUNG)
    if mixed:
        w = fem.Function(fm.mixed_space(data.mesh, ("Lagrange", 2, (3,)), ("Lagrange", 1)))
        u, pressure = ufl.split(w)
        shear = E / 2.8
        psi = energies.mixed_neo_hookean(u, pressure, shear, 0.1 / shear)
    else:
        w = fem.Function(fm.vector_space(data.mesh, 1))
        psi = energies.neo_hookean(w, *energies.lame(E, 0.3))
    plane = fm.Plane((0.5, 0.45, low + 0.003), (0.0, 0.0, -1.0), name="plate")
    sides = ("b2/bottom", "b1/top"), ("b3/bottom", "b2/top"), ("b3/top", plane)
    pairs = [fm.ContactPair(data, *side, law=law) for side, law in zip(sides, laws, strict=True)]
    V = w.function_space.sub(0) if mixed else w.function_space
    bcs = [fm.dirichlet(V, data, "b1/bottom", np.zeros(3))]
    residual = ufl.derivative(psi * ufl.dx(degree=4), w)
    problem = fm.ContactProblem(
        residual, w, pairs, bcs=bcs, petsc_options_prefix="tower_", newton=SOLVED
    )
    controls = {"E": E, "place": sensitivity.ObstaclePlace(plane)}
    for number, law in enumerate(laws):
        controls[f"offset{number}"] = sensitivity.Offset(number)
        for name in law.parameters if law else ():
            controls[f"{name}{number}"] = sensitivity.LawParameter(number, name)

    def move(place):
        plane.place = place

    places = [(0.0, 0.0, -0.02, 0.0, 0.0, 0.0), (0.004, 0.002, -0.03, 0.0, 0.0, 0.0)]
    places += [(0.05, 0.03, -0.03, 0.0, 0.0, 0.02)]
    return Path(problem, w, controls, move, places)
