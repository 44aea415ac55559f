# SPDX-License-Identifier: MIT
"""The surface of some boundary tags: curves in the plane, faces in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fenics_mortar.interface.curve_surface import extract_curve
from fenics_mortar.interface.faces import extract_faces
from fenics_mortar.mesh.space import DisplacementSpace


def extract_surface(
    space: DisplacementSpace, facet_tags: Any, tags: Sequence[int], name: str
) -> Any:
    """Extract the facets of some tags as a ``Curve`` or as ``Faces`` (collective).

    Args:
        space: Nodes and dofs of the displacement, degree 1 or 2.
        facet_tags: Facet tags of the mesh.
        tags: Tags of the surface.
        name: Name used in messages.

    Raises:
        SurfaceError: On all ranks; see ``extract_curve`` and ``extract_faces``.
    """
    extract = extract_curve if space.V.mesh.topology.dim == 2 else extract_faces
    return extract(space, facet_tags, tags, name)
