# SPDX-License-Identifier: MIT
"""Pictures of solids: their outer facets, shaded, and coloured by a field."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fenics_mortar.contact.tied import Tie
from fenics_mortar.io.fields import evaluated_contacts
from fenics_mortar.io.skin import skin_of
from fenics_mortar.io.style import BODIES, INK, PRESSURE, Style, colours, pressure_label
from fenics_mortar.problem import ContactProblem
from fenics_mortar.utils.arrays import Array

# Angles of the camera above the x-y plane and about z [degrees].
CAMERA = (22.0, -60.0)
# Angles from the camera to the light, upwards and to the right [degrees].
LIGHT = (25.0, 20.0)
# Brightness of facets that face away from the light, those that face it have 1 [1].
DARKEST = 0.55


class Facets(NamedTuple):
    """Outer facets of solids.

    Attributes:
        polygons: Their outlines in the deformed state, shape (f, k, 3) [length].
        inner: Midpoints of their cells, shape (f, 3) [length].
        values: Values of a field in their cells, shape (f,).
    """

    polygons: Array
    inner: Array
    values: Array


def drawing_of_solids(
    problem: ContactProblem, values: Array | None, style: Style
) -> Callable[[Any], Any]:
    """Function that draws solids into axes, or into new ones, on the first rank (collective).

    Args:
        problem: The problem.
        values: Values of a field in the owned cells, shape (cells,), or ``None``.
        style: Style of the picture.
    """
    bulk = problem.equations.bulk
    skin, x = skin_of(bulk.V), bulk.cells.X + style.scale * bulk.u.x.array[bulk.space.dofs]
    given = np.zeros(len(skin.cells)) if values is None else values[skin.cells]
    branches: Any = bulk.comm.gather((x[skin.rings], bulk.cells.middles(x)[skin.cells], given))
    contacts = [c for c in evaluated_contacts(problem) if not isinstance(c, Tie)]

    def draw(ax: Any) -> Any:
        facets = Facets(*(np.concatenate(parts) for parts in zip(*branches, strict=True)))
        axes = _new_axes() if ax is None else ax
        axes.set_title(style.title or "", y=1.0)
        _draw_facets(axes, facets, None if values is None else style)
        _draw_largest_pressures(axes, contacts, style)
        if style.scale != 1.0:
            axes.plot([], [], [], " ", color=INK, label=f"displacement x {style.scale:g}")
        _finish_axes(axes, style.units)
        return axes

    return draw


def _new_axes() -> Any:
    """Axes of a new figure."""
    from matplotlib.figure import Figure

    axes = Figure((7.0, 5.5), layout="constrained").add_subplot(projection="3d")
    axes.view_init(*CAMERA)
    axes.set_proj_type("ortho")
    return axes


def _draw_facets(axes: Any, facets: Facets, style: Style | None) -> None:
    """Draw the facets that the camera sees, coloured if there is a style, and set the limits."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    faces = np.tile(to_rgb(BODIES), (len(facets.values), 1))
    if style is not None:
        mapping = ScalarMappable(**colours(facets.values, style))
        faces = mapping.to_rgba(facets.values)[:, :3]
        bar = axes.figure.colorbar(
            mapping, ax=axes, label=style.label, location="left", shrink=0.6, pad=0.02
        )
        bar.outline.set_visible(False)
    normals = _normals(facets)
    seen = normals @ _direction(axes.elev, axes.azim) > 0.0  # their order in depth is not exact
    light = _direction(axes.elev + LIGHT[0], axes.azim + LIGHT[1])
    brightness = DARKEST + (1.0 - DARKEST) * np.clip(normals @ light, 0.0, 1.0)
    shaded = (faces * brightness[:, None])[seen]
    edges = {"edgecolors": (0.1, 0.1, 0.1, 0.5), "linewidths": min(0.35, 12 / len(shaded) ** 0.5)}
    drawn = Poly3DCollection(facets.polygons[seen], facecolors=shaded, clip_on=False, **edges)
    axes.add_collection3d(drawn)
    points = facets.polygons.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    for name, *limits in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(*limits)
    axes.set_box_aspect(high - low)


def _draw_largest_pressures(axes: Any, contacts: list[Any], style: Style) -> None:
    """Mark the node of the largest pressure of each contact."""
    for contact in contacts:
        if contact.pressure.max() > 0.0:
            X, x = (
                places[contact.pressure.argmax()]
                for places in (contact.slave.X, contact.operators.x)
            )
            label = pressure_label(contacts, contact, style)
            place = X + style.scale * (x - X)
            axes.plot(*place[:, None], "o", markersize=4, color=PRESSURE, label=label, zorder=10)


def _finish_axes(axes: Any, units: tuple[str, str] | None) -> None:
    """Labels with units, few numbers, panes without colour, and the legend."""
    for name in "xyz":
        label = name if units is None else f"{name} [{units[0]}]"
        getattr(axes, f"set_{name}label")(label, fontsize=9)
        axis = getattr(axes, f"{name}axis")
        axis.pane.set_visible(False)
        axis.set_tick_params(labelsize=8)
    axes.grid(visible=False)
    axes.locator_params(nbins=4)
    if axes.get_legend_handles_labels()[1]:
        style = {"labelcolor": "linecolor", "frameon": False, "handletextpad": 0.0}
        # below the labels of the axes, which reach lowest for tall bodies
        axes.legend(**style, loc="upper left", bbox_to_anchor=(0.0, -0.11), fontsize=9)


def _normals(facets: Facets) -> Array:
    """Outer unit normals of the facets, zero without area, shape (f, 3) [1]."""
    polygons = facets.polygons
    first, second = (polygons[:, len(polygons[0]) * k // 3] for k in (1, 2))
    normals = np.cross(first - polygons[:, 0], second - polygons[:, 0])
    outward = polygons.mean(axis=1) - facets.inner
    normals *= np.sign((normals * outward).sum(axis=1))[:, None]
    size = np.linalg.norm(normals, axis=1)
    return np.asarray(normals / np.where(size > 0.0, size, 1.0)[:, None])


def _direction(elevation: float, azimuth: float) -> Array:
    """Unit vector to a place at two angles [degrees], shape (3,) [1]."""
    up, about = np.radians([elevation, azimuth])
    return np.array([np.cos(up) * np.cos(about), np.cos(up) * np.sin(about), np.sin(up)])
