# SPDX-License-Identifier: MIT
"""Pictures of the deformed bodies and the contact pressure."""

from __future__ import annotations

from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_mortar.bulk.cells import OUTLINE
from fenics_mortar.contact.tied import Tie
from fenics_mortar.io import paraview, solids
from fenics_mortar.utils import errors, files

if TYPE_CHECKING:
    from fenics_mortar.contact.contact import Contact
    from fenics_mortar.obstacles.obstacle import Obstacle
    from fenics_mortar.problem import ContactProblem
    from fenics_mortar.utils.arrays import Array, Indices


# White around a picture [pixel].
WHITE = 20


def plot(
    problem: ContactProblem,
    path: str | Path | None = None,
    *,
    stress: Any | None = None,
    label: str = "stress",
    title: str | None = None,
    scale: float = 1.0,
    units: tuple[str, str] | None = None,
    limits: tuple[float, float] | None = None,
    cmap: Any | None = None,
    ax: Any | None = None,
) -> None:
    """Draw the deformed bodies and the pressure on the slave surfaces (collective).

    The axes have equal scales. Fields of both signs have a diverging map with white at zero. Of
    solids the outer facets are drawn, and the places of the largest pressures: by pyvista where it
    is installed and EGL draws without a screen, with rings for hidden places, otherwise by
    matplotlib, which may draw facets before others that hide them.

    Args:
        problem: The problem to draw.
        path: Path of a PNG file, used on the first rank; ``.png`` is appended, missing folders are
            created. ``None`` if ``ax`` is given.
        stress: Scalar UFL expression whose values at the midpoints colour the cells, or its means
            over the cells if it contains functions at quadrature points.
        label: Label of the colour bar.
        title: Title of the picture.
        scale: Factor of the displacement [1].
        units: Units of length and stress, e.g. ``("mm", "MPa")``, for the labels of the axes and of
            the largest pressure.
        limits: Smallest and largest value of the colours [unit of ``stress``]; by default those of
            the field, symmetric about zero if it has both signs.
        cmap: Colour map of matplotlib, or its name.
        ax: Axes of matplotlib on the first rank, instead of a new figure, for solids those of a
            "3d" projection; other ranks may pass ``None``. Without ``path`` no file is written.
            Angles of the camera are theirs, and so are limits that were set on them, as ``xlim``:
            of solids only facets that lie within are drawn.

    Raises:
        MortarError: On all ranks, if the expression cannot be evaluated or the file not be written.
        ValueError: On all ranks, if an argument is of another type, or neither ``path`` nor ``ax``
            is given.
    """
    paraview.check_problem(problem)
    comm = problem.equations.comm
    with errors.together(comm, "plot"):
        _check(path, scale, units, limits, ax, first=comm.rank == 0)
        if stress is not None:
            paraview.check_name(label)
    values = (
        None if stress is None else paraview.CellField(problem, stress, label, rank=0).evaluate()
    )
    file = None
    if comm.bcast(path is not None):
        file = files.without_suffix(comm, "" if path is None else path, ".png")
        files.make_folder(comm, file.parent)
    style = solids.Style(None if stress is None else label, title, scale, units, limits, cmap)
    parts = _gathered_facets(problem, values, scale)
    contacts = [c for c in paraview.evaluated_contacts(problem) if not isinstance(c, Tie)]
    draw_bodies = draw_section if problem.equations.bulk.space.dim == 2 else solids.draw_solids

    def draw() -> None:
        facets = solids.Facets(*(np.concatenate(each) for each in zip(*parts, strict=True)))
        axes = draw_bodies(problem, ax, facets, contacts, style)
        if file is not None:
            files.write_whole(file.with_name(f"{file.name}.png"), partial(_save, axes.figure))

    message = "cannot draw" if file is None else f"cannot draw '{file}.png'"
    files.try_together(comm, comm.rank == 0, draw, message)


def _save(figure: Any, path: Any) -> None:
    """Write a figure without its white margins, which are wide around axes in space."""
    from matplotlib.image import imread, imsave

    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=200, bbox_inches="tight")
    drawn.seek(0)
    pixels = imread(drawn)
    used = [np.flatnonzero((pixels < 1.0).any(axis=(side, 2))) for side in (1, 0)]
    around = tuple(slice(max(k[0] - WHITE, 0), k[-1] + WHITE) for k in used)
    imsave(path, pixels[around], format="png", dpi=200)


def _gathered_facets(problem: ContactProblem, values: Array | None, scale: float) -> Any:
    """Parts of ``Facets`` of all ranks on the first rank, ``None`` elsewhere (collective).

    Args:
        problem: The problem.
        values: Values of a field in the owned cells, shape (cells,), or ``None``.
        scale: Factor of the displacement [1].
    """
    bulk = problem.equations.bulk
    x = bulk.cells.X + scale * bulk.u.x.array[bulk.space.dofs]
    rings = paraview.owned_cells(problem)
    cells = np.arange(len(rings))
    if bulk.space.dim == 3:
        cells, rings = solids.rings_of_skin(bulk.V)
    nodes = bulk.V.dofmap.index_map.local_to_global(rings.ravel().astype(np.int32))
    given = np.zeros(len(rings)) if values is None else values[cells]
    return bulk.comm.gather((x[rings], nodes.reshape(rings.shape), given))


def draw_section(
    problem: ContactProblem, ax: Any, facets: solids.Facets, contacts: list[Any],
    style: solids.Style,
) -> Any:  # fmt: skip
    """Draw plane bodies into axes, or into new ones; see ``draw_solids`` (local)."""
    low, high = facets.rings.min(axis=(0, 1)), facets.rings.max(axis=(0, 1))
    axes = _new_axes(high - low) if ax is None else ax
    axes.set_aspect("equal")
    axes.set_title(style.title or "")
    values = None if style.label is None else facets.values
    bodies = _draw_bodies(axes, facets.nodes, facets.rings, values)
    if style.label is not None:
        bodies.set(**solids.colours(facets.values, style))
        inset = axes.inset_axes((1.03, 0.0, 0.025, 1.0))
        axes.figure.colorbar(bodies, cax=inset, label=style.label).outline.set_visible(False)
    _draw_obstacles(axes, problem.equations.motions.obstacles, *paraview.with_margin(low, high))
    _draw_pressure(axes, contacts, style, 0.1 * float(np.sqrt(np.prod(high - low))))
    names = "rz" if problem.equations.bulk.space.is_axisymmetric else "xy"
    solids.label_axes(axes, names, style, 6)
    _finish_axes(axes)
    return axes


def _check(path: Any, scale: Any, units: Any, limits: Any, ax: Any, *, first: bool) -> None:
    """Reject arguments of ``plot`` (local)."""
    if path is not None:
        errors.check_kind("path", path, (str, Path), "the name of a file")
    elif first and ax is None:
        raise ValueError("path=None: expected the name of a file, or axes as ax")
    errors.check_number("scale", scale, "a finite number", np.isfinite)
    if units is not None and not (
        isinstance(units, (tuple, list)) and [type(unit) for unit in units] == [str, str]
    ):
        raise ValueError(
            f"units={units!r}: expected those of length and stress, such as ('mm', 'MPa')"
        )
    if limits is not None:
        fits = isinstance(limits, (tuple, list, np.ndarray)) and len(limits) == 2
        if not fits or not np.isfinite(np.asarray(limits, float)).all() or limits[0] >= limits[1]:
            raise ValueError(f"limits={limits!r}: expected two increasing numbers")


def _new_axes(size: Array) -> Any:
    """Axes of a new figure for bodies of a size (2,) [length]."""
    from matplotlib.figure import Figure

    width, height = 6.0 * size / size.max()
    figure = Figure((max(width, 3.0) + 1.6, max(height, 1.5) + 0.9), layout="constrained")
    return figure.add_subplot()


def _finish_axes(axes: Any) -> None:
    """Thin lines around the numbers, and the legend below the axes."""
    from matplotlib.transforms import ScaledTranslation

    entries = axes.get_legend_handles_labels()[1]
    if entries:
        inches = axes.figure.dpi_scale_trans
        below = axes.transAxes + ScaledTranslation(0.0, -0.45, inches)  # numbers and axis label
        width = axes.get_window_extent().width / axes.figure.dpi
        columns = 2 if 2 * 0.07 * max(map(len, entries)) < width else 1  # width of a letter [inch]
        axes.legend(**solids.LEGEND, bbox_to_anchor=(0.0, 0.0), bbox_transform=below, ncols=columns)
    axes.margins(0.03)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(solids.GREY)
    axes.tick_params(color=solids.GREY)


def _draw_bodies(axes: Any, nodes: Indices, polygons: Array, values: Array | None) -> Any:
    """Draw cells with thin edges, and the outline: edges of one cell only."""
    from matplotlib.collections import LineCollection, PolyCollection

    around = OUTLINE[nodes.shape[1]]
    nodes, polygons = nodes[:, around], polygons[:, around]
    cells = PolyCollection(polygons, facecolors=solids.BODIES[0])
    cells.set(array=values, edgecolors=(0.1, 0.1, 0.1, 0.35))
    cells.set(linewidths=min(0.35, 12.0 / np.sqrt(len(nodes))))
    edges = np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=2).reshape(-1, 2)
    ends = np.stack([polygons, np.roll(polygons, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    _, first, count = np.unique(np.sort(edges), axis=0, return_index=True, return_counts=True)
    axes.add_collection(cells)
    axes.add_collection(LineCollection(ends[first[count == 1]], colors=solids.INK, linewidths=0.8))
    return cells


def _draw_obstacles(axes: Any, obstacles: list[Obstacle], low: Array, high: Array) -> None:
    """Draw the solid parts of obstacles, phi < 0, in a box."""
    x, y, points = paraview.grid(low, high)
    for obstacle in obstacles:
        phi = obstacle.evaluate(points)[0].reshape(paraview.GRID, paraview.GRID)
        if phi.min() < 0.0:
            axes.contourf(x, y, phi, [phi.min(), 0.0], colors=[solids.GREY], alpha=0.35, zorder=0)
            axes.contour(x, y, phi, [0.0], colors=[solids.INK], linewidths=0.8)


def _draw_pressure(axes: Any, contacts: list[Contact], style: solids.Style, height: float) -> None:
    """Draw the pressure along the outer normals of the slave surfaces, and its maximum."""
    from matplotlib.collections import LineCollection, PolyCollection

    largest = max((contact.pressure.max() for contact in contacts), default=0.0)
    for contact in contacts:
        pressure, o = contact.pressure, contact.operators
        if not pressure.max() > 0.0:
            continue
        foot = contact.slave.X + style.scale * (o.x - contact.slave.X)
        tip = foot + height / largest * pressure[:, None] * o.n
        facets = contact.slave.facets[(pressure[contact.slave.facets] != 0.0).any(axis=1)]
        areas = np.concatenate([foot[facets], tip[facets][:, ::-1]], axis=1)
        axes.add_collection(PolyCollection(areas, facecolors="white", alpha=0.35, linewidths=0.0))
        stems = np.stack([foot, tip], axis=1)[np.unique(facets)]
        thin = min(0.5, 16.0 / len(stems))
        for lines, thickness in ((stems, thin), (tip[facets], 1.2), (foot[facets], 1.2)):
            axes.add_collection(LineCollection(lines, colors=solids.PRESSURE, linewidths=thickness))
        label = solids.pressure_label(contacts, contact, style)
        axes.plot(*tip[pressure.argmax()], "o", markersize=4, color=solids.PRESSURE, label=label)
