# SPDX-License-Identifier: MIT
"""A quarter of a round inclusion in a plate, with meshes that do not match.

Lengths are in any one unit; the centre is the origin, x = 0 and y = 0 are the planes of symmetry.
The facets of the plate's straight sides grow away from the inclusion.
"""

from __future__ import annotations

from typing import Any

from meshes._shared import add_lines, add_points, add_surface, divide, generate, write
from meshes.with_gmsh import gmsh


def build(
    *,
    radius: float = 1.0,
    width: float = 10.0,
    n_inclusion: int = 24,
    n_plate: int = 8,
    layers_plate: int = 10,
    growth: float = 8.0,
    order: int = 1,
) -> Any:
    """Build both as a new model of the running gmsh session; return ``gmsh.model``.

    Names: bodies ``inclusion`` and ``plate``; boundaries ``inclusion/arc``, ``inclusion/left``,
    ``inclusion/bottom``, ``plate/arc``, ``plate/left``, ``plate/bottom``, ``plate/right`` and
    ``plate/top``.

    Args:
        radius: Radius of the inclusion [length].
        width: Half width and height of the plate [length].
        n_inclusion: Number of facets of the inclusion's arc.
        n_plate: Number of facets of the plate's arc.
        layers_plate: Number of facets of the plate's left and bottom side.
        growth: Length of the outermost of these by that of the innermost.
        order: Order of the cells; those of order 2 have curved sides on the arcs.
    """
    if not 0.0 < radius < width:
        raise ValueError("right is 0 < radius < width")
    gmsh.model.add("inclusion")
    centre, *corners = add_points([(0, 0), (width, 0), (width, width), (0, width)])
    bodies: dict[str, list[int]] = {}
    boundaries: dict[str, list[int]] = {}
    for name, facets in (("inclusion", n_inclusion), ("plate", n_plate)):
        low, high = add_points([(radius, 0), (0, radius)])
        arc = gmsh.model.geo.addCircleArc(low, centre, high)
        if name == "inclusion":
            sides = {"bottom": add_lines([centre, low])[0], "left": add_lines([high, centre])[0]}
            loop, straight = [sides["bottom"], arc, sides["left"]], (round(facets / 1.5), 1.0)
        else:
            chain = add_lines([low, *corners])
            sides = dict(zip(("bottom", "right", "top"), chain))
            sides["left"] = add_lines([high, corners[-1]])[0]
            loop, straight = [*chain, -sides["left"], -arc], (layers_plate, growth)
        divide(arc, facets)
        for side, curve in sides.items():
            outside = side in ("right", "top")
            divide(curve, *((max(facets // 2, 1), 1.0) if outside else straight))
        bodies[name] = [add_surface(loop, "triangle")]
        boundaries |= {f"{name}/{side}": [curve] for side, curve in {**sides, "arc": arc}.items()}
    model = generate(bodies, boundaries)
    model.mesh.setOrder(order)
    return model


if __name__ == "__main__":
    write(build, "inclusion.msh")
