# SPDX-License-Identifier: MIT
"""A scene of bodies supported by friction or adhesion as a contact problem with its loads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scenes import internal, neo_hookean, read, rotation
from supported_parts import Array, Body, Flat, Loads, Touch, flat_nodes, measure, structure

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.stability.limit_analysis import Structure, Verdict, friction_needed, judge
from fenics_mortar.utils import compat
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block

NU = 0.3


@dataclass
class Assembly:
    """A scene: the problem and its loads.

    Attributes:
        name: Description with parameters.
        problem: The problem, to be solved.
        gravity, push: Loads as vectors, ``fem.Constant`` of shape (2,).
        torque: Size of the torque, a scalar ``fem.Constant``.
        traction: Tractions on named boundaries, ``fem.Constant`` of shape (2,) each.
        path: Loads of the steps.
        turn: Rotation of the whole scene [radian].
        small: Displacement that elastic bodies may have under the loads of the path [length].
        stop: Displacement at which a sliding body is stopped, if it is [length].
        reserve: Fraction by which the limit load of a body may increase after it has moved [1].
        note: Function of the solved scene that returns an additional entry of the table's row.
        wrong: Function that returns a message on errors of a solved scene.
    """

    name: str
    problem: fm.ContactProblem
    data: fm.MeshData
    bodies: list[Body]
    touches: list[Touch]
    gravity: Any
    push: Any
    torque: Any
    traction: dict[str, Any]
    directions: dict[str, Array]
    path: list[Loads]
    turn: float
    small: float
    obstacles: dict[str, Any]
    stop: float | None = None
    reserve: float = 0.0
    note: Callable[[Assembly], str] = lambda scene: ""
    wrong: Callable[[Assembly], str] = lambda scene: ""

    def set(self, weight: float = 0.0, push: float = 0.0, torque: float = 0.0) -> None:
        """Set all loads; zero by default."""
        R = rotation(self.turn)
        self.gravity.value[:] = weight * R @ self.directions["gravity"]
        self.push.value[:] = push * R @ self.directions["push"]
        self.torque.value = PETSc.ScalarType(torque)

    def solve(self) -> Iterator[fm.NewtonReport]:
        """Solve for the loads of the path one after the other."""
        for loads in self.path:
            self.set(**loads)
            yield self.problem.solve()

    @property
    def moved(self) -> Array:
        """Displacement of all nodes in the frame of the scene, shape (nodes, 2)."""
        return self.problem.equations.bulk.by_input_node()[1] @ rotation(self.turn)

    def nodes(self, name: str) -> slice:
        """Nodes of a body among those of ``moved``."""
        first = 0
        for body in self.bodies:
            count = body.grid.numbers().max() + 1
            if body.grid.name == name:
                return slice(first, first + count)
            first += count
        raise KeyError(name)

    def motion(self, name: str) -> Array:
        """Mean displacement (2,) of a body and its mean rotation: x, y, angle."""
        u = self.moved[self.nodes(name)]
        body = next(body for body in self.bodies if body.grid.name == name)
        X = flat_nodes(body.grid)
        X = X - X.mean(axis=0)
        turn = (X[:, 0] * u[:, 1] - X[:, 1] * u[:, 0]).sum() / (X**2).sum()
        return np.array([*u.mean(axis=0), turn])

    def largest(self) -> float:
        """Largest displacement of a node [length]."""
        return float(np.linalg.norm(self.moved, axis=1).max())

    def force(self, number: int) -> Array:
        """Contact force on the slave of a pair in the frame of the scene (2,)."""
        return np.array(self.problem.equations.contacts[number].total_force) @ rotation(self.turn)

    def structure(self, loads: Loads, live: Loads) -> Structure:
        """The rigid bodies under dead loads, with live ones to be scaled."""
        return structure(self.bodies, self.touches, self.directions, loads, live)

    def verdict(self, step: int) -> tuple[Verdict, float]:
        """Limit analysis of a step, and the factor of friction that its loads need."""
        loads, before = self.path[step], self.path[step - 1] if step else {}
        live = {name: value - before.get(name, 0.0) for name, value in loads.items()}
        whole = self.structure(loads, {})
        return judge(self.structure(before, live)), friction_needed(whole)


def pose(
    name: str,
    bodies: Sequence[Body],
    touches: Sequence[Touch],
    path: Sequence[Loads],
    *,
    E: float = 1e4,
    turn: float = 0.0,
    gravity: Sequence[float] = (0.0, -1.0),
    push: Sequence[float] = (1.0, 0.0),
    small: float = 0.0,
    stop: float | None = None,
    cell: str = "quadrilateral",
    material: Callable[..., Any] = neo_hookean,
    traction: Sequence[str] = (),
    prescribed: Sequence[tuple[str, int, float]] = (),
    reserve: float = 0.0,
    note: Callable[[Assembly], str] = lambda scene: "",
    wrong: Callable[[Assembly], str] = lambda scene: "",
    algorithm: str | None = None,
    newton: fm.NewtonOptions | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Assembly:
    """Create the problem of a scene (collective).

    Args:
        name: What it is.
        bodies: Its bodies, in the scene's frame.
        touches: Its pairs.
        path: Loads of the steps.
        E: Reference of the bodies' Young's moduli.
        turn: Rotation of the scene.
        gravity: Direction of the weights, in the scene's frame.
        push: Direction of the pushes.
        small: Largest elastic displacement; by default 20 times the sum of the loads over E.
        stop: Displacement at which a sliding body is stopped.
        cell: "quadrilateral" or "triangle".
        material: Stress.
        traction: Boundaries with a traction per reference length, ``Assembly.traction``.
        prescribed: Boundaries with one prescribed component and its value.
        reserve: Fraction by which the limit load may increase after a motion.
        note: Function that returns an additional entry of the table's row.
        wrong: Function that returns a message on errors of a solved scene.
        algorithm: As of ``ContactProblem``.
        newton: As of ``ContactProblem``.
        comm: Communicator.
    """
    R = rotation(turn)
    grids = [replace(body.grid, x=body.grid.x @ R.T) for body in bodies]
    data = read(mapped_grids.build, comm=comm, grids=grids, cell=cell)
    mesh = data.mesh
    V = fm.vector_space(mesh, 1)
    u, v = fem.Function(V), ufl.TestFunction(V)
    areas = [measure(body.grid) for body in bodies]
    stiffness = by_body(data, bodies, [E * body.E for body in bodies])
    density, pushed = (
        by_body(data, bodies, [getattr(b, what) / a[0] for b, a in zip(bodies, areas)])
        for what in ("weight", "push")
    )
    spin = by_body(data, bodies, [b.torque / a[2] for b, a in zip(bodies, areas)])
    middle = [by_body(data, bodies, [float((R @ a[1])[i]) for a in areas]) for i in (0, 1)]
    pull, thrust = (fem.Constant(mesh, np.zeros(2)) for _ in range(2))
    torque = fem.Constant(mesh, PETSc.ScalarType(0.0))
    X = ufl.SpatialCoordinate(mesh)
    couple = torque * spin * ufl.as_vector((middle[1] - X[1], X[0] - middle[0]))
    dx = ufl.dx(metadata={"quadrature_degree": 4})
    load = density * pull + pushed * thrust + couple
    residual = internal(u, material(u, stiffness, NU)) - ufl.inner(load, v) * dx
    tractions = {side: fem.Constant(mesh, np.zeros(2)) for side in traction}
    for side, value in tractions.items():
        ds = ufl.Measure("ds", mesh, subdomain_data=data.facet_tags)
        residual -= ufl.inner(value, v) * ds(data.boundary_tag(side))
    bcs = [
        fm.dirichlet(V, data, f"{b.grid.name}/{side}", (0.0, 0.0))
        for b in bodies
        for side in b.clamped
    ]
    guides = [(f"{b.grid.name}/{side}", c, 0.0) for b in bodies for side, c in b.guided]
    for side, component, value in [*guides, *prescribed]:
        along = R @ np.eye(2)[component]
        axis = int(np.abs(along).argmax())
        if not abs(abs(along[axis]) - 1.0) < 1e-12:
            raise ValueError(f"turn={turn}: a guide needs a multiple of a quarter turn")
        bcs.append(fm.dirichlet(V, data, side, float(np.sign(along[axis]) * value), axis))
    obstacles: dict[str, Any] = {}
    for touch in touches:
        if isinstance(touch.master, Flat) and touch.master.name not in obstacles:
            obstacles[touch.master.name] = _plane(touch.master, R)
    pairs = [
        fm.ContactPair(
            data,
            t.slave,
            obstacles[t.master.name] if isinstance(t.master, Flat) else t.master,
            law=t.law,
            **t.options,
        )
        for t in touches
    ]
    problem = fm.ContactProblem(
        residual,
        u,
        pairs,
        bcs=bcs,
        petsc_options_prefix="supported_",
        algorithm=algorithm,
        newton=newton,
    )
    forces = [
        sum(
            abs(b.weight * loads.get("weight", 0.0))
            + abs(b.push * loads.get("push", 0.0))
            + abs(b.torque * loads.get("torque", 0.0))
            for b in bodies
        )
        for loads in path
    ]
    directions = {"gravity": np.array(gravity, float), "push": np.array(push, float)}
    return Assembly(
        name, problem, data, list(bodies), list(touches), pull, thrust, torque, tractions,
        directions, list(path), turn, small or 20.0 * max(forces) / E, obstacles, stop, reserve,
        note, wrong,
    )  # fmt: skip


def _plane(flat: Flat, R: Array) -> fm.Plane:
    """The plane turned; a force drives it along its normal."""
    plane = fm.Plane(R @ flat.point, R @ flat.normal, name=flat.name)
    if flat.force is not None:
        force = R @ flat.force
        axis = int(np.abs(force).argmax())
        plane.push(**{"xy"[axis]: float(force[axis])})
    return plane


def by_body(data: fm.MeshData, bodies: Sequence[Body], values: Sequence[float]) -> fem.Function:
    """A function that is constant in each body."""
    function = fem.Function(compat.scalar_space(data.mesh, 0, "DG"))
    dofs = compat.dofmap(function.function_space)[:, 0]
    for body, value in zip(bodies, values):
        function.x.array[dofs[data.cell_tags.find(data.body_tag(body.grid.name))]] = value
    return function


def ground(
    width: float, columns: int, *, left: float = 0.0, depth: float = 0.5, rows: int = 2
) -> Body:
    """A deformable block below y = 0, clamped at its bottom."""
    x = block(columns, rows, width=width, height=depth, corner=(left, -depth))
    return Body(Grid("ground", x), clamped=("bottom",))


def floor_of(kind: str, **sizes: Any) -> tuple[list[Body], str | Flat]:
    """Bodies of the ground, and the master of the bodies on it: "plane" or "body"."""
    if kind == "plane":
        return [], Flat((0.0, 0.0), (0.0, 1.0), "floor")
    return [ground(**sizes)], "ground/top"
