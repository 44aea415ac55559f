# SPDX-License-Identifier: MIT
"""Check of the tags in the measures of a user's form: ds(99) is zero if no facet has the tag 99."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dolfinx import mesh as dmesh

from fenics_mortar.mesh.data import MeshData, check_tags
from fenics_mortar.utils.arrays import Indices
from fenics_mortar.utils.errors import MeshError

# Name of the measure, dimension, and description of its entities, by UFL's type of integral.
MEASURES = {
    "cell": ("dx", 2, "cell"),
    "exterior_facet": ("ds", 1, "facet of the boundary"),
    "interior_facet": ("dS", 1, "facet inside the bodies"),
}


def check_subdomains(what: str, form: Any, mesh: dmesh.Mesh, named: Sequence[MeshData]) -> None:
    """Reject integrals over tags of another mesh, or that no entity has (collective).

    Args:
        what: Description of the form, for the message.
        form: The UFL form.
        mesh: The mesh.
        named: Meshes with names, which are listed in the message.

    Raises:
        MeshError: On all ranks.
    """
    for kind, (measure, dim, entity) in MEASURES.items():
        integrals = [i for i in form.integrals() if i.integral_type() == kind]
        numbers = sorted(set().union(*(_numbers(i.subdomain_id()) for i in integrals)))
        given = (i.subdomain_data() for i in integrals)
        tags: Any = next((data for data in given if data is not None), None)
        if hasattr(tags, "find"):
            check_tags(f"the tags of {measure} in the {what}", tags, mesh)
            if tags.dim != dim:
                raise MeshError(
                    f"the tags of {measure} in the {what} are of dimension {tags.dim}; expected "
                    f"tags of dimension {dim}"
                )
        if not numbers:
            continue
        where = f"the {what} has an integral over {measure}({{}})"
        if tags is None:
            name = "cell_tags" if dim == 2 else "facet_tags"
            raise MeshError(
                f"{where.format(numbers[0])}, but this measure has no tags, and the integral would "
                f"be zero: give it subdomain_data=data.{name}"
            )
        here = _tags_with_entities(tags, kind, mesh)
        present = sorted(set().union(*mesh.comm.allgather(here)))
        missing = [number for number in numbers if number not in present]
        if missing:
            raise MeshError(
                f"{where.format(missing[0])}, but no {entity} has the tag {missing[0]}, and the "
                f"integral would be zero; the tags there are {_listed(present, tags, named)}: "
                "correct the tag, or leave out the integral"
            )


def _numbers(subdomain: Any) -> set[int]:
    """Tags of an integral, without "everywhere" and "otherwise" (local)."""
    several = subdomain if isinstance(subdomain, tuple) else (subdomain,)
    return {int(number) for number in several if not isinstance(number, str)}


def _tags_with_entities(tags: Any, kind: str, mesh: dmesh.Mesh) -> set[int]:
    """Tags of the entities of this rank over which a form is integrated (local).

    Later releases of dolfinx also take pairs of a tag and its entities.
    """
    if not hasattr(tags, "find"):
        return {int(number) for number, entities in tags if len(entities)}
    if kind == "cell":
        used: Indices = np.arange(mesh.topology.index_map(2).size_local)
    else:
        mesh.topology.create_connectivity(1, 2)
        used = dmesh.exterior_facet_indices(mesh.topology)
        if kind == "interior_facet":
            used = np.setdiff1d(np.arange(mesh.topology.index_map(1).size_local), used)
    return {int(tag) for tag in np.unique(tags.values[np.isin(tags.indices, used)])}


def _listed(present: Sequence[int], tags: Any, named: Sequence[MeshData]) -> str:
    """The tags with entities, with their names if they have one (local)."""
    name_of = {
        tag: name
        for data in named
        for own, names in ((data.facet_tags, data.boundaries), (data.cell_tags, data.bodies))
        if own is tags
        for name, tag in names.items()
    }
    shown = [f"{tag} ('{name_of[tag]}')" if tag in name_of else f"{tag}" for tag in present]
    return ", ".join(shown) or "none"
