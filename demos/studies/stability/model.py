# SPDX-License-Identifier: MIT
"""Problems of the stability study, set up with a method's options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, neo_hookean, read_mesh
from fenics_mortar.energies import displacement_gradient, lame
from fenics_mortar.utils import compat
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, mapped, sector

__all__ = [
    "Body", "Grid", "Posed", "Scene", "Support", "Tool", "block", "fm", "legs", "mapped", "sector",
]  # fmt: skip

# Displacements along x and y, and a rotation about the origin [radian].
Pose = tuple[float, float, float]
STILL: Pose = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Body:
    """A grid of one neo-Hookean material, plane strain.

    Attributes:
        grid: Mesh of the body.
        E: Young's modulus [stress].
        nu: Poisson's ratio.
        weight: Body force at time 1, growing linearly from 0 [stress / length].
    """

    grid: mapped_grids.Grid
    E: float = 1.0
    nu: float = 0.3
    weight: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Support:
    """Boundaries with a prescribed rigid motion, or one component of it.

    Attributes:
        boundaries: Names of the boundaries.
        pose: Function that returns the pose at a time in [0, 1].
        component: 0 or 1 to leave the other component free.
        centre: Centre of the rotation [length].
    """

    boundaries: Sequence[str]
    pose: Callable[[float], Pose] = lambda time: STILL
    component: int | None = None
    centre: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Tool:
    """A rigid obstacle driven by a force; pairs refer to it by name as their master.

    Attributes:
        name: Its name.
        make: Function that creates it for each problem.
        force: Arguments of its ``push`` at time 1, growing linearly from 0.
    """

    name: str
    make: Callable[[], fm.Obstacle]
    force: dict[str, float]


@dataclass(frozen=True)
class Scene:
    """One problem of the stability study: everything except the method.

    Attributes:
        bodies: The bodies.
        pairs: Names of slave and master of each pair; without a master a side touches itself.
        supports: Dirichlet conditions.
        steps: Number of load steps from time 0 to 1 if none is cut: a user's first choice.
        pair: Options of all pairs that belong to the problem.
        check: Function that compares the last state with a known solution; returns a message, or
            "".
        cell: Kind of cells.
        linear: Whether the bodies are linear elastic at small strain.
        ranks: Number of ranks to run on; the record is compared with that of one rank.
        tools: Rigid bodies.
        geometry: "plane", or "axisymmetric" about x = 0.
    """

    bodies: Sequence[Body]
    pairs: Sequence[tuple[str, str | None]]
    supports: Sequence[Support]
    steps: int
    pair: dict[str, Any] = field(default_factory=dict)
    check: Callable[[Posed], str] = lambda posed: ""
    cell: str = "quadrilateral"
    linear: bool = False
    ranks: int = 1
    motions: Sequence[Tool] = ()
    geometry: str = "plane"

    def scaled(self, length: float, stress: float) -> Scene:
        """The same problem of meshed bodies in other units."""
        assert not self.motions

        def pose_of(support: Support) -> Callable[[float], Pose]:
            def pose(time: float) -> Pose:
                x, y, angle = support.pose(time)
                return length * x, length * y, angle

            return pose

        bodies = [
            replace(b, grid=replace(b.grid, x=length * b.grid.x), E=stress * b.E)
            for b in self.bodies
        ]
        supports = [replace(s, pose=pose_of(s)) for s in self.supports]
        return replace(self, bodies=bodies, supports=supports)


def legs(*targets: tuple[int, Pose]) -> Callable[[float], Pose]:
    """A path from pose to pose; each leg has a number of steps of equal duration."""
    counts, poses = zip(*targets)
    times = np.concatenate([[0], np.cumsum(counts)]) / sum(counts)
    knots = np.array([STILL, *poses])

    def pose(time: float) -> Pose:
        x, y, angle = (float(np.interp(time, times, knots[:, i])) for i in range(3))
        return x, y, angle

    return pose


@dataclass
class Posed:
    """A problem with a method: ready to solve."""

    scene: Scene
    problem: fm.ContactProblem
    set_loads: Callable[[float], None]

    @property
    def forces(self) -> np.ndarray:
        """Total force on the slave body of each pair, shape (pairs, 2)."""
        return np.array([contact.total_force for contact in self.problem.equations.contacts])


def read(scene: Scene, comm: MPI.Comm) -> fm.MeshData:
    """Build the mesh on rank 0 and read it on all."""
    grids = [body.grid for body in scene.bodies]
    return read_mesh(lambda: mapped_grids.build(grids, cell=scene.cell), comm)


def residual_of(scene: Scene, data: fm.MeshData, u: Any) -> tuple[Any, fem.Constant]:
    """The UFL residual, two forms for all problems, and the factor of the body forces."""
    V0 = compat.scalar_space(data.mesh, 0, "DG")
    mu, lmbda, bx, by = (fem.Function(V0) for _ in range(4))
    for body in scene.bodies:
        cells = data.cell_tags.find(data.bodies[body.grid.name])
        dofs = compat.dofmap(V0)[cells, 0]
        mu.x.array[dofs], lmbda.x.array[dofs] = lame(body.E, body.nu)
        bx.x.array[dofs], by.x.array[dofs] = body.weight
    factor = fem.Constant(data.mesh, 0.0)
    v = ufl.TestFunction(u.function_space)
    P = (linear_elastic if scene.linear else neo_hookean)(u, mu, lmbda, scene.geometry)
    work = ufl.inner(P, displacement_gradient(v, scene.geometry))
    dx = ufl.dx(metadata={"quadrature_degree": 3})
    if scene.geometry == "axisymmetric":
        return 2.0 * np.pi * ufl.SpatialCoordinate(data.mesh)[0] * work * dx, factor
    return (work - factor * (bx * v[0] + by * v[1])) * dx, factor


def rigid_motion(X: np.ndarray, pose: Pose, centre: tuple[float, float]) -> np.ndarray:
    """Displacement, shape (2, n), of points ``X`` (3, n)."""
    x, y, angle = pose
    arm = X[:2] - np.reshape(centre, (2, 1))
    cosine, sine = np.cos(angle) - 1.0, np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]]) @ arm + np.array([[x], [y]])


def dirichlet(V: Any, data: fm.MeshData, support: Support) -> tuple[Any, Callable[[float], None]]:
    """The condition of a support, and a function that sets it for a time."""
    names = list(support.boundaries)
    if support.component is not None:
        number = fem.Constant(data.mesh, 0.0)

        def set_component(time: float) -> None:
            number.value = support.pose(time)[support.component]

        return fm.dirichlet(V, data, names, number, support.component), set_component
    moved = fem.Function(V)

    def set_motion(time: float) -> None:
        moved.interpolate(lambda X: rigid_motion(X, support.pose(time), support.centre))

    return fm.dirichlet(V, data, names, moved), set_motion


def pose_problem(
    scene: Scene, comm: MPI.Comm, *, pair: dict[str, Any], problem: dict[str, Any]
) -> Posed:
    """Set up a problem with the options of a method (collective)."""
    data = read(scene, comm)
    V = fm.vector_space(data.mesh, 1)
    u = fem.Function(V)
    residual, factor = residual_of(scene, data, u)
    bcs, setters = zip(*(dirichlet(V, data, support) for support in scene.supports))
    options = {**scene.pair, **pair}
    chosen = {f.name for f in fields(fm.Discretization)} & options.keys()
    discretization = fm.Discretization(**{name: options.pop(name) for name in chosen})
    made = {tool.name: tool.make() for tool in scene.motions}
    pairs = [
        fm.ContactPair(
            data, slave, made.get(master or "", master), discretization=discretization, **options
        )
        for slave, master in scene.pairs
    ]
    contact_problem = fm.ContactProblem(
        residual, u, pairs, bcs=bcs, petsc_options_prefix="atlas_", geometry=scene.geometry,
        **problem,
    )  # fmt: skip

    def set_loads(time: float) -> None:
        factor.value = time
        for setter in setters:
            setter(time)
        for tool in scene.motions:
            made[tool.name].push(**{name: time * part for name, part in tool.force.items()})

    return Posed(scene, contact_problem, set_loads)
