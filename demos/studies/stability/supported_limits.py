# SPDX-License-Identifier: MIT
"""Limit analysis of a problem of bodies supported by friction: time at which they move.

Forces act anywhere on the sides in contact, or only at the nodes of the slaves, as in the mesh.
"""

from __future__ import annotations

import numpy as np

from demos.studies.stability.limit_analysis import GROUND, Point, Structure, judge, least_factor
from demos.studies.stability.random_bodies import Array
from demos.studies.stability.supported_case import SupportedCase
from demos.studies.stability.touching import (
    normal_of,
    touching_lines,
    touching_nodes,
    touching_plane,
)


def rigid(case: SupportedCase, *, at_nodes: bool = False) -> Structure:
    """The rigid bodies and their contact points; dead load at time 1, live load added later.

    Args:
        case: The case.
        at_nodes: Whether forces act at nodes of the slaves only, as in the mesh, and without
            friction at nodes that a guide fixes along the surface, as on symmetry planes.
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
    """Whether a node of a slave is prescribed along the surface: such nodes have no friction."""
    return any(
        given.component is not None
        and abs(n[given.component]) < 0.5
        and given.boundary.split("/")[0] == slave.split("/")[0]
        and bool((case.x[case.nodes_of(given.boundary)] == x).all(axis=1).any())
        for given in case.prescribed
    )


def end_of_mesh(case: SupportedCase) -> float:
    """Time at which bodies move if forces act at nodes of the slaves only."""
    verdict = judge(rigid(case, at_nodes=True))
    return 1.0 + verdict.factor if verdict.feasible else 0.0


def earliest_end_of_mesh(case: SupportedCase) -> float:
    """Earliest time at which bodies may move, for non-associated friction."""
    if any(case.pulls):
        return end_of_mesh(case)
    return 1.0 + least_factor(rigid(case, at_nodes=True))


def _touching(
    case: SupportedCase, slave: str, master: str, *, at_nodes: bool
) -> list[tuple[Array, Array, float]]:
    """Contact points of a pair, normals of the slave, and tributary lengths."""
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
