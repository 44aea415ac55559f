# SPDX-License-Identifier: MIT
"""A scalar field on a contact surface: values at the nodes, and their dofs.

The values at the surface's nodes are E times the dofs. A field of the displacement's degree has one
dof at each node, with weight 1. A field of degree 1 beside a displacement of degree 2 has none at
nodes inside edges and facets; its value there is the mean of their corners. E is then part of D and
M of the field: jumps are D E T, and the loads of fluxes q are E^T D^T q.

The surface of some boundary tags: curves in the plane, faces in space.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import coo_array, csr_array, diags, eye

import basix
import ufl
from dolfinx import fem

from fenics_mortar.interface.curve_surface import extract_curve
from fenics_mortar.interface.faces import extract_faces
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.surfaces import Surface, replicate, tagged_facets
from fenics_mortar.utils import compat

if TYPE_CHECKING:
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices


@dataclass(frozen=True)
class Trace:
    """A scalar field on a surface.

    Attributes:
        surface: The surface.
        dofs: Global dofs that determine the value at each node, -1 for none, shape (n, r).
        weights: Their weights, zero for none, shape (n, r) [1].
        local_dofs: Local dofs of the nodes owned by this rank, shape (owned nodes, r).
        is_mine: Whether this rank owns a dof of ``dofs``, of that shape, bool.
        first: Global number of the first dof of this rank.
    """

    surface: Any
    dofs: Indices
    weights: Array
    local_dofs: Indices
    is_mine: Flags
    first: int

    def gather(self, values: Array) -> Array:
        """Values at the nodes, shape (n,) [their unit], equal on all ranks (collective).

        Args:
            values: Values of all local dofs, ghosts included, shape (local dofs,).
        """
        at_nodes = (self.weights[self.surface.owned] * values[self.local_dofs]).sum(axis=1)
        return replicate(at_nodes[:, None], self.surface.owners, self.surface.comm)[:, 0]

    def scatter_add(self, nodal: Array, target: Array) -> None:
        """Add E^T times replicated ``nodal`` (n,) to the owned dofs of ``target`` (local).

        Args:
            nodal: Loads of the nodes, shape (n,) [any unit].
            target: Local array, shape (owned dofs,) or longer; changed in place.
        """
        mine = self.is_mine
        np.add.at(target, self.dofs[mine] - self.first, (self.weights * nodal[:, None])[mine])

    def columns(self, nodes: Indices, values: Array) -> tuple[Indices, Array]:
        """Dofs and derivatives by dofs, for derivatives by values at nodes (local).

        Args:
            nodes: Nodes, shape (b, k).
            values: Derivatives by their values, shape (b, r, k) [any unit].

        Returns:
            Dofs, shape (b, k r'), and derivatives by them, shape (b, r, k r').
        """
        width = nodes.shape[1] * self.dofs.shape[1]
        dofs = self.dofs[nodes].reshape(len(nodes), width)
        spread = values[..., None] * self.weights[nodes][:, None]
        return dofs, spread.reshape(*values.shape[:2], width)

    def rows(self, block: Block) -> Block:
        """E^T times a block whose rows are nodes of the surface: rows are dofs (local)."""
        dofs, values = self.columns(block.rows, np.swapaxes(block.values, 1, 2))
        return Block(dofs, block.columns, np.ascontiguousarray(np.swapaxes(values, 1, 2)))

    def interpolation(self, dofs: Indices) -> csr_array:
        """E, with columns in the order of some dofs (d,), ascending, that hold its own (local).

        Returns:
            Shape (n, d) [1].
        """
        node, part = np.nonzero(self.dofs >= 0)
        column = np.searchsorted(dofs, self.dofs[node, part])
        shape = len(self.dofs), dofs.size
        return coo_array((self.weights[node, part], (node, column)), shape=shape).tocsr()

    def spreads(self, prescribed: Flags, *, at_vertices: bool) -> tuple[csr_array, csr_array]:
        """The matrices A of a flux, and of one that is conducted perfectly (collective).

        See ``contact.fluxes``; shape (n, n) [1] each.

        Args:
            prescribed: Whether a local dof has a Dirichlet value, shape (local dofs,), bool.
            at_vertices: Whether multipliers are at vertices alone.
        """
        slave, count, linear = self.surface, self.surface.num_nodes, self.dofs.shape[1] > 1
        at_carriers = csr_array(eye(count))
        if linear:
            inner, corners, weights = slave.between_corners
            first = np.unique(inner, return_index=True)[1]
            rows = np.repeat(inner[first], corners.shape[1])
            values = np.broadcast_to(weights[first], corners[first].shape).ravel()
            between = coo_array((values, (rows, corners[first].ravel())), shape=(count, count))
            at_carriers = csr_array(diags((~slave.inner).astype(float)) + between)
        facets = slave.corners if at_vertices or linear else slave.facets
        of_facets = np.repeat(np.arange(len(facets)), facets.shape[1]), facets.ravel()
        beside = coo_array((np.ones(facets.size), of_facets), shape=(len(facets), count)).tocsr()
        free = self.gather(prescribed.astype(float)) < 1.0
        others = (beside.T @ beside) @ diags(free.astype(float))
        sums = others.sum(axis=1)
        kept = free | (sums == 0.0)
        shares = np.where(kept, 0.0, 1.0 / np.where(sums > 0.0, sums, 1.0))
        handed = diags(kept.astype(float)) + diags(shares) @ others
        both = at_carriers, csr_array(at_carriers @ handed)
        for spread in both:
            spread.eliminate_zeros()  # times inf
        return both


def trace_of(space: DisplacementSpace, field: Any, surface: Surface) -> Trace:
    """The trace of a scalar field on a surface (collective).

    Args:
        space: The displacement's nodes, and the space of all unknowns.
        field: Number of the field's sub-space in a mixed space, or a function of its own space.
        surface: The surface.

    Raises:
        ValueError: On all ranks, if there is no such scalar field, or if its values on facets are
            not determined by those at the nodes.
    """
    alone = isinstance(field, fem.Function)
    of_field = field.function_space if alone else _sub_space(space, field)
    _check(space, of_field, field)
    index_map = space.V.dofmap.index_map
    shape = index_map.size_local + index_map.num_ghosts, 2 ** (surface.dim - 1)
    dofs, weights = np.full(shape, -1), np.zeros(shape)
    for node, parts in _pairs(space.V, of_field):
        for part, (dof, weight) in enumerate(parts):
            dofs[node, part], weights[node, part] = dof, weight
    begin, _ = index_map.local_range
    mine = surface.nodes[surface.owned] - begin
    local_dofs, weights = dofs[mine], weights[mine]
    comm, whole = surface.comm, (of_field if alone else space.whole).dofmap.index_map
    first, num_owned = whole.local_range[0], whole.size_local
    named = whole.local_to_global(np.maximum(local_dofs, 0).ravel().astype(np.int32))
    numbers = np.where(local_dofs >= 0, np.reshape(named, local_dofs.shape), -1)
    everywhere = replicate(numbers.astype(np.int64), surface.owners, comm)
    weights = replicate(weights, surface.owners, comm)
    used = slice(0, int((everywhere >= 0).sum(axis=1).max(initial=1)))
    everywhere, weights = everywhere[:, used].copy(), weights[:, used].copy()
    is_mine = (everywhere >= first) & (everywhere < first + num_owned)
    return Trace(surface, everywhere, weights, local_dofs[:, used].copy(), is_mine, first)


def _sub_space(space: DisplacementSpace, field: Any) -> Any:
    """The sub-space of a scalar field, a view of the mixed space (local).

    dolfinx 0.5 cannot collapse it on ranks without cells.

    Raises:
        ValueError: On all ranks.
    """
    whole = space.whole
    if not space.is_mixed:
        raise ValueError(
            f"field={field!r}: u is no mixed function; expected a function of a mixed space with "
            "the displacement and the scalar field, or the field's own function"
        )
    if field not in range(whole.num_sub_spaces) or field == space.part:
        others = [str(part) for part in range(whole.num_sub_spaces) if part != space.part]
        raise ValueError(
            f"field={field!r}: expected the number of another sub-space than the displacement's: "
            f"{', '.join(others)}"
        )
    return whole.sub(field)


def _check(space: DisplacementSpace, V: Any, field: Any) -> None:
    """Reject fields whose values on facets are not determined by the nodes (local).

    Raises:
        ValueError: On all ranks.
    """
    if V.mesh is not space.V.mesh:
        raise ValueError(f"field={field!r}: expected a function on the mesh of the problem")
    (at_vertex, on_facet), (_, of_u) = _numbers_of_dofs(V), _numbers_of_dofs(space.V)
    corners = len(_entities(V.mesh)[-2][0])
    if ufl.TestFunction(V).ufl_shape or at_vertex != 1 or on_facet not in (corners, of_u):
        raise ValueError(
            f"field={field!r}: expected a continuous scalar field of Lagrange elements, of degree "
            "1 or of that of the displacement"
        )


def _numbers_of_dofs(V: Any) -> tuple[int, int]:
    """Numbers of dofs at a vertex, and on a facet with its ends, without components."""
    layout = V.dofmap.dof_layout
    on_facet = layout.entity_closure_dofs(V.mesh.topology.dim - 1, 0)
    return len(layout.entity_dofs(0, 0)), len(on_facet)


def _entities(mesh: Any) -> Any:
    """Vertices of the entities of a cell, by dimension and number."""
    return basix.topology(getattr(basix.CellType, compat.cell_name(mesh)))


def _pairs(V: Any, T: Any) -> Iterator[tuple[Any, list[tuple[Any, float]]]]:
    """Nodes of ``V`` on facets, and the dofs of the field with their weights there."""
    nodes, of_field = compat.dofmap(V), compat.dofmap(T)
    layouts = V.dofmap.dof_layout, T.dofmap.dof_layout
    for dim, entities in enumerate(_entities(V.mesh)[:-1]):
        for entity, vertices in enumerate(entities):
            for node in layouts[0].entity_dofs(dim, entity):
                own = layouts[1].entity_dofs(dim, entity)
                if len(own):
                    yield nodes[:, node], [(of_field[:, own[0]], 1.0)]
                    continue
                corners = [layouts[1].entity_dofs(0, vertex)[0] for vertex in vertices]
                share = 1.0 / len(corners)
                yield nodes[:, node], [(of_field[:, corner], share) for corner in corners]


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
        SurfaceError: On all ranks, if a facet is not on the boundary of the mesh, and as
            ``extract_curve`` and ``extract_faces`` do.
    """
    extract = extract_curve if space.V.mesh.topology.dim == 2 else extract_faces
    return extract(space, tagged_facets(space.V.mesh, facet_tags, tags, name), name)
