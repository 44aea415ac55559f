# SPDX-License-Identifier: MIT
"""Check that tags belong to a mesh: those of another one crash dolfinx, or mark wrong entities."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx import mesh as dmesh

from fenics_mortar.utils import compat
from fenics_mortar.utils.arguments import check_kind
from fenics_mortar.utils.errors import MeshError, raise_together

# Names of the entities of a plane mesh by dimension, in messages.
ENTITIES = ("vertices", "facets", "cells")


def check_tags(what: str, tags: Any, mesh: dmesh.Mesh) -> None:
    """Reject tags of another mesh, or of entities that the mesh does not have (collective).

    Args:
        what: Description of the tags, for the message.
        tags: Tags of dolfinx, or ``None``.
        mesh: The mesh.

    Raises:
        MeshError: On all ranks.
        ValueError: If tags or mesh are of another type.
    """
    if tags is None:
        return
    if not all(hasattr(tags, name) for name in ("find", "indices", "dim")):
        raise ValueError(f"{what}={tags!r}: expected tags of dolfinx.mesh.meshtags, or None")
    check_kind("mesh", mesh, dmesh.Mesh, "a mesh of dolfinx")
    error = None
    if not compat.are_tags_of(tags, mesh):
        error = MeshError(
            f"{what} belong to another mesh; expected tags of this one, e.g. facet_tags or "
            "cell_tags of its MeshData"
        )
    else:
        mesh.topology.create_entities(tags.dim)
        index_map = mesh.topology.index_map(tags.dim)
        count = index_map.size_local + index_map.num_ghosts
        indices = np.asarray(tags.indices)
        wrong = indices[(indices < 0) | (indices >= count)]
        if wrong.size:
            error = MeshError(
                f"{what} have entity {wrong[0]}, but there are {count} {ENTITIES[tags.dim]} on "
                f"rank {mesh.comm.rank}: they were made for another mesh"
            )
    raise_together(mesh.comm, error)
