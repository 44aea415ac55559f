# SPDX-License-Identifier: MIT
"""Random rows and stacks of bodies without load beside a block that is pressed on its ground.

The block is pressed at its top, twice; one to three others are beside it, on either side, one
behind or on top of the other, and touch their neighbours and the ground, or have small gaps.
Nothing presses them: no force acts on them, they move rigidly, and they stay if the load on a rigid
plane decreases (an elastic ground rises again). Nothing overlaps, by the outlines of the bodies,
and the ground bears the load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.common import linear_elastic, neo_hookean
from demos.studies.stability.physics import SOLVED, certified, differs, size
from fenics_mortar.energies import lame
from meshes.mapped_grids import SIDES, Grid, block, mesh

# Largest force on an idle body over the load, and motion of one that stays over the unit of length,
# by roundoff [1].
NOTHING = 1e-12
# Largest overlap of a node over the load's strain times the unit of length [1], of any body on a
# plane, of an idle one and of the pressed one on an elastic ground: gaps are closed in the mean of
# facets, whose sides bend, most under a corner that presses. Up to 0.007, 0.04 and 0.11 are
# measured; a block that does not give way overlaps by about half of nu.
OF_FACETS = {"plane": 0.01, "idle": 0.06, "pressed": 0.2}
# Largest deformation of an idle body over the load's strain [1], by Newton's tolerance; the square
# of its motion is added, since the rotations of linear strains are small ones.
RIGID = 1e-6
# Largest force along an elastic ground without friction over the load [1]: nothing but the ends of
# the ground determines where the block rests, and springs may carry what is far below the error of
# the mesh (``RigidOptions.negligible``).
NEUTRAL = 0.005
# Largest motion of an idle body over the load's strain times the unit of length [1]: sides bulge by
# less than half of the width times the strain, and bodies turn by it.
FARTHEST = 10.0


@dataclass
class Block:
    """A block, and its neighbours.

    Attributes:
        name: Its name.
        box: Left and lower end, width, height [unit].
        counts: Columns and rows of cells.
        beside: Blocks beside it or below, with its own side and theirs, and whether its own side is
            the slave.
    """

    name: str
    box: tuple[float, float, float, float]
    counts: tuple[int, int]
    beside: list[tuple[str, str, str, bool]] = field(default_factory=list)

    def grid(self, order: int, axes: np.ndarray, unit: float) -> Grid:
        """Its mesh."""
        x, y, width, height = self.box
        counts = (order * n for n in self.counts)
        own = block(*counts, width=width, height=height, corner=(x, y))
        return Grid(self.name, unit * own @ axes.T)


def draw_idle(rng: np.random.Generator) -> tuple[dict[str, Any], Callable[[], Any]]:
    """Draw a row and its judge."""
    angle, unit, E = rng.uniform(0.0, 2.0 * np.pi), size(rng, 1e-3, 1e3), size(rng, 1e-3, 1e6)
    strain, factor = size(rng, 1e-5, 5e-3), float(rng.choice([0.0, 0.3, 2.0, 5.0]))
    blocks = _blocks(rng)
    low, high = (
        f([b.box[0] + end * b.box[2] for b in blocks for end in (0, 1)]) for f in (min, max)
    )
    ground = None
    if rng.random() < 0.5:
        columns = int(rng.integers(2, 5) * (high - low) + 3)
        box = (low - 0.5, -0.8, high - low + 1.0, 0.8)
        ground = Block("ground", box, (columns, int(rng.integers(2, 4))))
    about = {
        "scene": f"{len(blocks) - 1} on {'a body' if ground else 'a plane'}", "strain": strain,
        "factor": factor, "mu": float(rng.choice([0.0, rng.uniform(0.05, 0.6)])),
        "nu": rng.uniform(0.0, 0.4), "degree": int(rng.integers(1, 3)),
        "cell": str(rng.choice(["triangle", "quadrilateral"])),
        "material": str(rng.choice(["linear", "neo-Hookean"])),
        "ground is slave": bool(rng.random() < 0.4), "angle": angle,
        "blocks": [(b.name, b.box, b.counts, b.beside) for b in blocks],
    }  # fmt: skip
    order = rng.permutation(20).tolist()

    def solve() -> Any:
        scene = _scene(about, blocks, ground, order, (unit, E, angle))
        reports, errors, before = [], [], scene.positions()
        for load in (1.0, factor):
            scene.press(load)
            reports.append(scene.problem.solve())
            now = scene.positions()
            errors += [f"load {load:g}: {w}" for w in _judge(scene, load, before, now)]
            before = now
        violations, remarks = certified([scene.problem])
        return reports, errors + violations, remarks

    return about, solve


def _blocks(rng: np.random.Generator) -> list[Block]:
    """The pressed block and the idle ones, whose neighbours are drawn before them."""

    def counts(width: float, height: float) -> tuple[int, int]:
        n = np.maximum(np.round(rng.uniform(2.0, 4.5, 2) * (width, height)), 2)
        return int(n[0]), int(n[1])

    width, height = rng.uniform(0.8, 1.5), rng.uniform(0.4, 1.2)
    pressed = Block("pressed", (0.0, 0.0, width, height), counts(width, height))
    blocks, last = [pressed], {"left": pressed, "right": pressed}
    closed: set[str] = set()
    for k in range(int(rng.integers(1, 4))):
        side = str(rng.choice(["left", "right"]))
        side = {"left": "right", "right": "left"}[side] if side in closed else side
        inner, back = last[side], {"left": "right", "right": "left"}[side]
        gap, hover = (float(rng.choice([0.0, 0.0, rng.uniform(0.02, 0.05)])) for _ in range(2))
        x, y, w, h = inner.box
        stacked = inner is not pressed and side not in closed and rng.random() < 0.4
        width, height = rng.uniform(0.4, 1.2), rng.uniform(0.3, 1.0)
        slaves = [bool(rng.random() < 0.5) for _ in range(2)]
        if stacked:
            closed.add(side)
            width *= w / 1.2
            x, y = (x if side == "right" else x + w - width), y + h + hover
            beside = [(inner.name, "bottom", "top", slaves[0])]
            if y < pressed.box[3] and inner.beside[0][0] == "pressed":
                beside.append(("pressed", back, side, True))
        else:
            x, y = (x + w + gap if side == "right" else x - width - gap), hover
            beside = [(inner.name, back, side, slaves[0])]
        new = Block(f"idle{k}", (x, y, width, height), counts(width, height), beside)
        last[side] = new
        blocks.append(new)
        if len(closed) == 2:
            break
    return blocks


@dataclass
class Scene:
    """The problem, and what is needed to load and to judge it.

    Attributes:
        problem: The problem.
        load: Pressure at the top of the pressed block [stress].
        about: The drawn values.
        blocks: The blocks.
        names: Bodies of the slave and the master of each pair.
        axes: Axes of the problem, columns of a (2, 2) array.
        unit: Unit of length [length].
        pressure: Pressure of the first load [stress].
        bodies, outlines: Dofs of the nodes of each body and in order along its outline.
    """

    problem: fm.ContactProblem
    load: fem.Constant
    about: dict[str, Any]
    blocks: Sequence[Block]
    names: list[tuple[str, str]]
    axes: np.ndarray
    unit: float
    pressure: float
    bodies: dict[str, np.ndarray]
    outlines: dict[str, np.ndarray]

    def press(self, factor: float) -> None:
        """Set the load."""
        self.load.value = factor * self.pressure

    def positions(self) -> np.ndarray:
        """Present positions of all nodes in the frame of the problem, (n, 2) [unit]."""
        u = self.problem.equations.bulk.u
        X = u.function_space.tabulate_dof_coordinates()[:, :2]
        return (X + u.x.array.reshape(-1, 2)) @ self.axes / self.unit


def _scene(
    about: dict[str, Any], blocks: Sequence[Block], ground: Block | None, order: list[int],
    units: tuple[float, float, float],
) -> Scene:  # fmt: skip
    """The problem of a row."""
    unit, E, angle = units
    c, s = np.cos(angle), np.sin(angle)
    axes, degree = np.array([[c, -s], [s, c]]), about["degree"]
    every = [*blocks, *([ground] if ground else [])]
    grids = [b.grid(degree, axes, unit) for b in sorted(every, key=lambda b: order[len(b.name)])]
    data = mesh(grids, order=degree, cell=about["cell"], comm=MPI.COMM_SELF)
    V = fm.vector_space(data.mesh, degree)
    u, v = fem.Function(V), ufl.TestFunction(V)
    load, up = fem.Constant(data.mesh, 0.0), ufl.as_vector(tuple(axes[:, 1]))
    stress = {"linear": linear_elastic, "neo-Hookean": neo_hookean}[about["material"]]
    metadata = {"quadrature_degree": 2 * degree + 2}
    ds = ufl.Measure("ds", data.mesh, subdomain_data=data.facet_tags, metadata=metadata)
    residual = ufl.inner(stress(u, *lame(E, about["nu"])), ufl.grad(v)) * ufl.dx(metadata=metadata)
    residual += load * ufl.dot(up, v) * ds(data.boundary_tags("pressed/top")[0])
    plane = fm.Plane((0.0, 0.0), tuple(axes[:, 1]), name="ground")
    law = fm.Coulomb(about["mu"]) if about["mu"] else None
    pairs, names = [], []
    for b in blocks:
        own: list[tuple[str, Any]] = [(f"{b.name}/bottom", "ground/top" if ground else plane)]
        if ground and b.name == "pressed" and about["ground is slave"]:
            own = [("ground/top", "pressed/bottom")]
        if any(side == "bottom" for _, side, _, _ in b.beside):
            own = []
        for other, side, its, is_slave in b.beside:
            touching = f"{b.name}/{side}", f"{other}/{its}"
            own.append(touching if is_slave else touching[::-1])
        for touching in own:
            pairs.append(fm.ContactPair(data, *touching, law=law))
            names.append(tuple(t if t is plane else t.split("/")[0] for t in touching))
    rank = np.argsort(order[: len(pairs)])
    bcs = [fm.dirichlet(V, data, "ground/bottom", (0.0, 0.0))] if ground else []
    problem = fm.ContactProblem(
        residual, u, [pairs[i] for i in rank], bcs=bcs, petsc_options_prefix="idle_"
    )
    data.mesh.topology.create_connectivity(2, 2)
    bodies = {
        b.name: fem.locate_dofs_topological(V, 2, data.cell_tags.find(data.body_tag(b.name)))
        for b in every
    }
    own_x = V.tabulate_dof_coordinates()[:, :2] @ axes
    outlines = {}
    for b in every:
        parts = []
        for side, along, sign in zip(SIDES, (0, 1, 0, 1), (1, 1, -1, -1), strict=True):
            facets = data.facet_tags.find(data.boundary_tags(f"{b.name}/{side}")[0])
            dofs = fem.locate_dofs_topological(V, 1, facets)
            parts.append(dofs[np.argsort(sign * own_x[dofs, along])][:-1])
        outlines[b.name] = np.concatenate(parts)
    return Scene(
        problem, load, about, blocks, [names[i] for i in rank], axes, unit, about["strain"] * E,
        bodies, outlines,
    )  # fmt: skip


def _judge(scene: Scene, load: float, before: np.ndarray, now: np.ndarray) -> Iterator[str]:
    """Messages on forces on idle bodies, on their motions since ``before``, and on overlaps."""
    width, strain = scene.blocks[0].box[2], scene.about["strain"]
    total, on_plane = scene.pressure * width * scene.unit, "ground" not in scene.outlines
    drifts = not (on_plane or scene.about["mu"])
    for sides, contact in zip(scene.names, scene.problem.contacts, strict=True):
        if not any(str(name).startswith("idle") for name in sides):
            sign = -1.0 if sides[0] == "ground" else 1.0
            along, across = sign * contact.total_force @ scene.axes / total
            yield from differs("1 + the reaction", 1.0 + across, 1.0 + load, SOLVED)
            allowed = NEUTRAL if drifts else SOLVED
            yield from differs("1 + the force along the ground", 1.0 + along, 1.0, allowed)
            continue
        force = float(np.abs(contact.forces).sum())
        if not force <= NOTHING * total:
            yield f"a force of {force / total:.1e} loads acts between {sides}"
    for b in scene.blocks[1:]:
        nodes = scene.bodies[b.name]
        moved = now[nodes] - before[nodes]
        largest, deformed = np.abs(moved).max(), _deformation(before[nodes], moved)
        if not deformed <= largest**2 + RIGID * strain + NOTHING:
            yield f"{b.name} is deformed by {deformed:.1e} units"
        if load < 1.0 and on_plane and not largest <= NOTHING:
            yield f"{b.name} moves by {largest:.1e} units while the load decreases"
        if not (drifts or largest <= FARTHEST * max(load, 1.0) * strain):
            yield f"{b.name} moves by {largest:.1e} units"
    for depth, names in overlaps(scene, now):
        kind = "idle" if any(name.startswith("idle") for name in names) else "pressed"
        kind = "plane" if on_plane else kind
        if not depth <= OF_FACETS[kind] * max(load, 1.0) * strain + NOTHING:
            yield f"{names[0]} overlaps {names[1]} by {depth / strain:.2g} strains"


def overlaps(scene: Scene, now: np.ndarray) -> Iterator[tuple[float, tuple[str, str]]]:
    """Largest depth of nodes of a body in another one [unit], and their names."""
    for one, other in permutations(scene.outlines, 2):
        yield _depth(now[scene.outlines[one]], now[scene.outlines[other]]), (one, other)
    if "ground" not in scene.outlines:
        for name, nodes in scene.outlines.items():
            yield float(-now[nodes, 1].min()), (name, "ground")


def _depth(x: np.ndarray, polygon: np.ndarray) -> float:
    """Largest distance from a polygon (m, 2) of those of the points (n, 2) that are inside."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    edge, to = b - a, x[:, None] - a
    t = np.clip((to * edge).sum(axis=2) / (edge**2).sum(axis=1), 0.0, 1.0)
    away = np.linalg.norm(to - t[..., None] * edge, axis=2).min(axis=1)
    up = (a[:, 1] <= x[:, 1:]) != (b[:, 1] <= x[:, 1:])
    left = edge[:, 0] * to[..., 1] - edge[:, 1] * to[..., 0] > 0.0
    inside = (up & (left == (edge[:, 1] > 0.0))).sum(axis=1) % 2 == 1
    return float(away[inside].max(initial=0.0))


def _deformation(x: np.ndarray, moved: np.ndarray) -> float:
    """Largest motion (n, 2) of points (n, 2) besides the rigid one that is nearest."""
    own, one, zero = x - x.mean(axis=0), np.ones(len(x)), np.zeros(len(x))
    motions = ((one, zero), (zero, one), (-own[:, 1], own[:, 0]))
    rigid = np.stack([np.stack(m, axis=1).ravel() for m in motions], axis=1)
    fit = np.linalg.lstsq(rigid, moved.ravel(), rcond=None)[0]
    return float(np.abs(moved.ravel() - rigid @ fit).max())
