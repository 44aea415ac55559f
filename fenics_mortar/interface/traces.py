# SPDX-License-Identifier: MIT
"""The surfaces of a pair, and the values of scalar fields on them.

``extract_surface`` makes the surface of some boundary tags, ``surfaces_of`` those of a pair, with
checks of shared nodes; ``substitutes_of`` replaces nodes without weight. ``Trace`` gives the values
of a scalar field at the nodes of a surface by its dofs.
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

from fenics_mortar.interface.corners import TURN
from fenics_mortar.interface.curve_surface import extract_curve, turn_between
from fenics_mortar.interface.faces import extract_faces
from fenics_mortar.interface.mortar import Block
from fenics_mortar.interface.surfaces import Surface, replicate, tagged_facets
from fenics_mortar.obstacles.obstacle import Obstacle
from fenics_mortar.utils import compat, errors, ranks

if TYPE_CHECKING:
    from fenics_mortar.mesh.space import DisplacementSpace
    from fenics_mortar.utils.arrays import Array, Flags, Indices


@dataclass(frozen=True)
class Trace:
    """A scalar field on a surface.

    The values at the surface's nodes are E times the dofs. A field of the displacement's degree has
    one dof at each node, with weight 1. A field of degree 1 beside a displacement of degree 2 has
    none at nodes inside edges and facets; its value there is the mean of their corners. E is then
    part of D and M of the field: jumps are D E T, and the loads of fluxes q are E^T D^T q.

    Attributes:
        surface: The surface.
        dofs: Global dofs that determine the value at each node, -1 for none, shape (n, r).
        weights: Their weights, zero for none, shape (n, r) [1].
    """

    surface: Any
    dofs: Indices
    weights: Array

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
        """E, with a column for each of some dofs (d,), ascending, which include its own (local).

        Returns:
            Shape (n, d) [1].
        """
        node, part = np.nonzero(self.dofs >= 0)
        column = np.searchsorted(dofs, self.dofs[node, part])
        shape = len(self.dofs), dofs.size
        return coo_array((self.weights[node, part], (node, column)), shape=shape).tocsr()

    def spreads(self, free: Flags, *, at_vertices: bool) -> tuple[csr_array, csr_array]:
        """The matrices A of a flux, and of one that is conducted perfectly (local).

        See ``contact.fluxes``; shape (n, n) [1] each.

        Args:
            free: Whether the value at a node is not prescribed, shape (n,), bool.
            at_vertices: Whether multipliers are at vertices alone.
        """
        slave, count, linear = self.surface, self.surface.num_nodes, self.dofs.shape[1] > 1
        at_carriers = slave.from_corners if linear else csr_array(eye(count))
        facets = slave.corners if at_vertices or linear else slave.facets
        of_facets = np.repeat(np.arange(len(facets)), facets.shape[1]), facets.ravel()
        beside = coo_array((np.ones(facets.size), of_facets), shape=(len(facets), count)).tocsr()
        others = (beside.T @ beside) @ diags(free.astype(float))
        sums = others.sum(axis=1)
        kept = free | (sums == 0.0)
        shares = np.where(kept, 0.0, 1.0 / np.where(sums > 0.0, sums, 1.0))
        handed = diags(kept.astype(float)) + diags(shares) @ others
        perfect = csr_array(at_carriers @ handed)
        perfect.eliminate_zeros()  # times inf
        return at_carriers, perfect


class FieldTraces:
    """Traces of a scalar field on the surfaces of a pair, and values at all of their dofs.

    Args:
        space: See ``trace_of``, as ``field``.
        field: The field.
        sides: The surfaces.

    Attributes:
        traces: The traces.
        dofs: All their dofs, ascending, shape (d,), replicated.
        interpolations: Matrices E of the traces, for the values at ``dofs``.
        owned: Global number of the first dof of this rank, and of the first one of the next rank.
    """

    def __init__(self, space: DisplacementSpace, field: Any, sides: Sequence[Surface]) -> None:
        self.traces = [trace_of(space, field, side) for side in sides]
        found = np.unique(np.concatenate([trace.dofs.ravel() for trace in self.traces]))
        self.dofs: Indices = found[found >= 0]
        self.interpolations = [trace.interpolation(self.dofs) for trace in self.traces]
        whole = field.function_space if isinstance(field, fem.Function) else space.whole
        self.owned = whole.dofmap.index_map.local_range
        self._places = slice(*np.searchsorted(self.dofs, self.owned))  # of this rank's ``dofs``
        self._mine, self._comm = self.dofs[self._places] - self.owned[0], sides[0].comm

    def gathered(self, values: Array | Flags) -> Array:
        """Values (owned dofs,) at ``dofs``, shape (d,) [their unit], on all ranks (collective)."""
        found = np.zeros(self.dofs.size)
        found[self._places] = values[self._mine]
        return ranks.sum_over_ranks(self._comm, found)

    def add(self, values: Array, target: Array) -> None:
        """Add ``values`` (d, ...) at the dofs to those of this rank in ``target`` (local)."""
        target[self._mine] += values[self._places]


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
    named = whole.local_to_global(np.maximum(local_dofs, 0).ravel().astype(np.int32))
    numbers = np.where(local_dofs >= 0, np.reshape(named, local_dofs.shape), -1)
    everywhere = replicate(numbers.astype(np.int64), surface.owners, comm)
    weights = replicate(weights, surface.owners, comm)
    used = slice(0, int((everywhere >= 0).sum(axis=1).max(initial=1)))
    return Trace(surface, everywhere[:, used].copy(), weights[:, used].copy())


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


def extract_surface(space: DisplacementSpace, facet_tags: Any, tags: list[int], name: str) -> Any:
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


def surfaces_of(pair: Any, space: DisplacementSpace, welds: Indices) -> tuple[Any, Any]:
    """Slave and master of a pair (collective).

    Both are the same object if the surface may touch itself. The surface of an obstacle has no
    nodes.

    Args:
        pair: The pair.
        space: Nodes and dofs of the displacement.
        welds: Pairs of nodes to be merged, shape (k, 2); see ``Surface.welded``.

    Raises:
        SurfaceError: On all ranks, if the surfaces share nodes other than tips of cracks.
    """
    tags = pair.data.facet_tags
    slave = extract_surface(space, tags, pair.slave_tags, pair.slave_name).welded(welds)
    if pair.master is None:
        return slave, slave
    if isinstance(pair.master, Obstacle):
        none = {"facets": slave.facets[:0], "thickness": None}
        master = slave.of_nodes(np.empty(0, np.int64), name=pair.master_name, **none)
    else:
        on_master = pair.data.boundary_tags(pair.master)
        master = extract_surface(space, tags, on_master, pair.master_name)
    master = master.welded(welds)
    _check_shared_nodes(slave, master)
    return slave, master


def _check_shared_nodes(slave: Any, master: Any) -> None:
    """Check that only tips of cracks are shared, where both surfaces end and fold back (local)."""
    j, turns = turns_at_shared(slave, master)
    wrong = np.flatnonzero(~(turns < TURN))
    if slave.dim == 3 and wrong.size:
        raise errors.SurfaceError(
            f"slave '{slave.name}' and master '{master.name}' share {wrong.size} nodes, one at "
            f"{errors.format_point(slave.X[j[wrong[0]]])}; expected surfaces of bodies that are "
            "not joined in the mesh: `fragment` and `removeDuplicateNodes` join them, and cracks "
            "in space are not supported"
        )
    if wrong.size and set(slave.nodes) == set(master.nodes):
        raise errors.SurfaceError(
            f"slave and master are the same surface, '{slave.name}': give the other one, or for "
            "contact of a surface with itself no master, ContactPair(data, slave)"
        )
    if wrong.size:
        reason = (
            "bodies are joined by nodes that both have, as after `fragment` or "
            "`removeDuplicateNodes`; the faces of a crack share its tips, where both end, and "
            "have different nodes everywhere else, as by gmsh's plugin Crack"
            if np.isnan(turns[wrong]).any()
            else "they meet at a corner of one body and do not face each other"
        )
        raise errors.SurfaceError(
            f"slave '{slave.name}' and master '{master.name}' share {wrong.size} nodes, one at "
            f"{errors.format_point(slave.X[j[wrong[0]]])}; expected different surfaces that are "
            f"not joined in the mesh: {reason}"
        )


def turns_at_shared(slave: Any, master: Any) -> tuple[Indices, Array]:
    """Nodes of the slave that are in both surfaces, and turns of the outline there (local).

    Returns:
        Their numbers in the slave, shape (k,), and turns to the left [radian], negative at the tip
        of a crack; nan unless one surface ends where the other begins, shape (k,).
    """
    j, l = equal_pairs(slave.nodes, master.nodes)
    j, l = (k[(j != l) | (slave is not master)] for k in (j, l))
    turns = np.full(j.size, np.nan)
    if slave.dim == 3:
        return j, turns
    for before, i, after, k in ((slave, j, master, l), (master, l, slave, j)):
        ends = np.flatnonzero((before.following[i] < 0) & (after.previous[k] < 0))
        i, k = i[ends], k[ends]
        start = before.along(i, range(-before.degree, 0))[:, 0]
        stop = after.along(k, range(after.degree, after.degree + 1))[:, 0]
        turns[ends] = turn_between(before.X[i] - before.X[start], after.X[stop] - after.X[k])
    return j, turns


def equal_pairs(a: Indices, b: Indices) -> tuple[Indices, Indices]:
    """All positions with a[j] == b[l], in the order of j and then l, each (k,) (local).

    Numbers may occur several times; no array of all pairs is needed.
    """
    order = np.argsort(b, kind="stable")
    first, stop = (np.searchsorted(b, a, side, order) for side in ("left", "right"))
    counts = stop - first
    before = np.cumsum(counts) - counts
    at = np.arange(counts.sum()) + np.repeat(first - before, counts)
    return np.repeat(np.arange(a.size), counts), order[at]


def at_tips(slave: Any, master: Any) -> Flags:
    """Whether a slave node is also one of the other face, at the tip of a crack, (slave nodes,).

    It has no gap, and therefore no multiplier.
    """
    j, turns = turns_at_shared(slave, master)
    found = np.zeros(slave.num_nodes, bool)
    found[j[turns < TURN]] = True
    return found


def substitutes_of(slave: Any, *, at_vertices: bool) -> tuple[Indices, Indices]:
    """Nodes without weight, and the next nodes that may have a multiplier, each (k,)."""
    if slave.dim == 3:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    alone, step = np.flatnonzero(slave.weightless), slave.degree if at_vertices else 1
    before, after = slave.along(alone, range(-step, step + 1, 2 * step)).T
    return alone, np.where(after >= 0, after, before)
