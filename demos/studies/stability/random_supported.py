# SPDX-License-Identifier: MIT
"""Random scenes of bodies supported by contact with friction alone, each from a seed.

First the weight grows, until time 1, then another load: it is drawn as a part of what limit
analysis of the rigid bodies allows, from little to more than that. So each case knows whether, and
until when, there may be an equilibrium.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from demos.studies.stability.limit_analysis import (
    GROUND,
    Point,
    Structure,
    judge,
    least_factor,
    normal_of,
    touching_lines,
    touching_nodes,
    touching_plane,
)
from demos.studies.stability.placement import draw_placement
from demos.studies.stability.random_bodies import Array, Body, draw_cells, split
from demos.studies.stability.random_cases import Case, Prescribed
from demos.studies.stability.user_laws import Rule

# Elastic bodies move by up to this many times the sum of the loads over Young's modulus.
YIELDING = 60.0
# Limit analysis is of rigid bodies; elastic ones may slide or stay that much earlier or later.
MARGIN = 0.05
# The same where the certificate tells of a coarse mesh: forces at edges are right to a facet then.
TOLD_MARGIN = 0.25
# Where friction is not associated bodies may give way before limit analysis says so: a dead end
# below this part of what it allows is taken for a failure.
EARLIEST = 0.9
# Width of upright joints that are no pairs [length]: bodies that bulge do not meet in them.
OPEN = 0.02
# A point with a normal, of a rigid plane.
Plane = tuple[Array, Array]
DOWN = np.array([0.0, -1.0])


@dataclass(frozen=True)
class SupportedCase(Case):
    """A scene of bodies supported by friction.

    Attributes:
        planes: Rigid planes by name, among the masters.
        friction: Coefficient of each pair.
        pulls: Adhesion of each pair; none if empty [stress].
        fade: Gap over which adhesion falls to a third [length].
        loads: Force and moment about its centre of each body at times 0, 1, 2, (3, bodies, 3).
        clamped: Names of the bodies that do not move.
        end: Time at which limit analysis sees bodies give way; infinite if never.
        yielding: Largest displacement that is elastic [length].
    """

    planes: dict[str, Plane] = field(default_factory=dict)
    friction: list[float] = field(default_factory=list)
    pulls: list[float] = field(default_factory=list)
    fade: float = 1.0
    loads: Array = field(default_factory=lambda: np.zeros((3, 0, 3)))
    clamped: tuple[str, ...] = ()
    end: float = np.inf
    yielding: float = np.inf

    @property
    def rules(self) -> list[Rule]:
        """Law of each pair."""
        pulls = self.pulls or [0.0] * len(self.pairs)
        return [
            Rule("sticky" if pull else "Coulomb", mu, length=self.fade, stress=pull)
            for mu, pull in zip(self.friction, pulls, strict=True)
        ]

    @property
    def stop(self) -> float:
        """The weight until 1, then the other load."""
        return 2.0

    @property
    def smallest(self) -> float:
        """Limit analysis is not righter than that."""
        return 0.02

    @property
    def can_be_swapped(self) -> bool:
        """Planes are no slaves."""
        return not self.planes and super().can_be_swapped

    @property
    def areas(self) -> list[tuple[float, Array, float]]:
        """Area, centre and polar moment about it of the bodies."""
        return [measured(body) for body in self.bodies]

    def densities(self, loads: Array) -> Array:
        """Body forces (x, y) and moment density over polar moment, shape (bodies, 3)."""
        areas = self.areas
        rows = [[x / a, y / a, m / p] for (x, y, m), (a, _, p) in zip(loads, areas)]
        return np.array(rows)


def measured(body: Body) -> tuple[float, Array, float]:
    """Area, centre and polar moment about it, of the cells as two triangles each."""
    x = body.x
    a, b, c = x[body.cells[:, :3].T]
    triangles = [(a, b, c)]
    if body.cells.shape[1] == 4:
        triangles.append((x[body.cells[:, 1]], x[body.cells[:, 3]], x[body.cells[:, 2]]))
    area, first, polar = 0.0, np.zeros(2), 0.0
    origin = x.mean(axis=0)
    for p, q, r in triangles:
        p, q, r = p - origin, q - origin, r - origin
        u, v = q - p, r - p
        S = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        area += S.sum()
        first += (S[:, None] * (p + q + r) / 3.0).sum(axis=0)
        polar += sum((S * (m**2).sum(axis=1)).sum() for m in (p + q, q + r, r + p)) / 12.0
    centre = first / area
    return float(area), centre + origin, float(polar - area * centre @ centre)


# Limit analysis of a case


def rigid(case: SupportedCase, *, at_nodes: bool = False) -> Structure:
    """Its rigid bodies and where they touch; dead is the load at time 1, live what is added.

    Args:
        case: The case.
        at_nodes: Whether forces act at nodes of the slaves only, as the mesh lets them, and without
            friction at those that a guide holds along the surface, as those on symmetry planes.
    """
    free = [body.name for body in case.bodies if body.name not in case.clamped]
    number = {name: k for k, name in enumerate(free)}
    of_body = {body.name: k for k, body in enumerate(case.bodies)}
    wrenches, areas = [], case.areas
    for loads in (case.loads[1], case.loads[2] - case.loads[1]):
        rows = []
        for name in free:
            x, y, m = loads[of_body[name]]
            centre = areas[of_body[name]][1]
            rows.append([x, y, m + centre[0] * y - centre[1] * x])
        wrenches.append(np.array(rows))
    guided = np.zeros((len(free), 3), bool)
    for prescribed in case.prescribed:
        name = prescribed.boundary.split("/")[0]
        if prescribed.component is not None and name in number:
            guided[number[name], [prescribed.component, 2]] = True
    points = [
        Point(
            number.get(slave.split("/")[0], GROUND),
            number.get(master.split("/")[0], GROUND),
            x,
            n,
            0.0 if at_nodes and _is_guided(case, slave, x, n) else rule.mu,
            length * rule.stress if rule.kind == "sticky" else 0.0,
        )
        for (slave, master), rule in zip(case.pairs, case.rules)
        for x, n, length in _touching(case, slave, master, at_nodes=at_nodes)
    ]
    return Structure(points, *wrenches, guided)


def _is_guided(case: SupportedCase, slave: str, x: Array, n: Array) -> bool:
    """Whether a node of a slave is prescribed along the surface: such nodes bear no friction."""
    return any(
        given.component is not None
        and abs(n[given.component]) < 0.5
        and given.boundary.split("/")[0] == slave.split("/")[0]
        and bool((case.x[case.nodes_of(given.boundary)] == x).all(axis=1).any())
        for given in case.prescribed
    )


def end_of_mesh(case: SupportedCase) -> float:
    """Time at which bodies give way if forces act at nodes of the slaves only."""
    verdict = judge(rigid(case, at_nodes=True))
    return 1.0 + verdict.factor if verdict.feasible else 0.0


def earliest_end_of_mesh(case: SupportedCase) -> float:
    """The same for friction that is not associated: bodies may give way from this time on."""
    if any(case.pulls):
        return end_of_mesh(case)
    return 1.0 + least_factor(rigid(case, at_nodes=True))


def _touching(
    case: SupportedCase, slave: str, master: str, *, at_nodes: bool
) -> list[tuple[Array, Array, float]]:
    """Places where a pair touches, the normals on the slave there, and the lengths that belong."""
    line = _line(case, slave)
    if master in case.planes:
        point, normal = case.planes[master]
        return [(x, normal, share) for x, share in touching_plane(line, point, normal)]
    other = _line(case, master)
    places = touching_nodes if at_nodes else touching_lines
    return [(x, normal_of(other, x), share) for x, share in places(line, other)]


def _line(case: SupportedCase, boundary: str) -> Array:
    """Nodes of a boundary, the body on the left."""
    x = case.x[case.nodes_of(boundary)]
    return x[::-1] if boundary.split("/")[1] in ("top", "left") else x


# Drawing


def hanging_case(seed: int) -> SupportedCase:
    """Draw a scene of blocks that hang by adhesion."""
    rng = np.random.default_rng([seed, 18])
    draw = _hanging if rng.random() < 0.7 else _glued
    return _placed(rng, _loaded(rng, draw(rng, seed)))


def supported_case(seed: int) -> SupportedCase:
    """Draw a scene; its seeds have nothing to do with those of ``random_case``."""
    rng = np.random.default_rng([seed, 17])
    draw = rng.choice([_block, _wall, _tower, _junction, _groove, _row, _arch])
    return _placed(rng, _loaded(rng, draw(rng, seed)))


def quadrilateral(
    rng: np.random.Generator, name: str, corners: Array, counts: tuple[int, int], cells: str
) -> Body:
    """A body between four corners, counter-clockwise from the lower left; its E is one."""
    s, t = np.meshgrid(np.linspace(0, 1, counts[0] + 1), np.linspace(0, 1, counts[1] + 1))
    a, b, c, d = np.asarray(corners, float)
    s, t = s[..., None], t[..., None]
    x = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
    nodes = np.arange(s.size).reshape(s.shape[:2])
    sides = {"bottom": nodes[0], "right": nodes[:, -1], "top": nodes[-1], "left": nodes[:, 0]}
    sides = {side: along.copy() for side, along in sides.items()}
    thickness = float(np.linalg.norm(d - a))
    nu = float(rng.uniform(0.0, 0.4))
    return Body(name, x.reshape(-1, 2), split(rng, nodes, cells), sides, 1.0, nu, thickness)


def _box(rng, name, x, y, width, height, counts, cells) -> Body:
    """A rectangle with its lower left corner at (x, y)."""
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)]) + np.array([x, y])
    return quadrilateral(rng, name, corners, counts, cells)


def _counts(rng: np.random.Generator, width: float = 1.0) -> tuple[int, int]:
    """Cells along and across a block."""
    return max(round(width * rng.integers(2, 6)), 1), int(rng.integers(1, 4))


def _scene(seed: int, about: dict[str, Any], bodies, pairs, **options: Any) -> SupportedCase:
    """Put a scene together; loads are still missing."""
    still = np.zeros((3, 2))
    clamped = options.get("clamped", ())
    prescribed = [Prescribed(f"{name}/{side}", still) for name, side in options.pop("supports", [])]
    prescribed += [
        Prescribed(f"{name}/{side}", still, c) for name, side, c in options.pop("guides", [])
    ]
    about = {"supported": True, **about, "clamped": list(clamped)}
    return SupportedCase(seed, about, bodies, pairs, prescribed, "", still, 1.0, **options)


def _on(rng, x: float, width: float, cells: str) -> dict[str, Any]:
    """What stands below y = 0: a rigid plane, or a clamped block."""
    if rng.random() < 0.5:
        return {"bodies": [], "top": "floor", "planes": {"floor": (np.zeros(2), -DOWN)}}
    counts = (int(rng.integers(3, 9)), 2)
    ground = _box(rng, "ground", x - 0.4, -0.6, width + 0.8, 0.6, counts, cells)
    return {
        "bodies": [ground], "top": "ground/top", "planes": {},
        "clamped": ("ground",), "supports": [("ground", "bottom")],
    }  # fmt: skip


def _with_roles(rng: np.random.Generator, pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Exchange the roles of some pairs of two bodies."""
    return [pair[::-1] if "/" in pair[1] and rng.random() < 0.5 else pair for pair in pairs]


def _block(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A block on the ground."""
    cells = draw_cells(rng)
    width, height = rng.uniform(0.5, 1.5), rng.uniform(0.3, 1.2)
    on = _on(rng, 0.0, width, cells)
    block = _box(rng, "block", 0.0, 0.0, width, height, _counts(rng, width), cells)
    pairs = _with_roles(rng, [("block/bottom", on.pop("top"))])
    bodies = [*on.pop("bodies"), block]
    return _scene(seed, {"scene": "block"}, bodies, pairs, friction=[rng.uniform(0.1, 1.0)], **on)


def _courses(
    rng: np.random.Generator, seed: int, rows: list[list[float]], name: str
) -> SupportedCase:
    """Rows of blocks upon each other; ``rows``: places of the joints of each."""
    cells, upright = draw_cells(rng), rng.random() < 0.8
    alike = int(rng.integers(2, 5)) if rng.random() < 0.4 else 0
    on = _on(rng, rows[0][0], rows[0][-1] - rows[0][0], cells)
    bodies, pairs, below, y = on.pop("bodies"), [], [], 0.0
    for r, joints in enumerate(rows):
        height, row = rng.uniform(0.3, 0.7), []
        for c, (a, b) in enumerate(itertools.pairwise(joints)):
            b -= OPEN * (not upright and c < len(joints) - 2)
            counts = (max(round((b - a) * alike), 1), 2) if alike else _counts(rng, b - a)
            bodies.append(_box(rng, f"b{r}_{c}", a, y, b - a, height, counts, cells))
            row.append((f"b{r}_{c}", a, b))
        if not below:
            pairs += [(f"{one}/bottom", on["top"]) for one, *_ in row]
        pairs += [
            (f"{one}/bottom", f"{other}/top")
            for one, a, b in row
            for other, c, d in below
            if min(b, d) - max(a, c) > 1e-6
        ]
        if upright:
            pairs += [(f"{p[0]}/right", f"{q[0]}/left") for p, q in itertools.pairwise(row)]
        below, y = row, y + height
    on.pop("top")
    mu = rng.uniform(0.1, 1.0)
    friction = [float(mu * rng.uniform(0.7, 1.0)) for _ in pairs]
    about = {"scene": name, "upright": upright, "conforming": bool(alike)}
    return _scene(seed, about, bodies, _with_roles(rng, pairs), friction=friction, **on)


def _wall(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A wall whose joints are anywhere, or in running bond."""
    rows, length = int(rng.integers(2, 5)), float(rng.integers(1, 4))
    courses = []
    for r in range(rows):
        joints = np.arange(1.0, length) if r % 2 == 0 else np.arange(0.5, length)
        if rng.random() < 0.5:
            joints = joints + rng.uniform(-0.2, 0.2, joints.size)
        courses.append([0.0, *joints.tolist(), length])
    return _courses(rng, seed, courses, "wall")


def _tower(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Blocks upon each other with offsets."""
    x, courses = 0.0, []
    for _ in range(rng.integers(2, 9)):
        width = rng.uniform(0.8, 1.3)
        courses.append([x - 0.5 * width, x + 0.5 * width])
        x += rng.uniform(-0.2, 0.2)
    return _courses(rng, seed, courses, "tower")


def _junction(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A block upon two others that touch."""
    left, right = rng.uniform(0.6, 1.2, 2)
    ends = [rng.uniform(-0.9, -0.3) * left, rng.uniform(0.3, 0.9) * right]
    if rng.random() < 0.3:
        ends = [-left, right]
    return _courses(rng, seed, [[-left, 0.0, right], ends], "T-junction")


def _groove(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A block on its corner in a groove that fits."""
    cells, half = draw_cells(rng), rng.uniform(0.3, 1.2)
    e = np.array([np.cos(half), np.sin(half)])  # along the right flank
    f = np.array([-e[1], e[0]]) if rng.random() < 0.5 else np.array([-e[0], e[1]])
    length, width = rng.uniform(0.6, 1.2, 2)
    corners = np.array([0.0 * e, length * e, length * e + width * f, width * f])
    counts = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    block = quadrilateral(rng, "block", corners, counts, cells)
    normal_e, normal_f = np.array([-e[1], e[0]]), np.array([f[1], -f[0]])
    mu = rng.uniform(0.1, 0.9)
    options: dict[str, Any] = {}
    if rng.random() < 0.5:
        zero = np.zeros(2)
        options["planes"] = {"right": (zero, normal_e), "left": (zero, normal_f)}
        bodies, pairs = [block], [("block/bottom", "right"), ("block/left", "left")]
    else:
        flanks = []
        for name, along, normal, reach in (
            ("right", e, normal_e, length), ("left", f, normal_f, width),
        ):  # fmt: skip
            a, b = 0.0 * along, 1.3 * reach * along
            low, high = a - 0.5 * normal + 0.2 * along, b - 0.5 * normal
            body = [low, high, b, a] if name == "right" else [high, low, a, b]
            counts = (int(rng.integers(2, 6)), 2)
            flanks.append(quadrilateral(rng, name, np.array(body), counts, cells))
        bodies = [block, *flanks]
        pairs = _with_roles(rng, [("block/bottom", "right/top"), ("block/left", "left/top")])
        options["clamped"] = ("right", "left")
        options["supports"] = [("right", "bottom"), ("left", "bottom")]
    about = {"scene": "groove"}
    return _scene(seed, about, bodies, pairs, friction=[mu, mu], **options)


def _row(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Blocks in a row between a clamped and a guided jaw, which is pressed."""
    cells, x, mu = draw_cells(rng), 0.0, rng.uniform(0.3, 1.0)
    height = rng.uniform(0.5, 1.0)
    bodies = [_box(rng, "left", -0.6, -0.2, 0.6, height + 0.4, _counts(rng), cells)]
    names = ["left"]
    for k in range(rng.integers(1, 5)):
        width = rng.uniform(0.4, 1.0)
        bodies.append(_box(rng, f"b{k}", x, 0.0, width, height, _counts(rng, 2 * width), cells))
        names.append(f"b{k}")
        x += width
    bodies.append(_box(rng, "right", x, -0.2, 0.6, height + 0.4, _counts(rng), cells))
    names.append("right")
    pairs = [(f"{p}/right", f"{q}/left") for p, q in itertools.pairwise(names)]
    return _scene(
        seed,
        {"scene": "row", "pressed": "right"},
        bodies,
        _with_roles(rng, pairs),
        friction=[mu] * len(pairs),
        clamped=("left",),
        supports=[("left", "left")],
        guides=[("right", "top", 1)],
    )


def _arch(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Voussoirs between rigid springings."""
    cells, number = draw_cells(rng), int(rng.integers(3, 9))
    thickness, mu = rng.uniform(0.08, 0.3), rng.uniform(0.4, 1.0)
    angles = np.linspace(0.0, np.pi, number + 1)
    bodies = []
    for k, (a, b) in enumerate(itertools.pairwise(angles)):
        corners = [
            r * np.array([np.cos(t), np.sin(t)])
            for r, t in ((1 + thickness / 2, a), (1 + thickness / 2, b),
                         (1 - thickness / 2, b), (1 - thickness / 2, a))
        ]  # fmt: skip
        counts = (int(rng.integers(1, 3)), int(rng.integers(1, 4)))
        bodies.append(quadrilateral(rng, f"v{k}", np.array(corners), counts, cells))
    pairs = [(f"v{k}/right", f"v{k + 1}/left") for k in range(number - 1)]
    pairs = _with_roles(rng, pairs)
    pairs += [("v0/left", "springing"), (f"v{number - 1}/right", "springing")]
    return _scene(
        seed,
        {"scene": "arch", "t/R": thickness},
        bodies,
        pairs,
        friction=[mu] * len(pairs),
        planes={"springing": (np.zeros(2), -DOWN)},
    )


def _hanging(rng: np.random.Generator, seed: int) -> SupportedCase:
    """Blocks that hang below each other, the first from a rigid or a clamped ceiling.

    Friction is of pressures alone, so that only a guide fixes them sideways; loads pull
    straight down.
    """
    cells, y = draw_cells(rng), 0.0
    widths = rng.uniform(0.5, 1.3, rng.integers(1, 4))
    options: dict[str, Any] = {}
    if rng.random() < 0.5:
        above, bodies, options["planes"] = "ceiling", [], {"ceiling": (np.zeros(2), DOWN)}
    else:
        counts = (int(rng.integers(3, 9)), 2)
        above, bodies = "base/bottom", [_box(rng, "base", -1.0, 0.0, 2.0, 0.5, counts, cells)]
        options |= {"clamped": ("base",), "supports": [("base", "top")]}
    pairs, heights, x = [], [], 0.0
    for k, width in enumerate(widths):
        height = rng.uniform(0.2, 0.8)
        y -= height
        counts = _counts(rng, width)
        bodies.append(_box(rng, f"b{k}", x - width / 2, y, width, height, counts, cells))
        pairs.append((f"b{k}/top", above))
        above = f"b{k}/bottom"
        heights.append(height)
        x += rng.uniform(-0.1, 0.1)
    if guided := rng.random() < 0.7:
        options["guides"] = [(f"b{k}", "left", 0) for k in range(len(widths))]
    hung = np.cumsum((widths * heights)[::-1])[::-1]
    narrow = np.minimum(widths, np.r_[2.0, widths[:-1]])
    pulls = hung / narrow * rng.uniform(1.5, 5.0, len(widths))
    friction = rng.uniform(0.1, 0.8) * rng.uniform(0.7, 1.0, len(pairs))
    about = {"scene": f"{len(pairs)} hanging", "guided": guided, "straight": True}
    return _scene(
        seed, about, bodies, _with_roles(rng, pairs), friction=friction.tolist(),
        pulls=pulls.tolist(), fade=float(rng.uniform(0.03, 0.1)), **options,
    )  # fmt: skip


def _glued(rng: np.random.Generator, seed: int) -> SupportedCase:
    """A tall block that stands, and sticks too much to slide: adhesion keeps it from tipping."""
    cells = draw_cells(rng)
    width, height = rng.uniform(0.3, 0.6), rng.uniform(0.8, 1.5)
    on = _on(rng, 0.0, width, cells)
    block = _box(rng, "block", 0.0, 0.0, width, height, _counts(rng, 2 * width), cells)
    pairs = _with_roles(rng, [("block/bottom", on.pop("top"))])
    bodies = [*on.pop("bodies"), block]
    return _scene(
        seed, {"scene": "glued"}, bodies, pairs, friction=[rng.uniform(2.0, 4.0)],
        pulls=[height * rng.uniform(0.2, 3.0)], fade=float(rng.uniform(0.03, 0.1)), **on,
    )  # fmt: skip


def _loaded(rng: np.random.Generator, case: SupportedCase) -> SupportedCase:
    """Draw weight, another load as a part of what limit analysis allows, and stiffness."""
    areas = np.array([area for area, *_ in case.areas])
    free = np.array([body.name not in case.clamped for body in case.bodies])
    pressed = np.array([body.name == case.about.get("pressed") for body in case.bodies])
    total = areas[free].sum()
    dead, live = np.zeros((2, len(areas), 3))
    if pressed.any():
        dead[pressed, 0] = -total
        live[free & ~pressed, 1] = -areas[free & ~pressed]
    else:
        dead[free, 1] = -areas[free]
        where = free
        if rng.random() < 0.3:
            where = free & (np.arange(len(areas)) == rng.choice(np.flatnonzero(free)))
        angle = rng.choice([0.0, np.pi]) + rng.uniform(-0.4, 0.4)
        if "straight" in case.about:
            angle = -0.5 * np.pi
        live[where, :2] = areas[where, None] * np.array([np.cos(angle), np.sin(angle)])
    case = replace(case, loads=np.array([0.0 * dead, dead, dead + live]))
    verdict = judge(rigid(case))
    part = rng.uniform(0.05, 0.85) if rng.random() < 0.7 else rng.uniform(1.15, 1.6)
    most = verdict.factor if np.isfinite(verdict.factor) else 3.0
    size = part * max(most, 0.02)
    loads = np.array([0.0 * dead, dead, dead + size * live])
    end = 1.0 + verdict.factor / size if verdict.feasible else 0.0
    stiffness = total * 10.0 ** rng.uniform(3.5, 5.0)
    bodies = [replace(body, E=stiffness * 10.0 ** rng.uniform(0.0, 0.5)) for body in case.bodies]
    sizes = np.abs(loads[1]).sum() + np.abs(loads[2] - loads[1]).sum()
    step = float(rng.choice([0.25, 0.5, 1.0]))
    about = {
        "friction": [float(min(case.friction)), float(max(case.friction))],
        "stiffness": float(stiffness / total),
        "factor": float(verdict.factor),
        "part": float(part),
        "end": float(end),
        "step": step,
    }
    return replace(
        case, bodies=bodies, loads=loads, end=end, step=step,
        yielding=float(YIELDING * sizes / stiffness), about=case.about | about,
    )  # fmt: skip


def _placed(rng: np.random.Generator, case: SupportedCase) -> SupportedCase:
    """Turn, move and scale a scene; guides need directions along the axes."""
    placement = draw_placement(
        rng, guided=any(prescribed.component is not None for prescribed in case.prescribed)
    )
    turn, length, stress = placement.turn, placement.length, placement.stress
    bodies = list(map(placement.body, case.bodies))
    prescribed = [
        h
        if h.component is None
        else replace(h, component=int(np.abs(turn[:, h.component]).argmax()))
        for h in case.prescribed
    ]
    planes = {name: (placement.points(x), n @ turn.T) for name, (x, n) in case.planes.items()}
    loads = stress * length * case.loads
    loads[..., :2] = loads[..., :2] @ turn.T
    loads[..., 2] *= length
    about = (
        case.about
        | placement.about(bodies)
        | {
            "bodies": len(bodies),
            "dofs": 2 * len(case.x),
        }
    )
    return replace(
        case, bodies=bodies, prescribed=prescribed, planes=planes, loads=loads,
        pulls=[stress * pull for pull in case.pulls], fade=length * case.fade,
        yielding=length * case.yielding, about=about,
    )  # fmt: skip
