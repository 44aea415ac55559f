# SPDX-License-Identifier: MIT
"""Scenes of bodies that friction or adhesion holds, with what limit analysis says of each.

    python3 tests/held.py                 all scenes by the present code, a row each
    python3 tests/held.py wall tower      those whose name begins so

A scene is made in a frame of its own and turned as a whole. Its loads are dead: the weight of
bodies, a push on some of them and a torque, all spread over the body; ``Held.set`` says how large
they are. ``Held.path`` holds the loads of its steps.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "meshes"), str(ROOT / "tests")]

import mapped_grids  # noqa: E402
from limit_analysis import (  # noqa: E402
    GROUND,
    Point,
    Structure,
    Verdict,
    friction_needed,
    judge,
    normal_of,
    touching_lines,
    touching_plane,
)
from mapped_grids import Grid, block, mapped, sector  # noqa: E402
from scenes import internal, neo_hookean, read, rotation  # noqa: E402

import ufl  # noqa: E402
from dolfinx import fem  # noqa: E402

import fenics_mortar as fm  # noqa: E402
from fenics_mortar import compat  # noqa: E402
from fenics_mortar.laws import Stick  # noqa: E402

Array = np.ndarray
Loads = dict[str, float]
NU = 0.3
# A load is borne, or not, for certain if the factor of limit analysis is off it by this part.
MARGIN = 0.02


@dataclass(frozen=True)
class Body:
    """A body in the frame of its scene.

    Attributes:
        grid: Its nodes.
        weight: Force along gravity, where gravity is one.
        push: Force along the push, where the push is one.
        torque: Moment about its centre, where the torque is one.
        E: Young's modulus over that of the scene.
        clamped: Sides that are held.
        guided: Sides of which one component is held, and which one.
    """

    grid: Grid
    weight: float = 0.0
    push: float = 0.0
    torque: float = 0.0
    E: float = 1.0
    clamped: tuple[str, ...] = ()
    guided: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Flat:
    """A rigid plane; ``force`` drives it against its normal's back, the rest is prescribed."""

    point: tuple[float, float]
    normal: tuple[float, float]
    name: str = "plane"
    force: tuple[float, float] | None = None


@dataclass(frozen=True)
class Touch:
    """A pair: slave boundary, master boundary or plane, its law.

    ``at``: where they touch for limit analysis, if that is not seen from the lines.
    """

    slave: str
    master: str | Flat
    law: fm.Law | None = None
    at: Sequence[Sequence[float]] | None = None
    options: dict[str, Any] = field(default_factory=dict)


@dataclass
class Held:
    """A scene: the problem, and what turns its loads.

    Attributes:
        name: What it is, with its parameters.
        problem: Ready to be solved.
        gravity, push: Direction times size of the loads, ``fem.Constant`` of shape (2,).
        torque: Size of the torque, a scalar ``fem.Constant``.
        traction: Tractions on named boundaries, ``fem.Constant`` of shape (2,) each.
        path: Loads of the steps.
        turn: Rotation of the whole scene [radian].
        small: Displacement that elastic bodies may have under the loads of the path [length].
        stop: Where a body ends that slides, if something stops it: displacement [length].
        reserve: Part by which a body that has moved may bear more than one that has not.
        note: What a row of the table shows besides, of the solved scene.
        wrong: What is wrong with a solved scene, in words.
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
    note: Callable[[Held], str] = lambda held: ""
    wrong: Callable[[Held], str] = lambda held: ""

    def set(self, weight: float = 0.0, push: float = 0.0, torque: float = 0.0) -> None:
        """Set all loads; what is not given is zero."""
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
        return self.problem.bulk.by_input_node()[1] @ rotation(self.turn)

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
        return np.array(self.problem.contacts[number].total_force) @ rotation(self.turn)

    def structure(self, loads: Loads, live: Loads) -> Structure:
        """The rigid bodies under dead loads, with live ones to be scaled."""
        return structure(self.bodies, self.touches, self.directions, loads, live)

    def verdict(self, step: int) -> tuple[Verdict, float]:
        """Limit analysis of a step, and the factor of friction that its loads need."""
        loads, before = self.path[step], self.path[step - 1] if step else {}
        live = {name: value - before.get(name, 0.0) for name, value in loads.items()}
        whole = self.structure(loads, {})
        return judge(self.structure(before, live)), friction_needed(whole)


def flat_nodes(grid: Grid) -> Array:
    """Positions of the nodes of a grid in the order of their numbers, shape (nodes, 2)."""
    numbers = grid.numbers()
    x = np.zeros((numbers.max() + 1, 2))
    x[numbers.ravel()] = grid.x.reshape(-1, 2)
    return x


def line_of(grid: Grid, side: str) -> Array:
    """Nodes along a side, the body on the left."""
    x = grid.x
    return {"bottom": x[:, 0], "right": x[-1], "top": x[::-1, -1], "left": x[0, ::-1]}[side]


def measure(grid: Grid) -> tuple[float, Array, float]:
    """Area, centre, and polar moment of area about the centre, of the meshed polygon cells."""
    x = grid.x
    a, b, c, d = x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]
    area, first, polar = 0.0, np.zeros(2), 0.0
    for p, q, r in ((a, b, c), (a, c, d)):
        p, q, r = (y.reshape(-1, 2) for y in (p, q, r))
        u, v = q - p, r - p
        S = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        area += S.sum()
        first += (S[:, None] * (p + q + r) / 3.0).sum(axis=0)
        middles = [(p + q) / 2, (q + r) / 2, (r + p) / 2]
        polar += sum((S / 3.0 * (m**2).sum(axis=1)).sum() for m in middles)
    centre = first / area
    return float(area), centre, float(polar - area * centre @ centre)


def structure(
    bodies: list[Body], touches: list[Touch], directions: dict[str, Array], dead: Loads, live: Loads
) -> Structure:
    """Limit analysis of what is meshed: bodies that are not clamped, and driven planes."""
    free = [body for body in bodies if not body.clamped]
    number = {body.grid.name: k for k, body in enumerate(free)}
    driven = {t.master.name: t.master for t in touches if isinstance(t.master, Flat)}
    driven = {name: flat for name, flat in driven.items() if flat.force is not None}
    number |= {name: len(free) + k for k, name in enumerate(driven)}
    wrenches = []
    for loads in (dead, live):
        rows = [_wrench(body, directions, loads) for body in free]
        rows += [
            np.array([*flat.force, _cross(flat.point, flat.force)]) * (loads is dead)
            for flat in driven.values()
        ]
        wrenches.append(np.array(rows).reshape(-1, 3))
    guided = np.zeros((len(number), 3), bool)
    for body in free:
        for _, component in body.guided:
            guided[number[body.grid.name], [component, 2]] = True
    for name, flat in driven.items():
        along = int(np.abs(flat.normal).argmax())
        guided[number[name], [1 - along, 2]] = True
    grids = {body.grid.name: body.grid for body in bodies}
    points = [p for t in touches for p in _points(t, grids, number)]
    return Structure(points, wrenches[0], wrenches[1], guided)


def _cross(x: Any, f: Any) -> float:
    return float(x[0] * f[1] - x[1] * f[0])


def _wrench(body: Body, directions: dict[str, Array], loads: Loads) -> Array:
    """Force and moment about the origin of the loads on a body."""
    _, centre, _ = measure(body.grid)
    force = body.weight * loads.get("weight", 0.0) * directions["gravity"]
    force = force + body.push * loads.get("push", 0.0) * directions["push"]
    moment = _cross(centre, force) + body.torque * loads.get("torque", 0.0)
    return np.array([*force, moment])


def _points(touch: Touch, grids: dict[str, Grid], number: dict[str, int]) -> Iterator[Point]:
    """Where a pair touches."""
    owner, side = touch.slave.split("/")
    one, line = number.get(owner, GROUND), line_of(grids[owner], side)
    if isinstance(touch.master, Flat):
        other = number.get(touch.master.name, GROUND)
        normal = np.array(touch.master.normal) / np.linalg.norm(touch.master.normal)
        found = touching_plane(line, np.array(touch.master.point), normal)

        def normal_at(_: Array) -> Array:
            return normal
    else:
        name, other_side = touch.master.split("/")
        other, master = number.get(name, GROUND), line_of(grids[name], other_side)
        found = touching_lines(line, master)

        def normal_at(x: Array) -> Array:
            return normal_of(master, x)

    law = touch.law or fm.Frictionless()
    mu = np.inf if isinstance(law, Stick) else getattr(law, "mu", 0.0)
    pull = float(law.adhesion(np.zeros(1))[0][0]) if law.attracts else 0.0
    if touch.at is not None:
        found = [(np.array(x, float), 0.0) for x in touch.at]
    for x, share in found:
        yield Point(one, other, x, normal_at(x), mu, pull * share)


class Glue(fm.Coulomb):
    """Coulomb's friction and adhesion that fades away over a length."""

    def __init__(self, mu: float, pull: float, length: float) -> None:
        super().__init__(mu)
        self.pull, self.length = pull, length

    def adhesion(self, gap: Array) -> tuple[Array, Array]:
        """The pull across a gap."""
        pull = self.pull * np.exp(-gap / self.length)
        return pull, -pull / self.length


# Setting up


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
    held: Sequence[tuple[str, int, float]] = (),
    reserve: float = 0.0,
    note: Callable[[Held], str] = lambda held: "",
    wrong: Callable[[Held], str] = lambda held: "",
    algorithm: str | None = None,
    newton: fm.NewtonOptions | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Held:
    """Make the problem of a scene (collective).

    Args:
        name: What it is.
        bodies: Its bodies, in the scene's frame.
        touches: Its pairs.
        path: Loads of the steps.
        E: Young's modulus that those of the bodies are relative to.
        turn: Rotation of all.
        gravity: Direction of the weights, in the scene's frame.
        push: Direction of the pushes.
        small: Displacement that is elastic; by default 20 times the sum of the loads over E.
        stop: Displacement at which something stops a body that slides.
        cell: "quadrilateral" or "triangle".
        material: Stress.
        traction: Boundaries with a traction per reference length, ``Held.traction``.
        held: Boundaries with one prescribed component and its value.
        reserve: Part by which a body that has moved may bear more.
        note: What a row of the table shows besides.
        wrong: What is wrong with a solved scene.
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
    middle = [
        by_body(data, bodies, [float((R @ a[1])[i]) for a in areas]) for i in (0, 1)
    ]
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
        fm.dirichlet(V, data, f"{b.grid.name}/{side}", (0.0, 0.0)) for b in bodies for side in b.clamped
    ]
    guides = [(f"{b.grid.name}/{side}", c, 0.0) for b in bodies for side, c in b.guided]
    for side, component, value in [*guides, *held]:
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
        residual, u, pairs, bcs=bcs, petsc_options_prefix="held_", algorithm=algorithm, newton=newton
    )
    forces = [
        sum(
            abs(b.weight * loads.get("weight", 0.0)) + abs(b.push * loads.get("push", 0.0))
            + abs(b.torque * loads.get("torque", 0.0))
            for b in bodies
        )
        for loads in path
    ]
    directions = {"gravity": np.array(gravity, float), "push": np.array(push, float)}
    return Held(
        name, problem, data, list(bodies), list(touches), pull, thrust, torque, tractions,
        directions, list(path), turn, small or 20.0 * max(forces) / E, obstacles, stop, reserve, note, wrong,
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


def ground(width: float, columns: int, *, left: float = 0.0, depth: float = 0.5, rows: int = 2) -> Body:
    """A deformable block below y = 0, clamped at its bottom."""
    x = block(columns, rows, width=width, height=depth, corner=(left, -depth))
    return Body(Grid("ground", x), clamped=("bottom",))


def floor_of(kind: str, **sizes: Any) -> tuple[list[Body], str | Flat]:
    """The ground's bodies and the master of what stands on it: "plane" or "body"."""
    if kind == "plane":
        return [], Flat((0.0, 0.0), (0.0, 1.0), "floor")
    return [ground(**sizes)], "ground/top"


# Scenes


def incline(
    slope: float = 0.4,
    mu: float = 0.5,
    base: str = "plane",
    *,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 4,
    rows: int = 2,
    n_base: int = 7,
    weight: float = 1.0,
    turn: float | None = None,
    **options: Any,
) -> Held:
    """A block on an incline; by default turned so that gravity points down."""
    bodies, floor = floor_of(base, width=3.0 * width, columns=n_base, left=-width)
    grid = Grid("block", block(n, rows, width=width, height=height))
    bodies = [Body(grid, weight=weight), *bodies]
    return pose(
        f"incline tan={np.tan(slope):.3f} mu={mu:g} {base}",
        bodies,
        [Touch("block/bottom", floor, fm.Coulomb(mu))],
        [{"weight": 1.0}],
        gravity=(np.sin(slope), -np.cos(slope)),
        turn=-slope if turn is None else turn,
        **options,
    )


def block_and_wall(
    push: float = 0.1,
    mu: float = 0.5,
    base: str = "plane",
    *,
    gap: float = 0.3,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 4,
    rows: int = 2,
    n_base: int = 9,
    weight: float = 1.0,
    at_once: bool = False,
    **options: Any,
) -> Held:
    """A block pushed towards a frictionless wall."""
    bodies, floor = floor_of(base, width=3.0 * width, columns=n_base, left=-width)
    grid = Grid("block", block(n, rows, width=width, height=height))
    wall = Flat((width + gap, 0.0), (-1.0, 0.0), "wall")
    path = [{"weight": 1.0}, {"weight": 1.0, "push": push}]
    return pose(
        f"block and wall push={push:g} mu={mu:g} {base}{' at once' if at_once else ''}",
        [Body(grid, weight=weight, push=1.0), *bodies],
        [Touch("block/bottom", floor, fm.Coulomb(mu)), Touch("block/right", wall)],
        path[1:] if at_once else path,
        stop=gap,
        note=lambda held: f"wall force {-held.force(1)[0]:.3g}",
        wrong=wall_force,
        **options,
    )


def wall_force(held: Held) -> str:
    """A block that slid bears what friction leaves on the wall, one that sticks does not reach it."""
    push, (slid, *_) = held.path[-1].get("push", 0.0), held.motion("block")
    slid = slid > 0.5 * held.stop
    pushed = held.push.value @ rotation(held.turn)[:, 0]
    exact = max(pushed - held.touches[0].law.mu, 0.0) if slid else 0.0
    found = -held.force(1)[0]
    size = max(abs(push), 1e-300)
    return f"wall force {found:.3g} instead of {exact:.3g}" if abs(found - exact) > 0.02 * size else ""


def wheel(
    part: float = 0.01,
    mu: float = 0.3,
    groove: str = "planes",
    *,
    radius: float = 1.0,
    n: int = 24,
    n_groove: int = 8,
    weight: float = 1.0,
    **options: Any,
) -> Held:
    """A wheel in a right-angled groove under a part of the torque that friction bears."""
    x = sector(n, 2, radii=(0.4 * radius, radius))
    most = np.sqrt(2.0) * mu / (1.0 + mu**2) * weight * radius
    bottom = -np.sqrt(2.0) * radius
    half = np.sqrt(0.5) * radius
    places = [(half, -half), (-half, -half)]
    law, bodies, touches = fm.Coulomb(mu), [], []
    wheel = Body(Grid("wheel", x, closed=True), weight=weight, torque=most)
    if groove == "planes":
        for side, place in zip((1.0, -1.0), places):
            flat = Flat((0.0, bottom), (-side, 1.0), "right" if side > 0 else "left")
            touches.append(Touch("wheel/bottom", flat, law, at=[place]))
    else:
        def shape(s: Array, t: Array) -> tuple[Array, Array]:
            across = 1.5 * radius * (2.0 * s - 1.0)
            top = bottom + np.abs(across)
            return across, bottom - radius + t * (top - bottom + radius)

        notch = Grid("groove", mapped(n_groove, 3, shape))
        bodies.append(Body(notch, clamped=("bottom",)))
        touches.append(Touch("wheel/bottom", "groove/top", law, at=places))
    return pose(
        f"wheel torque={part:g} mu={mu:g} {groove}",
        [wheel, *bodies],
        touches,
        [{"weight": 1.0}, {"weight": 1.0, "torque": part}],
        note=lambda held: f"turned {held.motion('wheel')[2]:.2g}",
        reserve=1.2 * np.tan(np.pi / n) / mu,  # of a polygon that rests on its facets
        **options,
    )


def ladder(
    lean: float = 1.0,
    mu: float = 0.4,
    *,
    length: float = 1.0,
    thick: float = 0.05,
    n: int = 8,
    rows: int = 1,
    base: str = "plane",
    weight: float = 1.0,
    E: float = 1e5,
    **options: Any,
) -> Held:
    """A beam at an angle ``lean`` [radian] above a rough floor, against a frictionless wall."""
    R = rotation(lean)
    x = block(n, rows, width=length, height=thick) @ R.T
    head = R @ (length, 0.0)
    bodies, floor = floor_of(base, width=length, columns=4, left=-0.5 * length)
    wall = Flat(tuple(head), (-1.0, 0.0), "wall")
    return pose(
        f"ladder tan={np.tan(lean):.3f} mu={mu:g} {base}",
        [Body(Grid("ladder", x), weight=weight), *bodies],
        [
            Touch("ladder/left", floor, fm.Coulomb(mu), at=[(0.0, 0.0)]),
            Touch("ladder/right", wall, at=[head]),
        ],
        [{"weight": 1.0}],
        E=E,
        small=50.0 * weight * length**3 / (E * thick**3),
        **options,
    )


def hanging(
    weight: float = 0.5,
    pull: float = 1.0,
    base: str = "plane",
    *,
    mu: float = 0.3,
    push: float = 0.0,
    width: float = 1.0,
    height: float = 0.5,
    fade: float = 0.01,
    n: int = 4,
    rows: int = 2,
    **options: Any,
) -> Held:
    """A block on an adhesive ceiling that pulls with ``pull`` per width."""
    grid = Grid("block", block(n, rows, width=width, height=height, corner=(0.0, -height)))
    bodies = [Body(grid, weight=1.0, push=1.0)]
    ceiling: str | Flat = Flat((0.0, 0.0), (0.0, -1.0), "ceiling")
    if base == "body":
        x = block(5, 2, width=2.0 * width, height=height, corner=(-0.5 * width, 0.0))
        bodies.append(Body(Grid("ceiling", x), clamped=("top",)))
        ceiling = "ceiling/bottom"
    path = [{"weight": weight}] + ([{"weight": weight, "push": push}] if push else [])
    return pose(
        f"hanging weight={weight:g} pull={pull:g} {base}{f' push={push:g}' if push else ''}",
        bodies,
        [Touch("block/top", ceiling, Glue(mu, pull / width, fade))],
        path,
        **options,
    )


def jaws(
    weight: float = 0.5,
    force: float = 1.0,
    mu: float = 0.5,
    kind: str = "planes",
    *,
    blocks: int = 1,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 3,
    E: float = 1e4,
    **options: Any,
) -> Held:
    """Blocks in a row between two jaws that a force presses together; weight in a second step."""
    law = fm.Coulomb(mu)
    row = [
        Body(
            Grid(f"block{k}", block(3, n + k % 2, width=width, height=height, corner=(k * width, 0))),
            weight=1.0 / blocks,
        )
        for k in range(blocks)
    ]
    touches = [Touch(f"block{k}/right", f"block{k + 1}/left", law) for k in range(blocks - 1)]
    end = blocks * width
    bodies, path = list(row), [{"weight": 0.0}, {"weight": weight}]
    if kind == "planes":
        touches += [
            Touch("block0/left", Flat((0.0, 0.0), (1.0, 0.0), "left"), law),
            Touch(
                f"block{blocks - 1}/right",
                Flat((end, 0.0), (-1.0, 0.0), "right", force=(-force, 0.0)),
                law,
            ),
        ]
    else:
        still = block(2, n + 2, width=width, height=2.0 * height, corner=(-width, -0.5 * height))
        moves = block(2, n + 2, width=width, height=2.0 * height, corner=(end, -0.5 * height))
        bodies += [
            Body(Grid("left", still), clamped=("left",)),
            Body(Grid("right", moves), push=1.0, guided=(("right", 1),)),
        ]
        touches += [
            Touch("block0/left", "left/right", law),
            Touch(f"block{blocks - 1}/right", "right/left", law),
        ]
        path = [{"push": -force}, {"push": -force, "weight": weight}]
    return pose(
        f"jaws weight={weight:g} force={force:g} mu={mu:g} {kind} blocks={blocks}",
        bodies,
        touches,
        path if weight else path[:1],
        E=E,
        small=20.0 * (force + weight) / E,
        **options,
    )


def pressed(
    push: float = 0.1,
    depth: float = 1e-4,
    mu: float = 0.5,
    base: str = "plane",
    *,
    width: float = 1.0,
    height: float = 0.5,
    n: int = 4,
    rows: int = 2,
    E: float = 1e4,
    **options: Any,
) -> Held:
    """A block whose top is moved down by ``depth``, free along x; friction alone holds it there.

    ``push`` is the part of about mu times the pressing force.
    """
    bodies, floor = floor_of(base, width=3.0 * width, columns=7, left=-width)
    grid = Grid("block", block(n, rows, width=width, height=height))
    force = E * depth * width / height
    return pose(
        f"pressed push={push:g} mu={mu:g} {base}",
        [Body(grid, push=mu * force, guided=(("top", 1),)), *bodies],
        [Touch("block/bottom", floor, fm.Coulomb(mu))],
        [{}, {"push": push}],
        held=[("block/top", 1, -depth)],
        small=20.0 * depth,
        E=E,
        note=lambda held: f"shear/pressure {-held.force(0)[0] / max(held.force(0)[1], 1e-300):.3g}",
        **options,
    )


def arch(
    thickness: float = 0.15,
    number: int = 7,
    mu: float = 0.8,
    *,
    n: int = 1,
    rows: int = 2,
    E: float = 1e6,
    weight: float = 1.0,
    **options: Any,
) -> Held:
    """A semicircular arch of voussoirs with mean radius one, on rigid springings."""
    law = fm.Coulomb(mu)
    angles = np.linspace(0.0, np.pi, number + 1)
    radii = (1.0 - 0.5 * thickness, 1.0 + 0.5 * thickness)
    bodies = [
        Body(
            Grid(f"v{k}", sector(n, rows + k % 2, radii=radii, angles=(angles[k], angles[k + 1]))),
            weight=weight / number,
        )
        for k in range(number)
    ]
    springing = Flat((0.0, 0.0), (0.0, 1.0), "springing")
    touches = [Touch(f"v{k}/right", f"v{k + 1}/left", law) for k in range(number - 1)]
    touches += [Touch("v0/left", springing, law), Touch(f"v{number - 1}/right", springing, law)]
    return pose(
        f"arch t/R={thickness:g} n={number} mu={mu:g}", bodies, touches, [{"weight": 1.0}], E=E,
        **options,
    )  # fmt: skip


def wall(
    rows: int = 2,
    cols: int = 2,
    mu: float = 0.6,
    *,
    push: float = 0.25,
    load: str = "all",
    base: str = "plane",
    cells: Sequence[int] = (4,),
    layers: int = 2,
    upright: bool = True,
    size: tuple[float, float] = (1.0, 0.5),
    press: float | None = None,
    weight: float = 1.0,
    friction: bool = True,
    E: float = 1e4,
    **options: Any,
) -> Held:
    """Bricks in running bond; odd rows begin and end with half a brick.

    Weight one a brick, then a push of the part ``push`` of mu times the weight.

    Args:
        rows, cols: Rows, and whole bricks in the lowest one.
        mu: Friction of all joints.
        push: Part of mu times the weight that is pushed along x.
        load: Which bricks are pushed: "all", or the "top" row.
        base: "plane" or "body".
        cells: Facets along a whole brick, of the bricks one after the other.
        layers: Cells over the height of a brick.
        upright: Whether the upright joints are paired.
        size: Width and height of a brick.
        press: Force of jaws at both sides, rigid planes; none by default.
        weight: Of a whole brick.
        friction: Whether there is friction at all.
        E: Young's modulus.
    """
    law = fm.Coulomb(mu) if friction else None
    width, height = size
    places: list[list[tuple[str, float, float]]] = []
    bodies, count = [], 0
    for r in range(rows):
        ends = [0.0, *(width * (k + 0.5) for k in range(cols)), cols * width]
        ends = [k * width for k in range(cols + 1)] if r % 2 == 0 else ends
        line = []
        for c, (a, b) in enumerate(zip(ends[:-1], ends[1:])):
            part = (b - a) / width
            n = max(round(part * cells[count % len(cells)]), 1)
            x = block(n, layers, width=b - a, height=height, corner=(a, r * height))
            pushed = part * weight if load == "all" or r == rows - 1 else 0.0
            bodies.append(Body(Grid(f"b{r}_{c}", x), weight=part * weight, push=pushed))
            line.append((f"b{r}_{c}", a, b))
            count += 1
        places.append(line)
    under, floor = floor_of(
        base, width=(cols + 1.0) * width, columns=2 * cols + 3, left=-0.5 * width
    )
    touches = [Touch(f"{name}/bottom", floor, law) for name, *_ in places[0]]
    for low, high in zip(places[:-1], places[1:]):
        touches += [
            Touch(f"{one}/bottom", f"{other}/top", law)
            for one, a, b in high
            for other, c, d in low
            if min(b, d) - max(a, c) > 1e-6 * width
        ]
    if upright:
        touches += [
            Touch(f"{one[0]}/right", f"{other[0]}/left", law)
            for line in places
            for one, other in zip(line[:-1], line[1:])
        ]
    if press is not None:
        left = Flat((0.0, 0.0), (1.0, 0.0), "left jaw")
        right = Flat((cols * width, 0.0), (-1.0, 0.0), "right jaw", force=(-press, 0.0))
        touches += [Touch(f"{line[0][0]}/left", left, law) for line in places]
        touches += [Touch(f"{line[-1][0]}/right", right, law) for line in places]
    pushes = sum(body.push for body in bodies)
    share = push * mu * sum(b.weight for b in bodies) / pushes
    if load == "top":
        share = push * mu
    path = [{"weight": 1.0}] + ([{"weight": 1.0, "push": share}] if push else [])
    return pose(
        f"wall {rows}x{cols} ({count} bricks) mu={mu:g} push={push:g} {load} {base}"
        f" cells={','.join(map(str, cells))}{'' if upright else ' no upright joints'}"
        f"{'' if press is None else f' jaws={press:g}'}{'' if friction else ' frictionless'}",
        [*bodies, *under],
        touches,
        path,
        E=E,
        small=20.0 * (rows * weight * (1.0 + push * mu) + (press or 0.0)) / E,
        **options,
    )


def t_junction(
    cells: Sequence[int] = (3, 3, 5),
    mu: float = 0.5,
    *,
    slave: str = "upper",
    pressure: float = 1.0,
    side: float | None = 0.0,
    material: Callable[..., Any] | None = None,
    E: float = 1e3,
    layers: int = 2,
    joint_slave: str = "A",
    **options: Any,
) -> Held:
    """C upon A and B side by side, with friction everywhere: a homogeneous state without slip.

    A and B stand on a frictionless guide, A's left side is held along x; ``pressure`` on C's top,
    ``side`` on the right sides of B and C and the left one of C [stress]; ``None`` holds these
    along x instead. Exact is a linear displacement, with the pressure ``pressure`` on the level
    joint per reference length and ``side`` on the upright one; see ``t_junction_exact``.

    Args:
        cells: Facets along A, B and C.
        slave: "upper": C is the slave of A and B, "lower": A and B are.
        joint_slave: Which side of the upright joint is the slave.
    """
    from scenes import linear_elastic

    law = fm.Coulomb(mu)
    a, b, c = cells
    bodies = [
        Body(Grid("A", block(a, layers, width=1.0, height=1.0, corner=(-1.0, 0.0)))),
        Body(Grid("B", block(b, layers + 1, width=1.0, height=1.0))),
        Body(Grid("C", block(c, layers, width=2.0, height=1.0, corner=(-1.0, 1.0)))),
    ]
    level = [("C/bottom", "A/top"), ("C/bottom", "B/top")]
    if slave == "lower":
        level = [pair[::-1] for pair in level]
    joint = ("A/right", "B/left") if joint_slave == "A" else ("B/left", "A/right")
    held = [("A/bottom", 1, 0.0), ("B/bottom", 1, 0.0), ("A/left", 0, 0.0)]
    loaded = ["C/top", "B/right", "C/right", "C/left"]
    sides = "held" if side is None else f"{side:g}"
    if side is None:
        held += [(name, 0, 0.0) for name in loaded[1:]]
        loaded, side = loaded[:1], pressure * NU / (1.0 - NU)
    scene = pose(
        f"T-junction cells={','.join(map(str, cells))} mu={mu:g} side={sides} slave={slave}"
        f",{joint_slave}",
        bodies,
        [Touch(*pair, law) for pair in (*level, joint)],
        [{}],
        E=E,
        material=material or linear_elastic,
        traction=loaded,
        held=held,
        small=20.0 * (pressure + side) / E,
        note=lambda scene: f"pressure off by {t_junction_error(scene):.1e}",
        wrong=lambda scene: "pressure" if t_junction_error(scene) > 1e-6 else "",
        **options,
    )
    R = rotation(scene.turn)
    for name, direction, size in (
        ("C/top", (0.0, -1.0), pressure),
        ("B/right", (-1.0, 0.0), side),
        ("C/right", (-1.0, 0.0), side),
        ("C/left", (1.0, 0.0), side),
    ):
        if name in loaded:
            scene.traction[name].value[:] = size * R @ direction
    scene.exact = t_junction_exact(pressure, side, E)  # type: ignore[attr-defined]
    return scene


def t_junction_exact(pressure: float, side: float, E: float) -> dict[str, float]:
    """Linear elasticity: strains, and pressures per deformed length of the joints."""
    strain_x = (1.0 + NU) / E * (-(1.0 - NU) * side + NU * pressure)
    strain_y = (1.0 + NU) / E * (-(1.0 - NU) * pressure + NU * side)
    return {
        "strain_x": strain_x,
        "strain_y": strain_y,
        "level": pressure / (1.0 + strain_x),
        "upright": side / (1.0 + strain_y),
    }


def t_junction_error(scene: Held) -> float:
    """Largest error of pressure and shear at nodes that carry any, over the largest pressure."""
    exact, worst = scene.exact, 0.0  # type: ignore[attr-defined]
    for contact, what in zip(scene.problem.contacts, ("level", "level", "upright")):
        on = contact.carries & contact.covered
        z_n, z_tau = contact.pressure[on], contact.z_tau[on]
        worst = max(worst, np.abs(z_n - exact[what]).max(), np.abs(z_tau).max())
    return float(worst / max(exact["level"], exact["upright"]))


def tower(
    seed: int = 1,
    *,
    part: float = 0.5,
    base: str = "plane",
    E: float = 1e5,
    **options: Any,
) -> Held:
    """4 to 8 blocks with random sizes, offsets and friction; then a lateral force.

    ``part``: of the lateral force, spread like the weight, that limit analysis allows.
    """
    rng = np.random.default_rng(seed)
    while True:
        bodies, touches = _tower(rng, base)
        directions = {"gravity": np.array([0.0, -1.0]), "push": np.array([1.0, 0.0])}
        found = judge(structure(bodies, touches, directions, {"weight": 1.0}, {"push": 1.0}))
        if found.feasible and found.factor > 0.02:
            break
    size = part * found.factor
    return pose(
        f"tower seed={seed} blocks={sum(not b.clamped for b in bodies)} part={part:g} {base}",
        bodies,
        touches,
        [{"weight": 1.0}, {"weight": 1.0, "push": size}],
        E=E,
        **options,
    )


def _tower(rng: np.random.Generator, base: str) -> tuple[list[Body], list[Touch]]:
    """A tower that may stand or not."""
    under, floor = floor_of(base, width=4.0, columns=9, left=-2.0)
    mu, x, y = rng.uniform(0.2, 0.9), 0.0, 0.0
    bodies, touches, before = [], [], floor
    width = rng.uniform(0.8, 1.4)
    for k in range(rng.integers(4, 9)):
        height = rng.uniform(0.3, 0.8)
        n = int(rng.integers(2, 6))
        grid = block(n, 2, width=width, height=height, corner=(x - 0.5 * width, y))
        weight = width * height
        bodies.append(Body(Grid(f"b{k}", grid), weight=weight, push=weight))
        touches.append(Touch(f"b{k}/bottom", before, fm.Coulomb(mu * rng.uniform(0.8, 1.2))))
        before, y = f"b{k}/top", y + height
        wide = width * rng.uniform(0.8, 1.1)
        x, width = x + rng.uniform(-0.2, 0.2) * width, wide
    return [*bodies, *under], touches


# Everything by the present code


def everything() -> Iterator[tuple[Callable[..., Held], dict[str, Any]]]:
    """The scenes of the table."""
    for mu in (0.2, 0.5, 0.9):
        for base in ("plane", "body"):
            for factor in (0.5, 0.95, 1.05, 1.3):
                yield incline, {"slope": np.arctan(factor * mu), "mu": mu, "base": base}
    for base in ("plane", "body"):
        for push in (0.001, 0.1, 0.45, 0.6):
            yield block_and_wall, {"push": push, "base": base}
        yield block_and_wall, {"push": 0.1, "base": base, "at_once": True}
    for groove in ("planes", "body"):
        for part in (0.01, 0.5, 0.95, 1.1, 1.8):
            yield wheel, {"part": part, "groove": groove}
    for base in ("plane", "body"):
        for factor in (0.9, 0.97, 1.03, 1.3):
            yield ladder, {"lean": np.arctan(factor / 0.8), "mu": 0.4, "base": base}
    for base in ("plane", "body"):
        for weight in (0.1, 0.8, 1.2):
            yield hanging, {"weight": weight, "base": base}
        yield hanging, {"weight": -0.5, "push": 0.1, "base": base}
    for kind in ("planes", "bodies"):
        for weight in (0.0, 0.3, 0.9, 1.1):
            yield jaws, {"weight": weight, "kind": kind}
        yield jaws, {"weight": 0.1, "force": 2.0, "mu": 0.8, "blocks": 3, "kind": kind}
    for base in ("plane", "body"):
        for push in (0.1, 0.7, 1.4):
            yield pressed, {"push": push, "base": base}
    for number in (5, 9):
        for thickness in (0.2, 0.12, 0.09, 0.06):
            yield arch, {"thickness": thickness, "number": number}
    for side in (None, 0.0, 0.5):
        for cells in ((2, 2, 3), (3, 3, 3), (3, 4, 5), (2, 2, 4)):
            for slave in ("upper", "lower"):
                yield t_junction, {"cells": cells, "side": side, "slave": slave}
    yield wall, {"rows": 2, "cols": 2, "friction": False, "push": 0.0}
    for rows, cols in ((2, 1), (2, 2), (3, 2)):
        for mu in (0.2, 0.6, 1.0):
            for cells in ((4,), (4, 6, 2)):
                yield wall, {"rows": rows, "cols": cols, "mu": mu, "cells": cells}
    yield wall, {"rows": 2, "cols": 2, "base": "body"}
    yield wall, {"rows": 2, "cols": 2, "upright": False}
    yield wall, {"rows": 2, "cols": 2, "load": "top", "push": 0.5}
    yield wall, {"rows": 2, "cols": 2, "press": 2.0}
    yield wall, {"rows": 4, "cols": 3}
    yield wall, {"rows": 6, "cols": 4, "cells": (4, 2)}
    for seed in range(1, 9):
        yield tower, {"seed": seed}


def trial(build: Callable[..., Held], options: dict[str, Any]) -> dict[str, Any]:
    """Set up one scene, solve it step by step, and judge."""
    begin = time.perf_counter()
    row: dict[str, Any] = {"scene": f"{build.__name__} {options}", "steps": []}
    try:
        held = build(**options)
    except Exception as error:
        return row | {"steps": [f"set-up: {type(error).__name__}: {error}"], "judgement": "WRONG"}
    row["scene"] = held.name
    good = True
    for step, loads in enumerate(held.path):
        said, allowed = limit(held, step)
        held.set(**loads)
        outcome, ended = "", ""
        try:
            report = held.problem.solve()
            moved, defects = held.largest(), report.certificate.violations()
            ended = "stays" if moved <= held.small else "moved"
            if held.stop is not None and abs(moved / held.stop - 1.0) < 0.01:
                ended = "at its stop"
            if defects:
                ended = "violated"
            elif held.wrong(held):
                ended = "wrong"
            words = defects[0][:60] if defects else "clean"
            outcome = f"{report.num_iterations} it, moved {moved:.2g}, {words} {held.note(held)}"
            outcome += f" {held.wrong(held)}"
        except fm.MortarError as error:
            ended, outcome = "refused", f"{type(error).__name__}: {str(error)[:110]}"
        except Exception as error:
            ended, outcome = "crash", f"{type(error).__name__}: {str(error)[:110]}"
        rights = {"stays": {"stays"}, "moves": {"refused"}, "open": {"stays", "refused", "moved"}}
        right = ended in rights[allowed]
        if held.stop is not None:
            right = ended in {"stays": {"stays"}, "moves": {"at its stop"}}.get(allowed, {ended})
        good &= right
        row["steps"].append(f"{said} | {outcome.replace('|', '/')} | {'right' if right else 'WRONG'}")
        if ended != "stays":
            break
    return row | {"judgement": "right" if good else "WRONG", "seconds": time.perf_counter() - begin}


def limit(held: Held, step: int) -> tuple[str, str]:
    """What limit analysis says of a step, in words, and whether bodies stay, move, or either."""
    if not any(body.weight or body.push or body.torque for body in held.bodies) or (
        held.name.startswith("pressed")
    ):
        part = float(held.path[step].get("push", 0.0))
        return "by construction", "stays" if part < 0.9 else "moves" if part > 1.2 else "open"
    verdict, needed = held.verdict(step)
    allowed = "open"
    if verdict.feasible and verdict.factor > 1.0 + MARGIN:
        allowed = "stays"
    if not verdict.feasible or verdict.factor * (1.0 + held.reserve) < 1.0 - MARGIN:
        allowed = "moves"
    words = "feasible" if verdict.feasible and verdict.factor >= 1.0 else "infeasible"
    factor = abs(verdict.factor)
    return f"{words}, factor {factor:.3f}, friction needed {needed:.3f}", allowed


def main() -> None:
    """Print a row per step of each scene."""
    wanted = sys.argv[1:]
    print("| scene | step | judge | outcome | |\n|---|---|---|---|---|")
    count, right, begin = 0, 0, time.perf_counter()
    for build, options in everything():
        if wanted and not any(build.__name__.startswith(name) for name in wanted):
            continue
        row = trial(build, options)
        count, right = count + 1, right + (row["judgement"] == "right")
        for number, step in enumerate(row["steps"], start=1):
            print(f"| {row['scene']} | {number} | {step} |", flush=True)
    print(f"\n{right} of {count} scenes right, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
