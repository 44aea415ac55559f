# SPDX-License-Identifier: MIT
"""Averaged unit normals of the nodes of a surface, and their derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_mortar.interface.options import WEIGHTINGS, Weighting
from fenics_mortar.kernels import normals
from fenics_mortar.kernels.space import normals as space_normals
from fenics_mortar.utils.arrays import Array, Indices


def evaluate_normals(
    surface: Any,
    x: Array,
    weighting: Weighting,
    links: tuple[Indices, Indices] | None = None,
    projectors: Array | None = None,
) -> tuple[Array, Array]:
    """Averaged unit normals of nodes, and their derivatives (local).

    Args:
        surface: The surface.
        x: Current positions of its n nodes, shape (n, dim) [length].
        weighting: Weights of the facet normals at a node.
        links: Nodes before and after each node of a curve, (n,) each, if not those of the surface.
        projectors: Matrices that remove the components along symmetry planes' normals, in space
            only, shape (n, 3, 3).

    Returns:
        Normals (n, dim) and derivatives by the nodes of the stencil, (n, dim, dim s) [1 / length];
        see ``kernels.normals`` and ``kernels.space.normals``.
    """
    n, dn = np.empty_like(x), np.zeros((*x.shape, surface.stencil_dofs.shape[1]))
    choice = WEIGHTINGS[weighting]
    if surface.dim == 2:
        links = (surface.previous, surface.following) if links is None else links
        normals.tabulate_normals(x, *links, surface.inner, choice, n, dn)
    else:
        space_normals.tabulate_normals(
            x, surface.facets, surface.around, surface.stencil, choice, projectors, n, dn
        )
    return n, dn
