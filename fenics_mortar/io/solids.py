# SPDX-License-Identifier: MIT
"""Pictures of solids: their outer facets, shaded, and coloured by a field.

Axes, numbers, colours and legend are those of matplotlib. Facets are drawn by pyvista, with the
camera of the axes, where it is installed and can draw without a screen. Elsewhere matplotlib draws
those that face the camera, from the back to the front. No order is right for facets that cover each
other in turn, as the sides of two bodies in contact may do.

``colours``, ``pressure_label`` and ``label_axes`` are those of pictures in the plane, too.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from ctypes import CDLL, CFUNCTYPE, addressof, c_int, c_uint, c_void_p
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from dolfinx import mesh as dmesh

from fenics_mortar.interface.reference import CORNERS
from fenics_mortar.interface.surfaces import outward_nodes
from fenics_mortar.mesh.space import cells_of_facets
from fenics_mortar.utils.arrays import Array, Indices, at_rows

if TYPE_CHECKING:
    from fenics_mortar.problem import ContactProblem

INK, GREY, PRESSURE = "#222222", "#999999", "#c8102e"
# Bodies without a field, in space by turns.
BODIES = ("#dfe6ea", "#e8dcc4", "#d5e3cf", "#e6d3da")
SEQUENTIAL, DIVERGING = "YlGnBu", "RdBu_r"
# A field has both signs if the largest value of one sign is at least this fraction of the largest
# of the other sign [1]: smaller values may be discretization errors, and half of the colours would
# not be used.
SIGNED = 0.2


class Style(NamedTuple):
    """Arguments of ``plot``; without a field ``label`` is ``None``."""

    label: str | None
    title: str | None
    scale: float
    units: tuple[str, str] | None
    limits: tuple[float, float] | None
    cmap: Any


def colours(values: Array, style: Style) -> dict[str, Any]:
    """Colour map and norm of a field, diverging about zero if it has both signs (local)."""
    from matplotlib.colors import Normalize, TwoSlopeNorm

    low, high = (values.min(), values.max()) if style.limits is None else style.limits
    smaller, larger = sorted((abs(low), abs(high)))
    if not (low < 0.0 < high and smaller > SIGNED * larger):
        return {"norm": Normalize(low, high), "cmap": style.cmap or SEQUENTIAL}
    if style.limits is None:
        low, high = -larger, larger
    return {"norm": TwoSlopeNorm(0.0, low, high), "cmap": style.cmap or DIVERGING}


def pressure_label(contacts: list[Any], contact: Any, style: Style) -> str:
    """Entry of the legend on the largest pressure of a contact (local)."""
    slaves = [other.slave.name for other in contacts]
    name = contact.slave.name
    if slaves.count(name) > 1:
        name += f" by {contact.pair.master_name}"
    unit = "" if style.units is None else f" {style.units[1]}"
    return f"pressure on {name}, maximum {contact.pressure.max():.4g}{unit}"


# Legend of a picture, whose entries have the colours of what they describe.
LEGEND = {
    "loc": "upper left", "labelcolor": "linecolor", "frameon": False, "handletextpad": 0.0,
    "fontsize": 9,
}  # fmt: skip


def label_axes(axes: Any, names: Sequence[str], style: Style, numbers: int) -> None:
    """Label axes with units, about ``numbers`` ticks, and the scale of displacements (local)."""
    for direction, name in zip("xyz", names, strict=False):
        label = name if style.units is None else f"{name} [{style.units[0]}]"
        getattr(axes, f"set_{direction}label")(label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=numbers)
    if style.scale != 1.0:
        nowhere = np.empty((len(names), 0))
        axes.plot(*nowhere, " ", color=INK, label=f"displacement x {style.scale:g}")


# Angles of the camera above the x-y plane and about z [degrees].
CAMERA = (22.0, -60.0)
# Angles from the camera to the light, upwards and to the right [degrees].
LIGHT = (25.0, 20.0)
# Brightness of facets that face away from the light, those that face it have 1 [1].
DARKEST = 0.55
# Opacity of the edges of cells [1].
EDGES = 0.6
# Width of the edges of bodies, and largest one of those of cells, which are finer the more facets
# there are [points, of which an inch has 72].
BODY_EDGES, CELL_EDGES = 1.2, 0.4
# First release of VTK that looks for EGL if there is no screen.
VTK = 9, 4
# Edges of bodies are those whose facets turn by more than this angle [degrees].
DRAWN_ANGLE = 30.0
# Part of the width or height of the axes that bodies fill, beside which are numbers [1].
FILLED = 0.8
# Height of numbers and labels below the axes, as a part of their height [1].
LABELS = 0.14
# Edges of bodies are drawn before the facets by this part of the bodies' size, and facets hide a
# place if they are before it by more [1]: rounding and curved facets do not.
BEFORE = 2e-3


class Facets(NamedTuple):
    """Outer facets of solids; in the plane the cells.

    Attributes:
        rings: Their outlines in the deformed state, shape (f, k, dim) [length].
        nodes: Numbers of the nodes of the outlines, shape (f, k).
        values: Values of a field in their cells, shape (f,).
    """

    rings: Array
    nodes: Indices
    values: Array

    def normals(self) -> Array:
        """Outer unit normals, zero without area, shape (f, 3) [1]."""
        areas = np.cross(self.rings, np.roll(self.rings, -1, axis=1)).sum(axis=1)
        size = np.linalg.norm(areas, axis=1)
        return np.asarray(areas / np.where(size > 0.0, size, 1.0)[:, None])

    def bodies(self) -> Indices:
        """Number of the connected surface of each facet, from below, shape (f,)."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        used, nodes = np.unique(self.nodes, return_inverse=True)
        nodes = nodes.reshape(self.nodes.shape)
        others = np.roll(nodes, 1, axis=1)
        size = (len(used), len(used))
        graph = coo_matrix((np.ones(nodes.size), (nodes.ravel(), others.ravel())), size)
        count, labels = connected_components(graph, directed=False)
        of_facet, height = labels[nodes[:, 0]], self.rings[..., 2].mean(axis=1)
        mean = np.bincount(of_facet, height, count) / np.bincount(of_facet, minlength=count)
        return np.asarray(mean.argsort().argsort()[of_facet])


def draw_solids(
    problem: ContactProblem, ax: Any, facets: Facets, contacts: list[Any], style: Style
) -> Any:
    """Draw solids into axes, or into new ones; returns the axes (local).

    Args:
        problem: The problem.
        ax: Axes in space, or ``None``.
        facets: The outer facets.
        contacts: Evaluated contacts.
        style: Style of the picture.
    """
    axes = _axes_in_space() if ax is None else ax
    if axes.name != "3d":
        raise ValueError("ax is in the plane; expected add_subplot(projection='3d') for solids")
    facets = _set_limits(axes, facets)
    axes.set_title(style.title or "", y=_corners_of_box(axes)[:, 1].max())
    markers = _draw_largest_pressures(axes, contacts, style)
    _draw_facets(axes, facets, style, markers)
    label_axes(axes, "xyz", style, 4)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_visible(False)
    axes.grid(visible=False)
    if axes.get_legend_handles_labels()[1]:
        below = _corners_of_box(axes)[:, 1].min() - LABELS
        axes.legend(**LEGEND, bbox_to_anchor=(0.0, below))
    return axes


def _axes_in_space() -> Any:
    """Axes of a new figure."""
    from matplotlib.figure import Figure

    axes = Figure((7.0, 5.5), layout="constrained").add_subplot(projection="3d")
    axes.view_init(*CAMERA)
    axes.set_proj_type("ortho")
    return axes


# Limits of axes by their names that are those of facets, not of the user.
_limits: WeakKeyDictionary[Any, dict[str, Any]] = WeakKeyDictionary()


def _set_limits(axes: Any, facets: Facets) -> Facets:
    """Set the limits that the user has not set, and return the facets within all limits."""
    ours = _limits.get(axes, {})
    free = [
        name
        for name in "xyz"
        if getattr(axes, f"get_autoscale{name}_on")()
        or getattr(axes, f"get_{name}lim")() == ours.get(name)
    ]
    for k, name in enumerate("xyz"):
        if name not in free:
            low, high = getattr(axes, f"get_{name}lim")()
            if low >= high:
                raise ValueError(
                    f"{name}lim={(low, high)} is inverted; expected the lower one first"
                )
            places, little = facets.rings[..., k], BEFORE * (high - low)
            inside = ((places >= low - little) & (places <= high + little)).all(axis=1)
            if not inside.any():
                raise ValueError(f"{name}lim={(low, high)}: no facet lies within these limits")
            facets = at_rows(facets, inside)
    for k, name in enumerate("xyz"):
        if name in free:
            places = facets.rings[..., k]
            getattr(axes, f"set_{name}lim")(places.min(), places.max())
    _limits[axes] = {name: getattr(axes, f"get_{name}lim")() for name in free}
    size = np.abs([np.diff(getattr(axes, f"get_{name}lim")())[0] for name in "xyz"])
    axes.set_box_aspect(size)
    axes.set_box_aspect(size, zoom=FILLED / np.ptp(_corners_of_box(axes), axis=0).max())
    return facets


def _corners_of_box(axes: Any) -> Array:
    """Places of the corners of the limits, shape (8, 2) [1]: (0, 0) and (1, 1) are the axes'."""
    limits = [getattr(axes, f"get_{name}lim")() for name in "xyz"]
    corners = np.stack(np.meshgrid(*limits), axis=-1).reshape(-1, 3)
    return np.asarray(axes.transAxes.inverted().transform(_pixels(axes, corners)))


def _pixels(axes: Any, points: Array) -> Array:
    """Places of points (n, 3) in a picture, shape (n, 2) [pixel]."""
    seen = np.c_[points, np.ones(len(points))] @ axes.get_proj().T
    return np.asarray(axes.transData.transform(seen[:, :2] / seen[:, 3:]))


def _draw_facets(axes: Any, facets: Facets, style: Style, markers: list[Any]) -> None:
    """Draw the facets, coloured by the field if there is one."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import to_rgb

    faces = np.array([to_rgb(tint) for tint in BODIES])[facets.bodies() % len(BODIES)]
    if style.label is not None:
        mapping = ScalarMappable(**colours(facets.values, style))
        faces = mapping.to_rgba(facets.values)[:, :3]
        bar = axes.figure.colorbar(
            mapping, ax=axes, label=style.label, location="left", shrink=0.6, pad=0.02
        )
        bar.outline.set_visible(False)
    thin = min(CELL_EDGES, 12.0 / len(faces) ** 0.5)
    if off_screen():
        axes.add_artist(_by_pyvista(axes, facets, faces, thin, markers)).set_clip_on(False)
    else:
        axes.add_collection3d(_by_matplotlib(axes, facets, faces, thin))


def _by_matplotlib(axes: Any, facets: Facets, faces: Array, thin: float) -> Any:
    """Collection of the facets that the camera sees; ``thin`` is the width of edges [points]."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    normals = facets.normals()
    seen = normals @ _direction(axes.elev, axes.azim) > 0.0
    light = _direction(axes.elev + LIGHT[0], axes.azim + LIGHT[1])
    bright = DARKEST + (1.0 - DARKEST) * np.clip(normals @ light, 0.0, 1.0)
    edges = {"edgecolors": (0.0, 0.0, 0.0, EDGES), "linewidths": thin}
    shaded = (faces * bright[:, None])[seen]
    return Poly3DCollection(facets.rings[seen], facecolors=shaded, clip_on=False, **edges)


def _by_pyvista(axes: Any, facets: Facets, faces: Array, thin: float, markers: list[Any]) -> Any:
    """Artist that draws the facets into an image, and markers that they hide as rings."""
    import pyvista
    from matplotlib.artist import Artist
    from matplotlib.transforms import Bbox

    first, nodes = np.unique(facets.nodes, return_index=True, return_inverse=True)[1:]
    points = facets.rings.reshape(-1, 3)[first]
    surface = pyvista.PolyData.from_regular_faces(points, nodes.reshape(facets.nodes.shape))
    surface.cell_data["colour"] = np.round(255.0 * faces).astype(np.uint8)
    drawn: dict[Any, Any] = {}

    class Bodies(Artist):
        def get_window_extent(self, renderer: Any = None) -> Any:
            places = _pixels(axes, points)
            return Bbox([places.min(axis=0), places.max(axis=0)])

        def draw(self, renderer: Any) -> None:
            pixels, sheet = _pixels(axes, points), axes.figure.bbox.size
            ends = [pixels.min(axis=0), pixels.max(axis=0)]
            low, high = np.clip(ends, -sheet, 2 * sheet)
            frame = Frame(axes, low, renderer.get_image_magnification())
            size = np.ceil((high - low) * frame.larger).astype(int)
            known = frame.larger, *size, np.round(pixels - low, 6).tobytes()
            if not size.all():  # outside
                return
            if known not in drawn:  # figures are drawn twice to find what they contain
                drawn.clear()
                drawn[known] = _rendered(surface, size, thin, markers, frame)
            gc = renderer.new_gc()
            renderer.draw_image(gc, *frame.low.round(), drawn[known])
            gc.restore()

    return Bodies()


class Frame(NamedTuple):
    """Part of a picture that shows bodies.

    Attributes:
        axes: Axes of matplotlib.
        low: Lower left corner in the picture, shape (2,) [pixel].
        larger: Pixels of the image in a pixel along each direction [1].
    """

    axes: Any
    low: Array
    larger: float


@cache
def off_screen() -> bool:
    """Whether pyvista is installed, and EGL has a device on which its VTK draws without a screen.

    VTK ends the process where there is none.
    """
    with suppress(PackageNotFoundError, OSError):
        if find_spec("pyvista") is None or tuple(map(int, version("vtk").split(".")[:2])) < VTK:
            return False
        egl, count = CDLL("libEGL.so.1"), c_int(0)
        egl.eglGetProcAddress.restype = c_void_p
        query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
        devices = CFUNCTYPE(c_uint, c_int, c_void_p, c_void_p)
        return bool(query and devices(query)(0, None, addressof(count)) and count.value > 0)
    return False


def _rendered(surface: Any, size: Indices, thin: float, markers: list[Any], frame: Frame) -> Any:
    """Image of a surface of pyvista, shape (height, width, 4); markers that it hides are rings.

    Args:
        surface: The facets, with their colours.
        size: Width and height of the image, shape (2,) [pixel of it].
        thin: Width of the edges of cells [points].
        markers: Lines of one point of matplotlib.
        frame: Part of the picture.
    """
    import pyvista

    points, axes = surface.points, frame.axes
    away = BEFORE * np.ptp(points, axis=0).max()
    options = {"consistent_normals": False, "split_vertices": True, "feature_angle": DRAWN_ANGLE}
    smooth = surface.compute_normals(cell_normals=False, **options)
    edges = surface.extract_feature_edges(DRAWN_ANGLE, non_manifold_edges=False)
    edges.points += away * _direction(axes.elev, axes.azim)
    light = _direction(axes.elev + LIGHT[0], axes.azim + LIGHT[1])
    with _no_screen():
        plotter = pyvista.Plotter(off_screen=True, window_size=size.tolist(), lighting="none")
        plotter.enable_anti_aliasing("ssaa")
        plotter.add_light(pyvista.Light(position=points[0] + light, focal_point=points[0]))
        wide = frame.larger * axes.figure.dpi / 72.0  # [pixel / point]
        cells = {"edge_opacity": EDGES * min(thin * wide, 1.0), "line_width": max(thin * wide, 1.0)}
        shading = {"smooth_shading": True, "ambient": DARKEST, "diffuse": 1.0 - DARKEST}
        colour = {"scalars": "colour", "rgb": True, "show_edges": True, "edge_color": "black"}
        plotter.add_mesh(smooth, **colour, **cells, **shading)
        if edges.n_points > 0:
            width = {"line_width": BODY_EDGES * wide, "lighting": False}
            plotter.add_mesh(edges, color="black", opacity=EDGES, **width)
        _set_camera(plotter.camera, points, size, frame)
        eye = np.array(plotter.camera.position)
        image = plotter.screenshot(None, transparent_background=True, return_img=True)
        plotter.close()
    for marker in markers:
        place = np.ravel(marker.get_data_3d())
        start = place + 2.0 * away * (eye - place) / np.linalg.norm(eye - place)
        hidden = len(surface.ray_trace(start, eye)[0]) > 0
        marker.set_markerfacecolor("none" if hidden else PRESSURE)
    return np.ascontiguousarray(image[::-1])


def _set_camera(camera: Any, points: Array, size: Indices, frame: Frame) -> None:
    """Give a camera of VTK the view of axes of matplotlib, and an image of a frame."""
    middle, width = points.mean(axis=0), np.ptp(points, axis=0).max()
    pixels = _pixels(frame.axes, np.vstack([middle, middle + 1e-4 * width * np.eye(3)]))
    upwards = (pixels[1:, 1] - pixels[0, 1]) / (1e-4 * width)  # [pixel / length]
    eye = np.linalg.svd(frame.axes.get_proj()[[0, 1, 3]])[2][-1]  # its image has no place
    parallel = abs(eye[3]) * width < 1e-9 * np.linalg.norm(eye[:3])
    to_camera = _direction(frame.axes.elev, frame.axes.azim)
    camera.position = middle + 10.0 * width * to_camera if parallel else eye[:3] / eye[3]
    camera.focal_point, camera.up = middle, upwards
    camera.parallel_projection = parallel
    camera.parallel_scale = 0.5 * size[1] / frame.larger / np.linalg.norm(upwards)
    camera.view_angle = np.degrees(2.0 * np.arctan(camera.parallel_scale / camera.distance))
    centre = 2.0 * (pixels[0] - frame.low) * frame.larger / size - 1.0
    camera.SetWindowCenter(*-centre)
    camera.clipping_range = camera.distance - 3.0 * width, camera.distance + 3.0 * width


@contextmanager
def _no_screen() -> Iterator[None]:
    """Context in which VTK does not look for a screen first, and report that there is none."""
    name = "VTK_DEFAULT_OPENGL_WINDOW"
    before = os.environ.get(name)
    os.environ.setdefault(name, "vtkEGLRenderWindow")
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]


def _draw_largest_pressures(axes: Any, contacts: list[Any], style: Style) -> list[Any]:
    """Mark the node of the largest pressure of each contact, and return the markers."""
    markers = []
    for contact in contacts:
        if contact.pressure.max() > 0.0:
            k = contact.pressure.argmax()
            X, x = contact.slave.X[k], contact.operators.x[k]
            label = pressure_label(contacts, contact, style)
            place = X + style.scale * (x - X)
            look = {"markersize": 5, "color": PRESSURE, "zorder": 10}
            markers += axes.plot(*place[:, None], "o", label=label, **look)
    return markers


def _direction(elevation: float, azimuth: float) -> Array:
    """Unit vector to a place at two angles [degrees], shape (3,) [1]."""
    up, about = np.radians([elevation, azimuth])
    return np.array([np.cos(up) * np.cos(about), np.cos(up) * np.sin(about), np.sin(up)])


def rings_of_skin(V: Any) -> tuple[Indices, Indices]:
    """The outer facets of the mesh of a Lagrange space of degree 1 or 2 in space (collective).

    Returns:
        Local cells of the facets (f,), and local nodes along their outlines, counter-clockwise
        seen from outside, with those in the middle of edges of order 2, (f, k).
    """
    topology = V.mesh.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    outer = dmesh.exterior_facet_indices(topology)
    cells, nodes = cells_of_facets(V.mesh, outer)[0], outward_nodes(V, outer)
    count = CORNERS[nodes.shape[1]]
    sides = [nodes[:, first : first + count] for first in range(0, nodes.shape[1] - 1, count)]
    return cells, np.stack(sides, axis=2).reshape(len(nodes), count * len(sides))
