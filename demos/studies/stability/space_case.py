# SPDX-License-Identifier: MIT
"""A problem in space as numbers: bodies, tools, motions, pairs, and the frame it is posed in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import fenics_mortar as fm
from demos.studies.stability.case import at_time
from demos.studies.stability.random_bodies import Array
from meshes.mapped_boxes import Box


@dataclass(frozen=True)
class Frame:
    """Where a problem is, and its units.

    Attributes:
        turn: Orthogonal matrix, which may mirror, shape (3, 3).
        shift: Position of the origin after the turn [unit].
        unit: Unit of length [length].
        stress: Unit of stress [stress].
    """

    turn: Array
    shift: Array
    unit: float
    stress: float

    def point(self, x: Any) -> Array:
        """Positions of points (..., 3) [unit] in the problem [length]."""
        return np.asarray(self.unit * (np.asarray(x) @ self.turn.T + self.shift))

    def vector(self, v: Any) -> Array:
        """Directions of vectors (..., 3) in the problem, of the same lengths."""
        return np.asarray(np.asarray(v) @ self.turn.T)

    def axial(self, w: Any) -> Array:
        """Rotation vectors (3,) in the problem: a mirror changes their sign, too."""
        return np.asarray(np.sign(np.linalg.det(self.turn)) * self.vector(w))

    def own(self, x: Array) -> Array:
        """Points (..., 3) of the problem [length] in the drawing [unit]."""
        return np.asarray((x / self.unit - self.shift) @ self.turn)

    def other(self, rng: np.random.Generator, *, mirrored: bool) -> Frame:
        """Another one, turned, moved and with other units."""
        turn = random_turn(rng) @ np.diag([1.0, 1.0, -1.0 if mirrored else 1.0])
        unit, stress = 10.0 ** rng.uniform(-3.0, 3.0, 2)
        return Frame(turn @ self.turn, rng.uniform(-2, 2, 3), float(unit), float(stress))


def random_turn(rng: np.random.Generator) -> Array:
    """A rotation matrix."""
    return np.asarray(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix())


# The frame of the drawing.
UPRIGHT = Frame(np.eye(3), np.zeros(3), 1.0, 1.0)


@dataclass(frozen=True)
class Solid:
    """A body.

    Attributes:
        box: Its nodes [unit].
        E: Young's modulus [unit of stress].
        nu: Poisson's ratio [1].
        force: Dead load per volume at times 0, 1, ..., (times, 3) [unit of stress / unit].
    """

    box: Box
    E: float
    nu: float
    force: Array = field(default_factory=lambda: np.zeros((2, 3)))

    def load(self, time: float) -> Array:
        """Load per volume at a time, shape (3,)."""
        return at_time(self.force, time)


@dataclass(frozen=True)
class Motion:
    """Rigid motion of a boundary or tool, linear between its values at times 0, 1, and so on.

    Attributes:
        moves: Translation [unit] and rotation vector [radian], shape (times, 6).
        about: Centre of the rotation [unit].
    """

    moves: Array
    about: Array = field(default_factory=lambda: np.zeros(3))

    def at(self, time: float) -> Array:
        """Translation and rotation vector at a time, shape (6,)."""
        return at_time(self.moves, time)

    def moved(self, x: Array, time: float) -> Array:
        """Positions (n, 3) [unit] at a time of points that are at ``x`` first."""
        now = self.at(time)
        turned = (x - self.about) @ Rotation.from_rotvec(now[3:]).as_matrix().T
        return np.asarray(turned + self.about + now[:3])

    def back(self, x: Array, time: float) -> Array:
        """First positions (n, 3) [unit] of points that are at ``x`` at a time."""
        now = self.at(time)
        turn = Rotation.from_rotvec(now[3:]).as_matrix()
        return np.asarray((x - self.about - now[:3]) @ turn + self.about)


@dataclass(frozen=True)
class Tool:
    """A rigid obstacle, with its distance by own formulas.

    Attributes:
        kind: One of ``KINDS``.
        point: Its centre; a point of a plane; the middle of the base of a punch [unit].
        axis: Normal of a plane; axis of a cylinder, a torus or of a punch, from its base inward.
        radius: Radius; half the width of a punch; that of the tube of a torus is a third [unit].
        motion: Its motion.
        first: Direction across an extruded punch.
        rounding: Of the edge of a punch, over the radius [1].
    """

    kind: str
    point: Array
    axis: Array
    radius: float
    motion: Motion
    first: Array | None = None
    rounding: float = 0.3

    def make(self, frame: Frame, name: str) -> Any:
        """The obstacle in a frame."""
        return KINDS[self.kind][0](self, frame, name)

    def distance(self, x: Array, time: float) -> Array:
        """Signed distances (n,) [unit] of points (n, 3) [unit] at a time."""
        return np.asarray(KINDS[self.kind][1](self, self.motion.back(x, time) - self.point))


def _placed(tool: Tool, frame: Frame, name: str) -> dict[str, Any]:
    """Name and pivot of an obstacle."""
    return {"name": name, "pivot": frame.point(tool.motion.about)}


def _profile(tool: Tool, frame: Frame, name: str) -> Any:
    """Section of a punch, with its base at y = 0."""
    r = frame.unit * tool.radius
    corners = [(-r, 0.0), (r, 0.0), (r, 2.0 * r), (-r, 2.0 * r)]
    return fm.Polygon(corners, rounding=tool.rounding * r, name=name)


def _ring(tool: Tool, frame: Frame, name: str) -> Any:
    point, axis = frame.point(tool.point), frame.vector(tool.axis)
    r = frame.unit * tool.radius
    return fm.Torus(point, axis, r, r / 3.0, **_placed(tool, frame, name))


def _extruded(tool: Tool, frame: Frame, name: str) -> Any:
    """The second coordinate, inward, is along axis x first."""
    along = np.cross(tool.first, tool.axis)
    return fm.Extruded(
        _profile(tool, frame, name), origin=frame.point(tool.point), first=frame.vector(tool.first),
        axis=frame.axial(along), **_placed(tool, frame, name),
    )  # fmt: skip


def _along(tool: Tool, x: Array) -> tuple[Array, Array]:
    """Coordinate of points along the axis, and distance from it, each (n,)."""
    along = x @ tool.axis
    return along, np.linalg.norm(x - along[:, None] * tool.axis, axis=1)


def _rounded(tool: Tool, across: Array, along: Array) -> Array:
    """Distance from the section of a punch."""
    r, edge = tool.radius, tool.rounding * tool.radius
    q = np.stack([np.abs(across), np.abs(along - r)]) - (r - edge)
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=0)
    return np.asarray(outside + np.minimum(q.max(axis=0), 0.0) - edge)


# Obstacle of the package and own distance of points from a tool at ``point``, by kind.
KINDS: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "plane": (
        lambda t, f, name: fm.Plane(
            f.point(t.point), f.vector(t.axis), **_placed(t, f, name)
        ),
        lambda t, x: x @ t.axis,
    ),
    "sphere": (
        lambda t, f, name: fm.Sphere(
            f.point(t.point), f.unit * t.radius, **_placed(t, f, name)
        ),
        lambda t, x: np.linalg.norm(x, axis=1) - t.radius,
    ),
    "cylinder": (
        lambda t, f, name: fm.Cylinder(
            f.point(t.point), f.vector(t.axis), f.unit * t.radius, **_placed(t, f, name)
        ),
        lambda t, x: _along(t, x)[1] - t.radius,
    ),
    "torus": (
        _ring,
        lambda t, x: np.hypot(_along(t, x)[1] - t.radius, _along(t, x)[0]) - t.radius / 3.0,
    ),
    "revolved": (
        lambda t, f, name: fm.Revolved(
            _profile(t, f, name), origin=f.point(t.point), axis=f.vector(t.axis),
            **_placed(t, f, name),
        ),
        lambda t, x: _rounded(t, _along(t, x)[1], _along(t, x)[0]),
    ),
    "extruded": (_extruded, lambda t, x: _rounded(t, x @ t.first, x @ t.axis)),
}  # fmt: skip


@dataclass(frozen=True)
class Friction:
    """Law of a pair.

    Attributes:
        mu: Coulomb's coefficient [1].
        shear: Largest shear, if positive [unit of stress].
    """

    mu: float = 0.0
    shear: float = 0.0

    def law(self, frame: Frame) -> Any:
        """The law in a frame."""
        if not self.mu:
            return None
        largest = {"max_shear": frame.stress * self.shear} if self.shear else {}
        return fm.Coulomb(self.mu, **largest)

    def limit(self, pressure: Array) -> Array:
        """Largest shear (n,) at pressures (n,)."""
        return np.minimum(self.mu * np.maximum(pressure, 0.0), self.shear or np.inf)


@dataclass(frozen=True)
class SpaceCase:
    """A problem as numbers.

    Attributes:
        about: Drawn values, as text.
        solids: Bodies.
        pairs: Slave boundary, and master boundary or name of a tool.
        laws: Laws of the pairs.
        held: Boundaries with prescribed motions.
        tools: Rigid obstacles by name.
        cell: ``"tetrahedron"`` or ``"hexahedron"``.
        degree: Degree of the displacement.
        stop: Final time.
        steps: Number of steps in each unit of time.
        frame: Where the problem is.
        strain: Typical strain, for tolerances [1].
    """

    about: dict[str, Any]
    solids: list[Solid]
    pairs: list[tuple[str, str]]
    laws: list[Friction]
    held: dict[str, Motion]
    tools: dict[str, Tool]
    cell: str
    degree: int
    stop: float
    steps: int
    frame: Frame
    strain: float

    def swapped(self) -> SpaceCase:
        """The problem with exchanged roles; tools remain masters."""
        pairs = [pair if pair[1] in self.tools else pair[::-1] for pair in self.pairs]
        return replace(self, pairs=pairs)

    @property
    def can_be_swapped(self) -> bool:
        """Whether a pair has two bodies, and no node would be slave in two pairs."""
        slaves = [slave for slave, _ in self.swapped().pairs]
        return self.swapped().pairs != self.pairs and len(set(slaves)) == len(slaves)


def still(times: int = 2) -> Motion:
    """No motion."""
    return Motion(np.zeros((times, 6)))


def moving(*moves: Any, about: Any = (0.0, 0.0, 0.0)) -> Motion:
    """A motion by its values (6,) or translations (3,) at times 1, 2, and so on."""
    rows = [np.zeros(6), *(np.append(m, np.zeros(6 - len(m))) for m in moves)]
    return Motion(np.array(rows, float), np.asarray(about, float))
