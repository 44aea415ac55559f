# SPDX-License-Identifier: MIT
"""Contact surfaces: facets with given tags, replicated on every rank.

A surface is a set of curves in the plane, see ``curve_surface``, or of faces in space, see
``faces``. Both are made from ``tagged_facets``, whose nodes are in order, with the body on the left
(``outward_nodes``), and gathered from all ranks. ``Roles`` are the slave and master roles of the
facets of a surface that may touch itself, see ``self_contact``.

A surface has O(N^((d - 1) / d)) nodes if the bulk has N in d dimensions, so every rank stores all
of it: the contact evaluation does not depend on the ownership of facets. The numbering of nodes
follows from coordinates and input numbers alone; it does not depend on the partition of the mesh.

Communication per rank and Newton iteration in the plane, with S slave nodes, M master nodes and B
nodes on the outlines of their bodies, for any number of ranks:

======================================================  =================
quantity                                                bytes
======================================================  =================
positions (slave of a rigid obstacle: 16 S)             16 B
sums of D, gap and cover                                32 S
contact forces                                          16 (S + M)
forces on slave nodes, from which multipliers follow    16 S
weights in multigrid                                    8 S
sum                                                     72 S + 16 M + 16 B
======================================================  =================

The work on all nodes (normals, tree of boxes) is repeated on each rank. With the solver
"iterative", the strip along the interface costs more: its right-hand side is sent to all ranks in
each linear iteration, and each rank factorizes the whole strip. The README of
`demos.studies.performance` has measurements and a simulation of up to 1000 ranks.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array

import basix
from dolfinx import mesh as dmesh

from fenics_mortar.interface import reference
from fenics_mortar.kernels.sight import tabulate_masters
from fenics_mortar.kernels.space.normals import facets_around
from fenics_mortar.mesh.space import DisplacementSpace, NodalThickness, cells_of_facets
from fenics_mortar.utils import compat, errors, ranks
from fenics_mortar.utils.arrays import Array, Flags, Indices, Numbers, summed

# Fraction of the whole integral [1] below which a node carries no multiplier, for two integrals.
# (1) Shape function times thickness, over the nodal area, which may become zero or negative after
# slight motions: it is 0.05 at a vertex of quadratic facets at 1/40 of a facet from the axis of
# revolution, and at least 2/3 for linear facets. (2) Cover: the multiplier function is handed over
# to a neighbour with twice the cover. Of two nodes with equal small covers either could carry the
# force, and rounding would decide. Regions in space below it are unresolved.
MIN_SHARE = 0.05


@dataclass(frozen=True, kw_only=True)
class SurfaceNodes:
    """Nodes of boundaries; equal on all ranks except ``owned`` and ``local_dofs``.

    Attributes:
        X: Reference positions, shape (n, dim) [length].
        nodes: Global number of each node in the displacement's space, shape (n,).
        owners: Rank that owns each node, shape (n,).
        owned: Indices in these arrays of the nodes owned by this rank, shape (owned nodes,).
        dofs: Global dofs of each node, shape (n, dim).
        local_dofs: Local dofs of the nodes owned by this rank, shape (owned nodes, dim).
        comm: Communicator of the mesh.
    """

    # Attributes of these classes with a row for each node, and with numbers of nodes.
    by_node: ClassVar = {
        "X", "nodes", "owners", "dofs", "is_open", "bodies", "previous", "following",
    }  # fmt: skip
    numbers: ClassVar = {"previous", "following", "facets", "segments", "ends"}

    X: Array
    nodes: Indices
    owners: Indices
    owned: Indices
    dofs: Indices
    local_dofs: Indices
    comm: MPI.Comm

    @cached_property
    def dim(self) -> int:
        """Number of coordinates: 2 in the plane, 3 in space."""
        return self.X.shape[1]

    @cached_property
    def num_nodes(self) -> int:
        """Number of nodes of the surface."""
        return self.X.shape[0]

    def gather(self, values: Array) -> Array:
        """Gather nodal values of a function of the space on all ranks (collective).

        Args:
            values: Local array of all dofs, owned ones first, shape (local dofs,).

        Returns:
            Values at the nodes, shape (n, dim) [their unit], equal on all ranks.
        """
        return replicate(values[self.local_dofs], self.owners, self.comm)

    def of_nodes(self, kept: Indices, **others: Any) -> Any:
        """The same with some of its nodes (local).

        Args:
            kept: The nodes, shape (k,).
            others: Other attributes to change, as facets between them, with the present nodes.
        """
        given, number = vars(self) | others, np.full(self.num_nodes + 1, -1)
        number[kept] = np.arange(kept.size)
        mine = np.isin(self.owned, kept)
        new = others | {name: given[name][kept] for name in self.by_node & given.keys()}
        new |= {name: number[new.get(name, given[name])] for name in self.numbers & given.keys()}
        owned, local_dofs = number[self.owned[mine]], self.local_dofs[mine]
        return replace(self, owned=owned, local_dofs=local_dofs, **new)


@dataclass(frozen=True, kw_only=True)
class Surface(SurfaceNodes, ABC):
    """Facets of some boundary tags.

    Attributes:
        name: Name used in messages.
        facets: Nodes of each facet, shape (m, K).
        thickness: Out-of-plane thickness in the plane; ``None`` if it is one, and in space.
        roles: Which facets are masters of which, of a surface that may touch itself.
    """

    name: str
    facets: Indices
    thickness: NodalThickness | None = None
    roles: Roles | None = None

    @cached_property
    def extent(self) -> float:
        """Diagonal of the bounding box in the reference state [length]."""
        return float(np.hypot.reduce(np.ptp(self.X, axis=0)))

    def of_nodes(self, kept: Indices, **others: Any) -> Any:
        """The surface with some of its nodes, of which no facet touches another (local)."""
        thickness = self.thickness and self.thickness.of(kept)
        return super().of_nodes(kept, **{"thickness": thickness, "roles": None} | others)

    @cached_property
    def around(self) -> tuple[Indices, Indices, Indices]:
        """Facets at each node: starts (n + 1,), their numbers and places of the node, (e,) each."""
        return facets_around(self.facets, self.num_nodes)

    @cached_property
    def corners(self) -> Indices:
        """Nodes at the corners of each facet, counter-clockwise, in the plane its ends, (m, c)."""
        return self.facets[:, reference.corner_places(self.facets.shape[1], self.dim)]

    @cached_property
    def degree(self) -> int:
        """Polynomial degree of the facets."""
        return 1 if self.corners.shape == self.facets.shape else 2

    @cached_property
    def functions_move(self) -> bool:
        """Whether multiplier functions change with the positions of wholly covered facets."""
        return self.degree > 1 or (self.thickness is not None and self.thickness.by_x != 0.0)

    @cached_property
    def inner(self) -> Flags:
        """Whether a node is no corner of a facet, shape (n,), bool."""
        inner = np.ones(self.num_nodes, bool)
        inner[self.corners] = False
        return inner

    @cached_property
    def from_corners(self) -> csr_array:
        """Values at the nodes of linear functions by those at the corners, shape (n, n) [1]."""
        count, size = self.facets.shape
        nodes, first = np.unique(self.facets, return_index=True)
        corners = np.repeat(self.corners, size, axis=0)[first]
        weights = np.tile(reference.linear_values(size, self.dim), (count, 1))[first]
        at = np.repeat(nodes, corners.shape[1]), corners.ravel()
        found = coo_array((weights.ravel(), at), shape=(self.num_nodes,) * 2).tocsr()
        found.eliminate_zeros()
        return found

    @property
    def products(self) -> Array:
        """Integrals of products of two shape functions times the thickness, (m, K, K) [area]."""
        thickness = None if self.thickness is None else self.thickness.at(self.X)[self.facets]
        return shape_products(self.X[self.facets], thickness)

    @cached_property
    def areas(self) -> Array:
        """Integrals of the shape functions times the thickness, undeformed, (m, K) [area]."""
        return self.products.sum(axis=2)

    @cached_property
    def measures(self) -> Array:
        """``areas`` without the thickness, shape (m, K) [length, in space area]."""
        if self.thickness is None:
            return self.areas
        return shape_products(self.X[self.facets]).sum(axis=2)

    @cached_property
    def facet_sizes(self) -> Array:
        """Lengths of the undeformed facets, in space roots of areas, shape (m,) [length]."""
        return np.asarray(self.measures.sum(axis=1) ** (1.0 / (self.dim - 1)))

    def distortions(self, u: Array) -> Array:
        """Largest relative motion of neighbouring corners over facet sizes, shape (m,) [1] (local).

        Args:
            u: Displacements of the nodes, shape (n, dim) [length].
        """
        corners = u[self.corners]
        change = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        return np.asarray(change.max(axis=1, initial=0.0) / self.facet_sizes)

    @property
    @abstractmethod
    def nodal_lengths(self) -> Array:
        """Size of the surface around each node, shape (n,) [length]."""

    @cached_property
    def full_cover(self) -> Array:
        """Integral of each nodal shape function times the thickness, undeformed, (n,) [area].

        Of corners of triangles with six nodes, those of linear functions.
        """
        return self.on_nodes(reference.covers(self.areas))

    @cached_property
    def mass(self) -> csr_array:
        """Integrals of products of two shape functions, undeformed, shape (n, n) [area]."""
        facets, size, shape = self.facets, self.facets.shape[1], (self.num_nodes, self.num_nodes)
        at = np.repeat(facets, size, axis=1).ravel(), np.tile(facets, size).ravel()
        return coo_array((self.products.ravel(), at), shape=shape).tocsr()

    @property
    @abstractmethod
    def mean_thickness(self) -> Array | float:
        """Areas over lengths of the nodes, shape (n,) [length]."""

    @property
    @abstractmethod
    def stencil(self) -> Indices:
        """Nodes on which the normal of each node depends, -1 for none, shape (n, s)."""

    @cached_property
    def stencil_dofs(self) -> Indices:
        """Global dofs of the nodes in ``stencil``, -1 for none, shape (n, dim s)."""
        return self.dofs_of(self.stencil)

    @cached_property
    def nodal_areas(self) -> Array:
        """Nodal lengths times mean thickness, (n,) [area]; positive even if a weight is not."""
        return self.nodal_lengths * self.mean_thickness

    @cached_property
    def weightless(self) -> Flags:
        """Nodes whose shape function has no positive integral with the thickness, shape (n,).

        The vertex of a quadratic facet on the axis of revolution: int (1 - s) (1 - 2 s) s ds = 0.
        """
        return self.full_cover < MIN_SHARE * self.nodal_areas

    def on_nodes(self, of_facets: Array) -> Array:
        """Sums at the nodes, (n,), of values (m, K) at the nodes of facets [their unit] (local)."""
        return summed(of_facets.ravel(), self.facets.ravel(), self.num_nodes)

    def dofs_of(self, which: Indices) -> Indices:
        """Global dofs of nodes of the surface (local).

        Args:
            which: Numbers of the nodes, -1 for none, shape (..., k).

        Returns:
            Dofs, -1 for none, shape (..., dim k).
        """
        dofs = np.where(which[..., None] >= 0, self.dofs[which], -1)
        return dofs.reshape(*which.shape[:-1], self.dim * which.shape[-1])

    def scatter_add(self, values: Array, target: Array) -> None:
        """Add replicated nodal ``values`` (n, dim) to the owned dofs of a local array (local).

        Args:
            values: Shape (n, dim).
            target: Local array of dofs, shape (owned dofs,) or longer; changed in place.
        """
        np.add.at(target, self.local_dofs, values[self.owned])


def place_of_nodes(space: DisplacementSpace, nodes: Indices) -> dict[str, Any]:
    """Owners and dofs of a surface's nodes, the arguments of ``Surface`` (collective).

    Args:
        space: Nodes and dofs of the displacement.
        nodes: Global numbers of the nodes, equal on all ranks, shape (n,).
    """
    comm = space.V.mesh.comm
    begin, end = space.V.dofmap.index_map.local_range
    starts = np.array(comm.allgather(begin))
    owners = np.searchsorted(starts, nodes, side="right") - 1
    owned = np.flatnonzero((nodes >= begin) & (nodes < end))
    local_dofs = space.dofs[nodes[owned] - begin]
    dofs = replicate(local_dofs + space.first, owners, comm)
    place = {"nodes": nodes, "owners": owners, "owned": owned, "comm": comm}
    return place | {"dofs": dofs, "local_dofs": local_dofs}


def replicate(mine: npt.NDArray[Any], owners: Indices, comm: MPI.Comm) -> npt.NDArray[Any]:
    """Gather the values of all ranks in the order of the nodes (collective).

    Args:
        mine: Values at the nodes owned by this rank, in order, shape (owned nodes, c).
        owners: Rank that owns each node, equal on all ranks, shape (nodes,).
        comm: Communicator.

    Returns:
        Values at all nodes, shape (nodes, c), equal on all ranks.
    """
    if comm.size == 1:
        return np.ascontiguousarray(mine)
    everything = np.empty((owners.size, mine.shape[1]), mine.dtype)
    counts = np.bincount(owners, minlength=comm.size)
    comm.Allgatherv(np.ascontiguousarray(mine), (everything, mine.shape[1] * counts))
    ordered = np.empty_like(everything)
    ordered[np.argsort(owners, kind="stable")] = everything
    return ordered


# Default number of Gauss points per segment, or between two neighbouring nodes of a facet. On
# linear facets errors of the gap are 6e-5, 7e-8, 3e-10 with 2, 3, 4 points, and rounding from 5 on.
POINTS = 5


def shape_products(x: Array, thickness: Array | None = None) -> Array:
    """Integrals of products of two shape functions over facets at ``x`` (m, K, dim) (local).

    Shape (m, K, K) [area]. With ``thickness`` (m, K) [length] they are those times the thickness.
    """
    in_plane = x.shape[2] == 2
    rule = reference.gauss_rule(POINTS) if in_plane else reference.rule_of_triangles(x.shape[1])
    T = reference.tabulate(rule[0], x.shape[1])
    tangents, N = np.einsum("qak,mkc->amqc", T[:, 1:], x), T[:, 0]
    J = np.linalg.norm(tangents[0] if in_plane else np.cross(*tangents), axis=2)
    if thickness is not None:
        J = J * (thickness @ N.T)
    return np.asarray(np.einsum("mq,qk,ql->mkl", J * rule[1], N, N, optimize=True))


def tagged_facets(mesh: Any, facet_tags: Any, tags: Sequence[int], name: str) -> Numbers:
    """Local facets of some tags that this rank owns, shape (m,) (collective).

    A facet is included if any rank tags it, whether that rank owns the facet or not.

    Args:
        mesh: The mesh.
        facet_tags: Its facet tags.
        tags: The tags.
        name: Name of the surface, used in messages.

    Raises:
        SurfaceError: On all ranks, if a facet is not on the boundary of the mesh.
    """
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    facet_map = mesh.topology.index_map(dim - 1)
    begin, end = facet_map.local_range
    tagged = np.concatenate([facet_tags.find(tag) for tag in tags])
    tagged = facet_map.local_to_global(tagged.astype(np.int32))
    tagged = np.unique(np.concatenate(mesh.comm.allgather(tagged)))
    tagged = (tagged[(tagged >= begin) & (tagged < end)] - begin).astype(np.int32)
    inside = np.setdiff1d(tagged, dmesh.exterior_facet_indices(mesh.topology)).astype(np.int32)
    midpoints = dmesh.compute_midpoints(mesh, dim - 1, inside)[:, :dim]
    count, where = errors.count_points(mesh.comm, midpoints)
    if count:
        raise errors.SurfaceError(
            f"surface '{name}': {count} of its facets are not on the boundary of the mesh, "
            f"one at {where}; expected facets of the outline of one body (in a crack, both faces "
            "have the same nodes there: gmsh's plugin Crack does not cut junctions of cracks)"
        )
    return tagged


def outward_nodes(V: Any, facets: Numbers) -> Indices:
    """Local nodes (m, K) of facets in order, seen from outside of the body (local).

    In the plane those of a curve with the body on its left; in space see ``faces``. The side is
    determined by the cell's corners: all nodes of a thin bent cell may lie on the other side of its
    facet's chord. Requires the connectivities facets -> cells and cells -> facets.

    Args:
        V: Space of the displacement.
        facets: Local facets, shape (m,).
    """
    layout, dofmap, dim = V.dofmap.dof_layout, compat.dofmap(V), V.mesh.topology.dim
    x = V.tabulate_dof_coordinates()[:, :dim]
    cells, places = cells_of_facets(V.mesh, facets)
    cell = basix.topology(getattr(basix.CellType, compat.cell_name(V.mesh)))
    corners = [layout.entity_dofs(0, k)[0] for k in range(len(cell[0]))]
    size = len(layout.entity_closure_dofs(dim - 1, 0))
    ends = reference.corner_places(size, dim)
    found = np.empty((facets.size, size), np.int64)
    for place in range(len(cell[dim - 1])):
        at = np.flatnonzero(places == place)
        nodes = dofmap[cells[at]]
        both = [nodes[:, _dofs_of_facet(layout, cell, place, turn)] for turn in (False, True)]
        inside, on_facet = x[nodes[:, corners]].mean(axis=1), x[both[0]]
        away = on_facet[:, ends].mean(axis=1) - inside
        outward = np.einsum("ec,ec->e", outward_normals(on_facet), away) > 0.0
        found[at] = np.where(outward[:, None], *both)
    return found


def outward_normals(x: Array) -> Array:
    """Outward normals of chords or corners of facets at ``x`` (f, K, d), (f, d) [length, area].

    Their lengths are those of the chords, in space twice the areas (local).
    """
    if x.shape[2] == 2:
        chord = x[:, -1] - x[:, 0]
        return np.stack([chord[:, 1], -chord[:, 0]], axis=1)
    last = reference.CORNERS[x.shape[1]] - 1
    return np.cross(x[:, last - 1] - x[:, 0], x[:, last] - x[:, last - 2])


def _dofs_of_facet(layout: Any, cell: Any, facet: int, turn: bool) -> list[int]:
    """Dofs of a facet of a cell in the order of its nodes, in the reverse sense if ``turn``."""
    if len(cell) == 3:
        first, last, *between = layout.entity_closure_dofs(1, facet)
        return [last, *between, first] if turn else [first, *between, last]
    vertices = list(cell[2][facet])
    if len(vertices) == 4:  # a tensor product of two intervals
        vertices[2], vertices[3] = vertices[3], vertices[2]
    if turn:
        vertices = [vertices[0], *vertices[:0:-1]]
    dofs = [layout.entity_dofs(0, vertex)[0] for vertex in vertices]
    for a, b in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        edge = next(e for e, ends in enumerate(cell[1]) if set(ends) == {a, b})
        dofs.extend(layout.entity_dofs(1, edge))
    return [*dofs, *layout.entity_dofs(2, facet)]


def facets_of_all_ranks(
    V: Any, mine: Indices, values: npt.NDArray[Any]
) -> tuple[Indices, Array, npt.NDArray[Any], Indices]:
    """Facets of all ranks, and their nodes in the order of the global numbers (collective).

    Args:
        V: Space of the displacement.
        mine: Local nodes of the facets of this rank, shape (m, K).
        values: Any values of the local nodes, shape (local nodes, ...).

    Returns:
        Global nodes (n,), their reference positions (n, dim) [length], their values (n, ...), and
        the facets in terms of them, (facets, K).
    """
    local, number = np.unique(mine, return_inverse=True)
    to_global = V.dofmap.index_map.local_to_global(local.astype(np.int32)).astype(np.int64)
    x = V.tabulate_dof_coordinates()[local, : V.mesh.geometry.dim]
    parts = to_global, x, values[local], to_global[number.reshape(mine.shape)]
    nodes, X, of_nodes, facets = ranks.from_all_ranks(V.mesh.comm, parts)
    nodes, first = np.unique(nodes, return_index=True)
    return nodes, X[first], of_nodes[first], np.searchsorted(nodes, facets)


@dataclass(frozen=True)
class Roles(ABC):
    """Order of the facets of a surface.

    Attributes:
        keys: Position of each facet in the order, and number of its connected part, shape (f, 2).
    """

    keys: Indices

    @abstractmethod
    def of(self, facets: Indices) -> tuple[Any, ...]:
        """Arguments of the kernels for the slave facets ``facets`` (k,)."""

    @abstractmethod
    def masters_of(self, facets: Indices) -> Flags:
        """Whether each facet is a master of the facets ``facets`` (k,), shape (k, f), bool."""

    def masters_of_nodes(self, facets: Indices, nodes: Indices) -> Flags:
        """Whether a facet is a master of a facet at each of ``nodes`` (k,), (k, f), bool (local).

        Args:
            facets: Nodes of the facets, shape (f, K).
            nodes: Numbers of the nodes, shape (k,).
        """
        masters = np.zeros((nodes.size, len(self.keys)), bool)
        index = np.full(facets.max() + 1, -1)
        index[nodes] = np.arange(nodes.size)
        facet, column = np.nonzero(index[facets] >= 0)
        np.logical_or.at(masters, index[facets[facet, column]], self.masters_of(facet))
        return masters


@dataclass(frozen=True)
class CurveRoles(Roles):
    """Order of the facets of curves and their positions along these.

    Attributes:
        arcs: Start and end of each facet along its curve, undeformed, and length of the curve if it
            is closed, else inf, shape (f, 3) [length].
        ends: Of both ends of each facet the junction of cracks there, -1 for none, and the crack
            that leaves it, shape (f, 2, 2).
    """

    arcs: Array
    ends: Indices

    def of(self, facets: Indices) -> tuple[Indices, Indices, Array, Indices]:
        """Arguments of the kernels for slave facets (k,), see ``kernels.sight``."""
        return facets, self.keys, self.arcs, self.ends

    def masters_of(self, facets: Indices) -> Flags:
        """Whether each facet is a master of the facets ``facets`` (k,), shape (k, f), bool."""
        masters = np.empty((facets.size, len(self.keys)), bool)
        tabulate_masters(self.keys, self.arcs, self.ends, facets, masters)
        return masters


@dataclass(frozen=True)
class FaceRoles(Roles):
    """Order of the facets of faces, and those that are too near to touch each other.

    Attributes:
        near: Each facet, its neighbours and theirs, -1 for none, shape (f, c).
    """

    near: Indices

    def of_nodes(self, facets: Indices, count: int) -> tuple[Indices, Indices]:
        """First and last position in the order of the facets at each node, (count,) each (local).

        Args:
            facets: Nodes of the facets, shape (f, K).
            count: Number of nodes.
        """
        order = self.keys[:, :1]
        earliest, latest = np.full(count, len(order)), np.full(count, -1)
        np.minimum.at(earliest, facets, order)
        np.maximum.at(latest, facets, order)
        return earliest, latest

    def of(self, facets: Indices) -> tuple[Indices, Indices]:
        """Arguments of ``kernels.space.pairs``, of all facets."""
        return np.ascontiguousarray(self.keys[:, 0]), self.near

    def masters_of(self, facets: Indices) -> Flags:
        """Whether each facet is a master of the facets ``facets`` (k,), shape (k, f), bool."""
        order = self.keys[:, 0]
        masters = order[facets, None] < order
        at, column = np.nonzero(self.near[facets] >= 0)
        masters[at, self.near[facets[at], column]] = False
        return masters
