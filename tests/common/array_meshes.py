# SPDX-License-Identifier: MIT
"""Meshes from arrays of cells and nodes, and problems on them."""

import numpy as np
from refusal import COMM
from scenes import internal, neo_hookean

from dolfinx import fem
from dolfinx import mesh as dmesh

import fenics_mortar as fm
from fenics_mortar.interface.traces import extract_surface
from fenics_mortar.mesh.space import DisplacementSpace
from fenics_mortar.utils import compat


def mesh_of(cells, x, cell="quadrilateral"):
    """Create a mesh from the arrays of rank 0."""
    if COMM.rank:
        cells, x = np.empty((0, np.shape(cells)[1]), int), np.empty((0, 2))
    mesh = compat.create_mesh(COMM, cells, x, cell)
    mesh.topology.create_entities(1)
    return mesh


def tagged(mesh, **boundaries):
    """Tag the facets of which all vertices satisfy a condition; name them in the order given."""
    facets = [dmesh.locate_entities(mesh, 1, where) for where in boundaries.values()]
    return tagged_facets(mesh, dict(zip(boundaries, facets, strict=True)))


def tagged_facets(mesh, boundaries):
    """Tag and name local facets."""
    facets = np.concatenate([np.empty(0, np.int32), *boundaries.values()]).astype(np.int32)
    sizes = [found.size for found in boundaries.values()]
    tags = np.repeat(np.arange(1, 1 + len(sizes)), sizes).astype(np.int32)
    order = np.argsort(facets, kind="stable")
    facet_tags = dmesh.meshtags(mesh, 1, facets[order], tags[order])
    return fm.MeshData(mesh, None, facet_tags, {}, dict(zip(boundaries, range(1, 9), strict=False)))


def grid(nx, ny, corner=(0.0, 0.0), size=(1.0, 1.0), first=0):
    """Quadrilaterals and nodes of a rectangle; nodes are numbered from ``first`` on."""
    X, Y = np.meshgrid(np.linspace(0, 1, nx + 1), np.linspace(0, 1, ny + 1))
    x = np.array(corner) + np.stack([X.ravel(), Y.ravel()], axis=1) * size
    i, j = (index.ravel() for index in np.meshgrid(np.arange(nx), np.arange(ny)))
    corners = i + (nx + 1) * j
    return first + np.stack([corners, corners + 1, corners + nx + 1, corners + nx + 2], axis=1), x


def triangles(cells):
    """Two triangles of each quadrilateral."""
    return np.concatenate([cells[:, [0, 1, 3]], cells[:, [0, 3, 2]]])


def blocks_of_arrays(cell="quadrilateral", turn=False):
    """Two blocks that touch at y = 1; ``turn`` gives every cell negative orientation."""
    lower, x = grid(4, 3, (0.0, 0.0), (2.0, 1.0))
    upper, y = grid(3, 3, (0.4, 1.5), (1.0, 1.0), first=len(x))
    cells = np.concatenate([lower, upper])
    cells = triangles(cells) if cell == "triangle" else cells
    if turn:
        cells = cells[:, [0, 2, 1] if cell == "triangle" else [1, 0, 3, 2]]
    mesh = mesh_of(cells, np.concatenate([x, y]), cell)
    places = {"base": 0.0, "master": 1.0, "slave": 1.5, "top": 2.5}
    data = tagged(mesh, **{k: lambda x, y=y: np.isclose(x[1], y) for k, y in places.items()})
    moved = mesh.geometry.x
    moved[moved[:, 1] > 1.25, 1] -= 0.5
    return data


def bcs_of(data, V, push=-0.02):
    """The base fixed, the top moved by ``push`` in y."""
    return [fm.dirichlet(V, data, "base", (0.0, 0.0)), fm.dirichlet(V, data, "top", (0.0, push))]


def problem_on(data, pairs=None, material=neo_hookean, u=None, **options):
    """Contact of the boundaries ``slave`` and ``master``, without Dirichlet conditions."""
    u = fem.Function(fm.vector_space(data.mesh, 1)) if u is None else u
    pairs = [fm.ContactPair(data, "slave", "master")] if pairs is None else pairs
    options = {"petsc_options_prefix": "test_errors_", **options}
    return fm.ContactProblem(internal(u, material(u, 100.0, 0.3)), u, pairs, **options)


def surface_of(data, name):
    V = fm.vector_space(data.mesh, 1)
    return extract_surface(DisplacementSpace(V), data.facet_tags, data.boundary_tags(name), name)
