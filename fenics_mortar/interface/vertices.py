# SPDX-License-Identifier: MIT
"""Surfaces with straight facets between the vertices of quadratic ones, for fields of degree 1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_mortar.interface.curve_surface import Curve
from fenics_mortar.utils.arrays import Indices


def surface_of_vertices(surface: Curve) -> tuple[Curve, Indices]:
    """The surface without the inner nodes of its facets (local).

    Returns:
        The surface, and the numbers of its k nodes in the given one, shape (k,).
    """
    degree, kept = surface.degree, np.flatnonzero(~surface.inner)
    number = np.full(surface.num_nodes + 1, -1)
    number[kept] = np.arange(kept.size)
    before, after = surface.along(kept, range(-degree, degree + 1, 2 * degree)).T
    mine = np.isin(surface.owned, kept)
    vertices = replace(
        surface,
        X=surface.X[kept],
        facets=number[surface.facets[:, [0, -1]]],
        previous=number[before],
        following=number[after],
        nodes=surface.nodes[kept],
        owners=surface.owners[kept],
        owned=number[surface.owned[mine]],
        dofs=surface.dofs[kept],
        local_dofs=surface.local_dofs[mine],
        thickness=surface.thickness.of(kept) if surface.thickness else None,
        roles=None,
    )
    return vertices, kept
