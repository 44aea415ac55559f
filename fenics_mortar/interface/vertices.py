# SPDX-License-Identifier: MIT
"""Surfaces with linear facets between the vertices of quadratic ones, for fields of degree 1."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fenics_mortar.interface.faces import CORNERS, Faces
from fenics_mortar.utils.arrays import Indices


def surface_of_vertices(surface: Any) -> tuple[Any, Indices]:
    """The surface without the inner nodes of its facets (local).

    Returns:
        The surface, and the numbers of its k nodes in the given one, shape (k,).
    """
    degree, kept = surface.degree, np.flatnonzero(~surface.inner)
    number = np.full(surface.num_nodes + 1, -1)
    number[kept] = np.arange(kept.size)
    mine = np.isin(surface.owned, kept)
    if isinstance(surface, Faces):
        corners = surface.facets[:, : CORNERS[surface.facets.shape[1]]]
        own = {"facets": number[corners], "is_open": surface.is_open[kept]}
    else:
        before, after = surface.along(kept, range(-degree, degree + 1, 2 * degree)).T
        thickness = surface.thickness.of(kept) if surface.thickness else None
        own = {
            "facets": number[surface.facets[:, [0, -1]]], "previous": number[before],
            "following": number[after], "thickness": thickness,
        }  # fmt: skip
    vertices = replace(
        surface,
        X=surface.X[kept],
        nodes=surface.nodes[kept],
        owners=surface.owners[kept],
        owned=number[surface.owned[mine]],
        dofs=surface.dofs[kept],
        local_dofs=surface.local_dofs[mine],
        roles=None,
        **own,
    )
    return vertices, kept
