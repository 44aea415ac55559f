# SPDX-License-Identifier: MIT
"""Support reactions: force and moment of the Dirichlet conditions on named boundaries."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from fenics_mortar.bulk.residual import Bulk
from fenics_mortar.mesh.data import MeshData, Names, as_list, joined_names
from fenics_mortar.utils.arrays import Array, Indices
from fenics_mortar.utils.errors import MeshError, check_same_texts, together
from fenics_mortar.utils.ranks import on_any_rank, sum_over_ranks


class Reaction(NamedTuple):
    """Force and moment that Dirichlet conditions on a boundary exert, equal on all ranks.

    The residual of all forces (stresses, loads, contact with friction, obstacles, inertia) is
    summed over the prescribed dofs of the boundary, whichever condition prescribes them; nothing
    supports free components. That of a rigid boundary contains its push. A corner belongs to all
    its boundaries: its force is in the reaction of each of them, and once in that of a list of
    them. The reaction of the list of all supports, the loads and the forces on obstacles are
    therefore in equilibrium, in dynamics with the inertia. Weak springs that restrain a body, as a
    report then says, are no support.

    Attributes:
        force: Force, shape (2,) [stress length]; with a thickness [force]. In space (3,) [force].
        moment: Moment about ``about``, counterclockwise [stress length^2]; with a thickness
            [force length]. In space a vector, shape (3,) [force length]. Levers are those of the
            present positions.
        about: The point of reference, shape (dim,) [length].

    Note:
        On bodies of revolution the radial component is the sum around the axis, as that of
        ``PairView.total_force``, and the moment is zero by symmetry.
    """

    force: Array
    moment: float | Array
    about: Array


def named_boundary(
    bulk: Bulk, given: list[MeshData], names: Names, about: npt.ArrayLike | None
) -> tuple[MeshData, Array]:
    """Mesh with some names of boundaries, and point of reference (dim,) [length] (collective).

    Args:
        bulk: The bodies.
        given: Meshes with names, those of the pairs or one of the user.
        names: Names or tags of the boundaries.
        about: The point of reference, or ``None`` for the origin.

    Raises:
        MeshError: On all ranks, if no mesh has the names.
        ValueError: On all ranks, if ``about`` is not a point.
    """
    with together(bulk.comm, "reaction"):
        point = _point(about, bulk.space.dim)
        if not given:
            raise MeshError("without pairs there are no names of boundaries; expected data=")
        if any(data.mesh is not bulk.V.mesh for data in given):
            raise MeshError("data belongs to another mesh than u")
        known = [
            data
            for data in given
            if all((isinstance(name, str) and name in data.boundaries) for name in as_list(names))
        ]
        data = (known or given)[0]
        tags = data.boundary_tags(names)
    check_same_texts(bulk.comm, "reaction", {"boundary": tags, "about": point})
    return data, point


def reaction_of(bulk: Bulk, forces: Array, data: MeshData, names: Names, about: Array) -> Reaction:
    """Sum of forces at the prescribed dofs of some boundaries (collective).

    Args:
        bulk: The bodies.
        forces: Bulk residual plus contact forces, shape (owned dofs,) [stress length].
        data: Mesh with the names.
        names: Names or tags of the boundaries; a node of several of them counts once.
        about: The point of reference, shape (dim,) [length].

    Raises:
        MeshError: On all ranks, if a boundary has no facets, or if no dof there is prescribed.
    """
    nodes = _nodes(bulk, data.boundary_facets(names))
    dofs = bulk.space.dofs[nodes]
    prescribed = bulk.prescribed[dofs]
    if not on_any_rank(bulk.comm, bool(prescribed.any())):
        raise MeshError(
            f"boundary '{joined_names(names)}' has no prescribed dof, so that nothing supports the "
            f"body there; expected one with a Dirichlet condition: {_supported(bulk, data)}"
        )
    on_nodes = np.where(prescribed, forces[dofs], 0.0)
    arms = bulk.positions()[nodes] - about
    if bulk.space.dim == 3:
        sums = np.stack([on_nodes.sum(axis=0), np.cross(arms, on_nodes).sum(axis=0)])
        force, moment = sum_over_ranks(bulk.comm, sums)
        return Reaction(force, moment, about)
    moments = arms[:, 0] * on_nodes[:, 1] - arms[:, 1] * on_nodes[:, 0]
    moment = 0.0 if bulk.space.is_axisymmetric else float(moments.sum())
    x, y, moment = sum_over_ranks(bulk.comm, [*on_nodes.sum(axis=0), moment])
    return Reaction(np.array([x, y]), float(moment), about)


def _point(about: Any, dim: int) -> Array:
    """The point of reference (dim,) [length], the origin for ``None`` (local)."""
    try:
        point = np.zeros(dim) if about is None else np.array(about, np.float64)
    except (TypeError, ValueError):
        point = np.empty(0)
    if point.shape != (dim,) or not np.isfinite(point).all():
        x = "(x, y)" if dim == 2 else "(x, y, z)"
        raise ValueError(f"about={about!r}: expected a point {x}, or None for the origin")
    return point


def _nodes(bulk: Bulk, facets: npt.NDArray[np.int32]) -> Indices:
    """Nodes of the displacement owned by this rank on facets, shape (k,) (collective)."""
    dim = bulk.space.dim
    bulk.V.mesh.topology.create_connectivity(dim - 1, dim)
    nodes = np.asarray(fem.locate_dofs_topological(bulk.V, dim - 1, facets), np.int64)
    return nodes[nodes < bulk.space.num_nodes]


def _supported(bulk: Bulk, data: MeshData) -> list[str]:
    """Names of boundaries of which every node has a prescribed dof (collective)."""
    found = []
    for name, tag in data.boundaries.items():
        nodes = _nodes(bulk, data.facet_tags.find(tag))
        prescribed = bulk.prescribed[bulk.space.dofs[nodes]].any(axis=1)
        count, fixed = sum_over_ranks(bulk.comm, [len(nodes), prescribed.sum()])
        if 0 < count == fixed:
            found.append(name)
    return found
