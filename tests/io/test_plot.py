# SPDX-License-Identifier: MIT
"""Pictures show bodies, fields and pressures."""

import re

from mpi4py import MPI

import numpy as np
import pytest
import scenes
from test_results import CELLS, FIXED, pressed

import ufl
from dolfinx import fem

import fenics_mortar as fm
from fenics_mortar.io.picture import plot
from meshes import two_blocks

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("solved, degree", [(True, 1), (False, 1), (True, 2)])
def test_plot_draws_a_picture(shared_path, cell, solved, degree):
    from matplotlib import image

    scene = pressed(cell, degree=degree)
    if solved:
        scene.problem.solve()
    energy = ufl.inner(ufl.grad(scene.u), ufl.grad(scene.u))
    options = {"title": "Blocks", "stress": energy, "label": "energy"} if solved else {}
    plot(scene.problem, shared_path / "new" / "picture.png", scale=2.0, **options)
    COMM.barrier()
    pixels = image.imread(shared_path / "new" / "picture.png")[..., :3]
    assert 500 < pixels.shape[0] < 2000
    assert 500 < pixels.shape[1] < 2000
    blank = (pixels > 0.99).all(axis=-1).mean()
    assert 0.05 < blank < 0.7
    red = (pixels[..., 0] > 0.7) & (pixels[..., 1:] < 0.3).all(axis=-1)
    assert (red.mean() > 1e-3) == solved  # the pressure


def test_plot_refuses_what_is_not_a_scalar(shared_path):
    scene = pressed()
    with pytest.raises(fm.MortarError, match="expected a scalar"):
        plot(scene.problem, shared_path / "picture", stress=ufl.grad(scene.u))


def test_plot_shows_every_cell_once(shared_path, monkeypatch):
    """Ghost cells of several ranks must not be drawn twice."""
    from fenics_mortar.io import picture

    drawn = []
    original = picture._draw_bodies
    monkeypatch.setattr(
        picture, "_draw_bodies", lambda *args: drawn.append(args) or original(*args)
    )
    scene = pressed()
    x = ufl.SpatialCoordinate(scene.data.mesh)
    plot(scene.problem, shared_path / "picture", stress=x[0] + 10 * x[1])
    if COMM.rank == 0:
        _, nodes, polygons, values = drawn[0]
        size = scene.data.mesh.topology.index_map(2).size_global
        assert len(nodes) == size == len(np.unique(np.sort(nodes), axis=0))
        assert np.allclose(values, polygons.mean(axis=1) @ [1.0, 10.0])


def axes_of(problem, **options):
    """Axes of a picture on rank 0, ``None`` elsewhere."""
    from matplotlib.figure import Figure

    axes = Figure().add_subplot() if COMM.rank == 0 else None
    plot(problem, ax=axes, **options)
    return axes


def test_plot_draws_into_given_axes_with_units_and_writes_no_file(shared_path):
    scene = pressed()
    scene.problem.solve()
    axes = axes_of(scene.problem, units=("mm", "MPa"), title="Blocks")
    assert not list(shared_path.iterdir())
    if COMM.rank == 0:
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")
        assert axes.get_title() == "Blocks" and axes.get_aspect() == 1.0
        (text,) = axes.get_legend().get_texts()
        assert re.fullmatch(r"pressure on upper/bottom, maximum [\d.]+ MPa", text.get_text())
        axes.figure.draw_without_rendering()
        legend, inside = axes.get_legend().get_window_extent(), axes.get_window_extent()
        labels = axes.xaxis.get_label().get_window_extent()
        assert legend.y1 < labels.y0 < inside.y0  # outside of the curves, and of the label


def test_plot_names_the_masters_of_a_surface_that_meets_several():
    data = scenes.read(two_blocks.build, gap=3.0, n_lower=12, layers_lower=3)
    u = fem.Function(fm.vector_space(data.mesh, 1))
    fixed = [fm.dirichlet(u.function_space, data, name, (0, 0)) for name in FIXED]
    circles = [fm.Circle((x, 1.98), 1.0, name=f"at {x}") for x in (0.5, 1.7)]
    problem = fm.ContactProblem(
        scenes.internal(u, scenes.linear_elastic(u, 100.0, 0.3)), u,
        [fm.ContactPair(data, "lower/top", circle) for circle in circles],
        bcs=fixed, petsc_options_prefix="test_",
    )  # fmt: skip
    problem.solve()
    axes = axes_of(problem)
    if COMM.rank == 0:
        labels = [text.get_text() for text in axes.get_legend().get_texts()]
        assert ["by at 0.5," in labels[0], "by at 1.7," in labels[1]] == [True, True]


@pytest.mark.each
@pytest.mark.parametrize(
    "field, options, cmap, low, high",
    [
        (lambda x: x[0], {}, "YlGnBu", 0.0, None),
        (lambda x: x[0] - 1.0, {}, "RdBu_r", "-high", None),
        (lambda x: x[0] - 1.0, {"limits": (-2.0, 1.0)}, "RdBu_r", -2.0, 1.0),
        (lambda x: x[0] - 1.0, {"limits": (0.0, 0.5)}, "YlGnBu", 0.0, 0.5),
        (lambda x: x[0], {"cmap": "magma", "limits": (0.0, 3.0)}, "magma", 0.0, 3.0),
    ],
)
def test_colour_scale_follows_the_sign_and_given_limits(field, options, cmap, low, high):
    scene = pressed()
    x = ufl.SpatialCoordinate(scene.data.mesh)
    axes = axes_of(scene.problem, stress=field(x), label="field", **options)
    if COMM.rank == 0:
        cells = axes.collections[0]
        assert cells.get_cmap().name == cmap
        norm = cells.norm
        if high is not None:
            assert (norm.vmin, norm.vmax) == (low, high)
        if cmap == "RdBu_r":
            assert norm(0.0) == pytest.approx(0.5)
        if low == "-high":
            assert norm.vmin == -norm.vmax


@pytest.mark.each
@pytest.mark.parametrize(
    "options, message",
    [
        ({}, "path=None: expected the name of a file, or axes as ax"),
        ({"path": "a", "limits": (1.0, 0.0)}, "limits=.*: expected two increasing numbers"),
        ({"path": "a", "limits": 3.0}, "limits=3.0"),
        ({"path": "a", "units": "mm"}, "units='mm': expected those of length and stress"),
    ],
)
def test_plot_refuses_arguments_on_all_ranks(options, message):
    scene = pressed()
    with pytest.raises((ValueError, fm.MortarError), match=message):
        plot(scene.problem, **options)
    COMM.barrier()  # hangs if a rank has left
