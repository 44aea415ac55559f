# SPDX-License-Identifier: MIT
"""Dual basis of whole facets on partly covered facets, for comparison with the consistent basis.

The contrast of Cichosz & Bischoff (2011) and Popp, Seitz, Gee & Wall (2013): Phi and D are those of
the whole facet, Phi = A N with the constant A below and D = l / 2, while M and the gap are
integrated over the covered part only.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

from fenics_mortar.contact.contact import Contact
from fenics_mortar.interface import integrals
from fenics_mortar.kernels.facets import DUAL, STANDARD

A = np.array([[2.0, -1.0], [-1.0, 2.0]])


@contextmanager
def whole_facet_basis() -> Iterator[None]:
    """Context in which all pairs use this basis."""
    function = partial(integrate_segments, integrals.integrate_segments)
    with (
        patch.object(integrals, "integrate_segments", function),
        patch.object(
            Contact, "update_multiplier_nodes", lambda self: 0
        ),  # hardly covered nodes are kept
    ):
        yield


def integrate_segments(
    standard: Any, s: Any, nodes: Any, geometry: Any, weights: Any, options: Any, thickness: Any
) -> Any:
    """As ``interface.integrals.integrate_segments``, from the integrals of the standard basis."""
    kind, *others = options
    if kind != DUAL or nodes.shape[1] != 2:
        return standard(s, nodes, geometry, weights, options, thickness)
    found = standard(s, nodes, geometry, weights, (STANDARD, *others), thickness)
    D, dD, M, dM, g, dg, cover = found
    edges = np.diff(geometry[0][nodes], axis=1)[:, 0]
    dual = (weights == np.eye(2)).all(axis=(1, 2)) & (cover.sum(axis=1) > 0.0)
    of_segment = np.repeat(dual, np.diff(s.offsets))
    of_pair = np.repeat(dual, np.diff(s.pair_offsets))
    for array, chosen in ((M, of_segment), (dM, of_pair), (g, dual), (dg, of_segment)):
        rows = array[chosen].reshape(np.count_nonzero(chosen), 2, -1)
        array[chosen] = np.einsum("ij,njr->nir", A, rows).reshape(array[chosen].shape)
    length = np.linalg.norm(edges[dual], axis=1)[:, None]
    D[dual] = 0.5 * length[:, :, None] * np.eye(2)
    dD[of_segment] = 0.0
    change = 0.5 * edges[dual] / length
    for j in range(2):  # the first segment of the facet represents all
        dD[s.offsets[:-1][dual], j, j, 2:6] = np.hstack([-change, change])
    return found
