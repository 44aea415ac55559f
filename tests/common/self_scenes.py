# SPDX-License-Identifier: MIT
"""Bodies that touch themselves or each other, with and without chosen sides."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from scenes import TIGHT, internal, neo_hookean, read

import ufl
from dolfinx import fem

import fenics_mortar as fm
from demos.studies.stability import random_itself
from meshes import mapped_grids
from meshes.mapped_grids import Grid, block, mapped, sector

E, NU = 100.0, 0.3


class Driven:
    """A problem loaded by prescribed motions of parts of boundaries.

    Attributes:
        data: Mesh and names.
        u: Displacement.
        problem: The problem.
        moved: Prescribed displacements by name of the part.
    """

    def __init__(
        self, grids: list[Grid] | fm.MeshData, parts: dict[str, Any], pairs: Any, *,
        problem: Any = None, order: int = 1, reverse: bool = False, foundation: float = 0.0,
        residual: Any = None,
    ) -> None:  # fmt: skip
        """Set up.

        Args:
            grids: The bodies, or their mesh.
            parts: Prescribed parts by name: functions of x (3, n) that mark nodes, bool (n,).
            pairs: Function of the mesh data that returns the pairs.
            problem: Options of the problem.
            order: Order of cells and displacement.
            reverse: Whether the nodes are numbered from the other end.
            foundation: Stiffness of springs at all points [stress / length^2].
            residual: Function of the displacement that returns the internal virtual work; that of
                plane neo-Hookean bodies by default.
        """
        if isinstance(grids, fm.MeshData):
            self.data = grids
        else:
            bodies = [backwards(grid) for grid in grids] if reverse else grids
            self.data = read(lambda: mapped_grids.build(bodies, order=order))
        V = fm.vector_space(self.data.mesh, order)
        self.u, self.moved, bcs = fem.Function(V), {}, []
        for name, where in parts.items():
            self.moved[name] = fem.Constant(self.data.mesh, (0.0, 0.0))
            bcs.append(fem.dirichletbc(self.moved[name], fem.locate_dofs_geometrical(V, where), V))
        if residual is None:
            form = internal(self.u, neo_hookean(self.u, E, NU))
        else:
            form = residual(self.u)
        if foundation:
            form += foundation * ufl.inner(self.u, ufl.TestFunction(V)) * ufl.dx
        options = {"petsc_options_prefix": "test_self_", "newton": TIGHT, **(problem or {})}
        self.problem = fm.ContactProblem(form, self.u, pairs(self.data), bcs=bcs, **options)

    def move(self, steps: int, **motions: Any) -> Any:
        """Move parts proportionally to new positions; return the path's report.

        Args:
            steps: Number of steps at least.
            motions: Displacement of each part at the end, shape (2,) [length].
        """
        start = {name: self.moved[name].value.copy() for name in motions}

        def load(time: float) -> None:
            for name, motion in motions.items():
                self.moved[name].value[:] = start[name] + time * (motion - start[name])

        options = fm.SteppingOptions(step=1.0 / steps, smallest=1e-3 / steps)
        return fm.follow_path(self.problem, load, options=options)

    @property
    def contact(self):
        return self.problem.equations.contacts[0]

    def forces(self) -> np.ndarray:
        """Norms of the contact forces of all pairs [stress length]."""
        return np.array([
            np.linalg.norm(c.operators.force(c.z)[0], axis=1).sum()
            for c in self.problem.equations.contacts
        ])  # fmt: skip


def backwards(grid: Grid) -> Grid:
    """The body with its columns and rows numbered from the other end."""
    other = {"left": "right", "right": "left", "top": "bottom", "bottom": "top"}
    names = {other[side]: grid.boundary(side) for side in mapped_grids.SIDES}
    return replace(grid, x=grid.x[::-1, ::-1], joined=names)


def c_ring(
    pairs: Any, *, mouth: float = 0.12, columns: int = 36, centre: float = 0.0, **options: Any
) -> Driven:
    """A ring with a mouth of parallel ends on the right, fixed at the bottom, moved at the top.

    Its centre is at x = ``centre``, so that it may be the section of a torus.
    """
    half = np.arcsin(mouth)
    shape = sector(columns, 3, radii=(0.8, 1.0), angles=(half, 2 * np.pi - half))
    shape[0, :, 1], shape[-1, :, 1] = 0.5 * mouth, -0.5 * mouth
    shape[..., 0] += centre

    def end_at(side: float) -> Any:
        def where(x: Any) -> Any:
            r = x[0] - centre
            return (np.hypot(r, x[1]) > 0.999) & (r > 0.6) & (side * x[1] > 0.2)

        return where

    names = {"left": "ring/first", "right": "ring/last"}
    return Driven(
        [Grid("ring", shape, joined=names)],
        {"low": end_at(-1.0), "high": end_at(1.0)},
        pairs,
        **options,
    )


def strip_shape(*, thickness: float = 0.1, gap: float = 0.1, order: int = 1) -> np.ndarray:
    """Positions of the nodes of a strip with three arms and two bends, along it and across."""
    radius, length = 0.5 * (gap + thickness), 1.0
    along, around = 12 * order, 8 * order
    line: list[np.ndarray] = [np.zeros(2)]
    for arm, sign in enumerate((1.0, -1.0, 1.0)):
        line += [line[-1] + [sign * length * k / along, 0.0] for k in range(1, along + 1)]
        if arm < 2:
            centre = line[-1] + [0.0, radius]
            turn = -0.5 * np.pi + sign * np.linspace(0.0, np.pi, around + 1)[1:]
            line += list(centre + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    middle = np.array(line)
    tangent = np.gradient(middle, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    t = thickness * np.linspace(-0.5, 0.5, 2 * order + 1)
    return np.asarray(middle[:, None] + t[None, :, None] * normal[:, None])


def strip_ends(shape: np.ndarray) -> dict[str, Any]:
    """Parts of ``strip_shape``: the lowest points, and the middle of the highest ones."""
    low, high = shape[..., 1].min(), shape[..., 1].max()
    near = 1e-6 * (high - low)
    return {
        "low": lambda x: x[1] < low + near,
        "high": lambda x: (x[1] > high - near) & (x[0] > 0.3) & (x[0] < 0.7),
    }


def strip_in_s(pairs: Any, *, thickness: float = 0.1, gap: float = 0.1, **options: Any) -> Driven:
    """A strip with three arms and two bends; the upper arm is moved, the lower one is fixed."""
    shape = strip_shape(thickness=thickness, gap=gap, order=options.get("order", 1))
    names = {side: "strip/outline" for side in mapped_grids.SIDES}
    return Driven([Grid("strip", shape, joined=names)], strip_ends(shape), pairs, **options)


def tube(pairs: Any, *, columns: int = 40, upright: bool = True, **options: Any) -> Driven:
    """A tube, flattened by motions of two opposite lines of its outside."""
    shape = sector(columns, 3, radii=(0.85, 1.0))
    x, y = (0, 1) if upright else (1, 0)
    names = {"top": "tube/inside", "bottom": "tube/outside"}

    def end_at(side: float) -> Any:
        width = 0.1
        return lambda X: (np.hypot(X[0], X[1]) > 0.999) & (abs(X[x]) < width) & (side * X[y] > 0.0)

    return Driven(
        [Grid("tube", shape, joined=names, closed=True)],
        {"low": end_at(-1.0), "high": end_at(1.0)},
        pairs,
        **options,
    )


def flattened_tube(law: Any, *, steps: int = 20) -> tuple[Driven, Any]:
    """A tube pressed flat between two planes until its inside touches itself, and the path."""
    planes = fm.Plane((0.0, 1.0), (0.0, -1.0)), fm.Plane((0.0, -1.0), (0.0, 1.0))
    names = {"top": "tube/inside", "bottom": "tube/outside"}
    shape = sector(64, 3, radii=(0.85, 1.0))

    def pairs(data: fm.MeshData) -> list[fm.ContactPair]:
        outside = [fm.ContactPair(data, "tube/outside", plane, law=law) for plane in planes]
        return [fm.ContactPair(data, "tube/inside", law=law), *outside]

    made = Driven([Grid("tube", shape, joined=names, closed=True)], {}, pairs)

    def load(time: float) -> None:
        for plane, shift in zip(planes, (-0.86, 0.86), strict=True):
            plane.move(y=shift * time)

    options = fm.SteppingOptions(step=1.0 / steps, smallest=0.01 / steps)
    return made, fm.follow_path(made.problem, load, options)


def ten_bodies(
    pairs: Any, *, seed: int = 1, foundation: float = 0.5, joined: bool = True, **options: Any
) -> Driven:
    """Ten blocks of random sizes between a ground and a tool, on weak springs.

    ``joined``: whether the argument of ``pairs`` is the list of whole outlines; otherwise two
    lists, of lower and upper sides and of left and right sides.
    """
    rng = np.random.default_rng(seed)
    grids, y = [], 0.0
    for layer, count in enumerate((3, 4, 3)):
        height, cuts = rng.uniform(0.5, 0.8), np.linspace(0.0, 3.0, count + 1)
        cuts[1:-1] += rng.uniform(-0.12, 0.12, count - 1)
        for i, (a, b) in enumerate(pairwise(cuts)):
            bulge = rng.uniform(0.0, 0.03)

            def position(s: Any, t: Any, a=a, b=b, y=y, height=height, bulge=bulge) -> Any:
                bent = bulge * np.sin(np.pi * s) * (t - 0.5)
                return a + (b - a - 0.01) * s, y + height * t + bent

            shape = mapped(int(rng.integers(5, 9)), int(rng.integers(3, 5)), position)
            name = f"b{layer}{i}"
            names = dict.fromkeys(mapped_grids.SIDES, f"{name}/outline") if joined else {}
            grids.append(Grid(name, shape, joined=names))
        y += height + 0.03
    tool = block(13, 2, width=3.2, height=0.3, corner=(-0.1, y))
    ground = block(11, 2, width=3.4, height=0.3, corner=(-0.2, -0.33))
    plates = ["tool/bottom", "ground/top"]
    given: Any = [f"{grid.name}/outline" for grid in grids] + plates
    if not joined:
        level, upright = (
            [f"{grid.name}/{side}" for grid in grids for side in sides]
            for sides in (("bottom", "top"), ("left", "right"))
        )
        given = level + plates, upright
    grids += [Grid("tool", tool), Grid("ground", ground)]
    return Driven(
        grids,
        {"low": lambda x: x[1] < -0.329, "high": lambda x: x[1] > y + 0.299},
        lambda data: pairs(data, given),
        foundation=foundation,
        **options,
    )


def honeycomb(pairs: Any) -> Driven:
    """A honeycomb of 3 x 3 cells; the lower ends of its columns are fixed, the upper ones moved."""
    data, (low, high), _ = random_itself.honeycomb(3, 0.15, 0.02, along=4, seed=1)
    return Driven(data, {"low": low, "high": high}, pairs)
